"""The noise of a sensor, learned from its readings as they come.

Its variance is the mean square of y₁ − (y₀ + y₂)/2, over that of white noise of variance 1. A
smooth signal hardly changes it. Its rounding step is the least change after equal readings, of the
reading or of its inverse: a timer from pulse to pulse counts whole ticks. A wheel that starts after
it stood shows no step: zero is repeated without rounding. A counter loses no pulse. So sums over
four of its readings vary no more than one does. Those of white noise vary four times as much.

Vibration, run-out and the teeth of a pole wheel are no white noise: neighbouring readings have
nearly the same error. Means over slices of 0.05 s show it, because they vary more than those of
white noise. So a slow filter takes the noise for white noise whose means vary as much.
"""

import math
from typing import NamedTuple

from ._mixture import squared

_SMALLEST_MEMORY = 50.0  # readings that the memory holds, if its time is shorter
_BLOCK = 4.0  # readings of a sum
_SLICE_TIME = 0.05  # half a period of vibration of 10 Hz [s]
_STANDSTILL_TIME = 1.0  # a wheel without speed for longer stands: that shows no noise [s]
_READING_TIME = 0.01  # a rounded reading counts once in this time [s]
_COUNTER_READINGS = 20.0  # readings that show a counter
_VARIANCE_READINGS = 8.0  # readings that show a variance
_SILENT = 1e-2  # variance over the guess, as long as all readings were the same
_OUTLIER = 10.0  # a square counts at most so many times the variance
_LOWEST = 1e-9  # product of readings below which their inverse shows nothing
_DITHER = 4.0 * math.pi * math.pi
_FLOOR = 1e-12  # least variance over the guess


class Slices(NamedTuple):
    """Means of the readings over slices of time."""

    variance: float  # of one reading of white noise whose means vary as much
    n: float  # means that the variance is of
    size: float  # readings of a slice
    total: float  # of z in this slice
    readings: float  # in it
    time: float  # its duration [s]
    last: float  # mean of the slice before
    first: float  # and of the one before that
    means: float  # their number without interruption


class Latest(NamedTuple):
    """The last reading."""

    y: float
    age: float  # time since the first reading [s]
    same: float  # time for which it has been the same [s]
    z: float  # it less its known changes
    dz: float  # last change of z
    h: float  # in this interval; 0: no reading before


class Blocks(NamedTuple):
    """Totals of z over a few readings."""

    readings: float  # their number
    total: float  # in this block
    last: float  # total of the block before
    first: float  # and of the one before that
    variance: float  # of such a total


class Noise(NamedTuple):
    """What is known of the noise, and the readings that come into it."""

    variance: float
    guess: float  # the variance until enough readings have come
    n: float  # readings that the variance is a mean of
    step: float  # least change of a reading, inf: none seen
    tick: float  # least change of its inverse, inf: none seen
    latest: Latest
    blocks: Blocks
    slices: Slices


