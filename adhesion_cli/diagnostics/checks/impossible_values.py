"""Speeds, pressures and decelerations that no train has: mostly a wrong unit."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.model import Quantity, fraction
from ...core.units import alternative_units
from ...train.grid import largest
from ..registry import About
from ..scene import Scene

ABOUT = About("Values that no train has", "force", 10)


class Params(NamedTuple):
    """Thresholds."""

    fastest: Annotated[float, Quantity("m/s", "no train is faster: 500 km/h", 1.0)] = 139.0
    highest: Annotated[float, Quantity("Pa", "no brake cylinder has more", 1e5)] = 1.2e6
    hardest: Annotated[float, Quantity("m/s²", "no rim slows harder, even on ice", 1.0)] = 30.0
    share: Annotated[float, fraction("of the moving time harder: a slide locks for less")] = 0.25


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Wheels that are too fast, pressures that are too high, rims that slow too hard."""
    for i, (a, rim) in enumerate(zip(s.axles, s.grid.rim, strict=True)):
        if (fast := rim > p.fastest).any():
            peak = float(np.nanmax(rim))
            likely = alternative_units(a.speed, s.vehicle, lambda x: 5.0 < x * peak < 120.0)  # noqa: B023
            unit = likely[0] if likely else "km/h"
            values, names = {"peak_kmh": 3.6 * peak}, {"units": join_units(likely), "unit": unit}
            yield s.finding("speed-too-high", "warning", a.speed, fast, i, values, names)
    for i, (a, pressure) in enumerate(zip(s.axles, s.grid.pressure, strict=True)):
        if (too_high := pressure > p.highest).any():
            top = float(np.nanmax(pressure))
            likely = alternative_units(a.brake, s.vehicle, lambda x: 1e5 < x * top < 1e6)  # noqa: B023
            unit = likely[0] if likely else "bar"
            values, names = {"peak_bar": top / 1e5}, {"units": join_units(likely), "unit": unit}
            yield s.finding("pressure-too-high", "warning", a.brake, too_high, i, values, names)
    slowing = -s.grid.rim_rate
    moving = np.isfinite(slowing) & (s.grid.rim > 0.1 * np.nanmax(s.grid.rim, initial=0.0))
    hard = slowing > p.hardest
    if moving.any() and hard[moving].mean() > p.share:
        values = {"deceleration_mps2": float(np.median(slowing[moving & hard]))}
        mask = largest(slowing) > p.hardest
        yield s.finding("deceleration-too-high", "warning", s.axles[0].speed, mask, 0, values)


def join_units(units: list[str]) -> str:
    """Units that would fit, as a message lists them."""
    return " or ".join(units) or "none known"
