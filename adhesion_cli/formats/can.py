"""CAN logs with the DBC of the vehicle; runs in a process of its own.

Frames are in BLF, in text (`can_text`), or in an MF4 of a bus, which python-can reads. cantools
reads the DBC. The signals are decoded here, a message at a time.
"""

from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Bools, Floats, Times
from ..core.text import NO_VALUE
from .can_blf import Frame, Problems, blf_frames
from .can_text import TextLog
from .source import YEAR_1990, Field, ReadOptions, distinct_words
from .tables import Contents, NamedColumn, TableSamples, fields

_FLOAT_BITS = 16, 32, 64  # lengths of floats; one of another length has no value
_DATABASES = {".sym": "sym", ".kcd": "kcd", ".arxml": "arxml", ".cdd": "cdd"}

_J1939_LENGTHS = 8, 16, 32  # of numbers that say by their highest byte that they are no value


class _Key(NamedTuple):
    bus: int
    identifier: int
    extended: bool


class _Database:
    def __init__(self, names: Sequence[str]) -> None:
        origins: dict[tuple[int, bool], tuple[Any, str]] = {}
        for name in names:
            for message in _load(name).messages:
                key = message.frame_id, bool(message.is_extended_frame)
                first_message, origin = origins.setdefault(key, (message, name))
                if _layout(first_message) != _layout(message):
                    raise UserError(
                        f"{name}: message 0x{key[0]:X} ({message.name}) is another one in "
                        f"{origin} ({first_message.name})",
                        "state only the DBC files of the buses in this log",
                        code=2,
                    )
        self._by_id = {key: message for key, (message, _) in origins.items()}
        self.size = len(self._by_id)
        self._by_name = {m.name: key for key, m in self._by_id.items()}
        extended = ((number, m) for (number, is_extended), m in self._by_id.items() if is_extended)
        j1939 = ((number, m) for number, m in extended if m.protocol == "j1939")
        self._by_group = {_parameter_group(number): m for number, m in j1939}

    def message(self, identifier: int, extended: bool) -> Any:
        """The message of an identifier, None for none; of J1939 that of its parameter group."""
        message = self._by_id.get((identifier, extended))
        return message or (self._by_group.get(_parameter_group(identifier)) if extended else None)

    def identifier(self, frame: Frame) -> tuple[int, bool]:
        """The identifier of a frame; of one that the log names, that of the message."""
        return self._by_name.get(frame.name, (frame.identifier, frame.extended))


def _parameter_group(identifier: int) -> int:
    """The parameter group of a J1939 frame: without priority, source and destination."""
    group = identifier >> 8 & 0x3FFFF
    return group if group >> 8 & 0xFF >= 240 else group & ~0xFF


@dataclass(slots=True)
class _Frames:
    """The frames of one message, in the order of the log."""

    length: int  # bytes that are kept of each
    t: "array[float]" = field(default_factory=lambda: array("d"))  # after the log's start [s]
    sizes: "array[int]" = field(default_factory=lambda: array("B"))  # bytes that each frame has
    data: bytearray = field(default_factory=bytearray)

    def add(self, t: float, data: bytes) -> None:
        self.t.append(t)
        self.sizes.append(len(data))
        self.data += data[: self.length].ljust(self.length, b"\0")

    def bits(self) -> NDArray[np.uint8]:
        """Each frame's bits, the lowest of each byte first; shape (n, 8 · length)."""
        octets = np.frombuffer(self.data, np.uint8).reshape(-1, self.length)
        return np.unpackbits(octets, axis=1, bitorder="little")

    def samples(
        self, bits: NDArray[np.uint8], message: Any, signal: Any
    ) -> tuple[Bools, Floats, dict[str, Bools]]:
        """Which frames have a signal, (n,); its values in these and masks over them, (m,)."""
        selected = _selected(bits, message, signal)
        value, no_value = _decoded(bits[selected], message, signal)
        sizes = np.frombuffer(self.sizes, np.uint8)[selected].astype(np.int64)
        truncated = 8 * sizes <= max(_positions(signal))
        return selected, value, {"value-missing": truncated, "value-is-text": no_value & ~truncated}


class _CanSignal(NamedTuple):
    key: _Key
    message: Any  # of cantools, as is the next
    signal: Any


