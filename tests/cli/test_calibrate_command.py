"""`adhesion calibrate` at the terminal: its document, its files, and that errors write nothing."""

import json
import tomllib
from pathlib import Path

import pytest
from helpers.commands import Run
from helpers.vehicle_logs import STATED, log, true

SET = ["--set", f"vehicle.lever_ratio={STATED.lever_ratio.value}"]


@pytest.fixture
def logs(tmp_path: Path) -> list[str]:
    return [log(tmp_path / f"{i}.csv", true(friction=0.9), i, 2).name for i in range(2)]


def test_document_and_files(logs: list[str], run: Run, tmp_path: Path) -> None:
    told = ["calibrate", *logs, *SET, "--json", "-o", "my.toml"]
    done = run(*told)
    assert done.returncode == 0, done.stderr
    doc = json.loads(done.stdout)
    assert (doc["schema"], doc["logs"], doc["applications"]) == ("adhesion.calibrate/1", 2, 4)
    assert {*doc["parameters"]["friction"]} >= {
        "prior", "prior_u", "posterior", "posterior_u", "unit",
    }  # fmt: skip
    n = len(doc["correlation"]["names"])
    assert [len(row) for row in doc["correlation"]["matrix"]] == n * [n]
    assert doc["band_after_n"] < doc["band_before_n"]
    stated = tomllib.loads((tmp_path / "my.toml").read_text())["vehicle"]
    posterior = doc["parameters"]["friction"]["posterior"]
    assert stated["friction"]["value"] == pytest.approx(posterior, rel=1e-6)
    assert run(*told).returncode == 1  # files exist
    shown = run("calibrate", *logs, *SET)
    assert shown.returncode == 0
    assert "force over mass" in shown.stdout


@pytest.mark.parametrize(
    ("more", "code"),
    [
        (["--set", "vehicle.axle_mass={value = 4797, tolerance = -1}"], 2),
        (["--set", "vehicle.axle_mass={value = 4797, tolerance = 0}"], 2),
        (["--set", "vehicle.friction=nan"], 2),
        (["--set", "vehicle.correlation.friction.axle_mass=2"], 2),
    ],
)
def test_errors_write_nothing(
    more: list[str], code: int, logs: list[str], run: Run, tmp_path: Path
) -> None:
    done = run("calibrate", *logs, *SET, "-o", "my.toml", *more)
    assert done.returncode == code
    assert "hint" in done.stderr
    assert sorted(p.name for p in tmp_path.glob("*.*")) == ["0.csv", "1.csv"]
