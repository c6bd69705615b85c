"""The brake test: the stops of all logs as one series, by a plan or by nominal speed."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from .. import __version__
from ..analysis.evaluate import evaluate
from ..analysis.identify import identify_together
from ..analysis.prepare import Window
from ..analysis.settings import Settings
from ..core.annotated import Json, as_json
from ..core.document import findings_document, tagged
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import IdentifiedVehicle, LogBrake
from ..core.summary import FailedLog, summarise_finding
from ..results.friction_groups import GroupedRun, find_friction_differs, group_by_friction
from ..results.geojson import MapOfLog, map_of_log
from ..results.report.protocol import Protocol
from ..stops.series import (
    GroupDifference,
    SeriesStop,
    StopSeries,
    WspSummary,
    compare_wet,
    differences,
    group_stops,
    judge,
    wet_speeds,
)
from .plan import Plan, PlannedGroup

_ALGO = "td"  # the quickest estimator: stops need the reference only


class Request(NamedTuple):
    """What of each log is taken."""

    axles: tuple[int, ...] = ()
    window: Window = (None, None)


class BrakeTest(NamedTuple):
    """A series with its results."""

    series: StopSeries
    findings: tuple[Finding, ...]
    failed: tuple[FailedLog, ...]
    plan: Plan
    maps: tuple[MapOfLog, ...] = ()  # of the logs that did not fail


def run(
    logs: Sequence[Path],
    load: Callable[[Sequence[Path]], Settings],
    plan: Plan,
    request: Request,
    progress: Callable[[str], None],
) -> BrakeTest:
    """Evaluates a series.

    Args:
        logs: the logs, each of one group or of none where the plan has no groups.
        load: gives the settings with those of further files: a group may state its vehicle.
        plan: of the series.
        request: what of each log is taken.
        progress: receives a line at each step.

    Raises:
        UserError: a log is in no group, or every log fails.
    """
    members = _members(logs, plan)
    stops: list[SeriesStop] = []
    findings: list[Finding] = []
    failed: list[FailedLog] = []
    maps: list[MapOfLog] = []
    for group, paths in members:
        stated = _load_for(group, load)
        identified = None
        if len(paths) > 1:
            progress(f"finding the vehicle of {len(paths)} logs")
            identified = identify_together(paths, stated, request.axles, request.window)
        runs: list[GroupedRun] = []  # with one vehicle
        its_stops: list[SeriesStop] = []
        for path in paths:
            progress(f"{path.name}: stops")
            try:
                map_, its_findings, brake = _map(path, stated, request, identified)
            except UserError as error:
                failed.append(FailedLog(str(path), error.text, error.hint))
                if len(failed) == len(logs):
                    raise
                continue
            findings += its_findings
            runs.append(GroupedRun(str(path), brake))
            label = group.label or None if group else None
            maps.append(map_._replace(group=group and group.name, label=label))
            for stop in map_.stops:
                name = group.name if group else f"{stop.nominal_speed_kmh:g} km/h"
                its_stops.append(SeriesStop(str(path), name, label, stop))
        stops += _by_clock(its_stops)
        findings = [*find_friction_differs(runs, group_by_friction(runs), by_name=True), *findings]
    groups = group_stops(stops)
    wsp: tuple[WspSummary, ...] = ()
    if plan.dry:
        wsp = (compare_wet(stops, plan.dry, plan.wet, plan.reservoir_volume),)
        if speeds := wet_speeds(stops, plan.dry, plan.wet):
            dry_kmh, wet_kmh = (", ".join(f"{v:g}" for v in x) for x in speeds)
            names = {"dry": plan.dry, "dry_kmh": dry_kmh, "wet": plan.wet, "wet_kmh": wet_kmh}
            findings.append(Finding("wet-speeds-differ", "warning", names=names))
    compared, limits = differences(groups, plan.pairs), judge(groups, plan.limits)
    series = StopSeries(tuple(stops), tuple(groups), tuple(compared), tuple(limits), wsp)
    return BrakeTest(series, tuple(dict.fromkeys(findings)), tuple(failed), plan, tuple(maps))


def _members(logs: Sequence[Path], plan: Plan) -> list[tuple[PlannedGroup | None, list[Path]]]:
    """The logs by group, in the order of the plan."""
    if not plan.groups:
        return [(None, list(logs))]
    by_name: dict[str, list[Path]] = {}
    for log in logs:
        by_name.setdefault(plan.group_of(log).name, []).append(log)
    for group in plan.groups:
        if group.name not in by_name:
            text = f"group {group.name}: no log matches {', '.join(group.logs)}"
            raise UserError(text, "name its logs on the command line, or correct the plan")
    return [(group, by_name[group.name]) for group in plan.groups]


def _by_clock(stops: Sequence[SeriesStop]) -> Sequence[SeriesStop]:
    """Stops in the order of time, in which they may drift; as named where a log has no clock."""
    if not all(s.stop.time for s in stops):
        return stops
    return sorted(stops, key=lambda s: s.stop.time or "")


def _load_for(group: PlannedGroup | None, load: Callable[[Sequence[Path]], Settings]) -> Settings:
    """The settings of a group: those of all, with its own vehicle and nominal speed."""
    settings = load([group.vehicle] if group and group.vehicle else [])
    if group is None:
        return settings
    stops = settings.stops._replace(nominal_speed=float(group.nominal_speed))
    return replace(settings, stops=stops) if group.nominal_speed else settings


def _map(
    path: Path, settings: Settings, request: Request, identified: IdentifiedVehicle | None
) -> tuple[MapOfLog, Sequence[Finding], LogBrake | None]:
    """The stops of a log with their places, by its axles or else by what it has; its brake."""
    axles, window = request
    evaluated = evaluate(path, settings, [_ALGO], axles, window, identified=identified)
    log, summary, result = evaluated
    brake = result.brake if result else None
    return map_of_log(log, summary.stops, summary.axles), evaluated.findings, brake


def protocol(test: BrakeTest, title: str, braked_weight: bool = False) -> Protocol:
    """The series as a page."""
    logs = dict.fromkeys(s.log for s in test.series.stops)
    about = {
        "Evaluated by": f"adhesion {__version__}",
        "Logs": ", ".join(Path(log).name for log in logs),
        **{f"Not evaluated: {x.path}": x.error for x in test.failed},
        "Expanded uncertainties": "coverage factor 2, about 95 %",
    }
    stated = {f"{g.name}": _stated(g) for g in test.plan.groups}
    about |= {f"Group {name}": text for name, text in stated.items() if text}
    return Protocol(
        title,
        test.plan.protocol,
        test.series,
        [summarise_finding(f) for f in test.findings],
        about,
        braked_weight,
    )


def _stated(group: PlannedGroup) -> str:
    """What the plan states of a group."""
    vehicle = group.vehicle and group.vehicle.name
    speed = f"{group.nominal_speed:g} km/h" if group.nominal_speed else ""
    values = {
        "nominal speed": speed, "rail": group.rail, "load": group.load, "mode": group.mode,
        "label": group.label, "vehicle": vehicle,
    }  # fmt: skip
    return ", ".join(f"{name}: {value}" for name, value in values.items() if value)


# ------------------------------------------------------------------------------------ the document


def document(test: BrakeTest) -> Json:
    """The `adhesion.stops/1` document."""
    series = test.series
    return tagged(
        "stops",
        stops=[
            {"log": s.log, "group": s.group, "label": s.label, **as_json(s.stop)}
            for s in series.stops
        ],
        groups=[
            {"name": g.name, "n": g.n, **{q: as_json(x) for q, x in g.statistics.items()}}
            for g in series.groups
        ],
        differences=[_difference(x) for x in series.differences],
        limits=as_json(series.limits),
        wsp=as_json(series.wsp),
        failed=as_json(test.failed),
        findings=findings_document(test.findings),
    )


def _difference(x: GroupDifference) -> Json:
    names = {"from": x.from_group, "to": x.to_group}
    return names | {k: v for k, v in as_json(x).items() if k not in ("from_group", "to_group")}
