"""A train of unlike axles as one of equal axles: the mean axle.

The brakes of all axles slow one train:

    −v̇ Σ (m + I/R²) = Σ φK.

A train of equal axles slows alike if each has the mean mass and the mean rotating mass, and if
their clamping forces are φK over the mean axle's φ. So the longitudinal model knows equal axles
only. What a log shows of the mean axle is one common error of all axles.

Tolerances are means, too: the errors of all axles are taken as one. An axle moves by its share of
that error, and one without tolerance does not move.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..core.model import CarAxle, FrictionTable, Load, Parameter, Vehicle
from ..core.physics import CHAIN, chain_ratio, fade_share, force_line, piston_area

_Changes = dict[str, Any]  # values of a vehicle by their names
_BRAKE = ("friction", *CHAIN, "cylinder_diameter")  # factors of the force per pressure


def vehicle_of_axles(axles: Sequence[CarAxle]) -> Vehicle:
    """The vehicle of axles that are stated one by one, in the order of their numbers."""
    mean = _mean({a.number: a.vehicle for a in axles})
    differ = axles[0].car or not _have_equal_values([a.vehicle for a in axles])
    return replace(mean, axles=tuple(axles)) if differ else mean


def mean_axle(vehicle: Vehicle, axles: Sequence[int]) -> Vehicle:
    """The mean axle of these numbers, with the wheel radius of each; the vehicle if all are alike.

    Raises:
        UserError: where the vehicle does not have one of them.
    """
    if not vehicle.axles:
        return vehicle
    return _mean({number: vehicle.of_axle(number) for number in axles})


def mass_at_rim(vehicle: Vehicle) -> float:
    """M + I/R² of a mean axle: what its brake force slows [kg]."""
    return vehicle.axle_mass.value + vehicle.wheelset_inertia.value / vehicle.radius(1).value ** 2


def have_equal_values(vehicle: Vehicle, axles: Sequence[int]) -> bool:
    """Whether these axles differ in their wheel radius only."""
    return _have_equal_values([vehicle.of_axle(number) for number in axles])


def _mean(by_number: dict[int, Vehicle]) -> Vehicle:
    """The mean axle of these, with a list of all radii up to the last number."""
    vehicles = list(by_number.values())
    first_vehicle, n = vehicles[0], len(vehicles)
    numbers = range(1, max(by_number) + 1)
    radii = tuple(by_number.get(number, first_vehicle).wheel_radius[0] for number in numbers)
    if _have_equal_values(vehicles):
        return replace(first_vehicle, wheel_radius=radii)
    forces = [v.friction.value * force_line(v).per_pascal for v in vehicles]
    changed: _Changes = {}
    for name in _BRAKE:
        tolerance = _mean_of([getattr(v, name).share for v in vehicles], forces)
        factor = sum(forces) / n / forces[0] if name == "discs" else 1
        value = getattr(first_vehicle, name).value * factor
        changed[name] = Parameter(value, value * tolerance)
    # The springs take φ ratio F of an axle's force, in the mean as well.
    ratios = [v.friction.value * chain_ratio(v) for v in vehicles]
    ratio = ratios[0] * changed["discs"].value / first_vehicle.discs.value
    # Rotating masses add up at the rim: I is on the radius of the axle that is taken first.
    R = first_vehicle.wheel_radius[0].value
    rotating = [(R / v.wheel_radius[0].value) ** 2 for v in vehicles]
    for name, weights, total in (
        ("spring_force", ratios, n * ratio),
        ("friction_fade", forces, sum(forces)),
        ("axle_mass", [1.0] * n, n),
        ("wheelset_inertia", rotating, n),
    ):
        columns = zip(*(getattr(v, name) for v in vehicles), strict=True)
        changed[name] = Parameter(*(_mean_of(column, weights, total) for column in columns))
    table = next((v.friction_table for v in vehicles if v.friction_table), None)
    if table:  # each axle has its own; this one shows whether φ is scaled or tilted
        factor = changed["friction"].value / table.reference
        table = table.scaled([factor] * len(table.speed))
    return replace(first_vehicle, **changed, wheel_radius=radii, friction_table=table)


def _have_equal_values(vehicles: Sequence[Vehicle]) -> bool:
    radius = vehicles[0].wheel_radius
    return all(replace(v, wheel_radius=radius) == vehicles[0] for v in vehicles)


def move_axles(vehicle: Vehicle, stated_mean: Vehicle, identified: Vehicle) -> Vehicle:
    """The vehicle with what a log shows of its mean axle, as one error of all axles."""
    if identified == stated_mean:
        return vehicle
    if vehicle == stated_mean:
        return replace(identified, load=_moved_load(vehicle, stated_mean, identified))
    stated_mean = _at_speed(stated_mean, identified.friction_speed.value)
    if not vehicle.axles:
        return _move_axle(vehicle, stated_mean, identified)
    moved_vehicles = (_move_axle(a.vehicle, stated_mean, identified) for a in vehicle.axles)
    pairs = zip(vehicle.axles, moved_vehicles, strict=True)
    return vehicle_of_axles([axle._replace(vehicle=v) for axle, v in pairs])


def _move_axle(axle_vehicle: Vehicle, stated_mean: Vehicle, identified: Vehicle) -> Vehicle:
    """One axle, moved as its mean axle was, by its share of the tolerances."""
    axle_vehicle = _at_speed(axle_vehicle, identified.friction_speed.value)
    changed: _Changes = {}
    of_brake = _ratio_of(brake_sigma(axle_vehicle), brake_sigma(stated_mean))
    for name in (*_BRAKE, "axle_mass", "wheelset_inertia"):
        three_vehicles = axle_vehicle, stated_mean, identified
        x, stated_value, identified_value = (getattr(v, name) for v in three_vehicles)
        share = of_brake if name in _BRAKE else _ratio_of(x.share, stated_value.share)
        value = x.value * (identified_value.value / stated_value.value) ** share
        changed[name] = Parameter(value, value * identified_value.share * share)
    # What differs in the spring is a pressure, which acts on every piston.
    area = piston_area(axle_vehicle) / piston_area(stated_mean)
    spring_change = (identified.spring_force.value - stated_mean.spring_force.value) * area
    spring = max(axle_vehicle.spring_force.value + spring_change, 0.0)
    changed["spring_force"] = Parameter(spring, identified.spring_force.tolerance * area)
    fade = identified.friction_fade.value - stated_mean.friction_fade.value
    changed["friction_fade"] = identified.friction_fade._replace(
        value=axle_vehicle.friction_fade.value + fade
    )
    if stated_mean.friction_table and identified.friction_table:
        tables = stated_mean.friction_table, identified.friction_table
        changed |= _moved_table(axle_vehicle, *tables, identified.friction.share, of_brake)
    load = _moved_load(axle_vehicle, stated_mean, identified)
    return replace(axle_vehicle, **changed, load=load, correlation=identified.correlation)


def _moved_load(axle_vehicle: Vehicle, stated_mean: Vehicle, identified: Vehicle) -> Load | None:
    """The line of the load pressure, with the error that the log shows of the mass."""
    if axle_vehicle.load is None:
        return None
    stated_value, identified_value = stated_mean.axle_mass, identified.axle_mass
    share = _ratio_of(axle_vehicle.axle_mass.share, stated_value.share)
    factor = (identified_value.value / stated_value.value) ** share
    empty_mass, loaded_mass = axle_vehicle.load.axle_mass
    narrower = _ratio_of(identified_value.share, stated_value.share)
    tolerance = factor * axle_vehicle.load.tolerance * narrower
    return axle_vehicle.load._replace(
        axle_mass=(factor * empty_mass, factor * loaded_mass), tolerance=tolerance
    )


def _moved_table(
    axle_vehicle: Vehicle,
    stated_mean: FrictionTable,
    identified: FrictionTable,
    tolerance: float,
    share: float,
) -> _Changes:
    """Friction and table of an axle, scaled over the speed as those of the mean axle were."""
    factors = [b / a for a, b in zip(stated_mean.value[0], identified.value[0], strict=True)]
    table, fade = axle_vehicle.friction_table, axle_vehicle.friction_fade
    if table is None:
        factor = float(np.interp(stated_mean.middle[0], stated_mean.speed, factors)) ** share
        value = factor * axle_vehicle.friction.value
        return {"friction": Parameter(value, value * tolerance * share), "friction_fade": fade}
    by_speed = np.interp(table.speed, stated_mean.speed, factors) ** share
    scaled = table.scaled(by_speed.tolist())
    friction = Parameter(scaled.reference, scaled.reference * tolerance * share)
    return {"friction": friction, "friction_table": scaled, "friction_fade": fade}


def _mean_of(values: Sequence[float], weights: Sequence[float], total: float = 0.0) -> float:
    """The sum of weighted values over that of the weights, or over another total."""
    return sum(x * w for x, w in zip(values, weights, strict=True)) / (total or sum(weights))


def _at_speed(v: Vehicle, speed: float) -> Vehicle:
    """The same vehicle with `friction` at another speed [m/s]."""
    friction_speed = Parameter(speed, 0.0)
    if v.friction_table:
        return replace(v, friction_speed=friction_speed)
    share, fade = float(fade_share(speed, v)), v.friction_fade
    friction = Parameter(v.friction.value * share, v.friction.tolerance * share)
    fade = Parameter(fade.value / share, fade.tolerance)
    return replace(v, friction=friction, friction_fade=fade, friction_speed=friction_speed)


def _ratio_of(a: float, b: float) -> float:
    return a / b if b else 1.0


def brake_shares(vehicle: Vehicle) -> dict[str, float]:
    """By how much each tolerance of the brake moves ln of its force per pressure."""
    shares = {name: getattr(vehicle, name).share for name in ("friction", *CHAIN)}
    return shares | {"cylinder_diameter": 2.0 * vehicle.cylinder_diameter.share}


def brake_sigma(v: Vehicle) -> float:
    """1 sigma of ln of the brake force per pressure, by the tolerances."""
    return math.hypot(*brake_shares(v).values())
