"""Han's two functions."""

import math

HAN = (
    "Han J.: From PID to active disturbance rejection control, "
    "IEEE Transactions on Industrial Electronics 56 (2009) 900-906"
)


def fal_gain(x: float, alpha: float, delta: float) -> float:
    """fal(x, α, δ)/x, the gain with which (10) feeds `x` back: finite and positive at every x."""
    return math.pow(max(abs(x), delta), alpha - 1.0)  # (10)


def fhan(x1: float, x2: float, r: float, h: float) -> float:
    """The rate of x2, at most `r`, that brings x1 and x2 to 0 fastest and without chatter.

    Within about r h² of 0 it is linear, a double pole at −1/h.
    """
    d = r * h * h
    a0 = h * x2
    y = x1 + a0
    if abs(y) <= d:
        a = a0 + y
    else:
        a1 = math.sqrt(d * (d + 8.0 * abs(y)))
        a = a0 + math.copysign(0.5 * (a1 - d), y)
    return -(r / d) * a if abs(a) <= d else -math.copysign(r, a)
