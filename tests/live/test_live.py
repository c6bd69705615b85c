"""`adhesion live`: senders, samples, and the same results as of a log."""

import fcntl
import json
import os
import pty
import re
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import recordings
from helpers.forked import Forked
from helpers.live_runs import LOGS, Kept, followed, running
from helpers.mounts import mounted
from mcap.reader import make_reader

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.request import choose_estimators
from adhesion_cli.analysis.settings import Settings, load
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset
from adhesion_cli.live.axle import LiveAxle, LiveSample, Measuring
from adhesion_cli.live.open import open_feed
from adhesion_cli.live.replay import Replay
from adhesion_cli.live.run import Tally, follow, wheels_of

SERVICE, LOW = LOGS / "service-brake.csv", LOGS / "low-adhesion.csv"


@pytest.mark.parametrize("log", [SERVICE, LOW, LOW.with_suffix(".mcap")], ids=lambda p: p.name)
def test_a_replay_gives_what_analyze_gives(log: Path) -> None:
    settings = load()
    found, _ = followed(Replay(log, settings.read, 0.0), settings)
    result = analyze(log, load())
    assert sorted(found) == [a.record.axle for a in result.axles]
    for axle in result.axles:
        of = {s.t: s for s in found[axle.record.axle]}
        mine = [of[t] for t in axle.record.t.tolist()]
        for algo, force in axle.estimates.items():
            live = np.array([s.estimates[algo].force for s in mine])
            np.testing.assert_allclose(live, force, rtol=1e-9, atol=1e-9)
        sigma = np.array([s.estimates["imm"].sigma for s in mine])
        np.testing.assert_allclose(sigma, axle.sigmas["imm"], rtol=1e-9)


# ---- the command


def lines_of(text: str) -> list[dict[str, object]]:
    return [json.loads(line) for line in text.splitlines()]


def message(t: float, axle: int, kmh: float, bar: float | None = 1.0) -> str:
    said = {"t": t, "axle": axle, "speed [km/h]": kmh, "bc pressure [bar]": bar}
    return json.dumps({k: x for k, x in said.items() if x is not None})


def taken(process: Forked, count: int) -> list[dict[str, object]]:
    """The next lines that it prints."""
    assert process.stdout
    return [json.loads(process.stdout.readline()) for _ in range(count)]


def read_all(process: Forked, lines: list[dict[str, Any]]) -> None:
    """Every line that it prints, as they come."""
    assert process.stdout
    while line := process.stdout.readline():
        lines.append(json.loads(line))


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


def ended(process: Forked, lines: int) -> tuple[list[dict[str, Any]], str]:
    """That many lines, then Ctrl-C; every line and what was said on stderr."""
    first = taken(process, lines)
    process.send_signal(signal.SIGINT)
    out, told = process.communicate(timeout=60)
    return [*first, *lines_of(out)], told


@pytest.mark.parametrize("as_json", [False, True])
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


