"""Sensors that are stuck, saturated or lost: found where they are, and no sound one accused."""

import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from helpers import simulated
from helpers.grids import thinned
from helpers.simulated import Recordings

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Bools, Channel, Column, Floats, Meaning, Result
from adhesion_cli.formats.open import open_source
from adhesion_cli.records import stuck_pressure, stuck_speed
from adhesion_cli.records.faults import runs
from adhesion_cli.wsp import simulate

DEFAULT = settings.load()
QUICK = settings.load(assignments=['analysis.reference="butterworth"'], folder=False)
PARAMS = stuck_pressure.Params()
SENSORS = {
    "speed-stuck", "speed-outlier", "speed-unusable", "pressure-stuck", "pressure-outlier",
    "pressure-saturated", "train-speed-stuck", "train-speed-outlier",
}  # fmt: skip


class Standing(NamedTuple):
    stuck: Bools
    saturated: Bools


def standing(brake: Channel) -> Standing:
    return Standing(*stuck_pressure.standing(PARAMS, brake, runs(brake)))


ALWAYS = simulated.during(0.0, math.inf)


def found(log: Recordings, folder: Path) -> list[Finding]:
    """What the checks of single channels report."""
    return [f for f in simulated.told(log, folder, DEFAULT) if f.code in SENSORS]


def codes(log: Recordings, folder: Path) -> set[str]:
    return {f.code for f in found(log, folder)}


def analysed(log: Recordings, folder: Path) -> Result:
    """A wheel that slides, and one that rolls."""
    path = simulated.write(folder / "log.csv", log)
    return analyze.analyze(path, QUICK, ["leso"], axles=[1, 3])


@cache
def clean(name: str) -> Recordings:
    return simulated.recordings(name, seed=1)


# --- sensors, one channel at a time -------------------------------------------------------------


def pressure(value: np.ndarray, rate: float, step: float = 0.0) -> Channel:
    t = np.round(np.arange(len(value)) * 1e9 / rate).astype(np.int64)
    data = Column(t, value, np.ones(len(t), dtype=np.bool_))
    gap = round(5e9 / rate)
    return Channel(
        "p", "", "pressure", 1, "bar", "", data, len(t), gap_ns=gap, step=step, rate_hz=rate
    )


def application(rate: float, noise: float, step: float) -> np.ndarray:
    """Cylinder pressure [Pa]: 3 s without brake, a ramp to 4 bar, 14 s of hold, a release."""
    t = np.arange(0.0, 24.0, 1.0 / rate)
    p = 4e5 * np.clip((t - 3.0) / 2.0, 0.0, 1.0) * np.clip(22.0 - t, 0.0, 1.0)
    p += noise * np.random.default_rng(3).standard_normal(len(t))
    return np.round(p / step) * step if step else p


