"""Recordings read back with Rerun's own reader."""

import socket
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import rerun.blueprint as rrb
from helpers.made_results import EPOCH, near, result
from helpers.recordings import batches, column, static
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Channel, Column, Floats, Meaning, Result, Vehicle
from adhesion_cli.core.physics import G
from adhesion_cli.core.text import by_uncertainty
from adhesion_cli.rail import sliding
from adhesion_cli.rail.creep_law import Contact, condition, creep_force
from adhesion_cli.rail.fit import Interval, RailFit
from adhesion_cli.results import palette, rrd, thinning
from adhesion_cli.results.rrd import overview, parts, results

PATCH = Contact().patch(Vehicle().axle_mass.value * G)
ALGORITHMS = ("gradient", "kalman", "leso", "neso", "td")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rrd") / "small.rrd"
    rrd.write_results(path, [result(2, 400)])
    return path


def blueprint(path: Path) -> dict[str, list[Any]]:
    """The components of the layout, by entity and name."""
    reader = RrdReader(path)
    (store,) = reader.blueprints()
    seen: dict[str, list[Any]] = {}
    for chunk in reader.stream(store=store):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if ":" in name:  # a component
                seen.setdefault(f"{chunk.entity_path} {name}", []).extend(batch[name].to_pylist())
    return seen


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks Linux for the threads")
def test_a_recording_leaves_no_thread_of_the_sdk(tmp_path: Path) -> None:
    """Each would keep some MB: those who analyse a folder of logs would run out of memory."""
    analysed, threads = result(1, 50), []
    for i in range(4):
        rrd.write_results(tmp_path / f"{i}.rrd", [analysed])
        threads.append(len(list(Path("/proc/self/task").iterdir())))
    assert max(threads[1:]) - threads[0] < 3, threads


def brake_start(analysed: Result) -> int:
    return min(int(a.record.t[a.applications[0].start]) for a in analysed.axles)


def test_numbers_and_gaps(small: Path) -> None:
    analysed = result(2, 400)
    zero = analysed.log.start_ns()
    for axle in analysed.axles:
        root, record = f"/axle/{axle.record.axle}", axle.record
        most = float(np.nanmax(axle.reference.sigma)) / 32.0
        (first, second) = record.segments
        breaks = [first.stop, second.start]

        def drawn(values: Floats, inside: bool, at: list[int] = breaks) -> Floats:
            values = values.astype(float).copy()
            if inside:
                values[slice(*at)] = np.nan
            return np.insert(values, at, np.nan)

        t, speed = column(small, f"{root}/speed", "scalars")
        expected = np.insert(record.t, breaks, record.t[np.array(breaks) - 1] + 1) - zero
        np.testing.assert_array_equal(t, expected)
        radius = analysed.vehicle.radius(1).value
        assert record.train_speed is not None
        assert record.truth is not None
        np.testing.assert_allclose(speed[:, 0], drawn(record.train_speed * 3.6, False), rtol=1e-15)
        np.testing.assert_allclose(
            speed[:, 1], drawn(record.wheel_speed * radius * 3.6, False), rtol=1e-15
        )
        _, estimates = column(small, f"{root}/force/estimates", "scalars")
        _, errors = column(small, f"{root}/error", "scalars")
        for i, algo in enumerate(ALGORITHMS):
            near(estimates[:, i], drawn(axle.estimates[algo], True), most)
            near(errors[:, i], drawn(axle.error(algo), True), most)
        _, force = column(small, f"{root}/force/reference", "values")
        _, variance = column(small, f"{root}/force/reference", "variances")
        near(force[:, 0], drawn(axle.reference.force, True), most)
        sigma = drawn(axle.reference.sigma, True)
        np.testing.assert_allclose(np.sqrt(variance[:, 0]), sigma, rtol=2.0**-9)
        _, middle = column(small, f"{root}/force/band", "values")
        _, square = column(small, f"{root}/force/band", "variances")
        half = np.sqrt(square[:, 0])
        most += float(np.nanmax(half)) / 512.0
        near(middle[:, 0] - half, drawn(axle.reference.lower, True), most)
        near(middle[:, 0] + half, drawn(axle.reference.upper, True), most)


