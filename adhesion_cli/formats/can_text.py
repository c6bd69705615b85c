"""Text logs of CAN frames: ASC, TRC, candump, BUSMASTER, CANHacker, CanKing and tables (CSV).

Each line is read by itself: one that should hold a frame and cannot be read costs only itself, and
is counted.
"""

import re
import statistics
from base64 import b64decode
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import chain, islice, pairwise
from pathlib import Path

from ..core.errors import UserError
from .can_blf import Frame, Problems

# Lines of logs that have a frame in each: time, bus, identifier, flags, size and bytes.
_CANDUMP = re.compile(
    r"\s*\((?P<t>[^)]+)\)\s+(?P<bus>\S+)\s+(?:[RT]X\s+\S+\s+\S+\s+)?(?P<id>[0-9A-Fa-f]{3,8})"
    r"(?:#(?P<log>\S*)|\s+\[\s*(?P<size>\d+)\]\s*(?P<data>.*))"
)
_CANHACKER = re.compile(r"(?P<t>[\d.,]+)\s+(?P<id>[0-9A-Fa-f]+)\s+(?P<size>\d+)\s*(?P<data>.*)")
_CANKING = re.compile(
    r"(?P<bus>\d+)\s+(?P<id>[0-9A-Fa-f]+)\s+(?P<flags>[A-Za-z]\S*\s+)?(?P<size>\d+)\s+"
    r"(?P<data>(?:[0-9A-Fa-f]{2}\s+)*)(?P<t>\d+[.,]\d+)\s+[RT]"
)
_FORMS = {"candump": _CANDUMP, "CANHacker": _CANHACKER, "CanKing": _CANKING}
_TABLE = {  # columns of a table of frames, by their names
    "t": r"time|(?:uhr)?zeit",
    "id": r"(?:can[ _-]?)?(?:id|identifier|arbitration_id)\b",
    "size": r"dlc\b|len(?:gth)?\b|data ?len",
    "data": r"d(?:ata)? ?[01]\b|data ?bytes|data\b(?! ?len)|daten\b",
    "bus": r"bus|ch",
}
_IN_HEAD = [rf'(?=[^\n]*(?:^|[,;\t])[ "]*(?:{x}))' for name, x in _TABLE.items() if name != "bus"]
_TABLE_HEAD = re.compile("(?im)^" + "".join(_IN_HEAD))
_DATED = re.compile(r"\d{4}-\d\d-\d\d[ T]")
_NO_FRAME = re.compile(r"\s*(?:Time\s+ID|Chn\s)")
# What the files of each program begin with; an ASC log may lack its head.
_BEGINS = {
    "BUSMASTER": rb"\*\*\*BUSMASTER",
    "TRC": rb"\s*;\$FILEVERSION",
    "CANHacker": rb"\s*Time\s+ID\s+DLC\s+Data",
    "CanKing": rb"\s*Chn\s+Identifier\s+Flg\s+DLC",
    "candump": rb"\s*\([^)]{3,40}\)\s+\w+\s+(?:[RT]X\s+\S+\s+\S+\s+)?[0-9A-Fa-f]{3,8}"
    rb"(?:#|\s+\[\s*\d+\])",
    "without time": rb"\s*\w+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]\s+[0-9A-Fa-f]{2}\s",
    "ASC": rb".{0,400}?^base\s+(?:hex|dec)\b"
    rb"|\s*-?\d+[.,]\d{3,}\s+(?:CANFD\s+)?\d+\s+\S+\s+(?:Rx|Tx|TxRq)\s",
    "table": rb"(?:[^\n]*\n){0,9}?(?i:^" + "".join(_IN_HEAD).encode() + b")",
}
BEGINS = b"(?ms:" + b"|".join(_BEGINS.values()) + b")"
_BEGIN = re.compile(r"(?i)begin trigger ?block\s+\w+\s+(.+)")
_END_OF_BLOCK = re.compile(r"(?i)\s*end trigger ?block")
_EVENTS = re.compile(r"(?i)Statistic|J1939|Overload|Status|Chip")  # lines of an ASC log: no frames
_DIRECTIONS = {"Rx", "Tx", "TxRq"}
_STATES = {"ST", "EC", "EV", "Warng", "Event"}  # lines of a TRC log that are no frames
_TRC_ERRORS = {"ER", "Error"}
_TRC_COLUMNS = {"1.0": "NOILD", "1.1": "NOTILD", "1.3": "NOBTIRLD"}  # else the file lists them
_CONTROL = re.compile(r"[\0-\x08\x0e-\x1f]")  # of bytes that were lost
_DAY = 86_400.0
_SAMPLE = 1000  # frames that show whether times are steps
_LEAST_DECIMALS = 6  # of steps: many coarser ones add up to a wrong time


