"""The smoothed speed of a braking, its jerk, and what slides of all axles hide of it.

Source of the highest of n normal errors: G. Blom, Statistical estimates and transformed
beta-variables (1958).
"""

import math
from typing import NamedTuple

import numpy as np

from ..core.model import Bools, Floats, Parameter
from ..core.physics import SLOW
from .signals import FAST, TimeSeries, gains_speed, quantisation_step

FIT = 1.0  # time over which speed and jerk are smoothed by a polynomial [s]
_STEP = 0.02  # of the smoothed speed [s]
_WINDOW = 51  # steps of a polynomial
_PLACES = 20  # of a reading within a step
_NOISE_SHARE, _NOISE_SIGMAS = 0.8, 1.2816  # of normal errors are smaller than so many sigmas
_CORNER = 2.0  # lines between readings hide this share of a corner's jerk, times (interval/FIT)²
_EARLY = 1e-6  # a reading on time may be so early [s]
CREEP = 0.0045, 0.003  # of a braked wheel at 1 m/s², and its 1 sigma: µ is 10 to 60 times the slip
_JERK_NOISE = 0.25  # in which the noise of a jerk has lost two thirds of its correlation [s]
_LAST_TIME = 3.0  # whose deceleration goes on after that [s]
_LOCKING = 0.8  # trains that slow harder in the last metre are slower before [m/s]
_FALL = 0.3  # a speed that falls to zero within twice that time is judged [s]


class SmoothSpeed(NamedTuple):
    """The speed of a braking without its noise; all arrays of shape (n,)."""

    t: Floats  # [s]
    v: Floats  # [m/s]
    is_read: Bools  # whether it is of readings only, of no line over a gap or to standstill
    noise: float  # standard uncertainty of one reading [m/s]
    interval: float  # between readings [s]


def smoothed_speed(speed: TimeSeries, command: float, stop: float, interval: float) -> SmoothSpeed:
    """The smoothed speed of a braking, from the command to standstill [s].

    Local polynomials of second degree over one second, of lines between the readings. They begin a
    second before the command, where the train still rolls. Slow readings, whose `interval` [s] is
    long, are not smoothed. A sensor that reads zero before the train stands is followed by a line
    to standstill.
    """
    run = speed.cut(command - 2.0, stop + interval)
    finite = np.isfinite(run.value)
    raw_t, raw_v = run.t[finite], run.value[finite]
    lead = int(min(FIT, max(command - raw_t[0], 0.0)) / _STEP)  # steps before the command
    t: Floats = command + np.float64(_STEP) * np.arange(-lead, math.ceil((stop - command) / _STEP))
    t = np.append(t, stop)
    last_t = min(stop, float(raw_t[-1]))  # after it, the speed would be constant
    if raw_v[-1] <= 0.0 and raw_v.any():
        first_zero = raw_t[np.flatnonzero(raw_v > 0.0)[-1] + 1]
        count = np.searchsorted(raw_t, min(first_zero - interval + _EARLY, stop))
        last_t = raw_t[max(count - 1, 0)]
        raw_t, raw_v = np.append(raw_t[:count], stop), np.append(raw_v[:count], 0.0)
    v = np.interp(t, raw_t, raw_v)
    place = np.clip(np.searchsorted(raw_t, t), 1, len(raw_t) - 1)
    is_read = raw_t[place] - raw_t[place - 1] <= max(2.0 * FAST, 3.0 * interval)
    is_read &= t <= last_t
    smooth, noise = v, 0.0
    if interval <= FAST and len(v) > _WINDOW:
        smooth, is_read = local_polynomial(v, _WINDOW, 2), _whole_windows(is_read)
        readings = _readings(interval)
        left = readings - local_polynomial(readings, _WINDOW, 2)
        high_error = float(np.quantile(np.abs(v - smooth), _NOISE_SHARE))
        noise = high_error / _NOISE_SIGMAS / _of_noise(left, interval)
    noise = math.hypot(noise, quantisation_step(raw_v) / math.sqrt(12.0))
    return SmoothSpeed(t, np.maximum(smooth, 0.0), is_read, noise, interval)


def _whole_windows(is_read: Bools) -> Bools:
    """Where the whole window around a sample is read."""
    return np.convolve(~is_read, np.ones(_WINDOW), "same") < 0.5


def _readings(interval: float) -> Floats:
    """What readings add to the lines between readings, at even steps, each at another place.

    They stand one after the other, so far away from each other that a filter keeps them apart.
    """
    places = _STEP * np.arange(-2 * _WINDOW, 2 * _WINDOW + 1)
    shifts = _STEP * np.arange(_PLACES) / _PLACES
    return np.maximum(1.0 - np.abs(places - shifts[:, None]) / interval, 0.0).ravel()


def _of_noise(answer: Floats, interval: float) -> float:
    """1 sigma of a filter's values for readings with a noise of 1, mean over the places.

    `answer` is that of the filter to `_readings`, `interval` that between readings [s].
    """
    return float(np.linalg.norm(answer)) * math.sqrt(_STEP / interval / _PLACES)


