"""The likeliest parameters of the longitudinal model, by least squares with a prior."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..core.model import Floats, Parameter
from ..core.physics import G
from ..core.signals import running_integral
from . import longitudinal
from .explanation import Design
from .longitudinal import DELAY, DRAG, FADE, OFFSET, RESISTANCE, SCALE, SHARED, STIFFNESS, Prior
from .pieces import mean_square, repeat_by_piece, sum_by_piece, without_bend

_LARGEST_OFFSET = 0.9  # the largest offset looked for, of the highest K
_LARGEST_FACTOR = 30.0  # and the largest factor
_STEP_SHARES = 1.0, 0.5, 0.2, 0.05  # of a step that are tried
_CONVERGED = 0.05  # a smaller gain of a step ends the search
_SINGULAR = 1e-9  # a smaller share left by the other parameters is rounding


class Posterior(NamedTuple):
    """What designs and prior say together of the shared parameters, in the order of `UNITS`."""

    prior: Floats  # means (7,)
    prior_sigma: Floats  # (7,), inf where free
    mean: Floats  # of the shared parameters, then of every piece's gradient [m/s²]
    covariance: Floats  # of the same
    cost: float  # −2 log of posterior density, but for a constant

    def sigma(self, i: int) -> float:
        """1 sigma of one of them."""
        return math.sqrt(max(float(self.covariance[i, i]), 0.0))

    @property
    def delay(self) -> Parameter:
        """Of the pressure [s]."""
        return Parameter(float(self.mean[DELAY]), self.sigma(DELAY))


def _braking_share(d: Design, x: Floats) -> Floats:
    """k, (n,)."""
    K = np.maximum(np.interp(d.t + float(x[DELAY]), d.t, d.K) - x[OFFSET], 0.0)
    k: Floats = K * (1.0 + x[FADE] * d.relative_speed)
    return k


def speed_loss(d: Design, x: Floats) -> Floats:
    """What the brake takes from the speed, but for the factor s; (m,) [m/s]."""
    k = _braking_share(d, x)
    creep = d.creeps * d.speed * k[d.samples] / (G * math.exp(x[STIFFNESS]))
    loss: Floats = d.c * (running_integral(d.t, k)[d.samples] + creep)
    return loss


def unbent_loss(d: Design, x: Floats) -> Floats:
    """`speed_loss` without α and γ of each piece, (m,) [m/s]."""
    return without_bend(d, speed_loss(d, x))


def residual(d: Design, x: Floats, gradients: Floats, loss: Floats | None = None) -> Floats:
    """What the model leaves of the speed, (m,) [m/s]; `loss` is `unbent_loss`, where known."""
    loss = unbent_loss(d, x) if loss is None else loss
    slope = repeat_by_piece(d, gradients - x[RESISTANCE])
    remainder: Floats = d.v + math.exp(x[SCALE]) * loss - slope * d.time
    remainder += x[DRAG] * d.squared
    return remainder + _motor_creep(d, x)


def _motor_creep(d: Design, x: Floats) -> Floats | float:
    """How much slower than the train a wheel turns by the motors' force, (m,) [m/s]."""
    if not d.creeps or not d.by_motors.any():
        return 0.0
    by_motors = d.by_motors[d.samples]
    return without_bend(d, d.speed * by_motors / (G * math.exp(x[STIFFNESS])))


def _columns(d: Design, x: Floats, loss: Floats) -> Floats:
    """How what is left changes with each shared parameter, (7, m)."""
    s = math.exp(x[SCALE])
    J = np.empty((SHARED, len(d.samples)))
    J[SCALE] = s * loss
    creep = d.creeps * d.c * d.speed * _braking_share(d, x)[d.samples]
    J[STIFFNESS] = -s * without_bend(d, creep / (G * math.exp(x[STIFFNESS]))) - _motor_creep(d, x)
    for i, step in ((OFFSET, 0.005), (FADE, 0.001), (DELAY, 0.01)):
        upper, lower = x.copy(), x.copy()
        upper[i] += step
        lower[i] -= step
        J[i] = s * (unbent_loss(d, upper) - unbent_loss(d, lower)) / (2.0 * step)
    J[RESISTANCE], J[DRAG] = d.time, d.squared
    return J


