"""Each axle on the times of its wheel speed: pressure repeated for estimators, interpolated else.

An online estimator may use the last value only. The offline reference may interpolate, and so may
what is only compared: train speed and truth.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from ..channels import to_si
from ..core import units
from ..core.finding import Finding, Severity
from ..core.model import (
    MOTOR_FORCES,
    AxleRecord,
    Bools,
    Channel,
    Floats,
    Meaning,
    Parameter,
    SpeedsAlone,
    Times,
    Vehicle,
)
from ..core.physics import CRAWL, NO_FORCE, RELEASED_SHARE, clamping_force
from ..core.sample_times import SampleTimes
from .axle_channels import AxleChannels, MotorForce
from .choose import SHORTEST, AxleChoice, Choice
from .faults import Fault, View
from .screen import Screened

_COMPARED: tuple[Meaning, ...] = ("train_speed", "truth", "true_slip")
_LEAST_USABLE = 0.5  # of the time of an axle's speed
_EARLIER = 1_000_000_000  # a brake applied for so long without a wheel speed is lost [ns]


def resample(
    choice: Choice, screened: Screened, view: View
) -> tuple[list[AxleChannels], list[Finding]]:
    """The axles of which something is left, and what was left out of them.

    An axle that is left for less than half of its time would shorten what all axles show together.
    """
    axles: list[AxleChannels] = []
    usable_times: dict[int, tuple[float, float]] = {}
    findings: list[Finding] = []
    for chosen in choice.axles:
        if chosen.speed in screened.channels and chosen.brake in screened.channels:
            logged_t = choice.channels[chosen.speed].data.t
            logged_t = logged_t[view.contains(logged_t)]
            inside = view.contains(screened.channels[chosen.speed].data.t)
            axle, faults = _axle(chosen, screened, inside)
            if axle:
                axles.append(axle)
                t = axle.record.t
                used_ns = sum(int(t[s.stop - 1] - t[s.start]) for s in axle.record.segments)
                usable_times[chosen.axle] = used_ns * 1e-9, float(np.ptp(logged_t)) * 1e-9
            if chosen.axle in choice.requested:
                findings += [f for channel, fault in faults for f in view.report(fault, channel)]
    short_axles = {x for x, (used, logged) in usable_times.items() if used < _LEAST_USABLE * logged}
    if short_axles >= {*choice.requested}.intersection(usable_times):
        return axles, findings
    for a in axles:
        if a.record.axle in short_axles:
            used, logged = usable_times[a.record.axle]
            values = {"axle": a.record.axle, "used_s": used, "logged_s": logged}
            findings.append(Finding("axle-left-out", "warning", a.speed.title, values=values))
    return [a for a in axles if a.record.axle not in short_axles], findings


def _axle(
    chosen: AxleChoice, screened: Screened, inside: Bools
) -> tuple[AxleChannels | None, list[tuple[Channel, Fault]]]:
    """One axle, None where too little is left; and the faults of its channels.

    `inside` says which samples of its speed lie in the window, shape (n,).
    """
    shared = {k[0]: c for k, c in screened.channels.items() if k[1] is None}
    channels = shared | {k[0]: c for k, c in screened.channels.items() if k[1] == chosen.axle}
    speed, brake = screened.channels[chosen.speed], screened.channels[chosen.brake]
    times = SampleTimes(speed.data.t, speed.pieces)
    last_value, smooth, is_fresh = _sampled(times, brake)
    motors, motors_fresh = _motor_force(channels, times)
    compared = {x: times.interpolate(channels[x]) for x in _COMPARED if x in channels}
    fresh = is_fresh & motors_fresh
    segments, in_segment = _segments(speed, inside & fresh)
    recorded = (times.t >= brake.data.t.min()) & (times.t <= brake.data.t.max())
    quantity, too_short = str(brake.meaning).replace("_", " "), inside & fresh & ~in_segment
    without_motors = inside & is_fresh & ~motors_fresh
    faults = [
        _missing(speed, brake, inside & ~is_fresh, recorded, quantity),
        (speed, Fault("too-short", too_short, values={"needed": SHORTEST})),
        _missing(speed, brake, without_motors, motors_fresh, "ED force"),
        *_brake_without_speed(speed, brake, chosen.vehicle),
    ]
    if not segments:
        return None, faults
    train = channels.get("train_speed")
    compared = {x: value[in_segment] for x, value in compared.items()}
    last_value, smooth = last_value[in_segment], smooth[in_segment]
    is_pressure = brake.meaning == "pressure"
    limit, unit = screened.ranges.get(chosen.brake), units.unit(speed.measured_in)
    record = AxleRecord(
        chosen.axle,
        speed.data.t[in_segment],
        last_value,
        smooth,
        speed.data.value[in_segment],
        segments,
        wheel_speed_step=speed.step,
        pressure=last_value if is_pressure else None,
        train_speed=compared.get("train_speed"),
        truth=compared.get("truth"),
        true_slip=compared.get("true_slip"),
        clamping_force_step=brake.step,
        train_speed_interval=1.0 / train.rate_hz if train and train.rate_hz else 0.0,
        train_speed_step=train.step if train else 0.0,
        of_totals=unit is not None and to_si.is_total(unit),
        of_rim=unit is not None and to_si.is_rim(unit),
        saturated=last_value >= limit if limit is not None else None,
        pressure_zero=brake.zero if is_pressure else Parameter(0.0, 0.0),
        wheel_period_step=speed.period_step,
        speeds_alone=_speeds_alone(speed, train, times, inside & ~fresh),
    )
    if motors:
        step_force, line_force, sigma = (x[in_segment] for x in motors[:3])
        motors = MotorForce(step_force, line_force, sigma, motors.traction_known)
    smooth_pressure = smooth if is_pressure else None
    axle = AxleChannels(record, speed, brake, train, smooth_pressure, chosen.vehicle, motors)
    return axle.clamped(), faults


def _speeds_alone(
    speed: Channel, train: Channel | None, times: SampleTimes, without_brake: Bools
) -> SpeedsAlone | None:
    """The speeds at the times of the wheel speed at which the brake is not known, (n,)."""
    if not without_brake.any():
        return None
    v = times.interpolate(train) if train else np.full(len(times.t), np.nan)
    wheel = speed.data
    return SpeedsAlone(wheel.t[without_brake], wheel.value[without_brake], v[without_brake])


def _motor_force(
    channels: Mapping[Meaning, Channel], times: SampleTimes
) -> tuple[MotorForce | None, Bools]:
    """The force of an axle's motors at the wheel speed's times, and where it is known, (n,)."""
    n = len(times.t)
    last_value, smooth, variance = np.zeros((3, n))
    known, meanings = np.ones(n, dtype=np.bool_), set[Meaning]()
    for sign, meaning in ((1.0, MOTOR_FORCES[0]), (-1.0, MOTOR_FORCES[1])):
        if meaning not in channels:
            continue
        by_force, by_force_smooth, is_fresh = _sampled(times, channels[meaning])
        last_value += sign * by_force
        smooth += sign * by_force_smooth
        variance += (channels[meaning].tolerance * by_force_smooth) ** 2
        known &= is_fresh
        meanings.add(meaning)
    if not meanings:
        return None, known
    drives = "traction_force" in meanings or bool(
        np.nanmin(smooth, initial=0.0) < -RELEASED_SHARE * np.nanmax(smooth, initial=0.0)
    )
    return MotorForce(last_value, smooth, np.sqrt(variance), drives), known


def _sampled(times: SampleTimes, brake: Channel) -> tuple[Floats, Floats, Bools]:
    """The last value of a brake, the same interpolated, and whether it is recent, (n,) each."""
    (last_value, fresh), smooth = times.last_value(brake), times.interpolate(brake)
    return last_value, np.where(np.isfinite(smooth), smooth, last_value), fresh


def _missing(
    speed: Channel, brake: Channel, stale: Bools, known: Bools, quantity: str
) -> tuple[Channel, Fault]:
    """Samples without a recent value: only a note where these are the first or the last ones.

    `stale` are samples without one, `known` those of which the first and the last have one, (n,)
    each.
    """
    within = np.logical_or.accumulate(known) & np.logical_or.accumulate(known[::-1])[::-1]
    lasts_ns = stale.sum() * np.median(np.diff(speed.data.t, append=speed.data.t[-1]))
    only_at_ends = lasts_ns <= 2 * max(brake.gap_ns, speed.gap_ns) and not (stale & within).any()
    severity: Severity = "info" if only_at_ends else "warning"
    return speed, Fault("no-pressure", stale, severity=severity, names={"quantity": quantity})


def _brake_without_speed(
    speed: Channel, brake: Channel, vehicle: Vehicle
) -> Iterator[tuple[Channel, Fault]]:
    """The samples of a brake that is applied before its wheel speed begins, or after its end.

    They are info where the wheel hardly turned at that end: no pulses come from a standing one.
    """
    t, y, brake_t = speed.data.t, speed.data.value, brake.data.t
    slow = CRAWL / vehicle.wheel_radius[0].value
    for outside, was_turning in (
        (brake_t < t.min() - _EARLIER, y[np.argmin(t)] > slow),
        (brake_t > t.max() + _EARLIER, y[np.argmax(t)] > slow),
    ):
        if not outside.any():
            continue
        brake_value = brake.data.value[outside]
        K = clamping_force(brake_value, vehicle) if brake.meaning == "pressure" else brake_value
        braked = outside.copy()
        braked[outside] = K > NO_FORCE
        if braked.sum() * np.median(np.diff(brake_t, append=brake_t[-1])) >= _EARLIER:
            severity: Severity = "warning" if was_turning else "info"
            yield brake, Fault("no-wheel-speed", braked, severity=severity, title=speed.title)


def _segments(speed: Channel, usable: Bools) -> tuple[tuple[slice, ...], Bools]:
    """Runs of kept samples without a jump of the clock or a gap, and the mask of their samples.

    The slices count kept samples only.
    """
    t: Times = speed.data.t
    jump = np.diff(t, prepend=t[0]) > speed.gap_ns
    jump[list(speed.starts)] = True
    index = np.flatnonzero(usable)
    if not len(index):
        return (), usable
    new_segment = np.diff(np.cumsum(jump)[index], prepend=-1) != 0
    new_segment[1:] |= np.diff(t[index]) > speed.gap_ns
    run = np.cumsum(new_segment) - 1
    length = np.bincount(run)
    long_enough = length >= SHORTEST
    in_segment = np.zeros(len(t), dtype=np.bool_)
    in_segment[index[long_enough[run]]] = True
    stops = np.cumsum(length[long_enough])
    return tuple(
        slice(int(stop - n), int(stop)) for stop, n in zip(stops, length[long_enough], strict=True)
    ), in_segment
