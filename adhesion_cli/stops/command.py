"""When a braking is commanded: by a channel, the brake pipe, the cylinders or the deceleration."""

import math
from collections.abc import Callable, Iterable

import numpy as np

from ..core.model import Floats, Parameter
from ..core.signals import median_of_five, robust_sigma
from ..core.summary import CommandSource
from .find import Braking
from .signals import StopSignals, TimeSeries, brake_levels, quantisation_step

_RISE, _SLOW_RISE = 0.01, 0.05  # of the full pressure: it rises; the same of a slow channel
_FALLEN = 1.7, 0.6  # from the begin of a rise to a clear one, over its doubling, and 1 sigma
_SLOW = 0.4  # from this interval on, a channel is slow [s]
_SLOWER = 4.0  # a rise that doubles more slowly, by this factor, than it began is a step first
_LEAD_TIME = 8.0  # time before a braking in which its command is looked for [s]
_Finder = Callable[[TimeSeries, float], tuple[float, float] | None]  # time, its uncertainty [s]


def find_command(signals: StopSignals, braking: Braking) -> tuple[float, float, CommandSource]:
    """Command time, its standard uncertainty [s], and what shows it."""
    commands = signals.commands
    sources: list[tuple[Iterable[TimeSeries], _Finder, CommandSource]] = [
        (commands.get("emergency", ()), _first_change, "channel"),
        (commands.get("brake_command", ()), _first_change, "channel"),
        (commands.get("brake_pipe", ()), _first_fall, "brake_pipe"),
        (signals.brakes.values(), _first_rise, "pressure"),
    ]
    for all_series, find_first, source in sources:
        if times := [x for series in all_series if (x := find_first(series, braking.start))]:
            return (*min(times), source)
    interval = float(np.median(np.diff(signals.speed.t)))
    begin = _deceleration_begin(signals.speed, braking.start)
    return begin, max(interval, 0.25), "deceleration"


def find_dead_time(signals: StopSignals, braking: Braking) -> Parameter | None:
    """From a command that is logged to the first rise of a cylinder; None without either [s]."""
    command, command_sigma, source = find_command(signals, braking)
    rise, rise_sigma, cause = find_command(signals._replace(commands={}), braking)
    if source == cause or cause != "pressure":
        return None
    return Parameter(rise - command, math.hypot(command_sigma, rise_sigma))


def _first_change(series: TimeSeries, start: float) -> tuple[float, float] | None:
    """When a command leaves the value that it had, and its uncertainty [s]."""
    t, x, _ = _change(series, start)
    span = float(np.max(np.abs(x), initial=0.0))
    has_changed = np.abs(x) > 0.5 * span
    if not span or has_changed[0]:
        return None
    k = int(np.argmax(has_changed))
    interval = float(t[k] - t[k - 1])
    return float(t[k] - interval / 2.0), interval / math.sqrt(12.0)


def _first_fall(pipe: TimeSeries, start: float) -> tuple[float, float] | None:
    """When a brake pipe begins to fall, and its uncertainty [s].

    Its noise hides the begin. The line through a small and twice as large a fall shows it.
    """
    t, x, noise = _change(pipe, start)
    threshold = max(-0.1 * float(np.min(x, initial=0.0)), 5.0 * noise)
    small, large = -x > threshold, -x > 2.0 * threshold
    if not threshold or not large.any() or small[0]:
        return None
    k, large_index = int(np.argmax(small)), int(np.argmax(large))
    interval = float(t[k] - t[k - 1])
    slope = float(x[k - 1] - x[large_index]) / float(t[large_index] - t[k - 1])
    fallen = max(float(-x[k]) / slope, 0.5 * interval)  # time of the fall so far
    return float(t[k]) - fallen, math.hypot(interval, fallen, noise / slope) / math.sqrt(12.0)


def _change(series: TimeSeries, start: float) -> tuple[Floats, Floats, float]:
    """Times around a braking, shape (n,), the change since before it, (n,), and its noise."""
    window = series.cut(start - _LEAD_TIME, start + 1.0)
    finite = np.isfinite(window.value)
    t, x = window.t[finite], window.value[finite]
    if len(t) < 3:
        return t[:0], x[:0], 0.0
    earlier = x[: max(1, len(x) // 4)]
    usual_value = float(np.median(earlier))
    return t, x - usual_value, robust_sigma(earlier - usual_value)


def _first_rise(brake: TimeSeries, start: float) -> tuple[float, float] | None:
    """When a brake leaves its released value, and the uncertainty of that [s].

    Its noise hides the begin, which is earlier than a clear rise by as long as that takes to double
    if the brake rises in a line, and by 2.4 times that if it begins slowly, as a parabola.
    """
    released, full_value, noise = brake_levels(brake, start, start + 10.0)
    window = brake.cut(start - _LEAD_TIME, start + 1.0)
    if not len(window.t) or full_value <= released:
        return None
    step = quantisation_step(window.value)
    # few slow samples show no noise, and in one interval a brake rises by much
    is_slow = len(window.t) > 1 and float(np.median(np.diff(window.t))) > _SLOW
    share = _SLOW_RISE if is_slow else _RISE
    threshold = max(share * (full_value - released), 5.0 * noise, 1.5 * step)
    risen = window.value > released + threshold
    unbraked_samples = np.flatnonzero(~risen & (window.t < start + 1.0))
    if not len(unbraked_samples) or unbraked_samples[-1] + 1 >= len(window.t):
        return None
    k = int(unbraked_samples[-1]) + 1
    interval = float(window.t[k] - window.t[k - 1])
    rise = median_of_five(window.value - released)
    low = np.flatnonzero(rise[:k] < 0.5 * threshold)
    if is_slow or not len(low) or not (rise[k:] >= 2.0 * threshold).any():
        return float(window.t[k - 1]), interval / math.sqrt(3.0)
    t, rise = window.t[low[-1] :], np.fmax.accumulate(rise[low[-1] :])
    first, double = (float(np.interp(level, rise, t)) for level in (threshold, 2.0 * threshold))
    if double - first > _SLOWER * (first - t[0] + interval):  # pads are laid on, then it rises
        return float(window.t[k - 1]), interval / math.sqrt(3.0)
    fallen, sigma = (x * (double - first) for x in _FALLEN)
    return first - fallen, math.hypot(sigma, interval / math.sqrt(3.0))


def _deceleration_begin(speed: TimeSeries, start: float) -> float:
    """Where the deceleration begins that is clear at `start` [s]: lines before and after meet."""
    lines = []
    for window in (speed.cut(start - 4.0, start - 1.0), speed.cut(start + 0.5, start + 3.0)):
        finite = np.isfinite(window.value)
        if finite.sum() < 3:
            return start
        lines.append(np.polyfit(window.t[finite], window.value[finite], 1))
    slope = lines[0][0] - lines[1][0]
    begin = (lines[1][1] - lines[0][1]) / slope if abs(slope) > 1e-6 else start
    return float(np.clip(begin, start - 3.0, start + 1.0))
