"""Excel workbooks: a sheet per table, each cell of the type that its column has.

A text is never a formula. Times are date cells in UTC. A cell without a finite value is empty. The
same tables give the same bytes.
"""

import io
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..core.errors import UserError
from ..core.text import printable

MAX_ROWS, MAX_COLUMNS = 1_048_576, 16_384  # of a sheet, the head among them

_MAX_TEXT = 32_767  # characters of a cell
_WIDTHS = 10, 40  # of a column in characters: at least and at most
_TIME = "yyyy-mm-dd hh:mm:ss.000"
_DAY = 86_400 * 10**9  # [ns]
_DAY_1970 = 25_569  # 1970-01-01 as a day of Excel
_CREATED = datetime(2000, 1, 1)  # the time of writing would make each file another one


class Sheet(NamedTuple):
    """A table that is to be written."""

    schema: Any  # of Arrow; a field states its unit in the metadata
    rows: int
    batches: Iterable[Any]  # Arrow record batches


def write_workbook(path: Path, sheets: Mapping[str, Sheet]) -> None:
    """Writes tables as sheets of these names, of 31 characters; a UserError for one too large."""
    from xlsxwriter import Workbook

    for schema, rows, _ in sheets.values():
        if rows >= MAX_ROWS or len(schema) > MAX_COLUMNS:
            text = f"an Excel sheet holds {MAX_ROWS - 1} rows and {MAX_COLUMNS} columns, "
            text += f"the table has {rows} and {len(schema)}"
            raise UserError(text, "write it as CSV, Parquet or MCAP")
    buffer = io.BytesIO()
    book = Workbook(buffer, {"constant_memory": True, "tmpdir": str(path.parent)})
    book.set_properties({"created": _CREATED})
    head = book.add_format({"bold": True, "bottom": 1})
    time = book.add_format({"num_format": _TIME})
    for name, (schema, _, batches) in sheets.items():
        sheet = book.add_worksheet(name)
        sheet.freeze_panes(1, 0)
        titles = [_title(column) for column in schema]
        for k, title in enumerate(titles):
            sheet.write_string(0, k, title, head)
        _write_rows(sheet, schema, batches, [len(title) for title in titles], time)
    book.close()
    path.write_bytes(buffer.getbuffer())


def _write_rows(
    sheet: Any, schema: Any, batches: Iterable[Any], widths: list[int], time: Any
) -> None:
    """The rows below the head, and the widths of the columns, at least those given."""
    columns: list[tuple[Callable[[Any], list[Any]], Callable[..., object], Any]] = []
    for kind in schema.types:  # its values, the method that writes one, and its format
        if pa.types.is_timestamp(kind):
            columns.append((_days, sheet.write_number, time))
        elif pa.types.is_boolean(kind):
            columns.append((pa.Array.to_pylist, sheet.write_boolean, None))
        elif pa.types.is_string(kind):
            columns.append((_texts, sheet.write_string, None))
        else:
            columns.append((_numbers, sheet.write_number, None))
    first = 1
    for batch in batches:
        cells = [values(x) for (values, *_), x in zip(columns, batch.columns, strict=True)]
        for row, in_row in enumerate(zip(*cells, strict=True), first):
            for k, (value, (_, write, style)) in enumerate(zip(in_row, columns, strict=True)):
                if value is not None:
                    write(row, k, value, style)
        first += len(batch)
        for k, (values, _, style) in enumerate(columns):
            texts = cells[k] if values is _texts else [_TIME] * bool(style)
            widths[k] = max(widths[k], *(len(x) for x in texts if x is not None), 0)
    for k, width in enumerate(widths):
        sheet.set_column(k, k, min(max(width + 2, _WIDTHS[0]), _WIDTHS[1]))


def _title(column: Any) -> str:
    """The head of a column: its name and unit; that of a time says that it is in UTC."""
    unit = (column.metadata or {}).get(b"unit", b"").decode()
    if pa.types.is_timestamp(column.type):
        unit = column.type.tz or ""
    return printable(f"{column.name} [{unit}]" if unit not in ("", "-") else column.name)


def _texts(array: Any) -> list[str | None]:
    return [None if x is None else printable(x)[:_MAX_TEXT] for x in array.to_pylist()]


class _Exact(float):
    """A number with all its digits; XlsxWriter formats others with 16."""

    def __format__(self, _: str) -> str:
        return repr(float(self))


def _numbers(array: Any) -> list[float | None]:
    numbers = pc.if_else(pc.is_finite(array), array, None).to_pylist()
    return [_Exact(x) if isinstance(x, float) else x for x in numbers]


def _days(array: Any) -> list[float | None]:
    """Times as days of Excel. Whole days are split off, as float64 does not hold nanoseconds."""
    ns = array.cast(pa.timestamp("ns", array.type.tz)).cast(pa.int64())
    days, time_of_day = np.divmod(np.asarray(ns.fill_null(0)), _DAY)
    return _numbers(
        pa.array(_DAY_1970 + days + time_of_day / _DAY, mask=~np.asarray(array.is_valid()))
    )
