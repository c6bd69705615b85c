"""What an MCAP source offers: fields with labels and units, clocks, findings."""

import json
import struct
import subprocess
import sys
import time
from collections import Counter
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
    OneofDescriptorProto,
)
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as F
from helpers.mcap_logs import (
    START,
    Log,
    cdr,
    double_message,
    message,
    proto_file,
    proto_schema,
    scalar_log,
)
from mcap.records import Channel, Schema

from adhesion_cli.channels.log import unchanged
from adhesion_cli.channels.meaning import understood
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Column
from adhesion_cli.formats.mcap.reader import McapSource, open_mcap
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import Field, ReadOptions
from adhesion_cli.results.wide_table import write_csv

JOINT_STATE = Schema(
    1,
    b"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity  # speed of the joint [rad/s]
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""",
    "ros2msg",
    "sensor_msgs/msg/JointState",
)


def joints(t: int, names: list[str], little: bool = True, **arrays: list[float]) -> bytes:
    stamp = {"sec": t // 10**9, "nanosec": t % 10**9}
    header = {"stamp": stamp, "frame_id": "wagon"}
    return cdr(JOINT_STATE, {"header": header, "name": names, **arrays}, little)


def opened(folder: Path, log: Log, **options: Any) -> McapSource:
    path = folder / "log.mcap"
    path.write_bytes(log.bytes())
    return open_mcap(path, ReadOptions(**options))


def read(source: McapSource) -> dict[str, Column]:
    """Columns by "topic path"."""
    columns = source.columns(source.fields)
    return {
        f"{f.channel} {f.path}": c for f, c in zip(source.fields, columns, strict=True)
    }  # fmt: skip


def json_log(*channels: list[tuple[int, Any]], **metadata: str) -> Log:
    """JSON channels /0, /1, ... of (log time after START [ns], message)."""
    log = Log([], [Channel(i, f"/{i}", "json", metadata, 0) for i in range(len(channels))])
    log.messages = [
        message(i, START + t, json.dumps(body).encode())
        for i, rows in enumerate(channels)
        for t, body in rows
    ]
    return log


def codes(source: McapSource) -> list[tuple[str, int]]:
    return [(f.code, f.count) for f in source.findings]


# ---------------------------------------------------------------------- fields


def test_joint_state_elements_carry_their_names(tmp_path: Path) -> None:
    log = Log([JOINT_STATE], [Channel(1, "/joints", "cdr", {}, 1)], per_chunk=4)
    for i in range(10):
        body = joints(START + i, ["left", "r"], position=[i, 2.0 * i], velocity=[0.5, i])
        log.messages.append(message(1, START + i + 5, body))
    source = opened(tmp_path, log)
    assert [(f.path, f.label, f.unit) for f in source.fields] == [
        ("position[0]", "left", ""),
        ("position[1]", "r", ""),
        ("velocity[0]", "left", "rad/s"),
        ("velocity[1]", "r", "rad/s"),
    ]
    assert {f.message_type for f in source.fields} == {"sensor_msgs/msg/JointState"}
    columns = read(source)
    np.testing.assert_array_equal(columns["/joints position[1]"].value, 2.0 * np.arange(10))
    np.testing.assert_array_equal(columns["/joints position[1]"].t, START + np.arange(10))
    assert source.findings == []


def test_a_copy_keeps_the_names_of_elements(tmp_path: Path) -> None:
    """Only they say here whose axle an element is."""
    log = Log([JOINT_STATE], [Channel(1, "/joints", "cdr", {}, 1)])
    for i in range(10):
        body = joints(START + i, ["axle_4", "axle_3"], velocity=[0.5, i])
        log.messages.append(message(1, START + i, body))
    source = opened(tmp_path, log)
    expected = [m.axle for m in understood(source.fields, ())[0]]
    write_csv(tmp_path / "a.csv", unchanged(source, ()))
    copy = open_source(tmp_path / "a.csv", ReadOptions())
    assert [m.axle for m in understood(copy.fields, ())[0]] == expected == [4, 3]


def test_names_that_change_take_their_numbers_out(tmp_path: Path) -> None:
    """Several publishers on one topic, each with joints of its own, as ROS allows."""
    log = Log([JOINT_STATE], [Channel(1, "/joints", "cdr", {}, 1)])
    for i, names in enumerate([["a", "b"], ["a", "b"], ["b", "a"], ["a", "bb"], ["a", "b"]]):
        log.messages.append(message(1, START + i, joints(START + i, names, position=[1.0, 2.0])))
    source = opened(tmp_path, log)
    first, second = (column.valid.tolist() for column in read(source).values())
    assert first == [True, True, False, True, True]
    assert second == [True, True, False, False, True]
    assert codes(source) == [("mcap-text-change", 1), ("mcap-text-change", 2)]


def test_messages_laid_out_alike_and_otherwise_in_one_block(tmp_path: Path) -> None:
    two = {"position": [1.5, 2.5], "velocity": [0.0, -1.0]}
    plain = joints(START, ["left", "r"], **two)
    text = plain.index(b"wagon\0") + 6
    assert plain[text : text + 2] == b"\0\0"  # padding, which writers need not clear
    cases = [
        (plain, [1.5, 2.5, 0.0, -1.0]),
        (plain[:text] + b"\x07\xff" + plain[text + 2 :], [1.5, 2.5, 0.0, -1.0]),
        (plain.replace(b"wagon", b"train"), [1.5, 2.5, 0.0, -1.0]),  # nobody asks for it
        (plain + b"more", [1.5, 2.5, 0.0, -1.0]),
        (plain + b"many more", [np.nan] * 4),
        (plain[:-5], [np.nan] * 4),
        (joints(START, ["left", "q"], **two), [1.5, np.nan, 0.0, np.nan]),
        (
            joints(START, ["left", "r"], position=[3.0], velocity=[4.0, 5.0]),
            [3.0, np.nan, 4.0, 5.0],
        ),
        (joints(START, ["left", "r"], position=[6.0, 7.0], velocity=[8.0, 9.0]), [6, 7, 8, 9]),
        (joints(START, ["left", "r"], little=False, **two), [1.5, 2.5, 0.0, -1.0]),
        (plain[:3], [np.nan] * 4),
    ]
    order = [0, *np.random.default_rng(5).integers(len(cases), size=60).tolist()]
    log = Log([JOINT_STATE], [Channel(1, "/joints", "cdr", {}, 1)], per_chunk=9)
    log.messages = [message(1, START + i, cases[k][0]) for i, k in enumerate(order)]
    source = opened(tmp_path, log, time_source="log")
    got = np.array([column.value for column in read(source).values()]).T
    np.testing.assert_array_equal(got, np.array([cases[k][1] for k in order], float))
    count = Counter(order)
    assert sorted(codes(source)) == [
        ("mcap-array-length", count[7]),
        *[("mcap-bad-message", n) for n in sorted([count[4], count[5], count[10]])],
        ("mcap-text-change", count[6]),
    ]


UNIT_SCHEMA = Schema(1, b"float64 x\nstring unit\nfloat64 y_bar", "ros2msg", "p/msg/T")


@pytest.mark.parametrize("encoding", ["json", "protobuf", "cdr"])
def test_a_unit_that_changes_takes_its_numbers_out(tmp_path: Path, encoding: str) -> None:
    units = ["bar", "bar", "kPa", "", "bars", "bar"]
    of = double_message()
    of.field.add(name="unit", number=2, type=F.TYPE_STRING, label=F.LABEL_OPTIONAL)
    schema = UNIT_SCHEMA if encoding == "cdr" else proto_schema(proto_file([of]), "D")
    typed = encoding != "json"
    log = Log([schema] if typed else [], [Channel(1, "/a", encoding, {}, int(typed))])
    for i, unit in enumerate(units):
        body = {
            "json": json.dumps({"value": 1.0, "unit": unit} if unit else {"value": 1.0}).encode(),
            "protobuf": b"\x09" + struct.pack("<d", 1.0)
            + (b"\x12" + bytes([len(unit)]) + unit.encode() if unit else b""),
            "cdr": cdr(UNIT_SCHEMA, {"x": 1.0, "unit": unit, "y_bar": 2.0}),
        }[encoding]  # fmt: skip
        log.messages.append(message(1, START + i, body))
    source = opened(tmp_path, log)
    assert {f.unit for f in source.fields} == {"bar"}
    for column in read(source).values():
        assert column.valid.tolist() == [True, True, False, True, False, True]
    (finding,) = source.findings
    assert (finding.code, finding.severity, finding.count) == ("mcap-text-change", "error", 2)
    assert (finding.spans, finding.names) == (((2e-9, 2e-9), (4e-9, 4e-9)), {"field": "unit"})
    with pytest.raises(UserError, match="/a: unit"):
        read(opened(tmp_path, log, strict=True))


def test_a_clock_set_back_is_not_sorted(tmp_path: Path) -> None:
    """Else two stretches of the log were mixed; the time axis begins a segment there."""
    times = [*range(0, 200, 2), *range(101, 301, 2)]
    source = opened(tmp_path, json_log([(t, {"x": t}) for t in times]))
    assert (read(source)["/0 x"].t - START).tolist() == times
    assert source.findings == []
    chunks = [*range(100, 200), *range(100)]  # exchanged
    source = opened(tmp_path, json_log([(t, {"x": t}) for t in chunks]))
    assert read(source)["/0 x"].value.tolist() == list(range(200))
    assert codes(source) == [("mcap-unordered", 100)]


def test_a_unit_of_its_own_per_element(tmp_path: Path) -> None:
    first, second = {"v": [1, 2], "units": ["m", "s"]}, {"v": [3, 4], "units": ["m", "ms"]}
    structs = [[{"name": "a", "w": 1}, {"name": n, "w": 2}] for n in "bc"]
    rows = [(0, first | {"in": structs[0]}), (1, second | {"in": structs[1]})]
    source = opened(tmp_path, json_log(rows))
    valid = {name: column.valid.tolist() for name, column in read(source).items()}
    assert valid == {
        "/0 v[0]": [True, True], "/0 v[1]": [True, False],
        "/0 in[0].w": [True, True], "/0 in[1].w": [True, False],
    }  # fmt: skip
    assert codes(source) == [("mcap-text-change", 1)] * 2


def test_structs_are_named_by_their_own_name(tmp_path: Path) -> None:
    body = {"axles": [{"name": "A1", "v": 1}, {"name": "A2", "v": 2}]}
    source = opened(tmp_path, json_log([(0, body)]))
    assert [(f.path, f.label) for f in source.fields] == [
        ("axles[0].v", "A1"),
        ("axles[1].v", "A2"),
    ]


@pytest.mark.parametrize(
    ("body", "metadata", "unit", "place"),
    [
        ({"p": 1, "p_unit": "bar", "unit": "kPa"}, {"unit": "Pa"}, "bar", "field p_unit"),
        ({"p": 1, "unit": "kPa"}, {"unit": "Pa"}, "kPa", "field unit"),
        ({"p": 1}, {"unit.p": "MPa", "unit": "Pa"}, "MPa", "channel metadata 'unit.p'"),
        ({"p": 1}, {"units": "Pa"}, "Pa", "channel metadata 'units'"),
        ({"p": 1, "unit": ""}, {}, "mbar", "JSON schema 'unit'"),
    ],
)
def test_where_a_unit_is_from(
    tmp_path: Path, body: Any, metadata: dict[str, str], unit: str, place: str
) -> None:
    log = json_log([(0, body)], **metadata)
    schema = {"type": "object", "properties": {"p": {"type": "number", "unit": "mbar"}}}
    log.schemas = [Schema(1, json.dumps(schema).encode(), "jsonschema", "x")]
    log.channels[0].schema_id = 1
    (field,) = opened(tmp_path, log).fields
    assert (field.unit, field.unit_from) == (unit, place)


def test_units_beside_and_above(tmp_path: Path) -> None:
    body = {"unit": "bar", "in": {"x": 1}, "many": {"v": [1, 2], "units": ["m", "s"]}}
    found = {f.path: f.unit for f in opened(tmp_path, json_log([(0, body)])).fields}
    assert found == {"in.x": "bar", "many.v[0]": "m", "many.v[1]": "s"}


def test_long_arrays_are_not_offered_but_told(tmp_path: Path) -> None:
    source = opened(tmp_path, json_log([(0, {"image": [0] * 300, "x": 1})]))
    assert [f.path for f in source.fields] == ["x"]
    assert codes(source) == [("mcap-not-offered", 1)]


def test_maps_and_bytes_are_told(tmp_path: Path) -> None:
    of = double_message()
    entry = of.nested_type.add(name="ByNameEntry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=F.TYPE_STRING, label=F.LABEL_OPTIONAL)
    entry.field.add(name="value", number=2, type=F.TYPE_DOUBLE, label=F.LABEL_OPTIONAL)
    of.field.add(
        name="by_name", number=2, type=F.TYPE_MESSAGE, label=F.LABEL_REPEATED,
        type_name=".t.D.ByNameEntry",
    )  # fmt: skip
    of.field.add(name="raw", number=3, type=F.TYPE_BYTES, label=F.LABEL_OPTIONAL)
    log = Log([proto_schema(proto_file([of]), "D")], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START, b"\x09" + struct.pack("<d", 3.0))]
    source = opened(tmp_path, log)
    assert [f.path for f in source.fields] == ["value"]
    (finding,) = source.findings
    assert (finding.code, finding.count) == ("mcap-not-offered", 2)
    assert finding.names == {"fields": "by_name (a map), raw (bytes)"}


def test_an_unknown_encoding_is_told(tmp_path: Path) -> None:
    log = Log([], [Channel(1, "/a", "ros1", {}, 0)], [message(1, START, b"x")])
    source = opened(tmp_path, log)
    assert (list(source.fields), source.rows) == ([], 1)
    assert codes(source) == [("mcap-encoding", 1)]


@pytest.mark.parametrize(("encoding", "schema"), [("protobuf", 7), ("protobuf", 0), ("cdr", 0)])
def test_a_missing_schema_is_reported(tmp_path: Path, encoding: str, schema: int) -> None:
    content = b"\x09" + bytes(8)
    log = Log([], [Channel(1, "/a", encoding, {}, schema)], [message(1, START, content)])
    source = opened(tmp_path, log)
    assert not source.fields
    (finding,) = source.findings
    assert (finding.code, finding.lossy) == ("mcap-topic-unreadable", True)
    assert "the file does not define its schema" in finding.message


def test_json_is_read_without_its_schema(tmp_path: Path) -> None:
    log = Log([], [Channel(1, "/a", "json", {}, 7)], [message(1, START, b'{"x": 1}')])
    source = opened(tmp_path, log)
    assert (len(source.fields), source.findings) == (1, [])


def test_channels_of_one_topic(tmp_path: Path) -> None:
    """With one schema they are one series in the file's order, else two."""
    log = Log([], [Channel(1, "/a", "json", {}, 0), Channel(2, "/a", "json", {"x": "y"}, 0)])
    log.messages = [message(1 + i % 2, START + i, b'{"x": %d}' % i) for i in range(6)]
    source = opened(tmp_path, log)
    assert read(source)["/a x"].value.tolist() == [0, 1, 2, 3, 4, 5]
    assert codes(source) == []

    log.schemas = [Schema(1, b"{}", "jsonschema", "other")]
    log.channels[1].schema_id = 1
    source = opened(tmp_path, log)
    assert [(f.channel, f.group) for f in source.fields] == [
        ("/a", "channel 1"), ("/a", "channel 2"),
    ]  # fmt: skip
    assert [c.value.tolist() for c in source.columns(source.fields)] == [[0, 2, 4], [1, 3, 5]]


def test_channels_of_one_topic_in_two_units_stay_apart(tmp_path: Path) -> None:
    """Else half of the pressure were a hundred times what it is; nor is a channel an axle."""
    units = ["kPa", "bar"]
    log = Log([], [Channel(7 + k, "/brake", "json", {"unit": units[k]}, 0) for k in (0, 1)])
    log.messages = [
        message(7 + i // 3, START + i, b'{"bc_pressure": %d}' % (400, 4)[i // 3]) for i in range(6)
    ]
    source = opened(tmp_path, log)
    assert [(f.group, f.unit) for f in source.fields] == [
        ("channel 7", "kPa"),
        ("channel 8", "bar"),
    ]
    assert [c.value.tolist() for c in source.columns(source.fields)] == [[400] * 3, [4] * 3]
    meant, _ = understood(source.fields, [])
    reason = "its name does not say which axles it serves"
    assert [(m.meaning, m.axle, m.reason) for m in meant] == [(None, None, reason)] * 2


def test_only_what_is_asked_for_is_decoded(tmp_path: Path) -> None:
    log = json_log([(0, {"x": 1}), (1, {"x": 2})], [(0, {"x": 1})])
    log.messages.append(message(1, START, b"broken"))
    source = opened(tmp_path, log)
    x, y = source.fields
    assert source.columns([x, x])[1].value.tolist() == [1, 2]
    assert source.findings == []
    for _ in range(2):  # a second time nothing is told twice
        source.columns([y])
        assert codes(source) == [("mcap-bad-message", 1)]
    with pytest.raises(UserError, match="no field 'z'"):
        source.columns([Field("/0", "z")])


# ---------------------------------------------------------------------- values


@pytest.mark.parametrize("encoding", ["json", "protobuf", "cdr"])
def test_an_array_has_its_usual_length(tmp_path: Path, encoding: str) -> None:
    """A first message that is short, or one that is long, does not cost all others."""
    ros = Schema(1, b"float64[] value", "ros2msg", "p/msg/T")
    of = double_message()
    of.field[0].label = F.LABEL_REPEATED
    schema = ros if encoding == "cdr" else proto_schema(proto_file([of]), "D")
    for odd in ([9.0], [7.0, 8.0, 9.0]):
        arrays = [odd] + [[i, -i] for i in range(1, 20)]
        bodies = {
            "json": lambda x: json.dumps({"value": x}).encode(),
            "protobuf": lambda x: b"\x0a" + bytes([8 * len(x)]) + struct.pack(f"<{len(x)}d", *x),
            "cdr": lambda x: cdr(ros, {"value": x}),
        }
        log = Log([schema], [Channel(1, "/a", encoding, {}, int(encoding != "json"))])
        log.messages = [message(1, START + i, bodies[encoding](x)) for i, x in enumerate(arrays)]
        source = opened(tmp_path, log)
        first, second = read(source).values()
        assert first.value[1:].tolist() == list(range(1, 20))
        assert second.value[1:].tolist() == [-i for i in range(1, 20)]
        assert codes(source) == [("mcap-array-length", 1)]


ENCODINGS = ["json", "protobuf", "cdr"]


def array_log(encoding: str, arrays: list[list[float]], beside: bool) -> Log:
    """Messages with an array of numbers, an array that holds no number, and maybe a number."""
    text = f"float64[] value\nN[] names\nE[2] none{chr(10) + 'float64 x' if beside else ''}"
    text += "\n===\nMSG: p/N\nstring s\n===\nMSG: p/E\n"
    ros = Schema(1, text.encode(), "ros2msg", "p/msg/T")
    of, name = double_message(), DescriptorProto(name="N")
    of.field[0].label = F.LABEL_REPEATED
    name.field.add(name="s", number=1, type=F.TYPE_STRING, label=F.LABEL_OPTIONAL)
    of.field.add(
        name="names", number=2, type=F.TYPE_MESSAGE, type_name=".t.N", label=F.LABEL_REPEATED
    )
    if beside:
        of.field.add(name="x", number=3, type=F.TYPE_DOUBLE, label=F.LABEL_OPTIONAL)
    schema = ros if encoding == "cdr" else proto_schema(proto_file([of, name]), "D")
    log = Log([schema], [Channel(1, "/a", encoding, {}, int(encoding != "json"))], per_chunk=3)
    for i, x in enumerate(arrays):
        names = [{"s": "n"}] * (i % 3)
        tree = {"value": x, "names": names, "none": [{}, {}]} | ({"x": 5.0} if beside else {})
        packed = bytes([10, 8 * len(x)]) + struct.pack(f"<{len(x)}d", *x) if x else b""
        packed += b"\x12\3\x0a\1n" * len(names)
        raw = {
            "json": json.dumps(tree).encode(),
            "protobuf": packed + (b"\x19" + struct.pack("<d", 5.0) if beside else b""),
            "cdr": cdr(ros, tree),
        }
        log.messages.append(message(1, START + i, raw[encoding]))
    return log


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("beside", [False, True])
def test_an_array_that_is_empty_at_first(tmp_path: Path, encoding: str, beside: bool) -> None:
    """Where one of the first messages fills it, it is read; else what comes is told of."""
    soon = opened(tmp_path, array_log(encoding, [[]] * 30 + [[1.0, 2.0]] * 30, beside))
    columns = read(soon)
    assert columns["/a value[1]"].value[30:].tolist() == [2.0] * 30
    assert codes(soon) == [("mcap-array-length", 30)]

    late = opened(tmp_path, array_log(encoding, [[]] * 150 + [[1.0, 2.0]] * 30, beside))
    columns = read(late)
    assert list(columns) == (["/a x"] if beside else [])
    (told,) = late.findings
    if beside:
        assert (told.code, told.severity, told.count) == ("mcap-array-length", "warning", 30)
    else:
        assert told.code == "mcap-not-offered"
        assert "without a number" in told.names["fields"]

    never = opened(tmp_path, array_log(encoding, [[]] * 50, beside))
    read(never)
    assert never.findings == []


def test_what_json_messages_lack_at_first(tmp_path: Path) -> None:
    """In the first block of the file is none of it; what comes after a hundred is told."""
    empty: dict[str, Any] = {"a": None, "x": 0}
    rows = [(0, {}), (1, {}), *((i, empty) for i in range(2, 20)), (20, {"a": 5, "x": 1})]
    log = json_log(rows)
    log.per_chunk = 2
    source = opened(tmp_path, log)
    assert read(source)["/0 a"].value[-1] == 5
    assert source.findings == []
    rows = [*((i, empty) for i in range(150)), (150, {"a": 5, "x": 1}), (151, {"a": "on", "x": 1})]
    source = opened(tmp_path, json_log(rows))
    assert list(read(source)) == ["/0 x"]
    (told,) = source.findings
    assert (told.code, told.count) == ("mcap-late-field", 1)
    assert (told.names, told.spans) == ({"field": "a"}, ((150e-9, 150e-9),))
    rows = [*((i, {"a": "text"}) for i in range(150)), (150, {"a": "text", "x": 1})]
    (told,) = opened(tmp_path, json_log(rows)).findings
    assert told.code == "mcap-not-offered"
    assert "100 messages without a number" in told.names["fields"]


def test_a_message_in_itself_is_told_where_it_is_not_read(tmp_path: Path) -> None:
    of = double_message()
    of.field.add(
        name="next", number=2, type=F.TYPE_MESSAGE, type_name=".t.D", label=F.LABEL_OPTIONAL
    )
    one = b"\x09" + struct.pack("<d", 1.0)
    log = Log([proto_schema(proto_file([of]), "D")], [Channel(1, "/a", "protobuf", {}, 1)])
    two = one + b"\x12\x09" + one
    paths = ["value", "next.value"]
    for messages in [one, two], [one] * 5 + [two]:
        log.messages = [message(1, START + i, raw) for i, raw in enumerate(messages)]
        source = opened(tmp_path, log)
        assert [f.path for f in source.fields] == paths
        (told,) = source.findings
        assert told.code == "mcap-not-offered"
        assert "next (absent at first, holds itself)" in told.names["fields"]


def test_names_without_end_are_not_offered(tmp_path: Path) -> None:
    long = "x" * 5000
    body = {"v": 1, long: 2, "w": [{"name": long, "u": 3}], "unit": long}
    source = opened(tmp_path, json_log([(0, body)]))
    assert [(f.path, f.label, f.unit) for f in source.fields] == [("v", "", ""), ("w[0].u", "", "")]
    (told,) = source.findings
    assert told.code == "mcap-not-offered"
    assert len(told.message) < 200


def test_numbers_in_quotation_marks_are_told(tmp_path: Path) -> None:
    rows = [(i, {"a": {"p": [f"{i}.5", "-1e3"]}, "unit": "bar", "x": "1,5"}) for i in range(9)]
    source = opened(tmp_path, json_log(rows))
    (finding,) = source.findings
    assert (finding.code, finding.count) == ("mcap-not-offered", 3)
    assert finding.names["fields"].startswith("a.p[0] (a number in quotation marks), a.p[1] ")


def test_keys_that_are_ever_new_are_no_names(tmp_path: Path) -> None:
    """A column for each were 200 times the log; one finding tells of them."""
    rows = [(i, {f"k{i}_{j}": j for j in range(20)} | {"x": i}) for i in range(600)]
    source = opened(tmp_path, json_log(rows))
    assert len(source.fields) == 1
    assert read(source)["/0 x"].value.tolist() == list(range(600))
    assert sum(f.count for f in source.findings if f.code == "mcap-late-field") == 600

    rows = [(i, {f"k{i}_{j}": j for j in range(2)} | {"x": i}) for i in range(1500)]
    log = json_log(rows)
    log.per_chunk = 1  # as few new keys in each block as are told one by one
    source = opened(tmp_path, log)
    read(source)
    assert len(source.findings) < 600
    assert sum(f.count for f in source.findings) == 1500


def test_many_channels_cost_each_the_same(tmp_path: Path) -> None:
    spent = []
    for count in (2_000, 8_000):
        log = Log([], [Channel(i, f"/{i}", "json", {}, 0) for i in range(1, count + 1)])
        log.messages = [message(c.id, START + c.id, b'{"x": %d}' % c.id) for c in log.channels]
        opened(tmp_path, log)
        begin = time.process_time()
        source = open_mcap(tmp_path / "log.mcap", ReadOptions())
        columns = source.columns(source.fields)
        spent.append(time.process_time() - begin)
        assert [c.value.tolist() for c in columns] == [[i] for i in range(1, count + 1)]
    assert spent[1] < 8 * spent[0]  # 4; 10 where each channel looks at all others


def test_arrays_of_other_lengths(tmp_path: Path) -> None:
    schema = Schema(1, b"uint8 n\nfloat64[] x\nfloat32 y", "ros2msg", "p/msg/T")
    repeated = double_message()
    repeated.field[0].label = F.LABEL_REPEATED
    proto = proto_schema(proto_file([repeated]), "D", 2)
    log = Log([schema, proto], [
        Channel(1, "/cdr", "cdr", {}, 1), Channel(2, "/proto", "protobuf", {}, 2),
        Channel(3, "/json", "json", {}, 0),
    ])  # fmt: skip
    for i, x in enumerate([[1.0, 2.0], [], [3.0], [4.0, 5.0, 6.0]]):
        packed = b"\x0a" + bytes([8 * len(x)]) + struct.pack(f"<{len(x)}d", *x)
        log.messages += [
            message(1, START + i, cdr(schema, {"n": 1, "x": x, "y": i})),
            message(
                2, START + i, packed if i else b"".join(b"\x09" + struct.pack("<d", v) for v in x)
            ),
            message(3, START + i, json.dumps({"x": x}).encode()),
        ]
    source = opened(tmp_path, log)
    columns = read(source)
    assert columns["/cdr y"].value.tolist() == [0, 1, 2, 3]
    for name in ("/cdr x", "/proto value", "/json x"):
        np.testing.assert_array_equal(columns[f"{name}[0]"].value, [1, np.nan, 3, 4])
        np.testing.assert_array_equal(columns[f"{name}[1]"].value, [2, np.nan, np.nan, 5])
    assert codes(source) == [("mcap-array-length", 3)] * 3


def test_json_keys_that_come_or_change_later(tmp_path: Path) -> None:
    rows = [(i, {"x": i}) for i in range(150)]
    rows[120] = (120, {"x": "7", "late": {"y": 1}})
    rows[130] = (130, {})
    rows[140] = (140, {"x": None})
    source = opened(tmp_path, json_log(rows))
    column = read(source)["/0 x"]
    assert np.flatnonzero(~column.valid).tolist() == [120, 130, 140]
    assert codes(source) == [("mcap-late-field", 1), ("mcap-type-change", 1)]
    assert [(f.names, f.spans) for f in source.findings] == [
        ({"field": "late"}, ((120e-9, 120e-9),)),
        ({"field": "x"}, ((120e-9, 120e-9),)),
    ]


def test_json_keys_of_all_first_messages_are_offered(tmp_path: Path) -> None:
    source = opened(tmp_path, json_log([(0, {"x": 1, "a": None}), (1, {"y": 2, "a": {"b": 3}})]))
    assert [f.path for f in source.fields] == ["x", "a.b", "y"]
    columns = read(source)
    assert columns["/0 y"].valid.tolist() == columns["/0 a.b"].valid.tolist() == [False, True]


def test_protobuf_presence(tmp_path: Path) -> None:
    """Omitted is 0, but absent where the schema can tell."""
    inner = double_message("In")
    outer = DescriptorProto(name="Out")
    one = F.LABEL_OPTIONAL
    outer.field.add(name="plain", number=1, type=F.TYPE_DOUBLE, label=one)
    outer.field.add(
        name="maybe", number=2, type=F.TYPE_DOUBLE, label=one, proto3_optional=True, oneof_index=1
    )
    outer.field.add(name="a", number=3, type=F.TYPE_DOUBLE, label=one, oneof_index=0)
    outer.field.add(name="b", number=4, type=F.TYPE_INT32, label=one, oneof_index=0)
    outer.field.add(name="in", number=5, type=F.TYPE_MESSAGE, label=one, type_name=".t.In")
    outer.oneof_decl.extend([OneofDescriptorProto(name="ab"), OneofDescriptorProto(name="_maybe")])
    schema = proto_schema(proto_file([inner, outer]), "Out")
    two = struct.pack("<d", 2.0)
    bodies = [
        b"",
        b"\x11" + two,
        b"\x20\x07",
        b"\x2a\x00",
        b"\x2a\x09\x09" + two + b"\x2a\x00",  # a message in pieces is merged
        b"\x09" + two + b"\x09" + bytes(8),  # a repeated single field: the last counts
    ]
    log = Log([schema], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START + i, body) for i, body in enumerate(bodies)]
    columns = read(opened(tmp_path, log))
    nan = np.nan
    expected = {
        "plain": [0, 0, 0, 0, 0, 0],
        "maybe": [nan, 2, nan, nan, nan, nan],
        "a": [nan] * 6,
        "b": [nan, nan, 7, nan, nan, nan],
        "in.value": [nan, nan, nan, 0, 2, nan],
    }
    for path, values in expected.items():
        np.testing.assert_array_equal(columns[f"/a {path}"].value, values, err_msg=path)


def test_a_message_longer_than_its_schema_is_refused(tmp_path: Path) -> None:
    """As where a logger found another version of the definition; alignment adds a few bytes."""
    schema = Schema(1, b"float64 x\nuint8 n", "ros2msg", "p/msg/T")
    log = Log([schema], [Channel(1, "/a", "cdr", {}, 1)], per_chunk=4)
    more = [0, 7, 8, 0, 20, 8, 8, 9, 0, 3]
    for i, n in enumerate(more):
        body = b"\0\1\0\0" + struct.pack("<dB", i, 1) + bytes(n)
        log.messages.append(message(1, START + i, body))
    source = opened(tmp_path, log)
    assert read(source)["/a x"].valid.tolist() == [n < 8 for n in more]
    assert codes(source) == [("mcap-bad-message", 5)]


VALUES = """uint8 LOW=3
int32 N = -0x10
float64 INF=-inf
string SAID='# a = b'
char c 200
float64[2] x [1, 2.5e-3]
bool b True
string<=9 s a word
p/Inner i
float32 y -.5
===
MSG: p/Inner
uint8 z 1
===
MSG: p/msg/Inner
uint8 z 2
"""


def test_ros_values_beside_fields_take_no_room(tmp_path: Path) -> None:
    schema = Schema(1, VALUES.encode(), "ros2msg", "p/msg/T")
    body = b"\0\1\0\0" + struct.pack("<B7x2d?3xI2sBxf", 200, 1.5, 2.5, True, 2, b"s", 7, 3.5)
    log = Log([schema], [Channel(1, "/a", "cdr", {}, 1)], [message(1, START, body)])
    columns = {name: column.value.tolist() for name, column in read(opened(tmp_path, log)).items()}
    assert columns == {
        "/a c": [200.0],  # rosidl takes a char as a uint8, mcap-ros2-support as an int8
        "/a x[0]": [1.5], "/a x[1]": [2.5], "/a b": [1.0], "/a i.z": [7.0], "/a y": [3.5],
    }  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        "float64 x float64 y", "float64 xfloat64 y", "uint8 N=3 float64 y",
        "uint8 N=3float64 y", "float64 x-y", "float64 x[3]", "float64<=3 y", f"uint8[{1 << 64}] y",
        f"uint8[{'9' * 5000}] y", "B y\n===\nMSG: p/B\nint8 x\n===\nint16 x",
    ],
)  # fmt: skip
def test_a_ros_schema_that_is_damaged_is_refused(tmp_path: Path, text: str) -> None:
    """Read with a field less, all that follows would be numbers from wrong places."""
    log = Log([Schema(1, text.encode(), "ros2msg", "p/msg/T")], [Channel(1, "/a", "cdr", {}, 1)])
    log.messages = [message(1, START, b"\0\1\0\0" + bytes(40))]
    source = opened(tmp_path, log)
    assert list(source.fields) == []
    assert codes(source) == [("mcap-topic-unreadable", 1)]


