"""What slides say of the rail: Polach's constants and the peak of the curve, each with an interval.

[S2]: the curve (3) with the patent's friction law is laid by least squares through the s–μ points
of the slides, and of what lies between them, where a wheel that was caught is on the rising flank.
Unknown are f0, A, B, kA and kS, in logarithms or logits, as kS ≤ kA and A lies between 0 and 1; and
the wheel's radius and the train speed's delay, whose errors are in every point. What is known of
them beforehand, little of the constants, holds those that the points do not decide.

Noise is in both, s and μ. Where the curve is steep or bends, noise of s is not noise of μ about the
curve: a point that is seen at s lay at s + N(0, σ_s), so it is compared with the mean of the curve
there and weighed with its variance, by three nodes of Gauss and Hermite.

Points follow one another in time and their errors with them: the squares of sums over stretches of
time are larger than the sum of the squares, by as much fewer points are independent. The rail is
not everywhere the same, and no rail is (3) exactly: more than `_INDEPENDENT` never count.

Intervals are from draws, each the best curve for other errors: of μ as large as those that are
left, correlated as they are, of what is known beforehand as wide as it is (randomised maximum
likelihood). Where constants exchange for one another the draws lie along the valley, and what the
points do not decide keeps the width that it had. A true μ that is c times that computed has c f0,
c kA and c kS, and the same A and B, exactly: the error by the vehicle's tolerances is put in
afterwards.

A rail's curve need not be (3). It may be (3) e^g, g a sum of bumps in ln s and of what goes with
the speed, the weight of each 0 give or take a: a is 0, where the rail is (3), or one of `_BENT`.
How likely the points make each a is by Laplace's approximation: what a bent curve gains beside the
points has to outdo how much else it could have been. Each a has so large a share of the draws for
the peak. The constants, and the rails to be run again, are of (3): of another rail they are those
of the nearest one.

A constant is told if its 95 % interval is narrower than a factor of `_TOLD`. So are slip and μ of
the peak, at the slides' middle speed, if there are points beyond it. The slip must have points on
both sides. μ needs none before it: friction that falls with sliding leads back to the peak's height
where the flank is not seen, and then the slip is told to be less than so much; but nothing leads
back where the rail is likelier not (3). Where no curve goes through the points, because the rail
changed under the slides, there is no fit. A curve that may bend and go with the speed passes
between two rails: nor is there one where a step of all μ, at some time, is clearly left beside it.

Adhesion utilisation, a term of EN 15595 (whose text was not at hand), is here the mean over time of
μ in the slides over that of the largest μ at the same speeds: the share that was used of what could
have been. The curve goes through the points, so only their errors can bring it above 1. Radius and
delay err in where a slide begins and ends, too: each draw has slides of its own.

μ errs more where the brake turns between two readings of its pressure: `Points.swing`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..core import compiled
from ..core.model import Bools, Floats, Vehicle
from ..core.physics import G
from ..core.signals import true_runs
from .creep_law import CREEP_FROM, Condition, Contact, Patch, conditions, creep_force
from .events import CAUGHT

_MOST = 400  # points of a fit
SHORTEST = 8.0  # points of less time show no spread of errors [s]
_STRETCHES = 0.25, 0.5, 1.0, 2.0  # over which errors may be alike [s]
_INDEPENDENT = 100.0  # points that count at most: no rail is everywhere the same
_BENT = 0.06, 0.2, 0.6  # 1 sigma of a bump's weight, where the rail is not (3)
_BUMP = 0.8  # between two bumps, about, and how wide each is [ln s]
_TOLD = 3.0  # widest interval of a constant that is told, high over low
# Before any point is seen, coded, around Polach's sets; 1 sigma of the logarithms.
_USUAL = Condition(k_a=0.5, k_s=0.2, f0=0.1, A=0.4, B=0.3)
_WIDE = 1.3, 1.3, 1.5, 1.3, 1.3
_LEFT = 0.15  # largest rms beside the curve, over the largest μ
_STEPPED = 0.1, 5.0  # least step of ln μ that is another rail, and the sigma that it is clear by
_PIECE = 0.1  # share of the points at least on each side of it: fewer move no curve by much
_EVALUATIONS = 50
_INSIDE = -12.0, 3.0  # unknowns beyond are no rail, and exponentials overflow
_CLOSE = 1e-4  # relative change at which a search ends
_STEP = 1e-6  # of an unknown, for the curve's slope with it
_DRAWS = 200
_SPEEDS = 8  # at which the peak is found, for all
_ENDS = 0.01, 0.98  # shares of the points that may lie outside of what they show
_SLIPS = 1e-4, 1.0  # between which it is looked for
_RMS = 0.02  # noise of μ that is expected, over the largest μ
_NODES = (1.0 / 6.0, -math.sqrt(3.0)), (2.0 / 3.0, 0.0), (1.0 / 6.0, math.sqrt(3.0))
_CLEAR = 0.3  # noise of slip over slip: points with more tell little, and bend the curve
_CENTRE = (2.5, 97.5)
_GRID, _HALVINGS = 60, 16  # steps that find a peak, and halvings of the last of them


class Interval(NamedTuple):
    """A value, the median of what it may be, and its 95 % interval."""

    value: float
    low: float
    high: float


class RailFit(NamedTuple):
    """A rail as the slides show it.

    Attributes:
        best: the likeliest curve; constants that cannot be told apart are only together right.
        draws: rails that it may be: the fit's uncertainty, to be carried through.
        scales: what each draw took for the true μ over the one computed; of one seed, the same for
            every axle, as φ's error is.
        told: the constants whose interval is narrow enough, by name.
        below: slip below which μ is largest, at 97.5 %; None where no point is beyond it.
        peak_slip: slip of the largest μ; None where the points do not show it.
        peak_mu: that μ; None where the points do not show it.
        utilisation: mean μ of the slides over the mean of the largest at the same speeds; None as
            `peak_mu`.
        speed: at which the peak stands [m/s].
    """

    best: Condition
    draws: tuple[Condition, ...]
    scales: tuple[float, ...]
    told: dict[str, Interval]
    below: float | None
    peak_slip: Interval | None
    peak_mu: Interval | None
    utilisation: Interval | None
    speed: float


class Points(NamedTuple):
    """Operating points on one rail, in the order of time; shape (n,) each."""

    t: Floats  # [s]
    speed: Floats  # v [m/s]
    slip: Floats
    mu: Floats
    noise: Floats  # σ_s, 1 sigma of the slip's noise
    swing: Floats  # 1 sigma of μ, as far as the log knows it; larger where the brake changes
    clock: Floats  # 1 sigma of slip by the train speed's delay and drift, one error for all
    sliding: Bools  # the others lie between slides


class Bend(NamedTuple):
    """By what a rail's curve may differ from (3): of what g, the logarithm of that, is a sum."""

    bumps: Floats  # ln s of their tops, shape (bumps,)
    slip: float  # ln s and
    speed: float  # ln v at which nothing goes with the speed


