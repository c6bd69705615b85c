"""Logs of a train that rolls, with another friction and mass than stated."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.core.physics import G, braked, clamping_force, friction_share, wheelset

STATED = replace(Vehicle(), lever_ratio=Parameter(2.4, 0.0))
# Everything that scales the brake, of the default vehicle, as somebody states it.
WHOLE: dict[str, object] = {
    name: getattr(Vehicle(), name).value
    for name in (
        "friction", "axle_mass", "discs", "lever_ratio", "radius_ratio", "cylinder_diameter",
    )
}  # fmt: skip


def true(friction: float = 1.0, mass: float = 1.0, **more: Parameter) -> Vehicle:
    """The stated vehicle with its friction and its mass off by these factors."""
    phi, m = STATED.friction.value, STATED.axle_mass.value
    return replace(
        STATED, friction=Parameter(friction * phi, 0.0), axle_mass=Parameter(mass * m, 0.0), **more
    )


def log(
    path: Path, vehicle: Vehicle, seed: int = 1, applications: int = 3, drag: float = 0.0,
    before: float = 7.0, gradient: float = 0.0, traction: float = 0.0,
) -> Path:  # fmt: skip
    """A train that rolls, braked several times on gradients that change; no train speed.

    Args:
        path: file to write.
        vehicle: as it truly is.
        seed: of pressures, gradients and noise.
        applications: how many.
        drag: of the air, over the square of speed [1/m].
        before: from a change of the gradient to the next brake application [s].
        gradient: of the whole line, uphill positive; the others are less than it and more.
        traction: acceleration by motors, until a brake begins and again after it [m/s²].
    """
    rng, h = np.random.default_rng(seed), 0.05
    t = np.arange(0.0, 10.0 + 26.0 * applications, h)
    p, slope = np.zeros(len(t)), np.zeros(len(t))
    for i in range(applications):
        begin = 8.0 + 26.0 * i
        up = np.minimum((t - begin) / 1.5, (begin + 12.0 - t) / 1.5)
        p = np.maximum(p, np.clip(up, 0.0, 1.0) * rng.uniform(1.5e5, 3.5e5))
        slope[t > begin - before] = rng.normal(0.0, 0.02)
        slope[(t > begin - 12.0 + 2.0 * (i > 0)) & (t < begin)] -= traction
    v, speed = np.empty(len(t)), 42.0
    w, K = wheelset(vehicle, 1), clamping_force(p, vehicle)
    for i in range(len(t)):
        v[i] = speed
        braking = float(braked(K[i], w) * friction_share(speed, K[i], vehicle))
        climbing = G * gradient * w.rolling
        speed -= h * (braking + climbing + 0.012 + slope[i] + drag * v[i] ** 2)
    rim = v + rng.normal(0.0, 0.004, len(t))
    rows = [f"{a:.2f},{b / 1e5:.4f},{3.6 * c:.4f}" for a, b, c in zip(t, p, rim, strict=True)]
    path.write_text("time [s],bc pressure [bar],wheel speed [km/h]\n" + "\n".join(rows) + "\n")
    return path


def blended_log(path: Path) -> Path:
    """A stop in which the pressure rises where another brake fades; the train slows as before."""
    t = np.arange(0.0, 60.0, 0.05)
    v = np.clip(22.0 - 0.75 * np.maximum(t - 10.0, 0.0), 0.0, None)
    p = np.where((t > 10.0) & (v > 4.0), 0.7, 0.0) + np.where((v <= 4.0) & (v > 0.0), 2.2, 0.0)
    rows = [f"{a:.2f},{b:.3f},{3.6 * c:.3f},{3.6 * c:.3f}" for a, b, c in zip(t, p, v, strict=True)]
    head = "time [s],bc pressure [bar],axle 1 speed [km/h],axle 2 speed [km/h]"
    path.write_text("\n".join([head, *rows, ""]))
    return path
