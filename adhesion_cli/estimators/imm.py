"""Interacting multiple models: a wheel that rolls, slides, or changes between the two.

Three Kalman filters of (ω, F) have ω̇ = a(F − φK) in common                              (1)
and differ in what moves F:

- rolling: the clamping force, dF = φ dK/(1 + I/(mR²)), and a small random walk;
- sliding: the rail, a medium walk. K has no effect on it;
- changing: a large walk, for the milliseconds between the two.

The regimes change at random. At every sample their states are mixed, each filter takes the reading,
and its likelihood weighs it. F̂ is the mean of the mixture and sigma its standard deviation. K comes
from two such filters, of a pressure that is held or moves. The noise of both sensors is learned
from their readings, white and coloured. So nothing depends on the rate of the log.

Train. While the wheel rolls, it shows the speed V and the deceleration of the train. While it
slides, V falls with the last deceleration D. A slide ends where ω reaches V/R. Then the force is
that of a rolling wheel, φK − I D/R², and not that of the slide.

Slides. A slide begins below the force of a rolling wheel. A rail that was slippery probably still
is: after a slide, the next one is more likely for some seconds.

Creep. The force grows with the creepage c, F = k m g c. So a rolling wheel that is braked harder
slows more than the train. F follows φK with a delay of I V/(k m g R²).

Pads. The cylinder and the caliper may follow the pressure late, and a valve that vents would then
seem to lower F. Whether K acts at once or after `LAG` is a hypothesis of its own. In a slide it is
weighed by the likelihood of the readings, and u is the mean of both (pseudo-Bayes, first order).

Start. A wheel is assumed to roll: F̂ = φK/(1 + I/(mR²)).

The filters are Blom's and Bar-Shalom's. Regimes, rates, train, creep, pads and the noise are ours.

| symbol of Blom and Bar-Shalom | here |
|---|---|
| modes rolling, sliding, changing | `State.rolling`, `State.sliding`, `State.changing` |
| x̂, P of a mode | (x, r) of a `Gaussian`, and xx, xr, rr |
| mode probability μ | `Gaussian.p`; `mu_r`, `mu_s`, `mu_c` with the likelihood |
| rates between modes | `ROLLING_TO_SLIDING` and others, by the brake and the last slide |
| mixing of the modes | `_mix`, `_mixture.merge` |
| prediction | `_predict`, `_mixture.predict` |
| innovation ν, its variance S | `nu`, `S` in `_mixture.update` |
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.innovations import square
from ..core.model import Quantity, Wheelset, fraction
from ..core.physics import G, rolling_deceleration
from ._mixture import (
    Gaussian,
    Reading,
    merge,
    predict,
    squared,
    tail_probabilities,
    uncorrelated,
    update,
    with_probability,
)
from ._noise import (
    Noise,
    initial_noise,
    is_counter,
    is_informative,
    learn,
    new_step,
    pause,
    rounding,
    safe_variance,
    slow_variance,
)

# Rates of change between regimes [1/s].
ROLLING_TO_CHANGING = 0.005
ROLLING_TO_SLIDING, TO_SLIDING_AGAIN = 0.015, 0.9  # while braked; and added just after a slide
SLIDING_TO_ROLLING, SLIDING_TO_CHANGING = 0.02, 0.3
CHANGING_TO_ROLLING, CHANGING_TO_SLIDING = 0.05, 2.0
STICKING_RATE = 5.0  # added for a wheel that is as fast as the train
HELD_TO_MOVING, MOVING_TO_HELD = 0.3, 0.1

SLIPPERY_TIME = 2.0  # time for which a rail is probably as it was [s]
BRAKED_SHARE = 0.02  # F over m g at which a slide is half as likely as at large F
FIRST_SLIDE_SHARE = 0.9  # first F of a slide over that of a rolling wheel
FIRST_SLIDE_SIGMA = 0.15  # and 1 sigma of it
LEAP_SIGMA = 0.05  # 1 sigma of a sudden change of F, over m g
TRAIN_SIGMA = 0.12  # 1 sigma of the deceleration of the train, if the wheel does not show it [m/s²]
CREEPAGE_SIGMA = 0.01  # 1 sigma of V/R over ω, for a wheel that rolled
STIFFNESS = 22.0  # k, mean of the published 8 to 60
STIFFNESS_SIGMA = 0.5  # 1 sigma of 1/k over its mean
LEAST_ROLLING = 0.1  # so that noise taken for a slide is learned, too
SPEED_NOISE = 0.02  # first guess of the speed's [rad/s]
FORCE_NOISE = 1e-5  # and of the clamping force's, over m g/φ
LARGEST_NOISE = 1e-3  # no pressure sensor has more: on a slow log the brake itself bends
FIRST_RATE_SIGMA = 0.1  # 1 sigma of a first rate of K, over m g/φ [1/s]
LAG = 0.035  # of the pads behind the pressure, if they lag; usual are 0.01 to 0.06 [s]
FIRST_ODDS, LARGEST_ODDS = -2.0, 6.0  # logarithm of the odds that the pads lag
INPUT_SIGMA = 0.15  # 1 sigma of what a change of K does not explain, over it
NO_INFORMATION = 1e30  # variance of a reading that says nothing [rad²/s²]
JUMP = 5.0  # standard deviations from which K has stepped
FIRST_ROLLING_SIGMA = 0.05  # 1 sigma of the first F over F, if the wheel rolls
FIRST_SLIDING_SIGMA = 0.5  # and if it slides
GRADIENT_SIGMA = 1e-3  # 1 sigma of the force of a gradient, over m g


class Params(NamedTuple):
    """Random walks and a memory: ours, one set for every log."""

    rolling: Annotated[float, Quantity("1/√s", "walk of F over m g, rolling", 0.0, 10.0)] = 3e-4
    sliding: Annotated[float, Quantity("1/√s", "walk of F over φK, sliding", 0.0, 100.0)] = 0.1
    changing: Annotated[float, Quantity("1/√s", "walk of F over φK in between", 0.0, 100.0)] = 4.0
    least: Annotated[float, fraction("share of m g that counts as φK where K is less")] = 0.04
    held: Annotated[float, Quantity("1/√s", "walk of φK over m g with K held", 0.0, 10.0)] = 1e-4
    moving: Annotated[
        float, Quantity("1/√s³", "walk of the rate of φK over m g while K moves", 0.0, 100.0)
    ] = 0.15
    lag: Annotated[
        float, Quantity("s", "1 sigma of the delay of K behind its pressure, in sigma", 0.0, 10.0)
    ] = 0.03
    memory: Annotated[float, Quantity("s", "time over which the noise is a mean", 0.0, 1e4)] = 10.0


class Clamping(NamedTuple):
    """The clamping force without its noise [N]."""

    held: Gaussian
    moving: Gaussian
    noise: Noise
    K: float
    variance: float


class TrainMotion(NamedTuple):
    """The train, for a wheel that does not roll."""

    speed: float  # V/R [rad/s]
    doubt: float  # its 1 sigma [rad/s]
    slows: float  # its deceleration D/R [rad/s²]


class Creep(NamedTuple):
    """The clamping force as a rolling wheel feels it."""

    K: float  # delayed [N]
    rate: float  # its rate [N/s]
    delay: float  # [s]


class Pads(NamedTuple):
    """The clamping force if the pads lag the pressure."""

    K: float  # [N]
    odds: float  # logarithm of the odds that they lag


class Surroundings(NamedTuple):
    """What is known besides the regimes of the wheel."""

    noise: Noise  # of the wheel speed [rad/s]
    clamping: Clamping
    creep: Creep
    train: TrainMotion
    pads: Pads


class State(NamedTuple):
    """The regimes of the wheel, with level ω [rad/s] and rate F [N], K and noise."""

    rolling: Gaussian
    sliding: Gaussian
    changing: Gaussian
    surroundings: Surroundings
    slippery: float  # probability that the rail is as in the last slide
    sigma: float  # standard uncertainty of F [N]
    F: float  # [N]


class Prediction(NamedTuple):
    """The regimes before they take the reading; the reading; what goes into the next state."""

    rolling: Gaussian
    sliding: Gaussian
    changing: Gaussian
    reading: Reading
    surroundings: Surroundings


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """A wheel that probably rolls, whether it is braked or not."""
    weight, rolling_force = w.mass * G, w.rolling * w.phi * K
    v, gradient_force = SPEED_NOISE * SPEED_NOISE, GRADIENT_SIGMA * weight
    sliding = uncorrelated(
        y, v, rolling_force, squared(FIRST_SLIDING_SIGMA * rolling_force + gradient_force), 0.05
    )
    sigma = FIRST_ROLLING_SIGMA * rolling_force + gradient_force
    rolling = uncorrelated(y, v, rolling_force, sigma * sigma, 0.9)
    surroundings = Surroundings(
        initial_noise(SPEED_NOISE, y),
        _initial_clamping(initial_noise(FORCE_NOISE * weight / w.phi, K), K, weight / w.phi),
        Creep(K, 0.0, 0.0),
        TrainMotion(y, abs(y) + 1.0, rolling_deceleration(w) * K),
        Pads(K, FIRST_ODDS),
    )
    return State(rolling, sliding, sliding, surroundings, 0.0, sigma, rolling_force)


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    q = _predict(p, w, s, h, K, y)
    rolling, d_r = update(q.rolling, q.reading)
    sliding, d_s = update(q.sliding, q.reading)
    changing, d_c = update(q.changing, q.reading)
    smallest = min(d_r, d_s, d_c)
    mu_r, mu_s = rolling.p * math.exp(smallest - d_r), sliding.p * math.exp(smallest - d_s)
    mu_c = changing.p * math.exp(smallest - d_c)
    total = mu_r + mu_s + mu_c
    rolling = with_probability(rolling, mu_r / total)
    sliding = with_probability(sliding, mu_s / total)
    changing = with_probability(changing, mu_c / total)
    F = rolling.p * rolling.r + sliding.p * sliding.r + changing.p * changing.r
    variance = rolling.p * (rolling.rr + squared(rolling.r - F))
    variance += sliding.p * (sliding.rr + squared(sliding.r - F))
    variance += changing.p * (changing.rr + squared(changing.r - F))
    K_variance = q.surroundings.clamping.variance + squared(p.lag * q.surroundings.creep.rate)
    sigma = math.sqrt(variance + squared(w.rolling * w.phi) * K_variance)
    slippery = max(sliding.p, s.slippery * SLIPPERY_TIME / (SLIPPERY_TIME + h))
    return State(rolling, sliding, changing, q.surroundings, slippery, sigma, F)


def nis(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> float:
    """Normalised innovation squared of this sample, NaN where the filters do not use it."""
    q = _predict(p, w, s, h, K, y)
    if q.reading.variance >= NO_INFORMATION:
        return math.nan
    return square(
        _tail_probabilities(q, y - 0.5 * q.reading.step),
        _tail_probabilities(q, y + 0.5 * q.reading.step),
    )


def _tail_probabilities(q: Prediction, y: float) -> tuple[float, float]:
    """Probability of a reading below y, and of one above it, by all regimes together."""
    a = tail_probabilities(q.rolling, q.reading, y)
    b = tail_probabilities(q.sliding, q.reading, y)
    d = tail_probabilities(q.changing, q.reading, y)
    total = q.rolling.p + q.sliding.p + q.changing.p
    return (a[0] + b[0] + d[0]) / total, (a[1] + b[1] + d[1]) / total


def _predict(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> Prediction:
    """The regimes before they take the reading; the reading; what is learned from it."""
    previous, weight, K_before = s.surroundings, w.mass * G, s.surroundings.clamping.K
    clamping = _update_clamping(p, previous.clamping, h, K, weight / w.phi)
    mean, dK = 0.5 * (K_before + clamping.K), clamping.K - K_before
    rolls = max(s.rolling.p, LEAST_ROLLING)
    noise = learn(previous.noise, y, h, -h * rolling_deceleration(w) * mean, p.memory, rolls)
    counts = is_counter(noise)
    white = safe_variance(noise)
    # The force of a rolling wheel is slower than a slice of the noise, that of a slide is not.
    r = white + s.rolling.p * (slow_variance(noise) - white)
    if not counts and not is_informative(noise):
        r = NO_INFORMATION
    reading = Reading(y, r, 0.0 if counts else rounding(noise), 1.0 if counts else 0.0)
    creep = _delay_by_creep(w, s, h, clamping.K)
    force_share = w.rolling * w.phi
    bend = STIFFNESS_SIGMA * creep.delay * force_share * (creep.rate - previous.creep.rate)

    u, a = -h * w.a * w.phi * mean, w.a * h
    input_sigma = INPUT_SIGMA * a * w.phi * dK
    step_sigma = new_step(noise, previous.noise)
    load = max(w.phi * clamping.K, abs(s.F)) + p.least * weight
    rolling, sliding, changing, train = _mix(w, s, h)
    rolling = predict(
        rolling,
        a,
        u,
        (1.0 - w.rolling) * input_sigma + step_sigma,
        force_share * (creep.K - previous.creep.K),
        squared(p.rolling * weight) * h + bend * bend,
    )  # (1)
    K_late = _follow(previous.pads.K, K_before, clamping.K, h, LAG)
    late = a * w.phi * (mean - 0.5 * (previous.pads.K + K_late))  # of u, if the pads lag
    u += late / (1.0 + math.exp(-previous.pads.odds))
    sliding = predict(sliding, a, u, input_sigma + step_sigma, 0.0, squared(p.sliding * load) * h)
    changing = predict(
        changing, a, u, input_sigma + step_sigma, 0.0, squared(p.changing * load) * h
    )
    odds = previous.pads.odds
    if not counts:
        nu_late = y - sliding.x - late / (1.0 + math.exp(odds))
        S = sliding.xx + r + squared(rounding(noise)) / 12.0
        odds += s.sliding.p * late * (nu_late + 0.5 * late) / S
    pads = Pads(K_late, min(max(odds, -LARGEST_ODDS), LARGEST_ODDS))
    surroundings = Surroundings(noise, clamping, creep, train, pads)
    return Prediction(rolling, sliding, changing, reading, surroundings)


def _delay_by_creep(w: Wheelset, s: State, h: float, K: float) -> Creep:
    """The clamping force with the delay of creep."""
    delay = w.inertia * abs(s.rolling.x) / (w.radius * w.mass * G * STIFFNESS) + 1e-9
    K_before, previous = s.surroundings.clamping.K, s.surroundings.creep.K
    K_delayed = _follow(previous, K_before, K, h, delay)
    return Creep(K_delayed, (K_delayed - previous) / h, delay)


def _follow(delayed: float, before: float, now: float, h: float, delay: float) -> float:
    """A lag of first order behind a signal, one interval on: exact for a straight line to `now`."""
    lag = (now - before) / h * delay
    return now - lag + (delayed - before + lag) * math.exp(-h / delay)


def _mix(w: Wheelset, s: State, h: float) -> tuple[Gaussian, Gaussian, Gaussian, TrainMotion]:
    """Each regime as a mixture of what may have become it within `h`, at most one change."""
    rolling, sliding, changing, motion = s.rolling, s.sliding, s.changing, s.surroundings.train
    weight, braked = w.mass * G, w.phi * s.surroundings.clamping.K
    normal = w.rolling * braked  # below zero where a motor drives: it slips as well
    slips = (ROLLING_TO_SLIDING + TO_SLIDING_AGAIN * s.slippery) * abs(normal)
    slips /= abs(normal) + BRAKED_SHARE * weight
    z_sticks = SLIDING_TO_ROLLING + STICKING_RATE * _probability_as_fast(sliding, motion)
    c_sticks = CHANGING_TO_ROLLING + STICKING_RATE * _probability_as_fast(changing, motion)
    time_x = rolling.p * _change_time(ROLLING_TO_CHANGING + slips, h)
    time_z = sliding.p * _change_time(SLIDING_TO_CHANGING + z_sticks, h)
    time_c = changing.p * _change_time(CHANGING_TO_SLIDING + c_sticks, h)
    x_leaves = (ROLLING_TO_CHANGING + slips) * time_x
    z_stays = sliding.p - (SLIDING_TO_CHANGING + z_sticks) * time_z
    c_stays = changing.p - (CHANGING_TO_SLIDING + c_sticks) * time_c

    rolling_rate = rolling_deceleration(w) * s.surroundings.clamping.K
    train_rate = 0.5 * (rolling_rate + motion.slows)
    difference = 0.5 * (rolling_rate - motion.slows)
    F = braked - train_rate / w.a
    FF = squared(abs(difference) + TRAIN_SIGMA / w.radius) / (w.a * w.a)
    slip = _with_force(rolling, FIRST_SLIDE_SHARE * normal, squared(FIRST_SLIDE_SIGMA * normal))
    leap = squared(LEAP_SIGMA * weight)
    return (
        merge(
            rolling,
            _with_force(sliding, F, FF),
            _with_force(changing, F, FF),
            rolling.p - x_leaves,
            z_sticks * time_z,
            c_sticks * time_c,
        ),
        merge(slip, sliding, changing, slips * time_x, z_stays, CHANGING_TO_SLIDING * time_c),
        merge(
            _widen_force(rolling, leap),
            _widen_force(sliding, leap),
            changing,
            ROLLING_TO_CHANGING * time_x,
            SLIDING_TO_CHANGING * time_z,
            c_stays,
        ),
        _update_train(
            w,
            s,
            h,
            x_leaves,
            z_stays + SLIDING_TO_CHANGING * time_z + changing.p - c_sticks * time_c,
        ),
    )


def _update_train(
    w: Wheelset, s: State, h: float, weight_stopped: float, weight_earlier: float
) -> TrainMotion:
    """The train one interval on, for wheels that stop rolling, and those that did before."""
    rolling, train = s.rolling, s.surroundings.train
    share = weight_stopped / (weight_stopped + weight_earlier)
    speed = train.speed + share * (rolling.x - train.speed)
    variance = (1.0 - share) * (squared(train.doubt) + squared(train.speed - speed))
    spread = rolling.xx + squared(CREEPAGE_SIGMA * rolling.x) + squared(rolling.x - speed)
    variance += share * spread
    own_rate = w.a * (w.phi * s.surroundings.clamping.K - rolling.r)
    rate = train.slows + share * (own_rate - train.slows)
    return TrainMotion(speed - h * rate, math.sqrt(variance) + h * TRAIN_SIGMA / w.radius, rate)


def _with_force(g: Gaussian, F: float, FF: float) -> Gaussian:
    """The same speed with another force."""
    return Gaussian(g.x, F, g.n, g.xx, 0.0, FF, g.xn, 0.0, g.nn, g.p)


def _widen_force(g: Gaussian, FF: float) -> Gaussian:
    """The same with more variance of the force."""
    return Gaussian(g.x, g.r, g.n, g.xx, g.xr, g.rr + FF, g.xn, g.rn, g.nn, g.p)


def _probability_as_fast(g: Gaussian, t: TrainMotion) -> float:
    """Probability that the wheel is as fast as the train; quicker than the error function."""
    e = g.x - t.speed
    return 0.5 + 0.5 * e / math.sqrt(e * e + 2.0 * (g.xx + t.doubt * t.doubt) + 1e-30)


def _change_time(rate: float, h: float) -> float:
    """Probability of a change within `h` over its rate; quicker than the exponential function."""
    return h / (1.0 + rate * h)


def _initial_clamping(noise: Noise, K: float, scale: float) -> Clamping:
    """K at a start, or where it is zero: a bound of (15), without noise."""
    rate = FIRST_RATE_SIGMA * scale
    return Clamping(
        uncorrelated(K, 0.0, 0.0, 0.0, 0.5),
        uncorrelated(K, 0.0, 0.0, rate * rate, 0.5),
        noise,
        K,
        0.0,
    )


def _update_clamping(p: Params, s: Clamping, h: float, K: float, scale: float) -> Clamping:
    """K one sample on: held and moving, mixed as the regimes of the wheel."""
    if K <= 0.0:
        return _initial_clamping(pause(s.noise, K, 0.0), K, scale)
    begins = s.noise.latest.y <= 0.0
    noise = pause(s.noise, K, 0.0) if begins else learn(s.noise, K, h, 0.0, p.memory, 1.0)
    largest_sigma = LARGEST_NOISE * scale
    reading = Reading(
        K,
        min(safe_variance(noise) + squared(rounding(noise)) / 12.0, largest_sigma * largest_sigma),
        0.0,
        0.0,
    )
    p_leaves = HELD_TO_MOVING * _change_time(HELD_TO_MOVING, h)
    p_stops = MOVING_TO_HELD * _change_time(MOVING_TO_HELD, h)
    a, b = s.held, s.moving
    mu_stays, mu_back = a.p * (1.0 - p_leaves), b.p * p_stops
    x = (mu_stays * a.x + mu_back * b.x) / (mu_stays + mu_back)
    spread = mu_stays * (a.xx + squared(a.x - x)) + mu_back * (b.xx + squared(b.x - x))
    xx = spread / (mu_stays + mu_back)
    held_prior = uncorrelated(x, xx + squared(p.held * scale) * h, 0.0, 0.0, mu_stays + mu_back)
    held_posterior, d_h = update(held_prior, reading)
    moving_prior = merge(a, b, b, a.p * p_leaves, b.p * (1.0 - p_stops), 0.0)
    moving_prior = predict(moving_prior, h, 0.0, 0.0, 0.0, squared(p.moving * scale) * h)
    if abs(K - moving_prior.x) > JUMP * math.sqrt(moving_prior.xx + reading.variance):
        moving_prior = uncorrelated(
            K,
            JUMP * JUMP * (moving_prior.xx + reading.variance),
            moving_prior.r,
            moving_prior.rr,
            moving_prior.p,
        )
    moving, d_m = update(moving_prior, reading)

    smallest = min(d_h, d_m)
    mu_h, mu_m = held_posterior.p * math.exp(smallest - d_h), moving.p * math.exp(smallest - d_m)
    held_posterior = with_probability(held_posterior, mu_h / (mu_h + mu_m))
    moving = with_probability(moving, mu_m / (mu_h + mu_m))
    x = held_posterior.p * held_posterior.x + moving.p * moving.x
    variance = held_posterior.p * (held_posterior.xx + squared(held_posterior.x - x)) + moving.p * (
        moving.xx + squared(moving.x - x)
    )
    return Clamping(held_posterior, moving, noise, max(x, 0.0), variance)


ABOUT = About(
    title="Interacting multiple models",
    source="Blom H., Bar-Shalom Y.: The interacting multiple model algorithm for systems with "
    "Markovian switching coefficients, IEEE Transactions on Automatic Control 33 (1988) 780-783, "
    "doi 10.1109/9.1299",
    claims={"service-brake": Claim(3.9, 0.001), "low-adhesion": Claim(34.1, 0.017)},
)
