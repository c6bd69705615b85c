"""A message as a tree of plain values: the numbers in it that are series, and its own time."""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from ...core.model import Bools, Floats, Times

Tree = Any  # dict[str, Tree] | list[Tree] | float | int | bool | str | Opaque | None
Steps = tuple[str | int, ...]  # the way from the root of a message to a value
Units = Callable[[Steps], tuple[str, str]]  # unit and where it stood, ("", "") if nowhere

LONG_ARRAY = 256  # longer arrays (images, point clouds) are not offered as scalar series
MAX_NUMBERS = 4096  # scalar series of one channel
DEEPEST = 32  # levels of a message
_LONGEST = 1000  # characters of a place
_LONGEST_UNIT = 100  # characters of a unit
_NUMBER = re.compile(r"[+-]?[0-9]+([.,][0-9]*)?([eE][+-]?[0-9]{1,3})?")
_RARE = 50  # keys that are in fewer than one of so many messages are no names
_AXLES = "axle axleid axleno axlenumber wheel wheelset achse radsatz".split()
# Keys of a message whose values may say whose its numbers are.
_OWNERS = [*_AXLES, *"device deviceid sensor sensorid name signal channel".split()]
_FRAME: Steps = ("header", "frame_id")  # so may this one, where only its number differs
_STAMPS = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"), ("secs", "nsecs"))


class UndecodableError(Exception):
    """A schema or a message breaks its encoding."""


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
    label_at: Steps = ()  # the string that is the label; () without one
    unit_at: Steps = ()  # the string that is the unit; () where no string of the message is
    words: tuple[str, ...] = ()  # of a text, those in the first messages; of an enum, its names
    numbers: tuple[int, ...] = ()  # of an enum, those of its names

    @property
    def path(self) -> str:
        """The place as users write it: "joints[1].position"."""
        return path(self.steps)


def path(steps: Steps) -> str:
    """A place in a message as users write it: "joints[1].position"."""
    text = ""
    for step in steps:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def is_number(value: Tree) -> bool:
    """Whether a tree is one number."""
    return isinstance(value, (int, float))


def node_at(tree: Tree, steps: Steps) -> Tree:
    """The value at a place, None where a message has no such place."""
    for step in steps:
        if isinstance(step, int):
            tree = tree[step] if isinstance(tree, list) and step < len(tree) else None
        else:
            tree = tree.get(step) if isinstance(tree, dict) else None
    return tree


def nodes(tree: Tree, steps: Steps = ()) -> Iterator[tuple[Steps, Tree]]:
    """Each value in a tree with its place, in order, down to the depth and length that is read."""
    yield steps, tree
    children: Iterable[tuple[str | int, Tree]] = ()
    if isinstance(tree, dict):
        children = tree.items()
    elif isinstance(tree, list) and len(tree) <= LONG_ARRAY:
        children = enumerate(tree)
    if len(steps) < DEEPEST:
        for step, child in children:
            yield from nodes(child, (*steps, step))


def empty(tree: Tree) -> Iterator[Steps]:
    """The places where a message has an array without an element."""
    return (steps for steps, node in nodes(tree) if isinstance(node, list) and not node)


def quoted_numbers(tree: Tree) -> Iterator[str]:
    """The places of texts that would be numbers without their quotation marks."""
    for steps, node in nodes(tree):
        if isinstance(node, str) and _NUMBER.fullmatch(node.strip()):
            yield f"{path(steps)} (a number in quotation marks)"


def stamp_keys(tree: Tree) -> tuple[str, str] | None:
    """The names of seconds and nanoseconds, where a tree is a time or a duration of these."""
    if isinstance(tree, dict) and len(tree) == 2 and all(map(is_number, tree.values())):
        return next((keys for keys in _STAMPS if tree.keys() == set(keys)), None)
    return None


def states_unit(key: str) -> bool:
    """Whether a channel's metadata states a unit under this key."""
    return key in ("unit", "units") or key.startswith("unit.")


