"""One pass over the rows of a delimited text log for some of its columns, every line accounted for.

The columns are read with explicit types by pyarrow, plain numbers in a long log by `plain`; what
cannot be read is counted by class and located. A block is what is in memory beside the columns.
"""

import os
import re
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.finding import Severity
from ...core.model import Bools, Floats, Times
from ..source import ReadOptions
from . import arrow as pc
from .clock import Clock, checked_floats, is_missing
from .dialect import NULLS, Dialect, is_comment, is_null, split, uncommented
from .lines import Block, Lines
from .long_table import Key
from .rejects import Rejects

_MAX_MET = 1_000  # keys of series, beyond which no more are collected
_MANY = 20_000_000  # cells, from which loading the compiled parser pays
_TRIES = 8  # blocks that are not plain, in excess of those that are, before no more are tried
_PIECE = 1 << 16  # bytes looked at together: a copy of them stays in the cache
_FALLS, _AROUND = 3, 20  # falls of the time in a block that are looked at, rows on each side
_T, _GROUP = -1, -2  # what a scan gives beside its columns

SKIPPED = {
    "too few cells": "have too few cells",
    "too many cells": "have too many cells",
    "time missing": "have no time stamp",
    "time unreadable": "have a time stamp that cannot be read",
    "group missing": "do not say which device or axle they belong to",
    "NUL bytes": "hold NUL bytes, as of space that was reserved and never written",
    "cut off": "are cut off where the data end",
    "another table": "stand above the header that was taken and are of another table: split the "
    "log there",
    "another header": "stand below a header of other columns or units: split the log there",
}


CELLS: dict[int, tuple[str, Severity, str]] = {
    1: ("csv-missing-cells", "info", "are empty or say there is no value"),
    2: ("csv-bad-cells", "warning", "hold no number"),
    3: ("not-a-number", "warning", "are infinite"),
}


@dataclass(slots=True)
class _Wrong:
    """Rows of a block that have another number of cells, by class."""

    rows: dict[str, list[NDArray[np.int64]]] = field(default_factory=dict)  # each part rises
    first: dict[str, tuple[int, str]] = field(default_factory=dict)  # row and text

    def add(self, kind: str, rows: NDArray[np.int64], text: str) -> None:
        """Adds rows of the block, the first of which says `text`."""
        self.rows.setdefault(kind, []).append(rows)
        self.first[kind] = min(self.first.get(kind, (rows[0], text)), (rows[0], text))

    def of(self, *kinds: str) -> NDArray[np.int64]:
        """Rows of some classes, in order; of all if none is named."""
        parts = [rows for kind in kinds or self.rows for rows in self.rows.get(kind, [])]
        return np.sort(np.concatenate(parts)) if parts else np.empty(0, np.int64)


