"""The noise of measured speeds."""

import numpy as np
import pytest

from adhesion_cli.reference import noise_fit, smoother

RATE, COASTS, N = 500.0, 5.0, 10_000  # samples per second, time without brake [s], samples
WHITE = 0.3  # 1 sigma of the white noise


def run_with(error: np.ndarray) -> smoother.UnbrokenRun:
    """A wheel that coasts, then brakes, and the error of its speed."""
    t = np.arange(N) / RATE
    u = -5.0 * np.clip(t - COASTS, 0.0, 1.0)
    y = 60.0 + np.concatenate([[0.0], np.cumsum((u[1:] + u[:-1]) / 2.0 / RATE)]) + error
    zero = np.zeros(N)
    return smoother.UnbrokenRun(t, y, u, zero, zero, zero, zero)


@pytest.mark.parametrize("seed", range(10))
def test_white_noise_is_no_vibration(seed: int) -> None:
    error = WHITE * np.random.default_rng(seed).normal(size=N)
    assert noise_fit.common_noise(run_with(error), np.zeros(N)) == 0.0


@pytest.mark.parametrize("frequency", [6.0, 8.0, 14.0])
@pytest.mark.parametrize("seed", range(3))
def test_vibration_in_a_narrow_band_below_white_noise_counts(seed: int, frequency: float) -> None:
    """It is 0.6 of the white noise, but at its frequency several times as strong."""
    from scipy import signal  # slow to import

    rng = np.random.default_rng(seed)
    pole = 0.99 * np.exp(2j * np.pi * frequency / RATE)
    vibration = signal.lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.normal(size=N))
    vibration *= 0.6 * WHITE / np.std(vibration)
    error = WHITE * rng.normal(size=N) + vibration
    assert noise_fit.common_noise(run_with(error), np.zeros(N)) > WHITE**2


def test_a_slide_of_a_long_log_is_fitted_though_vibration_is_rougher() -> None:
    """Vibration grows with the speed: the fast start is rougher from sample to sample."""
    random = np.random.default_rng(1)
    t = np.arange(0.0, 80.0, 0.002)
    speed = 70.0 - 0.8 * t
    slide = (t > 65.3) & (t < 66.6)
    speed[slide] -= 2.0 * np.sin(np.pi * (t[slide] - 65.3) / 1.3) ** 2
    vibration = 0.003 * speed * np.sin(2.0 * np.pi * 9.0 * t)
    y = speed + vibration + random.normal(0.0, 2e-4 * speed)
    zero = np.zeros(len(t))
    blocks = noise_fit.take_samples([smoother.UnbrokenRun(t, y, zero, zero, zero, zero, zero)])
    assert sum(len(b.t) for b in blocks) < len(t)
    assert any(b.t[0] < 65.5 < 66.5 < b.t[-1] for b in blocks)
