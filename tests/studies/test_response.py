"""Frequency responses against transfer functions worked out by hand, and what the command shows."""

import functools
import json
import math
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import in_process

from adhesion_cli.core import estimator
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset
from adhesion_cli.studies import response

W = wheelset(Vehicle(), 1)
REGISTRY = estimator.registry()
FEW = (0.1, 1.0, 10.0)


def observer(b1: float, b2: float, f: float) -> complex:
    s = 2j * math.pi * f
    return b2 / (s * s + b1 * s + b2)


@pytest.mark.parametrize(("name", "gains"), [("leso", (216.0, 216.0)), ("gradient", (4.0, 10.0))])
def test_linear_observers_have_their_transfer_function(
    name: str, gains: tuple[float, float]
) -> None:
    est = REGISTRY[name]
    (found,) = response.responses(est, est.Params(), W, FEW)
    assert found.amplitude_n is None
    for f, gain, delay, noise in zip(FEW, found.gain, found.delay_s, found.noise_gain, strict=True):
        exact = observer(*gains, f)
        assert gain == pytest.approx(abs(exact), rel=5e-3)
        turns = 2.0 * math.pi * f * delay
        assert math.remainder(turns + np.angle(exact), 2.0 * math.pi) == pytest.approx(
            0.0, abs=0.02
        )
        assert noise == pytest.approx(abs(exact) * 2.0 * math.pi * f / W.a, rel=5e-3)


@pytest.mark.parametrize("name", ["neso", "td"])
def test_nonlinear_ones_depend_on_the_amplitude(name: str) -> None:
    est = REGISTRY[name]
    found = response.responses(est, est.Params(), W, FEW)
    assert tuple(r.amplitude_n for r in found) == response.AMPLITUDES
    assert found[0].gain[1] > 1.04 * found[-1].gain[1]
    small = (216.0, 216.0 / 0.02**0.5)  # fal is linear near 0
    if name == "neso":
        exact = [abs(observer(*small, f)) for f in FEW]
        assert found[0].gain == pytest.approx(exact, rel=5e-3)


def test_harmonic_is_exact_beside_a_slope() -> None:
    t = np.arange(2000) * 1e-3
    x = 3.0 - 0.7 * t + 2.0 * np.sin(2.0 * math.pi * t) - 0.5 * np.cos(2.0 * math.pi * t)
    assert response.harmonic(t, x, 1.0) == pytest.approx(2.0 - 0.5j)


def test_command_shows_the_settings_stated(tmp_path: Path) -> None:
    run = functools.partial(in_process, tmp_path, "estimators", "--response")

    done = run("-a", "leso", "--set", "leso.beta2=2160", "--json")
    assert done.returncode == 0, done.stderr
    (found,) = json.loads(done.stdout)["responses"]
    exact = [abs(observer(216.0, 2160.0, f)) for f in found["frequency_hz"]]
    assert found["gain"] == pytest.approx(exact, rel=0.02)
    assert found["amplitude_n"] is None
    assert "Gain of the force by frequency [Hz]:" in run("-a", "leso").stdout
