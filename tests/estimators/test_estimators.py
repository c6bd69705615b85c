"""What every estimator must hold, found by the registry; nothing is skipped by name."""

import ast
import dataclasses
import inspect
import itertools
import math
import sys
from functools import cache

import numpy as np
import pytest
from helpers.brake_signals import REGISTRY, STEADY, W, online, rolling_brake, simulated
from helpers.grids import thinned
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from adhesion_cli import estimators
from adhesion_cli.core import compiled, estimator, methods
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Wheelset
from adhesion_cli.core.physics import clamping_force
from adhesion_cli.estimators.td import fhan
from adhesion_cli.records import brake_applications
from adhesion_cli.scores import metrics
from adhesion_cli.wsp import scenario, simulate

PAPERS = "gradient", "kalman", "leso", "neso", "td"

every = pytest.mark.parametrize("name", REGISTRY)


def ns(t):
    return np.round(np.asarray(t) * 1e9).astype(np.int64)


def run(name, t, K, y, starts=(0,), **overrides):
    est = REGISTRY[name]
    p = methods.validate(est, overrides)
    return compiled.batch(est, p, W, ns(t), K, y, np.array(starts))[0]


def sample_by_sample(name, t, K, y, **overrides):
    est = REGISTRY[name]
    p = methods.validate(est, overrides)
    samples = zip(ns(t).tolist(), K.tolist(), y.tolist(), strict=True)
    return np.array(list(online(est, p, samples)))


def slide(t):
    """K = 21 kN held, adhesion lost and found: the wheel's acceleration dips, then swings up."""

    def bell(centre):
        x = (t - centre) / 0.15
        return np.exp(-(x**2)), 0.15 * math.sqrt(math.pi) / 2.0 * np.vectorize(math.erf)(x)

    (dip, dip_area), (rise, rise_area) = bell(2.0), bell(2.6)
    y = 40.0 - 2.7 * t - 6.0 * dip_area + 5.0 * rise_area
    K = np.full_like(t, 21e3)
    return K, y, W.phi * K + (-2.7 - 6.0 * dip + 5.0 * rise) / W.a


def jittery(n, seed):
    """n rising times [s], intervals from 0.1 ms to 0.3 s."""
    rng = np.random.default_rng(seed)
    return np.cumsum(np.exp(rng.uniform(math.log(1e-4), math.log(0.3), n)))


# what a file says


@every
def test_documented(name):
    est = REGISTRY[name]
    module = inspect.getmodule(est.step)
    for thing in (module, est.Params, est.State, est.init, est.step):
        assert len(inspect.getdoc(thing) or "") > 10
    assert est.title
    assert "Wu M., Peng S., Li X." in est.source or "doi" in est.source
    assert est.claims
    for _, quantity, default in methods.parameters(est):
        assert quantity.unit
        assert quantity.text
        assert quantity.minimum <= default <= quantity.maximum
        assert math.isfinite(quantity.maximum)


@every
def test_plain_python(name):
    tree = ast.parse(inspect.getsource(inspect.getmodule(REGISTRY[name].step)))
    imported = {n.names[0].name for n in ast.walk(tree) if isinstance(n, ast.Import)}
    imported |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) if not n.level}
    assert imported <= {"math", "typing"}


# one step, two ways of running it


@every
def test_online_equals_batch(name):
    t = jittery(400, seed=1)
    K, y, _ = slide(t)
    y = y + np.random.default_rng(2).normal(0.0, 3e-3, len(t))
    np.testing.assert_array_equal(run(name, t, K, y), sample_by_sample(name, t, K, y))


@every
def test_causal_and_deterministic(name):
    t = jittery(300, seed=3)
    K, y, _ = slide(t)
    F = run(name, t, K, y)
    for cut in (1, 17, 150, 299):
        K2, y2 = K.copy(), y.copy()
        K2[cut:], y2[cut:] = 0.0, -1e3
        np.testing.assert_array_equal(run(name, t, K2, y2)[:cut], F[:cut])
        np.testing.assert_array_equal(run(name, t[:cut], K[:cut], y[:cut]), F[:cut])


@every
def test_nothing_crosses_a_segment(name):
    t = jittery(300, seed=4)
    K, y, _ = slide(t)
    whole = run(name, t, K, y, starts=(0, 100, 101, 230))
    for first, last in ((0, 100), (100, 101), (101, 230), (230, 300)):
        alone = run(name, t[first:last], K[first:last], y[first:last])
        np.testing.assert_array_equal(whole[first:last], alone)


