"""The vehicle that brake applications of its own logs show, and how narrow its band then is.

A train that rolls decelerates by a = s c K. A log so determines s, the force over the mass, and
never both. With the errors of what is stated, ln s = C − w M + N:

| symbol | error of the logarithm of |
|---|---|
| C | friction φ times n η i, the radius ratio and d² |
| M | axle mass m, with w = m / (m + I/R²) |
| N | inertia I and radius R |

The posterior of s then gives those of C and M by linear regression, as all errors are normal. So
the force is never known better than the mass.

C is written as the error of φ alone, and the tolerances of n, η, i, the radius ratio and d are
0. The logs know only their product, and in the force nothing but the product counts. Written apart,
each would have nearly its old tolerance, and the band would need all their correlations. The offset
of the force line is written as the return spring's. A pressure sensor's zero is part of it.

Sources: JCGM 100, 5.2; JCGM 102, 6.2; the model is that of `train.longitudinal`.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ..core.model import Z95, AxleRecord, Floats, FrictionTable, Parameter, Train, Vehicle
from ..core.physics import (
    CHAIN,
    LEAST_SHARE,
    RELEASED_SHARE,
    fade_share,
    force_line,
    piston_area,
    wheelset,
)
from ..train import longitudinal as model
from ..train import pieces, solve
from ..train.explanation import Design, Explanation
from ..train.grid import FEWEST
from ..train.mean_axle import brake_shares
from . import force

# 1 sigma from log to log, assumed: of the friction by heat and wear, of the pressure's zero.
LOG_TO_LOG = {model.SCALE: 0.02, model.OFFSET: 0.005}
_UNLIKE = 0.5  # 1 sigma of the brake force per mass of other cars that brake later, as a share
_BY_FILTER = 0.15  # 1 sigma of ln of the force by a filter, per delay [1/s]
_LONGEST_FILTER = 0.4  # a signal that is later than that is so by its clock [s]
_Values = dict[str, Any]  # of a vehicle, by their names
_SOURCES = {
    "force_over_mass": "stated tolerances",
    "friction": "stated tolerances of φ, n, η, i, d",
    "friction_scale": "stated tolerances of the friction table, n, η, i, d",
    "axle_mass": "stated tolerance",
    "wheelset_inertia": "stated tolerance",
    "spring_force": "stated tolerance; zero of a sensor: 1 % of the highest force",
    "friction_fade": "pads change by some 10 % over 90 km/h",
    "pressure_delay": "calipers, hoses, transducers: 0.03 s; sampling",
    "creep_stiffness": "20 to 100 % of Kalker's, per unit of slip",
    "running_resistance": "0.015 m/s² of a train that coasts",
    "air_drag": "1e-5 1/m of long trains to 7e-5 1/m of single vehicles",
}

# rows that scale a parameter
_PARAMETERS = {"friction_scale": "friction"}


class CalibratedParameter(NamedTuple):
    """A parameter before and after, each with its standard uncertainty."""

    prior: float
    prior_u: float
    posterior: float
    posterior_u: float
    unit: str
    source: str  # of the prior


class Evidence(NamedTuple):
    """What one log says of the vehicle."""

    design: Design | None  # None where no brake application has wheels that roll
    spans: tuple[tuple[float, float], ...]  # brake applications in the design's time [s]
    delay: float  # delay of the pressure that the checks found [s]

    def applications(self) -> int:
        """How many brake applications have enough samples in the design."""
        if self.design is None:
            return 0
        t = self.design.t[self.design.samples]
        return sum(int(((t >= a) & (t <= b)).sum()) >= FEWEST for a, b in self.spans)


class Calibrated(NamedTuple):
    """A vehicle as its logs show it."""

    vehicle: Vehicle
    rows: dict[str, CalibratedParameter]
    correlation: Floats  # of the posterior, in the order of the rows
    force: tuple[float, float]  # of an axle at the mean brake of all logs, as stated, after [N]
    band: tuple[float, float]  # half-width of its 95 % band, the same [N]


class MeanBrake(NamedTuple):
    """Where the force is given: at the mean brake of all logs."""

    top: float  # the highest K [N]
    share: float  # mean K over that
    speed: float  # ū, at which the model's friction holds [m/s]
    faster: float  # mean speed of the braked samples less ū [m/s]
    by_wheels: bool  # whether wheel speeds were used

    @property
    def gradient(self) -> Floats:
        """How ln of the force there changes with each shared parameter, (7,)."""
        gradient = np.zeros(len(model.UNITS))
        gradient[[model.SCALE, model.OFFSET, model.FADE]] = 1.0, -1.0 / self.share, self.faster
        return gradient


def evidence(
    explanation: Explanation, start_ns: int, record: AxleRecord, applications: Sequence[slice]
) -> Evidence:
    """What a log says; `start_ns` is the first time of the explanation's grid [ns]."""
    seconds = (record.t - start_ns) * 1e-9
    spans = tuple((float(seconds[s.start]), float(seconds[s.stop - 1])) for s in applications)
    design = explanation.design and pieces.along_track(explanation.design)
    return Evidence(design, spans, explanation.pressure_delay.value)


