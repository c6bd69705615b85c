"""Speed sensors that are stuck, and wheels that are locked.

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
from ..core.signals import true_runs
from ..dynamics.train_grid import FREE
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
    zero: Annotated[float, Quantity("rad/s", "a slower wheel stands")] = 0.1
    fast: Annotated[float, Quantity("rad/s", "others turn a free wheel; train m/s")] = 5.0
    unbraked: Annotated[float, Quantity("s", "no free wheel stands longer while others turn")] = 2.0
    applied: Annotated[float, Quantity("-", "of the highest force: a brake is on", 0.0, 1.0)] = 0.2
    early: Annotated[float, Quantity("s", "by which a train speed's clock may be early")] = 5.0
    rollers: Annotated[float, Quantity("-", "of its speed: rollers slow it by less")] = 0.35
    pulses: Annotated[float, Quantity("-", "of a counter are missing: the wheel stands")] = 2.0


def of_wheel(p: Params, speed: Channel, clamping: Floats, others: Sequence[Channel]) -> list[Fault]:
    """A stuck wheel speed, and a locked wheel.

    Args:
        p: thresholds.
        speed: wheel speed [rad/s].
        clamping: K at its times, shape (n,) [N].
        others: speeds of the other wheels and of the train.
    """
    frozen = stuck(p, speed, clamping, others)
    locks = locked(p, speed, others, 2.0 * p.slow) & ~frozen
    return [Fault("speed-stuck", frozen), Fault("wheel-locked", locks, False, "info")]


def of_train(p: Params, train: Channel, wheels: Sequence[Channel]) -> list[Fault]:
    """A stuck train speed [m/s], by the wheel speeds [rad/s]."""
    x, t = train.data.value, train.data.t
    frozen = stuck(p, train, np.zeros(len(x)), wheels, np.nanmin)
    last = int(runs(train).first[-1])
    if frozen[-1] and x[last] > p.slow:
        later = int(np.searchsorted(t, t[last] + round(p.early * 1e9)))
        goes_on = not np.ptp(x) or _all_move(train, wheels, later, p.moves)
        if not (goes_on and _all_move(train, wheels, last, p.rollers)):
            frozen[last:] = False
    return [Fault("train-speed-stuck", frozen)]


def _all_move(train: Channel, wheels: Sequence[Channel], first: int, share: float) -> bool:
    """Whether every wheel changes by more than a share of itself from a train's sample on."""
    last = len(train.data.t) - 1
    if first >= last:
        return False
    return all(_moved(train, np.array([first]), np.array([last]), w)[0] > share for w in wheels)


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
    y, same, dead = speed.data.value, runs(speed), _dead(p, speed, clamping, others)
    value = same.value
    long = same.length >= np.maximum(3.0, p.stays * _usual(y))
    long &= (same.seconds > p.lasts) & (value > p.slow)
    if not long.any():
        return dead
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
    return same.repeated(found) | dead


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


def _dead(p: Params, speed: Channel, clamping: Floats, others: Sequence[Channel]) -> Bools:
    """Where the wheel stands without brake for longer than any wheel of a moving train; (n,).

    One that does not turn in the whole log while the others do shows nothing of a wheel.
    """
    stands, still = locked(p, speed, others, p.fast), _still(p, speed)
    if still.all() and stands.any():
        return still
    free = stands & (clamping <= FREE * np.nanmax(clamping, initial=0.0))
    found = np.zeros(len(stands), dtype=np.bool_)
    for a, b in true_runs(still):
        t = speed.data.t[a:b] / 1e9
        found[a:b] = any(t[j - 1] - t[i] >= p.unbraked for i, j in true_runs(free[a:b]))
    return found


def locked(p: Params, speed: Channel, others: Sequence[Channel], faster: float) -> Bools:
    """Samples at which the wheel stands while half of the rest of the train moves, shape (n,).

    Args:
        p: thresholds.
        speed: wheel speed [rad/s].
        others: speeds of other axles [rad/s] and the train [m/s].
        faster: than this, they move.
    """
    at = time_axis.Over(speed.data.t, 0, 1)
    moving, known = np.zeros((2, len(at.t)), dtype=np.int16)
    slowest = np.full(len(at.t), np.inf)
    for other in others:
        x = time_axis.interpolated(at, other)
        moving += x > faster
        known += np.isfinite(x)
        slowest = np.where(x > faster, np.minimum(slowest, x), slowest)
    stands: Bools = (moving > 0) & (2 * moving >= known) & _still(p, speed)
    for a, b in true_runs(stands):
        # A zero of a counter is less than a pulse. Rad or m: a wheel turns more than it rolls.
        stands[a:b] = np.sum(slowest[a:b]) > p.pulses * speed.step
    return stands


def _still(p: Params, speed: Channel) -> Bools:
    """Samples at which the wheel stands, as far as its sensor shows, shape (n,)."""
    still: Bools = np.abs(speed.data.value) <= max(p.zero, speed.step / 2.0)
    return still
