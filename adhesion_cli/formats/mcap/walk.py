"""One linear walk over an MCAP file, which believes nothing unchecked: what it defines and holds.

Every CRC and every inflated size is compared. Indexes are not read: walking finds all records.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Header, Metadata, Schema, Statistics

from ...core.errors import UserError
from ...core.model import RECOVERED
from ..source import ReadOptions
from . import records as file_records
from .records import HEADER, MAGIC, BlockReader, DamageError, LogFile, RecordBlock, Records

_STRICT = "without --strict, `adhesion convert` writes what is whole as a new file"
_LONGEST_NAME = 4096  # characters of a topic
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
_MISPLACED = (Opcode.HEADER, Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END)


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
        self._data_end = 0
        self._statistics: tuple[int, Statistics] | None = None  # with their offset
        with self._open_file() as self._file:
            self._reader = BlockReader(self._file, options)
            if self._file.read(0, min(self._file.size, len(MAGIC))) != MAGIC:
                text = f"{path}: byte 0: not an MCAP file (wrong magic bytes)"
                raise UserError(text, "give an MCAP log; a CSV log must not be named .mcap")
            self._walk()
            if self._statistics and not self.damage:
                self._compare(*self._statistics)
        self.compressions = self._reader.compressions
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
        stated_count = self._statistics[1].message_count if self._statistics else 0
        return max(stated_count - self.counts.total(), 0)

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

    def reread(self) -> Iterator[tuple[RecordBlock, Records]]:
        """The whole blocks a second time, with their records.

        Raises:
            UserError: where a block has changed.
        """
        try:
            with self._open_file() as file:
                reader = BlockReader(file, self._options)
                for block in self.blocks:
                    yield block, reader.records(block)
        except DamageError:
            raise self.changed() from None

    def changed(self) -> UserError:
        """The error for a file that has changed since opening."""
        return UserError(f"{self.path}: the file changed while it was read", "read it again")

    # ------------------------------------------------------------------ the walk

    def _open_file(self) -> LogFile:
        return LogFile(self.path, self._options.max_record, self._content)

    def _note(self, damage: DamageError) -> None:
        # A traceback would keep alive what the frames in it hold: a chunk's inflated bytes.
        damage.__traceback__ = damage.__context__ = None
        self.damage.append(damage)
        if self._options.strict:
            raise self._error(damage) from damage

    def _error(self, damage: DamageError, hint: str = _STRICT) -> UserError:
        return UserError(f"{self.path}: byte {damage.at}: {damage.what}", damage.hint or hint)

    def _walk(self) -> None:
        """Walks up to the footer or a record without an end, past a damaged whole one."""
        offset, opcode = len(MAGIC), 0
        while opcode != Opcode.FOOTER:
            try:
                opcode, length = self._file.head(offset)
            except DamageError as damage:
                self._note(damage)
                return
            next_record = offset + HEADER.size + length
            if offset == len(MAGIC) and opcode != Opcode.HEADER:
                self._note(DamageError(offset, "first record is no header"))
            try:
                if opcode in (*_DEFINITIONS, Opcode.MESSAGE) and not self._data_end:
                    next_record = self._run(offset, next_record)
                else:
                    self._record(opcode, offset, length)
            except DamageError as damage:
                self._note(damage)
            offset = next_record

    def _record(self, opcode: int, offset: int, length: int) -> None:
        # A wrong byte can make an end of data of another record.
        is_in_data = bool(self.damage) or not self._data_end
        if opcode == Opcode.CHUNK and is_in_data:
            block = RecordBlock(offset, offset + HEADER.size + length, True)
            self._take(block, self._reader.records(block))
        elif opcode == Opcode.METADATA and is_in_data:
            if length <= self._options.max_part:  # larger ones are not ours
                record = Metadata.read(self._file.content(offset, length))
                self.metadata.setdefault(record.name, {}).update(record.metadata)
        elif opcode == Opcode.DATA_END and is_in_data:
            self._data_end = offset + HEADER.size + length
            crc = self._file.content(offset, length).read4()
            if crc and self._file.crc(0, offset) != crc:
                raise DamageError(offset, "data section has another CRC than it says")
        elif opcode in _DEFINITIONS:
            self._define(opcode, self._file.read(offset + HEADER.size, length), offset)
        elif opcode == Opcode.HEADER and offset == len(MAGIC):
            header = Header.read(self._file.content(offset, length))
            self.profile, self.library = header.profile, header.library
        elif opcode == Opcode.STATISTICS:
            self._statistics = offset, Statistics.read(self._file.content(offset, length))
        elif opcode == Opcode.FOOTER:
            self._footer(offset)
        elif opcode in _MISPLACED:
            raise DamageError(offset, f"a record of kind {opcode} where none may be")

    def _footer(self, offset: int) -> None:
        said = Footer.read(self._file.content(offset, 20))
        if not self._data_end:
            self._note(DamageError(offset, "no end of the data section before the footer"))
        start, crc = self._data_end or said.summary_start, said.summary_crc
        if crc and self._file.crc(start, offset + HEADER.size + 16) != crc:
            self._note(DamageError(start, "summary has another CRC than it says"))
        file_end = offset + HEADER.size + 20
        excess = self._file.size - file_end - len(MAGIC)
        if excess < 0 or self._file.read(file_end, len(MAGIC)) != MAGIC:
            self._note(DamageError(file_end, "no magic bytes after the footer"))
        elif excess:
            damage = f"{excess} bytes after the end, not read: cut two joined files apart there"
            self._note(DamageError(file_end + len(MAGIC), damage))

    def _compare(self, offset: int, said: Statistics) -> None:
        """Notes where a file has other messages than its statistics say."""
        counts = {"messages": (said.message_count, self.counts.total())}
        for channel, count in said.channel_message_counts.items():
            counts[f"messages of channel {channel}"] = count, self.counts[channel]
        for name, (count, actual) in counts.items():
            if count != actual:
                self._note(DamageError(offset, f"statistics say {count} {name}, found {actual}"))

    def _define(self, opcode: int, raw: bytes, offset: int) -> None:
        """Takes up a schema or channel; each keeps the definition that it had first.

        Raises:
            DamageError: where it is broken, too long, or contradicts an earlier one.
        """
        kind, limit = "schema" if opcode == Opcode.SCHEMA else "channel", self._options.max_part
        if len(raw) > limit:
            hint = file_records.RAISE_LIMIT.format("max_record", 32 * len(raw))
            raise DamageError(offset, f"a {kind} of {len(raw)} bytes, limit {limit}", hint)
        content = file_records.Content(raw, offset)
        definition: Any = (Schema if kind == "schema" else Channel).read(content)
        definitions: dict[int, Any] = self.schemas if kind == "schema" else self.channels
        name = definition.name if kind == "schema" else definition.topic
        if kind == "schema" and definition.id == 0:
            raise DamageError(offset, "a schema with the reserved id 0")
        if len(name) > _LONGEST_NAME:
            raise DamageError(offset, f"a name of {len(name)} characters, limit {_LONGEST_NAME}")
        if definitions.setdefault(definition.id, definition) != definition:
            damage = f"{kind} {definition.id} is defined a second time, differently"
            raise DamageError(offset, damage)

    # ------------------------------------------------------------------ blocks

    def _run(self, offset: int, next_record: int) -> int:
        """Takes up the records outside chunks from an offset on; returns where to read on."""
        size = max(min(file_records.PIECE, self._file.size - offset), next_record - offset)
        block, records = self._reader.run(offset, size)
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
