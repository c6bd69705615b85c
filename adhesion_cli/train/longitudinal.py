"""The train's longitudinal model: one joint fit of all brake applications.

While every wheel rolls, the wheelset equation and the force line give the rim speed from the
pressure. In each piece of a log, up to 12 s long,

    u(t) = α + γt² + (β − r) t − C ∫ u² dt − s c ∫ k dt − u s c k / (g κ),
    k(t) = (1 + f (u − ū)) max(K(t + τ) − o, 0).

K is the clamping force as a share of its highest value, c the deceleration by that.

| symbol | parameter |
|---|---|
| s, o | factor and offset of the force line |
| τ | delay of the pressure |
| κ = dµ/ds | creep stiffness: a braked wheel that rolls turns slower than the train by µ/κ |
| f | change of the friction with speed |
| r, C | running resistance of the train at low speed, its air drag over u² |
| β | gradient of the piece |

Delay and creep look the same within one application: both make the wheel react earlier. So each
parameter has a prior, and the fit gives the posterior of all together. Its maximum is found by
Gauss and Newton's method, its covariance is Laplace's. α and γ are eliminated in every piece.

A calibration takes shorter pieces without γ, and a gradient that changes along the track. Without
that a gradient that begins with a brake application is taken for force.

Every piece has its own error variance, which is estimated as well. A slide that was not recognised
gives its piece a large variance and so little weight. Errors that are correlated from sample to
sample count as fewer samples.

The rows are pieces, the parameters are shared: `fit` takes the designs of one or many logs.

Sources: wheelset equation (1), force line (15); creep stiffness of 20 to 100 % of Kalker's. Air
drag: Rochard and Schmid, Proc. IMechE F 214 (2000) 185: 1.7e-5 1/m (long high-speed train); single
vehicles have up to 7e-5 1/m, by 0.6 kg/m³ times 10 m² over 80 t.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.model import Bools, Floats, Parameter, Vehicle
from ..core.physics import CRAWL, FREE, G, braked, force_line, wheelset
from ..core.signals import true_runs, white_noise
from ..records.axle_channels import AxleChannels
from .explanation import AS_STATED, Design, Explanation, Line, Piece
from .grid import LEAST, Grid, far, grid

UNITS = {
    "scale": "ln", "offset": "-", "delay": "s", "stiffness": "ln", "fade": "s/m",
    "resistance": "m/s²", "drag": "1/m",
}  # fmt: skip
SCALE, OFFSET, DELAY, STIFFNESS, FADE, RESISTANCE, DRAG = range(len(UNITS))
_SHARED = len(UNITS)
CREEP = Parameter(math.log(22.0), 0.6)  # ln of 8 to 60 per unit of slip
_FADE = Parameter(0.0, 0.004)  # friction changes by some 10 % over 25 m/s [s/m]
_RESISTANCE = Parameter(0.015, 0.015)  # [m/s²]
_DRAG = Parameter(3e-5, 2e-5)  # [1/m]
_ABSORBED = Parameter(0.0, 1e-9)  # by the gradient and γ of long pieces, in a diagnosis [1/m]
_GRADIENT = 0.1  # 1 sigma of a gradient: 10 per mille [m/s²]
_CHANGES = 0.05  # 1 sigma by which it changes from piece to piece of one application [m/s²]
_SLOPES = 0.05  # 1 sigma of gradients along the track: 5 per mille, assumed [m/s²]
_ALONG = 1000.0  # they are correlated by exp(-x) over so many [m], assumed
_OWN = 0.005  # 1 sigma of what is not correlated: curves, wind [m/s²]
_SMALL = 0.03  # 1 sigma of the delay by calipers, hoses and transducers [s]
_ZERO = 0.01  # 1 sigma of a pressure sensor's zero, of the highest K

FINE = 0.05  # step of the grid, where the log is fast enough [s]
_CHANGE = 0.1  # of the highest K within a second: a build-up, a release
_AROUND = 6.0  # before and after a change [s]
_PIECE = 12.0  # longest piece [s]
_SHORT = 3.0  # the same where gradients are along the track [s]
_BENT = 20  # samples: with fewer, γ is not known from what happens between two
_REACH = 5.0  # the largest delay that is looked for [s]
_MOST = 0.9  # the largest offset looked for, of the highest K
_STEEPEST = 30.0  # and the largest factor
_FLOOR = 0.005  # 1 sigma by which the model misses a rolling wheel's speed [m/s]
_PARTS = 1.0, 0.5, 0.2, 0.05  # of a step that are tried
_STARTS = 64  # points that all fits of one design begin at, or fewer
_CONVERGED = 0.05  # a smaller gain of a step ends the search
_SINGULAR = 1e-9  # a smaller share left by the other parameters is rounding
_FACTORS = np.exp(np.linspace(math.log(0.05), math.log(20.0), 40))

CLEARLY = 12.0  # gain of another cause that is clear: twice the log of the likelihood
AS_GOOD = 8.0  # two causes with less between them cannot be separated
SIGMAS = 3.5  # of the stated tolerances are no other vehicle
_NOISY = 2.0  # times its noise is left of a speed that is explained
_SURE = 4.0  # sigma from zero is a delay
_LEAST_DELAY = 0.1  # a shorter one is the caliper's [s]
_SHARE = 0.75  # of the longer sampling interval: less may be the sampling's own
_SLIGHT = 0.05  # of the highest K: a smaller offset hardly shows in the force
_SPRING = 0.15  # 1 sigma of o where the force line is another one, of the highest K
_MISSED = 0.2  # of the speed's square: with more left, nothing is explained
_SEVERAL = 3  # pieces whose common line is more than their gradients
_FAINT = 0.1  # less than this shows little of a brake [m/s]
_ANY = 25.0  # times as steep: no other vehicle's line


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


def tolerance(v: Vehicle) -> float:
    """1 sigma of the deceleration by the pressure, as a share of it, from what is stated."""
    chain = (v.friction, v.axle_mass, v.discs, v.efficiency, v.lever_ratio, v.radius_ratio)
    shares = [x.tolerance / x.value for x in chain]
    return math.hypot(*shares, 2.0 * v.cylinder_diameter.tolerance / v.cylinder_diameter.value)


def stated(design: Design, vehicle: Vehicle) -> dict[int, Parameter]:
    """The prior of every shared parameter by what is stated of the vehicle.

    Args:
        design: of one log, for its highest K and its intervals.
        vehicle: with tolerances.
    """
    fade, at = vehicle.friction_fade, friction_share(vehicle, design.mean)
    return {
        SCALE: Parameter(0.0, math.log1p(tolerance(vehicle))),
        OFFSET: Parameter(0.0, math.hypot(_spring(design, vehicle).tolerance, _ZERO)),
        DELAY: Parameter(0.0, math.hypot(_SMALL, 0.25 * design.interval)),
        STIFFNESS: CREEP,
        FADE: Parameter(fade.value / at, fade.tolerance or _FADE.tolerance),
        RESISTANCE: _RESISTANCE,
        DRAG: _DRAG,
    }


def friction_share(vehicle: Vehicle, speed: float) -> float:
    """φ at a speed [m/s], over `friction`."""
    return max(1.0 + vehicle.friction_fade.value * (speed - vehicle.friction_speed.value), 0.1)


def _spring(design: Design, vehicle: Vehicle) -> Parameter:
    """What the return spring takes, of the highest K, as stated."""
    share, force = force_line(vehicle).at_zero / design.top, vehicle.spring_force
    return Parameter(share, share * force.tolerance / max(force.value, 1e-9))


# Designs


def design(
    axles: Sequence[AxleChannels], vehicle: Vehicle, coarse: Grid, fine: Grid, train: bool = False
) -> Design | None:
    """The pieces of a log; None where no brake application of wheels that roll is seen.

    Args:
        axles: all axles of the log.
        vehicle: what is stated of it.
        coarse: the axles on one time axis, for what rolls.
        fine: the same on a step as fine as the brakes change.
        train: whether the train speed is taken, not the mean of the rims.
    """
    v = fine.train if train and fine.train is not None else np.mean(fine.rim, axis=0)
    t: Floats = fine.step * np.arange(fine.rim.shape[1], dtype=np.float64)
    K, top = _force(axles, vehicle, fine, t)
    known = np.isfinite(np.mean(fine.clamping, axis=0))
    if top <= 0.0:
        return None
    pieces, run = _pieces(np.maximum(K, 0.0), np.nan_to_num(v), known, coarse, fine)
    if not pieces:
        return None
    at, first = np.concatenate(pieces), np.cumsum([0, *map(len, pieces[:-1])])
    same = np.array(run)[:, None] == np.array(run)
    doubt = _GRADIENT**2 * same + _CHANGES**2 * np.eye(len(run))
    noise = math.sqrt(white_noise((t[p], v[p]) for p in pieces))
    interval = max(between(a) for a in axles)
    rounding = max(_stands(a) * vehicle.radius(a.record.axle).value for a in axles)
    mean = float(v[at].mean())
    c = float(braked(top, wheelset(vehicle, axles[0].record.axle))) * friction_share(vehicle, mean)
    floor = math.hypot(_FLOOR, rounding, c * _unseen(t, np.maximum(K, 0.0), interval))
    whole = np.interp(t, t[np.isfinite(v)], v[np.isfinite(v)])
    d = Design(
        t, K, whole - mean, top, at, first, first, doubt, True, v[at], v[at], v[at], v[at], v[at],
        c, noise, floor, fine.train is not None, interval, mean,
        not (train and fine.train is not None),
    )  # fmt: skip
    return _cut(d, first)


def _cut(d: Design, first: NDArray[np.int64]) -> Design:
    """The design with pieces that begin at these places in `at`."""
    d = d._replace(first=first, size=np.diff(first, append=len(d.at)).astype(np.float64))
    t, u = d.t[d.at], d.faster + d.mean
    d = d._replace(time=t - _spread(d, _sums(d, t) / d.size))
    flat = _flat(d, d.measured)
    smooth = d.measured - _sloped(d, flat)
    return d._replace(v=flat, speed=smooth, squared=_flat(d, _area(d, u * u)[d.at]))


def along_track(d: Design) -> Design:
    """The design in short pieces, whose gradients are correlated along the track."""
    step = float(d.t[1] - d.t[0])
    runs = [0, *(np.flatnonzero(np.diff(d.at) > 1) + 1), len(d.at)]
    many = [max(1, min(round(n * step / _SHORT), n // LEAST)) for n in np.diff(runs)]
    edges = [np.linspace(*ends, n + 1)[:-1] for ends, n in zip(pairwise(runs), many, strict=True)]
    d = _cut(d._replace(bends=False), np.concatenate(edges).astype(np.int64))
    way = _sums(d, _area(d, d.faster + d.mean)[d.at]) / d.size
    apart = np.abs(way[:, None] - way) / _ALONG
    return d._replace(doubt=_SLOPES**2 * np.exp(-apart) + _OWN**2 * np.eye(len(way)))


def joined(designs: Sequence[Design], vehicle: Vehicle) -> list[Design]:
    """The designs of several logs with one highest K and one mean speed, for one fit."""
    top = max(d.top for d in designs)
    mean = float(np.average([d.mean for d in designs], weights=[len(d.at) for d in designs]))
    found = []
    for d in designs:
        c = d.c * top / d.top * friction_share(vehicle, mean) / friction_share(vehicle, d.mean)
        K, faster = d.K * d.top / top, d.faster + d.mean - mean
        found.append(d._replace(K=K, faster=faster, top=top, c=c, mean=mean))
    return found


def _force(
    axles: Sequence[AxleChannels], vehicle: Vehicle, fine: Grid, t: Floats
) -> tuple[Floats, float]:
    """Mean K over its highest value (n,), and that [N]; 0 where there is none."""
    K: Floats = np.mean(fine.clamping, axis=0)
    line = force_line(vehicle)
    if all(a.brake.meaning == "pressure" for a in axles):  # known below the spring's force, too
        below = line.per_pascal * np.mean(fine.pressure, axis=0) - line.at_zero
        K = np.where(K > 0.0, K, np.minimum(below, 0.0))
    known = np.isfinite(K)
    top = float(np.nanmax(K, initial=0.0))
    if known.sum() < LEAST or top <= 0.0:
        return K, 0.0
    return np.interp(t, t[known], K[known]) / top, top


def _pieces(
    on: Floats, v: Floats, known: Bools, coarse: Grid, fine: Grid
) -> tuple[list[NDArray[np.int64]], list[int]]:
    """Samples of brakes and around them where all wheels roll; and each piece's run."""
    t: Floats = fine.step * np.arange(len(on), dtype=np.float64)
    change = np.abs(np.interp(t + 0.5, t, on) - np.interp(t - 0.5, t, on))
    near = ~far((change < _CHANGE) & (on < FREE), round(_AROUND / fine.step))
    rolls: Bools = np.all(coarse.rolling, axis=0)
    place = np.clip(np.rint(t / coarse.step).astype(int), 0, len(rolls) - 1)
    used: Bools = near & rolls[place] & known & (v > CRAWL)
    pieces: list[NDArray[np.int64]] = []
    run: list[int] = []
    for begin, end in true_runs(used):
        many = max(1, round((end - begin) * fine.step / _PIECE))
        edges: list[int] = np.linspace(begin, end, many + 1).astype(int).tolist()
        for i, j in pairwise(edges):
            if j - i >= LEAST:
                pieces.append(np.arange(i, j))
                run.append(begin)
    return pieces, run


