"""A result file as a report shows it: the document it carries, and columns over time."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from ...core import annotated, physics
from ...core.errors import UserError
from ...core.model import MOTOR_FORCES, PLACES, STATES, Column, Floats, Meaning, Times
from ...core.summary import AxleSummary, BrakeApplication, ChannelSummary, ResultSummary
from ...core.text import shell_word
from ...formats.open import kind, open_source
from ...formats.source import Field, ReadOptions, Source
from ...records.route import Route, make_route
from ..carried_vehicle import parameter
from ..names import METRICS, PROVENANCE, SETTINGS
from ..train_stops import choose_axles

_TOPIC = re.compile(r"/axle/(\d+)/(input|reference|truth|slip|estimate/([\w-]+))")
_STATES: tuple[Meaning, ...] = (*STATES, *MOTOR_FORCES, "reservoir_pressure")
_STATE_TOPIC = re.compile(rf"(?:/axle/(\d+))?/({'|'.join(_STATES)})")
_CAR_AXLES = re.compile(r"car\..+\.axles")
_FAST = 3.0  # least speed at which slip shows the radius that it was computed with [m/s]
_TWO_LOGS = "name the *.adhesion.mcap of each log"


class LoggedState(NamedTuple):
    """What a switch, valve or command did, a force of motors [N], the reservoir's pressure [Pa]."""

    meaning: Meaning
    axle: int | None  # None: of the whole train
    t: Floats  # seconds after the log's start (n,)
    value: Floats  # (n,): finite
    levels: tuple[str, ...] = ()  # words of the values 0, 1 and so on, where the log has words


@dataclass(frozen=True, slots=True)
class ReportAxle:
    """One axle: its summary, and columns of shape (n,); NaN where not known."""

    summary: AxleSummary
    t: Floats  # seconds after the log's start
    train: Floats  # speed of the train [m/s]
    rim: Floats  # speed of the rim, ωR [m/s]
    pressure: Floats  # [Pa]
    clamping: Floats  # clamping force K [N]
    force: Floats  # the reference [N]
    lower: Floats  # edges of its 95 % band [N]
    upper: Floats
    slip: Floats  # [-]
    truth: Floats  # true force [N]
    errors: Mapping[str, Floats]  # of each estimator, against truth or reference [N]
    weight: float  # m g [N]

    @property
    def number(self) -> int:
        """As the log counts them."""
        return self.summary.axle

    @property
    def applications(self) -> Sequence[BrakeApplication]:
        """Brake applications, in the order of time."""
        return self.summary.applications

    @property
    def against(self) -> str:
        """What the estimators are measured against."""
        return next((s.against for s in self.summary.estimators), "reference")

    def has_values(self, column: str) -> bool:
        """Whether a column has a value anywhere."""
        return bool(np.isfinite(getattr(self, column)).any())


@dataclass(frozen=True, slots=True)
class ReportRun:
    """One result file."""

    file: str  # its name
    summary: ResultSummary
    axles: tuple[ReportAxle, ...]
    settings: Mapping[str, str]  # dotted keys with JSON values
    provenance: Mapping[str, str]
    detailed: tuple[int, ...]  # axles that are drawn one by one, and have all columns
    route: Route  # where the train was
    start_ns: int  # the start of the log on the clock of `route`
    states: Sequence[LoggedState] = ()

    @property
    def name(self) -> str:
        """Of the log it was made from."""
        return Path(self.summary.log.path).name

    @property
    def train(self) -> str:
        """What the train's speed is called: measured, or estimated from the axles."""
        is_estimated = any(f.code == "reference-speed" for f in self.summary.findings)
        return "reference speed (estimated)" if is_estimated else "train"

    @property
    def cars(self) -> dict[int, str]:
        """Name of the car of each axle, where the settings state cars."""
        axles = {k: v for k, v in self.settings.items() if _CAR_AXLES.fullmatch(k)}
        return {axle: key.split(".")[1] for key, v in axles.items() for axle in json.loads(v)}

    @property
    def brake_s(self) -> float:
        """Start of the first brake application [s]; 0 without one."""
        return min((o.start_s for a in self.axles for o in a.applications), default=0.0)


