"""The sample brake in the formats of other loggers, written by their own libraries."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.csv

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "sample_logs" / "low-adhesion.csv"
START = datetime(2026, 11, 21, 13, 5, 7, 250_000, UTC)


class Signal(NamedTuple):
    """A channel: name, unit, values."""

    name: str
    unit: str
    value: Any


class Group(NamedTuple):
    """Channels of one rate: time [s], channels."""

    t: Any
    signals: list[Signal]


def groups(path: Path = SAMPLE) -> list[Group]:
    """The channels of a CSV log, those with values in the same rows together."""
    table = pyarrow.csv.read_csv(path)
    t = table.column(0).to_numpy()
    found: dict[bytes, Group] = {}
    for title in table.column_names[1:]:
        column = table[title]
        there = column.is_valid().to_numpy()
        name, unit = title.rstrip("]").split(" [")
        group = found.setdefault(there.tobytes(), Group(t[there], []))
        value = np.asarray(column.drop_null().to_numpy(), np.float64)
        group.signals.append(Signal(name, unit, value))
    return list(found.values())


def mdf(path: Path, of: list[Group], version: str = "4.10", compression: int = 0) -> Path:
    """An MDF file; `compression`: 0 none, 1 deflate, 2 transposed."""
    import asammdf

    with asammdf.MDF(version=version) as file:
        file.header.start_time = START
        for group in of:
            channels = [
                asammdf.Signal(s.value, group.t, name=s.name, unit=s.unit) for s in group.signals
            ]
            file.append(channels, common_timebase=True)
        return Path(file.save(path, overwrite=True, compression=compression))


def parquet(path: Path, of: list[Group], row_group_size: int = 300) -> Path:
    """A Parquet file; all channels share a time, with nulls where they have no value."""
    import pyarrow as pa
    import pyarrow.parquet

    t = np.unique(np.concatenate([group.t for group in of]))
    ticks = np.rint(t * 1e9).astype(np.int64) + round(START.timestamp() * 1e3) * 10**6
    fields = [pa.field("time", pa.timestamp("ns", "UTC"))]
    columns = [pa.array(ticks, fields[0].type)]
    for group in of:
        rows = np.searchsorted(t, group.t)
        for s in group.signals:
            value, empty = np.zeros(len(t)), np.ones(len(t), bool)
            value[rows], empty[rows] = s.value, False
            columns.append(pa.array(value, mask=empty))
            fields.append(pa.field(s.name, pa.float64(), metadata={"unit": s.unit}))
    table = pa.table(columns, schema=pa.schema(fields))
    pa.parquet.write_table(
        table, path, row_group_size=row_group_size, write_page_checksum=True, compression="zstd"
    )
    return path


def tdms(path: Path, of: list[Group], *, by_channel: bool = False, segments: int = 1) -> Path:
    """A TDMS file of a group for each rate, in this many segments.

    The time is the start and increment of each channel, else a channel of the group.
    """
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as file:
        for part in range(segments):
            objects = []
            for k, group in enumerate(of):
                rows = slice(len(group.t) * part // segments, len(group.t) * (part + 1) // segments)
                step = float(group.t[1] - group.t[0])
                regular = np.allclose(np.diff(group.t), step) and not by_channel
                if not regular:
                    unit = {"unit_string": "s"}
                    objects.append(ChannelObject(f"rate {k}", "Time", group.t[rows], unit))
                for s in group.signals:
                    properties: dict[str, Any] = {"unit_string": s.unit}
                    if regular:
                        start = np.datetime64(START.replace(tzinfo=None))
                        properties |= {"wf_start_time": start, "wf_increment": step}
                        properties |= {"wf_start_offset": float(group.t[0])}
                    objects.append(ChannelObject(f"rate {k}", s.name, s.value[rows], properties))
            file.write_segment(objects)
    return path
