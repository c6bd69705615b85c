"""A train that slows otherwise than the stated vehicle does by its pressure.

First the joint fit of all brake applications: another factor or offset of the force line. Where it
sees no build-up or release, the deceleration over the whole of the brakes.
"""

import math
from collections.abc import Callable, Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding, Severity
from ...core.model import Quantity
from ...core.physics import GRADIENT, clamping_force
from ...core.units import others
from ...dynamics import longitudinal
from ...dynamics.train_grid import FREE, LEAST, Scene, far
from ..registry import About
from .impossible_values import named

ABOUT = About("Vehicle as stated", "force", 40)


class Params(NamedTuple):
    """Thresholds."""

    sigmas: Annotated[
        float, Quantity("-", "of the stated tolerances: 1 sound vehicle of 2000", 1.0)
    ] = 3.5
    changes: Annotated[
        float, Quantity("m/s²", "by which a gradient changes between two brakes", 0.0)
    ] = 0.25
    clear: Annotated[
        float, Quantity("-", "of the deceleration that must go with the pressure", 0.0, 1.0)
    ] = 0.8
    clearer: Annotated[
        float, Quantity("-", "where it hardly varies, as a locking wheel slows evenly", 0.0, 1.0)
    ] = 0.9
    known: Annotated[
        float, Quantity("-", "1 sigma of the response to one change of the pressure", 0.0)
    ] = 0.2
    beside: Annotated[
        float, Quantity("s", "of coasting beside a brake, on the same gradient", 0.0)
    ] = 5.0
    near: Annotated[
        float, Quantity("-", "factor from a unit's: nearer, the unit is the cause", 1.0)
    ] = 1.12
    any_vehicle: Annotated[
        float, Quantity("-", "no vehicle differs from another by this factor", 1.0)
    ] = 6.0


