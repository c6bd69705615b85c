"""A CSV log whose rows arrive."""

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from ..core.finding import Finding
from ..formats.csv.arriving import ArrivingCsv
from ..formats.csv.reader import CsvSource, open_csv
from ..formats.source import Field, ReadOptions, Source
from .bytes_arriving import MOST_HEAD, Pieces
from .feed import PAUSE, AddSource, Feed, FeedRow

_HEAD_LINES = 20  # lines that show how a table is written
_FEWEST = 4  # lines that must do where no more come for `PAUSE`


class LiveTable(Feed):
    """Rows of a table of text; `reopen` gives the bytes of the file that took its place, if any."""

    def __init__(
        self, pieces: Pieces, options: ReadOptions, reopen: Callable[[], Pieces] | None = None
    ) -> None:
        self.name = pieces.name
        self._pieces, self._options, self._reopen = pieces, options, reopen
        self._head, self._restarts = b"", 0
        self._source: CsvSource | None = None
        self._rows: ArrivingCsv | None = None

    def head(self) -> Source:
        """See `Feed`."""
        quiet = time.monotonic()
        for piece in self._pieces:
            lines = self._head.count(b"\n")
            if piece:
                self._head, quiet = self._head + piece, time.monotonic()
            elif lines >= _FEWEST and time.monotonic() - quiet > PAUSE:
                break
            if lines >= _HEAD_LINES or len(self._head) > MOST_HEAD:
                break
        self._source = self._open_source(self._head)
        return self._source

    def _open_source(self, head: bytes) -> CsvSource:
        """The log by its first lines: as a file, so that it is read as every other log is."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "head.csv"
            path.write_bytes(head[: head.rfind(b"\n") + 1])
            source = open_csv(path, self._options, self.name)
        source.path, source.texts = Path(self.name), []  # rows that arrive are numbers
        source.table = replace(source.table, path=source.path)
        return source

    def rows(self, wanted: list[Field], _: AddSource) -> Iterator[FeedRow | None]:
        """See `Feed`."""
        assert self._source, "head comes first"
        self._rows = ArrivingCsv(self._source, wanted)
        yield from (FeedRow(*row) for row in self._rows.rows(self._head))
        while True:
            for piece in self._pieces:
                if piece is None:
                    yield None
                else:
                    yield from (FeedRow(*row) for row in self._rows.rows(piece))
            if not self._reopen:
                return
            self._pieces = self._reopen()
            self._restarts += 1
            self._rows.restart()

    def findings(self) -> list[Finding]:
        """See `Feed`."""
        pending: list[Finding] = []
        if self._restarts:
            pending.append(Finding("source-restarted", "info", count=self._restarts))
            self._restarts = 0
        if self._rows and self._rows.lost:
            pending += self._rows.lost
            self._rows.lost = []
        return pending
