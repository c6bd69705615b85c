"""What the indexes of a file say, compared with what the walk over the file met.

A wrong index costs no message here, as the walk does not need it. Programs that seek need it.
"""

from collections.abc import Callable, Iterable

import numpy as np
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, Footer, MetadataIndex, SummaryOffset

from ...core.model import Times
from .blocks import RecordBlock, Records
from .records import Content, DamageError

Place = RecordBlock | AttachmentIndex | MetadataIndex  # where a record is: offset and length

#: Records that stand behind the data only.
OF_SUMMARY = (
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
    Opcode.STATISTICS,
    Opcode.SUMMARY_OFFSET,
)
_NAMES: dict[int, str] = {
    Opcode.CHUNK_INDEX: "chunk",
    Opcode.ATTACHMENT_INDEX: "attachment",
    Opcode.METADATA_INDEX: "metadata record",
}


class Indexes:
    """Compares the indexes of a file with what they index.

    Args:
        met: gives what an index of this kind should list; it is asked behind the data.

    Attributes:
        wrong: where they differ.
    """

    def __init__(self, met: Callable[[int], Iterable[Place]]) -> None:
        self.wrong: list[DamageError] = []
        self._met = met
        self._unlisted: dict[int, dict[int, Place]] = {}  # by kind and offset: not yet listed
        self._groups: dict[int, tuple[int, int]] = {}  # of the summary: first byte, byte behind

    def messages(self, block: RecordBlock, records: Records, log_time: Times) -> None:
        """Compares the message indexes behind a chunk with its messages; it may have none."""
        if not block.index[0]:
            return
        index, fits = records.index, False
        if index and len(index.entries) == len(records.start):
            # The offsets are those of the messages. Sums weighted by the offset are equal where
            # each has its channel and time. Sorting would cost three times as much.
            said, actual = 2 * index.entries[:, 1] + 1, 2 * records.start + 1
            channel = np.repeat(index.channels, index.counts)
            fits = np.dot(channel, said) == np.dot(records.channel, actual) and (
                np.dot(index.entries[:, 0], said) == np.dot(log_time, actual)
            )
        if not fits:
            damage = f"message indexes of the chunk at byte {block.offset} do not list its messages"
            self.wrong.append(DamageError(block.stop, damage))

    def record(self, opcode: int, offset: int, stop: int, content: Callable[[], Content]) -> None:
        """Compares a record of the summary with what the walk met.

        Args:
            opcode: its kind.
            offset: its offset.
            stop: offset behind it.
            content: reads its fields.
        """
        group_start, group_stop = self._groups.get(opcode, (offset, stop))
        self._groups[opcode] = group_start, max(group_stop, stop)
        try:
            if opcode in _NAMES:
                self._listed(opcode, offset, content())
            elif opcode == Opcode.SUMMARY_OFFSET:
                said = SummaryOffset.read(content())
                group = self._groups.get(said.group_opcode, (said.group_start, said.group_start))
                if group != (said.group_start, said.group_start + said.group_length):
                    message = f"summary offset of records of kind {said.group_opcode} is wrong"
                    raise DamageError(offset, message)
        except DamageError as damage:
            damage.__traceback__ = None
            self.wrong.append(damage)

    def _listed(self, opcode: int, position: int, content: Content) -> None:
        if opcode not in self._unlisted:
            self._unlisted[opcode] = {place.offset: place for place in self._met(opcode)}
        name, index = _NAMES[opcode], None
        if opcode == Opcode.CHUNK_INDEX:
            chunk = ChunkIndex.read(content)
            offset, length = chunk.chunk_start_offset, chunk.chunk_length
            if places := chunk.message_index_offsets:
                index = chunk.message_index_length, hash(frozenset(places.items()))
        else:
            read = AttachmentIndex if opcode == Opcode.ATTACHMENT_INDEX else MetadataIndex
            entry = read.read(content)
            offset, length = entry.offset, entry.length
        place = self._unlisted[opcode].pop(offset, None)
        if place is None:
            raise DamageError(position, f"index lists no {name}, or one again: at byte {offset}")
        if place.length != length:
            raise DamageError(position, f"index gives the {name} at byte {offset} {length} bytes")
        if index and isinstance(place, RecordBlock) and place.index != index:
            damage = f"index does not lead to the message indexes of the chunk at byte {offset}"
            raise DamageError(position, damage)

    def check_footer(self, position: int, start: int, said: Footer) -> None:
        """Compares the footer with the summary, and looks for what no index lists.

        Args:
            position: offset of the footer.
            start: where the summary begins.
            said: the footer.
        """
        offsets = self._groups.get(Opcode.SUMMARY_OFFSET, (position, position))[0]
        if said.summary_start not in (0, start):
            damage = f"summary begins at byte {start}, the footer says {said.summary_start}"
            self.wrong.append(DamageError(position, damage))
        if said.summary_offset_start not in (0, offsets):
            damage = f"summary offsets begin at byte {offsets}, "
            damage += f"the footer says {said.summary_offset_start}"
            self.wrong.append(DamageError(position, damage))
        for opcode, unlisted in self._unlisted.items():
            for offset in list(unlisted)[:1]:
                damage = f"index does not list {len(unlisted)} {_NAMES[opcode]}s, at first this one"
                self.wrong.append(DamageError(offset, damage))
