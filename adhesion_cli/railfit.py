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

The intervals hold for rails whose curve is (3); docs/slip.md has what they are worth on others.

A constant is told if its 95 % interval is narrower than a factor of `_TOLD`. So are slip and μ of
the peak, at the slides' middle speed, if there are points beyond it. The slip must have points on
both sides. μ needs none before it: friction that falls with sliding leads back to the peak's height
where the flank is not seen, and then the slip is told to be less than so much. Where no curve goes
through the points, because the rail changed under the slides, there is no fit.

Adhesion utilisation, a term of EN 15595 (whose text was not at hand), is here the mean over time of
μ in the slides over that of the largest μ at the same speeds: the share that was used of what could
have been. The curve goes through the points, so only their errors can bring it above 1.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from . import compiled
from .model import Bools, Floats, Vehicle
from .physics import G
from .rail import Condition, Contact, Patch, conditions, creep_force

_MOST = 400  # points of a fit
_SHORTEST = 8.0  # points of less time show no spread of errors [s]
_STRETCHES = 0.25, 0.5, 1.0, 2.0  # over which errors may be alike [s]
_INDEPENDENT = 100.0  # points that count at most: (3) is no better than that
_TOLD = 3.0  # widest interval of a constant that is told, high over low
# Before any point is seen, coded, around Polach's sets; 1 sigma of the logarithms.
_USUAL = Condition(k_a=0.5, k_s=0.2, f0=0.1, A=0.4, B=0.3)
_WIDE = 1.3, 1.3, 1.5, 1.3, 1.3
_LEFT = 0.15  # largest rms beside the curve, over the largest μ
_EVALUATIONS = 50
_INSIDE = -12.0, 3.0  # unknowns beyond are no rail, and exponentials overflow
_CLOSE = 1e-4  # relative change at which a search ends
_STEP = 1e-6  # of an unknown, for the errors' slope with it
_DRAWS = 200
_SPEEDS = 8  # at which the peak is found, for all
_ENDS = 0.01, 0.98  # shares of the points that may lie outside of what they show
_SLIPS = 1e-4, 1.0  # between which it is looked for
_RMS = 0.02  # noise of μ that is expected, over the largest μ
_NODES = (1.0 / 6.0, -math.sqrt(3.0)), (2.0 / 3.0, 0.0), (1.0 / 6.0, math.sqrt(3.0))
_CLEAR = 0.3  # noise of slip over slip: points with more tell little, and bend the curve
_CENTRE = (2.5, 97.5)
_HALVINGS = 40  # that find a peak


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
    clock: Floats  # 1 sigma of slip by the train speed's delay and drift, one error for all
    sliding: Bools  # the others lie between slides


_RADIUS, _DELAY = 5, 6  # places among the unknowns, in sigma, behind the coded constants


def _rail(x: Floats) -> Condition:
    e = math.exp
    k_a = e(x[0])
    return Condition(k_a, k_a / (1.0 + e(-x[1])), e(x[2]), 1.0 / (1.0 + e(-x[3])), e(x[4]))


def _errors(p: Points, patch: Patch, radius: float, sigma: float, x: Floats, left: Floats) -> None:
    """Fills the errors beside the curve, over their sigma; `sigma` is that of μ's noise."""
    rail = _rail(x)
    for i in range(len(p.slip)):
        v, noise = p.speed[i], p.noise[i]
        slip = 1.0 - (1.0 - p.slip[i]) * (1.0 + radius * x[_RADIUS]) + p.clock[i] * x[_DELAY]
        mean, square = 0.0, 0.0
        for weight, far in _NODES:
            mu = creep_force((slip + far * noise) * v, v, rail, patch)[0] / patch.load
            mean += weight * mu
            square += weight * mu * mu
        variance = sigma * sigma + max(square - mean * mean, 0.0)
        left[i] = (p.mu[i] - mean) / math.sqrt(variance)


def _slopes(
    p: Points, patch: Patch, radius: float, sigma: float, x: Floats, slopes: Floats
) -> None:
    """Fills the errors' slopes with each unknown, shape (n, unknowns); x is left as it is."""
    more, less = np.empty(len(p.slip)), np.empty(len(p.slip))
    _errors(p, patch, radius, sigma, x, less)
    for m in range(len(x)):
        at = x[m]
        x[m] = at + _STEP
        _errors(p, patch, radius, sigma, x, more)
        x[m] = at
        for i in range(len(less)):
            slopes[i, m] = (more[i] - less[i]) / _STEP


def _peaks(rails: Floats, patch: Patch, speed: Floats, found: Floats) -> None:
    """Fills slip and μ of the largest adhesion, shape (rails, speeds, 2)."""
    for i in range(len(rails)):
        rail = _rail(rails[i])
        for j in range(len(speed)):
            a, b, v = math.log(_SLIPS[0]), math.log(_SLIPS[1]), speed[j]
            for _ in range(_HALVINGS):
                middle = 0.5 * (a + b)
                if creep_force(math.exp(middle) * v, v, rail, patch)[1] > 0.0:
                    a = middle
                else:
                    b = middle
            found[i, j, 0] = math.exp(0.5 * (a + b))
            found[i, j, 1] = creep_force(found[i, j, 0] * v, v, rail, patch)[0] / patch.load


