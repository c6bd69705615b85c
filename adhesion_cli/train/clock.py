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
follows from the curvature of what is left. The noise of the train speed is slow and the same for
every axle.

Where all wheels slide all along, wheel-slide protection lets them come back to the train's speed
again and again. That shows the delay of a receiver, which is late and has no offset, and of another
train speed a bound. Only the moment of each two seconds counts at which a wheel is nearest to the
train, with c_i from the time without brake. What is left there is a slip κ of 0 to 3 %. Its error
κ v falls with the speed, that of a delay does not: T(t + τ) − (1 + c_i) ωR = κ ωR. Wheels that are
slower by the same speed all along would look like a delay, so the error of τ allows for 0.2 m/s of
that.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.masks import erode, true_runs
from ..core.model import Bools, Floats, Parameter
from ..core.physics import CRAWL, RECEIVER_INTERVAL
from ..core.signals import white_noise
from .grid import FEWEST, Grid

_SCAN = 0.1  # from one that is tried to the next [s]
_TAUS = np.arange(-5.0, 5.0 + _SCAN / 2.0, _SCAN)  # delays that are tried [s]
_OFFSETS = 0.6 * _TAUS  # of the speed that are tried [m/s]
_FLOOR = 0.03  # 1 sigma by which a rolling wheel may differ, whatever the noise [m/s]
_CUTOFF_SIGMAS = 4.0  # sigma that are no noise
_WORN = 0.02  # 1 sigma of c [-]
_CREEPAGE = 0.002, 0.004  # q and its 1 sigma: creep of 0.2 % at 1 m/s² [s²/m]
_NO_CREEP = 3.0  # sigma of q: a fit farther off is one of slides
_SLOWING = 0.2  # a train that does is braked [m/s²]
_GAINING = 0.1  # a wheel that does may be driven [m/s²]
_NEAR = 0.7  # from a delay to those that are tried beside it [s]
_SLIDE_MARGIN = 1.0  # before and behind a slide creep is no straight line of force [s]
_SHORTEST_ROLLING = 3.0  # shortest rolling of a braked wheel [s]
_RETURN_SLIP = 0.008, 0.008  # κ and its 1 sigma [-]
_FASTER_TIME = 0.6  # no braked wheel is faster than its train: by noise at most for this time [s]
_RETURN_TIME = 2.0  # within it some wheel comes back to the train's speed, where all slide [s]
_SHARE = 0.5  # and for this share of the braking
# of the time that the best axle rolls: an axle that rolls less does not count
_ROLLING_SHARE = 0.85
_NOISE_TIME = 1.5  # a receiver's noise is as slow as this, or as three of its samples [s]
# 1 sigma of τ by creep that does not go with the force; with more, unknown [s]
_DELAY_SIGMAS = 0.015, 0.2
_RETURN_SPEED = 0.1  # 1 sigma of what is left at a return and is no share of the speed [m/s]
_RETURN_UNKNOWN = 0.3  # 1 sigma of τ by returns from which on it is not known [s]
_OFFSET_SIGMAS = 0.05, 0.3  # the same two of o: by what a slow wheel's sensor leaves out [m/s]
_CERTAIN = 3.0  # sigma from zero is an offset
# nearest other τ or o [s, m/s], and its loss over the best one's
_SEPARATION, _LOSS_RATIO = 0.5, 1.1
_CLEAR_RATIO = 1.5  # the same of τ and o
_PAUSE = 5.0  # a longer time between two brakings parts them [s]
_PARABOLA = 3  # fine steps to each side of the least loss through which the parabola goes
_MOST_SAMPLES = 4000  # samples of the fit
_BLOCK = 50_000  # samples of candidates that are fitted at a time: they stay in a processor's cache

_Places = slice | NDArray[np.int64]


