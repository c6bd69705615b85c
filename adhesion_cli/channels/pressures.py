"""What a pressure is by what it does while the train rolls: a brake pipe's, or one from vacuum.

The pressure of a released brake cylinder is zero. That of a brake pipe stands at about 5 bar while
the train rolls freely, and is lower while the train slows. One that counts from vacuum stands at
the pressure of the air. Standing trains show nothing: their brakes are held or parked.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core import units
from ..core.finding import Finding
from ..core.masks import true_runs
from ..core.model import Bools, Channel, Floats, Parameter, Vehicle
from ..core.sample_times import SampleTimes
from .meaning import Meant

_STEP_NS = 500_000_000  # between the times at which speed and pressure are compared
_MOST_TIMES = 1_000_000  # a longer log is compared at longer intervals
_SLOPE_STEPS = 2  # so many before and after give the slope of the speed
_MOVING = 2.0  # [m/s]
_LEAST_RANGE = 0.15  # from rolling freely to braking, else no brake shows [m/s²]
_FREE_ROLLING, _SLOWS = 0.1, 0.5  # shares of that range: rolls freely by less, slows by more
_SHORTEST_RUN = 8  # times: wheels that regain speed in a slide do so for less
_PIPE = 3e5, 7e5  # pressure of a brake pipe that is not reduced [Pa]
_HIGHEST_PIPE = 7.7e5  # pressure of a brake pipe, 110 psi in America, with its gauge's error [Pa]
_LEAST_REDUCTION = 0.25e5  # of a brake pipe [Pa]
_AIR = 0.85e5, 1.1e5  # pressure of the air, with the error of a sensor [Pa]
_SURELY_FREE = -0.2  # a train that slows by more may be braked by the lowest pressure [m/s²]
_AIR_SPREAD = 0.05e5  # that of a released cylinder is constant [Pa]
_LEVEL_SIGMA = 3.0**-0.5  # 1 sigma of a zero that is 0 or the air's level, as a share of that


class Motion(NamedTuple):
    """How the train moves, at some times of a log."""

    times: SampleTimes
    rolls: Bools  # freely
    slows: Bools  # by a brake, for some time
    free_slope: float  # how its speed changes where it rolls freely [m/s²]


def judge(
    channels: Sequence[Channel], meant: Sequence[Meant], vehicle: Vehicle
) -> tuple[list[Channel], list[Finding]]:
    """The channels, with brake pipes named and the pressure of the air taken off."""
    judged, findings = [_as_reservoir(c, m) for c, m in zip(channels, meant, strict=True)], []
    pressures = [i for i, c in enumerate(channels) if c.meaning == "pressure" and len(c.data.t)]
    motion = _find_motion(channels, vehicle) if pressures else None
    for i in pressures:
        c = channels[i]
        briefly_rolling = rolling = slowing = np.empty(0)
        if motion:
            pressure = motion.times.interpolate(c)
            has_value = np.isfinite(pressure)
            masks = motion.rolls, _long_runs(motion.rolls), motion.slows
            briefly_rolling, rolling, slowing = (pressure[x & has_value] for x in masks)
        if _is_brake_pipe(rolling, slowing):
            level = float(np.median(rolling))
            reason = f"stands at {level / 1e5:.1f} bar while the train rolls, falls as it slows"
            judged[i] = replace(c, meaning="brake_pipe", axle=None, reason=reason)
            values = {"level_bar": level / 1e5}
            findings.append(Finding("pressure-of-brake-pipe", "info", c.title, values=values))
        elif meant[i].zero is None and _seems_absolute(c):
            free_rolling = rolling if len(rolling) >= _SHORTEST_RUN else briefly_rolling
            judged[i], finding = _above_air(c, free_rolling, motion.free_slope if motion else 0.0)
            findings += [finding] if finding else []
    return judged, list(dict.fromkeys(findings))


def _as_reservoir(c: Channel, m: Meant) -> Channel:
    """A channel; where its name says a brake pipe, but no brake pipe is so high, a reservoir's."""
    if c.meaning != "brake_pipe" or m.mapping or not len(c.data.value):
        return c
    level = float(np.median(c.data.value))
    if level <= _HIGHEST_PIPE:
        return c
    reason = f"named a pipe, but stands at {level / 1e5:.1f} bar as a main reservoir pipe does"
    return replace(c, meaning="reservoir_pressure", reason=reason)


