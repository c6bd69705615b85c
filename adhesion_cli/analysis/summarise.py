"""An analysed log as its summary, which JSON, tables, pages and Python have in common."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.model import AxleResult, Channel, Floats, IdentifiedVehicle, Log, Result, Times, Vehicle
from ..core.summary import (
    AxleSummary,
    BrakeApplication,
    ChannelSummary,
    LogSummary,
    ReferenceSummary,
    ResultSummary,
    StopSummary,
    summarise_finding,
    summarise_vehicle,
)
from ..core.text import iso
from ..rail.highest import PEAK_TIME
from ..records.route import find_route
from ..stops.settings import StopSettings


def summarise(
    result: Result,
    outputs: Mapping[str, str],
    braked: Mapping[int, Sequence[BrakeApplication]] | None = None,
) -> ResultSummary:
    """The summary of an analysed log.

    `braked` is what `brake_applications` gave, if that is known.
    """
    from .stops_of_log import stops_of_result  # slow to import, and only results need it

    braked = brake_applications(result) if braked is None else braked
    log = _summarise_log(result.log, _rows_used(result))
    vehicle = summarise_vehicle(result.identified)
    axles = tuple(_summarise_axle(a, braked[a.record.axle]) for a in result.axles)
    findings = tuple(map(summarise_finding, result.findings))
    stops = stops_of_result(result, braked.values())
    channels = _used_channels(result.log)
    return ResultSummary(log, outputs, vehicle, axles, channels, findings, result.brake, stops)


def summarise_stops(log: Log, vehicle: Vehicle, stops: tuple[StopSummary, ...]) -> ResultSummary:
    """The summary of a log that has stops, and no axle to analyse."""
    unknown = summarise_vehicle(IdentifiedVehicle(vehicle, "default", None, known=False))
    findings, channels = tuple(map(summarise_finding, log.findings)), _used_channels(log)
    log_summary = _summarise_log(log, 0)
    return ResultSummary(log_summary, {}, unknown, (), channels, findings, stops=stops)


def _summarise_log(log: Log, rows_used: int) -> LogSummary:
    times_of_channels = [c.data.t for c in log.channels if c.meaning and len(c.data.t)]
    start_ns = log.start_ns()
    stop_ns = max((int(t.max()) for t in times_of_channels), default=start_ns)
    start, duration = iso(start_ns) if log.absolute else None, (stop_ns - start_ns) / 1e9
    return LogSummary(log.path, log.format, log.sha256, start, duration, log.rows_read, rows_used)


def _used_channels(log: Log) -> tuple[ChannelSummary, ...]:
    return tuple(summarise_channel(c) for c in log.channels if c.meaning)


def _summarise_axle(axle: AxleResult, braked: Sequence[BrakeApplication]) -> AxleSummary:
    ref = axle.reference
    # While the wheel only rolls, force and errors are almost zero.
    selected = np.r_[axle.applications] if axle.applications else slice(None)
    sigma, band = _median(ref.sigma[selected]), _median(ref.half_width[selected])
    reference = ReferenceSummary(ref.method, sigma, band, ref.nis)
    return AxleSummary(axle.record.axle, reference, tuple(braked), axle.scores)


def summarise_channel(c: Channel) -> ChannelSummary:
    """What a channel was taken for, and why."""
    meaning = "truth" if c.meaning == "true_slip" else c.meaning  # by its unit
    return ChannelSummary(c.name, c.field, meaning, c.axle, c.unit, c.reason, levels=c.levels)


def brake_applications(result: Result) -> dict[int, tuple[BrakeApplication, ...]]:
    """The brake applications of each axle, by its number, in the order of time."""
    from ..rail.applications import find_applications  # slow to import, and only results need it

    start, route = result.log.start_ns(), find_route(result.log)
    limits = StopSettings(**result.settings.get("stops", {})).locks
    peak_time = float(result.settings.get("analysis", {}).get("peak_time", PEAK_TIME))
    return {
        a.record.axle: tuple(
            replace(x, other_brake=any(f.overlaps(x.start_s, x.end_s) for f in result.other_brakes))
            for x in find_applications(a, result.vehicle, start, route, limits, peak_time)
        )
        for a in result.axles
    }


def _rows_used(result: Result) -> int:
    """Rows or messages of the log that hold a number and lie in some axle's segments."""
    by_origin: dict[tuple[str, str], int] = {}
    for channel in result.log.channels:
        if not channel.meaning:
            continue
        records = (a.record for a in result.axles if channel.axle in (None, a.record.axle))
        spans = [r.t[s][[0, -1]] for r in records for s in r.segments]
        used_count = _count_between(spans, channel.data.t) - _count_between(spans, channel.held)
        by_origin[channel.row_of] = max(by_origin.get(channel.row_of, 0), used_count)
    return sum(by_origin.values())


def _count_between(ends: Sequence[Times], t: Times) -> int:
    """The times between any two ends; each counts once."""
    is_between = np.zeros(len(t), dtype=np.bool_)
    for begin, stop in ends:
        is_between |= (t >= begin) & (t <= stop)
    return int(is_between.sum())


def _median(values: Floats) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None
