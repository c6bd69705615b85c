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
from typing import Any, NamedTuple

import numpy as np

from ..core.model import Z95, AxleRecord, Floats, Parameter, Vehicle
from ..core.physics import RELEASED_SHARE, force_line, wheelset
from ..diagnostics.scene import Scene
from ..train import longitudinal as model
from ..train import pieces, solve
from ..train.explanation import Design
from ..train.grid import FEWEST
from . import force

_CHAIN = ("discs", "efficiency", "lever_ratio", "radius_ratio")
# 1 sigma from log to log, assumed: of the friction by heat and wear, of the pressure's zero.
LOG_TO_LOG = {model.SCALE: 0.02, model.OFFSET: 0.005}
_SOURCES = {
    "force_over_mass": "stated tolerances",
    "friction": "stated tolerances of φ, n, η, i, d",
    "axle_mass": "stated tolerance",
    "spring_force": "stated tolerance; zero of a sensor: 1 % of the highest force",
    "friction_fade": "pads change by some 10 % over 25 m/s",
    "pressure_delay": "calipers, hoses, transducers: 0.03 s; sampling",
    "creep_stiffness": "20 to 100 % of Kalker's, per unit of slip",
    "running_resistance": "0.015 m/s² of a train that coasts",
    "air_drag": "1e-5 1/m of long trains to 7e-5 1/m of single vehicles",
}


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

    def applications(self) -> list[tuple[tuple[float, float], Any]]:
        """Each brake application with its samples in the design, where they are enough."""
        if self.design is None:
            return []
        t = self.design.t[self.design.samples]
        pairs = [(span, np.flatnonzero((t >= span[0]) & (t <= span[1]))) for span in self.spans]
        return [(span, indices) for span, indices in pairs if len(indices) >= FEWEST]


class Calibrated(NamedTuple):
    """A vehicle as its logs show it."""

    vehicle: Vehicle
    rows: dict[str, CalibratedParameter]
    correlation: Floats  # of the posterior, in the order of the rows
    force: tuple[float, float]  # of an axle at the mean brake of all logs, as stated, after [N]
    band: tuple[float, float]  # half-width of its 95 % band, the same [N]


def evidence(
    scene: Scene | None, record: AxleRecord, applications: Sequence[slice], vehicle: Vehicle
) -> Evidence:
    """What a log says.

    Args:
        scene: all its axles; None where it has none in common.
        record: of its first axle.
        applications: of that record.
        vehicle: as stated.
    """
    if scene is None:
        return Evidence(None, (), 0.0)
    seconds = (record.t - scene.grid.start_ns) * 1e-9
    spans = tuple((float(seconds[s.start]), float(seconds[s.stop - 1])) for s in applications)
    explanation = scene.explanation
    return Evidence(
        pieces.along_track(explanation.design) if explanation.design else None,
        spans,
        explanation.pressure_delay.value,
    )


def band_shares(
    scene: Scene | None, record: AxleRecord, applications: Sequence[slice], vehicle: Vehicle
) -> tuple[float, float] | None:
    """Half-width of the force's 95 % band over the force, as stated and calibrated by one log.

    None where its brake applications do not determine the vehicle. Arguments as of `evidence`.
    """
    if len(applications) < 2 or min(vehicle.friction.tolerance, vehicle.axle_mass.tolerance) <= 0.0:
        return None
    log_evidence = evidence(scene, record, applications, vehicle)
    if log_evidence.design is None or len(log_evidence.applications()) < 2:
        return None
    designs = pieces.join_designs([log_evidence.design], vehicle)
    log_prior = prior(designs, vehicle, log_evidence.delay)
    calibration = calibrate_vehicle(
        vehicle, record, designs, log_prior, solve.joint(designs, log_prior)
    )
    return calibration.band[0] / calibration.force[0], calibration.band[1] / calibration.force[1]


