"""Vehicles and logs for the checks, and what they find."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from adhesion_cli.analysis import analyze, settings
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Result
from helpers import simulated
from helpers.simulated import Recordings
from helpers.vehicle_logs import WHOLE

# What good logs of the scenarios are accused of, with reason.
TRUE = {
    "leaf-film": {"train-speed-delay"},  # its train speed is 0.1 s late
    "paper-constant": {"train-speed-delay"},  # its wheel speed is 0.05 s late
    "roller-rig": {"deceleration-unexplained"},  # an info: rollers hold its speed
}


UNITS = {
    "speed-too-high", "pressure-too-high", "deceleration-too-high", "speed-unit-suspect",
    "pressure-unit-differs", "pressure-unit-suspect", "deceleration-unit-suspect",
}  # fmt: skip


AXLES = {"axle-pressure-differs", "axle-pressure-share"}


APART = {"wheel-faster", "wheel-slower-unbraked", "wheel-speed-drift"}


DIAMETER = {"wheel-diameter", "wheel-diameter-in-logger"}


FORCE = {
    *UNITS, *AXLES, "vehicle-suspect", "brake-unknown", "pressure-below-spring",
    "deceleration-unexplained", "coefficient-too-high", "speed-signal-loss", "force-negative",
}  # fmt: skip


CODES = {
    *FORCE, *APART, *DIAMETER, "pressure-delay", "delay-or-vehicle",
    "speed-stuck", "pressure-stuck", "pressure-saturated", "vehicle-suspect",
    "train-speed-delay", "axles-swapped", "reference-noise",
    "speed-outlier", "pressure-outlier", "pressure-zero",
    "train-speed-stuck", "train-speed-outlier", "train-speed-offset", "train-speed-delay-or-offset",
}  # fmt: skip


DEFAULT = settings.load()
STATED = settings.load({"vehicle": WHOLE})  # the same vehicle, as somebody states it


VEHICLES = {
    "paper": [],
    "light": ["vehicle.axle_mass=3000", "vehicle.wheelset_inertia=60"],
    "heavy": ["vehicle.axle_mass=14000", "vehicle.lever_ratio=3.2"],
    "shoes": ["vehicle.axle_mass=9000", "vehicle.lever_ratio=4", "vehicle.friction=0.15"],
}


def found(log: Recordings, folder: Path, stated: settings.Settings = DEFAULT) -> list[Finding]:
    """What the checks say of a log; not its other findings, as of gaps."""
    return [f for f in simulated.told(log, folder, stated) if f.code in CODES]


@cache
def clean(name: str, seed: int, case: str) -> Recordings:
    return simulated.recordings(name, seed=seed, **SENSORS[case])


SENSORS: dict[str, dict[str, float]] = {
    "as it is": {}, "10 Hz": {"rate": 10.0, "kmh": 0.1}, "50 Hz": {"rate": 50.0, "noise": 1e-3},
}  # fmt: skip


@cache
def at_rate(name: str, rate: float, seed: int = 1) -> Recordings:
    """All sensors at one rate [Hz]."""
    return simulated.recordings(name, rate=rate, seed=seed)


def codes(log: Recordings, folder: Path) -> set[str]:
    return {f.code for f in found(log, folder)}


def analysed(log: Recordings, folder: Path) -> Result:
    path = simulated.write(folder / "log.csv", log)
    return analyze.analyze(path, STATED, algos=["leso"])


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


def warned(findings: Sequence[Finding]) -> set[str]:
    """Codes that end with exit 3: what only informs leaves a result that is trusted."""
    return {f.code for f in findings if f.severity != "info"}
