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
with weights of 1 sigma a: a is 0 or one of `_BENT`. Laplace's approximation gives the likelihood of
each a, and each gets that share of the draws for the peak. The constants are those of (3).

Results. A constant is reported if its 95 % interval is narrower than a factor of `_TOLD`. So are
slip and μ of the peak, at the median speed of the slides, if points lie beyond the peak. The slip
also needs points before it; without them only an upper limit is reported. μ needs none before it if
the rail is likely (3), as its friction law leads back to the peak. There is no fit if the residuals
are too large, or if a step of μ at some time explains them: then the rail changed.

Adhesion utilisation, a term of EN 15595 (its text was not at hand), is the mean μ of the slides
over the mean of the largest μ at the same speeds. Radius and delay also change where a slide begins
and ends, so each draw has its own slides.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..core import compiled
from ..core.model import Bools, Floats, Vehicle
from ..core.physics import G
from ..core.signals import true_runs
from .creep_law import CREEP_FROM, Condition, Contact, Patch, conditions, creep_force, creep_slopes
from .events import CAUGHT

_MOST = 400  # points of a fit
SHORTEST = 8.0  # points of less time do not show the spread of errors [s]
LEAST = 0.5  # points of less time have no fit [s]
_STRETCHES = 0.25, 0.5, 1.0, 2.0  # over which errors may be correlated [s]
_INDEPENDENT = 100.0  # points that count at most: the rail varies from place to place
_BENT = 0.06, 0.2, 0.6  # 1 sigma of a bump's weight, where the rail is not (3)
_BUMP = 0.8  # distance of two bumps, about, and width of each [ln s]
_TOLD = 3.0  # widest interval of a constant that is reported, high over low
# Prior, coded, around Polach's sets; 1 sigma of the logarithms.
_USUAL = Condition(k_a=0.5, k_s=0.2, f0=0.1, A=0.4, B=0.3)
_WIDE = 1.3, 1.3, 1.5, 1.3, 1.3
_LEFT = 0.15  # largest rms residual, over the largest μ
_STEPPED = 0.1, 5.0  # least step of ln μ that is another rail, and its least number of sigma
_PIECE = 0.1  # least share of the points on each side of the step
_EVALUATIONS = 50
_INSIDE = -12.0, 3.0  # range of the unknowns, in which exponentials do not overflow
_CLOSE = 1e-4  # relative change at which a search ends
_FLAT = 1e-8  # cosine of the angle between errors and slopes at which it ends, too
_ASIDE = 1e-10  # step of slip, for the derivative of g
DRAWS = 200
_SPEEDS = 8  # at which the peak is found
_ENDS = 0.01, 0.98  # quantiles of slip between which the points show the curve
_SLIPS = 1e-4, 1.0  # range of slip in which the peak is found
_RMS = 0.02  # expected noise of μ, over the largest μ; the least of short slides
_NODES = (1.0 / 6.0, -math.sqrt(3.0)), (2.0 / 3.0, 0.0), (1.0 / 6.0, math.sqrt(3.0))
_CLEAR = 0.3  # largest noise of slip over slip of a point that is used
_CENTRE = (2.5, 97.5)
_GRID, _HALVINGS = 60, 16  # steps that find a peak, and halvings of the last one


class Interval(NamedTuple):
    """A value, the median of what it may be, and its 95 % interval."""

    value: float
    low: float
    high: float


class RailFit(NamedTuple):
    """A rail as the slides show it."""

    best: Condition  # the likeliest curve; constants that cannot be separated hold only together
    draws: tuple[Condition, ...]  # other rails that are likely: the uncertainty of the fit
    scales: tuple[float, ...]  # true over computed μ, per draw; with one seed the same on all axles
    told: dict[str, Interval]  # the constants whose interval is narrow enough, by name
    below: float | None  # upper limit (97.5 %) of the peak's slip; None: no point is beyond it
    peak_slip: Interval | None  # None where the points do not show it, as the next two
    peak_mu: Interval | None
    utilisation: Interval | None
    speed: float  # at which the peak is given [m/s]


class Points(NamedTuple):
    """Operating points on one rail, in the order of time; shape (n,) each."""

    t: Floats  # [s]
    speed: Floats  # v [m/s]
    slip: Floats
    mu: Floats
    noise: Floats  # σ_s, 1 sigma of the slip's noise
    swing: Floats  # 1 sigma of μ by the reference; larger between two readings of a pressure
    clock: Floats  # 1 sigma of slip by the train speed's delay and drift, one error for all
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
    bend: Bend
    radius: float  # 1 sigma of wheel radius over train speed, as a share of it
    noise: float = 0.0  # least 1 sigma of μ
    alike: float = 1.0  # how many points count as one, at least


