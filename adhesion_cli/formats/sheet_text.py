"""The cells of a sheet as lines of text, by calamine; runs in a process of its own."""

import csv
import re
from collections.abc import Iterable, Sequence
from datetime import date, datetime, time, timedelta
from itertools import dropwhile
from pathlib import Path
from typing import Any, NamedTuple

from ..core import toml, units
from ..core.errors import UserError, unknown
from .csv.header_words import time_name

_OLE = b"\xd0\xcf\x11\xe0"  # an .xls, or an encrypted workbook
_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
# A text that is a time, a duration, or a number with a decimal comma.
_TYPED = re.compile(r"\s*[0-9]{1,4}[-./:][0-9]{1,2}[-./:]|PT[0-9]|[+-]?[0-9]*,?[0-9]+$")
_HEAD_ROWS = 60  # in which names and units stand
_MEASURED = ("pressure", "speed", "angular speed")
_FIRST_DATE = datetime(1906, 1, 1)  # earlier ones are times of day, or durations
_DAY_ZERO = datetime(1904, 1, 1), datetime(1899, 12, 31)  # of Excel's two date systems


class SheetText(NamedTuple):
    """What was written."""

    name: str
    other_sheets: list[str]
    has_channels: bool  # a column of numbers is a time, or has the unit of a pressure or speed


def write_text(
    path: Path, target: Path, sheet_name: str | None, passed: Sequence[str] = ()
) -> SheetText | None:
    """Writes the cells of a sheet as lines; row N of the sheet is line N.

    Args:
        path: the workbook.
        target: the file to write; tabs are between its cells, the decimal mark is a point, in
            texts as they have it.
        sheet_name: as stated; None for the first visible one with columns of numbers.
        passed: sheets that are no log.

    Returns:
        What was written; None where no other sheet than those passed has columns of numbers.

    Raises:
        UserError: where the workbook cannot be read, or has no such sheet.
        ValueError: where it is damaged.
    """
    book = _open_book(path)
    names = book.sheet_names
    if sheet_name is not None and sheet_name not in names:
        error = unknown("sheet", sheet_name, names)
        raise UserError(f"{path}: {error.text}", error.hint)
    visible = [x.name for x in book.sheets_metadata if str(x.visible).endswith(".Visible")]
    unread = [x for x in names if x in visible and x not in passed]
    for name in unread if sheet_name is None else [sheet_name]:
        columns = _columns(book.get_sheet_by_name(name).to_python(skip_empty_area=False))
        numeric = sum(map(_is_of_numbers, columns))
        if sheet_name is not None or numeric > 1:
            break
    else:
        if passed:
            return None
        sheets = ", ".join(repr(x) + " (hidden)" * (x not in visible) for x in names)
        hint = f"state the sheet, as {option(names[0])}; sheets: {sheets}"
        raise UserError(f"{path}: no visible sheet has two columns of numbers", hint)
    others = [x for x in names if x != name]
    if not columns:
        hint = f"state another sheet, as {option(others[0])}" if others else "give one with a log"
        raise UserError(f"{path}: sheet {name!r} is empty", hint)
    with target.open("w", encoding="utf-8", newline="") as file:
        lines = csv.writer(file, delimiter="\t", lineterminator="\n")
        for row in zip(*map(_texts, columns), strict=True):
            lines.writerow(row if any(row) else ())
    return SheetText(name, others, any(map(_is_channel, columns)))


def option(name: str) -> str:
    """The option that states a sheet."""
    return toml.option(f"xlsx.sheet = {toml.quoted(name)}")


def _open_book(path: Path) -> Any:
    """The workbook.

    Raises:
        UserError: where it is encrypted, or no workbook.
        ValueError: where it is damaged.
    """
    import python_calamine as calamine

    with path.open("rb") as file:
        if file.read(4) == _OLE and _ENCRYPTED in file.read():
            hint = "open it in Excel, and save it without a password"
            raise UserError(f"{path}: the workbook is encrypted", hint)
    try:
        return calamine.CalamineWorkbook.from_path(path)
    except calamine.CalamineError as error:
        if "Cannot detect" in str(error):
            hint = "unpack it, and name the log that is in it"
            raise UserError(f"{path}: a ZIP archive, not a workbook", hint) from None
        raise ValueError(str(error)) from None


def _columns(rows: Sequence[Sequence[Any]]) -> list[tuple[Any, ...]]:
    """The columns from the first filled one on, without single cells behind the table."""
    columns = list(dropwhile(lambda cells: not _count(cells), zip(*rows, strict=True)))
    while columns and _count(columns[-1]) < (2 if len(columns) > 2 else 1):
        columns.pop()
    return columns


def _count(cells: Iterable[Any]) -> int:
    return sum(cell != "" for cell in cells)  # "" is an empty one, or an error


def _is_of_numbers(cells: Sequence[Any]) -> bool:
    """Whether at least half of the cells are numbers or times, and two are."""
    typed = sum(
        cell != "" and (not isinstance(cell, str) or _TYPED.match(cell) is not None)
        for cell in cells
    )
    return bool(typed >= max(2, _count(cells) / 2))


def _is_channel(cells: Sequence[Any]) -> bool:
    """Whether a column of numbers is a time by its head, or has the unit of a brake log."""
    heads = [cell for cell in cells[:_HEAD_ROWS] if isinstance(cell, str) and cell]
    found_units = (units.unit(x) or units.unit(units.in_name(x)[1]) for x in heads)
    is_measured = any(x is not None and x.dimension in _MEASURED for x in found_units)
    return _is_of_numbers(cells) and (is_measured or any(time_name(x) for x in heads))


def _texts(cells: Sequence[Any]) -> list[str]:
    """The cells of a column as a text log has them; times as dates, where most are whole days."""
    days = sum(type(cell) is date for cell in cells)
    is_day = 2 * days > sum(isinstance(cell, date) for cell in cells)
    return [_text(cell, is_day) for cell in cells]


def _text(cell: Any, is_day: bool) -> str:
    if isinstance(cell, str):
        return re.sub(r"[\t\r\n]+", " ", cell)
    if isinstance(cell, bool):
        return str(cell).lower()
    if type(cell) is date and not is_day:
        cell = datetime(cell.year, cell.month, cell.day)
    if isinstance(cell, datetime) and cell < _FIRST_DATE:
        cell -= _DAY_ZERO[cell < _DAY_ZERO[0]]
    if isinstance(cell, timedelta):
        minutes, seconds = divmod(cell, timedelta(minutes=1))
        return f"{minutes // 60:02d}:{minutes % 60:02d}:{seconds.total_seconds():09.6f}"
    if isinstance(cell, time | datetime | date):
        return str(cell)
    return repr(cell).removesuffix(".0")
