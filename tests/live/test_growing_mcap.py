"""`adhesion live` on an MCAP file to which another program appends."""

import io
import json
import random
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from helpers.live_runs import LOGS, followed, running
from helpers.mcap_logs import MAGIC, message, record
from mcap.reader import make_reader
from mcap.records import Channel, Header
from mcap.writer import CompressionType, Writer

from adhesion_cli.analysis.settings import load
from adhesion_cli.core.errors import UserError
from adhesion_cli.live.feed import Feed
from adhesion_cli.live.open import Replay, open_feed

LOW = LOGS / "low-adhesion.mcap"
SETTINGS = load()
Found = dict[int, list[tuple[int, float]]]


@cache
def written(chunks: bool, most: int = 1 << 30, late: str = "", begin: int = 0) -> bytes:
    """The bundled log's messages, as another logger would have written them.

    Those of topics with `late` in their name begin at `begin` [ns].
    """
    made = io.BytesIO()
    writer = Writer(made, chunk_size=20_000, use_chunking=chunks, compression=CompressionType.LZ4)
    writer.start(profile="", library="a logger")
    ids: dict[int, int] = {}
    with LOW.open("rb") as file:
        for n, (schema, channel, message) in enumerate(make_reader(file).iter_messages()):
            if n == most:
                break
            assert schema
            if late and late in channel.topic and message.log_time < begin:
                continue
            if channel.id not in ids:
                of = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, of, channel.metadata
                )
            writer.add_message(
                ids[channel.id], message.log_time, message.data, message.publish_time
            )
    writer.finish()
    return made.getvalue()


@cache
def whole() -> tuple[Found, list[str]]:
    """What a log that does not grow gives."""
    return forces(Replay(LOW, SETTINGS.read, 0.0))


