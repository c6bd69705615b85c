"""The clock of a table: how cells of its time column become int64 nanoseconds.

At today's epoch float64 is wrong by up to 256 ns, so absolute times are read as decimals. Stamps
without a zone count as UTC, times of day from midnight.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ...core.finding import Finding
from ...core.model import Bools, Times
from . import cells
from .header_words import NS_PER_UNIT

EXCEL_DAYS = (30_000, 60_000)  # serial days that a log may have: 1982 to 2064
SCALE = {"s": 9, "ms": 6, "us": 3, "ns": 0}  # decimals of an absolute time that are read

_EXCEL_1970 = 25_569  # serial day of 1970-01-01


@dataclass(frozen=True, slots=True)
class Clock:
    """How to get int64 ns from one or two columns of the table."""

    columns: tuple[int, ...]
    unit: str  # of a number: key of `NS_PER_UNIT` or "excel"; "" for stamps
    pattern: str  # of a stamp, date and time joined by a blank; "" for numbers
    decimal: str
    absolute: bool  # counts from 1970
    reason: str
    type: Any  # Arrow type of a column whose cells are all sound
    findings: tuple[Finding, ...] = ()

    def nanoseconds(self, arrays: Sequence[Any]) -> tuple[Times, Bools]:
        """Times [ns] of the rows of one block, and which of them hold; shape (n,).

        `arrays` are the clock's columns, of its type or text, null where a cell has no value.
        """
        array = arrays[0]
        if pa.types.is_timestamp(array.type):
            return np.asarray(array.cast(pa.int64()).fill_null(0)), np.asarray(array.is_valid())
        if self.pattern:
            text = [pc.utf8_trim_whitespace(a) for a in arrays]
            stamp = pc.binary_join_element_wise(*text, " ") if len(text) == 2 else text[0]
            return cells.stamps(stamp, self.pattern)
        if self.absolute and self.unit in SCALE:
            return cells.decimals(array, SCALE[self.unit], self.decimal)
        value, _ = cells.floats(array, self.decimal)
        with np.errstate(over="ignore"):
            if self.unit == "excel":
                # a serial day is exact to about a microsecond; rounding there keeps steps even
                value = np.rint((value - _EXCEL_1970) * 86_400e6) * 1000
            else:
                value = value * NS_PER_UNIT[self.unit]
        ok = np.abs(value) < 2.0**62
        if not ok.all():
            value[~ok] = 0.0
        return np.rint(value).astype(np.int64), ok
