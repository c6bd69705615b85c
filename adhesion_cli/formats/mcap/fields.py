"""A message as a tree of plain values, and the numbers in it: alike for every MCAP encoding."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import islice, zip_longest
from typing import Any, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...core.model import Bools, Floats, Times

Tree = Any  # dict[str, Tree] | list[Tree] | float | int | bool | str | Opaque | None
Steps = tuple[str | int, ...]  # the way from the root of a message to a value
Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]
Units = Callable[[Steps], tuple[str, str]]  # unit and where it stood, ("", "") if nowhere

LONG_ARRAY = 256  # longer arrays (images, point clouds) are not offered as scalar series
MOST_LEAVES = 4096  # scalar series of one channel
MOST_FIELDS = 1 << 16  # of one message, of whatever kind, before the messages in it stay closed
DEEPEST = 32  # levels of a message
_LONGEST = 1000  # characters of a place
_LONGEST_UNIT = 100  # characters of a unit
_NUMBER = re.compile(r"[+-]?[0-9]+([.,][0-9]*)?([eE][+-]?[0-9]{1,3})?")
_MANY_KEYS = 1024  # of JSON messages, taken together; more are names only where ...
_EVER_NEW = 16  # ... a message has at least one of so many
EXACT = 1 << 53  # up to here every integer is a double
PADDING = 16  # bytes that follow the last message in a buffer, so that wide loads stay inside

_STAMPS = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"), ("secs", "nsecs"))
_STAMP_AT: tuple[Steps, ...] = (
    ("header", "stamp"),
    ("header", "timestamp"),
    ("timestamp",),
    ("stamp",),
    ("time",),
    ("ts",),
)
_SECOND = 10**9
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_CALENDAR = (631_152_000 * 10**6, 4_102_444_800 * 10**6)  # 1990 to 2100 [us]
_UNITS = (1e6, 1e3, 1.0, 1e-3)  # microseconds in what clocks count: s, ms, us, ns


class UndecodableError(Exception):
    """A schema or a message that is not what it says it is."""


@dataclass(frozen=True, slots=True)
class Opaque:
    """A field that may hold numbers and is not read."""

    kind: str


@dataclass(frozen=True, slots=True)
class Leaf:
    """One number of a message: where it is, and what the message itself says about it."""

    steps: Steps
    label: str = ""
    unit: str = ""
    unit_from: str = ""
    label_at: Steps = ()  # the string that is the label; () where it is an array's, or none
    unit_at: Steps = ()  # the string that is the unit; () where no string of the message is

    @property
    def path(self) -> str:
        """The place as users write it: "joints[1].position"."""
        return path(self.steps)


@dataclass(frozen=True, slots=True)
class Fault:
    """What decoding had to leave out, of which messages of the batch."""

    code: str
    rows: Offsets
    field: str = ""  # its place in the message, where it is about one
    reason: str = ""  # why the messages do not decode


@dataclass(frozen=True, slots=True)
class Stamp:
    """Where messages keep their own time: seconds and nanoseconds, or one number or text."""

    places: tuple[Steps, ...]
    unit: float = 0.0  # microseconds in the unit of one number
    text: bool = False  # ISO 8601, which decoders give as microseconds since 1970
    zero: bool = False  # a pair of zeros is a time as any other, not a stamp that was not set

    def times(self, values: Floats) -> tuple[Times, Bools]:
        """Stamps [ns] from values of shape (len(places), n), and which of them are stamps.

        One number is taken to the microsecond, which is what a double carries.
        """
        if len(self.places) == 2:
            seconds, nanos = values
            known = (np.abs(seconds) < 9e9) & (np.abs(nanos) < 4.3e9)  # not NaN, fits 64 bits
            if not self.zero:
                known &= (seconds != 0) | (nanos != 0)
            own = np.where(known, seconds, 0).astype(np.int64) * _SECOND
            return own + np.where(known, nanos, 0).astype(np.int64), known
        micros = np.rint(values[0] * self.unit)
        known = (micros >= _CALENDAR[0]) & (micros < _CALENDAR[1])
        return np.where(known, micros, 0).astype(np.int64) * 1000, known

    def first(self, tree: Tree) -> int:
        """The stamp of one message [ns], 0 where it has none."""
        found = [at(tree, steps) for steps in self.places]
        if self.text:
            found = [microseconds(text) for text in found]
        values = [[float(v)] if is_number(v) else [np.nan] for v in found]
        return int(self.times(np.array(values))[0][0])


@dataclass(frozen=True, slots=True)
class Said:
    """A string of the first message that gives wanted numbers their unit or name."""

    text: str
    leaves: list[int]  # whose it is, in the order of Wanted.leaves


@dataclass(frozen=True, slots=True)
class Wanted:
    """The numbers asked for, and what the first message said that later ones must repeat."""

    leaves: Sequence[Steps]
    asked: int  # how many of them are; those behind are the stamp
    lengths: dict[Steps, int]  # of the arrays that hold wanted numbers, or nothing at first
    labels: dict[Steps, list[str]]  # of the string arrays that name elements of such arrays
    said: dict[Steps, Said]
    iso: Steps | None = None  # the one of `leaves` that is a time as text

    def under(self, parent: Steps) -> list[int]:
        """Which wanted numbers stand in arrays directly inside `parent`."""
        n = len(parent)
        return [
            i
            for i, s in enumerate(self.leaves)
            if len(s) > n + 1 and s[:n] == parent and isinstance(s[n + 1], int)
        ]


class Decoder(Protocol):
    """Turns the messages of one schema into trees (one) and columns (many)."""

    def tree(self, message: bytes) -> Tree:
        """One message as plain values, a schema's absent numbers as their defaults.

        Raises:
            UndecodableError: where the message breaks its encoding.
        """
        ...

    def know(self, tree: Tree) -> None:
        """States what the channel's first messages hold, all taken together."""
        ...

    def unit(self, steps: Steps) -> tuple[str, str]:
        """The unit the schema states for a number, and where."""
        ...

    def columns(
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[Fault]]:
        """Many messages at once.

        Args:
            buffer: bytes that hold the messages, PADDING more after the last of them.
            start: offsets of the messages' first bytes, shape (n,).
            end: offsets behind their last bytes, shape (n,).
            wanted: what to take from each.

        Returns:
            Values of shape (len(wanted.leaves), n), NaN where a message has no such number,
            and what was left out or rounded.
        """
        ...


