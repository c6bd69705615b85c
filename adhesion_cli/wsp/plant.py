"""A braked train in motion: cylinders, wheels on the rail, car body; one step of its equations.

One car body of mass M = Σ m shared by every wheelset, each with its own brake cylinder; (1) per
wheelset with Polach's adhesion force (3):

    M v̇ = −Σ F_i − M (r + C v²),    ω̇_i = a (F_i − φK_i) while the wheel turns.

r and C are zero but in the replay of a log. A wheel that stands is held by its brake up to φK; a
train that stands stays (level track, F = 0).
The equations are stiff: near adhesion the slip settles within 2 ms at 20 m/s, 20 µs at walking
pace. They are integrated by the two-stage, L-stable, stiffly accurate SDIRK method of order 2 (R.
Alexander, SIAM J. Numer. Anal. 14 (1977) 1006-1021, γ = 1 − 1/√2). Its last stage is the new
state, so F in the output satisfies (3) at its own sample.

Everything below `rolling` is plain Python that compiles; loops over `advance_to` set the valves.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import physics
from ..core.model import Floats
from ..core.physics import ForceLine, clamping
from ..rail.creep_law import Condition, Patch, condition, creep_force
from .controller import APPLY, DUMP, HOLD
from .scenario import INF, Scenario, Wave

GAMMA = 1.0 - math.sqrt(0.5)  # of the method: L-stable, order 2
STANDSTILL = 1e-3  # a braked train slower than this stands [m/s]
SOON = 1e-10  # events closer than this count as one [s]
CONVERGED = 1e-11  # last Newton correction [m/s]
PATIENCE = 60  # Newton iterations


class Plant(NamedTuple):
    """What the loop needs of train, brakes and valves; arrays of shape (axles,)."""

    radius: Floats
    inertia: float
    mass: float  # of the train
    phi: float
    brake: ForceLine
    patch: Patch
    positions: Floats
    fill_time: float
    vent_time: float
    fill_rate: float
    vent_rate: float
    valve_time: float  # time constant of a dump valve


class Demand(NamedTuple):
    """Pressure demanded at the cylinders, as straight lines between knots, shape (k,)."""

    t: Floats  # [s], the last one at infinity
    p: Floats  # [Pa]


class RailConditions(NamedTuple):
    """Rail condition under each axle as straight lines between knots."""

    timed: bool  # knots are times, not places
    knots: Floats  # shape (k,), the last one at infinity
    values: Floats  # shape (axles, k, 5), the fields of `Condition`
    amplitude: float
    period: float
    resistance: float = 0.0  # r: running resistance and gradient [m/s²]
    drag: float = 0.0  # C [1/m]


def plant_of(s: Scenario) -> Plant:
    """Train, brakes and valves of a scenario."""
    n, m = s.train.axles, s.vehicle.axle_mass.value
    return Plant(
        radius=radii(s),
        inertia=s.vehicle.wheelset_inertia.value,
        mass=n * m,
        phi=s.vehicle.friction.value,
        brake=physics.force_line(s.vehicle),
        patch=s.contact.patch(m * physics.G),
        positions=np.array(s.train.positions or [0.0] * n),
        fill_time=s.brake.fill_time,
        vent_time=s.brake.vent_time,
        fill_rate=s.brake.fill_rate,
        vent_rate=s.brake.vent_rate,
        valve_time=s.wsp.vent_time if s.wsp else INF,
    )


def radii(s: Scenario) -> Floats:
    """Wheel radius of each axle [m], shape (axles,)."""
    return np.array([s.vehicle.radius(axle).value for axle in range(1, s.train.axles + 1)])


def demand_of(s: Scenario) -> Demand:
    """What a scenario demands of its brakes."""
    t, p = [-1.0], [0.0]
    for c in s.brake.command:
        goal = c.pressure or 0.0
        if c.clamping_force:
            goal = physics.cylinder_pressure(physics.force_line(s.vehicle), c.clamping_force)
        start = c.at + s.brake.dead_time
        t += [start, start + c.ramp]
        p += [p[-1], goal]
    return Demand(np.array([*t, INF]), np.array([*p, p[-1]]))


def track_of(s: Scenario) -> RailConditions:
    """The rail of a scenario, film laid over its sections, as each axle finds it cleaned."""
    rail = s.rail
    knots: list[float] = []
    values: list[Condition] = []
    for place, name, scale in rail.changes():
        if knots:
            knots.append(place)
            values.append(values[-1])
        knots.append(place + rail.blend if knots else place)
        values.append(condition(name)._replace(f0=condition(name).f0 * scale))
    wave = rail.wave or Wave(0.0, 1.0)
    wheel_values = np.array([[*values, values[-1]]] * s.train.axles)
    wheel_values[:, :, 2] *= np.array(s.train.cleaning or [1.0] * s.train.axles)[:, None]  # f0
    return RailConditions(
        rail.along == "time", np.array([*knots, INF]), wheel_values, wave.amplitude, wave.period
    )


class MovingTrain(NamedTuple):
    """Where a train in motion is; `advance_to` gives the next one."""

    t: float  # [s]
    v: float  # NaN: Newton's iteration failed [m/s]
    x: float  # run by the first axle [m]
    demand_pressure: float  # cylinder pressure there would be without valves [Pa]
    demand_knot: int  # the last one past
    track_knot: int  # likewise, of a rail that changes with time


class WheelStates(NamedTuple):
    """Its wheels and their brakes, shape (axles,); `advance_to` changes them in place."""

    w: Floats  # rim speeds ωR [m/s]
    p: Floats  # cylinder pressures [Pa]
    air: Floats  # consumption of each cylinder, as a rise of pressure [Pa]
    valve: NDArray[np.int64]  # `controller.APPLY`, `HOLD`, `DUMP`; for others to set
    knot: NDArray[np.int64]  # of the track, the last one past each axle
    rails: Floats  # the condition under each where the last step ended, shape (axles, 5)
    friction: Floats  # work space of a step, as the rest
    w_new: Floats
    w_from: Floats
    newton: Floats  # shape (axles, 3)


def rolling(v: float, axles: int) -> tuple[MovingTrain, WheelStates]:
    """A train of that many axles that rolls at v [m/s], brakes released."""

    def zeros(*shape: int) -> Floats:
        return np.zeros((axles, *shape))

    valve, knot = np.zeros(axles, np.int64), np.zeros(axles, np.int64)
    rims = np.full(axles, v)
    return MovingTrain(0.0, v, 0.0, 0.0, 0, 0), WheelStates(
        rims, zeros(), zeros(), valve, knot, zeros(5), zeros(), zeros(), zeros(), zeros(3)
    )


# --- integration: plain Python that compiles ----------------------------------------------------


def rail_under(  # noqa: PLR0913 (compiled)
    plant: Plant, track: RailConditions, axle: int, t: float, x: float, j: int, rail: Floats
) -> int:
    """Fills `rail` with the condition under an axle; returns the knot before it.

    `axle` counts from 0. The train's first axle is at `x` at time `t`. `j` is that knot or an
    earlier one.
    """
    z = t if track.timed else x - plant.positions[axle]
    while track.knots[j + 1] <= z:
        j += 1
    fraction = max(0.0, (z - track.knots[j]) / (track.knots[j + 1] - track.knots[j]))
    for i in range(5):
        knot_value = track.values[axle, j, i]
        rail[i] = knot_value + fraction * (track.values[axle, j + 1, i] - knot_value)
    rail[2] *= 1.0 + track.amplitude * math.sin(2.0 * math.pi * z / track.period)  # f0
    return j


def adhesion(sliding: float, speed: float, rail: Floats, patch: Patch) -> tuple[float, float]:
    """`creep_force` under the condition that `rail_under` left in `rail`."""
    law = Condition(rail[0], rail[1], rail[2], rail[3], rail[4])
    return creep_force(sliding, speed, law, patch)


def forces(  # noqa: PLR0913 (compiled: one array each)
    plant: Plant, track: RailConditions, t: Floats, v: Floats, x: Floats, w: Floats, force: Floats
) -> None:
    """Fills the adhesion force at each sample; shapes (n,), of `w` [m/s] and `force` (n, axles)."""
    rail = np.zeros(5)
    for i in range(w.shape[1]):
        knot = 0
        for k in range(len(t)):
            knot = rail_under(plant, track, i, t[k], x[k], knot, rail)
            force[k, i] = adhesion(v[k] - w[k, i], v[k], rail, plant.patch)[0]


def cylinder(plant: Plant, valve: int, p: float, c0: float, c1: float, h: float) -> float:
    """Cylinder pressure `h` later, the demand going straight from c0 to c1."""
    if valve == HOLD:
        return p
    if valve == DUMP:
        return p * math.exp(-h / plant.valve_time)
    lag = plant.fill_time if c1 > p else plant.vent_time
    if lag == 0.0:
        p1 = c1
    elif h == 0.0:
        p1 = p
    else:
        lag_distance = (c1 - c0) / h * lag  # distance of a lag behind a ramp
        p1 = c1 - lag_distance + (p - c0 + lag_distance) * math.exp(-h / lag)
    if p1 > p:
        return min(p1, p + plant.fill_rate * h) if plant.fill_rate < math.inf else p1
    return max(p1, p - plant.vent_rate * h) if plant.vent_rate < math.inf else p1


def _stage(
    plant: Plant, track: RailConditions, s: WheelStates, h: float, v_from: float, v: float
) -> float:
    """Implicit stage: v = v_from − h (ΣF/M + r + C v²), w = w_from + h R² (F − B)/I, none below 0.

    Newton's method with an arrow Jacobian. F is very steep about zero sliding. An iterate that
    would cross it starts again from there, where F is steepest and it cannot overshoot.
    `v` and `s.w_new` are the first guess; `s.w_new` becomes the answer. NaN: no convergence.
    """
    e, w, work = h / plant.mass, s.w_new, s.newton
    for _ in range(PATIENCE):
        residual = v - v_from + h * (track.resistance + track.drag * v * v)
        slope = 1.0 + 2.0 * h * track.drag * v
        for i in range(len(w)):
            F, D = adhesion(v - w[i], v, s.rails[i], plant.patch)
            c = h * plant.radius[i] ** 2 / plant.inertia
            g = w[i] - s.w_from[i] - c * (F - s.friction[i])
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


def advance_to(
    plant: Plant,
    track: RailConditions,
    demand: Demand,
    s: MovingTrain,
    wheels: WheelStates,
    t_stop: float,
) -> MovingTrain:
    """The train at time `t_stop` [s]; a step ends at every jump and kink of demand or rail."""
    t, v, x, demand_pressure, i, j = s.t, s.v, s.x, s.demand_pressure, s.demand_knot, s.track_knot
    while t < t_stop - SOON:
        while demand.t[i + 1] <= t + SOON:
            i += 1
        stop = min(t_stop, demand.t[i + 1])
        if track.timed:
            while track.knots[j + 1] <= t + SOON:
                j += 1
            stop = min(stop, track.knots[j + 1])
        h = stop - t
        c0, rise = _line(demand, i, t)
        demand_pressure = cylinder(plant, APPLY, demand_pressure, c0, c0 + rise * h, h)
        solution = _step(plant, track, wheels, c0, rise, t, h, v, x)
        if math.isnan(solution):
            return MovingTrain(t, solution, x, demand_pressure, i, j)
        x += 0.5 * h * (v + solution)
        v, t = solution, stop
    return MovingTrain(t_stop, v, x, demand_pressure, i, j)


def settle(plant: Plant, demand: Demand, s: MovingTrain, wheels: WheelStates) -> None:
    """Applies a jump of the demand at the train's time to cylinders without lag."""
    k = s.demand_knot
    while demand.t[k + 1] <= s.t + SOON:
        k += 1
    c = _line(demand, k, s.t)[0]
    for i in range(len(wheels.p)):
        wheels.p[i] = cylinder(plant, wheels.valve[i], wheels.p[i], c, c, 0.0)


