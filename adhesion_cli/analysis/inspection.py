"""What is in a log: the `adhesion.inspect/1` document."""

import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ..channels.log import needed, survey, without_empty
from ..core.errors import UserError, as_user_error
from ..core.finding import Finding, Severity
from ..core.model import INPUTS, Channel, Log
from ..core.summary import (
    InspectedChannel,
    InspectedLog,
    VehicleSummary,
    summarise_finding,
    summarise_vehicle,
)
from ..core.text import iso
from ..formats.memory import Signals
from ..formats.open import kind, open_source
from ..formats.source import Source
from ..records.route import check_route
from .identify import identify
from .prepare import align_log
from .request import further_meanings, load_vehicle
from .settings import Settings
from .stated_track import track_of_log
from .summarise import summarise_channel
from .vehicle_findings import diagnose_with


class LogInspection(NamedTuple):
    """One log, whatever is wrong with it."""

    summary: InspectedLog
    code: int  # the exit code it deserves
    findings: Sequence[Finding] = ()
    log: Log | None = None  # None where it cannot be read
    vehicle: VehicleSummary | None = None  # None where the log cannot be analysed


def inspect(path: Path, settings: Settings, debug: bool = False) -> LogInspection:
    """What is in a log, also where it cannot be read.

    With `debug`, the traceback of an error goes to stderr.
    """
    try:
        inspection = inspect_log(path, settings)
    except Exception as error:  # an internal error in one log must not stop the others
        if debug:
            traceback.print_exc()
        user_error = as_user_error(error)
        summary = InspectedLog(
            path=str(path), format=kind(path) or None, status="error",
            error=user_error.text, hint=user_error.hint,
        )  # fmt: skip
        return LogInspection(summary, user_error.code)
    assert inspection.log is not None
    return inspection._replace(log=replace(inspection.log, channels=()))


def inspect_log(path: Path | Signals, settings: Settings) -> LogInspection:
    """What is in a log, with its channels.

    Raises:
        UserError: where it cannot be read.
    """
    source = open_source(path, settings.read)
    log = survey(source, settings.mappings, settings.vehicle)
    vehicle, record_findings = _judge_records(log, source, settings)
    findings = list(dict.fromkeys((*log.findings, *record_findings)))
    start_ns = log.start_ns()
    stop_ns = max((int(c.data.t.max()) for c in log.channels if len(c.data.t)), default=start_ns)
    summary = InspectedLog(
        path=path.name if isinstance(path, Signals) else str(path),
        format=log.format,
        status="damaged" if any(f.severity == "error" for f in findings) else "ok",
        rows_read=log.rows_read,
        start=iso(start_ns) if log.absolute and log.channels else None,
        duration_s=(stop_ns - start_ns) / 1e9,
        time=source.time_reason,
        stated=_stated(source, log),
        channels=tuple(map(_inspect_channel, log.channels)),
        findings=tuple(map(summarise_finding, findings)),
    )
    code = 3 if any(f.lossy for f in findings) else 0
    return LogInspection(summary, code, findings, log, vehicle)


def _stated(source: Source, log: Log) -> dict[str, object]:
    """What the log states beside its channels, and as what its columns of words are used."""
    stated_meanings = {k: v for k, v in source.reasons.items() if k != "time"}
    uses = {c.name: f"used as {c.meaning}" for c in log.channels if c.levels}
    columns = (f"{f.channel} ({uses.get(f.channel, 'not used')})" for f in source.texts)
    return stated_meanings | ({"words": ", ".join(columns)} if source.texts else {})


def _inspect_channel(c: Channel) -> InspectedChannel:
    summary = summarise_channel(c)
    return InspectedChannel(
        summary.name, summary.field, summary.meaning, summary.axle, summary.unit, summary.reason,
        rate_hz=c.rate_hz, rows=c.rows, valid=len(c.data.t) - len(c.held), gaps=c.gaps,
        duplicates=c.duplicates, backward=c.backward, levels=c.levels,
    )  # fmt: skip


def _judge_records(
    log: Log, source: Source, settings: Settings
) -> tuple[VehicleSummary | None, list[Finding]]:
    """The vehicle, and what only the channels together show; or why there is no record."""
    severity: Severity = "info"
    try:
        other_meanings = further_meanings(settings)
        chosen, findings = needed(source, settings.mappings, other_meanings)
        chosen_keys = {(m.field.name, m.field.path, m.axle) for m in chosen}
        meanings = {*INPUTS, *other_meanings}
        channels = (c for c in log.channels if (c.name, c.field, c.axle) in chosen_keys)
        meant = tuple(c for c in channels if c.meaning in meanings)
        severity = "warning"  # where all of what is needed is lost
        whole_log = without_empty(replace(log, channels=meant))
        severity = "info"
        settings, load_findings = load_vehicle(settings, whole_log)
        track = track_of_log(settings.track, source.path.name)
        aligned = align_log(whole_log, settings.vehicle, checks=settings.checks, track=track)
        identified = identify([aligned], settings)
        vehicle_findings, checked = diagnose_with(aligned, identified, settings)
        said = [f for f in vehicle_findings if f.code != "vehicle-default"]
        places = check_route(whole_log, settings.vehicle)
        findings = [*load_findings, *findings, *whole_log.findings, *checked.findings, *places]
        return summarise_vehicle(identified), [*said, *findings]
    except UserError as error:
        names = {"reason": error.text.rstrip("."), "hint": error.hint}
        return None, [Finding("not-analysable", severity, names=names)]
