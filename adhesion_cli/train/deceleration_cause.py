"""What explains the deceleration of the train: the stated vehicle, a late pressure, another force.

The longitudinal model of `longitudinal.py` is fitted four times to the pieces of one log:

| fit | delay τ of the pressure | factor s and offset o of the force line |
|---|---|---|
| stated | by its prior | by their priors |
| delayed | free | by their priors |
| other line | by its prior | free |
| both | free | free |

The cost of a fit is −2 ln of its likelihood and prior. A cause counts if it lowers the cost by
`CLEAR_GAIN`. A late pressure and another force line can have nearly the same cost. Then the log
cannot tell which of the two it is, and the explanation says so.

Symbols are those of `longitudinal.py`: x holds the shared parameters in the order of its `UNITS`,
u is the loss of speed by the brake for s = 1, v the measured speed. Both are without a straight
slope in each piece, because the gradient of the track is free.
"""

import math
from collections.abc import Sequence

import numpy as np

from ..core.model import Floats, Parameter, Train, Vehicle
from ..records.axle_channels import AxleChannels
from . import longitudinal
from .explanation import AS_STATED, Design, Explanation, OtherForceLine, Piece
from .grid import Grids
from .longitudinal import DELAY, DRAG, OFFSET, SCALE, SHARED, Prior
from .pieces import build_design, mean_square, sum_by_piece, without_slope
from .solve import Likeliest, Posterior, independent_samples, residual, search, unbent_loss

_LATE_SIGMA = 0.2  # 1 sigma of the train speed's delay from which rolling wheels say more [s]
_NO_DRAG = Parameter(0.0, 1e-9)  # long pieces have it in their gradient and γ [1/m]
_FACTORS = np.exp(np.linspace(math.log(0.05), math.log(20.0), 40))  # values of s that are tried
_OFFSETS = -0.3, -0.1, 0.1, 0.3, 0.5  # values of o that are tried, of the highest K
CLEAR_GAIN = 12.0  # gain in cost from which a cause is clear
EQUAL_GAIN = 8.0  # two causes whose costs differ by less cannot be told apart
STATED_SIGMAS = 3.5  # times the stated tolerance: within it the vehicle is as stated
_NOISE_RATIO = 2.0  # a residual below so many times the noise is explained
_UNEVEN = 0.01  # 1 sigma of what changes on a line of a known gradient [m/s²]
_CHANGE_TIME = 15.0  # in which it does, and an unknown gradient: 300 m at 70 km/h [s]
_SURE_SIGMAS = 4.0  # a delay of so many sigma is sure
_PADS_LAG = 0.03  # 1 sigma of the time by which pads lag their pressure [s]
_OTHER_BRAKE = 1.25  # times the stated force: a brake without a channel may act, and earlier
_CLEAR_SIGMAS = 2.5  # and of so many, where it is another one beside another force line
_LEAST_DELAY = 0.1  # a shorter delay is the caliper's own [s]
_INTERVAL_SHARE = 0.75  # of the longer sampling interval: a shorter delay may be the sampling's
_SMALL_OFFSET = 0.05  # of the highest K: a smaller offset hardly shows in the force
_OFFSET_SIGMA = 0.15  # 1 sigma of a free offset, of the highest K
_LARGEST_RESIDUAL = 0.2  # share of the speed's square: with more left, nothing is explained
_SEVERAL_PIECES = 3  # from so many pieces on, a common line is more than their gradients
_LITTLE_SPEED = 0.1  # a smaller change of speed shows little of a brake [m/s]
_ANY_FACTOR = 25.0  # s or 1/s above this is no other vehicle


def _start_points(d: Design, prior: Prior) -> list[Floats]:
    base = np.array([prior[i].value for i in range(SHARED)])
    reach = min(longitudinal.LARGEST_DELAY, float(d.t[-1]) / 4.0)
    delays = np.linspace(-reach, reach, 41) if math.isinf(prior[DELAY].tolerance) else [0.0]
    scale_is_free = math.isinf(prior[SCALE].tolerance)
    points = [(delay, 0.0) for delay in delays]
    points += [(0.0, offset) for offset in _OFFSETS] * scale_is_free
    starts = []
    for delay, offset in points:
        x = base.copy()
        x[DELAY], x[OFFSET] = delay, offset
        if scale_is_free:
            x[SCALE] = _likeliest_scale(d, x)
        starts.append(x)
    return starts


def _likeliest_scale(d: Design, x: Floats) -> float:
    """The ln s that fits best with any gradients: each piece leaves Σ (v + s u)²."""
    u, v = without_slope(d, unbent_loss(d, x)), without_slope(d, d.v)
    vv, vu, uu = sum_by_piece(d, v * v), sum_by_piece(d, v * u), sum_by_piece(d, u * u)
    s = _FACTORS[:, None]
    squares = np.maximum(vv + 2.0 * s * vu + s * s * uu, 0.0) / d.size + d.floor**2
    return math.log(float(_FACTORS[np.argmin(np.log(squares) @ d.size)]))


