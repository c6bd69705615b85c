"""`adhesion vehicle`: a vehicle to start from, and what a stated one means at the rail."""

from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import UserError
from .options import Shared, shared

if TYPE_CHECKING:
    from ..core.annotated import Json
    from ..core.model import CarBrake, Vehicle


@shared("config", "set_", "json")
def command(
    shared: Shared,
    preset: Annotated[str, typer.Argument(metavar="PRESET", help="Kind of vehicle.")] = "",
) -> int:
    """Print a vehicle as TOML, or what your own means at the rail.

    With PRESET a commented TOML, for -c: disc, tread, metro, tram, coach, wagon or paper. Without
    PRESET, the brake force at the rail per bar and axle and the deceleration of the car per bar,
    for the vehicle of -c: two numbers to check against the data sheet.

    Example: adhesion vehicle metro
    """
    from ..analysis.stated_friction import MATERIALS
    from ..analysis.vehicle_presets import names, preset_toml

    if preset:
        if shared.config or shared.set_ or shared.json:
            text = "PRESET prints a TOML and takes no other option"
            raise UserError(text, "leave out PRESET to see the vehicle of -c", code=2)
        print(preset_toml(preset.lower()), end="")
        return 0
    if not (shared.config or shared.set_):
        lines = [f"  {name:<7} {text}" for name, text in names().items()]
        print("\n".join(["adhesion vehicle PRESET prints the TOML of a vehicle:", *lines]))
        print("adhesion vehicle -c FILE.toml shows the brake force of yours.")
        print('Friction of a material with 1 sigma, as friction = "cast-iron" in [vehicle]:')
        for name, material in MATERIALS.items():
            print(f"  {name:<21} {material.text} ± {material.tolerance:.0%}")
        return 0
    return _derived(shared)


def _derived(shared: Shared) -> int:
    """The force at the rail, and the deceleration, of the stated vehicle or each of its cars."""
    from ..analysis import cars, identify, settings
    from ..analysis.stated_brake import clamping_faces
    from ..core.document import dumps, tagged

    tables = settings.layered_tables(shared.config, shared.set_)
    vehicle = settings.load(tables, folder=False).vehicle
    table_by_axle = {axle.number: axle.table for axle in cars.by_axle(tables)}
    brakes = []
    for brake in identify.car_brakes(vehicle):
        vehicle_of_car, table = vehicle, tables.get("vehicle", {})
        if brake.axles:
            vehicle_of_car, table = vehicle.of_axle(brake.axles[0]), table_by_axle[brake.axles[0]]
        brakes.append(
            (brake, vehicle_of_car, clamping_faces(table) * vehicle_of_car.radius_ratio.value)
        )
    if shared.json:
        figures = [_figures(brake, vehicle_of_car) for brake, vehicle_of_car, _ in brakes]
        cars_of_train: Json = {}
        if brakes[0][0].axles:
            numbers = [{"car": x.name, "axles": [*x.axles]} for x, *_ in brakes]
            cars_of_train["cars"] = [{**a, **b} for a, b in zip(numbers, figures, strict=True)]
        print(dumps(tagged("vehicle", **figures[0], **cars_of_train)))
        return 0
    for brake, vehicle_of_car, faces in brakes:
        _print_figures(brake, vehicle_of_car, faces)
    print("± is the expanded uncertainty (95 %). K is of all pads or blocks of one axle, at the")
    print("wheel rim.")
    return 0


def _figures(brake: "CarBrake", vehicle: "Vehicle") -> "Json":
    from ..core.model import Z95
    from ..core.physics import BAR, force_line

    pairs = {"force_per_bar_n": brake.force, "deceleration_per_bar": brake.deceleration}
    figures: Json = {
        name: {"value": x.value, "u95": Z95 * x.tolerance} for name, x in pairs.items()
    }
    return figures | {"clamping_force_per_bar_n": force_line(vehicle).per_pascal * BAR}


def _print_figures(brake: "CarBrake", vehicle: "Vehicle", faces: float) -> None:
    """The figures of a car, with its pads or blocks where they are stated."""
    from ..core.model import Z95
    from ..core.physics import BAR, force_line

    if brake.axles:
        numbers = f"axle{'s' * (len(brake.axles) > 1)} {', '.join(map(str, brake.axles))}"
        print(f"car {brake.name}, {numbers}:" if brake.name else f"{numbers}:")
    line, force, deceleration = force_line(vehicle), brake.force, brake.deceleration
    clamping, begins = line.per_pascal * BAR, line.at_zero / line.per_pascal / BAR
    force_u95, deceleration_u95 = Z95 * force.tolerance / 1e3, Z95 * deceleration.tolerance
    rows = {
        "brake force at the rail, per axle": f"{force.value / 1e3:8.2f} ± {force_u95:.2f} kN/bar",
        "deceleration of a car, all axles braked": (
            f"{deceleration.value:8.3f} ± {deceleration_u95:.3f} m/s²/bar"
        ),
        "equivalent clamping force K per axle": f"{clamping / 1e3:8.2f} kN/bar",
        "pressure at which the brake begins": f"{begins:8.2f} bar",
    }
    if faces:
        rows["clamping force of one pad or block"] = f"{clamping / faces / 1e3:8.2f} kN/bar"
    for text, number in rows.items():
        print(f"{text:<42} {number}")
    if table := vehicle.friction_table:
        speed, axle_force = table.middle
        state = f"{3.6 * speed:.0f} km/h"
        state += f" and {axle_force / faces / 1e3:.0f} kN per block" if axle_force and faces else ""
        print(
            f"Friction is a table. Force and deceleration are at {state}, φ {table.reference:.3f}."
        )
