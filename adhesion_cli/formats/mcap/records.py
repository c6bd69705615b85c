"""The records of an MCAP file: a bounded linear walk that believes nothing unchecked.

Every declared length is checked against the bytes that are left and the limits of ReadOptions,
every CRC and inflated size is compared. Indexes only speed up what walking would find.
Specification: https://mcap.dev/spec
"""

import os
import re
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, MetadataIndex
from mcap.records import Schema as Schema  # for those who ask a Walk
from numpy.typing import NDArray

from ...core.errors import UserError
from ...core.model import RECOVERED, Bools, Times
from ..source import ReadOptions
from .columns import PADDING, Bytes, Offsets

MAGIC = b"\x89MCAP0\r\n"
HEADER = struct.Struct("<BQ")  # opcode and length of every record
_INDEXED: dict[int, Opcode] = {
    Opcode.CHUNK_INDEX: Opcode.CHUNK,
    Opcode.ATTACHMENT_INDEX: Opcode.ATTACHMENT,
    Opcode.METADATA_INDEX: Opcode.METADATA,
}
_FOOTER = struct.Struct("<BQQQI8s")  # and the magic bytes behind it
_LOG_TIME = struct.Struct("<15xq")  # of a Message record
MESSAGE = 22  # bytes of a Message record before its data: channel, sequence, two times
_AMONG_MESSAGES = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_PIECE = 1 << 20  # bytes read from the file at once
_CHUNK_LEAST = 60  # more than the fields of a chunk before its records have
_RUN = 4 << 20  # bytes of unchunked records taken together
_HEADS = 100  # first messages of a channel that are kept, to learn from them what it holds
_FIRST_BYTES = 64 << 20  # of the very first ones, all channels together
_HEAD_BYTES = 1 << 18  # of those behind the first, one channel
_MORE_BYTES = 16 << 20  # of these, all channels together
_LONGEST = 4096  # bytes of a topic
_RECORD = 128  # inflated bytes of the limit that stand for one record, beside the file's size
_OTHER = 4  # messages that a schema or channel costs as much as
_MOST_CUTS = 16  # times that what stands outside chunks is read on behind a record that is wrong
_UNUSUAL = 1000  # times a file's size that its chunks may inflate to, beside max_inflated
_RAISE_LIMIT = (
    "if the log is trusted, raise the limit with --set mcap.{}={}; else `adhesion recover` cuts it"
)


class DamageError(Exception):
    """Bytes that are not what the specification or the file itself says they are.

    Args:
        at: offset in the file.
        what: what is wrong there.
        hint: remedy other than recovering.
    """

    def __init__(self, at: int, what: str, hint: str = "") -> None:
        super().__init__(what)
        self.at, self.what, self.hint = at, what, hint


class _Content:
    """The fields of one record, read front to back."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at, self._p = data, at, 0

    def raw(self, size: int) -> bytes:
        if size > len(self._data) - self._p:
            raise DamageError(self._at, f"a field of {size} bytes does not fit into its record")
        self._p += size
        return self._data[self._p - size : self._p]

    def number(self, size: int) -> int:
        return int.from_bytes(self.raw(size), "little")

    def text(self) -> str:
        try:
            return self.raw(self.number(4)).decode()
        except UnicodeDecodeError:
            raise DamageError(self._at, "text is not UTF-8") from None

    def pairs(self) -> dict[str, str]:
        inner = _Content(self.raw(self.number(4)), self._at)
        found = {}
        while inner._p < len(inner._data):
            key = inner.text()
            found[key] = inner.text()
        return found

    def place(self) -> int:
        return self._p


class _File:
    """A file whose bytes are read by offset, a bounded piece at a time."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb", buffering=0)
        self.size = os.fstat(self._file.fileno()).st_size
        self._window, self._from = b"", 0

    def __enter__(self) -> "_File":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def read(self, at: int, size: int) -> bytes:
        place = at - self._from
        if 0 <= place <= len(self._window) - size:
            return self._window[place : place + size]
        data = os.pread(self._file.fileno(), size, at)
        while len(data) < size:
            more = os.pread(self._file.fileno(), size - len(data), at + len(data))
            if not more:
                raise DamageError(at, "file became shorter while it was read")
            data += more
        return data

    def head(self, at: int) -> tuple[int, int]:
        """Opcode and length of the record at an offset."""
        place = at - self._from
        if not 0 <= place <= len(self._window) - HEADER.size:
            self._window, self._from = os.pread(self._file.fileno(), _PIECE, at), at
            place = 0
        opcode, length = HEADER.unpack_from(self._window, place)
        return opcode, length

    def crc(self, start: int, end: int) -> int:
        crc = 0
        for piece in range(start, end, _PIECE):
            crc = zlib.crc32(self.read(piece, min(_PIECE, end - piece)), crc)
        return crc


