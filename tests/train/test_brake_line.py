"""The line of the deceleration over the pressure, by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.vehicle_logs import blended_log, log

from adhesion_cli.analysis.prepare import align_log
from adhesion_cli.analysis.request import read_log
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.core.physics import force_line, wheelset
from adhesion_cli.train.brake_line import ROTATING, BrakeLine, find_brake_line

TRAIN = replace(
    Vehicle(), lever_ratio=Parameter(8.0, 0.0), axle_mass=Parameter(14e3, 0.0),
    spring_force=Parameter(600.0, 0.0),
)  # fmt: skip


def line_of(path: Path, rotating: Parameter = ROTATING) -> BrakeLine | None:
    settings, log = read_log(path, Settings())
    aligned = align_log(log, settings.vehicle)
    assert aligned.grids
    return find_brake_line(aligned.axles, aligned.grids.coarse, rotating)


def error(found: BrakeLine, vehicle: Vehicle) -> float:
    """Ln of the line's deceleration at its mean brake over the vehicle's own."""
    w, line = wheelset(vehicle, 1), force_line(vehicle)
    K = line.per_pascal * (found.brake + found.zero) - line.at_zero
    return float(np.log(found.slope * found.brake / (w.phi * K * w.rolling / w.mass)))


@pytest.mark.parametrize("seed", range(4))
def test_the_force_at_the_mean_brake_is_the_trains(seed: int, tmp_path: Path) -> None:
    found = line_of(log(tmp_path / "log.csv", TRAIN, seed, 4))
    assert found
    assert abs(error(found, TRAIN)) < 2.0 * found.sigma < 0.3
    assert found.rolling
    assert not found.mixed
    assert not found.differing


def test_a_pause_longer_than_all_that_is_recorded_changes_nothing(tmp_path: Path) -> None:
    path, paused = log(tmp_path / "log.csv", TRAIN, 1, 4), tmp_path / "paused.csv"
    header, *rows = path.read_text().splitlines()
    times = [float(row.split(",")[0]) for row in rows]
    later = [f"{t + 600.0:.3f},{row.split(',', 1)[1]}" for t, row in zip(times, rows, strict=True)]
    paused.write_text("\n".join([header, *rows, *later]) + "\n")
    assert (twice := line_of(paused))
    assert abs(error(twice, TRAIN)) < 2.0 * twice.sigma < 0.3


def test_no_brake_has_no_line(tmp_path: Path) -> None:
    assert line_of(log(tmp_path / "log.csv", TRAIN, applications=0)) is None


def test_a_brake_that_takes_over_at_a_higher_pressure_is_not_alone(tmp_path: Path) -> None:
    found = line_of(blended_log(tmp_path / "log.csv"))
    assert found
    assert found.mixed


def test_the_rotating_mass_is_an_error_of_wheels_that_slide_alone(tmp_path: Path) -> None:
    sure = Parameter(ROTATING.value, 0.0)
    rolls = log(tmp_path / "log.csv", TRAIN)
    assert line_of(rolls, sure) == line_of(rolls)
    slides = simulated.write(tmp_path / "log.csv", simulated.recordings("slippery-stop"))
    w = wheelset(Vehicle(), 1)
    own = Parameter(w.inertia / (w.mass * w.radius**2), 0.0)  # 0.17, far above the usual 0.08
    usual, too_sure, exact = (line_of(slides, rotating) for rotating in (ROTATING, sure, own))
    assert usual
    assert too_sure
    assert exact
    assert 2.0 * too_sure.sigma < abs(error(usual, Vehicle())) < 2.0 * usual.sigma
    assert abs(error(exact, Vehicle())) < exact.sigma
