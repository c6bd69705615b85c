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
from helpers.simulated import Recordings

from adhesion_cli.core.finding import Finding


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
