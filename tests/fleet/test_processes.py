"""Processes that are busy, stuck or dead when a run ends."""

import importlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from helpers import logs_of_fleet

from adhesion_cli.core.children import ChildDiedError
from adhesion_cli.fleet import work
from adhesion_cli.fleet.workers import Processes


@pytest.fixture(autouse=True)
def nothing_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """These processes analyse no log."""
    monkeypatch.setattr(work, "warm", os.getpid)


def test_the_end_leaves_no_thread_and_no_process(tmp_path: Path) -> None:
    before = set(threading.enumerate())
    processes, mark = Processes(2), tmp_path / "begun"
    try:
        assert processes.submit(os.getpid).result() != os.getpid()
        waits = processes.submit(logs_of_fleet.stuck, str(mark))
        while not mark.exists():
            time.sleep(0.01)
        dies = processes.submit(os.abort)
        assert isinstance(dies.exception(), ChildDiedError)
    finally:
        begin = time.monotonic()
        processes.close()
    assert time.monotonic() - begin < 5.0
    assert isinstance(waits.exception(0.0), ChildDiedError)
    assert set(threading.enumerate()) <= before
    assert not any(child.is_usable for child in processes._started)


def test_an_error_comes_back_and_the_process_works_on() -> None:
    processes = Processes(1)
    try:
        first = processes.submit(os.getpid).result()
        with pytest.raises(FileNotFoundError):
            processes.submit(os.stat, "/no such file").result()
        assert processes.submit(os.getpid).result() == first
    finally:
        processes.close()


def test_a_process_does_not_load_pandas_which_arrow_would() -> None:
    pytest.importorskip("pandas")
    processes = Processes(1)
    try:
        with pytest.raises(ModuleNotFoundError):
            processes.submit(importlib.import_module, "pandas").result()
    finally:
        processes.close()


@pytest.mark.slow
def test_a_run_with_failed_logs_ends_without_a_word(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for i in range(4):
        (logs / f"none-{i}.csv").write_text(f"no log {i}\n")
    for _ in range(5):
        made = subprocess.run(
            [sys.executable, "-m", "adhesion_cli", "fleet", logs, "-o", tmp_path / "out",
             "--workers", "2", "-q", "--json"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert (made.returncode, made.stderr) == (3, "")