def between(a: AxleChannels) -> float:
    """The longer of both channels' usual intervals [s]."""
    t, x = a.brake.data.t, a.brake.data.value
    own = t[np.flatnonzero(np.diff(x) != 0.0)]
    pressure = float(np.median(np.diff(own))) if len(own) > 1 else 0.0
    return max(float(np.median(np.diff(a.record.t))), pressure) * 1e-9


def _unseen(t: Floats, K: Floats, every: float) -> float:
    """What straight lines through samples so far apart miss of ∫K dt, by a kink half way."""
    before, after = (np.interp(t + x, t, K) for x in (-every, every))
    return every * float(np.max(np.abs(before - 2.0 * K + after))) / 8.0


def _stands(a: AxleChannels) -> float:
    """1 sigma of the rounding that is no noise [rad/s]: of a speed that stays on its levels."""
    t, y = a.record.t * 1e-9, a.record.wheel_speed
    lasts = np.diff(t[np.flatnonzero(np.diff(y, prepend=np.nan))], append=t[-1])
    stays = float(lasts[lasts > 2.0 * FINE].sum() / (t[-1] - t[0]))
    return stays * a.speed.coarsest / math.sqrt(12.0)


def _sums(d: Design, x: Floats) -> Floats:
    """Sums over each piece, (..., p)."""
    total: Floats = np.add.reduceat(x, d.first, axis=-1)
    return total