def locked_time(speed: TimeSeries, t: Floats, v: Floats) -> Parameter:
    """How long the train moves on when all wheels read zero, and 1 sigma of that [s].

    They are locked, or their sensors end: they fall to zero from a speed from which no train stops
    at once. It then slows as before; that speed may be too low, as of wheels that slide.
    """
    final = speed.cut(t[-1] - 2.0 * _FALL, t[-1] - _FALL).value
    before = (t > t[-1] - 2.0 * _FALL - _LAST_TIME) & (t < t[-1] - 2.0 * _FALL)
    if not before.any():
        return Parameter(0.0, 0.0)
    change = float(v[before][0] - v[before][-1]) / max(float(np.ptp(t[before])), 1e-9)
    mean_deceleration = max(change, float(v[0]) / float(t[-1] - t[0]), 1e-9)
    last_speed = float(np.nanmax(final, initial=0.0))
    needed = last_speed / mean_deceleration
    if last_speed < _LOCKING or needed < 4.0 * _FALL:  # twice what it took
        return Parameter(0.0, 0.0)
    return Parameter(needed - 2.0 * _FALL, needed)


def over_slides(t: Floats, v: Floats) -> tuple[Floats, float]:
    """The train's speed by its fastest wheel, and the standard uncertainty of its distance [m].

    No braked train gains speed: where the fastest wheel does, all wheels slid. WSP lets them come
    back near the train's speed again and again; lines between these moments, so that the
    deceleration does not fall, are the train.
    """
    if not gains_speed(v):
        return v, 0.0
    hull: list[int] = []
    for k in range(len(t)):
        while len(hull) > 1:
            i, j = hull[-2:]
            if (v[j] - v[i]) * (t[k] - t[i]) > (v[k] - v[i]) * (t[j] - t[i]):
                break
            hull.pop()
        hull.append(k)
    train = np.interp(t, t[hull], v[hull])
    return train, float(np.trapezoid(train - v, t)) / 2.0


def largest_jerk(speed: SmoothSpeed, command: float, by_wheels: bool = False) -> Parameter | None:
    """Largest |dv²/dt²| from the command to 5 km/h, with 1 sigma [m/s³].

    The highest of several values has the highest of their errors as well. How many there are is the
    time near the highest value, over the time in which the noise changes: at most as much as that
    many normal errors have, and half of it is subtracted. Polynomials at the end of the smoothed
    speed have more noise, so it has to begin before the command. Where a window reaches into a gap,
    or behind the last reading, there is no jerk.

    Lines between readings smooth, too: most where a deceleration begins at once. The noise is that
    of the readings, not of the samples on these lines. Wheels that show the speed creep more as the
    brake builds up, the more the faster they are: that share is taken off. None for slow readings,
    and for brakings below a second.
    """
    v, interval = speed.v, speed.interval
    if interval > FAST or len(v) <= 2 * _WINDOW:
        return None
    judged = (v > SLOW) & (speed.t >= command - 1e-9) & _whole_windows(speed.is_read)
    if judged.sum() < 5:
        return None
    jerk = np.abs(_third_degree(v))[judged]
    answer = _third_degree(local_polynomial(_readings(interval), _WINDOW, 2))
    sigma = speed.noise * _of_noise(answer, interval)
    highest = float(np.max(jerk))
    near_time = float(np.sum(jerk > highest - 2.0 * sigma)) * _STEP
    n = 1.0 + near_time / _JERK_NOISE
    half_excess = 0.5 * sigma * excess_of_highest(n)
    lost = 0.5 * _CORNER * (interval / FIT) ** 2 * highest
    creep, creep_sigma = (by_wheels * x * v[judged][np.argmax(jerk)] / FIT for x in CREEP)
    train = max(highest - half_excess, 0.0) / (1.0 + creep)
    return Parameter(train, math.hypot(sigma, half_excess, lost, creep_sigma * train))


def excess_of_highest(n: float) -> float:
    """How high the highest of n normal errors is to be expected, in sigma. Source: Blom."""
    from scipy.special import ndtri  # slow to import

    return max(float(ndtri((n - 0.375) / (n + 0.25))), 0.0)


def _third_degree(v: Floats) -> Floats:
    """Second derivative of a speed by polynomials of third degree [m/s³]."""
    return local_polynomial(v, _WINDOW, 3, derivative=2) / _STEP**2


def local_polynomial(x: Floats, window: int, degree: int, derivative: int = 0) -> Floats:
    """Least-squares polynomials over a moving window of samples (odd), or a derivative of them.

    At the ends, those of the first and the last whole window. Source: A. Savitzky, M. J. E. Golay,
    Analytical Chemistry 36 (1964).
    """
    half_width = window // 2
    place = np.arange(-half_width, half_width + 1, dtype=np.float64)
    fit = np.linalg.pinv(np.vander(place, degree + 1, increasing=True))  # coefficients per sample

    def weights_at(places: Floats) -> Floats:
        """Weights of the samples of a window at places of it, (m, window)."""
        powers = np.arange(derivative, degree + 1)
        factors = np.array([math.perm(int(power), derivative) for power in powers])
        terms: Floats = factors * places[:, None] ** (powers - derivative)
        return terms @ fit[derivative:]

    middle = np.convolve(x, weights_at(np.zeros(1))[0][::-1], "valid")
    first_values = weights_at(place[:half_width]) @ x[:window]
    last_values = weights_at(place[half_width + 1 :]) @ x[-window:]
    return np.concatenate([first_values, middle, last_values])