def mean_brake(designs: Sequence[Design]) -> MeanBrake:
    """The mean brake of joined designs."""
    braked = [np.maximum(d.K[d.samples], 0.0) > RELEASED_SHARE for d in designs]
    pairs = list(zip(designs, braked, strict=True))
    K = np.concatenate([d.K[d.samples][x] for d, x in pairs])
    faster = np.concatenate([d.relative_speed[d.samples][x] for d, x in pairs])
    means = (float(K.mean()), float(faster.mean())) if len(K) else (1.0, 0.0)
    by_wheels = any(d.creeps for d in designs)
    return MeanBrake(designs[0].top, means[0], designs[0].mean, means[1], by_wheels)


def calibrate_vehicle(
    vehicle: Vehicle,
    record: AxleRecord,
    brake_point: MeanBrake,
    prior: dict[int, Parameter],
    posterior: solve.Posterior,
    logs: int,
) -> Calibrated:
    """The vehicle of a posterior, which the next log's error from log to log widens.

    `record` is any of the logs', `prior` and `posterior` are of the shared parameters.
    """
    covariance = posterior.covariance.copy()
    for i, sigma in LOG_TO_LOG.items():  # the next log differs, and each of these did
        covariance[i, i] += sigma**2 * (1.0 + 1.0 / logs)
    posterior = posterior._replace(covariance=covariance)
    calibrated, rows, correlation = _vehicle(vehicle, brake_point, prior, posterior)
    bands = [_band(v, vehicle, brake_point, record) for v in (vehicle, calibrated)]
    newtons, band = zip(*bands, strict=True)
    return Calibrated(calibrated, rows, correlation, newtons, band)


def slowing_shares(vehicle: Vehicle, radius: bool) -> dict[str, float]:
    """By how much each tolerance moves ln s: C is `brake_shares`, M is `axle_mass`.

    `radius`: whether the speed is ω times the stated radius, not a measured train speed.
    """
    w = wheelset(vehicle, 1).rolling
    radius_factor = 2.0 * (1.0 - w) - radius  # a rim speed is ω times the radius that is stated
    return brake_shares(vehicle) | {
        "axle_mass": -w * vehicle.axle_mass.share,
        "wheelset_inertia": (w - 1.0) * vehicle.wheelset_inertia.share,
        "wheel_radius": radius_factor * vehicle.radius(1).share,
    }


def prior(
    designs: Sequence[Design], vehicle: Vehicle, logs: Sequence[Evidence], train: Train
) -> dict[int, Parameter]:
    """Stated tolerances and published ranges; a delay that the logs show widens its prior.

    The axles outside the log may have another brake force per mass: that moves the train's
    deceleration and no parameter of these axles.
    """
    interval, delay = max(d.interval for d in designs), max(abs(x.delay) for x in logs)
    priors = model.line_prior(vehicle, designs[0].top, designs[0].mean, interval)
    by_wheels = any(d.creeps for d in designs)
    priors[model.SCALE] = Parameter(0.0, scale_sigma(vehicle, by_wheels, train))
    priors[model.DELAY] = Parameter(0.0, max(priors[model.DELAY].tolerance, delay))
    return priors