# Places among the unknowns: of coded constants, then in sigma, then weights of what bends.
_K_A, _SHARE, _F0, _A, _B, _RADIUS, _DELAY, _WEIGHTS = range(8)
_BY_SPEED = 2  # weights behind those of the bumps: all μ goes with the speed, and the more the slip


def _rail(x: Floats) -> Condition:
    e = math.exp
    k_a = e(x[0])
    return Condition(k_a, k_a / (1.0 + e(-x[1])), e(x[2]), 1.0 / (1.0 + e(-x[3])), e(x[4]))


def _part(k: int, slip: float, speed: float, bend: Bend) -> float:
    """What the weight k bends by."""
    n, at = len(bend.bumps), math.log(max(slip, _SLIPS[0]))
    if k < n:
        far = (at - bend.bumps[k]) / (bend.bumps[1] - bend.bumps[0])
        return math.exp(-0.5 * far * far)
    faster = math.log(max(speed, CREEP_FROM)) - bend.speed
    return faster if k == n else faster * (at - bend.slip)


def _adhesion(slip: float, speed: float, x: Floats, patch: Patch, bend: Bend) -> float:
    """μ on the rail x: (3) e^g."""
    g = 0.0
    for k in range(len(x) - _WEIGHTS):
        g += float(x[_WEIGHTS + k]) * _part(k, slip, speed, bend)
    force = creep_force(slip * speed, speed, _rail(x), patch)[0]
    return math.exp(g) * force / patch.load


