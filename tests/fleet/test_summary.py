"""What the results of a fleet show together."""

import os
import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from adhesion_cli.cli.fleet import _text
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.summary import (
    AxleSummary,
    BrakeApplication,
    FailedLog,
    FindingSummary,
    LogSummary,
    MeanAndHighest,
    Measured,
    ReferenceSummary,
    ResultSummary,
    StopSummary,
    VehicleSummary,
)
from adhesion_cli.fleet import summary_tables
from adhesion_cli.fleet.dataset import OF_RESULTS, Dataset, KeptTables
from adhesion_cli.fleet.summary import summarise_fleet
from adhesion_cli.fleet.work import Job, _of_run, row
from adhesion_cli.results import tables
from adhesion_cli.results.report.page import campaign_page

JOB = Job({"vehicle": {"friction": 0.25, "discs": 2}}, False, (), (), (None, None), "1.2", "abcd")


def application(mu: float | None, from_mps: float, **slide: Any) -> BrakeApplication:
    values: dict[str, Any] = {
        "start_s": 2.0, "end_s": 12.0, "from_mps": from_mps, "to_mps": 0.0, "force_n": None,
        "coefficient": mu and MeanAndHighest(mu, 0.01, mu, 0.01), "slides": 0, "slide_list": (),
        "slide_s": 0.0, "slide_distance_m": 0.0, "max_slip": None, "slide_energy_j": None,
        "at_least": False, "utilisation": None, "utilisation_ci": None, "budget": None,
        "coverage": None,
    }  # fmt: skip
    return BrakeApplication(**values | slide)


SLID = {"slides": 1, "slide_s": 3.0, "slide_distance_m": 50.0, "max_slip": 0.2}
WORST = {"slides": 1, "slide_s": 2.0, "slide_distance_m": 30.0, "max_slip": 1.0}


def log(
    name: str, day: str | None, *braked: BrakeApplication, codes: tuple[str, ...] = ()
) -> ResultSummary:
    start = day and f"{day}T08:00:00Z"
    severity = {"gap": "warning", "vehicle-default": "warning", "csv-gzip-damaged": "error"}
    axle = AxleSummary(1, ReferenceSummary("smoother", 1.0, 2.0), braked, ())
    findings = (
        FindingSummary(code, severity[code], "", 1, None, (), {}, {}, code, None) for code in codes
    )
    summary = LogSummary(name, "csv", f"{name}0", start, 1.0, 1, 1)
    vehicle = VehicleSummary("stated", True, None, None, None, None)
    return ResultSummary(summary, {}, vehicle, (axle,), (), tuple(findings))


def stop(distance: float) -> StopSummary:
    deceleration = Measured(20.0**2 / 2.0 / distance, 0.01) if distance else None
    return StopSummary(
        start_s=1.0, end_s=30.0, command_from="channel", speed_from="train", nominal_speed_kmh=80.0,
        valid=True, initial_speed_mps=Measured(20.0, 0.1), distance_m=Measured(distance, 3.0),
        duration_s=None, delay_s=None, response_time_s=None, mean_deceleration=deceleration,
        equivalent_deceleration=None, jerk=None, corrected_distance_m=None,
    )  # fmt: skip


def failed(name: str) -> FailedLog:
    return FailedLog(name, "no pressure", "name it", sha256=name * 2)


def write(folder: Path, summary: ResultSummary | FailedLog, job: Job = JOB) -> None:
    kept = Dataset(folder, job.settings, job.version)
    kept.prepare(job.depends())
    files, line = {}, row(summary, job, 1.0)
    if isinstance(summary, ResultSummary):
        content = {name: tables.of_results(name, [summary]) for name in OF_RESULTS}
        files = {name: tables.packed(_of_run(table, job)) for name, table in content.items()}
    kept.write([KeptTables(line.sha256 or "", (line.log,), line, files)])


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    write(folder, log("a", "2026-03-01", application(0.10, 20.0), application(0.12, 24.0)))
    write(folder, log("b", "2026-03-02", application(0.04, 40.0, **SLID), codes=("gap",)))
    codes = ("csv-gzip-damaged", "gap")
    write(folder, log("c", None, application(None, 10.0, **WORST), codes=codes))
    write(folder, log("d", "2026-03-02", codes=("vehicle-default",)))
    write(folder, failed("e"))
    return folder


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(written, tmp_path, dirs_exist_ok=True))


