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
from .columns import Batch, MessageFault, Wanted
from .fields import DEEPEST, LONG_ARRAY, MOST_FIELDS, Opaque, Steps, Tree, UndecodableError

_VARINT, _FIXED64, _LEN, _FIXED32 = 0, 1, 2, 5  # wire types
_WIRE = {
    F.TYPE_DOUBLE: _FIXED64,
    F.TYPE_FIXED64: _FIXED64,
    F.TYPE_SFIXED64: _FIXED64,
    F.TYPE_FLOAT: _FIXED32,
    F.TYPE_FIXED32: _FIXED32,
    F.TYPE_SFIXED32: _FIXED32,
    F.TYPE_STRING: _LEN,
    F.TYPE_BYTES: _LEN,
    F.TYPE_MESSAGE: _LEN,
    F.TYPE_GROUP: 3,
}
_DTYPE = {
    F.TYPE_DOUBLE: "<f8",
    F.TYPE_FIXED64: "<u8",
    F.TYPE_SFIXED64: "<i8",
    F.TYPE_FLOAT: "<f4",
    F.TYPE_FIXED32: "<u4",
    F.TYPE_SFIXED32: "<i4",
}
_MESSAGES = (F.TYPE_MESSAGE, F.TYPE_GROUP)
_TEXTS = (F.TYPE_STRING, F.TYPE_BYTES)
_MOST_ROUNDS = 4096  # of the lock-step, beyond which what is left counts as unusual
_NOWHERE = 1 << 62  # the end of a varint that has no end

Uint64s = NDArray[np.uint64]


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
        self, buffer: Bytes, start: Offsets, stop: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[MessageFault]]:
        """Many messages at once, see Decoder."""
        return _LockStep(self, buffer, start, stop, wanted).columns()


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
    fields = message.DESCRIPTOR.fields_by_number
    for unknown in UnknownFieldSet(message):
        if unknown.field_number in fields:
            return int(unknown.field_number)
    for f, value in message.ListFields():
        if f.type in _MESSAGES and not _is_map(f):
            for sub in value if f.is_repeated else (value,):
                if number := _wrong_wire(sub):
                    return number
    return 0


def _numeric(f: Any, visited: set[str]) -> bool:
    """Whether a field can hold a number that is read."""
    if f.type not in _MESSAGES:
        return f.type not in _TEXTS
    if _is_map(f) or f.message_type.full_name in visited:
        return False
    visited.add(f.message_type.full_name)
    return any(_numeric(member, visited) for member in f.message_type.fields)


def _is_map(f: Any) -> bool:
    return f.type == F.TYPE_MESSAGE and bool(f.message_type.GetOptions().map_entry)


def _tree(message: Any, ancestors: tuple[Any, ...], budget: list[int], defaults: bool) -> Tree:
    """A message as plain values.

    Args:
        message: the parsed message.
        ancestors: the types of the messages it stands in, and its own.
        budget: how many more fields may be shown, counted down. Types that hold each other several
            times make a tree wide without making it deep.
        defaults: whether what is absent is shown by its default.
    """
    if budget[0] <= 0:
        return Opaque(f"after {MOST_FIELDS} others")
    budget[0] -= len(message.DESCRIPTOR.fields)
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
            elements = value[: LONG_ARRAY + 1]
            if f.type in _MESSAGES:
                elements = [
                    _tree(v, (*ancestors, f.message_type), budget, defaults) for v in elements
                ]
            if elements or _numeric(f, set()):
                tree[f.name] = list(elements)
        elif f.type not in _MESSAGES:
            tree[f.name] = value
        elif message.HasField(f.name) or (
            f.message_type not in ancestors and len(ancestors) < DEEPEST
        ):
            tree[f.name] = _tree(value, (*ancestors, f.message_type), budget, defaults)
        else:
            reason = "holds itself" if f.message_type in ancestors else "too deep"
            tree[f.name] = Opaque(f"absent at first, {reason}")
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
    present: Bools


# A place that is looked at, and its column; None where it is a text or an array.
_Place = tuple[int | None, Steps]


