"""ASAM MDF logs of versions 3 and 4 (MF4), by asammdf; runs in a process of its own."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import toml
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Bools, Floats, Times
from .csv.cells import count_of
from .csv.header_words import time_unit
from .source import YEAR_1990, ReadOptions, distinct_words, numbered
from .tables import Contents, NamedColumn, TableSamples, fields, nanoseconds, state_fields

_EPOCH, _MICROSECOND = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)
_EPOCH_S = 631_152_000.0, 4e9  # seconds of a date from 1990 on: such a time counts from 1970
_TIME = 1  # type of a master channel: time, and no angle, distance or index
# By whether the version is 4: data types that are integers and floats; conversions that give
# numbers only; conversions that give a text for some values.
_NUMBERS = {True: tuple(range(6)), False: (0, 1, 2, 3, *range(9, 17))}
_PLAIN_CONVERSIONS = {True: tuple(range(7)), False: (0, 1, 2, 6, 7, 8, 9, 10, 65535)}
_TEXTS = {True: (7, 8), False: (11, 12)}
_STRINGS = {True: (6, 7, 8, 9), False: (7,)}  # data types that are texts
_FINER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # units that a time may count, which says s
_LONGEST_STEP = 2.0  # of a brake log [s]
_HEAD = 1_000  # records that show which words a channel has
_UNSIGNED = {True: (0, 1), False: (0, 9, 13)}
_FRAMES = "CAN_DataFrame"  # channel of a group that holds the frames of a bus


class _Master(NamedTuple):
    """How the time channel of a group becomes seconds."""

    channel: int
    scale: float  # s = scale * value
    is_absolute: bool  # counts from 1970, not from the start of the log
    turn: float  # [s] that an unsigned counter spans; 0 for other numbers


class _ChannelPlace(NamedTuple):
    group: int
    channel: int


class Reader:
    """An MDF file, opened; see `tables.Reader`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        import asammdf

        self._path, self._options = path, options
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
        self._masters: dict[int, _Master] = {}
        self._texts: list[str] = []
        self._words: dict[_ChannelPlace, tuple[str, ...]] = {}  # of channels of words
        for g, group in enumerate(self._mdf.groups):
            if not group.channel_group.cycles_nr:
                continue
            name = group.channel_group.acq_name if self._is_version_4 else ""
            self._names[g] = name or f"group {g + 1}"
            if problem := self._add(g, group):
                findings.append(self._not_read(g, problem))
        if not self._places and any(_has_frames(group) for group in self._mdf.groups):
            text = f"{path}: the log holds CAN frames; which signals they are, a DBC file says"
            raise UserError(text, "state it with --dbc FILE.dbc")
        findings += self._settle_units()
        if any(time.is_absolute for time in self._masters.values()) and not self._start:
            zone, self._start = "UTC", YEAR_1990  # no other time can be compared with these
            for g in [g for g, time in self._masters.items() if not time.is_absolute]:
                findings.append(self._not_read(g, "their time has no start, that of others has"))
                del self._row_counts[g]
            self._places = [p for p in self._places if p.group in self._row_counts]
            self._words = {p: x for p, x in self._words.items() if p.group in self._row_counts}
        rows = sum(self._row_counts.values())
        reason = "time channel of each group, in the unit that it states"
        reason += f", after the start of the log ({zone})" if self._start else "; no start stated"
        reasons = {"version": self._mdf.version, "groups": len(self._row_counts)}
        reasons["not numeric"] = ", ".join(dict.fromkeys(self._texts))
        numbers = fields(list(map(self._named, self._places)), "channel's unit")
        named = {place: self._named(place) for place in self._words}
        texts = state_fields(named, self._words, dict(zip(self._places, numbers, strict=True)))
        self.contents = Contents(numbers, self._start, reason, rows, reasons, findings, texts)

    def _begin(self) -> tuple[int, str]:
        """Start of the log since 1970 [ns], 0 where the file states none, and its zone."""
        start = self._mdf.header.start_time
        zone = "UTC" if start.tzinfo else "without a zone: taken as UTC"
        ticks = (start.replace(tzinfo=start.tzinfo or UTC) - _EPOCH) // _MICROSECOND * 1000
        return (ticks if ticks > YEAR_1990 else 0), zone

    def _not_read(self, g: int, reason: str) -> Finding:
        return Finding("group-not-read", "info", names={"groups": self._names[g], "reason": reason})

    def _add(self, g: int, group: Any) -> str:
        """Adds the channels of a group; "", or why it cannot be read."""
        master = self._mdf.masters_db.get(g)
        if _has_frames(group):
            return "they hold CAN frames, whose DBC is to be stated with --dbc"
        if master is None or (self._is_version_4 and group.channels[master].sync_type != _TIME):
            return "they have no time axis"
        time = self._master(g, master)
        if time is None:
            unit = self._mdf.get_channel_unit(group=g, index=master)
            return f"their time is in {unit!r}, which is no unit of time"
        self._masters[g] = time
        self._row_counts[g] = int(group.channel_group.cycles_nr)
        for i, channel in enumerate(group.channels):
            if i != master and self._is_number(group, i):
                self._places.append(_ChannelPlace(g, i))
            elif i != master:
                self._texts.append(channel.name)
        self._find_words(g, group)
        return ""

    def _find_words(self, g: int, group: Any) -> None:
        """Finds the words of a group: those that conversions have, and the first of texts."""
        words: dict[_ChannelPlace, tuple[str, ...]] = {}
        strings = []
        for i, channel in enumerate(group.channels):
            texts = (getattr(channel.conversion, "referenced_blocks", None) or {}).values()
            words[_ChannelPlace(g, i)] = distinct_words(x for x in map(_text, texts) if x)
            if channel.data_type in _STRINGS[self._is_version_4]:
                strings.append(_ChannelPlace(g, i))
        head = self._mdf.select([(None, *x) for x in strings], raw=True, record_count=_HEAD)
        for place, signal in zip(strings, head, strict=True):
            words[place] = distinct_words(filter(None, map(_text, signal.samples)))
        self._words |= {place: x for place, x in words.items() if x}

    def _master(self, g: int, i: int) -> _Master | None:
        """How a group's time is read, since 1970 by its size; None if its unit is none of time."""
        said = self._mdf.get_channel_unit(group=g, index=i) or "s"
        unit = self._options.time_unit or time_unit(said)
        if unit is None:
            return None
        first_stamp = float(self._mdf.get_master(g, record_offset=0, record_count=1)[0])
        factor = count_of(unit).ns / 1e9
        scale = next((x for x in (factor, *_FINER.values()) if _is_date(first_stamp * x)), factor)
        channel, counter_span = self._mdf.groups[g].channels[i], 0.0
        if channel.data_type in _UNSIGNED[self._is_version_4] and channel.bit_count in (32, 64):
            counter_span = 2.0**channel.bit_count * scale * getattr(channel.conversion, "a", 1.0)
        return _Master(i, scale, _is_date(first_stamp * scale), counter_span)

    def _settle_units(self) -> Iterator[Finding]:
        """Takes times as ms, us or ns that say s, where the length of another group proves it."""
        lengths, finer = dict[int, float](), dict[int, str]()
        for g, master in self._masters.items():
            stamps = self._mdf.get_master(g, record_offset=0, record_count=_HEAD)
            last_row = self._row_counts[g] - 1
            last_stamp = self._mdf.get_master(g, record_offset=last_row, record_count=1)
            lengths[g] = master.scale * float((last_stamp - stamps[:1])[0])
            step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
            if master.scale == 1.0 and step > _LONGEST_STEP and not self._options.time_unit:
                usual = (x for x in _FINER if step * _FINER[x] <= _LONGEST_STEP / 10.0)
                finer[g] = next(usual, "s")
        longest_known = max((x for g, x in lengths.items() if g not in finer), default=0.0)
        for g, unit in ((g, x) for g, x in finer.items() if x in _FINER):
            name = self._names[g]
            if not longest_known:
                text = f"{self._path}: the time of {name!r} says s, and has steps of more than "
                text += f"{_LONGEST_STEP:g} s: the log would be {lengths[g]:g} s long"
                line = f"channels.time.unit = {toml.quoted(unit)}"
                raise UserError(text, f"state its unit, as {toml.option(line)} (or s)")
            if 0.5 < lengths[g] * _FINER[unit] / longest_known < 2.0:
                master = self._masters[g]
                turn = master.turn * _FINER[unit]
                self._masters[g] = master._replace(scale=_FINER[unit], turn=turn)
                reason = "as long as other groups"
                names = {"column": f"of {name!r}", "unit": unit, "reason": reason}
                yield Finding("time-unit-guessed", "info", name, names=names)

    def _times(self, g: int, timestamps: Floats) -> tuple[Times, Bools]:
        """The times of a group [ns] of its time channel's values, and which of them hold."""
        master = self._masters[g]
        seconds = master.scale * np.asarray(timestamps, np.float64)
        if master.turn and not master.is_absolute:
            # An unsigned counter that began below zero; its first number is close to a turn.
            wrapped = np.cumprod(seconds > master.turn / 2.0).astype(bool)
            if wrapped.any() and (not wrapped.all() or master.turn > _EPOCH_S[1]):
                raw = self._mdf.get(group=g, index=master.channel, raw=True)
                signed = raw.samples.view(f"<i{raw.samples.itemsize}")[: len(seconds)]
                exact = master.turn * (signed / 2.0 ** (8 * raw.samples.itemsize))
                seconds = np.where(wrapped, exact, seconds)
        return nanoseconds(seconds, 0 if master.is_absolute else self._start)

    def _is_number(self, group: Any, i: int) -> bool:
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

    def _named(self, place: _ChannelPlace) -> NamedColumn:
        g, i = place
        name = self._mdf.groups[g].channels[i].name or f"channel {i + 1}"
        unit = (self._mdf.get_channel_unit(group=g, index=i) or "").strip()
        return NamedColumn(self._names[g], name, unit, f"{g + 1} {self._names[g]}")

    def read(self, wanted: Sequence[int]) -> tuple[list[TableSamples], list[Finding]]:
        """See `tables.Reader`."""
        all_places = [(p, False) for p in self._places] + [(p, True) for p in self._words]
        as_words = [all_places[k] for k in wanted]
        places = [place for place, _ in as_words]
        series, findings = {}, []
        for g in dict.fromkeys(place.group for place in places):
            group_places = list(dict.fromkeys(place for place in places if place.group == g))
            channels = [(None, *place) for place in group_places]
            signals = self._mdf.select(channels, raw=True, copy_master=False)
            t, ok = self._times(g, signals[0].timestamps)
            rows = len(t)
            if rows < self._row_counts[g]:
                values = {"kept_rows": rows, "lost_rows": self._row_counts[g] - rows}
                note_values = {"damage": f"group {self._names[g]!r}, its data end early"}
                findings.append(Finding("log-damaged", "error", "", 1, (), values, note_values))
            if not ok.all():
                lost_rows = int(np.count_nonzero(~ok))
                findings.append(Finding("time-unreadable", "warning", self._names[g], lost_rows))
            whole_t = t[ok]
            for place, signal in zip(group_places, signals, strict=True):
                if len(signal.samples) != rows:
                    n = len(signal.samples)
                    raise ValueError(f"channel {signal.name!r} has {n} samples at {rows} times")
                value, texts = _physical(signal, _TEXTS[self._is_version_4])
                masks = {}
                if signal.invalidation_bits is not None:
                    masks["value-marked-invalid"] = np.asarray(signal.invalidation_bits, bool)[ok]
                if texts is not None:
                    is_text, words = np.array([x is not None for x in texts], bool)[ok], list[str]()
                    numbers = numbered(texts, words)[ok]
                    series[place, True] = TableSamples(whole_t, numbers, masks, tuple(words))
                    masks = {**masks, "value-is-text": is_text}
                series[place, False] = TableSamples(whole_t, value[ok], masks)
                if texts is None or not is_text.all():  # then the words mark some of its numbers
                    series[place, True] = series[place, False]
        return [series[pair] for pair in as_words], findings


