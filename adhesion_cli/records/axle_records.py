"""A log to one record per axle, on the time of its wheel speed.

1. choose: which channels are which axle's.
2. screen: samples that a working sensor cannot give are left out.
3. resample: each axle gets one time axis, the times of its wheel speed.
4. synchronise: all channels get one clock.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ..core.finding import Finding
from ..core.model import AxleRecord, Log, Vehicle
from ..dynamics.train_grid import Scene
from . import choose, resample, screen, synchronise
from .faults import View
from .faults import Window as Window


class Prepared(NamedTuple):
    """The records of a log, and what checks may look at."""

    records: list[AxleRecord]  # of the axles asked for
    findings: list[Finding]  # of the channels one by one, and of the clocks
    scene: Scene | None  # all axles together; None where a clock jumps back
    channels: frozenset[str]  # titles of the channels that the records are made of


def prepare(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: Window = (None, None),
    thresholds: screen.Thresholds = screen.DEFAULT,
) -> Prepared:
    """One record per axle that has a wheel speed and a pressure (or K).

    Args:
        log: with its channels' meanings.
        vehicle: for the force line.
        axles: only these, all if empty.
        window: only the samples between these seconds after the log's start.
        thresholds: of the checks of single channels.

    Raises:
        UserError: where a needed channel is missing, an axle asked for is not there, or no two
            channels share any time.
    """
    view = View(log.start_ns(), window)
    choice = choose.choose(log, axles)
    screened = screen.screen(choice, vehicle, view, thresholds)
    sampled, left_out = resample.resample(choice, screened, vehicle, view)
    of_channels = [f for f in screened.findings if f.channel in choice.titles]
    findings = [*choice.findings, *of_channels, *left_out]
    if not any(a.record.axle in choice.asked for a in sampled):
        raise choose.nothing(log, choice, view, findings)
    done = synchronise.synchronise(sampled, choice.acceleration, vehicle, view)
    chosen = [a for a in done.axles if a.record.axle in choice.asked]
    titles = {"", *(c.title for a in chosen for c in (a.speed, a.brake, a.train) if c)}
    return Prepared(
        [a.record for a in chosen], [*findings, *done.findings], done.scene, frozenset(titles)
    )
