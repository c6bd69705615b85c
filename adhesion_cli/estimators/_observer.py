"""What leso, neso and gradient share: state, start, and both steps of the linear observer.

    dε/dt = d̂ − κ − dy/dt − β1 ε,  dd̂/dt = −β2 ε,  κ = aφK

That is (9) with f = ε; (11)-(14) come to the same with β1 = λ, β2 = p.
"""

import math
from typing import Any, NamedTuple

from ..core.model import Wheelset


class State(NamedTuple):
    """Error and force, and the sample before."""

    e: float  # ε = ω̂ − y [rad/s]
    d: float  # d̂ = aF̂ [rad/s²]
    K: float  # [N]
    y: float  # [rad/s]
    F: float  # [N]


class Gains(NamedTuple):
    """Feedback of ε."""

    b1: float  # β1 > 0 [1/s]
    b2: float  # β2 > 0 [1/s²]


class Inputs(NamedTuple):
    """K and y as straight lines between two samples."""

    kappa: float  # κ = aφK at the start [rad/s²]
    kappa_rate: float  # [rad/s³]
    y_rate: float  # [rad/s²]


def init(p: Any, w: Wheelset, K: float, y: float) -> State:
    """ω̂ = y, F̂ = 0."""
    return State(0.0, 0.0, K, y, 0.0)


def lines(w: Wheelset, s: State, h: float, K: float, y: float) -> Inputs:
    """The inputs from the sample before to this one."""
    return Inputs(w.a * w.phi * s.K, w.a * w.phi * (K - s.K) / h, (y - s.y) / h)


def exact_step(w: Wheelset, s: State, h: float, K: float, y: float, gains: Gains) -> State:
    """One sample on, exact for straight lines between the samples; stable at every `h`."""
    e, d = advance(s.e, s.d, gains, h, lines(w, s, h, K, y))
    return State(e, d, K, y, d / w.a)


def euler_step(w: Wheelset, s: State, h: float, K: float, y: float, gains: Gains) -> State:
    """One sample on by forward Euler, as printed; stable up to `longest_euler`."""
    e = s.e + s.y - y + h * (s.d - w.a * w.phi * s.K - gains.b1 * s.e)
    d = s.d - h * gains.b2 * s.e
    return State(e, d, K, y, d / w.a)


def advance(e: float, d: float, gains: Gains, h: float, of: Inputs) -> tuple[float, float]:
    """ε and d̂ after `h` [s].

    For straight κ and y, ε = −κ̇/β2 and d̂ = ẏ + κ − κ̇ β1/β2 is a solution. The difference from it
    decays with s² + β1 s + β2 = 0.
    """
    b1, b2 = gains
    e_line = -of.kappa_rate / b2
    d_line = of.y_rate + of.kappa + b1 * e_line
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
    return e1 + e_line, d1 + d_line + of.kappa_rate * h


def longest_euler(gains: Gains) -> float:
    """Longest h [s] at which forward Euler of the same observer is stable: |1 + h s| < 1."""
    b1, b2 = gains
    D = b1 * b1 - 4.0 * b2
    return 4.0 / (b1 + math.sqrt(D)) if D >= 0.0 else b1 / b2
