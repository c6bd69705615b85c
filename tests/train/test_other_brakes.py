"""A brake without a channel that ends while the pressure stays: what is one, and what is not."""

from dataclasses import replace

import numpy as np
import pytest

from adhesion_cli.core.model import Floats
from adhesion_cli.train.grid import Grid
from adhesion_cli.train.other_brakes import find_brake_steps

STEP = 0.25
T = np.arange(0.0, 60.0, STEP)


def grid(deceleration: Floats, pressure: Floats | None = None, noise: float = 0.01) -> Grid:
    """Four axles that roll and slow like that from 60 m/s on, braked from 10 s on."""
    rng = np.random.default_rng(1)
    v = np.maximum(60.0 - np.cumsum(deceleration) * STEP, 0.0)
    p = np.where(T > 10.0, 3e5, 0.0) if pressure is None else pressure
    rim = np.maximum(v + rng.normal(0.0, noise, (4, len(T))), 0.0)
    return Grid(0, STEP, rim, np.tile(p * 0.1, (4, 1)), np.tile(p, (4, 1)), None)


BRAKE = np.where(T > 10.0, 0.8, 0.01)


@pytest.mark.parametrize(("more", "acts"), [(0.5, (10.25, 40.0)), (-0.5, (40.0, 59.75))])
def test_a_sudden_change_at_the_same_pressure_is_another_brake(
    more: float, acts: tuple[float, float]
) -> None:
    """It acts before the change where the train then slows less, and after it where more."""
    before = np.where((T > 10.0) & (T < 40.0), max(more, 0.0), 0.0)
    after = np.where(T >= 40.0, max(-more, 0.0), 0.0)
    (finding,) = find_brake_steps(grid(BRAKE + before + after), 0)
    assert finding.code == "other-brake"
    verb = "falls" if more > 0.0 else "rises"
    assert f"{verb} by 0.5 m/s² within 0.8 s" in finding.names["reason"]
    assert finding.spans[0] == pytest.approx(acts, abs=0.5)


STRONG_BRAKE = np.where(T > 10.0, 1.2, 0.01)  # to 6 m/s in 55 s


def test_a_retarder_that_fades_out_at_low_speed_has_acted_before() -> None:
    retarder = np.interp(T, [53.0, 56.0], [0.4, 0.0]) * (T > 10.0)
    (finding,) = find_brake_steps(grid(STRONG_BRAKE - 0.4 + retarder), 0)
    assert "falls by 0.4 m/s² within 4 s" in finding.names["reason"]
    assert finding.spans[0] == pytest.approx((10.25, 54.5), abs=0.75)


@pytest.mark.parametrize(
    "less",
    [
        np.interp(T, [52.0, 56.0], [0.0, 0.25]),  # a gradient of 2.5 % under a train
        np.interp(T, [20.0, 60.0], [0.0, 0.5]),  # pads that get hot
        -np.interp(T, [52.0, 56.0], [0.0, 0.5]),  # cast iron
    ],
    ids=["gradient", "hot pads", "cast iron"],
)
def test_no_other_brake_fades_where_friction_or_the_line_does_it(less: Floats) -> None:
    assert not find_brake_steps(grid(STRONG_BRAKE - less), 0)


def test_a_brake_that_drops_after_a_gap_has_acted_before_it() -> None:
    whole = grid(BRAKE + np.where((T > 10.0) & (T < 40.0), 0.5, 0.0))
    is_gap = (T > 18.0) & (T < 21.0)
    rim, clamping, pressure = (
        np.where(is_gap, np.nan, x) for x in (whole.rim, whole.clamping, whole.pressure)
    )
    (finding,) = find_brake_steps(replace(whole, rim=rim, clamping=clamping, pressure=pressure), 0)
    assert finding.spans == find_brake_steps(whole, 0)[0].spans


@pytest.mark.parametrize(
    "deceleration",
    [
        BRAKE,
        BRAKE - np.interp(T, [38.0, 42.0], [0.0, 0.25]),  # a gradient of 2.5 % under a train
        np.where(T > 10.0, 0.5 + 0.5 / (1.0 + np.maximum(50.0 - T, 0.0) / 5.0), 0.01),  # cast iron
    ],
    ids=["constant", "gradient", "cast iron"],
)
def test_a_gradient_and_the_friction_of_cast_iron_are_none(deceleration: Floats) -> None:
    assert not find_brake_steps(grid(deceleration), 0)


def test_a_change_of_the_pressure_or_noise_shows_none() -> None:
    less = BRAKE - np.where(T > 40.0, 0.3, 0.0)
    assert not find_brake_steps(grid(less, np.where(T > 10.0, 3e5, 0.0) * (less / BRAKE)), 0)
    assert find_brake_steps(grid(less), 0)
    assert not find_brake_steps(grid(less, noise=0.5), 0)
