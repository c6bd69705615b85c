"""A vehicle from its own logs: the joint posterior over all brake applications whose wheels roll.

A train that rolls decelerates by a = s c K. A log so determines s, the force over the mass, and
never both. With the errors of what is stated, ln s = C − w M + N:

| symbol | error of the logarithm of |
|---|---|
| C | friction φ times n η i, the radius ratio and d² |
| M | axle mass m, with w = m / (m + I/R²) |
| N | inertia I and radius R |

The posterior of s then gives those of C and M by linear regression, as all errors are normal. So
the force is never known better than the mass.

C is written as the error of φ alone, and the tolerances of n, η, i, the radius ratio and d are
0. The logs know only their product, and in the force nothing but the product counts. Written apart,
each would have nearly its old tolerance, and the band would need all their correlations. The offset
of the force line is written as the return spring's. A pressure sensor's zero is part of it.

Sources: JCGM 100, 5.2; JCGM 102, 6.2; the model is that of `dynamics.longitudinal`.
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
from ..core.physics import FREE, force_line, wheelset
from ..core.text import by_uncertainty
from ..diagnostics import diagnosis
from ..dynamics import longitudinal as model
from ..dynamics.train_grid import LEAST
from ..evaluation import metrics
from ..records import axle_records
from ..reference import force
from ..results.charts import Line, Panel
from ..results.palette import BLACK, BLUE, GREY, ORANGE
from .analyze import opened
from .settings import Settings, tree

_CHAIN = ("discs", "efficiency", "lever_ratio", "radius_ratio")
_FALSE = 0.01  # probability that logs of one vehicle are refused
_DOT = 4.5  # diameter of a point in the picture
# 1 sigma from log to log, assumed: of the friction by heat and wear, of the pressure's zero.
_AGAIN = {model.SCALE: 0.02, model.OFFSET: 0.005}
_SOURCES = {
    "force_over_mass": "stated tolerances",
    "friction": "stated tolerances of φ, n, η, i, d",
    "axle_mass": "stated tolerance",
    "spring_force": "stated tolerance; zero of a sensor: 1 % of the highest force",
    "friction_fade": "pads change by some 10 % over 25 m/s",
    "pressure_delay": "calipers, hoses, transducers: 0.03 s; sampling",
    "creep_stiffness": "20 to 100 % of Kalker's, per unit of slip",
    "running_resistance": "0.015 m/s² of a train that coasts",
}


class Applied(NamedTuple):
    """One brake application: deceleration measured, and by the brake as stated and calibrated."""

    log: str
    begin_s: float  # after the log's start
    speed_mps: float
    measured_mps2: float
    stated_mps2: float
    calibrated_mps2: float
    gradient_mps2: float  # above 0 where it drives the train


class Row(NamedTuple):
    """A parameter before and after, each with its standard uncertainty."""

    prior: float
    prior_u: float
    posterior: float
    posterior_u: float
    unit: str
    source: str  # of the prior


class Used(NamedTuple):
    """What one log contributes."""

    log: Log  # without channels
    record: AxleRecord  # of its first axle
    design: model.Design | None  # None where no brake application has wheels that roll
    spans: tuple[tuple[float, float], ...]  # brake applications in the design's time [s]
    findings: tuple[Finding, ...]
    late: float  # delay of the pressure that the checks found [s]


class Calibration(NamedTuple):
    """The result."""

    settings: Settings  # as stated, with the calibrated vehicle
    logs: tuple[Used, ...]
    rows: dict[str, Row]
    correlation: Floats  # of the posterior, in the order of the rows
    applications: tuple[Applied, ...]
    force: tuple[float, float]  # of an axle at the mean brake of all logs, as stated, after [N]
    band: tuple[float, float]  # half-width of its 95 % band, the same [N]
    findings: tuple[Finding, ...]


def calibrate(
    paths: Sequence[Path], load: Callable[..., Settings], tell: Callable[[str], None]
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
    designs = model.joined([u.design for u in rolling if u.design], vehicle)
    radius = any(d.creeps for d in designs)
    prior = _prior(designs, vehicle, radius, max(abs(u.late) for u in rolling))
    found = model.joint(designs, prior)
    _agree(rolling, designs, prior, found)
    for i, sigma in _AGAIN.items():  # the next log differs, and each of these did
        found.covariance[i, i] += sigma**2 * (1.0 + 1.0 / len(designs))
    calibrated, rows, correlation = _vehicle(vehicle, designs[0], prior, found, radius)
    of = _point(designs), rolling[0].record, designs[0]
    newtons, band = zip(*(_band(v, vehicle, *of) for v in (vehicle, calibrated)), strict=True)
    each = zip(rolling, designs, model.gradients(designs, found.mean), strict=True)
    applications = tuple(a for u, d, slopes in each for a in _applied(u, d, found, slopes))
    findings = (*(f for u in logs for f in u.findings), *_unused(logs))
    return Calibration(
        replace(stated[0], vehicle=calibrated), tuple(logs), rows, correlation, applications,
        newtons, band, findings,
    )  # fmt: skip


# Logs


def _used(path: Path, load: Callable[..., Settings]) -> tuple[Settings, Used]:
    settings, source = opened(path, load)
    vehicle, gap = settings.vehicle, round(settings.analysis.max_gap * 1e9)
    log = read(source, settings.mappings, vehicle, max_gap_ns=gap)
    made = axle_records.prepare(
        log, vehicle, (), (None, None), diagnosis.of_sensors(settings.checks)
    )
    record = made.records[0]
    findings = [*log.findings, *made.findings]
    design, late = None, 0.0
    spans: tuple[tuple[float, float], ...] = ()
    if made.scene:
        findings += diagnosis.findings(made.scene, settings.checks)
        design = model.of_log(made.scene.axles, made.scene.grid, vehicle)
        seconds = (record.t - made.scene.grid.first) * 1e-9
        spans = tuple((float(seconds[s.start]), float(seconds[s.stop - 1]))
                      for s in metrics.applications(record))  # fmt: skip
        late = made.scene.explanation.late.value
    short = replace(log, channels=())
    return settings, Used(short, record, design, spans, tuple(dict.fromkeys(findings)), late)


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
    rolling = [u for u in logs if u.design and _braked(u)]
    if not rolling:
        raise UserError(
            f"{logs[0].log.path}: no log has a brake application in which all wheels roll",
            "record service brakes on a dry rail, with 6 s before and after each",
        )
    if sum(len(_braked(u)) for u in rolling) < 2:
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


def _braked(u: Used) -> list[tuple[tuple[float, float], Any]]:
    """Each brake application with its samples in the design, where they are enough."""
    assert u.design
    t = u.design.t[u.design.at]
    of = [(span, np.flatnonzero((t >= span[0]) & (t <= span[1]))) for span in u.spans]
    return [(span, at) for span, at in of if len(at) >= LEAST]


def _unused(logs: Sequence[Used]) -> list[Finding]:
    names = [Path(u.log.path).name for u in logs if not (u.design and _braked(u))]
    return [Finding("calibration-log-unused", "info", names={"log": name}) for name in names]


# Posterior


def _shares(vehicle: Vehicle, radius: bool) -> dict[str, float]:
    """By how much each tolerance moves ln s: C is what has no other name; M is `axle_mass`."""
    v = vehicle
    names = ("friction", *_CHAIN, "axle_mass", "wheelset_inertia", "cylinder_diameter")
    shares = {name: getattr(v, name).tolerance / getattr(v, name).value for name in names}
    R, w = v.radius(1), wheelset(v, 1).rolling
    factors = {"axle_mass": -w, "wheelset_inertia": w - 1.0, "cylinder_diameter": 2.0}
    turned = 2.0 * (1.0 - w) - radius  # a rim speed is ω times the radius that is stated
    return {n: factors.get(n, 1.0) * x for n, x in shares.items()} | {
        "wheel_radius": turned * R.tolerance / R.value
    }


def _prior(
    designs: Sequence[model.Design], vehicle: Vehicle, radius: bool, late: float
) -> dict[int, Parameter]:
    """Stated tolerances and published ranges; a delay that the checks found widens its prior."""
    shares = _shares(vehicle, radius)
    prior = model.stated(designs[0], vehicle)
    prior[model.SCALE] = Parameter(0.0, math.sqrt(float(vehicle.covariance(shares, shares))))
    interval = max(d.interval for d in designs)
    usual = model.stated(designs[0]._replace(interval=interval), vehicle)[model.DELAY].tolerance
    prior[model.DELAY] = Parameter(0.0, max(usual, late))
    return prior


def _point(designs: Sequence[model.Design]) -> Floats:
    """How ln of the force at the mean brake changes with each shared parameter, (6,)."""
    on = [np.maximum(d.K[d.at], 0.0) > FREE for d in designs]
    K = np.concatenate([d.K[d.at][x] for d, x in zip(designs, on, strict=True)])
    faster = np.concatenate([d.faster[d.at][x] for d, x in zip(designs, on, strict=True)])
    found = np.zeros(len(model.UNITS))
    if len(K):
        found[[model.SCALE, model.OFFSET, model.FADE]] = 1.0, -1.0 / K.mean(), faster.mean()
    return found


def _agree(
    logs: Sequence[Used],
    designs: Sequence[model.Design],
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
            [d], [model.independent(d, model.left(d, joint.mean, of))], prior, [joint.mean[:n]]
        )
        means.append(found.mean[:n] - origin)
        informations.append(np.linalg.inv(found.covariance[:n, :n]))
    total = P + sum(x - P for x in informations)
    pull = sum(x @ m for x, m in zip(informations, means, strict=True))
    again = (1.0 + 1.0 / (len(designs) - 1)) * _AGAIN[model.SCALE] ** 2
    worst = (0.0, 0, 0.0, 0.0)
    for i, (d, mean, own) in enumerate(zip(designs, means, informations, strict=True)):
        C, D, g = np.linalg.inv(own), np.linalg.inv(total - own + P), _point([d])
        away = float(g @ (mean - D @ (pull - own @ mean)))
        variance = float(g @ (C + D - C @ P @ D - D @ P @ C) @ g) + again
        worst = max(worst, (abs(away) / math.sqrt(max(variance, 1e-12)), i, away, variance))
    sigmas, i, away, variance = worst
    if sigmas > NormalDist().inv_cdf(1.0 - _FALSE / (2.0 * len(designs))):
        values = {"share": math.expm1(away), "sigma_share": math.sqrt(variance), "sigmas": sigmas}
        path = logs[i].log.path
        why = Finding("logs-contradict", "error", values=values, names={"log": Path(path).name})
        raise UserError(f"{path}: {why.message}", why.hint or "")


def _vehicle(
    v: Vehicle, d: model.Design, prior: dict[int, Parameter], found: model.Posterior, radius: bool
) -> tuple[Vehicle, dict[str, Row], Floats]:
    """The calibrated vehicle, the table, and the correlation of its rows.

    Args:
        v: as stated.
        d: any design of the fit.
        prior: of the shared parameters.
        found: the posterior of these.
        radius: whether wheel speeds were used.
    """
    n, shares = len(model.UNITS), _shares(v, radius)
    mass = {"axle_mass": v.axle_mass.tolerance / v.axle_mass.value}
    known = ("axle_mass", "wheelset_inertia", "wheel_radius")
    chain = {name: x for name, x in shares.items() if name not in known}
    S, spread = found.mean[model.SCALE], prior[model.SCALE].tolerance ** 2
    both = np.array([[v.covariance(a, b) for a in (chain, mass)] for b in (chain, mass)])
    gain = np.array([v.covariance(chain, shares), v.covariance(mass, shares)]) / spread
    # Of (shared, C, M): what the logs say of s, and what is left of C and M where s is known.
    A = np.vstack([np.eye(n), np.zeros((2, n))])
    A[n:, model.SCALE] = gain
    joint = A @ found.covariance[:n, :n] @ A.T
    joint[n:, n:] += both - spread * np.outer(gain, gain)
    C, M = gain * S
    piston = d.top / force_line(v).per_pascal * math.pi * v.cylinder_diameter.value**2 / 4.0
    x = found.mean
    speed, fade0 = d.mean, prior[model.FADE]
    phi = v.friction.value * max(
        1.0 + v.friction_fade.value * (speed - v.friction_speed.value), 0.1
    )
    friction, m = phi * math.exp(C), v.axle_mass.value * math.exp(M)
    spring = max(v.spring_force.value + piston * float(x[model.OFFSET]), 0.0)
    kappa0, kappa = (math.exp(y) for y in (prior[model.STIFFNESS].value, x[model.STIFFNESS]))
    # name: place in `joint`, factor to its unit, prior, 1 sigma of it, posterior
    table: dict[str, tuple[int, float, float, float, float, str]] = {
        "force_over_mass": (0, math.exp(S), 1.0, math.sqrt(spread), math.exp(S), "-"),
        "friction": (n, friction, phi, phi * math.sqrt(both[0, 0]), friction, "-"),
        "axle_mass": (n + 1, m, *v.axle_mass, m, "kg"),
        "spring_force": (
            model.OFFSET, piston, v.spring_force.value, piston * prior[model.OFFSET].tolerance,
            spring, "N",
        ),
        "friction_fade": (model.FADE, 1.0, *fade0, float(x[model.FADE]), "s/m"),
        "pressure_delay": (model.DELAY, 1.0, *prior[model.DELAY], float(x[model.DELAY]), "s"),
        "creep_stiffness": (
            model.STIFFNESS, kappa, kappa0, kappa0 * prior[model.STIFFNESS].tolerance, kappa, "-",
        ),
        "running_resistance": (
            model.RESISTANCE, 1.0, *prior[model.RESISTANCE], float(x[model.RESISTANCE]), "m/s²",
        ),
    }  # fmt: skip
    places = [place for place, *_ in table.values()]
    sigma = np.sqrt(np.maximum(np.diag(joint), 1e-30))
    correlation = (joint / np.outer(sigma, sigma))[np.ix_(places, places)]
    rows = {
        name: Row(before, before_u, after, factor * float(sigma[place]), unit, _SOURCES[name])
        for name, (place, factor, before, before_u, after, unit) in table.items()
    }
    return _stated(v, rows, correlation, speed), rows, correlation


def _stated(v: Vehicle, rows: dict[str, Row], correlation: Floats, speed: float) -> Vehicle:
    """The vehicle of the posterior."""
    names = ("friction", "axle_mass", "spring_force", "friction_fade")
    places = {name: i for i, name in enumerate(rows)}
    related = tuple(
        (a, b, round(float(correlation[places[a], places[b]]), 4))
        for i, a in enumerate(names)
        for b in names[i + 1 :]
    )
    found: dict[str, Any] = {
        name: Parameter(rows[name].posterior, rows[name].posterior_u) for name in names
    }
    exact: dict[str, Any] = {
        n: Parameter(getattr(v, n).value, 0.0) for n in (*_CHAIN, "cylinder_diameter")
    }
    at = Parameter(speed, 0.0)
    return replace(v, **found, **exact, friction_speed=at, correlation=related)


# Report


def _band(
    v: Vehicle, stated: Vehicle, point: Floats, record: AxleRecord, d: model.Design
) -> tuple[float, float]:
    """Force of a rolling axle at the mean brake and the half-width of its 95 % band [N]."""
    share, faster = -1.0 / point[model.OFFSET], float(point[model.FADE])
    at, w = d.mean + faster - v.friction_speed.value, wheelset(v, record.axle)
    old, new = force_line(stated), force_line(v)
    K = share * d.top - (new.at_zero - old.at_zero)
    K *= 1.0 + v.friction_fade.value * at
    F = w.phi * K * w.rolling
    dw = -w.a * w.phi * K * (1.0 - w.rolling)
    moved = force.moves(record, v, *(np.array([x]) for x in (K, dw, d.mean + faster)))
    return float(F), Z95 * math.sqrt(float(v.covariance(moved, moved)[0]))


def _applied(u: Used, d: model.Design, found: model.Posterior, slopes: Floats) -> list[Applied]:
    """The decelerations of each brake application, by straight lines through its samples."""
    x = found.mean[: len(model.UNITS)]
    as_stated = x.copy()
    as_stated[[model.SCALE, model.OFFSET, model.FADE]] = found.prior[
        [model.SCALE, model.OFFSET, model.FADE]
    ]
    t, piece = d.t[d.at], np.repeat(slopes, d.size.astype(int))
    lost = [math.exp(y[model.SCALE]) * model.lost(d, y) for y in (as_stated, x)]
    rows = []
    for (begin, _), at in _braked(u):

        def slope(y: Floats, at: Any = at) -> float:
            return float(np.polyfit(t[at] - t[at].mean(), y[at], 1)[0])

        before, after = (slope(y) + float(x[model.RESISTANCE]) for y in lost)
        rows.append(Applied(
            Path(u.log.path).name, begin, float(d.measured[at].mean()), -slope(d.measured),
            before, after, float(piece[at].mean()),
        ))  # fmt: skip
    return rows


def as_toml(found: Calibration) -> str:
    """The vehicle, and how its logs were read, as `-c` takes it; comments say what it is from."""
    lines = ["# Vehicle by `adhesion calibrate`; tolerances are 1 sigma."]
    lines += ["# Only products of friction, discs, efficiency and ratios are known: friction has"]
    lines += ["# the tolerance of all. Do not change one of them, or friction, alone.", "# Logs:"]
    lines += [f"# - {Path(u.log.path).name!r}, sha256 {u.log.sha256}" for u in found.logs]
    lines += ["# Found as well, and not part of the vehicle:"]
    others = ("pressure_delay", "creep_stiffness", "running_resistance")
    for name, r in ((name, found.rows[name]) for name in others):
        shown = " ± ".join(by_uncertainty(r.posterior, r.posterior_u))
        lines.append(f"# - {name} = {shown} {r.unit}")
    stated, usual = tree(found.settings, []), tree(Settings(), [])
    for section in ("vehicle", "channels", "csv", "mcap"):
        if (keys := stated[section]) != usual[section]:
            lines += ["", f"[{section}]"]
            lines += [f"{toml.key(k)} = {toml.value(v)}" for k, v in keys.items()]
    return "\n".join([*lines, ""])


def panels(braked: Sequence[Applied]) -> list[Panel]:
    """Deceleration as predicted over the measured one, and their difference, by application."""
    measured = np.array([a.measured_mps2 for a in braked])
    number, ends = np.arange(1.0, len(braked) + 1.0), np.array([0.0, 1.1 * float(np.max(measured))])
    over, off = [Line("equal", ends, ends, BLACK, dashed=True)], []
    for name, colour in (("stated", GREY), ("calibrated", BLUE)):
        predicted = np.array([getattr(a, f"{name}_mps2") for a in braked])
        over.append(Line(name, measured, predicted, colour, dots=_DOT))
        off.append(Line(name, number, predicted - measured, colour, dots=_DOT))
    gradient = np.array([a.gradient_mps2 for a in braked])
    off.append(Line("fitted gradient", number, gradient, ORANGE, dots=0.5 * _DOT))
    return [
        Panel("Deceleration of each application", "measured [m/s²]", "predicted [m/s²]", over),
        Panel("Predicted less measured", "brake application", "difference [m/s²]", off),
    ]
