"""The simulator against its own equations, closed forms, and the sample logs on disk."""

import dataclasses
import importlib.util
import math
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.simulated import friction_force
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.core import physics
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Floats
from adhesion_cli.rail import creep_law
from adhesion_cli.wsp import scenario, simulate
from adhesion_cli.wsp.plant import demand_of, plant_of, track_of
from adhesion_cli.wsp.scenario import (
    Command,
    Rail,
    Scenario,
    ScenarioBrake,
    ScenarioTrain,
    Section,
    Sensor,
    Wsp,
)
from adhesion_cli.wsp.simulate import Recording, Simulation

SAMPLES = Path(__file__).parents[2] / "sample_logs"
NAMES = sorted(simulate.scenarios())
PATCH = creep_law.Contact().patch(4797.0 * physics.G)


@cache
def simulated(name: str, dt: float | None = None) -> Simulation:
    return simulate.run(simulate.load(name), dt=dt)


def braked(pressure: float = 6e5, condition: str = "dry", **changes: object) -> Scenario:
    """A plain brake application from t = 0 on."""
    s = Scenario(
        name="test",
        description="",
        duration=10.0,
        rail=Rail((Section(0.0, condition),)),
        brake=ScenarioBrake((Command(0.0, pressure=pressure),)),
    )
    return dataclasses.replace(s, **changes)  # type: ignore[arg-type]


def recorded(sensor: Sensor, of: str = "service-brake") -> Recording:
    base = simulated(of)
    s = dataclasses.replace(base.scenario, sensor=(sensor,))
    (recording,) = simulate.log(dataclasses.replace(base, scenario=s))
    return recording


def integral(rate: Floats, dt: float) -> Floats:
    steps = (rate[1:] + rate[:-1]) / 2.0 * dt
    return np.concatenate((np.zeros_like(rate[:1]), np.cumsum(steps, axis=0)))


# --- (3) and the friction law -------------------------------------------------------------------

conditions = st.sampled_from(sorted(creep_law.conditions()))
speeds = st.floats(0.0, 80.0)
slidings = st.floats(-40.0, 40.0)


@given(conditions, speeds, slidings)
def test_force_is_odd_and_below_friction(name: str, speed: float, sliding: float) -> None:
    law = creep_law.condition(name)
    force, slope = creep_law.creep_force(sliding, speed, law, PATCH)
    assert creep_law.creep_force(-sliding, speed, law, PATCH) == (-force, slope)
    friction = law.f0 * ((1.0 - law.A) * math.exp(-law.B * abs(sliding)) + law.A)
    assert abs(force) <= PATCH.load * friction
    assert force * sliding >= 0.0


@given(conditions, st.floats(0.5, 80.0), st.floats(1e-3, 10.0), st.sampled_from([0.0, 2e-3]))
def test_slope_is_the_derivative(name: str, speed: float, sliding: float, creep_y: float) -> None:
    patch = PATCH._replace(creep_y=creep_y, stiffness_y=PATCH.stiffness_x)
    law, step = creep_law.condition(name), 1e-6 * sliding
    up = creep_law.creep_force(sliding + step, speed, law, patch)[0]
    down = creep_law.creep_force(sliding - step, speed, law, patch)[0]
    slope = creep_law.creep_force(sliding, speed, law, patch)[1]
    assert slope == pytest.approx((up - down) / (2 * step), rel=1e-4, abs=1e-5 * PATCH.load)


def test_small_creep_is_linear_with_kalkers_slope() -> None:
    c = creep_law.Contact()
    for law in creep_law.conditions().values():
        kalker = 2.0 * c.shear_modulus * c.a * c.b * c.c11  # both wheels, per unit of creep
        reduced = kalker * (law.k_a + law.k_s) / 2.0
        force, slope = creep_law.creep_force(1e-7 * 20.0, 20.0, law, PATCH)
        assert force == pytest.approx(reduced * 1e-7, rel=1e-4)
        assert slope == pytest.approx(reduced / 20.0, rel=1e-3)


