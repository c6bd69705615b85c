"""Excel workbooks, by fastexcel: the cells of a sheet become lines of text, read as a text log.

So header, units and time are found by the rules of CSV. Line N of a message is row N of the sheet.
fastexcel rounds what it gives as text: numbers to nine decimals, times to milliseconds. As a number
it gives each cell as the file holds it, but none of a time. So a workbook is read twice, the second
time without its styles, which alone say that a number is a time.
"""

import re
import zipfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..core import toml, units
from ..core.errors import UserError, unknown
from ..core.finding import Finding, Severity
from ..core.text import listed
from .as_text import as_log
from .csv.header_words import speaks_of_time, time_name, unit_of
from .csv.reader import CsvSource, open_csv
from .isolated import Library
from .number_text import is_number
from .source import ReadOptions

_OLE = b"\xd0\xcf\x11\xe0"  # an .xls, or an encrypted workbook
_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
_STYLES = re.compile(rb"(?s)(PK\x03\x04.{26}|PK\x01\x02.{42})xl/styles\.")  # heads of a ZIP file
_MOST_BYTES = 4 << 30  # of all parts, unpacked

_TIME = r"^[0-9]{4}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(\.[0-9]+)?$"
_ANY_TIME = r"^\s*[0-9]{1,4}[-./:][0-9]{1,2}[-./:]"  # also as a text
_NUMBER = r"^-?[0-9]+(\.[0-9]+)?$"  # a text that Arrow reads as a number
_NUMBER_TEXT = r"^[+-]?[0-9]*[.,][0-9]+(\s?[^\d\s]\S*)?$"  # that may be a number, with a unit
_COUNTS = re.compile(r"[^\W\d] ?\d")  # as in "axle 1"
_DETAIL = re.compile(r"(?:(Error)|DurationIso)\(\"?(?:PT)?(\w+)(?:\.(\d+)S)?")
_ERRORS = {"Div0": "#DIV/0!", "NA": "#N/A", "Name": "#NAME?", "Null": "#NULL!", "Num": "#NUM!"}

_DAY = 86_400_000_000  # [µs]
_DAY_1899, _DAY_1904, _DAY_1906 = -25_568, -24_107, -23_376  # 31 December, 1 January; from 1970
_ROWS = 1 << 16  # written at once
_RESULTS = 100  # rows that a table of results has at most
_HEAD_ROWS = 60  # in which names and units stand
_OF_STATED_CHANNELS = "the one with most of the stated channels"  # why a sheet is read
_OF_BRAKE = "the first with a speed or a brake pressure"
_OF_NUMBERS = "the first with columns of numbers"
_MEASURED = ("pressure", "speed", "angular speed")


class SheetText(NamedTuple):
    """What was written."""

    names: list[str]  # of the sheets
    other_sheets: list[str]
    reason: str  # why these
    has_channels: bool  # a column of numbers is a time, or one of a brake
    is_part: bool  # other sheets are those of other axles, bogies or cars


class _Column(NamedTuple):
    """The cells of a column, Arrow arrays of shape (n,), null where a cell is empty."""

    text: Any
    number: Any  # also of texts that are one; of a time the days
    is_time: Any

    @property
    def is_of_numbers(self) -> bool:
        """Whether at least half of the cells are numbers or times, and two are."""
        is_typed = _matches(self.text, f"{_ANY_TIME}|{_NUMBER_TEXT}")
        is_typed = pc.or_(pc.is_valid(self.number), is_typed)
        cell_count = len(self.text) - self.text.null_count
        return bool((pc.sum(is_typed).as_py() or 0) >= max(2, cell_count / 2))

    def heads(self) -> list[str]:
        """The cells of its head, if it has numbers."""
        return self.text.slice(0, _HEAD_ROWS).drop_null().to_pylist() if self.is_of_numbers else []


