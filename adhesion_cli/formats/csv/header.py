"""Header, units and first data row of a table, found in the first rows of a file."""

import re
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, groupby
from pathlib import Path

from ...core import toml
from ...core.errors import UserError
from ...core.text import distinct
from ...core.units import in_name
from ..number_text import is_number, number_grammar, number_of
from . import header_words
from .dialect import fit, is_comment, is_null, split, uncommented
from .header_words import TYPES, is_named, is_units_row, label, normal, speaks_of_time, time_name
from .lines import Line, first_numbers
from .stamps import is_stamp

DELIMITERS = (";", "\t", ",", "|", " ")
REMARKS = ("comment", "comments", "remark", "remarks", "kommentar", "bemerkung", "备注", "注释")
_OF_COLUMNS = ("factors", "resolution", "facts")  # labels of rows between names and data
_DATA_SHARE = 0.1  # of a column's cells in the head hold data
Row = tuple[int, list[str]]  # number of its line, and cells


@dataclass(frozen=True, slots=True)
class FirstRows:
    """The first rows of a file, split into cells."""

    lines: list[Line]  # all, comments too
    rows: list[Row]  # those that may be header or data
    delimiter: str
    width: int  # cells of a data row
    decimal: str
    path: Path

    def of_width(self, begin: int = 0) -> list[list[str]]:
        """Cells of the rows from `begin` on that have as many as a data row."""
        return [cells for _, cells in self.rows[begin:] if len(cells) == self.width]

    def refuse_another(self, top: int) -> None:
        """Refuses rows of another table above the header: two or more, of one width.

        Each begins with a number or a stamp, as do half of its cells, whatever delimits them. Rows
        that count from 0 or 1 are a list, as of channels, if they have texts or are as few as the
        columns.

        Raises:
            UserError: names the first.
        """

        def form(text: str) -> tuple[str, int, bool] | None:
            for delimiter in DELIMITERS:
                cells = [c for c in split(text, delimiter) if not is_null(c)]
                typed = [is_number(c) or is_stamp(c) for c in cells]
                if sum(typed) >= max(2, len(typed) / 2) and typed[0]:
                    return delimiter, len(split(text, delimiter)), all(typed)
            return None

        line_numbers = {n for n, _ in self.rows[:top]}
        lines = [line for line in self.lines if line[0] in line_numbers]
        for row_form, group in groupby(lines, lambda line: form(line[1])):
            rows = list(group)
            if row_form is None or len(rows) < 2:
                continue
            delimiter, _, has_no_text = row_form
            firsts = [split(text, delimiter)[0] for _, text in rows]
            is_list = any(firsts == [str(n + k) for k in range(len(rows))] for n in (0, 1))
            if not is_list or (has_no_text and len(rows) > self.width):
                text = f"{self.path}: line {rows[0][0]} and the next ones are rows of "
                text += f"another table than those below line {self.rows[top][0]}"
                raise UserError(text, "split the log there, and read each part by itself")

    def refuse_width(self, header: "Header", width: int) -> None:
        """Refuses a header of another width than the rows.

        Raises:
            UserError: names both.
        """
        named = header.named(self)
        if not header.names:
            neighbours = self.rows[max(0, header.top - 2) : header.top]
            named = [row for row in neighbours if any(map(time_name, row[1]))]
        for n, cells in named:
            extra = [c for c in cells[width:] if c and c.casefold() not in REMARKS]
            if len(cells) < width or extra:
                text = f"the header (line {n}) names {len(cells)} columns, the rows have {width}"
                by_number = 'channels.time = {channel = 1, unit = "s"}'
                raise UserError(
                    f"{self.path}: {text}",
                    "correct the header; or export with semicolons if the comma is the decimal "
                    "mark as well; or read it without a header, and state each channel by number, "
                    f"as {toml.option('csv.header = false', by_number)}",
                )


@dataclass(slots=True)
class Header:
    """Where header and data stand: indices in `FirstRows.rows`."""

    names: list[list[str]]  # cells of its rows, top first
    units: int | None
    top: int  # the topmost of its rows
    start: int  # the first row of data

    def named(self, table: FirstRows) -> list[Row]:
        """The rows of names with the numbers of their lines; none where a comment names them."""
        rows = table.rows[self.top : self.start]
        return [(n, x) for n, y in rows for x in self.names if y in (x, x[1:], x[:1] + x[2:])]