def test_large_creep_saturates_at_falling_friction() -> None:
    law = creep_law.condition("dry")
    force = creep_law.creep_force(5.0, 10.0, law, PATCH)[0] / PATCH.load
    assert force == pytest.approx(0.55 * (0.6 * math.exp(-0.6 * 5.0) + 0.4), rel=0.01)
    wet = [
        creep_law.creep_force(s * 10.0, 10.0, creep_law.condition("wet"), PATCH)[0]
        for s in (0.05, 0.3)
    ]
    assert wet[0] > wet[1]  # past the adhesion optimum


def test_lateral_creep_takes_from_the_longitudinal_force() -> None:
    law = creep_law.condition("wet")
    plain = creep_law.creep_force(0.05, 20.0, law, PATCH)[0]
    total = creep_law.Contact(lateral_creep=2.5e-3).patch(PATCH.load)
    along = creep_law.creep_force(0.05, 20.0, law, total)[0]
    assert 0.5 * plain < along < 0.95 * plain
    mirrored = creep_law.Contact(lateral_creep=-2.5e-3).patch(PATCH.load)
    assert creep_law.creep_force(0.05, 20.0, law, mirrored)[0] == along


def test_published_sets_are_as_published_and_the_others_say_so() -> None:
    assert creep_law.condition("dry") == (1.00, 0.40, 0.55, 0.40, 0.60)
    assert creep_law.condition("wet") == (0.30, 0.10, 0.30, 0.40, 0.20)
    assert creep_law.condition("low").f0 == 0.06
    assert creep_law.condition("very-low").f0 == 0.03
    text = (Path(creep_law.__file__).parent / "rails.toml").read_text("utf-8")
    assert text.count('status = "unverified"') == 2


# --- (1), energy, convergence -------------------------------------------------------------------


def test_rolling_force_of_the_papers_vehicle() -> None:
    r = simulated("paper-constant")
    assert r.clamping_force[5000, 0] == pytest.approx(21000.0, rel=1e-12)
    assert r.adhesion_force[5000, 0] == pytest.approx(
        6300.0 / (1.0 + 145.0 / (4797.0 * 0.42**2)), rel=3e-4
    )
    assert round(r.adhesion_force[5000, 0]) == pytest.approx(5378, abs=1)
    slowing = (r.train_speed[4000] - r.train_speed[6000]) / 2.0
    assert slowing == pytest.approx(1.121, abs=1e-3)


# Without the rig, which knows no brake, and a stop in which wheels lock: a kink within a step.
@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("roller-rig", "slippery-stop")])
def test_truth_satisfies_the_equations(name: str) -> None:
    r, dt = simulated(name), 1e-3
    vehicle, n = r.scenario.vehicle, r.scenario.train.axles
    inertia, m = vehicle.wheelset_inertia.value, vehicle.axle_mass.value
    R = np.array([vehicle.radius(axle).value for axle in range(1, n + 1)])
    F, B, moving = r.adhesion_force, friction_force(r), r.train_speed > 0.0
    spin = r.wheel_speed[0] + integral(R / inertia * (F - B), dt)  # (1)
    speed = r.train_speed[0] - integral(F.sum(axis=1) / (n * m), dt)  # (1)
    assert np.abs(r.wheel_speed - spin)[moving].max() < 2e-3
    assert np.abs(r.train_speed - speed)[moving].max() < 1e-4
    assert (friction_force(r) <= 0.3 * r.clamping_force + 1e-9).all()
    assert (r.wheel_speed >= 0.0).all()
    rolling = np.nan_to_num(r.slip) < 0.9
    assert np.equal(B, 0.3 * r.clamping_force)[rolling & (r.wheel_speed > 0.0)].all()

    lost = integral(
        (B * R * r.wheel_speed + F * (r.train_speed[:, None] - R * r.wheel_speed)).sum(1), dt
    )
    energy = 0.5 * n * m * r.train_speed**2 + 0.5 * inertia * (r.wheel_speed**2).sum(axis=1)
    assert energy[0] - energy[-1] == pytest.approx(lost[-1], rel=1e-6)


