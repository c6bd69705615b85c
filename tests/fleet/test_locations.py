"""Which files are logs of a fleet."""

import os
from pathlib import Path

import pytest

from adhesion_cli.core.errors import UserError
from adhesion_cli.fleet.locations import find


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in (
        "logs/b.csv", "logs/a.mcap", "logs/z.mf4", "logs/day 2/c.CSV", "logs/day 2/d.csv.gz",
        "logs/read.me",
        "logs/a.adhesion.mcap", "logs/.hidden/e.csv", "logs/.adhesion-12.part", "logs/odd.out",
        "logs/out/logs/x.csv", "logs/out/applications/x.csv", "logs/out/findings/x.csv",
        "logs/out/estimators/x.csv", "logs/out/stops/x.parquet",
    ):  # fmt: skip
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path


def names(*named: str) -> list[str]:
    return [log.name.replace(os.sep, "/") for log in find(named)]


def test_a_folder_gives_the_logs_below_it_but_no_results(tree: Path) -> None:
    assert names("logs") == [
        "logs/a.mcap", "logs/b.csv", "logs/z.mf4", "logs/day 2/c.CSV", "logs/day 2/d.csv.gz"
    ]  # fmt: skip


def test_a_glob_gives_what_it_matches_but_no_results(tree: Path) -> None:
    assert names("logs/*.mcap") == ["logs/a.mcap"]
    assert names("logs/day*") == ["logs/day 2/c.CSV", "logs/day 2/d.csv.gz"]
    assert "logs/out/logs/x.csv" in names("logs/**/*.csv")


def test_a_file_is_taken_as_named_and_each_only_once(tree: Path) -> None:
    assert names("logs/odd.out", "logs/b.csv", str(tree / "logs" / "b.csv")) == [
        "logs/odd.out", "logs/b.csv"
    ]  # fmt: skip
    assert find(["logs/b.csv"])[0].place == os.path.join(os.getcwd(), "logs", "b.csv")


@pytest.mark.parametrize("name", ["none.csv", "logs/*.mf9", "empty", "nofs://bucket/x.csv"])
def test_a_name_without_logs_is_an_error(tree: Path, name: str) -> None:
    (tree / "empty").mkdir()
    with pytest.raises(UserError, match=name.partition("*")[0]) as error:
        find(["logs", name])
    assert error.value.hint


@pytest.mark.parametrize("suffix", ["csv.xz", "txt.bz2", "log", "log.gz", "lvm", "mat", "LOG"])
def test_a_folder_gives_each_format_that_is_read(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"a.{suffix}").touch()
    assert [Path(log.name).name for log in find([str(tmp_path)])] == [f"a.{suffix}"]
