"""The linear observer both (9) with f = ε and (11)-(14) come to, and its exact step."""

import math


def advance(  # noqa: PLR0913
    e: float,
    d: float,
    b1: float,
    b2: float,
    h: float,
    kappa: float,
    kappa_rate: float,
    y_rate: float,
) -> tuple[float, float]:
    """One exact step of ε̇ = d̂ − κ − ẏ − β1 ε, d̂˙ = −β2 ε.

    Under κ and y that run straight, ε = −κ̇/β2, d̂ = ẏ + κ − κ̇ β1/β2 is a solution; what ε and d̂
    have beside it decays with s² + β1 s + β2 = 0.

    Args:
        e: ε = ω̂ − y [rad/s].
        d: d̂ = aF̂ [rad/s²].
        b1: gain β1 > 0 [1/s].
        b2: gain β2 > 0 [1/s²].
        h: length of the step [s].
        kappa: κ = aφK at its start [rad/s²].
        kappa_rate: slope of κ [rad/s³].
        y_rate: slope of y [rad/s²].

    Returns:
        ε and d̂ after `h`.
    """
    e_line = -kappa_rate / b2
    d_line = y_rate + kappa + b1 * e_line
    sigma = 0.5 * b1
    D = sigma * sigma - b2
    if D >= 0.0:  # two real roots; written so that neither overflow nor cancellation can occur
        r = math.sqrt(D)
        slow = math.exp(-b2 * h / (sigma + r))
        gap = -math.expm1(-2.0 * r * h)
        C = slow * (1.0 - 0.5 * gap)
        S = slow * (gap / (2.0 * r) if r > 0.0 else h)
    else:
        r = math.sqrt(-D)
        decay = math.exp(-sigma * h)
        C = decay * math.cos(r * h)
        S = decay * math.sin(r * h) / r
    e0, d0 = e - e_line, d - d_line
    e1 = C * e0 + S * (d0 - sigma * e0)
    d1 = C * d0 + S * (sigma * d0 - b2 * e0)
    return e1 + e_line, d1 + d_line + kappa_rate * h


def longest_euler(b1: float, b2: float) -> float:
    """Longest h [s] at which forward Euler of the same observer is stable: |1 + h s| < 1."""
    D = b1 * b1 - 4.0 * b2
    return 4.0 / (b1 + math.sqrt(D)) if D >= 0.0 else b1 / b2