@pytest.mark.parametrize("name", ["paper-constant", "paper-varying"])
def test_halving_the_step_quarters_the_error(name: str) -> None:
    exact = simulated(name, 1.25e-4)
    errors = []
    for dt in (4e-3, 2e-3, 1e-3):
        r, every = simulated(name, dt), round(dt / 1.25e-4)
        errors.append([
            np.abs(r.train_speed - exact.train_speed[::every]).max(),
            np.sqrt(np.mean((r.wheel_speed - exact.wheel_speed[::every]) ** 2)),
        ])  # fmt: skip
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (order > 1.8).all()
    assert errors[-1][1] < 1e-4


@pytest.mark.parametrize("name", NAMES)
def test_half_the_step_changes_no_bundled_scenario(name: str) -> None:
    full, half = simulated(name), simulated(name, 5e-4)
    assert np.abs(full.train_speed - half.train_speed[::2]).max() < 1e-4
    error = full.adhesion_force - half.adhesion_force[::2]
    assert np.sqrt(np.mean(error**2)) < 0.5  # [N]


def test_compiled_equals_plain_python() -> None:
    s = dataclasses.replace(simulate.load("low-adhesion"), duration=0.3)
    s = dataclasses.replace(
        s,
        rail=Rail((Section(0.0, "low"),), blend=0.1),
        brake=ScenarioBrake((Command(0.0, pressure=9e5),)),
    )
    fast = simulate.run(s)
    n = len(fast.t)
    pressure, rim, speed, distance = np.zeros((n, 4)), np.zeros((n, 4)), np.zeros(n), np.zeros(n)
    plant, start = plant_of(s), simulate.rolling(s.train.speed, s.train.axles)
    failed = simulate._integrate(
        plant, track_of(s), demand_of(s), s.wsp or Wsp(period=math.inf), *start, s.dt,
        pressure, rim, speed, distance,
    )  # fmt: skip
    assert math.isnan(failed)
    for plain, compiled in zip(
        (pressure, rim / plant.radius, speed, distance),
        (fast.pressure, fast.wheel_speed, fast.train_speed, fast.distance),
        strict=True,
    ):
        np.testing.assert_allclose(plain, compiled, rtol=1e-12, atol=1e-12)
    assert np.ptp(fast.adhesion_force[-1]) > 100.0  # the axles differ


# --- locked wheels and standstill ---------------------------------------------------------------


def test_a_locked_wheel_stays_locked_and_the_train_stops_for_good() -> None:
    s = braked(9e5, "very-low", duration=120.0, train=ScenarioTrain(speed=10.0))
    r = simulate.run(s)
    locked = r.wheel_speed[:, 0] == 0.0
    first = int(np.argmax(locked))
    assert locked[first:].all()
    assert r.train_speed[first] > 5.0
    sliding = locked & (r.train_speed > 1.0)
    assert (r.slip[sliding] == 1.0).all()
    law = creep_law.condition("very-low")
    expected = [creep_law.creep_force(v, v, law, PATCH)[0] for v in r.train_speed[sliding]]
    np.testing.assert_array_equal(r.adhesion_force[sliding, 0], expected)
    np.testing.assert_array_equal(friction_force(r)[sliding], r.adhesion_force[sliding])
    v = r.train_speed[sliding]
    slowed = v[0] - integral(r.adhesion_force[sliding, 0] / 4797.0, 1e-3)  # (1)
    assert np.abs(v - slowed).max() < 1e-6
    stands = r.train_speed == 0.0
    assert stands[-1]
    assert stands[int(np.argmax(stands)) :].all()
    assert (r.adhesion_force[stands] == 0.0).all()
    assert np.isnan(r.slip[stands]).all()
    assert (np.diff(r.train_speed) <= 0.0).all()


