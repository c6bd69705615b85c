"""The reference against known truth: simulated brakes, real sensors' faults, exact solutions."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers import simulated
from helpers.grids import thinned
from helpers.reference_runs import (
    HARD,
    HARD_SLIDING,
    ROLLING,
    SLIDING,
    VEHICLE,
    best_butterworth,
    logged,
    rms,
    share_inside,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.channels.to_si import period_tick
from adhesion_cli.core import physics, signals
from adhesion_cli.core.model import (
    Z95,
    AxleRecord,
    Floats,
    Parameter,
    Vehicle,
    quantities,
)
from adhesion_cli.records import brake_applications
from adhesion_cli.reference import force, noise_fit, pulses, smoother


def averaged(record: AxleRecord, name: str, seed: int = 1) -> AxleRecord:
    """The same log by a sensor that gives the mean since its last reading."""
    true, t = simulated.simulation(name), record.t * 1e-9
    dense, speed = true.t * 1e-9, true.wheel_speed[:, record.axle - 1]
    turned = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2.0 * np.diff(dense))])
    mean = np.diff(np.interp(t, dense, turned)) / np.diff(t)
    noise = np.random.default_rng(seed).normal(0.0, math.sqrt(1e-5), len(mean)) * (mean > 0.0)
    return replace(record, wheel_speed=np.concatenate([speed[:1], mean + noise]))


@pytest.mark.parametrize("case", thinned(4, ROLLING))
def test_service_brake_is_better_than_the_best_filter(case: str) -> None:
    record, _ = logged("service-brake", **ROLLING[case])
    F = force.compute(record, VEHICLE)
    assert rms(F.force - record.truth) < 0.9 * best_butterworth(record, np.isfinite(F.force))


@pytest.mark.parametrize(("name", "case"), thinned(3, ["low-adhesion", "leaf-film"], SLIDING))
def test_slides_are_as_good_as_the_best_filter(case: str, name: str) -> None:
    record, _ = logged(name, **SLIDING[case])
    F = force.compute(record, VEHICLE)
    used = np.isfinite(F.force)
    assert rms((F.force - record.truth)[used]) < 1.1 * best_butterworth(record, used)


@pytest.mark.parametrize(
    ("name", "kmh"),
    thinned(3, ["service-brake", "low-adhesion", "leaf-film", "four-axles"], [0.0, 0.1]),
)
def test_sigma_is_right_while_rolling_and_while_sliding(name: str, kmh: float) -> None:
    """Share of errors within 1.96 sigma near 95 %, in each on its own, and sigma no mere bound."""
    inside, outside = [], []
    for seed in (1, 2, 3):
        record, slides = logged(name, 50.0, seed=seed, kmh=kmh, pressure_noise=1000.0)
        F = force.compute(record, VEHICLE)
        error = np.abs(F.force - record.truth)
        for slide, found in ((False, inside), (True, outside)):
            used = np.isfinite(error) & (slides == slide)
            if used.sum() > 20:
                found += [(np.mean(error[used] < 1.96 * F.sigma[used]), *np.median(
                    [error[used], F.sigma[used]], axis=1))]  # fmt: skip
    for found in (inside, outside):
        if found:
            share, error, sigma = np.mean(found, axis=0)
            assert share >= 0.85
            assert sigma < 12.0 * max(error, 0.5)
    assert bool(outside) == (name in ("low-adhesion", "leaf-film"))


@pytest.mark.parametrize(
    ("name", "case"),
    [
        *(("service-brake", case) for case in HARD.values()),
        *((name, case) for name in ("low-adhesion", "leaf-film") for case in HARD_SLIDING.values()),
    ],
)
def test_sigma_is_right_where_the_log_is_coarse(name: str, case: dict[str, float]) -> None:
    record, _ = logged(name, **case)
    F = force.compute(record, VEHICLE)
    used = np.isfinite(F.force)
    assert share_inside(F, record.truth, used) >= 0.85
    most = 1.3 if case.get("kmh") == 1.0 else 1.0  # a filter chosen knowing the truth may be better
    assert rms((F.force - record.truth)[used]) < most * best_butterworth(record, used)


@pytest.mark.parametrize(("rate", "variance", "gain", "duration"), [
    (50.0, 0.03, 1.2, 0.08), (100.0, 0.01, 1.0, 0.05),
])  # fmt: skip
def test_a_short_peak_in_a_slow_slide_is_no_noise(
    rate: float, variance: float, gain: float, duration: float
) -> None:
    """For a moment the rail grips, and the wheel that slides gains speed."""
    w, start = physics.wheelset(VEHICLE, 1), 20.3
    record, _ = logged("low-adhesion", rate, noise=variance, pressure_noise=500.0)
    assert record.truth is not None
    t = (record.t - record.t[0]) * 1e-9
    gained = gain * np.clip((t - start) / duration, 0.0, 1.0)
    F = force.compute(replace(record, wheel_speed=record.wheel_speed + gained), VEHICLE)
    peak = (t > start) & (t < start + duration)
    highest = record.truth[peak].mean() + gain / duration / w.a
    assert abs(F.force[peak].mean() - highest) < 1.96 * F.sigma[peak].mean()
    assert F.force[peak].max() > 0.8 * highest


@pytest.mark.parametrize("name", ["service-brake", "four-axles"])
def test_a_wheel_that_rolls_shows_the_pressure_between_its_samples(name: str) -> None:
    record, _ = logged(name, 50.0, pressure_rate=1.0, pressure_noise=500.0)
    F = force.compute(record, VEHICLE)
    used = np.isfinite(F.force)
    error = rms((F.force - record.truth)[used])
    assert error < 0.4 * best_butterworth(record, used)
    assert rms(F.sigma[used]) < 2.0 * error
    assert share_inside(F, record.truth, used) >= 0.9


def test_pads_that_lag_the_pressure_are_found_in_a_slide(monkeypatch: pytest.MonkeyPatch) -> None:
    record, _ = logged("low-adhesion", rate=100.0)
    assert record.truth is not None
    t = (record.t - record.t[0]) * 1e-9
    early = {
        name: np.interp(t + 0.04, t, getattr(record, name))
        for name in ("clamping_force", "clamping_force_smooth")
    }

    def error() -> float:
        F = force.compute(replace(record, **early), VEHICLE).force
        return rms((F - record.truth)[np.isfinite(F)])

    assert force.compute(record, VEHICLE).pad_lag == 0.0
    assert 0.03 <= force.compute(replace(record, **early), VEHICLE).pad_lag <= 0.05
    with_lag = error()
    monkeypatch.setattr(force, "_LAGS", (0.0,))
    assert with_lag < 0.5 * error()


@pytest.mark.parametrize(("gain", "slides"), [(0.0, False), (0.01, False), (0.1, True)])
def test_only_a_wheel_that_gains_speed_under_the_brake_shows_the_pads(
    gain: float, slides: bool
) -> None:
    t, zero = np.arange(800) / 100.0, np.zeros(800)
    speed = 60.0 - 6.0 * t + gain * 60.0 * ((t > 3.0) & (t < 3.5))
    run = smoother.UnbrokenRun(t, speed, zero, zero, zero, zero, zero)
    assert force._regains_grip(run, np.full(800, 3e4)) == slides
    assert not force._regains_grip(run, zero)
    vented = np.where((t > 2.9) & (t < 3.6), 0.0, 3e4)  # it regains its speed without brake
    assert force._regains_grip(run, vented) == slides


@pytest.mark.parametrize("brake", [(-1.0, 2.0), (6.0, 9.0)])
def test_a_wheel_that_motors_drive_before_or_after_a_braking_regains_no_grip(
    brake: tuple[float, float],
) -> None:
    t, zero = np.arange(800) / 100.0, np.zeros(800)
    run = smoother.UnbrokenRun(t, 20.0 + 2.0 * t, zero, zero, zero, zero, zero)
    K = np.where((t > brake[0]) & (t < brake[1]), 3e4, 0.0)
    speed = np.where(K > 0.0, 30.0 - 0.5 * t, 20.0 + 2.0 * t)
    assert not force._regains_grip(run._replace(y=speed), K)


@pytest.mark.parametrize(
    ("rate", "sigma", "white", "frequency"), [(200.0, 0.1, 0.0, 9.0), (500.0, 0.01, 0.003, 7.0)]
)
def test_vibration_is_not_taken_for_force(
    rate: float, sigma: float, white: float, frequency: float
) -> None:
    """Its neighbouring readings have nearly the same error, which no white noise has."""
    from scipy import signal  # a second of import, which each process of tests would take

    record, _ = logged("service-brake", rate=rate)
    t = (record.t - record.t[0]) * 1e-9
    rng = np.random.default_rng(6)
    pole = 0.995 * np.exp(2j * np.pi * frequency / rate)
    shaking = signal.lfilter(
        [1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.normal(size=len(t))
    )
    shaking = shaking * sigma / np.std(shaking) + white * rng.normal(size=len(t))
    shaking *= record.wheel_speed > 1.0
    F = force.compute(replace(record, wheel_speed=record.wheel_speed + shaking), VEHICLE)
    assert record.truth is not None
    braked = np.r_[brake_applications.find_applications(record)]
    braked = braked[record.wheel_speed[braked] > 5.0]
    error = (F.force - record.truth)[braked]
    assert math.sqrt(np.mean(error**2)) < 0.02 * np.mean(record.truth[braked])


def test_a_peak_that_is_taken_for_noise_departs_from_the_estimate() -> None:
    """Its speeds are less sure than the others', so the band of the highest force is wider."""
    t, zero = np.arange(500) / 100.0, np.zeros(500)
    jump = np.where((t > 2.0) & (t < 2.05), 0.4, 0.0)
    run = smoother.UnbrokenRun(t, 60.0 - 2.0 * t + jump, zero, zero, zero, zero, zero)
    misfit = force._misfit(run, np.full(500, -2.0))
    assert np.abs(misfit[jump > 0.0]).min() > 0.3
    assert np.abs(misfit[jump == 0.0]).max() < 0.05


