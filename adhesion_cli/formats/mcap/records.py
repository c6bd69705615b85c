"""The bytes of an MCAP file: records, chunks and runs of them, and damage in them.

Every declared length is checked against the bytes that are left and the limits of ReadOptions.
Specification: https://mcap.dev/spec
"""

import os
import struct
import zlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import McapRecord
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.model import Times
from ..source import ReadOptions

MAGIC = b"\x89MCAP0\r\n"  # first and last bytes
HEADER = struct.Struct("<BQ")  # opcode and length of every record
PIECE = 1 << 20  # bytes read from the file at once
RAISE_LIMIT = "if the log is trusted, raise the limit with --set mcap.{}={}"


def written(*records: McapRecord) -> bytes:
    """Records as bytes of a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class DamageError(Exception):
    """Bytes from an offset on that contradict the specification or the file; `hint`: a remedy."""

    def __init__(self, offset: int, damage: str, hint: str = "") -> None:
        super().__init__(damage)
        self.at, self.what, self.hint = offset, damage, hint


class Content(ReadDataStream):
    """The fields of one record, for the mcap package's record classes; none may be cut short."""

    def __init__(self, data: bytes, offset: int) -> None:
        super().__init__(BytesIO(data))
        self._remaining, self._offset = len(data), offset

    def read(self, length: int) -> bytes:
        """The next bytes."""
        if length > self._remaining:
            damage = f"a field of {length} bytes does not fit into its record"
            raise DamageError(self._offset, damage)
        self._remaining -= length
        return super().read(length)

    def read_prefixed_string(self) -> str:
        """A text with its length."""
        try:
            return super().read_prefixed_string()
        except UnicodeDecodeError:
            raise DamageError(self._offset, "text is not UTF-8") from None


