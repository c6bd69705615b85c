"""Brakes a train in the computer: scenario → true signals → what a logger would have written.

One car body of mass M = Σ m shared by every wheelset, each with its own brake cylinder; (1) per
wheelset with Polach's adhesion force (3):

    M v̇ = −Σ F_i,    ω̇_i = a (F_i − φK_i) while the wheel turns.

A wheel that stands is held by its brake up to φK; a train that stands stays (level track, F = 0).
The equations are stiff: near adhesion the slip settles within 1/(a R ∂F/∂Δv), 2 ms at 20 m/s and
20 µs at walking pace. They are integrated by the two-stage, L-stable, stiffly accurate SDIRK
method of order 2 (R. Alexander, SIAM J. Numer. Anal. 14 (1977) 1006-1021, γ = 1 − 1/√2), whose
last stage is the new state: F in the output satisfies (3) at the sample it stands beside. Steps
end at every jump or kink of the brake demand, of a rail that changes with time, and of the valves.
"""

import math
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from hashlib import sha256
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import physics
from .errors import UserError
from .model import Channel, Column, Floats, Log, Times, Vehicle
from .rail import SLOWEST, Condition, Patch, condition, creep_force
from .read.units import UNITS
from .scenario import INF, Rail, Scenario, Sensor, Signal, Wave, Wsp, load, scenarios

__all__ = ["Recording", "Scenario", "Simulation", "as_log", "load", "log", "run", "scenarios"]

GAMMA = 1.0 - math.sqrt(0.5)  # of the method: L-stable, order 2
STANDSTILL = 1e-3  # a braked train slower than this stands [m/s]
APPLY, HOLD, VENT = 0, 1, 2  # valves of the wheel slide protection
SOON = 1e-10  # events closer than this count as one [s]
CONVERGED = 1e-11  # last Newton correction [m/s]
PATIENCE = 60  # Newton iterations
MOST = 20_000_000  # samples of one run, axles times steps: about 2 GB; an hour at 1 kHz has 3.6e6

_NAMES: dict[Signal, str] = {
    "pressure": "bc_pressure",
    "clamping_force": "clamping_force",
    "wheel_speed": "wheel_speed",
    "train_speed": "train_speed",
    "truth": "adhesion_force_true",
    "slip": "slip_true",
}


class _Plant(NamedTuple):
    """What the loop needs of train, brakes and valves; arrays of shape (axles,)."""

    radius: Floats
    inertia: float
    mass: float  # of the train
    phi: float
    per_pascal: float  # (15) as a line: K = per_pascal · p − at_zero, never negative
    at_zero: float
    patch: Patch
    positions: Floats
    cleaning: Floats
    fill_time: float
    vent_time: float
    fill_rate: float
    vent_rate: float
    valve_period: float  # inf: no wheel slide protection
    valve_time: float
    hold_slip: float
    vent_slip: float
    valve_slowest: float


class _Track(NamedTuple):
    """Rail condition as straight lines between knots."""

    timed: bool  # knots are times, not places
    knots: Floats  # shape (k,), the last one at infinity
    values: Floats  # shape (k, 5), the fields of `Condition`
    amplitude: float
    period: float


def _plant(s: Scenario) -> _Plant:
    n, m = s.train.axles, s.vehicle.axle_mass.value
    wsp = s.wsp or Wsp()
    per_pascal, at_zero = _line(s.vehicle)
    return _Plant(
        radius=_radii(s),
        inertia=s.vehicle.wheelset_inertia.value,
        mass=n * m,
        phi=s.vehicle.friction.value,
        per_pascal=per_pascal,
        at_zero=at_zero,
        patch=s.contact.patch(m * physics.G),
        positions=np.array(s.train.positions or [0.0] * n),
        cleaning=np.array(s.train.cleaning or [1.0] * n),
        fill_time=s.brake.fill_time,
        vent_time=s.brake.vent_time,
        fill_rate=s.brake.fill_rate,
        vent_rate=s.brake.vent_rate,
        valve_period=wsp.period if s.wsp else INF,
        valve_time=wsp.vent_time,
        hold_slip=wsp.hold_slip,
        vent_slip=wsp.vent_slip,
        valve_slowest=wsp.slowest,
    )


