"""MCAP logs: a bounded linear walk over the records, and columns from the messages.

Nothing a file says is believed before it is checked: every declared length against the bytes
that are left and the limits of ReadOptions, every CRC, inflated sizes, indexes, statistics.
Indexes only speed up what walking would find. Specification: https://mcap.dev/spec
"""

import os
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from ..errors import UserError
from ..model import Bools, Column, Finding, Floats, Severity, Times
from .source import Field, ReadOptions
from .tree import (
    PADDING,
    Bytes,
    Decoder,
    Fault,
    Leaf,
    Offsets,
    Steps,
    Tree,
    UndecodableError,
    at,
    leaves,
    repeated,
    stamp,
)

MAGIC = b"\x89MCAP0\r\n"
_HEADER = struct.Struct("<BQ")  # opcode and length of every record
_MESSAGE = 22  # bytes of a Message record before its data: channel, sequence, two times
_PIECE = 1 << 20  # bytes read from the file at once
_RUN = 4 << 20  # bytes of unchunked records taken together
_HEADS = 64 << 20  # bytes of first messages that are kept, all channels together
_JSON_HEADS = 100  # messages of a JSON channel that are searched for keys on opening
_YEAR_1990 = 631_152_000 * 10**9  # earlier stamps count from a start of their own
_DAY = 86_400 * 10**9
_SECOND = 10**9
_RAISE_LIMIT = "raise the limit if the log is trusted, or cut it with `adhesion recover`"
_NOT_LOADED = (Opcode.ATTACHMENT,)  # read in pieces, so of any length
_SEVERITY: dict[str, Severity] = {
    "mcap-bad-message": "error",
    "mcap-type-change": "error",
    "mcap-label-change": "error",
    "mcap-array-length": "warning",
    "mcap-late-field": "warning",
    "mcap-no-stamp": "error",
}


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
        self._file = open(path, "rb")  # noqa: SIM115 (closed with the source)
        self.size = os.fstat(self._file.fileno()).st_size
        self._window, self._from = b"", 0

    def close(self) -> None:
        self._file.close()

    def read(self, at: int, size: int) -> bytes:
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
        if not 0 <= place <= len(self._window) - _HEADER.size:
            self._window, self._from = os.pread(self._file.fileno(), _PIECE, at), at
            place = 0
        opcode, length = _HEADER.unpack_from(self._window, place)
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
    index_at: int = 0  # the message indexes behind a chunk
    index_end: int = 0


@dataclass(slots=True)
class _Records:
    """The records of one block, inflated and checked."""

    data: Bytes
    start: Offsets  # of the Message records
    channel: Offsets  # their channel ids
    others: list[tuple[int, int, int]]  # opcode, offset and length of schemas and channels
    unknown: int  # records of unknown kinds

    def u64(self, offset: int) -> Times:
        """A 64-bit field of every message."""
        words = np.ndarray((len(self.data) - 7,), "<i8", self.data, 0, (1,))
        return words[self.start + offset]


@dataclass(slots=True)
class _Series:
    """What one topic carries: channels of one schema."""

    topic: str
    encoding: str
    schema: Schema | None
    metadata: dict[str, str]
    ids: list[int] = field(default_factory=list)
    rows: int = 0
    group: str = ""
    heads: list[bytes] = field(default_factory=list)
    head_time: int = 0
    decoder: Decoder | None = None
    tree: Tree = None
    leaves: dict[str, Leaf] = field(default_factory=dict)
    stamp: tuple[Steps, Steps] | None = None
    stamp_time: int = 0  # of the first message, 0 where it has none

    @property
    def name(self) -> str:
        return self.schema.name if self.schema else ""


def open_mcap(path: Path, options: ReadOptions) -> "McapSource":
    """Opens an MCAP log: walks all records, checks them, and lists the numbers in its messages.

    Raises:
        UserError: where the file is no MCAP, nothing in it is whole, or it is damaged and
            options.strict is set; "FILE: byte N: what".
    """
    return McapSource(Path(path), options)


