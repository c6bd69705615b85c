"""Samples that no wheel, train or brake cylinder can reach and leave again.

A sensor that fails leaves its signal faster than physics allows, for one sample or for seconds, and
returns as fast. The check keeps the largest part of the samples that one wheel, or one cylinder,
can have passed through in their order. The rest are outliers.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.masks import edges, true_runs
from ..core.methods import About
from ..core.model import Bools, Channel, Floats, Quantity, Times
from ..core.signals import robust_sigma, white_noise
from .choose import BRAKES, Channels, Key
from .faults import Fault

ABOUT = About("Outliers", "limits of wheels, valves and trains as stated for each parameter")
HIGHEST = 12e5  # no brake cylinder has more [Pa]
_FULL_PRESSURE = 5e5  # pressure of the cylinder that the limits are those of [Pa]
_LONGEST_LINK = 300  # pieces that may lie between two that belong together
_REPEAT_WEIGHT = 1e-3  # weight of a sample that repeats its predecessor: dead sensors do
_ZERO_WEIGHT = 0.3  # of the weight of other values: dead sensors read it
_CLEAR_SHARE = 0.65  # of the weight, zeros apart: with less, which part is the wheel's is not known
_RETURN_SHARE = 0.8  # of the impossible steps: with less the signal goes its way, in another unit


class Params(NamedTuple):
    """What a wheel, a train and a cylinder can do."""

    wheel_gains: Annotated[float, Quantity("rad/s²", "rise of a heavy axle on dry rail")] = 250.0
    wheel_loses: Annotated[float, Quantity("rad/s²", "fall of a wheel that locks")] = 150.0
    wheel_steps: Annotated[float, Quantity("rad/s", "change that needs no reason")] = 2.0
    wheel_least: Annotated[float, Quantity("rad/s", "wheel sensors read zero below this")] = 5.0
    wheel_single: Annotated[float, Quantity("rad/s²", "no wheel falls and rises so fast")] = 100.0
    train_changes: Annotated[float, Quantity("m/s²", "harder than any brake of a train")] = 10.0
    train_steps: Annotated[float, Quantity("m/s", "change that needs no reason")] = 1.0
    train_least: Annotated[float, Quantity("m/s", "train sensors read zero below this")] = 2.5
    fills: Annotated[float, Quantity("Pa/s", "rise: a valve fills 5 bar in 0.25 s", 1.0)] = 2e6
    dumps: Annotated[float, Quantity("Pa/s", "fall: a valve releases 5 bar in 0.1 s", 1.0)] = 5e6
    pressure_steps: Annotated[float, Quantity("Pa", "change that needs no reason")] = 2e4
    pressure_lasts: Annotated[float, Quantity("s", "a longer one may be a brake's step")] = 3.0
    pressure_single: Annotated[float, Quantity("1/s", "of the highest value: no valve's")] = 4.0
    vacuum: Annotated[float, Quantity("Pa", "far below zero: a broken wire", -1e6, 0.0)] = -3e4
    rests: Annotated[float, Quantity("s", "zero for this long may be rest")] = 0.3


class Limits(NamedTuple):
    """What one quantity can do, SI."""

    rise: float  # [1/s]
    fall: float  # [1/s]
    free_change: float  # change that needs no reason
    free_from_zero: float  # sensors read zero below this
    longest: float  # a longer excursion may be real [s]
    rests: float  # zero for this long may be rest [s]

    def widened(self, noise: float) -> "Limits":
        """With larger changes that need no reason, as by noise."""
        free_change, free_from_zero = self.free_change + noise, self.free_from_zero + noise
        return self._replace(free_change=free_change, free_from_zero=free_from_zero)


def wheel_limits(p: Params) -> Limits:
    """What a wheel can do [rad/s]."""
    return Limits(p.wheel_gains, p.wheel_loses, p.wheel_steps, p.wheel_least, np.inf, p.rests)


def brake_limits(p: Params, share: float = 1.0) -> Limits:
    """What a cylinder can do [Pa], or another brake quantity with a share of its values."""
    steps = share * p.pressure_steps
    return Limits(share * p.fills, share * p.dumps, steps, steps, p.pressure_lasts, p.rests)


def find_outliers(p: Params, channels: Channels) -> dict[Key, list[Fault]]:
    """The outliers of every brake, wheel and train speed; each is judged alone."""
    brakes = {key: brake_faults(p, c) for key, c in channels.items() if key[0] in BRAKES}
    wheels = {key: wheel_faults(p, c) for key, c in channels.items() if key[0] == "wheel_speed"}
    trains = {key: train_faults(p, c) for key, c in channels.items() if key[0] == "train_speed"}
    return brakes | wheels | trains


def wheel_faults(p: Params, speed: Channel) -> list[Fault]:
    """Faults of a wheel speed [rad/s]: outliers, or a channel of which no part can be trusted."""
    return [_fault("speed-outlier", "speed-unusable", wheel_outliers(p, speed))]


def train_faults(p: Params, speed: Channel) -> list[Fault]:
    """Faults of a train speed [m/s]."""
    limits = Limits(p.train_changes, p.train_changes, p.train_steps, p.train_least, np.inf, p.rests)
    return [_fault("train-speed-outlier", "train-speed-unusable", _excursions(speed, limits))]


def brake_faults(p: Params, brake: Channel) -> list[Fault]:
    """Faults of a pressure [Pa] or of K [N]: outliers, and values far below zero."""
    negative = brake.data.value < p.vacuum * max(scale_of(brake), 1.0)
    outliers = brake_outliers(p, brake) & ~negative
    outlier_fault = _fault("pressure-outlier", "pressure-unusable", outliers)
    return [Fault("pressure-negative", negative), outlier_fault]


def _fault(outlier_code: str, unusable_code: str, outliers: Bools) -> Fault:
    return Fault(unusable_code if outliers.all() else outlier_code, outliers)


def wheel_outliers(p: Params, speed: Channel) -> Bools:
    """Outliers of a wheel speed [rad/s], shape (n,); single zeros at low rates, too."""
    dropped = _single_outliers(speed, p.wheel_single) & (speed.data.value == 0.0)
    outliers: Bools = _excursions(speed, wheel_limits(p)) | dropped
    return outliers


def brake_outliers(p: Params, brake: Channel) -> Bools:
    """Outliers of a pressure [Pa] or of K [N], shape (n,).

    None where more steps stay than return: the signal is no cylinder's, or a slow repeated one.
    """
    rates = brake_limits(p, scale_of(brake))
    single = _single_outliers(brake, p.pressure_single * np.max(brake.data.value, initial=0.0))
    return _excursions(brake, rates) | single


def scale_of(brake: Channel) -> float:
    """By how much a brake's values are larger than those of the cylinder of the limits.

    1 for a pressure, unless its unit is one in which no cylinder has it: the unit is wrong then,
    not the sensor.
    """
    size = np.abs(brake.data.value)
    if brake.meaning == "pressure" and size.max(initial=0.0) <= HIGHEST:
        return 1.0
    high_value = float(np.quantile(size, 0.99))
    is_plausible = brake.meaning == "pressure" and high_value <= HIGHEST
    return 1.0 if is_plausible else high_value / _FULL_PRESSURE


def _single_outliers(c: Channel, steep: float) -> Bools:
    """Samples that depart from both neighbours, which agree, and steeper [SI/s]; shape (n,)."""
    change, dt = np.diff(c.data.value), np.diff(c.data.t) / 1e9
    outliers = np.zeros(len(c.data.t), dtype=np.bool_)
    large = np.abs(change) > steep * dt
    peaks = np.flatnonzero(large[:-1] & large[1:])  # few: only there is more to look at
    if len(change) < 4 or not len(peaks):
        return outliers
    departure, return_change = change[peaks], -change[peaks + 1]
    longer_dt = np.maximum(dt[peaks], dt[peaks + 1])
    smaller = np.minimum(np.abs(departure), np.abs(return_change))
    single = (departure * return_change > 0.0) & (np.abs(departure - return_change) < smaller / 2.0)
    single &= np.minimum(dt[peaks], dt[peaks + 1]) > 0.0
    single &= smaller - noise(c) > steep * longer_dt
    outliers[peaks[single] + 1] = True
    return outliers


def noise(c: Channel) -> float:
    """More than two samples differ by from noise alone."""
    runs = ((c.data.t[s], c.data.value[s]) for s in c.pieces)
    return 8.0 * math.sqrt(white_noise(runs)) + 6.0 * c.coarsest


def _excursions(c: Channel, limits: Limits) -> Bools:
    """Samples that the largest possible part excludes, shape (n,)."""
    outliers = np.zeros(len(c.data.t), dtype=np.bool_)
    if np.abs(np.diff(c.data.value)).max(initial=0.0) <= limits.free_change:
        return outliers
    limits = limits.widened(noise_among_outliers(c, limits.free_change))
    for piece in c.pieces:
        outliers[piece] = _impossible(c.data.t[piece], c.data.value[piece], c.coarsest, limits)
    return outliers


class _Signal(NamedTuple):
    """A channel's piece and what can be between its samples."""

    t: Floats  # [s]
    x: Floats
    resting: Bools  # reads zero and may be at rest
    refresh: float  # no change is quicker than from one reading to the next [s]
    limits: Limits

    def possible(self, earlier: NDArray[np.int64], later: NDArray[np.int64]) -> Bools:
        """Whether one sample can follow another, both by index; shape of the two together."""
        change = self.x[later] - self.x[earlier]
        seconds = np.maximum(self.t[later] - self.t[earlier], self.refresh)
        resting = self.resting[later] | self.resting[earlier]
        free_change = np.where(resting, self.limits.free_from_zero, self.limits.free_change)
        rate = np.where(change > 0.0, self.limits.rise, self.limits.fall)
        is_possible: Bools = np.abs(change) <= free_change + rate * seconds
        return is_possible


