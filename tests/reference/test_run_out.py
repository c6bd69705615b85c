"""Tone rings that are not centred, and motors: what (1) and a speed's noise do not explain."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.analysis import analyze
from adhesion_cli.analysis import settings as settings_module
from adhesion_cli.core import physics, signals
from adhesion_cli.core.model import AxleRecord, Floats
from adhesion_cli.reference import run_out


def braked(rate: float, seed: int, seconds: float = 25.0) -> tuple[Floats, Floats, Floats]:
    """Time, a wheel speed with noise that slides for a second, and the true angle."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    slope = np.where((t > 8.0) & (t < 8.4), -30.0, np.where((t > 8.4) & (t < 9.0), 18.0, -1.5))
    y = 60.0 + np.concatenate([[0.0], np.cumsum(slope[:-1] / rate)])
    angle = np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2.0 / rate)])
    return t, y + random.normal(0.0, 3e-3, len(t)), angle


@settings(max_examples=25)
@given(
    st.floats(2e-4, 3e-3), st.floats(0.0, 6.2), st.sampled_from([20.0, 50.0, 100.0, 250.0]),
    st.floats(0.985, 1.015),
)  # fmt: skip
def test_run_out_is_found_and_taken_out(
    share: float, phase: float, rate: float, radius: float
) -> None:
    """Whatever its phase, through a slide, and with a radius that is not the logger's."""
    t, y, angle = braked(rate, 1)
    added = share * y * np.sin(angle + phase)
    part, found = run_out.find_run_out(t, radius * (y + added))
    assert found == pytest.approx(share, rel=0.15)
    assert np.std(part / radius - added) < 0.3 * np.std(added)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0, 100.0])
@pytest.mark.parametrize("step", [0.0, 0.066, 0.66])
def test_noise_brakes_slides_and_rounding_are_no_run_out(
    seed: int, rate: float, step: float
) -> None:
    t, y, _ = braked(rate, seed)
    part, share = run_out.find_run_out(t, np.round(y / step) * step if step else y)
    assert share == 0.0
    assert not part.any()


def test_the_reference_is_cleaned_and_the_estimators_are_not(tmp_path: Path) -> None:
    log = simulated.recordings("service-brake", rate=100.0, noise=1e-5)
    true = simulated.simulation("service-brake")
    angle = np.cumsum(true.wheel_speed[:, 0]) * float(true.t[1]) * 1e-9

    def worse(r: simulated.Recording) -> simulated.Recording:
        turned = np.interp(r.t, true.t, angle)
        return replace(r, value=r.value * (1.0 + 1e-3 * np.sin(turned)), decimals=5)

    results = []
    for bad in (False, True):
        changed = simulated.changed(log, "wheel_speed", worse) if bad else log
        path = simulated.write(tmp_path / f"{bad}.csv", changed)
        results.append(analyze.analyze(path, settings_module.load(), algos=["kalman"]))
    good, bad = ((r, r.axles[0]) for r in results)
    (told,) = [f for f in bad[0].findings if f.code == "wheel-runout"]
    assert told.severity == "info"
    assert told.values["share"] == pytest.approx(1e-3, rel=0.1)
    assert "wheel-runout" not in {f.code for f in good[0].findings}
    rms = [
        float(np.sqrt(np.nanmean((axle.reference.force - axle.record.truth) ** 2)))
        for _, axle in (good, bad)
    ]
    assert rms[1] < 1.5 * rms[0]
    assert bad[1].scores[0].rmse_n > 1.5 * good[1].scores[0].rmse_n


def coasting(acceleration: float, v: float = 5.0, K: float = 0.0) -> AxleRecord:
    t = np.arange(0.0, 20.0, 0.05)
    rim = v + acceleration * np.clip(t - 5.0, 0.0, 8.0)
    held = np.full(len(t), K)
    return AxleRecord(
        1, (t * 1e9).astype(np.int64), held, held, rim / 0.42, (slice(0, len(t)),)
    )  # fmt: skip


def test_a_driven_wheel_is_one_that_gains_speed_without_brake() -> None:
    t = coasting(0.7).t * 1e-9
    driven = signals.driven(coasting(0.7), 0.42)
    assert driven[(t > 5.2) & (t < 12.8)].all()
    assert not driven[(t < 3.5) | (t > 14.5)].any()
    for other in (coasting(0.3), coasting(-0.7, 12.0), coasting(8.0), coasting(0.7, K=500.0)):
        assert not signals.driven(other, 0.42).any()
    recovering = replace(coasting(0.7), train_speed=np.full(len(t), 20.0))
    assert not signals.driven(recovering, 0.42).any()


def test_a_residual_pressure_is_no_brake_of_a_driven_wheel() -> None:
    record = coasting(0.7)
    t = record.t * 1e-9
    for residual in (200.0, 800.0):  # below the share of a brake, and a sensor's offset
        K = np.where(t > 16.0, 20e3, residual)
        braked_later = replace(record, clamping_force=K, clamping_force_smooth=K)
        driven = signals.driven(braked_later, 0.42)
        assert driven[(t > 5.2) & (t < 12.8)].all()
        assert not driven[(t < 3.5) | (t > 14.5)].any()


def test_a_train_that_gains_speed_shortly_is_driven_and_a_wheel_after_a_slide_is_not() -> None:
    record = coasting(0.0)
    t = record.t * 1e-9
    gain = np.clip(t - 5.0, 0.0, 1.5)
    short = replace(record, wheel_speed=(20.0 + gain) / 0.42, train_speed=20.0 + gain)
    driven = signals.driven(short, 0.42)
    assert driven[(t > 5.2) & (t < 6.3)].all()
    assert not driven[(t < 3.0) | (t > 8.5)].any()
    made_from_wheels = replace(short, train_speed_made=True)
    assert not signals.driven(made_from_wheels, 0.42).any()
    assert not signals.driven(replace(short, train_speed=np.full(len(t), 20.0)), 0.42).any()


def test_a_driven_wheel_has_no_reference(tmp_path: Path) -> None:
    t = np.arange(0.0, 40.0, 0.02)
    K = np.where((t > 22.0) & (t < 32.0), 8000.0, 0.0)
    pressure = np.where(K > 0.0, (K / 1.94 + 1450.0) / (np.pi * 0.1295**2 / 4.0), 0.0) / 1e5
    w = physics.wheelset(settings_module.load().vehicle, 1)
    rate = np.where((t > 3.0) & (t < 18.0), 0.7 / 0.42, -physics.rolling_deceleration(w) * K)
    y = 20.0 + np.concatenate([[0.0], np.cumsum(rate[:-1] * 0.02)])
    y += np.random.default_rng(1).normal(0.0, 3e-3, len(t))
    rows = (f"{a:.3f},{b:.5f},{c:.5f}" for a, b, c in zip(t, pressure, y, strict=True))
    path = tmp_path / "driven.csv"
    path.write_text("\n".join(["time [s],bc_pressure [bar],wheel_speed [rad/s]", *rows]))
    result = analyze.analyze(path, settings_module.load(), algos=["td"])
    (told,) = [f for f in result.findings if f.code == "traction"]
    assert (told.severity, told.channel) == ("info", "axle 1")
    assert told.first_s == pytest.approx(3.0, abs=1.1)
    assert "no-reference" not in {f.code for f in result.findings}
    force = result.axles[0].reference.force
    assert np.isnan(force[(t > 3.5) & (t < 17.5)]).all()
    assert np.isfinite(force[(t > 22.0) & (t < 32.0)]).all()
    assert told.count == int(np.isnan(force).sum())
