"""Faults of sensors as far as the past shows them, by the definitions of `records`.

`records` judges a whole log. Here the newest sample is judged by those before it, with the same
thresholds and functions: of an outlier by what a wheel or a cylinder can do, of a stuck sensor by
the window of the newest samples.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..channels.to_si import quantum
from ..core.model import Channel, Column, Floats, Meaning
from ..records import outliers, stuck_pressure, stuck_speed
from ..records.faults import runs
from ..records.outliers import Limits

_WINDOW_SAMPLES = 4000  # samples of a window
_NOISE = 200  # samples of one that shows the noise
_JUDGED = 20  # samples that show the noise
_REPEAT_TIME = 1.0  # a slow signal that is repeated in a fast table keeps a value as long [s]
_NEW_LEVEL_TIME = 3.0  # other values that last as long are the signal [s]
_REPEATED = 1e-3  # weight of a sample that repeats its predecessor: dead sensors do
_STUCK_SAMPLES = 30  # samples: so long a stretch of pressure may be stuck
_FEWEST = 3  # samples of the train speed that show how it changes
_LONGEST_STEP = 5.0  # and the longest interval between two of them [s]
_GROWTH = 1.25  # a stretch is judged again when it is longer by this factor


class Window:
    """The newest samples of a channel, so many at most."""

    def __init__(self, meaning: Meaning, size: int) -> None:
        self._meaning = meaning
        self._samples: deque[tuple[int, float, float]] = deque(maxlen=size)
        self.same = 0  # how many of the newest repeat one value
        self.since = 0  # time of the first one of these [ns]

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, t: int, x: float, force: float = math.nan) -> None:
        """The next sample, with the clamping force K at its time [N]."""
        if self._samples and t <= self._samples[-1][0]:  # the clock was set back
            self.clear()
        repeats = bool(self._samples) and x == self._samples[-1][1]
        self.same = self.same + 1 if repeats else 1
        self.since = self.since if repeats else t
        self._samples.append((t, x, force))

    def clear(self) -> None:
        """Forgets all samples: nothing crosses a gap."""
        self._samples.clear()
        self.same = 0

    def channel(self, gap: float) -> Channel:
        """The samples; longer intervals are gaps [s]."""
        t = np.array([s[0] for s in self._samples], np.int64)
        x = np.array([s[1] for s in self._samples])
        data = Column(t, x, np.ones(len(t), np.bool_))
        usual = float(np.median(np.diff(t))) * 1e-9 if len(t) > 1 else 0.0
        channel = Channel("", "", self._meaning, None, "", "", data, len(t), step=quantum(x))
        rate = 1.0 / usual if usual else None
        return replace(channel, gap_ns=round(gap * 1e9), rate_hz=rate)

    def force(self) -> Floats:
        """K at the times of the samples, shape (n,) [N]."""
        return np.array([s[2] for s in self._samples])


class _Track(NamedTuple):
    """Samples that one wheel, or one cylinder, can have passed through in their order."""

    begin: int  # [ns]
    since: int  # its value is the same since then [ns]
    t: int  # of its newest sample [ns]
    x: float
    weight: float  # how much it tells: changes of the value, as `records.outliers` weighs them

    def extended(self, t: int, x: float) -> "_Track":
        changes = x != self.x
        since, weight = (t, 1.0) if changes else (self.since, _REPEATED)
        return self._replace(since=since, t=t, x=x, weight=self.weight + weight)

    def can_reach(self, t: int, x: float, limits: Limits) -> bool:
        hold_time = min((t - self.since) * 1e-9, _REPEAT_TIME)
        seconds = max((t - self.t) * 1e-9, hold_time)
        change = x - self.x
        allowance = limits.free_from_zero if x == 0.0 or self.x == 0.0 else limits.free_change
        return abs(change) <= allowance + (limits.rise if change > 0.0 else limits.fall) * seconds


class Leaps:
    """Samples that the sensor's quantity cannot reach from the last one that counts.

    Where the others tell more than those that counted, or stay, they are the signal. `limits` says
    what the quantity can do, by its newest samples, without their noise.
    """

    def __init__(self, meaning: Meaning, limits: Callable[[Channel], Limits]) -> None:
        self._limits_of, self._window = limits, Window(meaning, _NOISE)
        self._limits, self._age = limits(self._window.channel(0.0)), _JUDGED
        self._level: _Track | None = None
        self._rival: _Track | None = None

    def restart(self) -> None:
        """After a gap anything may follow."""
        self._level = self._rival = None

    def leaps(self, t: int, x: float) -> bool:
        """Whether this sample must not be used."""
        self._window.add(t, x)
        self._age += 1
        if self._level is None or t <= self._level.t:
            self._level, self._rival = _Track(t, t, t, x, 1.0), None
            return False
        if not self._continues(x) and self._reaches(self._level, t, x):
            self._level, self._rival = self._level.extended(t, x), None
            return False
        rival = self._rival
        if rival is None or not self._reaches(rival, t, x):
            rival = _Track(t, t, t, x, 0.0)
        self._rival = rival.extended(t, x)
        is_new_level = (t - rival.begin) * 1e-9 > _NEW_LEVEL_TIME
        if not is_new_level and self._rival.weight <= self._level.weight:
            return True
        self._level, self._rival = self._rival, None
        return False

    def _continues(self, x: float) -> bool:
        """Whether it is one piece with others that leaped; by now the good ones might reach it."""
        return self._rival is not None and abs(x - self._rival.x) <= self._limits.free_change / 2.0

    def _reaches(self, track: _Track, t: int, x: float) -> bool:
        if track.can_reach(t, x, self._limits) or len(self._window) < _JUDGED:
            return True
        if self._age >= _JUDGED:  # the noise is looked at where it matters, and not always
            self._age, c = 0, self._window.channel(0.0)
            limits = self._limits_of(c)
            self._limits = limits.widened(outliers.noise_among_outliers(c, limits.free_change))
        return track.can_reach(t, x, self._limits)


def pressure_leaps(p: outliers.Params) -> Leaps:
    """Of a pressure [Pa]; one in a wrong unit has larger limits."""

    def limits(c: Channel) -> Limits:
        return outliers.brake_limits(p, outliers.scale_of(c) if len(c.data.t) else 1.0)

    return Leaps("pressure", limits)


class StuckSpeed:
    """A wheel speed that repeats one value where it must change."""

    def __init__(self, p: stuck_speed.Params) -> None:
        self._p, self._window = p, Window("wheel_speed", _WINDOW_SAMPLES // 2)
        self._train = Window("train_speed", _WINDOW_SAMPLES // 2)
        self._next_length, self._stuck = 0.0, False

    def restart(self) -> None:
        """After a gap."""
        self._window.clear()

    def train(self, t: int, v: float) -> None:
        """A speed of the train [m/s], which shows by how much the wheel's must have changed."""
        self._train.add(t, v)

    def stuck(self, t: int, y: float, force: float, gap: float) -> bool:
        """Whether the sensor is stuck at this sample.

        The time is in ns, the speed in rad/s, `force` is K [N], NaN where that is not known or its
        sensor is stuck. Intervals longer than `gap` [s] are gaps.
        """
        window = self._window
        window.add(t, y, force)
        if window.same < 3:
            self._next_length, self._stuck = self._p.lasts, False
        lasts = (t - window.since) * 1e-9
        if not self._stuck and lasts > self._next_length and y > self._p.slow:
            self._next_length = _GROWTH * lasts
            K = np.nan_to_num(window.force())
            companions = [self._train.channel(_LONGEST_STEP)] if len(self._train) > _FEWEST else []
            channel = window.channel(gap)
            stuck = stuck_speed.stuck(self._p, channel, runs(channel), K, companions)
            self._stuck = bool(stuck[-1])
        return self._stuck


class StuckPressure:
    """A pressure without its noise."""

    def __init__(self, p: stuck_pressure.Params) -> None:
        self._p, self._window = p, Window("pressure", _WINDOW_SAMPLES)
        self._next_length, self.stuck, self.saturated = float(_STUCK_SAMPLES), False, False

    def restart(self) -> None:
        """After a gap."""
        self._window.clear()

    def add(self, t: int, x: float, gap: float) -> None:
        """The next sample: time [ns], value, and the seconds of a gap."""
        window = self._window
        window.add(t, x)
        if window.same == 1:
            self._next_length, self.stuck, self.saturated = float(_STUCK_SAMPLES), False, False
        if window.same >= self._next_length:
            self._next_length = _GROWTH * window.same
            channel = window.channel(gap)
            stuck, saturated = stuck_pressure.standing(self._p, channel, runs(channel))
            self.stuck |= bool(stuck[-1])
            self.saturated = bool(saturated[-1]) and not self.stuck
