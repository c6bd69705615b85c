"""Channels of different rates to one record per axle, on the wheel speed's own time."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core import time_axis, units
from ..core.errors import UserError
from ..core.finding import Finding, Severity
from ..core.model import (
    Z95,
    AxleRecord,
    Bools,
    Channel,
    Column,
    Floats,
    Log,
    Meaning,
    Parameter,
    Times,
    Vehicle,
)
from ..core.physics import clamping_force, force_line
from ..dynamics import acceleration, longitudinal, train_clock
from ..dynamics.pressure_comparison import late as late_alone
from ..dynamics.train_grid import Axle, Explanation, Grid, Scene, grid
from . import sample_and_hold, screen

Window = tuple[float | None, float | None]  # seconds after the log's start, from and to

_REVERSE = 1.0  # speed that no noise around standstill reaches [rad/s, of the train m/s]
_TOLD = 3.0  # sigma from zero is a train speed that is late
_COUNTED = 0.75  # of an interval, a wheel speed by counted pulses is late itself
_DEAD = ("interleaved", "speed-frozen", "speed-spike", "pressure-frozen", "pressure-spike")
SHORTEST = 3  # samples: fewer give no derivative with an error


class Prepared(NamedTuple):
    """The records of a log, and what checks may look at."""

    records: list[AxleRecord]  # of the axles asked for
    findings: list[Finding]  # of the channels one by one, and of the clocks
    scene: Scene | None  # all axles together; None where a clock jumps back
    channels: frozenset[str]  # titles of the channels that the records are made of


def prepare(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: Window = (None, None),
) -> Prepared:
    """One record per axle that has a wheel speed and a pressure (or K).

    Args:
        log: with its channels' meanings.
        vehicle: for (15).
        axles: only these, all if empty.
        window: only the samples between these seconds after the log's start.

    Raises:
        UserError: where a needed channel is missing, an axle asked for is not there, or no two
            channels share any time.
    """
    findings: list[Finding] = []
    log = _as_read(log, findings)
    speeds, pressures = _by_axle(log, "wheel_speed"), _by_axle(log, "pressure")
    forces, trains = _by_axle(log, "clamping_force"), _by_axle(log, "train_speed")
    if not speeds:
        raise _missing(log, "wheel speed", 'speed."axle 1" = {channel = "…", unit = "km/h"}')
    if not pressures and not forces:
        raise _missing(
            log, "brake-cylinder pressure", 'pressure."axle 1" = {channel = "…", unit = "bar"}'
        )
    numbers = sorted({a for d in (speeds, pressures, forces) for a in d if a}) or [1]
    if unknown := set(axles) - set(numbers):
        raise UserError(
            f"{log.path}: no axle {min(unknown)}",
            f"the log has axles {', '.join(map(str, numbers))}",
            code=2,
        )
    asked = axles or numbers
    accelerations = [trains.pop(a) for a in list(trains) if trains[a].is_rate]
    trains, told = _sound_trains(trains, speeds, log.start_ns(), window)
    findings += told
    found: list[Axle] = []
    for axle in numbers:
        one, told = _axle(log, vehicle, axle, window, speeds, trains)
        findings += told if axle in asked else []
        found += [one] if one else []
    if not any(a.record.axle in asked for a in found):
        raise _nothing(log, speeds, pressures or forces, window, findings)
    if accelerations and not trains:
        found, told = _integrated(found, accelerations[0], vehicle)
        findings += told
    together = grid(found, vehicle)
    found, told = _on_one_clock(found, together, vehicle, log.start_ns())
    findings += told
    if told:  # the train speed is another one
        together = grid(found, vehicle)
    found, why = _explained(found, together, vehicle)
    chosen = [a for a in found if a.record.axle in asked]
    theirs = {"", *(c.title for a in chosen for c in (a.speed, a.brake, a.train) if c)}
    scene = Scene(found, together, vehicle, log.start_ns(), why) if together else None
    return Prepared([a.record for a in chosen], findings, scene, frozenset(theirs))


def _sound_trains(
    trains: dict[int | None, Channel], speeds: dict[int | None, Channel], start_ns: int,
    window: Window,
) -> tuple[dict[int | None, Channel], list[Finding]]:  # fmt: skip
    """The train speeds without their sign and what they cannot be, and what is told of that."""
    found, findings = {}, []
    signed = any(_backwards(c).any() for c in speeds.values())
    wheels = [_unsigned(c) for c in speeds.values()]
    for axle, train in trains.items():
        back = _backwards(train)
        if back.any() and not signed:
            text = (
                "is below zero where the wheels' speeds are above: taken without its sign; if the "
                "train did not run backwards, correct the sign"
            )
            fault = screen.Fault("reverse-running", text, back, False)
            told = _told(train, [fault], start_ns, window)
            findings += [replace(f, severity="info") for f in told]
        logged = _unsigned(train)
        faults = screen.of_train(logged, wheels)
        findings += _told(logged, faults, start_ns, window)
        found[axle] = _without(logged, faults)
    return found, findings


def _axle(
    log: Log, vehicle: Vehicle, axle: int, window: Window,
    speeds: dict[int | None, Channel], trains: dict[int | None, Channel],
) -> tuple[Axle | None, list[Finding]]:  # fmt: skip
    """One axle by its own channels, None where one lacks or is wrong all along; what is told."""
    speed = log.find("wheel_speed", axle)
    brake = log.find("pressure", axle) or log.find("clamping_force", axle)
    if not speed or not brake:
        lacking = "wheel speed" if not speed else "pressure or clamping force"
        name = (speed or brake).title  # type: ignore[union-attr]
        text = f"axle {axle} has no {lacking}: not analysed"
        return None, [Finding("axle-incomplete", "warning", text, name)]
    own = (trains[of_axle] for of_axle in (axle, None) if of_axle in trains)
    train = next((c for c in own if len(c.data.t)), None)
    wheels = [c for c in speeds.values() if c is not speed and len(c.data.t)]
    moving = [_unsigned(c) for c in (*wheels, *trains.values()) if len(c.data.t)]
    alike: Meaning = "pressure" if brake.meaning == "pressure" else "clamping_force"
    beside = [c for c in _by_axle(log, alike).values() if c is not brake]
    of_speed = screen.of_speed(speed)
    of_brake = screen.of_pressure(brake, beside, [speed, *wheels])
    told = [
        *_told(speed, of_speed, log.start_ns(), window),
        *_told(brake, of_brake, log.start_ns(), window),
    ]
    sound, pressing = _without(speed, of_speed), _without(brake, of_brake)
    if not len(sound.data.t) or not len(pressing.data.t):
        return None, told
    true = log.find("truth", axle), log.find("true_slip", axle)
    limit = screen.limit(pressing, of_brake)
    record, more = _record(log, vehicle, axle, window, sound, pressing, train, true, moving, limit)
    return Axle(record, speed, brake, train) if record else None, [*told, *more]


def _explained(
    axles: Sequence[Axle], g: Grid | None, vehicle: Vehicle
) -> tuple[list[Axle], Explanation]:
    """The axles with what their pressures are late by, and what explains how the train slows."""
    alone = late_alone(axles, g) if g else []  # they say nothing of the others
    alike = [a for k, a in enumerate(axles) if k not in alone]
    why = longitudinal.explained(alike, grid(alike, vehicle) if alone else g, vehicle)
    late = [a._replace(record=replace(a.record, pressure_late=why.late)) for a in axles]
    return late, why


def _integrated(
    axles: Sequence[Axle], a: Channel, vehicle: Vehicle
) -> tuple[list[Axle], list[Finding]]:
    """The axles with a train speed by its acceleration, or told why not."""
    g = grid(axles, vehicle, acceleration.FINE)
    v = acceleration.integrated(g, a) if g else "the clock jumps back"
    if isinstance(v, str):
        text = f"no train speed: the acceleration is not integrated to one, as {v}"
        return list(axles), [Finding("acceleration-unused", "warning", text, a.title)]
    columns = [v.at(x.record.t) for x in axles]
    late = Parameter(0.0, acceleration.LATE)
    made = [
        x._replace(
            record=replace(
                x.record, train_speed=speed, train_speed_sigma=sigma, train_speed_late=late
            )
        )
        for x, (speed, sigma) in zip(axles, columns, strict=True)
    ]
    sigma = np.concatenate([s for _, s in columns])
    low, high = v.bias.min(), v.bias.max()
    axis, way = ("forwards", "above") if v.sign > 0 else ("backwards", "below")
    text = (
        f"no train speed: made by integrating the acceleration, axis {axis}, {low:.2f} to "
        f"{high:.2f} m/s² {way} the train's by zero, tilt and gradient; held where wheels surely "
        f"roll ({v.anchored:.0f} s), its 1 sigma is up to {np.nanmax(sigma, initial=0.0):.2f} m/s"
    )
    told = Finding("train-speed-integrated", "info", text, a.title)
    return made, [told]


def _on_one_clock(
    axles: Sequence[Axle], g: Grid | None, vehicle: Vehicle, start_ns: int
) -> tuple[list[Axle], list[Finding]]:
    """The axles with a train speed shifted by what it is late, where that is told from zero."""
    train = axles[0].train
    if not g or train is None:
        return list(axles), []
    late, offset = train_clock.beside(axles, g, vehicle)
    findings = []
    first = (int(train.data.t[0]) - start_ns) / 1e9

    def tell(code: str, text: str) -> None:
        findings.append(Finding(code, "warning", text, train.title, train.rows, first))

    off = ""
    if offset is not None:
        off = (
            f"the train speed is {abs(offset.value):.2f} m/s (± {Z95 * offset.tolerance:.2f}) "
            f"{'above' if offset.value > 0.0 else 'below'} that of the wheels, at every speed"
        )
    if late is None:
        if off:
            tell(
                "train-offset",
                f"{off}: slip is wrong by that; correct its zero, or see if it drifts",
            )
        return list(axles), findings
    interval = max(float(np.median(np.diff(a.record.t))) for a in axles) * 1e-9
    if abs(late.value) > max(_TOLD * late.tolerance, _COUNTED * interval):
        way = "behind" if late.value > 0.0 else "ahead of"
        text = (
            f"the train speed is {abs(late.value):.2f} s (± {Z95 * late.tolerance:.2f}) {way} the "
            "wheels"
        )
        if off:  # kept, and slip's error holds it
            tell("train-clock-offset", f"{text}, or {off}: nothing in the log tells which")
            late = Parameter(0.0, math.hypot(*late))
        else:
            tell("train-clock-offset", f"{text}: its time stamps are shifted by that")
    else:  # none, as far as that is known
        late = Parameter(0.0, math.hypot(*late))
    return [_shifted(a, late) if a.train and _same(a.train, train) else a for a in axles], findings


def _same(one: Channel, other: Channel) -> bool:
    """Whether two channels hold the same samples, as a result of ours repeats one per axle."""
    a, b = one.data, other.data
    return one is other or (np.array_equal(a.t, b.t) and np.array_equal(a.value, b.value))


def _shifted(axle: Axle, late: Parameter) -> Axle:
    """An axle whose train speed is that much earlier."""
    record, train = axle.record, axle.train
    assert train is not None
    record = replace(record, train_speed_late=late)
    if late.value:
        data = replace(train.data, t=train.data.t - round(late.value * 1e9))
        v = time_axis.interpolated(time_axis.Over(record.t, 0, 1), replace(train, data=data))
        record = replace(record, train_speed=v)
    return axle._replace(record=record)


def _inside(since: Floats, window: Window) -> Bools:
    """Where a time lies in the window, seconds after the log's start; shape (n,)."""
    first, last = window
    inside: Bools = (since >= (-np.inf if first is None else first)) & (
        since <= (np.inf if last is None else last)
    )
    return inside


