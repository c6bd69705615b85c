"""What explains how the train slows: what is stated, another force line, or a late pressure.

While every wheel rolls, (1) and (15) give the speed from the pressure,

    v(t) = α + βt + γt² − s c ∫ max(K(t + τ) − o, 0) dt − q v s c max(K(t + τ) − o, 0),

with τ by which the pressure is late, s and o by which the force line is another one, α, β, γ for
speed, gradient and its change in each piece of the log, q for creep: a braked wheel turns more
slowly than the train by a share that goes with the force. A clock shifts both ends of every
build-up and release, a factor changes what lies between them, an offset moves their ends towards or
from each other; creep makes a wheel early by q v, the earlier the faster it is. Each is known only
beside the others. Every piece has an error of its own size: what follows another law (a slide)
tells little, and so do errors that are alike from sample to sample.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.model import Bools, Floats, Parameter, Vehicle
from ..core.physics import braked, force_line, wheelset
from ..core.signals import true_runs, white_noise
from .train_grid import LEAST, Axle, Explanation, Grid, Line, far, grid

_FINE = 0.05  # step of the grid, where the log is fast enough [s]
_CHANGE = 0.1  # of the highest K within a second: a build-up, a release
_AROUND = 6.0  # before and after a change [s]
_PIECE = 12.0  # within which a gradient stays the same [s]
_CRAWL = 1.0  # slower, a wheel may stand [m/s]
_REACH = 5.0  # the largest offset of clocks that is looked for [s]
_FLOOR = 0.005  # 1 sigma by which (1) misses a rolling wheel's speed [m/s]
_SPRING = 0.15  # 1 sigma of o where the force line is another one, of the highest K
_CLEARLY = 12.0  # so much better must another cause be: twice the log of the likelihood
_AS_GOOD = 8.0  # two causes with less between them cannot be told apart
_NOISY = 2.0  # times its noise is left of a speed that is explained
_SURE = 4.0  # sigma from zero is a clock that is off
_SHARE = 0.75  # of the longer sampling interval: less may be the sampling's own
_SMALL = 0.03  # wheels and rails delay a force by as much [s]
_CREEP = 0.003  # creep of 0.3 % at 1 m/s² makes a wheel early by this share of its speed [s²/m]
_USUAL, _SLIPPERY = 0.0, 0.005  # 1 sigma of q: with that allowed for, and on rails of any kind
_SLIGHT = 0.05  # of the highest K: a smaller offset hardly shows in the force
SIGMAS = 2.5  # of the stated tolerances are no other vehicle
_MISSED = 0.2  # of the speed's square: with more left, nothing is explained
_FAINT = 0.1  # less than this shows little of a brake [m/s]
_ANY = 10.0  # times as steep: no other vehicle's line
_MOST = 0.9  # the largest offset looked for, of the highest K
_STEEPEST = 30.0  # and the largest factor
_PARTS = 1.0, 0.5, 0.2, 0.05  # of a step that are tried
_CONVERGED = 0.05  # a smaller gain of a step ends the search
_BENT = 20  # samples: with fewer, γ is not told from what happens between two
_SINGULAR = 1e-9  # of what tells an unknown is left beside the others: rounding
_FACTORS = np.exp(np.linspace(math.log(0.05), math.log(20.0), 40))


AS_STATED = Explanation(Parameter(0.0, 0.0), None)


class _Point(NamedTuple):
    """One explanation."""

    late: float = 0.0  # τ [s]
    offset: float = 0.0  # o, of the highest K
    scale: float = 1.0  # s
    creep: float = 0.0  # q [s²/m]


class _Sigmas(NamedTuple):
    """How well each is known before; inf where it is not."""

    late: float
    offset: float
    scale: float  # of ln s
    creep: float  # of q


class _Log(NamedTuple):
    """The pieces, and the clamping force all along."""

    t: Floats  # even, (n,) [s]
    K: Floats  # as the straight line that (15) is, below zero too, over its highest value; (n,)
    top: float  # that [N]
    at: NDArray[np.int64]  # samples of the pieces, (m,)
    first: NDArray[np.int64]  # place of each piece's first one in `at`
    size: Floats  # how many each has
    time: Floats  # from the piece's middle, (m,) [s]
    v: Floats  # speed without the piece's parabola, (m,) [m/s]
    speed: Floats  # that itself, smooth (m,) [m/s]
    c: float  # deceleration by the highest K [m/s²]
    noise: float  # 1 sigma of v's white noise [m/s]
    floor: float  # 1 sigma of what no noise shows: rounding, and what (1) leaves out [m/s]
    seen: bool  # whether a train speed would show that all wheels slide


class _Fit(NamedTuple):
    """The likeliest of the explanations allowed."""

    point: _Point
    cost: float  # −2 log of its likelihood
    sigma: float  # 1 sigma of τ [s]


def tolerance(v: Vehicle) -> float:
    """1 sigma of the deceleration by the pressure, as a share of it, from what is stated."""
    chain = (v.friction, v.axle_mass, v.discs, v.efficiency, v.lever_ratio, v.radius_ratio)
    shares = [x.tolerance / x.value for x in chain]
    return math.hypot(*shares, 2.0 * v.cylinder_diameter.tolerance / v.cylinder_diameter.value)


def explained(axles: Sequence[Axle], coarse: Grid | None, vehicle: Vehicle) -> Explanation:
    """What explains best how the train slows; that it is as stated, where the log tells nothing.

    Args:
        axles: all axles of the log, on one clock each.
        coarse: the same on one time axis, where they have one.
        vehicle: what is stated of it.
    """
    fine = grid(axles, vehicle, _FINE) if coarse else None
    if coarse is None or fine is None:
        return AS_STATED
    e = _explained(axles, vehicle, coarse, fine, np.mean(fine.rim, axis=0), True)
    # A wheel on its way into a slide slows harder than (1) says; the train does not.
    if e.line and fine.train is not None:
        trains = _explained(axles, vehicle, coarse, fine, fine.train, False)
        if trains.line is None:
            return AS_STATED if e.either else e._replace(line=None)
    return e


def _explained(
    axles: Sequence[Axle], vehicle: Vehicle, coarse: Grid, fine: Grid, v: Floats, creeps: bool
) -> Explanation:
    """What explains this speed, of wheels that creep or of the train."""
    log = _log(axles, vehicle, coarse, fine, v)
    if log is None:
        return AS_STATED
    spring, tolerances = force_line(vehicle).at_zero / log.top, vehicle.spring_force
    uncertain = SIGMAS * spring * tolerances.tolerance / max(tolerances.value, 1e-9)
    late = max(_SMALL, _CREEP * float(log.speed.mean()), _SHARE * max(interval(a) for a in axles))
    factor = math.log1p(SIGMAS * tolerance(vehicle))
    least = _Sigmas(late, max(_SLIGHT, uncertain), factor, _USUAL)
    known = _Sigmas(*(x / math.sqrt(_CLEARLY) for x in least))._replace(creep=_USUAL)
    free = _Sigmas(math.inf, max(_SPRING, spring), math.inf, _USUAL)
    stated = _search(log, log.size, known, [_Point()])
    near = _search(log, log.size, free, [stated.point])
    left = _sums(log, _left(log, stated.point) ** 2) / log.size
    noise = _NOISY * math.hypot(log.noise, log.floor)
    if stated.cost - near.cost < _CLEARLY and (left < noise**2).all():
        return AS_STATED
    whole = _search(log, log.size, free, _starts(log, free))
    telling = _telling(log, whole.point)

    def fits(creep: float) -> dict[str, _Fit]:
        found = {}
        for cause, sigmas in {
            "stated": known,
            "late": known._replace(late=math.inf),
            "line": free._replace(late=known.late),
            "both": free,
        }.items():
            starts = [*_starts(log, sigmas), *([whole.point] if cause == "both" else [])]
            found[cause] = _search(log, telling, sigmas._replace(creep=creep), starts)
        return found

    usual, cost = _judged(log, telling, fits(_USUAL), least)
    if usual == AS_STATED or not creeps:
        return usual
    more = fits(_SLIPPERY)
    slippery, less = _judged(log, telling, more, least)
    or_creep = more["stated"].cost < cost + _CLEARLY
    if less < cost - _AS_GOOD or (or_creep and usual.line):
        return slippery
    return usual._replace(or_creep=or_creep)


def _judged(
    log: _Log, telling: Floats, fits: dict[str, _Fit], least: _Sigmas
) -> tuple[Explanation, float]:
    """What the likelihoods of all causes say together, and −2 log of that of what it says.

    Args:
        log: the pieces.
        telling: independent samples of each.
        fits: the likeliest point of each cause.
        least: less of each is as stated.
    """
    late, line, both = fits["late"], fits["line"], fits["both"]
    no_brake = _cost(log, telling, _Sigmas(*[math.inf] * 4), _Point(scale=1e-9))
    one = min(late.cost, line.cost)
    if min(one, both.cost) > min(fits["stated"].cost, no_brake) - _CLEARLY:
        return AS_STATED, fits["stated"].cost
    if two := both.cost < one - _CLEARLY:
        late = line = both
    tau, o, s = late.point.late, line.point.offset, line.point.scale
    is_late = abs(tau) > max(least.late, _SURE * late.sigma)
    other = abs(o) > least.offset or abs(math.log(s)) > least.scale
    if not two:  # what is as likely and nothing to tell of leaves the other one in doubt
        if abs(late.cost - line.cost) < _AS_GOOD:
            is_late = other = is_late and other
        elif late.cost < line.cost:
            other = False
        else:
            is_late = False
    unexplained = _unexplained(log, telling, min(late, line, key=lambda f: f.cost).point)
    # Where all wheels slide from the first moment on, they slow harder than by their brakes.
    slides = not log.seen and s > 1.0 and math.sqrt(log.v @ log.v / len(log.v)) < _FAINT
    if unexplained > _MISSED or (other and (slides or not 1.0 / _ANY < s < _ANY)):
        return AS_STATED, fits["stated"].cost
    told = Explanation(
        Parameter(tau, late.sigma) if is_late else AS_STATED.late,
        Line(s, o * log.top) if other else None,
        is_late and other and not two,
    )
    return told, min(late.cost, line.cost) if told != AS_STATED else fits["stated"].cost


def _unexplained(log: _Log, telling: Floats, p: _Point) -> float:
    """Share of the speed's square that is left, rounding apart."""
    left, whole = (_sums(log, x**2) / log.size for x in (_left(log, p), log.v))
    return float(telling @ np.maximum(left - log.floor**2, 0.0) / (telling @ whole))


