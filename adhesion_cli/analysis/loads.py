"""The mass of axles by their load pressure, which air springs or a weighing valve show.

`[vehicle.load]` states two points of a straight line. A log gives the pressure: its median while
the train stands or rolls steadily, since a braked car pitches.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ..core import units
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import CarAxle, Channel, Load, Log, Parameter, Quantity, Vehicle, quantities
from ..core.physics import BAR
from ..core.toml import Table
from ..train.mean_axle import vehicle_of_axles
from .stated_values import is_number, plain_number, table_of

_KEYS = ("pressure", "axle_mass", "unit", "tolerance")
_EXAMPLE = 'load = {pressure = [1.5, 3.8], axle_mass = [9500, 15000], unit = "bar"}'
_STEADY = 0.15  # a train that gains or loses less speed is steady [m/s²]
_EXTRAPOLATION = 0.5  # of the stated range: farther out, it is another pressure or unit


def stated_load(entry: Any) -> Load:
    """The line that `load` of a vehicle states.

    Raises:
        UserError: an unknown or missing key, an unknown unit, points that do not rise.
    """
    name, hint = "vehicle.load", f"for example {_EXAMPLE}"
    table_of(name, entry, _KEYS)
    for key in _KEYS[:3]:
        if key not in entry:
            raise UserError(f"{name} lacks {key}", hint, code=2)
    unit = units.unit(str(entry["unit"]))
    if unit is None or unit.dimension != "pressure":
        text = f"{name}.unit = {entry['unit']!r} is no unit of pressure"
        raise UserError(text, f"units: {', '.join(units.known_units('load_pressure'))}", code=2)
    pressure, mass = (_pair(f"{name}.{key}", entry[key]) for key in ("pressure", "axle_mass"))
    quantity = quantities(Vehicle)["axle_mass"]
    for x in mass:
        quantity.check(f"{name}.axle_mass", x)
    usual = Vehicle().axle_mass
    usual_tolerance = usual.share * sum(mass) / 2.0
    tolerance = plain_number(f"{name}.tolerance", entry.get("tolerance", usual_tolerance))
    Quantity("kg", "1 sigma", 0.0, mass[1]).check(f"{name}.tolerance", tolerance)
    return Load((pressure[0] * unit.factor, pressure[1] * unit.factor), mass, tolerance)


def as_stated(load: Load) -> Table:
    """The line as `stated_load` takes it."""
    pressure = [p / BAR for p in load.pressure]
    return {**load._asdict(), "pressure": pressure, "axle_mass": [*load.axle_mass], "unit": "bar"}


def with_load(vehicle: Vehicle, log: Log) -> tuple[Vehicle, list[Finding]]:
    """The vehicle with the masses of its axles in a log, and what must be said of them."""
    numbers = {c.axle for c in log.channels if c.meaning == "wheel_speed"}
    last_axle = max((number or 1 for number in numbers), default=1)
    stated_load = [a.number for a in vehicle.axles] or range(1, last_axle + 1)
    axle_load = {number: vehicle.of_axle(number) for number in stated_load}
    masses: dict[int, Parameter] = {}
    pressures: dict[str, float] = {}  # by channel
    findings, refused = list[Finding](), set[str]()
    for number, v in axle_load.items():
        if v.load is None or number > last_axle:
            continue
        channel = log.find("load_pressure", number)
        if channel is None:
            continue
        pressure = _steady_pressure(channel, log, number)
        if v.load.reaches(pressure, _EXTRAPOLATION):
            masses[number] = v.load.mass(pressure)
            pressures[channel.title] = pressure
        elif channel.title not in refused:
            refused.add(channel.title)
            low_bar, high_bar = (p / BAR for p in v.load.pressure)
            values = {"pressure_bar": pressure / BAR, "low_bar": low_bar, "high_bar": high_bar}
            findings.append(Finding("load-out-of-range", "warning", channel.title, values=values))
    if masses:
        by_load = [m.value for m in masses.values()]
        values = {"pressure_bar": float(np.mean([*pressures.values()])) / BAR}
        values |= {"lowest_kg": min(by_load), "highest_kg": max(by_load)}
        title = ", ".join(pressures)
        findings.append(Finding("mass-by-load", "info", title, len(masses), values=values))
    else:
        first_load = next(v for v in axle_load.values() if v.load)
        if not findings:
            values = {"mass_kg": first_load.axle_mass.value}
            findings.append(Finding("no-load-pressure", "warning", values=values))
        return vehicle, findings
    mass_of = {number: masses.get(number, v.axle_mass) for number, v in axle_load.items()}
    loaded = {n: replace(v, axle_mass=mass_of[n], load=None) for n, v in axle_load.items()}
    if not vehicle.axles and len({v.axle_mass for v in loaded.values()}) == 1:
        return replace(vehicle, axle_mass=loaded[1].axle_mass, load=None), findings
    cars = {a.number: a.car for a in vehicle.axles}
    axles_of_train = [CarAxle(n, cars.get(n, ""), v) for n, v in loaded.items()]
    return vehicle_of_axles(axles_of_train), findings


def states_load(vehicle: Vehicle) -> bool:
    """Whether any axle has its mass by a load pressure."""
    return vehicle.load is not None or any(a.vehicle.load for a in vehicle.axles)


def _steady_pressure(channel: Channel, log: Log, axle: int) -> float:
    """Median while the train stands or rolls steadily, else of all samples [Pa]."""
    t, p = channel.data.t, channel.data.value
    speed, radius = log.find("train_speed", axle), 1.0
    if speed is None or speed.is_rate:
        speed, radius = log.find("wheel_speed", axle), 0.45
    steady = np.ones(len(t), np.bool_)
    if speed is not None:
        half_width = 500_000_000  # [ns]
        shifts = -half_width, half_width
        v = [np.interp(t + shift, speed.data.t, speed.data.value) for shift in shifts]
        steady = np.abs(v[1] - v[0]) * radius < _STEADY
    return float(np.median(p[steady] if steady.any() else p))


def _pair(name: str, numbers: Any) -> tuple[float, float]:
    if not isinstance(numbers, list) or len(numbers) != 2 or not all(map(is_number, numbers)):
        text = f"{name} = {numbers!r} is not two numbers"
        raise UserError(text, f"for example {_EXAMPLE}", code=2)
    empty_mass, loaded_mass = map(float, numbers)
    if not empty_mass < loaded_mass:
        text = f"{name} does not rise: {loaded_mass:g} after {empty_mass:g}"
        raise UserError(text, "write the point of the empty car first", code=2)
    return empty_mass, loaded_mass
