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
from ..core.physics import CRAWL, RELEASED_SHARE, G, braked, force_line, wheelset
from ..core.signals import true_runs, white_noise
from ..records.axle_channels import AxleChannels
from .explanation import AS_STATED, Design, Explanation, OtherForceLine, Piece
from .grid import FEWEST, Grid, erode, grid

UNITS = {
    "scale": "ln",
    "offset": "-",
    "delay": "s",
    "stiffness": "ln",
    "fade": "s/m",
    "resistance": "m/s²",
    "drag": "1/m",
}
SCALE, OFFSET, DELAY, STIFFNESS, FADE, RESISTANCE, DRAG = range(len(UNITS))
_SHARED = len(UNITS)
CREEP = Parameter(math.log(22.0), 0.6)  # ln of 8 to 60 per unit of slip
_FADE = Parameter(0.0, 0.004)  # friction changes by some 10 % over 25 m/s [s/m]
_RESISTANCE = Parameter(0.015, 0.015)  # [m/s²]
_DRAG = Parameter(3e-5, 2e-5)  # [1/m]
_NO_DRAG = Parameter(0.0, 1e-9)  # by the gradient and γ of long pieces, in a diagnosis [1/m]
_GRADIENT = 0.1  # 1 sigma of a gradient: 10 per mille [m/s²]
_GRADIENT_CHANGE = 0.05  # 1 sigma by which it changes from piece to piece of one application [m/s²]
_TRACK_GRADIENT = 0.05  # 1 sigma of gradients along the track: 5 per mille, assumed [m/s²]
_CORRELATION_LENGTH = 1000.0  # they are correlated by exp(-x) over so many [m], assumed
_UNCORRELATED_GRADIENT = 0.005  # 1 sigma of what is not correlated: curves, wind [m/s²]
_DELAY_SIGMA = 0.03  # 1 sigma of the delay by calipers, hoses and transducers [s]
_ZERO_SIGMA = 0.01  # 1 sigma of a pressure sensor's zero, of the highest K

FINE_STEP = 0.05  # step of the grid, where the log is fast enough [s]
_CHANGE = 0.1  # of the highest K within a second: a build-up, a release
_CHANGE_MARGIN = 6.0  # before and after a change [s]
_PIECE = 12.0  # longest piece [s]
_SHORT_PIECE = 3.0  # the same where gradients are along the track [s]
_FEWEST_BENT = 20  # samples: with fewer, γ is not known from what happens between two
_LARGEST_DELAY = 5.0  # the largest delay that is looked for [s]
_LARGEST_OFFSET = 0.9  # the largest offset looked for, of the highest K
_LARGEST_FACTOR = 30.0  # and the largest factor
_FLOOR = 0.005  # 1 sigma by which the model misses a rolling wheel's speed [m/s]
_STEP_SHARES = 1.0, 0.5, 0.2, 0.05  # of a step that are tried
_STARTS = 64  # points that all fits of one design begin at, or fewer
_CONVERGED = 0.05  # a smaller gain of a step ends the search
_SINGULAR = 1e-9  # a smaller share left by the other parameters is rounding
_FACTORS = np.exp(np.linspace(math.log(0.05), math.log(20.0), 40))

CLEAR_GAIN = 12.0  # gain of another cause that is clear: twice the log of the likelihood
EQUAL_GAIN = 8.0  # two causes with less between them cannot be separated
STATED_SIGMAS = 3.5  # of the stated tolerances are no other vehicle
_NOISE_RATIO = 2.0  # times its noise is left of a speed that is explained
_SURE_SIGMAS = 4.0  # sigma from zero is a delay
_LEAST_DELAY = 0.1  # a shorter one is the caliper's [s]
_INTERVAL_SHARE = 0.75  # of the longer sampling interval: less may be the sampling's own
_SMALL_OFFSET = 0.05  # of the highest K: a smaller offset hardly shows in the force
_OFFSET_SIGMA = 0.15  # 1 sigma of o where the force line is another one, of the highest K
_LARGEST_RESIDUAL = 0.2  # of the speed's square: with more left, nothing is explained
_SEVERAL_PIECES = 3  # pieces whose common line is more than their gradients
_LITTLE_SPEED = 0.1  # less than this shows little of a brake [m/s]
_ANY_FACTOR = 25.0  # times as steep: no other vehicle's line


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


