"""Sensors that lie, in every scenario: reported, or harmless to the result."""

import math
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import (
    CODES,
    DEFAULT,
    FORCE,
    SENSORS,
    UNITS,
    analysed,
    clean,
    outside,
    warned,
)
from helpers.simulated import Recordings

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.units import ATMOSPHERE
from adhesion_cli.formats.open import open_source
from adhesion_cli.wsp import simulate

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


DRIVEN = sorted(set(simulate.scenarios()) - {"roller-rig"})


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
    """Each kind in one scenario."""
    never_confident_and_wrong(name, 0, tmp_path, slice(DRIVEN.index(name), None, len(DRIVEN)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(9))
@pytest.mark.parametrize("name", DRIVEN)
def test_no_fault_ever_is(name: str, seed: int, tmp_path: Path) -> None:
    never_confident_and_wrong(name, seed, tmp_path, slice(None))
