"""The unit of a train's wheel slide protection: from what is measured to the valves, [S1] to [S6].

At each of its ticks it has the train's speed, every axle's wheel speed and clamping force. `tick`
is all it does with them: an online estimator and the slope's least squares for each axle, what the
axle's controller is told, and the controller's answer. It is pure and plain: `antiskid` compiles it
into the loop around a simulated train, `online` feeds it sample by sample from a log, a bus or a
rig.
"""

import math
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

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
from .methods import Method, bound, validated
from .model import Floats, Vehicle, Wheelset
from .physics import G, braked, reference_speed, slip_over
from .slope import init as slope_init
from .slope import step as slope_step
from .stop import JUDGED_FROM

SPEED_NOISE = 0.02  # of v − ωR where nothing else is stated, a radar's [m/s]
Settings = Mapping[str, Mapping[str, float]]
Values = Floats | Sequence[float]


class Named(NamedTuple):
    """What has parameters and is no method."""

    name: str
    Params: type[Any]


SLOPE = Named("slope", slope.Params)
# Found by benchmarks/tune.py: quicker than what suits a log, forgetting by time alone, and in slip
# as it is: the patent's form. The law asks which way the curve bends where the wheel is now.
SLOPE_IN_LOOP = {
    "delta": 4.0, "rho": 2.3, "straight": 1e9, "knee": 1e3, "guard": 1.6, "doubt": 0.575,
}  # fmt: skip


class Constants(NamedTuple):
    """Constants of the chain; units know one wheel radius, that of axle 1."""

    wheelset: Wheelset
    estimator: Any  # its Params, and so on
    slope: slope.Params
    controller: Any
    speed_noise: float  # 1 sigma of v − ωR as measured [m/s]


class Axle(NamedTuple):
    """State of the chain of one axle."""

    estimator: Any
    slope: slope.State
    controller: Any  # its `valve` is the command


class Chosen(NamedTuple):
    """A unit: what it runs and with which constants."""

    estimator: Estimator
    controller: Method
    constants: Constants

    def stand_ins(self) -> dict[Any, Any]:
        """Its methods' functions by those that `start` and `tick` name in their place."""
        est, law = self.estimator, self.controller
        return {
            estimate_init: est.init, estimate_step: est.step,
            control_init: law.init, control_step: law.step,
        }  # fmt: skip


# --- one tick: plain Python that compiles ---------------------------------------------------------


def judged_slip(w: Wheelset, v: float, y: float) -> float:
    """Slip [-] over a speed of at least `JUDGED_FROM`: there is one until v = 0 [S6]."""
    s: float = slip_over(v, y * w.radius, JUDGED_FROM)
    return s


def observed(
    w: Wheelset, v: float, y: float, K: float, F: float, slowing: float, k: slope.State
) -> Observed:
    """What the controller is told. Source: [S1].

    ds/dt = −(R dω/dt + (1 − s) |dv/dt|)/v with dω/dt from (1).

    Args:
        w: the wheelset.
        v: train speed [m/s].
        y: wheel speed [rad/s].
        K: clamping force [N].
        F: estimated adhesion force [N].
        slowing: deceleration of the train that the estimated forces of its axles make [m/s²].
        k: slope at the operating point.
    """
    s = judged_slip(w, v, y)
    rate = w.radius**2 / w.inertia * (w.phi * K - F) - (1.0 - s) * slowing  # (1)
    if y <= 0.0 and rate > 0.0:
        rate = 0.0  # the wheel stands
    mu = F / (w.mass * G)
    return Observed(y * w.radius, s, rate / max(v, JUDGED_FROM), mu, k.slope, k.confidence)


def start(c: Constants, v: float, y: Values, K: Values) -> list[Axle]:
    """State of every axle at the first tick; arguments as of `tick`."""
    w, k, total = c.wheelset, slope_init(c.slope, 0.0, 0.0), 0.0
    estimates = []
    for i in range(len(y)):
        estimates.append(estimate_init(c.estimator, w, K[i], y[i]))
        total += estimates[i].F
    slowing = total / (len(y) * w.mass)  # (1)
    axles = []
    for i in range(len(y)):
        o = observed(w, v, y[i], K[i], estimates[i].F, slowing, k)
        axles.append(Axle(estimates[i], k, control_init(c.controller, o)))
    return axles


def tick(c: Constants, before: list[Axle], h: float, v: float, y: Values, K: Values) -> list[Axle]:
    """State of every axle one tick later.

    Args:
        c: constants.
        before: state of every axle at the tick before.
        h: interval since then [s].
        v: train speed [m/s].
        y: wheel speeds [rad/s], shape (axles,).
        K: clamping forces [N], shape (axles,).
    """
    w, total = c.wheelset, 0.0
    estimates = []
    for i in range(len(y)):
        estimates.append(estimate_step(c.estimator, w, before[i].estimator, h, K[i], y[i]))
        total += estimates[i].F
    slowing = total / (len(y) * w.mass)  # (1)
    axles, noise = [], c.speed_noise / max(v, JUDGED_FROM)
    for i in range(len(y)):
        F = estimates[i].F
        s, mu = judged_slip(w, v, y[i]), F / (w.mass * G)  # [S1]
        k = slope_step(c.slope, before[i].slope, h, s, mu, noise, 0.0)  # [S2] [S3]
        o = observed(w, v, y[i], K[i], F, slowing, k)
        axles.append(Axle(estimates[i], k, control_step(c.controller, before[i].controller, h, o)))
    return axles  # [S4] [S5]: what the controller decides


