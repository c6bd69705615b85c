"""The likeliest parameters of the longitudinal model, by least squares with a prior."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..core.model import Floats, Parameter
from ..core.physics import G
from .explanation import Design
from .longitudinal import (
    DELAY,
    DRAG,
    FADE,
    FLOOR,
    LARGEST_DELAY,
    OFFSET,
    RESISTANCE,
    SCALE,
    SHARED,
    STIFFNESS,
)
from .pieces import integral, quadratic, repeat_by_piece, sum_by_piece, without_bend_by

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


def _delayed(d: Design, x: Floats) -> Floats:
    """K(t + τ), (n,)."""
    return np.interp(d.t + float(x[DELAY]), d.t, d.K)


def _braking_share(d: Design, x: Floats, delayed: Floats) -> Floats:
    """k, (n,)."""
    K = np.maximum(delayed - x[OFFSET], 0.0)
    k: Floats = K * (1.0 + x[FADE] * d.relative_speed)
    return k


def speed_loss(d: Design, x: Floats) -> Floats:
    """What the brake takes from the speed, but for the factor s; (m,) [m/s]."""
    return _speed_loss(d, x, _delayed(d, x))


def _speed_loss(d: Design, x: Floats, delayed: Floats) -> Floats:
    k = _braking_share(d, x, delayed)
    creep = d.creeps * d.speed * k[d.samples] / (G * math.exp(x[STIFFNESS]))
    loss: Floats = d.c * (integral(d, k)[d.samples] + creep)
    return loss


class BrakeDeceleration:
    """What the brake takes from the speed in one design, at the points of a search.

    A search asks for the same point more than once, and most points share their delay. So the
    latest results are kept.

    Args:
        d: the design.
        capacity: points that are kept.
    """

    def __init__(self, d: Design, capacity: int = len(_STEP_SHARES)) -> None:
        self.d = d
        self._capacity = capacity
        self._bend = quadratic(d)
        self._cache: dict[tuple[float, ...], Floats] = {}
        self._delayed = math.nan, d.K  # a delay and K(t + τ)

    def speed_loss(self, x: Floats) -> Floats:
        """`speed_loss` without α and γ of each piece, (m,) [m/s]."""
        point = tuple(x[[OFFSET, DELAY, STIFFNESS, FADE]].tolist())
        if point not in self._cache:
            if len(self._cache) == self._capacity:
                del self._cache[next(iter(self._cache))]
            self._cache[point] = self._speed_loss(x)
        return self._cache[point]

    def residual(self, x: Floats, gradients: Floats) -> Floats:
        """What the model leaves of the speed, (m,) [m/s]."""
        d, slope = self.d, repeat_by_piece(self.d, gradients - x[RESISTANCE])
        remainder: Floats = d.v + math.exp(x[SCALE]) * self.speed_loss(x) - slope * d.time
        remainder += x[DRAG] * d.squared
        return remainder

    def columns(self, x: Floats) -> Floats:
        """How what is left changes with each shared parameter, (7, m)."""
        d, s = self.d, math.exp(x[SCALE])
        J = np.empty((SHARED, len(d.samples)))
        J[SCALE] = s * self.speed_loss(x)
        k = _braking_share(d, x, self._delayed_force(x))[d.samples]
        creep = d.creeps * d.c * d.speed * k / (G * math.exp(x[STIFFNESS]))
        J[STIFFNESS] = -s * without_bend_by(d, creep, self._bend)
        for i, step in ((OFFSET, 0.005), (FADE, 0.001), (DELAY, 0.01)):
            upper, lower = x.copy(), x.copy()
            upper[i] += step
            lower[i] -= step
            J[i] = s * (self._speed_loss(upper) - self._speed_loss(lower)) / (2.0 * step)
        J[RESISTANCE], J[DRAG] = d.time, d.squared
        return J

    def _speed_loss(self, x: Floats) -> Floats:
        return without_bend_by(self.d, _speed_loss(self.d, x, self._delayed_force(x)), self._bend)

    def _delayed_force(self, x: Floats) -> Floats:
        if self._delayed[0] != x[DELAY]:
            self._delayed = x[DELAY], _delayed(self.d, x)
        return self._delayed[1]


def residual(d: Design, x: Floats, gradients: Floats) -> Floats:
    """What the model leaves of the speed, (m,) [m/s]."""
    return BrakeDeceleration(d).residual(x, gradients)


def gradients(designs: Sequence[Design], x: Floats) -> list[Floats]:
    """The gradients of each design, of a posterior's mean [m/s²]."""
    edges = np.cumsum([SHARED, *(len(d.size) for d in designs)])
    return [x[i:j] for i, j in pairwise(edges)]


