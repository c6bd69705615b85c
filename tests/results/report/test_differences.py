"""Differences of runs: what they share cancels, and their uncertainty is that of drawn errors."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bokeh.models import Line
from helpers import made_results
from helpers.pages import EVIL, Elements, figures, written

from adhesion_cli.analysis.settings import Settings, tree
from adhesion_cli.core.model import Z95, LogBrake, Parameter, Vehicle
from adhesion_cli.results import palette
from adhesion_cli.results.report import comparison, differences, page
from adhesion_cli.results.report.plots import Figures
from adhesion_cli.results.report.run import ReportRun, read

RELATED = Vehicle(correlation=(("friction", "axle_mass", 0.8),))


def made(path: Path, vehicle: Vehicle = RELATED, **of: Any) -> ReportRun:
    result = made_results.result(**of)
    settings = tree(Settings(vehicle), [])
    return read(
        written(
            path,
            replace(
                result, identified=replace(result.identified, vehicle=vehicle), settings=settings
            ),
        )
    )


def with_log(run: ReportRun, **changed: str) -> ReportRun:
    log = run.summary.log._replace(**changed)
    return replace(run, summary=replace(run.summary, log=log))


def with_brake(run: ReportRun, brake: LogBrake) -> ReportRun:
    return replace(run, summary=replace(run.summary, brake=brake))


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> list[ReportRun]:
    """The same train twice; axle 2 slides, and brakes for another time."""
    folder = tmp_path_factory.mktemp("runs")
    return [made(folder / f"{n}.mcap", axles=2, n=n) for n in (3000, 4500)]


def test_of_a_run_and_itself_only_noise_is_left(pair: list[ReportRun]) -> None:
    for d in differences.compare([pair[0], pair[0]]):
        assert (d.difference, d.alike) == (0.0, True)
        one = pair[0].axles[d.axle - 1].applications[0]
        noise = next(r.contribution_n for r in one.budget or () if r.quantity == "noise")
        if d.quantity == "force":
            assert one.force_n is not None
            assert d.u95 == pytest.approx(Z95 * np.sqrt(2.0) * noise, rel=0.01)
            assert d.u95_apart == pytest.approx(np.sqrt(2.0) * one.force_n.mean_u95, rel=0.01)
            assert d.u95 < 0.5 * d.u95_apart


def test_the_uncertainty_is_that_of_drawn_errors(pair: list[ReportRun]) -> None:
    """Errors of the parameters are drawn once for both runs, those of noise for each."""
    rng, n = np.random.default_rng(5), 400_000
    found = {(d.axle, d.quantity): d for d in differences.compare(pair)}
    for axle in (1, 2):
        ones = [run.axles[axle - 1].applications[0] for run in pair]
        of = [{row.quantity: row for row in one.budget or ()} for one in ones]
        assert of[0].keys() == of[1].keys()
        unit = {name: rng.normal(size=n) for name in sorted({*of[0], "axle_mass"})}
        unit["axle_mass"] = 0.8 * unit["friction"] + 0.6 * rng.normal(size=n)  # as stated
        forces = []
        for one, rows in zip(ones, of, strict=True):
            assert one.force_n is not None
            errors = [r.sensitivity * r.u * unit[q] for q, r in rows.items() if q != "noise"]
            noise = rng.normal(size=n) * rows["noise"].u
            forces.append(one.force_n.mean + sum(errors) + noise)
        difference = forces[1] - forces[0]
        d = found[axle, "force"]
        assert np.mean(difference) == pytest.approx(d.difference, abs=0.02 * d.u95)
        assert Z95 * np.std(difference) == pytest.approx(d.u95, rel=0.02)
        mass = RELATED.axle_mass
        weight = pair[0].axles[0].weight * (1.0 + mass.tolerance / mass.value * unit["axle_mass"])
        d = found[axle, "coefficient"]
        assert Z95 * np.std(difference / weight) == pytest.approx(d.u95, rel=0.02)


@pytest.mark.parametrize(("ratio", "least"), [(1.0, 0.054), (1.1, 0.1)])
def test_friction_of_another_log_may_be_another_one(
    ratio: float, least: float, pair: list[ReportRun]
) -> None:
    """By 2 % (1 sigma) in each, and by what the logs' decelerations differ."""
    brake = LogBrake(0.46, 0.95, 0.06, 2.9, 14.0)
    first_run, same_log = (with_brake(run, brake) for run in pair)
    other_log = with_brake(with_log(pair[1], sha256="f" * 64), brake._replace(ratio=0.95 * ratio))
    differences_of_same = differences.compare([first_run, same_log])
    for a, b in zip(differences_of_same, differences.compare([first_run, other_log]), strict=True):
        if a.quantity != "utilisation":
            runs = (run.axles[a.axle - 1].applications[0] for run in pair)
            values = (getattr(x, "force_n" if a.unit == "N" else "coefficient").mean for x in runs)
            added = np.sqrt(b.u95**2 - a.u95**2) / max(map(abs, values))
            assert least < added < least + 0.02
            assert b.u95_apart >= b.u95


