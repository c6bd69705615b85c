"""The clock and the offset of a train speed."""

from pathlib import Path

import pytest
from helpers import simulated
from helpers.diagnosed import clean, found


@pytest.mark.parametrize("seconds", [-2.0, -1.0, 1.0, 1.8])
@pytest.mark.parametrize("name", ["low-adhesion", "four-axles", "leaf-film"])
def test_the_train_speeds_clock_is_measured(name: str, seconds: float, tmp_path: Path) -> None:
    (told,) = found(simulated.late(clean(name, 1, "as it is"), "train_speed", seconds), tmp_path)
    assert (told.code, told.severity) == ("train-speed-delay", "info")
    measured, doubt = told.values["delay_s"], told.values["delay_u95_s"]
    own = {
        "leaf-film": 0.1,
        "four-axles": -0.025,
    }  # late in the scenario; pulses of a past interval
    assert measured == pytest.approx(seconds + own.get(name, 0.0), abs=0.05 + doubt)


@pytest.mark.parametrize("plus", [-1.0, -0.4, 0.4, 1.0])
@pytest.mark.parametrize("name", ["low-adhesion", "four-axles", "service-brake"])
def test_a_train_speeds_offset_is_no_other_clock(name: str, plus: float, tmp_path: Path) -> None:
    log = simulated.recordings(name, rate=20.0, train=True)
    told = found(simulated.scaled(log, "train_speed", 0, 1.0, plus), tmp_path)
    (offset,) = [f for f in told if f.code.startswith("train-")]
    assert (offset.code, offset.severity) == ("train-speed-offset", "warning")
    measured, doubt = offset.values["offset_mps"], offset.values["offset_u95_mps"]
    assert measured == pytest.approx(plus, abs=doubt)


@pytest.mark.parametrize("way", ["late", "offset"])
def test_a_brake_without_beginning_tells_no_offset_from_a_late_clock(
    way: str, tmp_path: Path
) -> None:
    log = simulated.recordings("paper-constant", rate=20.0, train=True)
    bad = {
        "late": simulated.late(log, "train_speed", 1.0),
        "offset": simulated.scaled(log, "train_speed", 0, 1.0, 1.0),
    }[way]
    (told,) = [f for f in found(bad, tmp_path) if f.code.startswith("train-")]
    assert told.code == "train-speed-delay-or-offset"
    name, unit = ("delay", "s") if way == "late" else ("offset", "mps")
    doubt = told.values[f"{name}_u95_{unit}"]
    assert told.values[f"{name}_{unit}"] == pytest.approx(1.0, abs=0.05 + doubt)
