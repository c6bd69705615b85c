"""The main job: a log in, reference, estimates, scores and findings out."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from . import compiled, estimator, metrics, physics, reference
from . import settings as settings_module
from .errors import unknown
from .estimator import Estimator
from .model import AxleRecord, AxleResult, Finding, Result, Vehicle
from .read import align
from .read.log import open_source, read
from .settings import Settings

Window = tuple[float | None, float | None]


def chosen(algos: Sequence[str]) -> list[Estimator]:
    """The estimators of these names, every one if none is named.

    Raises:
        UserError: for a name the registry does not have.
    """
    known = estimator.registry()
    for name in algos:
        if name not in known:
            raise unknown("algorithm", name, list(known))
    return [known[name] for name in dict.fromkeys(algos)] or list(known.values())


def analyze(
    path: Path,
    load: Callable[..., Settings],
    algos: Sequence[str] = (),
    axles: Sequence[int] = (),
    window: Window = (None, None),
    tell: Callable[[str], None] = lambda _: None,
) -> Result:
    """Analyses one log.

    Args:
        path: raw log or result file; a result file's own settings are its defaults.
        load: gives the settings; takes `base`, settings weaker than every stated one.
        algos: estimators to run, all if empty.
        axles: axles to analyse, all if empty.
        window: seconds after the log's start, from and to.
        tell: is told what is being done.

    Raises:
        UserError: where the log cannot be read or holds nothing to analyse.
    """
    estimators = chosen(algos)
    tell(f"reading {path.name}")
    settings = load()
    source = open_source(path, settings.read)
    if carried := source.metadata.get("adhesion.settings"):
        settings = load(base=settings_module.nested(carried))
    if settings.analysis.reference not in reference.METHODS:
        raise unknown("reference", settings.analysis.reference, list(reference.METHODS))
    vehicle = settings.vehicle
    max_gap_ns = round(settings.analysis.max_gap * 1e9)
    log = read(source, settings.mappings, vehicle, max_gap_ns=max_gap_ns)
    records, findings = align.records(log, vehicle, axles, window)
    done = []
    for record in records:
        tell(f"{path.name}: axle {record.axle}")
        result, told = _axle(record, settings, estimators)
        done.append(result)
        findings += told
    sources = [r.reference.source for r in done[:1]] + [e.source for e in estimators]
    return Result(
        log,
        vehicle,
        tuple(done),
        (*log.findings, *findings),
        settings_module.tree(settings, estimators),
        tuple(dict.fromkeys(sources)),
    )


def _axle(
    record: AxleRecord, settings: Settings, estimators: Sequence[Estimator]
) -> tuple[AxleResult, list[Finding]]:
    vehicle = settings.vehicle
    w = physics.wheelset(vehicle, record.axle)
    ref = reference.compute(record, vehicle, settings.analysis.reference)
    starts = np.array([s.start for s in record.segments], dtype=np.int64)
    estimates = {
        e.name: compiled.batch(
            e, settings.params(e), w, record.t, record.clamping_force, record.wheel_speed, starts
        )
        for e in estimators
    }
    applications = metrics.applications(record)
    findings = _told(record, vehicle, ref.force, bool(applications))
    scores = metrics.scores(record, ref, estimates, applications)
    slip = None
    if record.train_speed is not None:
        radius = vehicle.radius(record.axle).value
        slip = physics.slip(
            record.train_speed, record.wheel_speed, radius, settings.analysis.slowest
        )
    return AxleResult(record, ref, estimates, scores, applications, slip), findings


def _told(
    record: AxleRecord, vehicle: Vehicle, force: np.ndarray[Any, Any], braked: bool
) -> list[Finding]:
    """What must be said about one axle's result."""
    findings = []
    name = f"axle {record.axle}"
    if missing := int((~np.isfinite(force)).sum()):
        text = "segments too short for the reference: no value there"
        findings.append(Finding("no-reference", "warning", text, name, missing))
    if not braked:
        text = "no brake application found: K never rises; estimators are not scored"
        findings.append(Finding("no-application", "warning", text, name))
    peak = float(np.nanmax(np.abs(force), initial=0.0)) / (vehicle.axle_mass.value * physics.G)
    if peak > 1.0:
        text = f"adhesion coefficient up to {peak:.1f}: units or vehicle parameters are wrong"
        findings.append(Finding("implausible", "warning", text, name))
    return findings


def document(results: Sequence[Result], outputs: Sequence[dict[str, str]]) -> dict[str, Any]:
    """The `adhesion.result/1` document; numbers that do not exist are null."""
    return {
        "schema": "adhesion.result/1",
        "results": [_one(r, o) for r, o in zip(results, outputs, strict=True)],
    }


def _one(result: Result, outputs: dict[str, str]) -> dict[str, Any]:
    log = result.log
    used = [c for c in log.channels if c.meaning]
    start = log.start_ns()
    end = max((int(c.data.t.max()) for c in used if len(c.data.t)), default=start)
    axles = []
    for axle in result.axles:
        ref = axle.reference
        axles.append(
            {
                "axle": axle.record.axle,
                "reference": {
                    "method": ref.method,
                    "sigma_n": _median(ref.sigma),
                    "band_n": _median((ref.upper - ref.lower) / 2.0),
                },
                "estimators": [asdict(s) for s in axle.scores],
            }
        )
    return {
        "log": {
            "path": log.path,
            "format": log.format,
            "sha256": log.sha256,
            "start": iso(start) if log.absolute else None,
            "duration_s": (end - start) / 1e9,
            "rows_read": log.rows_read,
            "rows_used": rows_used(result),
        },
        "outputs": outputs,
        "axles": axles,
        "findings": findings_document(result.findings),
    }


def findings_document(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Findings as the JSON names them."""
    return [asdict(f) for f in findings]


def rows_used(result: Result) -> int:
    """Rows or messages of the log whose time lies in some axle's segments and that hold a number."""
    by_origin: dict[tuple[str, str], int] = {}
    for channel in result.log.channels:
        if not channel.meaning:
            continue
        kept = np.zeros(len(channel.data.t), dtype=np.bool_)
        for axle in result.axles:
            if channel.axle in (None, axle.record.axle):
                for s in axle.record.segments:
                    t = axle.record.t[s]
                    kept |= (channel.data.t >= t[0]) & (channel.data.t <= t[-1])
        row = channel.row_of
        by_origin[row] = max(by_origin.get(row, 0), int(kept.sum()))
    return sum(by_origin.values())


def finite(value: float) -> float | None:
    """The number, None where JSON has none for it."""
    return value if math.isfinite(value) else None


def iso(t_ns: int) -> str:
    """A time stamp as ISO 8601, UTC, to the microsecond."""
    return datetime.fromtimestamp(t_ns // 1000 / 1e6, UTC).isoformat().replace("+00:00", "Z")


def _median(values: np.ndarray[Any, Any]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def dumps(document: dict[str, Any]) -> str:
    """A document as JSON; a NaN in it is a mistake of ours and raises."""
    return json.dumps(document, ensure_ascii=False, indent=1, allow_nan=False)