def test_a_long_level_beside_dither_counts_once() -> None:
    """A wheel that turns back near the edge of a step: its level of a second is no white noise."""
    y = np.repeat([18.0, 19.0, 20.0, 19.0, 20.0, 19.0, 18.0], [30, 57, 2, 1, 26, 44, 20])
    level, variance = pulses.remove_steps(np.arange(len(y)) * 0.005, y, np.ones(len(y)))
    for run in (slice(30, 87), slice(90, 116)):
        assert np.isfinite(variance[run]).sum() <= pulses._KNOTS + 2
    assert np.abs(level - y).max() <= 0.5


@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_sigma_is_right_where_a_counter_has_few_teeth(rate: float) -> None:
    """Short slides on a film; with more samples the pulses stay the same, and so does the error."""
    record, _ = logged("leaf-film", rate, teeth=100, pressure_noise=1000.0)
    F = force.compute(record, VEHICLE)
    used = np.isfinite(F.force)
    assert share_inside(F, record.truth, used) >= 0.9
    assert rms((F.force - record.truth)[used]) < 800.0


@pytest.mark.parametrize("teeth", [40, 60, 200])
@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_sigma_knows_what_few_pulses_miss_of_a_long_slide(rate: float, teeth: int) -> None:
    record, slides = logged("low-adhesion", rate, teeth=teeth, pressure_noise=500.0)
    F = force.compute(record, VEHICLE)
    used = np.isfinite(F.force)
    assert share_inside(F, record.truth, used & slides) >= 0.9
    assert share_inside(F, record.truth, used & ~slides) >= 0.8
    error = rms((F.force - record.truth)[used])
    assert error < 150.0
    assert rms(F.sigma[used]) < 3.0 * error