@pytest.mark.parametrize("dt", [5e-3, 1e-3, 2e-4])
def test_a_rolling_train_stops_at_zero(dt: float) -> None:
    r = simulate.run(braked(train=ScenarioTrain(speed=3.0)), dt=dt)
    assert r.train_speed[-1] == 0.0
    assert r.wheel_speed[-1, 0] == 0.0
    braking = 0.3 * r.clamping_force[0, 0] / (1.0 + 145.0 / (4797.0 * 0.42**2)) / 4797.0
    assert r.distance[-1] == pytest.approx(3.0**2 / 2.0 / braking, rel=2e-3)


def test_wheels_turn_again_when_the_brake_is_released() -> None:
    brake = ScenarioBrake((Command(0.0, pressure=9e5), Command(6.0, pressure=0.0)))
    r = simulate.run(braked(9e5, "low", brake=brake, train=ScenarioTrain(speed=10.0)))
    assert r.wheel_speed[5900, 0] == 0.0
    assert r.wheel_speed[-1, 0] * 0.42 == pytest.approx(r.train_speed[-1], rel=1e-6)
    assert r.train_speed[-1] > 1.0


def test_wsp_prevents_the_lock() -> None:
    r = simulated("low-adhesion")
    fast = r.train_speed > 2.0
    assert np.nanmax(r.slip[fast]) < 0.35
    assert np.nanmax(r.slip[fast][:, :2], axis=0).min() > 0.1  # two axles slide
    assert np.nanmax(r.slip[fast][:, 2:]) < 0.01  # and two do not
    speeding = (r.wheel_speed[40:] > r.wheel_speed[20:-20]) & (
        r.wheel_speed[20:-20] > r.wheel_speed[:-40]
    )
    vented = np.diff(r.pressure, axis=0)[39:] < 0.0
    assert vented.any()
    assert not (vented & speeding).any()  # a wheel that recovers keeps its pressure
    unprotected = simulate.run(dataclasses.replace(r.scenario, wsp=None))
    assert np.nanmax(unprotected.slip[unprotected.train_speed > 2.0]) == 1.0


sections = st.tuples(
    st.floats(2.0, 30.0),
    st.sampled_from(sorted(creep_law.conditions())),
    st.sampled_from([0.001, 0.3, 1.0]),
)
demands = st.tuples(
    st.floats(0.0, 2.0), st.sampled_from([0.0, 3e5, 2e6]), st.sampled_from([0.0, 0.5])
)


@given(
    st.lists(sections, min_size=1, max_size=4),
    st.lists(demands, min_size=1, max_size=4),
    st.sampled_from([0.0, 0.3, 5.0, 100.0]),
    st.sampled_from([2e-2, 1e-3]),
    st.sampled_from([None, Wsp(), Wsp(period=0.0137)]),
    st.sampled_from([0.0, 5e-3]),
)
def test_any_brake_on_any_rail_has_a_solution(
    places: list[tuple[float, str, float]], demand: list[tuple[float, float, float]],
    speed: float, dt: float, wsp: Wsp | None, creep_y: float,
) -> None:  # fmt: skip
    at, on = 0.0, []
    for length, name, scale in places:
        on.append(Section(at, name, scale))
        at += length
    t, commands = 0.0, []
    for wait, pressure, ramp in demand:
        commands.append(Command(t + wait, pressure=pressure, ramp=ramp))
        t += wait + ramp
    s = braked(
        rail=Rail(tuple(on)),
        brake=ScenarioBrake(tuple(commands), vent_time=0.2), wsp=wsp, duration=5.0,
        train=ScenarioTrain(speed, 2, cleaning=(1.0, 1.7)),
        contact=creep_law.Contact(lateral_creep=creep_y),
    )  # fmt: skip
    r = simulate.run(s, dt=dt)
    assert np.isfinite(r.adhesion_force).all()
    assert (r.wheel_speed >= 0.0).all()
    assert r.train_speed.min() >= 0.0
    assert r.train_speed.max() <= speed
    assert (np.abs(r.adhesion_force) <= PATCH.load * 0.55 * 1.7).all()


