"""What a brake application used of the rail: force, adhesion coefficient, slides.

Uncertainties are those of JCGM 100 (GUM), see `reference.budget`.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..core import physics, threads
from ..core.model import AxleResult, Floats, Times, Vehicle
from ..core.summary import (
    BrakeApplication,
    Contribution,
    Coverage,
    MeanAndHighest,
    SlideSummary,
    largest_slip,
)
from ..records.route import NOWHERE, Route
from ..reference import budget
from ..reference.brake_work import brake_work, motor_share
from . import fit, rail_under_slides, sliding
from .events import Slide
from .highest import PEAK_TIME, highest_mean, is_known
from .locks import Lock, LockLimits, locks_of_axle


def find_applications(
    axle: AxleResult,
    vehicle: Vehicle,
    start_ns: int = 0,
    route: Route = NOWHERE,
    limits: LockLimits | None = None,
    peak_time: float = PEAK_TIME,
) -> tuple[BrakeApplication, ...]:
    """The brake applications of an axle, in the order of time.

    Times count from `start_ns`, the log's start [ns]. `limits` say from when on a standing wheel is
    locked. The highest force is a mean over `peak_time` [s].
    """
    slides, merged = sliding.slides(axle), rail_under_slides.braked_pieces(axle)
    context = rail_under_slides.AxleContext(axle, vehicle)
    places = rail_under_slides.fit_places(context, slides)
    by_slide = {x.start: place.rail for place in places for x in place.slides}
    radius = vehicle.radius(axle.record.axle).value
    locks = locks_of_axle(axle.record, radius, limits or LockLimits())
    contributions: Mapping[str, Floats] = {}
    if merged:
        contributions = budget.contributions_by_parameter(axle.record, vehicle, axle.reference)
    about = slides, locks, by_slide, contributions, start_ns, route, peak_time
    return tuple(threads.run_each(lambda parts: _application(context, parts, *about), merged))


def _application(  # noqa: PLR0913 (all that a brake application is made of)
    context: rail_under_slides.AxleContext,
    pieces: Sequence[slice],
    all_slides: Sequence[Slide],
    all_locks: Sequence[Lock],
    rails: Mapping[int, fit.RailFit | None],
    contributions: Mapping[str, Floats],
    log_start: int,
    route: Route,
    peak_time: float,
) -> BrakeApplication:
    axle, vehicle = context.axle, context.vehicle
    record, samples = axle.record, slice(pieces[0].start, pieces[-1].stop)
    speed = rim = record.wheel_speed[samples] * vehicle.radius(record.axle).value
    if record.train_speed is not None:
        speed = np.where(np.isfinite(record.train_speed[samples]), record.train_speed[samples], rim)
    finite = speed[np.isfinite(speed)]
    from_speed, to_speed = (float(finite[i]) if len(finite) else None for i in (0, -1))
    measured = _measured(axle, vehicle, pieces, contributions, peak_time)
    force, coefficient, rows, coverage = measured or (None, None, None, None)
    weight = vehicle.axle_mass.value * physics.G
    slides = [x for x in all_slides if samples.start <= x.samples.start < samples.stop]
    place = route.at(int(record.t[samples.start]))
    locks = [x.duration for x in all_locks if samples.start <= x.samples.start < samples.stop]
    slip, slip_u95 = (1.0, 0.0) if locks else largest_slip(slides)
    energies = [x.energy for x in slides if x.energy is not None]
    by_force = sum(energies) * force.mean_u95 / max(abs(force.mean), 1e-9) if force else 0.0
    rail = rails.get(slides[0].start) if slides else None
    slide_list = tuple(summarise_slide(x, log_start, route, rail) for x in slides)
    utilisation = rail.utilisation if rail else None
    has_motor = force is not None and record.motor_clamping is not None
    work = brake_work(record, vehicle, pieces) if has_motor else None
    return BrakeApplication(
        axle=record.axle,
        start_s=(int(record.t[samples.start]) - log_start) / 1e9,
        end_s=(int(record.t[samples.stop - 1]) - log_start) / 1e9,
        from_mps=from_speed,
        to_mps=to_speed,
        force_n=force and _without_unknown(force, weight),
        coefficient=coefficient and _without_unknown(coefficient, 1.0),
        slides=len(slides),
        slide_list=slide_list,
        slide_s=sum(x.duration for x in slides),
        slide_distance_m=sum(x.distance for x in slides),
        max_slip=slip,
        max_slip_u95=slip_u95,
        slide_energy_j=sum(energies) if len(energies) == len(slides) else None,
        slide_energy_u95_j=force and math.hypot(by_force, sum(x.lock_u95 for x in slides)),
        at_least=any(x.is_lower_bound for x in slides),
        utilisation=utilisation and utilisation.value,
        utilisation_ci=utilisation and (utilisation.lower, utilisation.upper),
        budget=rows,
        coverage=coverage,
        locked_s=None if record.train_speed is None else sum(locks, 0.0),
        longest_lock_s=None if record.train_speed is None else max(locks, default=0.0),
        slip_unknown_s=rail_under_slides.unknown_slip(record, samples, vehicle)[1],
        time=place.time,
        position_km=place.position_km,
        position_from=route.position_from,
        latitude=place.latitude,
        longitude=place.longitude,
        slide_start_s=slide_list[0].start_s if slide_list else None,
        slide_position_km=slide_list[0].position_km if slide_list else None,
        ed_share=work and motor_share([work], vehicle),
    )


def summarise_slide(
    slide: Slide, start_ns: int, route: Route, rail: fit.RailFit | None
) -> SlideSummary:
    """A slide with its place and the rail under it; other arguments as of `find_applications`."""
    place, mu = route.at(slide.start), rail and rail.peak_mu
    return SlideSummary(
        start_s=(slide.start - start_ns) / 1e9,
        duration_s=slide.duration,
        distance_m=slide.distance,
        max_slip=slide.max_slip,
        energy_j=slide.energy,
        at_least=slide.is_lower_bound,
        duration_u95_s=slide.duration_u95,
        max_slip_u95=slide.max_slip_u95,
        peak_mu=mu and mu.value,
        peak_mu_ci=mu and (mu.lower, mu.upper),
        utilisation=rail.utilisation.value if rail and rail.utilisation else None,
        time=place.time,
        position_km=place.position_km,
        latitude=place.latitude,
        longitude=place.longitude,
    )


def _measured(
    axle: AxleResult,
    vehicle: Vehicle,
    pieces: Sequence[slice],
    contributions: Mapping[str, Floats],
    peak_time: float,
) -> tuple[MeanAndHighest, MeanAndHighest, tuple[Contribution, ...], Coverage] | None:
    """Force [N], µ and budget of an application; None where the reference has no value.

    Nor has it an interval where the pressure is at the end of its sensor's range. `pieces` are
    those in which the wheel turns.
    """
    ref, finite_pieces = axle.reference, []
    if ref.saturated is not None and any(ref.saturated[piece].any() for piece in pieces):
        return None
    for piece in pieces:
        indices = piece.start + np.flatnonzero(np.isfinite(ref.force[piece]))
        if len(indices) > 1:
            finite_pieces.append(indices)
    if not finite_pieces:
        return None
    mean = partial(_mean, axle.record.t, pieces=finite_pieces)
    samples = sum(map(len, finite_pieces))
    rows, coverage = budget.mean_budget(axle, vehicle, contributions, mean, samples)
    highest = highest_mean(axle.record.t, ref, finite_pieces, peak_time)
    force = MeanAndHighest(mean(ref.force), coverage.k * coverage.u_n, highest.value, highest.u95)
    mass = 0.0 if ref.mass is None else mean(ref.mass)
    return force, _coefficient(force, vehicle, mass, highest.mass), rows, coverage


def _mean(t: Times, x: Floats, pieces: Sequence[NDArray[np.int64]]) -> float:
    """Mean over time of the known samples, by the trapezoidal rule in each part."""
    seconds = [1e-9 * (t[indices] - t[indices[0]]) for indices in pieces]
    columns = zip(pieces, seconds, strict=True)
    area = sum(float(np.trapezoid(x[indices], since)) for indices, since in columns)
    return area / sum(float(since[-1]) for since in seconds)


def _coefficient(
    force: MeanAndHighest, vehicle: Vehicle, mean_mass: float, highest_mass: float
) -> MeanAndHighest:
    """A force [N] over the weight of the axle; the masses are the forces' covariances with ln m."""
    assert force.max is not None
    weight = vehicle.axle_mass.value * physics.G
    mean_u95 = budget.coefficient_u95(force.mean_u95, force.mean, vehicle, mean_mass)
    max_u95 = budget.coefficient_u95(force.max_u95, force.max, vehicle, highest_mass)
    return MeanAndHighest(*(x / weight for x in (force.mean, mean_u95, force.max, max_u95)))


def _without_unknown(x: MeanAndHighest, weight: float) -> MeanAndHighest:
    """A force [N], or µ with a weight of 1, without a highest value whose interval says nothing."""
    if x.max is None or is_known(x.max / weight, x.max_u95 / weight):
        return x
    return x._replace(max=None)