def test_a_counts_interval_ends_at_its_stamp_and_a_totals_lies_about_it() -> None:
    record, _ = logged("service-brake", 20.0, teeth=60)
    t, zero = record.t * 1e-9, np.zeros(len(record))
    whole = smoother.UnbrokenRun(t, zero, zero, zero, zero, zero, zero)
    ends = pulses.pulse_means(record, zero, whole, 2)
    about = pulses.pulse_means(
        replace(record, of_totals=True), zero, whole._replace(t=t - 0.025), 2
    )
    assert about.t == pytest.approx(ends.t)
    assert ends.t[:2] == pytest.approx([0.0, 0.1])
    for run in (ends, about):
        assert np.array_equal(run.y, (record.wheel_speed[::2] + record.wheel_speed[1::2]) / 2.0)
        assert run.span == pytest.approx(0.1)


def test_a_mean_lies_beside_the_middle_of_a_random_walks_integral() -> None:
    """By T³/320 times the walk's variance rate: what `smoother` takes a mean's noise to be."""
    random = np.random.default_rng(1)
    n, T = 400, 0.7
    rate = np.cumsum(random.normal(0.0, math.sqrt(T / n), (4000, n)), axis=1)
    level = np.cumsum(rate, axis=1) * (T / n)
    beside = level.mean(axis=1) - level[:, n // 2]
    assert np.var(beside) == pytest.approx(T**3 / 320.0, rel=0.1)


@pytest.mark.parametrize(
    ("sensor", "counts"),
    [
        ({"teeth": 60}, True), ({"teeth": 100}, True), ({"kmh": 1.0, "noise": 1e-2}, False),
        ({"kmh": 0.5}, False), ({"kmh": 0.1}, False), ({"noise": 1e-3}, False),
    ],
)  # fmt: skip
def test_a_pulse_counter_is_known_by_its_pulses(sensor: dict[str, float], counts: bool) -> None:
    for name in ("service-brake", "leaf-film"):
        assert (pulses.counts_together(logged(name, 100.0, **sensor)[0]) > 0) == counts


@pytest.mark.parametrize(("kmh", "rates"), [(1.0, (10.0, 50.0, 200.0)), (0.2, (50.0, 1000.0))])
def test_more_samples_of_coarse_steps_do_no_harm(kmh: float, rates: tuple[float, ...]) -> None:
    errors = []
    for rate in rates:
        record, _ = logged("service-brake", rate, noise=0.0, kmh=kmh, pressure_step=1000.0)
        F = force.compute(record, VEHICLE)
        errors.append(rms(F.force - record.truth))
        assert share_inside(F, record.truth, F.sigma > 0.0) >= 0.85
    assert errors[0] < 12.0
    assert max(errors[1:]) < 1.1 * errors[0]


@pytest.mark.parametrize("pressure_rate", [1.0, 2.0, 5.0])
def test_sigma_covers_what_a_slow_pressure_does_not_show(pressure_rate: float) -> None:
    record, _ = logged(
        "service-brake", 50.0, pressure_rate=pressure_rate, pressure_noise=300.0,
        pressure_step=1000.0,
    )  # fmt: skip
    F = force.compute(record, VEHICLE)
    K = physics.clamping_force(record.pressure, VEHICLE)
    moves = np.convolve(np.abs(np.diff(K, prepend=K[0])) > 300.0, np.ones(101), "same") > 0.0
    assert share_inside(F, record.truth, moves) >= 0.85
    assert share_inside(F, record.truth, ~moves) >= 0.85
    assert np.median(F.sigma[~moves]) < 0.1 * np.max(F.sigma[moves])


@settings(max_examples=30)
@given(st.floats(0.02, 3.0), st.floats(0.0, 1.0), st.sampled_from([-1.0, 1.0]))
def test_a_rounded_ramp_is_known_within_its_motion(rise: float, start: float, way: float) -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 300))
    ramp = 100.0 + start + way * rise * t
    level, variance = pulses.remove_steps(t, np.round(ramp), np.ones(len(ramp)))
    told = np.isfinite(variance)
    assert np.all(np.abs(level - ramp)[told] <= 0.5 + 1e-9)
    sharp = variance < 1.0 / 12.0
    assert np.all(np.abs(level - ramp)[sharp] <= 3.0 * np.sqrt(3.0 * variance[sharp]))
    assert not sharp.any() or rise < 1.5
    most = len(t) - 1  # of the first and the last only one side is known
    assert np.sum(1.0 / variance[told]) >= 12.0 * min(most, rise * (t[-1] - t[0]) - 2.0)


def test_a_pulse_counter_is_not_a_staircase() -> None:
    """5 5 6 5 5 6: the mean is 5.33, not half way between the two levels."""
    y = np.tile([5.0, 5.0, 6.0], 50)
    level, variance = pulses.remove_steps(np.arange(150.0), y, np.ones(150))
    assert np.average(level, weights=1.0 / variance) == pytest.approx(y.mean(), abs=0.02)


