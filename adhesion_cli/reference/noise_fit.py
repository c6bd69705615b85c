"""The noise of measured samples, fitted, and what a smoother makes of it."""

import math

import numpy as np
from numpy.typing import NDArray

from ..core.model import AxleRecord, Floats
from ..core.signals import running_integral, white_noise
from . import smoother
from .smoother import MeasurementNoise, Prior, Regimes, Runs, UnbrokenRun

_FITTED_SAMPLES = 20_000  # samples that the noise levels are fitted to
_BLOCK = 2_000  # consecutive samples fitted together
FLOOR = 1e-12  # least variance of the speed's noise [rad²/s²]
NO_BRAKING = 100.0  # clamping force below which there is no braking [N]
Slack = tuple[float, ...]  # of coupling and regimes [nats], see `smoother.Prior`
SLACK: Slack = (0.5, 0.5)  # of coupling and rolling
_SLOWEST = 0.2  # longest interval at which slides are looked for [s]
_CLEAR_NATS = 15.0  # nats by which slides must be more likely
_NATS = 3.0  # of a likelihood without correlated errors that count as one
NEVER, LIKELY = 1e-3, 0.8  # probabilities below which, and above which, a case is taken as sure
# Rates of switching from row to column [1/s]: rolling, sliding, changing, leaping.
_RATES = np.array(
    [
        [0.0, 0.02, 0.05, 0.001],
        [0.02, 0.0, 1.0, 0.03],
        [10.0, 10.0, 0.0, 0.03],
        [10.0, 10.0, 0.0, 0.0],
    ]
)
_FOLLOW = np.array([0.0, 1.0, 1.0, 1.0])  # of these for a wheel, see `smoother.Regimes`
_START_PROBABILITIES = np.array([0.9, 0.05, 0.05, 0.001])
_FITTED = 3  # regimes whose roughness is fitted
# 1 sigma of the prior of noise, coupling, and each roughness but that of leaps.
_DECADES = (2.0, 1.0, 2.0, 1.5, 0.7)
_SLIDE_SLICE = 0.25  # longer than a period of vibration, shorter than most slides [s]
_SLICE = 0.05  # half a period of vibration of 10 Hz [s]
_FEWEST_SLICES = 40  # that show how much their means vary
_MEDIAN_SQUARE = 0.4549  # median of the square of a standard normal value
_JERK = 8.0  # more than the median of any motion [rad/s³]
_CLEARLY = 1.6  # times white noise; below that its fit still finds the force
_BLOCK_TIME = 0.5  # of a spectrum [s]
_FEWEST_BLOCKS = 8  # whose mean is a spectrum
_VIBRATION = 4.0, 20.0  # band of a wheelset's vibration [Hz]
_PEAK = 2.5  # times white noise: the highest of ten bins of a mean of eight blocks is 2 by chance
ValueAndSigma = tuple[Floats, Floats]  # a column and its 1 sigma, shape (n,)


def rate_of_change(
    all_samples: UnbrokenRun, run: UnbrokenRun, regimes: Regimes, noise: MeasurementNoise
) -> ValueAndSigma:
    """ω̇ and its 1 sigma at the times of `all_samples`, estimated from `run`; shape (n,)."""
    x = smoother.smooth(run, regimes, noise)
    if run.t is all_samples.t:
        return x.rate, x.rate_sigma
    missed = line_error(all_samples.t, run.t, x.rate)
    rate: Floats = all_samples.u + np.interp(all_samples.t, run.t, x.rate)
    return rate, np.hypot(np.interp(all_samples.t, run.t, x.rate_sigma), missed)


def probability_of_means(
    instants: Runs, means: Runs, noise: MeasurementNoise, regimes: Regimes, prior: MeasurementNoise
) -> tuple[float, MeasurementNoise]:
    """Probability that readings are means since the one before, and the noise levels for that.

    The effect of K on ω̇ shows it: at once, or half an interval later.
    """
    instant_sample, mean_sample = take_samples(instants), take_samples(means)
    instant_likelihood = smoother.likelihood(instant_sample, regimes, noise)
    if smoother.likelihood(mean_sample, regimes, noise) < instant_likelihood - _CLEAR_NATS:
        return 0.0, noise
    noise = fit_again(mean_sample, regimes, prior, SLACK, noise)
    gain = smoother.likelihood(mean_sample, regimes, noise) - instant_likelihood
    return 1.0 / (1.0 + math.exp(min(-gain / _NATS, 700.0))), noise


