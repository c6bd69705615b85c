"""TDMS logs of LabVIEW and DIAdem, by npTDMS; runs in a process of its own."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from ..core import toml, units
from ..core.errors import UserError
from ..core.finding import Finding, Severity
from ..core.model import Bools, Times
from ..core.time_axis import from_digits
from . import tables
from .as_text import HEAD, dialect_of, printable
from .csv.cells import Clock
from .csv.dialect import fit
from .csv.header_words import interval_s, label, time_name, time_unit
from .csv.time_column import find_clock
from .number_text import number_of
from .source import YEAR_1990, ReadOptions, distinct_words, numbered
from .tables import Contents, NamedColumn, TableSamples, fields, nanoseconds, state_fields

_SINCE_1904 = 2_082_844_800  # seconds from the epoch of LabVIEW to 1970
_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit")  # properties of a channel

# Properties that say what the samples are, and when: of a channel, its group or the file. The
# others are for people; wf_samples counts the samples of one writing.
_SCALING = re.compile(r"NI_(Scal|Number_Of_Scales|Unit)|[Uu]nit")
_SAYING = re.compile(rf"wf_(increment|start|x)|{_SCALING.pattern}|x(channel|relation)$")
_STEPS = ("interval", "rate")  # labels of properties that say how far samples are apart
_X_CHANNEL = ("xchannel", "xrelation")  # properties that name the channel with a channel's time
_NO_TIME = re.compile(r"(?i)fr[eé]qu|order|ordnung|angle|winkel|dist|weg\b|position|rpm|drehzahl")
_KINDS = dict.fromkeys("biuf", "number") | {"O": "text", "V": "time", "M": "time"}  # of numpy
_PAUSE = 0.5  # a longer jump of a time channel is a pause [s]
_DEFAULT_INCREMENT = 1.0  # [s]; writers state it where nobody set one


class _Wave(NamedTuple):
    """Time of a channel by properties, from one of its samples on."""

    start: int  # since 1970 [ns]; 0 where none is stated
    offset: float  # of the first sample [s]
    increment: float  # [s]
    row: int = 0  # its first sample

    def time(self, rows: Any) -> Any:
        """The times of samples of the channel, after `start` [s]."""
        return self.offset + (rows - self.row) * self.increment


class _Columns(NamedTuple):
    """Time of a group by its time channels."""

    group: str
    clock: Clock
    names: tuple[str, ...]


_Waves = tuple[_Wave, ...]  # pieces that were recorded one after the other
_Axis = _Waves | _Columns
_Properties = dict[str, Any]  # of a channel, a group or the file, by name
_States = list[tuple[int, _Properties]]  # properties, and the sample from which on they hold


class Reader:
    """A TDMS file, opened; see `tables.Reader`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        self._file, self._changes = _open_file(path)
        self._channels: list[tuple[Any, _Axis]] = []
        self._words: dict[tuple[Any, _Axis], tuple[str, ...]] = {}  # of channels of words
        self._texts: list[str] = []
        findings = self._findings = list[Finding]()
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
            timeless += sorted({c.group_name for c, x in self._channels if not self._start(x)})
            self._channels = [pair for pair in self._channels if self._start(pair[1])]
            self._words = {pair: x for pair, x in self._words.items() if self._start(pair[1])}
        if timeless:
            names = {"groups": ", ".join(timeless[:6]), "reason": "they have no time, or another"}
            findings.append(Finding("group-not-read", "info", "", len(timeless), (), {}, names))
        by_length = sorted(self._channels, key=lambda pair: len(pair[0]))
        longest = {(c.group_name, axis): len(c) for c, axis in by_length}
        rows = sum(longest.values())
        if damage := self._damage():
            values = {"kept_rows": rows}
            findings.append(Finding("log-damaged", "error", "", 1, (), values, {"damage": damage}))
        reasons = {"version": self._file.tdms_version, "groups": len(self._file.groups())}
        reasons["not numeric"] = ", ".join(dict.fromkeys(self._texts))
        numbers = fields(list(map(self._named, self._channels)), "channel's unit")
        texts = state_fields({x: self._named(x) for x in self._words}, self._words, {})
        reason = self._reason(start)
        self.contents = Contents(numbers, start, reason, rows, reasons, findings, texts)

    def _add(self, group: Any) -> None:
        """Adds the channels of a group."""
        channels, waves, by_name = self._readable(group), {}, {}
        for name, (channel, states) in channels.items():
            if _kind(channel) != "number":
                self._texts += [name] * (_kind(channel) != "time")
                continue
            time = next((x for p in _X_CHANNEL if (x := states[-1][1].get(p)) in channels), None)
            if time:
                by_name[name] = self._by_columns(group.name, [channels[time][0]])
            elif wave := _waves(states):
                waves[name] = wave
        times = {name for axis in by_name.values() for name in axis.names}
        usable = [c for c, _ in channels.values() if c.name not in times]
        axis = self._time_channel(group.name, usable, waves)
        remaining_channels = [c for c in usable if c.name not in {*by_name, *waves}]
        other_channels = [c for c in remaining_channels if _kind(c) in ("number", "time")]
        if other_channels and axis is None:
            try:
                axis = self._by_columns(group.name, remaining_channels)
            except UserError:
                if not by_name and not waves:
                    raise
                for channel in other_channels:
                    self._leave_out(channel, "it has no time", "info")
        if axis:
            times |= set(axis.names)
        for c in usable:
            own_axis = by_name.get(c.name) or waves.get(c.name) or axis
            if own_axis and _kind(c) == "number" and c.name not in times:
                self._channels.append((c, own_axis))
        self._add_words([c for c in usable if _kind(c) == "text" and c.name not in times])

    def _add_words(self, texts: Sequence[Any]) -> None:
        """Adds channels of words, each with the time of one of numbers that is as long."""
        for c in texts:
            alike = (x for x in self._channels if x[0].group_name == c.group_name)
            axis = next((axis for x, axis in alike if len(x) == len(c)), None)
            if axis and (state_words := distinct_words(c[:HEAD])):
                self._words[c, axis] = state_words

    def _readable(self, group: Any) -> dict[str, tuple[Any, _States]]:
        """The channels of a group whose numbers are known, by name, with what is said of them."""
        channels = {}
        for channel in group.channels():
            states = self._states(channel)
            if not len(channel):
                continue
            if problem := _scaling_problem(self._file, group, channel, states):
                self._leave_out(channel, problem, "warning")
            elif _kind(channel) == "number" and (problem := _axis_problem(states)):
                self._leave_out(channel, problem, "info")
            else:
                channels[channel.name] = channel, states
        return channels

    def _leave_out(self, channel: Any, reason: str, severity: Severity) -> None:
        names = {"reason": reason}
        self._findings.append(Finding("channel-not-read", severity, channel.name, 1, names=names))

    def _states(self, channel: Any) -> _States:
        """What properties of channel, else group, else file say, and from which sample on."""
        paths = "/", channel.path.rsplit("/", 1)[0], channel.path
        by_path: dict[str, _Properties] = {path: {} for path in paths}
        states: _States = [(0, {})]
        for rows, changed in self._changes:
            for path in (path for path in paths if path in changed):
                by_path[path] = by_path[path] | changed[path]
                row = rows.get(channel.path, 0)
                states = [state for state in states if state[0] < row]
                states.append((row, by_path[paths[0]] | by_path[paths[1]] | by_path[paths[2]]))
        return states

    def _time_channel(
        self, group: str, channels: Sequence[Any], waves: dict[str, _Waves]
    ) -> _Columns | None:
        """The time channel that holds instead of increments; these are taken out of `waves`.

        It does where it is stated, or where an increment is the default and the channel has
        another step. A duration, and a time that no rule reads, leave the increments as they are.
        Increments without a start begin where a channel of dates and times does.
        """
        stated_channel = self._options.time_channel
        has_stated_name = stated_channel in {c.name for c in channels}
        if not waves or (stated_channel and not has_stated_name):
            return None
        by_default = any(w[-1].increment == _DEFAULT_INCREMENT for w in waves.values())
        names = [c for c in channels if _may_be_time(c, by_default)]
        if not names and not has_stated_name:
            return None
        try:
            axis = self._by_columns(group, channels if has_stated_name else names)
        except UserError:
            if has_stated_name or by_default:
                raise
            return None
        t, _ = self._by_clock(axis)
        steps = np.diff(t) / 1e9
        step = float(np.median(steps)) if len(steps) else 0.0
        for name, wave in list(waves.items()):
            increment = wave[-1].increment
            differs = abs(step - increment) >= 0.01 * increment
            # a clock may drift; what jumps is a pause that the increments do not have
            jumps = np.abs(steps - np.diff(self._times(wave, len(t))[0]) / 1e9)
            longest = float(jumps.max(initial=0.0))
            if not has_stated_name and not differs and longest <= max(10.0 * increment, _PAUSE):
                if axis.clock.absolute and len(wave) == 1 and not wave[0].start and len(t):
                    start = int(t[0]) - round(wave[0].offset * 1e9)
                    waves[name] = (wave[0]._replace(start=start),)
                continue
            if not has_stated_name and (increment != _DEFAULT_INCREMENT or not differs):
                hint = f"channels.time.channel = {toml.value(axis.names[0])}"
                said = f"steps of {step:.4g} s" if differs else f"a pause of {longest:.4g} s"
                raise UserError(
                    f"{self._path}: channel {name!r} states wf_increment = {increment:g} s, "
                    f"but time channel {axis.names[0]!r} has {said}",
                    f"state the time channel, as {toml.option(hint)}, or correct wf_increment",
                )
            del waves[name]
        return None if len(waves) else axis

    def _by_columns(self, group: str, channels: Sequence[Any]) -> _Columns:
        """The time of a group that has time channels."""
        heads = {c.name: _cells(c[:HEAD]) for c in channels if c.dtype is not None}
        channel_units = tuple(_unit(c) for c in channels if c.name in heads)
        longest = max(map(len, heads.values()), default=0)
        columns = [fit(cells.to_pylist(), longest) for cells in heads.values()]
        rows = [list(row) for row in zip(*columns, strict=True)]
        names = tuple(heads)
        dialect = dialect_of(names, channel_units, rows, "channel's unit")
        clock = find_clock(dialect, self._options, max(map(len, channels)), self._path)
        axis = _Columns(group, clock, tuple(names[i] for i in clock.columns))
        if clock.may_be_digits:  # all times show it
            t, ok = self._numbers(axis)
            if from_digits(t[ok]) is not None:
                clock = clock.in_digits(axis.names[0], columns[clock.columns[0]][0])
                self._findings += [f for f in clock.findings if f not in self._findings]
        return axis._replace(clock=clock)

    def _start(self, axis: _Axis) -> int:
        """Where an axis begins since 1970 [ns]; 0 where it counts from an unknown start."""
        if not isinstance(axis, _Columns):
            return axis[0].start
        head, _ = self._by_clock(axis, 1)
        return int(head[0]) if axis.clock.absolute and len(head) else 0

    def _by_clock(self, axis: _Columns, rows: int | None = None) -> tuple[Times, Bools]:
        """Times of a group by its time channels [ns], and which of them hold; shape (n,)."""
        t, ok = self._numbers(axis, rows)
        if axis.clock.may_be_digits and (time_of_day := from_digits(t[ok])) is not None:
            t = np.zeros_like(t)
            t[ok] = time_of_day
        return t, ok

    def _numbers(self, axis: _Columns, rows: int | None = None) -> tuple[Times, Bools]:
        group = self._file[axis.group]
        return axis.clock.nanoseconds([_cells(group[name][:rows]) for name in axis.names])

    def _damage(self) -> str:
        """What is wrong at the end of the file, which the library passes over; "" for nothing."""
        segments = self._file._reader._segments
        end_row = segments[-1].next_segment_pos if segments else 0
        if self._file.file_status.incomplete_final_segment:
            return "the last segment is not complete"
        is_cut_off = end_row < self._path.stat().st_size
        return f"byte {end_row}: no segment begins there" if is_cut_off else ""

    def _reason(self, start: int) -> str:
        axes = dict.fromkeys(axis for _, axis in self._channels)
        by_columns = [axis.clock.reason for axis in axes if isinstance(axis, _Columns)]
        waves = "start and increment of each channel" + (" (UTC)" if start else "; no start stated")
        return "; ".join(dict.fromkeys([waves] * (len(by_columns) < len(axes)) + by_columns))

    def _named(self, pair: tuple[Any, _Axis]) -> NamedColumn:
        channel, axis = pair
        axes = list(dict.fromkeys((c.group_name, axis) for c, axis in self._channels))
        folder = f"{axes.index((channel.group_name, axis))} {channel.group_name}"
        return NamedColumn(channel.group_name, channel.name or "(no name)", _unit(channel), folder)

    def read(self, wanted: Sequence[int]) -> tuple[list[TableSamples], list[Finding]]:
        """See `tables.Reader`."""
        times: dict[Any, Times] = {}
        series, findings = [], []
        pairs = [*self._channels, *self._words]
        for channel, axis in (pairs[k] for k in wanted):
            labels = list[str]()
            is_text = _kind(channel) == "text"
            value = numbered(channel[:], labels) if is_text else np.asarray(channel[:], np.float64)
            t, ok = self._times(axis, len(value))
            n = min(len(value), len(t))
            if invalid := len(value) - int(np.count_nonzero(ok[:n])):
                findings.append(Finding("time-unreadable", "warning", channel.name, invalid))
            whole_t = times.setdefault((axis, n), t[:n][ok[:n]])
            series.append(TableSamples(whole_t, value[:n][ok[:n]], {}, tuple(labels)))
        return series, findings

    def _times(self, axis: _Axis, n: int) -> tuple[Times, Bools]:
        """Times [ns] of a channel of n samples, and which of them hold."""
        if isinstance(axis, _Columns):
            return self._by_clock(axis)
        pieces = []
        for wave, end_row in zip(axis, [*(w.row for w in axis[1:]), n], strict=True):
            rows = np.arange(wave.row, max(min(end_row, n), wave.row), dtype=np.float64)
            pieces.append(nanoseconds(wave.time(rows), wave.start))
        t, ok = map(np.concatenate, zip(*pieces, strict=True))
        return t, ok


