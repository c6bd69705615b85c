"""The patent's law: slip and slope of the operating point judged together by AND.

[S3] The point that is judged is where slip will be a short time ahead: valves and cylinder need
that time, and the estimated force says at once where the wheel is going (1); nothing is
differentiated.
[S4] True where slip is in its band **and** slope in its band, see `slope.region`.
[S5] True: hold. False: move the point along the curve; beyond the bands vent, below them apply.
[S6] At every tick until the train stands.

The patent does not say which way each valve goes, nor what holds where the slope cannot be
observed: there slip alone decides, and within its band the pressure is held.
"""

from typing import Annotated, NamedTuple

from ..model import Quantity
from ..slope import Bands, region
from . import APPLY, HOLD, VENT, Observed


class Params(NamedTuple):
    """Bands of [S4]."""

    slip_low: Annotated[float, Quantity("-", "least slip of the band", 0.0, 1.0)] = 0.010
    slip_high: Annotated[float, Quantity("-", "most slip of the band", 0.0, 1.0)] = 0.03
    slope_low: Annotated[float, Quantity("-", "least slope of the band", -10.0, 0.0)] = -0.1
    slope_high: Annotated[float, Quantity("-", "most slope of the band", 0.0, 50.0)] = 0.3
    horizon: Annotated[float, Quantity("s", "how far ahead slip is judged", 0.0, 2.0)] = 0.2


class State(NamedTuple):
    """Valve command."""

    valve: int


def init(p: Params, o: Observed) -> State:
    """Both valves at rest."""
    return State(APPLY)


def step(p: Params, s: State, h: float, o: Observed) -> State:
    """One tick on."""
    bands = Bands(p.slip_low, p.slip_high, p.slope_low, p.slope_high)
    where = region(o.slip + p.horizon * o.slip_rate, o.slope, bands)  # [S4]
    if where == 3:  # beyond
        return State(VENT)  # [S5]
    if where == 1:  # below
        return State(APPLY)  # [S5]
    return State(HOLD)
