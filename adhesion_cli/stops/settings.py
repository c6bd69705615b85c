"""How stops are measured: the section `[stops]`."""

from typing import Annotated, NamedTuple

from ..core.model import Quantity
from ..core.physics import SLOW
from ..rail.locks import SHORTEST_LOCK, LockLimits


class StopSettings(NamedTuple):
    """How stops are measured."""

    start_share: Annotated[
        float,
        Quantity("-", "share of the full brake at which the delay ends; SUBSET-026: 0", 0.0, 0.5),
    ] = 0.1
    dead_time: Annotated[
        float,
        Quantity(
            "s",
            "from command to the first rise of a cylinder, where no command is logged; 0: unknown",
            0.0,
            10.0,
        ),
    ] = 0.0
    nominal_speed: Annotated[
        float, Quantity("km/h", "nominal speed of all stops; 0: the nearest usual one", 0.0, 600.0)
    ] = 0.0
    locked_speed: Annotated[
        float,
        Quantity("m/s", "a wheel that stands while the train is faster than this is locked", 0, 30),
    ] = SLOW
    shortest_lock: Annotated[float, Quantity("s", "a shorter lock does not count", 0.0, 10.0)] = (
        SHORTEST_LOCK
    )
    speed_scale: Annotated[
        float,
        Quantity("-", "1 sigma of the speed's scale: wheel diameter, radar; 0: by the log", 0, 0.1),
    ] = 0.0

    @property
    def locks(self) -> LockLimits:
        """From when on a standing wheel counts as locked."""
        return LockLimits(self.locked_speed, self.shortest_lock)