_Changes = list[tuple[dict[str, int], dict[str, _Properties]]]


def _open_file(path: Path) -> tuple[Any, _Changes]:
    """The file, and for each segment its properties and the samples of each channel before it."""
    from nptdms import tdms

    changes: _Changes = []

    class Noting(tdms.TdmsReader):  # type: ignore[misc]
        def _read_segment_metadata(self, *arguments: Any) -> Any:
            segment, properties = super()._read_segment_metadata(*arguments)
            saying = {
                name: {k: value for k, value in pairs if _SAYING.match(k) or label(k) in _STEPS}
                for name, pairs in (properties or {}).items()
            }
            if any(saying.values()):
                rows = {name: x.num_values for name, x in self.object_metadata.items()}
                changes.append((rows, saying))
            return segment, properties

    original = tdms.TdmsReader
    tdms.TdmsReader = Noting  # this process reads one file at a time
    try:
        # As a file without a name: the library would trust an index file beside the log.
        return tdms.TdmsFile.open(path.open("rb"), raw_timestamps=True), changes
    finally:
        tdms.TdmsReader = original


def _waves(states: _States) -> _Waves:
    """Pieces of time that properties state; one that goes on to half a sample is none."""
    pieces: list[_Wave] = []
    for row, properties in states:
        wave = _wave(properties)
        if wave is None:
            continue
        wave = wave._replace(row=row if pieces else 0)
        if pieces and pieces[-1][:3] == wave[:3]:
            continue
        if pieces and pieces[-1].increment == wave.increment:
            piece = pieces[-1]
            time_shift = (wave.start - piece.start) / 1e9 + wave.offset - piece.time(row)
            if abs(time_shift) < wave.increment / 2.0:
                continue
        pieces.append(wave)
    return tuple(pieces)


