"""A CSV log whose rows arrive."""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Bools, Times
from ..core.time_axis import from_digits, seconds_of_digits
from ..formats.csv.block_parser import Parser
from ..formats.csv.cells import NO_NUMBER, OTHER_MARK
from ..formats.csv.lines import LineBlock, Splitter
from ..formats.csv.reader import CsvSource, open_csv
from ..formats.csv.rows import Losses, UsedRows
from ..formats.source import Field, ReadOptions, Source
from .bytes_arriving import MOST_HEAD, Pieces
from .feed import PAUSE, AddSource, Feed, FeedRow

_HEAD_LINES = 20  # lines that show how a table is written
_FEWEST = 4  # lines that must do where no more come for `PAUSE`
_RECENT = 100  # rows that show the usual interval
_NEW_FILE = "let the logger begin a new file where its columns change; start `live` on that file"


class ArrivingCsv:
    """The rows after header and preamble."""

    def __init__(self, source: CsvSource, wanted: Sequence[Field]) -> None:
        self._table = source.table
        if source.others:
            text = f"{self._table.path}: channels have times of their own, which arrive apart"
            raise UserError(text, "send all channels on one time axis")
        keys = source.keys.columns
        self._wanted = [source.places[f] for f in wanted]
        self._rows = UsedRows(self._table, keys, list(source.keys.series))
        self._parser = Parser(self._table, sorted({i for _, i in self._wanted}), keys)
        self._first_time: int | None = None  # time of the first row [ns]
        self._newest_time = 0  # and of the newest
        self._recent = np.empty(0, np.int64)  # newest times as numbers, while these may be digits
        self._offset: int | None = None  # of a clock in digits, once it is proven [ns]
        self.lost: list[Finding] = []  # what was left out; whoever reads it may empty it
        self.restart(self._table.dialect.first_line - 1)

    def restart(self, skip: int = 0) -> None:
        """The next bytes are the first ones of a file, which may have a header again."""
        self._splitter = Splitter(self._table.path, self._table.dialect, skip)

    def rows(self, data: bytes) -> Iterator[FeedRow]:
        """The rows that these bytes, the next ones of the file, complete.

        Raises:
            UserError: where a line has no end, or another header stands among the rows.
        """
        if block := self._splitter.add(data):
            yield from self._parsed(block)

    def _of_digits(self, t: Times, timed: Bools) -> Times:
        """The times; those of a clock in digits go on from before its first full minute."""
        clock = self._table.clock
        if self._offset is None and clock.may_be_digits:
            numbers = np.append(self._recent, t[timed])
            if (of_day := from_digits(numbers)) is not None:
                self._offset = int(numbers[0] - of_day[0])
                name, example = self._table.dialect.names[clock.columns[0]], str(numbers[-1] / 1e9)
                names = {"example": example}
                self.lost.append(Finding("time-digits", "info", name, names=names))
            self._recent = numbers[-_RECENT:]
        return t if self._offset is None else seconds_of_digits(t) + self._offset

    def _parsed(self, block: LineBlock) -> Iterator[FeedRow]:
        try:
            parsed = self._parser.parse(block)
        except UserError as error:  # nobody can split a log that still grows
            raise UserError(error.text, _NEW_FILE) from None
        timed, codes = self._rows.take(parsed)
        parsed.times = self._of_digits(parsed.times, parsed.timed)
        row_times = parsed.times[timed]
        if self._first_time is None:
            self._first_time = self._newest_time = int(row_times[0]) if len(row_times) else 0
        for i, state in parsed.states.items():  # only all cells of a column decide on its notation
            parsed.values[i] = np.where(state < OTHER_MARK, parsed.values[i], np.nan)
            parsed.states[i] = np.where(state < OTHER_MARK, state, NO_NUMBER)
        losses = Losses(self._table.dialect)
        losses.add(parsed, timed, 1)
        self.lost += losses.findings(np.append(self._newest_time, row_times), self._first_time)
        self._newest_time = int(row_times[-1]) if len(row_times) else self._newest_time
        times, series = parsed.times.tolist(), codes.tolist()
        values = {i: column.tolist() for i, column in parsed.values.items()}
        for n in np.flatnonzero(timed).tolist():
            places = {place: i for place, (k, i) in enumerate(self._wanted) if k == series[n]}
            yield FeedRow(times[n], {place: values[i][n] for place, i in places.items()})


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
        yield from self._rows.rows(self._head)
        while True:
            for piece in self._pieces:
                if piece is None:
                    yield None
                else:
                    yield from self._rows.rows(piece)
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
