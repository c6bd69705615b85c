"""ROS 2 messages (CDR) with a ros2msg schema, all messages of a batch one field at a time."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.model import Bools, Floats
from .fields import (
    DEEPEST,
    LONG_ARRAY,
    PADDING,
    Bytes,
    Fault,
    Offsets,
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

_DTYPES = {
    "bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2",
    "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_FIELD = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:(?<=\bstring)<=\d+)?"
    r"(?P<array>\[(?P<bound><=)?(?P<size>\d{0,10})\])?"
    r"\s+(?P<name>[A-Za-z]\w*)(?:(?P<constant>\s*=.*)|\s+(?P<default>.*))?"
)
_CONSTANT = re.compile(r"[A-Z][A-Z0-9_]*")
_VALUE = re.compile(r"[-+]?(\.?\d[-+.\w]*|inf|nan)|true|false|\[[^]]*\]", re.IGNORECASE)
_UNIT = re.compile(r"\[([^][,\d][^][,]*)\]")  # as rosidl reads units: "# ... [bar]"
_MOST_ELEMENTS = 4096  # of an array of messages or strings, which is walked one by one
_MOST_MESSAGES = 16384  # inside one message
_SPARE = 8  # bytes behind a message that no alignment explains
_WIDEST = 4096  # bytes of messages that are compared with one another
_TIME = "uint32 sec\nuint32 nanosec"

_Place = int | Offsets  # alike in all messages of a batch, or one per message


@dataclass(frozen=True, slots=True)
class _Member:
    name: str
    type: str  # a key of _DTYPES, "string", or "package/Name"
    size: int | None  # elements, 0 for as many as the message says, None for no array
    unit: str


class Ros2Decoder:
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
        self._types: dict[str, tuple[_Member, ...]] = {}
        self._layouts: dict[int, _Layout] = {}  # by the identity of what is wanted
        lines = "\n".join(line for line in text.splitlines() if line.strip())
        current, self._root = name, _short(name)
        for part in re.split(r"^={3,}\s*$", lines, flags=re.MULTILINE):
            if said := re.match(r"\s*MSG:\s+(\S+)\s*$", part, flags=re.MULTILINE):
                current, part = said.group(1), part[said.end() :]
            kind = _short(current)
            members = _members(kind.split("/")[0], part)
            if self._types.setdefault(kind, members) != members:
                raise UndecodableError(f"type {kind} is defined in two ways")
        for n in ("Time", "Duration"):
            self._types.setdefault(f"builtin_interfaces/{n}", _members("", _TIME))
        self._check(self._root, (), set())

    def _check(self, kind: str, above: tuple[str, ...], done: set[str]) -> None:
        if kind not in self._types:
            raise UndecodableError(f"type {kind} is not defined")
        if kind in above or len(above) > DEEPEST:
            raise UndecodableError(f"type {kind} contains itself or nests too deep")
        for member in self._types[kind]:
            if member.type not in _DTYPES and member.type != "string" and member.type not in done:
                self._check(member.type, (*above, kind), done)
        done.add(kind)

    def tree(self, message: bytes) -> Tree:  # noqa: C901
        """One message as plain values; long arrays are cut after LONG_ARRAY + 1 elements."""
        buffer = np.zeros(len(message) + PADDING, np.uint8)
        buffer[: len(message)] = np.frombuffer(message, np.uint8)
        root: dict[str, Tree] = {}

        def put(steps: Steps, value: Tree) -> None:
            node: Any = root
            for step, after in zip(steps, (*steps[1:], None), strict=True):
                new = value if after is None else [] if isinstance(after, int) else {}
                if isinstance(step, str):
                    node = node.setdefault(step, new)
                else:
                    if step == len(node):
                        node.append(new)
                    node = node[step]

        def scalars(steps: Steps, dtype: str, where: Offsets, count: _Place) -> None:
            for k in range(min(int(np.max(count)), LONG_ARRAY + 1)):
                value = walk.gather(dtype, where + k * np.dtype(dtype).itemsize)[0].item()
                put((*steps, k), value)

        def scalar(steps: Steps, dtype: str, where: Offsets) -> None:
            put(steps, walk.gather(dtype, where)[0].item())

        def text(steps: Steps, where: Offsets, length: Offsets) -> None:
            raw = message[where[0] : where[0] + max(length[0] - 1, 0)]
            try:
                put(steps, raw.decode())
            except UnicodeDecodeError as e:
                raise UndecodableError(f"a string is not UTF-8: {e}") from e

        def array(steps: Steps, kind: str, count: _Place) -> None:
            if self._numeric(kind):  # others are put with their elements
                put(steps, [])

        walk = _Walk(
            self._types, buffer, np.zeros(1, np.int64), np.array([len(message)]),
            scalar, scalars, text, array,
        )  # fmt: skip
        walk.message(self._root, ())
        if walk.bad[0]:
            raise UndecodableError(walk.why)
        return root

    def _numeric(self, kind: str) -> bool:
        """Whether a type holds a number."""
        return kind in _DTYPES or any(self._numeric(m.type) for m in self._types.get(kind, ()))

    def know(self, tree: Tree) -> None:
        """Nothing: the schema says what messages hold."""

    def unit(self, steps: Steps) -> tuple[str, str]:
        """The unit in square brackets in the comment behind a field, as rosidl reads it."""
        kind, unit = self._root, ""
        for step in steps:
            if isinstance(step, str):
                member = next((m for m in self._types.get(kind, ()) if m.name == step), None)
                if member is None:
                    return "", ""
                kind, unit = member.type, member.unit
        return unit, "schema comment" if unit else ""

    def columns(
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[Fault]]:
        """Many messages at once, see Decoder.

        Those laid out as one before are read at its places, the others are walked.
        """
        layout = self._layouts.pop(id(wanted), None)
        layout = layout or self._layout(buffer, start[:1], end[:1], wanted)
        if layout is None:
            return self._walked(buffer, start, end, wanted)
        same, messages = layout.alike(buffer, start, end)
        if not len(same):
            return self._walked(buffer, start, end, wanted)  # and the next time another layout
        self._layouts[id(wanted)] = layout
        found, lost = layout.numbers(messages)
        faults = [replace(f, rows=same[f.rows]) for f in rounded_faults(wanted, lost)]
        if len(same) == len(start):
            return found, faults
        values = np.empty((len(wanted.leaves), len(start)))
        values[:, same] = found
        odd = np.delete(np.arange(len(start)), same)
        values[:, odd], more = self._walked(buffer, start[odd], end[odd], wanted)
        return values, faults + [replace(f, rows=odd[f.rows]) for f in more]

    def _layout(
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> "_Layout | None":
        """How one message is laid out; None where it has a fault or is long."""
        if any(f.code != "mcap-rounded" for f in self._walked(buffer, start, end, wanted)[1]):
            return None
        first = int(start[0])
        places: dict[Steps, tuple[str, int]] = {}
        decide = [(first + 1, 1)]  # offset and length; the byte order

        def scalar(steps: Steps, dtype: str, where: Offsets) -> None:
            places[steps] = dtype, int(where[0]) - first

        def scalars(steps: Steps, dtype: str, where: Offsets, count: _Place) -> None:
            for k in range(min(int(np.max(count)), LONG_ARRAY)):
                places[*steps, k] = dtype, int(where[0]) - first + k * np.dtype(dtype).itemsize

        def text(steps: Steps, where: Offsets, length: Offsets) -> None:
            if steps in wanted.said or steps[:-1] in wanted.labels:
                decide.append((int(where[0]), int(length[0])))

        walk = _TracedWalk(self._types, buffer, start, end, scalar, scalars, text, lambda *_: None)
        walk.message(self._root, ())
        decide += [(at, 4) for at in walk.lengths]
        of = [places.get(steps) for steps in wanted.leaves]
        ends = [at - first + length for at, length in decide]
        ends += [place[1] + np.dtype(place[0]).itemsize for place in of if place]
        width = -(-max(ends) // 8) * 8
        if width > _WIDEST:
            return None
        mask = np.zeros(width, np.uint8)
        for at, length in decide:
            mask[at - first : at - first + length] = 0xFF
        said = buffer[first : first + width] & mask
        return _Layout(
            wanted, walk.behind - first, of, mask.view(np.uint64), said.view(np.uint64), walk.order
        )

    def _walked(
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[Fault]]:
        kind = buffer[start + 1]  # of the encapsulation: 0 big-endian, 1 little-endian
        kind[end - start < 4] = 0xFF
        if (kind == kind[0]).all() and kind[0] <= 1:
            return self._same_order(buffer, start, end, wanted)
        values = np.full((len(wanted.leaves), len(start)), np.nan)
        faults = []
        for value in (0, 1):
            if len(rows := np.flatnonzero(kind == value)):
                values[:, rows], found = self._same_order(buffer, start[rows], end[rows], wanted)
                faults += [replace(f, rows=rows[f.rows]) for f in found]
        if len(rows := np.flatnonzero(kind > 1)):
            faults.append(Fault("mcap-bad-message", rows, "", "no plain CDR encapsulation"))
        return values, faults

    def _same_order(  # noqa: C901
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[Fault]]:
        values = np.full((len(wanted.leaves), len(start)), np.nan)
        rounded = np.zeros(values.shape, np.bool_)
        faults: list[Fault] = []
        scalars_at: dict[Steps, int] = {}
        arrays_at: dict[Steps, dict[int, int]] = {}
        for i, steps in enumerate(wanted.leaves):
            if isinstance(steps[-1], int):
                arrays_at.setdefault(steps[:-1], {})[steps[-1]] = i
            else:
                scalars_at[steps] = i
        relabelled = {steps: np.zeros(len(start), np.bool_) for steps in wanted.labels}
        resaid = {steps: np.zeros(len(start), np.bool_) for steps in wanted.said}

        def put(i: int, dtype: str, where: Offsets, has: Bools | bool) -> None:
            new = walk.gather(dtype, where)
            np.copyto(values[i], new, where=has)
            if new.dtype.kind in "iu":
                np.copyto(rounded[i], inexact(new), where=has)

        def scalar(steps: Steps, dtype: str, where: Offsets) -> None:
            if (i := scalars_at.get(steps)) is not None:
                put(i, dtype, where, True if walk.active is None else walk.active)

        def scalars(steps: Steps, dtype: str, where: Offsets, count: _Place) -> None:
            for k, i in arrays_at.get(steps, {}).items():
                has = np.greater(count, k) if walk.active is None else (count > k) & walk.active
                if has is False or not np.any(has):
                    continue
                put(i, dtype, np.where(has, where + k * np.dtype(dtype).itemsize, 0), has)

        def text(steps: Steps, where: Offsets, length: Offsets) -> None:
            length = np.maximum(length - 1, 0)  # without the 0 behind it
            if said := wanted.said.get(steps):
                other = (length > 0) & other_text(buffer, where, length, said.text)
                resaid[steps] |= other if walk.active is None else other & walk.active
            if steps and isinstance(steps[-1], int) and (named := wanted.labels.get(steps[:-1])):
                k = steps[-1]
                if k < len(named):
                    other = other_text(buffer, where, length, named[k])
                    relabelled[steps[:-1]] |= other if walk.active is None else other & walk.active

        def array(steps: Steps, kind: str, count: _Place) -> None:
            faults.extend(length_faults(wanted, steps, count, len(start)))
            if (named := wanted.labels.get(steps)) is not None:
                relabelled[steps] |= np.not_equal(count, len(named))

        walk = _Walk(self._types, buffer, start, end, scalar, scalars, text, array)
        walk.message(self._root, ())
        faults += [
            label_fault(wanted, steps, other & ~walk.bad, values)
            for steps, other in relabelled.items()
            if (other & ~walk.bad).any()
        ]
        faults += [
            said_fault(wanted, steps, other & ~walk.bad, values)
            for steps, other in resaid.items()
            if (other & ~walk.bad).any()
        ]
        faults += rounded_faults(wanted, rounded & ~walk.bad)
        if len(long := np.flatnonzero(~walk.bad & (walk.left >= _SPARE))):
            faults.append(Fault("mcap-long-message", long))
        if walk.bad.any():
            bad = np.flatnonzero(walk.bad)
            values[:, bad] = np.nan
            faults = [
                replace(f, rows=kept) for f in faults if len(kept := np.setdiff1d(f.rows, bad))
            ]
            faults.append(Fault("mcap-bad-message", bad, "", walk.why))
        return values, faults


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where the wanted numbers stand in messages that are laid out alike.

    That is decided by their byte order and the lengths in them. The strings that say what is
    wanted decide too, as a message that says another is at fault.
    """

    wanted: Wanted
    size: int  # bytes that such a message has, few more aside
    places: list[tuple[str, int] | None]  # of the wanted numbers: type, offset
    mask: NDArray[np.uint64]  # set where bytes decide, shape (w,)
    said: NDArray[np.uint64]  # what they are, shape (w,)
    order: str  # of the bytes, "<" or ">"

    def alike(
        self, buffer: Bytes, start: Offsets, end: Offsets
    ) -> tuple[Offsets, NDArray[np.uint64]]:
        """Which messages are laid out so, and their bytes, shape (n, w)."""
        more = end - start - self.size
        rows = np.flatnonzero((more >= 0) & (more < _SPARE))
        width = self.mask.nbytes
        if not len(rows):
            return rows, np.empty((0, len(self.mask)), np.uint64)
        view = np.ndarray((len(buffer) - width + 1,), f"V{width}", buffer, 0, (1,))
        messages = view[start[rows]].view(np.uint64).reshape(len(rows), len(self.mask))
        other = (messages & self.mask) != self.said
        if other.any():
            alike = ~other.any(axis=1)
            rows, messages = rows[alike], messages[alike]
        return rows, messages

    def numbers(self, messages: NDArray[np.uint64]) -> tuple[Floats, Bools]:
        """The wanted numbers of such messages and which are `inexact`, each of shape (k, n)."""
        values = np.full((len(self.places), len(messages)), np.nan)
        lost = np.zeros(values.shape, np.bool_)
        for i, (dtype, offset) in ((i, place) for i, place in enumerate(self.places) if place):
            kind = "u1" if dtype == "?" else self.order + dtype
            new = np.ndarray((len(messages),), kind, messages.data, offset, messages.strides[:1])
            values[i] = new != 0 if dtype == "?" else new
            lost[i] = new.dtype.kind in "iu" and inexact(new)
        return values, lost


