"""How wrong the speeds of an axle and of its train may be."""

import math

import numpy as np

from ..core import physics
from ..core.model import AxleRecord, Floats
from .events import END_SLIP

COASTING_RATE = 0.3  # largest deceleration of a coasting train [m/s²]
DRIVING_RATE = 0.1  # and largest acceleration: a driven wheel creeps [m/s²]
DELAY_SIGMA = 0.2  # 1 sigma of a fast train speed's delay that the log does not show [s]
_KNOWN_DELAY = 0.1  # 1 sigma of a delay up to which slides are measured, not bounded [s]
CLEAR_SIGMAS = 2.0  # sigma that are more than noise
_TURNING_SPEED = 1.0  # below this, a speed sensor may read zero, without its noise [m/s]
_ROLLING_DIFFERENCE = 0.2  # a wheel this close to the train's speed rolls [m/s]
_LONGEST_NOISE = 1.0  # longest time scale of noise that matters to the slope [s]
_MEDIAN_OF_SIGMA = 0.6745  # median of the absolute value of a normal variable of 1 sigma


def speed_noise(record: AxleRecord, radius: float) -> Floats:
    """1 sigma of the noise of v − ωR [m/s] while braked and moving, shape (n,).

    The train speed's noise is its second difference over three values a time apart: the largest for
    times up to `_LONGEST_NOISE`, as a receiver's filter makes noise slow. The train's motion bends
    v,
    too: the smaller counts of v itself and of v − ωR of a rolling wheel. Where v bends more than
    its noise, as when the train stops between two samples, that bend is the error.
    """
    assert record.train_speed is not None
    v, rim = record.train_speed, record.wheel_speed * radius
    braked = (record.clamping_force > physics.NO_FORCE) & (v > _TURNING_SPEED)
    rolls = braked & (np.abs(v - rim) < np.maximum(END_SLIP * v, _ROLLING_DIFFERENCE))
    h = float(np.median(np.diff(record.t))) * 1e-9
    train = 0.0
    for m in sorted({round(x) for x in np.geomspace(1, max(1, round(_LONGEST_NOISE / h)), 8)}):
        levels = [
            float(np.median(values)) / _MEDIAN_OF_SIGMA
            for x, selected in ((v, braked), (v - rim, rolls))
            if len(values := (bend := _bend(record, x, m))[selected & np.isfinite(bend)]) > 10 * m
        ]
        train = max(train, min(levels, default=0.0))
    turns = _bend(record, rim, 1)[v > _TURNING_SPEED]
    turns = turns[np.isfinite(turns)]
    wheel = float(np.median(turns)) / _MEDIAN_OF_SIGMA if len(turns) else 0.0
    reading = max(1, round(record.train_speed_interval / h))
    between_readings = _bend(record, v, reading) / CLEAR_SIGMAS
    noise: Floats = np.hypot(np.fmax(train, between_readings), wheel)
    return noise


def deceleration(record: AxleRecord) -> Floats:
    """Deceleration of the train over about a second [m/s²], at least 0, shape (n,)."""
    assert record.train_speed is not None
    rate = np.zeros(len(record))
    for s in record.segments:
        t, v = (record.t[s] - record.t[s.start]) * 1e-9, np.nan_to_num(record.train_speed[s])
        start, stop = np.maximum(t - 0.5, t[0]), np.minimum(t + 0.5, t[-1])
        rate[s] = (np.interp(start, t, v) - np.interp(stop, t, v)) / (stop - start)
    return np.maximum(rate, 0.0)


def has_slow_receiver(record: AxleRecord) -> bool:
    """Whether the train speed is a receiver's, whose delay is long and unknown."""
    is_slow = record.train_speed_interval > physics.RECEIVER_INTERVAL
    return is_slow and record.train_speed_late is None


def has_uncertain_delay(record: AxleRecord) -> bool:
    """Whether slides beside this train speed are lower bounds: only the certain slip counts."""
    return record.train_speed is not None and delay_sigma(record) > _KNOWN_DELAY


def speed_error(record: AxleRecord) -> Floats:
    """1 sigma of slip by the train speed's delay and drift, one error for all, shape (n,)."""
    if record.train_speed is None:
        return np.zeros(len(record))
    sigma = record.train_speed_sigma
    with np.errstate(divide="ignore", invalid="ignore"):
        of_itself = 0.0 if sigma is None else sigma / record.train_speed
    return np.hypot(delay_error(record), of_itself)


def unknown_delay(interval: float) -> float:
    """1 sigma of a delay that the log does not show, of a train speed with this interval [s]."""
    if interval > physics.RECEIVER_INTERVAL:
        return max(physics.RECEIVER_DELAY, 0.5 * interval)
    return DELAY_SIGMA


def delay_sigma(record: AxleRecord) -> float:
    """1 sigma of the delay that is left in the train speed of an axle [s]."""
    if record.train_speed_late is not None:
        return record.train_speed_late.tolerance
    return unknown_delay(record.train_speed_interval)


def delay_error(record: AxleRecord) -> Floats:
    """1 sigma of slip by the uncertain delay of the train speed, σ_τ (−v̇)/v, shape (n,)."""
    assert record.train_speed is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        error: Floats = delay_sigma(record) * deceleration(record) / record.train_speed
    return error


def _bend(record: AxleRecord, x: Floats, m: int) -> Floats:
    """Second difference of x over m samples, as 1 sigma of noise; shape (n,)."""
    differences = np.full(len(x), np.nan)
    for s in record.segments:
        if s.stop - s.start > 2 * m:
            y = x[s]
            differences[s][m:-m] = np.abs(y[2 * m :] - 2.0 * y[m:-m] + y[: -2 * m]) / math.sqrt(6.0)
    return differences
