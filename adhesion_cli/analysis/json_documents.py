"""The JSON documents that other programs read; their keys are a contract."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.finding import Finding
from ..core.model import AxleResult, Channel, Floats, Log, Result
from ..core.text import utf8

if TYPE_CHECKING:
    from ..core.stop import Stop
    from ..rail.applications import Application, Measured
    from ..rail.events import Slide
    from ..rail.slip import Summary
    from ..reference import budget
    from ..reference.budget import Budget
    from ..wsp import wsp_controller
    from ..wsp.plant import Track
    from ..wsp.replay import Answer, Case
    from ..wsp.scenario import Limit, Scenario
    from ..wsp.sweep import Row


class Coverage(NamedTuple):
    """The uncertainty of the mean force; names as in the JSON."""

    u_n: float  # combined standard uncertainty [N]
    k: float  # coverage factor of 95 %
    degrees_of_freedom: float | None  # effective ones; None where noise has no part


@dataclass(frozen=True, slots=True)
class BrakeApplication:
    """One brake application of one axle; names as in the JSON. None is what the log does not show.

    Attributes:
        axle: its number, from 1.
        start_s: from here, seconds after the start of the log.
        end_s: to here [s].
        from_mps: speed at the start: the train's, else that of the wheel's rim [m/s].
        to_mps: speed at the end [m/s].
        force_n: adhesion force [N]: mean and highest, each with its expanded uncertainty (95 %).
        coefficient: adhesion coefficient µ [-], as the force.
        slides: how many begin in it.
        slide_spans: from and to of each [s].
        slide_s: duration of all slides together [s].
        slide_distance_m: distance of the train in them [m].
        max_slip: the largest [-].
        slide_energy_j: energy of friction between wheel and rail [J].
        at_least: whether the numbers of the slides are lower bounds.
        utilisation: mean adhesion in the slides over the highest that the rail could give [-].
        utilisation_ci: its 95 % interval.
        budget: what each quantity adds to the uncertainty of the mean force.
        coverage: what they give together.
        slip_unknown_s: time in which the wheel turns and no train speed shows its slip [s].
    """

    axle: int
    start_s: float
    end_s: float
    from_mps: float | None
    to_mps: float | None
    force_n: "Measured | None"
    coefficient: "Measured | None"
    slides: int
    slide_spans: tuple[tuple[float, float], ...]
    slide_s: float
    slide_distance_m: float
    max_slip: float | None
    slide_energy_j: float | None
    at_least: bool
    utilisation: float | None
    utilisation_ci: tuple[float, float] | None
    budget: "tuple[budget.Row, ...] | None"
    coverage: Coverage | None
    slip_unknown_s: float


def tagged(kind: str, **body: Any) -> dict[str, Any]:
    """A document of this kind; what the run wrote stands in its `outputs`, by format."""
    return {"schema": f"adhesion.{kind}/1", **body}


def document(entries: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The `adhesion.result/1` document of the entries that `entry` made."""
    return tagged("result", results=list(entries))


def entry(
    result: Result,
    outputs: dict[str, str],
    braked: Mapping[int, Sequence[BrakeApplication]] | None = None,
) -> dict[str, Any]:
    """One log's entry; numbers that do not exist are None.

    Args:
        result: the analysed log.
        outputs: the files written, by kind.
        braked: what `brake_applications` gave, if that is known.
    """
    braked = brake_applications(result) if braked is None else braked
    log = result.log
    used_channels = [c for c in log.channels if c.meaning]
    start_ns = log.start_ns()
    stop_ns = max((int(c.data.t.max()) for c in used_channels if len(c.data.t)), default=start_ns)
    return {
        "log": {
            "path": log.path,
            "format": log.format,
            "sha256": log.sha256,
            "start": iso(start_ns) if log.absolute else None,
            "duration_s": (stop_ns - start_ns) / 1e9,
            "rows_read": log.rows_read,
            "rows_used": rows_used(result),
        },
        "outputs": outputs,
        "axles": [_axle(a, result, braked[a.record.axle]) for a in result.axles],
        "channels": [channel_document(c) for c in used_channels],
        "findings": findings_document(result.findings),
    }


def embedded(entries: Sequence[dict[str, Any]]) -> str:
    """The document as a result file carries it: by file names, wherever the files lie."""
    carried = [{key: item for key, item in entry.items() if key != "outputs"} for entry in entries]
    for entry in carried:
        entry["log"] = {**entry["log"], "path": Path(entry["log"]["path"]).name}
    return dumps(document(carried))


