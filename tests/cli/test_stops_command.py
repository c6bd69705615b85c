"""`adhesion stops`: the brake test on the screen, as JSON and as a table."""

import csv
import hashlib
import json
import math
import re
import shutil
from pathlib import Path

import pytest
from helpers.commands import Run
from helpers.pages import figures
from helpers.vehicle_logs import WHOLE
from openpyxl import load_workbook

from adhesion_cli.core import bundled
from adhesion_cli.results.report.protocol import FIELDS
from adhesion_cli.stops.series import QUANTITIES

SAMPLES = bundled.folder("sample_logs")
ROLLED, SLID = (SAMPLES / f"{name}.csv" for name in ("service-brake", "low-adhesion"))
PLAN = """
[group.first]
logs = ["one.csv"]
label = "as delivered"
nominal_speed = 70
[group.second]
logs = ["two.csv"]
nominal_speed = 70
vehicle = "other.toml"
[compare]
pairs = [["first", "second"]]
[limits]
equivalent_deceleration = {min = 0.1}
[wsp]
dry = "first"
wet = "second"
"""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    """Of a log at 5 Hz: the rows that have all values, of an axle that rolls."""
    head, *rows = csv.reader(SLID.read_text(encoding="utf-8").splitlines())
    chosen = [k for k, name in enumerate(head) if not re.search("_[124] ", name)]
    lines = [",".join(row[k] for k in chosen) for row in (head, *rows[::10])]
    for name in ("one.csv", "two.csv"):
        (tmp_path / name).write_text("\n".join([*lines, ""]), encoding="utf-8")
    (tmp_path / "other.toml").write_text("[vehicle]\naxle_mass = 6000\n")
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path / "plan.toml"


def test_a_series_by_its_plan(run: Run, plan: Path) -> None:
    document = json.loads(run("stops", "--plan", str(plan), "--json", "-o", "out").stdout)
    assert document["schema"] == "adhesion.stops/1"
    first, second = document["stops"]
    assert {"log", "group", "label", "start_s", "position_m", "valid", "reason"} <= set(first)
    assert (first["group"], first["label"], second["label"]) == ("first", "as delivered", None)
    assert set(first["distance_m"]) == {"value", "u95", "common_u95"}
    assert first["distance_m"] == pytest.approx(second["distance_m"], rel=1e-3)
    assert first["command_from"] == "pressure"
    assert second["nominal_speed_kmh"] == 70.0
    assert first["coefficient"]["value"] != second["coefficient"]["value"]  # its own vehicle
    groups = {g["name"]: g for g in document["groups"]}
    assert groups["first"]["distance_m"]["mean"] == first["distance_m"]["value"]
    assert set(QUANTITIES) <= set(groups["first"])
    change = {d["quantity"]: d for d in document["differences"]}
    assert (change["distance_m"]["from"], change["distance_m"]["to"]) == ("first", "second")
    assert (change["distance_m"]["value"], change["distance_m"]["distinguishable"]) == (0.0, False)
    assert {x["verdict"] for x in document["limits"]} == {"pass"}
    (wsp,) = document["wsp"]
    assert wsp["extension"] == pytest.approx(0.0, abs=1e-9)
    assert wsp["k_wet"] == pytest.approx(1.0)
    with Path(plan.parent, document["outputs"]["csv"]).open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(r["distance_m_value"]) for r in rows] == [
        s["distance_m"]["value"] for s in document["stops"]
    ]
    again = run("stops", "--plan", str(plan), "-o", "out")
    assert again.returncode == 1
    assert "--force" in again.stderr


def test_dry_and_wet_stops_from_other_speeds_are_a_finding(run: Run, plan: Path) -> None:
    plan.write_text(PLAN.replace("nominal_speed = 70", "nominal_speed = 50", 1))
    document = json.loads(run("stops", "--plan", str(plan), "--json").stdout)
    (finding,) = (f for f in document["findings"] if f["code"] == "wet-speeds-differ")
    assert finding["message"].startswith("Group first stops from 50 km/h, group second from 70")
    assert document["wsp"][0]["extension"] is None


