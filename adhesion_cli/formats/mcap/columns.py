"""Columns of many messages: which numbers are wanted, and what in later messages differs."""

from abc import ABC, abstractmethod
from array import array
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from itertools import islice, pairwise
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from ...core.model import Bools, Floats
from ..source import number_words
from . import fields
from .fields import MAX_NUMBERS, Leaf, Stamp, Steps, Tree, UndecodableError, node_at, path
from .records import Offsets

_NUMBERS = {int, float, bool}
_TOGETHER = 1 << 20  # bytes of messages that are parsed before their numbers are taken
_OVERHEAD = 256  # bytes that each counts more
_MOST_REPORTED = 500  # kinds of faults of one topic that are reported one by one


class DecodingFault(NamedTuple):
    """What decoding had to leave out of a message."""

    code: str  # of a finding
    field: str = ""  # its place in the message, where it is about one
    reason: str = ""  # why the message does not decode


Places = Container[Steps]
Faults = Iterator[tuple[DecodingFault, list[bool]]]  # each with the messages that have it


class Decoder(ABC):
    """Turns the messages of one schema into trees (one) and columns (many)."""

    @abstractmethod
    def parse(self, message: bytes) -> Any:
        """One message as its library gives it.

        Raises:
            UndecodableError: where the message breaks its encoding.
        """

    def tree(self, message: bytes) -> Tree:
        """One message as plain values, as `parse`; absent numbers of a schema as its defaults."""
        return self.parse(message)

    def unit(self, steps: Steps) -> tuple[str, str]:
        """The unit the schema states for a number, and where; "" for none."""
        return "", ""

    def names(self, steps: Steps) -> Mapping[int, str]:
        """The names that the schema gives the numbers at a place; none where it gives none."""
        return {}

    def watched(self, tree: Tree) -> Iterable[Steps]:
        """Places that are looked at, whoever wants them: those that no schema describes."""
        return ()

    def children(self, nodes: Sequence[Any], step: str | int) -> list[Any]:
        """What stands at a step below each value, None for nothing."""
        child = itemgetter(step)
        try:
            return list(map(child, nodes))
        except (LookupError, TypeError):
            return [_or_none(child, node) for node in nodes]

    def faults(self, nodes: list[Any], shape: Tree, steps: Steps, wanted: Places) -> Faults:
        """What differs at a place, and in which messages; of another kind it becomes None."""
        return iter(())


def _or_none(child: Any, node: Any) -> Any:
    try:
        return child(node)
    except (LookupError, TypeError):
        return None


