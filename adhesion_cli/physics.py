"""The scalar equations both source documents share, each once.

Numbers ``(n)`` are those of Wu, Peng, Li, "Online estimation algorithm of adhesive force for train
wheel-track"; ``[Sn]`` the steps of the patent on slip and slope. Plain arithmetic: works on floats,
on arrays and inside a compiled loop.
"""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from .model import AxleRecord, Bools, Floats, Times, Vehicle, Wheelset

G = 9.80665  # standard gravity [m/s²]
HARDER = 1.2  # error of what brakes are said to do
GRADIENT = 0.4  # a slope of 4 % gives or takes [m/s²]
LOCKING = 30.0  # no brake stops a wheel harder, even without adhesion [m/s²]
RISE = 3.0  # no train accelerates harder, but a wheel after a slide does [m/s²]
_GONE = 0.2  # share of the largest clamping force: from there down, a brake lets go
_CRAWL = 0.2  # a wheel slower than this may stand [rad/s]
_STOP = 0.3  # and does, if it stays so for this long [s]
_DRIVEN = 3.0  # such a wheel has caught up after this long [s]


def wheelset(vehicle: Vehicle, axle: int) -> Wheelset:
    """Constants of (1) for one axle. Source: (1); rolling without slip gives `rolling`."""
    R, I, m = vehicle.radius(axle).value, vehicle.wheelset_inertia.value, vehicle.axle_mass.value  # noqa: E741
    return Wheelset(R / I, vehicle.friction.value, 1.0 / (1.0 + I / (m * R * R)), R, I, m)


def rolling_deceleration(w: Wheelset) -> float:
    """−ω̇ of a rolling wheel per K, with which the train slows [rad/s² per N]. Source: (1)."""
    return w.a * w.phi * (1.0 - w.rolling)


def clamping_force(pressure: Floats, vehicle: Vehicle) -> Floats:
    """Equivalent clamping force K [N] from brake-cylinder pressure [Pa], shape (n,). Source: (15).

    The lever ratio i and the friction-radius ratio are not in the printed equation; both are 1 for
    the paper's vehicle. The spring keeps the pads off below its force: never negative.
    """
    force: Floats = clamping(force_line(vehicle), pressure)
    return force


class ForceLine(NamedTuple):
    """(15) as the straight line that it is above the spring's force."""

    per_pascal: float  # dK/dp [N/Pa]
    at_zero: float  # what the spring takes from K [N]


def force_line(vehicle: Vehicle) -> ForceLine:
    """The constants of (15): with n η i and the ratio of radii, K over the force of the piston."""
    v = vehicle
    ratio = v.discs.value * v.efficiency.value * v.lever_ratio.value * v.radius_ratio.value
    per_pascal = ratio * math.pi * v.cylinder_diameter.value**2 / 4.0
    return ForceLine(per_pascal, ratio * v.spring_force.value)


def clamping(line: ForceLine, p: Any) -> Any:
    """K [N] at the cylinder pressure p [Pa], a number or an array. Source: (15)."""
    return np.maximum(line.per_pascal * p - line.at_zero, 0.0)  # (15)


def cylinder_pressure(line: ForceLine, K: Any) -> Any:
    """The inverse of `clamping` for K > 0: p [Pa]. Source: (15)."""
    return (K + line.at_zero) / line.per_pascal  # (15)