class _Pieces(NamedTuple):
    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    weight: Floats  # how much each tells of the true signal
    shows: Bools  # whether it is not zero


def _impossible(t: Times, x: Floats, step: float, limits: Limits) -> Bools:
    """The samples that the kept ones exclude, or all, shape (n,)."""
    no_outliers = np.zeros(len(x), dtype=np.bool_)
    change = np.diff(x)
    if len(x) < 5 or np.abs(change).max() <= limits.free_change:
        return no_outliers
    seconds = (t - t[0]) / 1e9
    refresh = max(float(np.median(np.diff(seconds))), _hold_time(seconds, x, step, limits))
    signal = _Signal(seconds, x, _at_rest(seconds, x, step, limits.rests), refresh, limits)
    large = np.flatnonzero(np.abs(change) > min(limits.free_change, limits.free_from_zero))
    impossible = large[~signal.possible(large, large + 1)]
    if not len(impossible):
        return no_outliers
    pieces = _pieces(x, limits.free_change / 2.0)
    heaviest = _heaviest(signal, pieces)
    weight, shows = pieces.weight, pieces.shows
    if weight[heaviest & shows].sum() < _CLEAR_SHARE * weight[shows].sum():
        steps = np.sign(change[impossible])
        returns = np.mean(steps[1:] != steps[:-1]) if len(steps) > 1 else 0.0
        return np.full(len(x), returns > _RETURN_SHARE)
    return _outside_heaviest(signal, pieces, heaviest)


