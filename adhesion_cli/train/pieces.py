"""The pieces of a log in which the train rolls: one design of the longitudinal model."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..core.masks import erode, true_runs
from ..core.model import Bools, Floats, Vehicle
from ..core.physics import CRAWL, RELEASED_SHARE, braked, fade_share, force_line, wheelset
from ..core.signals import running_integral, white_noise
from ..records.axle_channels import AxleChannels
from .explanation import Design
from .grid import FEWEST, FINE_STEP, GRADIENT_SIGMA, Grid, Grids
from .longitudinal import DELAY_SIGMA, FLOOR

_GRADIENT = 0.1  # 1 sigma of a gradient: 10 per mille [m/s²]
_GRADIENT_CHANGE = 0.05  # 1 sigma by which it changes from piece to piece of one application [m/s²]
_CORRELATION_LENGTH = 1000.0  # they are correlated by exp(-x) over so many [m], assumed
_UNCORRELATED_GRADIENT = 0.005  # 1 sigma of what is not correlated: curves, wind [m/s²]
_CHANGE = 0.1  # of the highest K within a second: a build-up, a release
_CHANGE_MARGIN = 6.0  # before and after a change [s]
_PIECE = 12.0  # longest piece [s]
_SHORT_PIECE = 3.0  # the same where gradients are along the track [s]
_FEWEST_BENT = 20  # samples: with fewer, γ is not known from what happens between two


def build_design(
    axles: Sequence[AxleChannels], vehicle: Vehicle, grids: Grids, share: float, by_train: bool
) -> Design | None:
    """The pieces of a log; None where no brake application of wheels that roll is seen.

    `share` is that of the train's mass which is braked, see `Train`. With `by_train` the train
    speed is taken, not the mean of the rims.
    """
    coarse_grid, fine_grid = grids
    train = fine_grid.train if by_train else None
    v = np.mean(fine_grid.rim, axis=0) if train is None else train
    t: Floats = fine_grid.step * np.arange(fine_grid.rim.shape[1], dtype=np.float64)
    K, top = _relative_force(axles, vehicle, fine_grid, t)
    finite = np.isfinite(np.mean(fine_grid.clamping, axis=0))
    if top <= 0.0:
        return None
    braking = np.maximum(K, 0.0)
    pieces, run_starts = _pieces(braking, np.nan_to_num(v), finite, coarse_grid, fine_grid)
    if not pieces:
        return None
    samples, piece_start = np.concatenate(pieces), np.cumsum([0, *map(len, pieces[:-1])])
    noise = math.sqrt(white_noise((t[p], v[p]) for p in pieces))
    interval = max(longer_interval(a) for a in axles)
    rounding = max(_rounding_sigma(a) * vehicle.radius(a.record.axle).value for a in axles)
    mean = float(v[samples].mean())
    w = wheelset(vehicle, axles[0].record.axle)
    c = share * float(braked(top, w)) * float(fade_share(mean, vehicle))
    # What straight lines through samples so far apart miss of ∫K dt, by a kink half way.
    earlier_braking, later_braking = (np.interp(t + x, t, braking) for x in (-interval, interval))
    missed = interval * float(np.max(np.abs(earlier_braking - 2.0 * braking + later_braking))) / 8.0
    floor = math.hypot(FLOOR, rounding, c * missed)
    by_motors, motor_sigma = motor_deceleration(fine_grid, vehicle, axles, share)
    floor = math.hypot(floor, DELAY_SIGMA * float(np.max(np.abs(by_motors), initial=0.0)))
    complete_speed = np.interp(t, t[np.isfinite(v)], v[np.isfinite(v)])
    d = Design(
        t=t,
        K=K,
        relative_speed=complete_speed - mean,
        top=top,
        samples=samples,
        gradient_covariance=_gradient_covariance(np.array(run_starts), fine_grid),
        has_quadratic=True,
        measured=v[samples],
        c=c,
        noise=noise,
        floor=floor,
        shows_slides=fine_grid.train is not None,
        interval=interval,
        mean=mean,
        creeps=train is None,
        climb=(fine_grid.climb + np.zeros(len(t)))[samples],
        gradient_sigma=fine_grid.gradient_sigma,
        by_motors=by_motors,
        motor_sigma=motor_sigma,
    )
    d = _with_pieces(d, piece_start)
    return d._replace(gradient_covariance=d.gradient_covariance + _motor_covariance(d))


def _gradient_covariance(run_starts: NDArray[np.int64], grid: Grid) -> Floats:
    """Prior covariance of the gradients of pieces, by the run of each (p,); (p, p) [m²/s⁴]."""
    each = np.eye(len(run_starts))
    covariance: Floats = _GRADIENT**2 * (run_starts[:, None] == run_starts)
    covariance = covariance + _GRADIENT_CHANGE**2 * each
    if grid.gradient_sigma == GRADIENT_SIGMA:
        return covariance
    # The gradient is known: curves and wind stay.
    known = (grid.gradient_sigma / GRADIENT_SIGMA) ** 2
    return known * covariance + _UNCORRELATED_GRADIENT**2 * each


def motor_deceleration(
    grid: Grid, vehicle: Vehicle, axles: Sequence[AxleChannels], braked_share: float
) -> tuple[Floats, Floats]:
    """The deceleration by the force of the motors, and 1 sigma of it, shape (n,) [m/s²].

    Without a channel of that force it is 0, and its error that of a gradient in their place.
    Arguments as of `build_design`.
    """
    n = grid.rim.shape[1]
    if grid.motors is None or grid.motor_sigma is None:
        return np.zeros(n), grid.downhill_sigma
    w, mass = wheelset(vehicle, axles[0].record.axle), vehicle.axle_mass
    slowing = braked_share * braked(np.nan_to_num(np.mean(grid.motors, axis=0)), w)
    sigma = braked_share * braked(np.nan_to_num(np.mean(grid.motor_sigma, axis=0)) / w.phi, w)
    return slowing, np.hypot(sigma, slowing * mass.share)


def _motor_covariance(d: Design) -> Floats:
    """Covariance of the pieces' gradients by the error of the motors' force, (p, p) [m²/s⁴]."""
    sigma = sum_by_piece(d, d.motor_sigma[d.samples]) / d.size
    return np.outer(sigma, sigma)


def _with_pieces(d: Design, piece_start: NDArray[np.int64]) -> Design:
    """The design with pieces that begin at these places in `samples`."""
    sizes = np.diff(piece_start, append=len(d.samples))
    d = d._replace(piece_start=piece_start, size=sizes.astype(np.float64))
    t, u = d.t[d.samples], d.relative_speed + d.mean
    d = d._replace(time=t - repeat_by_piece(d, sum_by_piece(d, t) / d.size))
    # Times are even: a straight line leaves t² without its mean.
    bent = d.time**2 - repeat_by_piece(d, mean_square(d, d.time))
    lengths = np.sqrt(np.maximum(sum_by_piece(d, bent**2), 1e-30))
    is_bent = (d.size >= _FEWEST_BENT) & d.has_quadratic
    d = d._replace(bend=bent * repeat_by_piece(d, np.where(is_bent, 1.0 / lengths, 0.0)))
    unbent = without_bend(d, d.measured + d.climb)  # and below without the motors
    smooth = d.measured - without_slope(d, unbent)
    return d._replace(
        v=unbent + without_bend(d, running_integral(d.t, d.by_motors)[d.samples]),
        speed=smooth,
        squared=without_bend(d, running_integral(d.t, u * u)[d.samples]),
    )


def along_track(d: Design) -> Design:
    """The design in short pieces, whose gradients are correlated along the track."""
    step = float(d.t[1] - d.t[0])
    runs = [0, *(np.flatnonzero(np.diff(d.samples) > 1) + 1), len(d.samples)]
    edges = []
    for a, b in pairwise(runs):
        count = max(1, min(round((b - a) * step / _SHORT_PIECE), (b - a) // FEWEST))
        edges.append(np.linspace(a, b, count + 1)[:-1])
    d = _with_pieces(d._replace(has_quadratic=False), np.concatenate(edges).astype(np.int64))
    distance = sum_by_piece(d, running_integral(d.t, d.relative_speed + d.mean)[d.samples]) / d.size
    separation = np.abs(distance[:, None] - distance) / _CORRELATION_LENGTH
    covariance: Floats = d.gradient_sigma**2 * np.exp(-separation)
    covariance += _UNCORRELATED_GRADIENT**2 * np.eye(len(distance)) + _motor_covariance(d)
    return d._replace(gradient_covariance=covariance)


def join_designs(designs: Sequence[Design], vehicle: Vehicle) -> list[Design]:
    """The designs of several logs with one highest K and one mean speed, for one fit."""
    top = max(d.top for d in designs)
    mean = float(np.average([d.mean for d in designs], weights=[len(d.samples) for d in designs]))
    rescaled = []
    for d in designs:
        fade = float(fade_share(mean, vehicle) / fade_share(d.mean, vehicle))
        c = d.c * top / d.top * fade
        K, faster = d.K * d.top / top, d.relative_speed + d.mean - mean
        rescaled.append(d._replace(K=K, relative_speed=faster, top=top, c=c, mean=mean))
    return rescaled


def _relative_force(
    axles: Sequence[AxleChannels], vehicle: Vehicle, fine_grid: Grid, t: Floats
) -> tuple[Floats, float]:
    """Mean K over its highest value (n,), and that [N]; 0 where there is none."""
    K: Floats = np.mean(fine_grid.friction_clamping, axis=0)
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
    calm = (change < _CHANGE) & (force_share < RELEASED_SHARE)
    near_change = ~erode(calm, round(_CHANGE_MARGIN / fine_grid.step))
    rolling: Bools = np.all(coarse_grid.rolling, axis=0)
    place = np.clip(np.rint(t / coarse_grid.step).astype(int), 0, len(rolling) - 1)
    usable: Bools = near_change & rolling[place] & finite & (v > CRAWL)
    if not coarse_grid.has_traction:
        usable &= ~coarse_grid.driven[place]
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


def _rounding_sigma(a: AxleChannels) -> float:
    """1 sigma of the rounding that is no noise [rad/s]: of a speed that stays on its levels."""
    t, y = a.record.t * 1e-9, a.record.wheel_speed
    durations = np.diff(t[np.flatnonzero(np.diff(y, prepend=np.nan))], append=t[-1])
    constant_share = float(durations[durations > 2.0 * FINE_STEP].sum() / (t[-1] - t[0]))
    return constant_share * a.speed.coarsest / math.sqrt(12.0)


def sum_by_piece(d: Design, x: Floats) -> Floats:
    """Sums over each piece, (..., p)."""
    total: Floats = np.add.reduceat(x, d.piece_start, axis=-1)
    return total


def mean_square(d: Design, x: Floats) -> Floats:
    """Mean square over each piece, (p,)."""
    return sum_by_piece(d, x**2) / d.size


def repeat_by_piece(d: Design, x: Floats) -> Floats:
    """What each piece has, for each of its samples."""
    return x.repeat(d.size.astype(int), axis=-1)


def without_bend(d: Design, x: Floats) -> Floats:
    """What is left of x without α and γ of its piece, (m,): gradients change within it."""
    x = x - repeat_by_piece(d, sum_by_piece(d, x) / d.size)
    if not d.has_quadratic:
        return x
    unbent: Floats = x - repeat_by_piece(d, sum_by_piece(d, x * d.bend)) * d.bend
    return unbent


def without_slope(d: Design, x: Floats) -> Floats:
    """What is left of x without a straight slope of its piece, (m,)."""
    return x - repeat_by_piece(d, sum_by_piece(d, x * d.time) / sum_by_piece(d, d.time**2)) * d.time
