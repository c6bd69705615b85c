"""A pressure that releases the brake: springs apply it, as on trams and with parking brakes."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.model import Quantity, fraction
from ...core.units import UNITS
from ...train.grid import FEWEST
from ..registry import About
from ..scene import Scene, pressure_unit

ABOUT = About("Pressure that releases the brake", "force", 5)


class Params(NamedTuple):
    """Thresholds."""

    released_share: Annotated[float, fraction("of the highest pressure: brake released")] = 0.7
    braked_share: Annotated[float, fraction("of the highest pressure: springs brake")] = 0.4
    least_rate: Annotated[float, Quantity("m/s²", "no gradient slows as hard for long")] = 0.4
    rolling_rate: Annotated[float, Quantity("m/s²", "a train that slows less rolls")] = 0.1
    least_speed: Annotated[float, Quantity("m/s", "slower, the last of a stop counts")] = 2.0


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """One finding for each pressure at which the train rolls, and without which it slows."""
    g = s.grid
    moving = np.isfinite(g.braking) & (g.fastest > p.least_speed)
    for i, a in enumerate(s.axles):
        pressure = g.smooth(g.pressure[i])
        top = float(np.nanmax(pressure, initial=0.0))
        released = moving & (pressure > p.released_share * top)
        braked = moving & (pressure < p.braked_share * top)
        if min(released.sum(), braked.sum()) < FEWEST:
            continue
        rate, rolling_rate = (float(np.median(g.braking[mask])) for mask in (braked, released))
        if rate > p.least_rate and abs(rolling_rate) < p.rolling_rate:
            unit = pressure_unit(a.brake)
            logged = a.brake.zero.value + float(np.median(pressure[released])) - unit.offset
            has_plain_unit = unit == UNITS.get(a.brake.unit.lower())
            unit_text = f"1 {a.brake.unit}" if has_plain_unit else f"{unit.factor / 1e5:.10g} bar"
            statement = f' = {{unit = "-{unit_text}", zero = {logged / unit.factor:.3g}}}'
            names = {"option": s.pressure_option(a.brake, statement)}
            values = {"deceleration_mps2": rate}
            yield s.finding("pressure-releases-brake", "warning", a.brake, braked, i, values, names)
