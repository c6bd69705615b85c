"""A pressure that releases the brake, and what the finding says to do."""

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import codes
from helpers.vehicle_logs import log

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.model import Parameter, Result, Vehicle

RELEASED = 80.0  # pressure of the released brake [bar]
TRAM = replace(Vehicle(), lever_ratio=Parameter(8.0, 0.0), axle_mass=Parameter(14e3, 0.0))


def means(result: Result) -> list[float]:
    applications = summarise(result, {}).axles[0].applications
    return [a.coefficient.mean or np.nan for a in applications if a.coefficient]


@pytest.mark.parametrize(
    ("unit", "of_bar", "air"),
    [("bar", 1.0, 0.0), ("0.01 bar", 100.0, 0.0), ("kPa abs", 1e2, 101.325)],
)
def test_the_remedy_of_a_brake_that_springs_apply_gives_its_adhesion(
    unit: str, of_bar: float, air: float, tmp_path: Path
) -> None:
    as_air = log(tmp_path / "air.csv", TRAM)
    head, *lines = as_air.read_text().splitlines()
    cells = [line.split(",") for line in lines]
    rows = [f"{t},{air + of_bar * (RELEASED - 20.0 * float(p)):.3f},{v}" for t, p, v in cells]
    path = tmp_path / "springs.csv"
    assert "bar" in head
    path.write_text("\n".join([head.replace("bar", unit), *rows]) + "\n")
    findings = analyze(path, settings.load(), ["td"]).findings
    (finding,) = [f for f in findings if f.code == "pressure-releases-brake"]
    assignments = shlex.split(finding.names["option"].strip("`"))[1::2]
    stated = settings.load(assignments=assignments)
    expected = means(analyze(as_air, settings.load(), ["td"]))
    assert len(expected) == 3
    assert means(analyze(path, stated, ["td"])) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("name", ["service-brake", "low-adhesion"])
def test_a_brake_that_pressure_applies_is_none(name: str, tmp_path: Path) -> None:
    assert "pressure-releases-brake" not in codes(simulated.recordings(name), tmp_path)