def _spread(d: Design, x: Floats) -> Floats:
    """What each piece has, for each of its samples."""
    return np.repeat(x, d.size.astype(int), axis=-1)


def _flat(d: Design, x: Floats) -> Floats:
    """What is left of x without α and γ of its piece, (m,): gradients change within it."""
    return _unbent(d, x, _bend(d))


def _bend(d: Design) -> tuple[Floats, Floats]:
    """t² without its mean in each piece (m,), and the sums of its squares (p,)."""
    bent = d.time**2
    bent -= _spread(d, _sums(d, bent) / d.size)  # times are even: a straight line leaves it
    return bent, np.maximum(_sums(d, bent**2), 1e-30)


def _unbent(d: Design, x: Floats, bend: tuple[Floats, Floats]) -> Floats:
    """`_flat`, with what `_bend` gives."""
    x = np.subtract(x, _spread(d, _sums(d, x) / d.size))
    if not d.bends:
        return x
    bent, squares = bend
    part = np.where(d.size >= _BENT, _sums(d, x * bent) / squares, 0.0)
    flat: Floats = x - _spread(d, part) * bent
    return flat


# The model


def _delayed(d: Design, x: Floats) -> Floats:
    """K(t + τ), (n,)."""
    return np.interp(d.t + float(x[DELAY]), d.t, d.K)


