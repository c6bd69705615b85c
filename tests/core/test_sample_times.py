"""A channel at the times of another one."""

import numpy as np

from adhesion_cli.core.model import Bools, Channel, Column, Floats
from adhesion_cli.core.sample_times import SampleTimes

MS = 10**6


def channel(
    t_ms: list[int], x: list[float], gap_ms: int, starts: tuple[int, ...] = (0,)
) -> Channel:
    t = np.array(t_ms) * MS
    data = Column(t.astype(np.int64), np.array(x, dtype=float), np.ones(len(x), dtype=bool))
    return Channel("x", "", None, None, "", "", data, starts=starts, gap_ns=gap_ms * MS)


def last_value(t_ms: list[int], c: Channel, *pieces: slice) -> tuple[Floats, Bools]:
    t = np.array(t_ms, dtype=np.int64) * MS
    return SampleTimes(t, pieces or (slice(None),)).last_value(c)


def test_holding_never_shows_a_later_sample() -> None:
    slow = channel([0, 100, 200, 300], [1, 2, 3, 4], 500)
    value, fresh = last_value([-1, 0, 99, 100, 199, 350, 2000], slow)
    assert value[1:6].tolist() == [1, 1, 2, 2, 4]
    assert fresh.tolist() == [False, True, True, True, True, True, False]


def test_interpolation_stops_at_gaps() -> None:
    with_gap = channel([0, 10, 20, 30, 40, 500, 510], [0, 1, 2, 3, 4, 50, 51], 50)
    t = np.array([5, 40, 200, 505], dtype=np.int64) * MS
    value = SampleTimes(t).interpolate(with_gap)
    np.testing.assert_allclose(value, [0.5, 4.0, np.nan, 50.5])


def test_interpolation_ends_with_the_last_sample() -> None:
    """A speed that went on as it was would have a corner there, and a stop a jerk."""
    value = SampleTimes(np.array([10, 11], dtype=np.int64) * MS).interpolate(
        channel([0, 10], [0, 1], 50)
    )
    np.testing.assert_allclose(value, [1.0, np.nan])


def test_pieces_between_jumps_of_the_clock_go_together() -> None:
    """Two of one time each: the second starts anew, and so does the other channel's."""
    two = slice(0, 2), slice(2, 4)
    value, _ = last_value([0, 10, 0, 10], channel([0, 10, 0, 10], [1, 2, 3, 4], 50, (0, 2)), *two)
    assert value.tolist() == [1, 2, 3, 4]
    # Of one more piece, the one that shares time; of two that do, none.
    apart = channel([0, 10, 100, 110, 200, 210], [1, 2, 3, 4, 5, 6], 50, (0, 2, 4))
    value, _ = last_value([0, 10, 200, 210], apart, *two)
    assert value.tolist() == [1, 2, 5, 6]
    both = channel([0, 10, 0, 10, 200, 210], [1, 2, 3, 4, 5, 6], 50, (0, 2, 4))
    value, fresh = last_value([0, 10, 200, 210], both, *two)
    assert np.isnan(value[:2]).all()
    assert fresh.tolist() == [False, False, True, True]
