"""Which column of a typed table is the time, by the rules of text logs, and its times."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..core.finding import Finding
from ..core.model import Bools, Times
from ..core.time_axis import from_digits
from .csv.clock import Clock
from .csv.dialect import Dialect, fit
from .csv.long_table import interleaved
from .csv.time_column import find_clock
from .source import ReadOptions

HEAD = 1_000  # rows that show which column is the time


def find(
    heads: dict[str, Any],
    units: Sequence[str],
    rows: int,
    options: ReadOptions,
    path: Path,
    read: Callable[[str], Any],
) -> tuple[Clock, tuple[Finding, ...]]:
    """Decides which column is the time, and why; with findings on that, and on mixed devices.

    Args:
        heads: Arrow array of the first values of each column, by name.
        units: of each column, "" where none is stated.
        rows: of the whole table.
        options: what the user stated.
        path: of the file.
        read: gives a whole column by its name.

    Raises:
        UserError: where no column is a time, or its unit is open.
    """
    names = tuple(heads)
    cells = [_cells(head) for head in heads.values()]
    longest = max(map(len, cells), default=0)
    cells = [fit(column, longest) for column in cells]
    chosen = tuple(
        unit or ("ns" if pa.types.is_duration(head.type) else "")
        for unit, head in zip(units, heads.values(), strict=True)
    )
    head_rows = [list(row) for row in zip(*cells, strict=True)]
    dialect = Dialect(len(names), names, (names,), chosen, head_rows)
    clock = find_clock(dialect, options, rows, path)
    if clock.columns and clock.may_be_digits:
        name = names[clock.columns[0]]
        t, ok = _times([read(name)], clock)
        if from_digits(t[ok]) is not None:
            clock = clock.in_digits(name, cells[clock.columns[0]][0])
    mixed = None if options.group_channel else interleaved(dialect, clock.columns)
    return clock, (*clock.findings, *([mixed] if mixed else []))


def _cells(array: Any) -> list[str]:
    """The first values of a column as a text log would have them; "" where there is none."""
    if pa.types.is_duration(array.type):
        array = array.cast(pa.duration("ns"), safe=False).cast(pa.int64())
    elif pa.types.is_date(array.type):
        array = array.cast(pa.timestamp("ms"), safe=False)
    elif pa.types.is_boolean(array.type):
        array = array.cast(pa.int8())
    zone = ""
    if pa.types.is_timestamp(array.type) and array.type.tz:
        # The text of another zone needs a database of time zones, which not every Windows has.
        array, zone = array.cast(pa.timestamp(array.type.unit)), "Z"
    return ["" if x is None else x + zone for x in array.cast(pa.string()).to_pylist()]


def times(arrays: Sequence[Any], clock: Clock) -> tuple[Times, Bools]:
    """Times [ns] of the clock's columns, and which of them hold; shape (n,)."""
    t, ok = _times(arrays, clock)
    if clock.may_be_digits and (time_of_day := from_digits(t[ok])) is not None:
        t = np.zeros_like(t)
        t[ok] = time_of_day
    return t, ok


def _times(arrays: Sequence[Any], clock: Clock) -> tuple[Times, Bools]:
    """Times as the numbers say, and which of them hold."""
    array = arrays[0]
    ok = np.asarray(array.is_valid())
    kind = array.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind) or pa.types.is_duration(kind):
        target = pa.duration("ns") if pa.types.is_duration(kind) else pa.timestamp("ns")
        in_unit = array.cast(pa.timestamp(kind.unit)) if pa.types.is_timestamp(kind) else array
        return np.asarray(in_unit.cast(target).cast(pa.int64()).fill_null(0)), ok
    t, is_time = clock.nanoseconds([a.cast(pa.string()) for a in arrays])
    return t, ok & is_time