def stated_prior(design: Design, vehicle: Vehicle) -> dict[int, Parameter]:
    """The prior of every shared parameter by what is stated of the vehicle.

    Args:
        design: of one log, for its highest K and its intervals.
        vehicle: with tolerances.
    """
    fade, mean_share = vehicle.friction_fade, friction_share(vehicle, design.mean)
    return {
        SCALE: Parameter(0.0, math.log1p(tolerance(vehicle))),
        OFFSET: Parameter(0.0, math.hypot(_spring(design, vehicle).tolerance, _ZERO_SIGMA)),
        DELAY: Parameter(0.0, math.hypot(_DELAY_SIGMA, 0.25 * design.interval)),
        STIFFNESS: CREEP,
        FADE: Parameter(fade.value / mean_share, fade.tolerance or _FADE.tolerance),
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


def build_design(
    axles: Sequence[AxleChannels],
    vehicle: Vehicle,
    coarse_grid: Grid,
    fine_grid: Grid,
    train: bool = False,
) -> Design | None:
    """The pieces of a log; None where no brake application of wheels that roll is seen.

    Args:
        axles: all axles of the log.
        vehicle: what is stated of it.
        coarse_grid: the axles on one time axis, for what rolls.
        fine_grid: the same on a step as fine as the brakes change.
        train: whether the train speed is taken, not the mean of the rims.
    """
    v = fine_grid.train if train and fine_grid.train is not None else np.mean(fine_grid.rim, axis=0)
    t: Floats = fine_grid.step * np.arange(fine_grid.rim.shape[1], dtype=np.float64)
    K, top = _relative_force(axles, vehicle, fine_grid, t)
    finite = np.isfinite(np.mean(fine_grid.clamping, axis=0))
    if top <= 0.0:
        return None
    pieces, run_starts = _pieces(
        np.maximum(K, 0.0), np.nan_to_num(v), finite, coarse_grid, fine_grid
    )
    if not pieces:
        return None
    samples, piece_start = np.concatenate(pieces), np.cumsum([0, *map(len, pieces[:-1])])
    same_run = np.array(run_starts)[:, None] == np.array(run_starts)
    gradient_covariance = _GRADIENT**2 * same_run + _GRADIENT_CHANGE**2 * np.eye(len(run_starts))
    noise = math.sqrt(white_noise((t[p], v[p]) for p in pieces))
    interval = max(longer_interval(a) for a in axles)
    rounding = max(_rounding_sigma(a) * vehicle.radius(a.record.axle).value for a in axles)
    mean = float(v[samples].mean())
    c = float(braked(top, wheelset(vehicle, axles[0].record.axle))) * friction_share(vehicle, mean)
    floor = math.hypot(_FLOOR, rounding, c * _missed_impulse(t, np.maximum(K, 0.0), interval))
    complete_speed = np.interp(t, t[np.isfinite(v)], v[np.isfinite(v)])
    d = Design(
        t=t,
        K=K,
        relative_speed=complete_speed - mean,
        top=top,
        samples=samples,
        piece_start=piece_start,
        size=np.zeros(0),
        gradient_covariance=gradient_covariance,
        has_quadratic=True,
        time=v[samples],
        measured=v[samples],
        v=v[samples],
        speed=v[samples],
        squared=v[samples],
        c=c,
        noise=noise,
        floor=floor,
        shows_slides=fine_grid.train is not None,
        interval=interval,
        mean=mean,
        creeps=not (train and fine_grid.train is not None),
    )
    return _with_pieces(d, piece_start)


def _with_pieces(d: Design, piece_start: NDArray[np.int64]) -> Design:
    """The design with pieces that begin at these places in `at`."""
    d = d._replace(
        piece_start=piece_start, size=np.diff(piece_start, append=len(d.samples)).astype(np.float64)
    )
    t, u = d.t[d.samples], d.relative_speed + d.mean
    d = d._replace(time=t - _repeat_by_piece(d, _piece_sums(d, t) / d.size))
    unbent = _without_bend(d, d.measured)
    smooth = d.measured - _without_slope(d, unbent)
    return d._replace(
        v=unbent, speed=smooth, squared=_without_bend(d, _integral(d, u * u)[d.samples])
    )


def along_track(d: Design) -> Design:
    """The design in short pieces, whose gradients are correlated along the track."""
    step = float(d.t[1] - d.t[0])
    runs = [0, *(np.flatnonzero(np.diff(d.samples) > 1) + 1), len(d.samples)]
    pieces_per_run = [
        max(1, min(round(n * step / _SHORT_PIECE), n // FEWEST)) for n in np.diff(runs)
    ]
    edges = [
        np.linspace(*bounds, n + 1)[:-1]
        for bounds, n in zip(pairwise(runs), pieces_per_run, strict=True)
    ]
    d = _with_pieces(d._replace(has_quadratic=False), np.concatenate(edges).astype(np.int64))
    distance = _piece_sums(d, _integral(d, d.relative_speed + d.mean)[d.samples]) / d.size
    separation = np.abs(distance[:, None] - distance) / _CORRELATION_LENGTH
    return d._replace(
        gradient_covariance=_TRACK_GRADIENT**2 * np.exp(-separation)
        + _UNCORRELATED_GRADIENT**2 * np.eye(len(distance))
    )


def join_designs(designs: Sequence[Design], vehicle: Vehicle) -> list[Design]:
    """The designs of several logs with one highest K and one mean speed, for one fit."""
    top = max(d.top for d in designs)
    mean = float(np.average([d.mean for d in designs], weights=[len(d.samples) for d in designs]))
    rescaled = []
    for d in designs:
        c = d.c * top / d.top * friction_share(vehicle, mean) / friction_share(vehicle, d.mean)
        K, faster = d.K * d.top / top, d.relative_speed + d.mean - mean
        rescaled.append(d._replace(K=K, relative_speed=faster, top=top, c=c, mean=mean))
    return rescaled


def _relative_force(
    axles: Sequence[AxleChannels], vehicle: Vehicle, fine_grid: Grid, t: Floats
) -> tuple[Floats, float]:
    """Mean K over its highest value (n,), and that [N]; 0 where there is none."""
    K: Floats = np.mean(fine_grid.clamping, axis=0)
    line = force_line(vehicle)
    if all(a.brake.meaning == "pressure" for a in axles):  # known below the spring's force, too
        negative_force = line.per_pascal * np.mean(fine_grid.pressure, axis=0) - line.at_zero
        K = np.where(K > 0.0, K, np.minimum(negative_force, 0.0))
    finite = np.isfinite(K)
    top = float(np.nanmax(K, initial=0.0))
    if finite.sum() < FEWEST or top <= 0.0:
        return K, 0.0
    return np.interp(t, t[finite], K[finite]) / top, top


def _pieces(
    force_share: Floats, v: Floats, finite: Bools, coarse_grid: Grid, fine_grid: Grid
) -> tuple[list[NDArray[np.int64]], list[int]]:
    """Samples of brakes and around them where all wheels roll; and each piece's run."""
    t: Floats = fine_grid.step * np.arange(len(force_share), dtype=np.float64)
    change = np.abs(np.interp(t + 0.5, t, force_share) - np.interp(t - 0.5, t, force_share))
    near_change = ~erode(
        (change < _CHANGE) & (force_share < RELEASED_SHARE), round(_CHANGE_MARGIN / fine_grid.step)
    )
    rolling: Bools = np.all(coarse_grid.rolling, axis=0)
    place = np.clip(np.rint(t / coarse_grid.step).astype(int), 0, len(rolling) - 1)
    usable: Bools = near_change & rolling[place] & finite & (v > CRAWL)
    pieces: list[NDArray[np.int64]] = []
    run: list[int] = []
    for start, stop in true_runs(usable):
        piece_count = max(1, round((stop - start) * fine_grid.step / _PIECE))
        edges: list[int] = np.linspace(start, stop, piece_count + 1).astype(int).tolist()
        for i, j in pairwise(edges):
            if j - i >= FEWEST:
                pieces.append(np.arange(i, j))
                run.append(start)
    return pieces, run


def longer_interval(a: AxleChannels) -> float:
    """The longer of both channels' usual intervals [s]."""
    t, x = a.brake.data.t, a.brake.data.value
    change_times = t[np.flatnonzero(np.diff(x) != 0.0)]
    pressure = float(np.median(np.diff(change_times))) if len(change_times) > 1 else 0.0
    return max(float(np.median(np.diff(a.record.t))), pressure) * 1e-9


def _missed_impulse(t: Floats, K: Floats, interval: float) -> float:
    """What straight lines through samples so far apart miss of ∫K dt, by a kink half way."""
    earlier, later = (np.interp(t + x, t, K) for x in (-interval, interval))
    return interval * float(np.max(np.abs(earlier - 2.0 * K + later))) / 8.0


def _rounding_sigma(a: AxleChannels) -> float:
    """1 sigma of the rounding that is no noise [rad/s]: of a speed that stays on its levels."""
    t, y = a.record.t * 1e-9, a.record.wheel_speed
    durations = np.diff(t[np.flatnonzero(np.diff(y, prepend=np.nan))], append=t[-1])
    constant_share = float(durations[durations > 2.0 * FINE_STEP].sum() / (t[-1] - t[0]))
    return constant_share * a.speed.coarsest / math.sqrt(12.0)


def _piece_sums(d: Design, x: Floats) -> Floats:
    """Sums over each piece, (..., p)."""
    total: Floats = np.add.reduceat(x, d.piece_start, axis=-1)
    return total


def _repeat_by_piece(d: Design, x: Floats) -> Floats:
    """What each piece has, for each of its samples."""
    return np.repeat(x, d.size.astype(int), axis=-1)


def _without_bend(d: Design, x: Floats) -> Floats:
    """What is left of x without α and γ of its piece, (m,): gradients change within it."""
    return _without_bend_by(d, x, _quadratic(d))


def _quadratic(d: Design) -> tuple[Floats, Floats]:
    """t² without its mean in each piece (m,), and the sums of its squares (p,)."""
    bent = d.time**2
    bent -= _repeat_by_piece(
        d, _piece_sums(d, bent) / d.size
    )  # times are even: a straight line leaves it
    return bent, np.maximum(_piece_sums(d, bent**2), 1e-30)


def _without_bend_by(d: Design, x: Floats, bend: tuple[Floats, Floats]) -> Floats:
    """`_without_bend`, with what `_quadratic` gives."""
    x = np.subtract(x, _repeat_by_piece(d, _piece_sums(d, x) / d.size))
    if not d.has_quadratic:
        return x
    bent, squares = bend
    factor = np.where(d.size >= _FEWEST_BENT, _piece_sums(d, x * bent) / squares, 0.0)
    unbent: Floats = x - _repeat_by_piece(d, factor) * bent
    return unbent


# The model


def _delayed(d: Design, x: Floats) -> Floats:
    """K(t + τ), (n,)."""
    return np.interp(d.t + float(x[DELAY]), d.t, d.K)


def _braking_share(d: Design, x: Floats, delayed: Floats) -> Floats:
    """k, (n,)."""
    K = np.maximum(delayed - x[OFFSET], 0.0)
    k: Floats = K * (1.0 + x[FADE] * d.relative_speed)
    return k


def _integral(d: Design, k: Floats) -> Floats:
    """∫ k dt, (n,) [s]."""
    step = float(d.t[1] - d.t[0])
    area: Floats = np.concatenate([[0.0], np.cumsum((k[1:] + k[:-1]) * (0.5 * step))])
    return area


def speed_loss(d: Design, x: Floats) -> Floats:
    """What the brake takes from the speed, but for the factor s; (m,) [m/s]."""
    return _speed_loss(d, x, _delayed(d, x))


def _speed_loss(d: Design, x: Floats, delayed: Floats) -> Floats:
    k = _braking_share(d, x, delayed)
    creep = d.creeps * d.speed * k[d.samples] / (G * math.exp(x[STIFFNESS]))
    loss: Floats = d.c * (_integral(d, k)[d.samples] + creep)
    return loss


class BrakeDeceleration:
    """What the brake takes from the speed in one design, at the points of a search.

    A search asks for the same point more than once, and most points share their delay. So the
    latest results are kept.

    Args:
        d: the design.
        capacity: points that are kept.
    """

    def __init__(self, d: Design, capacity: int = len(_STEP_SHARES)) -> None:
        self.d = d
        self._capacity = capacity
        self._bend = _quadratic(d)
        self._cache: dict[tuple[float, ...], Floats] = {}
        self._delayed = math.nan, d.K  # a delay and K(t + τ)

    def speed_loss(self, x: Floats) -> Floats:
        """`speed_loss` without α and γ of each piece, (m,) [m/s]."""
        point = tuple(x[[OFFSET, DELAY, STIFFNESS, FADE]].tolist())
        if point not in self._cache:
            if len(self._cache) == self._capacity:
                del self._cache[next(iter(self._cache))]
            self._cache[point] = self._speed_loss(x)
        return self._cache[point]

    def residual(self, x: Floats, gradients: Floats) -> Floats:
        """What the model leaves of the speed, (m,) [m/s]."""
        d, slope = self.d, _repeat_by_piece(self.d, gradients - x[RESISTANCE])
        remainder: Floats = d.v + math.exp(x[SCALE]) * self.speed_loss(x) - slope * d.time
        remainder += x[DRAG] * d.squared
        return remainder

    def columns(self, x: Floats) -> Floats:
        """How what is left changes with each shared parameter, (7, m)."""
        d, s = self.d, math.exp(x[SCALE])
        J = np.empty((_SHARED, len(d.samples)))
        J[SCALE] = s * self.speed_loss(x)
        k = _braking_share(d, x, self._delayed_force(x))[d.samples]
        creep = d.creeps * d.c * d.speed * k / (G * math.exp(x[STIFFNESS]))
        J[STIFFNESS] = -s * _without_bend_by(d, creep, self._bend)
        for i, step in ((OFFSET, 0.005), (FADE, 0.001), (DELAY, 0.01)):
            upper, lower = x.copy(), x.copy()
            upper[i] += step
            lower[i] -= step
            J[i] = s * (self._speed_loss(upper) - self._speed_loss(lower)) / (2.0 * step)
        J[RESISTANCE], J[DRAG] = d.time, d.squared
        return J

    def _speed_loss(self, x: Floats) -> Floats:
        return _without_bend_by(self.d, _speed_loss(self.d, x, self._delayed_force(x)), self._bend)

    def _delayed_force(self, x: Floats) -> Floats:
        if self._delayed[0] != x[DELAY]:
            self._delayed = x[DELAY], _delayed(self.d, x)
        return self._delayed[1]


def residual(d: Design, x: Floats, gradients: Floats) -> Floats:
    """What the model leaves of the speed, (m,) [m/s]."""
    return BrakeDeceleration(d).residual(x, gradients)


def gradients(designs: Sequence[Design], x: Floats) -> list[Floats]:
    """The gradients of each design, of a posterior's mean [m/s²]."""
    edges = np.cumsum([_SHARED, *(len(d.size) for d in designs)])
    return [x[i:j] for i, j in pairwise(edges)]


class _Problem(NamedTuple):
    """Designs with weights, and the prior of all unknowns."""

    brakes: Sequence[BrakeDeceleration]  # of each design
    sample_counts: Sequence[Floats]  # independent samples of each piece
    mean: Floats  # of shared parameters, then of gradients
    information: Floats  # inverse of its covariance

    def gradients(self, x: Floats) -> list[Floats]:
        """The gradients of each design."""
        return gradients([b.d for b in self.brakes], x)


def _problem(
    brakes: Sequence[BrakeDeceleration],
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
) -> _Problem:
    total = _SHARED + sum(len(b.d.size) for b in brakes)
    mean, information = np.zeros(total), np.zeros((total, total))
    for i, p in prior.items():
        mean[i], information[i, i] = p.value, p.tolerance**-2.0
    start = _SHARED
    for brake in brakes:
        rows = slice(start, start + len(brake.d.size))
        information[rows, rows] = np.linalg.inv(brake.d.gradient_covariance)
        start = rows.stop
    return _Problem(brakes, sample_counts, mean, information)


def _cost(p: _Problem, x: Floats) -> float:
    """−2 log of the posterior, every piece's own variance taken as is likeliest."""
    deviation = x - p.mean
    cost = float(deviation @ p.information @ deviation)
    for brake, sample_count, gradients in zip(
        p.brakes, p.sample_counts, p.gradients(x), strict=True
    ):
        d = brake.d
        squares = _piece_sums(d, brake.residual(x, gradients) ** 2) / d.size + d.floor**2
        cost += float(sample_count @ np.log(squares))
    return cost


def _normal(p: _Problem, x: Floats) -> tuple[Floats, Floats]:
    """Normal equations at a point: matrix and right side."""
    A, b = p.information.copy(), p.information @ (x - p.mean)
    start = _SHARED
    for brake, sample_count, gradients in zip(
        p.brakes, p.sample_counts, p.gradients(x), strict=True
    ):
        d, residual = brake.d, brake.residual(x, gradients)
        weights = sample_count / (_piece_sums(d, residual**2) + d.size * d.floor**2)
        J = brake.columns(x)
        JW = J * _repeat_by_piece(d, weights)
        A[:_SHARED, :_SHARED] += JW @ J.T
        b[:_SHARED] += JW @ residual
        rows = slice(start, start + len(d.size))
        cross = -_piece_sums(d, JW * d.time)
        A[:_SHARED, rows] += cross
        A[rows, :_SHARED] += cross.T
        A[rows, rows] += np.diag(weights * _piece_sums(d, d.time**2))
        b[rows] -= weights * _piece_sums(d, d.time * residual)
        start = rows.stop
    return A, b


def fit(
    designs: Sequence[Design],
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
) -> Posterior:
    """The posterior of the shared parameters and of every piece's gradient.

    Args:
        designs: of one log or of many.
        sample_counts: independent samples of each piece, from `independent_samples`.
        prior: of each shared parameter; an infinite tolerance frees it.
        starts: points to begin at: shared parameters, or these and the gradients.
    """
    return _search(
        [BrakeDeceleration(d) for d in designs], sample_counts, prior, starts
    ).posterior()


class _Likeliest(NamedTuple):
    """The maximum of a posterior."""

    problem: _Problem
    prior: Mapping[int, Parameter]
    mean: Floats  # of the shared parameters, then of every piece's gradient [m/s²]
    cost: float  # as of `Posterior`

    def posterior(self) -> Posterior:
        """The same with its covariance."""
        covariance = invert_normal(_normal(self.problem, self.mean)[0])
        sigmas = np.array([self.prior[i].tolerance for i in range(_SHARED)])
        prior_mean = self.problem.mean[:_SHARED]
        return Posterior(prior_mean, sigmas, self.mean, covariance, self.cost)


def _search(
    brakes: Sequence[BrakeDeceleration],
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
) -> _Likeliest:
    p = _problem(brakes, sample_counts, prior)
    points = [_with_gradients(p, x) for x in starts]
    costs = [_cost(p, x) for x in points]
    best, cost = points[int(np.argmin(costs))], min(costs)
    limits = np.full(len(best), 2.0)
    reach = min(_LARGEST_DELAY, *(float(b.d.t[-1]) / 4.0 for b in brakes))
    limits[:_SHARED] = math.log(_LARGEST_FACTOR), _LARGEST_OFFSET, reach, 12.0, 0.05, 0.5, 5e-4
    for _ in range(15):
        A, b = _normal(p, best)
        d = _sizes(A)  # the units differ by powers of ten
        change = np.linalg.pinv(A / np.outer(d, d), hermitian=True) @ (b / d) / d
        trials = [np.clip(best - share * change, -limits, limits) for share in _STEP_SHARES]
        costs = [_cost(p, x) for x in trials]
        gained = cost - min(costs)
        if gained > 0.0:
            best, cost = trials[int(np.argmin(costs))], min(costs)
        if gained < _CONVERGED:
            break
    return _Likeliest(p, prior, best, cost)


def joint(designs: Sequence[Design], prior: Mapping[int, Parameter]) -> Posterior:
    """The posterior of joined designs, each with as many samples as are independent."""
    start = np.array([prior[i].value for i in range(_SHARED)])
    coarse_mean = fit(designs, [d.size for d in designs], prior, [start]).mean
    pairs = zip(designs, gradients(designs, coarse_mean), strict=True)
    sample_counts = [
        independent_samples(d, residual(d, coarse_mean, slopes)) for d, slopes in pairs
    ]
    return fit(designs, sample_counts, prior, [coarse_mean])


def _with_gradients(p: _Problem, x: Floats) -> Floats:
    """A point with gradients: those of least squares, drawn towards their prior."""
    if len(x) == len(p.mean):
        return x
    blocks = [x[:_SHARED]]
    for brake in p.brakes:
        d = brake.d
        residual = brake.residual(x, np.zeros(len(d.size)))
        blocks.append(
            np.clip(_piece_sums(d, residual * d.time) / _piece_sums(d, d.time**2), -0.5, 0.5)
        )
    return np.concatenate(blocks)


def _sizes(A: Floats) -> Floats:
    """Divisors of rows and columns that make normal equations of like size; 1 for an empty row."""
    d = np.sqrt(np.maximum(np.diag(A), 0.0))
    return np.where(d > 0.0, d, 1.0)


def invert_normal(A: Floats) -> Floats:
    """Inverse of normal equations, by rows of like size; infinite where nothing determines one."""
    d, empty = _sizes(A), np.diag(A) <= 0.0
    C = A / np.outer(d, d)
    values, vectors = np.linalg.eigh(C)
    regular = values > _SINGULAR
    inverse: Floats = (
        (vectors[:, regular] / values[regular]) @ vectors[:, regular].T / np.outer(d, d)
    )
    singular = (vectors[:, ~regular] ** 2).sum(axis=1) > _SINGULAR
    inverse[singular | empty, singular | empty] = np.inf
    return inverse


def independent_samples(d: Design, residuals: Floats) -> Floats:
    """Independent samples of each piece (p,), by how neighbours correlate in what is left (m,)."""
    pair = np.append(residuals[1:] * residuals[:-1], 0.0)
    pair[d.piece_start[1:] - 1] = 0.0
    correlation = _piece_sums(d, pair) / (
        _piece_sums(d, residuals**2) + d.size * _FLOOR**2
    )  # rounding is alike
    correlation = np.clip(correlation, 0.0, 0.99)
    return d.size * (1.0 - correlation) / (1.0 + correlation)


def _starts(brake: BrakeDeceleration, prior: Mapping[int, Parameter]) -> list[Floats]:
    """Where to look: with what is free, each by itself."""
    d = brake.d
    base = np.array([prior[i].value for i in range(_SHARED)])
    reach = min(_LARGEST_DELAY, float(d.t[-1]) / 4.0)
    delays = np.linspace(-reach, reach, 41) if math.isinf(prior[DELAY].tolerance) else [0.0]
    scales = math.isinf(prior[SCALE].tolerance)
    points = [(delay, 0.0) for delay in delays]
    points += [(0.0, o) for o in (-0.3, -0.1, 0.1, 0.3, 0.5)] * scales
    starts = []
    for delay, offset in points:
        x = base.copy()
        x[DELAY], x[OFFSET] = delay, offset
        if scales:
            x[SCALE] = _likeliest_scale(brake, x)
        starts.append(x)
    return starts


def _likeliest_scale(brake: BrakeDeceleration, x: Floats) -> float:
    """The ln s that fits best with any gradients."""
    d = brake.d
    u, v = _without_slope(d, brake.speed_loss(x)), _without_slope(d, d.v)
    A, B, C = _piece_sums(d, v * v), _piece_sums(d, v * u), _piece_sums(d, u * u)
    s = _FACTORS[:, None]
    squares = np.maximum(A + 2.0 * s * B + s * s * C, 0.0) / d.size + d.floor**2
    return math.log(float(_FACTORS[np.argmin(np.log(squares) @ d.size)]))


# What explains how the train slows


def explain(
    axles: Sequence[AxleChannels],
    coarse_grid: Grid | None,
    vehicle: Vehicle,
    fine_grid: Grid | None = None,
) -> Explanation:
    """The best explanation of how the train slows; the stated vehicle where the log shows none.

    Args:
        axles: all axles of the log, on one clock each.
        coarse_grid: the same on one time axis, where they have one.
        vehicle: what is stated of it.
        fine_grid: the same in steps of `FINE_STEP`, where it is known already.
    """
    fine_grid = fine_grid or (grid(axles, vehicle, FINE_STEP) if coarse_grid else None)
    if coarse_grid is None or fine_grid is None:
        return AS_STATED
    rims = build_design(axles, vehicle, coarse_grid, fine_grid)
    train = (
        build_design(axles, vehicle, coarse_grid, fine_grid, True)
        if fine_grid.train is not None
        else None
    )
    if rims is None:
        return AS_STATED._replace(design=train)
    e = _explain(rims, vehicle)
    # A wheel on its way into a slide slows harder than it should; the train does not.
    if e.line and fine_grid.train is not None and not (train and _explain(train, vehicle).line):
        e = e._replace(
            line=None,
            pressure_delay=AS_STATED.pressure_delay if e.delay_or_line else e.pressure_delay,
            delay_or_line=False,
        )
    return e._replace(design=train or rims)


def _explain(d: Design, vehicle: Vehicle) -> Explanation:
    """What explains this speed, of wheels that creep or of the train, which only has to agree."""
    clearly = CLEAR_GAIN if d.creeps else CLEAR_GAIN / 2.0
    prior = stated_prior(d, vehicle) | {DRAG: _NO_DRAG}
    offset = Parameter(0.0, max(_OFFSET_SIGMA, _spring(d, vehicle).value))
    any_delay = {DELAY: Parameter(0.0, math.inf)}
    any_line = {SCALE: Parameter(0.0, math.inf), OFFSET: offset}
    free_prior = {**prior, **any_delay, **any_line}
    brake = BrakeDeceleration(d, _STARTS)
    start = np.array([prior[i].value for i in range(_SHARED)])
    stated_fit = _search([brake], [d.size], prior, [start])
    pieces = _gradients(d, stated_fit.posterior())
    near_fit = _search([brake], [d.size], free_prior, [stated_fit.mean])
    mean_squares = (
        _piece_sums(d, brake.residual(stated_fit.mean, stated_fit.mean[_SHARED:]) ** 2) / d.size
    )
    noise = _NOISE_RATIO * math.hypot(d.noise, d.floor)
    if stated_fit.cost - near_fit.cost < clearly and (mean_squares < noise**2).all():
        return AS_STATED._replace(pieces=pieces)
    global_starts = _starts(brake, free_prior)
    free_fit = _search([brake], [d.size], free_prior, global_starts)
    sample_counts = [
        independent_samples(
            d, _without_slope(d, brake.residual(free_fit.mean, np.zeros(len(d.size))))
        )
    ]
    fits = {"stated": _search([brake], sample_counts, prior, _starts(brake, prior))}
    for name, cause_prior in (("late", {**prior, **any_delay}), ("line", {**prior, **any_line})):
        fits[name] = _best(
            brake, sample_counts, cause_prior, _starts(brake, cause_prior), [fits["stated"]]
        )
    fits["both"] = _best(
        brake, sample_counts, free_prior, [*global_starts, free_fit.mean], list(fits.values())
    )
    return _judge(d, sample_counts, fits, vehicle, clearly)._replace(pieces=pieces)


def _best(
    brake: BrakeDeceleration,
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
    inside: Sequence[_Likeliest],
) -> _Likeliest:
    """The best fit from the best of `starts` and from each fit with fewer unknowns.

    A model is never less likely than one that it contains; one search may end where it is. Of few
    pieces the gradients explain as much as a line does, and a better fit shows nothing.
    """
    contained_fits = inside if len(brake.d.size) >= _SEVERAL_PIECES else ()
    start_sets = [starts, *([fit.mean] for fit in contained_fits)]
    return min(
        (_search([brake], sample_counts, prior, x) for x in start_sets), key=lambda fit: fit.cost
    )


def _gradients(d: Design, p: Posterior) -> tuple[Piece, ...]:
    """What each piece needs as a gradient, by the vehicle as stated."""
    pieces = []
    for i, (piece_start, size) in enumerate(zip(d.piece_start, d.size.astype(int), strict=True)):
        start, stop = (float(d.t[d.samples[k]]) for k in (piece_start, piece_start + size - 1))
        slope = Parameter(float(p.mean[_SHARED + i]), p.sigma(_SHARED + i))
        pieces.append(Piece(start, stop, slope))
    return tuple(pieces)


def _judge(
    d: Design,
    sample_counts: Sequence[Floats],
    fits: Mapping[str, _Likeliest],
    vehicle: Vehicle,
    clear_gain: float,
) -> Explanation:
    """What the likelihoods of all causes say together.

    Args:
        d: the pieces.
        sample_counts: independent samples of each.
        fits: the likeliest point of each cause.
        vehicle: what is stated of it.
        clear_gain: gain of another cause that is clear.
    """
    delay_fit, line, both_fit = fits["late"], fits["line"], fits["both"]
    no_brake = float(
        sample_counts[0] @ np.log(_piece_sums(d, _without_slope(d, d.v) ** 2) / d.size + d.floor**2)
    )
    single_cost = min(delay_fit.cost, line.cost)
    if min(single_cost, both_fit.cost) > min(fits["stated"].cost, no_brake) - clear_gain:
        return AS_STATED
    if needs_both := both_fit.cost < single_cost - clear_gain:
        delay_fit = line = both_fit
    uncertain = STATED_SIGMAS * _spring(d, vehicle).tolerance
    allowed = math.log1p(math.hypot(STATED_SIGMAS * tolerance(vehicle), uncertain))
    tau, (ln_s, o) = delay_fit.posterior().delay, line.mean[[SCALE, OFFSET]].tolist()
    s = math.exp(ln_s)
    is_delayed = abs(tau.value) > max(
        _LEAST_DELAY, _INTERVAL_SHARE * d.interval, _SURE_SIGMAS * tau.tolerance
    )
    line_differs = abs(o) > max(_SMALL_OFFSET, uncertain)
    line_differs |= max(abs(math.log(s)), abs(math.log(s * max(1.0 - o, 1e-3)))) > allowed
    if not needs_both:  # what is as likely and nothing to report leaves the other one in doubt
        if abs(delay_fit.cost - line.cost) < EQUAL_GAIN:
            is_delayed = line_differs = is_delayed and line_differs
        elif delay_fit.cost < line.cost:
            line_differs = False
        else:
            is_delayed = False
    # Where all wheels slide from the first moment on, they slow harder than by their brakes.
    slides = not d.shows_slides and s > 1.0 and math.sqrt(d.v @ d.v / len(d.v)) < _LITTLE_SPEED
    unexplained = (
        _residual_share(d, sample_counts[0], min(delay_fit, line, key=lambda f: f.cost))
        > _LARGEST_RESIDUAL
    )
    if unexplained or (line_differs and (slides or not 1.0 / _ANY_FACTOR < s < _ANY_FACTOR)):
        return AS_STATED
    return Explanation(
        tau if is_delayed else AS_STATED.pressure_delay,
        OtherForceLine(s, o * d.top, s * (1.0 - o)) if line_differs else None,
        is_delayed and line_differs and not needs_both,
    )


def _without_slope(d: Design, x: Floats) -> Floats:
    """What is left of x without a straight slope of its piece, (m,)."""
    return x - _repeat_by_piece(d, _piece_sums(d, x * d.time) / _piece_sums(d, d.time**2)) * d.time


def _residual_share(d: Design, sample_counts: Floats, p: _Likeliest) -> float:
    """Share of the speed's square that is left, rounding apart."""
    mean_squares = _piece_sums(d, residual(d, p.mean, p.mean[_SHARED:]) ** 2) / d.size
    total_squares = _piece_sums(d, _without_slope(d, d.v) ** 2) / d.size
    return float(
        sample_counts @ np.maximum(mean_squares - d.floor**2, 0.0) / (sample_counts @ total_squares)
    )
