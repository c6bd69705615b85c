"""The clock and the offset of a train speed."""

from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import clean, found
from helpers.grids import thinned

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.channels.meaning import Mapping
from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions


@pytest.mark.parametrize(
    ("name", "seconds"),
    thinned(5, ["low-adhesion", "four-axles", "leaf-film"], [-2.0, -1.0, 1.0, 1.8]),
)
def test_the_train_speeds_clock_is_measured(name: str, seconds: float, tmp_path: Path) -> None:
    (told,) = found(simulated.late(clean(name, 1, "as it is"), "train_speed", seconds), tmp_path)
    assert (told.code, told.severity) == ("train-speed-delay", "info")
    measured, doubt = told.values["delay_s"], told.values["delay_u95_s"]
    own = {
        "leaf-film": 0.1,
        "four-axles": -0.025,
    }  # late in the scenario; pulses of a past interval
    assert measured == pytest.approx(seconds + own.get(name, 0.0), abs=0.05 + doubt)


@pytest.mark.parametrize("stated", [1.1, 2.0])
def test_a_stated_delay_is_weighed_against_the_wheels(stated: float, tmp_path: Path) -> None:
    """The wheels of this log show 1.0 s: the stated one is more accurate, or another one."""
    log = simulated.late(clean("low-adhesion", 1, "as it is"), "train_speed", 1.0)
    record_by_delay = {}
    for delay in (None, Parameter(stated, 0.02)):
        mapping = Mapping("train_speed", None, "", delay=delay)
        source = open_source(simulated.write(tmp_path / "log.csv", log), ReadOptions())
        prepared = prepare(read(source, (mapping,) if delay else (), Vehicle()), Vehicle())
        record_by_delay[delay] = prepared.records[0]
    shown = record_by_delay[None].train_speed_late
    used = record_by_delay[Parameter(stated, 0.02)].train_speed_late
    codes = [f.code for f in prepared.findings if f.code.startswith("train-speed")]
    assert shown is not None
    assert used is not None
    if stated == 1.1:
        assert codes == []
        assert shown.value < used.value < stated
        assert used.tolerance < min(0.02, shown.tolerance)
    else:
        assert codes == ["train-speed-delay-differs"]
        assert used == Parameter(2.0, 0.02)


@pytest.mark.parametrize(
    ("name", "plus"),
    thinned(5, ["low-adhesion", "four-axles", "service-brake"], [-1.0, -0.4, 0.4, 1.0]),
)
def test_a_train_speeds_offset_is_no_other_clock(name: str, plus: float, tmp_path: Path) -> None:
    log = simulated.recordings(name, rate=20.0, train=True)
    told = found(simulated.scaled(log, "train_speed", 0, 1.0, plus), tmp_path)
    (offset,) = [f for f in told if f.code.startswith("train-")]
    assert (offset.code, offset.severity) == ("train-speed-offset", "warning")
    measured, doubt = offset.values["offset_mps"], offset.values["offset_u95_mps"]
    assert measured == pytest.approx(plus, abs=doubt)


