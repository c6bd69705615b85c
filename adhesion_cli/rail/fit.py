"""The rail under slides: Polach's constants and the peak of the curve, each with an interval.

[S2]: least squares fit the curve (3), with the patent's friction law, to the s–μ points of the
slides and of the creep between them. Unknown are f0, A, B, kA and kS, as logarithms or logits, and
the errors of wheel radius and train speed's delay, which all points share. Wide priors hold what
the points do not decide.

Noise. A point measured at s lies at s + N(0, σ_s). It is compared with the mean of the curve there
and weighted with its variance, by three nodes of Gauss and Hermite. Successive errors are
correlated. Sums of errors over stretches of time show how many points are independent.

Points of less than `SHORTEST` do not show that. Their errors count as one over the longest of these
stretches, and their noise as no less than expected. The priors then widen the draws.

Intervals come from draws: each is the best curve for other errors of the same size and correlation,
and for other priors (randomised maximum likelihood). If the true μ is c times the computed one, f0,
kA and kS are c times as large, and A and B are the same. So the vehicle's tolerances are applied to
the draws afterwards.

Other curves. A rail's curve may be (3) e^g. Here g is a sum of bumps in ln s and of terms in ln v,
with weights of 1 sigma a: a is 0 or one of `_BEND_SIGMAS`. Laplace's approximation gives the
likelihood of each a, and each gets that share of the draws for the peak. The constants are those of
(3).

Results. A constant is reported if its 95 % interval is narrower than a factor of `_WIDEST_FACTOR`.
So are slip and μ of the peak, at the median speed of the slides, if points lie beyond the peak. The
slip also needs points before it; without them only an upper limit is reported. μ and utilisation
need none before it if the rail is likely (3), as its friction law leads back to the peak. The
utilisation is reported if its interval is narrower than `_WIDEST_UTILISATION`. There is no fit if
the residuals are too large, or if a step of μ at some time explains them: then the rail changed.

A brake force is wrong by its tolerance and, as pressure and speed need not be sampled at one time,
by what it changes in half an interval. What is not a factor of all μ is wrong by more in one part
of a slide than in another. Each draw of the utilisation has such errors: they move the curve, to
first order, and the mean. Those of the constants and of the peak are without.

Adhesion utilisation, a term of EN 15595 (its text was not at hand), is the mean μ of the slides
over the mean of the largest μ at the same speeds. Radius and delay also change where a slide begins
and ends, so each draw has its own slides.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..core import compiled
from ..core.masks import true_runs
from ..core.model import Bools, Floats, Vehicle
from ..core.physics import G
from .creep_law import CREEP_FROM, Condition, Contact, Patch, conditions, creep_force, creep_slopes
from .events import END_SLIP

_MOST_POINTS = 400  # points of a fit
SHORTEST = 8.0  # points of less time do not show the spread of errors [s]
SHORTEST_FIT = 0.5  # points of less time have no fit [s]
_STRETCHES = 0.25, 0.5, 1.0, 2.0  # over which errors may be correlated [s]
_INDEPENDENT = 100.0  # points that count at most: the rail varies from place to place
_BEND_SIGMAS = 0.06, 0.2, 0.6  # 1 sigma of a bump's weight, where the rail is not (3)
_BUMP_DISTANCE = 0.8  # distance of two bumps, about, and width of each [ln s]
_WIDEST_FACTOR = 3.0  # widest interval of a constant that is reported, high over low
# Prior, coded, around Polach's sets; 1 sigma of the logarithms.
_PRIOR_RAIL = Condition(k_a=0.5, k_s=0.2, f0=0.1, A=0.4, B=0.3)
_PRIOR_SIGMA = 1.3, 1.3, 1.5, 1.3, 1.3
_LARGEST_RESIDUAL = 0.15  # largest rms residual, over the largest μ
_WIDEST_UTILISATION = 0.25  # widest interval of an adhesion utilisation that is reported
_CLEAR_STEP = 0.1, 5.0  # least step of ln μ that is another rail, and its least number of sigma
_SMALLEST_SIDE = 0.1  # least share of the points on each side of the step
# relative changes, and the cosine of the angle between errors and slopes, at which a search ends
_SEARCH_LIMITS = {"ftol": 1e-4, "xtol": 1e-4, "gtol": 1e-8, "maxfev": 50}
_UNKNOWN_RANGE = -12.0, 3.0  # range of the unknowns, in which exponentials do not overflow
_SLIP_STEP = 1e-10  # step of slip, for the derivative of g
DRAWS = 200
_COMPARED = 40  # points, and draws, by which two rails are compared
_SPEEDS = 8  # at which the peak is found
_SLIP_QUANTILES = 0.01, 0.98  # quantiles of slip between which the points show the curve
_SLIPS = 1e-4, 1.0  # range of slip in which the peak is found
_NOISE_LIMIT = 2.0  # sigma by which noise may lift a point above the largest μ
_MU_NOISE = 0.02  # expected noise of μ, over the largest μ; the least of short slides
_NODES = (1.0 / 6.0, -math.sqrt(3.0)), (2.0 / 3.0, 0.0), (1.0 / 6.0, math.sqrt(3.0))
_CLEAR_NOISE = 0.3  # largest noise of slip over slip of a point that is used
_PERCENTILES = (2.5, 97.5)
_GRID_STEPS, _HALVINGS = 60, 16  # steps that find a peak, and halvings of the last one


class Interval(NamedTuple):
    """A value, the median of what it may be, and its 95 % interval."""

    value: float
    lower: float
    upper: float


class RailFit(NamedTuple):
    """A rail as the slides show it."""

    best: Condition  # the likeliest curve; constants that cannot be separated hold only together
    draws: tuple[Condition, ...]  # other rails that are likely: the uncertainty of the fit
    scales: tuple[float, ...]  # true over computed μ, per draw; with one seed the same on all axles
    constants: dict[str, Interval]  # the constants whose interval is narrow enough, by name
    # upper limit (97.5 %) of the peak's slip; None: no point is beyond it
    peak_slip_limit: float | None
    peak_slip: Interval | None  # None where the points do not show it, as the next two
    peak_mu: Interval | None
    utilisation: Interval | None
    speed: float  # at which the peak is given [m/s]
    delay: float = 0.0  # error of the train speed that the points show, in sigma of `Points.clock`
    points: "Points | None" = None  # those that were fitted

    @property
    def mean_mu(self) -> float | None:
        """Mean adhesion coefficient of the slides."""
        p = self.points
        return float(np.mean(p.mu[p.sliding])) if p and p.sliding.any() else None


class Points(NamedTuple):
    """Operating points on one rail, in the order of time; shape (n,) each."""

    t: Floats  # [s]
    speed: Floats  # v [m/s]
    slip: Floats
    mu: Floats
    noise: Floats  # σ_s, 1 sigma of the slip's noise
    swing: Floats  # 1 sigma of μ by the reference; larger between two readings of a pressure
    clock: Floats  # 1 sigma of slip by the train speed's delay and drift, one error for all
    common_errors: Floats  # 1 sigma of μ by errors that are each one for all, shape (n, errors)
    sliding: Bools  # the others lie between slides


class Bend(NamedTuple):
    """The terms of g, the logarithm of a rail's curve over (3)."""

    bumps: Floats  # ln s of their tops, shape (bumps,)
    slip: float  # ln s and
    speed: float  # ln v at which the terms in ln v are 0