def _backwards(speed: Channel) -> Bools:
    """Samples of a speed that say the train runs backwards, shape (n,)."""
    backwards: Bools = speed.data.value < -max(_REVERSE, speed.step)
    return backwards


def _unsigned(speed: Channel) -> Channel:
    """A speed without its sign where it says that the train runs backwards."""
    if not _backwards(speed).any():
        return speed
    return replace(speed, data=replace(speed.data, value=np.abs(speed.data.value)))


def _told(
    channel: Channel, faults: Sequence[screen.Fault], start_ns: int, window: Window
) -> list[Finding]:
    """What a channel's own samples show, within the window."""
    since = (channel.data.t - start_ns) / 1e9
    inside = _inside(since, window)
    findings = []
    for fault in faults:
        if (where := fault.where & inside).any():
            first, count = float(since[np.argmax(where)]), int(where.sum())
            text = f"the {channel.meaning} {fault.text}".replace("_", " ")
            findings.append(Finding(fault.code, "warning", text, channel.title, count, first))
    return findings


def _without(channel: Channel, faults: Sequence[screen.Fault]) -> Channel:
    """A channel without the samples that are none: a gap stays where they were."""
    left_out = np.any([f.where for f in faults if f.left_out], axis=0)
    if not left_out.any():
        return channel
    kept = np.cumsum(~left_out)
    d = channel.data
    data = Column(d.t[~left_out], d.value[~left_out], d.valid[~left_out])
    starts = (int(kept[s] - (not left_out[s])) for s in channel.starts)
    return replace(channel, data=data, starts=tuple(sorted({s for s in starts if s < kept[-1]})))


