"""A train of unlike axles in tables of settings: `[car.NAME]`, and lists per axle.

`[vehicle]` holds for every car. A car has the numbers of its axles and the keys that differ. Any
parameter may be a list: in `[vehicle]` with a value for each axle of the train, in a car with a
value for each of its own axles.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ..core.errors import UserError
from ..core.model import Vehicle, quantities
from ..core.physics import CHAIN
from ..core.toml import Table
from . import loads, stated_brake, stated_friction
from .stated_values import is_axle

Tables = Mapping[str, Any]  # of TOML, read only
# What a car states of one of these groups replaces what [vehicle] states of it.
_GROUPS = (
    (*stated_brake.KINDS, *CHAIN, "cylinder_diameter", "spring_force"),
    ("wheelset_inertia", "rotating_mass"),
)


class AxleTable(NamedTuple):
    """What is stated of one axle."""

    number: int  # in the train, from 1
    car: str  # "" without cars
    table: Table  # as `[vehicle]` of a train of such axles


def by_axle(tables: Tables) -> list[AxleTable]:
    """The axles that are stated one by one, in order; none where one statement serves all.

    The tables of the settings have each parameter under its own name.

    Raises:
        UserError: for cars without axles or with the same axle, and lists of a wrong length.
    """
    vehicle = tables.get("vehicle", {})
    if cars := tables.get("car"):
        return [
            AxleTable(number, car, _of_car(vehicle, car, cars[car], number, place))
            for number, car, place in sorted(_places(cars))
        ]
    lists = {k: len(v) for k, v in vehicle.items() if isinstance(v, list)}
    if not lists.keys() - {"wheel_radius"}:
        return []
    count = max(lists.values())
    for name, length in lists.items():
        if length not in (1, count):
            text = f"vehicle.{name} has {_values(length)}, another list has {count}"
            raise UserError(text, f"state one value, or {count}: one for each axle", code=2)
    places = range(count)
    return [AxleTable(i + 1, "", {k: _item(v, i) for k, v in vehicle.items()}) for i in places]


def with_parameters(tables: Table) -> Table:
    """The settings with every brake as parameters of (15).

    The table of each car then has what `[vehicle]` states for it, too.

    Raises:
        UserError: as `stated_brake.with_parameters`; for cars and lists as `by_axle`.
    """
    axles = by_axle(tables)
    other_axles = {k: v for k, v in tables.items() if k not in ("vehicle", "car")}
    if axles:
        converted = [x._replace(table=named(x, stated_brake.with_parameters)) for x in axles]
        return {**other_axles, **_collected(converted)}
    if vehicle := tables.get("vehicle"):
        other_axles["vehicle"] = stated_brake.with_parameters(vehicle)
    return other_axles


def named(axle: AxleTable, convert: Callable[[Table], Any]) -> Any:
    """What the table of an axle converts to; an error names its car."""
    try:
        return convert(axle.table)
    except UserError as error:
        if not axle.car:
            raise
        raise UserError(f"[car.{axle.car}]: {error}", error.hint, code=2) from error


def forget(tree: Table, layer: Tables) -> None:
    """Removes what a later layer states anew: other cars, a value for all cars, a mass."""
    cars, later_cars = tree.get("car", {}), layer.get("car", {})
    for table in (tree.get("vehicle", {}), *cars.values()):
        if "axle_mass" in layer.get("vehicle", {}):
            table.pop("load", None)
    if any("axles" in table for table in later_cars.values()):
        for name in cars.keys() - later_cars.keys():
            del cars[name]
    for table in cars.values():
        _forget_keys(table, layer.get("vehicle", {}))


def as_tables(vehicle: Vehicle) -> Table:
    """A vehicle as `[vehicle]`, or its cars as `[car.NAME]`, with every parameter in force."""
    if not vehicle.axles:
        return {"vehicle": _parameters(vehicle)}
    return _collected([AxleTable(a.number, a.car, _parameters(a.vehicle)) for a in vehicle.axles])


def _parameters(vehicle: Vehicle) -> Table:
    radii = [p._asdict() for p in vehicle.wheel_radius]
    table: Table = {"wheel_radius": radii if len(radii) > 1 else radii[0]}
    for name in quantities(Vehicle):
        if name != "wheel_radius":
            table[name] = getattr(vehicle, name)._asdict()
    if vehicle.friction_table:
        table["friction"] = stated_friction.as_stated(vehicle.friction, vehicle.friction_table)
    if vehicle.load:
        table["load"] = loads.as_stated(vehicle.load)
    correlations: Table = {}
    for a, b, share in vehicle.correlation:
        correlations.setdefault(a, {})[b] = share
    return table | ({"correlation": correlations} if correlations else {})


def _places(cars: Mapping[str, Table]) -> Iterator[tuple[int, str, int]]:
    """Number, car and place in the car of each axle."""
    owner: dict[int, str] = {}
    for car, table in cars.items():
        numbers = table.get("axles")
        if not isinstance(numbers, list) or not numbers or not all(map(is_axle, numbers)):
            text = f"car.{car}.axles is not a list of axle numbers"
            hint = f"number its axles as in the log, as [car.{car}] axles = [1, 2, 3, 4]"
            raise UserError(text, hint, code=2)
        for place, number in enumerate(numbers):
            if number in owner:
                text = f"axle {number} is in [car.{owner[number]}] and in [car.{car}]"
                if owner[number] == car:
                    text = f"axle {number} is twice in [car.{car}]"
                raise UserError(text, "take it out of one of the lists `axles`", code=2)
            owner[number] = car
            yield number, car, place


def _of_car(vehicle: Tables, car: str, table: Tables, number: int, place: int) -> Table:
    """What is stated of one axle of a car."""
    count, stated_keys, own_table = len(table["axles"]), Table(), Table()
    for name, value in vehicle.items():
        if isinstance(value, list) and 1 < len(value) < number:
            text = f"vehicle.{name} has {_values(len(value))}, [car.{car}] has an axle {number}"
            hint = "state one value, or a list with one for each axle of the train"
            raise UserError(text, hint, code=2)
        stated_keys[name] = _item(value, number - 1)
    for name, value in table.items():
        if isinstance(value, list) and len(value) not in (1, count) and name != "axles":
            text = f"car.{car}.{name} has {_values(len(value))}, the car has {count} axles"
            raise UserError(text, f"state one value, or {count}: one for each axle", code=2)
        if name != "axles":
            own_table[name] = _item(value, place)
    for group in _GROUPS:
        if of_group := [name for name in group if name in own_table]:
            replaced = set(group) - (set(of_group) & set(stated_brake.KINDS))
            stated_keys = {k: v for k, v in stated_keys.items() if k not in replaced}
    for name, value in own_table.items():
        joins = name in stated_brake.KINDS and isinstance(stated_keys.get(name), dict)
        joins &= isinstance(value, dict)
        stated_keys[name] = stated_keys[name] | value if joins else value
    return stated_keys


def _item(value: Any, place: int) -> Any:
    """The value of one axle: of a list that at this place, else the one of all axles."""
    if not isinstance(value, list) or not value:
        return value
    return value[place if len(value) > 1 else 0]


def _values(count: int) -> str:
    return "1 value" if count == 1 else f"{count} values"


def _forget_keys(table: Table, later_layer: Tables) -> None:
    for name, value in later_layer.items():
        if name in stated_brake.KINDS and isinstance(table.get(name), dict):
            _forget_keys(table[name], value)
        else:
            table.pop(name, None)


def _collected(axles: Sequence[AxleTable]) -> Table:
    """The tables of axles as those of their cars: a list where the axles of one differ."""
    cars: dict[str, list[AxleTable]] = {}
    for axle in axles:
        cars.setdefault(axle.car, []).append(axle)
    tables: Table = {}
    for car, own_table in cars.items():
        table: Table = {}
        for name in own_table[0].table:
            values = [axle.table[name] for axle in own_table]
            table[name] = values[0] if all(x == values[0] for x in values) else values
        if not car:
            return {"vehicle": table}
        tables[car] = {"axles": [axle.number for axle in own_table], **table}
    return {"car": tables}
