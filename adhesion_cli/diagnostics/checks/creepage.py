"""An axle whose wheels creep less than its brake force says, or a pressure that is too low.

The creepage of a braked wheel that rolls grows with its brake force. Against the train speed v,

    ωR = v (1 + c) − k v µ + τ dv/dt,

with µ by pressure and vehicle, the error c of the radius, the creepage k for each µ, which one rail
has for all axles alike, and the delay τ between the two speeds. A rail that is wet under one axle
makes k larger, never smaller. So a larger one counts only with a pressure below the others'. An
axle that is heavier than the others has a smaller one, too.
"""

import math
from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.model import Z95, Bools, Floats, fraction
from ...core.physics import CRAWL, G
from ...train.grid import FEWEST
from ..registry import About
from ..scene import Scene

ABOUT = About("Creepage against the other axles", "creepage", 10)
_FEWEST_AXLES = 3  # of two, either may be wrong
_LEAST_CREEPAGE = 0.005  # for each µ: no rail is as stiff
_UNLIKE_LOADS = 0.08  # 1 sigma of one axle's mass against the others', where none is stated
_BLOCK = 1.0  # errors of a train speed are alike within that time [s]


class Params(NamedTuple):
    """Thresholds."""

    least: Annotated[float, fraction("of the others' creepage: rail and loads differ")] = 0.85
    sure: Annotated[float, fraction("1 sigma of a share that says something")] = 0.1
    lower: Annotated[float, fraction("of the others' brake force: the pressure may be wrong")] = 0.9


class _Creepages(NamedTuple):
    """The creepage of each axle for each µ, k of the equation; shape (axles,)."""

    value: Floats
    sigma: Floats  # 1 sigma against the other axles
    error: float  # 1 sigma of what all axles share: errors of the train speed [m/s]
    weights: Floats  # of the speeds in the value (axles, blocks) [s/m]

    def common(self, i: int, share: float) -> float:
        """1 sigma of the value of axle i less a share of the others', by what all axles share.

        Most of it cancels where their brakes act at the same times.
        """
        others = np.delete(self.weights, i, axis=0).mean(axis=0)
        return self.error * float(np.linalg.norm(self.weights[i] - share * others))


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """One finding for each axle that surely brakes otherwise than pressure and vehicle say."""
    if s.grid.train is None or len(s.axles) < _FEWEST_AXLES:
        return
    creepages = _creepages(s, s.grid.train)
    if creepages is None:
        return
    brakes = np.nansum(s.grid.clamping, axis=1)
    for i, (value, sigma) in enumerate(zip(creepages.value, creepages.sigma, strict=True)):
        others = np.delete(creepages.value, i)
        usual = float(np.median(others))
        agree = (np.abs(others - usual) < (1.0 - p.least) * usual).sum()
        if usual < max(4.0 * creepages.common(i, 0.0), _LEAST_CREEPAGE) or 2 * agree <= len(
            creepages.value
        ):
            continue  # no majority says what is usual
        share = float(value) / usual
        by_load = share * min(
            s.vehicle.of_axle(s.axles[i].record.axle).axle_mass.share, _UNLIKE_LOADS
        )
        noise = float(np.hypot(sigma, creepages.common(i, share))) / usual
        share_sigma = math.hypot(noise, by_load)
        u95 = Z95 * share_sigma
        is_more = share - u95 > 1.0 / p.least and brakes[i] < p.lower * np.median(brakes)
        if share_sigma < p.sure * max(share, 1.0) and (share + u95 < p.least or is_more):
            values = {"share": share, "share_u95": u95}
            names = {"axle": str(s.axles[i].record.axle)}
            brake = s.axles[i].brake
            yield s.finding("axle-force-suspect", "warning", brake, None, i, values, names)


def _creepages(s: Scene, v: Floats) -> _Creepages | None:
    """The creepages, by the train speed (n,) [m/s]; None where the log does not show them."""
    g, fits = s.grid, []
    used = g.rolling.all(axis=0) & np.isfinite(g.braking) & (v > 2.0 * CRAWL)
    size = max(1, round(_BLOCK / g.step))
    columns = []
    for a, rim, K in zip(s.axles, g.rim, g.clamping, strict=True):
        vehicle = s.vehicle.of_axle(a.record.axle)
        mu = vehicle.friction.value * K / (vehicle.axle_mass.value * G)
        columns.append([v, -v * mu, g.slope(v), rim - v])
    used &= np.isfinite(columns).all(axis=(0, 1))  # the same times of all axles
    for of_axle in columns:
        blocks = _means(np.where(used, of_axle, 0.0), used, size)
        if (fit := _fit(blocks[:3].T, blocks[3])) is None:
            return None
        fits.append(fit)
    values, weights, residuals = (np.array(x) for x in zip(*fits, strict=True))
    others = (residuals.sum(axis=0) - residuals) / (len(fits) - 1)
    freedom = residuals.shape[1] - 3
    own, total = (np.sum(r**2, axis=1) / freedom for r in (residuals - others, residuals))
    sigma = np.sqrt(own) * np.linalg.norm(weights, axis=1)
    return _Creepages(values, sigma, float(np.sqrt(total.max())), weights)


def _fit(A: Floats, y: Floats) -> tuple[float, Floats, Floats] | None:
    """k, the weights of y in it [s/m], and what is left [m/s]; None where not shown."""
    if len(y) < FEWEST or np.linalg.matrix_rank(A) < A.shape[1]:
        return None
    inverse = np.linalg.pinv(A)
    x = inverse @ y
    return float(x[1]), inverse[1], y - A @ x


def _means(columns: Floats, known: Bools, size: int) -> Floats:
    """Means of the known samples over blocks of so many, without blocks of few, (m, blocks)."""
    starts = np.arange(0, len(known), size)
    counts = np.add.reduceat(known.astype(np.float64), starts)
    full = counts > size / 2.0
    means: Floats = np.add.reduceat(columns, starts, axis=1)[:, full] / counts[full]
    return means
