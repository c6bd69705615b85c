"""The results of a fleet: a folder of Parquet files for each table.

A file is named by the hash of the log's content, the hash of the settings and the version of the
program. The file of a log in `logs` appears last, and holds a hash of the others: a log is done
where all of them are whole.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
from pyarrow import dataset

from ..core.annotated import Json
from ..core.errors import UserError
from ..core.text import printable, utf8
from ..results import atomic_files, tables
from ..results.tables import LogRow

OF_RESULTS = ("applications", "stops", "estimators", "findings")
TABLES = (*OF_RESULTS, "logs")
SETTINGS = "settings"  # a file for each hash, with what it is of
_DIGITS = 16  # of the hash
_PARQUET = dataset.ParquetFileFormat(
    default_fragment_scan_options=dataset.ParquetFragmentScanOptions(
        page_checksum_verification=True
    )
)


class KeptTables(NamedTuple):
    """What is written of one log."""

    key: str  # hash of its content, or what stands for it
    names: tuple[str, ...]  # all names of this content
    row: LogRow
    files: Mapping[str, bytes]  # the other tables; none of a log that failed


class Dataset:
    """The part of a folder that belongs to one version and one hash of settings."""

    def __init__(self, folder: Path, settings: str, version: str) -> None:
        self._folder, self._settings = folder, settings
        self._suffix = f"-{settings}-{version}.parquet"

    def prepare(self, settings: Json) -> None:
        """Makes the folders, writes these settings, removes what killed runs left, or raises."""
        folders = [self._folder / name for name in (*TABLES, SETTINGS)]
        try:
            for folder in folders:
                folder.mkdir(parents=True, exist_ok=True)
            atomic_files.sweep(folders)
            file = self._folder / SETTINGS / f"{self._settings}.json"
            with atomic_files.outputs([file], True) as (place,):
                place.write_text(json.dumps(settings, indent=1, sort_keys=True), encoding="utf-8")
        except OSError as error:
            text = f"{printable(str(self._folder))}: cannot be written ({error.strerror})"
            raise UserError(text, "choose another folder with --out") from error

    def finished_logs(self) -> dict[str, list[LogRow]]:
        """The rows of the logs that are there, by key; what is damaged is not there."""
        files = sorted((self._folder / "logs").glob(f"*{self._suffix}"))
        by_key: dict[str, list[LogRow]] = {}
        for file, row in read_logs(files)[0]:
            if row.status == "error" or is_whole(file, row.tables_sha256):
                by_key.setdefault(file.name.removesuffix(self._suffix), []).append(row)
        return by_key

    def write(self, logs: Iterable[KeptTables]) -> None:
        """Writes all tables of these logs, those of the logs last; a UserError where it cannot."""
        content: dict[Path, bytes] = {}
        for log in logs:
            content |= {self._path(name, log.key): data for name, data in log.files.items()}
            row = log.row
            if log.files:
                row = replace(row, tables_sha256=_digest(log.files[name] for name in OF_RESULTS))
            rows = [replace(row, log=name) for name in sorted(map(utf8, log.names))]
            content[self._path("logs", log.key)] = tables.packed(tables.table(rows, tables.LOGS))
        with atomic_files.sets([[path] for path in content], True, sweeps=False) as places:
            for (place,), data in zip(places, content.values(), strict=True):
                place.write_bytes(data)

    def forget(self, key: str) -> None:
        """Removes a log from the table of logs, if it is there."""
        self._path("logs", key).unlink(missing_ok=True)

    def _path(self, table: str, key: str) -> Path:
        return self._folder / table / f"{key}{self._suffix}"


def read_logs(files: Sequence[Path]) -> tuple[list[tuple[Path, LogRow]], list[Path]]:
    """The rows of tables of logs, each after its file; and which files are damaged."""
    if not files:
        return [], []
    try:
        names = [*tables.LOGS.names, "__filename"]
        table = dataset.dataset([*map(str, files)], tables.LOGS, _PARQUET).to_table(names)
        return [(Path(x.pop("__filename")), LogRow(**x)) for x in table.to_pylist()], []
    except (OSError, pa.ArrowException):
        if len(files) == 1:
            return [], list(files)
    halves = files[: len(files) // 2], files[len(files) // 2 :]
    rows, damaged = zip(*map(read_logs, halves), strict=True)
    return [*chain(*rows)], [*chain(*damaged)]


def is_whole(log: Path, tables_sha256: str | None) -> bool:
    """Whether the other tables of a log, by its file in the table of logs, have this hash."""
    try:
        contents = [(log.parents[1] / name / log.name).read_bytes() for name in OF_RESULTS]
    except OSError:
        return False
    return _digest(contents) == tables_sha256


def _digest(contents: Iterable[bytes]) -> str:
    return sha256(b"".join(sha256(content).digest() for content in contents)).hexdigest()


def hashed(settings: Json) -> str:
    """A hash of all that a result depends on, except the log and the version."""
    return sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:_DIGITS]


def unread(name: str) -> str:
    """The key of a log whose content cannot be read."""
    return "unread-" + sha256(utf8(name).encode()).hexdigest()[:32]
