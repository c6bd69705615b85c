"""How well an estimate follows its target, over brake applications only.

None stands for what the data do not show. A reference as the target is smoothed without phase.
It judges accuracy, but response and lag only as far as it is itself quick enough.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ..core.model import Z95, AxleRecord, Floats, Reference, Score
from ..core.signals import means_around, median_of_five
from ..records import brake_applications

_LAG = 5.0  # longest lag looked for, either way [s]
# an estimate this early knows the future: a periodic force fits late as well [s]
_EARLIEST_LAG = 0.2
_EQUAL_FIT = 0.05  # lags that leave so little more of the variance fit as well
# share of its peak by which a target must vary (rms) to show lag and gain
_SMALLEST_VARIATION = 0.02
_RIPPLE = 0.5  # what is quicker than this is ripple [s]
_STEP = 0.1  # a step is over within this [s], or within one interval
_STEADY = 1.0  # and followed by this much steady force [s]
_BLOCK = 2.0  # errors of the target further apart than this count as independent [s]


@dataclass(frozen=True)
class EstimateAndTarget:
    """An estimate and its target, one column per brake application; at least one sample each.

    Only samples at which both are finite.
    """

    t: tuple[Floats, ...]  # [s]
    estimate: tuple[Floats, ...]  # [N]
    target: tuple[Floats, ...]  # [N]

    @cached_property
    def error(self) -> Floats:
        """Estimate less target over all applications, shape (n,) [N]."""
        return np.concatenate(self.estimate) - np.concatenate(self.target)

    @cached_property
    def fit(self) -> tuple[float, float] | None:
        """Lag τ [s] and gain g of estimate(t) ≈ g target(t − τ) + c, least squares over all three.

        None where the target hardly varies, or no lag within reach explains half of the estimate.
        """
        target = np.concatenate(self.target)
        if np.std(target) <= _SMALLEST_VARIATION * np.max(np.abs(target)) or len(target) < 5:
            return None
        longest = max(float(t[-1] - t[0]) for t in self.t)
        reach = min(_LAG, longest / 2.0)
        coarse, fine = (_SampledFit(self, max(len(target) // n, 1)) for n in (5_000, 50_000))
        lags = np.linspace(-reach, reach, 201)
        shares = [x for third in np.split(lags, 3) for x in coarse.unexplained(third)[0].tolist()]
        inner = range(1, len(lags) - 1)
        minima = [i for i in inner if shares[i] <= min(shares[i - 1], shares[i + 1])]
        if not minima:
            return None
        smallest_share = min(shares[i] for i in minima)
        fitting = [i for i in minima if shares[i] <= smallest_share + _EQUAL_FIT]
        best = min(fitting, key=lambda i: (lags[i] < -_EARLIEST_LAG, shares[i]))
        lag_before, lag_after = lags[[best - 1, best + 1]].tolist()
        lag = _golden(lambda x: float(fine.unexplained(np.array([x]))[0][0]), lag_before, lag_after)
        unexplained, gain = fine.unexplained(np.array([lag]))
        return (lag, float(gain[0])) if unexplained[0] < 0.5 else None


class _SampledFit:
    """An estimate, at every so many of its samples, against its target with any lag."""

    def __init__(self, c: EstimateAndTarget, stride: int) -> None:
        self._target, self._t = c.target, c.t
        self._sampled_t = [t[::stride] for t in c.t]
        estimate = np.concatenate([x[::stride] for x in c.estimate])
        self._estimate: Floats = estimate - np.mean(estimate)
        self._variation = float(self._estimate @ self._estimate)

    def unexplained(self, lags: Floats) -> tuple[Floats, Floats]:
        """Share of the estimate's variance that the target leaves, and its gain, at each lag.

        What goes against the target explains nothing.
        """
        signals = zip(self._sampled_t, self._t, self._target, strict=True)
        shifted = [np.interp(samples - lags[:, None], t, target) for samples, t, target in signals]
        x = np.concatenate(shifted, axis=1)
        x -= x.mean(axis=1, keepdims=True)
        xx, xy = np.vecdot(x, x), np.vecdot(x, self._estimate)
        scale, none = xx * self._variation, np.zeros(len(lags))
        explains = (scale > 0.0) & (xy > 0.0)
        explained = np.divide(xy * xy, scale, out=none.copy(), where=explains)
        return 1.0 - explained, np.divide(xy, xx, out=none, where=explains)


def _golden(f: Callable[[float], float], lower: float, upper: float) -> float:
    """Where f is least between `lower` and `upper`, golden section, to 1e-4 of the interval."""
    ratio = (math.sqrt(5.0) - 1.0) / 2.0
    a, b = upper - ratio * (upper - lower), lower + ratio * (upper - lower)
    fa, fb = f(a), f(b)
    for _ in range(19):
        if fa < fb:
            upper, b, fb = b, a, fa
            a = upper - ratio * (upper - lower)
            fa = f(a)
        else:
            lower, a, fa = a, b, fb
            b = lower + ratio * (upper - lower)
            fb = f(b)
    return (lower + upper) / 2.0


def response(c: EstimateAndTarget) -> float | None:
    """Time from a step of the target until the estimate has made 95 % of it for good.

    Of each application the largest step; the median of those the estimate made. It may overshoot.
    A step takes at most 0.1 s or one interval and is at least a fifth of the largest target. The
    force is steady before and after it, and the estimate has reached the force before it. A
    release is not a step: most logs end before a slow estimator has followed it.
    """
    peak = max(float(np.max(np.abs(y))) for y in c.target)
    times = []
    for t, estimate, target in zip(c.t, c.estimate, c.target, strict=True):
        step = _step(t, target, peak)
        if step is None:
            continue
        start, stop, level_before, level_after = step
        progress = (median_of_five(estimate) - level_before) / (level_after - level_before)
        not_reached = np.flatnonzero(progress[start:stop] < 0.95)
        reached = start + (int(not_reached[-1]) + 1 if len(not_reached) else 0)
        if reached < stop and abs(float(np.median(progress[max(start - 5, 0) : start]))) < 0.2:
            times.append(float(t[reached] - t[start]))
    return float(np.median(times)) if times else None


def _step(t: Floats, y: Floats, peak: float) -> tuple[int, int, float, float] | None:
    """The largest step of y: its first sample, the end of the steady time, level before and after.

    The first sample is the first that has left the level before.
    """
    n = len(t)
    stop = np.maximum(np.searchsorted(t, t + _STEP, side="right") - 1, np.arange(n) + 1)
    later_value = y[np.minimum(stop, n - 1)]
    change = np.where(np.abs(later_value) > 0.2 * peak, later_value - y, 0.0)  # less is a release
    k = int(np.argmax(np.abs(change)))
    if n < 3 or abs(change[k]) < 0.2 * peak:
        return None
    k += int(np.argmax(np.abs(y[k : stop[k] + 1] - y[k]) > 0.05 * abs(change[k])))  # it leaves
    earlier = y[np.searchsorted(t, t[k] - _STEADY) : k]
    settled = int(np.searchsorted(t, t[k] + _STEP))
    steady = y[settled : np.searchsorted(t, t[settled] + _STEADY) if settled < n else n]
    if not len(earlier) or len(steady) < 2 or t[-1] - t[k] < _STEADY:
        return None
    level, level_after = float(np.median(earlier)), float(np.median(steady))
    size = abs(level_after - level)
    if size < 0.2 * peak or np.ptp(earlier) > 0.2 * size or np.ptp(steady) > 0.2 * size:
        return None
    departures = np.flatnonzero(np.abs(y[settled:] - level_after) > 0.2 * size)
    return k, settled + int(departures[0]) if len(departures) else n, level, level_after


def ripple(c: EstimateAndTarget) -> float | None:
    """What moves in the estimate quicker than 0.5 s and is not in the target, rms.

    The error less its centred moving mean over that time; the median over stretches of that
    length, so that a step or a slide does not count.
    """
    squares = []
    for t, estimate, target in zip(c.t, c.estimate, c.target, strict=True):
        error = estimate - target
        interval = float(np.median(np.diff(t))) if len(t) > 5 else math.inf
        half_width = max(_RIPPLE / 2.0, 2.0 * interval)
        quick = error - means_around(t, error, 2.0 * half_width)
        inside = (t - half_width >= t[0]) & (t + half_width <= t[-1])
        block = ((t - t[0]) / (2.0 * half_width)).astype(int)[inside]
        if len(block):
            count = np.bincount(block)
            sums = np.bincount(block, quick[inside] ** 2)
            squares += (sums[count > 0] / count[count > 0]).tolist()
    return math.sqrt(float(np.median(squares))) if squares else None


def measure(c: EstimateAndTarget) -> dict[str, float | None]:
    """Every metric by its name in `Score`."""
    lag, gain = c.fit or (None, None)
    return {
        "rmse_n": math.sqrt(float(np.mean(c.error**2))),
        "bias_n": float(np.mean(c.error)),
        "max_error_n": float(c.error[np.argmax(np.abs(c.error))]),
        "lag_s": lag,
        "gain": gain,
        "response_s": response(c),
        "ripple_n": ripple(c),
    }


def compare(
    record: AxleRecord, estimate: Floats, target: Floats, applications: Iterable[slice]
) -> EstimateAndTarget | None:
    """Estimate [N] and target [N], shape (n,), in the applications; None without a sample."""
    masks = ((s, np.isfinite(estimate[s]) & np.isfinite(target[s])) for s in applications)
    pairs = [(s, finite) for s, finite in masks if finite.any()]
    if not pairs:
        return None
    return EstimateAndTarget(
        tuple((record.t[s] - record.t[s.start])[finite] * 1e-9 for s, finite in pairs),
        tuple(estimate[s][finite] for s, finite in pairs),
        tuple(target[s][finite] for s, finite in pairs),
    )


def choose_target(
    record: AxleRecord, reference: Reference, applications: Iterable[slice]
) -> tuple[Literal["truth", "reference"], Floats, tuple[slice, ...]]:
    """What an estimate is judged against (n,) [N], and in which parts: not while it starts."""
    applications = tuple(applications)
    start_ups = brake_applications.find_start_ups(record, applications)
    later_start = {s.start: s.stop for s in start_ups}
    applications = tuple(slice(later_start.get(s.start, s.start), s.stop) for s in applications)
    applications = tuple(s for s in applications if s.start < s.stop)
    if record.truth is not None and any(np.isfinite(record.truth[s]).any() for s in applications):
        return "truth", record.truth, applications
    return "reference", reference.force, applications


def score_estimates(
    record: AxleRecord,
    reference: Reference,
    estimates: Mapping[str, Floats],
    applications: Iterable[slice],
    sigmas: Mapping[str, Floats] | None = None,
) -> tuple[Score, ...]:
    """Every estimate of one axle against the truth where the record has it, else the reference.

    Estimates and their standard uncertainties, where they have one, are by algorithm [N], (n,).
    What `find_start_ups` finds in the brake applications is not used.
    """
    against, target, applications = choose_target(record, reference, applications)
    scores = []
    for algo, estimate in estimates.items():
        c = compare(record, estimate, target, applications)
        noise = reference.sigma if against == "reference" else np.zeros(len(target))
        blocks = _blocks(record, estimate - target, noise, applications)
        sigma = (sigmas or {}).get(algo)
        values: dict[str, Any] = dict(measure(c)) if c else {}
        if c and sigma is not None:
            values |= _band_metrics(estimate - target, sigma, applications)
        scores.append(Score(algo, against, **values, blocks=blocks))
    return rank(scores)


def _blocks(
    record: AxleRecord, error: Floats, noise: Floats, applications: Sequence[slice]
) -> tuple[Floats, Floats]:
    """Of each stretch of `_BLOCK`: mean square error, and what the target's noise does to it.

    `error` is estimate less target, `noise` 1 sigma of the target, with errors that are alike
    within a stretch; both (n,) [N]. Errors count in the applications.
    """
    squares, doubts = [], []
    for s in applications:
        number = ((record.t[s] - record.t[s.start]) * 1e-9 / _BLOCK).astype(np.int64)
        finite = np.isfinite(error[s])
        count = np.maximum(np.bincount(number, finite), 1e-300)
        e = np.where(finite, error[s], 0.0)
        squares.append(np.bincount(number, e**2) / count)
        doubts.append(np.bincount(number, 2.0 * np.abs(e) * np.nan_to_num(noise[s])) / count)
    return np.concatenate([[], *squares]), np.concatenate([[], *doubts])


def same_within_noise(score: Score, best: Score) -> bool | None:
    """Whether the noise of their target explains the difference of two rmse (95 %).

    None without an error, or where they are not of the same samples.
    """
    if score.blocks is None or best.blocks is None or None in (score.rmse_n, best.rmse_n):
        return None
    (a, da), (b, db) = score.blocks, best.blocks
    if len(a) != len(b):
        return None
    difference, doubt = float(np.sum(a - b)), float(np.linalg.norm(da + db))
    return abs(difference) <= Z95 * doubt


def _band_metrics(error: Floats, sigma: Floats, applications: Iterable[slice]) -> dict[str, float]:
    """Half-width of the estimate's own 95 % band, and how often it holds the target."""
    indices = np.r_[tuple(applications)]
    indices = indices[np.isfinite(error[indices])]
    half_width = Z95 * sigma[indices]
    return {
        "band_n": float(np.median(half_width)),
        "within": float(np.mean(np.abs(error[indices]) <= half_width)),
    }


