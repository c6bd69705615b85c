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
from ..core.finding import Finding, merged
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
from .events import CAUGHT, Slide
from .slope import REGIONS, Bands, Params, State, init, region, step

_EVEN = 0.3  # largest deceleration of a coasting train [m/s²]
_GAINS = 0.1  # and largest acceleration: a driven wheel creeps [m/s²]
_FAST = 3.0  # least speed of a calibration, below which (2) is mostly noise [m/s]
_COASTING = 2.0  # least time of coasting for a calibration [s]
_LARGEST = 0.1  # largest correction of a wheel radius: beyond it, a unit is wrong
_BEHIND = 0.03  # where all axles are this far below the reference speed, all slide
_BETWEEN = 5.0  # after a longer pause a slide may be on another rail [s]
_MOVES = 1.0  # below this, a speed sensor may read zero, without its noise [m/s]
_NEAR = 0.2  # a wheel this close to the train's speed rolls [m/s]
_SMEARS = 0.1  # over this time the smoother of the force spreads an error [s]
_SLOWEST = 1.0  # longest time scale of noise that matters to the slope [s]
_FEW = 40  # draws for the utilisation of one brake application
_DELAY = 0.2  # 1 sigma of an unknown delay of the train speed [s]; see `_slow`
_CREEPS = 0.5  # least duration of creep that is no oscillation of the speeds [s]
_CLEARLY = 2.0  # sigma that are more than noise
_MEDIAN = 0.6745  # median of the absolute value of a normal variable of 1 sigma


def calibration(record: AxleRecord, radius: float) -> tuple[float, float] | None:
    """True over stated wheel radius, and its 1 sigma, from coasting; None without coasting.

    A wheel that is neither braked nor driven rolls: v = ωR. Acceleration shows a driven one. The
    uncertainty of the train speed's delay is one error of all readings.
    """
    if record.train_speed is None:
        return None
    v, rim = record.train_speed, record.wheel_speed * radius
    ratios, late, seconds = [], [], 0.0
    unknown = _delay_error(record, _DELAY)
    for s in record.segments:
        t = (record.t[s] - record.t[s.start]) * 1e-9
        change = np.interp(t + 0.5, t, rim[s]) - np.interp(t - 0.5, t, rim[s])
        free = (record.clamping_force[s] < physics.NO_FORCE) & (change > -_EVEN) & (change < _GAINS)
        free &= (rim[s] > _FAST) & (v[s] > _FAST)
        ratios.append(v[s][free] / rim[s][free])
        late.append(unknown[s][free])
        seconds += float(np.diff(t, prepend=t[0])[free].sum())
    ratio = np.concatenate(ratios)
    if seconds < _COASTING or len(ratio) < 10:
        return None
    # At most one value a second is independent: interpolated values repeat. A line between readings
    # has 2/3 of their variance. The spread of few values is itself uncertain.
    interval, step = record.train_speed_interval, seconds / len(ratio)
    sigma = float(np.std(ratio)) * (math.sqrt(1.5) if interval > 1.5 * step else 1.0)
    sigma *= signals.coverage_factor(max(seconds / max(interval, step) - 1.0, 1.0)) / Z95
    sigma /= math.sqrt(max(seconds / max(interval, 1.0), 1.0))
    return float(np.median(ratio)), math.hypot(sigma, float(np.median(np.concatenate(late))))


