"""The estimator imm: its start, its uncertainty, and the noise that it learns."""

import math
from functools import cache

import numpy as np
import pytest
from helpers.brake_signals import REGISTRY, STEADY, W, rolling_brake, simulated

from adhesion_cli.core import compiled, methods
from adhesion_cli.core.model import Z95
from adhesion_cli.core.physics import G
from adhesion_cli.estimators import _noise
from adhesion_cli.records import brake_applications

IMM = REGISTRY["imm"]
P = methods.validate(IMM, {})
H = 0.01  # [s]
PULSE = 2.0 * math.pi / 100.0  # of a counter [rad]


def states(t, K, y, unit=1.0):
    """The state after each sample; times in `unit` [s]."""
    s = IMM.init(P, W, float(K[0]), float(y[0]))
    found = [s]
    for h, k, speed in zip(
        (np.diff(t) * unit).tolist(), K[1:].tolist(), y[1:].tolist(), strict=True
    ):
        s = IMM.step(P, W, s, h, k, speed)
        found.append(s)
    return found


def accuracy(t, K, y, F, start):
    """Rmse against F [N] from `start` [s] on, and the share of samples whose band holds F."""
    ns = np.round(t * 1e9).astype(np.int64)
    force, sigma, _ = compiled.batch(IMM, P, W, ns, K, y, np.array([0]))
    braked = t > start
    error = (force - F)[braked]
    return np.sqrt(np.mean(error**2)), np.mean(np.abs(error) < Z95 * sigma[braked])


def learned(readings):
    """What is known of the noise of these readings, one every `H`."""
    noise = _noise.initial_noise(0.02, readings[0])
    for y in readings[1:]:
        noise = _noise.learn(noise, y, H, -2.7 * H, P.memory, 1.0)
    return noise


@cache
def ramp():
    """30 s of a wheel that slows evenly [rad/s]."""
    return 90.0 - 2.7 * H * np.arange(3000)


@pytest.mark.parametrize("sigma", [1e-3, 0.01, 0.3])
def test_learns_the_variance_of_white_noise(sigma):
    noise = learned((ramp() + np.random.default_rng(1).normal(0.0, sigma, 3000)).tolist())
    assert math.sqrt(noise.variance) == pytest.approx(sigma, rel=0.1)
    assert _noise.rounding(noise) == 0.0
    assert not _noise.is_counter(noise)


def test_noise_that_neighbours_have_in_common_counts_more():
    """The means of white noise vary as little as its variance says; those of vibration do not."""
    rng, t = np.random.default_rng(3), H * np.arange(3000)
    white = learned((ramp() + rng.normal(0.0, 0.02, 3000)).tolist())
    assert _noise.slow_variance(white) < 1.3 * 0.02**2
    vibration = 0.02 * np.sin(2.0 * np.pi * 10.0 * t)
    shaking = learned((ramp() + vibration + rng.normal(0.0, 1e-3, 3000)).tolist())
    assert _noise.slow_variance(shaking) > 3.0 * shaking.variance
    assert _noise.slow_variance(learned((np.round(ramp() / 0.32) * 0.32).tolist())) < 0.32**2


def test_rounding_does_not_hide_vibration_of_readings_with_noise():
    random, step = np.random.default_rng(2), 0.05
    t = H * np.arange(len(ramp()))
    y = ramp() + 0.04 * np.sin(2.0 * np.pi * 9.0 * t) + random.normal(0.0, 0.6 * step, len(t))
    exact, rounded = (learned(x.tolist()) for x in (y, np.round(y / step) * step))
    assert _noise.slow_variance(exact) > 2.0 * exact.variance
    assert _noise.slow_variance(rounded) > 0.9 * _noise.slow_variance(exact)


def test_vibration_at_500_hz_is_no_slide():
    t = np.arange(0.0, 12.0, 0.002)
    K, y, F = rolling_brake(t)
    read = (
        y
        + 0.03 * np.sin(2.0 * np.pi * 9.0 * t)
        + np.random.default_rng(4).normal(0.0, 1e-3, len(t))
    )
    rmse, inside = accuracy(t, K, read, F, 6.0)
    assert rmse < 0.01 * F[-1]
    assert inside > 0.9


def test_learns_the_step_of_a_display():
    noise = learned((np.round(ramp() / 0.32) * 0.32).tolist())
    assert _noise.rounding(noise) == pytest.approx(0.32)
    assert not _noise.is_counter(noise)


def test_learns_the_tick_of_a_timer():
    """Its step is larger at higher speed."""
    y = ramp()
    read = PULSE / (np.round(PULSE / y / 5e-6) * 5e-6)
    for n in (1000, 2000):
        step = _noise.rounding(learned(read[:n].tolist()))
        assert step == pytest.approx(y[n - 1] ** 2 * 5e-6 / PULSE, rel=0.05)


