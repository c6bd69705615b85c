"""Rows of plain decimals, "-12.345", parsed in one compiled pass: what long logs are made of.

Their time is such a decimal too, or a stamp "2026-01-31T12:00:00.25". A cell of another spelling is
left to the general parser, and so are all rows where a time or the number of cells is another's to
judge; both give the same bits.
"""

from collections.abc import Sequence
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import compiled
from ...core.model import Floats, Times
from .clock import ZONED

_POWERS = 10.0 ** np.arange(19)
_INTEGER_POWERS = 10 ** np.arange(19)
_LOADING = Lock()  # blocks are parsed by several threads at once
_SKIPPED, _TIME = -1, -2  # what becomes of a column that is no value's
_ODD = 32  # of so many rows one may have a cell that is no plain decimal


class Parsed(NamedTuple):
    """Times and values of n rows, and where the cells are that were left."""

    times: Times
    values: Floats  # shape (columns, n); NaN where a cell is empty or was left
    odd: NDArray[np.int64]  # column, row, first byte and byte behind of each that was; (m, 4)


def parse(  # noqa: PLR0913
    data: NDArray[np.uint8],
    delimiter: str,
    decimal: str,
    width: int,
    time: int,
    power: int,
    columns: Sequence[int],
    rows: int,
) -> Parsed | None:
    """Times and values of rows that hold little but plain decimals where it matters.

    Args:
        data: whole rows without a quote, each ended by a line feed; shape (bytes,).
        delimiter: between cells, one ASCII character.
        decimal: mark of the decimals, one ASCII character.
        width: cells of each row.
        time: column of the time.
        power: times are told as the cell's decimal times 10**power; of stamps `NAIVE` or `ZONED`,
            told in ns since 1970.
        columns: those of the values.
        rows: number of line feeds in `data`.

    Returns:
        None where a row's width or time is another's to read, or too many cells are.
    """
    slots = np.full(width, _SKIPPED)
    slots[time] = _TIME
    slots[list(columns)] = np.arange(len(columns))
    times, values = np.empty(rows, np.int64), np.empty((len(columns), rows))
    odd = np.empty((rows // _ODD + 1, 4), np.int64)
    with _LOADING:
        call = compiled.function(_parse)
    found = call(
        data, ord(delimiter), ord(decimal), slots, power, times, values, odd, _POWERS,
        _INTEGER_POWERS,
    )  # fmt: skip
    return Parsed(times, values, odd[:found]) if found >= 0 else None


def _parse(  # noqa: C901, PLR0912, PLR0913, PLR0915
    data: NDArray[np.uint8],
    delimiter: int,
    decimal: int,
    slots: NDArray[np.int64],
    power: int,
    times: Times,
    values: Floats,
    odd: NDArray[np.int64],
    powers: Floats,
    integer_powers: NDArray[np.int64],
) -> int:
    """Fills times, values and odd; returns how many are odd, −1 where the rows are another's."""
    one = np.uint64(1)
    at = np.uint64(0)  # without a sign, an index costs no check for a negative one
    last = len(slots) - 1
    found = 0
    parts = np.empty(8, np.int64)
    for row in range(len(times)):
        for column in range(len(slots)):
            end = 10 if column == last else delimiter
            slot = slots[column]
            start = at
            if slot == _SKIPPED:
                while data[at] != delimiter and data[at] != 10:
                    at += one
            elif slot == _TIME and power < 0:
                at, times[row] = _stamp(data, at, power == ZONED, parts, integer_powers)
                if at == start:
                    return -1
            else:
                negative = data[at] == 45
                if negative:
                    at += one
                first = at
                number = 0
                while 48 <= data[at] <= 57:
                    number = 10 * number + (data[at] - 48)
                    at += one
                digits, decimals = np.int64(at - first), np.int64(0)
                if data[at] == decimal:
                    at += one
                    first = at
                    while 48 <= data[at] <= 57:
                        number = 10 * number + (data[at] - 48)
                        at += one
                    decimals = np.int64(at - first)
                plain = 0 < digits + decimals <= 18 and data[at] == end
                if slot == _TIME:
                    if not plain or decimals > power or digits + power > 18:
                        return -1
                    time = number * integer_powers[power - decimals]
                    times[row] = -time if negative else time
                elif plain and number <= 2**53:
                    value = number / powers[decimals]  # both exact, so the nearest float
                    values[slot, row] = -value if negative else value
                else:
                    values[slot, row] = np.nan
                    while data[at] != delimiter and data[at] != 10:
                        at += one
                    if at > start:
                        if found == len(odd):
                            return -1
                        odd[found, 0], odd[found, 1] = slot, row
                        odd[found, 2], odd[found, 3] = start, at
                        found += 1
            if data[at] != end:
                return -1
            at += one
    return found


def _stamp(  # noqa: C901, PLR0912
    data: NDArray[np.uint8],
    start: Any,
    zoned: bool,
    parts: NDArray[np.int64],
    integer_powers: NDArray[np.int64],
) -> tuple[Any, int]:
    """The byte behind a stamp and its time [ns]; the first byte and 0 where there is none.

    `parts` is room for year, month, day, hour, minute, second and the zone's hours and minutes.
    """
    one = np.uint64(1)
    at = start
    nanos, sign = 0, 1
    for k in range(8):
        parts[k] = 0
        for _ in range(4 if k == 0 else 2):
            if not 48 <= data[at] <= 57:
                return start, 0
            parts[k] = 10 * parts[k] + (data[at] - 48)
            at += one
        mark = data[at]
        if k == 5:
            if mark == 46:
                decimals = 0
                at += one
                while 48 <= data[at] <= 57 and decimals < 9:
                    nanos = 10 * nanos + (data[at] - 48)
                    decimals += 1
                    at += one
                if not decimals:
                    return start, 0
                nanos *= integer_powers[9 - decimals]
            mark = data[at]
            if not zoned or mark == 90:
                at += np.uint64(zoned)
                parts[6] = parts[7] = 0
                break
            if mark != 43 and mark != 45:
                return start, 0
            sign = 1 if mark == 43 else -1
        elif k == 7:
            break
        elif mark != (45 if k < 2 else 58) and not (k == 2 and (mark == 84 or mark == 32)):
            return start, 0
        at += one
    year, month, day, hour, minute, second, zone_hours, zone_minutes = parts
    longest = 31 - (month - 1) % 7 % 2
    if month == 2:
        longest = 29 if year % 4 == 0 and (year % 100 != 0 or year % 400 == 0) else 28
    if not (1700 <= year <= 2200 and 1 <= month <= 12 and 1 <= day <= longest):
        return start, 0
    if hour > 23 or minute > 59 or second > 59 or zone_hours > 23 or zone_minutes > 59:
        return start, 0
    if month <= 2:  # a year from March on, whose leap day is its last
        year, month = year - 1, month + 12
    days = 365 * year + year // 4 - year // 100 + year // 400 + (153 * month - 457) // 5 + day
    seconds = ((days - 719_469) * 24 + hour) * 3600 + minute * 60 + second
    seconds -= sign * (zone_hours * 3600 + zone_minutes * 60)
    return at, seconds * 1_000_000_000 + nanos
