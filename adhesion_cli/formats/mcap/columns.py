"""Columns of many messages: which numbers are wanted, and what in later messages differs."""

from abc import ABC, abstractmethod
from array import array
from collections.abc import Mapping, Sequence
from itertools import islice, pairwise
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from ...core.model import Bools, Floats
from ..source import number_words
from .blocks import Offsets
from .fields import MAX_NUMBERS, Leaf, Steps, Tree, UndecodableError, empty, node_at, path
from .stamps import Stamp

_TOGETHER = 1 << 20  # bytes of messages that are parsed before their numbers are taken
_OVERHEAD = 256  # bytes that each counts more
_MOST_REPORTED = 500  # kinds of faults of one topic that are reported one by one


class DecodingFault(NamedTuple):
    """What decoding had to leave out of a message."""

    code: str  # of a finding
    field: str = ""  # its place in the message, where it is about one
    reason: str = ""  # why the message does not decode


class FirstText(NamedTuple):
    """What gives wanted numbers their unit or name in the first message: a text, or a number."""

    value: Tree
    places: list[int]  # the numbers, by their place in Decoded.numbers


class Decoded:
    """The wanted numbers of a topic, filled message by message, and what differs in a message.

    Attributes:
        shape: what the first messages hold, all taken together.
        numbers: places of the numbers, those of the stamp behind the others.
        lengths: of the arrays that hold wanted numbers, or are empty at first.
        said: units and names that later messages must repeat.
        words: of texts that are wanted, whose numbers count these.
        iso: the one of `numbers` that is a time as text.
        values: of shape (len(numbers), rows), NaN where a message has no such number.
        faults: the messages that have each fault.
    """

    def __init__(self, tree: Tree, leaves: Sequence[Leaf], stamp: Stamp | None, rows: int) -> None:
        self.shape = tree
        places = [leaf.steps for leaf in leaves]
        places += [steps for steps in (stamp.places if stamp else ()) if steps not in places]
        self.numbers: Sequence[Steps] = places
        self.lengths: dict[Steps, int] = dict.fromkeys(islice(empty(tree), MAX_NUMBERS), 0)
        for steps in places:
            for i, step in enumerate(steps):
                if isinstance(step, int):
                    self.lengths[steps[:i]] = len(node_at(tree, steps[:i]))
        self.said: dict[Steps, FirstText] = {}
        for i, leaf in enumerate(leaves):
            for place in filter(None, (leaf.label_at, leaf.unit_at)):
                said = FirstText(node_at(tree, place), [])
                self.said.setdefault(place, said).places.append(i)
        self.iso = stamp.places[0] if stamp and stamp.text else None
        self.words = {leaf.steps: list[str]() for leaf in leaves if leaf.words and not leaf.numbers}
        self.values: Floats = np.full((len(places), rows), np.nan)
        self.faults: dict[DecodingFault, array[int]] = {}
        self._unlike: list[tuple[list[int], Offsets]] = []  # numbers, messages that say otherwise

    def note(self, fault: DecodingFault, rows: Offsets) -> None:
        """Notes a fault of these messages, if there are any."""
        if len(self.faults) >= _MOST_REPORTED and fault not in self.faults:
            code, field, reason = fault
            fault = DecodingFault(code, field and "further fields", reason and "other reasons")
        if len(rows):
            self.faults.setdefault(fault, array("q")).frombytes(rows.astype(np.int64).tobytes())

    def refuse(self, row: int, reason: str) -> None:
        """Leaves a message out that does not decode."""
        self.note(DecodingFault("mcap-bad-message", reason=reason), np.array([row]))

    def note_text(self, place: Steps, rows: Offsets) -> None:
        """Notes messages that say another unit or name; the numbers that it is of are left out."""
        self.note(DecodingFault("mcap-text-change", path(place)), rows)
        self._unlike.append((self.said[place].places, rows))

    def finish(self) -> Bools:
        """Takes out what cannot be used; which messages decode, shape (rows,)."""
        for numbers, rows in self._unlike:
            self.values[np.array(numbers)[:, None], rows] = np.nan
        decodes = np.ones(self.values.shape[1], np.bool_)
        for fault, bad in self.faults.items():
            if fault.code == "mcap-bad-message":
                decodes[np.array(bad)] = False
                self.values[:, np.array(bad)] = np.nan
        return decodes


