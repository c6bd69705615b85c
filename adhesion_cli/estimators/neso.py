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
from . import PAPER
from ._han import HAN, fal_gain
from ._observer import Gains, Inputs, State, advance, euler_step, init, lines, longest_euler

__all__ = ["ABOUT", "Params", "State", "init", "longest_step", "step"]

SUBSTEPS = 4096  # at most; by then the observer has long settled


class Params(NamedTuple):
    """Gains; the paper's Table 1."""

    beta1: Annotated[float, Quantity("1/s", "gain β1 on ω̂", 0.01, 1e5)] = 216.0
    beta2: Annotated[float, Quantity("1/s²", "gain β2 on d̂ = aF̂", 0.01, 1e8)] = 216.0
    alpha1: Annotated[float, Quantity("-", "exponent α1 of the error in ω̂", 0.0, 1.0)] = 1.0
    alpha2: Annotated[float, Quantity("-", "exponent α2 of the error in d̂", 0.0, 1.0)] = 0.5
    delta: Annotated[float, Quantity("rad/s", "half-width δ of the linear zone", 1e-6, 10.0)] = 0.02
    euler: Annotated[float, Quantity("-", "1: forward Euler step, as printed", 0.0, 1.0)] = 0.0


def gains(p: Params, e: float) -> Gains:
    """The gains of the linear observer that (9) is at error `e`."""
    return Gains(p.beta1 * fal_gain(e, p.alpha1, p.delta), p.beta2 * fal_gain(e, p.alpha2, p.delta))


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    if p.euler > 0.0:
        return euler_step(w, s, h, K, y, gains(p, s.e))  # (9)
    kappa, kappa_rate, y_rate = lines(w, s, h, K, y)
    highest = gains(p, 0.0)
    n = math.ceil(min(h * (highest.b1 + math.sqrt(highest.b2)), SUBSTEPS))
    tau = h / n
    e, d = s.e, s.d
    for i in range(n):
        of = Inputs(kappa + i * tau * kappa_rate, kappa_rate, y_rate)
        middle, _ = advance(e, d, gains(p, e), 0.5 * tau, of)
        e, d = advance(e, d, gains(p, middle), tau, of)  # (9)
    return State(e, d, K, y, d / w.a)


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    return longest_euler(gains(p, 0.0)) if p.euler > 0.0 else float("inf")


ABOUT = About(
    title="Nonlinear extended state observer",
    source=f"{PAPER}, (8)-(10); fal: {HAN}",
    claims={"service-brake": Claim(116.0, 0.15), "low-adhesion": Claim(79.0, 0.155)},
)
