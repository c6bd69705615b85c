"""One pass over the rows of a text log for some of its columns, every line accounted for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ...core import threads
from ...core.errors import UserError
from ...core.model import Bools, Floats, Times
from ..source import numbered
from .block_parser import CsvTable, ParsedBlock, Parser
from .cells import NO_NUMBER, NUMBER
from .dialect import is_null, stamps_in
from .lines import Lines
from .losses import SKIPPED, Losses
from .time_column import another_time

Key = tuple[str, ...]  # cells of the key columns

_MOST_ABOVE = 100  # lines above a header that are read
_MAX_MET = 1_000  # keys of series, beyond which no more are collected
_T, _SERIES = -1, -2  # what a pass gives besides its columns


@dataclass(frozen=True, slots=True)
class CsvRows:
    """What one pass gave: rows that have a time and a wanted key; arrays of shape (n,)."""

    times: Times
    codes: NDArray[Any]  # number of each row's key in `met`; zeros without keys
    values: dict[int, Floats]
    met: list[Key]
    words: dict[int, list[str]]  # of columns of words, whose values are numbers of them
    losses: Losses
    lines: Lines  # with what is wrong at the end of the file
    segments: list[tuple[int, dict[str, str]]]  # first row below each header, and `stamps_in` it


def read_rows(
    table: CsvTable,
    indices: list[int],
    keys: tuple[int, ...] = (),
    wanted: list[Key] | None = None,
    texts: Sequence[int] = (),
) -> CsvRows:
    """One pass over the file.

    Args:
        table: how to read it.
        indices: columns of numbers.
        keys: columns that separate series.
        wanted: their cells; None for every series that occurs.
        texts: columns of words.

    Raises:
        UserError: where no row has a time, another header stands among the rows, or the file
            cannot be read.
    """
    lines = Lines(table.path, table.dialect, table.options.max_unpacked)
    rows = UsedRows(table, keys, wanted)
    columns: dict[int, NDArray[Any]] = {}
    words: dict[int, list[str]] = {i: [] for i in texts}
    segments: dict[int, dict[str, str]] = {}
    for parsed in threads.run_ahead(Parser(table, indices, (*keys, *texts)).parse, lines.blocks()):
        row_count = rows.count
        timed, codes = rows.take(parsed)
        row_lines = parsed.lines[timed]
        for line in parsed.dropped.get("header", ()):
            rows_above = int(np.searchsorted(row_lines, line))
            above = int(row_lines[rows_above - 1]) + 1 if rows_above else 0
            lines_above = range(max(above, line - _MOST_ABOVE), line + 1)
            stated = map(parsed.block.text, lines_above)
            segments[row_count + rows_above] = stamps_in([*stated], table.dialect.delimiter)
        numbers = {i: _numbers_of(parsed, i, timed, words[i]) for i in texts}
        rows.losses.add(parsed, timed, row_count)
        for i, array in {_T: parsed.times, _SERIES: codes, **parsed.values, **numbers}.items():
            column = columns.setdefault(i, np.empty(0, array.dtype))
            if rows.count > len(column):  # in place, where the system can
                column.resize(rows.count + rows.count // 64, refcheck=False)
            column[row_count : rows.count] = array if timed.all() else array[timed]
    if not rows.count:
        hint = another_time(table.dialect, table.clock, rows.losses.lines.total(), table.path)
        raise UserError(f"{table.path}: no row has a time stamp that can be read", hint)
    rows.losses.lines["used"] = rows.count
    for column in columns.values():
        column.resize(rows.count, refcheck=False)
    for i in indices:
        rows.losses.settle(i, columns[i])
    t, codes = columns.pop(_T), columns.pop(_SERIES)
    return CsvRows(t, codes, columns, rows.met, words, rows.losses, lines, [*segments.items()])


def _numbers_of(parsed: ParsedBlock, i: int, timed: Bools, words: list[str]) -> Floats:
    """The number of each cell's word, see `numbered`; a word that has none is a loss."""
    cells = pc.if_else(pa.array(timed), parsed.texts[i], None)
    numbers = numbered(cells, words)
    unknown = np.isnan(numbers) & np.asarray(cells.is_valid())
    parsed.states[i] = np.where(unknown, NO_NUMBER, NUMBER).astype(np.int8)
    return numbers


class UsedRows:
    """Which rows are used, block by block: those with a time, and with a key that is wanted.

    Of `wanted` keys, None are all that occur.
    """

    def __init__(self, table: CsvTable, keys: tuple[int, ...], wanted: list[Key] | None) -> None:
        self.met = list(wanted or [])
        self.count = 0
        self.losses = Losses(table.dialect)
        self._table, self._keys, self._all = table, keys, wanted is None
        self._samples = 0  # where rows are counted
        self._last: int | None = None  # the time of the last row, where stamps are sparse

    def take(self, parsed: ParsedBlock) -> tuple[Bools, NDArray[Any]]:
        """Which rows of the next block are used, and the number of each row's key in `met`."""
        if step := self._table.clock.step:
            # a row that is left out was a sample
            skipped = [lines for kind, lines in parsed.dropped.items() if kind in SKIPPED]
            samples = np.unique(np.concatenate([parsed.lines, *skipped]))
            rows = self._samples + np.searchsorted(samples, parsed.lines)
            parsed.times = self._table.clock.start + rows * step
            self._samples += len(samples)
        if self._table.clock.is_sparse:
            self._carry_on(parsed)
        timed = parsed.timed.copy()
        codes = self._codes(parsed, timed) if self._keys else np.zeros(len(timed), np.int8)
        self.count += int(timed.sum())
        return timed, codes

    def _carry_on(self, parsed: ParsedBlock) -> None:
        """Gives rows that have no stamp the last one above them."""
        without = np.isin(parsed.lines, parsed.dropped.pop("time missing", ()))
        above = np.maximum.accumulate(np.where(parsed.timed, np.arange(len(without)), -1))
        times = np.where(above < 0, self._last or 0, parsed.times[above])
        has_stamp = without & ((above >= 0) | (self._last is not None))
        parsed.times = np.where(has_stamp, times, parsed.times)
        parsed.timed |= has_stamp
        if (without & ~has_stamp).any():
            parsed.dropped["time missing"] = parsed.lines[without & ~has_stamp]
        if parsed.timed.any():
            self._last = int(parsed.times[parsed.timed][-1])

    def _codes(self, parsed: ParsedBlock, timed: Bools) -> NDArray[Any]:
        """Number of each row's key in `met`; takes rows without a wanted one from `timed`."""
        cells = [pc.utf8_trim_whitespace(pc.fill_null(parsed.texts[i], "")) for i in self._keys]
        encoded = pc.binary_join_element_wise(*cells, "\0").dictionary_encode()  # no row has a NUL
        keys = [tuple(text.split("\0")) for text in encoded.dictionary.to_pylist()]
        said = np.array([not any(map(is_null, key)) for key in keys], bool)
        code_of = {v: k for k, v in enumerate(self.met)}
        index = np.asarray(encoded.indices)
        if self._all and len(code_of) <= _MAX_MET:
            for k in np.flatnonzero(np.bincount(index[timed], minlength=len(keys)) * said):
                code_of.setdefault(keys[k], len(code_of))
            self.met = list(code_of)
        codes: NDArray[np.int64] = np.array([code_of.get(v, -1) for v in keys], np.int64)[index]
        for kind, affected in (("group missing", ~said[index]), ("other group", said[index])):
            if (dropped := timed & affected & (codes < 0)).any():
                parsed.dropped[kind] = parsed.lines[dropped]
        timed &= codes >= 0
        return codes