def test_logs_are_counted_by_their_status(folder: Path) -> None:
    found = summarise_fleet(folder)
    assert found.logs == {"ok": 3, "damaged": 1, "error": 1}
    assert found.applications == 4
    assert found.failed == [{"log": "e", "error": "no pressure", "hint": "name it"}]
    assert found.damaged == ["c"]


def test_a_slide_counts_at_its_own_place_not_where_braking_began(tmp_path: Path) -> None:
    slid = placed(
        12.3, "2026-03-01T06:59:00Z", **SLID, slide_start_s=31.4, slide_position_km=13.125
    )
    write(tmp_path, log("a", "2026-03-01", slid, placed(12.4, "2026-03-01T07:10:00Z")))
    found = summarise_fleet(tmp_path)
    assert [(x.group["km"], x.with_slides) for x in found.by_km] == [(12, 0), (13, 1)]
    worst = _text(found).split("Worst slides")[1].splitlines()
    assert worst[3].split()[1:4] == ["1", "31.4", "13.125"]


def placed(km: float, time: str | None, mu: float = 0.1, **more: Any) -> BrakeApplication:
    place = {"position_km": km, "position_from": "position", "time": time}
    return application(mu, 20.0, **place | more)


def test_adhesion_is_distributed_by_kilometre_hour_and_day(tmp_path: Path) -> None:
    morning, later = "2026-03-01T06:59:00Z", "2026-03-01T07:00:00.5Z"
    slid = placed(12.9, later, **SLID, slide_position_km=12.9)
    first = placed(12.2, morning), placed(12.9, morning, 0.2), slid
    way = application(0.1, 20.0, position_km=1.0, position_from="distance", time=later)
    write(tmp_path, log("a", "2026-03-01", *first, placed(9.5, later), way))
    write(tmp_path, log("b", None, placed(12.0, None)))
    found = summarise_fleet(tmp_path)
    assert [(x.group["km"], x.applications, x.with_slides) for x in found.by_km] == [
        (9, 1, 0),
        (12, 4, 1),
    ]
    bins = [(*x.group.values(), x.applications) for x in found.by_km_and_hour]
    assert bins == [
        (9, "2026-03-01", 7, 1),
        (12, "2026-03-01", 6, 2),
        (12, "2026-03-01", 7, 1),
        (12, "unknown", None, 1),
    ]
    text = _text(found)
    kilometres = text.split("By kilometre:")[1].splitlines()
    assert [line.split()[0] for line in kilometres[3:5]] == ["12", "9"]  # most slides first
    hours = text.split("By kilometre, day and hour (UTC):")[1].splitlines()
    assert hours[3].split()[:4] == ["12", "2026-03-01", "07", "1"]
    worst = text.split("Worst slides")[1].splitlines()
    assert worst[1].split()[:5] == ["log", "axle", "at", "[s]", "km"]
    assert "12.900" in worst[3]
    figure = next(x.figure for x in summary_tables.tables(found) if x.title == "By kilometre")
    assert figure
    assert [(bar.begin, bar.number) for bar in figure.bars] == [(9, 1), (12, 4)]


def test_logs_without_positions_have_no_table_of_kilometres(folder: Path) -> None:
    assert summarise_fleet(folder).by_km == []
    assert "kilometre" not in _text(summarise_fleet(folder))


def test_the_coefficient_is_distributed_by_the_mean_speed(folder: Path) -> None:
    slow, middle = summarise_fleet(folder).by_speed
    assert (slow.group, slow.applications) == ({"from_kmh": 0.0, "to_kmh": 40.0}, 2)
    assert (middle.group["from_kmh"], middle.applications, middle.with_slides) == (40.0, 2, 1)
    assert middle.median == pytest.approx(0.08)
    assert middle.median_with_slides == pytest.approx(0.04)
    assert slow.median == pytest.approx(0.10)  # the locked wheel has no force
    assert middle.u95 == pytest.approx(0.01)
    assert _text(summarise_fleet(folder)).splitlines()[3].split()[-1] == "±"


