"""Parquet logs: a column per channel, its unit in the field's metadata."""

import ast
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from ..core import units
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.text import distinct
from . import time_columns
from .as_text import open_text
from .csv.clock import Clock
from .csv.dialect import is_number
from .csv.header_words import SIGNAL, is_named
from .csv.reader import CsvSource
from .source import Field, ReadOptions, Source, distinct_words
from .tables import Columns, Contents, TableSamples, TableSource, open_scale
from .time_columns import HEAD
from .words import numbered

_MOST_BYTES = 1 << 29, 1_000  # of the columns in memory: at least, and for each byte of the file
_READ_ERRORS = (pa.ArrowException, OSError, ValueError)  # of damaged files
_UNIT_KEYS = (b"unit", b"units", b"Unit", b"Units")  # of a field's metadata


_MOST_ELEMENTS = 64  # of a list, of which each is a channel


class _ParquetColumn(NamedTuple):
    """A column of the file, or a field of a structure in it, or an element of its lists."""

    name: str  # its place in the file, distinct from others: "axle.speed", "speeds[0]"
    title: str
    path: str  # place in a list: "[0]"; "" without one
    unit: str
    type: Any


def open_parquet(path: Path, options: ReadOptions) -> Source:
    """Opens a Parquet log; rows of several signals or devices are read as those of a text log.

    Raises:
        UserError: where the file is damaged or cut off, or no column is a time.
    """
    if options.group_channel and (text := _as_text(path, options)):
        return text
    try:
        reader = Reader(path, options)
    except _TimeError:
        if text := _as_text(path, options):
            return text
        raise
    if reader.has_numbers_as_texts and (text := _as_text(path, options)):
        return text
    if reader.may_be_long:
        text = _as_text(path, options)
        if text and text.keys.columns:
            return text
    return TableSource(path, "parquet", options, reader)


class _TimeError(UserError):
    """No column is the time of all others."""


def _as_text(path: Path, options: ReadOptions) -> CsvSource | None:
    """The log opened as a text log, None where its text is none.

    Raises:
        UserError: where the file is damaged.
    """
    table = _read_table(path, _open_file(path))
    try:
        return open_text("parquet", path, lambda _, text: _write_text(table, text), options)
    except (UserError, pa.ArrowException):
        if options.group_channel:
            raise
        return None


def _write_text(table: Any, text: Path) -> None:
    """Writes the columns of a table as a text log."""
    import pyarrow.csv

    arrays, _ = _arrays(table)
    columns, _ = _columns(table.schema, arrays)
    names = [f"{c.title}{c.path}" + (f" [{c.unit}]" if c.unit else "") for c in columns]
    cells = [arrays[c.name] for c in columns]
    pyarrow.csv.write_csv(pa.Table.from_arrays(cells, names), text)


