"""Slip, slides, peak and rail against simulations that know them."""

import functools
import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from helpers.commands import in_process
from helpers.pasted import pasted
from helpers.simulated import changed, late, recordings, simulation, write

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.cli.slip import table
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import AxleRecord, AxleResult, Parameter, Reference, Result, Vehicle
from adhesion_cli.core.physics import G
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.rail import (
    creep_law,
    fit,
    rail_under_slides,
    sliding,
    slip,
    slope,
    speed_errors,
    wheel_calibration,
)
from adhesion_cli.rail.applications import find_applications
from adhesion_cli.results import mcap
from adhesion_cli.wsp import closed_loop, scenario
from adhesion_cli.wsp.simulate import Recording


@cache
def analysed(name: str, train: bool | None = None, *stated: str) -> Result:
    with TemporaryDirectory() as folder:
        log = write(Path(folder) / f"{name}.csv", recordings(name, train=train))

        exact = ("analysis.vehicle=stated", *stated)
        return analyze.analyze(log, settings.load(None, exact), ["leso"], train_speed=True)


@cache
def told(name: str, axle: int, *stated: str) -> rail_under_slides.Summary:
    result = analysed(name, None, *stated)
    return rail_under_slides.summary(result.axles[axle - 1], result.vehicle)[0]


def rail(result: Result) -> fit.RailFit | None:
    """The rail under all slides of the first axle, with rough intervals."""
    axle = result.axles[0]
    context = rail_under_slides.AxleContext(axle, result.vehicle)
    return rail_under_slides.fit_rail(context, sliding.slides(axle), 50)[0]


def true_slip(name: str, axle: AxleResult) -> np.ndarray:
    true = simulation(name)
    return np.interp(axle.record.t, true.t, np.nan_to_num(true.slip[:, axle.record.axle - 1]))


def true_curve(name: str, cleaning: float, speed: float) -> tuple[float, float]:
    """Slip and μ of the true curve's peak."""
    condition = creep_law.condition(name)
    condition = condition._replace(f0=condition.f0 * cleaning)
    load = Vehicle().axle_mass.value * G
    patch = creep_law.Contact().patch(load)
    grid = np.linspace(1e-3, 0.3, 3000)
    mu = [
        creep_law.creep_force(s * speed, speed, condition, patch)[0] / load for s in grid.tolist()
    ]
    return float(grid[np.argmax(mu)]), max(mu)


def codes(result: Result) -> set[str]:
    return {f.code for f in result.findings}


def test_slip_follows_the_true_one() -> None:
    (axle, *_) = analysed("low-adhesion").axles
    known = np.isfinite(axle.slip)
    error = (axle.slip - true_slip("low-adhesion", axle))[known & (axle.record.train_speed > 3.0)]
    assert np.sqrt(np.mean(error**2)) < 3e-3
    carried = axle.record.true_slip - true_slip("low-adhesion", axle)
    assert np.abs(carried[known]).max() < 0.02  # read at another rate
    braked = np.concatenate([(axle.slip - axle.record.true_slip)[s] for s in axle.applications])
    rms = np.sqrt(np.nanmean(braked**2))
    assert told("low-adhesion", 1).slip_rmse == pytest.approx(rms)
    assert not np.isfinite(axle.slip[axle.record.train_speed < 1.0]).any()


def test_slope_follows_the_true_curve_on_a_roller_rig() -> None:
    (axle,) = analysed("roller-rig").axles
    speed, load = 10.0, Vehicle().axle_mass.value * G
    patch, wet = creep_law.Contact().patch(load), creep_law.condition("wet")
    at = np.flatnonzero(axle.slip > 0.05)
    true = np.array(
        [
            creep_law.creep_force(s * speed, speed, wet, patch)[1] * speed / load
            for s in axle.slip[at]
        ]
    )
    error = axle.slope[at] - true
    assert np.isfinite(error).mean() > 0.98
    assert np.sqrt(np.nanmean(error**2)) < 0.06
    changes = [e.t for e in axle.events if e.code == "region-change"]
    order = axle.region[np.searchsorted(axle.record.t, changes)]
    seen = [slope.REGIONS[i] for i in order if i]
    assert list(dict.fromkeys(seen)) == ["below", "optimal", "beyond"]
    assert seen == sorted(seen, key=slope.REGIONS.index)


def test_slides_are_those_of_the_simulation() -> None:
    name = "low-adhesion"
    true = simulation(name)
    found = sliding.slides(analysed(name).axles[0])
    first = found[0]
    i, j = np.searchsorted(true.t, [first.start, first.start + int(first.duration * 1e9)])
    sliding_speed = true.train_speed - true.wheel_speed[:, 0] * 0.42
    energy = np.trapezoid((true.adhesion_force[:, 0] * sliding_speed)[i:j], true.t[i:j] * 1e-9)
    assert first.energy == pytest.approx(energy, rel=0.03)
    assert first.distance == pytest.approx(true.distance[j] - true.distance[i], rel=0.01)
    assert first.max_slip == pytest.approx(true.slip[i:j, 0].max(), abs=0.01)
    assert not sliding.slides(analysed(name).axles[2])


@pytest.mark.parametrize(("axle", "cleaning"), [(1, 1.0), (2, 1.15)])
def test_peak_and_rail_lie_in_their_intervals(axle: int, cleaning: float) -> None:
    s = told("low-adhesion", axle)
    assert s.rail is not None
    assert s.rail.peak_slip is not None
    assert s.rail.peak_mu is not None
    peak, mu = true_curve("low", cleaning, s.rail.speed)
    assert s.rail.peak_slip.lower < peak < s.rail.peak_slip.upper
    assert s.rail.peak_slip.upper < 1.5 * s.rail.peak_slip.lower
    assert s.rail.peak_mu.value == pytest.approx(mu, rel=0.01)
    true = creep_law.condition("low")
    for name, value in true._replace(f0=true.f0 * cleaning)._asdict().items():
        if name in s.rail.constants:
            _, low, high = s.rail.constants[name]
            assert 0.98 * low < value < 1.02 * high, name
    assert {"f0", "B"} <= set(s.rail.constants)
    force = simulation("low-adhesion").adhesion_force[:, axle - 1]
    t = simulation("low-adhesion").t
    record_t = analysed("low-adhesion").axles[axle - 1].record.t
    spans = [record_t[[x.samples.start, x.samples.stop - 1]] for x in s.slides]
    used = np.concatenate([force[(t >= begin) & (t <= end)] for begin, end in spans])
    load = Vehicle().axle_mass.value * G
    assert s.rail.utilisation is not None
    assert s.rail.utilisation.value == pytest.approx(np.mean(used) / load / mu, rel=0.01)


