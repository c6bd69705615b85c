"""One block of a text log parsed by pyarrow: typed columns, and the rows of another width.

Each column has Arrow types to try in turn. A column that does not fit a type takes the next one,
in all later blocks too.
"""

import re
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.model import Bools, Floats, Times
from ..source import ReadOptions
from .cells import floats
from .clock import Clock
from .dialect import NULLS, Dialect, is_comment
from .lines import Block

_MOST_ASKED = 50  # rows of another width in a block, about which the parser asks
_SHOWN = 100_000  # bytes of a row that are looked at
Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Table:
    """What a text log is read as; the same for all passes over it."""

    path: Path
    options: ReadOptions
    dialect: Dialect
    clock: Clock
    types: dict[int, tuple[Any, ...]]  # Arrow types still to try by column; kept between passes
    units: dict[int, str]  # of columns whose cells carry it
    expected: int  # rows, roughly


@dataclass(slots=True)
class Part:
    """What one block holds; arrays of its n rows of the right width, each of shape (n,)."""

    block: Block
    times: Times
    timed: Bools  # which times hold
    values: dict[int, Floats]
    states: dict[int, NDArray[np.int8]]  # of columns with a cell that is no number
    arrays: dict[int, Any]  # Arrow arrays of the columns that are looked at again
    wrong: dict[str, Rows]  # rows of the block with another number of cells, by class
    blank: int
    inside: int  # line ends inside quotes
    gone: dict[str, Rows] = field(default_factory=dict)  # rows of the block left out, by class
    _places: Rows | None = None

    def numbers(self, rows: Rows) -> Rows:
        """Rows of the arrays as rows of the block, wrong ones included; both from 0."""
        wrong = joined(self.wrong.values())
        # row k of the arrays is row k + (wrong rows before it) of the block
        gaps = wrong - np.arange(len(wrong))
        return rows + np.searchsorted(gaps, rows, side="right")

    def places(self, numbers: Rows) -> Rows:
        """Start, end, first and last line of rows of the block, shape (n, 4)."""
        if self._places is None:
            self._places = self.block.rows()
        return self._places[numbers]

    def line(self, row: int) -> tuple[int, str]:
        """Line number and text of a row of the arrays."""
        return self.text(int(self.numbers(np.array([row]))[0]))

    def text(self, number: int) -> tuple[int, str]:
        """Line number and text of a row of the block."""
        ((start, end, line, _),) = self.places(np.array([number]))
        text = self.block.data[start : min(end, start + _SHOWN)]
        return int(line), text.decode("utf-8", "replace")