def _pieces(x: Floats, large: float) -> _Pieces:
    """Parts between large changes: only at one can a possible change belong to an excursion."""
    cuts = np.flatnonzero(np.abs(np.diff(x)) > large) + 1
    start, stop = np.concatenate([[0], cuts]), np.append(cuts, len(x))
    changes = np.cumsum(np.diff(x, prepend=x[0]) != 0.0)
    weight = changes[stop - 1] - changes[start] + _REPEAT_WEIGHT * (stop - start)
    shows = x[start] != 0.0
    weight[~shows] *= _ZERO_WEIGHT
    return _Pieces(start, stop, weight, shows)


def _heaviest(signal: _Signal, pieces: _Pieces) -> Bools:
    """The pieces that can follow each other and weigh most together, shape (k,)."""
    start, final, weight = pieces.start, pieces.stop - 1, pieces.weight
    total, predecessor = weight.copy(), np.full(len(weight), -1)
    for k in range(1, len(weight)):
        candidates = np.arange(max(0, k - _LONGEST_LINK), k)
        is_possible = signal.possible(final[candidates], start[k : k + 1])
        sums = np.where(is_possible, total[candidates], 0.0)
        best = int(np.argmax(sums))
        if sums[best] > 0.0:
            total[k] += sums[best]
            predecessor[k] = candidates[best]
    heaviest = np.zeros(len(weight), dtype=np.bool_)
    k = int(np.argmax(total))
    while k >= 0:
        heaviest[k] = True
        k = predecessor[k]
    return heaviest


