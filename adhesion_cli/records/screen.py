"""Sensors that stand still: which samples a stuck or saturated sensor only repeats.

Every check answers with a mask over the channel's own samples. A sensor is accused only where
repeating the last value is impossible for one that works: on the noise it otherwise has, or on
what the rest of the train does meanwhile.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import time_axis
from ..core.model import Bools, Channel, Floats
from ..core.signals import true_runs, white_noise
from ..dynamics.train_grid import FREE
from . import outliers, sample_and_hold

_SLOW = 1.0  # a wheel slower than this is about to stand [rad/s]
_ZERO = 0.1  # and one below this stands, as far as any sensor tells [rad/s]
_PULSES = 2.0  # of a counter that do not come where a wheel stands
_BRIEF = 0.4  # a wheel may turn from sliding to recovering for this long [s]
_APPLIED = 0.2  # of the highest pressure: the brake is applied
_RARE, _LONGER = 4, 4.0  # runs of a stuck sensor are fewer, and so much longer than others
_NEVER = 1e-3  # runs this long that a log of its length would show by chance
_LOCKS = 100.0  # no wheel is slowed harder for one sample and driven as hard in the next [rad/s²]
_QUICKEST = 4.0  # faster than any valve fills or vents a cylinder, of its highest value [1/s]
_AROUND = 10  # samples before and after
_LEVEL = 4.0  # small changes: noise about a level keeps within so much
_EARLY = 5.0  # so much may the clock of a train speed be ahead [s]
_MOVES = 0.02  # of itself: a speed that changes by less stands still
_SLIDES = 0.35  # of the speed by which a wheel on a roller rig may be slowed
_VACUUM = -3e4  # far below atmosphere [Pa]; K below zero does not exist either
_LASTS = 2.0  # seconds of one pressure that no valve of a wheel slide protection holds
_SLOWER = 0.95  # of the wheel beside it: one that turns by less slides
_JUMPS = (
    "jumps as no {} can, and comes back or never changes again: a spike, a drop-out or a dead "
    "sensor; left out; check the sensor and its wire"
)
_TURNS = (
    "alternates from sample to sample between two: rows of two devices by turns, or a broken "
    "sensor; all left out; state [channels] group, or another channel"
)
_TORN = (
    "jumps to and fro as no {} can, and which of it is true is not known: a broken sensor, or rows "
    "of two devices by turns; all left out; check the sensor, or state [channels] group"
)


class Fault(NamedTuple):
    """What one channel's samples show of its sensor."""

    code: str
    text: str  # behind "the pressure", "the wheel speed"
    where: Bools  # shape (n,)
    left_out: bool


def of_speed(speed: Channel) -> list[Fault]:
    """What a wheel speed [rad/s] shows by itself."""
    if outliers.by_turns(speed):
        every = np.ones(len(speed.data.t), dtype=np.bool_)
        return [Fault("interleaved", _TURNS, every, True)]
    spikes = speed_spikes(speed)
    return [Fault("speed-spike", _jumps("wheel", spikes), spikes, True)]


def _jumps(body: str, spikes: Bools) -> str:
    return (_TORN if spikes.all() else _JUMPS).format(body)


def of_train(train: Channel, wheels: Sequence[Channel]) -> list[Fault]:
    """What a train speed [m/s] shows by itself and beside the wheel speeds [rad/s]."""
    spikes = outliers.of_train(train)
    frozen = stuck_speed(train, np.zeros(len(spikes)), wheels, np.nanmin)
    last = int(_runs(train).first[-1])
    if frozen[-1] and train.data.value[last] > _SLOW:
        t = train.data.t
        later = int(np.searchsorted(t, t[last] + round(_EARLY * 1e9)))  # the clock may be early
        goes_on = not np.ptp(train.data.value) or (
            later < len(t) - 1 and _all_move(train, wheels, later, _MOVES)
        )
        if not (goes_on and _all_move(train, wheels, last, _SLIDES)):  # on a roller rig, too
            frozen[last:] = False
    return [
        Fault("train-spike", _jumps("train", spikes), spikes, True),
        Fault(
            "train-frozen",
            "repeats one value, or zero, while every wheel says it must change: left out; check "
            "the receiver, or name another channel in [channels] train_speed",
            frozen & ~spikes, True,
        ),
    ]  # fmt: skip


