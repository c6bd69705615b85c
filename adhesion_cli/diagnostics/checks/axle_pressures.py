"""One axle's pressure that departs from the others': one brake feeds all of them.

Axles may be braked differently: each by its own constant share, a little later, or some of them
together by another law. A WSP vents the cylinder of an axle that slides. Nothing else makes one
pressure alone depart from all others for seconds.
"""

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding, Severity
from ...core.model import Bools, Floats, Quantity
from ...core.physics import CRAWL, FREE
from ...core.signals import finite_median, true_runs
from ...core.units import others
from ...train.grid import FEWEST, Grid, long_runs
from ..registry import About
from ..scene import Scene
from .impossible_values import named

ABOUT = About("Pressures against each other", "axles", 10)
_APART = 0.08  # of the highest pressure: more than transducers and cylinders differ
_UNLIKE = 0.5  # so much later may one cylinder fill or vent than another [s]
_LASTS = 0.75  # so long must it depart [s]
_UNSEEN = 2.5  # or for so many samples: between fewer a slide of the others may not show
_ALIKE = 0.04  # ratios within this are one
_SHARE = 0.2  # of the time: that often is a ratio the axle's own
_OWN = 0.15  # another share of the others' pressure than 1 is worth a word
_RATIOS = 0.3, 3.0  # no axle is braked by less, or more, of what the others are
_SLIDES = 0.97  # of the train's speed
_APPLIED = 0.3  # of the highest pressure above that: a brake


class Params(NamedTuple):
    """Thresholds."""

    braked_less: Annotated[
        float, Quantity("-", "of the others' pressure: an axle by design has more", 0.0, 1.0)
    ] = 0.6
    least: Annotated[
        float, Quantity("-", "of the others' pressure: no axle is braked by less", 0.0, 1.0)
    ] = 0.3


class _Odd(NamedTuple):
    """Where one pressure departs from the others'."""

    axle: int  # its place
    off: Floats  # by how much, (n,) [Pa or N]
    where: Bools  # (n,)
    ratio: float  # what it is of the others', most of the time
    steady: bool  # nothing but that ratio is odd


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Pressures that are stuck, lost, offset, delayed or drift while the others do not.

    The largest departure comes first, and that axle is no reference for the others. Of two axles
    that differ, either may be wrong.
    """
    g = s.grid
    x = g.pressure if np.isfinite(g.pressure).any(axis=1).all() else g.clamping
    slid = _slid(g, x)
    left = list(range(len(x)))
    while len(left) > 1:
        rest = {i: [j for j in left if j != i] for i in left}
        found = [o for i in left if (o := _departs(g, x, slid, i, rest[i]))]
        either = len(left) == 2
        if not either:
            found.sort(key=lambda o: (o.steady, -np.abs(o.off[o.where]).sum()))
        for o in found if either else found[:1]:
            yield _found(p, s, o, either)
            left.remove(o.axle)
        if not found:
            return


def _slid(g: Grid, x: Floats) -> Bools:
    """Whether each axle has slid since the brake was applied, (k, n)."""
    level = np.nan_to_num(np.median(x, axis=0))
    slid = g.share < _SLIDES
    for a, b in true_runs(level > FREE * level.max()):
        slid[:, a:b] = np.logical_or.accumulate(slid[:, a:b], axis=1)
    return slid


def _departs(g: Grid, x: Floats, slid: Bools, i: int, rest: Sequence[int]) -> _Odd | None:
    """Where axle i has another pressure than the others that have not slid; None where nowhere."""
    beside = finite_median(np.where(slid[rest], np.nan, x[rest]))
    known = np.isfinite(x[i]) & np.isfinite(beside) & (g.fastest > CRAWL)
    if known.sum() < FEWEST:
        return None
    level = np.where(known, beside, np.nan)
    top = float(np.nanmax(level))
    if top <= _APPLIED * max(float(np.nanmax(x)), 0.0):
        return None  # with the brake on every other axle had slid: there is nothing to compare with
    ratio = _ratio(x[i], level, known & ~slid[i] & (level > 0.3 * top))
    level *= ratio if _RATIOS[0] < ratio < _RATIOS[1] else 1.0
    off = x[i] - level
    steep = np.fmax(np.abs(g.slope(level)), np.abs(g.slope(x[i])))
    allowed = _APART * top + _UNLIKE * _nearby(steep, g.half_width)
    apart = np.abs(x[rest] - x[i])
    alike = apart < allowed / 2.0
    # A vented cylinder has less than the brake gives, never more.
    vented = slid[rest] & (x[rest] > x[i] - allowed)
    alone = ~alike.any(axis=0) & ((off > 0.0) & ~vented.any(axis=0) | (off < 0.0) & ~slid[i])
    where = known & alone & (np.abs(off) > allowed)
    where = long_runs(where, max(_LASTS, _UNSEEN * g.step), g)
    steady = not where.any()
    if steady and abs(ratio - 1.0) > _OWN:
        where = known & ~slid[i] & (level > 0.3 * top) & ~alike.any(axis=0)
        where = long_runs(where, _LASTS, g)
    return _Odd(i, off, where, ratio, steady) if where.any() else None


def _nearby(x: Floats, j: int) -> Floats:
    """Largest value within j samples, (n,)."""
    wide = np.pad(np.nan_to_num(x), j)
    largest: Floats = np.lib.stride_tricks.sliding_window_view(wide, 2 * j + 1).max(axis=-1)
    return largest


def _ratio(x: Floats, level: Floats, used: Bools) -> float:
    """The share of the others' pressure that an axle has most of the time, 1 if at all."""
    ratios = np.sort(x[used] / level[used])
    if len(ratios) < FEWEST:
        return 1.0
    low, high = (np.searchsorted(ratios, (1.0 + sign * _ALIKE) * np.append(ratios, 1.0))
                 for sign in (-1.0, 1.0))  # fmt: skip
    near = high - low
    return 1.0 if near[-1] >= _SHARE * len(ratios) else float(ratios[int(np.argmax(near[:-1]))])


def _found(p: Params, s: Scene, o: _Odd, either: bool) -> Finding:
    a = s.axles[o.axle]
    names = {
        "quantity": str(a.brake.meaning).replace("_", " ").capitalize(),
        "reference": "the other axle" if either else "the others",
    }
    values = {"factor": o.ratio}
    code = "axle-pressure-differs"
    severity: Severity = "warning"
    likely = others(a.brake, s.vehicle, lambda f: 0.8 < f * o.ratio < 1.25)
    if o.steady:
        code = "axle-pressure-share"
        severity = "info" if p.braked_less < o.ratio < 1.0 / p.braked_less else "warning"
    elif likely and not p.least < o.ratio < 1.0 / p.least:
        code, values["axle"] = "pressure-unit-differs", a.record.axle
        names |= {"units": named(likely), "unit": likely[0], "key": str(a.brake.meaning)}
    else:
        most = float(np.median(o.off[o.where]))
        force = a.record.pressure is None
        values = {"offset_n": most} if force else {"offset_pa": most}
        size = f"{abs(most):.0f} N" if force else f"{abs(most) / 1e5:.2g} bar"
        names["offset"] = f"{size} {'above' if most > 0.0 else 'below'}"
    return s.finding(code, severity, a.brake, o.where, o.axle, values, names)
