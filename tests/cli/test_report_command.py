"""`adhesion report` as users run it: real processes, real files."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

from trains import rows

Run = Callable[..., subprocess.CompletedProcess[str]]


def test_a_report_is_written_once_and_is_the_same_again(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    assert run("analyze", "a.csv", "-a", "td").returncode == 0
    done = run("report", "a.adhesion.mcap")
    assert (done.returncode, done.stdout) == (0, "wrote a.adhesion.html\n"), done.stderr
    page = tmp_path / "a.adhesion.html"
    first = page.read_bytes()
    assert 300_000 < len(first) < 3_000_000

    refused = run("report", "a.adhesion.mcap")
    assert refused.returncode == 1
    assert "--force" in refused.stderr
    again = run("report", "a.adhesion.mcap", "--force", "--json")
    assert json.loads(again.stdout)["outputs"] == {"html": "a.adhesion.html"}
    assert page.read_bytes() == first


def test_a_raw_log_and_another_suffix_are_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    raw = run("report", "a.csv")
    assert raw.returncode == 1
    assert "adhesion analyze a.csv" in raw.stderr
    wrong = run("report", "a.csv", "-o", "a.pdf")
    assert wrong.returncode == 2
    assert ".html" in wrong.stderr
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv"}
