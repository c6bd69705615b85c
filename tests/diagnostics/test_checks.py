"""Sensors that lie: silent on good logs, told or harmless on bad ones."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import APART, CODES, DEFAULT, FORCE, SENSORS, UNITS, VEHICLES, clean, found
from helpers.simulated import Recordings

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding, Severity
from adhesion_cli.core.model import Result, Vehicle
from adhesion_cli.core.physics import G, clamping_force, cylinder_pressure, force_line, wheelset
from adhesion_cli.core.units import ATMOSPHERE
from adhesion_cli.diagnostics import diagnosis, registry
from adhesion_cli.diagnostics.scene import Scene
from adhesion_cli.formats.open import open_source
from adhesion_cli.rail.applications import find_applications
from adhesion_cli.train.explanation import AS_STATED
from adhesion_cli.train.grid import Grid
from adhesion_cli.wsp import simulate

ROOT = Path(__file__).parents[2]


def codes(log: Recordings, folder: Path) -> set[str]:
    return {f.code for f in found(log, folder)}


# --- good logs ----------------------------------------------------------------------------------

TRUE = {
    "leaf-film": {"train-speed-delay"},  # its train speed is 0.1 s late
    "paper-constant": {"train-speed-delay"},  # its wheel speed is 0.05 s late
    "roller-rig": {"deceleration-unexplained"},  # an info: rollers hold its speed
}
GOOD: dict[str, dict[str, float]] = {
    "as it is": {},
    "1 Hz": {"rate": 1.0},
    "2 Hz, no noise": {"rate": 2.0, "noise": 0.0},
    "5 Hz, 1 km/h steps": {"rate": 5.0, "kmh": 1.0},
    "10 Hz, 0.1 km/h steps": {"rate": 10.0, "kmh": 0.1},
    "50 Hz, train speed": {"rate": 50.0, "train": True},
    "100 Hz, noisy": {"rate": 100.0, "noise": 1e-2},
}
MORE: dict[str, dict[str, float]] = {
    "no train speed": {"train": False},
    "10 Hz, 0.1 km/h steps, no train speed": {"rate": 10.0, "train": False, "kmh": 0.1},
    "100 Hz, no noise": {"rate": 100.0, "noise": 0.0, "train": True},
    "1 kHz": {"rate": 1000.0},
}


@pytest.mark.parametrize("case", GOOD)
@pytest.mark.parametrize("name", sorted(simulate.scenarios()))
def test_a_good_log_is_not_accused(name: str, case: str, tmp_path: Path) -> None:
    assert codes(simulated.recordings(name, **GOOD[case]), tmp_path) <= TRUE.get(name, set())


def test_rollers_that_hold_the_speed_are_no_warning(tmp_path: Path) -> None:
    told = simulated.told(simulated.recordings("roller-rig"), tmp_path, DEFAULT)
    (one,) = [f for f in told if f.code == "deceleration-unexplained"]
    assert one.severity == "info"
    assert one.values["difference_mps2"] == pytest.approx(-0.64, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("case", {**GOOD, **MORE})
@pytest.mark.parametrize("name", sorted(simulate.scenarios()))
def test_no_good_log_is_accused(name: str, case: str, vehicle: str, tmp_path: Path) -> None:
    stated = settings.load(None, VEHICLES[vehicle])
    sensors = {**GOOD, **MORE}[case]
    other = stated.vehicle if vehicle != "paper" else None
    for seed in range(1 if case == "1 kHz" else 6):
        log = simulated.recordings(name, seed=seed, vehicle=other, **sensors)
        told = found(log, tmp_path, stated)
        if sensors.get("train") is False:
            # A wheel that slows too little is on a rig or slides: without a train speed a hint.
            told = [f for f in told if f.severity != "info"]
        assert {f.code for f in told} <= TRUE.get(name, set()), (seed, told)


@pytest.mark.parametrize("path", sorted((ROOT / "sample_logs").glob("low-adhesion.*")))
def test_the_sample_logs_are_not_accused(path: Path) -> None:
    log = read(open_source(path, DEFAULT.read), DEFAULT.mappings, DEFAULT.vehicle)
    assert not prepare(log, DEFAULT.vehicle).findings


# --- faults -------------------------------------------------------------------------------------

ALWAYS = simulated.during(0.0, math.inf)
Fault = tuple[set[str], Recordings]


def faults(log: Recordings, random: np.random.Generator) -> dict[str, Fault]:
    """One fault of each kind, at a place and of a size drawn at random, and what must be told."""
    axles = len(simulated.which(log, "wheel_speed"))
    axle = int(random.integers(1, axles + 1))
    end = float(log[0].t[-1]) * 1e-9
    at, seconds = random.uniform(0.1, 0.6) * end, random.uniform(0.5, 12.0)
    unit = {r.signal: r.unit for r in log}
    known = ["Pa", "kPa", "MPa", "bar", "psi"]
    speeds = [u for u in ("rad/s", "rpm", "m/s", "km/h") if u != unit["wheel_speed"]]
    brake = "pressure" if "pressure" in unit else "clamping_force"
    fast, high = (
        float(random.uniform(1.3, 3.0) * log[simulated.which(log, s)[0]].value.max())
        for s in ("wheel_speed", brake)
    )
    some = simulated.single(random, int(random.integers(1, 20)))
    then = simulated.during(at, seconds)
    stuck = {"pressure-stuck", *FORCE}
    drawn = {
        "stuck speed": (
            {"speed-stuck"}, simulated.stuck(log, "wheel_speed", axle, at, seconds),
        ),
        "all speeds stuck": (
            {"speed-stuck", *UNITS}, simulated.stuck(log, "wheel_speed", 0, at, seconds),
        ),
        "no speed": (
            {"speed-stuck"},
            simulated.put(log, "wheel_speed", axle, then, 0.0),
        ),
        "missing speed": (
            {"gap"}, simulated.put(log, "wheel_speed", axle, then, math.nan),
        ),
        "speed drops": (
            {"speed-outlier"}, simulated.put(log, "wheel_speed", axle, some, 0.0),
        ),
        "speed spikes": (
            {"speed-outlier", *UNITS}, simulated.put(log, "wheel_speed", axle, some, fast),
        ),
        "speed unit": (
            FORCE, simulated.mislabelled(log, "wheel_speed", str(random.choice(speeds))),
        ),
        "speed turned": (
            {"reverse-running"}, simulated.scaled(log, "wheel_speed", axle, -1.0),
        ),
        "time unit": (FORCE, simulated.slower(log, float(random.choice([1e-3, 1e3])))),
        "stuck brake": (stuck, simulated.stuck(log, brake, 0, at, seconds)),
        "no brake": (stuck, simulated.put(log, brake, 0, then, 0.0)),
        "missing brake": ({"gap"}, simulated.put(log, brake, axle, then, math.nan)),
        "brake drops": ({"pressure-outlier"}, simulated.put(log, brake, axle, some, 0.0)),
        "brake spikes": (
            {"pressure-outlier", *UNITS}, simulated.put(log, brake, axle, some, high),
        ),
        "late brake": (
            {"pressure-delay", *FORCE},
            simulated.late(log, brake, float(random.choice([-5.0, -1.0, -0.4, 0.4, 1.0, 5.0]))),
        ),
        "scaled brake": (
            FORCE, simulated.scaled(log, brake, 0, float(random.choice([0.4, 0.6, 1.6, 2.5]))),
        ),
    }  # fmt: skip
    if brake == "pressure":
        drawn["stuck pressure"] = (stuck, simulated.stuck(log, "pressure", axle, at, seconds))
        drawn["saturated pressure"] = (
            {"pressure-saturated", "pressure-outlier", *FORCE},
            simulated.saturated(log, float(random.uniform(0.3, 0.9))),
        )
        drawn["pressure unit"] = (
            FORCE,
            simulated.mislabelled(
                log, "pressure", str(random.choice([u for u in known if u != unit["pressure"]]))
            ),
        )
        drawn["from vacuum"] = (
            {"pressure-absolute", *FORCE}, simulated.scaled(log, "pressure", 0, 1.0, ATMOSPHERE),
        )  # fmt: skip
        drawn["below zero"] = (
            {"pressure-negative"}, simulated.scaled(log, "pressure", 0, 1.0, -ATMOSPHERE),
        )  # fmt: skip
        drawn["pressure turned"] = (
            {"pressure-negative"}, simulated.scaled(log, "pressure", axle, -1.0),
        )  # fmt: skip
    if axles > 1:
        one, other = (int(x) + 1 for x in random.permutation(axles)[:2])
        drawn["dead speed"] = (
            {"speed-stuck"},
            simulated.put(log, "wheel_speed", axle, ALWAYS, fast * random.random()),
        )
        if brake == "pressure":
            drawn["dead pressure"] = (
                {"pressure-stuck"},
                simulated.put(log, brake, axle, ALWAYS, high / 3.0 * random.random()),
            )
        drawn["swapped axles"] = ({"axles-swapped"}, simulated.swapped(log, one, other))
    return drawn


def analysed(log: Recordings, folder: Path) -> Result:
    path = simulated.write(folder / "log.csv", log)
    return analyze.analyze(path, DEFAULT, algos=["leso"])


def outside(result: Result) -> float:
    """Share of the truth, of braked wheels that turn, outside the reference's own 95 % band."""
    wrong = known = 0
    for a in result.axles:
        truth = a.record.truth
        assert truth is not None
        braked = (a.record.clamping_force_smooth > 100.0) | (np.abs(truth) > 100.0)
        there = braked & np.isfinite(truth) & np.isfinite(a.reference.force)
        known += int(there.sum())
        wrong += int((there & ((truth < a.reference.lower) | (truth > a.reference.upper))).sum())
    return wrong / max(known, 1)


