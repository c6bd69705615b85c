"""One block of a text log parsed: typed columns, and the rows of another width.

A column whose cells do not all fit its Arrow type is read as text, in all later blocks too.
"""

import csv
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.model import Bools, Floats, Times
from ..source import ReadOptions
from .cells import floats
from .clock import Clock
from .dialect import NULLS, Dialect, is_comment, split
from .lines import LineBlock

_EXAMPLE_BYTES = 100_000  # bytes of a row that are looked at
_TEXT = re.compile(r'(?=.*[^\W\d_]{3})[^"\d\s][^"]{0,200}')  # a line as "End of measurement"
Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class CsvTable:
    """What a text log is read as; the same for all passes over it."""

    path: Path
    options: ReadOptions
    dialect: Dialect
    clock: Clock
    types: dict[int, Any]  # Arrow type by column, set to text where cells do not fit
    expected: int = 0  # rows, about: columns of this size need no second copy to grow


@dataclass(slots=True)
class ParsedBlock:
    """What one block holds; arrays of its n rows of the right width, each of shape (n,)."""

    block: LineBlock
    times: Times
    timed: Bools  # which times hold
    values: dict[int, Floats]
    states: dict[int, NDArray[np.int8]]  # of columns with a cell that is no number
    arrays: dict[int, Any]  # Arrow arrays of the columns that are looked at again
    lines: Rows  # line of each row, from 0 at the block's start
    dropped: dict[str, Rows]  # lines left out, by class
    _line_ends: Rows | None = field(default=None, init=False)

    def text(self, line: int) -> str:
        """Text of a line of the block."""
        if self._line_ends is None:
            self._line_ends = _line_ends(self.block.data)
        start = int(self._line_ends[line - 1]) + 1 if line else 0
        stop = min(int(self._line_ends[line]), start + _EXAMPLE_BYTES)
        return self.block.data[start:stop].decode("utf-8", "replace")


