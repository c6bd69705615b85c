"""The train's speed from the acceleration of its body, where no speed is logged.

An accelerometer along the track reads a = ±dv/dt, plus slow errors: its own zero, its tilt and the
gradient. Together they are b, so

    v(t) = v0 + ∫ ±a dt − ∫ b dt.

Where wheels roll, v is theirs. There v0 and b are estimated, and between they are carried on. b is
a random walk: the gradient changes on the way, the body pitches with a, and the gain has an error.
A Kalman filter of (v, b) and its smoother estimate both on an even grid. The sigma of v grows with
the time since wheels rolled, and with the noise of a.

Wheels roll where no brake is on, nor was just before, and where they do not catch up. The train
stands where all wheels stand, if v and b so far agree with that: locked wheels stand, too. Braked
wheels are not used. They may creep by a percent or two for as long as the brake is on, and b would
absorb that.

Sources: Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445.
"""

import math
from typing import NamedTuple

import numpy as np

from ..core import compiled
from ..core.model import Bools, Channel, Floats, Times
from ..core.physics import CRAWL, FREE
from ..core.signals import finite_median, true_runs, white_noise
from .grid import LEAST, Grid, far

FINE = 0.1  # step of the grid [s]
_STANDS = 0.05  # of a wheel that stands [m/s]
_SETTLED = 0.5  # after a stop the body still swings, after a brake its wheel still slides [s]
_CATCHES_UP = 1.0  # a wheel that gains more than any bias rolls not yet [m/s²]
_BIAS = 0.5  # 1 sigma of b: tilt, zero, a gradient of 3 % [m/s²]
_DRIFT = 0.02  # b's walk: a gradient that changes by 1 % in 25 s [m/s² per √s]
_LOST = 1.0  # 1 sigma of a in a gap of it, per √s [m/s²]
_PITCH = 0.03  # share of a change of a by which b changes: gain, pitch
_WHEEL = 0.02  # 1 sigma of a wheel's speed that lasts for `_ALIKE`, without noise [m/s]
_ALIKE = 1.0  # [s]
_CREEP = 0.004  # 1 sigma of the creep of a wheel that a motor drives, at 1 m/s² [s²/m]
_GATE = 12.0  # χ² of two errors, in v and b, beyond which it is not the train that stands
_SLOWS = 0.05, 3.0  # a brake makes of a what lies between, or it is not the train's [m/s²]
_USELESS = 3.0  # no speed is known with a larger sigma [m/s]
LATE = 0.05  # 1 sigma delay of an accelerometer by its filter [s]
_UNKNOWN = 100.0  # 1 sigma of a speed before anything is known [m/s]


class Integrated(NamedTuple):
    """The train's speed by its acceleration; shape (n,)."""

    t: Floats  # even, after `first` [s]
    first: int  # [ns]
    beside: Floats  # v − ∫ ±a dt [m/s]
    sigma: Floats  # 1 sigma of v [m/s]
    bias: Floats  # b [m/s²]
    own: Floats  # times of the accelerometer's samples, after `first` (m,) [s]
    gained: Floats  # ∫ ±a dt at them (m,) [m/s]
    sign: int  # of the axis: 1 where it reads a braked train below zero
    anchored: float  # time in which wheels give the speed [s]

    def at(self, t: Times) -> tuple[Floats, Floats]:
        """Speed and its 1 sigma at these times, shape (m,) [m/s]; NaN where nothing was read."""
        since = (t - self.first) * 1e-9
        v = np.interp(since, self.own, self.gained) + np.interp(since, self.t, self.beside)
        sigma = np.interp(since, self.t, self.sigma)
        inside = (since >= self.own[0]) & (since <= self.own[-1]) & (sigma < _USELESS)
        return np.where(inside, np.maximum(v, 0.0), np.nan), np.where(inside, sigma, np.nan)


class _Samples(NamedTuple):
    """What the filter takes, on the grid."""

    h: float  # step [s]
    gained: Floats  # ∫ ±a dt of the step before (n,) [m/s]
    walk: Floats  # variance of v that it adds (n,) [m²/s²]
    drift: Floats  # and of b (n,) [m²/s⁴]
    rim: Floats  # of wheels that roll surely, else NaN (k, n) [m/s]
    variance: Floats  # of that (k, n)
    stands: Bools  # where every wheel does (n,)
    level: Floats  # mean of a there (n,) [m/s²]


