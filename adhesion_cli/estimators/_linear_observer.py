"""The linear observer that leso, neso and gradient have in common.

    dε/dt = d̂ − κ − dy/dt − β1 ε,  dd̂/dt = −β2 ε,  κ = aφK

That is (9) with f = ε; (11)-(14) come to the same with β1 = λ, β2 = p. Without inputs the state
decays with the roots of s² + β1 s + β2 = 0. `Gains` holds what the two gains decide of that,
`Decay` what an interval decides as well.
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
    """The feedback of ε, and its roots −σ ± √D."""

    sigma: float  # β1/2 [1/s]
    beta2: float  # β2 > 0 [1/s²]
    D: float  # σ² − β2: below 0 the error oscillates [1/s²]
    r: float  # √|D| [1/s]
    slow: float  # rate at which the error decays at last [1/s]


class Decay(NamedTuple):
    """(ε, d̂) after an interval without inputs: C + S (−σ, 1; −β2, σ) times what it was."""

    C: float  # [-]
    S: float  # [s]


class Inputs(NamedTuple):
    """K and y between two samples: straight lines, or constant for forward Euler."""

    kappa: float  # κ = aφK at the start [rad/s²]
    kappa_rate: float  # [rad/s³]
    y_rate: float  # [rad/s²]


def init(p: Any, w: Wheelset, K: float, y: float) -> State:
    """ω̂ = y, F̂ = 0."""
    return State(0.0, 0.0, K, y, 0.0)


def gains(beta1: float, beta2: float) -> Gains:
    """Of β1 > 0 [1/s] and β2 > 0 [1/s²]; no difference of equal numbers occurs."""
    sigma = 0.5 * beta1
    D = sigma * sigma - beta2
    r = math.sqrt(abs(D))
    return Gains(sigma, beta2, D, r, beta2 / (sigma + r) if D >= 0.0 else sigma)


def decay(g: Gains, h: float, euler: float) -> Decay:
    """After `h` [s]: exact and stable at every `h`; forward Euler is stable up to a longest `h`."""
    if euler > 0.0:
        return Decay(1.0 - g.sigma * h, h)
    slow = math.exp(-g.slow * h)
    if g.D >= 0.0:  # two real roots; written so that neither overflow nor cancellation can occur
        gap = -math.expm1(-2.0 * g.r * h)
        c, s = 1.0 - 0.5 * gap, 0.5 * gap
    else:
        c, s = math.cos(g.r * h), math.sin(g.r * h)
    return Decay(slow * c, slow * (s / g.r if g.r > 0.0 else h))


def inputs(w: Wheelset, s: State, h: float, K: float, y: float, euler: float) -> Inputs:
    """The inputs from the sample before to this one, `h` [s] later."""
    kappa_rate = 0.0 if euler > 0.0 else w.a * w.phi * (K - s.K) / h
    return Inputs(w.a * w.phi * s.K, kappa_rate, (y - s.y) / h)


def advance(
    e: float, d: float, g: Gains, decayed: Decay, h: float, u: Inputs
) -> tuple[float, float]:
    """ε and d̂ after `h` [s].

    For straight κ and y, ε = −κ̇/β2 and d̂ = ẏ + κ − κ̇ β1/β2 is a solution. The difference from it
    decays.
    """
    e_line = -u.kappa_rate / g.beta2
    d_line = u.y_rate + u.kappa + 2.0 * g.sigma * e_line
    e0, d0 = e - e_line, d - d_line
    e1 = decayed.C * e0 + decayed.S * (d0 - g.sigma * e0)
    d1 = decayed.C * d0 + decayed.S * (g.sigma * d0 - g.beta2 * e0)
    return e1 + e_line, d1 + d_line + u.kappa_rate * h


def observe(  # noqa: PLR0913 (a step, and the gains)
    g: Gains, euler: float, w: Wheelset, s: State, h: float, K: float, y: float
) -> State:
    """One sample on, with constant gains."""
    e, d = advance(s.e, s.d, g, decay(g, h, euler), h, inputs(w, s, h, K, y, euler))
    return State(e, d, K, y, d / w.a)


def longest_euler(beta1: float, beta2: float) -> float:
    """Longest h [s] at which forward Euler of the same observer is stable: |1 + h s| < 1."""
    D = beta1 * beta1 - 4.0 * beta2
    return 4.0 / (beta1 + math.sqrt(D)) if D >= 0.0 else beta1 / beta2