def calibrated(record: AxleRecord, vehicle: Vehicle) -> tuple[Parameter, list[Finding]]:
    """Wheel radius [m] at which the axle coasts without slip, and findings about it."""
    stated, name = vehicle.radius(record.axle), f"axle {record.axle}"
    radius = stated.value
    found = calibration(record, radius)
    if found is None:
        return stated, [Finding("wheel-not-calibrated", "info", channel=name)]
    ratio, sigma = found
    if abs(ratio - 1.0) > _LARGEST:
        return stated, []
    if abs(ratio - 1.0) <= 2.0 * sigma:
        return Parameter(radius, min(radius * sigma, stated.tolerance)), []
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
    records: Sequence[AxleRecord], every: Sequence[AxleRecord], vehicle: Vehicle, start_ns: int
) -> tuple[list[AxleRecord], list[Finding]]:
    """Records without a train speed get one estimated from all axles: `physics.reference_speed`.

    Args:
        records: the axles that need it.
        every: all axles of the log.
        vehicle: for the brake's deceleration, and the radii.
        start_ns: the log's start.
    """
    if any((np.diff(r.t) <= 0).any() for r in every):
        return list(records), [Finding("no-train-speed", "warning")]
    t = np.unique(np.concatenate([r.t for r in every]))
    rim, K = np.full((2, len(every), len(t)), np.nan)
    for i, r in enumerate(every):
        for s in r.segments:
            inside = (t >= r.t[s.start]) & (t <= r.t[s.stop - 1])
            rims = r.wheel_speed[s] * vehicle.radius(r.axle).value
            rim[i, inside] = np.interp(t[inside], r.t[s], rims)
            K[i, inside] = np.interp(t[inside], r.t[s], r.clamping_force[s])
    middle = signals.finite_median(rim)
    for i, r in enumerate(every):
        own = replace(r, train_speed=np.interp(r.t, t, middle))
        found = calibration(own, vehicle.radius(r.axle).value) if len(every) > 1 else None
        if found and abs(found[0] - 1.0) < _LARGEST:
            rim[i] *= found[0]
    known = np.isfinite(rim).any(axis=0)
    fastest = np.where(known, np.max(np.nan_to_num(rim, nan=-np.inf), axis=0), np.nan)
    w = physics.wheelset(vehicle, every[0].axle)
    braking = physics.braked(np.nan_to_num(signals.finite_median(K)), w)
    v = np.empty(len(t))
    seconds = (t - t[0]) * 1e-9
    compiled.function(_follow)(seconds, fastest, braking, v)
    findings = [Finding("reference-speed", "info", values={"axles": len(every)})]
    behind = (fastest < (1.0 - _BEHIND) * v) & (v > _FAST)
    if behind.any():
        at = (t - start_ns) * 1e-9
        spans = merged([(float(at[a]), float(at[b - 1])) for a, b in signals.true_runs(behind)])
        findings.append(Finding("all-axles-slide", "warning", count=int(behind.sum()), spans=spans))
    made = [
        replace(
            r, train_speed=np.interp(r.t, t, v), train_speed_late=Parameter(0.0, 0.0),
            train_speed_made=True,
        )
        for r in records
    ]  # fmt: skip
    return made, findings


# Slope and region


def _march(  # noqa: PLR0913 (compiled: one array each)
    p: Params, bands: Bands, t: Times, slip: Floats, mu: Floats, slip_noise: Floats,
    mu_noise: Floats, slope: Floats, sure: Floats, code: Regions,
) -> None:  # fmt: skip
    """`slope.step` over one segment."""
    s: State = init(p, slip[0], mu[0])
    for i in range(len(t)):
        if i > 0:
            h = (t[i] - t[i - 1]) * 1e-9
            s = step(p, s, h, slip[i], mu[i], slip_noise[i], mu_noise[i])
        slope[i] = s.slope
        sure[i] = s.confidence
        code[i] = region(slip[i], s.slope, bands)


def speed_noise(record: AxleRecord, radius: float) -> Floats:
    """1 sigma of the noise of v − ωR [m/s] while braked and moving, shape (n,).

    The train speed's noise is its second difference over three values a time apart: the largest for
    times up to `_SLOWEST`, as a receiver's filter makes noise slow. The train's motion bends v,
    too: the smaller counts of v itself and of v − ωR of a rolling wheel. Where v bends more than
    its noise, as when the train stops between two samples, that bend is the error.
    """
    assert record.train_speed is not None
    v, rim = record.train_speed, record.wheel_speed * radius
    braked = (record.clamping_force > physics.NO_FORCE) & (v > _MOVES)
    rolls = braked & (np.abs(v - rim) < np.maximum(CAUGHT * v, _NEAR))
    h = float(np.median(np.diff(record.t))) * 1e-9
    train = 0.0
    for m in sorted({round(x) for x in np.geomspace(1, max(1, round(_SLOWEST / h)), 8)}):
        levels = [
            float(np.median(known)) / _MEDIAN
            for x, used in ((v, braked), (v - rim, rolls))
            if len(known := (bend := _bend(record, x, m))[used & np.isfinite(bend)]) > 10 * m
        ]
        train = max(train, min(levels, default=0.0))
    wheel = np.nanmedian(np.where(v > _MOVES, _bend(record, rim, 1), np.nan)) / _MEDIAN
    between = _bend(record, v, max(1, round(record.train_speed_interval / h))) / _CLEARLY
    found: Floats = np.hypot(np.fmax(train, between), np.nan_to_num(wheel))
    return found


