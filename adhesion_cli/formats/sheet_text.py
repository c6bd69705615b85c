"""The cells of a sheet as lines of text, by fastexcel; runs in a process of its own.

fastexcel rounds what it gives as text: numbers to nine decimals, times to milliseconds. As a number
it gives each cell as the file holds it, but none of a time. So a workbook is read twice, the second
time without its styles, which alone say that a number is a time.
"""

import re
import zipfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..core import toml, units
from ..core.errors import UserError, unknown
from .csv.header_words import speaks_of_time, time_name

_OLE = b"\xd0\xcf\x11\xe0"  # an .xls, or an encrypted workbook
_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
_STYLES = re.compile(rb"(?s)(PK\x03\x04.{26}|PK\x01\x02.{42})xl/styles\.")  # heads of a ZIP file
_MOST_BYTES = 4 << 30  # of all parts, unpacked

_TIME = r"^[0-9]{4}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(\.[0-9]+)?$"
_ANY_TIME = r"^\s*[0-9]{1,4}[-./:][0-9]{1,2}[-./:]"  # also as a text
_NUMBER = r"^-?[0-9]+(\.[0-9]+)?$"  # a text that Arrow reads as a number
_WITH_COMMA = r"^[+-]?[0-9]*,[0-9]+$"  # a text that may be a number
_DETAIL = re.compile(r"(?:(Error)|DurationIso)\(\"?(?:PT)?(\w+)(?:\.(\d+)S)?")
_ERRORS = {"Div0": "#DIV/0!", "NA": "#N/A", "Name": "#NAME?", "Null": "#NULL!", "Num": "#NUM!"}

_DAY = 86_400_000_000  # [µs]
_DAY_1899, _DAY_1904, _DAY_1906 = -25_568, -24_107, -23_376  # 31 December, 1 January; from 1970
_ROWS = 1 << 16  # written at once
_RESULTS = 100  # rows that a table of results has at most
_HEAD_ROWS = 60  # in which names and units stand
_OF_STATED = "the one with most of the stated channels"  # why a sheet is read
_OF_BRAKE = "the first with a speed or a brake pressure"
_OF_NUMBERS = "the first with columns of numbers"
_MEASURED = ("pressure", "speed", "angular speed")


class SheetText(NamedTuple):
    """What was written."""

    name: str
    other_sheets: list[str]
    reason: str  # why this one
    has_channels: bool  # a column of numbers is a time, or one of a brake


class _Column(NamedTuple):
    """The cells of a column, Arrow arrays of shape (n,), null where a cell is empty."""

    text: Any
    number: Any  # also of texts that are one; of a time the days
    is_time: Any

    @property
    def is_of_numbers(self) -> bool:
        """Whether at least half of the cells are numbers or times, and two are."""
        is_typed = _matches(self.text, f"{_ANY_TIME}|{_WITH_COMMA}")
        is_typed = pc.or_(pc.is_valid(self.number), is_typed)
        cell_count = len(self.text) - self.text.null_count
        return bool((pc.sum(is_typed).as_py() or 0) >= max(2, cell_count / 2))

    def heads(self) -> list[str]:
        """The cells of its head, if it has numbers."""
        return self.text.slice(0, _HEAD_ROWS).drop_null().to_pylist() if self.is_of_numbers else []


def write_text(
    path: Path,
    target: Path,
    sheet_name: str | None,
    names_brake: Callable[[str], bool] | None = None,
    passed: Sequence[str] = (),
    stated: Sequence[str] = (),
) -> SheetText | None:
    """Writes the cells of a sheet as lines, tabs between them; row N of the sheet is line N.

    Without `sheet_name` it is the one with most of the `stated` channels, else the first visible
    one with columns of numbers, of which one is a brake's by name or unit, else the first with
    columns of numbers. `passed` are sheets that are no log: None where no other has columns of
    numbers.

    Raises:
        UserError: where the workbook cannot be read, or has no such sheet.
    """
    book = _Book(path)
    if sheet_name is not None and sheet_name not in book.names:
        error = unknown("sheet", sheet_name, book.names)
        raise UserError(f"{path}: {error.text}", error.hint)

    def says_brake(head: str) -> bool:
        unit = units.unit(head) or units.unit(units.in_name(head)[1])
        is_measured = unit is not None and unit.dimension in _MEASURED
        return is_measured or (names_brake is not None and names_brake(head))

    if sheet_name is None:
        unread = [x for x in book.names if x not in passed]
        choice = _choice(book, unread, says_brake, stated)
        if choice is None and passed:
            return None
        if choice is None:
            hidden_sheets = [x for x in book.names if not book.columns(x)[1]]
            sheets = ", ".join(repr(x) + " (hidden)" * (x in hidden_sheets) for x in book.names)
            hint = f"state the sheet, as {option(book.names[0])}; sheets: {sheets}"
            raise UserError(f"{path}: no visible sheet has two columns of numbers", hint)
        name, reason, columns = choice
    else:
        name, reason, columns = sheet_name, "stated", book.columns(sheet_name)[0]
    place = f"{path}: sheet {name!r}"
    if not columns:
        other_sheets = [x for x in book.names if x != name]
        hint = "give a workbook with a log"
        if other_sheets:
            hint = f"state another sheet, as {option(other_sheets[0])}"
        raise UserError(f"{place} is empty", hint)
    while len(columns) > 2 and len(columns[-1].text) - columns[-1].text.null_count < 2:
        columns.pop()  # a cell far from the table is no channel
    cells = [_quoted(_cells(column)) for column in columns]
    with target.open("wb") as file:
        for begin in range(0, len(cells[0]), _ROWS):
            rows = pc.binary_join_element_wise(*(c.slice(begin, _ROWS) for c in cells), "\t")
            rows = pc.if_else(pc.match_substring_regex(rows, r"^\t*$"), "", rows)  # of blank cells
            file.write(("\n".join(rows.to_pylist()) + "\n").encode())
    other_sheets = [x for x in book.names if x != name]
    has_channels = reason != _OF_NUMBERS or any(any(map(time_name, x.heads())) for x in columns)
    return SheetText(name, other_sheets, reason, has_channels)


