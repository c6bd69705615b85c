"""Offline smoother for a level and its rate on irregular steps, with changing roughness.

The level x is measured with white noise of variance r. Its rate is a known input u plus an unknown
δ: ẋ = u + δ, δ a random walk. The roughness of δ depends on a hidden regime that switches at random
(a Markov chain in continuous time). In the calm one δ also follows another signal s, by a variance
per |Δs|, so that a ramp of s has the same effect at any sample rate. Within each regime it is the
smoother of Rauch, Tung and Striebel. After each step the mixtures are merged to one Gaussian per
regime, forwards as Kim does. Backwards, Kim weights the regime before a step by its filtered
probability alone, which can choose a regime whose state does not fit the samples after it. Barber's
correction adds that fit: regime i before j has the weight

    w_ij ∝ p_i T_ij N(x̂_j; m_ij, P_ij),

with x̂_j the smoothed mean after the step, m_ij and P_ij its prediction by i and j. The spread of
x̂_j is neglected there. The noise levels are those that make the measurements most likely.

Sources: Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445; Kim, J. Econometrics 60 (1994) 1; Barber,
J. Machine Learning Research 7 (2006) 2515.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from ..core import compiled
from ..core.innovations import ROOT_TAU, score
from ..core.model import Z95, Floats

_SAME_STEP = 1e-9  # steps that differ by a smaller share are one, rounded


class UnbrokenRun(NamedTuple):
    """Measurements without interruption; columns of shape (n,)."""

    t: Floats  # [s], rising strictly
    y: Floats  # measured level
    u: Floats  # known part of the rate
    s: Floats  # what δ may follow: see `Regimes.follow` and `Noise.coupling`
    input_variance: Floats  # of ∫u from the sample before, which u at the samples does not show
    own_variance: Floats  # variance of y's own that adds to the fitted noise
    span: Floats  # y is the mean over this time about t [s]; 0 where it is the level at t


Runs = list[UnbrokenRun]


class Regimes(NamedTuple):
    """What the regimes are; M of them, the first is the calm one."""

    follow: Floats  # (M,) share of −Δs that δ takes up: 1 where the whole rate minus s is smooth
    rates: Floats  # (M, M) rate of switching from row to column [1/s]
    start: Floats  # (M,) probability at the first sample
    spread: float  # standard deviation of δ at the first sample


class MeasurementNoise(NamedTuple):
    """Noise levels: what `fit` finds."""

    measurement: float  # r, variance of y
    coupling: float  # calm regime: variance of what δ takes up of s as s changes, per |Δs|
    rough: Floats  # (M,) variance rate of δ in each regime: [y²/s³]; of a wheel speed rad²/s⁵


class Prior(NamedTuple):
    """What `fit` knows of the noise levels beforehand, log-normal and wide.

    It decides only what the measurements do not show.
    """

    guess: MeasurementNoise  # its centre
    decades: Sequence[float]  # its 1 sigma, for measurement, coupling, each regime; 0 holds a value
    floor: float  # least variance of the measurement noise; the excess over it is fitted
    # Nats below the maximum to which coupling and the first regimes are loosened. 0.5 is one
    # standard deviation of the likelihood.
    slack: Sequence[float] = (0.5, 0.5)


class Smooth(NamedTuple):
    """The smoothed run; columns of shape (n,). A sigma is the 95 % half-width over 1.96."""

    level: Floats
    level_sigma: Floats
    rate: Floats  # u + δ
    rate_sigma: Floats


def fit(
    runs: Sequence[UnbrokenRun],
    regimes: Regimes,
    prior: Prior,
    start_noise: MeasurementNoise | None = None,
) -> tuple[MeasurementNoise, float]:
    """The most likely noise levels and their log posterior.

    The search starts at `start_noise`, levels that fit nearly the same measurements, or at the
    guess.
    """
    width, guess, floor = np.array(prior.decades) * math.log(10.0), prior.guess, prior.floor

    def logarithms(noise: MeasurementNoise) -> Floats:
        excess = max(noise.measurement - floor, 1e-3 * floor)
        return np.log(np.maximum([excess, noise.coupling, *noise.rough], 1e-300))

    centre = logarithms(guess)

    def noise(x: Floats) -> MeasurementNoise:
        e = np.exp(x)
        return MeasurementNoise(floor + float(e[0]), float(e[1]), e[2:])

    def posterior(x: Floats) -> float:
        fitted = width > 0.0
        log_prior = -0.5 * float(np.sum(((x - centre)[fitted] / width[fitted]) ** 2))
        return log_prior + sum(_forward(run, regimes, noise(x), None) for run in runs)

    value_at = cache(lambda *x: posterior(np.array(x)))  # a fifth of the points occur twice
    if start_noise is None:
        best, value = _climb(value_at, centre, width / 2.0)
    else:
        best, value = _climb(value_at, logarithms(start_noise), width / 8.0)
    return noise(_loosen(value_at, best, value, width, prior.slack)), value


def likelihood(runs: Sequence[UnbrokenRun], regimes: Regimes, noise: MeasurementNoise) -> float:
    """Logarithm of how likely the measurements are at these noise levels."""
    return sum(_forward(run, regimes, noise, None) for run in runs)


def innovations(
    run: UnbrokenRun, regimes: Regimes, noise: MeasurementNoise
) -> tuple[Floats, Floats]:
    """Each sample as a standard normal value, by what the samples before it predict; (n − 1,).

    And the probability that the wheel rolls there, by the samples up to it, likewise.
    """
    scores, states = np.empty(len(run.t)), np.empty((len(run.t), len(regimes.follow), 6))
    _forward(run, regimes, noise, states, scores)
    return scores[1:], states[1:, 0, 5]


def smooth(run: UnbrokenRun, regimes: Regimes, noise: MeasurementNoise) -> Smooth:
    """Level and rate at every sample, from all samples."""
    n, M = len(run.t), len(regimes.follow)
    states = np.empty((n, M, 6))
    _forward(run, regimes, noise, states)
    smoothed = np.empty((n, 4))
    compiled.function(_backward)(*_arguments(run, regimes, noise), states, smoothed)
    return Smooth(smoothed[:, 0], smoothed[:, 1], run.u + smoothed[:, 2], smoothed[:, 3])


def _climb(f: Callable[..., float], start: Floats, steps: Floats) -> tuple[Floats, float]:
    """Maximum of f by search along the axes, with steps halved down to 0.2."""
    x, best = start.copy(), f(*start)
    while steps.max() > 0.2:
        improved = False
        for i in np.flatnonzero(steps):
            for sign in (1.0, -1.0):
                trial = x.copy()
                trial[i] += sign * steps[i]
                while (value := f(*trial)) > best:
                    x, best, improved = trial.copy(), value, True
                    trial[i] += sign * steps[i]
        if not improved:
            steps = steps / 2.0
    return x, best


def _loosen(
    f: Callable[..., float], x: Floats, best: float, width: Floats, slack: Sequence[float]
) -> Floats:
    """The point x with larger coupling, then larger roughness of each regime, as `slack` allows.

    Where little varies, the likelihood is flat towards zero roughness. Its maximum there would make
    the result too certain.
    """
    x = x.copy()
    for i, nats in zip(range(1, len(x)), slack, strict=False):
        step = width[i] / 16.0
        while step > 0.0:
            x[i] += step
            if f(*x) < best - nats:
                x[i] -= step
                break
        best = f(*x) if step > 0.0 else best
    return x


def _arguments(
    run: UnbrokenRun, regimes: Regimes, noise: MeasurementNoise
) -> tuple[Floats | float, ...]:
    inputs = run.t, run.u, run.s, run.input_variance
    return *inputs, noise.rough, noise.coupling, regimes.follow, regimes.rates


def _forward(
    run: UnbrokenRun,
    regimes: Regimes,
    noise: MeasurementNoise,
    states: Floats | None,
    scores: Floats | None = None,
) -> float:
    """Log-likelihood of the run; fills `states` (n, M, 6) and `scores` (n,) where given."""
    table = np.empty((0, len(regimes.follow), 6)) if states is None else states
    scores = np.empty(0) if scores is None else scores
    measured = run.y, noise.measurement + run.own_variance, run.span**3 / 320.0
    arguments = *_arguments(run, regimes, noise), *measured, regimes.start, regimes.spread**2
    value: float = compiled.function(_filter)(*arguments, table, scores)
    return value


# Everything below is compiled. Per regime: level, δ, their variances and covariance as
# (m0, m1, P00, P01, P11) and the probability p.


def _switching(leave: Floats, h: float, T: Floats) -> None:
    """Fill T (M, M): probability of each regime after a step h, at most one switch."""
    M = len(leave)
    for i in range(M):
        total_rate = 0.0
        for j in range(M):
            total_rate += leave[i, j]
        p_stay = math.exp(-total_rate * h)
        for j in range(M):
            T[i, j] = p_stay if i == j else leave[i, j] / total_rate * (1.0 - p_stay)


def _predict(  # noqa: PLR0913 (numba: plain arrays and floats)
    m0: float,
    m1: float,
    P00: float,
    P01: float,
    P11: float,
    h: float,
    gain: float,
    ds: float,
    c: float,
    q: float,
) -> tuple[float, float, float, float, float]:
    """One step of ẋ = u + δ in the regime with follow c and roughness q."""
    return (
        m0 + h * m1 + gain - 0.5 * h * c * ds,
        m1 - c * ds,
        P00 + 2.0 * h * P01 + h * h * P11 + q * h * h * h / 3.0,
        P01 + h * P11 + q * h * h / 2.0,
        P11 + q * h,
    )


def _filter(  # noqa: PLR0913 (numba: plain arrays and floats)
    t: Floats,
    u: Floats,
    s: Floats,
    input_variance: Floats,
    rough: Floats,
    coupling: float,
    follow: Floats,
    leave: Floats,
    y: Floats,
    r: Floats,
    blur: Floats,
    start: Floats,
    spread: float,
    states: Floats,
    scores: Floats,
) -> float:
    """Forward pass; returns the log-likelihood.

    It fills `states` with every state, and `scores` with every innovation, where these have the
    length.
    """
    n, M = len(t), len(follow)
    mixture, updated = np.empty((M, 6)), np.empty((M, 6))
    pair, W = np.empty((M, M, 5)), np.empty((M, M))
    T, nu, half_chi2 = np.empty((M, M)), np.empty((M, M)), np.empty((M, M))
    for j in range(M):
        mixture[j, 0], mixture[j, 1] = y[0], 0.0
        mixture[j, 2], mixture[j, 3], mixture[j, 4], mixture[j, 5] = r[0], 0.0, spread, start[j]
    if len(states) == n:
        _store(mixture, states, 0)
    total, last_h = 0.0, -1.0
    for k in range(1, n):
        h, ds = t[k] - t[k - 1], s[k] - s[k - 1]
        gain = h * (u[k - 1] + u[k]) / 2.0
        if abs(h - last_h) > _SAME_STEP * h:
            _switching(leave, h, T)
            last_h = h
        smallest = math.inf
        for i in range(M):
            # Loaded once: what is stored below might change `now`, for all the compiler knows.
            f0, f1, p = mixture[i, 0], mixture[i, 1], mixture[i, 5]
            F00, F01, F11 = mixture[i, 2], mixture[i, 3], mixture[i, 4]
            for j in range(M):
                q = rough[j] + (coupling * abs(ds) / h if j == 0 else 0.0)
                m0, m1, P00, P01, P11 = _predict(f0, f1, F00, F01, F11, h, gain, ds, follow[j], q)
                P00 += input_variance[k]
                noise = r[k] + q * blur[k]  # a mean's, about the middle of a random walk's integral
                e, precision = y[k] - m0, 1.0 / (P00 + noise)
                g0, g1 = P00 * precision, P01 * precision
                pair[i, j, 0], pair[i, j, 1] = m0 + g0 * e, m1 + g1 * e
                pair[i, j, 2], pair[i, j, 3], pair[i, j, 4] = g0 * noise, g1 * noise, P11 - g1 * P01
                nu[i, j], half_chi2[i, j] = e, 0.5 * e * e * precision
                W[i, j] = p * T[i, j] * math.sqrt(precision) / ROOT_TAU
                smallest = min(smallest, half_chi2[i, j])
        if len(scores) == n:
            scores[k] = _normal_score(mixture, T, nu, half_chi2)
        mass = 1e-300
        for i in range(M):
            for j in range(M):
                W[i, j] *= math.exp(smallest - half_chi2[i, j])
                mass += W[i, j]
        total += math.log(mass) - smallest
        for j in range(M):
            _merge(pair, W, j, updated)
            updated[j, 5] /= mass
        mixture, updated = updated, mixture
        if len(states) == n:
            _store(mixture, states, k)
    return total


def _store(mixture: Floats, states: Floats, k: int) -> None:
    """Copies the regimes (M, 6) into row k of `states`; `kept[k] = now` takes 2 s to compile."""
    for j in range(len(mixture)):
        for i in range(6):
            states[k, j, i] = mixture[j, i]


def _normal_score(mixture: Floats, T: Floats, nu: Floats, half_chi2: Floats) -> float:
    """The reading as a standard normal value, by every regime before and after the step.

    It is `nu` (M, M) from each prediction; `half_chi2` is half the square of that over its
    variance.
    """
    p_below = p_above = 0.0
    for i in range(len(T)):
        for j in range(len(T)):
            share = 0.5 * mixture[i, 5] * T[i, j]
            tail = math.erfc(math.sqrt(half_chi2[i, j]))  # 2 less it is the other
            p_below += share * (tail if nu[i, j] < 0.0 else 2.0 - tail)
            p_above += share * (2.0 - tail if nu[i, j] < 0.0 else tail)
    return score(p_below, p_above)


def _merge(components: Floats, w: Floats, j: int, merged: Floats) -> None:
    """Replace column j of a mixture (k, M, 5) with weights w (k, M) by its mean and covariance.

    They go into row j, with p = sum of the weights. Whole arrays: a view costs a third more time.
    """
    p = 1e-300
    for i in range(len(w)):
        p += w[i, j]
    m0 = m1 = P00 = P01 = P11 = 0.0
    for i in range(len(w)):
        share = w[i, j] / p
        m0 += share * components[i, j, 0]
        m1 += share * components[i, j, 1]
    for i in range(len(w)):
        share = w[i, j] / p
        d0, d1 = components[i, j, 0] - m0, components[i, j, 1] - m1
        P00 += share * (components[i, j, 2] + d0 * d0)
        P01 += share * (components[i, j, 3] + d0 * d1)
        P11 += share * (components[i, j, 4] + d1 * d1)
    merged[j, 0], merged[j, 1], merged[j, 2] = m0, m1, P00
    merged[j, 3], merged[j, 4], merged[j, 5] = P01, P11, p


def _backward(  # noqa: PLR0913 (numba: plain arrays and floats)
    t: Floats,
    u: Floats,
    s: Floats,
    input_variance: Floats,
    rough: Floats,
    coupling: float,
    follow: Floats,
    leave: Floats,
    states: Floats,
    smoothed: Floats,
) -> None:
    """Backward pass over what `_filter` kept; fills out (n, 4): level, its sigma, δ, its sigma."""
    n, M = len(t), len(follow)
    mixture, updated = states[n - 1].copy(), np.empty((M, 6))
    pair, W, T = np.empty((M, M, 5)), np.empty((M, M)), np.empty((M, M))
    last_h = -1.0
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            h, ds = t[k + 1] - t[k], s[k + 1] - s[k]
            gain = h * (u[k + 1] + u[k]) / 2.0
            if abs(h - last_h) > _SAME_STEP * h:
                _switching(leave, h, T)
                last_h = h
            for j in range(M):  # the regime after the step
                q = rough[j] + (coupling * abs(ds) / h if j == 0 else 0.0)
                top = -math.inf
                for i in range(M):  # before it
                    f0, f1 = states[k, i, 0], states[k, i, 1]
                    F00, F01, F11 = states[k, i, 2], states[k, i, 3], states[k, i, 4]
                    m0, m1, P00, P01, P11 = _predict(
                        f0, f1, F00, F01, F11, h, gain, ds, follow[j], q
                    )
                    P00 += input_variance[k + 1]
                    det = P00 * P11 - P01 * P01
                    c0, c1 = F00 + h * F01, F01 + h * F11  # covariance with the predicted level
                    G00, G01 = (c0 * P11 - F01 * P01) / det, (F01 * P00 - c0 * P01) / det
                    G10, G11 = (c1 * P11 - F11 * P01) / det, (F11 * P00 - c1 * P01) / det
                    e0, e1 = mixture[j, 0] - m0, mixture[j, 1] - m1
                    D00, D01 = mixture[j, 2] - P00, mixture[j, 3] - P01
                    D11 = mixture[j, 4] - P11
                    D00, D01, D11 = _without_growth(D00, D01, D11, P00, P01, P11, det)
                    pair[j, i, 0] = f0 + G00 * e0 + G01 * e1
                    pair[j, i, 1] = f1 + G10 * e0 + G11 * e1
                    pair[j, i, 2] = F00 + G00 * G00 * D00 + 2.0 * G00 * G01 * D01 + G01 * G01 * D11
                    pair[j, i, 3] = (
                        F01 + G00 * G10 * D00 + (G00 * G11 + G01 * G10) * D01 + G01 * G11 * D11
                    )
                    pair[j, i, 4] = F11 + G10 * G10 * D00 + 2.0 * G10 * G11 * D01 + G11 * G11 * D11
                    chi2 = (e0 * e0 * P11 - 2.0 * e0 * e1 * P01 + e1 * e1 * P00) / det
                    W[j, i] = math.log(states[k, i, 5] * T[i, j] + 1e-300)
                    W[j, i] -= 0.5 * (math.log(det) + chi2)
                    top = max(top, W[j, i])
                mass = 0.0
                for i in range(M):
                    W[j, i] = math.exp(W[j, i] - top)
                    mass += W[j, i]
                for i in range(M):
                    W[j, i] *= mixture[j, 5] / mass
            for i in range(M):
                _merge(pair, W, i, updated)
            mixture, updated = updated, mixture
        _mixture_summary(mixture, smoothed, k)


def _mixture_summary(mixture: Floats, smoothed: Floats, k: int) -> None:
    """Fills row k of `smoothed` with the mixture's level, its sigma, δ and its sigma."""
    M, mass = len(mixture), 0.0
    for j in range(M):
        mass += mixture[j, 5]
    for i in range(2):
        mean = 0.0
        for j in range(M):
            mean += mixture[j, 5] / mass * mixture[j, i]
        smoothed[k, 2 * i] = mean
        smoothed[k, 2 * i + 1] = _half_width(mixture, i, mean, mass) / Z95


