"""A log as one table, as CSV, Parquet or Excel: a column per channel, a row per time stamp.

Channels with different time stamps share a row only where the stamps are equal. Nothing is
interpolated. Every channel keeps its own order: where its time jumps back, a new pass through time
begins below. Clock times are in UTC to the nanosecond. Others are seconds, which still tell
nanoseconds apart after 50 days.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow.csv import CSVWriter, WriteOptions

from ..core.model import Log, Times
from ..core.text import distinct
from . import names, workbook

_ROWS = 1 << 16  # made at once


def write_csv(path: Path, log: Log) -> None:
    """Write a log with units in the header; a cell without a value is empty."""
    titles = map(names.cell, _titles(log))
    _, *types = _types(log)
    time_type = pa.string() if log.absolute else pa.float64()
    schema = pa.schema(list(zip(titles, [time_type, *types], strict=True)))
    options = WriteOptions(quoting_style="none")  # no cell below the head has a comma
    with path.open("wb") as file, CSVWriter(file, schema, write_options=options) as writer:
        for batch in _batches(log, schema):
            writer.write_batch(batch)


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
    with path.open("wb") as file, ParquetWriter(file, schema, **options) as writer:
        for batch in _batches(log, schema):
            writer.write_batch(batch)


def write_workbook(path: Path, log: Log) -> None:
    """The same as an Excel workbook, whose time stamps hold microseconds.

    Raises:
        UserError: the log has more rows or channels than a sheet holds.
    """
    schema = pa.schema(list(zip(_titles(log), _types(log), strict=True)))
    axes = _axes(log)
    rows = sum(len(_rows(axes, x)[0]) for x in _slices(axes))
    workbook.write_workbook(path, {"log": workbook.Sheet(schema, rows, _batches(log, schema))})


def _titles(log: Log) -> Iterator[str]:
    yield "time" if log.absolute else "time [s]"
    for name, unit in names.channels(log):
        has_unit = not unit or name.endswith((f"[{unit}]", f"({unit})"))
        yield name if has_unit else f"{name} [{unit}]"


def _types(log: Log) -> list[Any]:
    time = pa.timestamp("ns", "UTC") if log.absolute else pa.float64()
    return [time] + [pa.float64()] * len(log.channels)


def _batches(log: Log, schema: Any) -> Iterator[Any]:
    """The rows in order, some at once; a channel's column is null where it has no value."""
    axes = _axes(log)
    for slices in _slices(axes):
        t, rows = _rows(axes, slices)
        columns = [_time_column(t, schema.types[0])]
        for data in (channel.data for channel in log.channels):
            values, has_value = np.zeros(len(t)), np.zeros(len(t), bool)
            row, piece = rows[id(data.t)], slices[id(data.t)]
            values[row] = data.value[piece]
            has_value[row] = data.valid[piece]
            columns.append(pa.array(values, mask=~has_value | np.isnan(values)))
        yield pa.record_batch(columns, schema=schema)


def _time_column(t: Times, kind: Any) -> Any:
    """The times as seconds, as time stamps in UTC, or as the text of these."""
    if pa.types.is_floating(kind):
        return pa.array(t / 1e9)
    if pa.types.is_timestamp(kind):
        return pa.array(t, kind)
    # Arrow writes a text with its zone only where the system has a database of time zones.
    text = pa.array(t, pa.timestamp("ns")).cast(pa.string())
    return pc.binary_join_element_wise(text, "Z", "")


class _Axis(NamedTuple):
    """The time of channels, and its passes: it jumps back between two."""

    t: Times
    edges: NDArray[np.int64]  # where each begins, and the end

    def place(self, row: int) -> tuple[int, int]:
        """The pass of a sample, and its stamp."""
        return int(np.searchsorted(self.edges, row, side="right")) - 1, int(self.t[row])

    def row_past(self, place: tuple[int, int]) -> int:
        """The first sample behind a place."""
        start, stop = self.edges[np.minimum([place[0], place[0] + 1], len(self.edges) - 1)]
        return int(start + np.searchsorted(self.t[start:stop], place[1], side="right"))


def _axes(log: Log) -> dict[int, _Axis]:
    """The times of the channels, by the identity of their arrays."""
    return {
        id(t): _Axis(t, np.concatenate([[0], np.flatnonzero(t[1:] < t[:-1]) + 1, [len(t)]]))
        for t in (c.data.t for c in log.channels)
    }


def _slices(axes: dict[int, _Axis]) -> Iterator[dict[int, slice]]:
    """The samples of each axis that are written at once, to the same place in all of them."""
    positions = dict.fromkeys(axes, 0)
    while unfinished := [key for key, axis in axes.items() if positions[key] < len(axis.t)]:
        last_place = min(
            axes[key].place(min(positions[key] + _ROWS, len(axes[key].t)) - 1) for key in unfinished
        )
        stops = {key: axis.row_past(last_place) for key, axis in axes.items()}
        yield {key: slice(positions[key], stop) for key, stop in stops.items()}
        positions = stops


def _rows(
    axes: dict[int, _Axis], slices: dict[int, slice]
) -> tuple[Times, dict[int, NDArray[np.int64]]]:
    """One row per distinct time stamp, and the row of each sample of each axis.

    A stamp that an axis repeats, or comes back to, gets its own row. A row is identified by
    (how often the time has jumped back, stamp, how often it repeated just now).
    """
    table = np.concatenate([_keys(axes[key], piece) for key, piece in slices.items()], axis=1)
    order = np.lexsort(table[::-1])
    table = table[:, order]
    is_new = np.ones(len(order), bool)
    is_new[1:] = (np.diff(table, axis=1) != 0).any(axis=0)
    row = np.empty(len(order), np.int64)
    row[order] = np.cumsum(is_new) - 1
    slice_ends = np.cumsum([piece.stop - piece.start for piece in slices.values()])
    return table[1, is_new], dict(zip(slices, np.split(row, slice_ends[:-1]), strict=True))


def _keys(axis: _Axis, piece: slice) -> NDArray[np.int64]:
    t, number = axis.t[piece], np.arange(piece.start, piece.stop)
    is_new = np.diff(t, prepend=t[:1] - 1) != 0
    repeated = number - np.maximum.accumulate(np.where(is_new, number, 0))
    return np.stack([np.searchsorted(axis.edges, number, side="right"), t, repeated])
