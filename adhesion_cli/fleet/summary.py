"""What the results of a fleet show together: the document `adhesion.fleet-summary/1`."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from pyarrow import dataset

from ..core.annotated import Json, as_json
from ..core.document import tagged
from ..core.errors import UserError
from ..core.finding import Finding, is_lossy
from ..core.model import Floats
from ..core.text import printable
from ..results.carried_vehicle import parameter_title
from ..results.tables import LogRow
from .dataset import SETTINGS, TABLES, is_whole, read_logs

BANDS = (0.0, 40.0, 80.0, 120.0, 160.0, 200.0)  # edges of the speed bands [km/h]
_SHARES = (5.0, 50.0, 95.0)  # percentiles
_SUSPECT = "-unit-suspect"  # end of the codes of units that are probably wrong
_LISTED = 10  # slides and logs that are listed
_FILE = "__filename"
_OF_STOP = (
    "nominal_speed_kmh valid distance_m_value mean_deceleration_value response_time_s_value"
).split()


class Distribution(NamedTuple):
    """The mean adhesion coefficient of a group of brake applications."""

    group: Mapping[str, Any]  # what they have in common, by its name in the document
    applications: int  # of an axle
    with_slides: int
    p5: float | None  # 5 % are below it [-]
    median: float | None
    p95: float | None
    median_with_slides: float | None
    u95: float | None  # median expanded uncertainty of one application's mean (95 %) [-]


@dataclass(frozen=True, slots=True, kw_only=True)
class StopGroup:
    """Stops of the whole train from one nominal speed."""

    nominal_speed_kmh: float
    stops: int
    valid: int
    distance_median_m: float | None  # of the valid ones
    deceleration_p5: float | None  # of the mean deceleration: 5 % are below it [m/s²]
    deceleration_median: float | None
    deceleration_p95: float | None
    response_median_s: float | None


@dataclass(frozen=True, slots=True)
class SlidApplication:
    """A brake application that slid far; names as in the table of applications."""

    log: str
    axle: int
    slide_start_s: float | None
    from_mps: float | None
    to_mps: float | None
    coefficient_mean: float | None
    slides: int
    slide_s: float
    slide_distance_m: float
    max_slip: float
    slide_energy_j: float | None
    slide_energy_u95_j: float | None
    at_least: bool
    slide_position_km: float | None  # where `position_from` is "position", of the line
    position_from: str | None


_OF_SLID = tuple(f.name for f in fields(SlidApplication))


class CodeCount(NamedTuple):
    """How many logs have a finding."""

    code: str
    severity: str
    logs: int
    example: str


class DoubtfulLog(NamedTuple):
    """A log whose numbers are doubtful, and why."""

    log: str
    severity: str
    code: str
    message: str


class Evaluation(NamedTuple):
    """How the results were made."""

    versions: list[str]  # of the program
    days: list[str]  # first and last one on which results were written (UTC)


@dataclass(frozen=True, slots=True)
class FleetSummary:
    """What the results of a fleet show together."""

    logs: dict[str, int]  # how many, by status
    applications: int
    with_slides: int
    by_speed: list[Distribution]  # bands, from_kmh to to_kmh; None: no upper end
    by_settings: list[Distribution]  # settings: their hash, stated: of the vehicle, in a line
    by_day: list[Distribution]  # day (UTC) on which the log began
    by_km: list[Distribution]  # km, to the next one, where logs have positions on the line
    by_km_and_hour: list[Distribution]  # day and hour (UTC); "unknown", None: no calendar
    stops: list[StopGroup]
    worst_slides: list[SlidApplication]
    findings: list[CodeCount]
    in_doubt: int  # logs with a warning on the data, and no error
    to_check: list[DoubtfulLog]
    evaluated: Evaluation
    failed: list[dict[str, str]]  # log, error, hint
    damaged: list[str]
    lost: list[str]  # logs whose results are damaged or missing; a file where no log is known

    @property
    def loss(self) -> list[Finding]:
        """The finding on results that are damaged or missing, if any are."""
        values = {"results": float(len(self.lost))}
        finding = Finding("fleet-results-damaged", "error", count=len(self.lost), values=values)
        return [finding] if self.lost else []

    @property
    def document(self) -> Json:
        """The document `adhesion.fleet-summary/1`."""
        document = as_json(self)
        for name in (name for name in document if name.startswith("by_")):
            document[name] = [row.pop("group") | row for row in document[name]]
        return tagged("fleet-summary", **document)


_Row = tuple[Path, LogRow]  # of the table of logs, after its file


def summarise_fleet(folder: Path) -> FleetSummary:
    """The summary of a folder of results; a UserError where it holds none that can be read.

    Of a log with several results by the same settings, the newest version of the program counts,
    and of that the newest file. The speed of a brake application is the mean of its start and end.
    """
    files = {t: sorted((folder / t).glob("*.parquet")) for t in TABLES}
    if not files["logs"] or not all((folder / name).is_dir() for name in TABLES):
        text = f"{printable(str(folder))}: holds no results of a fleet"
        raise UserError(text, "name the folder that `adhesion fleet -o` wrote")
    try:
        rows, damaged = read_logs(files["logs"])
        rows, damaged_logs = _whole(rows)
        damaged_logs += map(str, damaged)
        named = {path.name for path in files["logs"]}
        damaged_logs += sorted(str(x) for x in files[TABLES[0]] if x.name not in named)
        newest = _newest(rows)
        logs = [row for _, row in newest]
        analysed = [(file, row) for file, row in newest if row.status != "error"]
        names = sorted({file.name for file, _ in analysed})
        columns = (*_OF_SLID, "coefficient_mean_u95", "position_km", "time", "settings", _FILE)
        applications = _read(folder / "applications", names, columns)
        findings = _read(folder / "findings", names, DoubtfulLog._fields)
        stops = _read(folder / "stops", names, _OF_STOP)
    except (OSError, pa.ArrowException) as error:
        text = f"{printable(str(folder))}: cannot be read as results of a fleet ({error})"
        raise UserError(text, "run `adhesion fleet` on the logs again, with --force") from error
    days = {file.name: row.start.date().isoformat() for file, row in analysed if row.start}
    row_days = [days.get(Path(x).name, "unknown") for x in applications[_FILE].to_pylist()]
    settings = applications["settings"].to_pylist()
    stated = {name: _stated_vehicle(folder, name) for name in set(settings)}
    places, kinds = _places(applications), {x[1:] for x in _lossy_findings(findings)}
    times = [file.stat().st_mtime for file, _ in analysed]
    written = [datetime.fromtimestamp(f(times), UTC).date() for f in (min, max) if times]
    versions = sorted({str(row.version) for _, row in analysed})
    return FleetSummary(
        logs={s: sum(r.status == s for r in logs) for s in ("ok", "damaged", "error")},
        applications=len(applications),
        with_slides=int((_column(applications, "slides") > 0).sum()),
        by_speed=_grouped(applications, "from_kmh to_kmh", _bands(applications)),
        by_settings=_grouped(applications, "settings stated", ((x, stated[x]) for x in settings)),
        by_day=_grouped(applications, "day", ((day,) for day in row_days)),
        by_km=_grouped(applications, "km", (x[:1] for x in places)),
        by_km_and_hour=_grouped(applications, "km day hour", places),
        stops=_stops(stops),
        worst_slides=_worst(applications),
        findings=_codes(findings),
        in_doubt=sum(kind == "warning" and ("error", log) not in kinds for kind, log in kinds),
        to_check=_to_check(findings),
        evaluated=Evaluation(versions, [day.isoformat() for day in written]),
        failed=[{"log": r.log, "error": r.error, "hint": r.hint or ""} for r in logs if r.error],
        damaged=sorted({row.log for row in logs if row.status == "damaged"}),
        lost=damaged_logs,
    )


def _whole(rows: Sequence[_Row]) -> tuple[list[_Row], list[str]]:
    """The rows of logs whose tables are whole, and the names of the other logs."""
    whole_rows, other_rows = list[_Row](), list[_Row]()
    for file, row in rows:
        is_good = row.status == "error" or is_whole(file, row.tables_sha256)
        (whole_rows if is_good else other_rows).append((file, row))
    made_anew = {(row.log, row.settings) for _, row in whole_rows}
    damaged_logs = {row.log for _, row in other_rows if (row.log, row.settings) not in made_anew}
    return whole_rows, sorted(damaged_logs)


def _read(folder: Path, names: Sequence[str], columns: Sequence[str]) -> Any:
    if not names:  # every log failed
        return pa.table({name: pa.array([], pa.null()) for name in columns})
    files = [str(folder / name) for name in names]
    return dataset.dataset(files, format="parquet").to_table(columns=list(columns))


def _newest(rows: Sequence[_Row]) -> list[_Row]:
    """The row that counts of each log and settings, in the order of the logs."""

    def age(x: _Row) -> tuple[list[int], int]:
        numbers = re.findall(r"\d+", x[1].version or "")
        return [int(number) for number in numbers], x[0].stat().st_mtime_ns

    newest = {(row.log, row.settings): (file, row) for file, row in sorted(rows, key=age)}
    return sorted(newest.values(), key=lambda x: x[1].log)


def _column(table: Any, name: str) -> Floats:
    column: Floats = table[name].cast(pa.float64()).to_numpy()
    return column


def _grouped(table: Any, names: str, keys: Iterable[tuple[Any, ...]]) -> list[Distribution]:
    """The distribution of each key, in the order of the keys; rows without one are left out."""
    rows: dict[tuple[Any, ...], list[int]] = {}
    for i, key in enumerate(keys):
        if key:
            rows.setdefault(key, []).append(i)
    all_mu, all_slides = _column(table, "coefficient_mean"), _column(table, "slides")
    all_u95 = _column(table, "coefficient_mean_u95")
    groups = []
    for key in sorted(rows):
        mu, slides = all_mu[rows[key]], all_slides[rows[key]]
        sliding = _percentiles(mu[slides > 0])[1]
        counts = len(mu), int((slides > 0).sum())
        group = dict(zip(names.split(), key, strict=True))
        u95 = _percentiles(all_u95[rows[key]])[1]
        groups.append(Distribution(group, *counts, *_percentiles(mu), sliding, u95))
    return groups


def _stops(table: Any) -> list[StopGroup]:
    speeds = _column(table, "nominal_speed_kmh")
    valid = _column(table, "valid") > 0.0
    groups = []
    for speed in np.unique(speeds[np.isfinite(speeds)]).tolist():
        rows = (speeds == speed) & valid
        p5, median, p95 = _percentiles(_column(table, "mean_deceleration_value")[rows])
        group = StopGroup(
            nominal_speed_kmh=speed,
            stops=int((speeds == speed).sum()),
            valid=int(rows.sum()),
            distance_median_m=_percentiles(_column(table, "distance_m_value")[rows])[1],
            deceleration_p5=p5,
            deceleration_median=median,
            deceleration_p95=p95,
            response_median_s=_percentiles(_column(table, "response_time_s_value")[rows])[1],
        )
        groups.append(group)
    return groups


def _percentiles(values: Floats) -> tuple[float | None, float | None, float | None]:
    """5 %, median and 95 % of the values that are known."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None, None, None
    lower, middle, upper = np.percentile(finite, _SHARES).tolist()
    return lower, middle, upper