def _axle(axle: AxleResult, result: Result, braked: Sequence[BrakeApplication]) -> dict[str, Any]:
    ref = axle.reference
    # While the wheel only rolls, force and errors are almost zero.
    selected = np.r_[axle.applications] if axle.applications else slice(None)
    return {
        "axle": axle.record.axle,
        "reference": {
            "method": ref.method,
            "sigma_n": _median(ref.sigma[selected]),
            "band_n": _median(ref.half_width[selected]),
            "nis": ref.nis and asdict(ref.nis),
        },
        "applications": [
            {f.name: _mapped(getattr(x, f.name)) for f in fields(x) if f.name != "axle"}
            for x in braked
        ],
        "estimators": [{k: x for k, x in asdict(s).items() if k != "blocks"} for s in axle.scores],
    }


def brake_applications(result: Result) -> dict[int, tuple[BrakeApplication, ...]]:
    """The brake applications of each axle, by its number, in the order of time."""
    from ..rail.applications import find_applications  # slow to import, and only results need it

    start = result.log.start_ns()
    return {
        a.record.axle: tuple(
            _application(a.record.axle, x, start) for x in find_applications(a, result.vehicle)
        )
        for a in result.axles
    }


def _application(axle: int, x: "Application", start_ns: int) -> BrakeApplication:
    slides, utilisation = x.slides, x.utilisation
    return BrakeApplication(
        axle=axle,
        start_s=(x.start_ns - start_ns) / 1e9,
        end_s=(x.end_ns - start_ns) / 1e9,
        from_mps=x.from_mps,
        to_mps=x.to_mps,
        force_n=x.force,
        coefficient=x.coefficient,
        slides=len(slides),
        slide_spans=tuple(_span(s, start_ns) for s in slides),
        slide_s=sum(s.duration for s in slides),
        slide_distance_m=sum(s.distance for s in slides),
        max_slip=max((s.max_slip for s in slides), default=None),
        slide_energy_j=_sum([s.energy for s in slides]),
        at_least=any(s.is_lower_bound for s in slides),
        utilisation=utilisation and utilisation.value,
        utilisation_ci=utilisation and (utilisation.lower, utilisation.upper),
        budget=x.budget and x.budget.rows,
        coverage=x.budget and _coverage(x.budget),
        slip_unknown_s=x.unknown_time,
    )


def _span(slide: "Slide", start_ns: int) -> tuple[float, float]:
    begin = (slide.start - start_ns) / 1e9
    return begin, begin + slide.duration


