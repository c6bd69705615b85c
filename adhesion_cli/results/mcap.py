"""Results and logs as MCAP: protobuf messages, packed by columns, chunked, zstd, every CRC on.

The messages are laid out by numpy, because one protobuf object per sample costs more than the whole
analysis. The bytes of a message are those the protobuf library would have written.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from .. import __version__
from ..core import physics, signals
from ..core.errors import UserError
from ..core.model import (
    MADE,
    RECOVERED,
    AxleResult,
    Column,
    Event,
    Floats,
    Log,
    Result,
    Times,
    Vehicle,
)
from ..core.stop import LOCKED, Stop
from ..core.text import printable
from ..rail import events
from ..rail.slope import REGIONS
from . import descriptors, mcap_container, names
from .mcap_container import Offsets

CHUNK = 4 << 20  # bytes of a chunk before compression, about
_MESSAGE = 9 + 22  # bytes of a message record before its data: opcode, length, header
_SECOND = 1_000_000_000
_MOST_CHANNELS = 0xFFFF  # channel ids have 16 bits

Bytes = NDArray[np.uint8]
_Values = Callable[[slice], Floats]  # the values of these rows: most are computed chunk by chunk


@dataclass(frozen=True, slots=True)
class _Stream:
    """One topic before packing: a column per double field, shape (n,).

    What is not known is written as NaN: an absent field reads as 0 in most programs, a force of
    nothing with certainty.
    """

    topic: str
    message: str
    t: Times
    columns: dict[str, tuple[str, _Values]]  # field: (unit, values)
    tails: tuple[bytes, ...] = (b"",)  # encoded fields that follow the doubles
    tail: NDArray[np.int64] | None = None  # which of them, per row; None: the first
    unit: str | None = None  # of the whole topic

    def metadata(self) -> dict[str, str]:
        """Units, as the channel record states them."""
        if self.unit is not None:
            return {"unit": self.unit}
        return {f"unit.{name}": unit for name, (unit, _) in self.columns.items()}


def write_result(
    path: Path, result: Result, metrics_json: str | bytes, slip_json: str | None = None
) -> None:
    """Write one analysed log, read it back and check it.

    Args:
        path: file to write; its old content is lost.
        result: the analysed log.
        metrics_json: the document that `--json` prints, kept as metadata `adhesion.metrics`.
        slip_json: what `slip --json` prints of the log, kept as metadata `adhesion.slip`.

    Raises:
        UserError: a time stamp that MCAP cannot hold, or a file that does not read back.
        OSError: the file cannot be written.
    """
    shift = _shift([result.log])
    metadata = {
        names.SETTINGS: names.flat(result.settings),
        "adhesion.provenance": _provenance(result, shift),
        "adhesion.metrics": {"json": _text(metrics_json)},
        **_account(result.log),
    }
    if slip_json is not None:
        metadata["adhesion.slip"] = {"json": _text(slip_json)}
    _write(path, _result_streams(result, ""), metadata, shift)


def write_comparison(path: Path, results: Sequence[Result], metrics_json: str | bytes) -> None:
    """Write several analysed logs into one file, topics and metadata parted by the log's name.

    Args:
        path: file to write; its old content is lost.
        results: the analysed logs.
        metrics_json: the document that `--json` prints, kept as metadata `adhesion.metrics`.

    Raises:
        UserError: a time stamp that MCAP cannot hold, or a file that does not read back.
        OSError: the file cannot be written.
    """
    shift = _shift([r.log for r in results])
    streams: list[_Stream] = []
    settings: dict[str, dict[str, str]] = {}
    provenance: dict[str, str] = {}
    for name, result in zip(names.logs(results), results, strict=True):
        streams += _result_streams(result, f"/{name}")
        # A file of one log can be analysed again, one of several cannot.
        key = f"{names.SETTINGS}/{name}" if len(results) > 1 else names.SETTINGS
        settings[key] = names.flat(result.settings)
        settings |= _account(result.log) if len(results) == 1 else {}
        provenance |= {f"{name}.{k}": v for k, v in _provenance(result, shift).items()}
    _write(
        path,
        streams,
        {
            **settings,
            "adhesion.provenance": provenance,
            "adhesion.metrics": {"json": _text(metrics_json)},
        },
        shift,
    )


def write_log(path: Path, log: Log) -> None:
    """Write a log as one topic of `adhesion.Scalar` per channel, each with its unit.

    Args:
        path: file to write; its old content is lost.
        log: channels with a meaning are in SI, others in the unit they state.

    Raises:
        UserError: a time stamp that MCAP cannot hold, or a file that does not read back.
        OSError: the file cannot be written.
    """
    streams = [
        _scalar(name, unit, channel.data)
        for (name, unit), channel in zip(names.channels(log), log.channels, strict=True)
    ]
    shift = _shift([log])
    _write(path, streams, {"adhesion.provenance": _origin(log, shift), **_account(log)}, shift)


def write_stop(  # noqa: PLR0913 (all that a stop's file holds)
    path: Path, name: str, stop: Stop, vehicle: Vehicle, settings: dict[str, Any], metrics: str,
    sources: Sequence[str],
) -> None:  # fmt: skip
    """Write one stop in closed loop as a result: a log of what the unit measured, with the truth.

    Args:
        path: file to write; its old content is lost.
        name: of the scenario.
        stop: the stop.
        vehicle: that was stopped.
        settings: as of a result, with all that the stop was made from; whoever reads the file as
            a log takes them.
        metrics: the document that `--json` prints, kept as metadata `adhesion.metrics`.
        sources: literature of the methods in the loop.

    Raises:
        UserError: a file that does not read back.
        OSError: the file cannot be written.
    """
    streams = [
        _scalar("/distance", "m", Column(stop.t, stop.distance, np.isfinite(stop.distance))),
        _scalar("/demand", "Pa", Column(stop.t, stop.demand, np.isfinite(stop.demand))),
    ]
    for i in range(stop.pressure.shape[1]):
        streams += _stop_streams(stop, i, vehicle)
    streams += _told([x for i in range(stop.pressure.shape[1]) for x in _stop_events(stop, i)], "")
    stated = names.flat(settings)
    provenance = {
        "version": __version__,
        "input": printable(f"{name}, controller {stop.controller}"),
        "input_sha256": sha256(repr(stated).encode()).hexdigest(),
        "input_format": "closed loop",
        "sources": "\n".join(sources),
    }
    _write(
        path,
        streams,
        {
            names.SETTINGS: stated,
            "adhesion.provenance": provenance,
            "adhesion.metrics": {"json": metrics},
        },
        0,
    )


# ---- what goes into the file


def _scalar(topic: str, unit: str, data: Column) -> _Stream:
    """A channel at its own stamps, one message per sample that has a value."""
    tail = descriptors.message("Scalar")(unit=unit).SerializeToString()
    t, value = data.t, data.value
    if not data.valid.all():
        t, value = t[data.valid], value[data.valid]
    return _Stream(topic, "Scalar", t, {"value": (unit, value.__getitem__)}, (tail,), unit=unit)


def _known(values: Floats | _Values | None) -> _Values:
    if values is None:
        return lambda part: np.full(part.stop - part.start, np.nan)
    return values if callable(values) else values.__getitem__


def _result_streams(result: Result, prefix: str) -> list[_Stream]:
    streams: list[_Stream] = []
    for axle in result.axles:
        streams += _axle_streams(axle, result, f"{prefix}/axle/{axle.record.axle}")
    first, *others = (result.log.find("train_speed", a.record.axle) for a in result.axles)
    if first and all(other is first for other in others):
        # As logged: the axles' input has it interpolated, and shifted where it was late.
        name = "train_acceleration" if first.is_rate else "train_speed"
        unit = names.SI["train_speed"] + "/s" * first.is_rate
        streams.append(_scalar(f"{prefix}/{name}", unit, first.data))
    return [*streams, *_events(result, prefix)]


def _axle_streams(axle: AxleResult, result: Result, topic: str) -> Iterator[_Stream]:
    record, reference = axle.record, axle.reference

    def stream(name: str, message: str, **columns: tuple[str, Floats | _Values | None]) -> _Stream:
        filled = {f: (unit, _known(v)) for f, (unit, v) in columns.items()}
        return _Stream(f"{topic}/{name}", message, record.t, filled)

    def mu(force: Floats) -> _Values:
        return lambda part: physics.coefficient(force[part], result.vehicle)

    yield stream(
        "input", "AxleInput",
        brake_cylinder_pressure=("Pa", record.pressure),
        clamping_force=("N", record.clamping_force),
        wheel_speed=("rad/s", record.wheel_speed),
        train_speed=("m/s", record.train_speed),
    )  # fmt: skip
    brake = result.log.find("pressure", record.axle) or result.log.find(
        "clamping_force", record.axle
    )
    if brake and brake.meaning and not np.isin(record.t, brake.data.t).all():
        # Between its own stamps the reference interpolates: held values alone would not do again.
        yield _scalar(f"{topic}/{brake.meaning}", names.SI[brake.meaning], brake.data)
    yield stream(
        "reference", "Reference",
        force=("N", reference.force),
        sigma=("N", reference.sigma),
        lower=("N", reference.lower),
        upper=("N", reference.upper),
        coefficient=("-", mu(reference.force)),
    )  # fmt: skip
    for algo, force in sorted(axle.estimates.items()):
        yield stream(
            f"estimate/{algo}", "Estimate",
            force=("N", force), coefficient=("-", mu(force)),
            error=("N", partial(axle.error, algo)),
        )  # fmt: skip
    if record.truth is not None or record.true_slip is not None:
        yield stream("truth", "Truth", force=("N", record.truth), slip=("-", record.true_slip))
    if axle.slip is not None:
        slip = stream(
            "slip", "Slip",
            slip=("-", axle.slip),
            coefficient=("-", mu(reference.force)),
            slope=("-", axle.slope),
            slope_confidence=("-", axle.slope_confidence),
        )  # fmt: skip
        if axle.region is not None:
            message = descriptors.message("Slip")
            regions = tuple(message(region=name).SerializeToString() for name in REGIONS)
            slip = replace(slip, tails=regions, tail=axle.region.astype(np.int64))
        yield slip


def _stop_streams(stop: Stop, i: int, vehicle: Vehicle) -> Iterator[_Stream]:
    """One axle of a stop, counted from 0: what was measured, what was true, what it did."""
    topic, slip = f"/axle/{i + 1}", descriptors.message("Slip")

    def stream(name: str, message: str, **columns: tuple[str, Floats]) -> _Stream:
        filled = {f: (unit, _known(v)) for f, (unit, v) in columns.items()}
        return _Stream(f"{topic}/{name}", message, stop.t, filled)

    F = stop.estimate[:, i]
    yield stream(
        "input", "AxleInput",
        brake_cylinder_pressure=("Pa", stop.measured_pressure[:, i]),
        clamping_force=("N", stop.measured_clamping_force[:, i]),
        wheel_speed=("rad/s", stop.measured_wheel_speed[:, i]),
        train_speed=("m/s", stop.measured_train_speed),
    )  # fmt: skip
    yield stream(
        f"estimate/{stop.algo}", "Estimate",
        force=("N", F), coefficient=("-", physics.coefficient(F, vehicle)),
        error=("N", F - stop.force[:, i]),
    )  # fmt: skip
    yield stream("truth", "Truth", force=("N", stop.force[:, i]), slip=("-", stop.slip[:, i]))
    yield replace(
        stream(
            "slip", "Slip",
            slip=("-", stop.measured_slip[:, i]),
            coefficient=("-", physics.coefficient(F, vehicle)),
            slope=("-", stop.slope[:, i]), slope_confidence=("-", stop.confidence[:, i]),
        ),
        tails=tuple(slip(region=name).SerializeToString() for name in REGIONS),
        tail=stop.region[:, i].astype(np.int64),
    )  # fmt: skip
    for name, unit, values in (
        ("valve", "-", stop.valve), ("judged_slip", "-", stop.judged_slip),
        ("peak/force", "N", stop.peak), ("peak/slip", "-", stop.peak_slip),
    ):  # fmt: skip
        column = values[:, i].astype(np.float64)
        yield _scalar(f"{topic}/{name}", unit, Column(stop.t, column, np.isfinite(column)))


def _events(result: Result, prefix: str) -> list[_Stream]:
    """Findings, brake applications, slides and regions on one topic, in the order of their time."""
    event, start = descriptors.message("Event"), result.log.start_ns()
    found = []
    of = {c.title: c.axle for c in result.log.channels}
    of |= {f"axle {a.record.axle}": a.record.axle for a in result.axles}
    for f in result.findings:
        where = f"{printable(f.channel)}: " if f.channel else ""
        text = f"{where}{printable(f.message)}"
        t = start + round((f.first_s or 0.0) * _SECOND)
        told = event(code=f.code, severity=f.severity, axle=of.get(f.channel), message=text)
        found.append((t, told))
    for axle in result.axles:
        N = axle.record.axle
        for s in axle.applications:
            on, gone = signals.pressed(axle.record, s)
            for i, what in ((on.start, "applied"), (on.stop - 1, "released"))[: 1 + gone]:
                text = f"axle {N}: brake {what}"
                told = event(code=f"brake-{what}", severity="info", axle=N, message=text)
                found.append((int(axle.record.t[i]), told))
        for x in axle.events:
            told = event(code=x.code, severity="info", axle=N, message=x.message)
            found.append((x.t, told))
    return _told(found, prefix)


def _stop_events(stop: Stop, i: int) -> Iterator[tuple[int, Any]]:
    """What truly happened to an axle of a stop, counted from 0, and the regions it was judged in.

    Pairs of a time [ns] and an `adhesion.Event`.
    """
    whole, s, wheel = slice(0, len(stop.t)), stop.slip[:, i], stop.sliding()[:, i]
    slides = events.slides(whole, stop.t, stop.train_speed, s, s, stop.force[:, i], False)
    told = list(events.of_axle(i + 1, slides, [whole], stop.t, stop.region[:, i]))
    for first, past in signals.true_runs(wheel == LOCKED):
        begin, end = stop.t[[first, min(past, len(stop.t) - 1)]].tolist()
        text = f"axle {i + 1}: locked for {(end - begin) / 1e9:.2f} s"
        told.append(Event(begin, "wheel-locked", text, end))
    message = descriptors.message("Event")
    for x in told:
        yield x.t, message(code=x.code, severity="info", axle=i + 1, message=x.message)


def _told(found: Sequence[tuple[int, Any]], prefix: str) -> list[_Stream]:
    """The topic of events, or nothing if there are none; pairs from `_stop_events`."""
    if not found:
        return []
    ordered = sorted(found, key=lambda e: e[0])
    tails = tuple(e.SerializeToString() for _, e in ordered)
    times = np.array([t for t, _ in ordered], np.int64)
    return [_Stream(f"{prefix}/events", "Event", times, {}, tails, np.arange(len(tails)))]


def _origin(log: Log, shift: int) -> dict[str, str]:
    origin = {
        "version": __version__,
        "input": printable(Path(log.path).name),
        "input_sha256": log.sha256,
        "input_format": log.format,
    }
    if shift:
        origin["time_shift_ns"] = str(shift)
    return origin


def _account(log: Log) -> dict[str, dict[str, str]]:
    """What the log had lost: fresh CRCs would let all of it look sound."""
    return {RECOVERED: dict(log.account)} if log.account else {}


def _provenance(result: Result, shift: int) -> dict[str, str]:
    told = {**_origin(result.log, shift), "sources": "\n".join(result.sources)}
    if any(a.record.train_speed_made for a in result.axles):
        told["train_speed"] = MADE
    return told


def _text(document: str | bytes) -> str:
    return document if isinstance(document, str) else document.decode()


def _shift(logs: Sequence[Log]) -> int:
    """What to add to every time stamp [ns]: MCAP has no time before zero.

    A log without a calendar may start at −5 s; whole seconds are added, and provenance says so.
    """
    first = 0
    for log in logs:
        begin = min((int(c.data.t.min()) for c in log.channels if len(c.data.t)), default=0)
        if begin < 0 and log.absolute:
            raise UserError(
                f"{printable(log.path)}: has time stamps before 1970, which MCAP cannot hold",
                "check the time channel and its unit",
            )
        first = min(first, begin)
    return max(0, -(first // _SECOND) * _SECOND)


# ---- how it goes into the file


def _write(
    path: Path, streams: Sequence[_Stream], metadata: dict[str, dict[str, str]], shift: int
) -> None:
    if len(streams) > _MOST_CHANNELS:
        raise UserError(
            f"{len(streams)} channels to write, an MCAP file holds {_MOST_CHANNELS}",
            "choose channels in [channels] of the TOML",
        )
    messages = sorted({s.message for s in streams})
    schemas = [
        Schema(i, descriptors.schema(m), "protobuf", f"adhesion.{m}")
        for i, m in enumerate(messages, 1)
    ]
    channels = [
        Channel(i, s.topic, "protobuf", s.metadata(), messages.index(s.message) + 1)
        for i, s in enumerate(streams, 1)
    ]
    with path.open("wb") as file:
        out = mcap_container.Container(file, "", f"adhesion-cli {__version__}")
        for name, entries in metadata.items():
            out.metadata(name, entries)
        out.define(schemas, channels)
        for parts in _partition(streams):
            _write_chunk(out, streams, parts, shift)
        out.finish()
    mcap_container.verify(path)


def _partition(streams: Sequence[_Stream]) -> Iterator[list[slice]]:
    """Cut the streams into chunks of about `CHUNK` bytes: the rows of each that go together.

    Rows keep their order within a stream. Across streams they go by the latest time seen so far,
    so that a chunk covers a span of time even where a clock jumps back.
    """
    if not any(len(s.t) for s in streams):
        return
    clocks: dict[int, Times] = {}  # by identity of the time axis: topics of one axle share theirs
    for s in streams:
        if id(s.t) not in clocks:
            rises = bool((s.t[1:] >= s.t[:-1]).all())
            clocks[id(s.t)] = s.t if rises else np.maximum.accumulate(s.t)
    total = sum(len(s.t) * (_MESSAGE + 13 + 9 * len(s.columns) + len(s.tails[0])) for s in streams)
    pieces = -(-total // CHUNK)
    every = max(64, total >> 24)  # one in so many: a sample of bounded size
    sample = np.sort(np.concatenate([clocks[id(s.t)][::every] for s in streams]))
    middle = len(sample) * np.arange(1, pieces) // pieces
    edges = sample[middle]
    # Where many rows lie at one time (a clock that jumped back), an edge takes its share of them.
    first, last = np.searchsorted(sample, edges, "left"), np.searchsorted(sample, edges, "right")

    cuts = {}
    for axis, clock in clocks.items():
        below, above = np.searchsorted(clock, edges, "left"), np.searchsorted(clock, edges, "right")
        share = (middle - first) * (above - below) // (last - first)
        cuts[axis] = np.concatenate([[0], below + share, [len(clock)]])
    for k in range(pieces):
        parts = [slice(int(cuts[id(s.t)][k]), int(cuts[id(s.t)][k + 1])) for s in streams]
        if any(p.stop > p.start for p in parts):
            yield parts


def _write_chunk(
    out: mcap_container.Container, streams: Sequence[_Stream], parts: list[slice], shift: int
) -> None:
    """Append one chunk and its message indexes."""
    rows = [
        _Rows(i, s, part, shift)
        for i, (s, part) in enumerate(zip(streams, parts, strict=True), 1)
        if part.stop > part.start
    ]
    clock = np.concatenate([np.maximum.accumulate(r.t) for r in rows])
    order = np.argsort(clock, kind="stable")
    sizes = np.concatenate([r.sizes for r in rows])
    ends = np.cumsum(sizes[order])
    at = np.empty_like(ends)
    at[order] = ends - sizes[order]

    buffer = np.zeros(int(ends[-1]), np.uint8)
    index = {}
    begin = 0
    for r in rows:
        offsets = at[begin : begin + len(r.t)]
        begin += len(r.t)
        r.write(buffer, offsets)
        index[r.channel] = np.stack([r.t, offsets], axis=1)
    out.chunk(buffer.tobytes(), index)


class _Rows:
    """The messages of one stream in one chunk: first how long each is, then their bytes."""

    def __init__(self, channel: int, stream: _Stream, part: slice, shift: int) -> None:
        self.channel, self.first = channel, part.start
        self.t = stream.t[part] + shift
        seconds, nanos = np.divmod(self.t, _SECOND)
        self.seconds, self.seconds_len = seconds, _varint_length(seconds)
        self.nanos, self.nanos_len = nanos, _varint_length(nanos)
        # A field with its default value is not written: that is how protobuf does it.
        self.stamp_len = self.seconds_len + (seconds > 0) + self.nanos_len + (nanos > 0)
        number = descriptors.numbers(stream.message)
        self.columns = [
            (number[name] << 3 | 1, values(part)) for name, (_, values) in stream.columns.items()
        ]
        self.tails = stream.tails
        self.tail = None if stream.tail is None else stream.tail[part]
        tail_len = np.array([len(t) for t in self.tails])
        self.sizes: Offsets = _MESSAGE + 2 + self.stamp_len
        self.sizes += tail_len[0] if self.tail is None else tail_len[self.tail]
        self.sizes += 9 * len(self.columns)

    def write(self, buffer: Bytes, at: Offsets) -> None:
        """Fill in the message records that start at `at`, shape (n,)."""
        _put(buffer, at, "u1", Opcode.MESSAGE)
        _put(buffer, at + 1, "<u8", self.sizes - 9)
        _put(buffer, at + 9, "<u2", self.channel)
        _put(buffer, at + 11, "<u4", (self.first + np.arange(len(at))) & 0xFFFFFFFF)  # sequence
        _put(buffer, at + 15, "<u8", self.t)  # log time
        _put(buffer, at + 23, "<u8", self.t)  # publish time
        _put(buffer, at + 31, "u1", 1 << 3 | 2)  # field 1, google.protobuf.Timestamp
        _put(buffer, at + 32, "u1", self.stamp_len)
        at = at + 33
        at = _put_varint(buffer, at, 1 << 3, self.seconds, self.seconds_len)
        at = _put_varint(buffer, at, 2 << 3, self.nanos, self.nanos_len)
        for tag, values in self.columns:
            _put(buffer, at, "u1", tag)
            _put(buffer, at + 1, "<f8", values)
            at = at + 9
        for k, tail in enumerate(self.tails):
            if tail:
                _put(
                    buffer, at if self.tail is None else at[self.tail == k], f"V{len(tail)}",
                    np.void(tail),
                )  # fmt: skip


def _put(buffer: Bytes, at: Offsets, dtype: str, values: Any) -> None:
    """Store `values` at the byte offsets `at`, whatever their alignment."""
    kind = np.dtype(dtype)
    if len(at):
        np.ndarray((len(buffer) - kind.itemsize + 1,), kind, buffer, 0, (1,))[at] = values


def _varint_length(values: NDArray[np.int64]) -> Offsets:
    """Bytes of each value ≥ 0 as a varint; 0 for 0, which protobuf does not write."""
    length = np.zeros(len(values), np.int64)
    while values.any():
        length += values > 0
        values = values >> 7
    return length


def _put_varint(
    buffer: Bytes, at: Offsets, tag: int, values: NDArray[np.int64], length: Offsets
) -> Offsets:
    """Store tag and varint where there is a value; returns where the next field goes."""
    here = length > 0
    _put(buffer, at[here], "u1", tag)
    for k in range(int(length.max())):
        here = length > k
        more = np.where(length[here] > k + 1, 0x80, 0)
        _put(buffer, at[here] + 1 + k, "u1", values[here] >> 7 * k & 0x7F | more)
    return at + length + (length > 0)
