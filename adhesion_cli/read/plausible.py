"""What the channels of one log say about each other, and what physics forbids.

Nothing is changed here: every finding names what to state so that the log is understood.
"""

from collections.abc import Callable, Iterator, Sequence

from ..model import Finding, Vehicle
from . import answers, deceleration, pressures, wheels
from .grid import Axle, Explanation, Grid, Scene

Check = Callable[[Scene], Iterator[Finding]]

# Of each group none after the first that warns: what comes after would only repeat it.
CHECKS: tuple[tuple[Check, ...], ...] = (
    (
        deceleration.impossible,
        deceleration.too_hard,
        pressures.released,
        answers.unlike,
        deceleration.explained,
        deceleration.unbraked,
        deceleration.another_factor,
        answers.unstated,
        deceleration.unexplained,
    ),
    (deceleration.late_pressure,),
    (pressures.odd,),
    (wheels.speeds, wheels.apart),
    (wheels.swapped,),
)


def findings(
    axles: Sequence[Axle], g: Grid | None, vehicle: Vehicle, start_ns: int, explanation: Explanation
) -> list[Finding]:
    """Everything that cannot be true, or hardly.

    Silent where a clock jumps back: then it is not known what was at the same time.

    Args:
        axles: all axles of the log that have a record.
        g: the same on one time axis, where they have one.
        vehicle: what the user states of it.
        start_ns: the log's start.
        explanation: of how the train slows.
    """
    if g is None:
        return []
    scene = Scene(axles, g, vehicle, start_ns, explanation)
    found: list[Finding] = []
    for group in CHECKS:
        for check in group:
            told = list(check(scene))
            found += told
            if any(f.severity != "info" for f in told):
                break
    return found
