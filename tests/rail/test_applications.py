"""Brake applications: force, coefficient, slides, against simulated truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.core.model import Result
from adhesion_cli.core.physics import G
from adhesion_cli.rail.applications import find_applications

SAMPLES = Path(__file__).parents[2] / "sample_logs"


@pytest.fixture(scope="module")
def low() -> Result:
    stated = settings.load(None, ["analysis.vehicle=stated"])
    return analyze(SAMPLES / "low-adhesion.csv", stated, ["td"])


def test_mean_and_highest_force_hold_the_true_ones(low: Result) -> None:
    for axle in low.axles:
        (one,) = find_applications(axle, low.vehicle)
        assert axle.record.truth is not None
        assert one.force is not None
        true = axle.record.truth[one.samples]
        t = axle.record.t[one.samples] * 1e-9
        known = np.isfinite(true)
        mean = np.trapezoid(true[known], t[known]) / np.ptp(t[known])
        assert abs(one.force.mean - mean) < one.force.mean_u95
        assert abs(one.force.max - np.nanmax(true)) < one.force.max_u95
        assert one.force.mean < one.force.max


def test_the_coefficient_has_the_tolerance_of_the_mass_too(low: Result) -> None:
    (one,) = find_applications(low.axles[2], low.vehicle)
    assert one.force is not None
    assert one.coefficient is not None
    mass = low.vehicle.axle_mass
    weight = mass.value * G
    assert one.coefficient.mean == pytest.approx(one.force.mean / weight)
    of_force, of_mass = one.force.mean_u95 / one.force.mean, 1.96 * mass.tolerance / mass.value
    share = one.coefficient.mean_u95 / one.coefficient.mean
    assert share == pytest.approx(np.hypot(of_force, of_mass), rel=1e-3)


def test_slides_belong_to_the_application_in_which_they_begin(low: Result) -> None:
    slid, rolled = (find_applications(low.axles[i], low.vehicle)[0] for i in (0, 2))
    assert len(slid.slides) > 1
    assert not rolled.slides
    assert slid.utilisation is not None
    assert slid.utilisation.lower < slid.utilisation.value < slid.utilisation.upper
    assert 0.9 < slid.utilisation.value < 1.0
    assert rolled.utilisation is None


def test_every_application_is_one_row_and_noise_does_not_make_the_highest_force() -> None:
    result = analyze(SAMPLES / "service-brake.csv", settings.load(), ["td"])
    (axle,) = result.axles
    (one,) = find_applications(axle, result.vehicle)
    middle = (one.samples.start + one.samples.stop) // 2
    ref = axle.reference
    force, sigma = ref.force.copy(), ref.sigma.copy()
    force[middle], sigma[middle] = 3.0 * force[middle], 2.0 * force[middle]
    noisy = replace(
        axle,
        reference=replace(ref, force=force, sigma=sigma),
        applications=(slice(one.samples.start, middle), slice(middle, one.samples.stop)),
    )
    first, second = find_applications(noisy, result.vehicle)
    assert first.end_ns <= second.start_ns
    for part in (first, second):
        assert part.force is not None
        assert one.force is not None
        assert part.force.max <= one.force.max * 1.001


def test_a_wheel_that_locks_for_a_time_has_one_application(low: Result) -> None:
    axle = low.axles[2]
    (whole,) = find_applications(axle, low.vehicle)
    middle = (whole.samples.start + whole.samples.stop) // 2
    parts = slice(whole.samples.start, middle), slice(middle + 200, whole.samples.stop)
    apart = replace(axle, applications=parts)
    (one,) = find_applications(apart, low.vehicle)
    assert (one.start_ns, one.end_ns) == (whole.start_ns, whole.end_ns)
    first, second = (
        find_applications(replace(axle, applications=(x,)), low.vehicle)[0] for x in parts
    )
    assert one.force
    assert first.force
    assert second.force
    assert one.force.max == max(first.force.max, second.force.max)
    means = sorted([first.force.mean, second.force.mean])
    assert means[0] < one.force.mean < means[1]
    released = axle.record.clamping_force.copy()
    released[middle : middle + 200] = 0.0
    record = replace(axle.record, clamping_force=released)
    assert len(find_applications(replace(apart, record=record), low.vehicle)) == 2
