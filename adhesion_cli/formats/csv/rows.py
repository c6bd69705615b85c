"""One pass over the rows of a text log for some of its columns, every line accounted for."""

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.model import Bools, Floats, Times
from . import arrow as pc
from .block_parser import Parser, Part, Table
from .dialect import is_null
from .lines import Lines
from .losses import Losses
from .rejects import Rejects
from .row_filter import RowFilter

Key = tuple[str, ...]  # cells of the key columns

_MAX_MET = 1_000  # keys of series, beyond which no more are collected
_T, _SERIES = -1, -2  # what a pass gives besides its columns


@dataclass(frozen=True, slots=True)
class Reading:
    """What one pass gave: rows that have a time and a wanted key; arrays of shape (n,)."""

    times: Times
    codes: NDArray[np.int64]  # number of each row's key in `met`; empty without keys
    values: dict[int, Floats]
    met: list[Key]
    losses: Losses
    lines: Lines  # with what is wrong at the end of the file


def read_rows(
    table: Table, indices: list[int], keys: tuple[int, ...] = (), wanted: list[Key] | None = None
) -> Reading:
    """One pass over the file.

    Args:
        table: how to read it.
        indices: columns of numbers.
        keys: columns that separate series.
        wanted: their cells; None for every series that occurs.

    Raises:
        UserError: where no row has a time, or the file cannot be read.
    """
    for i in indices:
        table.types.setdefault(i, (pa.float64(), pa.string()))
    lines = Lines(table.path, table.dialect, table.options.max_unpacked)
    rejects = Rejects(lines, table.dialect.names) if table.options.rejects else None
    losses = Losses(table.dialect, rejects)
    rows = RowFilter(table, losses, bool(keys))
    groups = _Groups(keys, wanted, losses)
    parser = Parser(table, indices, keys)
    kept = _Kept([_T, _SERIES] if keys else [_T], indices, table.expected)
    for part in _parts(lines, parser):
        losses.parsed(part)
        keep = rows.used(part)
        codes = groups.codes(part, keep)
        losses.cells_of(part, keep)
        losses.timed(part, keep, kept.last)
        kept.add({_T: part.times, _SERIES: codes, **part.values}, keep)
    if kept.last is None:
        raise UserError(
            f"{table.path}: no row has a time stamp that can be read",
            'state the time, as time = {channel = "…", unit = "s"} under [channels]',
        )
    losses.lines["used"] = kept.used
    if lines.cut_off:
        losses.cut_off(*lines.cut_off, kept.last)
    final = kept.columns()
    codes = final.pop(_SERIES, np.empty(0, np.int64))
    return Reading(final.pop(_T), codes, final, groups.met, losses, lines)


def _parts(lines: Lines, parser: Parser) -> Iterator[Part]:
    """The blocks parsed, in order, as many at once as there are processors."""
    workers = min(os.cpu_count() or 1, 4) + 1  # one waits for the interpreter now and then
    with ThreadPoolExecutor(workers) as pool:
        waiting: deque[Future[Part]] = deque()
        for block in lines.blocks():
            waiting.append(pool.submit(parser.parse, block))
            if len(waiting) > 2 * workers:  # so many that no worker waits for the file
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


class _Kept:
    """Columns that grow as rows are added."""

    def __init__(self, whole: list[int], floats: list[int], expected: int) -> None:
        self.used = 0
        room = expected + expected // 16
        self._columns: dict[int, NDArray[Any]] = {i: np.empty(room, np.int64) for i in whole}
        self._columns |= {i: np.empty(room) for i in floats}

    @property
    def last(self) -> int | None:
        """Time of the last row [ns]."""
        return int(self._columns[_T][self.used - 1]) if self.used else None

    def add(self, arrays: dict[int, NDArray[Any]], keep: Bools) -> None:
        """Adds the rows that are kept of each column."""
        end = self.used + int(keep.sum())
        every = bool(keep.all())
        for i, column in self._columns.items():
            if end > len(column):
                self._columns[i] = np.empty(2 * end, column.dtype)
                self._columns[i][: self.used] = column[: self.used]
            self._columns[i][self.used : end] = arrays[i] if every else arrays[i][keep]
        self.used = end

    def columns(self) -> dict[int, NDArray[Any]]:
        """The columns as far as they are filled."""
        return {i: column[: self.used] for i, column in self._columns.items()}


class _Groups:
    """Finds the key of each row, and counts rows of no or another series."""

    def __init__(self, keys: tuple[int, ...], wanted: list[Key] | None, losses: Losses) -> None:
        self.met = list(wanted or [])
        self._keys, self._all, self._losses = keys, wanted is None, losses

    def codes(self, part: Part, keep: Bools) -> NDArray[np.int64]:
        """Number of each row's key in `met`; takes rows without a wanted one from `keep`."""
        if not self._keys:
            return np.empty(0, np.int64)
        cells = [pc.fill_null(pc.cast(part.arrays[i], pa.string()), "") for i in self._keys]
        cells = [pc.utf8_trim_whitespace(c) for c in cells]
        encoded = pc.binary_join_element_wise(*cells, "\0").dictionary_encode()  # no row has a NUL
        keys = [tuple(text.split("\0")) for text in encoded.dictionary.to_pylist()]
        said = np.array([not any(map(is_null, key)) for key in keys], bool)
        at = {v: k for k, v in enumerate(self.met)}
        index = np.asarray(encoded.indices)
        if self._all and len(at) <= _MAX_MET:
            for k in np.flatnonzero(np.bincount(index[keep], minlength=len(keys)) * said):
                at.setdefault(keys[k], len(at))
            self.met = list(at)
        codes: NDArray[np.int64] = np.array([at.get(v, -1) for v in keys], np.int64)[index]
        self._losses.rows(part, keep & ~said[index], "group missing")
        self._losses.rows(part, keep & said[index] & (codes < 0), "other group")
        keep &= codes >= 0
        return codes
