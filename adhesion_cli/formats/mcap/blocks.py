"""Where messages stand in a file: chunks, and runs of records outside chunks."""

import zlib
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

from ..source import ReadOptions
from .messages import PADDING, PER_RECORD, Bytes, Offsets, Records, Search, u64
from .records import HEADER, PIECE, RAISE_LIMIT, DamageError, LogFile

_RUN = 4 << 20  # bytes of unchunked records taken together
_CHUNK_LEAST = 60  # more than the fields of a chunk before its records have
_UNUSUAL = 1000  # times a file's size that its chunks may inflate to, besides max_inflated


@dataclass(slots=True)
class Block:
    """A chunk, or a run of records outside chunks."""

    at: int
    end: int
    chunk: bool
    rows: int = 0  # messages
    checked: bool = False  # by a CRC
    index_end: int = 0  # of the message indexes after a chunk


class BlockReader:
    """Reads the records of blocks.

    Args:
        file: the file.
        options: limits.
        first: whether this is the first walk over the file, which limits inflated bytes in all.
    """

    def __init__(self, file: LogFile, options: ReadOptions, first: bool) -> None:
        self._file, self._options, self._first = file, options, first
        self._inflated = 0  # bytes, all chunks together
        self.found = 0  # records
        self.compressions: set[str] = set()

    def records(self, block: Block) -> Records:
        """The records of a block, inflated, checked, and its messages found.

        Raises:
            DamageError: where the block is not whole.
        """
        if not block.chunk:
            search = self._search(self._padded(block.at, block.end), block.end - block.at, block.at)
            return search.walked()[0]
        data, size = self._inflate(block)
        hints = self._hints(block, size)
        if hints is not None and (records := self._search(data, size, block.at).indexed(hints)):
            return records
        records, end = self._search(data, size, block.at).walked()
        if end < size:
            what = f"chunk, at its inflated byte {end}: no whole record that may stand there"
            raise DamageError(block.at, what)
        return records

    def run(self, at: int, length: int) -> tuple[Block, Records]:
        """The records outside chunks from an offset on, as many as are taken together.

        Args:
            at: where the first of them begins.
            length: of the first one, without its header.

        Raises:
            DamageError: where the first record may not stand there.
        """
        size = max(min(_RUN, self._file.size - at), HEADER.size + length)
        records, end = self._search(self._padded(at, at + size), size, at).walked()
        if not end:
            raise DamageError(at, "no whole message, schema or channel")
        return Block(at, at + end, False), records

    def next_chunk(self, at: int) -> Block | None:
        """The first whole chunk from an offset on."""
        while (size := min(PIECE, self._file.size - at)) > _CHUNK_LEAST:
            window = np.frombuffer(self._file.read(at, size), np.uint8)
            found = np.flatnonzero(window[:-_CHUNK_LEAST] == Opcode.CHUNK)
            length, name = u64(window, found + 1), u64(window, found + 37) & 0xFFFFFFFF
            known = name <= max(map(len, _INFLATE))
            packed = u64(window, np.where(known, found + 41 + name, 0))
            known &= (packed >= 0) & (packed <= length - 40 - name) & (length < self._file.size)
            for place, content in zip(found[known].tolist(), length[known].tolist(), strict=True):
                block = Block(at + place, at + place + HEADER.size + content, True)
                try:
                    self._file.head(block.at)
                    self.records(block)
                except DamageError:
                    continue
                return block
            at += size - _CHUNK_LEAST
        return None

    def _search(self, data: Bytes, size: int, at: int) -> Search:
        most = self._file.size + self._options.max_inflated // PER_RECORD
        return Search(data, size, at, most if self._first else 1 << 62, self.found)

    def _padded(self, at: int, end: int) -> Bytes:
        data = np.zeros(end - at + PADDING, np.uint8)
        data[: end - at] = np.frombuffer(self._file.read(at, end - at), np.uint8)
        return data

    def _bound(self, at: int, size: int) -> None:
        """Refuses a chunk that says it inflates to more than is allowed."""
        limit = self._options.max_inflated
        if size > limit:
            hint = RAISE_LIMIT.format("max_inflated", size)
            raise DamageError(at, f"a chunk of {size} inflated bytes, limit {limit}", hint)
        limit += _UNUSUAL * self._file.size
        total = self._inflated + size
        if self._first and total > limit:
            hint = RAISE_LIMIT.format("max_inflated", total)
            what = f"chunks of {total} inflated bytes in all, limit {limit} for such a file"
            raise DamageError(at, what, hint)
        self._inflated = total

    def _inflate(self, block: Block) -> tuple[Bytes, int]:
        """The bytes in a chunk with PADDING more, and how many they are."""
        content = self._file.content(block.at, block.end - block.at - HEADER.size)
        content.read(16)  # the time range, which nothing here relies on
        size, crc = content.read8(), content.read4()
        compression = content.read_prefixed_string()
        packed = content.read(content.read8())
        self._bound(block.at, size)
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

    def _hints(self, block: Block, size: int) -> Offsets | None:
        """Where the message indexes after a chunk say its messages are; not yet to be believed."""
        length = block.index_end - block.end
        if not 0 < length <= size + (1 << 20):
            return None
        raw = self._file.read(block.end, length)
        found, at = [], 0
        while at < length:
            _, record = HEADER.unpack_from(raw, at)
            at += HEADER.size
            entries = int.from_bytes(raw[at + 2 : at + 6], "little") // 16
            if entries * 16 > record - 6:
                return None
            found.append(np.frombuffer(raw, "<i8", 2 * entries, at + 6)[1::2])
            at += record
        return np.concatenate(found)


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
        more = frame.decompress(packed, max_length=min(len(into) - found, PIECE))
        if not more:
            break
        into[found : found + len(more)] = more
        found, packed = found + len(more), b""
    return found


_INFLATE = {"": _inflate_none, "zstd": _inflate_zstd, "lz4": _inflate_lz4}
