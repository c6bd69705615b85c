"""A rule-based WSP: thresholds on deceleration and slip, and a watchdog for dumping.

Dump if the rim slows faster than a train can, or slips too much and does not yet recover. Hold
while it recovers. Below the slip that counts as rolling, apply in pulses, if the pause between them
is longer than a tick. Too long a dump counts as a fault: the brake is applied for a while. The
structure is that of common pneumatic WSPs. The thresholds come from the same search as the patent
law's.
"""

import math
from typing import Annotated, NamedTuple

from ...core.methods import About
from ...core.model import Quantity
from ..controller import APPLY, DUMP, HOLD, Observed


class Params(NamedTuple):
    """Thresholds."""

    vent_slip: Annotated[float, Quantity("-", "slip that dumps", 0.0, 1.0)] = 0.183
    hold_slip: Annotated[float, Quantity("-", "slip that stops applying", 0.0, 1.0)] = 0.0314
    vent_deceleration: Annotated[
        float, Quantity("m/s²", "deceleration of the rim that dumps", 0.0, 50.0)
    ] = 1.12
    recovery: Annotated[
        float, Quantity("m/s²", "acceleration of the rim that ends dumping", -10.0, 50.0)
    ] = 1.15
    filter_time: Annotated[
        float, Quantity("s", "time constant of the rim's acceleration", 0.0, 1.0)
    ] = 0.383
    pulse: Annotated[float, Quantity("s", "duration of a pulse of applying", 0.0, 2.0)] = 0.305
    pause: Annotated[float, Quantity("s", "pause between two pulses", 0.0, 5.0)] = 0.005
    watchdog: Annotated[float, Quantity("s", "longest dump", 0.1, 60.0)] = 8.78
    reset: Annotated[float, Quantity("s", "brake after the watchdog", 0.0, 60.0)] = 5.0


class State(NamedTuple):
    """Filter and clocks."""

    rim_speed: float  # before [m/s]
    acceleration: float  # of the rim, filtered [m/s²]
    dumping: float  # duration [s]
    cycle: float  # place in a cycle of pulse and pause [s]; below 0: after the watchdog
    sliding: float  # 1 from the first dump until pressure has long been back
    judged: float  # slip [-]
    valve: int  # 0 apply, 1 hold, 2 dump


def init(p: Params, o: Observed) -> State:
    """Both valves at rest."""
    return State(o.rim_speed, 0.0, 0.0, 0.0, 0.0, o.slip, APPLY)


def step(p: Params, s: State, h: float, o: Observed) -> State:
    """One tick later."""
    rate = (o.rim_speed - s.rim_speed) / h
    forget = math.exp(-h / p.filter_time) if p.filter_time > 0.0 else 0.0
    acceleration = forget * s.acceleration + (1.0 - forget) * rate
    cycle, sliding = s.cycle + h, s.sliding
    if s.dumping > p.watchdog:
        cycle = -p.reset
    fast = acceleration < -p.vent_deceleration and o.slip > 0.5 * p.hold_slip
    deep = o.slip > p.vent_slip and acceleration < p.recovery
    if cycle < 0.0:
        valve = APPLY
    elif fast or deep:
        valve, cycle, sliding = DUMP, p.pulse, 1.0
    elif o.slip > p.hold_slip:
        valve, cycle = HOLD, p.pulse
    else:
        if cycle > p.pulse + p.pause:
            cycle = 0.0
        valve = APPLY if cycle < p.pulse or sliding == 0.0 else HOLD
    valve = max(valve, o.at_least)
    dumping = s.dumping + h if valve == DUMP else 0.0
    return State(o.rim_speed, acceleration, dumping, cycle, sliding, o.slip, valve)


ABOUT = About(
    "Rules on slip and deceleration", "Common pneumatic wheel slide protection; thresholds ours"
)
