"""`adhesion fleet` as a user runs it."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers import logs_of_fleet
from helpers.forked import Forked

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module", autouse=True)
def kept_processes() -> Iterator[None]:
    with logs_of_fleet.kept_processes():
        yield


def test_counts_exit_code_and_summary(run: Run, tmp_path: Path) -> None:
    logs_of_fleet.write(tmp_path / "logs", 2)
    (tmp_path / "logs" / "none.csv").write_text("no log\n")
    made = run("fleet", "logs", "--workers", "2", "--json", "-a", "td")
    document = json.loads(made.stdout)
    assert document.pop("seconds") > 0.0
    assert document == {
        "schema": "adhesion.fleet/1", "logs": 3, "done": 2, "skipped": 0, "failed": 1, "lossy": 0
    }  # fmt: skip
    assert made.returncode == 3
    shown = run("fleet", "--summary", "fleet-results")
    assert shown.returncode == 0
    assert max(map(len, shown.stdout.splitlines())) <= 100
    summary = json.loads(run("fleet", "--summary", "fleet-results", "--json").stdout)
    assert summary["schema"] == "adhesion.fleet-summary/1"
    assert summary["logs"] == {"ok": 2, "damaged": 0, "error": 1}
    assert summary["by_speed"][0]["applications"] == summary["applications"] == 2
    assert run("report", "fleet-results").returncode == 0
    page = (tmp_path / "fleet-results.html").read_text("utf-8")
    assert shown.stdout.splitlines()[0] in page  # logs and brake applications
    for cell in ("By day", "not stated", "none.csv"):
        assert cell in page
    assert run("report", "fleet-results", "other.mcap", "-o", "a.html").returncode == 2
    assert run("report", "logs").stderr.startswith("error: logs: holds no results of a fleet")
    assert not (tmp_path / "logs.html").exists()


def test_the_exit_code_is_that_of_analyze(run: Run, tmp_path: Path) -> None:
    good, damaged = logs_of_fleet.write(tmp_path, 2)
    damaged.write_bytes(damaged.read_bytes() + b"no number,0,0\n" * 3)
    for log, lossy in ((good, 0), (damaged, 1)):
        code = run("analyze", log.name, "-a", "td", "-q").returncode
        assert code == 3 * lossy
        for skipped in (0, 1):  # the second run finds the result
            made = run("fleet", log.name, "-a", "td", "--json", "--workers", "1")
            counts = json.loads(made.stdout)
            assert made.returncode == code
            assert [counts[k] for k in ("skipped", "failed", "lossy")] == [skipped, 0, lossy]


def test_a_summary_of_what_is_no_result_and_one_after_a_run(run: Run, tmp_path: Path) -> None:
    logs_of_fleet.write(tmp_path / "logs", 1)
    assert run("fleet", "--summary", "logs").returncode == 1
    assert run("fleet", "--summary", "a", "b").returncode == 2
    both = run("fleet", "logs", "-o", "results", "--summary", "-a", "td")
    assert both.returncode == 0
    assert run("fleet", "--summary", "results").stdout in both.stdout


def test_damaged_results_are_reported_and_made_again(run: Run, tmp_path: Path) -> None:
    logs_of_fleet.write(tmp_path / "logs", 2)
    fleet = "fleet", "logs", "-o", "results", "-a", "td", "--workers", "1", "--json"
    assert json.loads(run(*fleet).stdout)["done"] == 2
    before = {path: path.read_bytes() for path in (tmp_path / "results").glob("estimators/*")}
    next(iter(before)).write_bytes(b"")
    shown = run("fleet", "--summary", "results")
    assert shown.returncode == 3
    assert "fleet-results-damaged" in shown.stderr
    assert "Damaged or missing results:\n  logs/stop-00" in shown.stdout
    assert run("report", "results").returncode == 3
    again = json.loads(run(*fleet).stdout)
    assert (again["done"], again["skipped"]) == (1, 1)
    assert {path: path.read_bytes() for path in before} == before
    assert run("fleet", "--summary", "results").returncode == 0


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with a name")
def test_a_pipe_is_a_failed_log_and_an_interrupt_ends_what_is_read(
    run: Run, tmp_path: Path
) -> None:
    """Neither waits for what never ends."""
    logs_of_fleet.write(tmp_path / "logs", 1)
    os.mkfifo(tmp_path / "logs" / "pipe.csv")
    made = run("fleet", "logs", "/dev/zero", "--json", "-a", "td", "--workers", "1")
    counts = json.loads(made.stdout)
    assert (made.returncode, counts["done"], counts["failed"]) == (3, 1, 2)
    assert "pipe.csv: a pipe or a device, not a file" in made.stderr
    with (tmp_path / "large.csv").open("wb") as large:
        large.truncate(1 << 40)
    with Forked(tmp_path, ["fleet", "large.csv", "-o", "out"], stderr=subprocess.PIPE) as process:
        while not list(tmp_path.glob("out/settings/*.json")):
            time.sleep(0.02)
        time.sleep(0.3)  # it hashes now
        begin = time.monotonic()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert (process.returncode, time.monotonic() - begin < 20.0) == (130, True)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["none.csv"], 1),
        (["empty", "--workers", "2", "--scheduler", "tcp://localhost:1"], 2),
        (["empty", "--set", "vehicle.fricton=1"], 2),
        (["empty", "-a", "nesso"], 2),
    ],
)
def test_wrong_arguments_write_nothing(
    run: Run, tmp_path: Path, arguments: list[str], code: int
) -> None:
    (tmp_path / "empty").mkdir()
    made = run("fleet", *arguments, "-o", "results")
    assert made.returncode == code
    assert made.stderr.startswith("error: ")
    assert "\nhint: " in made.stderr
    assert not (tmp_path / "results").exists()


def test_channels_of_one_logger_do_not_fail_the_logs_of_another(run: Run, tmp_path: Path) -> None:
    own, other = logs_of_fleet.write(tmp_path, 2)
    own.write_text(own.read_text().replace("wheel_speed [km/h]", "Kanal A"))
    (tmp_path / "own.toml").write_text(
        "[channels]\nwheel_speed = {channel = 'Kanal A', unit = 'km/h'}\n"
    )
    fleet = "fleet", own.name, other.name, "-c", "own.toml", "-a", "td", "--workers", "1"
    made = run(*fleet, "--json")
    assert (json.loads(made.stdout)["done"], made.returncode) == (2, 3)
    shown = run("fleet", "--summary", "fleet-results", "--json").stdout
    (finding,) = json.loads(shown)["findings"]
    assert (finding["code"], finding["logs"]) == ("channels-of-another-log", 1)
    assert other.name in finding["example"]
    (tmp_path / "own.toml").write_text(
        "[channels]\nwheel_speed = {channel = 'Kanal A', unit = 'km/h'}\n"
        "pressure = {channel = 'BC 1'}\n"
    )
    made = run(*fleet)  # of a log that has one of them, the other is wrong
    assert made.returncode == 3
    assert "unknown channel 'BC 1'" in made.stderr
    assert "run the logs of each logger by themselves, each with its own -c" in made.stderr
