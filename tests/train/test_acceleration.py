"""A train speed by its acceleration, against simulations that know both."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.simulated import Recordings, simulation, write

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.analysis.prepare import Window, prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import AxleRecord
from adhesion_cli.core.physics import G
from adhesion_cli.formats.open import open_source
from adhesion_cli.rail import sliding
from adhesion_cli.results import mcap
from adhesion_cli.wsp import simulate
from adhesion_cli.wsp.scenario import Sensor

STATED = settings.Settings()


def logged(
    name: str = "low-adhesion", axles: tuple[int, ...] = (1, 2), seed: int = 1, rate: float = 50.0,
    bias: float = 0.15, noise: float = 0.1, speed: bool = False,
) -> Recordings:  # fmt: skip
    """These axles and an accelerometer, without a train speed if not asked for."""
    true = simulation(name)
    sensors = [
        s if s.signal == "train_speed" else replace(s, axles=axles)
        for s in true.scenario.sensor
        if speed or s.signal != "train_speed"
    ]
    sensors.append(Sensor("train_speed", "m/s2", rate, noise_variance=noise**2, offset=bias))
    scenario = replace(true.scenario, sensor=tuple(sensors))
    return simulate.log(replace(true, scenario=scenario, seed=seed))


def changed(log: Recordings, factor: float, unit: str) -> Recordings:
    """With the accelerometer in another unit, or its axis turned."""
    return [
        replace(r, unit=unit, value=factor * r.value) if r.name == "acceleration" else r
        for r in log
    ]


def taken(
    log: Recordings, folder: Path, window: Window = (None, None)
) -> tuple[AxleRecord, dict[str, Finding]]:
    """The first axle's record, and what is told."""
    source = open_source(write(folder / "log.csv", log), STATED.read)
    one = read(source, (), STATED.vehicle)
    prepared = prepare(one, STATED.vehicle, window=window)
    return prepared.records[0], {f.code: f for f in (*one.findings, *prepared.findings)}


def errors(record: AxleRecord, name: str = "low-adhesion") -> tuple[np.ndarray, np.ndarray]:
    """Of the train speed, and its 1 sigma."""
    true = simulation(name)
    assert record.train_speed is not None
    assert record.train_speed_sigma is not None
    return record.train_speed - np.interp(record.t, true.t, true.train_speed), (
        record.train_speed_sigma
    )


@pytest.mark.parametrize(
    ("seed", "bias", "noise", "rate", "factor", "unit"),
    [
        (1, 0.05, 0.05, 200.0, 1.0, "m/s2"),
        (2, 0.3, 0.5, 100.0, -1.0, "m/s^2"),
        (3, -0.3, 0.2, 50.0, 1.0 / G, "g"),
        (4, -0.1, 0.1, 20.0, -1e3 / G, "mg"),
    ],
)
def test_where_all_wheels_slide_the_speed_is_right_within_its_sigma(
    tmp_path: Path, seed: int, bias: float, noise: float, rate: float, factor: float, unit: str
) -> None:
    log = changed(logged(seed=seed, bias=bias, noise=noise, rate=rate), factor, unit)
    record, told = taken(log, tmp_path)
    off, sigma = errors(record)
    assert np.sqrt(np.mean(off**2)) < 0.25
    assert np.mean(np.abs(off) < 1.96 * sigma) > 0.95
    assert sigma.max() < 0.6
    axis = "forwards" if factor > 0.0 else "backwards"
    assert told["train-speed-integrated"].names["axis"] == axis
    assert told["train-speed-integrated"].severity == "info"


def test_sigma_grows_from_where_wheels_roll(tmp_path: Path) -> None:
    record, _ = taken(logged(), tmp_path)
    _, sigma = errors(record)
    t = (record.t - record.t[0]) * 1e-9
    slide = (t > 8.0) & (t < 14.0)  # both wheels slide from 6 s on
    assert (np.diff(sigma[slide]) > 0.0).mean() > 0.9
    assert sigma[slide][-1] > 2.0 * sigma[t < 2.0].min()


