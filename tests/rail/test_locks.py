"""Locks: a wheel that stands while the train is fast, and not only in the last metres."""

from dataclasses import replace

import numpy as np
import pytest

from adhesion_cli.core.model import AxleRecord, Parameter
from adhesion_cli.rail.locks import LockLimits, find_locks, locks_of_axle

T = np.arange(0.0, 40.0, 0.01)
V = np.maximum(20.0 - 0.5 * T, 0.0)
LIMITS = LockLimits()


def stands(start: float, stop: float) -> np.ndarray:
    return np.where((start <= T) & (stop > T), 0.0, V)


def test_a_wheel_that_stands_at_speed_is_locked() -> None:
    (lock,) = find_locks(T, V, stands(10.0, 12.0), LIMITS)
    assert lock.duration == pytest.approx(2.0, abs=0.02)
    assert T[lock.samples.start] == pytest.approx(10.0)


def test_short_times_and_the_last_metres_do_not_count() -> None:
    assert not find_locks(T, V, stands(10.0, 10.3), LIMITS)
    assert not find_locks(T, V, stands(37.0, 40.0), LIMITS)  # from 5.4 km/h on
    assert find_locks(T, V, stands(10.0, 10.3), LockLimits(shortest=0.2))
    assert find_locks(T, V, stands(37.0, 40.0), LockLimits(speed=0.5))


def test_a_lock_up_to_standstill_counts_as_long_as_the_train_is_fast() -> None:
    (lock,) = find_locks(T, V, stands(30.0, 40.0), LIMITS)
    assert V[lock.samples.stop - 1] == pytest.approx(LIMITS.speed, abs=0.01)


def test_a_lock_that_is_sure_lasts_as_long_as_the_train_is_fast_by_its_speed() -> None:
    error = np.full(len(T), 0.4)
    (lock,) = find_locks(T, V, stands(30.0, 40.0), LIMITS, least_v=V - error)
    (exact,) = find_locks(T, V, stands(30.0, 40.0), LIMITS)
    assert lock == exact
    assert not find_locks(T, V, stands(36.5, 40.0), LIMITS, least_v=V - error)


def test_no_lock_reaches_across_segments_or_is_known_without_a_train_speed() -> None:
    t, K = (T * 1e9).astype(np.int64), np.full(len(T), 1e4)
    parts = slice(0, 1100), slice(1100, len(T))
    record = AxleRecord(1, t, K, K, stands(10.0, 12.0) / 0.5, parts, train_speed=V)
    locks = locks_of_axle(record, 0.5, LIMITS)
    assert [x.samples for x in locks] == [slice(1000, 1100), slice(1100, 1200)]
    unknown = AxleRecord(1, t, K, K, stands(10.0, 12.0) / 0.5, parts)
    assert not locks_of_axle(unknown, 0.5, LIMITS)


def test_a_standing_wheel_is_not_locked_where_a_slow_receiver_may_be_late() -> None:
    t, K = (T * 1e9).astype(np.int64), np.full(len(T), 1e4)
    late_v = np.minimum(V + 0.7, 20.0)  # by 1.4 s
    record = AxleRecord(
        1, t, K, K, stands(37.0, 40.0) / 0.5, (slice(0, len(T)),), train_speed=late_v
    )
    assert len(locks_of_axle(record, 0.5, LIMITS)) == 1
    slow = replace(record, train_speed_interval=1.0)
    assert not locks_of_axle(slow, 0.5, LIMITS)
    assert locks_of_axle(replace(slow, train_speed_late=Parameter(0.0, 0.05)), 0.5, LIMITS)
