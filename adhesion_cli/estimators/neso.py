"""Nonlinear extended state observer: as LESO, but small errors are fed back more strongly.

    ε = ω̂ − y
    dω̂/dt = d̂ − aφK − β1 fal(ε, α1, δ)                                              (9)
    dd̂/dt = −β2 fal(ε, α2, δ),  F̂ = d̂/a
    fal(x, α, δ) = sgn(x)|x|^α,  linear for |x| ≤ δ                                 (10)

State scaled to d = aF as in LESO. The printed h2 is δ.

fal(ε) is a gain times ε, and between samples that gain changes slowly. A step is therefore the
exact step of the linear observer with the gains at the middle of the step. Half a step with the
gains at its start gives the middle. The method is of second order. The gains are positive, so it is
stable at every h. Within |ε| ≤ δ the gains are constant. Both halves of a step then have the same
matrix, which only the interval decides.
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.model import Quantity, Wheelset
from . import PAPER
from ._han import HAN, fal_gain
from ._observer import (
    Decay,
    Inputs,
    Modes,
    State,
    advance,
    decayed,
    init,
    lines,
    longest_euler,
    modes,
)

__all__ = ["ABOUT", "Params", "State", "across", "fixed", "init", "longest_step", "part", "step"]

SUBSTEPS = 4096.0  # at most; by then the observer has long settled
ALONE = True  # most samples are within the linear zone


class Params(NamedTuple):
    """Gains; the paper's Table 1."""

    beta1: Annotated[float, Quantity("1/s", "gain β1 on ω̂", 0.01, 1e5)] = 216.0
    beta2: Annotated[float, Quantity("1/s²", "gain β2 on d̂ = aF̂", 0.01, 1e8)] = 216.0
    alpha1: Annotated[float, Quantity("-", "exponent α1 of the error in ω̂", 0.0, 1.0)] = 1.0
    alpha2: Annotated[float, Quantity("-", "exponent α2 of the error in d̂", 0.0, 1.0)] = 0.5
    delta: Annotated[float, Quantity("rad/s", "half-width δ of the linear zone", 1e-6, 10.0)] = 0.02
    euler: Annotated[float, Quantity("-", "1: forward Euler step, as printed", 0.0, 1.0)] = 0.0


class Fixed(NamedTuple):
    """What the parameters decide."""

    p: Params
    linear: Modes  # in the linear zone, where the gains are the highest
    rate: float  # of the fastest change [1/s]


class Across(NamedTuple):
    """And the interval."""

    parts: float  # sub-steps
    h: float  # length of one [s]
    per_h: float  # over the whole interval [1/s]
    decay: Decay  # of half a sub-step in the linear zone


def at(p: Params, e: float) -> Modes:
    """The linear observer that (9) is at error `e`."""
    return modes(p.beta1 * fal_gain(e, p.alpha1, p.delta), p.beta2 * fal_gain(e, p.alpha2, p.delta))


def fixed(p: Params) -> Fixed:
    """The gains of the linear zone."""
    m = at(p, 0.0)
    return Fixed(p, m, 2.0 * m.sigma + math.sqrt(m.b2))


def across(f: Fixed, h: float) -> Across:
    """An interval of `h` [s]."""
    n = 1.0 if f.p.euler > 0.0 else float(math.ceil(min(h * f.rate, SUBSTEPS)))
    return Across(n, h / n, 1.0 / h, decayed(f.linear, 0.5 * h / n, 0.0))


def part(  # noqa: PLR0913 (as `step`, with the sub-step)
    f: Fixed, q: Across, w: Wheelset, s: State, K: float, y: float, i: float
) -> State:
    """Sub-step `i` = 0, 1, … of an interval; within the linear zone both halves are one matrix."""
    p, half = f.p, 0.5 * q.h
    kappa, kappa_rate, y_rate = lines(w, s, q.per_h, K, y, p.euler)
    start = Inputs(kappa + i * q.h * kappa_rate, kappa_rate, y_rate)
    near = abs(s.e) <= p.delta
    m = f.linear if near else at(p, s.e)
    by = q.decay if near else decayed(m, half, 0.0)
    e, d = advance(s.e, s.d, m, by, half, start)
    if near and abs(e) <= p.delta and p.euler == 0.0:
        middle = Inputs(start.kappa + half * kappa_rate, kappa_rate, y_rate)
        e, d = advance(e, d, m, by, half, middle)
    else:
        m = at(p, s.e if p.euler > 0.0 else e)
        e, d = advance(s.e, s.d, m, decayed(m, q.h, p.euler), q.h, start)  # (9)
    last = i + 1.0 >= q.parts
    return State(e, d, K if last else s.K, y if last else s.y, d * w.per_a)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    f = fixed(p)
    q = across(f, h)
    for i in range(int(q.parts)):
        s = part(f, q, w, s, K, y, float(i))
    return s


def longest_step(p: Params) -> float:
    """Longest stable interval [s]."""
    m = at(p, 0.0)
    return longest_euler(2.0 * m.sigma, m.b2) if p.euler > 0.0 else float("inf")


ABOUT = About(
    title="Nonlinear extended state observer",
    source=f"{PAPER}, (8)-(10); fal: {HAN}",
    claims={"service-brake": Claim(116.0, 0.15), "low-adhesion": Claim(79.0, 0.155)},
)
