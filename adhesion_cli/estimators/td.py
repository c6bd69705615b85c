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
from . import PAPER
from ._han import HAN, fhan

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


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """x1 = y, x2 = 0."""
    return State(0.0 if p.from_zero > 0.0 else y, 0.0, y, w.phi * K)


class Fixed(NamedTuple):
    """What the parameters decide."""

    r: float  # [rad/s³]
    h0: float  # [s]
    middle: float  # where in a sub-step the rates are taken: 0.5, or 0 for forward Euler


class Across(NamedTuple):
    """And the interval."""

    parts: float  # sub-steps
    share: float  # of one
    h: float  # length of one [s]
    h0: float  # [s]


def fixed(p: Params) -> Fixed:
    """The midpoint rule, or forward Euler."""
    return Fixed(p.r, p.h0, 0.0 if p.euler > 0.0 else 0.5)


def across(f: Fixed, h: float) -> Across:
    """An interval of `h` [s]."""
    h0 = f.h0 if f.h0 > 0.0 else h
    if f.middle == 0.0:
        return Across(1.0, 1.0, h, h0)
    n = float(math.ceil(min(4.0 * h / h0, SUBSTEPS)))
    tau = h * (1.0 / n)
    return Across(n, 1.0 / n, tau, max(h0, 4.0 * tau))


def part(  # noqa: PLR0913 (as `step`, with the sub-step)
    f: Fixed, q: Across, w: Wheelset, s: State, K: float, y: float, i: float
) -> State:
    """Sub-step `i` = 0, 1, … of an interval."""
    dv = (y - s.y) * q.share
    v, ahead = s.y + i * dv, f.middle * q.h
    middle = s.x2 + ahead * fhan(s.x1 - v, s.x2, f.r, q.h0)
    rate = fhan(s.x1 + ahead * s.x2 - v - f.middle * dv, middle, f.r, q.h0)  # (4)
    x2 = s.x2 + q.h * rate
    last = i + 1.0 >= q.parts
    F = w.phi * K + x2 * w.per_a  # (5)
    return State(s.x1 + q.h * middle, x2, y if last else s.y, F)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    f = fixed(p)
    q = across(f, h)
    for i in range(int(q.parts)):
        s = part(f, q, w, s, K, y, float(i))
    return s


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    return 2.0 * p.h0 if p.euler > 0.0 and p.h0 > 0.0 else float("inf")


ABOUT = About(
    title="Tracking differentiator",
    source=f"{PAPER}, (4) (5); fhan: {HAN}",
    claims={"service-brake": Claim(16.5, 0.0), "low-adhesion": Claim(108.0, 0.03)},
)
