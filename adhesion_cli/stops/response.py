"""The response of the brakes: delay and build-up of each axle."""

import math
from typing import NamedTuple

import numpy as np

from ..core.masks import true_runs
from ..core.model import Floats, Parameter
from ..core.physics import SLOW
from .find import BEGUN, Braking
from .signals import DROP, StopSignals, brake_levels, quantisation_step

FULL_SHARE = 0.95  # of the full value of a brake: the build-up ends
_LONGEST_BUILD_UP = 0.5  # of the braking: what is later is another brake, or the driver
_QUARTER = 0.25  # of the full value: nothing disturbs the build-up before it
_LEVEL_ERROR = 0.005  # 1 sigma of the full value, as a share of it
_CREEPS = 0.02  # slip of a wheel from which it slides where it goes on to `_SLIDES`
_SLIDES = 0.05  # slip of a wheel that slides


class BrakeResponse(NamedTuple):
    """When the brakes of all axles build up, after the command; NaN where it is not defined."""

    delay: Parameter  # [s]
    equivalent: Parameter  # [s]
    full_value: float  # of the brake, mean over the axles: pressure [Pa] or force [N]
    build_up: float = math.nan  # how long it takes, by its first quarter where it is disturbed [s]


def find_response(
    signals: StopSignals, command: float, braking: Braking, start_share: float
) -> BrakeResponse:
    """The mean response of all axles, weighted by their brakes.

    It is not defined where WSP, a slide or another brake disturbs the build-up, nor where a
    pressure is at the end of its sensor's range, nor where the log begins after the command or
    other cars brake later than its axles. The delay ends at `start_share` of the full brake.
    """
    delays, build_ups, weights = list[Parameter](), list[Parameter](), list[float]()
    quarters = list[float]()
    unknown = Parameter(math.nan, math.nan)
    if braking.reason == BEGUN:
        return BrakeResponse(unknown, unknown, math.nan)
    if np.any((signals.saturated > command) & (signals.saturated < braking.stop)):
        return BrakeResponse(unknown, unknown, math.nan)  # nobody knows the full value
    disturbed = False
    for axle, brake in signals.brakes.items():
        released, full_value, noise = brake_levels(brake, braking.start, braking.stop)
        span = full_value - released
        window = brake.cut(command - 0.5, braking.stop)
        if span < 10.0 * noise or span <= 0.0 or len(window.t) < 2:
            continue
        share = (window.value - released) / span
        error = math.hypot(noise, quantisation_step(window.value) / math.sqrt(12.0)) / span
        t, begin_share = window.t - command, start_share or 5.0 * noise / span
        delay = _crossing(t, share, begin_share, error)
        build_up_end = _crossing(t, share, FULL_SHARE, math.hypot(error, _LEVEL_ERROR))
        if delay is None or build_up_end is None:
            disturbed = True
            continue
        # A valve that acts as soon after it cuts the last rise off: the full value is not known.
        rising = share[t <= 2.0 * build_up_end.value - delay.value]
        rising = rising[np.isfinite(rising)]
        fall = np.max(np.maximum.accumulate(rising) - rising) if len(rising) else 0.0
        disturbed |= bool(fall > DROP) or _slides(signals, axle, command, build_up_end.value)
        delays.append(delay)
        build_ups.append(build_up_end)
        weights.append(span)
        quarters.append(float(t[np.argmax(share >= _QUARTER)]) - delay.value)
    if not weights:
        return BrakeResponse(unknown, unknown, math.nan)
    delay, full_time = (
        Parameter(*np.average(times, axis=0, weights=weights).tolist())
        for times in (delays, build_ups)
    )
    longest, mean_weight = max(x.value for x in build_ups), float(np.mean(weights))
    if signals.others_later:
        return BrakeResponse(unknown, unknown, mean_weight, full_time.value)
    if disturbed or longest > _LONGEST_BUILD_UP * (braking.stop - command):
        return BrakeResponse(delay, unknown, mean_weight, max(quarters) / _QUARTER)
    sigma = math.hypot(delay.tolerance, full_time.tolerance) / 2.0
    equivalent = Parameter((delay.value + full_time.value) / 2.0, sigma)
    if any(f.overlaps(command, command + longest) for f in signals.other_brakes):
        equivalent = unknown  # the pressure alone is not the force
    return BrakeResponse(delay, equivalent, mean_weight, full_time.value)


def _crossing(t: Floats, share: Floats, level: float, error: float) -> Parameter | None:
    """The first time at which a rising share of the full brake reaches a level, between samples.

    `error` is 1 sigma of the share: the flatter it rises, the less is its time known.
    """
    reached = np.flatnonzero(share >= level)
    if not len(reached):
        return None
    k = int(reached[0])
    interval = float(np.median(np.diff(t)))
    upper_places, lower_places = (
        np.flatnonzero(share >= level + x) for x in (2.0 * error, -2.0 * error)
    )
    spread = t[upper_places[0]] - t[lower_places[0]] if len(upper_places) else t[-1] - t[k]
    sigma = math.hypot(float(spread) / 4.0, 0.25 * interval)
    if k == 0 or not share[k - 1] < level:
        return Parameter(float(t[k]), sigma)
    fraction = (level - share[k - 1]) / (share[k] - share[k - 1])
    return Parameter(float(t[k - 1] + fraction * (t[k] - t[k - 1])), sigma)


def _slides(signals: StopSignals, axle: int, command: float, build_up: float) -> bool:
    """Whether an axle begins to slide while its brake builds up [s]."""
    if axle not in signals.rims:
        return False
    rim = signals.rims[axle].cut(command, math.inf)
    v = signals.least_speed(rim.t)
    with np.errstate(divide="ignore", invalid="ignore"):
        slip = np.where(v > SLOW, 1.0 - rim.value / v, 0.0)
        runs = true_runs(slip > _CREEPS)
        return any(rim.t[a] - command < build_up and np.max(slip[a:b]) > _SLIDES for a, b in runs)