def _bands(table: Any) -> Iterator[tuple[float, float | None] | tuple[()]]:
    """The band of each mean speed [km/h]."""
    speeds = 3.6 * 0.5 * (_column(table, "from_mps") + _column(table, "to_mps"))
    for place in np.searchsorted(BANDS, speeds, side="right").tolist():
        yield () if not place else (BANDS[place - 1], BANDS[place] if place < len(BANDS) else None)


def _places(table: Any) -> list[tuple[Any, ...]]:
    """Kilometre of its first slide or start, day and hour of each application with a position."""
    names = "position_from", "position_km", "slide_position_km", "time"
    places: list[tuple[Any, ...]] = []
    for source, start_km, slide_km, time in zip(
        *(table[n].to_pylist() for n in names), strict=True
    ):
        km = start_km if slide_km is None else slide_km
        clock = (time[:10], int(time[11:13])) if time else ("unknown", None)
        places.append((math.floor(km), *clock) if source == "position" and km is not None else ())
    return places


def _worst(table: Any) -> list[SlidApplication]:
    """The applications that slid furthest: distance times the largest slip, an upper limit."""
    length = _column(table, "slide_distance_m") * _column(table, "max_slip")
    slid = np.flatnonzero(np.isfinite(length) & (length > 0.0))
    longest = slid[np.argsort(-length[slid], kind="stable")][:_LISTED]
    return [SlidApplication(**row) for row in table.take(longest).select(_OF_SLID).to_pylist()]


