"""Parquet logs: a column per channel, its unit in the field's metadata."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from ..core import toml
from ..core.errors import UserError
from ..core.model import Bools, Floats, Times
from ..core.text import distinct
from . import time_columns
from .source import Field, ReadOptions
from .tables import Columns, Contents, Note, TableSamples, TableSource
from .time_columns import HEAD

_MOST_BYTES = 1 << 29, 1_000  # of the columns in memory: at least, and for each byte of the file
_UNIT_KEYS = (b"unit", b"units", b"Unit", b"Units")  # of a field's metadata


def open_parquet(path: Path, options: ReadOptions) -> TableSource:
    """Opens a Parquet log.

    Raises:
        UserError: where the file is damaged or cut off, or no column is a time.
    """
    return TableSource(path, "parquet", options, Reader(path, options))


class Reader:
    """A Parquet file, row group by row group."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path = path
        try:
            self._file = _open_file(path)
        except (pa.ArrowException, OSError) as error:
            raise _damaged(path, _first_line(error)) from None
        schema, meta = self._file.schema_arrow, self._file.metadata
        self._rows = meta.num_rows
        columns = [i for i, f in enumerate(schema) if _is_scalar(f.type)]
        self._names = [schema.names[i] for i in columns]
        if len(set(schema.names)) < len(schema.names):
            raise UserError(
                f"{path}: two columns have the same name", "give each column a name of its own"
            )
        self._check_size(2)
        units = [_unit(schema.field(i)) for i in columns]
        heads = {name: self._head(name) for name in self._names}
        self._clock, time_reason = time_columns.find(heads, units, self._rows, options, path)
        self._device = _device(self._names, options, path)
        time = self._clock.columns
        numeric = [
            k for k, i in enumerate(columns) if k not in time and _is_number(schema.field(i).type)
        ]
        self._numbers = [self._names[k] for k in numeric]
        titles = distinct([name or "(no name)" for name in self._numbers])
        fields = [
            Field(title, unit=units[k], unit_from="field metadata" if units[k] else "")
            for title, k in zip(titles, numeric, strict=True)
        ]
        start = 2**62 if self._clock.absolute else 0  # only whether it has one counts
        skipped = [n for n in schema.names if n not in {self._names[k] for k in (*time, *numeric)}]
        kind = schema.field(columns[time[0]]).type
        reasons = {
            "columns": len(schema.names),
            "row groups": meta.num_row_groups,
            "written by": meta.created_by or "",
            "time column": str(kind),
            "not numeric": ", ".join(skipped),
        }
        notes = [
            Note(f.code, f.severity, f.channel, f.count, f.values, f.names) for f in time_reason
        ]
        reason = self._clock.reason.replace("(units row)", "(field metadata)")
        self.contents = Contents(fields, start, reason, self._rows, reasons, notes=notes)

    def _check_size(self, columns: int) -> None:
        """Refuses a file that says it holds much more than it can.

        Raises:
            UserError: where these columns would take too much memory.
        """
        smallest, per_byte = _MOST_BYTES
        limit = max(smallest, per_byte * self._path.stat().st_size)
        if 9 * self._rows * columns > limit:
            raise UserError(
                f"{self._path}: states {self._rows} rows, more than a file of this size holds",
                "write the file again with the program that made it",
            )

    def _head(self, name: str) -> Any:
        """The first values of a column, from the first row group in which it is sound."""
        for group in range(self._file.metadata.num_row_groups):
            try:
                batches = self._file.iter_batches(HEAD, row_groups=[group], columns=[name])
                if head := next(batches, None):
                    return head.column(0)
            except (pa.ArrowException, OSError, ValueError):
                continue
        return None

    def read(self, wanted: Sequence[int]) -> Columns:
        """See `tables.Reader`. A damaged part of a column costs its samples, or those of a time."""
        names = [self._numbers[i] for i in wanted]
        times = [self._names[i] for i in self._clock.columns]
        self._check_size(len(names) + len(times))
        pieces: list[_Piece] = []
        lost_groups: list[tuple[int, str]] = []  # rows, and why
        untimed = 0
        for group in range(self._file.metadata.num_row_groups):
            try:
                arrays = [self._column(group, name) for name in times]
                t, ok = time_columns.times(arrays, self._clock)
            except (pa.ArrowException, OSError, ValueError) as error:
                damage = f"row group {group + 1}: {_first_line(error)}"
                lost_groups.append((self._file.metadata.row_group(group).num_rows, damage))
                continue
            untimed += int(np.count_nonzero(~ok))
            if self._device:
                ok &= self._is_of_device(group, *self._device)
            pieces.append(_Piece(t[ok], [self._values(group, name, ok) for name in names]))
        if not pieces:
            raise _damaged(self._path, lost_groups[0][1])
        if self._device and not any(len(piece.t) for piece in pieces):
            name, equals = self._device
            text = f"{self._path}: no row has {equals!r} in column {name!r}"
            raise UserError(text, "state a value of this column in channels.group")
        notes = []
        if lost_groups:
            values = {
                "kept_rows": sum(len(piece.t) for piece in pieces),
                "lost_rows": sum(n for n, _ in lost_groups),
            }
            names_of = {"damage": lost_groups[0][1]}
            notes.append(Note("log-damaged", "error", "", len(lost_groups), values, names_of))
        if untimed:
            notes.append(Note("time-unreadable", "warning", "", untimed))
        series = []
        for k in range(len(names)):
            value, null, bad = (
                np.concatenate([piece.series[k][x] for piece in pieces]) for x in range(3)
            )
            series.append(TableSamples(0, value, {"value-missing": null, "value-damaged": bad}))
        return Columns([np.concatenate([piece.t for piece in pieces])], series, notes)

    def _column(self, group: int, name: str) -> Any:
        """A column of a row group as one array.

        Raises:
            pa.ArrowException, OSError: where it is damaged.
        """
        column = self._file.read_row_group(group, columns=[name]).column(0)
        column.validate(full=True)
        return pa.concat_arrays(column.chunks) if column.num_chunks else pa.array([], column.type)

    def _is_of_device(self, group: int, name: str, equals: str) -> Bools:
        """The rows of a row group that belong to the stated device; none where it is damaged."""
        try:
            cells = self._column(group, name).cast(pa.string()).fill_null("")
        except (pa.ArrowException, OSError, ValueError):
            return np.zeros(self._file.metadata.row_group(group).num_rows, np.bool_)
        return np.array([cell == equals for cell in cells.to_pylist()], np.bool_)

    def _values(self, group: int, name: str, ok: Bools) -> tuple[Floats, Bools, Bools]:
        """Values of a row group's rows that have a time; where there is none; what is damaged."""
        n, is_null = int(np.count_nonzero(ok)), np.zeros(len(ok), np.bool_)[ok]
        try:
            array = self._column(group, name)
            null = np.asarray(array.is_null())
            value = np.asarray(array.cast(pa.float64(), safe=False).fill_null(np.nan))
        except (pa.ArrowException, OSError, ValueError):
            return np.full(n, np.nan), is_null, ~is_null
        if len(value) != len(ok):
            return np.full(n, np.nan), is_null, ~is_null
        return value[ok], null[ok], is_null


