"""Samples that no wheel and no cylinder can have: drop-outs, spikes, dead stretches.

A sensor that fails leaves the signal faster than physics allows, for one sample or for seconds, and
comes back likewise. What is kept is the largest part of the samples that one wheel, or one
cylinder, can have gone through in their order.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import time_axis
from ..core.model import Bools, Channel, Floats, Times
from ..core.signals import true_runs

_BACK = 300  # pieces that may lie between two that belong together
_REPEATED = 1e-3  # weight of a sample that repeats its predecessor: dead sensors do
_ZERO = 0.3  # of the weight of other values: dead sensors read it
_CLEAR = 0.65  # of the weight, zeros apart: with less, which part is the wheel's is not known
_RETURNS = 0.8  # of the impossible steps: with less the signal goes its way, in another unit
_TURNS = 20  # samples that may not alternate by chance
STANDS = 0.3  # a signal that reads zero for this long may be at rest [s]


class Limits(NamedTuple):
    """What a quantity can do, SI."""

    rise: float  # [1/s]
    fall: float  # [1/s]
    least: float  # what it may differ by without a reason
    start: float  # sensors read zero below this
    longest: float  # a longer excursion may be real [s]


# A wheel slides at up to 30 m/s² and is back at once where a heavy axle finds a dry rail.
WHEEL = Limits(250.0, 150.0, 2.0, 5.0, np.inf)
# Valves empty a cylinder in 0.1 s and fill it in 0.25 s. A longer step may be a brake's: simulated
# ones have no valve.
_CYLINDER = Limits(2e6, 5e6, 2e4, 2e4, 3.0)
_TRAIN = Limits(10.0, 10.0, 1.0, 2.5, np.inf)
_FULL = 5e5  # pressure of that cylinder [Pa]
_APPLIED = 1e5  # a brake is, above this [Pa]
HIGHEST = 12e5  # no brake cylinder has more [Pa]


def of_wheel(speed: Channel) -> Bools:
    """Samples of a wheel speed [rad/s] that no wheel can reach and leave again, shape (n,)."""
    return _of(speed, WHEEL)


def by_turns(c: Channel) -> bool:
    """Whether every second sample is another signal's, all log long and neither zero."""
    x = c.data.value
    if len(x) < _TURNS or np.mean(x == 0.0) > 1.0 - _RETURNS:
        return False
    there, along = np.diff(x), np.abs(x[2:] - x[:-2])
    returns = float(np.mean(there[1:] * there[:-1] < 0.0))
    away = float(np.median(np.abs(there)))
    return returns > _RETURNS and away > 4.0 * (float(np.median(along)) + c.coarsest)


def of_train(speed: Channel) -> Bools:
    """Samples of a train speed [m/s] that no train can reach and leave again, shape (n,)."""
    return _of(speed, _TRAIN)


def of_cylinder(brake: Channel) -> Bools:
    """Samples of a pressure [Pa] or K [N] that no valve can reach and leave again, shape (n,).

    None where more steps stay than return: it is no cylinder's, or a slow one's held.
    """
    share = scale(brake)
    rise, fall, least, start, longest = _CYLINDER
    return _of(brake, Limits(share * rise, share * fall, share * least, share * start, longest))


def scale(brake: Channel) -> float:
    """By how much a brake's values are larger than that cylinder's.

    Of a pressure 1, but in a unit in which no cylinder has it: its sensor is not accused of that.
    """
    x = brake.data.value
    if brake.meaning != "pressure":
        return float(np.quantile(np.abs(x), 0.99)) / _FULL
    applied = x[x > _APPLIED]
    usual = float(np.median(applied)) if len(applied) else 0.0
    return usual / _FULL if usual > HIGHEST else 1.0


def _of(c: Channel, limits: Limits) -> Bools:
    found = np.zeros(len(c.data.t), dtype=np.bool_)
    noise = by_noise(c, limits.least)
    limits = limits._replace(least=limits.least + noise, start=limits.start + noise)
    for piece in time_axis.pieces(c.starts, len(found)):
        found[piece] = _impossible(c.data.t[piece], c.data.value[piece], c.coarsest, limits)
    return found


class _Signal(NamedTuple):
    """A channel's piece and what can be between its samples."""

    t: Floats  # [s]
    x: Floats
    rest: Bools  # reads zero and may be at rest
    refresh: float  # no change is quicker than from one reading to the next [s]
    limits: Limits

    def possible(self, before: NDArray[np.int64], after: NDArray[np.int64]) -> Bools:
        """Whether one sample can follow another, both by index; shape of the two together."""
        change = self.x[after] - self.x[before]
        seconds = np.maximum(self.t[after] - self.t[before], self.refresh)
        rest = self.rest[after] | self.rest[before]
        free = np.where(rest, self.limits.start, self.limits.least)
        fast = np.where(change > 0.0, self.limits.rise, self.limits.fall)
        can: Bools = np.abs(change) <= free + fast * seconds
        return can


