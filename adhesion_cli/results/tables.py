"""Summaries of logs as tables: brake applications, stops, estimators, findings and logs.

The columns are the fields of the classes in `core.summary`, as in the JSON. Nested names are joined
with `_`, as `force_n` and `mean` to `force_n_mean`. Lists are left out. What a log does not show is
null.
"""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import pyarrow as pa
from pyarrow import parquet

from ..core import errors, finding, summary
from ..core.annotated import columns, flat
from ..core.model import Log, Quantity, Score
from ..core.summary import AxleSummary, FailedLog, LogSummary, ResultSummary
from ..core.text import printable, utf8
from ..reference.calibrated_vehicle import CalibratedParameter
from ..stops import series
from . import names
from .workbook import Sheet, write_workbook

_TYPES = {
    str: pa.string(),
    int: pa.int64(),
    float: pa.float64(),
    bool: pa.bool_(),
    datetime: pa.timestamp("us", "UTC"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LogRow:
    """A log of a run over many: whether it was analysed, and how.

    `status` is `ok`, `damaged` (a finding is an error) or `error`. `lossy` says that data was lost
    or repaired, or may be wrong. `tables_sha256` is of the files that hold its other tables.
    """

    log: str
    sha256: str | None = None
    status: str
    lossy: bool = False
    error: str | None = None
    hint: str | None = None
    format: str | None = None
    start: datetime | None = None
    duration_s: Annotated[float | None, Quantity("s", "from the first to the last sample")] = None
    rows_read: int | None = None
    rows_used: int | None = None
    seconds: Annotated[float | None, Quantity("s", "that the analysis took")] = None
    version: str | None = None
    settings: str | None = None
    tables_sha256: str | None = None


def _field(name: str, kind: Any, unit: str = "") -> Any:
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


def _schema(cls: type, **keys: type) -> Any:
    """The columns of a class, after those that say whose row it is."""
    heads = [_field(name, _TYPES[kind]) for name, kind in keys.items()]
    return pa.schema([*heads, *(_field(c.name, _TYPES[c.type], c.unit) for c in columns(cls))])


APPLICATIONS = _schema(summary.BrakeApplication, log=str, sha256=str, axle=int)
ESTIMATORS = _schema(Score, log=str, sha256=str, axle=int)
FINDINGS = _schema(summary.FindingSummary, log=str, sha256=str)
LOGS = _schema(LogRow)
STOPS = _schema(summary.StopSummary, log=str, sha256=str)
SERIES = _schema(summary.StopSummary, log=str, group=str, label=str, vehicle_in_doubt=bool)
SLIDES = _schema(summary.SlideSummary, log=str, axle=int)
RAILS = _schema(summary.SlipSummary)
CHANNELS = _schema(summary.InspectedChannel)
PARAMETERS = _schema(CalibratedParameter, parameter=str)


_Rows = Iterator[tuple[dict[str, int], Any]]


def _of_axles(r: ResultSummary, name: str) -> _Rows:
    """The brake applications, or scores, of the axles of a log, each after the axle's number."""
    return (({"axle": a.axle}, x) for a in r.axles for x in getattr(a, name))


# The tables of results, by name: the schema, and the rows of a log with their further keys.
_OF_RESULTS: dict[str, tuple[Any, Callable[[ResultSummary], _Rows]]] = {
    "applications": (APPLICATIONS, lambda r: _of_axles(r, "applications")),
    "stops": (STOPS, lambda r: (({}, x) for x in r.stops)),
    "slides": (
        SLIDES,
        lambda r: ((k, x) for k, a in _of_axles(r, "applications") for x in a.slide_list),
    ),
    "estimators": (ESTIMATORS, lambda r: _of_axles(r, "estimators")),
    "findings": (FINDINGS, lambda r: (({}, x) for x in r.findings)),
}


def of_results(name: str, results: Iterable[ResultSummary]) -> Any:
    """A `pyarrow.Table` of results: applications, stops, slides, estimators or findings."""
    schema, rows = _OF_RESULTS[name]
    return keyed(((keys_of_log(r.log) | keys, x) for r in results for keys, x in rows(r)), schema)


def sheets_of_series(
    x: series.StopSeries, logs: Iterable[tuple[str, Iterable[AxleSummary]]] = ()
) -> Any:
    """The tables of a series by name, those with rows; `logs` are paths and axles with slides."""
    stops = [
        (
            {
                "log": utf8(s.log),
                "group": s.group,
                "label": s.label,
                "vehicle_in_doubt": s.vehicle_in_doubt,
            },
            s.stop,
        )
        for s in x.stops
    ]
    groups = [
        ({"group": g.name, "quantity": k}, y) for g in x.groups for k, y in g.statistics.items()
    ]
    slides = [
        ({"log": utf8(path), "axle": a.axle}, slide)
        for path, axles in logs
        for a in axles
        for application in a.applications
        for slide in application.slide_list
    ]
    sheets: dict[str, tuple[Any, Sequence[tuple[Mapping[str, object], object]]]] = {
        "stops": (SERIES, stops),
        "groups": (_schema(series.Statistic, group=str, quantity=str), groups),
        "differences": (_schema(series.GroupDifference), [({}, y) for y in x.differences]),
        "limits": (_schema(series.LimitVerdict), [({}, y) for y in x.limits]),
        "wsp": (_schema(series.WspSummary), [({}, y) for y in x.wsp]),
        "wsp axles": (
            _schema(summary.AxleStop, group=str),
            [({"group": wsp.group}, axle) for wsp in x.wsp for axle in wsp.axles],
        ),
        "slides": (SLIDES, slides),
    }
    return {
        name: keyed(rows, schema)
        for name, (schema, rows) in sheets.items()
        if rows or name == "stops"
    }


def keyed(rows: Iterable[tuple[Mapping[str, object], object]], schema: Any) -> Any:
    """A row per object, each after the cells that say whose it is."""
    return pa.Table.from_pylist([{**keys, **flat(x)} for keys, x in rows], schema=schema)


def table(rows: Iterable[object], schema: Any) -> Any:
    """A row per object, as a slip summary, a channel or a log; `schema` is that of their class."""
    return keyed((({}, x) for x in rows), schema)


def keys_of_log(log: Log | LogSummary) -> dict[str, object]:
    """The cells that say of which log a row is."""
    return {"log": utf8(log.path), "sha256": log.sha256}


def columns_table(arrays: Mapping[str, tuple[Any, str]]) -> Any:
    """Arrays of one length (n,), each with its unit, as a table: a field each."""
    fields = [_field(name, pa.array(x[:0]).type, unit) for name, (x, unit) in arrays.items()]
    return pa.table([pa.array(x) for x, _ in arrays.values()], schema=pa.schema(fields))


def log_row(result: ResultSummary | FailedLog) -> LogRow:
    """The row of a log, or of one that has no result; without what is known of the run."""
    if isinstance(result, FailedLog):
        path, error, hint = utf8(result.path), utf8(result.error), utf8(result.hint)
        return LogRow(log=path, sha256=result.sha256, status="error", error=error, hint=hint)
    log, codes = result.log, {(f.code, f.severity) for f in result.findings}
    return LogRow(
        log=utf8(log.path),
        sha256=log.sha256,
        status="damaged" if any(severity == "error" for _, severity in codes) else "ok",
        lossy=any(finding.is_lossy(*pair) for pair in codes),
        format=log.format,
        start=datetime.fromisoformat(log.start) if log.start else None,
        duration_s=log.duration_s,
        rows_read=log.rows_read,
        rows_used=log.rows_used,
    )


def kind(path: Path) -> str:
    """The format that a table's name states, its suffix; a UserError for another one."""
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet", ".xlsx"):
        text, hint = f"{path}: a table is CSV, Parquet or Excel", f"--table {path.stem}.xlsx"
        raise errors.UserError(text, hint, code=2)
    return suffix


def write(path: Path, suffix: str, sheets: Mapping[str, pa.Table]) -> None:
    """Write tables in the format of a suffix, see `kind`: a workbook has all, others the first."""
    first_table = next(iter(sheets.values()))
    if suffix == ".xlsx":
        tables = {name: Sheet(x.schema, len(x), x.to_batches()) for name, x in sheets.items()}
        write_workbook(path, tables)
    elif suffix == ".csv":
        _write_csv(path, first_table)
    else:
        path.write_bytes(packed(first_table))


def _write_csv(path: Path, table: Any) -> None:
    """A table as other programs read it; a cell without a value is empty."""

    def cell_text(value: Any) -> str:
        if isinstance(value, str):
            return names.cell(printable(value))
        return "" if value is None else str(value)

    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(table.column_names)
        rows.writerows([cell_text(x) for x in row.values()] for row in table.to_pylist())


def packed(table: Any) -> bytes:
    """A table as the bytes of a Parquet file."""
    sink = io.BytesIO()
    parquet.write_table(table, sink, compression="zstd", write_page_checksum=True)
    return sink.getvalue()
