"""A readable log, played as if it were measured now."""

import time
from collections.abc import Iterator
from pathlib import Path

from ..core.finding import Finding
from ..formats.open import open_source
from ..formats.source import Field, ReadOptions, Source
from .feed import TICK, AddSource, Feed, FeedRow, rows_of


class Replay(Feed):
    """The rows of a log in the order of time, or in the log's own where one clock has them all.

    `speed` is in seconds of the log per second; 0: as fast as they are taken.
    """

    def __init__(self, path: Path, options: ReadOptions, speed: float) -> None:
        self.name = str(path)
        self._source, self._speed = open_source(path, options), speed

    def head(self) -> Source:
        """See `Feed`."""
        return self._source

    def rows(self, wanted: list[Field], _: AddSource) -> Iterator[FeedRow | None]:
        """See `Feed`."""
        all_rows = rows_of(dict(enumerate(self._source.columns(wanted))))
        begin, first_stamp = time.monotonic(), None
        for row in all_rows:
            first_stamp = row.t if first_stamp is None else first_stamp
            due_time = begin + (row.t - first_stamp) * 1e-9 / self._speed if self._speed else 0.0
            while (wait := due_time - time.monotonic()) > 0.0 and self._speed:
                time.sleep(min(wait, TICK))
                if wait > TICK:
                    yield None
            yield row

    def findings(self) -> list[Finding]:
        """See `Feed`."""
        pending, self._source.findings = self._source.findings, []
        return [f for f in pending if f.severity != "info"]
