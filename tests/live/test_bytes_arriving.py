"""Files that grow, and standard input."""

import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.live_runs import (
    SERVICE,
    ended,
    followed,
    lines_of,
    running,
    taken,
)

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load
from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.live.bytes_arriving import Pieces
from adhesion_cli.live.open import Replay, _text


def test_a_file_that_grows_and_begins_anew_is_followed(tmp_path: Path) -> None:
    text = SERVICE.read_text().splitlines(keepends=True)
    log = tmp_path / "brake.csv"
    log.write_text("".join(text[:101]))
    with running(tmp_path, log, "--json", "-o", "out") as process:
        first = taken(process, 100)
        with log.open("a") as file:
            file.write(text[101][:9])  # a row that is not complete yet
            file.flush()
            time.sleep(0.1)
            file.write(text[101][9:] + "".join(text[102:151]))
        second = taken(process, 50)
        log.unlink()
        log.write_text(text[0] + "".join(text[151:161]))
        third = taken(process, 10)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "source-restarted" in told
    t = [one["t"] for one in (*first, *second, *third)]
    assert t == pytest.approx([float(row.split(",")[0]) for row in text[1:161]])
    assert {one["status"] for one in second} == {"ok"}
    assert set(first[0]) >= {"t", "axle", "force_n", "coefficient", "u95_n", "algo", "status"}
    again = analyze(tmp_path / "out" / "brake.live.mcap", load())
    assert len(again.axles[0].record.t) == 160


@pytest.mark.parametrize("as_json", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_rows_of_a_long_file_are_taken_once(tmp_path: Path, as_json: bool) -> None:
    rows = [line.split(",") for line in SERVICE.read_text().splitlines()]
    text = [",".join(row) for row in rows]
    if as_json:
        named = [dict(zip(rows[0], row, strict=True)) for row in rows[1:]]
        text = [json.dumps({n: float(x) for n, x in row.items() if x}) for row in named]
    log = tmp_path / ("brake.jsonl" if as_json else "brake.csv")
    log.write_text("\n".join(text[:2000]) + "\n")
    with running(tmp_path, log, "--json", "-a", "imm") as process:
        first = taken(process, 1900)
        with log.open("a") as file:
            file.write("\n".join(text[2000:]) + "\n")
        rest, told = ended(process, 2601 - 1900)
    settings = load()
    kept, _ = followed(Replay(SERVICE, settings.read, 0.0), settings, ["imm"])
    samples = [*first, *rest]
    assert [s["t"] for s in samples] == pytest.approx([s.t * 1e-9 for s in kept[1]])
    force = [s.estimates["imm"].force for s in kept[1]]
    assert [s["force_n"] for s in samples] == pytest.approx(force)
    assert not {"time-backward", "csv-bad-cells", "messages-unreadable"} & set(told.split())
    assert process.returncode == 130


def test_standard_input_takes_a_table_and_objects_in_json(tmp_path: Path) -> None:
    rows = [line.split(",") for line in SERVICE.read_text().splitlines()]
    names = rows[0]
    objects = [{n: float(x) for n, x in zip(names, row, strict=True) if x} for row in rows[1:401]]
    said = []
    for text in (
        "\n".join(",".join(row) for row in rows[:401]) + "\n",
        "\n".join(map(json.dumps, objects)),
    ):
        with running(tmp_path, "-", "--json", "-a", "imm", "-a", "td") as process:
            out, told = process.communicate(text, timeout=120)
        assert process.returncode == 0, told
        said.append(lines_of(out))
    assert said[0] == said[1]
    assert len(said[0]) == 800


@pytest.mark.parametrize("byte", [b" ", b"x", b"{"])
def test_a_sender_without_an_end_of_a_line_is_an_error(byte: bytes) -> None:
    """And is not kept for ever."""
    taken_bytes = 0

    def pieces() -> Iterator[bytes]:
        nonlocal taken_bytes
        for _ in range(1000):
            taken_bytes += 1 << 16
            yield byte * (1 << 16)

    with pytest.raises(UserError):
        _text(Pieces("x", pieces()), ReadOptions(), None).head()
    assert taken_bytes < 1 << 22 or byte == b"{"  # which may be many long messages


def test_a_closed_standard_input_is_an_error(tmp_path: Path) -> None:
    with running(tmp_path, "-", code="sys.stdin = None") as process:
        _, told = process.communicate(timeout=60)
    assert process.returncode == 1
    assert told.startswith("error: standard input is closed\nhint: ")