@pytest.mark.parametrize("rate", [20.0, 100.0])
@pytest.mark.parametrize("tick", [1e-5, 1e-4])
def test_a_speed_by_the_period_of_pulses_has_the_steps_of_its_timer(
    tick: float, rate: float
) -> None:
    """Whole ticks between pulses: at speed the steps are coarse, and near standstill it waits."""
    record, _ = logged("service-brake", 1000.0, noise=0.0)
    t, teeth = record.t * 1e-9, 80
    turned = np.concatenate([[0.0], np.cumsum(np.diff(t) * record.wheel_speed[1:])])
    at = np.interp(np.arange(turned[-1] * teeth / math.tau) * math.tau / teeth, turned, t)
    at = np.unique(np.round(at / tick))
    speed = math.tau / teeth / (np.diff(at) * tick)
    own = np.arange(t[0], t[-1], 1.0 / rate)
    last = np.searchsorted(at[1:] * tick, own, side="right") - 1
    y = speed[np.maximum(last, 0)]
    shown = period_tick(np.round(y, 5), 0.0)
    assert shown == pytest.approx(tick * teeth / math.tau, rel=1e-4)
    rows = np.round((own - t[0]) * 1000.0).astype(int)
    log = AxleRecord(
        1, record.t[rows], record.clamping_force[rows], record.clamping_force_smooth[rows], y,
        (slice(0, len(rows)),), wheel_period_step=shown,
    )  # fmt: skip
    F = force.compute(log, VEHICLE)
    assert record.truth is not None
    error = F.force - record.truth[rows]
    used = np.isfinite(error)
    assert used.mean() > 0.8
    assert np.mean((np.abs(error) < 1.96 * F.sigma + 0.02 * np.max(record.truth))[used]) > 0.9
    assert tick > 1e-5 or rms(error[used]) < 0.01 * np.max(record.truth)


def test_speeds_that_no_timer_made_have_no_ticks() -> None:
    ramp = np.linspace(30.0, 3.0, 3000)
    noisy = ramp + np.random.default_rng(1).normal(0.0, 0.01, len(ramp))
    for y, step in (
        (ramp, 0.0), (noisy, 0.0), (np.round(ramp, 1), 0.1), (np.round(noisy, 2), 0.01),
        (np.round(ramp / 0.0661) * 0.0661, 0.0661), (np.full(100, 7.0), 0.0), (ramp[:0], 0.0),
    ):  # fmt: skip
        assert period_tick(y, step) == 0.0


def test_wrong_mass_and_friction_change_the_model_not_the_noise() -> None:
    other = replace(VEHICLE, friction=Parameter(0.36, 0.03), axle_mass=Parameter(6500.0, 1.0))
    record, _ = logged("service-brake", 100.0, vehicle=other, pressure_noise=500.0)
    F = force.compute(record, other)
    error = F.force - record.truth
    assert rms(error) < 4.0
    assert np.mean(np.abs(error) < 1.96 * F.sigma) > 0.85


def test_a_step_of_clamping_force_is_not_blurred() -> None:
    t = np.arange(0.0, 8.0, 0.01)
    K = np.where(t >= 3.0, 21000.0, 0.0)
    w = physics.wheelset(VEHICLE, 1)
    truth = w.rolling * w.phi * K
    rate = w.a * (truth - w.phi * K)
    y = 50.0 + np.concatenate([[0.0], np.cumsum(rate[1:] * 0.01)])
    random = np.random.default_rng(1)
    y += random.normal(0.0, 3e-3, len(t))
    K = np.where(K > 0.0, K + random.normal(0.0, 25.0, len(t)), 0.0)
    record = AxleRecord(1, (t * 1e9).astype(np.int64), K, K, y, (slice(0, len(t)),))
    error = np.abs(force.compute(record, VEHICLE).force - truth)
    assert np.max(error[np.abs(t - 2.995) > 0.011]) < 25.0


