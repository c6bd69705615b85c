"""How often the rail's intervals hold the truth, over rails and errors drawn at random."""

import math

import numpy as np
import pytest

from adhesion_cli import rail, railfit
from adhesion_cli.model import Vehicle
from adhesion_cli.physics import G

LOAD = Vehicle().axle_mass.value * G
PATCH = rail.Contact().patch(LOAD)


def peak(condition: rail.Condition, speed: float) -> tuple[float, float]:
    grid = np.geomspace(1e-3, 0.5, 2000)
    mu = [rail.creep_force(s * speed, speed, condition, PATCH)[0] / LOAD for s in grid.tolist()]
    return float(grid[np.argmax(mu)]), max(mu)


def drawn(seed: int) -> tuple[rail.Condition, railfit.Points, float, float]:
    """A rail, points of slides on it as a log gives them, 1 sigma of radius and of μ's scale.

    Slip swings between a few parts in a thousand and a tenth, within 1.5 to 4 s. Speed and μ are
    noisy at 10 Hz and interpolated, as a receiver's and a smoother's are.
    """
    random = np.random.default_rng(seed)
    k_a, f0 = random.uniform(0.3, 1.0), math.exp(random.uniform(math.log(0.05), math.log(0.2)))
    condition = rail.Condition(
        k_a, k_a * random.uniform(0.25, 0.5), f0, random.uniform(0.3, 0.5),
        random.uniform(0.15, 0.6),
    )  # fmt: skip
    seconds = random.uniform(10.0, 40.0)
    t, own = np.arange(0.0, seconds, 0.02), np.arange(0.0, seconds + 0.1, 0.1)
    v = np.linspace(random.uniform(15.0, 30.0), random.uniform(3.0, 8.0), len(t))
    period = np.interp(t, own[::10], random.uniform(1.5, 4.0, len(own[::10])))
    swing = random.uniform(0.5, 1.2) * np.sin(np.cumsum(2.0 * math.pi * 0.02 / period))
    slip = np.clip(0.03 * np.exp(swing), 0.004, 0.3)
    mu = np.array(
        [
            rail.creep_force(s * u, u, condition, PATCH)[0] / LOAD
            for s, u in zip(slip, v, strict=True)
        ]
    )
    radius, scale = random.choice([5e-4, 2e-3, 1e-2]), random.choice([0.005, 0.1])
    speed_noise, clock = random.choice([0.005, 0.03]), 0.02 * 0.5 * mu * G / v
    noise = np.interp(t, own, speed_noise * random.standard_normal(len(own)))
    seen = 1.0 - (1.0 - slip) / (1.0 + radius * random.standard_normal())
    seen += noise / v + clock * random.standard_normal()
    measured = mu + 0.01 * mu.mean() * np.interp(t, own, random.standard_normal(len(own)))
    measured /= 1.0 + scale * random.standard_normal()
    sigma = math.sqrt(2.0 / 3.0) * speed_noise / v
    points = railfit.Points(t, v, seen, measured, sigma, clock, np.ones(len(t), dtype=np.bool_))
    return condition, points, radius, scale


@pytest.mark.parametrize("rails", [4, pytest.param(80, marks=pytest.mark.slow)])
def test_the_intervals_hold(rails: int) -> None:
    """95 % of them, less what 3 sigma of chance may take off."""
    held: dict[str, list[bool]] = {}
    for seed in range(rails):
        condition, points, radius, scale = drawn(seed)
        found = railfit.fit(points, Vehicle(), radius, scale)
        if found is None:  # noise leaves too little of a slow train's slides
            continue
        slip, mu = peak(condition, found.speed)
        true = {**condition._asdict(), "peak slip": slip, "peak mu": mu}
        told = {**found.told, "peak slip": found.peak_slip, "peak mu": found.peak_mu}
        for name, x in told.items():
            if x is not None:
                held.setdefault(name, []).append(x.low <= true[name] <= x.high)
        if found.below is not None:
            held.setdefault("below", []).append(slip < found.below)
    print({name: f"{sum(hits)} of {len(hits)}" for name, hits in sorted(held.items())})
    for name, hits in held.items():
        n = len(hits)
        assert sum(hits) >= 0.95 * n - 3.0 * math.sqrt(n * 0.95 * 0.05) - 0.5, name
    assert len(held["f0"]) > 0.8 * rails