def train_by(logs: Sequence[Evidence], train: Train) -> Train:
    """The rest of the train: where it brakes later than the axles of a log, it is not alike.

    A signal may be late by its filter. That also bends the build-up: it looks like another force.
    A longer delay is one of clocks.
    """
    delay = min(max(abs(x.delay) for x in logs), _LONGEST_FILTER)
    sigma = math.hypot(train.alike, _BY_FILTER * delay)
    if any(x.delay < -model.EARLY for x in logs):
        sigma = max(sigma, _UNLIKE)
    return train._replace(alike=sigma)


def scale_sigma(vehicle: Vehicle, by_wheels: bool, train: Train) -> float:
    """1 sigma of ln s by what is stated.

    `by_wheels`: whether the deceleration is that of the wheels.
    """
    shares = slowing_shares(vehicle, by_wheels)
    return math.hypot(math.sqrt(float(vehicle.covariance(shares, shares))), train.alike)


def _vehicle(
    v: Vehicle, brake_point: MeanBrake, prior: dict[int, Parameter], posterior: solve.Posterior
) -> tuple[Vehicle, dict[str, CalibratedParameter], Floats]:
    n, shares = len(model.UNITS), slowing_shares(v, brake_point.by_wheels)
    masses = {"axle_mass": v.axle_mass.share}, {"wheelset_inertia": v.wheelset_inertia.share}
    errors = (brake_shares(v), *masses)
    S, scale_variance = posterior.mean[model.SCALE], prior[model.SCALE].tolerance ** 2
    stated_covariance = np.array([[v.covariance(a, b) for a in errors] for b in errors])
    gain = np.array([v.covariance(error, shares) for error in errors]) / scale_variance
    # Of (shared, C, M, I): what the logs say of s, and what is left of the others where s is known.
    A = np.vstack([np.eye(n), np.zeros((len(errors), n))])
    A[n:, model.SCALE] = gain
    joint = A @ posterior.covariance[:n, :n] @ A.T
    joint[n:, n:] += stated_covariance - scale_variance * np.outer(gain, gain)
    C, M, of_inertia = gain * S
    piston = brake_point.top / force_line(v).per_pascal * piston_area(v)
    x = posterior.mean
    # With a friction table the logs scale it, and its clamping forces are in `brake_point`.
    name = "friction_scale" if v.friction_table else "friction"
    phi = v.friction.value * float(fade_share(brake_point.speed, v))
    phi = 1.0 if v.friction_table else phi
    friction, m = phi * math.exp(C), v.axle_mass.value * math.exp(M)
    I = v.wheelset_inertia.value * math.exp(of_inertia)  # noqa: E741
    spring = max(v.spring_force.value + piston * float(x[model.OFFSET]), 0.0)
    kappa0, kappa = (math.exp(y) for y in (prior[model.STIFFNESS].value, x[model.STIFFNESS]))
    spring_u = piston * prior[model.OFFSET].tolerance
    kappa_u = kappa0 * prior[model.STIFFNESS].tolerance

    def unscaled(place: int, unit: str) -> tuple[int, float, float, float, float, str]:
        return place, 1.0, *prior[place], float(x[place]), unit

    # name: place in `joint`, factor to its unit, prior, 1 sigma of it, posterior
    table: dict[str, tuple[int, float, float, float, float, str]] = {
        "force_over_mass": (0, math.exp(S), 1.0, math.sqrt(scale_variance), math.exp(S), "-"),
        name: (n, friction, phi, phi * math.sqrt(stated_covariance[0, 0]), friction, "-"),
        "axle_mass": (n + 1, m, *v.axle_mass, m, "kg"),
        "wheelset_inertia": (n + 2, I, *v.wheelset_inertia, I, "kg m²"),
        "spring_force": (model.OFFSET, piston, v.spring_force.value, spring_u, spring, "N"),
        "friction_fade": unscaled(model.FADE, "s/m"),
        "pressure_delay": unscaled(model.DELAY, "s"),
        "creep_stiffness": (model.STIFFNESS, kappa, kappa0, kappa_u, kappa, "-"),
        "running_resistance": unscaled(model.RESISTANCE, "m/s²"),
        "air_drag": unscaled(model.DRAG, "1/m"),
    }
    places = [place for place, *_ in table.values()]
    sigma = np.sqrt(np.maximum(np.diag(joint), 1e-30))
    correlation = (joint / np.outer(sigma, sigma))[np.ix_(places, places)]
    rows = {}
    for name, (place, factor, before, before_u, value, unit) in table.items():
        u = factor * float(sigma[place])
        rows[name] = CalibratedParameter(before, before_u, value, u, unit, _SOURCES[name])
    return _posterior_vehicle(v, rows, correlation, brake_point.speed), rows, correlation