class Setup(NamedTuple):
    """What a curve is compared with, besides the unknowns."""

    p: Points
    patch: Patch
    shape: Bend
    radius: float  # 1 sigma of wheel radius over train speed, as a share of it
    noise: float = 0.0  # least 1 sigma of μ
    correlated: float = 1.0  # how many points count as one, at least


# Index of each unknown: coded constants, radius and delay in sigma, weights of the terms of g.
_K_A, _SHARE, _F0, _A, _B, _RADIUS, _DELAY, _WEIGHTS = range(8)
_BY_SPEED = 2  # weights after those of the bumps: of ln v, and of ln v ln s


def _rail(x: Floats) -> Condition:
    e = math.exp
    k_a = e(x[0])
    return Condition(k_a, k_a / (1.0 + e(-x[1])), e(x[2]), 1.0 / (1.0 + e(-x[3])), e(x[4]))


def _bend_term(k: int, slip: float, speed: float, bend: Bend) -> float:
    """The term of g with the weight k."""
    n, log_slip = len(bend.bumps), math.log(max(slip, _SLIPS[0]))
    if k < n:
        distance = (log_slip - bend.bumps[k]) / (bend.bumps[1] - bend.bumps[0])
        return math.exp(-0.5 * distance * distance)
    log_speed = math.log(max(speed, CREEP_FROM)) - bend.speed
    return log_speed if k == n else log_speed * (log_slip - bend.slip)


