"""Vehicles as a TOML to start from: typical values, each key with unit and place on a data sheet.

The values are typical of their kind and of no train: whoever takes one replaces them by those of
the data sheets. Friction: see `stated_friction`.
"""

from collections.abc import Mapping
from typing import NamedTuple

from ..core.errors import unknown
from ..core.model import Quantity, Vehicle, quantities
from ..core.toml import quoted
from .stated_brake import KINDS, ROTATING_MASS

Value = float | tuple[float, float] | str  # with its tolerance, 1 sigma; or a material


class Preset(NamedTuple):
    """A vehicle of one kind."""

    text: str
    axle: Mapping[str, Value]
    brake: str  # "" for parameters of (15)
    values: Mapping[str, Value]


def _disc(text: str, axle: Mapping[str, Value], **values: Value) -> Preset:
    usual: dict[str, Value] = {"pads_per_disc": 2, "cylinders": 1, "efficiency": (0.95, 0.03)}
    return Preset(text, {**axle, "friction": (0.35, 0.035)}, "disc_brake", usual | values)


def _tread(text: str, friction: str, axle: Mapping[str, Value], **values: Value) -> Preset:
    usual: dict[str, Value] = {"efficiency": (0.83, 0.05)}
    return Preset(text, {**axle, "friction": friction}, "tread_brake", usual | values)


def _axle(mass: float, diameter: float, rotating: float) -> dict[str, Value]:
    return {
        "wheel_diameter": (diameter, 0.01),
        "axle_mass": (mass, 0.05 * mass),
        "rotating_mass": (rotating, 0.02),
    }


PRESETS: Mapping[str, Preset] = {
    "disc": _disc(
        "a disc-braked car", _axle(13000, 0.90, 0.06), discs=2, piston_diameter=0.203,
        spring_force=(1500, 150), caliper_ratio=2.4, mean_radius=(0.247, 0.003),
    ),
    "tread": _tread(
        "a tread-braked car with composite blocks", "K", _axle(12000, 0.90, 0.05), cylinders=1,
        piston_diameter=0.178, spring_force=(1000, 200), rigging_ratio=5.0, blocks=4,
    ),
    "metro": _disc(
        "a metro car", _axle(13500, 0.84, 0.09), discs=2, piston_diameter=0.203,
        spring_force=(1500, 150), caliper_ratio=2.4, mean_radius=(0.24, 0.003),
    ),
    "tram": _disc(
        "a tram", _axle(8500, 0.60, 0.10), discs=1, piston_diameter=0.178,
        spring_force=(1000, 150), caliper_ratio=2.6, mean_radius=(0.17, 0.003),
    ),
    "coach": _disc(
        "a passenger coach", _axle(12500, 0.92, 0.05), discs=3, piston_diameter=0.203,
        spring_force=(1200, 150), caliper_ratio=2.2, mean_radius=(0.247, 0.003),
    ),
    "wagon": _tread(
        "a loaded freight wagon with cast-iron blocks", "cast-iron", _axle(20000, 0.92, 0.04),
        cylinders=0.25, piston_diameter=0.406, spring_force=(1800, 300), rigging_ratio=8.0,
        blocks=8,
    ),
}  # fmt: skip
_MORE = """
# Where the log has a load pressure, it gives the axle mass, by two points of a line:
# [vehicle.load]
# pressure = [1.5, 3.8]      # empty, loaded
# axle_mass = [9500, 15000]  # kg
# unit = "bar"

# Several cars: [vehicle] holds for all, each car states its axles and what differs:
# [car.trailer]
# axles = [5, 6, 7, 8]
# axle_mass = 12000
# disc_brake.discs = 3
"""
PAPER = "paper"  # the default vehicle, by parameters of (15)


def names() -> dict[str, str]:
    """What each preset is, by its name."""
    return {name: x.text for name, x in PRESETS.items()} | {PAPER: "the wheelset of the paper"}


def preset_toml(name: str) -> str:
    """A commented TOML of a vehicle.

    Raises:
        UserError: for an unknown name.
    """
    if name not in names():
        raise unknown("vehicle", name, list(names()))
    head = f"# Vehicle: {names()[name]}. Replace the values by those of your data sheets.\n"
    head += "# A number, or {value, tolerance}: the tolerance is 1 sigma, in the key's unit.\n"
    if name == PAPER:
        return head + _section("vehicle", _of_paper(), quantities(Vehicle))
    preset = PRESETS[name]
    of_axle = quantities(Vehicle) | {
        "rotating_mass": ROTATING_MASS,
        "wheel_diameter": Quantity("m", "wheel, new or as measured; also a list, one per axle"),
        "friction": Quantity("-", "of pad or block; a number, a table, or a material"),
    }
    kind = KINDS[preset.brake]
    brake = _section(f"vehicle.{preset.brake}", preset.values, quantities(kind))
    return head + _section("vehicle", preset.axle, of_axle) + "\n" + brake + _MORE


def _of_paper() -> dict[str, Value]:
    v = Vehicle()
    parameters = {name: getattr(v, name) for name in quantities(Vehicle)}
    (parameters["wheel_radius"],) = v.wheel_radius
    return {name: (p.value, p.tolerance) for name, p in parameters.items()}


def _section(name: str, values: Mapping[str, Value], texts: Mapping[str, Quantity]) -> str:
    lines = []
    for key, value in values.items():
        if isinstance(value, tuple):
            number = f"{{value = {value[0]:g}, tolerance = {value[1]:g}}}"
        elif isinstance(value, str):
            number = quoted(value)
        else:
            number = f"{value:g}"
        unit = "" if texts[key].unit == "-" else f"{texts[key].unit}; "
        lines.append((f"{key} = {number}", f"# {unit}{texts[key].text}"))
    width = max(len(line) for line, _ in lines)
    return f"[{name}]\n" + "".join(f"{line:<{width}}  {text}\n" for line, text in lines)
