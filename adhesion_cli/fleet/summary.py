"""What the results of a fleet show together: the document `adhesion.fleet-summary/1`."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import dataset

from ..core.errors import UserError
from ..core.finding import is_lossy
from ..core.model import Floats
from ..core.text import printable
from .dataset import SETTINGS, TABLES

BANDS = (0.0, 40.0, 80.0, 120.0, 160.0, 200.0)  # edges of the speed bands [km/h]
_SHARES = (5.0, 50.0, 95.0)  # percentiles
_SUSPECT = "-unit-suspect"  # end of the codes of units that are probably wrong
_MOST = 10  # slides and logs that are listed
_OF_APPLICATION = (
    "log", "sha256", "axle", "start_s", "from_mps", "to_mps", "coefficient_mean", "slides",
    "slide_s", "slide_distance_m", "max_slip", "slide_energy_j", "settings", "version",
)  # fmt: skip
_OF_FINDING = ("log", "sha256", "code", "severity", "message", "settings", "version")
_OF_LOG = ("log", "sha256", "status", "error", "hint", "start", "version", "settings")


def summarised(folder: Path) -> dict[str, Any]:
    """The summary of a folder of results.

    Of a log with several results by the same settings, the newest version of the program counts,
    and of that the newest file. The speed of a brake application is the mean of its start and end.

    Raises:
        UserError: the folder holds no results, or they cannot be read.
    """
    try:
        logs = _newest(_read(folder, "logs", (*_OF_LOG, "__filename")))
        good = [row for row in logs if row["status"] != "error"]
        keys = pa.array(sorted({_key(row) for row in good}), pa.string())
        applications = _of(_read(folder, "applications", _OF_APPLICATION), keys)
        findings = _of(
            _read(folder, "findings", _OF_FINDING),
            keys,
        )
    except (OSError, pa.ArrowException) as error:
        text = f"{printable(str(folder))}: cannot be read as results of a fleet ({error})"
        raise UserError(
            text, "name the folder that `adhesion fleet -o` wrote; to analyse first, add -o"
        ) from error
    days = {_key(row): row["start"].date().isoformat() for row in good if row["start"]}
    stems = _keys(applications).to_pylist()
    speed = 3.6 * 0.5 * (_column(applications, "from_mps") + _column(applications, "to_mps"))
    settings = applications["settings"].to_pylist()
    return {
        "logs": {s: sum(r["status"] == s for r in logs) for s in ("ok", "damaged", "error")},
        "applications": len(applications),
        "with_slides": int((_column(applications, "slides") > 0).sum()),
        "by_speed": _by_speed(applications, speed),
        "by_settings": [
            {"settings": one, "stated": _stated(folder, one), **of}
            for one, of in _grouped(applications, settings)
        ],
        "by_day": [
            {"day": one, **of}
            for one, of in _grouped(applications, [days.get(x, "unknown") for x in stems])
        ],
        "worst_slides": _worst(applications),
        "findings": _codes(findings),
        "in_doubt": _in_doubt(findings),
        "to_check": _to_check(findings),
        "evaluated": _evaluated(good),
        "failed": [{k: row[k] for k in ("log", "error", "hint")} for row in logs if row["error"]],
        "damaged": sorted({row["log"] for row in logs if row["status"] == "damaged"}),
    }  # fmt: skip


def _read(folder: Path, table: str, columns: Sequence[str]) -> Any:
    """Columns of a table.

    Raises:
        UserError: the folder has no such table.
    """
    files = sorted((folder / table).glob("*.parquet")) if set(TABLES) <= _inside(folder) else []
    if table == "logs" and not files:
        text = f"{printable(str(folder))}: holds no results of a fleet"
        raise UserError(text, "name the folder that `adhesion fleet -o` wrote")
    if not files:  # every log failed
        return pa.table({name: pa.array([], pa.null()) for name in columns})
    found = dataset.dataset([str(file) for file in files], format="parquet")
    return found.to_table(columns=list(columns))


def _inside(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} if folder.is_dir() else set()


def _key(row: Mapping[str, Any]) -> str:
    return f"{row['sha256']}-{row['settings']}-{row['version']}"


def _keys(table: Any) -> Any:
    parts = (table[name].cast(pa.string()) for name in ("sha256", "settings", "version"))
    return pc.binary_join_element_wise(*parts, "-")


def _of(table: Any, keys: Any) -> Any:
    """The rows of these results."""
    return table.filter(pc.is_in(_keys(table), keys))


def _newest(table: Any) -> list[dict[str, Any]]:
    """The row that counts of each log and settings."""
    best: dict[tuple[str, str], tuple[Any, dict[str, Any]]] = {}
    for row in table.to_pylist():
        numbers = [int(x) for x in re.findall(r"\d+", row["version"] or "")]
        age = numbers, Path(row["__filename"]).stat().st_mtime_ns
        at = row["log"], row["settings"]
        if at not in best or best[at][0] < age:
            best[at] = age, row
    return [row for _, row in sorted(best.values(), key=lambda of: of[1]["log"])]


def _column(table: Any, name: str) -> Floats:
    """A column of numbers, NaN where there is none."""
    column: Floats = table[name].cast(pa.float64()).to_numpy()
    return column


def _spread(table: Any, where: NDArray[np.bool_] | NDArray[np.int64]) -> dict[str, Any]:
    """Number of applications and of those with slides, and percentiles of the coefficient."""
    mu, slides = _column(table, "coefficient_mean")[where], _column(table, "slides")[where]
    known, sliding = mu[np.isfinite(mu)], mu[np.isfinite(mu) & (slides > 0)]
    shares = np.percentile(known, _SHARES).tolist() if len(known) else [None] * len(_SHARES)
    return {
        "applications": len(mu), "with_slides": int((slides > 0).sum()),
        **dict(zip(("p5", "median", "p95"), shares, strict=True)),
        "median_with_slides": float(np.median(sliding)) if len(sliding) else None,
    }  # fmt: skip


def _by_speed(table: Any, speed: Floats) -> list[dict[str, Any]]:
    rows = []
    for low, high in zip(BANDS, (*BANDS[1:], np.inf), strict=True):
        where = (speed >= low) & (speed < high)
        if where.any():
            end = high if np.isfinite(high) else None
            rows.append({"from_kmh": low, "to_kmh": end, **_spread(table, where)})
    return rows


def _grouped(table: Any, names: Sequence[str]) -> list[tuple[str, dict[str, Any]]]:
    """Each name with the spread of its rows, in the order of the names."""
    found, at = np.unique(np.array(names, dtype=np.str_), return_inverse=True)
    order = np.argsort(at, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(at, minlength=len(found)))[:-1])
    return [(str(name), _spread(table, part)) for name, part in zip(found, parts, strict=False)]


def _worst(table: Any) -> list[dict[str, Any]]:
    """The applications that slid furthest: distance times the largest slip, an upper limit."""
    far = _column(table, "slide_distance_m") * _column(table, "max_slip")
    slid = np.flatnonzero(np.isfinite(far) & (far > 0.0))
    first = slid[np.argsort(-far[slid], kind="stable")][:_MOST]
    names = [n for n in _OF_APPLICATION if n not in ("sha256", "settings", "version")]
    rows: list[dict[str, Any]] = table.take(first).select(names).to_pylist()
    return rows


def _codes(table: Any) -> list[dict[str, Any]]:
    """Warnings and errors on the data, by how many logs have them."""
    found: dict[tuple[str, str], set[str]] = {}
    columns: Iterable[Any] = (table[name].to_pylist() for name in ("code", "severity", "log"))
    for code, severity, log in zip(*columns, strict=True):
        if is_lossy(code, severity):
            found.setdefault((code, severity), set()).add(log)
    rows = [
        {"code": code, "severity": severity, "logs": len(logs), "example": min(logs)}
        for (code, severity), logs in found.items()
    ]
    return sorted(rows, key=lambda row: (row["severity"], -int(row["logs"]), row["code"]))


def _in_doubt(table: Any) -> int:
    """How many logs have a warning on the data, and no error."""
    of: dict[str, set[str]] = {"warning": set(), "error": set()}
    columns: Iterable[Any] = (table[name].to_pylist() for name in ("code", "severity", "log"))
    for code, severity, log in zip(*columns, strict=True):
        if is_lossy(code, severity):
            of[severity].add(log)
    return len(of["warning"] - of["error"])


def _to_check(table: Any) -> list[dict[str, str]]:
    """Errors and suspect units, which make the numbers of a log doubtful: one row for each."""
    rows = [
        {k: str(row[k] or "") for k in ("log", "severity", "code", "message")}
        for row in table.select(["log", "severity", "code", "message"]).to_pylist()
        if row["severity"] == "error" or row["code"].endswith(_SUSPECT)
    ]
    of = {(row["log"], row["code"]): row for row in reversed(rows)}  # the first of a code
    return [of[key] for key in sorted(of)]


def _evaluated(logs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Versions of the program, and when their results were written: first and last day (UTC)."""
    times = [Path(row["__filename"]).stat().st_mtime for row in logs]
    days = [datetime.fromtimestamp(f(times), UTC).date().isoformat() for f in (min, max) if times]
    return {"versions": sorted({str(row["version"]) for row in logs}), "days": days}


def _stated(folder: Path, settings: str) -> str:
    """What the settings of a hash state of the vehicle, in a line."""
    try:
        text = (folder / SETTINGS / f"{settings}.json").read_text("utf-8")
        vehicle = json.loads(text)["stated"].get("vehicle", {})
    except (OSError, ValueError, KeyError, AttributeError):
        return "unknown"
    parts = []
    for name, value in vehicle.items():
        one = value.get("value") if isinstance(value, dict) else value
        if isinstance(one, int | float):
            parts.append(f"{name} {one:g}")
    return ", ".join(parts) or "default vehicle"