def _outside_heaviest(signal: _Signal, pieces: _Pieces, heaviest: Bools) -> Bools:
    """The samples of the other pieces, unless more of these last for so long that they stay."""
    x, t = signal.x, signal.t
    outliers = np.zeros(len(x), dtype=np.bool_)
    lasting_count = 0
    for a, b in true_runs(~heaviest):
        inside = slice(pieces.start[a], pieces.stop[b - 1])
        at_end = a == 0 or b == len(heaviest)
        duration = np.inf if at_end else t[inside.stop - 1] - t[inside.start]
        if duration > signal.limits.longest:
            lasting_count += 1
        else:
            outliers[inside] = not at_end or not np.ptp(x[inside])
    return outliers if lasting_count <= len(true_runs(outliers)) else np.zeros_like(outliers)


def _at_rest(seconds: Floats, x: Floats, step: float, rests: float) -> Bools:
    """Where a signal reads zero for long, or at its beginning or end; shape (n,)."""
    zero = np.abs(x) <= step / 2.0
    start, stop = edges(zero).T
    lasts = (start == 0) | (stop == len(x)) | (seconds[stop - 1] - seconds[start] >= rests)
    zero[zero] = np.repeat(lasts, stop - start)
    return zero


def noise_among_outliers(c: Channel, threshold: float) -> float:
    """More than two samples differ by from white noise and rounding, whatever outliers there are.

    By the median second difference of the samples within it, beginning with `threshold`: noise
    brings in more of itself each time, outliers stay outside however many they are.
    """
    x, sigma, previous = c.data.value, 0.0, -1.0
    bend = np.abs(np.diff(x[np.diff(x, prepend=np.nan) != 0.0], 2))
    while sigma > 1.01 * previous:
        previous = sigma
        inside = bend[bend <= 2.0 * threshold + 10.0 * sigma + 6.0 * c.coarsest]
        if len(inside):
            middle = robust_sigma(inside)
            sigma = max(sigma, (middle - 3.0 * c.coarsest) / math.sqrt(6.0))
    return 8.0 * sigma + 6.0 * c.coarsest


def _hold_time(seconds: Floats, x: Floats, step: float, limits: Limits) -> float:
    """How long a signal that goes on changing one way keeps each value [s]; 0 where unknown.

    More than its own rate where a slow signal is repeated in a fast table. Single steps of a
    rounded signal do not show it. Excursions do not either: they return. A signal that never goes
    on and may be a brake's steps keeps each for the least time between two.
    """
    change = np.diff(x)
    steps = np.flatnonzero(np.abs(change) > 1.5 * step)
    continues = np.sign(change[steps][1:]) == np.sign(change[steps][:-1])
    if continues.any():
        return float(np.median(np.diff(seconds[steps + 1])[continues]))
    if limits.longest == np.inf:
        return 0.0
    return float(np.diff(seconds[np.flatnonzero(change)]).min(initial=limits.longest))
