"""What valves, wheel slide protection, sanding and commands of a log did, in its report."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bokeh.models import ColumnDataSource
from bokeh.plotting import figure
from helpers.made_results import EPOCH
from helpers.pages import analysed, written

from adhesion_cli.analysis.request import read_log
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.core.model import Channel, Column, Meaning, Result
from adhesion_cli.results.report.plots import Figures
from adhesion_cli.results.report.run import LoggedState, ReportRun, read
from adhesion_cli.results.report.state_plots import draw_lanes, stretches

COLUMNS = "t train rim pressure clamping force lower upper slip truth".split()


def state(values: list[float], *levels: str) -> LoggedState:
    return LoggedState("brake_command", None, np.arange(len(values)) / 10, np.array(values), levels)


def with_states(made: Result) -> Result:
    """The result of a log with a valve, a command in words and a reservoir."""
    t = EPOCH + np.arange(100) * 10**8
    on = (np.arange(100) // 10 % 2).astype(np.float64)

    def channel(meaning: Meaning, axle: int | None, value: np.ndarray, *levels: str) -> Channel:
        data = Column(t, value, np.isfinite(value))
        return Channel(meaning, "", meaning, axle, "", "", data, levels=levels)

    channels = (
        channel("vent_valve", 2, on, "closed", "open"),
        channel("brake_command", None, 2.0 * on, "off", "step 1", "step 2"),
        channel("sanding", None, on),
        channel("reservoir_pressure", None, 9e5 - 1e4 * on),
    )
    log = replace(made.log, channels=(*made.log.channels, *channels))
    return replace(made, log=log)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> ReportRun:
    path = tmp_path_factory.mktemp("run") / "one.adhesion.mcap"
    return read(written(path, with_states(analysed(axles=2, n=1500, rate=25.0))))


def test_a_result_carries_states_and_the_reservoir(run: ReportRun) -> None:
    by_place = {(s.meaning, s.axle): s for s in run.states}
    assert set(by_place) == {
        ("vent_valve", 2), ("brake_command", None), ("sanding", None), ("reservoir_pressure", None),
    }  # fmt: skip
    valve = by_place["vent_valve", 2]
    assert valve.t[10] - valve.t[0] == pytest.approx(1.0)
    assert valve.value[[9, 10, 19, 20]].tolist() == [0, 1, 1, 0]


def test_a_second_analysis_has_the_words_of_states(tmp_path: Path) -> None:
    path = written(
        tmp_path / "one.adhesion.mcap", with_states(analysed(axles=2, n=1500, rate=25.0))
    )
    _, log = read_log(path, Settings())
    levels = {(c.meaning, c.axle): c.levels for c in log.channels if c.levels}
    assert levels == {
        ("vent_valve", 2): ("closed", "open"),
        ("brake_command", None): ("off", "step 1", "step 2"),
    }
    (command,) = (c for c in log.channels if c.meaning == "brake_command")
    assert "'step 2' is 2" in command.reason


def test_states_stand_under_the_speeds_and_valves_with_their_axle(run: ReportRun) -> None:
    figures = Figures()
    drawn = figures.of_run(run)
    assert drawn.overview == [
        "overview-speed", "overview-states", "overview-reservoir", "overview-adhesion",
    ]  # fmt: skip
    assert [place for place in drawn.axles[2] if "states" in place] == ["axle-2-states"]
    assert not [place for place in drawn.axles[1] if "states" in place]
    speed, states = figures.figures_of(drawn.overview[:2])
    assert speed.x_range is states.x_range
    assert [item.label.value for item in states.legend[0].items] == [
        "brake command: step 1, step 2",
        "sanding",
    ]
    (valves,) = figures.figures_of(["axle-2-states"])
    (source,) = valves.select({"type": ColumnDataSource})
    assert (source.data["stop"] - source.data["begin"])[:-1] == pytest.approx(1.0)


def test_a_run_without_states_has_no_figure_of_them(run: ReportRun) -> None:
    without = replace(run, states=())
    assert len(run.states) == 4
    assert "overview-states" not in Figures().of_run(without).overview


def test_words_of_levels_are_shown() -> None:
    fig = figure()
    lanes = state([0, 1, 2, 0], "off", "step 1", "step 2")
    assert list(draw_lanes(fig, [lanes])) == ["brake command: step 1, step 2"]
    (source,) = fig.select({"type": ColumnDataSource})
    assert source.data["state"] == ["step 1", "step 2"]


def test_a_state_holds_until_its_next_sample() -> None:
    begins, stops, values = stretches(state([0, 1, 1, 0, 0, 3]))
    assert begins.tolist() == [0.1, 0.5]
    assert stops.tolist() == pytest.approx([0.3, 0.5])
    assert values.tolist() == [1, 3]


def test_many_changes_keep_their_highest_values() -> None:
    values = [float(k % 2) for k in range(50_000)]
    values[30_000] = 5.0
    begins, _, highest = stretches(state(values))
    assert len(begins) < 2100
    assert highest.max() == 5.0


def test_a_state_ends_at_a_gap_of_the_log_and_holds_to_its_end() -> None:
    times = np.arange(0.0, 10.01, 0.1)
    log_times = times[(times < 2.05) | (times > 4.95)]
    rows = log_times[::5]
    every_row = LoggedState("sanding", None, rows, np.ones(len(rows)))
    begins, stops, _ = stretches(every_row, log_times)
    assert begins == pytest.approx([0.0, rows[rows > 4.0][0]])
    assert stops == pytest.approx([2.0, 10.0])
    on_change = LoggedState("sanding", None, np.array([0.0, 7.0, 9.0]), np.array([1.0, 0.0, 1.0]))
    begins, stops, _ = stretches(on_change, log_times)
    assert begins.tolist() == [0.0, 9.0]
    assert stops == pytest.approx([2.0, 10.0])
    in_gap = LoggedState("sanding", None, times[::5], np.ones(21))  # only wheels have none
    begins, stops, _ = stretches(in_gap, log_times)
    assert (begins.tolist(), stops.tolist()) == ([0.0], [10.0])


def test_nothing_is_drawn_across_a_gap_of_the_log(tmp_path: Path) -> None:
    made = with_states(analysed(axles=1, n=1000))
    (axle,) = made.axles
    outside = np.abs((axle.record.t - EPOCH) * 1e-9 - 5.0) > 1.0
    channels = []
    for channel in made.log.channels:
        x, rows = channel.data, np.abs((channel.data.t - EPOCH) * 1e-9 - 5.0) > 1.0
        data = Column(x.t[rows], x.value[rows], x.valid[rows])
        channels.append(replace(channel, data=data))
    cut = replace(made, log=replace(made.log, channels=tuple(channels)))
    shown = read(written(tmp_path / "cut.adhesion.mcap", cut))
    whole = shown.axles[0]
    columns = {f: getattr(whole, f)[outside] for f in COLUMNS}
    shown = replace(shown, axles=(replace(whole, errors={}, **columns),))
    figures = Figures()
    figures.of_run(shown)
    lanes, reservoir = figures.figures_of(["overview-states", "overview-reservoir"])
    for source in lanes.select({"type": ColumnDataSource}):
        spans = zip(source.data["begin"], source.data["stop"], strict=True)
        assert not any(begin < 4.5 and stop > 5.5 for begin, stop in spans)
    (source,) = reservoir.select({"type": ColumnDataSource})
    assert np.isnan(source.data["y"]).any()


def test_forces_of_motors_stand_with_their_axle(tmp_path: Path) -> None:
    made = analysed(axles=2, n=1500, rate=25.0)
    t = EPOCH + np.arange(100) * 10**8
    data = Column(t, np.full(100, 9e3), np.ones(100, np.bool_))
    ed_force = Channel("ED", "", "ed_force", 1, "kN", "", data)
    made = replace(made, log=replace(made.log, channels=(*made.log.channels, ed_force)))
    figures = Figures()
    drawn = figures.of_run(read(written(tmp_path / "one.adhesion.mcap", made)))
    assert "axle-1-ed-force" in drawn.axles[1]
    assert "axle-2-ed-force" not in drawn.axles[2]
    (fig,) = figures.figures_of(["axle-1-ed-force"])
    (source,) = fig.select({"type": ColumnDataSource})
    assert source.data["y"] == pytest.approx(9.0, rel=1e-3)