def test_days_and_vehicles_are_apart(folder: Path) -> None:
    other = JOB._replace(stated={}, settings="ef01")
    write(folder, log("a", "2026-03-01", application(0.20, 20.0)), other)
    found = summarise_fleet(folder)
    assert [(r.group["day"], r.applications) for r in found.by_day] == [
        ("2026-03-01", 3), ("2026-03-02", 1), ("unknown", 1)
    ]  # fmt: skip
    assert [(*r.group.values(), r.applications) for r in found.by_settings] == [
        ("abcd", "clamping forces 2, friction 0.25", 4), ("ef01", "not stated", 1)
    ]  # fmt: skip


def test_stops_are_grouped_by_their_nominal_speed(folder: Path) -> None:
    stops = [stop(300.0), stop(310.0), replace(stop(0.0), valid=False, distance_m=None)]
    write(folder, replace(log("s", "2026-03-03"), stops=tuple(stops)))
    (group,) = summarise_fleet(folder).stops
    assert (group.nominal_speed_kmh, group.stops, group.valid) == (80.0, 3, 2)
    assert group.distance_median_m == pytest.approx(305.0)
    assert group.deceleration_median == pytest.approx(20.0**2 / 2.0 / 305.0, rel=1e-3)
    assert group.response_median_s is None


def test_the_worst_slide_is_first_though_its_force_is_not_known(folder: Path) -> None:
    assert [row.log for row in summarise_fleet(folder).worst_slides] == ["c", "b"]


def test_a_slide_that_is_a_lower_bound_is_marked(tmp_path: Path) -> None:
    write(tmp_path, log("late", None, application(0.1, 20.0, **SLID, at_least=True)))
    text = _text(summarise_fleet(tmp_path))
    row = next(line for line in text.splitlines() if line.startswith("late "))
    assert row.split()[-7:-1] == ["≥", "3.0", "≥", "50", "≥", "20.0"]


def test_the_energy_of_the_worst_slides_has_its_uncertainty(tmp_path: Path) -> None:
    energy = {"slide_energy_j": 54_400.0, "slide_energy_u95_j": 44_000.0}
    write(tmp_path, log("a", None, application(0.1, 20.0, **SLID, **energy)))
    assert "54±44" in _text(summarise_fleet(tmp_path))


def test_findings_on_the_data_count_logs(folder: Path) -> None:
    assert [(r.code, r.logs, r.example) for r in summarise_fleet(folder).findings] == [
        ("csv-gzip-damaged", 1, "c"), ("gap", 2, "b")
    ]  # fmt: skip


def test_of_one_log_only_the_newest_result_counts(folder: Path) -> None:
    newer = JOB._replace(version="1.10")
    write(folder, log("a", "2026-03-01", application(0.30, 20.0)), newer)
    changed = log("b", "2026-03-02", application(0.05, 40.0))
    write(folder, replace(changed, log=changed.log._replace(sha256="bb")))
    old = folder / "logs" / "b0-abcd-1.2.parquet"
    os.utime(old, (1, 1))
    found = summarise_fleet(folder)
    assert found.applications == 3
    assert found.by_speed[-1].with_slides == 0


@pytest.mark.parametrize("table", ["applications", "estimators", "findings", "logs"])
@pytest.mark.parametrize("content", [b"", b"PAR1 PAR1", None])
def test_damaged_results_are_left_out_and_named(
    folder: Path, table: str, content: bytes | None
) -> None:
    assert summarise_fleet(folder).loss == []
    path = folder / table / "a0-abcd-1.2.parquet"
    path.write_bytes(content or b"")
    if content is None:
        path.unlink()
    found = summarise_fleet(folder)
    assert (found.logs["ok"], found.applications) == (2, 2)
    (name,) = found.lost
    assert name.endswith("a" if table != "logs" else "a0-abcd-1.2.parquet")
    assert [f.code for f in found.loss] == ["fleet-results-damaged"]
    assert f"Damaged or missing results:\n  {name}" in _text(found)
    assert name in campaign_page(summary_tables.campaign("x", found))


