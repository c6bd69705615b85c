"""A vehicle from its own logs: the joint posterior over all brake applications whose wheels roll.

The mathematics is that of `reference.calibrated_vehicle`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ..analysis.identify import as_equal_axles, find_prior, of_all_axles, with_any_wheel
from ..analysis.prepare import AlignedLog, align_log, diagnose_log
from ..analysis.request import load_vehicle, read_log
from ..analysis.settings import Settings, tree
from ..core import toml
from ..core.annotated import Json, Progress
from ..core.document import findings_document, tagged
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import AxleRecord, Log, Parameter, Vehicle, quantities
from ..core.text import by_uncertainty
from ..formats.memory import Signals
from ..records import brake_applications
from ..reference import calibrated_vehicle as reference
from ..results.carried_vehicle import parameter_title
from ..train import longitudinal as model
from ..train import pieces, solve
from ..train.explanation import Design
from ..train.mean_axle import move_axles

_FALSE_REFUSAL = 0.01  # probability that logs of one vehicle are refused
_PLAUSIBLE_SIGMAS = 4.0  # from its prior a parameter is another one
_MORE_BRAKE = (
    "another brake acts (ED, magnetic, retarder), or pads or cylinders are counted too few"
)
_LESS_BRAKE = "pads, discs or cylinders are counted twice, or the pressure is not the cylinder's"
# What is probably wrong, by the parameter that is implausible and the direction.
_CAUSES = {
    ("force_over_mass", "high"): _MORE_BRAKE,
    ("force_over_mass", "low"): _LESS_BRAKE,
    ("friction", "high"): _MORE_BRAKE,
    ("friction", "low"): _LESS_BRAKE,
    ("friction_scale", "high"): _MORE_BRAKE,
    ("friction_scale", "low"): _LESS_BRAKE,
    ("axle_mass", "any"): "the load is another one, or pads or cylinders are miscounted",
    ("wheelset_inertia", "any"): "the rotating mass or the load is another one",
    ("spring_force", "low"): "another brake acts at low pressure, or the pressure has a zero error",
    ("spring_force", "high"): "the pressure has a zero error, or cylinder or spring are others",
    ("friction_fade", "any"): "an ED brake acts at some speeds, or the friction needs a table",
    ("pressure_delay", "any"): "the clocks of pressure and speed differ",
    ("creep_stiffness", "any"): "wheels slid, or a wheel diameter is wrong",
    ("running_resistance", "any"): "the track has a gradient, or a motor drives",
    ("air_drag", "any"): "the track has a gradient, or a motor drives",
}


class UsedLog(NamedTuple):
    """What one log contributes."""

    log: Log  # without channels
    record: AxleRecord  # of its first axle
    evidence: reference.Evidence
    findings: tuple[Finding, ...]


class CalibrationRun(NamedTuple):
    """The result."""

    settings: Settings  # as stated, with the calibrated vehicle
    logs: tuple[UsedLog, ...]
    result: reference.Calibrated
    applications: int  # brake applications in which all wheels roll
    findings: tuple[Finding, ...]


def calibrate(
    paths: Sequence[Path | Signals], settings: Settings, progress: Progress = lambda _: None
) -> CalibrationRun:
    """Calibrates one vehicle.

    Raises:
        UserError: where a log cannot be read, or is a result; where the logs do not determine the
            vehicle; where they contradict each other.
    """
    all_settings: list[Settings] = []
    read_logs: list[tuple[Log, AlignedLog]] = []
    titles = ", ".join(p.name for p in paths)
    for path in paths:
        progress(f"reading {path.name}")
        settings_of_log, log = read_log(path, settings)
        if settings_of_log.analysis.vehicle != settings.analysis.vehicle:
            text = f"{path.name}: a result, whose vehicle has the evidence of its log already"
            raise UserError(text, "name the logs themselves: each counts once")
        loaded, load_findings = load_vehicle(settings_of_log, log)
        log = replace(log, findings=(*load_findings, *log.findings))
        checks, track = settings_of_log.checks, settings_of_log.track
        aligned = align_log(log, loaded.vehicle, checks=checks, track=track)
        all_settings.append(settings_of_log)
        read_logs.append((replace(log, channels=()), aligned))
    _one_vehicle(all_settings)
    aligned_logs = [aligned for _, aligned in read_logs]
    settings = with_any_wheel(aligned_logs, all_settings[0])
    equal_logs, mean = as_equal_axles(aligned_logs, settings)
    prior_vehicle, _ = find_prior(equal_logs, replace(settings, vehicle=mean))
    vehicle = prior_vehicle.vehicle  # of the mean axle
    of_all = of_all_axles(prior_vehicle, mean, settings.vehicle, aligned_logs[0].numbers[0])
    acting = [f for log in aligned_logs for f in log.other_brakes]
    if prior_vehicle.other_brake:
        names = {"reason": "Train decelerates more than the pressure explains"}
        acting.append(Finding("other-brake", "warning", names=names))
    if acting:
        raise UserError(f"{titles}: {acting[-1].message}", acting[-1].hint or "")
    vehicles = [move_axles(aligned.vehicle, mean, vehicle) for aligned in aligned_logs]
    pairs = zip(read_logs, vehicles, strict=True)
    logs = [_used_log(log, aligned, v, settings) for (log, aligned), v in pairs]
    rolling = _rolling_logs(logs)
    progress("fitting all brake applications")
    evidence = [u.evidence for u in rolling]
    designs = pieces.join_designs([e.design for e in evidence if e.design], vehicle)
    train = reference.train_by(evidence, settings.train)
    prior = reference.prior(designs, vehicle, evidence, train)
    posterior = solve.joint(designs, prior)
    _check_agreement(rolling, designs, prior, posterior)
    brake_point = reference.mean_brake(designs)
    calibrated = reference.calibrate_vehicle(
        vehicle, rolling[0].record, brake_point, prior, posterior, len(designs)
    )
    if prior_vehicle.source != "log":  # of a brake that nobody stated, any is plausible
        _check_plausible(calibrated.rows, posterior, titles)
    applications = sum(u.evidence.applications() for u in rolling)
    unused = [Path(u.log.path).name for u in logs if not u.evidence.applications()]
    findings = [f for u in logs for f in u.findings]
    findings += [Finding("calibration-log-unused", "info", names={"log": x}) for x in unused]
    analysis = replace(settings.analysis, vehicle="stated")  # the same logs are no new evidence
    every_axle = move_axles(of_all.vehicle, vehicle, calibrated.vehicle)
    settings = replace(settings, vehicle=every_axle, analysis=analysis)
    return CalibrationRun(settings, tuple(logs), calibrated, applications, tuple(findings))


# Logs


def _used_log(log: Log, aligned: AlignedLog, vehicle: Vehicle, settings: Settings) -> UsedLog:
    """What a log says with a vehicle near its own."""
    prepared = diagnose_log(aligned, vehicle, settings.checks, settings.train)
    record, findings = prepared.records[0], (*log.findings, *prepared.findings)
    applications = brake_applications.find_applications(record)
    evidence = reference.Evidence(None, (), 0.0)
    if scene := prepared.scene:
        start_ns = scene.grid.start_ns
        evidence = reference.evidence(scene.explanation, start_ns, record, applications)
    return UsedLog(log, record, evidence, tuple(dict.fromkeys(findings)))


def _one_vehicle(all_settings: Sequence[Settings]) -> None:
    """Refuses results of several vehicles, and tolerances that leave nothing to find."""
    vehicle = all_settings[0].vehicle
    if any(s.vehicle != vehicle for s in all_settings):
        hint = "state the one they share with -c FILE.toml"
        raise UserError("the logs state different vehicles", hint)
    for name, share in (("friction", 0.1), ("axle_mass", 0.05)):
        p: Parameter = getattr(vehicle, name)
        if p.tolerance <= 0.0:
            line = f"vehicle.{name} = {{value = {p.value:g}, tolerance = {share * p.value:.3g}}}"
            text = f"vehicle.{name} has the tolerance 0: no log can change it"
            hint = f"state 1 sigma of what is known of it, as {toml.option(line)}"
            raise UserError(text, hint, code=2)


def _rolling_logs(logs: Sequence[UsedLog]) -> list[UsedLog]:
    """The logs in whose brakes wheels roll; refuses none, and K beside pressures."""
    rolling = [u for u in logs if u.evidence.applications()]
    if not rolling:
        text = f"{logs[0].log.path}: no log has a brake application in which all wheels roll"
        hint = "record service brakes on a dry rail, with 6 s before and after each"
        raise UserError(text, hint)
    if len({u.record.pressure is None for u in rolling}) > 1:
        hint = "calibrate them apart: a clamping force does not contain the brake's efficiency"
        raise UserError("some logs have a clamping force, others a pressure", hint)
    return rolling


def _check_agreement(
    logs: Sequence[UsedLog], designs: Sequence[Design], prior: model.Prior, joint: solve.Posterior
) -> None:
    """Refuses logs of which one's force, at its own brakes, differs from that of all others.

    Both posteriors contain the prior P. With the information I of a log, Λ = P + I and C = 1/Λ, the
    difference of two means has the covariance C + C' − C P C' − C' P C. Each log's fit begins at
    the joint one and weights its samples by that, so that slides stay outliers.
    """
    if len(designs) < 2:
        return
    n = len(model.UNITS)
    means, informations = [], []
    P = np.diag([prior[i].tolerance ** -2.0 for i in range(n)])
    origin = np.array([prior[i].value for i in range(n)])
    slopes = solve.gradients(designs, joint.mean)
    for d, log_gradients in zip(designs, slopes, strict=True):
        residuals = solve.residual(d, joint.mean, log_gradients)
        counts, start = solve.independent_samples(d, residuals), joint.mean[:n]
        posterior = solve.search([d], [counts], prior, [start]).posterior()
        means.append(posterior.mean[:n] - origin)
        informations.append(np.linalg.inv(posterior.covariance[:n, :n]))
    total = P + sum(x - P for x in informations)
    pull = sum(x @ m for x, m in zip(informations, means, strict=True))
    log_to_log = (1.0 + 1.0 / (len(designs) - 1)) * reference.LOG_TO_LOG[model.SCALE] ** 2
    worst = (0.0, 0, 0.0, 0.0)
    for i, (d, mean, information) in enumerate(zip(designs, means, informations, strict=True)):
        C, D = np.linalg.inv(information), np.linalg.inv(total - information + P)
        g = reference.mean_brake([d]).gradient
        difference = float(g @ (mean - D @ (pull - information @ mean)))
        variance = float(g @ (C + D - C @ P @ D - D @ P @ C) @ g) + log_to_log
        sigmas = abs(difference) / math.sqrt(max(variance, 1e-12))
        worst = max(worst, (sigmas, i, difference, variance))
    sigmas, i, difference, variance = worst
    if sigmas > NormalDist().inv_cdf(1.0 - _FALSE_REFUSAL / (2.0 * len(designs))):
        values = {"share": math.expm1(difference), "sigma_share": math.sqrt(variance)}
        values["sigmas"] = sigmas
        path = logs[i].log.path
        finding = Finding("logs-contradict", "error", values=values, names={"log": Path(path).name})
        raise UserError(f"{path}: {finding.message}", finding.hint or "")


def _check_plausible(
    rows: Mapping[str, reference.CalibratedParameter], posterior: solve.Posterior, titles: str
) -> None:
    """Refuses a parameter that the vehicle as stated cannot have, or that is at a bound."""
    change = (posterior.mean[: model.SHARED] - posterior.prior) / posterior.prior_sigma
    sigmas = {n: (x.posterior - x.prior) / max(x.prior_u, 1e-12) for n, x in rows.items()}
    of_logarithm = {"force_over_mass": model.SCALE, "creep_stiffness": model.STIFFNESS}
    sigmas |= {name: float(change[i]) for name, i in of_logarithm.items() if name in rows}
    # A wheel that creeps less than usual is no fault; one that creeps more slid.
    sigmas["creep_stiffness"] = min(sigmas.get("creep_stiffness", 0.0), 0.0)
    bounds = quantities(Vehicle)
    limits = {name: (bounds[name].minimum, bounds[name].maximum) for name in rows if name in bounds}
    inside = [n for n, (lowest, highest) in limits.items() if lowest < rows[n].prior < highest]
    at_bound = [n for n in inside if not limits[n][0] < rows[n].posterior < limits[n][1]]
    farthest = max(sigmas, key=lambda name: (name in at_bound, abs(sigmas[name])))
    if farthest not in at_bound and abs(sigmas[farthest]) <= _PLAUSIBLE_SIGMAS:
        return
    row, towards = rows[farthest], "low" if sigmas[farthest] < 0.0 else "high"
    names = {
        "parameter": farthest.replace("_", " "),
        "cause": _CAUSES.get((farthest, towards)) or _CAUSES[farthest, "any"],
        "unit": f" {row.unit}".removesuffix(" -"),
    }
    values = {"posterior": row.posterior, "prior": row.prior, "sigmas": sigmas[farthest]}
    finding = Finding("calibration-implausible", "error", values=values, names=names)
    raise UserError(f"{titles}: {finding.message}", finding.hint or "")


# Report


def as_toml(calibration: CalibrationRun) -> str:
    """The vehicle, and how its logs were read, as `-c` takes it; comments say what it is from."""
    lines = ["# Vehicle by `adhesion calibrate`; tolerances are 1 sigma."]
    lines += ["# `discs` counts clamping forces of an axle: discs times pads."]
    lines += ["# Only products of friction, discs, efficiency and ratios are known: friction has"]
    lines += ["# the tolerance of all. Do not change one of them, or friction, alone.", "# Logs:"]
    lines += [f"# - {Path(u.log.path).name!r}, sha256 {u.log.sha256}" for u in calibration.logs]
    lines += ["# Found as well, and not part of the vehicle:"]
    longitudinal_names = ("pressure_delay", "creep_stiffness", "running_resistance", "air_drag")
    for name, r in ((name, calibration.result.rows[name]) for name in longitudinal_names):
        text = " ± ".join(by_uncertainty(r.posterior, r.posterior_u))
        lines.append(f"# - {name} = {text} {r.unit}")
    tables = as_tables(calibration)
    tables |= {f"car.{toml.key(car)}": keys for car, keys in tables.pop("car", {}).items()}
    for section, keys in tables.items():
        lines += ["", f"[{section}]"]
        lines += [f"{toml.key(k)} = {toml.value(v)}" for k, v in keys.items()]
    return "\n".join([*lines, ""])


def as_tables(calibration: CalibrationRun) -> dict[str, Json]:
    """The vehicle, and how its logs were read, as tables of settings."""
    calibrated_tree, default_tree = tree(calibration.settings, []), tree(Settings(), [])
    section_names = ("vehicle", "car", "analysis", "channels", "csv", "mcap", "can")
    stated_tables = {name: keys for name in section_names if (keys := calibrated_tree.get(name))}
    return {name: keys for name, keys in stated_tables.items() if keys != default_tree.get(name)}


def document(calibration: CalibrationRun, outputs: dict[str, str]) -> Json:
    """The document of `calibrate`; `outputs` are the files written, by format."""
    result = calibration.result
    return tagged(
        "calibrate",
        logs=len(calibration.logs),
        applications=calibration.applications,
        outputs=outputs,
        parameters={name: row._asdict() for name, row in result.rows.items()},
        correlation={"names": [*result.rows], "matrix": result.correlation.tolist()},
        force_before_n=result.force[0],
        force_after_n=result.force[1],
        band_before_n=result.band[0],
        band_after_n=result.band[1],
        used=[{"path": u.log.path, "sha256": u.log.sha256} for u in calibration.logs],
        findings=findings_document(calibration.findings),
    )


def as_rows(calibration: CalibrationRun) -> list[dict[str, str]]:
    """Each parameter before and after with 1 sigma, as text."""
    return [
        {
            "parameter": parameter_title(name),
            "stated by": r.source,
            "unit": r.unit,
            "stated": " ± ".join(by_uncertainty(r.prior, r.prior_u)),
            "calibrated": " ± ".join(by_uncertainty(r.posterior, r.posterior_u)),
        }
        for name, r in calibration.result.rows.items()
    ]
