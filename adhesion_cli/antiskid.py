"""Closed loop: a train stops while a controller works the valves of each brake cylinder.

At each of its ticks, the unit of an axle reads train speed, wheel speed and cylinder pressure (late
and noisy), runs an online estimator and the slope's least squares, asks the controller and sets the
valves, which answer after their dead time. `online` is that chain sample by sample, for a unit, a
rig or a log; `run` is the same chain around the simulated train, compiled.

A stop is told in the terms of EN 15595: stopping distance and its extension over that on dry rail,
use of the adhesion there was, depth and time of slides, standing wheels, air. The limits of the
standard are not built in: no copy of it could be read.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import physics, slope
from .controller import APPLY, VENT, Drives, Observed
from .controller import registry as controllers
from .controllers.none import init as control_init
from .controllers.none import step as control_step
from .errors import UserError, unknown
from .estimator import Estimator
from .estimator import registry as estimators
from .estimators.kalman import init as estimate_init
from .estimators.kalman import step as estimate_step
from .methods import Method, validated
from .model import Floats, Vehicle, Wheelset
from .physics import G, braked, reference_speed
from .plant import (
    SOON,
    Plant,
    Track,
    adhesion,
    advance,
    cylinder,
    demand_of,
    plant_of,
    radii,
    rail_at,
    scratch,
    track_of,
)
from .rail import Patch
from .scenario import Limit, Rail, Scenario, Section
from .slope import init as slope_init
from .slope import region
from .slope import step as slope_step
from .stop import LOCKED, ROLLS, SLOWEST, Stop, Verdict

DRY = Rail((Section(0.0, "dry"),))
Settings = Mapping[str, Mapping[str, float]]


class Named(NamedTuple):
    """What has parameters and is no method."""

    name: str
    Params: type[Any]


SLOPE = Named("slope", slope.Params)
SLOPE_IN_LOOP = {"delta": 1.2, "rho": 0.5}  # found by search; slower than what suits a log
ESTIMATOR = "kalman"  # in the loop where none is chosen
LONGEST = 600.0  # of a stop [s]
_NORMAL = 101_325.0 * 293.15 / 273.15  # pressure of normal air (DIN 1343) at 20 °C [Pa]
_HALVINGS = 30  # in the search for the peak


# --- one axle, one tick: plain Python that compiles -----------------------------------------------


class Chain(NamedTuple):
    """What the chain from sensors to controller needs of the wheelset."""

    radius: float  # R [m]
    mass: float  # m [kg]
    inertia: float  # I [kg m²]
    phi: float  # φ [-]
    noise: float = 0.0  # 1 sigma of v − ωR as measured [m/s]


def slip_of(c: Chain, v: float, y: float) -> float:
    """Slip [-] over a speed of at least `SLOWEST`. Source: (2)."""
    return (v - y * c.radius) / max(v, SLOWEST)


def observed(
    c: Chain, v: float, y: float, K: float, F: float, slowing: float, k: slope.State
) -> Observed:
    """What the controller is told. Source: [S1].

    ds/dt = −(R dω/dt + (1 − s) |dv/dt|)/v with dω/dt from (1).

    Args:
        c: the wheelset.
        v: train speed [m/s].
        y: wheel speed [rad/s].
        K: clamping force [N].
        F: estimated adhesion force [N].
        slowing: deceleration of the train that the estimated forces of its axles make [m/s²].
        k: slope at the operating point.
    """
    s = slip_of(c, v, y)
    rate = c.radius**2 / c.inertia * (c.phi * K - F) - (1.0 - s) * slowing  # (1)
    if y <= 0.0 and rate > 0.0:
        rate = 0.0  # the wheel stands
    mu = F / (c.mass * G)
    return Observed(y * c.radius, s, rate / max(v, SLOWEST), mu, k.slope, k.confidence)


class _Unit(NamedTuple):
    """Times in steps of the plant, and what the unit knows."""

    every: int  # between ticks
    delay: int  # age of measured values
    dead: int  # until the valves answer
    measured: bool  # the train speed; else it is made of the axles
    bands: slope.Bands  # that regions are told by


class _Trace(NamedTuple):
    """Columns of `Stop`, a row per tick: four of shape (ticks,), then (ticks, axles)."""

    speed: Floats
    distance: Floats
    demand: Floats
    told_train_speed: Floats
    wheel_speed: Floats  # [rad/s]
    pressure: Floats
    force: Floats
    peak: Floats
    peak_slip: Floats
    told_wheel_speed: Floats
    told_pressure: Floats
    told_clamping_force: Floats
    estimate: Floats
    slope: Floats
    confidence: Floats
    valve: NDArray[np.int8]
    region: NDArray[np.int8]


def online(
    chosen: tuple[Any, ...],
    wheelset: Wheelset,
    chain: Chain,
    samples: Iterable[tuple[int, float, float, float]],
    drives: Drives | None = None,
) -> Iterator[int]:
    """The valves of one axle after each sample, as the samples arrive; needs no compiler.

    Args:
        chosen: what `choose` returned.
        wheelset: constants of (1).
        chain: the same wheelset for the slip.
        samples: (time [ns], train speed [m/s], wheel speed [rad/s], K [N]), time rising strictly.
        drives: the valves, if there are any.

    Yields:
        `controller.APPLY`, `HOLD` or `VENT`.
    """
    est, law, ep, sp, cp = chosen
    estimate: Any = None
    k: Any = None
    control: Any = None
    before = 0
    for t, v, y, K in samples:
        h, before = (t - before) * 1e-9, t
        if control is None:
            estimate, k = est.init(ep, wheelset, K, y), slope_init(sp, 0.0, 0.0)
            o = observed(chain, v, y, K, estimate.F, estimate.F / chain.mass, k)
            control = law.init(cp, o)
        else:
            estimate = est.step(ep, wheelset, estimate, h, K, y)
            noise = chain.noise / max(v, SLOWEST)
            mu = estimate.F / (chain.mass * G)
            k = slope_step(sp, k, h, slip_of(chain, v, y), mu, noise, 0.0)
            o = observed(chain, v, y, K, estimate.F, estimate.F / chain.mass, k)
            control = law.step(cp, control, h, o)
        if drives is not None:
            drives.set(control.valve != APPLY, control.valve == VENT)
        yield control.valve


def _peak(v: float, rail: Floats, patch: Patch) -> float:
    """Sliding speed [m/s] of the greatest adhesion force: where its slope changes sign."""
    low, high = math.log(1e-6 * v), math.log(v)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if adhesion(math.exp(middle), v, rail, patch)[1] > 0.0:
            low = middle
        else:
            high = middle
    return math.exp(low)


def _march(
    plant: Plant, track: Track, demand_t: Floats, demand_p: Floats, v: float, dt: float,
    unit: _Unit, chain: Chain, w: Wheelset, ep: Any, sp: slope.Params, cp: Any,
    train_noise: Floats, wheel_noise: Floats, pressure_noise: Floats,
    trace: _Trace, air: Floats,
) -> tuple[int, float]:  # fmt: skip
    """Brakes until the train stands, or `trace` is full.

    `air` receives what each axle's cylinder took in, as a rise of pressure [Pa].

    Returns:
        Ticks done, and NaN or the time [s] at which Newton's iteration failed.
    """
    ticks, axles = trace.pressure.shape
    p, rim, room = np.zeros(axles), np.full(axles, v), scratch(axles)
    valve, knot = np.zeros(axles, np.int64), np.zeros(axles, np.int64)
    before, alone = np.zeros(axles), 0.0
    size = max(unit.delay, unit.dead) + 1  # of the rings of what was
    was_v, was_w, was_p = np.zeros(size), np.zeros((size, axles)), np.zeros((size, axles))
    command = np.zeros((size, axles), np.int64)
    F = np.zeros(axles)
    h = unit.every * dt
    x, v_told, segment, timed_knot = 0.0, v, 0, 0
    estimates = [estimate_init(ep, w, 0.0, v / chain.radius)] * axles
    slopes = [slope_init(sp, 0.0, 0.0)] * axles
    start = observed(chain, v, v / chain.radius, 0.0, 0.0, 0.0, slopes[0])
    controls = [control_init(cp, start)] * axles
    for k in range(ticks * unit.every):
        t, end, now = k * dt, (k + 1) * dt, k % size
        was_v[now] = v
        for i in range(axles):
            was_w[now, i], was_p[now, i] = rim[i] / plant.radius[i], p[i]
        if k % unit.every == 0:
            j, then = k // unit.every, max(k - unit.delay, 0) % size
            for i in range(axles):
                y = was_w[then, i]
                if y > 0.0:  # a sensor at rest gives no pulses
                    y = max(y + wheel_noise[j, i], 0.0)
                told = was_p[then, i] + pressure_noise[j, i]
                K = max(plant.per_pascal * told - plant.at_zero, 0.0)  # (15)
                if j > 0:
                    estimates[i] = estimate_step(ep, w, estimates[i], h, K, y)
                else:
                    estimates[i] = estimate_init(ep, w, K, y)
                F[i] = estimates[i].F
                trace.told_wheel_speed[j, i], trace.told_clamping_force[j, i] = y, K
                trace.told_pressure[j, i] = told
            if unit.measured:
                v_told = max(was_v[then] + train_noise[j], 0.0) if was_v[then] > 0.0 else 0.0
            else:
                fastest = trace.told_wheel_speed[j].max() * chain.radius
                braking = braked(trace.told_clamping_force[j], w, chain.radius).mean()
                v_told = reference_speed(v_told, fastest, braking, h) if j > 0 else fastest
            slowing, noise = F.sum() / (axles * chain.mass), chain.noise / max(v_told, SLOWEST)
            for i in range(axles):
                y, K = trace.told_wheel_speed[j, i], trace.told_clamping_force[j, i]
                s, mu = slip_of(chain, v_told, y), F[i] / (chain.mass * G)
                if j > 0:
                    slopes[i] = slope_step(sp, slopes[i], h, s, mu, noise, 0.0)
                o = observed(chain, v_told, y, K, F[i], slowing, slopes[i])
                if j > 0:
                    controls[i] = control_step(cp, controls[i], h, o)
                else:
                    controls[i] = control_init(cp, o)
                z = t if track.timed else x - plant.positions[i]
                knot[i] = rail_at(track, i, z, knot[i], room.rails[i])
                trace.wheel_speed[j, i], trace.pressure[j, i] = rim[i] / plant.radius[i], p[i]
                trace.force[j, i] = adhesion(v - rim[i], v, room.rails[i], plant.patch)[0]
                sliding = _peak(v, room.rails[i], plant.patch)
                trace.peak[j, i] = adhesion(sliding, v, room.rails[i], plant.patch)[0]
                trace.peak_slip[j, i], trace.valve[j, i] = sliding / v, controls[i].valve
                trace.estimate[j, i], trace.slope[j, i] = F[i], slopes[i].slope
                trace.confidence[j, i] = slopes[i].confidence
                trace.region[j, i] = region(s, slopes[i].slope, unit.bands)
            trace.speed[j], trace.told_train_speed[j] = v, v_told
            trace.distance[j], trace.demand[j] = x, alone
        for i in range(axles):
            command[now, i] = controls[i].valve
            if k >= unit.dead:
                valve[i] = command[(k - unit.dead) % size, i]
        while t < end - SOON:
            while demand_t[segment + 1] <= t + SOON:
                segment += 1
            while track.timed and track.knots[timed_knot + 1] <= t + SOON:
                timed_knot += 1
            stop = min(end, demand_t[segment + 1])
            if track.timed:
                stop = min(stop, track.knots[timed_knot + 1])
            span = demand_t[segment + 1] - demand_t[segment]
            rise = (demand_p[segment + 1] - demand_p[segment]) / span
            c0 = demand_p[segment] + rise * (t - demand_t[segment])
            before[:] = p
            alone = cylinder(plant, APPLY, alone, c0, c0 + rise * (stop - t), stop - t)
            v_new = advance(plant, track, valve, knot, c0, rise, t, stop - t, v, x, rim, p, room)
            if math.isnan(v_new):
                return 0, t
            air += np.maximum(p - before, 0.0)
            x += 0.5 * (stop - t) * (v + v_new)
            v, t = v_new, stop
        if v == 0.0:
            return k // unit.every + 1, math.nan
    return ticks, math.nan


# --- stops ----------------------------------------------------------------------------------------


def run(
    scenario: Scenario,
    controller: str,
    seed: int | None = None,
    algo: str = ESTIMATOR,
    settings: Settings | None = None,
    track: Track | None = None,
) -> Stop:
    """One stop.

    Args:
        scenario: train, brake, rail and unit; its sensors and its simple slide protection are the
            log's and play no part.
        controller: a name in `controller.registry()`.
        seed: of the sensors' noise, in place of the scenario's.
        algo: online estimator in the loop.
        settings: parameters by name of controller, of estimator, and of "slope".
        track: the rail, in place of the scenario's.

    Raises:
        UserError: no such controller or estimator, a parameter unknown or out of range, a scenario
            that does not end in a stop.
    """
    from . import compiled

    if scenario.rig or not scenario.brake.command:
        raise UserError(f"{scenario.name}: no train that brakes", "take a scenario of a stop")
    known, axles, dt = scenario.antiskid, scenario.train.axles, scenario.dt
    settings = settings or {}
    every, delay, dead = (round(x / dt) for x in (known.period, known.delay, known.dead_time))
    unit = _Unit(every, delay, dead, known.train_speed == "measured", bands(settings))
    if unit.every < 1:
        raise UserError(f"{scenario.name}: dt is longer than the unit's period", "a shorter dt")
    est, law, ep, sp, cp = choose(controller, algo, settings)
    plant = plant_of(scenario)
    plant = plant._replace(
        valve_time=known.vent_time, fill_rate=min(plant.fill_rate, known.fill_rate)
    )
    h = unit.every * dt
    ticks = round(LONGEST / h)
    shape = (ticks, axles)
    seed = scenario.seed if seed is None else seed
    random = np.random.Generator(np.random.PCG64(seed))
    noise = [
        math.sqrt(variance) * random.standard_normal(size)
        for variance, size in (
            (known.train_noise, ticks), (known.wheel_noise, shape), (known.pressure_noise, shape),
        )
    ]  # fmt: skip
    columns = [np.empty(size) for size in (ticks,) * 4 + (shape,) * 11]
    trace = _Trace._make([*columns, np.empty(shape, np.int8), np.empty(shape, np.int8)])
    air = np.zeros(axles)
    march = compiled.function(
        _march, estimate_init=est.init, estimate_step=est.step,
        control_init=law.init, control_step=law.step,
    )  # fmt: skip
    done, failed = march(
        plant, track or track_of(scenario), *demand_of(scenario), scenario.train.speed, dt, unit,
        chain_of(scenario.vehicle), physics.wheelset(scenario.vehicle, 1), ep, sp, cp, *noise,
        trace, air,
    )  # fmt: skip
    if not math.isnan(failed):
        raise UserError(f"{scenario.name}: no solution at {failed:g} s", "take a shorter dt")
    if done == ticks:
        raise UserError(
            f"{scenario.name}: the train does not stand after {LONGEST:g} s",
            "antiskid needs a brake that is not released before the train stands",
        )
    trace = _Trace._make(column[:done].copy() for column in trace)
    v, rim = trace.speed, trace.wheel_speed * radii(scenario)
    return Stop(
        controller, algo, seed, np.round(np.arange(done) * (h * 1e9)).astype(np.int64),
        v, trace.distance, trace.demand, rim, trace.pressure, trace.force, trace.peak,
        trace.peak_slip, physics.slip(v[:, None], rim, 1.0, SLOWEST), trace.valve,
        trace.told_train_speed, trace.told_wheel_speed, trace.told_pressure,
        trace.told_clamping_force, trace.estimate, trace.slope, trace.confidence, trace.region,
        air=float(air.sum()) * known.volume / _NORMAL * 1e3,
    )  # fmt: skip


def chain_of(vehicle: Vehicle) -> Chain:
    """The constants of the chain; units know the nominal radius, that of axle 1."""
    return Chain(
        vehicle.radius(1).value, vehicle.axle_mass.value, vehicle.wheelset_inertia.value,
        vehicle.friction.value,
    )  # fmt: skip


def choose(
    controller: str, algo: str, settings: Settings
) -> tuple[Estimator, Method, Any, slope.Params, Any]:
    """Estimator, controller, and the parameters of estimator, slope and controller.

    Raises:
        UserError: a name that is none, or a parameter unknown or out of range.
    """
    known, laws = estimators(), controllers()
    if controller not in laws:
        raise unknown("controller", controller, list(laws))
    if algo not in known:
        raise unknown("estimator", algo, list(known))
    for name in settings:
        if name not in (*laws, *known, SLOPE.name):
            raise unknown("setting", name, [*laws, *known, SLOPE.name])
    est, law = known[algo], laws[controller]
    settings = {**settings, SLOPE.name: {**SLOPE_IN_LOOP, **settings.get(SLOPE.name, {})}}
    ep, sp, cp = (validated(x, settings.get(x.name, {})) for x in (est, SLOPE, law))
    return est, law, ep, sp, cp


def parameters(laws: Iterable[str], algo: str, settings: Settings) -> dict[str, dict[str, float]]:
    """Every parameter in force in the loops of these controllers, by `Settings`' names.

    Raises:
        UserError: as `choose`.
    """
    found: dict[str, dict[str, float]] = {}
    for law in laws:
        _, _, ep, sp, cp = choose(law, algo, settings)
        found |= {algo: ep._asdict(), SLOPE.name: sp._asdict(), law: cp._asdict()}
    return found


def bands(settings: Settings) -> slope.Bands:
    """The patent's bands under these settings, for every controller's picture alike."""
    p = validated(controllers()["patent"], settings.get("patent", {}))
    return slope.Bands(p.slip_low, p.slip_high, p.slope_low, p.slope_high)


def dry_distance(scenario: Scenario) -> float:
    """Stopping distance of the same train and brake on dry rail, without controller [m]."""
    dry = replace(scenario, rail=DRY, train=replace(scenario.train, cleaning=()))
    return _stopping_distance(run(dry, "none"), dry)


def verdict(stop: Stop, scenario: Scenario, dry: float) -> Verdict:
    """What a stop is worth; `dry` is the stopping distance on dry rail [m]."""
    h = float(stop.t[1] - stop.t[0]) * 1e-9
    wheel = physics.wheelset(scenario.vehicle, 1)
    asked = wheel.rolling * wheel.phi * physics.clamping_force(stop.demand, scenario.vehicle)
    counted = stop.train_speed >= SLOWEST
    limited = counted[:, None] & (asked[:, None] > stop.peak)
    distance, some = _stopping_distance(stop, scenario), bool(limited.any())
    error, sliding = np.abs(stop.slip - stop.peak_slip)[limited], stop.sliding()
    return Verdict(
        stopping_distance_m=distance,
        extension=distance / dry - 1.0,
        utilisation=float(stop.force[limited].sum() / stop.peak[limited].sum()) if some else None,
        max_slip=float(stop.slip[counted].max()),
        locked_s=float((sliding == LOCKED).sum()) * h,
        air_nl=stop.air,
        mean_slip_error=float(error.mean()) if some else None,
        slide_s=float((sliding != ROLLS).sum()) * h,
        limited_s=float(limited.sum()) * h,
    )


def _stopping_distance(stop: Stop, scenario: Scenario) -> float:
    demanded = scenario.brake.command[0].at
    return float(stop.distance[-1] - np.interp(demanded, stop.t * 1e-9, stop.distance))


def against(limits: Sequence[Limit], v: Verdict) -> Iterator[tuple[Limit, bool]]:
    """Each limit, and whether the stop keeps it; what did not take place breaks none."""
    for limit in limits:
        value = getattr(v, limit.quantity)
        yield limit, value is None or limit.least <= value <= limit.most