class _Problem(NamedTuple):
    """Designs with weights, and the prior of all unknowns."""

    brakes: Sequence[BrakeDeceleration]  # of each design
    sample_counts: Sequence[Floats]  # independent samples of each piece
    mean: Floats  # of shared parameters, then of gradients
    information: Floats  # inverse of its covariance

    def gradients(self, x: Floats) -> list[Floats]:
        """The gradients of each design."""
        return gradients([b.d for b in self.brakes], x)


def _problem(
    brakes: Sequence[BrakeDeceleration],
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
) -> _Problem:
    total = SHARED + sum(len(b.d.size) for b in brakes)
    mean, information = np.zeros(total), np.zeros((total, total))
    for i, p in prior.items():
        mean[i], information[i, i] = p.value, p.tolerance**-2.0
    start = SHARED
    for brake in brakes:
        rows = slice(start, start + len(brake.d.size))
        information[rows, rows] = np.linalg.inv(brake.d.gradient_covariance)
        start = rows.stop
    return _Problem(brakes, sample_counts, mean, information)


def _cost(p: _Problem, x: Floats) -> float:
    """−2 log of the posterior, every piece's own variance taken as is likeliest."""
    deviation = x - p.mean
    cost = float(deviation @ p.information @ deviation)
    for brake, sample_count, gradients in zip(
        p.brakes, p.sample_counts, p.gradients(x), strict=True
    ):
        d = brake.d
        squares = sum_by_piece(d, brake.residual(x, gradients) ** 2) / d.size + d.floor**2
        cost += float(sample_count @ np.log(squares))
    return cost


def _normal(p: _Problem, x: Floats) -> tuple[Floats, Floats]:
    """Normal equations at a point: matrix and right side."""
    A, b = p.information.copy(), p.information @ (x - p.mean)
    start = SHARED
    for brake, sample_count, gradients in zip(
        p.brakes, p.sample_counts, p.gradients(x), strict=True
    ):
        d, residual = brake.d, brake.residual(x, gradients)
        weights = sample_count / (sum_by_piece(d, residual**2) + d.size * d.floor**2)
        J = brake.columns(x)
        JW = J * repeat_by_piece(d, weights)
        A[:SHARED, :SHARED] += JW @ J.T
        b[:SHARED] += JW @ residual
        rows = slice(start, start + len(d.size))
        cross = -sum_by_piece(d, JW * d.time)
        A[:SHARED, rows] += cross
        A[rows, :SHARED] += cross.T
        A[rows, rows] += np.diag(weights * sum_by_piece(d, d.time**2))
        b[rows] -= weights * sum_by_piece(d, d.time * residual)
        start = rows.stop
    return A, b


def fit(
    designs: Sequence[Design],
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
) -> Posterior:
    """The posterior of the shared parameters and of every piece's gradient.

    Args:
        designs: of one log or of many.
        sample_counts: independent samples of each piece, from `independent_samples`.
        prior: of each shared parameter; an infinite tolerance frees it.
        starts: points to begin at: shared parameters, or these and the gradients.
    """
    return search([BrakeDeceleration(d) for d in designs], sample_counts, prior, starts).posterior()


