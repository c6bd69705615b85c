"""Files that are read back: what a disk, or its cable, changed on the way is no result."""

import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ..core.errors import UserError

_BLOCK = 1 << 20  # bytes read at once


@contextmanager
def verified(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, front to back; its old content is lost. On leaving it is read back.

    Raises:
        UserError: it does not read back.
        OSError: it cannot be written.
    """
    with _Checked(io.FileIO(path, "w")) as checked:
        yield checked
    size, crc = 0, 0
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            size, crc = size + len(block), zlib.crc32(block, crc)
    if (size, crc) != (checked.size, checked.crc):
        text = "the result does not read back as written"
        raise UserError(text, "check the disk, then run again")


def write(path: Path, content: str | bytes) -> None:
    """Writes a whole file, as `verified`."""
    with verified(path) as file:
        file.write(content.encode("utf-8") if isinstance(content, str) else content)


class _Checked(io.BufferedWriter):
    """Keeps size and CRC of what is written."""

    size, crc = 0, 0

    def write(self, data: "bytes | memoryview") -> int:  # type: ignore[override]
        self.size += memoryview(data).nbytes
        self.crc = zlib.crc32(data, self.crc)
        return super().write(data)
