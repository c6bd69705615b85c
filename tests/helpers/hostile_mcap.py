"""MCAP files that nobody should write."""

import struct
from collections.abc import Callable

import lz4.frame
import zstandard
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as F
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    Metadata,
    Schema,
)

from helpers.mcap_logs import (
    MAGIC,
    START,
    Log,
    chunk,
    double_message,
    message,
    proto_file,
    proto_schema,
    raw_record,
    record,
)


def wrapped(*records: bytes) -> bytes:
    data = MAGIC + record(Header("", "")) + b"".join(records)
    return data + record(DataEnd(0)) + record(Footer(0, 0, 0)) + MAGIC


def json_log(*bodies: bytes) -> bytes:
    log = Log([], [Channel(1, "/c", "json", {}, 0)], per_chunk=100)
    log.messages = [message(1, START + i, body) for i, body in enumerate(bodies)]
    return log.bytes()


def typed_log(schema: Schema, encoding: str, *bodies: bytes) -> bytes:
    log = Log([schema], [Channel(1, "/c", encoding, {}, 1)], per_chunk=100)
    log.messages = [message(1, START + i, body) for i, body in enumerate(bodies)]
    return log.bytes()


def ros(text: str) -> Schema:
    return Schema(1, text.encode(), "ros2msg", "p/msg/T")


def bomb(compress: Callable[[bytes], bytes], declared: int, real: int) -> bytes:
    return wrapped(inflating(compress, declared, real))


