"""Controllers of the brake cylinder's valves: one law per file, each a pure step with state.

A controller holds `Params` and `State` (NamedTuples; every parameter has a default and its
`Quantity`, the last field of `State` is `valve`), `init(p, o) -> State` and
`step(p, s, h, o) -> State`, where `o` is `Observed` and `h` the interval to it [s]. Plain Python
on floats: the same step runs sample by sample on a unit or a rig, and compiled in the loop.
"""

from typing import NamedTuple

APPLY, HOLD, VENT = 0, 1, 2  # both valves at rest; hold valve; hold and vent valve


class Observed(NamedTuple):
    """What one axle's controller is told at one of its ticks."""

    rim_speed: float  # ωR, measured [m/s]
    slip: float  # s [-], over a floor of the speed
    slip_rate: float  # ds/dt that estimated and braking force make, (1) in (2) [1/s]
    coefficient: float  # μ̂ = F̂/(m g) [-]
    slope: float  # k = dμ/ds [-], NaN where not observable
    confidence: float  # in the slope: 0 not observable, 1 certain
