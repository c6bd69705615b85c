"""The wheel's radius from rolling, and a train speed from the axles."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core import compiled, physics, signals
from ..core.finding import Finding
from ..core.masks import spans_of_mask, true_runs
from ..core.model import Z95, AxleRecord, Floats, Parameter, Vehicle
from ..core.physics import reference_speed
from ..train.mean_axle import mean_axle
from .speed_errors import COASTING_RATE, DRIVING_RATE, delay_error

_CALIBRATION_SPEED = 3.0  # least speed of a calibration, below which (2) is mostly noise [m/s]
_SHORTEST_COASTING = 2.0  # least time of coasting for a calibration [s]
_LARGEST_CORRECTION = 0.1  # largest correction of a wheel radius: beyond it, a unit is wrong
_ROUNDED_SHARE = 0.3  # of the readings' spread: rounding that is more needs least squares
_SLOWER = 2.5  # times the interval of the fastest speed: another tachometer, with another delay
_LATEST = 2.0  # of its intervals, the delay of a slower tachometer: a mean, or a filter
_SLIDING_SHARE = 0.03  # where all axles are this far below the reference speed, all slide


def _of_rounded(runs: Sequence[tuple[Floats, Floats]], step: float) -> tuple[float, float]:
    """The ratio of rounded train speeds to a wheel's by least squares, and its 1 sigma.

    Rounding errs by as much at each speed. Readings of one level all have one error; over n levels
    that a train coasts through, the mean of the errors is n times smaller. A run of coasting is
    train speed and rim speed; these and the step of rounding are in m/s.
    """
    squares, error = sum(float(rim @ rim) for _, rim in runs), step / math.sqrt(12.0)
    ratio = sum(float(v @ rim) for v, rim in runs) / squares
    means = [error * min(1.0, error / max(float(np.std(v)), 1e-9)) for v, _ in runs]
    errors = (x * float(rim.sum()) for x, (_, rim) in zip(means, runs, strict=True))
    return ratio, math.hypot(*errors) / squares


def calibration(record: AxleRecord, radius: float) -> tuple[float, float] | None:
    """True over stated wheel radius, and its 1 sigma, from coasting; None without coasting.

    A wheel that is neither braked nor driven rolls: v = ωR. Acceleration shows a driven one. The
    uncertainty of the train speed's delay is one error of all readings.
    """
    if record.train_speed is None:
        return None
    v, rim = record.train_speed, record.wheel_speed * radius
    ratios, delay_errors, seconds = [], [], 0.0
    runs: list[tuple[Floats, Floats]] = []
    error_by_delay = delay_error(record)
    for s in record.segments:
        t = (record.t[s] - record.t[s.start]) * 1e-9
        change = np.interp(t + 0.5, t, rim[s]) - np.interp(t - 0.5, t, rim[s])
        coasting = (change > -COASTING_RATE) & (change < DRIVING_RATE)
        coasting &= record.clamping_force[s] < physics.NO_FORCE
        coasting &= (rim[s] > _CALIBRATION_SPEED) & (v[s] > _CALIBRATION_SPEED)
        runs += [(v[s][a:b], rim[s][a:b]) for a, b in true_runs(coasting)]
        ratios.append(v[s][coasting] / rim[s][coasting])
        delay_errors.append(error_by_delay[s][coasting])
        seconds += float(np.diff(t, prepend=t[0])[coasting].sum())
    ratio = np.concatenate(ratios)
    if seconds < _SHORTEST_COASTING or len(ratio) < 10:
        return None
    # At most one value a second is independent: interpolated values repeat. A line between readings
    # has 2/3 of their variance. The spread of few values is itself uncertain.
    interval, step = record.train_speed_interval, seconds / len(ratio)
    sigma = float(np.std(ratio)) * (math.sqrt(1.5) if interval > 1.5 * step else 1.0)
    sigma *= signals.coverage_factor(max(seconds / max(interval, step) - 1.0, 1.0)) / Z95
    sigma /= math.sqrt(max(seconds / max(interval, 1.0), 1.0))
    by_delay = float(np.median(np.concatenate(delay_errors)))
    rounded_ratio, by_rounding = _of_rounded(runs, record.train_speed_step)
    if by_rounding > _ROUNDED_SHARE * sigma:
        return rounded_ratio, math.hypot(sigma, by_rounding, by_delay)
    return float(np.median(ratio)), math.hypot(sigma, by_delay)


def calibrate_radius(record: AxleRecord, vehicle: Vehicle) -> tuple[Parameter, list[Finding]]:
    """Wheel radius [m] at which the axle coasts without slip, and findings about it."""
    stated_radius, name = vehicle.radius(record.axle), f"axle {record.axle}"
    radius = stated_radius.value
    measured = calibration(record, radius)
    if measured is None:
        return stated_radius, [Finding("wheel-not-calibrated", "info", channel=name)]
    ratio, sigma = measured
    if abs(ratio - 1.0) > _LARGEST_CORRECTION:
        return stated_radius, []
    if abs(ratio - 1.0) <= 2.0 * sigma:
        return Parameter(radius, min(radius * sigma, stated_radius.tolerance)), []
    values = {"share": ratio - 1.0, "share_u95": Z95 * sigma, "reading": 1.0 / ratio - 1.0}
    rolling = Parameter(radius * ratio, radius * sigma)
    return rolling, [Finding("wheel-calibrated", "info", channel=name, values=values)]


def _follow(t: Floats, fastest: Floats, braking: Floats, v: Floats) -> None:
    """Fills v by `physics.reference_speed`; starts anew after unknown values."""
    v[0] = fastest[0]
    for i in range(1, len(t)):
        v[i] = fastest[i]
        if math.isfinite(v[i - 1]) and math.isfinite(fastest[i]):
            v[i] = reference_speed(v[i - 1], fastest[i], braking[i], t[i] - t[i - 1])


def _without_delays(t: Floats, rim: Floats, intervals: Sequence[float]) -> Floats:
    """Rim speeds (axles, n) at times t (n,), without what the delay of a slow one may add.

    Where the train slows, a wheel that is logged later looks faster than it.
    """
    least = rim.copy()
    for i, interval in enumerate(intervals):
        if interval > _SLOWER * min(intervals):
            later = np.interp(t + _LATEST * interval, t, rim[i], right=np.nan)
            least[i] = np.minimum(rim[i], later)
    return least


def with_reference_speed(
    records: Sequence[AxleRecord],
    all_records: Sequence[AxleRecord],
    vehicle: Vehicle,
    start_ns: int,
    known: bool = True,
) -> tuple[list[AxleRecord], list[Finding]]:
    """Records without a train speed get one estimated from all axles: `physics.reference_speed`.

    Where the vehicle is not `known`, the fastest axle is the train: slides of all axles together
    cannot be told from a hard brake.
    """
    if any((np.diff(r.t) <= 0).any() for r in all_records):
        return list(records), [Finding("no-train-speed", "warning")]
    t = np.unique(np.concatenate([r.t for r in all_records]))
    rim, K = np.full((2, len(all_records), len(t)), np.nan)
    mean = mean_axle(vehicle, [r.axle for r in all_records])
    for i, r in enumerate(all_records):
        for s in r.segments:
            inside = (t >= r.t[s.start]) & (t <= r.t[s.stop - 1])
            rims = r.wheel_speed[s] * vehicle.radius(r.axle).value
            rim[i, inside] = np.interp(t[inside], r.t[s], rims)
            K[i, inside] = np.interp(t[inside], r.t[s], r.clamping_force[s])
        if vehicle.axles:  # as of the mean axle
            axle_vehicle = vehicle.of_axle(r.axle)
            K[i] *= physics.table_share(rim[i], K[i], axle_vehicle.friction_table)
            K[i] *= axle_vehicle.friction.value / mean.friction.value
    middle = signals.finite_median(rim)
    for i, r in enumerate(all_records if len(all_records) > 1 else ()):
        trial = replace(r, train_speed=np.interp(r.t, t, middle))
        measured = calibration(trial, vehicle.radius(r.axle).value)
        if measured and abs(measured[0] - 1.0) < _LARGEST_CORRECTION:
            rim[i] *= measured[0]
    rim = _without_delays(t, rim, [float(np.median(np.diff(r.t))) for r in all_records])
    finite = np.isfinite(rim).any(axis=0)
    fastest = np.where(finite, np.max(np.nan_to_num(rim, nan=-np.inf), axis=0), np.nan)
    usual_force = signals.finite_median(K)
    if vehicle.axles:  # unlike axles slow the train by their mean
        usual_force = np.nansum(K, axis=0) / np.maximum(np.isfinite(K).sum(axis=0), 1)
        mean = replace(mean, friction_table=None)
    usual_force = np.nan_to_num(usual_force)
    braking = physics.braked(usual_force, physics.wheelset(mean, all_records[0].axle))
    # φ(v, K) / φ at its 95 % limit: cast iron brakes twice as hard at the end of a stop
    rim_speed = np.nan_to_num(fastest)
    uncertain = np.abs(rim_speed - mean.friction_speed.value) * mean.friction_fade.tolerance
    braking *= physics.friction_share(rim_speed, usual_force, mean) + Z95 * uncertain
    if not known:
        braking = np.full(len(t), np.inf)
    v = np.empty(len(t))
    seconds = (t - t[0]) * 1e-9
    compiled.function(_follow)(seconds, fastest, braking, v)
    findings = [Finding("reference-speed", "info", values={"axles": len(all_records)})]
    if not known:
        findings.append(Finding("common-slides-unknown", "info"))
    step = max(r.wheel_speed_step * vehicle.radius(r.axle).value for r in all_records)
    sliding = (fastest + step < (1.0 - _SLIDING_SHARE) * v) & (v > _CALIBRATION_SPEED)
    if sliding.any():
        spans, count = spans_of_mask(sliding, t, start_ns), int(sliding.sum())
        findings.append(Finding("all-axles-slide", "warning", count=count, spans=spans))
    no_delay = Parameter(0.0, 0.0)
    completed = [replace(r, train_speed_late=no_delay, train_speed_made=True) for r in records]
    return [replace(r, train_speed=np.interp(r.t, t, v)) for r in completed], findings