def interval(a: Axle) -> float:
    """The longer of both channels' usual intervals [s]."""
    t, x = a.brake.data.t, a.brake.data.value
    own = t[np.flatnonzero(np.diff(x) != 0.0)]
    pressure = float(np.median(np.diff(own))) if len(own) > 1 else 0.0
    return max(float(np.median(np.diff(a.record.t))), pressure) * 1e-9


def _log(
    axles: Sequence[Axle], vehicle: Vehicle, coarse: Grid, fine: Grid, v: Floats
) -> _Log | None:
    """None where no brake application of wheels that roll is seen."""
    t: Floats = fine.step * np.arange(fine.rim.shape[1], dtype=np.float64)
    K: Floats = np.mean(fine.clamping, axis=0)
    line = force_line(vehicle)
    if all(a.brake.meaning == "pressure" for a in axles):  # known below the spring's force, too
        below = line.per_pascal * np.mean(fine.pressure, axis=0) - line.at_zero
        K = np.where(K > 0.0, K, np.minimum(below, 0.0))
    known: Bools = np.isfinite(K)
    top = float(np.nanmax(K, initial=0.0))
    if known.sum() < LEAST or top <= 0.0:
        return None
    K = np.interp(t, t[known], K[known]) / top
    on = np.maximum(K, 0.0)
    change = np.abs(np.interp(t + 0.5, t, on) - np.interp(t - 0.5, t, on))
    near = ~far(change < _CHANGE, round(_AROUND / fine.step))
    rolls: Bools = np.all(coarse.rolling, axis=0)
    place = np.clip(np.rint(t / coarse.step).astype(int), 0, len(rolls) - 1)
    used: Bools = near & rolls[place] & known & (np.nan_to_num(v) > _CRAWL)
    pieces: list[NDArray[np.int64]] = []
    for begin, end in true_runs(used):
        many = max(1, round((end - begin) * fine.step / _PIECE))
        edges: list[int] = np.linspace(begin, end, many + 1).astype(int).tolist()
        pieces += [np.arange(i, j) for i, j in pairwise(edges) if j - i >= LEAST]
    if not pieces:
        return None
    size = np.array([len(p) for p in pieces])
    at, first = np.concatenate(pieces), np.cumsum(size) - size
    w = wheelset(vehicle, axles[0].record.axle)
    since = np.concatenate([t[p] - t[p].mean() for p in pieces])
    noise = math.sqrt(white_noise((t[p], v[p]) for p in pieces))
    rounding = max(_stands(a) * vehicle.radius(a.record.axle).value for a in axles)
    c = float(braked(top, w))
    floor = math.hypot(_FLOOR, rounding, c * _untold(t, on, max(interval(a) for a in axles)))
    log = _Log(
        t, K, top, at, first, size.astype(np.float64), since, v[at], v[at],
        c, noise, floor, fine.train is not None,
    )  # fmt: skip
    flat = _detrended(log, log.v)
    return log._replace(v=flat, speed=log.speed - flat)