def path(steps: Steps) -> str:
    """The place of a number as users write it: "joints[1].position"."""
    text = ""
    for step in steps:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def is_number(value: Tree) -> bool:
    """Whether a tree is one number."""
    return isinstance(value, (int, float))


def stamp_keys(tree: Tree) -> tuple[str, str] | None:
    """The names of seconds and nanoseconds, where a tree is a time or a duration of these."""
    if isinstance(tree, dict) and len(tree) == 2 and all(map(is_number, tree.values())):
        return next((keys for keys in _STAMPS if tree.keys() == set(keys)), None)
    return None


def at(tree: Tree, steps: Steps) -> Tree:
    """The value at a place, None where there is none."""
    for step in steps:
        if isinstance(step, int):
            tree = tree[step] if isinstance(tree, list) and step < len(tree) else None
        else:
            tree = tree.get(step) if isinstance(tree, dict) else None
    return tree


def microseconds(text: Tree) -> float:
    """Microseconds since 1970 of an ISO 8601 time with a date, UTC unless it says another zone.

    NaN where it is none.
    """
    if not isinstance(text, str) or text[10:11] not in ("T", " "):
        return float("nan")
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return float("nan")
    return float(((time if time.tzinfo else time.replace(tzinfo=UTC)) - _EPOCH) // _MICROSECOND)


def stamp(tree: Tree, texts: bool) -> Stamp | None:
    """Where a message keeps its own time.

    That is under one of the usual names a pair of seconds and nanoseconds, a number that counts
    s, ms, us or ns since 1970 (by its size: 1990 to 2100), or, if `texts`, an ISO 8601 time.
    """
    for steps in _STAMP_AT:
        value = at(tree, steps)
        if keys := stamp_keys(value):
            return Stamp(((*steps, keys[0]), (*steps, keys[1])))
        if is_number(value):
            for unit in _UNITS:
                if _CALENDAR[0] <= value * unit < _CALENDAR[1]:
                    return Stamp((steps,), unit)
        elif texts and _CALENDAR[0] <= microseconds(value) < _CALENDAR[1]:
            return Stamp((steps,), 1.0, text=True)
    return None


def states_unit(key: str) -> bool:
    """Whether a channel's metadata states a unit under this key."""
    return key in ("unit", "units") or key.startswith("unit.")


def leaves(  # noqa: C901
    tree: Tree, schema_unit: Units, metadata: dict[str, str]
) -> tuple[list[Leaf], list[str]]:
    """Every number of a message, in its order.

    A unit is taken from a string beside the number (`<name>_unit`, `unit`, `units`), else one
    level above, else from the channel's metadata (`unit.<path>`, `unit`, `units`), else from
    the schema.

    Args:
        tree: the message.
        schema_unit: the unit the schema states for a place.
        metadata: the channel's metadata.

    Returns:
        The numbers, and the places that are not offered: too long, too deep or opaque.
    """
    found: list[Leaf] = []
    left_out: list[str] = []

    def unit(steps: Steps) -> tuple[str, str, Steps]:
        where = steps
        while where:
            *above, name = where
            if isinstance(name, str):
                beside = at(tree, tuple(above))
                for key in (f"{name}_unit", f"{name}_units", "unit", "units"):
                    stated, place = at(beside, (key,)), (*above, key)
                    if isinstance(stated, list) and isinstance(steps[-1], int):
                        stated, place = at(stated, (steps[-1],)), (*place, steps[-1])
                    if isinstance(stated, str) and 0 < len(stated) <= _LONGEST_UNIT:
                        return stated, f"field {path((*above, key))}", place
            if len(steps) - len(where) > 2:
                break
            where = tuple(above)
        for key in (f"unit.{path(steps)}", "unit", "units"):
            if 0 < len(metadata.get(key, "")) <= _LONGEST_UNIT:
                return metadata[key], f"channel metadata {key!r}", ()
        return *schema_unit(steps), ()

    def walk(node: Tree, steps: Steps, label: str, label_at: Steps) -> None:  # noqa: C901, PLR0912
        if is_number(node):
            if len(path(steps)) > _LONGEST:
                left_out.append(f"{path(steps)[:_LONGEST]} (a name too long)")
            elif len(found) < MOST_LEAVES:
                stated, where, unit_at = unit(steps)
                found.append(Leaf(steps, label, stated, where, label_at, unit_at))
            elif (rest := f"all after {found[-1].path}") not in left_out:
                left_out[:] = [*left_out[:20], rest]
        elif isinstance(node, Opaque):
            left_out.append(f"{path(steps)} ({node.kind})")
        elif isinstance(node, (dict, list)) and len(steps) >= DEEPEST:
            left_out.append(path(steps))
        elif isinstance(node, dict):
            if stamp_keys(node):
                return
            own = node.get("name")
            if steps and isinstance(steps[-1], int) and isinstance(own, str) and (
                len(own) <= _LONGEST
            ):  # fmt: skip
                label, label_at = own, (*steps, "name")
            for key, value in node.items():
                if isinstance(value, list):
                    walk_list(value, (*steps, key), names(node, len(value)), label, label_at)
                else:
                    walk(value, (*steps, key), label, label_at)
        elif isinstance(node, list):
            walk_list(node, steps, None, label, label_at)

    def walk_list(
        node: list[Tree], steps: Steps, named: list[str] | None, label: str, label_at: Steps
    ) -> None:
        if not any(isinstance(value, (int, float, dict, list)) for value in node):
            return
        if len(node) > LONG_ARRAY:
            left_out.append(f"{path(steps)} (more than {LONG_ARRAY} elements)")
            return
        for i, value in enumerate(node):
            if named:
                walk(value, (*steps, i), named[i], ())
            else:
                walk(value, (*steps, i), label, label_at)

    walk(tree, (), "", ())
    return found, left_out


def number_texts(tree: Tree, steps: Steps = ()) -> Iterator[str]:
    """The places of texts that are numbers but for their quotation marks."""
    if isinstance(tree, str):
        if _NUMBER.fullmatch(tree.strip()):
            yield path(steps)
    elif isinstance(tree, dict) and len(steps) < DEEPEST:
        for key, value in tree.items():
            yield from number_texts(value, (*steps, key))
    elif isinstance(tree, list) and len(steps) < DEEPEST:
        for i, value in enumerate(tree[:LONG_ARRAY]):
            yield from number_texts(value, (*steps, i))


def names(parent: Tree, length: int) -> list[str] | None:
    """The string array `name` or `names` of a message that names the elements of its arrays."""
    for key in ("name", "names"):
        found = parent.get(key) if isinstance(parent, dict) else None
        if (
            isinstance(found, list)
            and len(found) == length > 0
            and all(isinstance(name, str) and len(name) <= _LONGEST for name in found)
        ):
            return found
    return None


def merged(first: Tree, second: Tree, depth: int = 0) -> Tree:
    """What either of two messages has, down to the depth that is read; of two values the first."""
    if isinstance(first, dict) and isinstance(second, dict) and depth < DEEPEST:
        keys = first | second  # in the order of their first sight
        return {key: merged(first.get(key), second.get(key), depth + 1) for key in keys}
    if isinstance(first, list) and isinstance(second, list) and depth < DEEPEST:
        return [merged(a, b, depth + 1) for a, b in zip_longest(first, second)]
    if first is None or (isinstance(first, Opaque) and isinstance(second, dict)):
        return second  # as of a message that is absent in the first
    return first


def typical(trees: Sequence[Tree]) -> Tree:
    """What the messages of a channel hold, by its first ones.

    Keys are those of any, unless they are ever new, as those that are numbers or names of things:
    then those of the largest message. An array has the length that most of them have which is not
    0: others are told and not used.

    Args:
        trees: the first messages, at least one.
    """
    shapes = [tuple(_lengths(tree)) for tree in trees]
    often = Counter(shapes)
    usual = max(often, key=lambda one: often[one])
    first = [tree for tree, shape in zip(trees, shapes, strict=True) if shape == usual]
    others = [tree for tree, shape in zip(trees, shapes, strict=True) if shape != usual]
    level = [*first, *others]
    while len(level) > 1:  # by twos, as the union of many is large
        odd = level[len(level) & ~1 :]
        level = [merged(a, b) for a, b in zip(level[::2], level[1::2], strict=False)] + odd
    largest = max(trees, key=_size)
    if _size(level[0]) > max(_MANY_KEYS, _EVER_NEW * _size(largest)):
        return largest
    return _cut(level[0], trees)


def empty(tree: Tree, steps: Steps = ()) -> Iterator[Steps]:
    """The places where a message has an array without an element."""
    if isinstance(tree, dict) and len(steps) < DEEPEST:
        for key, value in tree.items():
            yield from empty(value, (*steps, key))
    elif isinstance(tree, list) and len(steps) < DEEPEST:
        if not tree:
            yield steps
        for i, value in enumerate(tree[:LONG_ARRAY]):
            if isinstance(value, (dict, list)):
                yield from empty(value, (*steps, i))


def clipped(tree: Tree, depth: int = 0) -> Tree:
    """A message with long arrays cut after LONG_ARRAY + 1 elements."""
    if isinstance(tree, dict) and depth < DEEPEST:
        return {key: clipped(value, depth + 1) for key, value in tree.items()}
    if isinstance(tree, list) and depth < DEEPEST:
        return [clipped(value, depth + 1) for value in tree[: LONG_ARRAY + 1]]
    return tree


def _lengths(tree: Tree, depth: int = 0) -> Iterator[int]:
    """Of all arrays, in their order."""
    if isinstance(tree, list):
        yield len(tree)
    if isinstance(tree, (list, dict)) and depth < DEEPEST:
        for below in tree if isinstance(tree, list) else tree.values():
            if isinstance(below, (list, dict)):
                yield from _lengths(below, depth + 1)


def _size(tree: Tree, depth: int = 0) -> int:
    if isinstance(tree, (list, dict)) and depth < DEEPEST:
        below = tree if isinstance(tree, list) else tree.values()
        return sum(_size(one, depth + 1) for one in below)
    return 1


def _cut(tree: Tree, trees: Sequence[Tree], depth: int = 0) -> Tree:
    """A union of trees, its arrays as long as most of those that hold anything."""
    if isinstance(tree, dict) and depth < DEEPEST:
        objects = [one for one in trees if isinstance(one, dict)]
        return {k: _cut(v, [o[k] for o in objects if k in o], depth + 1) for k, v in tree.items()}
    if isinstance(tree, list) and tree and depth < DEEPEST:
        arrays = [one for one in trees if isinstance(one, list) and one]
        often = Counter(map(len, arrays))
        length = max(often, key=lambda n: (often[n], n))
        return [
            _cut(v, [a[i] for a in arrays if i < len(a)], depth + 1)
            for i, v in enumerate(tree[:length])
        ]
    return tree


def repeated(tree: Tree, leaves: Sequence[Leaf], stamp: Stamp | None) -> Wanted:
    """What a first message says about wanted numbers that later ones must repeat."""
    wanted = [leaf.steps for leaf in leaves]
    wanted += [steps for steps in (stamp.places if stamp else ()) if steps not in wanted]
    lengths = dict.fromkeys(islice(empty(tree), MOST_LEAVES), 0)  # what comes in them is not read
    labels: dict[Steps, list[str]] = {}
    for steps in wanted:
        for i, step in enumerate(steps):
            if not isinstance(step, int):
                continue
            array = at(tree, steps[:i])
            if isinstance(array, list):
                lengths[steps[:i]] = len(array)
                parent = at(tree, steps[: i - 1]) if i else None
                if parent is not None and (named := names(parent, len(array))):
                    key = "name" if parent.get("name") is named else "names"
                    labels[(*steps[: i - 1], key)] = named
    said: dict[Steps, Said] = {}
    for i, leaf in enumerate(leaves):
        for place, text in ((leaf.label_at, leaf.label), (leaf.unit_at, leaf.unit)):
            if place:
                said.setdefault(place, Said(text, [])).leaves.append(i)
    iso = stamp.places[0] if stamp and stamp.text else None
    return Wanted(tuple(wanted), len(leaves), lengths, labels, said, iso)


def length_faults(wanted: Wanted, steps: Steps, count: Offsets | int, rows: int) -> Iterator[Fault]:
    """The fault of messages in which a wanted array has another length than in the first."""
    expected = wanted.lengths.get(steps)
    if expected is not None:
        other = np.broadcast_to(np.not_equal(count, expected), rows)
        if other.any():
            yield Fault("mcap-array-length", np.flatnonzero(other), path(steps))


def label_fault(wanted: Wanted, steps: Steps, other: Bools, values: Floats) -> Fault:
    """Takes out the numbers of messages in which an array of names differs from the first's."""
    rows = np.flatnonzero(other)
    for i in wanted.under(steps[:-1]):
        values[i, rows] = np.nan
    return Fault("mcap-text-change", rows, path(steps))


def said_fault(wanted: Wanted, steps: Steps, other: Bools, values: Floats) -> Fault:
    """Takes out the numbers of messages in which their unit or name differs from the first's."""
    said, rows = wanted.said[steps], np.flatnonzero(other)
    for i in said.leaves:
        values[i, rows] = np.nan
    return Fault("mcap-text-change", rows, path(steps))


def inexact(integers: NDArray[Any]) -> Bools:
    """Which integers a double does not hold: from the first bit set to the last more than 53."""
    if integers.dtype.itemsize < 8:
        return np.zeros(len(integers), np.bool_)
    size = np.abs(integers).astype(np.uint64)
    lost: Bools = size // np.maximum(size & (~size + np.uint64(1)), 1) > EXACT
    return lost


def rounded_faults(wanted: Wanted, lost: Bools) -> Iterator[Fault]:
    """The faults of numbers asked for that are `inexact`; a stamp is one to the microsecond.

    Args:
        wanted: the numbers.
        lost: which are, shape (len(wanted.leaves), n).
    """
    for steps, rows in zip(wanted.leaves[: wanted.asked], lost, strict=False):
        if rows.any():
            yield Fault("mcap-rounded", np.flatnonzero(rows), path(steps))


def other_text(buffer: Bytes, start: Offsets, length: Offsets, text: str) -> Bools:
    """Where the bytes at `start` are not this text; shape (n,)."""
    raw = np.frombuffer(text.encode(), np.uint8)
    other: Bools = length != len(raw)
    if len(raw) and len(same := np.flatnonzero(~other)):
        other[same] = (sliding_window_view(buffer, len(raw))[start[same]] != raw).any(1)
    return other
