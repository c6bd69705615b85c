"""One linear walk over an MCAP file, which believes nothing unchecked: what it defines and holds.

The CRCs and inflated sizes of all data are compared. Of what follows the data, only definitions and
the number of messages are read: walking finds all records.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Header, Metadata, Schema, Statistics

from ...core.errors import UserError
from ...core.model import RECOVERED
from ..source import ReadOptions
from .records import HEADER, MAGIC, PIECE, DamageError, LogFile, RecordBlock, Records, decoded

_STRICT = "without --strict, `adhesion convert` writes what is whole as a new file"
_HEADS = 100  # first messages of a channel that are kept, to learn from them what it holds
_HEAD_BYTES = 1 << 18  # of one channel, beyond which no more than the first is kept


class FirstMessages:
    """The first messages of each channel, from as many blocks as it takes."""

    def __init__(self) -> None:
        # By channel id the log time of the first one [ns], and the messages.
        self.of: dict[int, tuple[int, list[bytes]]] = {}
        self.full: set[int] = set()  # channels whose further messages are not kept

    def add(self, records: Records) -> None:
        """Keeps messages of a block, of channels that are not full."""
        selection = records.select(np.flatnonzero(~np.isin(records.channel, list(self.full))))
        columns = (selection.channel, selection.log_time, selection.start, selection.stop)
        for channel, time, start, stop in zip(*(x.tolist() for x in columns), strict=True):
            if channel in self.full:
                continue
            heads = self.of.setdefault(channel, (time, []))[1]
            room = _HEAD_BYTES - sum(map(len, heads[1:]))
            if not heads or stop - start <= room:
                heads.append(records.data[start:stop])
            if len(heads) == _HEADS or stop - start > room:
                self.full.add(channel)


_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)


class Walk:
    """One walk over a file: what it defines, where its messages are, and what is damaged.

    `content` has the bytes of the file, where they are in memory.

    Raises:
        UserError: where the file cannot be read, is no MCAP, holds nothing whole, or is damaged
            and options.strict is set: "FILE: byte N: what".
    """

    def __init__(self, path: Path, options: ReadOptions, content: bytes = b"") -> None:
        self.path, self._options, self._content = path, options, content
        self.counts: Counter[int] = Counter()  # messages by channel
        self.blocks: list[RecordBlock] = []
        self.damage: list[DamageError] = []
        self.times = (1 << 63, -1)  # first and last log time
        self.profile = self.library = ""
        self.metadata: dict[str, dict[str, str]] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._first_messages = FirstMessages()
        self._stated_count: int | None = None  # messages
        with LogFile(path, content) as self._file:
            if self._file.read(0, min(self._file.size, len(MAGIC))) != MAGIC:
                text = f"{path}: byte 0: not an MCAP file (wrong magic bytes)"
                raise UserError(text, "give an MCAP log; a CSV log must not be named .mcap")
            self._walk()
        self.compressions = self._file.compressions
        self.heads = self._first_messages.of  # by channel: log time of the first, first messages
        #: Messages of channels that the file defines, and of others.
        self.rows = sum(n for channel, n in self.counts.items() if channel in self.channels)
        self.stray = self.counts.total() - self.rows
        if self.damage and not self.rows:
            raise self._error(self.damage[0], "no message in it is whole: copy the log anew")

    # ------------------------------------------------------------------ what is lost or in doubt

    @property
    def previous(self) -> str:
        """The account of the damaged file that this one was made from, "" for none."""
        return self.metadata.get(RECOVERED, {}).get("damage", "")

    @property
    def lost_count(self) -> int:
        """Messages that the statistics count and that are not whole; 0 without statistics."""
        return max((self._stated_count or 0) - self.counts.total(), 0)

    def account(self) -> str:
        """What a copy must say about itself, as its fresh CRCs hide all; "" for a sound file."""
        items = [f"byte {damage.at}: {damage.what}" for damage in self.damage[:1]]
        if len(self.damage) > 1:
            items.append(f"{len(self.damage) - 1} more")
        if self.stray:
            items.append(f"{self.stray} messages of channels that it does not define")
        if not items:
            return self.previous
        return "; ".join([*items, *([f"before: {self.previous}"] * bool(self.previous))])[:1000]

    # ------------------------------------------------------------------ what is whole, again

    def reread(self) -> Iterator[Records]:
        """The records of the whole blocks a second time.

        Raises:
            UserError: where a block has changed.
        """
        try:
            with LogFile(self.path, self._content) as file:
                for block in self.blocks:
                    yield file.records(block)
        except DamageError:
            raise self.changed() from None

    def changed(self) -> UserError:
        """The error for a file that has changed since opening."""
        return UserError(f"{self.path}: the file changed while it was read", "read it again")

    # ------------------------------------------------------------------ the walk

    def _note(self, damage: DamageError) -> None:
        # A traceback would keep alive what the frames in it hold: a chunk's inflated bytes.
        damage.__traceback__ = damage.__context__ = None
        self.damage.append(damage)
        if self._options.strict:
            raise self._error(damage) from damage

    def _error(self, damage: DamageError, hint: str = _STRICT) -> UserError:
        return UserError(f"{self.path}: byte {damage.at}: {damage.what}", hint)

    def _walk(self) -> None:
        """Walks up to the footer or a record without an end, past a damaged whole one."""
        offset, opcode, has_ended = len(MAGIC), 0, False
        while opcode != Opcode.FOOTER:
            try:
                opcode, length = self._file.head(offset)
            except DamageError as damage:
                self._note(damage)
                return
            next_record = offset + HEADER.size + length
            try:
                if opcode in (*_DEFINITIONS, Opcode.MESSAGE) and not has_ended:
                    next_record = self._run(offset, next_record)
                elif opcode in _DEFINITIONS:  # those of a damaged chunk are here once more
                    self._define(opcode, self._file.read(offset + HEADER.size, length), offset)
                elif opcode == Opcode.STATISTICS and has_ended:
                    self._compare(offset, self._file.record(Statistics, offset, length))
                elif opcode == Opcode.FOOTER and not has_ended:
                    raise DamageError(offset, "no end of the data section before the footer")
                elif not has_ended:
                    has_ended = self._record(opcode, offset, length)
            except DamageError as damage:
                self._note(damage)
            offset = next_record
        if (excess := self._file.size - offset - len(MAGIC)) > 0:
            text = f"{excess} bytes after the end, not read: cut two joined files apart there"
            self._note(DamageError(offset + len(MAGIC), text))

    def _record(self, opcode: int, offset: int, length: int) -> bool:
        """Takes up a record before the end of the data; whether it is this end."""
        if opcode == Opcode.CHUNK:
            block = RecordBlock(offset, offset + HEADER.size + length, True)
            self._take(block, self._file.records(block))
        elif opcode == Opcode.METADATA:
            record = self._file.record(Metadata, offset, length)
            self.metadata.setdefault(record.name, {}).update(record.metadata)
        elif opcode == Opcode.HEADER:
            header = self._file.record(Header, offset, length)
            self.profile, self.library = header.profile, header.library
        elif opcode == Opcode.DATA_END:
            crc = self._file.record(DataEnd, offset, length).data_section_crc
            if crc and self._file.crc(0, offset) != crc:
                self._note(DamageError(offset, "data section has another CRC than it says"))
            return True
        return False

    def _compare(self, offset: int, said: Statistics) -> None:
        """Notes where a file that seems sound has other messages than its statistics say."""
        self._stated_count = said.message_count
        if said.message_count != self.counts.total() and not self.damage:
            damage = f"statistics say {said.message_count} messages, found {self.counts.total()}"
            self._note(DamageError(offset, damage))

    def _define(self, opcode: int, raw: bytes, offset: int) -> None:
        """Takes up a schema or channel; each keeps the definition that it had first.

        Raises:
            DamageError: where it is broken, or contradicts an earlier one.
        """
        kind, record = ("schema", Schema) if opcode == Opcode.SCHEMA else ("channel", Channel)
        definition = decoded(record, raw, offset)
        definitions: dict[int, Any] = self.schemas if kind == "schema" else self.channels
        if definitions.setdefault(definition.id, definition) != definition:
            damage = f"{kind} {definition.id} is defined a second time, differently"
            raise DamageError(offset, damage)

    # ------------------------------------------------------------------ blocks

    def _run(self, offset: int, next_record: int) -> int:
        """Takes up the records outside chunks from an offset on; returns where to read on."""
        size = max(min(PIECE, self._file.size - offset), next_record - offset)
        block, records = self._file.run(offset, size)
        try:
            self._take(block, records)
        except DamageError as damage:
            self._note(damage)
        return block.stop

    def _take(self, block: RecordBlock, records: Records) -> None:
        """Takes up a block's definitions and counts its messages: none if a definition is wrong."""
        for opcode, raw in records.definitions:
            self._define(opcode, raw, block.offset)
        counts = np.bincount(records.channel)
        met = np.flatnonzero(counts).tolist()
        if len(log := records.log_time):
            if log.min() < 0:
                raise DamageError(block.offset, "a log time beyond the year 2262")
            self.times = min(self.times[0], int(log.min())), max(self.times[1], int(log.max()))
        self.counts.update(dict(zip(met, counts[met].tolist(), strict=True)))
        self._first_messages.add(records)
        self.blocks.append(block)