# --- brake, rail, rig ---------------------------------------------------------------------------


def test_cylinder_fills_after_the_dead_time_with_its_time_constant() -> None:
    brake = ScenarioBrake(
        (Command(1.0, pressure=4e5), Command(5.0, pressure=0.0)),
        dead_time=0.25, fill_time=0.4, vent_time=0.7,
    )  # fmt: skip
    r = simulate.run(braked(brake=brake))
    t, p = r.t * 1e-9, r.pressure[:, 0]
    fill = np.where(t > 1.25, 4e5 * (1.0 - np.exp(-np.maximum(t - 1.25, 0.0) / 0.4)), 0.0)
    np.testing.assert_allclose(p[t <= 5.25], fill[t <= 5.25], atol=1e-4)
    after = t >= 5.25
    np.testing.assert_allclose(p[after], fill[5250] * np.exp(-(t[after] - 5.25) / 0.7), atol=1e-4)


def test_cylinder_is_no_faster_than_its_rate() -> None:
    brake = ScenarioBrake((Command(1.0003, pressure=3e5),), fill_rate=2e5)
    r = simulate.run(braked(brake=brake))
    t = r.t * 1e-9
    np.testing.assert_allclose(r.pressure[:, 0], np.clip((t - 1.0003) * 2e5, 0.0, 3e5), atol=1e-3)


def test_clamping_force_may_be_demanded_instead_of_pressure() -> None:
    brake = ScenarioBrake((Command(0.0, clamping_force=15000.0, ramp=2.0),))
    r = simulate.run(braked(brake=brake))
    assert r.clamping_force[4000, 0] == pytest.approx(15000.0)
    np.testing.assert_array_equal(
        r.clamping_force, physics.clamping_force(r.pressure, r.scenario.vehicle)
    )


def test_each_axle_meets_a_film_where_it_runs() -> None:
    film = scenario.Film("very-low", first=50.0, length=5.0, pitch=20.0, count=2)
    on = Rail((Section(0.0, "dry"),), film=film, blend=0.05)
    s = braked(7e5, rail=on, train=ScenarioTrain(20.0, 2, (0.0, 4.0)))
    r = simulate.run(s)
    for axle, behind in ((0, 0.0), (1, 4.0)):
        x = r.distance - behind
        filmed = ((x > 50.1) & (x < 55.0)) | ((x > 70.1) & (x < 75.0))
        assert (r.adhesion_force[filmed, axle] < 0.03 * PATCH.load).all()
        clear = (x > 30.0) & (x < 50.0)
        assert (r.adhesion_force[clear, axle] > 0.05 * PATCH.load).all()


def test_friction_swings_with_time() -> None:
    on = Rail((Section(0.0, "low"),), along="time", wave=scenario.Wave(0.5, 2.0))
    r = simulate.run(braked(9e5, rail=on, wsp=Wsp()))
    law = creep_law.condition("low")
    k = 2500  # a quarter past a whole swing: f0 is half as high again
    assert r.slip[k, 0] > 0.01
    speed, sliding = r.train_speed[k], r.slip[k, 0] * r.train_speed[k]
    expected = creep_law.creep_force(sliding, speed, law._replace(f0=1.5 * law.f0), PATCH)[0]
    assert r.adhesion_force[k, 0] == pytest.approx(expected, rel=1e-9)


def test_rig_sweeps_slip_and_asks_the_brake_for_the_rest() -> None:
    r = simulated("roller-rig")
    np.testing.assert_allclose(r.slip[:, 0], np.linspace(0.0, 0.3, len(r.t)), atol=1e-12)
    spin = np.gradient(r.wheel_speed[:, 0], 1e-3)
    rhs = 0.42 / 145.0 * (r.adhesion_force[:, 0] - 0.3 * r.clamping_force[:, 0])  # (1)
    np.testing.assert_allclose(spin, rhs, atol=1e-6)
    peak = int(np.argmax(r.adhesion_force))
    assert 0.02 < r.slip[peak, 0] < 0.2  # wet rail: an optimum, and a fall beyond it
    assert r.adhesion_force[-1, 0] < 0.95 * r.adhesion_force[peak, 0]