def curve(rail: Condition, speed: float, slip: Floats, vehicle: Vehicle) -> Floats:
    """μ at a train speed [m/s] and each slip, shape of `slip`."""
    patch = Contact().patch(vehicle.axle_mass.value * G)
    mu = [creep_force(s * speed, speed, rail, patch)[0] / patch.load for s in slip.tolist()]
    return np.array(mu)


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
    clear = points.noise < _CLEAR * points.slip
    h = np.diff(points.t, append=points.t[-1:])
    h = np.minimum(h, 2.0 * np.median(h))  # not from slide to slide
    if h[clear].sum() < _SHORTEST or not points.sliding.any():
        return None
    some = np.flatnonzero(clear)[:: max(1, -(-int(clear.sum()) // _MOST))]
    p = Points._make(column[some] for column in points)
    level, n = max(float(np.quantile(np.abs(p.mu), 0.9)), 1e-6), len(some)
    size = len(_WIDE) + 2
    known, wide = np.zeros(size), np.ones(size)
    known[:_RADIUS], wide[:_RADIUS] = _coded(_USUAL), _WIDE
    search = _Search(p, patch, radius_error, known, wide)

    rough = search._replace(p=p._replace(noise=np.zeros(n)))
    starts = [np.append(_coded(rail), (0.0, 0.0)) for rail in conditions().values()]
    best, left = min((rough.run(_RMS * level, x) for x in starts), key=lambda f: rough.cost(*f))
    sigma = math.sqrt(float(left @ left) / n) * _RMS * level
    if sigma > _LEFT * level:
        return None
    best, left = search.run(sigma, best)
    alike = _alike(p.t, left)
    weak = search._replace(weight=1.0 / math.sqrt(alike))

    random = np.random.default_rng(seed)
    scales = np.exp(mu_error * random.standard_normal(_DRAWS))
    draws = np.empty((_DRAWS, size))
    for j in range(_DRAWS):
        other = known + wide * random.standard_normal(size)
        draws[j] = weak._replace(known=other).run(sigma, best, random.standard_normal(n))[0]
    draws[:, [0, 2]] += np.log(scales)[:, None]  # kA, and kS with it, and f0 go with μ
    rails = [_rail(x) for x in draws]
    told = {}
    for name in Condition._fields:
        spread = _interval([getattr(rail, name) for rail in rails])
        if _narrow(spread):
            told[name] = spread

    slides = points.speed[points.sliding]
    speed, speeds = float(np.median(slides)), np.linspace(slides.min(), slides.max(), _SPEEDS)
    peaks = np.empty((_DRAWS, 1 + _SPEEDS, 2))
    compiled.function(_peaks)(draws, patch, np.append(speed, speeds), peaks)
    at, mu = (_interval(peaks[:, 0, i]) for i in (0, 1))
    low, high = np.quantile(p.slip, _ENDS).tolist()
    passed = at.high < high
    hats = [np.interp(slides, speeds, unit) for unit in np.eye(_SPEEDS)]
    h = h[points.sliding]
    could = peaks[:, 1:, 1] @ np.average(hats, axis=1, weights=h)
    used = _interval(scales * np.average(points.mu[points.sliding], weights=h) / could)
    return RailFit(
        _rail(best),
        tuple(rails),
        tuple(scales.tolist()),
        told,
        at.high if passed else None,
        at if passed and low < at.value and _narrow(at) else None,
        mu if passed and _narrow(mu) else None,
        used if passed and _narrow(mu) else None,
        speed,
    )


class _Search(NamedTuple):
    """Least squares of the errors beside the curve, and of what is known beforehand."""

    p: Points
    patch: Patch
    radius: float  # 1 sigma, as a share of it
    known: Floats  # of the unknowns, shape (unknowns,)
    wide: Floats  # 1 sigma of that
    weight: float = 1.0  # of a point's error

    def cost(self, x: Floats, beside: Floats) -> float:
        """What `run` makes small, of what it returns."""
        return float(
            np.sum((self.weight * beside) ** 2) + np.sum(((x - self.known) / self.wide) ** 2)
        )

    def run(
        self, sigma: float, start: Floats, other: Floats | float = 0.0
    ) -> tuple[Floats, Floats]:
        """The unknowns of the best curve, and the errors beside it in sigma, shape (n,).

        Args:
            sigma: of the noise of μ.
            start: of the unknowns.
            other: errors taken to be in μ besides, in sigma of what a point weighs.
        """
        from scipy.optimize import least_squares

        errors, slopes = compiled.function(_errors), compiled.function(_slopes)
        what = self.p, self.patch, self.radius, sigma
        n, size = len(self.p.t), len(start)
        beside, by = np.empty(n), np.empty((n, size))

        def left(x: Floats) -> Floats:
            errors(*what, np.clip(x, *_INSIDE), beside)
            both: Floats = np.append(self.weight * beside + other, (x - self.known) / self.wide)
            return both

        def slope(x: Floats) -> Floats:
            slopes(*what, np.clip(x, *_INSIDE), by)
            both: Floats = np.concatenate([self.weight * by, np.diag(1.0 / self.wide)])
            return both

        found = least_squares(
            left, start, slope, method="lm", max_nfev=_EVALUATIONS, ftol=_CLOSE, xtol=_CLOSE
        )
        left(found.x)
        return np.clip(found.x, *_INSIDE), beside


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