def test_unusual_protobuf_is_read(tmp_path: Path) -> None:
    """Very many fields, groups and long varints."""
    schema = proto_schema(proto_file([double_message()]), "D")
    value = b"\x09" + struct.pack("<d", 3.0)
    unusual = [
        b"\x09" + struct.pack("<d", 1.0) * 1 + (b"\x10\x01" * 5000) + value,
        b"\x13\x08\x01\x14" + value,  # an unknown group
        b"\x89\x80\x80\x00" + struct.pack("<d", 3.0),  # a tag with needless bytes
        value,
    ]
    log = Log([schema], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START + i, body) for i, body in enumerate(unusual)]
    source = opened(tmp_path, log)
    assert read(source)["/a value"].value.tolist() == [3.0] * 4
    assert source.findings == []


def test_a_protobuf_field_of_another_type_costs_its_message_where_it_is_wanted(
    tmp_path: Path,
) -> None:
    outer = double_message()
    outer.field.add(name="note", number=2, type=F.TYPE_STRING, label=F.LABEL_OPTIONAL)
    outer.field.add(
        name="in", number=3, type=F.TYPE_MESSAGE, type_name=".t.In", label=F.LABEL_OPTIONAL
    )
    schema = proto_schema(proto_file([double_message("In"), outer]), "D")
    value = b"\x09" + struct.pack("<d", 3.0)
    bodies = [
        value + b"\x1a\x09" + value,
        value + b"\x10\x05\x1a\x09" + value,  # a note that is a number, and nobody asks for it
        value + b"\x1a\x02\x08\x05",  # a value inside that is an integer
        b"\x08\x05\x1a\x09" + value,  # one outside
    ]
    log = Log([schema], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START + i, body) for i, body in enumerate(bodies)]
    source = opened(tmp_path, log)
    for column in read(source).values():
        assert column.valid.tolist() == [True, True, False, False]
    assert codes(source) == [("mcap-bad-message", 1)] * 2