def _without_growth(  # noqa: PLR0913 (numba: plain arrays and floats)
    D00: float, D01: float, D11: float, P00: float, P01: float, P11: float, det: float
) -> tuple[float, float, float]:
    """What later samples change of the covariance P (its determinant `det`): D without growth.

    More samples never widen the spread for one regime before and one after. A merged mixture can
    still be wider, and would grow without end where y shows little. So the positive part of
    D = λ₁PvvᵀP + λ₂PwwᵀP is removed.
    """
    mean_lambda = (P11 * D00 - 2.0 * P01 * D01 + P00 * D11) / (2.0 * det)
    difference = math.sqrt(max(mean_lambda * mean_lambda - (D00 * D11 - D01 * D01) / det, 0.0))
    lambda_1, lambda_2 = mean_lambda + difference, mean_lambda - difference
    if lambda_1 <= 0.0:
        return D00, D01, D11
    factor = min(lambda_2, 0.0) / (lambda_1 - lambda_2 + 1e-300)
    D00, D01, D11 = lambda_1 * P00 - D00, lambda_1 * P01 - D01, lambda_1 * P11 - D11
    return factor * D00, factor * D01, factor * D11


def _half_width(mixture: Floats, i: int, mean: float, mass: float) -> float:
    """Half-width about `mean` that holds 95 % of the mixture's level (i 0) or δ (i 1)."""
    M = len(mixture)
    narrow, wide_limit = math.inf, 0.0
    for j in range(M):
        if mixture[j, 5] > 1e-4 * mass:
            width = Z95 * math.sqrt(max(mixture[j, 4 if i else 2], 0.0))
            narrow = min(narrow, width)
            wide_limit = max(wide_limit, width + abs(mixture[j, i] - mean))
    while wide_limit > 1.01 * narrow and wide_limit > 0.0:
        middle, outside = math.sqrt(narrow * wide_limit) if narrow > 0.0 else 0.5 * wide_limit, 0.0
        for j in range(M):
            scale = math.sqrt(2.0 * max(mixture[j, 4 if i else 2], 1e-300))
            d = mixture[j, i] - mean
            tails = math.erfc((middle - d) / scale) + math.erfc((middle + d) / scale)
            outside += 0.5 * tails * (mixture[j, 5] / mass)
        if outside > 0.05:
            narrow = middle
        else:
            wide_limit = middle
    return wide_limit