def test_what_runs_state_differently_does_not_cancel(pair: list[ReportRun], tmp_path: Path) -> None:
    other = replace(RELATED, friction=Parameter(0.31, 0.03))
    run = made(tmp_path / "x.mcap", other, axles=2, n=4500)
    assert differences.same_vehicle(pair[0], pair[1])
    assert not differences.same_vehicle(pair[0], run)
    same = {d[:4]: d for d in differences.compare(pair)}
    for d in differences.compare([pair[0], run]):
        if d.quantity == "force":
            assert d.u95 > 3.0 * same[d[:4]].u95


def test_a_difference_by_the_settings_alone_is_said_first(
    pair: list[ReportRun], tmp_path: Path
) -> None:
    other = replace(
        RELATED,
        friction=Parameter(0.31, 0.03),
        axle_mass=Parameter(9e3, 100.0),
        correlation=(("friction", "axle_mass", 0.7),),
    )
    same = made(tmp_path / "x.mcap", other, axles=2, n=3000)
    apart = with_log(same, sha256="other")
    first = with_log(pair[0], sha256=same.summary.log.sha256)
    for run in (same, apart):
        (said,) = comparison.cautions([first, run])
        assert "vehicle.friction" in said
        assert "vehicle.axle_mass" in said
        assert "correlation" not in said
        assert "vehicle.lever_ratio" not in said
        assert ("SHA-256" in said) == (run is same)
    (said,) = comparison.cautions([first, same, same])
    assert said.startswith("Runs 2 and 3: ")
    third = with_log(pair[1], sha256="third")
    assert not list(comparison.cautions([first, third]))


def test_logs_that_adapt_one_stated_vehicle_are_of_no_other_vehicle(
    pair: list[ReportRun], tmp_path: Path
) -> None:
    stated = replace(pair[0].summary.vehicle, source="stated", force_per_bar_n=4400.0)
    adapted = replace(RELATED, friction=Parameter(0.31, 0.03))
    runs = [pair[0], with_log(made(tmp_path / "b.mcap", adapted, axles=2, n=3000), sha256="other")]
    vehicles = stated, replace(stated, force_per_bar_n=4600.0)
    first, second = (
        replace(run, summary=replace(run.summary, vehicle=vehicle))
        for run, vehicle in zip(runs, vehicles, strict=True)
    )
    (text,) = comparison.cautions([first, second])
    assert "another vehicle" not in text
    assert "4.400 and 4.600 kN per bar" in text


def test_brackets_are_explained_only_where_there_are_some(pair: list[ReportRun]) -> None:
    for runs in (pair, [pair[0], with_log(pair[0], sha256="x")]):
        text = page.page(runs)
        shown = re.search(r"± [\d.]+ \(", text) is not None
        assert ("brackets" in text) == shown