def test_a_wheel_of_known_radius_tells_the_whole_rail() -> None:
    exact = "vehicle.wheel_radius={value=0.42, tolerance=0.0}"
    loose, sure = (rail(analysed("roller-rig", None, *more)) for more in ((), (exact,)))
    assert loose is not None
    assert sure is not None
    assert set(loose.constants) <= set(sure.constants)
    for name, interval in loose.constants.items():
        assert interval.lower < getattr(creep_law.condition("wet"), name) < interval.upper, name
    assert {"k_a", "k_s", "f0", "B"} <= set(sure.constants)
    for name, interval in sure.constants.items():
        assert interval.value == pytest.approx(getattr(creep_law.condition("wet"), name), rel=0.05)


def test_what_the_log_does_not_show_is_refused() -> None:
    result = analysed("low-adhesion")
    summary, findings = rail_under_slides.summary(result.axles[2], result.vehicle)
    assert summary.rail is None
    assert not summary.slides
    assert [(f.code, f.channel) for f in findings] == [("no-slide", "axle 3")]


def test_points_on_one_side_of_the_peak_tell_no_peak() -> None:
    t = np.arange(0.0, 20.0, 0.02)
    creep = 0.002 + 0.0005 * np.sin(t)
    load = Vehicle().axle_mass.value * G
    patch, wet = creep_law.Contact().patch(load), creep_law.condition("wet")
    mu = np.array([creep_law.creep_force(s * 15.0, 15.0, wet, patch)[0] / load for s in creep])
    mu += np.random.default_rng(1).normal(0.0, 1e-3, len(mu))
    points = fit.Points(
        t, np.full(len(t), 15.0), creep, mu, *(3 * [0.0 * t]), 0.0 * t[:, None], t >= 0.0
    )
    found = fit.fit(points, Vehicle(), 0.0, 0.0, 50)
    assert found is not None
    assert found.peak_slip is None
    assert found.peak_mu is None
    assert found.peak_slip_limit is None
    assert not {"A", "B"} & set(found.constants)


@pytest.mark.parametrize("name", ["low", "dry"])
def test_points_beyond_the_peak_alone_bound_it(name: str) -> None:
    t, speed = np.arange(0.0, 20.0, 0.02), 15.0
    creep = 0.1 * np.exp(0.7 * np.sin(2.0 * t))
    load = Vehicle().axle_mass.value * G
    patch, condition = creep_law.Contact().patch(load), creep_law.condition(name)
    mu = np.array(
        [creep_law.creep_force(s * speed, speed, condition, patch)[0] / load for s in creep]
    )
    mu += np.random.default_rng(1).normal(0.0, 5e-4, len(mu))
    points = fit.Points(
        t, np.full(len(t), speed), creep, mu, *(3 * [0.0 * t]), 0.0 * t[:, None], t >= 0.0
    )
    found = fit.fit(points, Vehicle(), 0.0, 0.0, 50)
    assert found is not None
    assert found.peak_slip is None
    at, height = true_curve(name, 1.0, speed)
    assert found.peak_slip_limit is not None
    assert at < found.peak_slip_limit < creep.max()
    assert found.peak_mu is not None
    assert found.peak_mu.lower < height < found.peak_mu.upper < 1.2 * found.peak_mu.lower


