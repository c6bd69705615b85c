"""JSON messages: parsed one by one, taken apart key by key."""

import json
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from operator import itemgetter
from typing import Any

import numpy as np
import orjson

from ...core.model import Floats
from .blocks import Bytes, Offsets
from .columns import Batch, MessageFault, Wanted
from .fields import LONG_ARRAY, Steps, Tree, UndecodableError, path
from .stamps import microseconds

_TOGETHER = 1 << 20  # bytes of messages that are parsed before their numbers are taken
_NUMBERS = {int, float, bool}
_NUMERIC_TYPES = (int, float, dict, list)  # a number


def _loads(raw: bytes) -> Tree:
    """A JSON text; NaN and Infinity are numbers in it, which Python writes."""
    try:
        return orjson.loads(raw)
    except orjson.JSONDecodeError as e:
        reason = e.msg
    if (
        (b"NaN" in raw or b"Infinity" in raw)
        and len(raw) < _TOGETHER
        and b"\\ud" not in raw.lower()
    ):
        with suppress(ValueError, RecursionError):
            return json.loads(raw, parse_int=float)
    raise UndecodableError(f"not JSON: {reason}")


class JsonDecoder:
    """JSON messages of one channel, with or without a JSON schema.

    Args:
        schema: the JSON schema, or b"".
        limit: bytes of one message; a message takes up to twenty times that when it is read.

    Raises:
        UndecodableError: where the schema is no JSON object.
    """

    def __init__(self, schema: bytes, limit: int) -> None:
        self._limit = limit
        try:
            self._schema = orjson.loads(schema) if schema.strip() else {}
        except orjson.JSONDecodeError as e:
            raise UndecodableError(f"JSON schema: {e}") from None

    def tree(self, message: bytes) -> Tree:
        """One message as plain values."""
        if len(message) > self._limit:
            raise UndecodableError(
                f"a JSON message of {len(message)} bytes, limit {self._limit}; if the log is "
                f"trusted, raise it with --set mcap.max_record={32 * len(message)}"
            )
        return _loads(message)

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
        self, buffer: Bytes, start: Offsets, stop: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[MessageFault]]:
        """Many messages at once, see Decoder: as many as may stand in memory together."""
        batch = np.cumsum(stop - start) // _TOGETHER
        cuts = [0, *(np.flatnonzero(np.diff(batch)) + 1).tolist(), len(start)]
        values, faults = np.empty((len(wanted.numbers), len(start))), list[MessageFault]()
        for a, b in pairwise(cuts):
            values[:, a:b], batch_faults = self._together(buffer, start[a:b], stop[a:b], wanted)
            faults += [replace(fault, rows=fault.rows + a) for fault in batch_faults]
        return values, faults

    def _together(
        self, buffer: Bytes, start: Offsets, stop: Offsets, wanted: Wanted
    ) -> tuple[Floats, list[MessageFault]]:
        raw, loads = buffer.data, orjson.loads
        spans = list(zip(start.tolist(), stop.tolist(), strict=True))
        batch, rows = Batch(wanted, len(spans)), np.arange(len(spans))
        messages = list[Tree]()
        if len(spans) > 1:  # a single one may be too large
            with suppress(orjson.JSONDecodeError):
                messages = [loads(raw[a:b]) for a, b in spans]
        if not messages:
            parsed = []
            for i, (a, b) in enumerate(spans):
                try:
                    messages.append(self.tree(bytes(raw[a:b])))
                    parsed.append(i)
                except UndecodableError as e:
                    batch.refuse(i, str(e))
            rows = np.array(parsed, np.int64)
        if messages:
            _Spread(batch).walk(messages, rows, wanted.shape, ())
        return batch.finish()


class _Spread:
    """Takes a list of trees apart, place by place."""

    def __init__(self, batch: Batch) -> None:
        self._batch, self._wanted = batch, batch.wanted
        self._columns = {steps: i for i, steps in enumerate(batch.wanted.numbers)}
        self._places = self._columns.keys() | batch.wanted.said.keys()

    def walk(self, nodes: list[Tree], rows: Offsets, shape: Tree, steps: Steps) -> None:
        """Takes the `nodes` that the messages `rows` have at a place; `shape` came on opening."""
        if isinstance(shape, dict):
            if subset := self._of_type(dict, nodes, rows, steps):
                self._object(*subset, shape, steps)
        elif isinstance(shape, list):
            if len(shape) <= LONG_ARRAY and (subset := self._of_type(list, nodes, rows, steps)):
                self._array(*subset, shape, steps)
        elif said := self._wanted.said.get(steps):
            differs = [node != said.text and node not in ("", None) for node in nodes]
            self._batch.texts[steps][rows] = differs
        elif (i := self._columns.get(steps)) is not None:
            if steps == self._wanted.iso:
                self._batch.values[i, rows] = list(map(microseconds, nodes))
            else:
                self._number(nodes, rows, i, steps)

    def _fault(self, code: str, rows: Offsets, place: str) -> None:
        if len(rows):
            self._batch.faults.append(MessageFault(code, rows, place or "message"))

    def _of_type(
        self, kind: type, nodes: list[Tree], rows: Offsets, steps: Steps
    ) -> tuple[list[Tree], Offsets] | None:
        if set(map(type, nodes)) == {kind}:
            return nodes, rows
        is_kind = np.array([type(node) is kind for node in nodes], np.bool_)
        differs = [not ok and node is not None for ok, node in zip(is_kind, nodes, strict=True)]
        self._fault("mcap-type-change", rows[differs], path(steps))
        if not is_kind.any():
            return None
        return [node for node in nodes if type(node) is kind], rows[is_kind]

    def _object(self, nodes: list[Tree], rows: Offsets, shape: Tree, steps: Steps) -> None:
        if keys := set().union(*nodes) - shape.keys():
            has_new_keys = [not node.keys() <= shape.keys() for node in nodes]
            suffix = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
            self._fault("mcap-late-field", rows[has_new_keys], path((*steps, min(keys))) + suffix)
        for key, child in shape.items():
            place = (*steps, key)
            if not isinstance(child, (dict, list)) and place not in self._places:
                if child is None:
                    has_new_keys = [isinstance(node.get(key), _NUMERIC_TYPES) for node in nodes]
                    self._fault("mcap-late-field", rows[has_new_keys], path(place))
                continue
            try:
                self.walk(list(map(itemgetter(key), nodes)), rows, child, place)
            except KeyError:
                if children := [node[key] for node in nodes if key in node]:
                    self.walk(children, rows[[key in node for node in nodes]], child, place)

    def _array(self, nodes: list[Tree], rows: Offsets, shape: Tree, steps: Steps) -> None:
        count = np.array(list(map(len, nodes)))
        if steps in self._batch.lengths:
            self._batch.lengths[steps][rows] = count != self._wanted.lengths[steps]
        for k, child in enumerate(shape):
            place = (*steps, k)
            if not isinstance(child, (dict, list)) and place not in self._places:
                continue
            if children := [node[k] for node in nodes if len(node) > k]:
                self.walk(children, rows[count > k], child, place)

    def _number(self, nodes: list[Tree], rows: Offsets, i: int, steps: Steps) -> None:
        if set(map(type, nodes)) <= _NUMBERS:
            self._batch.values[i, rows] = nodes
            return
        number = np.array([type(node) in _NUMBERS for node in nodes], np.bool_)
        numbers = [node for node in nodes if type(node) in _NUMBERS]
        self._batch.values[i, rows[number]] = numbers
        not_numeric = ~number & np.array([node is not None for node in nodes], np.bool_)
        self._fault("mcap-type-change", rows[not_numeric], path(steps))
