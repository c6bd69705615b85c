"""The WSP controller of a train: from measured values to the valves, [S1] to [S6].

At each of its ticks it gets the train's speed and every axle's wheel speed and clamping force.
`tick` does the rest. It is pure and plain. `closed_loop` compiles it into the loop around a
simulated train. `online` feeds it sample by sample from a log, a bus or a test rig.
"""

import math
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np

from ..core import physics
from ..core.errors import UserError, unknown
from ..core.estimator import Estimator
from ..core.estimator import registry as estimators
from ..core.methods import Method, bind, validate
from ..core.model import Floats, Vehicle, Wheelset
from ..core.physics import JUDGED_FROM, NO_FORCE, G, slip_over, wheelset_of
from ..estimators.kalman import init as estimate_init
from ..estimators.kalman import step as estimate_step
from ..rail import slope
from ..rail.slope import init as slope_init
from ..rail.slope import step as slope_step
from .controller import APPLY, DUMP, Drives, Observed
from .controller import registry as controllers
from .controllers.none import init as control_init
from .controllers.none import step as control_step
from .reference_speed import (
    NO_PILOT,
    TrainEstimate,
    Witness,
    asks_pilot,
    estimate_next,
    pilots_valve,
    watched,
)

SPEED_NOISE = 0.02  # default of v − ωR, a radar's [m/s]
_WORN = 0.03  # 1 sigma of a stated wheel radius, over it [-]
_ROLLING = 10.0  # time without brake after which a wheel rolls [s]
_CALIBRATION_SPAN = 0.12  # if its speed differs from the train's by no more than this share [-]
Settings = Mapping[str, Mapping[str, float]]
Values = Floats | Sequence[float]


class ParameterSet(NamedTuple):
    """Something with parameters that is no method."""

    name: str
    Params: type[Any]


SLOPE = ParameterSet("slope", slope.Params)
# Found by benchmarks/tune.py: faster than for a log, forgetting by time only, and in slip itself,
# as in the patent. The law needs the slope at the present slip.
SLOPE_IN_LOOP = {"delta": 4.0, "rho": 2.3, "straight": 1e9, "knee": 1e3}
SLOPE_IN_LOOP |= {"guard": 1.6, "doubt": 0.575}


class Constants(NamedTuple):
    """What does not change between ticks."""

    wheelset: Wheelset  # that of axle 1
    radii: Floats  # of the wheels as stated [m], shape (axles,), or one for all
    estimator: Any  # its Params, and so on
    slope: slope.Params
    controller: Any
    speed_noise: float  # 1 sigma of v − ωR as measured [m/s]


class Wheel(NamedTuple):
    """A wheel's radius as the WSP controller knows it."""

    radius: float  # [m]
    weight: float  # ∑ω² of its measurements [rad²/s²]
    free_time: float  # time without brake and near the train's speed [s]


class ControlledAxle(NamedTuple):
    """State of one axle."""

    wheel: Wheel
    estimator: Any
    slope: slope.State
    witness: Witness
    controller: Any  # its `valve` is the command


class Chosen(NamedTuple):
    """A WSP controller: its methods and constants."""

    estimator: Estimator
    controller: Method
    constants: Constants

    def stand_ins(self) -> dict[Any, Any]:
        """Its methods' functions, by the names in `start` and `tick` that they replace."""
        est, law = self.estimator, self.controller
        estimates = {estimate_init: est.init, estimate_step: est.step}
        return {**estimates, control_init: law.init, control_step: law.step}


# --- one tick: plain Python that compiles ---------------------------------------------------------


def initial_wheels(c: Constants, axles: int) -> list[Wheel]:
    """The wheels of that many axles at power-on, assumed to roll.

    A stated radius has the weight of measurements with the same error.
    """
    wheels = []
    for i in range(axles):
        radius = c.radii[i if len(c.radii) > 1 else 0]
        wheels.append(Wheel(radius, (c.speed_noise / (_WORN * radius)) ** 2, math.inf))
    return wheels


def calibrated(wheel: Wheel, h: float, train: TrainEstimate, y: float, K: float) -> Wheel:
    """A wheel one tick later: its radius by recursive least squares of v = ωR while it rolls."""
    R, error = wheel.radius, train.v - y * wheel.radius
    is_near = K <= NO_FORCE and train.doubt == 0.0 and abs(error) <= _CALIBRATION_SPAN * train.v
    free_time = wheel.free_time + h if is_near else 0.0
    if free_time < _ROLLING or train.v < JUDGED_FROM:
        return Wheel(R, wheel.weight, free_time)
    weight = wheel.weight + y * y
    return Wheel(R + y * error / weight, weight, free_time)


def slip_of(radius: float, v: float, y: float) -> float:
    """Slip [-] over a speed of at least `JUDGED_FROM`, so that it exists until v = 0 [S6]."""
    s: float = slip_over(v, y * radius, JUDGED_FROM)
    return s