# ---------------------------------------------------------------------- time


def stamped_schema() -> Schema:
    stamp = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    of = DescriptorProto(name="S")
    one = F.LABEL_OPTIONAL
    of.field.add(
        name="timestamp", number=1, type=F.TYPE_MESSAGE, label=one,
        type_name=".google.protobuf.Timestamp",
    )  # fmt: skip
    of.field.add(name="wheel_speed", number=3, type=F.TYPE_DOUBLE, label=one)
    file = proto_file([of])
    file.dependency.append(stamp.name)
    data = FileDescriptorSet(file=[stamp, file]).SerializeToString()
    return Schema(1, data, "protobuf", "t.S")


def stamped(t: int, value: float) -> bytes:
    stamp = timestamp_pb2.Timestamp(seconds=t // 10**9, nanos=t % 10**9).SerializeToString()
    return b"\x0a" + bytes([len(stamp)]) + stamp + b"\x19" + struct.pack("<d", value)


def test_a_stamp_of_its_own_is_the_time(tmp_path: Path) -> None:
    log = Log([stamped_schema()], [Channel(1, "/axle/1/input", "protobuf", {}, 1)], per_chunk=3)
    log.messages = [
        message(1, START + i * 1000 + 7, stamped(START + i * 1000, i)) for i in range(9)
    ]
    source = opened(tmp_path, log)
    assert [f.path for f in source.fields] == ["wheel_speed"]
    (column,) = read(source).values()
    np.testing.assert_array_equal(column.t, START + 1000 * np.arange(9))
    assert source.absolute
    assert "stamp" in source.time_reason
    assert source.findings == []
    (column,) = read(opened(tmp_path, log, time_source="log")).values()
    np.testing.assert_array_equal(column.t, START + 7 + 1000 * np.arange(9))


def test_messages_without_their_stamp_are_not_used(tmp_path: Path) -> None:
    log = Log([stamped_schema()], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START + i, stamped(START + i if i != 2 else 0, i)) for i in range(4)]
    source = opened(tmp_path, log)
    (column,) = read(source).values()
    assert column.valid.tolist() == [True, True, False, True]
    np.testing.assert_array_equal(column.t, START + np.arange(4))
    assert codes(source) == [("mcap-no-stamp", 1)]


