"""A run on a Dask cluster: a real scheduler and two workers, of which one is killed."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from helpers import logs_of_fleet
from helpers.commands import Run

COUNT = 10
RESULTS = ("applications", "stops", "estimators", "findings")


def fleet(*arguments: Any, **more: Any) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "adhesion_cli", "fleet", *map(str, arguments)],
        capture_output=True, text=True, check=False, **more,
    )  # fmt: skip


def content(out: Path) -> dict[str, bytes]:
    return {f"{n}/{p.name}": p.read_bytes() for n in RESULTS for p in out.glob(f"{n}/*.parquet")}


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    """Address and workers of a cluster on the loopback; a worker has no nurse to start it anew."""
    pytest.importorskip("distributed")
    with socket.socket() as free, ExitStack() as stack:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        free.close()

        def start(*of: str) -> "subprocess.Popen[bytes]":
            log = stack.enter_context((tmp_path / "dask.log").open("ab"))
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *of], stdout=log, stderr=log, cwd=tmp_path
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        port = address.rpartition(":")[2]
        start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        workers = [
            start("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
            for _ in range(2)
        ]
        from distributed import Client

        with Client(address, timeout="60s", set_as_default=False) as client:
            client.wait_for_workers(2, timeout=120)
        yield address, workers


@pytest.mark.slow
def test_a_killed_worker_costs_no_log_and_changes_no_byte(
    cluster: tuple[str, list["subprocess.Popen[bytes]"]], tmp_path: Path
) -> None:
    address, workers = cluster
    logs, out = tmp_path / "logs", tmp_path / "results"
    logs_of_fleet.write(logs, COUNT)
    (logs / "none.csv").write_text("no log\n")
    run = subprocess.Popen(
        [
            sys.executable, "-m", "adhesion_cli", "fleet", "logs", "-o", str(out), "--json",
            "--scheduler", address,
        ],
        stdout=subprocess.PIPE, text=True, cwd=tmp_path,
    )  # fmt: skip
    while run.poll() is None and len(list(out.glob("logs/*.parquet"))) < 2:
        time.sleep(0.05)
    assert run.poll() is None
    os.kill(workers[0].pid, signal.SIGKILL)
    told, _ = run.communicate(timeout=500)
    counts = json.loads(told)
    assert run.returncode == 3
    assert (counts["logs"], counts["done"], counts["failed"]) == (COUNT + 1, COUNT, 1)
    local = tmp_path / "local"
    assert fleet("logs", "-o", local, "-q", cwd=tmp_path).returncode == 3
    assert content(out) == content(local)
    assert len(content(out)) == len(RESULTS) * COUNT


def test_a_scheduler_that_does_not_answer_is_an_error(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    client = distributed.Client
    brief = lambda address, **more: client(address, **{**more, "timeout": "1s"})  # noqa: E731
    monkeypatch.setattr(distributed, "Client", brief)
    logs_of_fleet.write(tmp_path, 1)
    made = run("fleet", tmp_path, "-o", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9")
    assert made.returncode == 1
    assert len(made.stderr.splitlines()) == 2
    assert made.stderr.startswith("error: ")
    assert not (tmp_path / "out").exists()


def test_without_the_extra_the_error_says_what_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("distributed", "fsspec"):
        (tmp_path / f"{name}.py").write_text("raise ImportError('not installed')\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    logs_of_fleet.write(tmp_path, 1)
    for arguments in ([tmp_path, "--scheduler", "tcp://127.0.0.1:9"], ["s3://bucket/logs"]):
        made = fleet(*arguments, "-o", tmp_path / "out")
        assert made.returncode == 1
        assert 'pip install "adhesion-cli[fleet]"' in made.stderr.splitlines()[1]
        assert "Traceback" not in made.stderr
