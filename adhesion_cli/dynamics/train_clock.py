"""Time offset of the train speed against the wheels: one number per log, with its error.

A receiver delivers an older speed, T(t) = v(t − τ). GNSS is delayed by one to two seconds. For a
wheel i that rolls,

    T(t + τ) − ωR = c_i ωR + q (−v̇) ωR,

with c_i the error of its radius and q (−v̇) its creepage, which grows with the force on the rising
flank of the creep curve (3). A delay differs from both: its error is τ (−v̇) at every speed, and it
begins and ends later than the braking. A constant offset o of the train speed is the same with and
without brake. Where τ and o explain the log equally well, both are reported.

Wheels that slide are left out, with one second around each slide. τ is where most samples of all
axles fit. Slides that a controller repeats all along fit as well. They need a q that no creepage
has, or a c that the wheels do not show without brake, and then nothing is reported. The error of τ
is that of the least squares. The noise of the train speed is slow and the same for every axle.

Where the wheels hardly roll, the train still slows by the adhesion of its wheels,

    T(t + τ) = v₀ − b ∫ mean_i(F_i/m) dt − c t,

with F by the wheelset equation (1). Its ∫ I ω̇ needs no derivative. b stands for the constants of
the vehicle, v₀ and c for start and gradient of each piece. T is taken at its own samples, since
straight lines between samples of 1 Hz miss what wheels do meanwhile. The steps at each build-up,
slide and release determine τ. Vehicles that are not in the log make it less certain.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.model import Bools, Floats, Parameter, Vehicle, Wheelset
from ..core.physics import CRAWL, wheelset
from ..core.signals import white_noise
from .train_grid import LEAST, Axle, Grid, far, grid

_REACH = 5.0  # the largest offset looked for [s]
_SCAN = 0.1  # from one that is tried to the next [s]
_TAUS = np.arange(-_REACH, _REACH + _SCAN / 2.0, _SCAN)
_OFFSETS = 0.6 * _TAUS  # of the speed that are tried [m/s]
_FLOOR = 0.03  # 1 sigma by which a rolling wheel may differ, whatever the noise [m/s]
_CUT = 4.0  # sigma that are no noise
_WORN = 0.02  # 1 sigma of c [-]
_CREEP = 0.002, 0.004  # q and its 1 sigma: creep of 0.2 % at 1 m/s² [s²/m]
_NO_CREEP = 3.0  # sigma of q: a fit farther off is one of slides
_SLOWING = 0.2  # a train that does is braked [m/s²]
_NEAR = 1.0  # before and behind a slide creep is no straight line of force [s]
_LEAST = 3.0  # shortest rolling of a braked wheel [s]
_SHARE = 0.5  # and for this share of the braking
_ALIKE = 0.85  # of the time that the best axle rolls: an axle that rolls less does not count
_BLOCK = 3.0  # within it errors are correlated [s]
_SLOW = 1.5  # a receiver's noise is as slow as this, or as three of its samples [s]
_SYSTEMATIC = 0.015  # 1 sigma of τ by creep that does not go with the force [s]
_SUREST = 0.2  # τ is not known with a larger 1 sigma [s]
_OFF = 0.05, 0.3  # the same two of o: by what a slow wheel's sensor leaves out [m/s]
_CERTAIN = 3.0  # sigma from zero is an offset
_APART, _AS_GOOD = 0.5, 1.1  # nearest other τ or o [s, m/s], and its loss over the best one's
_CLEAR = 1.5  # the same of τ and o
_CLEARLY = 12.0  # and by the forces, as twice the log of the likelihood
_FINE = 0.05  # step on which forces are, where the log is fast enough [s]
_PIECE = 25.0  # within which a gradient stays the same [s]
_EXPLAINED = 0.8  # share of the train's deceleration that its wheels' adhesion must explain
_OTHERS = 0.05  # 1 sigma of τ by the wheels that are not in the log, by pads and pipes [s]
_MOST = 4000  # samples of the fit


class _Samples(NamedTuple):
    """What is fitted: shape (n,), and (axles, n)."""

    t: Floats  # [s]
    rim: Floats  # [m/s]
    slowing: Floats  # of the rim [m/s²]
    noise: float  # 1 sigma of the train speed on the grid [m/s]


class _Fit(NamedTuple):
    """At one τ."""

    x: Floats  # c of each axle, q
    left: Floats  # (axles, n) [m/s]
    used: Bools  # (axles, n): no slide
    loss: float  # mean square of what is left, cut off


class Beside(NamedTuple):
    """How the train speed differs from the wheels; None where that is not clear."""

    late: Parameter | None  # τ [s]
    offset: Parameter | None = None  # o [m/s], where τ is none or does not explain it better


class _Scan(NamedTuple):
    """How well each of some values fits."""

    tried: Floats
    losses: Floats

    @property
    def place(self) -> int:
        """Of the least loss."""
        return int(np.argmin(self.losses))

    @property
    def best(self) -> float:
        """The value there."""
        return float(self.tried[self.place])

    @property
    def has_least(self) -> bool:
        """Whether it lies between others."""
        return math.isfinite(self.losses[self.place]) and 0 < self.place < len(self.tried) - 1

    def unclear(self, value: float, times: float) -> bool:
        """Whether another, far from this one, has less than so many times the least loss."""
        others = self.losses[np.abs(self.tried - value) > _APART]
        return bool(others.min() < times * self.losses[self.place])


def beside(axles: Sequence[Axle], g: Grid, vehicle: Vehicle) -> Beside:
    """Delay of the train speed, negative where it is early, and its offset.

    Args:
        axles: all axles, with the same train speed.
        g: the same on one time axis.
        vehicle: for the wheels' constants.
    """
    train, interval = g.train, axles[0].record.train_speed_interval
    if train is None or axles[0].train is None or np.isfinite(train).sum() < 2 * LEAST:
        return Beside(None)
    found = _by_rolling(g, train, interval)
    fine = grid(axles, vehicle, _FINE)
    if found != Beside(None) or fine is None:
        return found
    t: Floats = (g.first - fine.first) * 1e-9 + g.step * np.arange(len(train), dtype=np.float64)
    if interval > g.step:
        own = axles[0].train.data
        t, train = np.multiply(own.t - fine.first, 1e-9), np.abs(own.value)
    every = max(1, len(t) // _MOST)
    wheels = [wheelset(vehicle, a.record.axle) for a in axles]
    return Beside(_by_forces(fine, t[::every], train[::every], wheels))


def _by_forces(g: Grid, t: Floats, train: Floats, wheels: Sequence[Wheelset]) -> Parameter | None:
    """τ at which the train slows as the adhesion of its wheels makes it, if that is clear.

    Args:
        g: all axles, as finely as forces change.
        t: of samples of the train speed, on that axis (n,) [s].
        train: those (n,) [m/s].
        wheels: their constants, one each.
    """
    axis: Floats = g.step * np.arange(g.rim.shape[1], dtype=np.float64)
    S, known = _lost(g, wheels)
    made = np.gradient(S, g.step)

    def at(tau: float) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """T, −S and what τ makes of T, without their pieces' lines (3, n); what is left; pieces."""
        when = t - tau
        used = (when > axis[0]) & (when < axis[-1]) & (train > CRAWL) & np.isfinite(train)
        used &= np.interp(when, axis, known) > 0.999
        piece = np.cumsum(~used)[used] + 1e6 * np.floor(t[used] / _PIECE)
        _, piece, size = np.unique(piece, return_inverse=True, return_counts=True)
        enough = size[piece] >= LEAST
        on, piece = np.flatnonzero(used)[enough], np.unique(piece[enough], return_inverse=True)[1]
        columns = train[on], -np.interp(when[on], axis, S), np.interp(when[on], axis, made)
        flat = _flat(np.array(columns), t[on], piece)
        square = float(flat[1] @ flat[1])
        b = float(flat[1] @ flat[0]) / square if square > 0.0 else 0.0
        flat[2] *= b
        return flat, flat[0] - b * flat[1], piece

    def loss(tau: float) -> float:
        left = at(tau)[1]
        return float(np.mean(left**2)) if len(left) >= 2 * LEAST else math.inf

    scan = _Scan(_TAUS, np.array([loss(tau) for tau in _TAUS]))
    if not scan.has_least:
        return None
    tau = scan.best
    for _ in range(5):
        flat, left, piece = at(tau)
        X = flat[1:]
        if len(left) < 2 * LEAST or not X.any(axis=1).all() or np.linalg.cond(X) > 1e7:
            return None
        x = np.linalg.lstsq(X.T, left, rcond=None)[0]
        tau += float(x[1])
        if not abs(tau - scan.best) <= 2.0 * _SCAN:
            return None
    rest, square = left - x @ X, float(left @ left)
    alike = min(max(float(left[1:] @ left[:-1]) / square, 0.0), 0.99) if square else 0.0
    telling = (1.0 - alike) / (1.0 + alike)
    row = np.linalg.inv(X @ X.T)[1]
    of_pieces = sum(float(row @ (X * rest)[:, piece == i].sum(axis=1)) ** 2 for i in set(piece))
    of_noise = float(np.mean(rest**2)) / telling * float(np.sum((row @ X) ** 2))
    sigma = math.hypot(math.sqrt(max(of_pieces, of_noise)), _OTHERS)
    unclear = scan.unclear(tau, math.exp(_CLEARLY / (telling * len(left))))
    unclear |= square > (1.0 - _EXPLAINED) * float(flat[0] @ flat[0])
    return None if unclear or sigma > _SUREST else Parameter(tau, sigma)