def test_time_counts_from_the_log_beside_its_clock(small: Path, tmp_path: Path) -> None:
    (batch,) = batches(small, "/axle/1/speed")
    clock, time = (
        batch[name].cast(pa.int64()).to_numpy(zero_copy_only=False) for name in ("clock", "time")
    )
    assert clock.min() == EPOCH
    assert set(clock - time) == {result(2, 400).log.start_ns()}
    rrd.write_results(tmp_path / "a.rrd", [result(1, 50, start=0)])
    (batch,) = batches(tmp_path / "a.rrd", "/axle/1/speed")
    assert "clock" not in batch.schema.names


def test_names_and_colours_do_not_depend_on_the_selection(small: Path, tmp_path: Path) -> None:
    whole = dict(
        zip(
            static(small, "/axle/1/force/estimates", "names"),
            static(small, "/axle/1/force/estimates", "colors"), strict=True,
        )
    )  # fmt: skip
    assert list(whole) == list(ALGORITHMS)
    assert len(set(whole.values())) == 5
    analysed = result(1, 50)
    (axle,) = analysed.axles
    some = replace(axle, estimates={a: axle.estimates[a] for a in ("td", "neso")})
    rrd.write_results(tmp_path / "a.rrd", [replace(analysed, axles=(some,))])
    assert static(tmp_path / "a.rrd", "/axle/1/force/estimates", "names") == ["neso", "td"]
    for entity in ("force/estimates", "error"):
        colours = static(tmp_path / "a.rrd", f"/axle/1/{entity}", "colors")
        assert colours == [whole["neso"], whole["td"]]


def test_an_estimator_with_an_uncertainty_has_a_band(tmp_path: Path) -> None:
    analysed = result(1, 50)
    (axle,) = analysed.axles
    known = replace(axle, sigmas={"neso": np.full(50, 3.0)})
    rrd.write_results(tmp_path / "a.rrd", [replace(analysed, axles=(known,))])
    colours = static(tmp_path / "a.rrd", "/axle/1/force/own", "colors")
    assert colours == [palette.rgba(palette.of_method("neso"))]


def test_events_and_summary(small: Path, tmp_path: Path) -> None:
    def told(entity: str) -> list[str]:
        (batch,) = batches(small, entity)
        return [cell[0] for cell in batch["TextLog:text"].to_pylist()]

    (finding,) = told("/findings/axle/1")
    assert finding == "0.00 s  no-application: speed 1: No brake application found."
    assert all("gap: speed 2" in x for x in told("/findings/axle/2"))
    assert "0.19 s  axle 1: brake applied" in told("/events/axle/1")
    assert not any("axle 2" in x for x in told("/events/axle/1"))
    (text,) = static(small, "/summary", "text")
    assert "| neso | truth |" in text
    assert "**warning** gap\\: speed 2" in text
    (about,) = static(small, "/about", "text")
    assert "Rauch, Tung, Striebel" in about
    assert "| neso.beta1 | 216.0 |" in about

    evil = {"reason": "![](http://evil/) <b> | \x1b[2J", "hint": ""}
    hostile = Finding("not-analysable", "info", "*\u202e", names=evil)
    analysed = replace(result(1, 50), findings=(hostile,))
    rrd.write_results(tmp_path / "a.rrd", [analysed])
    (text,) = static(tmp_path / "a.rrd", "/summary", "text")
    assert "not\\-analysable\\: \\*\\\\u202e\\: " in text
    assert "\\!\\[\\]\\(http\\://evil/\\) \\<b\\> \\| \\\\x1b\\[2J" in text


