"""Brake applications: force, coefficient, slides, against simulated truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.samples import analysed_sample

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.core.model import Result
from adhesion_cli.core.physics import G
from adhesion_cli.rail.applications import find_applications
from adhesion_cli.rail.locks import LockLimits

SAMPLES = Path(__file__).parents[2] / "sample_logs"


@pytest.fixture(scope="module")
def low() -> Result:
    return analysed_sample("low-adhesion")


def test_mean_and_highest_force_hold_the_true_ones(low: Result) -> None:
    for axle in low.axles:
        (one,) = find_applications(axle, low.vehicle)
        assert axle.record.truth is not None
        assert one.force_n is not None
        (samples,) = axle.applications
        true = axle.record.truth[samples]
        t = axle.record.t[samples] * 1e-9
        known = np.isfinite(true)
        mean = np.trapezoid(true[known], t[known]) / np.ptp(t[known])
        assert abs(one.force_n.mean - mean) < one.force_n.mean_u95
        assert abs(one.force_n.max - np.nanmax(true)) < one.force_n.max_u95
        assert one.force_n.mean < one.force_n.max


def test_a_highest_value_whose_interval_says_nothing_is_left_out(low: Result) -> None:
    axle = low.axles[2]
    wide = replace(axle.reference, tolerance=np.full_like(axle.reference.force, 2e4))
    (one,) = find_applications(replace(axle, reference=wide), low.vehicle)
    (known,) = find_applications(axle, low.vehicle)
    for x, known_x in ((one.force_n, known.force_n), (one.coefficient, known.coefficient)):
        assert x is not None
        assert known_x is not None
        assert x.max is None
        assert x.max_u95 > known_x.max_u95
        assert known_x.max is not None


def test_the_coefficient_has_the_tolerance_of_the_mass_too(low: Result) -> None:
    (one,) = find_applications(low.axles[2], low.vehicle)
    assert one.force_n is not None
    assert one.coefficient is not None
    mass = low.vehicle.axle_mass
    weight = mass.value * G
    assert one.coefficient.mean == pytest.approx(one.force_n.mean / weight)
    of_force, of_mass = one.force_n.mean_u95 / one.force_n.mean, 1.96 * mass.tolerance / mass.value
    share = one.coefficient.mean_u95 / one.coefficient.mean
    assert share == pytest.approx(np.hypot(of_force, of_mass), rel=1e-3)


def test_slides_belong_to_the_application_in_which_they_begin(low: Result) -> None:
    slid, rolled = (find_applications(low.axles[i], low.vehicle)[0] for i in (0, 2))
    assert slid.slides > 1
    assert not rolled.slides
    assert slid.utilisation is not None
    assert slid.utilisation_ci is not None
    assert slid.utilisation_ci[0] < slid.utilisation < slid.utilisation_ci[1]
    assert 0.9 < slid.utilisation < 1.0
    assert rolled.utilisation is None


def test_every_application_is_one_row_and_noise_does_not_make_the_highest_force() -> None:
    result = analyze(SAMPLES / "service-brake.csv", settings.load(), ["td"])
    (axle,) = result.axles
    (one,) = find_applications(axle, result.vehicle)
    (samples,) = axle.applications
    middle = (samples.start + samples.stop) // 2
    ref = axle.reference
    force, sigma = ref.force.copy(), ref.sigma.copy()
    force[middle], sigma[middle] = 3.0 * force[middle], 2.0 * force[middle]
    noisy = replace(
        axle,
        reference=replace(ref, force=force, sigma=sigma, impulse=None),
        applications=(slice(samples.start, middle), slice(middle, samples.stop)),
    )
    first, second = find_applications(noisy, result.vehicle)
    assert first.end_s <= second.start_s
    for part in (first, second):
        assert part.force_n is not None
        assert one.force_n is not None
        assert part.force_n.max <= one.force_n.max * 1.001


def test_a_wheel_that_locks_for_a_time_has_one_application(low: Result) -> None:
    axle = low.axles[2]
    (whole,) = find_applications(axle, low.vehicle)
    (samples,) = axle.applications
    middle = (samples.start + samples.stop) // 2
    parts = slice(samples.start, middle), slice(middle + 200, samples.stop)
    apart = replace(axle, applications=parts)
    (one,) = find_applications(apart, low.vehicle)
    assert (one.start_s, one.end_s) == (whole.start_s, whole.end_s)
    first, second = (
        find_applications(replace(axle, applications=(x,)), low.vehicle)[0] for x in parts
    )
    assert one.force_n
    assert first.force_n
    assert second.force_n
    assert one.force_n.max == max(first.force_n.max, second.force_n.max)
    means = sorted([first.force_n.mean, second.force_n.mean])
    assert means[0] < one.force_n.mean < means[1]
    released = axle.record.clamping_force.copy()
    released[middle : middle + 200] = 0.0
    record = replace(axle.record, clamping_force=released)
    assert len(find_applications(replace(apart, record=record), low.vehicle)) == 2


def test_the_last_metres_have_no_part_in_the_largest_slip(low: Result) -> None:
    axle = low.axles[0]
    (before,) = find_applications(axle, low.vehicle)
    v, wheel = axle.record.train_speed, axle.record.wheel_speed
    assert v is not None
    assert axle.slip is not None
    (samples,) = axle.applications
    last = np.zeros(len(v), dtype=np.bool_)
    last[samples] = (v[samples] > 0.8) & (v[samples] < 1.5)
    stands = np.where(last, 0.0, wheel)
    slip = np.where(last, 1.0, axle.slip)
    stood = replace(axle, record=replace(axle.record, wheel_speed=stands), slip=slip)
    (after,) = find_applications(stood, low.vehicle)
    assert after.max_slip == before.max_slip
    assert before.max_slip is not None
    assert before.max_slip < 0.9
    (limited,) = find_applications(stood, low.vehicle, limits=LockLimits(speed=0.8))
    assert (limited.locked_s or 0.0) > 0.4
    assert limited.max_slip == 1.0