def read(path: Path, name: str = "", axles: Sequence[int] | None = None) -> ReportRun:
    """Reads a result file.

    `axles` are drawn one by one, the others have speeds, force and slip. None: as many as a page
    has room for, the worst ones. `name` is that of a file that has none yet.

    Raises:
        UserError: for a raw log, a comparison, a damaged file or one of an older version; for axles
            that it does not have.
    """
    if path.suffix.lower() == ".rrd":
        text = f"{path}: a recording for the Rerun viewer, not a result"
        raise UserError(text, f"name the result: {shell_word(str(path.with_suffix('.mcap')))}")
    if path.is_file() and path.stat().st_size and kind(path) != "mcap":
        raise _no_result(path)
    source = open_source(path, ReadOptions(strict=True))
    entry = _entry(path, source)
    settings = source.metadata.get(SETTINGS, {})
    provenance = source.metadata.get(PROVENANCE, {})
    try:
        summary = annotated.from_json(ResultSummary, {"outputs": {}, **entry})
        start = int(provenance["start_ns"]) + int(provenance.get("time_shift_ns", "0"))
        numbers = [axle.axle for axle in summary.axles]
        if missing := sorted(set(axles or ()) - set(numbers)):
            text = f"{path}: has no axle {missing[0]}"
            raise UserError(text, f"axles: {', '.join(map(str, numbers))}", code=2)
        detailed = choose_axles(summary.axles) if axles is None else tuple(axles)
        columns = _axles(source, summary.axles, start, settings, detailed)
        route = _route(source)
        states = _states(source, start, summary.channels, detailed)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        version = provenance.get("version", "an unknown version")
        text = (
            f"{path}: what it says of its analysis is not complete (made by {version}; {error!r})"
        )
        hint = f"make it again: `adhesion analyze {shell_word(str(path))} -o FOLDER`"
        raise UserError(text, hint) from error
    facts = settings, provenance, detailed, route, start, states
    return ReportRun(name or path.name, summary, columns, *facts)


def _route(source: Source) -> Route:
    fields = [f for f in source.fields if f.channel.removeprefix("/") in PLACES]
    columns = source.columns(fields)
    by_meaning = {f.channel.removeprefix("/"): c for f, c in zip(fields, columns, strict=True)}
    return make_route({meaning: by_meaning[meaning] for meaning in PLACES if meaning in by_meaning})


def _states(
    source: Source, start: int, channels: Sequence[ChannelSummary], detailed: Sequence[int]
) -> list[LoggedState]:
    levels = {(c.meaning, c.axle): c.levels for c in channels}
    fields = {}
    for field in source.fields:
        if match := _STATE_TOPIC.fullmatch(field.channel):
            axle = int(match[1]) if match[1] else None
            if axle is None or axle in detailed:
                fields[cast(Meaning, match[2]), axle] = field
    states = []
    for (meaning, axle), c in zip(fields, source.columns([*fields.values()]), strict=True):
        t, is_used_row = (c.t - start) * np.float64(1e-9), np.isfinite(c.value)
        level_words = levels.get((meaning, axle), ())
        states.append(LoggedState(meaning, axle, t[is_used_row], c.value[is_used_row], level_words))
    return states


def _entry(path: Path, source: Source) -> annotated.Json:
    """The entry of the log in the document that a result carries; refuses none or several."""
    if any(name.startswith(f"{SETTINGS}/") for name in source.metadata):
        raise UserError(f"{path}: a comparison of several logs, not one result", _TWO_LOGS)
    carried = source.metadata.get(METRICS, {}).get("json", "{}")
    try:
        loaded = json.loads(carried)
    except ValueError:
        loaded = {}
    if not isinstance(loaded, dict) or loaded.get("schema") != "adhesion.result/1":
        raise _no_result(path)
    if len(entries := loaded.get("results", [])) != 1:
        raise UserError(f"{path}: not the result of one log", _TWO_LOGS)
    entry: annotated.Json = entries[0]
    return entry


