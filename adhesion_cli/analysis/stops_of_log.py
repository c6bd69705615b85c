"""The stops of a log: of its analysed axles, or of the channels of a log that has none."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..core.model import Log, Parameter, Result, Track, Vehicle
from ..core.physics import wheelset
from ..core.summary import BrakeApplication, Measured, StopSummary, largest_slip
from ..rail.stop_slides import add_slides
from ..records.faults import Window
from ..records.route import find_route
from ..reference.brake_work import brake_work, motor_share
from ..stops.find import find_brakings
from ..stops.measure import ToLevel, measure_stop
from ..stops.settings import StopSettings
from ..stops.signals import StopSignals, TimeSeries, of_log, of_records
from ..train.track import Gradient, find_gradient
from .settings import Settings

_UNKNOWN_GRADIENT = Parameter(0.0, 3.0)  # of a line of which nothing is stated [‰]


def stops_of_result(
    result: Result, applications: Iterable[Sequence[BrakeApplication]]
) -> tuple[StopSummary, ...]:
    """The stops of an analysed log, with the adhesion that its axles used."""
    records = [axle.record for axle in result.axles]
    settings = StopSettings(**result.settings.get("stops", {}))
    signals = of_records(records, result.log, result.vehicle)
    has_motors = any(r.motor_clamping is not None for r in records)
    mix_unknown = has_motors and not result.identified.known  # a pressure is no force then
    signals = signals._replace(other_brakes=result.other_brakes, mix_unknown=mix_unknown)
    stops = _measured(signals, result.vehicle, settings, result.track, result.log)
    by_axle = list(applications)
    placed = (_with_adhesion(stop, by_axle) for stop in stops)
    stops_with_slides = (add_slides(stop, result, by_axle, settings.locks) for stop in placed)
    return tuple(replace(stop, ed_share=_ed_share(stop, result)) for stop in stops_with_slides)


def stops_of_log(log: Log, settings: Settings, window: Window) -> tuple[StopSummary, ...]:
    """The stops of a log without wheel speeds, or without brakes.

    The settings say the vehicle, for the rotating mass, the line, and how stops are measured.
    """
    signals = of_log(log, settings.vehicle)
    if signals is None:
        return ()
    start, stop = window
    end_s = math.inf if stop is None else stop
    speed = signals.speed.cut(-math.inf if start is None else start, end_s)
    if not len(speed.t):
        return ()
    signals = signals._replace(speed=speed)
    return tuple(_measured(signals, settings.vehicle, settings.stops, settings.track, log))


def _measured(
    signals: StopSignals, vehicle: Vehicle, settings: StopSettings, track: Track, log: Log
) -> Iterator[StopSummary]:
    """Each stop with its place on the line."""
    gradient, route, start_ns = find_gradient(log, track), find_route(log), log.start_ns()
    w = wheelset(replace(vehicle, axles=()), 1)  # of the mean axle
    rotating = 1.0 + w.inertia / (w.mass * w.radius**2)
    for braking in find_brakings(signals):
        run = signals.speed.cut(braking.start, braking.stop)
        to_level = ToLevel(_mean_gradient(gradient, run, start_ns), rotating)
        stop = measure_stop(signals, braking, to_level, settings)
        place = route.at(start_ns + round(1e9 * stop.start_s))
        yield replace(stop, position_from=route.position_from, **place._asdict())


def _mean_gradient(gradient: Gradient | None, run: TimeSeries, start_ns: int) -> Parameter:
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
    slides, other_brake, inside = 0, False, list[BrakeApplication]()
    for of_axle in applications:
        for a in of_axle:
            shared = min(a.end_s, stop.end_s) - max(a.start_s, stop.start_s)
            if shared <= 0.0 or shared < 0.5 * (a.end_s - a.start_s):
                continue
            slides += a.slides
            other_brake |= a.other_brake
            inside.append(a)
            mu = a.coefficient
            if mu and math.isfinite(mu.mean) and math.isfinite(mu.mean_u95):
                seconds += shared
                total += shared * mu.mean
                error += shared * mu.mean_u95  # one vehicle: its errors are common
    coefficient = Measured(total / seconds, *[error / seconds] * 2) if seconds else None
    stop = replace(stop, coefficient=coefficient, other_brake=other_brake)
    slip, slip_u95 = largest_slip(inside)
    return replace(stop, slides=slides, max_slip=slip, max_slip_u95=slip_u95)


def _ed_share(stop: StopSummary, result: Result) -> Measured | None:
    """The share of the ED brake in the work of the brakes of all axles."""
    has_motors = any(axle.record.motor_clamping is not None for axle in result.axles)
    if not has_motors or stop.coefficient is None:  # or the friction brake is not known
        return None
    start_ns, works = result.log.start_ns(), []
    bounds = [start_ns + round(1e9 * x) for x in (stop.start_s, stop.end_s)]
    for axle in result.axles:
        t = axle.record.t
        pieces = []
        for s in axle.record.segments:
            first_row, last_row = s.start + np.searchsorted(t[s], bounds)
            pieces += [slice(int(first_row), int(last_row))] if last_row - first_row > 1 else []
        works.append(brake_work(axle.record, result.vehicle, pieces))
    return motor_share(works, result.vehicle)
