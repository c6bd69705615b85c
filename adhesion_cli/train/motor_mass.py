"""The mass of an axle by the forces of its motors, where a log has these and nobody states it.

A train that rolls, with the force F of the motors at the rims of an axle, positive where it brakes,
and the pressure (or clamping force) x of its friction brake, slows by

    −v̇ = r + s F / M + c max(x − x₀, 0),    M = m + I/R².

All axles must have the same motors: their sum of adhesion is then right, whatever the mass.
1/M and c are fitted by least squares over traction and braking. r is the deceleration of a train
that coasts, s the stated share of its mass that brakes, I/R² the rotating mass. The gradient of
each stretch is one error. The motors of logged axles may be more or less than those of the whole
train, which no log shows: that is the largest part of the uncertainty.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ..core.masks import erode, true_runs
from ..core.model import Bools, Parameter, Vehicle
from ..core.physics import CRAWL, NO_FORCE, RELEASED_SHARE, STANDING
from ..core.signals import robust_sigma
from ..records.axle_channels import AxleChannels
from .brake_line import ROTATING, BrakeLine, any_zero
from .grid import FEWEST, Grid
from .longitudinal import RESISTANCE_OF_TRAINS

MASS = Parameter(12e3, 5.4e3)  # of an axle not stated; the heaviest ones have 22.5 t [kg]
_LARGEST_SIGMA = 0.3  # as a share: with more, the log does not show the mass
_TRAIN_SIGMA = 0.3  # 1 sigma of the train's motors per mass over those of the logged axles
_ALIKE = 0.2  # by which the motors of axles differ: unlike axles need a known mass
_LIGHTEST, _HEAVIEST = 1.5e3, 3e4  # of an axle; a force of another kind gives another mass [kg]
_SINGULAR = 1e6  # condition of normal equations in which brake and motors are one


def find_motor_mass(
    axles: Sequence[AxleChannels],
    grid: Grid,
    vehicle: Vehicle,
    braked_share: float,
    is_inertia_stated: bool,
) -> Parameter | None:
    """The mass of an axle with 1 sigma [kg]; None where the log does not show it.

    The vehicle's φ makes the motors' part of K a force at the rim; `braked_share` is s. Unless the
    inertia is stated, it is that of any wheelset.
    """
    if grid.motors is None or grid.motor_sigma is None:
        return None
    by_pressure = all(a.brake.meaning == "pressure" for a in axles)
    brake = grid.friction_clamping
    if by_pressure:
        brake = grid.pressure - any_zero(float(np.nanmax(grid.pressure, initial=0.0))).value
    excess = np.mean(np.maximum(grid.smooth(brake), 0.0), axis=0)
    forces = braked_share * vehicle.friction.value * grid.smooth(grid.motors)
    force = np.mean(forces, axis=0)
    slowing = grid.slowing(np.mean(grid.rim, axis=0) if grid.train is None else grid.train)
    top, largest = (float(np.nanmax(np.abs(column), initial=0.0)) for column in (excess, force))
    pulls: Bools = np.abs(force) > RELEASED_SHARE * largest
    used_samples = (pulls | (excess > RELEASED_SHARE * top)) & np.all(grid.rolling, axis=0)
    used_samples &= erode(np.all(grid.rim > STANDING, axis=0), 2 * grid.half_width)
    used_samples &= (grid.fastest > CRAWL) & np.isfinite(force + excess + slowing)
    if not largest > NO_FORCE or (used_samples & pulls).sum() < FEWEST:
        return None
    pull_of_axle = np.mean(np.abs(forces[:, used_samples & pulls]), axis=1)
    if np.ptp(pull_of_axle) > _ALIKE * pull_of_axle.max():
        return None
    has_brake = excess[used_samples].any()
    columns = np.column_stack([force, excess] if has_brake else [force])[used_samples]
    columns /= (scale := np.abs(columns).max(axis=0))
    normal = columns.T @ columns
    if not np.linalg.cond(normal) < _SINGULAR:
        return None
    by_forces = slowing[used_samples] - RESISTANCE_OF_TRAINS.value
    covariance = np.linalg.inv(normal)
    shares = covariance @ (columns.T @ by_forces)
    mass = scale[0] / shares[0]  # M
    scatter = robust_sigma(by_forces - columns @ shares)
    samples_of_stretch = used_samples.sum() / len(true_runs(used_samples))
    error = math.hypot(scatter, grid.gradient_sigma) * math.sqrt(samples_of_stretch)
    error *= math.sqrt(covariance[0, 0]) / shares[0]
    resistance = RESISTANCE_OF_TRAINS.tolerance * (covariance @ columns.sum(axis=0))[0]
    motor_sigma = braked_share * np.mean(grid.motor_sigma, axis=0)[used_samples & pulls].mean()
    by_motors = motor_sigma / np.abs(force[used_samples & pulls]).mean()
    sigma = mass * math.hypot(error, resistance / shares[0], by_motors)
    if is_inertia_stated:
        inertia, radius = vehicle.wheelset_inertia, vehicle.radius(1)
        rotating = inertia.value / radius.value**2
        error = math.hypot(inertia.share, 2.0 * radius.share)
        mass, sigma = mass - rotating, math.hypot(sigma, rotating * error)
    else:
        mass /= 1.0 + ROTATING.value
        sigma = math.hypot(sigma, mass * ROTATING.tolerance) / (1.0 + ROTATING.value)
    if not (_LIGHTEST < mass < _HEAVIEST and sigma < _LARGEST_SIGMA * mass):
        return None
    return Parameter(float(mass), math.hypot(sigma, _TRAIN_SIGMA * mass))


def with_mean_mass(line: BrakeLine, lines: Iterable[BrakeLine]) -> BrakeLine:
    """The line with the mass that all lines show, and any axle may have."""
    masses = [x.mass for x in lines if x.mass]
    if not masses:
        return line
    # The motors' tolerance and the rotating mass are in all of them alike: no mean has less.
    by_motors = Parameter(_mean(masses).value, min(mass.tolerance for mass in masses))
    return line._replace(mass=_mean([by_motors, MASS]))


def _mean(parameters: Sequence[Parameter]) -> Parameter:
    weights = np.array([x.tolerance**-2.0 for x in parameters])
    mean = float(weights @ np.array([x.value for x in parameters]) / weights.sum())
    return Parameter(mean, float(weights.sum()) ** -0.5)
