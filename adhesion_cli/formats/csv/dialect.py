"""How a text log is written: its cells, numbers and columns."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from ...core.units import in_name, unit
from ..number_text import is_number, number_grammar
from .header_words import UNITS, is_named, is_units_row, label, normal, time_name
from .stamps import is_stamp

HEAD_BYTES = 1 << 20

NULLS = (
    "",
    *"NaN nan NAN -nan nan(ind) -nan(ind) NULL null Null (null) <NULL> \\N".split(),
    *(f"{x}.#{y}" for x in ("1", "-1") for y in ("IND", "IND00", "QNAN", "QNAN0", "SNAN")),
    *"None none N/A n/a NA - -- --- #N/A #NA #NV".split(),
)
INFINITE = tuple(
    "inf -inf +inf Inf -Inf +Inf INF -INF +INF Infinity -Infinity infinity -infinity"
    " 1.#INF -1.#INF 1.#INF00 -1.#INF00".split()
)
_NULLS = frozenset((*NULLS, *INFINITE))

# What makes a cell a text, in Excel.
TEXT_MARK = re.compile(r"""^(?:'|=")([-+.,0-9][^"]*?)["']?$""")
COMMENT = re.compile(  # also the lines of a drawn table
    r"\s*(#(?!N/?A\b|NV\b|DIV/0|VALUE!|REF!|NAME\?|NUM!|NULL!)|%|//|\+?-{3,}\+[-+]*$)"
)


@dataclass(frozen=True, slots=True)
class Dialect:
    """How to read one file; `reasons` gives each decision with its reason."""

    width: int  # cells of each data row, one more than `names` where rows end in a delimiter
    names: tuple[str, ...]  # one per column, distinct: the header text, else "column N"
    header_cells: tuple[tuple[str, ...], ...]  # of each row of the header
    units: tuple[str, ...]  # units row, "" where a cell is empty
    rows: list[list[str]]  # data rows of the head, each as wide as `names`, without `removals`
    encoding: str = "utf-8"  # Python codec; UTF-8 passes through undecoded
    delimiter: str = ","  # one character; " " stands for runs of spaces and tabs
    decimal: str = "."
    headed: bool = True
    first_line: int = 1  # line of the first data row, from 1
    reasons: dict[str, str] = field(default_factory=dict)
    # what numbers do not need, by column: a pattern, of which group 1 stays
    removals: dict[int, str] = field(default_factory=dict)
    labels: dict[str, list[str]] = field(default_factory=dict)  # rows above the table, see `label`
    has_remarks: bool = False  # a row may have a comment behind its cells
    segments: tuple[str, ...] = ()  # first cells of a header that comes again, as in LVM files
    preamble: tuple[str, ...] = ()  # lines above the header, which may come again
    unit_source: str = "units row"  # where the units stand

    def column(self, index: int) -> list[str]:
        """Non-null cells of a column in the head's rows."""
        return [c for row in self.rows if (c := row[index]) not in _NULLS]

    def mark(self, index: int) -> str:
        """The decimal mark of a column: that of the log, unless its cells have only the other."""
        cells, other_mark = self.column(index), "." if self.decimal == "," else ","
        marked = any(other_mark in c for c in cells) and not any(self.decimal in c for c in cells)
        marked = marked and all(map(number_grammar(other_mark).fullmatch, cells))
        return other_mark if marked else self.decimal

    def numbers(self, index: int) -> list[float]:
        """Numbers of a column in the head's rows."""
        number = number_grammar(self.mark(index))
        cells = (c for c in self.column(index) if number.fullmatch(c))
        return [float(c.replace(",", ".")) for c in cells]

    def is_numeric(self, index: int) -> bool:
        """Whether at least half of a column's cells in the head's rows are numbers."""
        return 2 * len(self.numbers(index)) >= len(self.column(index))

    def unit_beside(self, index: int) -> str:
        """The unit that each row of the head has in the column behind, "" for none."""
        k = index + 1
        if k >= len(self.names) or not self.headed or not is_named(self.header_cells[-1][k], UNITS):
            return ""
        cells = {row[k] for row in self.rows} - _NULLS
        return cells.pop() if len(cells) == 1 and all(map(unit, cells)) else ""

    def repeats_header(self, cells: list[str]) -> bool:
        """Whether a row among the data is a row of the header, or the units row, once more."""
        if cells[0] in self.segments and not self.is_another_header(cells):
            return True
        rows = (row for row in (*self.header_cells, self.units) if any(row))
        return _key(cells[: len(self.names)]) in map(_key, rows)

    def is_another_header(self, cells: list[str]) -> bool:
        """Whether a row among the data is a header, or a units row, of other columns than ours."""
        said = [c for c in cells if c]
        if cells[0] in self.segments:
            kind = label(cells[0])
            return kind in ("units", "interval") and [c for c in self.labels[kind] if c] != said
        if not self.headed or len(said) < max(2, len(cells) / 2):
            return False
        if not time_name(cells[0]) and cells[1:] in [[*row[1:]] for row in self.header_cells]:
            return False  # of a table of statistics
        if is_units_row(cells):
            own_units = [u or in_name(n)[1] for n, u in zip(self.names, self.units, strict=True)]
            pairs = zip(_key(own_units), _key(cells), map(without_brackets, cells), strict=False)
            return any(a != b and unit(text) for a, b, text in pairs)
        units = sum(bool(in_name(c)[1]) for c in said)
        names_time = any(map(time_name, said)) or units >= len(said) / 2
        return names_time and not any(map(is_number, said))