def _lossy_findings(table: Any) -> Iterator[tuple[str, str, str]]:
    """Code, severity and log of each warning and error on the data."""
    names = ("code", "severity", "log")
    for code, severity, log in zip(*(table[name].to_pylist() for name in names), strict=True):
        if is_lossy(code, severity):
            yield code, severity, log


def _codes(table: Any) -> list[CodeCount]:
    """Warnings and errors on the data, by how many logs have them."""
    logs_by_code: dict[tuple[str, str], set[str]] = {}
    for code, severity, log in _lossy_findings(table):
        logs_by_code.setdefault((code, severity), set()).add(log)
    counts = [
        CodeCount(code, severity, len(logs), min(logs))
        for (code, severity), logs in logs_by_code.items()
    ]
    return sorted(counts, key=lambda x: (x.severity, -x.logs, x.code))


def _to_check(table: Any) -> list[DoubtfulLog]:
    """Errors and suspect units, which make the numbers of a log doubtful: one row for each."""
    rows = [
        DoubtfulLog(*(str(x or "") for x in values.values()))
        for values in table.select(DoubtfulLog._fields).to_pylist()
    ]
    doubtful = [r for r in rows if r.severity == "error" or r.code.endswith(_SUSPECT)]
    by_code = {(row.log, row.code): row for row in reversed(doubtful)}  # the first of a code
    return [by_code[key] for key in sorted(by_code)]


def _stated_vehicle(folder: Path, settings: str) -> str:
    """What the settings of a hash state of the vehicle, in a line."""
    try:
        stated = json.loads((folder / SETTINGS / f"{settings}.json").read_text("utf-8"))["stated"]
        tables = {"": stated.get("vehicle", {}), **stated.get("car", {})}
        entries = [(f"{car} {key}".strip(), x) for car, t in tables.items() for key, x in t.items()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return "unknown"
    values = []
    for name, entry in entries:
        value = entry.get("value") if isinstance(entry, dict) else entry
        if isinstance(value, int | float):
            values.append(f"{parameter_title(name)} {value:g}")
    return ", ".join(values) or "not stated"