def _choice(
    book: "_Book", names: Sequence[str], says_brake: Callable[[str], object], stated: Sequence[str]
) -> tuple[str, str, list[_Column]] | None:
    """The sheet to read, why, and its columns; None where no visible one has two of numbers."""
    best_rank, choice = (-1, False, False), None
    for name in names:
        columns, is_visible = book.columns(name)
        if not is_visible or sum(c.is_of_numbers for c in columns) < 2:
            continue
        heads = [c.heads() for c in columns]
        stated_count = sum(any(_is_named(x, k, h) for k, h in enumerate(heads, 1)) for x in stated)
        is_of_brake = any(any(map(says_brake, cells)) for cells in heads)
        is_log = len(columns[0].text) > _RESULTS or any(any(map(speaks_of_time, x)) for x in heads)
        if (rank := (stated_count, is_of_brake, is_of_brake and is_log)) > best_rank:
            best_rank = rank
            reason = _OF_STATED if stated_count else _OF_BRAKE if is_of_brake else _OF_NUMBERS
            choice = name, reason, columns
        if is_of_brake and is_log and not stated:
            break
    return choice


def _is_named(channel: str, number: int, heads: Sequence[str]) -> bool:
    """Whether a channel is stated by the number of a column, or by a name of one or several rows.

    A title above several columns stands in the first one only: the last cell of a name decides.
    """
    name = channel.strip().casefold()
    texts = (x.strip().casefold() for head in heads for x in (head, units.in_name(head)[0]))
    return name == f"column {number}" * bool(heads) or any(
        f" {name}".endswith(f" {x}") for x in texts if x
    )


def option(name: str) -> str:
    """The option that states a sheet."""
    return toml.option(f"xlsx.sheet = {toml.quoted(name)}")


class _Book:
    def __init__(self, path: Path) -> None:
        import fastexcel

        data = path.read_bytes()
        if not data.startswith(_OLE):
            _check_parts(path)
        elif _ENCRYPTED in data:
            hint = "open it in Excel, and save it without a password"
            raise UserError(f"{path}: the workbook is encrypted", hint)
        unstyled = _STYLES.sub(rb"\1xl/styles_", data)
        self._has_serials = unstyled != data
        self._text, self._number = fastexcel.read_excel(data), fastexcel.read_excel(unstyled)
        self.names = self._text.sheet_names

    def columns(self, name: str) -> tuple[list[_Column], bool]:
        """The columns of a sheet from its first filled one on, and whether people see it."""
        sheet = self._text.load_sheet(name, header_row=None, skip_rows=0, dtypes="string")
        texts, errors = sheet.to_arrow_with_errors()
        details: dict[int, dict[int, str]] = defaultdict(dict)  # by column and row
        for error in errors.errors if errors else ():
            row, column = error.offset_position
            details[column][row] = _detail(error.detail)
        is_visible = sheet.visible == "visible"
        del sheet  # one of the two in memory is enough
        sheet = self._number.load_sheet(name, header_row=None, skip_rows=0, dtypes="float")
        pairs = zip(texts.columns, sheet.to_arrow().columns, strict=True)
        columns = [self._column(_with(x, details[k]), n) for k, (x, n) in enumerate(pairs)]
        return columns, is_visible

    def _column(self, text: Any, number: Any) -> _Column:
        text = pc.if_else(pc.equal(text, ""), None, text)
        number = pc.if_else(pc.is_finite(number), number, None)
        is_time = _matches(text, _TIME)
        if self._has_serials:  # else nothing tells a time from its text
            is_time = pc.and_(is_time, pc.is_valid(number))
        return _Column(text, number, is_time)


