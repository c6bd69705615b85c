"""Signals that a table repeats until they are new."""

from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.core.model import Channel, Column, Floats
from adhesion_cli.records import sample_and_hold


def channel(value: Floats, rate: float, step: float = 0.0) -> Channel:
    t = np.round(np.arange(len(value)) * 1e9 / rate).astype(np.int64)
    data = Column(t, value, np.ones(len(t), dtype=np.bool_))
    return Channel(
        "p", "", "pressure", 1, "bar", "", data, gap_ns=round(5e9 / rate), step=step, rate_hz=rate
    )


def application(t: Floats, noise: float, step: float) -> Floats:
    """Cylinder pressure [Pa]: applied, held, released, as through an orifice."""
    target = np.where((t > 3.0) & (t < 20.0), 4e5, 0.0)
    p = np.zeros(len(t))
    for k in range(1, len(t)):
        p[k] = target[k] + (p[k - 1] - target[k]) * np.exp(-(t[k] - t[k - 1]) / 1.5)
    p += noise * np.random.default_rng(1).standard_normal(len(t))
    return np.round(p / step) * step if step else p


@given(
    st.floats(0.02, 1.5), st.sampled_from([30.0, 100.0, 250.0]), st.sampled_from([0.0, 1e3, 5e3]),
    st.sampled_from([0.0, 1e3]),
)  # fmt: skip
def test_the_interval_of_a_held_signal_is_found(
    every: float, rate: float, step: float, noise: float
) -> None:
    """And straight lines join what was sampled, to within the table's interval."""
    t, own = np.arange(0.0, 30.0, 1.0 / rate), np.arange(0.0, 30.0, every)
    p = application(own, noise, step)
    last = np.searchsorted(own, t + 1e-9, side="right") - 1
    table = channel(p[last], rate, step)
    found = sample_and_hold.interval(table)
    if every * rate < 2.0 or (step and every < 0.2):  # a step at a time, or no repeat
        assert found == 0.0 or found == pytest.approx(every, rel=0.1)
        return
    assert found == pytest.approx(every, rel=0.1)
    measured = sample_and_hold.readings(table, found).data
    line = np.interp(table.data.t, measured.t, measured.value)
    ahead = np.interp(t - 1.0 / rate, own, p), np.interp(t, own, p)
    some = t < own[own <= t[-1]][-1]
    lowest, highest = np.minimum(*ahead), np.maximum(*ahead)
    slack = 1.0 + 0.6 * step + np.abs(np.gradient(line))
    # noise bends the line at each own sample, and most of these lie between two rows
    least = 0.97 if every * rate > 10.0 or not noise else 0.92
    assert np.mean(((line > lowest - slack) & (line < highest + slack))[some]) > least


@pytest.mark.parametrize("step", [0.0, 200.0, 1000.0, 5000.0, 20000.0])
@pytest.mark.parametrize("noise", [0.0, 20.0, 300.0, 1000.0, 5000.0])
@pytest.mark.parametrize("rate", [1.0, 10.0, 100.0])
def test_a_rounded_signal_is_not_a_held_one(rate: float, noise: float, step: float) -> None:
    t = np.arange(0.0, 30.0, 1.0 / rate)
    assert sample_and_hold.interval(channel(application(t, noise, step), rate, step)) == 0.0


def test_a_gap_and_a_clock_that_falls_back_are_not_crossed() -> None:
    p = np.repeat(application(np.arange(0.0, 30.0, 0.1), 1e3, 0.0), 10)
    table = channel(p, 100.0)
    t = table.data.t.copy()
    t[1500:] += 2_000_000_000
    t[2200:] -= 5_000_000_000
    parted = Column(t, p, table.data.valid)
    measured = sample_and_hold.readings(
        Channel("p", "", "pressure", 1, "bar", "", parted, gap_ns=table.gap_ns), 0.1
    )
    assert measured.starts == (0, 150, 220)
    np.testing.assert_array_equal(measured.data.t, t[::10])
    np.testing.assert_array_equal(measured.data.value, p[::10])