class _Piece(NamedTuple):
    """A row group: times, and for each column values, what is missing and what is damaged."""

    t: Times
    series: list[tuple[Floats, Bools, Bools]]


def _device(names: Sequence[str], options: ReadOptions, path: Path) -> tuple[str, str] | None:
    """The column that separates devices, and the one that is read; None where none is stated.

    Raises:
        UserError: where there is no such column, or no device is stated.
    """
    name, equals = options.group_channel, options.group_equals
    if name is None:
        return None
    if name not in names or equals is None:
        text = "no such column" if name not in names else "state which of its values is read"
        raise UserError(
            f"{path}: channels.group names {name!r}: {text}",
            "of a Parquet log one device is read: "
            + toml.option('channels.group = {channel = "NAME", equals = "1"}'),
        )
    return name, equals


def _open_file(path: Path) -> Any:
    """The file, read with all checks; pyarrow's Parquet part is loaded only here."""
    import pyarrow.parquet

    metadata_limit = min(path.stat().st_size, 1 << 27)  # of the metadata
    return pyarrow.parquet.ParquetFile(
        path,
        page_checksum_verification=True,
        thrift_string_size_limit=metadata_limit,
        thrift_container_size_limit=metadata_limit,
    )


def _damaged(path: Path, damage: str) -> UserError:
    return UserError(
        f"{path}: damaged Parquet file: {damage}",
        "copy the log again from its source; a file that was cut off has no table of contents",
    )


def _first_line(error: Exception) -> str:
    return " ".join(str(error).splitlines()[0].split())[:160] if str(error) else "unreadable"


def _is_scalar(kind: Any) -> bool:
    types = pa.types
    text = types.is_string(kind) or types.is_large_string(kind) or types.is_dictionary(kind)
    return _is_number(kind) or types.is_temporal(kind) or text


def _is_number(kind: Any) -> bool:
    types = pa.types
    return bool(
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_decimal(kind)
        or types.is_boolean(kind)
    )


def _unit(field: Any) -> str:
    """The unit that a field's metadata state, "" for none."""
    metadata = field.metadata or {}
    return next((metadata[k].decode("utf-8", "replace") for k in _UNIT_KEYS if k in metadata), "")