def mix_estimates(
    instant_estimate: ValueAndSigma, mean_estimate: ValueAndSigma, share: float
) -> ValueAndSigma:
    """The first one, or the other if that is clearly more likely; 1 sigma contains both."""
    chosen = mean_estimate[0] if share > LIKELY else instant_estimate[0]
    variances = [sigma**2 + (x - chosen) ** 2 for x, sigma in (instant_estimate, mean_estimate)]
    return chosen, np.sqrt((1.0 - share) * variances[0] + share * variances[1])


def largest_bend(x: Floats) -> Floats:
    """The larger second difference at i − 1 and i, shape (n,)."""
    bend = np.abs(np.diff(x, 2, prepend=x[0], append=x[-1])) if len(x) else x
    larger: Floats = np.maximum(bend, np.concatenate([bend[:1], bend[:-1]]))
    return larger


def fit_regimes(
    runs: Runs, interval: float, scale: float, prior: MeasurementNoise, slack: Slack
) -> tuple[MeasurementNoise, Regimes]:
    """Noise levels for a wheel that only rolls, or also slides if that is clearly more likely.

    A slow log only rolls: a slide of a few samples cannot be recognised.

    A wheel that slides may also leap: as it grips again, the force changes by all of φK within
    0.1 s. A log has few leaps. A fit takes them for noise, so their roughness is that of the prior.
    """
    sample = take_samples(runs)
    rolling, sliding, leaping = (switching_regimes(_FOLLOW[:n], scale + 1.0) for n in (1, 3, 4))
    rolling_noise, rolling_value = smoother.fit(sample, rolling, _prior(1, prior, slack))
    if interval > _SLOWEST:
        return rolling_noise, rolling
    sliding_noise, sliding_value = smoother.fit(sample, sliding, _prior(3, prior, slack))
    if sliding_value - rolling_value <= _CLEAR_NATS:
        return rolling_noise, rolling
    return sliding_noise._replace(rough=np.append(sliding_noise.rough, prior.rough[3])), leaping


def switching_regimes(follow: Floats, spread: float) -> Regimes:
    """Rolling, sliding, changing and, where `follow` has a fourth, leaping.

    Arguments as of `smoother.Regimes`.
    """
    count, start = len(follow), _START_PROBABILITIES[: len(follow)]
    return Regimes(follow, _RATES[:count, :count].copy(), start / start.sum(), spread)


def fit_again(
    runs: Runs, regimes: Regimes, prior: MeasurementNoise, slack: Slack, start: MeasurementNoise
) -> MeasurementNoise:
    """Noise levels of runs that changed a little since `start` was fitted.

    The fit is without leaps: it would take a leap for noise.
    """
    count = min(len(regimes.start), _FITTED)
    fitted = switching_regimes(_FOLLOW[:count], regimes.spread)
    start = start._replace(rough=start.rough[:count])
    sample, levels = take_samples(runs), _prior(count, prior, slack)
    noise, _ = smoother.fit(sample, fitted, levels, start)
    return noise._replace(rough=np.append(noise.rough, prior.rough[count : len(regimes.start)]))


def _prior(count: int, prior: MeasurementNoise, slack: Slack) -> Prior:
    guess = prior._replace(rough=prior.rough[:count])
    return Prior(guess, _DECADES[: 2 + count], FLOOR, slack)


def line_error(t: Floats, knots: Floats, x: Floats) -> Floats:
    """Possible error at the times t of straight lines between x at `knots`, shape (n,)."""
    right = np.clip(np.searchsorted(knots, t), 1, len(knots) - 1)
    fraction = (t - knots[right - 1]) / (knots[right] - knots[right - 1])
    return largest_bend(x)[right] * fraction * (1.0 - fraction)