def _applied(d: Design, x: Floats, delayed: Floats) -> Floats:
    """k, (n,)."""
    K = np.maximum(delayed - x[OFFSET], 0.0)
    k: Floats = K * (1.0 + x[FADE] * d.faster)
    return k


def _area(d: Design, k: Floats) -> Floats:
    """∫ k dt, (n,) [s]."""
    step = float(d.t[1] - d.t[0])
    area: Floats = np.concatenate([[0.0], np.cumsum((k[1:] + k[:-1]) * (0.5 * step))])
    return area


def lost(d: Design, x: Floats) -> Floats:
    """What the brake takes from the speed, but for the factor s; (m,) [m/s]."""
    return _lost(d, x, _delayed(d, x))


def _lost(d: Design, x: Floats, delayed: Floats) -> Floats:
    k = _applied(d, x, delayed)
    crept = d.creeps * d.speed * k[d.at] / (G * math.exp(x[STIFFNESS]))
    taken: Floats = d.c * (_area(d, k)[d.at] + crept)
    return taken


class Brake:
    """What the brake takes from the speed in one design, at the points of a search.

    A search asks for the same point more than once, and most points share their delay. So the
    latest results are kept.

    Args:
        d: the design.
        kept: so many points.
    """

    def __init__(self, d: Design, kept: int = len(_PARTS)) -> None:
        self.d = d
        self._kept = kept
        self._bend = _bend(d)
        self._known: dict[tuple[float, ...], Floats] = {}
        self._delayed = math.nan, d.K  # a delay and K(t + τ)

    def lost(self, x: Floats) -> Floats:
        """`lost` without α and γ of each piece, (m,) [m/s]."""
        point = tuple(x[[OFFSET, DELAY, STIFFNESS, FADE]].tolist())
        if point not in self._known:
            if len(self._known) == self._kept:
                del self._known[next(iter(self._known))]
            self._known[point] = self._lost(x)
        return self._known[point]

    def left(self, x: Floats, gradients: Floats) -> Floats:
        """What the model leaves of the speed, (m,) [m/s]."""
        d, slope = self.d, _spread(self.d, gradients - x[RESISTANCE])
        rest: Floats = d.v + math.exp(x[SCALE]) * self.lost(x) - slope * d.time
        rest += x[DRAG] * d.squared
        return rest

    def columns(self, x: Floats) -> Floats:
        """How what is left changes with each shared parameter, (7, m)."""
        d, s = self.d, math.exp(x[SCALE])
        J = np.empty((_SHARED, len(d.at)))
        J[SCALE] = s * self.lost(x)
        k = _applied(d, x, self._at(x))[d.at]
        crept = d.creeps * d.c * d.speed * k / (G * math.exp(x[STIFFNESS]))
        J[STIFFNESS] = -s * _unbent(d, crept, self._bend)
        for i, step in ((OFFSET, 0.005), (FADE, 0.001), (DELAY, 0.01)):
            high, low = x.copy(), x.copy()
            high[i] += step
            low[i] -= step
            J[i] = s * (self._lost(high) - self._lost(low)) / (2.0 * step)
        J[RESISTANCE], J[DRAG] = d.time, d.squared
        return J

    def _lost(self, x: Floats) -> Floats:
        return _unbent(self.d, _lost(self.d, x, self._at(x)), self._bend)

    def _at(self, x: Floats) -> Floats:
        if self._delayed[0] != x[DELAY]:
            self._delayed = x[DELAY], _delayed(self.d, x)
        return self._delayed[1]


