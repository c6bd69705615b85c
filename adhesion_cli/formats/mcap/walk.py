"""One linear walk over an MCAP file, which believes nothing unchecked.

Every CRC and every inflated size is compared. Indexes only speed up what walking would find.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from ...core.errors import UserError
from ...core.model import RECOVERED, Times
from ..source import ReadOptions
from .account import Account
from .blocks import Block, BlockReader
from .definitions import Definitions, FirstMessages, Key
from .messages import Offsets, Records, u64
from .records import HEADER, MAGIC, PIECE, DamageError, LogFile
from .summary import differences, footer_damage, summary_start

_INDEXED: dict[int, Opcode] = {
    Opcode.CHUNK_INDEX: Opcode.CHUNK,
    Opcode.ATTACHMENT_INDEX: Opcode.ATTACHMENT,
    Opcode.METADATA_INDEX: Opcode.METADATA,
}
_IN_DATA: dict[int, str] = {  # records of the data section, and who reads them
    Opcode.CHUNK: "_chunk",
    Opcode.ATTACHMENT: "_attachment",
    Opcode.METADATA: "_metadata",
    Opcode.DATA_END: "_end_of_data",
}
_AMONG_MESSAGES = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_MISPLACED = (Opcode.HEADER, Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END)
_MOST_CUTS = 16  # times that reading goes on after a wrong record outside chunks


class Walk:
    """One walk over a file: what it defines, where its messages are, and what is damaged.

    Args:
        path: the file.
        options: limits, and whether damage is an error.

    Raises:
        UserError: where the file cannot be read, is no MCAP, holds nothing whole, or is damaged
            and options.strict is set: "FILE: byte N: what".
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        self.counts: Counter[int] = Counter()  # messages by channel
        self.blocks: list[Block] = []
        self.damage: list[DamageError] = []
        self.times = (1 << 63, -1)  # first and last log time
        self.profile = self.library = ""
        self.metadata: dict[str, dict[str, str]] = {}
        self.metadata_records: list[MetadataIndex] = []
        self.attachments: list[AttachmentIndex] = []  # the whole ones
        self._definitions = Definitions(options.max_part)
        self._first = FirstMessages()
        self._cuts = 0
        self._met: dict[int, tuple[int, int]] = {}  # kind and length by offset, for the indexes
        self._data_end = 0
        self._data_changed = False  # as the CRC of the data section says
        self._all_checked = False  # by the CRC of the data section
        self._sought = len(MAGIC)  # how far chunks after damage were looked for
        self._kinds: Counter[int] = Counter()  # records by opcode
        self._statistics: tuple[int, Statistics] | None = None  # with their offset
        with self._opened() as self._file:
            self._reader = BlockReader(self._file, options, first=True)
            self._check_magic()
            self._walk()
            if self._statistics and not self.damage:
                at, said = self._statistics
                for damage in differences(said, at, self._kinds, self.counts):
                    self._note(damage)
        self.compressions = self._reader.compressions
        self.heads = self._first.of  # by channel: log time of the first, first messages
        self.schemas, self.channels = self._definitions.schemas, self._definitions.channels
        #: Messages of channels that the file defines.
        self.rows = sum(n for channel, n in self.counts.items() if channel in self.channels)
        if self.damage and not self.rows:
            raise self._error(self.damage[0], "no message in it is whole: copy the log anew")

    @property
    def chunks(self) -> int:
        """Whole chunks."""
        return sum(block.chunk for block in self.blocks)

    @property
    def losses(self) -> Account:
        """What the file has lost, and which of its messages may have changed."""
        end = max((block.end for block in self.blocks), default=0)
        return Account(
            damage=self.damage,
            rows=self.rows,
            stray=sum(self.counts.values()) - self.rows,
            unguarded=0 if self._all_checked else sum(b.rows for b in self.blocks if not b.checked),
            changed=self._data_changed or any(one.at < end for one in self.damage),
            counted=self._statistics[1].message_count if self._statistics else None,
            past=self.metadata.get(RECOVERED, {}),
        )

    def account(self) -> dict[str, str]:
        """What a copy must say about itself, {} for a sound file."""
        return self.losses.as_metadata()

    # ------------------------------------------------------------------ what is whole, again

    def again(self) -> Iterator[tuple[Block, Records]]:
        """The whole blocks a second time, with their records.

        Raises:
            UserError: where a block has changed.
        """
        try:
            with self._opened() as file:
                reader = BlockReader(file, self._options, first=False)
                for block in self.blocks:
                    yield block, reader.records(block)
        except DamageError:
            raise self.changed() from None

    def changed(self) -> UserError:
        """The error for a file that has changed since opening."""
        return UserError(f"{self.path}: the file changed while it was read", "read it again")

    def messages(self) -> Iterator[tuple[bytes, Offsets, Times, Offsets]]:
        """The messages of channels that the file defines, a block at a time.

        Yields:
            Their records end to end; of each channel id, log time [ns] and length of the record,
            shape (n,).

        Raises:
            UserError: as `again`.
        """
        for _, records in self.again():
            known = records.some(np.isin(records.channel, list(self.channels)))
            start, end = known.start, known.end
            if len(start):
                gaps = np.flatnonzero(start[1:] != end[:-1])
                runs = zip(start[np.append(0, gaps + 1)], end[np.append(gaps, -1)], strict=True)
                raw = b"".join(known.data[a:b].tobytes() for a, b in runs)
                yield raw, known.channel, known.log_time, end - start

    def raw(self, at: int, length: int) -> Iterator[bytes]:
        """Bytes of the file, a piece at a time.

        Raises:
            UserError: where the file has become shorter.
        """
        try:
            with self._opened() as file:
                for piece in range(at, at + length, PIECE):
                    yield file.read(piece, min(PIECE, at + length - piece))
        except DamageError:
            raise self.changed() from None

    # ------------------------------------------------------------------ the walk

    def _opened(self) -> LogFile:
        return LogFile(self.path, self._options.max_record)

    def _check_magic(self) -> None:
        size = self._file.size
        if self._file.read(0, min(size, len(MAGIC))) != MAGIC:
            what = "file is empty" if not size else "not an MCAP file (wrong magic bytes)"
            hint = "give an MCAP log; a CSV log must not be named .mcap"
            raise UserError(f"{self.path}: byte 0: {what}", hint)

    def _note(self, damage: DamageError) -> None:
        # A traceback would keep alive what the frames in it hold: a chunk's inflated bytes.
        damage.__traceback__ = damage.__context__ = None
        self.damage.append(damage)
        if self._options.strict:
            raise self._error(damage)

    def _error(
        self,
        damage: DamageError,
        hint: str = "`adhesion recover` writes what is whole as a new file",
    ) -> UserError:
        return UserError(f"{self.path}: byte {damage.at}: {damage.what}", damage.hint or hint)

    def _walk(self) -> None:
        """Walks the file up to its footer.

        Damage of one whole record does not end the walk. Where a record has no end, the walk goes
        on in the summary, whose indexes lead to the records after the damage. Without a right
        summary it goes on at the next whole chunk.
        """
        at, opcode = len(MAGIC), 0
        while opcode != Opcode.FOOTER:
            try:
                opcode, length = self._file.head(at)
            except DamageError as damage:
                self._note(damage)
                if self._data_end:
                    break
                at = self._data_end = summary_start(self._file)
                if not at and not (at := self._next_chunk()):
                    break
                continue
            after = at + HEADER.size + length
            if at == len(MAGIC) and opcode != Opcode.HEADER:
                self._note(DamageError(at, "first record is no header"))
            try:
                if opcode in _AMONG_MESSAGES and not self._data_end:
                    after = self._take(*self._reader.run(at, length))
                else:
                    self._record(opcode, at, length, in_data=not self._data_end)
            except DamageError as damage:
                self._note(damage)
            at = after

    def _next_chunk(self) -> int:
        """Where the next whole chunk begins that was not met yet; 0 without one."""
        block = self._reader.next_chunk(max([self._sought, *(b.end for b in self.blocks)]))
        self._sought = block.end if block else self._sought  # even if it is refused afterwards
        return block.at if block else 0

    def _record(self, opcode: int, at: int, length: int, in_data: bool) -> None:
        self._kinds[opcode] += 1
        if in_data and opcode in _INDEXED.values():
            self._met[at] = opcode, HEADER.size + length
        if in_data and opcode in _IN_DATA:
            getattr(self, _IN_DATA[opcode])(at, length)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            fresh: dict[Key, Schema | Channel] = {}
            self._definitions.read(opcode, self._file.read(at + HEADER.size, length), at, fresh)
            self._definitions.keep(fresh)
        elif opcode == Opcode.HEADER and self._kinds[opcode] == 1:
            header = Header.read(self._file.content(at, length))
            self.profile, self.library = header.profile, header.library
        elif opcode == Opcode.STATISTICS:
            self._statistics = at, Statistics.read(self._file.content(at, length))
        elif opcode in _INDEXED:
            content = self._file.content(at, length)
            content.read(16 if opcode == Opcode.CHUNK_INDEX else 0)
            self._index(_INDEXED[opcode], content.read8(), content.read8(), at)
        elif opcode == Opcode.FOOTER:
            for damage in footer_damage(self._file, at, self._data_end):
                self._note(damage)
        elif opcode in _MISPLACED:
            raise DamageError(at, f"a record of kind {opcode} where none may be")

    def _index(self, kind: Opcode, place: int, size: int, at: int) -> None:
        """Compares an index with what was met; where the walk missed it, goes there."""
        if self._met.get(place) == (kind, size):
            return
        if self.damage and self._file.head(place) == (kind, size - HEADER.size):
            self._record(kind, place, size - HEADER.size, in_data=True)
        else:
            what = f"an index of a {kind.name.lower()} at byte {place} that is not there"
            raise DamageError(at, what)

    # ------------------------------------------------------------------ records between messages

    def _chunk(self, at: int, length: int) -> None:
        block = Block(at, at + HEADER.size + length, True)
        block.index_end = block.end
        try:
            while (head := self._file.head(block.index_end))[0] == Opcode.MESSAGE_INDEX:
                if head[1] < 6:
                    break
                block.index_end += HEADER.size + head[1]
        except DamageError:
            pass  # which the walk meets next
        self._take(block)

    def _end_of_data(self, at: int, length: int) -> None:
        self._data_end = at + HEADER.size + length
        crc = self._file.content(at, length).read4()
        if crc and self._file.crc(0, at) != crc:
            self._data_changed = True
            raise DamageError(at, "data section has another CRC than it says")
        self._all_checked = bool(crc)

    def _metadata(self, at: int, length: int) -> None:
        content = self._file.content(at, min(length, self._options.max_part))
        name = content.read_prefixed_string()
        if length <= self._options.max_part:  # larger ones are not ours; a copy keeps them
            whole = Metadata.read(self._file.content(at, length))
            self.metadata.setdefault(name, {}).update(whole.metadata)
        self.metadata_records.append(MetadataIndex(at, HEADER.size + length, name))

    def _attachment(self, at: int, length: int) -> None:
        place, end = at + HEADER.size, at + HEADER.size + length
        content = self._file.content(at, min(length, PIECE))
        log_time, create_time = content.read8(), content.read8()
        name, kind = content.read_prefixed_string(), content.read_prefixed_string()
        size = content.read8()
        after = place + content.count + size
        if after + 4 > end:
            raise DamageError(at, "an attachment's data does not fit into its record")
        crc = int.from_bytes(self._file.read(after, 4), "little")
        if crc and self._file.crc(place, after) != crc:
            raise DamageError(at, "attachment has another CRC than it says")
        self.attachments.append(
            AttachmentIndex(at, end - at, log_time, create_time, size, name, kind)
        )

    # ------------------------------------------------------------------ blocks

    def _take(self, block: Block, records: Records | None = None) -> int:
        """Takes up the definitions in a block and counts its messages.

        A chunk with any damage defines nothing and has no messages. Records outside chunks are
        taken up to the one that is wrong.

        Returns:
            The offset from which to read on.
        """
        fresh: dict[Key, Schema | Channel] = {}
        try:
            records = records or self._reader.records(block)
            self._check(block, records, fresh)
        except DamageError as damage:
            self._note(damage)
            if block.chunk or records is None or self._cuts == _MOST_CUTS:
                return block.end
            self._cuts += 1
            place = damage.at - block.at
            if place:
                self._take(Block(block.at, damage.at, False), records.before(place))
            return damage.at + HEADER.size + int(u64(records.data, np.array([place + 1]))[0])
        self._definitions.keep(fresh)
        block.rows = len(records.start)
        self.blocks.append(block)
        self._reader.found += records.cost
        self._count(records)
        return block.end

    def _check(self, block: Block, records: Records, fresh: dict[Key, Schema | Channel]) -> None:
        """Refuses a block with wrong definitions, wrong times, or messages of doubtful channels."""
        for opcode, place, length in records.others:
            at = block.at if block.chunk else block.at + place - HEADER.size
            raw = records.data[place : place + length].tobytes()
            self._definitions.read(opcode, raw, at, fresh)

        def at_first(which: np.intp) -> int:
            return block.at + (0 if block.chunk else int(records.start[which]))

        if len(records.start) and (log := records.log_time).min() < 0:
            raise DamageError(at_first(np.argmax(log < 0)), "a log time beyond the year 2262")
        for channel in self._definitions.doubtful(records, fresh):
            what = f"a message of channel {channel}, whose definition was contradicted before"
            raise DamageError(at_first(np.argmax(records.channel == channel)), what)

    def _count(self, records: Records) -> None:
        """Counts messages and keeps the first ones of each channel."""
        if not len(records.start):
            return
        counts = np.bincount(records.channel)
        met = np.flatnonzero(counts).tolist()
        self.counts.update(dict(zip(met, counts[met].tolist(), strict=True)))
        if unmet := [channel for channel in met if channel not in self._first.full]:
            order = np.argsort(records.channel.astype(np.uint16), kind="stable")
            ends = np.cumsum(counts).tolist()
            for channel in unmet:
                end = ends[channel]
                self._first.keep(channel, records, order[end - int(counts[channel]) : end])
        log = records.log_time
        first, last = int(log.min()), int(log.max())
        self.times = min(self.times[0], first), max(self.times[1], last)