def _all_move(train: Channel, wheels: Sequence[Channel], first: int, share: float) -> bool:
    """Whether every wheel changes by more than a share of itself from a train's sample on."""
    rest = _Runs(np.array([first, len(train.data.t)]))
    return all(_moved(train, rest, w)[0] > share for w in wheels)


def of_pressure(
    pressure: Channel, others: Sequence[Channel] = (), wheels: Sequence[Channel] = ()
) -> list[Fault]:
    """What a pressure [Pa] or K [N] shows by itself and beside the other axles'.

    Args:
        pressure: of one axle.
        others: the other axles'.
        wheels: the axle's wheel speed [rad/s], then the others'.
    """
    below = pressure.data.value < _VACUUM * max(outliers.scale(pressure), 1.0)
    spikes = pressure_spikes(pressure) & ~below
    stuck, saturated = standing_pressure(pressure, others, wheels)
    return [
        Fault(
            "pressure-frozen",
            "repeats one value while its noise or the other axles say it must change: left out; "
            "check the sensor, or name another channel in [channels]",
            stuck & ~spikes, True,
        ),
        Fault(
            "pressure-impossible", "is far below zero: a broken sensor or wire; left out",
            below, True,
        ),
        Fault("pressure-spike", _jumps("cylinder", spikes), spikes, True),
        Fault(
            "pressure-saturated",
            "stands at its highest value without its noise: the sensor's range ends there, the "
            "true one is higher and so is the force; leave it out with --from and --to",
            saturated, False,
        ),
    ]  # fmt: skip


def limit(pressure: Channel, faults: Sequence[Fault]) -> float:
    """Where the sensor's range ends, as its faults show; inf where they do not show it."""
    ends = any(f.code == "pressure-saturated" and f.where.any() for f in faults)
    return float(pressure.data.value.max()) if ends else math.inf


class _Runs(NamedTuple):
    """Stretches of equal values without a gap: where they begin, and the end; shape (k + 1,)."""

    edges: NDArray[np.int64]

    @property
    def first(self) -> NDArray[np.int64]:
        return self.edges[:-1]

    @property
    def last(self) -> NDArray[np.int64]:
        return self.edges[1:] - 1

    @property
    def length(self) -> NDArray[np.int64]:
        return np.diff(self.edges)


def _runs(c: Channel) -> _Runs:
    t, x = c.data.t, c.data.value
    new = np.ones(len(t) + 1, dtype=np.bool_)
    dt = np.diff(t)
    new[1:-1] = (x[1:] != x[:-1]) | (dt <= 0) | (dt > c.gap_ns)
    return _Runs(np.flatnonzero(new))


def _leap(x: Floats, runs: _Runs) -> Floats:
    """By how much each run is left, infinite for the last one: it is never left; shape (k,)."""
    after = np.append(x[runs.first[1:]], np.inf)
    return np.abs(after - x[runs.last])


def _repeats(n: int, runs: _Runs, stuck: Bools) -> Bools:
    """Mask of all but the first sample of the stuck runs: that one is a measurement."""
    edges = np.zeros(n + 1, dtype=np.int64)
    edges[runs.first[stuck] + 1] += 1
    edges[runs.last[stuck] + 1] -= 1
    inside: Bools = np.cumsum(edges[:-1]) > 0
    return inside