def _untold(t: Floats, K: Floats, every: float) -> float:
    """What straight lines through samples so far apart miss of ∫K dt, by a kink half way."""
    before, after = (np.interp(t + x, t, K) for x in (-every, every))
    return every * float(np.max(np.abs(before - 2.0 * K + after))) / 8.0


def _stands(a: Axle) -> float:
    """1 sigma of the rounding that is no noise [rad/s]: of a speed that stays on its levels."""
    t, y = a.record.t * 1e-9, a.record.wheel_speed
    lasts = np.diff(t[np.flatnonzero(np.diff(y, prepend=np.nan))], append=t[-1])
    stays = float(lasts[lasts > 2.0 * _FINE].sum() / (t[-1] - t[0]))
    return stays * a.speed.coarsest / math.sqrt(12.0)


def _sums(log: _Log, x: Floats) -> Floats:
    """Sums over each piece."""
    total: Floats = np.add.reduceat(x, log.first)
    return total


def _spread(log: _Log, x: Floats) -> Floats:
    """What each piece has, for each of its samples."""
    return np.repeat(x, log.size.astype(int))


def _detrended(log: _Log, x: Floats) -> Floats:
    """What is left of x without the parabola of its piece, (m,): gradients change within it."""
    bent = log.time**2
    bent -= _spread(log, _sums(log, bent) / log.size)  # a straight line leaves it: times are even
    for shape, pieces in ((np.ones_like(x), True), (log.time, True), (bent, log.size >= _BENT)):
        part = np.where(pieces, _sums(log, x * shape) / _sums(log, shape**2), 0.0)
        x = x - _spread(log, part) * shape
    return x