def test_a_clock_that_was_set_back_to_zero_is_at_zero(tmp_path: Path) -> None:
    log = Log([stamped_schema()], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, t, stamped(t, i)) for i, t in enumerate((5, 6, 0, 1))]
    source = opened(tmp_path, log)
    (column,) = read(source).values()
    assert column.valid.all()
    assert column.t.tolist() == [5, 6, 0, 1]
    assert "mcap-no-stamp" not in dict(codes(source))


@pytest.mark.parametrize("encoding", ["json", "cdr"])
def test_all_channels_take_one_clock(tmp_path: Path, encoding: str) -> None:
    stamp = {"sec": START // 10**9, "nsec": 500}
    log = json_log([(7, {"timestamp": stamp, "x": 1})], [(9, {"x": 1})])
    if encoding == "cdr":
        log.schemas = [JOINT_STATE]
        log.channels[0] = Channel(0, "/0", "cdr", {}, 1)
        body = joints(START + 500, ["x"], position=[1.0])
        log.messages[0] = message(0, START + 7, body)
    source = opened(tmp_path, log)
    assert [int(c.t[0]) - START for c in read(source).values()] == [7, 9]
    assert source.time_reason == "log time: /1 has no stamps inside"
    with pytest.raises(UserError, match="/1: messages carry no stamp"):
        read(opened(tmp_path, log, time_source="header"))
    del log.channels[1], log.messages[1]
    assert int(next(iter(read(opened(tmp_path, log)).values())).t[0]) == START + 500


@pytest.mark.parametrize("place", ["timestamp", "stamp", "time", "ts", "header.stamp"])
@pytest.mark.parametrize("kind", ["Z", "+01:00", "s", "ms", "us", "ns"])
def test_stamps_as_text_or_one_number(tmp_path: Path, place: str, kind: str) -> None:
    """As doubles carry them: exact to the microsecond."""
    rows: list[tuple[int, Any]] = []
    for i in range(6):
        micros = START // 1000 + 20_001 * i
        own: Any
        if kind in ("Z", "+01:00"):
            zone = UTC if kind == "Z" else timezone(timedelta(hours=1))
            time = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=micros)
            own = time.astimezone(zone).isoformat().replace("+00:00", "Z")
        else:
            own = {"s": micros / 1e6, "ms": micros / 1e3, "us": micros, "ns": micros * 1000}[kind]
        for name in reversed(place.split(".")):
            own = {name: own}
        rows.append((20_001_000 * i + 7_000_000 * (i % 2), own | {"x": i}))
    source = opened(tmp_path, json_log(rows))
    column = read(source)["/0 x"]
    np.testing.assert_array_equal(column.t, START + 20_001_000 * np.arange(6))
    assert column.valid.all()
    assert source.time_reason.startswith("stamp inside the messages")
    assert codes(source) == []