def left(d: Design, x: Floats, gradients: Floats) -> Floats:
    """What the model leaves of the speed, (m,) [m/s]."""
    return Brake(d).left(x, gradients)


def gradients(designs: Sequence[Design], x: Floats) -> list[Floats]:
    """The gradients of each design, of a posterior's mean [m/s²]."""
    edges = np.cumsum([_SHARED, *(len(d.size) for d in designs)])
    return [x[i:j] for i, j in pairwise(edges)]


class _Problem(NamedTuple):
    """Designs with weights, and the prior of all unknowns."""

    brakes: Sequence[Brake]  # of each design
    telling: Sequence[Floats]  # independent samples of each piece
    mean: Floats  # of shared parameters, then of gradients
    weight: Floats  # inverse of its covariance

    def parts(self, x: Floats) -> list[Floats]:
        """The gradients of each design."""
        return gradients([b.d for b in self.brakes], x)


def _problem(
    brakes: Sequence[Brake], telling: Sequence[Floats], prior: Mapping[int, Parameter]
) -> _Problem:
    total = _SHARED + sum(len(b.d.size) for b in brakes)
    mean, weight = np.zeros(total), np.zeros((total, total))
    for i, p in prior.items():
        mean[i], weight[i, i] = p.value, p.tolerance**-2.0
    begin = _SHARED
    for brake in brakes:
        own = slice(begin, begin + len(brake.d.size))
        weight[own, own] = np.linalg.inv(brake.d.doubt)
        begin = own.stop
    return _Problem(brakes, telling, mean, weight)


def _cost(p: _Problem, x: Floats) -> float:
    """−2 log of the posterior, every piece's own variance taken as is likeliest."""
    off = x - p.mean
    cost = float(off @ p.weight @ off)
    for brake, telling, gradients in zip(p.brakes, p.telling, p.parts(x), strict=True):
        d = brake.d
        squares = _sums(d, brake.left(x, gradients) ** 2) / d.size + d.floor**2
        cost += float(telling @ np.log(squares))
    return cost


