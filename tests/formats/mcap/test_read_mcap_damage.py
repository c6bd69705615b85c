"""Damaged and hostile MCAP files: a typed error or a finding, never wrong numbers in silence."""

import random
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.hostile_mcap import HOSTILE, LONG_MCAP, RIGHT, wrapped
from helpers.mcap_logs import (
    MAGIC,
    START,
    Log,
    chunk,
    message,
    record,
    scalar_log,
)
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
)

from adhesion_cli.channels.log import unchanged
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.formats.mcap.reader import McapSource, open_mcap
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.results.mcap import write_log

# what a log says, read: by field its times, values and validity, and the metadata
Said = dict[tuple[str, str], tuple[bytes, bytes, bytes]]

VALUES = [0.5 * i for i in range(24)]
SMALL = {
    "zstd": scalar_log(VALUES, compression="zstd", per_chunk=8, data_crc=False),
    "lz4": scalar_log(VALUES, compression="lz4", per_chunk=8, attachments=2, data_crc=False),
    "none": scalar_log(VALUES, per_chunk=8, padding=b"more", data_crc=False),
    "unchunked": scalar_log(VALUES, metadata={"wagon": "7"}),
}  # fmt: skip


def read(path: Path, strict: bool = False) -> tuple[Said, set[str]]:
    """All a log says, and the severities of what was found beside that."""
    source = open_mcap(path, ReadOptions(strict=strict))
    columns = source.columns(source.fields)
    said = {
        (f.channel, f.path): (c.t.tobytes(), c.value.tobytes(), c.valid.tobytes())
        for f, c in zip(source.fields, columns, strict=True)
    }
    said["metadata", str(source.metadata)] = (b"", b"", b"")
    return said, {f.severity for f in source.findings} - {"info"}


def verdict(path: Path, whole: Said) -> str:
    """ "right", "told" (error or finding) or "silent"; any other exception escapes."""
    try:
        said, told = read(path)
    except UserError as error:
        return "told" if f"{path}: byte" in error.text else "without a place"
    if told:
        return "told"
    return "right" if said == whole else "silent"


