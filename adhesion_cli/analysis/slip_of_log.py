"""What `slip` reports of a log: slides, shares and rail of every axle."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from ..core.document import dumps
from ..core.finding import Finding
from ..core.model import Result
from ..rail.rail_under_slides import Summary, summary
from ..records.route import find_route
from ..results.slip_text import note
from .json_documents import slip_document

if TYPE_CHECKING:
    from ..results.rrd.results import Note


class SlipOfLog(NamedTuple):
    """One log."""

    result: Result
    axles: Sequence[Summary]
    findings: Sequence[Finding]  # of the log, and of the rails


def slip_of(result: Result) -> SlipOfLog:
    """The slip of an analysed log."""
    summaries, rail_findings = zip(
        *(summary(axle, result.vehicle) for axle in result.axles), strict=True
    )
    return SlipOfLog(
        result, summaries, [*result.findings, *(f for axle in rail_findings for f in axle)]
    )


def carried(slip: SlipOfLog) -> "tuple[str, list[Note]]":
    """What a result file has of it: the document, and a text on each axle with its rail."""
    log = slip.result.log
    start, route = log.start_ns(), find_route(log)
    notes = [(f"```\n{note(s, start, route)}\n```", s.rail) for s in slip.axles]
    return dumps(slip_document([log], [slip.axles], [slip.findings])), notes
