"""The end of a file: its statistics, its footer, and where its summary begins."""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from mcap.opcode import Opcode

from .records import HEADER, MAGIC, DamageError, LogFile

_FOOTER = struct.Struct("<BQQQI8s")  # and the magic bytes after it


@dataclass(frozen=True, slots=True)
class Statistics:
    """What a file says of itself."""

    at: int
    records: dict[str, int]  # how many there are, by what they are
    messages: dict[int, int]  # by channel

    @classmethod
    def read(cls, file: LogFile, at: int, length: int) -> "Statistics":
        """Reads the record at an offset."""
        content = file.content(at, length)
        records = {"messages": content.number(8)}
        content.raw(6)  # schemas and channels: records that hide no data
        for name in ("attachments", "metadata records", "chunks"):
            records[name] = content.number(4)
        content.raw(16)
        return cls(at, records, content.counts())

    def differences(
        self, kinds: Mapping[int, int], messages: Mapping[int, int]
    ) -> Iterator[DamageError]:
        """Where a file differs from them.

        Args:
            kinds: records found, by opcode.
            messages: messages found, by channel.
        """
        found = {
            "messages": sum(messages.values()),
            "chunks": kinds.get(Opcode.CHUNK, 0),
            "attachments": kinds.get(Opcode.ATTACHMENT, 0),
            "metadata records": kinds.get(Opcode.METADATA, 0),
        }
        for name, here in found.items():
            if self.records[name] != here:
                yield DamageError(
                    self.at, f"statistics say {self.records[name]} {name}, found {here}"
                )
        for channel, count in self.messages.items():
            if (here := messages.get(channel, 0)) != count:
                what = f"statistics say {count} messages of channel {channel}, found {here}"
                yield DamageError(self.at, what)


def summary_start(file: LogFile) -> int:
    """Where the summary begins, if its CRC holds; else 0."""
    footer = file.size - _FOOTER.size
    if footer < len(MAGIC):
        return 0
    opcode, length, start, _, crc, magic = _FOOTER.unpack(file.read(footer, _FOOTER.size))
    if (opcode, length, magic) != (Opcode.FOOTER, 20, MAGIC) or not 0 < start < footer:
        return 0
    return start if file.crc(start, footer + HEADER.size + 16) == crc else 0


def footer_damage(file: LogFile, at: int, data_end: int) -> Iterator[DamageError]:
    """What is wrong with the end of a file.

    Args:
        file: the file.
        at: offset of its footer.
        data_end: where the data section ended, 0 where it did not.
    """
    content = file.content(at, 20)
    summary, _, crc = content.number(8), content.number(8), content.number(4)
    if not data_end:
        yield DamageError(at, "no end of the data section before the footer")
    start = data_end or summary
    if crc and file.crc(start, at + HEADER.size + 16) != crc:
        yield DamageError(start, "summary has another CRC than it says")
    after = at + HEADER.size + 20
    more = file.size - after - len(MAGIC)
    if more < 0 or file.read(after, len(MAGIC)) != MAGIC:
        yield DamageError(after, "no magic bytes after the footer")
    elif more:
        what = f"{more} bytes after the end, not read: cut two joined files apart there"
        yield DamageError(after + len(MAGIC), what)