def _lost(g: Grid, wheels: Sequence[Wheelset]) -> tuple[Floats, Bools]:
    """S = ∫ mean F/m dt (n,) [m/s], and where it is known: a wheel that stands has less than φK."""
    known: Bools = np.all(np.isfinite(g.clamping) & (g.rim > CRAWL), axis=0)
    K, rim = np.nan_to_num(g.clamping), np.nan_to_num(g.rim)
    area = np.zeros(K.shape)
    area[:, 1:] = np.cumsum((K[:, 1:] + K[:, :-1]) / 2.0 * g.step, axis=1)
    each = zip(wheels, area, rim, strict=True)
    lost = [(w.phi * a + w.inertia / w.radius**2 * v) / w.mass for w, a, v in each]
    return np.mean(lost, axis=0), known


def _flat(x: Floats, t: Floats, piece: NDArray[np.int64]) -> Floats:
    """Columns (k, n) without the straight lines of their pieces: start, and gradient."""

    def mean(y: Floats) -> Floats:
        found: Floats = (np.bincount(piece, y) / np.bincount(piece))[piece]
        return found

    since = t - mean(t)
    for i, y in enumerate(x):
        y = y - mean(y)
        x[i] = y - since * mean(y * since) / mean(since**2)
    return x


class _Cause(NamedTuple):
    """One possible error of the train speed, by its size."""

    tried: Floats
    true: Callable[[float], Floats]  # the train's speed then, (n,) [m/s]
    slope: Callable[[float], Floats]  # by how much the logged one is above it, per unit; (n,)
    start: Callable[[float], Floats]  # c and q from which to look
    sure: float  # its 1 sigma where everything else is known
    tells: float  # the cause is not known with a larger 1 sigma


