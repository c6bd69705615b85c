"""A log as one table, as CSV, Parquet or Excel: a column per channel, a row per time stamp.

Channels with different time stamps share a row only where the stamps are equal. Nothing is
interpolated. Every channel keeps its own order: where its time jumps back, a new pass through time
begins below. Clock times are in UTC to the nanosecond. Others are seconds, which still tell
nanoseconds apart after 50 days.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow.csv import CSVWriter, WriteOptions

from ..core.errors import UserError
from ..core.model import Log, Times
from ..core.text import distinct
from . import mcap, names, workbook

_ROWS = 1 << 16  # made at once


def writer(target: Path) -> Callable[[Path, Log], None]:
    """What writes a log, to a path, in the format of `target`'s suffix; a UserError for none."""
    writers = {
        ".csv": write_csv,
        ".mcap": mcap.write_log,
        ".parquet": write_parquet,
        ".xlsx": write_workbook,
    }
    if target.suffix.lower() not in writers:
        text = f"{target}: unknown format {target.suffix!r}"
        raise UserError(text, f"end it with one of {', '.join(writers)}", code=2)
    return writers[target.suffix.lower()]


def write_csv(path: Path, log: Log) -> None:
    """Write a log with units in the header; a cell without a value is empty."""
    titles = map(names.cell, _titles(log))
    _, *types = _types(log)
    time_type = pa.string() if log.absolute else pa.float64()
    schema = pa.schema(list(zip(titles, [time_type, *types], strict=True)))
    options = WriteOptions(quoting_style="none")  # no cell below the head has a comma
    with path.open("wb") as file, CSVWriter(file, schema, write_options=options) as rows:
        for batch in _batches(log, schema, *_rows(log)):
            rows.write_batch(batch)


def write_parquet(path: Path, log: Log) -> None:
    """The same with the units in the fields' metadata. Each page has a checksum."""
    from pyarrow.parquet import ParquetWriter

    channels = [("time", "" if log.absolute else "s"), *names.channels(log)]
    titles = distinct([name for name, _ in channels])
    schema = pa.schema(
        pa.field(title, kind, metadata={"unit": unit} if unit else None)
        for title, (_, unit), kind in zip(titles, channels, _types(log), strict=True)
    )
    options = {"compression": "zstd", "write_page_checksum": True}
    with path.open("wb") as file, ParquetWriter(file, schema, **options) as rows:
        for batch in _batches(log, schema, *_rows(log)):
            rows.write_batch(batch)


def write_workbook(path: Path, log: Log) -> None:
    """The same as an Excel workbook, whose time stamps hold microseconds; raises as `workbook`."""
    schema = pa.schema(list(zip(_titles(log), _types(log), strict=True)))
    t, rows = _rows(log)
    sheet = workbook.Sheet(schema, len(t), _batches(log, schema, t, rows))
    workbook.write_workbook(path, {"log": sheet})


def _titles(log: Log) -> Iterator[str]:
    yield "time" if log.absolute else "time [s]"
    for name, unit in names.channels(log):
        has_unit = not unit or name.endswith((f"[{unit}]", f"({unit})"))
        yield name if has_unit else f"{name} [{unit}]"


def _types(log: Log) -> list[Any]:
    time = pa.timestamp("ns", "UTC") if log.absolute else pa.float64()
    return [time] + [pa.float64()] * len(log.channels)


_RowsOfAxes = dict[int, NDArray[np.int64]]  # of the samples, by the identity of their times


def _batches(log: Log, schema: Any, t: Times, rows: _RowsOfAxes) -> Iterator[Any]:
    """The rows in order, some at once; a channel's column is null where it has no value."""
    for first_row in range(0, len(t), _ROWS):
        times = t[first_row : first_row + _ROWS]
        columns = [_time_column(times, schema.types[0])]
        for data in (channel.data for channel in log.channels):
            values, has_value = np.zeros(len(times)), np.zeros(len(times), bool)
            places = rows[id(data.t)]  # which rise
            piece = slice(*np.searchsorted(places, [first_row, first_row + len(times)]))
            values[places[piece] - first_row] = data.value[piece]
            has_value[places[piece] - first_row] = data.valid[piece]
            columns.append(pa.array(values, mask=~has_value | np.isnan(values)))
        yield pa.record_batch(columns, schema=schema)


def _time_column(t: Times, kind: Any) -> Any:
    """The times as seconds, as time stamps in UTC, or as the text of these."""
    if pa.types.is_floating(kind):
        return pa.array(t / 1e9)
    if pa.types.is_timestamp(kind):
        return pa.array(t, kind)
    # Arrow writes a text with its zone only where the system has a database of time zones.
    return pc.binary_join_element_wise(pa.array(t, pa.timestamp("ns")).cast(pa.string()), "Z", "")


def _rows(log: Log) -> tuple[Times, _RowsOfAxes]:
    """One row per distinct time stamp, and the row of each sample.

    A stamp that an axis repeats, or comes back to, gets its own row. A row is identified by
    (how often the time has jumped back, stamp, how often it repeated just now).
    """
    axes = {id(c.data.t): c.data.t for c in log.channels}
    if len(axes) == 1:
        ((axis, t),) = axes.items()
        return t, {axis: np.arange(len(t))}
    table = np.concatenate([np.empty((3, 0), np.int64), *map(_keys, axes.values())], axis=1)
    order = np.lexsort(table[::-1])
    table = table[:, order]
    is_new = np.ones(len(order), bool)
    is_new[1:] = (np.diff(table, axis=1) != 0).any(axis=0)
    row = np.empty(len(order), np.int64)
    row[order] = np.cumsum(is_new) - 1
    axis_stops = np.cumsum([len(t) for t in axes.values()])
    return table[1, is_new], dict(zip(axes, np.split(row, axis_stops[:-1]), strict=False))


def _keys(t: Times) -> NDArray[np.int64]:
    number = np.arange(len(t))
    is_new = np.diff(t, prepend=t[:1] - 1) != 0
    repeated = number - np.maximum.accumulate(np.where(is_new, number, 0))
    return np.stack([np.cumsum(np.diff(t, prepend=t[:1]) < 0), t, repeated])
