"""The slides of an axle in a stop: adhesion and energy against truth, and their intervals."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.samples import analysed_sample

from adhesion_cli.analysis.summarise import brake_applications, summarise
from adhesion_cli.core.model import Parameter
from adhesion_cli.core.physics import G
from adhesion_cli.rail.locks import LockLimits
from adhesion_cli.rail.sliding import possible_begin
from adhesion_cli.rail.stop_slides import _utilisation, add_slides


def test_slides_of_a_stop_have_their_initial_adhesion_and_energy() -> None:
    result = analysed_sample("low-adhesion")
    summary = summarise(result, {})
    (stop,) = summary.stops
    axle, row = result.axles[0], stop.axles[0]
    record, t = axle.record, (axle.record.t - result.log.start_ns()) * 1e-9
    assert record.truth is not None
    assert record.train_speed is not None
    radius, weight = result.vehicle.radius(1).value, result.vehicle.axle_mass.value * G
    spans = [
        (x.start_s, x.start_s + x.duration_s)
        for a in summary.axles[0].applications
        for x in a.slide_list
    ]
    first = (t >= spans[0][0]) & (t <= spans[0][0] + 0.1)
    true_initial = np.nanmean(record.truth[first]) / weight
    assert row.initial_coefficient == pytest.approx(true_initial, rel=0.1)
    assert row.initial_coefficient_u95 is not None
    assert abs(row.initial_coefficient - true_initial) < row.initial_coefficient_u95 < 0.02
    power = record.truth * (record.train_speed - radius * record.wheel_speed)
    inside = np.any([(t >= a) & (t <= b) for a, b in spans], axis=0) & np.isfinite(power)
    interval = float(np.median(np.diff(t)))
    assert row.energy_j == pytest.approx(float(np.sum(power[inside])) * interval, rel=0.1)
    used = summary.axles[0].applications[0]
    assert row.utilisation == pytest.approx(used.utilisation, rel=1e-9)
    assert row.utilisation_ci == pytest.approx(used.utilisation_ci, rel=1e-9)
    assert row.max_slip == used.max_slip
    assert (row.locked_s, row.lock_energy_j) == (0.0, None)
    rolled = stop.axles[2]
    assert (rolled.initial_coefficient, rolled.energy_j) == (None, None)


def test_the_initial_adhesion_is_as_uncertain_as_the_brake_force() -> None:
    """While a wheel slides, an error of the brake force goes whole into the adhesion force."""
    result = analysed_sample("low-adhesion")
    braked = brake_applications(result)
    (stop,) = summarise(result, {}, braked).stops
    reference = result.axles[0].reference
    clamping = np.nanmax(result.axles[0].record.clamping_force)
    doubtful = replace(reference, tolerance=reference.tolerance + 0.1 * clamping)
    axles = (replace(result.axles[0], reference=doubtful), *result.axles[1:])
    certain, uncertain = (
        add_slides(stop, x, [*braked.values()], LockLimits()).axles[0].initial_coefficient_u95
        for x in (result, replace(result, axles=axles))
    )
    assert certain is not None
    assert uncertain is not None
    weight = result.vehicle.axle_mass.value * G
    assert uncertain - certain == pytest.approx(1.96 * 0.1 * clamping / weight, rel=0.3)


def test_the_utilisation_of_several_applications_keeps_its_interval() -> None:
    result = analysed_sample("low-adhesion")
    (a, *_) = brake_applications(result)[1]
    one = replace(a, utilisation=0.9, utilisation_ci=(0.8, 0.95), slide_s=1.0)
    other = replace(a, utilisation=0.6, utilisation_ci=(0.5, 0.8), slide_s=2.0)
    unknown = replace(a, utilisation=None, utilisation_ci=None)
    value, interval = _utilisation([one, other, unknown])
    assert value == pytest.approx(0.7)
    assert interval == pytest.approx((0.6, 0.85))
    assert _utilisation([unknown]) == (None, None)


@pytest.mark.parametrize(("share", "earliest"), [(0.0, 10.0), (0.01, 5.0)])
def test_a_slide_that_the_error_of_the_slip_hides_may_be_the_first(
    share: float, earliest: float
) -> None:
    axle = analysed_sample("low-adhesion").axles[0]
    t = (axle.record.t - axle.record.t[0]) * 1e-9
    slip = np.interp(t, [5.0, 5.1, 5.6, 5.7, 10.0, 10.1, 11.0], [0, 0.045, 0.045, 0, 0, 0.2, 0.0])
    no_delay = replace(axle.record, train_speed_late=Parameter(0.0, 0.0))
    doubtful = replace(axle, record=no_delay, slip=slip, slip_noise=None, radius_share=share)
    start = int(np.searchsorted(t, 10.01))
    first, last = possible_begin(doubtful, start, int(np.searchsorted(t, 3.0)))
    assert t[first] == pytest.approx(earliest, abs=0.05)
    assert t[last] == pytest.approx(10.0, abs=0.05)
