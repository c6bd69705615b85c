"""Parquet logs: a column per channel, its unit in the field's metadata."""

import ast
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
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
_UNIT_KEY = re.compile(rb"(?i)(.*_)?(unit|units|unit_string|uom)")  # of a field's metadata
_MOST_ELEMENTS = 64  # of a list, of which each is a channel

_TEXTS = pa.types.is_string, pa.types.is_large_string, pa.types.is_string_view
_LISTS = pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list
_NUMBERS = pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal, pa.types.is_boolean
_ELEMENTS = *_NUMBERS, pa.types.is_struct  # of lists


class _ParquetColumn(NamedTuple):
    """A column of the file, or a field of a structure in it, or an element of its lists."""

    title: str  # its place in the file: "axle.speed", "speeds[0]"
    unit: str
    array: Any


def open_parquet(path: Path, options: ReadOptions) -> CsvSource:
    """Opens a Parquet log: its columns are read as those of a text log.

    Raises:
        UserError: where the file is damaged or cut off, or no column is a time.
    """
    import pyarrow.parquet

    limit = min(path.stat().st_size, 1 << 27)  # of the metadata
    limits = {"thrift_string_size_limit": limit, "thrift_container_size_limit": limit}
    try:
        file = pyarrow.parquet.ParquetFile(path, page_checksum_verification=True, **limits)
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
    try:
        table = file.read()
        table.validate(full=True)
    except _READ_ERRORS as error:
        raise damaged(path, "Parquet", _first_line(error)) from None
    columns, findings = _columns(table)
    titles = distinct([c.title for c in columns])
    pairs = zip(titles, columns, strict=True)
    durations = {title for title, c in pairs if pa.types.is_duration(c.array.type)}

    def write(text: Path) -> list[str]:
        units_of_columns = [c.unit for c in columns]
        arrays = [c.array for c in columns]
        columns.clear()
        write_table(dict(zip(titles, arrays, strict=True)), text)
        return units_of_columns

    if not columns or not meta.num_rows:
        raise without_numbers(path, findings)
    source = open_text("parquet", path, write, options)
    source.fields = [f for f in source.fields if f.channel not in durations]
    if not source.fields:
        raise without_numbers(path, findings)
    source.findings += findings
    source.reasons |= {"columns": len(schema.names), "row groups": meta.num_row_groups}
    source.reasons["written by"] = meta.created_by or ""
    return source


def _columns(table: Any) -> tuple[list[_ParquetColumn], list[Finding]]:
    """The columns that hold one value in a row; and findings on those that are not read."""
    columns, nested, findings = list[_ParquetColumn](), list[str](), list[Finding]()
    pairs = zip(table.schema, table.columns, strict=True)
    for f, c in chain.from_iterable(_leaf_columns(f, x.combine_chunks()) for f, x in pairs):
        if pa.types.is_integer(f.type) and (problem := open_scale(map(_text, f.metadata or ()))):
            names = {"reason": problem}
            findings.append(Finding("channel-not-read", "warning", c.title, 1, names=names))
        elif _is_any(c.array.type, (*_NUMBERS, *_TEXTS, pa.types.is_temporal)):
            columns.append(c)
        else:
            nested.append(c.title)
    if nested:
        names = {"columns": ", ".join(nested[:6])}
        findings.insert(0, Finding("nested-columns", "info", "", len(nested), names=names))
    return columns, findings


def _leaf_columns(f: Any, array: Any) -> Iterator[tuple[Any, _ParquetColumn]]:
    """The columns that a column of the file holds, each with its field in the file.

    Those of a structure are its fields, those of lists of numbers or structures their elements. A
    list that is shorter than others has nulls behind its end.
    """
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    name, unit = _pair(f.name)
    unit = _unit(f) or unit
    if pa.types.is_struct(array.type):
        for inner, values in zip(array.type, array.flatten(), strict=True):
            yield from _leaf_columns(inner.with_name(f"{f.name}.{inner.name}"), values)
        return
    is_list = _is_any(array.type, _LISTS) and _is_any(array.type.value_type, _ELEMENTS)
    longest = (pc.max(pc.list_value_length(array)).as_py() or 0) if is_list else 0
    if not 0 < longest <= _MOST_ELEMENTS:
        title = re.sub(r"\s*[\r\n]\s*", " ", name) or "(no name)"
        yield f, _ParquetColumn(title, unit, array)
        return
    padded = pc.list_slice(array, 0, longest, return_fixed_size_list=True)
    unit = unit or units.in_name(name)[1]  # which the place would hide
    metadata = {b"unit": unit.encode(), **(f.metadata or {})}
    for k in range(longest):
        element = pc.list_element(padded, k)
        yield from _leaf_columns(pa.field(f"{name}[{k}]", element.type, metadata=metadata), element)


def _pair(name: str) -> tuple[str, str]:
    """The name and the unit of a column that is called by a pair of texts, as pandas writes them.

    >>> _pair("('BC pressure', 'bar')"), _pair("('axle 1', 'speed')")
    (('BC pressure', 'bar'), ('axle 1 speed', ''))
    """
    if not re.fullmatch(r"\(('[^']*'(, )?)+\)", name):
        return name, ""
    *pieces, last_name = ast.literal_eval(name)
    is_unit = not last_name or units.unit(last_name) or units.rare_unit(last_name)
    unit = last_name if pieces and is_unit else ""
    return " ".join(piece for piece in (*pieces, *([] if unit else [last_name])) if piece), unit


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
    return next((_text(x) for k, x in metadata.items() if _UNIT_KEY.fullmatch(k)), "")


def _text(metadata: bytes) -> str:
    return metadata.decode("utf-8", "replace")
