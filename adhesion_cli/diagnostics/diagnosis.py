"""What the channels of one log say about each other, and what physics forbids.

Nothing is changed here: every finding names what to state so that the log is understood.
"""

from collections.abc import Mapping
from typing import Any

from ..core.finding import Finding
from ..records.screen import Thresholds
from .registry import registry
from .scene import Scene

Checks = Mapping[str, Any]  # parameters of checks, by the check's name


def diagnose(scene: Scene, params: Checks | None = None) -> list[Finding]:
    """Everything that cannot be true, or hardly; `params` are by the name of a check."""
    findings: list[Finding] = []
    groups_that_warned: set[str] = set()
    for name, check in registry().items():
        if check.about.group not in groups_that_warned:
            check_findings = list(check.check((params or {}).get(name, check.Params()), scene))
            findings += check_findings
            groups_that_warned |= {
                check.about.group for f in check_findings if f.severity != "info"
            }
    return findings


def sensor_thresholds(params: Checks | None) -> Thresholds:
    """The parameters of the checks of single channels, of those of all checks."""
    return Thresholds(**{k: p for k, p in (params or {}).items() if k in Thresholds._fields})
