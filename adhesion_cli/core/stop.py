"""What a stop in closed loop leaves behind: data only."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .model import Floats, Times

JUDGED_FROM = 1.0  # train speed from which a stop is judged; the law's slip counts on at least it
SLIDE = 0.05  # slip from which a wheel slides [-]
_STANDING = 0.1  # a rim slower than this stands [m/s]
ROLLS, SLIDES, LOCKED = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Stop:
    """One stop under one controller: a row per tick, shape (n,) or (n, axles), SI."""

    controller: str
    algo: str  # estimator in the loop
    seed: int
    t: Times  # [ns]
    train_speed: Floats
    distance: Floats  # run by the first axle
    demand: Floats  # cylinder pressure there would be without controller
    rim_speed: Floats  # ωR
    pressure: Floats
    force: Floats  # true F
    peak: Floats  # the most the rail can give at this speed
    peak_slip: Floats  # and the slip at which it does
    slip: Floats  # true slip, NaN below `JUDGED_FROM`
    valve: NDArray[np.int8]  # as commanded: `controller.APPLY`, `HOLD`, `VENT`
    measured_train_speed: Floats  # what the unit had of its sensors, or made of its axles
    train_speed_doubt: Floats  # `trainspeed.Known.doubt`
    measured_wheel_speed: Floats  # [rad/s]
    measured_pressure: Floats
    measured_clamping_force: Floats  # K of that pressure
    measured_slip: Floats  # `unit.slip_of`
    judged_slip: Floats  # that the controller went by: the patent's law judges it a time ahead
    estimate: Floats  # F̂
    slope: Floats  # k = dμ/ds, NaN where not observable
    confidence: Floats
    region: NDArray[np.int8]  # index into `slope.REGIONS`, of judged slip and slope
    air: float  # taken in by all cylinders [normal litres]

    def sliding(self) -> NDArray[np.int8]:
        """`ROLLS`, `SLIDES` or `LOCKED`, shape (n, axles); rolls where the train is too slow."""
        fast = self.train_speed[:, None] >= JUDGED_FROM
        code = np.where(fast & (self.slip > SLIDE), SLIDES, ROLLS)
        return np.where(fast & (self.rim_speed < _STANDING), LOCKED, code).astype(np.int8)


class Verdict(NamedTuple):
    """One stop in the terms of EN 15595; None where nothing of the kind took place."""

    stopping_distance_m: float  # from the brake demand
    extension: float  # of it over that on dry rail, less 1
    utilisation: float | None  # of the rail's peak, while the brake would ask for more than that
    max_slip: float | None  # None: never so fast
    locked_s: float  # axle-seconds of standing wheels
    air_nl: float
    mean_slip_error: float | None  # mean |s − slip of the peak|, over the times of `utilisation`
    slide_s: float  # axle-seconds of sliding
    limited_s: float  # axle-seconds in which the brake would ask for more than the rail's peak