def _impossible(t: Times, x: Floats, step: float, limits: Limits) -> Bools:
    """The samples that the kept ones exclude, or all, shape (n,)."""
    found = np.zeros(len(x), dtype=np.bool_)
    change = np.diff(x)
    if len(x) < 5 or np.abs(change).max() <= limits.least:
        return found
    seconds = (t - t[0]) / 1e9
    refresh = max(float(np.median(np.diff(seconds))), _held(seconds, x, step, limits))
    signal = _Signal(seconds, x, _rest(seconds, x, step), refresh, limits)
    at = np.arange(len(x) - 1)
    if signal.possible(at, at + 1).all():
        return found
    # Only at large changes can one that is possible by itself belong to an excursion.
    cut = np.flatnonzero(np.abs(change) > limits.least / 2.0) + 1
    first = np.concatenate([[0], cut])
    past = np.append(cut, len(x))
    changes = np.cumsum(np.diff(x, prepend=x[0]) != 0.0)
    weight = changes[past - 1] - changes[first] + _REPEATED * (past - first)
    shows = x[first] != 0.0
    weight[~shows] *= _ZERO
    kept = _heaviest(signal, first, past - 1, weight)
    if weight[kept & shows].sum() < _CLEAR * weight[shows].sum():
        steps = np.sign(change[~signal.possible(at, at + 1)])
        returns = np.mean(steps[1:] != steps[:-1]) if len(steps) > 1 else 0.0
        return np.full(len(x), returns > _RETURNS)
    stays = 0
    for a, b in true_runs(~kept):
        inside = slice(first[a], past[b - 1])
        ends = a == 0 or b == len(kept)
        lasts = np.inf if ends else seconds[inside.stop - 1] - seconds[inside.start]
        if lasts > limits.longest:
            stays += 1
        else:
            found[inside] = not ends or not np.ptp(x[inside])
    return found if stays <= len(true_runs(found)) else np.zeros_like(found)


def _heaviest(
    signal: _Signal, first: NDArray[np.int64], last: NDArray[np.int64], weight: Floats
) -> Bools:
    """The pieces that can follow each other and weigh most together, shape (k,)."""
    total, before = weight.copy(), np.full(len(weight), -1)
    for k in range(1, len(weight)):
        some = np.arange(max(0, k - _BACK), k)
        sums = np.where(signal.possible(last[some], first[k : k + 1]), total[some], 0.0)
        best = int(np.argmax(sums))
        if sums[best] > 0.0:
            total[k] += sums[best]
            before[k] = some[best]
    kept = np.zeros(len(weight), dtype=np.bool_)
    k = int(np.argmax(total))
    while k >= 0:
        kept[k] = True
        k = before[k]
    return kept


def _rest(seconds: Floats, x: Floats, step: float) -> Bools:
    """Where a signal reads zero for long, or at its beginning or end; shape (n,)."""
    zero = np.abs(x) <= step / 2.0
    for a, b in true_runs(zero):
        zero[a:b] = a == 0 or b == len(x) or seconds[b - 1] - seconds[a] >= STANDS
    return zero


def by_noise(c: Channel, least: float) -> float:
    """More than two samples differ by from white noise and rounding.

    By the median bend of the samples that lie within it, beginning with `least`: noise brings in
    more of itself each time, drop-outs stay outside however many they are.
    """
    x, sigma, before = c.data.value, 0.0, -1.0
    bend = np.abs(np.diff(x[np.diff(x, prepend=np.nan) != 0.0], 2))
    while sigma > 1.01 * before:
        before = sigma
        inside = bend[bend <= 2.0 * least + 10.0 * sigma + 6.0 * c.coarsest]
        if len(inside):
            middle = 1.4826 * float(np.median(inside))
            sigma = max(sigma, (middle - 3.0 * c.coarsest) / math.sqrt(6.0))
    return 8.0 * sigma + 6.0 * c.coarsest


def _held(seconds: Floats, x: Floats, step: float, limits: Limits) -> float:
    """How long a signal that goes on changing one way holds each value [s]; 0 where unknown.

    More than its own rate where a slow signal stands in a fast table. Single steps of a rounded
    signal do not show it, nor do excursions: they come back. One that never goes on and may be a
    brake's steps holds each for the least time between two.
    """
    change = np.diff(x)
    at = np.flatnonzero(np.abs(change) > 1.5 * step)
    on = np.sign(change[at][1:]) == np.sign(change[at][:-1])
    if on.any():
        return float(np.median(np.diff(seconds[at + 1])[on]))
    if limits.longest == np.inf:
        return 0.0
    return float(np.diff(seconds[np.flatnonzero(change)]).min(initial=limits.longest))