# --- sensors ------------------------------------------------------------------------------------


def test_noise_has_its_variance_and_a_standing_wheel_none() -> None:
    r = recorded(Sensor("wheel_speed", "rad/s", rate=1000.0, noise_variance=1e-5))
    truth = np.interp(
        r.t, simulated("service-brake").t, simulated("service-brake").wheel_speed[:, 0]
    )
    assert np.var(r.value - truth) == pytest.approx(1e-5, rel=0.05)
    stop = recorded(Sensor("wheel_speed", "km/h", noise_variance=1e-5), "leaf-film")
    assert (stop.value[-100:] == 0.0).all()


def test_rounding_leaves_whole_steps_and_prints_them() -> None:
    r = recorded(Sensor("pressure", "bar", noise_variance=1e6, resolution=0.05))
    steps = r.value / 0.05
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert r.decimals == 2
    assert [float(text) for text in r.texts()] == r.value.tolist()
    assert len(set(r.value)) > 100


def test_delay_is_where_the_signal_says() -> None:
    r = recorded(Sensor("pressure", "Pa", rate=200.0, delay=0.12))
    base = simulated("service-brake")
    shifts = np.arange(0.0, 0.3, 0.005)
    errors = [
        np.abs(r.value - np.interp(r.t * 1e-9 - s, base.t * 1e-9, base.pressure[:, 0])).max()
        for s in shifts
    ]
    assert shifts[int(np.argmin(errors))] == pytest.approx(0.12)
    assert min(errors) < 1.0


def test_jitter_moves_stamps_but_never_past_each_other() -> None:
    r = recorded(Sensor("wheel_speed", "m/s", rate=100.0, jitter=0.004))
    off = r.t * 1e-9 - np.arange(len(r.t)) / 100.0
    assert 0.0038 < np.abs(off).max() <= 0.004
    assert (np.diff(r.t) > 0).all()


def test_loss_and_gaps_drop_samples() -> None:
    r = recorded(Sensor("wheel_speed", "m/s", rate=1000.0, loss=0.2))
    assert len(r.t) == pytest.approx(0.8 * 26001, rel=0.02)
    r = recorded(Sensor("wheel_speed", "m/s", rate=100.0, gaps=((3.0, 4.0), (10.0, 10.5))))
    assert len(r.t) == 2601 - 101 - 51
    assert not ((r.t > 3_000_000_000) & (r.t < 4_000_000_000)).any()


def test_pulse_counter_counts_the_wheels_turns() -> None:
    base = simulated("service-brake")
    count = recorded(Sensor("wheel_speed", "count", rate=50.0, teeth=80))
    turned = integral(base.wheel_speed[:, 0], 1e-3)[::20] / (2 * math.pi) * 80
    assert (np.diff(count.value) >= 0).all()
    assert np.ptp(count.value - turned) < 1.0 + 1e-6
    speed = recorded(Sensor("wheel_speed", "rad/s", rate=50.0, teeth=80))
    step = 2 * math.pi * 50.0 / 80
    np.testing.assert_allclose(speed.value / step, np.round(speed.value / step), atol=1e-9)
    assert len(speed.t) == len(count.t) - 1
    assert (
        np.abs(speed.value - np.interp(speed.t, base.t, base.wheel_speed[:, 0])).max() < 1.01 * step
    )


