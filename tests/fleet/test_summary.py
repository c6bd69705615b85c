"""What the results of a fleet show together."""

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from adhesion_cli.cli.fleet import _text
from adhesion_cli.core.errors import UserError
from adhesion_cli.fleet import summary_tables
from adhesion_cli.fleet.dataset import Dataset, Kept
from adhesion_cli.fleet.summary import summarised
from adhesion_cli.fleet.work import Job, _of_run, row
from adhesion_cli.results import tables
from adhesion_cli.results.report.page import write_tables

JOB = Job({"vehicle": {"friction": 0.25}}, False, (), (), (None, None), "1.2", "abcd")


def application(mu: float | None, from_mps: float, **slide: float) -> dict[str, Any]:
    measured = mu and {"mean": mu, "mean_u95": 0.01, "max": mu, "max_u95": 0.01}
    return {
        "start_s": 2.0, "end_s": 12.0, "from_mps": from_mps, "to_mps": 0.0, "force_n": None,
        "coefficient": measured, "slides": 0, "utilisation_ci": None, **slide,
    }  # fmt: skip


SLID = {"slides": 1, "slide_s": 3.0, "slide_distance_m": 50.0, "max_slip": 0.2}
WORST = {"slides": 1, "slide_s": 2.0, "slide_distance_m": 30.0, "max_slip": 1.0}


def log(name: str, day: str | None, *found: dict[str, Any], codes: tuple[str, ...] = ()) -> Any:
    start = day and f"{day}T08:00:00Z"
    severity = {"gap": "warning", "vehicle-default": "warning", "csv-gzip-damaged": "error"}
    return {
        "log": {"path": name, "sha256": f"{name}0", "start": start},
        "axles": [{"axle": 1, "applications": found, "estimators": []}],
        "findings": [{"code": code, "severity": severity[code]} for code in codes],
    }


def write(folder: Path, entry: dict[str, Any], job: Job = JOB, key: str = "") -> None:
    kept = Dataset(folder, job.settings, job.version)
    kept.prepare(job.depends())
    files = {}
    if "axles" in entry:
        for name in ("applications", "estimators", "findings"):
            files[name] = tables.packed(_of_run(getattr(tables, name)([entry]), job))
    of = entry["log"]
    kept.write([Kept(key or of["sha256"], (of["path"],), row(entry, job, 1.0), files)])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path, log("a", "2026-03-01", application(0.10, 20.0), application(0.12, 24.0)))
    write(tmp_path, log("b", "2026-03-02", application(0.04, 40.0, **SLID), codes=("gap",)))
    write(
        tmp_path,
        log("c", None, application(None, 10.0, **WORST), codes=("csv-gzip-damaged", "gap")),
    )
    write(tmp_path, log("d", "2026-03-02", codes=("vehicle-default",)))
    bad = {"log": {"path": "e", "sha256": "ee"}, "error": "no pressure", "hint": "name it"}
    write(tmp_path, bad)
    return tmp_path


def test_logs_are_counted_by_their_status(folder: Path) -> None:
    found = summarised(folder)
    assert found["logs"] == {"ok": 3, "damaged": 1, "error": 1}
    assert found["applications"] == 4
    assert found["failed"] == [{"log": "e", "error": "no pressure", "hint": "name it"}]
    assert found["damaged"] == ["c"]


def test_the_coefficient_is_distributed_by_the_mean_speed(folder: Path) -> None:
    slow, middle = summarised(folder)["by_speed"]
    assert (slow["from_kmh"], slow["to_kmh"], slow["applications"]) == (0.0, 40.0, 2)
    assert (middle["from_kmh"], middle["applications"], middle["with_slides"]) == (40.0, 2, 1)
    assert middle["median"] == pytest.approx(0.08)
    assert middle["median_with_slides"] == pytest.approx(0.04)
    assert slow["median"] == pytest.approx(0.10)  # the locked wheel has no force


def test_days_and_vehicles_are_apart(folder: Path) -> None:
    other = JOB._replace(stated={}, settings="ef01")
    write(folder, log("a", "2026-03-01", application(0.20, 20.0)), other)
    found = summarised(folder)
    assert [(r["day"], r["applications"]) for r in found["by_day"]] == [
        ("2026-03-01", 3), ("2026-03-02", 1), ("unknown", 1)
    ]  # fmt: skip
    assert [(r["settings"], r["stated"], r["applications"]) for r in found["by_settings"]] == [
        ("abcd", "friction 0.25", 4), ("ef01", "default vehicle", 1)
    ]  # fmt: skip