class _Sheet(NamedTuple):
    """A visible sheet with two columns of numbers."""

    name: str
    columns: list[_Column]
    stated_count: int  # channels that the user states
    is_of_brake: bool
    is_log: bool

    @property
    def heads(self) -> list[tuple[str, ...]]:
        """The texts above the numbers of each column that is no time."""
        heads = [[x for x in c.heads() if not is_number(x)] for c in self.columns]
        return [tuple(x) for x in heads if x and not any(map(time_name, x))]

    @property
    def is_complete(self) -> bool:
        """Whether it has a pressure and a speed."""
        texts = [x for head in self.heads for x in head]
        dimensions = {unit.dimension for unit in map(unit_of, texts) if unit}
        return "pressure" in dimensions and bool(dimensions & {"speed", "angular speed"})

    @property
    def times(self) -> NDArray[np.float64]:
        """The numbers of its first time, shape (n,); none where they are texts."""
        times = (c.number.drop_null() for c in self.columns if any(map(time_name, c.heads())))
        return np.asarray(next(times, pa.array([], pa.float64())))


def write_text(
    path: Path, target: Path, options: ReadOptions, refused: Sequence[str] = (), joins: bool = True
) -> SheetText | None:
    """Writes the cells of a sheet as lines, tabs between them; row N of the sheet is line N.

    Where no sheet is stated it is the one with most of the stated channels, else the first visible
    one with columns of numbers, of which one is a brake's by name or unit, else the first with
    columns of numbers. `refused` are sheets that are no log: None where no other has columns of
    numbers. With `joins`, other sheets of the same log stand beside or below it.

    Raises:
        UserError: where the workbook cannot be read, or has no such sheet.
    """
    book, sheet_name = _Book(path), options.sheet
    if sheet_name is not None and sheet_name not in book.names:
        error = unknown("sheet", sheet_name, book.names)
        raise UserError(f"{path}: {error.text}", error.hint)
    if sheet_name is None:
        sheets = _sheets(book, [x for x in book.names if x not in refused], options)
        if not sheets and refused:
            return None
        if not sheets:
            hidden_sheets = [x for x in book.names if not book.columns(x)[1]]
            names = ", ".join(repr(x) + " (hidden)" * (x in hidden_sheets) for x in book.names)
            hint = f"state the sheet, as {option(book.names[0])}; sheets: {names}"
            raise UserError(f"{path}: no visible sheet has two columns of numbers", hint)
        best = max(sheets, key=lambda x: (x.stated_count, x.is_of_brake * (1 + x.is_log)))
        reason = _OF_BRAKE if best.is_of_brake else _OF_NUMBERS
        reason = _OF_STATED_CHANNELS if best.stated_count else reason
        part_names, columns = [best.name], best.columns
        logs = [x for x in sheets if x.is_of_brake and x.is_log]
        places = [x for x in logs if options.names_place and options.names_place(x.name)]
        are_places = len(places) > 1 and any(x is best for x in places)
        logs = places if are_places else logs  # without a summary beside them
        if joins and any(x is best for x in logs):
            part_names, columns = _joined(logs, are_places) or (part_names, columns)
        reason = "one log" if len(part_names) > 1 else reason
    else:
        part_names, reason, columns = [sheet_name], "stated", book.columns(sheet_name)[0]
        are_places = False
    other_sheets = [x for x in book.names if x not in part_names]
    if not columns:
        hint = "give a workbook with a log"
        if other_sheets:
            hint = f"state another sheet, as {option(other_sheets[0])}"
        raise UserError(f"{path}: sheet {sheet_name!r} is empty", hint)
    cells = [_quoted(_cells(column)) for column in _without_notes(columns)]
    with target.open("wb") as file:
        for begin in range(0, len(cells[0]), _ROWS):
            rows = pc.binary_join_element_wise(*(c.slice(begin, _ROWS) for c in cells), "\t")
            rows = pc.if_else(pc.match_substring_regex(rows, r"^\t*$"), "", rows)  # of blank cells
            file.write(("\n".join(rows.to_pylist()) + "\n").encode())
    has_channels = reason != _OF_NUMBERS or any(any(map(time_name, x.heads())) for x in columns)
    is_one_of_several = are_places and len(part_names) == 1
    return SheetText(part_names, other_sheets, reason, has_channels, is_one_of_several)


