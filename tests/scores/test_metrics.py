"""Metrics as properties: what each one sees, and what it must not mistake for something else."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.core.model import AxleRecord, Floats, Reference, Score
from adhesion_cli.records import brake_applications
from adhesion_cli.scores import metrics

RATES = [10.0, 100.0, 400.0]


def force(t: Floats) -> Floats:
    """Two applications: coast, quick build-up, hold with a slow wave, release."""
    F = np.zeros_like(t)
    for start in (2.0, 16.0):
        F += 5000.0 * (
            np.clip((t - start) / 1.5, 0.0, 1.0) - np.clip((t - start - 8.0) / 1.0, 0.0, 1.0)
        )
        F += 400.0 * np.sin(1.3 * (t - start)) * ((t > start + 1.5) & (t < start + 8.0))
    return F


def times(rate: float, seed: int = 1) -> Floats:
    """Irregular: every interval between a half and one and a half of the nominal."""
    steps = np.random.default_rng(seed).uniform(0.5, 1.5, int(30.0 * rate)) / rate
    return np.cumsum(steps) - steps[0]


def record(
    t: Floats, K: Floats, wheel_speed: Floats | None = None, splits: tuple[int, ...] = ()
) -> AxleRecord:
    edges = [0, *splits, len(t)]
    y = np.full(len(t), 40.0) if wheel_speed is None else wheel_speed
    return AxleRecord(
        1, np.round(t * 1e9).astype(np.int64), K, K, y,
        tuple(slice(a, b) for a, b in pairwise(edges)),
    )  # fmt: skip


def compared(t: Floats, estimate: Floats, target: Floats) -> metrics.EstimateAndTarget:
    r = record(t, force(t) / 0.27)
    c = metrics.compare(r, estimate, target, brake_applications.find_applications(r))
    assert c is not None
    return c


@settings(derandomize=True, max_examples=25, deadline=None)
@given(st.sampled_from(RATES), st.floats(-0.8, 1.5), st.floats(0.3, 2.0), st.floats(-900.0, 900.0))
def test_lag_gain_and_bias_are_told_apart(
    rate: float, late: float, factor: float, offset: float
) -> None:
    t = times(rate)
    c = compared(t, factor * force(t - late) + offset, force(t))
    lag, gain = metrics.measure(c)["lag_s"], metrics.measure(c)["gain"]
    assert lag == pytest.approx(late, abs=0.02 + 0.3 / rate)
    assert gain == pytest.approx(factor, rel=0.03)


@settings(derandomize=True, max_examples=25, deadline=None)
@given(st.sampled_from(RATES), st.floats(-900.0, 900.0))
def test_a_constant_error_is_bias_and_nothing_else(rate: float, offset: float) -> None:
    t = times(rate)
    c = compared(t, force(t) + offset, force(t))
    assert metrics.measure(c)["bias_n"] == pytest.approx(offset)
    assert metrics.measure(c)["rmse_n"] == pytest.approx(abs(offset))
    assert metrics.measure(c)["max_error_n"] == pytest.approx(offset)
    assert metrics.measure(c)["lag_s"] == pytest.approx(0.0, abs=1e-3)
    assert metrics.measure(c)["gain"] == pytest.approx(1.0, abs=1e-3)


def test_noise_shifts_neither_lag_nor_gain() -> None:
    t = times(100.0)
    noise = np.random.default_rng(3).normal(0.0, 500.0, len(t))
    c = compared(t, 0.8 * force(t - 0.25) + noise, force(t))
    assert metrics.measure(c)["lag_s"] == pytest.approx(0.25, abs=0.03)
    assert metrics.measure(c)["gain"] == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize("target", [5000.0, 0.0])
def test_a_constant_target_shows_neither_lag_nor_gain(target: float) -> None:
    t = times(100.0)
    flat = np.full(len(t), target) + np.random.default_rng(2).normal(0.0, 1.0, len(t)) * (
        target > 0
    )
    c = compared(t, flat + np.sin(t), flat)
    assert metrics.measure(c)["lag_s"] is None
    assert metrics.measure(c)["gain"] is None
    assert metrics.response(c) is None


def test_an_unrelated_estimate_has_no_lag() -> None:
    t = times(100.0)
    noise = np.random.default_rng(4).normal(0.0, 2000.0, len(t))
    assert metrics.measure(compared(t, noise, force(t)))["lag_s"] is None


@pytest.mark.parametrize("rate", [20.0, 100.0, 1000.0])
@pytest.mark.parametrize("tau", [0.1, 0.4])
def test_response_is_the_time_to_95_percent_of_a_step(rate: float, tau: float) -> None:
    t = np.arange(0.0, 12.0, 1.0 / rate)
    K = np.where(t >= 2.0, 21000.0, 0.0)
    target = np.where(t >= 2.0, 5400.0, 0.0)
    estimate = 5400.0 * (1.0 - np.exp(-np.maximum(t - 2.0, 0.0) / tau))
    r = record(t, K)
    c = metrics.compare(r, estimate, target, brake_applications.find_applications(r))
    assert c is not None
    assert metrics.response(c) == pytest.approx(tau * np.log(20.0), abs=1.5 / rate)


def test_response_to_a_step_between_two_levels() -> None:
    t = np.arange(0.0, 12.0, 0.01)
    target = np.where(t >= 6.0, 2700.0, 5400.0)
    r = record(t, np.full(len(t), 21000.0))
    late = np.where(t >= 6.35, 2700.0, 5400.0)
    c = metrics.compare(r, late, target, brake_applications.find_applications(r))
    assert c is not None
    assert metrics.response(c) == pytest.approx(0.35, abs=0.011)
    never = metrics.compare(
        r, np.full(len(t), 5400.0), target, brake_applications.find_applications(r)
    )
    assert never is not None
    assert metrics.response(never) is None


@pytest.mark.parametrize("factor", [0.0, 0.8])
def test_an_estimate_that_never_gets_there_has_no_response(factor: float) -> None:
    t = np.arange(0.0, 20.0, 0.01)
    target = np.where((t >= 2.0) & (t < 12.0), 5400.0, 0.0)  # and a release, as high as the step
    r = record(t, target / 0.27)
    c = metrics.compare(r, factor * target, target, brake_applications.find_applications(r))
    assert c is not None
    assert metrics.response(c) is None


@settings(derandomize=True, max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(0.2, 1.0), st.floats(0.0, 200.0))
def test_noise_and_a_release_do_not_choose_the_response(
    seed: int, tau: float, sigma: float
) -> None:
    t = np.arange(0.0, 20.0, 0.01)
    pressed = (t >= 2.0) & (t < 12.0)
    noise = np.random.default_rng(seed).normal(0.0, [[20.0], [sigma / 10.0]], (2, len(t)))
    target = np.where(pressed, 5400.0, 0.0) + noise[0]
    estimate = 5400.0 * (1.0 - np.exp(-np.maximum(t - 2.0, 0.0) / tau)) * (t < 12.0) + noise[1]
    r = record(t, pressed * 2e4)
    c = metrics.compare(r, estimate, target, brake_applications.find_applications(r))
    assert c is not None
    assert metrics.response(c) == pytest.approx(3.0 * tau, rel=0.15)


def test_response_waits_for_the_estimate_to_stay() -> None:
    t = np.arange(0.0, 12.0, 0.01)
    target = np.where(t >= 2.0, 5400.0, 0.0)
    since = t - 2.0
    overshoots = np.where(
        since >= 0.0, 5400.0 * (1.0 - np.exp(-2.0 * since) * np.cos(6 * since)), 0
    )
    r = record(t, target / 0.27)
    c = metrics.compare(r, overshoots, target, brake_applications.find_applications(r))
    assert c is not None
    below = since[(overshoots < 0.95 * 5400.0) & (since > 0.0)]
    assert below[-1] > 1.0 > since[(overshoots > 5400.0)][0]
    assert metrics.response(c) == pytest.approx(below[-1], abs=0.05)


@pytest.mark.parametrize("late", [0.3, 0.8, 1.2, 1.6])
def test_a_periodic_force_is_late_and_not_early(late: float) -> None:
    t = np.arange(0.0, 30.0, 0.01)
    wave = 3000.0 + 1000.0 * np.sin(np.pi * t)
    r = record(t, np.full(len(t), 2e4))
    c = metrics.compare(
        r,
        3000.0 + 1000.0 * np.sin(np.pi * (t - late)),
        wave,
        brake_applications.find_applications(r),
    )
    assert c is not None
    assert metrics.measure(c)["lag_s"] == pytest.approx(late, abs=0.01)
    assert metrics.measure(c)["gain"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("back", [0.5, 5.0, 30.0])
def test_a_clock_set_back_in_mid_brake_does_not_change_the_score(back: float) -> None:
    t = np.arange(0.0, 40.0, 0.01)
    K = np.interp(t, [2.0, 4.0], [0.0, 2e4])
    r = record(np.where(t < 12.0, t, t - back), K, splits=(1200,))
    truth, estimate = 0.27 * K, 0.27 * K + 50.0
    estimate[1200:] -= 5000.0 * np.exp(-(t[1200:] - t[1200]) / 0.3)  # it starts anew
    applications = brake_applications.find_applications(r)
    assert brake_applications.find_start_ups(r, applications) == [
        slice(1200, 1200 + round(100 * brake_applications.START_UP))
    ]
    r = replace(r, truth=truth)
    (score,) = metrics.score_estimates(r, reference(truth), {"late": estimate}, applications)
    assert score.rmse_n == pytest.approx(50.0, rel=0.01)
    assert score.ripple_n is not None


@pytest.mark.parametrize("gaps", [0, 1, 2])
def test_a_gap_in_mid_brake_does_not_change_the_score(gaps: int) -> None:
    t = np.arange(0.0, 40.0, 0.01)
    K = np.interp(t, [2.0, 4.0], [0.0, 2e4])
    at = [1200, 2400][:gaps]
    r = record(t, K, splits=tuple(at))
    truth, estimate = 0.27 * K, 0.27 * K + 50.0
    for first in at:
        since = t[first:] - t[first]
        estimate[first:] = truth[first:] + 50.0 - 5000.0 * np.exp(-since / 0.3)
    r = replace(r, truth=truth)
    applications = brake_applications.find_applications(r)
    assert [s.start for s in brake_applications.find_start_ups(r, applications)] == at
    (score,) = metrics.score_estimates(r, reference(truth), {"late": estimate}, applications)
    assert score.rmse_n == pytest.approx(50.0, rel=0.01)
    assert score.max_error_n == pytest.approx(50.0, rel=0.01)


def test_a_slow_build_up_is_no_step() -> None:
    t = times(100.0)
    assert metrics.response(compared(t, force(t - 0.2), force(t))) is None


@pytest.mark.parametrize("step", [0.0, 300.0])
@pytest.mark.parametrize("rate", [20.0, 500.0])
def test_ripple_is_what_is_quick_and_not_a_step(step: float, rate: float) -> None:
    t = np.arange(0.0, 30.0, 1.0 / rate)
    noise = np.random.default_rng(5).normal(0.0, 30.0, len(t))
    c = compared(t, force(t) + noise + step * (t > 6.0), force(t))
    assert metrics.ripple(c) == pytest.approx(30.0, rel=0.15)
    assert metrics.ripple(compared(t, force(t) + 100.0, force(t))) == pytest.approx(0.0, abs=1e-6)


def spans(r: AxleRecord) -> list[tuple[float, float]]:
    return [
        ((r.t[s][0] - r.t[0]) * 1e-9, (r.t[s][-1] - r.t[0]) * 1e-9)
        for s in brake_applications.find_applications(r)
    ]


@pytest.mark.parametrize("rate", [5.0, 100.0, 1000.0])
@pytest.mark.parametrize("offset", [0.0, 900.0])
@pytest.mark.parametrize("noise", [0.0, 80.0])
def test_applications_are_found_through_offset_and_noise(
    rate: float, offset: float, noise: float
) -> None:
    t = np.arange(0.0, 60.0, 1.0 / rate)
    pressed = np.interp(t, [5, 13, 20, 22, 40, 41, 50, 51], [0, 2e4, 2e4, 0, 0, 9e3, 9e3, 0])
    K = pressed + offset + np.random.default_rng(6).normal(0.0, noise, len(t))
    (a, b), (c, d) = spans(record(t, K))
    assert a == pytest.approx(5.0, abs=0.7)  # the whole slow build-up, and no coasting
    assert b == pytest.approx(23.0, abs=0.7)  # with the tail
    assert c == pytest.approx(40.0, abs=0.7)
    assert d == pytest.approx(52.0, abs=0.7)


def test_a_drag_brake_is_braking_before_and_after_the_stronger_one() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    K = np.interp(t, [30, 31, 40, 41], [8e3, 2e4, 2e4, 8e3])
    assert spans(record(t, K)) == [pytest.approx((0.0, 59.99))]


def test_a_log_that_begins_and_ends_braked_is_one_application() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    (found,) = spans(record(t, 15000.0 + 5000.0 * np.sin(t)))
    assert found == pytest.approx((0.0, 19.99))


def test_wheel_slide_protection_does_not_split_an_application() -> None:
    t = np.arange(0.0, 40.0, 0.01)
    K = np.where((t > 5.0) & (t < 30.0) & (np.mod(t, 4.0) > 1.5), 20000.0, 0.0)
    assert len(spans(record(t, K))) == 1


def test_applications_stay_within_segments_and_out_of_standstill() -> None:
    t = np.arange(0.0, 40.0, 0.01)
    K = np.interp(t, [5, 7], [0, 20000])
    speed = np.maximum(60.0 - 3.0 * np.maximum(t - 5.0, 0.0), 0.0)  # stands from 25 s
    r = record(t, K, speed, splits=(1200,))
    first, second = spans(r)
    assert first == pytest.approx((5.0, 11.99), abs=0.3)
    assert second[0] == pytest.approx(12.0)
    assert second[1] == pytest.approx(25.0, abs=0.1)


@pytest.mark.parametrize("rest", [0.3, 0.5])
def test_a_sensor_that_shows_no_zero_ends_the_application_at_standstill(rest: float) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    K = np.interp(t, [5, 7], [0, 20000])
    noise = np.random.default_rng(1).uniform(-rest, 0.1, len(t))
    speed = 60.0 - 3.0 * np.maximum(t - 5.0, 0.0)  # stands from 25 s
    (span,) = spans(record(t, K, np.maximum(speed, np.maximum(rest + noise, 0.0))))
    assert span == pytest.approx((5.0, 25.0), abs=0.4)


def test_a_wheel_that_creeps_to_its_mark_or_slides_does_not_stand() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    K = np.interp(t, [5, 7], [0, 20000])
    creeping = np.interp(t, [5.0, 24.0, 40.0, 40.2], [58.0, 0.5, 0.5, 0.0])
    (span,) = spans(record(t, K, creeping))
    assert span[1] == pytest.approx(40.1, abs=0.3)
    sliding = record(t, K, np.interp(t, [5.0, 24.0, 30.0, 32.0], [58.0, 0.5, 0.5, 10.0]))
    moving = replace(sliding, train_speed=np.full(len(t), 10.0))
    assert max(stop for _, stop in spans(moving)) > 59.0


def test_coasting_has_no_application() -> None:
    t = np.arange(0.0, 30.0, 0.01)
    noise = np.random.default_rng(7).normal(0.0, 30.0, len(t))
    assert brake_applications.find_applications(record(t, np.maximum(noise, 0.0))) == ()
    assert brake_applications.find_applications(record(t, np.zeros(len(t)))) == ()
    assert brake_applications.find_applications(record(t, np.zeros(len(t)), np.zeros(len(t)))) == ()


def reference(F: Floats) -> Reference:
    return Reference("smoother", "", F, np.ones_like(F), np.ones_like(F))


def test_an_estimate_with_an_uncertainty_is_scored_on_its_band() -> None:
    t = times(50.0)
    r = record(t, force(t) / 0.27)
    estimates = {"sure": force(t) + 100.0, "none": force(t)}
    applications = brake_applications.find_applications(r)
    used = np.r_[applications]
    sigma = np.full(len(t), 50.0)  # too small for an error of 100 N, but at every second sample
    sigma[used[::2]] = 52.0
    found = metrics.score_estimates(
        r, reference(force(t)), estimates, applications, {"sure": sigma}
    )
    none, sure = found
    assert none.band_n is none.within is None
    assert sure.within == pytest.approx(0.5, abs=0.01)
    assert 1.95 * 50.0 < sure.band_n < 1.97 * 52.0
    (pooled, _) = sorted(metrics.pool_scores([found, found]), key=lambda s: s.algo, reverse=True)
    assert (pooled.band_n, pooled.within) == (sure.band_n, sure.within)


@pytest.mark.parametrize("noise", [0.0, 0.3, 30.0])
def test_a_difference_within_the_references_noise_is_marked(noise: float) -> None:
    """The rmse of 100 and 101 N differ by 1 %, and an error of 30 N in stretches of 2 s by more."""
    t = times(50.0)
    r = record(t, force(t) / 0.27)
    of = replace(reference(force(t)), sigma=np.full(len(t), noise))
    estimates = {"a": force(t) + 100.0, "b": force(t) - 101.0, "far": force(t) + 400.0}
    found = metrics.score_estimates(r, of, estimates, brake_applications.find_applications(r))
    assert [s.alike for s in found] == [True, noise > 1.0, False]
    pooled = metrics.pool_scores([found, found])
    assert [s.alike for s in pooled] == [True, noise > 1.0, False]


def test_against_the_truth_only_equals_are_alike() -> None:
    t = times(50.0)
    r = replace(record(t, force(t) / 0.27), truth=force(t))
    estimates = {"a": force(t) + 100.0, "b": force(t) - 100.0, "c": force(t) + 100.1}
    of = replace(reference(force(t)), sigma=np.full(len(t), 1e4))
    found = metrics.score_estimates(r, of, estimates, brake_applications.find_applications(r))
    assert [s.alike for s in found] == [True, True, False]


def test_scores_prefer_truth_and_rank_by_rmse() -> None:
    t = times(50.0)
    r = record(t, force(t) / 0.27)
    estimates = {"far": force(t) + 300.0, "near": force(t) + 100.0, "none": np.full(len(t), np.nan)}
    found = metrics.score_estimates(
        r, reference(force(t)), estimates, brake_applications.find_applications(r)
    )
    assert [s.algo for s in found] == ["near", "far", "none"]
    assert [s.relative for s in found] == [1.0, pytest.approx(3.0), None]
    assert {s.against for s in found} == {"reference"}
    assert found[2] == Score("none", "reference", *[None] * 10)
    known = AxleRecord(
        1,
        r.t,
        r.clamping_force,
        r.clamping_force,
        r.wheel_speed,
        r.segments,
        truth=force(t) + 300.0,
    )
    found = metrics.score_estimates(
        known, reference(force(t)), estimates, brake_applications.find_applications(r)
    )
    assert [s.algo for s in found] == ["far", "near", "none"]
    assert found[0].against == "truth"


def test_samples_without_target_are_left_out() -> None:
    t = times(50.0)
    target = np.where(np.mod(t, 3.0) < 0.5, np.nan, force(t))
    c = compared(t, force(t) + 50.0, target)
    assert metrics.measure(c)["rmse_n"] == pytest.approx(50.0)


def test_every_metric_is_a_column_of_the_score() -> None:
    given = {"algo", "against", "relative", "band_n", "within", "alike", "blocks", "nis"}
    t = np.arange(0.0, 20.0, 0.02)
    every = metrics.measure(compared(t, force(t), force(t)))
    assert set(Score.__dataclass_fields__) - given == set(every)


def test_overall_pools_axles_and_passes_over_those_without_a_score() -> None:
    def score(algo: str, rmse: float | None, worst: float | None = None) -> Score:
        bias = None if rmse is None else rmse / 2.0
        return Score(algo, "truth", rmse, bias, worst, None, None, None, None)

    groups = [
        [score("a", 30.0, -90.0), score("b", 10.0, 20.0)],
        [score("a", 40.0, 80.0), score("b", 50.0, 60.0)],
        [score("a", None), score("b", None)],
    ]
    best, second = metrics.pool_scores(groups)
    assert (best.algo, second.algo) == ("a", "b")
    assert best.rmse_n == pytest.approx(np.sqrt(1250.0))
    assert (best.bias_n, best.max_error_n, best.relative) == (17.5, -90.0, 1.0)
    assert second.relative == pytest.approx(np.sqrt(1300.0 / 1250.0))
    mixed = [*groups, [Score("a", "reference", 5.0, 0.0, 9.0, None, None, None, None)]]
    assert [(s.algo, s.against) for s in metrics.pool_scores(mixed)] == [
        ("a", "truth"), ("b", "truth"), ("a", "reference"),
    ]  # fmt: skip