def _has_frames(group: Any) -> bool:
    return any(channel.name == _FRAMES for channel in group.channels)


def _is_date(seconds: float) -> bool:
    return _EPOCH_S[0] < seconds < _EPOCH_S[1]


def _physical(signal: Any, conversions: Sequence[int]) -> tuple[Floats, NDArray[Any] | None]:
    """The numbers of a channel, and the texts that stand for some of them, None for no text; (n,).

    A conversion that gives a text for some values converts each value that occurs once. A number is
    NaN where a text stands, a text None where a number stands.
    """
    raw, conversion = signal.samples, signal.conversion
    has_texts = conversion is not None and conversion.conversion_type in conversions
    if raw.dtype.kind not in "SUO" and not has_texts:
        value = raw if conversion is None else conversion.convert(raw)
        return np.asarray(value, np.float64), None
    values, inverse = np.unique(raw, return_inverse=True)
    if has_texts:
        values = conversion.convert(values, as_object=True)
    texts = np.array([_text(x) for x in values] + [None], object)[inverse]
    numbers = np.array([np.nan if isinstance(x, str | bytes) else float(x) for x in values])
    return numbers[inverse], texts


def _text(value: Any) -> str | None:
    """A value that is a text, None for a number."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").rstrip("\0")
    return value if isinstance(value, str) else None
