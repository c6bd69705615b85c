"""CAN frames, what is wrong with a log of them, and BLF logs.

The objects of BLF are walked here, so that each is counted. What is no frame, as a marker of the
user, is passed over by its length. A damaged container ends the log; a damaged object costs itself.
"""

import struct
import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

_MOST_UNPACKED = 1 << 27  # bytes of one container
_CONTAINER = 10  # type of an object that holds others
_ERRORS = (2, 3, 73)  # types of objects: error frames and overload frames
_LOSS = 125  # type of an object: the logger lost frames
_CLASSIC, _FD, _FD_64 = (1, 86), 100, 101  # types of frames
_PADDING = 8  # bytes at most between two objects; how many, depends on their types


class Frame(NamedTuple):
    """One frame of a log."""

    t: float  # after the start of the log [s]
    bus: int  # from 0
    identifier: int  # -1 where the log names the message
    extended: bool = False
    data: bytes = b""
    kind: str = "data"  # or "remote", "error"; "event" of a line with a time and no frame
    name: str = ""  # of the message, where the log has no number


@dataclass(slots=True)
class Problems:
    """What is wrong with a log."""

    damage: str = ""
    lines: list[int] = field(default_factory=list)  # that hold a frame which cannot be read
    example: str = ""  # the first of them
    errors: list[float] = field(default_factory=list)  # times of error frames, after the start [s]
    has_steps: bool = False  # whether times count from the line before
    losses: list[float] = field(default_factory=list)  # times at which the logger notes a loss [s]

    def note(self, damage: str) -> None:
        """Notes damage; the first is the one that people are shown."""
        self.damage = self.damage or damage


def blf_frames(path: Path, problems: Problems) -> Iterator[Frame]:
    """The frames of a BLF log, in its order."""
    size, tail = path.stat().st_size, b""
    with path.open("rb") as file:
        offset = struct.unpack("<4xL", file.read(8))[0]
        while offset < size:
            file.seek(offset)
            start = file.read(16 + _PADDING)
            padding = start.find(b"LOBJ", 0, _PADDING)
            if len(start) <= _PADDING and not start.strip(b"\0"):
                break
            if padding < 0 or len(start) < padding + 16:
                problems.note(f"byte {offset}: no object begins there")
                return
            offset += padding
            length, kind = struct.unpack_from("<LL", start, padding + 8)
            if length < 16 or offset + length > size:
                problems.note(f"byte {offset}: the file ends inside an object")
                return
            file.seek(offset)
            data: bytes | None = file.read(length)
            if kind == _CONTAINER:
                data = _unpacked(data or b"")
            if data is None:
                problems.note(f"byte {offset}: compressed frames do not unpack")
                return
            tail = yield from _frames(tail + data, offset, problems)
            offset += length
    if tail.strip(b"\0"):
        problems.note(f"byte {size}: the last frame is cut off")


def _unpacked(container: bytes) -> bytes | None:
    """The content of a container, None where it is damaged."""
    if len(container) < 32:
        return None
    method, size = struct.unpack_from("<H6xL", container, 16)
    if method == 0:
        return container[32:]
    if method != 2 or size > _MOST_UNPACKED:
        return None
    unpack = zlib.decompressobj()
    try:
        content = unpack.decompress(container[32:], size + 1)
    except zlib.error:
        return None
    return content if unpack.eof and len(content) == size else None


def _frames(data: bytes, place: int, problems: Problems) -> Generator[Frame, None, bytes]:
    """The frames among objects; returns the rest. One after a wrong length is looked for."""
    offset = 0
    while (begin := data.find(b"LOBJ", offset)) >= 0:
        if begin + 32 > len(data):
            return data[begin:]
        header, length, kind = struct.unpack_from("<HxxLL", data, begin + 4)
        if begin - offset > _PADDING or not 32 <= header <= length:
            problems.note(f"byte {place}: no object begins where one should")
        if not 32 <= header <= length:
            offset = begin + 4
            continue
        if begin + length > len(data):
            return data[begin:]
        flags, stamp = struct.unpack_from("<L4xQ", data, begin + 16)
        t = stamp * (1e-5 if flags == 1 else 1e-9)
        if kind == _LOSS:
            problems.losses.append(t)
        try:
            if frame := _frame(data[begin + header : begin + length], kind, t):
                yield frame
        except struct.error:
            problems.note(f"byte {place}: an object of type {kind} is too short")
        offset = begin + length
    if len(data) - offset > _PADDING:
        problems.note(f"byte {place}: no object begins where one should")
    return data[max(offset, len(data) - 3) :]  # the next name of an object may begin there


def _frame(body: bytes, kind: int, t: float) -> Frame | None:
    """The frame that an object holds, None where it holds none."""
    if kind in _ERRORS:
        return Frame(t, 0, 0, kind="error")
    if kind in _CLASSIC:
        channel, flags, size, identifier, data = struct.unpack_from("<HBBL8s", body)
        is_remote = flags & 0x80
    elif kind == _FD:
        channel, flags, identifier, size, data = struct.unpack_from("<HBxL6xB5x64s", body)
        is_remote = flags & 0x80
    elif kind == _FD_64:
        channel, size, identifier, flags, extra = struct.unpack_from("<BxBxL4xL19xB4x", body)
        is_remote = flags & 0x10
        # Where data of another kind follow, they are no bytes of the frame.
        data = body[40 : max(extra - 32, 40) if extra else None].ljust(size, b"\0")
    else:
        return None
    number, is_extended = identifier & 0x1FFFFFFF, bool(identifier & 0x80000000)
    frame_kind = "remote" if is_remote else "data"
    return Frame(t, channel - 1, number, is_extended, data[:size], frame_kind)
