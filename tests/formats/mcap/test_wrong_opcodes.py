"""A chunk whose opcode is wrong, in a file without statistics and indexes."""

import json
import struct
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.writer import IndexType, Writer

from adhesion_cli.formats.mcap.reader import McapSource
from adhesion_cli.formats.source import ReadOptions

ROWS = 300


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("plain") / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(
            file, chunk_size=2000, index_types=IndexType.NONE, repeat_channels=False,
            repeat_schemas=False, use_statistics=False, use_summary_offsets=False,
        )  # fmt: skip
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for i in range(ROWS):
            data = json.dumps({"bc_pressure_bar": i / 100, "wheel_speed_rads": 50 - i / 10})
            writer.add_message(channel, i * 10**7, data.encode(), i * 10**7)
        writer.finish()
    return path.read_bytes()


def second_chunk(raw: bytes) -> int:
    at, found = 8, []
    while len(found) < 2:
        opcode, length = struct.unpack_from("<BQ", raw, at)
        found += [at] if opcode == Opcode.CHUNK else []
        at += 9 + length
    return found[1]


@pytest.mark.parametrize("opcode", [0x00, 0x02, 0x04, *range(0x07, 0x10), 0x46, 0x86])
def test_no_chunk_is_lost_without_a_word(plain: bytes, tmp_path: Path, opcode: int) -> None:
    raw, at = bytearray(plain), second_chunk(plain)
    raw[at] = opcode
    (tmp_path / "log.mcap").write_bytes(raw)
    walk = McapSource(tmp_path / "log.mcap", ReadOptions()).walk
    assert [d.at for d in walk.damage][:1] == [at]
    if opcode in (0x07, 0x08, 0x0A, 0x0D, 0x0E, 0x46, 0x86):  # else the chunk itself is not read
        assert walk.rows == ROWS


def test_an_unknown_record_is_no_damage(plain: bytes, tmp_path: Path) -> None:
    at = second_chunk(plain)
    private = struct.pack("<BQ", 0x90, 100) + bytes(100)
    (tmp_path / "log.mcap").write_bytes(plain[:at] + private + plain[at:])
    walk = McapSource(tmp_path / "log.mcap", ReadOptions()).walk
    assert not walk.damage
    assert walk.rows == ROWS