def _bend_factor(slip: float, speed: float, x: Floats, shape: Bend) -> float:
    """e^g at a point."""
    g = 0.0
    for k in range(len(x) - _WEIGHTS):
        g += float(x[_WEIGHTS + k]) * _bend_term(k, slip, speed, shape)
    return math.exp(g)


def _adhesion(
    slip: float, speed: float, rail: Condition, x: Floats, patch: Patch, shape: Bend
) -> float:
    """μ on the rail x, whose constants of (3) are `rail`: (3) e^g."""
    force = creep_force(slip * speed, speed, rail, patch)[0]
    return _bend_factor(slip, speed, x, shape) * force / patch.load


def _mean_mu(setup: Setup, x: Floats, mean: Floats, variance: Floats) -> None:
    """Fills mean and variance of μ over the noise of each point's slip."""
    rail = _rail(x)
    for i in range(len(setup.p.slip)):
        slip, speed = _slip(setup, x, i), setup.p.speed[i]
        mean_value, square_value = 0.0, 0.0
        for weight, node in _NODES:
            node_slip = slip + node * setup.p.noise[i]
            mu = _adhesion(node_slip, speed, rail, x, setup.patch, setup.shape)
            mean_value += weight * mu
            square_value += weight * mu * mu
        mean[i], variance[i] = mean_value, max(square_value - mean_value * mean_value, 0.0)


def _slip(setup: Setup, x: Floats, i: int) -> float:
    """A point's slip without the errors of radius and delay."""
    rolling = (1.0 - setup.p.slip[i]) * (1.0 + setup.radius * x[_RADIUS])
    return float(1.0 - rolling + setup.p.clock[i] * x[_DELAY])


def _slopes(setup: Setup, x: Floats, scale: Floats, slopes: Floats) -> None:
    """Fills the derivatives of the mean by each unknown, times `scale`; shape (unknowns, n)."""
    p, rail = setup.p, _rail(x)
    share_derivative, A_derivative = 1.0 - rail.k_s / rail.k_a, rail.A * (1.0 - rail.A)
    for i in range(len(p.slip)):
        mean = slip_slope = stiffness_slope = share_slope = A_slope = B_slope = 0.0
        point_slip, speed = _slip(setup, x, i), p.speed[i]
        for weight, node in _NODES:
            node_slip = point_slip + node * p.noise[i]
            force, slope, k_a, k_s, A, B = creep_slopes(node_slip * speed, speed, rail, setup.patch)
            bend = _bend_factor(node_slip, speed, x, setup.shape)
            stepped_slip = point_slip + _SLIP_STEP + node * p.noise[i]
            stepped = _bend_factor(stepped_slip, speed, x, setup.shape)
            factor = weight * bend / setup.patch.load
            mean += factor * force
            slip_slope += factor * slope * speed
            slip_slope += weight * (stepped - bend) / _SLIP_STEP * force / setup.patch.load
            stiffness_slope += factor * (k_a + k_s)
            share_slope += factor * k_s * share_derivative
            A_slope += factor * A * A_derivative
            B_slope += factor * B
        slopes[_K_A, i], slopes[_SHARE, i] = scale[i] * stiffness_slope, scale[i] * share_slope
        slopes[_A, i], slopes[_B, i] = scale[i] * A_slope, scale[i] * B_slope
        slopes[_F0, i] = scale[i] * (mean - stiffness_slope)  # c f0, c kA and c kS make c μ
        slopes[_RADIUS, i] = -scale[i] * slip_slope * setup.radius * (1.0 - p.slip[i])
        slopes[_DELAY, i] = scale[i] * slip_slope * p.clock[i]
        for k in range(len(x) - _WEIGHTS):
            factor = _bend_term(k, _slip(setup, x, i), p.speed[i], setup.shape)
            slopes[_WEIGHTS + k, i] = scale[i] * mean * factor


