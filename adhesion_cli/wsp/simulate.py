"""Simulates a braked train: scenario → true signals → what a logger would have recorded.

The train and its equations are `plant`'s. Here its brake is applied and released, its simple WSP
acts, and sensors log it.
"""

import math
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from hashlib import sha256

import numpy as np

from ..core import compiled, physics
from ..core.errors import UserError
from ..core.model import Channel, Column, Floats, Log, Times
from ..core.signals import running_integral
from ..core.units import UNITS
from ..rail.creep_law import CREEP_FROM
from . import plant as plants
from .controller import APPLY, DUMP, HOLD
from .plant import (
    SOON,
    Demand,
    MovingTrain,
    Plant,
    RailConditions,
    WheelStates,
    advance_to,
    radii,
    rolling,
    settle,
)
from .scenario import INF, Scenario, Sensor, Signal, Wsp, load, scenarios

__all__ = ["Recording", "Scenario", "Simulation", "as_log", "load", "log", "run", "scenarios"]

# samples of one run, axles times steps: about 4 GB; an hour at 1 kHz has 3.6e6
MAX_SAMPLES = 20_000_000

_NAMES: dict[Signal, str] = {
    "pressure": "bc_pressure",
    "clamping_force": "clamping_force",
    "wheel_speed": "wheel_speed",
    "train_speed": "train_speed",
    "truth": "adhesion_force_true",
    "slip": "slip_true",
}


# --- integration: plain Python that compiles ----------------------------------------------------


def _decide(wsp: Wsp, v: float, wheels: WheelStates, previous: Floats) -> None:
    """Sets each axle's valve by its true slip; `previous` is the rim speed at the last decision."""
    w = wheels.w
    for i in range(len(w)):
        sliding = v - w[i] if v > wsp.slowest else 0.0
        if sliding > wsp.vent_slip * v and w[i] <= previous[i]:
            wheels.valve[i] = DUMP
        elif sliding > wsp.hold_slip * v:
            wheels.valve[i] = HOLD
        else:
            wheels.valve[i] = APPLY
        previous[i] = w[i]


def _integrate(  # noqa: PLR0913 (compiled: one array each)
    plant: Plant,
    track: RailConditions,
    demand: Demand,
    wsp: Wsp,
    train: MovingTrain,
    wheels: WheelStates,
    dt: float,
    pressure: Floats,
    rim_speed: Floats,
    speed: Floats,
    distance: Floats,
) -> float:
    """Fills the columns, shape (n, axles) and (n,); returns NaN, or the time [s] Newton failed."""
    previous, decisions = wheels.w.copy(), 0
    for k in range(len(speed)):
        step_end, recorded = (k + 1) * dt, False
        while train.t < step_end - SOON:
            if decisions * wsp.period <= train.t + SOON:
                decisions += 1
                _decide(wsp, train.v, wheels, previous)
            settle(plant, demand, train, wheels)
            if not recorded:
                recorded = True
                speed[k], distance[k] = train.v, train.x
                for i in range(len(wheels.w)):  # rows at once take 2 s to compile
                    pressure[k, i], rim_speed[k, i] = wheels.p[i], wheels.w[i]
            tick_end = min(step_end, decisions * wsp.period) if decisions > 0 else step_end
            train = advance_to(plant, track, demand, train, wheels, tick_end)
            if math.isnan(train.v):
                return train.t
    return math.nan


# --- true signals -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Simulation:
    """The true signals on one dense time axis, SI; shape (n,) or (n, axles)."""

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
    def slip(self) -> Floats:
        """Slip s [-], NaN below `rail.CREEP_FROM`. Source: (2)."""
        rim = self.wheel_speed * radii(self.scenario)
        return physics.slip(self.train_speed[:, None], rim, 1.0, CREEP_FROM)

    def signal(self, signal: Signal, axle: int | None) -> Floats:
        """One axle's column of that name, axles numbered from 1; SI, shape (n,)."""
        if signal == "train_speed":
            return self.train_speed
        name = "adhesion_force" if signal == "truth" else signal
        column: Floats = getattr(self, name)[:, (axle or 1) - 1]
        return column