def _wave(properties: _Properties) -> _Wave | None:
    """The time that these properties state, None where they state none."""
    unit = units.unit(_x_unit(properties))
    scale = unit.factor if unit else 1.0
    increment = scale * _number(properties.get("wf_increment")) or _interval(properties)
    if not 0.0 < increment < 1e6:
        return None
    offset = _number(properties.get("wf_start_offset"))
    start = properties.get("wf_start_time")
    ns = 0
    if start is not None and hasattr(start, "second_fractions"):
        ns = int(_stamps(np.array([start.seconds]), np.array([start.second_fractions]))[0])
    start_offset = offset if abs(offset) < 1e9 else 0.0
    return _Wave(ns if ns >= YEAR_1990 else 0, scale * start_offset, increment)


def _interval(properties: _Properties) -> float:
    """The time between two samples [s] that a property of any name states; 0 for none."""
    for name, value in properties.items():
        if step_s := interval_s(label(name), _number(value), [name]):
            return step_s
    return 0.0


def _number(value: Any) -> float:
    """The number that a property holds, also as a text; 0 for none."""
    return number_of(str(value)) or 0.0


def _x_unit(properties: _Properties) -> str:
    return str(properties.get("wf_xunit_string", "")).strip()


def _axis_problem(states: _States) -> str:
    """Why the x axis of a channel is no time, "" where it may be one."""
    increments: dict[tuple[int, float], float] = {}  # by the start that they belong to
    for _, properties in states:
        wave = _wave(properties)
        if wave and increments.setdefault(wave[:2], wave.increment) != wave.increment:
            return "wf_increment changes inside the file, and the start does not"
        text = _x_unit(properties)
        unit = units.unit(text)
        if text and _wave(properties) and not (unit and unit.dimension == "time"):
            return f"wf_xunit_string = {text!r} is no unit of time"
        name = str(properties.get("wf_xname", ""))
        if not text and _NO_TIME.search(name):
            return f"wf_xname = {name!r} is no time"
    return ""


