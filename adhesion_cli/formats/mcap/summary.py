"""The end of a file: its statistics, its footer, and where its summary begins."""

import struct
from collections.abc import Iterator, Mapping

from mcap.opcode import Opcode
from mcap.records import Footer, Statistics

from .records import HEADER, MAGIC, DamageError, LogFile

_FOOTER = struct.Struct("<BQQQI8s")  # and the magic bytes after it


def differences(
    said: Statistics, at: int, kinds: Mapping[int, int], messages: Mapping[int, int]
) -> Iterator[DamageError]:
    """Where a file differs from its statistics; schemas and channels hide no data.

    Args:
        said: the statistics.
        at: their offset.
        kinds: records found, by opcode.
        messages: messages found, by channel.
    """
    found = {
        "messages": (said.message_count, sum(messages.values())),
        "chunks": (said.chunk_count, kinds.get(Opcode.CHUNK, 0)),
        "attachments": (said.attachment_count, kinds.get(Opcode.ATTACHMENT, 0)),
        "metadata records": (said.metadata_count, kinds.get(Opcode.METADATA, 0)),
    }
    for channel, count in said.channel_message_counts.items():
        found[f"messages of channel {channel}"] = count, messages.get(channel, 0)
    for name, (count, here) in found.items():
        if count != here:
            yield DamageError(at, f"statistics say {count} {name}, found {here}")


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
    said = Footer.read(file.content(at, 20))
    if not data_end:
        yield DamageError(at, "no end of the data section before the footer")
    start, crc = data_end or said.summary_start, said.summary_crc
    if crc and file.crc(start, at + HEADER.size + 16) != crc:
        yield DamageError(start, "summary has another CRC than it says")
    after = at + HEADER.size + 20
    more = file.size - after - len(MAGIC)
    if more < 0 or file.read(after, len(MAGIC)) != MAGIC:
        yield DamageError(after, "no magic bytes after the footer")
    elif more:
        what = f"{more} bytes after the end, not read: cut two joined files apart there"
        yield DamageError(after + len(MAGIC), what)
