"""The brake as engineers state it, turned into the parameters of equation (15).

The force of one axle at the wheel rim is

    disc    φ · discs · pads_per_disc · cylinders · caliper_ratio · η · mean_radius/R · (A p − F_s)
    tread   φ · cylinders · rigging_ratio · η · (A p − F_s)

with the piston area A and the return spring force F_s of one cylinder. (15) has the same factors:
the number n of clamping forces, the lever ratio i, and the friction radius over the wheel radius.
UIC 541-05 and EN 14531-1 state a brake by these quantities.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from ..core.errors import UserError
from ..core.model import Parameter, Quantity, Vehicle, quantities
from ..core.toml import Table
from . import stated_friction
from .stated_values import parameter, table_of

_PistonArea = Annotated[
    float, Quantity("m²", "in place of the diameter; cylinder data sheet", 1e-4, 1.0)
]
_SpringForce = Annotated[
    float, Quantity("N", "return spring, at the piston; cylinder data sheet", 0.0, 50e3)
]


class DiscBrake(NamedTuple):
    """The keys of `[vehicle.disc_brake]`."""

    discs: Annotated[float, Quantity("-", "brake discs of one axle; bogie drawing", 1.0, 8.0)]
    pads_per_disc: Annotated[
        float, Quantity("-", "sides of a disc that a pad presses on; nearly always 2", 1.0, 2.0)
    ]
    cylinders: Annotated[
        float, Quantity("-", "brake cylinders of one disc; caliper data sheet", 1.0, 4.0)
    ]
    piston_diameter: Annotated[
        float, Quantity("m", "piston of one cylinder; cylinder data sheet (8 inch: 0.203)", 0.01, 1)
    ]
    piston_area: _PistonArea
    spring_force: _SpringForce
    caliper_ratio: Annotated[
        float,
        Quantity("-", "force of one pad over force of the piston; caliper data sheet", 0.05, 50.0),
    ]
    efficiency: Annotated[
        float, Quantity("-", "of cylinder and caliper; caliper data sheet", 0.1, 1.0)
    ]
    mean_radius: Annotated[
        float, Quantity("m", "mean friction radius of the disc; disc data sheet", 0.05, 0.6)
    ]


class TreadBrake(NamedTuple):
    """The keys of `[vehicle.tread_brake]`."""

    cylinders: Annotated[
        float, Quantity("-", "brake cylinders of one axle; 0.25: one for four axles", 0.1, 8.0)
    ]
    piston_diameter: Annotated[
        float,
        Quantity("m", "piston of one cylinder; cylinder data sheet (16 inch: 0.406)", 0.01, 1),
    ]
    piston_area: _PistonArea
    spring_force: _SpringForce
    rigging_ratio: Annotated[
        float,
        Quantity(
            "-", "force of all blocks of an axle over force of its pistons; brake calculation",
            0.05, 50.0,
        ),
    ]  # fmt: skip
    efficiency: Annotated[float, Quantity("-", "of the rigging; brake calculation", 0.1, 1.0)]
    blocks: Annotated[float, Quantity("-", "blocks of one axle, for the force of one", 1.0, 16.0)]


KINDS: Mapping[str, type[Any]] = {"disc_brake": DiscBrake, "tread_brake": TreadBrake}
ROTATING_MASS = Quantity(
    "-", "rotating mass as a share of the axle's mass, in place of the inertia; brake calculation",
    1e-3, 1.0,
)  # fmt: skip
KEYS = (*KINDS, "rotating_mass")
# For each brake: the factors of n with their usual values, the ratio, and what must be stated.
_COUNTS: Mapping[str, Mapping[str, float | None]] = {
    "disc_brake": {"discs": None, "pads_per_disc": 2.0, "cylinders": 1.0},
    "tread_brake": {"cylinders": 1.0},
}
_RATIOS = {"disc_brake": "caliper_ratio", "tread_brake": "rigging_ratio"}
_NEEDED = {
    "disc_brake": ("discs", "caliper_ratio", "mean_radius"),
    "tread_brake": ("rigging_ratio",),
}
_PISTONS = ("piston_diameter", "piston_area")
_OF_CYLINDER = ("efficiency", "spring_force")  # parameters of (15) as they are stated
_OWN = ("discs", "lever_ratio", "radius_ratio", "cylinder_diameter", *_OF_CYLINDER)


def with_parameters(vehicle: Table) -> Table:
    """The `[vehicle]` table with brake and friction as engineers state them, as of one axle.

    Each parameter is under its own name. `disc_brake`, `tread_brake` and `rotating_mass` are gone.

    Raises:
        UserError: two statements of the same brake, a missing or unknown key, a value out of
            range, or a length that needs the wheel's diameter without one.
    """
    parameters = {k: v for k, v in vehicle.items() if k not in KEYS}
    stated_kinds = [kind for kind in KINDS if kind in vehicle]
    if len(stated_kinds) > 1:
        text = "vehicle.disc_brake and vehicle.tread_brake are both stated"
        raise UserError(text, "keep the one whose cylinder pressure the log has", code=2)
    for kind in stated_kinds:
        if twice := [name for name in _OWN if name in parameters]:
            text = f"vehicle.{twice[0]} is stated beside [vehicle.{kind}]: the same brake twice"
            raise UserError(text, f"leave out vehicle.{twice[0]}, or that table", code=2)
        parameters |= _brake(kind, vehicle[kind], vehicle)
    if "rotating_mass" in vehicle:
        parameters["wheelset_inertia"] = _inertia(vehicle)
    if "friction" in parameters:
        faces = 0.0 if any(name in parameters for name in _OWN) else None
        if stated_kinds:
            faces = clamping_faces(vehicle) * parameters["radius_ratio"]["value"]
        friction = stated_friction.per_axle(parameters["friction"], faces)
        parameters["friction"] = friction
    return parameters


def clamping_faces(vehicle: Table) -> float:
    """The pads or blocks of one axle that share its clamping force; 0 where nobody stated them."""
    if disc := vehicle.get("disc_brake"):
        usual = {k: x for k, x in _COUNTS["disc_brake"].items() if k != "cylinders"}
        count_entries = {f"vehicle.disc_brake.{key}": disc.get(key, x) for key, x in usual.items()}
        return math.prod(parameter(name, entry).value for name, entry in count_entries.items())
    blocks = vehicle.get("tread_brake", {}).get("blocks", 0.0)
    return parameter("vehicle.tread_brake.blocks", blocks).value


def _brake(kind: str, table: Any, vehicle: Table) -> Table:
    """The parameters of (15) by one of the two tables."""
    ranges, section = quantities(KINDS[kind]), f"vehicle.{kind}"
    values = {}
    for key, entry in table_of(section, table, ranges).items():
        values[key] = parameter(f"{section}.{key}", entry)
        ranges[key].check(f"{section}.{key}", values[key].value)
    pistons = [key for key in _PISTONS if key in values]
    missing = [key for key in _NEEDED[kind] if key not in values] + [_PISTONS[0]] * (not pistons)
    if missing:
        text = f"[{section}] lacks {' and '.join(missing)}"
        hint = f"{ranges[missing[0]].text}. `adhesion vehicle` prints an example"
        raise UserError(text, hint, code=2)
    if len(pistons) > 1:
        text = f"[{section}] states piston_diameter and piston_area"
        raise UserError(text, "keep one of them", code=2)
    counts = [values.get(k) or Parameter(usual or 0.0, 0.0) for k, usual in _COUNTS[kind].items()]
    piston = values[pistons[0]]
    if pistons[0] == "piston_area":
        piston = _power_product((piston, 0.5), (Parameter(4.0 / math.pi, 0.0), 0.5))
    radius_ratio = Parameter(1.0, 0.0)
    if kind == "disc_brake":
        R = _wheel_radius(vehicle, f"{section}.mean_radius")
        radius_ratio = _power_product((values["mean_radius"], 1.0), (R, -1.0))
    return {
        "discs": _power_product(*((count, 1.0) for count in counts))._asdict(),
        "lever_ratio": values[_RATIOS[kind]]._asdict(),
        "radius_ratio": radius_ratio._asdict(),
        "cylinder_diameter": piston._asdict(),
    } | {key: table[key] for key in _OF_CYLINDER if key in table}


def _inertia(vehicle: Table) -> Table:
    """I = share · m · R² [kg m²]: the rotating mass at the rim."""
    name = "vehicle.rotating_mass"
    if "wheelset_inertia" in vehicle:
        text = f"vehicle.wheelset_inertia is stated beside {name}: the same inertia twice"
        raise UserError(text, "leave out one of them", code=2)
    if "axle_mass" not in vehicle:
        raise UserError(f"{name} needs the mass", "state vehicle.axle_mass [kg], too", code=2)
    default = Vehicle().wheelset_inertia
    share = parameter(name, vehicle["rotating_mass"], default.share)
    ROTATING_MASS.check(name, share.value)
    mass = parameter("vehicle.axle_mass", vehicle["axle_mass"])
    R = _wheel_radius(vehicle, name)
    inertia = _power_product((share, 1.0), (mass._replace(tolerance=0.0), 1.0), (R, 2.0))
    return inertia._asdict()


def _wheel_radius(vehicle: Table, needed_by: str) -> Parameter:
    """The mean of the stated wheel radii [m], with the tolerance of the first."""
    radius = vehicle.get("wheel_radius")
    if radius is None or radius == []:
        hint = "state vehicle.wheel_diameter [m], too"
        raise UserError(f"{needed_by} needs the diameter of the wheels", hint, code=2)
    (default,) = Vehicle().wheel_radius
    entries = radius if isinstance(radius, list) else [radius]
    radii = [parameter("vehicle.wheel_radius", entry, default.share) for entry in entries]
    mean = sum(r.value for r in radii) / len(radii)
    quantities(Vehicle)["wheel_radius"].check("vehicle.wheel_radius", mean)
    return radii[0]._replace(value=mean)


def _power_product(*factors: tuple[Parameter, float]) -> Parameter:
    """A product of powers of independent factors. Source: JCGM 100, 5.1.6."""
    value = math.prod(x.value**n for x, n in factors)
    shares = (n * x.share for x, n in factors)
    return Parameter(value, abs(value) * math.hypot(*shares))
