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
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core import compiled
from ..core.finding import Finding
from ..core.masks import erode, true_runs
from ..core.model import Bools, Channel, Floats, Parameter, Times
from ..core.physics import CRAWL, RELEASED_SHARE
from ..core.signals import finite_median, running_integral, white_noise
from ..records.axle_channels import AxleChannels
from .grid import FEWEST, Grid

GRID_STEP = 0.1  # step of the grid [s]
_STANDSTILL_SPEED = 0.05  # of a wheel that stands [m/s]
_SETTLING_TIME = 0.5  # after a stop the body still swings, after a brake its wheel still slides [s]
_CATCH_UP_RATE = 1.0  # a wheel that gains more than any bias rolls not yet [m/s²]
_BIAS = 0.5  # 1 sigma of b: tilt, zero, a gradient of 3 % [m/s²]
_DRIFT = 0.02  # b's walk: a gradient that changes by 1 % in 25 s [m/s² per √s]
_GAP_SIGMA = 1.0  # 1 sigma of a in a gap of it, per √s [m/s²]
_PITCH = 0.03  # share of a change of a by which b changes: gain, pitch
# 1 sigma of a wheel's speed that lasts for `_CORRELATION_TIME`, without noise [m/s]
_WHEEL_SIGMA = 0.02
_CORRELATION_TIME = 1.0  # [s]
_CREEP = 0.004  # 1 sigma of the creep of a wheel that a motor drives, at 1 m/s² [s²/m]
_GATE = 12.0  # χ² of two errors, in v and b, beyond which it is not the train that stands
_BRAKING_RANGE = 0.05, 3.0  # a brake makes of a what lies between, or it is not the train's [m/s²]
_LARGEST_SIGMA = 3.0  # no speed is known with a larger sigma [m/s]
_FILTER_DELAY_SIGMA = 0.05  # 1 sigma delay of an accelerometer by its filter [s]
_UNKNOWN = 100.0  # 1 sigma of a speed before anything is known [m/s]


class Integrated(NamedTuple):
    """The train's speed by its acceleration; shape (n,)."""

    t: Floats  # even, after `first` [s]
    start_ns: int  # [ns]
    correction: Floats  # v − ∫ ±a dt [m/s]
    sigma: Floats  # 1 sigma of v [m/s]
    bias: Floats  # b [m/s²]
    sample_t: Floats  # times of the accelerometer's samples, after `first` (m,) [s]
    sample_gain: Floats  # ∫ ±a dt at them (m,) [m/s]
    sign: int  # of the axis: 1 where it reads a braked train below zero
    anchored: float  # time in which wheels give the speed [s]

    def interpolate(self, t: Times) -> tuple[Floats, Floats]:
        """Speed and its 1 sigma at these times, shape (m,) [m/s]; NaN where nothing was read."""
        since = (t - self.start_ns) * 1e-9
        v = np.interp(since, self.sample_t, self.sample_gain)
        v += np.interp(since, self.t, self.correction)
        sigma = np.interp(since, self.t, self.sigma)
        inside = (since >= self.sample_t[0]) & (since <= self.sample_t[-1])
        inside &= sigma < _LARGEST_SIGMA
        return np.where(inside, np.maximum(v, 0.0), np.nan), np.where(inside, sigma, np.nan)


class _AccelerationSamples(NamedTuple):
    """What the filter takes, on the grid."""

    h: float  # step [s]
    gain: Floats  # ∫ ±a dt of the step before (n,) [m/s]
    walk: Floats  # variance of v that it adds (n,) [m²/s²]
    drift: Floats  # and of b (n,) [m²/s⁴]
    rim: Floats  # of wheels that roll surely, else NaN (k, n) [m/s]
    variance: Floats  # of that (k, n)
    standstill: Bools  # where every wheel does (n,)
    level: Floats  # mean of a there (n,) [m/s²]