class LogFile:
    """A log whose bytes are read by offset, a bounded piece at a time.

    A record may have `max_record` bytes, attachments aside. `content` has those of the log, where
    they are in memory.

    Raises:
        UserError: where it cannot be opened.
    """

    def __init__(self, path: Path, max_record: int, content: bytes = b"") -> None:
        self._file: BinaryIO
        try:
            self._file = BytesIO(content) if content else path.open("rb", buffering=PIECE)
        except OSError as e:
            raise UserError(f"{path}: {e.strerror}", "give the path of a log") from None
        self._max_record = max_record
        self.size = self._file.seek(0, os.SEEK_END)

    def __enter__(self) -> "LogFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def id(self) -> tuple[int, int]:
        """Which file it is, whatever its name."""
        status = os.fstat(self._file.fileno())
        return status.st_dev, status.st_ino

    def read(self, offset: int, size: int) -> bytes:
        """Bytes from an offset on.

        Raises:
            DamageError: where the file has become shorter.
        """
        self._file.seek(offset)
        data = self._file.read(size)
        if len(data) < size:
            raise DamageError(offset, "file became shorter while it was read")
        return data

    def head(self, offset: int) -> tuple[int, int]:
        """Opcode and length of the record at an offset.

        Raises:
            DamageError: where no record can be that the file goes on after.
        """
        remaining = self.size - offset - HEADER.size
        if remaining < 0:
            raise DamageError(offset, "file ends without a footer")
        opcode, length = HEADER.unpack(self.read(offset, HEADER.size))
        if opcode == 0:
            raise DamageError(offset, "a record of kind 0, which does not exist")
        if length > remaining:
            damage = f"a record says it has {length} bytes where {remaining} are left"
            raise DamageError(offset, damage)
        if opcode == Opcode.FOOTER and length != 20:
            raise DamageError(offset, f"a footer of {length} bytes")
        if length > self._max_record and opcode != Opcode.ATTACHMENT:  # those are read in pieces
            hint = RAISE_LIMIT.format("max_record", length)
            raise DamageError(offset, f"a record of {length} bytes, limit {self._max_record}", hint)
        return opcode, length

    def content(self, offset: int, length: int) -> Content:
        """The fields of the record at an offset."""
        return Content(self.read(offset + HEADER.size, length), offset)

    def crc(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes from `start` to `stop`."""
        crc = 0
        for piece in range(start, stop, PIECE):
            crc = zlib.crc32(self.read(piece, min(PIECE, stop - piece)), crc)
        return crc


Offsets = NDArray[np.int64]

_HEAD = np.dtype("<i8, <u2, <u4, <i8, <i8")  # of a message: length, channel, sequence, two times
BEFORE_DATA = 22  # bytes of a Message record before its data: channel, sequence, two times
# Times a file's size that its chunks may inflate to, besides max_inflated. Each record counts as
# so many bytes, too: a few bytes can inflate to millions of records.
_UNUSUAL = 1000


@dataclass(slots=True)
class RecordBlock:
    """A chunk, or a run of records outside chunks."""

    offset: int
    stop: int
    chunk: bool


class Records(NamedTuple):
    """The records of one block, inflated and checked; of its n messages arrays of shape (n,)."""

    data: bytes
    definitions: list[tuple[int, bytes]]  # kind and content of the Schema and Channel records
    channel: NDArray[np.uint16]  # ids
    log_time: Times  # [ns]; beyond the year 2262 negative
    publish_time: Times
    start: Offsets  # of the messages themselves in the data
    stop: Offsets

    def select(self, rows: Offsets) -> "Records":
        """Some of the messages, by their numbers, which rise."""
        if len(rows) == len(self.start):
            return self  # without a copy, which takes memory
        arrays: tuple[Any, ...] = self[2:]
        return Records(self.data, self.definitions, *(array[rows] for array in arrays))


class BlockReader:
    """Reads the records of blocks."""

    def __init__(self, file: LogFile, options: ReadOptions) -> None:
        self._file, self._limit = file, options.max_inflated
        self._allowed = options.max_inflated + _UNUSUAL * file.size
        self._spent = 0  # of this
        self.compressions: set[str] = set()

    def records(self, block: RecordBlock) -> Records:
        """The records of a block, inflated, checked, and its messages found.

        Raises:
            DamageError: where the block is not whole.
        """
        if not block.chunk:
            return self.run(block.offset, block.stop - block.offset)[1]
        data = self._inflate(block)
        records, stop = self._find(data, block.offset)
        if stop < len(data):
            damage = f"chunk, at its inflated byte {stop}: no whole record that may stand there"
            raise DamageError(block.offset, damage)
        return records

    def run(self, offset: int, size: int) -> tuple[RecordBlock, Records]:
        """The records outside chunks from an offset on, in as many bytes or less.

        Raises:
            DamageError: where the first record may not stand there.
        """
        records, stop = self._find(self._file.read(offset, size), offset, outside=True)
        return RecordBlock(offset, offset + stop, False), records

    def _find(self, data: bytes, offset: int, outside: bool = False) -> tuple[Records, int]:
        """Walks over records, one by one; returns them, and where the walk ends.

        That is the end of the bytes, or the first record that is not whole, or that may not stand
        among messages, or one too many. `offset` is that of the records or their chunk in the file.
        """
        unpack, size = HEADER.unpack_from, len(data)
        message, definition = int(Opcode.MESSAGE), (int(Opcode.SCHEMA), int(Opcode.CHANNEL))
        places, definitions, unknown = array("q"), list[tuple[int, bytes]](), 0
        p = 0
        for _ in range((self._allowed - self._spent) // _UNUSUAL + 1):
            if p > size - HEADER.size:
                break
            opcode, length = unpack(data, p)
            next_record = p + 9 + length
            if next_record > size:
                break
            if opcode == message:
                if length < BEFORE_DATA:
                    break
                places.append(p)
            elif opcode in definition:
                definitions.append((opcode, data[p + HEADER.size : next_record]))
            elif opcode <= Opcode.DATA_END:
                break
            else:
                unknown += 1
            p = next_record
        if outside and not p:
            raise DamageError(offset, "no whole message, schema or channel")
        count = len(places) + len(definitions) + unknown
        damage, room = "more records than a file of this size holds", size // HEADER.size
        self._spend(offset, damage, _UNUSUAL * count, _UNUSUAL * (room - count))
        rows, heads = np.frombuffer(places, np.int64), np.empty(0, _HEAD)
        if places:
            heads = np.ndarray((size - _HEAD.itemsize,), _HEAD, data, 1, (1,))[rows]
        length, channel, _, log_time, publish_time = (heads[name] for name in _HEAD.names or ())
        start, stop = rows + HEADER.size + BEFORE_DATA, rows + HEADER.size + length
        return Records(data, definitions, channel, log_time, publish_time, start, stop), p

    def _spend(self, offset: int, damage: str, cost: int, extra: int = 0) -> None:
        """Refuses a block that costs more than is left; `extra` is what may come besides."""
        self._spent += cost
        if self._spent > self._allowed:
            limit = self._limit + self._spent + extra - self._allowed
            raise DamageError(offset, damage, RAISE_LIMIT.format("max_inflated", limit))

    def _inflate(self, block: RecordBlock) -> bytes:
        content = self._file.content(block.offset, block.stop - block.offset - HEADER.size)
        content.read(16)  # the time range, which nothing here relies on
        size, crc = content.read8(), content.read4()
        compression = content.read_prefixed_string()
        packed = content.read(content.read8())
        offset = block.offset
        if size > self._limit:
            hint = RAISE_LIMIT.format("max_inflated", size)
            damage = f"a chunk of {size} inflated bytes, limit {self._limit}"
            raise DamageError(offset, damage, hint)
        damage = "too many inflated bytes in all for such a file"
        self._spend(offset, damage, len(packed) + size)
        try:
            data = _INFLATE[compression](packed, size + 1)
        except KeyError:
            raise DamageError(offset, f"unknown compression {compression[:20]!r}") from None
        except Exception as e:  # lz4 and zstandard raise several kinds, all of them mean this
            raise DamageError(offset, f"chunk does not inflate: {e}") from None
        if len(data) != size:
            excess = "more" if len(data) > size else f"{len(data)}"
            raise DamageError(offset, f"chunk says {size} inflated bytes and has {excess}")
        if crc and zlib.crc32(data) != crc:
            raise DamageError(offset, "chunk has another CRC than it says")
        self.compressions.add(compression or "none")
        return data


def _inflate_zstd(packed: bytes, limit: int) -> bytes:
    import zstandard

    with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
        return stream.read(limit)


def _inflate_lz4(packed: bytes, limit: int) -> bytes:
    import lz4.frame

    data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=limit)
    return data


_INFLATE: dict[str, Callable[[bytes, int], bytes]] = {
    "": lambda packed, limit: packed[:limit],
    "zstd": _inflate_zstd,
    "lz4": _inflate_lz4,
}
