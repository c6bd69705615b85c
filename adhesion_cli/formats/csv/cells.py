"""Text cells of a block as numbers, exact decimals and times, all rows at once.

At today's epoch float64 is wrong by up to 256 ns, so absolute times are read as decimals. Stamps
without a zone count as UTC, times of day from midnight. Arrow arrays of shape (n,) are null where a
cell has no value.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ...core import units
from ...core.finding import Finding
from ...core.model import Bools, Floats, Times
from ..number_text import number_grammar
from . import stamps
from .dialect import INFINITE, NULLS
from .header_words import NS_PER_UNIT

# States of a cell. Some are numbers by their column: with the other decimal mark, or such that this
# mark may separate groups of digits; and texts of digits. The last one is bad by its quality.
NUMBER, NO_VALUE, NO_NUMBER, IS_INFINITE, OTHER_MARK, IN_GROUPS, DIGITS, IS_BAD = range(8)


def floats(text: Any, decimal: str) -> tuple[Floats, NDArray[np.int8]]:
    """Numbers of one column by the strict grammar.

    Returns:
        float64 values, NaN where the cell is no number, and states; both of shape (n,).
    """
    if pc.any(pc.match_substring(text, " ")).as_py():
        text = pc.utf8_trim_whitespace(text)
    with_point = pc.replace_substring(text, decimal, ".") if decimal != "." else text
    grammar = f"^(?:{number_grammar(decimal).pattern})$"
    numeric = pc.fill_null(pc.match_substring_regex(text, grammar), False)
    value = np.array(pc.cast(pc.if_else(numeric, with_point, None), pa.float64()))
    state = np.full(len(value), NUMBER, np.int8)
    non_finite = np.flatnonzero(~np.isfinite(value))
    if len(non_finite):
        odd_cells = text.take(pa.array(non_finite))
        infinite = np.isinf(value[non_finite]) | _is_any(INFINITE, odd_cells)
        value[non_finite], kinds = _other_notations(odd_cells, decimal)
        kinds[infinite], kinds[is_missing(odd_cells)] = IS_INFINITE, NO_VALUE
        state[non_finite] = kinds
        value[np.isin(state, (NO_VALUE, IS_INFINITE))] = np.nan
    return value, state


def _other_notations(text: Any, decimal: str) -> tuple[Floats, NDArray[np.int8]]:
    """Numbers of cells that are none by the grammar, NaN where they are no number; and states."""
    other_mark = "." if decimal == "," else ","
    d, o = re.escape(decimal), re.escape(other_mark)
    value, state = np.full(len(text), np.nan), np.full(len(text), NO_NUMBER, np.int8)
    for kind, pattern, mark in (
        (DIGITS, r"\(?[+-]?[0-9][^A-Za-z]*(?:[A-Za-z][^0-9_]*)?", ""),
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


_DAY, _S = NS_PER_UNIT["d"], NS_PER_UNIT["s"]
_GPS_S = 315_964_800 - 18  # of 1970 to 1980-01-06, and leap seconds since 2017


class Count(NamedTuple):
    """What the numbers of a time column count."""

    ns: int  # length of one
    at_1970: float = 0  # the number of 1970-01-01
    name: str = ""  # in words; "" for a unit alone, which may count from any day

    @property
    def scale(self) -> int:
        """Decimals that an absolute time is read with: to the nanosecond, if int64 holds them."""
        return len(str(self.ns)) - 1 if self.at_1970 < 1e12 else 0

    def seconds(self, number: float) -> float:
        """Seconds from 1970 to the time of this number [s]."""
        return (number - self.at_1970) * self.ns / _S


def count_of(unit: str) -> Count:
    """What numbers of this unit count: a key of `COUNTS`, or a unit of time with a factor."""
    if unit in COUNTS:
        return COUNTS[unit]
    scaled = units.unit(unit)
    assert scaled
    return Count(round(scaled.factor * _S))


COUNTS = {unit: Count(ns) for unit, ns in NS_PER_UNIT.items()} | {
    "excel": Count(_DAY, 25_569, "Excel serial days"),
    "datenum": Count(_DAY, 719_529, "days since the year 0"),
    "julian": Count(_DAY, 2_440_587.5, "Julian days"),
    "1904": Count(_S, 2_082_844_800, "seconds since 1904"),
    "filetime": Count(100, 116_444_736_000_000_000, "100 ns since 1601"),
    "ticks": Count(100, 621_355_968_000_000_000, "100 ns since the year 1"),
    "gps": Count(_S, -_GPS_S, "GPS seconds since 1980, less 18 leap seconds"),
    "gps_ms": Count(_S // 1_000, -_GPS_S * 1_000, "GPS milliseconds since 1980"),
}
GPS = {"s": "gps", "ms": "gps_ms"}  # what numbers of these units may count instead


@dataclass(frozen=True, slots=True)
class Clock:
    """How to get int64 ns from one or more columns of the table."""

    columns: tuple[int, ...]  # none where rows are counted
    unit: str  # of a number, see `count_of`; "" for stamps
    pattern: str  # of a stamp, the cells of its columns joined by blanks; "" for numbers
    decimal: str
    absolute: bool  # counts from 1970
    reason: str
    findings: tuple[Finding, ...] = ()
    start: int = 0  # what is added to every time [ns]
    step: int = 0  # between two rows, where they are counted [ns]
    is_sparse: bool = False  # a stamp holds for the rows below it that have none

    def in_digits(self, name: str, example: str) -> "Clock":
        """The clock of a column whose digits, HHMMSS, are read as a number of seconds."""
        reason = f"column {name!r}; time of day in digits, HHMMSS"
        other_findings = (f for f in self.findings if f.code != "time-unit-guessed")
        digits = Finding("time-digits", "info", name, names={"example": example})
        return replace(self, reason=reason, findings=(*other_findings, digits))

    @property
    def may_be_digits(self) -> bool:
        """Whether times are numbers after an unknown start, as digits, HHMMSS, are."""
        return bool(self.unit) and not self.absolute

    def nanoseconds(self, arrays: Sequence[Any]) -> tuple[Times, Bools]:
        """Times [ns] of rows by the clock's columns as text, and which of them hold; shape (n,)."""
        t, ok = self._nanoseconds(arrays)
        return (np.where(ok, t + self.start, 0), ok) if self.start else (t, ok)

    def _nanoseconds(self, arrays: Sequence[Any]) -> tuple[Times, Bools]:
        """Times without the start."""
        array = arrays[0]
        if self.pattern:
            text = [pc.utf8_trim_whitespace(a) for a in arrays]
            return stamps.parse(pc.binary_join_element_wise(*text, " "), self.pattern)
        count = count_of(self.unit)
        if self.absolute and count.ns < _DAY:
            ticks, ok = decimals(array, count.scale, self.decimal)
            per_tick = count.ns // 10**count.scale
            ticks = ticks - int(count.at_1970) * 10**count.scale
            ok = ok & (np.abs(ticks) < 2**62 // per_tick)
            return np.where(ok, ticks, 0) * per_tick, ok
        value, state = floats(array, self.decimal)
        with np.errstate(over="ignore"):
            # a serial day is exact to about a microsecond; rounding there keeps steps even
            step = 1_000 if count.at_1970 else 1
            value = np.rint((value - count.at_1970) * (count.ns / step)) * step
        ok = (np.abs(value) < 2.0**62) & (state == NUMBER)
        return np.where(ok, value, 0.0).astype(np.int64), ok
