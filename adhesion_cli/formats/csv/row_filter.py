"""Which rows of a block are used: they have a time and are above any other header."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from ...core.model import Bools
from . import arrow as pc
from .block_parser import Part, Rows, Table, joined
from .cells import is_missing
from .dialect import is_comment, split, uncommented
from .losses import SKIPPED, Losses

_FALLS, _AROUND = 3, 20  # falls of the time in a block that are looked at, rows on each side
_BRACKETS = "[](){}<> "


@dataclass(slots=True)
class RowFilter:
    """Filters the rows of the blocks of one pass, in their order."""

    table: Table
    losses: Losses
    interleaved: bool  # rows of several series; their times may fall
    ended: bool = False  # by a header of other columns

    def used(self, part: Part) -> Bools:
        """Which rows have a time and belong to this table; counts the others by class.

        Raises:
            UserError: where fractions of a second lack their leading zeros.
        """
        ok = part.timed.copy()
        if not ok.all():
            self._count_untimed(part, ok)
        if not self.interleaved:
            self._refuse_unpadded(part, ok)
        end = 0 if self.ended else self._end(part, np.flatnonzero(~part.timed))
        if end is not None:
            below = ok & (part.numbers(np.arange(len(ok))) >= end)
            self.losses.rows(part, below, "another header")
            ok &= ~below
        return ok

    def _refuse_unpadded(self, part: Part, ok: Bools) -> None:
        """Refuses fractions of a second without leading zeros, which the head may not show.

        Such times fall once a second: a few falls of each block are looked at.
        """
        t = part.times
        falls = np.flatnonzero((t[1:] < t[:-1]) & ok[1:] & ok[:-1])
        for k in falls[:_FALLS].tolist():
            near = range(max(k - _AROUND, 0), min(k + _AROUND, len(t)))
            rows = [split(part.line(row)[1], part.block.delimiter) for row in near if ok[row]]
            times = [[cells[i] for i in self.table.clock.columns] for cells in rows]
            name = self.table.dialect.names[self.table.clock.columns[-1]]
            self.table.clock.refuse_unpadded(times, name, self.table.path)

    def _count_untimed(self, part: Part, ok: Bools) -> None:
        """Counts the rows that have no time by class."""
        missing = np.zeros(len(ok), bool)
        for i in self.table.clock.columns:
            missing |= is_missing(part.arrays[i])
        comment = np.zeros(len(ok), bool)
        if any(mark in part.block.data for mark in (b"#", b"%", b"//")):
            comment[[r for r in np.flatnonzero(~ok) if is_comment(part.line(int(r))[1])]] = True
        unread = ~ok & ~missing & ~comment
        again = self._header_again(part, unread)
        self.losses.rows(part, comment, "comment")
        self.losses.rows(part, again, "header again")
        self.losses.rows(part, ~ok & missing & ~comment, "time missing")
        self.losses.rows(part, unread & ~again, "time unreadable")

    def _header_again(self, part: Part, which: Bools) -> Bools:
        """Which of these rows are the header, or the units row, once more."""
        again = np.zeros(len(which), bool)
        i = self.table.clock.columns[0]
        dialect = self.table.dialect
        heads = [list(cells) for cells in (*dialect.parts, dialect.units) if any(cells)]
        if not heads or not pa.types.is_string(part.arrays[i].type):
            return again
        bare = pc.utf8_trim(part.arrays[i], _BRACKETS)
        known = pa.array([cells[i].strip(_BRACKETS) for cells in heads], pa.string())
        for row in np.flatnonzero(which & np.asarray(pc.is_in(bare, known))).tolist():
            cells = split(part.line(row)[1], part.block.delimiter)[: len(dialect.names)]
            again[row] = cells in heads or [c.strip(_BRACKETS) for c in cells] in heads
        return again

    def _end(self, part: Part, untimed: Rows) -> int | None:
        """Row of the block that is a header of other columns or units, where this table ends."""
        commented = self.table.dialect.headed and not self.table.dialect.before.get("header")
        kinds = {*SKIPPED, "comment"} if commented else {*SKIPPED}
        wrong = (numbers for kind, numbers in part.wrong.items() if kind in kinds)
        rows = joined([part.numbers(untimed), *wrong])
        if not len(rows):
            return None
        spans = part.places(rows)
        first = np.frombuffer(part.block.data, np.uint8)[spans[:, 0]]
        two_cells = spans[:, 1] - spans[:, 0] > 2
        seen = set()  # a row need not be looked at twice
        for k in np.flatnonzero(two_cells & ~np.isin(first, list(b"+-.0123456789"))):
            start, end = spans[k, :2]
            if (raw := part.block.data[start:end]) in seen:
                continue
            seen.add(raw)
            if self._is_other_header(part.text(int(rows[k]))[1], part.block.delimiter, commented):
                self.ended = True
                return int(rows[k])
        return None

    def _is_other_header(self, text: str, delimiter: str, commented: bool) -> bool:
        bare = uncommented(text) if commented else text
        cells = split(bare, delimiter)
        if bare != text and len({*cells} & {*self.table.dialect.names}) < 2:
            return False  # a remark
        return self.table.dialect.contradicted(cells)
