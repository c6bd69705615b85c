"""The scalar equations both source documents share, each once.

Numbers ``(n)`` are those of Wu, Peng, Li, "Online estimation algorithm of adhesive force for train
wheel-track"; ``[Sn]`` the steps of the patent on slip and slope. Plain arithmetic: works on floats,
on arrays and inside a compiled loop.
"""

import math

import numpy as np

from .model import Floats, Vehicle, Wheelset

G = 9.80665  # standard gravity [m/s²]


def wheelset(vehicle: Vehicle, axle: int) -> Wheelset:
    """Constants of (1) for one axle. Source: (1); rolling without slip gives `rolling`."""
    R, I, m = vehicle.radius(axle).value, vehicle.wheelset_inertia.value, vehicle.axle_mass.value  # noqa: E741
    return Wheelset(a=R / I, phi=vehicle.friction.value, rolling=1.0 / (1.0 + I / (m * R * R)))


def clamping_force(pressure: Floats, vehicle: Vehicle) -> Floats:
    """Equivalent clamping force K [N] from brake-cylinder pressure [Pa], shape (n,). Source: (15).

    The lever ratio i and the friction-radius ratio are not in the printed equation; both are 1 for
    the paper's vehicle. The spring keeps the pads off below its force: never negative.
    """
    area = math.pi * vehicle.cylinder_diameter.value**2 / 4.0
    per_bar = vehicle.discs.value * vehicle.efficiency.value * vehicle.lever_ratio.value
    K = per_bar * (area * pressure - vehicle.spring_force.value)                    # (15)
    return np.maximum(K, 0.0) * vehicle.radius_ratio.value


def slip(train_speed: Floats, wheel_speed: Floats, radius: float, slowest: float) -> Floats:
    """Slip s [-] from v [m/s] and ω [rad/s], shape (n,); NaN below `slowest` [m/s]. Source: (2)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (train_speed - wheel_speed * radius) / train_speed                      # (2)
    return np.where(train_speed >= slowest, s, np.nan)


def coefficient(force: Floats, vehicle: Vehicle) -> Floats:
    """Adhesion coefficient μ = F/(m g) [-], shape (n,). Source: [S1]."""
    return force / (vehicle.axle_mass.value * G)
