"""Nonlinear extended state observer: as LESO, small errors fed back more than in proportion.

    ε = ω̂ − y
    dω̂/dt = d̂ − aφK − β1 fal(ε, α1, δ)                                              (9)
    dd̂/dt = −β2 fal(ε, α2, δ),  F̂ = d̂/a
    fal(x, α, δ) = sgn(x)|x|^α,  linear for |x| ≤ δ                                 (10)

State scaled to d = aF as in LESO. The printed h2 is δ.

fal(ε) is a gain times ε, and between samples that gain changes slowly: the exact step of the
linear observer, with the gains of the middle of the step, twice over: half a step with the gains
at its start gives the middle. Second order, and as the gains are positive stable at every h.
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import PAPER
from ._han import HAN, fal_gain
from ._observer import advance, longest_euler

SUBSTEPS = 4096  # at most; by then the observer has long settled


class Params(NamedTuple):
    """Gains; the paper's Table 1."""

    beta1: Annotated[float, Quantity("1/s", "gain β1 on ω̂", 0.01, 1e5)] = 216.0
    beta2: Annotated[float, Quantity("1/s²", "gain β2 on d̂ = aF̂", 0.01, 1e8)] = 216.0
    alpha1: Annotated[float, Quantity("-", "exponent α1 of the error in ω̂", 0.0, 1.0)] = 1.0
    alpha2: Annotated[float, Quantity("-", "exponent α2 of the error in d̂", 0.0, 1.0)] = 0.5
    delta: Annotated[float, Quantity("rad/s", "half-width δ of the linear zone", 1e-6, 10.0)] = 0.02
    euler: Annotated[float, Quantity("-", "1: forward Euler step, as printed", 0.0, 1.0)] = 0.0


class State(NamedTuple):
    """Observer, and the sample before."""

    e: float  # ε = ω̂ − y [rad/s]
    d: float  # d̂ = aF̂ [rad/s²]
    K: float  # [N]
    y: float  # [rad/s]
    F: float  # [N]


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """ω̂ = y, F̂ = 0."""
    return State(0.0, 0.0, K, y, 0.0)


def gains(p: Params, e: float) -> tuple[float, float]:
    """The gains of the linear observer that (9) is at error `e`."""
    return p.beta1 * fal_gain(e, p.alpha1, p.delta), p.beta2 * fal_gain(e, p.alpha2, p.delta)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    kappa = w.a * w.phi * s.K
    if p.euler > 0.0:
        b1, b2 = gains(p, s.e)
        e, d = s.e + s.y - y + h * (s.d - kappa - b1 * s.e), s.d - h * b2 * s.e  # (9)
        return State(e, d, K, y, d / w.a)
    kappa_rate = w.a * w.phi * (K - s.K) / h
    y_rate = (y - s.y) / h
    b1, b2 = gains(p, 0.0)  # the highest
    n = math.ceil(min(h * (b1 + math.sqrt(b2)), SUBSTEPS))
    tau = h / n
    e, d = s.e, s.d
    for i in range(n):
        k = kappa + i * tau * kappa_rate
        b1, b2 = gains(p, e)
        middle, _ = advance(e, d, b1, b2, 0.5 * tau, k, kappa_rate, y_rate)
        b1, b2 = gains(p, middle)
        e, d = advance(e, d, b1, b2, tau, k, kappa_rate, y_rate)  # (9)
    return State(e, d, K, y, d / w.a)


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    b1, b2 = gains(p, 0.0)
    return longest_euler(b1, b2) if p.euler > 0.0 else float("inf")


ABOUT = About(
    title="Nonlinear extended state observer",
    source=f"{PAPER}, (8)-(10); fal: {HAN}",
    claims={"service-brake": Claim(116.0, 0.15), "low-adhesion": Claim(79.0, 0.155)},
)