def gradients(designs: Sequence[Design], x: Floats) -> list[Floats]:
    """The gradients of each design, of a posterior's mean [m/s²]."""
    edges = np.cumsum([SHARED, *(len(d.size) for d in designs)])
    return [x[i:j] for i, j in pairwise(edges)]


class _Problem(NamedTuple):
    """Designs with weights, and the prior of all unknowns."""

    designs: Sequence[Design]
    sample_counts: Sequence[Floats]  # independent samples of each piece
    mean: Floats  # of shared parameters, then of gradients
    information: Floats  # inverse of its covariance

    def parts(self, x: Floats) -> Iterator[tuple[Design, Floats, Floats]]:
        """Each design, its independent samples and its gradients."""
        return zip(self.designs, self.sample_counts, gradients(self.designs, x), strict=True)


def _problem(designs: Sequence[Design], sample_counts: Sequence[Floats], prior: Prior) -> _Problem:
    total = SHARED + sum(len(d.size) for d in designs)
    mean, information = np.zeros(total), np.zeros((total, total))
    for i, p in prior.items():
        mean[i], information[i, i] = p.value, p.tolerance**-2.0
    start = SHARED
    for d in designs:
        rows = slice(start, start + len(d.size))
        information[rows, rows] = np.linalg.inv(d.gradient_covariance)
        start = rows.stop
    return _Problem(designs, sample_counts, mean, information)


def _cost(p: _Problem, x: Floats, losses: Sequence[Floats | None]) -> float:
    """−2 log of the posterior, every piece's own variance taken as is likeliest.

    `losses` are the `unbent_loss` of each design, where known.
    """
    deviation = x - p.mean
    cost = float(deviation @ p.information @ deviation)
    for (d, sample_count, slopes), loss in zip(p.parts(x), losses, strict=True):
        squares = mean_square(d, residual(d, x, slopes, loss)) + d.floor**2
        cost += float(sample_count @ np.log(squares))
    return cost


def _normal(p: _Problem, x: Floats) -> tuple[Floats, Floats]:
    """Normal equations at a point: matrix and right side."""
    A, b = p.information.copy(), p.information @ (x - p.mean)
    start = SHARED
    for d, sample_count, slopes in p.parts(x):
        loss = unbent_loss(d, x)
        remainder, J = residual(d, x, slopes, loss), _columns(d, x, loss)
        weights = sample_count / (sum_by_piece(d, remainder**2) + d.size * d.floor**2)
        JW = J * repeat_by_piece(d, weights)
        A[:SHARED, :SHARED] += JW @ J.T
        b[:SHARED] += JW @ remainder
        rows = slice(start, start + len(d.size))
        cross = -sum_by_piece(d, JW * d.time)
        A[:SHARED, rows] += cross
        A[rows, :SHARED] += cross.T
        A[rows, rows] += np.diag(weights * sum_by_piece(d, d.time**2))
        b[rows] -= weights * sum_by_piece(d, d.time * remainder)
        start = rows.stop
    return A, b


class Likeliest(NamedTuple):
    """The maximum of a posterior."""

    problem: _Problem
    prior: Prior
    mean: Floats  # of the shared parameters, then of every piece's gradient [m/s²]
    cost: float  # as of `Posterior`

    def posterior(self) -> Posterior:
        """The same with its covariance."""
        covariance = invert_normal(_normal(self.problem, self.mean)[0])
        sigmas = np.array([self.prior[i].tolerance for i in range(SHARED)])
        prior_mean = self.problem.mean[:SHARED]
        return Posterior(prior_mean, sigmas, self.mean, covariance, self.cost)


