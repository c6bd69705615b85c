"""The JSON documents that other programs read; their keys are a contract."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.annotated import Json, as_json
from ..core.finding import Finding
from ..core.model import Log
from ..core.summary import Constant, FailedLog, ResultSummary, SlideSummary, SlipSummary
from ..core.text import utf8
from .summarise import summarise_finding

if TYPE_CHECKING:
    from ..rail.fit import Interval
    from ..rail.rail_under_slides import Summary
    from ..wsp import wsp_controller
    from ..wsp.plant import Track
    from ..wsp.replay import Answer, Case
    from ..wsp.scenario import Limit, Scenario
    from ..wsp.stop import Stop
    from ..wsp.sweep import SweepRow


def tagged(kind: str, **body: Any) -> Json:
    """A document of this kind; what the run wrote stands in its `outputs`, by format."""
    return {"schema": f"adhesion.{kind}/1", **body}


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
        as_json(summarise_slip(log.path if outputs else Path(log.path).name, log.start_ns(), s))
        for log, of_log in zip(logs, summaries, strict=True)
        for s in of_log
    ]
    all_findings = findings_document([f for of_log in findings for f in of_log])
    if not outputs:
        return tagged("slip", axles=axles, findings=all_findings)
    files = {log.path: of_log for log, of_log in zip(logs, outputs, strict=True)}
    return tagged("slip", outputs=files, axles=axles, findings=all_findings)


def summarise_slip(log: str, start_ns: int, summary: "Summary") -> SlipSummary:
    """One axle of the `adhesion.slip/1` document; what the log does not show is None."""
    rail, delay = summary.rail, summary.delay
    peak, mu, used = (rail.peak_slip, rail.peak_mu, rail.utilisation) if rail else (None,) * 3
    constants = rail.constants.items() if rail else ()
    return SlipSummary(
        log=log,
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
            SlideSummary(
                (x.start - start_ns) / 1e9, x.duration, x.distance, x.max_slip, x.energy,
                x.is_lower_bound,
            )
            for x in summary.slides
        ),
        fit={name: Constant(x.value, (x.lower, x.upper)) for name, x in constants} or None,
        fit_curve="polach" if rail else None,
    )  # fmt: skip


def _limits(interval: "Interval | None") -> tuple[float, float] | None:
    return (interval.lower, interval.upper) if interval else None


def antiskid_document(
    stop: "Stop",
    scenario: str,
    parameters: Mapping[str, Mapping[str, float]],
    dry: float | None,
    controllers: Mapping[str, Mapping[str, float | None]],
    **more: Any,
) -> Json:
    """The `adhesion.antiskid/1` document.

    Args:
        stop: one of the stops: they share estimator and seed.
        scenario: its name.
        parameters: in force, from `wsp_controller.parameters`.
        dry: stopping distance on dry rail [m], None where it is not known.
        controllers: fields of each controller's `Verdict`.
        more: limits, or entries of a replayed log.
    """
    return tagged(
        "antiskid",
        scenario=scenario,
        seed=stop.seed,
        estimator=stop.algo,
        parameters=parameters,
        dry_distance_m=dry,
        controllers=controllers,
        **more,
    )


def replay_document(
    log: str,
    case: "Case",
    parameters: Mapping[str, Mapping[str, float]],
    dry: float | None,
    answers: "dict[str, Answer]",
    findings: Sequence[Finding],
) -> Json:
    """The `adhesion.antiskid/1` document; medians of the draws with their 95 % intervals."""
    median = {law: {k: x and x[0] for k, x in a.values.items()} for law, a in answers.items()}
    spread = {
        law: {k: x and list(x[1:]) for k, x in a.values.items()} for law, a in answers.items()
    }
    stop = next(iter(answers.values())).stop
    return antiskid_document(
        stop,
        case.scenario.name,
        parameters,
        dry,
        median,
        log=log,
        draws=len(case.draws),
        start_s=case.start_s,
        logged_distance_m=case.logged_m,
        intervals=spread,
        compared={law: a.compared._asdict() for law, a in answers.items()},
        findings=findings_document(findings),
    )


def limits_document(rows: "Sequence[tuple[str, Limit, bool | float]]") -> list[Json]:
    """Which controller keeps which limit, or in what share; an end that is not stated is None."""
    return [
        {
            "controller": law,
            "quantity": x.quantity,
            "least": finite(x.least),
            "most": finite(x.most),
            "source": x.source,
            "kept": ok,
        }
        for law, x, ok in rows
    ]


def stop_settings(
    stop: "Stop",
    case: "Scenario",
    settings: "wsp_controller.Settings",
    track: "Track | None" = None,
    **more: str,
) -> Json:
    """All that a stop was made from, as the settings its file carries.

    Args:
        stop: the stop.
        case: its scenario.
        settings: as stated.
        track: the fitted rail, where that is not the scenario's.
        more: on the log it was fitted to.
    """
    from ..wsp import wsp_controller  # slow to import, and only this needs it
    from .settings import Settings, tree

    unused = ("vehicle", "sensor", "wsp", "limit")  # the vehicle has its own section
    loop: Json = {"controller": stop.controller, "estimator": stop.algo, **more}
    scenario = {k: v for k, v in asdict(case).items() if k not in unused}
    if track:  # its last knot is at infinity
        knots, conditions = track.knots[:-1].tolist(), track.values[:, :-1].tolist()
        scenario["rail"] = {"knots": knots, "conditions": conditions}
    loop["scenario"] = _as_json({**scenario, "seed": stop.seed})
    return {
        **tree(Settings(case.vehicle, bands=wsp_controller.bands(settings)), []),
        **wsp_controller.parameters([stop.controller], stop.algo, settings),
        "antiskid": loop,
    }


def _as_json(value: Any) -> Any:
    """As JSON has it; what is not stated, or without a limit, is left out."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {k: _as_json(v) for k, v in value.items() if v is not None and v != math.inf}
    if isinstance(value, list | tuple):
        return [_as_json(v) for v in value]
    return value


