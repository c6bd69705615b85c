"""Slip of every axle, its slope and region, slides, and the rail under them: [S1] to [S4].

[S1], whose formula is missing in the text that we have: at the rim the brake acts on the wheelset
with φK and the rail with F, so I ω̇ = (F − φK) R, which is (1), and

    μ = F/(m g) = (φK + I ω̇/R)/(m g).                                                        [S1]

F is the offline reference's. The estimators lag, and a lag in μ alone bends every slope. `fit` has
[S2], the curve through the points, and `slope` has [S3] and [S4].
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..core import compiled, physics, signals
from ..core.finding import Finding, merge_spans
from ..core.model import (
    Z95,
    AxleRecord,
    AxleResult,
    Bools,
    Floats,
    Parameter,
    Regions,
    Times,
    Vehicle,
)
from ..core.physics import reference_speed
from . import events, fit
from .events import END_SLIP, Slide
from .slope import REGIONS, Bands, Params, State, init, region, step

_COASTING_RATE = 0.3  # largest deceleration of a coasting train [m/s²]
_DRIVING_RATE = 0.1  # and largest acceleration: a driven wheel creeps [m/s²]
_CALIBRATION_SPEED = 3.0  # least speed of a calibration, below which (2) is mostly noise [m/s]
_SHORTEST_COASTING = 2.0  # least time of coasting for a calibration [s]
_LARGEST_CORRECTION = 0.1  # largest correction of a wheel radius: beyond it, a unit is wrong
_SLIDING_SHARE = 0.03  # where all axles are this far below the reference speed, all slide
_SAME_RAIL_PAUSE = 5.0  # after a longer pause a slide may be on another rail [s]
_TURNING_SPEED = 1.0  # below this, a speed sensor may read zero, without its noise [m/s]
_ROLLING_DIFFERENCE = 0.2  # a wheel this close to the train's speed rolls [m/s]
_SMEARING_TIME = 0.1  # over this time the smoother of the force spreads an error [s]
_LONGEST_NOISE = 1.0  # longest time scale of noise that matters to the slope [s]
_FEW_DRAWS = 40  # draws for the utilisation of one brake application
_DELAY_SIGMA = 0.2  # 1 sigma of an unknown delay of the train speed [s]; see `_has_slow_receiver`
_SHORTEST_CREEP = 0.5  # least duration of creep that is no oscillation of the speeds [s]
_CLEAR_SIGMAS = 2.0  # sigma that are more than noise
_MEDIAN_OF_SIGMA = 0.6745  # median of the absolute value of a normal variable of 1 sigma


def calibration(record: AxleRecord, radius: float) -> tuple[float, float] | None:
    """True over stated wheel radius, and its 1 sigma, from coasting; None without coasting.

    A wheel that is neither braked nor driven rolls: v = ωR. Acceleration shows a driven one. The
    uncertainty of the train speed's delay is one error of all readings.
    """
    if record.train_speed is None:
        return None
    v, rim = record.train_speed, record.wheel_speed * radius
    ratios, delay_errors, seconds = [], [], 0.0
    delay_error = _delay_error(record, _DELAY_SIGMA)
    for s in record.segments:
        t = (record.t[s] - record.t[s.start]) * 1e-9
        change = np.interp(t + 0.5, t, rim[s]) - np.interp(t - 0.5, t, rim[s])
        coasting = (
            (record.clamping_force[s] < physics.NO_FORCE)
            & (change > -_COASTING_RATE)
            & (change < _DRIVING_RATE)
        )
        coasting &= (rim[s] > _CALIBRATION_SPEED) & (v[s] > _CALIBRATION_SPEED)
        ratios.append(v[s][coasting] / rim[s][coasting])
        delay_errors.append(delay_error[s][coasting])
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
    return float(np.median(ratio)), math.hypot(
        sigma, float(np.median(np.concatenate(delay_errors)))
    )


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
    values = {"share": ratio - 1.0, "share_u95": Z95 * sigma, "diameter_m": 2.0 * radius * ratio}
    rolling = Parameter(radius * ratio, radius * sigma)
    return rolling, [Finding("wheel-calibrated", "info", channel=name, values=values)]


# Train speed from the axles


def _follow(t: Floats, fastest: Floats, braking: Floats, v: Floats) -> None:
    """Fills v by `physics.reference_speed`; starts anew after unknown values."""
    v[0] = fastest[0]
    for i in range(1, len(t)):
        v[i] = fastest[i]
        if math.isfinite(v[i - 1]) and math.isfinite(fastest[i]):
            v[i] = reference_speed(v[i - 1], fastest[i], braking[i], t[i] - t[i - 1])


def with_reference_speed(
    records: Sequence[AxleRecord],
    all_records: Sequence[AxleRecord],
    vehicle: Vehicle,
    start_ns: int,
) -> tuple[list[AxleRecord], list[Finding]]:
    """Records without a train speed get one estimated from all axles: `physics.reference_speed`.

    Args:
        records: the axles that need it.
        all_records: all axles of the log.
        vehicle: for the brake's deceleration, and the radii.
        start_ns: the log's start.
    """
    if any((np.diff(r.t) <= 0).any() for r in all_records):
        return list(records), [Finding("no-train-speed", "warning")]
    t = np.unique(np.concatenate([r.t for r in all_records]))
    rim, K = np.full((2, len(all_records), len(t)), np.nan)
    for i, r in enumerate(all_records):
        for s in r.segments:
            inside = (t >= r.t[s.start]) & (t <= r.t[s.stop - 1])
            rims = r.wheel_speed[s] * vehicle.radius(r.axle).value
            rim[i, inside] = np.interp(t[inside], r.t[s], rims)
            K[i, inside] = np.interp(t[inside], r.t[s], r.clamping_force[s])
    middle = signals.finite_median(rim)
    for i, r in enumerate(all_records):
        trial = replace(r, train_speed=np.interp(r.t, t, middle))
        measured = (
            calibration(trial, vehicle.radius(r.axle).value) if len(all_records) > 1 else None
        )
        if measured and abs(measured[0] - 1.0) < _LARGEST_CORRECTION:
            rim[i] *= measured[0]
    finite = np.isfinite(rim).any(axis=0)
    fastest = np.where(finite, np.max(np.nan_to_num(rim, nan=-np.inf), axis=0), np.nan)
    w = physics.wheelset(vehicle, all_records[0].axle)
    braking = physics.braked(np.nan_to_num(signals.finite_median(K)), w)
    v = np.empty(len(t))
    seconds = (t - t[0]) * 1e-9
    compiled.function(_follow)(seconds, fastest, braking, v)
    findings = [Finding("reference-speed", "info", values={"axles": len(all_records)})]
    sliding = (fastest < (1.0 - _SLIDING_SHARE) * v) & (v > _CALIBRATION_SPEED)
    if sliding.any():
        seconds_of_log = (t - start_ns) * 1e-9
        spans = merge_spans(
            [
                (float(seconds_of_log[a]), float(seconds_of_log[b - 1]))
                for a, b in signals.true_runs(sliding)
            ]
        )
        findings.append(
            Finding("all-axles-slide", "warning", count=int(sliding.sum()), spans=spans)
        )
    completed = [
        replace(
            r,
            train_speed=np.interp(r.t, t, v),
            train_speed_late=Parameter(0.0, 0.0),
            train_speed_made=True,
        )
        for r in records
    ]
    return completed, findings


# Slope and region


def _slope_of_segment(  # noqa: PLR0913 (compiled: one array each)
    p: Params,
    bands: Bands,
    t: Times,
    slip: Floats,
    mu: Floats,
    slip_noise: Floats,
    mu_noise: Floats,
    slope: Floats,
    confidence: Floats,
    code: Regions,
) -> None:
    """`slope.step` over one segment."""
    s: State = init(p, slip[0], mu[0])
    for i in range(len(t)):
        if i > 0:
            h = (t[i] - t[i - 1]) * 1e-9
            s = step(p, s, h, slip[i], mu[i], slip_noise[i], mu_noise[i])
        slope[i] = s.slope
        confidence[i] = s.confidence
        code[i] = region(slip[i], s.slope, bands)


def speed_noise(record: AxleRecord, radius: float) -> Floats:
    """1 sigma of the noise of v − ωR [m/s] while braked and moving, shape (n,).

    The train speed's noise is its second difference over three values a time apart: the largest for
    times up to `_LONGEST_NOISE`, as a receiver's filter makes noise slow. The train's motion bends
    v,
    too: the smaller counts of v itself and of v − ωR of a rolling wheel. Where v bends more than
    its noise, as when the train stops between two samples, that bend is the error.
    """
    assert record.train_speed is not None
    v, rim = record.train_speed, record.wheel_speed * radius
    braked = (record.clamping_force > physics.NO_FORCE) & (v > _TURNING_SPEED)
    rolls = braked & (np.abs(v - rim) < np.maximum(END_SLIP * v, _ROLLING_DIFFERENCE))
    h = float(np.median(np.diff(record.t))) * 1e-9
    train = 0.0
    for m in sorted({round(x) for x in np.geomspace(1, max(1, round(_LONGEST_NOISE / h)), 8)}):
        levels = [
            float(np.median(values)) / _MEDIAN_OF_SIGMA
            for x, selected in ((v, braked), (v - rim, rolls))
            if len(values := (bend := _bend(record, x, m))[selected & np.isfinite(bend)]) > 10 * m
        ]
        train = max(train, min(levels, default=0.0))
    wheel = (
        np.nanmedian(np.where(v > _TURNING_SPEED, _bend(record, rim, 1), np.nan)) / _MEDIAN_OF_SIGMA
    )
    between_readings = (
        _bend(record, v, max(1, round(record.train_speed_interval / h))) / _CLEAR_SIGMAS
    )
    noise: Floats = np.hypot(np.fmax(train, between_readings), np.nan_to_num(wheel))
    return noise


def deceleration(record: AxleRecord) -> Floats:
    """Deceleration of the train over about a second [m/s²], at least 0, shape (n,)."""
    assert record.train_speed is not None
    rate = np.zeros(len(record))
    for s in record.segments:
        t, v = (record.t[s] - record.t[s.start]) * 1e-9, np.nan_to_num(record.train_speed[s])
        start, stop = np.maximum(t - 0.5, t[0]), np.minimum(t + 0.5, t[-1])
        rate[s] = (np.interp(start, t, v) - np.interp(stop, t, v)) / (stop - start)
    return np.maximum(rate, 0.0)


def _has_slow_receiver(record: AxleRecord) -> bool:
    """Whether the train speed's delay is unknown and may be two of its long intervals."""
    return record.train_speed_late is None and record.train_speed_interval > _DELAY_SIGMA


