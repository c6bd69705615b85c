"""TDMS logs of LabVIEW and DIAdem, by npTDMS; runs in a process of its own."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Bools, Times
from . import time_columns
from .csv.clock import Clock
from .source import Field, ReadOptions
from .tables import (
    YEAR_1990,
    Columns,
    Contents,
    NamedColumn,
    TableSamples,
    fields,
    nanoseconds,
)

_SINCE_1904 = 2_082_844_800  # seconds from the epoch of LabVIEW to 1970
_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")  # properties of a channel


class _Wave(NamedTuple):
    """Time of a channel by its own properties."""

    start: int  # since 1970 [ns]; 0 where none is stated
    offset: float  # of the first sample [s]
    increment: float  # [s]


class _Columns(NamedTuple):
    """Time of a group by its time channels."""

    group: str
    clock: Clock
    names: tuple[str, ...]


_Axis = _Wave | _Columns


class Reader:
    """A TDMS file, opened; see `tables.Reader`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        from nptdms import TdmsFile

        self._path, self._options = path, options
        # As a file without a name: the library would trust an index file beside the log.
        self._file: Any = TdmsFile.open(path.open("rb"), raw_timestamps=True)
        self._channels: list[tuple[Any, _Axis]] = []
        self._texts: list[str] = []
        findings: list[Finding] = []
        refused: dict[str, UserError] = {}  # by group
        for group in self._file.groups():
            try:
                self._add(group)
            except UserError as error:
                refused[group.name] = error
        if refused and not self._channels:
            raise next(iter(refused.values()))
        timeless = list(refused)
        starts = {self._start(axis) for _, axis in self._channels}
        start = min((s for s in starts if s >= YEAR_1990), default=0)
        if start and min(starts) < YEAR_1990:  # the two cannot be compared
            skipped_groups = {c.group_name for c, axis in self._channels if not self._start(axis)}
            timeless += sorted(skipped_groups)
            self._channels = [pair for pair in self._channels if self._start(pair[1])]
        if timeless:
            names = {"groups": ", ".join(timeless[:6]), "reason": "they have no time, or another"}
            findings.append(Finding("group-not-read", "info", "", len(timeless), (), {}, names))
        rows = self._count_rows()
        if damage := self._damage():
            values = {"kept_rows": rows}
            findings.append(Finding("log-damaged", "error", "", 1, (), values, {"damage": damage}))
        reasons = {
            "version": self._file.tdms_version,
            "groups": len(self._file.groups()),
            "not numeric": ", ".join(dict.fromkeys(self._texts)),
        }
        reason = self._reason(start)
        self.contents = Contents(self._fields(), start, reason, rows, reasons, findings=findings)

    def _add(self, group: Any) -> None:
        """Adds the channels of a group, those with a time of their own first.

        Raises:
            UserError: where the others have no time.
        """
        channels = [c for c in group.channels() if len(c)]
        without_wave = [c for c in channels if not _wave(c)]
        for channel in channels:
            if not _is_number(channel):
                self._texts += [channel.name] * (not _is_time(channel))
            elif wave := _wave(channel):
                self._channels.append((channel, wave))
        if without_wave and (
            len(without_wave) == len(channels) or self._options.time_channel is None
        ):
            axis = self._by_columns(group.name, without_wave)
            own_names = [c for c in without_wave if c.name not in axis.names and _is_number(c)]
            self._channels += [(channel, axis) for channel in own_names]

    def _by_columns(self, group: str, channels: Sequence[Any]) -> _Columns:
        """The time of a group that has time channels.

        Raises:
            UserError: where no channel is a time.
        """
        heads = {
            c.name: _array(c[: time_columns.HEAD]) for c in channels if _is_number(c) or _is_time(c)
        }
        units = [_unit(c) for c in channels if c.name in heads]
        rows = max(map(len, channels))
        clock, _ = time_columns.find(heads, units, rows, self._options, self._path)
        return _Columns(group, clock, tuple(list(heads)[i] for i in clock.columns))

    def _start(self, axis: _Axis) -> int:
        """Where an axis begins since 1970 [ns]; 0 where it counts from an unknown start."""
        if isinstance(axis, _Wave):
            return axis.start
        head, _ = self._by_clock(axis, 1)
        return int(head[0]) if axis.clock.absolute and len(head) else 0

    def _by_clock(self, axis: _Columns, rows: int | None = None) -> tuple[Times, Bools]:
        """Times of a group by its time channels [ns], and which of them hold; shape (n,)."""
        time_channels = [self._file[axis.group][name][:rows] for name in axis.names]
        return time_columns.times([_array(values) for values in time_channels], axis.clock)

    def _damage(self) -> str:
        """What is wrong at the end of the file, which the library passes over; "" for nothing."""
        segments = self._file._reader._segments
        end = segments[-1].next_segment_pos if segments else 0
        if self._file.file_status.incomplete_final_segment:
            return "the last segment is not complete"
        return f"byte {end}: no segment begins there" if end < self._path.stat().st_size else ""

    def _count_rows(self) -> int:
        """Samples of the longest channel of each group and time, in all."""
        rows: dict[tuple[str, _Axis], int] = {}
        for c, axis in self._channels:
            key = c.group_name, axis
            rows[key] = max(len(c), rows.get(key, 0))
        return sum(rows.values())

    def _reason(self, start: int) -> str:
        """Which time was taken, for people."""
        axes = {axis for _, axis in self._channels}
        by_columns = [_reason(axis.clock) for axis in axes if isinstance(axis, _Columns)]
        waves = "start and increment of each channel" + (" (UTC)" if start else "; no start stated")
        descriptions = [waves] * (len(by_columns) < len(axes)) + by_columns
        return "; ".join(dict.fromkeys(descriptions))

    def _fields(self) -> list[Field]:
        """A field for each channel of numbers."""
        axes = list(dict.fromkeys((c.group_name, axis) for c, axis in self._channels))
        named = []
        for c, axis in self._channels:
            folder = f"{axes.index((c.group_name, axis))} {c.group_name}"
            named.append(NamedColumn(c.group_name, c.name or "(no name)", _unit(c), folder))
        return fields(named, "channel's unit")

    def read(self, wanted: Sequence[int]) -> Columns:
        """See `tables.Reader`."""
        axes: list[Times] = []
        places: dict[Any, int] = {}
        series, findings = [], []
        for k in wanted:
            channel, axis = self._channels[k]
            value = np.asarray(channel[:], np.float64)
            t, ok = self._times(axis, len(value))
            n = min(len(value), len(t))
            if invalid := len(value) - int(np.count_nonzero(ok[:n])):
                findings.append(Finding("time-unreadable", "warning", channel.name, invalid))
            if (axis, n) not in places:
                places[axis, n] = len(axes)
                axes.append(t[:n][ok[:n]])
            series.append(TableSamples(places[axis, n], value[:n][ok[:n]]))
        return Columns(axes, series, findings)

    def _times(self, axis: _Axis, n: int) -> tuple[Times, Bools]:
        """Times [ns] of a channel of n samples, and which of them hold."""
        if isinstance(axis, _Columns):
            return self._by_clock(axis)
        return nanoseconds(
            axis.offset + np.arange(n, dtype=np.float64) * axis.increment, axis.start
        )


