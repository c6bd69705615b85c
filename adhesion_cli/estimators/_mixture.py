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
_SMALLEST_PROBABILITY = 1e-12  # probability that every regime keeps
# probability of a rounded reading below which the normal distribution takes over
_IMPROBABLE = 1e-20


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


def uncorrelated(x: float, xx: float, r: float, rr: float, p: float) -> Gaussian:
    """Level and rate with these variances, uncorrelated."""
    return Gaussian(x, r, 0.0, xx, 0.0, rr, 0.0, 0.0, 0.0, p)


def merge(a: Gaussian, b: Gaussian, c: Gaussian, wa: float, wb: float, wc: float) -> Gaussian:
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
        x,
        r,
        n,
        wa * (a.xx + xa * xa) + wb * (b.xx + xb * xb) + wc * (c.xx + xc * xc),
        wa * (a.xr + xa * ra) + wb * (b.xr + xb * rb) + wc * (c.xr + xc * rc),
        wa * (a.rr + ra * ra) + wb * (b.rr + rb * rb) + wc * (c.rr + rc * rc),
        wa * (a.xn + xa * na) + wb * (b.xn + xb * nb) + wc * (c.xn + xc * nc),
        wa * (a.rn + ra * na) + wb * (b.rn + rb * nb) + wc * (c.rn + rc * nc),
        wa * (a.nn + na * na) + wb * (b.nn + nb * nb) + wc * (c.nn + nc * nc),
        p,
    )


def predict(g: Gaussian, h: float, u: float, input_sigma: float, rise: float, q: float) -> Gaussian:
    """One interval on: dx = gained + h r, where r rises evenly and walks.

    `h` is the effect of the rate on the level: the interval if the rate is that of the level. `u`
    is the known part of the level's change, with a standard deviation, and `rise` that of the rate.
    The rate's random walk gains the variance `q`.
    """
    return Gaussian(
        g.x + u + h * (g.r + 0.5 * rise),
        g.r + rise,
        g.n,
        g.xx + input_sigma * input_sigma + 2.0 * h * g.xr + h * h * (g.rr + q / 3.0),
        g.xr + h * (g.rr + 0.5 * q),
        g.rr + q,
        g.xn + h * g.rn,
        g.rn,
        g.nn,
        g.p,
    )


def update(g: Gaussian, reading: Reading) -> tuple[Gaussian, float]:
    """The Gaussian after a reading, with p times its likelihood over exp(−d), and d."""
    if reading.step * reading.step > g.xx + reading.variance:
        return _rounded_update(g, reading)
    return _kalman_update(g, reading)


def _kalman_update(g: Gaussian, reading: Reading) -> tuple[Gaussian, float]:
    """Kalman's update; rounding is noise."""
    v = reading.variance + reading.step * reading.step / 12.0
    nu = reading.y - g.x + reading.counts * g.n
    cx, cr = g.xx - reading.counts * g.xn, g.xr - reading.counts * g.rn
    S = max(cx - reading.counts * (g.xn - reading.counts * g.nn), 0.0) + v
    inverse = 1.0 / S
    kx, kr, kn = cx * inverse, cr * inverse, v * inverse
    posterior = Gaussian(
        g.x + kx * nu,
        g.r + kr * nu,
        kn * nu,
        max(g.xx - kx * cx, 0.0),
        g.xr - kx * cr,
        max(g.rr - kr * cr, 0.0),
        -kx * v,
        -kr * v,
        v - kn * v,
        g.p * math.sqrt(inverse / _TAU),
    )
    return posterior, 0.5 * nu * nu * inverse


def _rounded_update(g: Gaussian, reading: Reading) -> tuple[Gaussian, float]:
    """The reading is within half a step of level plus noise: the rest is cut off."""
    S = g.xx + reading.variance
    s, nu = math.sqrt(S), reading.y - g.x
    z_low, z_high = (abs(nu) - 0.5 * reading.step) / s, (abs(nu) + 0.5 * reading.step) / s
    inside = 0.5 * (math.erfc(z_low / _ROOT2) - math.erfc(z_high / _ROOT2))
    if inside < _IMPROBABLE:
        return _kalman_update(g, Reading(reading.y, reading.variance, reading.step, 0.0))
    density_low = math.exp(-0.5 * z_low * z_low) / _ROOT_TAU / inside
    density_high = math.exp(-0.5 * z_high * z_high) / _ROOT_TAU / inside
    mean = density_low - density_high
    cut_share = (
        mean * mean - z_low * density_low + z_high * density_high
    )  # share of the variance that is cut off
    kx, kr, nu = g.xx / S, g.xr / S, math.copysign(s * mean, nu)
    posterior = Gaussian(
        g.x + kx * nu,
        g.r + kr * nu,
        0.0,
        max(g.xx - cut_share * kx * g.xx, 0.0),
        g.xr - cut_share * kx * g.xr,
        max(g.rr - cut_share * kr * g.xr, 0.0),
        0.0,
        0.0,
        0.0,
        g.p * inside / reading.step,
    )
    return posterior, 0.0


def tail_probabilities(g: Gaussian, reading: Reading, y: float) -> tuple[float, float]:
    """The probability of a reading below y, and of one above it, each times p."""
    n = reading.counts
    S = max(g.xx - 2.0 * n * g.xn + n * n * g.nn, 0.0) + reading.variance
    z = (y - g.x + n * g.n) / math.sqrt(2.0 * S)
    return 0.5 * g.p * math.erfc(-z), 0.5 * g.p * math.erfc(z)


def with_probability(g: Gaussian, p: float) -> Gaussian:
    """The same with another probability."""
    return Gaussian(
        g.x, g.r, g.n, g.xx, g.xr, g.rr, g.xn, g.rn, g.nn, max(p, _SMALLEST_PROBABILITY)
    )
