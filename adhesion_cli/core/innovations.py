"""Whether the readings are as a filter predicts them: normalised innovation squared, NIS.

Before each reading, a filter says how probable every value of it is. z is the reading as a standard
normal value: the same share of the probability lies below both. For one Gaussian z² is e²/S, with e
the innovation and S its variance. For a mixture of regimes z² is its exact counterpart. If the
model is right, z is white, and the mean of z² is 1.
"""

import math

import numpy as np

from .model import Floats, Nis
from .signals import coverage_factor

_FEWEST = 40  # innovations that show a mean and its error
_BLOCKS = 30  # parts of a log whose means show the error of the whole mean
_SMALLEST_PART = 20  # least innovations of such a part, if there are many

_ROOT2, ROOT_TAU = math.sqrt(2.0), math.sqrt(2.0 * math.pi)
_SMALLEST_PROBABILITY = 1e-300
_THIN, _NARROW = 1e-30, 1e-4  # a reading that is one value, or so improbable
_ROUNDS = 8  # of Newton's method, at most; four give ten digits
_SETTLED = 1e-8


def score(p_below: float, p_above: float) -> float:
    """Standard normal value with these probabilities below and above it; runs compiled."""
    tail = max(min(p_below, p_above), _SMALLEST_PROBABILITY)
    wanted = math.log(tail)
    z = math.sqrt(-2.0 * wanted)  # never less than the solution, and so Newton's steps converge
    for _ in range(_ROUNDS):
        q = 0.5 * math.erfc(z / _ROOT2)
        step = (math.log(q) - wanted) * q * ROOT_TAU * math.exp(0.5 * z * z)
        z += step
        if abs(step) < _SETTLED:  # the next step is about its square
            break
    return z if p_above < p_below else -z


def square(p_lower: tuple[float, float], p_upper: tuple[float, float]) -> float:
    """Mean of z² over a reading that is known to lie between two values; runs compiled.

    `p_lower` has the probabilities below and above the smaller value, `p_upper` those of the other.
    """
    a, b = score(p_lower[0], p_lower[1]), score(p_upper[0], p_upper[1])
    inside = min(p_upper[0] - p_lower[0], 1.0) if p_lower[0] < 0.5 else p_lower[1] - p_upper[1]
    if inside < _THIN or b - a < _NARROW:
        return 0.5 * (a * a + b * b)
    at_a, at_b = math.exp(-0.5 * a * a), math.exp(-0.5 * b * b)
    return 1.0 + (a * at_a - b * at_b) / (ROOT_TAU * inside)


def mean(squares: Floats) -> Nis | None:
    """Mean of z² and the 95 % interval in which it lies if the model is right.

    The means of consecutive parts show how much the whole mean varies. So the interval is right for
    innovations that are correlated within a part, and for any distribution. `squares` are in the
    order of time (n,), NaN where the filter did not use the sample. None for too few innovations,
    and where all are zero.
    """
    finite_squares = squares[np.isfinite(squares)]
    if len(finite_squares) < _FEWEST or not finite_squares.any():
        return None
    groups = np.array_split(
        finite_squares, min(max(len(finite_squares) // _SMALLEST_PART, 4), _BLOCKS)
    )
    overall, means = float(finite_squares.mean()), [x.mean() for x in groups]
    error = float(np.std(means, ddof=1)) / math.sqrt(len(groups))
    half_width = coverage_factor(len(groups) - 1) * error / overall
    return Nis(overall, max(1.0 - half_width, 0.0), 1.0 + half_width)
