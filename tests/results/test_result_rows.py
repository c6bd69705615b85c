"""Brake applications and budgets as rows of text."""

from typing import Any

from adhesion_cli.core.summary import (
    BrakeApplication,
    Contribution,
    Coverage,
    MeanAndHighest,
    SlideSummary,
)
from adhesion_cli.results.carried_vehicle import parameter_title
from adhesion_cli.results.result_rows import combined, row, slid_row
from adhesion_cli.results.text_tables import describe_cells


def application(**values: Any) -> BrakeApplication:
    base: dict[str, Any] = {
        "start_s": 2.0, "end_s": 12.0, "from_mps": 20.0, "to_mps": 0.0,
        "force_n": MeanAndHighest(5000.0, 500.0, 6000.0, 600.0), "coefficient": None, "slides": 1,
        "slide_list": (), "slide_s": 3.0, "slide_distance_m": 40.0, "max_slip": 0.2,
        "slide_energy_j": 9e4, "at_least": False, "utilisation": None, "utilisation_ci": None,
        "budget": None, "coverage": Coverage(250.0, 2.0, None),
    }  # fmt: skip
    return BrakeApplication(**base | values)


def test_the_share_used_has_its_interval() -> None:
    assert slid_row("1", application())["used [%]"] == "-"
    shown = application(utilisation=0.714, utilisation_ci=(0.6, 0.85))
    assert slid_row("1", shown)["used [%]"] == "71 (60–85)"


def test_the_energy_has_its_uncertainty() -> None:
    assert slid_row("1", application())["energy [kJ]"] == "90.0"
    assert slid_row("1", application(slide_energy_u95_j=2e4))["energy [kJ]"] == "90±20"
    bound = application(slide_energy_u95_j=2e4, at_least=True)
    assert slid_row("1", bound)["energy [kJ]"] == "≥ 90±20"


def test_slides_have_the_place_of_the_first_one() -> None:
    placed = application(position_km=12.3, position_from="position", slide_position_km=12.6021)
    assert slid_row("1", placed)["km"] == "12.602"
    way = application(position_km=0.3, position_from="distance", slide_position_km=0.6)
    assert "km" not in slid_row("1", way)


def test_a_share_above_100_percent_is_explained() -> None:
    def budget(*shares: float) -> BrakeApplication:
        rows = (Contribution("friction", 0.3, "-", "B", 0.01, 1e4, 100.0, x) for x in shares)
        return application(budget=tuple(rows))

    assert "correlated" in combined(budget(1.4, -0.4))
    assert "correlated" not in combined(budget(0.9, 0.1))


def test_a_highest_value_that_says_nothing_is_not_known() -> None:
    of_force = MeanAndHighest(5000.0, 500.0, None, 20000.0)
    wide = application(coefficient=MeanAndHighest(0.09, 0.013, None, 0.41), force_n=of_force)
    cells = row("1", wide)
    assert (cells["µ mean"], cells["µ max"]) == ("0.090±0.013", "not known")
    assert cells["Fmax [kN]"] == "not known"
    assert "both 0 and 0.1" in describe_cells([cells])
    narrow = row("1", application(coefficient=MeanAndHighest(0.02, 0.013, 0.03, 0.06)))
    assert narrow["µ max"] == "0.030±0.060"  # says that µ was below 0.09: slippery
    assert not describe_cells([narrow])


def test_a_mean_that_says_nothing_is_not_known() -> None:
    wide, narrow = MeanAndHighest(0.11, 0.27, None, 0.27), MeanAndHighest(0.11, 0.1, None, 0.27)
    of_force, heads = MeanAndHighest(13e3, 31e3, None, 32e3), ("µ mean", "F [kN]")
    cells = row("1", application(coefficient=wide, force_n=of_force, other_brake=True))
    assert [cells[head] for head in heads] == ["not known", "not known"]
    cells = row("1", application(coefficient=narrow, force_n=of_force, other_brake=True))
    assert [cells[head] for head in heads] == ["0.11±0.10*", "13±31"]
    assert describe_cells([cells]).startswith("*: without the force of another brake")


def test_slides_stand_at_the_begin_of_the_first_one() -> None:
    slide = SlideSummary(7.5, 1.0, 20.0, 0.2, None, at_least=False, time="2026-03-05T06:00:07Z")
    shown = application(slide_list=(slide,), time="2026-03-05T06:00:02Z")
    cells = slid_row("1", shown)
    assert (cells["at [s]"], cells["clock"]) == ("7.5", "06:00:07")


def test_discs_are_shown_as_what_they_count() -> None:
    names = ("discs", "M1 discs", "discs, axle 2", "wheel_radius")
    assert [parameter_title(x) for x in names] == [
        "clamping forces", "M1 clamping forces", "clamping forces, axle 2", "wheel radius"
    ]  # fmt: skip