def stuck_speed(
    speed: Channel, clamping: Floats, others: Sequence[Channel] = (),
    among: Callable[..., Floats] = np.nanmedian,
) -> Bools:  # fmt: skip
    """Samples at which a stuck speed sensor repeats its last value, shape (n,).

    It would have moved meanwhile: by as much as the other axles and the train do, or, where the
    log has none, as this speed usually does with the brake applied. More than six quantisation
    steps (four where there are others) and 2 % of it, that is; for much longer than the speed's
    usual steps last; and then the speed leaps by a good part of it, or never changes again, or it
    is the highest of all while the train's changes by 10 %: there the sensor's range ends. A wheel
    that turns from sliding to recovering stands at one value too, but leaves it gently. One that
    stands without brake while the others turn is no wheel either.

    Args:
        speed: wheel speed [rad/s].
        clamping: K at the speed's times, shape (n,).
        others: speeds of other axles and the train, in any unit.
        among: of what the others moved by, what counts.
    """
    t, y = speed.data.t, speed.data.value
    runs, dead = _runs(speed), _dead(speed, clamping, others)
    value = y[runs.first]
    long = (
        (runs.length >= np.maximum(3.0, 2.5 * _usual(y)))
        & ((t[runs.last] - t[runs.first]) / 1e9 > _BRIEF)
        & (value > _SLOW)
    )
    if not long.any():
        return dead
    expected = _expected(speed, clamping, runs)
    steps = np.full(len(value), 6.0)
    ends = np.zeros(len(value), dtype=np.bool_)  # of the sensor's range
    if others:
        moved = np.array([_moved(speed, runs, other) for other in others]) * value
        # Where all of them stand still to the last digit, it is the logger that does.
        known = np.isfinite(moved).any(axis=0) & (np.nan_to_num(moved).max(axis=0) > 0.0)
        expected[known] = among(moved[:, known], axis=0)
        steps[known] = 4.0
        for of_train in moved[[c.meaning == "train_speed" for c in others]]:
            ends = known & np.isfinite(of_train) & (value >= y.max())
            expected[ends] = of_train[ends]  # all wheels may stand there
    constant = not np.ptp(y)
    least = np.where(ends | constant, 0.1, _MOVES)  # one value alone does not show its step
    stuck = (
        long
        & (expected > np.maximum(steps * speed.coarsest, least * value))
        & (ends | (_leap(y, runs) > 0.3 * expected))
    )
    if constant and stuck.any():
        return np.ones(len(y), dtype=np.bool_)
    return _repeats(len(y), runs, stuck) | dead


def _usual(x: Floats) -> float:
    """Usual number of samples with one value; of the longest, on trial, only if it is not alone."""
    stands = np.diff(np.flatnonzero(np.diff(x, prepend=np.nan)), append=len(x))
    return float(np.median(np.sort(stands)[:-1])) if len(stands) > 1 else 1.0


def _moved(speed: Channel, runs: _Runs, other: Channel) -> Floats:
    """By which share of itself another speed changed within each run; shape (k,).

    From end to end, or in between by more than its noise; NaN where it hardly moves at all.
    """
    x = time_axis.interpolated(time_axis.Over(speed.data.t, 0, 1), other)
    low, high = (of.reduceat(x, runs.first) for of in (np.fmin, np.fmax))
    ends = np.abs(x[runs.last] - x[runs.first])
    fast = 0.1 * np.max(other.data.value)
    share = np.full(len(ends), np.nan)
    np.divide(ends, x[runs.first], out=share, where=x[runs.first] > fast)
    between = np.full(len(ends), np.nan)
    np.divide(high - low - _noise(other), high, out=between, where=high > fast)
    moved: Floats = np.fmax(share, np.fmax(between, 0.0))
    return moved


def _dead(speed: Channel, clamping: Floats, others: Sequence[Channel]) -> Bools:
    """Stretches in which the wheel stands and for a while only a dead sensor explains it; (n,).

    A wheel that no brake holds turns with the train, and at once when a brake lets it go. One that
    does not turn in the whole log while the others do shows nothing of a wheel.
    """
    stands = locked(speed, others, outliers.WHEEL.start)
    still = _still(speed)
    if still.all() and stands.any():
        return still
    free = stands & (clamping <= FREE * np.nanmax(clamping, initial=0.0))
    found = np.zeros(len(stands), dtype=np.bool_)
    for a, b in true_runs(still):
        t = speed.data.t[a:b] / 1e9
        found[a:b] = any(t[j - 1] - t[i] >= _LASTS for i, j in true_runs(free[a:b]))
    return found