def search(
    designs: Sequence[Design], counts: Sequence[Floats], prior: Prior, starts: Sequence[Floats]
) -> Likeliest:
    """The likeliest point, by Gauss and Newton with shortened steps from the best start.

    `counts` are from `independent_samples`. An infinite tolerance of the prior frees a
    parameter. A start is shared parameters, or these and the gradients.
    """
    p = _problem(designs, counts, prior)
    points, costs = zip(*(_start(p, x) for x in starts), strict=True)
    best, cost = points[int(np.argmin(costs))], min(costs)
    limits = np.full(len(best), 2.0)
    reach = min(longitudinal.LARGEST_DELAY, *(float(d.t[-1]) / 4.0 for d in designs))
    limits[:SHARED] = math.log(_LARGEST_FACTOR), _LARGEST_OFFSET, reach, 12.0, 0.05, 0.5, 5e-4
    for _ in range(15):
        A, b = _normal(p, best)
        d = _sizes(A)  # the units differ by powers of ten
        C = A / np.outer(d, d) + _SINGULAR * np.eye(len(d))
        change = np.linalg.solve(C, b / d) / d
        trials = [np.clip(best - share * change, -limits, limits) for share in _STEP_SHARES]
        costs = tuple(_cost(p, x, [None] * len(designs)) for x in trials)
        gained = cost - min(costs)
        if gained > 0.0:
            best, cost = trials[int(np.argmin(costs))], min(costs)
        if gained < _CONVERGED:
            break
    return Likeliest(p, prior, best, cost)


def joint(designs: Sequence[Design], prior: Prior) -> Posterior:
    """The posterior of joined designs, each with as many samples as are independent."""
    start = np.array([prior[i].value for i in range(SHARED)])
    coarse_mean = search(designs, [d.size for d in designs], prior, [start]).mean
    sample_counts = [
        independent_samples(d, residual(d, coarse_mean, slopes))
        for d, slopes in zip(designs, gradients(designs, coarse_mean), strict=True)
    ]
    return search(designs, sample_counts, prior, [coarse_mean]).posterior()


def _start(p: _Problem, x: Floats) -> tuple[Floats, float]:
    """A point and its cost; gradients that it lacks are of least squares."""
    losses = [unbent_loss(d, x) for d in p.designs]
    if len(x) < len(p.mean):
        blocks = [x[:SHARED]]
        for d, loss in zip(p.designs, losses, strict=True):
            remainder = residual(d, x, np.zeros(len(d.size)), loss)
            slopes = sum_by_piece(d, remainder * d.time) / sum_by_piece(d, d.time**2)
            blocks.append(np.clip(slopes, -0.5, 0.5))
        x = np.concatenate(blocks)
    return x, _cost(p, x, losses)


def _sizes(A: Floats) -> Floats:
    """Divisors of rows and columns that make normal equations of like size; 1 for an empty row."""
    d = np.sqrt(np.maximum(np.diag(A), 0.0))
    return np.where(d > 0.0, d, 1.0)


def invert_normal(A: Floats) -> Floats:
    """Inverse of normal equations, by rows of like size; infinite where nothing determines one."""
    d, empty = _sizes(A), np.diag(A) <= 0.0
    C = A / np.outer(d, d)
    values, vectors = np.linalg.eigh(C)
    regular = values > _SINGULAR
    inverse: Floats = (vectors[:, regular] / values[regular]) @ vectors[:, regular].T
    inverse /= np.outer(d, d)
    singular = (vectors[:, ~regular] ** 2).sum(axis=1) > _SINGULAR
    inverse[singular | empty, singular | empty] = np.inf
    return inverse


def independent_samples(d: Design, residuals: Floats) -> Floats:
    """Independent samples of each piece (p,), by how neighbours correlate in what is left (m,)."""
    pair = np.append(residuals[1:] * residuals[:-1], 0.0)
    pair[d.piece_start[1:] - 1] = 0.0
    # Rounding is alike.
    correlation = sum_by_piece(d, pair) / (
        sum_by_piece(d, residuals**2) + d.size * longitudinal.FLOOR**2
    )
    correlation = np.clip(correlation, 0.0, 0.99)
    return d.size * (1.0 - correlation) / (1.0 + correlation)
