"""Samples that a working sensor cannot give are left out, one kind of fault after the other.

Every step takes channels and returns channels and findings. The later steps judge a channel by
others, so they come after those that judge it alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core import time_axis
from ..core.finding import Finding
from ..core.model import Bools, Channel, Floats, Meaning, Vehicle
from ..core.physics import clamping_force
from . import outliers, sample_and_hold, stuck_pressure, stuck_speed
from .choose import AxleKeys, Channels, Choice, Key
from .faults import Fault, View, remove_samples
from .outliers import Params as Outliers
from .stuck_pressure import Params as StuckPressure
from .stuck_speed import Params as StuckSpeed

_BACKWARDS = 1.0  # speed that no noise around standstill reaches [rad/s, of the train m/s]
_BRAKES: tuple[Meaning, ...] = ("pressure", "clamping_force")
_WHEEL: tuple[Meaning, ...] = ("wheel_speed",)
_TRAIN: tuple[Meaning, ...] = ("train_speed",)


class Thresholds(NamedTuple):
    """Parameters of the checks, by the name of the file that holds each."""

    outliers: Outliers = Outliers()
    stuck_speed: StuckSpeed = StuckSpeed()
    stuck_pressure: StuckPressure = StuckPressure()


DEFAULT = Thresholds()


class Screened(NamedTuple):
    """The channels without what was left out; a channel without any sample left is not in it."""

    channels: Channels
    ranges: dict[Key, float]  # where the range of a saturated sensor ends [Pa or N]
    findings: list[Finding]


Judge = Callable[[Key, Channel], list[Fault]]


def screen(choice: Choice, vehicle: Vehicle, view: View, p: Thresholds) -> Screened:
    """The channels that records are made of.

    Args:
        choice: of the log.
        vehicle: for the force line.
        view: findings are of its window only.
        p: thresholds of the checks.
    """
    channels, findings = _remove_repeats(choice.channels, view)

    def judged(channels: Channels, meanings: Sequence[Meaning], judge: Judge) -> Channels:
        """The channels without the faults of those with some meanings, which are reported."""
        sound = {}
        for key, c in channels.items():
            excluded = np.zeros(len(c.data.t), dtype=np.bool_)
            for fault in judge(key, c) if key[0] in meanings else []:
                findings.extend(view.report(fault, c))
                excluded |= fault.mask & fault.excluded
            if not excluded.all():
                sound[key] = remove_samples(c, excluded)
        return sound

    channels = judged(channels, _BRAKES, lambda _, c: outliers.brake_faults(p.outliers, c))
    channels = judged(channels, _WHEEL, lambda _, c: outliers.wheel_faults(p.outliers, c))
    channels = judged(channels, _TRAIN, lambda _, c: outliers.train_faults(p.outliers, c))
    reverse = any(runs_backwards(c).any() for c in _channels_of(channels, "wheel_speed"))
    sign = "reverse-running" if reverse else "train-speed-sign"
    channels = judged(
        channels,
        _WHEEL if reverse else _TRAIN,
        lambda _, c: [Fault(sign, runs_backwards(c), False, "info")],
    )
    channels = {k: _unsigned(c) if "speed" in k[0] else c for k, c in channels.items()}
    wheels = _channels_of(channels, "wheel_speed")
    channels = judged(
        channels, _TRAIN, lambda _, c: stuck_speed.train_faults(p.stuck_speed, c, wheels)
    )
    ranges: dict[Key, float] = {}
    channels = judged(channels, _BRAKES, lambda key, c: _stuck_brake(p, channels, key, c, ranges))
    forces = {a.speed: a for a in reversed(choice.axles)}
    channels = judged(
        channels, _WHEEL, lambda key, c: _stuck_wheel(p, channels, key, c, forces, vehicle)
    )
    return Screened(channels, ranges, findings)


def _remove_repeats(channels: Channels, view: View) -> tuple[Channels, list[Finding]]:
    """The channels as they were measured: what a table repeats is no measurement."""
    measured, findings = {}, []
    for key, c in channels.items():
        measured[key] = c
        of_speed = key[0] in ("wheel_speed", "train_speed")
        interval = sample_and_hold.interval(c) if of_speed or key[0] in _BRAKES else 0.0
        if interval:
            measured[key] = sample_and_hold.readings(c, interval)
            start, stop = view.seconds(c.data.t[[0, -1]])
            repeats = len(c.data.t) - len(measured[key].data.t)
            findings.append(
                Finding(
                    "speed-repeated" if of_speed else "pressure-repeated",
                    "info",
                    channel=c.title,
                    count=repeats,
                    spans=((float(start), float(stop)),),
                    values={"interval_s": interval},
                )
            )
    return measured, findings


def runs_backwards(speed: Channel) -> Bools:
    """Samples of a speed that say the train runs backwards, shape (n,)."""
    reversed_samples: Bools = speed.data.value < -max(_BACKWARDS, speed.step)
    return reversed_samples


def _unsigned(speed: Channel) -> Channel:
    """A speed without its sign where it says that the train runs backwards."""
    if not runs_backwards(speed).any():
        return speed
    return replace(speed, data=replace(speed.data, value=np.abs(speed.data.value)))


def _stuck_brake(
    p: Thresholds, channels: Channels, key: Key, c: Channel, ranges: dict[Key, float]
) -> list[Fault]:
    faults = stuck_pressure.brake_faults(p.stuck_pressure, c, _channels_of(channels, key[0], key))
    if any(f.code == "pressure-saturated" and f.mask.any() for f in faults):
        ranges[key] = float(c.data.value.max())
    return faults


def _stuck_wheel(
    p: Thresholds,
    channels: Channels,
    key: Key,
    c: Channel,
    axles: dict[Key, AxleKeys],
    vehicle: Vehicle,
) -> list[Fault]:
    if key not in axles or not (brake := channels.get(axles[key].brake)):
        return []
    other_speeds = [
        *_channels_of(channels, "wheel_speed", key),
        *_channels_of(channels, "train_speed"),
    ]
    force = _held_force(c, brake, vehicle.of_axle(axles[key].axle))
    return stuck_speed.wheel_faults(p.stuck_speed, c, force, other_speeds)


def _held_force(speed: Channel, brake: Channel, vehicle: Vehicle) -> Floats:
    """K at the times of a wheel speed, by the last sample of the brake, shape (n,) [N]."""
    last_value = np.concatenate(
        [time_axis.hold_last(instants, brake)[0] for instants in time_axis.instants_of(speed)]
    )
    return clamping_force(last_value, vehicle) if brake.meaning == "pressure" else last_value


def _channels_of(channels: Channels, meaning: Meaning, but: Key | None = None) -> list[Channel]:
    return [c for k, c in channels.items() if k[0] == meaning and k != but]
