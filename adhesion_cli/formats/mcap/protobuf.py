"""Protobuf messages: the protobuf library parses them one by one."""

from collections.abc import Container, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from operator import attrgetter
from typing import Any

from google.protobuf.descriptor import FieldDescriptor as F
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.unknown_fields import UnknownFieldSet

from .columns import Decoder, DecodingFault, Faults, Places
from .fields import DEEPEST, LONG_ARRAY, Opaque, Steps, Tree, UndecodableError

_MESSAGES = (F.TYPE_MESSAGE, F.TYPE_GROUP)
_TEXTS = (F.TYPE_STRING, F.TYPE_BYTES)
_MOST_FIELDS = 1 << 16  # of one message, before the messages in it stay closed


class ProtobufDecoder(Decoder):
    """Messages of one protobuf schema.

    `data` is a serialized FileDescriptorSet.

    Raises:
        UndecodableError: where the set is broken, incomplete, cyclic or has no such type.
    """

    def __init__(self, name: str, data: bytes) -> None:
        pool = _pool(data)
        try:
            self._type = pool.FindMessageTypeByName(name)
        except KeyError:
            raise UndecodableError(f"schema does not define {name}") from None
        try:
            self._class = GetMessageClass(self._type)
        except RecursionError:  # the library goes into each type within a type
            raise UndecodableError(f"types in {name} nest too deep") from None

    def parse(self, message: bytes) -> Any:
        """See Decoder."""
        try:
            return self._class.FromString(message)
        except DecodeError as e:
            raise UndecodableError(f"not a {self._type.full_name}: {e}") from None

    def tree(self, message: bytes) -> Tree:
        """One message as plain values; messages inside that are absent show their defaults."""
        return _tree(self.parse(message), (self._type,), [_MOST_FIELDS])

    def children(self, nodes: Sequence[Any], step: str | int) -> list[Any]:
        """See Decoder; messages have attributes in place of keys."""
        messages = [node for node in nodes if node is not None]
        if isinstance(step, int) or not messages:
            return super().children(nodes, step)
        has_presence = messages[0].DESCRIPTOR.fields_by_name[step].has_presence
        if not has_presence and len(messages) == len(nodes):
            return list(map(attrgetter(step), nodes))
        has_field = (x is not None and (not has_presence or x.HasField(step)) for x in nodes)
        pairs = zip(nodes, has_field, strict=True)
        return [getattr(node, step) if has_value else None for node, has_value in pairs]

    def faults(self, nodes: list[Any], shape: Tree, steps: Steps, wanted: Places) -> Faults:
        """See Decoder."""
        messages = [node for node in nodes if node is not None]
        if not messages or not isinstance(shape, dict):
            return
        numbers = {f.number for f in messages[0].DESCRIPTOR.fields if (*steps, f.name) in wanted}
        reasons = [_wire_fault(node, numbers) for node in nodes]
        for reason in filter(None, dict.fromkeys(reasons)):
            fault = DecodingFault("mcap-bad-message", reason=reason)
            yield fault, [other == reason for other in reasons]

    def names(self, steps: Steps) -> Mapping[int, str]:
        """See Decoder; without what all names of an enum begin with, as style guides ask for."""
        field = self._field(steps)
        if field is None or field.enum_type is None:
            return {}
        values = field.enum_type.values
        pieces = [value.name.split("_") for value in values]
        while len({words[0] for words in pieces}) == 1 and all(len(words) > 1 for words in pieces):
            pieces = [words[1:] for words in pieces]
        numbers = (value.number for value in values)
        return dict(zip(numbers, map(" ".join, pieces), strict=True))

    def _field(self, steps: Steps) -> Any:
        kind, field = self._type, None
        for step in steps:
            if isinstance(step, str):
                field = kind.fields_by_name[step] if kind else None
                kind = field.message_type if field else None
        return field


def _pool(data: bytes) -> DescriptorPool:
    try:
        by_name = {file.name: file for file in FileDescriptorSet.FromString(data).file}
    except DecodeError as e:
        raise UndecodableError(f"schema is no FileDescriptorSet: {e}") from None
    order = TopologicalSorter({file.name: list(file.dependency) for file in by_name.values()})
    pool = DescriptorPool()
    try:
        for name in order.static_order():
            pool.Add(by_name[name])
    except CycleError:
        raise UndecodableError("schema imports files in a circle") from None
    except KeyError as e:
        raise UndecodableError(f"schema imports {e}, which it does not hold") from None
    except TypeError as e:
        raise UndecodableError(f"schema file {name!r} is wrong: {e}") from None
    return pool


def _wire_fault(message: Any, numbers: Container[int]) -> str:
    """Why a message, not one in it, breaks its schema in these fields; "" where it does not."""
    for unknown in UnknownFieldSet(message) if message is not None else ():
        if unknown.field_number in numbers:
            name = f"field {unknown.field_number} of {message.DESCRIPTOR.full_name}"
            return f"{name} has another wire type, or a value that its enum does not have"
    return ""


def _numeric(f: Any, visited: set[str]) -> bool:
    if f.type not in _MESSAGES:
        return f.type not in _TEXTS
    if _is_map(f) or f.message_type.full_name in visited:
        return False
    visited.add(f.message_type.full_name)
    return any(_numeric(member, visited) for member in f.message_type.fields)


def _is_map(f: Any) -> bool:
    return f.type == F.TYPE_MESSAGE and bool(f.message_type.GetOptions().map_entry)


def _tree(message: Any, ancestors: tuple[Any, ...], budget: list[int]) -> Tree:
    """A message as plain values.

    `ancestors` are the types of the messages it stands in, and its own. `budget` counts down how
    many more fields may be shown: types that hold each other several times make a tree wide.
    """
    if reason := _wire_fault(message, message.DESCRIPTOR.fields_by_number):
        raise UndecodableError(reason)
    if budget[0] <= 0:
        return Opaque(f"after {_MOST_FIELDS} others")
    budget[0] -= len(message.DESCRIPTOR.fields)
    tree: dict[str, Tree] = {}
    for f in message.DESCRIPTOR.fields:
        value = getattr(message, f.name)
        is_expandable = f.message_type not in ancestors and len(ancestors) < DEEPEST
        if _is_map(f):
            tree[f.name] = Opaque("a map")
        elif f.type == F.TYPE_BYTES:
            tree[f.name] = Opaque("bytes")
        elif f.is_repeated:
            elements = value[: LONG_ARRAY + 1]
            if f.type in _MESSAGES:
                elements = [_tree(v, (*ancestors, f.message_type), budget) for v in elements]
            if elements or _numeric(f, set()):
                tree[f.name] = list(elements)
        elif f.type not in _MESSAGES:
            tree[f.name] = value
        elif message.HasField(f.name) or is_expandable:
            tree[f.name] = _tree(value, (*ancestors, f.message_type), budget)
        else:
            reason = "holds itself" if f.message_type in ancestors else "too deep"
            tree[f.name] = Opaque(f"absent at first, {reason}")
    return tree
