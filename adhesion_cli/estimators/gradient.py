"""Negative gradient iteration: the force slides down the gradient of the squared speed error.

Both sides of (1) pass the filter 1/(s + λ), which spares differentiating ω:        (11)

    dz/dt = d̂ − aφK − λz,  dy_f/dt = λ(y − y_f),  ω̂ = z + y_f                       (12)
    ε = ω̂ − y                                                                       (13)
    dd̂/dt = −p ε,  F̂ = d̂/a                                                          (14)

The printed (14) multiplies by (1 − e^(−λt))/λ · a once more than the filter of (11) already does,
and converges at 5·10⁻⁶ 1/s; without it the error obeys s² + λs + p = 0, the "approximately
second-order" convergence that the paper names.

z and y_f share the pole λ, so what they add up to needs no state of its own: (12) in (13) gives
dε/dt = d̂ − aφK − dy/dt − λε. That is the linear observer of (9) with β1 = λ, β2 = p; the printed
trapezoidal rule for (14) is replaced by its exact step.
"""

from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import PAPER
from ._observer import advance, longest_euler


class Params(NamedTuple):
    """Filter and gain; the paper's Table 1."""

    lam: Annotated[float, Quantity("1/s", "corner λ of the filter", 0.01, 1e5, "lambda")] = 4.0
    p: Annotated[float, Quantity("1/s²", "gain p of the iteration", 0.01, 1e8)] = 10.0
    euler: Annotated[float, Quantity("-", "1: forward Euler step", 0.0, 1.0)] = 0.0


class State(NamedTuple):
    """Error and force, and the sample before."""

    e: float  # ε = z + y_f − y [rad/s]
    d: float  # d̂ = aF̂ [rad/s²]
    K: float  # [N]
    y: float  # [rad/s]
    F: float  # [N]


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """ω̂ = y with z = 0 and y_f = y; F̂ = 0."""
    return State(0.0, 0.0, K, y, 0.0)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    if p.euler > 0.0:
        e = s.e + s.y - y + h * (s.d - w.a * w.phi * s.K - p.lam * s.e)  # (12) (13)
        d = s.d - h * p.p * s.e  # (14)
    else:
        kappa = w.a * w.phi * s.K
        kappa_rate = w.a * w.phi * (K - s.K) / h
        y_rate = (y - s.y) / h
        e, d = advance(s.e, s.d, p.lam, p.p, h, kappa, kappa_rate, y_rate)  # (12) (13) (14)
    return State(e, d, K, y, d / w.a)


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    return longest_euler(p.lam, p.p) if p.euler > 0.0 else float("inf")


ABOUT = About(
    title="Negative gradient iteration",
    source=f"{PAPER}, (11)-(14)",
    claims={"service-brake": Claim(342.0, 0.43), "low-adhesion": Claim(204.0, 0.455)},
)
