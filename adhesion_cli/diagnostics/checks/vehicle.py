"""A train that slows otherwise than the stated vehicle does by its pressure.

The joint fit of all brake applications finds another factor or offset of the force line.
"""

import math
from collections.abc import Callable, Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core import toml
from ...core.finding import Finding, Severity
from ...core.model import Quantity, Vehicle
from ...core.physics import CRAWL, clamping_force
from ...core.units import alternative_units
from ...train import longitudinal
from ...train.grid import FEWEST
from ..registry import About
from ..scene import Scene
from .impossible_values import join_units

ABOUT = About("Vehicle as stated", "force", 40)


_NEARLY = 1.2  # a factor that differs from 2 by less is nearly 2
_MASS_SIGMAS = 4.0  # no mass is proposed that differs more from what is stated


class Params(NamedTuple):
    """Thresholds."""

    sigmas: Annotated[float, Quantity("-", "of the tolerances: 1 sound vehicle of 2000", 1.0)] = 3.5
    near: Annotated[
        float, Quantity("-", "factor from a unit's: nearer, the unit is the cause", 1.0)
    ] = 1.12
    any_vehicle: Annotated[float, Quantity("-", "no two vehicles differ so much", 1.0)] = 6.0


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Another factor or unit, and whether a delay would explain the same."""
    _, line, delay_or_line, *_ = s.explanation
    if line is None:
        yield from _no_vehicle(p, s)
        return
    factor = max((line.scale, line.factor), key=lambda x: abs(math.log(max(x, 1e-3))))
    largest = math.log1p(p.sigmas * longitudinal.tolerance(s.vehicle))
    if factor > 0.0 and abs(math.log(factor)) >= largest:
        yield _vehicle_finding(p, s, factor)
    if delay_or_line:
        yield s.finding("delay-or-vehicle", "info", s.axles[0].brake)


def _no_vehicle(p: Params, s: Scene) -> Iterator[Finding]:
    """A factor that only another unit explains, such as that of time."""
    K = s.grid.smooth(np.mean(s.grid.clamping, axis=0))
    moves = s.grid.fastest > CRAWL
    braked = moves & np.isfinite(s.grid.braking) & (0.5 * np.nanmax(K, initial=0.0) < K)
    if braked.sum() >= FEWEST:
        factor = float(np.median(s.grid.braking[braked]) / (s.by_rolling * np.median(K[braked])))
        if factor > 0.0 and not 0.02 < factor < 50.0 and _units(p, s, factor):
            yield _vehicle_finding(p, s, factor)


def _vehicle_finding(p: Params, s: Scene, factor: float) -> Finding:
    brake, units = s.axles[0].brake, _units(p, s, factor)
    values = {"factor": factor}
    if units or not 1.0 / p.any_vehicle < factor < p.any_vehicle:
        names = {"candidates": join_units(units)}
        return s.finding("deceleration-unit-suspect", "warning", brake, None, 0, values, names)
    severity: Severity = "info" if factor > 1.0 and s.grid.slid_together else "warning"
    names = remedy_names(s.vehicle, factor)
    return s.finding("vehicle-suspect", severity, brake, None, 0, values, names)


def remedy_names(vehicle: Vehicle, factor: float) -> dict[str, str]:
    """What to check first, and what to state so that the train slows so many times as hard.

    A factor of nearly 2 is a pad, a disc or a cylinder that is counted once too often or not at
    all. A mass is proposed within its stated tolerance only.
    """
    friction, mass = factor * vehicle.friction.value, vehicle.axle_mass.value / factor
    share = vehicle.axle_mass.share
    count, check = "", "Check lever ratio, friction, cylinder and axle mass of the vehicle."
    if abs(abs(math.log(factor)) - math.log(2.0)) < math.log(_NEARLY):
        count = f"{'twice' if factor > 1.0 else 'half'} the pads, discs or cylinders"
        check = "First count the pads of a disc, the discs of an axle and the cylinders of a disc."
    fits = [count] * bool(count)
    # No pad has another friction.
    if 0.05 < friction < 0.6 and vehicle.friction_table is None:
        fits.append(toml.option(f"vehicle.friction = {friction:.2g}"))
    if abs(math.log(factor)) < _MASS_SIGMAS * share:
        fits.append(toml.option(f"vehicle.axle_mass = {mass:.0f}"))
    return {"check": check, "fits": join_units(fits)}


def _units(p: Params, s: Scene, factor: float) -> list[str]:
    """What could be in another unit, so that the pressure explains the deceleration."""
    tolerance = p.near if 1.0 / p.any_vehicle < factor < p.any_vehicle else 1.6

    def is_near_one(x: float) -> bool:
        return abs(math.log(x)) < math.log(tolerance)

    a, g, vehicle = s.axles[0], s.grid, s.vehicle
    K = float(np.nanmean(g.clamping))

    def pressed(times: float) -> bool:
        pressure = times * g.pressure[np.isfinite(g.pressure)]
        mean_force = float(np.mean(clamping_force(pressure, vehicle)))
        return is_near_one(factor * K / max(mean_force, 1e-9))

    # The train's deceleration is the train speed's, where there is one.
    by_train = a.train if g.train is not None else None
    speed = alternative_units(by_train or a.speed, vehicle, lambda x: is_near_one(factor * x))
    by_pressure = a.brake.meaning == "pressure"
    fits: Callable[[float], bool] = pressed if by_pressure else lambda x: is_near_one(factor / x)
    quantity = "pressure" if by_pressure else "clamping force"
    candidates = [f"{'train' if by_train else 'wheel'} speed in {u}" for u in speed]
    candidates += [f"{quantity} in {u}" for u in alternative_units(a.brake, vehicle, fits)]
    for times, unit in ((1e-3, "ms for s, or us for ms"), (1e3, "s for ms, or ms for us")):
        if is_near_one(factor / times):
            candidates.append(f"time in another unit ({unit})")
    return candidates
