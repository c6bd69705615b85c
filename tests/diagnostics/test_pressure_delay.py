"""A pressure that is delayed against the wheel speed."""

from pathlib import Path

import pytest
from helpers import simulated
from helpers.diagnosed import clean, found


@pytest.mark.parametrize("seconds", [-1.0, 0.4])
@pytest.mark.parametrize("name", ["service-brake", "four-axles"])
def test_a_delay_is_measured(name: str, seconds: float, tmp_path: Path) -> None:
    log = simulated.late(clean(name, 1, "as it is"), "pressure", seconds)
    (finding,) = found(log, tmp_path)
    assert (finding.code, finding.severity) == ("pressure-delay", "warning")
    delay, doubt = finding.values["delay_s"], finding.values["delay_u95_s"]
    assert delay == pytest.approx(seconds, abs=0.02 + doubt)


def test_a_delay_as_of_a_valve_is_a_note(tmp_path: Path) -> None:
    log = simulated.late(clean("service-brake", 1, "as it is"), "pressure", 0.2)
    (finding,) = found(log, tmp_path)
    assert (finding.code, finding.severity) == ("pressure-delay", "info")


@pytest.mark.parametrize("axles", [(3, 4), (4,)])
def test_axles_that_slide_and_are_not_logged_are_no_delay(
    axles: tuple[int, ...], tmp_path: Path
) -> None:
    log = [r for r in clean("low-adhesion", 1, "as it is") if r.axle in (None, *axles)]
    delays = [f for f in found(log, tmp_path) if f.code == "pressure-delay"]
    assert all(f.severity == "info" and f.names["why"] for f in delays)
