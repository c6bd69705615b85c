"""The brake of a train from its log alone: a straight line of the deceleration over the pressure.

All axles together stop the train, whether they roll or slide. With the adhesion of each from its
own brake, (1) gives

    −v̇ − r = (1 + ρ) c mean(max(x − x₀, 0)) + ρ mean(ω̇R),

with x the axles' pressures (or clamping forces, where the log has these), x₀ the value from which
the brake acts, ρ the rotating mass over the mass and r the deceleration of a train that coasts.
c is the deceleration of a train that rolls, per pressure. No vehicle is needed for that. Where a
friction table is stated, each x − x₀ counts by the table's φ at its speed and force.

The line is rough: it knows no gradient. The longitudinal model begins at it, and where no brake
application has wheels that all roll, it is all that the log says of the brake.

Samples with a larger error count less (Huber, Ann. Math. Stat. 35 (1964) 73). x₀ has a prior, since
a log whose brake applications have one pressure does not show it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core.masks import erode, true_runs
from ..core.model import Bools, DifferingStop, Floats, Parameter, SpeedEffect
from ..core.physics import CRAWL, GRADIENT, NO_FORCE, RELEASED_SHARE, STANDING
from ..core.signals import largest_nearby, robust_sigma
from ..records.axle_channels import AxleChannels
from .grid import FEWEST, Grid
from .longitudinal import RESISTANCE_OF_TRAINS

_ZERO = Parameter(1.5e4, 2e4)  # pressure from which brakes act, of any kind with air [Pa]
# The usual and the highest pressure of air brakes; x₀ of a hydraulic one grows with its own [Pa]
_USUAL_AIR, _HIGHEST_AIR = 3.5e5, 1.2e6
ANY_SHARE = 1.0  # 1 sigma of ln of a force per mass of which nothing is known
ROTATING = Parameter(0.08, 0.03)  # rotating mass over mass, of any wheelset [-]
_ZERO_SHARE = 0.02  # 1 sigma of x₀ of a clamping force, of the highest one
_LOWEST_BRAKE = 2e4  # a highest pressure below it brakes nothing [Pa]
_LEAST_KNOWN = 0.5  # of the log: a sensor with less of it is gone
_SINGULAR = 1e14  # condition of normal equations that have no solution; their units differ by 1e10
_APPLIED = 0.1  # of the highest pressure: a brake is on
_RELEASED = 0.03  # of the highest pressure: none is
_STEADY = 0.1  # of the highest pressure, within a second: more is a change
_HUBER = 1.5  # sigma from which an error counts less
_LEAST_SHARE = 0.6  # of the line's deceleration that a brake of any friction has
_SIGMAS = 3.0  # of gradients
_LARGEST_SLIP, _LARGEST_DIFFERENCE = 0.02, 0.25  # of wheels that roll [-], [m/s]
_ROLLING_SHARE = 0.2  # of the braking: less rolling says little of it
_FRICTION_SCATTER = 0.05  # 1 sigma of the friction from stop to stop, by heat
_SURE_SIGMAS = 4.0  # from which a stop differs from the others
_STRONG_SHARE = 0.5  # of the strongest braking: with less, the gradient says more than the friction
_SHORTEST_STOP = 2.0  # a shorter one has no mean [s]
_SHORTEST_MIXED = 0.9  # less deceleration for a shorter time is no other brake [s]
_SHORTEST_PART = 2.0  # of a stop that shows its first level [s]
_TAKEN_OVER = 0.3  # growth of the pressure where a brake takes over from another one
_FOLLOWING = 0.25  # of it: a deceleration that grows by less does not follow the pressure
_ROUNDS = 20  # of the weights
_LARGEST_SCATTER = 0.3  # of the deceleration: with more, it does not follow the pressure


class BrakeLine(NamedTuple):
    """How a train slows by its brake."""

    slope: float  # c, deceleration per pressure or clamping force [m/s² per Pa or N]
    zero: float  # x₀ [Pa or N]
    prior_zero: Parameter  # the same before the log [Pa or N]
    sigma: float  # 1 sigma of ln c at the mean brake, by gradient, resistance, scatter and ρ
    brake: float  # mean of the pressure or clamping force that acts, above x₀ [Pa or N]
    speed: float  # mean speed [m/s]
    rolling: bool  # whether all axles roll in it
    # stops that the line does not explain, after the first time of the grid
    differing: tuple[DifferingStop, ...] = ()
    speed_effect: SpeedEffect | None = None  # None where too little rolls slowly or fast
    mass: Parameter | None = None  # of an axle, by the forces of motors; None: it is stated [kg]
    mixed: bool = False  # whether wheels slow much less than it says: another brake acted as well


def find_brake_line(
    axles: Sequence[AxleChannels],
    grid: Grid,
    rotating: Parameter = ROTATING,
    by_motors: tuple[Floats, Floats] | None = None,
) -> BrakeLine | None:
    """The line of a log, whose axles are on one clock; None where it shows none.

    `rotating` is ρ, rotating mass over mass. `by_motors` is the deceleration by the force of the
    motors, and 1 sigma of it (n,) [m/s²]; None where no mass is known that it slows: then only
    samples without it are used.
    """
    rho = rotating.value
    by_pressure = all(a.brake.meaning == "pressure" for a in axles)
    clamping = grid.friction_clamping
    x = np.array([grid.smooth(row) for row in (grid.pressure if by_pressure else clamping)])
    shares = np.broadcast_to(grid.friction if by_pressure else 1.0, x.shape)
    friction = np.nan_to_num(shares, nan=1.0)
    grid, x, friction = _without_gone_sensors(grid, x, friction)
    if not len(x):
        return None
    mean_x = np.mean(x, axis=0)
    top = float(np.nanmax(mean_x, initial=0.0))
    rim_slowing = np.mean(grid.slowing(grid.rim), axis=0)
    slowing = rim_slowing if grid.train is None else grid.slowing(grid.train)
    v = np.mean(grid.rim, axis=0) if grid.train is None else grid.train
    measured: Bools = np.isfinite(mean_x) & np.isfinite(slowing) & np.isfinite(rim_slowing)
    motors, motor_sigma = by_motors or (np.zeros(len(v)), np.zeros(len(v)))
    if by_motors is None and grid.motors is not None:
        pull = np.abs(np.mean(grid.motors, axis=0))
        measured &= erode(pull <= RELEASED_SHARE * np.nanmax(pull, initial=0.0), grid.half_width)
    measured &= (v > CRAWL) & erode(np.all(grid.rim > STANDING, axis=0), 2 * grid.half_width)
    rolling: Bools = np.all(grid.rolling, axis=0)
    if not top > (_LOWEST_BRAKE if by_pressure else NO_FORCE):
        return None
    steady = erode(np.abs(grid.slope(mean_x)) <= _STEADY * top, grid.half_width)
    applied = measured & (mean_x > _APPLIED * top)
    choices, fewest = [applied & rolling & steady, applied & rolling], FEWEST
    if grid.train is not None:  # it shows what slides add, so a small part of the braking is none
        choices.append(applied)
        fewest = max(FEWEST, round(_ROLLING_SHARE * float(applied.sum())))
    braked = next((mask for mask in choices if mask.sum() >= fewest), None)
    if braked is None:
        return None
    released = measured & rolling & (mean_x < _RELEASED * top) & ~grid.driven
    rates = (slowing - motors)[released]
    rates = rates[np.abs(rates) < GRADIENT]  # driven stretches apart
    coasting = float(np.median(rates)) if len(rates) >= FEWEST else RESISTANCE_OF_TRAINS.value
    by_brake = (slowing + rho * rim_slowing) / (1.0 + rho) - coasting - motors
    zero = any_zero(top) if by_pressure else Parameter(0.0, _ZERO_SHARE * top)
    stops, acting = true_runs(braked), _acting(x[:, braked], friction[:, braked])
    line = _fit(acting, by_brake[braked], zero, len(stops), grid.gradient_sigma)
    if line is None:
        return None
    # How the deceleration by the brake changes with ρ: wheels that roll cancel it.
    by_rotating = np.where(rolling, 0.0, rim_slowing - slowing)[braked] / (1.0 + rho) ** 2
    of_rotating = float(np.mean(by_rotating)) * rotating.tolerance / (line.slope * line.brake)
    of_motors = float(np.mean(motor_sigma[braked])) / (line.slope * line.brake)
    lowest_x = -largest_nearby(-mean_x, 2 * grid.half_width)  # within a second
    least_acting = np.min(friction, axis=0) * (lowest_x - line.zero)
    slows_less = _slows_less(grid, least_acting, rim_slowing - coasting - motors, line)
    slows_less &= applied  # for long; wheels that slide together recover in between
    recovers_not = np.min(rim_slowing[slows_less], initial=np.inf) > GRADIENT / 2.0
    return line._replace(
        sigma=math.hypot(line.sigma, of_rotating, of_motors),
        speed=float(np.mean(v[braked])),
        rolling=bool(rolling[braked].all()),
        mixed=bool(slows_less.sum() * grid.step > _SHORTEST_MIXED and recovers_not)
        or _takes_over(mean_x, by_brake, applied & _agree(grid), steady, grid.step),
        differing=tuple(_differing_stops(grid, acting, by_brake[braked], stops, line)),
        speed_effect=_speed_effect(grid, line, acting, by_brake[braked], v[braked], len(stops)),
    )


def any_zero(top: float) -> Parameter:
    """The pressure from which a brake acts of which only the highest pressure is known [Pa]."""
    scale = top / _USUAL_AIR if top > _HIGHEST_AIR else 1.0
    return Parameter(scale * _ZERO.value, scale * _ZERO.tolerance)


def _without_gone_sensors(grid: Grid, x: Floats, friction: Floats) -> tuple[Grid, Floats, Floats]:
    """Without axles, or the train speed, of which half of what is recorded or more has no value."""
    # a pause of the recorder is no loss of a sensor, and pressures that are left out are none
    recorded = np.isfinite(grid.rim).any(axis=0) & np.isfinite(x).any(axis=0)
    fewest_samples = _LEAST_KNOWN * recorded.sum()
    lasts = np.isfinite(grid.rim[:, recorded]).sum(axis=-1) > fewest_samples
    lasts &= np.isfinite(x[:, recorded]).sum(axis=-1) > fewest_samples
    train = grid.train
    if train is not None and not np.isfinite(train[recorded]).sum() > fewest_samples:
        train = None
    if lasts.all() and train is grid.train:
        return grid, x, friction
    rows = (grid.rim[lasts], grid.clamping[lasts], grid.pressure[lasts])
    motors = None if grid.motors is None else grid.motors[lasts]
    grid = replace(grid, rim=rows[0], clamping=rows[1], pressure=rows[2], train=train)
    return replace(grid, motors=motors), x[lasts], friction[lasts]


class _Acting(NamedTuple):
    """What acts of the axles' pressures or clamping forces; shape (n,)."""

    pressures: Floats  # or clamping forces, (k, n)
    mean: Floats  # over all axles, each times its friction
    share: Floats  # of the axles, times the same; the others are released, or vented by a valve

    def excess(self, zero: float) -> Floats:
        """Mean of what is above x₀."""
        excess: Floats = self.mean - self.share * zero
        return excess