def test_a_logged_speed_is_used_and_the_acceleration_is_not(tmp_path: Path) -> None:
    record, told = taken(logged(speed=True), tmp_path)
    assert record.train_speed is not None
    assert record.train_speed_sigma is None
    assert "train-speed-integrated" not in told


def test_without_a_wheel_that_surely_rolls_there_is_no_speed(tmp_path: Path) -> None:
    record, told = taken(logged(), tmp_path, (6.0, 25.0))
    assert record.train_speed is None
    assert told["acceleration-not-usable"].severity == "warning"


def test_what_no_train_feels_makes_no_speed(tmp_path: Path) -> None:
    """The accelerometer lies across, or in another unit."""
    log = logged(bias=0.0, noise=0.1)
    for factor in (0.0, 30.0):
        some = [
            replace(r, value=factor * r.value + 1e-3 * np.sin(r.t * 1e-9))
            if r.name == "acceleration"
            else r
            for r in log
        ]
        record, told = taken(some, tmp_path)
        assert record.train_speed is None
        assert told["acceleration-not-usable"].severity == "warning"


def test_locked_wheels_are_no_train_that_stands(tmp_path: Path) -> None:
    """All four lock on `slippery-stop` without slide protection, and the train goes on."""
    name = "slippery-stop"
    record, _ = taken(logged(name, (1, 2, 3, 4)), tmp_path)
    off, sigma = errors(record, name)
    true = np.interp(record.t, simulation(name).t, simulation(name).train_speed)
    locked = (record.wheel_speed < 0.1) & (true > 1.0)
    assert locked.sum() > 200
    known = locked & np.isfinite(off)
    assert np.mean(np.abs(off[known]) < 1.96 * sigma[known]) > 0.9


def test_while_nothing_is_read_the_speed_is_not_sure(tmp_path: Path) -> None:
    log = logged()
    whole, _ = taken(log, tmp_path)
    gap = [
        replace(r, t=r.t[kept], value=r.value[kept])
        if r.name == "acceleration"
        and (kept := (r.t < 10_000_000_000) | (r.t > 13_000_000_000)) is not None
        else r
        for r in log
    ]
    record, _ = taken(gap, tmp_path)
    off, sigma = errors(record)
    at = np.argmin(np.abs(record.t - 13_000_000_000))
    assert sigma[at] > 2.0 * errors(whole)[1][at]
    known = np.isfinite(off)
    assert np.mean(np.abs(off[known]) < 1.96 * sigma[known]) > 0.95


def test_a_result_analysed_again_is_told_as_its_log_was(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", logged())

    first = analyze.analyze(path, settings.load(), ["leso"], train_speed=True)
    mcap.write_results(tmp_path / "a.adhesion.mcap", [first], "{}")
    again = analyze.analyze(
        tmp_path / "a.adhesion.mcap", settings.load(), ["leso"], train_speed=True
    )
    for a, b in zip(first.axles, again.axles, strict=True):
        np.testing.assert_allclose(a.record.train_speed, b.record.train_speed, atol=1e-6)
        np.testing.assert_allclose(a.record.train_speed_sigma, b.record.train_speed_sigma, 1e-3)

    def told(result: analyze.Result) -> list[str]:
        return [f.message for f in result.findings if f.code == "train-speed-integrated"]

    assert told(first) == told(again)
    # Both wheels slide: what the axles alone tell of it is far off.
    alone = write(tmp_path / "alone.csv", [r for r in logged() if r.name != "acceleration"])
    made = analyze.analyze(alone, settings.load(), ["leso"], train_speed=True)
    true = simulation("low-adhesion")
    off = []
    for result in (first, made):
        r = result.axles[0].record
        s = np.interp(r.t, true.t, np.nan_to_num(true.slip[:, 0]))
        assert r.train_speed is not None
        error = r.train_speed - np.interp(r.t, true.t, true.train_speed)
        off.append(np.sqrt(np.nanmean(error[s > 0.02] ** 2)))
    assert off[0] < 0.5 * off[1]
    assert sliding.slides(first.axles[0])