class LeafSearch:
    """Every number of a message, in its order, and every text; `label_at` is as of `owner_of`.

    A unit comes from the first of these places that states one:

    1. a string in the same message (`<name>_unit`, `unit`, `units`),
    2. such a string one level above,
    3. the channel's metadata (`unit.<path>`, `unit`, `units`),
    4. the schema.
    """

    def __init__(
        self, tree: Tree, schema_unit: Units, metadata: dict[str, str], label_at: Steps = ()
    ) -> None:
        self._tree, self._schema_unit, self._metadata = tree, schema_unit, metadata
        self.leaves: list[Leaf] = []
        self.texts: list[Steps] = []
        self.omitted: list[str] = []  # places that are not offered: too long, too deep or opaque
        self._walk(tree, (), label_at, ())

    def _walk(self, node: Tree, steps: Steps, label_at: Steps, names_at: Steps) -> None:
        """Takes up the numbers at a place; texts may name it, and at `names_at` its elements."""
        if is_number(node):
            self._number(steps, label_at)
        elif isinstance(node, str):
            self.texts += [steps] * (len(self.texts) < MAX_NUMBERS)
        elif isinstance(node, Opaque):
            self.omitted.append(f"{path(steps)} ({node.kind})")
        elif not isinstance(node, (dict, list)) or stamp_keys(node):
            return
        elif len(steps) >= DEEPEST:
            self.omitted.append(path(steps))
        elif isinstance(node, dict):
            is_element = bool(steps) and isinstance(steps[-1], int)
            label_keys = (k for k in node if k == "name" or _normal(k) in _AXLES)
            key = next((k for k in label_keys if is_label(node[k])), None)
            if is_element and key:
                label_at = (*steps, key)
            for key, value in node.items():
                names = next((k for k in ("name", "names") if _names(node.get(k), value)), None)
                self._walk(value, (*steps, key), label_at, (*steps, names) if names else ())
        elif any(isinstance(value, (int, float, dict, list)) for value in node):
            if len(node) > LONG_ARRAY:
                self.omitted.append(f"{path(steps)} (more than {LONG_ARRAY} elements)")
                return
            for i, value in enumerate(node):
                self._walk(value, (*steps, i), (*names_at, i) if names_at else label_at, ())

    def _number(self, steps: Steps, label_at: Steps) -> None:
        if len(path(steps)) > _LONGEST:
            self.omitted.append(f"{path(steps)[:_LONGEST]} (a name too long)")
        elif len(self.leaves) < MAX_NUMBERS:
            label = label_of(label_at, node_at(self._tree, label_at)) if label_at else ""
            unit, unit_place, unit_at = self._unit(steps)
            self.leaves.append(Leaf(steps, label, unit, unit_place, label_at, unit_at))
        elif (skipped := f"all after {self.leaves[-1].path}") not in self.omitted:
            self.omitted[:] = [*self.omitted[:20], skipped]

    def _unit(self, steps: Steps) -> tuple[str, str, Steps]:
        """The unit of a number, where it stood in words, and the string of the message it is."""
        for depth in range(len(steps), max(len(steps) - 3, 0), -1):
            *parents, name = steps[:depth]
            if not isinstance(name, str):
                continue
            message = node_at(self._tree, tuple(parents))
            for key in (f"{name}_unit", f"{name}_units", "unit", "units"):
                unit, place = node_at(message, (key,)), (*parents, key)
                if isinstance(unit, list) and isinstance(steps[-1], int):
                    unit, place = node_at(unit, (steps[-1],)), (*place, steps[-1])
                if isinstance(unit, str) and 0 < len(unit) <= _LONGEST_UNIT:
                    return unit, f"field {path((*parents, key))}", place
        for key in (f"unit.{path(steps)}", "unit", "units"):
            if 0 < len(self._metadata.get(key, "")) <= _LONGEST_UNIT:
                return self._metadata[key], f"channel metadata {key!r}", ()
        return *self._schema_unit(steps), ()


def _normal(key: str) -> str:
    return key.replace("_", "").casefold()


def is_label(value: Tree) -> bool:
    """Whether a value is a name or a number that can name something."""
    return type(value) is int or (isinstance(value, str) and 0 < len(value) <= _LONGEST)


def label_of(steps: Steps, value: Tree) -> str:
    """The name that a value at a place gives; a number with its key: "axle 2"."""
    return f"{steps[-1]} {value}" if str(value).isdecimal() else str(value)


def owner_of(trees: Sequence[Tree]) -> Steps:
    """Where messages say whose their numbers are, if they are of several in turn; else ()."""
    first_tree = trees[0] if isinstance(trees[0], dict) else {}
    keys: list[Steps] = [(key,) for key in first_tree if _normal(key) in _OWNERS]
    for steps in [*keys, _FRAME]:
        owners = [node_at(tree, steps) for tree in trees]
        if not all(map(is_label, owners)) or not 1 < len(set(owners)) <= len(owners) / 2:
            continue
        if steps != _FRAME or len({re.sub(r"\d+", "", owner) for owner in owners}) == 1:
            return steps
    return ()


def _names(element: Tree, array: Tree) -> bool:
    """Whether what stands under `name` in a message names the elements of an array beside it."""
    if not isinstance(element, list) or not isinstance(array, list) or len(element) != len(array):
        return False
    return all(isinstance(name, str) and len(name) <= _LONGEST for name in element)


