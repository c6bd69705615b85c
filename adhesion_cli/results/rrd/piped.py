"""A file that the Rerun SDK writes, by a pipe."""

import os
import threading
from contextlib import AbstractContextManager
from typing import BinaryIO

_BLOCK = 1 << 20  # bytes copied at a time


class Piped:
    """Takes what the SDK writes to `place`, and writes it itself.

    The SDK waits for ever for its own thread once that has failed, as on a full disk. The pipe is
    read to its end, whatever becomes of the file. As a context it holds the pipe open until the SDK
    has opened it.

    Args:
        target: gives the file when it is entered.

    Attributes:
        place: what the SDK writes to.
    """

    def __init__(self, target: AbstractContextManager[BinaryIO]) -> None:
        self._target = target
        self._source, self._sink = os.pipe()
        self.place = f"/dev/fd/{self._sink}"
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._copy, daemon=True)
        self._thread.start()

    def __enter__(self) -> "Piped":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._sink)

    def _copy(self) -> None:
        with open(self._source, "rb", buffering=0) as pipe:
            try:
                with self._target as file:
                    while data := pipe.read(_BLOCK):
                        while data:
                            data = data[file.write(data) :]
            except BaseException as error:  # raised again by `check`
                self._error = error
            while pipe.read(_BLOCK):
                pass

    def wait(self, seconds: float | None = None) -> None:
        """Until the SDK has closed the pipe and all is written, or so many seconds have passed."""
        self._thread.join(seconds)

    def check(self) -> None:
        """Raises what went wrong so far: an OSError, or what the file raises where it is closed."""
        if self._error:
            raise self._error
