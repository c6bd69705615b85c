"""A speed that is counted in pulses: what its samples say, and which of them."""

import math

import numpy as np

from ..core.model import AxleRecord, Floats
from ..core.signals import bends, running_integral
from .noise_fit import seconds_of
from .smoother import UnbrokenRun

_PULSES = 24.0  # of a counter that give a speed to a few percent
_COUNT_NOISE = 0.18  # noise of its counts in pulses²; 0.28 where all phases occur, rounding 0.08
_SHORT_TIME = 0.1  # a slide hardly changes within [s]
_KNOTS = 6  # samples of a run of equal speeds that are used
_DITHER = 2  # samples that a level of dither lasts; longer, and its errors are not independent


def counts_together(run: AxleRecord) -> int:
    """How many samples of a pulse counter to take together; 0 for another sensor.

    Together they have `_PULSES`, but they are no longer than `_SHORT_TIME`.
    """
    y, step, t = run.wheel_speed, run.wheel_speed_step, seconds_of(run)
    if step == 0.0 or len(y) < 100:
        return 0
    if not (run.of_totals or _dithers(t, y / step)):
        return 0
    interval = float(np.median(np.diff(t)))
    m = min(_PULSES * step / max(float(np.median(y)), step), _SHORT_TIME / interval)
    return max(round(m), 1)


