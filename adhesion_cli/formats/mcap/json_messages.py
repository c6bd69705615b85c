"""JSON messages: parsed one by one, taken apart key by key."""

import re
from dataclasses import replace
from itertools import pairwise
from operator import itemgetter
from typing import Any

import numpy as np
import orjson

from ...core.model import Floats
from .blocks import Bytes, Offsets
from .columns import EXACT, Batch, Fault, Wanted
from .fields import LONG_ARRAY, Steps, Tree, UndecodableError, at, path
from .stamps import microseconds

_MOST_LATE = 20  # new keys of one object that are reported one by one, of each block
_TOGETHER = 1 << 20  # bytes of messages that are parsed before their numbers are taken
_NUMBERS = {int, float, bool}
_MAY_HOLD = (int, float, dict, list)  # a number
# Python writes these although JSON does not have them. The pattern matches strings to keep them.
_NO_NUMBER = re.compile(rb'("(?:[^"\\]++|\\.)*+"?)|(?<![\w.])-?(?:NaN|Infinity)\b', re.DOTALL)


def _loads(raw: bytes, no_number: bytes) -> Tree:
    """A JSON text; NaN and Infinity in it are what `no_number` says."""
    try:
        return orjson.loads(raw)
    except orjson.JSONDecodeError:
        if (b"NaN" not in raw and b"Infinity" not in raw) or len(raw) > _TOGETHER:
            raise
        return orjson.loads(_NO_NUMBER.sub(lambda m: m[1] or no_number, raw))


class JsonDecoder:
    """JSON messages of one channel, with or without a JSON schema.

    Args:
        schema: the JSON schema, or b"".
        most: bytes of one message; a message takes up to twenty times that when it is read.

    Raises:
        UndecodableError: where the schema is no JSON object.
    """

    def __init__(self, schema: bytes, most: int) -> None:
        self._most = most
        try:
            self._schema = orjson.loads(schema) if schema.strip() else {}
        except orjson.JSONDecodeError as e:
            raise UndecodableError(f"JSON schema: {e}") from None

    def tree(self, message: bytes) -> Tree:
        """One message as plain values."""
        try:
            self._bounded(len(message))
            return _loads(message, b"0")  # NaN is a number, whichever
        except orjson.JSONDecodeError as e:
            raise UndecodableError(f"not JSON: {e}") from None

    def _bounded(self, size: int) -> None:
        if size > self._most:
            raise UndecodableError(
                f"a JSON message of {size} bytes, limit {self._most}; if the log is trusted, raise "
                f"it with --set mcap.max_record={32 * size}"
            )

    def unit(self, steps: Steps) -> tuple[str, str]:
        """The property `unit` (or `units`) that the JSON schema states for the field."""
        node: Any = self._schema
        for step in steps:
            if not isinstance(node, dict):
                return "", ""
            if isinstance(step, int):
                node = node.get("items")
            else:
                properties = node.get("properties")
                node = properties.get(step) if isinstance(properties, dict) else None
        for key in ("unit", "units"):
            if isinstance(node, dict) and isinstance(node.get(key), str):
                return node[key], f"JSON schema {key!r}"
        return "", ""

    def columns(
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[Fault]]:
        """Many messages at once, see Decoder: as many as may stand in memory together."""
        batch = np.cumsum(end - start) // _TOGETHER
        cuts = [0, *(np.flatnonzero(np.diff(batch)) + 1).tolist(), len(start)]
        if len(cuts) == 2:
            return self._together(buffer, start, end, wanted)
        values, faults = np.empty((len(wanted.leaves), len(start))), list[Fault]()
        for a, b in pairwise(cuts):
            values[:, a:b], found = self._together(buffer, start[a:b], end[a:b], wanted)
            faults += [replace(fault, rows=fault.rows + a) for fault in found]
        return values, faults

    def _together(
        self, buffer: Bytes, start: Offsets, end: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[Fault]]:
        raw, loads = buffer.data, orjson.loads
        spans = list(zip(start.tolist(), end.tolist(), strict=True))
        batch, rows = Batch(wanted, len(spans)), np.arange(len(spans))
        try:
            if len(spans) == 1:
                self._bounded(int(end[0] - start[0]))
            messages = [loads(raw[a:b]) for a, b in spans]
        except (orjson.JSONDecodeError, UndecodableError):
            messages, whole = [], []
            for i, (a, b) in enumerate(spans):
                try:
                    self._bounded(b - a)
                    messages.append(_loads(bytes(raw[a:b]), b'"NaN"'))
                    whole.append(i)
                except UndecodableError as e:
                    batch.refuse(i, str(e))
                except orjson.JSONDecodeError as e:
                    batch.refuse(i, f"not JSON: {e.msg}")
            rows = np.array(whole, np.int64)
        if messages:
            _Spread(batch).walk(messages, rows, wanted.known, ())
        for steps, named in wanted.labels.items():
            batch.texts[steps][rows] = [at(message, steps) != named for message in messages]
        return batch.finish()