def test_layout_opens_whole_paused_and_linked(small: Path) -> None:
    seen = blueprint(small)
    # the range that linked charts share: without it they show half a minute
    assert seen[f"/{parts.GLOBAL_VIEW}/TimeAxis TimeAxis:view_range"] == [
        [{"start": None, "end": None}]  # infinite
    ]
    linked = [v for k, v in seen.items() if k.endswith("TimeAxis:link")]
    assert len(linked) == 4 + 2 * (4 + 2 + 1)  # of all axles; of force, of slip, states
    titles = {t[0] for k, v in seen.items() if "display_name" in k for t in v if t}
    speed = "Axle 1: speed [km/h], blue: wheel, grey: train"
    assert {speed, "Axle 2: adhesion force [N]", "Lines"} <= titles
    assert [v for k, v in seen.items() if k.endswith("PlotLegend:visible")] == [[[False]]] * (
        4 + 2 * 6
    )
    assert {f"Axle {N}: {x}" for N in (1, 2) for x in ("findings", "events")} <= titles
    assert "Axle 1: estimate minus truth [N]" in titles
    states = [v for k, v in seen.items() if k.endswith(":play_state")]
    assert states == [[[1]]]  # paused


def test_each_line_is_named_in_its_colour_outside_of_the_charts(small: Path) -> None:
    drawn = {}
    for entity in ("band", "reference", "truth", "estimates"):
        names, colours = (static(small, f"/axle/2/force/{entity}", x) for x in ("names", "colors"))
        drawn |= dict(zip(names, colours, strict=True))
    (batch,) = batches(small, "/lines/axle/2")
    named = {
        text[0].removeprefix("\u25a0 "): colour[0]
        for text, colour in zip(
            batch["TextLog:text"].to_pylist(), batch["TextLog:color"].to_pylist(), strict=True
        )
    }
    assert named == drawn
    (batch,) = batches(small, "/lines/all")
    texts = [text[0] for text in batch["TextLog:text"].to_pylist()]
    assert texts == ["\u25a0 train", "\u25a0 axle 1", "\u25a0 axle 2"]


@pytest.mark.parametrize("axles", [4, 6, 8])
def test_the_names_of_all_axles_and_the_train_have_room(axles: int) -> None:
    """The head of the list takes 55 px, and a name 19 px, of 800 px beside the charts."""
    tab = overview.tab("/", result(axles, n=300), {n: [] for n in range(1, axles + 1)})
    names, summary = tab.contents[1].row_shares
    assert 55 + 19 * (axles + 1) <= 805 * names / (names + summary)


