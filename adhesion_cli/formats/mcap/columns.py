"""Columns of many messages: which numbers are wanted, and what in later messages differs."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise
from operator import itemgetter
from typing import Any

import numpy as np

from ...core.model import Bools, Floats
from ..source import MOST_WORDS
from .blocks import Offsets
from .fields import MAX_NUMBERS, Leaf, Steps, Tree, UndecodableError, empty, node_at, path
from .stamps import Stamp

_TOGETHER = 1 << 20  # bytes of messages that are parsed before their numbers are taken
_OVERHEAD = 256  # bytes that each counts more


@dataclass(frozen=True, slots=True)
class MessageFault:
    """What decoding had to leave out, and the messages of the batch that it concerns."""

    code: str
    rows: Offsets
    field: str = ""  # its place in the message, where it is about one
    reason: str = ""  # why the messages do not decode


@dataclass(frozen=True, slots=True)
class FirstText:
    """A string of the first message that gives wanted numbers their unit or name."""

    text: str
    places: list[int]  # the numbers, by their place in Wanted.numbers


@dataclass(frozen=True, slots=True, eq=False)
class Wanted:
    """The numbers asked for, and what the first messages said that later ones must repeat."""

    numbers: Sequence[Steps]  # the numbers asked for, then those of the stamp
    lengths: dict[Steps, int]  # of the arrays that hold wanted numbers, or are empty at first
    said: dict[Steps, FirstText]
    words: dict[Steps, list[str]]  # of texts that are asked for, whose numbers count these
    shape: Tree  # what the first messages hold, all taken together
    iso: Steps | None = None  # the one of `numbers` that is a time as text
    layouts: list[Any] = field(default_factory=list)  # what a decoder learns of its messages

    @classmethod
    def select(cls, tree: Tree, wanted: Sequence[Leaf], stamp: Stamp | None) -> "Wanted":
        """What the typical first message says about numbers and the stamp."""
        places = [leaf.steps for leaf in wanted]
        places += [steps for steps in (stamp.places if stamp else ()) if steps not in places]
        lengths = dict.fromkeys(islice(empty(tree), MAX_NUMBERS), 0)  # never read
        for steps in places:
            for i, step in enumerate(steps):
                if isinstance(step, int):
                    lengths[steps[:i]] = len(node_at(tree, steps[:i]))
        said: dict[Steps, FirstText] = {}
        for i, leaf in enumerate(wanted):
            for place, text in ((leaf.label_at, leaf.label), (leaf.unit_at, leaf.unit)):
                if place:
                    said.setdefault(place, FirstText(text, [])).places.append(i)
        iso = stamp.places[0] if stamp and stamp.text else None
        words = {leaf.steps: list[str]() for leaf in wanted if leaf.words and not leaf.numbers}
        return cls(tuple(places), lengths, said, words, tree, iso)


class Batch:
    """The columns of many messages while they are decoded.

    Attributes:
        values: the wanted numbers, shape (len(wanted.numbers), n).
        lengths: which messages have another length, by array; shape (n,).
        texts: which messages have another unit or name, by string; shape (n,).
        faults: what else is wrong.
    """

    def __init__(self, wanted: Wanted, count: int) -> None:
        self.wanted = wanted
        self.values = np.full((len(wanted.numbers), count), np.nan)
        self.lengths = {steps: np.zeros(count, np.bool_) for steps in wanted.lengths}
        self.texts = {steps: np.zeros(count, np.bool_) for steps in wanted.said}
        self.faults: list[MessageFault] = []
        self._bad: dict[str, list[int]] = {}  # messages that do not decode, by the reason

    def refuse(self, row: int, reason: str) -> None:
        """Leaves a message out that does not decode."""
        self._bad.setdefault(reason, []).append(row)

    def finish(self) -> tuple[Floats, list[MessageFault]]:
        """The values and the faults, see Decoder.columns."""
        is_sound = np.ones(self.values.shape[1], np.bool_)
        for reason, bad in self._bad.items():
            is_sound[bad] = False
            self.faults.append(MessageFault("mcap-bad-message", np.array(bad), reason=reason))
        self.values[:, ~is_sound] = np.nan
        for steps, differs in self.texts.items():
            rows = self._add("mcap-text-change", differs & is_sound, steps)
            self.values[np.array(self.wanted.said[steps].places)[:, None], rows] = np.nan
        for steps, differs in self.lengths.items():
            self._add("mcap-array-length", differs & is_sound, steps)
        return self.values, self.faults

    def _add(self, code: str, affected: Bools, steps: Steps) -> Offsets:
        if len(rows := np.flatnonzero(affected)):
            self.faults.append(MessageFault(code, rows, path(steps)))
        return rows


class Spread:
    """Takes parsed messages apart, place by place, all messages at once.

    Args:
        batch: takes their numbers, and what differs from the first messages.
    """

    def __init__(self, batch: Batch) -> None:
        self._batch, self._wanted = batch, batch.wanted
        self._columns = {steps: i for i, steps in enumerate(batch.wanted.numbers)}
        places = (*batch.wanted.numbers, *batch.wanted.said, *batch.wanted.lengths)
        self._places = {steps[:k] for steps in places for k in range(1, len(steps) + 1)}

    def walk(self, nodes: Sequence[Any], rows: Offsets, shape: Tree, steps: Steps = ()) -> None:
        """Takes what is wanted of the values at a place.

        Args:
            nodes: the values.
            rows: the messages that have them, shape (len(nodes),).
            shape: what the first messages have there.
            steps: the place.
        """
        if isinstance(shape, (dict, list)):
            nodes, rows = self._usable(nodes, rows, shape, steps)
            if not nodes:
                return
            if isinstance(shape, dict):
                self._members(nodes, rows, shape, steps)
            else:
                self._elements(nodes, rows, shape, steps)
        elif said := self._wanted.said.get(steps):
            differs = [node != said.text and node not in ("", None) for node in nodes]
            self._batch.texts[steps][rows] = differs
        elif (i := self._columns.get(steps)) is not None:
            self._numbers(nodes, rows, i, steps)

    def _usable(
        self, nodes: Sequence[Any], rows: Offsets, shape: Tree, steps: Steps
    ) -> tuple[Sequence[Any], Offsets]:
        """The values that are what the first messages have there, and their messages."""
        return nodes, rows

    def _visits(self, shape: Tree, steps: Steps) -> bool:
        """Whether a place matters."""
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
        if steps in self._batch.lengths:
            self._batch.lengths[steps][rows] = count != self._wanted.lengths[steps]
        for k, child in enumerate(shape):
            if self._visits(child, place := (*steps, k)):
                children = [node[k] for node in nodes if len(node) > k]
                if children:
                    self.walk(children, rows[count > k], child, place)

    def _numbers(self, nodes: Sequence[Any], rows: Offsets, column: int, steps: Steps) -> None:
        if (words := self._wanted.words.get(steps)) is not None:
            texts = [node.strip() if isinstance(node, str) else "" for node in nodes]
            new_words = [text for text in dict.fromkeys(texts) if text and text not in words]
            words += new_words[: MOST_WORDS - len(words)]
            number_of = {word: float(k) for k, word in enumerate(words)}
            nodes = [number_of.get(text, np.nan) for text in texts]
        self._batch.values[column, rows] = nodes


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

    @abstractmethod
    def unit(self, steps: Steps) -> tuple[str, str]:
        """The unit the schema states for a number, and where; "" for none."""

    def names(self, steps: Steps) -> Mapping[int, str]:
        """The names that the schema gives the numbers at a place; none where it gives none."""
        return {}

    def columns(
        self, data: bytes, start: Offsets, stop: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[MessageFault]]:
        """Many messages at once. As many are parsed as may stand in memory together.

        Args:
            data: bytes that hold the messages.
            start: offsets of the messages' first bytes, shape (n,).
            stop: offsets after their last bytes, shape (n,).
            wanted: what to take from each.

        Returns:
            Values of shape (len(wanted.numbers), n), NaN where a message has no such number,
            and what was left out.
        """
        batch = Batch(wanted, len(start))
        cuts = np.flatnonzero(np.diff(np.cumsum(stop - start + _OVERHEAD) // _TOGETHER)) + 1
        for begin, end in pairwise([0, *cuts.tolist(), len(start)]):
            messages, rows = list[Any](), list[int]()
            spans = zip(start[begin:end].tolist(), stop[begin:end].tolist(), strict=True)
            for row, (a, b) in enumerate(spans, begin):
                try:
                    messages.append(self.parse(data[a:b]))
                    rows.append(row)
                except UndecodableError as e:
                    batch.refuse(row, str(e))
            if messages:
                self.spread(batch).walk(messages, np.array(rows), wanted.shape)
        return batch.finish()
