"""One axle's pressure that departs from the others': one brake feeds all of them.

Axles may be braked differently: each by its own constant share, a little later, or some of them
together by another law. A WSP vents the cylinder of an axle that slides. Nothing else makes one
pressure alone depart from all others for seconds.
"""

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ...core import toml
from ...core.finding import Finding, Severity
from ...core.masks import true_runs
from ...core.model import Bools, Floats, fraction
from ...core.physics import CRAWL, RELEASED_SHARE
from ...core.signals import finite_median, largest_nearby
from ...core.units import alternative_units
from ...train.grid import FEWEST, Grid, long_runs
from ..registry import About
from ..scene import Scene
from .impossible_values import join_units

ABOUT = About("Pressures against each other", "axles", 10)
_DEPARTURE = 0.08  # of the highest pressure: more than transducers and cylinders differ
_FILLING_TIME = 0.5  # so much later may one cylinder fill or vent than another [s]
_SHORTEST_TIME = 0.75  # so long must it depart [s]
_SHORTEST_SAMPLES = 2.5  # or for so many samples: between fewer a slide of the others may not show
_RATIO_WIDTH = 0.04  # ratios within this are one
_RATIO_SHARE = 0.2  # of the time: that often is a ratio the axle's own
_SHARE_DIFFERENCE = 0.15  # another share of the others' pressure than 1 is worth a word
_RATIOS = 0.3, 3.0  # no axle is braked by less, or more, of what the others are
_SLIDING_SHARE = 0.97  # of the train's speed
_APPLIED_SHARE = 0.3  # of the highest pressure above that: a brake


class Params(NamedTuple):
    """Thresholds."""

    braked_less: Annotated[float, fraction("of the others' pressure: any design gives more")] = 0.6
    least: Annotated[float, fraction("of the others' pressure: no axle is braked by less")] = 0.3