def _no_result(path: Path) -> UserError:
    command = f"`adhesion analyze {shell_word(str(path))}`"
    hint = f"{command} makes a *.adhesion.mcap of it, and with --report this page"
    return UserError(f"{path}: a log, not a result", hint)


def _axles(
    source: Source,
    summaries: Sequence[AxleSummary],
    start: int,
    settings: Mapping[str, str],
    detailed: Sequence[int],
) -> tuple[ReportAxle, ...]:
    by_number = {}
    for axle in summaries:  # as before JSON, which states the axle once
        braked = tuple(replace(x, axle=axle.axle) for x in axle.applications)
        by_number[axle.axle] = axle._replace(applications=braked)
    wanted: dict[tuple[int, str, str], Field] = {}
    for field in source.fields:
        match = _TOPIC.fullmatch(field.channel)
        if match and int(match[1]) in by_number:
            key = match[2], field.path
            is_detailed = int(match[1]) in detailed
            is_wanted = key in _WANTED or bool(match[3] and field.path == "force")
            if is_wanted if is_detailed else key in _OVERVIEW:
                wanted[int(match[1]), *key] = field
    columns = dict(zip(wanted, source.columns([*wanted.values()]), strict=True))
    axles = []
    for number, summary in by_number.items():
        of_axle = {key[1:]: columns.pop(key) for key in list(columns) if key[0] == number}
        axles.append(_axle(summary, of_axle, start, settings))
    return tuple(axles)


_COLUMNS = {  # topic and field of each column
    "train": ("input", "train_speed"),
    "pressure": ("input", "brake_cylinder_pressure"),
    "clamping": ("input", "clamping_force"),
    "force": ("reference", "force"),
    "lower": ("reference", "lower"),
    "upper": ("reference", "upper"),
    "slip": ("slip", "slip"),
    "truth": ("truth", "force"),
}
_WANTED = {("input", "wheel_speed"), *_COLUMNS.values()}  # and the force of each estimate
_OVERVIEW = {  # of every axle
    ("input", "wheel_speed"),
    ("input", "train_speed"),
    ("reference", "force"),
    ("slip", "slip"),
}


def _axle(
    summary: AxleSummary,
    columns: Mapping[tuple[str, str], Column],
    start: int,
    settings: Mapping[str, str],
) -> ReportAxle:
    wheel = columns["input", "wheel_speed"]
    t = wheel.t

    def column(topic: str, field: str) -> Floats:
        logged = columns.get((topic, field))
        return np.full(len(t), np.nan) if logged is None else _interpolate(t, logged)

    series = {name: column(*place) for name, place in _COLUMNS.items()}
    target = {"truth": series["truth"], "reference": series["force"]}
    scores = sorted(summary.estimators, key=lambda s: s.algo)
    errors = {s.algo: column(f"estimate/{s.algo}", "force") - target[s.against] for s in scores}
    radius, mass = (
        parameter(settings, name, summary.axle).value for name in ("wheel_radius", "axle_mass")
    )
    rim = wheel.value * _rolling_radius(wheel.value, series["train"], series["slip"], radius)
    weight = physics.G * mass
    seconds = (t - start) * np.float64(1e-9)
    return ReportAxle(summary, t=seconds, rim=rim, errors=errors, weight=weight, **series)


def _interpolate(t: Times, column: Column) -> Floats:
    """A column at other times: its own values where it has them, else the line between them."""
    if np.array_equal(t, column.t):
        return column.value
    if not len(column.t) or (np.diff(column.t) < 0).any() or (np.diff(t) < 0).any():
        return np.full(len(t), np.nan)
    return np.interp(t, column.t, column.value, np.nan, np.nan)


def _rolling_radius(wheel: Floats, train: Floats, slip: Floats, nominal: float) -> float:
    """The radius that the slip was computed with, by (2), else the stated one [m]."""
    rolling = np.isfinite(slip) & (train > _FAST) & (wheel > 1.0) & (slip < 0.5)
    radius = train[rolling] * (1.0 - slip[rolling]) / wheel[rolling]
    return float(np.median(radius)) if len(radius) else nominal
