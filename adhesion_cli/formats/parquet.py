"""Parquet logs: a column per channel, its unit in the field's metadata."""

import ast
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from ..core import units
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.text import distinct
from .as_text import open_text, write_table
from .csv.reader import CsvSource
from .source import ReadOptions, damaged, without_numbers
from .tables import open_scale

_MOST_BYTES = 1 << 29, 1_000  # of the columns in memory: at least, and for each byte of the file
_READ_ERRORS = (pa.ArrowException, OSError, ValueError)  # of damaged files
_UNIT_KEYS = (b"unit", b"units", b"Unit", b"Units")  # of a field's metadata
_MOST_ELEMENTS = 64  # of a list, of which each is a channel


_TEXTS = pa.types.is_string, pa.types.is_large_string, pa.types.is_string_view
_LISTS = pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list
_NUMBERS = pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal, pa.types.is_boolean


class _ParquetColumn(NamedTuple):
    """A column of the file, or a field of a structure in it, or an element of its lists."""

    name: str  # its place in the file, distinct from others: "axle.speed", "speeds[0]"
    title: str
    unit: str


def open_parquet(path: Path, options: ReadOptions) -> CsvSource:
    """Opens a Parquet log: its columns are read as those of a text log.

    Raises:
        UserError: where the file is damaged or cut off, or no column is a time.
    """
    try:
        file = _open_file(path)
    except _READ_ERRORS as error:
        raise damaged(path, "Parquet", _first_line(error)) from None
    schema, meta = file.schema_arrow, file.metadata
    if len(set(schema.names)) < len(schema.names):
        hint = "give each column a name of its own"
        raise UserError(f"{path}: two columns have the same name", hint)
    smallest, per_byte = _MOST_BYTES
    size = 9 * meta.num_rows * len(schema.names)
    if size > max(smallest, per_byte * path.stat().st_size):
        text = f"{path}: states {meta.num_rows} rows, more than a file of this size holds"
        raise UserError(text, "write the file again with the program that made it")
    table = _read_table(path, file)
    arrays = _arrays(table)
    columns, nested = _columns(table.schema, arrays)
    integers = [f for f in table.schema if pa.types.is_integer(f.type)]
    keys = {f.name: [x.decode("utf-8", "replace") for x in f.metadata or ()] for f in integers}
    raw = {name: problem for name, x in keys.items() if (problem := open_scale(x))}
    columns = [c for c in columns if c.name not in raw]
    findings = [
        Finding("channel-not-read", "warning", name, 1, names={"reason": reason})
        for name, reason in raw.items()
    ]
    if nested:
        names = {"columns": ", ".join(nested[:6])}
        findings.insert(0, Finding("nested-columns", "info", "", len(nested), names=names))
    durations = {c.title for c in columns if pa.types.is_duration(arrays[c.name].type)}

    def write(text: Path) -> list[str]:
        write_table({c.title: arrays.pop(c.name) for c in columns}, text)
        return [c.unit for c in columns]

    if not columns or not meta.num_rows:
        raise without_numbers(path, findings)
    source = open_text("parquet", path, write, "field metadata", options)
    source.fields = [f for f in source.fields if f.channel not in durations]
    if not source.fields:
        raise without_numbers(path, findings)
    source.findings += findings
    source.reasons |= {
        "columns": len(schema.names),
        "row groups": meta.num_row_groups,
        "written by": meta.created_by or "",
    }
    return source


def _read_table(path: Path, file: Any) -> Any:
    """The columns of a file, the fields of structures in it as columns."""
    try:
        table = file.read()
        table.validate(full=True)
    except _READ_ERRORS as error:
        raise damaged(path, "Parquet", _first_line(error)) from None
    while any(pa.types.is_struct(f.type) for f in table.schema):
        table = table.flatten()
    return table


def _arrays(table: Any) -> dict[str, pa.Array]:
    """Each column as one array, by name: elements of lists, too.

    A list that is shorter than others of its column has nulls behind its end.
    """
    arrays = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        array = column.combine_chunks()
        if pa.types.is_dictionary(array.type):
            array = array.dictionary_decode()
        if not _is_any(array.type, _LISTS):
            arrays[name] = array
            continue
        longest = pc.max(pc.list_value_length(array)).as_py() or 0
        if 0 < longest <= _MOST_ELEMENTS:
            padded = pc.list_slice(array, 0, longest, return_fixed_size_list=True)
            arrays |= {f"{name}[{k}]": pc.list_element(padded, k) for k in range(longest)}
    return arrays


def _columns(schema: Any, arrays: dict[str, pa.Array]) -> tuple[list[_ParquetColumn], list[str]]:
    """The columns that hold one value in a row; and the names of those that are not read."""
    columns, nested = [], []
    pair_names = (re.sub(r"\s*[\r\n]\s*", " ", _pair(f.name)[0]) for f in schema)
    titles = distinct([name or "(no name)" for name in pair_names])
    for f, title in zip(schema, titles, strict=True):
        unit = _unit(f) or _pair(f.name)[1]
        kind = arrays[f.name].type if f.name in arrays else None  # not that of a dictionary
        if kind and _is_any(kind, (*_NUMBERS, *_TEXTS, pa.types.is_temporal)):
            columns.append(_ParquetColumn(f.name, title, unit))
        elif (
            _is_any(f.type, _LISTS)
            and _is_any(f.type.value_type, _NUMBERS)
            and f"{f.name}[0]" in arrays
        ):
            count = sum(name.rpartition("[")[0] == f.name for name in arrays)
            places = (f"[{k}]" for k in range(count))
            unit = unit or units.in_name(title)[1]  # which the place would hide
            columns += [_ParquetColumn(f.name + x, title + x, unit) for x in places]
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


def _first_line(error: Exception) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "the name of a column is not UTF-8"
    return " ".join(str(error).splitlines()[0].split())[:160] if str(error) else "unreadable"


def _is_any(kind: Any, checks: Sequence[Callable[[Any], bool]]) -> bool:
    return any(check(kind) for check in checks)


def _unit(field: Any) -> str:
    """The unit that a field's metadata state, "" for none; a duration is written in ns."""
    if pa.types.is_duration(field.type):
        return "ns"
    metadata = field.metadata or {}
    return next((metadata[k].decode("utf-8", "replace") for k in _UNIT_KEYS if k in metadata), "")
