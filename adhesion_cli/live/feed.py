"""What gives samples while they are measured: first its fields, then row after row."""

import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from heapq import merge
from typing import Generic, NamedTuple, TypeVar

from ..core.finding import Finding
from ..core.model import Column
from ..formats.source import Field, Source

TICK = 0.02  # longest wait for a row, after which the others may do something [s]
PAUSE = 1.0  # after the first samples: by then the fields are known [s]
FARTHEST = 1 << 62  # from 1970 [ns], or the differences of times do not fit 64 bits
# pieces that wait, of a sender that does not wait itself, and of one that does
WAITING = 4096, 1024

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
        yield FeedRow(stamp, {p: x[n] for p, x in values.items() if p not in valid or valid[p][n]})


class Feed:
    """A sender of samples."""

    name: str  # for people and for the names of files

    def head(self) -> Source:
        """The fields, by header or first messages; waits for them. Raises a UserError for none."""
        raise NotImplementedError

    def rows(self, wanted: list[Field], add_source: AddSource) -> Iterator[FeedRow | None]:
        """The rows from the first on, as they arrive; None where none came for `TICK`.

        `wanted` are their fields. `add_source` is called with all fields before the first row that
        has a new one; it may add to `wanted`. Raises a UserError at the end of a broken sender.
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
        self._take, self._patient, self._dropped = take, patient, 0
        self._waiting: queue.Queue[T | BaseException | None] = queue.Queue(WAITING[patient])
        threading.Thread(target=self._run, daemon=True).start()

    def __iter__(self) -> Iterator[T | None]:
        """The pieces in order, None where there was none for `TICK`; ends with the sender."""
        while True:
            try:
                piece = self._waiting.get(timeout=TICK)
            except queue.Empty:
                yield None
                continue
            if piece is None:
                return
            if isinstance(piece, BaseException):
                raise piece
            yield piece

    def dropped_count(self) -> int:
        """How many pieces were dropped since the last call."""
        count, self._dropped = self._dropped, 0
        return count

    def _run(self) -> None:
        last_error: BaseException | None = None
        try:
            while (piece := self._take()) is not None:
                self._add(piece)
        except BaseException as error:  # raised again where the pieces are taken
            last_error = error
        self._add(last_error)

    def _add(self, piece: T | BaseException | None) -> None:
        while self._waiting.full() and not self._patient:
            with suppress(queue.Empty):
                self._waiting.get_nowait()
                self._dropped += 1
        self._waiting.put(piece)
