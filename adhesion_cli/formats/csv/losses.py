"""What a pass over a text log leaves out: rows and cells, counted, located and timed."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...core.finding import Finding, Severity, Span, merged
from ...core.model import Bools, Times
from .block_parser import Part, Rows
from .cells import IS_INFINITE, NO_NUMBER, NO_VALUE
from .dialect import Dialect, split
from .rejects import Rejects

_MOST = 20  # spans of one finding
_SHOWN = 40  # characters of a cell or row in a message

SKIPPED = {  # classes of rows that are data and are left out
    "too few cells": "too few cells",
    "too many cells": "too many cells",
    "time missing": "no time stamp",
    "time unreadable": "time stamp not readable",
    "group missing": "no device or axle",
    "NUL bytes": "NUL bytes, from space that was never written",
    "cut off": "cut off at the end of the data",
    "another table": "another table above the header",
    "another header": "below a header of other columns or units",
}
_CODES: dict[int, tuple[str, Severity, str]] = {
    NO_VALUE: ("csv-missing-cells", "info", ""),
    NO_NUMBER: ("csv-bad-cells", "warning", "no number"),
    IS_INFINITE: ("not-a-number", "warning", "infinite"),
}


class Losses:
    """Counts lines by class, and cells that hold no number.

    `rejects` remembers each row and cell; None where the user does not want them.
    """

    def __init__(self, dialect: Dialect, rejects: Rejects | None) -> None:
        self.lines: Counter[str] = Counter(dialect.before)
        self.cells: Counter[tuple[int, int]] = Counter()  # column and state
        self.rejects = rejects
        self._dialect = dialect
        self._first = dict(dialect.first)  # line and text
        self._first_cell: dict[tuple[int, int], tuple[int, str]] = {}
        self._spans: dict[str | tuple[int, int], list[Span]] = {}  # [ns]
        self._early = set(self.lines)  # classes of lines before the first row that has a time
        if rejects is not None and dialect.above:
            rejects.add(np.array([row[:2] for row in dialect.above]), "another table")

    def parsed(self, part: Part) -> None:
        """Counts what the parser left out of a block."""
        self.lines.update({"blank": part.blank, "inside quotes": part.inside})
        for kind, numbers in part.wrong.items():
            self._count(part, numbers, kind)

    def rows(self, part: Part, which: Bools, kind: str) -> None:
        """Counts rows of a block's arrays that are left out."""
        if which.any():
            self._count(part, part.numbers(np.flatnonzero(which)), kind)

    def _count(self, part: Part, numbers: Rows, kind: str) -> None:
        self.lines[kind] += len(numbers)
        if kind not in self._first:
            self._first[kind] = part.text(int(numbers[0]))
        if kind in SKIPPED:
            part.gone[kind] = numbers
            self._reject(part, numbers, kind)

    def _reject(self, part: Part, numbers: Rows, reason: str, column: int = -1) -> None:
        if self.rejects is not None:
            self.rejects.add(part.places(numbers)[:, 2:], reason, column)

    def cells_of(self, part: Part, keep: Bools) -> None:
        """Counts cells without a number in the rows of a block that are kept."""
        for (i, state), k in ((item, k) for item in part.states.items() for k in _CODES):
            which = (state == k) & keep
            if not which.any():
                continue
            rows = np.flatnonzero(which)
            self.cells[i, k] += len(rows)
            ends = np.flatnonzero(np.diff(rows, prepend=-2, append=-2) != 1)
            t = part.times[rows]
            self._spans.setdefault((i, k), []).extend(_longest(t[ends[:-1]], t[ends[1:] - 1]))
            if k != NO_VALUE:
                self._reject(part, part.numbers(rows), _CODES[k][2], i)
            if (i, k) not in self._first_cell:
                line, text = part.line(int(rows[0]))
                cells = split(text, part.block.delimiter)
                self._first_cell[i, k] = line, cells[i] if i < len(cells) else ""

    def timed(self, part: Part, keep: Bools, before: int | None) -> None:
        """Notes when rows were left out: from the time of the row before to that of the next.

        `keep` are the rows that are used. `before` is the time of the last one before the block
        [ns], None where there is none.
        """
        t = part.times[keep]
        if before is None and not len(t):
            self._early |= part.gone.keys()
            return
        first = t[0] if before is None else before
        for kind in self._early:
            self._spans.setdefault(kind, []).append((int(first), int(first)))
        self._early = set()
        if not part.gone:
            return
        edges = np.concatenate(([first], t, [t[-1] if len(t) else first]))
        rows = part.numbers(np.flatnonzero(keep))
        for kind, numbers in part.gone.items():
            at = np.unique(np.searchsorted(rows, numbers))
            self._spans.setdefault(kind, []).extend(_longest(edges[at], edges[at + 1]))

    def cut_off(self, line: int, text: str, last: int) -> None:
        """Counts the row in which the data end; `last` is the time of the row before [ns]."""
        self.lines["cut off"] += 1
        self._first["cut off"] = line, text
        self._spans["cut off"] = [(last, last)]
        if self.rejects is not None:
            self.rejects.add(np.full((1, 2), line), "cut off")

    def findings(self, start: int) -> Iterator[Finding]:
        """What was left out, as findings; `start` is the log's first time [ns]."""
        for kind, reason in SKIPPED.items():
            if n := self.lines[kind]:
                line, text = self._first[kind]
                yield Finding(
                    "csv-rows-skipped", "warning", count=n, spans=self._seconds(kind, start),
                    values={"line": line}, names={"reason": reason, "example": quoted(text)},
                )  # fmt: skip
        if n := self.lines["header again"]:
            line, _ = self._first["header again"]
            yield Finding("csv-header-again", "info", count=n, values={"line": line})
        for (i, k), n in sorted(self.cells.items()):
            code, severity, _ = _CODES[k]
            line, cell = self._first_cell[i, k]
            said = self.lines["used"] - self.cells[i, NO_VALUE]
            if k == NO_NUMBER and not self._dialect.column(i) and n == said:
                severity = "info"  # a column of words that begin late is not a channel
            yield Finding(
                code, severity, channel=self._dialect.names[i], count=n,
                spans=self._seconds((i, k), start), values={"line": line},
                names={"example": quoted(cell)},
            )  # fmt: skip

    def _seconds(self, of: str | tuple[int, int], start: int) -> tuple[Span, ...]:
        spans = [((a - start) / 1e9, (b - start) / 1e9) for a, b in self._spans.get(of, [])]
        return merged(spans, _MOST)


def _longest(begins: Times, ends: Times) -> list[Span]:
    """Stretches [ns], those with the least time between them joined to `_MOST`."""
    if len(begins) > _MOST:
        gaps = begins[1:] - ends[:-1]
        cuts = np.sort(np.argpartition(gaps, 1 - _MOST)[1 - _MOST :])
        begins, ends = begins[np.append(0, cuts + 1)], ends[np.append(cuts, -1)]
    both: NDArray[np.int64] = np.sort([begins, ends], axis=0)  # a clock may have gone back
    return list(zip(*both.tolist(), strict=True))


def quoted(text: str) -> str:
    """Text of a log as it may stand in a message."""
    return repr(text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…")