class _Found(NamedTuple):
    """The likeliest value of a cause."""

    value: Parameter
    loss: float
    clear: bool  # no other is nearly as likely


def _by_rolling(g: Grid, train: Floats, interval: float) -> Beside:
    """Which of τ, o or neither makes rolling wheels as fast as the train."""
    t: Floats = g.step * np.arange(len(train), dtype=np.float64)
    known = np.isfinite(train)
    falling, every = -g.slope(train), max(1, len(t) // _MOST)
    apart = (1, max(1, round(0.5 / g.step)))  # neighbours may be interpolated
    runs = ((t[known][::j], train[known][::j]) for j in apart)
    noise = max(_FLOOR, *(math.sqrt(white_noise([run])) for run in runs))
    s = _Samples(t[::every], g.rim[:, ::every], -g.slope(g.rim)[:, ::every], noise)

    def at(tau: float, column: Floats) -> Floats:
        return np.interp(s.t + tau, t[known], column[known], left=np.nan, right=np.nan)

    first = _start(g, train)
    late = _Cause(
        _TAUS, lambda tau: at(tau, train), lambda tau: at(tau, falling), lambda _: first,
        _SYSTEMATIC, _SUREST,
    )  # fmt: skip
    offset = _Cause(
        _OFFSETS, lambda o: at(0.0, train) - o, lambda _: np.ones(len(s.t)),
        lambda o: _start(g, train - o), *_OFF,
    )  # fmt: skip
    alike = max(1.0, max(_SLOW, 3.0 * interval) / (g.step * every))
    free = g.clamping[:, ::every] <= 0.0
    slows = np.nan_to_num(at(0.0, falling)) > _SLOWING
    both = [_likeliest(s, cause, slows, free, alike, _LEAST / (g.step * every))
            for cause in (late, offset)]  # fmt: skip
    return _told(*both)


def _told(late: _Found | None, offset: _Found | None) -> Beside:
    """Which of both it is; both where the log cannot separate them."""
    by_late = late.value if late and late.clear else None
    if offset is None or abs(offset.value.value) < _CERTAIN * offset.value.tolerance:
        return Beside(by_late)
    if late is None or _CLEAR * offset.loss < late.loss:
        return Beside(None, offset.value if offset.clear else None)
    either = by_late and _CLEAR * late.loss > offset.loss
    return Beside(by_late, offset.value if either else None)


def _likeliest(
    s: _Samples, cause: _Cause, slows: Bools, free: Bools, alike: float, least: float
) -> _Found | None:
    """The value at which most of the samples fit; None where the wheels do not show it.

    Args:
        s: the samples.
        cause: what is looked for.
        slows: where the train does (n,).
        free: where a wheel is not braked (axles, n).
        alike: samples in a row with correlated noise.
        least: samples that a wheel must roll while braked.
    """
    fits = [_fit(s, cause.true(x), cause.start(x)) for x in cause.tried]
    scan = _Scan(cause.tried, np.array([f.loss for f in fits]))
    if not scan.has_least:
        return None
    value, f = scan.best, fits[scan.place]
    rolls = (f.used & slows).sum(axis=1)
    if rolls.max() < max(least, _SHARE * slows.sum()):
        return None
    counts = rolls > _ALIKE * rolls.max()  # what little is left of a slide is no noise
    s = s._replace(rim=s.rim[counts], slowing=s.slowing[counts])
    x, sigma = f.x[np.append(counts, True)], math.inf
    for _ in range(5):
        f = _fit(s, cause.true(value), x)
        change, sigma = _step(s, f, cause.slope(value), alike, cause.sure)
        value, x = value + change, f.x
        if not abs(value - scan.best) <= 2.0 * (cause.tried[1] - cause.tried[0]):
            return None
    rolling = free[counts] & np.isfinite(cause.true(value)) & (s.rim > CRAWL)
    slides = abs(f.x[-1] - _CREEP[0]) > _NO_CREEP * _CREEP[1]
    slides |= 2 * f.used[rolling].sum() < rolling.sum()
    clear = not (scan.unclear(value, _AS_GOOD) or slides or sigma > cause.tells)
    return _Found(Parameter(value, sigma), f.loss, clear)


def _start(g: Grid, train: Floats) -> Floats:
    """First c and q: a wheel coasts without slip, and one that rolls is the faster one."""
    c = np.append(np.zeros(len(g.rim)), _CREEP[0])
    even = np.abs(g.slope(train)) < _SLOWING
    for i, rim in enumerate(g.rim):
        fast = (rim > 0.3 * np.nanmax(rim)) & (train > CRAWL)
        free = fast & even & (g.clamping[i] <= 0.0)
        if free.sum() >= LEAST:
            c[i] = np.median(train[free] / rim[free]) - 1.0
        elif fast.any():
            c[i] = np.quantile(train[fast] / rim[fast], 0.3) - 1.0
    inside: Floats = np.clip(c, -3.0 * _WORN, 3.0 * _WORN)
    return inside


def _prior(s: _Samples) -> tuple[Floats, Floats]:
    """Prior of c and q: their weights, as numbers of samples, and their means."""
    k = len(s.rim)
    weights = (s.noise / np.array([*([_WORN] * k), _CREEP[1]])) ** 2
    return weights, np.append(np.zeros(k), _CREEP[0])


def _columns(s: _Samples, used: Bools) -> Floats:
    """What c of each axle and q are multiplied with, shape (axles + 1, axles, n)."""
    k = len(s.rim)
    X = np.zeros((k + 1, *s.rim.shape))
    X[np.arange(k), np.arange(k)] = np.where(used, s.rim, 0.0)
    X[k] = np.where(used, s.rim * np.maximum(s.slowing, 0.0), 0.0)
    return X


def _fit(s: _Samples, v: Floats, start: Floats) -> _Fit:
    """Least squares of c and q over what is no slide; v is shifted already, shape (n,)."""
    usable = np.isfinite(v) & np.isfinite(s.slowing) & (s.rim > CRAWL) & (v > CRAWL)
    X, d = _columns(s, usable), np.where(usable, v - s.rim, 0.0)
    weights, expected = _prior(s)
    x, left, used, cut = start, d, usable, _CUT * s.noise
    near = round(_NEAR / (s.t[1] - s.t[0]))
    for _ in range(8):
        left = d - np.einsum("ian,i->an", X, x)
        rolls = ~usable | (left < cut)
        used = usable & (np.abs(left) < cut) & np.array([far(row, near) for row in rolls])
        own = X * used
        A = np.einsum("ian,jan->ij", own, X) + np.diag(weights)
        x = np.linalg.solve(A, np.einsum("ian,an->i", own, d) + weights * expected)
    some = left[usable]
    loss = float(np.mean(np.minimum(some**2, cut**2))) if len(some) >= LEAST else math.inf
    return _Fit(x, left, used, loss)


def _step(s: _Samples, f: _Fit, slope: Floats, alike: float, sure: float) -> tuple[float, float]:
    """Change of the cause that fits better, and its 1 sigma.

    Args:
        s: the samples.
        f: their fit at the value so far.
        slope: change of the logged speed per unit of the cause, (n,) [m/s].
        alike: samples in a row with correlated noise.
        sure: 1 sigma of the cause where everything else is known.
    """
    used = f.used & np.isfinite(slope)
    late = np.where(used, np.nan_to_num(slope), 0.0)
    X = np.concatenate([_columns(s, used), late[None]])
    left = np.where(used, f.left, 0.0)
    weights, expected = (np.append(x, 0.0) for x in _prior(s))
    A = np.einsum("ian,jan->ij", X, X) + np.diag(weights)
    b = np.einsum("ian,an->i", X, left) - weights * (np.append(f.x, 0.0) - expected)
    if np.linalg.cond(A) > 1e14:
        return math.nan, math.inf
    x = np.linalg.solve(A, b)
    rest = left - np.einsum("ian,i->an", X, x)
    _, block = np.unique(s.t // _BLOCK, return_inverse=True)
    scores = np.zeros((len(X), int(block.max()) + 1))
    np.add.at(scores.T, block, (X * rest).sum(axis=1).T)
    free = max(scores.shape[1] - len(X), 1)
    row = np.linalg.inv(A)[-1]
    of_blocks = float(np.sum((row @ scores) ** 2)) * scores.shape[1] / free
    together = row @ X.sum(axis=1)  # the train speed's noise is in every axle
    of_noise = float(np.mean(rest[used] ** 2)) * alike * float(together @ together)
    of_prior = s.noise**2 * float(weights @ row**2)
    variance = max(of_blocks, of_noise) + of_prior
    return float(x[-1]), math.hypot(math.sqrt(variance), sure)