def _not_read(nested: Sequence[str], raw: Mapping[str, str]) -> Iterator[Finding]:
    """What is not read: columns of structures and lists, and raw numbers, with the reason."""
    if nested:
        names = {"columns": ", ".join(nested[:6])}
        yield Finding("nested-columns", "info", "", len(nested), names=names)
    for name, reason in raw.items():
        yield Finding("channel-not-read", "warning", name, 1, names={"reason": reason})


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
        if len(set(schema.names)) < len(schema.names):
            raise UserError(
                f"{path}: two columns have the same name", "give each column a name of its own"
            )
        self._check_size(2)
        first_rows = self._first_rows()
        head, _ = _arrays(first_rows)
        self._columns, nested = _columns(first_rows.schema, head)
        raw = {f.name: problem for f in schema if (problem := _open_scale(f))}
        self._columns = [c for c in self._columns if c.name not in raw]
        self._elements = Counter(c.name.removesuffix(c.path) for c in self._columns if c.path)
        self._clock, self._times, findings = self._find_time(head, options)
        self.may_be_long = self._may_be_long(head)
        time_names = {c.name for c in self._times}
        numbers = [c for c in self._columns if c.name not in time_names and _is_number(c.type)]
        cells = {
            c: head[c.name].drop_null().to_pylist()
            for c in self._columns
            if not c.path and c.name not in time_names and _is_text(c.type)
        }
        self.has_numbers_as_texts = any(
            cells[c] and all(map(is_number, cells[c]))
            for c in cells
            if units.unit(c.unit or units.in_name(c.title)[1])
        )
        words = {c: cell_words for c in cells if (cell_words := distinct_words(cells[c]))}
        self._series = [*numbers, *words]
        fields = [
            Field(c.title, path=c.path, unit=c.unit, unit_from="field metadata" if c.unit else "")
            for c in numbers
        ]
        used = {*time_names, *(c.name for c in numbers)}
        skipped = [*(c.title for c in self._columns if c.name not in used), *nested]
        reasons = {
            "columns": len(schema.names),
            "row groups": meta.num_row_groups,
            "written by": meta.created_by or "",
            "time column": str(self._times[0].type),
            "not numeric": ", ".join(skipped),
        }
        self.contents = Contents(
            fields,
            2**62 if self._clock.absolute else 0,  # only whether it has one counts
            self._clock.reason.replace("(units row)", "(field metadata)"),
            self._rows,
            reasons,
            findings=[*findings, *_not_read(nested, raw)],
            texts=[Field(c.title, words=words[c]) for c in words],
        )

    def _may_be_long(self, head: dict[str, pa.Array]) -> bool:
        """Whether rows may be of several signals or devices, which texts tell apart."""
        times, _ = time_columns.times([head[c.name] for c in self._times], self._clock)
        has_signals = any(is_named(c.title, SIGNAL) and _is_text(c.type) for c in self._columns)
        return has_signals or len(times) > 1.5 * len(set(times.tolist()))

    def _find_time(
        self, head: dict[str, pa.Array], options: ReadOptions
    ) -> tuple[Clock, list[_ParquetColumn], tuple[Finding, ...]]:
        """The time of all columns, the columns that hold it, and what there is to say of it.

        Raises:
            _TimeError: where no column is a time, or several are.
        """
        by_title = {c.title: c for c in self._columns if not c.path}
        heads = {title: head[c.name] for title, c in by_title.items()}
        unit_texts = [c.unit for c in by_title.values()]

        def read(title: str) -> Any:
            name = by_title[title].name
            return _arrays(_read_table(self._path, self._file, [name]))[0][name]

        try:
            clock, findings = time_columns.find(
                heads, unit_texts, self._rows, options, self._path, read
            )
        except UserError as error:
            raise _TimeError(error.text, error.hint, error.code) from error
        columns = [*by_title.values()]
        return clock, [columns[i] for i in clock.columns], findings

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

    def _first_rows(self) -> Any:
        """The first rows, as a table without structures."""
        try:
            head = next(self._file.iter_batches(HEAD), None)
            table = pa.Table.from_batches([head] if head else [], self._file.schema_arrow)
            return _without_structures(table)
        except _READ_ERRORS as error:
            raise _damaged(self._path, _first_line(error)) from None

    def read(self, wanted: Sequence[int]) -> Columns:
        """See `tables.Reader`."""
        columns = [self._series[i] for i in wanted]
        self._check_size(len(columns) + len(self._times))
        names = {c.name.removesuffix(c.path) for c in (*columns, *self._times)}
        arrays, longer = _arrays(_read_table(self._path, self._file, names), self._elements)
        findings, series = list[Finding](), []
        if longer:
            said = {"columns": ", ".join(f"{x} from [{self._elements[x]}] on" for x in longer)}
            findings.append(Finding("nested-columns", "info", "", len(longer), names=said))
        t, ok = time_columns.times([arrays[c.name] for c in self._times], self._clock)
        if untimed := int(np.count_nonzero(~ok)):
            findings.append(Finding("time-unreadable", "warning", "", untimed))
        for column in columns:
            array = arrays.get(column.name, pa.nulls(self._rows, pa.float64()))
            words = list[str]()
            if _is_text(column.type):
                value = numbered(array, words)
            else:
                value = np.asarray(array.cast(pa.float64(), safe=False).fill_null(np.nan))
            masks = {"value-missing": np.asarray(array.is_null())[ok]}
            series.append(TableSamples(0, value[ok], masks, tuple(words)))
        return Columns([t[ok]], series, findings)


