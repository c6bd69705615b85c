"""Sensors that lie: silent on good logs, told or harmless on bad ones."""

import ast
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import simulated
from simulated import Recordings

from adhesion_cli import analysis, settings, simulate
from adhesion_cli.model import Finding, Result, Vehicle
from adhesion_cli.read import align
from adhesion_cli.read.log import open_source, read

ROOT = Path(__file__).parent.parent
CODES = {
    "speed-frozen", "pressure-frozen", "pressure-saturated", "unit-suspect", "vehicle-suspect",
    "brake-unknown", "clock-offset", "wheel-diameter", "axles-swapped", "reference-noise",
    "implausible",
}  # fmt: skip
DEFAULT = settings.load()
VEHICLES = {
    "paper": [],
    "light": ["vehicle.axle_mass=3000", "vehicle.wheelset_inertia=60"],
    "heavy": ["vehicle.axle_mass=14000", "vehicle.lever_ratio=3.2"],
    "shoes": ["vehicle.axle_mass=9000", "vehicle.lever_ratio=4", "vehicle.friction=0.15"],
}


def found(log: Recordings, folder: Path, stated: settings.Settings = DEFAULT) -> list[Finding]:
    """What the checks say of a log; not its other findings, as of gaps."""
    path = simulated.write(folder / "log.csv", log)
    one = read(open_source(path, stated.read), stated.mappings, stated.vehicle)
    return [f for f in align.records(one, stated.vehicle)[1] if f.code in CODES]


def codes(log: Recordings, folder: Path) -> set[str]:
    return {f.code for f in found(log, folder)}


# --- good logs ----------------------------------------------------------------------------------

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
    assert not found(simulated.recordings(name, **GOOD[case]), tmp_path)


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
        if name == "roller-rig" and sensors.get("train") is False:
            # A wheel that hardly slows is a rig or a gradient: without a train speed only a hint.
            told = [f for f in told if f.severity != "info"]
        assert not told, (seed, told)


@pytest.mark.parametrize("path", sorted((ROOT / "sample_logs").glob("low-adhesion.*")))
def test_the_sample_logs_are_not_accused(path: Path) -> None:
    log = read(open_source(path, DEFAULT.read), DEFAULT.mappings, DEFAULT.vehicle)
    assert not align.records(log, DEFAULT.vehicle)[1]
