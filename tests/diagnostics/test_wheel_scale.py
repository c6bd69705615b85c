"""A wheel of another diameter than stated."""

from pathlib import Path

import pytest
from helpers import simulated
from helpers.diagnosed import TRUE, clean, found


@pytest.mark.parametrize(
    "scale", [0.9, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.95, 1.05, 1.1))]
)
def test_a_wheels_diameter_is_measured(scale: float, tmp_path: Path) -> None:
    log = simulated.worn(clean("leaf-film", 1, "as it is"), 1, scale)  # in rpm
    (told,) = [f for f in found(log, tmp_path) if f.code not in TRUE["leaf-film"]]
    assert told.code == "wheel-diameter"
    assert told.values["diameter_m"] == pytest.approx(
        0.84 / scale, rel=0.01
    )  # it creeps on a wet rail
    for case, train in (("low-adhesion", True), ("four-axles", False)):
        told = found(simulated.worn(simulated.recordings(case, train=train), 4, scale), tmp_path)[0]
        assert (told.code, told.channel) == (
            "wheel-diameter-in-logger",
            "wheel_speed_4 [km/h]",
        )
