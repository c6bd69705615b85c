"""The bytes of a text log: its head, its last rows, and all of it in blocks of whole rows.

Blocks are UTF-8 with line feeds, also where the file is UTF-16 or GBK, is compressed or has
carriage returns. So the parser sees one form, and lines can be counted.
"""

import codecs
import gzip
import io
import os
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...core.errors import UserError
from .dialect import HEAD_BYTES, Dialect, split

_BLOCK = 1 << 20  # it stays in a processor's cache; smaller ones make threads wait for each other
_PIECE = 1 << 16  # bytes that are counted together: what is made of them stays in the cache
_TAIL = 1 << 16
_TAIL_ROWS = 300
_MAX_LINE = 16 << 20
_MAX_QUOTED = 1 << 20  # bytes and lines of one quoted cell; beyond, the quote is taken to be stray
_MAX_QUOTED_LINES = 100
_DAMAGE = (EOFError, gzip.BadGzipFile, zlib.error)
_LAST = 2_000  # bytes before the last row, by which it is known to be whole
_FEW = 5  # of them, at least
_MAX_TEXT = 2_000  # bytes of a row in the list of rejects


@dataclass(slots=True)
class Block:
    """Whole rows of the file, each ended by a line feed: the first `size` bytes of `data`."""

    data: bytes
    size: int
    first_line: int
    lines: int
    delimiter: str
    quotes: bool  # whether there is any

    def ends(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Positions of all line feeds, and of those that end a row."""
        text = np.frombuffer(self.data, np.uint8, self.size)
        feeds = np.flatnonzero(text == 10)
        quotes = np.flatnonzero(text == 34)
        if not (np.searchsorted(quotes, feeds) % 2).any():
            return feeds, feeds
        inside = np.zeros(len(feeds), bool)
        for m in _quoted(self.delimiter).finditer(self.data, 0, self.size):
            a, b = np.searchsorted(feeds, m.span())
            inside[a:b] = True
        return feeds, feeds[~inside]

    def rows(self) -> NDArray[np.int64]:
        """Start, end, first and last line of each row that is not blank, shape (n, 4)."""
        feeds, ends = self.ends()
        starts = np.concatenate(([0], ends[:-1] + 1))
        first, last = (self.first_line + np.searchsorted(feeds, x) for x in (starts, ends))
        return np.column_stack((starts, ends, first, last))[ends > starts]


@dataclass(slots=True)
class Lines:
    """One pass over the data rows of a file, after preamble and header."""

    path: Path
    dialect: Dialect
    max_inflated: int
    cut_off: tuple[int, str] | None = None  # line and text of a row that the data end in
    damage: str = ""  # what is wrong with the compression
    open_end: bool = False  # the last line has no line end
    _last: bytes = b""  # of the rows given last
    _source: BinaryIO | None = None  # where the last chunk stands as it is, ending here

    def blocks(self) -> Iterator[Block]:
        """The rows in blocks, in order.

        Raises:
            UserError: where a quote does not close, a line has no end, or gzip inflates too far.
        """
        delimiter = self.dialect.delimiter
        rest = b""
        line, skip = 1, self.dialect.first_line - 1
        chunks = self._text()
        done = False
        while not done:
            chunk = next(chunks, None)
            done = chunk is None
            data = rest + chunk if chunk is not None else rest
            holes = b"\0" in data
            if holes:  # space that was never written can be longer than any line
                data, self._source = re.sub(rb"\0+", b"\0", data), None
            if skip:
                if not done and data.count(b"\n") < skip:
                    rest = data
                    continue
                at = 0
                for _ in range(skip):
                    at = data.find(b"\n", at) + 1
                data, line, skip = data[at:], line + skip, 0
            if done and data and not data.endswith(b"\n"):
                data = self._close(data, line)
            quotes = b'"' in data
            cut = self._cut(data, line, done, quotes)
            rest = data[cut:]
            if cut and self._source and len(rest) <= len(chunk or b""):
                self._source.seek(-len(rest), os.SEEK_CUR)  # cheaper than joining it to the next
                rest = b""
            if cut:
                lines = _lines_in(data, cut)
                if holes:
                    data = _without_holes(data[:cut])
                    cut = len(data)
                if delimiter == " ":
                    data = _single_blanks(data[:cut])
                    cut = len(data)
                elif quotes:  # the parser knows a quote only right after the delimiter
                    data = data[:cut].replace(delimiter.encode() + b' "', delimiter.encode() + b'"')
                    cut = len(data)
                self._last = data[max(0, cut - _LAST) : cut]
                yield Block(data, cut, line, lines, delimiter, quotes)
                line += lines

    def texts(self, rows: NDArray[np.int64]) -> Iterator[tuple[int, str]]:
        """Where rows begin [bytes] and what they say, as the file has them.

        Args:
            rows: first and last line of each, in order; shape (n, 2).

        Raises:
            UserError: where the file has become shorter since.
        """
        unit = np.dtype({"utf-16-le": "<u2", "utf-16-be": ">u2"}.get(self.dialect.encoding, "u1"))
        line, at, data, k = 1, self.dialect.bom, b"", 0
        skip = at
        for chunk in chain(self._bytes(), [b""]):
            done = not chunk
            data, skip = data + chunk[skip:], 0
            units = np.frombuffer(data, unit, len(data) // unit.itemsize)
            feeds = units == 10
            ends = feeds | ((units == 13) & ~np.append(feeds[1:], not done))
            starts = np.append(0, np.flatnonzero(ends) + 1)
            if done:
                starts = np.append(starts, len(units))
            while k < len(rows) and rows[k, 1] - line + 1 < len(starts):
                a, b = (starts[rows[k] - line + (0, 1)] * unit.itemsize).tolist()
                text = data[a : min(b, a + _MAX_TEXT)].decode(self.dialect.encoding, "replace")
                yield at + a, text.rstrip("\r\n")
                k += 1
            if k == len(rows):
                return
            kept = min(len(starts) - 1, int(rows[k, 0]) - line)
            a = int(starts[kept]) * unit.itemsize
            data, at, line = data[a:], at + a, line + kept
        raise UserError(f"{self.path}: changed while it was read", "read it when it is complete")

    def _close(self, data: bytes, line: int) -> bytes:
        """The file's end, with the line end that it lacks or without what damage cut."""
        at = data.rfind(b"\n") + 1
        if not self.damage:
            text = data.rstrip(b"\x1a")  # the end of a file as DOS marked it
            self.open_end = bool(text) and not text.endswith(b"\n")
            if not (self.open_end and self._is_cut(data[:at], text[at:])):
                return text + b"\n" * self.open_end
            self.open_end = False
        self.cut_off = line + data.count(b"\n"), data[at:].decode("utf-8", "replace")
        return data[:at]

    def _is_cut(self, before: bytes, last: bytes) -> bool:
        """Whether the last row ends inside a number: all before it have more decimals there."""
        mark = self.dialect.decimal
        number = re.compile(rf"[+-]?[0-9]+(?:{re.escape(mark)}[0-9]*)?")

        def decimals(row: bytes) -> int:
            cells = split(row.decode("utf-8", "replace"), self.dialect.delimiter)
            plain = len(cells) == self.dialect.width and number.fullmatch(cells[-1])
            return len(cells[-1].partition(mark)[2]) if plain else -1

        others = [decimals(row) for row in (self._last + before)[-_LAST:].split(b"\n")[1:-1]]
        return len(others) >= _FEW and 0 <= decimals(last) < min(others) == max(others)

    def _cut(self, data: bytes, line: int, done: bool, quotes: bool) -> int:
        """Where the last whole row of `data` ends."""
        end = data.rfind(b"\n") + 1
        if quotes and (done or data.count(b'"', 0, end) % 2):
            end = self._cut_quoted(data, line, done)
        if len(data) - end > _MAX_LINE:
            raise UserError(
                f"{self.path}: line {line + data.count(10)} is longer than {_MAX_LINE >> 20} MiB",
                "give a text log with one row per line",
            )
        return end

    def _cut_quoted(self, data: bytes, line: int, done: bool) -> int:
        last = len(data)
        for m in _quoted(self.dialect.delimiter).finditer(data):
            size = m.end() - m.start()
            closed = size > 1 and data[m.end() - 1] == 34 and (done or m.end() < len(data))
            lines = data.count(b"\n", *m.span())
            if size > _MAX_QUOTED or lines > _MAX_QUOTED_LINES or (done and not closed):
                raise UserError(
                    f"{self.path}: the quote opened in line "
                    f"{line + data.count(10, 0, m.start())} does not close",
                    "correct the quotes in that line",
                )
            if not closed:
                last = m.start()
        return data.rfind(b"\n", 0, last) + 1

    def _text(self) -> Iterator[bytes]:
        """The file as UTF-8 with line feeds, in chunks."""
        plain = self.dialect.encoding == "utf-8"
        codec, target = ("latin-1",) * 2 if plain else (self.dialect.encoding, "utf-8")
        decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(codec)("replace"), True)
        bom = self.dialect.bom
        for raw in self._bytes():
            plain = plain and b"\r" not in raw
            chunk, bom = raw[bom:], 0
            if not plain:
                chunk = decoder.decode(chunk).encode(target)
            if chunk is not raw:
                self._source = None
            yield chunk
        if last := decoder.decode(b"", True).encode(target):  # half a character, or a line end
            yield last

    def _bytes(self) -> Iterator[bytes]:
        if not is_gzip(self.path):
            with self.path.open("rb") as file:
                while chunk := file.read(_BLOCK):
                    self._source = file
                    yield chunk
            self._source = None
            return
        total, parts, size = 0, [], 0
        for more in chain(self._unpacked(), [b""]):
            total, size = total + len(more), size + len(more)
            if total > self.max_inflated:
                limit = self.max_inflated
                shown = f"{limit >> 20} MiB" if limit >= 1 << 20 else f"{limit} bytes"
                raise UserError(
                    f"{self.path}: inflates to more than {shown}",
                    f"if the log is trusted, raise the limit: --set csv.max_unpacked={8 * limit}",
                )
            parts.append(more)
            if not more or size >= _BLOCK:
                yield b"".join(parts)
                parts, size = [], 0

    def _unpacked(self) -> Iterator[bytes]:
        """What a gzip file holds before its end, or before damage."""
        with gzip.open(self.path) as file:
            try:
                while more := file.read1(_BLOCK):
                    yield more
            except _DAMAGE as error:
                self.damage = str(error)