@dataclass(slots=True)
class _Part:
    """What one block gave; arrays of its n rows of the right width."""

    block: Block
    rows: slice  # of the scan's columns: where its times and values are
    arrays: dict[int, Any]  # Arrow arrays of the columns that are looked at again
    timed: Bools
    states: dict[int, NDArray[np.int8]]
    wrong: "_Wrong"
    blank: int
    inside: int  # line ends inside quotes
    _spans: NDArray[np.int64] | None = None

    def numbers(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Rows of the arrays as rows of the block, wrong ones included; both from 0."""
        wrong = self.wrong.of()
        # wrong rows stand between: row k of the arrays is row k + (wrong ones before it)
        gaps = wrong - np.arange(len(wrong))
        return rows + np.searchsorted(gaps, rows, side="right")

    def places(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Start, end, first and last line of rows of the block, shape (n, 4)."""
        if self._spans is None:
            self._spans = self.block.rows()
        return self._spans[numbers]

    def line(self, row: int) -> tuple[int, str]:
        """Line number and text of a row of the arrays."""
        return self.text(int(self.numbers(np.array([row]))[0]))

    def text(self, number: int) -> tuple[int, str]:
        """Line number and text of a row of the block."""
        ((start, end, line, _),) = self.places(np.array([number]))
        text = self.block.data[start : min(end, start + 100_000)]
        return int(line), text.decode("utf-8", "replace")


@dataclass(slots=True)
class Scan:
    """One pass over the file for some of its columns."""

    path: Path
    options: ReadOptions
    dialect: Dialect
    clock: Clock
    types: dict[int, tuple[Any, ...]]  # Arrow types still to try by column; kept between passes
    units: dict[int, str]  # of columns whose cells carry it
    expected: int  # rows, roughly
    indices: list[int]
    keys: tuple[int, ...] = ()  # columns that tell series apart
    wanted: list[Key] | None = None  # their cells; None: every one met
    used: int = 0  # rows of `columns` that are final
    columns: dict[int, NDArray[Any]] = field(default_factory=dict)  # by index, _T and _GROUP
    lines: Counter[str] = field(default_factory=Counter)
    first: dict[str, tuple[int, str]] = field(default_factory=dict)
    cells: Counter[tuple[int, int]] = field(default_factory=Counter)
    first_cell: dict[tuple[int, int], tuple[int, str, int]] = field(default_factory=dict)
    met: list[Key] = field(default_factory=list)
    damage: str = ""
    open_end: bool = False
    rejects: Rejects | None = None
    tries: int = 0  # at taking a block as plain numbers
    ended: bool = False  # by a header of other columns
    again: int = 0  # rows that are the header once more
    skipped_at: int | None = None  # time before the first row left out, else behind it [ns]

    def read(self) -> tuple[Times, NDArray[np.int64], dict[int, Floats]]:  # noqa: C901
        """Times, group codes and values of the rows that have a time and a wanted group."""
        self.lines.update(self.dialect.before)
        if above := self.dialect.above:
            self.first["another table"] = above[0][0], above[0][2]
        self.met = list(self.wanted or [])
        for i in self.indices:
            self.types.setdefault(i, (pa.float64(), pa.string()))
        source = Lines(self.path, self.dialect, self.options.max_unpacked)
        if self.options.rejects:
            self.rejects = Rejects(source, self.dialect.names)
            if above:
                self.rejects.add(np.array([row[:2] for row in above]), "another table")
        many = self.expected * self.dialect.width > _MANY
        power = self.clock.power
        if many and not self.keys and power is not None:
            self.tries = _TRIES if power >= 0 or self.dialect.delimiter != " " else 0
        room = self.expected + self.expected // 16
        whole = [_T, _GROUP] if self.keys else [_T]
        self.columns = {i: np.empty(room, np.int64) for i in whole}
        self.columns |= {i: np.empty(room) for i in self.indices}
        for part in self._parts(source):
            self._count_lines(part)
            keep = self._count_times(part)
            self._count_groups(part, keep)
            for i, state in part.states.items():
                self._count_cells(part, i, state, keep)
            if self.skipped_at is None:
                self.skipped_at = self._beside_skipped(part, keep)
            self._close_up(part, keep)
        self.lines["used"] = self.used
        self.damage, self.open_end = source.damage, source.open_end
        if source.cut_off:
            self.lines["cut off"] += 1
            self.first["cut off"] = source.cut_off
            if self.rejects is not None:
                self.rejects.add(np.full((1, 2), source.cut_off[0]), "cut off")
        if not self.used:
            raise UserError(
                f"{self.path}: no row has a time stamp that can be read",
                'state the time, as time = {channel = "…", unit = "s"} under [channels]',
            )
        final = {i: column[: self.used] for i, column in self.columns.items()}
        if self.skipped_at is None:  # what ends the file
            self.skipped_at = int(final[_T][-1])
        return final[_T], final.get(_GROUP, np.empty(0, np.int64)), final

    def _beside_skipped(self, part: _Part, keep: Bools) -> int | None:
        """Time of the row before the first one left out, else behind it; None for none yet."""
        left_out = [c for c in SKIPPED if self.lines[c]]
        rows = np.flatnonzero(keep)
        if not left_out or not (self.used or len(rows)):
            return None
        t = self.columns[_T][part.rows][rows]
        lines = part.places(part.numbers(rows))[:, 2]
        first = min(self.first[c][0] if c in self.first else 0 for c in left_out)
        before = int(np.searchsorted(lines, first))
        if before == 0 and self.used:
            return int(self.columns[_T][self.used - 1])
        return int(t[max(before - 1, 0)])

    def where(self, kind: str) -> str:
        """Where lines of a kind that is skipped begin, and how the first one reads."""
        if kind not in self.first:
            return "before the header"
        line, text = self.first[kind]
        return f"first in line {line}: {quoted(text)}"

    def _parts(self, source: Lines) -> Iterator[_Part]:
        """The blocks parsed, in order, as many at once as there are processors.

        Each writes its times and values where they belong if no line before it is left out.
        """
        workers = min(os.cpu_count() or 1, 4) + 1  # one waits for the interpreter now and then
        at = 0
        with ThreadPoolExecutor(workers) as pool:
            waiting: deque[Future[_Part]] = deque()
            for block in source.blocks():
                if at + block.lines > len(self.columns[_T]):
                    while waiting:
                        yield waiting.popleft().result()
                    at = self.used
                    self._grow(at + block.lines)
                waiting.append(pool.submit(self._parse, block, at))
                at += block.lines
                if len(waiting) > 2 * workers:  # so many that no worker waits for the file
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()

    def _grow(self, need: int) -> None:
        """Makes room for so many rows, and as many again where there was not enough."""
        if need > len(self.columns[_T]):
            for i, column in self.columns.items():
                self.columns[i] = np.empty(2 * need, column.dtype)
                self.columns[i][: self.used] = column[: self.used]

    def _close_up(self, part: _Part, keep: Bools) -> None:
        """Moves a part's rows behind the final ones, without those that are left out."""
        end = self.used + int(keep.sum())
        if part.rows != slice(self.used, end):
            for column in self.columns.values():
                column[self.used : end] = column[part.rows][keep]
        self.used = end

    def _parse(self, block: Block, at: int) -> _Part:  # noqa: C901
        """One block's columns; changes nothing but `types`, and `columns` from `at` on."""
        if part := self._plain(block, at):
            return part
        blank = inside = 0
        if not block.data.isascii():  # the parser tells no wrong row that is not UTF-8
            text = block.data[: block.size].decode("utf-8", "replace")
            block.data = text.replace("\ufeff", "").encode()  # it begins a file joined to another
            block.size = len(block.data)
        if block.quotes:
            feeds, ends = block.ends()
            inside = len(feeds) - len(ends)
        fit, wrong, kept = self._sieved(block)
        while True:
            types = {i: self.types[i][0] for i in (*self.clock.columns, *self.indices)}
            for i in self.keys:
                types.setdefault(i, pa.string())
            asked: list[tuple[int, str, str]] = []  # row, class and text
            try:
                table = self._table(fit, types, inside > 0, asked)
            except pa.ArrowInvalid as error:
                self._demote(block, str(error), types)
                continue
            arrays = {i: _flat(table[f"c{i}"]) for i in types}
            checked = {
                i: checked_floats(arrays[i], self.dialect.decimal, self.units.get(i, ""))
                for i in self.indices
            }
            unfit = [
                i
                for i, kind in types.items()
                if pa.types.is_floating(kind) and not self._is_exact(arrays[i], checked.get(i))
            ]
            if not unfit:
                break
            for i in unfit:
                self.types[i] = tuple(k for k in self.types[i] if not pa.types.is_floating(k))
        for kind in {kind for _, kind, _ in asked}:
            told = [(row, text) for row, of, text in asked if of == kind]
            numbers = np.array([row for row, _ in told])
            wrong.add(kind, numbers if kept is None else kept[numbers], told[0][1])
        left_out = len(wrong.of())
        if block.lines != table.num_rows + left_out:
            feeds, ends = block.ends()
            blank = int((np.diff(ends, prepend=-1) == 1).sum())
            inside = len(feeds) - len(ends)
            if block.lines != table.num_rows + left_out + blank + inside:
                raise UserError(
                    f"{self.path}: the quotes after line {block.first_line} cannot be followed",
                    "mend the quotes in the log",
                )
        rows = slice(at, at + table.num_rows)
        t, timed = self.clock.nanoseconds([arrays[i] for i in self.clock.columns])
        self.columns[_T][rows] = t
        for i, (value, _) in checked.items():
            self.columns[i][rows] = value
        states = {i: state for i, (_, state) in checked.items() if state.any()}
        again = self.keys if timed.all() else (*self.keys, *self.clock.columns)
        arrays = {i: arrays[i] for i in again}
        return _Part(block, rows, arrays, timed, states, wrong, blank, inside)

    def _plain(self, block: Block, at: int) -> _Part | None:
        """The same of a block of plain numbers, but for a few cells; None where it is none."""
        if block.quotes or not self.tries:
            return None
        from . import numbers

        found = numbers.parse(
            np.frombuffer(block.data, np.uint8, block.size), block.delimiter, self.dialect.decimal,
            self.dialect.width, self.clock.columns[0], self.clock.power or 0, self.indices,
            block.lines,
        )  # fmt: skip
        if found is None:
            self.tries -= 1
            return None
        self.tries = min(self.tries + 1, _TRIES)
        rows = slice(at, at + block.lines)
        self.columns[_T][rows] = found.times
        states = {}
        for k, i in enumerate(self.indices):
            value = found.values[k]
            state = np.isnan(value).view(np.int8)
            odd = found.odd[found.odd[:, 0] == k, 1:]
            if len(odd):
                cells = [block.data[a:b].decode("utf-8", "replace") for _, a, b in odd.tolist()]
                value[odd[:, 0]], state[odd[:, 0]] = checked_floats(
                    pa.array(cells), self.dialect.decimal, self.units.get(i, "")
                )
            self.columns[i][rows] = value
            if state.any():
                states[i] = state
        return _Part(block, rows, {}, np.ones(block.lines, np.bool_), states, _Wrong(), 0, 0)

    def _sieved(self, block: Block) -> tuple[Block, _Wrong, NDArray[np.int64] | None]:
        """The block without rows of another width, those, and which rows of the block are left.

        The parser asks about each of them, which takes as long as a hundred sound ones. Those that
        may be blank, comments or holes are left to it; None where the block is as it was.
        """
        text, mark = np.frombuffer(block.data, np.uint8, block.size), ord(block.delimiter)
        pieces = (text[i : i + _PIECE] for i in range(0, len(text), _PIECE))
        marks = sum(np.count_nonzero(piece == mark) for piece in pieces)
        found = _Wrong()
        if block.quotes or marks == block.lines * (self.dialect.width - 1):
            return block, found, None
        feeds = np.flatnonzero(text == 10)
        starts = np.append(0, feeds[:-1] + 1)
        starts, ends = starts[feeds > starts], feeds[feeds > starts]
        before = np.searchsorted(np.flatnonzero(text == mark), [starts, ends])
        cells = before[1] - before[0] + 1
        bare = (text[starts] < 128) & ~np.isin(
            text[starts], list(b"\0 \t\r\f\v\x1c\x1d\x1e\x1f#%/")
        )
        wrong = bare & (cells != self.dialect.width)
        if not wrong.any():
            return block, found, None
        wrong[-1] &= not wrong.all()  # the parser takes no block without a row
        few = cells < self.dialect.width
        for kind, which in (("too few cells", wrong & few), ("too many cells", wrong & ~few)):
            rows = np.flatnonzero(which)
            if len(rows):
                a, b = int(starts[rows[0]]), int(ends[rows[0]])
                shown = block.data[a : min(b, a + 400)].decode("utf-8", "replace")[:100]
                found.add(kind, rows, shown)
        away = np.zeros(block.size + 1, np.int8)
        np.add.at(away, starts[wrong], 1)
        np.add.at(away, ends[wrong] + 1, -1)
        data = text[np.cumsum(away[:-1], dtype=np.int8) == 0].tobytes()
        return replace(block, data=data, size=len(data)), found, np.flatnonzero(~wrong)

    def _is_exact(self, array: Any, checked: tuple[Floats, Any] | None) -> bool:
        """Whether float64 says what the cells of a column said; no `checked` for the time's.

        1e400 parses as infinity; the strict grammar of text tells it from a spelled "inf".
        """
        if checked is None:
            return self.clock.is_exact(array)
        value, state = checked
        return not (state.any() and np.isinf(value).any())

    def _table(self, block: Block, types: dict[int, Any], multiline: bool, wrong: list[Any]) -> Any:
        def skip(row: Any) -> str:
            text = row.text
            few = row.actual_columns < row.expected_columns
            kind = "too few cells" if few else "too many cells"
            if "\0" in text:
                kind = "NUL bytes"
            elif not text.strip():
                kind = "blank"
            elif is_comment(text):
                kind = "comment"
            wrong.append((row.number - 1, kind, text[:100]))
            return "skip"

        return pyarrow.csv.read_csv(
            pa.BufferReader(pa.py_buffer(block.data).slice(0, block.size)),
            pyarrow.csv.ReadOptions(
                column_names=[f"c{i}" for i in range(self.dialect.width)],
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
                decimal_point=self.dialect.decimal,
            ),
        )

    def _demote(self, block: Block, error: str, tried: dict[int, Any]) -> None:
        """Sets the next type of the column whose cells do not fit; raises where there is none."""
        found = re.search(r"CSV column #(\d+)", error)
        i = int(found[1]) if found else -1
        if i in tried and i in self.types and self.types[i][0] is not tried[i]:
            return  # another block has done so already
        if i in self.types and len(self.types[i]) > 1:
            self.types[i] = self.types[i][1:]
            return
        raise UserError(
            f"{self.path}: cannot be read from line {block.first_line} on: {error.splitlines()[0]}",
            "mend the log, or state its dialect under [csv]",
        )

    def _count_lines(self, part: _Part) -> None:
        self.lines.update({"blank": part.blank, "inside quotes": part.inside})
        for kind, (row, text) in part.wrong.first.items():
            if kind not in self.first:
                self.first[kind] = int(part.places(np.array([row]))[0, 2]), text
            numbers = part.wrong.of(kind)
            self.lines[kind] += len(numbers)
            if kind in SKIPPED:
                self._reject(part, numbers, kind)

    def _reject(
        self, part: _Part, numbers: NDArray[np.int64], reason: str, column: int = -1
    ) -> None:
        if self.rejects is not None:
            self.rejects.add(part.places(numbers)[:, 2:], reason, column)

    def _count_times(self, part: _Part) -> Bools:
        """Which rows have a time and are of this table; the others are counted by class."""
        ok = part.timed.copy()
        if not ok.all():
            self._count_untimed(part, ok)
        if not self.keys:
            self._refuse_unpadded(part, ok)
        end = 0 if self.ended else self._end(part, np.flatnonzero(~part.timed))
        if end is not None:
            below = ok & (part.numbers(np.arange(len(ok))) >= end)
            self._drop(part, below, "another header")
            ok &= ~below
        return ok

    def _refuse_unpadded(self, part: _Part, ok: Bools) -> None:
        """Refuses times that fall as those do that lack leading zeros, which the head may not show.

        They fall once a second: a few falls of each block are looked at.
        """
        t = self.columns[_T][part.rows]
        falls = np.flatnonzero((t[1:] < t[:-1]) & ok[1:] & ok[:-1])
        for k in falls[:_FALLS].tolist():
            near = range(max(k - _AROUND, 0), min(k + _AROUND, len(t)))
            rows = [split(part.line(row)[1], part.block.delimiter) for row in near if ok[row]]
            self.clock.refuse_unpadded(
                [[cells[i] for i in self.clock.columns] for cells in rows],
                self.dialect.names[self.clock.columns[-1]], self.path,
            )  # fmt: skip

    def _count_untimed(self, part: _Part, ok: Bools) -> None:
        """Counts the rows that have no time by class."""
        missing = np.zeros(len(ok), bool)
        for i in self.clock.columns:
            missing |= is_missing(part.arrays[i])
        comment = np.zeros(len(ok), bool)
        if any(mark in part.block.data for mark in (b"#", b"%", b"//")):
            comment[[r for r in np.flatnonzero(~ok) if is_comment(part.line(int(r))[1])]] = True
        self.lines["comment"] += int(comment.sum())
        again = self._header_again(part, ~ok & ~missing & ~comment)
        self._drop(part, ~ok & missing & ~comment, "time missing")
        self._drop(part, ~ok & ~missing & ~comment & ~again, "time unreadable")

    def _header_again(self, part: _Part, which: Bools) -> Bools:
        """Which of these rows are the header, or the units row, once more; they are counted."""
        again = np.zeros(len(which), bool)
        i = self.clock.columns[0]
        heads = [list(cells) for cells in (*self.dialect.parts, self.dialect.units) if any(cells)]
        if not heads or not pa.types.is_string(part.arrays[i].type):
            return again
        bare = pc.utf8_trim(part.arrays[i], "[](){}<> ")
        known = pa.array([cells[i].strip("[](){}<> ") for cells in heads], pa.string())
        for row in np.flatnonzero(which & np.asarray(pc.is_in(bare, known))).tolist():
            cells = split(part.line(row)[1], part.block.delimiter)[: len(self.dialect.names)]
            if cells in heads or [c.strip("[](){}<> ") for c in cells] in heads:
                again[row] = True
        if n := int(again.sum()):
            self.lines["header"] += n
            self.again += n
            self.first.setdefault("again", part.line(int(again.argmax())))
        return again

    def _end(self, part: _Part, untimed: NDArray[np.int64]) -> int | None:
        """Row of the block that is a header of other columns or units, where this table ends."""
        commented = self.dialect.headed and not self.dialect.before.get("header")
        kinds = {*SKIPPED, "comment"} if commented else {*SKIPPED}
        rows = np.sort(np.append(part.numbers(untimed), part.wrong.of(*kinds)))
        if not len(rows):
            return None
        spans = part.places(rows)
        first = np.frombuffer(part.block.data, np.uint8)[spans[:, 0]]
        two_cells = spans[:, 1] - spans[:, 0] > 2
        seen = set()  # a row need not be judged twice
        for k in np.flatnonzero(two_cells & ~np.isin(first, list(b"+-.0123456789"))):
            row, (start, end) = int(rows[k]), spans[k, :2]
            if (raw := part.block.data[start:end]) in seen:
                continue
            seen.add(raw)
            _, text = place = part.text(row)
            bare = uncommented(text) if commented else text
            cells = split(bare, part.block.delimiter)
            if bare != text and len({*cells} & {*self.dialect.names}) < 2:
                continue  # a remark
            if self.dialect.contradicted(cells):
                self.first["another header"] = place
                self.ended = True
                return row
        return None

    def _count_groups(self, part: _Part, keep: Bools) -> None:
        """Finds each row's group in `met`; takes rows of no or another group from `keep`."""
        if not self.keys:
            return
        cells = [pc.fill_null(pc.cast(part.arrays[i], pa.string()), "") for i in self.keys]
        cells = [pc.utf8_trim_whitespace(c) for c in cells]
        encoded = pc.binary_join_element_wise(*cells, "\0").dictionary_encode()  # no row has a NUL
        keys = [tuple(text.split("\0")) for text in encoded.dictionary.to_pylist()]
        said = np.array([not any(map(is_null, key)) for key in keys], bool)
        at = {v: k for k, v in enumerate(self.met)}
        index = np.asarray(encoded.indices)
        if self.wanted is None and len(at) <= _MAX_MET:
            for k in np.flatnonzero(np.bincount(index[keep], minlength=len(keys)) * said):
                at.setdefault(keys[k], len(at))
            self.met = list(at)
        codes = np.array([at.get(v, -1) for v in keys], np.int64)
        self._drop(part, keep & ~said[index], "group missing")
        other = keep & said[index] & (codes[index] < 0)
        self.lines["other group"] += int(other.sum())
        keep &= codes[index] >= 0
        self.columns[_GROUP][part.rows] = codes[index]

    def _drop(self, part: _Part, which: Bools, kind: str) -> None:
        if n := int(which.sum()):
            self.lines[kind] += n
            if kind not in self.first:
                self.first[kind] = part.line(int(which.argmax()))
            self._reject(part, part.numbers(np.flatnonzero(which)), kind)

    def _count_cells(self, part: _Part, i: int, state: NDArray[np.int8], keep: Bools) -> None:
        for k in CELLS:
            which = (state == k) & keep
            if n := int(which.sum()):
                self.cells[i, k] += n
                if k > 1:
                    reason = "no number" if k == 2 else "infinite"
                    self._reject(part, part.numbers(np.flatnonzero(which)), reason, i)
                if (i, k) not in self.first_cell:
                    row = int(which.argmax())
                    line, text = part.line(row)
                    cells = split(text, part.block.delimiter)
                    shown = cells[i] if i < len(cells) else ""
                    t = int(self.columns[_T][part.rows][row])
                    self.first_cell[i, k] = line, shown, t


def _flat(column: Any) -> Any:
    """One Arrow array from a chunked one."""
    return column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()


def quoted(text: str) -> str:
    """Text of a log as it may stand in a message."""
    return repr(text if len(text) <= 60 else text[:59] + "…")