def swinging(deepest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, slip that swings between 0.3 % and the deepest, and its μ on a low rail at 15 m/s."""
    t, speed = np.arange(0.0, 20.0, 0.02), 15.0
    depth = 0.5 * math.log(deepest / 0.003)
    creep = deepest * np.exp(depth * (np.sin(4.0 * t) - 1.0))
    load = Vehicle().axle_mass.value * G
    patch, condition = creep_law.Contact().patch(load), creep_law.condition("low")
    mu = [
        creep_law.creep_force(s * speed, speed, condition, patch)[0] / load for s in creep.tolist()
    ]
    return t, creep, np.array(mu)


def test_forces_known_to_err_where_the_brake_turns_move_no_peak() -> None:
    t, creep, mu = swinging(0.25)
    turns = (creep > 0.06) & (np.gradient(creep) > 0.0)
    noise = np.random.default_rng(2).normal(0.0, 3e-4, len(t))
    seen = np.where(turns, 0.9, 1.0) * mu + noise
    swing = np.where(turns, 0.1, 0.0) * mu
    zero = 0.0 * t
    points = fit.Points(t, zero + 15.0, creep, seen, zero, swing, zero, zero[:, None], creep > 0.01)
    found = fit.fit(points, Vehicle(), 0.0, 0.0, 50)
    assert found is not None
    assert found.peak_slip is not None
    at, _ = true_curve("low", 1.0, found.speed)
    assert found.peak_slip.lower < at < found.peak_slip.upper
    assert found.peak_slip.value == pytest.approx(at, rel=0.1)


def test_utilisation_knows_that_slides_may_begin_and_end_elsewhere() -> None:
    t, creep, mu = swinging(0.12)
    clock, zero = 0.01, 0.0 * t
    seen = creep - clock + np.random.default_rng(3).normal(0.0, 5e-4, len(t))
    slides = seen - 2.0 * clock > 0.01  # as slides are found
    points = fit.Points(
        t, zero + 15.0, seen, mu, zero + 5e-4, zero, zero + clock, zero[:, None], slides
    )
    found = fit.fit(points, Vehicle(), 0.0, 0.0, 50)
    assert found is not None
    assert found.utilisation is not None
    true = mu[creep > 0.01].mean() / true_curve("low", 1.0, 15.0)[1]
    assert abs(mu[slides].mean() / mu[creep > 0.01].mean() - 1.0) > 0.02
    assert found.utilisation.lower < true < found.utilisation.upper
    assert found.utilisation.upper < 1.2 * found.utilisation.lower


def test_a_rail_that_changes_has_no_curve() -> None:
    t = np.arange(0.0, 20.0, 0.02)
    creep = 0.05 + 0.04 * np.sin(3.0 * t)
    mu = np.where(np.sin(t) > 0.0, 0.05, 0.3)
    points = fit.Points(
        t, np.full(len(t), 15.0), creep, mu, *(3 * [0.0 * t]), 0.0 * t[:, None], t >= 0.0
    )
    assert fit.clear_time(points) >= fit.SHORTEST
    assert fit.fit(points, Vehicle(), 0.0, 0.0) is None
    assert fit.clear_time(fit.Points._make(x[: int(7.0 / 0.02)] for x in points)) < fit.SHORTEST


def test_a_wheel_that_swings_about_the_peak_tells_it(tmp_path: Path) -> None:
    """Slide protection lets it slide for hardly longer than a fit needs, and creep for 40 s."""
    case = scenario.load("slippery-stop")
    exact = settings.AnalysisSettings(vehicle="stated")
    carried = settings.tree(settings.Settings(case.vehicle, analysis=exact), [])
    log = tmp_path / "slippery-stop.rule.antiskid.mcap"
    mcap.write_stop(log, case.name, closed_loop.run(case, "rule"), case.vehicle, carried, "{}", [])
    result = analyze.analyze(log, settings.load(folder=False), ["leso"], axles=[1])
    assert sum(x.duration for x in sliding.slides(result.axles[0])) < 2.0 * fit.SHORTEST
    found = rail(result)
    assert found is not None
    at, height = true_curve("low", 1.0, found.speed)
    assert found.peak_slip is not None
    assert found.peak_slip.lower < at < found.peak_slip.upper
    assert found.peak_mu is not None
    assert found.peak_mu.lower < height < found.peak_mu.upper


def test_wheel_diameters_come_from_coasting() -> None:
    result = analysed("four-axles")
    for axle in result.axles:
        radius, _ = wheel_calibration.calibrate_radius(axle.record, result.vehicle)
        true = simulation("four-axles").scenario.vehicle.radius(axle.record.axle).value
        assert abs(radius.value - true) < 3.0 * radius.tolerance + 1e-3
    calibrated = [f.channel for f in result.findings if f.code == "wheel-calibrated"]
    assert calibrated == ["axle 3", "axle 4"]


def test_diameters_of_calibrated_wheels_are_stated_as_the_hint_says(tmp_path: Path) -> None:
    def turning(r: Recording) -> Recording:
        return replace(r, unit="rad/s", value=r.value / 3.6 / 0.42, decimals=4)

    log = write(tmp_path / "x.csv", changed(recordings("four-axles"), "wheel_speed", turning))

    def found(*stated: str) -> list[Finding]:
        load = settings.load(None, stated, folder=False)
        every = analyze.analyze(log, load, ["leso"]).findings
        return [f for f in every if f.code == "wheel-calibrated"]

    told = found()
    assert [f.channel for f in told] == ["axle 3", "axle 4"]
    (hint,) = {f.hint or "" for f in told}
    (setting,) = pasted(hint)
    every = json.loads(setting.partition("=")[2])
    assert every[:2] == [0.84, 0.84]
    assert every[2:] == [pytest.approx(0.84 * (1.0 + f.values["share"]), abs=1e-4) for f in told]
    assert not found(setting)


def test_speeds_in_kmh_show_ratios_and_one_wheel_keeps_its_diameter(tmp_path: Path) -> None:
    log = write(tmp_path / "x.csv", recordings("four-axles"))

    def hints(*stated: str) -> set[str]:
        load = settings.load(None, stated, folder=False)
        findings = analyze.analyze(log, load, ["td"], axles=[3, 4]).findings
        told = [f for f in findings if f.code == "wheel-calibrated"]
        assert len(told) == 2
        assert not any(" m" in f.message or "stated" in f.message for f in told)
        return {f.hint or "" for f in told}

    (hint,) = hints()
    assert "axle 3 keeps its own" in hint
    (setting,) = pasted(hint)
    assert json.loads(setting.partition("=")[2])[:3] == [0.84, 0.84, 0.84]
    assert hints(setting) == {hint}  # what is pasted does not move


def test_a_wheel_is_no_other_than_stated_by_few_readings_of_the_train() -> None:
    t = np.arange(0.0, 8.0, 0.02)
    columns = np.round(t * 1e9).astype(np.int64), 0.0 * t, 0.0 * t, 25.0 / 0.42 + 0.0 * t
    every = np.arange(-1.0, 10.0)
    inside = []
    for seed in range(300):
        noise = np.random.default_rng(seed).normal(0.0, 0.05, len(every))
        v = 25.0 + np.interp(t, every + 0.5, noise)
        record = AxleRecord(1, *columns, (slice(0, len(t)),), train_speed=v, train_speed_interval=1)
        found = wheel_calibration.calibration(record, 0.42)
        assert found is not None
        inside.append(abs(found[0] - 1.0) < 1.96 * found[1])
    assert 0.91 < np.mean(inside) < 0.98


def test_a_wheel_is_no_other_than_stated_by_readings_in_whole_miles_per_hour() -> None:
    t, random, step = np.arange(0.0, 60.0, 0.02), np.random.default_rng(7), 0.44704
    K = np.where((t > 20.0) & (t < 40.0), 5000.0, 0.0)  # the train coasts before and after
    inside, errors = [], []
    for _ in range(100):
        v = np.interp(t, [20.0, 40.0], random.uniform([10.0, 4.0], [25.0, 9.0]))
        columns = np.round(t * 1e9).astype(np.int64), K, K, v / 0.42
        train = np.round((v + random.normal(0.0, 0.03, len(t))) / step) * step
        record = AxleRecord(
            1, *columns, (slice(0, len(t)),), train_speed=train, train_speed_step=step
        )
        measured = wheel_calibration.calibration(record, 0.42)
        assert measured is not None
        errors.append(abs(measured[0] - 1.0))
        inside.append(errors[-1] < 1.96 * measured[1])
    assert np.mean(inside) > 0.93  # 0.05 where the readings count as independent
    assert np.mean(errors) < 0.008


def test_the_noise_of_the_speeds_is_not_that_of_a_train_that_stands() -> None:
    t = np.arange(0.0, 90.0, 0.02)
    true = np.maximum(20.0 - 0.8 * np.maximum(t - 3.0, 0.0), 0.0)  # stands after 28 s
    random, K = np.random.default_rng(5), np.where(t > 3.0, 8000.0, 0.0)
    v = np.maximum(true + random.normal(0.0, 0.03, len(t)), 0.0) * (true > 0.0)
    columns = np.round(t * 1e9).astype(np.int64), K, K, true / 0.42
    record = AxleRecord(1, *columns, (slice(0, len(t)),), train_speed=v)
    level = np.median(speed_errors.speed_noise(record, 0.42)[true > 1.0])
    assert level == pytest.approx(0.03, rel=0.1)


def test_a_speed_made_of_the_axles_tells_no_wheel_from_itself() -> None:
    t = np.arange(0, 8 * 10**9, 2 * 10**7)
    y, K = np.full(len(t), 25.0 / 0.42), np.zeros(len(t))
    records = [AxleRecord(n, t, K, K, y, (slice(0, len(t)),)) for n in (1, 2)]
    made, _ = wheel_calibration.with_reference_speed(records, records, Vehicle(), 0)
    assert wheel_calibration.calibrate_radius(made[0], Vehicle())[1] == []


def test_without_a_train_speed_the_fastest_axle_is_the_train() -> None:
    result = analysed("low-adhesion", False)
    assert "reference-speed" in codes(result)
    assert "all-axles-slide" not in codes(result)
    true = simulation("low-adhesion")
    (axle, *_) = result.axles
    v = np.interp(axle.record.t, true.t, true.train_speed)
    assert np.abs(axle.record.train_speed - v).max() < 0.15
    summary, findings = rail_under_slides.summary(axle, result.vehicle)
    assert summary.rail is None
    assert [f.code for f in findings] == ["rail-needs-train-speed"]
    assert sliding.slides(axle)[0].energy == pytest.approx(
        sliding.slides(analysed("low-adhesion").axles[0])[0].energy, rel=0.1
    )


def test_a_slower_tachometer_with_another_delay_is_no_slide_of_the_others() -> None:
    def record(axle: int, interval: float, delay: float, slip: float = 0.0) -> AxleRecord:
        seconds = np.arange(0.0, 24.0, interval)
        v = 25.0 - 1.0 * np.maximum(seconds - delay - 3.0, 0.0)
        y = v * (1.0 - slip * ((seconds > 8.0) & (seconds < 10.0))) / 0.42
        K = np.where(seconds > 3.0, 18000.0, 0.0)
        t = np.round(seconds * 1e9).astype(np.int64)
        return AxleRecord(axle, t, K, K, y, (slice(0, len(t)),))

    def highest_slip(first: AxleRecord, second: AxleRecord) -> float:
        records = [first, second, record(3, 0.2, 0.35), record(4, 0.2, 0.35)]
        made, _ = wheel_calibration.with_reference_speed(records, records, Vehicle(), 0)
        v = made[0].train_speed
        assert v is not None
        slip = 1.0 - 0.42 * first.wheel_speed / v
        return float(np.nanmax(slip[v > 3.0]))

    assert highest_slip(record(1, 0.02, 0.0), record(2, 0.02, 0.0)) < 0.005
    sliding = record(1, 0.02, 0.0, 0.2), record(2, 0.02, 0.0, 0.2)
    assert highest_slip(*sliding) == pytest.approx(0.2, abs=0.02)  # the slow ones are the train


def test_a_step_of_rounded_speeds_is_no_slide_of_all_axles() -> None:
    t = np.arange(0, 20 * 10**9, 2 * 10**7)
    seconds = t * 1e-9
    step = 1.0 / 3.6 / 0.42  # whole km/h
    speed = (20.0 - 1.0 * np.maximum(seconds - 3.0, 0.0)) / 0.42
    speed = step * np.round(speed / step)
    K = np.where(seconds > 3.0, 25000.0, 0.0)
    records = [AxleRecord(n, t, K, K, speed, (slice(0, len(t)),), step) for n in (1, 2)]
    _, findings = wheel_calibration.with_reference_speed(records, records, Vehicle(), 0)
    assert [f.code for f in findings] == ["reference-speed"]


def test_all_axles_sliding_is_told() -> None:
    t = np.arange(0, 20 * 10**9, 2 * 10**7)
    seconds = t * 1e-9
    v = 20.0 - 0.5 * np.maximum(seconds - 3.0, 0.0)
    slide = np.interp(seconds, [4.0, 6.0, 9.0, 10.0], [0.0, 0.25, 0.25, 0.0])
    K = np.where(seconds > 3.0, 8000.0, 0.0)
    records = [
        AxleRecord(n, t, K, K, v * (1.0 - slide) / 0.42, (slice(0, len(t)),)) for n in (1, 2)
    ]
    made, findings = wheel_calibration.with_reference_speed(records, records, Vehicle(), 0)
    assert [f.code for f in findings] == ["reference-speed", "all-axles-slide"]
    assert findings[0].values == {"axles": 2}
    ((begin, end),) = findings[1].spans
    assert 3.9 < begin < 5.5
    assert 9.0 < end < 10.1
    assert np.abs(made[0].train_speed - v)[seconds < 4.0].max() < 0.01
    assert (made[0].train_speed > 0.8 * v).all()
    shown = []
    known = Parameter(0.0, 0.01)
    for record in (made[0], replace(records[0], train_speed=v, train_speed_late=known)):
        force = np.full(len(t), 1500.0)
        ref = Reference("none", "none", force, 0.0 * force, 0.0 * force)
        axle = AxleResult(record, ref, {}, (), (slice(0, len(t)),))
        axle, _ = slip.observe_slip(axle, Vehicle(), 1.0, slope.Params(), slope.Bands())
        summary, _ = rail_under_slides.summary(axle, Vehicle())
        shown.append((summary.slides[0], table([summary], 0)))
    (bound, text), (whole, plain) = shown
    assert (bound.is_lower_bound, whole.is_lower_bound) == (True, False)
    for name in ("duration", "distance", "max_slip", "energy"):
        assert getattr(bound, name) < getattr(whole, name), name
    assert f"≥ {100.0 * bound.max_slip:.1f}" in text
    assert "≥" not in plain


def test_a_locked_wheel_has_the_energy_of_the_force_before_and_behind_it() -> None:
    t = np.arange(0, 10 * 10**9, 2 * 10**7)
    seconds = t * 1e-9
    v = 20.0 - 0.5 * seconds
    creep = np.interp(seconds, [2.0, 3.0, 5.0, 6.0], [0.0, 1.0, 1.0, 0.0])
    K = np.full(len(t), 5000.0)
    record = AxleRecord(1, t, K, K, v * (1.0 - creep) / 0.42, (slice(0, len(t)),), train_speed=v)
    record = replace(record, train_speed_late=Parameter(0.0, 0.01))
    force = np.where(creep < 1.0, 1500.0, np.nan)
    ref = Reference("none", "none", force, 0.0 * force, 0.0 * force)
    axle = AxleResult(record, ref, {}, (), (slice(0, len(t)),))
    axle, _ = slip.observe_slip(axle, Vehicle(), 1.0, slope.Params(), slope.Bands())
    (slide,) = sliding.slides(axle)
    inside = slide.samples
    heat = 1500.0 * creep[inside] * v[inside]
    assert slide.energy == pytest.approx(np.trapezoid(heat, seconds[inside]), rel=0.01)
    assert slide.max_slip == pytest.approx(1.0)
    assert slide.duration == pytest.approx(4.0, abs=0.05)
    assert (axle.region[creep == 1.0] == slope.REGIONS.index("beyond")).all()
    assert [e.code for e in axle.events].count("slide") == 1


@pytest.mark.parametrize(("sigma", "is_bound"), [(0.02, False), (0.35, True), (None, True)])
def test_slides_beside_a_train_speed_that_may_be_late_are_lower_bounds(
    sigma: float | None, is_bound: bool
) -> None:
    """A radar that is 0.3 s late makes rolling wheels slide, and every slide deeper."""
    t = np.arange(0, 20 * 10**9, 2 * 10**7)
    seconds, K = t * 1e-9, np.full(len(t), 5000.0)
    v = 20.0 - 0.9 * seconds
    creep = np.interp(seconds, [2.0, 3.0, 5.0, 6.0], [0.0, 0.2, 0.2, 0.0])
    late = None if sigma is None else Parameter(0.0, sigma)
    read_late = v + (0.27 if is_bound else 0.0)
    record = AxleRecord(1, t, K, K, v * (1.0 - creep) / 0.42, (slice(0, len(t)),))
    record = replace(record, train_speed=read_late, train_speed_late=late)
    ref = Reference("none", "none", 0.1 * K, 0.0 * K, 0.0 * K)
    axle = AxleResult(record, ref, {}, (), (slice(0, len(t)),))
    axle, findings = slip.observe_slip(axle, Vehicle(), 1.0, slope.Params(), slope.Bands())
    (slide,) = sliding.slides(axle)
    assert slide.is_lower_bound == is_bound
    assert slide.max_slip is not None
    assert 0.17 < slide.max_slip < 0.2 + 0.001
    assert 3.4 < slide.duration < 4.01
    codes = [f.code for f in findings if f.code.startswith("train-speed")]
    assert codes == ["train-speed-delay-unknown"] * is_bound


def test_the_rail_beside_a_late_train_speed_is_fitted_to_the_slip_without_its_delay() -> None:
    """Under a WSP the deceleration changes within the delay: its mean does not give the slip."""
    seconds = np.arange(0.0, 24.0, 0.02)
    t, K = np.round(seconds * 1e9).astype(np.int64), np.full(len(seconds), 5000.0)

    def speed(at: np.ndarray) -> np.ndarray:
        return 24.0 - 0.7 * at + 0.1 * np.cos(3.0 * at)

    v, creep = speed(seconds), 0.08 - 0.078 * np.cos(3.0 * seconds)
    rail = creep_law.Condition(k_a=0.15, k_s=0.1, f0=0.065, A=0.6, B=0.1)
    load = Vehicle().axle_mass.value * G
    force = load * np.array(
        [fit.curve(rail, x, np.array([s]), Vehicle())[0] for x, s in zip(v, creep, strict=True)]
    )
    record = AxleRecord(1, t, K, K, v * (1.0 - creep) / 0.42, (slice(0, len(t)),))
    record = replace(record, train_speed=speed(seconds - 0.3), train_speed_late=None)
    ref = Reference("none", "none", force, 0.0 * force, 0.0 * force)
    axle = AxleResult(record, ref, {}, (), (slice(0, len(t)),))
    axle, _ = slip.observe_slip(axle, Vehicle(), 1.0, slope.Params(), slope.Bands())
    context = rail_under_slides.AxleContext(axle, Vehicle())
    found, _ = rail_under_slides.fit_rail(context, sliding.slides(axle), 40)
    assert found
    assert found.points
    error = found.points.slip - np.interp(found.points.t, seconds, creep)
    raw = 0.3 * 0.7 / found.points.speed
    assert float(np.sqrt(np.mean(error**2))) < 0.3 * float(np.sqrt(np.mean(raw**2)))


def test_a_locked_wheel_whose_brake_is_vented_has_one_brake_application() -> None:
    t = np.arange(0, 20 * 10**9, 2 * 10**7)
    seconds, v = t * 1e-9, np.full(len(t), 15.0)
    K = np.where((seconds > 9.5) & (seconds < 11.0), 0.0, 5000.0)
    rim = np.where((seconds > 8.0) & (seconds < 10.0), 0.0, v)
    record = AxleRecord(1, t, K, K, rim / 0.42, (slice(0, len(t)),), train_speed=v)
    ref = Reference("none", "none", K, 0.0 * K, 0.0 * K)
    pieces = (slice(0, 400), slice(550, len(t)))
    axle = AxleResult(record, ref, {}, (), pieces, slip=1.0 - rim / v)
    assert rail_under_slides.braked_pieces(axle) == [[*pieces]]
    rolling = replace(axle, slip=0.0 * v)  # the driver released the brake
    assert len(rail_under_slides.braked_pieces(rolling)) == 2
    released = replace(record, clamping_force=np.where(seconds > 7.9, 0.0, K))
    apart = replace(axle, record=released, applications=(slice(0, 390), slice(560, len(t))))
    assert len(rail_under_slides.braked_pieces(apart)) == 2


@pytest.mark.parametrize("rate", [1.0, 5.0, 10.0, 50.0])
@pytest.mark.parametrize("noise", [0.005, 0.02, 0.1, 0.3])
def test_a_rolling_wheel_has_no_slope_of_noise(noise: float, rate: float) -> None:
    """Slip's noise is that of the speeds over v: at walking pace ten times that at 10 m/s."""
    random = np.random.default_rng(int(1e4 * noise + rate))
    t = np.arange(0.0, 25.0, 0.02)
    slowing = 1.05 * np.clip((t - 2.0) / 1.5, 0.0, 1.0)
    v = np.maximum(20.0 - np.concatenate([[0.0], np.cumsum(slowing[1:]) * 0.02]), 0.0)
    mu = np.where(v > 0.0, slowing / G, 0.0)
    steep = 40.0  # of a dry rail
    own = np.arange(0.0, 25.0 + 1.0 / rate, 1.0 / rate)
    train = np.interp(t, own, np.interp(own, t, v) + noise * random.standard_normal(len(own)))
    wheel = v * (1.0 - mu / steep) / 0.42 + 0.003 * random.standard_normal(len(t))
    record = AxleRecord(
        1, np.round(t * 1e9).astype(np.int64), 8000.0 * slowing, 8000.0 * slowing, wheel,
        (slice(0, len(t)),), train_speed=train, train_speed_interval=1.0 / rate,
    )  # fmt: skip
    level = np.median(speed_errors.speed_noise(record, 0.42))
    true = math.hypot(noise * (math.sqrt(2.0 / 3.0) if rate < 50.0 else 1.0), 0.42 * 0.003)
    assert level == pytest.approx(true, rel=0.5)
    force = mu * Vehicle().axle_mass.value * G
    ref = Reference("none", "none", force, 0.0 * force + 5.0, 0.0 * force)
    axle = AxleResult(record, ref, {}, (), (slice(100, len(t)),))
    done, _ = slip.observe_slip(axle, Vehicle(), 1.0, slope.Params(), slope.Bands())
    told = done.slope[np.isfinite(done.slope)]
    assert (told > steep / 2.0).all()


@pytest.mark.parametrize(
    "seconds", [-0.5, 1.0, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.1, 0.3, 2.0))]
)
def test_a_late_train_speed_is_shifted(tmp_path: Path, seconds: float) -> None:
    shifted = late(recordings("low-adhesion"), "train_speed", seconds)
    log = write(tmp_path / "late.csv", shifted)
    result = analyze.analyze(log, settings.load(), ["leso"], axles=[1, 3])
    (told,) = [f for f in result.findings if f.code == "train-speed-delay"]
    assert told.severity == "info"  # it is corrected
    assert told.channel.startswith("train_speed")
    removed = result.axles[0].record.train_speed_late
    assert removed is not None
    assert removed.value == pytest.approx(seconds, abs=3.0 * removed.tolerance)
    assert removed.tolerance < 0.05
    true = sliding.slides(analysed("low-adhesion").axles[0])
    for mine, its in zip(sliding.slides(result.axles[0]), true, strict=True):
        assert mine.start == pytest.approx(its.start, abs=2e8)
        assert mine.duration == pytest.approx(its.duration, abs=0.5)
        assert mine.max_slip == pytest.approx(its.max_slip, abs=0.03)
    assert not sliding.slides(result.axles[1])  # the third
    found = rail(result)
    assert found is not None
    assert found.peak_slip is not None
    peak, _ = true_curve("low", 1.0, found.speed)
    assert found.peak_slip.lower < peak < found.peak_slip.upper


