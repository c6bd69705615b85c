"""Protobuf messages, all messages of a batch one field at a time.

Writers put the fields of a message in the order of their numbers. So all messages of a batch are
read in step: the lowest of the next tags is read from every message that has it. The protobuf
library reads unusual messages (groups, packed varints, very many fields) one by one.
"""

from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor as F
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.unknown_fields import UnknownFieldSet
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...core.model import Bools, Floats
from .blocks import Bytes, Offsets
from .columns import Batch, Fault, Wanted
from .fields import DEEPEST, LONG_ARRAY, MOST_FIELDS, Opaque, Steps, Tree, UndecodableError

_VARINT, _FIXED64, _LEN, _FIXED32 = 0, 1, 2, 5  # wire types
_WIRE = {
    F.TYPE_DOUBLE: _FIXED64, F.TYPE_FIXED64: _FIXED64, F.TYPE_SFIXED64: _FIXED64,
    F.TYPE_FLOAT: _FIXED32, F.TYPE_FIXED32: _FIXED32, F.TYPE_SFIXED32: _FIXED32,
    F.TYPE_STRING: _LEN, F.TYPE_BYTES: _LEN, F.TYPE_MESSAGE: _LEN, F.TYPE_GROUP: 3,
}  # fmt: skip
_DTYPE = {
    F.TYPE_DOUBLE: "<f8", F.TYPE_FIXED64: "<u8", F.TYPE_SFIXED64: "<i8",
    F.TYPE_FLOAT: "<f4", F.TYPE_FIXED32: "<u4", F.TYPE_SFIXED32: "<i4",
}  # fmt: skip
_MESSAGES = (F.TYPE_MESSAGE, F.TYPE_GROUP)
_TEXTS = (F.TYPE_STRING, F.TYPE_BYTES)
_MOST_ROUNDS = 4096  # of the lock-step, beyond which what is left counts as unusual
_NOWHERE = 1 << 62  # the end of a varint that has no end

Words = NDArray[np.uint64]


class ProtobufDecoder:
    """Messages of one protobuf schema.

    Args:
        name: full name of the message type.
        data: a serialized FileDescriptorSet.

    Raises:
        UndecodableError: where the set is broken, incomplete, cyclic or has no such type.
    """

    def __init__(self, name: str, data: bytes) -> None:
        pool = _pool(data)
        try:
            self._type = pool.FindMessageTypeByName(name)
        except KeyError:
            raise UndecodableError(f"schema does not define {name}") from None
        try:
            self._class = GetMessageClass(self._type)
        except RecursionError:  # the library goes into each type within a type
            raise UndecodableError(f"types in {name} nest too deep") from None
        try:
            self._options = GetMessageClass(
                pool.FindMessageTypeByName("google.protobuf.FieldOptions")
            )
        except KeyError:
            self._options = None

    def _parse(self, message: bytes) -> Any:
        try:
            parsed = self._class.FromString(message)
        except DecodeError as e:
            raise UndecodableError(f"not a {self._type.full_name}: {e}") from None
        if number := _wrong_wire(parsed):
            raise UndecodableError(
                f"field {number} of {self._type.full_name} has another wire type, or a value that "
                "its enum does not have"
            )
        return parsed

    def tree(self, message: bytes) -> Tree:
        """One message as plain values; messages inside that are absent show their defaults."""
        return _tree(self._parse(message), (self._type,), [MOST_FIELDS], defaults=True)

    def present(self, message: bytes) -> Tree:
        """One message as plain values, without what is absent."""
        return _tree(self._parse(message), (self._type,), [MOST_FIELDS], defaults=False)

    def unit(self, steps: Steps) -> tuple[str, str]:
        """The unit a custom field option named `unit` states."""
        kind, option = self._type, None
        for step in steps:
            if isinstance(step, str):
                option = kind.fields_by_name[step] if kind else None
                kind = option.message_type if option else None
        if option is None or self._options is None:
            return "", ""
        for extension, value in self._options.FromString(
            option.GetOptions().SerializeToString()
        ).ListFields():
            if extension.name in ("unit", "units") and isinstance(value, str):
                return value, f"field option {extension.full_name}"
        return "", ""

    def columns(
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[Fault]]:
        """Many messages at once, see Decoder."""
        return _LockStep(self, buffer, start, end, wanted).columns()


def _pool(data: bytes) -> DescriptorPool:
    """The files of a descriptor set, each after those it imports."""
    try:
        by_name = {file.name: file for file in FileDescriptorSet.FromString(data).file}
    except DecodeError as e:
        raise UndecodableError(f"schema is no FileDescriptorSet: {e}") from None
    order = TopologicalSorter({file.name: list(file.dependency) for file in by_name.values()})
    pool = DescriptorPool()
    try:
        for name in order.static_order():
            pool.Add(by_name[name])
    except CycleError:
        raise UndecodableError("schema imports files in a circle") from None
    except KeyError as e:
        raise UndecodableError(f"schema imports {e}, which it does not hold") from None
    except TypeError as e:
        raise UndecodableError(f"schema file {name!r} is wrong: {e}") from None
    return pool


