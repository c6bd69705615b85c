"""The gradient of the line, as stated or logged, at every time of a log.

A gradient i (uphill positive) slows a train that rolls by g i / (1 + ρ), with the rotating mass ρ
as a share of its mass. The longitudinal model takes that from the deceleration. The brake force of
an axle follows from its own pressure and speed: no gradient changes it.
"""

from typing import NamedTuple

import numpy as np

from ..core.model import Channel, Column, Floats, Log, Times, Track

_DIRECTION_WINDOW = 2.5e9  # before and after: where the train goes [ns]


class Gradient(NamedTuple):
    """The gradient of a log."""

    t: Times  # (n,) [ns]
    value: Floats  # uphill positive, (n,) [-]
    sigma: float  # 1 sigma [-]

    def at(self, t: Times) -> Floats:
        """The gradient at these times, (m,) [-]."""
        return np.interp(t, self.t, self.value)


def find_gradient(log: Log, track: Track) -> Gradient | None:
    """The gradient of a log; None where nobody knows it.

    A stated constant or profile counts more than a channel of the log.
    """
    sigma = track.gradient.tolerance
    if track.profile:
        position = position_channel(log, track)
        return _along_profile(position.data, track.profile, sigma) if position else None
    if track.stated:
        return Gradient(np.zeros(1, np.int64), np.full(1, track.gradient.value), sigma)
    logged = _named(log, "gradient")
    if logged is None:
        return None
    t, value, valid = logged.data.t, logged.data.value, logged.data.valid
    return Gradient(t[valid], value[valid], sigma) if valid.any() else None


def position_channel(log: Log, track: Track) -> Channel | None:
    """The channel that says where the train is: by its name, else by its meaning."""
    named = [c for c in log.channels if track.position in (c.name, c.title) and c.meaning]
    return named[0] if named else _named(log, "position") or _named(log, "distance")


def _named(log: Log, meaning: str) -> Channel | None:
    return next((c for c in log.channels if c.meaning == meaning and len(c.data.t)), None)


def _along_profile(
    position: Column, profile: tuple[tuple[float, float], ...], sigma: float
) -> Gradient:
    """The profile at the train's places; the sign changes where it goes towards lower ones."""
    t, x = position.t[position.valid], position.value[position.valid]
    if not len(t):
        t, x = np.zeros(1, np.int64), np.full(1, profile[0][0])
    starts, values = np.array(profile).T
    place = np.clip(np.searchsorted(starts, x, side="right") - 1, 0, len(starts) - 1)
    later_place, earlier_place = (
        np.interp(t + shift, t, x) for shift in (_DIRECTION_WINDOW, -_DIRECTION_WINDOW)
    )
    return Gradient(t, values[place] * np.sign(later_place - earlier_place), sigma)
