"""A pressure at the end of its range, or lost: left out, and reported once."""

from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import analysed, clean, found, outside, warned
from helpers.grids import thinned

from adhesion_cli.rail.applications import find_applications


def test_a_pressure_lost_on_a_single_axle_is_a_warning(tmp_path: Path) -> None:
    log = [r for r in simulated.recordings("service-brake", train=False) if r.axle in (None, 1)]
    lost = simulated.put(log, "pressure", 0, simulated.during(10.0, 6.0), 0.0)
    told = [f for f in analysed(lost, tmp_path).findings if f.code.startswith("pressure-")]
    assert "warning" in {f.severity for f in told}


@pytest.mark.parametrize(
    ("name", "share"), thinned(3, ["service-brake", "low-adhesion"], [0.5, 0.8])
)
def test_a_saturated_pressure_leaves_the_band_open(name: str, share: float, tmp_path: Path) -> None:
    whole = clean(name, 1, "as it is")
    assert all(np.isfinite(a.reference.upper).sum() == np.isfinite(a.reference.force).sum()
               for a in analysed(whole, tmp_path).axles)  # fmt: skip
    result = analysed(simulated.saturated(whole, share), tmp_path)
    assert "pressure-saturated" in warned(result.findings)
    for a in result.axles:
        assert a.record.pressure is not None
        ends = a.record.pressure >= a.record.pressure.max()
        known = np.isfinite(a.reference.force)
        assert (ends & known).any()
        assert (np.isfinite(a.reference.upper) == (known & ~ends)).all()
        for x in find_applications(a, result.vehicle):
            t = a.record.t / 1e9
            braked = (t >= x.start_s) & (t <= x.end_s)
            assert (x.coefficient is None) == bool(ends[braked].any())
    assert outside(result) < 0.1


@pytest.mark.parametrize(
    ("name", "axles", "share"),
    thinned(3, ["service-brake", "four-axles"], [(1,), (1, 2, 3, 4)], [0.5, 0.9]),
)
def test_what_follows_of_a_saturated_pressure_is_not_told_beside_it(
    name: str, axles: tuple[int, ...], share: float, tmp_path: Path
) -> None:
    whole = clean(name, 1, "as it is")
    ends = simulated.saturated(whole, share)
    log = [bad if r.axle in (None, *axles) else r for r, bad in zip(whole, ends, strict=True)]
    assert {f.code for f in found(log, tmp_path)} == {"pressure-saturated"}
