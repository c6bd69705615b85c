"""The main job: a log in, reference, estimates, scores and findings out."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..channels.log import read
from ..core import compiled, estimator, physics, signals
from ..core.errors import UserError, unknown
from ..core.estimator import Estimator
from ..core.finding import Finding, Severity
from ..core.model import Z95, AxleRecord, AxleResult, Bools, Reference, Result, Vehicle, quantities
from ..diagnostics import plausible
from ..evaluation import metrics
from ..formats.open import open_source
from ..rail import slip
from ..records import axle_records
from ..reference import force
from . import settings as settings_module
from .settings import Settings

_HIGHEST = 0.7  # no rail has a higher adhesion coefficient [-]
_BRAKED = 0.05  # of the highest K: less is no braking
_SURELY = 0.99  # so likely, and a speed is the mean since the last one
_FEW = 12.0  # pulses in 0.1 s: with fewer, slides do not stand out from rounding
_SLIGHT = 0.02  # of the highest φK: as little is an error of what the model leaves out


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


def checked(settings: Settings) -> Settings:
    """The settings, if the methods they name exist.

    Raises:
        UserError: for a reference nobody knows.
    """
    if settings.analysis.reference not in force.METHODS:
        raise unknown("reference", settings.analysis.reference, list(force.METHODS))
    return settings


def analyze(  # noqa: PLR0913
    path: Path,
    load: Callable[..., Settings],
    algos: Sequence[str] = (),
    axles: Sequence[int] = (),
    window: axle_records.Window = (None, None),
    tell: Callable[[str], None] = lambda _: None,
    train_speed: bool = False,
) -> Result:
    """Analyses one log.

    Args:
        path: raw log or result file; a result file's own settings are its defaults.
        load: gives the settings; takes `base`, settings weaker than every stated one.
        algos: estimators to run, all if empty.
        axles: axles to analyse, all if empty.
        window: seconds after the log's start, from and to.
        tell: is told what is being done.
        train_speed: whether a log that has none gets one made of its axles.

    Raises:
        UserError: where the log cannot be read or holds nothing to analyse.
    """
    estimators = chosen(algos)
    tell(f"reading {path.name}")
    settings = load()
    source = open_source(path, settings.read)
    if any(name.startswith("adhesion.settings/") for name in source.metadata):
        raise UserError(
            f"{path}: a comparison of several logs, not a log",
            "name the logs themselves or their *.adhesion.mcap",
        )
    if carried := source.metadata.get("adhesion.settings"):
        settings = load(base=settings_module.nested(carried))
    checked(settings)
    vehicle = settings.vehicle
    max_gap_ns = round(settings.analysis.max_gap * 1e9)
    axles = list(dict.fromkeys(axles))
    log = read(source, settings.mappings, vehicle, max_gap_ns=max_gap_ns)
    records, findings = plausible.records(log, vehicle, axles, window, settings.checks)
    if train_speed and all(r.train_speed is None for r in records):
        every = plausible.records(log, vehicle, (), window)[0] if axles else records
        records, told = slip.with_reference_speed(records, every, vehicle, log.start_ns())
        findings += told
    done = []
    for record in records:
        tell(f"{path.name}: axle {record.axle}")
        result, more = _axle(record, settings, estimators, log.start_ns())
        done.append(result)
        findings += more
    findings += _assumed(vehicle, any(r.pressure is not None for r in records))
    sources = [r.reference.source for r in done[:1]] + [e.source for e in estimators]
    return Result(
        log,
        vehicle,
        tuple(done),
        tuple(dict.fromkeys((*log.findings, *findings))),
        settings_module.tree(settings, estimators, axles, window),
        tuple(dict.fromkeys(sources)),
    )


def _assumed(vehicle: Vehicle, by_pressure: bool) -> list[Finding]:
    """Which values of the vehicle are the paper's: of (1), and of (15) where K is by pressure."""
    wheel = ("axle_mass", "wheel_radius", "wheelset_inertia", "friction")
    papers, named = Vehicle(), []
    for name, q in quantities(Vehicle).items():
        mine, theirs = (np.atleast_2d(getattr(v, name))[:, 0].tolist() for v in (vehicle, papers))
        if (by_pressure or name in wheel) and mine == theirs:
            named.append(f"{name} {theirs[0]:g} {q.unit}".removesuffix(" -"))
    if not named:
        return []
    text = (
        f"{', '.join(named)}: as of the paper's vehicle, and every force goes by them; state yours "
        "in [vehicle] of a TOML given with -c, or by --set vehicle.NAME=VALUE, where they differ"
    )
    return [Finding("vehicle-assumed", "info", text)]


def _axle(
    record: AxleRecord, settings: Settings, estimators: Sequence[Estimator], start_ns: int
) -> tuple[AxleResult, list[Finding]]:
    vehicle = settings.vehicle
    w = physics.wheelset(vehicle, record.axle)
    ref = force.compute(record, vehicle, settings.analysis.reference)
    starts = np.array([s.start for s in record.segments], dtype=np.int64)
    estimates = {
        e.name: compiled.batch(
            e, settings.params(e), w, record.t, record.clamping_force, record.wheel_speed, starts
        )
        for e in estimators
    }
    applications = metrics.applications(record)
    findings = _told(record, vehicle, ref, applications, start_ns)
    lost = [s for s in applications if _drowned(ref, s)]
    if lost:
        ref, refused = _refused(record, ref, lost, start_ns)
        findings.append(refused)
        applications = tuple(s for s in applications if s not in lost)
    scores = metrics.scores(record, ref, estimates, applications)
    result = AxleResult(record, ref, estimates, scores, applications)
    if record.train_speed is None:
        return result, findings
    result, told = slip.observed(
        result, vehicle, settings.analysis.slowest, settings.slope, settings.bands
    )
    return result, findings + told


