"""Columns of generated MCAP files equal what the ordinary decoders give."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    EnumDescriptorProto,
    FieldDescriptorProto,
    OneofDescriptorProto,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from helpers.mcap_logs import START, Log, cdr, message, proto_file, proto_schema
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as Ros2Factory

from adhesion_cli.formats.mcap.reader import open_mcap
from adhesion_cli.formats.source import ReadOptions

F = FieldDescriptorProto
SOME = settings(
    max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture]
)  # fmt: skip
containers = st.fixed_dictionaries(
    {
        "compression": st.sampled_from(["", "zstd", "lz4"]),
        "per_chunk": st.sampled_from([0, 1, 3, 100]),
        "index": st.booleans(),
        "summary": st.booleans(),
        "statistics": st.booleans(),
        "crc": st.booleans(),
        "end": st.sampled_from([True, True, True, False]),
        "padding": st.sampled_from([b"", b"\0", b"later fields"]),
        "repeat": st.booleans(),
        "attachments": st.integers(0, 2),
        "metadata": st.sampled_from([{}, {"wagon": "7", "": "ü"}]),
        "unknown": st.booleans(),
    }
)
# in any order, repeated, before 1990 and after
times = st.integers(0, 20).map(lambda n: START + n * 1_000_003)


def value_at(tree: Any, path: str) -> float | int:
    """The number at a path of a decoded message, NaN where it has none."""
    for step in re.findall(r"[^.\[\]]+|\[\d+\]", path):
        if step.startswith("["):
            index = int(step[1:-1])
            if tree is None or index >= len(tree):
                return math.nan
            tree = tree[index]
        elif isinstance(tree, dict):
            tree = tree.get(step)
        elif hasattr(tree, "DESCRIPTOR"):
            f = tree.DESCRIPTOR.fields_by_name[step]
            tree = None if f.has_presence and not tree.HasField(step) else getattr(tree, step)
        else:
            tree = getattr(tree, step, None)
    return tree if isinstance(tree, (int, float)) else math.nan


def opaque_in(message: Any) -> bool:
    """Whether a message has maps or bytes, which are not read but told."""
    for f in message.DESCRIPTOR.fields if hasattr(message, "DESCRIPTOR") else ():
        value = getattr(message, f.name)
        if f.type == F.TYPE_BYTES or is_map(f):
            return True
        if f.type == F.TYPE_MESSAGE and any(map(opaque_in, value if f.is_repeated else [value])):
            return True
    return False


def is_map(f: Any) -> bool:
    return f.type == F.TYPE_MESSAGE and bool(f.message_type.GetOptions().map_entry)


def numbers_in(tree: Any, at: str = "") -> set[str]:
    """Paths of all numbers of a decoded message, written a second time, more simply."""
    if isinstance(tree, (int, float)):
        return {at}
    if isinstance(tree, (list, tuple)) or type(tree).__name__.startswith("Repeated"):
        return {p for i, v in enumerate(tree) for p in numbers_in(v, f"{at}[{i}]")}
    if isinstance(tree, bytes):
        return {f"{at}[{i}]" for i in range(len(tree))} if not at.endswith("!") else set()
    if isinstance(tree, dict):
        inside = tree
    elif hasattr(tree, "DESCRIPTOR"):
        inside = {
            f.name: getattr(tree, f.name)
            for f in tree.DESCRIPTOR.fields
            if f.type != F.TYPE_BYTES and not is_map(f)
        }
    elif hasattr(tree, "__slots__"):
        inside = {name: getattr(tree, name) for name in tree.__slots__}
    else:
        return set()
    return {
        p for k, v in inside.items() for p in numbers_in(v, f"{at}.{k}" if at else k)
    }  # fmt: skip


def check(folder: Path, log: Log, decoded: dict[int, list[tuple[int, Any]]]) -> None:
    """Compares all columns of a log with decoded messages by channel id.

    Args:
        folder: where to write the log.
        log: the log.
        decoded: log time and ordinarily decoded message, by channel id.
    """
    path = folder / "log.mcap"
    path.write_bytes(log.bytes())
    source = open_mcap(path, ReadOptions(time_source="log"))
    assert source.rows == len(log.messages)
    assert any(f.code == "mcap-damaged" for f in source.findings) == (not log.end)
    assert source.metadata == ({"meta": log.metadata} if log.metadata else {})
    topics = {c.topic: c.id for c in log.channels}
    columns = source.columns(source.fields)
    seen: dict[str, set[str]] = {}
    for f, column in zip(source.fields, columns, strict=True):
        messages = decoded[topics[f.channel]]
        messages = sorted(messages, key=lambda m: m[0])  # stable
        np.testing.assert_array_equal(column.t, [t for t, _ in messages])
        expected = np.array([value_at(m, f.path) for _, m in messages], float)
        np.testing.assert_array_equal(column.value, expected, err_msg=f.path)
        np.testing.assert_array_equal(column.valid, np.isfinite(expected))
        seen.setdefault(f.channel, set()).add(f.path)
    for topic, number in topics.items():
        if messages := decoded[number]:
            at_first = numbers_in(messages[0][1])
            later = seen.get(topic, set()) - at_first  # in messages that are absent at first
            assert at_first <= seen.get(topic, set()), topic
            assert all("[" in p for p in later), topic
    told = {f.code for f in source.findings}
    assert told <= {"mcap-damaged", "mcap-unordered", "mcap-not-offered"}
    opaque = any(opaque_in(m[0][1]) for m in decoded.values() if m)
    if not any(c.message_encoding == "json" for c in log.channels):  # texts may be numbers there
        assert ("mcap-not-offered" in told) == opaque


# ---------------------------------------------------------------------- protobuf

SCALARS = [
    F.TYPE_DOUBLE, F.TYPE_FLOAT, F.TYPE_INT64, F.TYPE_UINT64, F.TYPE_INT32, F.TYPE_FIXED64,
    F.TYPE_FIXED32, F.TYPE_BOOL, F.TYPE_STRING, F.TYPE_BYTES, F.TYPE_UINT32, F.TYPE_ENUM,
    F.TYPE_SFIXED32, F.TYPE_SFIXED64, F.TYPE_SINT32, F.TYPE_SINT64,
]  # fmt: skip
RANGES = {
    F.TYPE_INT64: (-(2**63), 2**63 - 1), F.TYPE_SFIXED64: (-(2**63), 2**63 - 1),
    F.TYPE_SINT64: (-(2**63), 2**63 - 1), F.TYPE_UINT64: (0, 2**64 - 1),
    F.TYPE_FIXED64: (0, 2**64 - 1), F.TYPE_INT32: (-(2**31), 2**31 - 1),
    F.TYPE_SFIXED32: (-(2**31), 2**31 - 1), F.TYPE_SINT32: (-(2**31), 2**31 - 1),
    F.TYPE_UINT32: (0, 2**32 - 1), F.TYPE_FIXED32: (0, 2**32 - 1), F.TYPE_ENUM: (0, 2),
}  # fmt: skip


@st.composite
def proto_files(draw: st.DrawFn) -> tuple[Any, str]:
    """A file with messages M0, M1, M2, each of which may hold the ones before it."""
    syntax = draw(st.sampled_from(["proto3", "proto2"]))
    made: list[DescriptorProto] = []
    for n in range(draw(st.integers(1, 3))):
        of = DescriptorProto(name=f"M{n}")
        if draw(st.booleans()):
            of.oneof_decl.append(OneofDescriptorProto(name="choice"))
        numbers = draw(st.lists(st.integers(1, 40), min_size=1, max_size=5, unique=True))
        for i, number in enumerate(numbers):
            kinds = SCALARS + [F.TYPE_MESSAGE] * (3 if made else 0)
            kind = draw(st.sampled_from(kinds))
            f = of.field.add(name=f"f{i}", number=number, type=kind, label=F.LABEL_OPTIONAL)
            if kind == F.TYPE_MESSAGE:
                f.type_name = f".t.{draw(st.sampled_from(made)).name}"
            if kind == F.TYPE_ENUM:
                f.type_name = ".t.E"
            how = draw(st.sampled_from(["single"] * 2 + ["repeated", "optional", "oneof", "map"]))
            if how == "repeated":
                f.label = F.LABEL_REPEATED
                if can_pack(f):
                    f.options.packed = draw(st.booleans())
            elif how == "map":
                entry = of.nested_type.add(name=f"F{i}Entry")
                entry.options.map_entry = True
                entry.field.add(name="key", number=1, type=F.TYPE_INT32, label=F.LABEL_OPTIONAL)
                value = entry.field.add(name="value", number=2, type=kind, label=F.LABEL_OPTIONAL)
                if f.type_name:
                    value.type_name = f.type_name
                f.label, f.type, f.type_name = (
                    F.LABEL_REPEATED,
                    F.TYPE_MESSAGE,
                    f".t.M{n}.F{i}Entry",
                )
            elif how == "single" and syntax == "proto2" and kind == F.TYPE_DOUBLE:
                f.default_value = "2.5"
            elif how == "oneof" and of.oneof_decl:
                f.oneof_index = 0
            elif how == "optional" and syntax == "proto3" and kind != F.TYPE_MESSAGE:
                f.proto3_optional = True
        if of.oneof_decl and not any(f.HasField("oneof_index") for f in of.field):
            del of.oneof_decl[:]
        for f in of.field:
            if f.proto3_optional:
                f.oneof_index = len(of.oneof_decl)
                of.oneof_decl.append(OneofDescriptorProto(name=f"_{f.name}"))
        made.append(of)
    file = proto_file(made, syntax)
    enum = EnumDescriptorProto(name="E")
    for i in range(3):
        enum.value.add(name=f"E{i}", number=i)
    file.enum_type.append(enum)
    return file, made[-1].name


def can_pack(f: FieldDescriptorProto) -> bool:
    kinds = (*RANGES, F.TYPE_DOUBLE, F.TYPE_FLOAT, F.TYPE_BOOL)
    return f.label == F.LABEL_REPEATED and f.type in kinds


def fill(draw: st.DrawFn, of: Any, lengths: dict[str, int], at: str = "") -> None:
    for f in of.DESCRIPTOR.fields:
        place = f"{at}.{f.name}"
        if is_map(f):
            kind = f.message_type.fields_by_name["value"]
            for key in draw(st.lists(st.integers(-2, 9), max_size=2)):
                if kind.type == F.TYPE_MESSAGE:
                    getattr(of, f.name).get_or_create(key)
                else:
                    getattr(of, f.name)[key] = scalar(draw, kind.type)
        elif f.is_repeated:
            # a log's arrays keep their length, those of other lengths have a test of their own
            for k in range(lengths.setdefault(place, draw(st.integers(0, 3)))):
                if f.type == F.TYPE_MESSAGE:
                    fill(draw, getattr(of, f.name).add(), lengths, f"{place}[{k}]")
                else:
                    getattr(of, f.name).append(scalar(draw, f.type))
        elif draw(st.integers(0, 3)):
            if f.type == F.TYPE_MESSAGE:
                getattr(of, f.name).SetInParent()
                fill(draw, getattr(of, f.name), lengths, place)
            else:
                setattr(of, f.name, scalar(draw, f.type))


def scalar(draw: st.DrawFn, kind: int) -> Any:
    if kind in RANGES:
        low, high = RANGES[kind]
        return draw(
            st.one_of(st.integers(low, high), st.integers(max(low, -3), 3 if high > 2 else 2))
        )
    if kind == F.TYPE_DOUBLE:
        return draw(st.floats())
    if kind == F.TYPE_FLOAT:
        return draw(st.floats(width=32))
    if kind == F.TYPE_BOOL:
        return draw(st.booleans())
    return draw(st.text(max_size=4)) if kind == F.TYPE_STRING else draw(st.binary(max_size=140))


@SOME
@given(st.data(), proto_files(), containers, st.booleans(), st.booleans())
def test_protobuf(
    tmp_path: Path, data: Any, of: Any, how: Any, unknown: bool, repacked: bool
) -> None:
    file, root = of
    pool = DescriptorPool()
    pool.Add(file)
    make = GetMessageClass(pool.FindMessageTypeByName(f"t.{root}"))
    if repacked:  # a reader takes packed numbers where the schema has them single, and vice versa
        for f in (f for m in file.message_type for f in m.field if can_pack(f)):
            f.options.packed = not f.options.packed
    schema = proto_schema(file, root)
    decode = ProtobufFactory().decoder_for("protobuf", schema)
    log = Log([schema], [Channel(1, "/a", "protobuf", {}, 1)], **how)
    decoded = []
    lengths: dict[str, int] = {}
    for _ in range(data.draw(st.integers(1, 12))):
        made = make()
        fill(data.draw, made, lengths)
        raw = made.SerializePartialToString()
        if unknown and data.draw(st.booleans()):
            raw += data.draw(
                st.sampled_from([b"\xa8\x1f\x05", b"\xaa\x1f\x03abc", b"\xa9\x1f12345678"])
            )
        t = data.draw(times)
        log.messages.append(message(1, t, raw))
        decoded.append((t, decode(raw)))
    # arrays whose parent is absent in the first message have no length there
    if "mcap-array-length" in codes(tmp_path, log):
        return
    check(tmp_path, log, {1: decoded})


def codes(folder: Path, log: Log) -> set[str]:
    path = folder / "log.mcap"
    path.write_bytes(log.bytes())
    source = open_mcap(path, ReadOptions())
    source.columns(source.fields)
    return {f.code for f in source.findings}


# ---------------------------------------------------------------------- ROS 2

ROS = {
    "bool": st.booleans(), "byte": st.integers(0, 255), "char": st.integers(0, 127),
    "int8": st.integers(-128, 127), "uint8": st.integers(0, 255),
    "int16": st.integers(-(2**15), 2**15 - 1), "uint16": st.integers(0, 2**16 - 1),
    "int32": st.integers(-(2**31), 2**31 - 1), "uint32": st.integers(0, 2**32 - 1),
    "int64": st.integers(-(2**63), 2**63 - 1), "uint64": st.integers(0, 2**64 - 1),
    "float32": st.floats(width=32), "float64": st.floats(), "string": st.text(max_size=9),
}  # fmt: skip


@st.composite
def ros_schemas(draw: st.DrawFn) -> tuple[Schema, dict[str, list[tuple[str, str, str]]]]:
    """A schema, and by type its fields: name, type and array suffix."""
    types: dict[str, list[tuple[str, str, str]]] = {}
    for n in range(draw(st.integers(1, 3))):
        fields = []
        for i in range(draw(st.integers(0, 5))):
            kind = draw(st.sampled_from([*ROS, *types, *types]))
            suffix = draw(st.sampled_from(["", "", "", "[2]", "[]", "[<=3]"]))
            fields.append((f"f{i}", kind, suffix))
        types[f"T{n}"] = fields
    (root, own), *others = reversed(types.items())
    text = "# a comment\nuint8 CONSTANT=3\n"
    for name, fields in [(root, own), *others]:
        if name != root:
            text += f"{'=' * 40}\nMSG: pkg/{name}\n"
        for f, kind, suffix in fields:
            full = f"pkg/{kind}" if kind in types and draw(st.booleans()) else kind
            text += f"{full}{suffix} {f}  # says nothing\n"
    return Schema(1, text.encode(), "ros2msg", f"pkg/msg/{root}"), types


def ros_value(draw: st.DrawFn, types: Any, kind: str, lengths: dict[str, int], at: str) -> Any:
    if kind in ROS:
        return draw(ROS[kind])
    value = {}
    for name, inner, suffix in types[kind]:
        place = f"{at}.{name}"
        if suffix:
            count = 2 if suffix == "[2]" else lengths.setdefault(place, draw(st.integers(0, 3)))
            value[name] = [
                ros_value(draw, types, inner, lengths, f"{place}[{k}]") for k in range(count)
            ]
        else:
            value[name] = ros_value(draw, types, inner, lengths, place)
    return value


@SOME
@given(st.data(), ros_schemas(), containers)
def test_ros2(tmp_path: Path, data: Any, of: Any, how: Any) -> None:
    schema, types = of
    root = schema.name.split("/")[-1]
    decode = Ros2Factory().decoder_for("cdr", schema)
    log = Log([schema], [Channel(1, "/a", "cdr", {}, 1)], **how)
    decoded = []
    lengths: dict[str, int] = {}
    for _ in range(data.draw(st.integers(1, 8))):
        value = ros_value(data.draw, types, root, lengths, "")
        raw = cdr(schema, value, little=data.draw(st.booleans()))
        t = data.draw(times)
        log.messages.append(message(1, t, raw))
        decoded.append((t, decode(raw)))
    check(tmp_path, log, {1: decoded})


# ---------------------------------------------------------------------- JSON

json_numbers = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.integers(-(2**63), 2**64 - 1),
    st.booleans(),
)
json_shapes = st.recursive(
    st.sampled_from(["number", "text", "null"]),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
    ),
    max_leaves=8,
)


def json_value(draw: st.DrawFn, shape: Any) -> Any:
    if isinstance(shape, list):
        return [json_value(draw, inner) for inner in shape]
    if isinstance(shape, dict):
        return {key: json_value(draw, inner) for key, inner in shape.items()}
    return {"number": draw(json_numbers), "text": draw(st.text(max_size=3)), "null": None}[shape]


@SOME
@given(
    st.data(), st.dictionaries(st.sampled_from("abcd"), json_shapes), containers, st.booleans()
)  # fmt: skip
def test_json(tmp_path: Path, data: Any, shape: Any, how: Any, schema: bool) -> None:
    schemas = [Schema(1, b"{}", "jsonschema", "j")] if schema else []
    log = Log(schemas, [Channel(1, "/a", "json", {}, int(schema))], **how)
    decoded = []
    for _ in range(data.draw(st.integers(1, 8))):
        raw = json.dumps(json_value(data.draw, shape)).encode()
        t = data.draw(times)
        log.messages.append(message(1, t, raw))
        decoded.append((t, json.loads(raw)))
    check(tmp_path, log, {1: decoded})


def test_several_channels_come_in_order_of_log_time(tmp_path: Path) -> None:
    channels = [Channel(i, f"/c{i}", "json", {}, 0) for i in range(5)]
    rng = np.random.default_rng(3)
    log = Log([], channels, per_chunk=37, compression="zstd")
    decoded: dict[int, list[tuple[int, Any]]] = {c.id: [] for c in channels}
    for i in range(500):
        number, t = int(rng.integers(5)), START + int(rng.integers(100))
        log.messages.append(message(number, t, b'{"x": %d}' % i))
        decoded[number].append((t, {"x": i}))
    check(tmp_path, log, decoded)


@pytest.mark.parametrize("index", [True, False])
def test_an_index_that_lies_changes_nothing(tmp_path: Path, index: bool) -> None:
    """Nothing is read by indexes that skip messages, repeat them or point elsewhere."""
    from helpers.mcap_logs import chunk, record
    from mcap.records import MessageIndex

    log = Log([], [Channel(1, "/c", "json", {}, 0)], per_chunk=100)
    log.messages = [message(1, START + i, b'{"x": %d}' % i) for i in range(20)]
    _, entries = chunk([*log.channels, *log.messages], "")
    whole = log.bytes()
    true = record(MessageIndex(1, entries[1]))
    for lie in (entries[1][3:15:2], entries[1] * 2, [(0, 7), (0, 1 << 62)], [(0, -1 % 2**64)]):
        false = record(MessageIndex(1, lie)) if index else b""
        path = tmp_path / "log.mcap"
        path.write_bytes(whole.replace(true, false)[: len(whole) - 8] + b"")
        source = open_mcap(path, ReadOptions())
        (column,) = source.columns(source.fields)
        np.testing.assert_array_equal(column.value, np.arange(20.0))