# Index of each unknown: coded constants, radius and delay in sigma, weights of the terms of g.
_K_A, _SHARE, _F0, _A, _B, _RADIUS, _DELAY, _WEIGHTS = range(8)
_BY_SPEED = 2  # weights after those of the bumps: of ln v, and of ln v ln s


def _rail(x: Floats) -> Condition:
    e = math.exp
    k_a = e(x[0])
    return Condition(k_a, k_a / (1.0 + e(-x[1])), e(x[2]), 1.0 / (1.0 + e(-x[3])), e(x[4]))


def _part(k: int, slip: float, speed: float, bend: Bend) -> float:
    """The term of g with the weight k."""
    n, at = len(bend.bumps), math.log(max(slip, _SLIPS[0]))
    if k < n:
        far = (at - bend.bumps[k]) / (bend.bumps[1] - bend.bumps[0])
        return math.exp(-0.5 * far * far)
    faster = math.log(max(speed, CREEP_FROM)) - bend.speed
    return faster if k == n else faster * (at - bend.slip)


def _bent_by(slip: float, speed: float, x: Floats, bend: Bend) -> float:
    """e^g at a point."""
    g = 0.0
    for k in range(len(x) - _WEIGHTS):
        g += float(x[_WEIGHTS + k]) * _part(k, slip, speed, bend)
    return math.exp(g)


def _adhesion(
    slip: float, speed: float, rail: Condition, x: Floats, patch: Patch, bend: Bend
) -> float:
    """μ on the rail x, whose constants of (3) are `rail`: (3) e^g."""
    force = creep_force(slip * speed, speed, rail, patch)[0]
    return _bent_by(slip, speed, x, bend) * force / patch.load


def _factors(of: Setup, x: Floats, aside: float, factors: Floats) -> None:
    """Fills e^g of each point at the nodes of its slip, moved by `aside`; shape (n, nodes)."""
    for i in range(len(of.p.slip)):
        slip = _slip(of, x, i) + aside
        for k in range(len(_NODES)):
            at = slip + _NODES[k][1] * of.p.noise[i]
            factors[i, k] = _bent_by(at, of.p.speed[i], x, of.bend)


def _course(
    of: Setup, x: Floats, aside: float, factors: Floats, mean: Floats, variance: Floats
) -> None:
    """Fills mean and variance of μ over the noise of each point's slip, moved by `aside`."""
    rail = _rail(x)
    for i in range(len(of.p.slip)):
        slip = _slip(of, x, i) + aside
        first, second = 0.0, 0.0
        for k in range(len(_NODES)):
            weight, far = _NODES[k]
            at, speed = slip + far * of.p.noise[i], of.p.speed[i]
            force = creep_force(at * speed, speed, rail, of.patch)[0]
            mu = factors[i, k] * force / of.patch.load
            first += weight * mu
            second += weight * mu * mu
        mean[i], variance[i] = first, max(second - first * first, 0.0)


def _slip(of: Setup, x: Floats, i: int) -> float:
    """A point's slip without the errors of radius and delay."""
    rolling = (1.0 - of.p.slip[i]) * (1.0 + of.radius * x[_RADIUS])
    return float(1.0 - rolling + of.p.clock[i] * x[_DELAY])


def _errors(of: Setup, x: Floats, noise: Floats, errors: Floats) -> None:
    """Fills the errors of the points, in sigma, shape (n,)."""
    n = len(of.p.slip)
    factors, mean, variance = np.empty((n, len(_NODES))), np.empty(n), np.empty(n)
    _factors(of, x, 0.0, factors)
    _course(of, x, 0.0, factors, mean, variance)
    for i in range(n):
        errors[i] = (of.p.mu[i] - mean[i]) / noise[i]


