"""Result documents as tables: brake applications, estimators, findings and logs.

The columns are the keys of a log's entry in the `adhesion.result/1` document. Nested keys are
joined with `_`, as `force_n` and `mean` to `force_n_mean`. Lists are left out, except the limits of
`utilisation_ci`. What a log does not show is null.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from ..core.errors import UserError
from ..core.finding import is_lossy
from ..core.text import printable, utf8
from . import names
from .verified import verified

_TEXT, _INTEGER, _NUMBER, _TRUTH = pa.string(), pa.int64(), pa.float64(), pa.bool_()


def _field(name: str, kind: Any, unit: str = "") -> Any:
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


def _numbers(**units: str) -> list[Any]:
    return [_field(name, _NUMBER, unit) for name, unit in units.items()]


def _measured(name: str, unit: str) -> list[Any]:
    return _numbers(**{f"{name}_{key}": unit for key in ("mean", "mean_u95", "max", "max_u95")})


_OF_LOG = [_field("log", _TEXT), _field("sha256", _TEXT)]
_OF_AXLE = [*_OF_LOG, _field("axle", _INTEGER)]
APPLICATIONS = pa.schema([
    *_OF_AXLE,
    *_numbers(start_s="s", end_s="s", from_mps="m/s", to_mps="m/s"),
    *_measured("force_n", "N"),
    *_measured("coefficient", "-"),
    _field("slides", _INTEGER),
    *_numbers(slide_s="s", slide_distance_m="m", max_slip="-", slide_energy_j="J"),
    _field("at_least", _TRUTH),
    *_numbers(utilisation="-", utilisation_ci_low="-", utilisation_ci_high="-"),
    *_numbers(coverage_u_n="N", coverage_k="-", coverage_degrees_of_freedom="-"),
    *_numbers(slip_unknown_s="s"),
])  # fmt: skip
ESTIMATORS = pa.schema([
    *_OF_AXLE,
    _field("algo", _TEXT), _field("against", _TEXT),
    *_numbers(
        rmse_n="N", bias_n="N", max_error_n="N", lag_s="s", gain="-", response_s="s",
        ripple_n="N", relative="-", band_n="N", within="-", nis_mean="-", nis_low="-",
        nis_high="-",
    ),
    _field("alike", _TRUTH),
])  # fmt: skip
FINDINGS = pa.schema([
    *_OF_LOG,
    _field("code", _TEXT), _field("severity", _TEXT), _field("channel", _TEXT),
    _field("count", _INTEGER), *_numbers(first_s="s"), _field("message", _TEXT),
    _field("hint", _TEXT),
])  # fmt: skip
LOGS = pa.schema([
    *_OF_LOG,
    _field("status", _TEXT), _field("lossy", _TRUTH), _field("error", _TEXT),
    _field("hint", _TEXT),
    _field("format", _TEXT), _field("start", pa.timestamp("us", "UTC")), *_numbers(duration_s="s"),
    _field("rows_read", _INTEGER), _field("rows_used", _INTEGER), *_numbers(seconds="s"),
    _field("version", _TEXT), _field("settings", _TEXT),
])  # fmt: skip


SLIDES = pa.schema([
    _field("log", _TEXT), _field("axle", _INTEGER),
    *_numbers(start_s="s", duration_s="s", distance_m="m", max_slip="-", energy_j="J"),
    _field("at_least", _TRUTH),
])  # fmt: skip
RAILS = pa.schema([
    _field("log", _TEXT), _field("axle", _INTEGER),
    *_numbers(
        peak_slip="-", peak_slip_below="-", peak_mu="-", peak_speed_mps="m/s", utilisation="-",
        slip_rmse="-", train_speed_late_s="s", train_speed_late_sigma_s="s",
    ),
])  # fmt: skip
CHANNELS = pa.schema([
    *(_field(name, _TEXT) for name in ("name", "field", "meaning")), _field("axle", _INTEGER),
    _field("unit", _TEXT), _field("reason", _TEXT), *_numbers(rate_hz="Hz"),
    *(_field(name, _INTEGER) for name in ("rows", "valid", "gaps", "duplicates", "backward")),
])  # fmt: skip
PARAMETERS = pa.schema([
    _field("parameter", _TEXT), _field("unit", _TEXT), _field("source", _TEXT),
    *(_field(name, _NUMBER) for name in ("prior", "prior_u", "posterior", "posterior_u")),
])  # fmt: skip


def applications(entries: Iterable[Mapping[str, Any]]) -> Any:
    """A row per log, axle and brake application.

    Args:
        entries: of the logs, from `json_documents.entry`; those of failed logs have no rows.

    Returns:
        A `pyarrow.Table` with the schema `APPLICATIONS`.
    """
    rows = (
        {**_log(entry), "axle": axle["axle"], **_flat(application)}
        for entry in entries
        for axle in entry.get("axles", ())
        for application in axle["applications"]
    )
    return _table(rows, APPLICATIONS)


def estimators(entries: Iterable[Mapping[str, Any]]) -> Any:
    """A row per log, axle and estimator's score, as `applications`; the schema is `ESTIMATORS`."""
    rows = (
        {**_log(entry), "axle": axle["axle"], **dict(_joined(score, ""))}
        for entry in entries
        for axle in entry.get("axles", ())
        for score in axle["estimators"]
    )
    return _table(rows, ESTIMATORS)


