"""The scalar equations that both source documents share, each once.

Numbers ``(n)`` are those of Wu, Peng, Li, "Online estimation algorithm of adhesive force for train
wheel-track"; ``[Sn]`` the steps of the patent on slip and slope. Plain arithmetic, for floats,
arrays and compiled loops.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .model import AxleRecord, Floats, FrictionTable, SpeedEffect, Vehicle, Wheelset

G = 9.80665  # standard gravity [m/s²]
BAR = 1e5  # [Pa]
NORMAL_PRESSURE = 101_325.0 * 293.15 / 273.15  # of normal air (DIN 1343) at 20 °C [Pa]
HARDER = 1.2  # brakes may decelerate by this factor more than their parameters say
GRADIENT = 0.4  # deceleration by a gradient of 4 %, the steepest of ordinary lines [m/s²]
LOCKING = 30.0  # no brake decelerates a wheel harder, even without adhesion [m/s²]
RISE = 3.0  # no train accelerates harder, but a wheel after a slide does [m/s²]
CRAWL = 1.0  # below it a wheel may stand, and a slip is mostly an error of the speeds [m/s]
RELEASED_SHARE = 0.05  # share of the highest clamping force: less is no braking
_EFFECT_SIGMAS = 2.5  # of an effect of the speed on the brake, from which the friction changes
_EFFECT_FACTOR = 1.25  # by which it changes at least: gradients that change look alike
LEAST_SHARE = 0.1  # of friction that every pad keeps at any speed
NO_FORCE = 60.0  # clamping force that does not brake: the pads just touch [N]
SLOW = 1.39  # jerk and locks are judged above: 5 km/h [m/s]
RECEIVER_INTERVAL = 0.15  # a train speed with longer intervals is a receiver's, and late [s]
RECEIVER_DELAY = 0.75  # 1 sigma of its delay, where the log does not show it, at least [s]
WORKING = 2.78  # a WSP works at least down to it, and the largest slip is judged: 10 km/h [m/s]
JUDGED_FROM = 1.0  # slower trains are not judged, and slip is relative to at least this [m/s]
SLIDE = 0.05  # slip from which a wheel slides [-]
LONGEST_DUMP = 3.0  # a shorter release of a brake is one of wheel slide protection [s]
STANDING = 0.1  # a rim or a train slower than this stands [m/s]
ROLLS, SLIDES, LOCKED = 0, 1, 2


def wheelset(vehicle: Vehicle, axle: int) -> Wheelset:
    """Constants of (1) for one axle. Source: (1); rolling without slip gives `rolling`."""
    v = vehicle.of_axle(axle)
    I, m = v.wheelset_inertia.value, v.axle_mass.value  # noqa: E741
    return wheelset_of(v.radius(axle).value, v.friction.value, I, m)


def wheelset_of(R: float, phi: float, I: float, m: float) -> Wheelset:  # noqa: E741
    """The same from radius R [m], friction φ, inertia I [kg m²] and mass m [kg]. Source: (1)."""
    a = R / I
    return Wheelset(a, phi, 1.0 / (1.0 + I / (m * R * R)), R, I, m)


def rolling_deceleration(w: Wheelset) -> float:
    """−ω̇ of a rolling wheel per K, with which the train slows [rad/s² per N]. Source: (1)."""
    return w.a * w.phi * (1.0 - w.rolling)


def clamping_force(pressure: Floats, vehicle: Vehicle) -> Floats:
    """Equivalent clamping force K [N] from brake-cylinder pressure [Pa], shape (n,). Source: (15).

    The lever ratio i and the friction-radius ratio are not in the printed equation; both are 1 for
    the paper's vehicle. Below the spring's force the pads do not touch: K is never negative.
    """
    force: Floats = clamping(force_line(vehicle), pressure)
    return force


def friction_share(rim: Any, K: Any, vehicle: Vehicle) -> Any:
    """φ(v, K) / φ [-] at the rim speed v = ωR [m/s] and the clamping force K [N], shape (n,).

    v is the speed of the pad on its disc, and K is shared by the pads or blocks of the axle.
    """
    return fade_share(rim, vehicle) * table_share(rim, K, vehicle.friction_table)


def fade_share(rim: Any, vehicle: Vehicle) -> Any:
    """The same without a friction table: φ(v) / φ [-]."""
    faster = rim - vehicle.friction_speed.value
    return np.maximum(1.0 + vehicle.friction_fade.value * faster, LEAST_SHARE)


def friction_change(effect: SpeedEffect, stated: Vehicle) -> float:
    """Slope of ln φ over the speed that a log shows beyond what is stated [s/m]; 0 if not clear.

    `effect` is without what a friction table says. `stated` has a `friction_fade`.
    """
    without_table = replace(stated, friction_table=None)
    at_low, at_high = (friction_share(v, 0.0, without_table) for v in (effect.low, effect.high))
    change = math.log(effect.ratio * at_high / at_low)
    if abs(change) <= max(_EFFECT_SIGMAS * effect.sigma, math.log(_EFFECT_FACTOR)):
        return 0.0
    return change / (effect.low - effect.high)


def table_share(rim: Any, K: Any, table: FrictionTable | None) -> Any:
    """The same of a stated table alone; 1 where there is none."""
    return 1.0 if table is None else table.at(rim, K) / table.reference


def with_fade(record: AxleRecord, vehicle: Vehicle) -> AxleRecord:
    """The record with φ(v, K) / φ as a factor of K: both act as φK only. Source: (1)."""
    vehicle = vehicle.of_axle(record.axle)
    if not has_fade(vehicle):
        return record
    rim = record.wheel_speed * vehicle.radius(record.axle).value
    K, smooth = record.friction_clamping, record.friction_clamping_smooth
    K, smooth = friction_share(rim, K, vehicle) * K, friction_share(rim, smooth, vehicle) * smooth
    # No friction changes the force of motors.
    if record.motor_clamping is not None and record.motor_clamping_smooth is not None:
        K, smooth = K + record.motor_clamping, smooth + record.motor_clamping_smooth
    return replace(record, clamping_force=K, clamping_force_smooth=smooth)


def has_fade(vehicle: Vehicle) -> bool:
    """Whether φ changes with speed or clamping force."""
    return vehicle.friction_fade.value != 0.0 or vehicle.friction_table is not None


# parameters between the piston and K: n, η, i and the ratio of radii
CHAIN = ("discs", "efficiency", "lever_ratio", "radius_ratio")


class ForceLine(NamedTuple):
    """(15) above the spring's force, where it is a straight line."""

    per_pascal: float  # dK/dp [N/Pa]
    at_zero: float  # what the spring takes from K [N]


