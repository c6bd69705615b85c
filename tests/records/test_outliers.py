"""Drop-outs, spikes and dead stretches: found to the sample; slides and dumps are none."""

from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.channels.to_si import quantum
from adhesion_cli.core.model import Bools, Channel, Column, Floats, Meaning
from adhesion_cli.records import outliers

LIMITS = outliers.Params()
KMH = 1.0 / 3.6 / 0.42  # [rad/s]
STEPS = [0.0, 1e-3, 0.1 * KMH, KMH]


def channel(t: Floats, value: Floats, meaning: Meaning) -> Channel:
    ns = np.round(t * 1e9).astype(np.int64)
    every = int(np.median(np.diff(ns)))
    data = Column(ns, value, np.ones(len(t), dtype=np.bool_))
    return Channel(
        "c", "", meaning, 1, "", "", data, len(t), gap_ns=5 * every, step=quantum(value),
        rate_hz=1e9 / every,
    )  # fmt: skip


def drawn(
    rate: float, curve: tuple[Floats, Floats], noise: float, step: float, held: float = 0.0
) -> tuple[Floats, Floats]:
    """Times and values of a sensor on a curve of straight lines, in a table of this rate."""
    t = np.arange(0.0, curve[0][-1], 1.0 / rate)
    at = np.floor(t * held + 1e-9) / held if held else t
    x = np.interp(at, *curve)
    own, which = np.unique(at, return_inverse=True)
    x += (x > 0.0) * np.random.default_rng(7).normal(0.0, noise, len(own))[which]
    return t, np.round(x / step) * step if step else x


def lines(*points: tuple[float, float]) -> tuple[Floats, Floats]:
    t, x = np.array(points).T
    return t, x


# A stop from 25 m/s; the same with slides of 30 m/s² at the rim, one to a locked wheel, and back.
STOP = lines((0, 60), (2, 60), (22, 10), (23, 7.5))
SLIDES = lines(
    (0, 60), (2, 60), (4, 55), (4.4, 27), (4.7, 27), (4.9, 52), (8, 45), (8.65, 0), (10, 0),
    (10.3, 38), (12, 34), (12.1, 27), (12.2, 33), (20, 12), (20.2, 0), (24, 0),
)  # fmt: skip
BRAKE = lines((0, 0), (2, 0), (4, 3e5), (20, 3e5), (22, 0), (24, 0))
DUMPS = lines(
    (0, 0), (2, 0), (3, 4e5), (6, 4e5), (6.2, 0), (6.3, 0), (6.7, 4e5), (9, 4e5), (9.1, 1e5),
    (9.4, 4e5), (12, 4e5), (12.2, 0), (15, 0), (15.5, 4e5), (20, 4e5), (20.2, 0), (24, 0),
)  # fmt: skip


@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0, 20.0, 100.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, 3e-3, 0.1])
@pytest.mark.parametrize("step", STEPS)
def test_a_slide_is_none(rate: float, noise: float, step: float) -> None:
    for curve in (STOP, SLIDES):
        for held in (0.0, rate / 10.0):
            t, y = drawn(rate, curve, noise, step, held)
            assert not outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed")).any(), held


@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0, 20.0, 100.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, 500.0, 3000.0])
@pytest.mark.parametrize("step", [0.0, 1000.0, 10_000.0])
def test_a_dump_is_none(rate: float, noise: float, step: float) -> None:
    for curve in (BRAKE, DUMPS):
        for held in (0.0, rate / 10.0):
            t, p = drawn(rate, curve, noise, step, held)
            assert not outliers.brake_outliers(LIMITS, channel(t, p, "pressure")).any(), held
            assert not outliers.brake_outliers(
                LIMITS, channel(t, p / 20.0, "clamping_force")
            ).any(), held


def test_simulated_steps_are_none() -> None:
    for times in ((2.0, 20.0), (2.0,), (2.0, 3.0), (2.0, 8.0, 8.5, 20.0)):
        t = np.arange(0.0, 24.0, 0.01)
        K = 21e3 * (np.searchsorted(times, t, side="right") % 2)
        if len(times) != 2 or np.ptp(times) > 3.0:
            assert not outliers.brake_outliers(LIMITS, channel(t, K, "clamping_force")).any(), times