def _peaks(rails: Floats, patch: Patch, bend: Bend, speed: Floats, peaks: Floats) -> None:
    """Fills slip and μ of the largest adhesion, shape (rails, speeds, 2)."""
    log_start, log_range = math.log(_SLIPS[0]), math.log(_SLIPS[1] / _SLIPS[0])
    for i in range(len(rails)):
        rail = _rail(rails[i])
        for j in range(len(speed)):
            log_peak, highest, step = log_start, 0.0, log_range / _GRID_STEPS
            for k in range(_GRID_STEPS + 1):
                slip = math.exp(log_start + k * step)
                mu = _adhesion(slip, speed[j], rail, rails[i], patch, bend)
                if mu > highest:
                    log_peak, highest = log_start + k * step, mu
            for _ in range(_HALVINGS):
                step *= 0.5
                for neighbour in (log_peak - step, log_peak + step):
                    mu = _adhesion(math.exp(neighbour), speed[j], rail, rails[i], patch, bend)
                    if mu > highest:
                        log_peak, highest = neighbour, mu
            peaks[i, j, 0], peaks[i, j, 1] = math.exp(log_peak), highest


def curve(rail: Condition, speed: Floats | float, slip: Floats, vehicle: Vehicle) -> Floats:
    """μ at each slip and a train speed [m/s], one for all or one for each, shape of `slip`."""
    patch = Contact().patch(vehicle.axle_mass.value * G)
    places = zip(slip.tolist(), np.broadcast_to(speed, slip.shape).tolist(), strict=True)
    return np.array([creep_force(s * v, v, rail, patch)[0] / patch.load for s, v in places])


def _is_clear(points: Points) -> Bools:
    return points.noise < _CLEAR_NOISE * points.slip


def _durations(points: Points) -> Floats:
    """Time that each point represents [s], shape (n,)."""
    h = np.diff(points.t, append=points.t[-1:])
    return np.minimum(h, 2.0 * np.median(h))  # without the time between slides


def clear_time(points: Points) -> float:
    """For how long slip exceeds its noise [s]; 0 without a slide."""
    if not points.sliding.any():
        return 0.0
    return float(_durations(points)[_is_clear(points)].sum())


