"""One axle whose force is not shown, or cannot be."""

from pathlib import Path

import numpy as np
from helpers import simulated
from helpers.diagnosed import analysed, clean

from adhesion_cli.rail.applications import find_applications


def test_a_brake_that_pushes_is_told_with_the_sensor(tmp_path: Path) -> None:
    log = simulated.scaled(clean("low-adhesion", 1, "as it is"), "pressure", 1, 0.3)
    told = [f for f in analysed(log, tmp_path).findings if f.code == "force-negative"]
    assert {f.channel for f in told} == {"axle 1"}
    assert all(f.severity == "warning" and f.first_s > 3.0 for f in told)


def test_a_force_less_sure_than_large_is_not_shown(tmp_path: Path) -> None:
    result = analysed(simulated.recordings("service-brake", rate=10.0, noise=1e7), tmp_path)
    (told,) = [f for f in result.findings if f.code == "reference-noise"]
    assert (told.count, told.channel) == (1, "axle 1")
    (axle,) = result.axles
    assert all(s.rmse_n is None for s in axle.scores)
    assert [a.force_n for a in find_applications(axle, result.vehicle)] == [
        None
    ]  # its slides are still shown
    braked = axle.record.clamping_force > 1000.0
    assert not np.isfinite(axle.reference.force[braked]).any()
