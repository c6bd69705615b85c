"""One pass over the rows of a text log for some of its columns, every line accounted for."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ...core import threads
from ...core.errors import UserError
from ...core.finding import Finding, Severity, Span
from ...core.masks import spans_of
from ...core.model import Bools, Floats, Times
from ..number_text import largest_jump
from ..source import numbered
from .block_parser import CsvTable, ParsedBlock, Parser
from .cells import DIGITS, IN_GROUPS, IS_BAD, IS_INFINITE, NO_NUMBER, NO_VALUE, NUMBER, OTHER_MARK
from .dialect import Dialect, is_null, split, stamps_in
from .lines import Lines, Rows
from .time_column import another_time

_MOST_SPANS = 20  # of one finding
_FEW_UNREAD, _MOST_UNREAD = 2, 0.01  # cells, or share of a column, beside which others are used
_RESULT = re.compile(r'"?[^\W\d_].*\d')  # a row as "Maximum; 4.1"
_EXAMPLE_CHARACTERS = 40  # characters of a cell or row in a message

SKIPPED = {  # classes of rows that are data and are left out
    "too few cells": "too few cells",
    "too many cells": "too many cells",
    "time missing": "no time stamp",
    "time unreadable": "time stamp not readable",
    "group missing": "no device or axle",
    "NUL bytes": "NUL bytes, from space that was never written",
}
_CELLS: dict[int, tuple[str, Severity]] = {
    NO_VALUE: ("csv-missing-cells", "info"),
    NO_NUMBER: ("csv-bad-cells", "warning"),
    IS_INFINITE: ("not-a-number", "warning"),
    IS_BAD: ("value-of-bad-quality", "warning"),
}


@dataclass(slots=True)
class _Loss:
    """Rows, or cells of one column, that are left out for one reason."""

    line: int  # of the first
    text: str
    count: int = 0
    places: list[Rows] = field(default_factory=list)  # rows used before each

    def add(self, places: Rows) -> None:
        """Counts rows or cells, each with the number of rows used before it."""
        self.count += len(places)
        self.places.append(np.unique(places))


class Losses:
    """Counts lines by class, and cells that hold no number."""

    def __init__(self, dialect: Dialect) -> None:
        self.lines = Counter({"above": dialect.first_line - 1})
        self.rows: dict[str, _Loss] = {}
        self.cells: dict[tuple[int, int], _Loss] = {}  # by column and state
        self.unread: dict[int, _Loss] = {}  # by column: all of it is left out
        self._dialect = dialect

    def add(self, parsed: ParsedBlock, timed: Bools, row_count: int) -> None:
        """Counts what is left out of a block; of its rows `timed` are used, `row_count` before."""
        row_lines = parsed.lines[timed]
        for kind, lines in parsed.dropped.items():
            self.lines[kind] += len(lines)
            if kind in SKIPPED:
                line, text = parsed.block.first_line + int(lines[0]), parsed.block.text(lines[0])
                loss = self.rows.setdefault(kind, _Loss(line, text))
                loss.add(row_count + np.searchsorted(row_lines, lines))
        for i, state in parsed.states.items():
            for k in (*_CELLS, OTHER_MARK, IN_GROUPS, DIGITS):
                rows = np.flatnonzero(state[timed] == k)
                if not len(rows):
                    continue
                if (i, k) not in self.cells:
                    first_line = int(row_lines[rows[0]])
                    cells = split(parsed.block.text(first_line), self._dialect.delimiter)
                    cell = cells[i] if i < len(cells) else ""
                    self.cells[i, k] = _Loss(parsed.block.first_line + first_line, cell)
                self.cells[i, k].add(row_count + rows)

    def settle(self, i: int, value: Floats) -> None:
        """Decides by all cells of a column what its cells in another notation are.

        Their mark is the column's own decimal mark, or it separates groups of digits. Where it may
        be both, or more than a hundredth of the cells cannot be read, all values become NaN.

        `value` is changed in place.
        """
        losses = {k: self.cells.pop((i, k), None) for k in (OTHER_MARK, IN_GROUPS, DIGITS)}
        if not any(losses.values()):
            if all(map(str.isdecimal, self._dialect.column(i))) and (row := _first_group(value)):
                self.unread[i] = _Loss(0, f"{value[row]:.3f}")
                value[:] = np.nan
            return
        rows = {k: np.concatenate(loss.places) for k, loss in losses.items() if loss}
        marked = np.concatenate([*rows.values(), np.empty(0, np.int64)]).astype(np.int64)
        plain_values = np.delete(value, marked)
        plain_values = plain_values[np.isfinite(plain_values)]
        has_own_mark = bool((plain_values % 1.0 != 0.0).any())
        is_sound = len(rows.get(DIGITS, ())) <= max(_FEW_UNREAD, _MOST_UNREAD * len(value))
        if OTHER_MARK in rows:
            is_sound &= not has_own_mark
        elif IN_GROUPS in rows:
            is_sound &= bool(len(plain_values)) and bool((np.abs(plain_values) < 1_000.0).all())
            value[rows[IN_GROUPS]] = np.rint(value[rows[IN_GROUPS]] * 1_000.0)
        if (unread := losses[DIGITS]) and is_sound:
            loss = self.cells.get((i, NO_NUMBER)) or replace(unread, count=0, places=[])
            first_loss = min(loss, unread, key=lambda x: x.line)  # the example of both
            places = [*loss.places, *unread.places]
            joined = _Loss(first_loss.line, first_loss.text, loss.count + unread.count, places)
            self.cells[i, NO_NUMBER] = joined
        elif not is_sound:
            self.unread[i] = next(loss for loss in losses.values() if loss)
            value[:] = np.nan

    def findings(self, t: Times, start: int) -> Iterator[Finding]:
        """What was left out; `t` are the times of rows that are used [ns], `start` the log's."""
        for kind, loss in sorted(self.rows.items(), key=lambda item: [*SKIPPED].index(item[0])):
            is_below_samples = kind == "time unreadable" and min(map(np.min, loss.places)) == len(t)
            if is_below_samples and _RESULT.match(loss.text):  # below the samples
                self.lines["statistics"] += loss.count
                continue
            spans, values = _spans(loss, t, start, between_rows=True), {"line": loss.line}
            names = {"reason": SKIPPED[kind], "example": quoted(loss.text)}
            yield Finding("csv-rows-skipped", "warning", "", loss.count, spans, values, names)
        if count := self.lines["statistics"]:
            yield Finding("statistics-rows", "info", "", count)
        for (i, k), loss in sorted(self.cells.items()):
            code, severity = _CELLS[k]
            empty = self.cells.get((i, NO_VALUE))
            said = len(t) - (empty.count if empty else 0)
            if k == NO_NUMBER and not self._dialect.column(i) and loss.count == said:
                severity = "info"  # a column of words that begin late is not a channel
            spans, name = _spans(loss, t, start, between_rows=False), self._dialect.names[i]
            values, names = {"line": loss.line}, {"example": quoted(loss.text)}
            yield Finding(code, severity, name, loss.count, spans, values, names)
        for i, loss in self.unread.items():
            names = {"example": quoted(loss.text)}
            yield Finding("csv-no-numbers", "warning", self._dialect.names[i], len(t), names=names)


