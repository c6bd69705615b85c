"""Speed sensors that are stuck.

A sensor is stuck only where a working one could not repeat its last value. The rest of the train
shows that, or else the brake of this wheel.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.methods import About
from ..core.model import Bools, Channel, Floats, Quantity, fraction
from ..core.physics import clamping_force
from ..core.sample_times import SampleTimes
from .choose import AxleChoice, Channels, Key
from .faults import Fault, RepeatedRuns
from .outliers import noise

ABOUT = About("Stuck speeds", "the other speeds of the train, or the usual effect of its brake")
Indices = NDArray[np.int64]


class Params(NamedTuple):
    """Thresholds."""

    lasts: Annotated[float, Quantity("s", "a wheel that recovers stays as long at one value")] = 0.4
    stays: Annotated[float, Quantity("-", "times the usual number of equal samples", 1.0)] = 2.5
    steps: Annotated[float, Quantity("-", "quantisation steps: others changed more", 1.0)] = 4.0
    steps_alone: Annotated[float, Quantity("-", "the same, by the brake alone", 1.0)] = 6.0
    moves: Annotated[float, fraction("of itself: a smaller change is none")] = 0.02
    moves_much: Annotated[float, fraction("of one that never changes")] = 0.1
    leaps: Annotated[float, fraction("of the expected change, at the end")] = 0.3
    slow: Annotated[float, Quantity("rad/s", "slower, it is about to stand; train m/s")] = 1.0
    fast: Annotated[float, Quantity("rad/s", "others turn, and it never does; train m/s")] = 5.0
    applied: Annotated[float, fraction("of the highest force: a brake is on")] = 0.2
    early: Annotated[float, Quantity("s", "by which a train speed's clock may be early")] = 5.0
    late: Annotated[float, Quantity("s", "by which a receiver's train speed may be late")] = 1.5
    rollers: Annotated[float, Quantity("-", "of its speed: rollers slow it by less")] = 0.35


def find_wheel_faults(
    p: Params, channels: Channels, repeats: Mapping[Key, RepeatedRuns], axles: Sequence[AxleChoice]
) -> dict[Key, list[Fault]]:
    """Where each wheel speed is stuck; `repeats` has where a channel repeats a value."""
    faults = {}
    for axle in reversed(axles):
        speed, brake = channels.get(axle.speed), channels.get(axle.brake)
        if speed and brake:
            other_keys = [k for k in channels if k[0] == "wheel_speed" and k != axle.speed]
            other_keys += [k for k in channels if k[0] == "train_speed"]
            other_speeds = [channels[k] for k in other_keys]
            force, _ = SampleTimes(speed.data.t, speed.pieces).last_value(brake)
            if brake.meaning == "pressure":
                force = clamping_force(force, axle.vehicle)
            is_stuck = stuck(p, speed, repeats[axle.speed], force, other_speeds)
            faults[axle.speed] = [Fault("speed-stuck", is_stuck)]
    return {key: faults[key] for key in channels if key in faults}


def find_train_faults(
    p: Params, channels: Channels, repeats: Mapping[Key, RepeatedRuns]
) -> dict[Key, list[Fault]]:
    """Where a train speed [m/s] is stuck, by the wheel speeds [rad/s]."""
    wheels = [c for k, c in channels.items() if k[0] == "wheel_speed"]
    trains = {key: c for key, c in channels.items() if key[0] == "train_speed"}
    masks = {key: _stuck_train(p, c, repeats[key], wheels) for key, c in trains.items()}
    return {key: [Fault("train-speed-stuck", mask)] for key, mask in masks.items()}


def stuck(
    p: Params,
    speed: Channel,
    equal_runs: RepeatedRuns,
    clamping: Floats,
    other_speeds: Sequence[Channel] = (),
    among: Callable[..., Floats] = np.nanmedian,
) -> Bools:
    """Samples at which a stuck speed sensor repeats its last value, shape (n,).

    The speed should have changed as much as the other axles and the train. Where the log has none,
    the usual effect of the brake counts. Then the speed leaps by a good part of that, or never
    changes again. A wheel that turns from sliding to recovering leaves its value gently. The
    highest value of all may be the end of the sensor's range: there the train speed counts. So it
    does where no other wheel moves. The speed is in rad/s, of a train in m/s, `clamping` is K at
    its times, (n,), and `among` says what counts of that by which the others moved.
    """
    y, value = speed.data.value, equal_runs.value
    is_long_run = (equal_runs.length >= 3) & (equal_runs.seconds > p.lasts) & (value > p.slow)
    if is_long_run.any():
        # without the longest, which is on trial
        lengths = np.sort(np.diff(np.flatnonzero(np.diff(y, prepend=np.nan)), append=len(y)))[:-1]
        is_long_run &= equal_runs.length >= p.stays * (np.median(lengths) if len(lengths) else 1.0)
    if y.max() < 0.1 * p.slow and any(c.data.value.max() > p.fast for c in other_speeds):
        return np.ones(len(y), dtype=np.bool_)  # it never turns, and the train runs
    if not is_long_run.any():
        return np.zeros(len(y), dtype=np.bool_)
    expected = _expected(p, speed, clamping, equal_runs)
    steps = np.full(len(value), p.steps_alone)
    at_range_end = np.zeros(len(value), dtype=np.bool_)  # of the sensor's range
    if other_speeds:
        rows = equal_runs.start, equal_runs.final
        relative_change = value * [_relative_change(speed, *rows, x) for x in other_speeds]
        # Where all of them stand still to the last digit, it is the logger that does.
        comparable = np.isfinite(relative_change).any(axis=0)
        comparable &= np.nan_to_num(relative_change).max(axis=0) > 0.0
        expected[comparable] = among(relative_change[:, comparable], axis=0)
        steps[comparable] = p.steps
        is_train = np.array([c.meaning == "train_speed" for c in other_speeds])
        # All wheel sensors may be stuck together, by the unit that sends them.
        smallest_change = np.maximum(p.steps * speed.coarsest, p.moves * value)
        all_constant = np.all(np.nan_to_num(relative_change[~is_train]) <= smallest_change, axis=0)
        for of_train in relative_change[is_train]:
            is_train_only = comparable & all_constant & np.isfinite(of_train)
            expected[is_train_only] = of_train[is_train_only]
            at_range_end = comparable & np.isfinite(of_train) & (value >= y.max())
            expected[at_range_end] = of_train[at_range_end]  # all wheels may be at that end
    constant = not np.ptp(y)
    # one value shows no step
    smallest_share = np.where(at_range_end | constant, p.moves_much, p.moves)
    is_stuck = is_long_run & (expected > np.maximum(steps * speed.coarsest, smallest_share * value))
    is_stuck &= at_range_end | (equal_runs.leap > p.leaps * expected)
    if constant and is_stuck.any():
        return np.ones(len(y), dtype=np.bool_)
    return equal_runs.repeated(is_stuck)


def _stuck_train(
    p: Params, train: Channel, equal_runs: RepeatedRuns, wheels: Sequence[Channel]
) -> Bools:
    """Samples at which a train speed repeats its last value, shape (n,).

    Braking may have begun while a late train speed still reads that of coasting: only what the
    wheels lose at every possible delay counts. The last value may be the end of a log whose train
    speed is early, or that of rollers.
    """
    shifts = product(wheels, (round(1e9 * x) for x in np.linspace(0.0, p.late, 4)))
    delayed_wheels = [replace(w, data=replace(w.data, t=w.data.t + ns)) for w, ns in shifts]
    frozen = stuck(p, train, equal_runs, np.zeros(len(train.data.t)), delayed_wheels, np.nanmin)
    if equal_runs.value[-1] > p.slow and frozen[equal_runs.start[-1] :].any():
        final_run = equal_runs.start[-1:], equal_runs.final[-1:]
        changes = (_relative_change(train, *final_run, w)[0] for w in wheels)
        smallest_change = min(changes, default=0.0)
        if equal_runs.seconds[-1] < p.early or not smallest_change > p.rollers:
            frozen[equal_runs.start[-1] :] = False
    return frozen


def _relative_change(
    speed: Channel, start: Indices, final: Indices, other_speed: Channel
) -> Floats:
    """By which share of itself another speed changed between pairs of samples; shape (k,).

    From end to end, or in between by more than its noise. NaN where it hardly moves at all.
    """
    x = SampleTimes(speed.data.t).interpolate(other_speed)
    lowest, highest = (extreme.reduceat(x, start) for extreme in (np.fmin, np.fmax))
    change = np.abs(x[final] - x[start])
    fast = 0.1 * np.max(other_speed.data.value)
    share, inner_share = np.full((2, len(change)), np.nan)
    np.divide(change, x[start], out=share, where=x[start] > fast)
    np.divide(highest - lowest - noise(other_speed), highest, out=inner_share, where=highest > fast)
    change_share: Floats = np.fmax(share, np.fmax(inner_share, 0.0))
    return change_share


def _expected(p: Params, speed: Channel, clamping: Floats, equal_runs: RepeatedRuns) -> Floats:
    """By how much K would have slowed the wheel within each stretch, by its own rate; (k,)."""
    t, y = speed.data.t, speed.data.value
    applied = (clamping > p.applied * np.nanmax(clamping, initial=0.0)) & (y > 0.0)
    dt = np.diff(t) / 1e9
    both_applied = applied[1:] & applied[:-1] & (dt > 0.0) & (np.diff(t) <= speed.gap_ns)
    usual = float(np.median(dt)) if len(dt) else 0.0
    m = max(1, min(len(dt), round(1.0 / max(usual, 1e-9))))  # over a second: above the noise
    span = (t[m:] - t[:-m]) / 1e9
    pair = applied[m:] & applied[:-m] & (span > 0.0) & (span < 2.0 * m * usual)
    if not pair.any():
        return np.zeros(len(equal_runs.start))
    mean = (clamping[1:] + clamping[:-1]) / 2.0
    impulse = np.concatenate([[0.0], np.cumsum(np.where(both_applied, mean * dt, 0.0))])
    total_impulse = (impulse[m:] - impulse[:-m])[pair].sum()
    change = float(np.abs(y[m:] - y[:-m])[pair].sum())
    by_impulse = change / total_impulse if total_impulse > 0.0 else 0.0
    expected: Floats = by_impulse * (impulse[equal_runs.final] - impulse[equal_runs.start])
    return expected