def test_a_train_speed_on_time_is_left_alone() -> None:
    for name in ("low-adhesion", "four-axles"):
        result = analysed(name)
        assert "train-speed-delay" not in codes(result)
        known = result.axles[0].record.train_speed_late
        assert known is not None
        assert known.value == 0.0
        assert 0.0 < known.tolerance < 0.1


def test_a_delay_that_no_rolling_wheel_tells_is_said_so() -> None:
    with TemporaryDirectory() as folder:
        log = write(Path(folder) / "slide.csv", recordings("low-adhesion"))
        result = analyze.analyze(log, settings.load(), ["leso"], axles=[1])
    assert result.axles[0].record.train_speed_late is not None  # the other axles tell
    alone = [r for r in recordings("low-adhesion") if r.axle in (None, 1)]
    with TemporaryDirectory() as folder:
        log = write(Path(folder) / "alone.csv", alone)
        result = analyze.analyze(log, settings.load(), ["leso"])
    assert result.axles[0].record.train_speed_late is None
    assert "train-speed-delay-unknown" in codes(result)


def test_a_delay_that_may_be_an_offset_is_said_once(tmp_path: Path) -> None:
    late_train = late(recordings("leaf-film", train=True), "train_speed", 0.3)
    result = analyze.analyze(write(tmp_path / "late.csv", late_train), settings.load(), ["leso"])
    said = {code for code in codes(result) if code.startswith("train-speed")}
    assert said == {"train-speed-delay-or-offset"}
    assert any(slide.is_lower_bound for slide in sliding.slides(result.axles[0]))