def damaged() -> bytes:
    """The same, with a wrong byte in one chunk of many."""
    data = bytearray(written(True))
    data[len(data) // 2] ^= 0xFF
    return bytes(data)


@contextmanager
def growing(path: Path, data: bytes, seed: int) -> Iterator[None]:
    """Another program that appends pieces of any size."""
    draw = random.Random(seed)

    def append() -> None:
        at = 0
        with path.open("ab", buffering=0) as file:
            while at < len(data):
                size = round(draw.expovariate(40.0) * len(data)) + 1
                file.write(data[at : at + size])
                at += size
                time.sleep(0.01)

    path.touch()
    thread = threading.Thread(target=append)
    thread.start()
    try:
        yield
    finally:
        thread.join()


def forces(feed: Feed) -> tuple[Found, list[str]]:
    """Time and force of each sample by axle, and the codes of the findings."""
    samples, findings = followed(feed, SETTINGS, ["td"])
    found = {
        n: [(s.t, s.estimates["td"].force) for s in of if s.estimates] for n, of in samples.items()
    }
    return found, [f.code for f in findings if f.severity != "info"]


@pytest.mark.parametrize(("chunks", "seed"), [(True, 0), (False, 1)])
def test_a_log_that_grows_gives_what_a_whole_one_gives(
    tmp_path: Path, chunks: bool, seed: int
) -> None:
    log = tmp_path / "growing.mcap"
    with growing(log, written(chunks), seed):
        assert forces(open_feed(str(log), SETTINGS.read)) == whole()


def test_a_channel_that_begins_later_is_taken_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Axle 4 begins to send after 5 s: so do its channels in the file."""
    log, all_axles = tmp_path / "growing.mcap", whole()[0]
    begin = all_axles[1][0][0] + 5_000_000_000
    data = written(True, late="4", begin=begin)
    log.write_bytes(data[: len(data) // 16])
    feed, begun = open_feed(str(log), SETTINGS.read), threading.Event()
    read = feed.rows

    def rows(*of: Any) -> Any:
        begun.set()
        return read(*of)

    monkeypatch.setattr(feed, "rows", rows)

    def append() -> None:
        begun.wait(60.0)
        with log.open("ab") as file:
            file.write(data[len(data) // 16 :])

    thread = threading.Thread(target=append)
    thread.start()
    found, codes = forces(feed)
    thread.join()
    assert codes == []
    assert {n: of for n, of in found.items() if n != 4} == {
        n: of for n, of in all_axles.items() if n != 4
    }
    late = [t for t, _ in all_axles[4] if t >= begin]
    assert 0 < len(late) < len(all_axles[4])
    assert [t for t, _ in found[4]] == late


def test_a_damaged_chunk_is_told_and_the_next_ones_are_read(tmp_path: Path) -> None:
    data = damaged()
    log = tmp_path / "growing.mcap"
    with growing(log, data, 1):
        found, codes = forces(open_feed(str(log), SETTINGS.read))
    assert "mcap-damaged" in codes
    for axle, of in whole()[0].items():
        kept = {t for t, _ in found[axle]}
        assert 0.8 * len(of) < len(kept) < len(of)
        assert kept < {t for t, _ in of}
        assert max(kept) == of[-1][0]


def test_with_strict_a_damaged_chunk_ends_the_run(tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(damaged())
    for strict, code in (("--strict",), 1), ((), 3):
        with running(tmp_path, "log.mcap", "--json", "-a", "td", *strict) as process:
            out, told = process.communicate(timeout=120)
        assert process.returncode == code, told
        lines = [json.loads(line) for line in out.splitlines()]
        assert ("error" in lines[-1]) == bool(strict)


def test_long_records_of_another_kind_are_passed_over(tmp_path: Path) -> None:
    """One longer than what is read at once, before the first message and behind it."""
    data, log = written(True), tmp_path / "growing.mcap"
    attachment = b"\x09" + (9 << 20).to_bytes(8, "little") + bytes(9 << 20)
    indexes = (b"\x07" + (6).to_bytes(8, "little") + bytes(6)) * 700_000
    start = 8 + 9 + 4 + len("a logger") + 4
    (first,) = struct.unpack_from("<Q", data, start + 1)
    chunk = start + 9 + first  # behind the first record after the header
    parts = data[:start], attachment, indexes, data[start:chunk], attachment, data[chunk:]
    log.write_bytes(b"".join(parts))
    assert forces(open_feed(str(log), SETTINGS.read)) == whole()


def test_a_file_that_takes_its_place_begins_anew(tmp_path: Path) -> None:
    log, fresh = tmp_path / "growing.mcap", tmp_path / "fresh.mcap"
    unended = written(True, 4000)
    unended = unended[: len(unended) // 2]  # its logger was stopped
    log.write_bytes(unended)
    feed = open_feed(str(log), SETTINGS.read)
    fresh.write_bytes(written(True))
    threading.Timer(2.0, lambda: fresh.replace(log)).start()
    found, codes = forces(feed)
    assert set(codes) == {"time-backward"}
    assert {n: of[-1801:] for n, of in found.items()} == whole()[0]


def test_one_that_ends_without_a_message_and_a_monstrous_record_are_refused(
    tmp_path: Path,
) -> None:
    empty, monster = tmp_path / "empty.mcap", tmp_path / "monster.mcap"
    empty.write_bytes(written(True, 0))
    with pytest.raises(UserError, match="ended without a message"):
        followed(open_feed(str(empty), SETTINGS.read), SETTINGS, ["td"])
    start = written(True)[: 8 + 9 + 4 + len("a logger") + 4]
    monster.write_bytes(start + b"\x06" + (1 << 40).to_bytes(8, "little") + bytes(20))
    with pytest.raises(UserError, match=r"byte \d+: a record of 1099511627776 bytes"):
        followed(open_feed(str(monster), SETTINGS.read), SETTINGS, ["td"])


def test_owners_are_known_in_each_part_of_a_log_that_grows(tmp_path: Path) -> None:
    messages = [
        message(1, k * 10**7, b'{"axle": %d, "bc_pressure_bar": %d}' % (k % 2 + 1, k % 2 + 1))
        for k in range(40)
    ]
    path = tmp_path / "log.mcap"
    begin = MAGIC + b"".join(map(record, [Header("", ""), Channel(1, "/a", "json", {}, 0)]))
    path.write_bytes(begin + b"".join(map(record, messages[:39])))
    feed = open_feed(str(path), SETTINGS.read)
    wanted = [f for f in feed.head().fields if f.path == "bc_pressure_bar"]
    assert [f.group for f in wanted] == ["axle 1", "axle 2"]
    rows = feed.rows(wanted, lambda _: None)
    assert sum(1 for _ in iter(lambda: next(rows), None)) == 39
    with path.open("ab") as file:
        file.write(record(messages[39]))
    row = next(filter(None, rows))
    assert row.values == {1: 2.0}
