"""Logs of a metro whose ED brake and motors act beside the friction brake, with known force."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adhesion_cli.core.model import Floats

MASS, INERTIA, RADIUS, PHI = 14e3, 105.0, 0.42, 0.35
AXLES = 4
_STEPS = 8  # of the simulation, for each sample
RATIO, PISTON, SPRING = 2 * 2 * 0.95 * 2.5 * 0.247 / RADIUS, np.pi * 0.203**2 / 4.0, 1500.0
VEHICLE = """
[vehicle]
axle_mass = 14000
wheelset_inertia = 105
wheel_diameter = 0.84
friction = 0.35
[vehicle.disc_brake]
discs = 2
mean_radius = 0.247
caliper_ratio = 2.5
efficiency = 0.95
piston_diameter = 0.203
spring_force = 1500
"""


class Blended(NamedTuple):
    """A log of rolling wheels, shape (n,) or (4, n)."""

    t: Floats  # [s]
    pressure: Floats  # of each axle [bar]
    ed: Floats  # at the rim of each axle [N]
    traction: Floats  # at the rim of each axle [N]
    v: Floats  # [m/s]
    force: Floats  # true adhesion force of each axle [N]
    stops: tuple[tuple[float, float], ...]  # from and to [s]

    def mean_coefficient(self, axle: int, start: float, stop: float) -> float:
        """Mean of the true adhesion coefficient of an axle, counted from 1."""
        inside = (self.t >= start) & (self.t <= stop)
        return float(np.mean(self.force[axle - 1][inside])) / (MASS * 9.80665)

    def write(self, path: Path, columns: dict[str, Floats], seed: int = 1) -> Path:
        """The log as CSV: pressures and speeds with noise, and further columns as they are."""
        rng = np.random.default_rng(seed)
        table = {"time [s]": self.t}
        for bogie in (1, 2):
            noise = rng.normal(0.0, 0.01, len(self.t))
            table[f"BC pressure bogie {bogie} [bar]"] = self.pressure[2 * bogie - 1] + noise
        for axle in range(1, AXLES + 1):
            noise = rng.normal(0.0, 0.01, len(self.t))
            table[f"axle {axle} speed [km/h]"] = np.maximum(3.6 * (self.v + noise), 0.0)
        table |= columns
        rows = np.column_stack(list(table.values()))
        np.savetxt(path, rows, fmt="%.3f", delimiter=",", header=",".join(table), comments="",
                   encoding="utf-8")  # fmt: skip
        return path


@cache
def blended(
    fastest: tuple[float, ...] = (60.0, 70.0, 80.0),
    decelerations: tuple[float, ...] = (0.7, 0.9, 1.1),
    ed_share: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0),
    ed_part: float = 0.7,
    rate: float = 12.5,
    coasting: float = 6.0,
) -> Blended:
    """Accelerations of 0.9 m/s² and stops in which an ED brake takes a part above 8 km/h.

    Args:
        fastest: speed of each run [km/h].
        decelerations: demand of each stop [m/s²].
        ed_share: how the ED force and the traction are shared by the axles, 1 on average.
        ed_part: share of the braking that the ED brake takes at speed.
        rate: samples a second.
        coasting: time between the motors' drive and each stop [s].
    """
    h, rotating = 1.0 / (_STEPS * rate), INERTIA / RADIUS**2
    v = time = ed = traction = force_air = 0.0
    rows: list[tuple[float, ...]] = []
    stops = []
    share = np.array(ed_share)

    def advance(wanted_traction: float, wanted_brake: float) -> None:
        nonlocal v, time, ed, traction, force_air
        possible = wanted_brake * ed_part * min(max((v - 2.2) / 2.0, 0.0), 1.0)
        ed += (possible - ed) * min(h / 0.3, 1.0)
        force_air += (wanted_brake - possible - force_air) * min(h / 0.25, 1.0)
        traction += (wanted_traction - traction) * min(h / 0.3, 1.0)
        resistance = MASS * (0.012 + 3e-5 * v * v) if v > 0.0 else 0.0
        net = ed + force_air - traction
        a = -(net + resistance) / (MASS + rotating)
        moves = v + a * h > 0.0
        rows.append((time, force_air, ed, traction, v, a if moves else 0.0))
        v = v + a * h if moves else 0.0
        time += h

    for top, demand in zip(fastest, decelerations, strict=True):
        for _ in range(round(8.0 / h)):
            advance(0.0, 0.3 * MASS)
        while v < top / 3.6:
            advance(0.9 * (MASS + rotating), 0.0)
        for _ in range(round(coasting / h)):
            advance(0.0, 0.0)
        begin = time
        while v > 0.0:
            advance(0.0, demand * (MASS + rotating))
        stops.append((begin, time))
    for _ in range(round(8.0 / h)):
        advance(0.0, 0.3 * MASS)
    t, air, ed_rim, traction_rim, speed, rates = np.array(rows[::_STEPS]).T
    K = air / PHI
    pressure = np.where(air > 1.0, (K / RATIO + SPRING) / PISTON / 1e5, 0.0)
    forces = air + share[:, None] * (ed_rim - traction_rim) + rotating * rates
    return Blended(
        t,
        np.broadcast_to(pressure, (AXLES, len(t))),
        share[:, None] * ed_rim,
        share[:, None] * traction_rim,
        speed,
        forces,
        tuple(stops),
    )
