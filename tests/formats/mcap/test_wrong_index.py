"""Indexes that lead elsewhere cost no row; the file is damaged, and a copy has a right index."""

import io
import json
import subprocess
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.mcap_logs import MAGIC, START, record
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    AttachmentIndex,
    ChunkIndex,
    Footer,
    McapRecord,
    MessageIndex,
    MetadataIndex,
    SummaryOffset,
)
from mcap.writer import Writer

from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.mcap.reader import open_mcap
from adhesion_cli.formats.source import ReadOptions

ROWS = 600
FOOTER = 9 + 20 + len(MAGIC)
KINDS: dict[int, type[McapRecord]] = {
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
}


def whole() -> bytes:
    """Ten chunks or so of two channels, two attachments, two metadata records."""
    file = io.BytesIO()
    writer = Writer(file, chunk_size=2000)
    writer.start()
    ids = [writer.register_channel(name, "json", 0) for name in ("/a", "/b")]
    for i in range(ROWS):
        if i % 300 == 0:
            writer.add_attachment(0, 0, "a", "text/plain", b"attached" * i)
            writer.add_metadata("m", {"i": str(i)})
        data = json.dumps({"bc_pressure_bar": i / 100}).encode()
        writer.add_message(ids[i % 2], START + i * 10**7, data, START + i * 10**7)
    writer.finish()
    return file.getvalue()


RAW = whole()


def parts(raw: bytes) -> list[bytes]:
    """The records, one by one."""
    found, at = [], len(MAGIC)
    while at < len(raw) - len(MAGIC):
        size = 9 + int.from_bytes(raw[at + 1 : at + 9], "little")
        found.append(raw[at : at + size])
        at += size
    return found


def sealed(raw: bytes, **footer: int) -> bytes:
    """The file with another footer and a right CRC of its summary."""
    records = parts(raw)
    before = raw[: len(raw) - FOOTER]
    start = len(MAGIC)
    for one in records:
        start += len(one)
        if one[0] == Opcode.DATA_END:
            break
    said = replace(Footer.read(ReadDataStream(io.BytesIO(records[-1][9:]))), **footer)
    said.summary_crc = zlib.crc32(before[start:] + record(replace(said, summary_crc=0))[:-4])
    return before + record(said) + MAGIC


def edited(kind: int, number: int, **fields: object) -> bytes:
    """The file with other fields of one record; its size stays."""
    out, met = [], 0
    for one in parts(RAW):
        if one[0] == kind:
            if met == number:
                size = len(one)
                of = KINDS[kind].read(ReadDataStream(io.BytesIO(one[9:])))  # type: ignore[attr-defined]
                one = record(replace(of, **fields))
                assert len(one) == size
            met += 1
        out.append(one)
    assert met > number
    return sealed(MAGIC + b"".join(out) + MAGIC)


def of_kind(kind: int) -> list[McapRecord]:
    some = (one for one in parts(RAW) if one[0] == kind)
    return [KINDS[kind].read(ReadDataStream(io.BytesIO(one[9:]))) for one in some]  # type: ignore[attr-defined]


def without(kind: int, number: int) -> bytes:
    """The file without one record of the summary; offsets behind it are right."""
    records, met = parts(RAW), [k for k, one in enumerate(parts(RAW)) if one[0] == kind]
    gone = len(records.pop(met[number]))
    summary = False
    for k, one in enumerate(records[:-1]):
        summary |= one[0] == Opcode.DATA_END
        if one[0] == Opcode.SUMMARY_OFFSET:
            of = SummaryOffset.read(ReadDataStream(io.BytesIO(one[9:])))
            if of.group_opcode == kind:
                of.group_length -= gone
            elif of.group_opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
                of.group_start -= gone
            records[k] = record(of)
    footer = Footer.read(ReadDataStream(io.BytesIO(records[-1][9:])))
    raw = MAGIC + b"".join(records) + MAGIC
    return sealed(raw, summary_offset_start=footer.summary_offset_start - gone)