def _speed_error(record: AxleRecord, unknown: float = 0.0) -> Floats:
    """1 sigma of slip by the train speed's delay and drift, one error for all, shape (n,).

    Args:
        record: of an axle.
        unknown: σ_τ of an unknown delay [s]; for a slow receiver, its interval counts.
    """
    if record.train_speed is None:
        return np.zeros(len(record))
    sigma = record.train_speed_sigma
    with np.errstate(divide="ignore", invalid="ignore"):
        of_itself = 0.0 if sigma is None else sigma / record.train_speed
    return np.hypot(_delay_error(record, unknown), of_itself)


def _delay_error(record: AxleRecord, unknown_sigma: float) -> Floats:
    """1 sigma of slip by the uncertain delay of the train speed, σ_τ (−v̇)/v, shape (n,)."""
    assert record.train_speed is not None
    delay = record.train_speed_late
    unknown_sigma = record.train_speed_interval if _has_slow_receiver(record) else unknown_sigma
    with np.errstate(divide="ignore", invalid="ignore"):
        error: Floats = (
            (delay.tolerance if delay else unknown_sigma)
            * deceleration(record)
            / record.train_speed
        )
    return error


def _bend(record: AxleRecord, x: Floats, m: int) -> Floats:
    """Second difference of x over m samples, as 1 sigma of noise; shape (n,)."""
    differences = np.full(len(x), np.nan)
    for s in record.segments:
        if s.stop - s.start > 2 * m:
            y = x[s]
            differences[s][m:-m] = np.abs(y[2 * m :] - 2.0 * y[m:-m] + y[: -2 * m]) / math.sqrt(6.0)
    return differences