def _lines_in(data: bytes, size: int) -> int:
    """How many line feeds the first `size` bytes hold."""
    text = np.frombuffer(data, np.uint8, size)
    pieces = (text[i : i + _PIECE] for i in range(0, size, _PIECE))
    return sum(int(np.count_nonzero(piece == 10)) for piece in pieces)


def _without_holes(rows: bytes) -> bytes:
    """The rows, each row with NUL bytes replaced by a lone NUL.

    A lone NUL has too few cells for any table. The two ends of such a row may be of two rows.
    """
    kept = []
    at = 0
    while (hole := rows.find(b"\0", at)) >= 0:
        kept += [rows[at : rows.rfind(b"\n", at, hole) + 1 or at], b"\0\n"]
        at = rows.find(b"\n", hole) + 1
    return b"".join([*kept, rows[at:]])


def _single_blanks(rows: bytes) -> bytes:
    """The rows with one blank for each run of blanks and tabs, none at either end of a row."""
    rows = rows.replace(b"\t", b" ")
    while b"  " in rows:
        rows = rows.replace(b"  ", b" ")
    return rows.replace(b"\n ", b"\n").replace(b" \n", b"\n").lstrip(b" ")


def _quoted(delimiter: str) -> re.Pattern[bytes]:
    """A quoted cell: the quote opens it only at the start of the cell."""
    d = re.escape(delimiter.encode())
    return re.compile(rb"(?<![^\n" + d + rb'])"[^"]*(?:""[^"]*)*(?:"|\Z)')


