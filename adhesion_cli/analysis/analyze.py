"""The main job: a log in, reference, estimates, scores and findings out.

read → prepare (screen, align, identify the vehicle, diagnose) → each axle (reference, estimates,
slip) → summarise.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ..core import threads
from ..core.annotated import Progress
from ..core.cache_folder import silent
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import AxleRecord, AxleResult, IdentifiedVehicle, Log, Result
from ..core.summary import ResultSummary
from ..formats.memory import Signals
from ..rail import wheel_calibration
from ..records.route import check_route
from . import settings as settings_module
from .axle import analyze_axle, without_force
from .identify import at_load, find_log_brake, identify, with_force_of_log
from .loads import states_load
from .prepare import Window, align_log
from .request import choose_estimators, load_vehicle, read_log
from .settings import Settings
from .stops_of_log import stops_of_log
from .summarise import summarise, summarise_stops
from .vehicle_findings import diagnose_with, state_diameters, without_force_findings


def analyze(  # noqa: PLR0913 (each choice of a run has a default)
    path: Path | Signals,
    settings: Settings,
    algos: Sequence[str] = (),
    axles: Sequence[int] = (),
    window: Window = (None, None),
    progress: Progress = silent,
    train_speed: bool = False,
    identified: IdentifiedVehicle | None = None,
) -> Result:
    """Analyses one log.

    Args:
        path: raw log, result file or signals in memory; a result's own settings are its defaults.
        settings: what is stated; it counts more than what a result carries.
        algos: estimators to run, all if empty.
        axles: axles to analyse, all if empty.
        window: seconds after the log's start, from and to.
        progress: receives a line at each step.
        train_speed: whether a log without a train speed gets a reference speed of its axles.
        identified: the vehicle, where this and other logs have shown it together.

    Raises:
        UserError: where the log cannot be read or holds nothing to analyse.
    """
    choose_estimators(algos)  # a wrong name is an error before a long log is read
    progress(f"reading {path.name}")
    settings, log = read_log(path, settings)
    return analyze_log(log, settings, algos, axles, window, progress, train_speed, identified)


def analyze_log(  # noqa: PLR0913 (as of `analyze`)
    log: Log,
    settings: Settings,
    algos: Sequence[str],
    axles: Sequence[int],
    window: Window,
    progress: Progress,
    train_speed: bool,
    identified: IdentifiedVehicle | None,
) -> Result:
    """Analyses a log that has been read, with its channels' meanings; the rest as `analyze`."""
    estimators, axles = choose_estimators(algos), list(dict.fromkeys(axles))
    stated_load = states_load(settings.vehicle)
    settings, load_findings = load_vehicle(settings, log)
    start_ns = log.start_ns()

    aligned = align_log(log, settings.vehicle, axles, window, settings.checks, settings.track)
    if identified is None or settings.analysis.vehicle == "stated":
        identified = identify([aligned], settings)
    elif stated_load:  # found at another load
        identified = replace(identified, vehicle=at_load(identified, settings.vehicle))
    vehicle_findings, prepared = diagnose_with(aligned, identified, settings)
    identified = with_force_of_log(identified, settings.vehicle)
    settings = settings.with_vehicle(identified)
    vehicle = settings.vehicle
    records, findings = prepared.records, [*prepared.findings]
    if train_speed and all(r.train_speed is None for r in records):
        records, speed_findings = wheel_calibration.with_reference_speed(
            records, prepared.all_records, vehicle, start_ns, identified.known
        )
        findings += speed_findings

    def analyzed(record: AxleRecord) -> tuple[AxleResult, list[Finding]]:
        progress(f"{Path(log.path).name}: axle {record.axle}")
        return analyze_axle(record, settings, estimators, start_ns)

    results, findings_by_axle = zip(*threads.run_each(analyzed, records), strict=True)
    axle_findings = [f for of_axle in findings_by_axle for f in of_axle]
    if any(f.code == "train-speed-delay-or-offset" for f in findings):  # says this already
        axle_findings = [f for f in axle_findings if f.code != "train-speed-delay-unknown"]
    findings += check_route(log, vehicle)
    findings += state_diameters(axle_findings, results, vehicle, log)
    if not identified.known:
        results = tuple(without_force(axle) for axle in results)
        findings = without_force_findings(findings)
    return Result(
        log,
        identified,
        results,
        tuple(dict.fromkeys((*vehicle_findings, *load_findings, *log.findings, *findings))),
        settings_module.tree(settings, estimators, axles, window),
        tuple(dict.fromkeys((results[0].reference.source, *(e.source for e in estimators)))),
        find_log_brake(aligned, settings),
        settings.track,
    )


class EvaluatedLog(NamedTuple):
    """A log with its summary."""

    log: Log
    summary: ResultSummary
    result: Result | None  # None: no axle can be analysed, and there are the stops alone

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Those of the analysis, else those of the log."""
        return self.result.findings if self.result else self.log.findings


def evaluate(  # noqa: PLR0913 (as of `analyze`)
    path: Path,
    settings: Settings,
    algos: Sequence[str],
    axles: Sequence[int],
    window: Window,
    train_speed: bool = False,
    identified: IdentifiedVehicle | None = None,
) -> EvaluatedLog:
    """Analyses a log; one that has no axle to analyse gives the stops of the train.

    Arguments as of `analyze`.

    Raises:
        UserError: where the log cannot be read, or has neither.
    """
    choose_estimators(algos)  # a wrong name is an error before a long log is read
    settings, log = read_log(path, settings)
    try:
        result = analyze_log(log, settings, algos, axles, window, silent, train_speed, identified)
    except UserError as refusal:
        stops = stops_of_log(log, settings, window)
        if refusal.code == 2 or not stops:  # 2: the log does not have what is asked for
            raise
        reason = refusal.text.removeprefix(f"{log.path}: ").partition(" (")[0]
        remark = Finding("stops-alone", "info", names={"reason": reason})
        log = replace(log, findings=(*log.findings, remark))
        return EvaluatedLog(log, summarise_stops(log, settings.vehicle, stops), None)
    return EvaluatedLog(result.log, summarise(result, {}), result)