def test_wheel_diameter_and_offset_errors() -> None:
    good = recorded(Sensor("wheel_speed", "km/h")).value
    worn = recorded(Sensor("wheel_speed", "km/h", diameter_error=-0.02)).value
    np.testing.assert_allclose(worn, good / 0.98, rtol=1e-12)
    angular = recorded(Sensor("wheel_speed", "rad/s", diameter_error=-0.02)).value
    np.testing.assert_allclose(angular * 0.42 * 3.6, good, rtol=1e-12)
    plain = recorded(Sensor("pressure", "kPa")).value
    np.testing.assert_allclose(recorded(Sensor("pressure", "kPa", offset=5e3)).value - plain, 5.0)


def test_same_seed_same_log_other_seed_other_noise() -> None:
    s = simulate.load("four-axles")
    first, again, other = (simulate.log(simulate.run(s, seed=seed)) for seed in (1, 1, 2))
    for a, b in zip(first, again, strict=True):
        assert a.texts() == b.texts()
        np.testing.assert_array_equal(a.t, b.t)
    assert first[0].texts() != other[0].texts()
    assert first[0].texts() != first[1].texts()  # no two channels share their noise
    more = dataclasses.replace(s, sensor=(*s.sensor, Sensor("slip")))
    longer = simulate.log(simulate.run(more, seed=1))
    assert longer[0].texts() == first[0].texts()


# --- scenario files -----------------------------------------------------------------------------

MINIMAL = 'description = ""\nduration = 1.0\n[[rail.section]]\nat = 0.0\ncondition = "dry"\n'


def test_every_scenario_is_described_and_has_a_log() -> None:
    wanted = {"paper-constant", "paper-varying", "service-brake", "low-adhesion", "leaf-film"}
    assert wanted | {"four-axles", "roller-rig", "slippery-stop"} == set(NAMES)
    for name in NAMES:
        assert simulate.scenarios()[name]
        assert simulated(name).pressure.max() <= 10e5 or name == "roller-rig"
        signals = {r.signal for r in simulate.log(simulated(name))}
        assert {"wheel_speed", "truth"} <= signals
        assert signals & {"pressure", "clamping_force"}


def test_a_rail_may_state_constants_of_its_own(tmp_path: Path) -> None:
    constants = {**creep_law.condition("low")._asdict(), "B": 0.3}
    table = "{" + ", ".join(f"{k} = {x}" for k, x in constants.items()) + "}"
    path = tmp_path / "mine.toml"
    path.write_text(MINIMAL.replace('"dry"', table))
    s = simulate.load(path)
    assert s.rail.section[0].condition == creep_law.Condition(**constants)
    under = track_of(s)
    np.testing.assert_array_equal(under.values[0, 0], tuple(s.rail.section[0].condition))
    named = dataclasses.replace(s, rail=scenario.Rail((scenario.Section(0.0, "low"),)))
    path.write_text(MINIMAL.replace('"dry"', table.replace("0.3}", "0.2}")))
    np.testing.assert_array_equal(track_of(simulate.load(path)).values, track_of(named).values)