@pytest.mark.parametrize("method", force.METHODS)
def test_every_method_says_what_it_is_and_is_deterministic(method: str) -> None:
    record, _ = logged("service-brake", 50.0, pressure_noise=500.0)
    first, second = (force.compute(record, VEHICLE, method) for _ in range(2))
    assert first.method == method
    assert first.source
    for name in ("force", "sigma", "lower", "upper"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
        assert np.isfinite(getattr(first, name)).all()
    assert np.all(first.sigma > 0.0)
    assert np.all(first.lower < first.force)
    assert rms(first.force - record.truth) < 20.0


@pytest.mark.parametrize("method", force.METHODS)
def test_butterworth_and_smoother_agree_on_clock_and_epoch(method: str) -> None:
    record, _ = logged("service-brake", 20.0, jitter=0.3)
    later = replace(record, t=record.t + 1_700_000_000_000_000_000)
    assert np.array_equal(
        force.compute(record, VEHICLE, method).force,
        force.compute(later, VEHICLE, method).force,
    )


def test_butterworth_sigma_is_what_noise_it_lets_through() -> None:
    random = np.random.default_rng(3)
    t = (np.arange(2000) * 10_000_000).astype(np.int64)
    K = np.zeros(2000)
    y = 60.0 + random.normal(0.0, 3e-3, 2000)
    F = force.compute(AxleRecord(1, t, K, K, y, (slice(0, 2000),)), VEHICLE, "butterworth")
    assert np.std(F.force[100:-100]) == pytest.approx(float(np.median(F.sigma)), rel=0.25)


def test_segments_stand_alone() -> None:
    """Another segment changes the fitted noise a little, and nothing else."""
    record, _ = logged("service-brake", 50.0, pressure_noise=500.0)
    n = len(record)
    both = replace(record, segments=(slice(0, 500), slice(500, n)))
    moved = replace(both, wheel_speed=record.wheel_speed + np.where(np.arange(n) >= 500, 20.0, 0.0))
    a, b = (force.compute(r, VEHICLE) for r in (both, moved))
    assert np.allclose(a.force, b.force, atol=0.5)
    assert rms(b.force - record.truth) < 4.0


@pytest.mark.parametrize("method", force.METHODS)
def test_no_reference_in_a_short_segment_or_at_standstill(method: str) -> None:
    record, _ = logged("service-brake", 50.0, pressure_noise=500.0)
    n = len(record)
    y = np.where(np.arange(n) < 100, 0.0, record.wheel_speed)
    parted = replace(
        record, wheel_speed=y, segments=(slice(0, 700), slice(700, 702), slice(702, n))
    )
    F = force.compute(parted, VEHICLE, method)
    missing = np.isnan(F.force)
    assert missing.nonzero()[0].tolist() == [*range(100), 700, 701]
    for column in (F.sigma, F.lower, F.upper):
        assert np.array_equal(np.isnan(column), missing)
    assert np.array_equal(signals.standing(parted), np.arange(n) < 100)


def test_a_pass_through_zero_is_no_standstill() -> None:
    t = np.arange(0, 4_000_000_000, 10_000_000)
    y = 2.0 - t * 1e-9
    record = AxleRecord(1, t, 0.0 * t, 0.0 * t, np.abs(y), (slice(0, len(t)),))
    assert not signals.standing(replace(record, wheel_speed=np.abs(5.0 * y))).any()
    assert signals.standing(record).sum() == pytest.approx(41, abs=1)


@pytest.mark.parametrize("rate", [1.0, 30.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("K", [0.0, 15000.0])
def test_constant_signals_without_noise_give_finite_numbers(rate: float, K: float) -> None:
    t = (np.arange(400) / rate * 1e9).astype(np.int64)
    record = AxleRecord(1, t, *np.full((2, 400), K), np.full(400, 50.0), (slice(0, 400),))
    F = force.compute(record, VEHICLE)
    assert np.allclose(F.force, 0.3 * K, atol=1.0)
    assert np.isfinite(F.sigma).all()


@pytest.mark.parametrize("n", [7, 8, 12])
def test_the_shortest_segments_give_finite_numbers(n: int) -> None:
    t = (np.arange(n) * 10_000_000).astype(np.int64)
    K = np.linspace(0.0, 5000.0, n)
    record = AxleRecord(1, t, K, K, 50.0 - 0.01 * np.arange(n), (slice(0, n),))
    F = force.compute(record, VEHICLE)
    assert (np.isfinite([F.force, F.sigma, F.lower, F.upper]) == (n >= 8)).all()


@pytest.mark.parametrize(
    ("name", "rate", "n"), thinned(5, ["service-brake", "low-adhesion"], [10.0, 100.0], [8, 12, 24])
)
def test_a_short_log_knows_its_error(name: str, rate: float, n: int) -> None:
    record, _ = logged(name, rate, pressure_noise=500.0)
    shares = []
    for first in np.linspace(0.1, 0.8, 20) * len(record):
        part = record.extract(slice(int(first), int(first) + n))
        F = force.compute(part, VEHICLE)
        shares.append(share_inside(F, part.truth, np.isfinite(F.force)))
    assert np.nanmean(shares) >= 0.8


@pytest.mark.parametrize("jitter", [0.0, 0.2, 0.49])
def test_white_noise_is_the_same_on_uneven_stamps(jitter: float) -> None:
    random = np.random.default_rng(1)
    t = (np.arange(5000) + random.uniform(-jitter, jitter, 5000)) * 0.01
    y = 90.0 - 2.6 * t + random.normal(0.0, 1e-3, len(t))
    assert math.sqrt(signals.white_noise([(t, y)])) == pytest.approx(1e-3, rel=0.1)


def test_butterworth_knows_a_slow_pressure() -> None:
    record, _ = logged("service-brake", 100.0, pressure_noise=300.0, pressure_rate=2.0)
    F = force.compute(record, VEHICLE, "butterworth")
    error = F.force - record.truth
    assert share_inside(F, record.truth, np.isfinite(error)) >= 0.8
    assert np.median(F.sigma) < 30.0


# --- band ---------------------------------------------------------------------------------------


def exact(**tolerance: float) -> Vehicle:
    """The vehicle with these tolerances and no others."""
    values = {
        name: Parameter(getattr(VEHICLE, name).value, tolerance.get(name, 0.0))
        for name in quantities(Vehicle)
        if name != "wheel_radius"
    }
    R = Parameter(VEHICLE.wheel_radius[0].value, tolerance.get("wheel_radius", 0.0))
    return Vehicle(wheel_radius=(R,), **values)


def test_without_tolerances_the_band_is_noise() -> None:
    record, _ = logged("service-brake", 20.0, pressure_noise=500.0)
    F = force.compute(record, exact())
    assert np.allclose(F.upper - F.force, Z95 * F.sigma)
    assert np.allclose(F.force - F.lower, Z95 * F.sigma)


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("friction", 0.1), ("efficiency", 0.03), ("discs", 0.02), ("lever_ratio", 0.05),
        ("radius_ratio", 0.05), ("spring_force", 0.1), ("cylinder_diameter", 0.01),
        ("wheelset_inertia", 0.05), ("wheel_radius", 0.02),
    ],
)  # fmt: skip
def test_each_tolerance_moves_the_band_as_it_moves_the_force(name: str, share: float) -> None:
    """The band's width against F with the parameter shifted by a tenth of its tolerance."""
    record, _ = logged("low-adhesion", 20.0, noise=1e-12)
    assert record.pressure is not None
    F = force.compute(record, VEHICLE)
    value = (VEHICLE.wheel_radius[0] if name == "wheel_radius" else getattr(VEHICLE, name)).value
    tolerance = share * value
    band = force.compute(record, exact(**{name: tolerance}))
    squared = ((band.upper - band.lower) / 2.0) ** 2 - (Z95 * band.sigma) ** 2
    half = np.sqrt(np.maximum(squared, 0.0))  # rounding
    shifted = Parameter(value + 0.1 * tolerance, 0.0)
    other = replace(VEHICLE, **{name: (shifted,) if name == "wheel_radius" else shifted})
    w, was = physics.wheelset(other, 1), physics.wheelset(VEHICLE, 1)
    K, K_was = (physics.clamping_force(record.pressure, v) for v in (other, VEHICLE))
    acceleration = was.a * (F.force - was.phi * K_was)
    moved = np.abs(w.phi * K + acceleration / w.a - F.force)
    used = np.isfinite(F.force) & ((K_was == 0.0) == (K == 0.0))
    assert half[used] / Z95 == pytest.approx(10.0 * moved[used], rel=0.05, abs=3.0)


def test_a_radius_counts_twice_where_the_log_has_the_rims_speed() -> None:
    record, _ = logged("low-adhesion", 20.0, noise=1e-12)
    known = exact(wheel_radius=0.02 * VEHICLE.wheel_radius[0].value)
    w, by = physics.wheelset(VEHICLE, 1), 1.002  # a tenth of the tolerance
    turning, rim = (
        force.compute(replace(record, of_rim=of_rim), known) for of_rim in (False, True)
    )
    acceleration = w.a * (turning.force - w.phi * record.clamping_force_smooth)
    used = np.isfinite(acceleration)
    for F, power in ((turning, 1), (rim, 2)):
        moved = np.abs(acceleration / w.a * (by**-power - 1.0))
        assert F.tolerance[used] == pytest.approx(10.0 * moved[used], rel=0.05, abs=3.0)


def test_the_cylinder_does_not_matter_where_the_log_has_the_clamping_force() -> None:
    record, _ = logged("service-brake", 20.0)
    given_K = replace(record, pressure=None)
    cylinder = exact(cylinder_diameter=0.01, spring_force=500.0, efficiency=0.1, discs=0.1)
    F = force.compute(given_K, cylinder)
    assert np.allclose(F.upper - F.force, Z95 * F.sigma)
    F = force.compute(given_K, exact(friction=0.03))
    assert np.max(F.upper - F.force) == pytest.approx(
        Z95 * 0.03 * np.max(record.clamping_force), rel=0.02
    )


# --- smoother -----------------------------------------------------------------------------------


def random_run(seed: int, n: int, r: float, q: float) -> tuple[smoother.UnbrokenRun, Floats]:
    """A level whose rate is u plus a random walk, on irregular steps; and its true rate."""
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.2, 1.8, n)) * 0.05
    u, s = np.sin(t), np.zeros(n)
    h = np.diff(t)
    delta = np.concatenate([[0.3], 0.3 + np.cumsum(random.normal(0.0, np.sqrt(q * h)))])
    step = h * (u[1:] + u[:-1] + delta[1:] + delta[:-1]) / 2.0
    step += random.normal(0.0, np.sqrt(q * h**3 / 12.0))
    level = np.concatenate([[5.0], 5.0 + np.cumsum(step)])
    y = level + random.normal(0.0, math.sqrt(r), n)
    return smoother.UnbrokenRun(t, y, u, s, s, s, s), u + delta


