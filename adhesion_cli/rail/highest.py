"""The highest adhesion force of a brake application: a mean over a stated time, with its band.

The value is the mean force of the window with the highest lower limit, so no outlier of the noise.
Its band holds the true highest mean. That may lie in another window: a peak of 0.1 s at the end of
a slide is flattened by the smoother, which says so by a large sigma there. So the highest mean has
the distribution of the largest of all windows, each normal about its estimate:

    P(highest ≤ x) = Π Φ((x − F_k) / σ_k)

over windows one after the other, and the band reaches from the value to the quantiles of 2.5 and
97.5 %, the wider of the two on both sides. Errors of windows are taken as independent, which makes
the band wider.

σ_k is the smoother's sigma of the force, or that of the mean by its two ends,
ω̇ = (ω_2 − ω_1) / T, where that is less: a slide's peak is short, but the speed before and after it
is well known.

Tolerances are one error for all windows. Where they are wide, as of a friction that is not known at
some speed, another window may have the highest mean: the value is found with each tolerance added
and subtracted, too.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ..core.model import Z95, Floats, Reference, Times
from ..core.signals import running_integral

SLIPPERY = 0.1  # adhesion coefficient below which a rail is slippery, about
PEAK_TIME = 0.1  # the highest force is a mean over this time [s]
_ROOT_2 = math.sqrt(2.0)
_FAR = 6.0  # sigma beyond which a window is surely lower
_erfc = cast(Callable[[Floats], Floats], np.vectorize(math.erfc, otypes=[float]))


class HighestMean(NamedTuple):
    """The highest mean force of a brake application."""

    value: float  # [N]
    u95: float  # half the width of its 95 % band [N]
    mass: float  # its covariance with ln m [N]


def is_known(coefficient: float, u95: float) -> bool:
    """Whether the interval of a µ says anything: it does not hold both 0 and a rail that grips."""
    return coefficient > u95 or coefficient + u95 < SLIPPERY


def highest_mean(
    t: Times, reference: Reference, pieces: Sequence[NDArray[np.int64]], peak_time: float
) -> HighestMean:
    """The highest mean force over `peak_time` [s], with its band.

    Each of `pieces` is in the order of time and without NaN. Where samples are further apart than
    half of that time, each is taken as it is.
    """
    windows = [_windows(t[i], reference.rows(i), peak_time) for i in pieces]
    mean, sigma, tolerance, mass = (np.concatenate(column) for column in zip(*windows, strict=True))
    sigma = np.maximum(sigma, 1e-9 * max(float(np.abs(mean).max()), 1.0))
    lower_limit = mean - Z95 * sigma
    top = int(np.argmax(lower_limit))
    highest, top_low = float(mean[top]), float(lower_limit[top])
    higher, lower = (float(np.max(lower_limit + k * tolerance)) for k in (Z95, -Z95))
    by_tolerance = max(higher - top_low, top_low - lower)
    candidates = mean + _FAR * sigma > mean[top] - _FAR / 2.0 * sigma[top]
    windows_near = mean[candidates], sigma[candidates]
    lowest, largest = (_quantile(*windows_near, share) for share in (0.025, 0.975))
    u95 = math.hypot(max(largest - highest, highest - lowest), by_tolerance)
    return HighestMean(highest, u95, float(mass[top]))


def _windows(t: Times, r: Reference, peak_time: float) -> tuple[Floats, ...]:
    """The highest window of each `peak_time` [s], at times `t` [ns].

    Mean force, its sigma by noise and by tolerances, and its covariance with ln m [N]; (k,).
    """
    seconds = (t - t[0]) * 1e-9
    mean, sigma, interval = r.force, r.sigma, float(np.median(np.diff(seconds)))
    if interval <= 0.501 * peak_time:
        mean, sigma = (_moving_mean(seconds, x, peak_time) for x in (r.force, r.sigma))
        if interval <= peak_time / 4.0 and r.impulse is not None and r.clamping is not None:
            sigma_by_ends = np.hypot(_ROOT_2 * r.impulse / peak_time, r.clamping)
            sigma = np.minimum(sigma, sigma_by_ends)
    block = np.floor(seconds / peak_time).astype(int)
    order = np.lexsort((mean + sigma, block))
    best = order[np.append(np.flatnonzero(np.diff(block[order])), len(order) - 1)]
    mass = np.zeros(len(t)) if r.mass is None else r.mass
    return mean[best], sigma[best], r.tolerance[best], mass[best]


def _moving_mean(t: Floats, x: Floats, width: float) -> Floats:
    """Mean of x over `width` about each time, by the trapezoidal rule; less at the ends; (n,)."""
    area = running_integral(t, x)
    begins, ends_of_windows = np.maximum(t - width / 2.0, t[0]), np.minimum(t + width / 2.0, t[-1])
    gained = np.interp(ends_of_windows, t, area) - np.interp(begins, t, area)
    mean: Floats = gained / (ends_of_windows - begins)
    return mean


def _quantile(mean: Floats, sigma: Floats, share: float) -> float:
    """What the largest of independent normal values is below, with this probability."""
    lower, upper = float(np.max(mean - 4.0 * sigma)), float(np.max(mean + _FAR * sigma))
    while upper - lower > 1e-9 * abs(upper) + 1e-12:
        middle = (lower + upper) / 2.0
        exceedance = 0.5 * _erfc((middle - mean) / (_ROOT_2 * sigma))
        if float(np.sum(np.log1p(-np.minimum(exceedance, 1.0 - 1e-16)))) < math.log(share):
            lower = middle
        else:
            upper = middle
    return (lower + upper) / 2.0
