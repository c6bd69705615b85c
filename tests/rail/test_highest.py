"""The highest mean force of a brake application, and its band."""

from dataclasses import replace

import numpy as np
import pytest

from adhesion_cli.core.model import Floats, Parameter, Reference, Vehicle
from adhesion_cli.rail.highest import highest_mean
from adhesion_cli.reference.budget import coefficient_u95

RATE = 100.0  # [Hz]


def reference(force: Floats, sigma: Floats, tolerance: float = 0.0) -> Reference:
    return Reference("made", "", force, sigma, np.full(len(force), tolerance))


def highest(r: Reference, peak_time: float = 0.1) -> tuple[float, float]:
    n = np.arange(len(r.force))
    return highest_mean((n * 1e9 / RATE).astype(np.int64), r, [n], peak_time)[:2]


@pytest.mark.parametrize(("peak_time", "mean"), [(0.1, 2000.0), (0.2, 2000.0), (0.4, 1500.0)])
def test_the_highest_force_is_a_mean_over_the_stated_time(peak_time, mean) -> None:
    force = np.full(1000, 1000.0)
    force[500:521] = 2000.0  # 0.2 s
    value, half = highest(reference(force, np.full(1000, 1e-3)), peak_time)
    assert value == pytest.approx(mean, rel=0.03)
    assert half < 0.1


def test_the_band_holds_the_highest_of_many_means_that_are_uncertain() -> None:
    """The true means lie about the estimates, each on its own: the highest is far above them."""
    value, half = highest(reference(np.full(300, 5000.0), np.full(300, 100.0)))
    true = 5000.0 + 100.0 * np.random.default_rng(3).standard_normal((1000, 30))
    inside = np.abs(value - true.max(axis=1)) < half
    assert 0.95 < np.mean(inside) < 0.99
    assert half > 1.5 * 196.0


def test_a_peak_that_is_hardly_known_widens_the_band_only() -> None:
    force, sigma = np.full(1000, 5000.0), np.full(1000, 50.0)
    calm, narrow = highest(reference(force, sigma))
    force[500:520], sigma[500:520] = 5400.0, 2000.0
    value, half = highest(reference(force, sigma))
    assert value == pytest.approx(calm)
    assert half > 10.0 * narrow
    assert value + half > 9000.0


def test_a_speed_that_is_known_before_and_after_a_peak_narrows_the_band() -> None:
    force, sigma = np.full(1000, 5000.0), np.full(1000, 50.0)
    force[500:530], sigma[500:530] = 9000.0, 2000.0
    flat = reference(force, sigma)
    known = replace(flat, impulse=np.full(1000, 10.0), clamping=np.full(1000, 20.0))
    value, half = highest(known)
    assert value == pytest.approx(9000.0)
    assert half < 400.0 < highest(flat)[1]


def test_samples_that_are_far_apart_are_taken_as_they_are() -> None:
    force = np.array([1000.0, 1000.0, 3000.0, 1000.0, 1000.0])
    t = np.arange(5) * 100_000_000
    r = replace(reference(force, np.full(5, 1.0)), impulse=np.zeros(5), clamping=np.zeros(5))
    value, half, _ = highest_mean(t, r, [np.arange(5)], 0.1)
    assert value == 3000.0
    assert half == pytest.approx(1.96, rel=0.01)


def test_tolerances_count_in_full() -> None:
    value, half = highest(reference(np.full(100, 5000.0), np.full(100, 1e-3), 100.0))
    assert (value, half) == (pytest.approx(5000.0), pytest.approx(196.0, rel=1e-3))


def test_a_force_that_is_less_known_at_another_time_may_be_the_highest_there() -> None:
    """As where only slow stops have shown the friction, and it may rise with the speed."""
    force, tolerance = np.full(100, 5000.0), np.where(np.arange(100) < 50, 1000.0, 100.0)
    r = replace(reference(force, np.full(100, 1e-3)), tolerance=tolerance)
    value, half = highest(r)
    assert value == pytest.approx(5000.0)
    assert half == pytest.approx(1960.0, rel=1e-3)


def test_the_covariance_with_the_mass_is_that_of_the_highest_window() -> None:
    """Not that of the mean force: their difference once made the interval of the highest µ zero."""
    force = np.where(np.arange(100) < 50, 4000.0, 6000.0)  # a motor has a part of the first half
    share = 0.4  # of the mass, 1 sigma
    brake = np.where(np.arange(100) < 50, 1000.0, 6000.0)  # the part that is found by the mass
    r = reference(force, np.full(100, 1e-3))
    r = replace(r, tolerance=share * brake, mass=share**2 * brake)
    value, u95, mass = highest_mean(
        (np.arange(100) * 1e7).astype(np.int64), r, [np.arange(100)], 0.1
    )
    assert mass == pytest.approx(share**2 * 6000.0)
    vehicle = Vehicle(axle_mass=Parameter(10e3, share * 10e3))
    assert coefficient_u95(u95, value, vehicle, mass) < 1.0  # µ does not depend on the mass
