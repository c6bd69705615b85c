"""MCAP files for tests, built record by record, so that every variant can be made."""

import io
import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import lz4.frame
import zstandard
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Schema,
    Statistics,
)

MAGIC = b"\x89MCAP0\r\n"
START = 1_700_000_000 * 10**9
COMPRESS = {"": bytes, "zstd": zstandard.compress, "lz4": lz4.frame.compress}


def record(of: McapRecord, padding: bytes = b"") -> bytes:
    """One record; padding goes behind its fields, as future versions may append some."""
    builder = RecordBuilder()
    of.write(builder)
    raw = bytes(builder.end())
    return raw[:1] + struct.pack("<Q", len(raw) - 9 + len(padding)) + raw[9:] + padding


def raw_record(opcode: int, content: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(content) if length is None else length) + content


def chunk(
    records: list[McapRecord | bytes],
    compression: str = "zstd",
    padding: bytes = b"",
    *,
    crc: int | None = None,
    size: int | None = None,
    inner_padding: bytes = b"",
) -> tuple[bytes, dict[int, list[tuple[int, int]]]]:
    """A Chunk record and what an index of it says."""
    body, index = b"", {}
    for one in records:
        if isinstance(one, Message):
            index.setdefault(one.channel_id, []).append((one.log_time, len(body)))
        pad = inner_padding if isinstance(one, (Schema, Channel)) else b""
        body += one if isinstance(one, bytes) else record(one, pad)
    times = [one.log_time for one in records if isinstance(one, Message)] or [0]
    compress = COMPRESS.get(compression, bytes)
    whole = Chunk(
        compression, compress(body), max(times), min(times),
        zlib.crc32(body) if crc is None else crc, len(body) if size is None else size,
    )  # fmt: skip
    return record(whole, padding), index


@dataclass
class Log:
    """What to write, and how."""

    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    messages: list[Message] = field(default_factory=list)
    compression: str = ""
    per_chunk: int = 0  # messages; 0: no chunks
    index: bool = True
    summary: bool = True
    statistics: bool = True
    crc: bool = True
    data_crc: bool = True  # off in mcap's writer, unless asked for
    end: bool = True
    padding: bytes = b""
    repeat: bool = False  # definitions again in every chunk
    attachments: int = 0
    metadata: dict[str, str] = field(default_factory=dict)
    unknown: bool = False  # records of unknown kinds in between

    def bytes(self) -> bytes:
        definitions: list[McapRecord | bytes] = [*self.schemas, *self.channels]
        out = MAGIC + record(Header("", "tests"), self.padding)
        chunk_indexes: list[ChunkIndex] = []
        if self.unknown:
            out += raw_record(0x80, b"private")
        for i in range(self.attachments):
            out += record(Attachment(1, 2, f"a{i}", "text/plain", b"attached" * i), self.padding)
        if self.metadata:
            out += record(Metadata("meta", self.metadata), self.padding)
        if not self.per_chunk:
            for of in definitions:
                out += record(of, self.padding)
            for message in self.messages:
                out += record(message)
                if self.unknown:
                    out += raw_record(0x7F, b"later")
        else:
            for i in range(0, len(self.messages), self.per_chunk):
                records = list(definitions) if i == 0 or self.repeat else []
                records += self.messages[i : i + self.per_chunk]
                if self.unknown:
                    records.insert(1, raw_record(0x99, b"private"))
                raw, index = chunk(
                    records, self.compression, self.padding, inner_padding=self.padding,
                    crc=None if self.crc else 0,
                )  # fmt: skip
                at = len(out)
                out += raw
                chunk_indexes.append(ChunkIndex(len(raw), at, self.compression, 0, 0, 0, {}, 0, 0))
                if self.index:
                    for channel, entries in index.items():
                        out += record(MessageIndex(channel, entries), self.padding)
        if not self.end:
            return out
        out += record(DataEnd(zlib.crc32(out) if self.crc and self.data_crc else 0), self.padding)
        start, summary = len(out), b""
        if self.summary:
            for of in definitions:
                summary += record(of, self.padding)
            if self.statistics:
                counts = Counter(m.channel_id for m in self.messages)
                summary += record(
                    Statistics(
                        attachment_count=self.attachments, channel_count=len(self.channels),
                        channel_message_counts=dict(counts), chunk_count=len(chunk_indexes),
                        message_count=len(self.messages), message_end_time=0,
                        message_start_time=0, metadata_count=int(bool(self.metadata)),
                        schema_count=len(self.schemas),
                    ),
                    self.padding,
                )  # fmt: skip
            if self.index:
                for one in chunk_indexes:
                    summary += record(one, self.padding)
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start if summary else 0, 0)
        crc = zlib.crc32(summary + head) if self.crc else 0
        return out + summary + record(Footer(start if summary else 0, 0, crc)) + MAGIC


def message(channel: int, time: int, data: bytes, publish: int | None = None) -> Message:
    return Message(channel, time, data, time if publish is None else publish, 0)


def scalar_log(values: list[float], **how: Any) -> Log:
    """Two JSON channels, /p and /v, with one number each."""
    import json

    channels = [Channel(1, "/p", "json", {}, 1), Channel(2, "/v", "json", {}, 0)]
    schemas = [Schema(1, b'{"type": "object"}', "jsonschema", "value")]
    messages = [
        message(1 + i % 2, START + i * 10**7, json.dumps({"value": v}).encode())
        for i, v in enumerate(values)
    ]
    return Log(schemas, channels, messages, **how)


def proto_file(
    messages: list[DescriptorProto], syntax: str = "proto3", name: str = "t.proto"
) -> FileDescriptorProto:
    return FileDescriptorProto(name=name, package="t", syntax=syntax, message_type=messages)


def proto_schema(file: FileDescriptorProto, root: str, number: int = 1) -> Schema:
    data = FileDescriptorSet(file=[file]).SerializeToString()
    return Schema(number, data, "protobuf", f"t.{root}")


def double_message(name: str = "D", **options: Any) -> DescriptorProto:
    """A message with one double field, "value"."""
    one = FieldDescriptorProto(
        name="value", number=1, type=FieldDescriptorProto.TYPE_DOUBLE,
        label=FieldDescriptorProto.LABEL_OPTIONAL, **options,
    )  # fmt: skip
    return DescriptorProto(name=name, field=[one])


def cdr(schema: Schema, value: dict[str, Any], little: bool = True) -> bytes:
    """A ROS 2 message by mcap-ros2-support's writer, in either byte order."""
    from mcap_ros2 import _dynamic
    from mcap_ros2._cdr import CdrWriter, EncapsulationKind

    found: dict[str, Any] = {
        "builtin_interfaces/Time": _dynamic.TimeDefinition,
        "builtin_interfaces/Duration": _dynamic.TimeDefinition,
    }

    def keep(name: str, short: str, of: Any) -> None:
        found[name] = found[short] = of

    _dynamic._for_each_msgdef(schema.name, schema.data.decode(), keep)
    out = io.BytesIO()
    kind = EncapsulationKind.CDR_LE if little else EncapsulationKind.CDR_BE
    root = found[schema.name]
    _dynamic._write_complex_type(root.msg_name, root.fields, found, value, CdrWriter(out, kind))
    return out.getvalue()
