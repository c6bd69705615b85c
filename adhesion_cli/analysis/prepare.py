"""A log to one record per axle that can be trusted as far as the checks see.

1. choose: which channels are which axle's.
2. screen: samples that a working sensor cannot give are left out.
3. resample: each axle gets one time axis, the times of its wheel speed.
4. align: all channels get one clock. How the train slows shows the delay of the pressure.
5. diagnose: what the channels say about each other, and what physics forbids.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..core.finding import Finding
from ..core.model import AxleRecord, Log, Vehicle
from ..diagnostics.diagnosis import diagnose, sensor_thresholds
from ..diagnostics.scene import Scene
from ..records.choose import choose, no_records_error
from ..records.faults import View
from ..records.faults import Window as Window
from ..records.resample import resample
from ..records.screen import screen
from ..train.align import align


class Prepared(NamedTuple):
    """The records of a log, and what checks may look at."""

    records: list[AxleRecord]  # of the axles asked for
    all_records: list[AxleRecord]  # of every axle: some things only all axles together show
    findings: list[Finding]
    scene: Scene | None  # all axles together; None where a clock jumps back


def prepare(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: Window = (None, None),
    checks: Mapping[str, Any] | None = None,
) -> Prepared:
    """One record per axle that has a wheel speed and a pressure (or K).

    Args:
        log: with its channels' meanings.
        vehicle: for the force line.
        axles: only these, all if empty.
        window: only the samples between these seconds after the log's start.
        checks: parameters of checks by name; the defaults where there are none.

    Raises:
        UserError: where a needed channel is missing, an axle asked for is not there, or no two
            channels share any time.
    """
    view = View(log.start_ns(), window)
    choice = choose(log, axles)
    screened = screen(choice, vehicle, view, sensor_thresholds(checks))
    sampled, resample_findings = resample(choice, screened, vehicle, view)
    sensor_findings = [f for f in screened.findings if f.channel in choice.titles]
    findings = [*choice.findings, *sensor_findings, *resample_findings]
    if not any(a.record.axle in choice.requested for a in sampled):
        raise no_records_error(log, choice, view, findings)
    aligned = align(sampled, choice.acceleration, vehicle, view)
    requested = [a for a in aligned.axles if a.record.axle in choice.requested]
    findings += aligned.findings
    scene = None
    if aligned.grid:
        scene = Scene(aligned.axles, aligned.grid, vehicle, view.start_ns, aligned.explanation)
        titles = {"", *(c.title for a in requested for c in (a.speed, a.brake, a.train) if c)}
        findings += [f for f in diagnose(scene, checks) if f.channel in titles]
    return Prepared(
        [a.record for a in requested], [a.record for a in aligned.axles], findings, scene
    )
