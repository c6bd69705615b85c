"""Header, units and first data row of a table, found in the first rows of a file."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import UserError
from ...core.text import distinct
from .dialect import (
    fit,
    is_comment,
    is_null,
    is_number,
    is_stamp,
    number_grammar,
    split,
    uncommented,
)
from .head import Line, opens_quote
from .header_words import SIGNAL, UNITS, is_named, is_units_row, time_name

DELIMITERS = (";", "\t", ",", "|", " ")
_REMARKS = ("comment", "comments", "remark", "remarks", "kommentar", "bemerkung", "备注", "注释")
Row = tuple[int, list[str]]  # number of its line, and cells


@dataclass(slots=True)
class FirstRows:
    """The first rows of a file, split into cells."""

    lines: list[Line]  # all, comments too
    rows: list[Row]  # those that may be header or data
    delimiter: str
    width: int  # cells of a data row
    decimal: str
    path: Path

    @property
    def texts(self) -> dict[int, str]:
        """What the rows say, by the numbers of their lines."""
        of = {n for n, _ in self.rows}
        return {line.number: line.text for line in self.lines if line.number in of}

    def of_width(self, begin: int = 0) -> list[list[str]]:
        """Cells of the rows from `begin` on that have as many as a data row."""
        return [cells for _, cells in self.rows[begin:] if len(cells) == self.width]

    def later(self) -> list[list[str]]:
        """Cells of the rows that are surely data."""
        return self.of_width(len(self.rows) // 3)


@dataclass(slots=True)
class Header:
    """Where header and data stand: indices in `FirstRows.rows`."""

    names: list[list[str]]  # cells of its rows, top first
    units: int | None
    top: int  # the topmost of its rows
    start: int  # the first row of data

    def named(self, table: FirstRows) -> list[Row]:
        """The rows of names with the numbers of their lines; none where a comment names them."""
        return [row for row in table.rows[self.top : self.start] if row[1] in self.names]


def find_header(table: FirstRows, stated: bool | None) -> Header:
    """The header; `stated` says whether there is one, None where it is not stated.

    Raises:
        UserError: where there are no data rows.
    """
    start = _first_data(table)
    if start is None:
        raise UserError(
            f"{table.path}: no data rows under the header (no row of {table.width} cells holds "
            "numbers)",
            'give a log with data rows; if its numbers use a decimal comma, state decimal = "," '
            "under [csv]",
        )
    if stated is False:
        return Header([], None, start, start)
    found = _text_above(table, start)
    if found.names:
        return found
    if stated:
        if start + 1 >= len(table.rows):
            raise UserError(f"{table.path}: header only, no data rows", "give a log with data rows")
        return Header([table.rows[start][1]], None, start, start + 1)
    found.names = _commented_header(table, table.rows[start][0])
    if not found.names and table.delimiter == " " and start > 0:
        # blanks stand inside the names, above columns that blanks align: two are between names
        cells = re.split(r"\s{2,}|\t", table.texts[table.rows[start - 1][0]].strip())
        if len(cells) == table.width and _names_time(cells):
            return Header([cells], found.units, found.top - 1, start)
    return found


def _first_data(table: FirstRows) -> int | None:
    """Index of the first row that reads like the later rows."""
    number, width = number_grammar(table.decimal), table.width

    def typed(c: str) -> bool:
        return number.fullmatch(c) is not None or is_stamp(c)

    later = table.later()
    numeric = []
    for i in range(width if later else 0):
        said = [row[i] for row in later if not is_null(row[i])]
        if said and sum(map(typed, said)) >= 0.5 * len(said):
            numeric.append(i)

    def like(cells: list[str]) -> bool:
        remark = len(cells) == width + 1 and not is_null(cells[-1]) and not typed(cells[-1])
        if not later or (len(cells) != width and not remark):
            return False
        said = [cells[i] for i in numeric if not is_null(cells[i])]
        words = [c for c in said if not typed(c)]
        if any(map(time_name, words)):  # a header whose other names are numbers
            return False
        return len(words) < 0.5 * len(said)

    flags = [like(cells) for _, cells in table.rows]
    near = (flags[i : i + 6] for i in range(len(flags)))
    return next((i for i, f in enumerate(near) if f[0] and sum(f) >= 0.3 * len(f)), None)


def _text_above(table: FirstRows, start: int) -> Header:
    """Rows of text right above the data: names, of several rows, and units."""
    rows, width = table.rows, table.width
    number = number_grammar(table.decimal)

    def texts(k: int) -> bool:
        cells = rows[k][1]
        if not width - 1 <= len(cells) <= width + 1 or (len(cells) < width and width == 2):
            return False
        said = [c for c in cells if c]
        if any(map(time_name, said)):
            return True
        return bool(said) and not any(number.fullmatch(c) for c in said if c not in ("-", "1"))

    def of_units(k: int) -> bool:
        """Whether row k is a row of units below one of names."""
        if k < 1 or not (texts(k) and is_units_row(rows[k][1])):
            return False
        above = rows[k - 1][1]
        return texts(k - 1) and sum(map(bool, above)) >= len(above) / 2

    top, units = start, None
    if of_units(start - 1):
        top = units = start - 1
    elif of_units(start - 2) and texts(start - 1):  # remarks stand below the units
        top = units = start - 2
    names: list[list[str]] = []
    while top > 0 and len(names) < 4 and texts(top - 1):
        cells = rows[top - 1][1]
        if names and units is None and len(cells) == width and is_units_row(cells):
            top = units = top - 1  # above the names
            break
        if not _continues(names, cells, width):
            break
        names.insert(0, cells)
        top -= 1
    return Header(names, units, top, start)


def _continues(names: list[list[str]], cells: list[str], width: int) -> bool:
    """Whether a row of text above the header's rows so far is one of them."""
    said = sum(map(bool, cells))
    pairs = sum(bool(re.match(r"[^:=\[(]+[:=]\s*\S", c)) for c in cells)
    if not names:
        return said >= len(cells) / 2 and (pairs <= said / 2 or said == len(cells))
    repeated = len(set(names[0])) < len(names[0])
    spanning = repeated and said >= 2 and len(cells) == width
    full = width > 2 and said == len(cells) == width and len(names) < 2
    return pairs <= said / 2 and (spanning or full)


