"""A pressure that rests at another level than zero while no brake slows the train."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.model import Quantity
from ...core.physics import CRAWL, clamping_force, force_line
from ...train.grid import long_runs
from ..registry import About
from ..scene import Scene

ABOUT = About("Zero of the pressure", "force", 20)


class Params(NamedTuple):
    """Thresholds."""

    share: Annotated[
        float, Quantity("-", "of the highest pressure: transducers are off by less", 0.0, 1.0)
    ] = 0.04
    least: Annotated[float, Quantity("Pa", "and by less than this at any range", 0.0)] = 1e4
    rest: Annotated[
        float, Quantity("-", "of the highest pressure: noise of a released brake", 0.0, 1.0)
    ] = 0.03
    applied: Annotated[
        float, Quantity("-", "of the highest pressure above rest: the log has a brake", 0.0, 1.0)
    ] = 0.3
    slows: Annotated[
        float, Quantity("-", "of what the level would slow the train by: it is a brake", 0.0, 1.0)
    ] = 0.5
    lasts: Annotated[float, Quantity("s", "a release passes faster", 0.0)] = 1.5


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """One finding per pressure whose zero is off."""
    g = s.grid
    for i, (a, pressure) in enumerate(zip(s.axles, g.pressure, strict=True)):
        top = float(np.nanmax(pressure, initial=0.0))
        is_moving = np.isfinite(pressure) & (g.fastest > CRAWL)
        lowest = float(np.min(pressure[is_moving], initial=top))
        rests = long_runs(is_moving & (pressure < lowest + p.rest * top), p.lasts, g)
        slowing = -g.slope(g.fastest)[rests]
        if not np.isfinite(slowing).any():
            continue
        level = float(np.median(pressure[rests]))
        if abs(level) < max(p.share * top, p.least) or top - level < p.applied * top:
            continue
        own = s.vehicle.of_axle(a.record.axle)
        slowed = s.by_rolling * float(clamping_force(np.array(level), own))
        if slowed and np.nanmedian(slowing) > p.slows * slowed:
            continue
        force = force_line(own).per_pascal * level
        values = {"level_bar": level / 1e5, "force_n": force}
        yield s.finding("pressure-zero", "warning", a.brake, rests, i, values)