def _gained(log: _Log, p: _Point) -> Floats:
    """What s makes v lose without the parabola of each piece, (m,) [m/s]."""
    K = _applied(log, p)
    area = np.concatenate([[0.0], np.cumsum((K[1:] + K[:-1]) / 2.0)]) * (log.t[1] - log.t[0])
    crept = p.creep * log.speed * K[log.at]
    return _detrended(log, log.c * (area[log.at] + crept))


def _applied(log: _Log, p: _Point) -> Floats:
    """max(K(t + τ) − o, 0), (n,)."""
    K: Floats = np.maximum(np.interp(log.t + p.late, log.t, log.K) - p.offset, 0.0)
    return K


def _left(log: _Log, p: _Point) -> Floats:
    """What is left of the speed, (m,) [m/s]."""
    return log.v + p.scale * _gained(log, p)


def _cost(log: _Log, telling: Floats, sigmas: _Sigmas, p: _Point) -> float:
    """−2 log of the likelihood, every piece's own variance taken as is likeliest."""
    left = _sums(log, _left(log, p) ** 2) / log.size + log.floor**2
    return float(telling @ np.log(left)) + _unexpected(p, sigmas)


def _unexpected(p: _Point, sigmas: _Sigmas) -> float:
    """The same for what was known before alone."""
    off = p.late, p.offset, math.log(p.scale), p.creep
    return sum((x / sigma) ** 2 for x, sigma in zip(off, sigmas, strict=True) if x)