def calibrate_vehicle(
    vehicle: Vehicle,
    record: AxleRecord,
    designs: Sequence[Design],
    prior: dict[int, Parameter],
    posterior: solve.Posterior,
) -> Calibrated:
    """The vehicle of a posterior, which the next log's error from log to log widens.

    Args:
        vehicle: as stated.
        record: any of the logs.
        designs: of the logs, from `longitudinal.join_designs`.
        prior: of the shared parameters, from `prior`.
        posterior: their posterior.
    """
    covariance = posterior.covariance.copy()
    for i, sigma in LOG_TO_LOG.items():  # the next log differs, and each of these did
        covariance[i, i] += sigma**2 * (1.0 + 1.0 / len(designs))
    posterior, radius = posterior._replace(covariance=covariance), any(d.creeps for d in designs)
    calibrated, rows, correlation = _vehicle(vehicle, designs[0], prior, posterior, radius)
    common = force_gradient(designs), record, designs[0]
    newtons, band = zip(*(_band(v, vehicle, *common) for v in (vehicle, calibrated)), strict=True)
    return Calibrated(calibrated, rows, correlation, newtons, band)


def _shares(vehicle: Vehicle, radius: bool) -> dict[str, float]:
    """By how much each tolerance moves ln s: C is what has no other name; M is `axle_mass`."""
    v = vehicle
    names = ("friction", *_CHAIN, "axle_mass", "wheelset_inertia", "cylinder_diameter")
    shares = {name: getattr(v, name).tolerance / getattr(v, name).value for name in names}
    R, w = v.radius(1), wheelset(v, 1).rolling
    factors = {"axle_mass": -w, "wheelset_inertia": w - 1.0, "cylinder_diameter": 2.0}
    radius_factor = 2.0 * (1.0 - w) - radius  # a rim speed is ω times the radius that is stated
    return {n: factors.get(n, 1.0) * x for n, x in shares.items()} | {
        "wheel_radius": radius_factor * R.tolerance / R.value
    }


def prior(designs: Sequence[Design], vehicle: Vehicle, delay: float) -> dict[int, Parameter]:
    """Stated tolerances and published ranges; a delay that the checks found widens its prior."""
    shares = _shares(vehicle, any(d.creeps for d in designs))
    priors = model.stated_prior(designs[0], vehicle)
    priors[model.SCALE] = Parameter(0.0, math.sqrt(float(vehicle.covariance(shares, shares))))
    interval = max(d.interval for d in designs)
    usual = model.stated_prior(designs[0]._replace(interval=interval), vehicle)[
        model.DELAY
    ].tolerance
    priors[model.DELAY] = Parameter(0.0, max(usual, delay))
    return priors


def force_gradient(designs: Sequence[Design]) -> Floats:
    """How ln of the force at the mean brake changes with each shared parameter, (7,)."""
    braked = [np.maximum(d.K[d.samples], 0.0) > RELEASED_SHARE for d in designs]
    K = np.concatenate([d.K[d.samples][x] for d, x in zip(designs, braked, strict=True)])
    faster = np.concatenate(
        [d.relative_speed[d.samples][x] for d, x in zip(designs, braked, strict=True)]
    )
    gradient = np.zeros(len(model.UNITS))
    if len(K):
        gradient[[model.SCALE, model.OFFSET, model.FADE]] = 1.0, -1.0 / K.mean(), faster.mean()
    return gradient