def test_recognises_a_counter():
    total = np.floor(np.cumsum(ramp()) * H / PULSE)
    noise = learned((np.diff(total) * PULSE / H).tolist())
    assert _noise.is_counter(noise)
    assert _noise.rounding(noise) == pytest.approx(PULSE / H)


@pytest.mark.parametrize(("teeth", "speed"), [(80, 55.0), (100, 42.0)])
def test_periods_of_single_teeth_are_no_counter(teeth, speed):
    """A tooth that is wide makes the next one narrow, as a count does; fast logs see few pairs."""
    t, pitch = 0.002 * np.arange(3000), 2.0 * math.pi / teeth
    edge = pitch * 0.003 * np.random.default_rng(8).standard_normal(teeth)
    last = np.floor(speed * t / pitch).astype(int)
    width = pitch + edge[last % teeth] - edge[(last - 1) % teeth]
    noise = _noise.initial_noise(0.02, speed)
    for y in (speed * pitch / width).tolist():
        noise = _noise.learn(noise, y, 0.002, 0.0, P.memory, 1.0)
    assert noise.blocks.variance < 2.0 * noise.variance
    assert not _noise.is_counter(noise)


def test_a_first_step_of_the_reading_is_no_slide():
    """A timer with coarse ticks: all readings were the same so far."""
    t = np.arange(0.0, 12.0, H)
    K, y, F = rolling_brake(t)
    found = states(t, K, np.round(y / 0.46) * 0.46)
    first = int(np.argmax(np.round(y / 0.46) != np.round(y[0] / 0.46)))
    assert first > 100
    assert all(s.rolling.p > 0.8 for s in found[first : first + 50])
    assert np.abs([s.F for s in found] - F)[first : first + 50].max() < 0.02 * F[-1]


def test_rounding_at_10_khz_is_no_certainty():
    """A bound that holds for thousands of samples is one piece of information, not thousands."""
    t = np.arange(0.0, 6.0, 1e-4)
    K, y, F = rolling_brake(t)
    read = np.round(y / 0.3) * 0.3
    rmse, inside = accuracy(t, K, read, F, 3.0)
    assert rmse < 0.08 * F[-1]
    assert inside > 0.9


def test_a_wheel_that_stands_shows_no_noise():
    """Its zeros do not make the filter sure of what comes after."""
    noise = learned(ramp().tolist() + [0.0] * 500)
    moves = learned(ramp().tolist() + [0.0] * 20_000)
    assert moves.variance == noise.variance


def test_a_wheel_that_starts_again_shows_no_rounding():
    """A locked wheel repeats zero, and its next speed may be far from it."""
    locked = ramp().tolist() + [0.0] * 50
    again = learned([*locked, *(1.0 + 0.3 * np.arange(50)).tolist()])
    assert _noise.rounding(again) == 0.0
    assert again.variance < 1.5 * learned(locked).variance


def test_starts_in_mid_brake():
    """At the force of a rolling wheel, with an uncertainty that holds it."""
    t = np.arange(0.0, 10.0, H)
    K, y, F = rolling_brake(t)
    K, y, F = K[600:], y[600:], F[600:]
    found = states(t[600:], K, y + np.random.default_rng(2).normal(0.0, 0.01, len(y)))
    assert np.abs([s.F for s in found] - F).max() < 0.05 * F[0]
    sliding = y + np.where(t[600:] > 6.0, 0.5 * W.a * F[0] * (t[600:] - 6.0), 0.0)  # half as hard
    last = states(t[600:], K, sliding)[-1]
    assert abs(last.F - 1.5 * F[0]) < 2.0 * last.sigma + 1.0


@cache
def creeping(*slippery):
    """Time, K, ω, F at 100 Hz: a wheel with creep brakes with 21 kN from 2 s on.

    From each time in `slippery` the rail gives 0.05 m g for 2.5 s. After 1 s of it, K is zero.
    """
    fine, weight, found = 2e-4, W.mass * G, []
    v, omega = 30.0, 30.0 / W.radius
    for i in range(round(12.5 / fine)):
        t = i * fine
        K = 21e3 * min(max((t - 2.0) / 0.3, 0.0), 1.0)
        slides = any(0.0 < t - begin < 2.5 for begin in slippery)
        K *= not any(1.0 < t - begin < 2.5 for begin in slippery)
        F = min(22.0 * (v - omega * W.radius) / v, 0.05 if slides else 0.3) * weight
        if i % 50 == 0:
            found.append((t, K, omega, F))
        v -= fine * F / W.mass
        omega += fine * W.a * (F - W.phi * K)
    return np.array(found).T


def of_creeping(noise, *slippery):
    """Times, states and errors of F̂, with white noise of the speed [rad/s]."""
    t, K, omega, F = creeping(*slippery)
    found = states(t, K, omega + np.random.default_rng(3).normal(0.0, noise, len(t)))
    return t, found, np.array([s.F for s in found]) - F