def _scaling_problem(file: Any, group: Any, channel: Any, states: _States) -> str:
    """Why the numbers of a channel cannot be known, "" where nothing is wrong."""
    from nptdms.scaling import get_scaling

    scalings = [{k: x for k, x in state.items() if _SCALING.match(k)} for _, state in states]
    if any(other_scaling != scalings[0] for other_scaling in scalings[1:] if scalings[0]):
        return "its scaling or unit changes inside the file"
    last_scaling = scalings[-1]
    if last_scaling.get("NI_Scaling_Status", "unscaled") == "scaled":
        return ""
    types = [str(x) for k, x in last_scaling.items() if k.endswith("_Scale_Type")]
    has_raw_data = channel.data_type is None or "NI_Scaling_Status" in last_scaling
    try:
        is_known_scaling = get_scaling(*(x.properties for x in (channel, group, file))) is not None
        channel[:1]
    except Exception as error:  # whatever the library raises
        return f"scaling {', '.join(types)} lacks {error}"
    has_integers = channel.dtype.kind in "iu"
    if has_integers and not types and (problem := tables.open_scale(channel.properties)):
        return problem
    if is_known_scaling or not (types or (has_raw_data and has_integers)):
        return ""
    return f"scaling {', '.join(types) or 'of its raw numbers'} is not known"