@dataclass(slots=True)
class _Block:
    """Where messages stand in the file: a chunk, or a run of records outside chunks."""

    at: int
    end: int
    chunk: bool
    rows: int = 0  # messages
    checked: bool = False  # by a CRC
    index_at: int = 0  # the message indexes behind a chunk
    index_end: int = 0


@dataclass(slots=True)
class Records:
    """The records of one block, inflated and checked."""

    data: Bytes
    start: Offsets  # of the Message records
    channel: Offsets  # their channel ids
    others: list[tuple[int, int, int]]  # opcode, offset and length of schemas and channels
    unknown: int  # records of unknown kinds

    @property
    def besides(self) -> int:
        """How many messages the records that are none cost as much as."""
        return _OTHER * len(self.others) + self.unknown

    def field(self, offset: int, dtype: str) -> NDArray[Any]:
        """A number that every message record has at an offset."""
        size = np.dtype(dtype).itemsize
        view = np.ndarray((len(self.data) - size + 1,), dtype, self.data, 0, (1,))
        found: NDArray[Any] = view[self.start + offset]
        return found

    def before(self, place: int) -> "Records":
        """Those that stand before an offset."""
        others = [one for one in self.others if one[1] < place]
        return replace(self.some(self.start < place), others=others, unknown=0)

    def some(self, mine: Bools | Offsets) -> "Records":
        """Some of the messages, by a mask or by their numbers."""
        return replace(self, start=self.start[mine], channel=self.channel[mine])

    @property
    def end(self) -> Offsets:
        """Offsets behind the message records."""
        length: Offsets = self.field(1, "<i8")
        return self.start + HEADER.size + length

    @property
    def log_time(self) -> Times:
        """When messages were logged [ns]; beyond the year 2262 negative."""
        return self.field(15, "<i8")

    @property
    def publish_time(self) -> Times:
        """When messages were published [ns]; beyond the year 2262 negative."""
        return self.field(23, "<i8")


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
        self._defined: dict[tuple[int, int], Schema | Channel] = {}  # by opcode and id
        self.counts: Counter[int] = Counter()  # messages by channel
        self.heads: dict[int, tuple[int, list[bytes]]] = {}  # first messages, log time of the first
        self.blocks: list[_Block] = []
        self.damage: list[DamageError] = []
        self.unknown = 0  # records of unknown kinds
        self.times = (1 << 63, -1)  # first and last log time
        self.compressions: set[str] = set()
        self.profile = self.library = ""
        self.metadata: dict[str, dict[str, str]] = {}
        self.metadata_records: list[MetadataIndex] = []
        self.attachments: list[AttachmentIndex] = []  # the whole ones
        self._first_bytes = self._more_bytes = 0
        self._full: set[int] = set()  # channels of which no further first messages are kept
        self._prints: dict[tuple[int, int], int] = {}  # hashes of the definitions as they stood
        self._doubted: set[tuple[int, int]] = set()  # defined a second time, differently
        self._found = 0  # records inside blocks
        self._cuts = 0
        self._pending: _Block | None = None
        self._met: dict[int, tuple[int, int]] = {}  # kind and length by offset, for the indexes
        self._data_end = 0
        self._data_changed = False  # as the CRC of the data section says
        self._all_checked = False  # by the CRC of the data section
        self._inflated = 0  # bytes, all chunks of the first walk together
        self._walked = False
        self._sought = len(MAGIC)  # how far chunks behind damage were looked for
        self._kinds: Counter[int] = Counter()  # records by opcode
        self._statistics: tuple[int, dict[str, int], dict[int, int]] | None = None
        with self._opened() as self._file:
            self._check_magic()
            self._walk()
            self._compare()
        self._walked = True
        defined = self._defined.values()
        self.schemas = {one.id: one for one in defined if isinstance(one, Schema)}
        self.channels = {one.id: one for one in defined if isinstance(one, Channel)}
        if self.damage and not self.rows:
            raise self._error(self.damage[0], "no message in it is whole: copy the log anew")

    @property
    def rows(self) -> int:
        """Messages of channels that the file defines."""
        return sum(n for channel, n in self.counts.items() if channel in self.channels)

    @property
    def chunks(self) -> int:
        """Whole chunks."""
        return sum(block.chunk for block in self.blocks)

    @property
    def unchecked(self) -> int:
        """Messages that no CRC guards, or none did before they were recovered."""
        return self._bare + min(self._before("unchecked"), self.rows)

    @property
    def _bare(self) -> int:
        return 0 if self._all_checked else sum(b.rows for b in self.blocks if not b.checked)

    @property
    def suspect(self) -> int:
        """Of those, messages that may have changed: of the same bytes some are known to have."""
        end = max((block.end for block in self.blocks), default=0)
        here = self._data_changed or any(one.at < end for one in self.damage)
        return self.unchecked if here else min(self._before("suspect"), self.rows)

    def _before(self, what: str) -> int:
        count = self.metadata.get(RECOVERED, {}).get(what, "0")
        return int(count) if re.fullmatch("[0-9]{1,18}", count) else 0

    def account(self) -> dict[str, str]:
        """What a copy of what is whole has to say of itself: fresh CRCs make nothing sound."""
        past = self.metadata.get(RECOVERED, {})
        stray = sum(self.counts.values()) - self.rows
        if not (self.damage or self._bare or stray):
            return past
        found = [f"byte {one.at}: {one.what}" for one in self.damage[:1]]
        if len(self.damage) > 1:
            found.append(f"{len(self.damage) - 1} more")
        if stray and not found:
            found.append(f"{stray} messages of channels that it does not define")
        before = past.get("damage", "")
        unknown = self.lost is None or past.get("lost") == "unknown"
        lost = (self.lost or 0) + stray + self._before("lost")
        return {
            "damage": "; ".join([*found, *([f"before: {before}"] if before else [])])[:1000],
            "lost": "unknown" if unknown else str(lost),
            "unchecked": str(self.unchecked),
            "suspect": str(self.suspect),
        }

    @property
    def lost(self) -> int | None:
        """Messages that the statistics count and that are not whole; None where there are none."""
        said = self._statistics
        return None if said is None else max(said[1]["messages"] - sum(self.counts.values()), 0)

    def again(self) -> Iterator[tuple[_Block, Records]]:
        """The whole blocks a second time, with their records.

        Raises:
            UserError: where a block is not what it was.
        """
        try:
            with self._opened() as self._file:
                for block in self.blocks:
                    yield block, self._records(block)
        except DamageError:
            raise self.changed() from None

    def changed(self) -> UserError:
        """The error for a file that is not what it was on opening."""
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
                for piece in range(at, at + length, _PIECE):
                    yield file.read(piece, min(_PIECE, at + length - piece))
        except DamageError:
            raise self.changed() from None

    # ------------------------------------------------------------------ records outside chunks

    def _opened(self) -> _File:
        try:
            return _File(self.path)
        except OSError as e:
            raise UserError(f"{self.path}: {e.strerror}", "give the path of a log") from None

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
        on in the summary, whose indexes lead to what stands behind the damage; or, where bytes
        are missing or too many and no index is right, at the next chunk that is whole.
        """
        at, opcode = len(MAGIC), 0
        while opcode != Opcode.FOOTER:
            try:
                opcode, length = self._head(at)
            except DamageError as damage:
                self._flush()
                self._note(damage)
                if self._data_end:
                    break
                at = self._data_end = self._summary()
                if not at and not (at := self._next_chunk()):
                    break
                continue
            after = at + HEADER.size + length
            if at == len(MAGIC) and opcode != Opcode.HEADER:
                self._note(DamageError(at, "first record is no header"))
            try:
                if opcode in _AMONG_MESSAGES and not self._data_end:
                    after = self._run(at, length)
                else:
                    self._record(opcode, at, length, in_data=not self._data_end)
            except DamageError as damage:
                self._note(damage)
            at = after

    def _head(self, at: int) -> tuple[int, int]:
        """Opcode and length of the record at an offset, after which the file goes on."""
        left = self._file.size - at - HEADER.size
        if left < 0:
            raise DamageError(at, "file ends without a footer")
        opcode, length = self._file.head(at)
        if opcode == 0:
            raise DamageError(at, "a record of kind 0, which does not exist")
        if length > left:
            raise DamageError(at, f"a record says it has {length} bytes where {left} are left")
        if opcode == Opcode.FOOTER and length != 20:
            raise DamageError(at, f"a footer of {length} bytes")
        limit = self._options.max_record
        if length > limit and opcode != Opcode.ATTACHMENT:  # those are read in pieces
            hint = _RAISE_LIMIT.format("max_record", length)
            raise DamageError(at, f"a record of {length} bytes, limit {limit}", hint)
        return opcode, length

    def _summary(self) -> int:
        """Where the summary begins, if its CRC holds; else 0."""
        footer = self._file.size - _FOOTER.size
        if footer < len(MAGIC):
            return 0
        raw = self._file.read(footer, _FOOTER.size)
        opcode, length, start, _, crc, magic = _FOOTER.unpack(raw)
        if (opcode, length, magic) != (Opcode.FOOTER, 20, MAGIC) or not 0 < start < footer:
            return 0
        return start if self._file.crc(start, footer + HEADER.size + 16) == crc else 0

    def _next_chunk(self) -> int:
        """Where the first whole chunk that was not met begins; 0 where there is none."""
        at = max([self._sought, *(block.end for block in self.blocks)])
        while (size := min(_PIECE, self._file.size - at)) > _CHUNK_LEAST:
            window = np.frombuffer(self._file.read(at, size), np.uint8)
            found = np.flatnonzero(window[:-_CHUNK_LEAST] == Opcode.CHUNK)
            length, name = _u64(window, found + 1), _u64(window, found + 37) & 0xFFFFFFFF
            known = name <= max(map(len, _INFLATE))
            packed = _u64(window, np.where(known, found + 41 + name, 0))
            known &= (packed >= 0) & (packed <= length - 40 - name) & (length < self._file.size)
            for place, content in zip(found[known].tolist(), length[known].tolist(), strict=True):
                block = _Block(at + place, at + place + HEADER.size + content, True)
                try:
                    self._head(block.at)
                    self._records(block)
                except DamageError:
                    continue
                self._sought = block.end  # even if what it says is refused then
                return block.at
            at += size - _CHUNK_LEAST
        return 0

    def _run(self, at: int, length: int) -> int:
        """Takes messages and definitions outside chunks together; returns the offset behind."""
        self._flush()
        size = max(min(_RUN, self._file.size - at), HEADER.size + length)
        data = self._padded(at, size)
        found = _Found(*self._room())
        end = found.walk(data.data, 0, size, at)
        if not end:
            raise DamageError(at, _why(data.data, 0, size))
        return self._block(_Block(at, at + end, False), found.records(data))

    def _padded(self, at: int, size: int) -> Bytes:
        data = np.zeros(size + PADDING, np.uint8)
        data[:size] = np.frombuffer(self._file.read(at, size), np.uint8)
        return data

    def _content(self, at: int, length: int) -> _Content:
        return _Content(self._file.read(at + HEADER.size, length), at)

    def _record(self, opcode: int, at: int, length: int, in_data: bool) -> None:  # noqa: C901, PLR0912
        end = at + HEADER.size + length
        self._kinds[opcode] += 1
        if in_data and opcode in _INDEXED.values():
            self._met[at] = opcode, end - at
        if opcode == Opcode.MESSAGE_INDEX and in_data:
            if (chunk := self._pending) and chunk.chunk:
                chunk.index_at = chunk.index_at or at
                chunk.index_end = end
            return
        self._flush()
        if opcode == Opcode.CHUNK and in_data:
            self._pending = _Block(at, end, True)
        elif opcode == Opcode.DATA_END and in_data:
            self._data_end = end
            crc = self._content(at, length).number(4)
            if crc and self._file.crc(0, at) != crc:
                self._data_changed = True
                raise DamageError(at, "data section has another CRC than it says")
            self._all_checked = bool(crc)
        elif opcode == Opcode.HEADER and self._kinds[opcode] == 1:
            content = self._content(at, length)
            self.profile, self.library = content.text(), content.text()
        elif opcode == Opcode.ATTACHMENT and in_data:
            self._attachment(at, length)
        elif opcode == Opcode.METADATA and in_data:
            content = self._content(at, min(length, self._options.max_part))
            name = content.text()
            if length <= self._options.max_part:  # what is larger is none of ours, and is copied
                self.metadata.setdefault(name, {}).update(content.pairs())
            self.metadata_records.append(MetadataIndex(at, end - at, name))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._define(opcode, self._file.read(at + HEADER.size, length), at, self._defined)
        elif opcode == Opcode.STATISTICS:
            self._read_statistics(at, length)
        elif opcode in _INDEXED:
            content = self._content(at, length)
            content.raw(16 if opcode == Opcode.CHUNK_INDEX else 0)
            self._index(_INDEXED[opcode], content.number(8), content.number(8), at)
        elif opcode == Opcode.FOOTER:
            self._footer(at, length)
        elif opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END, Opcode.HEADER):
            raise DamageError(at, f"a record of kind {opcode} where none may be")
        elif opcode not in set(Opcode):
            self.unknown += 1

    def _index(self, kind: Opcode, place: int, size: int, at: int) -> None:
        """Compares an index with what was met; where the walk missed it, goes there."""
        if self._met.get(place) == (kind, size):
            return
        if self.damage and self._head(place) == (kind, size - HEADER.size):
            self._record(kind, place, size - HEADER.size, in_data=True)
        else:
            what = f"an index of a {kind.name.lower()} at byte {place} that is not there"
            raise DamageError(at, what)

    def _flush(self) -> None:
        """Hands on the block whose end was not known until now."""
        if self._pending:
            block, self._pending = self._pending, None
            self._block(block)

    def _compare(self) -> None:
        """Compares with what the statistics say."""
        if self._statistics is None or self.damage:
            return
        at, said, channels = self._statistics
        found = {
            "messages": sum(self.counts.values()),
            "chunks": self._kinds[Opcode.CHUNK],
            "attachments": self._kinds[Opcode.ATTACHMENT],
            "metadata records": self._kinds[Opcode.METADATA],
        }
        for name, count in found.items():
            if said[name] != count:
                self._note(DamageError(at, f"statistics say {said[name]} {name}, found {count}"))
        for channel, count in channels.items():
            if self.counts[channel] != count:
                here = self.counts[channel]
                what = f"statistics say {count} messages of channel {channel}, found {here}"
                self._note(DamageError(at, what))

    def _attachment(self, at: int, length: int) -> None:
        place, end = at + HEADER.size, at + HEADER.size + length
        content = self._content(at, min(length, _PIECE))
        log_time, create_time = content.number(8), content.number(8)
        name, kind, size = content.text(), content.text(), content.number(8)
        behind = place + content.place() + size
        if behind + 4 > end:
            raise DamageError(at, "an attachment's data does not fit into its record")
        crc = int.from_bytes(self._file.read(behind, 4), "little")
        if crc and self._file.crc(place, behind) != crc:
            raise DamageError(at, "attachment has another CRC than it says")
        self.attachments.append(
            AttachmentIndex(at, end - at, log_time, create_time, size, name, kind)
        )

    def _read_statistics(self, at: int, length: int) -> None:
        content = self._content(at, length)
        said = {"messages": content.number(8)}
        content.raw(6)  # schemas and channels: records that hide no data
        for name in ("attachments", "metadata records", "chunks"):
            said[name] = content.number(4)
        content.raw(16)
        inner = _Content(content.raw(content.number(4)), at)
        channels = {}
        while inner.place() < len(inner._data):
            channel = inner.number(2)
            channels[channel] = inner.number(8)
        self._statistics = at, said, channels

    def _footer(self, at: int, length: int) -> None:
        content = self._content(at, length)
        summary, _, crc = content.number(8), content.number(8), content.number(4)
        if not self._data_end:
            self._note(DamageError(at, "no end of the data section before the footer"))
        start = self._data_end or summary
        if crc and self._file.crc(start, at + HEADER.size + 16) != crc:
            self._note(DamageError(start, "summary has another CRC than it says"))
        behind = at + HEADER.size + length
        if self._file.size - behind < len(MAGIC) or self._file.read(behind, len(MAGIC)) != MAGIC:
            self._note(DamageError(behind, "no magic bytes behind the footer"))
        elif self._file.size - behind > len(MAGIC):
            more = self._file.size - behind - len(MAGIC)
            what = f"{more} bytes behind the end, not read: cut two joined files apart there"
            self._note(DamageError(behind + len(MAGIC), what))

    # ------------------------------------------------------------------ records inside a block

    def _block(self, block: _Block, records: Records | None = None) -> int:
        """Takes up the definitions in a block and counts its messages.

        A chunk that is wrong somewhere defines nothing and has no messages; records outside
        chunks are taken up to the one that is wrong.

        Returns:
            The offset from which to read on.
        """
        fresh: dict[tuple[int, int], Schema | Channel] = {}
        try:
            records = records or self._records(block)
            for opcode, place, length in records.others:
                at = block.at if block.chunk else block.at + place - HEADER.size
                self._define(opcode, records.data[place : place + length].tobytes(), at, fresh)
            self._check(block, records, fresh)
        except DamageError as damage:
            self._note(damage)
            if block.chunk or records is None or self._cuts == _MOST_CUTS:
                return block.end
            self._cuts += 1
            place = damage.at - block.at
            if place:
                self._block(_Block(block.at, damage.at, False), records.before(place))
            return damage.at + HEADER.size + int(_u64(records.data, np.array([place + 1]))[0])
        self._defined |= fresh
        block.rows = len(records.start)
        self.blocks.append(block)
        self._found += len(records.start) + records.besides
        self.unknown += records.unknown
        counts = np.bincount(records.channel)
        met = np.flatnonzero(counts).tolist()
        self.counts.update(dict(zip(met, counts[met].tolist(), strict=True)))
        if unmet := [channel for channel in met if channel not in self._full]:
            order = np.argsort(records.channel.astype(np.uint16), kind="stable")
            behind = np.cumsum(counts).tolist()
            for channel in unmet:
                end = behind[channel]
                self._keep_heads(channel, records, order[end - int(counts[channel]) : end])
        if len(records.start):
            log = records.log_time
            first, last = int(log.min()), int(log.max())
            self.times = min(self.times[0], first), max(self.times[1], last)
        return block.end

    def _check(
        self, block: _Block, records: Records, fresh: dict[tuple[int, int], Schema | Channel]
    ) -> None:
        """Refuses a block whose messages have no time, or nobody knows of which channel.

        That is where the channel was defined differently in some block, and not in this one.
        """

        def at(first: np.intp) -> int:
            return block.at + (0 if block.chunk else int(records.start[first]))

        if len(records.start) and (log := records.log_time).min() < 0:
            raise DamageError(at(np.argmax(log < 0)), "a log time beyond the year 2262")
        if not self._doubted:
            return
        stated = {
            (opcode, int(records.data[place]) | int(records.data[place + 1]) << 8)
            for opcode, place, length in records.others
        }
        for channel in np.unique(records.channel).tolist():
            key = (int(Opcode.CHANNEL), channel)
            one = fresh.get(key) or self._defined.get(key)
            schema = one.schema_id if isinstance(one, Channel) else 0
            if {key, (int(Opcode.SCHEMA), schema)} & self._doubted - stated:
                what = f"a message of channel {channel}, whose definition was contradicted before"
                raise DamageError(at(np.argmax(records.channel == channel)), what)

    def _keep_heads(self, channel: int, records: Records, mine: Offsets) -> None:
        """Keeps the first messages of a channel, of as many blocks as it takes."""
        data, starts = records.data.data, records.start
        if channel not in self.heads:
            self.heads[channel] = _LOG_TIME.unpack_from(data, int(starts[mine[0]]))[0], []
        heads = self.heads[channel][1]
        bytes_before = sum(map(len, heads[1:]))
        for start in starts[mine[: _HEADS - len(heads)]].tolist():
            size = HEADER.unpack_from(data, start)[1] - MESSAGE
            if not heads:
                self._first_bytes += size
                full = self._first_bytes > _FIRST_BYTES
            else:
                bytes_before += size
                self._more_bytes += size
                full = bytes_before > _HEAD_BYTES or self._more_bytes > _MORE_BYTES
            if full:
                self._full.add(channel)
                return
            begin = start + HEADER.size + MESSAGE
            heads.append(bytes(data[begin : begin + size]))
        if len(heads) == _HEADS:
            self._full.add(channel)

    def _define(
        self, opcode: int, raw: bytes, at: int, into: dict[tuple[int, int], Schema | Channel]
    ) -> None:
        """Takes up a Schema or Channel record; a second one must equal the first.

        Args:
            opcode: which of them.
            raw: its content.
            at: where to say that it stands.
            into: what is defined by now, beside `_defined`.
        """
        if len(raw) > (limit := self._options.max_part):
            kind = "schema" if opcode == Opcode.SCHEMA else "channel"
            hint = _RAISE_LIMIT.format("max_record", 32 * len(raw))
            raise DamageError(at, f"a {kind} of {len(raw)} bytes, limit {limit}", hint)
        key, print_ = (opcode, int.from_bytes(raw[:2], "little")), hash(raw)
        if self._prints.get(key) == print_ and (key in into or key in self._defined):
            return  # as in every chunk of some writers
        content = _Content(raw, at)
        one: Schema | Channel
        if opcode == Opcode.SCHEMA:
            number, name, encoding = content.number(2), content.text(), content.text()
            one = Schema(number, content.raw(content.number(4)), encoding, name)
            if number == 0:
                raise DamageError(at, "a schema with the reserved id 0")
        else:
            number, schema = content.number(2), content.number(2)
            topic, encoding = content.text(), content.text()
            one = Channel(number, topic, encoding, content.pairs(), schema)
            name = topic
        if len(name) > _LONGEST:
            raise DamageError(at, f"a name of {len(name)} characters, limit {_LONGEST}")
        if self._defined.get(key, one) != one or into.setdefault(key, one) != one:
            self._doubted.add(key)
            kind = type(one).__name__.lower()
            raise DamageError(at, f"{kind} {number} is defined a second time, differently")
        self._prints[key] = print_

    def _room(self) -> tuple[int, int]:
        """How many records blocks may have, as a few bytes can inflate to millions; and have."""
        most = self._file.size + self._options.max_inflated // _RECORD
        return (1 << 62 if self._walked else most), self._found

    def _records(self, block: _Block) -> Records:
        """The records of a block, inflated, checked, and its messages found."""
        if block.chunk:
            data, size = self._inflate(block)
            hints = self._hints(block, size)
        else:
            size, hints = block.end - block.at, None
            data = self._padded(block.at, size)
        return _find(data, size, hints, block, self._room())

    def _inflate(self, block: _Block) -> tuple[Bytes, int]:
        content = self._content(block.at, block.end - block.at - HEADER.size)
        content.raw(16)  # the time range, which nothing here relies on
        size, crc, compression = content.number(8), content.number(4), content.text()
        packed = content.raw(content.number(8))
        limit = self._options.max_inflated
        if size > limit:
            hint = _RAISE_LIMIT.format("max_inflated", size)
            raise DamageError(block.at, f"a chunk of {size} inflated bytes, limit {limit}", hint)
        if not self._walked:
            self._inflated += size
            if (total := self._inflated) > (limit := limit + _UNUSUAL * self._file.size):
                self._inflated -= size
                hint = _RAISE_LIMIT.format("max_inflated", total)
                what = f"chunks of {total} inflated bytes in all, limit {limit} for such a file"
                raise DamageError(block.at, what, hint)
        data = np.empty(size + PADDING, np.uint8)
        data[size:] = 0
        try:
            found = _INFLATE[compression](packed, data.data[: size + 1])
        except KeyError:
            raise DamageError(block.at, f"unknown compression {compression[:20]!r}") from None
        except Exception as e:  # lz4 and zstandard raise several kinds, all of them mean this
            raise DamageError(block.at, f"chunk does not inflate: {e}") from None
        if found != size:
            more = "more" if found > size else f"{found}"
            raise DamageError(block.at, f"chunk says {size} inflated bytes and has {more}")
        if crc and zlib.crc32(data[:size].data) != crc:
            raise DamageError(block.at, "chunk has another CRC than it says")
        block.checked = bool(crc)
        data[size:] = 0
        self.compressions.add(compression or "none")
        return data, size

    def _hints(self, block: _Block, size: int) -> Offsets | None:
        """Where the message indexes behind a chunk say its messages are; not yet to be believed."""
        length = block.index_end - block.index_at
        if not length or length > size + (1 << 20):
            return None
        raw = self._file.read(block.index_at, length)
        found, at = [], 0
        while at < length:
            _, record = HEADER.unpack_from(raw, at)
            at += HEADER.size
            if record < 6:
                return None
            entries = int.from_bytes(raw[at + 2 : at + 6], "little") // 16
            if entries * 16 > record - 6:
                return None
            found.append(np.frombuffer(raw, "<i8", 2 * entries, at + 6)[1::2])
            at += record
        return np.concatenate(found) if found else None


def _inflate_none(packed: bytes, into: memoryview) -> int:
    fits = min(len(packed), len(into))
    into[:fits] = packed[:fits]
    return fits


def _inflate_zstd(packed: bytes, into: memoryview) -> int:
    import zstandard

    found = 0
    with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
        while found < len(into) and (more := stream.readinto(into[found:])):
            found += more
    return found


def _inflate_lz4(packed: bytes, into: memoryview) -> int:
    import lz4.frame

    found, frame = 0, lz4.frame.LZ4FrameDecompressor()
    while found < len(into) and not frame.eof:
        more = frame.decompress(packed, max_length=min(len(into) - found, _PIECE))
        if not more:
            break
        into[found : found + len(more)] = more
        found, packed = found + len(more), b""
    return found


_INFLATE = {"": _inflate_none, "zstd": _inflate_zstd, "lz4": _inflate_lz4}


class _Found:
    """Records found in a buffer so far.

    Args:
        most: how many there may be, with those before.
        before: how many were found in other buffers.
    """

    def __init__(self, most: int, before: int) -> None:
        self._most, self._before = most, before
        self._starts = array("q")
        self._others: list[tuple[int, int, int]] = []
        self._unknown = 0

    def walk(self, view: memoryview, p: int, stop: int, at: int) -> int:
        """Walks records one by one; returns where it ends.

        That is `stop`, or the first record that is not whole, or that may not stand among
        messages; `_why` tells which.

        Raises:
            DamageError: at the offset `at`, where there are more records than there may be.
        """
        unpack, add = HEADER.unpack_from, self._starts.append
        message, definitions = int(Opcode.MESSAGE), (int(Opcode.SCHEMA), int(Opcode.CHANNEL))
        while p <= stop - HEADER.size:
            last = min(stop - HEADER.size, p + _PIECE)
            while p <= last:
                opcode, length = unpack(view, p)
                after = p + 9 + length
                if after > stop:
                    return p
                if opcode == message:
                    if length < MESSAGE:
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
            if self._before + found > self._most:
                hint = _RAISE_LIMIT.format("max_inflated", (self._before + stop) * _RECORD)
                raise DamageError(at, "more records than a file of this size holds", hint)
        return p

    def records(self, data: Bytes, indexed: Offsets | None = None) -> Records:
        """What was found, and messages that an index had found before."""
        start = np.array(self._starts, np.int64)
        if indexed is not None:
            start = np.sort(np.append(indexed, start)) if len(start) else indexed
        channel = data[start + 9].astype(np.int64) | (data[start + 10].astype(np.int64) << 8)
        return Records(data, start, channel, self._others, self._unknown)


def _why(view: memoryview, p: int, stop: int) -> str:
    """Why a walk ended at a record."""
    if p > stop - HEADER.size:
        return "ends in the middle of a record"
    opcode, length = HEADER.unpack_from(view, p)
    if length > stop - p - HEADER.size:
        return f"a record says it has {length} bytes, more than are left"
    if opcode == Opcode.MESSAGE:
        return f"a message record of {length} bytes"
    return f"a record of kind {opcode} where none may be"


def _find(
    data: Bytes, size: int, hints: Offsets | None, block: _Block, room: tuple[int, int]
) -> Records:
    """Finds the records of a block.

    Args:
        data: the block's bytes, PADDING more behind them.
        size: how many bytes it has.
        hints: where an index says its messages are; used where they and what stands between
            them fill the block without a gap, which is what walking would find.
        block: for the words of an error.
        room: how many records there may be, and how many were found before.
    """
    if hints is not None and len(hints):
        start = _tiling(data, size, np.sort(hints))
        if start is not None:
            found = _Found(*room)
            ends = np.append(0, start + HEADER.size + _u64(data, start + 1))
            stops = np.append(start, size)
            gaps = np.flatnonzero(ends != stops)
            between = zip(ends[gaps].tolist(), stops[gaps].tolist(), strict=True)
            if all(found.walk(data.data, p, stop, block.at) == stop for p, stop in between):
                return found.records(data, start)
    found = _Found(*room)
    end = found.walk(data.data, 0, size, block.at)
    if end < size:
        where = f"chunk, at its inflated byte {end}: " if block.chunk else ""
        raise DamageError(block.at, where + _why(data.data, end, size))
    return found.records(data)


def _u64(data: Bytes, offsets: Offsets) -> Offsets:
    view: Offsets = np.ndarray((len(data) - 7,), "<i8", data, 0, (1,))
    return view[offsets]


def _tiling(data: Bytes, size: int, hints: Offsets) -> Offsets | None:
    """The hints, if there are message records at all of them that do not overlap."""
    if hints[0] < 0 or hints[-1] > size - HEADER.size - MESSAGE:
        return None
    length = _u64(data, hints + 1)
    if (data[hints] != Opcode.MESSAGE).any() or ((length < MESSAGE) | (length > size)).any():
        return None
    ends = hints + HEADER.size + length
    if (ends[:-1] > hints[1:]).any() or ends[-1] > size:
        return None
    return hints