def _acting(x: Floats, friction: Floats) -> _Acting:
    acting = np.where(x > _APPLIED * float(np.max(x)), friction, 0.0)
    return _Acting(x, np.mean(acting * x, axis=0), np.mean(acting, axis=0))


def _slows_less(grid: Grid, acting: Floats, rim_slowing: Floats, line: BrakeLine) -> Bools:
    """Where wheels that roll slow much less than the line says, shape (n,).

    A brake that takes over from another one has the same deceleration at a higher pressure.
    `acting` is the least that acts within a second; `rim_slowing` is by the brake [m/s²].
    """
    slowest = _LEAST_SHARE * line.slope * acting - _SIGMAS * grid.gradient_sigma
    return erode(_agree(grid), 4 * grid.half_width) & (rim_slowing < slowest)


def _agree(grid: Grid) -> Bools:
    """Where no axle turns much slower than the train: axles that slide differ; (n,)."""
    lowest_rim, v = np.min(grid.rim, axis=0), np.max(grid.rim, axis=0)
    v = v if grid.train is None else np.fmax(v, grid.train)
    agree: Bools = v - lowest_rim < _LARGEST_SLIP * v + _LARGEST_DIFFERENCE
    return agree


def _takes_over(x: Floats, by_brake: Floats, applied: Bools, steady: Bools, step: float) -> bool:
    """Whether most stops end at a higher pressure than they began, but with the same deceleration.

    An ED brake fades out at low speed, and the brake by pressure takes over from it. `x` is the
    mean of the pressures or clamping forces; masks and columns have shape (n,).
    """
    size, judged, taken_over = max(round(_SHORTEST_PART / step), 1), 0, 0
    for start, stop in true_runs(applied):
        calm = start + np.flatnonzero(steady[start:stop])[:size]
        if len(calm) == size:
            growth, slowing_growth = (y[stop - 1] / np.mean(y[calm]) - 1.0 for y in (x, by_brake))
            judged += 1
            taken_over += bool(growth > _TAKEN_OVER and slowing_growth < _FOLLOWING * growth)
    return taken_over > judged / 2


