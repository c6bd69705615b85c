"""A mixture of Gaussians of a level and its rate, one for each regime, and its Kalman steps.

The reading of the level may be rounded to steps, and its noise may be that of a pulse counter. A
counter loses no pulse: what one reading has too much the next has too little. Its noise is n − n',
n of the sample and n' of the one before. So n is a third component of the Gaussian.

Sources: Blom, Bar-Shalom, IEEE Trans. Automatic Control 33 (1988) 780; for a rounded reading the
mean and variance of a normal distribution that is cut off at both ends: Curry, Estimation and
Control with Quantized Measurements, MIT Press 1970.
"""

import math
from typing import NamedTuple

_TAU = 2.0 * math.pi
_ROOT2, _ROOT_TAU = math.sqrt(2.0), math.sqrt(_TAU)
_LEAST = 1e-12  # probability that every regime keeps
_FAR = 1e-20  # probability of a rounded reading below which the normal distribution takes over


class Gaussian(NamedTuple):
    """What one regime says of level x, rate r and the reading's own noise n."""

    x: float
    r: float
    n: float
    xx: float  # variances and covariances
    xr: float
    rr: float
    xn: float
    rn: float
    nn: float
    p: float  # probability of the regime


class Reading(NamedTuple):
    """A measured level."""

    y: float
    variance: float  # of n
    step: float  # rounding step, 0: not rounded
    counts: float  # 1: n − n' of a pulse counter, 0: n


def squared(x: float) -> float:
    """x². `x ** 2` would call `pow`, whose last bit may differ from that of a product."""
    return x * x


def known(x: float, xx: float, r: float, rr: float, p: float) -> Gaussian:
    """Level and rate with these variances, uncorrelated."""
    return Gaussian(x, r, 0.0, xx, 0.0, rr, 0.0, 0.0, 0.0, p)


def merged(a: Gaussian, b: Gaussian, c: Gaussian, wa: float, wb: float, wc: float) -> Gaussian:
    """The Gaussian with mean and covariance of the mixture; p is the sum of the weights."""
    p = wa + wb + wc
    share = 1.0 / p
    wa, wb, wc = wa * share, wb * share, wc * share
    x, r = wa * a.x + wb * b.x + wc * c.x, wa * a.r + wb * b.r + wc * c.r
    n = wa * a.n + wb * b.n + wc * c.n
    xa, ra, na = a.x - x, a.r - r, a.n - n
    xb, rb, nb = b.x - x, b.r - r, b.n - n
    xc, rc, nc = c.x - x, c.r - r, c.n - n
    return Gaussian(
        x, r, n,
        wa * (a.xx + xa * xa) + wb * (b.xx + xb * xb) + wc * (c.xx + xc * xc),
        wa * (a.xr + xa * ra) + wb * (b.xr + xb * rb) + wc * (c.xr + xc * rc),
        wa * (a.rr + ra * ra) + wb * (b.rr + rb * rb) + wc * (c.rr + rc * rc),
        wa * (a.xn + xa * na) + wb * (b.xn + xb * nb) + wc * (c.xn + xc * nc),
        wa * (a.rn + ra * na) + wb * (b.rn + rb * nb) + wc * (c.rn + rc * nc),
        wa * (a.nn + na * na) + wb * (b.nn + nb * nb) + wc * (c.nn + nc * nc), p,
    )  # fmt: skip


def moved(g: Gaussian, h: float, gained: float, lost: float, rise: float, q: float) -> Gaussian:
    """One interval on: dx = gained + h r, where r rises evenly and walks.

    Args:
        g: the state before.
        h: effect of the rate on the level; the interval if the rate is that of the level.
        gained: known part of the change of the level.
        lost: standard deviation of that.
        rise: known change of the rate.
        q: variance that the rate's random walk gains.
    """
    return Gaussian(
        g.x + gained + h * (g.r + 0.5 * rise), g.r + rise, g.n,
        g.xx + lost * lost + 2.0 * h * g.xr + h * h * (g.rr + q / 3.0),
        g.xr + h * (g.rr + 0.5 * q), g.rr + q, g.xn + h * g.rn, g.rn, g.nn, g.p,
    )  # fmt: skip


def corrected(g: Gaussian, of: Reading) -> tuple[Gaussian, float]:
    """The Gaussian after a reading, with p times its likelihood over exp(−d), and d."""
    if of.step * of.step > g.xx + of.variance:
        return _rounded(g, of)
    return _read(g, of)


def _read(g: Gaussian, of: Reading) -> tuple[Gaussian, float]:
    """Kalman's update; rounding is noise."""
    v = of.variance + of.step * of.step / 12.0
    e = of.y - g.x + of.counts * g.n
    cx, cr = g.xx - of.counts * g.xn, g.xr - of.counts * g.rn
    S = max(cx - of.counts * (g.xn - of.counts * g.nn), 0.0) + v
    inverse = 1.0 / S
    kx, kr, kn = cx * inverse, cr * inverse, v * inverse
    after = Gaussian(
        g.x + kx * e, g.r + kr * e, kn * e,
        max(g.xx - kx * cx, 0.0), g.xr - kx * cr, max(g.rr - kr * cr, 0.0),
        -kx * v, -kr * v, v - kn * v, g.p * math.sqrt(inverse / _TAU),
    )  # fmt: skip
    return after, 0.5 * e * e * inverse


def _rounded(g: Gaussian, of: Reading) -> tuple[Gaussian, float]:
    """The reading is within half a step of level plus noise: the rest is cut off."""
    S = g.xx + of.variance
    s, e = math.sqrt(S), of.y - g.x
    low, high = (abs(e) - 0.5 * of.step) / s, (abs(e) + 0.5 * of.step) / s
    inside = 0.5 * (math.erfc(low / _ROOT2) - math.erfc(high / _ROOT2))
    if inside < _FAR:
        return _read(g, Reading(of.y, of.variance, of.step, 0.0))
    at_low = math.exp(-0.5 * low * low) / _ROOT_TAU / inside
    at_high = math.exp(-0.5 * high * high) / _ROOT_TAU / inside
    mean = at_low - at_high
    less = mean * mean - low * at_low + high * at_high  # share of the variance that is cut off
    kx, kr, e = g.xx / S, g.xr / S, math.copysign(s * mean, e)
    after = Gaussian(
        g.x + kx * e, g.r + kr * e, 0.0,
        max(g.xx - less * kx * g.xx, 0.0), g.xr - less * kx * g.xr,
        max(g.rr - less * kr * g.xr, 0.0), 0.0, 0.0, 0.0,
        g.p * inside / of.step,
    )  # fmt: skip
    return after, 0.0


def below(g: Gaussian, of: Reading, y: float) -> tuple[float, float]:
    """The probability of a reading below y, and of one above it, each times p."""
    n = of.counts
    S = max(g.xx - 2.0 * n * g.xn + n * n * g.nn, 0.0) + of.variance
    far = (y - g.x + n * g.n) / math.sqrt(2.0 * S)
    return 0.5 * g.p * math.erfc(-far), 0.5 * g.p * math.erfc(far)


def weighed(g: Gaussian, p: float) -> Gaussian:
    """The same with another probability."""
    return Gaussian(g.x, g.r, g.n, g.xx, g.xr, g.rr, g.xn, g.rn, g.nn, max(p, _LEAST))