DRIVEN = sorted(set(simulate.scenarios()) - {"roller-rig"})


def warned(findings: Sequence[Finding]) -> set[str]:
    """Codes that end with exit 3: what only informs leaves a result that is trusted."""
    return {f.code for f in findings if f.severity != "info"}


def told_of(log: Recordings, folder: Path) -> set[str]:
    """Codes of all warnings before anything is computed, "refused" where it is not."""
    path = simulated.write(folder / "log.csv", log)
    try:
        one = read(open_source(path, DEFAULT.read), DEFAULT.mappings, DEFAULT.vehicle)
        return warned([*one.findings, *prepare(one, DEFAULT.vehicle).findings])
    except UserError:
        return {"refused"}


UNSEEN = {
    # One wheel, no train speed, a brake from the first sample: a rail with little adhesion, a slide
    # or another vehicle looks the same.
    ("paper-constant", "scaled brake"), ("paper-varying", "scaled brake"),
    ("paper-constant", "speed unit"), ("paper-varying", "speed unit"),
    # One long brake on a slippery rail: a gradient of 2.6 % looks the same.
    ("leaf-film", "scaled brake"),
    # All wheels slide all the time: nothing follows the pressure.
    ("slippery-stop", "late brake"), ("slippery-stop", "time unit"),
}  # fmt: skip


