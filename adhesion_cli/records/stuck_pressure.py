"""Pressure sensors that are stuck, or saturated at the end of their range.

A sensor is stuck where its noise ends, or where it shows one value in the whole log while all other
axles are applied and released. A pressure without noise that is stuck for a part of the log is
found by the comparison of the axles.
"""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from ..core.methods import About
from ..core.model import Bools, Channel, Floats, Quantity
from .faults import Fault
from .repeats import Runs, runs

ABOUT = About("Stuck and saturated pressures", "the chance of equal samples of white noise")
_SHORT = 30  # samples: so long a stretch is no noise
_ENOUGH = 20  # samples that show noise


class Params(NamedTuple):
    """Thresholds."""

    chance: Annotated[float, Quantity("-", "of equal samples in a log", 1e-12, 1.0)] = 1e-3
    small: Annotated[float, Quantity("-", "of the highest value: may be noise", 0.0, 1.0)] = 0.02
    level: Annotated[float, Quantity("-", "small changes: range of noise about a level")] = 4.0
    near: Annotated[float, Quantity("s", "before and after, in which a level holds")] = 0.4
    longer: Annotated[float, Quantity("-", "times the usual: valves keep a value, too")] = 4.0
    rises: Annotated[float, Quantity("-", "of itself, in half a second before a top")] = 0.05
    varies: Annotated[float, Quantity("-", "of the highest value: all others vary", 0.0, 1.0)] = 0.3


class Standing(NamedTuple):
    """Samples at which a pressure sensor repeats its last value; shape (n,)."""

    stuck: Bools
    saturated: Bools  # at its highest value, the end of its range


def of_brake(p: Params, brake: Channel, others: Sequence[Channel]) -> list[Fault]:
    """A stuck and a saturated pressure [Pa] or K [N].

    Args:
        p: thresholds.
        brake: of one axle.
        others: the other axles'.
    """
    stuck, saturated = standing(p, brake, others)
    return [Fault("pressure-stuck", stuck), Fault("pressure-saturated", saturated, False)]


def standing(p: Params, brake: Channel, others: Sequence[Channel] = ()) -> Standing:
    """Where a pressure sensor is stuck or saturated.

    Where it reads its lowest value, its range may end there: that is no fault.
    """
    x, same = brake.data.value, runs(brake)
    if not np.ptp(x) and _all_vary(p, others):
        return Standing(np.ones(len(x), dtype=np.bool_), np.zeros(len(x), dtype=np.bool_))
    silent = _silent(p, brake, same)
    flat = _flat_top(p, brake, same, silent)
    silent &= ~flat
    if silent.any() and _cut_off(p, brake, same):
        silent &= same.value > x.min()
    return Standing(same.repeated(silent), same.repeated(flat))


def _all_vary(p: Params, others: Sequence[Channel]) -> bool:
    top = max((float(c.data.value.max()) for c in others), default=0.0)
    return bool(others) and all(np.ptp(c.data.value) > p.varies * top for c in others)


def _flat_top(p: Params, brake: Channel, same: Runs, silent: Bools) -> Bools:
    """Silent stretches at the highest value, reached steeply or more than once; shape (k,)."""
    x = brake.data.value
    top = float(x.max())
    found: Bools = silent & (same.value == top)
    if found.sum() == 1:
        first = same.first[found]
        before = np.maximum(first - max(2, round((brake.rate_hz or 1.0) / 2.0)), 0)
        found[found] = top - x[before] > p.rises * top
    return found


def _cut_off(p: Params, brake: Channel, same: Runs) -> bool:
    """Whether the sensor reads nothing below its lowest value: it is there often, not by chance."""
    low, high = float(brake.data.value.min()), float(brake.data.value.max())
    value = same.value[same.length < _SHORT]
    near = (value <= low + max(p.small * high, 4.0 * brake.step)).sum()
    return bool(near < _ENOUGH or (value == low).sum() > 0.1 * near)


def _silent(p: Params, brake: Channel, same: Runs) -> Bools:
    """Stretches longer than the channel's noise allows, none where it has no noise; shape (k,).

    Noise is small changes up and down. Where there are steps, it is two of them at least: a quiet
    signal that crosses from one step to the next changes by one. Below the highest value noise is
    about a level: valves that move the pressure make such changes, too.
    """
    x, rate, value = brake.data.value, brake.rate_hz or 0.0, same.value
    length = same.length
    small = max(p.small * float(x.max()), 2.5 * brake.step)
    turns = _turns(value, small, 1.5 * brake.step)
    j = min(max(2, round(p.near * rate)), 20)
    level = _range(np.pad(value, j, "edge"), 2 * j + 1) <= p.level * small

    def longest(where: Bools) -> float:
        """What the noise there allows."""
        free = (length < _SHORT) & (value > x.min()) & where
        samples = int(length[free].sum())
        if samples < _ENOUGH or (turns & where[1:-1]).sum() < max(6.0, 0.03 * samples):
            return np.inf
        # How often it repeats by chance; more often half way between two steps.
        chance = np.clip(1.0 - free.sum() / samples + 0.15, 0.45, 0.7)
        return float(np.log(p.chance / len(x)) / np.log(chance))

    below = value < x.max()
    # Stretches that come again and again with about one length show valves, not noise.
    usual = float(np.sort(length[below])[-4:][0]) if below.any() else 0.0
    least = max(longest(level), p.longer * usual)
    return np.where(below, length >= least, length > longest(np.ones_like(level)))


def _range(x: Floats, many: int) -> Floats:
    """Range of so many values in a row, shape (n - many + 1,)."""
    high, low, wide = x, x, 1  # of so many; two stretches make one that is up to twice as long
    while wide < many:
        more = min(wide, many - wide)
        high, low = np.maximum(high[more:], high[:-more]), np.minimum(low[more:], low[:-more])
        wide += more
    return high - low


def _turns(value: Floats, small: float, clear: float) -> Bools:
    """Where small changes up and down follow each other, shape (k - 2,).

    Args:
        value: of stretches that follow each other (k,).
        small: a larger change is no noise.
        clear: one of both must be larger than this.
    """
    changes = np.diff(value)
    up, down, size = changes > 0.0, changes < 0.0, np.abs(changes)
    fits: Bools = up[1:] & down[:-1] | down[1:] & up[:-1]
    fits &= (np.maximum(size[1:], size[:-1]) <= small) & (np.maximum(size[1:], size[:-1]) > clear)
    return fits