def _differing_stops(
    grid: Grid, acting: _Acting, by_brake: Floats, stops: Sequence[tuple[int, int]], line: BrakeLine
) -> Iterator[DifferingStop]:
    """The stops that no gradient and no scatter of the friction brings to the line.

    `acting`, and the deceleration by the brake [m/s²], are those in the stops, (n,).
    """
    expected = line.slope * acting.excess(line.zero)
    place = 0  # of the stop's first sample in those of all stops
    for start, stop in stops:
        samples = slice(place, place + stop - start)
        place = samples.stop
        force, deceleration = np.mean(expected[samples]), np.mean(by_brake[samples])
        sigma = math.hypot(grid.gradient_sigma, _FRICTION_SCATTER * force)
        seconds = (stop - start) * grid.step
        if seconds > _SHORTEST_STOP and abs(deceleration - force) > _SURE_SIGMAS * sigma:
            span = start * grid.step, (stop - 1) * grid.step
            yield DifferingStop(*span, float(deceleration / force))


def _speed_effect(
    grid: Grid, line: BrakeLine, acting: _Acting, by_brake: Floats, v: Floats, stops: int
) -> SpeedEffect | None:
    """How much harder the brake slows at low than at high speed, over what the line says.

    Low is the lowest third of the speeds, high the highest. Pressures, or clamping forces, that are
    strong count. The deceleration by the brake is in m/s², the gradient of each brake application
    is one error.
    """
    expected = line.slope * acting.excess(line.zero)
    strength = _acting(acting.pressures, np.ones_like(acting.pressures)).excess(line.zero)
    is_strong = strength > _STRONG_SHARE * np.max(strength)
    is_slow, is_fast = (is_strong & mask for mask in (v < np.max(v) / 3.0, v > np.max(v) / 1.5))
    if min(is_slow.sum(), is_fast.sum()) < FEWEST:
        return None
    slowing = [(np.mean(by_brake[mask]), np.mean(expected[mask])) for mask in (is_slow, is_fast)]
    factor_at_low, factor_at_high = (float(measured / line) for measured, line in slowing)
    if not min(factor_at_low, factor_at_high) > 0.0:
        return None
    sigma = grid.gradient_sigma / math.sqrt(stops) * math.hypot(*(1.0 / x for x, _ in slowing))
    return SpeedEffect(
        ratio=factor_at_low / factor_at_high,
        sigma=sigma,
        low=float(np.mean(v[is_slow])),
        high=float(np.mean(v[is_fast])),
    )


