"""The line of the deceleration over the pressure, by itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.vehicle_logs import blended_log, log

from adhesion_cli.analysis.prepare import align_log
from adhesion_cli.analysis.request import open_log, read_log
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.core.physics import force_line, wheelset
from adhesion_cli.train.brake_line import BrakeLine, find_brake_line

TRAIN = replace(
    Vehicle(), lever_ratio=Parameter(8.0, 0.0), axle_mass=Parameter(14e3, 0.0),
    spring_force=Parameter(600.0, 0.0),
)  # fmt: skip


def line_of(path: Path) -> BrakeLine | None:
    settings, source = open_log(path, Settings())
    aligned = align_log(read_log(source, settings), settings.vehicle)
    assert aligned.grids
    return find_brake_line(aligned.axles, aligned.grids.coarse)


@pytest.mark.parametrize("seed", range(4))
def test_the_force_at_the_mean_brake_is_the_trains(seed: int, tmp_path: Path) -> None:
    found = line_of(log(tmp_path / "log.csv", TRAIN, seed, 4))
    assert found
    w, line = wheelset(TRAIN, 1), force_line(TRAIN)
    K = line.per_pascal * (found.brake + found.zero) - line.at_zero
    error = np.log(found.slope * found.brake / (w.phi * K * w.rolling / w.mass))
    assert abs(error) < 2.0 * found.sigma < 0.3
    assert found.rolling
    assert not found.mixed
    assert not found.differing


def test_no_brake_has_no_line(tmp_path: Path) -> None:
    assert line_of(log(tmp_path / "log.csv", TRAIN, applications=0)) is None


def test_a_brake_that_takes_over_at_a_higher_pressure_is_not_alone(tmp_path: Path) -> None:
    found = line_of(blended_log(tmp_path / "log.csv"))
    assert found
    assert found.mixed
