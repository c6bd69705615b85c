"""Many parameter sets in one pass: each as if it was alone."""

import math

import numpy as np
import pytest

from adhesion_cli.core import compiled, estimator, lane_math, lanes
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset

SPLIT = [name for name, est in estimator.registry().items() if est.split]
W = wheelset(Vehicle(), 1)


@pytest.mark.parametrize("name", SPLIT)
def test_each_set_is_as_alone(name):
    """Uneven and even intervals, sub-steps of different numbers, two segments, lanes left over."""
    est = estimator.registry()[name]
    rng = np.random.default_rng(5)
    h = np.where(np.arange(400) < 200, 20_000_000, rng.integers(100_000, 60_000_000, 400))
    t, starts = np.cumsum(h), np.array([0, 150])
    K = 21e3 * np.minimum(t * 1e-9, 1.0) + rng.normal(0.0, 50.0, 400)
    y = 40.0 - 0.4 * t * 1e-9 + rng.normal(0.0, 3e-2, 400)
    judged = rng.random(400) < 0.7
    target = np.where(judged, 0.27 * K, np.nan)
    rows = 10.0 ** rng.uniform(-0.5, 0.0, (40, len(est.Params._fields)))
    sets = [est.Params(*(row * np.array(est.Params()))) for row in rows]
    columns = t, K, y, starts
    alone = [np.sum((compiled.batch(est, p, W, *columns)[0] - target)[judged] ** 2) for p in sets]
    found = lanes.squares(est, sets, W, *columns, target, judged)
    np.testing.assert_allclose(found, alone, rtol=1e-9)


def test_functions_without_branches_are_those_of_math():
    rng = np.random.default_rng(6)
    for x in rng.uniform(-700.0, 700.0, 2000):
        assert lane_math.exp(x) == pytest.approx(math.exp(x), rel=1e-12)
    for x in (*-(10.0 ** rng.uniform(-300.0, 2.0, 2000)), 0.0, *rng.uniform(-1.0, 1.0, 100)):
        assert lane_math.expm1(x) == pytest.approx(math.expm1(x), rel=1e-12, abs=0.0)
    for x in rng.uniform(-1e6, 1e6, 2000):
        assert lane_math.sin(x) == pytest.approx(math.sin(x), abs=1e-12)
        assert lane_math.cos(x) == pytest.approx(math.cos(x), abs=1e-12)
    for x, a in zip(10.0 ** rng.uniform(-12.0, 12.0, 2000), rng.uniform(-9, 9, 2000), strict=True):
        assert lane_math.power(x, a) == pytest.approx(math.pow(x, a), rel=1e-12)


def test_what_is_no_number_stays_none():
    """An estimate that diverges must not look like a good one."""
    for f in (lane_math.exp, lane_math.expm1, lane_math.sin, lane_math.cos):
        assert math.isnan(f(math.nan))
    assert math.isnan(lane_math.power(2.0, math.nan))
    assert lane_math.exp(-math.inf) < 1e-300
    assert lane_math.exp(math.inf) > 1e300