def typical(trees: Sequence[Tree]) -> Tree:
    """What the messages of a channel hold, judged by its first ones, at least one.

    Keys are those of any message, without very rare ones. An array has its most frequent length
    except 0.
    """
    arrays = ([node for _, node in nodes(tree) if isinstance(node, list)] for tree in trees)
    shapes = [tuple(map(len, x)) for x in arrays]
    usual = Counter(shapes).most_common(1)[0][0]
    ordered = sorted(range(len(trees)), key=lambda i: shapes[i] != usual)
    return _union([trees[i] for i in ordered], 0)


def _union(values: Sequence[Tree], depth: int) -> Tree:
    """What stands at one place in some messages; of two kinds the first."""
    example = next((value for value in values if value is not None), None)
    if isinstance(example, Opaque):  # as of a message that is absent there
        example = next((value for value in values if isinstance(value, dict)), example)
    if depth >= DEEPEST:
        return example
    if isinstance(example, dict):
        by_key: dict[str, list[Tree]] = {}
        for candidate in values:
            for key, value in candidate.items() if isinstance(candidate, dict) else ():
                by_key.setdefault(key, []).append(value)
        usual = {key: x for key, x in by_key.items() if len(x) * _RARE >= len(values)}
        return {key: _union(branch, depth + 1) for key, branch in usual.items()}
    if isinstance(example, list):
        arrays = [candidate for candidate in values if isinstance(candidate, list) and candidate]
        often = Counter(map(len, arrays))
        length = max(often, key=lambda n: (often[n], n), default=0)
        indices = range(min(length, LONG_ARRAY + 1))
        branches = ([array[i] for array in arrays if i < len(array)] for i in indices)
        return [_union(branch, depth + 1) for branch in branches]
    return example


_IN_HEADER: tuple[Steps, ...] = (("header", "stamp"), ("header", "timestamp"))
_PLACES: tuple[Steps, ...] = (*_IN_HEADER, ("timestamp",), ("stamp",), ("time",), ("ts",))
_SECOND = 10**9
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_CALENDAR = (631_152_000 * 10**6, 4_102_444_800 * 10**6)  # 1990 to 2100 [us]
_CLOCK_UNITS = (1e6, 1e3, 1.0, 1e-3)  # microseconds in what clocks count: s, ms, us, ns


@dataclass(frozen=True, slots=True)
class Stamp:
    """Where messages keep their own time."""

    places: tuple[Steps, ...]  # of seconds and nanoseconds, or of one number or text
    unit: float = 0.0  # microseconds in the unit of one number
    text: bool = False  # ISO 8601, which decoders give as microseconds since 1970

    def times(self, values: Floats) -> tuple[Times, Bools]:
        """Stamps [ns] of values (len(places), n), one number to the microsecond; which hold."""
        if len(self.places) == 2:
            seconds, nanos = values
            has_stamp = (np.abs(seconds) < 9e9) & (np.abs(nanos) < 4.3e9)  # not NaN, fits 64 bits
            has_stamp &= (seconds != 0) | (nanos != 0)
            stamp_seconds = np.where(has_stamp, seconds, 0).astype(np.int64) * _SECOND
            return stamp_seconds + np.where(has_stamp, nanos, 0).astype(np.int64), has_stamp
        micros = np.rint(values[0] * self.unit)
        has_stamp = (micros >= _CALENDAR[0]) & (micros < _CALENDAR[1])
        return np.where(has_stamp, micros, 0).astype(np.int64) * 1000, has_stamp

    def first_time(self, tree: Tree) -> int:
        """The stamp of one message [ns], 0 where it has none."""
        stamp_parts = [node_at(tree, steps) for steps in self.places]
        if self.text:
            stamp_parts = [microseconds(text) for text in stamp_parts]
        values = [[float(v)] if is_number(v) else [np.nan] for v in stamp_parts]
        return int(self.times(np.array(values))[0][0])


def microseconds(text: Tree) -> float:
    """Microseconds since 1970 of an ISO 8601 date and time, UTC if it has no zone; else NaN."""
    if not isinstance(text, str) or text[10:11] not in ("T", " "):
        return float("nan")
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return float("nan")
    return float(((time if time.tzinfo else time.replace(tzinfo=UTC)) - _EPOCH) // _MICROSECOND)


def stamp(tree: Tree, texts: bool) -> Stamp | None:
    """Where a message keeps its own time: the first of the usual names that holds one.

    That is a pair of seconds and nanoseconds, or a number of s, ms, us or ns between 1990 and 2100;
    with `texts` an ISO 8601 text, too.
    """
    for steps in _PLACES:
        value = node_at(tree, steps)
        if keys := stamp_keys(value):
            return Stamp(((*steps, keys[0]), (*steps, keys[1])))
        if is_number(value):
            for unit in _CLOCK_UNITS:
                if _CALENDAR[0] <= value * unit < _CALENDAR[1]:
                    return Stamp((steps,), unit)
        elif texts and _CALENDAR[0] <= microseconds(value) < _CALENDAR[1]:
            return Stamp((steps,), 1.0, text=True)
    return None