def slowing(record: AxleRecord) -> Floats:
    """Deceleration of the train over about a second [m/s²], at least 0, shape (n,)."""
    assert record.train_speed is not None
    found = np.zeros(len(record))
    for s in record.segments:
        t, v = (record.t[s] - record.t[s.start]) * 1e-9, np.nan_to_num(record.train_speed[s])
        before, after = np.maximum(t - 0.5, t[0]), np.minimum(t + 0.5, t[-1])
        found[s] = (np.interp(before, t, v) - np.interp(after, t, v)) / (after - before)
    return np.maximum(found, 0.0)


def _slow(record: AxleRecord) -> bool:
    """Whether the train speed's delay is unknown and may be two of its long intervals."""
    return record.train_speed_late is None and record.train_speed_interval > _DELAY


def _speed_error(record: AxleRecord, unknown: float = 0.0) -> Floats:
    """1 sigma of slip by the train speed's delay and drift, one error for all, shape (n,).

    Args:
        record: of an axle.
        unknown: σ_τ of an unknown delay [s]; for a slow receiver, its interval counts.
    """
    if record.train_speed is None:
        return np.zeros(len(record))
    own = record.train_speed_sigma
    with np.errstate(divide="ignore", invalid="ignore"):
        of_itself = 0.0 if own is None else own / record.train_speed
    return np.hypot(_delay_error(record, unknown), of_itself)


def _delay_error(record: AxleRecord, unknown: float) -> Floats:
    """1 sigma of slip by the uncertain delay of the train speed, σ_τ (−v̇)/v, shape (n,)."""
    assert record.train_speed is not None
    late = record.train_speed_late
    unknown = record.train_speed_interval if _slow(record) else unknown
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Floats = (late.tolerance if late else unknown) * slowing(record) / record.train_speed
    return found


def _bend(record: AxleRecord, x: Floats, m: int) -> Floats:
    """Second difference of x over m samples, as 1 sigma of noise; shape (n,)."""
    found = np.full(len(x), np.nan)
    for s in record.segments:
        if s.stop - s.start > 2 * m:
            y = x[s]
            found[s][m:-m] = np.abs(y[2 * m :] - 2.0 * y[m:-m] + y[: -2 * m]) / math.sqrt(6.0)
    return found


