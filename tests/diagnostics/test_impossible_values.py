"""Speeds, pressures and decelerations that no train has."""

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers import simulated
from helpers.diagnosed import clean, found
from helpers.simulated import Recordings

# What a log is made of, and what is reported of it.
WRONG: dict[str, tuple[str, Callable[[Recordings], Recordings]]] = {
    "pressure in MPa": (
        "pressure-too-high", lambda log: simulated.mislabelled(log, "pressure", "MPa"),
    ),
    "speed tenfold": (
        "speed-too-high", lambda log: simulated.scaled(log, "wheel_speed", 0, 10.0),
    ),
    "time in thousandths": ("deceleration-too-high", lambda log: simulated.slower(log, 1e-3)),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_a_value_that_no_train_has_is_reported(wrong: str, tmp_path: Path) -> None:
    code, change = WRONG[wrong]
    (finding,) = found(change(clean("service-brake", 1, "as it is")), tmp_path)
    assert (finding.code, finding.severity) == (code, "warning")
    if code == "pressure-too-high":
        assert finding.names["units"] == "bar"
