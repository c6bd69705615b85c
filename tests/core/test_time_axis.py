from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.core import time_axis
from adhesion_cli.core.model import Channel, Column

MS = 10**6


def column(t_ms: list[float], values: list[float] | None = None) -> Column:
    t = np.array([round(x * MS) for x in t_ms], dtype=np.int64)
    value = np.arange(len(t), dtype=float) if values is None else np.array(values, dtype=float)
    return Column(t, value, np.isfinite(value))


def codes(axis: time_axis.TimeAxis) -> dict[str, int]:
    return {f.code: f.count for f in axis.findings}


def channel(axis: time_axis.TimeAxis) -> Channel:
    return Channel("x", "", None, None, "", "", axis.data, starts=axis.starts, gap_ns=axis.gap_ns)


def test_a_clean_axis_is_left_alone() -> None:
    data = column([10.0 * i for i in range(50)])
    axis = time_axis.clean("x", data, 0)
    assert not axis.findings
    assert axis.starts == (0,)
    assert axis.interval_ns == 10 * MS
    np.testing.assert_array_equal(axis.data.t, data.t)


def test_a_gap_is_found_and_located() -> None:
    axis = time_axis.clean("x", column([*range(0, 500, 10), *range(900, 1400, 10)]), 0)
    (finding,) = axis.findings
    assert (finding.code, finding.count, finding.spans) == ("gap", 1, ((0.49, 0.9),))
    assert finding.values == {"longest_s": 0.41, "limit_s": 1.0}
    assert axis.gaps == 1


def test_many_gaps_are_joined_where_least_is_between_them() -> None:
    t = [x for k in range(100) for x in range(100 * k, 100 * k + 50, 1)]
    far = [t[-1] + 2000 + x for x in range(50)]
    (gap,) = time_axis.clean("x", column([*t, *far]), 10 * MS).findings
    assert (gap.count, len(gap.spans)) == (100, 20)
    assert gap.spans[-1] == (9.939, 11.939)
    assert gap.spans[0][0] == 0.039
    assert all(b < c for (_, b), (c, _) in pairwise(gap.spans))


def test_missing_single_samples_are_no_gap() -> None:
    axis = time_axis.clean("x", column([t for t in range(0, 1000, 10) if t % 70]), 0)
    assert not axis.findings