class Spread:
    """Takes parsed messages apart, place by place, all messages at once."""

    def __init__(self, decoded: Decoded) -> None:
        self._decoded = decoded
        self._columns = {steps: i for i, steps in enumerate(decoded.numbers)}
        places = (*decoded.numbers, *decoded.said, *decoded.lengths)
        self._places = {steps[:k] for steps in places for k in range(1, len(steps) + 1)}

    def walk(self, nodes: Sequence[Any], rows: Offsets, shape: Tree, steps: Steps = ()) -> None:
        """Takes what is wanted of the values at a place.

        `rows` are the messages that have `nodes`, `shape` is what the first messages have there.
        """
        if isinstance(shape, (dict, list)):
            nodes, rows = self._usable(nodes, rows, shape, steps)
            if not nodes:
                return
            if isinstance(shape, dict):
                self._members(nodes, rows, shape, steps)
            else:
                self._elements(nodes, rows, shape, steps)
            return
        if said := self._decoded.said.get(steps):
            differs = [node != said.value and node not in ("", None) for node in nodes]
            self._decoded.note_text(steps, rows[differs])
        if (i := self._columns.get(steps)) is not None:
            self._numbers(nodes, rows, i, steps)

    def _usable(
        self, nodes: Sequence[Any], rows: Offsets, shape: Tree, steps: Steps
    ) -> tuple[Sequence[Any], Offsets]:
        """The values that are what the first messages have there, and their messages."""
        return nodes, rows

    def _visits(self, shape: Tree, steps: Steps) -> bool:
        return steps in self._places

    def _children(
        self, nodes: Sequence[Any], rows: Offsets, key: str
    ) -> tuple[Sequence[Any], Offsets]:
        """The values under a key, and the messages that have one."""
        try:
            return list(map(itemgetter(key), nodes)), rows
        except KeyError:
            return [node[key] for node in nodes if key in node], rows[[key in n for n in nodes]]

    def _members(
        self, nodes: Sequence[Any], rows: Offsets, shape: dict[str, Tree], steps: Steps
    ) -> None:
        for key, child in shape.items():
            if self._visits(child, place := (*steps, key)):
                children, rows_with_child = self._children(nodes, rows, key)
                if children:
                    self.walk(children, rows_with_child, child, place)

    def _elements(
        self, nodes: Sequence[Any], rows: Offsets, shape: list[Tree], steps: Steps
    ) -> None:
        count = np.array(list(map(len, nodes)))
        if steps in self._decoded.lengths:
            fault = DecodingFault("mcap-array-length", path(steps))
            self._decoded.note(fault, rows[count != self._decoded.lengths[steps]])
        for k, child in enumerate(shape):
            if self._visits(child, place := (*steps, k)):
                children = [node[k] for node in nodes if len(node) > k]
                if children:
                    self.walk(children, rows[count > k], child, place)

    def _numbers(self, nodes: Sequence[Any], rows: Offsets, column: int, steps: Steps) -> None:
        if (words := self._decoded.words.get(steps)) is not None:
            texts = [node.strip() if isinstance(node, str) else "" for node in nodes]
            number_of = number_words(words, filter(None, texts))
            nodes = [number_of.get(text, np.nan) for text in texts]
        self._decoded.values[column, rows] = nodes


class Decoder(ABC):
    """Turns the messages of one schema into trees (one) and columns (many)."""

    spread: type[Spread] = Spread  # takes parsed messages apart

    @abstractmethod
    def parse(self, message: bytes) -> Any:
        """One message as its library gives it.

        Raises:
            UndecodableError: where the message breaks its encoding.
        """

    @abstractmethod
    def tree(self, message: bytes) -> Tree:
        """One message as plain values, a schema's absent numbers as their defaults.

        Raises:
            UndecodableError: where the message breaks its encoding.
        """

    def unit(self, steps: Steps) -> tuple[str, str]:
        """The unit the schema states for a number, and where; "" for none."""
        return "", ""

    def names(self, steps: Steps) -> Mapping[int, str]:
        """The names that the schema gives the numbers at a place; none where it gives none."""
        return {}

    def fill(
        self, decoded: Decoded, first_row: int, data: bytes, start: Offsets, stop: Offsets
    ) -> None:
        """Decodes many messages at once. As many are parsed as may stand in memory together.

        `start` and `stop` are the offsets of each message in `data`, shape (n,).
        """
        cuts = np.flatnonzero(np.diff(np.cumsum(stop - start + _OVERHEAD) // _TOGETHER)) + 1
        for begin, end in pairwise([0, *cuts.tolist(), len(start)]):
            messages, rows = list[Any](), list[int]()
            spans = zip(start[begin:end].tolist(), stop[begin:end].tolist(), strict=True)
            for row, (a, b) in enumerate(spans, first_row + begin):
                try:
                    messages.append(self.parse(data[a:b]))
                    rows.append(row)
                except UndecodableError as e:
                    decoded.refuse(row, str(e))
            if messages:
                self.spread(decoded).walk(messages, np.array(rows), decoded.shape)
