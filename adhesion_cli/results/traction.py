"""Where a picture shows no adhesion: a train that gains speed is driven, by a force of no brake."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..core.model import AxleResult, Bools, Floats, Result
from ..core.physics import GRADIENT

_HALF = 0.5  # the gain of speed is that from this time before to this time after a sample [s]


def gains_speed(t: Floats, speed: Floats, braked: Iterable[tuple[float, float]]) -> Bools:
    """Where a train gains more speed than on a gradient, outside of its brake applications.

    Args:
        t: times, shape (n,) [s].
        speed: of the train, shape (n,) [m/s].
        braked: begin and end of the brake applications [s].
    """
    known = np.isfinite(speed)
    if not known.any():
        return np.zeros(len(t), np.bool_)
    earlier, later = np.maximum(t - _HALF, t[0]), np.minimum(t + _HALF, t[-1])
    gain = np.subtract(*(np.interp(x, t[known], speed[known]) for x in (later, earlier)))
    gains: Bools = gain > GRADIENT * (later - earlier)
    for begin, stop in braked:
        gains &= (t < begin) | (t > stop)
    return gains


def without_traction(result: Result) -> Result:
    """A result whose references have no force where motors drive, for pictures."""
    return replace(result, axles=tuple(_without_traction(axle, result) for axle in result.axles))


def _without_traction(axle: AxleResult, result: Result) -> AxleResult:
    record = axle.record
    if record.traction_known or not len(record.t) or (np.diff(record.t) <= 0).any():
        return axle
    t = (record.t - record.t[0]) * np.float64(1e-9)
    rim = record.wheel_speed * result.vehicle.radius(record.axle).value
    speed = rim if record.train_speed is None else record.train_speed
    braked = [(float(t[s.start]), float(t[s.stop - 1])) for s in axle.applications]
    force = np.where(gains_speed(t, speed, braked), np.nan, axle.reference.force)
    return replace(axle, reference=replace(axle.reference, force=force))