def initial_noise(sigma: float, y: float) -> Noise:
    """Before the first change: a guess of the noise, and a reading."""
    v = sigma * sigma
    latest = Latest(y, 0.0, 0.0, y, 0.0, 0.0)
    blocks = Blocks(0.0, 0.0, 0.0, 0.0, _BLOCK * _BLOCK * v)
    slices = Slices(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Noise(v, v, 0.0, math.inf, math.inf, latest, blocks, slices)


def pause(x: Noise, y: float, constant_time: float) -> Noise:
    """After a reading that has no noise: nothing is learned across it."""
    latest = Latest(y, x.latest.age, constant_time, y, 0.0, 0.0)
    blocks = Blocks(0.0, 0.0, 0.0, 0.0, x.blocks.variance)
    slices = Slices(x.slices.variance, x.slices.n, x.slices.size, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Noise(x.variance, x.guess, x.n, x.step, x.tick, latest, blocks, slices)


def safe_variance(x: Noise) -> float:
    """The variance, and not less than the guess as long as it or a rounding step is not known."""
    if x.n < _VARIANCE_READINGS:
        return max(x.variance, x.guess)
    repeats = x.latest.same > 0.0 and x.step == math.inf
    return max(x.variance, _SILENT * x.guess) if repeats else x.variance


def slow_variance(x: Noise) -> float:
    """Variance of white noise as strong as this one for a filter that is slower than a slice.

    Rounding is not in it: a step bounds its errors, and they vary by up to a quarter of its square.
    Noise makes them white: of that, neighbours have exp(−4π²σ²/step²) in common (B. Widrow,
    I. Kollár: Quantization Noise, Cambridge 2008).
    """
    white, square = safe_variance(x), squared(rounding(x))
    if x.slices.n < _VARIANCE_READINGS or x.slices.size < 2.0:
        return white
    common = square / 4.0
    if square > 0.0:
        common *= math.exp(-_DITHER * max(white / square - 1.0 / 12.0, 0.0))
    return max(white, x.slices.variance - x.slices.size * common)


def rounding(x: Noise) -> float:
    """Rounding step of the last reading."""
    if x.step == math.inf:
        return 0.0
    y = x.latest.y
    return max(x.step, min(x.tick * y * y, abs(y)))


def is_informative(x: Noise) -> bool:
    """Whether the last reading is to be used.

    Errors of rounding are not independent. A bound that is used at every sample of a fast log would
    count too often. A step below the guess of the noise does not matter.
    """
    square = squared(rounding(x))
    if square < 12.0 * x.variance or square < _SILENT * x.guess:
        return True
    age = x.latest.age
    return math.floor(age / _READING_TIME) > math.floor((age - x.latest.h) / _READING_TIME)


def new_step(x: Noise, previous: Noise) -> float:
    """The rounding step, at the reading that is the first to show it: all before were rounded."""
    return rounding(x) if previous.step == math.inf else 0.0


def is_counter(x: Noise) -> bool:
    """Whether the readings are those of a pulse counter.

    The error of a slice's total is that of one reading: periods of single teeth may look alike over
    four readings, but not over many.
    """
    if x.blocks.readings < _COUNTER_READINGS or x.blocks.variance >= 2.0 * x.variance:
        return False
    has_slices = x.slices.n >= _VARIANCE_READINGS
    return not has_slices or x.slices.size * x.slices.variance < 4.0 * x.variance


def learn(x: Noise, y: float, h: float, u: float, memory: float, known: float) -> Noise:
    """The noise after one more reading, an interval `h` [s] after the last one.

    `u` is the known change since then, and `known` the probability that it is all of the change but
    noise: the weight of a slice. The variance is a mean over `memory` [s].
    """
    last, step, tick, constant_time = x.latest, x.step, x.tick, x.latest.same + h
    if y != last.y:
        constant_time = 0.0
    elif y == 0.0 and constant_time > _STANDSTILL_TIME:
        return pause(x, y, constant_time)
    if last.same > 0.0 and constant_time == 0.0 and last.y != 0.0:
        step = min(step, abs(y - last.y))
        tick = min(tick, abs(y - last.y) / max(abs(y * last.y), _LOWEST))
    dz = y - last.y - u
    latest = Latest(y, last.age + h, constant_time, last.z + dz, dz, h)
    b = x.blocks
    blocks = Blocks(b.readings + 1.0, b.total + latest.z, b.last, b.first, b.variance)
    slices = _with_slice(x.slices, latest.z, h, known, memory, _OUTLIER * safe_variance(x))
    noise = Noise(x.variance, x.guess, x.n, step, tick, latest, blocks, slices)
    return _average(noise, last, memory) if last.h > 0.0 else noise


def _with_slice(
    x: Slices, z: float, h: float, weight: float, memory: float, largest_square: float
) -> Slices:
    """With one more reading in the slice, and one more mean if its time is over."""
    total, readings, time = x.total + z, x.readings + 1.0, x.time + h
    if time < _SLICE_TIME:
        return Slices(x.variance, x.n, x.size, total, readings, time, x.last, x.first, x.means)
    mean, variance, n = total / readings, x.variance, x.n
    if x.means >= 2.0:
        square = squared(x.last - 0.5 * (x.first + mean)) / 1.5 * readings
        n = min(n + weight, _SMALLEST_MEMORY + memory / time)
        limit = max(_OUTLIER * variance, largest_square)
        variance += weight * (min(square, limit) - variance) / n
    return Slices(variance, n, readings, 0.0, 0.0, 0.0, mean, x.last, x.means + 1.0)


def _average(x: Noise, previous: Latest, memory: float) -> Noise:
    """With one more square in the variance, and one more total if the block is full."""
    step, latest = rounding(x), x.latest
    share = previous.h / (previous.h + latest.h)
    deviation = (1.0 - share) * previous.dz - share * latest.dz
    square = deviation * deviation / (1.0 + share * share + (1.0 - share) * (1.0 - share))
    n = min(x.n + 1.0, _SMALLEST_MEMORY + memory / latest.h)
    largest_square = _OUTLIER * safe_variance(x) + step * step
    variance = max(x.variance + (min(square, largest_square) - x.variance) / n, _FLOOR * x.guess)
    blocks = _with_total(x.blocks, n, largest_square)
    return Noise(variance, x.guess, n, x.step, x.tick, latest, blocks, x.slices)


def _with_total(x: Blocks, n: float, largest_square: float) -> Blocks:
    """With one more total in the variance, and an empty block, if the block is full."""
    count, variance = x.readings / _BLOCK, x.variance
    if count != math.floor(count):
        return x
    if x.readings >= 3.0 * _BLOCK:
        square = squared(x.last - 0.5 * (x.first + x.total)) / 1.5
        variance += (min(square, _BLOCK * largest_square) - variance) / (n / _BLOCK + 1.0)
    return Blocks(x.readings, 0.0, x.total, x.last, variance)
