"""An MCAP log to which another program appends."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

from ..core.errors import UserError
from ..core.finding import Finding
from ..formats.mcap.arriving import ArrivingMcap
from ..formats.source import Field, ReadOptions, Source
from .feed import PAUSE, TICK, AddSource, Feed, FeedRow, rows_of


class GrowingMcap(Feed):
    """The messages of an MCAP, as they are appended; ends with the data section."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.name = str(path)
        self._arriving = ArrivingMcap(path, options)

    def head(self) -> Source:
        """See `Feed`."""
        receive_time = math.inf  # when messages were first seen
        while time.monotonic() - receive_time < PAUSE and not self._arriving.ended:
            if self._arriving.arrived():
                receive_time = min(receive_time, time.monotonic())
            time.sleep(TICK)
        if not self._arriving.arrived():
            raise UserError(f"{self.name}: ended without a message", "check what records it")
        return self._arriving.head()

    def rows(self, wanted: list[Field], add_source: AddSource) -> Iterator[FeedRow | None]:
        """See `Feed`."""
        while True:
            columns = self._arriving.columns(wanted, add_source)
            yield from rows_of(columns)
            if not columns:
                if self._arriving.ended:
                    return
                yield None
                time.sleep(TICK)

    def findings(self) -> list[Finding]:
        """See `Feed`."""
        found, self._arriving.lost = self._arriving.lost, []
        return found