@pytest.mark.parametrize("step", [0.0, 200.0, 1000.0, 5000.0, 20000.0])
@pytest.mark.parametrize("noise", [0.0, 20.0, 300.0, 1000.0, 5000.0])
@pytest.mark.parametrize("rate", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("bottom", [-1e9, 0.0])
def test_a_steady_pressure_is_not_a_stuck_one(
    rate: float, noise: float, step: float, bottom: float
) -> None:
    channel = pressure(np.maximum(application(rate, noise, step), bottom), rate, step)
    assert not standing(channel).stuck.any()
    assert not standing(channel).saturated.any()


@pytest.mark.parametrize("at", [1.0, 4.0, 10.0])
def test_a_stuck_pressure_is_found_to_the_sample(at: float) -> None:
    p = application(100.0, 1000.0, 1000.0)
    stuck = slice(round(100 * at), round(100 * at) + 300)
    p[stuck] = p[stuck.start]
    mask = standing(pressure(p, 100.0, 1000.0)).stuck
    assert not mask[: stuck.start - 2].any()  # one or two before may read the same by chance
    assert mask[stuck.start + 1 : stuck.stop].all()
    assert mask[stuck.stop + 2 :].sum() == 0


@pytest.mark.parametrize("seed", range(4))
def test_a_released_pressure_that_reads_zero_is_not_stuck(seed: int) -> None:
    """The sensor reads 0.04 bar too little, and nothing below zero; releases are slow."""
    t, p = np.arange(0.0, 60.0, 0.02), np.zeros(3000)
    for begin, end, top in ((9.0, 23.0, 3e5), (34.0, 49.0, 1.5e5)):
        filling = 1.0 - np.exp((begin - np.maximum(t, begin)) / 0.3)
        p = np.maximum(p, top * np.where(t < end, filling, np.exp((end - t) / 0.8)))
    p += 400.0 * np.random.default_rng(seed).standard_normal(len(t)) - 4000.0
    channel = pressure(np.maximum(0.0, np.round(p / 100.0) * 100.0), 50.0, 100.0)
    assert not standing(channel).stuck.any()


def test_a_saturated_pressure_is_not_a_stuck_one() -> None:
    p = application(25.0, 1000.0, 1000.0)
    stretches = standing(pressure(np.minimum(p, 2e5), 25.0, 1000.0))
    assert stretches.saturated.sum() > 300
    assert not stretches.stuck.any()


# --- sensors that are dead all along ------------------------------------------------------------

MANY = ["four-axles", "low-adhesion", "slippery-stop"]


def with_dead(name: str, signal: str, share: float, train: bool) -> Recordings:
    """A log with axle 2's sensor always at a share of its highest value."""
    log = simulated.recordings(name, train=train)
    top = float(log[simulated.which(log, signal, 2)[0]].value.max())
    return simulated.put(log, signal, 2, ALWAYS, share * top)


def with_train_speed(path: Path) -> Result:
    return analyze.analyze(path, QUICK, ["td"], train_speed=True)


@cache
def speeds_without_axle_2(name: str, train: bool) -> dict[int, Floats | None]:
    """The train speed that each other axle has where the log lacks axle 2."""
    log = [r for r in simulated.recordings(name, train=train) if r.axle != 2]
    with tempfile.TemporaryDirectory() as folder:
        result = with_train_speed(simulated.write(Path(folder, "sound.csv"), log))
    return {a.record.axle: a.record.train_speed for a in result.axles}


@pytest.mark.parametrize(
    ("name", "share", "train"), thinned(7, MANY, [0.0, 0.3, 0.7, 1.0, 1.4], [True, False])
)
def test_a_speed_that_never_changes_is_dead(
    name: str, share: float, train: bool, tmp_path: Path
) -> None:
    dead = with_dead(name, "wheel_speed", share, train)
    result = with_train_speed(simulated.write(tmp_path / "dead.csv", dead))
    told = [f for f in result.findings if f.channel.startswith("wheel_speed_2")]
    assert [(f.code, f.severity, f.first_s < 0.5) for f in told if f.code in SENSORS] == [
        ("speed-stuck", "warning", True)
    ]
    sound = speeds_without_axle_2(name, train)
    assert [a.record.axle for a in result.axles] == [*sound]
    for axle in result.axles:  # nothing of the sound axles changes
        np.testing.assert_array_equal(axle.record.train_speed, sound[axle.record.axle])


@pytest.mark.parametrize(
    ("name", "share", "train"), thinned(5, MANY, [0.0, 0.3, 0.6, 1.0], [True, False])
)
def test_a_pressure_that_never_changes_is_dead(
    name: str, share: float, train: bool, tmp_path: Path
) -> None:
    dead = with_dead(name, "pressure", share, train)
    log = open_source(simulated.write(tmp_path / "log.csv", dead), DEFAULT.read)
    prepared = prepare(read(log, DEFAULT.mappings, DEFAULT.vehicle), DEFAULT.vehicle)
    assert ("pressure-stuck", "warning") in [(f.code, f.severity) for f in prepared.findings]
    assert [record.axle for record in prepared.records] == [1, 3, 4]


def test_a_log_of_a_dead_sensor_alone_says_so(tmp_path: Path) -> None:
    log = simulated.put(clean("low-adhesion"), "wheel_speed", 2, ALWAYS, 50.0)
    path = simulated.write(tmp_path / "log.csv", log)
    with pytest.raises(UserError, match=r"nothing to analyse: wheel_speed_2") as told:
        analyze.analyze(path, DEFAULT, ["td"], axles=[2])
    assert "sensor" in told.value.hint


def test_a_gap_hides_no_dead_sensor(tmp_path: Path) -> None:
    dead = simulated.put(clean("low-adhesion"), "wheel_speed", 2, ALWAYS, 50.0)
    holed = simulated.put(dead, "wheel_speed", 0, simulated.during(12.0, 4.0), math.nan)
    assert "speed-stuck" in codes(holed, tmp_path)


@pytest.mark.parametrize("name", ["four-axles", "service-brake"])
def test_all_wheel_speeds_that_are_stuck_together_differ_from_the_trains(
    name: str, tmp_path: Path
) -> None:
    log = simulated.recordings(name, train=True)
    stuck = simulated.stuck(log, "wheel_speed", 0, 17.0, 3.0)
    told = [f for f in found(stuck, tmp_path) if f.severity == "warning"]
    assert {f.code for f in told} == {"speed-stuck"}
    assert len(told) == len(simulated.which(log, "wheel_speed"))
    for (start, stop), *more in (f.spans for f in told):
        assert not more
        assert 16.5 < start < 17.1  # a coarse speed may repeat by chance before
        assert 19.9 < stop < 20.1


@pytest.mark.parametrize(("name", "kmh", "held"), thinned(5, MANY, [0.0, 1.0], [0.2, 0.5, 2.0]))
def test_slow_and_coarse_speeds_in_a_fast_table_are_not_dead(
    name: str, kmh: float, held: float, tmp_path: Path
) -> None:
    def slow(r: simulate.Recording) -> simulate.Recording:
        last = np.searchsorted(r.t, np.floor(r.t / (held * 1e9)) * held * 1e9)
        return replace(r, value=r.value[np.minimum(last, len(r.t) - 1)])

    log = simulated.changed(simulated.recordings(name, kmh=kmh), "wheel_speed", slow)
    assert "speed-stuck" not in codes(log, tmp_path)


def test_a_train_that_stands_or_runs_evenly_has_no_dead_sensors(tmp_path: Path) -> None:
    for speed in (0.0, 60.0):
        log = clean("low-adhesion")
        even = simulated.put(log, "wheel_speed", 0, ALWAYS, speed)
        even = simulated.put(even, "train_speed", 0, ALWAYS, speed)
        assert "speed-stuck" not in codes(even, tmp_path)


def losses(log: Recordings) -> dict[str, Recordings]:
    """Train speeds as receivers lose them."""
    (v,) = simulated.which(log, "train_speed")
    some = simulated.single(np.random.default_rng(1), 6)
    top = float(log[v].value.max())
    return {
        "train-speed-stuck, 5 s": simulated.stuck(log, "train_speed", 0, 8.0, 5.0),
        "train-speed-stuck, to the end": simulated.stuck(log, "train_speed", 0, 8.0, 1e9),
        "train-speed-stuck, dead": simulated.put(log, "train_speed", 0, lambda _: True, 0.6 * top),
        "train-speed-stuck, zero": simulated.put(log, "train_speed", 0, lambda _: True, 0.0),
        "train-speed-outlier, no fix": simulated.put(
            log, "train_speed", 0, simulated.during(8.0, 3.0), 0.0
        ),
        "train-speed-outlier, before a fix": simulated.put(
            log, "train_speed", 0, simulated.during(0.0, 5.0), 0.0
        ),
        "train-speed-outlier, zeros": simulated.put(log, "train_speed", 0, some, 0.0),
        "train-speed-outlier, twice": simulated.put(log, "train_speed", 0, some, 2.0 * top),
    }


@pytest.mark.parametrize("rate", [5.0, pytest.param(20.0, marks=pytest.mark.slow)])
def test_a_train_speed_that_a_receiver_loses_is_left_out(rate: float, tmp_path: Path) -> None:
    log = simulated.recordings("low-adhesion", rate=rate)
    assert not [f for f in simulated.told(log, tmp_path, DEFAULT) if f.severity == "warning"]
    for fault, bad in losses(log).items():
        told = [f for f in simulated.told(bad, tmp_path, DEFAULT) if f.severity == "warning"]
        assert fault.split(",")[0] in {f.code for f in told}, fault
        assert {f.channel for f in told} == {"train_speed [km/h]"}, (fault, told)


def test_a_roller_rig_turns_at_one_speed(tmp_path: Path) -> None:
    rig = simulated.recordings("roller-rig", rate=20.0)
    (v,) = simulated.which(rig, "train_speed")
    even = simulated.put(rig, "train_speed", 0, lambda _: True, float(np.median(rig[v].value)))
    assert "train-speed-stuck" not in {f.code for f in simulated.told(even, tmp_path, DEFAULT)}


def braking(meaning: Meaning, rate: float, delay: float, step: float, seed: int = 0) -> Channel:
    """Speed [m/s] of a train that coasts from 80 km/h, and brakes at 12 s within half a second."""
    t = np.arange(0.15, 35.0, 1.0 / rate)
    value = np.interp(t - delay, [0.0, 12.0, 12.5, 32.0, 40.0], [22.2, 21.8, 21.5, 0.5, 0.5])
    value += np.random.default_rng(seed).normal(0.0, 0.03, len(t))
    times = np.round(t * 1e9).astype(np.int64)
    data = Column(times, np.round(value / step) * step, np.ones(len(t), dtype=np.bool_))
    gap = round(5e9 / rate)
    return Channel(
        "v", "", meaning, 1, "m/s", "", data, len(t), gap_ns=gap, step=step, rate_hz=rate
    )


def is_train_stuck(train: Channel) -> bool:
    wheel = braking("wheel_speed", 20.0, 0.0, 0.01)
    channels = {("train_speed", None): train, ("wheel_speed", 1): wheel}
    repeats = {key: runs(c) for key, c in channels.items()}
    ((fault,),) = stuck_speed.find_train_faults(stuck_speed.Params(), channels, repeats).values()
    return bool(fault.mask.any())


@pytest.mark.parametrize("delay", [0.0, 0.7, 1.5])
def test_a_late_train_speed_that_repeats_by_rounding_is_not_stuck(delay: float) -> None:
    """A receiver of 2 Hz reads the speed of coasting while the wheels brake already."""
    for seed in range(100):
        train = braking("train_speed", 2.0, delay, 0.1 / 3.6, seed)
        assert not is_train_stuck(train)
        t, y = train.data.t * 1e-9, train.data.value
        held = np.where((t >= 12.0) & (t < 16.0), y[np.argmax(t >= 12.0)], y)
        assert is_train_stuck(replace(train, data=replace(train.data, value=held)))


def test_slip_is_right_beside_a_train_speed_that_was_lost(tmp_path: Path) -> None:
    log = simulated.recordings("low-adhesion", rate=20.0)
    for fault, bad in losses(log).items():
        result = analysed(bad, tmp_path)
        for axle in result.axles:
            if axle.slip is None:
                continue
            true = axle.record.true_slip
            known = np.isfinite(axle.slip) & np.isfinite(true)
            far = np.abs(axle.slip - true)[known] > 0.02 + 0.2 * np.abs(true[known])
            assert far.mean() < 0.05, (fault, axle.record.axle)


def test_what_valves_do_is_no_noise_of_a_pressure_that_stands() -> None:
    """A sensor without noise: about a level while a valve works, then silent while it is held."""
    t = np.arange(0.0, 200.0, 0.2)
    works = np.where(t % 50.0 < 25.0, 0.03 * np.sin(2.0 * np.pi * t / 0.71), 0.0)
    held = np.round((2.0 + works + 0.3 * (t // 50.0)) * 1e5, 2)
    assert not standing(pressure(held, 5.0, 0.01)).stuck.any()


@pytest.mark.parametrize(("rate", "share"), thinned(5, [1.0, 5.0, 50.0], [0.5, 0.8]))
def test_wheel_speeds_at_the_end_of_their_range_are_left_out(
    rate: float, share: float, tmp_path: Path
) -> None:
    log = simulated.recordings("service-brake", rate=rate, train=True)
    cut = simulated.changed(
        log, "wheel_speed", lambda r: replace(r, value=np.minimum(r.value, share * r.value.max()))
    )
    assert ("speed-stuck", "warning") in [(f.code, f.severity) for f in found(cut, tmp_path)]


def test_an_axle_whose_speed_is_lost_early_does_not_cut_what_the_others_show(
    tmp_path: Path,
) -> None:
    """Its record would end the time that all axles share."""
    whole = simulated.late(simulated.recordings("low-adhesion"), "train_speed", 0.4)
    begin = min(r.t[0] for r in whole) * 1e-9
    path = simulated.write(
        tmp_path / "stuck.csv", simulated.stuck(whole, "wheel_speed", 2, begin + 6.0, 1e3)
    )
    result = analyze.analyze(path, QUICK, ["td"])
    codes = {f.code: f for f in result.findings}
    assert codes["axle-left-out"].values["axle"] == 2
    assert 2 not in [axle.record.axle for axle in result.axles]
    assert "train-speed-delay" in codes
    (alone,) = analyze.analyze(path, QUICK, ["td"], [2]).axles
    assert alone.record.axle == 2
