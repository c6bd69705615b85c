"""The force of motors: whether it acts at all, and its sign, by what the train does."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.finding import Finding
from ..core.model import MOTOR_FORCES, Channel, Vehicle
from ..core.signals import in_order
from .choose import Channels

_IDLE = 0.05  # deceleration of an axle by motors, in the mean of a second, of none [m/s²]
_STEP = 0.5  # of the times at which they are compared [s]
_LARGE_SHARE = 0.3  # of the largest force: less says little
_FEWEST = 4  # samples that say something
_CLEAR_RATE = 0.1  # of a rim, with the wrong sign, that no gradient explains [m/s²]


def judge_motor_forces(channels: Channels, vehicle: Vehicle) -> tuple[Channels, list[Finding]]:
    """The channels without ED brakes that are off, and with the signs that the train shows."""
    acting, idle_findings = _without_idle(channels, vehicle)
    signed, sign_findings = _with_signs(acting, vehicle)
    return signed, idle_findings + sign_findings


def _without_idle(channels: Channels, vehicle: Vehicle) -> tuple[Channels, list[Finding]]:
    """The channels without the ED forces of a brake that is off: they show noise and an offset.

    Where the brake of other axles acts, the force of an idle one is zero.
    """
    forces = {key: c for key, c in channels.items() if key[0] == MOTOR_FORCES[0]}
    highest = {key: _highest_mean(c) for key, c in forces.items()}
    limit = {key: _IDLE * vehicle.of_axle(key[1] or 1).axle_mass.value for key in forces}
    idle = [key for key in forces if highest[key] < limit[key]]
    if not idle:
        return channels, []
    titles = ", ".join(dict.fromkeys(forces[key].title for key in idle))
    values = {"highest_kn": max(highest[key] for key in idle) / 1e3}
    acting = {key: c for key, c in channels.items() if key not in idle}
    if len(idle) < len(forces):
        for key in idle:
            data = replace(forces[key].data, value=np.zeros_like(forces[key].data.value))
            acting[key] = replace(forces[key], data=data)
    return acting, [Finding("motor-force-idle", "info", channel=titles, values=values)]


def _highest_mean(force: Channel) -> float:
    """The highest force, in the mean of a second [N]."""
    finite = np.isfinite(force.data.value)
    t, value = force.data.t[finite], force.data.value[finite]
    _, second, counts = np.unique(t // 10**9, return_inverse=True, return_counts=True)
    sums = np.bincount(second, weights=value)
    return float(np.max(np.abs(sums / counts), initial=0.0))


def _with_signs(channels: Channels, vehicle: Vehicle) -> tuple[Channels, list[Finding]]:
    """The channels with ED forces that brake above zero, and traction forces that drive."""
    signed, findings = dict(channels), list[Finding]()
    speeds = {key[1]: c for key, c in channels.items() if key[0] == "wheel_speed"}
    for meaning, sign in zip(MOTOR_FORCES, (-1.0, 1.0), strict=True):
        forces = {key: c for key, c in channels.items() if key[0] == meaning}
        rates = [x for key, c in forces.items() for x in _rates(key[1], c, speeds, vehicle)]
        if len(rates) < _FEWEST or sign * float(np.mean(rates)) > -_CLEAR_RATE:
            continue
        for key, c in forces.items():
            signed[key] = replace(c, data=replace(c.data, value=-c.data.value))
        titles = ", ".join(dict.fromkeys(c.title for c in forces.values()))
        names = {"force": "ED force" if meaning == MOTOR_FORCES[0] else "Traction force"}
        findings.append(Finding("motor-force-sign", "warning", channel=titles, names=names))
    return signed, findings


def _rates(
    axle: int | None, force: Channel, speeds: Mapping[int | None, Channel], vehicle: Vehicle
) -> Sequence[float]:
    """Accelerations of a rim, times the sign of the force, where that is large [m/s²].

    The force of all axles is compared with the first of the wheel speeds.
    """
    speed = speeds.get(axle) or speeds.get(None)
    if speed is None and axle is None:
        speed = next(iter(speeds.values()), None)
    if speed is None or len(speed.data.t) < _FEWEST:
        return []
    columns = [in_order(c.data.t, c.data.value) for c in (speed, force)]
    start, stop = max(t[0] for t, _ in columns), min(t[-1] for t, _ in columns)
    t = np.arange(start, max(stop, start), int(_STEP * 1e9), dtype=np.float64)
    y, F = (np.interp(t, *column) for column in columns)
    rim, F = vehicle.radius(speed.axle or 1).value * y, F[1:-1]
    large = np.abs(F) > _LARGE_SHARE * float(np.max(np.abs(F), initial=0.0))
    moving = np.min([rim[2:], rim[:-2]], axis=0) > 1.0
    rate = (rim[2:] - rim[:-2]) / (2.0 * _STEP)
    rates: list[float] = (np.sign(F) * rate)[large & moving].tolist()
    return rates