def common_noise(run: UnbrokenRun, steps: Floats) -> float:
    """Variance to add to that of white noise, where neighbouring readings have common errors.

    Vibration and run-out move the means of slices of time more than white noise does. A fit of
    white noise then takes them for force. For a smoother slower than a slice, they are white noise
    whose means vary as much. A wheel that is not braked shows them best, for it has no force. Where
    it is always braked, only means count that move more than the force moves them. Vibration in a
    narrow band can leave these means alone: there the peak of the spectrum without brake counts.
    The variance is 0 where neither is clearly above white noise. A quantisation step bounds its
    errors, which are not counted.
    """
    z = run.y - running_integral(run.t, run.u)
    starts, sizes = _slices(run.t, _SLICE)
    size = float(np.median(sizes))
    if len(starts) < _FEWEST_SLICES or size < 2.0:
        return 0.0
    bends = np.abs(np.diff(np.add.reduceat(z, starts) / sizes, 2))
    rests = np.logical_and.reduceat(run.u == 0.0, starts)
    rests = rests[2:] & rests[1:-1] & rests[:-2]
    samples = np.full(len(z), True)
    if rests.sum() >= _FEWEST_SLICES:
        bends, samples = bends[rests], run.u == 0.0
    bend = float(np.median(bends))
    if samples.all() and bend < _JERK * _SLICE**2:
        return 0.0
    variance = bend**2 / _MEDIAN_SQUARE / 6.0  # of a mean
    rounding = float(np.mean(steps[samples] ** 2)) / 12.0
    slow = size * (variance - rounding)
    white = white_noise([(run.t[samples], z[samples])])
    if slow > _CLEARLY * white:
        return slow - white
    peak = _spectral_peak(run) - rounding
    return peak - white if peak > _PEAK * white else 0.0


def _slices(t: Floats, duration: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First sample and number of samples of each slice of so many seconds; (k,) each."""
    starts = np.flatnonzero(np.diff(np.floor(t / duration), prepend=-1.0))
    return starts, np.diff(starts, append=len(t))


def _spectral_peak(run: UnbrokenRun) -> float:
    """Variance of the white noise as strong as the strongest vibration of a wheel without brake.

    The spectrum is that of Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70, of blocks that
    overlap by a half, each without its straight line. It is 0 where there are too few blocks.
    """
    interval = float(np.median(np.diff(run.t)))
    size = round(_BLOCK_TIME / interval)
    rests = run.u == 0.0
    starts = range(0, len(rests) - size + 1, size // 2)
    blocks = [run.y[i : i + size] for i in starts if rests[i : i + size].all()]
    if len(blocks) < _FEWEST_BLOCKS:
        return 0.0
    y, n, window = np.array(blocks), np.arange(size) - (size - 1) / 2.0, np.hanning(size)
    y = y - y.mean(axis=1, keepdims=True) - np.outer(y @ n / (n @ n), n)
    power = np.mean(np.abs(np.fft.rfft(y * window)) ** 2, axis=0) / (window @ window)
    frequency = np.fft.rfftfreq(size, interval)
    return float(power[(frequency >= _VIBRATION[0]) & (frequency <= _VIBRATION[1])].max())


def seconds_of(run: AxleRecord) -> Floats:
    """Times since the first sample [s], shape (n,)."""
    since: Floats = (run.t - run.t[0]) * 1e-9
    return since


def median_step(runs: Runs) -> float:
    """Median interval [s]."""
    return float(np.median(np.concatenate([np.diff(r.t) for r in runs])))


def take_samples(runs: Runs) -> Runs:
    """The runs, or blocks of a long log for the fit: half spread evenly, half the roughest.

    Slides are rare, and noise levels fitted without them would be wrong for them.
    """
    if sum(len(r.t) for r in runs) <= _FITTED_SAMPLES:
        return runs
    starts = [(r, i) for r in runs for i in range(0, len(r.t), _BLOCK)]
    blocks = [UnbrokenRun(*(x[i : i + _BLOCK] for x in r)) for r, i in starts]
    count = min(_FITTED_SAMPLES // _BLOCK // 2, len(blocks))
    means = []
    for b in blocks:
        begins, sizes = _slices(b.t, _SLIDE_SLICE)  # vibration has no part in its changes of slope
        means.append(np.add.reduceat(b.y, begins) / sizes)
    roughness = [float(np.sum(np.diff(x, 2) ** 2)) for x in means]
    roughest = np.argsort([-x for x in roughness], kind="stable")[:count]
    spread = np.linspace(0, len(blocks) - 1, count).astype(int)
    return [blocks[i] for i in sorted({*roughest, *spread})]
