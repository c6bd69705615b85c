"""What a controller of a brake cylinder's valves is, and which ones there are.

A controller is a method (`methods` says what its file holds) in `controllers/`, one per axle. Its
`State` ends with `judged`, the slip that it went by, and `valve`, the command, and it has

- `init(p, o) -> State`, at the first tick;
- `step(p, s, h, o) -> State`, one tick later: `h` is the interval since the last [s], `o` what is
  `Observed`.
"""

from typing import NamedTuple, Protocol

from . import methods
from .methods import About, Kind, Method

APPLY, HOLD, VENT = 0, 1, 2  # both valves at rest; hold valve; hold and vent valve: ever less air


class Observed(NamedTuple):
    """What one axle's controller is told at one of its ticks."""

    rim_speed: float  # ωR, measured [m/s]
    slip: float  # s [-], over a floor of the speed
    slip_noise: float  # 1 sigma of it [-]
    slip_doubt: float  # by which s may be another, as the train's speed may [-]
    slip_rate: float  # ds/dt that estimated and braking force make, (1) in (2) [1/s]
    coefficient: float  # μ̂ = F̂/(m g) [-]
    slope: float  # k = dμ/ds [-], NaN where not observable
    confidence: float  # in the slope: 0 not observable, 1 certain
    at_least: int  # valve that the unit asks for, to see its train's speed: `APPLY` for nothing


class Drives(Protocol):
    """The two magnet valves of one axle, as a unit or a rig switches them."""

    def set(self, hold: bool, vent: bool) -> None:
        """Energises them or not; both at rest is the brake's own pressure."""


KIND = Kind(
    "wsp/controllers", "a controller", About, ("judged", "valve"),
    "the slip it went by and the command", "core.controller",
)  # fmt: skip


def registry() -> dict[str, Method]:
    """Every controller by name, sorted.

    Raises:
        UserError: for a file that is no controller.
    """
    return {name: method for name, (method, _) in methods.scan(KIND).items()}