def run(scenario: Scenario, seed: int | None = None, dt: float | None = None) -> Simulation:
    """The true signals of a scenario.

    `seed` and `dt`, the step of integration and output [s], stand in place of the scenario's.

    Raises:
        UserError: where the step is too long for the scenario, or the run too large for memory.
    """
    dt = scenario.dt if dt is None else dt
    n = round(scenario.duration / dt) + 1
    fastest = max((x.rate for x in scenario.sensor), default=0.0)
    sample_count = max(n, scenario.duration * fastest) * scenario.train.axles
    if sample_count > MAX_SAMPLES:
        text = f"{sample_count:.3g} samples, at most {MAX_SAMPLES:.3g} fit into one run"
        hint = "simulate less time, or with a longer dt and slower sensors"
        raise UserError(f"{scenario.name}: {text}", hint)
    plant, track, v = plants.plant_of(scenario), plants.track_of(scenario), scenario.train.speed
    pressure, rim_speed, force = np.zeros((3, n, scenario.train.axles))
    t = np.arange(n, dtype=np.float64) * np.float64(dt)
    speed, distance = np.full(n, v), v * t
    if scenario.rig:
        rim_speed[:, 0] = v - scenario.rig.slip * v * t / t[-1]
    else:
        loop = plant, track, plants.demand_of(scenario), scenario.wsp or Wsp(period=INF)
        columns = pressure, rim_speed, speed, distance
        integrate = compiled.function(_integrate)
        failed = integrate(*loop, *rolling(v, scenario.train.axles), dt, *columns)
        if not math.isnan(failed):
            hint = f"take a shorter step, as --dt {dt / 2.0:g}"
            raise UserError(f"{scenario.name}: no solution at {failed:g} s", hint)
    compiled.function(plants.forces)(plant, track, t, speed, distance, rim_speed, force)
    K = physics.clamping_force(pressure, scenario.vehicle)
    if scenario.rig:
        slowing = scenario.rig.slip * v / t[-1] / plant.radius[0]  # −ω̇
        K = (force + slowing * plant.inertia / plant.radius[0]) / plant.phi  # (1)
        pressure = np.where(K > 0.0, physics.cylinder_pressure(plant.brake, K), 0.0)
    ns = np.round(t * 1e9).astype(np.int64)
    seed = scenario.seed if seed is None else seed
    w = rim_speed / plant.radius
    return Simulation(scenario, seed, ns, pressure, K, w, force, speed, distance)


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
    decimals: int | None  # after rounding; None: not rounded

    def texts(self) -> list[str]:
        """Values as printed in a log; "" where there is no value."""
        form = ".9g" if self.decimals is None else f".{self.decimals}f"
        return ["" if math.isnan(x) else format(x, form) for x in self.value.tolist()]


def log(simulation: Simulation) -> list[Recording]:
    """The records of the scenario's sensors; the same seed gives the same ones."""
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
    """The same as a log to be written: every channel in its own unit, without meaning.

    Its hash is that of scenario, seed and length.
    """
    identity = repr((simulation.scenario, simulation.seed, len(simulation.t)))
    channels = []
    for r in log(simulation):
        data = Column(r.t, r.value, np.isfinite(r.value))
        channels.append(Channel(r.name, "", None, r.axle, r.unit, "simulated", data, len(r.t)))
    name, rows = simulation.scenario.name, sum(c.rows for c in channels)
    sha = sha256(identity.encode()).hexdigest()
    return Log(name, "simulation", sha, False, rows, tuple(channels), ())


def _recorded(
    simulation: Simulation, sensor: Sensor, axle: int | None, random: np.random.Generator
) -> Recording:
    scenario = simulation.scenario
    sample_count = math.floor(scenario.duration * sensor.rate + 1e-9) + 1
    sample_times: Floats = np.arange(sample_count) / sensor.rate
    signal = simulation.signal(sensor.signal, axle)
    dense: Floats = simulation.t.astype(np.float64) * 1e-9
    unit = UNITS.get(sensor.unit.lower())
    accelerates = unit is not None and unit.dimension == "acceleration"
    if accelerates:
        signal = np.gradient(signal, dense)
    if sensor.teeth:
        sample_times, value = _pulses(sample_times, signal, dense, sensor, random)
    else:
        exact = np.interp(sample_times, dense, signal)
        noise = math.sqrt(sensor.noise_variance) * random.standard_normal(len(sample_times))
        if sensor.signal in ("wheel_speed", "train_speed") and not accelerates:
            noise[exact == 0.0] = 0.0  # a sensor at rest gives no pulses
        value = exact + sensor.offset + noise
    if unit:
        if sensor.signal == "wheel_speed" and unit.dimension == "speed":
            value *= scenario.vehicle.radius(axle or 1).value / (1.0 + sensor.diameter_error)
        value = (value - unit.offset) / unit.factor
    decimals = None
    if sensor.resolution:
        decimals = max(0, -int(Decimal(repr(sensor.resolution)).normalize().as_tuple().exponent))
        value = np.round(np.round(value / sensor.resolution) * sensor.resolution, decimals) + 0.0
    jitter = random.uniform(-sensor.jitter, sensor.jitter, len(sample_times))
    stamp = sample_times + sensor.delay + jitter
    received = random.random(len(sample_times)) >= sensor.loss
    for start, gap_end in sensor.gaps:
        received &= (stamp < start) | (stamp > gap_end)
    name = "acceleration" if accelerates else _NAMES[sensor.signal]
    if axle is not None and scenario.train.axles > 1:
        name = f"{name}_{axle}"
    t = np.round(stamp * 1e9).astype(np.int64)
    unit_name = "-" if sensor.signal == "slip" else sensor.unit
    return Recording(name, sensor.signal, axle, unit_name, t[received], value[received], decimals)


def _pulses(
    sample_times: Floats, speed: Floats, dense: Floats, sensor: Sensor, random: np.random.Generator
) -> tuple[Floats, Floats]:
    """Times and readings of a counter: total, or speed [rad/s] from the last interval's pulses."""
    angle = np.interp(sample_times, dense, running_integral(dense, speed))
    count = np.floor((angle / (2.0 * math.pi)) * sensor.teeth + random.random())
    if sensor.unit == "count":
        return sample_times, count
    return sample_times[1:], np.diff(count) * (2.0 * math.pi * sensor.rate / sensor.teeth)