def test_a_number_as_stamp_in_protobuf(tmp_path: Path) -> None:
    of = double_message()
    of.field.add(name="timestamp", number=2, type=F.TYPE_UINT64, label=F.LABEL_OPTIONAL)
    log = Log([proto_schema(proto_file([of]), "D")], [Channel(1, "/a", "protobuf", {}, 1)])
    for i in range(4):
        micros, raw = START // 1000 + 500 * i if i != 2 else 0, b"\x10"
        while micros > 0x7F:
            raw, micros = raw + bytes([micros & 0x7F | 0x80]), micros >> 7
        log.messages.append(message(1, START + i, raw + bytes([micros])))
    source = opened(tmp_path, log)
    columns = read(source)
    assert (columns["/a value"].t - START).tolist() == [0, 500_000, 2, 1_500_000]
    assert columns["/a value"].valid.tolist() == [True, True, False, True]
    assert columns["/a timestamp"].value[1] == START // 1000 + 500
    assert codes(source) == [("mcap-no-stamp", 1)]


@pytest.mark.parametrize(
    "own", ["2023-11-14T22:13:20Z", "2023-11-14", "yesterday", 1_700_000_000, 12.5, True, None]
)
def test_what_is_no_stamp(tmp_path: Path, own: Any) -> None:
    """A date, whole seconds and other numbers do not tell when a sample was taken."""
    source = opened(tmp_path, json_log([(i * 10**7, {"time": own, "x": i}) for i in range(30)]))
    column = read(source)["/0 x"]
    np.testing.assert_array_equal(column.t, START + 10**7 * np.arange(30))
    assert column.valid.all()
    assert source.time_reason.startswith("log time: ")
    assert codes(source) == []


