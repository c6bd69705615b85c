"""ROS 2 messages (CDR) with a ros2msg schema.

One message is read front to back. It shows where the wanted numbers stand in all messages with
the same lengths inside. Their columns are taken at once.
"""

import re
import struct
from dataclasses import dataclass

import numpy as np

from .blocks import Offsets, load
from .columns import Decoded, Decoder, Spread
from .fields import DEEPEST, LONG_ARRAY, Steps, Tree, UndecodableError, node_at

_CODES = {  # of struct and numpy
    "bool": "?",
    "byte": "B",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:(?<=\bstring)<=\d+)?"
    r"(?P<array>\[(?P<bound><=)?(?P<size>\d{0,10})\])?"
    r"\s+(?P<name>[A-Za-z]\w*)\s*(?P<value>(?<=\s).*|=.*)?"
)
# Of other values after a field's name two lines may have run into one: a field would be missing.
_VALUE = re.compile(r"=?\s*([-+.\w]*|\[[^]]*\])")
_UNIT = re.compile(r"\[([^][,\d][^][,]*)\]")  # as rosidl reads units: "# ... [bar]"
_MOST_ELEMENTS = 4096  # of an array of messages or strings, which is read one by one
_MOST_MESSAGES = 16384  # inside one message
_SPARE = 8  # bytes after a message that alignment does not explain
_MOST_DECISIVE = 256  # lengths and strings in a message that others are compared with
_MOST_LAYOUTS = 256  # of one channel; messages of further ones are read one by one
_TIME = "uint32 sec\nuint32 nanosec"


@dataclass(frozen=True, slots=True)
class _Member:
    name: str
    type: str  # a key of _CODES, "string", or "package/Name"
    size: int | None  # elements, 0 for as many as the message says, None for no array
    unit: str


_Types = dict[str, tuple[_Member, ...]]


class Ros2Decoder(Decoder):
    """Messages of one ros2msg schema.

    Args:
        name: schema name, "sensor_msgs/msg/JointState".
        data: the schema: message definitions, joined by lines of "=".

    Raises:
        UndecodableError: where the schema is no such text or names types that it does not define.
    """

    def __init__(self, name: str, data: bytes) -> None:
        try:
            text = data.decode()
        except UnicodeDecodeError as e:
            raise UndecodableError(f"schema is not UTF-8: {e}") from e
        self._types: _Types = {}
        lines = "\n".join(line for line in text.splitlines() if line.strip())
        current, self._root = name, _short_name(name)
        for section in re.split(r"^={3,}\s*$", lines, flags=re.MULTILINE):
            if said := re.match(r"\s*MSG:\s+(\S+)\s*$", section, flags=re.MULTILINE):
                current, section = said.group(1), section[said.end() :]
            kind = _short_name(current)
            members = _members(kind.split("/")[0], section)
            if self._types.setdefault(kind, members) != members:
                raise UndecodableError(f"type {kind} is defined in two ways")
        for n in ("Time", "Duration"):
            self._types.setdefault(f"builtin_interfaces/{n}", _members("", _TIME))
        self._check(self._root, (), set())

    def _check(self, kind: str, ancestors: tuple[str, ...], checked: set[str]) -> None:
        if kind not in self._types:
            raise UndecodableError(f"type {kind} is not defined")
        if kind in ancestors or len(ancestors) > DEEPEST:
            raise UndecodableError(f"type {kind} contains itself or nests too deep")
        for member in self._types[kind]:
            if member.type not in _CODES and member.type != "string" and member.type not in checked:
                self._check(member.type, (*ancestors, kind), checked)
        checked.add(kind)

    def parse(self, message: bytes) -> "_Message":
        """See Decoder."""
        return _Message(self._types, self._root, message)

    def tree(self, message: bytes) -> Tree:
        """One message as plain values; long arrays are cut after LONG_ARRAY + 1 elements."""
        return self.parse(message).tree

    def unit(self, steps: Steps) -> tuple[str, str]:
        """The unit in square brackets in the comment after a field, as rosidl reads it."""
        kind, unit = self._root, ""
        for step in steps:
            if isinstance(step, str):
                member = next((m for m in self._types.get(kind, ()) if m.name == step), None)
                if member is None:
                    return "", ""
                kind, unit = member.type, member.unit
        return unit, "schema comment" if unit else ""

    def fill(
        self, decoded: Decoded, first_row: int, data: bytes, start: Offsets, stop: Offsets
    ) -> None:
        """See Decoder. Messages of a layout that is known are taken at once."""
        pending = np.arange(len(start))
        for layout in decoded.layouts:
            pending = layout.take(decoded, first_row, data, start, stop, pending)
        while len(pending):
            k, row = int(pending[0]), first_row + int(pending[0])
            pending = pending[1:]
            try:
                message = self.parse(data[start[k] : stop[k]])
            except UndecodableError as e:
                decoded.refuse(row, str(e))
                continue
            Spread(decoded).walk([message.tree], np.array([row]), decoded.shape)
            decisive_count = len(message.lengths) + len(decoded.said) + len(decoded.words)
            if decisive_count <= _MOST_DECISIVE and len(decoded.layouts) < _MOST_LAYOUTS:
                decoded.layouts.append(layout := _layout(message, decoded, row))
                pending = layout.take(decoded, first_row, data, start, stop, pending)