def find_header(table: FirstRows, has_header: bool | None) -> Header:
    """The header; `has_header` says whether there is one, None where it is not stated.

    Raises:
        UserError: where there are no data rows.
    """
    start = _first_data(table)
    if start is None:
        reason = f"no row of {table.width} cells holds numbers"
        text = f"{table.path}: no data rows under the header ({reason})"
        raise UserError(text, "give a log with data rows, its numbers as 1.5 or 1.5e3")
    if has_header is False:
        return Header([], None, start, start)
    begin = start  # of the data below rows that say something of the columns
    while label(table.rows[begin][1][0]) in _OF_COLUMNS and begin + 1 < len(table.rows):
        begin += 1
    columns = [*zip(*table.of_width(begin), strict=True)]
    for line, cells in table.rows[:begin]:
        kind = label(cells[0]) if len(cells) == table.width else ""
        number_cells = [k for k, cell in enumerate(cells) if number_of(cell) not in (None, 1.0)]
        if kind == "resolution":  # of counts; others have it
            number_cells = [k for k in number_cells if all(map(str.isdecimal, columns[k]))]
        if kind in ("factors", "resolution") and number_cells:
            text = f"{table.path}: line {line} states factors ({cells[0]!r}), and not whether the "
            hint = "multiply the numbers, and delete the line; or delete it, and state units with "
            hint += 'factors, as `--set "channels.pressure.unit=0.01 bar"`'
            raise UserError(f"{text}numbers below have them", hint)
    text_above = _text_above(table, start)
    _take_keyed_names(table, text_above)
    if text_above.names:
        text_above.start = begin + _numbers_columns(table, begin)
        return text_above
    if has_header:
        if start + 1 >= len(table.rows):
            raise UserError(f"{table.path}: header only, no data rows", "give a log with data rows")
        return Header([table.rows[start][1]], None, start, start + 1)
    text_above.names = _commented_header(table, table.rows[start][0])
    return text_above


def _take_keyed_names(table: FirstRows, header: Header) -> None:
    """Gives a header the names beside a key that each time has: "Name;p;Name;v" of TwinCAT."""
    rows = {
        normal(cells[0]): k
        for k, (_, cells) in enumerate(table.rows[: header.start])
        if len(cells) == table.width > 3 and len({*cells[::2]}) == 1
    }
    line, cells = table.rows[rows["offset"]] if "offset" in rows else (0, [])
    if {number_of(cell) for cell in cells[1::2]} - {0.0}:
        text = f"{table.path}: line {line} states {cells[0]}, and not whether the numbers below"
        raise UserError(f"{text} have it", "correct the numbers, and delete the line")
    if {"name", "sampletime[ms]"} <= rows.keys():
        header.top, header.units = rows["name"], None
        names = table.rows[header.top][1]
        header.names = [["Time [ms]" if k % 2 == 0 else cell for k, cell in enumerate(names)]]


def _numbers_columns(table: FirstRows, row: int) -> bool:
    """Whether a row numbers the columns, 1, 2, 3, as AiM writes: the times begin below 1."""
    cells, *following = (x for _, x in table.rows[row : row + 2])
    is_counted = cells == [str(k) for k in range(1, table.width + 1)]
    return is_counted and bool(following) and "" < following[0][0] < "1"