def speed_spikes(speed: Channel) -> Bools:
    """Samples of a wheel speed that no wheel can reach and leave again, shape (n,).

    Where slides take few samples, single ones too: zeros from more than sensors read zero at, and
    those far above all within ten samples; a slide only goes down.
    """
    y, n = speed.data.value, len(speed.data.t)
    alone, steep = _alone(speed)
    wide = np.pad(y, _AROUND, constant_values=-np.inf)
    before = np.lib.stride_tricks.sliding_window_view(wide, _AROUND).max(axis=1)
    highest = np.maximum(before[:n], before[_AROUND + 1 :])
    above = y > np.maximum(1.1 * highest, highest + _noise(speed) + outliers.WHEEL.start)
    dropped = (y == 0.0) & (highest > outliers.WHEEL.start) & (steep > _LOCKS)
    found: Bools = outliers.of_wheel(speed) | alone & (above | dropped) | _flickers(speed)
    return found


def _flickers(speed: Channel) -> Bools:
    """Zeros for a moment that no wheel can reach and leave again, however slow it is; shape (n,).

    About the least speed that it can tell, a sensor may give the speed and zero by turns.
    """
    t, y, noise = speed.data.t / 1e9, speed.data.value, _noise(speed)
    found = np.zeros(len(y), dtype=np.bool_)
    for a, b in true_runs(y == 0.0):
        if a > 0 and b < len(y) and t[b - 1] - t[a] < outliers.STANDS:
            fell, rose = y[a - 1] - noise, y[b] - noise
            found[a:b] = (
                fell > outliers.WHEEL.fall * (t[a] - t[a - 1])
                and rose > outliers.WHEEL.rise * (t[b] - t[b - 1])
            )  # fmt: skip
    return found


def pressure_spikes(pressure: Channel) -> Bools:
    """Samples of a pressure that no valve can reach and leave again, shape (n,)."""
    alone, steep = _alone(pressure)
    single = alone & (steep > _QUICKEST * np.max(pressure.data.value, initial=0.0))
    return outliers.of_cylinder(pressure) | single


def _alone(c: Channel) -> tuple[Bools, Floats]:
    """Where one sample departs from neighbours that agree, and how steeply [SI/s]; shape (n,)."""
    t, y = c.data.t, c.data.value
    alone, steep = np.zeros(len(t), dtype=np.bool_), np.zeros(len(t))
    if len(t) < 5:
        return alone, steep
    noise, away = _noise(c), np.diff(y)
    leaps = np.abs(away) > noise
    at = np.flatnonzero(leaps[1:] & leaps[:-1]) + 1  # few, and only these are looked at
    there, back = away[at - 1], -away[at]
    before, after = (t[at] - t[at - 1]) / 1e9, (t[at + 1] - t[at]) / 1e9
    least = np.minimum(np.abs(there), np.abs(back))
    found = (
        (np.sign(there) == np.sign(back))
        & (np.abs(there - back) < least / 2.0)
        & (before > 0.0)
        & (after > 0.0)
    )
    at = at[found]
    alone[at] = True
    steep[at] = ((least - noise)[found]) / np.maximum(before, after)[found]
    return alone, steep


def _noise(c: Channel) -> float:
    """More than two samples differ by from noise alone."""
    runs = ((c.data.t[s], c.data.value[s]) for s in time_axis.pieces(c.starts, len(c.data.t)))
    return 8.0 * math.sqrt(white_noise(runs)) + 6.0 * c.coarsest