def _wrong_wire(message: Any) -> int:
    """The number of a known field that a message carries as another wire type, else 0."""
    known = message.DESCRIPTOR.fields_by_number
    for unknown in UnknownFieldSet(message):
        if unknown.field_number in known:
            return int(unknown.field_number)
    for f, value in message.ListFields():
        if f.type in _MESSAGES and not _is_map(f):
            for sub in value if f.is_repeated else (value,):
                if number := _wrong_wire(sub):
                    return number
    return 0


def _numeric(f: Any, seen: set[str]) -> bool:
    """Whether a field can hold a number that is read."""
    if f.type not in _MESSAGES:
        return f.type not in _TEXTS
    if _is_map(f) or f.message_type.full_name in seen:
        return False
    seen.add(f.message_type.full_name)
    return any(_numeric(below, seen) for below in f.message_type.fields)


def _is_map(f: Any) -> bool:
    return f.type == F.TYPE_MESSAGE and bool(f.message_type.GetOptions().map_entry)


def _tree(message: Any, above: tuple[Any, ...], left: list[int], defaults: bool) -> Tree:
    """A message as plain values.

    Args:
        message: the parsed message.
        above: the types of the messages it stands in, and its own.
        left: how many more fields may be shown, counted down. Types that hold each other several
            times make a tree wide without making it deep.
        defaults: whether what is absent is shown by its default.
    """
    if left[0] <= 0:
        return Opaque(f"after {MOST_FIELDS} others")
    left[0] -= len(message.DESCRIPTOR.fields)
    tree: dict[str, Tree] = {}
    for f in message.DESCRIPTOR.fields:
        if not defaults and f.has_presence and not message.HasField(f.name):
            continue
        value = getattr(message, f.name)
        if _is_map(f):
            tree[f.name] = Opaque("a map")
        elif f.type == F.TYPE_BYTES:
            tree[f.name] = Opaque("bytes")
        elif f.is_repeated:
            some = value[: LONG_ARRAY + 1]
            if f.type in _MESSAGES:
                some = [_tree(v, (*above, f.message_type), left, defaults) for v in some]
            if some or _numeric(f, set()):
                tree[f.name] = list(some)
        elif f.type not in _MESSAGES:
            tree[f.name] = value
        elif message.HasField(f.name) or (f.message_type not in above and len(above) < DEEPEST):
            tree[f.name] = _tree(value, (*above, f.message_type), left, defaults)
        else:
            why = "holds itself" if f.message_type in above else "too deep"
            tree[f.name] = Opaque(f"absent at first, {why}")
    return tree


@dataclass(slots=True)
class _Slot:
    """What to do with one field of a message type; elements count from 0, which a single one is."""

    type: int
    wire: int
    columns: dict[int, int] = field(default_factory=dict)  # element to column
    said: dict[int, tuple[str, Bools]] = field(default_factory=dict)  # to text, and who differs
    inside: dict[int, "_Node"] = field(default_factory=dict)  # element to message
    count: Offsets | None = None  # elements seen so far of an array, per message of the batch
    expected: tuple[int, Bools] | None = None  # how many, and who has another count


@dataclass(slots=True)
class _Node:
    """What to do with a message type at one place."""

    slots: dict[int, _Slot]
    zeros: list[int]  # columns that are 0 where the message is there and does not say more
    seen: Bools


# A place that is looked at, and its column; None where it is a text or an array.
_Place = tuple[int | None, Steps]


