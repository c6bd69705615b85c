"""Friction as a number, a table over speed and block force, or a material's name."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.vehicle_logs import log
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.stated_friction import MATERIALS
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.core.physics import G, clamping_force, friction_share, wheelset
from adhesion_cli.results.names import flat
from adhesion_cli.studies.calibrate import as_toml, calibrate

TABLE = {
    "speed": [0, 10, 30],
    "block_force": [5e3, 20e3],
    "value": [[0.40, 0.30, 0.20], [0.30, 0.25, 0.18]],
    "tolerance": 0.08,
}
TREAD = {
    "piston_diameter": 0.203, "rigging_ratio": 4.0, "efficiency": 0.85, "spring_force": 800,
    "blocks": 4,
}  # fmt: skip
AXLE = {"wheel_diameter": 0.92, "axle_mass": 12000, "wheelset_inertia": 110}


def stated(friction: Any, **more: Any) -> settings.Settings:
    tables = {"vehicle": {**AXLE, "friction": friction, "tread_brake": TREAD, **more}}
    return settings.load(tables, folder=False)


def phi(vehicle: Vehicle, speed: float, block_force: float, blocks: float = 4.0) -> float:
    return vehicle.friction.value * float(friction_share(speed, blocks * block_force, vehicle))


def test_the_table_is_over_the_force_of_one_block_and_the_speed() -> None:
    vehicle = stated(TABLE).vehicle
    assert phi(vehicle, 10.0, 20e3) == pytest.approx(0.25)
    assert phi(vehicle, 20.0, 5e3) == pytest.approx(0.25)
    assert phi(vehicle, 10.0, 12.5e3) == pytest.approx(0.275)
    assert phi(vehicle, 50.0, 90e3) == pytest.approx(0.18)  # as at the last points
    assert vehicle.friction.tolerance == pytest.approx(0.08 * vehicle.friction.value)


def test_the_force_of_a_pad_is_at_the_disc() -> None:
    disc = {"discs": 2, "piston_diameter": 0.203, "caliper_ratio": 2.5, "mean_radius": 0.23}
    tables = {"vehicle": {**AXLE, "friction": TABLE, "disc_brake": disc}}
    vehicle = settings.load(tables, folder=False).vehicle
    assert phi(vehicle, 10.0, 20e3, 4 * 0.5) == pytest.approx(0.25)


def test_a_table_over_speed_alone_needs_no_blocks() -> None:
    tables = {"vehicle": {"friction": {"speed": [0, 20], "value": [0.4, 0.3]}}}
    vehicle = settings.load(tables, folder=False).vehicle
    assert phi(vehicle, 10.0, 1e3) == pytest.approx(0.35)


@given(V=st.floats(0.0, 160.0), F=st.floats(1.0, 80.0))
def test_cast_iron_is_karwatzkis_formula(V: float, F: float) -> None:
    formula = 0.6 * (16 * F / G + 100) / (80 * F / G + 100) * (V + 100) / (5 * V + 100)
    vehicle = stated("cast-iron").vehicle
    assert phi(vehicle, V / 3.6, 1e3 * F) == pytest.approx(formula, rel=0.01)


@pytest.mark.parametrize("name", MATERIALS)
def test_every_material_is_a_friction_with_a_tolerance(name: str) -> None:
    vehicle = stated(name).vehicle
    assert 0.05 < phi(vehicle, 15.0, 15e3) < 0.45
    assert 0.05 < vehicle.friction.tolerance / vehicle.friction.value < 0.25


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"speed": [0, 10, 10]}, "speed does not rise"),
        ({"block_force": [20e3, 5e3]}, "block_force does not rise"),
        ({"value": [[0.4, 0.3, -0.2], [0.3, 0.25, 0.18]]}, "value = -0.2"),
        ({"value": [[0.4, 0.3], [0.3, 0.25]]}, "row of 2, and speed has 3"),
        ({"value": [[0.4, 0.3, 0.2]]}, "not 2 rows"),
        ({"value": None}, "not 2 rows"),
        ({"speed": [0, "fast", 30]}, "speed = 'fast' is not a number"),
        ({"tolerance": 5}, "tolerance = 5"),
        ({"forces": [1]}, "forces"),
        ({"clamping_force": [1, 2]}, "block_force and clamping_force"),
    ],
)
def test_a_table_that_does_not_fit_is_an_error(change: dict[str, Any], says: str) -> None:
    with pytest.raises(UserError, match=says) as error:
        stated({**TABLE, **change})
    assert "vehicle.friction" in error.value.text
    assert error.value.hint


def test_a_table_without_the_number_of_blocks_names_the_key() -> None:
    with pytest.raises(UserError, match="blocks are not stated") as error:
        settings.load({"vehicle": {**AXLE, "friction": TABLE}}, folder=False)
    assert "adhesion vehicle wagon" in (error.value.hint or "")
    no_blocks = {"rigging_ratio": 5.0, "piston_diameter": 0.3}
    tables = {"vehicle": {**AXLE, "friction": TABLE, "tread_brake": no_blocks}}
    with pytest.raises(UserError, match="blocks are not stated") as error:
        settings.load(tables, folder=False)
    assert "vehicle.tread_brake.blocks" in (error.value.hint or "")


@pytest.mark.parametrize(
    "brake", [{"discs": 2, "lever_ratio": 5.0, "cylinder_diameter": 0.3}, {"efficiency": 0.9}]
)
def test_a_material_over_force_needs_the_blocks_of_a_brake_by_its_own_names(
    brake: dict[str, float],
) -> None:
    """Over the speed alone, its change with the force would be lost without a word."""
    vehicle = {**AXLE, **brake, "friction": "cast-iron"}
    with pytest.raises(UserError, match="blocks are not stated") as error:
        settings.load({"vehicle": vehicle}, folder=False)
    assert "vehicle.tread_brake.blocks" in (error.value.hint or "")


def test_a_material_without_a_brake_changes_over_the_speed() -> None:
    vehicle = settings.load(assignments=["vehicle.friction=cast-iron"], folder=False).vehicle
    low, high = (phi(vehicle, V / 3.6, 20e3) for V in (10.0, 100.0))
    assert low / high == pytest.approx((110 / 150) / (200 / 600), rel=0.01)
    assert phi(vehicle, 10.0 / 3.6, 5e3) == pytest.approx(low)
    band = 2.0 * vehicle.friction.tolerance / vehicle.friction.value
    of_light, of_heavy = (phi(stated("cast-iron").vehicle, 10.0 / 3.6, F) for F in (5e3, 40e3))
    assert low * (1.0 - band) < of_heavy < low < of_light < low * (1.0 + band)


def test_a_table_and_a_fade_are_speed_twice() -> None:
    with pytest.raises(UserError, match="friction_fade"):
        stated(TABLE, friction_fade=-0.004)


def test_a_later_friction_replaces_the_table() -> None:
    tables = {"vehicle": {**AXLE, "friction": TABLE, "tread_brake": TREAD}}
    number = {"value": 0.25, "tolerance": 0.01}
    vehicle = settings.load(tables, [{"vehicle": {"friction": number}}], folder=False).vehicle
    assert (vehicle.friction, vehicle.friction_table) == (Parameter(0.25, 0.01), None)
    narrower = settings.load(tables, ["vehicle.friction.tolerance=0.02"], folder=False).vehicle
    assert narrower.friction_table == stated(TABLE).vehicle.friction_table
    assert narrower.friction.tolerance == pytest.approx(0.02 * narrower.friction.value)


@pytest.fixture(scope="module")
def cast_iron_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Stops of a wagon whose blocks have 0.93 of the formula's friction."""
    vehicle = stated("cast-iron").vehicle
    friction = Parameter(0.93 * vehicle.friction.value, 0.0)
    true = replace(vehicle, friction=friction)
    return log(tmp_path_factory.mktemp("cast-iron") / "wagon.csv", true)


