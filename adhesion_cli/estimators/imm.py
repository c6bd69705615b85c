"""Interacting multiple models: a wheel that rolls, slides, or changes between the two.

Three Kalman filters of (ω, F) have ω̇ = a(F − φK) in common                              (1)
and differ in what moves F:

- rolling: the clamping force, dF = φ dK/(1 + I/(mR²)), and a small random walk;
- sliding: the rail, a medium walk. K has no effect on it;
- changing: a large walk, for the milliseconds between the two.

The regimes change at random, at fixed rates per second. At every sample their states are mixed,
each filter takes the reading, and its likelihood weighs it. F̂ is the mean of the mixture and sigma
its standard deviation. K comes from two such filters, of a pressure that is held or moves. The
noise of both sensors is learned from their readings. So nothing depends on the rate of the log.

Start. A wheel is assumed to roll: F̂ = φK/(1 + I/(mR²)).

The filters are Blom's and Bar-Shalom's. Regimes, rates and the noise are ours.
"""

import math
from typing import Annotated, NamedTuple

from ..core.estimator import About, Claim
from ..core.innovations import square
from ..core.model import Quantity, Wheelset
from ..core.physics import G, rolling_deceleration
from ._mixture import Gaussian, Reading, below, corrected, known, merged, moved, weighed
from ._noise import Noise, certain, counting, discovered, guessed, learned, paused, rounding, tells

# Rates of change between regimes [1/s].
ROLLS_CHANGES = 0.005
SLIDES_ROLLS, SLIDES_CHANGES = 0.2, 1.0
CHANGES_ROLLS, CHANGES_SLIDES = 0.05, 3.0
HELD_MOVES, MOVES_HELD = 0.3, 0.1

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
    ] = 5e-4
    sliding: Annotated[
        float, Quantity("1/√s", "walk of F over φK while the wheel slides", 0.0, 100.0)
    ] = 0.1
    changing: Annotated[
        float, Quantity("1/√s", "walk of F over φK between the two", 0.0, 100.0)
    ] = 3.0
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


class State(NamedTuple):
    """The regimes of the wheel, with level ω [rad/s] and rate F [N], K and noise."""

    rolling: Gaussian
    sliding: Gaussian
    changing: Gaussian
    noise: Noise  # of the wheel speed [rad/s]
    clamping: Clamping
    sigma: float  # standard uncertainty of F [N]
    F: float  # [N]


def init(p: Params, w: Wheelset, K: float, y: float) -> State:
    """A wheel that probably rolls, whether it is braked or not."""
    weight, rolls = w.mass * G, w.rolling * w.phi * K
    v, least = SPEED_NOISE * SPEED_NOISE, SLOPE * weight
    slides = known(y, v, rolls, (ANY * rolls + least) ** 2, 0.05)
    sigma = UNSURE * rolls + least
    return State(
        known(y, v, rolls, sigma * sigma, 0.9), slides, slides, guessed(SPEED_NOISE, y),
        _first(guessed(FORCE_NOISE * weight / w.phi, K), K, weight / w.phi), sigma, rolls,
    )  # fmt: skip


