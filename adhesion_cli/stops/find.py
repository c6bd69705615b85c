"""Where a train was braked to standstill, or would have been: the brakings of a log."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..core.masks import true_runs
from ..core.model import Bools, Floats, Parameter
from ..core.physics import LONGEST_DUMP, SLOW, STANDING
from .signals import StopSignals, TimeSeries, quantisation_step

BEGUN = "the log begins with the brake applied"  # why a braking has no command
ALL_LOCK = "all wheels lock at"  # why a braking has no shape
STEP = 0.1  # of the grid on which brakings are looked for [s]
_ON_SHARE, _OFF_SHARE = 0.08, 0.04  # shares of the highest brake at which a braking begins and ends
_HIGHEST_SHARE = 0.995  # of the samples of a brake: few are higher than the highest that counts
_LARGEST_ZERO = 3e4  # of a pressure sensor: no pads touch below [Pa]
_LEAST_BRAKE = 5e3  # and the least: pressure [Pa], or clamping force [N]
_LEAST_LOSS = 0.2  # of the speed at the begin: less is no stop that failed
_ROLLED_OUT = 8.0 / 3.6  # a brake that is released below this speed has stopped the train [m/s]
_LONGEST_ROLL = 10.0  # and the train then stands after this time [s]
_LONGEST_GAP = 1.0  # without a speed: the distance is not known [s]
_FASTEST_START = 2.0  # that a train reaches in a second [m/s]
_LOCKED = 10.0  # all wheels may be locked for this long [s]
_STOPPING_TIME = 2.0  # time before standstill whose speeds lead to it [s]
_FEWEST = 4  # samples of a line
_BEND_SIGMAS = 4.0  # from which the train slows less in the last second than in the one before
_BENT = 0.02  # 1 sigma of standstill by a friction that rises in the last metres [s]
_SLOWING = 0.15  # deceleration that is braking, where no brake is logged [m/s²]
_HARDEST = 3.5  # no train slows harder by its wheels [m/s²]
_LOCKING_TIME = 0.5  # over which that is a mean [s]
_AVERAGED = 1.0  # time over which that is a mean [s]


class Braking(NamedTuple):
    """One braking of the train."""

    start: float  # the brake is clearly applied, after the start of the log [s]
    stop: float  # standstill, or where the braking ends before it [s]
    reason: str  # why it is no stop, "" where it is one
    stop_sigma: float = 0.0  # standard uncertainty of the time of standstill [s]


def find_brakings(signals: StopSignals) -> Iterator[Braking]:
    """Every braking that stops the train, or takes a fifth of its speed, in the order of time."""
    speed = signals.speed
    t = np.arange(speed.t[0], speed.t[-1], STEP)
    if len(t) < 3:
        return
    v, has_speed = speed.interpolated(t), _has_speed(speed, t)
    applied = _applied(signals, t) if signals.brakes else _slows(v)
    first_brake_sample = min(
        (_first_sample_time(x) for x in signals.brakes.values()), default=-math.inf
    )
    is_standing = _standing(v, _LOCKED if signals.speed_from == "axles" else 0.0)
    for first_index, release_index in true_runs(applied):
        start_speed = v[first_index]
        if not start_speed > SLOW:
            continue
        standing = [k for k, _ in true_runs(is_standing[first_index:])]
        stop_index = first_index + standing[0] if standing else len(t) - 1
        braked_until = min(release_index - 1, stop_index)
        known_speeds = v[first_index : braked_until + 1]
        last_speed = float(known_speeds[np.isfinite(known_speeds)][-1])
        gaps = true_runs(~has_speed[first_index : braked_until + 1])
        gap = STEP * max((gap_end - gap_begin for gap_begin, gap_end in gaps), default=0)
        is_begun = not signals.commands and t[first_index] <= first_brake_sample + STEP
        if first_index == 0 or is_begun:
            reason = BEGUN
        elif any(a < t[braked_until] and b > t[first_index] for a, b in signals.overlaps):
            reason = "the clock was set back"
        elif gap:
            reason = f"no speed for {gap:.1f} s"
        elif not standing and release_index == len(t):
            reason = f"the log ends at {3.6 * last_speed:.0f} km/h"
        elif release_index - 1 < stop_index and last_speed > _ROLLED_OUT:
            reason = f"the brake was released at {3.6 * last_speed:.0f} km/h"
        elif stop_index - release_index > _LONGEST_ROLL / STEP:
            reason = "the train rolled on after the release of the brake"
        elif signals.speed_from == "axles" and (v_locked := _locking_speed(v[: stop_index + 1])):
            reason = f"{ALL_LOCK} {3.6 * v_locked:.0f} km/h, and no train speed is logged"
        else:
            reading = signals.interval if signals.is_coarse is None else 0.0
            slow = float(t[stop_index])
            standstill = _standstill(speed, slow, reading, _wheel_step(signals, slow))
            # between two readings of a slow speed the train stops anywhere
            sigma = math.hypot(
                standstill.tolerance, signals.coarse_interval(standstill.value) / math.sqrt(12.0)
            )
            yield Braking(float(t[first_index]), standstill.value, "", sigma)
            continue
        if not start_speed - last_speed < _LEAST_LOSS * start_speed:
            yield Braking(float(t[first_index]), float(t[braked_until]), reason)


def _first_sample_time(brake: TimeSeries) -> float:
    """The time of the first sample of a brake [s]; infinite for none."""
    is_finite = np.isfinite(brake.value)
    return float(brake.t[np.argmax(is_finite)]) if is_finite.any() else math.inf


def _has_speed(speed: TimeSeries, t: Floats) -> Bools:
    finite = speed.t[np.isfinite(speed.value)]
    place = np.clip(np.searchsorted(finite, t), 1, len(finite) - 1)
    usual = float(np.median(np.diff(finite)))
    return (finite[place] - finite[place - 1]) < max(_LONGEST_GAP, 3.0 * usual)


def _applied(signals: StopSignals, t: Floats) -> Bools:
    """Where any brake is applied; it stays applied in short releases, and in gaps of the log."""
    columns = [_above_zero(signals, brake.interpolated(t)) for brake in signals.brakes.values()]
    brake = np.fmax.reduce(columns)
    is_unknown, brake = np.isnan(brake), np.nan_to_num(brake, nan=0.0)
    highest = float(np.quantile(brake, _HIGHEST_SHARE))
    is_applied = brake > max(_ON_SHARE * highest, _LEAST_BRAKE)
    is_released = brake < max(_OFF_SHARE * highest, _LEAST_BRAKE / 2.0)
    applied = np.zeros(len(t), dtype=np.bool_)
    for first_index, stop in true_runs(~is_released):
        applied[first_index:stop] = is_applied[first_index:stop].any()
        applied[first_index : first_index + int(np.argmax(is_applied[first_index:stop]))] = False
    last_applied = len(applied) - int(np.argmax(applied[::-1])) if applied.any() else 0
    if last_applied and is_unknown[last_applied:].all():  # whether it is released, the speed says
        applied[last_applied:] = True
    return _closed(applied, is_unknown)


def _above_zero(signals: StopSignals, brake: Floats) -> Floats:
    """A brake without the level to which it is released, (n,): its sensor may be off by that."""
    known = brake[np.isfinite(brake)]
    if not len(known):
        return brake
    lowest, highest = (float(x) for x in np.quantile(known, [0.02, _HIGHEST_SHARE]))
    largest_zero = max(0.1 * highest, _LARGEST_ZERO if signals.by_pressure else 0.0)
    return brake - lowest if lowest < largest_zero else brake


def _slows(v: Floats) -> Bools:
    half_width = max(1, round(_AVERAGED / STEP / 2.0))
    slope = np.zeros(len(v))
    slope[half_width:-half_width] = (v[2 * half_width :] - v[: -2 * half_width]) / (
        2.0 * half_width * STEP
    )
    return _closed(slope < -_SLOWING, np.isnan(slope))


def _closed(mask: Bools, is_unknown: Bools) -> Bools:
    """A mask without short holes, as of wheel slide protection, and without those of a gap."""
    closed = mask.copy()
    runs = list(true_runs(mask))
    for (_, stop), (start, _) in itertools.pairwise(runs):
        if start - stop <= LONGEST_DUMP / STEP or is_unknown[stop:start].all():
            closed[stop:start] = True
    return closed


def _standing(v: Floats, locked: float) -> Bools:
    """Standstill without the times, up to `locked` [s], in which all wheels are locked.

    Wheels that were locked come back to a train that moves; a train starts slowly.
    """
    standing = np.zeros(len(v), dtype=np.bool_)
    for start, stop in true_runs(v < STANDING):
        later = v[min(stop + round(1.0 / STEP), len(v) - 1)]  # in a second
        is_over = stop == len(v) or stop - start > locked / STEP
        standing[start:stop] = is_over or later < _FASTEST_START
    return standing


def _locking_speed(v: Floats) -> float:
    """The speed from which all wheels fall to standstill, harder than a train [m/s]; else 0.

    `v` is the speed of the fastest of them, every `STEP`.
    """
    width = round(_LOCKING_TIME / STEP)
    if len(v) <= width:
        return 0.0
    is_hard = v[:-width] - v[width:] > _HARDEST * _LOCKING_TIME
    begin, end = (true_runs(is_hard) or [(0, 0)])[-1]
    falls = end and len(v) - end - width < width  # down to standstill
    return float(v[begin]) if falls and v[begin] > _ROLLED_OUT else 0.0


def _bend(t: Floats, v: Floats, later: Bools) -> tuple[float, float] | None:
    """Slope and level of the line through the later speeds; None unless they surely slow less."""
    lines, variances = [], []
    for half in (~later, later):
        line = np.polyfit(t[half], v[half], 1)
        noise = float(np.mean((v[half] - np.polyval(line, t[half])) ** 2))
        lines.append(line)
        variances.append(noise / max(float(np.sum((t[half] - t[half].mean()) ** 2)), 1e-9))
    softer = float(lines[1][0] - lines[0][0])
    is_sure = softer > _BEND_SIGMAS * math.sqrt(sum(variances)) and lines[1][0] < -_SLOWING / 2.0
    return (float(lines[1][0]), float(lines[1][1])) if is_sure else None


def _wheel_step(signals: StopSignals, slow: float) -> float:
    """Quantisation step of the wheels before standstill, where they show the speed [m/s]."""
    if signals.speed_from == "train" and signals.is_coarse is None:
        return 0.0
    endings = (rim.cut(slow - _STOPPING_TIME, slow + 1.0) for rim in signals.rims.values())
    return max((quantisation_step(x.value) for x in endings), default=0.0)


def _standstill(speed: TimeSeries, slow: float, reading: float, wheel_step: float) -> Parameter:
    """When the train stands, and 1 sigma [s].

    The line through the last speeds crosses zero there: sensors read zero too early, and noise
    crosses any threshold too early. It is `slow` when slower than `STANDING`. From the last reading
    to zero, `reading` seconds, a line is no speed. `wheel_step` is a step of the wheels [m/s].
    """
    ending = speed.cut(slow - _STOPPING_TIME, slow + 1.0)
    zero = ending.t[ending.value <= 0.0]
    last_t = min(slow, float(zero[0]) - reading + 1e-6) if len(zero) and reading else slow
    run = speed.cut(slow - _STOPPING_TIME, last_t)
    is_used = np.isfinite(run.value) & (run.value > 2.0 * STANDING) & (run.value < SLOW)
    t, v = run.t[is_used], run.value[is_used]
    interval = float(np.median(np.diff(speed.t)))
    usual = Parameter(slow, math.hypot(interval, STEP) / math.sqrt(3.0))
    if len(t) < _FEWEST:
        return usual
    slope, level = np.polyfit(t - slow, v, 1)
    if slope > -_SLOWING / 2.0:
        return usual
    later = t >= np.median(t)
    if later.sum() >= _FEWEST and (bend := _bend(t - slow, v, later)):  # a brake that is released
        t, v, slope, level = t[later], v[later], *bend
    residual = v - slope * (t - slow) - level
    sigma = math.sqrt(float(np.sum(residual**2)) / max(len(t) - 2, 1)) / -slope
    moving = np.flatnonzero((ending.value > 0.0) & ((ending.t <= last_t) | (reading == 0.0)))
    # A train that slows harder in the last metre reads zero before the line does.
    latest = float(ending.t[moving[-1]] - ending.value[moving[-1]] / slope) + 2.0 * sigma
    by_line = min(float(slow - level / slope), latest)
    stop = min(max(by_line, slow - STEP), slow + 1.0)
    excess = max(by_line - stop, 0.0)  # the wheels read zero long before
    # the last reading is within one step, and the fastest of several wheels is rounded up
    step = max(quantisation_step(v), wheel_step) / -slope / math.sqrt(3.0)
    noise = 2.0 * sigma / math.sqrt(len(t))
    return Parameter(stop, math.hypot(noise, interval / math.sqrt(12.0), excess, _BENT, step))