def observe_slip(
    axle: AxleResult, vehicle: Vehicle, slowest: float, p: Params, bands: Bands
) -> tuple[AxleResult, list[Finding]]:
    """The result of an axle with a train speed, with its slip, slope, regions and their events.

    Noise of either speed, over v, raises the excitation that a slope needs.

    Args:
        axle: as far as it is computed.
        vehicle: for μ and the wheel radius.
        slowest: no slip below this train speed [m/s].
        p: of the slope.
        bands: of the AND-test.
    """
    record = axle.record
    assert record.train_speed is not None
    radius, findings = calibrate_radius(record, vehicle)
    slip = physics.slip(record.train_speed, record.wheel_speed, radius.value, slowest)
    mu = physics.coefficient(axle.reference.force, vehicle)  # [S1]
    with np.errstate(divide="ignore", invalid="ignore"):
        speed_slip_noise = speed_noise(record, radius.value) / record.train_speed  # noise of (2)
        lasting = _speed_error(record)
        # The slope's filter passes only the change within 1/δ of an error that follows −v̇/v.
        slip_noise = np.hypot(
            speed_slip_noise, lasting * deceleration(record) / record.train_speed / p.delta
        )
    mu_noise = physics.coefficient(axle.reference.sigma, vehicle)
    n = len(record)
    slope, confidence, code = np.full(n, np.nan), np.zeros(n), np.zeros(n, np.int8)
    march = compiled.function(_slope_of_segment)
    for s in record.segments:
        noise = slip_noise[s], mu_noise[s]
        march(p, bands, record.t[s], slip[s], mu[s], *noise, slope[s], confidence[s], code[s])
    completed = replace(
        axle,
        slip=slip,
        slip_noise=speed_slip_noise,
        slope=slope,
        slope_confidence=confidence,
        region=code,
    )
    if record.train_speed_late is None and any(
        np.median(deceleration(record)[x.samples]) > _COASTING_RATE
        for x in _slides(completed, slip, slip)
    ):
        finding, name = Finding("train-speed-delay-unknown", "info"), f"axle {record.axle}"
        if _has_slow_receiver(record):
            delay = {"delay_s": 2.0 * record.train_speed_interval}
            finding = Finding("train-speed-slow", "warning", values=delay)
        findings.append(replace(finding, channel=name))
    axle_events = events.axle_events(
        record.axle, slides(completed), record.segments, record.t, code
    )
    return replace(completed, events=axle_events), findings