class _Message:
    """One message, read front to back.

    Attributes:
        raw: its bytes.
        tree: its values; long arrays are cut after LONG_ARRAY + 1 elements.
        order: "<" or ">", of its bytes.
        size: bytes that the schema explains.
        lengths: offsets of the lengths in it, which are 4 bytes each.
        texts: offset and size of its strings.
        numbers: struct's code, offset and count of its numbers and arrays of numbers.

    Raises:
        UndecodableError: where the schema does not fit.
    """

    def __init__(self, types: _Types, root: str, raw: bytes) -> None:
        if len(raw) < 4 or raw[1] > 1:  # of the encapsulation: 0 big-endian, 1 little-endian
            raise UndecodableError("no plain CDR encapsulation")
        self._types, self.raw = types, raw
        self.order = "<" if raw[1] else ">"
        self.size = 4  # alignment counts from here
        self._messages = 0
        self.lengths: list[int] = []
        self.texts: dict[Steps, tuple[int, int]] = {}
        self.numbers: dict[Steps, tuple[str, int, int]] = {}
        self.tree = self._members(root, ())
        if len(raw) - self.size >= _SPARE:
            raise UndecodableError("message is longer than its schema says")

    def _take(self, size: int, count: int = 1) -> int:
        """Moves on over `count` aligned numbers of a size; returns where they start."""
        if not count:
            return self.size  # no padding before no element
        begin = self.size + -(self.size - 4) % size
        if begin + size * count > len(self.raw):
            raise UndecodableError("message is shorter than its schema says")
        self.size = begin + size * count
        return begin

    def _length(self) -> int:
        self.lengths.append(self._take(4))
        length: int = struct.unpack_from(f"{self.order}I", self.raw, self.lengths[-1])[0]
        return length

    def _members(self, kind: str, steps: Steps) -> dict[str, Tree]:
        self._messages += 1
        if self._messages > _MOST_MESSAGES:
            raise UndecodableError("too many messages in a message")
        members = self._types[kind]
        if not members:
            self._take(1)  # rosidl gives an empty message one byte
        tree = {}
        for member in members:
            path = (*steps, member.name)
            if member.size is None:
                tree[member.name] = self._value(member.type, path)
            elif (array := self._values(member, path)) or self._numeric(member.type):
                tree[member.name] = array
        return tree

    def _numeric(self, kind: str) -> bool:
        """Whether a type holds a number."""
        return kind in _CODES or any(self._numeric(m.type) for m in self._types.get(kind, ()))

    def _value(self, kind: str, steps: Steps) -> Tree:
        if kind == "string":
            length = self._length()
            begin = self._take(1, length)
            self.texts[steps] = begin, length
            # What is not UTF-8 stays distinct and printable.
            return self.raw[begin : begin + max(length - 1, 0)].decode(errors="backslashreplace")
        if code := _CODES.get(kind):
            return self._numbers(code, 1, steps)[0]
        return self._members(kind, steps)

    def _numbers(self, code: str, count: int, steps: Steps) -> list[Tree]:
        begin = self._take(struct.calcsize(f"{self.order}{code}"), count)
        self.numbers[steps] = code, begin, count
        length = min(count, LONG_ARRAY + 1)
        return list(struct.unpack_from(f"{self.order}{length}{code}", self.raw, begin))

    def _values(self, member: _Member, steps: Steps) -> list[Tree]:
        count = member.size or self._length()
        if code := _CODES.get(member.type):
            return self._numbers(code, count, steps)
        if count > min(_MOST_ELEMENTS, len(self.raw)):  # each has at least one byte
            raise UndecodableError(f"too many elements in an array of {member.type}")
        values = [self._value(member.type, (*steps, k)) for k in range(count)]
        return values[: LONG_ARRAY + 1]


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where the wanted numbers stand in messages that have the same lengths inside."""

    size: int  # bytes that the schema explains
    decisive: dict[int, bytes]  # byte order, lengths, strings that must not change; by offset
    numbers: dict[int, tuple[str, int]]  # numpy's type and offset, by column
    words: dict[int, float]  # the number of the word that a string is, by column
    lengths: list[Steps]  # the arrays that have another length than at first
    texts: list[Steps]  # the strings that are other units or names than at first

    def take(
        self,
        decoded: Decoded,
        first_row: int,
        data: bytes,
        start: Offsets,
        stop: Offsets,
        pending: Offsets,
    ) -> Offsets:
        """Takes the messages of `pending` that are laid out so; returns the others."""
        excess = stop[pending] - start[pending] - self.size
        fits = (excess >= 0) & (excess < _SPARE)
        for offset, expected in self.decisive.items():
            actual = load(data, start[pending[fits]] + offset, f"V{len(expected)}")
            fits[fits] = actual == np.void(expected)
        begin, rows = start[pending[fits]], first_row + pending[fits]
        for column, (kind, offset) in self.numbers.items():
            is_bool = kind[1:] == "?"  # one of 2 is true
            values = load(data, begin + offset, "u1" if is_bool else kind)
            decoded.values[column, rows] = values != 0 if is_bool else values
        for column, number in self.words.items():
            decoded.values[column, rows] = number
        for steps in self.lengths:
            decoded.note_length(steps, rows)
        for steps in self.texts:
            decoded.note_text(steps, rows)
        return pending[~fits]


def _layout(message: _Message, decoded: Decoded, row: int) -> _Layout:
    """How a message is laid out whose numbers stand in a row."""
    texts = decoded.said.keys() | decoded.words.keys()
    places = [(1, 1), *((offset, 4) for offset in message.lengths)]  # the first: byte order
    places += [place for steps, place in message.texts.items() if steps in texts]
    for steps in decoded.said.keys() & message.numbers.keys():
        code, begin, _ = message.numbers[steps]
        places.append((begin, struct.calcsize(f"{message.order}{code}")))
    decisive = {a: message.raw[a : a + size] for a, size in places if size}
    numbers: dict[int, tuple[str, int]] = {}
    for column, steps in enumerate(decoded.numbers):
        array, k = (steps[:-1], steps[-1]) if isinstance(steps[-1], int) else (steps, 0)
        code, begin, count = message.numbers.get(array, ("", 0, 0))
        if k < count:
            kind = message.order + code
            numbers[column] = kind, begin + k * struct.calcsize(kind)
    columns = [decoded.numbers.index(steps) for steps in decoded.words]
    words = {column: float(decoded.values[column, row]) for column in columns}
    arrays = {steps: node_at(message.tree, steps) for steps in decoded.lengths}
    lengths = [
        steps
        for steps, array in arrays.items()
        if isinstance(array, list) and len(array) != decoded.lengths[steps]
    ]
    differing = [
        steps
        for steps, said in decoded.said.items()
        if node_at(message.tree, steps) not in ("", None, said.value)
    ]
    return _Layout(message.size, decisive, numbers, words, lengths, differing)


def _short_name(name: str) -> str:
    """The name without its middle part: "package/Name" of "package/msg/Name"."""
    segments = name.split("/")
    return f"{segments[0]}/{segments[-1]}"


def _members(package: str, text: str) -> tuple[_Member, ...]:
    members = []
    for line in text.splitlines():
        code = line.partition("#")[0].strip()
        if not code:
            continue
        declaration = _FIELD.fullmatch(code)
        value = (declaration and declaration["value"]) or ""
        if not declaration or (declaration["type"] != "string" and not _VALUE.fullmatch(value)):
            raise UndecodableError(f"schema line not understood: {line.strip()[:80]!r}")
        if value.startswith("="):
            continue  # a constant
        kind = declaration["type"]
        if kind not in _CODES and kind != "string":
            if kind in ("wstring", "time", "duration"):
                raise UndecodableError(f"type {kind} is not read")
            kind = _short_name(kind) if "/" in kind else f"{package}/{kind}"
        size = None
        if declaration["array"]:
            size = 0 if declaration["bound"] else int(declaration["size"] or 0)
            if declaration["size"] and int(declaration["size"]) == 0:
                raise UndecodableError(f"array without elements: {line.strip()[:80]!r}")
        units = _UNIT.findall(line.partition("#")[2])
        members.append(_Member(declaration["name"], kind, size, units[-1] if units else ""))
    if len({m.name for m in members}) < len(members):
        raise UndecodableError("a field name occurs twice")
    return tuple(members)