class _Walk:
    """The place in every message of a batch, moved on together, field by field.

    A message that ends too early is marked bad and stays at its end; loads for it are from
    offset 0 and are thrown away.
    """

    def __init__(  # noqa: PLR0913
        self,
        types: dict[str, tuple[_Member, ...]],
        buffer: Bytes,
        start: Offsets,
        end: Offsets,
        scalar: Callable[[Steps, str, Offsets], None],
        scalars: Callable[[Steps, str, Offsets, _Place], None],
        text: Callable[[Steps, Offsets, Offsets], None],
        array: Callable[[Steps, str, _Place], None],
    ) -> None:
        self._types, self._buffer = types, buffer
        self._base = start + 4  # alignment counts from behind the encapsulation header
        self._room = np.maximum(end - self._base, 0)
        self._least = int(self._room.min())
        self._pos: _Place = 0
        self._scalar, self._scalars, self._text, self._array = scalar, scalars, text, array
        self.active: Bools | None = None  # messages that have the array element being walked
        self.bad = end - start < 4
        self.why = "message is shorter than its schema says"
        self._messages = 0
        self.order = ">" if len(buffer) and buffer[start[0] + 1] == 0 else "<"

    @property
    def left(self) -> Offsets:
        """Bytes behind what was walked."""
        left: Offsets = self._room - self._pos
        return left

    def gather(self, dtype: str, where: Offsets) -> NDArray[Any]:
        """Numbers at any offsets, aligned or not."""
        if dtype == "?":
            truth: Bools = self._buffer[where] != 0
            return truth
        size = np.dtype(dtype).itemsize
        view = np.ndarray(
            (len(self._buffer) - size + 1,), self.order + dtype, self._buffer, 0, (1,)
        )
        found: NDArray[Any] = view[where]
        return found

    def _take(self, size: int, count: _Place = 1) -> Offsets:
        """Moves on over `count` aligned numbers of a size; returns where they start."""
        pos = self._pos + -self._pos % size
        if not isinstance(count, int):
            pos = np.where(count > 0, pos, self._pos)  # no padding before no element
        elif count == 0:
            pos = self._pos
        after = pos + size * count
        where = self._base + pos
        if isinstance(after, int) and after <= self._least and self.active is None:
            self._pos = after
            return where
        short = after > self._room
        if self.active is not None:
            short &= self.active
        if np.any(short):
            self.bad = self.bad | short
            after = np.where(short, self._room, after)
        where = np.where(self.bad | (after > self._room), 0, where)
        if self.active is not None:
            after = np.where(self.active, after, self._pos)
        self._pos = after
        return where

    def _length(self) -> Offsets:
        length = self.gather("u4", self._take(4)).astype(np.int64)
        length[self.bad] = 0
        if self.active is not None:
            length[~self.active] = 0
        return length

    def message(self, kind: str, steps: Steps) -> None:
        """Walks one message, or one message inside another."""
        self._messages += 1
        if self._messages > _MOST_MESSAGES and not self.bad.all():
            self.bad, self.why = np.ones_like(self.bad), "too many messages in a message"
        if self.bad.all():
            return
        members = self._types[kind]
        if not members:
            self._take(1)  # rosidl gives an empty message one byte
        for member in members:
            at = (*steps, member.name)
            if member.size is None:
                self._one(member.type, at)
            else:
                self._many(member.type, member.size, at)

    def _one(self, kind: str, steps: Steps) -> None:
        if kind == "string":
            length = self._length()
            uniform = self.active is None and bool((length == length[0]).all())
            where = self._take(1, int(length[0]) if uniform else length)
            self._text(steps, where, np.where(self.bad, 0, length))
        elif dtype := _DTYPES.get(kind):
            where = self._take(np.dtype(dtype).itemsize)
            self._scalar(steps, dtype, where)
        else:
            self.message(kind, steps)

    def _many(self, kind: str, size: int, steps: Steps) -> None:
        count: _Place = size
        if not size:
            counts = self._length()
            uniform = self.active is None and bool((counts == counts[0]).all())
            count = int(counts[0]) if uniform else counts
        self._array(steps, kind, count)
        if dtype := _DTYPES.get(kind):
            where = self._take(np.dtype(dtype).itemsize, count)
            if self.bad.any():
                count = np.where(self.bad, 0, count)
            self._scalars(steps, dtype, where, count)
            return
        outer = self.active
        # every element has at least one byte, so more elements than bytes are none
        over = np.broadcast_to(
            np.greater(count, np.minimum(self._room, _MOST_ELEMENTS)), self.bad.shape
        )
        if outer is not None:
            over = over & outer
        if over.any():
            self.bad = self.bad | over
            self.why = (
                f"too many elements in an array of {kind}, or message shorter than its schema says"
            )
            count = np.where(self.bad, 0, count)
        for k in range(int(np.max(count))):
            if not isinstance(count, int):
                self.active = (count > k) & ~self.bad
                if outer is not None:
                    self.active = self.active & outer
                if not self.active.any():
                    break
            elif self.bad.all():
                break
            self._one(kind, (*steps, k))
        self.active = outer


