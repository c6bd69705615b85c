"""A train that brakes while no cylinder has the pressure for it, or the spring takes it."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.model import Quantity, fraction
from ...core.physics import cylinder_pressure, force_line
from ...core.units import alternative_units
from ...train.grid import FEWEST, largest, long_runs
from ..registry import About
from ..scene import Scene
from .impossible_values import join_units

ABOUT = About("Braking without pressure", "force", 50)


class Params(NamedTuple):
    """Thresholds."""

    least: Annotated[float, Quantity("m/s²", "no gradient slows a train as hard for long")] = 0.5
    most: Annotated[float, Quantity("m/s²", "harder, the wheel slides")] = 3.0
    lasts: Annotated[float, Quantity("s", "no slide protection dumps a brake longer")] = 3.0
    alike: Annotated[float, fraction("correlation of pressure, deceleration: a wrong unit")] = 0.9
    present: Annotated[float, Quantity("Pa", "zero and noise are less: it is a pressure")] = 2e4


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Where the wheels slow without clamping force."""
    g, brake = s.grid, s.axles[0].brake
    top = float(np.nanmax(g.pressure, initial=0.0))
    unbraked = (g.braking > p.least) & (g.braking < p.most) & g.rolling.any(axis=0)
    unbraked &= g.smooth(largest(g.clamping)) * s.by_rolling < 0.1 * p.least
    lasting = long_runs(unbraked, p.lasts, g)
    if not lasting.any():
        return
    values = {"deceleration_mps2": float(np.median(g.braking[lasting]))}
    pressure_there = float(np.median(np.nan_to_num(largest(g.pressure)[lasting])))
    likely = alternative_units(brake, s.vehicle, lambda x: 1e5 < x * top < 1e6)
    code, rolls = "brake-unknown", g.rolling.any(axis=0)
    if likely and _correlation(np.mean(g.pressure, axis=0)[rolls], g.braking[rolls]) > p.alike:
        code, values = "pressure-unit-suspect", {**values, "peak_bar": top / 1e5}
    elif pressure_there > p.present and s.vehicle.spring_force.value:
        spring = float(cylinder_pressure(force_line(s.vehicle), 0.0))
        code = "pressure-below-spring"
        values |= {"pressure_bar": pressure_there / 1e5, "spring_bar": spring / 1e5}
    names = {"units": join_units(likely), "unit": likely[0] if likely else "bar"}
    yield s.finding(code, "warning", brake, lasting, 0, values, names)


def _correlation(x: np.ndarray, y: np.ndarray) -> float:
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if len(x) < FEWEST or not np.ptp(x) or not np.ptp(y):
        return 0.0
    return float(np.corrcoef(x, y)[0, 1])
