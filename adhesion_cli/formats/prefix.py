"""The first bytes of a file, as a file: for libraries that read on until they fail."""

import io
from pathlib import Path
from typing import Any


class Prefix(io.RawIOBase):
    """The first bytes of a file. A library that gets it does not know the file's name."""

    def __init__(self, path: Path, size: int) -> None:
        self._file, self._size = path.open("rb"), size

    def seekable(self) -> bool:
        """See `io`."""
        return True

    def readable(self) -> bool:
        """See `io`."""
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        """See `io`."""
        base = (0, self._file.tell(), self._size)[whence]
        return self._file.seek(min(base + offset, self._size))

    def tell(self) -> int:
        """See `io`."""
        return self._file.tell()

    def readinto(self, buffer: Any) -> int:
        """See `io`."""
        view = memoryview(buffer).cast("B")
        return self._file.readinto(view[: max(self._size - self._file.tell(), 0)])
