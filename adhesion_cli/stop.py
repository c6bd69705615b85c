"""What a stop in closed loop leaves behind: data only."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .model import Floats, Times


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
    slip: Floats  # true slip, NaN where the train is too slow
    valve: NDArray[np.int8]  # as commanded: `controller.APPLY`, `HOLD`, `VENT`
    region: NDArray[np.int8]  # of what the unit was told: index into `slope.REGIONS`
    told_train_speed: Floats  # what the sensors said
    told_wheel_speed: Floats  # [rad/s]
    told_clamping_force: Floats  # K from the pressure they said
    estimate: Floats  # F̂
    slope: Floats  # k = dμ/ds, NaN where not observable
    confidence: Floats
    air: float  # taken in by all cylinders [normal litres]


class Verdict(NamedTuple):
    """One stop in the terms of EN 15595; None where nothing of the kind took place."""

    stopping_distance_m: float  # from the brake demand
    extension: float  # of it over that on dry rail, less 1
    utilisation: float | None  # of the rail's peak, while the brake would ask for more than that
    max_slip: float
    locked_s: float  # axle-seconds of standing wheels
    air_nl: float
    mean_slip_error: float | None  # mean |s − slip of the peak|, over the times of `utilisation`
    slide_s: float  # axle-seconds of sliding
    limited_s: float  # axle-seconds in which the brake would ask for more than the rail's peak
