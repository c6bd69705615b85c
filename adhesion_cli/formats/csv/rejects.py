"""What was left out of a text log: remembered by place, read again from the file when asked for."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.model import Reject
from .lines import Lines


class Rejects:
    """Rows left out, and cells that hold no number; iterates over them in the file's order."""

    def __init__(self, lines: Lines, names: Sequence[str]) -> None:
        self._lines, self._names = lines, names
        self._reasons: list[str] = []
        self._parts: list[NDArray[np.int64]] = []

    def add(self, places: NDArray[np.int64], reason: str, column: int = -1) -> None:
        """Remembers rows by their first and last line, shape (n, 2); `column` −1: the whole row."""
        if reason not in self._reasons:
            self._reasons.append(reason)
        part = np.empty((len(places), 4), np.int64)
        part[:, :2], part[:, 2], part[:, 3] = places, column, self._reasons.index(reason)
        self._parts.append(part)

    def __iter__(self) -> Iterator[Reject]:
        if not self._parts:
            return
        every = np.concatenate(self._parts)
        every = every[np.lexsort((every[:, 2], every[:, 0]))]
        texts = self._lines.texts(every[:, :2])
        for (line, _, column, reason), (byte, text) in zip(every.tolist(), texts, strict=True):
            name = self._names[column] if column >= 0 else ""
            yield Reject(line, byte, self._reasons[reason], name, text)