def _first_data(table: FirstRows) -> int | None:
    """Index of the first row that reads like the later rows."""
    width = table.width

    def typed(c: str) -> bool:
        return is_number(c) or is_stamp(c)

    begin = first_numbers([cells[0] for _, cells in table.rows])
    data_rows = table.of_width(max(len(table.rows) // 3, begin))  # surely data
    numeric = []
    for i in range(width if data_rows else 0):
        said = [row[i] for row in data_rows if not is_null(row[i])]
        if said and sum(map(typed, said)) >= 0.5 * len(said):
            numeric.append(i)

    @cache
    def resembles_data(row: int) -> bool:
        cells = table.rows[row][1]
        if is_units_row(cells) or (0 in numeric and _is_statistics(cells)):
            return False
        remark = len(cells) == width + 1 and not is_null(cells[-1]) and not typed(cells[-1])
        if not data_rows or (len(cells) != width and not remark):
            return False
        said = [cells[i] for i in numeric if not is_null(cells[i])]
        texts = [c for c in said if not typed(c)]
        if any(map(time_name, texts)):  # a header whose other names are numbers
            return False
        return len(texts) < 0.5 * len(said)

    def names_time(cells: list[str]) -> bool:
        return any(map(time_name, cells)) and not any(map(typed, cells))

    row_count = len(table.rows)
    header = next((i for i, (_, cells) in enumerate(table.rows) if names_time(cells)), 0)
    firsts = [cells[0] for _, cells in table.rows]
    if "names" in map(label, firsts) and "" in firsts:  # each row above the samples has a label
        header = firsts.index("")
    for first in filter(resembles_data, range(header, row_count)):
        flags = [resembles_data(row) for row in range(first, min(first + 6, row_count))]
        if sum(flags) >= 0.3 * len(flags):
            return first
    return None


def _text_above(table: FirstRows, start: int) -> Header:
    """Rows of text right above the data: names, of several rows, and units."""
    rows, width = table.rows, table.width
    number = number_grammar(table.decimal)

    def texts(k: int) -> bool:
        cells = rows[k][1] if k >= 0 else []
        if not width - 1 <= len(cells) <= width + 1 or (len(cells) < width and width == 2):
            return False
        said = [c for c in cells if c]
        if any(map(time_name, said)) or _is_statistics(cells):
            return True
        if any(map(is_stamp, said)):  # as of a trigger
            return False
        return bool(said) and not any(number.fullmatch(c) for c in said if c not in ("-", "1"))

    top, units = _below_names(table, start), None
    names: list[list[str]] = []
    data = table.of_width(start)
    filled = (sum(not is_null(cell) for cell in column) for column in zip(*data, strict=True))
    # the other columns of a spreadsheet hold notes beside the table
    data_columns = sum(n >= _DATA_SHARE * len(data) for n in filled)
    while len(names) < 4 and texts(top - 1):
        line, cells = rows[top - 1]
        between = [split(x, table.delimiter) for n, x in table.lines if line < n < rows[top][0]]
        if names and any(len(x) > 1 and any(map(is_number, x)) for x in between):
            break  # the row of another table
        if all(is_named(c, TYPES) for c in cells if c) or _is_statistics(cells):
            pass
        elif units is None and is_units_row(cells) and (names or texts(top - 2)):
            units = top - 1
        elif _continues(names, cells, width, data_columns):
            names.insert(0, cells)
        elif not names and not cells[0] and texts(top - 2):
            pass  # as of serial numbers
        else:
            break
        top -= 1
    return Header(names, units, top, start)


def _below_names(table: FirstRows, start: int) -> int:
    """The first row of data; or of those below names and units that say more, as catman writes."""
    for k in range(start - 2, max(start - 8, -1), -1):
        cells, has_units = table.rows[k][1], is_units_row(table.rows[k + 1][1])
        if len({*cells}) == len(cells) == table.width and any(map(speaks_of_time, cells)):
            is_complete = has_units or sum(bool(in_name(c)[1]) for c in cells) > table.width / 2
            is_named = is_null(table.rows[k + 1 + has_units][1][0])  # the row below is a part
            return k + 1 + has_units if is_complete and not is_named else start
    return start


def _is_statistics(cells: list[str]) -> bool:
    """Whether a row states the largest numbers, the mean or such of the columns."""
    return bool(cells) and header_words.is_statistic(cells[0]) and any(map(is_number, cells))


def _continues(names: list[list[str]], cells: list[str], width: int, data_columns: int) -> bool:
    """Whether a row of text above the header's rows so far, of cells `names`, is one of them."""
    said = sum(map(bool, cells))
    pairs = sum(bool(re.match(r"[^:=\[(]+[:=]\s*\S", c)) for c in cells)
    if not names:
        if said == 1 and time_name(cells[0]):  # as pandas writes the name of its index
            return True
        return said >= data_columns / 2 and (pairs <= said / 2 or said >= data_columns)
    columns = list(zip(*_spread(names), strict=False))
    titled = list(zip(*_spread([cells, *names]), strict=False))
    spanning = said >= 2 and len(cells) == width and len(set(titled)) > len(set(columns))
    # a time above a column without a name: the two cells were one in a spreadsheet
    is_merged = any(time_name(c) for c, n in zip(cells, names[0], strict=False) if not n)
    is_complete = width > 2 and said >= data_columns and len(cells) == width and len(names) < 2
    return pairs <= said / 2 and (spanning or is_merged or is_complete)


def _commented_header(table: FirstRows, first_line: int) -> list[list[str]]:
    """Names in the last comment line above the data, as numpy writes them."""
    for number, text in reversed(table.lines):
        if number < first_line and is_comment(text):
            cells = split(uncommented(text), table.delimiter)
            return [cells] if len(cells) == table.width and not any(map(is_number, cells)) else []
    return []


def column_names(heads: list[list[str]], width: int) -> tuple[str, ...]:
    """Distinct names of the columns."""
    filled = _spread([fit(cells, width) for cells in heads])
    titles = [[row[i] for row in filled if row[i].strip("-")] for i in range(width)]
    names = [" ".join(dict.fromkeys(x)) or f"column {i}" for i, x in enumerate(titles, 1)]
    return tuple(distinct(names))


def _spread(heads: list[list[str]]) -> list[list[str]]:
    """The rows of a header with each title above all its columns; it stands in the first."""

    def last_title(title: str, cell: str) -> str:
        return cell or title

    return [*(list(accumulate(cells, last_title)) for cells in heads[:-1]), *heads[-1:]]