def test_the_screen_has_stops_statistics_and_verdicts(run: Run, plan: Path) -> None:
    done = run("stops", "one.csv", "two.csv", "--plan", str(plan), "--lambda", "--budget")
    assert done.returncode == 0, done.stderr
    for text in (
        "a equiv.", "one.csv", "first rise of a cylinder pressure", "not distinguishable",
        "undecided (JCGM", "K_wet", "SUBSET-026", "speed scale",
    ):  # fmt: skip
        assert text in done.stdout, text


def test_stops_of_logs_with_a_clock_are_in_the_order_of_time(run: Run, tmp_path: Path) -> None:
    for name, minute in (("a.csv", 30), ("b.csv", 10)):
        rows = [
            f"2026-03-05 06:{minute}:{t / 2:06.3f},{max(80 - max(t / 2 - 10, 0) * 4, 0):.2f}"
            for t in range(90)
        ]
        (tmp_path / name).write_text("\n".join(["time,train speed [km/h]", *rows, ""]))
    stops = json.loads(run("stops", "a.csv", "b.csv", "--json").stdout)["stops"]
    assert [Path(s["log"]).name for s in stops] == ["b.csv", "a.csv"]
    assert not any(s["vehicle_in_doubt"] for s in stops)


def test_a_stop_whose_log_contradicts_its_vehicle_says_so_in_json_and_table(
    run: Run, tmp_path: Path
) -> None:
    log = str(ROLLED)
    values = {**WHOLE, "friction": 0.15}
    stated = [text for name, x in values.items() for text in ("--set", f"vehicle.{name}={x}")]
    done = run("stops", log, *stated, "--json", "-o", "out")
    (stop,) = json.loads(done.stdout)["stops"]
    assert stop["vehicle_in_doubt"] is True
    (row,) = csv.DictReader((tmp_path / "out" / "stops.csv").read_text().splitlines())
    assert row["vehicle_in_doubt"].lower() == "true"


def test_a_stop_with_slides_has_a_sentence(run: Run) -> None:
    assert "Stop 1: 9 slides, largest slip 15.8±0.9 % (axle 1)." in run("stops", str(SLID)).stdout
    assert "slide" not in run("stops", str(ROLLED)).stdout


def test_a_series_names_its_vehicle_and_the_logs_of_its_findings(run: Run, plan: Path) -> None:
    done = run("stops", "one.csv", "two.csv", "--json")
    document = json.loads(done.stdout)
    assert [Path(x["path"]).name for x in document["logs"]] == ["one.csv", "two.csv"]
    assert all(x["vehicle"]["logs"] == 2 for x in document["logs"])
    of_vehicle = [Path(f["log"]).name for f in document["findings"] if "vehicle" in f["code"]]
    assert of_vehicle == ["one.csv", "two.csv"]
    done = run("stops", "one.csv", "two.csv")
    assert done.stdout.startswith("Vehicle: ")
    assert "Each log alone shows" in " ".join(done.stdout.split())
    assert done.stderr.count("vehicle-default") == 1
    assert "all 2 logs" in done.stderr
    by_group = " ".join(run("stops", "--plan", str(plan)).stdout.split())
    assert "Vehicle of group first: " in by_group
    assert "Vehicle of group second: " in by_group


def test_analyze_has_the_same_stops(run: Run, plan: Path) -> None:
    log = str(plan.with_name("one.csv"))
    (stop,) = json.loads(run("stops", log, "--json").stdout)["stops"]
    (result,) = json.loads(run("analyze", log, "--json", "-a", "td").stdout)["results"]
    (own,) = result["stops"]
    assert {k: stop[k] for k in own} == own
    assert stop["group"] == f"{own['nominal_speed_kmh']:g} km/h"