def _stamps(seconds: Any, fractions: Any) -> Times:
    """Times since 1970 [ns] of LabVIEW's seconds since 1904 and 2⁻⁶⁴ fractions; shape (n,)."""
    nanoseconds = np.rint(np.asarray(fractions, np.float64) * (1e9 / 2.0**64)).astype(np.int64)
    return (np.asarray(seconds, np.int64) - _SINCE_1904) * 10**9 + nanoseconds


def _kind(channel: Any) -> str:
    """What the samples are: "number", "text", "time"; "" for anything else."""
    return _KINDS.get(channel.dtype.kind, "") if channel.dtype is not None else ""


def _may_be_time(channel: Any, by_default: bool) -> bool:
    """Whether a channel is a time instead of increments; `by_default` where one is the default.

    A stated increment stands against all but stamps, and names of a time, with values that rise. A
    default gives way to stamps or such a name alone, and to rising values in a unit of time.
    """
    is_number = _kind(channel) == "number"
    is_named = _kind(channel) == "time" or (is_number and time_name(channel.name) is not None)
    if is_named and by_default:
        return True
    if not is_named and not (by_default and is_number and time_unit(_unit(channel))):
        return False
    array = _array(channel[:])
    values = np.asarray(array.cast(pa.int64()) if pa.types.is_timestamp(array.type) else array)
    return len(values) > 1 and bool(np.all(np.diff(values[np.isfinite(values)]) > 0))


def _array(values: Any) -> Any:
    names = values.dtype.names or ()
    if "second_fractions" in names:
        stamps = _stamps(np.asarray(values["seconds"]), np.asarray(values["second_fractions"]))
        return pa.array(stamps, pa.timestamp("ns", "UTC"))
    return pa.array(np.asarray(values))


def _cells(values: Any) -> Any:
    """Values of a channel as the cells of a text log have them."""
    return printable(_array(values)).cast(pa.string())


def _unit(channel: Any) -> str:
    texts: Iterator[str] = (str(channel.properties.get(name, "")).strip() for name in _UNITS)
    return next((unit for unit in texts if unit), "")