def test_the_worst_slide_is_first_though_its_force_is_not_known(folder: Path) -> None:
    assert [row["log"] for row in summarised(folder)["worst_slides"]] == ["c", "b"]


def test_findings_on_the_data_count_logs(folder: Path) -> None:
    assert [(r["code"], r["logs"], r["example"]) for r in summarised(folder)["findings"]] == [
        ("csv-gzip-damaged", 1, "c"), ("gap", 2, "b")
    ]  # fmt: skip


def test_of_one_log_only_the_newest_result_counts(folder: Path) -> None:
    newer = JOB._replace(version="1.10")
    write(folder, log("a", "2026-03-01", application(0.30, 20.0)), newer)
    changed = log("b", "2026-03-02", application(0.05, 40.0))
    changed["log"]["sha256"] = "bb"
    write(folder, changed)
    old = folder / "logs" / "b0-abcd-1.2.parquet"
    os.utime(old, (1, 1))
    found = summarised(folder)
    assert found["applications"] == 3
    assert found["by_speed"][-1]["with_slides"] == 0


def test_only_failed_logs_make_a_summary(tmp_path: Path) -> None:
    write(tmp_path, {"log": {"path": "e", "sha256": "ee"}, "error": "none", "hint": ""})
    found = summarised(tmp_path)
    assert (found["logs"]["error"], found["applications"], found["by_speed"]) == (1, 0, [])


def test_the_text_names_every_log_to_look_at(folder: Path) -> None:
    write(folder, log("a" * 120, "2026-03-03", application(0.02, 30.0, **SLID)))
    for i in range(12):
        bad = {"log": {"path": f"f{i}", "sha256": f"f{i}"}, "error": "none", "hint": ""}
        write(folder, bad)
    text = _text(summarised(folder))
    assert max(map(len, text.splitlines())) <= 100
    failed = text.partition("Failed logs:")[2].partition("Damaged logs:")
    assert "  e\n" in failed[0]
    assert "3 more" in failed[0]
    assert failed[2].split() == ["c"]


def test_groups_that_can_be_compared_have_a_figure(folder: Path, tmp_path: Path) -> None:
    write(folder, log("g", "2026-03-04", application(0.3, 20.0)), JOB._replace(settings="ef01"))
    figures = {of.title.split()[1]: of.figure for of in summary_tables.tables(summarised(folder))}
    assert [title for title, of in figures.items() if of] == ["adhesion", "settings", "day"]
    slow, middle = figures["adhesion"].bars
    assert (slow.begin, slow.end, slow.number) == (0.0, 40.0, 3)
    assert (middle.name, middle.middle, middle.slid) == (
        "40 to 80", pytest.approx(0.08), pytest.approx(0.04)
    )  # fmt: skip
    days = figures["day"].bars
    assert [bar.name for bar in days] == ["2026-03-01", "2026-03-02", "2026-03-04"]
    first = 1e-3 * days[0].begin  # midnight in UTC
    assert datetime.fromtimestamp(first, UTC).isoformat() == "2026-03-01T00:00:00+00:00"
    page, again = tmp_path / "a.html", tmp_path / "b.html"
    for path in (page, again):
        write_tables(path, summary_tables.campaign("a", summarised(folder)))
    assert page.read_bytes() == again.read_bytes()
    assert page.read_text("utf-8").count('class="figure"') == 3


def test_the_page_says_how_many_slid_and_which_logs_are_doubtful(folder: Path) -> None:
    found = summarised(folder)
    assert (found["with_slides"], found["in_doubt"]) == (2, 1)
    assert [(r["log"], r["code"]) for r in found["to_check"]] == [("c", "csv-gzip-damaged")]
    of = summary_tables.campaign("x", found)
    assert "2 of 4" in of.verdict
    assert set(of.codes) == {"gap", "csv-gzip-damaged"}
    assert "1.2" in of.about["Evaluated by"]
    write_tables(folder / "x.html", of)
    text = (folder / "x.html").read_text("utf-8")
    for code in of.codes:
        assert f'href="#finding-{code}"' in text
        assert f'id="finding-{code}"' in text
    worst = next(t for t in of.tables if "doubtful" in t.rows[0])
    assert [(r["log"], bool(r["doubtful"])) for r in worst.rows] == [("c", True), ("b", False)]


def test_one_group_has_no_figure(tmp_path: Path) -> None:
    write(tmp_path, log("a", None, application(0.10, 20.0)))
    assert not any(of.figure for of in summary_tables.tables(summarised(tmp_path)))


def test_a_folder_without_results_is_an_error(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(UserError) as error:
            summarised(folder)
        assert str(folder) in error.value.text