@pytest.mark.parametrize("text", ["[]", "1", "{}", '{"stated": []}', '{"stated": {"vehicle": []}}'])
def test_settings_that_are_none_are_unknown(folder: Path, text: str) -> None:
    (folder / "settings" / "abcd.json").write_text(text)
    assert {row.group["stated"] for row in summarise_fleet(folder).by_settings} == {"unknown"}


def test_only_failed_logs_make_a_summary(tmp_path: Path) -> None:
    write(tmp_path, failed("e"))
    found = summarise_fleet(tmp_path)
    assert (found.logs["error"], found.applications, found.by_speed) == (1, 0, [])


def test_the_text_names_every_log_to_look_at(folder: Path) -> None:
    write(folder, log("a" * 120, "2026-03-03", application(0.02, 30.0, **SLID)))
    for i in range(12):
        write(folder, failed(f"f{i}"))
    text = _text(summarise_fleet(folder))
    assert max(map(len, text.splitlines())) <= 100
    listed = text.partition("Failed logs:")[2].partition("Damaged logs:")
    assert "  e\n" in listed[0]
    assert "3 more" in listed[0]
    assert listed[2].split() == ["c"]


def test_groups_that_can_be_compared_have_a_figure(folder: Path, tmp_path: Path) -> None:
    write(folder, log("g", "2026-03-04", application(0.3, 20.0)), JOB._replace(settings="ef01"))
    figures = {
        of.title.split()[1]: of.figure for of in summary_tables.tables(summarise_fleet(folder))
    }
    assert [title for title, of in figures.items() if of] == ["adhesion", "settings", "day"]
    slow, middle = figures["adhesion"].bars
    assert (slow.begin, slow.stop, slow.number) == (0.0, 40.0, 3)
    assert (middle.name, middle.middle, middle.slid) == (
        "40 to 80", pytest.approx(0.08), pytest.approx(0.04)
    )  # fmt: skip
    days = figures["day"].bars
    assert [bar.name for bar in days] == ["2026-03-01", "2026-03-02", "2026-03-04"]
    first = 1e-3 * days[0].begin  # midnight in UTC
    assert datetime.fromtimestamp(first, UTC).isoformat() == "2026-03-01T00:00:00+00:00"
    page, again = tmp_path / "a.html", tmp_path / "b.html"
    for path in (page, again):
        path.write_text(
            campaign_page(summary_tables.campaign("a", summarise_fleet(folder))), "utf-8"
        )
    assert page.read_bytes() == again.read_bytes()
    assert page.read_text("utf-8").count('class="figure"') == 3


def test_the_page_says_how_many_slid_and_which_logs_are_doubtful(folder: Path) -> None:
    found = summarise_fleet(folder)
    assert (found.with_slides, found.in_doubt) == (2, 1)
    assert [(r.log, r.code) for r in found.to_check] == [("c", "csv-gzip-damaged")]
    of = summary_tables.campaign("x", found)
    assert "2 of 4" in of.verdict
    assert set(of.codes) == {"gap", "csv-gzip-damaged"}
    assert "1.2" in of.about["Evaluated by"]
    (folder / "x.html").write_text(campaign_page(of), "utf-8")
    text = (folder / "x.html").read_text("utf-8")
    for code in of.codes:
        assert f'href="#finding-{code}"' in text
        assert f'id="finding-{code}"' in text
    worst = next(t for t in of.tables if "doubtful" in t.rows[0])
    assert [(r["log"], bool(r["doubtful"])) for r in worst.rows] == [("c", True), ("b", False)]


def test_one_group_has_no_figure(tmp_path: Path) -> None:
    write(tmp_path, log("a", None, application(0.10, 20.0)))
    assert not any(of.figure for of in summary_tables.tables(summarise_fleet(tmp_path)))


def test_a_folder_without_results_is_an_error(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(UserError) as error:
            summarise_fleet(folder)
        assert str(folder) in error.value.text
