"""What must be reported about the vehicle: defaults, and diameters."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.finding import Finding, merge_spans
from ..core.masks import spans_of_mask
from ..core.model import (
    Z95,
    AxleResult,
    IdentifiedVehicle,
    Log,
    Result,
    SpeedEffect,
    Vehicle,
    quantities,
)
from ..core.physics import friction_change
from ..core.units import UNITS
from ..diagnostics.checks.vehicle import remedy_names
from ..results.friction_groups import find_friction_differs, group_by_friction, run_of_log
from .identify import ANY_WHEEL, is_wheel_unknown
from .prepare import AlignedLog, Prepared, diagnose_log
from .settings import Settings

_CALIBRATED = "wheel-calibrated"
_FEW_DEFAULTS = 3  # defaults that the line of a finding names
_LINE_LETTERS = 50  # letters that it has for them with their values

_OF_FORCE = {
    "coefficient-too-high",
    "deceleration-unexplained",
    "force-negative",
    "noise-model",
    "pressure-below-spring",
    "reference-noise",
    "speed-signal-loss",
    "vehicle-suspect",
}  # codes that judge a force


def without_force_findings(findings: Sequence[Finding]) -> list[Finding]:
    """The findings of a log whose vehicle is not known: none judges a force that nobody knows."""
    return [f for f in findings if f.code not in _OF_FORCE]


def _reason_unknown(identified: IdentifiedVehicle, log: AlignedLog) -> str:
    """Why a log does not show its brake."""
    if log.grids is None:
        clock_jumps = any((np.diff(a.record.t) <= 0).any() for a in log.axles)
        return "its clock was set back" if clock_jumps else "it is too short"
    if identified.other_brake or log.other_brakes:
        return "another brake acts as well"
    if log.grids.coarse.motors is not None:
        return "its motors act as well, and no mass is stated"
    if len(log.axles) == 1 and any(f.code == "axle-incomplete" for f in log.findings):
        return "only one axle of several has a pressure"
    if log.grids.coarse.slid_together:
        return "all its wheels slide, and no train speed is logged"
    return "no brake application in it slows the train as the pressure says"


def find_vehicle_findings(
    settings: Settings, identified: IdentifiedVehicle, log: AlignedLog
) -> list[Finding]:
    """What must be said of the vehicle first."""
    findings = []
    if identified.other_brake:
        values = {} if identified.factor is None else {"factor": identified.factor}
        names = {"reason": "Train decelerates more than the pressure explains"}
        findings.append(Finding("other-brake", "warning", values=values, names=names))
    findings += log.other_brakes
    if identified.unstated and (identified.source == "log" or not identified.known):
        names = {"unstated": ", ".join(identified.unstated)}
        findings.append(Finding("vehicle-incomplete", "warning", names=names))
    findings += _find_missing_evidence(settings, log)
    if not identified.known:
        reason = _reason_unknown(identified, log)
        findings.append(Finding("vehicle-unknown", "warning", names={"reason": reason}))
    if identified.factor is not None and not identified.other_brake:
        values = {"factor": identified.factor}
        names = remedy_names(identified.vehicle, identified.factor)
        findings.append(Finding("vehicle-suspect", "warning", values=values, names=names))
    if identified.doubt is not None:
        factor, sigmas = identified.doubt
        values = {"factor": factor, "sigmas": sigmas}
        findings.append(Finding("vehicle-in-doubt", "warning", values=values))
    if log.path in identified.differing:
        findings.append(Finding("log-differs", "warning", names={"log": Path(log.path).name}))
    if stops := identified.differing_stops.get(log.path):
        share = max((stop.share for stop in stops), key=lambda x: abs(x - 1.0))
        spans, values = merge_spans([stop[:2] for stop in stops]), {"share": share}
        findings.append(Finding("stops-differ", "warning", "", len(stops), spans, values))
    if not identified.known:
        return findings
    effect = None if identified.other_brake else identified.speed_effects.get(log.path)
    if effect and friction_change(effect, settings.vehicle):
        findings.append(_friction_over_speed(settings.vehicle, effect))
    if mass := identified.motor_mass:
        values = {"mass_t": mass.value / 1e3, "u95_t": Z95 * mass.tolerance / 1e3}
        findings.append(Finding("mass-by-motors", "info", values=values))
    if identified.source == "log":
        by_log = Finding("vehicle-by-log", "info", values={"stops": identified.stops})
        return [*findings, by_log]
    by_pressure = any(a.record.pressure is not None for a in log.axles)
    return findings + default_parameters(settings, by_pressure)


def diagnose_with(
    log: AlignedLog, identified: IdentifiedVehicle, settings: Settings
) -> tuple[list[Finding], Prepared]:
    """What must be said of the vehicle first, and the log diagnosed, without saying it again.

    Arguments as of `find_vehicle_findings`.
    """
    vehicle_findings = find_vehicle_findings(settings, identified, log)
    prepared = diagnose_log(log, identified.vehicle, settings.checks, settings.train)
    codes = {f.code for f in vehicle_findings}
    if identified.other_brake:  # it is no other vehicle
        codes |= {"vehicle-suspect", "deceleration-unit-suspect"}
    findings = [f for f in prepared.findings if f.code not in codes]
    if not identified.known:
        findings = without_force_findings(findings)
        # What explains an unknown vehicle stands before it: its remedy is the one that helps.
        causes = [f for f in findings if f.code == "pressure-unit-suspect"]
        vehicle_findings = [*causes, *vehicle_findings]
        findings = [f for f in findings if f not in causes]
    return vehicle_findings, prepared._replace(findings=findings)


def _friction_over_speed(stated_vehicle: Vehicle, effect: SpeedEffect) -> Finding:
    """That the brake slows harder at low than at high speed, at the same pressure.

    Cast iron does, and so do some pads and blocks. What a stated friction table says is not in it.
    """
    speeds = {"low_kmh": 3.6 * effect.low, "high_kmh": 3.6 * effect.high}
    states_change = stated_vehicle.friction_table or stated_vehicle.friction_fade.value
    condition = " after the stated friction is taken into account" if states_change else ""
    values = {"factor": effect.ratio, **speeds}
    return Finding("friction-over-speed", "warning", values=values, names={"more": condition})


def _find_missing_evidence(settings: Settings, log: AlignedLog) -> list[Finding]:
    """What the log does not show of the vehicle: braking that holds the speed, and wheels."""
    findings = []
    grid = log.grids and log.grids.coarse
    if grid and grid.hold_mask is not None and grid.hold_mask.any():
        spans = spans_of_mask(grid.hold_mask, grid.t, log.view.start_ns)
        findings.append(Finding("brake-holds-speed", "info", "", len(spans), spans))
    if is_wheel_unknown(log, settings):
        R = settings.vehicle.wheel_radius[0].value
        values = {"diameter_m": 2.0 * R, "u95_m": 2.0 * R * Z95 * ANY_WHEEL}
        findings.append(Finding("wheel-diameter-unknown", "warning", values=values))
    return findings


def live_findings(settings: Settings, by_pressure: bool) -> list[Finding]:
    """What must be said of the vehicle where there is no log to find its brake in."""
    needed = [Finding("vehicle-needed", "warning")] if settings.unstated_brake(by_pressure) else []
    return needed + default_parameters(settings, by_pressure)


def default_parameters(settings: Settings, by_pressure: bool) -> list[Finding]:
    """The vehicle values that are defaults; those of the brake only if K is by pressure."""
    wheel = ("axle_mass", "wheel_radius", "wheelset_inertia", "friction")
    vehicle, papers, defaults, considered = settings.vehicle, Vehicle(), dict[str, str](), 0
    for name, q in quantities(Vehicle).items():
        if name.startswith("friction_") or not (by_pressure or name in wheel):
            continue
        considered += 1
        value_arrays = (np.atleast_2d(getattr(v, name)) for v in (vehicle, papers))
        own_values, paper_values = (x[:, 0].tolist() for x in value_arrays)
        if name not in settings.stated and own_values == paper_values:
            defaults[name] = f"{name} {paper_values[0]:g} {q.unit}".removesuffix(" -")
    if not defaults or settings.carries_vehicle:
        return []
    texts = {
        "parameters": ", ".join(defaults.values()),
        "which": _short_list(defaults),
        "are": "is a default" if len(defaults) == 1 else "are defaults",
    }
    values = {"defaults": len(defaults), "of": considered}
    return [Finding("vehicle-default", "warning", count=len(defaults), values=values, names=texts)]


def _short_list(named: Mapping[str, str]) -> str:
    """Which parameters are defaults, if a line has room for them."""
    if len(named) > _FEW_DEFAULTS:
        return " (the paper's vehicle)"
    listing = ", ".join(named.values())
    return f": {listing if len(listing) <= _LINE_LETTERS else ', '.join(named)}"


def state_diameters(
    findings: Sequence[Finding], axles: Sequence[AxleResult], vehicle: Vehicle, log: Log
) -> list[Finding]:
    """The findings; those of calibrated wheels with the diameters of all axles, as one setting.

    Wheel speeds in km/h show only how the wheels differ, whatever diameters are stated. One wheel
    then keeps its diameter: the first that rolls as stated, else the first one.
    """
    ratios = {f.channel: 1.0 + f.values["share"] for f in findings if f.code == _CALIBRATED}
    if not ratios:
        return list(findings)
    last_axle = max(a.record.axle for a in axles)
    radii = replace(vehicle, axles=()).radius  # of axles before the first of the log, too
    stated_diameters = {f"axle {k}": 2.0 * radii(k).value for k in range(1, last_axle + 1)}
    names, kept_axle = {"kept": ""}, ""
    channels = (log.find("wheel_speed", a.record.axle) for a in axles)
    units = (UNITS.get(c.measured_in.lower()) for c in channels if c)
    if any(unit and unit.dimension == "speed" for unit in units):
        axle_names = [f"axle {a.record.axle}" for a in axles]
        kept_axle = next((x for x in axle_names if x not in ratios), axle_names[0])
        names["kept"] = f" Speeds in km/h show only ratios of diameters: {kept_axle} keeps its own."
    base = stated_diameters
    if kept_axle:
        base = dict.fromkeys(ratios, base[kept_axle] / ratios.get(kept_axle, 1.0))
    diameters = {name: f"{diameter:.6g}" for name, diameter in stated_diameters.items()}
    diameters |= {x: f"{base[x] * ratio:.4f}" for x, ratio in ratios.items() if x in diameters}
    texts = [*diameters.values()]
    names["diameters"] = f"[{','.join(texts)}]" if last_axle > 1 else texts[0]
    return [replace(f, names=names) if f.code == _CALIBRATED else f for f in findings]


def with_friction_findings(
    results: Sequence[Result], vehicle_files: Sequence[str] = ()
) -> list[Result]:
    """The results of logs named together; first in each is that some have another brake.

    `vehicle_files` are those of the stated vehicle.
    """
    runs = [run_of_log(x.log.path, x.brake, x.identified) for x in results]
    findings = find_friction_differs(runs, group_by_friction(runs), vehicle_files, by_name=True)
    return [replace(x, findings=(*findings, *x.findings)) for x in results]