def test_the_axles_are_in_order_and_the_worst_slide_is_open_where_slip_is_asked_for(
    tmp_path: Path,
) -> None:
    analysed = result(2, 400)
    rolls, slides = np.zeros(400), np.where(np.arange(400) // 60 == 2, 0.3, 0.001)
    axles = tuple(
        replace(a, slip=x, record=replace(a.record, clamping_force=np.full(400, 1e4)))
        for a, x in zip(analysed.axles, (rolls, slides), strict=True)
    )
    path, made = tmp_path / "a.rrd", replace(analysed, axles=axles)
    assert [overview.worst(sliding.slides(a)) for a in axles] == pytest.approx(
        [0.0, 0.3], abs=0.001
    )
    rrd.write_results(path, [made])
    (text,) = static(path, "/summary", "text")
    (line,) = [x for x in text.splitlines() if x.startswith("| 2 | ")]
    assert " 30.0 | " in line
    t, drawn = column(path, "/all/slip/2", "scalars")
    assert len(t) == 402
    assert np.nanmax(drawn) == pytest.approx(30.0)
    tabs = results._Page("", made, (), ()).layout().contents
    names = [tab.name for tab in tabs if isinstance(tab, rrb.Container | rrb.View)]
    assert names[:3] == ["All axles", "Axle 1", "Axle 2"]
    turned = replace(made, axles=axles[::-1])
    page = results._Page("", turned, (), ())
    page.notes = (None,)  # the slip was asked for
    noted = page.layout()
    assert noted.active_tab == 2  # the worst slide
    assert [tab.name for tab in noted.contents][:3] == names[:3]
    assert names[-1] == "How this was made, settings"


def test_sparse_result(tmp_path: Path) -> None:
    """No pressure, no truth, no train speed, no slip, no brake application, one sample."""
    analysed = result(1, 50)
    (axle,) = analysed.axles
    record = replace(axle.record, pressure=None, train_speed=None, truth=None)
    bare = replace(axle, record=record, scores=(), applications=(), slip=None, estimates={})
    path = tmp_path / "a.rrd"
    rrd.write_results(path, [replace(analysed, axles=(bare,), findings=())])
    t, force = column(path, "/axle/1/force/reference", "values")
    assert t[0] == 0  # counts from the log's start
    assert len(force) == 52
    assert not batches(path, "/axle/1/force/truth")
    rrd.write_results(path, [replace(analysed, axles=(), findings=())])
    empty = replace(axle, slip=np.full(50, np.nan))
    rrd.write_results(path, [replace(analysed, axles=(empty,))])


def test_comparison_lays_logs_over_one_another(tmp_path: Path) -> None:
    logs = [result(1, 60, name="a.csv"), result(1, 60, start=0, name="b odd/name.mcap")]
    rrd.write_results(tmp_path / "c.rrd", logs)
    first, _ = column(tmp_path / "c.rrd", "/a/axle/1/speed", "scalars")
    second, _ = column(tmp_path / "c.rrd", "/name/axle/1/speed", "scalars")
    np.testing.assert_array_equal(first, second)
    (batch,) = batches(tmp_path / "c.rrd", "/a/axle/1/speed")
    time, brake = (
        batch[name].cast(pa.int64()).to_numpy(zero_copy_only=False) for name in ("time", "brake")
    )
    assert set(time - brake) == {brake_start(logs[0]) - logs[0].log.start_ns()}


def test_a_comparison_opens_on_all_logs_in_one_chart(tmp_path: Path) -> None:
    path, logs = tmp_path / "c.rrd", [result(2, 60, name="runs.csv"), result(1, 90, name="b.csv")]
    rrd.write_results(path, logs)
    root = r"/runs\ \(2\)"  # as one of the logs has the name
    for chart, drawn in (
        ("speed", [a.record.wheel_speed * 3.6 * logs[0].vehicle.radius(1).value for a in (
            logs[0].axles[0], logs[1].axles[0])]),
        ("force", [log.axles[0].reference.force / 1e3 for log in logs]),
    ):  # fmt: skip
        for i, values in enumerate(drawn, 1):
            _, line = column(path, f"{root}/axle/1/{chart}/{i}", "scalars")
            # A force is rounded to a small share of its uncertainty.
            assert np.nanmax(line) == pytest.approx(np.nanmax(values), abs=1e-3)
            colours = static(path, f"{root}/axle/1/{chart}/{i}", "colors")
            assert colours == [palette.rgba(palette.nth(i - 1))]
    assert static(path, f"{root}/axle/1/speed/2", "names") == ["b"]
    assert not batches(path, f"{root}/axle/2/speed/2")  # this log has one axle
    seen = blueprint(path)
    assert [v for k, v in seen.items() if k.endswith(":timeline")] == [[["brake"]]]
    titles = {t[0] for k, v in seen.items() if "display_name" in k for t in v if t}
    assert {"All logs", "Axle 2: adhesion coefficient µ", "runs.csv", "b.csv"} <= titles


def test_a_long_log_is_thinned_between_its_brakes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    analysed = result(1, 4000)
    (axle,) = analysed.axles
    t, where = axle.record.t, slice(1500, 2000)
    axle = replace(axle, applications=(where,), events=())
    path = tmp_path / "a.rrd"
    for limit in (10**9, 1000):
        monkeypatch.setattr(thinning, "LONG_ROWS", limit)
        rrd.write_results(path, [replace(analysed, axles=(axle,))])
        at, drawn = column(path, "/axle/1/speed", "scalars")
        at += analysed.log.start_ns()
        if limit == 10**9:
            every, whole = at, drawn
    assert len(every) == len(t) + 2  # a gap
    near = (every >= t[where.start] - 2 * 10**9) & (every <= t[where.stop - 1] + 2 * 10**9)
    kept = np.isin(at, every[near])
    np.testing.assert_array_equal(drawn[kept], whole[near])
    assert len(at) - kept.sum() < 0.1 * np.count_nonzero(~near)
    _, counts = np.unique(at[~kept] // 500_000_000, return_counts=True)
    assert len(counts) > 40
    assert counts.max() == 1 + (np.isnan(drawn[~kept]).any())
    (about,) = static(path, "/about", "text")
    assert "one sample of each 0.5 s" in about


def test_bands_are_drawn_where_the_result_states_them(tmp_path: Path) -> None:
    analysed = result(1, 400)
    (axle,) = analysed.axles
    n = len(axle.record)
    slip = np.linspace(0.0, 0.1, n)
    curved = replace(axle, slip=slip, slope=np.zeros(n), slope_confidence=np.ones(n))
    stated = {"slip_low": 0.02, "slip_high": 0.06, "slope_low": -0.1, "slope_high": 0.4}
    made = replace(
        analysed, axles=(curved,), settings={**analysed.settings, "bands": stated}
    )  # fmt: skip
    path = tmp_path / "a.rrd"
    rrd.write_results(path, [made])
    t, edges = column(path, "/axle/1/slope/band", "scalars")
    assert edges.tolist() == [[-0.1, 0.4]] * 2
    assert t.tolist() == [
        axle.record.t[0] - made.log.start_ns(),
        axle.record.t[-1] - made.log.start_ns(),
    ]
    edges = [line[0][0] for line in static(path, "/axle/1/slip/band", "strips")]
    assert "green: slip band 2 to 6 %" in static(path, "/axle/1/slip/notes", "labels")
    _, now = column(path, "/axle/1/slip/now", "positions")
    x = np.array([point[0] for (point,) in now])
    known = slip[np.isfinite(axle.reference.force)]
    ends = np.interp([0.02, 0.06], known, x)
    np.testing.assert_allclose(edges, ends, atol=0.5)
    made = replace(made, settings={**made.settings, "bands": {**stated, "slip_high": 0.9}})
    rrd.write_results(path, [made])
    assert len(static(path, "/axle/1/slip/band", "strips")) == 1  # the other lies outside
    rrd.write_results(path, [replace(analysed, axles=(curved,))])
    assert not batches(path, "/axle/1/slope/band")
    assert not batches(path, "/axle/1/slip/band", static=True)


def test_a_fitted_rail_is_drawn_among_the_points(tmp_path: Path) -> None:
    analysed = result(1, 400)
    (axle,) = analysed.axles
    slip = np.linspace(0.0, 0.2, len(axle.record))
    law, path = condition("low"), tmp_path / "a.rrd"
    peak = Interval(0.03, 0.02, 0.05)
    rail = RailFit(law, (), (), {}, 0.05, peak, Interval(0.02, 0.01, 0.03), None, 12.0)
    made = replace(analysed, axles=(replace(axle, slip=slip),))
    rrd.write_results(path, [made], [("a note", rail)])
    _, now = column(path, "/axle/1/slip/now", "positions")
    known = np.isfinite(axle.reference.force)
    x = np.poly1d(np.polyfit(slip[known], [point[0] for (point,) in now], 1))
    curve, (left, right) = static(path, "/axle/1/slip/fit/curve", "strips")
    assert (left[0], right[0]) == pytest.approx((x(0.02), x(0.05)), abs=0.1)
    ((at, _),) = static(path, "/axle/1/slip/fit/peak", "positions")
    assert at == pytest.approx(x(0.03), abs=0.1)
    ruled = static(path, "/axle/1/slip/grid", "strips")
    y = [line[0][1] for line in ruled if line[0][1] == line[1][1]]
    marks = [n for n in static(path, "/axle/1/slip/labels", "labels") if "." in n or n == "0"]
    mu = np.poly1d(np.polyfit(y, [float(n) for n in marks[-len(y) :]], 1))
    for place, height in curve:
        s = (place - x(0.0)) / (x(1.0) - x(0.0))
        force = creep_force(s * 12.0, 12.0, law, PATCH)[0]
        assert mu(height) == pytest.approx(force / PATCH.load, rel=0.02, abs=1e-3)
    assert "fit at 43 km/h" in static(path, "/axle/1/slip/notes", "labels")[0]
    assert static(path, "/axle/1/note", "text") == ["a note"]


@pytest.mark.slow
def test_viewer_shows_every_view(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The real viewer, without a window, on a software renderer (mesa-vulkan-drivers)."""
    drivers = sorted(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"))
    if not drivers:
        pytest.skip("needs a software Vulkan driver")
    monkeypatch.setenv("VK_ICD_FILENAMES", str(drivers[0]))
    monkeypatch.setenv("WGPU_BACKEND", "vulkan")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    from rerun.experimental import ViewerClient

    recording = tmp_path / "a.rrd"
    rrd.write_results(recording, [result(2, 2000)])
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    executable = str(Path(sys.executable).with_name("rerun"))
    with ViewerClient.spawn(
        headless=True, port=port, hide_welcome_screen=True, executable_path=executable
    ) as viewer:
        viewer.open([str(recording)])
        for _ in range(300):
            state = viewer.get_state()
            viewer.take_screenshot(max_size=200)  # draws a frame
            if state.recordings and state.views and not state.loading:
                break
            time.sleep(0.2)
        for _ in range(5):
            viewer.take_screenshot(max_size=200)
        state = viewer.get_state()
    names = sorted(v.name for v in state.views)
    first, second = ([n for n in names if n.startswith(f"Axle {k}: ")] for k in (1, 2))
    assert len(first) == 14
    assert second == [n.replace("Axle 1", "Axle 2") for n in first]
    rest = set(names) - {*first, *second}
    every = {f"All axles: {x}" for x in (
        "speed [km/h]", "adhesion force, reference [kN]", "adhesion coefficient µ", "slip [%]"
    )}  # fmt: skip
    text = {"Lines", "How this was made, settings", "Summary"}
    assert rest == every | text
    assert [(v.name, r.summary) for v in state.views for r in v.reports] == []
    (shown,) = state.recordings
    assert {t.name for t in shown.timelines} == {"time", "clock"}


def test_scores_have_no_column_without_values(small: Path, tmp_path: Path) -> None:
    """What lies right of one would be out of view."""

    def heads(path: Path) -> list[str]:
        (text,) = static(path, "/axle/1/scores", "text")
        return [cell.strip() for cell in text.splitlines()[0].strip("|").split("|")]

    few = heads(small)
    analysed = result(1, 50)
    (axle,) = analysed.axles
    known = tuple(replace(s, band_n=3.0, within=0.9, response_s=0.1) for s in axle.scores[:1])
    some = replace(axle, scores=(*known, *axle.scores[1:]))
    rrd.write_results(tmp_path / "a.rrd", [replace(analysed, axles=(some,))])
    every = heads(tmp_path / "a.rrd")
    assert [x for x in every if x in few] == few
    assert len(every) == len(few) + 3


@pytest.mark.parametrize("most", [128 << 20, 1000])
def test_short_and_long_recordings_hold_the_same(
    tmp_path: Path, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long one is written bit by bit, without the footer that a short one has."""
    monkeypatch.setattr(parts, "_MOST_WAITING", most)
    path = tmp_path / "a.rrd"
    rrd.write_results(path, [result(1, 300)])
    assert path.read_bytes().count(b"RRF2FOOT") == (most > 1000)
    with pytest.warns(RerunWarning) if most == 1000 else nullcontext():
        chunks = list(RrdReader(path).stream())
    rows = sum(chunk.num_rows for chunk in chunks)
    assert rows > 3 * 300


def test_the_first_tab_has_the_adhesion_coefficient_with_its_uncertainty(tmp_path: Path) -> None:
    made = result(10, 400)
    summary = summarise(made, {})
    axles = summary.axles
    rrd.write_results(tmp_path / "a.rrd", [made], summaries=[summary])
    (text,) = static(tmp_path / "a.rrd", "/summary", "text")
    mu = axles[0].applications[0].coefficient
    assert mu
    assert "±".join(by_uncertainty(mu.mean, mu.mean_u95, 3)) in text
    assert "## Groups of axles" in text
    assert ("## Stops" in text) == bool(summary.stops)
    assert [name for name, _ in overview._groups(made)] == ["axles 1–4", "axles 5–8", "axles 9–10"]


def test_a_log_with_coordinates_has_a_map(small: Path, tmp_path: Path) -> None:
    analysed = result(2, 400)
    t = analysed.axles[0].record.t
    usable = np.ones(len(t), np.bool_)
    metres = 20.0 * (t - t[0]) * 1e-9
    places: dict[Meaning, Floats] = {
        "latitude": 50.0 + metres / 111_195.0, "longitude": np.full(len(t), 8.6),
    }  # fmt: skip
    channels = tuple(
        Channel(str(m), "", m, None, "deg", "", Column(t, x, usable)) for m, x in places.items()
    )
    log = replace(analysed.log, channels=(*analysed.log.channels, *channels))
    path = tmp_path / "placed.rrd"
    rrd.write_results(path, [replace(analysed, log=log)])
    (way,) = static(path, "/map/way", "strips")
    ends = np.array(way)[[0, -1]]
    assert ends[0, 1] > ends[1, 1]  # north is up, where y points down
    assert np.ptp(ends[:, 1]) == pytest.approx(100.0, rel=0.1)
    assert static(path, "/map/slides", "strips")
    names = [value for key, value in blueprint(path).items() if "display_name" in key]
    assert "On the line" in str(names)
    assert not batches(small, "/map/way", static=True)


def test_logged_valves_and_sanding_are_states() -> None:
    analysed = result(1, 400)
    record = analysed.axles[0].record
    t = record.t[::40]
    usable = np.ones(len(t), np.bool_)
    open_ = (np.arange(len(t)) % 2).astype(np.float64)
    held = np.ones(len(t))
    states: tuple[tuple[Meaning, int | None, Floats], ...] = (
        ("hold_valve", 1, held),
        ("vent_valve", 1, open_),
        ("vent_valve", 2, held),
        ("sanding", None, open_),
    )
    channels = tuple(
        Channel(f"{m} {axle}", "", m, axle, "", "", Column(t, x, usable)) for m, axle, x in states
    )
    shown = results._logged_states(replace(analysed.log, channels=channels), record)
    codes = {name: code for name, code, _ in shown}
    assert set(codes) == {"valve", "sanding"}
    assert codes["valve"][[0, 39, 40, 79, 80]].tolist() == [1, 1, 2, 2, 1]
    assert codes["sanding"][[0, 40, 80]].tolist() == [0, 1, 0]
    assert not list(results._logged_states(replace(analysed.log, channels=()), record))


def test_commands_and_emergency_are_states_with_their_words() -> None:
    analysed = result(1, 400)
    record = analysed.axles[0].record
    t = record.t[::40]
    steps = np.arange(len(t)) % 3.0

    def shown(values: Floats, *words: str) -> dict[str, tuple[list[int], list[str]]]:
        usable = np.ones(len(t), np.bool_)
        emergency = Channel(
            "e", "", "emergency", None, "", "", Column(t, 1.0 * (values > 1), usable)
        )
        command = Channel(
            "c", "", "brake_command", None, "", "", Column(t, values, usable), levels=words
        )
        log = replace(analysed.log, channels=(emergency, command))
        lanes = results._logged_states(log, record)
        return {n: (codes[::40].tolist(), [x for x, _ in states]) for n, codes, states in lanes}

    lanes = shown(steps, "off", "step 1", "step 2")
    assert lanes["command"][0][:4] == [0, 1, 2, 0]
    assert lanes["command"][1] == ["off", "step 1", "step 2"]
    assert lanes["emergency"][0][:4] == [0, 0, 1, 0]
    assert shown(50.0 * steps)["command"][1] == ["0", "50", "100"]
    assert shown(np.minimum(steps, 1.0))["command"][1] == ["off", "on"]
    assert shown(np.linspace(0.0, 100.0, len(t)))["command"][1] == ["off", "on"]


def test_logged_states_stand_in_the_tab_of_an_axle_without_slip(tmp_path: Path) -> None:
    analysed = result(1, 400)
    (axle,) = analysed.axles
    t = axle.record.t[::40]
    data = Column(t, np.arange(len(t)) % 2.0, np.ones(len(t), np.bool_))
    log = replace(analysed.log, channels=(Channel("v", "", "vent_valve", 1, "", "", data),))
    for channels, has_view in ((log, True), (analysed.log, False)):
        path = tmp_path / f"{has_view}.rrd"
        without_slip = replace(axle, slip=None)
        rrd.write_results(path, [replace(analysed, log=channels, axles=(without_slip,))])
        lanes = [value for key, value in blueprint(path).items() if "ViewContents" in key]
        assert ("$origin/valve/**" in str(lanes)) is has_view
    _, states = column(tmp_path / "True.rrd", "/axle/1/state/valve", "state")
    assert {"apply", "vent"} <= set(states[:, 0].tolist())
    assert not batches(tmp_path / "True.rrd", "/axle/1/state/region")


def test_a_wheel_that_stands_does_not_roll(tmp_path: Path) -> None:
    analysed = result(1, 1200)
    (axle,) = analysed.axles
    assert axle.record.train_speed is not None
    moves = np.arange(1200) < 600
    speed, train = moves * axle.record.wheel_speed, moves * axle.record.train_speed
    stopped = replace(axle, record=replace(axle.record, wheel_speed=speed, train_speed=train))
    path = tmp_path / "a.rrd"
    rrd.write_results(path, [replace(analysed, axles=(stopped,))])
    _, states = column(path, "/axle/1/state/wheel", "state")
    assert states[-1, 0] == "stands"
    assert "rolls" in states[:, 0]


def test_a_force_of_motors_is_a_line_whether_the_vehicle_is_known_or_not(tmp_path: Path) -> None:
    analysed = result(2, 400)
    first, second = analysed.axles
    phi = analysed.vehicle.friction.value
    motors = np.linspace(0.0, 9e3, 400) / phi
    unknown = replace(analysed.identified, known=False)
    for identified, lines in (
        (analysed.identified, ["brake cylinder pressure [bar]", "clamping force K of the axle"]),
        (unknown, ["brake cylinder pressure [bar]"]),
    ):
        path = tmp_path / f"{identified.known}.rrd"
        with_motors = replace(first, record=replace(first.record, motor_clamping=motors))
        axles = (with_motors, second)
        rrd.write_results(path, [replace(analysed, identified=identified, axles=axles)])
        titles = static(path, "/axle/1/braking", "names")
        assert [title.removesuffix(" [10 kN]") for title in titles] == [
            *lines,
            "ED force at the rim",
        ]
        _, values = column(path, "/axle/1/braking", "scalars")
        assert np.nanmax(values[:, -1]) == pytest.approx(0.9)
        assert "ED force at the rim" not in static(path, "/axle/2/braking", "names")


def test_there_is_no_empty_chart_of_a_force_that_is_not_known(tmp_path: Path) -> None:
    analysed = result(2, 400)
    nothing = np.full(400, np.nan)
    axles = tuple(
        replace(
            a,
            reference=replace(a.reference, force=nothing, sigma=nothing),
            estimates=dict.fromkeys(a.estimates, nothing),
        )
        for a in analysed.axles
    )
    unknown = replace(analysed, identified=replace(analysed.identified, known=False), axles=axles)
    for made, is_drawn in ((analysed, True), (unknown, False)):
        path = tmp_path / f"{is_drawn}.rrd"
        rrd.write_results(path, [made])
        names = str([value for key, value in blueprint(path).items() if "display_name" in key])
        charts = ("adhesion force", "adhesion coefficient µ'", "estimate minus")
        assert [chart in names for chart in charts] == [is_drawn] * 3
