"""Protobuf messages, all messages of a batch one field at a time.

Writers put the fields of a message in the order of their numbers. So all messages of a batch
are read in lock-step: of the tags that come next, the lowest is taken from every message that
has it, and the others wait. What is unusual (groups, broken varints, very many fields) goes
message by message through the protobuf library, which also judges what is broken.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor as F
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.unknown_fields import UnknownFieldSet
from numpy.typing import NDArray

from ...core.model import Floats
from .fields import (
    DEEPEST,
    LONG_ARRAY,
    MOST_FIELDS,
    Bytes,
    Fault,
    Offsets,
    Opaque,
    Steps,
    Tree,
    UndecodableError,
    Wanted,
    inexact,
    label_fault,
    length_faults,
    other_text,
    rounded_faults,
    said_fault,
)

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
        return _tree(self._parse(message), (self._type,), [MOST_FIELDS])

    def know(self, tree: Tree) -> None:
        """Nothing: the schema says what messages hold."""

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

    def numbers(self, message: bytes, leaves: Sequence[Steps]) -> list[float]:
        """The wanted numbers of one message by the protobuf library, NaN where absent."""
        parsed = self._parse(message)
        return [_number(parsed, steps) for steps in leaves]


def _pool(data: bytes) -> DescriptorPool:
    """The files of a descriptor set, each after those it imports."""
    try:
        files = FileDescriptorSet.FromString(data).file
    except DecodeError as e:
        raise UndecodableError(f"schema is no FileDescriptorSet: {e}") from None
    waiting = {file.name: file for file in files}
    if len(waiting) < len(files):
        raise UndecodableError("schema defines a file twice")
    needs = {name: set(file.dependency) for name, file in waiting.items()}
    users: dict[str, list[str]] = {}
    for name, needed in needs.items():
        for other in needed:
            users.setdefault(other, []).append(name)
    ready = [name for name, needed in needs.items() if not needed]
    pool, added = DescriptorPool(), 0
    while ready:
        name = ready.pop()
        try:
            pool.Add(waiting[name])
        except TypeError as e:
            raise UndecodableError(f"schema file {name!r} is wrong: {e}") from None
        added += 1
        for user in users.get(name, ()):
            needs[user].discard(name)
            if not needs[user]:
                ready.append(user)
    if added < len(waiting):
        raise UndecodableError("schema imports files in a circle or files it does not hold")
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


def _tree(message: Any, above: tuple[Any, ...], left: list[int]) -> Tree:
    """A message as plain values.

    Args:
        message: it, parsed.
        above: the types of the messages it stands in, and its own.
        left: how many more fields may be shown, counted down: types that hold each other several
            times over make a tree that is wide where it is not deep.
    """
    if left[0] <= 0:
        return Opaque(f"behind {MOST_FIELDS} others")
    left[0] -= len(message.DESCRIPTOR.fields)
    tree: dict[str, Tree] = {}
    for f in message.DESCRIPTOR.fields:
        value = getattr(message, f.name)
        if _is_map(f):
            tree[f.name] = Opaque("a map")
        elif f.type == F.TYPE_BYTES:
            tree[f.name] = Opaque("bytes")
        elif f.is_repeated:
            some = value[: LONG_ARRAY + 1]
            if not some and not _numeric(f, set()):
                continue
            if f.type in _MESSAGES:
                tree[f.name] = [_tree(v, (*above, f.message_type), left) for v in some]
            else:
                tree[f.name] = list(some)
        elif f.type not in _MESSAGES:
            tree[f.name] = value
        elif message.HasField(f.name) or (f.message_type not in above and len(above) < DEEPEST):
            tree[f.name] = _tree(value, (*above, f.message_type), left)
        else:
            why = "holds itself" if f.message_type in above else "too deep"
            tree[f.name] = Opaque(f"absent at first, {why}")
    return tree


def _at(message: Any, steps: Steps, absent: Any) -> Any:
    """What a message holds at a place."""
    for step in steps:
        if isinstance(step, int):
            message = message[step] if step < len(message) else absent
        else:
            message = getattr(message, step, absent)
    return message


def _number(message: Any, steps: Steps) -> float:
    for step in steps:
        if isinstance(step, int):
            if step >= len(message):
                return float("nan")
            message = message[step]
        else:
            f = message.DESCRIPTOR.fields_by_name[step]
            if f.has_presence and not message.HasField(step):
                return float("nan")
            message = getattr(message, step)
    number: float = message
    return number


@dataclass(slots=True)
class _Slot:
    """What to do with one field of a message type."""

    type: int
    wire: int
    repeated: bool
    steps: Steps
    columns: dict[int, int] = field(default_factory=dict)  # element (0 if single) to column
    said: dict[int, Steps] = field(default_factory=dict)  # element (0 if single) to its place
    inside: dict[int, "_Node"] = field(default_factory=dict)  # element (0 if single) to message
    count: Offsets | None = None  # elements seen so far, per message of the batch
    labels: list[str] | None = None
    clears: list[int] = field(default_factory=list)  # columns of the same oneof's other members
    closed: NDArray[np.int64] | None = None  # all values it may have, where its enum says so


@dataclass(slots=True)
class _Node:
    """What to do with a message type at one place."""

    slots: dict[int, _Slot]
    zeros: list[int]  # columns that are 0 where the message is there and does not say more
    seen: NDArray[np.bool_]


class _LockStep:
    def __init__(
        self, decoder: ProtobufDecoder, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> None:
        self._decoder, self._buffer, self._wanted = decoder, buffer, wanted
        self._start, self._end = start, end
        self._words: Words = np.ndarray((len(buffer) - 7,), "<u8", buffer, 0, (1,))
        n = len(start)
        self._values = np.full((len(wanted.leaves), n), np.nan)
        self._rounded = np.zeros(self._values.shape, np.bool_)
        self._odd = np.zeros(n, np.bool_)  # unusual: the library decides
        self._rounds = 0
        self._slots: list[_Slot] = []
        self._relabelled = {steps: np.zeros(n, np.bool_) for steps in wanted.labels}
        self._resaid = {steps: np.zeros(n, np.bool_) for steps in wanted.said}
        self._terminators: Offsets | None = None
        texts = [(-1, steps) for steps in wanted.said]
        texts += [(-2, steps) for steps, length in wanted.lengths.items() if not length]
        self._root = self._node(decoder._type, (), [*enumerate(wanted.leaves), *texts])

    def _node(self, kind: Any, at: Steps, below: list[tuple[int, Steps]]) -> _Node:  # noqa: C901, PLR0912
        node = _Node({}, [], np.zeros(len(self._start), np.bool_))
        depth = len(at)
        by_name: dict[str, list[tuple[int, Steps]]] = {}
        for i, steps in below:
            by_name.setdefault(str(steps[depth]), []).append((i, steps))
        for f in kind.fields:
            steps = (*at, f.name)
            repeated = f.is_repeated
            slot = _Slot(f.type, _WIRE.get(f.type, _VARINT), repeated, steps)
            mine = by_name.get(f.name, [])
            inner = [one for one in mine if one != (-2, steps)]
            if f.type in _MESSAGES:
                groups: dict[int, list[tuple[int, Steps]]] = {}
                for i, leaf in inner:
                    element = leaf[depth + 1] if repeated else 0
                    assert isinstance(element, int)
                    groups.setdefault(element, []).append((i, leaf))
                for element, leaves in groups.items():
                    place = (*steps, element) if repeated else steps
                    slot.inside[element] = self._node(f.message_type, place, leaves)
            else:
                for i, leaf in inner:
                    element = leaf[-1] if repeated else 0
                    assert isinstance(element, int)
                    if i < 0:
                        slot.said[element] = leaf
                    else:
                        slot.columns[element] = i
                if slot.columns and not repeated and not f.has_presence:
                    node.zeros += slot.columns.values()
            slot.labels = self._wanted.labels.get(steps)
            if repeated and (mine or slot.labels):
                slot.count = np.zeros(len(self._start), np.int64)
            if mine or slot.labels:
                self._slots.append(slot)
            if f.containing_oneof is not None:
                others = {o.name for o in f.containing_oneof.fields} - {f.name}
                slot.clears = [i for name in others for i, _ in by_name.get(name, []) if i >= 0]
            if f.type == F.TYPE_ENUM and f.enum_type.is_closed:
                slot.closed = np.array(list(f.enum_type.values_by_number))
            node.slots[f.number] = slot
        return node

    def columns(self) -> tuple[Floats, list[Fault]]:
        n = len(self._start)
        self._message(self._root, np.arange(n), self._start, self._end)
        faults: list[Fault] = []
        bad: dict[str, list[int]] = {}
        odd = np.flatnonzero(self._odd)
        for i in odd.tolist():
            message = self._buffer[self._start[i] : self._end[i]].tobytes()
            try:
                for k, number in enumerate(self._decoder.numbers(message, self._wanted.leaves)):
                    self._put(None, k, np.array([i]), np.array([number]))
                self._recount(message, i)
            except UndecodableError as e:
                self._values[:, i] = np.nan
                bad.setdefault(str(e), []).append(i)
        good = np.ones(n, np.bool_)
        for text, rows in bad.items():
            faults.append(Fault("mcap-bad-message", np.array(rows), "", text))
            good[rows] = False
        faults += rounded_faults(self._wanted, self._rounded & good)
        for slot in self._slots:
            if slot.count is None:
                continue
            if slot.labels is not None:
                self._relabelled[slot.steps] |= slot.count != len(slot.labels)
            expected = self._wanted.lengths.get(slot.steps)
            count = slot.count if expected is None else np.where(good, slot.count, expected)
            faults += length_faults(self._wanted, slot.steps, count, n)
        faults += [
            label_fault(self._wanted, steps, other & good, self._values)
            for steps, other in self._relabelled.items()
            if (other & good).any()
        ]
        faults += [
            said_fault(self._wanted, steps, other & good, self._values)
            for steps, other in self._resaid.items()
            if (other & good).any()
        ]
        return self._values, faults

    def _recount(self, message: bytes, row: int) -> None:
        """Array lengths, names and units of a message that the library read."""
        parsed = self._decoder._parse(message)
        for steps, other in self._resaid.items():
            other[row] = _at(parsed, steps, "") not in ("", self._wanted.said[steps].text)
        for slot in self._slots:
            if slot.count is None:
                continue
            array = _at(parsed, slot.steps, ())
            slot.count[row] = len(array)
            if slot.labels is not None:
                self._relabelled[slot.steps][row] = list(array) != slot.labels

    def _varint(self, p: Offsets) -> tuple[Words, Offsets]:
        """Varints at p, and the offsets behind them (_NOWHERE where one does not end)."""
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
        fresh = rows[~node.seen[rows]] if node.seen.any() else rows
        for i in node.zeros:
            self._values[i, fresh] = 0.0
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
        """Reads one field of the messages that have it next; returns the offsets behind it."""
        number, wire = tag >> 3, tag & 7
        slot = node.slots.get(number)
        q = np.minimum(q, end)
        value: Words | None = None
        if wire == _VARINT:
            value, after = self._varint(q)
        elif wire == _FIXED64:
            after = q + 8
        elif wire == _FIXED32:
            after = q + 4
        elif wire == _LEN:
            length, q = self._varint(q)
            room = np.maximum(end - q, -1)
            fits = (room >= 0) & (length <= np.maximum(room, 0).astype(np.uint64))
            after = np.where(fits, q + length.astype(np.int64), _NOWHERE)
        else:
            after = np.full(len(q), _NOWHERE)
        if number == 0:
            after = np.full(len(q), _NOWHERE)
        if slot is None:
            return after
        packed = wire == _LEN and slot.wire not in (_LEN, 3) and slot.repeated
        if wire != slot.wire and not packed:
            after = np.full(len(q), _NOWHERE)
        if not (slot.columns or slot.inside or slot.said or slot.count is not None or slot.clears):
            return after
        if not (whole := after <= end).all():
            self._odd[rows[~whole]] = True
            rows, q, end = rows[whole], q[whole], after[whole]
            value = value if value is None else value[whole]
        else:
            end = after
        if len(rows):
            self._store(slot, rows, q, end, value, packed)
        return after

    def _store(
        self,
        slot: _Slot,
        rows: Offsets,
        q: Offsets,
        end: Offsets,
        value: Words | None,
        packed: bool,
    ) -> None:
        for i in slot.clears:
            self._values[i, rows] = np.nan
        if slot.inside or slot.type in _MESSAGES:
            self._each(slot, rows, lambda k, r, pick: self._inside(slot, k, r, q[pick], end[pick]))
        elif slot.type in _TEXTS:
            self._each(slot, rows, lambda k, r, pick: self._label(slot, k, r, q[pick], end[pick]))
        elif packed:
            self._packed(slot, rows, q, end)
        else:
            numbers = self._numbers(slot.type, q, value)

            def put(k: int, r: Offsets, pick: Any) -> None:
                if (i := slot.columns.get(k)) is not None:
                    self._put(slot, i, r, numbers[pick])

            self._each(slot, rows, put)

    def _put(self, slot: _Slot | None, i: int, rows: Offsets, numbers: NDArray[Any]) -> None:
        self._values[i, rows] = numbers
        if slot and slot.closed is not None:  # to the library another value is none at all
            self._odd[rows[~np.isin(numbers, slot.closed)]] = True
        if numbers.dtype.kind in "iu":
            self._rounded[i, rows] = inexact(numbers)

    def _each(self, slot: _Slot, rows: Offsets, put: Any) -> None:
        """Hands on rows by the number of the element they are at."""
        if slot.count is None:
            put(0, rows, slice(None))
            return
        at = slot.count[rows]
        if (at == at[0]).all():
            put(int(at[0]), rows, slice(None))
        else:
            for k in np.unique(at).tolist():
                pick = at == k
                put(k, rows[pick], pick)
        slot.count[rows] += 1

    def _inside(self, slot: _Slot, k: int, rows: Offsets, q: Offsets, end: Offsets) -> None:
        if node := slot.inside.get(k):
            self._message(node, rows, q, end)

    def _label(self, slot: _Slot, k: int, rows: Offsets, q: Offsets, end: Offsets) -> None:
        if slot.labels is not None and k < len(slot.labels):
            other = other_text(self._buffer, q, end - q, slot.labels[k])
            self._relabelled[slot.steps][rows] |= other
        if place := slot.said.get(k):
            text = self._wanted.said[place].text
            other = (end > q) & other_text(self._buffer, q, end - q, text)
            self._resaid[place][rows] = other

    def _packed(self, slot: _Slot, rows: Offsets, q: Offsets, end: Offsets) -> None:
        assert slot.count is not None
        before = slot.count[rows]
        if dtype := _DTYPE.get(slot.type):
            size = np.dtype(dtype).itemsize
            count, rest = np.divmod(end - q, size)
            if rest.any():
                self._odd[rows[rest > 0]] = True
        else:
            if self._terminators is None:
                self._terminators = np.flatnonzero(self._buffer < 0x80)
            first = np.searchsorted(self._terminators, q)
            count = np.searchsorted(self._terminators, end) - first
            broken = (end > q) & (self._buffer[end - 1] >= 0x80)
            if broken.any():
                self._odd[rows[broken]] = True
        for k, i in slot.columns.items():
            has = (before <= k) & (k < before + count)
            if not has.any():
                continue
            element = (k - before)[has]
            if dtype:
                where, value = q[has] + element * size, None
            else:
                assert self._terminators is not None
                last = self._terminators[first[has] + element - 1]
                where = np.where(element > 0, last + 1, q[has])
                value, after = self._varint(where)
                self._odd[rows[has][after > end[has]]] = True
            self._put(slot, i, rows[has], self._numbers(slot.type, where, value))
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