def _starts(log: _Log, sigmas: _Sigmas) -> list[_Point]:
    """Where to look: with what is free, each by itself."""
    reach = _reach(log)
    lates = np.linspace(-reach, reach, 41) if math.isinf(sigmas.late) else np.zeros(1)
    offsets = [-0.3, -0.1, 0.1, 0.3, 0.5] if math.isinf(sigmas.scale) else []
    points = [_Point(float(x)) for x in lates] + [_Point(0.0, o) for o in offsets]
    found = []
    for p in points:
        if math.isinf(sigmas.scale):
            u = _gained(log, p)
            A, B, C = _sums(log, log.v**2), _sums(log, log.v * u), _sums(log, u * u)
            s = _FACTORS[:, None]
            left = np.maximum(A + 2.0 * s * B + s * s * C, 0.0) / log.size + log.floor**2
            p = p._replace(scale=float(_FACTORS[np.argmin(np.log(left) @ log.size)]))
        found.append(p)
    return found


def _reach(log: _Log) -> float:
    """The largest τ that is looked for [s]."""
    return min(_REACH, float(log.t[-1]) / 4.0)


def _telling(log: _Log, p: _Point) -> Floats:
    """Independent samples of each piece, by how alike neighbours are in what is left."""
    off = _left(log, p)
    pair = np.append(off[1:] * off[:-1], 0.0)
    pair[log.first[1:] - 1] = 0.0
    alike = _sums(log, pair) / (_sums(log, off**2) + log.size * _FLOOR**2)  # rounding is alike
    alike = np.clip(alike, 0.0, 0.99)
    return log.size * (1.0 - alike) / (1.0 + alike)


def _search(log: _Log, telling: Floats, sigmas: _Sigmas, starts: list[_Point]) -> _Fit:
    """Gauss and Newton's way from the best of some points."""
    costs = [_cost(log, telling, sigmas, p) for p in starts]
    best, cost = starts[int(np.argmin(costs))], min(costs)
    free = 4 if sigmas.creep else 3
    weights = np.array(sigmas[:free]) ** -2.0
    most = np.array([_reach(log), _MOST, math.log(_STEEPEST), 1.0])
    A, change = np.diag(weights), np.zeros(4)
    for _ in range(12):
        left = _left(log, best)
        crept = log.c * log.speed * _applied(log, best)[log.at]
        scaled = [_gained(log, best), _detrended(log, crept)]
        J = np.array([*_slopes(log, best), *(best.scale * x for x in scaled)])[:free]
        each = telling / (_sums(log, left**2) + log.size * log.floor**2)
        JW = J * _spread(log, each)
        A = JW @ J.T + np.diag(weights)
        x = np.array([best.late, best.offset, math.log(best.scale), best.creep])
        b = JW @ left + weights * x[:free]
        change[:free] = np.linalg.pinv(A) @ b
        if change[3] > x[3]:  # no brake makes a wheel faster
            change[:3] = np.linalg.pinv(A[:3, :3]) @ (b[:3] - x[3] * A[:3, 3])
            change[3] = x[3]
        steps = [np.clip(x - part * change, -most, most).tolist() for part in _PARTS]
        trials = [_Point(late, o, math.exp(factor), q) for late, o, factor, q in steps]
        costs = [_cost(log, telling, sigmas, p) for p in trials]
        gained = cost - min(costs)
        if gained > 0.0:
            best, cost = trials[int(np.argmin(costs))], min(costs)
        if gained < _CONVERGED:
            break
    return _Fit(best, cost, _sigma(A))


def _sigma(A: Floats) -> float:
    """1 sigma of the first unknown by the normal equations' (k, k); inf where nothing tells it.

    By what the others leave of its own: the inverse of a nearly singular matrix may be below 0.
    """
    d = np.sqrt(np.diag(A))
    if d[0] == 0.0:
        return math.inf
    d[d == 0.0] = 1.0
    C = A / np.outer(d, d)
    own = float(1.0 - C[0, 1:] @ np.linalg.pinv(C[1:, 1:], hermitian=True) @ C[1:, 0])
    return 1.0 / (float(d[0]) * math.sqrt(own)) if own > _SINGULAR else math.inf


def _slopes(log: _Log, p: _Point) -> Iterator[Floats]:
    """How what is left changes with τ and with o, (m,) each."""
    for name, step in (("late", 0.01), ("offset", 0.005)):
        high, low = (
            _gained(log, p._replace(**{name: getattr(p, name) + x})) for x in (step, -step)
        )
        yield p.scale * (high - low) / (2.0 * step)