def rank(scores: Iterable[Score]) -> tuple[Score, ...]:
    """The scores, least rmse first and those without one last, each with rmse over the least."""
    order = sorted(scores, key=lambda s: math.inf if s.rmse_n is None else s.rmse_n)
    best = order[0].rmse_n if order else None
    ratios = [s.rmse_n / best if best and s.rmse_n is not None else None for s in order]
    pairs = zip(order, ratios, strict=True)
    return tuple(replace(s, relative=x, alike=same_within_noise(s, order[0])) for s, x in pairs)


def _mean(values: Sequence[float | None]) -> float | None:
    values_there = [x for x in values if x is not None]
    return float(np.mean(values_there)) if values_there else None


def pool_scores(groups: Iterable[Iterable[Score]]) -> tuple[Score, ...]:
    """Each algorithm over several axles, ranked: rms of its rmse, mean bias, largest error.

    Only axles on which it was scored count, those against truth and those against the reference
    apart. Metrics without a sound mean over axles stay None. One axle keeps its scores.
    """
    of_axles = [tuple(group) for group in groups]
    if len(of_axles) == 1:
        return of_axles[0]
    pooled_scores: list[Score] = []
    all_scores = [s for of_axle in of_axles for s in of_axle if s.rmse_n is not None]
    for against in dict.fromkeys(s.against for s in all_scores):
        pooled = []
        for algo in dict.fromkeys(s.algo for s in all_scores if s.against == against):
            algo_scores = [s for s in all_scores if (s.algo, s.against) == (algo, against)]
            errors_of = [(s.rmse_n, s.bias_n, s.max_error_n) for s in algo_scores]
            rmse, bias, worst = np.array(errors_of).T
            rms, largest = float(np.sqrt(np.mean(rmse**2))), float(worst[np.argmax(np.abs(worst))])
            band = _mean([s.band_n for s in algo_scores])
            mean_within = _mean([s.within for s in algo_scores])
            blocks_there = [s.blocks for s in algo_scores if s.blocks is not None]
            joined = (np.concatenate(x) for x in zip(*blocks_there, strict=True))
            blocks = (next(joined), next(joined)) if len(blocks_there) == len(algo_scores) else None
            errors = rms, float(np.mean(bias)), largest
            score = Score(algo, against, *errors, band_n=band, within=mean_within, blocks=blocks)
            pooled.append(score)
        pooled_scores += rank(pooled)
    return tuple(pooled_scores)
