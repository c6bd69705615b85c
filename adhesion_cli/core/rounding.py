"""Numbers without digits that say nothing: what is left of them compresses.

Digits below a small share of a number's uncertainty are noise. A multiple of a power of two has
zeros for them. Source: Zender C.: Bit Grooming, Geosci. Model Dev. 9 (2016) 3199; here the step
follows the uncertainty of each number, not its size.
"""

import numpy as np

from .model import Floats

SHARE = 1.0 / 32.0  # of the standard uncertainty: adds at most 0.02 % to it
DIGITS = 2.0**-9  # of a number's own size, where it is an uncertainty or a slope
SLIP = 2.0**-12  # standard uncertainty of a measured slip at its best: diameters are known worse


def rounded(x: Floats, sigma: Floats | float) -> Floats:
    """Multiples of the largest power of two that changes x by at most SHARE of its uncertainty.

    Args:
        x: numbers (n,), any unit.
        sigma: their standard uncertainty, (n,) or for all. Where it is zero or not finite, x stays
            as it is.

    >>> rounded(np.array([1234.5678, 1234.5678]), np.array([100.0, 0.0]))
    array([1236.    , 1234.5678])
    """
    has_sigma = np.isfinite(sigma) & np.isfinite(x) & (np.asarray(sigma) > 0.0)
    _, power = np.frexp(np.where(has_sigma, 2.0 * SHARE * sigma, 1.0))
    step = np.ldexp(1.0, power - 1)
    return np.where(has_sigma, np.rint(x / step) * step, x)


def digits(x: Floats) -> Floats:
    """The same with a change of at most DIGITS of each number's own size."""
    return rounded(x, np.abs(x) * (DIGITS / SHARE))
