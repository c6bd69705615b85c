"""Logs on URLs: an S3 server on the loopback, read by the client that users have."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers import logs_of_fleet, s3_server
from helpers.commands import Run
from pyarrow import dataset

pytestmark = pytest.mark.slow


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[s3_server.Objects]:
    """The objects of a server whose address the environment has."""
    s3fs = pytest.importorskip("s3fs")
    objects: s3_server.Objects = {}
    with s3_server.serving(objects) as address:
        for name, value in {
            "AWS_ENDPOINT_URL": address, "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test", "AWS_DEFAULT_REGION": "us-east-1",
        }.items():  # fmt: skip
            monkeypatch.setenv(name, value)
        s3fs.S3FileSystem.clear_instance_cache()  # a client keeps the address it began with
        yield objects
        s3fs.S3FileSystem.clear_instance_cache()


def test_logs_of_a_bucket_give_what_their_files_give(
    bucket: s3_server.Objects, run: Run, tmp_path: Path
) -> None:
    for path in logs_of_fleet.write(tmp_path / "logs", 2):
        bucket["trains", f"day 1/{path.name}"] = path.read_bytes()
    for name in ("none.csv", "read.me"):
        bucket["trains", f"day 1/{name}"] = b"no log\n"

    made = run("fleet", "s3://trains/day 1", "-o", "remote", "--json", "--workers", "1")
    counts = json.loads(made.stdout)
    assert made.returncode == 3, made.stderr
    assert (counts["logs"], counts["done"], counts["failed"]) == (3, 2, 1)
    again = run("fleet", "s3://trains/*/stop-*.csv", "-o", "remote", "--json")
    assert json.loads(again.stdout)["skipped"] == 2
    assert run("fleet", "logs", "-o", "local", "-q").returncode == 0
    rows = {}
    for results in ("remote", "local"):
        table = dataset.dataset(tmp_path / results / "applications").to_table()
        found = table.drop_columns(["log"]).to_pylist()
        rows[results] = sorted(found, key=lambda row: row["sha256"])
    assert rows["remote"] == rows["local"]
    logs = dataset.dataset(tmp_path / "remote" / "logs").to_table().to_pylist()
    (failed,) = [row for row in logs if row["status"] == "error"]
    assert failed["log"] == "s3://trains/day 1/none.csv"
    assert failed["log"] in failed["error"]
    lost = run("fleet", "s3://trains/day 7", "-o", "none")
    assert lost.returncode == 1
    assert lost.stderr.startswith("error: ")
    assert len(lost.stderr.splitlines()) == 2