def test_bursts_are_no_gaps() -> None:
    t = [100.0 * (i // 10) + (i % 10) for i in range(400)]
    assert not time_axis.clean("x", column(t), 0).findings


def test_equal_duplicates_are_dropped_and_different_ones_masked() -> None:
    axis = time_axis.clean("x", column([0, 10, 10, 20, 30, 30, 40], [0, 1, 1, 2, 3, 9, 4]), 0)
    assert codes(axis) == {"time-duplicate": 1, "time-conflict": 2}
    assert axis.data.value.tolist() == [0, 1, 2, 4]
    assert axis.duplicates == 2


@pytest.mark.parametrize("form", [".1f", ".0f"])
def test_samples_that_came_evenly_are_spread_between_coarse_stamps(form: str) -> None:
    true = np.r_[0:1500, 2500:4000] / 100  # a gap of ten seconds
    t = [1e3 * float(f"{x + 0.033:{form}}") for x in true]
    axis = time_axis.clean("x", column(t, np.sin(true).tolist()), 0)
    assert codes(axis) == {"time-coarse-spread": 3000, "gap": 1}
    assert axis.findings[0].values["rate_hz"] == pytest.approx(100.0, rel=0.01)
    off = axis.data.t * 1e-9 - true
    assert np.ptp(off) < 0.015  # what the stamps leave open is common to all
    assert abs(off.mean()) < 0.55
    np.testing.assert_array_equal(axis.data.value, np.sin(true))


@pytest.mark.parametrize(
    ("sizes", "values"),
    [
        ([7, 9, 12, 8, 5, 9, 11, 8, 7, 12, 3, 9], np.arange(100.0)),
        ([8] * 6 + [4] + [8] * 6, np.arange(100.0)),  # some are missing
        ([8] * 12 + [4], np.tile([1.0, 5.0, 2.0, 7.0], 25)),  # rows of four devices
    ],
)
def test_stamps_too_coarse_to_tell_samples_apart_are_told_once(sizes, values) -> None:
    t = np.repeat(1000.0 * np.arange(len(sizes)), sizes).tolist()
    axis = time_axis.clean("x", column(t, values.tolist()), 0)
    assert codes(axis) == {"time-coarse": 100}
    assert axis.findings[0].values == {"samples": np.median(sizes), "apart_s": 1.0}
    assert axis.findings[0].spans == ((0.0, len(sizes) - 1.0),)
    assert not len(axis.data.t)


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize("rounding", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("lost", [0.0, 0.01])
def test_rounded_stamps_of_a_jittering_cycle_are_put_right(jitter, rounding, lost) -> None:
    rng = np.random.default_rng(4)
    true = 5.0 * np.arange(4000)[rng.random(4000) >= lost]
    stamps = np.maximum.accumulate(true + 5.0 * jitter * rng.standard_normal(len(true)))
    stamps = rounding * np.round(stamps / rounding)
    values = np.sin(true / 1000.0) + 0.01 * rng.standard_normal(len(true))
    axis = time_axis.clean("x", column(stamps.tolist(), values.tolist()), 0)
    if rounding < 10.0 and not jitter:  # no two samples share a stamp
        assert not axis.findings
        return
    assert codes(axis) == {"time-coarse-spread": len(true)}
    assert axis.findings[0].severity == "info"
    assert axis.findings[0].values == {
        "apart_s": rounding * 1e-3,
        "rate_hz": pytest.approx(200.0, rel=0.02),
    }
    off = axis.data.t / MS - true
    assert np.std(off) < (2.5 if lost else 0.8)  # half a cycle where samples are lost
    np.testing.assert_array_equal(axis.data.value, values)


def test_rows_of_another_channel_between_rounded_stamps_are_not_out_of_order() -> None:
    rng = np.random.default_rng(4)
    stamps = 5.0 * np.round(2.5 * np.arange(8000) / 5.0)
    values = np.where(np.arange(8000) % 2, np.sin(stamps / 1000.0), np.nan)
    values[1::2] += 0.01 * rng.standard_normal(4000)
    stamps = np.maximum.accumulate(5.0 * np.round(stamps / 5.0 + rng.normal(0.0, 0.3, 8000)))
    axis = time_axis.clean("x", column(stamps.tolist(), values.tolist()), 0)
    assert set(codes(axis)) <= {"time-coarse-spread", "not-a-number"}
    assert codes(axis)["time-coarse-spread"] == 4000
    assert len(axis.data.t) == 4000


def test_rows_of_a_jittering_cycle_that_are_written_twice_are_no_rounding() -> None:
    rng = np.random.default_rng(4)
    stamps = np.round(10.0 * np.arange(1000) + rng.uniform(-3.0, 3.0, 1000))
    twice = np.repeat(stamps, 1 + (np.arange(1000) % 100 == 50))
    axis = time_axis.clean("x", column(twice.tolist(), twice.tolist()), 0)
    assert codes(axis) == {"time-duplicate": 10}


@pytest.mark.parametrize("stamps", [np.zeros(100), np.repeat([0.0, 10.0, 20.0], 40)])
def test_stamps_that_hardly_move_show_no_cycle(stamps) -> None:
    axis = time_axis.clean("x", column(stamps.tolist(), np.arange(len(stamps)).tolist()), 0)
    assert "time-coarse-spread" not in codes(axis)


def test_two_senders_are_no_rounding() -> None:
    rng = np.random.default_rng(4)
    stamps = np.round(10.0 * np.arange(2000) / 2.0 + rng.uniform(-4.0, 4.0, 2000))
    values = np.tile([20.0, 21.0], 1000) + 0.01 * rng.standard_normal(2000)
    axis = time_axis.clean("x", column(np.sort(stamps).tolist(), values.tolist()), 0)
    assert "time-conflict" in codes(axis)
    assert "time-coarse-spread" not in codes(axis)


def test_one_sample_of_each_stamp_repeated_is_taken_once() -> None:
    t = np.repeat(100.0 * np.arange(30), 10).tolist()
    axis = time_axis.clean("x", column(t, np.repeat(np.arange(30.0), 10).tolist()), 0)
    assert codes(axis) == {"time-duplicate": 270}
    assert axis.data.value.tolist() == list(range(30))
    assert axis.interval_ns == 100 * MS


def test_rows_that_hold_another_channels_sample_share_its_stamp() -> None:
    t = np.repeat(10.0 * np.arange(20), 4)
    for k in range(4):
        values = np.full(80, np.nan)
        values[k::4] = np.arange(20)
        axis = time_axis.clean("x", column(t.tolist(), values.tolist()), 0)
        assert not axis.findings
        assert axis.data.value.tolist() == list(range(20))
        assert axis.data.t.tolist() == (t[::4] * MS).tolist()


def test_each_sample_left_out_is_counted_once() -> None:
    axis = time_axis.clean("x", column([0, 10, 10, 10, 20, 30, 40], [0, 1, 9, 9, 2, 3, 4]), 0)
    assert codes(axis) == {"time-conflict": 3}


def test_a_clock_that_stands_still_is_a_conflict() -> None:
    t = [*range(0, 100, 10), 50, *[100] * 40, *range(110, 200, 10), 190, 150]
    axis = time_axis.clean("x", column([float(x) for x in t]), 0)
    assert codes(axis) == {"time-conflict": 42, "time-out-of-order": 2}


def test_a_wrap_is_located_in_the_continued_time() -> None:
    t = np.arange(2**32 - 3000, 2**32 + 3000, 10) % 2**32
    data = column(t.tolist())
    unwrapped, found = time_axis.unwrapped(data.t)
    assert (np.diff(unwrapped) == 10 * MS).all()
    assert list(found) == ["32-bit millisecond counter"]
    (finding,) = time_axis.clean("x", data, int(unwrapped.min())).findings
    assert (finding.code, finding.first_s) == ("time-wrapped", 3.0)
    assert finding.names == {"counter": "32-bit millisecond counter"}


def test_a_late_sample_is_left_out_and_not_sorted_in() -> None:
    axis = time_axis.clean("x", column([0, 10, 30, 20, 40, 50, 60]), 0)
    assert codes(axis) == {"time-out-of-order": 1}
    assert axis.data.value.tolist() == [0, 1, 2, 4, 5, 6]


@pytest.mark.parametrize("wrong", [0, 1, 50, 98])
def test_one_stamp_far_ahead_costs_one_sample(wrong: int) -> None:
    t: list[float] = [*range(100)]
    t[wrong] = 1_700_000_000
    axis = time_axis.clean("x", column(t), time_axis.earliest(column(t).t))
    assert codes(axis) == {"time-outlier": 1}
    assert axis.starts == (0,)
    assert len(axis.data.t) == 99
    assert axis.findings[0].first_s == pytest.approx(max(wrong - 1, 0) * 1e-3)


def test_times_count_from_the_first_sample_that_is_used() -> None:
    t: list[float] = [100, 101, -99_999, 103, 104, 105]
    assert time_axis.earliest(column(t).t) == 100 * MS
    axis = time_axis.clean("x", column(t), 100 * MS)
    assert [(f.code, f.first_s) for f in axis.findings] == [("time-out-of-order", 1e-3)]


def test_a_clock_that_jumps_back_begins_a_new_piece() -> None:
    axis = time_axis.clean("x", column([*range(0, 300, 10), *range(100, 400, 10)]), 0)
    (finding,) = axis.findings
    assert (finding.code, finding.count, finding.spans) == ("time-backward", 1, ((0.29, 0.29),))
    assert finding.values == {"most_s": 0.19}
    assert axis.starts == (0, 30)
    assert len(axis.data.t) == 60


def test_a_wrapped_millisecond_counter_goes_on() -> None:
    t = [(2**32 - 500 + 10 * i) % 2**32 for i in range(100)]
    axis = time_axis.clean("x", column([float(x) for x in t]), 0)
    assert codes(axis) == {"time-wrapped": 1}
    assert axis.starts == (0,)
    assert np.all(np.diff(axis.data.t) == 10 * MS)


def test_a_counter_that_wraps_between_two_rare_samples_goes_on() -> None:
    t = [(60_000 + 100 * i) % 2**16 for i in range(200)]
    axis = time_axis.clean("x", column([float(x) for x in t]), 0)
    assert codes(axis) == {"time-wrapped": 1}
    assert np.all(np.diff(axis.data.t) == 100 * MS)


def test_numbers_that_are_none_are_counted() -> None:
    data = column([0, 10, 20, 30], [1.0, np.nan, 2.0, 3.0])
    axis = time_axis.clean("x", Column(data.t, data.value, np.ones(4, dtype=np.bool_)), 0)
    assert codes(axis) == {"not-a-number": 1}
    assert axis.data.value.tolist() == [1.0, 2.0, 3.0]


@given(st.lists(st.integers(-50, 50), max_size=60), st.randoms(use_true_random=False))
def test_whatever_the_clock_does_time_rises_within_a_piece(
    steps: list[int], random: object
) -> None:
    t = np.cumsum([0, *steps]).astype(np.int64) * MS
    value = np.arange(len(t), dtype=float) % 3
    axis = time_axis.clean("x", Column(t, value, np.ones(len(t), dtype=np.bool_)), 0)
    bounds = (*axis.starts, len(axis.data.t))
    for a, b in pairwise(bounds):
        assert np.all(np.diff(axis.data.t[a:b]) > 0)
    dropped = sum(
        f.count
        for f in axis.findings
        if f.code
        in (
            "time-out-of-order",
            "time-outlier",
            "time-duplicate",
            "time-conflict",
            "time-coarse",
        )
    )
    assert len(axis.data.t) + dropped == len(t)


def test_channels_of_one_clean_time_share_it() -> None:
    data = column([10.0 * i for i in range(50)])
    assert time_axis.clean("x", data, 0).data.t is data.t


def test_many_jumps_back_are_one_finding() -> None:
    t = [float(x) for k in range(3000) for x in (k, k + 20, k + 40, k + 60)]
    axis = time_axis.clean("x", column(t), 0)
    (told,) = (f for f in axis.findings if f.code == "time-backward")
    assert told.count == len(axis.starts) - 1 == 2999
    assert 1 <= len(told.spans) <= 20