def locked(speed: Channel, others: Sequence[Channel], faster: float = 2.0 * _SLOW) -> Bools:
    """Samples at which the wheel stands while half of the rest of the train moves, shape (n,).

    Args:
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
    stands: Bools = (moving > 0) & (2 * moving >= known) & _still(speed)
    for a, b in true_runs(stands):
        # A zero of a counter is less than a pulse. Rad or m: a wheel turns more than it rolls.
        stands[a:b] = np.sum(slowest[a:b]) > _PULSES * speed.step
    return stands


def _still(speed: Channel) -> Bools:
    """Samples at which the wheel stands, as far as its sensor tells, shape (n,)."""
    still: Bools = np.abs(speed.data.value) <= max(_ZERO, speed.step / 2.0)
    return still


def _expected(speed: Channel, clamping: Floats, runs: _Runs) -> Floats:
    """By how much K would have slowed the wheel within each run, judged by itself; shape (k,)."""
    t, y = speed.data.t, speed.data.value
    applied = (clamping > _APPLIED * np.nanmax(clamping, initial=0.0)) & (y > 0.0)
    dt = np.diff(t) / 1e9
    both = applied[1:] & applied[:-1] & (dt > 0.0) & (np.diff(t) <= speed.gap_ns)
    usual = float(np.median(dt)) if len(dt) else 0.0
    m = max(1, min(len(dt), round(1.0 / max(usual, 1e-9))))  # over a second: above the noise
    far = (t[m:] - t[:-m]) / 1e9
    pair = applied[m:] & applied[:-m] & (far > 0.0) & (far < 2.0 * m * usual)
    if not pair.any():
        return np.zeros(len(runs.first))
    mean = (clamping[1:] + clamping[:-1]) / 2.0
    impulse = np.concatenate([[0.0], np.cumsum(np.where(both, mean * dt, 0.0))])
    over = (impulse[m:] - impulse[:-m])[pair].sum()
    by_impulse = float(np.abs(y[m:] - y[:-m])[pair].sum() / over) if over > 0.0 else 0.0
    expected: Floats = by_impulse * (impulse[runs.last] - impulse[runs.first])
    return expected


class Standing(NamedTuple):
    """Samples at which a pressure sensor repeats its last value; shape (n,)."""

    stuck: Bools
    saturated: Bools  # at its highest value, the end of its range


def standing_pressure(
    pressure: Channel, others: Sequence[Channel] = (), wheels: Sequence[Channel] = ()
) -> Standing:
    """Where a pressure sensor stands.

    Stuck is seen by its noise, which ends; or by the other axles' pressures, which go on, if it
    then leaps or never changes again. Where it reads its lowest value it may be cut off there.

    Args:
        pressure: of one axle [Pa], or its K [N].
        others: the other axles'.
        wheels: the axle's wheel speed [rad/s], then the others'.
    """
    x = pressure.data.value
    runs = _runs(pressure)
    silent = _silent(pressure, runs)
    below, above = _left_alone(pressure, runs, others, wheels)
    alone = below | above
    flat = _flat_top(pressure, runs, silent) & ~above
    saturated = _repeats(len(x), runs, flat)
    if alone.any() and not np.ptp(x):
        return Standing(np.ones(len(x), dtype=np.bool_), saturated)
    silent &= ~flat
    if silent.any() and _cut_off(pressure, runs):
        silent[silent] = x[runs.first[silent]] > x.min()
    return Standing(_repeats(len(x), runs, silent | alone & ~flat), saturated)


def _flat_top(pressure: Channel, runs: _Runs, silent: Bools) -> Bools:
    """Silent runs at the highest value, reached steeply or more than once; shape (k,)."""
    x = pressure.data.value
    top = float(x.max())
    found = silent.copy()
    found[silent] = x[runs.first[silent]] == top
    if found.sum() == 1:
        first = runs.first[found]
        before = np.maximum(first - max(2, round((pressure.rate_hz or 1.0) / 2.0)), 0)
        found[found] = top - x[before] > 0.05 * top
    return found


def _cut_off(pressure: Channel, runs: _Runs) -> bool:
    """Whether the sensor reads nothing below its lowest value: it is there often, not by chance."""
    x = pressure.data.value
    low = float(x.min())
    short = runs.length < 30
    near = x[runs.first[short]] <= low + max(0.02 * float(x.max()), 4.0 * pressure.step)
    there = x[runs.first[short]] == low
    return bool(near.sum() < 20 or there.sum() > 0.1 * near.sum())


def _silent(pressure: Channel, runs: _Runs) -> Bools:
    """Runs longer than the noise of the channel allows, none where it shows no noise; shape (k,).

    Noise is small changes back and forth; where there are steps, by two of them at least: less may
    come and go as a quiet signal crosses from one step to the next. Below the highest value it is
    about a level: valves that move the pressure make such changes, too.
    """
    x = pressure.data.value
    top, step = float(x.max()), pressure.step
    repeats = max(1, round(sample_and_hold.interval(pressure) * (pressure.rate_hz or 0.0)))
    value = x[runs.first]
    changes = np.diff(value)
    up, down, size = changes > 0.0, changes < 0.0, np.abs(changes)
    small, clear = size <= max(0.02 * top, 2.5 * step), size > 1.5 * step
    turns = (up[1:] & down[:-1] | down[1:] & up[:-1]) & small[1:] & small[:-1]
    turns &= clear[1:] | clear[:-1]
    length = np.maximum(runs.length // repeats, 1)
    j = min(max(2, round(_BRIEF * (pressure.rate_hz or 0.0))), 2 * _AROUND)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(value, j, "edge"), 2 * j + 1)
    level = np.ptp(near, axis=1) <= _LEVEL * max(0.02 * top, 2.5 * step)

    def longest(where: Bools) -> float:
        """What the noise there allows."""
        free = (length < 30) & (value > x.min()) & where
        samples = int(length[free].sum())
        if samples < 20 or (turns & where[1:-1]).sum() < max(6.0, 0.03 * samples):
            return np.inf
        # How often it repeats by chance; more often half way between two steps.
        chance = np.clip(1.0 - free.sum() / samples + 0.15, 0.45, 0.7)
        return float(np.log(_NEVER / len(x)) / np.log(chance))

    below = value < top
    # What is silent again and again for about as long has no noise there: valves made the changes.
    often = float(np.sort(length[below])[-_RARE:][0]) if below.any() else 0.0
    least = max(longest(level), _LONGER * often)
    return np.where(below, length >= least, length > longest(np.ones_like(level)))


def _left_alone(
    pressure: Channel, runs: _Runs, others: Sequence[Channel], wheels: Sequence[Channel]
) -> Bools:
    """Runs below every other axle's pressure, and above, for longer than by a valve; shape (2, k).

    All below it: the brake is released, unless slide protection vents every other axle: then their
    wheels slide beside this one again and again (a single other one may be vented for long). Or all
    above it, unless slide protection vents this one: its wheel slides beside another. One at full
    pressure while others are vented is no fault.
    """
    t, x = pressure.data.t, pressure.data.value
    found = np.zeros((2, len(runs.first)), dtype=np.bool_)
    if not others:
        return found
    top = max(float(c.data.value.max()) for c in others)
    whole = not np.ptp(x)  # all log long: no valve, if all others are applied or released
    lasts = _BRIEF if whole else _LASTS
    if whole and any(np.ptp(c.data.value) <= 0.3 * top for c in others):
        return found
    long = (runs.length >= 5) & ((t[runs.last] - t[runs.first]) / 1e9 >= lasts)
    long &= (x[runs.first] > 0.05 * top) | whole  # let go while others brake, or dead
    long &= _leap(x, runs) > 0.2 * top
    for i in np.flatnonzero(long):
        run = slice(runs.first[i], runs.last[i] + 1)
        at, seconds, value = (
            time_axis.Over(t[run], 0, 1),
            (t[run] - t[run.start]) / 1e9,
            x[run.start],
        )
        beside = np.array([time_axis.interpolated(at, c) for c in others])
        above, below = beside > value + 0.3 * top, beside < value - 0.3 * top
        if len(others) == 1 or whole:
            below = (beside < 0.05 * top) & (value > 0.1 * top)
        if not whole and len(wheels) > 1:
            own, *rest = (time_axis.interpolated(at, c) for c in wheels)
            least = 2.0 * wheels[0].step
            others_slide: Bools = np.any(np.array(rest) < _SLOWER * own - least, axis=0)
            slides: Bools = np.any(own < _SLOWER * np.array(rest) - least, axis=0)
            below &= ~_lately(at, others_slide)
            slid = _lately(at, slides)
            above &= ~np.logical_or.accumulate(slid)  # what was vented may be held for long
        for side, apart in enumerate((above.all(axis=0), below.all(axis=0))):
            found[side, i] = any(seconds[b - 1] - seconds[a] >= lasts for a, b in true_runs(apart))
    return found


def _lately(at: time_axis.Over, slides: Bools) -> Bools:
    """Where a wheel slides within `_LASTS`, before or after; shape (n,)."""
    seen = np.concatenate([[0], np.cumsum(slides)])
    before, after = (np.searchsorted(at.t, at.t + sign * round(_LASTS * 1e9)) for sign in (-1, 1))
    return np.asarray(seen[after] > seen[before])