def _first_group(value: Floats) -> int:
    """The first row with a number that seems to be thousands, as 1.020 after 990; 0 for none.

    In its head the column has whole numbers only. As groups of digits it has smaller jumps.
    """
    numbers = np.nan_to_num(value)
    has_fraction = numbers % 1.0 != 0.0
    if not has_fraction.any():
        return 0
    thousands = np.where(has_fraction, 1e3 * numbers, numbers)
    whole_numbers, groups = np.abs(numbers[~has_fraction]), np.abs(thousands[has_fraction])
    is_group = 1e3 < groups.min() <= groups.max() < 1e6
    if not is_group or not 100.0 <= whole_numbers.max(initial=0.0) < 1e3:
        return 0
    has_jump = largest_jump(numbers) > largest_jump(thousands)
    are_integers = bool((np.abs(groups - np.rint(groups)) < 1e-6).all())
    return int(np.argmax(has_fraction)) if are_integers and has_jump else 0


def _spans(loss: _Loss, t: Times, start: int, *, between_rows: bool) -> tuple[Span, ...]:
    """When cells were lost; of whole rows from the time of the row before to that of the next."""
    places = np.unique(np.concatenate(loss.places))
    cuts = np.flatnonzero(np.diff(places) != 1)
    first_place, last_place = places[np.append(0, cuts + 1)], places[np.append(cuts, -1)]
    begins = t[np.maximum(first_place - between_rows, 0)]
    stops = t[np.minimum(last_place, len(t) - 1)]
    gaps = begins[1:] - stops[:-1]
    if len(gaps) >= _MOST_SPANS:  # what is regular is one stretch, whose ends are said
        cuts = np.flatnonzero(gaps > np.sort(gaps)[-_MOST_SPANS])
        begins, stops = begins[np.append(0, cuts + 1)], stops[np.append(cuts, -1)]
    bounds = np.sort([begins, stops], axis=0)  # a clock may have gone back
    return spans_of(bounds[0], bounds[1], start)


def quoted(text: str) -> str:
    """Text of a log as it may stand in a message."""
    return repr(text if len(text) <= _EXAMPLE_CHARACTERS else text[: _EXAMPLE_CHARACTERS - 1] + "…")


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
    """One pass over the file for columns of numbers and, by `texts`, of words.

    `keys` are columns that separate series, `wanted` their cells; None for every series.

    Raises:
        UserError: where no row has a time, another header stands among the rows, or the file
            cannot be read.
    """
    lines = Lines(table.path, table.dialect)
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
            lines_in_order = map(parsed.block.text, lines_above)
            segments[row_count + rows_above] = stamps_in([*lines_in_order], table.dialect.delimiter)
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
    """Which rows are used, block by block: those with a time and a wanted key, of None with any."""

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
