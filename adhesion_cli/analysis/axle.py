"""One axle: reference and estimates, findings, scores, slip."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core import compiled, innovations, physics
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.masks import spans_of
from ..core.model import Z95, AxleRecord, AxleResult, Reference
from ..diagnostics import noise_model
from ..rail import slip
from ..records import brake_applications
from ..reference import force
from ..scores import metrics
from .axle_findings import find_axle_findings
from .settings import Settings


def analyze_axle(
    record: AxleRecord, settings: Settings, estimators: Sequence[Estimator], start_ns: int
) -> tuple[AxleResult, list[Finding]]:
    """The result of one axle, and what must be reported about it.

    Spans of the findings count from `start_ns`, the log's start [ns].
    """
    vehicle = settings.vehicle.of_axle(record.axle)
    w, faded = physics.wheelset(vehicle, record.axle), physics.with_fade(record, vehicle)
    reference = force.compute(faded, vehicle, settings.analysis.reference)
    starts = np.array([s.start for s in record.segments], dtype=np.int64)
    K, y = faded.clamping_force, record.wheel_speed
    columns = w, record.t, K, y, starts
    estimates = {e.name: compiled.batch(e, settings.params(e), *columns) for e in estimators}
    forces = {name: e.force for name, e in estimates.items()}
    sigmas = {name: e.sigma for name, e in estimates.items() if e.sigma is not None}
    nis = {name: innovations.mean(e.nis) for name, e in estimates.items() if e.nis is not None}
    applications = brake_applications.find_applications(record)
    locks = settings.stops.locks
    findings = [
        *find_axle_findings(record, vehicle, reference, applications, start_ns, limits=locks)
    ]
    by_method, thresholds = {"the reference": reference.nis, **nis}, settings.checks["noise_model"]
    findings += noise_model.check(thresholds, f"axle {record.axle}", by_method)
    drowned = [s for s in applications if _is_drowned(reference, s)]
    if drowned:
        reference, finding = _remove_drowned(record, reference, drowned, start_ns)
        findings.append(finding)
    scored_applications = tuple(s for s in applications if s not in drowned)
    scores = metrics.score_estimates(record, reference, forces, scored_applications, sigmas)
    scores = tuple(replace(s, nis=nis.get(s.algo)) for s in scores)
    result = AxleResult(record, reference, forces, scores, applications, sigmas=sigmas)
    if record.train_speed is None:
        return result, findings
    result, slip_findings = slip.observe_slip(
        result, vehicle, settings.analysis.slowest, settings.slope, settings.bands
    )
    return result, findings + slip_findings


def without_force(axle: AxleResult) -> AxleResult:
    """An axle of an unknown vehicle: speeds, brake applications and slip, no force."""
    ref, unknown = axle.reference, np.full(len(axle.record), np.nan)
    reference = replace(ref, force=unknown, sigma=unknown, tolerance=unknown, mass=unknown)
    return replace(
        axle,
        reference=reference,
        estimates=dict.fromkeys(axle.estimates, unknown),
        scores=(),
        sigmas=dict.fromkeys(axle.sigmas, unknown),
        slope=None if axle.slope is None else unknown,
        slope_confidence=None if axle.slope is None else np.zeros(len(unknown)),
        region=None if axle.region is None else np.zeros_like(axle.region),
    )


def _is_drowned(reference: Reference, application: slice) -> bool:
    """Whether the force of a brake application is mostly smaller than its 95 % noise."""
    finite = np.isfinite(reference.force[application])
    force = np.abs(reference.force[application][finite])
    noise = Z95 * reference.sigma[application][finite]
    return bool(finite.any() and np.median(noise) > np.median(force))


def _remove_drowned(
    record: AxleRecord, reference: Reference, drowned: Sequence[slice], start_ns: int
) -> tuple[Reference, Finding]:
    """The reference without these applications, whose noise exceeds the force."""
    rows = np.r_[tuple(drowned)]
    columns = np.array([reference.force, reference.sigma, reference.tolerance])
    columns[:, rows] = np.nan
    force, sigma, tolerance = columns
    begin_rows, end_rows = [s.start for s in drowned], [s.stop - 1 for s in drowned]
    spans = spans_of(record.t[begin_rows], record.t[end_rows], start_ns)
    finding = Finding("reference-noise", "warning", f"axle {record.axle}", len(drowned), spans)
    return replace(reference, force=force, sigma=sigma, tolerance=tolerance), finding
