"""Braking without pressure, or with less than the spring takes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import DEFAULT, clean, codes, found

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import force_line
from adhesion_cli.formats.open import open_source
from adhesion_cli.wsp import simulate


def test_a_brake_the_log_does_not_know_is_told(tmp_path: Path) -> None:
    def off(r: simulate.Recording) -> simulate.Recording:
        return replace(r, value=0.0 * r.value)

    log = simulated.changed(clean("service-brake", 1, "as it is"), "pressure", off)
    assert codes(log, tmp_path) == {"brake-unknown"}


@pytest.mark.parametrize("times", [1.05, 2.0])
def test_a_spring_that_takes_the_pressure_is_told_with_both(times: float, tmp_path: Path) -> None:
    log = clean("service-brake", 1, "as it is")
    (bar,) = (float(log[i].value.max()) for i in simulated.which(log, "pressure"))
    line, paper = force_line(Vehicle()), Vehicle().spring_force.value
    force = paper * times * 1e5 * bar * line.per_pascal / line.at_zero
    told = found(log, tmp_path, settings.load(None, [f"vehicle.spring_force={force:g}"]))
    (one,) = [f for f in told if f.code == "pressure-below-spring"]
    assert {f.code for f in told}.isdisjoint({"brake-unknown", "pressure-unit-suspect"})
    assert 0.5 * bar < one.values["pressure_bar"] <= bar
    assert one.values["spring_bar"] == pytest.approx(times * bar, rel=1e-3)


@pytest.mark.parametrize("unit", ["kPa", "Pa"])
def test_the_unit_of_the_pressure_that_was_meant_is_named(unit: str, tmp_path: Path) -> None:
    log = simulated.mislabelled(clean("service-brake", 1, "as it is"), "pressure", unit)
    (finding,) = found(log, tmp_path)
    assert (finding.code, finding.severity) == ("pressure-unit-suspect", "warning")
    assert finding.names["units"] == "bar"


def test_the_unit_is_named_where_the_brake_stays_on_at_standstill(tmp_path: Path) -> None:
    """A pressure that holds a train shows no deceleration, in any unit."""
    t = np.arange(0.0, 36.0, 0.05)
    p = 3.5 * np.clip(t - 5.0, 0.0, 1.0)
    v = 3.6 * np.maximum(25.0 - np.cumsum(1.2 * np.clip(t - 5.0, 0.0, 1.0)) * 0.05, 0.0)
    lines = [f"{a:.2f},{b:.3f},{c:.2f},{c:.2f}" for a, b, c in zip(t, p, v, strict=True)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["time [s],p1 [kPa],v1 [km/h],train speed [km/h]", *lines]))
    one = read(open_source(log, DEFAULT.read), (), DEFAULT.vehicle)
    named = {f.code for f in prepare(one, DEFAULT.vehicle).findings}
    assert "pressure-unit-suspect" in named
    assert "brake-unknown" not in named