@pytest.mark.parametrize(
    ("mode", "filling", "takes"), [("", 2.0, True), ("G", 2.0, False), ("", 6.0, False)]
)
def test_a_log_without_a_command_has_the_dead_time_of_the_other_logs(
    run: Run, tmp_path: Path, mode: str, filling: float, takes: bool
) -> None:
    """If its brake is in the same mode, and fills as fast."""
    for name, head, rise in (("a", ",brake command [0/1]", 2.0), ("b", "", filling)):
        lines = [f"time [s],train speed [km/h],bc pressure axle 1 [bar]{head}"]
        for k in range(900):
            t = k / 20.0
            since = max(t - 10.6, 0.0)
            p = min(since / rise, 1.0)
            v = max(1.0 - (p * since - rise * p**2 / 2.0) / 22.0, 0.0)
            lines.append(f"{t},{80.0 * v:.2f},{3.0 * p:.2f}" + f",{int(t >= 10.0)}" * bool(head))
        (tmp_path / f"{name}.csv").write_text("\n".join([*lines, ""]))
    _, (alone,) = (
        json.loads(run("stops", x, "--json").stdout)["stops"] for x in ("a.csv", "b.csv")
    )
    plan = f"[group.a]\nlogs = ['a.csv']\n[group.b]\nlogs = ['b.csv']\nmode = '{mode}'\n"
    (tmp_path / "plan.toml").write_text(plan)
    document = json.loads(run("stops", "--plan", "plan.toml", "--json").stdout)
    _, stop = document["stops"]
    assert ("times-of-other-logs" in {f["code"] for f in document["findings"]}) == takes
    assert stop["start_s"] == pytest.approx(10.0 if takes else alone["start_s"], abs=0.05)
    assert (stop["distance_m"]["u95"] < 0.6 * alone["distance_m"]["u95"]) == takes


def test_a_workbook_has_a_sheet_for_each_table_of_the_series(run: Run, plan: Path) -> None:
    run("stops", "--plan", str(plan), "--table", "series.xlsx")
    book = load_workbook(plan.with_name("series.xlsx"))
    assert book.sheetnames == [
        "stops", "groups", "differences", "limits", "wsp", "wsp axles",
    ]  # fmt: skip
    head, first, *_ = book["groups"].values
    row = dict(zip(head, first, strict=True))
    assert (row["group"], row["quantity"], row["n"]) == ("first", "initial_speed_mps", 1)
    assert isinstance(row["mean"], float)


def test_a_log_that_has_no_wheel_speeds_has_stops(run: Run, tmp_path: Path) -> None:
    rows = [f"{t / 20},{min(max(90 - 3.6 * (t / 20 - 10), 0), 90)}" for t in range(0, 900)]
    (tmp_path / "gps.csv").write_text("time [s],train speed [km/h]\n" + "\n".join(rows))
    document = json.loads(run("stops", "gps.csv", "--json").stdout)
    (stop,) = document["stops"]
    assert (stop["command_from"], stop["valid"], stop["delay_s"]) == ("deceleration", True, None)
    assert stop["distance_m"]["value"] == pytest.approx(25.0**2 / 2.0, rel=0.01)
    assert stop["mean_deceleration"]["value"] == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["stops"], 2, "no log"),
        (["stops", "missing.csv"], 1, "missing.csv"),
        (["stops", "one.csv", "three.csv", "--plan", "plan.toml"], 1, "three.csv: in no group"),
        (["stops", "one.csv", "--plan", "plan.toml"], 1, "group second: no log matches two.csv"),
        (["stops", "--plan", "other.toml"], 2, "vehicle"),
    ],
)
def test_what_cannot_be_done_says_so(
    run: Run, plan: Path, arguments: list[str], code: int, said: str
) -> None:
    shutil.copy(ROLLED, plan.parent / "three.csv")
    done = run(*arguments)
    assert done.returncode == code
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_the_protocol_shows_what_the_plan_states_of_groups(run: Run, plan: Path) -> None:
    text = plan.read_text().replace("nominal_speed = 70", 'nominal_speed = 70\nload = "empty"')
    plan.write_text(text.replace("[group.second]", '[group.second]\nrail = "wet"'))
    assert run("stops", "--plan", str(plan), "-o", "out", "--report", "-q").returncode == 0
    page = Path(plan.parent, "out", "stops.html").read_text(encoding="utf-8")
    assert page.count('class="blank"') == sum(map(len, FIELDS.values())) - 2
    assert "second: wet" in page
    assert "first: empty" not in page  # the same load in both