def test_messages_that_are_none_are_counted(tmp_path: Path) -> None:
    good = [
        json.dumps({"t": 0.1 * k, "axle": 1, "speed": {"kmh": 80 - 0.1 * k}, "bc": 1.0})
        for k in range(50)
    ]
    bad = ["{", "[1, 2]", '{"t": "soon", "bc": 1}', '{"t": 1e400, "bc": 1}', "\x00\xff", "null"]
    text = "\n".join([*good[:25], *bad, *good[25:]])
    stated = (
        'channels.speed = {channel = "speed.kmh", unit = "km/h"}',
        ('channels.pressure = {channel = "bc", unit = "bar"}'),
    )
    with running(tmp_path, "-", "--json", "--set", stated[0], "--set", stated[1]) as process:
        out, told = process.communicate(text, timeout=60)
    assert (process.returncode, len(lines_of(out))) == (3, 50), told
    assert "messages-unreadable" in told


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def test_datagrams_are_taken_and_kept_through_a_kill(tmp_path: Path) -> None:
    place = f"127.0.0.1:{free_port()}"
    host, port = place.split(":")
    with (
        running(tmp_path, f"udp://{place}", "--json", "-o", "out") as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        seen: list[dict[str, object]] = []
        process.stdout and process.stdout.reconfigure()  # type: ignore[attr-defined]
        begin, k = time.monotonic(), 0
        while time.monotonic() - begin < 8.0:
            said = {"t": 0.01 * k, "speed 1 [km/h]": 80.0 - 0.01 * k, "bc pressure [bar]": 1.0}
            sender.sendto(json.dumps(said).encode(), (host, int(port)))
            k += 1
            time.sleep(0.01)
        seen = taken(process, 200)
        process.kill()
    steps = np.diff([float(str(one["t"])) for one in seen])
    assert np.allclose(steps, 0.01)
    kept = analyze(tmp_path / "out" / f"udp-127-0-0-1-{port}.live.mcap", load())
    assert len(kept.axles[0].record.t) >= 200


def test_an_axle_that_boots_later_is_taken_in(tmp_path: Path) -> None:
    """Two brake units; the second begins 2 s later, first with its speed, then with all."""
    port = free_port()
    source, to = f"udp://127.0.0.1:{port}", ("127.0.0.1", port)
    with (
        running(tmp_path, source, "--json", "-o", "out", "-a", "imm") as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        lines: list[dict[str, Any]] = []
        reading = threading.Thread(target=read_all, args=(process, lines))
        reading.start()
        k, late = 0, 0
        while late < 250:
            sender.sendto(message(0.02 * k, 1, 80 - 0.02 * k).encode(), to)
            if len(lines) > 100:
                said = message(0.02 * k, 2, 79 - 0.02 * k, None if late < 10 else 2.0)
                sender.sendto(said.encode(), to)
                late += 1
            k += 1
            time.sleep(0.01)
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
        reading.join()
        assert process.stderr
        told = process.stderr.read()
    second = [one for one in lines if one["axle"] == 2]
    assert len(second) > 50, told
    assert "axle-began-late" in told
    assert {one["status"] for one in second[1:]} == {"ok"}
    assert set(lines[0]) <= set(second[0])
    assert all(one["force_n"] is not None for one in second)
    stem = tmp_path / "out" / f"udp-127-0-0-1-{port}.live"
    kept = {a.record.axle: a.record for a in analyze(stem.with_suffix(".live.mcap"), load()).axles}
    assert kept.keys() == {1, 2}
    assert len(kept[2].t) == len(second)
    times, force = recordings.column(
        stem.with_suffix(".live.rrd"), "/axle/2/force/estimates", "scalars"
    )
    assert len(times) == len(second)
    assert np.isfinite(force).all()


def test_a_late_channel_without_a_unit_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    text = [message(0.01 * k, 1, 80.0 - 0.01 * k) for k in range(400)]
    text += [json.dumps({"t": 4.0 + 0.01 * k, "axle": 2, "speed": 70.0}) for k in range(5)]
    text += [message(4.05 + 0.01 * k, 1, 76.0 - 0.01 * k) for k in range(100)]
    feed = open_feed(str(_written(tmp_path, text)), load().read)
    threading.Timer(2.0, (tmp_path / "log.jsonl").write_text, [""]).start()  # ends the feed
    found, findings = followed(feed, load(), ["td"])
    assert {f.code for f in findings} >= {"late-channels-left-out"}
    assert len(found[1]) == 500


def _written(folder: Path, lines: Sequence[str]) -> Path:
    log = folder / "log.jsonl"
    log.write_text("\n".join(lines) + "\n")
    return log


@pytest.mark.parametrize("then", [(), (-50.0,)])
def test_times_before_zero_are_recorded(tmp_path: Path, then: tuple[float, ...]) -> None:
    """Whole seconds are added, as in result files; a clock set back below zero is reported."""
    t = [*(-3.0 + 0.01 * k for k in range(500)), *(x + 0.01 * k for x in then for k in range(20))]
    text = [message(x, 1, 80.0 - 0.01 * k) for k, x in enumerate(t)]
    with running(tmp_path, "-", "--json", "-o", "out", "-a", "imm") as process:
        assert process.stdin
        process.stdin.write("\n".join(text[:500]) + "\n")
        process.stdin.flush()
        taken(process, 500)
        time.sleep(1.0)  # it is written
        out, told = process.communicate("\n".join(text[500:]), timeout=60)
    assert process.returncode == (3 if then else 0), told
    assert len(lines_of(out)) == len(t) - 500
    assert ("not-recorded" in told) == bool(then)
    record = tmp_path / "out" / "standard-input.live.mcap"
    with record.open("rb") as file:
        (own,) = [m for m in make_reader(file).iter_metadata() if m.name.endswith("provenance")]
    assert own.metadata["time_shift_ns"] == "3000000000"
    kept = analyze(record, load())
    assert len(kept.axles[0].record.t) == 500
    assert kept.log.start_ns() == 0


def test_the_file_goes_on_where_nobody_reads_the_lines(tmp_path: Path) -> None:
    with running(tmp_path, "--replay", SERVICE, "--speed", "0", "--json", "-o", "out") as process:
        taken(process, 5)
        assert process.stdout
        process.stdout.close()
        assert process.wait(timeout=120) == 0
    whole = analyze(tmp_path / "out" / "service-brake.live.mcap", load())
    assert len(whole.axles[0].record.t) == 2601


def test_the_file_goes_on_where_the_reader_of_the_lines_stands_still(tmp_path: Path) -> None:
    with running(tmp_path, "--replay", SERVICE, "--speed", "0", "--json", "-o", "out") as process:
        taken(process, 5)
        assert process.wait(timeout=120) == 0
        assert process.stderr
        told = process.stderr.read()
    dropped = re.search(r"--json: (\d+) lines were dropped", told)
    assert dropped
    assert 500 < int(dropped[1]) < 2596  # a pipe holds some hundred
    whole = analyze(tmp_path / "out" / "service-brake.live.mcap", load())
    assert len(whole.axles[0].record.t) == 2601


def test_a_full_disk_ends_the_run_and_what_was_written_can_be_read(tmp_path: Path) -> None:
    with mounted(tmp_path, "size=1m") as disk:
        with running(disk, "--replay", LOW, "--speed", "10", "--json", "-o", "out") as process:
            out, told = process.communicate(timeout=120)
        assert process.returncode == 1
        *lines, failed = lines_of(out)
        assert str(failed["error"]).startswith("out/low-adhesion.live.mcap: cannot be written"), (
            told
        )
        whole = analyze(disk / "out" / "low-adhesion.live.mcap", load())
    assert [f.code for f in whole.findings if f.severity == "error"] == ["mcap-damaged"]
    kept = sum(len(a.record.t) for a in whole.axles)
    assert 100 < kept <= len(lines)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # its viewer was killed
def test_a_viewer_shows_the_samples_and_may_go(tmp_path: Path) -> None:
    port = free_port()
    shown = tmp_path / "shown.rrd"
    command = [sys.executable, "-m", "rerun", "--port", str(port), "--save", str(shown)]
    null = subprocess.DEVNULL
    viewer = subprocess.Popen(command, stdin=null, stdout=null, stderr=null, start_new_session=True)
    try:
        url = f"rerun+http://127.0.0.1:{port}/proxy"
        with running(tmp_path, "--replay", SERVICE, "--connect", url, "-o", "out") as process:
            until = time.monotonic() + 100.0
            while not (shown.exists() and shown.stat().st_size > 100_000):
                assert time.monotonic() < until
                time.sleep(0.2)
            os.killpg(viewer.pid, signal.SIGKILL)  # with the process that it started
            viewer.wait()
            process.send_signal(signal.SIGINT)
            _, told = process.communicate(timeout=60)
        assert process.returncode == 130, told
    finally:
        with suppress(ProcessLookupError):
            os.killpg(viewer.pid, signal.SIGKILL)
    for path in (shown, tmp_path / "out" / "service-brake.live.rrd"):
        times, force = recordings.column(path, "/axle/1/force/estimates", "scalars")
        assert len(times) >= 20
        assert np.isfinite(force).all()
    (names,) = recordings.batches(path, "/lines/all")
    assert "axle 1" in str(names.to_pydict())


@pytest.mark.parametrize(
    "arguments",
    [
        ["-", "--connect", "foo"],
        ["-", "--connect", "rerun+http://127.0.0.1:99999/proxy"],
        ["-", "--dbc", "no.dbc"],
        ["-", "-o", "file.txt"],
        ["."],
        ["udp://127.0.0.1:99999"],
    ],
)
def test_wrong_arguments_are_refused_with_a_remedy(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "file.txt").touch()
    with running(tmp_path, *arguments, "--json") as process:
        out, _ = process.communicate("", timeout=60)
    (error,) = lines_of(out)
    code = 1 if "-o" in arguments else 2  # as every command says of -o
    assert (process.returncode, error["schema"]) == (code, "adhesion.error/1")
    assert "internal error" not in str(error["error"])
    assert error["hint"]


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("no.csv", "no such file"),
        ("tcp://127.0.0.1:1", "no source of this kind"),
        ("udp://127.0.0.1:0", "no port"),
        ("udp://127.0.0.1:x", "no port"),
        ("udp://192.0.2.1:5005", "cannot listen"),
        ("log.parquet", "--replay"),
    ],
)
def test_what_is_no_source_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.parquet").write_bytes(b"PAR1 and more")
    with pytest.raises(UserError) as told:
        open_feed(source, load().read)
    assert says in f"{told.value.text} {told.value.hint}"


