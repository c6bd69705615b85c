"""Whole records of an MCAP to which another program appends, as small logs of their own."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, Schema

from ...core.errors import UserError
from ...core.finding import Finding
from ...core.model import Column
from ..source import Field, ReadOptions
from .reader import McapSource
from .records import HEADER, MAGIC, RAISE_LIMIT, LogFile

_MOST = 1 << 23  # bytes that are read at once, and one record more
_KEPT = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE)
_HAS_MESSAGES = (Opcode.CHUNK, Opcode.MESSAGE)
_ENDS = (Opcode.DATA_END, Opcode.FOOTER)


class Arriving:
    """An MCAP that grows.

    Each part that was appended is read as a log of its own, with all schemas and channels that were
    defined before it: so it is checked and decoded as every other log is.

    Args:
        path: the file.
        options: how to read it.

    Attributes:
        ended: whether the file is complete.
        restarts: how often another file took its place.
        lost: what could not be read; whoever reads it may empty it.

    Raises:
        UserError: where there is no such file.
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        self._limit = options.max_record
        self.restarts, self.lost = 0, list[Finding]()
        self._id: tuple[int, int] | None = None
        self._restart()
        with LogFile(path, self._limit):
            pass

    def _restart(self) -> None:
        self._at, self.ended = 0, False
        self._header, self._defined = b"", list[Schema | Channel]()

    def head(self) -> McapSource | None:
        """The log up to now, with its fields; None before its first message."""
        _, raw, has_messages = self._whole()
        if not has_messages:
            return None
        with tempfile.TemporaryDirectory() as folder:
            source = self._source(folder, raw)
        source.path = self._path
        return source

    def columns(self, wanted: Sequence[Field]) -> dict[int, Column]:
        """What has arrived of these fields since the last call, by their places."""
        start = self._at
        after, raw, has_messages = self._whole()
        if not has_messages:
            return {}
        self._at = after
        with tempfile.TemporaryDirectory() as folder:
            try:
                source = self._source(folder, raw)
                known = {(f.channel, f.group, f.path): f for f in source.fields}
                asked = {
                    place: known[key]
                    for place, f in enumerate(wanted)
                    if (key := (f.channel, f.group, f.path)) in known
                }
                found = dict(zip(asked, source.columns(list(asked.values())), strict=True))
            except UserError as error:
                damage = error.text.rpartition(": ")[2]
                values, names = {"byte": start, "kept_messages": 0}, {"damage": damage}
                self.lost.append(
                    Finding("mcap-damaged", "error", count=1, values=values, names=names)
                )
                return {}
        if asked and self._options.time_source is None:  # one clock for all parts
            self._options = replace(self._options, time_source=source.clock)
        self.lost += (_placed(f, start) for f in source.findings if f.severity != "info")
        return found

    def _source(self, folder: str, raw: bytes) -> McapSource:
        """These records, as a log of their own."""
        path = Path(folder) / self._path.name
        before = self._header + _written(*self._defined)
        path.write_bytes(MAGIC + before + raw + _written(DataEnd(0), Footer(0, 0, 0)) + MAGIC)
        source = McapSource(path, replace(self._options, strict=False))
        self._defined = [*source.walk.schemas.values(), *source.walk.channels.values()]
        return source

    def _whole(self) -> tuple[int, bytes, bool]:
        """Where the whole records end, those with definitions or messages, whether the latter."""
        try:
            file = LogFile(self._path, self._limit)
        except UserError:
            return self._at, b"", False  # it may come again
        with file:
            self._is_another(file)
            start = self._at or len(MAGIC)
            size = min(file.size - start, _MOST)
            if (
                size >= HEADER.size
                and (first := HEADER.unpack(file.read(start, HEADER.size))[1]) > size
            ):
                size = min(HEADER.size + self._checked(first, start), file.size - start)
            data = file.read(start, max(size, 0))
        end, kept, messages = 0, [], False
        for opcode, begin, end in self._records(data, start):
            if opcode == Opcode.HEADER:
                self._header = data[begin:end]
            if opcode in _KEPT:
                kept.append(data[begin:end])
                messages |= opcode in _HAS_MESSAGES
        return start + end, b"".join(kept), messages

    def _records(self, data: bytes, start: int) -> Iterator[tuple[int, int, int]]:
        """Kind, begin and end of each whole record in some bytes of the file."""
        at = 0
        while at + HEADER.size <= len(data):
            opcode, length = HEADER.unpack_from(data, at)
            if not opcode:
                return  # room that was made for more
            if opcode in _ENDS:
                self.ended = True
                return
            end = at + HEADER.size + self._checked(length, start + at)
            if end > len(data):
                return
            yield opcode, at, end
            at = end

    def _checked(self, length: int, at: int) -> int:
        """The length of a record, if it is within the limit."""
        if length > self._limit:
            text = f"{self._path}: byte {at}: a record of {length} bytes, limit {self._limit}"
            raise UserError(text, RAISE_LIMIT.format("max_record", length))
        return length

    def _is_another(self, file: LogFile) -> None:
        """Begins anew where the file was cut, or another one has its name."""
        if self._id is not None and (self._id != file.id or file.size < self._at):
            self.restarts += 1
            self._restart()
        self._id = file.id


def _written(*records: Schema | Channel | DataEnd | Footer) -> bytes:
    builder = RecordBuilder()
    for one in records:
        one.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _placed(finding: Finding, start: int) -> Finding:
    """A finding about a part, whose bytes are not those of the file: it names where that begins."""
    if "byte" not in finding.values:
        return finding
    return replace(finding, values={**finding.values, "byte": start})