def _slopes(of: Setup, x: Floats, scale: Floats, slopes: Floats) -> None:
    """Fills the derivatives of the mean by each unknown, times `scale`; shape (unknowns, n)."""
    p, n, rail = of.p, len(of.p.slip), _rail(x)
    factors, beside = np.empty((n, len(_NODES))), np.empty((n, len(_NODES)))
    _factors(of, x, 0.0, factors)
    _factors(of, x, _ASIDE, beside)
    by_share, by_a = 1.0 - rail.k_s / rail.k_a, rail.A * (1.0 - rail.A)
    for i in range(n):
        mean = steep = stiff = share = by_A = by_B = 0.0
        for k in range(len(_NODES)):
            weight, far = _NODES[k]
            at, speed = _slip(of, x, i) + far * p.noise[i], p.speed[i]
            force, slope, k_a, k_s, A, B = creep_slopes(at * speed, speed, rail, of.patch)
            part = weight * factors[i, k] / of.patch.load
            mean += part * force
            steep += part * slope * speed
            steep += weight * (beside[i, k] - factors[i, k]) / _ASIDE * force / of.patch.load
            stiff += part * (k_a + k_s)
            share += part * k_s * by_share
            by_A += part * A * by_a
            by_B += part * B
        slopes[_K_A, i], slopes[_SHARE, i] = scale[i] * stiff, scale[i] * share
        slopes[_A, i], slopes[_B, i] = scale[i] * by_A, scale[i] * by_B
        slopes[_F0, i] = scale[i] * (mean - stiff)  # c f0, c kA and c kS make c μ
        slopes[_RADIUS, i] = -scale[i] * steep * of.radius * (1.0 - p.slip[i])
        slopes[_DELAY, i] = scale[i] * steep * p.clock[i]
        for k in range(len(x) - _WEIGHTS):
            part = _part(k, _slip(of, x, i), p.speed[i], of.bend)
            slopes[_WEIGHTS + k, i] = scale[i] * mean * part


def _peaks(rails: Floats, patch: Patch, bend: Bend, speed: Floats, found: Floats) -> None:
    """Fills slip and μ of the largest adhesion, shape (rails, speeds, 2)."""
    first, whole = math.log(_SLIPS[0]), math.log(_SLIPS[1] / _SLIPS[0])
    for i in range(len(rails)):
        rail = _rail(rails[i])
        for j in range(len(speed)):
            at, most, step = first, 0.0, whole / _GRID
            for k in range(_GRID + 1):
                mu = _adhesion(math.exp(first + k * step), speed[j], rail, rails[i], patch, bend)
                if mu > most:
                    at, most = first + k * step, mu
            for _ in range(_HALVINGS):
                step *= 0.5
                for side in (at - step, at + step):
                    mu = _adhesion(math.exp(side), speed[j], rail, rails[i], patch, bend)
                    if mu > most:
                        at, most = side, mu
            found[i, j, 0], found[i, j, 1] = math.exp(at), most


def curve(rail: Condition, speed: float, slip: Floats, vehicle: Vehicle) -> Floats:
    """μ at a train speed [m/s] and each slip, shape of `slip`."""
    patch = Contact().patch(vehicle.axle_mass.value * G)
    mu = [creep_force(s * speed, speed, rail, patch)[0] / patch.load for s in slip.tolist()]
    return np.array(mu)


def _clear(points: Points) -> Bools:
    return points.noise < _CLEAR * points.slip


def _times(points: Points) -> Floats:
    """Time that each point represents [s], shape (n,)."""
    h = np.diff(points.t, append=points.t[-1:])
    return np.minimum(h, 2.0 * np.median(h))  # without the time between slides


def clear_time(points: Points) -> float:
    """For how long slip exceeds its noise [s]; 0 without a slide."""
    if not points.sliding.any():
        return 0.0
    return float(_times(points)[_clear(points)].sum())


