"""Text cells of a block as numbers, exact decimals and time stamps, all rows at once.

Every function takes an Arrow array of shape (n,) that is null where a cell has no value.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ...core.model import Bools, Floats, Times
from .dialect import INFINITE, NULLS, number_grammar
from .stamps import month as month_number

# States of a cell. The last ones are numbers by their column: with the other decimal mark, or such
# that this mark may separate groups of digits; and texts of digits.
NUMBER, NO_VALUE, NO_NUMBER, IS_INFINITE, OTHER_MARK, IN_GROUPS, DIGITS = range(7)
_S = 1_000_000_000
_DAY = 86_400 * _S
_FRACTIONS = {"f": 1, "l": 1_000_000, "u": 1_000, "N": 1}  # groups, and their unit [ns]


def floats(text: Any, decimal: str) -> tuple[Floats, NDArray[np.int8]]:
    """Numbers of one column by the strict grammar.

    Args:
        text: the cells.
        decimal: their decimal mark.

    Returns:
        float64 values, NaN where the cell is no number, and states; both of shape (n,).
    """
    if pc.any(pc.match_substring(text, " ")).as_py():
        text = pc.utf8_trim_whitespace(text)
    with_point = pc.replace_substring(text, decimal, ".") if decimal != "." else text
    try:
        if decimal != "." and pc.any(pc.match_substring(text, ".")).as_py():
            raise pa.ArrowInvalid
        value = np.array(pc.cast(with_point, pa.float64()))
    except pa.ArrowInvalid:
        grammar = f"^(?:{number_grammar(decimal).pattern})$"
        numeric = pc.fill_null(pc.match_substring_regex(text, grammar), False)
        value = np.array(pc.cast(pc.if_else(numeric, with_point, None), pa.float64()))
    state = np.full(len(value), NUMBER, np.int8)
    non_finite = np.flatnonzero(~np.isfinite(value))
    if len(non_finite):
        odd_cells = text.take(pa.array(non_finite))
        infinite = np.isinf(value[non_finite]) | _is_any(INFINITE, odd_cells)
        value[non_finite], kinds = _other_notations(odd_cells, decimal)
        state[non_finite] = np.select(
            [is_missing(odd_cells), infinite], [NO_VALUE, IS_INFINITE], kinds
        )
        value[np.isin(state, (NO_VALUE, IS_INFINITE))] = np.nan
    return value, state


def _other_notations(text: Any, decimal: str) -> tuple[Floats, NDArray[np.int8]]:
    """Numbers of cells that are none by the grammar, NaN where they are no number; and states."""
    other_mark = "." if decimal == "," else ","
    d, o = re.escape(decimal), re.escape(other_mark)
    value, state = np.full(len(text), np.nan), np.full(len(text), NO_NUMBER, np.int8)
    for kind, pattern, mark in (
        (DIGITS, "[+-]?[0-9][^A-Za-z_]*(?:[A-Za-z][^0-9_]*)?", ""),
        (OTHER_MARK, rf"[+-]?[1-9][0-9]{{0,2}}(?:[' {d}][0-9]{{3}})+{o}[0-9]*", other_mark),
        (OTHER_MARK, number_grammar(other_mark).pattern, other_mark),
        (IN_GROUPS, rf"[+-]?[1-9][0-9]{{0,2}}{o}[0-9]{{3}}", other_mark),
        (NUMBER, rf"[+-]?[0-9]{{1,3}}(?:[' ][0-9]{{3}})+(?:{d}[0-9]*)?", decimal),
        (NUMBER, rf"[+-]?[1-9][0-9]{{0,2}}(?:{o}[0-9]{{3}})+{d}[0-9]*", decimal),
        (NUMBER, rf"[+-]?[1-9][0-9]{{0,2}}(?:{o}[0-9]{{3}}){{2,}}", decimal),
    ):
        matches = pc.fill_null(pc.match_substring_regex(text, f"^(?:{pattern})$"), False)
        rows = np.flatnonzero(np.asarray(matches))
        state[rows] = kind
        if mark and len(rows):
            digits = pc.replace_substring_regex(text.take(pa.array(rows)), f"[^0-9eE+{mark}-]", "")
            digits = pc.replace_substring(digits, mark, ".")
            value[rows] = np.asarray(pc.cast(digits, pa.float64()))
    return value, state


def is_missing(text: Any) -> Bools:
    """Which cells are null or spell it, shape (n,)."""
    return np.asarray(pc.is_null(text)) | _is_any(NULLS, pc.utf8_trim_whitespace(text))


def _is_any(texts: Sequence[str], text: Any) -> Bools:
    return np.asarray(pc.is_in(text, pa.array(texts, pa.string())))


def decimals(text: Any, scale: int, decimal: str) -> tuple[Times, Bools]:
    """Decimals times 10**scale as int64, exactly, rounded to the nearest; and which hold."""
    text = pc.utf8_trim_whitespace(text)
    text = pc.replace_substring(text, decimal, ".") if decimal != "." else text
    grammar = r"^[+-]?[0-9]{1,19}(\.[0-9]*)?([eE][+-]?[0-9]{1,2})?$"
    # digits beyond the 18th decimal say nothing here
    shortened = pc.replace_substring_regex(text, r"(\.[0-9]{18})[0-9]+", r"\1")
    is_decimal = pc.match_substring_regex(text, grammar)
    array = pc.cast(pc.if_else(is_decimal, shortened, None), pa.decimal128(38, 18))
    array = pc.round(array, ndigits=scale, round_mode="half_to_even")
    array = array.cast(pa.decimal128(38, scale))
    halves = np.frombuffer(array.buffers()[1], np.int64, 2 * len(array), 16 * array.offset)
    low_half, high_half = halves[0::2], halves[1::2]
    ok = np.asarray(array.is_valid()) & (high_half == low_half >> 63)
    return np.where(ok, low_half, 0), ok


def stamps(text: Any, pattern: str) -> tuple[Times, Bools]:
    """Times [ns] of stamps that match the pattern, and which do; `stamps.toml` names its groups."""
    groups = _Groups(text, pattern)
    ns, ok = _time_of_day(groups)
    if "y" in groups.names:
        days, is_date = _days(groups)
        ns, ok = ns + days * _DAY, ok & is_date
    zone = pc.replace_substring_regex(groups.text("z"), "[^0-9+-]", "")
    digits = pc.utf8_rpad(pc.utf8_slice_codeunits(zone, 1, 5), 4, padding="0")
    shift = np.asarray(pc.cast(digits, pa.int64()))
    shift = (shift // 100 * 3600 + shift % 100 * 60) * _S
    ns = ns - np.where(np.asarray(pc.starts_with(zone, "-")), -shift, shift)
    ok &= groups.ok
    return np.where(ok, ns, 0), ok


class _Groups:
    """What the named groups of a pattern match in each text; "" and 0 of a group it has not."""

    def __init__(self, text: Any, pattern: str) -> None:
        self._matches = pc.extract_regex(text, pattern=f"^(?:{pattern})$")
        self.ok: Bools = np.asarray(self._matches.is_valid())
        kind = self._matches.type
        self.names = {kind.field(k).name for k in range(kind.num_fields)}

    def text(self, name: str) -> Any:
        if name not in self.names:
            return pa.array([""]).take(pa.array(np.zeros(len(self.ok), np.int8)))
        return pc.fill_null(pc.struct_field(self._matches, name), "")

    def number(self, name: str) -> Times:
        if name not in self.names:
            return np.zeros(len(self.ok), np.int64)
        cells = self.text(name)
        if name == "f":  # digits of a fraction: as many as a nanosecond has
            digits = pc.utf8_rpad(pc.utf8_slice_codeunits(cells, 0, 9), 9, padding="0")
            cells = pc.if_else(pc.equal(cells, ""), "", digits)
        cells = pc.if_else(pc.equal(cells, ""), "0", cells)
        return np.asarray(pc.cast(cells, pa.int64()))


def _time_of_day(groups: _Groups) -> tuple[Times, Bools]:
    """Nanoseconds after midnight, and which are a time of day."""
    hour, minute, second = (groups.number(name) for name in "HMS")
    half_day = pc.utf8_lower(groups.text("p"))
    said = np.asarray(pc.not_equal(half_day, ""))
    ok = ~said | ((hour >= 1) & (hour <= 12))
    hour = np.where(said, hour % 12 + 12 * _is_any(("p", "下"), half_day), hour)
    ok &= ("y" not in groups.names) | (hour < 24)
    ok &= ("H" not in groups.names) | (minute < 60)
    ok &= ("M" not in groups.names) | (second <= 60)
    fraction = sum(groups.number(name) * ns for name, ns in _FRACTIONS.items())
    seconds = groups.number("D") * 86_400 + hour * 3600 + minute * 60 + second
    sign = np.where(np.asarray(pc.equal(groups.text("n"), "")), 1, -1)
    return sign * (seconds * _S + fraction), ok & (fraction < _S)


def _days(groups: _Groups) -> tuple[NDArray[np.int64], Bools]:
    """Days after 1970-01-01, and which are a date."""
    year, month, day = (groups.number(name) for name in "ymd")
    year = np.where(year < 100, year + 2000, year)
    ok = (year >= 1678) & (year <= 2261)
    if "b" in groups.names:
        names = groups.text("b").dictionary_encode()
        month = np.array([month_number(x) for x in names.dictionary.to_pylist()])[names.indices]
    unit = "M"
    if "j" in groups.names:
        unit, month, day = "Y", np.ones_like(year), groups.number("j")
    ok &= (month >= 1) & (month <= 12) & (day >= 1)
    begin = np.where(ok, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
    days = begin.astype("datetime64[D]") + np.where(ok, day - 1, 0)
    ok &= days.astype(f"datetime64[{unit}]") == begin.astype(
        f"datetime64[{unit}]"
    )  # no 31 February
    return days.astype(np.int64), ok
