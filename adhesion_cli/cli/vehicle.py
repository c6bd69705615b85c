"""`adhesion vehicle`: a vehicle to start from, and what a stated one means at the rail."""

from typing import Annotated

import typer

from .options import Shared, shared


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
    from ..core.errors import UserError

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
    """The force at the rail, and the deceleration, of the stated vehicle."""
    from ..analysis import settings
    from ..analysis.identify import deceleration_per_bar, force_per_bar
    from ..analysis.stated_brake import clamping_faces
    from ..core import physics
    from ..core.document import dumps, tagged
    from ..core.model import Z95

    tables = settings.layered_tables(shared.config, shared.set_)
    vehicle = settings.load(tables, folder=False).vehicle
    force, deceleration = force_per_bar(vehicle), deceleration_per_bar(vehicle)
    line = physics.force_line(vehicle)
    clamping = line.per_pascal * physics.BAR
    if shared.json:
        body = {
            "force_per_bar_n": {"value": force.value, "u95": Z95 * force.tolerance},
            "deceleration_per_bar": {
                "value": deceleration.value, "u95": Z95 * deceleration.tolerance
            },
        }  # fmt: skip
        print(dumps(tagged("vehicle", **body, clamping_force_per_bar_n=clamping)))
        return 0
    begins = line.at_zero / line.per_pascal / physics.BAR
    force_u95, deceleration_u95 = Z95 * force.tolerance / 1e3, Z95 * deceleration.tolerance
    rows = {
        "brake force at the rail, per axle": f"{force.value / 1e3:8.2f} ± {force_u95:.2f} kN/bar",
        "deceleration of a car, all axles braked": (
            f"{deceleration.value:8.3f} ± {deceleration_u95:.3f} m/s²/bar"
        ),
        "equivalent clamping force K per axle": f"{clamping / 1e3:8.2f} kN/bar",
        "pressure at which the brake begins": f"{begins:8.2f} bar",
    }
    faces = clamping_faces(tables.get("vehicle", {})) * vehicle.radius_ratio.value
    if faces:
        rows["clamping force of one pad or block"] = f"{clamping / faces / 1e3:8.2f} kN/bar"
    for text, number in rows.items():
        print(f"{text:<42} {number}")
    print("± is the expanded uncertainty (95 %). K is of all pads or blocks of one axle, at the")
    print("wheel rim.")
    if table := vehicle.friction_table:
        speed, axle_force = table.middle
        at = f"{3.6 * speed:.0f} km/h"
        at += f" and {axle_force / faces / 1e3:.0f} kN per block" if axle_force and faces else ""
        print(f"Friction is a table. Force and deceleration are at {at}, φ {table.reference:.3f}.")
    return 0
