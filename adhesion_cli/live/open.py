"""The sender that a source names."""

from pathlib import Path

from ..core.errors import UserError
from ..core.text import shell_word
from ..formats.open import kind
from ..formats.source import ReadOptions
from . import bytes_arriving
from .feed import Feed
from .growing_mcap import GrowingMcap
from .messages import Messages, lines
from .table import LiveTable

SOURCES = (
    "a growing CSV, JSON or MCAP file, - for standard input, udp://HOST:PORT, mqtt://HOST/TOPIC or "
    "can:CHANNEL"
)


def open_feed(source: str, options: ReadOptions) -> Feed:
    """The sender of samples that `source` names; `SOURCES` says which there are.

    Raises:
        UserError: where there is none, or it cannot be opened.
    """
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
        return GrowingMcap(path, options)
    if format_:
        text = f"{source}: a file of the format {format_} is not followed while it grows"
        raise UserError(text, f"play it: `adhesion live --replay {shell_word(source)}`", code=2)
    return _text(pieces, options, path)


def _sent(source: str, options: ReadOptions) -> Feed:
    scheme, _, address = source.partition("://")
    if scheme == "mqtt":
        from .mqtt import Mqtt

        return Mqtt(address, options)
    if scheme != "udp":
        raise UserError(f"{source}: no source of this kind", f"name {SOURCES}", code=2)
    from .udp import Udp

    return Udp(address, options)


def _text(pieces: bytes_arriving.Pieces, options: ReadOptions, path: Path | None) -> Feed:
    if pieces.peek().startswith(b"{"):
        return Messages(pieces.name, lines(iter(pieces)), options)
    reopen = (lambda: bytes_arriving.growing(path)) if path else None
    return LiveTable(pieces, options, reopen)
