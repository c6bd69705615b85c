"""The main job: a log in, reference, estimates, scores and findings out."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..channels.log import read
from ..core import compiled, estimator, innovations, physics, threads
from ..core.errors import UserError, unknown
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import Z95, AxleRecord, AxleResult, Reference, Result, Vehicle, quantities
from ..core.time_axis import spans_of
from ..diagnostics import noise_model
from ..diagnostics.scene import Scene
from ..evaluation import metrics
from ..formats.memory import Signals
from ..formats.open import open_source
from ..formats.source import Source
from ..rail import slip
from ..reference import calibrated_vehicle, force
from . import settings as settings_module
from .axle_findings import of_axle
from .prepare import Window, prepare
from .settings import Settings

_NARROWER = 2.0 / 3.0  # of the stated band: from there on `calibrate` is worth its run
_CALIBRATED = "wheel-calibrated"
_FEW = 3  # defaults that the line of a finding names
_ROOM = 50  # letters that it has for them with their values


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
        UserError: for an unknown reference.
    """
    if settings.analysis.reference not in force.METHODS:
        raise unknown("reference", settings.analysis.reference, list(force.METHODS))
    return settings


def prepared(
    load: Callable[..., Settings], algos: Sequence[str], window: Window
) -> Callable[..., Settings]:
    """The same `load`, after a check of what a run is asked for.

    Raises:
        UserError: for an unknown name, a value out of range.
    """
    chosen(algos)
    stated = dict(zip(("--from", "--to"), window, strict=True))
    span = {flag: value for flag, value in stated.items() if value is not None}
    ends = span.get("--from", 0.0) < span.get("--to", math.inf)
    if not (ends and all(map(math.isfinite, span.values()))):
        text = " and ".join(f"{flag} {value:g}" for flag, value in span.items())
        hint = "--to is later than --from; both are seconds after the log's start"
        raise UserError(f"{text} are not two times in order", hint, code=2)
    checked(load())
    return load


def analyze(  # noqa: PLR0913 (each choice of a run has a default)
    path: Path | Signals,
    load: Callable[..., Settings],
    algos: Sequence[str] = (),
    axles: Sequence[int] = (),
    window: Window = (None, None),
    tell: Callable[[str], None] = lambda _: None,
    train_speed: bool = False,
) -> Result:
    """Analyses one log.

    Args:
        path: raw log, result file or signals in memory; a result's own settings are its defaults.
        load: gives the settings; takes `base`, which every stated setting overrides.
        algos: estimators to run, all if empty.
        axles: axles to analyse, all if empty.
        window: seconds after the log's start, from and to.
        tell: receives a line at each step.
        train_speed: whether a log without a train speed gets a reference speed of its axles.

    Raises:
        UserError: where the log cannot be read or holds nothing to analyse.
    """
    estimators = chosen(algos)
    tell(f"reading {path.name}")
    settings, source = opened(path, load)
    vehicle = settings.vehicle
    max_gap_ns = round(settings.analysis.max_gap * 1e9)
    axles = list(dict.fromkeys(axles))
    log = read(source, settings.mappings, vehicle, max_gap_ns=max_gap_ns)
    prepared = prepare(log, vehicle, axles, window, settings.checks)
    records, findings = prepared.records, [*prepared.findings]
    if train_speed and all(r.train_speed is None for r in records):
        records, speed_findings = slip.with_reference_speed(
            records, prepared.all_records, vehicle, log.start_ns()
        )
        findings += speed_findings

    def judged(record: AxleRecord) -> tuple[AxleResult, list[Finding]]:
        tell(f"{path.name}: axle {record.axle}")
        return _axle(record, settings, estimators, log.start_ns())

    every_axle = threads.each(judged, records)
    done = [result for result, _ in every_axle]
    findings += _with_diameters([f for _, more in every_axle for f in more], done, vehicle)
    findings += _calibration(prepared.scene, done[0], vehicle)
    defaults = assumed(settings, any(r.pressure is not None for r in records))
    sources = [r.reference.source for r in done[:1]] + [e.source for e in estimators]
    return Result(
        log,
        vehicle,
        tuple(done),
        tuple(dict.fromkeys((*defaults, *log.findings, *findings))),
        settings_module.tree(settings, estimators, axles, window),
        tuple(dict.fromkeys(sources)),
    )


def opened(path: Path | Signals, load: Callable[..., Settings]) -> tuple[Settings, Source]:
    """A log and its settings, see `analyze`.

    Raises:
        UserError: where it cannot be read, and for wrong settings.
    """
    settings = load()
    source = open_source(path, settings.read)
    if carried := _carried(path, source):
        settings = load(base=settings_module.nested(carried))
    return checked(settings), source


def _carried(path: Path | Signals, source: Source) -> Mapping[str, str]:
    """The settings that a result file was made with; none of a raw log.

    Raises:
        UserError: for the result of a comparison.
    """
    if any(name.startswith("adhesion.settings/") for name in source.metadata):
        raise UserError(
            f"{path}: a comparison of several logs, not a log",
            "name the logs themselves or their *.adhesion.mcap",
        )
    return source.metadata.get("adhesion.settings", {})