def is_gzip(path: Path) -> bool:
    """Whether the file is gzip by its first bytes."""
    with path.open("rb") as file:
        return file.read(2) == b"\x1f\x8b"


def read_head(path: Path) -> tuple[bytes, bool, float]:
    """First bytes of the (decompressed) file, whether that is all, and an estimate of its size.

    Raises:
        UserError: where there is no such file, nothing in it, or it cannot be read.
    """
    try:
        if not path.is_file():
            missing = not path.exists()
            raise UserError(
                f"{path}: {'no such file' if missing else 'is not a file'}", "check the path"
            )
        size = float(path.stat().st_size)
        if is_gzip(path):
            size *= 4  # usual for columns of numbers
            with gzip.open(path) as file:
                head = _read_until_damage(file)
        else:
            with path.open("rb") as file:
                head = file.read(HEAD_BYTES + 1)
    except _DAMAGE as error:
        raise UserError(f"{path}: gzip data are damaged: {error}", "fetch the file again") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}", "check the path") from None
    if not head.strip():
        raise UserError(f"{path}: is empty", "give a log with a header and data rows")
    complete = len(head) <= HEAD_BYTES
    return head[:HEAD_BYTES], complete, len(head) if complete else size


def read_tail(path: Path, dialect: Dialect) -> list[list[str]]:
    """Last rows of a plain file; none of a compressed one, whose end is far to reach."""
    if is_gzip(path):
        return []
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        start = max(dialect.bom, size - _TAIL - (size - dialect.bom) % 4)  # whole UTF-16 units
        file.seek(start)
        text = file.read().decode(dialect.encoding, "replace")
    lines = text.replace("\r", "\n").split("\n")[1:][-_TAIL_ROWS:]
    rows = (split(line, dialect.delimiter) for line in lines)
    return [cells for cells in rows if len(cells) == dialect.width]


def _read_until_damage(file: Any) -> bytes:
    head = b""
    try:
        while len(head) <= HEAD_BYTES and (more := file.read1(HEAD_BYTES + 1 - len(head))):
            head += more
    except _DAMAGE:
        if not head:
            raise
    return head