@dataclass(slots=True)
class Parser:
    """Parses blocks, several at a time; only the table's `types` change."""

    table: Table
    indices: list[int]  # columns of numbers
    keys: tuple[int, ...]  # columns that separate series

    def parse(self, block: Block) -> Part:
        """The columns of one block.

        Raises:
            UserError: where the parser cannot follow it.
        """
        if not block.data.isascii():  # the parser reports no wrong row that is not UTF-8
            text = block.data[: block.size].decode("utf-8", "replace")
            block.data = text.replace("\ufeff", "").encode()  # a file joined to another begins so
            block.size = len(block.data)
        multiline = block.quotes and _line_ends(block)[1] > 0
        wrong: dict[str, Rows] = {}
        kept = None
        found = self._typed(block, multiline, sys.maxsize if block.quotes else _MOST_ASKED)
        if found is None:
            fit, wrong, kept = self._sieved(block)
            found = self._typed(fit, multiline, sys.maxsize)
        assert found is not None
        arrays, checked, refused = found
        for kind, rows in refused.items():
            numbers = np.array(rows, np.int64)
            numbers = numbers if kept is None else kept[numbers]
            wrong[kind] = joined([wrong.get(kind, numbers[:0]), numbers])
        times, timed = self.table.clock.nanoseconds([arrays[i] for i in self.table.clock.columns])
        blank = inside = 0
        rows_in_all = len(times) + sum(map(len, wrong.values()))
        if block.lines != rows_in_all:
            blank, inside = _line_ends(block)
        if block.lines != rows_in_all + blank + inside:
            raise UserError(
                f"{self.table.path}: the quotes after line {block.first_line} cannot be followed",
                "correct the quotes in the log",
            )
        again = self.keys if timed.all() else (*self.keys, *self.table.clock.columns)
        return Part(
            block, times, timed, {i: value for i, (value, _) in checked.items()},
            {i: state for i, (_, state) in checked.items() if state.any()},
            {i: arrays[i] for i in again}, wrong, blank, inside,
        )  # fmt: skip

    def _sieved(self, block: Block) -> tuple[Block, dict[str, Rows], Rows | None]:
        """The block without rows of another width, those, and which rows of the block are left.

        The parser asks about each of them, which takes as long as a hundred sound rows. So it gets
        only those that may be blank, comments or holes. None where the block is as it was.
        """
        text, mark = np.frombuffer(block.data, np.uint8, block.size), ord(block.delimiter)
        width = self.table.dialect.width
        feeds = np.flatnonzero(text == 10)
        starts = np.append(0, feeds[:-1] + 1)
        starts, ends = starts[feeds > starts], feeds[feeds > starts]
        before = np.searchsorted(np.flatnonzero(text == mark), [starts, ends])
        cells = before[1] - before[0] + 1
        first = text[starts]
        bare = (first < 128) & ~np.isin(first, list(b"\0 \t\r\f\v\x1c\x1d\x1e\x1f#%/"))
        wrong = bare & (cells != width)
        if not wrong.any():
            return block, {}, None
        wrong[-1] &= not wrong.all()  # the parser takes no block without a row
        kinds = {
            "too few cells": wrong & (cells < width),
            "too many cells": wrong & (cells > width),
        }
        away = np.zeros(block.size + 1, np.int8)
        np.add.at(away, starts[wrong], 1)
        np.add.at(away, ends[wrong] + 1, -1)
        data = text[np.cumsum(away[:-1], dtype=np.int8) == 0].tobytes()
        found = {kind: np.flatnonzero(which) for kind, which in kinds.items() if which.any()}
        return replace(block, data=data, size=len(data)), found, np.flatnonzero(~wrong)

    def _typed(
        self, block: Block, multiline: bool, most: int
    ) -> tuple[dict[int, Any], dict[int, tuple[Floats, Any]], dict[str, list[int]]] | None:
        """Arrow arrays, checked numbers, and the rows that the parser refused, by class.

        None where it refuses more than `most`.
        """
        while True:
            types = {i: self.table.types[i][0] for i in (*self.table.clock.columns, *self.indices)}
            types |= {i: types.get(i, pa.string()) for i in self.keys}
            refused: dict[str, list[int]] = {}
            try:
                table = self._table(block, types, multiline, refused, most)
            except pa.ArrowInvalid as error:
                if sum(map(len, refused.values())) > most:
                    return None
                self._demote(block, str(error), types)
                continue
            arrays = {i: _flat(table[f"c{i}"]) for i in types}
            checked = {
                i: floats(arrays[i], self.table.dialect.decimal, self.table.units.get(i, ""))
                for i in self.indices
            }
            floating = [i for i, kind in types.items() if pa.types.is_floating(kind)]
            unfit = [i for i in floating if not self._is_exact(arrays[i], checked.get(i))]
            if not unfit:
                return arrays, checked, refused
            for i in unfit:
                self.table.types[i] = tuple(
                    k for k in self.table.types[i] if not pa.types.is_floating(k)
                )

    def _is_exact(self, array: Any, checked: tuple[Floats, Any] | None) -> bool:
        """Whether float64 holds what the cells of a column say; no `checked` for the time's.

        1e400 parses as infinity. The strict grammar of text separates it from the word "inf".
        """
        if checked is None:
            return self.table.clock.is_exact(array)
        value, state = checked
        return not (state.any() and np.isinf(value).any())

    def _table(
        self,
        block: Block,
        types: dict[int, Any],
        multiline: bool,
        refused: dict[str, list[int]],
        most: int,
    ) -> Any:
        def skip(row: Any) -> str:
            few = row.actual_columns < row.expected_columns
            kind = "too few cells" if few else "too many cells"
            if "\0" in row.text:
                kind = "NUL bytes"
            elif not row.text.strip():
                kind = "blank"
            elif is_comment(row.text):
                kind = "comment"
            refused.setdefault(kind, []).append(row.number - 1)
            return "skip" if sum(map(len, refused.values())) <= most else "error"

        return pyarrow.csv.read_csv(
            pa.BufferReader(pa.py_buffer(block.data).slice(0, block.size)),
            pyarrow.csv.ReadOptions(
                column_names=[f"c{i}" for i in range(self.table.dialect.width)],
                use_threads=False,  # blocks run in parallel; only so are wrong rows numbered
                block_size=block.size + 1,
            ),
            pyarrow.csv.ParseOptions(
                delimiter=block.delimiter, newlines_in_values=multiline, invalid_row_handler=skip
            ),
            pyarrow.csv.ConvertOptions(
                column_types={f"c{i}": kind for i, kind in types.items()},
                include_columns=[f"c{i}" for i in types],
                null_values=list(NULLS),
                strings_can_be_null=True,
                decimal_point=self.table.dialect.decimal,
            ),
        )

    def _demote(self, block: Block, error: str, tried: dict[int, Any]) -> None:
        """Sets the next type of the column whose cells do not fit; raises after the last type."""
        found = re.search(r"CSV column #(\d+)", error)
        i = int(found[1]) if found else -1
        types = self.table.types
        if i in tried and i in types and types[i][0] is not tried[i]:
            return  # another block has done so already
        if i in types and len(types[i]) > 1:
            types[i] = types[i][1:]
            return
        why = error.splitlines()[0]
        raise UserError(
            f"{self.table.path}: cannot be read from line {block.first_line} on: {why}",
            "correct the log, or state its dialect under [csv]",
        )


def joined(parts: Any) -> Rows:
    """Rows of several arrays in order."""
    parts = list(parts)
    return np.sort(np.concatenate(parts)) if parts else np.empty(0, np.int64)


def _flat(column: Any) -> Any:
    """One Arrow array from a chunked one."""
    return column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()


def _line_ends(block: Block) -> tuple[int, int]:
    """How many lines of a block are blank, and how many line ends stand inside quotes."""
    feeds, ends = block.ends()
    return int((np.diff(ends, prepend=-1) == 1).sum()), len(feeds) - len(ends)