def fit(
    points: Points, vehicle: Vehicle, radius_error: float, mu_error: float, draws: int = DRAWS
) -> RailFit | None:
    """The rail under the points; None where they last less than `SHORTEST_FIT` or nothing fits.

    The points are of slides and between them, without NaN. The errors are 1 sigma: of wheel radius
    over train speed, and of μ's scale, as shares. An interval of few `draws` is rougher.
    """
    seconds = clear_time(points)
    if seconds < SHORTEST_FIT:
        return None
    chosen = np.flatnonzero(_is_clear(points))
    chosen = chosen[:: max(1, -(-len(chosen) // _MOST_POINTS))]
    p = Points._make(column[chosen] for column in points)
    patch = Contact().patch(vehicle.axle_mass.value * G)
    setup = Setup(p, patch, _bend(p), radius_error)
    if seconds < SHORTEST:
        independent = max(seconds / _STRETCHES[-1], 1.0)
        setup = setup._replace(noise=_MU_NOISE * _largest_mu(p), correlated=len(p.t) / independent)
    search = _search(setup)
    optimum = _best(search)
    if optimum is None:
        return None
    best, sigma = optimum
    random = np.random.default_rng(0)
    scales = np.exp(mu_error * random.standard_normal(draws))
    correlated = max(_correlated_points(p.t, best.residuals), setup.correlated)
    weighted = search._replace(weight=1.0 / math.sqrt(correlated))
    local_search = _LocalSearch(weighted, sigma, best.x)
    error_draws = np.random.default_rng(1).standard_normal((draws, points.common_errors.shape[1]))
    straight_draws = np.array([local_search.draw(random) for _ in range(draws)])
    all_curves = _draw_curves(search, sigma, straight_draws, error_draws, best.x, random)
    if all_curves is None:
        return None
    for x in (straight_draws, *all_curves):
        x[:, [_K_A, _F0]] += np.log(scales)[:, None]  # kA, and kS with it, and f0 go with μ
    rails = _Draws(straight_draws, *all_curves, scales, error_draws)
    return _summarise_draws(points, setup, _rail(best.x), sigma, rails)


def _best(search: "_FitSearch") -> "tuple[_Optimum, float] | None":
    """The best curve and the noise of μ; None where the residuals are too large."""
    p = search.setup.p
    level = _largest_mu(p)
    rough = search._replace(setup=search.setup._replace(p=p._replace(noise=np.zeros(len(p.t)))))
    starts = [np.append(_encode(rail), (0.0, 0.0)) for rail in conditions().values()]
    coarse_optima = [rough.run(_MU_NOISE * level, x) for x in starts]
    sigma = min(f.rms for f in coarse_optima) * _MU_NOISE * level
    if sigma > _LARGEST_RESIDUAL * level:
        return None
    sigma = max(sigma, search.setup.noise)
    best = max((search.run(sigma, f.x) for f in coarse_optima), key=lambda f: f.likely)
    return search.run(sigma, best.x), sigma


def _largest_mu(p: Points) -> float:
    return max(float(np.quantile(np.abs(p.mu), 0.9)), 1e-6)


class _Draws(NamedTuple):
    """Rails that are likely, and the errors of μ that each is for."""

    straight: Floats  # curves (3), shape (draws, unknowns)
    curves: Floats  # among all curves, shape (draws, unknowns)
    curves_with_errors: Floats  # the same for the errors `error_draws`, shape (draws, unknowns)
    scales: Floats  # true over computed μ, shape (draws,)
    error_draws: Floats  # errors of `Points.common_errors`, in sigma, shape (draws, errors)


def _summarise_draws(
    points: Points, setup: Setup, best: Condition, sigma: float, rails_drawn: _Draws
) -> RailFit:
    """What the draws show.

    `points` are all points, `setup` those that were fitted, with 1 sigma of μ.
    """
    draws, curves, curves_with_errors, scales, _ = rails_drawn
    rails = tuple(_rail(x) for x in draws)
    spreads = {n: _interval([getattr(rail, n) for rail in rails]) for n in Condition._fields}
    slides = points.speed[points.sliding]
    speed, speeds = float(np.median(slides)), np.linspace(slides.min(), slides.max(), _SPEEDS)
    at_speeds = np.append(speed, speeds)
    peaks, peaks_with_errors = all_peaks = np.empty((2, len(curves), len(at_speeds), 2))
    for rails_of, curve_peaks in zip((curves, curves_with_errors), all_peaks, strict=True):
        compiled.function(_peaks)(rails_of, setup.patch, setup.shape, at_speeds, curve_peaks)
    peak_slip, mu = (_interval(peaks[:, 0, i]) for i in (0, 1))
    lowest, highest = np.quantile(setup.p.slip, _SLIP_QUANTILES).tolist()
    slip_limit = max(peak_slip.upper, lowest)  # of less slip there are no points
    beyond_peak = slip_limit < highest
    # Friction falls as it does in the slides on curves (3) only; other curves need points before.
    is_bent = curves[:, _WEIGHTS:].any(axis=1)
    early_peaks = 100.0 * np.mean(is_bent & (peaks[:, 0, 0] < lowest))
    lacks_points_before = is_bent.mean() > 0.5 and early_peaks > _PERCENTILES[0]
    shows_peak_mu = beyond_peak and _narrow(mu) and not lacks_points_before
    largest_mu = peaks_with_errors[:, 1:, 1]
    shares_used = _utilisation(points, rails_drawn, setup.radius, sigma, speeds, largest_mu)
    utilisation = _interval(np.minimum(shares_used, 1.0))
    is_uncertain = utilisation.upper - utilisation.lower > _WIDEST_UTILISATION
    return RailFit(
        best,
        rails,
        tuple(scales.tolist()),
        {n: x for n, x in spreads.items() if _narrow(x)},
        slip_limit if beyond_peak else None,
        peak_slip if beyond_peak and lowest < peak_slip.value and _narrow(peak_slip) else None,
        mu if shows_peak_mu else None,
        None if is_uncertain or lacks_points_before else utilisation,
        speed,
        float(np.median(draws[:, _DELAY])),
        setup.p,
    )


def contradicts(rail_a: RailFit, rail_b: RailFit, vehicle: Vehicle) -> bool:
    """Whether the slides of rail b have clearly another adhesion than rail a gives there (95 %)."""
    assert rail_b.points is not None
    p = rail_b.points
    sliding = np.flatnonzero(p.sliding)
    sliding = sliding[:: max(1, len(sliding) // _COMPARED)]
    if not len(sliding):
        return False
    measured, ratios = float(np.mean(p.mu[sliding])), []
    for rail, scale in zip(rail_a.draws[:_COMPARED], rail_a.scales, strict=False):
        expected = float(np.mean(curve(rail, p.speed[sliding], p.slip[sliding], vehicle))) / scale
        ratios.append(math.log(max(measured, 1e-6) / max(expected, 1e-6)))
    lower, upper = np.percentile(ratios, _PERCENTILES)
    return bool(lower > _CLEAR_STEP[0] or upper < -_CLEAR_STEP[0])


def _utilisation(
    p: Points, rails: _Draws, radius: float, sigma: float, speeds: Floats, largest_mu: Floats
) -> Floats:
    """Mean μ of the slides over that of the largest at the same speeds, by each draw; (draws,).

    A draw's radius and delay change the slip, and where slides begin and end. Its errors of the
    brake force change μ as they did for the curve. A point above the largest μ, by more than noise
    of 1 sigma `sigma` explains, is on another rail, as where a slide ends: it counts as the
    largest.

    `largest_mu` is the largest μ at these speeds, shape (draws, speeds).
    """
    utilisation, h = np.empty(len(rails.curves_with_errors)), _durations(p)
    for j, (x, scale, error) in enumerate(
        zip(rails.curves_with_errors, rails.scales, rails.error_draws, strict=True)
    ):
        slip = 1.0 - (1.0 - p.slip) * (1.0 + radius * x[_RADIUS]) + p.clock * x[_DELAY]
        inside = np.zeros(len(h), dtype=np.bool_)
        for a, b in true_runs(slip > END_SLIP):
            inside[a:b] = p.sliding[a:b].any()
        inside = inside if inside.any() else p.sliding
        largest = np.interp(p.speed[inside], speeds, largest_mu[j])
        weight, highest = h[inside], largest / scale + _NOISE_LIMIT * sigma
        mu = np.minimum(p.mu[inside] + p.common_errors[inside] @ error, highest)
        utilisation[j] = scale * (mu @ weight) / (largest @ weight)
    return utilisation


class _Optimum(NamedTuple):
    x: Floats  # the unknowns, shape (unknowns,)
    residuals: Floats  # residuals, in sigma, shape (n,)
    likely: float  # log evidence of the points on such curves, but for a constant
    errors: Floats  # weighted residuals, then those of the prior; shape (n + unknowns,)
    slopes: Floats  # derivatives of these by the unknowns, shape (n + unknowns, unknowns)

    @property
    def rms(self) -> float:
        return math.sqrt(float(self.residuals @ self.residuals) / len(self.residuals))


class _FitSearch(NamedTuple):
    """Least squares of the residuals and of the prior."""

    setup: Setup
    prior_mean: Floats  # prior of the unknowns, shape (unknowns,)
    prior_sigma: Floats  # its 1 sigma
    weight: float = 1.0  # of a point's error

    def run(self, sigma: float, start: Floats) -> _Optimum:
        """The best curve, from `start`."""
        local_search = _LocalSearch(self, sigma, start)
        x, errors = local_search.solve(self.prior_mean, 0.0)
        slopes = local_search.slopes(x).T
        volume = float(np.linalg.slogdet(slopes.T @ slopes)[1])
        log_sigmas = float(np.log(self.prior_sigma).sum())
        log_sigmas += float(self.weight**2 * np.log(local_search.noise).sum())
        likely = -0.5 * float(np.dot(errors, errors)) - 0.5 * volume - log_sigmas
        clipped = np.clip(x, *_UNKNOWN_RANGE)
        return _Optimum(clipped, local_search.residuals(x), likely, errors, slopes)


class _LocalSearch:
    """Searches from one start: what all of them need there is computed once.

    The curve at the start turns noise of slip into noise of μ. New weights at each iteration would
    favour steep and bent curves. `sigma` is that of μ, the start has shape (unknowns,).
    """

    def __init__(self, search: _FitSearch, sigma: float, start: Floats) -> None:
        self._search, self._start = search, start
        self._mean_mu, self._slopes = compiled.function(_mean_mu), compiled.function(_slopes)
        mean, variance = self._mean_and_variance(start)
        self.noise: Floats = np.sqrt(sigma * sigma + search.setup.p.swing**2 + variance)
        self._first_residual = (search.setup.p.mu - mean) / self.noise
        self._first_slopes = self._computed(start)

    def _mean_and_variance(self, x: Floats) -> tuple[Floats, Floats]:
        """Of μ at each point, (n,) each."""
        mean, variance = np.empty((2, len(self._search.setup.p.t)))
        self._mean_mu(self._search.setup, np.clip(x, *_UNKNOWN_RANGE), mean, variance)
        return mean, variance

    def residuals(self, x: Floats) -> Floats:
        """Errors of the points, in sigma, shape (n,)."""
        if np.array_equal(x, self._start):
            return self._first_residual
        residuals: Floats = (self._search.setup.p.mu - self._mean_and_variance(x)[0]) / self.noise
        return residuals

    def slopes(self, x: Floats) -> Floats:
        """Derivatives of the weighted residuals, and of the prior's; (unknowns, n + unknowns)."""
        return self._first_slopes if np.array_equal(x, self._start) else self._computed(x)

    def _computed(self, x: Floats) -> Floats:
        n, scale = len(self.noise), -self._search.weight / self.noise
        slopes = np.empty((len(x), n + len(x)))
        self._slopes(self._search.setup, x.clip(*_UNKNOWN_RANGE), scale, slopes)
        slopes[:, n:] = np.diag(1.0 / self._search.prior_sigma)
        return slopes

    def solve(self, prior_mean: Floats, added: Floats | float) -> tuple[Floats, Floats]:
        """The unknowns of the best curve, and the errors there; `added` are errors in sigma."""
        from scipy.optimize import leastsq

        _, _, prior_sigma, weight = self._search
        n = len(self.noise)

        def all_residuals(x: Floats) -> Floats:
            stacked = np.empty(n + len(x))
            stacked[:n] = weight * self.residuals(x) + added
            stacked[n:] = (x - prior_mean) / prior_sigma
            return stacked

        slopes = {"Dfun": self.slopes, "col_deriv": True}
        options = {**slopes, **_SEARCH_LIMITS, "full_output": True}
        x, _, info, *_ = leastsq(all_residuals, self._start, **options)
        return x, info["fvec"]

    def draw(self, random: np.random.Generator) -> Floats:
        """The unknowns of the best curve for other errors, as likely as the residuals."""
        setup, prior_mean, prior_sigma, _ = self._search
        prior_mean = prior_mean + prior_sigma * random.standard_normal(len(prior_mean))
        x, _ = self.solve(prior_mean, random.standard_normal(len(setup.p.t)))
        return np.clip(x, *_UNKNOWN_RANGE)

    def shifts(self, error_draws: Floats) -> Floats:
        """By how much errors of μ move the unknowns, to first order; shape (draws, unknowns).

        The draws are of errors of `Points.common_errors`, in sigma, shape (draws, errors).
        """
        errors = self._search.weight * (self._search.setup.p.common_errors @ error_draws.T)
        stacked = np.zeros((self._first_slopes.shape[1], len(error_draws)))
        stacked[: len(self.noise)] = errors / self.noise[:, None]
        return np.asarray(-np.linalg.lstsq(self._first_slopes.T, stacked)[0].T, np.float64)


def _search(setup: Setup) -> _FitSearch:
    size = len(_PRIOR_SIGMA) + 2
    prior_mean, prior_sigma = np.zeros(size), np.ones(size)
    prior_mean[:_RADIUS], prior_sigma[:_RADIUS] = _encode(_PRIOR_RAIL), _PRIOR_SIGMA
    return _FitSearch(setup, prior_mean, prior_sigma)


def _bend(p: Points) -> Bend:
    """The terms of g for these points: bumps over their slips, and one before."""
    lowest, highest = np.quantile(p.slip, _SLIP_QUANTILES).tolist()
    count = max(1, round(math.log(highest / lowest) / _BUMP_DISTANCE))
    bumps = math.log(lowest) + math.log(highest / lowest) / count * np.arange(-1.0, count + 1)
    return Bend(bumps, float(np.median(np.log(p.slip))), float(np.median(np.log(p.speed))))


def _draw_curves(
    straight_search: _FitSearch,
    sigma: float,
    draws: Floats,
    error_draws: Floats,
    best: Floats,
    random: np.random.Generator,
) -> tuple[Floats, Floats] | None:
    """Draws among all curves, (3) or not, shape (draws, unknowns); None for points of two rails.

    As many `draws` of curves (3) are kept as the points make likely. The second are the
    same curves for errors of `Points.common_errors`.
    """
    t = straight_search.setup.p.t
    bend_zeros = np.zeros(len(straight_search.setup.shape.bumps) + _BY_SPEED)
    searches = [straight_search]
    for weight in _BEND_SIGMAS:
        prior_mean = np.append(straight_search.prior_mean, bend_zeros)
        prior_sigma = np.append(straight_search.prior_sigma, bend_zeros + weight)
        searches.append(straight_search._replace(prior_mean=prior_mean, prior_sigma=prior_sigma))
    start = np.append(best, bend_zeros)
    sigma = max(sigma * searches[-1].run(sigma, start).rms, straight_search.setup.noise)
    correlated = _correlated_points(t, searches[-1].run(sigma, start).residuals)
    weight = 1.0 / math.sqrt(max(correlated, straight_search.setup.correlated))
    searches = [search._replace(weight=weight) for search in searches]
    optima = [search.run(sigma, start[: len(search.prior_mean)]) for search in searches]
    if _has_step(t, optima[-1], weight):
        return None
    share = np.exp([f.likely - max(f.likely for f in optima) for f in optima])
    count = len(draws)
    chosen = np.searchsorted(np.cumsum(share) / share.sum(), (np.arange(count) + 0.5) / count)
    curves = np.pad(draws, ((0, 0), (0, len(bend_zeros))))
    shifts = np.zeros_like(curves)
    for k in range(len(searches)):
        local_search = _LocalSearch(searches[k], sigma, optima[k].x)
        its_draws = np.flatnonzero(chosen == k)
        for j in its_draws.tolist() if k else ():
            curves[j] = local_search.draw(random)
        shifts[its_draws, : len(optima[k].x)] = local_search.shifts(error_draws[its_draws])
    return curves, np.clip(curves + shifts, *_UNKNOWN_RANGE)


def _has_step(t: Floats, f: _Optimum, weight: float) -> bool:
    """Whether all μ steps at some time, more than the other unknowns explain.

    The step is compared with the residuals after it: those before it contain the step.
    """
    n, (smallest_step, sigma) = len(t), _CLEAR_STEP
    step_start = np.arange(math.ceil(_SMALLEST_SIDE * n), math.floor((1.0 - _SMALLEST_SIDE) * n))
    slope_basis = np.linalg.qr(f.slopes)[0]
    steps = np.zeros((len(f.slopes), len(step_start)))
    steps[:n] = f.slopes[:n, [_K_A, _F0]].sum(axis=1)[:, None]  # kA, and kS with it, and f0
    steps[:n] *= np.arange(n)[:, None] >= step_start
    steps -= slope_basis @ (slope_basis.T @ steps)
    step_norms, projections = np.sum(steps**2, axis=0), f.errors @ steps
    k = int(np.argmax(projections**2 / step_norms))
    step = float(projections[k] / step_norms[k])
    correlated = _correlated_points(t, f.residuals - step / weight * steps[:n, k])
    is_clear = step**2 * float(step_norms[k]) > sigma**2 * weight**2 * correlated
    return abs(step) > smallest_step and is_clear


def _correlated_points(t: Floats, residuals: Floats) -> float:
    """How many points count as one, as their errors are correlated over a while."""
    largest = max(float(np.mean(residuals**2)), len(t) / _INDEPENDENT)
    for seconds in _STRETCHES:
        stretch = np.floor((t - t[0]) / seconds).astype(np.int64)
        sums = np.bincount(stretch, weights=residuals)
        largest = max(largest, float(sums @ sums) / len(t))
    return largest


def _encode(rail: Condition) -> Floats:
    """Logarithms; of kS/kA and A, which lie between 0 and 1, the logits."""
    share, log = rail.k_s / rail.k_a, math.log
    odds = log(share / (1.0 - share)), log(rail.A / (1.0 - rail.A))
    return np.array([log(rail.k_a), odds[0], log(rail.f0), odds[1], log(rail.B)])


def _narrow(x: Interval) -> bool:
    return x.upper < _WIDEST_FACTOR * x.lower


def _interval(draws: Sequence[float] | Floats) -> Interval:
    return Interval(*(float(x) for x in np.percentile(draws, (50.0, *_PERCENTILES))))
