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
from ..words import numbered
from .block_parser import CsvTable, ParsedBlock, Parser
from .cells import NO_NUMBER, NUMBER, is_missing
from .dialect import is_comment, is_null, split
from .header_words import label
from .lines import Lines
from .losses import SKIPPED, Losses
from .time_column import another_time

Key = tuple[str, ...]  # cells of the key columns

_MAX_MET = 1_000  # keys of series, beyond which no more are collected
_MAX_UNREAD = 1_000  # rows of a block without a readable time that may be a header
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
    segments: list[tuple[int, str]]  # of an LVM file: first row of each, and its time of day


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
    for i in indices:
        table.types.setdefault(i, pa.float64())
    lines = Lines(table.path, table.dialect, table.options.max_unpacked)
    losses = Losses(table.dialect)
    groups = Groups(keys, wanted)
    by_column: dict[int, NDArray[Any]] = {}
    row_count = sample_count = 0
    words: dict[int, list[str]] = {i: [] for i in texts}
    reread = (*keys, *texts)
    segments: list[tuple[int, str]] = []
    for parsed in threads.run_ahead(Parser(table, indices, reread).parse, lines.blocks()):
        if not parsed.timed.all():
            classify_untimed(table, parsed)
        sample_count = count_times(table, parsed, sample_count)
        timed = parsed.timed.copy()
        codes = groups.codes(parsed, timed)
        numbers = {i: _numbers_of(parsed, i, timed, words[i]) for i in texts}
        losses.add(parsed, timed, row_count)
        for line in parsed.dropped.get("header", ()) if table.dialect.segments else ():
            cells = split(parsed.text(line), table.dialect.delimiter)
            if label(cells[0]) == "clock":
                row = row_count + int(np.searchsorted(parsed.lines[timed], line))
                segments.append((row, cells[1]))
        stop = row_count + int(timed.sum())
        for i, array in {_T: parsed.times, _SERIES: codes, **parsed.values, **numbers}.items():
            if i not in by_column:
                by_column[i] = np.empty(max(table.expected, stop), array.dtype)
            if stop > len(by_column[i]):
                by_column[i].resize(stop + stop // 8, refcheck=False)
            by_column[i][row_count:stop] = array if timed.all() else array[timed]
        row_count = stop
    if not row_count:
        hint = another_time(table.dialect, table.clock, table.expected, table.path)
        raise UserError(f"{table.path}: no row has a time stamp that can be read", hint)
    losses.lines["used"] = row_count
    for column in by_column.values():
        column.resize(row_count, refcheck=False)
    for i in indices:
        losses.settle(i, by_column[i])
    t, codes = by_column.pop(_T), by_column.pop(_SERIES)
    return CsvRows(t, codes, by_column, groups.met, words, losses, lines, segments)


def count_times(table: CsvTable, parsed: ParsedBlock, count: int) -> int:
    """Sets the times of rows that are counted, after `count` earlier ones; returns the new count.

    A row that is left out was a sample.
    """
    if not table.clock.step:
        return 0
    skipped_lines = [lines for kind, lines in parsed.dropped.items() if kind in SKIPPED]
    samples = np.unique(np.concatenate([parsed.lines, *skipped_lines]))
    rows = count + np.searchsorted(samples, parsed.lines)
    parsed.times = table.clock.start + rows * table.clock.step
    return count + len(samples)


def _numbers_of(parsed: ParsedBlock, i: int, timed: Bools, words: list[str]) -> Floats:
    """The number of each cell's word, shape (n,); NaN without a word, and where it is not used.

    Cells with a word beyond those that a state may have hold no number.
    """
    used_cells = pc.if_else(pa.array(timed), parsed.arrays[i], None)
    numbers = numbered(used_cells, words)
    is_unknown = np.isnan(numbers) & np.asarray(used_cells.is_valid())
    if is_unknown.any():
        parsed.states[i] = np.where(is_unknown, NO_NUMBER, NUMBER).astype(np.int8)
    return numbers


def classify_untimed(table: CsvTable, parsed: ParsedBlock) -> None:
    """Notes the rows that have no time by class.

    Raises:
        UserError: where one of them is a header of other columns or units.
    """
    dialect = table.dialect
    missing = np.zeros(len(parsed.timed), bool)
    for i in table.clock.columns:
        missing |= is_missing(parsed.arrays[i])
    kinds: dict[str, list[int]] = {}
    for k, row in enumerate(np.flatnonzero(~parsed.timed).tolist()):
        line = int(parsed.lines[row])
        text = parsed.text(line)
        kind = "time missing" if missing[row] else "time unreadable"
        if is_comment(text):
            kind = "comment"
        elif k < _MAX_UNREAD:
            cells = split(text, dialect.delimiter)
            if dialect.repeats_header(cells):
                kind = "header"
            elif dialect.is_another_header(cells):
                line_text = f"{table.path}: line {parsed.block.first_line + line}"
                hint = "split the log there, and read each part by itself"
                raise UserError(f"{line_text} is a header of other columns or units", hint)
        kinds.setdefault(kind, []).append(line)
    for kind, numbers in kinds.items():
        lines = np.append(parsed.dropped.get(kind, np.empty(0, np.int64)), numbers)
        parsed.dropped[kind] = np.sort(lines)


class Groups:
    """Finds the key of each row, and the rows of no or another series."""

    def __init__(self, keys: tuple[int, ...], wanted: list[Key] | None) -> None:
        self.met = list(wanted or [])
        self._keys, self._all = keys, wanted is None

    def codes(self, parsed: ParsedBlock, timed: Bools) -> NDArray[Any]:
        """Number of each row's key in `met`; takes rows without a wanted one from `timed`."""
        if not self._keys:
            return np.zeros(len(timed), np.int8)
        cells = [pc.fill_null(pc.cast(parsed.arrays[i], pa.string()), "") for i in self._keys]
        cells = [pc.utf8_trim_whitespace(c) for c in cells]
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
