"""Linear extended state observer: the adhesion force as one more state, errors fed back linearly.

    ε = ω̂ − y
    dω̂/dt = d̂ − aφK − β1 ε                                                               (9)
    dd̂/dt = −β2 ε,  F̂ = d̂/a

The printed (9) has F̂ itself as second state. With its β2 that takes 17 minutes. Scaled to d = aF
it gives the 2.99 s of the paper's Table 2, so this is what was run there.

The state holds ε in place of ω̂.
"""

from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import PAPER
from ._linear_observer import State, gains, init, longest_euler, observe

__all__ = ["ABOUT", "Params", "State", "init", "longest_step", "step"]


class Params(NamedTuple):
    """Gains; the paper's Table 1."""

    beta1: Annotated[float, Quantity("1/s", "gain β1 on ω̂", 0.01, 1e5)] = 216.0
    beta2: Annotated[float, Quantity("1/s²", "gain β2 on d̂ = aF̂", 0.01, 1e8)] = 216.0
    euler: Annotated[float, Quantity("-", "1: forward Euler step, as printed", 0.0, 1.0)] = 0.0


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    return observe(gains(p.beta1, p.beta2), p.euler, w, s, h, K, y)  # (9)


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    return longest_euler(p.beta1, p.beta2) if p.euler > 0.0 else float("inf")


ABOUT = About(
    title="Linear extended state observer",
    source=f"{PAPER}, (8) (9) with f = ε",
    claims={"service-brake": Claim(630.0, 0.88), "low-adhesion": Claim(340.0, 0.96)},
)