@pytest.mark.parametrize("seed", [5, 12])
def test_whole_miles_per_hour_once_a_second_are_no_offset(seed: int, tmp_path: Path) -> None:
    rng, t, path = np.random.default_rng(seed), np.arange(0.0, 40.0, 0.1), tmp_path / "log.csv"
    p = 3.0 * np.clip(np.minimum((t - 3.0) / 1.5, (24.0 - t) / 1.5), 0.0, 1.0)
    v = 25.0 - np.cumsum(rng.uniform(0.25, 0.4) * p) * 0.1
    miles = np.round(v / 0.44704)[np.arange(len(t)) // 10 * 10]
    rows = (
        f"{a:.1f},{b:.2f},{3.6 * c + rng.normal(0.0, 0.03):.2f},{d:.0f}\n"
        for a, b, c, d in zip(t, p, v, miles, strict=True)
    )
    head = "time [s],BC pressure [bar],wheel speed [km/h],train speed [mph]\n"
    path.write_text(head + "".join(rows))
    log = read(open_source(path, ReadOptions()), (), Vehicle())
    assert not [f for f in prepare(log, Vehicle()).findings if f.code == "train-speed-offset"]


@pytest.mark.parametrize("way", ["late", "offset"])
def test_a_brake_without_beginning_tells_no_offset_from_a_late_clock(
    way: str, tmp_path: Path
) -> None:
    log = simulated.recordings("paper-constant", rate=20.0, train=True)
    bad = {
        "late": simulated.late(log, "train_speed", 1.0),
        "offset": simulated.scaled(log, "train_speed", 0, 1.0, 1.0),
    }[way]
    (told,) = [f for f in found(bad, tmp_path) if f.code.startswith("train-")]
    assert told.code == "train-speed-delay-or-offset"
    name, unit = ("delay", "s") if way == "late" else ("offset", "mps")
    doubt = told.values[f"{name}_u95_{unit}"]
    assert told.values[f"{name}_{unit}"] == pytest.approx(1.0, abs=0.05 + doubt)


@pytest.mark.parametrize(("least_slip", "is_shown"), [(0.006, True), (0.05, False)])
def test_a_delay_is_shown_by_wheels_that_slide_and_come_back_to_the_trains_speed(
    least_slip: float, is_shown: bool, tmp_path: Path
) -> None:
    rng, t, path = np.random.default_rng(1), np.arange(0.0, 55.0, 0.02), tmp_path / "log.csv"
    slowing = np.where(t < 9.0, 0.02, np.where(t < 11.0, 0.02 + 0.3 * (t - 9.0), 0.62))
    v = np.maximum(27.8 - np.cumsum(slowing) * 0.02, 0.0)
    phase = (t[:, None] / 1.2 + np.arange(4) / 4.0) % 1.0
    slip = np.where(t[:, None] < 11.0, 0.001, least_slip + 0.3 * np.minimum(phase, 1.0 - phase))
    wheels = 3.6 * v[:, None] * (1.0 - slip) + rng.normal(0.0, 0.06, slip.shape)
    wheels = np.where(v[:, None] > 1.0, wheels, 0.0)
    late = 3.6 * np.interp(t - 0.6, t, v) + rng.normal(0.0, 0.1, len(t))
    p = 2.5 * np.clip((t - 9.0) / 2.0, 0.0, 1.0)
    received = [f"{x:.2f}" if k % 50 == 0 else "" for k, x in enumerate(np.maximum(late, 0.0))]
    rows = (
        f"{time:.2f},{train}," + ",".join(f"{pressure:.3f},{w:.2f}" for w in rims) + "\n"
        for time, train, pressure, rims in zip(t, received, p, wheels, strict=True)
    )
    axles = ",".join(f"BC pressure {i} [bar],wheel speed {i} [km/h]" for i in range(1, 5))
    path.write_text(f"time [s],train speed [km/h],{axles}\n" + "".join(rows))
    log = read(open_source(path, ReadOptions()), (), Vehicle())
    delays = [f for f in prepare(log, Vehicle()).findings if f.code.startswith("train-speed")]
    assert [f.code for f in delays if "delay_s" in f.values] == ["train-speed-delay"] * is_shown
    if is_shown:
        assert delays[0].values["delay_s"] == pytest.approx(0.6, abs=0.1)
        assert 0.2 < delays[0].values["delay_u95_s"] < 0.5


def test_a_dry_brake_shows_the_delay_of_a_log_with_a_wet_one(tmp_path: Path) -> None:
    """The wheels slide in the first braking all along, and roll in the second to half the speed."""
    rng, t, path = np.random.default_rng(2), np.arange(0.0, 130.0, 0.04), tmp_path / "log.csv"
    v = np.interp(t, [0, 12, 52, 60, 95, 107, 122, 130], [28, 28, 0, 0, 28, 28, 14, 13.8])
    wet, dry = (t > 12.0) & (t < 52.0), (t > 107.0) & (t < 122.0)
    phase = (t[:, None] / 1.2 + np.arange(4) / 4.0) % 1.0
    slip = np.where(wet[:, None], 0.006 + 0.3 * np.minimum(phase, 1.0 - phase), 0.0)
    slip += 0.006 * dry[:, None]
    wheels = np.maximum(3.6 * v[:, None] * (1.0 - slip) + rng.normal(0.0, 0.05, slip.shape), 0.0)
    radar = np.maximum(3.6 * np.interp(t - 0.3, t, v) + rng.normal(0.0, 0.1, len(t)), 0.0)
    rows = (
        f"{time:.2f},{train:.2f}," + ",".join(f"{3.0 * p:.2f},{w:.2f}" for w in rims)
        for time, train, p, rims in zip(t, radar, wet | dry, wheels, strict=True)
    )
    axles = ",".join(f"BC pressure {i} [bar],wheel speed {i} [km/h]" for i in range(1, 5))
    path.write_text(f"time [s],train speed [km/h],{axles}\n" + "\n".join(rows) + "\n")
    log = read(open_source(path, ReadOptions()), (), Vehicle())
    (delay,) = [f for f in prepare(log, Vehicle()).findings if f.code == "train-speed-delay"]
    assert delay.values["delay_s"] == pytest.approx(0.3, abs=delay.values["delay_u95_s"])
    assert 0.04 < delay.values["delay_u95_s"] < 0.1


def test_wheels_that_never_come_back_are_no_delay_of_a_fast_train_speed(tmp_path: Path) -> None:
    """They slide by 0.8 m/s or more all along: a train speed that is late says the same."""
    t, path = np.arange(0.0, 45.0, 0.05), tmp_path / "log.csv"
    brake = np.clip(t - 8.0, 0.0, 1.0)
    v = np.maximum(25.0 - np.cumsum(0.75 * brake) * 0.05, 0.0)
    phase = (t[:, None] / 1.2 + np.arange(2) / 2.0) % 1.0
    lag = 0.8 + 0.3 * v[:, None] * np.minimum(phase, 1.0 - phase)
    wheels = np.maximum(v[:, None] - lag * brake[:, None], 0.0)
    rows = (
        f"{time:.2f},{3.6 * speed:.2f}," + ",".join(f"{3.0 * p:.2f},{3.6 * w:.2f}" for w in rims)
        for time, speed, p, rims in zip(t, v, brake, wheels, strict=True)
    )
    axles = ",".join(f"BC pressure {i} [bar],wheel speed {i} [km/h]" for i in (1, 2))
    path.write_text(f"time [s],train speed [km/h],{axles}\n" + "\n".join(rows) + "\n")
    log = read(open_source(path, ReadOptions()), (), Vehicle())
    assert not [f for f in prepare(log, Vehicle()).findings if f.code == "train-speed-delay"]


@pytest.mark.parametrize(("seconds", "fall"), [(3.0, 2.0), (30.0, 0.0)])
def test_a_short_log_and_one_without_a_brake_show_no_delay(
    seconds: float, fall: float, tmp_path: Path
) -> None:
    t, path = np.arange(0.0, seconds, 0.1), tmp_path / "log.csv"
    braked = t > 0.6 * seconds
    rows = (
        f"{x:.1f},{3.0 * p:.1f}" + f",{90.0 - fall * x:.2f}" * 2
        for x, p in zip(t, braked, strict=True)
    )
    head = "time [s],BC pressure [bar],wheel speed [km/h],train speed [km/h]\n"
    path.write_text(head + "\n".join(rows) + "\n")
    log = read(open_source(path, ReadOptions()), (), Vehicle())
    assert not [f for f in prepare(log, Vehicle()).findings if f.code == "train-speed-delay"]


def findings_of(folder: Path, columns: dict[str, np.ndarray]) -> dict[str, dict[str, float]]:
    """Values of the findings of a log with these columns, by their codes."""
    file = folder / "log.csv"
    rows = np.column_stack([*columns.values()])
    np.savetxt(file, rows, "%.4f", ",", header=",".join(columns), comments="")
    prepared = prepare(read(open_source(file, ReadOptions()), (), Vehicle()), Vehicle())
    return {f.code: f.values for f in prepared.findings}


def test_the_creep_of_driven_wheels_is_no_delay_of_the_train_speed(tmp_path: Path) -> None:
    t, rng = np.arange(0.0, 80.0, 0.05), np.random.default_rng(3)
    v = np.interp(t, [0, 3, 28, 40, 42, 66, 80], [0, 0, 25, 24.8, 24.0, 0, 0])
    creep = -0.006 * np.gradient(v, t)
    columns = {
        "time [s]": t,
        "bc pressure axle 1 [bar]": 3.0 * ((t > 40.0) & (t < 75.0)),
        "speed axle 1 [km/h]": 3.6 * v * (1.0 - creep) + rng.normal(0.0, 0.02, len(t)) * (v > 0.0),
        "train speed [km/h]": 3.6 * np.interp(t - 0.2, t, v),
    }
    values = findings_of(tmp_path, columns)["train-speed-delay"]
    assert abs(values["delay_s"] - 0.2) < values["delay_u95_s"] < 0.05


def test_a_change_of_the_line_in_a_slow_build_up_is_no_delay_of_the_pressure(
    tmp_path: Path,
) -> None:
    t = np.arange(0.0, 85.0, 0.05)
    p = 3.5 * np.clip((t - 10.0) / 30.0, 0.0, 1.0) * (t < 80.0)
    a = -0.136 * p - 0.012 * ((t > 25.0) & (t < 45.0))  # a curve in the build-up
    v = np.maximum(25.0 + np.cumsum(a) * 0.05, 0.0)
    twice = [np.concatenate([x, x]) for x in (p, 3.6 * v)]
    columns = {
        "time [s]": np.concatenate([t, t + 100.0]),
        "bc pressure axle 1 [bar]": twice[0],
        "speed axle 1 [km/h]": twice[1],
    }
    assert "pressure-delay" not in findings_of(tmp_path, columns)
