"""The response of the brakes: delay and build-up of each axle."""

import math
from typing import NamedTuple

import numpy as np

from ..core.model import Floats
from .brake_levels import brake_levels
from .find import Braking
from .signals import StopSignals

FULL_SHARE = 0.95  # of the full value of a brake: the build-up ends
_LONGEST_BUILD_UP = 0.5  # of the braking: what is later is another brake, or the driver
_DROP = 0.1  # of the full value: a fall in the build-up is a valve of the WSP
_SLIDES = 0.05  # slip of a wheel that slides
_SLOW = 5.0 / 3.6  # slower wheels show no slip, and jerk is not evaluated [m/s]


class Response(NamedTuple):
    """When the brakes of all axles build up, after the command [s]; NaN where it is not defined."""

    delay: float
    equivalent: float


class _AxleResponse(NamedTuple):
    delay: float  # until the start share [s]
    full: float  # until 95 % of the full value [s]
    weight: float  # the full value of the brake


def find_response(
    signals: StopSignals, command: float, braking: Braking, start_share: float
) -> Response:
    """The mean response of all axles, weighted by their brakes.

    It is not defined where WSP, a slide or another brake disturbs the build-up.

    Args:
        signals: of the log.
        command: its time [s].
        braking: from `find_brakings`.
        start_share: share of the full brake at which the delay ends.
    """
    axles, disturbed = [], False
    for axle, brake in signals.brakes.items():
        released, full, noise = brake_levels(brake, braking.on, braking.end)
        span = full - released
        if span < 10.0 * noise or span <= 0.0:
            continue
        part = brake.between(command - 0.5, braking.end)
        share = (part.value - released) / span
        delay = _crossing(part.t, share, start_share if start_share else 5.0 * noise / span)
        end = _crossing(part.t, share, FULL_SHARE)
        if delay is None or end is None:
            disturbed = True
            continue
        rising = share[part.t <= end]
        rising = rising[np.isfinite(rising)]
        fall = np.max(np.maximum.accumulate(rising) - rising) if len(rising) else 0.0
        disturbed |= bool(fall > _DROP) or _slides(signals, axle, command, end)
        axles.append(_AxleResponse(delay - command, end - command, span))
    total = sum(r.weight for r in axles)
    if not total:
        return Response(math.nan, math.nan)
    delay_mean = sum(r.weight * r.delay for r in axles) / total
    full_mean = sum(r.weight * r.full for r in axles) / total
    disturbed |= full_mean > _LONGEST_BUILD_UP * (braking.end - command)
    return Response(delay_mean, math.nan if disturbed else (delay_mean + full_mean) / 2.0)


def _crossing(t: Floats, share: Floats, level: float) -> float | None:
    """The first time at which a rising share reaches a level, between samples."""
    above = np.flatnonzero(share >= level)
    if not len(above):
        return None
    k = int(above[0])
    if k == 0 or not share[k - 1] < level:
        return float(t[k])
    part = (level - share[k - 1]) / (share[k] - share[k - 1])
    return float(t[k - 1] + part * (t[k] - t[k - 1]))


def _slides(signals: StopSignals, axle: int, start: float, stop: float) -> bool:
    """Whether an axle slides in a span of time."""
    if axle not in signals.rims:
        return False
    rim = signals.rims[axle].between(start, stop)
    v = signals.speed.at(rim.t)
    with np.errstate(invalid="ignore"):
        return bool(np.any((v > _SLOW) & (rim.value < (1.0 - _SLIDES) * v)))