def _is_brake_pipe(rolling: Floats, slowing: Floats) -> bool:
    """Whether a pressure is high where the train rolls freely, and lower where it slows."""
    if min(len(rolling), len(slowing)) < _SHORTEST_RUN:
        return False
    lower, level = np.quantile(rolling, [0.25, 0.5])
    reduced = np.quantile(slowing, 0.75)
    return bool(_PIPE[0] < level < _PIPE[1] and reduced < lower - _LEAST_REDUCTION)


def _seems_absolute(c: Channel) -> bool:
    """Whether a pressure never falls far below that of the air, and has twice as much.

    If its unit says that it counts from vacuum, the air is off already.
    """
    unit = units.unit_for(c.unit, "pressure")
    lowest, top = (float(x) for x in np.quantile(c.data.value, [0.02, 1.0]))  # [Pa]
    is_air = unit is not None and not unit.offset and _AIR[0] < lowest < _AIR[1]
    return is_air and top > 2.0 * lowest


def _above_air(c: Channel, rolling: Floats, free_slope: float) -> tuple[Channel, Finding | None]:
    """The pressure above its level in a freely rolling train, if that is the air's.

    Where it is used as logged, its zero is uncertain by that level. `rolling` are its values where
    the train rolls freely [Pa], `free_slope` says how the train's speed changes there [m/s²]. There
    is no finding where the level varies as that of a brake in use.
    """
    names = {"unit": c.unit, "use": "It never falls far below 1 bar, and is used as logged"}
    values, lowest = {}, float(np.quantile(c.data.value, 0.02))
    zero = Parameter(0.0, _LEVEL_SIGMA * lowest)
    if len(rolling):
        lower, level, upper = (float(x) for x in np.quantile(rolling, [0.25, 0.5, 0.75]))
        is_air = _AIR[0] < level < _AIR[1] and upper - lower < _AIR_SPREAD
        if not is_air and len(rolling) >= _SHORTEST_RUN:
            return c, None
        if is_air and free_slope > _SURELY_FREE:
            zero = Parameter(level, max((upper - lower) / 1.35, c.step / 12.0**0.5))
            c = replace(c, data=replace(c.data, value=c.data.value - level))
            names["use"] = f"Its released level of {level / 1e5:.1f} bar is taken off"
            values["level_bar"] = level / 1e5
    finding = Finding("pressure-absolute", "warning", c.title, values=values, names=names)
    return replace(c, zero=zero), finding


def _find_motion(channels: Sequence[Channel], vehicle: Vehicle) -> Motion | None:
    """How the train moves, by its speed or its fastest wheel; None where nothing shows it."""
    speeds = [c for c in channels if c.meaning in ("wheel_speed", "train_speed")]
    speeds = [c for c in speeds if not c.is_rate and len(c.data.t)]
    if not speeds:
        return None
    start = min(int(c.data.t.min()) for c in speeds)
    stop = max(int(c.data.t.max()) for c in speeds)
    step = max(_STEP_NS, (stop - start) // _MOST_TIMES)
    times = SampleTimes(np.arange(start, stop, step, dtype=np.int64))
    fastest = np.full(len(times.t), np.nan)
    for c in speeds:
        radius = vehicle.radius(c.axle or 1).value if c.meaning == "wheel_speed" else 1.0
        fastest = np.fmax(fastest, radius * np.abs(times.interpolate(c)))
    if len(fastest) <= 2 * _SLOPE_STEPS:
        return None
    slope = np.full(len(fastest), np.nan)
    inner = slice(_SLOPE_STEPS, -_SLOPE_STEPS)
    slope[inner] = fastest[2 * _SLOPE_STEPS :] - fastest[: -2 * _SLOPE_STEPS]
    slope /= 2.0 * _SLOPE_STEPS * step * 1e-9
    is_moving = (fastest > _MOVING) & np.isfinite(slope)
    if not is_moving.any():
        return None
    # Resistance and gradient slow a train that rolls freely, too: its least deceleration shows it.
    free_slope = min(float(np.quantile(slope[is_moving], 0.95)), 0.0)
    braked = slope[is_moving & (slope < free_slope - _LEAST_RANGE)]
    if not len(braked):
        return None
    slows_range = free_slope - float(np.median(braked))
    rolls = is_moving & (slope > free_slope - _FREE_ROLLING * slows_range)
    slows = _long_runs(is_moving & (slope < free_slope - _SLOWS * slows_range))
    return Motion(times, rolls, slows, float(np.median(slope[rolls])))


def _long_runs(mask: Bools) -> Bools:
    long_enough = np.zeros_like(mask)
    for a, b in true_runs(mask):
        long_enough[a:b] = b - a >= _SHORTEST_RUN
    return long_enough