def assumed(settings: Settings, by_pressure: bool) -> list[Finding]:
    """The vehicle values that are defaults; those of the brake only if K is by pressure."""
    wheel = ("axle_mass", "wheel_radius", "wheelset_inertia", "friction")
    vehicle, papers, named, asked = settings.vehicle, Vehicle(), dict[str, str](), 0
    for name, q in quantities(Vehicle).items():
        if name.startswith("friction_") or not (by_pressure or name in wheel):
            continue
        asked += 1
        mine, theirs = (np.atleast_2d(getattr(v, name))[:, 0].tolist() for v in (vehicle, papers))
        if name not in settings.stated and mine == theirs:
            named[name] = f"{name} {theirs[0]:g} {q.unit}".removesuffix(" -")
    if not named:
        return []
    shown = {
        "parameters": ", ".join(named.values()), "which": _few(named),
        "are": "is a default" if len(named) == 1 else "are defaults",
    }  # fmt: skip
    values = {"defaults": len(named), "of": asked}
    return [Finding("vehicle-default", "warning", count=len(named), values=values, names=shown)]


def _few(named: Mapping[str, str]) -> str:
    """Which parameters are defaults, if a line has room for them."""
    if len(named) > _FEW:
        return " (the paper's vehicle)"
    whole = ", ".join(named.values())
    return f": {whole if len(whole) <= _ROOM else ', '.join(named)}"


def _with_diameters(
    findings: Sequence[Finding], axles: Sequence[AxleResult], vehicle: Vehicle
) -> list[Finding]:
    """The findings; those of calibrated wheels with the diameters of all axles, as one setting."""
    found = {f.channel: f"{f.values['diameter_m']:.4f}" for f in findings if f.code == _CALIBRATED}
    last = max(a.record.axle for a in axles)
    stated = [f"{2.0 * vehicle.radius(k).value:.6g}" for k in range(1, last + 1)]
    every = [found.get(f"axle {k}", one) for k, one in enumerate(stated, 1)]
    setting = f"[{','.join(every)}]" if last > 1 else every[0]
    return [
        replace(f, names={"diameters": setting}) if f.code == _CALIBRATED else f for f in findings
    ]


def _calibration(scene: Scene | None, axle: AxleResult, vehicle: Vehicle) -> list[Finding]:
    """That the log's own brake applications would make the band of the force narrower."""
    found = calibrated_vehicle.narrowed(scene, axle.record, axle.applications, vehicle)
    if found is None or found[1] > _NARROWER * found[0]:
        return []
    values = {"stated_share": found[0], "calibrated_share": found[1]}
    return [Finding("calibration-narrows", "info", values=values)]


def _axle(
    record: AxleRecord, settings: Settings, estimators: Sequence[Estimator], start_ns: int
) -> tuple[AxleResult, list[Finding]]:
    vehicle = settings.vehicle
    w, faded = physics.wheelset(vehicle, record.axle), physics.faded(record, vehicle)
    ref = force.compute(faded, vehicle, settings.analysis.reference)
    starts = np.array([s.start for s in record.segments], dtype=np.int64)
    found = {
        e.name: compiled.batch(
            e, settings.params(e), w, record.t, faded.clamping_force, record.wheel_speed, starts
        )
        for e in estimators
    }
    estimates = {name: force for name, (force, *_) in found.items()}
    sigmas = {name: sigma for name, (_, sigma, _) in found.items() if sigma is not None}
    nis = {name: innovations.mean(x) for name, (*_, x) in found.items() if x is not None}
    applications = metrics.applications(record)
    findings = list(of_axle(record, vehicle, ref, applications, start_ns))
    findings += noise_model.check(
        settings.checks["noise_model"], f"axle {record.axle}", {"the reference": ref.nis, **nis}
    )
    lost = [s for s in applications if _drowned(ref, s)]
    if lost:
        ref, refused = _refused(record, ref, lost, start_ns)
        findings.append(refused)
    known = tuple(s for s in applications if s not in lost)
    scores = metrics.scores(record, ref, estimates, known, sigmas)
    scores = tuple(replace(s, nis=nis.get(s.algo)) for s in scores)
    result = AxleResult(record, ref, estimates, scores, applications, sigmas=sigmas)
    if record.train_speed is None:
        return result, findings
    result, told = slip.observed(
        result, vehicle, settings.analysis.slowest, settings.slope, settings.bands
    )
    return result, findings + told


def _drowned(ref: Reference, application: slice) -> bool:
    """Whether the force of a brake application is mostly smaller than its 95 % noise."""
    known = np.isfinite(ref.force[application])
    force, noise = np.abs(ref.force[application][known]), Z95 * ref.sigma[application][known]
    return bool(known.any() and np.median(noise) > np.median(force))


def _refused(
    record: AxleRecord, ref: Reference, lost: Sequence[slice], start_ns: int
) -> tuple[Reference, Finding]:
    """The reference without these applications, whose noise exceeds the force."""
    force, sigma, tolerance = (c.copy() for c in (ref.force, ref.sigma, ref.tolerance))
    for s in lost:
        force[s] = sigma[s] = tolerance[s] = np.nan
    found = Finding(
        "reference-noise", "warning", channel=f"axle {record.axle}", count=len(lost),
        spans=spans_of(
            record.t[[s.start for s in lost]], record.t[[s.stop - 1 for s in lost]], start_ns
        ),
    )  # fmt: skip
    return replace(ref, force=force, sigma=sigma, tolerance=tolerance), found