def _radii(s: Scenario) -> Floats:
    return np.array([s.vehicle.radius(axle).value for axle in range(1, s.train.axles + 1)])


def _line(vehicle: Vehicle) -> tuple[float, float]:
    """Slope and offset of (15), read off where no spring keeps the pads away."""
    high = 1e9
    K = physics.clamping_force(np.array([high, 2.0 * high]), vehicle)
    per_pascal = float(K[1] - K[0]) / high
    return per_pascal, per_pascal * high - float(K[0])


def _demand(s: Scenario) -> tuple[Floats, Floats]:
    """Knots of the pressure demanded at the cylinder: times [s] and pressures [Pa]."""
    per_pascal, at_zero = _line(s.vehicle)
    t, p = [-1.0], [0.0]
    for c in s.brake.command:
        goal = c.pressure or 0.0
        if c.clamping_force:
            goal = (c.clamping_force + at_zero) / per_pascal
        start = c.at + s.brake.dead_time
        t += [start, start + c.ramp]
        p += [p[-1], goal]
    return np.array([*t, INF]), np.array([*p, p[-1]])


def _track(rail: Rail) -> _Track:
    knots: list[float] = []
    values: list[Condition] = []
    for place, name, scale in rail.changes():
        if knots:
            knots.append(place)
            values.append(values[-1])
        knots.append(place + rail.blend if knots else place)
        values.append(condition(name)._replace(f0=condition(name).f0 * scale))
    wave = rail.wave or Wave(0.0, 1.0)
    return _Track(
        rail.along == "time",
        np.array([*knots, INF]),
        np.array([*values, values[-1]]),
        wave.amplitude,
        wave.period,
    )


# --- integration: plain Python that compiles ----------------------------------------------------


def _rail_at(track: _Track, z: float, j: int, cleaning: float, rail: Floats) -> int:
    """Puts the condition at place or time `z` into `rail`; returns the knot before it.

    `j` is a knot no later.
    """
    while track.knots[j + 1] <= z:
        j += 1
    part = max(0.0, (z - track.knots[j]) / (track.knots[j + 1] - track.knots[j]))
    for i in range(5):
        rail[i] = track.values[j, i] + part * (track.values[j + 1, i] - track.values[j, i])
    wave = track.amplitude * math.sin(2.0 * math.pi * z / track.period)
    rail[2] *= cleaning * (1.0 + wave)  # f0
    return j


def _adhesion(sliding: float, speed: float, rail: Floats, patch: Patch) -> tuple[float, float]:
    law = Condition(rail[0], rail[1], rail[2], rail[3], rail[4])
    return creep_force(sliding, speed, law, patch)


def _cylinder(plant: _Plant, valve: int, p: float, c0: float, c1: float, h: float) -> float:
    """Cylinder pressure `h` later, the demand going straight from c0 to c1."""
    if valve == HOLD:
        return p
    if valve == VENT:
        return p * math.exp(-h / plant.valve_time)
    lag = plant.fill_time if c1 > p else plant.vent_time
    if lag == 0.0:
        p1 = c1
    elif h == 0.0:
        p1 = p
    else:
        behind = (c1 - c0) / h * lag  # how far a lag trails a ramp
        p1 = c1 - behind + (p - c0 + behind) * math.exp(-h / lag)
    if p1 > p:
        return min(p1, p + plant.fill_rate * h) if plant.fill_rate < math.inf else p1
    return max(p1, p - plant.vent_rate * h) if plant.vent_rate < math.inf else p1


def _decide(plant: _Plant, v: float, w: Floats, before: Floats, valve: NDArray[np.int64]) -> None:
    """Sets each axle's valve from its true slip; `before` is the rim speed at the last decision."""
    for i in range(len(w)):
        sliding = v - w[i] if v > plant.valve_slowest else 0.0
        if sliding > plant.vent_slip * v and w[i] <= before[i]:
            valve[i] = VENT
        elif sliding > plant.hold_slip * v:
            valve[i] = HOLD
        else:
            valve[i] = APPLY
        before[i] = w[i]