class _ClockSamples(NamedTuple):
    """What is fitted: shape (n,), and (axles, n)."""

    t: Floats  # [s]
    rim: Floats  # [m/s]
    released: Bools  # not braked (axles, n)
    train_slows: Bools  # the train does (n,)
    noise: float  # 1 sigma of the train speed [m/s]
    correlated: float  # samples in a row with correlated noise
    usable: Bools  # where the rim turns and its deceleration is known (axles, n)
    fast: Bools  # where it is not slow for its axle (axles, n)
    by_radius: Floats  # factor of c, 0 where not known (axles, n)
    by_creep: Floats  # factor of q, likewise
    gains: Bools  # where the wheel may be driven (axles, n)
    creepage: tuple[float, float] = _CREEPAGE  # q and its 1 sigma

    def select(self, axles: Bools) -> "_ClockSamples":
        """Those of some axles."""
        return self._replace(**{n: x[axles] for n, x in self._asdict().items() if np.ndim(x) == 2})

    def cut(self, samples: slice) -> "_ClockSamples":
        """Those of a part of the log."""
        columns = self._asdict()
        columns |= {n: x[..., samples] for n, x in columns.items() if isinstance(x, np.ndarray)}
        return self._replace(**columns)

    def undriven(self) -> "_ClockSamples":
        """Those without the wheels that may be driven."""
        usable = self.usable & ~self.gains
        by = {name: getattr(self, name) * usable for name in ("by_radius", "by_creep")}
        return self._replace(usable=usable, **by)


class _Fits(NamedTuple):
    """At each of m candidates of τ or o."""

    x: Floats  # c of each axle, q; (m, axles + 1)
    rolling: Bools  # (m, axles, n): no slide
    loss: Floats  # mean square of what is left, cut off (m,)


class ClockOffset(NamedTuple):
    """How the train speed differs from the wheels; None where that is not clear."""

    delay: Parameter | None  # τ [s]
    offset: Parameter | None = None  # o [m/s], where τ is none or does not explain it better


class _LikeliestClock(NamedTuple):
    value: Parameter
    loss: float
    clear: bool  # no other is nearly as likely