CHUNKS = of_kind(Opcode.CHUNK_INDEX)
INDEX: MessageIndex = of_kind(Opcode.MESSAGE_INDEX)[2]  # type: ignore[assignment]
ENTRIES = INDEX.records
OFFSETS: dict[int, int] = CHUNKS[1].message_index_offsets  # type: ignore[attr-defined]
END = len(RAW)
WRONG: dict[str, Callable[[], bytes]] = {
    "summary beyond the file": lambda: sealed(RAW, summary_start=END + 1000),
    "summary in the data": lambda: sealed(RAW, summary_start=len(MAGIC)),
    "summary offsets beyond the file": lambda: sealed(RAW, summary_offset_start=END + 1000),
    "summary offsets in the data": lambda: sealed(RAW, summary_offset_start=len(MAGIC)),
    "group in the data": lambda: edited(Opcode.SUMMARY_OFFSET, 2, group_start=len(MAGIC)),
    "group too short": lambda: edited(Opcode.SUMMARY_OFFSET, 3, group_length=5),
    "group of another kind": lambda: edited(Opcode.SUMMARY_OFFSET, 3, group_opcode=4),
    "chunk indexed twice": lambda: edited(Opcode.CHUNK_INDEX, 1, **vars(CHUNKS[2])),
    "chunk not indexed": lambda: without(Opcode.CHUNK_INDEX, 1),
    "no chunk there": lambda: edited(Opcode.CHUNK_INDEX, 1, chunk_start_offset=END + 9),
    "chunk of another length": lambda: edited(Opcode.CHUNK_INDEX, 1, chunk_length=12),
    "message indexes of another chunk": lambda: edited(
        Opcode.CHUNK_INDEX, 1,
        message_index_offsets=CHUNKS[2].message_index_offsets,  # type: ignore[attr-defined]
    ),
    "message indexes of other channels": lambda: edited(
        Opcode.CHUNK_INDEX, 1, message_index_offsets={1: OFFSETS[2], 2: OFFSETS[1]}
    ),
    "message indexes of another length": lambda: edited(
        Opcode.CHUNK_INDEX, 1, message_index_length=3
    ),
    "message index to no message": lambda: edited(
        Opcode.MESSAGE_INDEX, 2, records=[(ENTRIES[0][0], ENTRIES[0][1] + 1), *ENTRIES[1:]]
    ),
    "message index to one twice": lambda: edited(
        Opcode.MESSAGE_INDEX, 2, records=[ENTRIES[1], *ENTRIES[1:]]
    ),
    "message index of exchanged times": lambda: edited(
        Opcode.MESSAGE_INDEX, 2,
        records=[(ENTRIES[1][0], ENTRIES[0][1]), (ENTRIES[0][0], ENTRIES[1][1]), *ENTRIES[2:]],
    ),
    "message index of another channel": lambda: edited(
        Opcode.MESSAGE_INDEX, 2, channel_id=3 - INDEX.channel_id
    ),
    "attachment not indexed": lambda: edited(Opcode.ATTACHMENT_INDEX, 1, offset=len(MAGIC)),
    "metadata not indexed": lambda: edited(Opcode.METADATA_INDEX, 1, offset=len(MAGIC)),
}  # fmt: skip


def test_the_file_that_is_changed_is_sound(tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(sealed(RAW))
    assert sealed(RAW) == RAW
    assert len(CHUNKS) > 5
    assert not open_mcap(tmp_path / "log.mcap", ReadOptions(strict=True)).findings


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_index_costs_no_row_and_is_reported(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(WRONG[name]())
    source = open_mcap(path, ReadOptions())
    columns = source.columns(source.fields)
    assert [len(column.t) for column in columns] == [ROWS // 2] * 2
    assert not source.walk.damage
    (finding,) = source.findings
    assert (finding.code, finding.severity) == ("mcap-wrong-index", "error")
    assert 0 < finding.values["byte"] < END
    with pytest.raises(UserError, match=f"byte {finding.values['byte']:.0f}: "):
        open_mcap(path, ReadOptions(strict=True))


@pytest.mark.parametrize(
    "name", ["chunk indexed twice", "chunk not indexed", "summary beyond the file"]
)
def test_recover_rewrites_the_index(
    tmp_path: Path, run: Callable[..., subprocess.CompletedProcess[str]], name: str
) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(WRONG[name]())
    done = run("inspect", path, "--json")
    (log,) = json.loads(done.stdout)["logs"]
    assert (done.returncode, log["status"], log["rows_read"]) == (3, "damaged", ROWS)
    assert read(path) != list(range(ROWS))
    done = run("recover", path, "-o", tmp_path / "copy.mcap")
    assert done.returncode == 3, done.stderr
    assert read(tmp_path / "copy.mcap") == list(range(ROWS))
    done = run("inspect", tmp_path / "copy.mcap", "--json")
    (log,) = json.loads(done.stdout)["logs"]
    assert (log["status"], log["rows_read"]) == ("ok", ROWS)
    assert not [f for f in log["findings"] if f["code"].startswith("mcap-")]


def read(path: Path) -> list[int]:
    """Numbers of the messages that the mcap package reads by the index, [] where it fails."""
    with path.open("rb") as file:
        try:
            times = [
                m.log_time for _, _, m in make_reader(file, validate_crcs=True).iter_messages()
            ]
        except Exception:
            return []
    return [(t - START) // 10**7 for t in times]
