"""Rows of plain decimals, "-12.345", parsed in one compiled pass: what long logs are made of.

pyarrow alone reads a log at 0.6 of the speed at which it reads the same columns into its own
arrays. This keeps the reader above 0.8. A cell of another spelling is left to the general parser.
So is a whole block where a time or the number of cells is not plain. Both give the same bits.
"""

from collections.abc import Sequence
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import compiled
from ...core.model import Floats, Times

STAMPS = -1  # as a scale: times are ISO stamps without a zone, or with Z
_SKIPPED, _TIME = -1, -2  # what becomes of a column that has no values
_ODD = 32  # of so many rows one may have a cell that is no plain decimal
_POWERS = 10.0 ** np.arange(19)
_INTEGER_POWERS = 10 ** np.arange(19)
_LOADING = Lock()  # blocks are parsed by several threads at once


class Parsed(NamedTuple):
    """Times and values of n rows, and where the cells are that were left."""

    times: Times  # (n,)
    values: Floats  # shape (columns, n); NaN where a cell is empty or was left
    odd: NDArray[np.int64]  # column, row, first byte and byte behind of each that was; (m, 4)


class Layout(NamedTuple):
    """What the cells of each row are."""

    delimiter: str  # one ASCII character
    decimal: str  # one ASCII character
    width: int  # cells of each row
    time: int | None  # column of times as integers; None: times are values
    scale: int  # of these, decimals that the integers hold, or `STAMPS` [ns]
    zoned: bool  # whether each stamp ends with Z
    columns: Sequence[int]  # of the values


def parse(data: NDArray[np.uint8], layout: Layout, rows: int) -> Parsed | None:
    """Times and values of rows that hold little but plain decimals where it matters.

    Args:
        data: whole rows without a quote, each ended by a line feed; shape (bytes,).
        layout: of each row.
        rows: number of line feeds in `data`.

    Returns:
        None where a row's width or time is not plain, or too many cells are not.
    """
    slots = np.full(layout.width, _SKIPPED)
    if layout.time is not None:
        slots[layout.time] = _TIME
    slots[list(layout.columns)] = np.arange(len(layout.columns))
    times, values = np.empty(rows, np.int64), np.empty((len(layout.columns), rows))
    odd = np.empty((rows // _ODD + 1, 4), np.int64)
    marks = np.array([ord(layout.delimiter), ord(layout.decimal)])
    with _LOADING:
        call = compiled.function(_parse)
    form = np.array([layout.scale, layout.zoned])
    found = call(data, marks, slots, form, times, values, odd, _POWERS, _INTEGER_POWERS)
    return Parsed(times, values, odd[:found]) if found >= 0 else None


def _parse(  # noqa: C901, PLR0912, PLR0913 (one pass; calls per cell would cost half the gain)
    data: NDArray[np.uint8], marks: NDArray[np.int64], slots: NDArray[np.int64],
    form: NDArray[np.int64], times: Times, values: Floats, odd: NDArray[np.int64],
    powers: Floats, integer_powers: NDArray[np.int64],
) -> int:  # fmt: skip
    """Fills times, values and odd; returns how many are odd, −1 where the rows are another's."""
    one, at, found = np.uint64(1), np.uint64(0), 0  # unsigned: an index needs no check of its sign
    delimiter, decimal = marks
    scale, zoned = form
    for row in range(len(times)):
        for column in range(len(slots)):
            end = 10 if column == len(slots) - 1 else delimiter
            slot, start = slots[column], at
            if slot == _SKIPPED:
                at = _cell_end(data, at, delimiter)
            elif slot == _TIME and scale == STAMPS:
                at, times[row] = _stamp(data, at, zoned, integer_powers)
                if at == start:
                    return -1
            else:
                negative = data[at] == 45
                if negative:
                    at += one
                first, number = at, 0
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
                    time = _scaled(number, digits + decimals, scale - decimals, integer_powers)
                    if time < 0 or data[at] != end:
                        return -1
                    times[row] = -time if negative else time
                elif plain and number <= 2**53:
                    value = number / powers[decimals]  # both exact, so the nearest float
                    values[slot, row] = -value if negative else value
                else:
                    values[slot, row] = np.nan
                    at = _cell_end(data, at, delimiter)
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


def _cell_end(data: NDArray[np.uint8], at: Any, delimiter: int) -> Any:
    """The delimiter or line feed that ends a cell."""
    while data[at] != delimiter and data[at] != 10:
        at += np.uint64(1)
    return at


def _scaled(number: int, digits: Any, power: Any, integer_powers: NDArray[np.int64]) -> int:
    """Times the power of ten; −1 where that is no number of 64 bits."""
    # 19 digits may be too large for 64 bits, and then are below zero
    if not 0 < digits <= 19 or power < 0 or number < 0:
        return -1
    factor = integer_powers[power]
    return number * factor if number <= (2**63 - 1) // factor else -1


def _digits(data: NDArray[np.uint8], at: Any) -> tuple[Any, Any, Any]:
    """The byte behind some digits, the number that they are, and how many."""
    first, number = at, 0
    while 48 <= data[at] <= 57:
        number = 10 * number + (data[at] - 48)
        at += np.uint64(1)
    return at, number, np.int64(at - first)


def _stamp(
    data: NDArray[np.uint8], start: Any, zoned: int, integer_powers: NDArray[np.int64]
) -> tuple[Any, int]:
    """The byte behind a stamp and its time [ns]; the first byte and 0 where there is none."""
    at, good = start, True
    year = month = day = seconds = nanos = 0
    for k in range(6):
        at, part, digits = _digits(data, at)
        mark = data[at]
        good = digits == (4 if k == 0 else 2) and (k < 3 or part <= (23 if k == 3 else 59))
        if k < 5:
            expected = 45 if k < 2 else 84 if k == 2 else 58
            good = good and (mark == expected or (k == 2 and mark == 32))
            at += np.uint64(1)
        if not good:
            return start, 0
        if k == 0:
            year = part
        elif k == 1:
            month = part
        elif k == 2:
            day = part
        else:
            seconds = 60 * seconds + part
    if data[at] == 46:
        at, nanos, digits = _digits(data, at + np.uint64(1))
        good = 0 < digits <= 9
        nanos *= integer_powers[9 - digits] if good else 0
    if zoned:
        good = good and data[at] == 90
        at += np.uint64(good)
    longest = 31 - (month - 1) % 7 % 2
    if month == 2:
        longest = 29 if year % 4 == 0 and (year % 100 != 0 or year % 400 == 0) else 28
    if not (good and 1700 <= year <= 2200 and 1 <= month <= 12 and 1 <= day <= longest):
        return start, 0
    if month <= 2:  # a year from March on, whose leap day is its last
        year, month = year - 1, month + 12
    days = 365 * year + year // 4 - year // 100 + year // 400 + (153 * month - 457) // 5 + day
    seconds += (days - 719_469) * 86_400
    return at, seconds * 1_000_000_000 + nanos
