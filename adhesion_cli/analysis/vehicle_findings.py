"""What must be reported about the vehicle: defaults, diameters, what `calibrate` would give."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.finding import Finding
from ..core.model import AxleResult, Vehicle, quantities
from ..diagnostics.scene import Scene
from ..reference import calibrated_vehicle
from .settings import Settings

_NARROWER = 2.0 / 3.0  # of the stated band: from there on `calibrate` is worth its run
_CALIBRATED = "wheel-calibrated"
_FEW = 3  # defaults that the line of a finding names
_ROOM = 50  # letters that it has for them with their values


def default_parameters(settings: Settings, by_pressure: bool) -> list[Finding]:
    """The vehicle values that are defaults; those of the brake only if K is by pressure."""
    wheel = ("axle_mass", "wheel_radius", "wheelset_inertia", "friction")
    vehicle, papers, named, asked = settings.vehicle, Vehicle(), dict[str, str](), 0
    for name, q in quantities(Vehicle).items():
        if name.startswith("friction_") or not (by_pressure or name in wheel):
            continue
        asked += 1
        mine, theirs = (np.atleast_2d(getattr(v, name))[:, 0].tolist() for v in (vehicle, papers))
        if name not in settings.stated and mine == theirs:
            named[name] = f"{name} {theirs[0]:g} {q.unit}".removesuffix(" -")
    if not named:
        return []
    shown = {
        "parameters": ", ".join(named.values()), "which": _short_list(named),
        "are": "is a default" if len(named) == 1 else "are defaults",
    }  # fmt: skip
    values = {"defaults": len(named), "of": asked}
    return [Finding("vehicle-default", "warning", count=len(named), values=values, names=shown)]


def _short_list(named: Mapping[str, str]) -> str:
    """Which parameters are defaults, if a line has room for them."""
    if len(named) > _FEW:
        return " (the paper's vehicle)"
    whole = ", ".join(named.values())
    return f": {whole if len(whole) <= _ROOM else ', '.join(named)}"


def state_diameters(
    findings: Sequence[Finding], axles: Sequence[AxleResult], vehicle: Vehicle
) -> list[Finding]:
    """The findings; those of calibrated wheels with the diameters of all axles, as one setting."""
    found = {f.channel: f"{f.values['diameter_m']:.4f}" for f in findings if f.code == _CALIBRATED}
    last = max(a.record.axle for a in axles)
    stated = [f"{2.0 * vehicle.radius(k).value:.6g}" for k in range(1, last + 1)]
    every = [found.get(f"axle {k}", one) for k, one in enumerate(stated, 1)]
    setting = f"[{','.join(every)}]" if last > 1 else every[0]
    return [
        replace(f, names={"diameters": setting}) if f.code == _CALIBRATED else f for f in findings
    ]


def calibration_narrows(scene: Scene | None, axle: AxleResult, vehicle: Vehicle) -> list[Finding]:
    """That the log's own brake applications would make the band of the force narrower."""
    found = calibrated_vehicle.band_shares(scene, axle.record, axle.applications, vehicle)
    if found is None or found[1] > _NARROWER * found[0]:
        return []
    values = {"stated_share": found[0], "calibrated_share": found[1]}
    return [Finding("calibration-narrows", "info", values=values)]
