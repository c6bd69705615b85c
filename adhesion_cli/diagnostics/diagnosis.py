"""What the channels of one log say about each other, and what physics forbids.

Nothing is changed here: every finding names what to state so that the log is understood.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from ..core.finding import Finding
from ..core.model import Log, Vehicle
from ..dynamics.train_grid import Scene
from ..records import axle_records
from ..records.screen import Thresholds
from .registry import registry


def findings(scene: Scene, params: Mapping[str, Any] | None = None) -> list[Finding]:
    """Everything that cannot be true, or hardly.

    Args:
        scene: all axles of the log that have a record, on one time axis.
        params: of checks by name; the default's where there are none.
    """
    found: list[Finding] = []
    warned: set[str] = set()
    for name, check in registry().items():
        if check.about.group not in warned:
            own = list(check.check((params or {}).get(name, check.Params()), scene))
            found += own
            warned |= {check.about.group for f in own if f.severity != "info"}
    return found


def of_sensors(params: Mapping[str, Any] | None) -> Thresholds:
    """The parameters of the checks of single channels, of those of all checks."""
    return Thresholds(**{k: p for k, p in (params or {}).items() if k in Thresholds._fields})


def records(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: axle_records.Window = (None, None),
    params: Mapping[str, Any] | None = None,
) -> axle_records.Prepared:
    """One record per axle, and everything that was found on the way, by the checks as well.

    Args:
        log: with its channels' meanings.
        vehicle: for (15).
        axles: only these, all if empty.
        window: only the samples between these seconds after the log's start.
        params: of checks by name; the default's where there are none.

    Raises:
        UserError: as `axle_records.prepare`.
    """
    made = axle_records.prepare(log, vehicle, axles, window, of_sensors(params))
    if made.scene is None:
        return made
    odd = [f for f in findings(made.scene, params) if f.channel in made.channels]
    return made._replace(findings=made.findings + odd)
