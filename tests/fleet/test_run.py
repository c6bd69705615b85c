"""A run over many logs, by real processes."""

from collections.abc import Iterator
from dataclasses import replace
from hashlib import sha256 as hash_of
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from helpers import logs_of_fleet
from pyarrow import dataset, parquet

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.summary import FailedLog
from adhesion_cli.fleet.dataset import TABLES, Dataset, hashed
from adhesion_cli.fleet.locations import LogLocation, find
from adhesion_cli.fleet.run import FleetProgress, run
from adhesion_cli.fleet.work import Job, analysed
from adhesion_cli.fleet.workers import Processes
from adhesion_cli.results import tables


class Killed(Processes):
    """Processes that some logs end."""

    submitted: list[str]

    def submit(self, do: Any, *arguments: Any) -> Any:
        self.submitted = [*getattr(self, "submitted", []), arguments[0].name]
        return super().submit(logs_of_fleet.killed, *arguments)


JOB = Job({}, False, (), (), (None, None), "1.2", "abcd")


@pytest.fixture(scope="module")
def workers() -> Iterator[Killed]:
    processes = Killed(2)
    yield processes
    processes.close()


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two good logs, one of them twice, one that cannot be read, one that is none, two that die."""
    folder = tmp_path_factory.mktemp("fleet") / "logs"
    good, dies, once = logs_of_fleet.write(folder, 3)
    (folder / "copy.csv").write_bytes(good.read_bytes())
    dies.rename(folder / "dies.csv")
    once.rename(folder / "once.csv")
    (folder / "none.csv").write_text("no log\n")
    (folder / "lost.csv").symlink_to(folder / "nowhere")
    return folder


def of(folder: Path, table: str) -> list[dict[str, Any]]:
    return dataset.dataset(folder / table, format="parquet").to_table().to_pylist()


def campaign(logs: Path, folder: Path, workers: Killed, **more: Any) -> FleetProgress:
    workers.submitted = []
    kept = Dataset(folder, JOB.settings, JOB.version)
    return run(find([str(logs)]), JOB, kept, workers, **more)


@pytest.fixture(scope="module")
def first(logs: Path, workers: Killed) -> tuple[Path, FleetProgress]:
    folder = logs.parent / "results"
    return folder, campaign(logs, folder, workers)


def test_each_log_has_a_row_with_what_became_of_it(
    logs: Path, first: tuple[Path, FleetProgress]
) -> None:
    folder, state = first
    rows = {Path(row["log"]).name: row for row in of(folder, "logs")}
    assert {name: row["status"] for name, row in rows.items()} == {
        "stop-000.csv": "ok", "copy.csv": "ok", "once.csv": "ok",
        "dies.csv": "error", "none.csv": "error", "lost.csv": "error",
    }  # fmt: skip
    assert (state.logs, state.completed, state.skipped, len(state.failed)) == (6, 3, 0, 3)
    for name in ("dies.csv", "none.csv", "lost.csv"):
        assert rows[name]["error"]
        assert rows[name]["hint"]
    assert rows["lost.csv"]["sha256"] is None
    assert rows["copy.csv"]["sha256"] == rows["stop-000.csv"]["sha256"]
    assert {row["version"] for row in rows.values()} == {"1.2"}


def test_two_logs_with_one_content_are_analysed_once(first: tuple[Path, FleetProgress]) -> None:
    names = [Path(row["log"]).name for row in of(first[0], "applications")]
    assert sorted(names) == ["copy.csv", "once.csv"]


def test_the_tables_hold_what_analyze_gives(logs: Path, first: tuple[Path, FleetProgress]) -> None:
    log = logs / "once.csv"
    one = summarise(analyze(log, Settings(), train_speed=True), {})
    for name in ("applications", "stops", "estimators", "findings"):
        expected = tables.of_results(name, [one])
        mine = [row for row in of(first[0], name) if row["log"] == str(log)]
        assert expected.num_rows
        assert [{k: row[k] for k in expected.schema.names} for row in mine] == expected.to_pylist()


@pytest.mark.parametrize("pressure", [True, False])
def test_a_log_without_wheel_speeds_has_its_stops(tmp_path: Path, pressure: bool) -> None:
    log, header = tmp_path / "train.csv", "time [s],train speed [km/h]"
    rows = [f"{t / 20},{min(max(90 - 3.6 * (t / 20 - 10), 0), 90)}" for t in range(900)]
    if pressure:
        header += ",brake cylinder pressure [bar]"
        rows = [f"{row},{3 * min(max(t / 20 - 9.5, 0), 1)}" for t, row in enumerate(rows)]
    log.write_text("\n".join([header, *rows, ""]))
    job = JOB._replace(window=(2.0, 44.0))
    outcome = analysed(
        LogLocation("train.csv", str(log), hash_of(log.read_bytes()).hexdigest()), job
    )
    assert (outcome.row.status, outcome.row.error) == ("ok", None)
    by_name = {
        name: parquet.read_table(BytesIO(x)).to_pylist() for name, x in outcome.files.items()
    }
    (stop,) = by_name["stops"]
    assert (stop["log"], stop["valid"]) == ("train.csv", True)
    assert stop["distance_m_value"] == pytest.approx(324.0 if pressure else 313.0, rel=0.01)
    assert not by_name["applications"]
    assert not by_name["estimators"]
    (remark,) = (x for x in by_name["findings"] if x["code"] == "stops-alone")
    assert "no channel is a wheel speed" in remark["message"]
    assert str(tmp_path) not in remark["message"]
    outside = job._replace(window=(0.0, 5.0))
    assert analysed(LogLocation("train.csv", str(log), ""), outside).row.status == "error"


def test_a_choice_of_axles_leaves_a_log_without_wheel_speeds_its_stops(tmp_path: Path) -> None:
    log = tmp_path / "train.csv"
    rows = [f"{t / 20},{min(max(90 - 3.6 * (t / 20 - 10), 0), 90)}" for t in range(900)]
    log.write_text("\n".join(["time [s],train speed [km/h]", *rows, ""]))
    item = LogLocation("train.csv", str(log), hash_of(log.read_bytes()).hexdigest())
    outcomes = [analysed(item, JOB._replace(axles=axles)) for axles in ((), (2,))]
    assert [x.row.status for x in outcomes] == ["ok", "ok"]
    every, chosen = (parquet.read_table(BytesIO(x.files["stops"])) for x in outcomes)
    assert every.num_rows == 1
    assert chosen.equals(every)


def test_an_axle_that_a_log_does_not_have_is_an_error(logs: Path) -> None:
    log = logs / "once.csv"
    item = LogLocation("once.csv", str(log), hash_of(log.read_bytes()).hexdigest())
    row = analysed(item, JOB._replace(axles=(7,))).row
    assert (row.status, row.error) == ("error", "once.csv: no axle 7")


def test_a_second_run_tries_only_what_failed(
    logs: Path, first: tuple[Path, FleetProgress], workers: Killed
) -> None:
    folder, _ = first
    before = {p: (p.read_bytes(), p.stat().st_ino) for p in folder.glob("applications/*")}
    state = campaign(logs, folder, workers)
    assert {Path(name).name for name in workers.submitted} == {"dies.csv", "none.csv"}
    assert (state.completed, state.skipped, len(state.failed)) == (0, 3, 3)
    assert {p: (p.read_bytes(), p.stat().st_ino) for p in folder.glob("applications/*")} == before


def test_a_new_name_of_a_known_log_is_added_without_analysis(
    logs: Path, first: tuple[Path, FleetProgress], workers: Killed
) -> None:
    again = logs.parent / "moved.csv"
    again.write_bytes((logs / "once.csv").read_bytes())
    state = campaign(again, first[0], workers)
    assert not workers.submitted
    assert state.skipped == 1
    sums = [row["log"] for row in of(first[0], "logs") if row["log"].endswith("moved.csv")]
    assert sums == [str(again)]


def test_a_log_that_can_be_read_at_last_loses_its_failed_row(
    logs: Path, first: tuple[Path, FleetProgress], workers: Killed
) -> None:
    (logs / "nowhere").write_bytes((logs / "once.csv").read_bytes())
    campaign(logs / "lost.csv", first[0], workers)
    (logs / "nowhere").unlink()
    rows = [row for row in of(first[0], "logs") if row["log"].endswith("lost.csv")]
    assert [row["status"] for row in rows] == ["ok"]


def test_a_damaged_mark_of_done_is_no_mark(tmp_path: Path) -> None:
    kept = Dataset(tmp_path, "ab", "1")
    kept.prepare({})
    for name, content in (("good-ab-1", None), ("bad-ab-1", b"PAR1"), ("other-cd-1", None)):
        path = tmp_path / "logs" / f"{name}.parquet"
        if content:
            path.write_bytes(content)
        else:
            row = replace(tables.log_row(FailedLog("x", "lost", "")), seconds=1.0)
            parquet.write_table(tables.table([row], tables.LOGS), path)
    assert list(kept.finished_logs()) == ["good"]


def test_settings_decide_the_hash() -> None:
    one, same = {"friction": 0.3, "discs": 2}, {"discs": 2, "friction": 0.3}
    assert hashed({"x": one}) == hashed({"x": same}) != hashed({"x": {}})


def test_every_table_has_a_file_for_each_log(first: tuple[Path, FleetProgress]) -> None:
    files = {name: {p.name for p in (first[0] / name).iterdir()} for name in TABLES}
    assert files["applications"] == files["estimators"] == files["findings"] < files["logs"]
    assert all(name.endswith(f"-{JOB.settings}-1.2.parquet") for name in files["logs"])
