"""The bytes of a text log: its head, and all of it in blocks of whole rows.

Blocks are UTF-8 with line feeds, also where the file is UTF-16 or GBK, is compressed or has
carriage returns. So the parser sees one form, and lines can be counted.
"""

import bz2
import codecs
import gzip
import io
import lzma
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...core.errors import UserError
from ..number_text import plain
from .dialect import HEAD_BYTES, Dialect, split

_BLOCK = 1 << 18  # it stays in a processor's cache; smaller ones make threads wait for each other
MAX_LINE = 16 << 20
_SHOWN = 100_000  # bytes of a line that are looked at by itself
# What packed files begin with, and who unpacks them.
_UNPACKERS: dict[bytes, Any] = {
    b"\x1f\x8b": lambda file: gzip.GzipFile(fileobj=file),
    b"\xfd7zXZ\0": lzma.LZMAFile,
    b"BZh": bz2.BZ2File,
}
_TAIL = 1 << 14  # bytes that hold the last rows


Rows = NDArray[np.int64]


@dataclass(slots=True)
class LineBlock:
    """Whole lines of the file, each ended by a line feed."""

    data: bytes
    first_line: int
    ends: Rows = field(init=False)  # place of each line feed

    def __post_init__(self) -> None:
        self.ends = np.flatnonzero(np.frombuffer(self.data, np.uint8) == 10)

    @property
    def lines(self) -> int:
        """How many lines it has."""
        return len(self.ends)

    def text(self, line: int) -> str:
        """The begin of a line, by its number in the block from 0."""
        start = int(self.ends[line - 1]) + 1 if line else 0
        stop = min(int(self.ends[line]), start + _SHOWN)
        return self.data[start:stop].decode("utf-8", "replace")


class Splitter:
    """Whole lines of bytes that come in pieces, as UTF-8 with line feeds.

    The first `skip` lines are no rows.
    """

    def __init__(self, path: Path, dialect: Dialect, skip: int) -> None:
        self._path, self._delimiter, self._skip = path, dialect.delimiter, skip
        self._line, self._remainder = 1, ""  # number of the next line, and what came of it
        decoder = codecs.getincrementaldecoder(dialect.encoding)("replace")
        self._decoder = io.IncrementalNewlineDecoder(decoder, True)

    def add(self, piece: bytes) -> LineBlock | None:
        """The lines that these bytes complete.

        Raises:
            UserError: where a line has no end.
        """
        return self._split(self._remainder + self._decoder.decode(piece))

    def finish(self, is_damaged: bool) -> tuple[LineBlock | None, bool]:
        """What is left at the end, and whether the last line has no end; it is cut if damaged."""
        # half a character, or an end; a DOS mark of the file's end
        text = (self._remainder + self._decoder.decode(b"", True)).rstrip("\x1a")
        if is_damaged:
            text = text[: text.rfind("\n") + 1]
        is_unfinished = bool(text) and not text.endswith("\n")
        return self._split(text + "\n" * is_unfinished), is_unfinished

    def _split(self, text: str) -> LineBlock | None:
        if "\0" in text:  # space that was never written can be longer than any line
            text = re.sub("\0+", "\0", text)
        stop = text.rfind("\n") + 1
        text, self._remainder = text[:stop], text[stop:]
        lines = text.count("\n")
        if len(self._remainder) > MAX_LINE:
            text = f"{self._path}: line {self._line + lines} is longer than {MAX_LINE >> 20} MiB"
            raise UserError(text, "give a text log with one row per line")
        skipped, offset = min(self._skip, lines), 0
        for _ in range(skipped):
            offset = text.find("\n", offset) + 1
        first_line = self._line + skipped
        self._line, self._skip = self._line + lines, self._skip - skipped
        rows = self._as_parsed(text[offset:])
        return LineBlock(rows.encode(), first_line) if rows else None

    def _as_parsed(self, rows: str) -> str:
        """The rows as the parser needs them."""
        if "\0" in rows:  # each end of a hole may be a part of another row
            rows = re.sub(r"(?m)^[^\n\0]*\0[^\n]*\n", "\0\n", rows)
        if not rows.isascii():  # a file joined to another begins with a mark
            rows = plain(rows)
        delimiter = self._delimiter
        if delimiter not in " \t" and "\t" in rows:
            rows = rows.replace("\t", " ")
        if delimiter != " ":  # the parser knows a quote only right after the delimiter
            return rows.replace(f'{delimiter} "', f'{delimiter}"') if '"' in rows else rows
        rows = re.sub("[ \t]+", " ", rows)
        return rows.replace("\n ", "\n").replace(" \n", "\n").lstrip(" ")


