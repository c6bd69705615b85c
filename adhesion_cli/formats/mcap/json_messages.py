"""JSON messages: parsed one by one, taken apart key by key."""

import json
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import orjson

from .columns import Decoder, DecodingFault, Faults, Places
from .fields import Steps, Tree, UndecodableError, nodes, path

_LONGEST = 1 << 22  # bytes of a message, which takes up to twenty times that when it is read
_NUMERIC_TYPES = (int, float, dict, list)  # of what is a number, or may hold some


class JsonDecoder(Decoder):
    """JSON messages of one channel, with or without a JSON schema.

    Raises:
        UndecodableError: where the schema is no JSON object.
    """

    def __init__(self, schema: bytes) -> None:
        try:
            self._schema = orjson.loads(schema) if schema.strip() else {}
        except orjson.JSONDecodeError as e:
            raise UndecodableError(f"JSON schema: {e}") from None

    def parse(self, message: bytes) -> Tree:
        """See Decoder; NaN and Infinity are numbers, which Python writes."""
        if len(message) > _LONGEST:
            raise UndecodableError(f"a JSON message of {len(message)} bytes, limit {_LONGEST}")
        try:
            return orjson.loads(message)
        except orjson.JSONDecodeError as e:
            reason = e.msg
        if (b"NaN" in message or b"Infinity" in message) and b"\\ud" not in message.lower():
            with suppress(ValueError, RecursionError):
                return json.loads(message, parse_int=float)
        raise UndecodableError(f"not JSON: {reason}")

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

    def watched(self, tree: Tree) -> Iterable[Steps]:
        """See Decoder."""
        return (steps for steps, node in nodes(tree) if isinstance(node, (dict, list)))

    def faults(self, nodes: list[Any], shape: Tree, steps: Steps, wanted: Places) -> Faults:
        """See Decoder."""
        kind = type(shape)
        if set(map(type, nodes)) != {kind}:
            has_fault = [node is not None and type(node) is not kind for node in nodes]
            yield DecodingFault("mcap-type-change", path(steps) or "message"), has_fault
            nodes[:] = [node if type(node) is kind else None for node in nodes]
        if kind is list:
            return
        members = [node or {} for node in nodes]
        if keys := set().union(*members) - shape.keys():
            suffix = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
            place = path((*steps, min(keys))) + suffix
            has_new_keys = [not node.keys() <= shape.keys() for node in members]
            yield DecodingFault("mcap-late-field", place), has_new_keys
        for key in (key for key, child in shape.items() if child is None):
            has_number = [isinstance(node.get(key), _NUMERIC_TYPES) for node in members]
            yield DecodingFault("mcap-late-field", path((*steps, key))), has_number
