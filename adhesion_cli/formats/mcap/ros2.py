"""ROS 2 messages (CDR) with a ros2msg schema, each read front to back."""

import re
import struct
from dataclasses import dataclass

from .columns import Decoder
from .fields import DEEPEST, LONG_ARRAY, Steps, Tree, UndecodableError

_TYPES = "bool byte char int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64".split()
_CODES = dict(zip(_TYPES, "?BBbBhHiIqQfd", strict=True))  # of struct
_NUMBERS = {  # how to read one of each type, by the byte of the encapsulation that says the order
    mark: {kind: struct.Struct(f"{order}{code}") for kind, code in _CODES.items()}
    for mark, order in enumerate("><")
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

    `data` has message definitions, joined by lines of "=".

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

    def parse(self, message: bytes) -> Tree:
        """One message as plain values; long arrays are cut after LONG_ARRAY + 1 elements."""
        try:
            return _Message(self._types, self._root, message).tree
        except struct.error:
            raise UndecodableError("message is shorter than its schema says") from None

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


class _Message:
    """One message, read front to back; long arrays are cut after LONG_ARRAY + 1 elements."""

    def __init__(self, types: _Types, root: str, raw: bytes) -> None:
        if len(raw) < 4 or raw[1] > 1:  # of the encapsulation: 0 big-endian, 1 little-endian
            raise UndecodableError("no plain CDR encapsulation")
        self._types, self._raw = types, raw
        self._order, self._number_of = "><"[raw[1]], _NUMBERS[raw[1]]
        self._size = 4  # bytes that the schema explains; alignment counts from here
        self._messages = 0
        self.tree = self._members(root)
        if len(raw) - self._size >= _SPARE:
            raise UndecodableError("message is longer than its schema says")

    def _take(self, size: int, count: int = 1) -> int:
        """Moves on over `count` aligned numbers of a size; returns where they start."""
        if not count:
            return self._size  # no padding before no element
        begin = self._size + -(self._size - 4) % size
        if begin + size * count > len(self._raw):
            raise UndecodableError("message is shorter than its schema says")
        self._size = begin + size * count
        return begin

    def _number(self, number: struct.Struct) -> Tree:
        begin = self._size + -(self._size - 4) % number.size
        self._size = begin + number.size
        return number.unpack_from(self._raw, begin)[0]

    def _length(self) -> int:
        length: int = self._number(self._number_of["uint32"])
        return length

    def _members(self, kind: str) -> dict[str, Tree]:
        self._messages += 1
        if self._messages > _MOST_MESSAGES:
            raise UndecodableError("too many messages in a message")
        members = self._types[kind]
        if not members:
            self._take(1)  # rosidl gives an empty message one byte
        tree = {}
        for member in members:
            if member.size is None:
                tree[member.name] = self._value(member.type)
            elif (array := self._values(member)) or self._numeric(member.type):
                tree[member.name] = array
        return tree

    def _numeric(self, kind: str) -> bool:
        return kind in _CODES or any(self._numeric(m.type) for m in self._types.get(kind, ()))

    def _value(self, kind: str) -> Tree:
        if number := self._number_of.get(kind):
            return self._number(number)
        if kind == "string":
            length = self._length()
            begin = self._take(1, length)
            # What is not UTF-8 stays distinct and printable.
            return self._raw[begin : begin + max(length - 1, 0)].decode(errors="backslashreplace")
        return self._members(kind)

    def _values(self, member: _Member) -> list[Tree]:
        count = member.size or self._length()
        if number := self._number_of.get(member.type):
            begin, length = self._take(number.size, count), min(count, LONG_ARRAY + 1)
            form = f"{self._order}{length}{number.format[1:]}"
            return list(struct.unpack_from(form, self._raw, begin))
        if count > min(_MOST_ELEMENTS, len(self._raw)):  # each has at least one byte
            raise UndecodableError(f"too many elements in an array of {member.type}")
        return [self._value(member.type) for _ in range(count)][: LONG_ARRAY + 1]


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