@pytest.mark.parametrize("rate", [2.0, 10.0])
def test_held_cells_mean_what_empty_ones_do(rate: float, tmp_path: Path) -> None:
    """The reference is the same but for a sample, and the log says what was done."""

    def slow(r: simulated.Recording, hold: bool) -> simulated.Recording:
        own = r.t - r.t % round(1e9 / rate)
        new = np.flatnonzero(np.diff(own, prepend=-1))
        if not hold:
            return simulated.replace(r, t=r.t[new], value=r.value[new])
        return simulated.replace(r, value=r.value[new][np.cumsum(np.diff(own, prepend=-1) > 0) - 1])

    log = simulated.recordings("service-brake", rate=100.0, noise=1e-5)
    results = []
    for hold in (False, True):
        changed = simulated.changed(log, "pressure", lambda r: slow(r, hold))  # noqa: B023
        path = simulated.write(tmp_path / f"{hold}.csv", changed)
        results.append(analyze.analyze(path, settings.load(), algos=["td"]))
    (empty,), (filled,) = (r.axles for r in results)
    n = min(len(empty.record), len(filled.record))
    a, b = empty.reference, filled.reference
    apart = (a.force[:n] - b.force[:n]) / np.hypot(a.sigma[:n], b.sigma[:n])
    assert np.nanquantile(np.abs(apart), 0.95) < 1.0
    told = [f for f in results[1].findings if f.code == "pressure-repeated"]
    assert [f.severity for f in told] == ["info"]
    assert told[0].values["interval_s"] == pytest.approx(1.0 / rate, rel=0.05)
    assert "pressure-repeated" not in {f.code for f in results[0].findings}


@pytest.mark.parametrize(("meaning", "scenario"), [
    ("wheel_speed", "service-brake"), ("wheel_speed", "low-adhesion"),
    ("train_speed", "low-adhesion"),
])  # fmt: skip
def test_repeated_speeds_are_no_measurements(meaning: str, scenario: str, tmp_path: Path) -> None:
    """A table that repeats a speed gives what one without the repeats does, and says so.

    Taken for measurements they make a staircase: the inertia's force is lost, and sigma is 0.
    """
    log = simulated.recordings(scenario, rate=100.0, noise=1e-5)
    results = []
    for hold in (False, True):

        def slow(r: simulated.Recording, hold: bool = hold) -> simulated.Recording:
            new = np.arange(0, len(r.t), 10)
            if hold:
                return simulated.replace(r, value=r.value[np.arange(len(r.t)) // 10 * 10])
            return simulated.replace(r, t=r.t[new], value=r.value[new])

        path = simulated.write(tmp_path / f"{hold}.csv", simulated.changed(log, meaning, slow))
        results.append(analyze.analyze(path, settings.load(), ["td"], axles=[1]))
    for empty, filled in zip(*(r.axles for r in results), strict=True):
        n = min(len(empty.record), len(filled.record))
        a, b = empty.reference, filled.reference
        assert np.nanmax(np.abs(a.force[:n] - b.force[:n]) / b.sigma[:n]) < 1.0
        if meaning == "train_speed":
            v, known = filled.record.train_speed, empty.record.train_speed
            assert v is not None
            assert known is not None
            assert np.nanmax(np.abs(v - known)[:-10]) < 0.02
    told = [f for f in results[1].findings if f.code == "speed-repeated"]
    assert told
    assert {f.severity for f in told} == {"info"}
    every = 1.0 if meaning == "train_speed" else 0.1
    assert all(f.values["interval_s"] == pytest.approx(every, rel=0.05) for f in told)
    assert all(f.count > 300 for f in told)
    assert "speed-repeated" not in {f.code for f in results[0].findings}


@pytest.mark.parametrize("noise", [0.15, 0.2])
@pytest.mark.parametrize("slope", [0.5, 0.65])
def test_a_rounded_speed_with_noise_is_not_a_held_one(slope: float, noise: float) -> None:
    """It jumps by two steps only after a stand: a few such stands are equally long by chance."""
    for seed in range(20):
        steps = slope * np.arange(1500) + noise * np.random.default_rng(seed).normal(size=1500)
        assert sample_and_hold.interval(channel(np.round(steps) * 0.1, 50.0, 0.1)) == 0.0
