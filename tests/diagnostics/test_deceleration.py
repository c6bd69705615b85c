"""Pressures whose zero or scale changes in mid-log, judged by how the train slows."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.grids import thinned

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Floats
from adhesion_cli.core.physics import (
    G,
    braked,
    clamping_force,
    cylinder_pressure,
    force_line,
    wheelset,
)
from adhesion_cli.wsp.simulate import Recording

DEFAULT = settings.load()
BRAKES = (6.0, 0.5), (31.0, 0.8), (56.0, 0.6), (81.0, 0.9)  # when [s], how hard [m/s²]
SECONDS = 110.0
Wrong = Callable[[Floats, Floats], Floats]


def recordings(
    rate: float,
    seed: int,
    wrong: Wrong,
    *,
    train: bool,
    pads: float = 0.15,
    percent: float = 2.0,
    motor: float = 0.0,
) -> simulated.Recordings:
    """Two axles that roll through four brakes of 14 s.

    Args:
        rate: of all channels [Hz].
        seed: of gradient, pads and noise.
        wrong: what both pressures [Pa] are taken for, over time [s].
        train: whether its speed is logged.
        pads: by this share their friction varies with speed and from brake to brake.
        percent: up to which the gradient goes, anew every 8 s.
        motor: by how much it drives the train until shortly before each brake [m/s²].
    """
    random, fine = np.random.default_rng(seed), np.arange(0.0, SECONDS, 0.01)
    w, line = wheelset(DEFAULT.vehicle, 1), force_line(DEFAULT.vehicle)
    p, friction, driven = np.zeros(len(fine)), np.ones(len(fine)), np.zeros(len(fine))
    for begin, hard in BRAKES:
        up = np.clip((fine - begin) / random.uniform(0.5, 3.0), 0.0, 1.0)
        p += (
            cylinder_pressure(line, hard / braked(1.0, w))
            * up
            * np.clip((begin + 14.0 - fine) / 1.5, 0.0, 1.0)
        )
        within = (fine > begin) & (fine < begin + 16.0)
        bent = random.uniform(-1.0, 1.0) + random.uniform(-1.0, 1.0) * (fine - begin - 7.0) / 7.0
        friction[within] += pads / 2.0 * bent[within]
        past = begin - random.uniform(0.2, 3.0)
        driven += motor * np.clip((past - fine) / 0.5, 0.0, 1.0) * (fine > begin - 6.0)
    corners = np.arange(0.0, SECONDS + 8.0, 8.0)
    slope = np.interp(fine, corners, random.uniform(-percent, percent, len(corners)))
    slows = friction * braked(clamping_force(p, DEFAULT.vehicle), w) - driven
    slows += w.rolling * G * slope / 100.0
    v = 60.0 - np.cumsum(slows) * 0.01
    t = np.arange(0.0, SECONDS - 0.02, 1.0 / rate)
    ns = np.round(t * 1e9).astype(np.int64)

    def channel(name: str, signal: str, axle: int | None, unit: str, x: Floats) -> Recording:
        return Recording(name, signal, axle, unit, ns, x, 4)  # type: ignore[arg-type]

    def noisy(x: Floats, sigma: float) -> Floats:
        y: Floats = np.interp(t, fine, x) + random.normal(0.0, sigma, len(t))
        return y

    log = [channel("train_speed", "train_speed", None, "m/s", noisy(v, 0.02))] * train
    for axle in (1, 2):
        bar = np.maximum(wrong(t, np.interp(t, fine, p)), 0.0) / 1e5
        bar += random.normal(0.0, 0.005, len(t))
        log += [
            channel(f"wheel_speed_{axle}", "wheel_speed", axle, "rad/s", noisy(v / w.radius, 0.01)),
            channel(f"bc_pressure_{axle}", "pressure", axle, "bar", bar),
        ]
    return log


def told(log: simulated.Recordings, folder: Path) -> list[Finding]:
    return [f for f in simulated.told(log, folder, DEFAULT) if f.severity == "warning"]


def sound(_: Floats, p: Floats) -> Floats:
    return p


FORCE = {"deceleration-unexplained", "vehicle-suspect", "deceleration-unit-suspect"}
# What goes wrong, and between which times it is told.
FAULTS: dict[str, tuple[Wrong, float, float]] = {
    "scale that drifts": (lambda t, p: p * (1.0 - 0.55 * t / SECONDS), 55.0, SECONDS),
}


@pytest.mark.parametrize("train", [False, True])
@pytest.mark.parametrize("rate", [2.0, 20.0])
@pytest.mark.parametrize("fault", FAULTS)
def test_pressures_that_change_in_mid_log_are_found_where_they_do(
    fault: str, rate: float, train: bool, tmp_path: Path
) -> None:
    wrong, begin, end = FAULTS[fault]
    log = recordings(rate, 0, wrong, train=train, pads=0.1, percent=1.0)
    found = [f for f in told(log, tmp_path) if f.code in FORCE]
    assert found
    for f in found:
        if f.code == "deceleration-unexplained":
            assert f.spans[-1][1] > begin
            assert f.spans[0][0] < end


@pytest.mark.parametrize(
    ("seed", "rate", "train"), thinned(5, range(3), [2.0, 20.0], [False, True])
)
def test_pads_and_gradients_are_no_other_sensor(
    seed: int, rate: float, train: bool, tmp_path: Path
) -> None:
    assert told(recordings(rate, seed, sound, train=train), tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1.0, 5.0, 50.0])
def test_pads_and_gradients_never_are(rate: float, tmp_path: Path) -> None:
    """At most 1 of 50 sound logs: the docs say 2 %."""
    logs = (recordings(rate, seed, sound, train=bool(seed % 2)) for seed in range(100, 150))
    accused = [found for log in logs if (found := told(log, tmp_path))]
    assert len(accused) <= 1, accused


@pytest.mark.parametrize("motor", [0.2, 0.6])
def test_a_motor_that_is_cut_off_before_the_brake_is_no_other_sensor(
    motor: float, tmp_path: Path
) -> None:
    for seed in range(2):
        log = recordings(20.0, seed, sound, train=bool(seed % 2), percent=1.0, motor=motor)
        assert told(log, tmp_path) == []


def test_rollers_that_hold_the_speed_are_no_warning(tmp_path: Path) -> None:
    log = simulated.write(tmp_path / "log.csv", simulated.recordings("roller-rig"))
    severity_by_code = {f.code: f.severity for f in analyze(log, DEFAULT, ["td"]).findings}
    assert severity_by_code["brake-holds-speed"] == "info"
    assert "deceleration-unexplained" not in severity_by_code
