import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.core import units
from adhesion_cli.core.errors import UserError


@pytest.mark.parametrize(
    ("name", "base", "unit"),
    [
        ("BC pressure [kPa]", "BC pressure", "kPa"),
        ("制动缸压力(kPa)", "制动缸压力", "kPa"),
        ("制动缸压力（kPa）", "制动缸压力", "kPa"),
        ("Druck / bar", "Druck", "bar"),
        ("speed, km/h", "speed", "km/h"),
        ("Geschwindigkeit in km/h", "Geschwindigkeit", "km/h"),
        ("v_kmh", "v", "kmh"),
        ("v_kmh_2", "v_2", "kmh"),
        ("speed_km_h_axle2", "speed_axle2", "km_h"),
        ("wheel_speed_rpm1", "wheel_speed1", "rpm"),
        ("/wheel/omega_rad_s", "/wheel/omega", "rad_s"),
        ("press.mbar", "press", "mbar"),
        ("wheelSpeedKmh", "wheelSpeed", "km/h"),
        ("bcPressure1Kpa", "bcPressure1", "kPa"),
        ("bc1 pressure bar(g)", "bc1 pressure", "bar(g)"),
        ("adhesion_force_true [N]", "adhesion_force_true", "N"),
        ("bc_pressure_1", "bc_pressure_1", ""),
        ("axle2_speed", "axle2_speed", ""),
        ("N", "N", ""),
        ("velocity[0]", "velocity[0]", ""),
        ("BC pressure [10 kPa]", "BC pressure", "10 kPa"),
        ("BC pressure x10 [kPa]", "BC pressure", "x10 kPa"),
        ("BC pressure/10kPa", "BC pressure", "10kPa"),
        ("BC pressure in 10 kPa", "BC pressure", "10 kPa"),
        ("BC pressure, 10 kPa", "BC pressure", "10 kPa"),
        ("wheel speed 0.1 km/h", "wheel speed", "0.1 km/h"),
        ("v_0.1kmh", "v", "0.1kmh"),
        ("BC pressure [bar] (1 s)", "BC pressure  (1 s)", "bar"),
        ("speed 1 km/h", "speed 1", "km/h"),
        ("pressurekPa", "pressure", "kPa"),
        ("BCP 10bar", "BCP", ""),  # a range, or a factor: its digits are no axle
        ("BCP (0-10 bar)", "BCP", ""),
        ("BC pressure 10 kPa", "BC pressure", ""),
        ("BC pressure 1/10 bar", "BC pressure", "1/10 bar"),
        ("speed axle 10 km/h", "speed axle 10", "km/h"),
        ("speed 12 km/h", "speed 12", "km/h"),
        ("BCP [bar x10]", "BCP", ""),
        ("BCP [bar/100]", "BCP", ""),
        ("BCP [10 bar]", "BCP", ""),
        ("BCP [bar] x0.01", "BCP", ""),
        ("BCP (kPa)/10", "BCP", ""),
    ],
)
def test_finds_the_unit_in_a_name(name: str, base: str, unit: str) -> None:
    assert units.in_name(name) == (base, unit)


@pytest.mark.parametrize(
    ("text", "value", "si"),
    [
        ("bar", 3.5, 3.5e5),
        ("mbar", 3500.0, 3.5e5),
        ("kPa", 350.0, 3.5e5),
        ("MPa", 0.35, 3.5e5),
        ("psi", 50.0, 344737.8646584181),
        ("bara", 1.01325, 0.0),
        ("kPa abs", 101.325, 0.0),
        ("kPa absolute", 101.325, 0.0),
        ("bar gauge", 4.0, 4e5),
        ("kPa(a)", 401.325, 3e5),
        ("km/h", 72.0, 20.0),
        ("mph", 10.0, 4.4704),
        ("knots", 36.0, 18.52),
        ("rpm", 60.0, 2.0 * math.pi),
        ("U/min", 60.0, 2.0 * math.pi),
        ("转/分", 60.0, 2.0 * math.pi),
        ("°/s", 180.0, math.pi),
        ("kN", 21.0, 21000.0),
        ("µs", 5.0, 5e-6),
        ("min⁻¹", 60.0, 2.0 * math.pi),
        ("N/mm²", 0.35, 3.5e5),
        ("0.01 bar", 350.0, 3.5e5),
        ("-1 bar", 3.5, -3.5e5),
        ("0,01 bar", 350.0, 3.5e5),
        ("10 kPa", 35.0, 3.5e5),
        ("x0.1 km/h", 720.0, 20.0),
        ("2 km/h", 36.0, 20.0),
        ("1/128 bar/bit", 448.0, 3.5e5),
        ("10^-2 bar", 350.0, 3.5e5),
        ("0.1 kPa abs", 1013.25, 0.0),
    ],
)
def test_converts_to_si(text: str, value: float, si: float) -> None:
    unit = units.unit(text)
    assert unit is not None
    assert unit.factor * value + unit.offset == pytest.approx(si, rel=1e-12, abs=1e-9)


def test_refuses_a_unit_of_another_dimension_and_names_the_right_ones() -> None:
    with pytest.raises(UserError) as error:
        units.stated_unit("km/h", "pressure", "bc1")
    assert "bc1" in error.value.text
    assert "kPa" in error.value.hint
    assert error.value.code == 2


@pytest.mark.parametrize("text", ["bar x10", "kPa*10", "bar/100", "0-10 bar", "10 bar", "0 bar"])
def test_a_number_that_may_mean_anything_is_no_factor(text: str) -> None:
    assert units.unit(text) is None
    assert units.unknown_in(f"BCP [{text}]") == text


def test_a_number_behind_the_unit_is_named() -> None:
    assert units.unknown_in("BCP [bar] x10") == "bar x10"
    assert units.unknown_in("BCP [bar] (x100)") == "bar x100"
    assert units.unknown_in("BCP [0.01 bar/LSB]") == ""
    assert units.in_name("BCP [bar] (x10)") == ("BCP", "")
    assert units.in_name("BCP x100 [bar]") == ("BCP", "")  # too coarse for a factor that holds
    assert units.unknown_in("BCP x100 [bar]") == "bar x100"
    assert units.unknown_in("BCP [% of 10 bar]") == "% of 10 bar"
    assert units.unknown_in("BCP 10 kPa") == "10 kPa"
    assert units.contradicting("x10 kPa", ["BCP x10 [kPa]"], "pressure") == ""
    assert units.contradicting("0.01 bar", ["BCP [bar]"], "pressure") == "bar"


@pytest.mark.parametrize("text", ["mPa", "[mPa]", "mPa abs"])
def test_a_millipascal_is_no_megapascal(text: str) -> None:
    assert units.unit(text) is None


@given(st.text(max_size=40))
def test_any_name_splits_without_loss_of_sense(name: str) -> None:
    _, unit = units.in_name(name)
    assert unit == "" or units.unit(unit) is not None


def test_a_unit_nobody_knows_is_told_by_its_name() -> None:
    assert units.unknown_in("bc_pressure_1 [foo]") == "foo"
    assert units.unknown_in("bc_pressure_1 [bar]") == units.unknown_in("bc_pressure_1") == ""
