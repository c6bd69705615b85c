"""What `slip` reports of a log: slides, shares and rail of every axle."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..core.annotated import Json, as_json
from ..core.document import dumps, findings_document, tagged
from ..core.finding import Finding
from ..core.model import Result
from ..core.summary import Constant, SlipSummary
from ..rail.rail_under_slides import Summary, summary
from ..records.route import Route, find_route
from ..results.slip_text import note

if TYPE_CHECKING:
    from ..rail.fit import Interval
    from ..results.rrd.results import Note


class SlipOfLog(NamedTuple):
    """One log."""

    result: Result
    axles: Sequence[Summary]
    findings: Sequence[Finding]  # of the log, and of the rails
    route: Route  # where the train was


def slip_of(result: Result) -> SlipOfLog:
    """The slip of an analysed log."""
    pairs = [summary(axle, result.vehicle) for axle in result.axles]
    summaries, rail_findings = zip(*pairs, strict=True)
    findings = [*result.findings, *(f for axle in rail_findings for f in axle)]
    return SlipOfLog(result, summaries, findings, find_route(result.log))


def carried(slip: SlipOfLog) -> "tuple[str, list[Note]]":
    """What a result file has of it: the document, and a text on each axle with its rail."""
    start = slip.result.log.start_ns()
    notes = [(f"```\n{note(s, start, slip.route)}\n```", s.rail) for s in slip.axles]
    axles, findings = as_json(summarise_slip(slip, by_name=True)), findings_document(slip.findings)
    return dumps(tagged("slip", axles=axles, findings=findings)), notes


def slip_document(slips: Sequence[SlipOfLog], outputs: Sequence[Mapping[str, str]]) -> Json:
    """The `adhesion.slip/1` document; `outputs` are the files written of each log, by format."""
    return tagged(
        "slip",
        outputs={x.result.log.path: files for x, files in zip(slips, outputs, strict=True)},
        axles=[as_json(axle) for x in slips for axle in summarise_slip(x)],
        findings=findings_document([f for x in slips for f in x.findings]),
    )


def summarise_slip(slip: SlipOfLog, by_name: bool = False) -> list[SlipSummary]:
    """The axles of the document; what the log does not show is None.

    With `by_name`, it has the log's name, wherever it lies, in place of its path.
    """
    path = slip.result.log.path
    return [_summarise_axle(slip, Path(path).name if by_name else path, s) for s in slip.axles]


def _summarise_axle(slip: SlipOfLog, log: str, s: Summary) -> SlipSummary:
    from ..rail.applications import summarise_slide  # slow to import, and only results need it

    start_ns = slip.result.log.start_ns()
    rails = {x.start: place.rail for place in s.places for x in place.slides}
    rail, delay = s.rail, s.delay
    rail_values = (rail.peak_slip, rail.peak_mu, rail.utilisation) if rail else (None, None, None)
    peak, mu, utilisation = rail_values
    constants = rail.constants.items() if rail else ()
    return SlipSummary(
        log=log,
        axle=s.axle,
        peak_slip=peak and peak.value,
        peak_slip_ci=_limits(peak),
        peak_slip_below=rail.peak_slip_limit if rail else None,
        peak_mu=mu and mu.value,
        peak_mu_ci=_limits(mu),
        peak_speed_mps=rail.speed if rail and rail.peak_slip_limit else None,
        slip_rmse=s.slip_rmse,
        train_speed_late_s=delay and delay.value,
        train_speed_late_sigma_s=delay and delay.tolerance,
        regions=s.regions,
        utilisation=utilisation and utilisation.value,
        utilisation_ci=_limits(utilisation),
        slides=tuple(
            summarise_slide(x, start_ns, slip.route, rails.get(x.start)) for x in s.slides
        ),
        fit={name: Constant(x.value, (x.lower, x.upper)) for name, x in constants} or None,
        fit_curve="polach" if rail else None,
    )


def _limits(interval: "Interval | None") -> tuple[float, float] | None:
    return (interval.lower, interval.upper) if interval else None
