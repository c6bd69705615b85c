"""A wheel whose speed drifts from the train speed."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import APART, DEFAULT, DIAMETER, found
from helpers.grids import thinned
from helpers.simulated import Recordings

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import cylinder_pressure, force_line, wheelset
from adhesion_cli.diagnostics.checks import wheel_apart
from adhesion_cli.formats.memory import MemorySource, Signals
from adhesion_cli.formats.open import open_source


def bent(log: Recordings, signal: str, axle: int, of: Callable[[np.ndarray], np.ndarray]
) -> Recordings:  # fmt: skip
    """Values times a function of time [s]."""
    return simulated.changed(
        log, signal, lambda r: replace(r, value=of(r.t * 1e-9) * r.value, decimals=None), axle
    )


# The third does not slide.
@pytest.mark.parametrize(("rate", "axle"), thinned(5, [1.0, 5.0, 50.0], [0, 3]))
def test_wheel_speeds_that_drift_from_the_trains_are_told(
    rate: float, axle: int, tmp_path: Path
) -> None:
    log = simulated.recordings("low-adhesion", rate=rate, train=True)
    up = bent(log, "wheel_speed", axle, lambda t: 1.0 + 0.015 * np.maximum(t - 8.0, 0.0))
    told = [f for f in found(up, tmp_path) if f.code in APART]
    assert "warning" in {f.severity for f in told}
    assert {f.channel.split()[0] for f in told} >= {f"wheel_speed_{axle or 3}"}


@pytest.mark.parametrize(("by", "rate"), thinned(5, [0.0, 0.06, -0.06], [2.0, 20.0]))
def test_a_speed_that_drifts_shows_between_brakes(rate: float, by: float, tmp_path: Path) -> None:
    random, t = np.random.default_rng(1), np.arange(0.0, 90.0, 1.0 / rate)
    on = sum(np.clip(t - at, 0.0, 1.0) * np.clip(at + 8.0 - t, 0.0, 1.0) for at in (12, 42, 72))
    w, slows = wheelset(DEFAULT.vehicle, 1), 0.8 * on
    v = 38.0 - np.cumsum(slows) / rate
    K = (w.mass + w.inertia / w.radius**2) * slows / w.phi
    p = np.where(on > 0.0, cylinder_pressure(force_line(DEFAULT.vehicle), K), 0.0)
    p += random.normal(0.0, 1000.0, len(t))
    train = v * (1.0 + by * t / 90.0) + random.normal(0.0, 0.01, len(t))
    rows = (f"{a:.3f},{b:.4f},{c:.4f},{d:.1f}" for a, b, c, d in zip(t, train, v, p, strict=True))
    path = tmp_path / "log.csv"
    head = "time [s],train_speed [m/s],wheel_speed [m/s],bc_pressure [Pa]"
    path.write_text("\n".join([head, *rows]) + "\n")
    one = read(open_source(path, DEFAULT.read), DEFAULT.mappings, DEFAULT.vehicle)
    told = [f for f in prepare(one, DEFAULT.vehicle).findings if f.code in APART]
    assert [f.channel.split()[0] for f in told] == ["wheel_speed"] * (by != 0.0)
    assert all((f.code, f.severity) == ("wheel-speed-drift", "warning") for f in told)
    assert all(f.values["share"] * by < 0.0 for f in told)  # beside the train


def slower_by(share: float) -> MemorySource:
    """A log whose wheel of 0.84 m turns so much slower than the train."""
    t = np.arange(0.0, 60.0, 0.1)
    brake = np.interp(t, [20.0, 21.0], [0.0, 3.0])
    v = np.maximum(28.0 - 0.1 * np.cumsum(0.02 + 0.3 * brake), 0.0)
    noise = np.random.default_rng(3).normal(0.0, 0.2, len(t)) * (v > 0.0)
    signals = {"BCP [bar]": brake, "axle 1 [rpm]": (1.0 - share) * v / 0.42 * 30.0 / np.pi}
    signals["train speed [km/h]"] = 3.6 * (v + noise)
    return MemorySource(Signals(t, signals))


def test_a_wheel_that_is_always_slower_by_the_same_share_has_another_diameter() -> None:
    log = read(slower_by(0.087), (), Vehicle())
    codes = {f.code for f in prepare(log, Vehicle()).findings}
    assert codes & DIAMETER
    assert not codes & APART


def test_a_wheel_that_stands_all_the_time_has_no_other_diameter() -> None:
    scene = prepare(read(slower_by(0.087), (), Vehicle()), Vehicle()).scene
    assert scene is not None
    standing = scene._replace(grid=replace(scene.grid, rim=0.0 * scene.grid.rim))
    (finding,) = wheel_apart.check(wheel_apart.Params(), standing)
    assert finding.code == "wheel-slower-unbraked"
    assert finding.values["share"] == 1.0