def _course(  # noqa: PLR0913
    p: Points, patch: Patch, bend: Bend, radius: float, x: Floats, aside: float, mean: Floats,
    variance: Floats,
) -> None:  # fmt: skip
    """Fills mean and variance of μ where each point may lie, and `aside` of it in slip."""
    for i in range(len(p.slip)):
        slip = _slip(p, radius, x, i) + aside
        first, second = 0.0, 0.0
        for weight, far in _NODES:
            mu = _adhesion(slip + far * p.noise[i], p.speed[i], x, patch, bend)
            first += weight * mu
            second += weight * mu * mu
        mean[i], variance[i] = first, max(second - first * first, 0.0)


def _slip(p: Points, radius: float, x: Floats, i: int) -> float:
    """A point's slip without the errors of radius and delay."""
    rolling = (1.0 - p.slip[i]) * (1.0 + radius * x[_RADIUS])
    return float(1.0 - rolling + p.clock[i] * x[_DELAY])


def _slopes(p: Points, patch: Patch, bend: Bend, radius: float, x: Floats, slopes: Floats) -> None:
    """Fills the slopes of the mean with each unknown, shape (n, unknowns); x is left as it is."""
    n, aside = len(p.slip), _STEP * _SLIPS[0]
    here, there, variance = np.empty(n), np.empty(n), np.empty(n)
    _course(p, patch, bend, radius, x, 0.0, here, variance)
    for m in (_K_A, _SHARE, _A, _B):
        at = x[m]
        x[m] = at + _STEP
        _course(p, patch, bend, radius, x, 0.0, there, variance)
        x[m] = at
        for i in range(n):
            slopes[i, m] = (there[i] - here[i]) / _STEP
    _course(p, patch, bend, radius, x, aside, there, variance)
    for i in range(n):
        steep = (there[i] - here[i]) / aside
        slopes[i, _F0] = here[i] - slopes[i, _K_A]  # c f0, c kA and c kS make c μ
        slopes[i, _RADIUS] = -steep * radius * (1.0 - p.slip[i])
        slopes[i, _DELAY] = steep * p.clock[i]
        for k in range(len(x) - _WEIGHTS):
            slopes[i, _WEIGHTS + k] = here[i] * _part(k, _slip(p, radius, x, i), p.speed[i], bend)


def _peaks(rails: Floats, patch: Patch, bend: Bend, speed: Floats, found: Floats) -> None:
    """Fills slip and μ of the largest adhesion, shape (rails, speeds, 2)."""
    first, whole = math.log(_SLIPS[0]), math.log(_SLIPS[1] / _SLIPS[0])
    for i in range(len(rails)):
        for j in range(len(speed)):
            at, most, step = first, 0.0, whole / _GRID
            for k in range(_GRID + 1):
                mu = _adhesion(math.exp(first + k * step), speed[j], rails[i], patch, bend)
                if mu > most:
                    at, most = first + k * step, mu
            for _ in range(_HALVINGS):
                step *= 0.5
                for side in (at - step, at + step):
                    mu = _adhesion(math.exp(side), speed[j], rails[i], patch, bend)
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
    """Time that each point stands for [s], shape (n,)."""
    h = np.diff(points.t, append=points.t[-1:])
    return np.minimum(h, 2.0 * np.median(h))  # not from slide to slide


def enough(points: Points) -> bool:
    """There is a slide, and time enough in which the slip stands out of its noise."""
    if not points.sliding.any():
        return False
    return bool(_times(points)[_clear(points)].sum() >= SHORTEST)