def observed(  # noqa: PLR0913 (compiled: plain floats)
    w: Wheelset,
    train: TrainEstimate,
    y: float,
    K: float,
    F: float,
    slowing: float,
    k: slope.State,
    speed_noise: float,
    at_least: int,
) -> Observed:
    """The inputs of the controller. Source: [S1].

    ds/dt = −(R dω/dt + (1 − s) |dv/dt|)/v with dω/dt from (1). `y` is the wheel speed [rad/s], K
    the clamping and F the estimated adhesion force [N], `slowing` the deceleration of the train by
    these forces [m/s²], `at_least` the least valve command.
    """
    s = slip_of(w.radius, train.v, y)
    rate = w.radius**2 / w.inertia * (w.phi * K - F) - (1.0 - s) * slowing  # (1)
    if y <= 0.0 and rate > 0.0:
        rate = 0.0  # the wheel stands
    v, rim, mu = max(train.v, JUDGED_FROM), y * w.radius, F / (w.mass * G)
    noise, doubt, rate = speed_noise / v, train.doubt / v, rate / v
    return Observed(rim, s, noise, doubt, rate, mu, k.slope, k.confidence, at_least)


def on_radius(w: Wheelset, radius: float) -> Wheelset:
    """The same wheelset on wheels of another radius [m]."""
    return wheelset_of(radius, w.phi, w.inertia, w.mass)


def start(
    c: Constants, wheels: list[Wheel], v: float, y: Values, K: Values
) -> tuple[TrainEstimate, list[ControlledAxle]]:
    """The train and the state of every axle at the first tick.

    `wheels` is from `initial_wheels`, or from before an interruption; the others are as in `tick`.
    """
    k, total, fastest = slope_init(c.slope, 0.0, 0.0), 0.0, 0.0
    sets, estimates = [], []
    for i in range(len(y)):
        sets.append(on_radius(c.wheelset, wheels[i].radius))
        estimates.append(estimate_init(c.estimator, sets[i], K[i], y[i]))
        total += estimates[i].F
        fastest = max(fastest, y[i] * wheels[i].radius)
    slowing = total / (len(y) * c.wheelset.mass)  # (1)
    train = TrainEstimate(fastest if v != v else v, 0.0, NO_PILOT)
    axles = []
    for i in range(len(y)):
        F, wheel = estimates[i].F, calibrated(wheels[i], 0.0, train, y[i], K[i])
        o = observed(sets[i], train, y[i], K[i], F, slowing, k, c.speed_noise, APPLY)
        law = control_init(c.controller, o)
        axles.append(ControlledAxle(wheel, estimates[i], k, Witness(0.0, 0.0), law))
    return train, axles


def tick(  # noqa: PLR0913 (compiled: state, interval and measured values)
    c: Constants,
    train: TrainEstimate,
    previous: list[ControlledAxle],
    h: float,
    v: float,
    y: Values,
    K: Values,
) -> tuple[TrainEstimate, list[ControlledAxle]]:
    """The train and the state of every axle one tick later.

    `h` is the interval since then [s]. `v` is the train speed [m/s], NaN where it is not measured,
    `y` the wheel speeds [rad/s], K the clamping forces [N], shape (axles,).
    """
    total, fastest, rolls = 0.0, 0.0, False
    sets, estimates = [], []
    for i in range(len(y)):
        sets.append(on_radius(c.wheelset, previous[i].wheel.radius))
        estimates.append(estimate_step(c.estimator, sets[i], previous[i].estimator, h, K[i], y[i]))
        total += estimates[i].F
        fastest = max(fastest, y[i] * sets[i].radius)
        rolls = rolls or previous[i].witness.recent_force == 0.0
    slowing = total / (len(y) * c.wheelset.mass)  # (1)
    if v != v:
        train = estimate_next(train, rolls, fastest, slowing, h)
    else:
        train = TrainEstimate(v, 0.0, NO_PILOT)
    witnesses, pilot = [], 0
    for i in range(len(y)):
        w, F, witness = sets[i], estimates[i].F, previous[i].witness
        rim = y[i] * w.radius
        x = watched(w, witness, train.v, slowing, rim, K[i], F, previous[i].controller.valve, h)
        if train.doubt > 0.0 and x.recent_force == 0.0:
            train = TrainEstimate(fastest, 0.0, NO_PILOT)  # a wheel shows the train's speed again
        witnesses.append(x)
        if rim > y[pilot] * sets[pilot].radius:
            pilot = i
    if asks_pilot(train):
        train = TrainEstimate(train.v, train.doubt, pilot)
    axles, noise = [], c.speed_noise / max(train.v, JUDGED_FROM)
    for i in range(len(y)):
        w, F, x = sets[i], estimates[i].F, witnesses[i]
        s, mu = slip_of(w.radius, train.v, y[i]), F / (w.mass * G)  # [S1]
        k = slope_step(c.slope, previous[i].slope, h, s, mu, noise, 0.0)  # [S2] [S3]
        pilot_valve = pilots_valve(w, x, K[i]) if i == train.pilot else APPLY
        o = observed(w, train, y[i], K[i], F, slowing, k, c.speed_noise, pilot_valve)
        law = control_step(c.controller, previous[i].controller, h, o)  # [S4] [S5]
        wheel = calibrated(previous[i].wheel, h, train, y[i], K[i])
        axles.append(ControlledAxle(wheel, estimates[i], k, x, law))
    return train, axles


