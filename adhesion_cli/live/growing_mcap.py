"""An MCAP log to which another program appends."""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..core.errors import UserError
from ..core.finding import Finding
from ..formats.mcap.arriving import Arriving
from ..formats.source import Field, ReadOptions, Source
from .feed import PAUSE, TICK, Row, rows_of


class GrowingMcap:
    """The messages of an MCAP, as they are appended; ends with the data section.

    Args:
        path: of the file.
        options: how to read it.
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.name = str(path)
        self._arriving = Arriving(path, options)
        self._restarts = 0

    def head(self) -> Source:
        """See `Feed`."""
        begin = 0.0
        while True:
            source = self._arriving.head()
            begin = begin or (time.monotonic() if source else 0.0)
            if source and (self._arriving.ended or time.monotonic() - begin > PAUSE):
                return source
            if self._arriving.ended:
                raise UserError(f"{self.name}: ended without a message", "check what records it")
            time.sleep(TICK)

    def rows(self, wanted: Sequence[Field]) -> Iterator[Row | None]:
        """See `Feed`."""
        while True:
            columns = self._arriving.columns(wanted)
            yield from rows_of(columns)
            if not columns:
                if self._arriving.ended:
                    return
                yield None
                time.sleep(TICK)

    def findings(self) -> list[Finding]:
        """See `Feed`."""
        found, self._arriving.lost = self._arriving.lost, []
        if restarts := self._arriving.restarts - self._restarts:
            self._restarts += restarts
            found.append(Finding("source-restarted", "info", count=restarts))
        return found

    def close(self) -> None:
        """See `Feed`."""