def test_minimal_scenario(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(MINIMAL + "[vehicle]\nwheel_radius = 0.46\nfriction = 0.35\n")
    s = simulate.load(path)
    assert s.name == "mine"
    assert s.vehicle.radius(1).value == 0.46
    assert simulate.run(s).train_speed[-1] == 20.0


@pytest.mark.parametrize(
    ("text", "says", "hints"),
    [
        ("[brake]\nfil_time = 1.0\n", "'fil_time'", "'fill_time'"),
        ("[wps]\n", "'wps'", "'wsp'"),
        ("[train]\nspeed = -3.0\n", "speed = -3", "0 to 150 m/s"),
        ("[train]\nspeed = nan\n", "speed = nan", "plain number"),
        ("[train]\naxles = 2.5\n", "axles = 2.5", "bundled"),
        ("[train]\naxles = 2\npositions = [0.0]\n", "positions", "2 values"),
        ("[vehicle]\nfriction = 'high'\n", "friction = 'high'", "bundled"),
        ("[vehicle]\nfrictoin = 0.3\n", "'frictoin'", "'friction'"),
        ("[[brake.command]]\nat = 1.0\n", "command at 1 s", "pressure"),
        ("[[brake.command]]\npressure = 1e5\n", "at is missing", "add at"),
        ("[[sensor]]\nsignal = 'pressure'\nunit = 'km/h'\n", "'km/h' does not fit", "bar"),
        ("[[sensor]]\nsignal = 'presure'\n", "'presure'", "'pressure'"),
        ("[[sensor]]\nsignal = 'wheel_speed'\nunit = 'count'\n", "teeth", "teeth = "),
        ("[[sensor]]\nsignal = 'slip'\njitter = 0.1\n", "jitter", "half"),
        ("[[sensor]]\nsignal = 'slip'\naxles = [3]\n", "no such axle", "1 to 1"),
        ("[[rail.section]]\nat = 9.0\ncondition = 'icy'\n", "'icy'", "dry"),
        ("[[rail.section]]\nat = 9.0\ncondition = {f0 = 0.1}\n", "k_a is missing", "k_a = "),
        ("[[rail.section]]\nat = 9.0\ncondition = {f1 = 0.1}\n", "'f1'", "f0"),
        ("[[rail.section]]\nat = 9.0\ncondition = 3\n", "is not a text", "bundled"),
        ("[[rail.section]]\nat = 0.05\ncondition = 'wet'\n", "closer than blend", "blend"),
        ("dt = \n", "line 6", "TOML"),
    ],
)  # fmt: skip
def test_a_bad_scenario_is_refused_with_a_remedy(
    tmp_path: Path, text: str, says: str, hints: str
) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(MINIMAL + text)
    with pytest.raises(UserError) as e:
        simulate.load(path)
    assert says in e.value.text
    assert hints in e.value.hint
    assert e.value.code == 2


def test_an_unknown_scenario_names_the_nearest() -> None:
    with pytest.raises(UserError, match="servce-brake") as e:
        simulate.load("servce-brake")
    assert "'service-brake'" in e.value.hint
    with pytest.raises(UserError, match=r"nowhere\.toml"):
        simulate.load("nowhere.toml")


# --- sample logs --------------------------------------------------------------------------------


def test_sample_logs_are_what_their_script_makes(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, SAMPLES / "make.py", tmp_path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    kept = {p.name: p.read_bytes() for p in SAMPLES.iterdir() if p.suffix in (".csv", ".mcap")}
    assert made == kept
    assert sum(map(len, kept.values())) < 1_500_000


def test_sample_logs_hold_what_their_readme_says() -> None:
    readme = (SAMPLES / "README.md").read_text("utf-8")
    for path in SAMPLES.iterdir():
        assert path.suffix not in (".csv", ".mcap") or path.name in readme
    header = (SAMPLES / "service-brake.csv").read_text("utf-8").splitlines()[0]
    assert header == "time [s],bc_pressure [bar],wheel_speed [km/h],adhesion_force_true [N]"


def test_sample_csv_and_mcap_hold_the_same() -> None:
    spec = importlib.util.spec_from_file_location("make", SAMPLES / "make.py")
    assert spec is not None
    assert spec.loader is not None
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    import json

    from mcap.reader import make_reader

    with (SAMPLES / "low-adhesion.mcap").open("rb") as file:
        messages = [
            (c.topic, m.log_time, json.loads(m.data))
            for _, c, m in make_reader(file).iter_messages()
        ]
    lines = (SAMPLES / "low-adhesion.csv").read_text("utf-8").splitlines()
    cells = sum(cell != "" for line in lines[1:] for cell in line.split(",")[1:])
    assert len(messages) == cells
    speeds = [d["value"] for topic, _, d in messages if topic == "/axle/2/wheel_speed"]
    column = lines[0].split(",").index("wheel_speed_2 [km/h]")
    assert speeds == [float(c) for line in lines[1:] if (c := line.split(",")[column])]
    assert {d["unit"] for topic, _, d in messages if "force" in topic} == {"N"}
    assert min(t for _, t, _ in messages) == make.START_NS
