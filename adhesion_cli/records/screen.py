"""Samples that a working sensor cannot give are left out, one kind of fault after the other.

Every step takes channels and returns channels and findings. The later steps judge a channel by
others, so they come after those that judge it alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core.finding import Finding
from ..core.model import Bools, Channel
from . import outliers, sample_and_hold, stuck_pressure, stuck_speed
from .choose import BRAKES, Channels, Choice, Key
from .faults import Fault, View, remove_samples, runs
from .outliers import Params as Outliers
from .stuck_pressure import Params as StuckPressure
from .stuck_speed import Params as StuckSpeed

_BACKWARDS = 1.0  # speed that no noise around standstill reaches [rad/s, of the train m/s]


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


def screen(choice: Choice, view: View, p: Thresholds) -> Screened:
    """The channels that records are made of."""
    channels, findings = sample_and_hold.remove_repeats(choice.channels, view)

    def remove_faults(faults: Mapping[Key, Sequence[Fault]]) -> Channels:
        """The channels without their faults, which are reported."""
        sound = dict(channels)
        for key, of_channel in faults.items():
            c = sound.pop(key)
            excluded = np.zeros(len(c.data.t), dtype=np.bool_)
            for fault in of_channel:
                findings.extend(view.report(fault, c))
                excluded |= fault.mask & fault.excluded
            if not excluded.all():
                sound[key] = remove_samples(c, excluded)
        return {key: sound[key] for key in channels if key in sound}

    channels = remove_faults(outliers.find_outliers(p.outliers, channels))
    channels = remove_faults(_find_signs(channels))
    channels = {k: _unsigned(c) if "speed" in k[0] else c for k, c in channels.items()}
    repeats = {k: runs(c) for k, c in channels.items() if "speed" in k[0] or k[0] in BRAKES}
    brake_faults = stuck_pressure.find_brake_faults(p.stuck_pressure, channels, repeats)
    ranges = {
        key: float(channels[key].data.value.max())
        for key, faults in brake_faults.items()
        if any(f.code == "pressure-saturated" and f.mask.any() for f in faults)
    }
    channels = remove_faults(brake_faults)
    channels = remove_faults(stuck_speed.find_train_faults(p.stuck_speed, channels, repeats))
    wheel_faults = stuck_speed.find_wheel_faults(p.stuck_speed, channels, repeats, choice.axles)
    return Screened(remove_faults(wheel_faults), ranges, findings)


def _find_signs(channels: Channels) -> dict[Key, list[Fault]]:
    """Where speeds are below zero: the wheels', or else the sign of the train speed."""
    reverse = any(_runs_backwards(c).any() for k, c in channels.items() if k[0] == "wheel_speed")
    meaning, code = "train_speed", "train-speed-sign"
    if reverse:
        meaning, code = "wheel_speed", "reverse-running"
    judged = {key: _runs_backwards(c) for key, c in channels.items() if key[0] == meaning}
    return {key: [Fault(code, mask, False, "info")] for key, mask in judged.items()}


def _runs_backwards(speed: Channel) -> Bools:
    """Samples of a speed that say the train runs backwards, shape (n,)."""
    return speed.data.value < -max(_BACKWARDS, speed.step)


def _unsigned(speed: Channel) -> Channel:
    """A speed without its sign where it says that the train runs backwards."""
    if not _runs_backwards(speed).any():
        return speed
    return replace(speed, data=replace(speed.data, value=np.abs(speed.data.value)))
