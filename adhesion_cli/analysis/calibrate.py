"""A vehicle from its own logs: the joint posterior over all brake applications whose wheels roll.

The mathematics is that of `reference.calibrated_vehicle`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from ..channels.log import read
from ..core import toml
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Z95, AxleRecord, Floats, Log, Parameter, Vehicle
from ..core.text import by_uncertainty
from ..evaluation import metrics
from ..formats.memory import Signals
from ..reference import calibrated_vehicle as reference
from ..results.charts import Line, Panel
from ..results.palette import BLACK, BLUE, GREY, ORANGE
from ..train import longitudinal as model
from ..train.explanation import Design
from .prepare import prepare
from .request import open_log
from .settings import Settings, tree

_FALSE = 0.01  # probability that logs of one vehicle are refused
_DOT = 4.0  # diameter of a point in the picture
_ASIDE = 0.22  # what one application shows in several points is drawn so far aside
_NAMES, _LETTERS = 16, 18  # of logs that have room under the picture, and of each


class Applied(NamedTuple):
    """One brake application: deceleration measured, and by the brake as stated and calibrated.

    `_u` is 1 sigma: by the tolerances, by the posterior and what changes from log to log, and of
    the gradient that was fitted.
    """

    log: str  # its path
    begin_s: float  # after the log's start
    speed_mps: float
    measured_mps2: float
    stated_mps2: float
    stated_u_mps2: float
    calibrated_mps2: float
    calibrated_u_mps2: float
    gradient_mps2: float  # above 0 where it drives the train
    gradient_u_mps2: float


class Used(NamedTuple):
    """What one log contributes."""

    log: Log  # without channels
    record: AxleRecord  # of its first axle
    evidence: reference.Evidence
    findings: tuple[Finding, ...]


class Calibration(NamedTuple):
    """The result."""

    settings: Settings  # as stated, with the calibrated vehicle
    logs: tuple[Used, ...]
    result: reference.Calibrated
    applications: tuple[Applied, ...]
    findings: tuple[Finding, ...]


def calibrate(
    paths: Sequence[Path | Signals],
    load: Callable[..., Settings],
    tell: Callable[[str], None] = lambda _: None,
) -> Calibration:
    """Calibrates one vehicle.

    Args:
        paths: its logs.
        load: gives the settings, see `analyze`.
        tell: receives a line at each step.

    Raises:
        UserError: where a log cannot be read; where the logs do not determine the vehicle; where
            they contradict each other.
    """
    stated: list[Settings] = []
    logs: list[Used] = []
    for path in paths:
        tell(f"reading {path.name}")
        settings, used = _used(path, load)
        stated.append(settings)
        logs.append(used)
    vehicle = _one_vehicle(stated)
    rolling = _determined(logs)
    tell("fitting all brake applications")
    designs = model.join_designs([u.evidence.design for u in rolling if u.evidence.design], vehicle)
    prior = reference.prior(designs, vehicle, max(abs(u.evidence.delay) for u in rolling))
    found = model.joint(designs, prior)
    _agree(rolling, designs, prior, found)
    calibrated = reference.calibrate_vehicle(vehicle, rolling[0].record, designs, prior, found)
    applications = _applications(rolling, designs, found)
    findings = (*(f for u in logs for f in u.findings), *_unused(logs))
    settings = replace(stated[0], vehicle=calibrated.vehicle)
    return Calibration(settings, tuple(logs), calibrated, applications, findings)


# Logs


def _used(path: Path | Signals, load: Callable[..., Settings]) -> tuple[Settings, Used]:
    settings, source = open_log(path, load)
    vehicle, gap = settings.vehicle, round(settings.analysis.max_gap * 1e9)
    log = read(source, settings.mappings, vehicle, max_gap_ns=gap)
    made = prepare(log, vehicle, checks=settings.checks)
    record, findings = made.records[0], (*log.findings, *made.findings)
    applications = metrics.find_applications(record)
    found = reference.evidence(made.scene, record, applications, vehicle)
    short = replace(log, channels=())
    return settings, Used(short, record, found, tuple(dict.fromkeys(findings)))


def _one_vehicle(stated: Sequence[Settings]) -> Vehicle:
    """The vehicle that all logs state.

    Raises:
        UserError: where results state several, and where a tolerance leaves nothing to find.
    """
    vehicle = stated[0].vehicle
    if any(s.vehicle != vehicle for s in stated):
        raise UserError(
            "the logs state different vehicles", "state the one they share with -c FILE.toml"
        )
    for name, share in (("friction", 0.1), ("axle_mass", 0.05)):
        p: Parameter = getattr(vehicle, name)
        if p.tolerance <= 0.0:
            line = f"vehicle.{name} = {{value = {p.value:g}, tolerance = {share * p.value:.3g}}}"
            text = f"vehicle.{name} has the tolerance 0: no log can change it"
            hint = f"state 1 sigma of what is known of it, as {toml.option(line)}"
            raise UserError(text, hint, code=2)
    return vehicle


def _determined(logs: Sequence[Used]) -> list[Used]:
    """The logs with brake applications of wheels that roll.

    Raises:
        UserError: where these are fewer than two; where some logs have K and others pressures.
    """
    rolling = [u for u in logs if u.evidence.applications()]
    if not rolling:
        raise UserError(
            f"{logs[0].log.path}: no log has a brake application in which all wheels roll",
            "record service brakes on a dry rail, with 6 s before and after each",
        )
    if sum(len(u.evidence.applications()) for u in rolling) < 2:
        raise UserError(
            f"{rolling[0].log.path}: there is one brake application only",
            "name more logs of this vehicle: in one application a gradient looks like a force",
        )
    if len({u.record.pressure is None for u in rolling}) > 1:
        raise UserError(
            "some logs have a clamping force, others a pressure",
            "calibrate them apart: a clamping force does not contain the brake's efficiency",
        )
    return rolling


def _unused(logs: Sequence[Used]) -> list[Finding]:
    names = [Path(u.log.path).name for u in logs if not u.evidence.applications()]
    return [Finding("calibration-log-unused", "info", names={"log": name}) for name in names]


def _agree(
    logs: Sequence[Used],
    designs: Sequence[Design],
    prior: dict[int, Parameter],
    joint: model.Posterior,
) -> None:
    """Whether each log's force, at its own brakes, agrees with that of all others.

    Both posteriors contain the prior P. With the information I of a log, Λ = P + I and C = 1/Λ, the
    difference of two means has the covariance C + C' − C P C' − C' P C. Each log's fit begins at
    the joint one and weights its samples by that, so that slides stay outliers.

    Raises:
        UserError: names the log that differs most, if that is no chance.
    """
    if len(designs) < 2:
        return
    n = len(model.UNITS)
    means, informations = [], []
    P = np.diag([prior[i].tolerance ** -2.0 for i in range(n)])
    origin = np.array([prior[i].value for i in range(n)])
    slopes = model.gradients(designs, joint.mean)
    for d, of in zip(designs, slopes, strict=True):
        found = model.fit(
            [d],
            [model.independent_samples(d, model.residual(d, joint.mean, of))],
            prior,
            [joint.mean[:n]],
        )
        means.append(found.mean[:n] - origin)
        informations.append(np.linalg.inv(found.covariance[:n, :n]))
    total = P + sum(x - P for x in informations)
    pull = sum(x @ m for x, m in zip(informations, means, strict=True))
    again = (1.0 + 1.0 / (len(designs) - 1)) * reference.LOG_TO_LOG[model.SCALE] ** 2
    worst = (0.0, 0, 0.0, 0.0)
    for i, (d, mean, own) in enumerate(zip(designs, means, informations, strict=True)):
        C, D, g = np.linalg.inv(own), np.linalg.inv(total - own + P), reference.force_gradient([d])
        away = float(g @ (mean - D @ (pull - own @ mean)))
        variance = float(g @ (C + D - C @ P @ D - D @ P @ C) @ g) + again
        worst = max(worst, (abs(away) / math.sqrt(max(variance, 1e-12)), i, away, variance))
    sigmas, i, away, variance = worst
    if sigmas > NormalDist().inv_cdf(1.0 - _FALSE / (2.0 * len(designs))):
        values = {"share": math.expm1(away), "sigma_share": math.sqrt(variance), "sigmas": sigmas}
        path = logs[i].log.path
        why = Finding("logs-contradict", "error", values=values, names={"log": Path(path).name})
        raise UserError(f"{path}: {why.message}", why.hint or "")


# Report


def _applications(
    logs: Sequence[Used], designs: Sequence[Design], found: model.Posterior
) -> tuple[Applied, ...]:
    """All brake applications, in the order of the logs."""
    rows: list[Applied] = []
    place = n = len(model.UNITS)
    again = np.zeros(n)
    again[[*reference.LOG_TO_LOG]] = [sigma**2 for sigma in reference.LOG_TO_LOG.values()]
    stated = np.diag(found.prior_sigma**2)
    after = found.covariance[:n, :n] + np.diag(again)
    for used, d in zip(logs, designs, strict=True):
        own = slice(place, place + len(d.size))
        of = _Fitted(found.mean[own], found.covariance[own, own], stated, after)
        rows += _applied(used, d, found, of)
        place = own.stop
    return tuple(rows)


class _Fitted(NamedTuple):
    """What a posterior says of one log."""

    gradients: Floats  # (p,) [m/s²]
    their: Floats  # covariance of these
    stated: Floats  # covariance of the shared parameters before, of the brake only
    after: Floats  # the same of the posterior


def _applied(u: Used, d: Design, found: model.Posterior, of: _Fitted) -> list[Applied]:
    """The decelerations of each brake application, by straight lines through its samples."""
    x = found.mean[: len(model.UNITS)]
    of_brake = [model.SCALE, model.OFFSET, model.FADE]
    as_stated = x.copy()
    as_stated[of_brake] = found.prior[of_brake]
    t, piece = d.t[d.samples], np.repeat(np.arange(len(d.size)), d.size.astype(int))
    before, after = (_predicted(d, y) for y in (as_stated, x))
    rows = []
    for (begin, _), at in u.evidence.applications():

        def slopes(y: Floats, at: Any = at) -> Floats:
            return np.asarray(np.polyfit(t[at] - t[at].mean(), y[..., at].T, 1)[0])

        (old, *by), (new, *moves) = (slopes(y) for y in (before, after))
        share = np.bincount(piece[at], minlength=len(d.size)) / len(at)
        by_brake, own = np.array(by)[of_brake], of.stated[np.ix_(of_brake, of_brake)]
        rows.append(Applied(
            u.log.path, begin, float(d.measured[at].mean()),
            -float(slopes(d.measured[None])[0]), float(old), _sigma(by_brake, own),
            float(new), _sigma(np.array(moves), of.after),
            float(share @ of.gradients), _sigma(share, of.their),
        ))  # fmt: skip
    return rows


def _sigma(moves: Floats, covariance: Floats) -> float:
    return math.sqrt(max(float(moves @ covariance @ moves), 0.0))


def _predicted(d: Design, x: Floats) -> Floats:
    """What brake and resistances take from the speed, then its derivatives; (8, m) [m/s]."""
    t, u = d.t[d.samples], d.relative_speed + d.mean
    way = np.cumsum(u * u)[d.samples] * (d.t[1] - d.t[0])

    def taken(y: Floats) -> Floats:
        of_brake = math.exp(y[model.SCALE]) * model.speed_loss(d, y)
        found: Floats = of_brake + y[model.RESISTANCE] * t + y[model.DRAG] * way
        return found

    rows = [taken(x)]
    for i, step in enumerate((0.01, 0.002, 0.005, 0.01, 1e-4, 1e-3, 1e-6)):
        high, low = x.copy(), x.copy()
        high[i] += step
        low[i] -= step
        rows.append((taken(high) - taken(low)) / (2.0 * step))
    return np.array(rows)


def as_toml(found: Calibration) -> str:
    """The vehicle, and how its logs were read, as `-c` takes it; comments say what it is from."""
    lines = ["# Vehicle by `adhesion calibrate`; tolerances are 1 sigma."]
    lines += ["# Only products of friction, discs, efficiency and ratios are known: friction has"]
    lines += ["# the tolerance of all. Do not change one of them, or friction, alone.", "# Logs:"]
    lines += [f"# - {Path(u.log.path).name!r}, sha256 {u.log.sha256}" for u in found.logs]
    lines += ["# Found as well, and not part of the vehicle:"]
    others = ("pressure_delay", "creep_stiffness", "running_resistance", "air_drag")
    for name, r in ((name, found.result.rows[name]) for name in others):
        shown = " ± ".join(by_uncertainty(r.posterior, r.posterior_u))
        lines.append(f"# - {name} = {shown} {r.unit}")
    for section, keys in as_tables(found).items():
        lines += ["", f"[{section}]"]
        lines += [f"{toml.key(k)} = {toml.value(v)}" for k, v in keys.items()]
    return "\n".join([*lines, ""])


def as_tables(found: Calibration) -> dict[str, dict[str, Any]]:
    """The vehicle, and how its logs were read, as tables of settings."""
    stated, usual = tree(found.settings, []), tree(Settings(), [])
    every = ("vehicle", "channels", "csv", "mcap", "can")
    return {name: of for name in every if (of := stated[name]) != usual[name]}


def as_rows(found: Calibration) -> list[dict[str, str]]:
    """Each parameter before and after with 1 sigma, as text."""
    return [
        {
            "parameter": name.replace("_", " "), "stated by": r.source, "unit": r.unit,
            "stated": " ± ".join(by_uncertainty(r.prior, r.prior_u)),
            "calibrated": " ± ".join(by_uncertainty(r.posterior, r.posterior_u)),
        }
        for name, r in found.result.rows.items()
    ]  # fmt: skip


def panels(braked: Sequence[Applied]) -> list[Panel]:
    """Deceleration as predicted over the measured one, and their difference, by application.

    Bars are expanded uncertainties (95 %). The first application of each log names the log.
    """
    measured = np.array([a.measured_mps2 for a in braked])
    place, ends = np.arange(float(len(braked))), np.array([0.0, 1.1 * float(np.max(measured))])
    over, off = [Line("equal", ends, ends, BLACK, dashed=True)], []
    for aside, (name, colour) in zip(
        (-_ASIDE, 0.0), (("stated", GREY), ("calibrated", BLUE)), strict=True
    ):
        predicted, u = (
            np.array([getattr(a, f"{name}{kind}_mps2") for a in braked]) for kind in ("", "_u")
        )
        over.append(Line(name, measured, predicted, colour, dots=_DOT, bars=Z95 * u))
        off.append(Line(name, place + aside, predicted - measured, colour, dots=_DOT, bars=Z95 * u))
    gradient, u = (
        np.array([getattr(a, f"gradient{kind}_mps2") for a in braked]) for kind in ("", "_u")
    )
    off.append(
        Line("fitted gradient", place + _ASIDE, gradient, ORANGE, dots=0.7 * _DOT, bars=Z95 * u)
    )
    return [
        Panel("Deceleration of each application, ± 95 %", "measured [m/s²]", "predicted [m/s²]",
              over),
        Panel("Predicted less measured, ± 95 %", "brake applications, log by log",
              "difference [m/s²]", off, x_names=_named(braked)),
    ]  # fmt: skip


def _named(braked: Sequence[Applied]) -> list[str]:
    """The log of each brake application, where it is the log's first one; at most `_NAMES`."""
    first = [i for i, a in enumerate(braked) if i == 0 or a.log != braked[i - 1].log]
    paths = {i: Path(braked[i].log) for i in first}
    stems = [path.stem for path in paths.values()]
    names = [""] * len(braked)
    for i in first[:: -(-len(first) // _NAMES)]:
        of = paths[i]
        name = of.stem if stems.count(of.stem) == 1 else f"{of.parent.name}/{of.stem}"
        names[i] = name if len(name) <= _LETTERS else f"…{name[1 - _LETTERS :]}"
    return names
