"""Vehicles and logs for the checks, and what they find."""

from functools import cache
from pathlib import Path

from adhesion_cli.analysis import settings
from adhesion_cli.core.finding import Finding
from helpers import simulated
from helpers.simulated import Recordings

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
