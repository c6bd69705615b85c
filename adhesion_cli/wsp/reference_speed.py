"""Reference speed: the train speed of a WSP controller that measures none, and its doubt.

While an axle rolls, the fastest one gives the train speed (`physics.reference_speed`). An axle may
slide from the moment its controller uses the valves, or its rim is slower. If all may slide, v
follows (1) with the estimated forces, v̇ = −ΣF̂/Σm, but is never below the fastest rim. So wheels
that creep away together do not pull it down. φ, mass and gradient make v uncertain by a share of
all that was integrated:

    doubt = ∫ `_SHARE` ΣF̂/Σm dt.

A wheel rolls again where F̂ is well below the recent adhesion force and its rim speed is even. After
a slide F̂ falls from the peak to what the brake takes, while a slower rim accelerates. If that does
not happen and the doubt exceeds `_DOUBTFUL` of v, the fastest axle becomes the pilot. Its brake is
released until it rolls and shows v, as WSPs in service do.

Plain Python that compiles. The constants are ours; their influence is small
(docs/explanation/antiskid.md).
"""

import math
from typing import NamedTuple

from ..core.controller import APPLY, DUMP, HOLD
from ..core.model import Wheelset
from ..core.physics import GRADIENT, HARDER, reference_speed

_SHARE = 0.1  # error of the estimated deceleration, as φ alone often has
_DOUBTFUL = 0.05  # share of v
_BEHIND, _NEAR = 0.015, 0.1  # largest lag of a rolling rim: share of v, and [m/s]
_LESS = 0.7  # share of the recent adhesion force; below it, a wheel rolls
_LEFT = 0.8 * _LESS  # share of it that a pilot's brake keeps
_FORGET = 2.0  # time constant of the recent adhesion force [s]
_EVEN = 0.05  # least time of an even rim speed [s]
_LITTLE = 1.0  # least adhesion force of a wheel that may slide, as 0 means that it rolls [N]
NONE = -1


class Known(NamedTuple):
    """The train as the WSP controller knows it."""

    v: float  # speed [m/s]
    doubt: float  # its possible error [m/s]
    pilot: int  # index of the axle whose brake is released, or `NONE`


class Witness(NamedTuple):
    """Whether an axle shows the train's speed."""

    given: float  # recent adhesion force since the axle may slide [N]; 0 while it rolls
    even: float  # time since the rim changed faster than a train does [s]


def further(before: Known, rolls: bool, fastest: float, slowing: float, h: float) -> Known:
    """The train one step later.

    Args:
        before: at the step before.
        rolls: whether any axle does.
        fastest: largest rim speed [m/s].
        slowing: ΣF̂/Σm [m/s²].
        h: interval [s].
    """
    if rolls:
        return Known(reference_speed(before.v, fastest, slowing, h), 0.0, before.pilot)
    v = max(before.v - slowing * h, fastest)  # (1)
    return Known(v, before.doubt + _SHARE * slowing * h, before.pilot)


def watched(  # noqa: PLR0913 (compiled: plain floats)
    w: Wheelset, before: Witness, v: float, slowing: float, rim: float, K: float, F: float,
    valve: int, h: float,
) -> Witness:  # fmt: skip
    """An axle one step later; `valve` is from the step before, the rest from this one."""
    rate = w.radius**2 / w.inertia * (F - w.phi * K)  # (1)
    even = before.even + h if abs(rate) < HARDER * slowing + GRADIENT else 0.0
    if before.given == 0.0:
        slides = valve != APPLY or v - rim > _BEHIND * v + _NEAR
        return Witness(max(F, _LITTLE) if slides else 0.0, even)
    given = max(F, before.given * math.exp(-h / _FORGET), _LITTLE)
    return Witness(0.0 if even > _EVEN and _LESS * given > F else given, even)


def asks_pilot(train: Known) -> bool:
    """Whether a pilot is needed, and no axle is one."""
    return train.pilot == NONE and train.doubt > _DOUBTFUL * train.v


def pilots_valve(w: Wheelset, x: Witness, K: float) -> int:
    """The pilot's valve: the brake is released below the adhesion force, then held."""
    return DUMP if w.phi * K > _LEFT * x.given else HOLD
