"""What the channels of one log say about each other, and what physics forbids.

Nothing is changed here: every finding names what to state so that the log is understood.
"""

from collections.abc import Callable, Iterator, Sequence

from ..core.finding import Finding
from ..core.model import AxleRecord, Log, Vehicle
from ..dynamics.train_grid import Scene
from ..records import axle_records
from . import brake_response, deceleration, pressures, wheels

Check = Callable[[Scene], Iterator[Finding]]

# Of each group none after the first that warns: what comes after would only repeat it.
CHECKS: tuple[tuple[Check, ...], ...] = (
    (
        deceleration.impossible,
        deceleration.too_hard,
        pressures.released,
        brake_response.unlike,
        deceleration.explained,
        deceleration.unbraked,
        deceleration.another_factor,
        brake_response.unstated,
        deceleration.unexplained,
    ),
    (deceleration.late_pressure,),
    (pressures.odd,),
    (wheels.speeds, wheels.apart),
    (wheels.swapped,),
)


def findings(scene: Scene) -> list[Finding]:
    """Everything that cannot be true, or hardly.

    Args:
        scene: all axles of the log that have a record, on one time axis.
    """
    found: list[Finding] = []
    for group in CHECKS:
        for check in group:
            told = list(check(scene))
            found += told
            if any(f.severity != "info" for f in told):
                break
    return found


def records(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: axle_records.Window = (None, None),
) -> tuple[list[AxleRecord], list[Finding]]:
    """One record per axle, and everything that was found on the way.

    Args:
        log: with its channels' meanings.
        vehicle: for (15).
        axles: only these, all if empty.
        window: only the samples between these seconds after the log's start.

    Raises:
        UserError: as `axle_records.prepare`.
    """
    made = axle_records.prepare(log, vehicle, axles, window)
    if made.scene is None:
        return made.records, made.findings
    odd = [f for f in findings(made.scene) if f.channel in made.channels]
    return made.records, made.findings + odd
