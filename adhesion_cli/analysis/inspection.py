"""What is in a log: the `adhesion.inspect/1` document."""

import traceback
from collections.abc import Callable, Sequence
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


class Inspected(NamedTuple):
    """What is in a log that can be read."""

    document: dict[str, Any]  # its entry
    findings: Sequence[Finding]
    log: Log


class Seen(NamedTuple):
    """One log, whatever is wrong with it."""

    document: dict[str, Any]  # its entry
    code: int  # the exit code it deserves
    findings: Sequence[Finding] = ()
    log: Log | None = None  # without channels; None where it cannot be read


def inspect(path: Path, load: Callable[..., Settings], debug: bool = False) -> Seen:
    """One log's entry of the document, with all that was found, also where it cannot be read.

    Args:
        path: the log.
        load: gives the settings.
        debug: whether the traceback of an error goes to stderr.

    Raises:
        UserError: for settings that cannot be loaded.
    """
    settings = load()
    try:
        document, findings, log = inspected(path, settings)
    except Exception as error:  # an internal error in one log must not stop the others
        if debug:
            traceback.print_exc()
        told = as_user_error(error)
        known = {"format": found} if (found := kind(path)) else {}
        wrong = {"status": "error", "error": told.text, "hint": told.hint, **known}
        return Seen(_blank(path) | wrong, told.code)
    code = 3 if any(f.lossy for f in findings) else 0
    return Seen(document, code, findings, replace(log, channels=()))


def inspected(path: Path | Signals, settings: Settings) -> Inspected:
    """One log's entry of the document, its channels, and all that was found.

    Raises:
        UserError: where it cannot be read.
    """
    source = open_source(path, settings.read)
    log = survey(source, settings.mappings, settings.vehicle)
    findings = list(dict.fromkeys((*log.findings, *_of_records(log, source, settings))))
    first = log.start_ns()
    last = max((int(c.data.t.max()) for c in log.channels if len(c.data.t)), default=first)
    worst = {f.severity for f in findings}
    document = _blank(path) | {
        "format": log.format,
        "status": "damaged" if "error" in worst else "ok",
        "rows_read": log.rows_read,
        "start": iso(first) if log.absolute and log.channels else None,
        "duration_s": (last - first) / 1e9,
        "time": source.time_reason,
        "stated": {k: v for k, v in source.stated.items() if k != "time"},
        "channels": [
            {
                **channel_document(c), "rate_hz": c.rate_hz, "rows": c.rows,
                "valid": len(c.data.t), "gaps": c.gaps, "duplicates": c.duplicates,
                "backward": c.backward,
            }
            for c in log.channels
        ],
        "findings": findings_document(findings),
    }  # fmt: skip
    return Inspected(document, findings, log)


def _blank(path: Path | Signals) -> dict[str, Any]:
    """The entry of a log of which nothing is known."""
    name = path.name if isinstance(path, Signals) else str(path)
    return {
        "path": name, "format": None, "status": "ok", "error": None, "hint": None,
        "rows_read": 0, "start": None, "duration_s": 0.0, "time": "", "stated": {},
        "channels": [], "findings": [],
    }  # fmt: skip


def _of_records(log: Log, source: Source, settings: Settings) -> list[Finding]:
    """What only the channels together show, as a stuck speed; or why there is no record."""
    severity: Severity = "info"
    try:
        chosen, findings = needed(source, settings.mappings)
        taken = {(name(m.field), m.field.path, m.axle) for m in chosen}
        meant = tuple(c for c in log.channels if (c.name, c.field, c.axle) in taken and c.meaning)
        severity = "warning"  # where all of what is needed is lost
        full = without_empty(replace(log, channels=meant))
        severity = "info"
        checked = prepare(full, settings.vehicle, checks=settings.checks)
        return [*findings, *full.findings, *checked.findings]
    except UserError as error:
        names = {"reason": error.text.rstrip("."), "hint": error.hint}
        return [Finding("not-analysable", severity, names=names)]
