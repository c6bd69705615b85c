"""`adhesion report` as users run it: real processes, real files."""

import csv
import hashlib
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import openpyxl
from helpers.trains import rows
from pyarrow import parquet

from adhesion_cli.core import bundled

SAMPLE = bundled.folder("sample_logs") / bundled.SAMPLE
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


def test_analyze_writes_report_and_table_as_one_set(run: Run, tmp_path: Path) -> None:
    (tmp_path / "=a;b.csv").write_text(rows())
    options = ("-a", "td", "--report", "--table", "t.csv", "--json")
    done = run("analyze", "=a;b.csv", *options)
    assert done.returncode == 0, done.stderr
    (entry,) = json.loads(done.stdout)["results"]
    names = {"mcap", "rrd", "html"}
    assert entry["outputs"] == {k: f"=a;b.adhesion.{k}" for k in names} | {"csv": "t.csv"}
    told = (tmp_path / "=a;b.adhesion.sha256").read_text().splitlines()[1:]
    for line in told:
        digest, name = line.split("  ")
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() == digest
    assert len(told) == 4

    page = (tmp_path / "=a;b.adhesion.html").read_bytes()
    again = run("report", "=a;b.adhesion.mcap", "-o", "again.html")
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "again.html").read_bytes() == page

    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    (axle,) = entry["axles"]
    (one,) = axle["applications"]
    assert row["log"] == "'=a;b.csv"  # no formula, and one cell
    assert (row["sha256"], row["axle"]) == (entry["log"]["sha256"], "1")
    assert float(row["force_n_mean"]) == one["force_n"]["mean"]
    assert row["utilisation"] == ""

    refused = run("analyze", "=a;b.csv", "-a", "td", "-o", "new", "--table", "t.csv")
    assert refused.returncode == 1
    assert "t.csv" in refused.stderr
    assert not (tmp_path / "new").exists()


def test_a_table_of_several_logs_is_parquet_with_units(run: Run, tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(rows())
    (tmp_path / "c.csv").write_text("no log")
    done = run("analyze", "c.csv", "b.csv", "a.csv", "-a", "td", "--table", "t.parquet")
    assert done.returncode == 3, done.stderr
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table["log"].to_pylist() == ["b.csv", "a.csv"]
    assert table.schema.field("force_n_mean").metadata == {b"unit": b"N"}
    assert "t.parquet" in (tmp_path / "b.adhesion.sha256").read_text()


def test_a_workbook_has_a_sheet_per_table(run: Run, tmp_path: Path) -> None:
    (tmp_path / "=a.csv").write_text(rows())
    done = run("analyze", "=a.csv", "-a", "td", "--table", "t.xlsx", "--json")
    assert done.returncode == 0, done.stderr
    (entry,) = json.loads(done.stdout)["results"]
    book = openpyxl.load_workbook(tmp_path / "t.xlsx")
    sheets = ["applications", "stops", "slides", "estimators", "findings", "logs"]
    assert book.sheetnames == sheets
    slides = [x for a in entry["axles"] for o in a["applications"] for x in o["slide_list"]]
    slide_heads, *slide_rows = book["slides"].iter_rows(values_only=True)
    assert "position_km [km]" in slide_heads
    assert len(slide_rows) == len(slides)
    heads, row = book["applications"].iter_rows(values_only=True)
    force = entry["axles"][0]["applications"][0]["force_n"]["mean"]
    assert row[0] == "=a.csv"
    assert row[heads.index("force_n_mean [N]")] == force
    codes = [code.value for code in book["findings"]["C"][1:]]
    assert codes == [finding["code"] for finding in entry["findings"]]


def test_what_a_table_cannot_be_is_refused_before_the_work(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    for wrong in ("--table t.xls", "--table t"):
        done = run("analyze", "a.csv", *wrong.split())
        assert done.returncode == 2, wrong
        assert "hint:" in done.stderr
    done = run("analyze", "a.csv", "--table", "a.csv", "--force")
    assert done.returncode == 1
    assert (tmp_path / "a.csv").read_text() == rows()


def test_report_takes_no_file_name(run: Run, tmp_path: Path) -> None:
    for arguments in (
        ["analyze", str(SAMPLE), "--report", "page.html"],
        ["analyze", "--report", "page", str(SAMPLE)],
        ["stops", str(SAMPLE), "--report", "page.html", "-o", "out"],
    ):
        refused = run(*arguments)
        assert refused.returncode == 2
        name = next(x for x in arguments if x.startswith("page"))
        assert f"error: --report takes no file name: {name} stands" in refused.stderr
        assert "-o DIR states the folder" in refused.stderr
        assert not [*tmp_path.glob("*.adhesion.*")]
    refused = run("analyze", str(SAMPLE), "--report=page.html")
    assert refused.returncode == 2
    assert "`adhesion analyze --help`" in refused.stderr
