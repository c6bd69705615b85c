"""The brake test: the stops of all logs as one series, by a plan or by nominal speed."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import __version__
from ..analysis.analyze import evaluate
from ..analysis.prepare import Window
from ..analysis.settings import Settings
from ..channels.meaning import Mapping
from ..core.annotated import Json, as_json
from ..core.document import tagged
from ..core.errors import UserError
from ..core.finding import Finding, is_doubt
from ..core.model import Z95, IdentifiedVehicle, LogBrake, Parameter
from ..core.summary import (
    AxleSummary,
    FailedLog,
    StopSummary,
    VehicleSummary,
    summarise_finding,
)
from ..core.text import enumerated
from ..results.friction_groups import (
    find_friction_differs,
    group_by_friction,
    run_of_log,
)
from ..results.geojson import MapOfLog, map_of_log
from ..results.names import flat
from ..results.report.protocol import Protocol
from ..results.text_tables import with_u95
from ..results.vehicle_text import VehicleOfLog, describe_vehicles
from ..stops.measure import DEAD_TIME_ERROR
from ..stops.series import (
    Group,
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
from .named_together import identify_together
from .plan import Plan, PlannedGroup

_ALGO = "td"  # the quickest estimator: stops need the reference only
_DELAY_UNKNOWN = "train-speed-delay-unknown", "train-speed-slow", "train-speed-delay-or-offset"
_LIKE_BUILD_UP = 1.5  # build-ups of one brake position differ by a smaller factor
_DELAY_SPREAD = 0.05  # by which delays of one receiver may differ besides their errors [s]


class _Request(NamedTuple):
    """A log of a series, and how it is evaluated."""

    path: Path
    group: PlannedGroup | None
    settings: Settings
    axles: Sequence[int]
    window: Window
    identified: IdentifiedVehicle | None


class TestedLog(NamedTuple):
    """What a series needs of a log besides its stops."""

    request: _Request
    findings: tuple[Finding, ...]
    vehicle: VehicleSummary
    axles: tuple[AxleSummary, ...]
    brake: LogBrake | None  # by the deceleration of this log alone
    map: MapOfLog
    sha256: str  # of its bytes
    speedometers: frozenset[str]  # names of the channels of the train speed

    @property
    def path(self) -> str:
        """Path of the log."""
        return str(self.request.path)

    @property
    def group(self) -> str:
        """Its group of the plan; "" without one."""
        return self.request.group.name if self.request.group else ""

    @property
    def brake_mode(self) -> tuple[Path | None, str] | None:
        """Vehicle and brake mode by the plan: logs with the same ones have one dead time."""
        return self.request.group and (self.request.group.vehicle, self.request.group.mode)

    @property
    def is_doubtful(self) -> bool:
        """Whether the log contradicts its vehicle."""
        return any(is_doubt(f.code, f.severity) for f in self.findings)


class BrakeTest(NamedTuple):
    """A series with its results."""

    series: StopSeries
    findings: tuple[Finding, ...]  # those on the series
    logs: tuple[TestedLog, ...]  # those that did not fail
    failed: tuple[FailedLog, ...]
    plan: Plan

    @property
    def findings_by_log(self) -> list[tuple[str, Finding]]:
        """All findings, each after the path of its log, or after "" if it is on the series."""
        of_logs = [(log.path, finding) for log in self.logs for finding in log.findings]
        return [*(("", finding) for finding in self.findings), *of_logs]

    @property
    def vehicle_lines(self) -> list[str]:
        """The vehicle of the series, or those of its groups, in a line each."""
        return describe_vehicles([
            VehicleOfLog(log.group, Path(log.path).name, log.vehicle, log.axles, log.brake)
            for log in self.logs
            if log.axles
        ])  # fmt: skip


def run(
    logs: Sequence[Path],
    load: Callable[[Sequence[Path]], Settings],
    plan: Plan,
    axles: Sequence[int],
    window: Window,
    progress: Callable[[str], None],
) -> BrakeTest:
    """Evaluates a series.

    Each log is of one group, or of none where the plan has no groups. `load` gives the settings
    with those of further files: a group may state its vehicle.

    Raises:
        UserError: a log is in no group, or every log fails.
    """
    tested: list[TestedLog] = []
    failed: list[FailedLog] = []
    for group, paths in _members(logs, plan):
        settings = _load_for(group, load)
        if len(paths) > 1:
            progress(f"finding the vehicle of {len(paths)} logs")
        vehicles = identify_together(paths, settings, axles, window)
        for path, identified in zip(paths, vehicles, strict=True):
            progress(f"{path.name}: stops")
            try:
                tested.append(_test_log(_Request(path, group, settings, axles, window, identified)))
            except UserError as error:
                failed.append(FailedLog(str(path), error.text, error.hint))
                if len(failed) == len(logs):
                    raise
    tested = [_with_times_of(tested, log) for log in tested]
    stops: list[SeriesStop] = []
    findings: list[Finding] = []
    for _, logs_of_group in groupby(tested, lambda x: x.group):
        members = [*logs_of_group]
        its_stops = [
            SeriesStop(
                x.path, x.group or f"{y.nominal_speed_kmh:g} km/h", x.map.label, y, x.is_doubtful
            )
            for x in members
            for y in x.map.stops
        ]
        if all(s.stop.time for s in its_stops):  # in the order of time, in which they may drift
            its_stops.sort(key=lambda s: s.stop.time or "")
        stops += its_stops
        runs = [run_of_log(x.path, x.brake, x.request.identified) for x in members]
        findings += find_friction_differs(runs, group_by_friction(runs), by_name=True)
    groups = group_stops(stops)
    wsp: list[WspSummary] = []
    for dry, wet in plan.wet_pairs:
        wsp.append(compare_wet(stops, dry, wet, plan.reservoir_volume))
        if speeds := wet_speeds(stops, dry, wet):
            dry_kmh, wet_kmh = (", ".join(f"{v:g}" for v in x) for x in speeds)
            names = {"dry": dry, "dry_kmh": dry_kmh, "wet": wet, "wet_kmh": wet_kmh}
            findings.append(Finding("wet-speeds-differ", "warning", names=names))
    compared, limits = differences(groups, plan.pairs), judge(stops, groups, plan.limits)
    findings += _find_unused_rules(groups, plan)
    series = StopSeries(tuple(stops), tuple(groups), tuple(compared), tuple(limits), tuple(wsp))
    return BrakeTest(series, tuple(findings), tuple(tested), tuple(failed), plan)


def _find_unused_rules(groups: Sequence[Group], plan: Plan) -> Iterator[Finding]:
    """Groups whose nominal speed a published rule, which is named for them, does not have."""
    for group in groups:
        limits = [x for x in plan.limits if x.speed and x.group in ("", group.name)]
        if group.n and limits and not any(limit.is_for(group) for limit in limits):
            speeds = enumerated([f"{limit.speed:g}" for limit in limits])
            names = {"group": group.name, "rule": limits[0].source, "speeds_kmh": speeds}
            yield Finding("limit-not-applied", "warning", names=names)


def _members(logs: Sequence[Path], plan: Plan) -> list[tuple[PlannedGroup | None, list[Path]]]:
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


def _load_for(group: PlannedGroup | None, load: Callable[[Sequence[Path]], Settings]) -> Settings:
    """The settings of a group: those of all, with its own vehicle and nominal speed."""
    settings = load([group.vehicle] if group and group.vehicle else [])
    if group is None:
        return settings
    stops = settings.stops._replace(nominal_speed=float(group.nominal_speed))
    return replace(settings, stops=stops) if group.nominal_speed else settings


def _with_times_of(logs: Sequence[TestedLog], log: TestedLog) -> TestedLog:
    """A log, evaluated again with what others of its brake show and it does not.

    These are the dead time of a brake whose command is not logged, and the delay of a train speed
    that slides hide: of a channel of the same name, as another sensor has another delay. Nothing is
    taken of logs that contradict each other.
    """
    settings, texts = log.request.settings, list[str]()
    sister_logs = [x for x in logs if x.brake_mode == log.brake_mode]
    if any(s.command_from == "pressure" for s in log.map.stops) and not settings.stops.dead_time:
        fills = [s.build_up_s.value for s in log.map.stops if s.build_up_s]
        stops_of_others = (s for x in sister_logs for s in x.map.stops if _fills_alike(s, fills))
        times = [s.dead_time_s.value for s in stops_of_others if s.dead_time_s]
        if times and np.ptp(times) < 4.0 * DEAD_TIME_ERROR * np.mean(times):
            stops = settings.stops._replace(dead_time=float(np.mean(times)))
            settings = replace(settings, stops=stops)
            texts.append(f"dead time of the brake {stops.dead_time:.2f} s")
    if any(f.code in _DELAY_UNKNOWN for f in log.findings):
        same_sensor = [x for x in sister_logs if x.speedometers & log.speedometers]
        delays = [
            f.values for x in same_sensor for f in x.findings if f.code == "train-speed-delay"
        ]
        values = [x["delay_s"] for x in delays]
        sigma = max((x["delay_u95_s"] for x in delays), default=0.0) / Z95
        if delays and np.ptp(values) < 4.0 * sigma + _DELAY_SPREAD:
            delay = Parameter(float(np.mean(values)), math.hypot(sigma, np.std(values)))
            mapping = Mapping("train_speed", None, "", delay=delay)
            settings = replace(settings, mappings=(*settings.mappings, mapping))
            delay_text = with_u95((delay.value, Z95 * delay.tolerance), 1.0, 2)
            texts.append(f"delay of the train speed {delay_text} s")
    if not texts:
        return log
    finding = Finding("times-of-other-logs", "info", names={"times": " and ".join(texts)})
    second_test = _test_log(log.request._replace(settings=settings))
    return second_test._replace(findings=(*second_test.findings, finding))


def _fills_alike(stop: StopSummary, build_ups: Sequence[float]) -> bool:
    """Whether a brake fills about as fast, as far as it is known: P and G are other brakes."""
    usual = float(np.median(build_ups)) if build_ups else 0.0
    if not usual or stop.build_up_s is None:
        return True
    ratio = stop.build_up_s.value / usual
    return 1.0 / _LIKE_BUILD_UP < ratio < _LIKE_BUILD_UP


def _test_log(request: _Request) -> TestedLog:
    """A log with its stops and their places, by its axles or else by what it has."""
    path, group, settings, axles, window, identified = request
    evaluated = evaluate(path, settings, [_ALGO], axles, window, identified=identified)
    log, summary, result = evaluated
    map_ = map_of_log(log, summary.stops, summary.axles)
    if group:
        map_ = map_._replace(group=group.name, label=group.label or None)
    return TestedLog(
        request,
        evaluated.findings,
        summary.vehicle,
        summary.axles,
        result.brake if result else None,
        map_,
        summary.log.sha256,
        frozenset(c.title for c in log.channels if c.meaning == "train_speed"),
    )


def protocol(test: BrakeTest, title: str, braked_weight: bool = False) -> Protocol:
    """The series as a page."""
    logs = dict.fromkeys(s.log for s in test.series.stops)
    about = {
        "Evaluated by": f"adhesion {__version__}",
        "Logs": ", ".join(Path(log).name for log in logs),
        **{f"Not evaluated: {x.path}": x.error for x in test.failed},
        "Expanded uncertainties": "coverage factor 2, about 95 %",
        **{f"SHA-256 of {Path(x.path).name}": x.sha256 for x in test.logs},
        **_stated_settings(test.logs),
    }
    group_texts = {f"{g.name}": _describe_group(g) for g in test.plan.groups}
    about |= {f"Group {name}": text for name, text in group_texts.items() if text}
    findings = [
        (Path(log).name if len(test.logs) > 1 else "", summarise_finding(finding))
        for log, finding in test.findings_by_log
    ]
    vehicle = test.vehicle_lines
    days = sorted({(s.stop.time or "")[:10] for s in test.series.stops})
    dates = {"date": " to ".join(dict.fromkeys((days[0], days[-1])))} if all(days) and days else {}
    texts = {**dates, **_stated_of_groups(test.plan.groups), **test.plan.protocol}
    return Protocol(title, texts, test.series, findings, about, braked_weight, vehicle)


def _stated_settings(logs: Sequence[TestedLog]) -> dict[str, str]:
    """What the user states of vehicle, line and evaluation, of each group where they differ."""
    of_groups = {log.group: flat(dict(log.request.settings.tables)) for log in logs}
    settings = [*of_groups.values()]
    if all(x == settings[0] for x in settings):
        of_groups = {"": settings[0]}
    return {
        name.replace(".discs", ".discs (clamping forces)") + f", group {group}" * bool(group): text
        for group, setting in of_groups.items()
        for name, text in setting.items()
    }


def _stated_of_groups(groups: Sequence[PlannedGroup]) -> dict[str, str]:
    """Fields of the protocol that the plan states group by group."""
    fields = {"brake_mode": "mode", "load": "load", "rail_condition": "rail"}
    texts = {}
    for field, name in fields.items():
        by_group = {g.name: getattr(g, name) for g in groups}
        listed = ", ".join(f"{group}: {text}" for group, text in by_group.items() if text)
        if listed:
            share_text = len({*by_group.values()}) == 1
            texts[field] = next(iter(by_group.values())) if share_text else listed
    return texts


def _describe_group(group: PlannedGroup) -> str:
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
        stops=[_unfolded(s, "stop") for s in series.stops],
        groups=[_unfolded(g, "statistics") for g in series.groups],
        differences=[_difference(x) for x in series.differences],
        limits=as_json(series.limits),
        wsp=as_json(series.wsp),
        logs=[
            {
                "path": x.path,
                "group": x.group or None,
                "vehicle": as_json(x.vehicle),
                "brake": as_json(x.brake),
            }
            for x in test.logs
        ],
        failed=as_json(test.failed),
        findings=[
            {"log": log or None, **as_json(summarise_finding(finding))}
            for log, finding in test.findings_by_log
        ],
    )


def _unfolded(x: SeriesStop | Group, name: str) -> Json:
    """The fields of a stop or a group, and after them those of its table of this name."""
    keys = as_json(x)
    inner = keys.pop(name)
    return {**keys, **inner}


def _difference(x: GroupDifference) -> Json:
    names = {"from": x.from_group, "to": x.to_group}
    return names | {k: v for k, v in as_json(x).items() if k not in ("from_group", "to_group")}
