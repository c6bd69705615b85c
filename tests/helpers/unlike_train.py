"""A log of a train whose axles have different brakes and masses."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from adhesion_cli.core.model import Floats, Vehicle
from adhesion_cli.core.physics import G, clamping_force, friction_share, wheelset

# As a TOML states it: a motor car with discs, a trailer with tread brakes.
TRAIN: dict[str, Any] = {
    "vehicle": {"friction": 0.35, "wheel_diameter": 0.84},
    "car": {
        "motor": {
            "axles": [1, 2],
            "axle_mass": 16000,
            "wheelset_inertia": 160,
            "disc_brake": {
                "discs": 2, "mean_radius": 0.247, "caliper_ratio": 2.4, "efficiency": 0.95,
                "piston_diameter": 0.203, "spring_force": 1500,
            },
        },
        "trailer": {
            "axles": [3, 4, 5],
            "axle_mass": 12000,
            "rotating_mass": 0.05,
            "wheel_diameter": 0.92,
            "friction": 0.25,
            "tread_brake": {
                "rigging_ratio": 8.5, "efficiency": 0.83, "piston_diameter": 0.203,
                "spring_force": 1000,
            },
        },
    },
}  # fmt: skip


def write(
    path: Path, vehicle: Vehicle, axles: Sequence[int], load: Floats | None = None, seed: int = 1
) -> dict[int, Floats]:
    """Two stops of wheels that roll, with noise; µ of each axle, (n,), by its number.

    Args:
        path: file to write.
        vehicle: as it truly is.
        axles: their numbers.
        load: load pressure of each axle [bar], where it is logged.
        seed: of the noise.
    """
    random, h = np.random.default_rng(seed), 0.05
    t = np.arange(0.0, 80.0, h)
    p = 3.0e5 * np.clip((t - 6.0) / 1.5, 0.0, 1.0) * np.clip((26.0 - t) / 1.5, 0.0, 1.0)
    p += 2.2e5 * np.clip((t - 40.0) / 1.5, 0.0, 1.0) * np.clip((64.0 - t) / 1.5, 0.0, 1.0)
    own = {number: wheelset(vehicle, number) for number in axles}
    mass = sum(w.mass + w.inertia / w.radius**2 for w in own.values())
    clamping = {n: clamping_force(p, vehicle.of_axle(n)) for n in axles}
    force = {n: np.empty(len(t)) for n in axles}
    v, slowing, speed = np.empty(len(t)), np.empty(len(t)), 58.0
    for i in range(len(t)):
        for n, w in own.items():
            K = clamping[n][i]
            force[n][i] = w.phi * K * friction_share(speed, K, vehicle.of_axle(n))
        v[i], slowing[i] = speed, sum(F[i] for F in force.values()) / mass + 0.015
        speed -= h * slowing[i]
    columns = [t, *(p / 1e5 + random.normal(0.0, 0.002, len(t)) for _ in axles)]
    columns += [3.6 * (v + random.normal(0.0, 0.004, len(t))) for _ in axles]
    names = [f"bc pressure axle {n} [bar]" for n in axles]
    names += [f"speed axle {n} [km/h]" for n in axles]
    if load is not None:
        columns += [x + random.normal(0.0, 0.01, len(t)) for x in load]
        names += [f"load pressure axle {n} [bar]" for n in axles]
    rows = [",".join(f"{x:.4f}" for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([",".join(["time [s]", *names]), *rows, ""]))
    return {
        n: (force[n] - w.inertia / w.radius**2 * slowing) / (w.mass * G) for n, w in own.items()
    }