def _stage(
    plant: _Plant, rails: Floats, friction: Floats, h: float,
    v_from: float, w_from: Floats, v: float, w: Floats, work: Floats,
) -> float:  # fmt: skip
    """Implicit stage: v = v_from − h ΣF/M, w = w_from + h R² (F − B)/I (rim speeds), none below 0.

    Newton's method; the Jacobian is an arrow. F falls so steeply about zero sliding that an iterate
    never crosses it but starts again from there, where F is steepest and it cannot overshoot.
    `v` and `w` are the first guess; `w` becomes the answer.

    Returns:
        v, or NaN where the iteration did not converge.
    """
    e = h / plant.mass
    for _ in range(PATIENCE):
        residual, slope = v - v_from, 1.0
        for i in range(len(w)):
            F, D = _adhesion(v - w[i], v, rails[i], plant.patch)
            c = h * plant.radius[i] ** 2 / plant.inertia
            g = w[i] - w_from[i] - c * (F - friction[i])
            if w[i] <= 0.0 and g >= 0.0:  # the brake holds it
                g, c = 0.0, 0.0
            work[i, 0], work[i, 1], work[i, 2] = g, c, D
            residual += e * (F + D * g / (1.0 + c * D))
            slope += e * D / (1.0 + c * D)
        dv = max(-residual / slope, -v)
        largest = abs(dv)
        for i in range(len(w)):
            g, c, D = work[i, 0], work[i, 1], work[i, 2]
            rim = w[i] + (c * D * dv - g) / (1.0 + c * D)
            if (v - w[i]) * (v + dv - rim) < 0.0:
                rim = v + dv
            rim = max(rim, 0.0)
            largest = max(largest, abs(rim - w[i]))
            w[i] = rim
        v += dv
        if largest < CONVERGED:
            return v
    return math.nan


class _Scratch(NamedTuple):
    """Room of `_advance`, so that no step allocates; `rails` is where its last stage ended."""

    rails: Floats  # shape (axles, 5)
    friction: Floats
    w_new: Floats
    w_from: Floats
    newton: Floats  # shape (axles, 3)


def _scratch(axles: int) -> _Scratch:
    return _Scratch(
        np.zeros((axles, 5)), np.zeros(axles), np.zeros(axles), np.zeros(axles),
        np.zeros((axles, 3)),
    )  # fmt: skip


def _advance(
    plant: _Plant, track: _Track, valve: NDArray[np.int64], knot: NDArray[np.int64],
    demand: float, rise: float, t: float, h: float,
    v: float, x: float, w: Floats, p: Floats, room: _Scratch,
) -> float:  # fmt: skip
    """One step from `t` to `t + h`, within which nothing jumps; w, p and knot are updated.

    `demand` is the pressure demanded at `t` [Pa] and `rise` its slope [Pa/s].

    Returns:
        v at the end, or NaN where Newton's iteration did not converge.
    """
    axles = len(w)
    w_new, w_from = room.w_new, room.w_from
    v_new, v_from, braked = v, v, False
    for i in range(axles):
        w_new[i] = w_from[i] = w[i]
    for part in (GAMMA, 1.0):
        for i in range(axles):
            p1 = _cylinder(plant, valve[i], p[i], demand, demand + rise * part * h, part * h)
            K = max(plant.per_pascal * p1 - plant.at_zero, 0.0)  # (15)
            room.friction[i] = plant.phi * K
            braked = braked or K > 0.0
            if part == 1.0:
                p[i] = p1
            z = t + part * h if track.timed else x + part * h * v_new - plant.positions[i]
            knot[i] = _rail_at(track, z, knot[i], plant.cleaning[i], room.rails[i])
        if v > 0.0:
            v_new = _stage(
                plant, room.rails, room.friction, GAMMA * h, v_from, w_from, v_new, w_new,
                room.newton,
            )  # fmt: skip
        if math.isnan(v_new):
            return v_new
        if part < 1.0:  # the second stage starts from h (1 − γ) f of the first
            v_from = v + (1.0 - GAMMA) / GAMMA * (v_new - v)
            for i in range(axles):
                w_from[i] = w[i] + (1.0 - GAMMA) / GAMMA * (w_new[i] - w[i])
    stands = braked and v_new < STANDSTILL
    for i in range(axles):
        w[i] = 0.0 if stands else w_new[i]
    return 0.0 if stands else v_new