class _LockStep:
    def __init__(
        self, decoder: ProtobufDecoder, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> None:
        self._decoder, self._buffer = decoder, buffer
        self._start, self._end = start, end
        self._words: Words = np.ndarray((len(buffer) - 7,), "<u8", buffer, 0, (1,))
        self._batch = Batch(wanted, len(start))
        self._values = self._batch.values
        self._odd = np.zeros(len(start), np.bool_)  # unusual: the library decides
        self._rounds = 0
        self._slots: list[_Slot] = []  # with elements that are counted
        places: list[_Place] = [*enumerate(wanted.leaves)]
        places += [(None, steps) for steps in (*wanted.said, *wanted.lengths)]
        self._root = self._node(decoder._type, (), places)

    def _node(self, kind: Any, at: Steps, below: list[_Place]) -> _Node:
        """What to do with a message at a place; `below` are the places in it that matter."""
        node = _Node({}, [], np.zeros(len(self._start), np.bool_))
        by_name: dict[str, list[_Place]] = {}
        for i, steps in below:
            by_name.setdefault(str(steps[len(at)]), []).append((i, steps))
        for name, mine in by_name.items():
            f = kind.fields_by_name[name]
            slot = node.slots[f.number] = self._slot(f, (*at, name), mine)
            if not f.is_repeated and not f.has_presence:
                node.zeros += slot.columns.values()
        return node

    def _slot(self, f: Any, steps: Steps, places: list[_Place]) -> _Slot:
        """What to do with a field; the places are those in it that are looked at."""
        slot = _Slot(f.type, _WIRE.get(f.type, _VARINT))
        wanted, depth = self._batch.wanted, len(steps)
        if f.is_repeated:
            slot.count = np.zeros(len(self._start), np.int64)
            self._slots.append(slot)
            if steps in wanted.lengths:
                slot.expected = wanted.lengths[steps], self._batch.lengths[steps]
        inside: dict[int, list[_Place]] = {}
        for i, place in places:
            if f.is_repeated and len(place) == depth:
                continue  # the array itself
            element = place[depth] if f.is_repeated else 0
            assert isinstance(element, int)
            if f.type in _MESSAGES:
                inside.setdefault(element, []).append((i, place))
            elif i is not None:
                slot.columns[element] = i
            elif place in wanted.said:
                slot.said[element] = wanted.said[place].text, self._batch.texts[place]
        for element, below in inside.items():
            at = (*steps, element) if f.is_repeated else steps
            slot.inside[element] = self._node(f.message_type, at, below)
        return slot

    def columns(self) -> tuple[Floats, list[Fault]]:
        """The columns, see Decoder."""
        self._message(self._root, np.arange(len(self._start)), self._start, self._end)
        for slot in self._slots:
            if slot.expected:
                count, other = slot.expected
                other |= slot.count != count
        for row in np.flatnonzero(self._odd).tolist():
            message = self._buffer[self._start[row] : self._end[row]].tobytes()
            try:
                self._batch.put_tree(row, self._decoder.present(message))
            except UndecodableError as e:
                self._batch.refuse(row, str(e))
        return self._batch.finish()

    def _varint(self, p: Offsets) -> tuple[Words, Offsets]:
        """Varints at p, and the offsets after them (_NOWHERE where one does not end)."""
        x = self._words[p]
        if not (x & np.uint64(0x80)).any():
            return x & np.uint64(0x7F), p + 1
        stop = ~x & np.uint64(0x8080808080808080)
        mask = stop ^ (stop - np.uint64(1))  # the bytes up to the first with its top bit clear
        size = np.bitwise_count(mask).astype(np.int64) >> 3
        x = x & mask
        for keep, move, shift in (
            (0x007F007F007F007F, 0x7F007F007F007F00, 1),
            (0x00003FFF00003FFF, 0x3FFF00003FFF0000, 2),
            (0x000000000FFFFFFF, 0x0FFFFFFF00000000, 4),
        ):
            x = (x & np.uint64(keep)) | ((x & np.uint64(move)) >> np.uint64(shift))
        after = p + size
        if len(long := np.flatnonzero(stop == 0)):
            ninth = self._buffer[p[long] + 8].astype(np.uint64)
            tenth = self._buffer[p[long] + 9].astype(np.uint64)
            ends = ninth < 0x80
            x[long] |= (ninth & np.uint64(0x7F)) << np.uint64(56)
            x[long] |= np.where(ends, np.uint64(0), tenth << np.uint64(63))
            after[long] = np.where(
                ends, p[long] + 9, np.where(tenth < 0x80, p[long] + 10, _NOWHERE)
            )
        return x, after

    def _message(self, node: _Node, rows: Offsets, p: Offsets, end: Offsets) -> None:
        if node.seen.any():  # a message in pieces
            self._odd[rows] |= node.seen[rows]
        for i in node.zeros:
            self._values[i, rows] = 0.0
        node.seen[rows] = True
        while True:
            live = p < end
            if not live.all():
                rows, p, end = rows[live], p[live], end[live]
            if not len(rows):
                return
            self._rounds += 1
            if self._rounds > _MOST_ROUNDS:
                self._odd[rows] = True
                return
            tag, q = self._varint(p)
            lowest = tag.min()
            now = tag == lowest
            if now.all():
                p = self._field(node, int(lowest), rows, q, end)
            else:
                p = p.copy()
                p[now] = self._field(node, int(lowest), rows[now], q[now], end[now])
            if len(strange := np.flatnonzero((p > end) | self._odd[rows])):
                self._odd[rows[strange]] = True
                p = np.where(self._odd[rows], end, p)

    def _field(self, node: _Node, tag: int, rows: Offsets, q: Offsets, end: Offsets) -> Offsets:
        """Reads one field of the messages that have it next; returns the offsets after it."""
        number, wire = tag >> 3, tag & 7
        slot = node.slots.get(number)
        q, after, value = self._extent(wire if number else -1, np.minimum(q, end), end)
        if slot is None:
            return after
        packed = wire == _LEN and slot.wire in (_FIXED64, _FIXED32) and slot.count is not None
        if wire != slot.wire and not packed:
            after = np.full(len(q), _NOWHERE)
        if not (whole := after <= end).all():
            self._odd[rows[~whole]] = True
            rows, q, end = rows[whole], q[whole], after[whole]
            value = value if value is None else value[whole]
        else:
            end = after
        if packed and len(rows):
            self._packed(slot, rows, q, end)
        elif len(rows):
            self._store(slot, rows, q, end, value)
        return after

    def _extent(self, wire: int, q: Offsets, end: Offsets) -> tuple[Offsets, Offsets, Words | None]:
        """Where values begin and end (_NOWHERE where they do not), and varints themselves."""
        if wire == _VARINT:
            value, after = self._varint(q)
            return q, after, value
        if wire == _FIXED64:
            return q, q + 8, None
        if wire == _FIXED32:
            return q, q + 4, None
        if wire == _LEN:
            length, q = self._varint(q)
            room = np.maximum(end - q, -1)
            fits = (room >= 0) & (length <= np.maximum(room, 0).astype(np.uint64))
            return q, np.where(fits, q + length.astype(np.int64), _NOWHERE), None
        return q, np.full(len(q), _NOWHERE), None

    def _store(
        self, slot: _Slot, rows: Offsets, q: Offsets, end: Offsets, value: Words | None
    ) -> None:
        """Takes the values of single fields, or the next element of repeated ones."""
        numbers = self._numbers(slot.type, q, value) if slot.columns else None
        at = slot.count[rows] if slot.count is not None else np.zeros(1, np.int64)
        for k in np.unique(at).tolist() if (at != at[0]).any() else [int(at[0])]:
            mine: Any = at == k if len(at) == len(rows) else slice(None)
            if node := slot.inside.get(k):
                self._message(node, rows[mine], q[mine], end[mine])
            if said := slot.said.get(k):
                other = _other_text(self._buffer, q[mine], (end - q)[mine], said[0])
                said[1][rows[mine]] |= other & (end > q)[mine]
            if (i := slot.columns.get(k)) is not None and numbers is not None:
                self._values[i, rows[mine]] = numbers[mine]
        if slot.count is not None:
            slot.count[rows] += 1

    def _packed(self, slot: _Slot, rows: Offsets, q: Offsets, end: Offsets) -> None:
        """Takes the numbers of arrays whose elements have one size."""
        assert slot.count is not None
        before = slot.count[rows]
        size = 8 if slot.wire == _FIXED64 else 4
        count, rest = np.divmod(end - q, size)
        self._odd[rows[rest > 0]] = True
        for k, i in slot.columns.items():
            has = (before <= k) & (k < before + count)
            where = (q + (k - before) * size)[has]
            self._values[i, rows[has]] = self._numbers(slot.type, where, None)
        slot.count[rows] += count

    def _numbers(self, kind: int, q: Offsets, value: Words | None) -> NDArray[Any]:
        if dtype := _DTYPE.get(kind):
            size = np.dtype(dtype).itemsize
            view = np.ndarray((len(self._buffer) - size + 1,), dtype, self._buffer, 0, (1,))
            found: NDArray[Any] = view[q]
            return found
        assert value is not None
        if kind in (F.TYPE_INT32, F.TYPE_ENUM):
            return value.astype(np.uint32).view(np.int32)
        if kind == F.TYPE_INT64:
            return value.view(np.int64)
        if kind == F.TYPE_UINT32:
            return value.astype(np.uint32)
        if kind == F.TYPE_BOOL:
            truth: NDArray[np.bool_] = value != 0
            return truth
        if kind == F.TYPE_SINT32:
            value = value.astype(np.uint32).astype(np.uint64)
        if kind in (F.TYPE_SINT32, F.TYPE_SINT64):
            return (value >> np.uint64(1)).view(np.int64) ^ -(value & np.uint64(1)).view(np.int64)
        return value


def _other_text(buffer: Bytes, start: Offsets, length: Offsets, text: str) -> Bools:
    """Where the bytes at `start` are not this text; shape (n,)."""
    raw = np.frombuffer(text.encode(), np.uint8)
    other: Bools = length != len(raw)
    if len(raw) and len(same := np.flatnonzero(~other)):
        other[same] = (sliding_window_view(buffer, len(raw))[start[same]] != raw).any(1)
    return other