class _LockStep:
    def __init__(
        self, decoder: ProtobufDecoder, buffer: Bytes, start: Offsets, stop: Offsets, wanted: Wanted
    ) -> None:
        self._decoder, self._buffer = decoder, buffer
        self._start, self._stop = start, stop
        self._eight_bytes: Uint64s = np.ndarray((len(buffer) - 7,), "<u8", buffer, 0, (1,))
        self._batch = Batch(wanted, len(start))
        self._values = self._batch.values
        self._unusual = np.zeros(len(start), np.bool_)  # unusual: the library decides
        self._rounds = 0
        self._slots: list[_Slot] = []  # with elements that are counted
        places: list[_Place] = [*enumerate(wanted.numbers)]
        places += [(None, steps) for steps in (*wanted.said, *wanted.lengths)]
        self._root = self._node(decoder._type, (), places)

    def _node(self, kind: Any, path: Steps, places: list[_Place]) -> _Node:
        """What to do with a message at a place; `places` are the places in it that matter."""
        node = _Node({}, [], np.zeros(len(self._start), np.bool_))
        by_name: dict[str, list[_Place]] = {}
        for i, steps in places:
            by_name.setdefault(str(steps[len(path)]), []).append((i, steps))
        for name, members in by_name.items():
            f = kind.fields_by_name[name]
            slot = node.slots[f.number] = self._slot(f, (*path, name), members)
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
        for element, inner_places in inside.items():
            path = (*steps, element) if f.is_repeated else steps
            slot.inside[element] = self._node(f.message_type, path, inner_places)
        return slot

    def columns(self) -> tuple[Floats, list[MessageFault]]:
        """The columns, see Decoder."""
        self._message(self._root, np.arange(len(self._start)), self._start, self._stop)
        for slot in self._slots:
            if slot.expected:
                count, differs = slot.expected
                differs |= slot.count != count
        for row in np.flatnonzero(self._unusual).tolist():
            message = self._buffer[self._start[row] : self._stop[row]].tobytes()
            try:
                self._batch.put_tree(row, self._decoder.present(message))
            except UndecodableError as e:
                self._batch.refuse(row, str(e))
        return self._batch.finish()

    def _varint(self, p: Offsets) -> tuple[Uint64s, Offsets]:
        """Varints at p, and the offsets after them (_NOWHERE where one does not end)."""
        x = self._eight_bytes[p]
        if not (x & np.uint64(0x80)).any():
            return x & np.uint64(0x7F), p + 1
        stop = ~x & np.uint64(0x8080808080808080)
        mask = stop ^ (stop - np.uint64(1))  # the bytes up to the first with its top bit clear
        size = np.bitwise_count(mask).astype(np.int64) >> 3
        x = x & mask
        for payload_mask, move, shift in (
            (0x007F007F007F007F, 0x7F007F007F007F00, 1),
            (0x00003FFF00003FFF, 0x3FFF00003FFF0000, 2),
            (0x000000000FFFFFFF, 0x0FFFFFFF00000000, 4),
        ):
            x = (x & np.uint64(payload_mask)) | ((x & np.uint64(move)) >> np.uint64(shift))
        next_byte = p + size
        if len(long_rows := np.flatnonzero(stop == 0)):
            ninth = self._buffer[p[long_rows] + 8].astype(np.uint64)
            tenth = self._buffer[p[long_rows] + 9].astype(np.uint64)
            is_complete = ninth < 0x80
            x[long_rows] |= (ninth & np.uint64(0x7F)) << np.uint64(56)
            x[long_rows] |= np.where(is_complete, np.uint64(0), tenth << np.uint64(63))
            next_byte[long_rows] = np.where(
                is_complete, p[long_rows] + 9, np.where(tenth < 0x80, p[long_rows] + 10, _NOWHERE)
            )
        return x, next_byte

    def _message(self, node: _Node, rows: Offsets, p: Offsets, stop: Offsets) -> None:
        if node.present.any():  # a message in pieces
            self._unusual[rows] |= node.present[rows]
        for i in node.zeros:
            self._values[i, rows] = 0.0
        node.present[rows] = True
        while True:
            live = p < stop
            if not live.all():
                rows, p, stop = rows[live], p[live], stop[live]
            if not len(rows):
                return
            self._rounds += 1
            if self._rounds > _MOST_ROUNDS:
                self._unusual[rows] = True
                return
            tag, q = self._varint(p)
            lowest = tag.min()
            is_due = tag == lowest
            if is_due.all():
                p = self._field(node, int(lowest), rows, q, stop)
            else:
                p = p.copy()
                p[is_due] = self._field(node, int(lowest), rows[is_due], q[is_due], stop[is_due])
            if len(strange := np.flatnonzero((p > stop) | self._unusual[rows])):
                self._unusual[rows[strange]] = True
                p = np.where(self._unusual[rows], stop, p)

    def _field(self, node: _Node, tag: int, rows: Offsets, q: Offsets, stop: Offsets) -> Offsets:
        """Reads one field of the messages that have it next; returns the offsets after it."""
        number, wire = tag >> 3, tag & 7
        slot = node.slots.get(number)
        q, next_field, value = self._extent(wire if number else -1, np.minimum(q, stop), stop)
        if slot is None:
            return next_field
        packed = wire == _LEN and slot.wire in (_FIXED64, _FIXED32) and slot.count is not None
        if wire != slot.wire and not packed:
            next_field = np.full(len(q), _NOWHERE)
        if not (is_whole := next_field <= stop).all():
            self._unusual[rows[~is_whole]] = True
            rows, q, stop = rows[is_whole], q[is_whole], next_field[is_whole]
            value = value if value is None else value[is_whole]
        else:
            stop = next_field
        if packed and len(rows):
            self._packed(slot, rows, q, stop)
        elif len(rows):
            self._store(slot, rows, q, stop, value)
        return next_field

    def _extent(
        self, wire: int, q: Offsets, stop: Offsets
    ) -> tuple[Offsets, Offsets, Uint64s | None]:
        """Where values begin and end (_NOWHERE where they do not), and varints themselves."""
        if wire == _VARINT:
            value, next_field = self._varint(q)
            return q, next_field, value
        if wire == _FIXED64:
            return q, q + 8, None
        if wire == _FIXED32:
            return q, q + 4, None
        if wire == _LEN:
            length, q = self._varint(q)
            room = np.maximum(stop - q, -1)
            fits = (room >= 0) & (length <= np.maximum(room, 0).astype(np.uint64))
            return q, np.where(fits, q + length.astype(np.int64), _NOWHERE), None
        return q, np.full(len(q), _NOWHERE), None

    def _store(
        self, slot: _Slot, rows: Offsets, q: Offsets, stop: Offsets, value: Uint64s | None
    ) -> None:
        """Takes the values of single fields, or the next element of repeated ones."""
        numbers = self._numbers(slot.type, q, value) if slot.columns else None
        element = slot.count[rows] if slot.count is not None else np.zeros(1, np.int64)
        for k in (
            np.unique(element).tolist() if (element != element[0]).any() else [int(element[0])]
        ):
            rows_of_element: Any = element == k if len(element) == len(rows) else slice(None)
            if node := slot.inside.get(k):
                self._message(
                    node, rows[rows_of_element], q[rows_of_element], stop[rows_of_element]
                )
            if said := slot.said.get(k):
                differs = _other_text(
                    self._buffer, q[rows_of_element], (stop - q)[rows_of_element], said[0]
                )
                said[1][rows[rows_of_element]] |= differs & (stop > q)[rows_of_element]
            if (i := slot.columns.get(k)) is not None and numbers is not None:
                self._values[i, rows[rows_of_element]] = numbers[rows_of_element]
        if slot.count is not None:
            slot.count[rows] += 1

    def _packed(self, slot: _Slot, rows: Offsets, q: Offsets, stop: Offsets) -> None:
        """Takes the numbers of arrays whose elements have one size."""
        assert slot.count is not None
        count_before = slot.count[rows]
        size = 8 if slot.wire == _FIXED64 else 4
        count, remainder = np.divmod(stop - q, size)
        self._unusual[rows[remainder > 0]] = True
        for k, i in slot.columns.items():
            holds_element = (count_before <= k) & (k < count_before + count)
            element_start = (q + (k - count_before) * size)[holds_element]
            self._values[i, rows[holds_element]] = self._numbers(slot.type, element_start, None)
        slot.count[rows] += count

    def _numbers(self, kind: int, q: Offsets, value: Uint64s | None) -> NDArray[Any]:
        if dtype := _DTYPE.get(kind):
            size = np.dtype(dtype).itemsize
            view = np.ndarray((len(self._buffer) - size + 1,), dtype, self._buffer, 0, (1,))
            numbers: NDArray[Any] = view[q]
            return numbers
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
    differs: Bools = length != len(raw)
    if len(raw) and len(same_length := np.flatnonzero(~differs)):
        differs[same_length] = (
            sliding_window_view(buffer, len(raw))[start[same_length]] != raw
        ).any(1)
    return differs