def _dithers(t: Floats, y: Floats) -> bool:
    """Whether whole numbers y change from sample to sample as counts of pulses do.

    Counters lose no pulse: sums over four samples vary no more than one sample does. Sums of
    rounded noise vary four times as much. A rounded ramp looks similar, but its error is half a
    step only, while a count has errors at both ends. Only parts where y changes are judged.
    """
    starts = np.linspace(0, len(y) - 100, min(len(y) // 50, 100)).astype(int)
    window_t, window = (x[starts[:, None] + np.arange(100)] for x in (t, y))
    halves = (x.reshape(-1, 2, 50) for x in (window_t, window))
    single_noise = bends(*halves).mean(axis=2).mean(axis=1)
    judged = single_noise >= 1.0 / 24.0
    if judged.sum() < 2:
        return False
    window_t, window, single_noise = window_t[judged], window[judged], single_noise[judged]
    sums = sum(window[:, i : 97 + i] for i in range(4))
    sum_noise = [bends(window_t[:, i:-3:4], sums[:, i::4]).mean(axis=1) for i in range(4)]
    ratio = np.median(np.mean(sum_noise, axis=0) / single_noise)
    return bool(np.median(single_noise) >= _COUNT_NOISE and ratio <= 2.0)


def count_pulses(run: AxleRecord) -> float:
    """Mean pulses of a counter in `_SHORT_TIME`; inf for at least `_PULSES`, or no counter.

    A speed below its step is a counter's.
    """
    step, mean = run.wheel_speed_step, float(np.mean(run.wheel_speed))
    if step == 0.0:
        return math.inf
    pulses = mean / step * _SHORT_TIME / float(np.median(np.diff(seconds_of(run))))
    return pulses if pulses < _PULSES and (mean < step or counts_together(run) > 0) else math.inf


def pulse_means(run: AxleRecord, ripple: Floats, rolling: UnbrokenRun, m: int) -> UnbrokenRun:
    """A counter's run in means over m samples, at their middle, of the level without ∫u.

    The only error is the rounding at both ends of a mean. A sample counts the interval before it,
    or, if the log has totals, the interval about it.
    """
    m = min(m, len(run) // 4)
    n, t = len(run) // m * m, rolling.t
    interval = float(np.median(np.diff(t)))
    stop = t + interval / 2.0 if run.of_totals else t
    start = np.maximum(np.concatenate([stop[:1], stop[:-1]]), stop - 1.5 * interval)
    start[0] = stop[0] - interval
    gained = [np.interp(x, t, running_integral(t, rolling.u)) for x in (start, stop)]
    y = np.mean((run.wheel_speed - ripple - np.mean(gained, axis=0))[:n].reshape(-1, m), axis=1)
    start, stop = start[:n:m], stop[m - 1 : n : m]
    middle = (start + stop) / 2.0
    input_variance = np.diff(np.interp(middle, t, np.cumsum(rolling.input_variance)), prepend=0.0)
    own_variance = np.full(len(y), run.wheel_speed_step**2 / 6.0 / m**2)
    s = np.interp(middle, t, rolling.s)
    variances = input_variance, own_variance
    return UnbrokenRun(middle, y, np.zeros(len(y)), s, *variances, stop - start)


def remove_steps(t: Floats, y: Floats, step: Floats) -> tuple[Floats, Floats]:
    """A signal rounded to these steps (n,), and its variance (n,); inf: a repeated sample.

    Rounding errors are independent only if the signal moves a step per sample. If it stays on a
    level for several, it is known best at the change to the next: half way, to within its movement
    in one interval. The run of equal values then counts as one sample. Where two levels alternate
    from sample to sample the errors are independent again: noise, or a pulse counter. A counter
    that measures the period of pulses has varying steps, and repeats its last value until the next
    pulse.
    """
    n, variance = len(y), step**2 / 12.0
    run_start = np.flatnonzero(np.diff(y, prepend=np.nan) != 0.0)  # of each run of equal values
    if len(run_start) == n or not step.any():
        return y, variance
    length = np.diff(run_start, append=n)
    jump = np.diff(y[run_start])
    returns = np.zeros(len(run_start) + 2, dtype=bool)  # runs that end where they came from
    returns[2:-2] = jump[1:] * jump[:-1] < 0.0
    dither = np.repeat(returns[1:-1] & (returns[:-2] | returns[2:]) & (length <= _DITHER), length)

    run_length, count = np.repeat(length, length), np.repeat(np.minimum(length, _KNOTS), length)
    place = np.arange(n) - np.repeat(run_start, length)  # in its run
    knot = place * (count - 1) // np.maximum(run_length - 1, 1)
    is_knot = np.diff(knot, prepend=-1) != 0
    is_knot[run_start] = True
    level, own_variance = y.copy(), np.where(is_knot, count * variance, np.inf)

    large_jump = np.abs(np.concatenate([[0.0], jump, [0.0]])) >= 1.5 * step[[*run_start, -1]]
    change, lasts = run_start[1:], np.diff(t[run_start], append=t[-1])
    slow = (np.minimum(length[1:], length[:-1]) > 1) & (np.abs(jump) < 1.5 * step[change])
    fast = np.concatenate([change[~slow], change[~slow] - 1])
    own_variance[fast] = variance[fast]
    change, jump, lasts = change[slow], jump[slow], np.minimum(lasts[1:], lasts[:-1])[slow]
    share = np.minimum((t[change] - t[change - 1]) / lasts, 1.0)  # of a step in one interval
    level[change] -= 0.5 * jump * (1.0 - share)
    own_variance[change] = variance[change] * share**2
    if np.ptp(step) > 0.0:
        waits = (length > 1) & (large_jump[1:] | large_jump[:-1])
        own_variance[np.repeat(waits, length)] = np.inf
        own_variance[run_start[waits]] = variance[run_start[waits]]
    return np.where(dither, y, level), np.where(dither, variance, own_variance)


def informative_samples(run: UnbrokenRun, mean: bool = False) -> UnbrokenRun:
    """The informative samples, of the level without ∫u; the run itself if all are.

    A step of the smoother without a measurement would only blur its regimes. With `mean`, each
    sample is the mean since the one before.
    """
    t, informative = run.t, np.isfinite(run.own_variance)
    if informative.all() and not mean:
        return run
    h = np.diff(t, prepend=t[0] - np.median(np.diff(t))) * mean
    start = t - np.minimum(h, 1.5 * np.median(h))
    gained = np.mean([np.interp(x, t, running_integral(t, run.u)) for x in (start, t)], axis=0)
    middle = (start + t) / 2.0
    input_variance = np.interp(middle, t, np.cumsum(run.input_variance))[informative]
    return UnbrokenRun(
        middle[informative],
        (run.y - gained)[informative],
        np.zeros(np.sum(informative)),
        np.interp(middle, t, run.s)[informative],
        np.diff(input_variance, prepend=0.0),
        run.own_variance[informative],
        (t - start)[informative],
    )