# the physics


@every
@pytest.mark.parametrize("mean", [-4e3, 0.0])
def test_a_motor_that_drives_or_whose_force_is_noise_leaves_an_estimate(name, mean):
    """K has the force of motors, which is below zero where they drive."""
    t, rng = np.arange(0.0, 20.0, 0.01), np.random.default_rng(1)
    K = np.where(t < 12.0, mean + rng.normal(0.0, 100.0, len(t)), 8e3)
    rate = -W.a * (1.0 - W.rolling) * W.phi * K
    y = 20.0 + 0.01 * np.cumsum(rate) + rng.normal(0.0, 0.01, len(t))
    force = run(name, t, K, y)
    assert np.isfinite(force).all()
    assert np.median(force[-300:]) == pytest.approx(W.rolling * W.phi * 8e3, rel=0.05)


@every
@pytest.mark.parametrize("h", [1e-4, 1e-3, 1e-2, 0.1, 1.0])
def test_finds_the_steady_force(name, h):
    t = np.arange(0.0, 17.0 + h / 2.0, h)
    K, y, F = rolling_brake(t)
    assert F[-1] == pytest.approx(5378.4, abs=0.1)
    assert run(name, t, K, y)[-1] == pytest.approx(F[-1], abs=0.1)


@pytest.mark.parametrize(
    ("name", "signals", "h"),
    thinned(7, REGISTRY, [rolling_brake, slide], [1e-3, 1e-2, 0.1, 1.0, "irregular"]),
)
def test_rate_does_not_matter(name, signals, h):
    """A log at `h` gives what the same log at 10 kHz gives at the same instants.

    To within the sampling's own limit: between two samples the log holds the mean force and no
    more, and the force itself may be as far from that as it changes in the interval.
    """
    fine = np.arange(0.0, 8.00005, 1e-4)
    K, y, F = signals(fine)
    if h == "irregular":
        at = np.unique(np.round(jittery(500, seed=5) / 1e-4).astype(int))
        at = np.concatenate([[0], at[at < len(fine)]])
    else:
        at = np.arange(0, len(fine), round(h / 1e-4))
    first = np.concatenate([[0], at[:-1]])
    change = [np.ptp(F[i : j + 1]) for i, j in zip(first, at, strict=True)]
    limit = max(change) + 0.1
    coarse = run(name, fine[at], K[at], y[at])
    assert np.abs(coarse - run(name, fine, K, y)[at]).max() <= limit


@cache
def braked(interval):
    """Clamping force, wheel speed and true force of a simulated brake, no noise, logged so often.

    Interval [s]; 0: irregular, down to 0.1 ms.
    """
    loaded = scenario.load("service-brake")
    sensors = tuple(
        dataclasses.replace(x, rate=1e4, noise_variance=0.0, resolution=0.0) for x in loaded.sensor
    )
    simulation = simulate.run(dataclasses.replace(loaded, sensor=sensors, dt=1e-4))
    log = {r.signal: r for r in simulate.log(simulation)}
    n = len(log["wheel_speed"].t)
    at = np.arange(0, n, round(interval / 1e-4)) if interval else irregular(n)
    K = clamping_force(log["pressure"].value * 1e5, simulation.scenario.vehicle)
    y = log["wheel_speed"].value / 3.6 / simulation.scenario.vehicle.radius(1).value
    return at, K, y, log["truth"].value


