"""The files and the viewer that samples go to."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from helpers import recordings
from helpers.commands import Run
from helpers.live_runs import (
    LOW,
    SERVICE,
    free_port,
    lines_of,
    message,
    running,
    samples_of,
    taken,
)
from helpers.mounts import mounted
from mcap.reader import make_reader

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load
from adhesion_cli.cli import view as cli_view
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.live import recording
from adhesion_cli.live.axle import Sink
from adhesion_cli.live.recording import new_file
from adhesion_cli.results.rrd.live import LiveRecording


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
    assert "the reader of --json is slower than the samples: it gets only some of them" in told
    whole = analyze(tmp_path / "out" / "service-brake.live.mcap", load())
    assert len(whole.axles[0].record.t) == 2601


def test_a_second_run_does_not_write_what_the_first_one_writes(tmp_path: Path) -> None:
    arguments = "--replay", SERVICE, "--json", "-o", "out", "--force"
    with running(tmp_path, *arguments, "--speed", "1") as first:
        taken(first, 5)
        with running(tmp_path, *arguments, "--speed", "0") as second:
            (told,) = lines_of(second.communicate(timeout=60)[0])
        assert second.returncode == 1
        assert told["error"] == (
            "out/service-brake.live.mcap: another run of `live` is writing this file"
        )
        first.send_signal(signal.SIGINT)
        lines = 5 + len(lines_of(first.communicate(timeout=60)[0]))
    whole = analyze(tmp_path / "out" / "service-brake.live.mcap", load())
    # An interrupt may come between the file and the line.
    assert len(whole.axles[0].record.t) - lines in (0, 1)
    assert not list(tmp_path.glob("out/.*"))
    with running(tmp_path, *arguments, "--speed", "0") as third:
        third.communicate(timeout=60)
    assert third.returncode == 0


def test_a_link_is_replaced_and_its_target_stays(run: Run, tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("precious")
    path = tmp_path / "service-brake.live.mcap"
    path.symlink_to(tmp_path / "precious")
    arguments = "live", "--replay", SERVICE, "--speed", "0", "-q", "-a", "td", "-o", "."
    assert run(*arguments).returncode == 1  # it exists
    assert path.is_symlink()
    assert run(*arguments, "--force").returncode == 0
    assert (tmp_path / "precious").read_text() == "precious"
    assert not path.is_symlink()
    assert path.stat().st_size > 1000


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_the_log_itself_is_no_target(
    run: Run, tmp_path: Path, link: Callable[[Path, Path], None]
) -> None:
    log = tmp_path / "log.csv"
    log.write_bytes(SERVICE.read_bytes())
    link(tmp_path / "log.live.mcap", log)
    made = run("live", "--replay", "log.csv", "--speed", "0", "-o", ".", "--force")
    assert made.returncode == 1
    assert "log.live.mcap: is the input itself" in made.stderr
    assert log.read_bytes() == SERVICE.read_bytes()


def test_a_viewer_that_takes_nothing_stops_no_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "_WAITING_SAMPLES", 10)
    monkeypatch.setattr(recording, "_PATIENCE", 0.1)

    class Stalled(Sink):
        def take(self, samples: object) -> None:
            time.sleep(60.0)

        def close(self) -> None:
            raise AssertionError

    told: list[str] = []
    batches = recording.Batches(Stalled(), 0.001, told.append)
    for sample in samples_of(200):
        batches.take([sample])
        time.sleep(0.001)
    batches.close()
    assert told == ["the viewer is slower than the samples: it gets only some of them"]


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
            while not (shown.exists() and shown.stat().st_size > 150_000):
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
    times, force = recordings.column(shown, "/axle/1/force/estimates", "scalars")
    assert len(times) >= 20
    assert np.isfinite(force).all()
    names, *_ = recordings.batches(shown, "/lines/all")
    assert "axle 1" in str(names.to_pydict())


def test_an_axle_that_comes_later_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rr, "GrpcSink", rr.FileSink)  # a viewer that keeps what it gets
    shown, errors = tmp_path / "shown.rrd", list[str]()
    live = LiveRecording("x", Vehicle(), [1], ["td"], str(shown))
    view = recording.LiveView(live, ["td"], errors.append)
    view.take(samples_of(50))
    view.take([sample._replace(axle=2) for sample in samples_of(50)])
    view.close()
    assert not errors
    for axle in (1, 2):
        times, force = recordings.column(shown, f"/axle/{axle}/force/estimates", "scalars")
        assert len(times) == 50
        assert np.isfinite(force).all()


def test_view_draws_the_file_of_a_live_run(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = run("live", "--replay", SERVICE, "--speed", "0", "-q", "-a", "td", "-o", ".")
    assert made.returncode == 0, made.stderr
    record = tmp_path / "service-brake.live.mcap"
    before = record.read_bytes()
    monkeypatch.setattr(cli_view, "serve_recording", lambda path: None)
    assert cli_view.command(result=record, serve=True, quiet=True, debug=False) == 0
    times, force = recordings.column(
        record.with_suffix(".rrd"), "/axle/1/force/estimates", "scalars"
    )
    assert len(times) == 2601
    assert np.isfinite(force).all()
    assert record.read_bytes() == before


def test_a_run_that_is_refused_leaves_the_lock_of_the_first_one(tmp_path: Path) -> None:
    path = tmp_path / "a.live.mcap"
    with new_file(path, False, []):
        for _ in range(2):
            with pytest.raises(UserError, match="another run"), new_file(path, True, []):
                pass
    with new_file(path, True, []):
        pass
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_an_error_while_the_file_grows_is_not_one_of_the_file(tmp_path: Path) -> None:
    """As a reader of the lines that has gone."""
    with pytest.raises(BrokenPipeError), new_file(tmp_path / "a.live.mcap", False, []):
        raise BrokenPipeError
