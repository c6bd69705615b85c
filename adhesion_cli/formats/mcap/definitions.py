"""Schemas and channels as a file defines them, and the first messages of each channel."""

from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from .blocks import Records
from .records import RAISE_LIMIT, Content, DamageError

_LONGEST = 4096  # characters of a topic
_HEADS = 100  # first messages of a channel that are kept, to learn from them what it holds
_HEAD_BYTES = 1 << 18  # of one channel, beyond which no more than the first is kept


class Definitions:
    """Schemas and channels; each keeps the definition that it had first.

    One may have `limit` bytes.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}

    def read(self, opcode: int, raw: bytes, offset: int) -> None:
        """Reads a Schema or Channel record.

        Raises:
            DamageError: where it is broken, too long, or contradicts an earlier one.
        """
        kind = "schema" if opcode == Opcode.SCHEMA else "channel"
        if len(raw) > self._limit:
            hint = RAISE_LIMIT.format("max_record", 32 * len(raw))
            raise DamageError(offset, f"a {kind} of {len(raw)} bytes, limit {self._limit}", hint)
        definition: Any = (Schema if kind == "schema" else Channel).read(Content(raw, offset))
        definitions: dict[int, Any] = self.schemas if kind == "schema" else self.channels
        name = definition.name if kind == "schema" else definition.topic
        if kind == "schema" and definition.id == 0:
            raise DamageError(offset, "a schema with the reserved id 0")
        if len(name) > _LONGEST:
            raise DamageError(offset, f"a name of {len(name)} characters, limit {_LONGEST}")
        if definitions.setdefault(definition.id, definition) != definition:
            raise DamageError(
                offset, f"{kind} {definition.id} is defined a second time, differently"
            )


class FirstMessages:
    """The first messages of each channel, from as many blocks as it takes.

    Attributes:
        of: by channel id the log time of the first one [ns], and the messages.
        full: channels whose further messages are not kept.
    """

    def __init__(self) -> None:
        self.of: dict[int, tuple[int, list[bytes]]] = {}
        self.full: set[int] = set()

    def add(self, records: Records) -> None:
        """Keeps messages of a block, of channels that are not full."""
        new = records.select(np.flatnonzero(~np.isin(records.channel, list(self.full))))
        for channel, time, start, stop in zip(
            *(x.tolist() for x in (new.channel, new.log_time, new.start, new.stop)), strict=True
        ):
            if channel in self.full:
                continue
            heads = self.of.setdefault(channel, (time, []))[1]
            room = _HEAD_BYTES - sum(map(len, heads[1:]))
            if not heads or stop - start <= room:
                heads.append(records.data[start:stop])
            if len(heads) == _HEADS or stop - start > room:
                self.full.add(channel)
