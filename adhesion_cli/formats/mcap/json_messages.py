"""JSON messages: parsed one by one, taken apart key by key."""

import json
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import orjson

from .blocks import Offsets
from .columns import Decoder, DecodingFault, Spread
from .fields import LONG_ARRAY, Steps, Tree, UndecodableError, path
from .stamps import microseconds

_MOST_NAN = 1 << 20  # bytes of a message with NaN or Infinity
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
        and len(raw) < _MOST_NAN
        and b"\\ud" not in raw.lower()
    ):
        with suppress(ValueError, RecursionError):
            return json.loads(raw, parse_int=float)
    raise UndecodableError(f"not JSON: {reason}")


class _JsonSpread(Spread):
    """Takes JSON messages apart; no schema says what they hold, so each may differ."""

    def _usable(
        self, nodes: Sequence[Tree], rows: Offsets, shape: Tree, steps: Steps
    ) -> tuple[Sequence[Tree], Offsets]:
        if isinstance(shape, list) and len(shape) > LONG_ARRAY:
            return [], rows
        kind = type(shape)
        if set(map(type, nodes)) == {kind}:
            return nodes, rows
        is_kind = np.array([type(node) is kind for node in nodes], np.bool_)
        differs = [not ok and node is not None for ok, node in zip(is_kind, nodes, strict=True)]
        self._decoded.note(
            DecodingFault("mcap-type-change", path(steps) or "message"), rows[differs]
        )
        return [node for node in nodes if type(node) is kind], rows[is_kind]

    def _visits(self, shape: Tree, steps: Steps) -> bool:
        return isinstance(shape, (dict, list)) or super()._visits(shape, steps)

    def _members(
        self, nodes: Sequence[Tree], rows: Offsets, shape: dict[str, Tree], steps: Steps
    ) -> None:
        if keys := set().union(*nodes) - shape.keys():
            has_new_keys = [not node.keys() <= shape.keys() for node in nodes]
            suffix = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
            place = path((*steps, min(keys))) + suffix
            self._decoded.note(DecodingFault("mcap-late-field", place), rows[has_new_keys])
        for key in (key for key, child in shape.items() if child is None):
            has_number = [isinstance(node.get(key), _NUMERIC_TYPES) for node in nodes]
            self._decoded.note(
                DecodingFault("mcap-late-field", path((*steps, key))), rows[has_number]
            )
        super()._members(nodes, rows, shape, steps)

    def _numbers(self, nodes: Sequence[Tree], rows: Offsets, column: int, steps: Steps) -> None:
        if steps == self._decoded.iso:
            nodes = list(map(microseconds, nodes))
        elif steps not in self._decoded.words and not set(map(type, nodes)) <= _NUMBERS:
            is_number = np.array([type(node) in _NUMBERS for node in nodes], np.bool_)
            not_numeric = ~is_number & np.array([node is not None for node in nodes], np.bool_)
            self._decoded.note(DecodingFault("mcap-type-change", path(steps)), rows[not_numeric])
            nodes, rows = [node for node in nodes if type(node) in _NUMBERS], rows[is_number]
        super()._numbers(nodes, rows, column, steps)


class JsonDecoder(Decoder):
    """JSON messages of one channel, with or without a JSON schema.

    A message may have `limit` bytes; it takes up to twenty times that when it is read.

    Raises:
        UndecodableError: where the schema is no JSON object.
    """

    spread = _JsonSpread

    def __init__(self, schema: bytes, limit: int) -> None:
        self._limit = limit
        try:
            self._schema = orjson.loads(schema) if schema.strip() else {}
        except orjson.JSONDecodeError as e:
            raise UndecodableError(f"JSON schema: {e}") from None

    def parse(self, message: bytes) -> Tree:
        """See Decoder."""
        if len(message) > self._limit:
            raise UndecodableError(
                f"a JSON message of {len(message)} bytes, limit {self._limit}; if the log is "
                f"trusted, raise it with --set mcap.max_record={32 * len(message)}"
            )
        return _loads(message)

    tree = parse

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
