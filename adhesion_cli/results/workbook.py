"""Excel workbooks: a sheet per table, each cell of the type that its column has.

A text is never a formula. Times are date cells in UTC. A cell without a finite value is empty. The
same tables give the same bytes.
"""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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


class _SheetColumn(NamedTuple):
    """How the cells of a column are written."""

    values: Callable[[Any], list[Any]]  # of an Arrow array, None for an empty cell
    write: Callable[..., object]  # a method of the sheet
    style: Any


@contextmanager
def workbook(path: Path) -> Iterator["Workbook"]:
    """A workbook that is written when the context ends without an error."""
    from xlsxwriter import Workbook as Writer

    buffer = io.BytesIO()
    writer = Writer(buffer, {"constant_memory": True, "tmpdir": str(path.parent)})
    writer.set_properties({"created": _CREATED})
    yield Workbook(writer)
    writer.close()
    path.write_bytes(buffer.getbuffer())


class Workbook:
    """A workbook that is being written; see `workbook`."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._head = writer.add_format({"bold": True, "bottom": 1})
        self._time = writer.add_format({"num_format": _TIME})

    def check(self, rows: int, columns: int) -> None:
        """Refuses, by a UserError, a table that is larger than a sheet."""
        if rows >= MAX_ROWS or columns > MAX_COLUMNS:
            text = f"an Excel sheet holds {MAX_ROWS - 1} rows and {MAX_COLUMNS} columns, "
            text += f"the table has {rows} and {columns}"
            raise UserError(text, "write it as CSV, Parquet or MCAP")

    def sheet(self, name: str, schema: Any) -> "Sheet":
        """Adds an empty sheet.

        The name has 31 characters at most. A field of the schema states its unit in the metadata.
        """
        sheet = self._writer.add_worksheet(name)
        sheet.freeze_panes(1, 0)
        for k, column in enumerate(schema):
            sheet.write_string(0, k, _title(column), self._head)
        return Sheet(sheet, [self._column(sheet, column.type) for column in schema], schema)

    def _column(self, sheet: Any, kind: Any) -> _SheetColumn:
        if pa.types.is_timestamp(kind):
            return _SheetColumn(_days, sheet.write_number, self._time)
        if pa.types.is_boolean(kind):
            return _SheetColumn(pa.Array.to_pylist, sheet.write_boolean, None)
        if pa.types.is_string(kind):
            return _SheetColumn(_texts, sheet.write_string, None)
        return _SheetColumn(_numbers, sheet.write_number, None)


class Sheet:
    """A sheet that is being written; `write_batch` is that of Arrow's writers."""

    def __init__(self, sheet: Any, columns: list[_SheetColumn], schema: Any) -> None:
        self._sheet, self._columns, self._row = sheet, columns, 0
        self._widths = [len(_title(column)) for column in schema]

    def write_batch(self, batch: Any) -> None:
        """Adds the rows of an Arrow record batch."""
        cells = [c.values(array) for c, array in zip(self._columns, batch.columns, strict=True)]
        for values in zip(*cells, strict=True):
            self._row += 1
            for k, value in enumerate(values):
                if value is not None:
                    _, write, style = self._columns[k]
                    write(self._row, k, value, style)
        for k, column in enumerate(self._columns):
            texts = cells[k] if column.values is _texts else [_TIME] * bool(column.style)
            longest = max((len(x) for x in texts if x is not None), default=0)
            self._widths[k] = max(self._widths[k], longest)
            width = min(max(self._widths[k] + 2, _WIDTHS[0]), _WIDTHS[1])
            self._sheet.set_column(k, k, width)


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
