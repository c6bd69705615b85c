"""A pressure that is late: measured where the wheel rolls, held by sigma, silent elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from test_reference import VEHICLE, logged, share_inside

from adhesion_cli import reference
from adhesion_cli.model import AxleRecord, Reference

SENSORS = {
    "20 Hz": {"rate": 20.0},
    "100 Hz": {"rate": 100.0, "pressure_noise": 500.0},
    "0.1 km/h steps": {"rate": 50.0, "kmh": 0.1, "pressure_noise": 1000.0},
}


def late(record: AxleRecord, seconds: float) -> AxleRecord:
    t = record.t * 1e-9
    K = np.interp(t - seconds, t, record.clamping_force_smooth)
    return replace(record, clamping_force=K, clamping_force_smooth=K)


def computed(
    name: str, seconds: float, method: str = "smoother", **sensor: float
) -> tuple[AxleRecord, Reference]:
    record = late(logged(name, **sensor)[0], seconds)
    return record, reference.compute(record, VEHICLE, method)


@pytest.mark.parametrize("method", reference.METHODS)
@pytest.mark.parametrize("seconds", [-0.1, 0.06, 0.1, 0.2])
@pytest.mark.parametrize("case", SENSORS)
@pytest.mark.parametrize("name", ["service-brake", "four-axles"])
def test_sigma_holds_a_late_pressure(name: str, case: str, seconds: float, method: str) -> None:
    record, F = computed(name, seconds, method, **SENSORS[case])
    assert F.late == pytest.approx(seconds, abs=0.03)  # the rail takes its time, too
    t, K = record.t * 1e-9, record.clamping_force_smooth
    moves = np.abs(np.interp(t + 0.5, t, K) - np.interp(t - 0.5, t, K)) > 500.0
    assert share_inside(F, record.truth, moves) >= 0.9
    assert np.median(F.sigma[~moves]) < 15.0


@pytest.mark.parametrize("case", SENSORS)
@pytest.mark.parametrize("name", ["service-brake", "four-axles", "low-adhesion", "leaf-film"])
def test_no_delay_is_found_where_there_is_none(name: str, case: str) -> None:
    assert computed(name, 0.0, **SENSORS[case])[1].late == 0.0


@pytest.mark.parametrize("name", ["low-adhesion", "leaf-film"])
def test_slides_tell_no_delay(name: str) -> None:
    assert computed(name, 0.1, **SENSORS["100 Hz"])[1].late == 0.0
