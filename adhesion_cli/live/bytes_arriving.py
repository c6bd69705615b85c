"""Bytes that arrive: from standard input, or from a file to which another program appends."""

import os
import sys
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from ..core.errors import UserError
from .feed import TICK, Pump

MOST_HEAD = 1 << 20  # bytes in which a table begins
_BLOCK = 1 << 16
_BLANK = b"\xef\xbb\xbf \t\r\n"
STDIN = "standard input"


class Pieces:
    """Bytes as they arrive, None where none came for `TICK`; ends with the sender."""

    def __init__(self, name: str, pieces: Iterator[bytes | None]) -> None:
        self.name, self._pieces = name, pieces
        self.begins = b""  # the first bytes, once `peek` was called

    def __iter__(self) -> Iterator[bytes | None]:
        return self._pieces

    def peek(self) -> bytes:
        """The first bytes that are no blank, each time the same; a UserError where none comes."""
        if begins := self.begins.lstrip(_BLANK):
            return begins
        for piece in self._pieces:
            self.begins += piece or b""
            if begins := self.begins.lstrip(_BLANK):
                self._pieces = chain([self.begins], self._pieces)
                return begins
            if len(self.begins) > MOST_HEAD:
                break
        raise UserError(f"{self.name}: ended without a row", "check what sends the samples")


def standard_input() -> Pieces:
    """What another program pipes into this one; a UserError where it is closed."""
    if sys.stdin is None:
        raise UserError("standard input is closed", "pipe samples in, or name a file that grows")
    pump = Pump(lambda: os.read(sys.stdin.fileno(), _BLOCK) or None, patient=True)
    return Pieces(STDIN, iter(pump))


def growing(path: Path) -> Pieces:
    """A file that grows, to where it is cut or another takes its name; a UserError for none."""
    try:
        file = path.open("rb")
    except FileNotFoundError:
        hint = "start the logger first, or check the path"
        raise UserError(f"{path}: no such file", hint) from None

    def pieces() -> Iterator[bytes | None]:
        with file:
            while not _is_replaced(path, file.fileno(), file.tell()):
                while piece := file.read(_BLOCK):
                    yield piece
                yield None
                time.sleep(TICK)

    return Pieces(str(path), pieces())


def _is_replaced(path: Path, inode: int, read: int) -> bool:
    """Whether the file was cut, or another one has its name."""
    try:
        status = path.stat()
    except OSError:
        return False  # it may come again
    return status.st_size < read or not os.path.samestat(status, os.fstat(inode))
