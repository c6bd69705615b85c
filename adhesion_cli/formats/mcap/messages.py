"""The Message records in a block of bytes, found by walking or by an index that is checked."""

from array import array
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from ...core.model import Bools, Times
from .records import HEADER, PIECE, RAISE_LIMIT, DamageError

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]

PADDING = 16  # bytes that follow the last message in a buffer, so that wide loads stay inside
BEFORE_DATA = 22  # bytes of a Message record before its data: channel, sequence, two times
PER_RECORD = 128  # inflated bytes of the limit that stand for one record, besides the file's size
_OTHER = 4  # messages that a schema or channel costs as much as


@dataclass(slots=True)
class Records:
    """The records of one block, inflated and checked."""

    data: Bytes  # PADDING more bytes follow the last record
    start: Offsets  # of the Message records
    channel: Offsets  # their channel ids
    others: list[tuple[int, int, int]]  # opcode, offset and length of schemas and channels
    unknown: int  # records of unknown kinds

    @property
    def cost(self) -> int:
        """How many messages all these records cost as much as."""
        return len(self.start) + _OTHER * len(self.others) + self.unknown

    def _field(self, offset: int) -> Offsets:
        """A number of 8 bytes that every message record has at an offset."""
        return u64(self.data, self.start + offset)

    def some(self, mine: Bools | Offsets) -> "Records":
        """Some of the messages, by a mask or by their numbers."""
        return replace(self, start=self.start[mine], channel=self.channel[mine])

    def before(self, place: int) -> "Records":
        """Those that stand before an offset."""
        others = [one for one in self.others if one[1] < place]
        return replace(self.some(self.start < place), others=others, unknown=0)

    @property
    def end(self) -> Offsets:
        """Offsets after the message records."""
        return self.start + HEADER.size + self._field(1)

    @property
    def data_start(self) -> Offsets:
        """Offsets of the messages themselves."""
        return self.start + HEADER.size + BEFORE_DATA

    @property
    def log_time(self) -> Times:
        """When messages were logged [ns]; beyond the year 2262 negative."""
        return self._field(15)

    @property
    def publish_time(self) -> Times:
        """When messages were published [ns]; beyond the year 2262 negative."""
        return self._field(23)


def u64(data: Bytes, offsets: Offsets) -> Offsets:
    """Numbers of 8 bytes at any offsets; from 2^63 on they are negative."""
    view: Offsets = np.ndarray((len(data) - 7,), "<i8", data, 0, (1,))
    return view[offsets]


class Search:
    """Looks for the records in a buffer.

    Args:
        data: the buffer, with PADDING more bytes.
        size: bytes of the buffer.
        at: offset of the block in the file, for errors.
        room: records that a file may have, as a few bytes can inflate to millions.
        before: records of the blocks before.
    """

    def __init__(self, data: Bytes, size: int, at: int, room: int, before: int) -> None:
        self._data, self._size, self._at = data, size, at
        self._room, self._before = room, before
        self._starts = array("q")
        self._others: list[tuple[int, int, int]] = []
        self._unknown = 0

    def walked(self) -> tuple[Records, int]:
        """The records from the start on, and where they end; see `walk`."""
        end = self.walk(0, self._size)
        return self._records(np.array(self._starts, np.int64)), end

    def indexed(self, hints: Offsets) -> Records | None:
        """All records, found by what an index says.

        Args:
            hints: where the messages should be.

        Returns:
            None where walking would find other records.
        """
        start = np.sort(hints)
        if not len(start) or start[0] < 0 or start[-1] > self._size - HEADER.size - BEFORE_DATA:
            return None
        length = u64(self._data, start + 1)
        wrong = (self._data[start] != Opcode.MESSAGE) | (length < BEFORE_DATA)
        if (wrong | (length > self._size)).any():
            return None
        ends = np.append(0, start + HEADER.size + length)
        stops = np.append(start, self._size)
        if (ends > stops).any():
            return None
        gaps = np.flatnonzero(ends != stops)
        for p, stop in zip(ends[gaps].tolist(), stops[gaps].tolist(), strict=True):
            if self.walk(p, stop) != stop:
                return None
        return self._records(np.sort(np.append(start, np.array(self._starts, np.int64))))

    def walk(self, p: int, stop: int) -> int:
        """Walks records one by one; returns where it ends.

        That is `stop`, or the first record that is not whole, or that may not stand among
        messages.

        Raises:
            DamageError: where there are more records than there may be.
        """
        unpack, add, view = HEADER.unpack_from, self._starts.append, self._data.data
        message, definitions = int(Opcode.MESSAGE), (int(Opcode.SCHEMA), int(Opcode.CHANNEL))
        while p <= stop - HEADER.size:
            last = min(stop - HEADER.size, p + PIECE)
            while p <= last:
                opcode, length = unpack(view, p)
                after = p + 9 + length
                if after > stop:
                    return p
                if opcode == message:
                    if length < BEFORE_DATA:
                        return p
                    add(p)
                elif opcode in definitions:
                    self._others.append((opcode, p + HEADER.size, length))
                elif opcode <= Opcode.DATA_END:
                    return p
                else:
                    self._unknown += 1
                p = after
            found = len(self._starts) + _OTHER * len(self._others) + self._unknown
            if self._before + found > self._room:
                hint = RAISE_LIMIT.format("max_inflated", (self._before + stop) * PER_RECORD)
                raise DamageError(self._at, "more records than a file of this size holds", hint)
        return p

    def _records(self, start: Offsets) -> Records:
        data: Any = self._data
        channel = data[start + 9].astype(np.int64) | (data[start + 10].astype(np.int64) << 8)
        return Records(self._data, start, channel, self._others, self._unknown)
