"""What a brake application used of the rail: force, adhesion coefficient, slides.

Uncertainties are those of JCGM 100 (GUM), see `reference.budget`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import physics, threads
from ..core.model import Z95, AxleRecord, AxleResult, Floats, Times, Vehicle
from ..core.signals import coverage_factor
from ..reference import budget
from ..reference.budget import Budget
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
        from_mps: speed at the start: the train's, or where it is not known, ωR of the wheel [m/s].
        to_mps: speed at the end.
        force: adhesion force [N].
        coefficient: adhesion coefficient F/(m g).
        slides: that begin in it, in the order of time.
        utilisation: mean μ in its slides over the highest that the rail could give.
        budget: of the mean force.
        unseen: time in which the wheel turns and its slip is not known [s].
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
    budget: Budget | None
    unseen: float


def of_axle(axle: AxleResult, vehicle: Vehicle) -> list[Application]:
    """The brake applications of an axle, in the order of time.

    Args:
        axle: with its slip, where the log has a train speed.
        vehicle: for the coefficient and its tolerance.
    """
    found, joined = slip.slides(axle), list[list[slice]]()
    for s in axle.applications:
        if joined and _locked(axle.record, slice(joined[-1][-1].stop, s.start)):
            joined[-1].append(s)
        else:
            joined.append([s])
    whole = slip.Whole(axle, vehicle)
    moved = budget.by_parameter(axle.record, vehicle, axle.reference) if joined else {}
    return threads.each(lambda parts: _application(whole, parts, found, moved), joined)


def _locked(record: AxleRecord, between: slice) -> bool:
    """Whether the brake stays on while the train moves: it is one application of a locked wheel."""
    K, v = record.clamping_force[between], record.train_speed
    if v is None or not len(K):
        return False
    return bool((K > physics.NO_FORCE).all() and (v[between] > physics.CRAWL).all())


def _application(
    whole: slip.Whole, parts: Sequence[slice], slides: Sequence[Slide],
    moved: Mapping[str, Floats],
) -> Application:  # fmt: skip
    axle, vehicle = whole.axle, whole.vehicle
    record, where = axle.record, slice(parts[0].start, parts[-1].stop)
    start, end = int(record.t[where.start]), int(record.t[where.stop - 1])
    speed = rim = record.wheel_speed[where] * vehicle.radius(record.axle).value
    if record.train_speed is not None:
        speed = np.where(np.isfinite(record.train_speed[where]), record.train_speed[where], rim)
    known = speed[np.isfinite(speed)]
    first, last = (float(known[i]) if len(known) else None for i in (0, -1))
    force, own_budget = _measured(axle, vehicle, parts, moved) or (None, None)
    weight = vehicle.axle_mass.value * physics.G
    own = tuple(x for x in slides if where.start <= x.where.start < where.stop)
    return Application(
        where, start, end, first, last, force,
        force and _over(force, weight, vehicle, _mass(axle, where)), own,
        slip.utilisation(whole, own), own_budget, slip.unknown(record, where, vehicle)[1],
    )  # fmt: skip


def _measured(
    axle: AxleResult, vehicle: Vehicle, parts: Sequence[slice], moved: Mapping[str, Floats]
) -> tuple[Measured, Budget] | None:
    """The force of an application [N]; None where the reference has no value.

    Args:
        axle: with its reference.
        vehicle: with its tolerances.
        parts: of the application in which the wheel turns.
        moved: what each parameter adds, from `budget.by_parameter`.

    The highest force is that with the highest lower limit of its noise: no outlier of the noise.
    """
    ref, known = axle.reference, []
    for part in parts:
        at = part.start + np.flatnonzero(np.isfinite(ref.force[part]))
        if len(at) > 1:
            known.append(at)
    if not known:
        return None
    every = np.concatenate(known)
    top = int(every[np.argmax(ref.force[every] - Z95 * ref.sigma[every])])
    mean = partial(_mean, axle.record.t, known=known)
    of = budget.of_mean(axle, vehicle, moved, mean, len(every))
    noise, u = float(ref.sigma[top]), math.hypot(ref.sigma[top], ref.tolerance[top])
    k = coverage_factor(budget.freedom(noise, u, len(every)))
    return Measured(mean(ref.force), of.k * of.u, float(ref.force[top]), k * u), of


def _mean(t: Times, x: Floats, known: Sequence[NDArray[np.int64]]) -> float:
    """Mean over time of the known samples, by the trapezoidal rule in each part."""
    area = sum(float(np.trapezoid(x[at], 1e-9 * (t[at] - t[at[0]]))) for at in known)
    return area / sum(1e-9 * float(t[at[-1]] - t[at[0]]) for at in known)


def _mass(axle: AxleResult, where: slice) -> float:
    """The force's mean covariance with ln m [N]."""
    of = axle.reference.mass
    return 0.0 if of is None else float(np.nanmean(of[where]))


def _over(force: Measured, weight: float, vehicle: Vehicle, together: float) -> Measured:
    """A force over the weight of the axle; `together` is from `_mass`."""

    def half(x: float, u95: float) -> float:
        return budget.of_coefficient(u95, x, vehicle, together) / weight

    return Measured(
        force.mean / weight, half(force.mean, force.mean_u95),
        force.max / weight, half(force.max, force.max_u95),
    )  # fmt: skip
