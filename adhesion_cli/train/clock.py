"""Time offset of the train speed against the wheels: one number per log, with its error.

A receiver delivers an older speed, T(t) = v(t − τ). GNSS is delayed by one to two seconds. For a
wheel i that rolls,

    T(t + τ) − ωR = c_i ωR + q (−v̇) ωR,

with c_i the error of its radius and q (−v̇) its creepage, which grows with the force on the rising
flank of the creep curve (3). A delay differs from both: its error is τ (−v̇) at every speed, and it
begins and ends later than the braking. A constant offset o of the train speed is the same with and
without brake. Where τ and o explain the log equally well, both are reported.

Wheels that slide are left out, with one second around each slide. τ is where most samples of all
axles fit. Slides that a controller repeats all along fit as well. They need a q that no creepage
has, or a c that the wheels do not show without brake, and then nothing is reported. The error of τ
follows from the curvature of what is left. The noise of the train speed is slow and the same for
every axle.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..core.model import Bools, Floats, Parameter
from ..core.physics import CRAWL
from ..core.signals import white_noise
from .grid import LEAST, Grid, far

_SCAN = 0.1  # from one that is tried to the next [s]
_TAUS = np.arange(-5.0, 5.0 + _SCAN / 2.0, _SCAN)  # delays that are tried [s]
_OFFSETS = 0.6 * _TAUS  # of the speed that are tried [m/s]
_FLOOR = 0.03  # 1 sigma by which a rolling wheel may differ, whatever the noise [m/s]
_CUT = 4.0  # sigma that are no noise
_WORN = 0.02  # 1 sigma of c [-]
_CREEP = 0.002, 0.004  # q and its 1 sigma: creep of 0.2 % at 1 m/s² [s²/m]
_NO_CREEP = 3.0  # sigma of q: a fit farther off is one of slides
_SLOWING = 0.2  # a train that does is braked [m/s²]
_NEAR = 1.0  # before and behind a slide creep is no straight line of force [s]
_LEAST = 3.0  # shortest rolling of a braked wheel [s]
_SHARE = 0.5  # and for this share of the braking
_ALIKE = 0.85  # of the time that the best axle rolls: an axle that rolls less does not count
_SLOW = 1.5  # a receiver's noise is as slow as this, or as three of its samples [s]
_DELAY = 0.015, 0.2  # 1 sigma of τ by creep that does not go with the force; with more, unknown [s]
_OFF = 0.05, 0.3  # the same two of o: by what a slow wheel's sensor leaves out [m/s]
_CERTAIN = 3.0  # sigma from zero is an offset
_APART, _AS_GOOD = 0.5, 1.1  # nearest other τ or o [s, m/s], and its loss over the best one's
_CLEAR = 1.5  # the same of τ and o
_MOST = 4000  # samples of the fit


class _Samples(NamedTuple):
    """What is fitted: shape (n,), and (axles, n)."""

    t: Floats  # [s]
    rim: Floats  # [m/s]
    free: Bools  # not braked (axles, n)
    slows: Bools  # the train does (n,)
    noise: float  # 1 sigma of the train speed [m/s]
    alike: float  # samples in a row with correlated noise
    known: Bools  # where the rim turns and its deceleration is known (axles, n)
    fast: Bools  # where it is not slow for its axle (axles, n)
    factors: Floats  # of c and q, 0 where not known (axles, 2, n)
    products: Floats  # of these: c², c q, q² (axles, 3, n)

    def of(self, axles: Bools) -> "_Samples":
        """Those of some axles."""
        of_axles = ("rim", "free", "known", "fast", "factors", "products")
        return self._replace(**{name: getattr(self, name)[axles] for name in of_axles})


class _Fit(NamedTuple):
    """At one τ or o."""

    x: Floats  # c of each axle, q
    used: Bools  # (axles, n): no slide
    loss: float  # mean square of what is left, cut off


class Beside(NamedTuple):
    """How the train speed differs from the wheels; None where that is not clear."""

    late: Parameter | None  # τ [s]
    offset: Parameter | None = None  # o [m/s], where τ is none or does not explain it better


class _Found(NamedTuple):
    """The likeliest τ or o."""

    value: Parameter
    loss: float
    clear: bool  # no other is nearly as likely


def beside(g: Grid, interval: float) -> Beside:
    """Delay of the train speed, negative where it is early, and its offset.

    Args:
        g: all axles on one time axis, with the train speed.
        interval: of the train speed's own samples [s].
    """
    train = g.train
    if train is None or np.isfinite(train).sum() < 2 * LEAST:
        return Beside(None)
    t: Floats = g.step * np.arange(len(train), dtype=np.float64)
    known, every = np.isfinite(train), max(1, len(t) // _MOST)
    apart = (1, max(1, round(0.5 / g.step)))  # neighbours may be interpolated
    runs = ((t[known][::j], train[known][::j]) for j in apart)
    some, own, measured = t[::every], t[known], train[known]

    def at(tau: float) -> Floats:
        return np.interp(some + tau, own, measured, left=np.nan, right=np.nan)

    noise = max(_FLOOR, *(math.sqrt(white_noise([run])) for run in runs))
    s = _samples(g, some, every, noise, max(1.0, max(_SLOW, 3.0 * interval) / (g.step * every)))
    late = _likeliest(s, _TAUS, at, *_DELAY)
    shown = at(0.0)
    offset = _likeliest(s, _OFFSETS, lambda o: shown - o, *_OFF)
    by_late = late.value if late and late.clear else None
    if offset is None or abs(offset.value.value) < _CERTAIN * offset.value.tolerance:
        return Beside(by_late)
    if late is None or _CLEAR * offset.loss < late.loss:
        return Beside(None, offset.value if offset.clear else None)
    either = by_late and _CLEAR * late.loss > offset.loss
    return Beside(by_late, offset.value if either else None)


def _samples(g: Grid, t: Floats, every: int, noise: float, alike: float) -> _Samples:
    """Every so many samples of a grid, at times t; with what all fits share."""
    rim, slowing = g.rim[:, ::every], -g.slope(g.rim)[:, ::every]
    slows = np.zeros(len(t), dtype=np.bool_)
    if g.train is not None:
        slows = np.nan_to_num(-g.slope(g.train)[::every]) > _SLOWING
    known = np.isfinite(slowing) & (rim > CRAWL)
    c = np.where(known, rim, 0.0)
    q = np.where(known, rim * np.maximum(slowing, 0.0), 0.0)
    fast = np.array([x > 0.3 * np.nanmax(x) for x in rim])
    return _Samples(
        t, rim, g.clamping[:, ::every] <= 0.0, slows, noise, alike, known, fast,
        np.stack([c, q], axis=1), np.stack([c * c, c * q, q * q], axis=1),
    )  # fmt: skip


def _likeliest(
    s: _Samples, tried: Floats, true: Callable[[float], Floats], sure: float, unknown: float
) -> _Found | None:
    """The value at which most of the samples fit; None where the wheels do not show it.

    Args:
        s: the samples.
        tried: values of the cause.
        true: the train's speed by one of them, (n,) [m/s].
        sure: its 1 sigma where everything else is known.
        unknown: its 1 sigma from which on it is not known.
    """
    fits = [_fit(s, true(x)) for x in tried]
    losses = np.array([f.loss for f in fits])
    place = int(np.argmin(losses))
    if not math.isfinite(losses[place]) or not 0 < place < len(tried) - 1:
        return None
    rolls = (fits[place].used & s.slows).sum(axis=1)
    least = max(_LEAST / (s.t[1] - s.t[0]), _SHARE * s.slows.sum())
    if rolls.max() < least:
        return None
    counts = rolls > _ALIKE * rolls.max()  # what little is left of a slide is no noise
    s = s.of(counts)
    near = np.linspace(tried[place - 1], tried[place + 1], 9)
    bend, slope, _ = np.polyfit(near - tried[place], [_fit(s, true(x)).loss for x in near], 2)
    if not bend > 0.0 or not abs(slope) < 2.0 * bend * (near[-1] - near[0]):
        return None
    value = float(tried[place] - slope / (2.0 * bend))
    f = _fit(s, true(value))
    # −2 log of the likelihood is its number of independent samples times the log of the loss.
    telling = float(f.used.any(axis=0).sum()) / s.alike
    sigma = math.hypot(math.sqrt(f.loss / (bend * telling)), sure)
    rolling = s.free & np.isfinite(true(value)) & (s.rim > CRAWL)
    slides = abs(f.x[-1] - _CREEP[0]) > _NO_CREEP * _CREEP[1]
    slides |= 2 * f.used[rolling].sum() < rolling.sum()
    others = losses[np.abs(tried - value) > _APART]
    clear = not (others.min() < _AS_GOOD * losses[place] or slides or sigma > unknown)
    return _Found(Parameter(value, sigma), f.loss, clear)


def _start(s: _Samples, v: Floats) -> Floats:
    """First c and q: a wheel coasts without slip, and one that rolls is the faster one."""
    c = np.append(np.zeros(len(s.rim)), _CREEP[0])
    runs = v > CRAWL
    for i, rim in enumerate(s.rim):
        fast = s.fast[i] & runs
        free = fast & ~s.slows & s.free[i]
        if free.sum() >= LEAST:
            c[i] = np.median(v[free] / rim[free]) - 1.0
        elif fast.any():
            c[i] = np.quantile(v[fast] / rim[fast], 0.3) - 1.0
    inside: Floats = np.clip(c, -3.0 * _WORN, 3.0 * _WORN)
    return inside


def _fit(s: _Samples, v: Floats) -> _Fit:
    """Least squares of c and q over what is no slide, by the train's true speed (n,) [m/s]."""
    k = len(s.rim)
    usable = s.known & np.isfinite(v) & (v > CRAWL)
    d = np.where(usable, v - s.rim, 0.0)
    sides = s.factors * d[:, None]
    weights = (s.noise / np.array([*([_WORN] * k), _CREEP[1]])) ** 2  # as numbers of samples
    expected = np.append(np.zeros(k), _CREEP[0])
    x, left, used, cut = _start(s, v), d, usable, _CUT * s.noise
    near = round(_NEAR / (s.t[1] - s.t[0]))
    for n in range(8):
        left, before = d - (s.factors[:, 0] * x[:k, None] + s.factors[:, 1] * x[k]), used
        used = usable & (np.abs(left) < cut) & far(~usable | (left < cut), near)
        if n > 0 and np.array_equal(used, before):
            break  # the next fit would be this one
        x = _solved(s.products, sides, used, weights, expected)
    some = left[usable]
    loss = float(np.mean(np.minimum(some**2, cut**2))) if len(some) >= LEAST else math.inf
    return _Fit(x, used, loss)


def _solved(
    products: Floats, sides: Floats, used: Bools, weights: Floats, expected: Floats
) -> Floats:
    """Every axle's c, and q, by the normal equations of the used samples.

    Args:
        products: of the factors of c and q, (axles, 3, n).
        sides: the factors times what they explain, (axles, 2, n).
        used: samples (axles, n).
        weights: of what is expected of c and q, as numbers of samples (axles + 1,).
        expected: of c and q (axles + 1,).
    """
    k, one = len(used), used[:, :, None].astype(np.float64)
    cc, cq, qq = (products @ one)[:, :, 0].T
    A: Floats = np.zeros((k + 1, k + 1))
    np.fill_diagonal(A, np.append(cc, qq.sum()) + weights)
    A[k, :k] = A[:k, k] = cq  # two axles share no sample
    of_c, of_q = (sides @ one)[:, :, 0].T
    b: Floats = np.append(of_c, of_q.sum()) + weights * expected
    return np.asarray(np.linalg.solve(A, b), np.float64)
