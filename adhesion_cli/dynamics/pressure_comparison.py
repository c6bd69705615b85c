"""Each axle's pressure compared with the others: one brake feeds all of them.

Axles may be braked differently: each by its own constant share, a little later, or some of them
together by another law. A WSP vents the cylinder of an axle that slides. Nothing else makes one
pressure alone depart from all others for seconds.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model import Bools, Floats
from ..core.physics import CRAWL, FREE
from ..core.signals import finite_median, true_runs
from . import longitudinal
from .train_grid import LEAST, Axle, Grid, lasting

_APART = 0.08  # of the highest pressure: more than transducers and cylinders differ
_UNLIKE = 0.5  # so much later may one cylinder fill or vent than another [s]
_LASTS = 1.5  # so long must it depart [s]
_UNSEEN = 2.5  # or for so many samples: between fewer a slide of the others may not show
_ALIKE = 0.04  # ratios within this are one
_SHARE = 0.2  # of the time: that often is a ratio the axle's own
_OWN = 0.15  # another share of the others' pressure than 1 is worth a word
_RATIOS = 0.3, 3.0  # no axle is braked by less, or more, of what the others are
_SLIDES = 0.97  # of the train's speed
_REACH = 5.0  # the largest offset of clocks that is looked for [s]
_LATE = 0.25  # smaller ones may be the cylinder's [s]
_INTERVALS = 0.75  # and the sampling's
_BETTER = 0.25  # so much less must a shift leave than anything else
_SLIGHT = 0.02  # of the highest pressure is left between equal ones
_APPLIED = 0.3  # of the highest pressure above that: a brake


class Odd(NamedTuple):
    """Where one pressure departs from the others'."""

    axle: int  # its place
    off: Floats  # by how much, (n,) [Pa or N]
    where: Bools  # (n,)
    ratio: float  # what it is of the others', most of the time
    late: float  # what it is behind them, 0 where that does not explain it [s]
    steady: bool  # nothing but that ratio is odd

    @property
    def size(self) -> float:
        """How much of it there is."""
        return float(np.abs(self.off[self.where]).sum())


def late(axles: Sequence[Axle], g: Grid) -> list[int]:
    """Places of the axles whose own pressure is delayed or early against two others or more."""
    return [o.axle for o, either in odd(axles, g) if o.late and not either]


def odd(axles: Sequence[Axle], g: Grid) -> Iterator[tuple[Odd, bool]]:
    """What departs, the largest first; and whether only one other is left, which may be wrong."""
    measured = np.isfinite(g.pressure).any(axis=1).all()
    x = g.pressure if measured else g.clamping
    slid = _slid(g, x)
    left = list(range(len(x)))
    while len(left) > 1:
        found = [
            o for i in left if (o := _departs(axles, g, x, slid, i, [j for j in left if j != i]))
        ]
        either = len(left) == 2
        for o in found if either else sorted(found, key=lambda o: (o.steady, -o.size))[:1]:
            yield o, either
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


def _departs(
    axles: Sequence[Axle], g: Grid, x: Floats, slid: Bools, i: int, rest: Sequence[int]
) -> Odd | None:
    """Where axle i has another pressure than the others that have not slid; None where nowhere."""
    beside = finite_median(np.where(slid[rest], np.nan, x[rest]))
    known = np.isfinite(x[i]) & np.isfinite(beside) & (g.fastest > CRAWL)
    if known.sum() < LEAST:
        return None
    level = np.where(known, beside, np.nan)
    top = float(np.nanmax(level))
    if top <= _APPLIED * max(float(np.nanmax(x)), 0.0):
        return None  # with the brake on every other axle had slid: there is nothing to compare with
    ratio = _ratio(x[i], level, known & ~slid[i] & (level > 0.3 * top))
    level *= ratio if _RATIOS[0] < ratio < _RATIOS[1] else 1.0
    off = x[i] - level
    steep = np.fmax(np.abs(g.slope(level)), np.abs(g.slope(x[i])))
    allowed = _APART * top + _UNLIKE * _nearby(steep, g.half)
    apart = np.abs(x[rest] - x[i])
    alike = apart < allowed / 2.0
    # A vented cylinder has less than the brake gives, never more.
    vented = slid[rest] & (x[rest] > x[i] - allowed)
    alone = ~alike.any(axis=0) & ((off > 0.0) & ~vented.any(axis=0) | (off < 0.0) & ~slid[i])
    late = _late(g, x[i], level, known & ~slid[i], axles[i])
    where = known & (np.abs(off) > _SLIGHT * top)
    if not late or (apart < np.abs(off) / 2.0).any(axis=0)[where].mean() > 0.5:
        lasts = max(_LASTS, _UNSEEN * g.step)
        late, where = 0.0, lasting(known & alone & (np.abs(off) > allowed), lasts, g)
    steady = not where.any()
    if steady and abs(ratio - 1.0) > _OWN:
        where = known & ~slid[i] & (level > 0.3 * top) & ~alike.any(axis=0)
        where = lasting(where, _LASTS, g)
    return Odd(i, off, where, ratio, late, steady) if where.any() else None


def _nearby(x: Floats, j: int) -> Floats:
    """Largest value within j samples, (n,)."""
    wide = np.pad(np.nan_to_num(x), j)
    largest: Floats = np.lib.stride_tricks.sliding_window_view(wide, 2 * j + 1).max(axis=-1)
    return largest


def _ratio(x: Floats, level: Floats, used: Bools) -> float:
    """The share of the others' pressure that an axle has most of the time, 1 if at all."""
    ratios = np.sort(x[used] / level[used])
    if len(ratios) < LEAST:
        return 1.0
    low, high = (np.searchsorted(ratios, (1.0 + sign * _ALIKE) * np.append(ratios, 1.0))
                 for sign in (-1.0, 1.0))  # fmt: skip
    near = high - low
    return 1.0 if near[-1] >= _SHARE * len(ratios) else float(ratios[int(np.argmax(near[:-1]))])


def _late(g: Grid, x: Floats, level: Floats, used: Bools, axle: Axle) -> float:
    """Delay of x against the others [s], 0 where a delay is not the best explanation.

    A cylinder that fills and vents more slowly is later the longer it takes: x + T ẋ is the others'
    then, or theirs with their own T is x.
    """
    t = g.step * np.arange(len(x))
    own = np.isfinite(x)
    if used.sum() < 2 * LEAST:
        return 0.0

    def left(tau: float) -> float:
        off = np.interp(t + tau, t[own], x[own], left=math.nan, right=math.nan) - level
        off = off[used & np.isfinite(off)]
        return float(np.mean(off**2)) if len(off) > LEAST else math.inf

    unmoved = left(0.0)
    slight = _SLIGHT * float(np.nanmax(level))
    if unmoved < slight**2:
        return 0.0
    taus = np.arange(-_REACH, _REACH + g.step / 4.0, g.step / 2.0)
    losses = [left(tau) for tau in taus]
    best = int(np.argmin(losses))
    slower = [unmoved]
    for rate in (np.gradient(x, g.step), np.gradient(level, g.step)):
        known = used & np.isfinite(rate)
        off, r = (x - level)[known], rate[known]
        slower.append(float(np.mean(off**2) - np.mean(off * r) ** 2 / max(np.mean(r * r), 1e-9)))
    late = float(taus[best])
    clear = (
        losses[best] < min(_BETTER * min(slower), (2.0 * slight) ** 2) and 0 < best < len(taus) - 1
    )
    least = max(_LATE, _INTERVALS * longitudinal.between(axle))
    return late if clear and abs(late) > least else 0.0
