"""The friction of pads and blocks: a number, a table over speed and force, or a material's name.

A table states φ over the speed of the train and, where φ depends on it, over the force of one pad
or block:

    friction = {speed = [0, 10, 20, 30], block_force = [10e3, 20e3], value = [[…], […]]}

A vehicle has it over K, the force of all pads of one axle at the wheel rim: the key
`clamping_force` in place of `block_force`. Results state it so. Tolerances are shares of φ there.

Karwatzki's formula of cast-iron blocks, with the force F of one block [t, as force] and the speed
V [km/h]:

    φ = 0.6 (16 F + 100)/(80 F + 100) · (V + 100)/(5 V + 100)

and with phosphorus 0.5 (16 F + 100)/(52 F + 100) for its first part. Single blocks differ from it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from ..core.errors import UserError
from ..core.model import FrictionTable, Parameter, Quantity, Vehicle, fraction, quantities
from ..core.physics import G
from ..core.toml import Table
from .stated_values import plain_number, table_of

SHARE = fraction("1 sigma, as a share of φ")
_SPEED = Quantity("m/s", "speed of the train", 0.0, 200.0)
_FORCE = Quantity("N", "force of one pad or block", 0.0, 1e6)
_AXLE_FORCE = Quantity("N", "clamping force of one axle", 0.0, 1e7)
_FORCES = {"block_force": _FORCE, "clamping_force": _AXLE_FORCE}
_KEYS = ("speed", *_FORCES, "value", "tolerance")
_EXAMPLE = "friction = {speed = [0, 30], value = [0.38, 0.32], tolerance = 0.1}"


class Material(NamedTuple):
    """The friction of one kind of pad or block."""

    text: str
    source: str  # and how sure it is
    tolerance: float  # 1 sigma, as a share
    friction: Callable[[float, float], float]  # φ by speed [km/h] and block force [t, as force]
    speeds: Sequence[float] = ()  # of the table [km/h]; empty: φ is one number
    forces: Sequence[float] = ()  # of one block [kN]

    def over_speed(self) -> Table:
        """`friction` of a vehicle over the speed alone: the force of one block is not known.

        It is that between a light and a heavy one; the tolerance has both.
        """
        light, heavy = (F / G for F in _BLOCK_FORCES)
        column = [math.sqrt(self.friction(V, light) * self.friction(V, heavy)) for V in self.speeds]
        by_force = math.log(self.friction(0.0, light) / self.friction(0.0, heavy)) / math.sqrt(12.0)
        tolerance = math.hypot(self.tolerance, by_force)
        return {"speed": [V / 3.6 for V in self.speeds], "value": column, "tolerance": tolerance}

    def stated_table(self) -> Table:
        """The same as `friction` of a vehicle."""
        if not self.speeds:
            phi = self.friction(0.0, 0.0)
            return {"value": phi, "tolerance": self.tolerance * phi}
        return {
            "speed": [V / 3.6 for V in self.speeds],
            "block_force": [1e3 * F for F in self.forces],
            "value": [[self.friction(V, F / G) for V in self.speeds] for F in self.forces],
            "tolerance": self.tolerance,
        }


def _over_speed(V: float) -> float:
    return (V + 100.0) / (5.0 * V + 100.0)


# Between these points a straight line is within 1 % of the formula.
_CAST_IRON_SPEEDS = (0, 3, 6, 10, 14, 19, 25, 32, 41, 52, 66, 83, 105, 134, 160)
_CAST_IRON_FORCES = (0, 1, 3, 5, 7, 10, 13, 17, 22, 28, 35, 44, 55, 69, 80)
_BLOCK_FORCES = (5.0, 40.0)  # of one block, light and heavy brakes [kN]
MATERIALS: Mapping[str, Material] = {
    "organic": Material(
        "organic disc pads",
        "nominal value of UIC 541-3, by secondary sources: the leaflet is not public",
        0.1, lambda V, F: 0.35,
    ),
    "sinter": Material(
        "sintered disc pads",
        "the same; how they fall at high speed, their maker knows",
        0.1, lambda V, F: 0.35,
    ),
    "K": Material(
        "composite blocks of high friction",
        "UIC 541-4, by secondary sources that agree on 0.25",
        0.12, lambda V, F: 0.25,
    ),
    "LL": Material(
        "composite blocks of low friction",
        "UIC 541-4, by secondary sources: 0.15 to 0.17",
        0.2, lambda V, F: 0.15,
    ),
    "cast-iron": Material(
        "cast-iron blocks",
        "Karwatzki's formula, as public programs of train dynamics have it",
        0.12, lambda V, F: 0.6 * (16.0 * F + 100.0) / (80.0 * F + 100.0) * _over_speed(V),
        _CAST_IRON_SPEEDS, _CAST_IRON_FORCES,
    ),
    "cast-iron-phosphorus": Material(
        "cast-iron blocks with 1.0 to 1.4 % phosphorus",
        "the same form with other constants, by one of these programs",
        0.12, lambda V, F: 0.5 * (16.0 * F + 100.0) / (52.0 * F + 100.0) * _over_speed(V),
        _CAST_IRON_SPEEDS, _CAST_IRON_FORCES,
    ),
}  # fmt: skip


def per_axle(entry: Any, faces: float | None) -> Any:
    """`friction` with a material's name as its table, and block forces as those of an axle.

    `faces` are pads or blocks of an axle times the ratio of radii; 0 where nobody states them. None
    where no brake is stated: a material then changes over the speed only.

    Raises:
        UserError: an unknown name; a table over the block force without the number of blocks.
    """
    if isinstance(entry, str):
        names = {name.lower(): name for name in MATERIALS}
        if entry.lower() not in names:
            text = f"vehicle.friction = {entry!r} is no material"
            raise UserError(text, f"write a number, or one of {', '.join(MATERIALS)}", code=2)
        material = MATERIALS[names[entry.lower()]]
        if faces is None and material.speeds:
            return material.over_speed()
        return per_axle(material.stated_table(), faces)
    if not (isinstance(entry, dict) and "block_force" in entry):
        return entry
    if not faces:
        text = "vehicle.friction depends on the force of one block, and the blocks are not stated"
        hint = (
            "state the brake with vehicle.tread_brake.blocks of one axle, as the "
            "[vehicle.tread_brake] that `adhesion vehicle wagon` prints"
        )
        raise UserError(text, hint, code=2)
    if "clamping_force" in entry:
        text = "vehicle.friction states block_force and clamping_force"
        raise UserError(text, "keep block_force", code=2)
    forces = _rising("block_force", entry["block_force"], _FORCE)
    axle_forces = [faces * F for F in forces]
    return {**{k: v for k, v in entry.items() if k != "block_force"}, "clamping_force": axle_forces}


def is_table(entry: Any) -> bool:
    """Whether `friction` is stated over speed or force."""
    return isinstance(entry, dict) and bool(entry.keys() - {"value", "tolerance"})


def replaces(earlier: Mapping[str, Any], later_layer: Mapping[str, Any]) -> bool:
    """Whether a friction replaces an earlier one: a number a table, or a table all of it."""
    by_table = isinstance(later_layer.get("value"), list)
    if by_table and "speed" in later_layer:
        return True
    return "value" in later_layer and not by_table and isinstance(earlier.get("value"), list)


def friction_table(entry: Table) -> tuple[Parameter, FrictionTable]:
    """φ in the middle of a table with its 1 sigma, and the table.

    The entry has forces of an axle.

    Raises:
        UserError: an unknown key; numbers out of range; a speed or force that does not rise; rows
            that do not fit.
    """
    table_of("vehicle.friction", entry, _KEYS)
    for key in ("speed", "value"):
        if key not in entry:
            raise UserError(f"vehicle.friction lacks {key}", f"for example {_EXAMPLE}", code=2)
    speed = _rising("speed", entry["speed"], _SPEED)
    forces: tuple[float, ...] = ()
    rows = entry["value"]
    if "clamping_force" in entry:
        forces = _rising("clamping_force", entry["clamping_force"], _AXLE_FORCE)
    else:
        rows = [rows]
    if not isinstance(rows, list) or len(rows) != max(len(forces), 1):
        text = f"vehicle.friction.value is not {len(forces)} rows"
        raise UserError(text, "one row in [] for each block force, in the same order", code=2)
    values = tuple(_row(row, len(speed)) for row in rows)
    usual = Vehicle().friction
    name, usual_share = "vehicle.friction.tolerance", usual.share
    share = SHARE.check(name, plain_number(name, entry.get("tolerance", usual_share)))
    table = FrictionTable(speed, forces, values)
    return Parameter(table.reference, share * table.reference), table


def as_stated(friction: Parameter, table: FrictionTable) -> Table:
    """The table as `friction_table` takes it."""
    factor = friction.value / table.reference
    rows = [[factor * x for x in row] for row in table.value]
    forces = {"clamping_force": list(table.clamping_force)} if table.clamping_force else {}
    value = rows if table.clamping_force else rows[0]
    share = friction.share
    return {"speed": list(table.speed), **forces, "value": value, "tolerance": share}


def _rising(key: str, numbers: Any, quantity: Quantity) -> tuple[float, ...]:
    name = f"vehicle.friction.{key}"
    if not isinstance(numbers, list) or not numbers:
        text = f"{name} = {numbers!r} is no list of numbers"
        raise UserError(text, f"for example {_EXAMPLE}", code=2)
    values = tuple(quantity.check(name, plain_number(name, x)) for x in numbers)
    for a, b in pairwise(values):
        if not b > a:
            text = f"{name} does not rise: {b:g} after {a:g}"
            raise UserError(text, "order it, each value once, and its column or row too", code=2)
    return values


def _row(row: Any, speeds: int) -> tuple[float, ...]:
    if not isinstance(row, list) or len(row) != speeds:
        count = len(row) if isinstance(row, list) else 1
        text = f"vehicle.friction.value has a row of {count}, and speed has {speeds} values"
        raise UserError(text, "one number for each speed in every row", code=2)
    name, friction = "vehicle.friction.value", quantities(Vehicle)["friction"]
    return tuple(friction.check(name, plain_number(name, x)) for x in row)