def irregular(n):
    at = np.cumsum(np.random.default_rng(9).integers(1, 1000, n // 400))
    return np.concatenate([[0], at[at < n]])


@cache
def at_10_khz(name):
    _, K, y, _ = braked(0.0)
    return run(name, np.arange(len(y)) * 1e-4, K, y)


@pytest.mark.parametrize(("name", "interval"), thinned(5, REGISTRY, [1e-3, 1e-2, 0.1, 0.0]))
def test_rate_of_the_log_of_a_simulated_brake_does_not_matter(name, interval):
    """10 kHz against 1 kHz, 100 Hz, 10 Hz and irregular, whole train, cylinder and creep."""
    at, K, y, F = braked(interval)
    t = np.arange(len(y)) * 1e-4
    change = [np.ptp(F[i : j + 1]) for i, j in itertools.pairwise(at)]
    coarse, fine = run(name, t[at], K[at], y[at]), at_10_khz(name)[at]
    assert np.abs(coarse - fine).max() <= max(change) + 0.1
    assert np.sqrt(np.mean((coarse - fine) ** 2)) <= max(change) / 8.0 + 0.1


def printed_fhan(x1, x2, r, h0):
    """As Han prints it, with sign functions for the cases."""
    sign = np.sign
    d, a0 = r * h0**2, h0 * x2
    y = x1 + a0
    a1 = math.sqrt(d * (d + 8.0 * abs(y)))
    a2 = a0 + sign(y) * (a1 - d) / 2.0
    s_y = (sign(y + d) - sign(y - d)) / 2.0
    a = (a0 + y - a2) * s_y + a2
    s_a = (sign(a + d) - sign(a - d)) / 2.0
    return -r * (a / d - sign(a)) * s_a - r * sign(a)


@given(
    x1=st.floats(-1e3, 1e3), x2=st.floats(-1e3, 1e3), r=st.floats(1.0, 1e3), h0=st.floats(1e-3, 1.0)
)
def test_fhan_is_as_printed(x1, x2, r, h0):
    assert fhan(x1, x2, r, h0) == pytest.approx(printed_fhan(x1, x2, r, h0), abs=1e-6 * r)


def right_side(name, p):
    """The differential equations of physics.md, as they stand, for K = 21 kN and y(t)."""
    kappa = W.a * W.phi * 21e3

    def fal(x, alpha, delta):
        big = math.copysign(abs(x) ** alpha, x)
        return x / delta ** (1.0 - alpha) if abs(x) <= delta else big

    def leso(y, omega, d):
        e = omega - y
        return d - kappa - p.beta1 * e, -p.beta2 * e

    def neso(y, omega, d):
        e = omega - y
        f1, f2 = fal(e, p.alpha1, p.delta), fal(e, p.alpha2, p.delta)
        return d - kappa - p.beta1 * f1, -p.beta2 * f2

    def gradient(y, z, y_f, d):
        e = z + y_f - y
        return d - kappa - p.lam * z, p.lam * (y - y_f), -p.p * e

    def td(y, x1, x2):
        return x2, printed_fhan(x1 - y, x2, p.r, p.h0)

    return {"leso": leso, "neso": neso, "gradient": gradient, "td": td}[name]


@pytest.mark.parametrize("name", ["leso", "neso", "gradient", "td"])
@pytest.mark.parametrize("h", [1e-3, 0.05])
def test_step_solves_the_equations(name, h):
    """Against an integrator that knows nothing of exact steps, on a line from sample to sample."""
    t = np.arange(0.0, 1.5 + h / 2.0, h)
    y = 40.0 - 2.7 * t - 0.5 * np.sin(9.0 * t)
    f = right_side(name, methods.validate(REGISTRY[name], {}))
    start = {"gradient": [0.0, y[0], 0.0]}.get(name, [y[0], 0.0])
    solution = solve_ivp(
        lambda at, x: f(np.interp(at, t, y), *x),
        (0.0, t[-1]), start, "LSODA", t, rtol=1e-9, atol=1e-11, max_step=min(h, 1e-2),
    )  # fmt: skip
    F = run(name, t, np.full_like(t, 21e3), y)
    known = W.phi * 21e3 if name == "td" else 0.0
    np.testing.assert_allclose(F, known + solution.y[-1] / W.a, rtol=0.0, atol=5.0)


@pytest.mark.parametrize("delta", [1e-6, 0.02, 0.05, 10.0])
def test_neso_takes_the_gains_of_the_middle(delta):
    """Whether within the linear zone or not: two matrix exponentials, of half a step and a step."""
    est = REGISTRY["neso"]
    p = methods.validate(est, {"alpha1": 0.7, "delta": delta})
    a = W.a * W.phi

    def exact(b1, b2, e, d, K, rates, h):
        rate_K, rate_y = rates
        A = np.array(
            [[-b1, 1, -a * K - rate_y, -a * rate_K], [-b2, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0]]
        )
        return (expm(A * h) @ [e, d, 1.0, 0.0])[:2]

    def gains(e):
        zone = max(abs(e), delta)
        return p.beta1 * zone ** (p.alpha1 - 1.0), p.beta2 * zone ** (p.alpha2 - 1.0)

    for h in (1e-4, 1e-2):
        for start in (0.01, -0.03, 0.2):
            s = est.init(p, W, 9e3, 30.0)._replace(e=start, d=7.0)
            b1, b2 = gains(0.0)
            n = math.ceil(h * (b1 + math.sqrt(b2)))
            rates, e, d = (2e3 / h, -0.03 / h), start, 7.0
            for i in range(n):
                K = 9e3 + 2e3 * i / n
                middle, _ = exact(*gains(e), e, d, K, rates, 0.5 * h / n)
                e, d = exact(*gains(middle), e, d, K, rates, h / n)
            found = est.step(p, W, s, h, 11e3, 29.97)
            assert found.e == pytest.approx(e, rel=1e-8, abs=1e-10)
            assert pytest.approx(d / W.a, rel=1e-8) == found.F


# the paper


def constant(h, duration=8.0, noise=0, halved_at=math.inf):
    """Section 3.2: K = 21 kN from the first sample, rolling; noise of variance 1e-5 by seed."""
    t = np.arange(round(duration / h) + 1) * h
    F = np.where(t > halved_at, 0.5, 1.0) * STEADY
    y = 20 / 0.42 + np.cumsum(h * W.a * (F - W.phi * 21e3))
    if noise:
        y = y + np.random.default_rng(noise).normal(0.0, math.sqrt(1e-5), len(t))
    return t, np.full_like(t, 21e3), y


@pytest.mark.parametrize(
    ("name", "response", "overrides"),
    [
        ("leso", 2.98, {}),
        ("leso", 2.98, {"euler": 1.0}),
        ("neso", 0.48, {}),
        ("neso", 0.48, {"euler": 1.0}),
        ("gradient", 0.83, {}),
        ("gradient", 0.83, {"euler": 1.0}),
    ],
)
@pytest.mark.parametrize("h", [1e-3, 2e-3, 5e-3])
def test_response_time_of_table_2(name, response, overrides, h):
    t, K, y = constant(h)
    F = run(name, t, K, y, **overrides)
    assert t[np.argmax(F >= 0.95 * STEADY)] == pytest.approx(response, abs=0.012)


def test_td_response_is_its_start_from_zero():
    t, K, y = constant(1e-3)

    def settled(**overrides):
        off = np.abs(run("td", t, K, y, **overrides) - STEADY) > 0.05 * STEADY
        return t[np.flatnonzero(off)[-1] + 1]

    printed = {"h0": 0.0, "euler": 1.0}
    assert settled(**printed, from_zero=1.0) == pytest.approx(1.69, abs=0.01)
    assert settled(**printed) < 0.07


@pytest.mark.parametrize(
    ("name", "largest", "overrides"),
    [
        ("neso", 10.0, {"euler": 1.0}),
        ("td", 96.0, {"h0": 0.0, "euler": 1.0}),
        ("gradient", 0.3, {}),
    ],
)
def test_largest_error_at_1_khz(name, largest, overrides):
    """The noise is a variance of each sample: then the errors are those of Table 2 in size."""
    errors = []
    for seed in range(1, 11):
        t, K, y = constant(1e-3, noise=seed)
        errors.append(np.abs(run(name, t, K, y, **overrides) - STEADY)[t > 6.0].max())
    assert np.mean(errors) == pytest.approx(largest, rel=0.15)


def printed(name, h, K, y):
    """The printed recursions, sample by sample at equal steps, with the state scaled to d = aF."""
    kappa = W.a * W.phi * K
    F = [W.phi * K[0] if name == "td" else 0.0]
    omega, d, P, z, y_f = y[0], 0.0, 10.0, 0.0, y[0]
    for k in range(len(y) - 1):
        e = omega - y[k]
        if name == "td":
            omega, d = omega + h * d, d + h * printed_fhan(e, d, 100.0, h)  # (4)
        elif name == "kalman":
            predicted = omega - h * (kappa[k] - W.a * F[-1])  # (7)
            gain = P / (P + 1e-5 * 1e-3 / h)
            updated = predicted + gain * (y[k + 1] - predicted)
            P = (1.0 - gain) * P
            weight = (1.0 - 0.95) / (1.0 - 0.95 ** (k + 1))
            eps1 = updated - omega + h * kappa[k]
            omega, d = updated, W.a * ((1.0 - weight) * F[-1] + weight * eps1 / (h * W.a))
        elif name == "leso":
            omega, d = omega + h * (d - kappa[k] - 216.0 * e), d - h * 216.0 * e  # (9)
        elif name == "neso":
            fal = e / 0.02**0.5 if abs(e) <= 0.02 else math.copysign(abs(e) ** 0.5, e)  # (10)
            omega, d = omega + h * (d - kappa[k] - 216.0 * e), d - h * 216.0 * fal  # (9)
        else:
            e = z + y_f - y[k]  # (13)
            z, y_f = z + h * (d - kappa[k] - 4.0 * z), y_f + h * 4.0 * (y[k] - y_f)  # (12)
            d = d - h * 10.0 * e  # (14)
        F.append(W.phi * K[k + 1] + d / W.a if name == "td" else d / W.a)  # (5)
    return F


@pytest.mark.parametrize("name", PAPERS)
def test_euler_is_the_printed_recursion(name):
    t = np.arange(2000) * 1e-3
    K, y, _ = slide(t)
    K, y = K * (1.0 + 0.1 * np.sin(t)), y + np.random.default_rng(8).normal(0.0, 3e-3, len(t))
    as_printed = {"td": {"h0": 0.0}, "kalman": {"q": 0.0}}.get(name, {})
    F = run(name, t, K, y, euler=1.0, **as_printed)
    np.testing.assert_allclose(F, printed(name, 1e-3, K, y), rtol=1e-6, atol=1e-3)


def test_printed_kalman_goes_blind():
    t, K, y = constant(1e-3, halved_at=4.0)
    blind = run("kalman", t, K, y, q=0.0, euler=1.0)
    assert abs(blind[-1] - 0.5 * STEADY) > 500.0  # 4 s after adhesion halved
    assert run("kalman", t, K, y)[-1] == pytest.approx(0.5 * STEADY, abs=1.0)


# what it claims


@cache
def measured(name, seeds=(1, 2, 3)):
    """By estimator: rmse [N] and lag [s] over the brake applications, mean over seeds and axles."""
    found = {algo: [] for algo in REGISTRY}
    for seed in seeds:
        for record in simulated(name, seed):
            for algo, est in REGISTRY.items():
                F = compiled.batch(
                    est, est.Params(), W, record.t, record.clamping_force, record.wheel_speed,
                    np.array([0]),
                )[0]  # fmt: skip
                c = metrics.compare(
                    record, F, record.truth, brake_applications.find_applications(record)
                )
                found[algo].append((metrics.measure(c)["rmse_n"], metrics.measure(c)["lag_s"]))
    return {algo: np.mean(pairs, axis=0) for algo, pairs in found.items()}


@pytest.mark.parametrize(("name", "on"), [(n, on) for n, e in REGISTRY.items() for on in e.claims])
def test_holds_its_claims(name, on):
    """A claim that has gone slack fails as well."""
    claim = REGISTRY[name].claims[on]
    rmse, lag = measured(on)[name]
    assert 0.9 * claim.rmse <= rmse <= claim.rmse
    assert claim.lag - 0.02 <= lag <= claim.lag


# whatever comes


finite = st.floats(-1e9, 1e9, allow_nan=False)


@every
@given(
    samples=st.lists(
        st.tuples(st.integers(1, 2 * 10**17), finite, finite), min_size=1, max_size=40
    ),
    data=st.data(),
)
@settings(max_examples=60)
def test_finite_for_any_finite_input(name, samples, data):
    est = REGISTRY[name]
    overrides = {
        key: data.draw(st.floats(q.minimum, q.maximum), label=key)
        for key, q, _ in methods.parameters(est)
        if key != "euler"
    }
    t, K, y = (np.array(column) for column in zip(*samples, strict=True))
    p = methods.validate(est, overrides)
    for parameters in (est.Params(), p):
        F = compiled.batch(est, parameters, W, np.cumsum(t), abs(K), y, np.array([0]))[0]
        assert np.isfinite(F).all()


@every
@pytest.mark.parametrize("h", [1e-4, 1e-3, 1e-2, 0.1, 1.0])
def test_does_not_diverge(name, h):
    """Bounded noise in, bounded force out, at every rate."""
    rng = np.random.default_rng(6)
    n = 3000
    F = run(name, h * np.arange(n), rng.uniform(0.0, 21e3, n), rng.uniform(0.0, 0.01, n))
    assert np.abs(F).max() <= 2.0 * (0.01 / h / W.a + W.phi * 21e3)


def test_euler_refuses_a_step_at_which_it_is_unstable():
    for name, longest in (("leso", 9.3e-3), ("neso", 9.58e-3), ("gradient", 0.4), ("td", 0.06)):
        for h, refused in ((0.98 * longest, False), (1.02 * longest, True)):
            t = h * np.arange(3000)
            K, y = np.full_like(t, 21e3), 40.0 - 2.7 * t
            for way in (run, sample_by_sample):
                if refused:
                    with pytest.raises(UserError, match="unstable"):
                        way(name, t, K, y, euler=1.0)
                else:
                    assert np.abs(way(name, t, K, y, euler=1.0)).max() < 5e4


def test_a_gap_between_segments_is_no_step():
    t = np.concatenate([np.arange(5) * 1e-3, 100.0 + np.arange(5) * 1e-3])
    K, y, _ = rolling_brake(t)
    assert np.isfinite(run("leso", t, K, y, starts=(0, 5), euler=1.0)).all()


# the registry

SIXTH = '''
"""Differentiation over the last interval."""

from typing import Annotated, NamedTuple

from adhesion_cli.core.estimator import About, Claim
from adhesion_cli.core.model import Quantity, Wheelset

from helper import slope


class Params(NamedTuple):
    """None but a factor."""

    gain: Annotated[float, Quantity("-", "factor on the result", 0.0, 2.0)] = 1.0


class State(NamedTuple):
    """The sample before."""

    y: float
    F: float


def init(p, w, K, y):
    """F = 0."""
    return State(y, 0.0)


def step(p, w, s, h, K, y):
    """One sample on."""
    return State(y, p.gain * (w.phi * K + slope(s.y, y, h) / w.a))


ABOUT = About("Difference", "nobody", {"rolling-brake": Claim(1.0, 0.0)})
'''


@pytest.fixture
def sixth(tmp_path, monkeypatch):
    """Gives the registry with one more file."""
    monkeypatch.setattr(estimators, "__path__", [*estimators.__path__, str(tmp_path)])

    def add(text=SIXTH):
        slope = "def slope(a, b, h):\n    return (b - a) / h"
        text = text.replace("from helper import slope", slope)
        (tmp_path / "difference.py").write_text(text, encoding="utf-8")
        return estimator.registry()

    yield add
    sys.modules.pop("adhesion_cli.estimators.difference", None)


def test_a_sixth_estimator_is_one_file(sixth):
    registry = sixth()
    est = registry["difference"]
    assert list(registry) == sorted([*REGISTRY, "difference"])
    t = jittery(300, seed=7)
    K, y, _ = slide(t)
    p = methods.validate(est, {"gain": 0.5})
    F = compiled.batch(est, p, W, ns(t), K, y, np.array([0, 100]))[0]
    expected = 0.5 * (W.phi * K[1:] + np.diff(y) / (np.diff(ns(t)) * 1e-9) / W.a)
    expected[99] = 0.0
    np.testing.assert_allclose(F, np.concatenate([[0.0], expected]), rtol=1e-12)
    samples = zip(ns(t)[:100].tolist(), K.tolist(), y.tolist(), strict=False)
    np.testing.assert_array_equal(list(online(est, p, samples)), F[:100])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("def step", "def stop"), "lacks step"),
        (("    F: float", "    G: float"), "State must end with F"),
        (('Annotated[float, Quantity("-", "factor on the result", 0.0, 2.0)]', "float"), "gain"),
        ((" = 1.0\n", "\n"), "gain"),
    ],
)
def test_a_broken_file_is_named(sixth, change, says):
    with pytest.raises(UserError, match=says) as caught:
        sixth(SIXTH.replace(*change))
    assert "difference.py" in caught.value.text
    assert caught.value.hint


def test_parameters_are_checked():
    est = REGISTRY["neso"]
    assert methods.validate(est, {"beta1": 100}).beta1 == 100.0
    assert methods.validate(est, {}) == est.Params()
    with pytest.raises(UserError, match="beta3") as caught:
        methods.validate(est, {"beta3": 1.0})
    assert "beta1" in caught.value.hint or "beta2" in caught.value.hint
    for value in (-1.0, 1e99, math.nan):
        with pytest.raises(UserError, match="out of range"):
            methods.validate(est, {"delta": value})


def test_wheelset_fields_are_floats():
    assert Wheelset(*map(float, W)) == W
