"""The stops of a log: of its analysed axles, or of the channels of a log that has none."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..core.model import Log, Parameter, Result, Track, Vehicle
from ..core.physics import wheelset
from ..core.summary import BrakeApplication, Measured, StopSummary
from ..records.route import find_route
from ..stops.find import find_brakings
from ..stops.measure import ToLevel, measure_stop
from ..stops.settings import StopSettings
from ..stops.signals import Series, StopSignals, of_log, of_records
from ..train.track import Gradient, find_gradient

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
    gradient = find_gradient(result.log, result.track)
    signals = of_records(records, result.log, result.vehicle)
    stops = _measured(signals, result.vehicle, settings, gradient, result.log.start_ns())
    by_axle = list(applications)
    return tuple(_with_adhesion(stop, by_axle) for stop in _placed(stops, result.log))


def stops_of_log(
    log: Log, vehicle: Vehicle, settings: StopSettings, track: Track
) -> tuple[StopSummary, ...]:
    """The stops of a log without wheel speeds, or without brakes.

    Args:
        log: with its channels' meanings.
        vehicle: for the rotating mass.
        settings: how stops are measured.
        track: the line, as stated.
    """
    signals = of_log(log)
    if signals is None:
        return ()
    gradient = find_gradient(log, track)
    return tuple(_placed(_measured(signals, vehicle, settings, gradient, log.start_ns()), log))


def _placed(stops: Iterable[StopSummary], log: Log) -> Iterator[StopSummary]:
    """The stops with their places at the command."""
    route, start_ns = find_route(log), log.start_ns()
    for stop in stops:
        place = route.at(start_ns + round(1e9 * stop.start_s))
        yield replace(stop, position_from=route.position_from, **place._asdict())


def _measured(
    signals: StopSignals,
    vehicle: Vehicle,
    settings: StopSettings,
    gradient: Gradient | None,
    start_ns: int,
) -> Iterator[StopSummary]:
    w = wheelset(replace(vehicle, axles=()), 1)  # of the mean axle
    rotating = 1.0 + w.inertia / (w.mass * w.radius**2)
    for braking in find_brakings(signals):
        run = signals.speed.between(braking.on, braking.end)
        to_level = ToLevel(_mean_gradient(gradient, run, start_ns), rotating)
        yield measure_stop(signals, braking, to_level, settings)


def _mean_gradient(gradient: Gradient | None, run: Series, start_ns: int) -> Parameter:
    """The mean gradient over the distance of a stop [‰]."""
    distance = np.maximum(np.nan_to_num(run.value), 0.0)
    if gradient is None or not distance.any():
        return _UNKNOWN_GRADIENT
    t = start_ns + np.rint(1e9 * run.t).astype(np.int64)
    mean = np.average(gradient.at(t), weights=distance)
    return Parameter(1e3 * float(mean), 1e3 * gradient.sigma)


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