@dataclass
class Parser:
    """Parses blocks, several at a time; only the table's `types` change."""

    table: CsvTable
    indices: list[int]  # columns of numbers
    keys: tuple[int, ...]  # columns that separate series

    def parse(self, block: LineBlock) -> ParsedBlock:
        """The columns of one block.

        Raises:
            UserError: where the parser cannot follow it.
        """
        dropped: dict[str, Rows] = {}
        lines = np.arange(block.lines)
        outcome = self._typed(block.data)
        if isinstance(outcome, str) or outcome.num_rows != block.lines:
            data, lines, dropped = self._sieved(block)
            if isinstance(outcome, str) or dropped.keys() != {"blank"}:
                outcome = self._typed(data)
        if isinstance(outcome, str) or outcome.num_rows != len(lines):
            reason = outcome if isinstance(outcome, str) else "its quotes cannot be followed"
            text = f"{self.table.path}: cannot be read from line {block.first_line} on: {reason}"
            hint = "correct the log, or state its dialect, as `--set csv.delimiter=semicolon`"
            raise UserError(text, hint)
        arrays = {int(name[1:]): outcome[name].combine_chunks() for name in outcome.column_names}
        clock, decimal = self.table.clock, self.table.dialect.decimal
        for i, pattern in self.table.dialect.removals.items():
            if i in arrays and pa.types.is_string(arrays[i].type):
                arrays[i] = pc.replace_substring_regex(arrays[i], pattern, r"\1")
        times, timed = np.zeros(len(lines), np.int64), np.ones(len(lines), np.bool_)
        if clock.columns:
            times, timed = clock.nanoseconds([arrays[i] for i in clock.columns])
        checked = {i: floats(arrays[i], decimal) for i in self.indices}
        reread = self.keys if timed.all() else (*self.keys, *clock.columns)
        values = {i: value for i, (value, _) in checked.items()}
        states = {i: state for i, (_, state) in checked.items() if state.any()}
        reread_arrays = {i: arrays[i] for i in reread}
        return ParsedBlock(block, times, timed, values, states, reread_arrays, lines, dropped)

    def _sieved(self, block: LineBlock) -> tuple[bytes, Rows, dict[str, Rows]]:
        """The block without lines of another width, the lines that are left, and the others.

        A comment behind the cells of a row is cut off, where the header names a column of them.
        A line in which a quote does not close has too few cells, and so has what follows it.
        """
        data, delimiter, width = block.data, self.table.dialect.delimiter, self.table.dialect.width
        text, line_ends = np.frombuffer(data, np.uint8), _line_ends(data)
        starts = np.append(0, line_ends[:-1] + 1)
        if b'"' in data:
            lines = data.decode("utf-8", "replace").split("\n")[:-1]
            cells = np.array([_closed_cells(line, delimiter) for line in lines])
        else:
            marks = np.flatnonzero(text == ord(delimiter))
            cells = np.searchsorted(marks, line_ends) - np.searchsorted(marks, starts) + 1
        remaining = np.ones(len(text), bool)
        if self.table.dialect.has_remarks:
            for k in np.flatnonzero(cells == width + 1).tolist():
                comment_start = data.rindex(delimiter.encode(), starts[k], line_ends[k])
                remaining[comment_start : line_ends[k]] = False
                cells[k] = width
        irregular = np.flatnonzero((cells != width) | (line_ends == starts))
        kinds: dict[str, list[int]] = {}
        for k in irregular.tolist():
            kind = self._kind(data[starts[k] : line_ends[k]], cells[k] < width)
            kinds.setdefault(kind, []).append(k)
        regular = np.ones(len(line_ends), bool)
        regular[irregular] = False
        remaining &= np.repeat(regular, line_ends + 1 - starts)
        dropped = {kind: np.array(numbers) for kind, numbers in kinds.items()}
        return text[remaining].tobytes(), np.flatnonzero(regular), dropped

    def _kind(self, line: bytes, is_narrow: bool) -> str:
        """Class of a line that has another width than the table.

        Raises:
            UserError: where it is a header of other columns or units.
        """
        if not line.strip():
            return "blank"
        if line[:1] == b"\0":
            return "NUL bytes"
        text = line[:_EXAMPLE_BYTES].decode("utf-8", "replace")
        if is_comment(text):
            return "comment"
        dialect = self.table.dialect
        firsts = (*dialect.segments, *(row[0] for row in dialect.header_cells if row[0]))
        if text.startswith(firsts):
            cells = split(text, dialect.delimiter)
            if dialect.repeats_header(cells):
                return "header"
            if cells[0] in dialect.segments:
                hint = "split the log there, and read each part by itself"
                raise UserError(f"{self.table.path}: {text[:60]!r} begins a header of others", hint)
        is_text = dialect.delimiter not in text and _TEXT.fullmatch(text)
        if is_text and dialect.rows[0][0][:1].isdecimal():
            return "comment"
        return "too few cells" if is_narrow else "too many cells"

    def _typed(self, data: bytes) -> Any:
        """The wanted columns as an Arrow table, or why they cannot be read."""
        wanted = (*self.table.clock.columns, *self.indices, *self.keys)
        while True:
            texts = dict.fromkeys(self.table.dialect.removals, pa.string())
            types = {i: (self.table.types | texts).get(i, pa.string()) for i in wanted}
            schema = pa.schema([(f"c{i}", kind) for i, kind in types.items()])
            if not data:
                return schema.empty_table()
            try:
                return self._read(data, schema)
            except pa.ArrowInvalid as error:
                column = re.search(r"In CSV column #(\d+)", str(error))
                if not column or types[int(column[1])] == pa.string():
                    return str(error).splitlines()[0]
                self.table.types[int(column[1])] = pa.string()

    def _read(self, data: bytes, schema: Any) -> Any:
        dialect, arrow = self.table.dialect, pyarrow.csv
        names = [f"c{i}" for i in range(dialect.width)]
        # blocks run in parallel, so each is read by one thread
        reads = arrow.ReadOptions(column_names=names, use_threads=False, block_size=len(data) + 1)
        parses = arrow.ParseOptions(delimiter=dialect.delimiter)
        converts = arrow.ConvertOptions(
            column_types=schema,
            include_columns=schema.names,
            null_values=list(NULLS),
            strings_can_be_null=True,
            decimal_point=dialect.decimal,
        )
        return arrow.read_csv(pa.BufferReader(data), reads, parses, converts)


def _line_ends(data: bytes) -> Rows:
    return np.flatnonzero(np.frombuffer(data, np.uint8) == 10)


def _closed_cells(line: str, delimiter: str) -> int:
    """How many cells a line has, 0 where a quote does not close in it."""
    reader = csv.reader([line, ""], delimiter=delimiter)
    try:
        cells = len(next(reader))
    except csv.Error:  # a cell beyond the reader's limit of 128 KiB
        return 0
    return cells if reader.line_num == 1 else 0