def _reason(clock: Clock) -> str:
    return clock.reason.replace("(units row)", "(channel's unit)")


def _wave(channel: Any) -> _Wave | None:
    """The time that a channel's properties state, None where they state none."""
    properties = channel.properties
    increment = properties.get("wf_increment", 0.0)
    if not isinstance(increment, float | int) or not 0.0 < increment < 1e6:
        return None
    offset = properties.get("wf_start_offset", 0.0)
    start = properties.get("wf_start_time")
    ns = 0
    if hasattr(start, "second_fractions"):
        ns = int(_stamps(np.array([start.seconds]), np.array([start.second_fractions]))[0])
    start_offset = float(offset) if isinstance(offset, float | int) and abs(offset) < 1e9 else 0.0
    return _Wave(ns if ns >= YEAR_1990 else 0, start_offset, float(increment))


def _stamps(seconds: Any, fractions: Any) -> Times:
    """Times since 1970 [ns] of LabVIEW's seconds since 1904 and 2⁻⁶⁴ fractions; shape (n,)."""
    nanoseconds = np.rint(np.asarray(fractions, np.float64) * (1e9 / 2.0**64)).astype(np.int64)
    return (np.asarray(seconds, np.int64) - _SINCE_1904) * 10**9 + nanoseconds


def _is_number(channel: Any) -> bool:
    return channel.dtype is not None and channel.dtype.kind in "biuf"


def _is_time(channel: Any) -> bool:
    return channel.dtype is not None and channel.dtype.kind in "VM"


def _array(values: Any) -> Any:
    """Values of a channel as an Arrow array; stamps with their zone."""
    names = values.dtype.names or ()
    if "second_fractions" in names:
        stamps = _stamps(np.asarray(values["seconds"]), np.asarray(values["second_fractions"]))
        return pa.array(stamps, pa.timestamp("ns", "UTC"))
    return pa.array(np.asarray(values))


def _unit(channel: Any) -> str:
    """The unit that a channel's properties state, "" for none."""
    texts: Iterator[str] = (str(channel.properties.get(name, "")).strip() for name in _UNITS)
    return next((unit for unit in texts if unit), "")
