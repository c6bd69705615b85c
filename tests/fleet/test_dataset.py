"""Which logs of a folder of results are done."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from adhesion_cli.core.summary import FailedLog
from adhesion_cli.fleet.dataset import TABLES, Dataset, KeptTables
from adhesion_cli.results import tables

OTHERS = TABLES[:-1]


def empty(path: Path) -> None:
    path.write_bytes(b"")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 4
    path.write_bytes(data)


def of_another_log(path: Path) -> None:
    path.write_bytes(next(path.parent.glob("b-*")).read_bytes())


DAMAGES = [empty, cut, flip, Path.unlink, of_another_log]


@pytest.fixture
def kept(tmp_path: Path) -> Dataset:
    """Of two logs, a and b."""
    dataset = Dataset(tmp_path, "ab", "1")
    dataset.prepare({})
    row = replace(tables.log_row(FailedLog("x", "", "")), status="ok", error=None, seconds=1.0)
    logs = [
        KeptTables(key, (key,), row, {name: f"{name} {key} {'.' * 99}".encode() for name in OTHERS})
        for key in "ab"
    ]
    dataset.write(logs)
    assert list(dataset.finished_logs()) == ["a", "b"]
    return dataset


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("table", OTHERS)
def test_a_log_is_done_where_all_its_tables_are_whole(
    kept: Dataset, tmp_path: Path, table: str, damage: Callable[[Path], None]
) -> None:
    damage(tmp_path / table / "a-ab-1.parquet")
    assert list(kept.finished_logs()) == ["b"]


@pytest.mark.parametrize("damage", DAMAGES[:4])
def test_a_damaged_row_is_none(
    kept: Dataset, tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    damage(tmp_path / "logs" / "a-ab-1.parquet")
    assert list(kept.finished_logs()) == ["b"]


def test_a_new_name_leaves_a_log_done(kept: Dataset) -> None:
    kept.write([KeptTables("a", ("a", "c"), kept.finished_logs()["a"][0], {})])
    assert [row.log for row in kept.finished_logs()["a"]] == ["a", "c"]
