"""How often the rail's intervals hold the truth, over rails and errors drawn at random."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from adhesion_cli.core.model import Floats, Vehicle
from adhesion_cli.core.physics import G
from adhesion_cli.rail import creep_law, fit

LOAD = Vehicle().axle_mass.value * G
PATCH = creep_law.Contact().patch(LOAD)


def peak(condition: creep_law.Condition, speed: float) -> tuple[float, float]:
    grid = np.geomspace(1e-3, 0.5, 2000)
    mu = [
        creep_law.creep_force(s * speed, speed, condition, PATCH)[0] / LOAD for s in grid.tolist()
    ]
    return float(grid[np.argmax(mu)]), max(mu)


def drawn(seed: int) -> tuple[creep_law.Condition, fit.Points, float, float]:
    """A rail whose curve is (3), and what `logged` makes of it."""
    random = np.random.default_rng(seed)
    k_a, f0 = random.uniform(0.3, 1.0), math.exp(random.uniform(math.log(0.05), math.log(0.2)))
    condition = creep_law.Condition(
        k_a, k_a * random.uniform(0.25, 0.5), f0, random.uniform(0.3, 0.5),
        random.uniform(0.15, 0.6),
    )  # fmt: skip

    def mu(slip: Floats, speed: Floats) -> Floats:
        both = zip(slip, speed, strict=True)
        return np.array(
            [creep_law.creep_force(s * v, v, condition, PATCH)[0] / LOAD for s, v in both]
        )

    return condition, *logged(random, mu)


def logged(
    random: np.random.Generator, law: Callable[[Floats, Floats], Floats]
) -> tuple[fit.Points, float, float]:
    """Points of slides on a rail as a log gives them, 1 sigma of radius and of μ's scale.

    Slip swings between a few parts in a thousand and a tenth, within 1.5 to 4 s. Speed and μ are
    noisy at 10 Hz and interpolated, as a receiver's and a smoother's are.
    """
    seconds = random.uniform(10.0, 40.0)
    t, own = np.arange(0.0, seconds, 0.02), np.arange(0.0, seconds + 0.1, 0.1)
    v = np.linspace(random.uniform(15.0, 30.0), random.uniform(3.0, 8.0), len(t))
    period = np.interp(t, own[::10], random.uniform(1.5, 4.0, len(own[::10])))
    swing = random.uniform(0.5, 1.2) * np.sin(np.cumsum(2.0 * math.pi * 0.02 / period))
    slip = np.clip(0.03 * np.exp(swing), 0.004, 0.3)
    mu = law(slip, v)
    radius, scale = random.choice([5e-4, 2e-3, 1e-2]), random.choice([0.005, 0.1])
    speed_noise, clock = random.choice([0.005, 0.03]), 0.02 * 0.5 * mu * G / v
    noise = np.interp(t, own, speed_noise * random.standard_normal(len(own)))
    seen = 1.0 - (1.0 - slip) / (1.0 + radius * random.standard_normal())
    seen += noise / v + clock * random.standard_normal()
    measured = mu + 0.01 * mu.mean() * np.interp(t, own, random.standard_normal(len(own)))
    measured /= 1.0 + scale * random.standard_normal()
    sigma = math.sqrt(2.0 / 3.0) * speed_noise / v
    points = fit.Points(t, v, seen, measured, sigma, 0.0 * t, clock, 0.0 * t[:, None], t >= 0.0)
    return points, radius, scale


def likely(hits: list[bool]) -> bool:
    """95 % of them, less what 3 sigma of chance may take off."""
    n = len(hits)
    return sum(hits) >= 0.95 * n - 3.0 * math.sqrt(n * 0.95 * 0.05) - 0.5


@pytest.mark.parametrize(
    ("rails", "draws"), [(4, 60), pytest.param(80, fit.DRAWS, marks=pytest.mark.slow)]
)
def test_the_intervals_hold(rails: int, draws: int) -> None:
    held: dict[str, list[bool]] = {}
    for seed in range(rails):
        condition, points, radius, scale = drawn(seed)
        found = fit.fit(points, Vehicle(), radius, scale, draws)
        if found is None:  # noise leaves too little of a slow train's slides
            continue
        slip, mu = peak(condition, found.speed)
        true = {**condition._asdict(), "peak slip": slip, "peak mu": mu}
        told = {**found.constants, "peak slip": found.peak_slip, "peak mu": found.peak_mu}
        for name, x in told.items():
            if x is not None:
                held.setdefault(name, []).append(x.lower <= true[name] <= x.upper)
        if found.peak_slip_limit is not None:
            held.setdefault("below", []).append(slip < found.peak_slip_limit)
    print({name: f"{sum(hits)} of {len(hits)}" for name, hits in sorted(held.items())})
    for name, hits in held.items():
        assert likely(hits), name
    assert len(held["f0"]) > 0.8 * rails


@pytest.mark.parametrize("rails", [4, pytest.param(40, marks=pytest.mark.slow)])
@pytest.mark.parametrize("seconds", [0.6, 2.0, 5.0])
def test_the_draws_of_short_slides_hold(seconds: float, rails: int) -> None:
    """The largest μ, and μ at small and large slip, of some stretch of a log."""
    held: list[bool] = []
    widths = []
    for seed in range(rails):
        condition, points, radius, scale = drawn(seed)
        n = round(seconds / 0.02)
        first = int(np.random.default_rng(seed).integers(0, len(points.t) - n))
        some = fit.Points._make(x[first : first + n] for x in points)
        found = fit.fit(some, Vehicle(), radius, scale, 60)
        if found is None:
            assert fit.clear_time(some) < fit.SHORTEST_FIT
            continue
        slips = np.geomspace(1e-3, 0.5, 60)
        true, *draws = (
            fit.curve(x, found.speed, slips, Vehicle()) for x in (condition, *found.draws)
        )
        low, high = np.percentile([x.max() for x in draws], (2.5, 97.5))
        held.append(low <= true.max() <= high)
        widths.append(high / low)
        for i in np.searchsorted(slips, (0.02, 0.3)):
            low, high = np.percentile([x[i] for x in draws], (2.5, 97.5))
            held.append(low <= true[i] <= high)
    assert likely(held)
    assert len(held) > 2 * rails
    assert np.median(widths) > 1.1  # wider than the noise: the slides are short


@pytest.mark.parametrize(("seed", "step", "at"), [(0, 0.8, 0.3), (3, 1.25, 0.7)])
def test_two_rails_have_no_curve(seed: int, step: float, at: float) -> None:
    """A curve that goes with the speed too would pass between them."""
    _, points, radius, scale = drawn(seed)
    mu = np.where(points.t > at * points.t[-1], step, 1.0) * points.mu
    assert fit.fit(points, Vehicle(), radius, scale, 10) is not None
    assert fit.fit(points._replace(mu=mu), Vehicle(), radius, scale, 10) is None


def test_a_rail_that_is_nowhere_quite_the_same_has_one() -> None:
    _, points, radius, scale = drawn(1)
    mu = points.mu * (1.0 + 0.03 * np.sin(0.7 * points.t))
    assert fit.fit(points._replace(mu=mu), Vehicle(), radius, scale, 10) is not None


def magic(random: np.random.Generator) -> Callable[[Floats], Floats]:
    """Pacejka's magic formula, flat to sharp."""
    C, E = random.uniform(1.15, 1.9), random.uniform(-2.0, 0.8)
    return lambda s: np.sin(C * np.arctan(s - E * (s - np.arctan(s))))