class Decoded:
    """The wanted numbers of a topic, filled message by message, and what differs in a message.

    Attributes:
        numbers: places of the numbers, those of the stamp behind the others.
        words: of texts that are wanted, whose numbers count these.
        values: of shape (len(numbers), rows), NaN where a message has no such number.
        faults: the messages that have each fault.
    """

    def __init__(
        self, decoder: Decoder, tree: Tree, leaves: Sequence[Leaf], stamp: Stamp | None, rows: int
    ) -> None:
        self._decoder = decoder
        self.numbers = [leaf.steps for leaf in leaves]
        self.numbers += [x for x in (stamp.places if stamp else ()) if x not in self.numbers]
        self._iso = stamp.places[0] if stamp and stamp.text else None
        self.words = {leaf.steps: list[str]() for leaf in leaves if leaf.words and not leaf.numbers}
        # Units and names, which later messages must repeat, and the numbers that they are of.
        self._said: dict[Steps, list[int]] = {}
        for i, leaf in enumerate(leaves):
            for place in filter(None, (leaf.label_at, leaf.unit_at)):
                self._said.setdefault(place, []).append(i)
        # Arrays that hold wanted numbers or are empty at first, which keep their length.
        arrays = [*islice(fields.empty(tree), MAX_NUMBERS)]
        arrays += [x[:k] for x in self.numbers for k, step in enumerate(x) if isinstance(step, int)]
        self._lengths = {steps: len(node_at(tree, steps)) for steps in arrays}
        wanted = *self.numbers, *self._said, *arrays, *decoder.watched(tree)
        places = dict.fromkeys(steps[:k] for steps in wanted for k in range(len(steps) + 1))
        self._shapes = {steps: node_at(tree, steps) for steps in sorted(places, key=len)}
        self.values: Floats = np.full((len(self.numbers), rows), np.nan)
        self.faults: dict[DecodingFault, array[int]] = {}
        self._unlike: list[tuple[list[int], Offsets]] = []  # numbers, messages that say otherwise

    def fill(self, first_row: int, data: bytes, start: Offsets, stop: Offsets) -> None:
        """Decodes many messages at once. As many are parsed as may stand in memory together.

        `start` and `stop` are the offsets of each message in `data`, shape (n,).
        """
        cuts = np.flatnonzero(np.diff(np.cumsum(stop - start + _OVERHEAD) // _TOGETHER)) + 1
        for begin, end in pairwise([0, *cuts.tolist(), len(start)]):
            messages, rows = list[Any](), list[int]()
            spans = zip(start[begin:end].tolist(), stop[begin:end].tolist(), strict=True)
            for row, (a, b) in enumerate(spans, first_row + begin):
                try:
                    messages.append(self._decoder.parse(data[a:b]))
                    rows.append(row)
                except UndecodableError as e:
                    self.note(DecodingFault("mcap-bad-message", reason=str(e)), np.array([row]))
            if messages:
                self._take(messages, np.array(rows))

    def _take(self, messages: list[Any], rows: Offsets) -> None:
        """Takes what is wanted of parsed messages, place by place, all messages at once."""
        nodes_by_steps: dict[Steps, list[Any]] = {}
        for steps, shape in self._shapes.items():
            parents = nodes_by_steps[steps[:-1]] if steps else messages
            nodes = self._decoder.children(parents, steps[-1]) if steps else messages
            nodes_by_steps[steps] = nodes
            if isinstance(shape, (dict, list)):
                for fault, has_fault in self._decoder.faults(nodes, shape, steps, self._shapes):
                    self.note(fault, rows[has_fault])
            if (length := self._lengths.get(steps)) is not None:
                has_fault = [node is not None and len(node) != length for node in nodes]
                self.note(DecodingFault("mcap-array-length", path(steps)), rows[has_fault])
            if (numbers := self._said.get(steps)) is not None:
                differs = rows[[node != shape and node not in ("", None) for node in nodes]]
                self.note(DecodingFault("mcap-text-change", path(steps)), differs)
                self._unlike.append((numbers, differs))
        for column, steps in enumerate(self.numbers):
            self.values[column, rows] = self._numbers(nodes_by_steps[steps], rows, steps)

    def _numbers(self, nodes: list[Any], rows: Offsets, steps: Steps) -> Floats:
        """The numbers among values at a place, NaN for others, which are noted."""
        if (words := self.words.get(steps)) is not None:
            texts = [node.strip() if isinstance(node, str) else "" for node in nodes]
            number_of = number_words(words, filter(None, texts))
            nodes = [number_of.get(text) for text in texts]
        elif steps == self._iso:
            nodes = list(map(fields.microseconds, nodes))
        elif not set(map(type, nodes)) <= _NUMBERS:
            has_fault = [node is not None and type(node) not in _NUMBERS for node in nodes]
            self.note(DecodingFault("mcap-type-change", path(steps)), rows[has_fault])
            nodes = [node if type(node) in _NUMBERS else None for node in nodes]
        return np.array(nodes, np.float64)  # of None NaN

    def note(self, fault: DecodingFault, rows: Offsets) -> None:
        """Notes a fault of these messages, if there are any."""
        if len(self.faults) >= _MOST_REPORTED and fault not in self.faults:
            code, field, reason = fault
            fault = DecodingFault(code, field and "further fields", reason and "other reasons")
        if len(rows):
            self.faults.setdefault(fault, array("q")).frombytes(rows.astype(np.int64).tobytes())

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