def _without_notes(columns: Sequence[_Column]) -> list[_Column]:
    """The columns without cells far from the table, which are no channel."""
    columns = [*columns]
    while len(columns) > 2 and len(columns[-1].text) - columns[-1].text.null_count < 2:
        columns.pop()
    return columns


def _sheets(book: "_Book", names: Sequence[str], options: ReadOptions) -> list[_Sheet]:
    """The visible sheets of these names that have two columns of numbers."""

    def says_brake(head: str) -> bool:
        unit = unit_of(head)
        is_measured = unit is not None and unit.dimension in _MEASURED
        return is_measured or (options.names_brake is not None and options.names_brake(head))

    wanted = [x for x in (options.time_channel, *options.named_channels) if x]
    sheets = []
    for name in names:
        columns, is_visible = book.columns(name)
        if not is_visible or sum(c.is_of_numbers for c in columns) < 2:
            continue
        heads = [c.heads() for c in columns]
        stated_count = sum(any(_is_named(x, k, h) for k, h in enumerate(heads, 1)) for x in wanted)
        is_of_brake = any(any(map(says_brake, cells)) for cells in heads)
        is_log = len(columns[0].text) > _RESULTS or any(any(map(speaks_of_time, x)) for x in heads)
        sheets.append(_Sheet(name, columns, stated_count, is_of_brake, is_log))
    return sheets


def _joined(sheets: Sequence[_Sheet], are_places: bool) -> tuple[list[str], list[_Column]] | None:
    """The names of sheets that are one log, and its columns; None where they are not.

    Sheets of other numbered channels stand beside the first, under their names where these say
    axle, bogie or car. Sheets of its channels that go on in time stand below it.
    """
    sheets = sorted(sheets, key=lambda x: -len(x.times))
    heads, times = [x.heads for x in sheets], [x.times for x in sheets]
    if len(sheets) < 2 or not all(map(len, times)):
        return None
    columns = [_without_notes(x.columns) for x in sheets]
    names = [x for own_heads in heads for x in own_heads]
    is_one_log = len({*names}) == len(names) and all(map(_COUNTS.search, map(str, heads)))
    is_one_log &= not all(x.is_complete for x in sheets)
    is_one_time = max(t[0] for t in times) < min(t[-1] for t in times)
    if is_one_time and (are_places or is_one_log) and all(_shows_pair(times[0], t) for t in times):
        length = max(len(x[0].text) for x in columns)
        side_columns = [
            _stacked(c, _blanks(length - len(c.text)))
            for name, own_columns in zip((x.name for x in sheets), columns, strict=True)
            for c in (_titled(name, own_columns) if are_places else own_columns)
        ]
        return [x.name for x in sheets], side_columns
    order = sorted(range(len(sheets)), key=lambda k: float(times[k][0]))
    have_equal_heads = len({*map(len, columns)}) == 1 and heads == [heads[0]] * len(heads)
    if have_equal_heads and all(times[a][-1] < times[b][0] for a, b in pairwise(order)):
        lower_columns = [_stacked(*x) for x in zip(*(columns[k] for k in order), strict=True)]
        return [sheets[k].name for k in order], lower_columns
    return None


def _titled(title: str, columns: Sequence[_Column]) -> list[_Column]:
    """The columns with a title before the name of each that is no time, in the row of its name."""
    heads = [[x or "" for x in c.text.slice(0, _HEAD_ROWS).to_pylist()] for c in columns]
    row = next(k for k, x in enumerate(zip(*heads, strict=True)) if any(map(time_name, x)))
    names = [cells[row] for cells in heads]
    titles = [{} if time_name(x) else {row: f"{title} {x}"} for x in names]
    pairs = zip(columns, titles, strict=True)
    return [c._replace(text=_with_cells(c.text, title_cells)) for c, title_cells in pairs]


