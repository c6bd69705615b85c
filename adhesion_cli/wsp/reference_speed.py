"""Train speed for a unit that measures none: the reference speed of its axles, and its doubt.

While an axle rolls, the fastest is the train (`physics.reference_speed`). An axle may slide from
the moment its controller touches the valves, or its rim falls behind. Where all may, v goes on by
(1) with the estimated forces, v̇ = −ΣF̂/Σm, never below the fastest rim: wheels that creep off
together cannot take it along. What is not known of the forces, from φ, mass and gradient, makes v
doubtful by a share of all that was integrated:

    doubt = ∫ `_SHARE` ΣF̂/Σm dt.

A wheel rolls again where F̂ is well below what the rail has lately given it and its rim is even: on
the way back from a slide F̂ falls behind the peak to what the brake takes, while a rim that is still
slower than the train runs up. Where that does not happen by itself and the doubt comes to more than
`_DOUBTFUL` of v, one axle at a time, the fastest, is the pilot: its brake is let out until it runs
up and shows v, as slide protection in service does.

Plain Python that compiles; the constants are ours, and little depends on them (docs/validation.md).
"""

import math
from typing import NamedTuple

from ..core.controller import APPLY, HOLD, VENT
from ..core.model import Wheelset
from ..core.physics import GRADIENT, HARDER, reference_speed

_SHARE = 0.1  # of the estimated deceleration that may be untrue, as φ alone often is
_DOUBTFUL = 0.05  # share of v
_BEHIND, _NEAR = 0.015, 0.1  # a rim that rolls lags by no more than this share of v, and [m/s]
_LESS = 0.7  # share of what the rail gave; a wheel that takes less rolls
_LEFT = 0.8 * _LESS  # share of it that a pilot's brake keeps
_FORGET = 2.0  # time constant of what the rail gave [s]
_EVEN = 0.05  # how long a rim has to be even [s]
_LITTLE = 1.0  # for nothing given, as 0 is a wheel that rolls [N]
NONE = -1


class Known(NamedTuple):
    """What the unit knows of the train."""

    v: float  # speed [m/s]
    doubt: float  # by which it may be another [m/s]
    pilot: int  # index of the axle that is let run up, or `NONE`


class Witness(NamedTuple):
    """Whether an axle shows the train's speed."""

    given: float  # what the rail gave since the axle may slide [N]; 0 while it rolls
    even: float  # so long the rim has changed no faster than a train does [s]


def further(before: Known, rolls: bool, fastest: float, slowing: float, h: float) -> Known:
    """The train one step on.

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


def watched(  # noqa: PLR0913
    w: Wheelset, before: Witness, v: float, slowing: float, rim: float, K: float, F: float,
    valve: int, h: float,
) -> Witness:  # fmt: skip
    """An axle one step on; `valve` is the command of the step before, the rest is of this one."""
    rate = w.radius**2 / w.inertia * (F - w.phi * K)  # (1)
    even = before.even + h if abs(rate) < HARDER * slowing + GRADIENT else 0.0
    if before.given == 0.0:
        slides = valve != APPLY or v - rim > _BEHIND * v + _NEAR
        return Witness(max(F, _LITTLE) if slides else 0.0, even)
    given = max(F, before.given * math.exp(-h / _FORGET), _LITTLE)
    return Witness(0.0 if even > _EVEN and _LESS * given > F else given, even)


def asks_pilot(train: Known) -> bool:
    """Whether an axle is to be let run up, and none is."""
    return train.pilot == NONE and train.doubt > _DOUBTFUL * train.v


def pilots_valve(w: Wheelset, x: Witness, K: float) -> int:
    """What lets the pilot run up: less brake than the rail gives, then as much."""
    return VENT if w.phi * K > _LEFT * x.given else HOLD