# Slides and shares


def slides(axle: AxleResult) -> list[Slide]:
    """Slides of a braked axle, in the order of time; none reaches across segments.

    Slip within the error and noise of the train speed is no slide. With an unknown delay of a slow
    receiver, the slides have the least slip that is certain.
    """
    if axle.slip is None:
        return []
    clear = _certain_slip(axle.record, axle.slip)
    return _slides(axle, clear if _has_slow_receiver(axle.record) else axle.slip, clear)


def _slides(axle: AxleResult, s: Floats, certain: Floats) -> list[Slide]:
    """The same of a slip, and of the part of it that is certain, shape (n,).

    The brake is applied in a slide, or was a second before.
    """
    record, slides = axle.record, []
    assert record.train_speed is not None
    columns = record.t, record.train_speed, s, certain, axle.reference.force
    is_lower_bound = record.train_speed_made or _has_slow_receiver(record)
    depth = None if axle.slip_noise is None else _CLEAR_SIGMAS * axle.slip_noise
    for segment in record.segments:
        for x in events.slides(segment, *columns, is_lower_bound, depth):
            earlier_t = record.t[: x.samples.start]
            brake_start = int(np.searchsorted(earlier_t, record.t[x.samples.start] - 1_000_000_000))
            if (record.clamping_force[brake_start : x.samples.stop] > 0.0).any():
                slides.append(x)
    return slides


def _certain_slip(record: AxleRecord, s: Floats) -> Floats:
    """Slip minus the possible error of the train speed, shape (n,)."""
    return s - 2.0 * _speed_error(record)


def limited_from(axle: AxleResult, start_ns: int, end_ns: int) -> int | None:
    """When adhesion first limits the wheel, between two times [ns]; None where it does not.

    With a WSP this is before the first slide: at the first lasting creep above a rolling wheel's.
    """
    record, s = axle.record, axle.slip
    if s is None or record.train_speed is None:
        return None
    runs = [x.samples for x in slides(axle)] + find_creep(record, s)
    starts = [int(record.t[x.start]) for x in runs]
    return min((t for t in starts if start_ns <= t <= end_ns), default=None)


def find_creep(record: AxleRecord, s: Floats) -> list[slice]:
    """Where a braked wheel has lasting slip above a rolling wheel's, in the order of time."""
    is_creeping, runs = (_certain_slip(record, s) > END_SLIP) & (record.clamping_force > 0.0), []
    for segment in record.segments:
        for start, stop in signals.true_runs(is_creeping[segment]):
            run = slice(segment.start + start, segment.start + stop)
            if record.t[run.stop - 1] - record.t[run.start] >= _SHORTEST_CREEP * 1e9:
                runs.append(run)
    return runs


