"""The sender that a source names, and a readable log, played as if it were measured now."""

import time
from collections.abc import Iterator
from pathlib import Path

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.text import shell_word
from ..formats.open import kind, open_source
from ..formats.source import Field, ReadOptions, Source
from . import bytes_arriving, feed, growing_mcap, messages, table
from .feed import TICK, AddSource, Feed, FeedRow, rows_of

SOURCES = (
    "a growing CSV, JSON or MCAP file, - for standard input, udp://HOST:PORT, mqtt://HOST/TOPIC or "
    "can:CHANNEL"
)


def open_feed(source: str, options: ReadOptions) -> feed.Feed:
    """The sender of samples that `source` names, one of `SOURCES`; a UserError for none."""
    if "://" in source:
        return _sent(source, options)
    if source.startswith("can:"):
        from .can import Can

        return Can(source.removeprefix("can:"), options)
    if source == "-":
        return _text(bytes_arriving.standard_input(), options, None)
    path = Path(source)
    if path.is_dir():
        hint = "name the file in it that grows"
        raise UserError(f"{source}: is a folder, not a file", hint, code=2)
    pieces = bytes_arriving.growing(path)
    pieces.peek()
    format_ = kind(path) if path.is_file() else None
    if format_ == "mcap":
        return growing_mcap.GrowingMcap(path, options)
    if format_:
        text = f"{source}: a file of the format {format_} is not followed while it grows"
        raise UserError(text, f"play it: `adhesion live --replay {shell_word(source)}`", code=2)
    return _text(pieces, options, path)


def _sent(source: str, options: ReadOptions) -> feed.Feed:
    scheme, _, address = source.partition("://")
    if scheme == "mqtt":
        from .network import Mqtt

        return Mqtt(address, options)
    if scheme != "udp":
        raise UserError(f"{source}: no source of this kind", f"name {SOURCES}", code=2)
    from .network import Udp

    return Udp(address, options)


def _text(pieces: bytes_arriving.Pieces, options: ReadOptions, path: Path | None) -> feed.Feed:
    if pieces.peek().startswith(b"{"):
        return messages.Messages(pieces.name, messages.lines(iter(pieces)), options)
    reopen = (lambda: bytes_arriving.growing(path)) if path else None
    return table.LiveTable(pieces, options, reopen)


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