def _normal(p: _Problem, x: Floats) -> tuple[Floats, Floats]:
    """Normal equations at a point: matrix and right side."""
    A, b = p.weight.copy(), p.weight @ (x - p.mean)
    begin = _SHARED
    for brake, telling, gradients in zip(p.brakes, p.telling, p.parts(x), strict=True):
        d, rest = brake.d, brake.left(x, gradients)
        each = telling / (_sums(d, rest**2) + d.size * d.floor**2)
        J = brake.columns(x)
        JW = J * _spread(d, each)
        A[:_SHARED, :_SHARED] += JW @ J.T
        b[:_SHARED] += JW @ rest
        own = slice(begin, begin + len(d.size))
        cross = -_sums(d, JW * d.time)
        A[:_SHARED, own] += cross
        A[own, :_SHARED] += cross.T
        A[own, own] += np.diag(each * _sums(d, d.time**2))
        b[own] -= each * _sums(d, d.time * rest)
        begin = own.stop
    return A, b


def fit(
    designs: Sequence[Design],
    telling: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
) -> Posterior:
    """The posterior of the shared parameters and of every piece's gradient.

    Args:
        designs: of one log or of many.
        telling: independent samples of each piece, from `independent`.
        prior: of each shared parameter; an infinite tolerance frees it.
        starts: points to begin at: shared parameters, or these and the gradients.
    """
    return _search([Brake(d) for d in designs], telling, prior, starts).posterior()


class _Likeliest(NamedTuple):
    """The maximum of a posterior."""

    problem: _Problem
    prior: Mapping[int, Parameter]
    mean: Floats  # of the shared parameters, then of every piece's gradient [m/s²]
    cost: float  # as of `Posterior`

    def posterior(self) -> Posterior:
        """The same with its covariance."""
        covariance = inverse(_normal(self.problem, self.mean)[0])
        sigmas = np.array([self.prior[i].tolerance for i in range(_SHARED)])
        of = self.problem.mean[:_SHARED]
        return Posterior(of, sigmas, self.mean, covariance, self.cost)


def _search(
    brakes: Sequence[Brake],
    telling: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
) -> _Likeliest:
    p = _problem(brakes, telling, prior)
    points = [_completed(p, x) for x in starts]
    costs = [_cost(p, x) for x in points]
    best, cost = points[int(np.argmin(costs))], min(costs)
    most = np.full(len(best), 2.0)
    reach = min(_REACH, *(float(b.d.t[-1]) / 4.0 for b in brakes))
    most[:_SHARED] = math.log(_STEEPEST), _MOST, reach, 12.0, 0.05, 0.5, 5e-4
    for _ in range(15):
        A, b = _normal(p, best)
        d = _sizes(A)  # the units differ by powers of ten
        change = np.linalg.pinv(A / np.outer(d, d), hermitian=True) @ (b / d) / d
        trials = [np.clip(best - part * change, -most, most) for part in _PARTS]
        costs = [_cost(p, x) for x in trials]
        gained = cost - min(costs)
        if gained > 0.0:
            best, cost = trials[int(np.argmin(costs))], min(costs)
        if gained < _CONVERGED:
            break
    return _Likeliest(p, prior, best, cost)


def joint(designs: Sequence[Design], prior: Mapping[int, Parameter]) -> Posterior:
    """The posterior of designs that are `joined`, each with as many samples as are independent."""
    start = np.array([prior[i].value for i in range(_SHARED)])
    first = fit(designs, [d.size for d in designs], prior, [start]).mean
    each = zip(designs, gradients(designs, first), strict=True)
    telling = [independent(d, left(d, first, slopes)) for d, slopes in each]
    return fit(designs, telling, prior, [first])


def _completed(p: _Problem, x: Floats) -> Floats:
    """A point with gradients: those of least squares, drawn towards their prior."""
    if len(x) == len(p.mean):
        return x
    found = [x[:_SHARED]]
    for brake in p.brakes:
        d = brake.d
        own = brake.left(x, np.zeros(len(d.size)))
        found.append(np.clip(_sums(d, own * d.time) / _sums(d, d.time**2), -0.5, 0.5))
    return np.concatenate(found)


def _sizes(A: Floats) -> Floats:
    """Divisors of rows and columns that make normal equations of like size; 1 for an empty row."""
    d = np.sqrt(np.maximum(np.diag(A), 0.0))
    return np.where(d > 0.0, d, 1.0)


def inverse(A: Floats) -> Floats:
    """Inverse of normal equations, by rows of like size; infinite where nothing determines one."""
    d, unknown = _sizes(A), np.diag(A) <= 0.0
    C = A / np.outer(d, d)
    values, vectors = np.linalg.eigh(C)
    kept = values > _SINGULAR
    found: Floats = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(d, d)
    lost = (vectors[:, ~kept] ** 2).sum(axis=1) > _SINGULAR
    found[lost | unknown, lost | unknown] = np.inf
    return found


