"""A train that slows otherwise than the stated vehicle does."""

from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import (
    CODES,
    clean,
    found,
)
from helpers.grids import thinned
from helpers.pasted import pasted

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.core.physics import G, clamping_force, wheelset
from adhesion_cli.diagnostics.checks.vehicle import remedy_names
from adhesion_cli.formats.open import open_source


def test_the_unit_of_the_wheel_speed_that_was_meant_is_named(tmp_path: Path) -> None:
    log = simulated.mislabelled(clean("service-brake", 1, "as it is"), "wheel_speed", "m/s")
    (finding,) = found(log, tmp_path)
    assert (finding.code, finding.severity) == ("deceleration-unit-suspect", "warning")
    assert finding.names["candidates"] == "wheel speed in km/h"


def test_another_vehicle_is_told(tmp_path: Path) -> None:
    stated = settings.load(None, ["vehicle.lever_ratio=2.4"])
    log = simulated.recordings("service-brake", vehicle=stated.vehicle)
    (told,) = found(log, tmp_path)
    assert (told.code, told.severity) == ("vehicle-suspect", "warning")
    assert not found(log, tmp_path, stated)


@pytest.mark.parametrize(
    ("rate", "gradient", "friction"), thinned(5, [1.0, 20.0], [-25.0, 0.0, 25.0], [0.15, 0.3])
)
def test_the_friction_that_would_fit_is_told(
    friction: float, gradient: float, rate: float, tmp_path: Path
) -> None:
    t = np.arange(0.0, 40.0, 1.0 / rate)
    p = 4e5 * np.clip((t - 4.0) / 2.0, 0.0, 1.0) * np.clip((26.0 - t) / 2.0, 0.0, 1.0)
    stated = settings.load(None, ["vehicle.lever_ratio=2.4"])
    w = wheelset(stated.vehicle, 1)
    slows = w.a * friction * (1.0 - w.rolling) * clamping_force(p, stated.vehicle)
    slows += w.rolling * G * gradient / 1000.0 / 0.42
    y = 90.0 - np.cumsum(slows) / rate + np.random.default_rng(2).normal(0.0, 3e-3, len(t))
    rows = (f"{a:.3f},{b:.0f},{c:.5f}\n" for a, b, c in zip(t, p, y, strict=True))
    path = tmp_path / "log.csv"
    path.write_text("time [s],bc_pressure [Pa],wheel_speed [rad/s]\n" + "".join(rows))
    one = read(open_source(path, stated.read), stated.mappings, stated.vehicle)
    told = [f for f in prepare(one, stated.vehicle).findings if f.code in CODES]
    assert [(f.code, f.severity) for f in told] == [("vehicle-suspect", "warning")] * (
        friction != 0.3
    )
    assert all(f.values["factor"] == pytest.approx(friction / 0.3, rel=0.1) for f in told)
    for f in told:  # its remedy has one line for each parameter
        fits = settings.load(assignments=pasted(f.names["fits"]), folder=False).vehicle
        assert fits.friction.value == pytest.approx(friction, rel=0.1)


@pytest.mark.parametrize(
    ("factor", "counts", "proposes_mass"),
    [(2.1, True, False), (0.48, True, False), (1.12, False, True), (3.2, False, False)],
)
def test_a_factor_of_two_is_a_count_and_no_other_mass(
    factor: float, counts: bool, proposes_mass: bool
) -> None:
    names = remedy_names(Vehicle(axle_mass=Parameter(14e3, 700.0)), factor)
    assert ("count the pads" in names["check"]) is counts
    assert names["fits"].startswith(("twice the pads", "half the pads")) is counts
    assert ("vehicle.axle_mass" in names["fits"]) is proposes_mass


def test_a_train_that_stands_braked_for_long_has_no_wrong_unit(tmp_path: Path) -> None:
    noise = np.random.default_rng(3)
    t = np.arange(0.0, 80.0, 0.05)
    p = 3.0 * np.clip((t - 4.0) / 2.0, 0.0, 1.0)
    v = np.maximum(20.0 - 0.4 * np.maximum(t - 5.0, 0.0), 0.0)
    slip = 0.15 * (np.abs(np.sin(0.7 * t)) > 0.3) * (t > 6.0)
    wheel = v * (1.0 - slip)  # WSP lets all wheels slide
    p *= 1.0 - 0.7 * (slip > 0.0) * (v > 0.0)
    radar = 3.6 * v + noise.normal(0.0, 0.15, len(t))
    rows = zip(t, p, 3.6 * wheel, 3.6 * wheel, radar, strict=True)
    path = tmp_path / "log.csv"
    head = "time [s],bc_pressure [bar],wheel_speed_1 [km/h],wheel_speed_2 [km/h],radar speed [km/h]"
    lines = (",".join(f"{x:.2f}" for x in row) for row in rows)
    path.write_text("\n".join([head, *lines]) + "\n")
    result = analyze(path, settings.load(None, folder=False), ["td"])
    assert "deceleration-unit-suspect" not in {f.code for f in result.findings}


@pytest.mark.parametrize("name", ["service-brake", "low-adhesion"])
def test_all_speeds_in_another_unit_are_told_as_that(name: str, tmp_path: Path) -> None:
    log = simulated.recordings(name, train=True)
    for signal in ("wheel_speed", "train_speed"):
        log = simulated.scaled(log, signal, 0, 3.6)
    (told,) = found(log, tmp_path)
    assert (told.code, told.severity) == ("vehicle-suspect", "warning")
    assert "friction" not in told.names["fits"]


@pytest.mark.parametrize(
    "times", [3.0, 20.0, *(pytest.param(x, marks=pytest.mark.slow) for x in (5.0, 8.0, 10.0))]
)
def test_time_stamps_too_fast_are_told_by_as_much_with_a_train_speed_too(
    times: float, tmp_path: Path
) -> None:
    log = simulated.slower(clean("four-axles", 1, "as it is"), 1.0 / times)
    (told,) = found(log, tmp_path)
    assert told.code in {"deceleration-unit-suspect", "vehicle-suspect"}
    assert told.severity == "warning"
    assert told.values["factor"] == pytest.approx(times, rel=0.1)


def test_milliseconds_taken_for_seconds_are_told_as_that(tmp_path: Path) -> None:
    stated = settings.load(None, ["channels.time.unit=s"])
    told = found(simulated.slower(clean("service-brake", 1, "as it is"), 1e3), tmp_path, stated)
    assert [(f.code, f.severity) for f in told] == [("deceleration-unit-suspect", "warning")]
    assert "ms for s" in told[0].names["candidates"]
