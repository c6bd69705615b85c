"""What the events of a result say: findings, brake applications, slides, changes of region."""

from collections.abc import Iterator
from typing import NamedTuple

from ..core import signals
from ..core.finding import Finding, Severity
from ..core.model import Result
from ..core.text import printable


class LogEvent(NamedTuple):
    """One line of them."""

    t: int  # [ns]
    code: str
    severity: Severity
    axle: int | None
    message: str


def text(finding: Finding) -> str:
    """What a finding says, on one line."""
    channel = f"{finding.channel}: " if finding.channel else ""
    often = f" ({finding.count} ×)" if finding.count > 1 else ""
    return printable(f"{channel}{finding.message}{often}")


def of_result(result: Result) -> Iterator[LogEvent]:
    """All of one log, axle by axle."""
    start = result.log.start_ns()
    axle_of = {c.title: c.axle for c in result.log.channels}
    axle_of |= {f"axle {a.record.axle}": a.record.axle for a in result.axles}
    for f in result.findings:
        t = start + round((f.first_s or 0.0) * 1e9)
        yield LogEvent(t, f.code, f.severity, axle_of.get(f.channel), text(f))
    for axle in result.axles:
        N, t_ns = axle.record.axle, axle.record.t
        for s in axle.applications:
            pressed, is_released = signals.pressed_part(axle.record, s)
            rows = {"applied": pressed.start, "released": pressed.stop - 1}
            for event in ("applied", "released")[: 1 + is_released]:
                message, t = f"axle {N}: brake {event}", int(t_ns[rows[event]])
                yield LogEvent(t, f"brake-{event}", "info", N, message)
        for x in axle.events:
            yield LogEvent(x.t, x.code, "info", N, x.message)
