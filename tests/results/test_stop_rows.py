"""Stops of a series as rows of text."""

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.pages import analysed, written

from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.summary import AxleStop, Measured, StopSummary
from adhesion_cli.results.report.page import page
from adhesion_cli.results.report.plots import Figures
from adhesion_cli.results.report.run import read
from adhesion_cli.results.stop_rows import (
    describe_columns,
    describe_reasons,
    describe_sources,
    series_tables,
)
from adhesion_cli.stops.series import (
    LimitVerdict,
    SeriesStop,
    StopSeries,
    WspSummary,
    group_stops,
)

STOP = StopSummary(
    start_s=1.0, end_s=30.0, command_from="channel", speed_from="train", nominal_speed_kmh=80.0,
    valid=True, initial_speed_mps=Measured(20.0, 0.1), distance_m=Measured(250.0, 3.0),
    duration_s=None, delay_s=None, response_time_s=None, mean_deceleration=Measured(0.8, 0.01),
    equivalent_deceleration=None, jerk=None, corrected_distance_m=None,
)  # fmt: skip
PLACED = replace(STOP, time="2026-03-01T08:00:00Z", position_m=1234.0, position_from="position")


def tables(*stops: StopSummary) -> dict[str, list[dict[str, str]]]:
    of_series = tuple(
        SeriesStop(f"{i}.csv", f"{s.nominal_speed_kmh:g} km/h", None, s)
        for i, s in enumerate(stops)
    )
    series = StopSeries(of_series, tuple(group_stops(of_series)), (), (), ())
    return {x.title: [dict(row) for row in x.rows] for x in series_tables(series, False, False)}


def note(*stops: StopSummary) -> str:
    """The text below the table of stops."""
    of_series = tuple(SeriesStop("a.csv", "80 km/h", None, s) for s in stops)
    return series_tables(StopSeries(of_series, (), (), (), ()), False, False)[0].note


def test_clock_and_place_stand_at_the_begin_where_the_first_log_has_none() -> None:
    rows = tables(STOP, PLACED)["Stops"]
    assert [*rows[0]][:7] == ["stop", "log", "group", "at [s]", "clock", "km", "v0 [km/h]"]
    assert (rows[0]["km"], rows[1]["km"]) == ("-", "1.234")
    assert [*rows[0]] == [*rows[1]]


def test_the_response_table_has_delay_and_build_up_of_stops_that_have_them() -> None:
    rolling = replace(
        STOP, delay_s=Measured(0.27, 0.01), build_up_s=Measured(0.94, 0.06),
        response_time_s=Measured(0.74, 0.03),
    )  # fmt: skip
    slid = replace(STOP, delay_s=Measured(0.28, 0.01))
    rows = tables(STOP, rolling, slid)["Response of the brakes"]
    assert [row["stop"] for row in rows] == ["2", "3"]
    assert [*rows[0].values()][2:] == ["0.27±0.01", "0.94±0.06", "0.74±0.03"]
    assert [*rows[1].values()][2:] == ["0.28±0.01", "-", "-"]


def test_the_label_of_a_group_stands_below_the_stops() -> None:
    stops = tuple(SeriesStop("a.csv", "wet", "soap", STOP) for _ in range(2))
    table, *_ = series_tables(StopSeries(stops, (), (), (), ()), False, False)
    assert table.note.count("Group wet: soap.") == 1


def test_a_group_of_different_pressures_and_a_missing_jerk_are_said() -> None:
    service, full = (replace(STOP, pressure_bar=x, jerk=Measured(1.0, 0.1)) for x in (2.0, 3.6))
    assert "Group 80 km/h mixes stops of 2.00 to 3.60 bar" in note(service, full)
    assert "mixes" not in note(full, full, replace(service, slides=3))
    fast = replace(full, nominal_speed_kmh=120.0, command_from="pressure")
    assert "Group 80 km/h mixes nominal speeds of 80 and 120 km/h" in note(full, fast)
    assert "mixes commands" in note(full, fast)
    rows = tables(full, fast)["Stops"]
    assert [row["command"] for row in rows] == ["channel", "pressure"]
    assert "jerk" not in note(full)
    assert "No jerk: the speed has fewer than 4 readings" in note(full, replace(full, jerk=None))


