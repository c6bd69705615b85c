"""What the events of a result say: findings, brake applications, slides, changes of region."""

from collections.abc import Iterator

from ..core import signals
from ..core.finding import Finding
from ..core.model import Event, Result
from ..core.text import printable


def text(finding: Finding) -> str:
    """What a finding says, on one line."""
    channel = f"{finding.channel}: " if finding.channel else ""
    often = f" ({finding.count} ×)" if finding.count > 1 else ""
    return printable(f"{channel}{finding.message}{often}")


def of_result(result: Result) -> Iterator[Event]:
    """All of one log, axle by axle."""
    start = result.log.start_ns()
    axle_of = {c.title: c.axle for c in result.log.channels}
    axle_of |= {f"axle {a.record.axle}": a.record.axle for a in result.axles}
    for f in result.findings:
        t = start + round((f.first_s or 0.0) * 1e9)
        yield Event(t, f.code, text(f), None, axle_of.get(f.channel), f.severity)
    for axle in result.axles:
        N, t_ns = axle.record.axle, axle.record.t
        for s in axle.applications:
            pressed, is_released = signals.pressed_part(axle.record, s)
            rows = ("applied", pressed.start), ("released", pressed.stop - 1)
            for event, row in rows[: 1 + is_released]:
                yield Event(int(t_ns[row]), f"brake-{event}", f"axle {N}: brake {event}", axle=N)
        yield from axle.events