def shown_on_a_terminal(folder: Path, columns: int, text: Sequence[str]) -> tuple[list[str], str]:
    """The lines that stay on a terminal, and every state of the line that does not."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": slave}
    with Forked(folder, ["live", "-", "-a", "imm"], **pipes) as process:
        os.close(slave)
        seen = bytearray()

        def read() -> None:
            with suppress(OSError):
                while piece := os.read(master, 1 << 16):
                    seen.extend(piece)

        reading = threading.Thread(target=read)
        reading.start()
        assert process.stdin
        for k, line in enumerate(text):
            process.stdin.write(line + "\n")
            process.stdin.flush()
            time.sleep(0.005 if k > 100 else 0.0)
        process.stdin.close()
        assert process.wait(timeout=60) == 3
    reading.join()
    os.close(master)
    *stays, last = seen.decode().replace("\r\n", "\n").split("\n")
    states = [x for line in (*stays, last) for x in line.split("\r\x1b[2K")[1:-1] if x]
    return [line.rsplit("\r\x1b[2K", 1)[-1] for line in stays], "\n".join(states)


@pytest.mark.parametrize(("columns", "worst"), [(30, "4"), (60, "1"), (200, "1")])
def test_the_line_fits_the_terminal_and_leaves_no_rests(
    tmp_path: Path, columns: int, worst: str
) -> None:
    """Axle 4 slides most; a repeated sample is reported in between."""
    slip = {1: 0.0, 2: 0.01, 3: 0.02, 4: 0.3}
    text = []
    for k in range(500):
        said: dict[str, float] = {"t": 0.01 * k, "train speed [km/h]": 80.0 - 0.01 * k}
        for n, s in slip.items():
            said[f"speed {n} [km/h]"] = (80.0 - 0.01 * k) * (1.0 - s)
            said[f"bc pressure {n} [bar]"] = 2.0
        text += [json.dumps(said)] * (2 if k == 300 else 1)
    stays, states = shown_on_a_terminal(tmp_path, columns, text)
    assert states
    assert max(map(len, states.split("\n"))) < columns
    assert {line[0] for line in states.split("\n")[1:]} == {worst}
    assert not [line for line in stays if "\r" in line or "Hz" in line or "30 %" in line]
    assert any("time-duplicate" in line for line in stays)
    assert [f"axle {n}: 500 samples" in stays for n in slip] == [True] * 4


def test_what_was_taken_and_written_is_said_at_the_end(tmp_path: Path) -> None:
    for quiet in ((), ("-q",)):
        with running(
            tmp_path, "--replay", SERVICE, "--speed", "0", "-o", "out", "--force", *quiet
        ) as process:
            _, told = process.communicate(timeout=120)
        assert process.returncode == 0
        said = told.splitlines()
        wrote = [f"wrote out/service-brake.live{kind}" for kind in (".mcap", ".rrd")]
        assert [x in said for x in ("axle 1: 2601 samples", *wrote)] == [not quiet] * 3
        assert ("vehicle-default" in told) is not quiet


def test_that_no_sample_comes_is_said_once(tmp_path: Path) -> None:
    source = f"udp://127.0.0.1:{(port := free_port())}"
    with (
        running(tmp_path, source, "--json") as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        assert process.stderr
        said, lines = [process.stderr.readline()], list[dict[str, Any]]()
        reading = threading.Thread(target=read_all, args=(process, lines))
        reading.start()
        for pause, begin in ((4.5, 0), (0.5, 300)):
            for k in range(begin, begin + 300):
                sender.sendto(message(0.01 * k, 1, 80.0).encode(), ("127.0.0.1", port))
                time.sleep(0.001)
            time.sleep(pause)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
        reading.join()
        said += process.stderr.read().splitlines()
    assert sum(source in line for line in said) == 4  # nothing comes, it comes; twice
    assert len(lines) > 500
    assert all("t" in one for one in lines)


def test_ctrl_c_before_the_first_sample_is_no_error(tmp_path: Path) -> None:
    with running(tmp_path, f"udp://127.0.0.1:{free_port()}", "--json", "-o", "out") as process:
        assert process.stderr
        process.stderr.readline()  # it waits
        process.send_signal(signal.SIGINT)
        out, told = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert "error" not in told


def test_foxglove_gets_the_topics_of_an_axle_that_comes_later() -> None:
    pytest.importorskip("foxglove")
    sync = pytest.importorskip("websockets.sync.client")
    from adhesion_cli.live.served import Served

    served, (sample,) = Served(0, Vehicle(), [1], ["td", "imm"]), samples_of(1)
    served.take([sample, sample._replace(axle=2)])
    try:
        with sync.connect(served.url, subprotocols=["foxglove.sdk.v1"]) as client:
            told = [json.loads(client.recv(timeout=20)) for _ in range(2)]
    finally:
        served.close()
    topics = {c["topic"] for one in told for c in one.get("channels", [])}
    of = ("input", "slip", "estimate/td", "estimate/imm")
    assert topics == {f"/axle/{n}/{t}" for n in (1, 2) for t in of}


def samples_of(count: int) -> list[LiveSample]:
    one = axle()
    for k in range(count):
        one.brake(k * 10_000_000, 2e5, 0)
    return [s for k in range(count) if (s := one.wheel(k * 10_000_000, 40.0 - 0.01 * k, 0))]


def faulty(folder: Path, column: int, value: str | None, to: float) -> Path:
    """The service brake with a fault from 10 s on; None: the value at its begin."""
    rows = [line.split(",") for line in SERVICE.read_text().splitlines()]
    own = [row for row in rows[1:] if 10.0 <= float(row[0]) < to]
    stays = own[0][column]
    for row in own:
        row[column] = stays if value is None else value
    log = folder / "faulty.csv"
    log.write_text("".join(",".join(row) + "\n" for row in rows))
    return log


@pytest.mark.parametrize(
    ("column", "value", "to", "code", "sees"),
    [
        (1, "", 14.0, "no-pressure", 0.2),
        (1, "NaN", 99.0, "no-pressure", 0.2),
        (1, None, 14.0, "pressure-stuck", 0.5),
        (2, "99999", 10.1, "speed-outlier", 0.0),
        (2, "0", 10.5, "speed-outlier", 0.0),
        (2, None, 13.0, "speed-stuck", 1.0),
    ],
)
def test_faults_are_found_as_analyze_finds_them(
    tmp_path: Path, column: int, value: str | None, to: float, code: str, sees: float
) -> None:
    log = faulty(tmp_path, column, value, to)
    assert code in {f.code for f in analyze(log, load()).findings}
    with log.open() as rows, running(tmp_path, "-", "--json", "-a", "imm") as process:
        out, told = process.communicate(rows.read(), timeout=60)
    assert (process.returncode, code in told) == (3, True)
    samples = lines_of(out)
    lasting = [s for s in samples if 10.0 + sees <= float(str(s["t"])) < to]
    assert {s["status"] for s in lasting} == {code}
    assert not [s for s in lasting if s["force_n"] is not None]
    others = [s for s in samples if not 10.0 <= float(str(s["t"])) < to + 0.1]
    assert {s["status"] for s in others} <= {"ok", "start"}


def test_empty_cells_of_slower_channels_are_one_note(tmp_path: Path) -> None:
    names = [f"{what} {n} [{unit}]" for n in (1, 2, 3, 4)
             for what, unit in (("bc_pressure", "bar"), ("wheel_speed", "km/h"))]  # fmt: skip
    rows = [
        [f"{0.01 * k:.2f}", *([f"{2.0 + 0.01 * (k % 7):.2f}" if k % 5 == 0 else "", "60.0"] * 4)]
        for k in range(200)
    ]
    text = "\n".join(",".join(row) for row in [["time [s]", *names], *rows]) + "\n"
    with running(tmp_path, "-", "--json", "-a", "td") as process:
        _, told = process.communicate(text, timeout=60)
    assert told.count("csv-missing-cells") == 1


@pytest.mark.parametrize("log", [SERVICE, LOW, LOW.with_suffix(".mcap")], ids=lambda p: p.name)
def test_a_sound_log_has_no_fault(log: Path) -> None:
    settings = load()
    found, findings = followed(Replay(log, settings.read, 0.0), settings, ["imm"])
    assert [f for f in findings if f.severity != "info"] == []
    assert {s.status for of in found.values() for s in of[1:]} == {"ok"}


def test_the_band_has_the_tolerances_of_the_vehicle(tmp_path: Path) -> None:
    """As the budget of the reference has them."""
    settings, w = load(), wheelset(Vehicle(), 1)
    found, _ = followed(Replay(SERVICE, settings.read, 0.0), settings, ["imm"])
    axle = analyze(SERVICE, load(), ["imm"]).axles[0]
    known = np.isfinite(axle.reference.tolerance) & (axle.record.clamping_force > 1e3)
    of = {s.t: s.estimates["imm"] for s in found[1]}
    mine = np.array([of[t].tolerance for t in axle.record.t.tolist()])
    np.testing.assert_allclose(
        np.median(mine[known]), np.median(axle.reference.tolerance[known]), rtol=0.02
    )
    with running(tmp_path, "--replay", SERVICE, "--speed", "0", "--json", "-a", "imm") as process:
        out, _ = process.communicate(timeout=60)
    u95 = {round(float(str(s["t"])) * 1e9): s["u95_n"] for s in lines_of(out)}
    for s in found[1][::100]:
        e = s.estimates["imm"]
        assert u95[s.t] == pytest.approx(1.959964 * np.hypot(e.sigma, e.tolerance), rel=1e-6)
    braked = [u95[s.t] for s in found[1] if s.clamping > 1e4]
    assert min(braked) > 1.9 * 0.1 * w.phi * 1e4  # friction alone has 10 %


def test_the_regime_agrees_with_the_slip(tmp_path: Path) -> None:
    with running(tmp_path, "--replay", LOW, "--speed", "0", "--json", "-a", "imm") as process:
        out, _ = process.communicate(timeout=60)
    assert all(s["regime"] is None for s in lines_of(out) if float(str(s["t"])) > 35.0)  # stands
    known = [s for s in lines_of(out) if s["slip"] is not None and s["regime"]]
    assert {s["regime"] for s in known if float(str(s["slip"])) > 0.05} == {"sliding"}
    assert {s["regime"] for s in known if float(str(s["slip"])) < 0.01} == {"rolling"}


def test_times_are_exact_to_the_nanosecond(tmp_path: Path) -> None:
    times = ["1700000025.99", "1700000026.000000001", "1700000026.01", "1700000026.02"]
    rows = "".join(f"{t},1.0,{80.0 - 0.01 * k}\n" for k, t in enumerate(times))
    text = "time [s],bc_pressure [bar],wheel_speed [km/h]\n" + rows
    with running(tmp_path, "-", "--json", "-a", "td", "-a", "imm") as process:
        out, told = process.communicate(text, timeout=60)
    said = [line.split(",")[0].removeprefix('{"t": ') for line in out.splitlines()]
    assert said == [t for t in times for _ in range(2)], told
    assert [s["algo"] for s in lines_of(out)] == ["td", "imm"] * 4


# ---- one axle


def axle() -> LiveAxle:
    algos = {e.name: (e, Settings().params(e)) for e in choose_estimators(["td", "imm"])}
    return LiveAxle(Measuring(1), Vehicle(), algos)


def test_gaps_repeats_and_late_samples_are_found_as_they_happen() -> None:
    one = axle()
    seconds = [*np.arange(0.0, 1.0, 0.01), 0.5, 0.99, 3.0, 3.01]
    samples = []
    for k, x in enumerate(seconds):
        one.brake(round(x * 1e9), 2e5, 0)
        samples.append(one.wheel(round(x * 1e9), 40.0 - 0.001 * k, 0))
    found = [(f.code, f.spans[0][0]) for f in one.findings if not f.code.startswith("time-out")]
    assert found == [("time-duplicate", pytest.approx(0.99)), ("gap", pytest.approx(3.0))]
    assert [s is None for s in samples[-4:]] == [True, True, False, False]
    assert [s and s.status for s in samples[-2:]] == ["start", "ok"]


def test_a_wheel_that_repeats_one_value_under_brake_is_stuck() -> None:
    one = axle()
    for k in range(1200):
        one.brake(k * 10_000_000, 2e5, 0)
        one.wheel(k * 10_000_000, 60.0 - 0.02 * min(k, 1000), 0)
    assert [(f.code, 10.3 < f.spans[0][0] < 11.0) for f in one.findings] == [("speed-stuck", True)]


def test_a_clock_that_is_set_back_starts_a_segment() -> None:
    one = axle()
    seconds = [*np.arange(20.0, 30.0, 0.01), *np.arange(0.0, 1.0, 0.01)]
    status = []
    for k, x in enumerate(seconds):
        one.brake(round(x * 1e9), 2e5, 0)
        sample = one.wheel(round(x * 1e9), 40.0 - 0.001 * k, 0)
        status.append(sample and sample.status)
    assert [f.code for f in one.findings] == ["time-backward"]
    assert status == ["start", *["ok"] * 999, "start", *["ok"] * 99]


def test_a_train_speed_that_ends_gives_no_slip() -> None:
    one = axle()
    known = []
    for k in range(300):
        t = k * 10_000_000
        one.brake(t, 2e5, 0)
        if k < 200:
            one.train(t, 20.0)
        sample = one.wheel(t, 40.0 - 0.001 * k, 0)
        known.append(sample is not None and np.isfinite([sample.slip, sample.train]).all())
    assert all(known[:205])
    assert not any(known[206:])


def test_without_a_recent_pressure_there_is_no_force() -> None:
    one = axle()
    for k in range(200):
        if k < 100:
            one.brake(k * 10_000_000, 2e5, 0)
        last = one.wheel(k * 10_000_000, 40.0 - 0.001 * k, 0)
    assert last
    assert (last.status, dict(last.estimates)) == ("no-pressure", {})


def test_frames_of_a_bus_are_decoded_by_the_dbc(tmp_path: Path) -> None:
    can = pytest.importorskip("can")
    cantools = pytest.importorskip("cantools")
    dbc = tmp_path / "train.dbc"
    dbc.write_text(
        'VERSION ""\nBS_:\nBU_: BCU\n'
        "BO_ 256 Brake: 4 BCU\n"
        ' SG_ bc_pressure_1 : 0|16@1+ (0.01,0) [0|10] "bar" BCU\n'
        ' SG_ wheel_speed_1 : 16|16@1+ (0.01,0) [0|300] "km/h" BCU\n'
    )
    message = cantools.database.load_file(dbc).get_message_by_name("Brake")
    settings = load(assignments=[f'can.dbc = ["{dbc}"]'])
    feed = open_feed("can:virtual:live", settings.read)
    with can.Bus(interface="virtual", channel="live") as sender:
        for k in range(250):
            said = {"bc_pressure_1": 2.0, "wheel_speed_1": 80.0 - 0.1 * k}
            frame = can.Message(
                arbitration_id=256, is_extended_id=False, data=message.encode(said),
                timestamp=1e9 + 0.01 * k,
            )  # fmt: skip
            sender.send(frame)
        sender.send(can.Message(arbitration_id=257, is_extended_id=False, data=b"\0"))
        kept, tally = Kept(), Tally(lambda _: None)
        algos = {e.name: (e, settings.params(e)) for e in choose_estimators(["imm"])}
        wheels = wheels_of(feed, settings, ())
        threading.Timer(3.0, feed.close).start()
        follow(feed, wheels, settings, algos, [kept], tally)
    assert len(kept.of[1]) == 250
    assert kept.of[1][100].speed == pytest.approx(70.0 / 3.6 / settings.vehicle.radius(1).value)
    assert kept.of[1][100].pressure == pytest.approx(2e5)


def test_messages_of_a_broker_are_taken_and_served_to_foxglove(tmp_path: Path) -> None:
    """A real broker, a real client of Foxglove's protocol."""
    import asyncio

    pytest.importorskip("foxglove")
    broker_of = pytest.importorskip("amqtt.broker").Broker
    sync = pytest.importorskip("websockets.sync.client")
    paho = pytest.importorskip("paho.mqtt.client")
    port, served = free_port(), free_port()
    stated = {
        "listeners": {"default": {"type": "tcp", "bind": f"127.0.0.1:{port}"}},
        "plugins": {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}},
    }
    loop = asyncio.new_event_loop()

    async def started() -> Any:
        broker = broker_of(stated)
        await broker.start()
        return broker

    broker = loop.run_until_complete(started())
    turning = threading.Thread(target=loop.run_forever, daemon=True)
    turning.start()
    sender = paho.Client(paho.CallbackAPIVersion.VERSION2)
    sender.connect("127.0.0.1", port)
    sender.loop_start()
    source = f"mqtt://127.0.0.1:{port}/train/#"
    try:
        with running(tmp_path, source, "--json", "--serve", str(served), "-a", "imm") as process:
            stop = threading.Event()

            def send() -> None:
                k = 0
                while not stop.wait(0.02):
                    said = {"t": 0.02 * k, "speed 1 [km/h]": 80 - 0.02 * k, "bc pressure [bar]": 1}
                    sender.publish("train/brake", json.dumps(said))
                    k += 1

            sending = threading.Thread(target=send)
            sending.start()
            try:
                assert taken(process, 20)[-1]["status"] == "ok"
                with sync.connect(
                    f"ws://127.0.0.1:{served}", subprotocols=["foxglove.sdk.v1"]
                ) as client:
                    told = [json.loads(client.recv(timeout=20)) for _ in range(2)]
            finally:
                stop.set()
                sending.join()
        topics = {c["topic"] for one in told for c in one.get("channels", [])}
        assert topics == {"/axle/1/input", "/axle/1/slip", "/axle/1/estimate/imm"}
    finally:
        sender.loop_stop()
        asyncio.run_coroutine_threadsafe(broker.shutdown(), loop).result(20)
        loop.call_soon_threadsafe(loop.stop)
        turning.join()