class Reader:
    """A CAN log, decoded by its DBC; see `tables.Reader`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        if not options.dbc:
            text = f"{path}: a CAN log holds frames; which signals they are, a DBC file says"
            raise UserError(text, "state it with --dbc FILE.dbc")
        self._path = path
        database = _Database(options.dbc)
        self._frames: dict[_Key, _Frames] = {}
        self._unknown: Counter[str] = Counter()
        problems = Problems()
        self._start = 0
        self._read(database, problems)
        keys = [key for key, frames in self._frames.items() if len(frames.t)]
        if not keys:
            raise self._nothing(database, problems)
        messages = {key: database.message(key.identifier, key.extended) for key in sorted(keys)}
        pairs = ((key, x, signal) for key, x in messages.items() for signal in x.signals)
        self._signals = [_CanSignal(*signal) for signal in pairs]
        rows = sum(len(self._frames[key].t) for key in keys)
        reasons = {
            "dbc": ", ".join(Path(name).name for name in options.dbc),
            "frames": rows,
            "messages": len(keys),
            "buses": len({key.bus for key in keys}),
        }
        clock = "sum of the time steps to" if problems.has_steps else "time stamp of"
        begin = "the start of the log is taken as UTC" if self._start else "no start stated"
        time_reason = f"{clock} each frame, to the microsecond; {begin}"
        findings = list(self._findings(problems, rows))
        events = []
        codes = {"can-error-frames": problems.errors, "can-frames-lost": problems.losses}
        for code, times in codes.items():
            if times:
                finding = Finding(code, "warning", count=len(times))
                events.append((finding, _ticks(np.array(times), self._start)))
        numbers = self._fields()
        states = {x: distinct_words(_words(x.signal)) for x in self._signals}
        number_of = zip(self._signals, numbers, strict=True)
        texts = {x: replace(number, words=states[x]) for x, number in number_of if states[x]}
        self._all_signals = [*self._signals, *texts]
        self.contents = Contents(
            fields=numbers,
            start_ns=self._start,
            time_reason=time_reason,
            rows=rows,
            reasons=reasons,
            findings=findings,
            texts=[*texts.values()],
            events=events,
        )

    def _read(self, database: _Database, problems: Problems) -> None:
        frames, begin = _open_frames(self._path, problems)
        for frame in frames:
            if frame.kind == "error":
                problems.errors.append(frame.t)
            if frame.kind != "data":
                continue
            key = _Key(frame.bus, *database.identifier(frame))
            frame_group = self._frames.get(key)
            if frame_group is None:
                definition = database.message(key.identifier, key.extended)
                if definition is None:
                    self._unknown[frame.name or f"0x{key.identifier:X}"] += 1
                    continue
                frame_group = self._frames[key] = _Frames(definition.length)
            frame_group.add(frame.t, frame.data)
        ticks = round(begin() * 1e6) * 1000
        self._start = ticks if ticks >= YEAR_1990 else 0

    def _nothing(self, database: _Database, problems: Problems) -> UserError:
        if self._unknown:
            return UserError(
                f"{self._path}: no frame of the log is in the DBC (frames: {self._unknown_ids})",
                f"state the DBC of this vehicle with --dbc; this one has {database.size} messages",
            )
        if damage := problems.damage or "".join(f"line {n}" for n in problems.lines[:1]):
            raise ValueError(damage)
        hint = "check that the logger recorded anything"
        return UserError(f"{self._path}: the log has no frames", hint)

    @property
    def _unknown_ids(self) -> str:
        return ", ".join(name for name, _ in self._unknown.most_common(6))

    def _findings(self, problems: Problems, rows: int) -> Iterator[Finding]:
        if problems.damage:
            values = {"kept_rows": rows}
            yield Finding("log-damaged", "error", "", 1, (), values, {"damage": problems.damage})
        if lines := problems.lines:
            values, names = {"line": lines[0]}, {"example": problems.example}
            yield Finding("can-lines-skipped", "warning", "", len(lines), (), values, names)
        if count := self._unknown.total():
            values, names = {"messages": len(self._unknown)}, {"ids": self._unknown_ids}
            yield Finding("can-unknown-frames", "info", "", count, (), values, names)

    def _fields(self) -> list[Field]:
        buses = {key.bus for key in self._frames}
        named = []
        for key, message, signal in self._signals:
            bus = f", CAN {key.bus + 1}" if len(buses) > 1 else ""
            sources = {k.identifier for k, m, _ in self._signals if m is message}
            source = f", ECU {key.identifier & 0xFF}" if len(sources) > 1 else ""
            group = f"{message.name}{bus}{source}"
            named.append(NamedColumn(group, signal.name, signal.unit or "", group))
        return fields(named, "DBC")

    def read(self, wanted: Sequence[int]) -> tuple[list[TableSamples], list[Finding]]:
        """See `tables.Reader`."""
        times: dict[Any, Times] = {}
        bits: dict[_Key, NDArray[np.uint8]] = {}
        series = []
        for k in wanted:
            key, message, signal = self._all_signals[k]
            frames = self._frames[key]
            if key not in bits:
                bits[key] = frames.bits()
            selected, value, masks = frames.samples(bits[key], message, signal)
            place = key, selected.tobytes()
            if place not in times:
                times[place] = _ticks(np.frombuffer(frames.t, np.float64)[selected], self._start)
            state_words: tuple[str, ...] = ()
            if k >= len(self._signals):
                number_of = {number: word for word, number in enumerate(signal.choices)}
                raw = _raw(bits[key][selected], signal).tolist()
                numbers = np.array([number_of.get(number, np.nan) for number in raw])
                has_no_value = np.logical_or(*masks.values())
                if np.isfinite(numbers[~has_no_value]).all():  # else it is a number
                    value, state_words = numbers, _words(signal)
            series.append(TableSamples(times[place], value, masks, state_words))
        return series, []


def bus(place: str) -> Any:
    """A bus that is listened to, as python-can has it.

    `place` is INTERFACE:CHANNEL; a channel alone is one of socketcan.

    Raises:
        UserError: where there is no such bus.
    """
    import can

    interface, _, channel = place.rpartition(":")
    try:
        return can.Bus(interface=interface or "socketcan", channel=channel)
    except Exception as error:  # each interface has errors of its own
        text = f"can:{place}: cannot be opened: {error}"
        raise UserError(text, "check interface and channel, as can:socketcan:can0") from None


def next_frame(bus: Any, place: str) -> Any:
    """The next frame of a bus; None where none comes within 0.2 s.

    Raises:
        UserError: where the bus can no longer be read, as when its interface goes down.
    """
    import can

    try:
        return bus.recv(timeout=0.2)
    except (can.CanError, OSError) as error:
        text = f"can:{place}: cannot be read any more: {error}"
        raise UserError(text, "check that the interface is up, then start again") from None


class FrameDecoder:
    """Frames one by one, by the DBC of the vehicle.

    Raises:
        UserError: where one of them cannot be read.
    """

    def __init__(self, dbc: Sequence[str]) -> None:
        self._known = _Database(dbc)
        self._fields: dict[int, list[tuple[Any, Field]]] = {}

    def values(self, identifier: int, extended: bool, data: bytes) -> dict[Field, float]:
        """What a frame says; nothing where the DBC does not know it, or calls it no value."""
        message = self._known.message(identifier, extended)
        if message is None:
            return {}
        if id(message) not in self._fields:
            group = message.name
            named = [NamedColumn(group, s.name, s.unit or "", group) for s in message.signals]
            pairs = zip(message.signals, fields(named, "DBC"), strict=True)
            self._fields[id(message)] = list(pairs)
        frames = _Frames(message.length)
        frames.add(0.0, data)
        bits, by_signal = frames.bits(), {}
        for signal, field_ in self._fields[id(message)]:
            _, value, masks = frames.samples(bits, message, signal)
            if len(value) and not any(mask[0] for mask in masks.values()):
                by_signal[field_] = float(value[0])
        return by_signal


def _load(name: str) -> Any:
    from cantools import database

    path = Path(name)
    try:
        raw = path.read_bytes()
        try:
            text = raw.decode("utf-8-sig")  # with a mark or without
        except UnicodeDecodeError:
            text = raw.decode("cp1252", "replace")
        file_format = _DATABASES.get(path.suffix.lower(), "dbc")
        return database.load_string(text, database_format=file_format, strict=False)
    except Exception as error:  # whatever the library raises, the file is no DBC
        said = " ".join(str(error).split())[:200]
        reason = error.strerror if isinstance(error, OSError) else f"no DBC file: {said}"
        text = f"{name}: {reason or 'cannot be read'}"
        raise UserError(text, "state the vehicle's DBC file with --dbc", code=2) from error


def _layout(message: Any) -> list[tuple[Any, ...]]:
    return [
        (s.name, s.start, s.length, s.byte_order, s.is_signed, s.is_float, s.scale, s.offset)
        for s in message.signals
    ]


def _open_frames(path: Path, problems: Problems) -> tuple[Iterator[Frame], Callable[[], float]]:
    """The frames of a log; and its start since 1970 [s], 0 for none, once they are read."""
    import can

    with path.open("rb") as file:
        head = file.read(8)
    if head.startswith(b"LOGG"):
        start = can.BLFReader(path).start_timestamp
        return blf_frames(path, problems), lambda: start
    if head.startswith((b"MDF", b"UnFinMF")):
        reader = can.MF4Reader(path)
        start = reader._start_timestamp
        return _mf4_frames(reader, start), lambda: start
    log = TextLog(path, problems)
    return iter(log), lambda: log.start


def _mf4_frames(reader: Any, start: float) -> Iterator[Frame]:
    for m in reader:
        bus = m.channel if isinstance(m.channel, int) else 1
        kind = "error" if m.is_error_frame else "remote" if m.is_remote_frame else "data"
        t = m.timestamp - start
        yield Frame(t, bus - 1, m.arbitration_id, m.is_extended_id, bytes(m.data), kind)


def _ticks(seconds: Floats, start: int) -> Times:
    """Times [ns], to the microsecond: python-can gives them as seconds since 1970 in a float."""
    return np.rint(seconds * 1e6).astype(np.int64) * 1000 + start


def _positions(signal: Any) -> list[int]:
    """The bits of a signal in a frame, the lowest first, as `_Frames.bits` numbers them."""
    bit, positions = int(signal.start), []
    for _ in range(signal.length):
        positions.append(bit)
        if signal.byte_order == "little_endian":
            bit += 1
        else:  # the start is the highest bit
            bit = bit + 15 if bit % 8 == 0 else bit - 1
    return positions if signal.byte_order == "little_endian" else positions[::-1]


def _raw(bits: NDArray[np.uint8], signal: Any) -> NDArray[Any]:
    """The raw numbers of a signal: integers, or floats where it is one; shape (n,)."""
    raw = np.zeros(len(bits), np.uint64)
    for power, position in enumerate(_positions(signal)):
        if position < bits.shape[1]:
            raw |= bits[:, position].astype(np.uint64) << np.uint64(power)
    n = signal.length
    if signal.is_float:
        if n not in _FLOAT_BITS:
            return np.full(len(raw), np.nan)
        return raw.astype(f"<u{n // 8}").view(f"<f{n // 8}")
    if signal.is_signed:
        return (raw << np.uint64(64 - n)).view(np.int64) >> np.int64(64 - n)
    return raw


def _decoded(bits: NDArray[np.uint8], message: Any, signal: Any) -> tuple[Floats, Bools]:
    """The physical values of a signal, and which raw values say that there is none; shape (n,)."""
    raw = _raw(bits, signal)
    scale, offset = float(signal.scale), float(signal.offset)
    value = raw.astype(np.float64)
    divisor = round(1.0 / scale) if 0.0 < abs(scale) < 1.0 else 0
    if divisor and abs(divisor * scale - 1.0) < 1e-12:
        value /= divisor  # 7199 of 0.01 is 71.99, and not that times a factor which is not exact
    elif scale != 1.0:
        value *= scale
    if offset:
        value += offset
    no_value = [k for k, text in (signal.choices or {}).items() if NO_VALUE.search(str(text))]
    is_no_value = np.isin(raw, no_value) if no_value else np.zeros(len(raw), np.bool_)
    if message.protocol == "j1939" and not signal.is_float and signal.length in _J1939_LENGTHS:
        is_no_value |= raw >= 0xFE << (signal.length - 8)  # an error, or not available
    return value, is_no_value


def _words(signal: Any) -> tuple[str, ...]:
    """The words of a signal for some of its raw numbers, in their order in the DBC."""
    return tuple(str(word).strip() for word in (signal.choices or {}).values())


def _selected(bits: NDArray[np.uint8], message: Any, signal: Any) -> Bools:
    """The frames in which the multiplexers select a signal, shape (n,)."""
    if not signal.multiplexer_ids:
        return np.ones(len(bits), np.bool_)
    selector = message.get_signal_by_name(signal.multiplexer_signal)
    is_selected = np.isin(_raw(bits, selector), np.array(signal.multiplexer_ids))
    return is_selected & _selected(bits, message, selector)
