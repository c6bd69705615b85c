"""Runs that are ended, and processes that die: nothing is lost but what was in work."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers import logs_of_fleet
from pyarrow import parquet

pytestmark = pytest.mark.slow
TABLES = ("applications", "stops", "estimators", "findings", "logs")
COUNT = 24


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("faults") / "logs"
    logs_of_fleet.write(folder, COUNT)
    return folder


def command(logs: Path, out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "adhesion_cli", "fleet", str(logs), "-o", str(out), *more]


@contextmanager
def running(logs: Path, out: Path, *more: str) -> Iterator["subprocess.Popen[str]"]:
    """A run in work: some logs are done, others are not."""
    run = subprocess.Popen(
        command(logs, out, *more), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        while run.poll() is None and len(list(out.glob("logs/*.parquet"))) < 2:
            time.sleep(0.05)
        assert run.poll() is None
        yield run
    finally:
        run.kill()
        run.communicate()


def children(of: int) -> list[int]:
    """The workers of a run: its children that load this package."""
    found = []
    for task in Path(f"/proc/{of}/task").iterdir():
        found += [int(x) for x in (task / "children").read_text().split()]
    return [
        pid
        for pid in found
        if b"children import serve" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]


def alive(pid: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


def content(out: Path) -> dict[str, bytes]:
    """All that is promised to be the same bytes."""
    return {
        f"{name}/{path.name}": path.read_bytes()
        for name in TABLES[:-1]
        for path in out.glob(f"{name}/*.parquet")
    }


def whole(out: Path) -> bool:
    """Whether all files can be read, and each log that is done has all its tables."""
    names = {name: {p.name for p in out.glob(f"{name}/*.parquet")} for name in TABLES}
    for path in out.glob("*/*.parquet"):
        parquet.read_table(path)
    return all(names["logs"] <= names[name] for name in TABLES)


@pytest.fixture(scope="module")
def expected(logs: Path) -> dict[str, bytes]:
    out = logs.parent / "one"
    made = subprocess.run(command(logs, out, "--workers", "1", "-q"), check=False)
    assert made.returncode == 0
    found = content(out)
    assert len(found) == len(TABLES[:-1]) * COUNT
    return found


def test_the_number_of_workers_changes_no_byte(logs: Path, expected: dict[str, bytes]) -> None:
    out = logs.parent / "three"
    subprocess.run(command(logs, out, "--workers", "3", "-q"), check=True)
    assert content(out) == expected


def test_a_killed_run_loses_only_what_was_in_work(logs: Path, expected: dict[str, bytes]) -> None:
    out = logs.parent / "killed"
    with running(logs, out, "--workers", "2") as run:
        workers = children(run.pid)
        run.kill()
        run.wait()
    assert workers
    done = {p.name for p in out.glob("logs/*.parquet")}
    assert whole(out)
    assert 2 <= len(done) < COUNT
    for _ in range(100):
        if not any(map(alive, workers)):
            break
        time.sleep(0.1)
    assert not any(map(alive, workers))  # they end with the run
    again = subprocess.run(command(logs, out, "--json"), check=True, capture_output=True, text=True)
    counts = json.loads(again.stdout)
    assert (counts["skipped"], counts["done"]) == (len(done), COUNT - len(done))
    assert content(out) == expected


def test_an_interrupt_ends_the_run_with_130(logs: Path) -> None:
    out = logs.parent / "interrupted"
    with running(logs, out, "--workers", "2") as run:
        workers = children(run.pid)
        for pid in (run.pid, *workers):  # as a terminal does
            os.kill(pid, signal.SIGINT)
        _, told = run.communicate(timeout=60)
        assert run.returncode == 130
        assert told.splitlines() == [
            "error: interrupted", "hint: nothing was left half-written"
        ]  # fmt: skip
    assert whole(out)
    assert not any(map(alive, workers))
    assert not list(out.glob("*/.*"))


def test_a_killed_worker_costs_no_log(logs: Path, expected: dict[str, bytes]) -> None:
    out = logs.parent / "worker"
    with running(logs, out, "--workers", "2", "--json") as run:
        os.kill(children(run.pid)[0], signal.SIGKILL)
        told, _ = run.communicate(timeout=300)
    counts = json.loads(told)
    assert (run.returncode, counts["done"], counts["failed"]) == (0, COUNT, 0)
    assert content(out) == expected


def test_what_starts_first_compiles_all_that_logs_need(tmp_path: Path) -> None:
    code = """
import sys
from functools import partial
from pathlib import Path
from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core import bundled
from adhesion_cli.fleet import work
work.warm()
cache = Path(sys.argv[1])
before = {path.name for path in cache.glob("**/*.nbc")}
for name in ("service-brake.csv", "low-adhesion.csv"):
    log = bundled.folder("sample_logs") / name
    summarise(analyze(log, settings.load(folder=False), train_speed=True), {})
assert before
print(sorted({path.name for path in cache.glob("**/*.nbc")} - before))
"""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    made = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True, text=True, check=False, env=environment,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    assert made.stdout.strip() == "[]"
