"""The line on the vehicle that stands above every result: stated or found, and how well known."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.model import Z95, LogBrake
from ..core.summary import AxleSummary, CarSummary, ResultSummary, VehicleSummary
from ..core.text import listed

_UNKNOWN = (
    "Vehicle: {statement}, and the log cannot show its brake. Adhesion force and µ are not known. "
    "State the {extent}vehicle with -c FILE.toml."
)
_FROM_EACH = (
    "Vehicle: not stated. Brake force per mass is found from each log, since friction changes with "
    "speed or the brakes differ{accuracy}. State the vehicle (-c FILE.toml) for newtons and a "
    "narrower band."
)
_MOST_LINES = 3  # on vehicles of several logs that are named
_MOST_CARS = 4  # that the line names one by one


_MOTORS = {"ed_force": "ED force", "traction_force": "traction force"}


def describe_motors(summaries: Iterable[ResultSummary]) -> str:
    """That known force and µ have the forces of the motors, too; empty where none acts."""
    meanings = set()
    for summary in summaries:
        idle = [
            title
            for f in summary.findings
            if f.code == "motor-force-idle"
            for title in f.channel.split(", ")
        ]
        acting = (c for c in summary.channels if c.title not in idle)
        meanings |= {c.meaning for c in acting if summary.vehicle.known}
    names = [name for meaning, name in _MOTORS.items() if meaning in meanings]
    return f"Force and µ include the {' and the '.join(names)} of the log." if names else ""


class VehicleOfLog(NamedTuple):
    """The vehicle of one of several logs."""

    group: str  # of the series; "" where there is none
    log: str  # file name
    vehicle: VehicleSummary
    axles: tuple[AxleSummary, ...]
    brake: LogBrake | None = None  # by this log alone, where its scatter is shown


def vehicles_of_logs(summaries: Iterable[ResultSummary]) -> list[VehicleOfLog]:
    """The vehicles of logs that are in no series."""
    return [VehicleOfLog("", Path(x.log.path).name, x.vehicle, x.axles) for x in summaries]


def describe_vehicles(logs: Sequence[VehicleOfLog]) -> list[str]:
    """The lines on the vehicles of several logs: one line where all have one vehicle."""
    logs_of_vehicle: dict[VehicleSummary, list[VehicleOfLog]] = {}
    for log in logs:
        logs_of_vehicle.setdefault(log.vehicle, []).append(log)
    groups = {log.group for log in logs}
    is_by_log = all(vehicle.source == "log" for vehicle in logs_of_vehicle)
    if is_by_log and len(logs_of_vehicle) > max(_MOST_LINES, len(groups)):
        shares = [x for log in logs if np.isfinite(x := _median_share(log.axles))]
        accuracy = f", µ ± {min(shares):.0f} to {max(shares):.0f} %" if shares else ""
        return [_FROM_EACH.format(accuracy=accuracy)]
    lines = []
    for vehicle, its_logs in logs_of_vehicle.items():
        line = describe_vehicle(vehicle, [axle for log in its_logs for axle in log.axles])
        scatter = describe_scatter([log.brake for log in its_logs if log.brake])
        elsewhere = {log.group for log in logs if log.vehicle != vehicle}
        names = listed([log.log for log in its_logs], 2)
        own_groups = dict.fromkeys(log.group for log in its_logs)
        if "" not in own_groups and not elsewhere.intersection(own_groups):
            names = f"group {', '.join(own_groups)}"
        if len(logs_of_vehicle) > 1:
            line = line.replace("Vehicle:", f"Vehicle of {names}:", 1)
        lines.append(f"{line} {scatter}".rstrip())
    return lines


def describe_vehicle(vehicle: VehicleSummary, axles: Sequence[AxleSummary] = ()) -> str:
    """The line, as plain text; the µ of these axles has an uncertainty."""
    statement = "stated in part" if vehicle.unstated else "not stated"
    extent = "whole " if vehicle.unstated else ""
    if not vehicle.known:
        return _UNKNOWN.format(statement=statement, extent=extent)
    stops = f"{vehicle.stops} brake application{'s' * (vehicle.stops != 1)}"
    evidence = f"{stops} of {'this log' if vehicle.logs <= 1 else f'{vehicle.logs} logs'}"
    if vehicle.source == "log":
        share = _median_share(axles)
        accuracy = f", µ ± {share:.0f} %" if np.isfinite(share) else ""
        return (
            f"Vehicle: {statement}. Its brake force per mass is found from {evidence}{accuracy}. "
            f"State the {extent}vehicle (-c FILE.toml) for newtons and a narrower band."
        )
    default = ", the rest by default" if vehicle.unstated else ", the default one"
    origin = "as stated" if vehicle.source == "stated" else statement + default
    origin = "that of the result file" if vehicle.carried else origin
    brakes, used = _brakes(vehicle.cars), _force(vehicle.force_per_bar_n, vehicle.u95)
    if vehicle.other_brake:
        return (
            f"Vehicle: {origin}, but another brake slows the train as well. Force and µ are those "
            "of the air brake alone."
        )
    if vehicle.contradicted_by:
        factor = f"{vehicle.contradicted_by:.2g} times"
        return f"Vehicle: {origin}, but the log contradicts it: its brake is {factor} as strong."
    if not vehicle.stops:
        return f"Vehicle: {origin}{brakes}"
    if not used or not vehicle.stated_force_per_bar_n:
        return f"Vehicle: {origin}, with {evidence}."
    if len(vehicle.cars) > 1 and vehicle.force_per_bar_n:
        used = f"{vehicle.force_per_bar_n / vehicle.stated_force_per_bar_n:.3f} times that"
    return f"Vehicle: {origin}{brakes} Used: {used}, with {evidence}."


def _median_share(axles: Sequence[AxleSummary]) -> float:
    """Median uncertainty of the mean µ [%]; NaN where there is none."""
    coefficients = [a.coefficient for axle in axles for a in axle.applications]
    shares = [100.0 * x.mean_u95 / x.mean for x in coefficients if x and x.mean > 0.0]
    return float(np.median(shares)) if shares else float("nan")


def describe_scatter(brakes: Sequence[LogBrake]) -> str:
    """How far the brakes differ that logs of one vehicle show, each by itself; "" for one log."""
    if len(brakes) < 2:
        return ""
    shares = [round(100.0 * (brake.ratio - 1.0)) for brake in brakes]
    u95 = 100.0 * Z95 * max(brake.sigma for brake in brakes)
    lower, upper = min(shares), max(shares)
    difference = f"{lower:+d}" if lower == upper else f"{lower:+d} to {upper:+d}"
    return (
        f"Each log alone shows a brake force per mass that differs by {difference} % from that "
        f"used, with an uncertainty of up to ± {u95:.0f} %."
    )


def _brakes(cars: Sequence[CarSummary]) -> str:
    """What the train, or each of its cars, does per bar: to check against the data sheets."""
    if not cars:
        return "."
    texts = [
        f"{_force(car.force_per_bar_n, car.u95)} at the rail per bar and axle, "
        f"{car.deceleration_per_bar:.3g} m/s² per bar{_friction_state(car)}."
        for car in cars
    ]
    if not cars[0].axles:
        return f": {texts[0]}"
    if len(cars) > _MOST_CARS:
        columns = ([c.force_per_bar_n / 1e3 for c in cars], [c.deceleration_per_bar for c in cars])
        force, slowing = (f"{min(column):.3g} to {max(column):.3g}" for column in columns)
        return f": {force} kN at the rail per bar and axle, {slowing} m/s² per bar."
    heads = [
        f"Car {car.name}"
        if car.name
        else f"Axle{'s' * (len(car.axles) > 1)} {', '.join(map(str, car.axles))}"
        for car in cars
    ]
    return " ".join([".", *(f"{head}: {text}" for head, text in zip(heads, texts, strict=True))])


def _friction_state(car: CarSummary) -> str:
    """Where its figures are, if its friction changes with speed, or with force as well."""
    if car.speed_mps is None:
        return ""
    speed, force, cause = f"{3.6 * car.speed_mps:.0f} km/h", "", "speed"
    if car.clamping_force_n:
        force = f" and a clamping force of {car.clamping_force_n / 1e3:.0f} kN per axle"
        cause = "speed and force"
    return f" at {speed}{force} (friction changes with {cause})"


def _force(force: float | None, u95: float | None) -> str:
    """A force per bar with its relative uncertainty (95 %); empty where there is none."""
    if not force or u95 is None:
        return ""
    return f"{force / 1e3:.3g} kN ± {100.0 * u95 / force:.0f} %"