def _check_parts(path: Path) -> None:
    """Refuses a ZIP file that is no workbook, unpacks to too much, or is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            if not any(x.startswith("xl/") or x == "content.xml" for x in archive.namelist()):
                hint = "unpack it, and name the log that is in it"
                raise UserError(f"{path}: a ZIP archive, not a workbook", hint)
            size = sum(member.file_size for member in archive.infolist())
            if size > _MOST_BYTES:
                text = f"{path}: unpacks to {size >> 30} GiB, more than {_MOST_BYTES >> 30}"
                raise UserError(text, "delete the sheets that are not needed, or export it as CSV")
            damaged_member = archive.testzip()
    except zipfile.BadZipFile as error:
        raise ValueError(str(error)) from None
    if damaged_member:
        raise ValueError(f"its part {damaged_member} has changed")


def _matches(text: Any, pattern: str) -> Any:
    return pc.fill_null(pc.match_substring_regex(text, pattern), False)


def _detail(detail: str) -> str:
    """The cell that fastexcel describes where it gives no text: an error, or a time of LibreOffice.

    >>> _detail("Expected string but got 'Error(Div0)'")
    '#DIV/0!'
    >>> _detail("Expected string but got 'DurationIso(PT26H00M01.25S)'")
    '26:00:01.25'
    """
    match = _DETAIL.search(detail)
    if match is None:
        return ""
    if match[1]:
        return _ERRORS.get(match[2], f"#{match[2].upper()}!")
    return ":".join(re.findall("[0-9]+", match[2])) + (f".{match[3]}" if match[3] else "")


def _with(text: Any, rows: dict[int, str]) -> Any:
    """The text with other cells in some rows."""
    if not rows:
        return text
    mask = np.zeros(len(text), np.bool_)
    mask[list(rows)] = True
    return pc.replace_with_mask(text, mask, pa.array([rows[k] for k in sorted(rows)], text.type))


def _cells(column: _Column) -> Any:
    """The cells of a column as a text log has them, each number with all its digits."""
    text, number, is_time = column
    is_number = pc.and_(pc.is_valid(number), _matches(text, _NUMBER))
    text_value = pc.cast(pc.if_else(is_number, text, None), pa.float64())
    is_rounded = pc.and_(
        is_number, pc.not_equal(pc.fill_null(text_value, 0.0), pc.fill_null(number, 0.0))
    )
    cells = pc.if_else(is_rounded, pc.cast(number, pa.string()), text)
    return pc.if_else(is_time, _times(column), cells) if pc.any(is_time).as_py() else cells


def _times(column: _Column) -> Any:
    text, number, is_time = column
    stamps = pc.utf8_slice_codeunits(pc.replace_substring(text, "T", " "), 0, 26)
    try:
        t = pc.cast(pc.if_else(is_time, stamps, None), pa.timestamp("us")).cast(pa.int64())
    except pa.ArrowInvalid:  # a text that is no date
        return text
    us, days = np.asarray(t.fill_null(0)), np.asarray(number.fill_null(0.0))
    has_serial = np.asarray(pc.and_(is_time, pc.is_valid(number)))
    whole_days = np.floor(days)
    serial = whole_days.astype(np.int64) * _DAY + np.rint((days - whole_days) * _DAY).astype(
        np.int64
    )
    # the text shows to which of Excel's two date systems the number belongs
    us = np.where(has_serial, serial + np.rint((us - serial) / _DAY).astype(np.int64) * _DAY, us)
    day_zero = np.where(us < _DAY_1904 * _DAY, _DAY_1899, _DAY_1904)
    elapsed_us = np.where(has_serial, serial, us - day_zero * _DAY)
    is_date = us >= _DAY_1906 * _DAY
    cells = pa.array(np.where(is_date, us, elapsed_us), pa.timestamp("us")).cast(pa.string())
    hours = pc.utf8_lpad(pc.cast(pa.array(elapsed_us // (_DAY // 24)), pa.string()), 2, "0")
    clock = pc.binary_join_element_wise(hours, pc.utf8_slice_codeunits(cells, 13), "")
    is_day = is_date & (us % _DAY == 0)
    if 2 * np.count_nonzero(is_day) > np.count_nonzero(is_date & np.asarray(is_time)):
        cells = pc.if_else(is_day, pc.utf8_slice_codeunits(cells, 0, 10), cells)
    return pc.if_else(is_date, cells, clock)


def _quoted(cells: Any) -> Any:
    """The cells without tabs and line ends; with the quotes that a text log needs."""
    cells = pc.fill_null(cells, "")
    if pc.any(pc.match_substring_regex(cells, r"[\t\r\n]")).as_py():
        cells = pc.replace_substring_regex(cells, r"[\t\r\n]+", " ")
    has_quote = pc.match_substring(cells, '"')
    if pc.any(has_quote).as_py():
        quotes_doubled = pc.replace_substring(cells, '"', '""')
        cells = pc.if_else(
            has_quote, pc.binary_join_element_wise('"', quotes_doubled, '"', ""), cells
        )
    return cells
