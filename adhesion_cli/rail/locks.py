"""When a wheel is locked: it stands while the train is fast, and not only in the last metres."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..core.masks import runs_within
from ..core.model import AxleRecord, Floats
from ..core.physics import SLOW, STANDING
from .speed_errors import CLEAR_SIGMAS, speed_error

SHORTEST_LOCK = 0.4  # a wheel that stands for a shorter time is not locked [s]


class LockLimits(NamedTuple):
    """A standing wheel is locked while the train is faster, if that lasts longer."""

    speed: float = SLOW  # of the train [m/s]
    shortest: float = SHORTEST_LOCK  # [s]


class Lock(NamedTuple):
    """One lock of a wheel, up to where the wheel turns again or the train is slow."""

    samples: slice
    duration: float  # [s]


def find_locks(
    t: Floats,
    v: Floats,
    rim: Floats,
    limits: LockLimits,
    runs: Iterable[slice] = (slice(0, None),),
    least_v: Floats | None = None,
) -> list[Lock]:
    """The locks of a wheel, in the order of time, none across two runs.

    Times [s], speeds of train and rim [m/s] have shape (n,); a speed is NaN where it is not known.
    A lock is sure where the train is fast for long enough by `least_v`, its speed less the error,
    and lasts as long as it is fast by its speed.
    """
    sure_v = v if least_v is None else least_v
    with np.errstate(invalid="ignore"):
        stands = rim < STANDING
        sure = runs_within(stands & (sure_v > limits.speed), runs)
        locked = runs_within(stands & ((v > limits.speed) | (sure_v > limits.speed)), runs)
    starts = [x.start for x in sure if t[x.stop - 1] - t[x.start] > limits.shortest]
    return [
        Lock(x, float(t[x.stop - 1] - t[x.start]))
        for x in locked
        if any(x.start <= start < x.stop for start in starts)
    ]


def locks_of_axle(record: AxleRecord, radius: float, limits: LockLimits) -> list[Lock]:
    """The locks of an axle, whose wheels have a radius [m].

    None reaches across its segments, none is an error of the train speed.
    """
    if record.train_speed is None:
        return []
    with np.errstate(invalid="ignore"):  # a train that stands has no slip, nor an error of it
        least_speed = record.train_speed * (1.0 - CLEAR_SIGMAS * speed_error(record))
    seconds = (record.t - record.t[0]) * np.float64(1e-9)
    rim = record.wheel_speed * radius
    return find_locks(seconds, record.train_speed, rim, limits, record.segments, least_speed)