def _by_axle(log: Log, meaning: Meaning) -> dict[int | None, Channel]:
    return {c.axle: c for c in log.channels if c.meaning == meaning and len(c.data.t)}


def _as_read(log: Log, findings: list[Finding]) -> Log:
    """The log with the speeds as they were measured: what a table repeats is no measurement."""
    channels = []
    for c in log.channels:
        every = 0.0
        if c.meaning in ("wheel_speed", "train_speed") and len(c.data.t) and not c.is_rate:
            every = sample_and_hold.interval(c)
        if every:
            own = sample_and_hold.readings(c, every)
            text = f"each reading is repeated for {every:.3g} s: one of each is used"
            repeats = len(c.data.t) - len(own.data.t)
            first = (int(c.data.t[0]) - log.start_ns()) / 1e9
            findings.append(Finding("speed-held", "info", text, c.title, repeats, first))
            c = own
        channels.append(c)
    return replace(log, channels=tuple(channels))


class _Aligned(NamedTuple):
    """The other channels at the wheel speed's times, shape (n,) each."""

    held: Floats  # pressure or K, last value
    smooth: Floats  # the same, interpolated
    fresh: Bools  # whether the last value is recent enough
    train: Floats
    truth: Floats
    true_slip: Floats


def _aligned(
    speed: Channel, brake: Channel, straight: Channel, *others: Channel | None
) -> _Aligned:
    parts: list[_Aligned] = []
    pieces = time_axis.pieces(speed.starts, len(speed.data.t))
    for k, piece in enumerate(pieces):
        at = time_axis.Over(speed.data.t[piece], k, len(pieces))
        last, fresh = time_axis.hold(at, brake)
        smooth = time_axis.interpolated(at, straight)
        if not np.isfinite(smooth).all():
            smooth = np.where(np.isfinite(smooth), smooth, last)
        # No online estimator sees these: they may be interpolated.
        known = [
            time_axis.interpolated(at, c) if c else np.broadcast_to(math.nan, len(at.t))
            for c in others
        ]
        parts.append(_Aligned(last, smooth, fresh, *known))
    if len(parts) == 1:
        return parts[0]
    return _Aligned(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _record(  # noqa: PLR0913
    log: Log, vehicle: Vehicle, axle: int, window: Window,
    speed: Channel, brake: Channel, train: Channel | None,
    true: tuple[Channel | None, Channel | None], others: Sequence[Channel], limit: float,
) -> tuple[AxleRecord | None, list[Finding]]:  # fmt: skip
    t, y = speed.data.t, speed.data.value
    every = sample_and_hold.interval(brake)
    straight = sample_and_hold.straightened(brake, every) if every else brake
    at = _aligned(speed, brake, straight, train, *true)
    backwards = _backwards(speed)
    since = (t - log.start_ns()) / 1e9
    inside = _inside(since, window)
    is_pressure = brake.meaning == "pressure"
    K = clamping_force(at.held, vehicle) if is_pressure else at.held
    K_smooth = K
    if at.smooth is not at.held:  # their times are not the same
        K_smooth = clamping_force(at.smooth, vehicle) if is_pressure else at.smooth
    frozen = screen.stuck_speed(speed, K, others)
    keep = inside & at.fresh & ~frozen
    jump = np.diff(t, prepend=t[0]) > speed.gap_ns
    jump[1:] |= frozen[:-1] & ~frozen[1:]
    jump[list(speed.starts)] = True
    segments, kept = _segments(t, keep, jump, speed.gap_ns)

    findings: list[Finding] = []

    def tell(code: str, severity: Severity, message: str, where: Bools) -> None:
        if count := int(where.sum()):
            when = float(since[np.argmax(where)])
            findings.append(Finding(code, severity, message, speed.title, count, when))

    stale = inside & ~at.fresh
    pressed = (t >= brake.data.t.min()) & (t <= brake.data.t.max())
    ends = stale.sum() * np.median(np.diff(t, append=t[-1])) <= 2 * max(brake.gap_ns, speed.gap_ns)
    tell(
        "no-pressure", "info" if ends and not (stale & pressed).any() else "warning",
        f"wheel speed of axle {axle} without a fresh {brake.meaning}: left out", stale,
    )  # fmt: skip
    tell(
        "speed-frozen", "warning",
        "the speed repeats one value, or zero without brake, while the train or the brake says it "
        "must change: left out; check the sensor, or name another channel in [channels]",
        frozen & inside & at.fresh,
    )  # fmt: skip
    tell(
        "wheel-locked", "info",
        "the wheel stands while the train moves: it is locked, and no force can be known there",
        screen.locked(speed, others) & keep,
    )  # fmt: skip
    tell(
        "reverse-running", "info",
        "the train runs backwards: speeds taken without their sign, forces positive when braking",
        backwards & inside,
    )  # fmt: skip
    tell("too-short", "warning", f"pieces of fewer than {SHORTEST} samples: left out", keep & ~kept)
    if every:
        text = (
            f"each sample is repeated for {every:.3g} s: the reference takes straight lines "
            "between them, online estimators what is held"
        )
        findings.append(Finding("pressure-held", "info", text, brake.title))
    if not segments:
        return None, findings
    if backwards.any():
        y = np.abs(y)
    rows = slice(None) if kept.all() else kept  # all of them need no copy
    return AxleRecord(
        axle, t[rows], K[rows], K_smooth[rows], y[rows], segments, speed.step,
        at.held[rows] if is_pressure else None,
        at.train[rows] if train else None,
        at.truth[rows] if true[0] else None,
        at.true_slip[rows] if true[1] else None,
        brake.step * (force_line(vehicle).per_pascal if is_pressure else 1.0),
        1.0 / train.rate_hz if train and train.rate_hz else 0.0,
        of_totals=(logged := units.unit(speed.unit)) is not None
        and logged.dimension in ("count", "angle"),
        of_rim=logged is not None and logged.dimension == "speed",
        saturated=at.held[kept] >= limit if limit < math.inf else None,
        wheel_period_step=speed.period_step,
    ), findings  # fmt: skip


def _segments(t: Times, keep: Bools, jump: Bools, gap_ns: int) -> tuple[tuple[slice, ...], Bools]:
    """Runs of kept samples without a jump or a gap, and the mask of the samples in them.

    The slices count kept samples only; `jump` marks a sample that begins something new.
    """
    index = np.flatnonzero(keep)
    if not len(index):
        return (), keep
    new = np.diff(np.cumsum(jump)[index], prepend=-1) != 0
    new[1:] |= np.diff(t[index]) > gap_ns
    run = np.cumsum(new) - 1
    length = np.bincount(run)
    long = length >= SHORTEST
    kept = np.zeros(len(t), dtype=np.bool_)
    kept[index[long[run]]] = True
    stops = np.cumsum(length[long])
    return tuple(
        slice(int(stop - n), int(stop)) for stop, n in zip(stops, length[long], strict=True)
    ), kept


def _missing(log: Log, what: str, example: str) -> UserError:
    names = ", ".join(repr(c.title) for c in log.channels[:8]) or "none"
    return UserError(
        f"{log.path}: no channel is a {what} (recognised: {names})",
        "`adhesion inspect` lists the channels; map one in a TOML given with -c: "
        f"[channels] {example}",
    )


def _nothing(
    log: Log, speeds: dict[int | None, Channel], brakes: dict[int | None, Channel],
    window: Window, findings: Sequence[Finding],
) -> UserError:  # fmt: skip
    def span(channels: dict[int | None, Channel]) -> str:
        first = min(int(c.data.t.min()) for c in channels.values())
        last = max(int(c.data.t.max()) for c in channels.values())
        return f"{first / 1e9:.3f} to {last / 1e9:.3f} s"

    usual = max(len(c.data.t) for c in speeds.values())
    if usual < SHORTEST:
        return UserError(
            f"{log.path}: {usual} usable wheel-speed samples; at least {SHORTEST} are needed",
            f"`adhesion inspect {log.path}` shows what was left out and why",
        )
    if window != (None, None):
        return UserError(
            f"{log.path}: no sample between --from and --to",
            "seconds after the log's start",
            code=2,
        )
    if dead := next((f for f in findings if f.code in _DEAD), None):
        text, _, remedy = dead.message.rpartition("; ")
        return UserError(f"{log.path}: nothing to analyse: {dead.channel}: {text}", remedy)
    if lacking := [f.message for f in findings if f.code == "axle-incomplete"]:
        return UserError(
            f"{log.path}: nothing to analyse: {'; '.join(lacking)}",
            "state which channel is which axle's in [channels]",
        )
    return UserError(
        f"{log.path}: no overlap in time of wheel speed ({span(speeds)}) "
        f"and pressure ({span(brakes)})",
        'state the clock in [channels], e.g. time = {source = "log"}, or convert one of them',
    )
