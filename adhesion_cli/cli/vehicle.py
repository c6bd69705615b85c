"""`adhesion vehicle`: a vehicle to start from, and what a stated one means at the rail."""

from typing import TYPE_CHECKING, Annotated

import typer

from .options import Shared, shared

if TYPE_CHECKING:
    from ..core.model import Parameter


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
        return 0
    return _derived(shared)


def _derived(shared: Shared) -> int:
    """The force at the rail, and the deceleration, of the stated vehicle."""
    from ..analysis import settings as all_settings
    from ..analysis.identify import deceleration_per_bar, force_per_bar
    from ..analysis.stated_brake import clamping_faces
    from ..core import physics
    from ..core.document import dumps, tagged
    from ..core.model import Z95
    from .options import load_settings

    vehicle = load_settings(shared).vehicle
    tables = all_settings.layered_tables(shared.config, shared.set_)
    faces = clamping_faces(tables.get("vehicle", {}))
    line = physics.force_line(vehicle)
    per_bar = line.per_pascal * physics.BAR
    rows: list[tuple[str, str, Parameter, float, int]] = [
        ("brake force at the rail, per axle", "kN/bar", force_per_bar(vehicle), 1e-3, 2),
        (
            "deceleration of a car, all axles braked",
            "m/s²/bar",
            deceleration_per_bar(vehicle),
            1,
            3,
        ),
    ]
    more = [
        ("equivalent clamping force K per axle", "kN/bar", per_bar / 1e3),
        ("pressure at which the brake begins", "bar", line.at_zero / line.per_pascal / physics.BAR),
    ]
    if faces:
        face = per_bar / faces / vehicle.radius_ratio.value
        more.append(("clamping force of one pad or block", "kN/bar", face / 1e3))
    if shared.json:
        keys = ("force_per_bar_n", "deceleration_per_bar")
        body = {
            key: {"value": x.value, "u95": Z95 * x.tolerance}
            for key, (_, _, x, _, _) in zip(keys, rows, strict=True)
        }
        print(dumps(tagged("vehicle", **body, clamping_force_per_bar_n=per_bar)))
        return 0
    for text, unit, x, factor, digits in rows:
        print(
            f"{text:<42} {factor * x.value:8.{digits}f} ± {factor * Z95 * x.tolerance:.{digits}f}"
            f" {unit}"
        )
    for text, unit, value in more:
        print(f"{text:<42} {value:8.2f} {unit}")
    print("± is the expanded uncertainty (95 %). K is of all pads of one axle, at the wheel rim.")
    return 0