def observed(
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
    radius, findings = calibrated(record, vehicle)
    slip = physics.slip(record.train_speed, record.wheel_speed, radius.value, slowest)
    mu = physics.coefficient(axle.reference.force, vehicle)  # [S1]
    with np.errstate(divide="ignore", invalid="ignore"):
        of_speeds = speed_noise(record, radius.value) / record.train_speed  # noise of (2)
        lasting = _speed_error(record)
        # The slope's filter passes only the change within 1/δ of an error that follows −v̇/v.
        slip_noise = np.hypot(of_speeds, lasting * slowing(record) / record.train_speed / p.delta)
    mu_noise = physics.coefficient(axle.reference.sigma, vehicle)
    n = len(record)
    slope, sure, code = np.full(n, np.nan), np.zeros(n), np.zeros(n, np.int8)
    march = compiled.function(_march)
    for s in record.segments:
        noise = slip_noise[s], mu_noise[s]
        march(p, bands, record.t[s], slip[s], mu[s], *noise, slope[s], sure[s], code[s])
    done = replace(
        axle, slip=slip, slip_noise=of_speeds, slope=slope, slope_confidence=sure, region=code
    )
    if record.train_speed_late is None and any(
        np.median(slowing(record)[x.where]) > _EVEN for x in _slides(done, slip, slip)
    ):
        found, name = Finding("train-speed-delay-unknown", "info"), f"axle {record.axle}"
        if _slow(record):
            delay = {"delay_s": 2.0 * record.train_speed_interval}
            found = Finding("train-speed-slow", "warning", values=delay)
        findings.append(replace(found, channel=name))
    told = events.of_axle(record.axle, slides(done), record.segments, record.t, code)
    return replace(done, events=told), findings


# Slides and shares


def slides(axle: AxleResult) -> list[Slide]:
    """Slides of a braked axle, in the order of time; none reaches across segments.

    Slip within the error and noise of the train speed is no slide. With an unknown delay of a slow
    receiver, the slides have the least slip that is certain.
    """
    if axle.slip is None:
        return []
    clear = _clear(axle.record, axle.slip)
    return _slides(axle, clear if _slow(axle.record) else axle.slip, clear)


def _slides(axle: AxleResult, s: Floats, clear: Floats) -> list[Slide]:
    """The same of a slip, and of the part of it that is certain, shape (n,).

    The brake is applied in a slide, or was a second before.
    """
    record, found = axle.record, []
    assert record.train_speed is not None
    columns = record.t, record.train_speed, s, clear, axle.reference.force
    at_least = record.train_speed_made or _slow(record)
    depth = None if axle.slip_noise is None else _CLEARLY * axle.slip_noise
    for part in record.segments:
        for x in events.slides(part, *columns, at_least, depth):
            before = record.t[: x.where.start]
            first = int(np.searchsorted(before, record.t[x.where.start] - 1_000_000_000))
            if (record.clamping_force[first : x.where.stop] > 0.0).any():
                found.append(x)
    return found


def _clear(record: AxleRecord, s: Floats) -> Floats:
    """Slip minus the possible error of the train speed, shape (n,)."""
    return s - 2.0 * _speed_error(record)


def limited_from(axle: AxleResult, begin: int, end: int) -> int | None:
    """When adhesion first limits the wheel, between two times [ns]; None where it does not.

    With a WSP this is before the first slide: at the first lasting creep above a rolling wheel's.
    """
    record, s = axle.record, axle.slip
    if s is None or record.train_speed is None:
        return None
    runs = [x.where for x in slides(axle)] + creeps(record, s)
    starts = [int(record.t[x.start]) for x in runs]
    return min((t for t in starts if begin <= t <= end), default=None)


def creeps(record: AxleRecord, s: Floats) -> list[slice]:
    """Where a braked wheel has lasting slip above a rolling wheel's, in the order of time."""
    creeps, found = (_clear(record, s) > CAUGHT) & (record.clamping_force > 0.0), []
    for part in record.segments:
        for first, past in signals.true_runs(creeps[part]):
            run = slice(part.start + first, part.start + past)
            if record.t[run.stop - 1] - record.t[run.start] >= _CREEPS * 1e9:
                found.append(run)
    return found


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
    late: Parameter | None  # delay of the train speed, corrected [s]; None: not known


def summary(axle: AxleResult, vehicle: Vehicle) -> tuple[Summary, list[Finding]]:
    """Slides, shares, rail, peak and adhesion utilisation of an axle."""
    found = slides(axle)
    rail, findings = fitted(Whole(axle, vehicle), found)
    late = None if axle.record.train_speed_made else axle.record.train_speed_late
    return Summary(axle.record.axle, shares(axle), found, rail, _rmse(axle), late), findings


class Whole:
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
        return calibrated(self.axle.record, self.vehicle)[0]

    @cached_property
    def noise(self) -> Floats:
        """1 sigma of v − ωR [m/s], (n,)."""
        return speed_noise(self.axle.record, self.radius.value)

    @cached_property
    def clock(self) -> Floats:
        """1 sigma of slip by the train speed, (n,)."""
        return _speed_error(self.axle.record, _DELAY)

    @cached_property
    def swing(self) -> Floats:
        """1 sigma of μ by the reference, (n,)."""
        return physics.coefficient(
            _around(self.axle.record, self.axle.reference.sigma), self.vehicle
        )

    @cached_property
    def creeps(self) -> list[slice]:
        """Where it creeps, as `creeps`."""
        assert self.axle.slip is not None
        return creeps(self.axle.record, self.axle.slip)


def unknown(record: AxleRecord, where: slice, vehicle: Vehicle) -> tuple[Bools, float]:
    """Where the wheel turns and the train speed is not known, and for how long [s].

    Args:
        record: the axle's record.
        where: a brake application.
        vehicle: for the radius.

    Returns:
        A mask of the brake application, shape (m,), and its time.
    """
    mask: Bools = record.wheel_speed[where] * vehicle.radius(record.axle).value > physics.CRAWL
    if record.train_speed is not None:
        mask &= ~np.isfinite(record.train_speed[where])
    h = np.diff(record.t[where], append=record.t[where.stop - 1])
    typical = np.minimum(h, 2.0 * np.median(h))  # without the time of a gap
    return mask, float(typical[mask].sum()) * 1e-9


def utilisation(whole: Whole, found: Sequence[Slide]) -> fit.Interval | None:
    """Adhesion utilisation in these slides of an axle, by the rail under them; None if not known.

    As in `summary`, with fewer draws: it takes about half a second.
    """
    rail, _ = fitted(whole, found, _FEW)
    return rail.utilisation if rail else None


def fitted(
    whole: Whole, found: Sequence[Slide], draws: int | None = None
) -> tuple[fit.RailFit | None, list[Finding]]:
    """The rail under slides of an axle, and findings about what they do not show."""
    record, vehicle = whole.axle.record, whole.vehicle
    name = f"axle {record.axle}"
    if not found:
        return None, [Finding("no-slide", "info", channel=name)]
    if record.train_speed_made:
        return None, [Finding("rail-needs-train-speed", "info", channel=name)]
    if _slow(record):
        return None, [Finding("rail-needs-train-clock", "info", channel=name)]
    radius = whole.radius
    seen, mu_error = points(whole, found)
    if fit.clear_time(seen) < fit.SHORTEST:
        needed = {"needed_s": fit.SHORTEST}
        return None, [Finding("slides-too-short", "info", channel=name, values=needed)]
    rail = fit.fit(seen, vehicle, radius.tolerance / radius.value, mu_error, draws or fit.DRAWS)
    if rail is None:
        return None, [Finding("rail-changes", "info", channel=name)]
    findings = []
    if rail.below is None:
        findings.append(Finding("peak-unknown", "info", channel=name))
    elif rail.peak_slip is None:
        below = {"share": rail.below}
        findings.append(Finding("peak-below", "info", channel=name, values=below))
    if missing := ", ".join(n for n in rail.best._fields if n not in rail.told):
        names = {"parameters": missing}
        findings.append(Finding("rail-parameters-unknown", "info", channel=name, names=names))
    return rail, findings


def _rmse(axle: AxleResult) -> float | None:
    """Rms error of slip against the log's true slip, while braked; None without a true slip."""
    true, s = axle.record.true_slip, axle.slip
    if true is None or s is None:
        return None
    error = np.concatenate([(s - true)[x] for x in axle.applications] or [np.empty(0)])
    error = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(error**2))) if len(error) else None


