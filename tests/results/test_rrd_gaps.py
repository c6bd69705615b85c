"""Gaps of a log in its recording: no line is drawn over one, at any zoom."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.made_results import result
from helpers.recordings import column
from helpers.vehicle_logs import WHOLE

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.core import bundled
from adhesion_cli.core.model import Result
from adhesion_cli.results import rrd, thinning

SAMPLE = (bundled.folder("sample_logs") / bundled.SAMPLE).read_text().splitlines(keepends=True)
SECOND = 10**9


def analysed(path: Path, lines: list[str]) -> Result:
    path.write_text("".join([SAMPLE[0], *lines]))
    return analyze(path, settings.load({"vehicle": WHOLE}, folder=False), ("neso", "imm"))


def seconds(line: str) -> float:
    return float(line.split(",")[0])


@pytest.fixture(scope="module")
def gapped(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The sample log without 7 s of its brake application."""
    lines = [x for x in SAMPLE[1:] if not 8.0 <= seconds(x) < 15.0]
    return analysed(tmp_path_factory.mktemp("gap") / "gap.csv", lines)


def assert_breaks(path: Path, entity: str, component: str = "scalars") -> None:
    """Asserts that no two neighbours with values lie on either side of the gap."""
    t, values = column(path, entity, component)
    assert (np.diff(t) > 0).all()
    known = np.isfinite(values).all(axis=1)
    before, after = np.flatnonzero(t < 8.0 * SECOND)[-1], np.flatnonzero(t > 14.9 * SECOND)[0]
    assert known[: before - 1].any()
    assert known[after:].any()
    assert not known[before : after + 1].all()


FORCES = {
    "force/estimates": "scalars", "force/truth": "scalars", "error": "scalars",
    "force/reference": "values", "force/band": "variances", "force/own": "values",
}  # fmt: skip


def test_no_line_of_an_axle_crosses_a_gap(gapped: Result, tmp_path: Path) -> None:
    rrd.write_results(tmp_path / "a.rrd", [gapped])
    for entity, component in {**FORCES, "speed": "scalars", "braking": "scalars"}.items():
        assert_breaks(tmp_path / "a.rrd", f"/axle/1/{entity}", component)


def test_no_line_crosses_a_gap_that_is_thinned(
    gapped: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thinning, "LONG_ROWS", 100)
    monkeypatch.setattr(thinning, "SAMPLE_INTERVAL", 2 * SECOND)
    (axle,) = gapped.axles
    bare = replace(gapped, axles=(replace(axle, applications=(), events=()),))
    rrd.write_results(tmp_path / "a.rrd", [bare])
    assert len(column(tmp_path / "a.rrd", "/axle/1/speed", "scalars")[0]) < 100
    for entity, component in {**FORCES, "speed": "scalars"}.items():
        assert_breaks(tmp_path / "a.rrd", f"/axle/1/{entity}", component)


def test_no_line_of_several_logs_crosses_a_gap(gapped: Result, tmp_path: Path) -> None:
    rrd.write_results(tmp_path / "c.rrd", [gapped, result(1, 60, name="b.csv")])
    for chart in ("speed", "force", "coefficient"):
        assert_breaks(tmp_path / "c.rrd", f"/runs/axle/1/{chart}/1")


def test_a_clock_set_back_is_drawn_where_its_times_are_new(tmp_path: Path) -> None:
    lines = []
    for line in SAMPLE[1:]:
        t, rest = line.split(",", 1)
        lines.append(f"{float(t) - 3.0 * (float(t) >= 12.0):.3f},{rest}")
    made, path = analysed(tmp_path / "back.csv", lines), tmp_path / "a.rrd"
    rrd.write_results(path, [made])
    (axle,) = made.axles
    first, second = (axle.record.t[s] - made.log.start_ns() for s in axle.record.segments)
    for entity in ("speed", "force/reference", "force/estimates"):
        component = "values" if entity == "force/reference" else "scalars"
        t, values = column(path, f"/axle/1/{entity}", component)
        known = np.isfinite(values).all(axis=1)
        expected = np.concatenate([first, second[second > first[-1] + 1]])
        np.testing.assert_array_equal(t[known], expected)
        assert not known[np.searchsorted(t, first[-1]) + 1]  # no line from before to after
