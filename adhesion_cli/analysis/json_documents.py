"""The JSON documents that other programs read; their keys are a contract."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.annotated import Json, as_json
from ..core.document import dumps, findings_document, tagged
from ..core.finding import Finding
from ..core.model import Log
from ..core.summary import Constant, FailedLog, ResultSummary, SlipSummary
from ..records.route import find_route

if TYPE_CHECKING:
    from ..rail.fit import Interval
    from ..rail.rail_under_slides import Summary


def result_document(results: Sequence[ResultSummary | FailedLog]) -> Json:
    """The `adhesion.result/1` document."""
    return tagged("result", results=[_entry(one) for one in results])


def _entry(one: ResultSummary | FailedLog) -> Json:
    if isinstance(one, FailedLog):
        return {"log": {"path": one.path}, "error": one.error, "hint": one.hint}
    entry: Json = as_json(one)
    return entry


def embedded(results: Sequence[ResultSummary]) -> str:
    """The document as a result file carries it: by file names, wherever the files lie."""
    entries = [_entry(one) for one in results]
    for entry in entries:
        del entry["outputs"]
        entry["log"] |= {"path": Path(entry["log"]["path"]).name}
    return dumps(tagged("result", results=entries))


def slip_document(
    logs: Sequence[Log],
    summaries: "Sequence[Sequence[Summary]]",
    findings: Sequence[Sequence[Finding]],
    outputs: Sequence[Mapping[str, str]] = (),
) -> Json:
    """The `adhesion.slip/1` document.

    Args:
        logs: the analysed logs.
        summaries: of each log's axles.
        findings: of each log.
        outputs: the files written of each log, by format, which the document names by log; without
            them it is the one that a result carries, with the log's name wherever it lies.
    """
    axles = [
        as_json(summarise_slip(log.path if outputs else Path(log.path).name, log, s))
        for log, of_log in zip(logs, summaries, strict=True)
        for s in of_log
    ]
    all_findings = findings_document([f for of_log in findings for f in of_log])
    if not outputs:
        return tagged("slip", axles=axles, findings=all_findings)
    files = {log.path: of_log for log, of_log in zip(logs, outputs, strict=True)}
    return tagged("slip", outputs=files, axles=axles, findings=all_findings)


def summarise_slip(name: str, log: Log, summary: "Summary") -> SlipSummary:
    """One axle of the `adhesion.slip/1` document; what the log does not show is None.

    Args:
        name: that the document gives the log.
        log: of the axle.
        summary: of the axle.
    """
    from ..rail.applications import summarise_slide  # slow to import, and only results need it

    route = find_route(log)
    rails = {x.start: place.rail for place in summary.places for x in place.slides}
    rail, delay = summary.rail, summary.delay
    peak, mu, used = (rail.peak_slip, rail.peak_mu, rail.utilisation) if rail else (None,) * 3
    constants = rail.constants.items() if rail else ()
    return SlipSummary(
        log=name,
        axle=summary.axle,
        peak_slip=peak and peak.value,
        peak_slip_ci=_limits(peak),
        peak_slip_below=rail.peak_slip_limit if rail else None,
        peak_mu=mu and mu.value,
        peak_mu_ci=_limits(mu),
        peak_speed_mps=rail.speed if rail and rail.peak_slip_limit else None,
        slip_rmse=summary.slip_rmse,
        train_speed_late_s=delay and delay.value,
        train_speed_late_sigma_s=delay and delay.tolerance,
        regions=summary.regions,
        utilisation=used and used.value,
        utilisation_ci=_limits(used),
        slides=tuple(
            summarise_slide(x, log.start_ns(), route, rails.get(x.start)) for x in summary.slides
        ),
        fit={name: Constant(x.value, (x.lower, x.upper)) for name, x in constants} or None,
        fit_curve="polach" if rail else None,
    )  # fmt: skip


def _limits(interval: "Interval | None") -> tuple[float, float] | None:
    return (interval.lower, interval.upper) if interval else None
