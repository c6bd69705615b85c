"""`adhesion fleet` as a user runs it."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers import logs_of_fleet

Run = Callable[..., "subprocess.CompletedProcess[str]"]
TABLES = ("applications", "estimators", "findings", "logs")


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
