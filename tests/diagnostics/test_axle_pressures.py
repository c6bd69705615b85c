"""One pressure against the other axles': reported where it is wrong, and only there."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import DEFAULT, at_rate
from helpers.pasted import pasted
from helpers.simulated import Recordings, pressed

from adhesion_cli.analysis import settings
from adhesion_cli.core.finding import Finding
from adhesion_cli.wsp.simulate import Recording

AXLE_CODES = {
    "axle-pressure-differs", "axle-pressure-share", "pressure-unit-differs",
}  # fmt: skip
AXLE = 3  # does not slide in low-adhesion


def warned(log: Recordings, folder: Path) -> list[Finding]:
    known = {*AXLE_CODES, "pressure-delay", "pressure-too-high", "deceleration-unexplained"}
    told = simulated.told(log, folder, DEFAULT)
    return [f for f in told if f.severity == "warning" and f.code in known]


def delayed(log: Recordings, axle: int, seconds: float) -> Recordings:
    return simulated.late(log, "pressure", seconds, axle)


FAULTS: dict[str, Callable[[Recordings, int], Recordings]] = {
    "offset up": lambda log, i: pressed(log, i, lambda _, p: p + 0.3),
    "drift up": lambda log, i: pressed(log, i, lambda t, p: p + 0.4 * t),
    "drift down": lambda log, i: pressed(log, i, lambda t, p: np.maximum(p - 0.4 * t, 0.0)),
    "lost": lambda log, i: simulated.put(log, "pressure", i, simulated.during(8.0, 2.5), 0.0),
    "held": lambda log, i: simulated.stuck(log, "pressure", i, 3.2, 5.0),
    "cut off": lambda log, i: pressed(log, i, lambda _, p: np.minimum(p, 0.6)),
    "1 s late": lambda log, i: delayed(log, i, 1.0),
    "1.5 s early": lambda log, i: delayed(log, i, -1.5),
    "another unit": lambda log, i: simulated.changed(
        log, "pressure", lambda r: replace(r, unit="kPa"), i
    ),
}
EXPECTED = {
    "late": "axle-pressure-differs",
    "early": "axle-pressure-differs",
    "unit": "pressure-unit-differs",
}
NAMES = ["four-axles", "low-adhesion"]


def told_of_the_axle(name: str, fault: str, rate: float, seed: int, folder: Path) -> None:
    bad = FAULTS[fault](at_rate(name, rate, seed), AXLE)
    told = warned(bad, folder)
    of_axle = [f for f in told if f.channel.startswith(f"bc_pressure_{AXLE}")]
    code = EXPECTED.get(fault.split()[-1])
    frozen = fault in ("lost", "held", "cut off")  # checks of one channel may have found these
    assert frozen or [f for f in of_axle if code in (None, f.code)], told
    assert not [f for f in told if f not in of_axle and f.code in AXLE_CODES], told


@pytest.mark.parametrize("fault", FAULTS)
def test_a_pressure_apart_from_all_others_is_told(fault: str, tmp_path: Path) -> None:
    k = list(FAULTS).index(fault)
    told_of_the_axle(NAMES[k % 2], fault, (5.0, 20.0)[k // 2 % 2], 1, tmp_path)


def test_the_line_on_a_pressure_unit_states_that_of_its_axle(tmp_path: Path) -> None:
    told = warned(FAULTS["another unit"](at_rate("four-axles", 20.0), AXLE), tmp_path)
    (found,) = (f for f in told if f.code == "pressure-unit-differs")
    (stated,) = settings.load(assignments=pasted(str(found.hint)), folder=False).mappings
    assert (stated.meaning, stated.axle, stated.unit) == ("pressure", AXLE, "bar")
    assert not stated.channel  # which would leave the other axles without their own


@pytest.mark.parametrize(("name", "seconds"), [("four-axles", 2.0), ("low-adhesion", -1.0)])
def test_one_late_pressure_is_nothing_of_all(name: str, seconds: float, tmp_path: Path) -> None:
    log = delayed(at_rate(name, 20.0), AXLE, seconds)
    told = [f for f in simulated.told(log, tmp_path, DEFAULT) if f.code != "no-pressure"]
    assert [(f.code, f.channel[:13]) for f in told if f.severity == "warning"] == [
        ("axle-pressure-differs", f"bc_pressure_{AXLE}")
    ]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("rate", [5.0, 20.0, 100.0])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("fault", FAULTS)
def test_every_pressure_apart_is_told(
    fault: str, name: str, rate: float, seed: int, tmp_path: Path
) -> None:
    told_of_the_axle(name, fault, rate, seed, tmp_path)


def halving(log: Recordings, axle: int) -> Recordings:
    """A pressure that loses half of its value until the end of the log."""
    return pressed(log, axle, lambda t, p: p * (1.0 - 0.5 * t))


def slower(log: Recordings, axle: int, seconds: float) -> Recordings:
    """A cylinder that fills and vents through a smaller hole."""

    def change(r: Recording) -> Recording:
        step, y = float(np.median(np.diff(r.t))) * 1e-9, r.value.copy()
        for k in range(1, len(y)):
            y[k] = y[k - 1] + (r.value[k] - y[k - 1]) * min(step / seconds, 1.0)
        return replace(r, value=y)

    return simulated.changed(log, "pressure", change, axle)


@pytest.mark.parametrize(
    ("what", "change"),
    {
        "own share": lambda log: pressed(log, AXLE, lambda _, p: 0.7 * p),
        "slower cylinder": lambda log: slower(log, AXLE, 0.4),
        "a bogie of its own": lambda log: pressed(
            pressed(log, 3, lambda t, p: p * (1.0 - 0.5 * t)),
            4,
            lambda t, p: p * (1.0 - 0.5 * t),
        ),
        "a bogie far behind": lambda log: delayed(delayed(log, 3, 0.8), 4, 0.8),
    }.items(),
)
def test_axles_braked_unlike_each_other_are_no_fault(
    what: str, change: Callable[[Recordings], Recordings], tmp_path: Path
) -> None:
    bad = change(at_rate("four-axles", 20.0))
    assert not [f for f in warned(bad, tmp_path) if f.code in AXLE_CODES], what


@pytest.mark.parametrize(
    ("share", "severity"), [(0.5, "warning"), (0.7, "info"), (1.4, "info"), (2.0, "warning")]
)
def test_a_share_of_its_own_is_said(share: float, severity: str, tmp_path: Path) -> None:
    log = pressed(at_rate("four-axles", 5.0), AXLE, lambda _, p: share * p)
    findings = simulated.told(log, tmp_path, DEFAULT)
    (told,) = [f for f in findings if f.code == "axle-pressure-share"]
    assert (told.severity, told.channel[:13]) == (severity, f"bc_pressure_{AXLE}")
    assert told.values["factor"] == pytest.approx(share, rel=0.05)


def test_two_axles_that_differ_are_both_in_doubt(tmp_path: Path) -> None:
    two = [r for r in at_rate("four-axles", 20.0) if r.axle in (None, 1, 2)]
    told = warned(FAULTS["offset up"](two, 2), tmp_path)
    of_one = [f for f in told if f.code == "axle-pressure-differs"]
    assert {f.channel[:13] for f in of_one} == {"bc_pressure_1", "bc_pressure_2"}
    assert {f.names["reference"] for f in of_one} == {"the other axle"}


def test_the_first_time_is_the_faults(tmp_path: Path) -> None:
    end = float(at_rate("four-axles", 5.0)[0].t[-1]) * 1e-9

    def dips(t: np.ndarray, p: np.ndarray) -> np.ndarray:
        return p * (1.0 - 0.6 * np.maximum(1.0 - np.abs(t * end - 18.0) / 3.0, 0.0))

    bad = pressed(at_rate("four-axles", 5.0), 2, dips)
    (told,) = [f for f in warned(bad, tmp_path) if f.channel.startswith("bc_pressure_2")]
    assert told.code == "axle-pressure-differs"
    assert 15.0 < told.spans[0][0] < 17.0 < told.spans[-1][1] < 21.5
    assert 5 * 1.5 < told.count < 5 * 6.0


@pytest.mark.parametrize(("seconds", "told"), [(2.0, False), (6.0, True)])
def test_slides_between_slow_samples_accuse_no_axle_that_holds(
    seconds: float, told: bool, tmp_path: Path
) -> None:
    """At 1 Hz the others may be vented for two samples in slides that no sample shows."""
    log = at_rate("four-axles", 1.0)
    for axle in (1, 2, 4):
        log = simulated.put(log, "pressure", axle, simulated.during(16.0, seconds), 1.0)
    accused = [f for f in warned(log, tmp_path) if f.channel.startswith("bc_pressure_3")]
    assert bool(accused) == told
