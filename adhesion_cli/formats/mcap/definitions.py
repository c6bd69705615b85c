"""Schemas and channels as a file defines them, and the first messages of each channel."""

import struct

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from .messages import BEFORE_DATA, Offsets, Records
from .records import HEADER, RAISE_LIMIT, Content, DamageError

Key = tuple[int, int]  # opcode and id

_LONGEST = 4096  # characters of a topic
_HEADS = 100  # first messages of a channel that are kept, to learn from them what it holds
_FIRST_BYTES = 64 << 20  # of the very first ones, all channels together
_HEAD_BYTES = 1 << 18  # of those after the first, one channel
_MORE_BYTES = 16 << 20  # of these, all channels together
_LOG_TIME = struct.Struct("<15xq")  # of a Message record


class Definitions:
    """Schemas and channels; each keeps the definition that it had first.

    Args:
        limit: bytes that one may have.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._of: dict[Key, Schema | Channel] = {}
        self._hashes: dict[Key, int] = {}  # of the records, which many writers repeat
        self._doubted: set[Key] = set()  # defined a second time, differently

    @property
    def schemas(self) -> dict[int, Schema]:
        """The schemas by id."""
        return {one.id: one for one in self._of.values() if isinstance(one, Schema)}

    @property
    def channels(self) -> dict[int, Channel]:
        """The channels by id."""
        return {one.id: one for one in self._of.values() if isinstance(one, Channel)}

    def read(self, opcode: int, raw: bytes, at: int, fresh: dict[Key, Schema | Channel]) -> None:
        """Reads a Schema or Channel record.

        Args:
            opcode: its kind.
            raw: its content.
            at: offset in the file that an error names.
            fresh: the definitions of the same block so far; this one is added.

        Raises:
            DamageError: where it is broken, too long, or contradicts an earlier one.
        """
        kind = "schema" if opcode == Opcode.SCHEMA else "channel"
        if len(raw) > self._limit:
            hint = RAISE_LIMIT.format("max_record", 32 * len(raw))
            raise DamageError(at, f"a {kind} of {len(raw)} bytes, limit {self._limit}", hint)
        key, hashed = (opcode, int.from_bytes(raw[:2], "little")), hash(raw)
        if self._hashes.get(key) == hashed and (key in fresh or key in self._of):
            return
        of = Schema if kind == "schema" else Channel
        one: Schema | Channel = of.read(Content(raw, at))
        name = one.name if isinstance(one, Schema) else one.topic
        if isinstance(one, Schema) and one.id == 0:
            raise DamageError(at, "a schema with the reserved id 0")
        if len(name) > _LONGEST:
            raise DamageError(at, f"a name of {len(name)} characters, limit {_LONGEST}")
        if self._of.get(key, one) != one or fresh.setdefault(key, one) != one:
            self._doubted.add(key)
            raise DamageError(at, f"{kind} {one.id} is defined a second time, differently")
        self._hashes[key] = hashed

    def keep(self, fresh: dict[Key, Schema | Channel]) -> None:
        """Takes up the definitions of a block that is whole."""
        self._of |= fresh

    def doubtful(self, records: Records, fresh: dict[Key, Schema | Channel]) -> list[int]:
        """Channels of a block that were contradicted before, and that it does not define itself."""
        if not self._doubted:
            return []
        data, found = records.data, []
        stated = {(op, int(data[p]) | int(data[p + 1]) << 8) for op, p, _ in records.others}
        for channel in sorted(set(records.channel.tolist())):
            key = (int(Opcode.CHANNEL), channel)
            one = fresh.get(key) or self._of.get(key)
            schema = one.schema_id if isinstance(one, Channel) else 0
            if {key, (int(Opcode.SCHEMA), schema)} & self._doubted - stated:
                found.append(channel)
        return found


class FirstMessages:
    """The first messages of each channel, from as many blocks as it takes.

    Attributes:
        of: by channel id the log time of the first one [ns], and the messages.
        full: channels whose further messages are not kept.
    """

    def __init__(self) -> None:
        self.of: dict[int, tuple[int, list[bytes]]] = {}
        self.full: set[int] = set()
        self._first_bytes = self._more_bytes = 0

    def keep(self, channel: int, records: Records, mine: Offsets) -> None:
        """Keeps messages of a channel, by their numbers in a block."""
        data, starts = records.data.data, records.start
        if channel not in self.of:
            self.of[channel] = _LOG_TIME.unpack_from(data, int(starts[mine[0]]))[0], []
        heads = self.of[channel][1]
        bytes_before = sum(map(len, heads[1:]))
        for start in starts[mine[: _HEADS - len(heads)]].tolist():
            size = HEADER.unpack_from(data, start)[1] - BEFORE_DATA
            if not heads:
                self._first_bytes += size
                full = self._first_bytes > _FIRST_BYTES
            else:
                bytes_before += size
                self._more_bytes += size
                full = bytes_before > _HEAD_BYTES or self._more_bytes > _MORE_BYTES
            if full:
                self.full.add(channel)
                return
            begin = start + HEADER.size + BEFORE_DATA
            heads.append(bytes(data[begin : begin + size]))
        if len(heads) == _HEADS:
            self.full.add(channel)