def _key(cells: Sequence[str]) -> list[str]:
    """The cells of a header or units row as they are compared."""
    return "\0".join(normal(without_brackets(c)) for c in cells).rstrip("\0").split("\0")


def stamps_in(lines: Sequence[str], delimiter: str) -> dict[str, str]:
    """Dates and times that lines state, by the words before each.

    >>> stamps_in(["Start: 24.11.2026 10:15:00", "Rate;50"], ";")
    {'Start': '24.11.2026 10:15:00'}
    """
    stamps = {}
    for line in map(uncommented, lines):
        line = line.rstrip(f" {delimiter}")
        match = re.match(r"([^\d:=]*[^\d:=\s])(?:\s*[:=]\s*|\s+)(.*)", line)
        label, *cells = split(line, delimiter) or [""]
        pairs = [(label, " ".join(cells[:2])), *((label, cell) for cell in cells)]
        pairs[:0] = [(match[1], match[2])] if match else []
        for label, text in pairs:
            text = re.sub(r"(?<![:\d+-])[0-9]{1,2}:[0-9]{2}(?=(?: ?Uhr)?$)", r"\g<0>:00", text)
            if is_stamp(text):
                stamps[label] = text
                break
    return stamps


def is_null(cell: str) -> bool:
    """Whether a cell is one of the spellings of "no value", or of infinity."""
    return cell in _NULLS


def is_comment(line: str) -> bool:
    """Whether a line is a comment ("#", "%", "//"), Excel's error values excepted."""
    return COMMENT.match(line) is not None


def uncommented(line: str) -> str:
    """A line without the mark that makes it a comment."""
    return COMMENT.sub("", line, count=1).strip() if is_comment(line) else line


def split(line: str, delimiter: str) -> list[str]:
    """Cells of one logical line, stripped of blanks around them."""
    if delimiter == " ":
        line = re.sub(r"[ \t]+", " ", line.strip())
    try:
        lines = line.splitlines(True) if "\n" in line else [line]  # it also cuts at other marks
        rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
        cells = [c.strip() for c in next(rows, [])]
    except csv.Error:  # a cell beyond the reader's limit of 128 KiB
        return [line]
    if "'" in line or "=" in line:
        cells = [TEXT_MARK.sub(r"\1", c) for c in cells]
    return [re.sub(r"\s*\n\s*", " ", c) for c in cells] if "\n" in line else cells


def fit(cells: list[str], width: int) -> list[str]:
    """The cells, cut or filled to `width`."""
    return (cells + [""] * width)[:width]


def without_brackets(unit: str) -> str:
    """A units cell without its brackets; "" for dashes."""
    bracketed = re.fullmatch(r"[\[({<](.*)[\])}>]", unit)
    text = (bracketed[1] if bracketed else unit).strip()
    return text if text.strip("-") else ""
