"""What is in a log: the `adhesion.inspect/1` document."""

import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ..channels.log import needed, survey, without_empty
from ..channels.meaning import name
from ..core.errors import UserError, as_user_error
from ..core.finding import Finding, Severity
from ..core.model import Log
from ..formats.memory import Signals
from ..formats.open import kind, open_source
from ..formats.source import Source
from .json_documents import channel_document, findings_document, iso
from .prepare import prepare
from .settings import Settings


class InspectedLog(NamedTuple):
    """What is in a log that can be read."""

    document: dict[str, Any]  # its entry
    findings: Sequence[Finding]
    log: Log


class LogInspection(NamedTuple):
    """One log, whatever is wrong with it."""

    document: dict[str, Any]  # its entry
    code: int  # the exit code it deserves
    findings: Sequence[Finding] = ()
    log: Log | None = None  # without channels; None where it cannot be read


def inspect(path: Path, settings: Settings, debug: bool = False) -> LogInspection:
    """One log's entry of the document, with all that was found, also where it cannot be read.

    Args:
        path: the log.
        settings: what is stated.
        debug: whether the traceback of an error goes to stderr.
    """
    try:
        document, findings, log = inspect_log(path, settings)
    except Exception as error:  # an internal error in one log must not stop the others
        if debug:
            traceback.print_exc()
        user_error = as_user_error(error)
        format_there = {"format": log_format} if (log_format := kind(path)) else {}
        failure = {
            "status": "error",
            "error": user_error.text,
            "hint": user_error.hint,
            **format_there,
        }
        return LogInspection(_blank(path) | failure, user_error.code)
    code = 3 if any(f.lossy for f in findings) else 0
    return LogInspection(document, code, findings, replace(log, channels=()))


def inspect_log(path: Path | Signals, settings: Settings) -> InspectedLog:
    """One log's entry of the document, its channels, and all that was found.

    Raises:
        UserError: where it cannot be read.
    """
    source = open_source(path, settings.read)
    log = survey(source, settings.mappings, settings.vehicle)
    findings = list(dict.fromkeys((*log.findings, *_record_findings(log, source, settings))))
    start_ns = log.start_ns()
    stop_ns = max((int(c.data.t.max()) for c in log.channels if len(c.data.t)), default=start_ns)
    worst = {f.severity for f in findings}
    document = _blank(path) | {
        "format": log.format,
        "status": "damaged" if "error" in worst else "ok",
        "rows_read": log.rows_read,
        "start": iso(start_ns) if log.absolute and log.channels else None,
        "duration_s": (stop_ns - start_ns) / 1e9,
        "time": source.time_reason,
        "stated": {k: v for k, v in source.stated.items() if k != "time"},
        "channels": [
            {
                **channel_document(c),
                "rate_hz": c.rate_hz,
                "rows": c.rows,
                "valid": len(c.data.t),
                "gaps": c.gaps,
                "duplicates": c.duplicates,
                "backward": c.backward,
            }
            for c in log.channels
        ],
        "findings": findings_document(findings),
    }
    return InspectedLog(document, findings, log)


def _blank(path: Path | Signals) -> dict[str, Any]:
    """The entry of a log of which nothing is known."""
    name = path.name if isinstance(path, Signals) else str(path)
    return {
        "path": name,
        "format": None,
        "status": "ok",
        "error": None,
        "hint": None,
        "rows_read": 0,
        "start": None,
        "duration_s": 0.0,
        "time": "",
        "stated": {},
        "channels": [],
        "findings": [],
    }


def _record_findings(log: Log, source: Source, settings: Settings) -> list[Finding]:
    """What only the channels together show, as a stuck speed; or why there is no record."""
    severity: Severity = "info"
    try:
        chosen, findings = needed(source, settings.mappings)
        chosen_keys = {(name(m.field), m.field.path, m.axle) for m in chosen}
        meant = tuple(
            c for c in log.channels if (c.name, c.field, c.axle) in chosen_keys and c.meaning
        )
        severity = "warning"  # where all of what is needed is lost
        whole_log = without_empty(replace(log, channels=meant))
        severity = "info"
        checked = prepare(whole_log, settings.vehicle, checks=settings.checks)
        return [*findings, *whole_log.findings, *checked.findings]
    except UserError as error:
        names = {"reason": error.text.rstrip("."), "hint": error.hint}
        return [Finding("not-analysable", severity, names=names)]
