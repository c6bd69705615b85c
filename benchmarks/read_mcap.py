"""How much faster the columns come than from mcap's own reader with its decoders.

Writes one log per encoding (8 channels) into a temporary folder, reads it with `mcap`'s reader
and decoder (a part of the messages), with Rerun's McapReader where it decodes the encoding, and
with ours, opening included, best of three.

    python benchmarks/read_mcap.py [--messages 2900000]
"""

import argparse
import itertools
import json
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from mcap.reader import make_reader
from mcap.writer import Writer
from table import Row, show

from adhesion_cli.formats.mcap.reader import open_mcap
from adhesion_cli.formats.source import ReadOptions

CHANNELS = 8
START = 1_700_000_000 * 10**9
FLOAT64 = b"float64 data"
JOINT_STATE = b"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def scalar_schema(stamped: bool) -> bytes:
    file = FileDescriptorProto(name="scalar.proto", package="bench", syntax="proto3")
    message = file.message_type.add(name="Scalar")
    one = FieldDescriptorProto.LABEL_OPTIONAL
    files = [file]
    if stamped:
        from google.protobuf import timestamp_pb2

        stamp_file = FileDescriptorProto()
        timestamp_pb2.DESCRIPTOR.CopyToProto(stamp_file)
        files.insert(0, stamp_file)
        file.dependency.append(stamp_file.name)
        message.field.add(
            name="timestamp", number=1, label=one, type=FieldDescriptorProto.TYPE_MESSAGE,
            type_name=".google.protobuf.Timestamp",
        )  # fmt: skip
    message.field.add(name="value", number=2, label=one, type=FieldDescriptorProto.TYPE_DOUBLE)
    return FileDescriptorSet(file=files).SerializeToString()


def varint(value: int) -> bytes:
    out = b""
    while value > 0x7F:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])


def protobuf(t: int, value: float) -> bytes:
    return b"\x11" + struct.pack("<d", value)


def protobuf_stamped(t: int, value: float) -> bytes:
    stamp = b"\x08" + varint(t // 10**9) + b"\x10" + varint(t % 10**9)
    return b"\x0a" + bytes([len(stamp)]) + stamp + b"\x11" + struct.pack("<d", value)


def float64(t: int, value: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", value)


def joint_state(t: int, value: float) -> bytes:
    body = struct.pack("<II", t // 10**9, t % 10**9) + struct.pack("<I5s3x", 5, b"base\0")
    body += (
        struct.pack("<I", 2) + struct.pack("<I3sx", 3, b"a1\0") + struct.pack("<I3sx", 3, b"a2\0")
    )
    body += struct.pack("<I", 2) + bytes(-(len(body) + 4) % 8) + struct.pack("<2d", value, value)
    body += struct.pack("<I4x2d", 2, value, -value) + struct.pack("<I", 0)
    return b"\0\1\0\0" + body


def json_value(t: int, value: float) -> bytes:
    return b'{"value": %r}' % value


CASES: dict[str, tuple[str, str, bytes, Callable[[int, float], bytes]]] = {
    "protobuf": ("bench.Scalar", "protobuf", scalar_schema(False), protobuf),
    "protobuf stamped": ("bench.Scalar", "protobuf", scalar_schema(True), protobuf_stamped),
    "ros2 Float64": ("std_msgs/msg/Float64", "ros2msg", FLOAT64, float64),
    "ros2 JointState": ("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE, joint_state),
    "json": ("value", "jsonschema", b'{"type": "object"}', json_value),
}
ENCODING = {"protobuf": "protobuf", "ros2msg": "cdr", "jsonschema": "json"}
TARGET = {"protobuf": 10, "ros2msg": 10, "jsonschema": 5}


def write(path: Path, case: str, messages: int) -> None:
    name, encoding, schema, message = CASES[case]
    values = np.random.default_rng(1).normal(1e5, 1e3, messages).tolist()
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        of = writer.register_schema(name, encoding, schema)
        ids = [
            writer.register_channel(f"/axle/{i}/pressure", ENCODING[encoding], of)
            for i in range(CHANNELS)
        ]
        for i, value in enumerate(values):
            t = START + i // CHANNELS * 5_000_000
            writer.add_message(ids[i % CHANNELS], t, message(t, value), t)
        writer.finish()


def by_mcap(path: Path, case: str, messages: int) -> float:
    """Seconds per message of mcap's reader with its decoder, over the first `messages`."""
    from mcap_protobuf.decoder import DecoderFactory as Protobuf
    from mcap_ros2.decoder import DecoderFactory as Ros2

    begin = time.perf_counter()
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[Protobuf(), Ros2()])
        decoded: Iterator[Any]
        if case == "json":
            decoded = (json.loads(m.data) for _, _, m in reader.iter_messages())
        else:
            decoded = (d for _, _, _, d in reader.iter_decoded_messages())
        n = sum(1 for _ in itertools.islice(decoded, messages))
    return (time.perf_counter() - begin) / n


def by_rerun(path: Path, messages: int) -> float:
    """Seconds per message of Rerun's own importer to Arrow batches."""
    from rerun.chunk import McapReader

    begin = time.perf_counter()
    for chunk in McapReader(str(path)).stream():
        chunk.to_record_batch()
    return (time.perf_counter() - begin) / messages


def by_us(path: Path, messages: int) -> float:
    begin = time.perf_counter()
    source = open_mcap(path, ReadOptions())
    columns = source.columns(source.fields)
    seconds = time.perf_counter() - begin
    assert sum(len(c.t) for c in columns) >= messages
    return seconds / messages


def rows(messages: int = 2_900_000, sample: int = 150_000) -> Iterator[Row]:
    """A row per encoding and rival.

    Args:
        messages: in each log.
        sample: how many of them mcap's own reader decodes.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        for case, (_, encoding, *_) in CASES.items():
            write(path, case, messages)
            theirs = 1e-3 / by_mcap(path, case, sample)
            ours = 1e-3 / min(by_us(path, messages) for _ in range(3))
            against = "mcap's reader with its decoder"
            yield Row(f"read {case}", ours, theirs, "k msg/s", against, TARGET[encoding])
            if encoding == "protobuf":
                theirs = 1e-3 / by_rerun(path, messages)
                yield Row(f"read {case}", ours, theirs, "k msg/s", "Rerun's McapReader", 0.8)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--messages", type=int, default=2_900_000)
    show(rows(parser.parse_args().messages))