def _fit(
    acting: _Acting, by_brake: Floats, zero: Parameter, stops: int, gradient_sigma: float
) -> BrakeLine | None:
    """Slope and zero by least squares with weights, and with the prior of the zero.

    The gradient of each uninterrupted stretch of `stops` is one error, with 1 sigma [m/s²].
    """
    x0, (_, mean_x, share) = zero.value, acting
    slope = float(np.sum(by_brake)) / max(float(np.sum(acting.excess(x0))), 1e-9)
    error = by_brake
    for _ in range(_ROUNDS):
        error = by_brake - slope * acting.excess(x0)
        scatter = robust_sigma(error)
        sigma = math.hypot(scatter, gradient_sigma)
        weights = np.minimum(1.0, _HUBER * sigma / np.maximum(np.abs(error), 1e-9)) / sigma**2
        weights *= stops / len(by_brake)
        prior_weight = 1.0 / max(slope * zero.tolerance, 1e-9) ** 2
        # of c and d = c x₀: c mean(x) − share d, and (d − c x₀)² over its variance
        A = np.array([
            [weights @ mean_x**2, -(weights @ (mean_x * share))],
            [-(weights @ (mean_x * share)), weights @ share**2],
        ])  # fmt: skip
        A += prior_weight * np.array([[zero.value**2, -zero.value], [-zero.value, 1.0]])
        b = np.array([weights @ (mean_x * by_brake), -(weights @ (share * by_brake))])
        if not np.linalg.cond(A) < _SINGULAR:
            return None
        previous, (slope, intercept) = slope, np.linalg.solve(A, b).tolist()
        if not slope > 0.0:
            return None
        x0 = intercept / slope
        if abs(slope - previous) < 1e-4 * slope:
            break
    brake = float(np.mean(acting.excess(x0)))
    deceleration = slope * brake
    scatter = robust_sigma(error)
    unexplained = math.sqrt(max(scatter**2 - gradient_sigma**2, 0.0))  # by gradients
    if deceleration <= 0.0 or unexplained > _LARGEST_SCATTER * deceleration:
        return None
    by_stop = math.hypot(gradient_sigma, scatter) / math.sqrt(stops)
    absolute = math.hypot(by_stop, RESISTANCE_OF_TRAINS.tolerance)
    return BrakeLine(slope, x0, zero, absolute / deceleration, brake, 0.0, False)