def sweep_document(
    scenario: str,
    seeds: int,
    algo: str,
    parameters: Mapping[str, Mapping[str, float]],
    rows: "Sequence[SweepRow]",
) -> Json:
    """The `adhesion.antiskid-sweep/1` document; every value is [mean, 2.5 %, 97.5 %] or None.

    `kept` of a limit is the share of the seeds.
    """
    rails: dict[str, Json] = {}
    for r in rows:
        rails.setdefault(r.rail, {})[r.controller] = {**r.values, **r.compared._asdict()}
    limits = [
        {"rail": r.rail, **x}
        for r in rows
        for x in limits_document([(r.controller, *row_limit) for row_limit in r.limits])
    ]
    return tagged(
        "antiskid-sweep",
        scenario=scenario,
        seeds=seeds,
        estimator=algo,
        parameters=parameters,
        dry_distance_m=rows[0].dry_distance_m,
        rails=rails,
        limits=limits,
        outputs={},
    )


def findings_document(findings: Sequence[Finding]) -> list[Json]:
    """Findings as the JSON names them."""
    return [as_json(summarise_finding(f)) for f in findings]


def finite(value: float) -> float | None:
    """The number, None where JSON has none for it."""
    return value if math.isfinite(value) else None


def dumps(document: Json) -> str:
    """A document as JSON in ASCII, for any terminal; a NaN in it is an error and raises.

    A file name that is not UTF-8 has codes for the bytes that are none, as no JSON holds them.
    """
    text = json.dumps(_utf8(document), indent=1, allow_nan=False)
    return text.replace("\x7f", "\\u007f")  # the one control character that JSON leaves


def _utf8(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _utf8(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_utf8(v) for v in value]
    return utf8(value) if isinstance(value, str) else value