def _filter(s: _AccelerationSamples, moments: Floats) -> None:
    """Kalman's filter.

    `moments` (n, 10) is filled: v, b, P_vv, P_vb, P_bb before the wheels of a step were heard, and
    after.
    """
    k, n = s.rim.shape
    v, b, Pvv, Pvb, Pbb = 0.0, 0.0, _UNKNOWN**2, 0.0, _BIAS**2
    train_stands = False
    for j in range(n):
        if j > 0:
            v += s.gain[j] - s.h * b
            Pvv += s.h * s.h * Pbb - 2.0 * s.h * Pvb + s.walk[j]
            Pvb -= s.h * Pbb
            Pbb += s.drift[j]
        moments[j, :5] = v, b, Pvv, Pvb, Pbb
        if not s.standstill[j]:
            train_stands = False
        elif j == 0 or not s.standstill[j - 1]:  # both v = 0 and b = a must be likely
            bias_change, S = s.level[j] - b, Pvv + _WHEEL_SIGMA**2
            T = Pbb + _PITCH**2 + s.walk[j] / s.h
            distance = v * v * T + 2.0 * v * bias_change * Pvb + bias_change * bias_change * S
            train_stands = distance < _GATE * (S * T - Pvb * Pvb)
        for i in range(k + 1):
            rim, R = 0.0, _WHEEL_SIGMA**2 * _CORRELATION_TIME / s.h
            if i < k:
                rim, R = s.rim[i, j], s.variance[i, j]
                if math.isnan(rim):
                    continue
            elif not train_stands:
                continue
            S, innovation = Pvv + R, rim - v
            Gv, Gb = Pvv / S, Pvb / S
            v, b = v + Gv * innovation, b + Gb * innovation
            Pbb -= Gb * Pvb
            Pvb -= Gv * Pvb
            Pvv -= Gv * Pvv
        moments[j, 5:] = v, b, Pvv, Pvb, Pbb


def _smooth(s: _AccelerationSamples, moments: Floats, smoothed: Floats) -> None:
    """Rauch, Tung and Striebel's pass back; fills `smoothed` (n, 3): v, b, P_vv."""
    n, h = len(moments), s.h
    v, b, Svv, Svb, Sbb = moments[n - 1, 5:]
    smoothed[n - 1] = v, b, Svv
    for j in range(n - 2, -1, -1):
        fv, fb, Fvv, Fvb, Fbb = moments[j, 5:]
        pv, pb, Pvv, Pvb, Pbb = moments[j + 1, :5]
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
        smoothed[j] = v, b, Svv


def give_train_speed(
    axles: list[AxleChannels], g: Grid | None, a: Channel
) -> tuple[list[AxleChannels], list[Finding]]:
    """The axles with a train speed by its acceleration, or why there is none."""
    v = _integrate(g, a) if g else "the clock jumps back"
    if isinstance(v, str):
        unused = Finding("acceleration-not-usable", "warning", channel=a.title, names={"reason": v})
        return axles, [unused]
    integrated_axles, highest = [], 0.0
    filter_delay = Parameter(0.0, _FILTER_DELAY_SIGMA)
    for x in axles:
        speed, sigma = v.interpolate(x.record.t)
        highest = max(highest, float(np.nanmax(sigma, initial=0.0)))
        record = replace(x.record, train_speed=speed, train_speed_sigma=sigma)
        integrated_axles.append(x._replace(record=replace(record, train_speed_late=filter_delay)))
    values = {
        "sigma_mps": highest,
        "bias_low_mps2": float(v.bias.min()),
        "bias_high_mps2": float(v.bias.max()),
        "anchored_s": v.anchored,
    }
    names = {"axis": "forwards" if v.sign > 0 else "backwards"}
    finding = Finding("train-speed-integrated", "info", channel=a.title, values=values, names=names)
    return integrated_axles, [finding]


