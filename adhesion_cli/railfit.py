"""What slides say of the rail: Polach's constants and the peak of the curve, each with an interval.

The curve (3) with the patent's friction law is fitted to the s–μ points of the slides, least
squares in the logarithms (A: in the logit) of f0, A, B, kA and kS.

Intervals are from a bootstrap. The points follow one another in time and their errors with them, so
stretches of `_BLOCK` seconds are drawn anew, not points; and each draw takes another wheel radius,
another delay of the train speed and another scale of μ, as uncertain as they are, because an error
of one of them is in every point. A
constant that the points do not decide must not stay where the search began: a weak anchor holds it,
and each draw has another, far around. A constant whose interval is wider than a factor of `_TOLD`
is not told: that is where another value of another constant does the same to the curve. The peak is
that of the fitted curve at the slides' middle speed; it is told only if nearly every draw has it
among the points. Where no curve goes through the points, because the rail changed under the slides,
there is no fit.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from . import compiled
from .model import Floats, Vehicle
from .physics import G
from .rail import Condition, Contact, Patch, conditions, creep_force

_BLOCK = 1.0  # s
_MOST = 800  # points of a fit
_DRAWS = 100
_BLOCKS = 8  # fewer show no spread
_TOLD = 3.0  # widest interval of a constant that is told, high over low
_TRUST = 0.02  # weight of the anchor, over that of one point
_WIDE = 1.0  # 1 sigma of a draw's anchor, in the logarithm
_CENTRE = (2.5, 97.5)
_LEFT = 0.15  # largest rms beside the curve, over the largest μ
_EVALUATIONS = 150
_GRID = 4000  # slips among which the peak is looked for: 0.2 % apart


class Interval(NamedTuple):
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float


class RailFit(NamedTuple):
    """A rail as the slides show it.

    Attributes:
        best: the curve through all points; constants that cannot be told apart are only together
            right.
        draws: the same of every bootstrap draw: the fit's uncertainty, to be carried through.
        scales: what each draw took for the true μ over the one computed; of one seed, the same for
            every axle, as φ's error is.
        told: the constants whose interval is narrow enough, by name.
        peak_slip: slip of the largest μ; None where the points do not show it.
        peak_mu: that μ; None where the points do not show it.
        speed: at which the peak stands [m/s].
    """

    best: Condition
    draws: tuple[Condition, ...]
    scales: tuple[float, ...]
    told: dict[str, Interval]
    peak_slip: Interval | None
    peak_mu: Interval | None
    speed: float


class Points(NamedTuple):
    """Operating points of slides on one rail, in the order of time; shape (n,) each."""

    t: Floats  # [s]
    speed: Floats  # v [m/s]
    slip: Floats
    mu: Floats
    clock: Floats  # 1 sigma of slip by the train speed's delay, one error for all


def _curve(rail: Condition, patch: Patch, speed: Floats, slip: Floats, mu: Floats) -> None:
    """Fills μ by (3)."""
    for i in range(len(slip)):
        mu[i] = creep_force(slip[i] * speed[i], speed[i], rail, patch)[0] / patch.load


def fit(
    points: Points, vehicle: Vehicle, radius_error: float, mu_error: float, seed: int = 0
) -> RailFit | None:
    """The rail under the points; None where there are too few, or no curve goes through them.

    Args:
        points: of slides, without NaN.
        vehicle: for the load; the contact is `rail.Contact`'s.
        radius_error: 1 sigma of wheel radius over train speed, as a share of it.
        mu_error: 1 sigma of μ's scale over μ.
        seed: of the bootstrap.
    """
    patch = Contact().patch(vehicle.axle_mass.value * G)
    block = np.floor(points.t / _BLOCK).astype(np.int64)
    blocks = [np.flatnonzero(block == b) for b in np.unique(block)]
    if len(blocks) < _BLOCKS:
        return None
    every = max(1, -(-len(points.t) // _MOST))
    start = min(
        (_solve(points, every, patch, x, x) for x in map(_coded, conditions().values())),
        key=lambda found: found[1],
    )
    best, cost = start
    if math.sqrt(2.0 * cost / len(points.t[::every])) > _LEFT:
        return None
    random = np.random.default_rng(seed)
    scales = 1.0 + mu_error * random.standard_normal(_DRAWS)
    draws = []
    for scale in scales:
        taken = np.concatenate([blocks[i] for i in random.integers(0, len(blocks), len(blocks))])
        turn, late = radius_error * random.standard_normal(), random.standard_normal()
        drawn = Points(
            points.t[taken],
            points.speed[taken],
            1.0 - (1.0 - points.slip[taken]) * (1.0 + turn) + late * points.clock[taken],
            points.mu[taken] * scale,
            points.clock[taken],
        )
        anchor = best + _WIDE * random.standard_normal(len(best))
        draws.append(_solve(drawn, every, patch, best, anchor)[0])
    rails = [_decoded(x) for x in draws]
    speed = float(np.median(points.speed))
    told = {}
    for name in Condition._fields:
        spread = _interval(getattr(_decoded(best), name), [getattr(rail, name) for rail in rails])
        if spread.high < _TOLD * spread.low:
            told[name] = spread
    peaks = [_peak(rail, patch, speed, points.slip) for rail in (_decoded(best), *rails)]
    seen = [p for p in peaks if p is not None]
    peak_slip = peak_mu = None
    if peaks[0] and len(seen) >= 0.95 * len(peaks):
        peak_slip, peak_mu = (_interval(seen[0][i], [p[i] for p in seen[1:]]) for i in (0, 1))
    return RailFit(
        _decoded(best), tuple(rails), tuple(scales.tolist()), told, peak_slip, peak_mu, speed
    )


def _solve(
    points: Points, every: int, patch: Patch, start: Floats, anchor: Floats
) -> tuple[Floats, float]:
    """Coded constants of the best curve, and its cost."""
    from scipy.optimize import least_squares

    p = Points(*(np.ascontiguousarray(column[::every]) for column in points))
    scale = max(float(np.quantile(np.abs(p.mu), 0.9)), 1e-6)
    model = np.empty(len(p.t))
    curve = compiled.function(_curve)

    def left(x: Floats) -> Floats:
        curve(_decoded(x), patch, p.speed, p.slip, model)
        held = _TRUST * (x - anchor)
        both: Floats = np.concatenate([(model - p.mu) / scale, held])
        return both

    found = least_squares(left, start, method="lm", max_nfev=_EVALUATIONS)
    x: Floats = found.x
    return x, float(found.cost)


def _coded(rail: Condition) -> Floats:
    """Logarithms, and the logit of A, which lies between 0 and 1."""
    x: Floats = np.log(np.array(rail))
    x[3] = math.log(rail.A / (1.0 - rail.A))
    return x


def _decoded(x: Floats) -> Condition:
    k_a, k_s, f0, A, B = (float(v) for v in np.clip(x, -12.0, 3.0))
    e = math.exp
    return Condition(e(k_a), e(k_s), e(f0), 1.0 / (1.0 + e(-A)), e(B))


def _interval(value: float, draws: Sequence[float]) -> Interval:
    low, high = np.percentile(draws, _CENTRE)
    return Interval(value, float(low), float(high))


def _peak(rail: Condition, patch: Patch, speed: float, slip: Floats) -> tuple[float, float] | None:
    """Slip and μ of the largest adhesion; None at the edge of where there are points."""
    low, high = (float(x) for x in np.quantile(slip, [0.01, 0.98]))
    grid = np.geomspace(max(low, 1e-4), max(high, 2e-4), _GRID)
    mu = np.empty(len(grid))
    compiled.function(_curve)(rail, patch, np.full(len(grid), speed), grid, mu)
    at = int(np.argmax(mu))
    return (float(grid[at]), float(mu[at])) if 0 < at < len(grid) - 1 else None
