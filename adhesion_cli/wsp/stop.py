"""The result of a stop in closed loop: data only."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.model import Floats, Times
from ..core.physics import JUDGED_FROM, LOCKED, ROLLS, SLIDE, SLIDES
from ..rail.locks import LockLimits, find_locks


class Stop(NamedTuple):
    """One stop under one controller: a row per tick, shape (n,) or (n, axles), SI."""

    controller: str
    algo: str  # estimator in the loop
    seed: int
    t: Times  # [ns]
    train_speed: Floats
    distance: Floats  # run by the first axle
    demand: Floats  # cylinder pressure without WSP controller
    rim_speed: Floats  # ωR
    pressure: Floats
    force: Floats  # true F
    peak: Floats  # available adhesion force at this speed
    peak_slip: Floats  # slip of that peak
    slip: Floats  # true slip, NaN below `JUDGED_FROM`
    valve: NDArray[np.int8]  # as commanded: `controller.APPLY`, `HOLD`, `DUMP`
    measured_train_speed: Floats  # by its sensors, or estimated from the axles
    train_speed_doubt: Floats  # `reference_speed.TrainEstimate.doubt`
    measured_wheel_speed: Floats  # [rad/s]
    measured_pressure: Floats
    measured_clamping_force: Floats  # K of that pressure
    measured_slip: Floats  # `wsp_controller.slip_of`
    judged_slip: Floats  # that the controller decided on: the patent's law predicts it
    estimate: Floats  # F̂
    slope: Floats  # k = dμ/ds, NaN where not observable
    confidence: Floats
    region: NDArray[np.int8]  # index into `slope.REGIONS`, of judged slip and slope
    air: float  # taken in by all cylinders [normal litres]

    def sliding(self) -> NDArray[np.int8]:
        """`ROLLS`, `SLIDES` or `LOCKED`, shape (n, axles); rolls where the train is too slow."""
        fast = self.train_speed[:, None] >= JUDGED_FROM
        code = np.where(fast & (self.slip > SLIDE), SLIDES, ROLLS).astype(np.int8)
        seconds: Floats = self.t * np.float64(1e-9)
        for i, rim in enumerate(self.rim_speed.T):
            for lock in find_locks(seconds, self.train_speed, rim, LockLimits()):
                code[lock.samples, i] = LOCKED
        return code


class Verdict(NamedTuple):
    """One stop in the terms of EN 15595; None where there was no such event."""

    stopping_distance_m: float  # from the brake demand
    extension: float  # relative to the distance on dry rail, less 1
    utilisation: float | None  # share of the peak, while the brake demands more than it
    max_slip: float | None  # above `WORKING`, as of logged stops; None: never so fast
    locked_s: float  # axle-seconds of standing wheels
    air_nl: float
    mean_slip_error: float | None  # mean |s − slip of the peak|, over the times of `utilisation`
    slide_s: float  # axle-seconds of sliding
    limited_s: float  # axle-seconds in which the brake demands more than the peak