def _drowned(ref: Reference, application: slice) -> bool:
    """Whether a brake application's force is mostly less than the 95 % noise of it."""
    known = np.isfinite(ref.force[application])
    force, noise = np.abs(ref.force[application][known]), Z95 * ref.sigma[application][known]
    return bool(known.any() and np.median(noise) > np.median(force))


def _refused(
    record: AxleRecord, ref: Reference, lost: Sequence[slice], start_ns: int
) -> tuple[Reference, Finding]:
    """The reference without these applications: a figure less sure than large is none."""
    force, sigma, tolerance = (c.copy() for c in (ref.force, ref.sigma, ref.tolerance))
    for s in lost:
        force[s] = sigma[s] = tolerance[s] = np.nan
    text = (
        "the noise of the force (95 %) exceeds the force in this many brake applications: no value "
        "there; log the wheel speed with more pulses per turn, less noise or a higher rate"
    )
    first = (int(record.t[lost[0].start]) - start_ns) / 1e9
    told = Finding("reference-noise", "warning", text, f"axle {record.axle}", len(lost), first)
    return replace(ref, force=force, sigma=sigma, tolerance=tolerance), told


def _told(
    record: AxleRecord,
    vehicle: Vehicle,
    ref: Reference,
    applications: Sequence[slice],
    start_ns: int,
) -> list[Finding]:
    """What must be said about one axle's result."""
    findings: list[Finding] = []

    def tell(code: str, severity: Severity, message: str, where: Bools) -> None:
        if count := int(where.sum()):
            first = (int(record.t[np.argmax(where)]) - start_ns) / 1e9
            findings.append(Finding(code, severity, message, f"axle {record.axle}", count, first))

    turning = np.zeros(len(record), dtype=np.bool_)
    for run in signals.moving(record):
        turning[run] = True
    text = "the wheel stands: no reference there, friction is anything up to φK"
    tell("standstill", "info", text, ~turning)
    driven = signals.driven(record, vehicle.radius(record.axle).value)
    text = (
        "the wheel gains speed without brake: a motor drives it, whose torque (1) does not know; "
        "no reference there"
    )
    tell("traction", "info", text, driven)
    short = turning & ~driven & ~np.isfinite(ref.force)
    lost = any(short[s].any() and turning[s].all() for s in record.segments)
    text = "segments too short for the reference: no value there"
    if not lost:
        text = "the wheel turns for too few samples between two stands: no reference there"
    tell("no-reference", "warning" if lost else "info", text, short)
    if ref.runout:
        text = (
            f"the speed errs by up to {100.0 * ref.runout:.2g} % once per turn, as by a tone ring "
            "that is not centred: taken out for the reference, estimators see it as logged"
        )
        findings.append(Finding("wheel-runout", "info", text, f"axle {record.axle}"))
    if ref.averaged > _SURELY:
        text = (
            "the speed follows the brake half an interval late, as of a sensor that averages since "
            "its last reading or counts its pulses' period: placed there for the reference, "
            "estimators see it as logged"
        )
        findings.append(Finding("speed-averaged", "info", text, f"axle {record.axle}"))
    if ref.pulses < _FEW:
        text = (
            f"the counter gives {ref.pulses:.1f} pulses in the 0.1 s in which a slide may change: "
            "slides may not show, and the noise of the force is that of a wheel that rolls; "
            "log more pulses per turn"
        )
        findings.append(Finding("few-pulses", "warning", text, f"axle {record.axle}"))
    if not applications:
        text = "no brake application found: estimators are not scored"
        findings.append(Finding("no-application", "info", text, f"axle {record.axle}"))
    begins = np.zeros(len(record), dtype=np.bool_)
    begins[[s.start for s in metrics.started(record, applications)]] = True
    text = (
        "the log, or what follows a gap, begins in mid-brake: estimators start there from nothing, "
        f"their first {metrics.START_UP:g} s are not scored"
    )
    tell("started-braked", "info", text, begins)
    force, surely = np.nan_to_num(np.abs(ref.force)), np.nan_to_num(np.abs(ref.force) - ref.half)
    highest = float(physics.coefficient(force, vehicle).max(initial=0.0))
    text = f"adhesion coefficient up to {highest:.1f}: units or vehicle parameters are wrong"
    high = (physics.coefficient(force, vehicle) > 1.0) | (
        physics.coefficient(surely, vehicle) > _HIGHEST
    )
    tell("implausible", "warning", text, high)

    # Without adhesion the wheel slows by aφK, and no rail makes it slow harder.
    K, w = record.clamping_force_smooth, physics.wheelset(vehicle, record.axle)
    most = float(K.max(initial=0.0))
    driving = np.nan_to_num(ref.upper) < -_SLIGHT * w.phi * most
    driving &= (_BRAKED * most < K) & ~high
    slowing = w.a * (w.phi * K - np.nan_to_num(ref.force)) * vehicle.radius(record.axle).value
    locks = slowing > physics.LOCKING
    for where, sensor in (
        (driving & locks, "the wheel-speed sensor drops out"),
        (driving & ~locks, "the pressure sensor reads too little or too late, or another brake"),
    ):
        text = f"the wheel slows harder than its brake makes it even without adhesion: {sensor}"
        tell("implausible", "warning", text, where)
    return findings
