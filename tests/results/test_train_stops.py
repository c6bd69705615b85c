"""Brake applications of all axles as stops of the train."""

from dataclasses import replace
from typing import Any

from adhesion_cli.core.summary import (
    AxleSummary,
    BrakeApplication,
    MeanAndHighest,
    ReferenceSummary,
)
from adhesion_cli.results.train_stops import (
    find_stops,
    group_axles,
    group_numbers,
    group_row,
    train_stop_row,
)


def application(axle: int, start: float, mean: float = 0.1, **slides: Any) -> BrakeApplication:
    values: dict[str, Any] = {
        "slides": 0, "slide_list": (), "slide_s": 0.0, "slide_distance_m": 0.0, "max_slip": None,
        "slide_energy_j": None, "at_least": False, "utilisation": None, "utilisation_ci": None,
        "budget": None, "coverage": None, "force_n": None,
    }  # fmt: skip
    return BrakeApplication(
        axle=axle, start_s=start, end_s=start + 20.0, from_mps=20.0, to_mps=0.0,
        coefficient=MeanAndHighest(mean, 0.01, mean, 0.02), **values | slides,
    )  # fmt: skip


def train(axles: int = 4) -> list[AxleSummary]:
    """Two stops; axle 2 slides in the second, and its valve parts that application."""
    slid = {"slides": 1, "slide_s": 3.0, "max_slip": 0.3}
    rows: dict[int, list[BrakeApplication]] = {
        n: [application(n, 10.0 + 0.1 * n), application(n, 60.0, 0.1 + 0.001 * n)]
        for n in range(1, axles + 1)
    }
    rows[2][1:] = [application(2, 60.0, 0.05, **slid), application(2, 75.0)]
    reference = ReferenceSummary("smoother", 1.0, 2.0)
    return [AxleSummary(n, reference, tuple(found), ()) for n, found in rows.items()]


def test_applications_that_overlap_are_one_stop() -> None:
    first, second = find_stops(train())
    assert [a.axle for a in first] == [1, 2, 3, 4]
    assert [a.axle for a in second] == [1, 2, 2, 3, 4]
    rows = [train_stop_row(stop) for stop in (first, second)]
    assert [(row["at [s]"], row["for [s]"]) for row in rows] == [("10.1", "20.3"), ("60.0", "35.0")]


def test_the_row_of_a_stop_is_of_its_worst_axle() -> None:
    first, second = find_stops(train())
    row = train_stop_row(second)
    assert [row[k] for k in ("slid", "max slip [%]", "axle", "µ of axles", "v [km/h]")] == [
        "1 of 4", "30.0", "2", "0.050–0.104", "72–0"
    ]  # fmt: skip
    assert [train_stop_row(first)[k] for k in ("slid", "max slip [%]", "axle")] == [
        "0 of 4",
        "-",
        "-",
    ]


def test_a_mean_that_says_nothing_is_not_known() -> None:
    wide = MeanAndHighest(0.11, 0.27, None, 0.27)
    stop = find_stops(train())[0]
    unsure = tuple(replace(a, coefficient=wide) for a in stop)
    row = train_stop_row(unsure)
    assert (row["µ mean"], row["µ of axles"]) == ("not known", "not known")
    axles = (train()[0]._replace(applications=unsure),)
    assert group_row("1", axles)["µ mean"] == "not known"
    axles = (train()[0]._replace(applications=(*unsure, stop[0])),)
    assert group_row("1", axles)["µ mean"] == "0.100"


def test_axles_are_grouped_in_their_order() -> None:
    groups = group_axles(train(10))
    assert [*groups] == ["1–4", "5–8", "9–10"]
    rows = [group_row(*group) for group in groups.items()]
    assert [row["with slides"] for row in rows] == ["1", "0", "0"]
    assert [rows[0][k] for k in ("axle", "at [s]", "max slip [%]")] == ["2", "60.0", "30.0"]


def test_axles_are_grouped_by_their_cars() -> None:
    cars = {1: "Mc1", 2: "Mc1", 3: "T", 4: "T", 5: "Mc2", 6: "Mc2"}
    assert [name for name, _ in group_numbers(range(1, 7), cars)] == [
        "Mc1 (1–2)", "T (3–4)", "Mc2 (5–6)"
    ]  # fmt: skip
    assert [*group_axles(train(6), {})] == ["1–4", "5–6"]