def explain_deceleration(
    axles: Sequence[AxleChannels],
    grids: Grids | None,
    vehicle: Vehicle,
    train: Train = Train(),  # noqa: B008 (a value that cannot change)
) -> Explanation:
    """The best explanation of how the train slows; the stated vehicle where the log shows none.

    `grids` are None where the axles have no time in common. `train` says what its other cars do.
    """
    if grids is None:
        return AS_STATED
    braked_share = train.braked_share(vehicle, len(axles))
    rim_design = build_design(axles, vehicle, grids, braked_share, False)
    uses_train_speed = grids.fine.train is not None and not (rim_design and _may_be_late(axles))
    train_design = None
    if uses_train_speed:
        train_design = build_design(axles, vehicle, grids, braked_share, True)
    if rim_design is None:
        return AS_STATED._replace(design=train_design)
    explanation = _explain_design(rim_design, vehicle)
    # A wheel on its way into a slide slows harder than by its brake. The train does not.
    if explanation.line and uses_train_speed:
        train_line = _explain_design(train_design, vehicle).line if train_design else None
        if train_line is None:
            if explanation.delay_or_line:  # the delay may be the line, too
                explanation = explanation._replace(pressure_delay=AS_STATED.pressure_delay)
            explanation = explanation._replace(line=None, delay_or_line=False)
    return explanation._replace(design=train_design or rim_design)


def _may_be_late(axles: Sequence[AxleChannels]) -> bool:
    """Whether the delay of the train speed is so uncertain that rolling wheels show more.

    It is uncertain where an offset of the speed explains the same as a delay.
    """
    delay = axles[0].record.train_speed_late
    return delay is not None and delay.tolerance > _LATE_SIGMA


def _explain_design(d: Design, vehicle: Vehicle) -> Explanation:
    """What explains the speed of one design, that of the wheels or that of the train.

    The train speed only has to agree with the wheels. There half of the gain is clear.
    """
    clear_gain = CLEAR_GAIN if d.creeps else CLEAR_GAIN / 2.0
    stated_prior = longitudinal.line_prior(vehicle, d.top, d.mean, d.interval) | {DRAG: _NO_DRAG}
    spring = longitudinal.spring_share(d.top, vehicle)
    offset = Parameter(0.0, max(_OFFSET_SIGMA, spring.value))
    delay_prior = stated_prior | {DELAY: Parameter(0.0, math.inf)}
    force_prior = stated_prior | {SCALE: Parameter(0.0, math.inf), OFFSET: offset}
    both_prior = delay_prior | {i: force_prior[i] for i in (SCALE, OFFSET)}
    start = np.array([stated_prior[i].value for i in range(SHARED)])
    first_fit = search([d], [d.size], stated_prior, [start])
    pieces = _gradients(d, first_fit.posterior())
    near_fit = search([d], [d.size], both_prior, [first_fit.mean])
    mean_squares = mean_square(d, residual(d, first_fit.mean, first_fit.mean[SHARED:]))
    noise = _NOISE_RATIO * math.hypot(d.noise, d.floor)
    if first_fit.cost - near_fit.cost < clear_gain and (mean_squares < noise**2).all():
        return AS_STATED._replace(pieces=pieces)
    both_starts = _start_points(d, both_prior)
    free_fit = search([d], [d.size], both_prior, both_starts)
    residuals = residual(d, free_fit.mean, np.zeros(len(d.size)))
    counts = independent_samples(d, without_slope(d, residuals))
    stated_fit = search([d], [counts], stated_prior, _start_points(d, stated_prior))
    delayed_fit, line_fit = (
        _best(d, counts, prior, _start_points(d, prior), [stated_fit])
        for prior in (delay_prior, force_prior)
    )
    joint_fit = _best(
        d, counts, both_prior, [*both_starts, free_fit.mean], [stated_fit, delayed_fit, line_fit]
    )
    fits = stated_fit, delayed_fit, line_fit, joint_fit
    explanation = _judge(d, fits, counts, vehicle, clear_gain)._replace(pieces=pieces)
    value, sigma = near_fit.posterior().delay
    is_small_delay = abs(value) < longitudinal.EARLY and sigma < longitudinal.EARLY
    if not explanation.pressure_delay.value and is_small_delay:  # it may be that, or none
        unknown = Parameter(0.0, math.hypot(value / math.sqrt(3.0), sigma))
        explanation = explanation._replace(pressure_delay=unknown)
    return explanation


def _best(
    d: Design, counts: Floats, prior: Prior, starts: list[Floats], simpler: Sequence[Likeliest]
) -> Likeliest:
    """The best fit from the best of `starts` and from each simpler fit, with fewer unknowns.

    A model is never less likely than one that it contains, but one search may end at a local
    maximum. Of few pieces the gradients explain as much as a line does, and a better fit shows
    nothing.
    """
    start_sets = [starts]
    if len(d.size) >= _SEVERAL_PIECES:
        start_sets += [[fit.mean] for fit in simpler]
    fits = [search([d], [counts], prior, points) for points in start_sets]
    return min(fits, key=lambda fit: fit.cost)


