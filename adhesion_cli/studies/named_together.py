"""The vehicles of several logs that are named together: one, or one for each brake."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..analysis.identify import at_load, brake_kinds, find_log_brake, identify, with_friction_error
from ..analysis.prepare import AlignedLog, Window, align_log
from ..analysis.request import load_vehicle, read_log
from ..analysis.settings import Settings
from ..core.model import Z95, IdentifiedVehicle, LogBrake, Vehicle
from ..core.physics import friction_change
from ..formats.memory import Signals
from ..results.friction_groups import FrictionGroup, GroupedRun, group_by_friction

_FEWEST_OF_DRIFT = 6  # runs that show a drift
_LEAST_DRIFT = 0.08  # of the brake force, from the first to the last third of the runs
_UNLIKE = 0.1  # 1 sigma of ln of the brake force from log to log, by other pads
_CLEAR = 4.0  # Student's t of the order of the runs


def identify_together(
    paths: Sequence[Path | Signals],
    settings: Settings,
    axles: Sequence[int] = (),
    window: Window = (None, None),
) -> list[IdentifiedVehicle | None]:
    """The vehicle of each of several logs that are named together: they are one train's.

    Where logs show different brakes, as with old and with new pads, each group of logs has its own,
    within the tolerances of what is stated. None for a log that is alone, that cannot be read, or
    that carries its vehicle. Only these `axles` count, all if empty, in a window of seconds after
    each log's start.
    """
    logs: dict[int, AlignedLog] = {}
    finds = len(paths) > 1 and settings.analysis.vehicle == "log"
    for place, path in enumerate(paths if finds else ()):
        try:
            settings_of_log, log = read_log(path, settings)
            if settings_of_log.analysis.vehicle == "log":
                loaded, _ = load_vehicle(settings, log)
                track = settings_of_log.track
                logs[place] = align_log(
                    log, loaded.vehicle, axles, window, checks=settings.checks, track=track
                )
        except Exception:  # its own analysis says what is wrong with a log
            continue
    if not logs or len(brake_kinds([*logs.values()])) > 1:
        return [None] * len(paths)
    identified = dict(zip(logs, _identify_each([*logs.values()], settings), strict=True))
    return [identified.get(place) for place in range(len(paths))]


def _identify_each(logs: Sequence[AlignedLog], settings: Settings) -> Sequence[IdentifiedVehicle]:
    """The vehicle of each log, one for all with the same brake.

    Friction that changes over speed, as of cast iron, does so over force, too: then each log has
    its own. So it has where the friction drifts from log to log, as of pads that bed in.
    """
    common = identify(logs, settings)
    vehicles = [common] * len(logs)
    if common.source == "default" or len(logs) < 2:
        return vehicles
    runs = [GroupedRun(x.path, _brake_of(x, common, settings)) for x in logs]
    groups = [part for group in group_by_friction(runs) for part in _without_drift(group, runs)]
    effects = common.speed_effects.values() if common.source == "log" else ()
    if any(friction_change(x, settings.vehicle) for x in effects):
        single_logs = [(i, run.brake.ratio) for i, run in enumerate(runs, 1) if run.brake]
        groups = [FrictionGroup((i,), ratio, 0.0) for i, ratio in single_logs]
    brakes = [run.brake for run in runs]
    for group in groups if len(groups) > 1 else ():
        group_vehicle = identify([logs[place - 1] for place in group.places], settings)
        for place in group.places:
            vehicles[place - 1] = replace(group_vehicle, factor_of_logs=group.factor)
            if len(group.places) > 1:
                brakes[place - 1] = _brake_of(logs[place - 1], group_vehicle, settings)
    pairs = zip(vehicles, brakes, strict=True)
    return [_holding_own_brake(x, brake, settings.vehicle) for x, brake in pairs]


def _brake_of(
    log: AlignedLog, identified: IdentifiedVehicle, settings: Settings
) -> LogBrake | None:
    """The brake that one log shows, over that of the vehicle of all logs at this log's load."""
    has_own_load = log.vehicle != settings.vehicle
    vehicle = at_load(identified, log.vehicle) if has_own_load else identified.vehicle
    return find_log_brake(log, replace(settings, vehicle=vehicle))


def _holding_own_brake(
    identified: IdentifiedVehicle, brake: LogBrake | None, vehicle: Vehicle
) -> IdentifiedVehicle:
    """The vehicle of several logs, with a band that holds the brake that one of them shows alone.

    Nobody knows whether a gradient or its brake makes a log differ from the others. `brake` is by
    that vehicle, and `vehicle` as stated.
    """
    if identified.logs < 2 or not identified.known or not brake:
        return identified
    change = math.log(brake.ratio) * _UNLIKE**2 / (_UNLIKE**2 + brake.sigma**2)
    return with_friction_error(identified, vehicle, math.expm1(abs(change)) / Z95)


def _without_drift(group: FrictionGroup, runs: Sequence[GroupedRun]) -> list[FrictionGroup]:
    """A group of runs, or each run as a group where their brake drifts in the order of the runs.

    Gradients that differ from run to run show no such order.
    """
    brakes = [(place, brake) for place in group.places if (brake := runs[place - 1].brake)]
    n = len(brakes)
    if n < _FEWEST_OF_DRIFT:
        return [group]
    change = np.log([brake.ratio for _, brake in brakes])
    change -= change.mean()
    ranks = np.argsort(np.argsort(change))
    order = float(np.corrcoef(ranks, np.arange(n))[0, 1])  # Spearman's
    third = n // 3
    total = abs(float(np.mean(change[-third:]) - np.mean(change[:third])))
    if total < _LEAST_DRIFT or abs(order) * math.sqrt((n - 2) / max(1.0 - order**2, 1e-9)) < _CLEAR:
        return [group]
    return [FrictionGroup((place,), brake.ratio, group.u95) for place, brake in brakes]
