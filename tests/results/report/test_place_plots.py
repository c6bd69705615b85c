"""Figures over the line: µ over the kilometre, and the map."""

from dataclasses import replace

import numpy as np
import pytest
from bokeh.models import ColumnDataSource
from helpers.pages import analysed, written

from adhesion_cli.core.model import Column, Floats, Meaning
from adhesion_cli.records.route import make_route
from adhesion_cli.results.plane import position_label
from adhesion_cli.results.report.plots import Figures
from adhesion_cli.results.report.run import ReportRun, read

SPEED = 20.0  # [m/s]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> ReportRun:
    path = tmp_path_factory.mktemp("run") / "one.adhesion.mcap"
    return read(written(path, analysed(axles=2, n=1500, rate=25.0)))


def placed(run: ReportRun, *meanings: Meaning) -> ReportRun:
    """The run from km 12 to the north with 20 m/s."""
    seconds = np.arange(0.0, float(run.axles[0].t[-1]) + 1.0, 0.5)
    metres = SPEED * seconds
    values: dict[Meaning, Floats] = {
        "position": 12_000.0 + metres, "distance": metres,
        "latitude": 50.0 + metres / 111_195.0, "longitude": np.full(len(seconds), 8.6),
    }  # fmt: skip
    t = run.start_ns + np.round(1e9 * seconds).astype(np.int64)
    usable = np.ones(len(t), np.bool_)
    return replace(run, route=make_route({m: Column(t, values[m], usable) for m in meanings}))


def test_a_run_without_places_has_no_figures_of_them(run: ReportRun) -> None:
    assert Figures().of_run(run).places == []


def test_adhesion_stands_over_the_kilometre(run: ReportRun) -> None:
    figures, on_line = Figures(), placed(run, "position")
    places = figures.of_run(on_line).places
    assert places == ["places-adhesion"]
    (fig,) = figures.figures_of(places)
    assert fig.xaxis[0].axis_label == "position on the line [km]"
    sources = [s for s in fig.select({"type": ColumnDataSource}) if "km" in s.data]
    km = np.concatenate([np.asarray(s.data["km"]) for s in sources])
    km = km[np.isfinite(km)]
    braked = [(a.start_s, a.end_s) for x in run.axles for a in x.applications]
    begin, stop = min(braked)[0], max(stop for _, stop in braked)
    assert km.min() == pytest.approx(12.0 + SPEED * begin / 1e3, abs=0.006)
    assert km.max() == pytest.approx(12.0 + SPEED * stop / 1e3, abs=0.006)


def test_the_way_since_the_start_is_no_kilometre(run: ReportRun) -> None:
    assert position_label(placed(run, "distance").route) == "way since the start of the log [km]"


def test_coordinates_give_a_map(run: ReportRun) -> None:
    figures, on_map = Figures(), placed(run, "position", "latitude", "longitude")
    places = figures.of_run(on_map).places
    assert places == ["places-adhesion", "places-map"]
    fig = figures.figures_of(places)[1]
    assert fig.match_aspect
    texts = [t for s in fig.select({"type": ColumnDataSource}) for t in s.data.get("text", [])]
    assert "km 13" in texts or SPEED * run.axles[0].t[-1] < 1000.0