def never_confident_and_wrong(name: str, seed: int, folder: Path, kinds: slice) -> None:
    """Every fault is told, or what comes out holds the truth as well as without it."""
    random = np.random.default_rng([seed, *name.encode()])
    log = clean(name, seed, str(random.choice(list(SENSORS))))
    allowed = None
    for kind, (expected, bad) in list(faults(log, random).items())[kinds]:
        told = told_of(bad, folder)
        if told & {*expected, "refused"} or (name, kind) in UNSEEN:
            continue
        if allowed is None:
            allowed = max(0.1, outside(analysed(log, folder)) + 0.05)
        result = analysed(bad, folder)
        told = warned(result.findings)
        assert told & expected or outside(result) < allowed, (kind, told & CODES)


@pytest.mark.parametrize("name", DRIVEN)
def test_no_fault_is_confident_and_wrong(name: str, tmp_path: Path) -> None:
    start = DRIVEN.index(name) % 3
    never_confident_and_wrong(name, 0, tmp_path, slice(start, None, 3))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 9))
@pytest.mark.parametrize("name", DRIVEN)
def test_no_fault_ever_is(name: str, seed: int, tmp_path: Path) -> None:
    never_confident_and_wrong(name, seed, tmp_path, slice(None))


@pytest.mark.parametrize("seconds", [-2.0, -1.0, 1.0, 1.8])
@pytest.mark.parametrize("name", ["low-adhesion", "four-axles", "leaf-film"])
def test_the_train_speeds_clock_is_measured(name: str, seconds: float, tmp_path: Path) -> None:
    (told,) = found(simulated.late(clean(name, 1, "as it is"), "train_speed", seconds), tmp_path)
    assert (told.code, told.severity) == ("train-speed-delay", "info")
    measured, doubt = told.values["delay_s"], told.values["delay_u95_s"]
    own = {
        "leaf-film": 0.1,
        "four-axles": -0.025,
    }  # late in the scenario; pulses of a past interval
    assert measured == pytest.approx(seconds + own.get(name, 0.0), abs=0.05 + doubt)


