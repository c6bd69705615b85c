"""What a controller of a brake cylinder's valves is, and which ones there are.

A controller is a method in `wsp/controllers/`, one per axle. `methods` says what its file holds.
Its `State` ends with `judged`, the slip that it decided on, and `valve`, the command. It has

- `init(p, o) -> State`, at the first tick;
- `step(p, s, h, o) -> State`, one tick later. `h` is the interval since the last tick [s], `o` what
  it has `Observed`.
"""

from typing import Annotated, NamedTuple, Protocol

from ..core import methods
from ..core.methods import About, Kind, Method
from ..core.model import Quantity

APPLY, HOLD, DUMP = 0, 1, 2  # the three states of a WSP dump valve, with ever less air


class Observed(NamedTuple):
    """What one axle's controller receives at one of its ticks, with plausible ranges."""

    rim_speed: Annotated[float, Quantity("m/s", "ωR, measured", -10.0, 200.0)]
    slip: Annotated[float, Quantity("-", "slip s, over a floor of the speed", -200.0, 10.0)]
    slip_noise: Annotated[float, Quantity("-", "1 sigma of the slip", 0.0, 100.0)]
    slip_doubt: Annotated[
        float, Quantity("-", "by which s may be wrong, as the train speed may be", 0.0, 200.0)
    ]
    slip_rate: Annotated[float, Quantity("1/s", "ds/dt by estimated and braking force", -1e4, 1e4)]
    coefficient: Annotated[float, Quantity("-", "μ̂ = F̂/(m g)", -100.0, 100.0)]
    slope: Annotated[
        float, Quantity("-", "k = dμ/ds, NaN where not observable", -1e9, 1e9, optional=True)
    ]
    confidence: Annotated[
        float, Quantity("-", "in the slope: 0 not observable, 1 certain", 0.0, 1.0)
    ]
    at_least: Annotated[
        int, Quantity("-", "valve that the WSP controller asks for; else `APPLY`", APPLY, DUMP)
    ]


class Drives(Protocol):
    """The two magnet valves of one axle, as a WSP controller or a test rig switches them."""

    def set(self, hold: bool, vent: bool) -> None:
        """Energises the valves or not; with both at rest the brake sets the pressure."""


_STATE = ("judged", "valve"), "the slip it decided on and the command"
KIND = Kind("wsp/controllers", "a controller", About, *_STATE, "wsp.controller")


def registry() -> dict[str, Method]:
    """Every controller by name, sorted.

    Raises:
        UserError: for a file that is no controller.
    """
    return {name: method for name, (method, _) in methods.scan(KIND).items()}
