"""Where a brake is on."""

from dataclasses import replace

import numpy as np

from adhesion_cli.core.model import AxleRecord, Floats
from adhesion_cli.records.brake_applications import find_applications


def record(speed: Floats, K: Floats) -> AxleRecord:
    """Samples at 10 Hz of wheel speed [rad/s] and of a clamping force [N] that is read off once a
    second.
    """
    n = np.arange(len(speed))
    held = K[n - n % 10]
    line = np.interp(n, n[::10], K[::10])
    return AxleRecord(1, n * 100_000_000, held, line, speed, (slice(0, len(speed)),))


def test_a_brake_that_is_released_as_the_train_starts_is_not_applied() -> None:
    n = np.arange(500)
    t = n / 10.0
    speed = np.interp(t, [0.0, 10.0, 30.0, 33.0, 50.0], [30.0, 30.0, 0.0, 0.0, 30.0])
    K = np.interp(t, [0.0, 9.0, 10.0, 33.0, 34.5, 50.0], [0.0, 0.0, 2e4, 2e4, 0.0, 0.0])
    (only,) = find_applications(record(speed, K))
    assert 85 <= only.start <= 100
    assert 290 <= only.stop <= 310


def test_a_brake_that_slows_a_train_from_its_start_on_is_applied() -> None:
    t = np.arange(300) / 10.0
    speed = np.interp(t, [0.0, 5.0, 6.0, 30.0], [0.0, 0.0, 20.0, 1.0])
    K = np.where(t > 5.0, 2e4, 0.0)
    (only,) = find_applications(record(speed, K))
    assert only.start <= 60
    assert only.stop > 290


def test_a_wheel_that_turns_again_beside_a_train_that_moves_was_locked() -> None:
    t = np.arange(300) / 10.0
    train = np.interp(t, [0.0, 5.0, 25.0, 30.0], [20.0, 20.0, 0.0, 0.0])
    speed = np.where((t > 8.0) & (t < 12.0), 0.0, train / 0.45)
    K = np.where((t > 5.0) & (t < 26.0), 2e4, 0.0)
    locked = replace(record(speed, K), train_speed=train)
    assert sum(x.stop - x.start for x in find_applications(locked)) > 150