def _gradients(d: Design, posterior: Posterior) -> tuple[Piece, ...]:
    """The gradient that each piece needs with this vehicle."""
    pieces = []
    for i, (piece_start, size) in enumerate(zip(d.piece_start, d.size.astype(int), strict=True)):
        start, stop = (float(d.t[d.samples[k]]) for k in (piece_start, piece_start + size - 1))
        gradient = Parameter(float(posterior.mean[SHARED + i]), posterior.sigma(SHARED + i))
        pieces.append(Piece(start, stop, gradient))
    return tuple(pieces)


def _judge(
    d: Design, fits: Sequence[Likeliest], counts: Floats, vehicle: Vehicle, clear_gain: float
) -> Explanation:
    """The explanation that the costs of the four fits, see the table above, support together.

    `counts` are the independent samples of each piece (p,).
    """
    stated_fit, delayed_fit, line_fit, joint_fit = fits
    single_cost = min(delayed_fit.cost, line_fit.cost)
    squares = mean_square(d, without_slope(d, d.v))  # of gradients alone
    cost_without_brake = float(counts @ np.log(squares + d.floor**2))
    simplest_cost = min(stated_fit.cost, cost_without_brake)
    if min(single_cost, joint_fit.cost) > simplest_cost - clear_gain:
        return AS_STATED
    needs_two_causes = joint_fit.cost < single_cost - clear_gain
    other_delay = (delayed_fit if needs_two_causes else joint_fit).posterior().delay.value
    if needs_two_causes:
        delayed_fit = line_fit = joint_fit
    value, sigma = delayed_fit.posterior().delay
    # a delay that is another one beside another force line is as uncertain as that choice
    by_choice = abs(other_delay - value) / math.sqrt(3.0)
    by_sampling = d.interval / math.sqrt(12.0)
    sigma = math.hypot(sigma, _delay_by_line(d))
    delay = Parameter(value, math.hypot(sigma, _PADS_LAG, by_sampling, by_choice))
    s, o = math.exp(line_fit.mean[SCALE]), float(line_fit.mean[OFFSET])
    is_delayed = abs(delay.value) > max(
        _LEAST_DELAY,
        _INTERVAL_SHARE * d.interval,
        _SURE_SIGMAS * sigma,
        _CLEAR_SIGMAS * delay.tolerance,
    )
    line_differs = _line_differs(s, o, d.top, vehicle)
    if not needs_two_causes:
        # One cause is as likely and within what is stated: then the other one is in doubt.
        if abs(delayed_fit.cost - line_fit.cost) < EQUAL_GAIN:
            is_delayed = line_differs = is_delayed and line_differs
        elif delayed_fit.cost < line_fit.cost:
            line_differs = False
        else:
            is_delayed = False
    # Where all wheels slide from the first moment on, they slow harder than by their brakes.
    may_slide = not d.shows_slides and s > 1.0 and math.sqrt(d.v @ d.v / len(d.v)) < _LITTLE_SPEED
    is_no_line = line_differs and (may_slide or not 1.0 / _ANY_FACTOR < s < _ANY_FACTOR)
    x = min(delayed_fit, line_fit, key=lambda fit: fit.cost).mean
    squares_left = np.maximum(mean_square(d, residual(d, x, x[SHARED:])) - d.floor**2, 0.0)
    if is_no_line or counts @ squares_left / (counts @ squares) > _LARGEST_RESIDUAL:
        return AS_STATED
    if is_delayed and line_differs and value > 0.0 and s * (1.0 - o) > _OTHER_BRAKE:
        is_delayed, unsure_delay = False, Parameter(0.0, value / math.sqrt(3.0))
    else:
        unsure_delay = AS_STATED.pressure_delay
    return Explanation(
        delay if is_delayed else unsure_delay,
        OtherForceLine(s, o * d.top, s * (1.0 - o)) if line_differs else None,
        is_delayed and line_differs and not needs_two_causes,
    )


def _delay_by_line(d: Design) -> float:
    """1 sigma of a delay by curves, wind and an unknown gradient, which change in a braking [s].

    The longer a brake is built up, the more they change, and the longer is the delay that explains
    the same deceleration.
    """
    t = d.t[d.samples]
    K_later, K_earlier = (np.interp(t + shift, d.t, d.K) for shift in (0.5, -0.5))
    steepest = d.c * float(np.max(np.abs(K_later - K_earlier), initial=1e-9))  # [m/s³]
    build_up = d.c * float(np.ptp(d.K)) / steepest  # [s]
    return math.hypot(_UNEVEN, d.gradient_sigma) * build_up / _CHANGE_TIME / steepest


def _line_differs(s: float, o: float, top: float, vehicle: Vehicle) -> bool:
    """Whether the force line s (K − o) is outside of what is stated; o is a share of `top` [N]."""
    offset_limit = STATED_SIGMAS * longitudinal.spring_share(top, vehicle).tolerance
    force_limit = STATED_SIGMAS * longitudinal.tolerance(vehicle)
    factor_limit = math.log1p(math.hypot(force_limit, offset_limit))
    largest_factor = max(abs(math.log(s)), abs(math.log(s * max(1.0 - o, 1e-3))))
    return abs(o) > max(_SMALL_OFFSET, offset_limit) or largest_factor > factor_limit
