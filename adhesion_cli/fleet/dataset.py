"""The results of a fleet: a folder of Parquet files for each table.

A file is named by the hash of the log's content, the hash of the settings and the version of the
program. The file of a log in `logs` appears last: what has one there is done.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
from pyarrow import dataset, parquet

from ..core.annotated import Json
from ..core.errors import UserError
from ..core.text import printable, utf8
from ..results import atomic_files, tables
from ..results.tables import LogRow

TABLES = ("applications", "estimators", "findings", "logs")
RECORDINGS = "recordings"
SETTINGS = "settings"  # a file for each hash, with what it is of
_DIGITS = 16  # of the hash


class KeptTables(NamedTuple):
    """What is written of one log.

    Attributes:
        key: hash of its content, or what stands for it.
        names: all names of this content.
        row: of the table of logs.
        files: the bytes of the other tables; none of a log that failed.
    """

    key: str
    names: tuple[str, ...]
    row: LogRow
    files: Mapping[str, bytes]


class DoneLog(NamedTuple):
    """A row of the table of logs: what a later run asks of it."""

    log: str
    status: str
    lossy: bool
    file: str  # that holds the row


class Dataset:
    """The part of a folder that belongs to one version and one hash of settings."""

    def __init__(self, folder: Path, settings: str, version: str) -> None:
        self._folder, self._settings = folder, settings
        self._suffix = f"-{settings}-{version}.parquet"

    def prepare(self, settings: Json) -> None:
        """Makes the folders, writes the settings, and removes what killed runs left.

        Args:
            settings: what the hash is of.

        Raises:
            UserError: they cannot be made.
        """
        folders = [self._folder / name for name in (*TABLES, SETTINGS)]
        try:
            for folder in folders:
                folder.mkdir(parents=True, exist_ok=True)
            atomic_files.sweep([*folders, *self._folder.glob(RECORDINGS)])
            file = self._folder / SETTINGS / f"{self._settings}.json"
            with atomic_files.outputs([file], True) as (place,):
                place.write_text(json.dumps(settings, indent=1, sort_keys=True), encoding="utf-8")
        except OSError as error:
            text = f"{printable(str(self._folder))}: cannot be written ({error.strerror})"
            raise UserError(text, "choose another folder with --out") from error

    def finished_logs(self) -> dict[str, list[DoneLog]]:
        """What `run` asks of the logs that are there, by key; a damaged file is not there."""
        files = sorted(str(path) for path in (self._folder / "logs").glob(f"*{self._suffix}"))
        by_key: dict[str, list[DoneLog]] = {}
        for row in _rows(files):
            key = Path(row.file).name.removesuffix(self._suffix)
            by_key.setdefault(key, []).append(row)
        return by_key

    def row(self, key: str) -> LogRow:
        """The row of a log that is there."""
        return LogRow(**parquet.read_table(self._path("logs", key)).to_pylist()[0])

    def write(self, logs: Iterable[KeptTables]) -> None:
        """Writes all tables of these logs, those of the logs last.

        Raises:
            UserError: the disk is full, fails or refuses.
        """
        content: dict[Path, bytes] = {}
        for log in logs:
            content |= {self._path(name, log.key): data for name, data in log.files.items()}
            names = sorted(map(utf8, log.names))
            rows = [replace(log.row, log=name) for name in names]
            content[self._path("logs", log.key)] = tables.packed(tables.table(rows, tables.LOGS))
        with atomic_files.sets([[path] for path in content], True, sweeps=False) as places:
            for (place,), data in zip(places, content.values(), strict=True):
                place.write_bytes(data)

    def forget(self, key: str) -> None:
        """Removes a log from the table of logs, if it is there."""
        self._path("logs", key).unlink(missing_ok=True)

    def _path(self, table: str, key: str) -> Path:
        return self._folder / table / f"{key}{self._suffix}"


def _rows(files: list[str]) -> list[DoneLog]:
    """Name, status, whether it is lossy, and the file of each row of these tables of logs."""
    if not files:
        return []
    try:
        table = dataset.dataset(files, tables.LOGS, "parquet")
        columns = ["log", "status", "lossy", "__filename"]
        rows = [DoneLog(*row.values()) for row in table.to_table(columns).to_pylist()]
    except (OSError, pa.ArrowException):
        middle = len(files) // 2  # one of them is damaged
        return [*_rows(files[:middle]), *_rows(files[middle:])] if middle else []
    return rows


def hashed(settings: Json) -> str:
    """A hash of all that a result depends on, except the log and the version."""
    return sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:_DIGITS]


def unread(name: str) -> str:
    """The key of a log whose content cannot be read."""
    return "unread-" + sha256(utf8(name).encode()).hexdigest()[:32]