def test_a_group_of_one_stop_has_no_statistics() -> None:
    (alone,) = tables(STOP)["Statistics"]
    assert alone == {"group": "80 km/h", "quantity": "one stop", "n": "1"}
    slow = replace(STOP, nominal_speed_kmh=50.0)
    rows = tables(STOP, slow, STOP)["Statistics"]
    assert {row["n"] for row in rows if row["group"] == "80 km/h"} == {"2"}
    (row,) = (row for row in rows if row["group"] == "50 km/h")
    assert {row[x] for x in ("mean", "sd", "common", "scatter [%]")} == {"-"}


def test_a_small_statistic_has_the_digits_of_its_uncertainty() -> None:
    values = (0.14301, 0.14313, 0.14322, 0.14339)
    stops = [replace(STOP, coefficient=Measured(x, 0.0002, 0.00002)) for x in values]
    (row,) = (r for r in tables(*stops)["Statistics"] if r["quantity"] == "µ [-]")
    shown = [row[x] for x in ("mean", "sd", "common", "drift")]
    assert shown == ["0.14319±0.00026", "0.00016", "0.000020", "0.000123±0.000048"]


@pytest.mark.parametrize(
    ("sources", "text"),
    [
        (["train"], "Speed: the train speed."),
        (["axles"], "Speed: the axles, as no train speed is logged."),
        (["axles", "train"], "Speed: the train speed; where none is logged, the axles."),
    ],
)
def test_the_source_of_the_speed_is_one_sentence(sources: list[str], text: str) -> None:
    stops = [replace(STOP, speed_from=x) for x in sources]
    assert text in describe_sources(stops)


def test_a_column_without_a_value_is_neither_shown_nor_explained() -> None:
    full = replace(STOP, pressure_bar=3.0, jerk=Measured(1.0, 0.1))
    assert {"p [bar]", "jerk [m/s³]"} <= {*tables(STOP, full)["Stops"][0]}
    assert not {"p [bar]", "jerk [m/s³]", "µ"} & {*tables(STOP)["Stops"][0]}
    assert "full pressure" in describe_columns(tables(STOP, full)["Stops"])
    assert "full pressure" not in describe_columns(tables(STOP)["Stops"])


def test_a_page_says_below_its_table_why_a_stop_has_no_distance(tmp_path: Path) -> None:
    made = analysed(axles=1, n=400)
    released = replace(STOP, valid=False, reason="the brake was released at 53 km/h")
    summary = replace(summarise(made, {}), stops=(STOP, released, released))
    run = read(written(tmp_path / "log.adhesion.mcap", made))
    text = page([replace(run, summary=summary)])
    sentence = "Without a distance: no whole stop (the brake was released at 53 km/h)."
    assert sentence in text
    assert text.count("the brake was released at 53 km/h") == 1
    assert describe_reasons([STOP]) == ""


def test_initial_adhesion_and_utilisation_have_their_intervals() -> None:
    axles = [
        AxleStop(1, 0.2, 0.0, 0.0, 3, None, 0.049, 0.012, 0.95, (0.93, 0.97)),
        AxleStop(2, 0.2, 0.0, 0.0, 3, None, 0.1, 0.5),
        AxleStop(3, 0.0, 0.0, 0.0, 0),
    ]
    wsp = WspSummary("wet", "dry", None, None, None, None, tuple(axles))
    (table,) = series_tables(StopSeries((), (), (), (), (wsp,)), False, False)
    assert [row["initial µ"] for row in table.rows] == ["0.049±0.012", "not known", "-"]
    assert [row["used [%]"] for row in table.rows] == ["95 (93–97)", "-", "-"]
    assert "not known: the interval of µ" in table.note
    (doubted,) = series_tables(
        StopSeries((), (), (), (), (wsp._replace(vehicle_in_doubt=True),)), False, False
    )
    assert [row["initial µ"] for row in doubted.rows] == ["0.049±0.012?", "not known", "-"]


def test_slip_by_a_train_speed_that_may_be_late_is_a_lower_bound() -> None:
    axles = [AxleStop(i, 0.2, 0.0, 0.0, 3, energy_j=9e4, at_least=i == 1) for i in (1, 2)]
    wsp = WspSummary("wet", "dry", None, None, None, None, tuple(axles))
    (table,) = series_tables(StopSeries((), (), (), (), (wsp,)), False, False)
    shown = [(row["max slip [%]"], row["energy [kJ]"]) for row in table.rows]
    assert shown == [("≥ 20.0", "≥ 90"), ("20.0", "90")]


