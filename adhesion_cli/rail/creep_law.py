"""Wheel on rail: Polach's creep force (3) and the rail conditions it is used with.

Sources: (3) of the paper; O. Polach, "Creep forces in simulations of traction vehicles running on
adhesion limit", Wear 258 (2005) 992-1000; the friction law that falls with sliding is the patent's.
The functions of one point are plain arithmetic on floats and run inside compiled loops.
"""

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, NamedTuple

from ..core.errors import unknown
from ..core.model import Quantity, fraction

CREEP_FROM = 0.1  # creepage counts from this speed up [m/s]: (2) has no value at standstill


class Condition(NamedTuple):
    """What the rail's surface does; names as in Polach's paper."""

    k_a: Annotated[float, Quantity("-", "slope reduction in the area of adhesion kA", 1e-3, 1.0)]
    k_s: Annotated[float, fraction("slope reduction in the area of slip kS")]
    f0: Annotated[float, Quantity("-", "friction coefficient without sliding", 1e-3, 1.0)]
    A: Annotated[float, Quantity("-", "friction at infinite sliding over f0", 1e-3, 1.0)]
    B: Annotated[float, Quantity("s/m", "decay of friction with sliding speed", 0.0, 10.0)]


class Patch(NamedTuple):
    """Contact of one wheelset, both wheels: what (3) needs besides slip and rail."""

    load: float  # normal force of the wheelset, 2 Q [N]
    stiffness_x: float  # (2/3) C π a² b / Q, longitudinal: ε f / s [-]
    stiffness_y: float  # the same with C22, lateral [-]
    creep_y: float  # lateral creepage [-]


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact ellipse and Kalker coefficients of one wheel.

    The ellipse is Hertz's for the paper's axle: 23.5 kN a wheel of radius 0.42 m with a straight
    tread, on a rail head of radius 0.3 m (E 210 GPa, ν 0.3). The coefficients are Kalker's for
    b/a = 0.8 and ν = 0.25.
    """

    a: Annotated[float, Quantity("m", "semi-axis a along the rail", 0.0, 0.05)] = 4.25e-3
    b: Annotated[float, Quantity("m", "semi-axis b across the rail", 0.0, 0.05)] = 3.37e-3
    shear_modulus: Annotated[float, Quantity("Pa", "shear modulus G", 0.0, 1e12)] = 8e10
    c11: Annotated[float, Quantity("-", "Kalker coefficient C11, longitudinal", 0.0, 50.0)] = 4.36
    c22: Annotated[float, Quantity("-", "Kalker coefficient C22, lateral", 0.0, 50.0)] = 3.99
    lateral_creep: Annotated[float, Quantity("-", "lateral creepage sy", -0.1, 0.1)] = 0.0

    def patch(self, load: float) -> Patch:
        """The constants of (3) for a wheelset that presses on the rail with `load` [N]."""
        Q = load / 2.0

        def stiffness(kalker: float) -> float:
            C = 3.0 / 8.0 * self.shear_modulus / self.a * kalker  # (3)
            return 2.0 / 3.0 * C * math.pi * self.a**2 * self.b / Q  # (3)

        return Patch(load, stiffness(self.c11), stiffness(self.c22), self.lateral_creep)


def creep_force(sliding: float, speed: float, rail: Condition, patch: Patch) -> tuple[float, float]:
    """Longitudinal adhesion force of a wheelset and its slope.

    Creepage counts from `CREEP_FROM` up, so that force and slope exist at every speed. `sliding` is
    v − ωR [m/s], positive when braking, `speed` v [m/s].

    Returns:
        F [N], odd in `sliding`, and ∂F/∂sliding [N s/m] at constant speed (with lateral creep, at
        constant Kalker coefficient).
    """
    return creep_slopes(sliding, speed, rail, patch)[:2]


def creep_slopes(
    sliding: float, speed: float, rail: Condition, patch: Patch
) -> tuple[float, float, float, float, float, float]:
    """The force, and its slopes by sliding and the constants; arguments as of `creep_force`.

    Returns:
        F [N], ∂F/∂sliding [N s/m], kA ∂F/∂kA, kS ∂F/∂kS, ∂F/∂A [N], B ∂F/∂B [N].
    """
    reference = max(speed, CREEP_FROM)
    s_x = sliding / reference
    s, stiffness = max(abs(s_x), 1e-12), patch.stiffness_x
    if patch.creep_y != 0.0:
        s = math.hypot(s_x, patch.creep_y)
        stiffness = math.hypot(patch.stiffness_x * s_x, patch.stiffness_y * patch.creep_y) / s
    falling = rail.f0 * (1.0 - rail.A) * math.exp(-rail.B * s * reference)
    f = falling + rail.f0 * rail.A  # f0 [(1 − A) e^(−B Δv) + A]
    e = stiffness * s / f  # (3)
    x, y = rail.k_a * e, rail.k_s * e
    g = x / (1.0 + x * x) + math.atan(y)  # (3)
    df = -rail.B * reference * falling
    dg = rail.k_a * (1.0 - x * x) / (1.0 + x * x) ** 2 + rail.k_s / (1.0 + y * y)
    scale, direction = 2.0 * patch.load / math.pi, s_x / s
    per_creep = scale * f * g / s  # total force over total creepage
    slope = scale * (df * g + dg * (stiffness - e * df))
    longitudinal = scale * s_x / s
    by_x, by_y = x * (1.0 - x * x) / (1.0 + x * x) ** 2, y / (1.0 + y * y)
    by_f = longitudinal * (g - by_x - by_y)  # e goes with 1/f
    by_a = rail.f0 - falling / (1.0 - rail.A) if rail.A < 1.0 else 0.0
    return (
        per_creep * s_x,
        (per_creep + direction * direction * (slope - per_creep)) / reference,
        longitudinal * f * by_x,
        longitudinal * f * by_y,
        by_f * by_a,
        -by_f * rail.B * s * reference * falling,
    )


@cache
def conditions() -> dict[str, Condition]:
    """Every rail condition of `rails.toml` by name; sources and doubts stand in that file."""
    table = tomllib.loads((Path(__file__).parent / "rails.toml").read_text("utf-8"))
    fields = Condition._fields
    return {name: Condition(*(float(row[key]) for key in fields)) for name, row in table.items()}


def condition(name: str | Condition) -> Condition:
    """The rail condition of that name, or one given by its constants.

    Raises:
        UserError: unknown name.
    """
    if isinstance(name, Condition):
        return name
    by_name = conditions()
    if name not in by_name:
        raise unknown("rail condition", name, list(by_name))
    return by_name[name]