@pytest.mark.parametrize("plus", [-1.0, -0.4, 0.4, 1.0])
@pytest.mark.parametrize("name", ["low-adhesion", "four-axles", "service-brake"])
def test_a_train_speeds_offset_is_no_other_clock(name: str, plus: float, tmp_path: Path) -> None:
    log = simulated.recordings(name, rate=20.0, train=True)
    told = found(simulated.scaled(log, "train_speed", 0, 1.0, plus), tmp_path)
    (offset,) = [f for f in told if f.code.startswith("train-")]
    assert (offset.code, offset.severity) == ("train-speed-offset", "warning")
    measured, doubt = offset.values["offset_mps"], offset.values["offset_u95_mps"]
    assert measured == pytest.approx(plus, abs=doubt)


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


def bent(log: Recordings, signal: str, axle: int, of: Callable[[np.ndarray], np.ndarray]
) -> Recordings:  # fmt: skip
    """Values times a function of time [s]."""
    return simulated.changed(
        log, signal, lambda r: replace(r, value=of(r.t * 1e-9) * r.value, decimals=None), axle
    )


@pytest.mark.parametrize("axle", [0, 3])  # that one does not slide
@pytest.mark.parametrize("rate", [1.0, 5.0, 50.0])
def test_wheel_speeds_that_drift_from_the_trains_are_told(
    rate: float, axle: int, tmp_path: Path
) -> None:
    log = simulated.recordings("low-adhesion", rate=rate, train=True)
    up = bent(log, "wheel_speed", axle, lambda t: 1.0 + 0.015 * np.maximum(t - 8.0, 0.0))
    told = [f for f in found(up, tmp_path) if f.code in APART]
    assert "warning" in {f.severity for f in told}
    assert {f.channel.split()[0] for f in told} >= {f"wheel_speed_{axle or 3}"}


