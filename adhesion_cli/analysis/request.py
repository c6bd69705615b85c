"""What a run is asked for: estimators, window and settings that exist, and a log that opens."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ..channels.log import read
from ..core import estimator
from ..core.errors import UserError, unknown
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import PLACES, STATES, Log, Meaning
from ..formats.memory import Signals
from ..formats.open import open_source
from ..formats.source import Source
from ..records.faults import Window
from ..reference import force
from . import loads
from . import settings as settings_module
from .settings import VEHICLE_USES, Settings
from .stated_track import track_of_log


def choose_estimators(algos: Sequence[str]) -> list[Estimator]:
    """The estimators of these names in any case, every one if none is named.

    Raises:
        UserError: for a name the registry does not have.
    """
    by_name = estimator.registry()
    for name in algos:
        if name.lower() not in by_name:
            raise unknown("algorithm", name, list(by_name))
    names = dict.fromkeys(name.lower() for name in algos)
    return [by_name[name] for name in names] or list(by_name.values())


def check_settings(settings: Settings) -> Settings:
    """The settings, if the methods they name exist.

    Raises:
        UserError: for an unknown reference, or another use of the vehicle.
    """
    if settings.analysis.vehicle not in VEHICLE_USES:
        raise unknown("vehicle", settings.analysis.vehicle, list(VEHICLE_USES))
    if settings.analysis.reference not in force.METHODS:
        raise unknown("reference", settings.analysis.reference, list(force.METHODS))
    return settings


def check_request(settings: Settings, algos: Sequence[str], window: Window) -> Settings:
    """The same settings, after a check of what a run is asked for.

    Raises:
        UserError: for an unknown name, a value out of range.
    """
    choose_estimators(algos)
    by_flag = dict(zip(("--from", "--to"), window, strict=True))
    span = {flag: value for flag, value in by_flag.items() if value is not None}
    in_order = span.get("--from", 0.0) < span.get("--to", math.inf)
    if not (in_order and all(map(math.isfinite, span.values()))):
        text = " and ".join(f"{flag} {value:g}" for flag, value in span.items())
        hint = "--to is later than --from; both are seconds after the log's start"
        raise UserError(f"{text} are not two times in order", hint, code=2)
    return check_settings(settings)


def read_log(path: Path | Signals, settings: Settings) -> tuple[Settings, Log]:
    """A log with its channels' meanings, and the settings of its analysis.

    They are over those that a result file carries.

    Raises:
        UserError: where it cannot be read, and for wrong settings.
    """
    source = open_source(path, settings.read)
    if carried := _carried(path, source):
        settings = settings.over(settings_module.nested(carried))
    track = track_of_log(settings.track, source.path.name)
    settings = check_settings(replace(settings, track=track))
    max_gap_ns, meanings = round(settings.analysis.max_gap * 1e9), further_meanings(settings)
    return settings, read(source, settings.mappings, settings.vehicle, max_gap_ns, meanings)


def further_meanings(settings: Settings) -> tuple[Meaning, ...]:
    """The meanings of channels that these settings need beside brake and speeds."""
    meanings: tuple[Meaning, ...] = (*PLACES, "brake_pipe", "reservoir_pressure", *STATES)
    if not settings.track.profile:
        meanings = (*meanings, "gradient")
    return (*meanings, "load_pressure") if loads.states_load(settings.vehicle) else meanings


def load_vehicle(settings: Settings, log: Log) -> tuple[Settings, list[Finding]]:
    """The settings with the axle masses that the load pressures of a log show, and what to report.

    They are as stated where no load is stated.
    """
    if not loads.states_load(settings.vehicle):
        return settings, []
    vehicle, findings = loads.with_load(settings.vehicle, log)
    return replace(settings, vehicle=vehicle), findings


def _carried(path: Path | Signals, source: Source) -> Mapping[str, str]:
    """The settings that a result file was made with; none of a raw log."""
    if any(name.startswith("adhesion.settings/") for name in source.metadata):
        hint = "name the logs themselves or their *.adhesion.mcap"
        raise UserError(f"{path}: a comparison of several logs, not a log", hint)
    return source.metadata.get("adhesion.settings", {})