def _filter(s: _Samples, known: Floats) -> None:
    """Kalman's filter.

    `known` (n, 10) is filled: v, b, P_vv, P_vb, P_bb before the wheels of a step were heard, and
    after.
    """
    k, n = s.rim.shape
    v, b, Pvv, Pvb, Pbb = 0.0, 0.0, _UNKNOWN**2, 0.0, _BIAS**2
    train_stands = False
    for j in range(n):
        if j > 0:
            v += s.gained[j] - s.h * b
            Pvv += s.h * s.h * Pbb - 2.0 * s.h * Pvb + s.walk[j]
            Pvb -= s.h * Pbb
            Pbb += s.drift[j]
        known[j, 0], known[j, 1], known[j, 2], known[j, 3], known[j, 4] = v, b, Pvv, Pvb, Pbb
        if not s.stands[j]:
            train_stands = False
        elif j == 0 or not s.stands[j - 1]:  # both v = 0 and b = a must be likely
            rest, S, T = s.level[j] - b, Pvv + _WHEEL**2, Pbb + _PITCH**2 + s.walk[j] / s.h
            far_off = v * v * T + 2.0 * v * rest * Pvb + rest * rest * S
            train_stands = far_off < _GATE * (S * T - Pvb * Pvb)
        for i in range(k + 1):
            rim, R = 0.0, _WHEEL**2 * _ALIKE / s.h
            if i < k:
                rim, R = s.rim[i, j], s.variance[i, j]
                if math.isnan(rim):
                    continue
            elif not train_stands:
                continue
            S, off = Pvv + R, rim - v
            Gv, Gb = Pvv / S, Pvb / S
            v, b = v + Gv * off, b + Gb * off
            Pbb -= Gb * Pvb
            Pvb -= Gv * Pvb
            Pvv -= Gv * Pvv
        known[j, 5], known[j, 6], known[j, 7], known[j, 8], known[j, 9] = v, b, Pvv, Pvb, Pbb


def _smooth(s: _Samples, known: Floats, out: Floats) -> None:
    """Rauch, Tung and Striebel's pass back; fills `out` (n, 3): v, b, P_vv."""
    n, h = len(known), s.h
    v, b, Svv, Svb, Sbb = known[n - 1, 5:]
    out[n - 1, 0], out[n - 1, 1], out[n - 1, 2] = v, b, Svv
    for j in range(n - 2, -1, -1):
        fv, fb, Fvv, Fvb, Fbb = known[j, 5:]
        pv, pb, Pvv, Pvb, Pbb = known[j + 1, :5]
        det = Pvv * Pbb - Pvb * Pvb
        c0, c1 = Fvv - h * Fvb, Fvb - h * Fbb  # covariance with the predicted speed
        Gvv, Gvb = (c0 * Pbb - Fvb * Pvb) / det, (Fvb * Pvv - c0 * Pvb) / det
        Gbv, Gbb = (c1 * Pbb - Fbb * Pvb) / det, (Fbb * Pvv - c1 * Pvb) / det
        ev, eb = v - pv, b - pb
        Dvv, Dvb, Dbb = Svv - Pvv, Svb - Pvb, Sbb - Pbb
        v, b = fv + Gvv * ev + Gvb * eb, fb + Gbv * ev + Gbb * eb
        Svv = Fvv + Gvv * Gvv * Dvv + 2.0 * Gvv * Gvb * Dvb + Gvb * Gvb * Dbb
        Svb = Fvb + Gvv * Gbv * Dvv + (Gvv * Gbb + Gvb * Gbv) * Dvb + Gvb * Gbb * Dbb
        Sbb = Fbb + Gbv * Gbv * Dvv + 2.0 * Gbv * Gbb * Dvb + Gbb * Gbb * Dbb
        out[j, 0], out[j, 1], out[j, 2] = v, b, Svv