@pytest.mark.parametrize("rate", [2.0, 20.0])
@pytest.mark.parametrize("by", [0.0, 0.06, -0.06])
def test_a_speed_that_drifts_shows_between_brakes(rate: float, by: float, tmp_path: Path) -> None:
    random, t = np.random.default_rng(1), np.arange(0.0, 90.0, 1.0 / rate)
    on = sum(np.clip(t - at, 0.0, 1.0) * np.clip(at + 8.0 - t, 0.0, 1.0) for at in (12, 42, 72))
    w, slows = wheelset(DEFAULT.vehicle, 1), 0.8 * on
    v = 38.0 - np.cumsum(slows) / rate
    K = (w.mass + w.inertia / w.radius**2) * slows / w.phi
    p = np.where(on > 0.0, cylinder_pressure(force_line(DEFAULT.vehicle), K), 0.0)
    p += random.normal(0.0, 1000.0, len(t))
    train = v * (1.0 + by * t / 90.0) + random.normal(0.0, 0.01, len(t))
    rows = (f"{a:.3f},{b:.4f},{c:.4f},{d:.1f}" for a, b, c, d in zip(t, train, v, p, strict=True))
    path = tmp_path / "log.csv"
    head = "time [s],train_speed [m/s],wheel_speed [m/s],bc_pressure [Pa]"
    path.write_text("\n".join([head, *rows]) + "\n")
    one = read(open_source(path, DEFAULT.read), DEFAULT.mappings, DEFAULT.vehicle)
    told = [f for f in prepare(one, DEFAULT.vehicle).findings if f.code in APART]
    assert [f.channel.split()[0] for f in told] == ["wheel_speed"] * (by != 0.0)
    assert all((f.code, f.severity) == ("wheel-speed-drift", "warning") for f in told)
    assert all(f.values["share"] * by < 0.0 for f in told)  # beside the train


@pytest.mark.parametrize("scale", [0.9, 0.95, 1.05, 1.1])
def test_a_wheels_diameter_is_measured(scale: float, tmp_path: Path) -> None:
    log = simulated.worn(clean("leaf-film", 1, "as it is"), 1, scale)  # in rpm
    (told,) = [f for f in found(log, tmp_path) if f.code not in TRUE["leaf-film"]]
    assert told.code == "wheel-diameter"
    assert told.values["diameter_m"] == pytest.approx(
        0.84 / scale, rel=0.01
    )  # it creeps on a wet rail
    for case, train in (("low-adhesion", True), ("four-axles", False)):
        told = found(simulated.worn(simulated.recordings(case, train=train), 4, scale), tmp_path)[0]
        assert (told.code, told.channel) == (
            "wheel-diameter-in-logger",
            "wheel_speed_4 [km/h]",
        )


@pytest.mark.parametrize("pair", [(1, 2), (1, 3), (2, 4)])
def test_swapped_axles_are_found_where_they_slide(pair: tuple[int, int], tmp_path: Path) -> None:
    log = clean("low-adhesion", 1, "as it is")
    found = codes(simulated.swapped(log, *pair), tmp_path)
    assert "axles-swapped" in found
    assert found <= {"axles-swapped", "axle-pressure-differs"}  # the one is a reason of the other


@pytest.mark.parametrize(
    ("signal", "unit", "likely"),
    [
        ("pressure", "kPa", "bar"), ("pressure", "Pa", "bar"), ("pressure", "MPa", "bar"),
        ("wheel_speed", "m/s", "km/h"),
    ],
)  # fmt: skip
def test_the_unit_that_was_meant_is_named(
    signal: str, unit: str, likely: str, tmp_path: Path
) -> None:
    told = found(
        simulated.mislabelled(clean("service-brake", 1, "as it is"), signal, unit), tmp_path
    )
    (one,) = told
    assert one.code in UNITS
    assert one.severity == "warning"
    assert likely in "".join(one.names.values())


def test_another_vehicle_is_told(tmp_path: Path) -> None:
    stated = settings.load(None, ["vehicle.lever_ratio=2.4"])
    log = simulated.recordings("service-brake", vehicle=stated.vehicle)
    (told,) = found(log, tmp_path)
    assert (told.code, told.severity) == ("vehicle-suspect", "warning")
    assert not found(log, tmp_path, stated)


