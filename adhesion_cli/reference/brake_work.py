"""The work of the friction brake and of the motors in a braking: which brake stops the train."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core import physics
from ..core.model import Z95, AxleRecord, Floats, Vehicle
from ..core.summary import Measured
from .force import contributions


class BrakeWork(NamedTuple):
    """The work of the brakes of some axles [J], and 1 sigma of it."""

    motors: float
    motors_sigma: float
    friction: float
    friction_terms: Mapping[str, float]  # by how much each parameter's tolerance changes it


def brake_work(record: AxleRecord, vehicle: Vehicle, pieces: Iterable[slice]) -> BrakeWork:
    """The work of an axle's brakes at the rim of its wheels, over pieces without a gap."""
    axle_vehicle = vehicle.of_axle(record.axle)
    phi, rim = axle_vehicle.friction.value, record.wheel_speed * vehicle.radius(record.axle).value
    friction = record.friction_clamping_smooth
    friction = friction * physics.friction_share(rim, friction, axle_vehicle)
    terms = contributions(record, axle_vehicle, friction, np.zeros(len(rim)), rim, None)
    spans = list(pieces)

    def work(force: Floats) -> float:
        return sum(_integral(record, force * rim, piece) for piece in spans)

    by_motors = sigma = 0.0
    if record.motor_clamping_smooth is not None and record.motor_sigma is not None:
        motors = record.motor_clamping_smooth
        brakes = motors > 0.0  # below zero they drive
        by_motors = work(np.where(brakes, phi * motors, 0.0))
        sigma = work(np.where(brakes, record.motor_sigma, 0.0))
    by_term = {name: work(term) for name, term in terms.items()}
    return BrakeWork(by_motors, sigma, work(phi * friction), by_term)


def motor_share(works: Sequence[BrakeWork], vehicle: Vehicle) -> Measured | None:
    """The share of the motors in the work of the brakes of all these axles; None where none brakes.

    The friction brake has the rest. One vehicle and one converter: all errors are common.
    """
    motors, friction = (sum(getattr(w, name) for w in works) for name in ("motors", "friction"))
    total = motors + friction
    if motors <= 0.0:
        return None
    names = dict.fromkeys(name for w in works for name in w.friction_terms)
    terms = {name: sum(w.friction_terms.get(name, 0.0) for w in works) for name in names}
    variance = motors**2 * max(vehicle.covariance(terms, terms), 0.0)
    variance += friction**2 * sum(w.motors_sigma for w in works) ** 2
    u95 = Z95 * float(np.sqrt(variance)) / total**2
    return Measured(motors / total, u95, u95)


def _integral(record: AxleRecord, x: Floats, piece: slice) -> float:
    t = (record.t[piece] - record.t[piece.start]) * np.float64(1e-9)
    return float(np.trapezoid(np.nan_to_num(x[piece]), t))