def test_only_channels_that_are_asked_for_decide_on_the_clock(tmp_path: Path) -> None:
    rows = [(7 + i, {"ts": (START + i * 10**6) / 1e9, "x": i}) for i in range(3)]
    source = opened(tmp_path, json_log(rows, [(0, {"cabin": 21})]))
    _, x, cabin = source.fields
    for _ in range(2):
        assert source.columns([x])[0].t.tolist() == [START + i * 10**6 for i in range(3)]
        assert source.time_reason.startswith("stamp inside the messages")
        assert source.reasons["time"] == source.time_reason
    assert source.findings == []
    assert [c.t[0] for c in source.columns([x, cabin])] == [START + 7, START]
    assert source.time_reason == "log time: /1 has no stamps inside"
    assert source.findings == []


def test_a_first_stamp_that_is_not_set_is_said(tmp_path: Path) -> None:
    log = Log([stamped_schema()], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START + i, stamped(START + i if i else 0, i)) for i in range(4)]
    source = opened(tmp_path, log)
    (column,) = read(source).values()
    assert column.valid.all()
    reason = "log time: the stamp inside the first message of /a is 0 or not set"
    assert source.time_reason == reason


def test_python_s_nan_costs_only_its_own_field(tmp_path: Path) -> None:
    texts = [
        b'{"x": NaN, "y": 1, "s": "NaN"}', b'{"x": 2, "y": 3, "s": "\\"NaN"}',
        b'{"x": -Infinity, "y": [NaN]}', b'{"x": Infinity, "y": 4}', b'{"x": NaN, "y": 5',
        b'{"x": xNaN, "y": 6}', b'{"x": "NaN", "y": 7}', b'{"x": "NaN',
    ]  # fmt: skip
    log = json_log([])
    log.messages = [message(0, START + i, text) for i, text in enumerate(texts)]
    source = opened(tmp_path, log)
    columns = read(source)
    assert columns["/0 x"].valid.tolist() == [False, True] + [False] * 6
    np.testing.assert_array_equal(
        columns["/0 y"].value, [1, 3, np.nan, 4] + [np.nan] * 2 + [7, np.nan]
    )
    assert sum(n for code, n in codes(source) if code == "mcap-bad-message") == 3
    assert ("mcap-type-change", 1) in codes(source)


