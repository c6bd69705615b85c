"""Speeds below zero: the train runs backwards, or the sign of its own speed is wrong."""

from dataclasses import replace

import numpy as np

from ..core.model import Bools, Channel
from .choose import Channels, Key
from .faults import Fault

_BACKWARDS = 1.0  # speed that no noise around standstill reaches [rad/s, of the train m/s]


def find_faults(channels: Channels) -> dict[Key, list[Fault]]:
    """Where speeds are below zero: the wheels', or else the sign of the train speed."""
    reverse = any(_runs_backwards(c).any() for k, c in channels.items() if k[0] == "wheel_speed")
    code, meaning = (
        ("reverse-running", "wheel_speed") if reverse else ("train-speed-sign", "train_speed")
    )
    return {
        key: [Fault(code, _runs_backwards(c), False, "info")]
        for key, c in channels.items()
        if key[0] == meaning
    }


def _runs_backwards(speed: Channel) -> Bools:
    """Samples of a speed that say the train runs backwards, shape (n,)."""
    return speed.data.value < -max(_BACKWARDS, speed.step)


def unsigned(speed: Channel) -> Channel:
    """A speed without its sign where it says that the train runs backwards."""
    if not _runs_backwards(speed).any():
        return speed
    return replace(speed, data=replace(speed.data, value=np.abs(speed.data.value)))