def burckhardt(random: np.random.Generator) -> Callable[[Floats], Floats]:
    falls = math.exp(-random.uniform(2.5, 5.0))
    return lambda s: np.maximum(1.0 - np.exp(-s) - falls * s, 0.3 * (1.0 - np.exp(-s)))


def kiencke(random: np.random.Generator) -> Callable[[Floats], Floats]:
    c = random.uniform(-1.0, 3.0)
    return lambda s: s / (1.0 + c * s + s * s)


@pytest.mark.parametrize("law", [magic, burckhardt, kiencke])
@pytest.mark.parametrize(
    ("rails", "draws"), [(1, 60), pytest.param(40, fit.DRAWS, marks=pytest.mark.slow)]
)
def test_the_peak_holds_on_rails_of_other_laws(
    rails: int, draws: int, law: Callable[[np.random.Generator], Callable[[Floats], Floats]]
) -> None:
    """None is (3), and μ may fall with the train's speed too, which (3) does not know."""
    slips, heights = [], []
    grid = np.geomspace(1e-3, 1e3, 20001)
    for seed in range(rails):
        random = np.random.default_rng(seed)
        shape = law(random)
        top, most = grid[np.argmax(shape(grid))], shape(grid).max()
        at = math.exp(random.uniform(math.log(0.005), math.log(0.12)))
        height = math.exp(random.uniform(math.log(0.04), math.log(0.2))) / most
        deep, fast = random.choice([0.0, 0.3]), random.choice([0.0, 0.01])

        def mu(
            s: Floats, v: Floats, shape=shape, stretch=top / at, height=height, deep=deep, fast=fast
        ) -> Floats:
            return height * shape(stretch * s) * np.exp(-(deep * s + fast) * v)

        points, radius, scale = logged(random, mu)
        found = fit.fit(points, Vehicle(), radius, scale, draws)
        if found is None or fit.clear_time(points) < fit.SHORTEST:  # too short for an interval
            continue
        s = np.geomspace(1e-3, 0.5, 4000)
        curve = mu(s, found.speed)
        slip, tall = s[np.argmax(curve)], curve.max()
        if found.peak_slip is not None:
            slips.append(found.peak_slip.lower <= slip <= found.peak_slip.upper)
        if found.peak_slip_limit is not None:
            slips.append(slip < found.peak_slip_limit)
        if found.peak_mu is not None:
            heights.append(found.peak_mu.lower <= tall <= found.peak_mu.upper)
    print(f"slip {sum(slips)} of {len(slips)}, μ {sum(heights)} of {len(heights)}")
    assert slips
    assert likely(slips)
    assert likely(heights)