def _vehicle(
    v: Vehicle, d: Design, prior: dict[int, Parameter], posterior: solve.Posterior, radius: bool
) -> tuple[Vehicle, dict[str, CalibratedParameter], Floats]:
    """The calibrated vehicle, the table, and the correlation of its rows.

    Args:
        v: as stated.
        d: any design of the fit.
        prior: of the shared parameters.
        posterior: the posterior of these.
        radius: whether wheel speeds were used.
    """
    n, shares = len(model.UNITS), _shares(v, radius)
    mass = {"axle_mass": v.axle_mass.tolerance / v.axle_mass.value}
    apart = ("axle_mass", "wheelset_inertia", "wheel_radius")
    chain = {name: x for name, x in shares.items() if name not in apart}
    S, scale_variance = posterior.mean[model.SCALE], prior[model.SCALE].tolerance ** 2
    stated_covariance = np.array(
        [[v.covariance(a, b) for a in (chain, mass)] for b in (chain, mass)]
    )
    gain = np.array([v.covariance(chain, shares), v.covariance(mass, shares)]) / scale_variance
    # Of (shared, C, M): what the logs say of s, and what is left of C and M where s is known.
    A = np.vstack([np.eye(n), np.zeros((2, n))])
    A[n:, model.SCALE] = gain
    joint = A @ posterior.covariance[:n, :n] @ A.T
    joint[n:, n:] += stated_covariance - scale_variance * np.outer(gain, gain)
    C, M = gain * S
    piston = d.top / force_line(v).per_pascal * math.pi * v.cylinder_diameter.value**2 / 4.0
    x = posterior.mean
    speed = d.mean
    phi = v.friction.value * model.friction_share(v, speed)
    friction, m = phi * math.exp(C), v.axle_mass.value * math.exp(M)
    spring = max(v.spring_force.value + piston * float(x[model.OFFSET]), 0.0)
    kappa0, kappa = (math.exp(y) for y in (prior[model.STIFFNESS].value, x[model.STIFFNESS]))
    spring_u = piston * prior[model.OFFSET].tolerance
    kappa_u = kappa0 * prior[model.STIFFNESS].tolerance

    def unscaled(place: int, unit: str) -> tuple[int, float, float, float, float, str]:
        return place, 1.0, *prior[place], float(x[place]), unit

    # name: place in `joint`, factor to its unit, prior, 1 sigma of it, posterior
    table: dict[str, tuple[int, float, float, float, float, str]] = {
        "force_over_mass": (0, math.exp(S), 1.0, math.sqrt(scale_variance), math.exp(S), "-"),
        "friction": (n, friction, phi, phi * math.sqrt(stated_covariance[0, 0]), friction, "-"),
        "axle_mass": (n + 1, m, *v.axle_mass, m, "kg"),
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
    rows = {
        name: CalibratedParameter(
            prior_value,
            prior_u,
            posterior_value,
            factor * float(sigma[place]),
            unit,
            _SOURCES[name],
        )
        for name, (place, factor, prior_value, prior_u, posterior_value, unit) in table.items()
    }
    return _posterior_vehicle(v, rows, correlation, speed), rows, correlation


def _posterior_vehicle(
    v: Vehicle, rows: dict[str, CalibratedParameter], correlation: Floats, speed: float
) -> Vehicle:
    """The vehicle of the posterior."""
    names = ("friction", "axle_mass", "spring_force", "friction_fade")
    places = {name: i for i, name in enumerate(rows)}
    related = tuple(
        (a, b, round(float(correlation[places[a], places[b]]), 4))
        for i, a in enumerate(names)
        for b in names[i + 1 :]
    )
    determined: dict[str, Any] = {
        name: Parameter(rows[name].posterior, rows[name].posterior_u) for name in names
    }
    exact: dict[str, Any] = {
        n: Parameter(getattr(v, n).value, 0.0) for n in (*_CHAIN, "cylinder_diameter")
    }
    friction_speed = Parameter(speed, 0.0)
    return replace(v, **determined, **exact, friction_speed=friction_speed, correlation=related)


def _band(
    v: Vehicle, stated_vehicle: Vehicle, point: Floats, record: AxleRecord, d: Design
) -> tuple[float, float]:
    """Force of a rolling axle at the mean brake and the half-width of its 95 % band [N]."""
    share, faster = -1.0 / point[model.OFFSET], float(point[model.FADE])
    speed_difference, w = d.mean + faster - v.friction_speed.value, wheelset(v, record.axle)
    stated_line, line = force_line(stated_vehicle), force_line(v)
    K = share * d.top - (line.at_zero - stated_line.at_zero)
    K *= 1.0 + v.friction_fade.value * speed_difference
    F = w.phi * K * w.rolling
    dw = -w.a * w.phi * K * (1.0 - w.rolling)
    contributions = force.contributions(
        record, v, *(np.array([x]) for x in (K, dw, d.mean + faster))
    )
    return float(F), Z95 * math.sqrt(float(v.covariance(contributions, contributions)[0]))
