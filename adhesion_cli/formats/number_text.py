"""How text says a number: decimal mark, groups of digits, minus signs, a unit behind it."""

import re
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise, takewhile

import numpy as np

from ..core.model import Floats
from ..core.units import unit


def number_grammar(decimal: str) -> re.Pattern[str]:
    """ASCII digits, one decimal mark, an exponent; no hex, no "_", no grouping."""
    d = re.escape(decimal)
    return re.compile(rf"[+-]?(?:[0-9]+(?:{d}[0-9]*)?|{d}[0-9]+)(?:[eE][+-]?[0-9]{{1,3}})?")


_GROUPED = r"[+-]?[0-9]{1,3}(?:[., '][0-9]{3})+(?:[.,][0-9]*)?"
_NUMBER = re.compile("|".join((number_grammar(".").pattern, number_grammar(",").pattern, _GROUPED)))
is_plain_number = _NUMBER.fullmatch  # with either decimal mark, in groups of digits
_GROUPS = re.compile(
    r"[+-]?(?:[1-9][0-9]{0,2}([., '])[0-9]{3}(?:\1[0-9]{3})*|[0-9]{1,3})(?:([.,])[0-9]*)?"
)
_WITH_UNIT = re.compile(r"([+-]?[0-9.,][0-9.,' ]*?)\s*([^\W\d_]\S*|[%‰°]\S*)")
_DASH = re.compile('(?<![^;,|\\s"])\u2013(?=[0-9])')  # in place of a minus
_BLANKS = "\u00a0\u202f\u2007\u2009"
_GAP = re.compile(f"(?<=[0-9])[{_BLANKS}\u2019](?=[0-9]{{3}}(?![0-9]))")
_PLAIN = str.maketrans(f"\u2212\u2011\u2012\uff0d{_BLANKS}\uff1a", "----    :", "\ufeff")


def plain(text: str) -> str:
    """The text with the minus, the blanks and the mark between groups of digits that ASCII has.

    >>> plain("\u22125\u202f987,0")
    "-5'987,0"
    """
    return text if text.isascii() else _DASH.sub("-", _GAP.sub("'", text)).translate(_PLAIN)


def number_of(text: str) -> float | None:
    """The number that a text is, with either decimal mark; None for none."""
    number = text.strip().replace(",", ".")
    return float(number) if number_grammar(".").fullmatch(number) else None


@lru_cache(1 << 14)  # the same cells are judged several times
def is_number(cell: str) -> bool:
    """Whether a cell is a number: with either decimal mark, in groups of digits, with a unit."""
    return is_plain_number(cell) is not None or unit_behind(cell) != ""


def unit_behind(cell: str) -> str:
    """The unit behind a number, "" where there is none.

    >>> unit_behind("69.98 km/h"), unit_behind("0.020s"), unit_behind("5 apples")
    ('km/h', 's', '')
    """
    match = None if is_plain_number(cell) else _WITH_UNIT.fullmatch(cell)
    return match[2] if match and unit(match[2]) and is_plain_number(match[1]) else ""


def group_mark(cells: Sequence[str], decimal: str = "") -> str:
    """The mark between groups of digits in the cells of a column, "" where there is none.

    In cells that count up, a second mark shows it, or that they would fall as decimals. Elsewhere
    it may be the decimal mark of others: each number from 1000 on has it, and none below.

    `decimal` is the decimal mark, where some number proves it.

    >>> group_mark(["980", "1,000.5", "1,020"]), group_mark(["0.9", "1.000", "1.1"])
    (',', '')
    """
    matches = [m for m in takewhile(bool, map(_GROUPS.fullmatch, cells)) if m]
    marks, decimal_marks = ({m[k] for m in matches if m[k]} for k in (1, 2))
    if len(matches) < max(3, len(cells)) or len(marks) != 1 or marks & decimal_marks:
        return ""
    (mark,) = marks
    values = [float(c.replace(mark, "").replace(",", ".")) for c in cells]
    is_rising = all(b > a for a, b in pairwise(values))
    if decimal_marks or any(c.count(mark) > 1 for c in cells):
        is_group = is_rising or (mark == decimal and not decimal_marks)
    else:
        as_decimals = [float(c.replace(mark, ".")) for c in cells]
        is_group = is_rising and any(b < a for a, b in pairwise(as_decimals))
        has_small = any(mark not in c for c in cells)
        is_group |= mark == decimal and has_small and has_smaller_jumps(cells, mark)
    return mark if is_group else ""


def has_smaller_jumps(cells: Sequence[str], mark: str) -> bool:
    """Whether numbers have far smaller jumps if a mark separates groups of digits."""
    grouped, as_decimals = (np.array([float(c.replace(mark, x)) for c in cells]) for x in ("", "."))
    return 2.0 * largest_jump(grouped) < largest_jump(as_decimals)


def largest_jump(values: Floats) -> float:
    """The largest jump of numbers, as a share of their range."""
    if not len(values):
        return 0.0
    return float(np.abs(np.diff(values)).max(initial=0.0) / (np.ptp(values) or 1.0))
