"""A brake as engineers state it is that of equation (15)."""

import math
import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.identify import force_per_bar
from adhesion_cli.analysis.vehicle_presets import names, preset_toml
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import clamping_force

DISC = {
    "discs": 2,
    "piston_diameter": 0.203,
    "caliper_ratio": 2.5,
    "efficiency": 0.95,
    "spring_force": 1500,
    "mean_radius": 0.247,
}
TREAD = {"piston_diameter": 0.406, "rigging_ratio": 5.5, "efficiency": 0.83, "spring_force": 1800}
AXLE = {"wheel_diameter": 0.84, "axle_mass": 14000, "friction": 0.35}


def vehicle(**stated: Any) -> Vehicle:
    return settings.load(assignments=[{"vehicle": {**AXLE, **stated}}], folder=False).vehicle


def rim_force(v: Vehicle, pressure: float) -> float:
    return float(v.friction.value * clamping_force(pressure, v))


@given(
    discs=st.integers(1, 4), pads=st.integers(1, 2), cylinders=st.integers(1, 2),
    ratio=st.floats(0.5, 5.0), r_m=st.floats(0.1, 0.4), pressure=st.floats(0.0, 6e5),
)  # fmt: skip
def test_a_disc_brake_has_the_force_of_its_formula(
    discs: int, pads: int, cylinders: int, ratio: float, r_m: float, pressure: float
) -> None:
    counts = {"discs": discs, "pads_per_disc": pads, "cylinders": cylinders}
    v = vehicle(disc_brake={**DISC, **counts, "caliper_ratio": ratio, "mean_radius": r_m})
    piston = math.pi * 0.203**2 / 4.0 * pressure - 1500.0
    force = 0.35 * discs * pads * cylinders * ratio * 0.95 * r_m / 0.42 * max(piston, 0.0)
    assert rim_force(v, pressure) == pytest.approx(force, rel=1e-9, abs=1e-6)


def test_a_tread_brake_has_the_force_of_its_formula() -> None:
    v = vehicle(tread_brake={**TREAD, "cylinders": 0.25, "blocks": 8})
    force = 0.35 * 0.25 * 5.5 * 0.83 * (math.pi * 0.406**2 / 4.0 * 3e5 - 1800.0)
    assert rim_force(v, 3e5) == pytest.approx(force, rel=1e-12)


def test_two_pads_press_on_a_disc_where_nobody_states_them() -> None:
    one = {**DISC, "pads_per_disc": 1}
    assert force_per_bar(vehicle(disc_brake=DISC)).value == pytest.approx(
        2.0 * force_per_bar(vehicle(disc_brake=one)).value
    )


def test_the_area_of_a_piston_stands_for_its_diameter() -> None:
    area = {"value": math.pi * 0.203**2 / 4.0, "tolerance": 2e-4}
    by_area = {k: v for k, v in DISC.items() if k != "piston_diameter"} | {"piston_area": area}
    v = vehicle(disc_brake=by_area)
    assert v.cylinder_diameter.value == pytest.approx(0.203)
    share = v.cylinder_diameter.tolerance / v.cylinder_diameter.value
    assert share == pytest.approx(0.5 * area["tolerance"] / area["value"])


def test_tolerances_of_both_radii_are_in_the_ratio() -> None:
    wheel = {"value": 0.84, "tolerance": 0.0084}
    v = vehicle(wheel_diameter=wheel, disc_brake={**DISC, "mean_radius": {"value": 0.25,
                "tolerance": 0.005}})  # fmt: skip
    assert v.radius_ratio.tolerance / v.radius_ratio.value == pytest.approx(math.hypot(0.01, 0.02))


def test_a_rotating_mass_is_an_inertia() -> None:
    v = vehicle(rotating_mass=0.1)
    assert v.wheelset_inertia.value == pytest.approx(0.1 * 14000 * 0.42**2)


@pytest.mark.parametrize(
    ("stated", "text", "hint"),
    [
        ({"disc_brake": DISC, "tread_brake": TREAD}, "both stated", "keep the one"),
        ({"disc_brake": DISC, "discs": 2}, "the same brake twice", "leave out vehicle.discs"),
        ({"disc_brake": {"discs": 2}}, "lacks caliper_ratio and mean_radius", "pad over force"),
        ({"tread_brake": {"rigging_ratio": 5}}, "lacks piston_diameter", "cylinder data sheet"),
        ({"disc_brake": {**DISC, "caliper": 2}}, "unknown key of", "did you mean 'caliper_ratio'"),
        ({"disc_brake": {**DISC, "caliper_ratio": -2}}, "caliper_ratio = -2 is out of", "0.05 to"),
        ({"disc_brake": {**DISC, "piston_area": 0.03}}, "piston_diameter and pist", "keep one"),
        ({"disc_brake": {**DISC, "discs": "two"}}, "is not a number", "write a plain number"),
        ({"disc_brake": 2}, "is a table", "write [vehicle.disc_brake]"),
        ({"disc_brake": DISC, "wheel_diameter": None}, "needs the diameter", "wheel_diameter"),
        ({"rotating_mass": 0.1, "wheelset_inertia": 100}, "the same inertia twice", "leave out"),
        ({"rotating_mass": 0.1, "axle_mass": None}, "needs the mass", "axle_mass"),
        ({"rotating_mass": -0.1}, "out of range", "0.001 to 1"),
        ({"rotating_mass": 0.1, "wheel_diameter": 0.0}, "wheel_radius = 0 is out", "0.1 to 1"),
        (
            {"disc_brake": {**DISC, "discs": {"value": 2, "tolerance": -1}}},
            "tolerance = -1 is out of range",
            "1 sigma",
        ),
    ],
)
def test_a_wrong_statement_is_one_error_with_key_and_remedy(
    stated: dict[str, Any], text: str, hint: str
) -> None:
    tables = {k: v for k, v in {**AXLE, **stated}.items() if v is not None}
    with pytest.raises(UserError) as error:
        settings.load(assignments=[{"vehicle": tables}], folder=False)
    assert text in error.value.text
    assert hint in error.value.hint
    assert error.value.code == 2


def test_a_key_may_be_stated_over_those_of_a_file() -> None:
    file = {"vehicle": {**AXLE, "disc_brake": DISC}}
    v = settings.load(file, ["vehicle.disc_brake.caliper_ratio=3"], folder=False).vehicle
    assert (v.lever_ratio.value, v.discs.value) == (3.0, 4.0)


@pytest.mark.parametrize("name", names())
def test_a_preset_is_a_vehicle(name: str) -> None:
    stated = settings.load(tomllib.loads(preset_toml(name)), folder=False)
    assert {"friction", "axle_mass", "wheelset_inertia", "discs"} <= stated.stated
    assert 2e2 < force_per_bar(stated.vehicle).value < 1.5e4
    if name == "paper":
        assert stated.vehicle == Vehicle()
