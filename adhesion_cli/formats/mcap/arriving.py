"""Whole records of an MCAP to which another program appends, as small logs of their own."""

import copy
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, Schema

from ...core.errors import UserError
from ...core.finding import Finding
from ...core.model import Column
from ..source import Field, ReadOptions
from .reader import McapSource
from .records import HEADER, MAGIC, RAISE_LIMIT, DamageError, LogFile, written
from .series import Owners

_PIECE_SIZE = 1 << 23  # bytes that are taken at once, and one record more
_KEPT_OPCODES = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE)
_HAS_MESSAGES = (Opcode.CHUNK, Opcode.MESSAGE)
_END_OPCODES = (Opcode.DATA_END, Opcode.FOOTER)


class ArrivingMcap:
    """An MCAP that grows.

    Each part that was appended is read as a log of its own, with all schemas and channels that were
    defined before it: so it is checked and decoded as every other log is.

    Attributes:
        ended: whether the file is complete.
        lost: what could not be read, and that another file took its place; whoever reads it may
            empty it.

    Raises:
        UserError: where there is no such file.
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        self._limit = options.max_record
        self.lost = list[Finding]()
        self._id: tuple[int, int] | None = None
        self._fields: dict[tuple[str, str, str], Field] = {}
        self._restart()
        with LogFile(path, self._limit):
            pass

    def _restart(self) -> None:
        self._offset, self.ended = len(MAGIC), False
        self._header, self._defined = b"", list[Schema | Channel]()
        self._owners: Owners = {}
        self._raw, self._has_messages, self._raw_start = bytearray(), False, self._offset

    def head(self) -> McapSource:
        """The log up to now, with its fields."""
        source = self._source(self._raw)
        self._fields = _by_name(source.fields)
        return source

    def columns(
        self, wanted: Sequence[Field], add_source: Callable[[McapSource], None]
    ) -> dict[int, Column]:
        """What has arrived of these fields since the last call, by their places.

        `add_source` is called with every field where new ones came; it may add to `wanted`.
        """
        if not self.arrived():
            return {}
        raw, start = self._raw, self._raw_start
        self._raw, self._has_messages, self._raw_start = bytearray(), False, self._offset
        try:
            source = self._source(raw)
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
            self.lost.append(Finding("mcap-damaged", "error", count=1, values=values, names=names))
            return {}
        if requested and self._options.time_source is None:  # one clock for all parts
            self._options = replace(self._options, time_source=source.clock)
        for f in (f for f in source.findings if f.severity != "info"):
            # the bytes of a part are not those of the file: where it begins
            place = {"byte": start} if "byte" in f.values else {}
            self.lost.append(replace(f, values={**f.values, **place}))
        return column_of

    def _source(self, raw: bytearray) -> McapSource:
        preamble = MAGIC + self._header + written(*self._defined)
        content = preamble + raw + written(DataEnd(0), Footer(0, 0, 0)) + MAGIC
        options = replace(self._options, strict=False)
        source = McapSource(self._path, options, content, self._owners)
        self._owners = source.owners
        source.texts = []  # what arrives are numbers
        self._defined = [*source.walk.schemas.values(), *source.walk.channels.values()]
        return source

    def arrived(self) -> bool:
        """Reads whole records on, if there are not many yet; whether there are new messages."""
        try:
            file = LogFile(self._path, self._limit)
        except UserError:
            return self._has_messages  # it may come again
        with file, suppress(DamageError):  # where it becomes shorter, it is another one next time
            # the file was cut, or another one has its name
            if self._id is not None and (self._id != file.id or file.size < self._offset):
                self.lost.append(Finding("source-restarted", "info", count=1))
                self._restart()
            self._id = file.id
            while len(self._raw) < _PIECE_SIZE and self._read_record(file):
                pass
        return self._has_messages

    def _read_record(self, file: LogFile) -> bool:
        """Reads the next record; False at the end, and where the record is not whole yet."""
        if file.size < self._offset + HEADER.size:
            return False
        opcode, length = HEADER.unpack(file.read(self._offset, HEADER.size))
        self.ended = opcode in _END_OPCODES
        if self.ended or not opcode:  # the latter is room that was made
            return False
        if length > self._limit and opcode != Opcode.ATTACHMENT:
            text = f"{self._path}: byte {self._offset}: a record of {length} bytes"
            hint = RAISE_LIMIT.format("max_record", length)
            raise UserError(f"{text}, limit {self._limit}", hint)
        stop = self._offset + HEADER.size + length
        if stop > file.size:
            return False
        if opcode == Opcode.HEADER:
            self._header = file.read(self._offset, stop - self._offset)
        elif opcode in _KEPT_OPCODES:
            self._raw += file.read(self._offset, stop - self._offset)
            self._has_messages |= opcode in _HAS_MESSAGES
        self._offset = stop
        return True


def _by_name(fields: Iterable[Field]) -> dict[tuple[str, str, str], Field]:
    return {(f.channel, f.group, f.path): f for f in fields}
