"""An MCAP file around its messages: chunks, indexes, statistics and summary, every CRC on.

The records are the mcap package's own, their order and what they say of the file stand here.
Specification: https://mcap.dev/spec
"""

import struct
import zlib
from collections import Counter
from collections.abc import Collection, Mapping
from typing import BinaryIO

import numpy as np
import zstandard
from mcap import records
from mcap.opcode import Opcode
from numpy.typing import NDArray

from ..formats.mcap.records import MAGIC, written

Offsets = NDArray[np.int64]
# A chunk before it has a place in a file; log times [ns] and offsets of each channel's messages.
Packed = tuple[records.Chunk, Mapping[int, Offsets]]  # (n, 2)


def packed(messages: bytes, index: Mapping[int, Offsets], level: int = 3) -> Packed:
    """Compresses messages, in any thread; `index` has times [ns] and offsets by channel, (n, 2)."""
    return records.Chunk(
        compression="zstd",
        data=zstandard.ZstdCompressor(level=level).compress(messages),
        message_start_time=int(min(entries[:, 0].min() for entries in index.values())),
        message_end_time=int(max(entries[:, 0].max() for entries in index.values())),
        uncompressed_crc=zlib.crc32(messages),
        uncompressed_size=len(messages),
    ), index


class Container:
    """A file that is written front to back: definitions before the chunks that use them."""

    def __init__(self, file: BinaryIO, library: str) -> None:
        self._file, self._offset, self._crc = file, 0, 0
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._chunks = bytearray()  # their indexes as written: as objects they take ten times that
        self._chunk_count, self._times = 0, (0, 0)
        self._metadata: list[records.MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._append(MAGIC)
        self._append(written(records.Header("", library)))

    def define(
        self, schemas: Collection[records.Schema], channels: Collection[records.Channel]
    ) -> None:
        """Adds definitions."""
        self._append(written(*schemas, *channels))
        self._schemas += schemas
        self._channels += channels

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Adds named texts."""
        offset, length = self._append(written(records.Metadata(name=name, metadata=entries)))
        self._metadata.append(records.MetadataIndex(offset, length, name))

    def chunk(self, packed: Packed) -> None:
        """Adds a chunk of messages."""
        chunk, index = packed
        start, length = self._append(written(chunk))
        places = {}
        for channel, entries in index.items():
            self._counts[channel] += len(entries)
            raw = entries.astype("<u8").tobytes()
            head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(raw), channel, len(raw))
            places[channel], _ = self._append(head + raw)
        times = chunk.message_start_time, chunk.message_end_time
        channel_times = self._times if self._chunk_count else times
        self._times = min(channel_times[0], times[0]), max(channel_times[1], times[1])
        self._chunk_count += 1
        self._chunks += written(
            records.ChunkIndex(
                chunk_start_offset=start,
                chunk_length=length,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_start_time=times[0],
                message_end_time=times[1],
                message_index_length=self._offset - start - length,
                message_index_offsets=places,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def finish(self) -> None:
        """Adds the summary and the end."""
        self._append(written(records.DataEnd(self._crc)))
        statistics = records.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(sorted(self._counts.items())),
            chunk_count=self._chunk_count,
            message_count=self._counts.total(),
            message_start_time=self._times[0],
            message_end_time=self._times[1],
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups = {
            Opcode.SCHEMA: written(*self._schemas),
            Opcode.CHANNEL: written(*self._channels),
            Opcode.STATISTICS: written(statistics),
            Opcode.CHUNK_INDEX: bytes(self._chunks),
            Opcode.METADATA_INDEX: written(*self._metadata),
        }
        start, summary, offsets = self._offset, b"", []
        for opcode, group in groups.items():
            if group:
                offsets.append(records.SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        footer = records.Footer(start, start + len(summary), 0)
        summary += written(*offsets)
        footer.summary_crc = zlib.crc32(summary + written(footer)[:-4])
        self._append(summary + written(footer) + MAGIC)

    def _append(self, data: bytes) -> tuple[int, int]:
        """Writes; returns where it went, as (offset, length)."""
        offset = self._offset
        self._file.write(data)
        self._crc = zlib.crc32(data, self._crc)
        self._offset += len(data)
        return offset, len(data)