def piston_area(vehicle: Vehicle) -> float:
    """Area of the piston of the brake cylinder [m²]."""
    return math.pi * vehicle.cylinder_diameter.value**2 / 4.0


def chain_ratio(vehicle: Vehicle) -> float:
    """K over the force of the piston [-]."""
    ratio: float = math.prod(getattr(vehicle, name).value for name in CHAIN)
    return ratio


def force_line(vehicle: Vehicle) -> ForceLine:
    """The constants of (15)."""
    ratio = chain_ratio(vehicle)
    return ForceLine(ratio * piston_area(vehicle), ratio * vehicle.spring_force.value)


def clamping(line: ForceLine, p: Any) -> Any:
    """K [N] at the cylinder pressure p [Pa], a number or an array. Source: (15)."""
    return np.maximum(line.per_pascal * p - line.at_zero, 0.0)  # (15)


def cylinder_pressure(line: ForceLine, K: Any) -> Any:
    """The inverse of `clamping` for K > 0: p [Pa]. Source: (15)."""
    return (K + line.at_zero) / line.per_pascal  # (15)


def slip_over(v: Any, rim: Any, floor: float) -> Any:
    """Slip s [-] from v and ωR [m/s] over a speed of at least `floor` [m/s]. Source: (2)."""
    return (v - rim) / np.maximum(v, floor)  # (2)


def slip(train_speed: Floats, wheel_speed: Floats, radius: float, slowest: float) -> Floats:
    """Slip s [-] from v [m/s] and ω [rad/s], shape (n,); NaN below `slowest` [m/s]."""
    s = slip_over(train_speed, wheel_speed * radius, slowest)
    return np.where(train_speed >= slowest, s, np.nan)


def braked(K: Any, w: Wheelset) -> Any:
    """Deceleration [m/s²] of a rolling wheel by its clamping force. Source: (1)."""
    return rolling_deceleration(w) * w.radius * K


def reference_speed(previous: float, fastest: float, braking: float, h: float) -> float:
    """Reference speed [m/s], one step later: the train speed as a WSP controller estimates it.

    The fastest axle is the train. It decelerates no harder than all brakes together on a gradient.
    Where every axle does, all slide. The speed then continues at that limit. All speeds are in m/s.
    `fastest` is the largest rim speed, `braking` the deceleration by the axles' brakes, from
    `braked`, or by their forces [m/s²], `h` the interval [s].
    """
    slowest = previous - (HARDER * braking + GRADIENT) * h
    return max(min(max(fastest, slowest), previous + RISE * h), 0.0)


def coefficient(force: Floats, vehicle: Vehicle, axle: int) -> Floats:
    """Adhesion coefficient μ = F/(m g) [-] of an axle, shape (n,). Source: [S1]."""
    return force / (vehicle.of_axle(axle).axle_mass.value * G)