def _integrate(
    plant: _Plant, track: _Track, demand_t: Floats, demand_p: Floats, v: float, dt: float,
    pressure: Floats, wheel_speed: Floats, force: Floats, speed: Floats, distance: Floats,
) -> float:  # fmt: skip
    """Fills the columns, shape (n, axles) and (n,); returns NaN, or the time [s] Newton failed."""
    n, axles = pressure.shape
    p, before, w, room = np.zeros(axles), np.zeros(axles), np.zeros(axles), _scratch(axles)
    valve, knot = np.zeros(axles, np.int64), np.zeros(axles, np.int64)
    for i in range(axles):
        w[i] = before[i] = v
    x, segment, timed_knot, decisions = 0.0, 0, 0, 0
    for k in range(n):
        t, end, recorded = k * dt, (k + 1) * dt, False
        while t < end - SOON:
            while demand_t[segment + 1] <= t + SOON:
                segment += 1
            while track.timed and track.knots[timed_knot + 1] <= t + SOON:
                timed_knot += 1
            if decisions * plant.valve_period <= t + SOON:
                decisions += 1
                _decide(plant, v, w, before, valve)
            stop = min(end, demand_t[segment + 1])
            if decisions > 0:
                stop = min(stop, decisions * plant.valve_period)
            if track.timed:
                stop = min(stop, track.knots[timed_knot + 1])
            span = demand_t[segment + 1] - demand_t[segment]
            rise = (demand_p[segment + 1] - demand_p[segment]) / span
            c0 = demand_p[segment] + rise * (t - demand_t[segment])
            for i in range(axles):
                p[i] = _cylinder(plant, valve[i], p[i], c0, c0, 0.0)
            if not recorded:
                recorded = True
                speed[k], distance[k] = v, x
                for i in range(axles):
                    z = t if track.timed else x - plant.positions[i]
                    knot[i] = _rail_at(track, z, knot[i], plant.cleaning[i], room.rails[i])
                    pressure[k, i], wheel_speed[k, i] = p[i], w[i] / plant.radius[i]
                    if v > 0.0:
                        force[k, i] = _adhesion(v - w[i], v, room.rails[i], plant.patch)[0]
            v_new = _advance(plant, track, valve, knot, c0, rise, t, stop - t, v, x, w, p, room)
            if math.isnan(v_new):
                return t
            x += 0.5 * (stop - t) * (v + v_new)
            v, t = v_new, stop
    return math.nan


# --- true signals -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Simulation:
    """What was true: columns on one dense time axis, SI; shape (n,) or (n, axles)."""

    scenario: Scenario
    seed: int
    t: Times
    pressure: Floats  # brake cylinders [Pa]
    clamping_force: Floats  # K [N]
    wheel_speed: Floats  # ω [rad/s]
    adhesion_force: Floats  # F [N]
    train_speed: Floats  # v [m/s]
    distance: Floats  # run by the first axle [m]

    @cached_property
    def friction_force(self) -> Floats:
        """B [N]: φK while the wheel turns, what holds it (F) while it stands; ω̇ = a(F − B)."""
        phi = self.scenario.vehicle.friction.value
        return np.where(self.wheel_speed > 0.0, phi * self.clamping_force, self.adhesion_force)

    @cached_property
    def slip(self) -> Floats:
        """Slip s [-], NaN below `rail.SLOWEST`. Source: (2)."""
        rim = self.wheel_speed * _radii(self.scenario)
        return physics.slip(self.train_speed[:, None], rim, 1.0, SLOWEST)

    def signal(self, signal: Signal, axle: int | None) -> Floats:
        """One axle's column of that name, axles numbered from 1; SI, shape (n,)."""
        if signal == "train_speed":
            return self.train_speed
        name = "adhesion_force" if signal == "truth" else signal
        column: Floats = getattr(self, name)[:, (axle or 1) - 1]
        return column


