"""What leso, neso and gradient share: state, start, and the step of the linear observer.

    dε/dt = d̂ − κ − dy/dt − β1 ε,  dd̂/dt = −β2 ε,  κ = aφK

That is (9) with f = ε; (11)-(14) come to the same with β1 = λ, β2 = p. The homogeneous part decays
with s² + β1 s + β2 = 0. `Modes` holds what the gains decide of that, `Decay` what an interval does.
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


class Modes(NamedTuple):
    """What the feedback of ε decides."""

    sigma: float  # β1/2 [1/s]
    b2: float  # β2 > 0 [1/s²]
    per_b2: float  # 1/β2 [s²]
    D: float  # σ² − β2: below 0 the error oscillates [1/s²]
    r: float  # √|D| [1/s]
    slow: float  # rate at which the error decays at last [1/s]


class Decay(NamedTuple):
    """(ε, d̂) after an interval without inputs: C + S (−σ, 1; −β2, σ) times what it was."""

    C: float  # [-]
    S: float  # [s]


class Fixed(NamedTuple):
    """What the parameters of a linear observer decide."""

    modes: Modes
    euler: float  # 1: forward Euler step


class Across(NamedTuple):
    """And the interval."""

    h: float  # [s]
    per_h: float  # [1/s]
    decay: Decay


class Inputs(NamedTuple):
    """K and y between two samples: straight lines, or held for forward Euler."""

    kappa: float  # κ = aφK at the start [rad/s²]
    kappa_rate: float  # [rad/s³]
    y_rate: float  # [rad/s²]


def init(p: Any, w: Wheelset, K: float, y: float) -> State:
    """ω̂ = y, F̂ = 0."""
    return State(0.0, 0.0, K, y, 0.0)


def modes(b1: float, b2: float) -> Modes:
    """Of the gains β1 > 0 [1/s] and β2 > 0 [1/s²]; no difference of equal numbers occurs."""
    sigma = 0.5 * b1
    D = sigma * sigma - b2
    r = math.sqrt(abs(D))
    return Modes(sigma, b2, 1.0 / b2, D, r, b2 / (sigma + r) if D >= 0.0 else sigma)


def decayed(m: Modes, h: float, euler: float) -> Decay:
    """After `h` [s], exact and stable at every `h`; by forward Euler stable up to a longest `h`."""
    if euler > 0.0:
        return Decay(1.0 - m.sigma * h, h)
    slow = math.exp(-m.slow * h)
    if m.D >= 0.0:  # two real roots; written so that neither overflow nor cancellation can occur
        gap = -math.expm1(-2.0 * m.r * h)
        c, s = 1.0 - 0.5 * gap, 0.5 * gap
    else:
        c, s = math.cos(m.r * h), math.sin(m.r * h)
    return Decay(slow * c, slow * (s / m.r if m.r > 0.0 else h))


def across(f: Fixed, h: float) -> Across:
    """An interval of `h` [s]."""
    return Across(h, 1.0 / h, decayed(f.modes, h, f.euler))


def part(f: Fixed, q: Across, w: Wheelset, s: State, K: float, y: float) -> State:
    """One sample on."""
    e, d = advance(s.e, s.d, f.modes, q.decay, q.h, lines(w, s, q.per_h, K, y, f.euler))
    return State(e, d, K, y, d * w.per_a)


def lines(w: Wheelset, s: State, per_h: float, K: float, y: float, euler: float) -> Inputs:
    """The inputs from the sample before to this one, 1/`per_h` [s] later."""
    bend = 0.0 if euler > 0.0 else w.a * w.phi * (K - s.K) * per_h
    return Inputs(w.a * w.phi * s.K, bend, (y - s.y) * per_h)


def advance(e: float, d: float, m: Modes, by: Decay, h: float, of: Inputs) -> tuple[float, float]:
    """ε and d̂ after `h` [s].

    For straight κ and y, ε = −κ̇/β2 and d̂ = ẏ + κ − κ̇ β1/β2 is a solution. The difference from it
    decays.
    """
    e_line = -of.kappa_rate * m.per_b2
    d_line = of.y_rate + of.kappa + 2.0 * m.sigma * e_line
    e0, d0 = e - e_line, d - d_line
    e1 = by.C * e0 + by.S * (d0 - m.sigma * e0)
    d1 = by.C * d0 + by.S * (m.sigma * d0 - m.b2 * e0)
    return e1 + e_line, d1 + d_line + of.kappa_rate * h


def longest_euler(b1: float, b2: float) -> float:
    """Longest h [s] at which forward Euler of the same observer is stable: |1 + h s| < 1."""
    D = b1 * b1 - 4.0 * b2
    return 4.0 / (b1 + math.sqrt(D)) if D >= 0.0 else b1 / b2
