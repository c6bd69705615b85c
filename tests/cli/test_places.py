"""A log with a clock, kilometres and coordinates: where and when stops and slides were."""

import csv
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from helpers.commands import Run
from pyarrow import parquet

from adhesion_cli.core import bundled

SAMPLE = bundled.folder("sample_logs") / "low-adhesion.csv"  # two of four axles slide
BEGIN = datetime(2026, 3, 5, 6, 30, tzinfo=UTC)
METRES_PER_DEGREE = 111_195.0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every tenth row of the sample with its places: from km 7 to the north."""
    path = tmp_path_factory.mktemp("places") / "line.csv"
    with SAMPLE.open(encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    rows = rows[::10]  # those that have all values
    train = next(i for i, name in enumerate(head) if "train" in name.lower())
    factor = 1.0 / 3.6 if "km/h" in head[train] else 1.0
    metres, speed, previous = 0.0, 0.0, float(rows[0][0])
    placed = [["time", *head[1:], "position [km]", "latitude [deg]", "longitude [deg]"]]
    for row in rows:
        t = float(row[0])
        speed = factor * float(row[train]) if row[train] else speed
        metres += (t - previous) * speed
        previous = t
        clock = (BEGIN + timedelta(seconds=t)).isoformat(timespec="milliseconds")
        place = [f"{7.0 + metres / 1e3:.6f}", f"{50.0 + metres / METRES_PER_DEGREE:.7f}", "8.6"]
        placed.append([clock, *row[1:], *place])
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(placed)
    return path


def test_analyze_says_when_and_where(run: Run, log: Path, tmp_path: Path) -> None:
    map_, table = "map.geojson", "out.parquet"
    options = "-a td --axle 1 --axle 3 --json --geojson".split()
    shown = run("analyze", str(log), *options, map_, "--table", table)
    assert shown.returncode in (0, 3), shown.stdout
    (result,) = json.loads(shown.stdout)["results"]
    (stop,) = result["stops"]
    assert 7000.0 < stop["position_m"] < 7500.0
    assert stop["position_from"] == "position"
    north = (stop["position_m"] - 7000.0) / METRES_PER_DEGREE
    assert stop["latitude"] == pytest.approx(50.0 + north, abs=1e-5)
    begin = BEGIN + timedelta(seconds=stop["start_s"])
    assert abs(datetime.fromisoformat(stop["time"]) - begin) < timedelta(milliseconds=2)
    applications = [a for axle in result["axles"] for a in axle["applications"]]
    slides = [x for a in applications for x in a["slide_list"]]
    assert sum(a["slides"] for a in applications) == len(slides) > 0
    keys = "start_s duration_s distance_m max_slip energy_j position_km latitude longitude".split()
    assert set(keys) <= set(slides[0])
    assert all(7.0 < x["position_km"] < 7.6 and x["longitude"] == 8.6 for x in slides)
    slid = next(a for a in applications if a["slide_list"])
    first_slide = slid["slide_list"][0]
    assert slid["slide_start_s"] == first_slide["start_s"] > slid["start_s"]
    assert slid["slide_position_km"] == first_slide["position_km"] > slid["position_km"]

    features = json.loads((tmp_path / map_).read_text("utf-8"))["features"]
    assert result["outputs"]["geojson"] == map_
    kinds = [f["properties"]["kind"] for f in features]
    assert kinds == ["run", "stop", *["slide"] * len(slides)]
    first, *_, last = features[0]["geometry"]["coordinates"]
    assert first == [8.6, 50.0]  # longitude, then latitude
    assert last[1] == pytest.approx(applications[0]["latitude"], abs=0.01)
    again = json.loads(run("stops", result["outputs"]["mcap"], "--json").stdout)
    of_place = ("time", "position_m", "latitude", "longitude")
    assert [again["stops"][0][x] for x in of_place] == [stop[x] for x in of_place]
    page = "out.html"
    assert run("report", result["outputs"]["mcap"], "-o", page).returncode == 0
    text = (tmp_path / page).read_text("utf-8")
    assert 'id="places-adhesion"' in text
    assert 'id="places-map"' in text
    rows = parquet.read_table(tmp_path / table).to_pylist()
    assert [row["position_km"] for row in rows] == [a["position_km"] for a in applications]
    assert rows[0]["time"].startswith("2026-03-05T06:30")


def test_screens_show_the_clock_and_the_kilometres(run: Run, log: Path) -> None:
    vehicle, table, *_ = run("stops", str(log)).stdout.split("\n\n")
    assert vehicle.startswith("Vehicle: ")
    lines = table.splitlines()
    assert lines[0].split()[:6] == ["stop", "group", "at", "[s]", "clock", "km"]
    assert "06:30:" in lines[2]


def test_a_map_needs_coordinates(run: Run, tmp_path: Path) -> None:
    bare = SAMPLE.with_name("service-brake.csv")
    refused = run("stops", str(bare), "--geojson", "map.geojson")
    assert refused.returncode == 1
    assert "no latitude and longitude" in refused.stderr
    assert not (tmp_path / "map.geojson").exists()
    refused = run("stops", str(bare), "--geojson", "map.kml")
    assert refused.returncode == 2
    assert "--geojson map.geojson" in refused.stderr


def test_of_several_logs_the_map_has_those_with_coordinates(
    run: Run, log: Path, tmp_path: Path
) -> None:
    bare = SAMPLE.with_name("service-brake.csv")
    done = run("stops", str(log), str(bare), "--geojson", "map.geojson")
    assert done.returncode in (0, 3), done.stderr
    features = json.loads((tmp_path / "map.geojson").read_text("utf-8"))["features"]
    assert {f["properties"]["log"] for f in features} == {log.name}


def test_the_map_of_a_series_has_the_groups_of_its_plan(
    run: Run, log: Path, tmp_path: Path
) -> None:
    plan = '[group.wet]\nlogs = ["line.csv"]\nlabel = "new pads"\n'
    (tmp_path / "plan.toml").write_text(plan)
    run("stops", str(log), "--plan", "plan.toml", "--geojson", "map.geojson")
    features = json.loads((tmp_path / "map.geojson").read_text("utf-8"))["features"]
    named = {(f["properties"]["kind"], f["properties"]["group"]) for f in features}
    assert named == {("run", "wet"), ("stop", "wet"), ("slide", "wet")}
    assert {f["properties"]["label"] for f in features} == {"new pads"}
    run("stops", str(log), "--geojson", "map.geojson", "--force")
    features = json.loads((tmp_path / "map.geojson").read_text("utf-8"))["features"]
    assert not any({"group", "label"} & set(f["properties"]) for f in features)


def test_inspect_names_places_that_jump(run: Run, log: Path, tmp_path: Path) -> None:
    head, *rows = log.read_text("utf-8").splitlines()
    later = [row.replace(",7.", ",97.") for row in rows[100:]]
    jumped = tmp_path / "jumped.csv"
    jumped.write_text("\n".join([head, *rows[:100], *later]) + "\n", encoding="utf-8")
    (inspected,) = json.loads(run("inspect", str(jumped), "--json").stdout)["logs"]
    jump = next(f for f in inspected["findings"] if f["code"] == "position-jumps")
    assert jump["channel"] == "position [km]"
    assert jump["values"]["largest_m"] == pytest.approx(90_000.0, abs=5.0)