def _commented_header(table: FirstRows, first_line: int) -> list[list[str]]:
    """Names in the last comment line above the data, as numpy writes them."""
    for line in reversed(table.lines):
        if line.number < first_line and is_comment(line.text):
            cells = split(uncommented(line.text), table.delimiter)
            return [cells] if len(cells) == table.width and not any(map(is_number, cells)) else []
    return []


def _names_time(cells: list[str]) -> bool:
    """Whether a row reads like a header: a time among names, and no number."""
    return any(map(time_name, cells)) and not any(is_number(c) or is_stamp(c) for c in cells)


def take_labelled(table: FirstRows) -> list[Row]:
    """Takes out the rows that their first cell labels, where data rows leave it empty.

    Exports of TDMS channels have them below the header, as "Channel", "unit_string", "Length".
    """
    if any(cells[0] for cells in table.later()):
        return []
    rows = table.rows
    head = next((i for i, (_, cells) in enumerate(rows) if is_named(cells[0], SIGNAL)), len(rows))
    labelled = [(n, cells) for n, cells in rows[head + 1 :] if cells[0]]
    table.rows = [row for row in rows if row not in labelled]
    return labelled


def labelled_units(labelled: list[Row]) -> Row | None:
    """The row of units among rows that their first cell labels."""
    if any(cells[:2] == ["X_Columns", "Multi"] for _, cells in labelled):
        return None  # LabVIEW's with a time for each channel: the units have other places
    return next(((n, cells) for n, cells in labelled if is_named(cells[0], UNITS)), None)


