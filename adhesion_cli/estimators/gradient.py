"""Negative gradient iteration: the force follows the gradient of the squared speed error.

Both sides of (1) pass the filter 1/(s + λ), so that ω need not be differentiated:  (11)

    dz/dt = d̂ − aφK − λz,  dy_f/dt = λ(y − y_f),  ω̂ = z + y_f                       (12)
    ε = ω̂ − y                                                                       (13)
    dd̂/dt = −p ε,  F̂ = d̂/a                                                          (14)

The printed (14) contains (1 − e^(−λt))/λ · a, although the filter of (11) already has that effect.
It converges at 5·10⁻⁶ 1/s. Without the factor the error obeys s² + λs + p = 0, the "approximately
second-order" convergence that the paper names.

z and y_f have the same pole λ, so their sum needs no state of its own. (12) in (13) gives
dε/dt = d̂ − aφK − dy/dt − λε. That is the linear observer of (9) with β1 = λ, β2 = p. Its exact step
replaces the printed trapezoidal rule for (14).
"""

from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import PAPER
from ._linear_observer import State, gains, init, longest_euler, observe

__all__ = ["ABOUT", "Params", "State", "init", "longest_step", "step"]


class Params(NamedTuple):
    """Filter and gain; the paper's Table 1."""

    lam: Annotated[float, Quantity("1/s", "corner λ of the filter", 0.01, 1e5, "lambda")] = 4.0
    p: Annotated[float, Quantity("1/s²", "gain p of the iteration", 0.01, 1e8)] = 10.0
    euler: Annotated[float, Quantity("-", "1: forward Euler step", 0.0, 1.0)] = 0.0


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    return observe(gains(p.lam, p.p), p.euler, w, s, h, K, y)  # (12) (13) (14)


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    return longest_euler(p.lam, p.p) if p.euler > 0.0 else float("inf")


ABOUT = About(
    title="Negative gradient iteration",
    source=f"{PAPER}, (11)-(14)",
    claims={"service-brake": Claim(342.0, 0.43), "low-adhesion": Claim(204.0, 0.455)},
)
