"""Uncertainty budget of the mean adhesion force, F = φK + I ω̇/R, by JCGM 100 (GUM).

First order: each quantity contributes its standard uncertainty times ∂F/∂q. The vehicle's
tolerances are stated (type B) and one error of all samples, so their sensitivities are means over
the samples. The noise (type A) is correlated over a time that is not known: it counts in full and
does not shrink with the number of samples.
"""

import math
from collections.abc import Callable, Mapping

from ..core.model import (
    Z95,
    AxleRecord,
    AxleResult,
    Floats,
    Parameter,
    Reference,
    Vehicle,
    quantities,
)
from ..core.physics import wheelset, with_fade
from ..core.signals import coverage_factor
from ..core.summary import Contribution, Coverage
from .force import CREEPAGE, ZERO, before_lag, contributions

NOISE = "noise"  # name of the row for noise and smoothing
MOTORS = "ed_force"  # name of the row for the force of the motors


def coefficient_u95(u95: float, force: float, vehicle: Vehicle, together: float) -> float:
    """Expanded uncertainty of F/(m g), times the stated m g: the mass has a tolerance, too [N].

    `u95` is that of F, `together` the covariance of F with ln m [N].
    """
    share = vehicle.axle_mass.share
    added = share**2 * force**2 - 2.0 * together * force
    return math.sqrt(max(u95**2 + Z95**2 * added, 0.0))


def contributions_by_parameter(
    record: AxleRecord, vehicle: Vehicle, reference: Reference
) -> Mapping[str, Floats]:
    """By how much each parameter's tolerance moves the force of an axle [N]; (n,) each."""
    w = wheelset(vehicle, record.axle)
    record = with_fade(record, vehicle)
    K, speed = record.clamping_force_smooth, record.wheel_speed * w.radius
    friction = record.friction_clamping_smooth
    earlier = before_lag(record, vehicle, friction)
    dw = w.a * (reference.force - w.phi * K)
    rows = contributions(record, vehicle, friction, dw, speed, earlier)
    if record.motor_sigma is not None:
        rows[MOTORS] = record.motor_sigma
    return rows


def mean_budget(
    axle: AxleResult,
    vehicle: Vehicle,
    columns: Mapping[str, Floats],
    mean: Callable[[Floats], float],
    samples: int,
) -> tuple[tuple[Contribution, ...], Coverage]:
    """The budget of the mean force of a brake application, the largest share first, and its sum.

    `columns` are from `contributions_by_parameter`. `mean` is that over the application's `samples`
    with a force, of a column of shape (n,).
    """
    contributions = {name: mean(column) for name, column in columns.items()}
    noise = mean(axle.reference.sigma)
    variance = max(vehicle.covariance(contributions, contributions), 0.0) + noise**2
    rows = [Contribution(NOISE, None, "N", "A", noise, 1.0, noise, _share(noise**2, variance))]
    if by_motors := contributions.get(MOTORS, 0.0):
        assert axle.record.motor_clamping_smooth is not None
        phi = wheelset(vehicle, axle.record.axle).phi
        mean_force = phi * mean(axle.record.motor_clamping_smooth)
        share = _share(by_motors**2, variance)
        rows.append(Contribution(MOTORS, mean_force, "N", "B", by_motors, 1.0, by_motors, share))
    record = axle.record
    of_axle = {"wheel_radius": vehicle.radius(record.axle), ZERO: record.pressure_zero}
    of_axle[CREEPAGE] = Parameter(1.0, record.creepage_doubt)
    for name, contribution in contributions.items():
        if name == MOTORS:
            continue
        q = of_axle.get(name) or getattr(vehicle, name)
        if q.tolerance > 0.0:
            share = _share(vehicle.covariance({name: contribution}, contributions), variance)
            unit = {ZERO: "Pa", CREEPAGE: "-"}.get(name) or quantities(Vehicle)[name].unit
            row = Contribution(
                quantity=name,
                value=q.value,
                unit=unit,
                type="B",
                u=q.tolerance,
                sensitivity=contribution / q.tolerance,
                contribution_n=abs(contribution),
                share=share,
            )
            rows.append(row)
    rows.sort(key=lambda row: -row.share)
    u = math.sqrt(variance)
    n = freedom(noise, u, samples)
    return tuple(rows), Coverage(u, coverage_factor(n), n if math.isfinite(n) else None)


def _share(variance: float, total: float) -> float:
    return variance / total if total else 0.0


def freedom(noise: float, u: float, samples: int) -> float:
    """Effective degrees of freedom of u, where only the noise is found from samples."""
    return max(samples - 1, 1) * (u / noise) ** 4 if noise > 0.0 else math.inf
