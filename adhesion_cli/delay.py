"""How late a pressure is against the wheel speed, by the brake's build-ups and releases.

Valve, hose, transducer and filter delay a pressure, averaging delays a speed; clocks differ. While
the wheel rolls, (1) says ω̇ = −cK, of a pressure that is late by τ

    ω(t) = α + βt − c ∫K dt − cτ K(t)

to first order, α and β for speed and gradient. Each change of K gives τ by least squares, with its
error; what follows another law (a slide) has a large one.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from .model import AxleRecord, Floats, Times, Wheelset
from .physics import rolling_deceleration
from .signals import true_runs

_REACH = 0.3  # a larger delay is for the check of clocks [s]
_CHANGE = 0.3  # of the highest K within a second: a build-up, a release
_AROUND = 1.0  # before and after it [s]
_LONGEST = 12.0  # a slower change tells no delay [s]
_LEAST = 12  # samples around a change
_MOST = 40  # changes that are looked at
_SURE = 4.0  # by how many sigma it must differ from 0
_SHARE = 0.75  # of the longer sampling interval: less may be the sampling's own
_SMALL = 0.03  # wheels and rails delay a force by as much [s]
_OTHER = 2.0  # times as hard as stated: another vehicle, more is a slide


class _Told(NamedTuple):
    """What one change says."""

    late: float  # [s]
    sigma: float  # [s]


def found(runs: Sequence[AxleRecord], w: Wheelset) -> float:
    """By how much the pressure is behind the wheel speed [s], negative ahead; 0 where not sure.

    Args:
        runs: uninterrupted records of one axle, its wheel turning.
        w: the constants of (1).
    """
    top = max((float(r.clamping_force_smooth.max()) for r in runs), default=0.0)
    changes = [(r, s) for r in runs for s in _changes(r, top)]
    some = changes[:: max(1, len(changes) // _MOST)]
    told = [one for r, s in some if (one := _told(r.cut(s), w))]
    if len(told) < 2:
        return 0.0
    late, sigma = np.array(told).T
    weight = 1.0 / sigma**2
    mean = float(np.average(late, weights=weight))
    spread = float(np.sum(weight * (late - mean) ** 2)) / (len(told) - 1)
    error = math.sqrt(max(spread, 1.0) / np.sum(weight))
    least = max(_SMALL, _SHARE * max(_interval(r) for r, _ in some), _SURE * error)
    return mean if least < abs(mean) < _REACH else 0.0


def missed(t: Times, K: Floats, late: float) -> Floats:
    """How far K [N] is off at the times t [ns] where it is that late [s]; shape (n,)."""
    since = (t - t[0]) * 1e-9
    off: Floats = np.abs(np.interp(since + late, since, K) - K)
    return off


def _interval(run: AxleRecord) -> float:
    """The longer of both channels' usual intervals [s]."""
    t = run.t * 1e-9
    own = np.flatnonzero(np.diff(run.clamping_force) != 0.0)
    speed, pressure = np.diff(t), np.diff(t[own])
    return max(float(np.median(speed)), float(np.median(pressure)) if len(pressure) else 0.0)


def _changes(run: AxleRecord, top: float) -> Iterator[slice]:
    """Where K changes, with what is around."""
    t, K = (run.t - run.t[0]) * 1e-9, run.clamping_force_smooth
    moves = np.abs(np.interp(t + 0.5, t, K) - np.interp(t - 0.5, t, K)) > _CHANGE * top
    for first, past in true_runs(moves):
        edges = np.searchsorted(t, [t[first] - _AROUND, t[past - 1] + _AROUND])
        if t[past - 1] - t[first] < _LONGEST and edges[1] - edges[0] >= _LEAST:
            yield slice(int(edges[0]), int(edges[1]))


def _told(run: AxleRecord, w: Wheelset) -> _Told | None:
    """None where the wheel does not slow with K about as one that rolls."""
    t, y = (run.t - run.t[0]) * 1e-9, run.wheel_speed
    late = 0.0
    for _ in range(3):
        K = np.interp(t + late, t, run.clamping_force_smooth)
        G = np.concatenate([[0.0], np.cumsum(np.diff(t) * (K[1:] + K[:-1]) / 2.0)])
        X = np.stack([np.ones(len(t)), t, G, K])
        largest = np.abs(X).max(axis=1)
        X /= largest[:, None]
        scale = float(largest[2] / largest[3])
        inverse = np.linalg.pinv(X @ X.T)
        fitted = inverse @ X @ y
        if not 1.0 / _OTHER < -fitted[2] / largest[2] / rolling_deceleration(w) < _OTHER:
            return None
        ratio = fitted[3] / fitted[2]
        late = float(np.clip(late + ratio * scale, -2.0 * _REACH, 2.0 * _REACH))
    off = y - fitted @ X
    # What is left goes on for several samples: fewer tell.
    alike = float(np.clip(off[1:] @ off[:-1] / max(float(off @ off), 1e-300), 0.0, 0.99))
    variance = off @ off / (len(t) - 4) * (1.0 + alike) / (1.0 - alike)
    slope = np.array([0.0, 0.0, -ratio, 1.0]) / fitted[2]
    sigma = scale * math.sqrt(max(float(variance * (slope @ inverse @ slope)), 1e-12))
    return _Told(late, sigma)
