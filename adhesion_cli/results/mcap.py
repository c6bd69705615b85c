"""Results and logs as MCAP: protobuf messages, packed by columns, chunked, zstd, every CRC on.

The messages of a topic are laid out as rows of one numpy array, because one protobuf object per
sample costs more than the whole analysis. The protobuf library reads them as its own.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from .. import __version__
from ..channels.to_si import words_key
from ..core import masks, model, physics, rounding, threads, toml
from ..core.errors import UserError
from ..core.model import AxleResult, Column, Event, Floats, Log, Result, Samples, Times
from ..core.physics import LOCKED
from ..core.text import printable
from ..core.toml import Table
from ..rail import events
from ..rail.slope import REGIONS
from ..wsp.stop import Stop
from . import descriptors, log_events, mcap_container, names, thinning
from .mcap_container import Offsets

CHUNK = 4 << 20  # bytes of a chunk before compression, about
_LEVEL = 5  # of zstd; the indexes, which are not compressed, are larger than what more would save
_OPCODE = int(Opcode.MESSAGE)
_SECOND = 1_000_000_000
_BRAKE_SIGNALS: tuple[model.Meaning, ...] = (*model.STATES, "brake_pipe", "reservoir_pressure")
_VARINT = 5  # bytes of seconds since 1970, until the year 3058, and of nanoseconds
_MOST_CHANNELS = 0xFFFF  # channel ids have 16 bits
_UNITS = {  # of the doubles of a message, in the order of its schema
    "AxleInput": ("Pa", "N", "rad/s", "m/s"),
    "Reference": ("N", "N", "N", "N", "-"),
    "Estimate": ("N", "-", "N", "N"),
    "Truth": ("N", "-"),
    "Slip": ("-", "-", "-", "-"),
}

Bytes = NDArray[np.uint8]
_Values = Callable[[slice | NDArray[np.int64]], Floats]  # of these rows, or one for all


@dataclass(frozen=True, slots=True)
class _Stream:
    """One topic before packing: a column per double field, shape (n,)."""

    topic: str
    message: str
    t: Times
    columns: dict[str, _Values]  # by field
    units: dict[str, str]  # as the channel record states them
    tails: tuple[bytes, ...] = (b"",)  # encoded fields that follow the doubles
    tail: NDArray[np.int64] | None = None  # which of them, per row; None: the first
    rows: NDArray[np.int64] | None = None  # that are written, of columns and `tail`; None: all


def write_results(path: Path, results: Sequence[Result], metrics: str, slip: str = "") -> None:
    """Write analysed logs, read the file back and check it.

    Topics and metadata of several logs are parted by their names. A file of one log can be analysed
    again. `metrics` is the document that `--json` prints, kept as metadata `adhesion.metrics`, and
    `slip` that of `slip --json`, as `adhesion.slip`. What was computed on a long log is thinned.

    Raises:
        UserError: for a time stamp that MCAP cannot hold.
    """
    is_single = len(results) == 1
    logs = list(zip([""] if is_single else names.logs(results), results, strict=True))
    streams = [x for n, r in logs for x in _result_streams(r, f"/{n}" * bool(n))]
    shift = _shift(streams, [result.log for result in results])
    provenance: dict[str, str] = {}
    metadata = {"adhesion.slip": {"json": slip}} if slip else {}
    for name, result in logs:
        stem = f"{name}." * bool(name)
        provenance |= {stem + k: v for k, v in _provenance(result, shift).items()}
        metadata[names.SETTINGS + f"/{name}" * bool(name)] = names.flat(result.settings)
        metadata |= _account(result.log) if is_single else {}
    metadata |= {names.PROVENANCE: provenance, names.METRICS: {"json": metrics}}
    _write(path, streams, metadata, shift)


def write_log(path: Path, log: Log) -> None:
    """Write a log as one topic of `adhesion.Scalar` per channel, with its unit; raises as above."""
    pairs = zip(names.channels(log), log.channels, strict=True)
    streams = [_scalar(*name_and_unit, channel.data) for name_and_unit, channel in pairs]
    shift = _shift(streams, [log])
    origin = _origin(Path(log.path).name, log.sha256, log.format, shift)
    _write(path, streams, {names.PROVENANCE: origin, **_account(log)}, shift)


def write_stop(  # noqa: PLR0913 (all that a stop's file holds)
    path: Path,
    name: str,
    stop: Stop,
    vehicle: model.Vehicle,
    settings: Table,
    metrics: str,
    sources: Sequence[str],
) -> None:
    """Write one stop in closed loop as a result: a log of what the unit measured, with the truth.

    `settings` has all that the stop was made from; whoever reads the file as a log takes them.
    `metrics` is the document that `--json` prints, kept as metadata `adhesion.metrics`.
    """
    axles = range(stop.pressure.shape[1])
    flat_settings = names.flat(settings)
    digest = sha256(repr(flat_settings).encode()).hexdigest()
    metadata = {
        names.SETTINGS: flat_settings,
        names.PROVENANCE: {
            **_origin(f"{name}, controller {stop.controller}", digest, "closed loop", 0),
            "sources": "\n".join(sources),
        },
        names.METRICS: {"json": metrics},
    }
    streams = [
        _computed("/distance", "m", stop.t, stop.distance),
        _computed("/demand", "Pa", stop.t, stop.demand),
        *(x for i in axles for x in _stop_streams(stop, i, vehicle)),
        *_events((x for i in axles for x in _stop_events(stop, i)), ""),
    ]
    _write(path, streams, metadata, 0)


class GrowingResult:
    """A result that grows with its log. What `add` wrote can be read, even after a kill.

    `nothing` has `Samples` of no row for each axle, with the estimators that will come.
    """

    def __init__(
        self,
        file: BinaryIO,
        log: str,
        settings: Table,
        vehicle: model.Vehicle,
        nothing: Mapping[int, Samples],
    ) -> None:
        self._file, self._log, self._vehicle, self._nothing = file, log, vehicle, dict(nothing)
        self._shift: int | None = None  # as of `_shift`; the first samples decide
        self.lost = 0  # samples that were left out, because MCAP has no time for them
        streams = self._streams({})
        self._schemas, self._defined = _schemas(streams), len(streams)
        self._container = _begun(file, streams, {names.SETTINGS: names.flat(settings)})
        file.flush()

    def add(self, samples: Mapping[int, Samples]) -> None:
        """Writes the new samples of some axles, which may be new, as one chunk; raises OSError."""
        if not any(len(x.t) for x in samples.values()):
            return
        if self._shift is None:
            self._begin(_whole_seconds(min(int(x.t.min()) for x in samples.values() if len(x.t))))
        assert self._shift is not None
        selection = {}
        for axle, x in samples.items():
            inside = x.t >= -self._shift
            self.lost += len(x.t) - int(inside.sum())
            selection[axle] = x if inside.all() else x.rows(inside)
        self._define(selection)
        streams = self._streams(selection)
        slices = [slice(0, len(s.t)) for s in streams]
        if any(p.stop for p in slices):
            self._container.chunk(_packed(streams, slices, self._shift))
        self._file.flush()

    def finish(self) -> None:
        """Writes the end of the file."""
        if self._shift is None:
            self._begin(0)
        self._container.finish()
        self._file.flush()

    def _begin(self, shift: int) -> None:
        """Says what is added to each stamp [ns], before the first one."""
        self._shift = shift
        origin = {**_origin(self._log, "", "live", shift), "sources": ""}
        self._container.metadata(names.PROVENANCE, origin)

    def _define(self, samples: Mapping[int, Samples]) -> None:
        if not samples.keys() - self._nothing.keys():
            return
        self._nothing |= {n: x.rows(slice(0)) for n, x in samples.items() if n not in self._nothing}
        streams = self._streams({})
        self._container.define([], _channels(streams, self._schemas)[self._defined :])
        self._defined = len(streams)

    def _streams(self, samples: Mapping[int, Samples]) -> list[_Stream]:
        """Every topic, in the same order each time."""
        streams = []
        for axle, nothing in self._nothing.items():
            x, topic = samples.get(axle, nothing), f"/axle/{axle}"
            inputs = x.pressure, x.clamping, x.wheel_speed, x.train_speed
            streams.append(_stream(f"{topic}/input", "AxleInput", x.t, *inputs))
            for algo, (force, sigma, _) in x.estimates.items():
                columns = force, physics.coefficient(force, self._vehicle, axle), None, sigma
                streams.append(_stream(f"{topic}/estimate/{algo}", "Estimate", x.t, *columns))
            streams.append(_stream(f"{topic}/slip", "Slip", x.t, x.slip, None, None, None))
        return streams


# ---- what goes into the file


def _scalar(topic: str, unit: str, data: Column) -> _Stream:
    """A channel at its own stamps, one message per sample that has a value."""
    tail = descriptors.message("Scalar")(unit=unit).SerializeToString()
    t, value = data.t, data.value
    if not data.valid.all():
        t, value = t[data.valid], value[data.valid]
    return _Stream(topic, "Scalar", t, {"value": value.__getitem__}, {"unit": unit}, (tail,))


def _computed(topic: str, unit: str, t: Times, values: Floats) -> _Stream:
    return _scalar(topic, unit, Column(t, values, np.isfinite(values)))


def _stream(topic: str, message: str, t: Times, *columns: Floats | _Values | None) -> _Stream:
    """The doubles of a message, in the order of its schema; NaN for none, as absent reads as 0."""
    _, *fields = descriptors.numbers(message)
    units = {f"unit.{name}": unit for name, unit in zip(fields, _UNITS[message], strict=False)}
    return _Stream(topic, message, t, dict(zip(fields, map(_finite, columns), strict=False)), units)


def _finite(values: Floats | _Values | None) -> _Values:
    if values is None:
        return lambda _: np.array(np.nan)
    return values if callable(values) else values.__getitem__


def _digits(values: Floats | None) -> _Values | None:
    return None if values is None else lambda piece: rounding.digits(values[piece])


def _slip(
    topic: str, t: Times, columns: Sequence[Floats | _Values | None], region: model.Regions | None
) -> _Stream:
    """Slip, coefficient, slope and its confidence, and the region where it is known."""
    doubles, message = _stream(f"{topic}/slip", "Slip", t, *columns), descriptors.message("Slip")
    if region is None:
        return doubles
    tails = tuple(message(region=name).SerializeToString() for name in REGIONS)
    return replace(doubles, tails=tails, tail=region.astype(np.int64))


def _result_streams(result: Result, prefix: str) -> list[_Stream]:
    streams: list[_Stream] = []
    for axle in result.axles:
        topic = f"{prefix}/axle/{axle.record.axle}"
        streams += _input_streams(axle.record, result.log, topic)
        computed = _computed_streams(axle, result, topic)
        if (rows := thinning.kept_rows(axle)) is not None:
            t = axle.record.t[rows]  # one array for all: `_partition` knows it by that
            computed = (replace(x, t=t, rows=rows) for x in computed)
        streams += computed
    train = result.shared_train()
    if train and not result.inputs_hold(train):
        # As logged: the axles' input has it interpolated, and shifted where it was late.
        name = "train_acceleration" if train.is_rate else "train_speed"
        unit = names.SI["train_speed"] + "/s" * train.is_rate
        streams.append(_scalar(f"{prefix}/{name}", unit, train.data))
    for meaning in model.PLACES:
        if channel := result.log.find(meaning, 0):
            streams.append(_scalar(f"{prefix}/{meaning}", names.SI[meaning], channel.data))
    for c in (c for c in result.log.channels if c.meaning in model.OTHER_BRAKES):
        streams.append(_scalar(f"{prefix}/{c.meaning}", "", c.data))
    streams += _brake_signals(result.log, prefix).values()
    return [*streams, *_events(log_events.of_result(result), prefix)]


def _brake_signals(log: Log, prefix: str) -> dict[str, _Stream]:
    """Commands, valves, pipe and reservoir, by topic: stops are judged by them."""
    streams: dict[str, _Stream] = {}
    for c in log.channels:
        if c.meaning and c.meaning in _BRAKE_SIGNALS and len(c.data.t):
            place = "" if c.axle is None else f"/axle/{c.axle}"
            topic, unit = f"{prefix}{place}/{c.meaning}", names.SI.get(c.meaning, "")
            streams.setdefault(topic, _scalar(topic, unit, c.data))
    return streams


def _input_streams(record: model.AxleRecord, log: Log, topic: str) -> Iterator[_Stream]:
    """What was measured, and the truth, exactly: the log can be analysed again."""
    t, w = record.t, record.wheel_speed
    K = record.clamping_force if record.pressure is not None else record.friction_clamping
    for meaning in model.MOTOR_FORCES:
        if force := log.find(meaning, record.axle):
            yield _scalar(f"{topic}/{meaning}", names.SI[meaning], force.data)
    yield _stream(f"{topic}/input", "AxleInput", t, record.pressure, K, w, record.train_speed)
    brake = log.find("pressure", record.axle) or log.find("clamping_force", record.axle)
    if brake and brake.meaning and not np.isin(t, brake.data.t).all():
        # Between its own stamps the reference interpolates: held values alone would not do again.
        yield _scalar(f"{topic}/{brake.meaning}", names.SI[brake.meaning], brake.data)
    yield from _whole_speed(record, topic)
    if record.truth is not None or record.true_slip is not None:
        yield _stream(f"{topic}/truth", "Truth", t, record.truth, record.true_slip)


def _whole_speed(record: model.AxleRecord, topic: str) -> Iterator[_Stream]:
    """The wheel speed with the times at which no brake is known: stops need them."""
    alone = record.speeds_alone
    if alone is None or (np.diff(record.t) <= 0).any():
        return
    t, speed = np.append(record.t, alone.t), np.append(record.wheel_speed, alone.wheel_speed)
    order = np.argsort(t, kind="stable")
    column = model.Column(t[order], speed[order], np.isfinite(speed[order]))
    yield _scalar(f"{topic}/wheel_speed", names.SI["wheel_speed"], column)


def _computed_streams(axle: AxleResult, result: Result, topic: str) -> Iterator[_Stream]:
    t, ref = axle.record.t, axle.reference

    def rounded(of_rows: _Values, sigma: Floats = ref.sigma) -> _Values:
        return lambda piece: rounding.rounded(of_rows(piece), sigma[piece])

    def mu(force: Floats, sigma: Floats = ref.sigma) -> _Values:
        def coefficient(x: Floats) -> Floats:
            return physics.coefficient(x, result.vehicle, axle.record.axle)

        return lambda piece: rounding.rounded(coefficient(force[piece]), coefficient(sigma[piece]))

    # Both edges of the band of every axle at once would be large.
    lower, upper = rounded(lambda x: ref.rows(x).lower), rounded(lambda x: ref.rows(x).upper)
    columns = rounded(ref.force.__getitem__), _digits(ref.sigma), lower, upper, mu(ref.force)
    yield _stream(f"{topic}/reference", "Reference", t, *columns)
    for algo, force in sorted(axle.estimates.items()):
        sigma, error = axle.sigma(algo), rounded(partial(axle.error, algo))
        F, sigma_stated = rounded(force.__getitem__, sigma), _digits(axle.sigmas.get(algo))
        estimate = F, mu(force, sigma), error, sigma_stated
        yield _stream(f"{topic}/estimate/{algo}", "Estimate", t, *estimate)
    if axle.slip is not None:
        slip = rounded(axle.slip.__getitem__, np.broadcast_to(rounding.SLIP, len(t)))
        slope, confidence = _digits(axle.slope), _digits(axle.slope_confidence)
        yield _slip(topic, t, (slip, mu(ref.force), slope, confidence), axle.region)


def _stop_streams(stop: Stop, i: int, vehicle: model.Vehicle) -> Iterator[_Stream]:
    """One axle of a stop, counted from 0: what was measured, what was true, what it did."""
    topic, t, F = f"/axle/{i + 1}", stop.t, stop.estimate[:, i]
    true_force, mu = stop.force[:, i], physics.coefficient(F, vehicle, i + 1)
    pressure, K = stop.measured_pressure[:, i], stop.measured_clamping_force[:, i]
    speeds = stop.measured_wheel_speed[:, i], stop.measured_train_speed
    yield _stream(f"{topic}/input", "AxleInput", t, pressure, K, *speeds)
    yield _stream(f"{topic}/estimate/{stop.algo}", "Estimate", t, F, mu, F - true_force, None)
    yield _stream(f"{topic}/truth", "Truth", t, true_force, stop.slip[:, i])
    columns = (stop.measured_slip[:, i], mu, stop.slope[:, i], stop.confidence[:, i])
    yield _slip(topic, t, columns, stop.region[:, i])
    yield _computed(f"{topic}/valve", "-", t, stop.valve[:, i].astype(np.float64))
    yield _computed(f"{topic}/judged_slip", "-", t, stop.judged_slip[:, i])
    yield _computed(f"{topic}/peak/force", "N", t, stop.peak[:, i])
    yield _computed(f"{topic}/peak/slip", "-", t, stop.peak_slip[:, i])


def _stop_events(stop: Stop, i: int) -> Iterator[Event]:
    """What truly happened to an axle of a stop, counted from 0, and the regions judged."""
    all_rows, s, wheel = slice(0, len(stop.t)), stop.slip[:, i], stop.sliding()[:, i]
    slides = events.slides([all_rows], stop.t, stop.train_speed, s, s, stop.force[:, i], False)
    yield from events.axle_events(i + 1, slides, [all_rows], stop.t, stop.region[:, i])
    for lock_start, lock_stop in masks.true_runs(wheel == LOCKED):
        begin, stop_time = stop.t[[lock_start, min(lock_stop, len(stop.t) - 1)]].tolist()
        text = f"axle {i + 1}: locked for {(stop_time - begin) / 1e9:.2f} s"
        yield Event(begin, "wheel-locked", text, axle=i + 1)


def _events(events: Iterable[Event], prefix: str) -> list[_Stream]:
    ordered, event = sorted(events, key=lambda e: e.t), descriptors.message("Event")
    if not ordered:
        return []
    tails = tuple(
        event(code=x.code, severity=x.severity, axle=x.axle, message=x.message).SerializeToString()
        for x in ordered
    )
    t = np.array([x.t for x in ordered], np.int64)
    return [_Stream(f"{prefix}/events", "Event", t, {}, {}, tails, np.arange(len(t)))]


def _origin(name: str, digest: str, kind: str, shift: int) -> dict[str, str]:
    origin = {"version": __version__, "input": printable(name)}
    origin |= {"input_sha256": digest, "input_format": kind}
    return {**origin, "time_shift_ns": str(shift)} if shift else origin


def _account(log: Log) -> dict[str, dict[str, str]]:
    """What the log had lost: fresh CRCs would let all of it look sound."""
    return {model.RECOVERED: {"damage": log.account}} if log.account else {}


def _provenance(result: Result, shift: int) -> dict[str, str]:
    entries = {
        **_origin(Path(result.log.path).name, result.log.sha256, result.log.format, shift),
        "start_ns": str(result.log.start_ns()),  # of the log: what is written may begin later
        "sources": "\n".join(result.sources),
    }
    for axle in (a.record.axle for a in result.axles):
        if speed := result.log.find("wheel_speed", axle):
            entries[f"wheel_speed_{axle}"] = speed.measured_in
        for meaning in model.MOTOR_FORCES:
            if force := result.log.find(meaning, axle):
                entries[f"{meaning}_tolerance"] = f"{force.tolerance:g}"
    for channel in result.log.channels:
        if channel.meaning and channel.levels:
            words = (word.replace("\n", " ") for word in channel.levels)
            entries[words_key(channel.meaning, channel.axle)] = "\n".join(words)
    if any(a.record.train_speed_made for a in result.axles):
        entries["train_speed"] = model.NOT_MEASURED
    elif (train := result.shared_train()) and result.inputs_hold(train):
        entries["train_speed"] = model.AS_INPUT
    if any(map(thinning.needs_thinning, result.axles)):
        entries["thinned"] = thinning.THINNED_NOTE
    return entries


def _shift(streams: Sequence[_Stream], logs: Sequence[Log]) -> int:
    """What makes each stamp one that MCAP can hold [ns], whole seconds; provenance says so."""
    earliest = min((int(s.t.min()) for s in streams if len(s.t)), default=0)
    if earliest < 0 and all(log.absolute for log in logs):
        option = toml.option('channels.time = {channel = "NAME", unit = "s"}')
        text = f"{printable(logs[0].path)}: has time stamps before 1970, which MCAP cannot hold"
        raise UserError(text, f"check the time channel and its unit; state them, as {option}")
    return _whole_seconds(earliest)


def _whole_seconds(earliest: int) -> int:
    """Least whole seconds that make a stamp one that MCAP can hold [ns]."""
    return max(0, -(earliest // _SECOND) * _SECOND)


# ---- how it goes into the file


def _write(
    path: Path, streams: Sequence[_Stream], metadata: dict[str, dict[str, str]], shift: int
) -> None:
    if len(streams) > _MOST_CHANNELS:
        text = f"{len(streams)} channels to write, an MCAP file holds {_MOST_CHANNELS}"
        raise UserError(text, "choose channels in [channels] of the TOML")
    with path.open("wb") as file:
        container = _begun(file, streams, metadata)
        for chunk in threads.run_ahead(lambda p: _packed(streams, p, shift), _partition(streams)):
            container.chunk(chunk)
        container.finish()


def _begun(
    file: BinaryIO, streams: Sequence[_Stream], metadata: dict[str, dict[str, str]]
) -> mcap_container.Container:
    """A file with all but its messages; channels count from 1, in the order of the streams."""
    messages = _schemas(streams)
    schemas = [
        Schema(i, descriptors.schema(m), "protobuf", f"adhesion.{m}")
        for i, m in enumerate(messages, 1)
    ]
    container = mcap_container.Container(file, f"adhesion-cli {__version__}")
    for name, entries in metadata.items():
        container.metadata(name, entries)
    container.define(schemas, _channels(streams, messages))
    return container


def _schemas(streams: Sequence[_Stream]) -> list[str]:
    return sorted({s.message for s in streams})


def _channels(streams: Sequence[_Stream], messages: Sequence[str]) -> list[Channel]:
    return [
        Channel(i, s.topic, "protobuf", s.units, messages.index(s.message) + 1)
        for i, s in enumerate(streams, 1)
    ]


def _partition(streams: Sequence[_Stream]) -> Iterator[list[slice]]:
    """Cut the streams into chunks of about `CHUNK` bytes: the rows of each that go together.

    Rows keep their order within a stream. Across streams they go by the latest time seen so far,
    so that a chunk covers a span of time even where a clock jumps back.
    """
    if not any(len(s.t) for s in streams):
        return
    axes = {id(s.t): s.t for s in streams}  # topics of one axle share theirs
    clocks = {  # a copy only where one jumps back
        axis: t if (t[1:] >= t[:-1]).all() else np.maximum.accumulate(t) for axis, t in axes.items()
    }
    total = sum(len(s.t) * _layout(len(s.columns), len(s.tails[0])).itemsize for s in streams)
    pieces = -(-total // CHUNK)
    sample_step = max(64, total >> 24)  # one in so many: a sample of bounded size
    sample = np.sort(np.concatenate([clocks[id(s.t)][::sample_step] for s in streams]))
    edges = sample[len(sample) * np.arange(1, pieces) // pieces]
    cuts = {
        axis: np.concatenate([[0], np.searchsorted(clock, edges), [len(clock)]])
        for axis, clock in clocks.items()
    }
    for k in range(pieces):
        slices = [slice(int(cuts[id(s.t)][k]), int(cuts[id(s.t)][k + 1])) for s in streams]
        if any(p.stop > p.start for p in slices):
            yield slices


def _packed(streams: Sequence[_Stream], slices: list[slice], shift: int) -> mcap_container.Packed:
    rows = [
        _Rows(i, s, piece, shift)
        for i, (s, piece) in enumerate(zip(streams, slices, strict=True), 1)
        if piece.stop > piece.start
    ]
    order = np.argsort(np.concatenate([np.maximum.accumulate(r.t) for r in rows]), kind="stable")
    sizes = np.concatenate([r.sizes for r in rows])
    row_ends = np.cumsum(sizes[order])
    row_starts = np.empty_like(row_ends)
    row_starts[order] = row_ends - sizes[order]

    buffer = np.zeros(int(row_ends[-1]), np.uint8)
    index = {}
    begin = 0
    for r in rows:
        offsets = row_starts[begin : begin + len(r.t)]
        begin += len(r.t)
        r.write(buffer, offsets)
        index[r.channel] = np.stack([r.t, offsets], axis=1)
    return mcap_container.packed(buffer.tobytes(), index, _LEVEL)


class _Rows:
    """The messages of one stream in one chunk: how long each is, then their bytes."""

    def __init__(self, channel: int, stream: _Stream, piece: slice, shift: int) -> None:
        self.channel, self.first = channel, piece.start
        self.t = stream.t[piece] + shift
        rows = piece if stream.rows is None else stream.rows[piece]
        number = descriptors.numbers(stream.message)
        self._tags = [number[name] << 3 | 1 for name in stream.columns]
        self._columns = np.empty((len(self._tags), len(self.t)))
        for column, values in zip(self._columns, stream.columns.values(), strict=True):
            column[:] = values(rows)
        self._tails = stream.tails
        self._tail = np.zeros(len(self.t), np.int64) if stream.tail is None else stream.tail[rows]
        layouts = [_layout(len(self._tags), len(tail)) for tail in stream.tails]
        self.sizes: Offsets = np.array([x.itemsize for x in layouts], np.int64)[self._tail]

    def write(self, buffer: Bytes, offsets: Offsets) -> None:
        """Fill in the message records that start at `offsets`, shape (n,)."""
        for k in np.unique(self._tail):
            rows = np.flatnonzero(self._tail == k)
            messages = self._messages(rows, self._tails[k])
            buffer[offsets[rows, None] + np.arange(messages.shape[1])] = messages

    def _messages(self, rows: NDArray[np.int64], tail: bytes) -> Bytes:
        """The message records of these rows, which have one tail; shape (rows, bytes of one)."""
        layout, t = _layout(len(self._tags), len(tail)), self.t[rows]
        messages = np.empty(len(rows), layout)
        messages["opcode"], messages["length"] = _OPCODE, layout.itemsize - 9
        messages["channel"], messages["sequence"] = self.channel, self.first + rows
        messages["log_time"] = messages["publish_time"] = t
        messages["stamp"] = 1 << 3 | 2, 2 * (1 + _VARINT)  # field 1, google.protobuf.Timestamp
        for name, tag, value in (("seconds", 1, t // _SECOND), ("nanos", 2, t % _SECOND)):
            messages[f"{name}_tag"], messages[name] = tag << 3, _varints(value)
        for i, (tag, column) in enumerate(zip(self._tags, self._columns, strict=True)):
            messages[f"tag_{i}"], messages[f"value_{i}"] = tag, column[rows]
        messages["tail"] = np.frombuffer(tail, np.uint8)
        return messages.view(np.uint8).reshape(len(rows), layout.itemsize)


@cache
def _layout(doubles: int, tail: int) -> np.dtype[np.void]:
    """The bytes of a message record with so many doubles and so long a tail, and a stamp."""
    return np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("stamp", "u1", (2,)),
            ("seconds_tag", "u1"),
            ("seconds", "u1", (_VARINT,)),
            ("nanos_tag", "u1"),
            ("nanos", "u1", (_VARINT,)),
            *(x for i in range(doubles) for x in ((f"tag_{i}", "u1"), (f"value_{i}", "<f8"))),
            ("tail", "u1", (tail,)),
        ]
    )


def _varints(values: NDArray[np.int64]) -> Bytes:
    """Protobuf's variable-length numbers, all of `_VARINT` bytes; shape (n, bytes)."""
    septets = (values[:, None] >> 7 * np.arange(_VARINT)) & 0x7F
    septets[:, :-1] |= 0x80  # more bytes follow
    return septets.astype(np.uint8)
