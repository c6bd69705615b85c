"""Nonlinear extended state observer: as LESO, but small errors are fed back more strongly.

    ε = ω̂ − y
    dω̂/dt = d̂ − aφK − β1 fal(ε, α1, δ)                                              (9)
    dd̂/dt = −β2 fal(ε, α2, δ),  F̂ = d̂/a
    fal(x, α, δ) = sgn(x)|x|^α,  linear for |x| ≤ δ                                 (10)

State scaled to d = aF as in LESO. The printed h2 is δ.

fal(ε) is a gain times ε, and between samples that gain changes slowly. A step is therefore the
exact step of the linear observer with the gains at the middle of the step. Half a step with the
gains at its start gives the middle. The method is of second order. The gains are positive, so it is
stable at every h.
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import HAN, PAPER
from ._linear_observer import (
    Gains,
    Inputs,
    State,
    advance,
    decay,
    gains,
    init,
    inputs,
    longest_euler,
)

__all__ = ["ABOUT", "Params", "State", "init", "longest_step", "step"]

SUBSTEPS = 4096.0  # at most; by then the observer has long settled


class Params(NamedTuple):
    """Gains; the paper's Table 1."""

    beta1: Annotated[float, Quantity("1/s", "gain β1 on ω̂", 0.01, 1e5)] = 216.0
    beta2: Annotated[float, Quantity("1/s²", "gain β2 on d̂ = aF̂", 0.01, 1e8)] = 216.0
    alpha1: Annotated[float, Quantity("-", "exponent α1 of the error in ω̂", 0.0, 1.0)] = 1.0
    alpha2: Annotated[float, Quantity("-", "exponent α2 of the error in d̂", 0.0, 1.0)] = 0.5
    delta: Annotated[float, Quantity("rad/s", "half-width δ of the linear zone", 1e-6, 10.0)] = 0.02
    euler: Annotated[float, Quantity("-", "1: forward Euler step, as printed", 0.0, 1.0)] = 0.0


def fal_gain(x: float, alpha: float, delta: float) -> float:
    """fal(x, α, δ)/x, the gain with which (10) feeds `x` back: finite and positive at every x."""
    return math.pow(max(abs(x), delta), alpha - 1.0)  # (10)


def gains_at(p: Params, e: float) -> Gains:
    """The linear observer that (9) is at error `e`; its gains are highest where |ε| ≤ δ."""
    beta1 = p.beta1 * fal_gain(e, p.alpha1, p.delta)  # (10)
    beta2 = p.beta2 * fal_gain(e, p.alpha2, p.delta)
    return gains(beta1, beta2)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    highest = gains_at(p, 0.0)
    fastest = 2.0 * highest.sigma + math.sqrt(highest.beta2)  # rate of the fastest change [1/s]
    n = 1.0 if p.euler > 0.0 else float(math.ceil(min(h * fastest, SUBSTEPS)))
    tau, line = h / n, inputs(w, s, h, K, y, p.euler)
    e, d = s.e, s.d
    for i in range(int(n)):
        u = Inputs(line.kappa + float(i) * tau * line.kappa_rate, line.kappa_rate, line.y_rate)
        start = gains_at(p, e)
        midpoint = advance(e, d, start, decay(start, 0.5 * tau, 0.0), 0.5 * tau, u)
        middle = start if p.euler > 0.0 else gains_at(p, midpoint[0])
        e, d = advance(e, d, middle, decay(middle, tau, p.euler), tau, u)  # (9)
    return State(e, d, K, y, d / w.a)


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    highest = gains_at(p, 0.0)
    return longest_euler(2.0 * highest.sigma, highest.beta2) if p.euler > 0.0 else float("inf")


ABOUT = About(
    title="Nonlinear extended state observer",
    source=f"{PAPER}, (8)-(10); fal: {HAN}",
    claims={"service-brake": Claim(116.0, 0.15), "low-adhesion": Claim(79.0, 0.155)},
)
