"""What gives samples while they are measured: first its fields, then row after row."""

import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from heapq import merge
from typing import Generic, NamedTuple, TypeVar

from ..core.finding import Finding
from ..core.model import Column
from ..formats.source import Field, Source

TICK = 0.02  # longest wait for a row, after which the others may do something [s]
PAUSE = 1.0  # after the first samples: by then the fields are known [s]
FARTHEST = 1 << 62  # from 1970 [ns], or the differences of times do not fit 64 bits
WAITING = 4096, 1 << 26  # pieces of a sender that wait, and their bytes

T = TypeVar("T")
AddSource = Callable[[Source], None]


class FeedRow(NamedTuple):
    """What was measured at one time."""

    t: int  # [ns]
    values: dict[int, float]  # by place among the wanted fields; NaN is no value


def rows_of(columns: Mapping[int, Column]) -> Iterator[FeedRow]:
    """The rows of columns, by places: in the order of time, or their own if one clock has all."""
    clocks: dict[int, dict[int, Column]] = {}
    for place, column in columns.items():
        clocks.setdefault(id(column.t), {})[place] = column
    return merge(*map(_rows, clocks.values()), key=lambda row: row.t)


def _rows(columns: dict[int, Column]) -> Iterator[FeedRow]:
    """The rows of columns with one clock; a cell without a number has no value."""
    t = next(iter(columns.values())).t.tolist()
    values = {place: c.value.tolist() for place, c in columns.items()}
    valid = {place: c.valid for place, c in columns.items() if not c.valid.all()}
    for n, stamp in enumerate(t):
        known = {p: x[n] for p, x in values.items() if p not in valid or valid[p][n]}
        yield FeedRow(stamp, known)


class Feed:
    """A sender of samples."""

    name: str  # for people and for the names of files

    def head(self) -> Source:
        """The fields, by the header or the first messages; waits for them.

        Raises:
            UserError: where they cannot be understood, or nothing ever came.
        """
        raise NotImplementedError

    def rows(self, wanted: list[Field], add_source: AddSource) -> Iterator[FeedRow | None]:
        """The rows from the first on, as they arrive; None where none came for `TICK`.

        `wanted` are their fields. `add_source` is called with all fields before the first row that
        has a new one; it may add to `wanted`.

        Raises:
            UserError: where the sender cannot be read on.
        """
        raise NotImplementedError

    def findings(self) -> list[Finding]:
        """What was lost or repaired since the last call."""
        return []

    def close(self) -> None:
        """Ends the connection, if there is one."""


class Pump(Generic[T]):
    """Takes pieces from a blocking sender in a thread of its own.

    `take` gives None at the end. Of a sender that is not `patient`, and so does not wait, the
    oldest piece makes room for the newest.
    """

    def __init__(self, take: Callable[[], T | None], patient: bool) -> None:
        self._take, self._patient = take, patient
        self._waiting: deque[T] = deque()
        self._bytes = 0  # of those
        self._change = threading.Condition()
        self._has_ended = False
        self._error: BaseException | None = None
        self._dropped = 0
        threading.Thread(target=self._run, daemon=True).start()

    def __iter__(self) -> Iterator[T | None]:
        """The pieces in order, None where there was none for `TICK`; ends with the sender."""
        while True:
            with self._change:
                self._change.wait_for(lambda: self._waiting or self._has_ended, TICK)
                piece = self._next() if self._waiting else None
                has_ended = piece is None and self._has_ended
            if has_ended:
                if self._error:
                    raise self._error
                return
            yield piece

    def dropped_count(self) -> int:
        """How many pieces were dropped since the last call."""
        count, self._dropped = self._dropped, 0
        return count

    def _run(self) -> None:
        try:
            while (piece := self._take()) is not None:
                self._add(piece)
        except BaseException as error:  # raised again where the pieces are taken
            self._error = error
        with self._change:
            self._has_ended = True
            self._change.notify()

    def _next(self) -> T:
        piece = self._waiting.popleft()
        self._bytes -= _size(piece)
        self._change.notify()
        return piece

    def _add(self, piece: T) -> None:
        """Puts a piece behind those that wait, where or as soon as there is room for it."""
        with self._change:
            if self._patient:
                self._change.wait_for(self._has_room)
            while not self._has_room():
                self._next()
                self._dropped += 1
            self._waiting.append(piece)
            self._bytes += _size(piece)
            self._change.notify()

    def _has_room(self) -> bool:
        return len(self._waiting) < WAITING[0] and self._bytes < WAITING[1]


def _size(piece: object) -> int:
    return len(piece) if isinstance(piece, bytes) else 0