@dataclass(slots=True)
class Lines:
    """One pass over the data rows of a file, after preamble and header."""

    path: Path
    dialect: Dialect
    max_inflated: int
    is_unfinished: bool = False  # the last line has no line end
    damage: str = ""  # of a packed file; the rows before it are read

    def blocks(self) -> Iterator[LineBlock]:
        """The rows in blocks, in order.

        Raises:
            UserError: where a line has no end, or the file inflates too far.
        """
        splitter = Splitter(self.path, self.dialect, self.dialect.first_line - 1)
        yield from filter(None, map(splitter.add, self._bytes()))
        block, self.is_unfinished = splitter.finish(bool(self.damage))
        if block:
            yield block

    def _bytes(self) -> Iterator[bytes]:
        file, total = PackedFile(self.path), -self.dialect.bom
        for block in file.blocks():
            yield block[max(-total, 0) :]
            total += len(block)
            if file.is_packed and total > self.max_inflated:
                limit = self.max_inflated
                limit_text = f"{limit >> 20} MiB" if limit >= 1 << 20 else f"{limit} bytes"
                hint = "if the log is trusted, raise the limit: "
                hint += f"--set csv.max_unpacked={8 * limit}"
                raise UserError(f"{self.path}: inflates to more than {limit_text}", hint)
        self.damage = file.damage


@dataclass(slots=True)
class PackedFile:
    """The bytes of a file, unpacked where it is compressed.

    Attributes:
        path: of the file.
        is_packed: whether it is compressed; known once blocks are read.
        damage: what ended it before its end, "" for nothing; known after the last block.
    """

    path: Path
    is_packed: bool = False
    damage: str = ""

    def blocks(self) -> Iterator[bytes]:
        """Its bytes in blocks, up to its end or its damage.

        Raises:
            UserError: where it cannot be read.
        """
        if not self.path.is_file():
            missing = not self.path.exists()
            text = f"{self.path}: {'no such file' if missing else 'is not a file'}"
            raise UserError(text, "check the path")
        try:
            with self.path.open("rb") as file:
                yield from self._unpacked(file)
        except OSError as error:
            text = f"{self.path}: cannot be read: {error.strerror}"
            raise UserError(text, "check the path") from None

    def _unpacked(self, file: BinaryIO) -> Iterator[bytes]:
        head = file.read(6)
        file.seek(0)
        unpack = next((x for begin, x in _UNPACKERS.items() if head.startswith(begin)), None)
        self.is_packed = unpack is not None
        reader: Any = unpack(file) if unpack else file
        data, piece = b"", b" "
        while piece:
            try:
                piece = reader.read1(_BLOCK)
            except (EOFError, OSError, lzma.LZMAError, zlib.error) as error:
                if not unpack:
                    raise
                self.damage, piece = str(error), b""
            data += piece
            if len(data) >= _BLOCK or not piece:
                yield data
                data = b""


def read_head(path: Path) -> tuple[bytes, bool, float]:
    """First bytes of the (decompressed) file, whether that is all, and an estimate of its size.

    Raises:
        UserError: where there is no such file, nothing in it, or it cannot be read.
    """
    file, head = PackedFile(path), b""
    for block in file.blocks():
        head += block
        if len(head) > HEAD_BYTES:
            break
    if file.damage and not head.strip():
        raise UserError(f"{path}: packed data are damaged: {file.damage}", "fetch the file again")
    if not head.strip():
        raise UserError(f"{path}: is empty", "give a log with a header and data rows")
    complete = len(head) <= HEAD_BYTES
    size = float(path.stat().st_size) * (4 if file.is_packed else 1)  # usual for numbers
    return head[:HEAD_BYTES], complete, len(head) if complete else size


def read_tail(path: Path, dialect: Dialect) -> list[list[str]]:
    """Cells of the last rows, after reading all of the file."""
    tail = b""
    for block in PackedFile(path).blocks():
        tail = (tail + block)[-_TAIL:]
    lines = plain(tail.decode(dialect.encoding, "replace")).splitlines()[1:]
    rows = (split(line, dialect.delimiter) for line in lines)
    return [cells for cells in rows if len(cells) == dialect.width]
