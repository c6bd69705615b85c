"""Whether the pressure explains how the train slows: units, clocks, stuck sensors, other brakes.

While every wheel rolls, (1) gives the train's deceleration from K alone.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..core.finding import Finding, Severity
from ..core.model import Z95, Bools, Floats
from ..core.physics import GRADIENT, LOCKING, G, clamping_force
from ..core.units import listed, others
from ..dynamics import longitudinal
from ..dynamics.train_grid import FREE, LEAST, Scene, far, largest, lasting
from ..records.outliers import HIGHEST

_FASTEST = 500.0 / 3.6  # no train is faster [m/s]
_HARDEST = 3.0  # no rail brakes a rolling wheel harder for long [m/s²]
_STARTING = 1.5  # nor does a train start harder [m/s²]
_CHANGES = 0.15  # deceleration by which a gradient changes between two brakes [m/s²]
_SLIDING = 1.0  # more than another brake usually adds, less than a slide [m/s²]
_UNBRAKED = 0.5  # deceleration without pressure that no gradient explains [m/s²]
_LASTS = 3.0  # and no slide protection [s]
_CLEAR = 0.8  # share of the deceleration that goes with K where both are right
_CLEARER = 0.9  # the same where K hardly varies: a wheel that locks slows evenly, too
_NEAR = 1.12  # as near as this to a unit's factor, the unit is the likely cause
_ABSURD = 30.0  # no slide explains that either
_ANY_VEHICLE = 6.0  # no vehicle is that far from another
_PADS = 0.05, 0.6  # cast iron at high speed has less friction than any other, no pad more; ours
_AXLES = 2e3, 45e3  # per axle, from an empty tram to a loaded ore wagon [kg]
_STOPS = 0.5  # of its speed: what rollers hold, or a gradient, loses less
_BESIDE = 5.0  # before and after a brake, the train coasts on the same gradient [s]
_LATE = 0.25  # an offset of clocks that makes the force wrong in every build-up [s]


# Values that no train has


def impossible(s: Scene) -> Iterator[Finding]:
    """Speeds and pressures that no train has."""
    for i, (a, rim) in enumerate(zip(s.axles, s.grid.rim, strict=True)):
        if (fast := rim > _FASTEST).any():
            peak = float(np.nanmax(rim))
            likely = others(a.speed, s.vehicle, lambda x: 5.0 < x * peak < 120.0)  # noqa: B023
            text = (
                f"the wheel runs at up to {3.6 * peak:.0f} km/h: "
                f"state the unit in [channels] speed{listed(likely)}"
            )
            yield s.told("unit-suspect", "warning", text, a.speed, fast, i)
    for i, (a, pressure) in enumerate(zip(s.axles, s.grid.pressure, strict=True)):
        if (high := pressure > HIGHEST).any():
            top = float(np.nanmax(pressure))
            likely = others(a.brake, s.vehicle, lambda x: 1e5 < x * top < 1e6)  # noqa: B023
            text = (
                f"a cylinder pressure of up to {top / 1e5:.0f} bar: "
                f"state the unit in [channels] pressure{listed(likely)}"
            )
            yield s.told("unit-suspect", "warning", text, a.brake, high, i)


def too_hard(s: Scene) -> Iterator[Finding]:
    """Wheels that stop harder than any brake does."""
    slowing = -s.grid.slope(s.grid.rim)
    moving = np.isfinite(slowing) & (s.grid.rim > 0.1 * np.nanmax(s.grid.rim, initial=0.0))
    hard = slowing > LOCKING
    if moving.any() and hard[moving].mean() > 0.25:
        text = (
            f"the wheels slow by {np.median(slowing[moving & hard]):.0f} m/s² at the rim, more "
            "than any brake does: state the units of time and speed in [channels]"
            f"{s.unless_sliding}"
        )
        yield s.told("unit-suspect", "warning", text, s.axles[0].speed, largest(slowing) > LOCKING)


# Another brake, another clock, another unit or vehicle


def unbraked(s: Scene) -> Iterator[Finding]:
    """The train brakes, and no cylinder has the pressure for it."""
    g, brake, top = s.grid, s.axles[0].brake, float(np.nanmax(s.grid.pressure, initial=0.0))
    alone = (g.braking > _UNBRAKED) & (g.braking < _HARDEST) & g.rolling.any(axis=0)
    alone &= g.mean(largest(g.clamping)) * s.by_rolling < 0.1 * _UNBRAKED
    long = lasting(alone, _LASTS, g)
    if not long.any():
        return
    text = f"the wheels slow by {float(np.median(g.braking[long])):.1f} m/s²"
    likely = others(brake, s.vehicle, lambda x: 1e5 < x * top < 1e6)
    if likely and _alike(np.mean(g.pressure, axis=0), g.braking):
        code = "unit-suspect"
        text += (
            f" with a pressure of at most {top / 1e5:.2g} bar: "
            f"state its unit in [channels] pressure{listed(likely)}"
        )
    else:
        code = "brake-unknown"
        text += (
            f" without pressure: a stuck sensor, a wrong unit{listed(likely)}, or another brake, "
            "whose force (1) does not know; name pressure and unit in [channels], or leave these "
            "times out with --from and --to"
        )
    yield s.told(code, "warning", text, brake, long)


def explained(s: Scene) -> Iterator[Finding]:
    """Another force line, or a pressure with another clock: which of them, or that it is one."""
    late, line, either = s.explanation
    if line is None:
        if abs(late.value) > _LATE:
            yield _late(s, "warning")
        return
    absurd = not 1.0 / _ANY_VEHICLE < line.scale < _ANY_VEHICLE
    if absurd and (fit := _fit(s)) and fit.slope > 0.0 and _as_stated(s, fit.slope):
        return  # by (1), which holds in slides too, the train slows as it should
    doubt = ""
    if either:
        doubt = "; what is logged cannot tell this from {}: log a brake's build-up and release"
    if not late.value and (told := list(another_factor(s))):
        yield from told
    elif not _as_stated(s, line.scale):
        yield _another(s, line.scale, "warning", doubt.format("a pressure with another clock"))
    else:
        way = "less" if line.offset > 0.0 else "more"
        text = (
            f"the train slows as by {abs(line.offset):.0f} N {way} clamping force than (15) gives "
            "at every pressure: check spring_force and the cylinder in [vehicle], and the pressure "
            f"sensor's zero{s.unless_sliding}{doubt.format('a pressure with another clock')}"
        )
        yield s.told("vehicle-suspect", "warning", text, s.axles[0].brake)
    if late.value:
        yield _late(s, "warning", doubt.format("another vehicle than stated"))


def late_pressure(s: Scene) -> Iterator[Finding]:
    """A delay as valves, hoses and filters make it."""
    late, line, _ = s.explanation
    if line is None and 0.0 < abs(late.value) <= _LATE:
        yield _late(s, "info")


def _late(s: Scene, severity: Severity, doubt: str = "") -> Finding:
    late = s.explanation.late
    way = "behind" if late.value > 0.0 else "ahead of"
    text = (
        f"the pressure is {abs(late.value):.2f} s (± {Z95 * late.tolerance:.2f}) {way} what it "
        "does to the wheels, and the force is wrong by that wherever the pressure changes: the "
        "reference's band holds it, estimators see it as logged; correct the time stamps by that, "
        f"or what the valve, the transducer or averaging takes{s.unless_sliding}{doubt}"
    )
    return s.told("pressure-clock-offset", severity, text, s.axles[0].brake)


def another_factor(s: Scene) -> Iterator[Finding]:
    """The train slows as many times as hard as the pressure explains, all along."""
    fit = _fit(s)
    if fit is None or not _clear(fit):
        return
    if s.grid.train is not None and (rolling := _fit(s, rolls=True)) and _clear(rolling):
        fit = rolling if fit.slope <= 0.0 or not _as_stated(s, fit.slope) else fit
    factor = fit.slope
    gradient = _CHANGES if fit.varied else GRADIENT
    if factor <= 0.0 or abs(factor - 1.0) * fit.top < gradient:
        return
    if _as_stated(s, factor):
        return
    # Braked all the time and hardly slower for it: a rig or a gradient does that too.
    held = not fit.varied and factor < 1.0 and not fit.slows
    yield _another(s, factor, "info" if held else "warning")


def _as_stated(s: Scene, factor: float) -> bool:
    """Whether the stated tolerances allow that the train slows so many times as hard."""
    allowed = longitudinal.SIGMAS * longitudinal.tolerance(s.vehicle)
    return abs(math.log(factor)) < math.log1p(allowed)


def _another(s: Scene, factor: float, severity: Severity, doubt: str = "") -> Finding:
    """That the train slows so many times as hard as it should."""
    allowed = longitudinal.SIGMAS * longitudinal.tolerance(s.vehicle)
    suspects = "axle_mass, lever_ratio, friction and the cylinder in [vehicle]"
    units = _that_explain(s, factor)
    code = "unit-suspect"
    text = f"the train slows {factor:.3g} times as hard as the pressure explains by (1)"
    if units:
        text += f": it would fit with {' or '.join(units)}; state the unit in [channels]"
        text += f", or check {suspects}"
    elif 1.0 / _ANY_VEHICLE < factor < _ANY_VEHICLE:
        code = "vehicle-suspect"
        phi, mass = factor * s.vehicle.friction.value, s.vehicle.axle_mass.value / factor
        fits = [f"friction = {phi:.2g}"] * (_PADS[0] < phi < _PADS[1])
        fits += [f"axle_mass = {mass:.0f}"] * (_AXLES[0] < mass < _AXLES[1])
        text += (
            f", the stated tolerances allow {100.0 * allowed:.0f} %: it would fit with "
            f"{' or '.join(fits) or 'no friction and no axle_mass that exist'}; "
            f"check {suspects}, the pressure at rest, and whether "
            f"{'an electric brake' if factor > 1.0 else 'traction'} or a gradient comes and goes "
            "with the brake"
        )
        if factor > 1.0 and s.grid.slid_together:
            severity = "info"
            text += ", unless every wheel slid, as one that gains speed beside its brake says"
    else:
        text += f": check the units in [channels], and {suspects}"
    if factor > 1.0:
        text += s.unless_sliding
    return s.told(code, severity, text + doubt, s.axles[0].brake)


def unexplained(s: Scene) -> Iterator[Finding]:
    """For a while the train slows more, or less, than the pressure explains elsewhere.

    An axle that slides is braked less than its pressure says, never more; vehicles that are not in
    the log may slide less than those that are.
    """
    g = s.grid
    made, x, y = s.made, s.by_rolling * g.mean(np.mean(g.clamping, axis=0)), g.braking
    known = np.isfinite(x) & (y < _HARDEST) & (y > -_STARTING)
    sure = known & np.isfinite(made)
    line = _line(made, y, sure)
    slope, level = line or (1.0, 0.0)
    most, least = (slope * f(made, x) + level for f in (np.fmax, np.fmin))
    allowed = 0.2 + (0.15 if line else 3.0 * longitudinal.tolerance(s.vehicle)) * np.fmax(most, y)
    for where, way, off in (
        (known & (sure | g.rolling.any(axis=0)) & (y - most > allowed), "more", y - most),
        (sure & (least - y > allowed) & (x > FREE * np.nanmax(x, initial=0.0)), "less", least - y),
    ):
        long = lasting(where, _LASTS, g)
        if not long.any():
            continue
        size = float(np.median(off[long]))
        # Nothing says that a single wheel rolls.
        slides = g.train is None and len(s.axles) == 1 and way == "more" and size > _SLIDING
        # Where the force itself was measured and nothing ever slows, rollers hold the speed.
        measured = s.axles[0].brake.meaning == "clamping_force"
        rig = measured and way == "less" and not (y[known] > _UNBRAKED).any()
        severity: Severity = "warning" if size > GRADIENT and not rig else "info"
        text = (
            f"the train slows {size:.1f} m/s² {way} than the pressure explains, and not so "
            f"elsewhere: {'a long slide, ' * slides}a stuck, cut off or drifting pressure sensor, "
            f"another brake, {'a rig, ' * rig}or a gradient of {100.0 * size / G:.0f} %; "
            "leave these times out with --from and --to"
        )
        yield s.told("pressure-suspect", severity, text, s.axles[0].brake, long)


def _line(x: Floats, y: Floats, used: Bools) -> tuple[float, float] | None:
    """Slope and level of the line that most of the samples follow, None where they do not.

    Beginning with what is stated of the vehicle, and with what fits all.
    """
    best, many = None, max(LEAST, int(used.sum()) // 3)
    for start in ((1.0, 0.0), _fitted(x[used], y[used])):
        slope, level = start
        for _ in range(5):
            near = used & (np.abs(y - slope * x - level) < 0.15 + 0.1 * np.fmax(x, y))
            if near.sum() < many or np.ptp(x[near]) < 0.3 * np.max(x[used]):
                break
            slope, level = _fitted(x[near], y[near])
        if near.sum() >= many and 0.3 < slope < 3.0:
            best, many = (slope, level), int(near.sum()) + 1
    return best


def _fitted(x: Floats, y: Floats) -> tuple[float, float]:
    """Slope and level of the straight line through samples; slope 0 where x does not vary."""
    if not len(x):
        return 0.0, 0.0
    spread = float(np.var(x))
    slope = float(np.mean((x - x.mean()) * (y - y.mean()))) / spread if spread else 0.0
    return slope, float(y.mean() - slope * x.mean())


class _Fit(NamedTuple):
    """Deceleration of the train as a line over the one that its wheels make."""

    slope: float
    explained: float  # share of the deceleration's square
    top: float  # highest that they make [m/s²]
    varied: bool  # that did, so that the slope is the brake's alone
    slows: bool  # by much of its speed, as no rig does


def _fit(s: Scene, rolls: bool = False) -> _Fit | None:
    """None where the log has too little of a brake application that says how the train slows.

    Args:
        s: the log.
        rolls: only where all wheels do, by K alone. Else their inertia is measured: wheels that
            slow harder than is true are left no adhesion by it.
    """
    g = s.grid
    K = g.mean(np.mean(g.clamping, axis=0))
    made = np.where(g.rolling.all(axis=0), s.by_rolling * K, np.nan) if rolls else s.made
    used = np.isfinite(g.braking) & np.isfinite(made)
    used &= ~far(FREE * np.nanmax(K, initial=0.0) > K, round(_BESIDE / g.step))
    if used.sum() < LEAST or not (K[used] > 0.0).any():
        return None
    x, y = made[used], g.braking[used]
    low, high = np.percentile(x, [5.0, 95.0])
    level = 0.0  # braked all the time: no telling a gradient from the brake
    slope = float(x @ y / (x @ x))
    whole = float(y @ y)
    varied = bool(high - low > 0.5 * float(x.max()))
    if varied:
        slope, level = _fitted(x, y)
        whole = float(np.sum((y - y.mean()) ** 2))
    left = float(np.sum((y - slope * x - level) ** 2))
    speed = g.fastest[used]
    slows = bool(np.nanmin(speed) < _STOPS * np.nanmax(speed))
    return _Fit(slope, 1.0 - left / whole if whole else 0.0, float(x.max()), varied, slows)


def _clear(fit: _Fit) -> bool:
    """Whether the line explains how the train slows."""
    absurd = not 1.0 / _ABSURD < fit.slope < _ABSURD
    return fit.explained >= (0.5 if absurd else _CLEAR if fit.varied else _CLEARER)


def _alike(x: Floats, y: Floats) -> bool:
    """Whether two columns rise and fall together."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < LEAST or not np.ptp(x) or not np.ptp(y):
        return False
    return float(np.corrcoef(x, y)[0, 1]) > 0.9


