"""A train of unlike axles slows as one of mean axles, and an error of it is one of all axles."""

from dataclasses import replace

import pytest

from adhesion_cli.core.model import CarAxle, Parameter, Vehicle
from adhesion_cli.core.physics import braked, clamping_force, force_line, wheelset
from adhesion_cli.train.mean_axle import mean_axle, move_axles, vehicle_of_axles

LIGHT = replace(Vehicle(), axle_mass=Parameter(9e3, 450.0), wheel_radius=(Parameter(0.46, 0.0),))
HEAVY = replace(
    Vehicle(), axle_mass=Parameter(16e3, 800.0), friction=Parameter(0.25, 0.05),
    lever_ratio=Parameter(4.0, 0.0), spring_force=Parameter(900.0, 90.0),
    wheelset_inertia=Parameter(210.0, 10.0),
)  # fmt: skip
AXLES = [CarAxle(1, "a", LIGHT), CarAxle(2, "b", HEAVY), CarAxle(4, "b", HEAVY)]
TRAIN = vehicle_of_axles(AXLES)


@pytest.mark.parametrize("pressure", [1.4e5, 3.5e5])
def test_the_mean_axle_slows_as_the_train(pressure: float) -> None:
    mean, own = mean_axle(TRAIN, [1, 2, 4]), [a.vehicle for a in AXLES]
    force = sum(v.friction.value * float(clamping_force(pressure, v)) for v in own)
    wheels = [wheelset(v, 1) for v in own]
    mass = sum(w.mass + w.inertia / w.radius**2 for w in wheels)
    slowing = float(braked(float(clamping_force(pressure, mean)), wheelset(mean, 1)))
    assert slowing == pytest.approx(force / mass, rel=1e-12)


def test_axles_of_one_kind_are_their_own_mean() -> None:
    heavy = mean_axle(TRAIN, [2, 4])
    assert heavy.of_axle(4) == HEAVY
    assert not heavy.axles
    alike = vehicle_of_axles([CarAxle(1, "", HEAVY), CarAxle(2, "", HEAVY)])
    assert not alike.axles


def test_an_error_of_the_mean_axle_is_one_of_all_axles() -> None:
    mean = mean_axle(TRAIN, [1, 2, 4])
    phi, m = mean.friction, mean.axle_mass
    found = replace(
        mean, friction=Parameter(1.1 * phi.value, 0.0), axle_mass=Parameter(0.9 * m.value, 0.0)
    )
    moved = move_axles(TRAIN, mean, found)
    shares = [
        moved.of_axle(n).friction.value / TRAIN.of_axle(n).friction.value - 1.0 for n in (1, 2)
    ]
    assert 0.0 < shares[0] < 0.1 < shares[1], "an axle moves by its share of the tolerances"
    masses = [moved.of_axle(n).axle_mass.value / TRAIN.of_axle(n).axle_mass.value for n in (1, 4)]
    assert masses == pytest.approx([0.9, 0.9])
    assert move_axles(TRAIN, mean, mean) == TRAIN


def test_an_axle_without_tolerance_does_not_move() -> None:
    exact = replace(
        LIGHT, friction=Parameter(0.3, 0.0), efficiency=Parameter(0.97, 0.0),
        cylinder_diameter=Parameter(0.1295, 0.0),
    )  # fmt: skip
    train = vehicle_of_axles([CarAxle(1, "a", exact), CarAxle(2, "b", HEAVY)])
    mean = mean_axle(train, [1, 2])
    found = replace(mean, friction=Parameter(1.2 * mean.friction.value, 0.01))
    moved = move_axles(train, mean, found)
    assert force_line(moved.of_axle(1)) == pytest.approx(force_line(exact))
    assert moved.of_axle(1).friction == pytest.approx(exact.friction)
    assert moved.of_axle(2).friction.value > 1.15 * HEAVY.friction.value