def test_a_log_without_messages_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="the log has no messages"):
        opened(tmp_path, json_log([]))


@pytest.mark.parametrize(
    ("ahead", "source"),
    [(10**6, "header"), (5 * 10**9, "header"), (2 * 86_400 * 10**9, "log")],
)
def test_stamps_away_from_log_time(tmp_path: Path, ahead: int, source: str) -> None:
    log = Log([stamped_schema()], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START + i, stamped(START + i + ahead, i)) for i in range(4)]
    opened_log = opened(tmp_path, log)
    (column,) = read(opened_log).values()
    assert int(column.t[0]) == START + (ahead if source == "header" else 0)


def test_a_log_time_that_stands_still(tmp_path: Path) -> None:
    log = Log([stamped_schema()], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, 0, stamped(START + i, i)) for i in range(4)]
    source = opened(tmp_path, log)
    assert source.time_reason == "stamp inside the messages: the log time stands still"
    assert read(source)["/a wheel_speed"].t.tolist() == [START + i for i in range(4)]


def test_a_first_message_that_is_broken_costs_only_itself(tmp_path: Path) -> None:
    schema = proto_schema(proto_file([double_message()]), "D")
    log = Log([schema], [Channel(1, "/a", "protobuf", {}, 1), Channel(2, "/b", "json", {}, 0)])
    log.messages = [message(1, START, b"\xff"), message(2, START, b"{")]
    log.messages += [message(1, START, b""), message(2, START, b'{"x": 1}')]
    source = opened(tmp_path, log)
    assert [c.valid.tolist() for c in read(source).values()] == [[False, True]] * 2
    assert codes(source) == [("mcap-bad-message", 1)] * 2


def test_two_numbers_of_one_path_are_told_apart(tmp_path: Path) -> None:
    source = opened(tmp_path, json_log([(0, {"a.b": 1, "a": {"b": 2}})]))
    assert read(source)["/0 a.b"].value.tolist() == [1.0]
    assert codes(source) == [("mcap-not-offered", 1)]


def test_definitions_lost_with_a_chunk_are_taken_from_the_summary(tmp_path: Path) -> None:
    log = scalar_log([1.0, 2.0, 3.0, 4.0], per_chunk=2)
    raw = bytearray(log.bytes())
    raw[raw.index(b'{"value": 1.0}') + 3] ^= 1  # in the first chunk, with all definitions
    path = tmp_path / "log.mcap"
    path.write_bytes(raw)
    columns = read(open_mcap(path, ReadOptions()))
    assert [c.value.tolist() for c in columns.values()] == [[3.0], [4.0]]


