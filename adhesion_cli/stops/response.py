"""The response of the brakes: delay and build-up of each axle."""

import math
from typing import NamedTuple

import numpy as np

from ..core.model import Floats, Parameter
from ..core.physics import SLOW
from .brake_levels import brake_levels, quantisation_step
from .find import Braking
from .signals import StopSignals

FULL_SHARE = 0.95  # of the full value of a brake: the build-up ends
_LONGEST_BUILD_UP = 0.5  # of the braking: what is later is another brake, or the driver
_LEVEL_ERROR = 0.005  # 1 sigma of the full value, as a share of it
_DROP = 0.1  # of the full value: a fall in the build-up is a valve of the WSP
_SLIDES = 0.05  # slip of a wheel that slides


class Response(NamedTuple):
    """When the brakes of all axles build up, after the command; NaN where it is not defined."""

    delay: Parameter  # [s]
    equivalent: Parameter  # [s]


class _AxleResponse(NamedTuple):
    delay: Parameter  # until the start share [s]
    full: Parameter  # until 95 % of the full value [s]
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
        error = math.hypot(noise, quantisation_step(part.value) / math.sqrt(12.0)) / span
        delay = _crossing(part.t, share, start_share if start_share else 5.0 * noise / span, error)
        end = _crossing(part.t, share, FULL_SHARE, math.hypot(error, _LEVEL_ERROR))
        if delay is None or end is None:
            disturbed = True
            continue
        rising = share[part.t <= end.value]
        rising = rising[np.isfinite(rising)]
        fall = np.max(np.maximum.accumulate(rising) - rising) if len(rising) else 0.0
        disturbed |= bool(fall > _DROP) or _slides(signals, axle, command, end.value)
        axles.append(_AxleResponse(_after(delay, command), _after(end, command), span))
    total = sum(r.weight for r in axles)
    unknown = Parameter(math.nan, math.nan)
    if not total:
        return Response(unknown, unknown)
    delay_mean, full_mean = (
        Parameter(
            sum(r.weight * x.value for r, x in zip(axles, times, strict=True)) / total,
            sum(r.weight * x.tolerance for r, x in zip(axles, times, strict=True)) / total,
        )
        for times in ([r.delay for r in axles], [r.full for r in axles])
    )
    if disturbed or full_mean.value > _LONGEST_BUILD_UP * (braking.end - command):
        return Response(delay_mean, unknown)
    sigma = math.hypot(delay_mean.tolerance, full_mean.tolerance) / 2.0
    mean = (delay_mean.value + full_mean.value) / 2.0
    return Response(delay_mean, Parameter(mean, sigma))


def _after(time: Parameter, command: float) -> Parameter:
    return time._replace(value=time.value - command)


def _crossing(t: Floats, share: Floats, level: float, error: float) -> Parameter | None:
    """The first time at which a rising share reaches a level, between samples.

    Args:
        t: times, shape (n,) [s].
        share: of the full brake, shape (n,).
        level: that is reached.
        error: 1 sigma of the share: the flatter it rises, the less is its time known.
    """
    above = np.flatnonzero(share >= level)
    if not len(above):
        return None
    k = int(above[0])
    interval = float(np.median(np.diff(t)))
    late = np.flatnonzero(share >= level + 2.0 * error)
    early = np.flatnonzero(share >= level - 2.0 * error)
    sigma = float(t[late[0]] - t[early[0]]) / 4.0 if len(late) else float(t[-1] - t[k]) / 4.0
    sigma = math.hypot(sigma, 0.25 * interval)
    if k == 0 or not share[k - 1] < level:
        return Parameter(float(t[k]), sigma)
    part = (level - share[k - 1]) / (share[k] - share[k - 1])
    return Parameter(float(t[k - 1] + part * (t[k] - t[k - 1])), sigma)


def _slides(signals: StopSignals, axle: int, start: float, stop: float) -> bool:
    """Whether an axle slides in a span of time."""
    if axle not in signals.rims:
        return False
    rim = signals.rims[axle].between(start, stop)
    v = signals.speed.at(rim.t)
    with np.errstate(invalid="ignore"):
        return bool(np.any((v > SLOW) & (rim.value < (1.0 - _SLIDES) * v)))