def shares(axle: AxleResult) -> dict[str, float]:
    """Share of the braked time, above the speed limit for slip, in each region."""
    if axle.region is None or axle.slip is None:
        return {}
    time = np.zeros(len(REGIONS))
    for s in axle.applications:
        h = np.diff(axle.record.t[s], append=axle.record.t[s.stop - 1]) * 1e-9
        h = np.where(np.isfinite(axle.slip[s]), h, 0.0)
        time += np.bincount(axle.region[s], weights=h, minlength=len(REGIONS))
    total = float(time.sum())
    if total == 0.0:
        return {}
    return {name: float(x) / total for name, x in zip(REGIONS, time, strict=True)}


class Summary(NamedTuple):
    """What `adhesion slip` reports of one axle; None where the log does not show it."""

    axle: int
    regions: dict[str, float]  # shares of the braked time
    slides: list[Slide]
    rail: fit.RailFit | None
    slip_rmse: float | None  # against the log's own true slip, while braked
    delay: Parameter | None  # delay of the train speed, corrected [s]; None: not known


def summary(axle: AxleResult, vehicle: Vehicle) -> tuple[Summary, list[Finding]]:
    """Slides, shares, rail, peak and adhesion utilisation of an axle."""
    axle_slides = slides(axle)
    rail, findings = fit_rail(AxleContext(axle, vehicle), axle_slides)
    delay = None if axle.record.train_speed_made else axle.record.train_speed_late
    return Summary(axle.record.axle, shares(axle), axle_slides, rail, _rmse(axle), delay), findings


class AxleContext:
    """What a fit needs of the whole axle, computed once for all its brake applications.

    Args:
        axle: with its slip and a train speed, before anything is asked for.
        vehicle: for μ and the wheel radius.
    """

    def __init__(self, axle: AxleResult, vehicle: Vehicle) -> None:
        self.axle, self.vehicle = axle, vehicle

    @cached_property
    def radius(self) -> Parameter:
        """At which it coasts without slip [m]."""
        return calibrate_radius(self.axle.record, self.vehicle)[0]

    @cached_property
    def noise(self) -> Floats:
        """1 sigma of v − ωR [m/s], (n,)."""
        return speed_noise(self.axle.record, self.radius.value)

    @cached_property
    def clock(self) -> Floats:
        """1 sigma of slip by the train speed, (n,)."""
        return _speed_error(self.axle.record, _DELAY_SIGMA)

    @cached_property
    def swing(self) -> Floats:
        """1 sigma of μ by the reference, (n,)."""
        return physics.coefficient(
            _around(self.axle.record, self.axle.reference.sigma), self.vehicle
        )

    @cached_property
    def creep(self) -> list[slice]:
        """Where it creeps, as `find_creep`."""
        assert self.axle.slip is not None
        return find_creep(self.axle.record, self.axle.slip)


def unknown_slip(record: AxleRecord, samples: slice, vehicle: Vehicle) -> tuple[Bools, float]:
    """Where the wheel turns and the train speed is not known, and for how long [s].

    Args:
        record: the axle's record.
        samples: a brake application.
        vehicle: for the radius.

    Returns:
        A mask of the brake application, shape (m,), and its time.
    """
    mask: Bools = record.wheel_speed[samples] * vehicle.radius(record.axle).value > physics.CRAWL
    if record.train_speed is not None:
        mask &= ~np.isfinite(record.train_speed[samples])
    h = np.diff(record.t[samples], append=record.t[samples.stop - 1])
    typical = np.minimum(h, 2.0 * np.median(h))  # without the time of a gap
    return mask, float(typical[mask].sum()) * 1e-9


def utilisation(context: AxleContext, axle_slides: Sequence[Slide]) -> fit.Interval | None:
    """Adhesion utilisation in these slides of an axle, by the rail under them; None if not known.

    As in `summary`, with fewer draws: it takes about half a second.
    """
    rail, _ = fit_rail(context, axle_slides, _FEW_DRAWS)
    return rail.utilisation if rail else None