class _Spread:
    """Takes a list of trees apart, place by place."""

    def __init__(self, batch: Batch) -> None:
        self._batch, self._wanted = batch, batch.wanted
        self._columns = {steps: i for i, steps in enumerate(batch.wanted.leaves)}
        self._places = self._columns.keys() | batch.wanted.said.keys()

    def walk(self, nodes: list[Tree], rows: Offsets, known: Tree, steps: Steps) -> None:
        """Takes the `nodes` that the messages `rows` have at a place; `known` came on opening."""
        if isinstance(known, dict):
            if found := self._only(dict, nodes, rows, steps):
                self._object(*found, known, steps)
        elif isinstance(known, list):
            if len(known) <= LONG_ARRAY and (found := self._only(list, nodes, rows, steps)):
                self._array(*found, known, steps)
        elif said := self._wanted.said.get(steps):
            other = [node != said.text and node not in ("", None) for node in nodes]
            self._batch.texts[steps][rows] = other
        elif (i := self._columns.get(steps)) is not None:
            if steps == self._wanted.iso:
                self._batch.values[i, rows] = list(map(microseconds, nodes))
            else:
                self._number(nodes, rows, i, steps)

    def _fault(self, code: str, rows: Offsets, place: str) -> None:
        if len(rows):
            self._batch.faults.append(Fault(code, rows, place or "message"))

    def _only(
        self, kind: type, nodes: list[Tree], rows: Offsets, steps: Steps
    ) -> tuple[list[Tree], Offsets] | None:
        if set(map(type, nodes)) == {kind}:
            return nodes, rows
        is_kind = np.array([type(node) is kind for node in nodes], np.bool_)
        other = [not ok and node is not None for ok, node in zip(is_kind, nodes, strict=True)]
        self._fault("mcap-type-change", rows[other], path(steps))
        if not is_kind.any():
            return None
        return [node for node in nodes if type(node) is kind], rows[is_kind]

    def _object(self, nodes: list[Tree], rows: Offsets, known: Tree, steps: Steps) -> None:
        keys = sorted(set().union(*nodes) - known.keys())
        if len(keys) > _MOST_LATE:
            late = [not node.keys() <= known.keys() for node in nodes]
            self._fault("mcap-late-field", rows[late], f"keys of {path(steps) or 'message'}")
            keys = []
        for key in keys:
            late = [key in node for node in nodes]
            self._fault("mcap-late-field", rows[late], path((*steps, key)))
        for key, child in known.items():
            place = (*steps, key)
            if not isinstance(child, (dict, list)) and place not in self._places:
                if child is None:
                    late = [isinstance(node.get(key), _MAY_HOLD) for node in nodes]
                    self._fault("mcap-late-field", rows[late], path(place))
                continue
            try:
                self.walk(list(map(itemgetter(key), nodes)), rows, child, place)
            except KeyError:
                if below := [node[key] for node in nodes if key in node]:
                    self.walk(below, rows[[key in node for node in nodes]], child, place)

    def _array(self, nodes: list[Tree], rows: Offsets, known: Tree, steps: Steps) -> None:
        count = np.array(list(map(len, nodes)))
        if steps in self._batch.lengths:
            self._batch.lengths[steps][rows] = count != self._wanted.lengths[steps]
        for k, child in enumerate(known):
            place = (*steps, k)
            if not isinstance(child, (dict, list)) and place not in self._places:
                continue
            if below := [node[k] for node in nodes if len(node) > k]:
                self.walk(below, rows[count > k], child, place)

    def _number(self, nodes: list[Tree], rows: Offsets, i: int, steps: Steps) -> None:
        if set(map(type, nodes)) <= _NUMBERS:
            self._put(nodes, rows, i)
            return
        number = np.array([type(node) in _NUMBERS for node in nodes], np.bool_)
        self._put([node for node in nodes if type(node) in _NUMBERS], rows[number], i)
        nan = np.array([node == "NaN" for node in nodes], np.bool_)
        self._fault("mcap-not-a-number", rows[nan], path(steps))
        other = ~number & ~nan & np.array([node is not None for node in nodes], np.bool_)
        self._fault("mcap-type-change", rows[other], path(steps))

    def _put(self, numbers: list[Tree], rows: Offsets, i: int) -> None:
        values = self._batch.values
        values[i, rows] = numbers
        for k in np.flatnonzero(np.abs(values[i, rows]) >= EXACT).tolist():
            number = numbers[k]
            rounded = isinstance(number, int) and int(float(number)) != number
            self._batch.rounded[i, rows[k]] = rounded