def step(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> State:
    """One sample on."""
    x, z, c, of, noise, clamping = _predicted(p, w, s, h, K, y)
    rolling, d_r = corrected(x, of)
    sliding, d_s = corrected(z, of)
    changing, d_c = corrected(c, of)
    least = min(d_r, d_s, d_c)
    p_r, p_s = rolling.p * math.exp(least - d_r), sliding.p * math.exp(least - d_s)
    p_c = changing.p * math.exp(least - d_c)
    total = p_r + p_s + p_c
    rolling, sliding = weighed(rolling, p_r / total), weighed(sliding, p_s / total)
    changing = weighed(changing, p_c / total)
    F = rolling.p * rolling.r + sliding.p * sliding.r + changing.p * changing.r
    variance = rolling.p * (rolling.rr + (rolling.r - F) ** 2)
    variance += sliding.p * (sliding.rr + (sliding.r - F) ** 2)
    variance += changing.p * (changing.rr + (changing.r - F) ** 2)
    sigma = math.sqrt(variance + (w.rolling * w.phi) ** 2 * clamping.variance)
    return State(rolling, sliding, changing, noise, clamping, sigma, F)


def nis(p: Params, w: Wheelset, s: State, h: float, K: float, y: float) -> float:
    """Normalised innovation squared of this sample, NaN where the filters do not use it."""
    x, z, c, of, _, _ = _predicted(p, w, s, h, K, y)
    if of.variance >= NOTHING:
        return math.nan
    low, high = y - 0.5 * of.step, y + 0.5 * of.step
    return square(_below(x, z, c, of, low), _below(x, z, c, of, high))


def _below(x: Gaussian, z: Gaussian, c: Gaussian, of: Reading, y: float) -> tuple[float, float]:
    """Probability of a reading below y, and of one above it, by all regimes together."""
    a, b, d = below(x, of, y), below(z, of, y), below(c, of, y)
    total = x.p + z.p + c.p
    return (a[0] + b[0] + d[0]) / total, (a[1] + b[1] + d[1]) / total


def _predicted(
    p: Params, w: Wheelset, s: State, h: float, K: float, y: float
) -> tuple[Gaussian, Gaussian, Gaussian, Reading, Noise, Clamping]:
    """The regimes before they take the reading; the reading; what is learned from it."""
    weight, before = w.mass * G, s.clamping.K
    clamping = _clamped(p, s.clamping, h, K, weight / w.phi)
    mean, rise = 0.5 * (before + clamping.K), w.rolling * w.phi * (clamping.K - before)
    gained = -h * rolling_deceleration(w) * mean
    noise = learned(s.noise, y, h, gained, p.memory)
    counts = counting(noise)
    r = certain(noise) if counts or tells(noise) else NOTHING
    of = Reading(y, r, 0.0 if counts else rounding(noise), 1.0 if counts else 0.0)

    braked, a = -h * w.a * w.phi * mean, w.a * h
    lost = BENT * a * w.phi * (clamping.K - before)
    fresh = discovered(noise, s.noise)
    load = max(w.phi * clamping.K, abs(s.F)) + p.least * weight
    x, z, c = _switched(s, h)
    x = moved(
        x, a, braked, (1.0 - w.rolling) * lost + fresh, rise, (p.rolling * weight) ** 2 * h
    )  # (1)
    z = moved(z, a, braked, lost + fresh, 0.0, (p.sliding * load) ** 2 * h)
    c = moved(c, a, braked, lost + fresh, 0.0, (p.changing * load) ** 2 * h)
    return x, z, c, of, noise, clamping


def _switched(s: State, h: float) -> tuple[Gaussian, Gaussian, Gaussian]:
    """Each regime as a mixture of what may have become it within `h`, at most one change."""
    x, z, c = s.rolling, s.sliding, s.changing
    x_leaves = _leaves(ROLLS_CHANGES, h)
    z_leaves = _leaves(SLIDES_ROLLS + SLIDES_CHANGES, h)
    c_leaves = _leaves(CHANGES_ROLLS + CHANGES_SLIDES, h)
    z_rolls = z_leaves * SLIDES_ROLLS / (SLIDES_ROLLS + SLIDES_CHANGES)
    c_rolls = c_leaves * CHANGES_ROLLS / (CHANGES_ROLLS + CHANGES_SLIDES)
    return (
        merged(x, z, c, x.p * (1.0 - x_leaves), z.p * z_rolls, c.p * c_rolls),
        merged(x, z, c, 0.0, z.p * (1.0 - z_leaves), c.p * (c_leaves - c_rolls)),
        merged(x, z, c, x.p * x_leaves, z.p * (z_leaves - z_rolls), c.p * (1.0 - c_leaves)),
    )


def _leaves(rate: float, h: float) -> float:
    """Probability of a change at this rate within `h`; quicker than the exponential function."""
    return rate * h / (1.0 + rate * h)


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
    of = Reading(K, min(certain(noise) + rounding(noise) ** 2 / 12.0, most * most), 0.0, 0.0)
    leaves, stops = _leaves(HELD_MOVES, h), _leaves(MOVES_HELD, h)
    a, b = s.held, s.moving
    stays, back = a.p * (1.0 - leaves), b.p * stops
    x = (stays * a.x + back * b.x) / (stays + back)
    xx = (stays * (a.xx + (a.x - x) ** 2) + back * (b.xx + (b.x - x) ** 2)) / (stays + back)
    still = known(x, xx + (p.held * scale) ** 2 * h, 0.0, 0.0, stays + back)
    held, d_h = corrected(still, of)
    goes = merged(a, b, b, a.p * leaves, b.p * (1.0 - stops), 0.0)
    goes = moved(goes, h, 0.0, 0.0, 0.0, (p.moving * scale) ** 2 * h)
    if abs(K - goes.x) > JUMP * math.sqrt(goes.xx + of.variance):
        goes = known(K, JUMP * JUMP * (goes.xx + of.variance), goes.r, goes.rr, goes.p)
    moving, d_m = corrected(goes, of)

    least = min(d_h, d_m)
    p_h, p_m = held.p * math.exp(least - d_h), moving.p * math.exp(least - d_m)
    held, moving = weighed(held, p_h / (p_h + p_m)), weighed(moving, p_m / (p_h + p_m))
    x = held.p * held.x + moving.p * moving.x
    variance = held.p * (held.xx + (held.x - x) ** 2) + moving.p * (moving.xx + (moving.x - x) ** 2)
    return Clamping(held, moving, noise, max(x, 0.0), variance)


ABOUT = About(
    title="Interacting multiple models",
    source="Blom H., Bar-Shalom Y.: The interacting multiple model algorithm for systems with "
    "Markovian switching coefficients, IEEE Transactions on Automatic Control 33 (1988) 780-783, "
    "doi 10.1109/9.1299",
    claims={"service-brake": Claim(4.8, 0.001), "low-adhesion": Claim(34.0, 0.017)},
)