def fit(
    points: Points, vehicle: Vehicle, radius_error: float, mu_error: float, seed: int = 0
) -> RailFit | None:
    """The rail under the points; None where there are too few, or no curve goes through them.

    Args:
        points: of slides and between them, without NaN.
        vehicle: for the load; the contact is `rail.Contact`'s.
        radius_error: 1 sigma of wheel radius over train speed, as a share of it.
        mu_error: 1 sigma of μ's scale over μ.
        seed: of the draws.
    """
    patch = Contact().patch(vehicle.axle_mass.value * G)
    if not enough(points):
        return None
    clear, h = _clear(points), _times(points)
    some = np.flatnonzero(clear)[:: max(1, -(-int(clear.sum()) // _MOST))]
    p = Points._make(column[some] for column in points)
    level, n = max(float(np.quantile(np.abs(p.mu), 0.9)), 1e-6), len(some)
    size = len(_WIDE) + 2
    known, wide = np.zeros(size), np.ones(size)
    known[:_RADIUS], wide[:_RADIUS] = _coded(_USUAL), _WIDE
    low, high = np.quantile(p.slip, _ENDS).tolist()
    bend = _bend(p, low, high)
    search = _Search(p, patch, bend, radius_error, known, wide)

    rough = search._replace(p=p._replace(noise=np.zeros(n)))
    starts = [np.append(_coded(rail), (0.0, 0.0)) for rail in conditions().values()]
    ends = [rough.run(_RMS * level, x) for x in starts]
    sigma = min(f.rms for f in ends) * _RMS * level
    if sigma > _LEFT * level:
        return None
    best = max((search.run(sigma, f.x) for f in ends), key=lambda f: f.likely)
    best = search.run(sigma, best.x)
    weak = search._replace(weight=1.0 / math.sqrt(_alike(p.t, best.left)))

    random = np.random.default_rng(seed)
    scales = np.exp(mu_error * random.standard_normal(_DRAWS))
    draws = np.empty((_DRAWS, size))
    for j in range(_DRAWS):
        draws[j] = weak.draw(sigma, best.x, random)
    curves = _bent(search, sigma, draws, best.x, random)
    if curves is None:
        return None
    for drawn in (draws, curves):
        drawn[:, [_K_A, _F0]] += np.log(scales)[:, None]  # kA, and kS with it, and f0 go with μ
    rails = [_rail(x) for x in draws]
    told = {}
    for name in Condition._fields:
        spread = _interval([getattr(rail, name) for rail in rails])
        if _narrow(spread):
            told[name] = spread

    slides = points.speed[points.sliding]
    speed, speeds = float(np.median(slides)), np.linspace(slides.min(), slides.max(), _SPEEDS)
    peaks = np.empty((_DRAWS, 1 + _SPEEDS, 2))
    compiled.function(_peaks)(curves, patch, bend, np.append(speed, speeds), peaks)
    at, mu = (_interval(peaks[:, 0, i]) for i in (0, 1))
    below = max(at.high, low)  # of less slip there are no points
    passed = below < high
    # That friction falls as it does where it is seen is (3)'s: nothing leads back on a bent curve.
    bent = curves[:, _WEIGHTS:].any(axis=1)
    blind = bent.mean() > 0.5 and 100.0 * np.mean(bent & (peaks[:, 0, 0] < low)) > _CENTRE[0]
    tall = passed and _narrow(mu) and not blind
    used = _utilisation(points, h, curves, scales, radius_error, speeds, peaks[:, 1:, 1])
    return RailFit(
        _rail(best.x),
        tuple(rails),
        tuple(scales.tolist()),
        told,
        below if passed else None,
        at if passed and low < at.value and _narrow(at) else None,
        mu if tall else None,
        _interval(used) if tall else None,
        speed,
    )


def _utilisation(  # noqa: PLR0913
    p: Points, h: Floats, draws: Floats, scales: Floats, radius: float, speeds: Floats,
    could: Floats,
) -> Floats:  # fmt: skip
    """Mean μ of the slides over that of the largest at the same speeds, by each draw; (draws,).

    A draw's radius and delay are other slips, and slides that begin and end elsewhere.

    Args:
        p: all points.
        h: the time that each stands for [s].
        draws: unknowns, of each draw.
        scales: true μ over the computed one, of each draw.
        radius: 1 sigma, as a share of it.
        speeds: at which the largest μ is known [m/s].
        could: that, shape (draws, speeds).
    """
    found = np.empty(len(draws))
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
    left: Floats  # errors beside it, in sigma, shape (n,)
    likely: float  # logarithm of how likely the points are on such curves, but for a constant
    errors: Floats  # those as weighed and, behind, of what is known; shape (n + unknowns,)
    slopes: Floats  # of these with the unknowns, shape (n + unknowns, unknowns)

    @property
    def rms(self) -> float:
        return math.sqrt(float(self.left @ self.left) / len(self.left))


class _Search(NamedTuple):
    """Least squares of the errors beside the curve, and of what is known beforehand."""

    p: Points
    patch: Patch
    bend: Bend
    radius: float  # 1 sigma, as a share of it
    known: Floats  # of the unknowns, shape (unknowns,)
    wide: Floats  # 1 sigma of that
    weight: float = 1.0  # of a point's error

    def run(self, sigma: float, start: Floats, other: Floats | float = 0.0) -> _Found:
        """The best curve.

        Args:
            sigma: of the noise of μ.
            start: of the unknowns; the noise of slip weighs as the curve there makes noise of μ
                of it. Weighed anew on the way, a curve that is steep or bent would be at its best.
            other: errors taken to be in μ besides, in sigma of what a point weighs.
        """
        from scipy.optimize import least_squares

        course, slopes = compiled.function(_course), compiled.function(_slopes)
        what = self.p, self.patch, self.bend, self.radius
        n, size = len(self.p.t), len(start)
        mean, variance, by = np.empty(n), np.empty(n), np.empty((n, size))
        course(*what, np.clip(start, *_INSIDE), 0.0, mean, variance)
        noise = np.sqrt(sigma * sigma + self.p.swing**2 + variance)

        def beside(x: Floats) -> Floats:
            course(*what, np.clip(x, *_INSIDE), 0.0, mean, variance)
            errors: Floats = (self.p.mu - mean) / noise
            return errors

        def left(x: Floats) -> Floats:
            both: Floats = np.append(self.weight * beside(x) + other, (x - self.known) / self.wide)
            return both

        def slope(x: Floats) -> Floats:
            slopes(*what, np.clip(x, *_INSIDE), by)
            weighed = -self.weight * by / noise[:, None]
            both: Floats = np.concatenate([weighed, np.diag(1.0 / self.wide)])
            return both

        found = least_squares(
            left, start, slope, method="lm", max_nfev=_EVALUATIONS, ftol=_CLOSE, xtol=_CLOSE
        )
        volume = float(np.linalg.slogdet(found.jac.T @ found.jac)[1])
        wide = float(np.log(self.wide).sum() + self.weight**2 * np.log(noise).sum())
        likely = -float(found.cost) - 0.5 * volume - wide
        at = np.clip(found.x, *_INSIDE)
        return _Found(at, beside(found.x), likely, found.fun, found.jac)

    def draw(self, sigma: float, start: Floats, random: np.random.Generator) -> Floats:
        """The unknowns of the best curve for other errors, as likely as those that are left."""
        known = self.known + self.wide * random.standard_normal(len(start))
        other = random.standard_normal(len(self.p.t))
        return self._replace(known=known).run(sigma, start, other).x


def _bend(p: Points, low: float, high: float) -> Bend:
    """What can bend a curve with points from one slip to the other, and the flank before them."""
    count = max(1, round(math.log(high / low) / _BUMP))
    bumps = math.log(low) + math.log(high / low) / count * np.arange(-1.0, count + 1)
    return Bend(bumps, float(np.median(np.log(p.slip))), float(np.median(np.log(p.speed))))


def _bent(
    straight: _Search, sigma: float, draws: Floats, best: Floats, random: np.random.Generator
) -> Floats | None:
    """Draws of the curve that the rail may have, be it (3) or not, shape (draws, unknowns).

    None where the points are of two rails.

    Args:
        straight: search among curves (3).
        sigma: of the noise of μ beside them.
        draws: of these curves, kept as far as the points make them likely.
        best: of these curves.
        random: for the others.
    """
    more = np.zeros(len(straight.bend.bumps) + _BY_SPEED)
    searches = [straight]
    for weight in _BENT:
        known, wide = np.append(straight.known, more), np.append(straight.wide, more + weight)
        searches.append(straight._replace(known=known, wide=wide))
    start = np.append(best, more)
    sigma *= searches[-1].run(sigma, start).rms
    weight = 1.0 / math.sqrt(_alike(straight.p.t, searches[-1].run(sigma, start).left))
    searches = [of._replace(weight=weight) for of in searches]
    found = [of.run(sigma, start[: len(of.known)]) for of in searches]
    if _stepped(straight.p.t, found[-1], weight):
        return None
    share = np.exp([f.likely - max(f.likely for f in found) for f in found])
    count = len(draws)
    which = np.searchsorted(np.cumsum(share) / share.sum(), (np.arange(count) + 0.5) / count)
    curves = np.pad(draws, ((0, 0), (0, len(more))))
    for j in np.flatnonzero(which).tolist():
        curves[j] = searches[which[j]].draw(sigma, found[which[j]].x, random)
    return curves


def _stepped(t: Floats, f: _Found, weight: float) -> bool:
    """All μ is another one from some time on, whatever else the unknowns may explain.

    The errors that a step has to outdo are those that it leaves: beside one curve for two rails
    they are the step's own.

    Args:
        t: of the points [s].
        f: the best of the curves that may bend.
        weight: of a point's error in it.
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
    """So many points count as one: their errors are alike for a while, or as few know all."""
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
