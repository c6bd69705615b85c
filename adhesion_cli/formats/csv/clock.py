"""The clock of a table: how cells of its time column become exact int64 nanoseconds.

Numbers go through float64 only where that keeps nanoseconds. At today's epoch float64 is wrong by
up to 256 ns: such times are read as decimals. Stamps without a zone count as UTC, times of day
from midnight.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ...core.errors import UserError
from ...core.finding import Finding
from ...core.model import Bools, Times
from . import arrow as pc
from . import cells
from .header_words import NS_PER_UNIT

# first and last day that a log may have, and the serial day of 1970-01-01
SERIALS = {"excel": (30_000, 60_000, 25_569), "matlab": (730_000, 753_000, 719_529)}
SCALE = {"s": 9, "ms": 6, "us": 3, "ns": 0, "min": 9, "h": 9}  # decimals that are read exactly

_S = 1_000_000_000
_DAY = 86_400 * _S
_EXACT = 2.0**50  # ns, 13 days: below, float64 is less than half a nanosecond off after scaling
_SECONDS = r"[+-]?[0-9]+[.,](?P<f>[0-9]+)"


@dataclass(frozen=True, slots=True)
class Clock:
    """How to get int64 ns from one or two columns of the table."""

    columns: tuple[int, ...]
    unit: str  # of a number: key of `NS_PER_UNIT`; "excel", "matlab"; "" for stamps
    pattern: str  # of a stamp, date and time joined by a blank; "" for numbers
    decimal: str
    absolute: bool  # counts from 1970
    reason: str
    types: tuple[Any, ...] = (pa.string(),)  # Arrow types to try in turn, text last
    findings: tuple[Finding, ...] = ()

    def nanoseconds(self, arrays: Sequence[Any]) -> tuple[Times, Bools]:
        """Times [ns] of the rows of one block, and which of them hold; shape (n,).

        `arrays` are the clock's columns, of one of `types`, null where a cell has no value.
        """
        array = arrays[0]
        if pa.types.is_timestamp(array.type):
            return np.asarray(array.cast(pa.int64()).fill_null(0)), np.asarray(array.is_valid())
        if self.pattern:
            text = [pc.utf8_trim_whitespace(a) for a in arrays]
            whole = pc.binary_join_element_wise(*text, " ") if len(text) == 2 else text[0]
            return cells.stamps(whole, self.pattern)
        if self.unit in SERIALS:
            value, state = cells.floats(array, self.decimal)
            ok = (state == cells.NUMBER) & (np.abs(value) < 1e6)
            days = np.where(ok, value - SERIALS[self.unit][2], 0.0)
            whole_days = np.floor(days)
            # a serial day is exact to about a microsecond; rounding there keeps even steps even
            us = np.rint((days - whole_days) * 86_400e6).astype(np.int64)
            return whole_days.astype(np.int64) * _DAY + us * 1000, ok
        if pa.types.is_floating(array.type):
            value = array.to_numpy(zero_copy_only=False) * NS_PER_UNIT[self.unit]
            ok = np.isfinite(value)
            if not ok.all():
                value[~ok] = 0.0
            return np.rint(value, out=value).astype(np.int64), ok
        t, ok = cells.decimals(array, SCALE[self.unit], self.decimal)
        if factor := {"min": 60, "h": 3600}.get(self.unit):
            ok &= np.abs(t) < 2**62 // factor
            t = np.where(ok, t, 0) * factor
        return t, ok

    def refuse_unpadded(self, rows: Sequence[Sequence[str]], name: str, path: Path) -> None:
        """Refuses times whose fraction is a whole number of ms, us or ns without leading zeros.

        "5.7" is 5.007 s then. Read as decimals such times fall once a second, as numbers never.
        `rows` are the cells of the clock's columns, of consecutive rows; `name` is the column.
        """
        pattern = self.pattern or (_SECONDS if self.unit == "s" else "")
        if "(?P<f>" not in pattern:
            return
        found = [m for row in rows if (m := re.fullmatch(pattern, " ".join(row)))]
        digits = {len(m["f"]) for m in found if m["f"]}
        if len(digits) < 2 or (most := max(digits)) > 9:
            return
        width = -(-most // 3) * 3
        padded = [
            m.string[: m.start("f")] + m["f"].zfill(width) + m.string[m.end("f") :]
            if m["f"] else m.string for m in found
        ]  # fmt: skip
        (t, _), (as_number, _) = (
            cells.stamps(pa.array(x), pattern) if self.pattern
            else cells.decimals(pa.array(x), 9, self.decimal)
            for x in ([m.string for m in found], padded)
        )  # fmt: skip
        falls = np.flatnonzero(np.diff(t) < 0)
        if len(falls) and not (np.diff(as_number) < 0).any():
            k = int(falls[0])
            raise UserError(
                f"{path}: the fractions of a second in {name!r} lack their leading zeros: "
                f"{found[k][0]!r} stands before {found[k + 1][0]!r}, as if it were {padded[k]!r}",
                f"export the time with all {width} decimals; nothing is repaired here",
            )

    def is_packed(self, t: Times, column: Sequence[str]) -> bool:
        """Whether the times [ns] of a log are not seconds but hhmmss.ss, as receivers give UTC.

        No such number ends in 60 to 99, and one in 59 is followed by one in 00. `column` has the
        cells of the first rows.
        """
        padded = any(re.match(r"0[0-9]{5}(?:[.,]|$)", c) for c in column)
        if self.unit != "s" or self.absolute or not (padded or t.max() >= 10_000 * _S):
            return False
        if (t[:: len(t) // 1000 + 1] % (100 * _S) >= 60 * _S).any():  # all would cost memory
            return False
        rest = t % (100 * _S)
        turns = (np.diff(t // (100 * _S)) == 1) & (rest[:-1] >= 59 * _S) & (rest[1:] < _S)
        return bool(turns.any() and (rest < 60 * _S).all())

    def is_exact(self, array: Any) -> bool:
        """Whether a block of the clock's column, read as float64, keeps nanoseconds."""
        if self.unit in SERIALS:
            return True
        value = array.to_numpy(zero_copy_only=False)
        ends = np.fmin.reduce(value, initial=0.0), np.fmax.reduce(value, initial=0.0)
        return bool(max(-ends[0], ends[1]) * NS_PER_UNIT[self.unit] < _EXACT)


def backwards(path: Path, name: str, column: Sequence[str]) -> UserError:
    """The refusal of a log whose time falls, as the cells of `column` do, whose name is `name`."""
    return UserError(
        f"{path}: time column {name!r} runs backwards (from {column[0]} to {column[-1]})",
        "export the rows in the order of time, the oldest first; nothing is sorted here",
    )