def _line(demand: Demand, i: int, t: float) -> tuple[float, float]:
    """Pressure demanded at time t, after knot i [Pa], and its rise [Pa/s]."""
    rise = (demand.p[i + 1] - demand.p[i]) / (demand.t[i + 1] - demand.t[i])
    return demand.p[i] + rise * (t - demand.t[i]), rise


def _step(  # noqa: PLR0913 (compiled: plain floats)
    plant: Plant,
    track: RailConditions,
    s: WheelStates,
    demand: float,
    rise: float,
    t: float,
    h: float,
    v: float,
    x: float,
) -> float:
    """One step to the v at `t + h`, without jumps inside; updates the wheels; NaN as in `_stage`.

    `demand` is the pressure demanded at `t` [Pa] and `rise` its slope [Pa/s].
    """
    w, w_new, w_from, axles = s.w, s.w_new, s.w_from, len(s.w)
    v_new, v_from, braked = v, v, False
    for i in range(axles):
        w_new[i] = w_from[i] = w[i]
    for stage in (GAMMA, 1.0):
        for i in range(axles):
            p1 = cylinder(plant, s.valve[i], s.p[i], demand, demand + rise * stage * h, stage * h)
            K = clamping(plant.brake, p1)
            s.friction[i] = plant.phi * K
            braked = braked or K > 0.0
            if stage == 1.0:
                s.air[i] += max(p1 - s.p[i], 0.0)
                s.p[i] = p1
            t_stage, x_stage = t + stage * h, x + stage * h * v_new
            s.knot[i] = rail_under(plant, track, i, t_stage, x_stage, s.knot[i], s.rails[i])
        if v > 0.0:
            v_new = _stage(plant, track, s, GAMMA * h, v_from, v_new)
        if math.isnan(v_new):
            return v_new
        if stage < 1.0:  # the second stage starts from h (1 − γ) f of the first
            v_from = v + (1.0 - GAMMA) / GAMMA * (v_new - v)
            for i in range(axles):
                w_from[i] = w[i] + (1.0 - GAMMA) / GAMMA * (w_new[i] - w[i])
    at_standstill = braked and v_new < STANDSTILL
    for i in range(axles):
        w[i] = 0.0 if at_standstill else w_new[i]
    return 0.0 if at_standstill else v_new