def slip(train_speed: Floats, wheel_speed: Floats, radius: float, slowest: float) -> Floats:
    """Slip s [-] from v [m/s] and ω [rad/s], shape (n,); NaN below `slowest` [m/s]. Source: (2)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (train_speed - wheel_speed * radius) / train_speed  # (2)
    return np.where(train_speed >= slowest, s, np.nan)


def braked(K: Any, w: Wheelset) -> Any:
    """Deceleration [m/s²] that the clamping force makes of a wheel that rolls. Source: (1)."""
    return rolling_deceleration(w) * w.radius * K


def reference_speed(before: float, fastest: float, braking: float, h: float) -> float:
    """Train speed made of the axles, one step on, as slide protection makes it [m/s].

    The fastest axle is the train, which slows no harder than all brakes together and a gradient can
    make it: where every axle does, all slide, and the speed goes on at that limit.

    Args:
        before: the same at the step before [m/s].
        fastest: largest rim speed of all axles [m/s].
        braking: what `braked` gives of the axles' clamping force [m/s²].
        h: interval [s].
    """
    slowest = before - (HARDER * braking + GRADIENT) * h
    return max(min(max(fastest, slowest), before + RISE * h), 0.0)


def coefficient(force: Floats, vehicle: Vehicle) -> Floats:
    """Adhesion coefficient μ = F/(m g) [-], shape (n,). Source: [S1]."""
    return force / (vehicle.axle_mass.value * G)


def pressed(record: AxleRecord, application: slice) -> tuple[slice, bool]:
    """The samples of an application until its pressure is gone, and whether that is in the log.

    An application ends where the wheel stands, as (1) says nothing of it; its pressure does not.
    """
    K, last = record.clamping_force, application.stop - 1
    past = next(s.stop for s in record.segments if s.start <= last < s.stop)
    gone = np.flatnonzero(K[last:past] <= _GONE * np.nanmax(K[application]))
    return slice(application.start, last + int(gone[0]) + 1 if len(gone) else past), len(gone) > 0


def standing(record: AxleRecord) -> Bools:
    """Where the wheel stands, and does not merely pass through zero; shape (n,).

    (1) does not hold there: the brake's friction is anything up to φK.
    """
    still = np.abs(record.wheel_speed) <= max(_CRAWL, record.wheel_speed_step / 2.0)
    found = np.zeros(len(record), dtype=bool)
    for s in record.segments:
        for first, past in true_runs(still[s]):
            first, past = s.start + first, s.start + past
            found[first:past] = (record.t[past - 1] - record.t[first]) * 1e-9 >= _STOP
    return found


def moving(record: AxleRecord) -> list[slice]:
    """The segments without the times in which the wheel stands."""
    moves = ~standing(record)
    return [
        slice(s.start + first, s.start + past)
        for s in record.segments
        for first, past in true_runs(moves[s])
    ]


def driven(record: AxleRecord, radius: float) -> Bools:
    """Where the wheel, of this radius [m], gains speed without brake as only a motor makes it.

    Harder than on a gradient, longer than it recovers from a slide, and not behind the train; shape
    (n,). The motor's torque is not in (1).
    """
    found = np.zeros(len(record), dtype=bool)
    free = (record.clamping_force <= 0.0) & (record.clamping_force_smooth <= 0.0)
    for s in record.segments:
        t = (record.t[s] - record.t[s.start]) * 1e-9
        rim = record.wheel_speed[s] * radius
        for first, past in true_runs(free[s]):
            own, rolls = t[first:past], rim[first:past]
            before, after = np.maximum(own - 1.0, own[0]), np.minimum(own + 1.0, own[-1])
            gained = np.interp(after, own, rolls) - np.interp(before, own, rolls)
            gains = gained > GRADIENT * (after - before)
            gains &= (gained < RISE * (after - before)) & (after - before >= 1.0)
            if record.train_speed is not None:
                gains &= ~(rolls < 0.95 * record.train_speed[s][first:past])
            for a, b in true_runs(gains):
                if own[b - 1] - own[a] >= _DRIVEN:
                    near = (own >= own[a] - 1.0) & (own <= own[b - 1] + 1.0)
                    found[s.start + first : s.start + past] |= near
    return found


def true_runs(mask: Bools) -> list[tuple[int, int]]:
    """First and past-the-last index of each run of True in a mask of shape (n,)."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def white_noise(runs: Iterable[tuple[Floats | Times, Floats]]) -> float:
    """Variance of the white noise on smooth signals; 0 where too short.

    Mean square departure from the straight line through both neighbours, in blocks of 50; the
    median block, so that edges in less than half of them do not count.

    Args:
        runs: times, rising strictly, and values of each run, shape (n,).
    """
    blocks = []
    for t, x in runs:
        share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])  # of the later neighbour
        off = x[1:-1] - (1.0 - share) * x[:-2] - share * x[2:]
        square = off**2 / (1.0 + share**2 + (1.0 - share) ** 2)
        blocks += [float(np.mean(square[i : i + 50])) for i in range(0, len(square), 50)]
    return float(np.median(blocks)) if blocks else 0.0
