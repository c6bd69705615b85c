"""The slides of one axle in one stop: initial adhesion, utilisation, energies.

The initial adhesion is the mean µ of the first `_BEGIN` seconds of the first slide, as EN 15595
means it (its text was not at hand). Its expanded uncertainty is that of the force there, and of the
begin: it has every mean from the first to the last moment at which the slide may begin. Errors of
neighbouring samples are taken as the same, so the mean has their mean uncertainty. While the
brake force is larger than the adhesion force, the wheel's deceleration shows only the difference
of both, and an error of the brake force goes whole into the adhesion force: without a stated
vehicle the interval is wide.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core.model import Z95, AxleResult, Floats, Result, Vehicle
from ..core.physics import G
from ..core.summary import AxleStop, BrakeApplication, StopSummary, largest_slip
from ..reference.budget import coefficient_u95
from .events import over_locks
from .locks import LockLimits, locks_of_axle
from .sliding import possible_begin

_BEGIN = 0.1  # over which the initial adhesion is a mean [s]


def add_slides(
    stop: StopSummary,
    result: Result,
    applications: Sequence[Sequence[BrakeApplication]],
    limits: LockLimits,
) -> StopSummary:
    """A stop with what the slides of each axle show, by the brake applications of each axle."""
    rows = {row.axle: row for row in stop.axles}
    for axle, of_axle in zip(result.axles, applications, strict=True):
        row = rows.get(axle.record.axle)
        shared = (a for a in of_axle if a.start_s < stop.end_s and a.end_s > stop.start_s)
        inside = [a for a in shared if a.slides]
        if row is not None and inside:
            t = (axle.record.t - result.log.start_ns()) * np.float64(1e-9)
            slides = _SlidesOfAxle(t, (stop.start_s, stop.end_s), axle, result.vehicle, inside)
            rows[row.axle] = _with_slides(row, slides, limits)
    return replace(stop, axles=tuple(rows.values()))


class _SlidesOfAxle(NamedTuple):
    t: Floats  # of its record, after the log's start [s]
    span: tuple[float, float]  # of the stop [s]
    axle: AxleResult
    vehicle: Vehicle  # of the log
    applications: Sequence[BrakeApplication]


def _with_slides(row: AxleStop, slides: _SlidesOfAxle, limits: LockLimits) -> AxleStop:
    t, (begin, end), axle, vehicle, applications = slides
    record, radius = axle.record, vehicle.radius(axle.record.axle).value
    assert record.train_speed is not None  # there is no slide without
    inside = [s for a in applications for s in a.slide_list if begin <= s.start_s <= end]
    force, _ = over_locks(axle.reference.force, axle.reference.brake)
    power = force * np.maximum(record.train_speed - record.wheel_speed * radius, 0.0)
    energies = [s.energy_j for s in inside if s.energy_j is not None]
    all_locks = locks_of_axle(record, radius, limits)
    locks = [lock for lock in all_locks if begin <= t[lock.samples.start] <= end]
    longest = max(locks, key=lambda lock: lock.duration, default=None)
    first_start = min((s.start_s for s in inside), default=math.nan)
    brake_start = max(begin, min(a.start_s for a in applications))
    initial, initial_u95 = _initial_coefficient(t, first_start, brake_start, axle, vehicle)
    utilisation, utilisation_ci = _utilisation(applications)
    lock_energy = math.nan
    if longest:
        lock_energy = float(np.trapezoid(power[longest.samples], t[longest.samples]))
    slip, slip_u95 = largest_slip(applications)
    if slip is None:
        slip, slip_u95 = row.max_slip, row.max_slip_u95
    return row._replace(
        max_slip=slip,
        max_slip_u95=slip_u95,
        initial_coefficient=initial,
        initial_coefficient_u95=initial_u95,
        utilisation=utilisation,
        utilisation_ci=utilisation_ci,
        energy_j=sum(energies) if inside and len(energies) == len(inside) else None,
        lock_energy_j=lock_energy if math.isfinite(lock_energy) else None,
    )


def _initial_coefficient(
    t: Floats, start: float, brake_start: float, axle: AxleResult, train: Vehicle
) -> tuple[float, float] | tuple[None, None]:
    """Mean µ at the begin of the first slide, and its expanded uncertainty."""
    reference, vehicle = axle.reference, train.of_axle(axle.record.axle)
    known = np.isfinite(reference.force + reference.sigma)
    rows = np.flatnonzero((t >= start) & (t <= start + _BEGIN) & known)
    if not len(rows):
        return None, None
    first, weight = reference.rows(rows), vehicle.axle_mass.value * G
    force = float(np.mean(first.force))
    u95 = Z95 * math.hypot(float(np.mean(first.sigma)), float(np.mean(first.tolerance)))
    places = (int(x) for x in np.searchsorted(t, [start, brake_start]))
    earliest, latest = t[[*possible_begin(axle, *places)]]
    late = max(_BEGIN, 2.0 * float(np.median(np.diff(t))))  # slip shows the begin so late, or early
    starts = np.arange(min(earliest, start - late), max(latest, start + late), _BEGIN / 2.0)
    edges = np.stack([starts, starts + _BEGIN])
    means = np.mean(np.interp(edges, t[known], reference.force[known]), axis=0)
    u95 = math.hypot(u95, float(np.max(np.abs(means - force))))
    together = 0.0 if first.mass is None else float(np.mean(first.mass))
    return force / weight, coefficient_u95(u95, force, vehicle, together) / weight


def _utilisation(
    applications: Sequence[BrakeApplication],
) -> tuple[float, tuple[float, float]] | tuple[None, None]:
    """Mean utilisation with its 95 % interval, over the time of the slides that show it."""
    rated = [a for a in applications if a.utilisation_ci]
    if not rated:
        return None, None
    rows = [(a.utilisation, *(a.utilisation_ci or ()), a.slide_s) for a in rated]
    *columns, seconds = np.array(rows).T
    mean, lower, upper = (float(np.average(x, weights=seconds)) for x in columns)
    return mean, (lower, upper)