def _posterior_vehicle(
    v: Vehicle, rows: dict[str, CalibratedParameter], correlation: Floats, speed: float
) -> Vehicle:
    names = ("friction", "axle_mass", "wheelset_inertia", "spring_force", "friction_fade")
    by_name = {_PARAMETERS.get(name, name): row for name, row in rows.items()}
    places = {name: i for i, name in enumerate(by_name)}
    coefficients = {(a, b): correlation[places[a], places[b]] for a, b in combinations(names, 2)}
    related = tuple((*pair, round(float(x), 4)) for pair, x in coefficients.items())
    determined: _Values = {
        name: Parameter(by_name[name].posterior, by_name[name].posterior_u) for name in names
    }
    if v.friction_table:
        determined |= _scaled_table(v, v.friction_table, determined, speed)
    exact: _Values = {n: Parameter(getattr(v, n).value, 0.0) for n in (*CHAIN, "cylinder_diameter")}
    friction_speed = Parameter(speed, 0.0)
    return replace(v, **determined, **exact, friction_speed=friction_speed, correlation=related)


def _scaled_table(v: Vehicle, table: FrictionTable, determined: _Values, speed: float) -> _Values:
    """The friction table of the posterior: scaled, and tilted by what φ changes with speed.

    `determined` is the posterior, whose friction is the scale. The tilt is 1 at `speed` [m/s].
    """
    scale, fade = determined["friction"], determined["friction_fade"]
    factor = scale.value * v.friction.value / table.reference
    tilts = (max(1.0 + fade.value * (u - speed), LEAST_SHARE) for u in table.speed)
    scaled = table.scaled(factor * tilt for tilt in tilts)
    friction = Parameter(scaled.reference, scale.share * scaled.reference)
    without_fade = Parameter(0.0, fade.tolerance)
    return {"friction": friction, "friction_table": scaled, "friction_fade": without_fade}


def _band(
    v: Vehicle, stated_vehicle: Vehicle, brake_point: MeanBrake, record: AxleRecord
) -> tuple[float, float]:
    """Force of a rolling axle at the mean brake and the half-width of its 95 % band [N]."""
    speed = brake_point.speed + brake_point.faster
    w = wheelset(v, record.axle)
    stated_line, line = force_line(stated_vehicle), force_line(v)
    K = brake_point.share * brake_point.top - (line.at_zero - stated_line.at_zero)
    K *= 1.0 + v.friction_fade.value * (speed - v.friction_speed.value)
    F = w.phi * K * w.rolling
    dw = -w.a * w.phi * K * (1.0 - w.rolling)
    clamping, rate, rim = (np.array([x]) for x in (K, dw, speed))
    contributions = force.contributions(record, v, clamping, rate, rim, None)
    return float(F), Z95 * math.sqrt(float(v.covariance(contributions, contributions)[0]))
