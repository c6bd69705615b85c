"""Stops of a train whose every figure is known: found, measured, and refused with a reason."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.made_results import result
from hypothesis import given, settings
from hypothesis import strategies as st

from adhesion_cli.core.finding import Finding
from adhesion_cli.core.masks import true_runs
from adhesion_cli.core.model import Channel, Column, Floats, Log, Meaning, Parameter, Vehicle
from adhesion_cli.core.physics import RECEIVER_DELAY, SLIDE, STANDING, G
from adhesion_cli.core.summary import JERK, SLIDE_SPAN, StopSummary
from adhesion_cli.rail.events import END_SLIP, SHORTEST_SLIDE
from adhesion_cli.rail.speed_errors import DELAY_SIGMA
from adhesion_cli.rail.wheel_calibration import calibrate_radius
from adhesion_cli.stops.command import find_command
from adhesion_cli.stops.find import Braking, find_brakings
from adhesion_cli.stops.measure import ToLevel, _gap_error, measure_stop
from adhesion_cli.stops.settings import StopSettings
from adhesion_cli.stops.signals import (
    StopSignals,
    TimeSeries,
    brake_levels,
    of_log,
    of_records,
)
from adhesion_cli.stops.speed import local_polynomial

FLAT = ToLevel(Parameter(0.0, 0.0), 1.0)
ON = 10.0  # command [s]
T_A, T_B = 0.4, 1.6  # the brake rises in a line from T_A to T_B after the command [s]


def brake_share(t: Floats) -> Floats:
    return np.clip((t - ON - T_A) / (T_B - T_A), 0.0, 1.0)


def train(v0: float, a: float, t: Floats) -> tuple[Floats, float]:
    """Speed of a train under that brake, and its distance from the command."""
    fine = np.arange(0.0, t[-1] + 0.001, 0.001)
    v = np.maximum(v0 - np.cumsum(a * brake_share(fine)) * 0.001, 0.0)
    distance = float(np.trapezoid(v[fine >= ON], fine[fine >= ON]))
    return np.interp(t, fine, v), distance


def signals(
    v0: float = 25.0, a: float = 1.0, rate: float = 50.0, command: bool = True, until: float = 1e9
) -> tuple[StopSignals, float]:
    t = np.arange(0.0, min(ON + v0 / a + 12.0, until), 1.0 / rate)
    v, distance = train(v0, a, t)
    p = 3e5 * brake_share(t)
    speed = TimeSeries(t, v)
    commands = {"brake_command": [TimeSeries(t, (t >= ON) * 1.0)]} if command else {}
    return StopSignals(
        speed, "train", 0.0, 0.0, {1: speed}, {1: TimeSeries(t, p)}, commands
    ), distance


def measured(x: StopSignals, to_level: ToLevel = FLAT, **stated: float) -> list[StopSummary]:
    return [measure_stop(x, b, to_level, StopSettings(**stated)) for b in find_brakings(x)]


@pytest.mark.parametrize("vents", [[], [6.0], [5.0, 7.0, 9.0], [9.5]])
def test_the_full_brake_is_that_before_a_valve_vents(vents: list[float]) -> None:
    t = np.arange(0.0, 20.0, 0.02)
    pressure = 3.2e5 * -np.expm1(-np.maximum(t - 1.0, 0.0) / 0.6)
    for vent in vents:  # and fills again, by less
        last = vent == max(vents)
        fill = -np.expm1(-np.maximum(t - vent, 0.0) / 2.0)
        pressure = np.where((t > vent) & (last | (t < vent + 2.0)), 2.2e5 + 0.8e5 * fill, pressure)
    _, full_value, _ = brake_levels(TimeSeries(t, pressure), 1.0, 19.0)
    assert full_value == pytest.approx(3.2e5, rel=0.01)  # two sigma of what the response states


def test_the_full_brake_is_its_level_not_an_overshoot_before_a_release() -> None:
    t = np.arange(0.0, 40.0, 0.02)
    level = np.interp(t, [11.0, 12.0, 13.0, 36.0, 38.0], np.array([0.0, 3.18, 3.0, 3.0, 1.0]) * 1e5)
    noisy = level + np.random.default_rng(1).normal(0.0, 5e3, len(t))
    assert brake_levels(TimeSeries(t, level), 11.0, 39.0)[1] == pytest.approx(3e5, rel=0.001)
    assert brake_levels(TimeSeries(t, noisy), 11.0, 39.0)[1] == pytest.approx(3e5, rel=0.005)


def test_the_full_brake_is_the_last_one_where_it_is_the_stronger() -> None:
    t = np.arange(0.0, 20.0, 0.02)
    pressure = np.interp(t, [1.0, 2.0, 6.0, 6.2, 9.0, 10.0], np.array([0, 2, 2, 1, 1, 3]) * 1e5)
    assert brake_levels(TimeSeries(t, pressure), 1.0, 19.0)[1] == pytest.approx(3e5, rel=0.005)


@settings(max_examples=25, deadline=None)
@given(v0=st.floats(8.0, 60.0), a=st.floats(0.4, 2.0), rate=st.sampled_from([10.0, 50.0, 100.0]))
def test_distance_and_decelerations_are_those_of_the_train(
    v0: float, a: float, rate: float
) -> None:
    x, distance = signals(v0, a, rate)
    (stop,) = measured(x)
    assert stop.valid
    assert stop.command_from == "channel"
    assert stop.start_s == pytest.approx(ON, abs=0.6 / rate)
    assert stop.distance_m is not None
    assert stop.distance_m.value == pytest.approx(distance, abs=v0 / rate + 0.1)
    assert stop.mean_deceleration is not None
    expected = v0**2 / (2.0 * distance)
    assert stop.mean_deceleration.value == pytest.approx(expected, rel=1.5 / rate)
    # 10 % of a line from 0.4 to 1.6 s, and 95 % of it
    t_a, t_full = T_A + 0.1 * (T_B - T_A), T_A + 0.95 * (T_B - T_A)
    assert stop.delay_s is not None
    assert stop.response_time_s is not None
    assert stop.delay_s.value == pytest.approx(t_a, abs=1.5 / rate)
    assert stop.response_time_s.value == pytest.approx((t_a + t_full) / 2.0, abs=1.5 / rate)
    assert stop.equivalent_deceleration is not None
    assert stop.equivalent_deceleration.value == pytest.approx(a, rel=0.03 + 2.0 * a / (v0 * rate))


@pytest.mark.parametrize("soft", [1.0, 0.5])
def test_a_brake_that_is_released_in_the_last_metre_stops_the_train_later(soft: float) -> None:
    x, _ = signals(20.0, 1.0)
    t, v = x.speed
    slows = np.interp(v, [0.55, 0.6], [soft, 1.0]) * brake_share(t)
    v = np.maximum(20.0 - np.cumsum(slows) / 50.0, 0.0)
    stands = float(t[np.argmax(v <= 0.0)]) - ON
    noise = np.random.default_rng(2).normal(0.0, 0.015, len(t))
    (stop,) = measured(x._replace(speed=TimeSeries(t, v + noise)))
    assert stop.duration_s is not None
    assert abs(stop.duration_s.value - stands) < min(stop.duration_s.u95, 0.15)


def test_standstill_is_as_uncertain_as_wheels_that_count_pulses() -> None:
    """The fastest of the wheels is rounded up, and follows a slow train speed."""
    x, _ = signals(20.0, 0.9, 20.0)
    t, v = x.speed
    stands = float(t[np.argmax(v <= 0.0)]) - ON
    counted = (np.floor(np.append(v[:2], v[:-2]) / 0.28 + phase) * 0.28 for phase in (0.2, 0.9))
    rims = {axle: TimeSeries(t, np.where(v > 0.0, y, 0.0)) for axle, y in enumerate(counted, 1)}
    shaped = np.maximum(rims[1].value, rims[2].value) + 0.004 * np.sin(3.0 * t)
    is_coarse = np.zeros(len(t), dtype=np.bool_)
    (stop,) = measured(x._replace(speed=TimeSeries(t, shaped), rims=rims, is_coarse=is_coarse))
    assert stop.duration_s is not None
    assert abs(stop.duration_s.value - stands) < stop.duration_s.u95


@pytest.mark.parametrize("grip", [1.3, 1.6])
def test_standstill_is_as_uncertain_as_a_friction_that_rises_makes_it(grip: float) -> None:
    x, _ = signals(20.0, 1.0, 100.0)
    fine = np.arange(0.0, x.speed.t[-1], 1e-3)
    v = np.full(len(fine), 20.0)
    for i, share in enumerate(brake_share(fine)[1:], 1):
        v[i] = max(v[i - 1] - 1e-3 * share * np.interp(v[i - 1], [0.0, 1.4], [grip, 1.0]), 0.0)
    stands = float(fine[np.argmax(v <= 0.0)]) - ON
    read = np.round(np.interp(x.speed.t, fine, v) / 0.03) * 0.03
    (stop,) = measured(x._replace(speed=TimeSeries(x.speed.t, read)))
    assert stop.duration_s is not None
    assert abs(stop.duration_s.value - stands) < stop.duration_s.u95 < 0.1


def test_a_train_speed_that_may_be_late_is_no_slide_in_the_build_up() -> None:
    x, _ = signals(20.0, 1.5)
    late = x._replace(speed=TimeSeries(x.speed.t + 0.5, x.speed.value))
    (unaware,), (aware,) = measured(late), measured(late._replace(delay_sigma=0.2))
    assert unaware.response_time_s is None
    assert aware.response_time_s is not None


def test_without_a_command_the_first_rise_is_the_command() -> None:
    x, _ = signals(command=False)
    (stop,) = measured(x)
    assert stop.command_from == "pressure"
    assert stop.start_s == pytest.approx(ON + T_A, abs=0.04)
    assert stop.delay_s is not None
    assert stop.delay_s.value == pytest.approx(0.1 * (T_B - T_A), abs=0.04)


def test_noise_of_a_slow_pressure_is_no_begin_of_a_brake() -> None:
    """At 1 Hz the samples before the brake are too few to show their noise."""
    x, _ = signals(command=False)
    values = [0.0, 1e3, 0.0, 0.0, -1e3, 0.0, 0.0, 0.0, 0.0, 3e3, 3e4, 2.1e5, *[2.4e5] * 8]
    slow = TimeSeries(np.arange(20.0), np.array(values))
    time, sigma, source = find_command(x._replace(brakes={1: slow}), Braking(9.7, 40.0, ""))
    assert (time, source) == (9.0, "pressure")
    assert sigma == pytest.approx(1.0 / math.sqrt(3.0))


@pytest.mark.parametrize("step", [0.1, 0.25, 0.3])
def test_pads_that_are_laid_on_first_do_not_date_the_command_far_back(step: float) -> None:
    x, _ = signals(command=False)
    t = x.speed.t
    bar = np.interp(t, [ON, ON + 0.02, ON + 1.0, ON + 2.0], [0.0, step, step, 3.0])
    bar += np.random.default_rng(1).normal(0.0, 0.01, len(t))
    braking = Braking(ON + 1.5, 40.0, "")
    time, sigma, _ = find_command(x._replace(brakes={1: TimeSeries(t, 1e5 * bar)}), braking)
    assert abs(time - ON) < max(3.0 * sigma, 0.1) < 1.0


def test_a_brake_pipe_falls_before_the_cylinders_rise() -> None:
    x, _ = signals(command=False)
    t = x.speed.t
    pipe = TimeSeries(t, 5e5 - 1.5e5 * np.clip((t - ON - 0.1) / 2.0, 0.0, 1.0))
    (stop,) = measured(x._replace(commands={"brake_pipe": [pipe]}))
    assert stop.command_from == "brake_pipe"
    assert ON <= stop.start_s <= ON + 0.4


@pytest.mark.parametrize("rate", [0.5e5, 1e5, 4e5])
def test_the_fall_of_a_noisy_brake_pipe_is_dated_back_to_its_begin(rate: float) -> None:
    x, _ = signals(command=False)
    t, errors = x.speed.t, []
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0.0, 1e3, len(t))
        fall = np.minimum(rate * np.maximum(t - ON + 0.3, 0.0), 1.5e5)
        pipes = [TimeSeries(t, 5e5 - fall + noise)]
        time, sigma, _ = find_command(
            x._replace(commands={"brake_pipe": pipes}), Braking(ON + T_A + 0.1, 40.0, "")
        )
        errors.append((time - (ON - 0.3)) / (2.0 * sigma))
    assert np.mean(np.abs(errors) < 1.0) >= 0.9
    assert 2.0 * sigma < 0.1


@pytest.mark.parametrize("power", [1.0, 2.0])
@pytest.mark.parametrize("noise", [2e2, 3e3])
def test_the_rise_of_a_noisy_pressure_is_dated_back_to_its_begin(
    power: float, noise: float
) -> None:
    """In a line, or slowly as an S begins: 2 bar in a second, after the end of another braking."""
    x, _ = signals(command=False)
    t, errors = x.speed.t, []
    for seed in range(20):
        rise = 2e5 * np.clip(t - ON - 0.01 * seed, 0.0, 1.2) ** power
        rise += 5e4 * (t < ON - 5.0)
        p = rise + np.random.default_rng(seed).normal(0.0, noise, len(t))
        series = x._replace(brakes={1: TimeSeries(t, p)})
        time, sigma, _ = find_command(series, Braking(ON + 0.6, 40.0, ""))
        errors.append((time - ON - 0.01 * seed) / (2.0 * sigma))
    assert np.mean(np.abs(errors) < 1.0) >= 0.9
    assert 2.0 * sigma < 0.2


def test_of_the_brake_pipes_of_cars_the_first_to_fall_is_the_command() -> None:
    x, _ = signals(command=False)
    t = x.speed.t
    pipes = [
        TimeSeries(t, 5e5 - 1.5e5 * np.clip((t - ON - late) / 2.0, 0.0, 1.0)) for late in (0.3, 0.1)
    ]
    (stop,) = measured(x._replace(commands={"brake_pipe": pipes}))
    assert stop.start_s == pytest.approx(ON + 0.1, abs=0.03)


def test_a_train_that_slows_harder_at_the_end_stands_when_its_speed_says_so() -> None:
    x, _ = signals(a=0.3, rate=100.0)
    t = x.speed.t
    still = float(t[np.argmax(x.speed.value <= 0.0)])
    harder = np.maximum(1.125 * (still - 1.1 - t), 0.0)  # as with locked wheels
    v = np.where(t < still - 1.5, x.speed.value, np.minimum(x.speed.value, harder))
    rim = TimeSeries(t, v)
    true_stop = float(t[np.argmax(v <= 0.0)])
    (braking,) = find_brakings(x._replace(speed=rim))
    assert braking.stop == pytest.approx(true_stop, abs=0.3)
    (stop,) = measured(x._replace(speed=rim, speed_from="axles", rims={1: rim}))
    assert stop.duration_s is not None
    assert stop.duration_s.value == pytest.approx(true_stop - ON, abs=0.3)


@pytest.mark.parametrize(("a", "from_speed"), [(0.6, 1.8), (0.65, 1.0)])
def test_a_train_moves_on_where_all_its_wheels_lock_at_the_end(a: float, from_speed: float) -> None:
    x, _ = signals(a=a, rate=100.0)
    t, v = x.speed.t, x.speed.value
    true_stop = float(t[np.argmax(v <= 0.0)])
    rim = TimeSeries(t, np.where(v > from_speed, 0.95 * v, 0.0))  # seconds before standstill
    (stop,) = measured(x._replace(speed=rim, speed_from="axles", rims={1: rim}))
    assert stop.duration_s is not None
    assert stop.duration_s.value == pytest.approx(true_stop - ON, abs=0.5)
    assert abs(stop.duration_s.value - (true_stop - ON)) < stop.duration_s.u95


def test_wheels_that_all_lock_show_no_stop_without_a_train_speed() -> None:
    x, _ = signals(a=0.7)
    t, v = x.speed
    locked = np.clip(v - 6.0 * np.maximum(t - ON - 5.0, 0.0), 0.0, None)
    rims = {axle: TimeSeries(t, locked) for axle in (1, 2)}
    (stop,) = measured(x._replace(speed=rims[1], rims=rims, speed_from="axles"))
    assert stop.reason == "all wheels lock at 80 km/h, and no train speed is logged"
    assert (stop.valid, stop.distance_m, stop.jerk) == (False, None, None)
    (by_train,) = measured(x._replace(rims=rims))
    assert by_train.valid


def test_wheels_that_all_slide_in_turn_show_no_jerk_of_the_train() -> None:
    x, _ = signals(a=0.7)
    t, v = x.speed.t, x.speed.value
    slips = [0.12 * ((t % 4.0 > k) & (t % 4.0 < k + 1.5) & (t > ON + 2.0)) for k in (0.0, 2.0)]
    rims = {i: TimeSeries(t, v * (1.0 - slip)) for i, slip in enumerate(slips, 1)}
    by_wheels = x._replace(rims=rims, speed_from="axles")
    (in_turn,) = measured(by_wheels)
    (one_rolls,) = measured(by_wheels._replace(rims=rims | {3: x.speed}))
    assert in_turn.jerk is None
    assert [a.at_least for a in in_turn.axles] == [True, True]
    assert one_rolls.jerk is not None


def test_speed_alone_has_distance_and_deceleration() -> None:
    x, distance = signals(command=False)
    (stop,) = measured(x._replace(brakes={}, rims={}))
    assert (stop.command_from, stop.response_time_s, stop.delay_s) == ("deceleration", None, None)
    assert stop.distance_m is not None
    response = (T_A + T_B) / 2.0  # where the lines before and after meet
    assert stop.distance_m.value == pytest.approx(distance - 25.0 * response, abs=5.0)


@pytest.mark.parametrize("gradient", [-15.0, 0.0, 10.0])
def test_a_stop_on_a_gradient_is_that_on_level_track(gradient: float) -> None:
    """The train of the log slows by the gradient, too; the corrected distance does not have it."""
    rho, v0, level = 1.06, 25.0, 1.0
    x, _ = signals(v0, level + G * gradient / 1000.0 / rho)
    (stop,) = measured(x, ToLevel(Parameter(gradient, 0.0), rho), nominal_speed=90.0)
    _, expected = train(25.0, level, np.arange(0.0, 60.0, 0.02))
    assert stop.corrected_distance_m is not None
    assert stop.corrected_distance_m.value == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("gradient", "v0"), [(14.0, 20.5), (-12.0, 24.0)])
def test_a_slow_brake_has_its_true_distance_on_level_track_in_the_interval(
    gradient: float, v0: float
) -> None:
    """A brake that is built up slowly, on a gradient and from another speed than the nominal."""
    rho, t = 1.06, np.arange(0.0, 80.0, 0.01)
    share = 1.0 - np.exp(-np.maximum(t - ON, 0.0) / 2.5)

    def run(v0: float, climb: float) -> Floats:
        a = share + (t >= ON) * G * climb / 1000.0 / rho
        return np.maximum(v0 - np.cumsum(a) * 0.01, 0.0)

    v, x = run(v0, gradient), signals()[0]
    brakes, commands = {1: TimeSeries(t, 3e5 * share)}, {"brake_command": [TimeSeries(t, t >= ON)]}
    speed = TimeSeries(t, v)
    x = x._replace(speed=speed, rims={1: speed}, brakes=brakes, commands=commands)
    (stop,) = measured(x, ToLevel(Parameter(gradient, 0.0), rho), nominal_speed=80.0)
    expected = float(np.trapezoid(run(80.0 / 3.6, 0.0)[t >= ON], t[t >= ON]))
    level, energy = stop.corrected_distance_m, stop.energy_distance_m
    assert level
    assert energy
    assert abs(level.value - expected) > 0.01 * expected
    for x_of_formula in (level, energy):
        assert abs(x_of_formula.value - expected) < x_of_formula.u95


def test_each_source_of_error_is_in_the_uncertainty() -> None:
    x, _ = signals()
    x = x._replace(scale=0.01, delay_sigma=0.1)
    (stop,) = measured(x, ToLevel(Parameter(0.0, 3.0), 1.06))
    by_source = {c.source: c for c in stop.budget}
    assert stop.distance_m is not None
    s = stop.distance_m
    assert by_source["speed scale"].distance_m == pytest.approx(0.01 * s.value)
    assert by_source["speed delay"].distance_m == pytest.approx(25.0 * 0.1, rel=0.01)
    total = 2.0 * math.sqrt(sum(c.distance_m**2 for c in stop.budget))
    assert s.u95 == pytest.approx(total)
    common = 2.0 * math.sqrt(sum(c.distance_m**2 for c in stop.budget if c.common))
    assert s.common_u95 == pytest.approx(common)
    assert stop.corrected_distance_m is not None
    assert stop.corrected_distance_m.u95 > stop.corrected_distance_m.value * 0.05  # the gradient


def test_stops_that_are_none_say_why() -> None:
    whole, _ = signals()
    cut, _ = signals(until=25.0)
    (stop,) = measured(cut)
    assert (stop.valid, stop.reason) == (False, "the log ends at 40 km/h")
    assert stop.distance_m is None
    assert stop.initial_speed_mps is not None

    t = whole.speed.t
    released = np.where(t < 20.0, whole.brakes[1].value, 0.0)
    v = np.where(t < 20.0, whole.speed.value, np.interp(20.0, t, whole.speed.value))
    (stop,) = measured(whole._replace(speed=TimeSeries(t, v), brakes={1: TimeSeries(t, released)}))
    assert (stop.valid, stop.reason) == (False, "the brake was released at 58 km/h")

    holey = np.where((t > 18.0) & (t < 21.0), np.nan, whole.speed.value)
    (stop,) = measured(whole._replace(speed=TimeSeries(t, holey)))
    assert not stop.valid
    assert stop.reason is not None
    assert stop.reason.startswith("no speed for")

    # A pause of the recorder that is longer than a WSP vents: neither brake nor speed is known.
    paused = (t > 18.0) & (t < 22.0)
    without = [
        TimeSeries(t, np.where(paused, np.nan, x.value)) for x in (whole.speed, whole.brakes[1])
    ]
    for brakes in ({1: without[1]}, {}):
        (stop,) = measured(whole._replace(speed=without[0], rims={}, brakes=brakes, commands={}))
        assert (stop.valid, stop.reason) == (False, "no speed for 4.0 s")

    late = t >= 15.0
    begun = TimeSeries(t[late], whole.brakes[1].value[late])
    (stop,) = measured(
        whole._replace(
            speed=TimeSeries(t[late], whole.speed.value[late]), brakes={1: begun}, commands={}
        )
    )
    assert (stop.valid, stop.reason) == (False, "the log begins with the brake applied")
    assert (stop.delay_s, stop.response_time_s) == (None, None)


@pytest.mark.parametrize("zero", [-3e4, 2.8e4])
def test_a_pressure_whose_zero_is_wrong_is_no_brake_that_is_applied(zero: float) -> None:
    x, distance = signals(command=False)
    t, p = x.brakes[1]
    low = 0.7 * p  # 2.1 bar
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t, low), 2: TimeSeries(t, low + zero)}))
    assert (stop.valid, stop.reason) == (True, None)
    assert stop.distance_m is not None
    assert abs(stop.distance_m.value - distance) < stop.distance_m.u95


def test_a_brief_brake_and_shunting_are_no_stops() -> None:
    slow, _ = signals(v0=1.2)
    assert measured(slow) == []
    x, _ = signals()
    t = x.speed.t
    short = np.where((t > ON) & (t < ON + 2.0), 2e5, 0.0)
    v = np.full(len(t), 25.0) - 1.0 * np.clip(t - ON, 0.0, 2.0)
    assert measured(x._replace(speed=TimeSeries(t, v), brakes={1: TimeSeries(t, short)})) == []


def test_slides_in_the_build_up_leave_no_response() -> None:
    x, _ = signals()
    t = x.speed.t
    slid = np.where((t > ON + 0.6) & (t < ON + 3.0), 0.8, 1.0) * x.speed.value
    (stop,) = measured(x._replace(rims={1: TimeSeries(t, slid)}))
    assert (stop.response_time_s, stop.equivalent_deceleration) == (None, None)
    assert stop.delay_s is not None
    (axle,) = stop.axles
    assert axle.max_slip == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("readings", [1, 40])
def test_the_noise_of_a_rolling_wheel_is_no_slip(readings: int) -> None:
    """The largest of many slips is mostly noise; that of a receiver lasts from one to the next."""
    x, _ = signals(rate=200.0)
    t, v = x.speed
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        train = v + np.interp(t, t[::readings], rng.normal(0.0, 0.02, len(t[::readings])))
        rim = 0.997 * v + rng.normal(0.0, 0.02, len(t))
        (stop,) = measured(x._replace(speed=TimeSeries(t, train), rims={1: TimeSeries(t, rim)}))
        (axle,) = stop.axles
        assert axle.max_slip is not None
        assert axle.max_slip_u95 is not None
        errors.append((axle.max_slip - 0.003) / axle.max_slip_u95)
    assert np.mean(np.abs(errors) < 1.0) >= 0.9
    assert axle.max_slip_u95 < 0.03


def test_a_short_slip_between_slow_samples_is_the_largest() -> None:
    """0.3 s at 10 Hz are three samples."""
    x, _ = signals(rate=10.0)
    t, v = x.speed
    slip = 0.04 * np.clip(1.5 - np.abs(t - ON - 8.0) / 0.1, 0.0, 1.0)
    (stop,) = measured(x._replace(rims={1: TimeSeries(t, v * (1.0 - slip))}))
    (axle,) = stop.axles
    assert axle.max_slip is not None
    assert axle.max_slip_u95 is not None
    assert axle.max_slip == pytest.approx(0.04, abs=max(axle.max_slip_u95, 0.002))


@pytest.mark.parametrize(("begin", "known"), [(1.5, False), (4.0, True)])
def test_a_slide_that_cuts_off_the_last_rise_leaves_no_response(begin: float, known: bool) -> None:
    """The brake fills as 1 − exp(−t/0.45 s), and its full value shows only before the slide."""
    x, _ = signals()
    t, v = x.speed
    p = 3e5 * (1.0 - np.exp((ON + 0.25 - np.maximum(t, ON + 0.25)) / 0.45))
    since = t - ON - begin
    p = np.where((since > 0.2) & (v > 2.0), p * (0.8 + 0.15 * np.sin(3.0 * since)), p)
    rim = TimeSeries(t, np.where((since > 0.0) & (v > 2.0), 0.88 * v, v))
    (stop,) = measured(x._replace(rims={1: rim}, brakes={1: TimeSeries(t, p)}))
    assert (stop.response_time_s is not None) == known


def test_an_axle_that_takes_over_from_another_brake_leaves_no_response() -> None:
    x, _ = signals()
    t, p = x.brakes[1]
    late = TimeSeries(t, np.where(t < ON + 20.0, 0.4, 1.0) * p)  # its ED brake fades out
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t, p), 2: TimeSeries(t, p), 3: late}))
    assert stop.delay_s is not None
    assert (stop.response_time_s, stop.equivalent_deceleration) == (None, None)


@pytest.mark.parametrize("spans", [(), ((ON + 0.5, ON + 30.0),)])
def test_another_brake_in_the_build_up_has_the_response_of_the_deceleration(
    spans: tuple[tuple[float, float], ...],
) -> None:
    """A track brake from 0.5 s on, beside pressures that rise as before, slows by 0.8 m/s²."""
    x, _ = signals()
    t, v = x.speed
    since = np.maximum(t - ON - 0.5, 0.0)
    v = np.where(v > 0.0, np.maximum(v - 0.8 * since, 0.0), 0.0)
    other = Finding("other-brake", "warning", spans=spans)
    both = x._replace(speed=TimeSeries(t, v), rims={}, other_brakes=[other])
    (stop,) = measured(both)
    assert (stop.response_from, stop.build_up_s) == ("deceleration", None)
    assert stop.response_time_s is not None
    true = ((T_A + T_B) / 2.0 + 0.8 * 0.5) / 1.8
    assert abs(stop.response_time_s.value - true) < stop.response_time_s.u95 < 0.1
    assert stop.equivalent_deceleration is not None
    assert stop.equivalent_deceleration.value == pytest.approx(1.8, rel=0.02)
    coarse = TimeSeries(t[::50], v[::50])
    assert measured(both._replace(speed=coarse))[0].response_time_s is None
    slid = TimeSeries(t, np.where((t > ON + 2.0) & (t < ON + 4.0), 0.8, 1.0) * v)
    assert measured(both._replace(rims={1: slid}))[0].response_time_s is None


@pytest.mark.parametrize(
    ("other", "begin", "source"),
    [(0.8, 0.0, "deceleration"), (0.5, 0.0, "brakes"), (0.5, T_A + 0.4, "brakes")],
)
def test_a_brake_without_a_channel_has_the_response_of_the_deceleration(
    other: float, begin: float, source: str
) -> None:
    """No finding says that it acts. Where the train slows as the pressure says, it does not."""
    x, _ = signals(v0=22.0)
    t = x.speed.t
    rise = np.clip((t - ON - begin) / 0.3, 0.0, 1.0)
    slowing = (1.0 - other) * brake_share(t) + other * rise
    noise = np.random.default_rng(4).normal(0.0, 0.02, len(t))
    v = np.maximum(22.0 - np.cumsum(slowing) / 50.0, 0.0)
    wheel = TimeSeries(t, v + noise * (v > 0.0))
    by_wheel = x._replace(speed=wheel, rims={1: wheel}, delay_sigma=0.2, knows_delay=False)
    (stop,) = measured(by_wheel)
    assert stop.response_from == source
    assert stop.response_time_s is not None
    true = (1.0 - other) * (T_A + T_B) / 2.0 + other * (begin + 0.15)
    assert abs(stop.response_time_s.value - true) < max(stop.response_time_s.u95, 0.1) < 1.0


def test_another_brake_before_the_command_leaves_the_response_of_the_brakes() -> None:
    x, _ = signals()
    earlier = Finding("other-brake", "warning", spans=((ON - 9.0, ON - 1.0),))
    assert measured(x._replace(other_brakes=[earlier]))[0].response_from == "brakes"


def test_a_single_reading_of_the_pressure_shows_no_response() -> None:
    x, _ = signals()
    t, p = x.brakes[1]
    kept = np.flatnonzero((t < ON - 1.0) | (np.abs(t - ON - 15.0) < 0.5 * (t[1] - t[0])))
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t[kept], p[kept])}))
    assert stop.response_time_s is None


def test_a_pressure_at_the_end_of_its_range_leaves_no_response() -> None:
    x, _ = signals()
    (stop,) = measured(x._replace(saturated=np.array([ON + 2.0])))
    assert (stop.delay_s, stop.response_time_s, stop.equivalent_deceleration) == (None, None, None)
    assert stop.distance_m is not None
    (later,) = measured(x._replace(saturated=x.speed.t[-1:]))
    assert later.response_time_s is not None


def test_axles_that_brake_before_the_rest_of_the_train_show_no_response() -> None:
    x, _ = signals()
    (stop,) = measured(x._replace(others_later=True))
    assert stop.response_from == "deceleration"
    assert stop.delay_s is not None
    assert abs(stop.delay_s.value - T_A - 0.1 * (T_B - T_A)) < stop.delay_s.u95 < 0.2
    assert stop.response_time_s is not None
    assert stop.response_time_s.value == pytest.approx((T_A + T_B) / 2.0, abs=0.07)
    assert stop.pressure_bar == pytest.approx(3.0, abs=0.01)
    t, slow = x.speed.t, 3e5 * np.clip((x.speed.t - ON - 1.0) / 20.0, 0.0, 1.0)
    filled = {"brakes": {1: TimeSeries(t, slow)}, "commands": {}}
    late, alike = (measured(x._replace(others_later=o, **filled))[0] for o in (True, False))
    assert late.duration_s is not None
    assert alike.duration_s is not None
    assert late.duration_s.u95 == pytest.approx(alike.duration_s.u95, rel=0.5)


def test_a_wheel_is_locked_where_the_train_is_fast_and_not_in_the_last_metres() -> None:
    x, _ = signals()
    t, v = x.speed.t, x.speed.value
    rim = np.where((t > 20.0) & (t < 22.0), 0.0, v)
    rim = np.where(v < 1.2, 0.0, rim)  # stands 0.7 m before the train does
    (stop,) = measured(x._replace(rims={1: TimeSeries(t, rim)}))
    (axle,) = stop.axles
    assert axle.locked_s == pytest.approx(2.0, abs=0.05)
    assert axle.longest_lock_s == pytest.approx(2.0, abs=0.05)
    assert axle.slip_bands is not None
    assert sum(axle.slip_bands) == pytest.approx(1.0)
    assert axle.rolling_u95 == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.4])
def test_time_without_a_slide_is_as_sure_as_noise_leaves_it(noise: float) -> None:
    """A slip of 4 % has no part above 5 %; noise of a speed counts as slip."""
    x, _ = signals()
    t, v = x.speed
    rim = v * np.where((t > 14.0) & (t < 25.0), 0.96, 1.0)
    rim += np.random.default_rng(2).normal(0.0, noise, len(t)) * (v > 0.0)
    (stop,) = measured(x._replace(rims={1: TimeSeries(t, rim)}))
    (axle,) = stop.axles
    assert axle.slip_bands is not None
    assert axle.rolling_u95 is not None
    assert axle.slip_bands[0] == pytest.approx(1.0, abs=axle.rolling_u95 + 0.01)
    assert (axle.rolling_u95 > 0.05) == (noise > 0.0)


def test_wheels_have_the_diameter_at_which_they_coast() -> None:
    """One definition, that of the slip: under the brake, a wheel keeps its creep."""
    made = result(1, 4000)
    record = made.axles[0].record
    worn = replace(record, wheel_speed=1.02 * record.wheel_speed)
    (rim, worn_rim) = (of_records([r], made.log, made.vehicle).rims[1] for r in (record, worn))
    radius = calibrate_radius(worn, made.vehicle)[0].value
    assert radius == pytest.approx(made.vehicle.radius(1).value / 1.02, rel=0.003)
    np.testing.assert_allclose(worn_rim.value, rim.value, rtol=0.003)


def test_releases_by_the_valves_are_counted() -> None:
    x, _ = signals()
    t = x.speed.t
    dumped = x.brakes[1].value * np.where((t > 15.0) & (np.mod(t, 4.0) < 1.0), 0.4, 1.0)
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t, dumped)}))
    assert stop.axles[0].valve_actions == len([k for k in range(16, 36, 4) if k < stop.end_s])


def test_valve_channels_come_before_the_pressure() -> None:
    x, _ = signals()
    t = x.speed.t
    opened = TimeSeries(t, 1.0 * ((t > 15.0) & (np.mod(t, 4.0) < 0.5)))
    reservoir = TimeSeries(t, 8e5 - 1e4 * np.clip(t - 15.0, 0.0, 5.0))
    states = {"valves": {1: opened}, "sanding": opened, "reservoir": reservoir}
    (stop,) = measured(x._replace(**states))
    (axle,) = stop.axles
    count = len([k for k in range(16, 60, 4) if k < stop.end_s])
    assert (axle.valve_actions, axle.valves_from) == (count, "valves")
    assert axle.vented_s == pytest.approx(0.5 * count, abs=0.1)
    assert stop.sanding_s == pytest.approx(0.5 * count, abs=0.1)
    assert stop.reservoir_drop_pa == pytest.approx(5e4)
    (plain,) = measured(x)
    assert (plain.axles[0].valves_from, plain.sanding_s) == ("pressure", None)


def test_axles_that_all_slide_give_a_wide_distance_that_holds_the_true_one() -> None:
    x, distance = signals(a=0.7)
    t, v = x.speed.t, x.speed.value
    slip = 0.15 * (1.0 - np.abs(np.sin(t))) * (t > ON + 2.0)
    rim = TimeSeries(t, v * (1.0 - slip))
    (stop,) = measured(x._replace(speed=rim, rims={1: rim}, speed_from="axles"))
    assert stop.distance_m is not None
    assert abs(stop.distance_m.value - distance) < stop.distance_m.u95
    assert stop.distance_m.u95 > 0.01 * distance
    assert (stop.response_time_s, stop.jerk) == (None, None)


def test_where_motors_brake_the_response_is_that_of_the_whole_force() -> None:
    analysed = result(1, 2000)
    (axle,) = analysed.axles
    by_pressure = of_records([axle.record], analysed.log, analysed.vehicle)
    np.testing.assert_allclose(by_pressure.brakes[1].interpolated(np.array([4.0])), 2.6e5, rtol=0.2)
    electric = replace(axle.record, motor_clamping=0.5 * axle.record.clamping_force)
    by_force = of_records([electric], analysed.log, analysed.vehicle)
    K = axle.record.clamping_force[~np.isnan(axle.record.clamping_force)]
    assert np.nanmax(by_force.brakes[1].value) == np.max(K)


@pytest.mark.parametrize(("degree", "derivative"), [(2, 0), (3, 2)])
def test_local_polynomials_are_those_of_savitzky_and_golay(degree: int, derivative: int) -> None:
    from scipy.signal import savgol_filter  # slow to import

    x = np.cumsum(np.random.default_rng(3).normal(size=120))
    expected = savgol_filter(x, 31, degree, deriv=derivative, mode="interp")
    np.testing.assert_allclose(local_polynomial(x, 31, degree, derivative), expected, atol=1e-9)


def test_a_command_that_is_not_logged_has_an_uncertain_dead_time() -> None:
    x, distance = signals(command=False)
    (stop,) = measured(x)
    assert stop.distance_m is not None
    assert abs(stop.distance_m.value - distance) < stop.distance_m.u95
    assert stop.pressure_bar == pytest.approx(3.0, abs=0.01)
    (stated,) = measured(x, dead_time=T_A)
    assert stated.distance_m is not None
    assert stated.distance_m.value == pytest.approx(distance, abs=1.0)
    assert stated.distance_m.u95 < 0.5 * stop.distance_m.u95


def test_the_dead_time_is_that_from_a_logged_command_to_the_first_rise() -> None:
    for command in (True, False):
        x, _ = signals(command=command)
        (stop,) = measured(x)
        assert (stop.dead_time_s is not None) == command
    (stop,) = measured(signals()[0])
    assert stop.dead_time_s is not None
    assert abs(stop.dead_time_s.value - T_A) < stop.dead_time_s.u95 < 0.1


def test_a_pressure_that_is_late_moves_the_begin_of_a_stop() -> None:
    """One that is early may be that of cars which brake first: that is uncertain alone."""
    made = result(1, 2000)
    record = made.axles[0].record
    plain = of_records([record], made.log, made.vehicle)
    for delay, shift in ((0.3, 0.3), (-0.3, 0.0)):
        late = replace(record, pressure_late=Parameter(delay, 0.02))
        found = of_records([late], made.log, made.vehicle)
        np.testing.assert_allclose(found.brakes[1].t, plain.brakes[1].t - shift)
        assert found.pressure_sigma > 0.5 * abs(delay)
    x, _ = signals()
    exact, stop = (measured(y)[0] for y in (x, x._replace(pressure_sigma=0.2)))
    assert exact.distance_m is not None
    assert stop.distance_m is not None
    assert stop.distance_m.u95 == pytest.approx(
        math.hypot(exact.distance_m.u95, 2.0 * 25.0 * 0.2), rel=0.01
    )


def test_a_brake_that_fills_for_most_of_the_stop_is_late_too() -> None:
    """As of a freight train in G: it has no response time, and the dead time is as uncertain."""
    x, _ = signals(command=False)
    t = x.speed.t
    slow, quick = 3e5 * np.clip((t - ON - 1.0) / 20.0, 0.0, 1.0), x.brakes[1].value
    by_brake = [measured(x._replace(brakes={1: TimeSeries(t, p)}))[0] for p in (slow, quick)]
    assert [stop.response_time_s is None for stop in by_brake] == [True, False]
    by_slow, by_quick = (stop.duration_s for stop in by_brake)
    assert by_slow is not None
    assert by_quick is not None
    assert by_slow.u95 > 5.0 * by_quick.u95


@pytest.mark.parametrize("brake", ["pressure", "brake_pipe"])
@pytest.mark.parametrize(("interval", "sigma"), [(0.02, DELAY_SIGMA), (1.0, RECEIVER_DELAY)])
def test_a_slow_train_speed_without_wheels_may_be_late(
    interval: float, sigma: float, brake: Meaning
) -> None:
    t = np.arange(0.0, 40.0, interval)
    v = np.clip(20.0 - (t - 10.0), 0.0, 20.0)

    def channel(meaning: Meaning, value: Floats) -> Channel:
        data = Column(np.round(1e9 * t).astype(np.int64), value, np.ones(len(t), np.bool_))
        return Channel(meaning, "", meaning, None, "", "", data)

    channels = (channel("train_speed", v), channel(brake, np.where(t > 10.0, 3e5, 0.0)))
    found = of_log(Log("a.csv", "csv", "", False, len(t), channels, ()), Vehicle())
    assert found is not None
    assert found.delay_sigma == pytest.approx(sigma)


@pytest.mark.parametrize(("delay", "sigma"), [(None, RECEIVER_DELAY), (Parameter(0.8, 0.03), 0.03)])
def test_a_slow_train_speed_beside_wheels_may_be_late_unless_they_show_it(
    delay: Parameter | None, sigma: float
) -> None:
    made = result(1, 2000)
    record = replace(made.axles[0].record, train_speed_interval=1.0, train_speed_late=delay)
    assert of_records([record], made.log, made.vehicle).delay_sigma == sigma


def test_a_slow_train_speed_takes_no_shape_of_wheels_that_slide() -> None:
    made = result(2, 6000)
    slid = replace(made.axles[1].record, train_speed_interval=1.0)
    x = of_records([slid], made.log, made.vehicle)
    assert x.is_coarse is not None
    t, v = x.speed
    slides = (t > 0.31 * t[-1]) & (t < 0.41 * t[-1])
    assert x.is_coarse[slides].all()
    assert slid.train_speed is not None
    assert np.array_equal(v[slides], slid.train_speed[slides])
    (_, edges) = true_runs(x.is_coarse)[0]
    assert edges * 0.01 > 0.42 * t[-1] + 2.0  # so wide as the average of the difference
    rolled = of_records(
        [replace(made.axles[0].record, train_speed_interval=1.0)], made.log, made.vehicle
    )
    assert rolled.is_coarse is not None
    assert not rolled.is_coarse[t < 0.5 * t[-1]].any()


def test_a_slow_and_late_train_speed_does_not_move_while_all_wheels_stand() -> None:
    made = result(1, 6000)
    record = made.axles[0].record
    t = (record.t - record.t[0]) * 1e-9
    v = np.clip(20.0 - 0.5 * (t - 5.0), 0.0, 20.0)
    stands, readings = float(t[np.argmax(v <= 0.0)]), np.arange(0.0, t[-1], 1.0)
    late = np.interp(t, readings, np.interp(readings - 0.8, t, v))
    wheel = v / made.vehicle.radius(record.axle).value
    slow = replace(record, wheel_speed=wheel, train_speed=late, train_speed_interval=1.0)
    x = of_records([slow], made.log, made.vehicle)
    moves = x.speed.t[x.speed.value > STANDING]
    assert moves[-1] - x.speed.t[0] < stands + 0.8  # not for longer than the speed is late


@pytest.mark.parametrize("ends", [(-4.0, 0.9), (-4.0, 2.0), (0.2, 3.0), (-20.0, 1.0)])
def test_a_rise_within_a_gap_of_the_pressure_is_no_response(ends: tuple[float, float]) -> None:
    x, _ = signals()
    t, p = x.brakes[1]
    seen = (t < ON + ends[0]) | (t > ON + ends[1])
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t[seen], p[seen])}))
    assert stop.response_time_s is None
    assert stop.mean_deceleration is not None


def test_a_pressure_that_ends_before_standstill_ends_no_stop() -> None:
    x, distance = signals()
    t, p = x.brakes[1]
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t[t < 25.0], p[t < 25.0])}))
    assert stop.valid
    assert stop.distance_m is not None
    assert stop.distance_m.value == pytest.approx(distance, rel=0.005)


def test_a_pressure_that_begins_in_a_braking_shows_no_command() -> None:
    x, _ = signals(command=False)
    t, p = x.brakes[1]
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t[t > 14.0], p[t > 14.0])}))
    assert stop.reason == "the log begins with the brake applied"


def test_a_stop_in_which_the_clock_is_set_back_is_not_valid() -> None:
    made = result(1, 6000)
    record = made.axles[0].record
    back = record.t.copy()
    back[3000:] -= 10 * 10**9
    assert not of_records([record], made.log, made.vehicle).overlaps
    ((start, end),) = of_records([replace(record, t=back)], made.log, made.vehicle).overlaps
    assert end - start == pytest.approx(10.0, abs=0.05)
    x, _ = signals()
    assert measured(x._replace(overlaps=[(20.0, 30.0)]))[0].reason == "the clock was set back"
    assert measured(x._replace(overlaps=[(1.0, 9.0)]))[0].valid


@pytest.mark.parametrize(("vent", "is_known"), [(2.3, True), (1.7, False)])
def test_a_valve_that_vents_a_level_leaves_the_response_known(vent: float, is_known: bool) -> None:
    x, _ = signals()
    t, p = x.brakes[1]
    since = t - ON - vent
    vented = np.where((since > 0.0) & (since < 3.0), 0.4, 1.0) * np.where(since > 3.0, 0.97, 1.0)
    (stop,) = measured(x._replace(brakes={1: TimeSeries(t, p * vented)}))
    assert (stop.response_time_s is not None) == is_known
    if stop.response_time_s:
        assert stop.response_time_s.value == pytest.approx((0.52 + 1.54) / 2.0, abs=0.02)


def test_where_nobody_knows_the_share_of_motors_the_deceleration_shows_the_response() -> None:
    x, _ = signals()
    (by_brakes,) = measured(x)
    (by_speed,) = measured(x._replace(mix_unknown=True))
    assert (by_brakes.response_from, by_speed.response_from) == ("brakes", "deceleration")
    assert by_speed.response_time_s is not None
    assert by_speed.response_time_s.value == pytest.approx((T_A + T_B) / 2.0, abs=0.05)
    slow_brake = TimeSeries(x.speed.t, 3e5 * np.clip((x.speed.t - ON) / 12.0, 0.0, 1.0))
    (unlike,) = measured(x._replace(mix_unknown=True, brakes={1: slow_brake}))
    assert unlike.response_time_s is None  # never that of the pressure


@pytest.mark.parametrize("slides", [False, True])
def test_wheels_that_roll_fill_a_gap_of_the_train_speed(slides: bool) -> None:
    made = result(1, 6000)
    record = made.axles[0].record
    t = (record.t - record.t[0]) * 1e-9
    v = np.clip(20.0 - 0.5 * (t - 5.0), 0.0, 20.0)
    slip = np.where(t > 5.0, 0.004, 0.0) + slides * np.interp(t, [15, 17, 18], [0.0, 0.3, 0.0])
    wheel = v * (1.0 - slip) / made.vehicle.radius(record.axle).value
    gap = (t > 12.0) & (t < 22.0)
    broken = replace(
        record, wheel_speed=wheel, train_speed=np.where(gap, np.nan, v), train_speed_interval=0.01
    )
    x = of_records([broken], made.log, made.vehicle)
    if slides:  # the train is not known
        assert x.filled is None
        assert np.isnan(x.speed.value[gap]).all()
        return
    assert x.filled is not None
    assert np.array_equal(x.filled, gap)
    assert x.speed.value == pytest.approx(v, abs=0.02)
    assert _gap_error(x, 5.0, 45.0) == pytest.approx(0.01 * np.trapezoid(v[gap], t[gap]), rel=0.01)


@pytest.mark.parametrize("rate", [50.0, 10.0, 5.0])
def test_the_jerk_is_that_of_the_train_whatever_the_noise(rate: float) -> None:
    """The highest of noisy values is higher than the highest value, and slow readings have more.

    A slow speed is on the wheels' times, as lines between its readings.
    """
    x, _ = signals()
    (exact,) = measured(x)
    assert exact.jerk is not None
    rng, errors, inside = np.random.default_rng(5), [], 0
    for _ in range(60):
        t = np.arange(rng.uniform(0.0, 1.0 / rate), x.speed.t[-1], 1.0 / rate)
        v = x.speed.interpolated(t)
        v += rng.normal(0.0, 0.03, len(t)) * (v > 0.0)
        slow = TimeSeries(x.speed.t, np.interp(x.speed.t, t, v))
        (stop,) = measured(x._replace(speed=slow, interval=1.0 / rate))
        assert stop.jerk is not None
        errors.append(stop.jerk.value - exact.jerk.value)
        inside += abs(errors[-1]) < stop.jerk.u95
    assert inside >= 56
    assert abs(np.mean(errors)) < 0.25 * stop.jerk.u95


def test_a_jerk_by_wheels_is_as_uncertain_as_their_creep() -> None:
    """They creep more as the brake builds up: they slow before the train, and more at once."""
    x, _ = signals(v0=36.0, a=1.2)
    t, v = x.speed
    creep = 1.2 * brake_share(t) * (v > 0.0) / G / 20.0  # 20: µ per slip
    wheel = TimeSeries(t, v * (1.0 - creep))
    (train,), (stop,) = (measured(y) for y in (x, x._replace(speed=wheel, speed_from="axles")))
    assert train.jerk is not None
    assert stop.jerk is not None
    assert abs(stop.jerk.value - train.jerk.value) < stop.jerk.u95 < 0.3 * stop.jerk.value


def test_wheels_show_no_jerk_where_every_valve_acts_again_and_again() -> None:
    x, _ = signals()
    t = x.speed.t
    vents = {1: TimeSeries(t, ((t > ON) & (t % 2.0 < 0.2)) * 1.0)}
    for source, shows in (("train", True), ("axles", False)):
        (stop,) = measured(x._replace(speed_from=source, valves=vents))
        assert (stop.jerk is not None) == shows


def test_a_sensor_that_ends_early_or_has_a_gap_shows_no_jerk_and_no_curve_there() -> None:
    x, _ = signals()
    (exact,) = measured(x)
    assert exact.jerk is not None
    t = np.arange(0.0, x.speed.t[-1], 0.1)
    v = x.speed.interpolated(t)
    ends = np.where(v < 1.4, 0.0, v)  # 5 km/h; then read as lines on the wheels' times
    early = TimeSeries(x.speed.t, np.interp(x.speed.t, t, ends))
    (stop,) = measured(x._replace(speed=early, interval=0.1))
    assert stop.jerk is not None
    assert stop.jerk.value == pytest.approx(exact.jerk.value, abs=0.02)
    assert stop.speed is not None
    after_command, curve = stop.speed
    last = float(t[ends > 0.0][-1]) - stop.start_s
    np.testing.assert_array_equal(np.isnan(curve), after_command > last - 0.5 + 1e-6)
    hole = np.abs(x.speed.t - 20.0) < 1.5
    gap = TimeSeries(x.speed.t[~hole], x.speed.value[~hole])
    (stop,) = measured(x._replace(speed=gap))
    assert stop.jerk is not None
    assert stop.jerk.value == pytest.approx(exact.jerk.value, abs=0.02)
    assert stop.speed is not None
    missing = stop.speed[0][np.isnan(stop.speed[1])] + stop.start_s
    in_gap = missing[missing < 30.0]
    assert (in_gap[0], in_gap[-1]) == pytest.approx((18.0, 22.0), abs=0.06)


def test_readings_that_are_too_slow_show_no_jerk() -> None:
    x, _ = signals()
    (stop,) = measured(x._replace(interval=0.3))
    assert stop.jerk is None
    (stop,) = measured(x._replace(interval=0.25 * 1.00001))  # 4 a second by a clock that is slow
    assert stop.jerk is not None


@pytest.mark.parametrize(
    ("definition", "pages"),
    [
        (JERK, ("glossary.md",)),  # howto/brake-test.md says it in short sentences
        (SLIDE_SPAN, ("glossary.md", "howto/a-slide.md")),
    ],
)
def test_pages_repeat_the_definitions(definition: str, pages: tuple[str, ...]) -> None:
    for page in pages:
        assert definition in (Path(__file__).parents[2] / "docs" / page).read_text("utf-8")


def test_a_slide_is_what_its_definition_says() -> None:
    numbers = f"{END_SLIP:.0%}", f"{SLIDE:.0%}", f"{SHORTEST_SLIDE:g} s"
    assert all(text.replace("%", " %") in SLIDE_SPAN for text in numbers)


def test_a_coarse_speed_has_no_jerk() -> None:
    x, _ = signals()
    (stop,) = measured(x)
    assert stop.jerk is not None
    (stop,) = measured(x._replace(is_coarse=np.abs(x.speed.t - 20.0) < 1.0))
    assert stop.jerk is None
    assert stop.distance_m is not None
    (stop,) = measured(x._replace(is_coarse=x.speed.t < ON - 1.0))
    assert stop.jerk is not None


def test_the_standstill_between_two_readings_of_a_slow_speed_is_as_uncertain_as_they_are() -> None:
    x, _ = signals()
    slow = x._replace(is_coarse=np.ones(len(x.speed.t), dtype=np.bool_), interval=1.0)
    for known, interval in ((x, 0.0), (slow, 1.0)):
        (stop,) = measured(known)
        assert stop.duration_s is not None
        assert stop.duration_s.u95 == pytest.approx(2.0 * interval / math.sqrt(12.0), abs=0.1)