def run(scenario: Scenario, seed: int | None = None, dt: float | None = None) -> Simulation:
    """The true signals of a scenario.

    Args:
        scenario: from `load`.
        seed: of the sensor noise, in place of the scenario's.
        dt: step of integration and output [s], in place of the scenario's.

    Raises:
        UserError: where the step is too long for the scenario, or the run too large for memory.
    """
    from . import compiled

    dt = scenario.dt if dt is None else dt
    n = round(scenario.duration / dt) + 1
    shape = (n, scenario.train.axles)
    fastest = max((x.rate for x in scenario.sensor), default=0.0)
    most = max(n, scenario.duration * fastest) * scenario.train.axles
    if most > MOST:
        raise UserError(
            f"{scenario.name}: {most:.3g} samples, at most {MOST:.3g} fit into one run",
            "simulate less time, or with a longer dt and slower sensors",
        )
    pressure, wheel_speed, force = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    speed, distance = np.zeros(n), np.zeros(n)
    seconds = np.arange(n, dtype=np.float64) * np.float64(dt)
    if scenario.rig:
        K = _sweep(scenario, seconds, wheel_speed, force, speed, distance)
        per_pascal, at_zero = _line(scenario.vehicle)
        pressure[:] = np.where(K > 0.0, (K + at_zero) / per_pascal, 0.0)
    else:
        failed = compiled.function(_integrate)(
            _plant(scenario), _track(scenario.rail), *_demand(scenario), scenario.train.speed, dt,
            pressure, wheel_speed, force, speed, distance,
        )  # fmt: skip
        if not math.isnan(failed):
            raise UserError(f"{scenario.name}: no solution at {failed:g} s", "take a shorter dt")
        K = physics.clamping_force(pressure, scenario.vehicle)
    t = np.round(seconds * 1e9).astype(np.int64)
    seed = scenario.seed if seed is None else seed
    return Simulation(scenario, seed, t, pressure, K, wheel_speed, force, speed, distance)


def _sweep(
    s: Scenario, t: Floats, wheel_speed: Floats, force: Floats, speed: Floats, distance: Floats
) -> Floats:
    """Fills the columns of a roller rig; returns the K [N] that (1) asks for, shape (n, 1)."""
    assert s.rig is not None
    plant, track, v = _plant(s), _track(s.rail), s.train.speed
    sliding = s.rig.slip * v * t / t[-1]
    speed[:] = v
    distance[:] = v * t
    wheel_speed[:, 0] = (v - sliding) / plant.radius[0]
    knot, rail = 0, np.zeros(5)
    for k, z in enumerate(t if track.timed else distance):
        knot = _rail_at(track, z, knot, plant.cleaning[0], rail)
        force[k, 0] = _adhesion(sliding[k], v, rail, plant.patch)[0]
    slowing = s.rig.slip * v / t[-1] / plant.radius[0]  # −ω̇
    K: Floats = (force + slowing * plant.inertia / plant.radius[0]) / plant.phi  # (1)
    return K


# --- sensors ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Recording:
    """One channel as a logger would hold it: in its unit, with its own time stamps."""

    name: str
    signal: Signal
    axle: int | None  # None: the train's
    unit: str
    t: Times  # [ns], rising strictly, shape (n,)
    value: Floats  # shape (n,), NaN where the signal does not exist
    decimals: int | None  # that the rounding leaves; None: not rounded

    def texts(self) -> list[str]:
        """Values as a log would print them, "" where there is none."""
        form = ".9g" if self.decimals is None else f".{self.decimals}f"
        return ["" if math.isnan(x) else format(x, form) for x in self.value.tolist()]


