"""The patent's law: slip and slope of the operating point, combined by AND.

[S3] The judged point is where slip will be a short time ahead, as valves and cylinder need that
time. The estimated force gives the rate of slip (1); nothing is differentiated.
[S4] True if slip is in its band **and** slope in its band, see `slope.region`. If the train speed
is doubtful, the largest possible slip counts.
[S5] True: hold. False: move the point along the curve; dump beyond the bands, apply below them.
[S6] At every tick until the train stands.

The patent does not say which way each valve moves, nor what to do if the slope is not observable.
Within the slip band the pressure is then held, and raised briefly now and then. That moves the
point, and a moving point shows its slope. Holding for good would leave a rolling wheel on a good
rail with the pressure of a bad one.
"""

from typing import Annotated, NamedTuple

from ...core.methods import About
from ...core.model import Quantity
from ...rail.slope import Bands, region
from ..controller import APPLY, DUMP, HOLD, Observed


class Params(NamedTuple):
    """Bands of [S4]; found by search, see docs/explanation/antiskid.md."""

    slip_low: Annotated[float, Quantity("-", "least slip of the band", 0.0, 1.0)] = 0.018
    slip_high: Annotated[float, Quantity("-", "most slip of the band", 0.0, 1.0)] = 0.3
    slope_low: Annotated[float, Quantity("-", "least slope of the band", -10.0, 0.0)] = -0.005
    slope_high: Annotated[float, Quantity("-", "most slope of the band", 0.0, 50.0)] = 0.0136
    horizon: Annotated[float, Quantity("s", "how far ahead slip is judged", 0.0, 2.0)] = 1.08
    patience: Annotated[
        float, Quantity("s", "how long to hold while the slope is not observable", 0.0, 10.0)
    ] = 0.192
    probe: Annotated[
        float, Quantity("s", "how long to apply then, until the slope shows", 0.0, 10.0)
    ] = 0.0245
    guard: Annotated[
        float, Quantity("-", "slip over its noise from which it is one", 0.0, 100.0)
    ] = 2.5


class State(NamedTuple):
    """Clock, judged slip and valve command."""

    blind: float  # time without a slope, since the last probe [s]
    judged: float  # slip that the AND-test had [-]
    valve: int  # 0 apply, 1 hold, 2 dump


def init(p: Params, o: Observed) -> State:
    """Both valves at rest."""
    return State(0.0, o.slip, APPLY)


def step(p: Params, s: State, h: float, o: Observed) -> State:
    """One tick later."""
    bands = Bands(p.slip_low, p.slip_high, p.slope_low, p.slope_high)
    judged = o.slip + o.slip_doubt
    # A slip within its noise counts as 0: the wheel rolls.
    judged = judged + p.horizon * o.slip_rate if judged > p.guard * o.slip_noise else 0.0
    operating_region = region(judged, o.slope, bands)  # [S4]
    blind = s.blind + h if operating_region == 0 else 0.0  # unknown
    looks = operating_region == 0 and blind >= p.patience  # for the slope
    applies = operating_region == 1 or looks
    valve = DUMP if operating_region == 3 else APPLY if applies else HOLD  # [S5]
    if blind >= p.patience + p.probe:
        blind = 0.0
    return State(blind, judged, max(valve, o.at_least))


ABOUT = About(
    "Slip and slope judged together",
    "Patent on slip-adhesion slope anti-skid control, Shanghai University of Engineering Science, "
    "published 2024-10",
)
