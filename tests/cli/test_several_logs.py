"""Several logs in one run: the good ones are written, the failed ones are listed."""

import json
from pathlib import Path

import pytest
from helpers.trains import rows

from adhesion_cli.cli.app import app
from adhesion_cli.core.errors import UserError


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two good logs around one without a row."""
    monkeypatch.chdir(tmp_path)
    for name, content in {"a.csv": rows(), "bad.csv": "time [s]\n", "c.csv": rows()}.items():
        Path(name).write_text(content)


ANALYZE = ["analyze", "-a", "td"]
EVERY = ["a.csv", "bad.csv", "c.csv"]
SETS = {f"{stem}.adhesion.{kind}" for stem in "ac" for kind in ("mcap", "rrd", "sha256")}


def written() -> set[str]:
    return {path.name for path in Path().iterdir()} - set(EVERY)


def test_the_good_logs_are_written_and_the_failed_one_is_listed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert app([*ANALYZE, *EVERY], standalone_mode=False) == 3
    shown = capsys.readouterr()
    assert "not analysed: bad.csv\n  error: bad.csv: " in shown.err
    assert "\n  hint: " in shown.err
    assert "bad.csv" not in shown.out
    assert written() == SETS


def test_what_logs_have_in_common_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    app([*ANALYZE, "a.csv", "c.csv"], standalone_mode=False)
    shown = capsys.readouterr()
    assert shown.out.count("One row per stop") == shown.out.count("Vehicle:") == 1
    rows = [line.split()[0] for line in shown.out.splitlines() if line.startswith(("a.csv", "c."))]
    assert rows == ["a.csv", "c.csv"]
    assert "vehicle-default  all 2 logs" in shown.err
    assert shown.err.count("vehicle-default") == 1


def test_a_failed_log_is_an_entry_of_the_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert app([*ANALYZE, *EVERY, "--json"], standalone_mode=False) == 3
    shown = capsys.readouterr()
    first, failed, last = json.loads(shown.out)["results"]
    assert set(failed) == {"log", "error", "hint"}
    assert failed["log"] == {"path": "bad.csv"}
    assert all((failed["error"], failed["hint"]))
    assert [one["log"]["path"] for one in (first, last)] == ["a.csv", "c.csv"]
    assert not shown.err
    assert written() == SETS


@pytest.mark.parametrize("stated", [[*EVERY, "--strict"], ["bad.csv", "missing.csv"]])
def test_strict_or_no_good_log_writes_nothing(stated: list[str]) -> None:
    with pytest.raises(UserError, match=r"bad\.csv") as raised:
        app([*ANALYZE, *stated], standalone_mode=False)
    assert raised.value.code == 1
    assert not written()