def test_after_a_slide_the_wheel_rolls_as_fast_as_the_train():
    """Then its force is that of a rolling wheel, though a noisy speed hardly shows that."""
    t, found, error = of_creeping(0.3, 5.0)
    slides, rolls = (t > 5.3) & (t < 7.3), (t > 7.6) & (t < 9.0)
    assert np.mean([s.rolling.p < 0.5 for s, now in zip(found, slides, strict=True) if now]) > 0.9
    assert np.sqrt(np.mean(error[slides] ** 2)) < 0.1 * STEADY
    assert np.sqrt(np.mean(error[rolls] ** 2)) < 0.06 * STEADY


def test_the_force_of_a_rolling_wheel_follows_with_the_delay_of_creep():
    t, found, error = of_creeping(0.3)
    grows = (t > 2.0) & (t < 2.4)
    assert np.sqrt(np.mean(error[grows] ** 2)) < 0.03 * STEADY
    assert all(s.rolling.p > 0.7 for s in found[50:])


def test_after_a_slide_the_next_one_is_no_surprise():
    """Its band holds the force at once; a rail that never was slippery gives a narrow band."""
    t, found, error = of_creeping(0.3, 5.0, 9.0)
    again = (t > 9.0) & (t < 9.5)
    sigma = np.array([s.sigma for s in found])
    assert np.mean(np.abs(error[again]) < Z95 * sigma[again]) > 0.85
    before, after = np.median(sigma[(t > 4.0) & (t < 5.0)]), np.median(sigma[(t > 8.0) & (t < 9.0)])
    assert before < 0.5 * after
    assert after < 0.1 * STEADY


def test_compiled_it_has_the_same_uncertainty():
    t = np.cumsum(np.random.default_rng(5).uniform(0.001, 0.1, 300))
    K, y, _ = rolling_brake(t)
    y = np.round(y / 0.1) * 0.1
    ns = np.round(t * 1e9).astype(np.int64)
    F, sigma, _ = compiled.batch(IMM, P, W, ns, K, y, np.array([0]))
    found = states(ns, K, y, 1e-9)
    assert [s.F for s in found] == F.tolist()
    assert [s.sigma for s in found] == sigma.tolist()
    td = REGISTRY["td"]
    estimate = compiled.batch(td, td.Params(), W, ns, K, y, np.array([0]))
    assert (estimate.sigma, estimate.nis) == (None, None)


@pytest.mark.parametrize("name", ["service-brake", "low-adhesion", "four-axles"])
def test_its_band_holds_the_true_force(name):
    """Not the vehicle's tolerances: the simulated vehicle is the stated one."""
    for record in simulated(name, seed=4):
        found = states(record.t * 1e-9, record.clamping_force, record.wheel_speed)
        used = np.r_[brake_applications.find_applications(record)]
        error = np.array([s.F for s in found])[used] - record.truth[used]
        sigma = np.array([s.sigma for s in found])[used]
        assert np.mean(np.abs(error) < Z95 * sigma) > 0.90
        assert np.median(sigma) < 100.0


def test_the_parameters_of_the_regimes_are_probabilities():
    t = np.arange(0.0, 10.0, H)
    K, y, _ = rolling_brake(t)
    for s in states(t, K, y)[::50]:
        assert s.rolling.p + s.sliding.p + s.changing.p == pytest.approx(1.0, abs=1e-9)
        assert s.rolling.p > 0.8


@pytest.mark.parametrize(("kmh", "noise"), [(0.0, 0.01), (0.5, 0.01), (0.1, 0.1)])
def test_readings_are_as_it_predicts(kmh, noise):
    """Mean of the normalised innovations squared, for white noise and for steps of a display."""
    t = np.arange(0.0, 15.0, H)
    K, y, _ = rolling_brake(t)
    y = y + np.random.default_rng(1).normal(0.0, noise, len(y))
    if kmh:
        step = kmh / 3.6 / 0.43
        y = np.round(y / step) * step
    ns = np.round(t * 1e9).astype(np.int64)
    squares = compiled.batch(IMM, P, W, ns, K, y, np.array([0])).nis
    assert np.isnan(squares[0])
    assert 0.6 < np.nanmean(squares) < 1.1
    before = states(ns[:300], K[:300], y[:300], 1e-9)[:-1]
    plain = [
        IMM.nis(P, W, s, h * 1e-9, k, v)
        for s, h, k, v in zip(before, np.diff(ns[:300]), K[1:300], y[1:300], strict=True)
    ]
    assert squares[1:300] == pytest.approx(plain, rel=1e-6, nan_ok=True)


@pytest.mark.parametrize(("early", "least", "largest"), [(0.0, -7.0, -1.0), (0.04, 3.0, 7.0)])
def test_learns_in_a_slide_whether_the_pads_lag_the_pressure(early, least, largest):
    record = next(simulated("low-adhesion", seed=4))
    t = (record.t - record.t[0]) * 1e-9
    K = np.interp(t + early, t, record.clamping_force)
    odds = states(record.t, K, record.wheel_speed, 1e-9)[-1].surroundings.pads.odds
    assert least < odds < largest