def points(whole: Whole, found: Sequence[Slide]) -> tuple[fit.Points, float]:
    """Operating points of slides and of creep close to them; 1 sigma of μ's scale.

    After a long pause the rail may be another one.
    """
    axle, vehicle = whole.axle, whole.vehicle
    record, ref = axle.record, axle.reference
    assert axle.slip is not None
    assert record.train_speed is not None
    sliding, near = np.zeros((2, len(record)), dtype=np.bool_)
    for x in found:
        sliding[x.where] = True
    runs = {x.start: x for x in (*whole.creeps, *(x.where for x in found))}
    for segment in record.segments:
        inside = [runs[i] for i in sorted(runs) if segment.start <= i < segment.stop]
        together = slice(0, 0)
        for run, after in pairwise([*inside, slice(0, 0)]):
            together = slice(together.start if together.stop else run.start, run.stop)
            pause = record.t[after.start] - record.t[run.stop - 1]
            if after.stop and pause < _BETWEEN * 1e9:
                continue
            near[together] = sliding[together].any()
            together = slice(0, 0)
    at = np.flatnonzero(near & np.isfinite(ref.force) & np.isfinite(axle.slip))
    mu = physics.coefficient(ref.force[at], vehicle)
    force, mass = np.maximum(ref.force[at], 1.0), vehicle.axle_mass
    common = 0.0 if ref.mass is None else ref.mass[at] / force  # error of force and mass
    scale = (ref.tolerance[at] / force) ** 2 - 2.0 * common
    variance = (float(np.median(scale)) if len(at) else 0.0) + (mass.tolerance / mass.value) ** 2
    error = math.sqrt(max(variance, 0.0))
    t = (record.t[at] - record.t[0]) * 1e-9
    v = record.train_speed[at]
    noise = whole.noise[at] / v  # of (2)
    of = whole.swing[at], whole.clock[at], sliding[at]
    return fit.Points(t, v, axle.slip[at], mu, noise, *of), error


def _around(record: AxleRecord, sigma: Floats) -> Floats:
    """Largest sigma of the reference within `_SMEARS`, shape (n,).

    Between two readings of a changing pressure, K is unknown. Its error goes into ω̇, and the
    smoother spreads it over correct readings nearby.
    """
    h = float(np.median(np.diff(record.t))) * 1e-9
    m = max(1, round(_SMEARS / h))
    wide = np.pad(np.nan_to_num(sigma), m)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(wide, 2 * m + 1).max(axis=-1))