def speed_of_axles(w: Wheelset, before: float, h: float, y: Values, K: Values) -> float:
    """Train speed [m/s] for a unit that measures none: `physics.reference_speed` of its axles.

    `before` is the same at the tick before, NaN at the first; the others are as of `tick`.
    """
    fastest, braking = 0.0, 0.0
    for i in range(len(y)):
        fastest = max(fastest, y[i] * w.radius)
        braking += braked(K[i], w)
    if before != before:  # NaN
        return fastest
    return reference_speed(before, fastest, braking / len(y), h)


# --- around it ------------------------------------------------------------------------------------


def choose(
    controller: str,
    algo: str,
    settings: Settings,
    vehicle: Vehicle,
    speed_noise: float = SPEED_NOISE,
) -> Chosen:
    """A unit.

    Args:
        controller: a name in `controller.registry()`.
        algo: online estimator in the loop.
        settings: parameters by name of controller, of estimator, and of "slope".
        vehicle: that it is for.
        speed_noise: 1 sigma of v − ωR as measured [m/s].

    Raises:
        UserError: a name that is none, a parameter unknown or out of range, a band without width.
    """
    known, laws = estimators(), controllers()
    if controller not in laws:
        raise unknown("controller", controller, list(laws))
    if algo not in known:
        raise unknown("estimator", algo, list(known))
    for name in settings:
        if name not in (*laws, *known, SLOPE.name):
            raise unknown("setting", name, [*laws, *known, SLOPE.name])
    bands(settings)
    est, law = known[algo], laws[controller]
    settings = {**settings, SLOPE.name: {**SLOPE_IN_LOOP, **settings.get(SLOPE.name, {})}}
    ep, sp, cp = (validated(x, settings.get(x.name, {})) for x in (est, SLOPE, law))
    return Chosen(est, law, Constants(physics.wheelset(vehicle, 1), ep, sp, cp, speed_noise))


def online(
    unit: Chosen,
    samples: Iterable[tuple[int, float | None, Sequence[float], Sequence[float]]],
    drives: Sequence[Drives] = (),
) -> Generator[list[int]]:
    """The valves of every axle after each sample, as the samples arrive; needs no compiler.

    After a sample with a value that is no number, both valves of every axle rest, and the unit
    starts anew with the next one. They rest too when the samples end or fail, and when the iterator
    is closed; a feed that only stops to answer is for a watchdog behind `drives`.

    Args:
        unit: from `choose`.
        samples: (time [ns], train speed [m/s] or None, wheel speed [rad/s] of every axle, K [N] of
            every axle), time rising strictly.
        drives: the valves of every axle, if there are any.

    Yields:
        `controller.APPLY`, `HOLD` or `VENT` of every axle.

    Raises:
        UserError: a sample with another number of axles, or not after the one before.
    """
    first, then = (bound(f, unit.stand_ins()) for f in (start, tick))
    c = unit.constants
    axles: list[Axle] = []
    before: float = -math.inf
    v = math.nan
    with ExitStack() as rest:
        for drive in drives:
            rest.callback(drive.set, False, False)
        for t, measured, y, K in samples:
            h, before = (t - before) * 1e-9, t
            if not len(y) == len(K) == (n := len(axles or drives or y)):
                raise UserError(
                    f"at {t} ns: {len(y)} wheel speeds, {len(K)} clamping forces for {n} axles",
                    "one of each for every axle in every sample",
                )
            if h <= 0.0:
                text = f"at {t} ns: not after the sample before"
                raise UserError(text, "samples in order of time")
            if all(math.isfinite(x) for x in (*y, *K, 0.0 if measured is None else measured)):
                v = speed_of_axles(c.wheelset, v, h, y, K) if measured is None else measured
                axles = then(c, axles, h, v, y, K) if axles else first(c, v, y, K)
                valves = [axle.controller.valve for axle in axles]
            else:
                v, axles, valves = math.nan, [], [APPLY] * len(y)
            for drive, valve in zip(drives, valves, strict=bool(drives)):
                drive.set(valve != APPLY, valve == VENT)
            yield valves


def parameters(laws: Iterable[str], algo: str, settings: Settings) -> dict[str, dict[str, float]]:
    """Every parameter in force in the units with these controllers, by `Settings`' names.

    Raises:
        UserError: as `choose`.
    """
    found: dict[str, dict[str, float]] = {}
    for law in laws:
        c = choose(law, algo, settings, Vehicle()).constants
        found |= {
            algo: c.estimator._asdict(),
            SLOPE.name: c.slope._asdict(),
            law: c.controller._asdict(),
        }
    return found


def bands(settings: Settings) -> slope.Bands:
    """The patent's bands under these settings, by which every controller's region is told.

    Raises:
        UserError: a band without width.
    """
    p = validated(controllers()["patent"], settings.get("patent", {}))
    found = slope.Bands(p.slip_low, p.slip_high, p.slope_low, p.slope_high)
    return slope.checked(found, "patent")