class _Line(NamedTuple):
    """Deceleration of the train over the one that its wheels make."""

    slope: float
    explained: float  # share of the deceleration's square
    top: float  # highest that they make [m/s²]
    varied: bool  # that did, so that the slope is the brake's alone
    slows: bool  # to half its speed, as no rig does


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Another factor, unit or offset, and whether a delay would explain the same."""
    late, line, either, *_ = s.explanation
    if line is None:
        if not late.value:
            yield from _by_level(p, s)
        return
    absurd = not 1.0 / p.any_vehicle < line.scale < p.any_vehicle
    if absurd and (level := _level(p, s)) and level.slope > 0.0 and _stated(p, s, level.slope):
        return  # by its wheels, which holds in slides too, the train slows as it should
    factor = max((line.scale, line.factor), key=lambda x: abs(math.log(max(x, 1e-3))))
    if not late.value and (found := list(_by_level(p, s))):
        yield from found
    elif factor > 0.0 and not _stated(p, s, factor):
        yield _another(p, s, factor, "warning")
    else:
        values = {"offset_n": -line.offset}
        yield s.found("force-offset", "warning", s.axles[0].brake, values=values)
    if either:
        yield s.found("delay-or-vehicle", "info", s.axles[0].brake)


def _by_level(p: Params, s: Scene) -> Iterator[Finding]:
    """The train slows as many times as hard as the pressure explains, all along."""
    line, seen = _level(p, s), [r.value for r in s.explanation.responses]
    known = np.array([r for r in seen if r.tolerance < p.known])
    if line is None or not _clear(p, line):
        return
    if len(known):  # responses to changes hold on any gradient
        mean = float(np.average(known[:, 0], weights=known[:, 1] ** -2.0))
        if mean > 0.0 and _stated(p, s, mean):
            return
    if s.grid.train is not None and (rolling := _level(p, s, rolls=True)) and _clear(p, rolling):
        line = rolling if line.slope <= 0.0 or not _stated(p, s, line.slope) else line
    factor = line.slope
    gradient = p.changes if line.varied else GRADIENT
    if factor <= 0.0 or abs(factor - 1.0) * line.top < gradient or _stated(p, s, factor):
        return
    # Braked all the time and hardly slower for it: a rig or a gradient does that too.
    held = not line.varied and factor < 1.0 and not line.slows
    yield _another(p, s, factor, "info" if held else "warning")


def _stated(p: Params, s: Scene, factor: float) -> bool:
    """Whether the stated tolerances allow that the train slows so many times as hard."""
    return abs(math.log(factor)) < math.log1p(p.sigmas * longitudinal.tolerance(s.vehicle))


def _another(p: Params, s: Scene, factor: float, severity: Severity) -> Finding:
    """That the train slows so many times as hard as it should."""
    brake, units = s.axles[0].brake, _units(p, s, factor)
    values = {"factor": factor}
    if units or not 1.0 / p.any_vehicle < factor < p.any_vehicle:
        names = {"candidates": named(units)}
        return s.found("deceleration-unit-suspect", severity, brake, None, 0, values, names)
    if factor > 1.0 and s.grid.slid_together:
        severity = "info"
    friction, mass = factor * s.vehicle.friction.value, s.vehicle.axle_mass.value / factor
    # No pad has another friction; an axle is one of an empty tram to a loaded ore wagon.
    fits = [f"friction = {friction:.2g}"] * (0.05 < friction < 0.6)
    fits += [f"axle_mass = {mass:.0f}"] * (2e3 < mass < 45e3)
    names = {"fits": named(fits)}
    return s.found("vehicle-suspect", severity, brake, None, 0, values, names)


def _level(p: Params, s: Scene, rolls: bool = False) -> _Line | None:
    """None where the log has too little of a brake application that says how the train slows.

    Args:
        p: thresholds.
        s: the log.
        rolls: only where all wheels do, by the clamping force alone. Else their inertia is
            measured: wheels that slow harder than is true are left no adhesion by it.
    """
    g = s.grid
    K = g.mean(np.mean(g.clamping, axis=0))
    made = np.where(g.rolling.all(axis=0), s.by_rolling * K, np.nan) if rolls else s.made
    used = np.isfinite(g.braking) & np.isfinite(made)
    used &= ~far(FREE * np.nanmax(K, initial=0.0) > K, round(p.beside / g.step))
    if used.sum() < LEAST or not (K[used] > 0.0).any():
        return None
    x, y = made[used], g.braking[used]
    low, high = np.percentile(x, [5.0, 95.0])
    level, slope = 0.0, float(x @ y / (x @ x))  # braked all the time: no gradient beside it
    whole = float(y @ y)
    varied = bool(high - low > 0.5 * float(x.max()))
    if varied:
        slope = float(np.cov(x, y, bias=True)[0, 1] / np.var(x))
        level = float(y.mean() - slope * x.mean())
        whole = float(np.sum((y - y.mean()) ** 2))
    left = float(np.sum((y - slope * x - level) ** 2))
    speed = g.fastest[used]
    slows = bool(np.nanmin(speed) < 0.5 * np.nanmax(speed))
    return _Line(slope, 1.0 - left / whole if whole else 0.0, float(x.max()), varied, slows)


def _clear(p: Params, line: _Line) -> bool:
    """Whether the line explains how the train slows."""
    absurd = not 1.0 / 30.0 < line.slope < 30.0  # no slide explains that either
    return line.explained >= (0.5 if absurd else p.clear if line.varied else p.clearer)


def _units(p: Params, s: Scene, factor: float) -> list[str]:
    """What could be in another unit, so that the pressure explains the deceleration."""
    near = p.near if 1.0 / p.any_vehicle < factor < p.any_vehicle else 1.6

    def one(x: float) -> bool:
        return abs(math.log(x)) < math.log(near)

    a, g, vehicle = s.axles[0], s.grid, s.vehicle
    K = float(np.nanmean(g.clamping))

    def pressed(times: float) -> bool:
        pressure = times * g.pressure[np.isfinite(g.pressure)]
        return one(factor * K / max(float(np.mean(clamping_force(pressure, vehicle))), 1e-9))

    # The train's deceleration is the train speed's, where there is one.
    by_train = a.train if g.train is not None else None
    speed = others(by_train or a.speed, vehicle, lambda x: one(factor * x))
    by_pressure = a.brake.meaning == "pressure"
    fits: Callable[[float], bool] = pressed if by_pressure else lambda x: one(factor / x)
    what = "pressure" if by_pressure else "clamping force"
    found = [f"{'train' if by_train else 'wheel'} speed in {u}" for u in speed]
    found += [f"{what} in {u}" for u in others(a.brake, vehicle, fits)]
    for times, unit in ((1e-3, "ms for s, or us for ms"), (1e3, "s for ms, or ms for us")):
        if one(factor / times):
            found.append(f"time in another unit ({unit})")
    return found
