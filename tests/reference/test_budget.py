"""The uncertainty budget against Monte Carlo draws of the vehicle (JCGM 101)."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.samples import analysed_sample

from adhesion_cli.core import physics
from adhesion_cli.core.model import Z95, Floats, Parameter, Result, Vehicle, quantities
from adhesion_cli.core.signals import coverage_factor
from adhesion_cli.rail.applications import find_applications
from adhesion_cli.reference import budget


@pytest.fixture(params=["low-adhesion", "service-brake"])
def result(request: pytest.FixtureRequest) -> Result:
    return analysed_sample(request.param)


def drawn(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    def one(p: Parameter) -> Parameter:
        return Parameter(float(rng.normal(*p)), 0.0)

    of = {n: one(getattr(vehicle, n)) for n in quantities(Vehicle) if n != "wheel_radius"}
    return replace(vehicle, wheel_radius=tuple(map(one, vehicle.wheel_radius)), **of)


@pytest.mark.parametrize("of_rim", [False, True])
def test_first_order_is_what_drawn_vehicles_give(result: Result, of_rim: bool) -> None:
    axle, vehicle = result.axles[0], result.vehicle
    zero = Parameter(0.0, 5e3)
    record = replace(axle.record, of_rim=of_rim, pressure_zero=zero)
    ref = replace(axle.reference, sigma=np.zeros(len(record)))
    at = np.flatnonzero(np.isfinite(ref.force[axle.applications[0]]))[::20]
    at += axle.applications[0].start

    def mean(x: Floats) -> float:
        return float(x[at].mean())

    moved = budget.contributions_by_parameter(record, vehicle, ref)
    of = replace(axle, record=record, reference=ref)
    _, found = budget.mean_budget(of, vehicle, moved, mean, len(at))
    assert found.degrees_of_freedom is None
    assert found.k == Z95
    assert record.pressure is not None
    w = physics.wheelset(vehicle, 1)
    acceleration = w.a * (ref.force[at] - w.phi * record.clamping_force_smooth[at])
    rng = np.random.default_rng(1)
    means = []
    for _ in range(1000):
        other = drawn(vehicle, rng)
        K = physics.clamping_force(record.pressure[at] - rng.normal(*zero), other)
        R = other.radius(1).value
        dw = acceleration * (vehicle.radius(1).value / R if of_rim else 1.0)
        F = other.friction.value * K + other.wheelset_inertia.value * dw / R
        means.append(F.mean())
    assert found.u_n == pytest.approx(np.std(means), rel=0.07)


def test_a_budget_adds_up_and_gives_the_expanded_uncertainty(result: Result) -> None:
    (one,) = find_applications(result.axles[0], result.vehicle)
    assert one.budget
    assert one.coverage
    assert one.force_n
    rows = one.budget
    assert sum(row.share for row in rows) == pytest.approx(1.0)
    assert [row.share for row in rows] == sorted((row.share for row in rows), reverse=True)
    for row in rows:
        assert row.contribution_n == pytest.approx(abs(row.u * row.sensitivity))
    assert np.hypot.reduce([row.contribution_n for row in rows]) == pytest.approx(one.coverage.u_n)
    assert one.force_n.mean_u95 == one.coverage.k * one.coverage.u_n
    assert [row.quantity for row in rows if row.type == "A"] == ["noise"]


def test_correlated_tolerances_add_up_to_the_whole(result: Result) -> None:
    pair = ("friction", "spring_force", 0.8)
    vehicle = replace(result.vehicle, correlation=(pair,))
    alone, together = (find_applications(result.axles[0], v)[0] for v in (result.vehicle, vehicle))
    assert alone.coverage
    assert together.budget
    assert together.coverage
    by = {row.quantity: row.u * row.sensitivity for row in together.budget}
    extra = 2.0 * 0.8 * by["friction"] * by["spring_force"]
    assert together.coverage.u_n**2 == pytest.approx(alone.coverage.u_n**2 + extra)
    assert sum(row.share for row in together.budget) == pytest.approx(1.0)


def test_few_samples_of_noise_alone_have_students_factor() -> None:
    assert budget.freedom(10.0, 10.0, 6) == 5.0
    assert budget.freedom(10.0, 20.0, 6) == 80.0
    assert coverage_factor(5.0) == pytest.approx(2.571, rel=0.003)
