"""Closed loop: a train stops while a controller works the dump valves of each brake cylinder.

The simulated train is `plant`'s. At each of its ticks the WSP controller gets train speed, wheel
speeds and cylinder pressures, delayed and noisy. It sets the valves, which respond after their dead
time. The verdict uses the terms of EN 15595, without its limits: no copy of it was at hand.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..core import compiled, physics
from ..core.errors import UserError
from ..core.estimator import check_step
from ..core.model import Floats, Vehicle
from ..core.physics import JUDGED_FROM, LOCKED, ROLLS, WORKING, clamping
from ..rail import slope
from ..rail.slope import region
from . import plant as plants
from .controller import registry
from .plant import (
    STANDSTILL,
    Demand,
    MovingTrain,
    Plant,
    RailConditions,
    WheelStates,
    adhesion,
    advance_to,
    rail_under,
)
from .scenario import Antiskid, Rail, Scenario, Section
from .stop import Stop, Verdict
from .wsp_controller import Constants, Settings, bands, choose, initial_wheels, slip_of, start, tick

DRY = Rail((Section(0.0, "dry"),))
ESTIMATOR = "kalman"  # in the loop where none is chosen
LONGEST = 600.0  # of a stop [s]
LOGGED = "logged"  # the stop in which the cylinders have the pressures of a log
_CREEP, _STEPS = 1e-6, 16  # least slip of the search for the peak, and slips up to 1, geometric
_HALVINGS = 27  # of the step between them


# --- the loop: plain Python that compiles ---------------------------------------------------------


class Logged(NamedTuple):
    """What a log shows of its axles from the start of a stop on, shape (n, axles)."""

    interval: float  # between rows; the last one stays [s]
    friction: float  # φ of the forces
    pressure: Floats  # of the cylinders [Pa]
    slip: Floats
    force: Floats  # adhesion force of a wheel that does not slide, else NaN [N]


class _World(NamedTuple):
    plant: Plant
    track: RailConditions
    demand: Demand
    wheels: WheelStates
    dt: float  # of the plant [s]
    stride: int  # steps of the plant between ticks
    delay: int  # steps: age of measured values
    dead: int  # steps: dead time of the valves
    measured: bool  # the train speed; else it is estimated from the axles
    v_noise: Floats  # of the train speed [m/s], shape (ticks,)
    w_noise: Floats  # of the wheel speed [rad/s], shape (ticks, axles)
    p_noise: Floats  # of the pressure [Pa]
    v_past: Floats  # [m/s], not yet measured: step k in row k modulo the rows
    w_past: Floats  # [rad/s], shape (rows, axles)
    p_past: Floats  # [Pa]
    trace: Stop  # to be filled, with a row for each tick that there may be


def _drive(world: _World, train: MovingTrain, j: int) -> MovingTrain:
    """The train at tick j, from the tick before; fills row j except the controller's part."""
    trace, wheels, stride = world.trace, world.wheels, world.stride
    if j == 0:
        _remember(world, train, 0)
    for k in range(max(j - 1, 0) * stride, j * stride):
        if k >= world.dead:
            for i in range(len(wheels.w)):
                wheels.valve[i] = trace.valve[(k - world.dead) // stride, i]
        step_end = (k + 1) * world.dt
        train = advance_to(world.plant, world.track, world.demand, train, wheels, step_end)
        if not train.v > 0.0:
            return train
        _remember(world, train, k + 1)
    trace.train_speed[j], trace.distance[j] = train.v, train.x
    trace.demand[j] = train.demand_pressure
    for i in range(len(wheels.w)):
        trace.rim_speed[j, i], trace.pressure[j, i] = wheels.w[i], wheels.p[i]
    _measure(world, j)
    return train


def _remember(world: _World, train: MovingTrain, k: int) -> None:
    """Stores the state at step k, to be measured later."""
    wheels, row = world.wheels, k % len(world.v_past)
    world.v_past[row] = train.v
    for i in range(len(wheels.w)):
        world.w_past[row, i] = wheels.w[i] / world.plant.radius[i]
        world.p_past[row, i] = wheels.p[i]


def _measure(world: _World, j: int) -> None:
    """Fills row j of the measured v, ω and p; a sensor at rest gives no pulses."""
    trace, row = world.trace, max(j * world.stride - world.delay, 0) % len(world.v_past)
    y, K, v = trace.measured_wheel_speed[j], trace.measured_clamping_force[j], world.v_past[row]
    for i in range(len(y)):
        w = world.w_past[row, i]
        y[i] = max(w + world.w_noise[j, i], 0.0) if w > 0.0 else 0.0
        trace.measured_pressure[j, i] = world.p_past[row, i] + world.p_noise[j, i]
        K[i] = clamping(world.plant.brake, trace.measured_pressure[j, i])
    if not world.measured:
        v = math.nan
    elif v > 0.0:
        v = max(v + world.v_noise[j], 0.0)
    trace.measured_train_speed[j] = v


def _march(world: _World, train: MovingTrain, c: Constants, bands: slope.Bands) -> int:
    """Ticks until the train stands or the trace is full; −j where Newton's method failed at j."""
    trace, h = world.trace, world.stride * world.dt
    y, K = trace.measured_wheel_speed, trace.measured_clamping_force
    for j in range(len(trace.demand)):
        train = _drive(world, train, j)
        if not train.v > 0.0:
            return -j if math.isnan(train.v) else j
        if j == 0:
            wheels = initial_wheels(c, y.shape[1])
            train_state, axles = start(c, wheels, trace.measured_train_speed[0], y[0], K[0])
        else:
            v = trace.measured_train_speed[j]
            train_state, axles = tick(c, train_state, axles, h, v, y[j], K[j])
        trace.measured_train_speed[j], trace.train_speed_doubt[j] = train_state.v, train_state.doubt
        for i in range(len(axles)):
            k, judged = axles[i].slope, axles[i].controller.judged
            trace.measured_slip[j, i] = slip_of(axles[i].wheel.radius, train_state.v, y[j, i])
            trace.judged_slip[j, i], trace.estimate[j, i] = judged, axles[i].estimator.F
            trace.slope[j, i], trace.confidence[j, i] = k.slope, k.confidence
            trace.region[j, i] = region(judged, k.slope, bands)
            trace.valve[j, i] = axles[i].controller.valve
    return len(trace.demand)


def _peaks(
    plant: Plant, track: RailConditions, t: Floats, v: Floats, x: Floats, rim: Floats
) -> None:
    """Fills the rim speed of the greatest adhesion force at each sample; shapes as in `forces`.

    The slope of the force changes its sign there. A fitted rail may have several such places: the
    largest force of `_STEPS` slips says near which one.
    """
    rail = np.zeros(5)
    for i in range(rim.shape[1]):
        knot = 0
        for j in range(len(v)):
            knot = rail_under(plant, track, i, t[j], x[j], knot, rail)
            lowest, highest = math.log(_CREEP * v[j]), math.log(v[j])
            step, largest, peak = (highest - lowest) / _STEPS, -1.0, lowest
            for k in range(_STEPS + 1):
                F = adhesion(math.exp(lowest + k * step), v[j], rail, plant.patch)[0]
                if largest < F:
                    largest, peak = F, lowest + k * step
            lowest, highest = max(lowest, peak - step), min(highest, peak + step)
            for _ in range(_HALVINGS):
                middle = 0.5 * (lowest + highest)
                if adhesion(math.exp(middle), v[j], rail, plant.patch)[1] > 0.0:
                    lowest = middle
                else:
                    highest = middle
            rim[j, i] = v[j] - math.exp(lowest)


# --- stops ----------------------------------------------------------------------------------------


def run(
    scenario: Scenario,
    controller: str,
    seed: int | None = None,
    algo: str = ESTIMATOR,
    settings: Settings | None = None,
    track: RailConditions | None = None,
) -> Stop:
    """One stop.

    The scenario's sensors and its simple WSP belong to its log and are not used. `seed` and `track`
    stand in place of its own; `settings` are those of `wsp_controller.choose`.

    Raises:
        UserError: no such controller or estimator, a parameter unknown, out of range or unstable,
            a scenario that does not end in a stop.
    """
    name = scenario.name
    if scenario.rig or not scenario.brake.command or not scenario.train.speed:
        raise UserError(f"{name}: no train that brakes", "take a scenario of a stop")
    antiskid, dt, settings = scenario.antiskid, scenario.dt, settings or {}
    if dt > antiskid.period:
        text = f"{name}: dt is longer than the WSP controller's period"
        hint = f"state dt = {antiskid.period:g} or less at the top of the scenario"
        raise UserError(text, hint, code=2)
    h = round(antiskid.period / dt) * dt
    chosen = choose(controller, algo, settings, taken_for(scenario), speed_noise(scenario))
    check_step(chosen.estimator, chosen.constants.estimator, h)
    seed = scenario.seed if seed is None else seed
    world, train = _world(scenario, track or plants.track_of(scenario), seed)
    march = compiled.function(_march, chosen.stand_ins())
    stop_index = march(world, train, chosen.constants, bands(settings))
    _check_stopped(name, stop_index, len(world.trace.demand), h)
    rows = (x[:stop_index].copy() if isinstance(x, np.ndarray) else x for x in world.trace)
    air = _litres(float(world.wheels.air.sum()), antiskid)
    stop = _on_rail(Stop._make(rows), world.plant, world.track)
    stop = stop._replace(controller=controller, algo=algo, seed=seed, air=air)
    if not _stopping_distance(stop, scenario) > 0.0:
        raise UserError(f"{name}: the train stands at once", "a faster train")
    return stop


def follow(scenario: Scenario, track: RailConditions, logged: Logged) -> Stop:
    """The stop in which every wheel slides as in a log.

    A wheel that slides has the log's slip, and so the force of the rail at that slip. With the
    logged pressures alone it would lock or roll: a wheel past the peak is not stable. The pads'
    friction scales the forces of wheels that do not slide. What the log shows begins with the
    scenario.

    Raises:
        UserError: the train does not stop.
    """
    h, axles, ticks = logged.interval, scenario.train.axles, round(LONGEST / logged.interval)
    plant, demand = plants.plant_of(scenario), plants.demand_of(scenario)
    forces = logged.force * (scenario.vehicle.friction.value / logged.friction)
    columns = [np.empty(ticks), np.empty(ticks), np.empty((ticks, axles)), np.empty((ticks, axles))]
    march = compiled.function(_follow)
    n = march(plant, track, scenario.train.speed, logged.slip, forces, h, *columns)
    _check_stopped(scenario.name, n, ticks, h)
    v, x, rim, force = (column[:n] for column in columns)
    pressure = logged.pressure[np.minimum(np.arange(n), len(logged.pressure) - 1)]
    rises = np.maximum(np.diff(pressure, axis=0), 0.0)
    empty = _empty(n, axles, h)
    stop = _on_rail(empty._replace(train_speed=v, distance=x, rim_speed=rim), plant, track)
    demanded = np.interp(np.arange(n) * h, demand.t[:-1], demand.p[:-1])
    stop = stop._replace(controller=LOGGED, demand=demanded, pressure=pressure, force=force)
    return stop._replace(air=_litres(float(np.sum(rises)), scenario.antiskid))


def _empty(ticks: int, axles: int, h: float) -> Stop:
    of_train = "train_speed", "distance", "demand", "measured_train_speed", "train_speed_doubt"
    shapes = {name: ticks if name in of_train else (ticks, axles) for name in Stop._fields[4:-1]}
    columns: Any = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    columns |= {name: np.zeros((ticks, axles), np.int8) for name in ("valve", "region")}
    t = np.round(np.arange(ticks) * h * 1e9).astype(np.int64)
    return Stop("", "", 0, t, **columns, air=0.0)


def _follow(  # noqa: PLR0913 (compiled)
    plant: Plant,
    track: RailConditions,
    speed: float,
    slip: Floats,
    rolling: Floats,
    h: float,
    v: Floats,
    x: Floats,
    rim: Floats,
    force: Floats,
) -> int:
    """Fills speed, distance, rim speeds and forces until the train stands; returns the ticks."""
    rail, knots, place = np.zeros(5), np.zeros(rim.shape[1], np.int64), 0.0
    for j in range(len(v)):
        row, total = min(j, len(slip) - 1), 0.0
        v[j], x[j] = speed, place
        for i in range(rim.shape[1]):
            knots[i] = rail_under(plant, track, i, j * h, place, knots[i], rail)
            rim[j, i] = speed * (1.0 - slip[row, i])
            force[j, i] = rolling[row, i]
            if math.isnan(force[j, i]):
                force[j, i] = adhesion(speed - rim[j, i], speed, rail, plant.patch)[0]
            total += force[j, i]
        slowing = total / plant.mass + track.resistance + track.drag * speed * speed
        place += h * (speed - 0.5 * h * slowing)
        speed -= h * slowing
        if not speed > STANDSTILL:
            return j + 1
    return len(v)


def _on_rail(stop: Stop, plant: Plant, track: RailConditions) -> Stop:
    """The stop with forces, slips, and those of the peak of the rail."""
    v, rim = stop.train_speed, stop.rim_speed
    force, peak, best = np.empty((3, *rim.shape))
    course = plant, track, stop.t * np.float64(1e-9), v, stop.distance
    compiled.function(_peaks)(*course, best)
    for rims, column in ((rim, force), (best, peak)):
        compiled.function(plants.forces)(*course, rims, column)
    slip = physics.slip(v[:, None], rim, 1.0, JUDGED_FROM)
    return stop._replace(force=force, peak=peak, peak_slip=1.0 - best / v[:, None], slip=slip)


def _litres(rise: float, antiskid: Antiskid) -> float:
    """Normal litres of a rise of pressure in a cylinder [Pa]."""
    return rise * antiskid.volume / physics.NORMAL_PRESSURE * 1e3


def _check_stopped(name: str, stop_index: int, ticks: int, h: float) -> None:
    """Refuses a train that does not stand after `stop_index` ticks."""
    if stop_index < 0:
        raise UserError(f"{name}: no solution at {-stop_index * h:g} s", "take a shorter dt")
    if stop_index == ticks:
        text = f"{name}: the train does not stop within {LONGEST:g} s"
        raise UserError(text, "a stronger brake that stays applied, or a better rail")


def _world(s: Scenario, track: RailConditions, seed: int) -> tuple[_World, MovingTrain]:
    """Train, rail and sensors of a scenario at the start, with an empty trace."""
    antiskid, axles, dt = s.antiskid, s.train.axles, s.dt
    times = antiskid.period, antiskid.delay, antiskid.dead_time
    stride, delay, dead = (round(x / dt) for x in times)
    plant = plants.plant_of(s)
    fill_rate = min(plant.fill_rate, antiskid.fill_rate)
    plant = plant._replace(valve_time=antiskid.vent_time, fill_rate=fill_rate)
    ticks = round(LONGEST / (stride * dt))
    shape = (ticks, axles)
    random = np.random.Generator(np.random.PCG64(seed))
    noise = (
        math.sqrt(antiskid.train_noise) * random.standard_normal(ticks),
        math.sqrt(antiskid.wheel_noise) * random.standard_normal(shape),
        math.sqrt(antiskid.pressure_noise) * random.standard_normal(shape),
    )
    trace = _empty(ticks, axles, stride * dt)
    train, wheels = plants.rolling(s.train.speed, axles)
    history = np.empty(delay + 1), np.empty((delay + 1, axles)), np.empty((delay + 1, axles))
    steps, measured = (dt, stride, delay, dead), antiskid.train_speed == "measured"
    demand = plants.demand_of(s)
    return _World(plant, track, demand, wheels, *steps, measured, *noise, *history, trace), train


def taken_for(s: Scenario) -> Vehicle:
    """The vehicle as the WSP controller of a scenario assumes it."""
    antiskid, v, axles = s.antiskid, s.vehicle, range(1, s.train.axles + 1)
    factors = antiskid.radius * (s.train.axles // len(antiskid.radius))
    friction = v.friction._replace(value=antiskid.friction * v.friction.value)
    wheels = zip(map(v.radius, axles), factors, strict=True)
    radii = tuple(R._replace(value=factor * R.value) for R, factor in wheels)
    mass = v.axle_mass._replace(value=antiskid.mass * v.axle_mass.value)
    return replace(v, friction=friction, wheel_radius=radii, axle_mass=mass)


def speed_noise(s: Scenario) -> float:
    """1 sigma of v − ωR as the WSP controller of a scenario measures it [m/s]."""
    rim = s.vehicle.radius(1).value ** 2 * s.antiskid.wheel_noise
    train = s.antiskid.train_noise if s.antiskid.train_speed == "measured" else rim
    return math.sqrt(train + rim)


def dry_distance(scenario: Scenario, track: RailConditions | None = None) -> float:
    """Stopping distance of the same train and brake on dry rail, without controller [m].

    The resistance of `track` acts, too.
    """
    dry = replace(scenario, rail=DRY, train=replace(scenario.train, cleaning=()))
    rail = plants.track_of(dry)
    if track:
        rail = rail._replace(resistance=track.resistance, drag=track.drag)
    return _stopping_distance(run(dry, "none", track=rail), dry)


def compare_laws(
    scenario: Scenario,
    seed: int | None,
    algo: str,
    settings: Settings,
    progress: Callable[[str], None],
    track: RailConditions | None = None,
) -> tuple[float, dict[str, tuple[Stop, Verdict]]]:
    """Dry distance [m], and the stop under every controller by name; arguments as in `run`.

    `progress` gets the progress.
    """
    progress("dry rail")
    dry, stops = dry_distance(scenario, track), {}
    for law in registry():
        progress(law)
        stop = run(scenario, law, seed, algo, settings, track)
        stops[law] = stop, verdict(stop, scenario, dry)
    return dry, stops


def verdict(stop: Stop, scenario: Scenario, dry: float) -> Verdict:
    """The measures of a stop; `dry` is the stopping distance on dry rail [m]."""
    h = float(stop.t[1] - stop.t[0]) * 1e-9
    wheel = physics.wheelset(scenario.vehicle, 1)
    demanded = wheel.rolling * wheel.phi * physics.clamping_force(stop.demand, scenario.vehicle)
    counted = stop.train_speed >= JUDGED_FROM
    limited = counted[:, None] & (demanded[:, None] > stop.peak)
    fast = stop.slip[stop.train_speed > WORKING]
    distance, is_limited = _stopping_distance(stop, scenario), bool(limited.any())
    error, sliding = np.abs(stop.slip - stop.peak_slip)[limited], stop.sliding()
    used, available = float(stop.force[limited].sum()), float(stop.peak[limited].sum())
    return Verdict(
        stopping_distance_m=distance,
        extension=distance / dry - 1.0,
        utilisation=used / available if is_limited else None,
        max_slip=float(fast.max()) if fast.size else None,
        locked_s=float((sliding == LOCKED).sum()) * h,
        air_nl=stop.air,
        mean_slip_error=float(error.mean()) if is_limited else None,
        slide_s=float((sliding != ROLLS).sum()) * h,
        limited_s=float(limited.sum()) * h,
    )


def _stopping_distance(stop: Stop, scenario: Scenario) -> float:
    demanded = scenario.brake.command[0].at
    return float(stop.distance[-1] - np.interp(demanded, stop.t * 1e-9, stop.distance))