def inflating(compress: Callable[[bytes], bytes], declared: int, real: int) -> bytes:
    """A chunk of zeros."""
    body = b"\0" * real
    content = struct.pack("<QQQI", 0, 0, declared, 0)
    name = b"zstd" if compress is zstandard.compress else b"lz4"
    packed = compress(body)
    content += struct.pack("<I", len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return raw_record(6, content)


def chain(count: int, circle: bool) -> Schema:
    """Protobuf files that import each other in a row or in a circle."""
    files = [
        FileDescriptorProto(name=f"f{i}", package="t", dependency=[f"f{i + 1}"])
        for i in range(count)
    ]
    last = proto_file([double_message()], name=f"f{count}")
    if circle:
        last.dependency.append("f0")
    data = FileDescriptorSet(file=[*files, last]).SerializeToString()
    return Schema(1, data, "protobuf", "t.D")


def recursive() -> Schema:
    node = double_message("N")
    node.field.add(
        name="next", number=2, type=F.TYPE_MESSAGE, type_name=".t.N", label=F.LABEL_OPTIONAL
    )
    return proto_schema(proto_file([node]), "N")


def fan_out() -> Schema:
    """40 message types, each with four fields of the next: 4^32 fields on 32 levels."""
    types = [
        DescriptorProto(
            name=f"A{n}",
            field=[
                F(
                    name=f"f{i}", number=i, type=F.TYPE_MESSAGE, type_name=f".t.A{n + 1}",
                    label=F.LABEL_OPTIONAL,
                )
                for i in range(1, 5)
            ],
        )
        for n in range(40)
    ]  # fmt: skip
    return proto_schema(proto_file([*types, double_message("A40")]), "A0")


def types_in_types(depth: int) -> Schema:
    types = [
        DescriptorProto(
            name=f"A{n}",
            field=[
                F(
                    name="f", number=1, type=F.TYPE_MESSAGE, type_name=f".t.A{n + 1}",
                    label=F.LABEL_OPTIONAL,
                )
            ],
        )
        for n in range(depth)
    ]  # fmt: skip
    return proto_schema(proto_file([*types, double_message(f"A{depth}")]), "A0")


def nested(depth: int) -> bytes:
    raw = b""
    for _ in range(depth):
        size = len(raw)
        length = b""
        while size > 0x7F:
            length += bytes([size & 0x7F | 0x80])
            size >>= 7
        raw = b"\x12" + length + bytes([size]) + raw
    return raw


D = proto_schema(proto_file([double_message()]), "D")


DOUBLE = b"\x09" + struct.pack("<d", 2.0)


ONE = chunk([Channel(1, "/c", "json", {}, 0), message(1, START, b'{"x": 1}')])[0]


HOSTILE: dict[str, Callable[[], bytes]] = {
    "empty": lambda: b"",
    "magic only": lambda: MAGIC,
    "other magic": lambda: b"\x89MCAP1\r\n" + bytes(100),
    "zstd bomb": lambda: bomb(zstandard.compress, 300 << 20, 300 << 20),
    "zstd bomb that lies": lambda: bomb(zstandard.compress, 100, 300 << 20),
    "lz4 bomb that lies": lambda: bomb(lz4.frame.compress, 100, 300 << 20),
    "huge declared size": lambda: bomb(zstandard.compress, 1 << 62, 10),
    "length 2^63": lambda: wrapped(ONE, raw_record(12, b"", 1 << 63)),
    "length 2^64-1": lambda: wrapped(ONE, raw_record(6, b"", (1 << 64) - 1)),
    "length in chunk": lambda: wrapped(
        ONE, chunk([raw_record(5, bytes(30), (1 << 63) + 5)], crc=0)[0]
    ),
    "string length": lambda: wrapped(ONE, raw_record(12, b"\xff" * 20)),
    "hole of zeros": lambda: MAGIC + record(Header("", "")) + ONE + bytes(1 << 20),
    "only zeros": lambda: MAGIC + bytes(1 << 20),
    "two files": lambda: json_log(b'{"x": 1}') * 2,
    "redefined channel": lambda: wrapped(
        ONE, chunk([Channel(1, "/other", "json", {}, 0), message(1, START, b'{"x": 5}')])[0]
    ),
    "unknown channel": lambda: wrapped(ONE, chunk([message(9, START, b'{"x": 5}')])[0]),
    "unknown compression": lambda: wrapped(
        ONE, chunk([message(1, START, b'{"x": 5}')], "snappy")[0]
    ),
    "nested chunk": lambda: wrapped(ONE, chunk([ONE])[0]),
    "name not UTF-8": lambda: wrapped(
        ONE, raw_record(12, struct.pack("<I", 2) + b"\xff\xfe" + struct.pack("<I", 0))
    ),
    "topic not UTF-8": lambda: wrapped(
        ONE, chunk([raw_record(4, b"\2\0\0\0" + b"\2\0\0\0\xff\xfe" + bytes(8))])[0]
    ),
    "late log time": lambda: wrapped(ONE, chunk([message(1, 1 << 63, b'{"x": 1}')])[0]),
    "JSON NaN": lambda: json_log(b'{"x": 1}', b'{"x": NaN}'),
    "JSON 1e400": lambda: json_log(b'{"x": 1}', b'{"x": 1e400}'),
    "JSON deep": lambda: json_log(b'{"x": 1}', b"[" * 100_000),
    "JSON deep and closed": lambda: json_log(b'{"x": 1}', b"[" * 900 + b"]" * 900),
    "JSON deep each time": lambda: json_log(*[b"[" * 1000 + b"]" * 1000] * 3, b'{"x": 1}'),
    "JSON not UTF-8": lambda: json_log(b'{"x": 1}', b'{"x": "\xff"}'),
    "JSON two in one": lambda: json_log(b'{"x": 1}', b'{"x": 1}, {"x": 2}'),
    "JSON text": lambda: json_log(b'{"x": 1}', b'{"x": "7"}'),
    "JSON late key": lambda: json_log(*[b'{"x": 1}'] * 250, b'{"x": 1, "y": 2}'),
    "JSON first broken": lambda: json_log(b"{"),
    "ROS giant array": lambda: typed_log(
        ros("Foo[2000000000] a\n===\nMSG: p/Foo\nuint8[1] b"), "cdr", b"\0\1\0\0"
    ),
    "ROS giant empty array": lambda: typed_log(
        ros("Foo[2000000000] a\n===\nMSG: p/Foo\n"), "cdr", b"\0\1\0\0"
    ),
    "ROS giant count": lambda: typed_log(
        ros("Foo[] a\n===\nMSG: p/Foo\nuint8[1] b"), "cdr", b"\0\1\0\0" + b"\xff" * 4
    ),
    "ROS fan-out": lambda: typed_log(
        ros(
            "\n".join(f"A0 f{i}" for i in range(9))
            + "".join(
                f"\n===\nMSG: p/A{n}\n" + "\n".join(f"A{n + 1} f{i}" for i in range(9))
                for n in range(20)
            )
            + "\n===\nMSG: p/A20\nuint8 x"
        ),
        "cdr",
        b"\0\1\0\0" + bytes(100_000),
    ),
    "ROS recursive": lambda: typed_log(ros("T a"), "cdr", b"\0\1\0\0" + bytes(90)),
    "ROS short": lambda: typed_log(
        ros("float64 a\nuint8[] b"), "cdr", b"\0\1\0\0" + bytes(12), b"\0\1\0\0" + bytes(7)
    ),
    "ROS array behind the end": lambda: typed_log(
        ros("float64 a\nuint8[] b"), "cdr", b"\0\1\0\0" + bytes(8) + b"\xff\0\0\0"
    ),
    "ROS no header": lambda: typed_log(ros("uint8 a"), "cdr", b"\0"),
    "ROS XCDR2": lambda: typed_log(ros("uint8 a"), "cdr", b"\0\1\0\0\1", b"\0\7\0\0\1"),
    "ROS schema": lambda: typed_log(ros("what is this?"), "cdr", b"\0\1\0\0\1"),
    "protobuf recursive": lambda: typed_log(recursive(), "protobuf", nested(90) + DOUBLE),
    "protobuf too deep": lambda: typed_log(recursive(), "protobuf", nested(20_000)),
    "protobuf cyclic": lambda: typed_log(chain(3, True), "protobuf", DOUBLE),
    "protobuf missing import": lambda: typed_log(
        Schema(1, FileDescriptorSet(
            file=[FileDescriptorProto(name="a", dependency=["b"])]
        ).SerializeToString(), "protobuf", "t.D"), "protobuf", DOUBLE,
    ),
    "protobuf wrong wire": lambda: typed_log(D, "protobuf", DOUBLE, b"\x08\x05"),
    "protobuf first wrong": lambda: typed_log(D, "protobuf", b"\x08\x05"),
    "protobuf cut": lambda: typed_log(D, "protobuf", DOUBLE, DOUBLE[:-1]),
    "protobuf endless varint": lambda: typed_log(D, "protobuf", DOUBLE, b"\xff" * 30),
    "protobuf many fields": lambda: typed_log(D, "protobuf", DOUBLE, DOUBLE * 99_999, b"\x08\1"),
    "protobuf fan-out": lambda: typed_log(fan_out(), "protobuf", b"\x0a\0"),
    "protobuf schema": lambda: typed_log(
        Schema(1, b"\xff", "protobuf", "t.D"), "protobuf", DOUBLE
    ),
    "protobuf other type": lambda: typed_log(
        Schema(1, D.data, "protobuf", "X"), "protobuf", DOUBLE
    ),
    "protobuf types in types": lambda: typed_log(types_in_types(500), "protobuf", b""),
    "ROS comment": lambda: typed_log(ros("uint8 a #" + "[" * 100_000), "cdr", b"\0\1\0\0\1"),
    "JSON lists": lambda: json_log(b'{"x": 1}', b"[" + b"[]," * 6_000_000 + b"[]]"),
    "JSON lists in many": lambda: json_log(
        b'{"x": 1}', *[b'{"y": [' + b"[]," * 300_000 + b"[]]}"] * 8
    ),
    "metadata only": lambda: wrapped(record(Metadata("m", {}))) [:-12],
    "metadata of one name": lambda: wrapped(ONE, *(
        raw_record(12, b"\1\0\0\0m" + struct.pack("<II", 16, 8) + b"%08d" % i + bytes(4))
        for i in range(100_000)
    )),
    "large metadata": lambda: wrapped(ONE, raw_record(
        12, b"\1\0\0\0m" + struct.pack("<III", 8 + 10**8, 0, 10**8) + bytes(10**8)
    )),
    "long topic": lambda: wrapped(
        ONE, chunk([Channel(1, "/p" * 2_000_000, "json", {}, 0), message(1, START, b'{"x": 1}')])[0]
    ),
    "large channel": lambda: wrapped(
        ONE, chunk([Channel(2, "/p", "json", {"x": "y" * 10**7}, 0), message(2, START, b"1")])[0]
    ),
}  # fmt: skip


# valid, however odd
RIGHT = {
    "protobuf recursive", "protobuf fan-out", "JSON deep each time", "ROS comment",
    "metadata of one name", "large metadata", "JSON NaN", "large channel",
}  # fmt: skip

# Each takes half a second or more, and has a like among the others.
LONG_MCAP = {
    "metadata of one name", "large metadata", "protobuf fan-out", "lz4 bomb that lies",
}  # fmt: skip
