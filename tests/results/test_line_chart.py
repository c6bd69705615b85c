"""µ over the position in a recording: bars of the way, those with slides apart."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.made_results import result
from helpers.recordings import batches, static

from adhesion_cli.core import physics
from adhesion_cli.core.model import Channel, Column, Result
from adhesion_cli.rail import sliding
from adhesion_cli.records.route import find_route
from adhesion_cli.results import rrd
from adhesion_cli.results.rrd.line_views import LineBars, _bar_way, find_bars

SPEED = 20.0  # [m/s]


def placed() -> Result:
    """Two axles, the second with a slide, from km 12 on with a steady speed."""
    made = result(2, 4000)
    t = made.axles[0].record.t
    metres = 12_000.0 + SPEED * (t - t[0]) * 1e-9
    data = Column(t, metres, np.ones(len(t), np.bool_))
    channel = Channel("km", "", "position", None, "m", "", data)
    return replace(made, log=replace(made.log, channels=(*made.log.channels, channel)))


def bars_of(made: Result) -> LineBars:
    slides = {axle.record.axle: sliding.slides(axle) for axle in made.axles}
    return find_bars(made, find_route(made.log), slides)


def test_bars_are_the_mean_of_the_axles_over_the_braked_way() -> None:
    made = placed()
    bars = bars_of(made)
    assert bars.way == 5.0
    t0, mu, at = made.log.start_ns(), [], []
    for axle in made.axles:
        for s in axle.applications:
            at.append(12_000.0 + SPEED * (axle.record.t[s] - t0) * 1e-9)
            force = axle.reference.force[s]
            mu.append(physics.coefficient(force, made.vehicle, axle.record.axle))
    position, coefficient = np.concatenate(at), np.concatenate(mu)
    middle = len(bars.position) // 3
    inside = np.abs(position - bars.position[middle]) <= 2.5 - 1e-6
    assert bars.coefficient[middle] == pytest.approx(np.nanmean(coefficient[inside]), rel=0.02)
    assert bars.position[0] == pytest.approx(position.min(), abs=5.0)
    assert bars.position[-1] == pytest.approx(position.max(), abs=5.0)


def test_bars_with_a_slide_are_apart(tmp_path: Path) -> None:
    made = placed()
    bars = bars_of(made)
    (slide,) = sliding.slides(made.axles[1])
    spans = 12_000.0 + SPEED * (made.axles[1].record.t[slide.samples] - made.log.start_ns()) * 1e-9
    slid = bars.position[bars.slid]
    assert slid.min() == pytest.approx(spans[0], abs=5.0)
    assert slid.max() == pytest.approx(spans[-1], abs=5.0)
    rrd.write_results(tmp_path / "a.rrd", [made])
    (rolls,) = static(tmp_path / "a.rrd", "/line/rolls", "abscissa")
    assert rolls
    assert static(tmp_path / "a.rrd", "/line/slides", "abscissa")


def test_a_log_without_places_has_no_bars(tmp_path: Path) -> None:
    assert not len(bars_of(result(1, 400)).position)
    rrd.write_results(tmp_path / "a.rrd", [result(1, 400)])
    assert not batches(tmp_path / "a.rrd", "/line/rolls", static=True)


@pytest.mark.parametrize(
    ("length", "way"), [(0.0, 5.0), (2_000.0, 5.0), (2_001.0, 10.0), (9_000.0, 50.0), (9e5, 5e3)]
)
def test_the_way_of_a_bar_is_round(length: float, way: float) -> None:
    assert _bar_way(length) == pytest.approx(way)
