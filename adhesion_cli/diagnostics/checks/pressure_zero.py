"""A pressure that rests at another level than zero, or than the others, while no brake slows."""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.masks import true_runs
from ...core.model import Bools, Channel, Quantity, fraction
from ...core.physics import CRAWL, clamping_force, force_line
from ...core.toml import value as value_text
from ...train.grid import long_runs
from ..registry import About
from ..scene import Scene, pressure_unit

_COASTING = 0.03  # deceleration of a train without brake, by its resistance or a gradient [m/s²]
_FEWEST_PHASES = 6  # without brake, from which a drift shows
ABOUT = About("Zero of the pressure", "force", 20)


class Params(NamedTuple):
    """Thresholds."""

    share: Annotated[float, fraction("of the highest pressure: transducers are off by less")] = 0.04
    least: Annotated[float, Quantity("Pa", "and by less than this at any range")] = 1e4
    rest: Annotated[float, fraction("of the highest pressure: noise of a released brake")] = 0.03
    applied: Annotated[float, fraction("of the highest pressure above rest: it brakes")] = 0.3
    slows: Annotated[float, fraction("of what the level would slow the train by: a brake")] = 0.5
    lasts: Annotated[float, Quantity("s", "a release passes faster")] = 1.5
    apart: Annotated[float, Quantity("Pa", "released pressures of two channels differ less")] = 6e3
    drift: Annotated[float, Quantity("Pa", "a released pressure changes less over the log")] = 6e3
    steady: Annotated[float, Quantity("s", "so long without brake show a zero beside others")] = 5.0
    released: Annotated[float, Quantity("Pa", "a released pressure that drifts is lower")] = 2.5e4


class _Rest(NamedTuple):
    """Where a brake is released while the train moves, and its pressure there."""

    mask: Bools  # (n,)
    level: float  # [Pa]
    top: float  # highest pressure of the channel [Pa]


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """One finding per pressure whose zero is off, and one per pressure whose zero drifts."""
    first_axles: dict[str, int] = {}  # a channel may serve several axles
    for i, a in enumerate(s.axles):
        first_axles.setdefault(a.brake.title, i)
    brakes = [(i, brake) for i in first_axles.values() if (brake := _released_brake(p, s, i))]
    for i, brake in brakes:
        other_levels = [other_brake.level for j, other_brake in brakes if j != i]
        yield from _offset(p, s, i, brake, other_levels)
        yield from _drift(p, s, i, brake.top)


def _released_brake(p: Params, s: Scene, i: int) -> _Rest | None:
    """Where the brake of an axle is released; None where nothing shows it."""
    g, pressure = s.grid, s.grid.pressure[i]
    top = float(np.nanmax(pressure, initial=0.0))
    is_moving = np.isfinite(pressure) & (g.fastest > CRAWL)
    lowest = float(np.min(pressure[is_moving], initial=top))
    mask = long_runs(is_moving & (pressure < lowest + p.rest * top), p.lasts, g)
    slowing = -g.slope(g.fastest)[mask]
    if not np.isfinite(slowing).any():
        return None
    level = float(np.median(pressure[mask]))
    if top - level < p.applied * top:
        return None
    # all brakes slow the train, and a small level of one of many does not show
    axle_vehicle = s.vehicle.of_axle(s.axles[i].record.axle)
    mean_level = np.array(np.nanmedian(np.nanmean(g.pressure[:, mask], axis=0)))
    slowed = s.by_rolling * float(clamping_force(mean_level, axle_vehicle))
    if slowed > _COASTING and np.nanmedian(slowing) > p.slows * slowed:
        return None
    return _Rest(mask, level, top)


def _offset(
    p: Params, s: Scene, i: int, rest: _Rest, other_levels: Sequence[float]
) -> Iterator[Finding]:
    """A released pressure that is not zero, where another one is, or by much."""
    a, level = s.axles[i], rest.level
    other_level = min(other_levels, key=abs, default=level)
    # A cylinder that is still being released is above another one, too, and falls.
    lower_level, upper_level = np.quantile(s.grid.pressure[i][rest.mask], [0.1, 0.9])
    difference = abs(level - other_level)
    lasts = rest.mask.sum() * s.grid.step > p.steady
    is_steady = lasts and upper_level - lower_level < difference
    is_farther = abs(level) > abs(other_level) and difference > max(p.apart, 1.1 * a.brake.step)
    differs = is_steady and is_farther
    if not differs and abs(level) < max(p.share * rest.top, p.least):
        return
    if abs(level) < 2.0 * a.brake.zero.tolerance:  # its zero is reported as not known
        return
    force = force_line(s.vehicle.of_axle(a.record.axle)).per_pascal * level
    values = {"level_bar": level / 1e5, "force_n": force}
    names = {"others": f", another one at {other_level / 1e5:+.2f} bar" if differs else ""}
    names["option"] = _option(s, a.brake, level, 0.0)
    yield s.finding("pressure-zero", "warning", a.brake, rest.mask, i, values, names)


def _drift(p: Params, s: Scene, i: int, top: float) -> Iterator[Finding]:
    """A released pressure that is another one at the end of the log than at its beginning.

    A cylinder may be released slowly: of each phase without brake the lowest pressure counts, and
    phases that are few or short show nothing.
    """
    g, pressure, brake = s.grid, s.grid.pressure[i], s.axles[i].brake
    is_moving = np.isfinite(pressure) & (g.fastest > CRAWL)
    lowest = float(np.min(pressure[is_moving]))
    is_released = is_moving & (pressure < lowest + max(p.released, p.rest * top))
    phases = true_runs(long_runs(is_released, 2.0 * p.steady, g))
    if len(phases) < _FEWEST_PHASES:
        return
    levels = [float(np.quantile(pressure[a:b], 0.1)) for a, b in phases]
    third = len(levels) // 3
    first_level, last_level = float(np.median(levels[:third])), float(np.median(levels[-third:]))
    stated_drift = 4.0 * brake.zero.tolerance  # of a drift that `_option` states: 4 / √12 of it
    if abs(last_level - first_level) < max(p.drift, 1.1 * brake.step, stated_drift):
        return
    values = {"first_bar": first_level / 1e5, "last_bar": last_level / 1e5}
    sigma = abs(last_level - first_level) / math.sqrt(12.0)
    option = _option(s, brake, (first_level + last_level) / 2.0, sigma)
    yield s.finding("pressure-zero-drift", "warning", brake, None, i, values, {"option": option})


def _option(s: Scene, brake: Channel, level: float, tolerance: float) -> str:
    factor = pressure_unit(brake).factor
    value = round((brake.zero.value + level) / factor, 3)
    zero = {"value": value, "tolerance": round(tolerance / factor, 3)} if tolerance else value
    return s.pressure_option(brake, f".zero = {value_text(zero)}")