class _TracedWalk(_Walk):
    """A walk over one message that keeps where the lengths in it stand."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.lengths: list[int] = []

    @property
    def behind(self) -> int:
        """The offset behind what was walked."""
        return int((self._base + self._pos)[0])

    def _length(self) -> Offsets:
        length = super()._length()
        self.lengths.append(self.behind - 4)
        return length


def _short(name: str) -> str:
    """The name without its middle part: "package/Name" of "package/msg/Name"."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def _members(package: str, text: str) -> tuple[_Member, ...]:
    members = []
    for line in text.splitlines():
        code = line.partition("#")[0].strip()
        if not code:
            continue
        found = _FIELD.fullmatch(code)
        if not found or not _is_said(found):
            raise UndecodableError(f"schema line not understood: {line.strip()[:80]!r}")
        if found["constant"]:
            continue
        kind = found["type"]
        if kind not in _DTYPES and kind != "string":
            if kind in ("wstring", "time", "duration"):
                raise UndecodableError(f"type {kind} is not read")
            kind = _short(kind) if "/" in kind else f"{package}/{kind}"
        size = None
        if found["array"]:
            size = 0 if found["bound"] else int(found["size"] or 0)
            if found["size"] and int(found["size"]) == 0:
                raise UndecodableError(f"array without elements: {line.strip()[:80]!r}")
        units = _UNIT.findall(line.partition("#")[2])
        members.append(_Member(found["name"], kind, size, units[-1] if units else ""))
    if len({m.name for m in members}) < len(members):
        raise UndecodableError("a field name occurs twice")
    return tuple(members)


def _is_said(line: re.Match[str]) -> bool:
    """Whether what a line says behind the name is a value as rosidl takes it.

    Two lines run into one, or an "=" too many, would leave a field out: all behind it were read
    at wrong places.
    """
    of, value = line["type"], line["default"]
    if line["constant"]:
        if not _CONSTANT.fullmatch(line["name"]):
            return False
        value = line["constant"].lstrip(" \t=")
    return not value or of == "string" or (of in _DTYPES and bool(_VALUE.fullmatch(value)))
