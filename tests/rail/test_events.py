"""Slides: their energy, and how uncertain it is where a wheel is locked."""

import numpy as np
import pytest

from adhesion_cli.rail.events import Slide, over_locks, slides

T = np.arange(0.0, 12.0, 0.01)
SLIP = np.interp(T, [2.0, 3.0, 8.0, 9.0], [0.0, 1.0, 1.0, 0.0])
V = np.full(len(T), 20.0)
LOCKED = SLIP >= 1.0


def slide(force: np.ndarray) -> Slide:
    t = np.round(T * 1e9).astype(np.int64)
    (found,) = slides([slice(0, len(T))], t, V, SLIP, SLIP, force, is_lower_bound=False)
    return found


def test_the_energy_of_a_lock_holds_each_force_between_that_before_and_that_after() -> None:
    true = np.interp(T, [5.0, 5.5], [3000.0, 15000.0])  # the rail changes under the locked wheel
    shown = slide(np.where(LOCKED, np.nan, true))
    energy = float(np.trapezoid(true * SLIP * V, T))
    assert shown.energy is not None
    assert 0.0 < abs(shown.energy - energy) < shown.lock_u95
    assert shown.lock_u95 == pytest.approx(6000.0 * 20.0 * 5.0, rel=0.02)
    same = slide(np.where(LOCKED, np.nan, 3000.0))
    assert same.lock_u95 == 0.0


def test_a_lock_without_a_force_at_one_end_may_have_twice_the_other() -> None:
    shown = slide(np.where(T >= 3.0, np.nan, 3000.0))
    assert shown.energy is not None
    assert shown.lock_u95 == pytest.approx(3000.0 * 20.0 * 5.5, rel=0.02)


def test_a_sliding_wheel_with_its_brake_on_heats_the_rail() -> None:
    shown = slide(np.full(len(T), -2000.0))
    assert shown.energy == 0.0


def test_a_lock_has_a_slip_of_one_whatever_the_noise_of_its_sensor() -> None:
    t = np.round(T * 1e9).astype(np.int64)
    slip = SLIP + np.where(LOCKED, 0.01 * np.sin(50.0 * T), 0.0)
    force = np.where(LOCKED, np.nan, 3000.0)
    (found,) = slides([slice(0, len(T))], t, V, slip, slip, force, is_lower_bound=False)
    assert found.max_slip == 1.0


def test_a_lock_whose_brake_is_vented_has_a_force_between_that_before_and_that_after() -> None:
    force = np.array([1.0, np.nan, np.nan, 4.0, np.nan])
    for brake in (None, np.array([5.0, 5.0, 2.0, 1.0, 1.0])):
        filled, error = over_locks(force, brake)
        assert filled.tolist() == [1.0, 2.0, 3.0, 4.0, 4.0]
        assert error.tolist() == [0.0, 1.5, 1.5, 0.0, 4.0]
    assert np.isnan(over_locks(np.full(5, np.nan), None)[0]).all()
    assert over_locks(np.array([0.0, np.nan]), None)[0].tolist() == [0.0, 0.0]


def test_a_lock_that_a_better_rail_ends_has_the_force_before_it_and_less_than_the_brake() -> None:
    filled, error = over_locks(np.array([1.0, np.nan, np.nan, 9.0]), np.full(4, 5.0))
    assert filled.tolist() == [1.0, 1.0, 1.0, 9.0]
    assert error.tolist() == [0.0, 4.0, 4.0, 0.0]


@pytest.mark.parametrize("rate", [10.0, 100.0])
@pytest.mark.parametrize("error", [-0.004, 0.0, 0.004])
def test_duration_and_largest_slip_of_a_slide_hold_the_true_ones(rate: float, error: float) -> None:
    """The slip is wrong by as much all along, as by the delay of a speed, and sampled anywhere."""
    for shift in np.linspace(0.0, 1.0, 7) / rate:
        x = np.arange(0.0, 12.0, 1.0 / rate) + shift
        true = np.interp(x, [2.0, 2.4, 3.0, 5.0], [0.0, 0.25, 0.1, 0.0])
        t, v = np.round(x * 1e9).astype(np.int64), np.full(len(x), 20.0)
        errors = np.full(len(x), 0.005)
        s = true + error
        columns = t, v, s, s - errors, 0.0 * x
        (found,) = slides([slice(0, len(x))], *columns, False, None, None, errors)
        begin, end = 2.0 + 0.4 * 0.01 / 0.25, 5.0 - 2.0 * 0.01 / 0.1
        assert found.duration_u95 is not None
        assert found.max_slip is not None
        assert found.max_slip_u95 is not None
        assert abs(found.duration - (end - begin)) < found.duration_u95
        assert abs(found.max_slip - 0.25) < found.max_slip_u95 < 0.1
        assert found.duration_u95 < 1.5 / rate + 0.2


def test_slides_with_little_slip_between_do_not_overlap() -> None:
    t = np.arange(0.0, 6.0, 0.02)
    slip = np.interp(t, [1, 1.2, 2, 2.2, 3, 3.2, 4, 4.2], [0, 0.1, 0.1, 0.012, 0.012, 0.1, 0.1, 0])
    errors = np.full(len(t), 0.005)
    v, force = np.full(len(t), 20.0), np.ones(len(t))
    columns = (t * 1e9).astype(np.int64), v, slip, slip - errors, force
    segments = [slice(0, len(t))]
    first, second = slides(segments, *columns, False, None, None, errors)
    assert first.start * 1e-9 + first.duration <= second.start * 1e-9 + 0.03
    assert first.duration == pytest.approx(2.0, abs=1.0)
    for x in (first, second):
        assert x.duration_u95 is not None
        assert x.duration_u95 < 1.2


def test_noise_that_hides_the_ends_of_a_slide_is_in_the_interval_of_its_duration() -> None:
    """A wheel that creeps slowly into its slide, read with a noise of 0.75 %."""
    t, errors = np.arange(0.0, 8.0, 0.02), []
    true = np.interp(t, [2.0, 2.6, 2.8, 3.2, 3.4, 3.6], [0.005, 0.015, 0.12, 0.12, 0.015, 0.005])
    expected = float(np.ptp(t[true > 0.01]))
    noise, lasting = (np.full(len(t), x) for x in (0.015, 0.008))
    for seed in range(20):
        s = true - 0.006 + np.random.default_rng(seed).normal(0.0, 0.0075, len(t))
        columns = (t * 1e9).astype(np.int64), np.full(len(t), 4.0), s, s - lasting, np.ones(len(t))
        found = list(slides([slice(0, len(t))], *columns, False, noise, None, lasting))
        longest = max(found, key=lambda x: x.duration)
        assert longest.duration_u95 is not None
        errors.append((longest.duration - expected) / longest.duration_u95)
        assert longest.duration_u95 < 1.1
    assert np.mean(np.abs(errors) < 1.0) >= 0.9