class Likeliest(NamedTuple):
    """The maximum of a posterior."""

    problem: _Problem
    prior: Mapping[int, Parameter]
    mean: Floats  # of the shared parameters, then of every piece's gradient [m/s²]
    cost: float  # as of `Posterior`

    def posterior(self) -> Posterior:
        """The same with its covariance."""
        covariance = invert_normal(_normal(self.problem, self.mean)[0])
        sigmas = np.array([self.prior[i].tolerance for i in range(SHARED)])
        prior_mean = self.problem.mean[:SHARED]
        return Posterior(prior_mean, sigmas, self.mean, covariance, self.cost)


def search(
    brakes: Sequence[BrakeDeceleration],
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
) -> Likeliest:
    """The likeliest point, by Gauss and Newton with shortened steps from each of the starts."""
    p = _problem(brakes, sample_counts, prior)
    points = [_with_gradients(p, x) for x in starts]
    costs = [_cost(p, x) for x in points]
    best, cost = points[int(np.argmin(costs))], min(costs)
    limits = np.full(len(best), 2.0)
    reach = min(LARGEST_DELAY, *(float(b.d.t[-1]) / 4.0 for b in brakes))
    limits[:SHARED] = math.log(_LARGEST_FACTOR), _LARGEST_OFFSET, reach, 12.0, 0.05, 0.5, 5e-4
    for _ in range(15):
        A, b = _normal(p, best)
        d = _sizes(A)  # the units differ by powers of ten
        C = A / np.outer(d, d) + _SINGULAR * np.eye(len(d))
        change = np.linalg.solve(C, b / d) / d
        trials = [np.clip(best - share * change, -limits, limits) for share in _STEP_SHARES]
        costs = [_cost(p, x) for x in trials]
        gained = cost - min(costs)
        if gained > 0.0:
            best, cost = trials[int(np.argmin(costs))], min(costs)
        if gained < _CONVERGED:
            break
    return Likeliest(p, prior, best, cost)


def joint(designs: Sequence[Design], prior: Mapping[int, Parameter]) -> Posterior:
    """The posterior of joined designs, each with as many samples as are independent."""
    start = np.array([prior[i].value for i in range(SHARED)])
    brakes = [BrakeDeceleration(d) for d in designs]
    coarse_mean = search(brakes, [d.size for d in designs], prior, [start]).mean
    pairs = zip(brakes, gradients(designs, coarse_mean), strict=True)
    sample_counts = [
        independent_samples(brake.d, brake.residual(coarse_mean, slopes)) for brake, slopes in pairs
    ]
    return search(brakes, sample_counts, prior, [coarse_mean]).posterior()


def _with_gradients(p: _Problem, x: Floats) -> Floats:
    """A point with gradients: those of least squares, drawn towards their prior."""
    if len(x) == len(p.mean):
        return x
    blocks = [x[:SHARED]]
    for brake in p.brakes:
        d = brake.d
        residual = brake.residual(x, np.zeros(len(d.size)))
        blocks.append(
            np.clip(sum_by_piece(d, residual * d.time) / sum_by_piece(d, d.time**2), -0.5, 0.5)
        )
    return np.concatenate(blocks)


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
    inverse: Floats = (
        (vectors[:, regular] / values[regular]) @ vectors[:, regular].T / np.outer(d, d)
    )
    singular = (vectors[:, ~regular] ** 2).sum(axis=1) > _SINGULAR
    inverse[singular | empty, singular | empty] = np.inf
    return inverse


def independent_samples(d: Design, residuals: Floats) -> Floats:
    """Independent samples of each piece (p,), by how neighbours correlate in what is left (m,)."""
    pair = np.append(residuals[1:] * residuals[:-1], 0.0)
    pair[d.piece_start[1:] - 1] = 0.0
    correlation = sum_by_piece(d, pair) / (
        sum_by_piece(d, residuals**2) + d.size * FLOOR**2
    )  # rounding is alike
    correlation = np.clip(correlation, 0.0, 0.99)
    return d.size * (1.0 - correlation) / (1.0 + correlation)
