"""An MCAP log to which another program appends.

Its whole records are read a part at a time, each part as a log of its own with all schemas and
channels that were defined before it: so it is checked and decoded as every other log is.
"""

import copy
import math
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, Header, Schema

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Column
from ..formats.mcap.reader import McapSource
from ..formats.mcap.records import HEADER, MAGIC, DamageError, LogFile, written
from ..formats.mcap.series import Owners
from ..formats.source import Field, ReadOptions, Source
from .feed import PAUSE, TICK, AddSource, Feed, FeedRow, rows_of

_PART_SIZE = 1 << 23  # bytes that are taken at once, and one record more
_KEPT_OPCODES = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE)
_HAS_MESSAGES = (Opcode.CHUNK, Opcode.MESSAGE)
_LARGEST_RECORD = 1 << 30  # bytes; no recorder writes a larger one
_END_OPCODES = (Opcode.DATA_END, Opcode.FOOTER)


class GrowingMcap(Feed):
    """The messages of an MCAP, as they are appended, to its end; a UserError for no such file."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.name, self._path, self._options = str(path), path, options
        self._lost = list[Finding]()
        self._id: tuple[int, int] | None = None
        self._fields: dict[tuple[str, str, str], Field] = {}
        self._restart()
        with LogFile(path):
            pass

    def _restart(self) -> None:
        self._offset = self._part_start = len(MAGIC)
        self._part, self._has_messages, self._has_ended = bytearray(), False, False
        self._defined = list[Schema | Channel]()
        self._owners: Owners = {}

    def head(self) -> Source:
        """See `Feed`."""
        receive_time = math.inf  # when messages were first seen
        while time.monotonic() - receive_time < PAUSE and not self._has_ended:
            if self._arrived():
                receive_time = min(receive_time, time.monotonic())
            time.sleep(TICK)
        if not self._arrived():
            raise UserError(f"{self.name}: ended without a message", "check what records it")
        source = self._source(self._part)
        self._fields = _by_name(source.fields)
        return source

    def rows(self, wanted: list[Field], add_source: AddSource) -> Iterator[FeedRow | None]:
        """See `Feed`."""
        while True:
            columns = self._columns(wanted, add_source) if self._arrived() else {}
            yield from rows_of(columns)
            if not columns:
                if self._has_ended:
                    return
                yield None
                time.sleep(TICK)

    def findings(self) -> list[Finding]:
        """See `Feed`."""
        found, self._lost = self._lost, []
        return found

    def _columns(self, wanted: list[Field], add_source: AddSource) -> dict[int, Column]:
        """What the part that arrived has of these fields, by their places."""
        chunk, start = self._part, self._part_start
        self._part, self._has_messages, self._part_start = bytearray(), False, self._offset
        try:
            source = self._source(chunk)
            field_of = _by_name(source.fields)
            if field_of.keys() - self._fields.keys():
                self._fields |= field_of
                whole_source = copy.copy(source)
                whole_source.fields = list(self._fields.values())
                add_source(whole_source)
            requested = {
                place: field_of[key]
                for place, f in enumerate(wanted)
                if (key := (f.channel, f.group, f.path)) in field_of
            }
            column_of = dict(zip(requested, source.columns(list(requested.values())), strict=True))
        except UserError as error:
            cause = error.__cause__  # the text names a byte of this part
            damage = cause.what if isinstance(cause, DamageError) else error.text
            values, names = {"byte": start, "kept_messages": 0}, {"damage": damage}
            self._lost.append(Finding("mcap-damaged", "error", count=1, values=values, names=names))
            return {}
        if requested and self._options.time_source is None:  # one clock for all parts
            self._options = replace(self._options, time_source=source.clock)
        for f in (f for f in source.findings if f.severity != "info"):
            # the bytes of a part are not those of the file: where it begins
            place = {"byte": start} if "byte" in f.values else {}
            self._lost.append(replace(f, values={**f.values, **place}))
        return column_of

    def _source(self, chunk: bytearray) -> McapSource:
        preamble = MAGIC + written(Header("", ""), *self._defined)
        content = preamble + chunk + written(DataEnd(0), Footer(0, 0, 0)) + MAGIC
        source = McapSource(self._path, replace(self._options, strict=False), content, self._owners)
        self._owners = source.owners
        source.texts = []  # what arrives are numbers
        self._defined = [*source.walk.schemas.values(), *source.walk.channels.values()]
        return source

    def _arrived(self) -> bool:
        """Reads whole records on, if there are not many yet; whether there are new messages."""
        try:
            file = LogFile(self._path)
        except UserError:
            return self._has_messages  # it may come again
        with file, suppress(DamageError):  # where it becomes shorter, it is another one next time
            # the file was cut, or another one has its name
            if self._id is not None and (self._id != file.id or file.size < self._offset):
                self._lost.append(Finding("source-restarted", "info", count=1))
                self._restart()
            self._id = file.id
            while len(self._part) < _PART_SIZE and self._read_record(file):
                pass
        return self._has_messages

    def _read_record(self, file: LogFile) -> bool:
        """Reads the next record; False at the end, and where the record is not whole yet."""
        if file.size < self._offset + HEADER.size:
            return False
        opcode, length = HEADER.unpack(file.read(self._offset, HEADER.size))
        self._has_ended = opcode in _END_OPCODES
        if self._has_ended or not opcode:  # the latter is room that was made
            return False
        if length > _LARGEST_RECORD and opcode != Opcode.ATTACHMENT:  # it would never be whole
            text = f"{self._path}: byte {self._offset}: a record of {length} bytes"
            raise UserError(text, "the file is damaged: let its recorder begin a new one")
        stop = self._offset + HEADER.size + length
        if stop > file.size:
            return False
        if opcode in _KEPT_OPCODES:
            self._part += file.read(self._offset, stop - self._offset)
            self._has_messages |= opcode in _HAS_MESSAGES
        self._offset = stop
        return True


def _by_name(fields: Iterable[Field]) -> dict[tuple[str, str, str], Field]:
    return {(f.channel, f.group, f.path): f for f in fields}
