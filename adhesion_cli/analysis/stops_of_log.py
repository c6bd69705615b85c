"""The stops of a log: of its analysed axles, or of the channels of a log that has none."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ..core.model import Log, Parameter, Result, Vehicle
from ..core.physics import wheelset
from ..core.summary import BrakeApplication, Measured, StopSummary
from ..stops.find import find_brakings
from ..stops.measure import Track, measure_stop
from ..stops.settings import StopSettings
from ..stops.signals import StopSignals, of_log, of_records

_UNKNOWN_GRADIENT = Parameter(0.0, 3.0)  # of a line of which nothing is stated [‰]


def stops_of_result(
    result: Result, applications: Iterable[Sequence[BrakeApplication]]
) -> tuple[StopSummary, ...]:
    """The stops of an analysed log, with the adhesion that its axles used.

    Args:
        result: the analysed log.
        applications: the brake applications of each axle.
    """
    records = [axle.record for axle in result.axles]
    settings = StopSettings(**result.settings.get("stops", {}))
    stops = _measured(of_records(records, result.log, result.vehicle), result.vehicle, settings)
    by_axle = list(applications)
    return tuple(_with_adhesion(stop, by_axle) for stop in stops)


def stops_of_log(log: Log, vehicle: Vehicle, settings: StopSettings) -> tuple[StopSummary, ...]:
    """The stops of a log without wheel speeds, or without brakes.

    Args:
        log: with its channels' meanings.
        vehicle: for the rotating mass.
        settings: how stops are measured.
    """
    signals = of_log(log)
    return tuple(_measured(signals, vehicle, settings)) if signals else ()


def _measured(signals: StopSignals, vehicle: Vehicle, settings: StopSettings) -> list[StopSummary]:
    w = wheelset(replace(vehicle, axles=()), 1)  # of the mean axle
    track = Track(_UNKNOWN_GRADIENT, 1.0 + w.inertia / (w.mass * w.radius**2))
    brakings = find_brakings(signals)
    return [measure_stop(signals, braking, track, settings) for braking in brakings]


def _with_adhesion(
    stop: StopSummary, applications: Sequence[Sequence[BrakeApplication]]
) -> StopSummary:
    """A stop with the mean adhesion coefficient of all axles, and their slides."""
    total = seconds = error = 0.0
    slides, slips = 0, []
    for of_axle in applications:
        for a in of_axle:
            shared = min(a.end_s, stop.end_s) - max(a.start_s, stop.start_s)
            if shared <= 0.0 or shared < 0.5 * (a.end_s - a.start_s):
                continue
            slides += a.slides
            slips += [a.max_slip] if a.max_slip is not None else []
            if a.coefficient and all(map(math.isfinite, a.coefficient)):
                seconds += shared
                total += shared * a.coefficient.mean
                error += shared * a.coefficient.mean_u95  # one vehicle: its errors are common
    coefficient = Measured(total / seconds, *[error / seconds] * 2) if seconds else None
    return replace(stop, coefficient=coefficient, slides=slides, max_slip=max(slips, default=None))