def test_the_protocol_has_the_days_of_its_stops(run: Run, plan: Path) -> None:
    for day, name in ((26, "one.csv"), (27, "two.csv")):
        log = plan.parent / name
        start = f"Start time: {day}.11.2026 09:12:03\n\n"
        log.write_text(start + log.read_text("utf-8"), "utf-8")
    options = "--set", "vehicle.discs=2", "-o", "out", "--report", "-q", "--force"
    fields = sum(map(len, FIELDS.values()))
    for stated, day, blanks in (("", "2026-11-26 to 2026-11-27", 1), ("27. November", "27. N", 1)):
        if stated:
            with plan.open("a") as file:
                file.write(f'[protocol]\ndate = "{stated}"\n')
        assert run("stops", "--plan", str(plan), *options).returncode == 0
        page = Path(plan.parent, "out", "stops.html").read_text(encoding="utf-8")
        assert page.count('class="blank"') == fields - blanks
        assert day in page
        assert "discs (clamping forces)" in page


def test_the_protocol_has_its_tables_figures_and_empty_lines(run: Run, plan: Path) -> None:
    with plan.open("a") as file:
        file.write('[protocol]\nvehicle = "<b>4711"\nobserver = "N. N."\n')
    options = ("-o", "out", "--report", "--table", "all.xlsx", "-q")
    stated = ("--set", "stops.dead_time=0.37")
    done = run("stops", "--plan", str(plan), *options, *stated)
    assert done.returncode == 0, done.stderr
    text = Path(plan.parent, "out", "stops.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;4711" in text
    assert "Vehicle of group first: " in text
    assert hashlib.sha256(Path(plan.parent, "one.csv").read_bytes()).hexdigest() in text
    assert re.search(r"stops\.dead_time\W.{0,40}0\.37", text, re.DOTALL)
    assert "N. N." in text
    for part in ("2 valid stops of 2. Limits: 2 kept.", "Statistics", "Differences", "K_wet"):
        assert part in text, part
    assert text.count('class="blank"') == sum(map(len, FIELDS.values())) - 1
    assert set(figures(text)["roots"].values()) == {"stops-speed", "stops-distance", "stops"}
    assert Path(plan.parent, "all.xlsx").exists()
    assert "<code>stops.dead_time</code>" in text
    assert '<th class="text">group</th>' in text
    refused = run("stops", "one.csv", "two.csv", "--plan", str(plan), "--report")
    assert refused.returncode == 2
    assert "-o DIR" in refused.stderr


def test_wheel_speeds_without_a_brake_are_those_of_the_rim(run: Run, tmp_path: Path) -> None:
    rows = [f"{t / 20},{min(max(90 - 3.6 * (t / 20 - 10), 0), 90)}" for t in range(0, 900)]
    (tmp_path / "axle.csv").write_text("time [s],axle 1 speed [km/h]\n" + "\n".join(rows))
    (stop,) = json.loads(run("stops", "axle.csv", "--json").stdout)["stops"]
    assert stop["initial_speed_mps"]["value"] == pytest.approx(25.0, rel=0.01)


def test_a_plan_may_lie_in_another_folder(run: Run, plan: Path, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    for name in ("one.csv", "two.csv"):
        (tmp_path / name).rename(tmp_path / "runs" / name)
    text = PLAN.replace('"one.csv"', '"runs/one.csv"')
    text = text.replace('"two.csv"', f'"{(tmp_path / "runs" / "tw*.csv").as_posix()}"')
    plan.write_text(text)
    document = json.loads(run("stops", "--plan", str(plan), "--json").stdout)
    assert [s["group"] for s in document["stops"]] == ["first", "second"]
    named = run("stops", "runs/one.csv", "runs/two.csv", "--plan", "plan.toml", "--json")
    assert json.loads(named.stdout)["groups"] == document["groups"]


def test_the_fall_of_a_brake_pipe_is_the_command(run: Run, tmp_path: Path) -> None:
    rows = []
    for k in range(1200):
        t = k / 20
        pipe = 5.0 - 1.5 * min(max(t - 10.2, 0.0), 1.0)
        cylinder = 3.2 * min(max((t - 10.8) / 1.5, 0.0), 1.0)
        speed = 90.0 - 3.24 * max(t - 11.5, 0.0)
        rows.append(f"{t},{pipe:.3f},{cylinder:.3f},{max(speed, 0.0):.2f},{max(speed, 0.0):.2f}")
    heads = "time [s],brake pipe pressure [bar],BC pressure [bar],axle 1 speed [km/h],GPS [km/h]"
    (tmp_path / "pipe.csv").write_text("\n".join([heads, *rows]))
    (stop,) = json.loads(run("stops", "pipe.csv", "--json").stdout)["stops"]
    assert stop["command_from"] == "brake_pipe"
    assert stop["start_s"] == pytest.approx(10.25, abs=0.1)


def test_a_log_with_slides_takes_no_delay_of_another_sensor(run: Run, tmp_path: Path) -> None:
    for name, sensor, delay, slip in (("dry", "GPS", 0.8, 0.0), ("wet", "radar", 0.0, 0.2)):
        lines = [f"time [s],bc pressure axle 1 [bar],axle speed 1 [km/h],{sensor} speed [km/h]"]
        for k in range(1800):
            t = k / 50.0

            def speed(t: float) -> float:
                braked = max(t - 11.0, 0.0)
                return max(80.0 - 3.0 * (braked - 0.7 * (1.0 - math.exp(-braked / 0.7))), 0.0)

            p = 3.0 * min(max((t - 10.6) / 2.0, 0.0), 1.0)
            wheel = speed(t) * (1.0 - slip * abs(math.sin(1.7 * t)) * (p > 2.0))
            lines.append(f"{t},{p:.2f},{wheel:.2f},{speed(t - delay):.2f}")
        (tmp_path / f"{name}.csv").write_text("\n".join([*lines, ""]))
    wet = tmp_path / "wet.csv"
    for sensor in ("radar", "GPS"):
        wet.write_text(wet.read_text().replace("radar", sensor))
        findings = json.loads(run("stops", "dry.csv", "wet.csv", "--json").stdout)["findings"]
        codes = [f["code"] for f in findings]
        assert "train-speed-delay" in codes
        assert ("times-of-other-logs" in codes) == (sensor == "GPS")


def test_a_result_has_the_stops_of_its_log_where_the_pressure_was_lost(
    run: Run, tmp_path: Path
) -> None:
    rows = []
    for k in range(1200):
        t = k / 20
        pressure = "" if 9.3 < t < 14.0 else f"{min(max(t - 10.0, 0.0) * 3.0, 3.0):.3f}"
        speed = min(90.0, max(90.0 - 3.6 * (t - 10.5), 0.0))
        rows.append(f"{t:.2f},{pressure},{speed:.3f},{speed:.3f}")
    log = tmp_path / "log.csv"
    log.write_text("t [s],BCP 1 [bar],axle 1 [km/h],train speed [km/h]\n" + "\n".join(rows) + "\n")
    of_log, of_result = (
        json.loads(run("analyze", name, "-o", out, "--json").stdout)["results"][0]["stops"]
        for name, out in ((str(log), "a"), ("a/log.adhesion.mcap", "b"))
    )
    (stop,) = of_log
    assert stop["valid"]
    for key in ("start_s", "valid", "reason", "distance_m", "response_time_s", "duration_s"):
        assert of_result[0][key] == stop[key]


def test_wheels_that_fill_a_gap_of_the_train_speed_are_named(run: Run, tmp_path: Path) -> None:
    rows = []
    for k in range(900):
        t = k / 20
        pressure = min(max(t - 10.0, 0.0) * 3.0, 3.0)
        speed = min(90.0, max(90.0 - 3.6 * (t - 10.5), 0.0))
        train = "" if 18.0 < t < 24.0 else f"{speed:.3f}"
        rows.append(f"{t:.2f},{pressure:.3f},{0.998 * speed:.3f},{train}")
    head = "t [s],BCP 1 [bar],axle 1 [km/h],train speed [km/h]"
    (tmp_path / "log.csv").write_text("\n".join([head, *rows, ""]))
    shown = " ".join(run("stops", "log.csv").stdout.split())
    assert "train speed; where that is missing for some time, of wheels that roll." in shown
    assert "No valid stop" not in shown
