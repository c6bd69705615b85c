"""Differentiation by a tracking differentiator: x1 follows y as fast as a rate r of x2 allows.

    dx1/dt = x2,  dx2/dt = fhan(x1 − y, x2, r, h0)                                  (4)
    F̂ = φK + x2/a                                                                   (5)

Departures. The paper's filter step h0 is the sample interval, so that noise and delay depend on
the log's rate. Here it is a separate time; x2 lags by 2 h0. (4) is integrated by the midpoint rule
in steps of at most h0/4. The start is x1 = y. The paper's Table 2 needs x1 = 0 (`from_zero`): its
1.52 s is the time in which x1 reaches the wheel's speed.
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import HAN, PAPER

SUBSTEPS = 4096.0  # at most; beyond, the filter step widens with the interval


class Params(NamedTuple):
    """r is the paper's Table 1; h0 is ours, the 32 ms its train bus may take: no data is newer."""

    r: Annotated[float, Quantity("rad/s³", "bound r on the rate of x2", 1e-3, 1e6)] = 100.0
    h0: Annotated[float, Quantity("s", "filter step; 0: interval, as printed", 0.0, 10.0)] = 0.03
    from_zero: Annotated[float, Quantity("-", "1: start at x1 = 0, as printed", 0.0, 1.0)] = 0.0
    euler: Annotated[float, Quantity("-", "1: forward Euler step, as printed", 0.0, 1.0)] = 0.0


class State(NamedTuple):
    """Differentiator, and the sample before."""

    x1: float  # follows ω [rad/s]
    x2: float  # follows dω/dt [rad/s²]
    y: float  # [rad/s]
    F: float  # [N]


def fhan(x1: float, x2: float, r: float, h: float) -> float:
    """The rate of x2, at most `r`, that brings x1 and x2 to 0 fastest and without chatter.

    Within about r h² of 0 it is linear, a double pole at −1/h.
    """
    d = r * h * h
    a0 = h * x2
    y = x1 + a0
    if abs(y) <= d:
        a = a0 + y
    else:
        a1 = math.sqrt(d * (d + 8.0 * abs(y)))
        a = a0 + math.copysign(0.5 * (a1 - d), y)
    return -(r / d) * a if abs(a) <= d else -math.copysign(r, a)


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """x1 = y, x2 = 0."""
    return State(0.0 if p.from_zero > 0.0 else y, 0.0, y, w.phi * K)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    n, h0 = 1.0, p.h0 if p.h0 > 0.0 else h
    if p.euler == 0.0:
        n = float(math.ceil(min(4.0 * h / h0, SUBSTEPS)))
        h0 = max(h0, 4.0 * h / n)
    tau, dy = h / n, (y - s.y) / n
    middle_share = 0.0 if p.euler > 0.0 else 0.5  # the rates are those of the middle of a sub-step
    x1, x2 = s.x1, s.x2
    for i in range(int(n)):
        v = s.y + float(i) * dy
        x2_middle = x2 + middle_share * tau * fhan(x1 - v, x2, p.r, h0)
        rate = fhan(x1 + middle_share * tau * x2 - v - middle_share * dy, x2_middle, p.r, h0)  # (4)
        x1, x2 = x1 + tau * x2_middle, x2 + tau * rate  # (4)
    return State(x1, x2, y, w.phi * K + x2 / w.a)  # (5)


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    return 2.0 * p.h0 if p.euler > 0.0 and p.h0 > 0.0 else float("inf")


ABOUT = About(
    title="Tracking differentiator",
    source=f"{PAPER}, (4) (5); fhan: {HAN}",
    claims={"service-brake": Claim(16.5, 0.0), "low-adhesion": Claim(108.0, 0.03)},
)