def straight(seed: int, doubt: float) -> tuple[fit.Points, float, Vehicle]:
    """Points of a curve that falls by a straight line beyond its peak, their utilisation.

    A brake force that is wrong lifts the points of much slip: there the pressure is high.
    """
    random = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, 0.02)
    slip = 0.075 + 0.06 * np.sin(2.0 * math.pi * t / 1.3)
    share = 1.0 - 0.15 * (slip - 0.015) / 0.2
    profile = doubt * (slip - 0.075) / 0.06
    mu = 0.05 * share + profile + 1e-4 * random.standard_normal(len(t))
    zero = 0.0 * t
    columns = zero + 1e-4, zero, zero, profile[:, None], t >= 0.0
    return fit.Points(t, zero + 20.0, slip, mu, *columns), float(share.mean()), Vehicle()


def test_the_utilisation_of_another_curve_lies_in_its_interval() -> None:
    points, share, vehicle = straight(1, 0.0)
    certain = fit.fit(points, vehicle, 1e-4, 0.02, 40)
    assert certain is not None
    assert certain.utilisation is not None
    assert certain.utilisation.lower < share < certain.utilisation.upper


def test_the_utilisation_holds_an_error_of_the_brake_force() -> None:
    points, share, vehicle = straight(2, 7e-4)
    rail = fit.fit(points, vehicle, 1e-4, 0.02, 40)
    assert rail is not None
    assert rail.utilisation is not None
    assert rail.utilisation.lower < share < rail.utilisation.upper


def test_the_end_of_a_slide_on_a_better_rail_is_not_used_adhesion() -> None:
    points, share, vehicle = straight(3, 0.0)
    mu, swing = points.mu.copy(), points.swing.copy()
    mu[-15:], swing[-15:] = 0.25, 0.05  # the smoother does not know the step
    rail = fit.fit(points._replace(mu=mu, swing=swing), vehicle, 1e-4, 0.02, 40)
    assert rail is not None
    assert rail.utilisation is not None
    assert rail.utilisation.value == pytest.approx(share, abs=0.01)


def test_slides_that_do_not_show_the_peak_show_no_utilisation() -> None:
    """A rail that grips as slides begin looks like a peak below their slip, however high."""
    points, _, vehicle = straight(4, 0.0)
    grip = 0.02 * np.exp(-(points.slip - 0.015) / 0.008)
    rail = fit.fit(points._replace(mu=points.mu + grip), vehicle, 1e-4, 0.02, 40)
    assert rail is not None
    assert rail.peak_slip_limit is not None
    assert (rail.peak_slip, rail.peak_mu, rail.utilisation) == (None, None, None)