def test_publish_time_and_a_clock_of_its_own(tmp_path: Path) -> None:
    log = json_log([(0, {"x": 1})])
    log.messages = [message(0, 5, b'{"x": 1}', publish=3), message(0, 4, b'{"x": 2}', publish=9)]
    source = opened(tmp_path, log, time_source="publish")
    assert not source.absolute
    assert read(source)["/0 x"].t.tolist() == [3, 9]
    assert read(opened(tmp_path, log))["/0 x"].t.tolist() == [4, 5]


def test_order_in_the_file_is_not_order_in_time(tmp_path: Path) -> None:
    """The container orders log times by its indexes; the order of stamps is the sender's."""
    order = [0, 10, 30, 20, 40, 5, 30]
    log = json_log([(t, {"x": i}) for i, t in enumerate(order)], [(t, {"x": t}) for t in (1, 2)])
    source = opened(tmp_path, log)
    columns = read(source)
    assert (columns["/0 x"].t - START).tolist() == [0, 5, 10, 20, 30, 30, 40]
    assert columns["/0 x"].value.tolist() == [0, 5, 1, 3, 2, 6, 4]
    assert columns["/1 x"].value.tolist() == [1, 2]
    (finding,) = source.findings
    assert (finding.code, finding.severity, finding.channel) == ("mcap-unordered", "warning", "/0")
    assert (finding.count, finding.spans) == (3, ((5e-9, 30e-9),))
    assert finding.values == {"most_s": 35e-9}

    log = Log([stamped_schema()], [Channel(1, "/a", "protobuf", {}, 1)])
    log.messages = [message(1, START + t, stamped(START + t, t)) for t in order]
    source = opened(tmp_path, log)
    (column,) = read(source).values()
    assert (column.t - START).tolist() == order
    assert source.findings == []


# ---------------------------------------------------------------------- cost


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    log = Log([], [Channel(1, "/x", "json", {}, 0), Channel(2, "/camera", "raw", {}, 0)])
    log.per_chunk, log.compression = 2, "zstd"
    for i in range(120):
        log.messages += [message(1, START + i, b'{"x": 1}'), message(2, START + i, bytes(1 << 20))]
    path = tmp_path / "log.mcap"
    path.write_bytes(log.bytes())
    script = """
import sys
import time
from collections import Counter
from pathlib import Path
from adhesion_cli.formats.mcap.reader import open_mcap
from adhesion_cli.formats.source import ReadOptions
import orjson, zstandard, adhesion_cli.formats.mcap.json_messages
def peak():
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
before = peak()
source = open_mcap(Path(sys.argv[1]), ReadOptions())
(column,) = source.columns(source.fields)
assert column.value.sum() == 120
print(peak() - before)
"""
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)],
        capture_output=True, text=True, check=True, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    assert int(done.stdout) < 16 << 10  # KiB, of 120 MiB in 120 chunks


def test_a_log_is_read_with_and_without_an_index(tmp_path: Path) -> None:
    values = [float(i) for i in range(200)]
    for compression in ("", "zstd", "lz4"):
        for per_chunk in (0, 7, 1000):
            for index in (True, False):
                log = scalar_log(
                    values, compression=compression, per_chunk=per_chunk, index=index
                )  # fmt: skip
                columns = read(opened(tmp_path, log))
                assert columns["/p value"].value.tolist() == values[::2]
                assert columns["/v value"].value.tolist() == values[1::2]


# ---------------------------------------------------------------------- whose numbers they are


@pytest.mark.parametrize("encoding", ["json", "cdr"])
def test_elements_are_known_by_their_own_axle(tmp_path: Path, encoding: str) -> None:
    """Not by their place in the list; an axle that changes takes the numbers out."""
    text = b"Axle[] axles\n===\nMSG: p/Axle\nint32 axle\nfloat64 bc_pressure_bar\n"
    schema = Schema(1, text, "ros2msg", "p/msg/Axles")
    log = Log([schema], [Channel(1, "/a", encoding, {}, int(encoding == "cdr"))])
    for k in range(20):
        axles = (2, 1) if k != 7 else (1, 2)
        tree = {"axles": [{"axle": axle, "bc_pressure_bar": 10.0 * axle} for axle in axles]}
        raw = cdr(schema, tree) if encoding == "cdr" else json.dumps(tree).encode()
        log.messages.append(message(1, START + k, raw))
    source = opened(tmp_path, log)
    meant, _ = understood(source.fields, ())
    pressures = {m.axle: m.field for m in meant if m.meaning == "pressure"}
    columns = source.columns([pressures[1], pressures[2]])
    for axle, column in enumerate(columns, 1):
        assert set(column.value[column.valid]) == {10.0 * axle}
        assert np.flatnonzero(~column.valid).tolist() == [7]
    assert codes(source) == [("mcap-text-change", 1)] * 2


@pytest.mark.parametrize("encoding", ["json", "cdr"])
@pytest.mark.parametrize("owners", [(1, 2), ("axle 1", "axle 2")])
def test_messages_of_several_owners_in_one_topic(
    tmp_path: Path, encoding: str, owners: tuple[Any, Any]
) -> None:
    """Each owner has its series and units; one that comes later is reported."""
    kind = "int32" if owners[0] == 1 else "string"
    text = f"{kind} axle\nfloat64 bc_pressure\nstring unit\n".encode()
    schema = Schema(1, text, "ros2msg", "p/msg/Axle")
    log = Log([schema], [Channel(1, "/a", encoding, {}, int(encoding == "cdr"))], per_chunk=7)
    for k in range(400):
        axle = k % 2 + 1
        owner = owners[axle - 1] if k < 399 else (3 if owners[0] == 1 else "axle 3")
        tree = {"axle": owner, "bc_pressure": float(axle), "unit": ("bar", "kPa")[axle - 1]}
        raw = cdr(schema, tree) if encoding == "cdr" else json.dumps(tree).encode()
        log.messages.append(message(1, START + k, raw))
    source = opened(tmp_path, log)
    meant, _ = understood(source.fields, ())
    pressures = {m.axle: m for m in meant if m.meaning == "pressure"}
    assert [pressures[axle].unit for axle in (1, 2)] == ["bar", "kPa"]
    for axle in (1, 2):  # each alone, too
        (column,) = source.columns([pressures[axle].field])
        assert set(column.value[column.valid]) == {float(axle)}
        assert column.t[column.valid].tolist() == [START + k for k in range(axle - 1, 399, 2)]
    assert {code for code, _ in codes(source)} == {"mcap-text-change"}