def log(simulation: Simulation) -> list[Recording]:
    """What the scenario's sensors make of a simulation, the same for the same seed."""
    scenario = simulation.scenario
    recordings = []
    for number, sensor in enumerate(scenario.sensor):
        axles: tuple[int | None, ...] = sensor.axles or tuple(range(1, scenario.train.axles + 1))
        for axle in (None,) if sensor.signal == "train_speed" else axles:
            key = np.random.SeedSequence(simulation.seed, spawn_key=(number, axle or 0))
            random = np.random.Generator(np.random.PCG64(key))
            recordings.append(_recorded(simulation, sensor, axle, random))
    return recordings


def as_log(simulation: Simulation) -> Log:
    """The same as a log to be written: every channel as logged, in its own unit, without meaning.

    Its hash is that of everything it was made from.
    """
    made_from = repr((simulation.scenario, simulation.seed, len(simulation.t)))
    channels = [
        Channel(
            r.name, "", None, r.axle, r.unit, "simulated",
            Column(r.t, r.value, np.isfinite(r.value)), len(r.t),
        )
        for r in log(simulation)
    ]  # fmt: skip
    return Log(
        simulation.scenario.name, "simulation", sha256(made_from.encode()).hexdigest(), False,
        sum(c.rows for c in channels), tuple(channels), (),
    )  # fmt: skip


def _recorded(
    simulation: Simulation, sensor: Sensor, axle: int | None, random: np.random.Generator
) -> Recording:
    scenario = simulation.scenario
    at: Floats = np.arange(math.floor(scenario.duration * sensor.rate + 1e-9) + 1) / sensor.rate
    true = simulation.signal(sensor.signal, axle)
    dense: Floats = simulation.t.astype(np.float64) * 1e-9
    if sensor.teeth:
        at, value = _pulses(at, true, dense, sensor, random)
    else:
        exact = np.interp(at, dense, true)
        noise = math.sqrt(sensor.noise_variance) * random.standard_normal(len(at))
        if sensor.signal in ("wheel_speed", "train_speed"):
            noise[exact == 0.0] = 0.0  # a sensor at rest gives no pulses
        value = exact + sensor.offset + noise
    if unit := UNITS.get(sensor.unit.lower()):
        if sensor.signal == "wheel_speed" and unit.dimension == "speed":
            value *= scenario.vehicle.radius(axle or 1).value / (1.0 + sensor.diameter_error)
        value = (value - unit.offset) / unit.factor
    decimals = None
    if sensor.resolution:
        decimals = max(0, -int(Decimal(repr(sensor.resolution)).normalize().as_tuple().exponent))
        value = np.round(np.round(value / sensor.resolution) * sensor.resolution, decimals) + 0.0
    stamp = at + sensor.delay + random.uniform(-sensor.jitter, sensor.jitter, len(at))
    kept = random.random(len(at)) >= sensor.loss
    for start, end in sensor.gaps:
        kept &= (stamp < start) | (stamp > end)
    name = _NAMES[sensor.signal]
    if axle is not None and scenario.train.axles > 1:
        name = f"{name}_{axle}"
    t = np.round(stamp * 1e9).astype(np.int64)
    return Recording(name, sensor.signal, axle, sensor.unit, t[kept], value[kept], decimals)


def _pulses(
    at: Floats, speed: Floats, dense: Floats, sensor: Sensor, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Times and readings of a counter: total, or speed [rad/s] from the last interval's pulses."""
    steps = (speed[1:] + speed[:-1]) / 2.0 * np.diff(dense)
    angle = np.interp(at, dense, np.concatenate(([0.0], np.cumsum(steps))))
    count = np.floor((angle / (2.0 * math.pi)) * sensor.teeth + random.random())
    if sensor.unit == "count":
        return at, count
    return at[1:], np.diff(count) * (2.0 * math.pi * sensor.rate / sensor.teeth)