def _mapped(value: Any) -> Any:
    """Records as tables and tuples as lists."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {k: _mapped(v) for k, v in value.items()}
    return [_mapped(v) for v in value] if isinstance(value, tuple) else value


def _coverage(b: "Budget") -> Coverage:
    return Coverage(b.u, b.k, b.freedom if math.isfinite(b.freedom) else None)


def _sum(values: Sequence[float | None]) -> float | None:
    """None where one is not known."""
    numbers = [v for v in values if v is not None]
    return sum(numbers) if len(numbers) == len(values) else None


def slip_document(
    logs: Sequence[Log],
    summaries: "Sequence[Sequence[Summary]]",
    findings: Sequence[Sequence[Finding]],
    outputs: Sequence[Mapping[str, str]] = (),
) -> dict[str, Any]:
    """The `adhesion.slip/1` document.

    Args:
        logs: the analysed logs.
        summaries: of each log's axles.
        findings: of each log.
        outputs: the files written of each log, by format, which the document names by log; without
            them it is the one that a result carries, with the log's name wherever it lies.
    """
    axles = [
        _slip_axle(log.path if outputs else Path(log.path).name, log.start_ns(), s)
        for log, of_log in zip(logs, summaries, strict=True)
        for s in of_log
    ]
    all_findings = findings_document([f for of_log in findings for f in of_log])
    if not outputs:
        return tagged("slip", axles=axles, findings=all_findings)
    files = {log.path: of_log for log, of_log in zip(logs, outputs, strict=True)}
    return tagged("slip", outputs=files, axles=axles, findings=all_findings)


def _slip_axle(log: str, start_ns: int, summary: "Summary") -> dict[str, Any]:
    """One axle of the `adhesion.slip/1` document; what the log does not show is None."""
    rail = summary.rail
    peak, mu, utilisation = (
        (rail.peak_slip, rail.peak_mu, rail.utilisation) if rail else (None,) * 3
    )
    fit = None
    if rail and rail.constants:
        fit = {
            name: {"value": x.value, "ci": [x.lower, x.upper]} for name, x in rail.constants.items()
        }
    return {
        "log": log,
        "axle": summary.axle,
        "peak_slip": peak and peak.value,
        "peak_slip_ci": peak and [peak.lower, peak.upper],
        "peak_slip_below": rail.peak_slip_limit if rail else None,
        "peak_mu": mu and mu.value,
        "peak_mu_ci": mu and [mu.lower, mu.upper],
        "peak_speed_mps": rail.speed if rail and rail.peak_slip_limit else None,
        "slip_rmse": summary.slip_rmse,
        "train_speed_late_s": summary.delay and summary.delay.value,
        "train_speed_late_sigma_s": summary.delay and summary.delay.tolerance,
        "regions": summary.regions,
        "utilisation": utilisation and utilisation.value,
        "utilisation_ci": utilisation and [utilisation.lower, utilisation.upper],
        "slides": [
            {
                "start_s": (x.start - start_ns) / 1e9,
                "duration_s": x.duration,
                "distance_m": x.distance,
                "max_slip": x.max_slip,
                "energy_j": x.energy,
                "at_least": x.is_lower_bound,
            }
            for x in summary.slides
        ],
        "fit": fit,
        "fit_curve": "polach" if rail else None,
    }


def antiskid_document(
    stop: "Stop",
    scenario: str,
    parameters: Mapping[str, Mapping[str, float]],
    dry: float | None,
    controllers: Mapping[str, Mapping[str, float | None]],
    **more: Any,
) -> dict[str, Any]:
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
) -> dict[str, Any]:
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


def limits_document(rows: "Sequence[tuple[str, Limit, bool | float]]") -> list[dict[str, Any]]:
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
) -> dict[str, Any]:
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
    loop: dict[str, Any] = {"controller": stop.controller, "estimator": stop.algo, **more}
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
    rows: "Sequence[Row]",
) -> dict[str, Any]:
    """The `adhesion.antiskid-sweep/1` document; every value is [mean, 2.5 %, 97.5 %] or None.

    `kept` of a limit is the share of the seeds.
    """
    rails: dict[str, dict[str, Any]] = {}
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


def channel_document(channel: Channel) -> dict[str, Any]:
    """What a channel was taken for, and why."""
    document = {
        k: getattr(channel, k) for k in ("name", "field", "meaning", "axle", "unit", "reason")
    }
    return document | (
        {"meaning": "truth"} if channel.meaning == "true_slip" else {}
    )  # by its unit


def findings_document(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Findings as the JSON names them."""
    return [
        {
            "code": f.code,
            "severity": f.severity,
            "channel": f.channel,
            "count": f.count,
            "first_s": f.first_s,
            "spans": f.spans,
            "values": dict(f.values),
            "names": dict(f.names),
            "message": f.message,
            "hint": f.hint,
        }
        for f in findings
    ]


def rows_used(result: Result) -> int:
    """Rows or messages of the log that hold a number and lie in some axle's segments."""
    by_origin: dict[tuple[str, str], int] = {}
    for channel in result.log.channels:
        if not channel.meaning:
            continue
        used = np.zeros(len(channel.data.t), dtype=np.bool_)
        for axle in result.axles:
            if channel.axle in (None, axle.record.axle):
                for s in axle.record.segments:
                    t = axle.record.t[s]
                    used |= (channel.data.t >= t[0]) & (channel.data.t <= t[-1])
        row = channel.row_of
        by_origin[row] = max(by_origin.get(row, 0), int(used.sum()))
    return sum(by_origin.values())


def finite(value: float) -> float | None:
    """The number, None where JSON has none for it."""
    return value if math.isfinite(value) else None


def iso(t_ns: int) -> str:
    """A time stamp as ISO 8601, UTC, to the microsecond."""
    return datetime.fromtimestamp(t_ns // 1000 / 1e6, UTC).isoformat().replace("+00:00", "Z")


def _median(values: Floats) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def dumps(document: dict[str, Any]) -> str:
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