def rows_above(table: FirstRows, top: int) -> tuple[tuple[int, int, str], ...]:
    """Lines above the header that are rows of another table: two or more, of one width.

    Each begins with a number or a stamp, as do half of its cells, whatever delimits them.
    """

    def form(text: str) -> tuple[str, int] | None:
        for delimiter in DELIMITERS:
            cells = split(text, delimiter)
            typed = [is_number(c) or is_stamp(c) for c in cells if not is_null(c)]
            if sum(typed) >= max(2, len(typed) / 2) and typed[0]:
                return delimiter, len(cells)
        return None

    texts, first = table.texts, table.rows[top][0]
    lines = [line for line in table.lines if line.number in texts and line.number < first]
    forms = [None, *(form(line.text) for line in lines), None]
    return tuple(
        (line.number, line.number + line.more, line.text)
        for k, line in enumerate(lines, 1)
        if forms[k] and forms[k] in (forms[k - 1], forms[k + 1])
    )


def refuse_width(table: FirstRows, header: Header, data: list[list[str]], width: int) -> None:
    """Refuses a header of another width than the rows.

    Raises:
        UserError: names both, and where the comma is decimal mark as well, that.
    """
    named = header.named(table)
    if not header.names:
        near = table.rows[max(0, header.top - 2) : header.top]
        named = [row for row in near if _names_time(row[1])]
    for n, cells in named:
        extra = [c for c in cells[width:] if c and c.casefold() not in _REMARKS]
        if len(cells) >= width and not extra:
            continue
        if opens_quote(table.texts[n]):
            raise UserError(
                f"{table.path}: the quote opened in line {n} does not close",
                "correct the quotes in that line",
            )
        text = f"{table.path}: the header (line {n}) names {len(cells)} columns, the rows have "
        said = [c for row in data for c in row if c]
        whole = table.delimiter == "," and all(re.fullmatch(r"[+-]?[0-9]+", c) for c in said)
        if whole and width > len(cells) and any(re.fullmatch("0[0-9]+", c) for c in said):
            raise UserError(
                f"{text}{width}: the comma is delimiter and decimal mark at once",
                "export it with semicolons between the cells, or with decimal points",
            )
        raise UserError(
            f"{text}{width}",
            "correct the header, or state header = false under [csv] and map the columns as "
            '"column 1", "column 2", …',
        )


def column_names(heads: list[list[str]], width: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Distinct names, and those that stand above several columns."""
    filled = [fit(cells, width) for cells in heads]
    for cells in filled[:-1]:  # a title above several columns stands in the first of them
        for i in range(1, width):
            cells[i] = cells[i] or cells[i - 1]
    names = [
        " ".join(dict.fromkeys(row[i] for row in filled if row[i])) or f"column {i + 1}"
        for i in range(width)
    ]
    return tuple(distinct(names)), tuple(n for n, k in Counter(names).items() if k > 1)


def lines_before(
    table: FirstRows, header: Header, above: Sequence[tuple[int, int, str]]
) -> tuple[dict[str, int], dict[str, tuple[int, str]]]:
    """Lines before the first data row: how many of each class, and the first of each.

    `above` are those that are rows of another table.
    """
    rows, top = table.rows, header.top
    others = {number for number, _, _ in above}

    def kind(line: Line) -> str:
        if not line.text.strip():
            return "blank"
        if "\0" in line.text:
            return "NUL bytes"
        if is_comment(line.text):
            return "comment"
        if top < header.start and line.number >= rows[top][0]:
            is_units = header.units is not None and line.number == rows[header.units][0]
            return "units" if is_units else "header"
        return "another table" if line.number in others else "preamble"

    before: Counter[str] = Counter()
    first: dict[str, tuple[int, str]] = {}
    for line in table.lines:
        if line.number < rows[header.start][0]:
            before[kind(line)] += 1
            before["inside quotes"] += line.more
            first.setdefault(kind(line), line[:2])
    return dict(+before), first


def metadata(preamble: list[Row]) -> dict[str, str]:
    """`key: value` and `key = value` cells, and rows of just a key and a value."""
    out: dict[str, str] = {}
    for _, cells in preamble:
        said = [c for c in cells if c]
        found = [m for c in said if (m := re.match(r"([^:=]{1,80}?)\s*[:=]\s*(.+)", c))]
        if len(found) == len(said):
            out.update((m[1], m[2]) for m in found)
        elif len(said) == 2:
            out[said[0].rstrip(" :=")] = said[1]
    return out