def independent(d: Design, off: Floats) -> Floats:
    """Independent samples of each piece (p,), by how neighbours correlate in what is left (m,)."""
    pair = np.append(off[1:] * off[:-1], 0.0)
    pair[d.first[1:] - 1] = 0.0
    alike = _sums(d, pair) / (_sums(d, off**2) + d.size * _FLOOR**2)  # rounding is alike
    alike = np.clip(alike, 0.0, 0.99)
    return d.size * (1.0 - alike) / (1.0 + alike)


def _starts(brake: Brake, prior: Mapping[int, Parameter]) -> list[Floats]:
    """Where to look: with what is free, each by itself."""
    d = brake.d
    base = np.array([prior[i].value for i in range(_SHARED)])
    reach = min(_REACH, float(d.t[-1]) / 4.0)
    delays = np.linspace(-reach, reach, 41) if math.isinf(prior[DELAY].tolerance) else [0.0]
    scales = math.isinf(prior[SCALE].tolerance)
    points = [(delay, 0.0) for delay in delays]
    points += [(0.0, o) for o in (-0.3, -0.1, 0.1, 0.3, 0.5)] * scales
    found = []
    for delay, offset in points:
        x = base.copy()
        x[DELAY], x[OFFSET] = delay, offset
        if scales:
            x[SCALE] = _likeliest_scale(brake, x)
        found.append(x)
    return found


def _likeliest_scale(brake: Brake, x: Floats) -> float:
    """The ln s that fits best with any gradients."""
    d = brake.d
    u, v = _sloped(d, brake.lost(x)), _sloped(d, d.v)
    A, B, C = _sums(d, v * v), _sums(d, v * u), _sums(d, u * u)
    s = _FACTORS[:, None]
    squares = np.maximum(A + 2.0 * s * B + s * s * C, 0.0) / d.size + d.floor**2
    return math.log(float(_FACTORS[np.argmin(np.log(squares) @ d.size)]))


# What explains how the train slows


def explained(
    axles: Sequence[AxleChannels], coarse: Grid | None, vehicle: Vehicle, fine: Grid | None = None
) -> Explanation:
    """The best explanation of how the train slows; the stated vehicle where the log shows none.

    Args:
        axles: all axles of the log, on one clock each.
        coarse: the same on one time axis, where they have one.
        vehicle: what is stated of it.
        fine: the same in steps of `FINE`, where it is known already.
    """
    fine = fine or (grid(axles, vehicle, FINE) if coarse else None)
    if coarse is None or fine is None:
        return AS_STATED
    rims = design(axles, vehicle, coarse, fine)
    train = design(axles, vehicle, coarse, fine, True) if fine.train is not None else None
    if rims is None:
        return AS_STATED._replace(design=train)
    e = _explained(rims, vehicle)
    # A wheel on its way into a slide slows harder than it should; the train does not.
    if e.line and fine.train is not None and not (train and _explained(train, vehicle).line):
        e = e._replace(line=None, late=AS_STATED.late if e.either else e.late, either=False)
    return e._replace(design=train or rims)


def _explained(d: Design, vehicle: Vehicle) -> Explanation:
    """What explains this speed, of wheels that creep or of the train, which only has to agree."""
    clearly = CLEARLY if d.creeps else CLEARLY / 2.0
    known = stated(d, vehicle) | {DRAG: _ABSORBED}
    offset = Parameter(0.0, max(_SPRING, _spring(d, vehicle).value))
    any_delay = {DELAY: Parameter(0.0, math.inf)}
    any_line = {SCALE: Parameter(0.0, math.inf), OFFSET: offset}
    free = {**known, **any_delay, **any_line}
    brake = Brake(d, _STARTS)
    start = np.array([known[i].value for i in range(_SHARED)])
    first = _search([brake], [d.size], known, [start])
    pieces = _gradients(d, first.posterior())
    near = _search([brake], [d.size], free, [first.mean])
    rest = _sums(d, brake.left(first.mean, first.mean[_SHARED:]) ** 2) / d.size
    noise = _NOISY * math.hypot(d.noise, d.floor)
    if first.cost - near.cost < clearly and (rest < noise**2).all():
        return AS_STATED._replace(pieces=pieces)
    everywhere = _starts(brake, free)
    whole = _search([brake], [d.size], free, everywhere)
    telling = [independent(d, _sloped(d, brake.left(whole.mean, np.zeros(len(d.size)))))]
    fits = {"stated": _search([brake], telling, known, _starts(brake, known))}
    for name, prior in (("late", {**known, **any_delay}), ("line", {**known, **any_line})):
        fits[name] = _best(brake, telling, prior, _starts(brake, prior), [fits["stated"]])
    fits["both"] = _best(brake, telling, free, [*everywhere, whole.mean], list(fits.values()))
    return _judged(d, telling, fits, vehicle, clearly)._replace(pieces=pieces)