# --- around it ------------------------------------------------------------------------------------


def choose(
    law: str, algo: str, settings: Settings, vehicle: Vehicle, speed_noise: float = SPEED_NOISE
) -> Chosen:
    """A WSP controller.

    `settings` are parameters by name of controller, of estimator, and of "slope". `speed_noise` is
    1 sigma of v − ωR as measured [m/s].

    Raises:
        UserError: an unknown name, a parameter unknown or out of range, a band without width.
    """
    estimator_names, laws = estimators(), controllers()
    all_names = [*laws, *estimator_names, SLOPE.name]
    named = [("controller", law, list(laws)), ("estimator", algo, list(estimator_names))]
    for kind, name, among in [*named, *(("setting", x, all_names) for x in settings)]:
        if name not in among:
            raise unknown(kind, name, among)
    bands(settings)
    est, chosen = estimator_names[algo], laws[law]
    settings = {**settings, SLOPE.name: {**SLOPE_IN_LOOP, **settings.get(SLOPE.name, {})}}
    ep, sp, cp = (validate(x, settings.get(x.name, {})) for x in (est, SLOPE, chosen))
    radii = np.array([x.value for x in vehicle.wheel_radius])
    w = physics.wheelset(vehicle, 1)
    return Chosen(est, chosen, Constants(w, radii, ep, sp, cp, speed_noise))


def online(
    unit: Chosen,
    samples: Iterable[tuple[int, float | None, Sequence[float], Sequence[float]]],
    drives: Sequence[Drives] = (),
) -> Generator[list[int]]:
    """The valves of every axle after each sample, as the samples arrive; needs no compiler.

    A sample is (time [ns], train speed [m/s] or None, wheel speed [rad/s] of every axle, K [N] of
    every axle), with rising time. It gives `controller.APPLY`, `HOLD` or `DUMP` of every axle,
    which `drives` get, too.

    After a sample with a value that is no number, both valves of every axle are at rest. The next
    sample starts anew, with the known wheel radii. The valves are also at rest when the samples end
    or fail, and when the iterator is closed. A feed that stops without an end needs a watchdog
    behind `drives`.

    Raises:
        UserError: a sample with another number of axles, or not after the one before.
    """
    start_step, tick_step = (bind(f, unit.stand_ins()) for f in (start, tick))
    c = unit.constants
    train, wheels = TrainEstimate(math.nan, 0.0, NO_PILOT), list[Wheel]()
    axles = list[ControlledAxle]()
    previous: float = -math.inf
    with ExitStack() as stack:
        for drive in drives:
            stack.callback(drive.set, False, False)
        for t, measured, y, K in samples:
            h, previous = (t - previous) * 1e-9, t
            n = len(axles or drives or y)
            if not len(y) == len(K) == n > 0 or len(c.radii) not in (1, n):
                text = f"at {t} ns: {len(y)} wheel speeds, {len(K)} clamping forces, "
                text += f"{len(c.radii)} wheel radii for {n} axles"
                raise UserError(text, "one of each for every axle in every sample")
            if h <= 0.0:
                text = f"at {t} ns: not after the sample before"
                raise UserError(text, "samples in order of time")
            wheels = [axle.wheel for axle in axles] or wheels or initial_wheels(c, n)
            v = math.nan if measured is None else measured
            if all(map(math.isfinite, (*y, *K))) and (measured is None or math.isfinite(v)):
                if axles:
                    train, axles = tick_step(c, train, axles, h, v, y, K)
                else:
                    train, axles = start_step(c, wheels, v, y, K)
                valves = [axle.controller.valve for axle in axles]
            else:
                wheels = [wheel._replace(free_time=0.0) for wheel in wheels]
                axles, valves = [], [APPLY] * n
            for drive, valve in zip(drives, valves, strict=bool(drives)):
                drive.set(valve != APPLY, valve == DUMP)
            yield valves


def parameters(laws: Iterable[str], algo: str, settings: Settings) -> dict[str, dict[str, float]]:
    """Every parameter in use with these controllers, by the names of `Settings`.

    Raises:
        UserError: as `choose`.
    """
    tables: dict[str, dict[str, float]] = {}
    for law in laws:
        c = choose(law, algo, settings, Vehicle()).constants
        chosen = {algo: c.estimator, SLOPE.name: c.slope, law: c.controller}
        tables |= {name: p._asdict() for name, p in chosen.items()}
    return tables


def bands(settings: Settings) -> slope.Bands:
    """The patent's bands under these settings; they define the regions for every controller.

    Raises:
        UserError: a band without width.
    """
    p = validate(controllers()["patent"], settings.get("patent", {}))
    limits = slope.Bands(p.slip_low, p.slip_high, p.slope_low, p.slope_high)
    return slope.check_bands(limits, "patent")