def findings(entries: Iterable[Mapping[str, Any]]) -> Any:
    """A row per finding of a log, as `applications`; the schema is `FINDINGS`."""
    rows = (
        {**_log(entry), **finding} for entry in entries for finding in entry.get("findings", ())
    )
    return _table(rows, FINDINGS)


def slides(document: Mapping[str, Any]) -> Any:
    """A row per axle and slide of the `adhesion.slip/1` document; the schema is `SLIDES`."""
    rows = (
        {"log": axle["log"], "axle": axle["axle"], **slide}
        for axle in document["axles"]
        for slide in axle["slides"]
    )
    return _table(rows, SLIDES)


def rails(document: Mapping[str, Any]) -> Any:
    """A row per axle of the `adhesion.slip/1` document; the schema is `RAILS`."""
    return _table(document["axles"], RAILS)


def channels(document: Mapping[str, Any]) -> Any:
    """A row per channel of a log's entry of `adhesion.inspect/1`; the schema is `CHANNELS`."""
    return _table(document["channels"], CHANNELS)


def parameters(document: Mapping[str, Any]) -> Any:
    """A row per parameter of the `adhesion.calibrate/1` document; the schema is `PARAMETERS`."""
    rows = ({"parameter": name, **row} for name, row in document["parameters"].items())
    return _table(rows, PARAMETERS)


def series(columns: Mapping[str, tuple[Any, str]]) -> Any:
    """Arrays of one length as a table, a field each.

    Args:
        columns: by name, the array of shape (n,) and its unit.
    """
    fields = [_field(name, pa.array(x[:0]).type, unit) for name, (x, unit) in columns.items()]
    return pa.table([pa.array(x) for x, _ in columns.values()], schema=pa.schema(fields))


def log_row(entry: Mapping[str, Any], **run: str | float | None) -> dict[str, Any]:
    """The row of a log; its status is `ok`, `damaged` (a finding is an error) or `error`.

    It is `lossy` if a finding says that data was lost or repaired, or may be wrong.

    Args:
        entry: of the log; `error` and `hint` stand in place of results if it failed.
        run: `seconds` of the analysis, `version` of the program, hash of the `settings`.
    """
    log, codes = entry["log"], {(f["code"], f["severity"]) for f in entry.get("findings", ())}
    damaged = any(severity == "error" for _, severity in codes)
    row = {**log, **_log(entry), "status": "damaged" if damaged else "ok", **run}
    row["lossy"] = any(is_lossy(*pair) for pair in codes)
    if start := log.get("start"):
        row["start"] = datetime.fromisoformat(start)
    if entry.get("error") is not None:
        row |= {"status": "error", "error": utf8(entry["error"]), "hint": utf8(entry["hint"])}
    return row


def logs(rows: Iterable[Mapping[str, Any]]) -> Any:
    """The table of rows from `log_row`; its schema is `LOGS`."""
    return _table(rows, LOGS)


def write(path: Path, table: Any) -> None:
    """Write a table as Parquet; equal tables give equal bytes.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    with verified(path) as file:
        file.write(packed(table))


def kind(path: Path, decimal: str | None) -> str:
    """The format that a table's name states: its suffix.

    Raises:
        UserError: for another suffix, and a decimal mark that it cannot have.
    """
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise UserError(
            f"{path}: a table is CSV or Parquet", "--table FILE.csv or FILE.parquet", code=2
        )
    if decimal not in (None, ".", ","):
        raise UserError(f"--decimal {decimal}: not a decimal mark", '"." or ","', code=2)
    if decimal and suffix != ".csv":
        raise UserError("--decimal is for CSV", "--table FILE.csv", code=2)
    return suffix


def write_csv(path: Path, table: Any, decimal: str = ".") -> None:
    """Write a table as CSV for a spreadsheet; a cell without a value is empty.

    Args:
        path: file to write; its old content is lost.
        table: a `pyarrow.Table`.
        decimal: the mark of decimals; with a comma, semicolons part the cells.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """

    def cell_text(value: Any) -> str:
        if isinstance(value, str):
            return names.cell(printable(value))
        return "" if value is None else str(value).replace(".", decimal)

    with verified(path) as file, io.TextIOWrapper(file, "utf-8", newline="") as text_file:
        rows = csv.writer(text_file, delimiter=";" if decimal == "," else ",", lineterminator="\n")
        rows.writerow(table.column_names)
        rows.writerows([cell_text(x) for x in row.values()] for row in table.to_pylist())


def packed(table: Any) -> bytes:
    """A table as the bytes of a Parquet file."""
    sink = io.BytesIO()
    parquet.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def _table(rows: Iterable[Mapping[str, Any]], schema: Any) -> Any:
    cells = [{name: row.get(name) for name in schema.names} for row in rows]
    return pa.Table.from_pylist(cells, schema=schema)


def _log(entry: Mapping[str, Any]) -> dict[str, Any]:
    log = entry["log"]
    return {"log": utf8(log["path"]), "sha256": log.get("sha256")}


def _flat(document: Mapping[str, Any]) -> dict[str, Any]:
    """One application with joined keys; without lists."""
    lower, upper = document["utilisation_ci"] or (None, None)
    flat = dict(_joined({k: x for k, x in document.items() if k != "utilisation_ci"}, ""))
    return {**flat, "utilisation_ci_low": lower, "utilisation_ci_high": upper}


def _joined(document: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in document.items():
        if isinstance(value, Mapping):
            yield from _joined(value, f"{prefix}{key}_")
        elif not isinstance(value, list | tuple):
            yield prefix + key, value
