"""The samples of a long log to which noise levels are fitted."""

import numpy as np

from adhesion_cli.reference import noise_fit, smoother


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