def _best(
    brake: Brake, telling: Sequence[Floats], prior: Mapping[int, Parameter],
    starts: Sequence[Floats], inside: Sequence[_Likeliest],
) -> _Likeliest:  # fmt: skip
    """The best fit from the best of `starts` and from each fit with fewer unknowns.

    A model is never less likely than one that it contains; one search may end where it is. Of few
    pieces the gradients explain as much as a line does, and a better fit shows nothing.
    """
    wider = inside if len(brake.d.size) >= _SEVERAL else ()
    every = [starts, *([fit.mean] for fit in wider)]
    return min((_search([brake], telling, prior, x) for x in every), key=lambda fit: fit.cost)


def _gradients(d: Design, p: Posterior) -> tuple[Piece, ...]:
    """What each piece needs as a gradient, by the vehicle as stated."""
    found = []
    for i, (first, many) in enumerate(zip(d.first, d.size.astype(int), strict=True)):
        begin, end = (float(d.t[d.at[k]]) for k in (first, first + many - 1))
        slope = Parameter(float(p.mean[_SHARED + i]), p.sigma(_SHARED + i))
        found.append(Piece(begin, end, slope))
    return tuple(found)


def _judged(
    d: Design, telling: Sequence[Floats], fits: Mapping[str, _Likeliest], vehicle: Vehicle,
    clearly: float,
) -> Explanation:  # fmt: skip
    """What the likelihoods of all causes say together.

    Args:
        d: the pieces.
        telling: independent samples of each.
        fits: the likeliest point of each cause.
        vehicle: what is stated of it.
        clearly: gain of another cause that is clear.
    """
    late, line, both = fits["late"], fits["line"], fits["both"]
    no_brake = float(telling[0] @ np.log(_sums(d, _sloped(d, d.v) ** 2) / d.size + d.floor**2))
    one = min(late.cost, line.cost)
    if min(one, both.cost) > min(fits["stated"].cost, no_brake) - clearly:
        return AS_STATED
    if two := both.cost < one - clearly:
        late = line = both
    uncertain = SIGMAS * _spring(d, vehicle).tolerance
    allowed = math.log1p(math.hypot(SIGMAS * tolerance(vehicle), uncertain))
    tau, (ln_s, o) = late.posterior().delay, line.mean[[SCALE, OFFSET]].tolist()
    s = math.exp(ln_s)
    is_late = abs(tau.value) > max(_LEAST_DELAY, _SHARE * d.interval, _SURE * tau.tolerance)
    other = abs(o) > max(_SLIGHT, uncertain)
    other |= max(abs(math.log(s)), abs(math.log(s * max(1.0 - o, 1e-3)))) > allowed
    if not two:  # what is as likely and nothing to report leaves the other one in doubt
        if abs(late.cost - line.cost) < AS_GOOD:
            is_late = other = is_late and other
        elif late.cost < line.cost:
            other = False
        else:
            is_late = False
    # Where all wheels slide from the first moment on, they slow harder than by their brakes.
    slides = not d.seen and s > 1.0 and math.sqrt(d.v @ d.v / len(d.v)) < _FAINT
    missed = _missed(d, telling[0], min(late, line, key=lambda f: f.cost)) > _MISSED
    if missed or (other and (slides or not 1.0 / _ANY < s < _ANY)):
        return AS_STATED
    return Explanation(
        tau if is_late else AS_STATED.late,
        Line(s, o * d.top, s * (1.0 - o)) if other else None,
        is_late and other and not two,
    )


def _sloped(d: Design, x: Floats) -> Floats:
    """What is left of x without a straight slope of its piece, (m,)."""
    return x - _spread(d, _sums(d, x * d.time) / _sums(d, d.time**2)) * d.time


def _missed(d: Design, telling: Floats, p: _Likeliest) -> float:
    """Share of the speed's square that is left, rounding apart."""
    rest = _sums(d, left(d, p.mean, p.mean[_SHARED:]) ** 2) / d.size
    whole = _sums(d, _sloped(d, d.v) ** 2) / d.size
    return float(telling @ np.maximum(rest - d.floor**2, 0.0) / (telling @ whole))
