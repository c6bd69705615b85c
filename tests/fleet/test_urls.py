"""Logs on URLs: a real S3 server on the loopback."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers import logs_of_fleet
from pyarrow import dataset

pytestmark = pytest.mark.slow


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A bucket `trains` of a server whose address the environment has."""
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer("127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}", "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    yield "s3://trains"
    server.stop()


def test_logs_of_a_bucket_give_what_their_files_give(bucket: str, tmp_path: Path) -> None:
    import s3fs

    paths = logs_of_fleet.write(tmp_path / "logs", 2)
    system = s3fs.S3FileSystem()
    system.mkdir("trains")
    for path in paths:
        system.put_file(str(path), f"trains/day 1/{path.name}")
    system.pipe_file("trains/day 1/none.csv", b"no log\n")
    system.pipe_file("trains/day 1/read.me", b"no log\n")

    def fleet(*arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-m", "adhesion_cli", "fleet", *arguments],
            capture_output=True, text=True, check=False, cwd=tmp_path,
        )  # fmt: skip

    made = fleet(f"{bucket}/day 1", "-o", "remote", "--json", "--workers", "1")
    counts = json.loads(made.stdout)
    assert made.returncode == 3, made.stderr
    assert (counts["logs"], counts["done"], counts["failed"]) == (3, 2, 1)
    again = fleet(f"{bucket}/*/stop-*.csv", "-o", "remote", "--json")
    assert json.loads(again.stdout)["skipped"] == 2
    assert fleet("logs", "-o", "local", "-q").returncode == 0
    rows = {}
    for of in ("remote", "local"):
        table = dataset.dataset(tmp_path / of / "applications").to_table().drop_columns(["log"])
        rows[of] = sorted(table.to_pylist(), key=lambda row: row["sha256"])
    assert rows["remote"] == rows["local"]
    failed = [
        row for row in dataset.dataset(tmp_path / "remote" / "logs").to_table().to_pylist()
        if row["status"] == "error"
    ]  # fmt: skip
    assert [row["log"] for row in failed] == [f"{bucket}/day 1/none.csv"]
    assert f"{bucket}/day 1/none.csv" in failed[0]["error"]
    lost = fleet(f"{bucket}/day 7", "-o", "none")
    assert lost.returncode == 1
    assert lost.stderr.startswith("error: ")
    assert len(lost.stderr.splitlines()) == 2