def test_a_sensor_that_reads_zero_below_3_kmh_is_none() -> None:
    for noise in (0.0, 3e-3):
        t, y = drawn(100.0, lines((0, 20), (2, 20), (10, 0), (12, 0)), noise, 0.0)
        y[y < 3.0 * KMH] = 0.0
        for x in (y, y[::-1]):
            assert not outliers.wheel_outliers(LIMITS, channel(t, x, "wheel_speed")).any()


SECONDS = [0.0, 0.03, 0.2, 1.0, 2.5]


def during(t: Floats, starts: tuple[float, ...], seconds: float) -> Bools:
    """The samples of several stretches, one sample of each at least."""
    longer = max(seconds, float(t[1] - t[0])) - 1e-6
    since = np.subtract.outer(t, starts)
    return ((since > -1e-6) & (since < longer)).any(axis=1)


@pytest.mark.parametrize("rate", [5.0, 10.0, 50.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, 3e-3, 0.05])
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("value", [0.0, 300.0])
def test_what_a_dead_speed_sensor_says_is_found(
    rate: float, noise: float, step: float, value: float
) -> None:
    for seconds in SECONDS:
        t, y = drawn(rate, STOP, noise, step)
        dead = during(t, (3.0, 6.3, 9.7), seconds)  # 60 … 40 rad/s
        y[dead] = value
        found = outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed"))
        assert (found == dead).all(), (seconds, found.sum(), dead.sum())


@pytest.mark.parametrize("rate", [20.0, 50.0, 500.0])
@pytest.mark.parametrize("noise", [0.0, 500.0, 3000.0])
@pytest.mark.parametrize("step", [0.0, 1000.0])
@pytest.mark.parametrize("value", [0.0, 8e5])
def test_what_a_dead_pressure_sensor_says_is_found(
    rate: float, noise: float, step: float, value: float
) -> None:
    for seconds in SECONDS:
        t, p = drawn(rate, BRAKE, noise, step)
        dead = during(t, (5.0, 10.0, 15.0), seconds)
        p[dead] = value
        for meaning, factor in (("pressure", 1.0), ("clamping_force", 0.05)):
            found = outliers.brake_outliers(LIMITS, channel(t, factor * p, meaning))  # type: ignore[arg-type]
            assert (found == dead).all(), (seconds, meaning, found.sum(), dead.sum())


def test_a_speed_sensor_that_dies_for_good_is_found() -> None:
    t, y = drawn(50.0, STOP, 3e-3, 0.0)
    for value in (0.0, 300.0):
        dead = np.where(t > 3.0, value, y)  # for 20 of 23 s
        for x, there in ((dead, t > 3.0), (dead[::-1], (t > 3.0)[::-1])):
            assert (outliers.wheel_outliers(LIMITS, channel(t, x, "wheel_speed")) == there).all()


