"""What a pressure is by what it does while the train rolls."""

import numpy as np
import pytest

from adhesion_cli.channels.log import read, survey
from adhesion_cli.channels.meaning import Mapping
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Channel, Floats, Log, Parameter, Vehicle
from adhesion_cli.formats.memory import MemorySource, Signals

T = np.arange(0.0, 80.0, 0.1)
BRAKE = np.interp(T, [10.0, 12.0, 40.0, 42.0, 55.0, 57.0], [0.0, 3.0, 3.0, 0.0, 0.0, 3.0])  # bar


def speed(brake: Floats, rolling: Floats | float = -0.05) -> Floats:
    """Of a train that a brake slows by 0.25 m/s² per bar [m/s]."""
    return np.maximum(30.0 + np.cumsum(rolling - 0.25 * brake) * 0.1, 0.0)


def source(names_and_values: dict[str, Floats]) -> MemorySource:
    return MemorySource(Signals(T, names_and_values))


def logged(pressure: Floats, v: Floats, name: str = "pressure [bar]") -> Log:
    return survey(source({name: pressure, "axle 1 [m/s]": v}), (), Vehicle())


def first(log: Log) -> Channel:
    return log.channels[0]


def codes(log: Log) -> list[str]:
    return [f.code for f in log.findings]


@pytest.mark.parametrize("rolling", [-0.2, -0.05, 0.1])
def test_a_pressure_that_falls_as_the_train_slows_is_a_brake_pipe(rolling: float) -> None:
    log = logged(5.0 - 0.5 * BRAKE, speed(BRAKE, rolling))
    assert first(log).meaning == "brake_pipe"
    (finding,) = log.findings
    assert (finding.code, finding.severity) == ("pressure-of-brake-pipe", "info")
    assert finding.values["level_bar"] == pytest.approx(5.0, abs=0.01)


def test_a_pipe_that_stands_higher_than_a_brake_pipe_is_a_main_reservoirs() -> None:
    """It falls slowly, as the brakes take air: no command."""
    signals = {
        "pipe 1 [bar]": 9.0 - 0.02 * T, "pipe 2 [bar]": 5.0 - 0.5 * BRAKE,
        "BC pressure [bar]": BRAKE, "axle 1 [m/s]": speed(BRAKE),
    }  # fmt: skip
    named = {c.name: c for c in survey(source(signals), (), Vehicle()).channels}
    assert named["pipe 1 [bar]"].meaning == "reservoir_pressure"
    assert "stands at 8.2 bar" in named["pipe 1 [bar]"].reason
    assert named["pipe 2 [bar]"].meaning == "brake_pipe"


def test_a_log_whose_only_pressure_is_a_brake_pipe_is_refused_by_name() -> None:
    signals = {"pressure [bar]": 5.0 - 0.5 * BRAKE, "axle 1 [m/s]": speed(BRAKE)}
    with pytest.raises(UserError, match=r"'pressure \[bar\]' is a brake pipe's") as error:
        read(source(signals), (), Vehicle())
    assert error.value.hint == "log the pressure of a brake cylinder, too"
    log = read(source({**signals, "pressure 2 [bar]": BRAKE, "axle 2 [m/s]": speed(BRAKE)}), (),
               Vehicle())  # fmt: skip
    assert [c.name for c in log.channels if c.meaning == "pressure"] == ["pressure 2 [bar]"]


def descent() -> tuple[Floats, Floats]:
    """A brake of 1 to 2.5 bar that holds the speed on a descent, and is never released."""
    brake = 1.7 + 0.7 * np.sin(0.3 * T)
    return brake, speed(brake, 0.25 * 1.7)


def wsp() -> tuple[Floats, Floats]:
    """A stop on a slippery rail: the WSP releases the cylinder again and again."""
    applied = np.interp(T, [8.0, 10.0], [0.0, 3.8])
    vented = np.where((T > 12.0) & (np.sin(2.0 * T) > 0.3), 0.3, 1.0)
    return applied * vented, speed(0.6 * applied)


def parked() -> tuple[Floats, Floats]:
    """A stop, and 5 bar in the cylinder of the standing train."""
    v = speed(BRAKE)
    return np.where(v > 0.0, BRAKE, 5.0), v


@pytest.mark.parametrize("log", [descent, wsp, parked])
def test_a_sound_cylinder_pressure_is_not_suspected(log) -> None:
    pressure, v = log()
    assert first(logged(pressure, v)).meaning == "pressure"
    assert not codes(logged(pressure, v))


def test_the_pressure_of_the_air_is_taken_off() -> None:
    log = logged(BRAKE + 1.013, speed(BRAKE), "BC pressure [bar]")
    assert codes(log) == ["pressure-absolute"]
    assert log.findings[0].values["level_bar"] == pytest.approx(1.013, abs=0.001)
    assert np.allclose(first(log).data.value, 1e5 * BRAKE)
    assert first(log).zero.value == pytest.approx(1.013e5)


@pytest.mark.parametrize("coasting", [2.5, 3.0])
def test_a_train_that_coasts_only_for_a_moment_shows_the_pressure_of_the_air(
    coasting: float,
) -> None:
    brake = np.interp(T, [coasting, coasting + 1.0], [0.0, 3.0])
    log = logged(brake + 1.004, speed(brake, -0.02), "BC pressure [bar]")
    assert codes(log) == ["pressure-absolute"]
    assert np.allclose(first(log).data.value, 1e5 * brake)


def test_without_a_released_brake_or_with_a_stated_zero_it_stays() -> None:
    pressure = np.maximum(BRAKE, 1.0)
    log = logged(pressure, speed(pressure), "BC pressure [bar]")
    assert codes(log) == ["pressure-absolute"]
    assert np.allclose(first(log).data.value, 1e5 * pressure)
    assert 1.96 * first(log).zero.tolerance > 1e5  # the band holds both 0 and 1 bar
    zero = Mapping("pressure", None, "", zero=Parameter(0.0, 0.0))
    signals = {"BC pressure [bar]": BRAKE + 1.013, "axle 1 [m/s]": speed(BRAKE)}
    assert not codes(survey(source(signals), (zero,), Vehicle()))