def _integrate(g: Grid, a: Channel) -> Integrated | str:
    """The train's speed by its acceleration [m/s²], in any sign; or why there is none."""
    n = g.rim.shape[1]
    t: Floats = g.step * np.arange(n, dtype=np.float64)
    sample_t: Floats = np.multiply(a.data.t - g.start_ns, 1e-9)
    dt, x = np.diff(sample_t), a.data.value
    if len(sample_t) < FEWEST or (dt <= 0.0).any():
        return "its clock jumps back"
    area = running_integral(sample_t, x)
    gain: Floats = np.interp(t, sample_t, area)
    rate, settling_steps = g.slope(gain), round(_SETTLING_TIME / g.step)
    release_force = RELEASED_SHARE * float(np.nanmax(g.clamping, initial=0.0))
    released = erode(g.clamping <= release_force, settling_steps)
    standstill = erode(np.all(g.rim < _STANDSTILL_SPEED, axis=0), settling_steps)
    braked = erode(np.all(g.clamping > 0.0, axis=0), g.half_width)
    sign = _sign(rate, braked & ~standstill, released.all(axis=0) | standstill)
    if not sign:
        return "it does not show the brake slow the train"
    gain, rate = sign * gain, sign * rate
    mean: Floats = np.interp(t, t[np.isfinite(rate)], rate[np.isfinite(rate)])
    s = _samples(g, gain, mean, a, released, standstill)
    anchored = np.isfinite(s.rim).any(axis=0) | s.standstill
    if not anchored.any():
        return "no wheel surely rolls: the brake is on all the time, and the train does not stand"
    moments, smoothed = np.empty((n, 10)), np.empty((n, 3))
    compiled.function(_filter)(s, moments)
    compiled.function(_smooth)(s, moments, smoothed)
    v, b, variance = smoothed.T
    return Integrated(
        t=t,
        start_ns=g.start_ns,
        correction=v - gain,
        sigma=np.sqrt(variance),
        bias=b,
        sample_t=sample_t,
        sample_gain=sign * area,
        sign=sign,
        anchored=g.step * float(anchored.sum()),
    )


def _sign(rate: Floats, braked: Bools, unbraked: Bools) -> int:
    """Of the axis: a brake slows the train; 0 where what is read does not show that.

    `rate` is that of ∫ a dt over about a second [m/s²], beside where all and no wheels are braked.
    """
    braked, unbraked = braked & np.isfinite(rate), unbraked & np.isfinite(rate)
    if min(braked.sum(), unbraked.sum()) < 2:
        return 0
    change = float(np.mean(rate[braked]) - np.mean(rate[unbraked]))
    shows_brake = _BRAKING_RANGE[0] < abs(change) < _BRAKING_RANGE[1]
    return -int(math.copysign(1, change)) if shows_brake else 0


def _samples(
    g: Grid, gain: Floats, mean: Floats, a: Channel, released: Bools, standstill: Bools
) -> _AccelerationSamples:
    """What the filter takes.

    `gain` is ∫ ±a dt [m/s], `mean` ±a over about a second, (n,) [m/s²]. `released` says which
    wheels are not braked (k, n), `standstill` where all of them stand, for a while (n,).
    """
    h, n = g.step, len(gain)
    t: Floats = h * np.arange(n, dtype=np.float64)
    sample_t: Floats = np.multiply(a.data.t - g.start_ns, 1e-9)
    step_gain = np.diff(gain, prepend=gain[0])
    level = np.zeros(n)
    for start, stop in true_runs(standstill):
        level[start:stop] = np.mean(step_gain[start:stop]) / h
    steady = ~(np.abs(g.rim_rate - mean) >= _CATCH_UP_RATE)  # at both ends, nobody knows
    rolling = released & erode(steady, g.half_width) & (g.rim > CRAWL)
    noise = white_noise([(sample_t, a.data.value)]) + a.step**2 / 12.0
    walk = np.full(n, noise * float(np.median(np.diff(sample_t))) * h)
    next_sample = np.searchsorted(sample_t, t).clip(1, len(sample_t) - 1)
    in_gap = np.diff(sample_t)[next_sample - 1] > max(1e-9 * a.gap_ns, h)
    in_gap |= (t < sample_t[0]) | (t > sample_t[-1])
    walk[in_gap] += h * _GAP_SIGMA**2
    drift: Floats = _DRIFT**2 * h + (_PITCH * np.diff(mean, prepend=mean[0])) ** 2

    rim = np.where(rolling, g.rim, np.nan)
    median_rim = finite_median(rim)
    ratio = [
        np.median(x[rolls] / median_rim[rolls]) if rolls.any() else 1.0
        for x, rolls in zip(rim, rolling, strict=True)
    ]
    variance = (_WHEEL_SIGMA**2 + (_CREEP * mean * rim) ** 2) * _CORRELATION_TIME / h
    return _AccelerationSamples(
        h=h,
        gain=step_gain,
        walk=walk,
        drift=drift,
        rim=rim / np.array(ratio)[:, None],
        variance=variance,
        standstill=standstill,
        level=level,
    )
