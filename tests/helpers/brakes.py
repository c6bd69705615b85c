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


_SCALE = {"bar": 0.01, "km/h": 0.01, "N": 1.0, "-": 0.0001}  # of the sample's own digits


def database(of: list[Group]) -> Any:
    """A DBC of a message for each pair of channels, in both orders of bytes."""
    from cantools.database import Database, Message, Signal
    from cantools.database.conversion import BaseConversion

    messages = []
    for k, group in enumerate(of):
        for i in range(0, len(group.signals), 2):
            signals = []
            for j, s in enumerate(group.signals[i : i + 2]):
                conversion = BaseConversion.factory(scale=_SCALE[s.unit], offset=0)
                order: Any = ("little_endian", "big_endian")[j]
                start = 0 if j == 0 else 39  # byte 4, its highest bit
                signals.append(
                    Signal(s.name, start, 32, order, True, conversion=conversion, unit=s.unit)
                )
            identifier = 0x100 + 0x10 * k + i // 2
            messages.append(Message(identifier, f"Rate{k}_{i // 2}", 8, signals, strict=True))
    return Database(messages, version="")


def can(path: Path, of: list[Group], *, errors: tuple[float, ...] = ()) -> Path:
    """A CAN log in the format of the suffix; its DBC stands next to it."""
    import can as library

    dbc = database(of)
    path.with_suffix(".dbc").write_text(dbc.as_dbc_string(), "utf-8")
    start = START.timestamp()
    frames = []
    for k, group in enumerate(of):
        for i in range(0, len(group.signals), 2):
            message = dbc.get_message_by_name(f"Rate{k}_{i // 2}")
            pair = group.signals[i : i + 2]
            for row, t in enumerate(group.t):
                data = message.encode({s.name: float(s.value[row]) for s in pair})
                frames.append(
                    library.Message(
                        start + t, message.frame_id, False, data=data, channel=0, is_rx=True
                    )
                )
    frames += [library.Message(start + t, is_error_frame=True, channel=0) for t in errors]
    frames.sort(key=lambda frame: frame.timestamp)
    with library.Logger(path) as log:
        for frame in frames:
            log(frame)
    if path.suffix == ".trc":  # its head names its folder: its bytes are to be the same in any
        path.write_bytes(path.read_bytes().replace(str(path).encode(), path.name.encode()))
    return path
