"""The bytes of a text log: encoding and lines of its head, and all of it in blocks of whole rows.

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
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...core.errors import UserError
from ..number_text import plain
from .dialect import HEAD_BYTES, Dialect, split

_HEAD_LINES = 600
_OPEN_QUOTE = re.compile(r'(?:^|[;,\t|])\s*"[^"]*$')  # of a cell that goes on in the next line
_DATA = re.compile(r'\s*"?[+-]?[0-9]')  # begin of a line of numbers
_MOST_LINE_ENDS = 20  # in the cells of one row
_CONTROLS = bytes(b for b in range(1, 32) if b not in b"\t\n\r\f\v\x1a\x1b")
FORMATS = "CSV, MCAP, Parquet, Excel, MATLAB, MDF 4, TDMS, CAN (BLF, ASC, TRC, candump, BUSMASTER)"
READABLE = f"give a log in one of the formats: {FORMATS}"
_MARKS = {"utf-8": codecs.BOM_UTF8}
_MARKS |= {"utf-16-le": codecs.BOM_UTF16_LE, "utf-16-be": codecs.BOM_UTF16_BE}
Line = tuple[int, str]  # number, from 1, and text

# Words for time, pressure, speed and wheel by which a codec is known; the first that has one is it.
_LANGUAGE_WORDS = {
    "gb18030": "时间 压力 速度 车速 轴速 轮速 制动 闸缸 缸压 采样 日期",
    "cp932": "時間 時刻 圧力 速度 車輪 車軸 ブレーキ シリンダ 日付 電圧",
    "cp1250": "ciśni prędko koła kołow tlak nyomás presiun",
    "cp852": "ciśni prędko koła kołow nyomás",
    "cp1251": "давлен скорост тиск швидк ось км/ч",
    "cp866": "давлен скорост",
    "big5": "壓力 速度 時間",
    "euc_kr": "압력 속도 시간",
}


def encoding_of(head: bytes, encoding: str | None, path: Path) -> tuple[str, str]:
    """Codec, and why. Its byte order mark is a character of the text, which `plain` takes out.

    Raises:
        UserError: where the file is binary, or the stated encoding unknown.
    """
    for codec, mark in _MARKS.items():
        if head.startswith(mark):
            return codec, f"{codec} (byte order mark)"
    codec, reason = _given_encoding(head, encoding, path) if encoding else _guessed(head, path)
    return codec, f"{codec} ({reason})"


def _given_encoding(head: bytes, encoding: str, path: Path) -> tuple[str, str]:
    try:
        codec = codecs.lookup(encoding).name
        b"a".decode(codec, "replace")  # refuses codecs that are no text, as base64
    except (LookupError, UnicodeError):
        hint = "state it, as `--set csv.encoding=utf-16` (or utf-8, gb18030, cp1252)"
        raise UserError(f"{path}: unknown encoding {encoding!r}", hint) from None
    if codec == "utf-16":  # without a mark: whichever half holds the NULs of ASCII
        codec = "utf-16-be" if head[0:4000:2].count(0) > head[1:4000:2].count(0) else "utf-16-le"
    return codec, "stated"


def _guessed(head: bytes, path: Path) -> tuple[str, str]:
    zeros = head[0::2].count(0), head[1::2].count(0)
    rarer, commoner = sorted(zeros)
    if commoner > len(head) // 5 and rarer <= commoner // 50:
        codec = "utf-16-le" if zeros[1] == commoner else "utf-16-be"
        return codec, "every second byte is NUL"
    controls = len(head) - len(head.translate(None, _CONTROLS))
    if controls > max(4, len(head) // 200):
        raise UserError(f"{path}: is a binary file, not CSV", READABLE)
    if head.isascii():
        return "utf-8", "only ASCII in the head"
    with suppress(UnicodeDecodeError):
        codecs.getincrementaldecoder("utf-8")("strict").decode(head)
        return "utf-8", "the head decodes"
    for codec, stems in _LANGUAGE_WORDS.items():
        # bytes have no letters beyond ASCII, so each word is looked for in three forms
        spellings = (f(x) for x in stems.split() for f in (str.lower, str.upper, str.title))
        if any(spelling.encode(codec) in head for spelling in spellings):
            return codec, "not UTF-8; words of its languages"
    return "cp1252", "not UTF-8; no words of other languages"


def first_lines(head: bytes, encoding: str, complete: bool, path: Path) -> list[Line]:
    """The first lines that are whole.

    Raises:
        UserError: where the text is empty, HTML, XML or JSON, or a line is too long.
    """
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, complete)
    text = plain(text.replace("\r\n", "\n").replace("\r", "\n"))
    _refuse_other_texts(text, path)
    lines = text.split("\n")
    if not complete and len(lines) == 1:
        hint = "give a text log with one row per line"
        raise UserError(f"{path}: no line end in the first {len(text) >> 10} KiB", hint)
    if not complete or not lines[-1]:
        lines.pop()
    lines = lines[: max(_HEAD_LINES, 2 * first_numbers(lines))]
    for number, line in enumerate(lines, 1):
        if len(line) > HEAD_BYTES // 2:
            raise line_too_long(number, path)
    return _with_line_ends(list(enumerate(lines, 1)))


def first_numbers(lines: Sequence[str]) -> int:
    """Index of the first line that begins with a number, 0 where others are not a preamble."""
    is_data = [_DATA.match(line) is not None for line in lines]
    begin = is_data.index(True) if True in is_data else 0
    return begin if 2 * sum(is_data) > max(begin, len(lines) - begin) else 0


def _with_line_ends(lines: list[Line]) -> list[Line]:
    """The lines; those above the data whose quotes close in a later line are one with it."""
    joined: list[Line] = []
    for k, (number, text) in enumerate(lines):
        if _DATA.match(text):
            return [*joined, *lines[k:]]
        previous_text = joined[-1][1] if joined else ""
        if _OPEN_QUOTE.search(previous_text) and previous_text.count("\n") < _MOST_LINE_ENDS:
            joined[-1] = joined[-1][0], f"{previous_text}\n{text}"
        else:
            joined.append((number, text))
    return joined


def _refuse_other_texts(text: str, path: Path) -> None:
    start = text[:2000].lstrip().casefold()
    if re.match(r"<(!--|!doctype|html|head|body|table|\?xml)", start):
        raise UserError(f"{path}: is HTML or XML, not CSV", "download the log itself, not the page")
    if re.match(r"[{\[]\s*[\[{\"]", start) and "}" in start:
        raise UserError(f"{path}: is JSON, not CSV", f"export the log as one of: {FORMATS}")
    if not text.strip("\n\t "):
        raise UserError(f"{path}: is empty", "give a log with a header and data rows")
    if not text.strip("\0\n\t "):
        text = f"{path}: holds nothing but NUL bytes: space that was reserved and never written"
        raise UserError(text, "fetch the log from the recorder again")


def line_too_long(line: int, path: Path) -> UserError:
    """The refusal of a line of more than half of the head."""
    hint = "give a text log with one row per line"
    return UserError(f"{path}: line {line} is longer than {HEAD_BYTES >> 11} KiB", hint)


_BLOCK = 1 << 18  # it stays in a processor's cache; smaller ones make threads wait for each other
MAX_LINE = 16 << 20
_EXAMINED_BYTES = 100_000  # bytes of a line that are looked at by itself
# What packed files begin with, and who unpacks them.
_UNPACKERS: dict[bytes, Any] = {b"\x1f\x8b": lambda file: gzip.GzipFile(fileobj=file)}
_UNPACKERS |= {b"\xfd7zXZ\0": lzma.LZMAFile, b"BZh": bz2.BZ2File}
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

    def text(self, line: int) -> str:
        """The begin of a line, by its number in the block from 0."""
        start = int(self.ends[line - 1]) + 1 if line else 0
        stop = min(int(self.ends[line]), start + _EXAMINED_BYTES)
        return self.data[start:stop].decode("utf-8", "replace")


class Splitter:
    """Whole lines of bytes in pieces, as UTF-8 with line feeds; the first `skip` are no rows."""

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
        rows, delimiter = plain(rows), self._delimiter  # one joined to another begins with a mark
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
    is_unfinished: bool = False  # the last line has no line end
    damage: str = ""  # of a packed file; the rows before it are read

    def blocks(self) -> Iterator[LineBlock]:
        """The rows in blocks, in order.

        Raises:
            UserError: where a line has no end.
        """
        file, first_line = PackedFile(self.path), self.dialect.first_line
        splitter = Splitter(self.path, self.dialect, first_line - 1)
        yield from filter(None, map(splitter.add, file.blocks()))
        self.damage = file.damage
        block, self.is_unfinished = splitter.finish(bool(self.damage))
        if block:
            yield block


@dataclass(slots=True)
class PackedFile:
    """The bytes of a file, unpacked where it is compressed."""

    path: Path
    is_packed: bool = False  # known once blocks are read
    damage: str = ""  # what ended it before its end; known after the last block

    def blocks(self) -> Iterator[bytes]:
        """Its bytes in blocks, up to its end or its damage.

        Raises:
            UserError: where it cannot be read.
        """
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
        UserError: where it cannot be read, or its packed data are damaged.
    """
    file, head = PackedFile(path), b""
    for block in file.blocks():
        head += block
        if len(head) > HEAD_BYTES:
            break
    if file.damage and not head.strip():
        raise UserError(f"{path}: packed data are damaged: {file.damage}", "fetch the file again")
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