@pytest.mark.parametrize(("slip", "text"), [(0.2, "≥ 20.0 %"), (1.0, "100 %")])
def test_the_number_of_slides_is_no_lower_bound(slip: float, text: str) -> None:
    axle = AxleStop(1, slip, None, None, 0, at_least=True)
    stops = (SeriesStop("a", "a", None, replace(STOP, slides=3, axles=(axle,))),)
    table, *_ = series_tables(StopSeries(stops, (), (), (), ()), False, False)
    assert f"Stop 1: 3 slides, largest slip {text} (axle 1)." in table.note


def test_a_limit_of_the_equivalent_deceleration_has_the_mean_one_beside_it() -> None:
    stops = [SeriesStop("a", "a", None, replace(STOP, mean_deceleration=Measured(0.8, 0.02)))]
    groups = tuple(group_stops(stops))
    limits = [
        LimitVerdict("a", name, 1.0, "min", 1.1, 0.02, "pass", stops_pass=2, stops_undecided=1)
        for name in ("equivalent_deceleration", "distance_m")
    ]
    tables = series_tables(StopSeries((), groups, (), tuple(limits), ()), False, False)
    (table,) = (x for x in tables if x.title == "Limits")
    assert [row["a [m/s²]"] for row in table.rows] == ["0.800±0.020", "-"]
    assert [row["stops"] for row in table.rows] == ["2 pass, 1 undecided"] * 2
    assert "never decelerates so hard" in table.note


def test_a_limit_without_a_value_is_in_the_table() -> None:
    verdict = LimitVerdict("a", "jerk", 4.0, "max", None, None, "undecided")
    tables = series_tables(StopSeries((), (), (), (verdict,), ()), False, False)
    (table,) = (x for x in tables if x.title == "Limits")
    assert [(row["mean"], row["verdict"]) for row in table.rows] == [("no value", "undecided")]
    assert "no value: no valid stop of the group has the quantity" in table.note


def test_a_coefficient_that_says_nothing_is_not_known() -> None:
    stops = [
        SeriesStop("a", "a", None, replace(STOP, coefficient=Measured(0.0, u95)))
        for u95 in (0.12, 0.05)
    ]
    table, *_ = series_tables(StopSeries(tuple(stops), (), (), (), ()), False, False)
    assert [row["µ"] for row in table.rows] == ["not known", "0.000±0.050"]
    assert "not known: the interval of µ" in table.note


def test_a_coefficient_whose_vehicle_the_log_contradicts_is_marked() -> None:
    stop = replace(STOP, coefficient=Measured(0.1, 0.02))
    stops = [SeriesStop("a", "a", None, stop, in_doubt) for in_doubt in (True, False)]
    table, *_ = series_tables(StopSeries(tuple(stops), (), (), (), ()), False, False)
    assert [row["µ"] for row in table.rows] == ["0.100±0.020?", "0.100±0.020"]
    assert "?: the log contradicts its vehicle" in table.note


@pytest.mark.parametrize("slides", [False, True])
def test_the_figure_of_all_stops_has_one_deceleration_and_its_name(slides: bool) -> None:
    """A stop with slides in the build-up has no equivalent deceleration."""
    equivalent, mean = Measured(1.1, 0.01), Measured(1.0, 0.01)
    decelerations = {"equivalent_deceleration": equivalent, "mean_deceleration": mean}
    stops = [replace(STOP, **decelerations), replace(STOP, **decelerations)]
    if slides:
        stops[1] = replace(stops[1], equivalent_deceleration=None)
    figures = Figures()
    places = figures.of_stops([SeriesStop("a.csv", "a", None, x) for x in stops])
    chart = figures.figures_of(places)[-1]
    shown = {
        float(r.data_source.data["y"][0]) for r in chart.renderers if "y" in r.data_source.data
    }
    assert shown == {1.0 if slides else 1.1}
    assert chart.yaxis[0].axis_label.startswith("Mean" if slides else "Equivalent")