ONE = smoother.Regimes(np.zeros(1), np.zeros((1, 1)), np.ones(1), 10.0)


def test_one_regime_is_the_exact_gaussian_posterior() -> None:
    """Against dense linear algebra: all samples at once, no recursion."""
    n, r, q = 40, 0.01, 0.5
    run, _ = random_run(1, n, r, q)
    cov = np.zeros((2 * n, 2 * n))  # level and δ, sample by sample
    mean = np.zeros(2 * n)
    cov[0, 0], cov[1, 1] = r, ONE.spread**2
    mean[0] = run.y[0]
    for k in range(1, n):
        h = run.t[k] - run.t[k - 1]
        A = np.array([[1.0, h], [0.0, 1.0]])
        now, old = slice(2 * k, 2 * k + 2), slice(2 * k - 2, 2 * k)
        mean[now] = A @ mean[old] + [h * (run.u[k] + run.u[k - 1]) / 2.0, 0.0]
        cov[now, : 2 * k] = A @ cov[old, : 2 * k]
        cov[: 2 * k, now] = cov[now, : 2 * k].T
        Q = q * np.array([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]])
        cov[now, now] = A @ cov[old, old] @ A.T + Q
    C = cov[2::2]  # the first sample is in the prior already
    gain = C.T @ np.linalg.inv(C[:, 2::2] + r * np.eye(n - 1))
    mean = mean + gain @ (run.y[1:] - mean[2::2])
    sigma = np.sqrt(np.diag(cov - gain @ C))
    found = smoother.smooth(run, ONE, smoother.MeasurementNoise(r, 0.0, np.array([q])))
    assert found.level == pytest.approx(mean[::2], abs=1e-8)
    assert found.rate == pytest.approx(run.u + mean[1::2], abs=1e-8)
    assert found.level_sigma == pytest.approx(sigma[::2], rel=1e-5)
    assert found.rate_sigma == pytest.approx(sigma[1::2], rel=1e-5)


@settings(max_examples=20)
@given(st.integers(0, 1000), st.integers(2, 4))
def test_regimes_that_do_not_differ_are_one(seed: int, M: int) -> None:
    run, _ = random_run(seed, 60, 0.01, 0.5)
    leave = np.random.default_rng(seed).uniform(0.1, 5.0, (M, M))
    np.fill_diagonal(leave, 0.0)
    many = smoother.Regimes(np.zeros(M), leave, np.full(M, 1.0 / M), 10.0)
    one = smoother.smooth(run, ONE, smoother.MeasurementNoise(0.01, 0.0, np.array([0.5])))
    same = smoother.smooth(run, many, smoother.MeasurementNoise(0.01, 0.0, np.full(M, 0.5)))
    for a, b in zip(one, same, strict=True):
        assert a == pytest.approx(b, rel=0.02, abs=1e-7)  # sigma: bisected to 1 %
    assert one.rate == pytest.approx(same.rate, abs=1e-8)


