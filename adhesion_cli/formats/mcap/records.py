"""The bytes of an MCAP file: records, chunks and runs of them, and damage in them.

Every declared length is checked against the bytes that are left, and chunks inflate to a limit.
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
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.model import Times

MAGIC = b"\x89MCAP0\r\n"  # first and last bytes
HEADER = struct.Struct("<BQ")  # opcode and length of every record
PIECE = 1 << 20  # bytes read from the file at once
_MOST_INFLATED = 1 << 27  # bytes of a chunk
Offsets = NDArray[np.int64]

_HEAD = np.dtype("<i8, <u2, <u4, <i8, <i8")  # of a message: length, channel, sequence, two times
BEFORE_DATA = 22  # bytes of a Message record before its data: channel, sequence, two times


def written(*records: McapRecord) -> bytes:
    """Records as bytes of a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class DamageError(Exception):
    """Bytes from an offset on that contradict the specification or the file."""

    def __init__(self, offset: int, damage: str) -> None:
        super().__init__(damage)
        self.at, self.what = offset, damage


def decoded(kind: type[McapRecord], content: bytes, offset: int) -> Any:
    """The record of this kind whose fields are the content.

    Raises:
        DamageError: where these do not fit into it.
    """
    reader: Any = kind
    try:
        return reader.read(ReadDataStream(BytesIO(content)))
    except (McapError, struct.error, UnicodeDecodeError, MemoryError, OverflowError):
        damage = f"the fields of a record ({kind.__name__}) do not fit into it"
        raise DamageError(offset, damage) from None


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


class LogFile:
    """A log whose bytes are read by offset, a bounded piece at a time.

    `content` has those of the log, where they are in memory.

    Raises:
        UserError: where it cannot be opened.
    """

    def __init__(self, path: Path, content: bytes = b"") -> None:
        self._file: BinaryIO
        try:
            self._file = BytesIO(content) if content else path.open("rb", buffering=PIECE)
        except OSError as e:
            raise UserError(f"{path}: {e.strerror}", "give the path of a log") from None
        self.size = self._file.seek(0, os.SEEK_END)
        self.compressions: set[str] = set()  # of the chunks so far

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
        return opcode, length

    def record(self, kind: type[McapRecord], offset: int, length: int) -> Any:
        """The record of this kind at an offset."""
        return decoded(kind, self.read(offset + HEADER.size, length), offset)

    def crc(self, start: int, stop: int) -> int:
        """CRC-32 of the bytes from `start` to `stop`."""
        crc = 0
        for piece in range(start, stop, PIECE):
            crc = zlib.crc32(self.read(piece, min(PIECE, stop - piece)), crc)
        return crc

    def records(self, block: RecordBlock) -> Records:
        """The records of a block, inflated, checked, and its messages found.

        Raises:
            DamageError: where the block is not whole.
        """
        if not block.chunk:
            return self.run(block.offset, block.stop - block.offset)[1]
        data = self._inflate(block)
        records, stop = _find(data)
        if stop < len(data):
            damage = f"chunk, at its inflated byte {stop}: no whole record that may stand there"
            raise DamageError(block.offset, damage)
        return records

    def run(self, offset: int, size: int) -> tuple[RecordBlock, Records]:
        """The records outside chunks from an offset on, in as many bytes or less.

        Raises:
            DamageError: where the first record may not stand there.
        """
        records, stop = _find(self.read(offset, size))
        if not stop:
            raise DamageError(offset, "no whole message, schema or channel")
        return RecordBlock(offset, offset + stop, False), records

    def _inflate(self, block: RecordBlock) -> bytes:
        chunk = self.record(Chunk, block.offset, block.stop - block.offset - HEADER.size)
        size = chunk.uncompressed_size
        if size > _MOST_INFLATED:
            damage = f"a chunk of {size} inflated bytes, limit {_MOST_INFLATED}"
            raise DamageError(block.offset, f"{damage}: write the log anew with smaller ones")
        try:
            data = _INFLATE[chunk.compression](chunk.data, size + 1)
        except KeyError:
            raise DamageError(block.offset, "unknown compression of a chunk") from None
        except Exception as e:  # lz4 and zstandard raise several kinds, all of them mean this
            raise DamageError(block.offset, f"chunk does not inflate: {e}") from None
        if len(data) != size:
            raise DamageError(block.offset, f"chunk has not the {size} inflated bytes that it says")
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise DamageError(block.offset, "chunk has another CRC than it says")
        self.compressions.add(chunk.compression or "none")
        return data


def _find(data: bytes) -> tuple[Records, int]:
    """Walks over records, one by one; returns them, and where the walk ends.

    That is the end of the bytes, or the first record that is not whole, or that may not stand
    among messages.
    """
    unpack, size = HEADER.unpack_from, len(data)
    message, definition = int(Opcode.MESSAGE), (int(Opcode.SCHEMA), int(Opcode.CHANNEL))
    places, definitions, p = array("q"), list[tuple[int, bytes]](), 0
    while p <= size - HEADER.size:
        opcode, length = unpack(data, p)
        next_record = p + HEADER.size + length
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
        p = next_record
    rows, heads = np.frombuffer(places, np.int64), np.empty(0, _HEAD)
    if places:
        heads = np.ndarray((size - _HEAD.itemsize,), _HEAD, data, 1, (1,))[rows]
    length, channel, _, log_time, publish_time = (heads[name] for name in _HEAD.names or ())
    start, stop = rows + HEADER.size + BEFORE_DATA, rows + HEADER.size + length
    return Records(data, definitions, channel, log_time, publish_time, start, stop), p


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