def _that_explain(s: Scene, factor: float) -> list[str]:
    """What could be in another unit, so that the pressure explains the deceleration."""
    near = _NEAR if 1.0 / _ANY_VEHICLE < factor < _ANY_VEHICLE else 1.6

    def one(x: float) -> bool:
        return abs(math.log(x)) < math.log(near)

    a, g, vehicle = s.axles[0], s.grid, s.vehicle
    K = float(np.nanmean(g.clamping))

    def pressed(times: float) -> bool:
        p = times * g.pressure[np.isfinite(g.pressure)]
        return one(factor * K / max(float(np.mean(clamping_force(p, vehicle))), 1e-9))

    # The train's deceleration is the train speed's, where there is one.
    by_train = a.train if g.train is not None else None
    speed = others(by_train or a.speed, vehicle, lambda x: one(factor * x))
    what = "train speed (and the wheels' by the same factor)" if by_train else "wheel speed"
    by_pressure = a.brake.meaning == "pressure"
    brake = others(a.brake, vehicle, pressed if by_pressure else lambda x: one(factor / x))
    found = [f"{what} in {u}" for u in speed]
    found += [f"{'pressure' if by_pressure else 'clamping force'} in {u}" for u in brake]
    for times, what in ((1e-3, "ms for s, or us for ms"), (1e3, "s for ms, or ms for us")):
        if one(factor / times):
            found.append(f"time in another unit ({what})")
    return found