def flips(raw: bytes, bits: Iterator[int]) -> Iterator[bytes]:
    for bit in bits:
        changed = bytearray(raw)
        changed[bit // 8] ^= 1 << bit % 8
        yield bytes(changed)


@pytest.mark.parametrize("kind", SMALL)
def test_a_flipped_bit_is_never_silent(tmp_path: Path, kind: str) -> None:
    raw = SMALL[kind].bytes()
    some = random.Random(kind).sample(range(len(raw) * 8), 250)
    _never_silent(tmp_path, raw, flips(raw, iter(some)))


@pytest.mark.parametrize("kind", SMALL)
def test_a_truncation_is_never_silent(tmp_path: Path, kind: str) -> None:
    raw = SMALL[kind].bytes()
    some = random.Random(kind).sample(range(len(raw)), 80)
    _never_silent(tmp_path, raw, (raw[:n] for n in some))


@pytest.mark.slow
@pytest.mark.parametrize("kind", SMALL)
def test_every_flipped_bit_and_truncation(tmp_path: Path, kind: str) -> None:
    raw = SMALL[kind].bytes()
    _never_silent(tmp_path, raw, flips(raw, iter(range(len(raw) * 8))))
    _never_silent(tmp_path, raw, (raw[:n] for n in range(len(raw))))


def _never_silent(folder: Path, raw: bytes, damaged: Iterator[bytes]) -> None:
    path = folder / "log.mcap"
    path.write_bytes(raw)
    whole, told = read(path)
    assert not told
    for n, changed in enumerate(damaged):
        path.write_bytes(changed)
        assert verdict(path, whole) in ("right", "told"), n


def test_whole_chunks_before_a_truncation_are_kept_and_counted(tmp_path: Path) -> None:
    log = scalar_log(VALUES, compression="zstd", per_chunk=8)
    raw = log.bytes()
    path = tmp_path / "log.mcap"
    third = raw.index(b"\x06", raw.rindex(b"zstd", 0, raw.index(b"\x0f\x04")) - 60)
    path.write_bytes(raw[: third + 70])
    source = open_mcap(path, ReadOptions())
    p, v = source.columns(source.fields)
    assert source.rows == 16
    np.testing.assert_array_equal(p.value, VALUES[:16:2])
    np.testing.assert_array_equal(v.value, VALUES[1:16:2])
    (finding,) = source.findings
    assert (finding.code, finding.severity) == ("mcap-damaged", "error")
    assert (finding.values["byte"], finding.values["kept_messages"]) == (third, 16)
    with pytest.raises(UserError, match=f"log.mcap: byte {third}: "):
        open_mcap(path, ReadOptions(strict=True))


def test_one_bad_chunk_costs_only_itself(tmp_path: Path) -> None:
    definitions = [Channel(1, "/c", "json", {}, 0)]
    chunks = [
        chunk([*definitions, *(message(1, START + 10 * n + i, b'{"x": %d}' % n) for i in range(5))])
        for n in range(3)
    ]
    bad = bytearray(chunks[1][0])
    bad[-3] ^= 4
    raw = MAGIC + record(Header("", "")) + chunks[0][0] + bytes(bad) + chunks[2][0]
    path = tmp_path / "log.mcap"
    path.write_bytes(raw + record(DataEnd(0)) + record(Footer(0, 0, 0)) + MAGIC)
    source = open_mcap(path, ReadOptions())
    (column,) = source.columns(source.fields)
    assert column.value.tolist() == [0.0] * 5 + [2.0] * 5
    (finding,) = source.findings
    assert finding.values["byte"] == len(MAGIC + record(Header("", ""))) + len(chunks[0][0])


def recovered(path: Path, copy: Path) -> list[Finding]:
    """Writes what is whole into a new file, as `convert` does."""
    source = McapSource(path, ReadOptions())
    write_log(copy, unchanged(source, ()))
    return source.findings


def changed(log: Log) -> bytes:
    """A log with one digit of a message other than it was."""
    raw = log.bytes()
    at = raw.index(b'"value"', len(raw) // 3) + 9
    return raw[:at] + bytes([raw[at] ^ 1]) + raw[at + 1 :]


def test_a_copy_makes_nothing_sound(tmp_path: Path) -> None:
    """Which messages changed is not known where one CRC guards them all."""
    path, copy = tmp_path / "log.mcap", tmp_path / "0.mcap"
    path.write_bytes(changed(scalar_log(VALUES)))
    assert {f.code for f in recovered(path, copy)} == {"mcap-damaged"}
    first = McapSource(copy, ReadOptions()).metadata["adhesion.recovered"]
    for k in range(3):  # copies of the copy
        assert McapSource(copy, ReadOptions()).metadata["adhesion.recovered"] == first
        findings = McapSource(copy, ReadOptions()).findings
        assert [(f.code, f.severity, f.count) for f in findings] == [
            ("mcap-recovered", "warning", 1)
        ]
        assert "data section has another CRC" in findings[0].names["damage"]
        recovered(copy, copy := tmp_path / f"{k + 1}.mcap")
    raw = copy.read_bytes()
    copy.write_bytes(raw[: raw.index(b"\x0f\x04" + bytes(7))])
    recovered(copy, path)
    told = {f.code: f for f in McapSource(path, ReadOptions()).findings}
    assert "before: byte" in told["mcap-recovered"].names["damage"]

    whole = scalar_log(VALUES, per_chunk=5)  # with a CRC of each chunk
    path.write_bytes(changed(whole))
    recovered(path, copy)
    (finding,) = McapSource(copy, ReadOptions()).findings
    assert (finding.code, finding.severity) == ("mcap-recovered", "warning")


CHUNKED = [kind for kind in SMALL if kind != "unchunked"]


def _recovers(folder: Path, kind: str, damages: Iterator[tuple[int, int, bytes]]) -> None:
    """Reads damaged logs.

    Every chunk before the damage must be read.

    Args:
        folder: where to work.
        kind: which of `SMALL`.
        damages: first byte changed, first byte behind, and what stands there instead.
    """
    raw = SMALL[kind].bytes()
    path = folder / "damaged.mcap"
    path.write_bytes(raw)
    spans = [(block.offset, block.stop) for block in open_mcap(path, ReadOptions()).walk.blocks]
    for first, behind, instead in damages:
        path.write_bytes(raw[:first] + instead + raw[behind:])
        kept = [k for k, (_, b) in enumerate(spans) if b <= first]
        try:
            source = open_mcap(path, ReadOptions())
            columns = source.columns(source.fields)
        except UserError as error:
            where = error.text
            assert not kept, (first, instead)
        else:
            where = f"{path}: byte"
            found = {x for c in columns for x in c.value[c.valid].tolist()}
            assert found >= {x for k in kept for x in VALUES[8 * k : 8 * k + 8]}, first
            assert source.findings or len(found) == len(VALUES)
        assert f"{path}: byte" in where


def _flips(kind: str, bits: Iterator[tuple[int, int]]) -> Iterator[tuple[int, int, bytes]]:
    raw = SMALL[kind].bytes()
    return ((n, n + 1, bytes([raw[n] ^ (1 << bit)])) for n, bit in bits)


def _shifts(size: int, at: Sequence[int], by: int) -> Iterator[tuple[int, int, bytes]]:
    """Bytes too many, and bytes that are missing: every offset behind is another."""
    yield from ((n, n, bytes(by)) for n in at)
    yield from ((n, min(n + by, size), b"") for n in at)


@pytest.mark.parametrize("kind", CHUNKED)
def test_recovery_keeps_every_chunk_before_the_damage(tmp_path: Path, kind: str) -> None:
    size, chance = len(SMALL[kind].bytes()), random.Random(kind)
    at = chance.sample(range(len(MAGIC), size), 150)
    _recovers(tmp_path, kind, _flips(kind, ((n, chance.randrange(8)) for n in at)))
    _recovers(tmp_path, kind, ((n, size, b"") for n in at[:50]))
    _recovers(tmp_path, kind, _shifts(size, at[:50], chance.choice([1, 8, 300])))


@pytest.mark.slow
@pytest.mark.parametrize("kind", CHUNKED)
def test_recovery_from_every_flipped_bit_truncation_and_shift(tmp_path: Path, kind: str) -> None:
    size = len(SMALL[kind].bytes())
    every = range(len(MAGIC), size)
    _recovers(tmp_path, kind, _flips(kind, ((n, bit) for n in every for bit in range(8))))
    _recovers(tmp_path, kind, ((n, size, b"") for n in every))
    for by in (1, 8, 300):
        _recovers(tmp_path, kind, _shifts(size, every, by))


# ---------------------------------------------------------------------- hostile files


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.slow] * (x in LONG_MCAP)) for x in HOSTILE]
)
def test_hostile_files_are_told_of(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(HOSTILE[name]())
    begin = time.process_time()
    try:
        said, told = read(path)
    except UserError as error:
        text = error.text
    else:
        assert bool(told) == (name not in RIGHT), said
        text = str(path)
        if "error" in told:
            with pytest.raises(UserError, match="log"):
                read(path, strict=True)
    assert str(path) in text
    # generous: the point is that no size inside the file decides how long it takes
    assert time.process_time() - begin < 10


def test_a_definition_that_is_contradicted_costs_no_more_than_it_must(tmp_path: Path) -> None:
    """The first definition counts."""
    path = tmp_path / "log.mcap"
    one, other = Channel(1, "/c", "json", {}, 0), Channel(1, "/d", "json", {}, 0)
    blocks: list[list[Any]] = [
        [one, *(message(1, START + n, b'{"x": %d}' % n) for n in range(3))],
        [other, message(1, START + 3, b'{"x": 3}')],
        [message(1, START + 4, b'{"x": 4}')],
        [Channel(2, "/e", "json", {}, 0), message(2, START + 5, b'{"x": 5}')],
        [one, message(1, START + 6, b'{"x": 6}')],
    ]
    parts = [chunk(b)[0] for b in blocks]
    path.write_bytes(wrapped(*parts))
    source = open_mcap(path, ReadOptions())
    values = [c.value.tolist() for c in source.columns(source.fields)]
    assert values == [[0, 1, 2, 4, 6], [5]]
    at = len(MAGIC) + len(record(Header("", ""))) + len(parts[0])
    assert [(d.at, d.what) for d in source.walk.damage] == [
        (at, "channel 1 is defined a second time, differently"),
    ]


def test_what_a_damaged_log_lost_is_told_of_all_that_is_made_of_it(tmp_path: Path) -> None:
    """Fresh CRCs make nothing sound: not by `convert`."""
    log = scalar_log(VALUES, crc=False)
    log.messages.append(message(77, START, b"of no channel"))
    (tmp_path / "stray.mcap").write_bytes(log.bytes())
    recovered(tmp_path / "stray.mcap", tmp_path / "copy.mcap")
    (told,) = (
        f
        for f in McapSource(tmp_path / "copy.mcap", ReadOptions()).findings
        if f.code == "mcap-recovered"
    )
    assert "1 messages of channels that it does not define" in told.names["damage"]

    raw = bytearray(scalar_log(VALUES).bytes())
    raw[raw.index(b"7.5")] ^= 1  # under the CRC of all messages together
    (tmp_path / "bad.mcap").write_bytes(raw)
    for source, target in ("bad", "a"), ("a", "b"):
        result = unchanged(open_mcap(tmp_path / f"{source}.mcap", ReadOptions()), ())
        write_log(tmp_path / f"{target}.mcap", result)
    for name in "a", "b":
        (told,) = (
            f
            for f in McapSource(tmp_path / f"{name}.mcap", ReadOptions()).findings
            if f.code == "mcap-recovered"
        )
        assert told.severity == "warning"
        assert "data section has another CRC" in told.names["damage"]
