"""Interacting multiple models: a wheel that rolls, slides, or changes between the two.

Three Kalman filters of (ω, F) have ω̇ = a(F − φK) in common                              (1)
and differ in what moves F:

- rolling: the clamping force, dF = φ dK/(1 + I/(mR²)), and a small random walk;
- sliding: the rail, a medium walk. K has no effect on it;
- changing: a large walk, for the milliseconds between the two.

The regimes change at random. At every sample their states are mixed, each filter takes the reading,
and its likelihood weighs it. F̂ is the mean of the mixture and sigma its standard deviation. K comes
from two such filters, of a pressure that is held or moves. The noise of both sensors is learned
from their readings. So nothing depends on the rate of the log.

Train. While the wheel rolls, it shows the speed V and the deceleration of the train. While it
slides, V falls with the last deceleration D. A slide ends where ω reaches V/R. Then the force is
that of a rolling wheel, φK − I D/R², and not that of the slide.

Slides. A slide begins below the force of a rolling wheel. A rail that was slippery probably still
is: after a slide, the next one is more likely for some seconds.

Creep. The force grows with the creepage c, F = k m g c. So a rolling wheel that is braked harder
slows more than the train. F follows φK with a delay of I V/(k m g R²).

Start. A wheel is assumed to roll: F̂ = φK/(1 + I/(mR²)).

The filters are Blom's and Bar-Shalom's. Regimes, rates, train, creep and the noise are ours.
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.innovations import square
from ..core.model import Quantity, Wheelset
from ..core.physics import G, rolling_deceleration
from ._mixture import (
    Gaussian,
    Reading,
    below,
    corrected,
    known,
    merged,
    moved,
    squared,
    weighed,
)
from ._noise import Noise, certain, counting, discovered, guessed, learned, paused, rounding, tells

# Rates of change between regimes [1/s].
ROLLS_CHANGES = 0.005
ROLLS_SLIDES, SLIDES_AGAIN = 0.015, 0.9  # while braked; and added just after a slide
SLIDES_ROLLS, SLIDES_CHANGES = 0.02, 0.3
CHANGES_ROLLS, CHANGES_SLIDES = 0.05, 1.2
STICKS = 5.0  # added for a wheel that is as fast as the train
HELD_MOVES, MOVES_HELD = 0.3, 0.1

SLIPPERY = 2.0  # time for which a rail is probably as it was [s]
BRAKED = 0.02  # F over m g at which a slide is half as likely as at large F
SLIPS, SLIPS_BY = 0.9, 0.15  # first F of a slide over that of a rolling wheel, and 1 sigma
LEAP = 0.05  # 1 sigma of a sudden change of F, over m g
SLOWS = 0.12  # 1 sigma of the deceleration of the train, if the wheel does not show it [m/s²]
CREEPAGE = 0.01  # 1 sigma of V/R over ω, for a wheel that rolled
STIFFNESS = 22.0  # k, mean of the published 8 to 60
OTHERWISE = 0.5  # 1 sigma of 1/k over its mean
SPEED_NOISE = 0.02  # first guess of the speed's [rad/s]
FORCE_NOISE = 1e-5  # and of the clamping force's, over m g/φ
MOST_NOISE = 1e-3  # no pressure sensor has more: on a slow log the brake itself bends
FASTEST = 0.1  # 1 sigma of a first rate of K, over m g/φ [1/s]
BENT = 0.15  #
NOTHING = 1e30  # variance of a reading that says nothing [rad²/s²]
JUMP = 5.0  # standard deviations from which K has stepped
UNSURE = 0.05  # 1 sigma of the first F over F, if the wheel rolls
ANY = 0.5  # and if it slides
SLOPE = 1e-3  # 1 sigma of the force of a gradient, over m g


class Params(NamedTuple):
    """Random walks and a memory: ours, one set for every log."""

    rolling: Annotated[
        float, Quantity("1/√s", "walk of F over m g while the wheel rolls", 0.0, 10.0)
    ] = 3e-4
    sliding: Annotated[
        float, Quantity("1/√s", "walk of F over φK while the wheel slides", 0.0, 100.0)
    ] = 0.1
    changing: Annotated[
        float, Quantity("1/√s", "walk of F over φK between the two", 0.0, 100.0)
    ] = 4.0
    least: Annotated[
        float, Quantity("-", "share of m g that counts as φK where K is less", 0.0, 1.0)
    ] = 0.04
    held: Annotated[float, Quantity("1/√s", "walk of φK over m g while K is held", 0.0, 10.0)] = (
        1e-4
    )
    moving: Annotated[
        float, Quantity("1/√s³", "walk of the rate of φK over m g while K moves", 0.0, 100.0)
    ] = 0.15
    memory: Annotated[float, Quantity("s", "time over which the noise is a mean", 0.0, 1e4)] = 10.0


class Clamping(NamedTuple):
    """The clamping force without its noise [N]."""

    held: Gaussian
    moving: Gaussian
    noise: Noise
    K: float
    variance: float


class Train(NamedTuple):
    """The train, for a wheel that does not roll."""

    speed: float  # V/R [rad/s]
    doubt: float  # its 1 sigma [rad/s]
    slows: float  # its deceleration D/R [rad/s²]


class Creep(NamedTuple):
    """The clamping force as a rolling wheel feels it."""

    K: float  # delayed [N]
    rate: float  # its rate [N/s]
    delay: float  # [s]


class State(NamedTuple):
    """The regimes of the wheel, with level ω [rad/s] and rate F [N], K and noise."""

    rolling: Gaussian
    sliding: Gaussian
    changing: Gaussian
    noise: Noise  # of the wheel speed [rad/s]
    clamping: Clamping
    creep: Creep
    train: Train
    slippery: float  # probability that the rail is as in the last slide
    sigma: float  # standard uncertainty of F [N]
    F: float  # [N]


class Predicted(NamedTuple):
    """The regimes before they take the reading; the reading; what goes into the next state."""

    rolling: Gaussian
    sliding: Gaussian
    changing: Gaussian
    of: Reading
    noise: Noise
    clamping: Clamping
    creep: Creep
    train: Train


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """A wheel that probably rolls, whether it is braked or not."""
    weight, rolls = w.mass * G, w.rolling * w.phi * K
    v, least = SPEED_NOISE * SPEED_NOISE, SLOPE * weight
    slides = known(y, v, rolls, squared(ANY * rolls + least), 0.05)
    sigma = UNSURE * rolls + least
    return State(
        known(y, v, rolls, sigma * sigma, 0.9), slides, slides, guessed(SPEED_NOISE, y),
        _first(guessed(FORCE_NOISE * weight / w.phi, K), K, weight / w.phi), Creep(K, 0.0, 0.0),
        Train(y, abs(y) + 1.0, rolling_deceleration(w) * K), 0.0, sigma, rolls,
    )  # fmt: skip


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    q = _predicted(p, w, s, h, K, y)
    rolling, d_r = corrected(q.rolling, q.of)
    sliding, d_s = corrected(q.sliding, q.of)
    changing, d_c = corrected(q.changing, q.of)
    least = min(d_r, d_s, d_c)
    p_r, p_s = rolling.p * math.exp(least - d_r), sliding.p * math.exp(least - d_s)
    p_c = changing.p * math.exp(least - d_c)
    total = p_r + p_s + p_c
    rolling, sliding = weighed(rolling, p_r / total), weighed(sliding, p_s / total)
    changing = weighed(changing, p_c / total)
    F = rolling.p * rolling.r + sliding.p * sliding.r + changing.p * changing.r
    variance = rolling.p * (rolling.rr + squared(rolling.r - F))
    variance += sliding.p * (sliding.rr + squared(sliding.r - F))
    variance += changing.p * (changing.rr + squared(changing.r - F))
    sigma = math.sqrt(variance + squared(w.rolling * w.phi) * q.clamping.variance)
    slippery = max(sliding.p, s.slippery * SLIPPERY / (SLIPPERY + h))
    return State(
        rolling, sliding, changing, q.noise, q.clamping, q.creep, q.train, slippery, sigma, F
    )


def nis(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> float:
    """Normalised innovation squared of this sample, NaN where the filters do not use it."""
    q = _predicted(p, w, s, h, K, y)
    if q.of.variance >= NOTHING:
        return math.nan
    return square(_below(q, y - 0.5 * q.of.step), _below(q, y + 0.5 * q.of.step))


def _below(q: Predicted, y: float) -> tuple[float, float]:
    """Probability of a reading below y, and of one above it, by all regimes together."""
    a, b, d = below(q.rolling, q.of, y), below(q.sliding, q.of, y), below(q.changing, q.of, y)
    total = q.rolling.p + q.sliding.p + q.changing.p
    return (a[0] + b[0] + d[0]) / total, (a[1] + b[1] + d[1]) / total


def _predicted(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> Predicted:
    """The regimes before they take the reading; the reading; what is learned from it."""
    weight, before = w.mass * G, s.clamping.K
    clamping = _clamped(p, s.clamping, h, K, weight / w.phi)
    mean, more = 0.5 * (before + clamping.K), clamping.K - before
    noise = learned(s.noise, y, h, -h * rolling_deceleration(w) * mean, p.memory)
    counts = counting(noise)
    r = certain(noise) if counts or tells(noise) else NOTHING
    of = Reading(y, r, 0.0 if counts else rounding(noise), 1.0 if counts else 0.0)
    creep = _crept(w, s, h, clamping.K)
    follows = w.rolling * w.phi
    bend = OTHERWISE * creep.delay * follows * (creep.rate - s.creep.rate)

    braked, a = -h * w.a * w.phi * mean, w.a * h
    lost = BENT * a * w.phi * more
    fresh = discovered(noise, s.noise)
    load = max(w.phi * clamping.K, abs(s.F)) + p.least * weight
    x, z, c, train = _switched(w, s, h)
    x = moved(
        x, a, braked, (1.0 - w.rolling) * lost + fresh, follows * (creep.K - s.creep.K),
        squared(p.rolling * weight) * h + bend * bend,
    )  # (1)  # fmt: skip
    z = moved(z, a, braked, lost + fresh, 0.0, squared(p.sliding * load) * h)
    c = moved(c, a, braked, lost + fresh, 0.0, squared(p.changing * load) * h)
    return Predicted(x, z, c, of, noise, clamping, creep, train)


def _crept(w: Wheelset, s: State, h: float, K: float) -> Creep:
    """The clamping force with the delay of creep: exact for a straight line to K."""
    delay = w.inertia * abs(s.rolling.x) / (w.radius * w.mass * G * STIFFNESS) + 1e-9
    behind = (K - s.clamping.K) / h * delay
    now = K - behind + (s.creep.K - s.clamping.K + behind) * math.exp(-h / delay)
    return Creep(now, (now - s.creep.K) / h, delay)


def _switched(w: Wheelset, s: State, h: float) -> tuple[Gaussian, Gaussian, Gaussian, Train]:
    """Each regime as a mixture of what may have become it within `h`, at most one change."""
    x, z, c = s.rolling, s.sliding, s.changing
    weight, braked = w.mass * G, w.phi * s.clamping.K
    normal = w.rolling * braked
    slips = (ROLLS_SLIDES + SLIDES_AGAIN * s.slippery) * normal / (normal + BRAKED * weight)
    z_sticks = SLIDES_ROLLS + STICKS * _reached(z, s.train)
    c_sticks = CHANGES_ROLLS + STICKS * _reached(c, s.train)
    of_x = x.p * _within(ROLLS_CHANGES + slips, h)
    of_z = z.p * _within(SLIDES_CHANGES + z_sticks, h)
    of_c = c.p * _within(CHANGES_SLIDES + c_sticks, h)
    x_leaves, z_stays = (ROLLS_CHANGES + slips) * of_x, z.p - (SLIDES_CHANGES + z_sticks) * of_z
    c_stays = c.p - (CHANGES_SLIDES + c_sticks) * of_c

    own = rolling_deceleration(w) * s.clamping.K
    slows, off = 0.5 * (own + s.train.slows), 0.5 * (own - s.train.slows)
    F, FF = braked - slows / w.a, squared(abs(off) + SLOWS / w.radius) / (w.a * w.a)
    slip = _with(x, SLIPS * normal, squared(SLIPS_BY * normal))
    leap = squared(LEAP * weight)
    return (
        merged(
            x, _with(z, F, FF), _with(c, F, FF), x.p - x_leaves, z_sticks * of_z, c_sticks * of_c
        ),
        merged(slip, z, c, slips * of_x, z_stays, CHANGES_SLIDES * of_c),
        merged(
            _leapt(x, leap), _leapt(z, leap), c, ROLLS_CHANGES * of_x, SLIDES_CHANGES * of_z,
            c_stays,
        ),
        _left(w, s, h, x_leaves, z_stays + SLIDES_CHANGES * of_z + c.p - c_sticks * of_c),
    )  # fmt: skip


def _left(w: Wheelset, s: State, h: float, new: float, old: float) -> Train:
    """The train one interval on; the wheel stops rolling with weight `new`, `old` did before."""
    x, t, share = s.rolling, s.train, new / (new + old)
    speed = t.speed + share * (x.x - t.speed)
    variance = (1.0 - share) * (squared(t.doubt) + squared(t.speed - speed))
    variance += share * (x.xx + squared(CREEPAGE * x.x) + squared(x.x - speed))
    slows = t.slows + share * (w.a * (w.phi * s.clamping.K - x.r) - t.slows)
    return Train(speed - h * slows, math.sqrt(variance) + h * SLOWS / w.radius, slows)


def _with(g: Gaussian, F: float, FF: float) -> Gaussian:
    """The same speed with another force."""
    return Gaussian(g.x, F, g.n, g.xx, 0.0, FF, g.xn, 0.0, g.nn, g.p)


def _leapt(g: Gaussian, FF: float) -> Gaussian:
    """The same with more variance of the force."""
    return Gaussian(g.x, g.r, g.n, g.xx, g.xr, g.rr + FF, g.xn, g.rn, g.nn, g.p)


def _reached(g: Gaussian, t: Train) -> float:
    """Probability that the wheel is as fast as the train; quicker than the error function."""
    e = g.x - t.speed
    return 0.5 + 0.5 * e / math.sqrt(e * e + 2.0 * (g.xx + t.doubt * t.doubt) + 1e-30)


def _within(rate: float, h: float) -> float:
    """Probability of a change within `h` over its rate; quicker than the exponential function."""
    return h / (1.0 + rate * h)


def _first(noise: Noise, K: float, scale: float) -> Clamping:
    """K at a start, or where it is zero: a bound of (15), without noise."""
    rate = FASTEST * scale
    return Clamping(
        known(K, 0.0, 0.0, 0.0, 0.5), known(K, 0.0, 0.0, rate * rate, 0.5), noise, K, 0.0
    )


def _clamped(p: Params, s: Clamping, h: float, K: float, scale: float) -> Clamping:
    """K one sample on: held and moving, mixed as the regimes of the wheel."""
    if K <= 0.0:
        return _first(paused(s.noise, K, 0.0), K, scale)
    noise = learned(s.noise, K, h, 0.0, p.memory) if s.noise.y > 0.0 else paused(s.noise, K, 0.0)
    most = MOST_NOISE * scale
    of = Reading(K, min(certain(noise) + squared(rounding(noise)) / 12.0, most * most), 0.0, 0.0)
    leaves, stops = HELD_MOVES * _within(HELD_MOVES, h), MOVES_HELD * _within(MOVES_HELD, h)
    a, b = s.held, s.moving
    stays, back = a.p * (1.0 - leaves), b.p * stops
    x = (stays * a.x + back * b.x) / (stays + back)
    xx = (stays * (a.xx + squared(a.x - x)) + back * (b.xx + squared(b.x - x))) / (stays + back)
    still = known(x, xx + squared(p.held * scale) * h, 0.0, 0.0, stays + back)
    held, d_h = corrected(still, of)
    goes = merged(a, b, b, a.p * leaves, b.p * (1.0 - stops), 0.0)
    goes = moved(goes, h, 0.0, 0.0, 0.0, squared(p.moving * scale) * h)
    if abs(K - goes.x) > JUMP * math.sqrt(goes.xx + of.variance):
        goes = known(K, JUMP * JUMP * (goes.xx + of.variance), goes.r, goes.rr, goes.p)
    moving, d_m = corrected(goes, of)

    least = min(d_h, d_m)
    p_h, p_m = held.p * math.exp(least - d_h), moving.p * math.exp(least - d_m)
    held, moving = weighed(held, p_h / (p_h + p_m)), weighed(moving, p_m / (p_h + p_m))
    x = held.p * held.x + moving.p * moving.x
    variance = held.p * (held.xx + squared(held.x - x)) + moving.p * (
        moving.xx + squared(moving.x - x)
    )
    return Clamping(held, moving, noise, max(x, 0.0), variance)


ABOUT = About(
    title="Interacting multiple models",
    source="Blom H., Bar-Shalom Y.: The interacting multiple model algorithm for systems with "
    "Markovian switching coefficients, IEEE Transactions on Automatic Control 33 (1988) 780-783, "
    "doi 10.1109/9.1299",
    claims={"service-brake": Claim(3.9, 0.001), "low-adhesion": Claim(34.0, 0.017)},
)
