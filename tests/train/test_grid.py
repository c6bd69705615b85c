"""What a train does before and after its brake, on the coarse grid."""

from dataclasses import replace

import numpy as np
import pytest

from adhesion_cli.core.model import Floats
from adhesion_cli.train.grid import STEP, Grid

BRAKE = 10.0, 20.0  # of 30 s [s]


def braked(before: float, after: float) -> Grid:
    """One axle that gains speed by that before and after a brake application [m/s²]."""
    t: Floats = np.arange(0.0, 30.0, STEP)
    acts = (t >= BRAKE[0]) & (t < BRAKE[1])
    acceleration = np.where(acts, -0.8, np.where(t < BRAKE[0], before, after))
    v = 20.0 + np.cumsum(acceleration) * STEP
    clamping = np.where(acts, 2e4, 0.0)
    return Grid(0, STEP, v[None], clamping[None], 10.0 * clamping[None], None)


def at(grid: Grid, values: Floats, time: float) -> float:
    """The value at that time [s]."""
    return float(values[round(time / grid.step)])


@pytest.mark.parametrize("rate", [0.1, 0.25, 0.35])
def test_a_gain_before_the_brake_alone_is_of_motors_or_a_gradient(rate: float) -> None:
    grid = braked(rate, -0.02)
    assert at(grid, grid.driven, 6.0)
    assert not at(grid, grid.driven, 25.0)
    assert at(grid, grid.downhill_sigma, 15.0) == pytest.approx(rate / 2.0, rel=0.01)
    assert at(grid, grid.downhill_sigma, 25.0) == 0.0


def test_a_gain_that_no_line_has_is_of_motors() -> None:
    grid = braked(0.6, -0.02)
    assert at(grid, grid.driven, 6.0)
    assert not grid.downhill_sigma.any()


@pytest.mark.parametrize("rate", [-0.1, 0.0, 0.1, 0.25])
def test_what_is_alike_before_and_after_the_brake_is_the_gradient(rate: float) -> None:
    grid = braked(rate, rate + 0.02)
    assert not grid.driven.any()
    assert not grid.downhill_sigma.any()


def test_the_gradient_is_in_no_doubt_where_the_force_of_motors_is_logged() -> None:
    grid = braked(0.25, -0.02)
    pulls = np.where(grid.clamping > 0.0, 0.0, -3e3)
    grid = replace(grid, motors=pulls, motor_sigma=np.full(pulls.shape, 300.0))
    assert grid.has_traction
    assert not grid.downhill_sigma.any()


def test_a_known_gradient_leaves_a_gain_to_the_motors() -> None:
    unknown = braked(0.25, -0.02)
    known = replace(unknown, gradient_sigma=unknown.gradient_sigma / 10.0)
    assert at(known, known.driven, 6.0)
    assert known.downhill_sigma == pytest.approx(unknown.downhill_sigma / 10.0)