def fit(
    points: Points, vehicle: Vehicle, radius_error: float, mu_error: float, draws: int = DRAWS
) -> RailFit | None:
    """The rail under the points; None where they have less than `LEAST`, or no curve fits them.

    Args:
        points: of slides and between them, without NaN.
        vehicle: for the load; the contact is `creep_law.Contact`'s.
        radius_error: 1 sigma of wheel radius over train speed, as a share of it.
        mu_error: 1 sigma of μ's scale over μ.
        draws: how many; an interval of few is rougher.
    """
    seconds = clear_time(points)
    if seconds < LEAST:
        return None
    some = np.flatnonzero(_clear(points))
    some = some[:: max(1, -(-len(some) // _MOST))]
    p = Points._make(column[some] for column in points)
    patch = Contact().patch(vehicle.axle_mass.value * G)
    of = Setup(p, patch, _bend(p), radius_error)
    if seconds < SHORTEST:
        independent = max(seconds / _STRETCHES[-1], 1.0)
        of = of._replace(noise=_RMS * _level(p), alike=len(p.t) / independent)
    search = _search(of)
    found = _best(search)
    if found is None:
        return None
    best, sigma = found
    random = np.random.default_rng(0)
    scales = np.exp(mu_error * random.standard_normal(draws))
    weak = search._replace(weight=1.0 / math.sqrt(max(_alike(p.t, best.left), of.alike)))
    near = _Near(weak, sigma, best.x)
    drawn = np.array([near.draw(random) for _ in range(draws)])
    curves = _bent(search, sigma, drawn, best.x, random)
    if curves is None:
        return None
    for x in (drawn, curves):
        x[:, [_K_A, _F0]] += np.log(scales)[:, None]  # kA, and kS with it, and f0 go with μ
    return _fitted(points, of, _rail(best.x), drawn, curves, scales)


def _best(search: "_Search") -> "tuple[_Found, float] | None":
    """The best curve and the noise of μ; None where the residuals are too large."""
    p = search.of.p
    level = _level(p)
    rough = search._replace(of=search.of._replace(p=p._replace(noise=np.zeros(len(p.t)))))
    starts = [np.append(_coded(rail), (0.0, 0.0)) for rail in conditions().values()]
    ends = [rough.run(_RMS * level, x) for x in starts]
    sigma = min(f.rms for f in ends) * _RMS * level
    if sigma > _LEFT * level:
        return None
    sigma = max(sigma, search.of.noise)
    best = max((search.run(sigma, f.x) for f in ends), key=lambda f: f.likely)
    return search.run(sigma, best.x), sigma


def _level(p: Points) -> float:
    """The largest μ, but for outliers."""
    return max(float(np.quantile(np.abs(p.mu), 0.9)), 1e-6)


def _fitted(
    points: Points, of: Setup, best: Condition, draws: Floats, curves: Floats, scales: Floats
) -> RailFit:
    """What the draws show, shape (draws, unknowns): `draws` among curves (3), `curves` among all.

    `points` are all points, `of` those that were fitted.
    """
    rails = tuple(_rail(x) for x in draws)
    spreads = {n: _interval([getattr(rail, n) for rail in rails]) for n in Condition._fields}
    slides = points.speed[points.sliding]
    speed, speeds = float(np.median(slides)), np.linspace(slides.min(), slides.max(), _SPEEDS)
    peaks = np.empty((len(curves), 1 + _SPEEDS, 2))
    compiled.function(_peaks)(curves, of.patch, of.bend, np.append(speed, speeds), peaks)
    at, mu = (_interval(peaks[:, 0, i]) for i in (0, 1))
    low, high = np.quantile(of.p.slip, _ENDS).tolist()
    below = max(at.high, low)  # of less slip there are no points
    passed = below < high
    # Friction falls as it does in the slides on curves (3) only; other curves need points before.
    bent = curves[:, _WEIGHTS:].any(axis=1)
    blind = bent.mean() > 0.5 and 100.0 * np.mean(bent & (peaks[:, 0, 0] < low)) > _CENTRE[0]
    tall = passed and _narrow(mu) and not blind
    used = _utilisation(points, curves, scales, of.radius, speeds, peaks[:, 1:, 1])
    return RailFit(
        best,
        rails,
        tuple(scales.tolist()),
        {n: x for n, x in spreads.items() if _narrow(x)},
        below if passed else None,
        at if passed and low < at.value and _narrow(at) else None,
        mu if tall else None,
        _interval(used) if tall else None,
        speed,
    )


def _utilisation(
    p: Points, draws: Floats, scales: Floats, radius: float, speeds: Floats, could: Floats
) -> Floats:
    """Mean μ of the slides over that of the largest at the same speeds, by each draw; (draws,).

    A draw's radius and delay change the slip, and where slides begin and end. `could` is the
    largest μ at these speeds, shape (draws, speeds).
    """
    found, h = np.empty(len(draws)), _times(p)
    for j, x in enumerate(draws):
        slip = 1.0 - (1.0 - p.slip) * (1.0 + radius * x[_RADIUS]) + p.clock * x[_DELAY]
        inside = np.zeros(len(h), dtype=np.bool_)
        for a, b in true_runs(slip > CAUGHT):
            inside[a:b] = p.sliding[a:b].any()
        inside = inside if inside.any() else p.sliding
        largest = np.interp(p.speed[inside], speeds, could[j])
        weight = h[inside]
        found[j] = scales[j] * (p.mu[inside] @ weight) / (largest @ weight)
    return found


class _Found(NamedTuple):
    """The best curve of a search."""

    x: Floats  # the unknowns, shape (unknowns,)
    left: Floats  # residuals, in sigma, shape (n,)
    likely: float  # log evidence of the points on such curves, but for a constant
    errors: Floats  # weighted residuals, then those of the prior; shape (n + unknowns,)
    slopes: Floats  # derivatives of these by the unknowns, shape (n + unknowns, unknowns)

    @property
    def rms(self) -> float:
        return math.sqrt(float(self.left @ self.left) / len(self.left))


class _Search(NamedTuple):
    """Least squares of the residuals and of the prior."""

    of: Setup
    known: Floats  # prior of the unknowns, shape (unknowns,)
    wide: Floats  # its 1 sigma
    weight: float = 1.0  # of a point's error

    def run(self, sigma: float, start: Floats) -> _Found:
        """The best curve, from `start`."""
        near = _Near(self, sigma, start)
        x, errors = near.solved(self.known, 0.0)
        slopes = near.slopes(x).T
        volume = float(np.linalg.slogdet(slopes.T @ slopes)[1])
        wide = float(np.log(self.wide).sum() + self.weight**2 * np.log(near.noise).sum())
        likely = -0.5 * float(np.dot(errors, errors)) - 0.5 * volume - wide
        at = np.clip(x, *_INSIDE)
        return _Found(at, near.residuals(x), likely, errors, slopes)


class _Near:
    """Searches from one start: what all of them need there is computed once.

    The curve at the start turns noise of slip into noise of μ. New weights at each iteration would
    favour steep and bent curves.

    Args:
        search: among which curves.
        sigma: 1 sigma of μ.
        start: the unknowns, shape (unknowns,).
    """

    def __init__(self, search: _Search, sigma: float, start: Floats) -> None:
        self._search, self._start = search, start
        self._errors, self._slopes = compiled.function(_errors), compiled.function(_slopes)
        of, n = search.of, len(search.of.p.t)
        factors, mean, variance = np.empty((n, len(_NODES))), np.empty(n), np.empty(n)
        at = np.clip(start, *_INSIDE)
        compiled.function(_factors)(of, at, 0.0, factors)
        compiled.function(_course)(of, at, 0.0, factors, mean, variance)
        self.noise: Floats = np.sqrt(sigma * sigma + of.p.swing**2 + variance)
        self._scale, self._prior = -search.weight / self.noise, np.diag(1.0 / search.wide)
        self._first = (of.p.mu - mean) / self.noise
        self._first_slopes = self._computed(start)

    def residuals(self, x: Floats) -> Floats:
        """Errors of the points, in sigma, shape (n,)."""
        if np.array_equal(x, self._start):
            return self._first
        errors = np.empty(len(self.noise))
        self._errors(self._search.of, x.clip(*_INSIDE), self.noise, errors)
        return errors

    def slopes(self, x: Floats) -> Floats:
        """Derivatives of the weighted residuals, and of the prior's; (unknowns, n + unknowns)."""
        return self._first_slopes if np.array_equal(x, self._start) else self._computed(x)

    def _computed(self, x: Floats) -> Floats:
        n = len(self.noise)
        slopes = np.empty((len(x), n + len(x)))
        self._slopes(self._search.of, x.clip(*_INSIDE), self._scale, slopes)
        slopes[:, n:] = self._prior
        return slopes

    def solved(self, known: Floats, other: Floats | float) -> tuple[Floats, Floats]:
        """The unknowns of the best curve, and the errors there.

        Args:
            known: centre of the prior, shape (unknowns,).
            other: errors added to the residuals, in sigma.
        """
        from scipy.optimize import leastsq

        _, _, wide, weight = self._search

        n = len(self.noise)

        def left(x: Floats) -> Floats:
            both = np.empty(n + len(x))
            both[:n] = weight * self.residuals(x) + other
            both[n:] = (x - known) / wide
            return both

        x, _, info, *_ = leastsq(
            left, self._start, Dfun=self.slopes, full_output=True, col_deriv=True, ftol=_CLOSE,
            xtol=_CLOSE, gtol=_FLAT, maxfev=_EVALUATIONS,
        )  # fmt: skip
        return x, info["fvec"]

    def draw(self, random: np.random.Generator) -> Floats:
        """The unknowns of the best curve for other errors, as likely as the residuals."""
        of, known, wide, _ = self._search
        known = known + wide * random.standard_normal(len(known))
        return np.clip(self.solved(known, random.standard_normal(len(of.p.t)))[0], *_INSIDE)


def _search(of: Setup) -> _Search:
    """The search among curves (3)."""
    size = len(_WIDE) + 2
    known, wide = np.zeros(size), np.ones(size)
    known[:_RADIUS], wide[:_RADIUS] = _coded(_USUAL), _WIDE
    return _Search(of, known, wide)


def _bend(p: Points) -> Bend:
    """The terms of g for these points: bumps over their slips, and one before."""
    low, high = np.quantile(p.slip, _ENDS).tolist()
    count = max(1, round(math.log(high / low) / _BUMP))
    bumps = math.log(low) + math.log(high / low) / count * np.arange(-1.0, count + 1)
    return Bend(bumps, float(np.median(np.log(p.slip))), float(np.median(np.log(p.speed))))


def _bent(
    straight: _Search, sigma: float, draws: Floats, best: Floats, random: np.random.Generator
) -> Floats | None:
    """Draws among all curves, (3) or not, shape (draws, unknowns); None for points of two rails.

    As many `draws` of curves (3) are kept as the points make likely.
    """
    t = straight.of.p.t
    more = np.zeros(len(straight.of.bend.bumps) + _BY_SPEED)
    searches = [straight]
    for weight in _BENT:
        known, wide = np.append(straight.known, more), np.append(straight.wide, more + weight)
        searches.append(straight._replace(known=known, wide=wide))
    start = np.append(best, more)
    sigma = max(sigma * searches[-1].run(sigma, start).rms, straight.of.noise)
    alike = _alike(t, searches[-1].run(sigma, start).left)
    weight = 1.0 / math.sqrt(max(alike, straight.of.alike))
    searches = [of._replace(weight=weight) for of in searches]
    found = [of.run(sigma, start[: len(of.known)]) for of in searches]
    if _stepped(t, found[-1], weight):
        return None
    share = np.exp([f.likely - max(f.likely for f in found) for f in found])
    count = len(draws)
    which = np.searchsorted(np.cumsum(share) / share.sum(), (np.arange(count) + 0.5) / count)
    curves = np.pad(draws, ((0, 0), (0, len(more))))
    for k in range(1, len(searches)):
        near = _Near(searches[k], sigma, found[k].x)
        for j in np.flatnonzero(which == k).tolist():
            curves[j] = near.draw(random)
    return curves


def _stepped(t: Floats, f: _Found, weight: float) -> bool:
    """Whether all μ steps at some time, more than the other unknowns explain.

    The step is compared with the residuals after it: those before it contain the step.
    """
    n, (least, sigma) = len(t), _STEPPED
    first = np.arange(math.ceil(_PIECE * n), math.floor((1.0 - _PIECE) * n))
    own = np.linalg.qr(f.slopes)[0]
    steps = np.zeros((len(f.slopes), len(first)))
    steps[:n] = f.slopes[:n, [_K_A, _F0]].sum(axis=1)[:, None]  # kA, and kS with it, and f0
    steps[:n] *= np.arange(n)[:, None] >= first
    steps -= own @ (own.T @ steps)
    told, seen = np.sum(steps**2, axis=0), f.errors @ steps
    k = int(np.argmax(seen**2 / told))
    step = float(seen[k] / told[k])
    others = _alike(t, f.left - step / weight * steps[:n, k])
    return abs(step) > least and step**2 * float(told[k]) > sigma**2 * weight**2 * others


def _alike(t: Floats, left: Floats) -> float:
    """How many points count as one, as their errors are correlated over a while."""
    most = max(float(np.mean(left**2)), len(t) / _INDEPENDENT)
    for seconds in _STRETCHES:
        stretch = np.floor((t - t[0]) / seconds).astype(np.int64)
        sums = np.bincount(stretch, weights=left)
        most = max(most, float(sums @ sums) / len(t))
    return most


def _coded(rail: Condition) -> Floats:
    """Logarithms; of kS/kA and A, which lie between 0 and 1, the logits."""
    share, log = rail.k_s / rail.k_a, math.log
    odds = log(share / (1.0 - share)), log(rail.A / (1.0 - rail.A))
    return np.array([log(rail.k_a), odds[0], log(rail.f0), odds[1], log(rail.B)])


def _narrow(x: Interval) -> bool:
    return x.high < _TOLD * x.low


def _interval(draws: Sequence[float] | Floats) -> Interval:
    return Interval(*(float(x) for x in np.percentile(draws, (50.0, *_CENTRE))))
