"""ASAM MDF logs of versions 3 and 4 (MF4), by asammdf; runs in a process of its own."""

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Bools, Floats
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

_EPOCH, _ZERO = datetime(1970, 1, 1), timedelta(0)
_TIME = 1  # type of a master channel: time, and no angle, distance or index
# By whether the version is 4: data types that are integers and floats; conversions that give
# numbers only; conversions that give a text for some values.
_NUMBERS = {True: tuple(range(6)), False: (0, 1, 2, 3, *range(9, 17))}
_PLAIN_CONVERSIONS = {True: tuple(range(7)), False: (0, 1, 2, 6, 7, 8, 9, 10, 65535)}
_TEXTS = {True: (7, 8), False: (11, 12)}


class _ChannelPlace(NamedTuple):
    """Where a channel is in the file."""

    group: int
    channel: int


class Reader:
    """An MDF file, opened; see `tables.Reader`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        import asammdf

        self._path = path
        try:
            library: Any = asammdf
            self._mdf: Any = library.MDF(path, process_bus_logging=False)
        except ValueError as error:
            if "seek out of range" not in str(error):
                raise
            text = "a link leads behind the end of the file; it was cut off, or a link is wrong"
            raise ValueError(text) from error
        self._is_version_4 = self._mdf.version >= "4"
        self._start, zone = self._begin()
        self._places: list[_ChannelPlace] = []
        self._row_counts: dict[int, int] = {}  # whole rows of each group
        self._names: dict[int, str] = {}
        findings: list[Finding] = []
        rows, timeless, texts = 0, [], []
        for g, group in enumerate(self._mdf.groups):
            count = group.channel_group.cycles_nr
            if not count:
                continue
            self._names[g] = self._name(g)
            master = self._mdf.masters_db.get(g)
            if not self._is_time(group, master):
                timeless.append(self._names[g])
                continue
            self._row_counts[g] = int(count)
            rows += self._row_counts[g]
            for i, channel in enumerate(group.channels):
                if i == master:
                    continue
                if self._is_number(group, i):
                    self._places.append(_ChannelPlace(g, i))
                else:
                    texts.append(channel.name)
        if timeless:
            names = {"groups": ", ".join(timeless[:6]), "reason": "they have no time axis"}
            findings.append(Finding("group-not-read", "info", "", len(timeless), (), {}, names))
        reason = "time channel of each group, in seconds"
        reason += f" after the start of the log ({zone})" if self._start else "; no start stated"
        reasons = {
            "version": self._mdf.version,
            "groups": len(self._row_counts),
            "not numeric": ", ".join(dict.fromkeys(texts)),
        }
        self.contents = Contents(
            self._fields(), self._start, reason, rows, reasons, findings=findings
        )

    def _begin(self) -> tuple[int, str]:
        """Start of the log since 1970 [ns], 0 where the file states none, and its zone."""
        header = self._mdf.header
        if not self._is_version_4:
            start = header.start_time
            since = (start.replace(tzinfo=None) - _EPOCH) - (start.utcoffset() or _ZERO)
            ticks = round(since.total_seconds() * 1e6) * 1000
            zone = "UTC" if start.tzinfo else "without a zone: taken as UTC"
            return (ticks if ticks > YEAR_1990 else 0), zone
        local = header.time_flags & 1
        zone = "in local time without a zone: taken as UTC" if local else "UTC"
        return (header.abs_time if header.abs_time > YEAR_1990 else 0), zone

    def _name(self, g: int) -> str:
        """A group's name for people."""
        group = self._mdf.groups[g]
        name = group.channel_group.acq_name if self._is_version_4 else ""
        return name or f"group {g + 1}"

    def _is_time(self, group: Any, master: int | None) -> bool:
        if master is None:
            return False
        return not self._is_version_4 or group.channels[master].sync_type == _TIME

    def _is_number(self, group: Any, i: int) -> bool:
        """Whether a channel holds one number in each row."""
        channel = group.channels[i]
        if group.channel_dependencies[i]:  # arrays and structures
            return False
        if channel.data_type not in _NUMBERS[self._is_version_4]:
            return False
        conversion = channel.conversion
        if conversion is None:
            return True
        kind = conversion.conversion_type
        if kind in _TEXTS[self._is_version_4]:
            blocks = (conversion.referenced_blocks or {}).values()
            return any(hasattr(block, "convert") for block in blocks)
        return kind in _PLAIN_CONVERSIONS[self._is_version_4]

    def _fields(self) -> list[Field]:
        """A field for each channel of numbers."""
        named = []
        for g, i in self._places:
            name = self._mdf.groups[g].channels[i].name or f"channel {i + 1}"
            unit = (self._mdf.get_channel_unit(group=g, index=i) or "").strip()
            named.append(NamedColumn(self._names[g], name, unit, f"{g + 1} {self._names[g]}"))
        return fields(named, "channel's unit")

    def read(self, wanted: Sequence[int]) -> Columns:
        """See `tables.Reader`."""
        places = [self._places[k] for k in wanted]
        axes, series, findings = [], {}, []
        for a, g in enumerate(dict.fromkeys(place.group for place in places)):
            group_places = list(dict.fromkeys(place for place in places if place.group == g))
            signals = self._mdf.select(
                [(None, *place) for place in group_places],
                raw=True,
                copy_master=False,
            )
            t, ok = nanoseconds(signals[0].timestamps, self._start)
            rows = len(t)
            if rows < self._row_counts[g]:
                values = {"kept_rows": rows, "lost_rows": self._row_counts[g] - rows}
                note_values = {"damage": f"group {self._names[g]!r}, its data end early"}
                findings.append(Finding("log-damaged", "error", "", 1, (), values, note_values))
            if not ok.all():
                lost_rows = int(np.count_nonzero(~ok))
                findings.append(Finding("time-unreadable", "warning", self._names[g], lost_rows))
            axes.append(t[ok])
            for place, signal in zip(group_places, signals, strict=True):
                if len(signal.samples) != rows:
                    raise UserError(
                        f"{self._path}: damaged MDF file: channel {signal.name!r} has "
                        f"{len(signal.samples)} samples at {rows} times",
                        "copy the log again from its source",
                    )
                value, text = _physical(signal, _TEXTS[self._is_version_4])
                masks = {}
                if signal.invalidation_bits is not None:
                    masks["value-marked-invalid"] = np.asarray(signal.invalidation_bits, bool)[ok]
                if text is not None:
                    masks["value-is-text"] = text[ok]
                series[place] = TableSamples(a, value[ok], masks)
        return Columns(axes, [series[place] for place in places], findings)


def _physical(signal: Any, texts: Sequence[int]) -> tuple[Floats, Bools | None]:
    """The numbers of a channel, and which of its samples stand for a text; None for none.

    A conversion that gives a text for some values converts each value that occurs once.

    Args:
        signal: its raw values and their conversion.
        texts: types of such conversions.
    """
    raw, conversion = signal.samples, signal.conversion
    if conversion is None:
        return np.asarray(raw, np.float64), None
    if conversion.conversion_type not in texts:
        return np.asarray(conversion.convert(raw), np.float64), None
    values, inverse = np.unique(raw, return_inverse=True)
    converted = conversion.convert(values, as_object=True)
    text = np.array([isinstance(x, str | bytes) for x in converted], bool)
    numbers = np.array([np.nan if isinstance(x, str | bytes) else float(x) for x in converted])
    return numbers[inverse], text[inverse]