class McapSource:
    """An MCAP log, see Source."""

    format = "mcap"

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        self.findings: list[Finding] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.stated: dict[str, Any] = {}
        self.rows = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._heads: dict[int, tuple[int, list[bytes]]] = {}  # log time, messages
        self._head_bytes = 0
        self._blocks: list[_Block] = []
        self._damage: list[DamageError] = []
        self._unknown = 0
        self._times = (1 << 63, -1)  # first and last log time
        self._compressions: set[str] = set()
        try:
            self._file = _File(path)
        except OSError as e:
            raise UserError(f"{path}: {e.strerror}", "give the path of a log") from None
        self._check_magic()
        self._scan()
        self._report_damage()
        self._series = self._group()
        self._discover()
        self._source, self.time_reason, self.absolute = self._clock()
        self.fields: Sequence[Field] = [
            Field(
                s.topic, p, leaf.label, s.group, leaf.unit, leaf.unit_from, s.name, s.encoding
            )
            for s in self._series
            for p, leaf in s.leaves.items()
        ]  # fmt: skip
        self.stated["time"] = self.time_reason

    # ------------------------------------------------------------------ walking the file

    def _check_magic(self) -> None:
        size = self._file.size
        magic = self._file.read(0, min(size, len(MAGIC)))
        if magic != MAGIC:
            what = "file is empty" if not size else "not an MCAP file (wrong magic bytes)"
            raise UserError(f"{self.path}: byte 0: {what}", "give a CSV or MCAP log")

    def _outer(self) -> Iterator[tuple[int, int, int]]:
        """Opcode, offset and content length of the records outside chunks, up to the footer."""
        at, size = len(MAGIC), self._file.size
        while True:
            if size - at < _HEADER.size:
                raise DamageError(at, "file ends without a footer")
            opcode, length = self._file.head(at)
            if opcode == 0:
                raise DamageError(at, "a record of kind 0, which does not exist")
            if length > size - at - _HEADER.size:
                left = size - at - _HEADER.size
                raise DamageError(at, f"a record says it has {length} bytes where {left} are left")
            if length > self._options.max_record and opcode not in _NOT_LOADED:
                limit = self._options.max_record
                raise DamageError(at, f"a record of {length} bytes, limit {limit}", _RAISE_LIMIT)
            yield opcode, at, length
            at += _HEADER.size + length
            if opcode == Opcode.FOOTER:
                return

    def _content(self, at: int, length: int) -> _Content:
        return _Content(self._file.read(at + _HEADER.size, length), at)

    def _note(self, damage: DamageError) -> None:
        self._damage.append(damage)
        if self._options.strict:
            raise self._error(damage)

    def _error(self, damage: DamageError) -> UserError:
        hint = damage.hint or "`adhesion recover` writes what is whole as a new file"
        return UserError(f"{self.path}: byte {damage.at}: {damage.what}", hint)

    def _scan(self) -> None:
        """Walks the file once, checks everything, notes where messages are."""
        walk = _Outer(self)
        try:
            for opcode, at, length in self._outer():
                try:
                    walk.record(opcode, at, length)
                except DamageError as damage:
                    self._note(damage)  # the record's own; the walk goes on behind it
            walk.finish()
        except DamageError as damage:
            walk.flush()
            self._note(damage)

    def _block(self, block: _Block) -> None:
        """Takes up the definitions in a block and counts its messages."""
        try:
            records = self._records(block)
            schemas, channels = dict(self._schemas), dict(self._channels)
            for opcode, at, length in records.others:
                content = _Content(records.data[at : at + length].tobytes(), block.at)
                self._define(opcode, content, block.at, schemas, channels)
            log = records.u64(15)
            if len(log) and log.min() < 0:
                raise DamageError(block.at, "a log time beyond the year 2262")
        except DamageError as damage:
            self._note(damage)
            return
        self._schemas, self._channels = schemas, channels
        self._blocks.append(block)
        self._unknown += records.unknown
        counts = np.bincount(records.channel)
        for channel in np.flatnonzero(counts).tolist():
            self._counts[channel] += int(counts[channel])
            if channel not in self._heads and channel in channels:
                self._keep_heads(channels[channel], records, log)
        if len(log):
            self._times = (
                min(self._times[0], int(log.min())),
                max(self._times[1], int(log.max())),
            )

    def _keep_heads(self, channel: Channel, records: _Records, log: Times) -> None:
        """Keeps the first message of a channel, of a JSON channel the first of its first block."""
        mine = records.channel == channel.id
        most = _JSON_HEADS if channel.message_encoding == "json" else 1
        rows = np.flatnonzero(mine)[:most]
        heads = []
        for start, length in zip(records.start[rows], records.u64(1)[rows], strict=True):
            self._head_bytes += int(length)
            if self._head_bytes > _HEADS:
                break
            end = start + _HEADER.size + length
            heads.append(records.data[start + _HEADER.size + _MESSAGE : end].tobytes())
        self._heads[channel.id] = int(log[rows[0]]), heads

    def _define(
        self,
        opcode: int,
        content: _Content,
        at: int,
        schemas: dict[int, Schema],
        channels: dict[int, Channel],
    ) -> None:
        """Takes up a Schema or Channel record; a second one must equal the first."""
        if opcode == Opcode.SCHEMA:
            number, name, encoding = content.number(2), content.text(), content.text()
            schema = Schema(number, content.raw(content.number(4)), encoding, name)
            if number == 0:
                raise DamageError(at, "a schema with the reserved id 0")
            if schemas.setdefault(number, schema) != schema:
                raise DamageError(at, f"schema {number} is defined a second time, differently")
        else:
            number, schema_id = content.number(2), content.number(2)
            topic, encoding = content.text(), content.text()
            channel = Channel(number, topic, encoding, content.pairs(), schema_id)
            if channels.setdefault(number, channel) != channel:
                raise DamageError(at, f"channel {number} is defined a second time, differently")

    # ------------------------------------------------------------------ reading a block

    def _records(self, block: _Block) -> _Records:
        """The records of a block, inflated, checked, and its messages found."""
        if block.chunk:
            data, size = self._inflate(block)
            hints = self._hints(block, size)
        else:
            size = block.end - block.at
            data = np.zeros(size + PADDING, np.uint8)
            data[:size] = np.frombuffer(self._file.read(block.at, size), np.uint8)
            hints = None
        return _find(data, size, hints, block)

    def _inflate(self, block: _Block) -> tuple[Bytes, int]:
        content = self._content(block.at, block.end - block.at - _HEADER.size)
        content.raw(16)  # the time range, which nothing here relies on
        size, crc, compression = content.number(8), content.number(4), content.text()
        packed = content.raw(content.number(8))
        if size > self._options.max_inflated:
            limit = self._options.max_inflated
            raise DamageError(
                block.at, f"a chunk of {size} inflated bytes, limit {limit}", _RAISE_LIMIT
            )
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
        data[size:] = 0
        self._compressions.add(compression or "none")
        return data, size

    def _hints(self, block: _Block, size: int) -> Offsets | None:
        """Where the message indexes behind a chunk say its messages are; not yet to be believed."""
        length = block.index_end - block.index_at
        if not length or length > size + (1 << 20):
            return None
        raw = self._file.read(block.index_at, length)
        found, at = [], 0
        while at < length:
            _, record = _HEADER.unpack_from(raw, at)
            at += _HEADER.size
            if record < 6:
                return None
            entries = int.from_bytes(raw[at + 2 : at + 6], "little") // 16
            if entries * 16 > record - 6:
                return None
            found.append(np.frombuffer(raw, "<i8", 2 * entries, at + 6)[1::2])
            at += record
        return np.concatenate(found) if found else None

    # ------------------------------------------------------------------ what is in it

    def _report_damage(self) -> None:
        unknown = {i: n for i, n in self._counts.items() if i not in self._channels}
        self.rows = sum(self._counts.values()) - sum(unknown.values())
        chunks = sum(block.chunk for block in self._blocks)
        if self._damage:
            first = self._damage[0]
            if not self.rows:
                raise self._error(first)
            more = f" (and {len(self._damage) - 1} more)" if len(self._damage) > 1 else ""
            kept = (
                f"{self.rows} messages in {chunks} whole chunks"
                if chunks
                else f"{self.rows} messages"
            )
            self.findings.append(
                Finding(
                    "mcap-damaged", "error",
                    f"byte {first.at}: {first.what}{more}; kept {kept}", count=len(self._damage),
                )
            )  # fmt: skip
        for channel, count in sorted(unknown.items()):
            self._tell(
                "mcap-unknown-channel", "error",
                f"messages of channel {channel}, which the file does not define", count=count,
            )  # fmt: skip
        if self._unknown:
            self._tell(
                "mcap-unknown-record", "info", "records of unknown kinds, skipped",
                count=self._unknown,
            )  # fmt: skip
        self.stated |= {
            "chunks": chunks,
            "compression": ", ".join(sorted(self._compressions)) or "none",
        }

    def _tell(
        self, code: str, severity: Severity, message: str, channel: str = "", count: int = 1,
        first_s: float | None = None,
    ) -> None:  # fmt: skip
        if self._options.strict and severity == "error":
            where = f" {channel}:" if channel else ""
            raise UserError(f"{self.path}:{where} {message}", "read without --strict to drop these")
        finding = Finding(code, severity, message, channel, count, first_s)
        if finding not in self.findings:
            self.findings.append(finding)

    def _group(self) -> list[_Series]:
        """Channels that carry one topic with one schema are one series."""
        series: dict[tuple[Any, ...], _Series] = {}
        for channel in self._channels.values():
            schema = self._schemas.get(channel.schema_id)
            key = (
                channel.topic, channel.message_encoding,
                (schema.name, schema.encoding, schema.data) if schema else channel.schema_id,
            )  # fmt: skip
            one = series.setdefault(
                key, _Series(channel.topic, channel.message_encoding, schema, channel.metadata)
            )
            one.ids.append(channel.id)
            one.rows += self._counts[channel.id]
            time, heads = self._heads.get(channel.id, (0, []))
            if not one.heads:
                one.head_time, one.heads = time, heads
            elif one.encoding == "json":
                one.heads = one.heads + heads
            if channel.schema_id and schema is None and self._counts[channel.id]:
                self._tell(
                    "mcap-unknown-schema", "error",
                    f"schema {channel.schema_id} is not defined", channel.topic,
                )  # fmt: skip
        self._heads = {}
        topics = Counter(one.topic for one in series.values())
        for one in series.values():
            if topics[one.topic] > 1:
                one.group = f"channel {one.ids[0]}"
            if len(one.ids) > 1:
                self._tell(
                    "mcap-shared-topic", "info",
                    f"{len(one.ids)} channels carry this topic; read as one series", one.topic,
                )  # fmt: skip
        return list(series.values())

    def _discover(self) -> None:
        """Finds the numbers in each series' first messages."""
        for s in self._series:
            if not s.rows:
                continue
            try:
                s.decoder = self._decoder(s)
            except UndecodableError as e:
                self._tell("mcap-bad-schema", "error", str(e), s.topic, s.rows)
                continue
            if s.decoder is None:
                kind = s.encoding + (f" with schema {s.schema.encoding}" if s.schema else "")
                self._tell(
                    "mcap-encoding", "info", f"encoding {kind!r} is not read", s.topic, s.rows
                )
                continue
            why = "first message is too large" if not s.heads else ""
            for head in s.heads:
                try:
                    tree = s.decoder.tree(head)
                except UndecodableError as e:
                    why = why or str(e)
                    continue
                if s.encoding == "json":
                    from .json_rows import merged

                    s.tree = merged(s.tree, tree)
                else:
                    s.tree = tree
            s.heads = []
            if s.tree is None:
                self._tell("mcap-bad-message", "error", why, s.topic, s.rows)
                continue
            if s.encoding == "json":
                s.decoder.know(s.tree)  # type: ignore[attr-defined]
            found, left_out = leaves(s.tree, s.decoder.unit, s.metadata)
            for leaf in found:
                s.leaves.setdefault(leaf.path, leaf)
            if left_out:
                self._tell(
                    "mcap-not-offered", "info",
                    f"too long or too deep for single series: {', '.join(left_out[:3])}",
                    s.topic, len(left_out),
                )  # fmt: skip
            if (of := stamp(s.tree)) is not None:
                s.stamp = of
                seconds, nanos = (at(s.tree, steps) for steps in of)
                s.stamp_time = int(seconds) * _SECOND + int(nanos)

    def _decoder(self, s: _Series) -> Decoder | None:
        schema = s.schema
        if s.encoding == "json":
            from .json_rows import JsonDecoder

            return JsonDecoder(schema.data if schema and schema.encoding == "jsonschema" else b"")
        if s.encoding == "protobuf" and schema and schema.encoding == "protobuf":
            from .protobuf import ProtobufDecoder

            return ProtobufDecoder(schema.name, schema.data)
        if s.encoding == "cdr" and schema and schema.encoding == "ros2msg":
            from .ros2 import Ros2Decoder

            return Ros2Decoder(schema.name, schema.data)
        return None

    # ------------------------------------------------------------------ time

    def _clock(self) -> tuple[Literal["log", "publish", "header"], str, bool]:
        """Which of a message's times is the time of its values, why, and whether since 1970."""
        first, last = self._times
        calendar = first >= _YEAR_1990
        asked = self._options.time_source
        if asked == "header":
            stamps = [s.stamp_time for s in self._series if s.stamp and s.stamp_time]
            since_1970 = bool(stamps) and min(stamps) >= _YEAR_1990
            return "header", "stamp inside the messages, as asked for", since_1970
        if asked is not None:
            return asked, f"{asked} time, as asked for", calendar
        offering = [s for s in self._series if s.leaves]
        stamped = [s for s in offering if s.stamp and s.stamp_time]
        if not stamped:
            return "log", "log time: no message carries a stamp of its own", calendar
        if len(stamped) < len(offering):
            without = next(s for s in offering if s not in stamped)
            return "log", f"log time: {without.topic} carries no stamp of its own", calendar
        stands_still = first == last and self.rows > len(stamped)
        apart = max(abs(s.stamp_time - s.head_time) for s in stamped)
        if stands_still and min(s.stamp_time for s in stamped) >= _YEAR_1990:
            return "header", "stamp inside the messages: the log time stands still", True
        if apart > _DAY:
            reason = f"log time: stamps inside the messages are {apart / 1e9:.0f} s away from it"
            return "log", reason, calendar
        reason = f"stamp inside the messages, at first {apart / 1e9:.6f} s from log time"
        return "header", reason, calendar

    # ------------------------------------------------------------------ columns

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, see Source."""
        takers: dict[int, _Taker] = {}
        for f in wanted:
            s = next((s for s in self._series if (s.topic, s.group) == (f.channel, f.group)), None)
            if s is None or f.path not in s.leaves:
                raise UserError(
                    f"{self.path}: no field {f.path!r} in {f.channel!r}",
                    "`adhesion inspect` lists the fields of a log",
                )
            if self._source == "header" and s.stamp is None:
                raise UserError(
                    f"{self.path}: {f.channel}: messages carry no stamp",
                    "state another time source, log or publish",
                )
            taker = takers.setdefault(id(s), _Taker(s))
            if f.path not in taker.paths:
                taker.paths.append(f.path)
        for taker in takers.values():
            taker.prepare(self._source)
        try:
            for block in self._blocks:
                records = self._records(block)
                for taker in takers.values():
                    taker.take(records, block)
        except DamageError as damage:  # whole when the file was opened
            raise UserError(
                f"{self.path}: byte {damage.at}: {damage.what}",
                "the file changed while it was read",
            ) from None
        by_field: dict[tuple[str, str, str], Column] = {}
        for taker in takers.values():
            if taker.rows != taker.series.rows:
                raise UserError(f"{self.path}: the file changed while it was read", "read it again")
            for p, column in zip(taker.paths, taker.columns(), strict=True):
                by_field[taker.series.topic, taker.series.group, p] = column
            self._report(taker)
        return [by_field[f.channel, f.group, f.path] for f in wanted]

    def _report(self, taker: "_Taker") -> None:
        for (code, text), found in sorted(taker.found.items()):
            self._tell(
                code, _SEVERITY[code], f"{text}; first in the block at byte {found.at}",
                taker.series.topic, found.count, (found.time - self._times[0]) / 1e9,
            )  # fmt: skip
        low, high = taker.ahead
        if low <= high and (max(-low, high) > _SECOND or high - low > _SECOND):
            self._tell(
                "clock-offset", "info",
                f"stamps inside the messages are {low / 1e9:.3f} to {high / 1e9:.3f} s ahead of "
                f"log time; {self._source} time is used",
                taker.series.topic,
            )  # fmt: skip


@dataclass(slots=True)
class _Found:
    count: int
    at: int
    time: int


class _Taker:
    """Collects the columns of one series, block by block."""

    def __init__(self, series: _Series) -> None:
        self.series, self.paths = series, list[str]()
        self.rows = 0
        self.found: dict[tuple[str, str], _Found] = {}
        self.ahead = (1 << 62, -(1 << 62))  # lowest and highest of stamp minus log time [ns]

    def prepare(self, source: Literal["log", "publish", "header"]) -> None:
        s = self.series
        self._source = source
        steps = [s.leaves[p].steps for p in self.paths]
        self._stamped = s.stamp is not None
        self._wanted = repeated(s.tree, [*steps, *(s.stamp or ())])
        self._ids = np.array(s.ids)
        self._t: Times = np.empty(s.rows, np.int64)
        self._values: Floats = np.empty((len(self.paths), s.rows))
        self._timed: Bools = np.ones(s.rows, np.bool_)

    def take(self, records: _Records, block: _Block) -> None:
        """Adds the messages of one block."""
        ids = self._ids
        mine = records.channel == ids[0] if len(ids) == 1 else np.isin(records.channel, ids)
        start = records.start[mine]
        n = len(start)
        if not n or self.rows + n > self.series.rows:
            self.rows += n  # of too many rows the caller tells
            return
        words = np.ndarray((len(records.data) - 7,), "<i8", records.data, 0, (1,))
        end = start + _HEADER.size + words[start + 1]
        log = words[start + 15]
        decoder = self.series.decoder
        assert decoder is not None
        begin = start + _HEADER.size + _MESSAGE
        values, faults = decoder.columns(records.data, begin, end, self._wanted)
        here = slice(self.rows, self.rows + n)
        self.rows += n
        k = len(self.paths)
        self._values[:, here] = values[:k]
        t = words[start + 23] if self._source == "publish" else log
        if self._stamped:
            seconds, nanos = values[k], values[k + 1]
            known = (np.abs(seconds) < 9e9) & (np.abs(nanos) < 4.3e9)  # not NaN, fits 64 bits
            known &= (seconds != 0) | (nanos != 0)
            own = np.where(known, seconds, 0).astype(np.int64) * _SECOND
            own += np.where(known, nanos, 0).astype(np.int64)
            if known.any():
                ahead = (own - log)[known]
                self.ahead = (
                    min(self.ahead[0], int(ahead.min())),
                    max(self.ahead[1], int(ahead.max())),
                )
            if self._source == "header":
                t = np.where(known, own, log)
                self._timed[here] = known
                if not known.all():
                    text = "message without a stamp of its own; its values are not used"
                    bad = [f.rows for f in faults if f.code == "mcap-bad-message"]
                    rows = np.flatnonzero(~known)
                    if len(rows := np.setdiff1d(rows, np.concatenate(bad)) if bad else rows):
                        faults.append(Fault("mcap-no-stamp", text, rows))
        self._t[here] = t
        for fault in faults:
            found = self.found.setdefault(
                (fault.code, fault.text), _Found(0, block.at, int(log[fault.rows[0]]))
            )
            found.count += len(fault.rows)

    def columns(self) -> list[Column]:
        """One column per path, all with the same time array."""
        return [Column(self._t, v, np.isfinite(v) & self._timed) for v in self._values]


class _Outer:
    """What the records outside chunks mean, one after the other."""

    def __init__(self, source: McapSource) -> None:
        self._source, self._file = source, source._file
        self._pending: _Block | None = None
        self._chunks: dict[int, int] = {}  # offset and length, for the chunk indexes
        self._header = False
        self._data_end = 0
        self._counts: Counter[int] = Counter()
        self._statistics: tuple[int, dict[str, int], dict[int, int]] | None = None

    def record(self, opcode: int, at: int, length: int) -> None:
        source, end = self._source, at + _HEADER.size + length
        if not self._header:
            self._header = True
            if opcode != Opcode.HEADER:
                source._note(DamageError(at, "first record is no header"))
        self._counts[opcode] += 1
        in_data = not self._data_end
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE) and in_data:
            run = self._pending
            if run is None or run.chunk or end - run.at > _RUN:
                self.flush()
                run = self._pending = _Block(at, end, False)
            run.end = end
            return
        if opcode == Opcode.MESSAGE_INDEX and in_data:
            if (chunk := self._pending) and chunk.chunk:
                chunk.index_at = chunk.index_at or at
                chunk.index_end = end
            return
        self.flush()
        if opcode == Opcode.CHUNK and in_data:
            self._pending = _Block(at, end, True)
            self._chunks[at] = end - at
        elif opcode == Opcode.DATA_END and in_data:
            self._data_end = end
            crc = source._content(at, length).number(4)
            if crc and self._file.crc(0, at) != crc:
                raise DamageError(at, "data section has another CRC than it says")
        elif opcode == Opcode.HEADER and self._counts[opcode] == 1:
            content = source._content(at, length)
            source.stated |= {"profile": content.text(), "library": content.text()}
        elif opcode == Opcode.ATTACHMENT and in_data:
            self._attachment(at, length)
        elif opcode == Opcode.METADATA and in_data:
            content = source._content(at, length)
            name = content.text()
            source.metadata[name] = source.metadata.get(name, {}) | content.pairs()
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            content = source._content(at, length)
            source._define(opcode, content, at, source._schemas, source._channels)
        elif opcode == Opcode.STATISTICS:
            self._read_statistics(at, length)
        elif opcode == Opcode.CHUNK_INDEX:
            content = source._content(at, length)
            content.raw(16)
            place, size = content.number(8), content.number(8)
            if self._chunks.get(place) != size:
                raise DamageError(at, f"an index of a chunk at byte {place} that is not there")
        elif opcode == Opcode.FOOTER:
            self._footer(at, length)
        elif opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END, Opcode.HEADER):
            raise DamageError(at, f"a record of kind {opcode} where none may be")
        elif opcode not in set(Opcode):
            source._unknown += 1

    def flush(self) -> None:
        """Hands on the block whose end was not known until now."""
        if self._pending:
            block, self._pending = self._pending, None
            self._source._block(block)

    def finish(self) -> None:
        """Compares with what the statistics say."""
        source = self._source
        if self._statistics is None or source._damage:
            return
        at, said, channels = self._statistics
        found = {
            "messages": sum(source._counts.values()),
            "chunks": self._counts[Opcode.CHUNK],
            "attachments": self._counts[Opcode.ATTACHMENT],
            "metadata records": self._counts[Opcode.METADATA],
        }
        for name, count in found.items():
            if said[name] != count:
                source._note(DamageError(at, f"statistics say {said[name]} {name}, found {count}"))
        for channel, count in channels.items():
            if source._counts[channel] != count:
                here = source._counts[channel]
                what = f"statistics say {count} messages of channel {channel}, found {here}"
                source._note(DamageError(at, what))

    def _attachment(self, at: int, length: int) -> None:
        place, end = at + _HEADER.size, at + _HEADER.size + length
        content = _Content(self._file.read(place, min(length, _PIECE)), at)
        content.raw(16)
        content.text(), content.text()
        behind = place + content.number(8) + content.place()
        if behind + 4 > end:
            raise DamageError(at, "an attachment's data does not fit into its record")
        crc = int.from_bytes(self._file.read(behind, 4), "little")
        if crc and self._file.crc(place, behind) != crc:
            raise DamageError(at, "attachment has another CRC than it says")

    def _read_statistics(self, at: int, length: int) -> None:
        content = self._source._content(at, length)
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
        content = self._source._content(at, length)
        summary, _, crc = content.number(8), content.number(8), content.number(4)
        if not self._data_end:
            self._source._note(DamageError(at, "no end of the data section before the footer"))
        start = self._data_end or summary
        if crc and self._file.crc(start, at + _HEADER.size + 16) != crc:
            self._source._note(DamageError(start, "summary has another CRC than it says"))
        behind = at + _HEADER.size + length
        if self._file.size - behind < len(MAGIC) or self._file.read(behind, len(MAGIC)) != MAGIC:
            self._source._note(DamageError(behind, "no magic bytes behind the footer"))
        elif self._file.size - behind > len(MAGIC):
            more = self._file.size - behind - len(MAGIC)
            what = f"{more} bytes behind the end of the log (two files joined?), not read"
            self._source._note(DamageError(behind + len(MAGIC), what))


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


def _find(data: Bytes, size: int, hints: Offsets | None, block: _Block) -> _Records:
    """Finds the records of a block.

    Args:
        data: the block's bytes, PADDING more behind them.
        size: how many bytes it has.
        hints: where an index says its messages are; used where they and what stands between
            them fill the block without a gap, which is what walking would find.
        block: for the words of an error.
    """
    starts = array("q")
    others: list[tuple[int, int, int]] = []
    unknown = 0
    view = data.data

    def walk(p: int, stop: int) -> None:
        nonlocal unknown
        unpack = _HEADER.unpack_from
        while p < stop:
            if stop - p < _HEADER.size:
                raise wrong(p, "ends in the middle of a record")
            opcode, length = unpack(view, p)
            if length > stop - p - _HEADER.size:
                raise wrong(p, f"a record says it has {length} bytes, more than are left")
            if opcode == Opcode.MESSAGE:
                if length < _MESSAGE:
                    raise wrong(p, f"a message record of {length} bytes")
                starts.append(p)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                others.append((opcode, p + _HEADER.size, length))
            elif opcode <= Opcode.DATA_END:
                raise wrong(p, f"a record of kind {opcode} where none may be")
            else:
                unknown += 1
            p += _HEADER.size + length

    def wrong(p: int, what: str) -> DamageError:
        if block.chunk:
            return DamageError(block.at, f"chunk, at its inflated byte {p}: {what}")
        return DamageError(block.at + p, what)

    start = None
    if hints is not None and len(hints):
        start = _tiling(data, size, np.sort(hints))
    if start is not None:
        ends = start + _HEADER.size + _u64(data, start + 1)
        stops = np.append(start, size)
        ends = np.insert(ends, 0, 0)
        try:
            for i in np.flatnonzero(ends != stops).tolist():
                walk(int(ends[i]), int(stops[i]))
            if starts:
                start = np.sort(np.append(start, np.frombuffer(starts, np.int64)))
        except DamageError:
            start, starts, others, unknown = None, array("q"), [], 0
    if start is None:
        walk(0, size)
        start = np.frombuffer(starts, np.int64) if starts else np.empty(0, np.int64)
    channel = data[start + 9].astype(np.int64) | (data[start + 10].astype(np.int64) << 8)
    return _Records(data, start, channel, others, unknown)


def _u64(data: Bytes, offsets: Offsets) -> Offsets:
    view: Offsets = np.ndarray((len(data) - 7,), "<i8", data, 0, (1,))
    return view[offsets]


def _tiling(data: Bytes, size: int, hints: Offsets) -> Offsets | None:
    """The hints, if there are message records at all of them that do not overlap."""
    if hints[0] < 0 or hints[-1] > size - _HEADER.size - _MESSAGE:
        return None
    length = _u64(data, hints + 1)
    if (data[hints] != Opcode.MESSAGE).any() or ((length < _MESSAGE) | (length > size)).any():
        return None
    ends = hints + _HEADER.size + length
    if (ends[:-1] > hints[1:]).any() or ends[-1] > size:
        return None
    return hints
