"""Speed sensors that are stuck.

A sensor is stuck only where a working one could not repeat its last value. The rest of the train
shows that, or else the brake of this wheel.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import time_axis
from ..core.methods import About
from ..core.model import Bools, Channel, Floats, Quantity
from .faults import Fault
from .outliers import noise
from .repeats import Runs, runs

ABOUT = About("Stuck speeds", "the other speeds of the train, or the usual effect of its brake")
Indices = NDArray[np.int64]


class Params(NamedTuple):
    """Thresholds."""

    lasts: Annotated[float, Quantity("s", "a wheel that recovers stays as long at one value")] = 0.4
    stays: Annotated[float, Quantity("-", "times the usual number of equal samples", 1.0)] = 2.5
    steps: Annotated[float, Quantity("-", "quantisation steps: others changed more", 1.0)] = 4.0
    steps_alone: Annotated[float, Quantity("-", "the same, by the brake alone", 1.0)] = 6.0
    moves: Annotated[float, Quantity("-", "of itself: a smaller change is none", 0.0, 1.0)] = 0.02
    moves_much: Annotated[float, Quantity("-", "of one that never changes", 0.0, 1.0)] = 0.1
    leaps: Annotated[float, Quantity("-", "of the expected change, at the end", 0.0, 1.0)] = 0.3
    slow: Annotated[float, Quantity("rad/s", "slower, it is about to stand; train m/s")] = 1.0
    fast: Annotated[float, Quantity("rad/s", "others turn, and it never does; train m/s")] = 5.0
    applied: Annotated[float, Quantity("-", "of the highest force: a brake is on", 0.0, 1.0)] = 0.2
    early: Annotated[float, Quantity("s", "by which a train speed's clock may be early")] = 5.0
    rollers: Annotated[float, Quantity("-", "of its speed: rollers slow it by less")] = 0.35


def of_wheel(p: Params, speed: Channel, clamping: Floats, others: Sequence[Channel]) -> list[Fault]:
    """A stuck wheel speed.

    Args:
        p: thresholds.
        speed: wheel speed [rad/s].
        clamping: K at its times, shape (n,) [N].
        others: speeds of the other wheels and of the train.
    """
    return [Fault("speed-stuck", stuck(p, speed, clamping, others))]


def of_train(p: Params, train: Channel, wheels: Sequence[Channel]) -> list[Fault]:
    """A stuck train speed [m/s], by the wheel speeds [rad/s].

    The last value may be the end of a log whose train speed is early, or that of rollers.
    """
    frozen = stuck(p, train, np.zeros(len(train.data.t)), wheels, np.nanmin)
    same = runs(train)
    if same.value[-1] > p.slow and frozen[same.first[-1] :].any():
        last = same.first[-1:], same.last[-1:]
        moved = min((_moved(train, *last, w)[0] for w in wheels), default=0.0)
        if same.seconds[-1] < p.early or not moved > p.rollers:
            frozen[same.first[-1] :] = False
    return [Fault("train-speed-stuck", frozen)]


def stuck(
    p: Params, speed: Channel, clamping: Floats, others: Sequence[Channel] = (),
    among: Callable[..., Floats] = np.nanmedian,
) -> Bools:  # fmt: skip
    """Samples at which a stuck speed sensor repeats its last value, shape (n,).

    The speed should have changed as much as the other axles and the train. Where the log has none,
    the usual effect of the brake counts. Then the speed leaps by a good part of that,
    or never changes again. A wheel that turns from sliding to recovering leaves its value gently.
    The highest value of all may be the end of the sensor's range: there the train speed counts.

    Args:
        p: thresholds.
        speed: wheel speed [rad/s], or train speed [m/s].
        clamping: K at the speed's times, shape (n,).
        others: speeds of other axles and the train, in any unit.
        among: of what the others moved by, what counts.
    """
    y, same = speed.data.value, runs(speed)
    value = same.value
    long = (same.length >= 3) & (same.seconds > p.lasts) & (value > p.slow)
    if long.any():
        long &= same.length >= p.stays * _usual(y)
    if y.max() < 0.1 * p.slow and any(other.data.value.max() > p.fast for other in others):
        return np.ones(len(y), dtype=np.bool_)  # it never turns, and the train runs
    if not long.any():
        return np.zeros(len(y), dtype=np.bool_)
    expected = _expected(p, speed, clamping, same)
    steps = np.full(len(value), p.steps_alone)
    ends = np.zeros(len(value), dtype=np.bool_)  # of the sensor's range
    if others:
        moved = np.array([_moved(speed, same.first, same.last, other) for other in others]) * value
        # Where all of them stand still to the last digit, it is the logger that does.
        known = np.isfinite(moved).any(axis=0) & (np.nan_to_num(moved).max(axis=0) > 0.0)
        expected[known] = among(moved[:, known], axis=0)
        steps[known] = p.steps
        for of_train in moved[[c.meaning == "train_speed" for c in others]]:
            ends = known & np.isfinite(of_train) & (value >= y.max())
            expected[ends] = of_train[ends]  # all wheels may be at that end
    constant = not np.ptp(y)
    least = np.where(ends | constant, p.moves_much, p.moves)  # one value shows no step
    found = long & (expected > np.maximum(steps * speed.coarsest, least * value))
    found &= ends | (same.leap > p.leaps * expected)
    if constant and found.any():
        return np.ones(len(y), dtype=np.bool_)
    return same.repeated(found)


def _usual(y: Floats) -> float:
    """Usual number of samples with one value, the longest apart: that one is on trial."""
    stands = np.diff(np.flatnonzero(np.diff(y, prepend=np.nan)), append=len(y))
    return float(np.median(np.sort(stands)[:-1])) if len(stands) > 1 else 1.0


def _moved(speed: Channel, first: Indices, last: Indices, other: Channel) -> Floats:
    """By which share of itself another speed changed between pairs of samples; shape (k,).

    From end to end, or in between by more than its noise. NaN where it hardly moves at all.
    """
    x = time_axis.interpolated(time_axis.Over(speed.data.t, 0, 1), other)
    low, high = (of.reduceat(x, first) for of in (np.fmin, np.fmax))
    change = np.abs(x[last] - x[first])
    fast = 0.1 * np.max(other.data.value)
    share, between = np.full((2, len(change)), np.nan)
    np.divide(change, x[first], out=share, where=x[first] > fast)
    np.divide(high - low - noise(other), high, out=between, where=high > fast)
    moved: Floats = np.fmax(share, np.fmax(between, 0.0))
    return moved


def _expected(p: Params, speed: Channel, clamping: Floats, same: Runs) -> Floats:
    """By how much K would have slowed the wheel within each stretch, by its own rate; (k,)."""
    t, y = speed.data.t, speed.data.value
    applied = (clamping > p.applied * np.nanmax(clamping, initial=0.0)) & (y > 0.0)
    dt = np.diff(t) / 1e9
    both = applied[1:] & applied[:-1] & (dt > 0.0) & (np.diff(t) <= speed.gap_ns)
    usual = float(np.median(dt)) if len(dt) else 0.0
    m = max(1, min(len(dt), round(1.0 / max(usual, 1e-9))))  # over a second: above the noise
    far = (t[m:] - t[:-m]) / 1e9
    pair = applied[m:] & applied[:-m] & (far > 0.0) & (far < 2.0 * m * usual)
    if not pair.any():
        return np.zeros(len(same.first))
    mean = (clamping[1:] + clamping[:-1]) / 2.0
    impulse = np.concatenate([[0.0], np.cumsum(np.where(both, mean * dt, 0.0))])
    over = (impulse[m:] - impulse[:-m])[pair].sum()
    by_impulse = float(np.abs(y[m:] - y[:-m])[pair].sum() / over) if over > 0.0 else 0.0
    expected: Floats = by_impulse * (impulse[same.last] - impulse[same.first])
    return expected
