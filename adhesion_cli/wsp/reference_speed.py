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

from ..core.model import Wheelset
from ..core.physics import GRADIENT, HARDER, reference_speed
from .controller import APPLY, DUMP, HOLD

_SHARE = 0.1  # error of the estimated deceleration, as φ alone often has
_DOUBTFUL = 0.05  # share of v
_LARGEST_LAG, _LARGEST_LAG_SPEED = 0.015, 0.1  # largest lag of a rolling rim: share of v, and [m/s]
_ROLLING_SHARE = 0.7  # share of the recent adhesion force; below it, a wheel rolls
_PILOT_SHARE = 0.8 * _ROLLING_SHARE  # share of it that a pilot's brake keeps
_FORGET = 2.0  # time constant of the recent adhesion force [s]
_EVEN_TIME = 0.05  # least time of an even rim speed [s]
_LEAST_FORCE = 1.0  # least adhesion force of a wheel that may slide, as 0 means that it rolls [N]
NO_PILOT = -1


class TrainEstimate(NamedTuple):
    """The train as the WSP controller knows it."""

    v: float  # speed [m/s]
    doubt: float  # its possible error [m/s]
    pilot: int  # index of the axle whose brake is released, or `NO_PILOT`


class Witness(NamedTuple):
    """Whether an axle shows the train's speed."""

    recent_force: float  # recent adhesion force since the axle may slide [N]; 0 while it rolls
    even_time: float  # time since the rim changed faster than a train does [s]


def estimate_next(
    previous: TrainEstimate, rolls: bool, fastest: float, slowing: float, h: float
) -> TrainEstimate:
    """The train one step later.

    `rolls`: whether any axle does. `fastest` is the largest rim speed [m/s], `slowing` ΣF̂/Σm
    [m/s²], `h` the interval [s].
    """
    if rolls:
        return TrainEstimate(reference_speed(previous.v, fastest, slowing, h), 0.0, previous.pilot)
    v = max(previous.v - slowing * h, fastest)  # (1)
    return TrainEstimate(v, previous.doubt + _SHARE * slowing * h, previous.pilot)


def watched(  # noqa: PLR0913 (compiled: plain floats)
    w: Wheelset,
    previous: Witness,
    v: float,
    slowing: float,
    rim: float,
    K: float,
    F: float,
    valve: int,
    h: float,
) -> Witness:
    """An axle one step later; `valve` is from the step before, the rest from this one."""
    rate = w.radius**2 / w.inertia * (F - w.phi * K)  # (1)
    even_time = previous.even_time + h if abs(rate) < HARDER * slowing + GRADIENT else 0.0
    if previous.recent_force == 0.0:
        slides = valve != APPLY or v - rim > _LARGEST_LAG * v + _LARGEST_LAG_SPEED
        return Witness(max(F, _LEAST_FORCE) if slides else 0.0, even_time)
    recent_force = max(F, previous.recent_force * math.exp(-h / _FORGET), _LEAST_FORCE)
    rolls = even_time > _EVEN_TIME and _ROLLING_SHARE * recent_force > F
    return Witness(0.0 if rolls else recent_force, even_time)


def asks_pilot(train: TrainEstimate) -> bool:
    """Whether a pilot is needed, and no axle is one."""
    return train.pilot == NO_PILOT and train.doubt > _DOUBTFUL * train.v


def pilots_valve(w: Wheelset, x: Witness, K: float) -> int:
    """The pilot's valve: the brake is released below the adhesion force, then held."""
    return DUMP if w.phi * K > _PILOT_SHARE * x.recent_force else HOLD
