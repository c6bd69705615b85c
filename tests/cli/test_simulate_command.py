"""`adhesion simulate` as users run it, and what the other commands make of its logs."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.channels.log import read
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.results.wide_table import writer
from adhesion_cli.wsp import simulate

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.mark.parametrize(
    ("name", "suffix"),
    [
        ("paper-constant", ".csv"),
        ("service-brake", ".mcap"),
        ("leaf-film", ".csv"),
        ("leaf-film", ".mcap"),
        ("four-axles", ".csv"),
        ("four-axles", ".mcap"),
        ("roller-rig", ".csv"),
    ],
)
def test_what_is_written_is_read_with_its_meaning(name: str, suffix: str, tmp_path: Path) -> None:
    """Every sensor's samples come back in SI, on their own stamps, with the truth recognised."""
    simulation = simulate.run(simulate.load(name))
    path = tmp_path / f"log{suffix}"
    writer(path)(path, simulate.as_log(simulation))
    log = read(open_source(path, ReadOptions()), (), simulation.scenario.vehicle)
    found = {(c.meaning, c.axle): c for c in log.channels}
    many = simulation.scenario.train.axles > 1  # a single axle is not numbered
    sensed = {
        ("true_slip" if r.signal == "slip" else r.signal, r.axle if many else None): r
        for r in simulate.log(simulation)
    }
    assert set(found) == set(sensed)
    for key, recording in sensed.items():
        channel, signal = found[key], recording.signal
        assert channel.unit == recording.unit
        known = np.isfinite(recording.value)  # there is no slip at standstill
        assert abs(channel.data.t - recording.t[known]).max() <= 1
        if signal in ("truth", "slip"):
            assert channel.data.value == pytest.approx(recording.value[known], rel=1e-12)


def test_simulate_writes_a_log_that_analyze_scores(run: Run, tmp_path: Path) -> None:
    done = run("simulate", "service-brake", "-o", "brake.csv")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("wrote brake.csv: 3 channels")
    first = (tmp_path / "brake.csv").read_bytes()
    refused = run("simulate", "service-brake", "-o", "brake.csv")
    assert refused.returncode == 1
    assert "--force" in refused.stderr
    assert (tmp_path / "brake.csv").read_bytes() == first
    again = run("simulate", "service-brake", "-o", "brake.csv", "--force", "--json")
    assert json.loads(again.stdout)["schema"] == "adhesion.simulate/1"
    assert (tmp_path / "brake.csv").read_bytes() == first
    arguments = ("-o", "brake.csv", "--force", "--seed", "9", "--dt", "0.002", "-q")
    other = run("simulate", "service-brake", *arguments)
    assert other.returncode == 0, other.stderr
    assert (tmp_path / "brake.csv").read_bytes() != first

    analysed = json.loads(run("analyze", "brake.csv", "--json").stdout)
    (axle,) = analysed["results"][0]["axles"]
    assert {e["against"] for e in axle["estimators"]} == {"truth"}
    assert min(e["rmse_n"] for e in axle["estimators"]) < 20.0


def test_scenarios_are_listed(run: Run) -> None:
    listed = json.loads(run("simulate", "--list", "--json").stdout)["scenarios"]
    assert {"paper-constant", "paper-varying", "service-brake", "low-adhesion", "leaf-film",
            "four-axles", "roller-rig"} <= set(listed)  # fmt: skip
    shown = run("simulate", "--list").stdout
    assert max(map(len, shown.splitlines())) <= 80
    words = shown.split()
    assert all(word in words for entry in listed.items() for word in " ".join(entry).split())


@pytest.mark.parametrize(
    ("arguments", "says", "code"),
    [
        (("service-brake",), "-o FILE", 2),
        (("servce-brake", "-o", "a.csv"), "service-brake", 2),
        (("service-brake", "-o", "a.txt"), ".csv, .mcap, .parquet, .xlsx", 2),
        (("service-brake", "-o", "nowhere/a.csv"), "no such folder", 1),
        (("own.toml", "-o", "a.csv"), "shorter", 1),
    ],
)
def test_bad_arguments_are_one_error_and_no_file(
    run: Run, tmp_path: Path, arguments: tuple[str, ...], says: str, code: int
) -> None:
    text = 'description = "long"\nduration = 1e6\n[[rail.section]]\nat = 0.0\ncondition = "dry"\n'
    (tmp_path / "own.toml").write_text(text)
    done = run("simulate", *arguments)
    assert done.returncode == code
    assert says.replace("shorter", "simulate less time") in done.stderr
    assert "Traceback" not in done.stderr
    assert {p.name for p in tmp_path.iterdir()} == {"own.toml"}