def test_axles_that_only_one_run_has_are_left_out(pair: list[ReportRun], tmp_path: Path) -> None:
    run = made(tmp_path / "x.mcap", axles=1, n=3000)
    assert {d.axle for d in differences.compare([run, pair[1]])} == {1}
    assert differences.unpaired([run, pair[1]])
    assert not differences.unpaired(pair)


def test_a_page_of_several_runs_overlays_them_from_the_start_of_braking(
    pair: list[ReportRun], tmp_path: Path
) -> None:
    runs = [pair[0], with_log(pair[1], path=EVIL)]
    text = page.page(runs)
    assert page.page(runs) == text
    found = Elements(text)
    assert "img" not in {tag for tag, _ in found.elements}
    places = {a["id"] for tag, a in found.elements if a.get("class") == "figure"}
    of: Any = figures(text)
    assert set(of["roots"].values()) == places == {f"axle-{n}-{i}" for n in (1, 2) for i in (0, 1)}
    axes = {r["attributes"]["x_range"]["id"] for r in of["doc"]["roots"]}
    assert len(axes) == 1
    assert "run 2" in found.texts  # a row of the table of all runs
    assert "onerror" not in str(of)
    assert runs[0].brake_s != runs[1].brake_s


def test_runs_with_other_brakes_have_no_difference_of_adhesion(pair: list[ReportRun]) -> None:
    brake = LogBrake(0.46, 0.92, 0.03, 2.9, 14.0)
    runs = [
        with_brake(pair[0], brake),
        with_brake(pair[1], brake),
        with_brake(pair[1], brake._replace(deceleration_per_bar=0.55, ratio=1.10)),
    ]
    compared = {(d.run, d.quantity) for d in differences.compare(runs)}
    assert {(2, "force"), (2, "coefficient")} <= compared
    assert not {(3, "force"), (3, "coefficient")} & compared
    text = page.page(runs)
    assert differences.friction_findings(runs)[0].message in text
    assert "adhesion calibrate stop.csv -c my-train.toml -o brake-2.toml" in text
    assert "run 2" not in Elements(text).texts  # nor is their µ in one table
    drawn: Any = figures(text)
    assert set(drawn["roots"].values()) == {"axle-1-0", "axle-2-0"}


def test_runs_whose_logs_show_other_brakes_are_compared_and_named(pair: list[ReportRun]) -> None:
    """Each has the vehicle of its own log, so µ is right in both; the pads still differ."""
    runs = []
    for run, per_bar in zip(pair, (0.46, 0.55), strict=True):
        own = with_brake(run, LogBrake(per_bar, 1.0, 0.03, 2.9, 14.0))
        vehicle = replace(own.summary.vehicle, source="log")
        runs.append(replace(own, summary=replace(own.summary, vehicle=vehicle)))
    (finding,) = differences.friction_findings(runs)
    assert finding.values["factor"] == pytest.approx(0.55 / 0.46)
    assert (2, "coefficient") in {(d.run, d.quantity) for d in differences.compare(runs)}
    assert not differences.friction_findings([runs[0], runs[0]])


def test_a_small_difference_has_the_digits_of_its_uncertainty(pair: list[ReportRun]) -> None:
    found = [d for d in differences.compare([pair[0], pair[0]]) if d.quantity == "coefficient"]
    for d, row in zip(found, comparison._rows(found), strict=True):
        shown = float(row["Adhesion coefficient, mean"].split()[3])
        assert shown == pytest.approx(d.u95, rel=0.06)


def test_the_line_of_a_run_lies_on_that_of_the_train(pair: list[ReportRun]) -> None:
    drawn = Figures()
    speed, _ = drawn.figures_of(drawn.of_runs(pair)[1])
    colours = [x.glyph.line_color for x in speed.renderers if isinstance(x.glyph, Line)]
    assert colours == [palette.BLACK, palette.nth(0), palette.BLACK, palette.nth(1)]