@pytest.mark.parametrize("friction", [0.15, 0.3])
@pytest.mark.parametrize("gradient", [-25.0, 0.0, 25.0])
@pytest.mark.parametrize("rate", [1.0, 20.0])
def test_the_friction_that_would_fit_is_told(
    friction: float, gradient: float, rate: float, tmp_path: Path
) -> None:
    t = np.arange(0.0, 40.0, 1.0 / rate)
    p = 4e5 * np.clip((t - 4.0) / 2.0, 0.0, 1.0) * np.clip((26.0 - t) / 2.0, 0.0, 1.0)
    stated = settings.load(None, ["vehicle.lever_ratio=2.4"])
    w = wheelset(stated.vehicle, 1)
    slows = w.a * friction * (1.0 - w.rolling) * clamping_force(p, stated.vehicle)
    slows += w.rolling * G * gradient / 1000.0 / 0.42
    y = 90.0 - np.cumsum(slows) / rate + np.random.default_rng(2).normal(0.0, 3e-3, len(t))
    rows = (f"{a:.3f},{b:.0f},{c:.5f}\n" for a, b, c in zip(t, p, y, strict=True))
    path = tmp_path / "log.csv"
    path.write_text("time [s],bc_pressure [Pa],wheel_speed [rad/s]\n" + "".join(rows))
    one = read(open_source(path, stated.read), stated.mappings, stated.vehicle)
    told = [f for f in prepare(one, stated.vehicle).findings if f.code in CODES]
    assert [(f.code, f.severity) for f in told] == [("vehicle-suspect", "warning")] * (
        friction != 0.3
    )
    assert all(f.values["factor"] == pytest.approx(friction / 0.3, rel=0.1) for f in told)
    for f in told:  # its remedy has one line for each parameter
        lines = re.findall(r"--set '([^']+)'", f.names["fits"])
        fits = settings.load(assignments=lines, folder=False).vehicle
        assert fits.friction.value == pytest.approx(friction, rel=0.1)


@pytest.mark.parametrize("name", ["service-brake", "low-adhesion"])
def test_all_speeds_in_another_unit_are_told_as_that(name: str, tmp_path: Path) -> None:
    log = simulated.recordings(name, train=True)
    for signal in ("wheel_speed", "train_speed"):
        log = simulated.scaled(log, signal, 0, 3.6)
    (told,) = found(log, tmp_path)
    assert (told.code, told.severity) == ("vehicle-suspect", "warning")
    assert "friction" not in told.names["fits"]


def test_a_pressure_lost_on_a_single_axle_is_a_warning(tmp_path: Path) -> None:
    log = [r for r in simulated.recordings("service-brake", train=False) if r.axle in (None, 1)]
    lost = simulated.put(log, "pressure", 0, simulated.during(10.0, 6.0), 0.0)
    told = [f for f in analysed(lost, tmp_path).findings if f.code.startswith("pressure-")]
    assert "warning" in {f.severity for f in told}


@pytest.mark.parametrize("share", [0.5, 0.8])
@pytest.mark.parametrize("name", ["service-brake", "low-adhesion"])
def test_a_saturated_pressure_leaves_the_band_open(name: str, share: float, tmp_path: Path) -> None:
    whole = clean(name, 1, "as it is")
    assert all(np.isfinite(a.reference.upper).sum() == np.isfinite(a.reference.force).sum()
               for a in analysed(whole, tmp_path).axles)  # fmt: skip
    result = analysed(simulated.saturated(whole, share), tmp_path)
    assert "pressure-saturated" in warned(result.findings)
    for a in result.axles:
        assert a.record.pressure is not None
        ends = a.record.pressure >= a.record.pressure.max()
        known = np.isfinite(a.reference.force)
        assert (ends & known).any()
        assert (np.isfinite(a.reference.upper) == (known & ~ends)).all()
    assert outside(result) < 0.1


@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("axles", [(1,), (1, 2, 3, 4)])
@pytest.mark.parametrize("name", ["service-brake", "four-axles"])
def test_what_follows_of_a_saturated_pressure_is_not_told_beside_it(
    name: str, axles: tuple[int, ...], share: float, tmp_path: Path
) -> None:
    whole = clean(name, 1, "as it is")
    ends = simulated.saturated(whole, share)
    log = [bad if r.axle in (None, *axles) else r for r, bad in zip(whole, ends, strict=True)]
    assert {f.code for f in found(log, tmp_path)} == {"pressure-saturated"}