def integrated(g: Grid, a: Channel) -> Integrated | str:
    """The train's speed, or why there is none.

    Args:
        g: all axles, without a train speed.
        a: the train's acceleration [m/s²], in any sign.
    """
    n = g.rim.shape[1]
    t: Floats = g.step * np.arange(n, dtype=np.float64)
    own: Floats = np.multiply(a.data.t - g.first, 1e-9)
    every, x = np.diff(own), a.data.value
    if len(own) < LEAST or (every <= 0.0).any():
        return "its clock jumps back"
    area: Floats = np.concatenate([[0.0], np.cumsum((x[1:] + x[:-1]) / 2.0 * every)])
    settled = round(_SETTLED / g.step)
    least = FREE * float(np.nanmax(g.clamping, initial=0.0))
    free = far(g.clamping <= least, settled)
    stands = far(np.all(g.rim < _STANDS, axis=0), settled)
    total: Floats = np.interp(t, own, area)
    sign = _sign(g, total, free, stands)
    if not sign:
        return "it does not show the brake slow the train"
    total *= sign
    s = _samples(g, total, a, free, stands)
    held = np.isfinite(s.rim).any(axis=0) | s.stands
    if not held.any():
        return "no wheel surely rolls: the brake is on all the time, and the train does not stand"
    known, out = np.empty((n, 10)), np.empty((n, 3))
    compiled.function(_filter)(s, known)
    compiled.function(_smooth)(s, known, out)
    v, b, variance = out.T
    return Integrated(
        t, g.first, v - total, np.sqrt(variance), b, own, sign * area, sign,
        g.step * float(held.sum()),
    )  # fmt: skip


def _sign(g: Grid, total: Floats, free: Bools, stands: Bools) -> int:
    """Of the axis, by ∫ a dt: a brake slows the train; 0 where what is read does not show that."""
    mean = g.slope(total)
    known = np.isfinite(mean)
    braked = far(np.all(g.clamping > 0.0, axis=0), g.half) & ~stands & known
    other = (free.all(axis=0) | stands) & known
    if min(braked.sum(), other.sum()) < 2:
        return 0
    change = float(np.mean(mean[braked]) - np.mean(mean[other]))
    return -int(math.copysign(1, change)) if _SLOWS[0] < abs(change) < _SLOWS[1] else 0


def _samples(g: Grid, total: Floats, a: Channel, free: Bools, stands: Bools) -> _Samples:
    """What the filter takes.

    Args:
        g: all axles.
        total: ∫ ±a dt on it [m/s].
        a: the acceleration.
        free: which wheels are not braked, nor just before (k, n).
        stands: where all of them do, for a while (n,).
    """
    h, n = g.step, len(total)
    t: Floats = h * np.arange(n, dtype=np.float64)
    own: Floats = np.multiply(a.data.t - g.first, 1e-9)
    gained = np.diff(total, prepend=total[0])
    mean = g.slope(total)
    mean = np.interp(t, t[np.isfinite(mean)], mean[np.isfinite(mean)])
    noise = white_noise([(own, a.data.value)]) + a.step**2 / 12.0
    walk = np.full(n, noise * float(np.median(np.diff(own))) * h)
    after = np.searchsorted(own, t).clip(1, len(own) - 1)
    lost = (own[after] - own[after - 1] > max(1e-9 * a.gap_ns, h)) | (t < own[0]) | (t > own[-1])
    walk[lost] += h * _LOST**2
    drift: Floats = _DRIFT**2 * h + (_PITCH * np.diff(mean, prepend=mean[0])) ** 2

    even = ~(np.abs(g.slope(g.rim) - mean) >= _CATCHES_UP)  # at both ends, nobody knows
    rolls = free & far(even, g.half) & (g.rim > CRAWL)
    rim = np.where(rolls, g.rim, np.nan)
    together = finite_median(rim)
    ratio = [np.median(x[on] / together[on]) if on.any() else 1.0
             for x, on in zip(rim, rolls, strict=True)]  # fmt: skip
    level = np.zeros(n)
    for first, past in true_runs(stands):
        level[first:past] = np.mean(gained[first:past]) / h
    return _Samples(
        h, gained, walk, drift, rim / np.array(ratio)[:, None],
        (_WHEEL**2 + (_CREEP * mean * rim) ** 2) * _ALIKE / h, stands, level,
    )  # fmt: skip
