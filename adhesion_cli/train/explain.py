"""What explains the deceleration: the parameters as stated, or others."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..core.model import Floats, Parameter, Train, Vehicle
from ..records.axle_channels import AxleChannels
from .explanation import AS_STATED, Design, Explanation, OtherForceLine, Piece
from .grid import Grids
from .longitudinal import (
    DELAY,
    DRAG,
    LARGEST_DELAY,
    OFFSET,
    SCALE,
    SHARED,
    line_prior,
    spring_share,
    tolerance,
)
from .pieces import build_design, sum_by_piece, without_slope
from .solve import Likeliest, Posterior, independent_samples, residual, search, unbent_loss

_LATE_SIGMA = 0.2  # 1 sigma of the train speed's delay from which rolling wheels say more [s]
_NO_DRAG = Parameter(0.0, 1e-9)  # by the gradient and γ of long pieces, in a diagnosis [1/m]
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


def _starts(d: Design, prior: Mapping[int, Parameter]) -> list[Floats]:
    """Where to look: with what is free, each by itself."""
    base = np.array([prior[i].value for i in range(SHARED)])
    reach = min(LARGEST_DELAY, float(d.t[-1]) / 4.0)
    delays = np.linspace(-reach, reach, 41) if math.isinf(prior[DELAY].tolerance) else [0.0]
    scales = math.isinf(prior[SCALE].tolerance)
    points = [(delay, 0.0) for delay in delays]
    points += [(0.0, o) for o in (-0.3, -0.1, 0.1, 0.3, 0.5)] * scales
    starts = []
    for delay, offset in points:
        x = base.copy()
        x[DELAY], x[OFFSET] = delay, offset
        if scales:
            x[SCALE] = _likeliest_scale(d, x)
        starts.append(x)
    return starts


def _likeliest_scale(d: Design, x: Floats) -> float:
    """The ln s that fits best with any gradients."""
    u, v = without_slope(d, unbent_loss(d, x)), without_slope(d, d.v)
    A, B, C = sum_by_piece(d, v * v), sum_by_piece(d, v * u), sum_by_piece(d, u * u)
    s = _FACTORS[:, None]
    squares = np.maximum(A + 2.0 * s * B + s * s * C, 0.0) / d.size + d.floor**2
    return math.log(float(_FACTORS[np.argmin(np.log(squares) @ d.size)]))


def explain(
    axles: Sequence[AxleChannels],
    grids: Grids | None,
    vehicle: Vehicle,
    train: Train = Train(),  # noqa: B008 (a value that cannot change)
) -> Explanation:
    """The best explanation of how the train slows; the stated vehicle where the log shows none.

    Args:
        axles: all axles of the log, on one clock each.
        grids: the same on one time axis, where they have one.
        vehicle: what is stated of it.
        train: the rest of it.
    """
    if grids is None:
        return AS_STATED
    share = train.braked_share(vehicle, len(axles))
    rims = build_design(axles, vehicle, grids, share)
    by_train = grids.fine.train is not None and not (rims and _may_be_late(axles))
    of_train = build_design(axles, vehicle, grids, share, by_train=True) if by_train else None
    if rims is None:
        return AS_STATED._replace(design=of_train)
    e = _explain(rims, vehicle)
    # A wheel on its way into a slide slows harder than it should; the train does not.
    if e.line and by_train and not (of_train and _explain(of_train, vehicle).line):
        e = e._replace(
            line=None,
            pressure_delay=AS_STATED.pressure_delay if e.delay_or_line else e.pressure_delay,
            delay_or_line=False,
        )
    return e._replace(design=of_train or rims)


def _may_be_late(axles: Sequence[AxleChannels]) -> bool:
    """Whether the train speed may be late by so much that wheels that roll say more of the brake.

    It is where an offset of the speed explains the same as a delay.
    """
    delay = axles[0].record.train_speed_late
    return delay is not None and delay.tolerance > _LATE_SIGMA


def _explain(d: Design, vehicle: Vehicle) -> Explanation:
    """What explains this speed, of wheels that creep or of the train, which only has to agree."""
    clearly = CLEAR_GAIN if d.creeps else CLEAR_GAIN / 2.0
    prior = line_prior(vehicle, d.top, d.mean, d.interval) | {DRAG: _NO_DRAG}
    offset = Parameter(0.0, max(_OFFSET_SIGMA, spring_share(d.top, vehicle).value))
    any_delay = {DELAY: Parameter(0.0, math.inf)}
    any_line = {SCALE: Parameter(0.0, math.inf), OFFSET: offset}
    free_prior = {**prior, **any_delay, **any_line}
    start = np.array([prior[i].value for i in range(SHARED)])
    stated_fit = search([d], [d.size], prior, [start])
    pieces = _gradients(d, stated_fit.posterior())
    near_fit = search([d], [d.size], free_prior, [stated_fit.mean])
    mean_squares = (
        sum_by_piece(d, residual(d, stated_fit.mean, stated_fit.mean[SHARED:]) ** 2) / d.size
    )
    noise = _NOISE_RATIO * math.hypot(d.noise, d.floor)
    if stated_fit.cost - near_fit.cost < clearly and (mean_squares < noise**2).all():
        return AS_STATED._replace(pieces=pieces)
    global_starts = _starts(d, free_prior)
    free_fit = search([d], [d.size], free_prior, global_starts)
    sample_counts = [
        independent_samples(d, without_slope(d, residual(d, free_fit.mean, np.zeros(len(d.size)))))
    ]
    fits = {"stated": search([d], sample_counts, prior, _starts(d, prior))}
    for name, cause_prior in (("late", {**prior, **any_delay}), ("line", {**prior, **any_line})):
        fits[name] = _best(d, sample_counts, cause_prior, _starts(d, cause_prior), [fits["stated"]])
    fits["both"] = _best(
        d, sample_counts, free_prior, [*global_starts, free_fit.mean], list(fits.values())
    )
    return _judge(d, sample_counts, fits, vehicle, clearly)._replace(pieces=pieces)


def _best(
    d: Design,
    sample_counts: Sequence[Floats],
    prior: Mapping[int, Parameter],
    starts: Sequence[Floats],
    inside: Sequence[Likeliest],
) -> Likeliest:
    """The best fit from the best of `starts` and from each fit with fewer unknowns.

    A model is never less likely than one that it contains; one search may end where it is. Of few
    pieces the gradients explain as much as a line does, and a better fit shows nothing.
    """
    contained_fits = inside if len(d.size) >= _SEVERAL_PIECES else ()
    start_sets = [starts, *([fit.mean] for fit in contained_fits)]
    return min((search([d], sample_counts, prior, x) for x in start_sets), key=lambda fit: fit.cost)


def _gradients(d: Design, p: Posterior) -> tuple[Piece, ...]:
    """What each piece needs as a gradient, by the vehicle as stated."""
    pieces = []
    for i, (piece_start, size) in enumerate(zip(d.piece_start, d.size.astype(int), strict=True)):
        start, stop = (float(d.t[d.samples[k]]) for k in (piece_start, piece_start + size - 1))
        slope = Parameter(float(p.mean[SHARED + i]), p.sigma(SHARED + i))
        pieces.append(Piece(start, stop, slope))
    return tuple(pieces)


def _judge(
    d: Design,
    sample_counts: Sequence[Floats],
    fits: Mapping[str, Likeliest],
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
        sample_counts[0] @ np.log(sum_by_piece(d, without_slope(d, d.v) ** 2) / d.size + d.floor**2)
    )
    single_cost = min(delay_fit.cost, line.cost)
    if min(single_cost, both_fit.cost) > min(fits["stated"].cost, no_brake) - clear_gain:
        return AS_STATED
    if needs_both := both_fit.cost < single_cost - clear_gain:
        delay_fit = line = both_fit
    uncertain = STATED_SIGMAS * spring_share(d.top, vehicle).tolerance
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


def _residual_share(d: Design, sample_counts: Floats, p: Likeliest) -> float:
    """Share of the speed's square that is left, rounding apart."""
    mean_squares = sum_by_piece(d, residual(d, p.mean, p.mean[SHARED:]) ** 2) / d.size
    total_squares = sum_by_piece(d, without_slope(d, d.v) ** 2) / d.size
    return float(
        sample_counts @ np.maximum(mean_squares - d.floor**2, 0.0) / (sample_counts @ total_squares)
    )