@pytest.mark.parametrize("times", [3.0, 5.0, 8.0, 10.0, 20.0])
def test_time_stamps_too_fast_are_told_by_as_much_with_a_train_speed_too(
    times: float, tmp_path: Path
) -> None:
    log = simulated.slower(clean("four-axles", 1, "as it is"), 1.0 / times)
    (told,) = found(log, tmp_path)
    assert told.code in {"deceleration-unit-suspect", "vehicle-suspect"}
    assert told.severity == "warning"
    assert told.values["factor"] == pytest.approx(times, rel=0.1)


def test_milliseconds_taken_for_seconds_are_told_as_that(tmp_path: Path) -> None:
    told = found(simulated.slower(clean("service-brake", 1, "as it is"), 1e3), tmp_path)
    assert [(f.code, f.severity) for f in told] == [("deceleration-unit-suspect", "warning")]
    assert "ms for s" in told[0].names["candidates"]


def test_a_brake_the_log_does_not_know_is_told(tmp_path: Path) -> None:
    def off(r: simulate.Recording) -> simulate.Recording:
        return replace(r, value=0.0 * r.value)

    log = simulated.changed(clean("service-brake", 1, "as it is"), "pressure", off)
    assert codes(log, tmp_path) == {"brake-unknown"}


@pytest.mark.parametrize("times", [1.05, 2.0])
def test_a_spring_that_takes_the_pressure_is_told_with_both(times: float, tmp_path: Path) -> None:
    log = clean("service-brake", 1, "as it is")
    (bar,) = (float(log[i].value.max()) for i in simulated.which(log, "pressure"))
    line, paper = force_line(Vehicle()), Vehicle().spring_force.value
    force = paper * times * 1e5 * bar * line.per_pascal / line.at_zero
    told = found(log, tmp_path, settings.load(None, [f"vehicle.spring_force={force:g}"]))
    (one,) = [f for f in told if f.code == "pressure-below-spring"]
    assert {f.code for f in told}.isdisjoint({"brake-unknown", "pressure-unit-suspect"})
    assert 0.5 * bar < one.values["pressure_bar"] <= bar
    assert one.values["spring_bar"] == pytest.approx(times * bar, rel=1e-3)


def test_a_brake_that_pushes_is_told_with_the_sensor(tmp_path: Path) -> None:
    log = simulated.scaled(clean("low-adhesion", 1, "as it is"), "pressure", 0, 0.3)
    told = [f for f in analysed(log, tmp_path).findings if f.code == "force-negative"]
    assert {f.channel for f in told} == {f"axle {i}" for i in (1, 2, 3, 4)}
    assert all(f.severity == "warning" and f.first_s > 3.0 for f in told)


def test_a_force_less_sure_than_large_is_not_shown(tmp_path: Path) -> None:
    result = analysed(simulated.recordings("service-brake", rate=10.0, noise=1e7), tmp_path)
    (told,) = [f for f in result.findings if f.code == "reference-noise"]
    assert (told.count, told.channel) == (1, "axle 1")
    (axle,) = result.axles
    assert all(s.rmse_n is None for s in axle.scores)
    assert [a.force for a in find_applications(axle, result.vehicle)] == [
        None
    ]  # its slides are still shown
    braked = axle.record.clamping_force > 1000.0
    assert not np.isfinite(axle.reference.force[braked]).any()


# --- the page that lists them all ---------------------------------------------------------------


def test_what_only_informs_hides_no_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    def telling(rank: int, severity: Severity) -> registry.Check:
        about = registry.About("", "one", rank)
        one = [Finding(severity, severity)]
        return registry.Check(str(rank), about, tuple, lambda *_: iter(one))

    checks = telling(1, "info"), telling(2, "warning"), telling(3, "error")
    monkeypatch.setattr(diagnosis, "registry", lambda: {c.name: c for c in checks})
    x = np.zeros((1, 9))
    grid = Grid(0, 1.0, x, x, x, None)
    told = diagnosis.diagnose(Scene([], grid, DEFAULT.vehicle, 0, AS_STATED))
    assert [f.code for f in told] == ["info", "warning"]