def compare_clocks(g: Grid, interval: float, resolution: float = 0.0) -> ClockOffset:
    """Delay of the train speed, negative where it is early, and its offset.

    `interval` is that of the train speed's own samples [s]. An offset within the `resolution` of
    its values [m/s] is none, as of whole miles per hour.
    """
    train = g.train
    if train is None or np.isfinite(train).sum() < 2 * FEWEST:
        return ClockOffset(None)
    t: Floats = g.step * np.arange(len(train), dtype=np.float64)
    finite, stride = np.isfinite(train), max(1, len(t) // _MOST_SAMPLES)
    strides = (1, max(1, round(0.5 / g.step)))  # neighbours may be interpolated
    runs = ((t[finite][::j], train[finite][::j]) for j in strides)
    sample_t, train_t, measured = t[::stride], t[finite], train[finite]

    def read_train(tau: float) -> Floats:
        return np.interp(sample_t + tau, train_t, measured, left=np.nan, right=np.nan)

    noise = max(_FLOOR, *(math.sqrt(white_noise([run])) for run in runs))
    correlated = max(1.0, max(_NOISE_TIME, 3.0 * interval) / (g.step * stride))
    s = _samples(g, sample_t, stride, noise, correlated)
    clocks = _compare(s, read_train, resolution)
    if clocks.delay or clocks.offset:
        return clocks
    for samples in _brakings(s):
        part = _compare(s.cut(samples), partial(_read_part, read_train, samples), resolution)
        if part.delay and not (clocks.delay and clocks.delay.tolerance < part.delay.tolerance):
            clocks = part
    if clocks.delay:
        return clocks
    delay = _delay_by_returns(s, read_train)
    if delay and interval <= RECEIVER_INTERVAL:  # it may have an offset: only a bound
        delay = Parameter(0.0, math.hypot(*delay))
    return ClockOffset(delay)


def _compare(
    s: _ClockSamples, read_train: Callable[[float], Floats], resolution: float
) -> ClockOffset:
    """The offset that some samples show, by the train speed at each delay."""
    delay = _likeliest(s, _TAUS, read_train, *_DELAY_SIGMAS)
    if delay:  # the creep of driven wheels is as a delay
        near = delay.value.value + np.arange(-_NEAR, _NEAR + _SCAN / 2.0, _SCAN)
        if undriven := _likeliest(s.undriven(), near, read_train, *_DELAY_SIGMAS):
            delay = delay._replace(value=undriven.value)
    train_speed = read_train(0.0)
    offset = _likeliest(s, _OFFSETS, lambda o: train_speed - o, *_OFFSET_SIGMAS)
    clear_delay = delay.value if delay and delay.clear else None
    if offset is None or abs(offset.value.value) < _CERTAIN * offset.value.tolerance:
        return ClockOffset(clear_delay)
    sure_offset = offset.value if abs(offset.value.value) > resolution else None
    if delay is None or _CLEAR_RATIO * offset.loss < delay.loss:
        return ClockOffset(None, sure_offset if offset.clear else None)
    both_fit = clear_delay and _CLEAR_RATIO * delay.loss > offset.loss
    return ClockOffset(clear_delay, sure_offset if both_fit else None)


def _brakings(s: _ClockSamples) -> Iterator[slice]:
    """The samples of each braking of several: one of them may be dry."""
    pause = _PAUSE / (s.t[1] - s.t[0])
    runs = list(true_runs(s.train_slows))
    cuts = [(b + a) // 2 for (_, b), (a, _) in itertools.pairwise(runs) if a - b > pause]
    if cuts:
        yield from itertools.starmap(slice, itertools.pairwise([0, *cuts, len(s.t)]))


def _read_part(read_train: Callable[[float], Floats], samples: _Places, tau: float) -> Floats:
    return read_train(tau)[samples]


def _delay_by_returns(s: _ClockSamples, read_train: Callable[[float], Floats]) -> Parameter | None:
    """The delay by one wheel in place of all: the nearest to the train within each two seconds.

    None where it is not clear, where a wheel rolls most of the time, and where no axle has a time
    without brake. A wheel that comes back swings by more than what the delay explains.
    """
    train, step = read_train(0.0), float(s.t[1] - s.t[0])
    coasting = s.usable & s.released & ~s.train_slows & np.isfinite(train)
    coasts = coasting.sum(axis=1) >= FEWEST
    width = max(1, round(_RETURN_TIME / step))
    starts = np.arange(0, len(train) - width + 1, width)
    slowing = s.train_slows & np.isfinite(train)
    if not coasts.any() or min(len(starts), slowing.sum()) < FEWEST:
        return None
    s = s.select(coasts)
    ratios = np.where(coasting[coasts], train / np.maximum(s.rim, CRAWL), np.nan)
    rim = s.rim * np.nanmedian(ratios, axis=1, keepdims=True)

    def gap(v: Floats) -> Floats:
        return np.where(s.usable & np.isfinite(v), v - rim, np.inf)

    logged_gap = gap(train)
    windows = logged_gap[:, : len(starts) * width].reshape(len(rim), len(starts), width)
    places = starts + windows.min(axis=0).argmin(axis=1)
    axles = logged_gap[:, places].argmin(axis=0)
    nearest, usable = rim[axles, places], s.usable[axles, places]
    train_slows = s.train_slows[places]
    returns = s._replace(
        t=s.t[starts],
        rim=nearest[None],
        released=s.released[axles, places][None],
        train_slows=train_slows,
        correlated=max(1.0, s.correlated / width),
        usable=usable[None],
        fast=s.fast[axles, places][None],
        by_radius=np.zeros((1, len(starts))),
        by_creep=np.where(usable & train_slows, nearest, 0.0)[None],
        gains=np.zeros((1, len(starts)), dtype=np.bool_),
        creepage=_RETURN_SLIP,
    )
    mean_rate = -float(np.diff(train)[slowing[1:] & slowing[:-1]].mean()) / step
    sigma = _RETURN_SPEED / max(mean_rate, _SLOWING)
    read_nearest = partial(_read_part, read_train, places)
    likeliest = _likeliest(returns, _TAUS, read_nearest, sigma, _RETURN_UNKNOWN)
    if likeliest is None or not likeliest.clear:
        return None
    delay = likeliest.value
    if delay.value < -delay.tolerance:
        return None
    true_gap, cutoff = gap(read_train(delay.value)), _CUTOFF_SIGMAS * s.noise
    faster = ((true_gap < -cutoff) & ~s.released).any(axis=0).sum() * step
    rolling = (np.abs(true_gap) < cutoff) & s.train_slows
    rolls = rolling.sum(axis=1).max() > _SHARE * s.train_slows.sum()
    highest = np.where(np.isfinite(windows), windows, -np.inf).max(axis=2)
    swings = (highest - windows.min(axis=2)).max(axis=0)[train_slows]
    comes_back = float(np.median(swings)) > delay.value * mean_rate
    return None if faster > _FASTER_TIME or rolls or not comes_back else delay


def _samples(g: Grid, t: Floats, stride: int, noise: float, correlated: float) -> _ClockSamples:
    """Every so many samples of a grid, at times t; with what all fits share."""
    rim, slowing = g.rim[:, ::stride], -g.rim_rate[:, ::stride]
    train_slows = np.zeros(len(t), dtype=np.bool_)
    if g.train_rate is not None:
        train_slows = np.nan_to_num(-g.train_rate[::stride]) > _SLOWING
    usable = np.isfinite(slowing) & (rim > CRAWL)
    fast = np.array([x > 0.3 * np.nanmax(x) for x in rim])
    return _ClockSamples(
        t=t,
        rim=rim,
        released=g.clamping[:, ::stride] <= 0.0,
        train_slows=train_slows,
        noise=noise,
        correlated=correlated,
        usable=usable,
        fast=fast,
        by_radius=np.where(usable, rim, 0.0),
        by_creep=np.where(usable, rim * np.maximum(slowing, 0.0), 0.0),
        gains=slowing < -_GAINING,
    )


def _likeliest(
    s: _ClockSamples,
    candidates: Floats,
    speed_by: Callable[[float], Floats],
    model_sigma: float,
    unknown: float,
) -> _LikeliestClock | None:
    """The value at which most of the samples fit; None where the wheels do not show it.

    `speed_by` gives the train's speed by a candidate, (n,) [m/s]. `model_sigma` is 1 sigma where
    everything else is known; from `unknown` on the value is not known.
    """
    fits = _fit_each(s, speed_by, candidates)
    losses = fits.loss
    place = int(np.argmin(losses))
    if not math.isfinite(losses[place]) or not 0 < place < len(candidates) - 1:
        return None
    rolls = (fits.rolling[place] & s.train_slows).sum(axis=1)
    needed = max(_SHORTEST_ROLLING / (s.t[1] - s.t[0]), _SHARE * s.train_slows.sum())
    if rolls.max() < needed:
        return None
    counts = rolls > _ROLLING_SHARE * rolls.max()  # what little is left of a slide is no noise
    s = s.select(counts)
    fine_values = np.linspace(candidates[place - 1], candidates[place + 1], 17)
    fine_fits = _fit_each(s, speed_by, fine_values)
    fine_losses = fine_fits.loss
    # far from its minimum the loss is no parabola: samples that no longer fit are cut off
    middle = min(max(int(np.argmin(fine_losses)), _PARABOLA), len(fine_values) - 1 - _PARABOLA)
    near = slice(middle - _PARABOLA, middle + _PARABOLA + 1)
    bend, slope, _ = np.polyfit(fine_values[near] - fine_values[middle], fine_losses[near], 2)
    if not bend > 0.0 or not abs(slope) < 2.0 * bend * (fine_values[-1] - fine_values[0]):
        return None
    value = float(fine_values[middle] - slope / (2.0 * bend))
    f = _Fits(*(x[0] for x in _fit_each(s, speed_by, np.array([value]))))
    # −2 log of the likelihood is its number of independent samples times the log of the loss.
    telling = float(f.rolling.any(axis=0).sum()) / s.correlated
    loss = float(f.loss)
    # over less of the speed, what goes with it is the more like what does not
    braked_rim = s.rim[f.rolling & s.train_slows]
    speed_share = 1.0 - float(braked_rim.min() / braked_rim.max())
    sigma = math.hypot(math.sqrt(loss / (bend * telling)), model_sigma / max(speed_share, 1e-9))
    rolling = s.released & np.isfinite(speed_by(value)) & s.usable
    creep_by_value = float(np.polyfit(fine_values[near], fine_fits.x[near, -1], 1)[0])
    creep_sigma = math.hypot(s.creepage[1], creep_by_value * sigma)  # q has the error of the value
    slides = abs(f.x[-1] - s.creepage[0]) > _NO_CREEP * creep_sigma
    slides |= 2 * f.rolling[rolling].sum() < rolling.sum()
    other_losses = losses[np.abs(candidates - value) > _SEPARATION]
    clear = not (other_losses.min() < _LOSS_RATIO * losses[place] or slides or sigma > unknown)
    return _LikeliestClock(Parameter(value, sigma), loss, clear)


def _start(s: _ClockSamples, v: Floats) -> Floats:
    """First c and q, (m, axles + 1): a wheel coasts without slip, one that rolls is the faster.

    `v` is the train's true speed by each candidate (m, n) [m/s].
    """
    fast = s.fast & (v > CRAWL)[:, None]  # (m, axles, n)
    coasting = fast & s.released & ~s.train_slows
    coasts = coasting.sum(axis=-1) >= FEWEST
    chosen = np.where(coasts[..., None], coasting, fast)
    unknown = np.full(chosen.shape, np.nan)
    ratios = np.sort(np.divide(v[:, None], s.rim, out=unknown, where=chosen), axis=-1)  # NaN last
    count = chosen.sum(axis=-1)
    place = np.where(coasts, 0.5, 0.3) * np.maximum(count - 1, 0)  # of the median, and of 30 %
    lower = place.astype(np.int64)[..., None]
    upper = np.minimum(lower + 1, np.maximum(count - 1, 0)[..., None])
    edges = (np.take_along_axis(ratios, i, axis=-1)[..., 0] for i in (lower, upper))
    ratio_below, ratio_above = edges
    ratio_step = (place - lower[..., 0]) * (ratio_above - ratio_below)
    c = np.where(count > 0, ratio_below + ratio_step - 1.0, 0.0)
    x = np.append(c, np.full((len(v), 1), s.creepage[0]), axis=-1)
    inside: Floats = np.clip(x, -3.0 * _WORN, 3.0 * _WORN)
    return inside


def _fit_each(s: _ClockSamples, speed_by: Callable[[float], Floats], candidates: Floats) -> _Fits:
    """The fits at all candidates, some of them at a time."""
    speeds, block = np.array([speed_by(x) for x in candidates]), max(1, _BLOCK // s.rim.size)
    fits = [_fit(s, speeds[k : k + block]) for k in range(0, len(speeds), block)]
    return _Fits(*map(np.concatenate, zip(*fits, strict=True)))


def _fit(s: _ClockSamples, v: Floats) -> _Fits:
    """Least squares of c and q over what is no slide, by each true speed (m, n) [m/s]."""
    k = len(s.rim)
    usable = s.usable & (v > CRAWL)[:, None]
    d = np.where(usable, v[:, None] - s.rim, 0.0)
    x, residual, rolling, cutoff = _start(s, v), d.copy(), usable.copy(), _CUTOFF_SIGMAS * s.noise
    margin = round(_SLIDE_MARGIN / (s.t[1] - s.t[0]))
    changes = np.arange(len(v))  # candidates whose next fit would be another one
    for n in range(8):
        by_radius, by_creep = x[changes, :k, None], x[changes, k, None, None]
        left = d[changes] - (s.by_radius * by_radius + s.by_creep * by_creep)
        in_use, previous = usable[changes], rolling[changes]
        rolls = in_use & (np.abs(left) < cutoff) & erode(~in_use | (left < cutoff), margin)
        residual[changes], rolling[changes] = left, rolls
        if n > 0:
            changes = changes[(rolls != previous).any(axis=(1, 2))]
        x[changes] = _solved(s, rolling[changes], d[changes])
    squares = np.where(usable, np.minimum(residual**2, cutoff**2), 0.0).sum(axis=(1, 2))
    count = usable.sum(axis=(1, 2))
    return _Fits(x, rolling, np.where(count >= FEWEST, squares / np.maximum(count, 1), math.inf))


def _solved(s: _ClockSamples, rolling: Bools, d: Floats) -> Floats:
    """Every axle's c, and q, by the normal equations of the samples without slides; (m, axles + 1).

    `rolling` are the samples that are used, by each candidate (m, axles, n); `d` is what c and q
    explain, of that shape [m/s].
    """
    k, c, q = len(s.rim), s.by_radius * rolling, s.by_creep * rolling
    expected = np.append(np.zeros(k), s.creepage[0])
    weights = (s.noise / np.array([*([_WORN] * k), s.creepage[1]])) ** 2  # as numbers of samples
    A, axle_index = np.zeros((len(d), k + 1, k + 1)), np.arange(k)
    A[:, axle_index, axle_index] = (c * c).sum(axis=-1)
    A[:, k, k] = (q * q).sum(axis=(1, 2))
    A[:, k, :k] = A[:, :k, k] = (c * q).sum(axis=-1)  # two axles share no sample
    b = np.append((c * d).sum(axis=-1), (q * d).sum(axis=(1, 2))[:, None], axis=-1)
    b += weights * expected
    return np.asarray(np.linalg.solve(A + np.diag(weights), b[..., None])[..., 0], np.float64)
