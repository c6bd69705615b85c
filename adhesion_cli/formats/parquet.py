"""Parquet logs: a column per channel, its unit in the field's metadata."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..core import toml
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.text import distinct
from . import time_columns
from .source import Field, ReadOptions
from .tables import Columns, Contents, TableSamples, TableSource
from .time_columns import HEAD

_MOST_BYTES = 1 << 29, 1_000  # of the columns in memory: at least, and for each byte of the file
_READ_ERRORS = (pa.ArrowException, OSError, ValueError)  # of damaged files
_UNIT_KEYS = (b"unit", b"units", b"Unit", b"Units")  # of a field's metadata


def open_parquet(path: Path, options: ReadOptions) -> TableSource:
    """Opens a Parquet log.

    Raises:
        UserError: where the file is damaged or cut off, or no column is a time.
    """
    return TableSource(path, "parquet", options, Reader(path, options))


class Reader:
    """A Parquet file. A damaged one is refused: its checksums show where, and a copy is sound."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path = path
        try:
            self._file = _open_file(path)
        except _READ_ERRORS as error:
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
        heads = self._heads()
        self._clock, findings = time_columns.find(heads, units, self._rows, options, path)
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
        reason = self._clock.reason.replace("(units row)", "(field metadata)")
        self.contents = Contents(
            fields, start, reason, self._rows, reasons, findings=list(findings)
        )

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

    def _heads(self) -> dict[str, pa.Array]:
        """The first values of each column."""
        try:
            head = next(self._file.iter_batches(HEAD, columns=self._names), None)
        except _READ_ERRORS as error:
            raise _damaged(self._path, _first_line(error)) from None
        head = head or self._file.schema_arrow.empty_table()
        return {name: head.column(name) for name in self._names}

    def read(self, wanted: Sequence[int]) -> Columns:
        """See `tables.Reader`."""
        names = [self._numbers[i] for i in wanted]
        times = [self._names[i] for i in self._clock.columns]
        self._check_size(len(names) + len(times))
        device, equals = self._device or ("", "")
        arrays = self._arrays({*names, *times, *([device] if device else [])})
        t, ok = time_columns.times([arrays[name] for name in times], self._clock)
        findings = []
        if untimed := int(np.count_nonzero(~ok)):
            findings.append(Finding("time-unreadable", "warning", "", untimed))
        if device:
            cells = arrays[device].cast(pa.string()).to_pylist()
            ok &= np.array([cell == equals for cell in cells], np.bool_)
            if not ok.any():
                text = f"{self._path}: no row has {equals!r} in column {device!r}"
                raise UserError(text, "state a value of this column in channels.group")
        series = []
        for name in names:
            value = arrays[name].cast(pa.float64(), safe=False).fill_null(np.nan)
            null = np.asarray(arrays[name].is_null())
            series.append(TableSamples(0, np.asarray(value)[ok], {"value-missing": null[ok]}))
        return Columns([t[ok]], series, findings)

    def _arrays(self, names: Collection[str]) -> dict[str, pa.Array]:
        """Whole columns, each as one array.

        Raises:
            UserError: where one is damaged.
        """
        try:
            table = self._file.read(list(names))
            table.validate(full=True)
        except _READ_ERRORS as error:
            raise _damaged(self._path, _first_line(error)) from None
        return {name: table.column(name).combine_chunks() for name in names}


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
    if isinstance(error, UnicodeDecodeError):
        return "the name of a column is not UTF-8"
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