class _Departure(NamedTuple):
    """Where one pressure departs from the others'."""

    axle: int  # its place
    difference: Floats  # by how much, (n,) [Pa or N]
    mask: Bools  # (n,)
    ratio: float  # what it is of the others', most of the time
    steady: bool  # nothing but that ratio is odd


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Pressures that are stuck, lost, offset, delayed or drift while the others do not.

    The largest departure comes first, and that axle is no reference for the others. Of two axles
    that differ, either may be wrong.
    """
    g = s.grid
    x = g.pressure if np.isfinite(g.pressure).any(axis=1).all() else g.friction_clamping
    slid = _slid(g, x)
    axles_left = list(range(len(x)))
    while len(axles_left) > 1:
        other_axles = {i: [j for j in axles_left if j != i] for i in axles_left}
        trials = (_find_departure(g, x, slid, i, other_axles[i]) for i in axles_left)
        departures = [o for o in trials if o]
        only_two = len(axles_left) == 2
        if not only_two:
            departures.sort(key=lambda o: (o.steady, -np.abs(o.difference[o.mask]).sum()))
        for o in departures if only_two else departures[:1]:
            yield _departure_finding(p, s, o, only_two)
            axles_left.remove(o.axle)
        if not departures:
            return


def _slid(g: Grid, x: Floats) -> Bools:
    """Whether each axle has slid since the brake was applied, (k, n)."""
    level = np.nan_to_num(np.median(x, axis=0))
    slid = g.share < _SLIDING_SHARE
    for a, b in true_runs(level > RELEASED_SHARE * level.max()):
        slid[:, a:b] = np.logical_or.accumulate(slid[:, a:b], axis=1)
    return slid


def _find_departure(
    g: Grid, x: Floats, slid: Bools, i: int, other_axles: Sequence[int]
) -> _Departure | None:
    """Where axle i has another pressure than the others that have not slid; None where nowhere."""
    usual_pressure = finite_median(np.where(slid[other_axles], np.nan, x[other_axles]))
    comparable = np.isfinite(x[i]) & np.isfinite(usual_pressure) & (g.fastest > CRAWL)
    if comparable.sum() < FEWEST:
        return None
    level = np.where(comparable, usual_pressure, np.nan)
    top = float(np.nanmax(level))
    if top <= _APPLIED_SHARE * max(float(np.nanmax(x)), 0.0):
        return None  # with the brake on every other axle had slid: there is nothing to compare with
    ratio = _ratio(x[i], level, comparable & ~slid[i] & (level > 0.3 * top))
    level *= ratio if _RATIOS[0] < ratio < _RATIOS[1] else 1.0
    difference = x[i] - level
    steep = np.fmax(np.abs(g.slope(level)), np.abs(g.slope(x[i])))
    allowed = _DEPARTURE * top + _FILLING_TIME * largest_nearby(steep, g.half_width)
    distance = np.abs(x[other_axles] - x[i])
    agrees = distance < allowed / 2.0
    # A vented cylinder has less than the brake gives, never more.
    vented = slid[other_axles] & (x[other_axles] > x[i] - allowed)
    unexplained = ~agrees.any(axis=0) & (
        (difference > 0.0) & ~vented.any(axis=0) | (difference < 0.0) & ~slid[i]
    )
    mask = comparable & unexplained & (np.abs(difference) > allowed)
    mask = long_runs(mask, max(_SHORTEST_TIME, _SHORTEST_SAMPLES * g.step), g)
    steady = not mask.any()
    if steady and abs(ratio - 1.0) > _SHARE_DIFFERENCE:
        mask = comparable & ~slid[i] & (level > 0.3 * top) & ~agrees.any(axis=0)
        mask = long_runs(mask, _SHORTEST_TIME, g)
    return _Departure(i, difference, mask, ratio, steady) if mask.any() else None


def _ratio(x: Floats, level: Floats, selected: Bools) -> float:
    """The share of the others' pressure that an axle has most of the time, 1 if at all."""
    ratios = np.sort(x[selected] / level[selected])
    if len(ratios) < FEWEST:
        return 1.0
    candidates = np.append(ratios, 1.0)
    counts = np.searchsorted(ratios, (1.0 + _RATIO_WIDTH) * candidates)
    counts -= np.searchsorted(ratios, (1.0 - _RATIO_WIDTH) * candidates)
    is_usual = counts[-1] >= _RATIO_SHARE * len(ratios)
    return 1.0 if is_usual else float(ratios[int(np.argmax(counts[:-1]))])


def _departure_finding(p: Params, s: Scene, o: _Departure, only_two: bool) -> Finding:
    a = s.axles[o.axle]
    names = {
        "quantity": str(a.brake.meaning).replace("_", " ").capitalize(),
        "reference": "the other axle" if only_two else "the others",
    }
    values = {"factor": o.ratio}
    code = "axle-pressure-differs"
    severity: Severity = "warning"
    likely = alternative_units(a.brake, s.vehicle, lambda f: 0.8 < f * o.ratio < 1.25)
    if o.steady:
        code = "axle-pressure-share"
        severity = "info" if p.braked_less < o.ratio < 1.0 / p.braked_less else "warning"
    elif likely and not p.least < o.ratio < 1.0 / p.least:
        code, values["axle"] = "pressure-unit-differs", a.record.axle
        line = f'channels.{a.brake.meaning}.axle{a.record.axle}.unit = "{likely[0]}"'
        names |= {"units": join_units(likely), "option": toml.option(line)}
    else:
        typical = float(np.median(o.difference[o.mask]))
        force = a.record.pressure is None
        values = {"offset_n": typical} if force else {"offset_pa": typical}
        size = f"{abs(typical):.0f} N" if force else f"{abs(typical) / 1e5:.2g} bar"
        names["offset"] = f"{size} {'above' if typical > 0.0 else 'below'}"
    return s.finding(code, severity, a.brake, o.mask, o.axle, values, names)
