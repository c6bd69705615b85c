"""The normalised innovation squared: exact values, and an interval that holds."""

import math

import numpy as np
import pytest
from scipy.special import ndtr

from adhesion_cli.core import innovations


@pytest.mark.parametrize("z", [-30.0, -8.0, -1.5, -1e-6, 0.0, 0.3, 2.0, 12.0])
def test_a_score_has_the_probabilities_of_the_normal_distribution(z: float) -> None:
    assert innovations.score(ndtr(z), ndtr(-z)) == pytest.approx(z, abs=1e-9)


def test_an_impossible_reading_has_a_finite_score() -> None:
    assert 30.0 < innovations.score(1.0, 0.0) < 40.0
    assert innovations.square((1.0, 0.0), (1.0, 0.0)) > 900.0


@pytest.mark.parametrize("step", [0.01, 0.5, 3.0, 20.0])
def test_rounded_readings_have_a_mean_of_one(step: float) -> None:
    """Over all cells of a rounding grid, each as often as it occurs."""
    edges = np.arange(-40.0, 40.0, step) + 0.3 * step
    below, above = ndtr(edges), ndtr(-edges)
    cells = [
        (innovations.square((below[i], above[i]), (below[i + 1], above[i + 1])), share)
        for i, share in enumerate(np.where(edges[:-1] < 0.0, np.diff(below), -np.diff(above)))
    ]
    assert sum(x * share for x, share in cells) == pytest.approx(1.0, rel=0.01)


def test_a_narrow_reading_counts_as_its_value() -> None:
    a, b = 1.3, 1.3 + 1e-7
    found = innovations.square((float(ndtr(a)), float(ndtr(-a))), (float(ndtr(b)), float(ndtr(-b))))
    assert found == pytest.approx(1.3**2, rel=1e-5)


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_the_interval_holds_for_correlated_innovations(memory: float) -> None:
    random, inside = np.random.default_rng(1), 0
    for _ in range(300):
        z = random.normal(0.0, math.sqrt(1.0 - memory**2), 1500)
        for i in range(1, len(z)):
            z[i] += memory * z[i - 1]
        found = innovations.mean(z**2)
        assert found is not None
        inside += found.low <= found.mean <= found.high
    assert 0.91 <= inside / 300 <= 0.98


def test_samples_that_are_not_used_do_not_count() -> None:
    z2 = np.random.default_rng(1).chisquare(1.0, 500)
    gaps = np.full(1000, np.nan)
    gaps[::2] = z2
    assert innovations.mean(gaps) == innovations.mean(z2)
    assert innovations.mean(z2[:39]) is None
    assert innovations.mean(np.zeros(500)) is None
