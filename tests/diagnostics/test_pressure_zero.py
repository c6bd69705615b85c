"""The level of a released brake is the zero of its sensor."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import (
    DEFAULT,
    at_rate,
)
from helpers.pasted import pasted
from helpers.simulated import Recordings

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.analysis.settings import load
from adhesion_cli.channels.log import read
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Floats
from adhesion_cli.formats.memory import MemorySource, Signals


def zeros(log: Recordings, folder: Path) -> list[Finding]:
    return [f for f in simulated.told(log, folder, DEFAULT) if f.code == "pressure-zero"]


@pytest.mark.parametrize("share", [0.08, 0.3])
@pytest.mark.parametrize(
    ("name", "rate"), [("service-brake", 1.0), ("four-axles", 5.0), ("low-adhesion", 1.0)]
)
def test_what_a_released_brake_shows_is_the_sensors_zero(
    name: str, rate: float, share: float, tmp_path: Path
) -> None:
    log = at_rate(name, rate)
    top = max(float(log[i].value.max()) for i in simulated.which(log, "pressure"))
    told = zeros(simulated.pressed(log, 0, lambda _, p: p + share), tmp_path)
    unit = {"bar": 1.0, "kPa": 1e-2}[log[simulated.which(log, "pressure")[0]].unit]
    assert {f.channel.split()[0] for f in told} == {
        log[i].name for i in simulated.which(log, "pressure")
    }
    for f in told:
        assert f.values["level_bar"] == pytest.approx(share * top * unit, rel=0.15)
    assert not zeros(log, tmp_path)


def test_a_zero_below_zero_is_told(tmp_path: Path) -> None:
    log = simulated.pressed(at_rate("service-brake", 20.0), 0, lambda _, p: 0.5 * p - 0.03)
    (told,) = zeros(log, tmp_path)
    assert told.values["level_bar"] < 0.0


def test_a_log_that_begins_with_the_brake_applied_shows_no_zero(tmp_path: Path) -> None:
    log = at_rate("four-axles", 5.0)  # two steps, then a release
    t = log[simulated.which(log, "pressure", 1)[0]].t * 1e-9
    p = log[simulated.which(log, "pressure", 1)[0]].value
    first = float(t[np.argmax(p > 0.5 * p.max())])
    last = float(t[len(p) - 1 - np.argmax(p[::-1] > 0.5 * p.max())])
    cut = [replace(r, t=r.t[k], value=r.value[k]) for r in log
           for k in [(r.t * 1e-9 > first) & (r.t * 1e-9 < last)]]  # fmt: skip
    assert not zeros(cut, tmp_path)


def bogies(second: Floats | float, line: str = "", coasting: float = 0.01) -> list[Finding]:
    """Findings on eight stops whose pressures are two bogies', with an error of the second.

    A train that coasts slows by `coasting` [m/s²].
    """
    t = np.arange(0.0, 800.0, 0.1)
    brake = np.interp(t % 100.0, [60.0, 62.0, 90.0, 92.0], [0.0, 2.0, 2.0, 0.0])
    a = np.where(t % 100.0 < 20.0, 0.6, 0.0) - 0.2 * brake - coasting
    speed = 3.6 * np.maximum(4.0 + np.cumsum(a) * 0.1, 0.0)
    signals = {"BCP bogie 1 [bar]": brake, "BCP bogie 2 [bar]": brake + second}
    signals |= {f"axle {n} [km/h]": speed for n in (1, 2, 3, 4)}
    noise = np.random.default_rng(1)
    signals = {k: v + noise.normal(0.0, 0.005, len(t)) for k, v in signals.items()}
    source = MemorySource(Signals(t, signals))
    loaded = load(assignments=pasted(line), folder=False)
    log = read(source, loaded.mappings, loaded.vehicle)
    found = prepare(log, loaded.vehicle).findings
    return [f for f in found if f.code.startswith("pressure-zero")]


def test_a_zero_beside_another_that_is_right_is_told_with_the_line_that_mends_it() -> None:
    (told,) = bogies(0.1)
    assert told.channel == "BCP bogie 2 [bar]"
    assert told.values["level_bar"] == pytest.approx(0.1, abs=0.003)
    assert "another one at" in told.message
    assert not bogies(0.1, str(told.names["option"]))
    assert not bogies(0.02)


@pytest.mark.parametrize("coasting", [0.0, 0.03])
def test_a_zero_is_told_of_a_brake_without_spring_whatever_the_resistance(coasting: float) -> None:
    (told,) = bogies(0.15, "`--set vehicle.spring_force=0`", coasting)
    assert told.values["level_bar"] == pytest.approx(0.15, abs=0.003)


def test_a_zero_that_drifts_is_told_with_the_line_that_states_its_tolerance() -> None:
    (told,) = bogies(np.linspace(-0.06, 0.06, 8000))
    assert told.code == "pressure-zero-drift"
    assert told.values["last_bar"] - told.values["first_bar"] == pytest.approx(0.09, abs=0.02)
    assert not bogies(np.linspace(-0.06, 0.06, 8000), str(told.names["option"]))


def test_a_cylinder_that_is_released_slowly_has_no_zero_and_no_drift() -> None:
    t = np.arange(0.0, 800.0, 0.1)
    since = np.where(t < 92.0, 92.0, t % 100.0) - 92.0  # each release
    tail = np.where(since > 0.0, 0.3 * np.exp(-since / 2.0), 0.0)
    assert not bogies(tail)
    assert not bogies(tail * (t > 700.0))


def test_a_level_within_the_stated_uncertainty_of_the_zero_is_not_reported() -> None:
    line = '`--set "channels.pressure.zero = {value = 0, tolerance = %s}"`'
    assert bogies(0.3, line % 0.1)
    assert not bogies(0.3, line % 0.2)