def _blanks(n: int) -> _Column:
    cells = pa.nulls(n, pa.bool_())
    return _Column(cells.cast(pa.string()), cells.cast(pa.float64()), cells.fill_null(False))


def _stacked(*parts: _Column) -> _Column:
    return _Column(*map(pa.concat_arrays, zip(*parts, strict=True)))


def _shows_pair(first_times: NDArray[np.float64], other_times: NDArray[np.float64]) -> bool:
    """Whether the head of two times shows that they differ, if they do."""
    n = min(len(first_times), len(other_times), _HEAD_ROWS)
    is_equal_head = np.array_equal(first_times[:n], other_times[:n])
    return not is_equal_head or np.array_equal(first_times[: len(other_times)], other_times)


def _is_named(channel: str, number: int, heads: Sequence[str]) -> bool:
    """Whether a channel is stated by the number of a column, or by a name of one or several rows.

    A title above several columns stands in the first one only: the last cell of a name decides.
    """
    name = channel.strip().casefold()
    texts = (x.strip().casefold() for head in heads for x in (head, units.in_name(head)[0]))
    is_numbered = name == f"column {number}" * bool(heads)
    return is_numbered or any(f" {name}".endswith(f" {x}") for x in texts if x)


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
        columns = [self._column(_with_cells(x, details[k]), n) for k, (x, n) in enumerate(pairs)]
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


def _with_cells(text: Any, rows: dict[int, str]) -> Any:
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
    differs = pc.not_equal(pc.fill_null(text_value, 0.0), pc.fill_null(number, 0.0))
    is_rounded = pc.and_(is_number, differs)
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
    serial = (whole_days * _DAY + np.rint((days - whole_days) * _DAY)).astype(np.int64)
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
    quoted = pc.binary_join_element_wise('"', pc.replace_substring(cells, '"', '""'), '"', "")
    return pc.if_else(has_quote, quoted, cells)


_LIBRARY = Library("xlsx", "Excel", (), "")


def open_workbook(path: Path, options: ReadOptions) -> CsvSource:
    """Opens a sheet of a workbook (.xlsx, .xlsm, .xlsb, .xls or .ods) as a log.

    Raises:
        UserError: where the workbook cannot be read or has no such sheet, or the sheet is no log.
    """
    folder = TemporaryDirectory(prefix="adhesion-", ignore_cleanup_errors=True)
    text = Path(folder.name) / "sheet.txt"
    of_text = replace(options, encoding="utf-8", delimiter="\t", decimal=options.decimal or ".")
    refusals: dict[str, UserError] = {}  # a list of channels may stand before the samples
    joins = True
    while True:
        sheet: SheetText | None = _LIBRARY.call(path, write_text, text, options, [*refusals], joins)
        if sheet is None:
            raise next(iter(refusals.values()))
        others = sheet.other_sheets if options.sheet is None else []
        names = listed(sheet.names)
        place = f"{path}: sheet{'s' * (len(sheet.names) > 1)} {names}"
        try:
            source = open_csv(text, of_text, place)
            if source.fields or sheet.has_channels or not others:
                break
            error = UserError(f"{place}: holds no numbers over time", "give a sheet with a log")
        except UserError as refusal:
            error = refusal
        if len(sheet.names) > 1:
            joins = False
            continue
        if others:
            error.hint = f"{error.hint}; or state another sheet ({listed(others)}), as "
            error.hint += option(others[0])
        if sheet.has_channels or not others:
            raise error
        refusals[sheet.names[0]] = error
    as_log(source, "xlsx", path, folder)
    reason = "the first that is a log" if refusals else sheet.reason
    source.reasons = {"sheet": f"{names} ({reason})", **source.reasons}
    if others:
        for sheet_refusal in refusals.values():
            reason += f" ({sheet_refusal.text.removeprefix(f'{path}: ')})"
        values = {"sheet": names, "reason": reason, "others": listed(others)}
        values["option"] = option(others[0])
        severity: Severity = "warning" if sheet.is_part else "info"
        source.findings.append(Finding("one-sheet-read", severity, names=values))
    return source
