"""Rows of plain decimals, "-12.345", parsed in one compiled pass: what long logs are made of.

Anything else, be it one cell, is the general parser's; both give the same bits.
"""

from collections.abc import Sequence
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from .. import compiled
from ..model import Floats, Times

_POWERS = 10.0 ** np.arange(19)
_INTEGER_POWERS = 10 ** np.arange(19)
_LOADING = Lock()  # blocks are parsed by several threads at once
_SKIPPED, _TIME = -1, -2  # what becomes of a column that is no value's


def parse(
    data: NDArray[np.uint8],
    delimiter: str,
    decimal: str,
    width: int,
    time: int,
    power: int,
    columns: Sequence[int],
    rows: int,
) -> tuple[Times, Floats] | None:
    """Times and values of rows that hold nothing but plain decimals where it matters.

    Args:
        data: whole rows without a quote, each ended by a line feed; shape (bytes,).
        delimiter: between cells, one ASCII character.
        decimal: mark of the decimals, one ASCII character.
        width: cells of each row.
        time: column of the time.
        power: times are told as the cell's decimal times 10**power.
        columns: those of the values; an empty cell is NaN.
        rows: number of line feeds in `data`.

    Returns:
        int64 times (rows,) and values (columns, rows); None where a row or cell is another's to
        read: width, spelling, more digits than a float or an int64 holds exactly.
    """
    slots = np.full(width, _SKIPPED)
    slots[time] = _TIME
    slots[list(columns)] = np.arange(len(columns))
    times, values = np.empty(rows, np.int64), np.empty((len(columns), rows))
    with _LOADING:
        call = compiled.function(_parse)
    done = call(
        data, ord(delimiter), ord(decimal), slots, power, times, values, _POWERS, _INTEGER_POWERS
    )
    return (times, values) if done else None


def _parse(
    data: NDArray[np.uint8],
    delimiter: int,
    decimal: int,
    slots: NDArray[np.int64],
    power: int,
    times: Times,
    values: Floats,
    powers: Floats,
    integer_powers: NDArray[np.int64],
) -> bool:
    one = np.uint64(1)
    at = np.uint64(0)  # without a sign, an index costs no check for a negative one
    last = len(slots) - 1
    for row in range(len(times)):
        for column in range(len(slots)):
            end = 10 if column == last else delimiter
            slot = slots[column]
            if slot == _SKIPPED:
                while data[at] != delimiter and data[at] != 10:
                    at += one
                if data[at] != end:
                    return False
                at += one
                continue
            start = at
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
            if data[at] != end:
                return False
            empty = at == start
            at += one
            if empty and slot >= 0:
                values[slot, row] = np.nan
                continue
            if not 0 < digits + decimals <= 18:
                return False
            if slot >= 0:
                if number > 2**53:
                    return False
                value = number / powers[decimals]  # both exact, so the nearest float
                values[slot, row] = -value if negative else value
            else:
                if decimals > power or digits + power > 18:
                    return False
                time = number * integer_powers[power - decimals]
                times[row] = -time if negative else time
    return True