def _read_table(path: Path, file: Any, names: Collection[str] | None = None) -> Any:
    """Whole columns of a file without structures, all of them where none are named.

    Raises:
        UserError: where one is damaged.
    """
    try:
        table = file.read(None if names is None else list(names))
        table.validate(full=True)
    except _READ_ERRORS as error:
        raise _damaged(path, _first_line(error)) from None
    return _without_structures(table)


def _without_structures(table: Any) -> Any:
    """The table, the fields of structures in it as columns."""
    while any(pa.types.is_struct(f.type) for f in table.schema):
        table = table.flatten()
    return table


def _arrays(
    table: Any, elements: Mapping[str, int] | None = None
) -> tuple[dict[str, pa.Array], list[str]]:
    """Each column as one array, by name: elements of lists, too.

    A list that is shorter than others of its column has nulls behind its end.

    Args:
        table: the columns, without structures.
        elements: how many are taken of each column of lists; None for all, if not too many.

    Returns:
        The arrays; and the columns of lists that have more elements than are taken.
    """
    import pyarrow.compute as pc

    arrays, longer = {}, []
    for name, column in zip(table.column_names, table.columns, strict=True):
        array = column.combine_chunks()
        if pa.types.is_dictionary(array.type):
            array = array.dictionary_decode()
        if not _is_list(array.type):
            arrays[name] = array
            continue
        longest = pc.max(pc.list_value_length(array)).as_py() or 0
        count = longest if longest <= _MOST_ELEMENTS else 0
        if elements is not None:
            count = elements.get(name, 0)
        if count:
            padded = pc.list_slice(array, 0, count, return_fixed_size_list=True)
            arrays |= {f"{name}[{k}]": pc.list_element(padded, k) for k in range(count)}
        if 0 < count < longest:
            longer.append(name)
    return arrays, longer


def _columns(schema: Any, arrays: dict[str, pa.Array]) -> tuple[list[_ParquetColumn], list[str]]:
    """The columns that hold one value in a row; and the names of those that are not read."""
    columns, nested = [], []
    titles = distinct([_pair(f.name)[0] or "(no name)" for f in schema])
    for f, title in zip(schema, titles, strict=True):
        unit = _unit(f) or _pair(f.name)[1]
        kind = arrays[f.name].type if f.name in arrays else f.type  # not that of a dictionary
        if _is_scalar(kind):
            columns.append(_ParquetColumn(f.name, title, "", unit, kind))
        elif _is_list(f.type) and _is_number(f.type.value_type) and f"{f.name}[0]" in arrays:
            count = sum(name.rpartition("[")[0] == f.name for name in arrays)
            kind = f.type.value_type
            columns += [
                _ParquetColumn(f"{f.name}[{k}]", title, f"[{k}]", unit, kind) for k in range(count)
            ]
        else:
            nested.append(f.name)
    return columns, nested


def _pair(name: str) -> tuple[str, str]:
    """The name and the unit of a column that is called by a pair of texts, as pandas writes them.

    >>> _pair("('BC pressure', 'bar')"), _pair("('axle 1', 'speed')")
    (('BC pressure', 'bar'), ('axle 1 speed', ''))
    """
    if not re.fullmatch(r"\(('[^']*'(, )?)+\)", name):
        return name, ""
    *pieces, last_name = ast.literal_eval(name)
    unit = (
        last_name
        if pieces and (units.unit(last_name) or units.rare_unit(last_name) or not last_name)
        else ""
    )
    return " ".join(piece for piece in (*pieces, *([] if unit else [last_name])) if piece), unit


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
    return _is_number(kind) or pa.types.is_temporal(kind) or _is_text(kind)


def _is_text(kind: Any) -> bool:
    types = pa.types
    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind))


def _is_list(kind: Any) -> bool:
    types = pa.types
    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def _is_number(kind: Any) -> bool:
    types = pa.types
    return bool(
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_decimal(kind)
        or types.is_boolean(kind)
    )


def _open_scale(field: Any) -> str:
    """Why the numbers of a field are not known, "" where they are."""
    names = [key.decode("utf-8", "replace") for key in field.metadata or ()]
    return open_scale(names) if pa.types.is_integer(field.type) else ""


def _unit(field: Any) -> str:
    """The unit that a field's metadata state, "" for none."""
    metadata = field.metadata or {}
    return next((metadata[k].decode("utf-8", "replace") for k in _UNIT_KEYS if k in metadata), "")