@given(st.lists(st.tuples(st.integers(10, 1000), st.integers(1, 8)), max_size=30))
def test_many_drop_outs_of_any_length_are_found(runs: list[tuple[int, int]]) -> None:
    t, y = drawn(50.0, lines((0, 60), (2, 60), (20, 30), (23, 30)), 3e-3, 0.0)
    dead = np.zeros(len(t), dtype=np.bool_)
    for at, length in runs:
        dead[at : at + length] = True
    y[dead] = 0.0
    assert (outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed")) == dead).all()


def test_a_filter_behind_a_drop_out_is_part_of_it() -> None:
    t, y = drawn(100.0, STOP, 3e-3, 0.0)
    y[500:506] = [45.0, 20.0, 0.0, 0.0, 15.0, 42.0]
    (found,) = np.nonzero(outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed")))
    assert found.tolist() == list(range(500, 506))


def test_a_signal_that_is_no_wheels_is_left_alone() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    y = np.random.default_rng(1).uniform(0.0, 400.0, len(t))
    assert not outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed")).any()


@pytest.mark.parametrize("density", [0.01, 0.1, 0.25, 0.35, 0.5, 0.6])
@pytest.mark.parametrize("noise", [3e-3, 0.05])
def test_drop_outs_are_found_however_many(density: float, noise: float) -> None:
    random = np.random.default_rng(round(1000 * density))
    t, y = drawn(50.0, lines((0, 60), (2, 60), (20, 30), (23, 30)), noise, 0.0)
    dead = random.random(len(t)) < density
    y[dead] = 0.0
    # A row of zeros of 0.2 s may be a slide, one at the end a release.
    assert (outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed")) != dead).mean() < 0.03
    t, p = drawn(50.0, lines((0, 0), (2, 0), (4, 3e5), (24, 3e5)), 1e5 * noise, 1000.0)
    dead = (random.random(len(t)) < density) & (t > 5.0)
    p[dead] = 0.0
    assert (outliers.brake_outliers(LIMITS, channel(t, p, "pressure")) != dead).mean() < 0.03


@pytest.mark.parametrize("every", [2, 3, 6])
@pytest.mark.parametrize("first", [0, 1])
def test_regular_drop_outs_are_found(every: int, first: int) -> None:
    t, y = drawn(100.0, lines((0, 60), (20, 30)), 3e-3, 0.0)
    y[first::every] = 0.0
    found = outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed"))
    assert (found == (y == 0.0)).all()


@pytest.mark.parametrize("sigma", [0.5, 2.0, 8.0])
def test_noise_is_no_drop_out(sigma: float) -> None:
    for rate in (5.0, 100.0, 1000.0):
        t, y = drawn(rate, STOP, sigma, 0.0)
        assert not outliers.wheel_outliers(LIMITS, channel(t, y, "wheel_speed")).any()


def test_a_speed_whose_true_half_is_not_known_is_left_out_whole() -> None:
    t, y = drawn(100.0, lines((0, 60), (20, 30)), 3e-3, 0.0)
    half = np.random.default_rng(4).random(len(t)) < 0.5
    (fault,) = outliers.wheel_faults(LIMITS, channel(t, np.where(half, y / 2.0, y), "wheel_speed"))
    assert fault.code == "speed-unusable"
    assert fault.mask.all()


def test_a_sensor_is_not_accused_of_its_unit() -> None:
    t, p = drawn(25.0, DUMPS, 1000.0, 0.0)
    faults = outliers.brake_faults(
        LIMITS, channel(t, 100.0 * (p - 500.0), "pressure")
    )  # kPa as bar
    assert not any(f.mask.any() for f in faults)


@pytest.mark.parametrize(
    ("signal", "value", "seconds"),
    [("wheel_speed", 0.0, 0.05), ("wheel_speed", 0.0, 0.5), ("pressure", 8.0, 0.02)],
)
def test_the_force_around_a_drop_out_is_as_without_it(
    signal: str, value: float, seconds: float, tmp_path: Path
) -> None:
    log = simulated.recordings("service-brake", rate=50.0)

    def force(log: simulated.Recordings) -> tuple[Floats, Floats, list[str]]:
        path = simulated.write(tmp_path / "log.csv", log)
        result = analyze.analyze(path, settings.load(), algos=["leso"])
        axle = result.axles[0]
        return axle.record.t, axle.reference.force, [f.code for f in result.findings]

    t, clean, none = force(log)
    bad = log
    for at in (6.0, 9.0):
        bad = simulated.put(bad, signal, 1, simulated.during(at, seconds), value)
    some, found, codes = force(bad)
    assert none == ["vehicle-default"]
    assert f"{signal.removeprefix('wheel_')}-outlier" in codes
    there = np.isfinite(found)
    assert there.sum() > 0.9 * np.isfinite(clean).sum()
    assert np.abs(found - np.interp(some, t, clean))[there].max() < 100.0  # of 3 kN


@pytest.mark.parametrize("teeth", [4, 40])
def test_a_counters_zeros_between_pulses_do_not_flicker(teeth: int) -> None:
    t, y = drawn(1000.0, lines((0, 20), (10, 0.2)), 0.0, 0.0)
    step = 2.0 * np.pi / teeth * 1000.0
    counted = np.diff(np.floor(np.cumsum(y) / step), prepend=0.0) * step
    assert not outliers.wheel_outliers(LIMITS, channel(t, counted, "wheel_speed")).any()
