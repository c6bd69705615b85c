"""What a brake application used of the rail: force, adhesion coefficient, slides.

Uncertainties are those of JCGM 100 (GUM). The noise of neighbouring samples is correlated over a
time that is not known, and the vehicle's tolerances are one error of all samples. So both count in
full in the mean: its uncertainty does not shrink with the number of samples.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import physics
from ..core.model import Z95, AxleResult, Floats, Vehicle
from . import slip
from .events import Slide
from .fit import Interval


class Measured(NamedTuple):
    """Mean and highest value, each with its expanded uncertainty (95 %); names as in the JSON."""

    mean: float
    mean_u95: float
    max: float
    max_u95: float


@dataclass(frozen=True, slots=True)
class Application:
    """One brake application of one axle; None is what the log does not show.

    Attributes:
        where: of the record.
        start: [ns].
        end: [ns].
        from_mps: speed at the start: the train's, or ωR of the wheel [m/s].
        to_mps: speed at the end.
        force: adhesion force [N].
        coefficient: adhesion coefficient F/(m g).
        slides: that begin in it, in the order of time.
        utilisation: mean μ in its slides over the highest that the rail could give.
    """

    where: slice
    start: int
    end: int
    from_mps: float | None
    to_mps: float | None
    force: Measured | None
    coefficient: Measured | None
    slides: tuple[Slide, ...]
    utilisation: Interval | None


def of_axle(axle: AxleResult, vehicle: Vehicle) -> list[Application]:
    """The brake applications of an axle, in the order of time.

    Args:
        axle: with its slip, where the log has a train speed.
        vehicle: for the coefficient and its tolerance.
    """
    found = slip.slides(axle)
    return [_application(axle, vehicle, s, found) for s in axle.applications]


def _application(
    axle: AxleResult, vehicle: Vehicle, where: slice, slides: Sequence[Slide]
) -> Application:
    record = axle.record
    start, end = int(record.t[where.start]), int(record.t[where.stop - 1])
    if record.train_speed is None:
        speed = record.wheel_speed[where] * vehicle.radius(record.axle).value
    else:
        speed = record.train_speed[where]
    known = speed[np.isfinite(speed)]
    first, last = (float(known[i]) if len(known) else None for i in (0, -1))
    force = _measured(axle, where)
    weight = vehicle.axle_mass.value * physics.G
    share = vehicle.axle_mass.tolerance / vehicle.axle_mass.value
    own = tuple(x for x in slides if where.start <= x.where.start < where.stop)
    return Application(
        where, start, end, first, last, force, force and _over(force, weight, share),
        own, slip.utilisation(axle, vehicle, own),
    )  # fmt: skip


def _measured(axle: AxleResult, where: slice) -> Measured | None:
    """The force of an application [N]; None where the reference has no value.

    The highest force is that with the highest lower limit of its noise: no outlier of the noise.
    """
    t: Floats = (axle.record.t[where] - axle.record.t[where.start]) * 1e-9
    ref = axle.reference
    at = np.flatnonzero(np.isfinite(ref.force[where]))
    if len(at) < 2:
        return None
    force, sigma, tolerance = (x[where][at] for x in (ref.force, ref.sigma, ref.tolerance))
    highest = int(np.argmax(force - Z95 * sigma))
    half = math.hypot(_mean(t[at], sigma), _mean(t[at], tolerance))
    peak = math.hypot(float(sigma[highest]), float(tolerance[highest]))
    return Measured(_mean(t[at], force), Z95 * half, float(force[highest]), Z95 * peak)


def _mean(t: Floats, x: Floats) -> float:
    """Mean over time, by the trapezoidal rule."""
    return float(np.trapezoid(x, t) / (t[-1] - t[0]))


def _over(force: Measured, weight: float, share: float) -> Measured:
    """A force over the weight of the axle, whose relative standard uncertainty is `share`."""
    mean, peak = force.mean / weight, force.max / weight
    return Measured(
        mean, math.hypot(force.mean_u95 / weight, Z95 * share * mean),
        peak, math.hypot(force.max_u95 / weight, Z95 * share * peak),
    )  # fmt: skip
