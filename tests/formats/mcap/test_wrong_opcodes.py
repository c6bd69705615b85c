"""A record whose opcode is wrong, in a file without statistics and indexes."""

import json
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.mcap_logs import START, Log, message, record, scalar_log
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, ChunkIndex, MessageIndex, Metadata, Schema
from mcap.writer import CompressionType, IndexType, Writer

from adhesion_cli.formats.mcap.walk import Walk
from adhesion_cli.formats.source import ReadOptions

ROWS = 300
OTHERS = [n for n in (*range(16), 0x16, 0x46, 0x80, 0x86, 0xFF) if n != Opcode.CHUNK]
#: A chunk with such an opcode is not read, and reported.
UNREAD = (0, Opcode.FOOTER, Opcode.ATTACHMENT)


def plain(folder: Path, compression: CompressionType, start: int) -> bytes:
    """Chunks and nothing that counts them or leads to them."""
    path = folder / "plain.mcap"
    with path.open("wb") as file:
        writer = Writer(
            file, chunk_size=2000, compression=compression, index_types=IndexType.NONE,
            repeat_channels=False, repeat_schemas=False, use_statistics=False,
            use_summary_offsets=False,
        )  # fmt: skip
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for i in range(ROWS):
            data = json.dumps({"bc_pressure_bar": i / 100, "wheel_speed_rads": 50 - i / 10})
            writer.add_message(channel, start + i * 10**7, data.encode(), start + i * 10**7)
        writer.finish()
    return path.read_bytes()


def places(raw: bytes, kind: int) -> list[tuple[int, int]]:
    """Offset and size of the records of a kind."""
    at, found = 8, []
    while at < len(raw) - 8:
        opcode, length = struct.unpack_from("<BQ", raw, at)
        found += [(at, 9 + length)] if opcode == kind else []
        at += 9 + length
    return found


def walked(folder: Path, raw: bytes) -> Walk:
    (folder / "log.mcap").write_bytes(raw)
    return Walk(folder / "log.mcap", ReadOptions())


@pytest.mark.parametrize("opcode", OTHERS)
@pytest.mark.parametrize("start", [START, 1])
@pytest.mark.parametrize("compression", CompressionType)
def test_no_chunk_is_lost_without_a_word(
    tmp_path: Path, compression: CompressionType, start: int, opcode: int
) -> None:
    whole = plain(tmp_path, compression, start)
    chunks = places(whole, Opcode.CHUNK)
    first = [] if opcode in UNREAD else chunks[:1]  # else all definitions are lost: an error
    for at, size in (*first, chunks[1], chunks[-1]):
        walk = walked(tmp_path, whole[:at] + bytes([opcode]) + whole[at + 1 :])
        assert walk.damage[0].at == at
        assert walk.account()
        if opcode not in UNREAD:
            assert walk.rows == ROWS
            assert f"{size} bytes" in walk.damage[0].what  # the size is no wording


@pytest.mark.parametrize("opcode", OTHERS)
@pytest.mark.parametrize("padding", [b"", b"more"])
def test_nor_behind_definitions_outside_chunks(tmp_path: Path, padding: bytes, opcode: int) -> None:
    log = scalar_log([1.0] * 24, per_chunk=8, index=False, statistics=False, summary=False)
    log.padding, log.data_crc = padding, False
    whole = log.bytes()
    at, _ = places(whole, Opcode.CHUNK)[0]
    definitions = b"".join(map(record, [*log.schemas, *log.channels]))
    walk = walked(tmp_path, whole[:at] + definitions + bytes([opcode]) + whole[at + 1 :])
    assert walk.damage or walk.stray
    assert walk.damage[0].at <= at + len(definitions) if walk.damage else walk.stray
    if opcode not in (*UNREAD, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
        assert walk.rows == 24


def test_a_copy_says_what_was_damaged(
    tmp_path: Path, run: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    whole = plain(tmp_path, CompressionType.ZSTD, START)
    at, _ = places(whole, Opcode.CHUNK)[1]
    (tmp_path / "log.mcap").write_bytes(whole[:at] + b"\x46" + whole[at + 1 :])
    done = run("inspect", "log.mcap", "--json")
    assert done.returncode == 3
    assert json.loads(done.stdout)["logs"][0]["status"] == "damaged"
    done = run("recover", "log.mcap", "-o", "copy.mcap", "--json")
    assert done.returncode == 3
    assert json.loads(done.stdout)["findings"][0]["values"]["byte"] == at
    with (tmp_path / "copy.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == ROWS
        assert [m.name for m in reader.iter_metadata()] == ["adhesion.recovered"]


@pytest.mark.parametrize(
    "wrong", [ChunkIndex(0, 0, "", 0, 0, 0, {}, 0, 0), MessageIndex(1, [(1, 2), (3, 4)])]
)
def test_an_index_that_is_none_in_the_data(
    tmp_path: Path, wrong: ChunkIndex | MessageIndex
) -> None:
    whole = plain(tmp_path, CompressionType.ZSTD, START)
    at, _ = places(whole, Opcode.CHUNK)[1]
    one = bytearray(record(wrong))
    if isinstance(wrong, MessageIndex):
        one[11] += 16  # one entry more than it has
    (first,) = walked(tmp_path, whole[:at] + one + whole[at:]).damage
    assert first.at == at


def test_what_may_look_like_a_chunk_is_none(tmp_path: Path) -> None:
    """Private records, fields that are appended, and names with a length that a chunk has."""
    whole = plain(tmp_path, CompressionType.ZSTD, START)
    at, _ = places(whole, Opcode.CHUNK)[1]
    odd = (
        struct.pack("<BQ", 0x90, 100) + bytes(100),
        record(MessageIndex(1, []), bytes(100)),
        record(Metadata("", {}), bytes(100)),
        record(Attachment(1, 1, "cal.json", "", bytes(200)), bytes(3)),
        record(Attachment(0, 0, "cal.json", "zstd", bytes(200))),
        record(Schema(7, b"\3" + bytes(100), "", "n" * 16)),
    )
    for one in (*odd, b"".join(odd)):
        walk = walked(tmp_path, whole[:at] + one + whole[at:])
        assert not walk.damage
        assert walk.rows == ROWS
    log = Log(messages=[message(1, START, b"{}")], unknown=True, crc=False)
    walk = walked(tmp_path, log.bytes())
    assert not walk.damage
