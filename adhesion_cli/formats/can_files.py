"""What is wrong with CAN logs, which python-can passes over without a word.

It takes lines that it cannot read for comments, or stops at them. It stops at damaged parts of a
BLF file, and unpacks without a limit.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .prefix import Prefix

_MOST_UNPACKED = 1 << 27  # bytes of one container of a BLF file
_CONTAINER = 10  # type of an object that holds others
_LOSS_OBJECTS = {2: "errors", 3: "errors", 125: "lost"}  # other objects: error, overload, data lost
_FRAME = re.compile(  # a line of an ASC log that should hold a frame
    r"\s*\d+\.\d+\s+(CANFD\s+)?\d+\s+(?!Statistic|J1939|Overload|Status)"
    r"|.*[\0-\x08\x0e-\x1f\ufffd]"
)
_TRC_STATE = {"ST", "EC", "EV", "Warng", "Event"}  # lines of a TRC log that are no frames
_TRC_ERROR = {"ER", "Error"}
_BEGIN = re.compile(r"(?i)begin trigger ?block\s+\w+\s+(.+)")
_END_OF_BLOCK = re.compile(r"(?i)\s*end trigger ?block")
_RESUMED = "no internal events logged\n"  # ends the head of an ASC log; a TRC log passes over it


@dataclass(slots=True)
class Problems:
    """What is wrong with a log."""

    damage: str = ""
    lines: list[int] = field(default_factory=list)  # that hold a frame which cannot be read
    example: str = ""  # the first of them
    errors: list[float] = field(default_factory=list)  # times of error frames, after the start [s]
    loss_times: list[float] = field(
        default_factory=list
    )  # times at which the logger notes a loss [s]
    reader: Any = None  # of a text log
    version: str = ""  # of a TRC log
    begin: str = ""  # date and time at which the frames of an ASC log begin


def checked_lines(path: Path, make: Any, problems: Problems) -> Iterator[Any]:
    """The frames of a text log. A line that cannot be read costs only itself.

    Args:
        path: the log.
        make: class of its reader.
        problems: takes what is wrong, and the reader.
    """
    lines = _Lines(path, make.__name__ == "TRCReader", problems)
    reader = problems.reader = make(lines)
    while not lines.ended:
        try:
            for message in reader:
                frame = not (message.is_remote_frame or message.is_error_frame)
                if frame and len(message.data) < message.dlc:
                    continue  # its line counts as one without a frame
                lines.used = True
                yield message
        except (ValueError, IndexError, TypeError, KeyError):
            lines.resume()


class _Lines:
    """The lines of a log, as a file that python-can reads; notes which of them held no frame."""

    def __init__(self, path: Path, trc: bool, problems: Problems) -> None:
        self._file = path.open(encoding="utf-8", errors="replace", newline=None)
        self._trc, self._problems = trc, problems
        self._number, self._line, self._resumed = 0, "", False
        self.used, self.ended, self._closed = True, False, False

    def read(self, size: int = -1) -> str:
        return self._file.read(size)

    def write(self, _: str) -> int:
        raise OSError  # python-can asks only whether it could

    def close(self) -> None:
        self._file.close()

    def __iter__(self) -> "_Lines":
        return self

    def __next__(self) -> str:
        if self._resumed:
            self._resumed = False
            return "" if self._trc else _RESUMED
        self._judge()
        self._line = self._file.readline(1 << 16) if not self.ended else ""
        if not self._line or not (self._line.endswith("\n") or _END_OF_BLOCK.match(self._line)):
            self._at_end()
            raise StopIteration
        self._number += 1
        self.used = False
        self._closed |= _END_OF_BLOCK.match(self._line) is not None
        if self._trc and self._line.startswith(";$FILEVERSION"):
            self._problems.version = self._line.partition("=")[2].strip()
        if not self._problems.begin and (begin := _BEGIN.match(self._line)):
            self._problems.begin = begin[1].strip()
        return self._line

    def _at_end(self) -> None:
        """Notes a last line that is cut off, and an end mark that is missing."""
        self.ended = True
        if self._line:  # a digit of its last byte may be missing
            self._skip(self._number + 1)
        elif self._problems.begin and not self._closed:
            self._problems.damage = f"line {self._number}: the file ends without its end mark"

    def resume(self) -> None:
        """The reader begins anew behind a line that it could not read: first with a head."""
        self._resumed = True

    def _judge(self) -> None:
        """Notes the last line where it should have held a frame and did not."""
        line = self._line.strip()
        if self.used or not line:
            return
        self.used = True
        if self._trc:
            tokens = set(line.split()[:6])
            if line.startswith(";") or tokens & _TRC_STATE:
                return
            if tokens & _TRC_ERROR:
                self._problems.errors.append(_trc_time(line))
                return
        elif not _FRAME.match(line):
            return
        self._skip(self._number)

    def _skip(self, number: int) -> None:
        """Notes the last line as one that is left out."""
        self._problems.lines.append(number)
        self._problems.example = self._problems.example or repr(self._line.strip()[:40])


def _trc_time(line: str) -> float:
    """The time in a line of a TRC log [s]."""
    try:
        return float(line.split()[1]) / 1000
    except (ValueError, IndexError):
        return 0.0


def blf_prefix(path: Path, problems: Problems) -> Prefix:
    """The first bytes of a BLF file whose containers are whole, as a file.

    Notes what is wrong behind them, and the errors and losses that the logger notes.
    """
    size = path.stat().st_size
    offset, tail = 144, b""
    with path.open("rb") as file:
        head = file.read(144)
        if len(head) == 144:
            offset = struct.unpack_from("<L", head, 4)[0]
        while offset < size:
            file.seek(offset)
            start = file.read(32)
            length = struct.unpack_from("<L", start, 8)[0] if len(start) >= 16 else 0
            if not start.startswith(b"LOBJ") or length < 16:
                problems.damage = f"byte {offset}: no object begins there"
                break
            if offset + length > size:
                problems.damage = f"byte {offset}: the file ends inside an object"
                break
            if struct.unpack_from("<L", start, 12)[0] == _CONTAINER:
                file.seek(offset + 32)
                method, unpacked = struct.unpack_from("<H6xL", start, 16)
                data = _unpacked(file.read(length - 32), method, unpacked)
                if data is None:
                    problems.damage = f"byte {offset}: compressed frames do not unpack"
                    break
                remainder = _noted(tail + data, problems)
                tail = remainder or b""
                if remainder is None:
                    problems.damage = f"byte {offset}: no object begins where one should"
                    offset += length + length % 4  # what is before it is read
                    break
            offset += length + length % 4
    if tail and not problems.damage:
        problems.damage = f"byte {min(offset, size)}: the last frame is cut off"
    return Prefix(path, min(offset, size))


def _unpacked(data: bytes, method: int, size: int) -> bytes | None:
    """The content of a container, None where it is damaged."""
    if method == 0:
        return data
    if method != 2 or size > _MOST_UNPACKED:
        return None
    unpack = zlib.decompressobj()
    try:
        content = unpack.decompress(data, size + 1)
    except zlib.error:
        return None
    return content if unpack.eof and len(content) == size else None


def _noted(data: bytes, problems: Problems) -> bytes | None:
    """Notes errors and losses among objects; the rest that is not whole, None for no object."""
    offset = 0
    while True:
        object_start = data.find(b"LOBJ", offset, offset + 8)
        if object_start < 0:
            return data[offset:] if offset + 8 > len(data) else None
        if object_start + 32 > len(data):
            return data[object_start:]
        length, kind = struct.unpack_from("<LL", data, object_start + 8)
        if length < 16:
            return None
        if object_start + length > len(data):
            return data[object_start:]
        if kind in _LOSS_OBJECTS:
            flags, stamp = struct.unpack_from("<L4xQ", data, object_start + 16)
            times = problems.errors if _LOSS_OBJECTS[kind] == "errors" else problems.loss_times
            times.append(stamp * (1e-5 if flags == 1 else 1e-9))
        offset = object_start + length
