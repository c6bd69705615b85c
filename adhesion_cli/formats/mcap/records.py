"""The bytes of an MCAP file: records, their fields, and damage in them.

Every declared length is checked against the bytes that are left and the limits of ReadOptions.
Specification: https://mcap.dev/spec
"""

import os
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import McapRecord

from ...core.errors import UserError

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
    """Bytes that contradict the specification or the file itself.

    `offset` is that in the file; `hint` is a remedy other than recovering.
    """

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
            raise DamageError(
                self._offset, f"a field of {length} bytes does not fit into its record"
            )
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

    def __init__(self, path: Path, max_record: int, content: bytes | None = None) -> None:
        self._file: BinaryIO
        try:
            self._file = path.open("rb", buffering=PIECE) if content is None else BytesIO(content)
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
            raise DamageError(
                offset, f"a record says it has {length} bytes where {remaining} are left"
            )
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