class TextLog:
    """A text log of frames; `start` [s since 1970], 0 for none, is known with the first frame."""

    def __init__(self, path: Path, problems: Problems) -> None:
        self._path, self._problems = path, problems
        with path.open("rb") as file:
            head = file.read(1024)
        # Comments may be in any encoding; what frames are made of is ASCII.
        self._encoding = "utf-16" if head.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "latin-1"
        head = head.decode(self._encoding, "ignore").encode("latin-1", "replace")
        self._line_reader = self._reader(head, path.suffix.lower())
        self.start = 0.0
        self._first: float | None = None  # the first time as the log counts [s]
        self._begin, self._is_closed = "", False
        self._latest = 0.0  # what the last head states [s]
        self._base, self._columns = 16, [*_TRC_COLUMNS["1.0"]]
        self._is_hexadecimal = False  # whether bytes of a table were read as such
        self._is_base64 = False
        self._buses: list[str] = []
        self._places: dict[str, int] = {}  # of the columns of a table
        self._unit = 1.0  # of its times in a second, 0 where none is stated
        self._says_steps, self._decimals = False, 0

    def _reader(self, head: bytes, suffix: str) -> Callable[[str], Frame | None]:
        begins = (kind for kind, begin in _BEGINS.items() if re.match(b"(?ms)" + begin, head))
        kind = next(begins, suffix.removeprefix(".").upper())
        if kind == "without time":
            hint = "log them with `candump -l`, or show the time with `candump -t a`"
            raise UserError(f"{self._path}: frames of candump without time stamps", hint)
        self._form = _FORMS.get(kind)
        by_kind = {"BUSMASTER": self._busmaster, "TRC": self._trc, "table": self._table}
        return self._one_a_line if self._form else by_kind.get(kind, self._asc)

    def __iter__(self) -> Iterator[Frame]:
        """The frames; the times of some logs count from the line before, and are added.

        Raises:
            UserError: where such times are too coarse, or begin anew.
        """
        frames, t = self._frames(), 0.0
        first_frames = list(islice(frames, _SAMPLE))
        has_steps = self._has_steps(first_frames)
        if has_steps and self._decimals < _LEAST_DECIMALS:
            raise _relative(self._path)
        self._problems.has_steps = has_steps
        for frame in chain(first_frames, frames):
            t = t + frame.t + (self._first or 0.0) if has_steps else frame.t
            if frame.kind != "event":
                yield frame._replace(t=t)

    def _has_steps(self, frames: list[Frame]) -> bool:
        """Whether times count from the line before: they do not grow, and fall on each bus."""
        half, times = len(frames) // 2, [frame.t for frame in frames]
        if half < 2 or min(times[half:]) > statistics.median(times[:half]):
            return False
        by_bus = sorted(frames, key=lambda frame: frame.bus)
        falls = sum(b.t < a.t for a, b in pairwise(by_bus))
        return self._says_steps or falls > max(0.1 * len(times), 1)

    def _frames(self) -> Iterator[Frame]:
        number, line, last_time, frames = 0, "", 0.0, 0
        latest, shift = self._latest, 0.0  # of files that were joined
        with self._path.open(encoding=self._encoding, newline=None) as file:
            for number, line in enumerate(file, 1):
                if not line.endswith("\n") and not _END_OF_BLOCK.match(line):
                    break  # a digit of its last byte may be missing
                if frame := self._frame(number, line.strip()):
                    if self._latest != latest:
                        latest = self._latest
                        if self._says_steps and frames:
                            raise _relative(self._path)
                        begins_anew = frames > 0 and frame.t + shift < last_time
                        shift = latest - self.start if begins_anew else shift
                    frame = frame._replace(t=frame.t + shift) if shift else frame
                    frames, last_time = frames + 1, frame.t
                    yield frame
        if line and not line.endswith("\n") and not _END_OF_BLOCK.match(line):
            self._skip(number, line)
        elif self._begin and not self._is_closed:
            self._problems.note(f"line {number}: the file ends without its end mark")

    def _frame(self, number: int, line: str) -> Frame | None:
        """The frame of a line, None for none; a line that should hold one is noted."""
        try:
            frame = self._line_reader(line) if line else None
            is_lost_frame = frame is None and bool(_CONTROL.search(line))
        except (ValueError, LookupError):
            frame, is_lost_frame = None, True
        if is_lost_frame:
            self._skip(number, line)
        return frame

    def _skip(self, number: int, line: str) -> None:
        self._problems.lines.append(number)
        self._problems.example = self._problems.example or repr(line.strip()[:40])

    def _asc(self, line: str) -> Frame | None:
        tokens = line.split()
        if not re.fullmatch(r"-?\d+[.,]\d+", tokens[0]):
            self._asc_head(line)
            return None
        t, is_fd = self._time(tokens[0]), tokens[1:2] == ["CANFD"]
        event = Frame(t, 0, 0, kind="event") if self._says_steps else None
        if len(tokens) < 3 or not (is_fd or tokens[1].isdecimal()):
            return event
        bus = int(tokens[2 if is_fd else 1]) - 1
        fields = tokens[3 if is_fd else 2 :]
        if "errorframe" in (token.lower() for token in fields[:2]):
            return Frame(t, bus, 0, kind="error")
        has_direction = len(fields) > 1 and fields[1] in _DIRECTIONS
        if not has_direction and _EVENTS.match(fields[0]):
            return event  # a message of such a name has a direction
        if is_fd:  # direction, identifier, perhaps a name, BRS, ESI, DLC, length
            has_name = not fields[2].isdecimal()
            text, size, data = fields[1], int(fields[5 + has_name]), fields[6 + has_name :]
            is_remote = size == 0
        elif has_direction:  # identifier, direction, d or r, DLC
            text, data, is_remote = fields[0], fields[4:], fields[2].lower() == "r"
            size = 0 if is_remote else min(int(fields[3], self._base), 8)
        else:
            raise ValueError
        octets, kind = self._bytes(data, size), "remote" if is_remote else "data"
        if named := re.search(r"\bID = (\d+)(x?)", line):  # of a message that has a name, decimal
            return Frame(t, bus, int(named[1]), bool(named[2]), octets, kind)
        try:
            identifier = int(text.rstrip("xX"), self._base)
        except ValueError:
            return Frame(t, bus, -1, False, octets, kind, text)
        return Frame(t, bus, identifier, text[-1] in "xX", octets, kind)

    def _asc_head(self, line: str) -> None:
        if begin := _BEGIN.match(line):
            self._start_asc(begin[1].strip())
            self._begin = line
        elif date := re.match(r"(?i)date\s+\w+\s+(.+)", line):
            self._start_asc(date[1].strip())
        elif base := re.match(r"(?i)base\s+(hex|dec)(?:\s+timestamps\s+(\w+))?", line):
            self._base = 10 if base[1].lower() == "dec" else 16
            self._says_steps = (base[2] or "").lower() == "relative"
        self._is_closed |= _END_OF_BLOCK.match(line) is not None

    def _start_asc(self, text: str) -> None:
        """The start of the log, its local time taken as UTC."""
        from .csv.stamps import STAMPS, forms_of, read

        if forms := forms_of([text], STAMPS):
            self._latest = int(read([text], STAMPS[forms[0]])[0]) / 1e9
            if not self._begin:  # the first block has the start of the log
                self.start = self._latest

    def _trc(self, line: str) -> Frame | None:
        if line.startswith(";"):
            self._trc_head(line)
            return None
        tokens = line.split(maxsplit=len(self._columns) - 1)
        cells = dict(zip(self._columns, tokens, strict=False))
        kind = cells.get("T", "")
        if kind in _STATES:
            return None
        t = float(cells["O"]) / 1e3
        if kind in _TRC_ERRORS:
            return Frame(t, 0, 0, kind="error")
        identifier, bus, data = cells["I"], cells.get("B", "1"), cells.get("D", "").split()
        if identifier == "FFFFFFFF":  # what the bus does
            return None
        is_remote = kind == "RR" or data[:1] == ["RTR"]
        size = min(int(cells.get("l") or cells["L"]), 64)
        octets = b"" if is_remote else self._bytes(data, size)
        kind = "remote" if is_remote else "data"
        return Frame(t, int(bus) - 1, int(identifier, 16), len(identifier) > 4, octets, kind)

    def _trc_head(self, line: str) -> None:
        key, _, value = line[1:].partition("=")
        if key == "$FILEVERSION":
            version = value.strip()
            self._columns = [*_TRC_COLUMNS.get(version, "")]
            if version not in (*_TRC_COLUMNS, "2.0", "2.1"):
                hint = "export the log as version 1.1, 1.3, 2.0 or 2.1"
                raise UserError(f"{self._path}: TRC files of version {version} are not read", hint)
        elif key == "$STARTTIME":
            self.start = (float(value) - 25_569.0) * _DAY
        elif key == "$COLUMNS":
            self._columns = value.strip().split(",")

    def _one_a_line(self, line: str) -> Frame | None:
        """The frame in a line of a log whose lines are of one form; see `_FORMS`."""
        match = self._form.match(line) if self._form else None
        if match is None:
            if _NO_FRAME.match(line):
                return None
            raise ValueError
        cells = {name: cell or "" for name, cell in match.groupdict().items()}
        t, bus = self._time(cells["t"]), cells.get("bus", "")
        text, data = cells["id"], cells["data"]
        if self._first is None:
            self._first = self.start = t
        t -= self._first
        if bus not in self._buses:
            self._buses.append(bus)
        identifier, number = int(text, 16), self._buses.index(bus)
        is_extended = len(text) > 3
        if "flags" in cells:
            is_extended = identifier > 0x7FF or cells["flags"].strip().upper() == "X"
        if self._form is _CANDUMP and (identifier & 0x20000000 or "ERRORFRAME" in line):
            return Frame(t, number, 0, kind="error")
        data = data or re.sub(r"^#.", "", cells.get("log", ""))  # of FD: "#" and its flags
        if data.startswith(("R", "remote")):
            return Frame(t, number, identifier, is_extended, b"", "remote")
        size = cells.get("size")
        octets = self._bytes(data.split(), int(size)) if size else bytes.fromhex(data)
        return Frame(t, number, identifier, is_extended, octets)

    def _table(self, line: str) -> Frame | None:
        """The frame in a row of a table; with bytes of one or three digits all are decimal."""
        mark = next((x for x in ";\t" if x in line), ",")
        cells = [cell.strip(' "ï»¿') for cell in line.split(mark)]
        if not self._places:
            if _TABLE_HEAD.match(line):
                for kind, pattern in _TABLE.items():
                    places = (k for k, x in enumerate(cells) if re.match(f"(?i){pattern}", x))
                    self._places[kind] = next(places, len(cells))
                unit = re.search(r"[\W_](m|u|µ|Âµ|)s\b", name := cells[self._places["t"]])
                self._unit = {"m": 1e3, "": 1.0}.get(unit[1], 1e6) if unit else 0.0
                self._unit = 1e6 if name == "Time Stamp" else self._unit  # by SavvyCAN
                self._is_base64 = "arbitration_id" in cells  # by python-can, in seconds
                self._unit = 1.0 if self._is_base64 else self._unit
            return None
        cells.append("")
        t, text, size, data, bus = (cells[min(k, len(cells) - 1)] for k in self._places.values())
        time = self._time(t)
        if ":" not in t:  # neither a date nor a time of day
            if self._unit == 0.0 and self._decimals < 3:
                hint = "write it behind the name of the column, as [ms]"
                raise UserError(f"{self._path}: the unit of the times is not stated", hint)
            time /= self._unit or 1.0
        self._first = self.start = time if self._first is None else self._first
        in_columns = [x for x in cells[self._places["data"] :][: int(size)] if x]
        tokens = data.split() if " " in data else in_columns
        if len(tokens) > 1 and self._base == 16 and {*map(len, tokens)} != {2}:
            if self._is_hexadecimal:
                hint = "export them as hexadecimal numbers of two digits"
                raise UserError(f"{self._path}: bytes may be decimal or hexadecimal", hint)
            self._base = 10
        self._is_hexadecimal |= len(tokens) > 1 and self._base == 16
        identifier = int(text, 16 if text[:2] == "0x" else self._base)
        number = int(re.sub(r"\D", "", bus) or 0)  # as in "CAN 1"
        if len(tokens) == 1 and len(data) > 3:
            octets = b64decode(data) if self._is_base64 else bytes.fromhex(data)
        else:
            octets = self._bytes(tokens, int(size))
        t_s = self._after_first(time)
        return Frame(t_s, number, identifier, identifier > 0x7FF, octets)

    def _busmaster(self, line: str) -> Frame | None:
        if line.startswith("***"):
            self._busmaster_head(line)
            return None
        clock, _, bus, identifier, kind, size, *data = line.split()
        t = self._after_first(self._time(clock))
        number = int(identifier, 16 if identifier.startswith("0x") else self._base)
        is_extended, frame_kind = kind.startswith("x"), "remote" if kind.endswith("r") else "data"
        octets = self._bytes(data, int(size)) if frame_kind == "data" else b""
        return Frame(t, int(bus) - 1, number, is_extended, octets, frame_kind)

    def _busmaster_head(self, line: str) -> None:
        tokens_of_line = line.strip("*").split()
        if "RELATIVE" in tokens_of_line:
            raise _relative(self._path)
        if "DEC" in tokens_of_line:
            self._base = 10
        if tokens_of_line[:3] == ["START", "DATE", "AND"]:
            day, month, year, h, m, s = map(int, re.findall(r"\d+", line)[:6])
            self.start = datetime(year, month, day, h, m, s, tzinfo=UTC).timestamp()
            self._first = self.start % _DAY
        elif "ABSOLUTE" in tokens_of_line:
            self._first = 0.0

    def _after_first(self, time: float) -> float:
        """A time after the first one [s]; a time of day may begin anew at midnight."""
        t = time - (self._first or 0.0)
        return t + _DAY if t < -_DAY / 2.0 else t

    def _time(self, text: str) -> float:
        """A stamp: seconds, a time of day, or a date [s]."""
        if _DATED.match(text):
            return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()
        text = text.replace(",", ".")
        if ":" in text:
            hours, minutes, seconds = text.split(":", 2)
            return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds.replace(":", "."))
        self._decimals = len(text.partition(".")[2])
        return float(text)

    def _bytes(self, tokens: list[str], size: int) -> bytes:
        octets = bytes(int(token, self._base) for token in tokens[:size])
        if len(octets) < size:
            raise ValueError
        return octets


def _relative(path: Path) -> UserError:
    text = f"{path}: time stamps are relative to the frame before"
    return UserError(text, "export the log with absolute time stamps")