def test_the_fit_finds_the_noise_levels() -> None:
    runs = [random_run(seed, 1500, 0.004, 0.2)[0] for seed in (1, 2)]
    guess = smoother.MeasurementNoise(1.0, 1e-3, np.array([10.0]))
    noise, _ = smoother.fit(runs, ONE, smoother.Prior(guess, [2.0, 0.0, 2.0], 1e-6))
    assert noise.measurement == pytest.approx(0.004, rel=0.1)
    assert noise.rough[0] == pytest.approx(0.2, rel=0.25)


def test_the_fit_never_goes_below_the_quantisation() -> None:
    run, _ = random_run(1, 300, 1e-8, 0.2)
    guess = smoother.MeasurementNoise(1e-8, 1e-3, np.array([0.1]))
    noise, _ = smoother.fit([run], ONE, smoother.Prior(guess, [2.0, 0.0, 2.0], 0.003))
    assert noise.measurement >= 0.003


@pytest.mark.parametrize("n", [10, 1000])
def test_what_follows_a_ramp_does_not_depend_on_the_rate(n: int) -> None:
    t = np.linspace(0.0, 1.0, n)
    zero = np.zeros(n)
    run = smoother.UnbrokenRun(t, zero, zero, 3.0 * t, zero, np.full(n, 1e9), zero)  # says nothing
    found = smoother.smooth(run, ONE, smoother.MeasurementNoise(1e9, 0.5, np.zeros(1)))
    assert found.rate_sigma[-1] ** 2 == pytest.approx(ONE.spread**2 + 0.5 * 3.0, rel=1e-3)


def test_sigma_tells_calm_from_rough() -> None:
    """δ is rough for a while: errors are larger there, and sigma knows where."""
    random = np.random.default_rng(4)
    n, h, r = 3000, 0.01, 1e-4
    t = np.arange(n) * h
    rough = (t > 10.0) & (t < 15.0)
    delta = np.cumsum(random.normal(0.0, 1.0, n) * np.sqrt(np.where(rough, 20.0, 1e-4) * h))
    level = np.concatenate([[0.0], np.cumsum(h * (delta[1:] + delta[:-1]) / 2.0)])
    zero = np.zeros(n)
    y = level + random.normal(0.0, math.sqrt(r), n)
    run = smoother.UnbrokenRun(t, y, zero, zero, zero, zero, zero)
    leave = np.array([[0.0, 0.1], [0.1, 0.0]])
    two = smoother.Regimes(np.zeros(2), leave, np.array([0.5, 0.5]), 10.0)
    guess = smoother.MeasurementNoise(1e-3, 0.0, np.array([1e-3, 1.0]))
    noise, _ = smoother.fit([run], two, smoother.Prior(guess, [2.0, 0.0, 2.0, 2.0], 1e-9))
    found = smoother.smooth(run, two, noise)
    inside = np.abs(found.rate - delta) < 1.96 * found.rate_sigma
    assert np.mean(inside[rough]) == pytest.approx(0.95, abs=0.05)
    assert np.mean(inside[~rough]) >= 0.85
    assert np.median(found.rate_sigma[rough]) > 5.0 * np.median(found.rate_sigma[~rough])


@settings(max_examples=50)
@given(st.integers(0, 10_000))
def test_later_samples_never_widen_a_path(seed: int) -> None:
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(2, 2, 2))
    P, N = A @ A.T + 0.01 * np.eye(2), B @ B.T
    D = N - P
    d00, d01, d11 = smoother._without_growth(
        D[0, 0], D[0, 1], D[1, 1], P[0, 0], P[0, 1], P[1, 1], float(np.linalg.det(P))
    )
    kept = np.array([[d00, d01], [d01, d11]])
    before, after = (np.sort(np.linalg.eigvals(np.linalg.solve(P, x)).real) for x in (D, kept))
    assert after == pytest.approx(np.minimum(before, 0.0), abs=1e-6)


def test_compiled_and_plain_loops_agree() -> None:
    run, _ = random_run(5, 30, 0.01, 0.5)
    leave = np.array([[0.0, 0.3], [1.0, 0.0]])
    two = smoother.Regimes(np.array([0.0, 1.0]), leave, np.array([0.5, 0.5]), 10.0)
    run = run._replace(s=np.cos(run.t), input_variance=np.full(30, 1e-5), span=np.full(30, 0.05))
    noise = smoother.MeasurementNoise(0.01, 0.2, np.array([0.1, 2.0]))
    plain_kept, plain, scores = np.empty((30, 2, 6)), np.empty((30, 4)), np.empty(30)
    arguments = smoother._arguments(run, two, noise)
    smoother._filter(
        *arguments, run.y, 0.01 + run.own_variance, run.span**3 / 320.0, two.start, 100.0,
        plain_kept, scores,
    )  # fmt: skip
    smoother._backward(*arguments, plain_kept, plain)
    found = smoother.smooth(run, two, noise)
    assert found.level == pytest.approx(plain[:, 0], rel=1e-12)
    assert found.rate - run.u == pytest.approx(plain[:, 2], rel=1e-9)
    z, rolling = smoother.innovations(run, two, noise)
    assert z == pytest.approx(scores[1:], rel=1e-9)
    assert rolling == pytest.approx(plain_kept[1:, 0, 5], rel=1e-9)


