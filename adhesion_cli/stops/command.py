"""When a braking is commanded: by a channel, the brake pipe, the cylinders or the deceleration."""

import math

import numpy as np

from ..core.signals import robust_sigma
from ..core.summary import CommandSource
from .brake_levels import brake_levels, quantisation_step
from .find import Braking
from .signals import Series, StopSignals

_BEFORE = 8.0  # time before a braking in which its command is looked for [s]


def find_command(signals: StopSignals, braking: Braking) -> tuple[float, float, CommandSource]:
    """Command time, its standard uncertainty [s], and what shows it."""
    sources: tuple[tuple[str, CommandSource], ...] = (
        ("emergency", "channel"),
        ("brake_command", "channel"),
        ("brake_pipe", "brake_pipe"),
    )
    for name, source in sources:
        if series := signals.commands.get(name):
            changed = _first_change(series, braking.on, source == "brake_pipe")
            if changed is not None:
                return (*changed, source)
    rises = [rise for brake in signals.brakes.values() if (rise := _first_rise(brake, braking.on))]
    if rises:
        return (*min(rises), "pressure")
    interval = float(np.median(np.diff(signals.speed.t)))
    begin = _deceleration_begin(signals.speed, braking.on)
    return begin, max(interval, 0.25), "deceleration"


def _first_change(series: Series, on: float, falls: bool) -> tuple[float, float] | None:
    """When a command or a brake pipe leaves the value that it had, and its uncertainty [s]."""
    part = series.between(on - _BEFORE, on + 1.0)
    finite = np.isfinite(part.value)
    t, x = part.t[finite], part.value[finite]
    if len(t) < 3:
        return None
    before = float(np.median(x[: max(1, len(x) // 4)]))
    span = float(np.max(np.abs(x - before)))
    noise = robust_sigma(x[: max(1, len(x) // 4)] - before)
    threshold = max(0.1 * span, 5.0 * noise) if falls else 0.5 * span
    moved = (before - x if falls else np.abs(x - before)) > threshold
    if not span or not moved.any() or moved[0]:
        return None
    k = int(np.argmax(moved))
    interval = float(t[k] - t[k - 1])
    return float(t[k] - interval / 2.0), interval / math.sqrt(12.0)


def _first_rise(brake: Series, on: float) -> tuple[float, float] | None:
    """When a brake leaves its released value, and the uncertainty of that [s]."""
    released, full, noise = brake_levels(brake, on, on + 10.0)
    part = brake.between(on - _BEFORE, on + 1.0)
    if not len(part.t) or full <= released:
        return None
    step = quantisation_step(part.value)
    risen = part.value > released + max(0.01 * (full - released), 5.0 * noise, 1.5 * step)
    low = np.flatnonzero(~risen & (part.t < on + 1.0))
    if not len(low) or low[-1] + 1 >= len(part.t):
        return None
    k = int(low[-1])
    interval = float(part.t[k + 1] - part.t[k])
    return float(part.t[k]), interval / math.sqrt(3.0)


def _deceleration_begin(speed: Series, on: float) -> float:
    """Where the deceleration begins that is clear at `on` [s]: lines before and after meet."""
    before, after = speed.between(on - 4.0, on - 1.0), speed.between(on + 0.5, on + 3.0)
    lines = []
    for part in (before, after):
        finite = np.isfinite(part.value)
        if finite.sum() < 3:
            return on
        lines.append(np.polyfit(part.t[finite], part.value[finite], 1))
    slope = lines[0][0] - lines[1][0]
    begin = (lines[1][1] - lines[0][1]) / slope if abs(slope) > 1e-6 else on
    return float(np.clip(begin, on - 3.0, on + 1.0))
