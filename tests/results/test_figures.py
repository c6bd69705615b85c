"""What `--figure` draws: the numbers themselves, and the same bytes again."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.made_results import result

from adhesion_cli.rail import rail_under_slides
from adhesion_cli.rail.slope import REGION_TITLES, Bands
from adhesion_cli.results import charts, figures
from adhesion_cli.wsp import closed_loop, scenario, wsp_controller
from adhesion_cli.wsp.controller import registry
from adhesion_cli.wsp.stop import Stop
from adhesion_cli.wsp.sweep import Compared, SweepRow


@pytest.fixture(scope="module")
def stops() -> list[Stop]:
    long = scenario.load("slippery-stop")
    short = replace(long, train=scenario.ScenarioTrain(speed=9.0), name="short")
    return [closed_loop.run(short, law) for law in registry()]


def by_title(panels: list[charts.Panel], title: str) -> tuple[charts.Panel, dict[str, charts.Line]]:
    (panel,) = [p for p in panels if p.title == title]
    return panel, {line.name: line for line in panel.lines}


def test_a_stop_is_drawn_as_it_was(stops: list[Stop]) -> None:
    bands = wsp_controller.bands({})
    panels = figures.of_stops(stops, 47e3, {"patent": bands})
    for stop in stops:
        who = stop.controller
        _, speeds = by_title(panels, f"{who}: speed, axle 1")
        np.testing.assert_allclose(speeds["wheel"].y, stop.rim_speed[:, 0] * 3.6)
        _, parts = by_title(panels, f"{who}: cylinder, by valve")
        valves = np.stack([parts[name].y for name in ("apply", "hold", "dump")])
        assert (np.isfinite(valves).sum(axis=0) == 1).all()
        np.testing.assert_array_equal(np.isfinite(valves).argmax(axis=0), stop.valve[:, 0])
        np.testing.assert_allclose(np.nanmax(valves, axis=0), stop.pressure[:, 0] * 1e-5)
        curve, points = by_title(panels, f"{who}: µ over slip")
        np.testing.assert_allclose(points["operating point"].x, stop.slip[:, 0] * 100.0)
        np.testing.assert_allclose(points["operating point"].y, stop.force[:, 0] / 47e3)
        np.testing.assert_allclose(points["the rail's peak"].y, stop.peak[:, 0] / 47e3)
        slope, _ = by_title(panels, f"{who}: slope, confidence")
        drawn = [(b.lower, b.upper, b.of_x) for panel in (curve, slope) for b in panel.bands]
        whole = [
            (100.0 * bands.slip_low, 100.0 * bands.slip_high, True),
            (bands.slope_low, bands.slope_high, False),
        ]
        assert drawn == (whole if who == "patent" else [])


def test_the_same_stops_give_the_same_bytes_and_few(stops: list[Stop], tmp_path: Path) -> None:
    for name in ("a.svg", "b.svg"):
        panels = figures.of_stops(stops, 47e3, {"patent": wsp_controller.bands({})})
        charts.write(tmp_path / name, "short", panels)
    content = (tmp_path / "a.svg").read_bytes()
    assert content == (tmp_path / "b.svg").read_bytes()
    assert len(content) < 300_000
    ET.fromstring(content)


def test_points_of_slip_have_the_colour_of_their_region() -> None:
    analysed = result(2, 400)
    axles = []
    for axle in analysed.axles:
        n = len(axle.record)
        s = 0.05 * np.sin(np.arange(n) / 50.0)
        axles.append(replace(axle, slip=s, region=(np.arange(n) % 4).astype(np.int8)))
    made = replace(analysed, axles=tuple(axles))
    of = [rail_under_slides.Summary(a.record.axle, {}, [], None, None, None) for a in axles]
    panels = figures.of_slip(made, of, Bands())
    assert len(panels) == 6  # none slid: all are drawn
    _, lines = by_title(panels, "axle 1: µ over slip, by region")
    assert set(lines) == set(REGION_TITLES)
    braked = np.concatenate([np.arange(s.start, s.stop) for s in axles[0].applications])
    for i, region in enumerate(REGION_TITLES):
        at = np.flatnonzero(np.isfinite(lines[region].x))
        assert at.tolist() == [k for k in braked.tolist() if k % 4 == i]
        np.testing.assert_allclose(lines[region].x[at], 100.0 * axles[0].slip[at])


def test_a_sweep_is_drawn_with_its_intervals(tmp_path: Path) -> None:
    rows = [
        SweepRow(
            rail, law, 500.0,
            {"stopping_distance_m": (700.0 + n, 650.0, 800.0 + n), "utilisation": None,
             "air_nl": (100.0, 90.0, 120.0)}, Compared(None, 0.5),
        )
        for rail in ("wet", "low")
        for n, law in enumerate(("patent", "rule"))
    ]  # fmt: skip
    panels = figures.of_sweep(rows)
    panel, lines = by_title(panels, "Stopping distance")
    assert panel.x_names == ["wet", "low"]
    assert lines["rule"].y.tolist() == [701.0, 701.0]
    assert np.round(lines["rule"].x).tolist() == [0.0, 1.0]
    spread = panel.lines[list(panel.lines).index(lines["rule"]) - 1]
    np.testing.assert_array_equal(spread.y[[0, 1, 3, 4]], [650.0, 801.0, 650.0, 801.0])
    charts.write(tmp_path / "rails.svg", "rails", panels)
    texts = [e.text for e in ET.parse(tmp_path / "rails.svg").iter() if e.tag.endswith("text")]
    assert texts.count("low") == texts.count("rule") == 3
