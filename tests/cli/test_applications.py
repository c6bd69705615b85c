"""The table of brake applications."""

from collections.abc import Iterable, Sequence
from typing import Any

from adhesion_cli.cli.terminal import budgets
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.summary import (
    AxleSummary,
    BrakeApplication,
    Contribution,
    Coverage,
    FindingSummary,
    LogSummary,
    MeanAndHighest,
    ReferenceSummary,
    ResultSummary,
    VehicleSummary,
    summarise_finding,
)
from adhesion_cli.results.application_tables import application_tables

FITS = {"check": "", "fits": ""}  # that the remedy of `vehicle-suspect` names
MEASURED = MeanAndHighest(0.123, 0.021, 0.234, 0.045)


def one(start: float = 3456.7, slides: int = 0, **more: Any) -> BrakeApplication:
    values: dict[str, Any] = {
        "start_s": start, "end_s": start + 123.4, "from_mps": 83.31, "to_mps": 10.02,
        "coefficient": MEASURED, "force_n": MeanAndHighest(*(1e5 * v for v in MEASURED)),
        "slides": slides, "slide_list": (), "slide_s": 100.2, "slide_distance_m": 1234.5,
        "max_slip": 0.999, "slide_energy_j": 1234567.0, "at_least": False, "utilisation": None,
        "utilisation_ci": None, "budget": None, "coverage": None,
    }  # fmt: skip
    return BrakeApplication(**values | more)


def axle(number: int, *applications: BrakeApplication) -> AxleSummary:
    return AxleSummary(number, ReferenceSummary("smoother", 1.0, 2.0), applications, ())


def tables(
    axles: Sequence[AxleSummary], all_rows: bool = False, findings: Iterable[FindingSummary] = ()
) -> str:
    log, vehicle = (
        LogSummary("a.csv", "csv", "", None, 1.0, 1, 1),
        VehicleSummary("stated", True, *[None] * 4),
    )
    summary = ResultSummary(log, {}, vehicle, tuple(axles), (), tuple(findings))
    return "\n\n".join(x.text() for x in application_tables([summary], all_rows))


def test_a_log_of_three_stops_has_three_rows_per_axle_in_80_columns() -> None:
    axles = [axle(n, *(one(s) for s in (1.0, 200.0, 400.0))) for n in (1, 2)]
    lines = tables(axles).splitlines()
    assert [line.split()[:2] for line in lines[2:8]] == [
        [str(n), s] for n in (1, 2) for s in ("1.0", "200.0", "400.0")
    ]
    assert max(map(len, lines)) <= 80
    assert lines[-1] == "No slides."


def test_slides_are_one_row_per_application_in_80_columns() -> None:
    slid = [one(), one(slides=12, utilisation=0.94), one(slides=3, at_least=True, max_slip=1.0)]
    lines = tables([axle(4, *slid)]).splitlines()
    at = next(i for i, line in enumerate(lines) if "slides" in line and "axle" in line)
    assert max(map(len, lines)) <= 80
    first, second = lines[at + 2 : at + 4]
    assert first.split()[2] == "12"
    assert first.split()[-1] == "94"
    assert "≥" in second
    assert " 100 " in second
    assert "at least" in " ".join(lines[-2:])


def test_the_coefficients_of_a_doubtful_vehicle_have_a_mark() -> None:
    stops = [axle(n, one(1.0), one(200.0)) for n in range(1, 9)]
    suspect = Finding("vehicle-suspect", "warning", values={"factor": 2.0}, names=FITS)
    for all_rows in (True, False):
        sound, marked = (
            tables(stops, all_rows, map(summarise_finding, x)) for x in ((), [suspect])
        )
        assert "?" not in sound
        assert marked.count("0.021?") == sound.count("0.123±0.021")
        assert marked.count("0.045?") == sound.count("0.234±0.045")
        assert "the log contradicts its vehicle" in " ".join(marked.split())


def test_a_highest_force_that_may_be_zero_is_not_known() -> None:
    unsure = one(force_n=MeanAndHighest(12e3, 10e3, None, 20e3))
    shown = tables([axle(1, unsure)])
    assert shown.splitlines()[2].endswith("not known")
    assert "0.234±0.045" in shown
    assert "or of Fmax over the weight, holds both 0 and 0.1" in " ".join(shown.split())


def test_what_the_log_does_not_show_is_a_dash() -> None:
    unknown = one(force_n=None, coefficient=None, from_mps=None, slides=1, slide_energy_j=None)
    lines = tables([axle(1, unknown)]).splitlines()
    assert lines[2].split()[3:] == ["-–36.1", "-", "-", "-", "-"]
    assert tables([axle(1)]) == "No brake application."


def test_a_budget_is_a_table_of_80_columns_with_its_sum() -> None:
    row = Contribution(
        "cylinder_diameter", 0.12951, "m", "B", 1.234e-4, -123456.0, 12345.6, share=1.0
    )
    coverage = Coverage(12345.6, 1.96, None)
    shown = budgets([axle(1, one(budget=(row,), coverage=coverage))])
    lines = shown.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[3].split()[-1] == "100.0"
    assert "freedom: many" in " ".join(lines)
    assert not budgets([axle(1, one(budget=None))])


def test_many_rows_are_one_row_per_stop_worst_first() -> None:
    starts = [500.0 * i for i in range(30)]
    axles = [
        axle(n, *(one(s, slides=1, max_slip=0.4 - 1e-5 * abs(s - 5000.0)) for s in starts))
        for n in (1, 2)
    ]
    shown = tables(axles)
    lines = shown.splitlines()
    assert lines[0] == "20 of 30 stops, most slip first:"
    assert lines[3].split()[0] == "5000.0"
    assert max(map(len, lines)) <= 100
    assert len(tables(axles, all_rows=True).splitlines()) > 60
    assert "Groups of axles" in tables([axle(n, one()) for n in range(1, 33)])
    assert "Groups of axles" not in shown