def fit_rail(
    context: AxleContext, axle_slides: Sequence[Slide], draws: int | None = None
) -> tuple[fit.RailFit | None, list[Finding]]:
    """The rail under slides of an axle, and findings about what they do not show."""
    record, vehicle = context.axle.record, context.vehicle
    name = f"axle {record.axle}"
    if not axle_slides:
        return None, [Finding("no-slide", "info", channel=name)]
    if record.train_speed_made:
        return None, [Finding("rail-needs-train-speed", "info", channel=name)]
    if _has_slow_receiver(record):
        return None, [Finding("rail-needs-train-clock", "info", channel=name)]
    radius = context.radius
    observed, mu_error = points(context, axle_slides)
    if fit.clear_time(observed) < fit.SHORTEST:
        needed = {"needed_s": fit.SHORTEST}
        return None, [Finding("slides-too-short", "info", channel=name, values=needed)]
    rail = fit.fit(observed, vehicle, radius.tolerance / radius.value, mu_error, draws or fit.DRAWS)
    if rail is None:
        return None, [Finding("rail-changes", "info", channel=name)]
    findings = []
    if rail.peak_slip_limit is None:
        findings.append(Finding("peak-unknown", "info", channel=name))
    elif rail.peak_slip is None:
        values = {"share": rail.peak_slip_limit}
        findings.append(Finding("peak-below", "info", channel=name, values=values))
    if missing := ", ".join(n for n in rail.best._fields if n not in rail.constants):
        names = {"parameters": missing}
        findings.append(Finding("rail-parameters-unknown", "info", channel=name, names=names))
    return rail, findings


def _rmse(axle: AxleResult) -> float | None:
    """Rms error of slip against the log's true slip, while braked; None without a true slip."""
    true_slip, s = axle.record.true_slip, axle.slip
    if true_slip is None or s is None:
        return None
    error = np.concatenate([(s - true_slip)[x] for x in axle.applications] or [np.empty(0)])
    error = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(error**2))) if len(error) else None


def points(context: AxleContext, axle_slides: Sequence[Slide]) -> tuple[fit.Points, float]:
    """Operating points of slides and of creep close to them; 1 sigma of μ's scale.

    After a long pause the rail may be another one.
    """
    axle, vehicle = context.axle, context.vehicle
    record, ref = axle.record, axle.reference
    assert axle.slip is not None
    assert record.train_speed is not None
    sliding, on_same_rail = np.zeros((2, len(record)), dtype=np.bool_)
    for x in axle_slides:
        sliding[x.samples] = True
    runs = {x.start: x for x in (*context.creep, *(x.samples for x in axle_slides))}
    for segment in record.segments:
        inside = [runs[i] for i in sorted(runs) if segment.start <= i < segment.stop]
        group = slice(0, 0)
        for run, following in pairwise([*inside, slice(0, 0)]):
            group = slice(group.start if group.stop else run.start, run.stop)
            pause = record.t[following.start] - record.t[run.stop - 1]
            if following.stop and pause < _SAME_RAIL_PAUSE * 1e9:
                continue
            on_same_rail[group] = sliding[group].any()
            group = slice(0, 0)
    indices = np.flatnonzero(on_same_rail & np.isfinite(ref.force) & np.isfinite(axle.slip))
    mu = physics.coefficient(ref.force[indices], vehicle)
    force, mass = np.maximum(ref.force[indices], 1.0), vehicle.axle_mass
    common = 0.0 if ref.mass is None else ref.mass[indices] / force  # error of force and mass
    scale = (ref.tolerance[indices] / force) ** 2 - 2.0 * common
    variance = (float(np.median(scale)) if len(indices) else 0.0) + (
        mass.tolerance / mass.value
    ) ** 2
    error = math.sqrt(max(variance, 0.0))
    t = (record.t[indices] - record.t[0]) * 1e-9
    v = record.train_speed[indices]
    noise = context.noise[indices] / v  # of (2)
    columns = context.swing[indices], context.clock[indices], sliding[indices]
    return fit.Points(t, v, axle.slip[indices], mu, noise, *columns), error


def _around(record: AxleRecord, sigma: Floats) -> Floats:
    """Largest sigma of the reference within `_SMEARING_TIME`, shape (n,).

    Between two readings of a changing pressure, K is unknown. Its error goes into ω̇, and the
    smoother spreads it over correct readings nearby.
    """
    h = float(np.median(np.diff(record.t))) * 1e-9
    m = max(1, round(_SMEARING_TIME / h))
    padded = np.pad(np.nan_to_num(sigma), m)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * m + 1).max(axis=-1))