def test_innovations_of_a_right_model_are_white_and_of_variance_one() -> None:
    run, _ = random_run(1, 4000, 0.01, 0.5)
    fitting = smoother.MeasurementNoise(0.01, 0.0, np.array([0.5]))
    right, _ = smoother.innovations(run, ONE, fitting)
    assert np.mean(right**2) == pytest.approx(1.0, abs=0.07)
    assert abs(np.mean(right[1:] * right[:-1])) < 0.05
    too_sure = smoother.MeasurementNoise(0.0025, 0.0, np.array([0.125]))
    sure, _ = smoother.innovations(run, ONE, too_sure)
    assert np.mean(sure**2) == pytest.approx(4.0, abs=0.3)


def test_slides_that_a_wsp_repeats_do_not_count_as_noise_of_the_speed() -> None:
    t, random = np.arange(0.0, 60.0, 0.02), np.random.default_rng(3)
    since, zero = t % 1.5, np.zeros(len(t))
    rate = np.where((since < 0.5) & (t > 10.0), -20.0 * np.sin(4.0 * np.pi * since), 0.0)
    y = 50.0 + 0.02 * np.cumsum(rate) + random.normal(0.0, 0.03, len(t))
    run = smoother.UnbrokenRun(t, y, zero, zero, zero, zero, zero)
    regimes = noise_fit.switching_regimes(np.array([0.0, 1.0, 1.0]), 30.0)
    noise = smoother.MeasurementNoise(0.0009, 1e-4, np.array([1e-3, 10.0, 1e3]))
    every, _ = smoother.innovations(run, regimes, noise)
    judged = force._rolling_squares(run, regimes, noise)
    assert np.mean(every**2) > 1.2
    assert 0.8 < np.mean(judged) < 1.0
    assert len(judged) > 1000


@pytest.mark.parametrize("case", [{"kmh": 0.1}, {"noise": 1e-4}])
def test_the_reference_has_the_nis_of_its_forward_filter(case: dict[str, float]) -> None:
    record, _ = logged("low-adhesion", 50.0, pressure_noise=500.0, **case)
    nis = force.compute(record, VEHICLE).nis
    assert nis is not None
    assert 0.3 < nis.mean < nis.high
    assert force.compute(record, VEHICLE, "butterworth").nis is None


@pytest.mark.parametrize(("seed", "rate"), thinned(5, [1, 2], [10.0, 20.0, 50.0]))
def test_a_speed_that_is_the_mean_since_the_last_one_is_known_by_its_lateness(
    rate: float, seed: int
) -> None:
    name = "low-adhesion"
    now, _ = logged(name, rate, seed=seed)
    late = averaged(now, name, seed)
    known, found = force.compute(now, VEHICLE), force.compute(late, VEHICLE)
    assert known.averaged < 0.01
    assert found.averaged > 0.99
    used = np.isfinite(found.force)
    error = (found.force - now.truth)[used]
    assert rms(error) < 90.0
    assert np.mean(np.abs(error) < 1.96 * found.sigma[used]) > 0.93


def test_a_pressure_slower_than_the_speed_does_not_tell_means() -> None:
    """Lines between its samples bend where valves turn, by more than half an interval of speeds."""
    now, _ = logged("low-adhesion", 50.0, pressure_rate=20.0)
    for record in (now, averaged(now, "low-adhesion")):
        found = force.compute(record, VEHICLE)
        assert found.averaged == 0.5
        used = np.isfinite(found.force)
        held = np.abs(found.force - now.truth)[used] < 1.96 * found.sigma[used]
        assert np.mean(held) > 0.99


def test_where_nothing_tells_whether_a_speed_is_a_mean_sigma_holds_either() -> None:
    name = "four-axles"
    now, _ = logged(name, 20.0)
    found = force.compute(averaged(now, name), VEHICLE)
    used = np.isfinite(found.force)
    assert np.mean(np.abs(found.force - now.truth)[used] < 1.96 * found.sigma[used]) > 0.8


def test_a_brake_that_bends_at_1_hz_is_no_noise() -> None:
    """A smooth brake of 18 samples, in kPa and mm/s: the error is that of the rounding."""
    w = physics.wheelset(VEHICLE, 1)
    dense = np.arange(0.0, 32.0, 0.01)
    p = 2.2e5 * np.sin(np.pi * np.clip((dense - 6.0) / 18.0, 0.0, 1.0)) ** 2
    K = physics.clamping_force(p, VEHICLE)
    dw = -physics.rolling_deceleration(w) * K
    speed = 40.0 + np.cumsum(dw) * 0.01
    sampled = slice(37, None, 100)
    p, speed = np.round(p[sampled], -3), np.round(speed[sampled], 3)
    measured = physics.clamping_force(p, VEHICLE)
    record = AxleRecord(
        1, np.round(dense[sampled] * 1e9).astype(np.int64), measured, measured, speed,
        (slice(0, len(p)),), 0.001, pressure=p, clamping_force_step=1e3 * 0.0256,
    )  # fmt: skip
    error = force.compute(record, VEHICLE).force - (w.phi * K + dw / w.a)[sampled]
    assert rms(error) < 4.0


def test_a_lag_of_the_pads_widens_the_band_while_the_pressure_moves() -> None:
    record, _ = logged("service-brake", 100.0)
    plain = force.compute(record, exact())
    lagging = force.compute(record, exact(friction_lag=0.05))
    np.testing.assert_array_equal(plain.force, lagging.force)
    K = record.clamping_force_smooth
    phi = physics.wheelset(VEHICLE, 1).phi
    moved = phi * np.abs(K[5:] - K[:-5])
    known = np.isfinite(plain.force[5:])
    np.testing.assert_allclose(
        lagging.tolerance[5:][known], moved[known], atol=0.02 * phi * K.max()
    )
    assert np.nanmax(lagging.tolerance) > 0.03 * np.nanmax(plain.force)
    steady = np.flatnonzero(K / K.max() > 0.999)[20]
    assert lagging.tolerance[steady] < 0.002 * plain.force[steady]