def test_a_wagon_of_cast_iron_has_its_adhesion(cast_iron_log: Path) -> None:
    result = analyze(cast_iron_log, stated("cast-iron"), ["td"])
    (axle,) = result.axles
    applications = summarise(result, {}).axles[0].applications
    vehicle, record, w = result.vehicle, axle.record, wheelset(result.vehicle, 1)
    truth = stated("cast-iron").vehicle
    assert record.pressure is not None
    K = clamping_force(record.pressure, truth)
    rim = record.wheel_speed * w.radius
    force = w.rolling * 0.93 * truth.friction.value * K * friction_share(rim, K, truth)
    for s, a in zip(axle.applications, applications, strict=True):
        assert a.coefficient is not None
        mu = force[s] / (w.mass * G)
        assert a.coefficient.mean == pytest.approx(float(np.mean(mu)), rel=0.06)
        assert abs(a.coefficient.max - float(np.max(mu))) < a.coefficient.max_u95
    assert vehicle.friction_table is not None
    assert vehicle.friction_fade.value == 0.0


def test_a_result_is_a_valid_input(cast_iron_log: Path) -> None:
    result = analyze(cast_iron_log, stated("cast-iron"), ["td"])
    again = settings.load(folder=False).over(settings.nested(flat(result.settings)))
    assert again.vehicle.friction_table is not None
    speeds, forces = np.linspace(0.0, 40.0, 9), np.linspace(0.0, 4e5, 9)
    np.testing.assert_allclose(
        again.vehicle.friction.value * friction_share(speeds, forces, again.vehicle),
        result.vehicle.friction.value * friction_share(speeds, forces, result.vehicle),
        rtol=1e-12,
    )


def test_calibrate_scales_the_table(cast_iron_log: Path, tmp_path: Path) -> None:
    run = calibrate([cast_iron_log], stated("cast-iron"))
    row = run.result.rows["friction_scale"]
    assert (row.prior, row.prior_u) == (1.0, pytest.approx(0.13, abs=0.02))
    assert abs(row.posterior - 0.93) < 2.0 * row.posterior_u
    assert row.posterior_u < 0.8 * row.prior_u
    file = tmp_path / "wagon.toml"
    file.write_text(as_toml(run), encoding="utf-8")
    vehicle = settings.load(file, folder=False).vehicle
    share = phi(vehicle, 15.0, 15e3) / phi(stated("cast-iron").vehicle, 15.0, 15e3)
    assert share == pytest.approx(row.posterior, rel=0.03)
    assert vehicle.friction_fade.value == 0.0
