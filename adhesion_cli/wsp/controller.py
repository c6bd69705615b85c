"""What a controller of a brake cylinder's valves is, and which ones there are.

A controller is a method in `wsp/controllers/`, one per axle. `methods` says what its file holds.
Its `State` ends with `judged`, the slip that it decided on, and `valve`, the command. It has

- `init(p, o) -> State`, at the first tick;
- `step(p, s, h, o) -> State`, one tick later. `h` is the interval since the last tick [s], `o` what
  it has `Observed`.
"""

from typing import NamedTuple

from ..core import methods
from ..core.methods import About, Kind, Method

APPLY, HOLD, DUMP = 0, 1, 2  # the three states of a WSP dump valve, with ever less air


class Observed(NamedTuple):
    """What one axle's controller receives at one of its ticks."""

    rim_speed: float  # ωR, measured [m/s]
    slip: float  # s, over a floor of the speed [-]
    slip_noise: float  # 1 sigma of the slip [-]
    slip_doubt: float  # by which s may be wrong, as the train speed may be [-]
    slip_rate: float  # ds/dt by estimated and braking force [1/s]
    coefficient: float  # μ̂ = F̂/(m g) [-]
    slope: float  # k = dμ/ds, NaN where not observable [-]
    confidence: float  # in the slope: 0 not observable, 1 certain
    at_least: int  # valve that the WSP controller asks for; else `APPLY`


_STATE = ("judged", "valve"), "the slip it decided on and the command"
KIND = Kind("wsp/controllers", "a controller", About, *_STATE, "wsp.controller")


def registry() -> dict[str, Method]:
    """Every controller by name, sorted.

    Raises:
        UserError: for a file that is no controller.
    """
    return {name: method for name, (method, _) in methods.scan(KIND).items()}