@pytest.mark.parametrize("seconds", [0.0, 1.5])
def test_on_a_receiver_that_nothing_times_slides_are_at_least_as_told(seconds: float) -> None:
    def slow(r: Recording) -> Recording:
        some = np.flatnonzero(np.diff(r.t // 10**9, prepend=-1))
        return replace(r, t=r.t[some] + round(seconds * 1e9), value=r.value[some])

    alone = [r for r in recordings("low-adhesion") if r.axle in (None, 1)]
    with TemporaryDirectory() as folder:
        log = write(Path(folder) / "gnss.csv", changed(alone, "train_speed", slow))
        result = analyze.analyze(log, settings.load(), ["leso"])
    (axle,) = result.axles
    assert axle.record.train_speed_late is None
    (found,) = (f for f in result.findings if f.code == "train-speed-slow")
    assert found.severity == "warning"
    assert found.values["delay_s"] == pytest.approx(1.5, rel=0.05)
    found, _ = rail_under_slides.summary(axle, result.vehicle)
    assert found.rail is None
    assert axle.record.true_slip is not None
    for x in found.slides:
        assert x.is_lower_bound
        true_slip = np.nanmax(axle.record.true_slip[x.samples])
        assert x.max_slip is None or x.max_slip < true_slip + 0.01


def seen(t: np.ndarray, v: np.ndarray, rim: np.ndarray, K: np.ndarray) -> AxleResult:
    """What is observed of a wheel beside a train speed that is on time."""
    record = AxleRecord(
        1, np.round(t * 1e9).astype(np.int64), K, K, rim / 0.42, (slice(0, len(t)),),
        train_speed=v, train_speed_late=Parameter(0.0, 0.0),
    )  # fmt: skip
    ref = Reference("none", "none", np.full(len(t), 1e3), np.full(len(t), 5.0), np.zeros(len(t)))
    axle = AxleResult(record, ref, {}, (), (slice(0, len(t)),))
    return slip.observe_slip(axle, Vehicle(), 1.0, slope.Params(), slope.Bands())[0]


def test_a_wheel_that_no_brake_slows_does_not_slide() -> None:
    t = np.arange(0.0, 40.0, 0.05)
    v = 0.4 * t
    rim = np.interp(t - 0.3, t, v)  # a sensor that averages
    assert sliding.slides(seen(t, v, rim, np.full(len(t), 1e4)))
    assert not sliding.slides(seen(t, v, rim, np.where(t < 1.0, 1e4, 0.0)))


def test_a_wheel_that_a_motor_spins_tells_no_diameter() -> None:
    t = np.arange(0.0, 100.0, 0.05)
    v = np.interp(t, [0.0, 20.0, 40.0, 100.0], [15.0, 14.0, 4.0, 16.0])
    rim = v * np.where(t > 40.0, 1.05, 1.01)  # 1 % larger than stated
    axle = seen(t, v, rim, np.where((t > 20.0) & (t < 40.0), 1e4, 0.0))
    assert axle.slip is not None
    assert np.abs(axle.slip[t < 20.0]).max() < 1e-3


def test_what_the_noise_of_a_speed_makes_of_slip_is_no_slide() -> None:
    t = np.arange(0.0, 60.0, 0.05)
    v = np.interp(t, [0.0, 40.0, 60.0], [20.0, 1.1, 1.1])
    random = np.random.default_rng(3)
    slow = np.convolve(
        random.normal(0.0, 0.05, len(t) + 19), np.ones(20) / math.sqrt(20.0), "valid"
    )
    rim = v * np.where((t > 10.0) & (t < 11.0), 0.8, 1.0)
    found = sliding.slides(seen(t, v + slow, rim, np.full(len(t), 1e4)))
    assert [round(x.start * 1e-9) for x in found] == [10]


def test_a_spike_does_not_become_the_train() -> None:
    t = np.arange(0, 10 * 10**9, 2 * 10**7)
    wheel, K = np.full(len(t), 40.0), np.zeros(len(t))
    wheel[250] = 80.0
    record = AxleRecord(1, t, K, K, wheel, (slice(0, len(t)),))
    ((made,), _) = wheel_calibration.with_reference_speed([record], [record], Vehicle(), 0)
    assert np.abs(made.train_speed - 40.0 * 0.42).max() < 0.1


def test_slope_settings_are_checked() -> None:
    with pytest.raises(settings.UserError, match="not below"):
        settings.load(None, ["bands.slip_low=0.5"])
    with pytest.raises(settings.UserError, match="out of range"):
        settings.load(None, ["slope.delta=-1"])
    stated = settings.load(None, ["bands.slip_high=0.1", "slope.rho=5"])
    assert stated.bands.slip_high == 0.1
    assert settings.load().over(settings.tree(stated, [])).slope.rho == 5.0


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit, "DRAWS", 50)
    log = write(tmp_path / "stop.csv", recordings("low-adhesion"))

    run = functools.partial(in_process, tmp_path, "slip")

    done = run(log.name, "--json", "--axle", "1", "--axle", "3")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["schema"] == "adhesion.slip/1"
    (outputs,) = document["outputs"].values()
    assert outputs == {kind: f"stop.slip.{kind}" for kind in ("mcap", "rrd")}
    assert all((tmp_path / path).is_file() for path in outputs.values())
    assert {axle["log"] for axle in document["axles"]} == set(document["outputs"])
    first, third = document["axles"]
    assert first["axle"] == 1
    assert first["peak_slip_ci"][0] < first["peak_slip"] < first["peak_slip_ci"][1]
    assert 5.0 < first["peak_speed_mps"] < 25.0
    assert third["peak_speed_mps"] is None
    metadata = open_source(tmp_path / outputs["mcap"], ReadOptions()).metadata
    assert json.loads(metadata["adhesion.slip"]["json"])["axles"] == document["axles"]
    assert sum(first["regions"].values()) == pytest.approx(1.0)
    assert set(first["regions"]) == set(slope.REGIONS)
    assert first["fit"]["f0"]["ci"][0] < 0.06 < first["fit"]["f0"]["ci"][1]
    assert first["slides"][0]["energy_j"] > 5e4
    assert 0.0 < first["slip_rmse"] < 3e-3
    assert first["train_speed_late_s"] == 0.0  # in time, as far as can be told
    assert 0.0 < first["train_speed_late_sigma_s"] < 0.05
    assert third["peak_slip"] is None
    assert third["fit"] is None
    assert (first["fit_curve"], third["fit_curve"]) == ("polach", None)
    assert third["slides"] == []
    again = run(log.name, "--force", "--axle", "1")
    assert again.returncode == 0, again.stderr
    assert again.stdout.endswith("wrote stop.slip.sha256\n")
    listed = (tmp_path / "stop.slip.sha256").read_text().splitlines()[1:]
    assert [line.split("  ")[1] for line in listed] == ["stop.slip.mcap", "stop.slip.rrd"]
    assert "utilisation" in again.stdout
    assert "wrote stop.slip.mcap" in again.stdout
    messages = _messages(tmp_path / "stop.slip.mcap", "/axle/1/slip")
    known = [math.isfinite(m.slope) for m in messages if m.slip > 0.03]
    assert sum(known) > 0.4 * len(known)
    assert {m.region for m in messages} == set(slope.REGIONS)
    assert all(0.0 <= m.slope_confidence <= 1.0 for m in messages)
    truth = _messages(tmp_path / "stop.slip.mcap", "/axle/1/truth")
    moves = [m.slip for m in truth if m.HasField("slip") and m.timestamp.seconds < 30]
    assert max(moves) == pytest.approx(0.156, abs=0.005)
    told = {m.code for m in _messages(tmp_path / "stop.slip.mcap", "/events")}
    assert {"slide", "region-change"} <= told


def _messages(path: Path, topic: str) -> list:
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [m for _, _, _, m in reader.iter_decoded_messages(topics=[topic])]


@pytest.mark.parametrize(
    "lag",
    [
        pytest.param(0.0, id="in time", marks=pytest.mark.slow),
        pytest.param(0.5, id="late"),
        pytest.param(None, id="made of the axles"),
    ],
)
def test_a_result_is_told_as_its_log_was(tmp_path: Path, lag: float | None) -> None:
    """Same clock, same refusals: a train speed made of the axles is none that was measured."""
    log = late(recordings("low-adhesion", train=lag is not None), "train_speed", lag or 0.0)
    first = analyze.analyze(
        write(tmp_path / "log.csv", log), settings.load(), ["leso"], train_speed=True
    )
    mcap.write_results(tmp_path / "log.mcap", [first], "{}")
    again = analyze.analyze(tmp_path / "log.mcap", settings.load(), ["leso"], train_speed=True)
    for a, b in zip(first.axles, again.axles, strict=True):
        one, other = a.record, b.record
        assert one.train_speed_made == other.train_speed_made == (lag is None)
        assert one.train_speed_late == other.train_speed_late
        assert one.train_speed == pytest.approx(other.train_speed, nan_ok=True)
        assert a.slip == pytest.approx(b.slip, nan_ok=True)
        assert [x[:5] for x in sliding.slides(a)] == [x[:5] for x in sliding.slides(b)]
    assert [f.code for f in again.findings] == [
        f.code for f in first.findings if not f.code.startswith(("csv-", "vehicle-default"))
    ]  # the vehicle of a result is the result's


def rail_fit(f0: float, seed: int) -> fit.RailFit:
    """The fit of noisy points on a rail with this friction."""
    t, random = np.arange(0.0, 12.0, 0.02), np.random.default_rng(seed)
    creep = 0.05 + 0.045 * np.sin(2.0 * t + seed)
    condition = creep_law.condition("low")._replace(f0=f0)
    mu = fit.curve(condition, 15.0, creep, Vehicle())
    mu *= 1.0 + 0.02 * random.standard_normal(len(t))
    points = fit.Points(
        t, np.full(len(t), 15.0), creep, mu, *(3 * [0.0 * t]), 0.0 * t[:, None], t >= 0.0
    )
    rail = fit.fit(points, Vehicle(), 1e-3, 0.05, 40)
    assert rail
    return rail


def test_rails_of_other_friction_contradict_each_other_and_the_same_do_not() -> None:
    low, again, high = rail_fit(0.05, 1), rail_fit(0.05, 2), rail_fit(0.08, 3)
    for pair, contradicts in (((low, high), True), ((high, low), True), ((low, again), False)):
        assert fit.contradicts(*pair, Vehicle()) is contradicts


def test_slip_and_analyze_know_the_utilisation_of_the_same_slides() -> None:
    result = analysed("low-adhesion")
    for axle in result.axles:
        (place,) = told("low-adhesion", axle.record.axle).places or (None,)
        braked = [a for a in find_applications(axle, result.vehicle) if a.slides]
        assert [a.utilisation for a in braked] == [
            place.rail.utilisation.value for place in [place] if place and place.rail
        ]
