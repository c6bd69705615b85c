"""One block of a text log parsed: its columns, and the lines that are no rows, by class."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.model import Bools, Floats, Times
from ..number_text import is_number
from ..source import ReadOptions
from .cells import IS_BAD, Clock, floats, is_missing
from .dialect import NULLS, Dialect, is_comment, split, stamps_in
from .header_words import is_statistic, quality_column
from .lines import LineBlock, Rows
from .stamps import is_stamp

_MOST_READ = 10_000  # lines of a block without a row that may be a header
_BAD = r"(?i)^\s*(?:bad|schlecht|mauvais|invalid|ungültig)"  # of a quality
_NONE: Rows = np.empty(0, np.int64)
# a line as "End of measurement"; one that begins with a stamp has two words
_TEXT = re.compile(r'(?:(?!\d)(?=.*[^\W\d_]{3})|(?=(?:.*\b[^\W\d_]{3,}\b){2}))[^"\s][^"]{0,200}')


@dataclass(frozen=True, slots=True)
class CsvTable:
    """What a text log is read as; the same for all passes over it."""

    path: Path
    options: ReadOptions
    dialect: Dialect
    clock: Clock
    columns: range | None = None  # those that have this clock; None for all


@dataclass(slots=True)
class ParsedBlock:
    """What one block holds; arrays of its n rows of the right width, each of shape (n,)."""

    block: LineBlock
    times: Times
    timed: Bools  # which times hold
    values: dict[int, Floats]
    states: dict[int, NDArray[np.int8]]  # of columns with a cell that is no number
    texts: dict[int, Any]  # Arrow arrays of columns of text
    lines: Rows  # line of each row, from 0 at the block's start
    dropped: dict[str, Rows]  # lines that are no rows, or rows without a time, by class


@dataclass(frozen=True)
class Parser:
    """Parses blocks, several at a time."""

    table: CsvTable
    indices: list[int]  # columns of numbers
    texts: tuple[int, ...]  # columns of text

    def parse(self, block: LineBlock) -> ParsedBlock:
        """The columns of one block.

        Raises:
            UserError: where the parser cannot follow it, or another header stands in it.
        """
        lines, narrow, wide_lines = np.arange(len(block.ends)), _NONE, _NONE
        try:
            cells = self._cells(block.data, len(lines))
        except pa.ArrowInvalid:
            data, lines, narrow, wide_lines = self._sieved(block)
            try:
                cells = self._cells(data, len(lines))
            except pa.ArrowInvalid as error:
                text = f"{self.table.path}: cannot be read from line {block.first_line} on: "
                hint = "correct the log, or state its dialect, as `--set csv.delimiter=semicolon`"
                raise UserError(text + str(error).splitlines()[0], hint) from None
        columns = {int(name[1:]): cells[name].combine_chunks() for name in cells.column_names}
        clock, decimal = self.table.clock, self.table.dialect.decimal
        for i in self.table.dialect.removals.keys() & columns.keys():
            pattern = self.table.dialect.removals[i]
            columns[i] = pc.replace_substring_regex(columns[i], pattern, r"\1")
        missing = absent = np.zeros(len(lines), np.bool_)
        times, timed = np.zeros(len(lines), np.int64), ~missing
        if clock.columns:
            times, timed = clock.nanoseconds([columns[i] for i in clock.columns])
        if not timed.all():
            missing = np.any([is_missing(columns[i]) for i in clock.columns], axis=0)
            if self.table.columns:  # rows of other columns have their own time
                absent = ~timed & np.all([columns[i].is_null() for i in self.indices], axis=0)
        faults = {
            "too few cells": narrow,
            "too many cells": wide_lines,
            "time missing": lines[~timed & missing & ~absent],
            "time unreadable": lines[~timed & ~missing],
        }
        numbers = {i: floats(columns[i], decimal) for i in self.indices}
        for i in self._with_unit:
            if pc.any(pc.not_equal(columns[i + 1], self.table.dialect.unit_beside(i))).as_py():
                text = f"{self.table.path}: the unit beside {self.table.dialect.names[i]!r} changes"
                raise UserError(text, "export the column in one unit")
        for i, quality in self._qualities.items():
            bad = pc.match_substring_regex(columns[quality], _BAD)
            is_bad = np.asarray(pc.fill_null(bad, False))
            value, state = numbers[i]
            value[is_bad], state[is_bad] = np.nan, IS_BAD
        values = {i: value for i, (value, _) in numbers.items()}
        states = {i: state for i, (_, state) in numbers.items() if state.any()}
        texts = {i: columns[i] for i in self.texts}
        dropped = self._classified(block, faults) | {"other group": lines[absent]}
        return ParsedBlock(block, times, timed, values, states, texts, lines, dropped)

    @property
    def _with_unit(self) -> list[int]:
        """The columns of numbers whose unit stands behind each, and separates no series."""
        numeric = (i for i in self.indices if i + 1 not in self.texts)
        return list(filter(self.table.dialect.unit_beside, numeric))

    @property
    def _qualities(self) -> dict[int, int]:
        """The columns of numbers that have a column of their quality, and which."""
        columns = ((i, quality_column(self.table.dialect.names, i)) for i in self.indices)
        return {i: quality for i, quality in columns if quality is not None}

    def _cells(self, data: bytes, rows: int) -> Any:
        """The wanted columns of so many rows as an Arrow table of text."""
        dialect, arrow = self.table.dialect, pyarrow.csv
        besides = (*self._qualities.values(), *(i + 1 for i in self._with_unit))
        wanted = dict.fromkeys((*self.table.clock.columns, *self.indices, *self.texts, *besides))
        schema = pa.schema([(f"c{i}", pa.string()) for i in wanted])
        if not data:
            return schema.empty_table()
        names = [f"c{i}" for i in range(dialect.width)]
        # blocks run in parallel, so each is read by one thread
        reads = arrow.ReadOptions(column_names=names, use_threads=False, block_size=len(data) + 1)
        nulls = {"null_values": [*NULLS], "strings_can_be_null": True}
        types = {"column_types": schema, "include_columns": schema.names}
        converts = arrow.ConvertOptions(**types, **nulls)
        parses = arrow.ParseOptions(delimiter=dialect.delimiter)
        cells = arrow.read_csv(pa.BufferReader(data), reads, parses, converts)
        if cells.num_rows != rows:
            raise pa.ArrowInvalid("its quotes cannot be followed")
        return cells

    def _sieved(self, block: LineBlock) -> tuple[bytes, Rows, Rows, Rows]:
        """The block without lines of another width; the lines left, the narrow and the wide ones.

        A comment behind the cells of a row is cut off, where the header names a column of them.
        A line in which a quote does not close has too few cells, and so has what follows it.
        """
        data, delimiter, width = block.data, self.table.dialect.delimiter, self.table.dialect.width
        text, line_ends = np.frombuffer(data, np.uint8), block.ends
        starts = np.append(0, line_ends[:-1] + 1)
        lines = data.decode("utf-8", "replace").split("\n")[:-1]
        if b'"' in data:
            cells = np.array([_closed_cells(line, delimiter) for line in lines])
        else:
            cells = np.array([line.count(delimiter) + bool(line) for line in lines])
        remaining = np.ones(len(text), bool)
        if self.table.dialect.has_remarks:
            for k in np.flatnonzero(cells == width + 1).tolist():
                comment_start = data.rindex(delimiter.encode(), starts[k], line_ends[k])
                remaining[comment_start : line_ends[k]] = False
                cells[k] = width
        remaining &= np.repeat(cells == width, line_ends + 1 - starts)
        regular, narrow, wide = map(np.flatnonzero, (cells == width, cells < width, cells > width))
        return text[remaining].tobytes(), regular, narrow, wide

    def _classified(self, block: LineBlock, faults: dict[str, Rows]) -> dict[str, Rows]:
        """Lines by class, from those that hold no row, by fault: some of them are no data."""
        classes: dict[str, list[int]] = {}
        for fault, lines in faults.items():
            results = -1, 0  # the last row of a table of results, and its cells
            for k, line in enumerate(lines.tolist()):
                kind = fault
                if k < _MOST_READ:
                    kind = self._kind(block.text(line), fault, block.first_line + line)
                    width = len(split(block.text(line), self.table.dialect.delimiter))
                    if fault == "too few cells" and width > 1:
                        if kind == fault and results == (line - 1, width):
                            kind = "statistics"
                        if kind in ("comment", "statistics"):
                            results = line, width
                classes.setdefault(kind, []).append(line)
        return {kind: np.sort(lines) for kind, lines in classes.items()}

    def _kind(self, text: str, fault: str, line: int) -> str:
        """Class of a line that holds no row for this fault."""
        dialect = self.table.dialect
        if not text.strip(f' \t\r"{dialect.delimiter}'):
            return "blank"
        if text.startswith("\0"):
            return "NUL bytes"
        if is_comment(text):
            return "comment"
        cells = split(text, dialect.delimiter)
        if text.strip() in dialect.preamble:
            return "preamble"
        preamble_stamps = stamps_in(dialect.preamble, dialect.delimiter)
        if preamble_stamps.keys() & stamps_in([text], dialect.delimiter).keys():
            return "preamble"
        if dialect.repeats_header(cells):
            return "header"
        first_cell = dialect.rows[0][0]
        has_words = not (is_number(first_cell) or is_stamp(first_cell))  # as names of brake steps
        if is_statistic(cells[0]) and not has_words:
            return "statistics"
        is_row = len(cells) == dialect.width or cells[0] in dialect.segments
        if is_row and dialect.is_another_header(cells):
            hint = "split the log there, and read each part by itself"
            text = f"{self.table.path}: line {line} is a header of other columns or units"
            raise UserError(text, hint)
        said = [cell for cell in cells if cell]
        texts = [(k, cell) for k, cell in enumerate(cells) if cell and not is_number(cell)]
        is_text = len({*said}) == len(said) == len(texts)  # no error, repeated
        column, remark = texts[0] if texts else (0, "")
        if fault == "too few cells" and len(said) == len(texts) + 1 > 1:
            is_text = remark not in dialect.column(column)  # beside a time or a result
        is_remark = is_text and _TEXT.fullmatch(text if dialect.delimiter == " " else remark)
        return "comment" if is_remark and "".join(dialect.rows[0])[:1].isdecimal() else fault


def _closed_cells(line: str, delimiter: str) -> int:
    """How many cells a line has, 0 where a quote does not close in it."""
    reader = csv.reader([line, ""], delimiter=delimiter)
    try:
        cells = len(next(reader))
    except csv.Error:  # a cell beyond the reader's limit of 128 KiB
        return 0
    return cells if reader.line_num == 1 else 0
