"""Offline reference of the adhesion force, F = φK + ω̇/a, with its uncertainty.

It is neither causal nor the truth. `sigma` is its uncertainty by noise and smoothing; the 95 % band
also contains the vehicle's tolerances. Where the wheel stands there is no reference: friction can
then be anything up to φK.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..core import innovations
from ..core.errors import unknown
from ..core.model import AxleRecord, Bools, Floats, Reference, Vehicle, Wheelset
from ..core.physics import rolling_deceleration, wheelset
from ..core.signals import driven, moving, true_runs, white_noise
from . import run_out, smoother

_SHORTEST = 8  # least samples of a run: fewer do not show their noise
_FITTED_SAMPLES = 20_000  # samples that the noise levels are fitted to
_BLOCK = 2_000  # consecutive samples fitted together
_PULSES = 24.0  # of a counter that give a speed to a few percent
_COUNT_NOISE = 0.18  # noise of its counts in pulses²; 0.28 where all phases occur, rounding 0.08
_SHORT_TIME = 0.1  # a slide hardly changes within [s]
_KNOTS = 6  # samples of a run of equal speeds that are used
_DITHER = 2  # samples that a level of dither lasts; longer, and its errors are not independent
_SHORTEST_ZERO = 10  # fewer samples of K = 0 in a row are noise around the spring's force
_FLOOR = 1e-12  # least variance of the speed's noise [rad²/s²]
_NO_BRAKING = 100.0  # clamping force below which there is no braking [N]
_SLACK: tuple[float, ...] = (0.5, 0.5)  # slack of coupling and rolling [nats], see `smoother.Prior`
_COUNTER_SLACK: tuple[float, ...] = (2.0, 2.0, 4.5)  # the same, and of sliding, for a pulse counter
_SLOWEST = 0.2  # longest interval at which slides are looked for [s]
_CLEAR_NATS = 15.0  # nats by which slides must be more likely
_NATS = 3.0  # of a likelihood without correlated errors that count as one
_RATE_SHARE = 0.75  # pressure samples per speed sample from which its rate counts as equal
_NEVER, _LIKELY = 1e-3, 0.8  # probabilities below which, and above which, a case is taken as sure
_SWITCHING_RATES = np.array(
    [[0.0, 0.02, 0.05], [0.02, 0.0, 1.0], [10.0, 10.0, 0.0]]
)  # regimes [1/s]
_CUTOFF = 2.0  # of the Butterworth filter, −3 dB of one pass [Hz]
_START_PROBABILITIES = np.array([0.9, 0.05, 0.05])
_DECADES = (2.0, 1.0, 2.0, 1.5, 0.7)  # 1 sigma of the prior of noise, coupling, each roughness
_SHARE = 1e-3  # square of the share of φK's rise that rolling does not explain, to a factor of 10


_Estimate = tuple[Floats, Floats]  # a column and its 1 sigma, shape (n,)


class _Clamping(NamedTuple):
    """The clamping force without its noise; columns of shape (n,)."""

    K: Floats  # [N]
    sigma: Floats  # 1 sigma at its own samples, a line between them [N]
    missed: Floats  # 1 sigma of what lines between its samples may miss [N]
    measured: Bools  # the samples of the speed that are nearest to its own


class RunEstimate(NamedTuple):
    """The result of a method for one run of a moving wheel; columns of shape (n,)."""

    clamping_force: Floats  # K [N], with less noise
    acceleration: Floats  # ω̇ [rad/s²]
    sigma: Floats  # 1 sigma of φK + ω̇/a from noise alone [N]
    averaged: float = 0.0  # probability that a speed is the mean since the last one
    squares: Floats | None = None  # normalised innovations squared, where the filter has a sample


class ReferenceMethod(NamedTuple):
    """A way to compute the reference."""

    source: str
    # Takes the runs, the run-out in the wheel speed of each, and the wheelset's constants.
    estimate: Callable[[list[AxleRecord], list[Floats], Wheelset], list[RunEstimate]]


def compute(record: AxleRecord, vehicle: Vehicle, method: str = "smoother") -> Reference:
    """Reference adhesion force over all segments, each on its own.

    They are NaN in a segment of too few samples, where the wheel stands, and where a motor drives
    it. The run-out of a tone ring is removed first. If the pressure is delayed, sigma contains the
    error of K.

    Args:
        record: one axle's record, `faded`.
        vehicle: its values give F, its tolerances the band.
        method: a name from `METHODS`.

    Raises:
        UserError: the method is not known.
    """
    if method not in METHODS:
        raise unknown("reference", method, list(METHODS))
    w = wheelset(vehicle, record.axle)
    slices = [s for s in moving(record) if s.stop - s.start >= _SHORTEST]
    runs = [record.extract(s) for s in slices]
    ripples = [run_out.find_run_out(_seconds(r), r.wheel_speed) for r in runs]
    delay = record.pressure_late.value
    force, sigma, tolerance, mass = (np.full(len(record), np.nan) for _ in range(4))
    estimates = METHODS[method].estimate(runs, [ripple for ripple, _ in ripples], w)
    for s, estimate in zip(slices, estimates, strict=True):
        force[s] = w.phi * estimate.clamping_force + estimate.acceleration / w.a  # (1)
        sigma[s] = estimate.sigma
        tolerance[s], mass[s] = _tolerance(record.extract(s), vehicle, estimate)
        if delay:
            t = (record.t[s] - record.t[s.start]) * 1e-9
            delay_error = np.interp(t + delay, t, estimate.clamping_force) - estimate.clamping_force
            sigma[s] = np.hypot(sigma[s], w.phi * delay_error)
    unknown_torque = driven(record, vehicle.radius(record.axle).value)
    for column in (force, sigma, tolerance, mass):
        column[unknown_torque] = np.nan
    largest = max((share for _, share in ripples), default=0.0)
    averaged = estimates[0].averaged if estimates else 0.0
    pulses = _pulses(max(runs, key=len)) if runs else math.inf
    squares = [estimate.squares for estimate in estimates if estimate.squares is not None]
    nis = innovations.mean(np.concatenate(squares)) if squares else None
    source, saturated = METHODS[method].source, record.saturated
    return Reference(
        method, source, force, sigma, tolerance, saturated, largest, pulses, averaged, mass, nis
    )


def _tolerance(run: AxleRecord, vehicle: Vehicle, estimate: RunEstimate) -> tuple[Floats, Floats]:
    """1 sigma of the force from the vehicle's tolerances, and its covariance with ln m [N]."""
    speed = run.wheel_speed * vehicle.radius(run.axle).value
    variance, mass = by_tolerances(
        run, vehicle, estimate.clamping_force, estimate.acceleration, speed
    )
    return np.sqrt(np.maximum(variance, 0.0)), np.zeros(len(run)) + mass


class Measured(Protocol):
    """What says how an axle is measured: its record, or live its channels."""

    @property
    def axle(self) -> int:
        """Its number."""
        ...

    @property
    def of_rim(self) -> bool:
        """Whether the wheel speed was logged as ωR."""
        ...

    @property
    def pressure(self) -> object:
        """None where K itself was logged."""
        ...


def by_tolerances(
    record: Measured, vehicle: Vehicle, K: Floats, dw: Floats, speed: Floats
) -> tuple[Any, Any]:
    """Variance of the force [N²] by the vehicle's tolerances, and its covariance with ln m [N].

    Arguments as of `contributions`: arrays, or numbers for one sample.
    """
    by_name = contributions(record, vehicle, K, dw, speed)
    mass = {"axle_mass": vehicle.axle_mass.tolerance / vehicle.axle_mass.value}
    return vehicle.covariance(by_name, by_name), vehicle.covariance(by_name, mass)


def contributions(
    record: Measured, vehicle: Vehicle, K: Floats, dw: Floats, speed: Floats
) -> dict[str, Floats]:
    """By how much each parameter's tolerance moves F = φK + I ω̇/R, first order [N]; (n,) each.

    Every parameter varies on its own, at measured ω and p, or K if the log has K. A speed logged in
    m/s or km/h is ωR, and the reader has divided it by R: an error of R counts twice there.

    Args:
        record: what its sensors measure.
        vehicle: with tolerances.
        K: clamping force, with the friction's change over speed (n,) [N].
        dw: ω̇ (n,) [rad/s²].
        speed: ωR (n,) [m/s].
    """
    R, inertia, phi = vehicle.radius(record.axle), vehicle.wheelset_inertia, vehicle.friction
    fade, speed_difference = vehicle.friction_fade, speed - vehicle.friction_speed.value
    terms = {
        "friction": K * phi.tolerance,
        "friction_fade": phi.value
        * K
        * speed_difference
        / (1.0 + fade.value * speed_difference)
        * fade.tolerance,
        "wheelset_inertia": dw / R.value * inertia.tolerance,
        "wheel_radius": (-2.0 if record.of_rim else -1.0)
        * dw
        * inertia.value
        / R.value**2
        * R.tolerance,
    }
    if record.pressure is not None:
        names = ("discs", "efficiency", "lever_ratio", "radius_ratio")
        chain = {name: getattr(vehicle, name) for name in names}
        ratio = math.prod(x.value for x in chain.values())  # K over the piston's force    (15)
        piston = K + np.where(K > 0.0, ratio * vehicle.spring_force.value, 0.0)
        d = vehicle.cylinder_diameter
        terms |= {name: phi.value * K * x.tolerance / x.value for name, x in chain.items()}
        terms["cylinder_diameter"] = phi.value * piston * 2.0 * d.tolerance / d.value
        terms["spring_force"] = -phi.value * ratio * vehicle.spring_force.tolerance * (K > 0.0)
    return terms


# Smoother: rolling, sliding, changing


def _smoother(runs: list[AxleRecord], ripples: list[Floats], w: Wheelset) -> list[RunEstimate]:
    """Rauch, Tung and Striebel's smoother for a wheel that rolls or slides, with fitted noise.

    While the wheel rolls, the train's mass holds ω̇ and F follows φK at once:
    ω̇ = −aφK(1 − rolling) + δ with a slow δ. While it slides, adhesion is slow and ω̇ follows φK: δ
    takes up every change of aφK·rolling. In between F changes within milliseconds. The data decide
    which regime holds. A wrong φ, I or m only makes δ rougher. F is φK + ω̇/a of the estimated ω̇ in
    every regime.
    """
    if not runs:
        return []
    clamping = _clamping(runs)
    highest = max(float(c.K.max()) for c in clamping)
    scale = w.a * w.phi * max(highest, _NO_BRAKING)  # of δ, if all of φK went missing
    counts, step = _counts_together(max(runs, key=len)), runs[0].wheel_speed_step
    triples = zip(runs, ripples, clamping, strict=True)
    wheel = [_rolling_run(r, x, c.K, w) for r, x, c in triples]
    if counts:  # errors of successive counts are correlated; those of every second one are not
        informative = [
            _pulse_means(r, x, run, counts) for r, x, run in zip(runs, ripples, wheel, strict=True)
        ]
        fitted_to = [
            smoother.UnbrokenRun(*(column[::2].copy() for column in run)) for run in informative
        ]
        rounding, slack, white = step**2 / 6.0 / counts**2, _COUNTER_SLACK, fitted_to
    else:
        informative = fitted_to = [_informative_samples(run) for run in wheel]
        rounding = float(np.mean([np.mean(r.wheel_speed_steps**2) for r in runs])) / 12.0
        slack, white = _SLACK, wheel
    noise = max(white_noise((r.t, r.y) for r in white) - rounding, 1e-3 * rounding)
    prior = smoother.MeasurementNoise(
        noise, _SHARE * scale, scale**2 * np.array([1e-5, 1e-2, 10.0])
    )
    fitted, regimes = _fit_regimes(fitted_to, _step(wheel), scale, prior, slack)
    rates = [_rate(*pair, regimes, fitted) for pair in zip(wheel, informative, strict=True)]
    averaged, judged = 0.0, (fitted_to, fitted)
    if not counts and not runs[0].pressure_late.value:
        means = [_informative_samples(run, mean=True) for run in wheel]
        averaged, noise_of = 0.5, fitted
        if not _sparse(runs):
            averaged, noise_of = _probability_of_means(informative, means, fitted, regimes, prior)
        if averaged > _NEVER:
            mean_rates = [
                _rate(*pair, regimes, noise_of) for pair in zip(wheel, means, strict=True)
            ]
            rates = [_mixture(*pair, averaged) for pair in zip(rates, mean_rates, strict=True)]
        judged = (means, noise_of) if averaged > _LIKELY else judged
    squares = [smoother.innovations(run, regimes, judged[1]) ** 2 for run in judged[0]]
    rolls = len(regimes.start) == 1 and _sparse(runs)
    forces = [
        _between_samples(*pair, w) if rolls else _noise(*pair, w)
        for pair in zip(clamping, rates, strict=True)
    ]
    return [
        RunEstimate(K, rate, sigma, averaged, z2)
        for (K, sigma), (rate, _), z2 in zip(forces, rates, squares, strict=True)
    ]


def _noise(c: _Clamping, rate: _Estimate, w: Wheelset) -> _Estimate:
    """K, and 1 sigma of φK + ω̇/a [N]."""
    return c.K, np.hypot(rate[1] / w.a, w.phi * np.hypot(c.sigma, c.missed))


def _between_samples(c: _Clamping, rate: _Estimate, w: Wheelset) -> _Estimate:
    """The same for a wheel that only rolls, and a K that is measured less often than the speed.

    There ω̇ shows K between its samples: F and ω̇ follow it at once. So ω̇ departs from what straight
    lines of K explain by −a(1 − rolling)φ times the error of K. How far K may be off the line
    bounds it, so a slow δ stays one.
    """
    rate_per_force, n, measured_index = (
        w.a * (1.0 - w.rolling),
        np.arange(len(c.K)),
        np.flatnonzero(c.measured),
    )
    departure = rate[0] + rate_per_force * w.phi * c.K
    departure = departure - np.interp(n, measured_index, departure[measured_index])
    variance_here, variance_there = (
        rate[1] ** 2,
        np.interp(n, measured_index, rate[1][measured_index] ** 2),
    )
    missed = (w.phi * c.missed) ** 2
    gain = missed / np.maximum(
        missed + (variance_here + variance_there) / rate_per_force**2, _FLOOR
    )
    K = c.K - gain * departure / rate_per_force / w.phi
    rate_gain = gain / (1.0 - w.rolling)
    variance = (1.0 - gain) ** 2 * missed + (
        (rate_gain - 1.0) ** 2 * variance_here + rate_gain**2 * variance_there
    ) / w.a**2
    return K, np.sqrt(variance + (w.phi * c.sigma) ** 2)


def _rate(
    all_samples: smoother.UnbrokenRun,
    run: smoother.UnbrokenRun,
    regimes: smoother.Regimes,
    noise: smoother.MeasurementNoise,
) -> _Estimate:
    """ω̇ and its 1 sigma at the times of `all_samples`, estimated from `run`; shape (n,)."""
    x = smoother.smooth(run, regimes, noise)
    if run.t is all_samples.t:
        return x.rate, x.rate_sigma
    missed = _line_error(all_samples.t, run.t, x.rate)
    rate: Floats = all_samples.u + np.interp(all_samples.t, run.t, x.rate)
    return rate, np.hypot(np.interp(all_samples.t, run.t, x.rate_sigma), missed)


def _sparse(runs: list[AxleRecord]) -> bool:
    """Whether K is measured less often than the speed.

    Then the error of straight lines between its samples looks like half an interval of the speed.
    """
    measured, interpolated = (
        sum(int(np.count_nonzero(np.diff(column))) for column in columns)
        for columns in zip(
            *((r.clamping_force, r.clamping_force_smooth) for r in runs), strict=True
        )
    )
    return measured < _RATE_SHARE * interpolated


def _probability_of_means(
    instants: list[smoother.UnbrokenRun],
    means: list[smoother.UnbrokenRun],
    noise: smoother.MeasurementNoise,
    regimes: smoother.Regimes,
    prior: smoother.MeasurementNoise,
) -> tuple[float, smoother.MeasurementNoise]:
    """Probability that readings are means since the one before, and the noise levels for that.

    The effect of K on ω̇ shows it: at once, or half an interval later.
    """
    instant_sample, mean_sample = _sample(instants), _sample(means)
    instant_likelihood = smoother.likelihood(instant_sample, regimes, noise)
    if smoother.likelihood(mean_sample, regimes, noise) < instant_likelihood - _CLEAR_NATS:
        return 0.0, noise
    noise, _ = _fit(mean_sample, regimes, prior, _SLACK, noise)
    gain = smoother.likelihood(mean_sample, regimes, noise) - instant_likelihood
    return 1.0 / (1.0 + math.exp(min(-gain / _NATS, 700.0))), noise


def _mixture(instant_estimate: _Estimate, mean_estimate: _Estimate, share: float) -> _Estimate:
    """The first one, or the other if that is clearly more likely; 1 sigma contains both."""
    chosen = mean_estimate[0] if share > _LIKELY else instant_estimate[0]
    variances = [sigma**2 + (x - chosen) ** 2 for x, sigma in (instant_estimate, mean_estimate)]
    return chosen, np.sqrt((1.0 - share) * variances[0] + share * variances[1])


def _rolling_run(run: AxleRecord, ripple: Floats, K: Floats, w: Wheelset) -> smoother.UnbrokenRun:
    """The run as a rolling wheel: ω̇ known from K except δ."""
    t = _seconds(run)
    u = -rolling_deceleration(w) * K
    input_variance = np.diff(t, prepend=0.0) * _bend(u) / 8.0  # as by a kink in u half way
    y, own_variance = _remove_steps(t, run.wheel_speed, run.wheel_speed_steps)
    s = w.a * w.phi * w.rolling * K
    return smoother.UnbrokenRun(
        t, y - ripple, u, s, input_variance**2, own_variance, np.zeros(len(t))
    )


def _counts_together(run: AxleRecord) -> int:
    """How many samples of a pulse counter to take together; 0 for another sensor.

    Together they have `_PULSES`, but they are no longer than `_SHORT_TIME`.
    """
    y, step, t = run.wheel_speed, run.wheel_speed_step, _seconds(run)
    if step == 0.0 or len(y) < 100:
        return 0
    if not (run.of_totals or _dithers(t, y / step)):
        return 0
    interval = float(np.median(np.diff(t)))
    m = min(_PULSES * step / max(float(np.median(y)), step), _SHORT_TIME / interval)
    return max(round(m), 1)


def _dithers(t: Floats, y: Floats) -> bool:
    """Whether whole numbers y change from sample to sample as counts of pulses do.

    Counters lose no pulse: sums over four samples vary no more than one sample does. Sums of
    rounded noise vary four times as much. A rounded ramp looks similar, but its error is half a
    step only, while a count has errors at both ends. Only parts where y changes are judged.
    """
    noise_pairs = []
    for start in np.linspace(0, len(y) - 100, min(len(y) // 50, 100)).astype(int):
        window_t, window = t[start : start + 100], y[start : start + 100]
        single_noise = np.mean(
            [white_noise([(window_t[i : i + 50], window[i : i + 50])]) for i in (0, 50)]
        )
        if single_noise >= 1.0 / 24.0:
            sums = np.convolve(window, np.ones(4), "valid")
            sum_noise = np.mean([white_noise([(window_t[i:-3:4], sums[i::4])]) for i in range(4)])
            noise_pairs.append((single_noise, sum_noise / single_noise))
    if len(noise_pairs) < 2:
        return False
    single_noise, ratio = np.median(noise_pairs, axis=0)
    return bool(single_noise >= _COUNT_NOISE and ratio <= 2.0)


def _pulses(run: AxleRecord) -> float:
    """Mean pulses of a counter in `_SHORT_TIME`; inf for at least `_PULSES`, or no counter.

    A speed below its step is a counter's.
    """
    step, mean = run.wheel_speed_step, float(np.mean(run.wheel_speed))
    if step == 0.0:
        return math.inf
    pulses = mean / step * _SHORT_TIME / float(np.median(np.diff(_seconds(run))))
    return pulses if pulses < _PULSES and (mean < step or _counts_together(run) > 0) else math.inf


def _pulse_means(
    run: AxleRecord, ripple: Floats, rolling: smoother.UnbrokenRun, m: int
) -> smoother.UnbrokenRun:
    """A counter's run in means over m samples, at their middle, of the level without ∫u.

    The only error is the rounding at both ends of a mean. A sample counts the interval before it,
    or, if the log has totals, the interval about it.
    """
    m = min(m, len(run) // 4)
    n, t = len(run) // m * m, rolling.t
    interval = float(np.median(np.diff(t)))
    stop = t + interval / 2.0 if run.of_totals else t
    start = np.maximum(np.concatenate([stop[:1], stop[:-1]]), stop - 1.5 * interval)
    start[0] = stop[0] - interval
    gained = [np.interp(x, t, _integral(t, rolling.u)) for x in (start, stop)]
    y = np.mean((run.wheel_speed - ripple - np.mean(gained, axis=0))[:n].reshape(-1, m), axis=1)
    start, stop = start[:n:m], stop[m - 1 : n : m]
    middle = (start + stop) / 2.0
    input_variance = np.diff(np.interp(middle, t, np.cumsum(rolling.input_variance)), prepend=0.0)
    own_variance = np.full(len(y), run.wheel_speed_step**2 / 6.0 / m**2)
    s = np.interp(middle, t, rolling.s)
    return smoother.UnbrokenRun(
        middle, y, np.zeros(len(y)), s, input_variance, own_variance, stop - start
    )


def _integral(t: Floats, u: Floats) -> Floats:
    """∫u from the first sample on, shape (n,)."""
    mean = (u + np.concatenate([u[:1], u[:-1]])) / 2.0
    gained: Floats = np.cumsum(np.diff(t, prepend=t[0]) * mean)
    return gained


def _remove_steps(t: Floats, y: Floats, step: Floats) -> tuple[Floats, Floats]:
    """A signal rounded to these steps (n,), and its variance (n,); inf: a repeated sample.

    Rounding errors are independent only if the signal moves a step per sample. If it stays on a
    level for several, it is known best at the change to the next: half way, to within its movement
    in one interval. The run of equal values then counts as one sample. Where two levels alternate
    from sample to sample the errors are independent again: noise, or a pulse counter. A counter
    that measures the period of pulses has varying steps, and repeats its last value until the next
    pulse.
    """
    n, variance = len(y), step**2 / 12.0
    run_start = np.flatnonzero(np.diff(y, prepend=np.nan) != 0.0)  # of each run of equal values
    if len(run_start) == n or not step.any():
        return y, variance
    length = np.diff(run_start, append=n)
    jump = np.diff(y[run_start])
    returns = np.zeros(len(run_start) + 2, dtype=bool)  # runs that end where they came from
    returns[2:-2] = jump[1:] * jump[:-1] < 0.0
    dither = np.repeat(returns[1:-1] & (returns[:-2] | returns[2:]) & (length <= _DITHER), length)

    run_length, count = np.repeat(length, length), np.repeat(np.minimum(length, _KNOTS), length)
    knot = (
        (np.arange(n) - np.repeat(run_start, length)) * (count - 1) // np.maximum(run_length - 1, 1)
    )
    is_knot = np.diff(knot, prepend=-1) != 0
    is_knot[run_start] = True
    level, own_variance = y.copy(), np.where(is_knot, count * variance, np.inf)

    large_jump = np.abs(np.concatenate([[0.0], jump, [0.0]])) >= 1.5 * step[[*run_start, -1]]
    change, lasts = run_start[1:], np.diff(t[run_start], append=t[-1])
    slow = (np.minimum(length[1:], length[:-1]) > 1) & (np.abs(jump) < 1.5 * step[change])
    own_variance[change[~slow]], own_variance[change[~slow] - 1] = (
        variance[change[~slow]],
        variance[change[~slow] - 1],
    )
    change, jump, lasts = change[slow], jump[slow], np.minimum(lasts[1:], lasts[:-1])[slow]
    share = np.minimum((t[change] - t[change - 1]) / lasts, 1.0)  # of a step in one interval
    level[change] -= 0.5 * jump * (1.0 - share)
    own_variance[change] = variance[change] * share**2
    if np.ptp(step) > 0.0:
        waits = (length > 1) & (large_jump[1:] | large_jump[:-1])
        own_variance[np.repeat(waits, length)] = np.inf
        own_variance[run_start[waits]] = variance[run_start[waits]]
    return np.where(dither, y, level), np.where(dither, variance, own_variance)


def _informative_samples(run: smoother.UnbrokenRun, mean: bool = False) -> smoother.UnbrokenRun:
    """The informative samples, of the level without ∫u; the run itself if all are.

    A step of the smoother without a measurement would only blur its regimes. With `mean`, each
    sample is the mean since the one before.
    """
    t, informative = run.t, np.isfinite(run.own_variance)
    if informative.all() and not mean:
        return run
    h = np.diff(t, prepend=t[0] - np.median(np.diff(t))) * mean
    start = t - np.minimum(h, 1.5 * np.median(h))
    gained = np.mean([np.interp(x, t, _integral(t, run.u)) for x in (start, t)], axis=0)
    middle = (start + t) / 2.0
    input_variance = np.interp(middle, t, np.cumsum(run.input_variance))[informative]
    return smoother.UnbrokenRun(
        middle[informative],
        (run.y - gained)[informative],
        np.zeros(np.sum(informative)),
        np.interp(middle, t, run.s)[informative],
        np.diff(input_variance, prepend=0.0),
        run.own_variance[informative],
        (t - start)[informative],
    )


def _bend(x: Floats) -> Floats:
    """The larger second difference at i − 1 and i, shape (n,)."""
    bend = np.abs(np.diff(x, 2, prepend=x[0], append=x[-1])) if len(x) else x
    larger: Floats = np.maximum(bend, np.concatenate([bend[:1], bend[:-1]]))
    return larger


def _fit_regimes(
    runs: list[smoother.UnbrokenRun],
    interval: float,
    scale: float,
    prior: smoother.MeasurementNoise,
    slack: tuple[float, ...],
) -> tuple[smoother.MeasurementNoise, smoother.Regimes]:
    """Noise levels for a wheel that only rolls, or also slides if that is clearly more likely.

    A slow log only rolls: a slide of a few samples cannot be recognised.
    """
    sample = _sample(runs)
    rolling_only = smoother.Regimes(np.zeros(1), np.zeros((1, 1)), np.ones(1), scale + 1.0)
    rolling_noise, rolling_value = _fit(sample, rolling_only, prior, slack)
    if interval > _SLOWEST:
        return rolling_noise, rolling_only
    switching = smoother.Regimes(
        np.array([0.0, 1.0, 1.0]), _SWITCHING_RATES, _START_PROBABILITIES, scale + 1.0
    )
    switching_noise, switching_value = _fit(sample, switching, prior, slack)
    return (
        (switching_noise, switching)
        if switching_value - rolling_value > _CLEAR_NATS
        else (rolling_noise, rolling_only)
    )


def _fit(
    runs: list[smoother.UnbrokenRun],
    regimes: smoother.Regimes,
    prior: smoother.MeasurementNoise,
    slack: tuple[float, ...],
    start_noise: smoother.MeasurementNoise | None = None,
) -> tuple[smoother.MeasurementNoise, float]:
    """Noise levels of these regimes, the first of the prior, and their log posterior."""
    M = len(regimes.start)
    guess = prior._replace(rough=prior.rough[:M])
    return smoother.fit(
        runs, regimes, smoother.Prior(guess, _DECADES[: 2 + M], _FLOOR, slack), start_noise
    )


def _clamping(runs: list[AxleRecord]) -> list[_Clamping]:
    """K without its noise: constant, moving, or stepping (then as measured).

    K = 0 is a bound of (15), not a measurement with noise: there it is exact.
    """
    pieces = [[_piece(r, s) for s in _braked_spans(r)] for r in runs]
    all_pieces = [one for run_pieces in pieces for one in run_pieces]
    if not all_pieces:
        zeros = [np.zeros(len(r)) for r in runs]
        return [_Clamping(x, x, x, np.ones(len(x), bool)) for x in zeros]
    scale = max(max(float(np.max(np.abs(r.y))) for r in all_pieces), _NO_BRAKING)
    step = _step(all_pieces)
    floor = (1e-5 * scale) ** 2 + runs[0].clamping_force_step ** 2 / 12.0  # never quite zero
    rough = scale**2 * np.array([1e-6, 0.1, 3.0 / step**3])
    guess = smoother.MeasurementNoise(
        max(white_noise((r.t, r.y) for r in all_pieces), floor), 0.0, rough
    )
    regimes = smoother.Regimes(np.zeros(3), _SWITCHING_RATES, _START_PROBABILITIES, 3.0 * scale)
    prior = smoother.Prior(guess, [2.0, 0.0, 2.0, 2.0, 0.0], floor)
    noise, _ = smoother.fit(_sample(all_pieces), regimes, prior)
    clamping = []
    for r, run_pieces in zip(runs, pieces, strict=True):
        K, sigma, missed = np.zeros((3, len(r)))
        measured = np.ones(len(r), bool)
        for s, piece in zip(_braked_spans(r), run_pieces, strict=True):
            t, x = _seconds(r)[s], smoother.smooth(piece, regimes, noise)
            t = t - t[0]
            K[s] = np.interp(t, piece.t, x.level)
            sigma[s] = np.interp(t, piece.t, x.level_sigma)
            missed[s] = _line_error(t, piece.t, x.level)
            measured[s] = False
            measured[s.start + np.searchsorted((t[1:] + t[:-1]) / 2.0, piece.t)] = True
        clamping.append(_Clamping(K, sigma, missed, measured))
    return clamping


def _braked_spans(run: AxleRecord) -> list[slice]:
    """Where K > 0, with one sample of the zero on either side; short zeros are noise."""
    released = run.clamping_force_smooth <= 0.0
    for start, stop in true_runs(released):
        released[start:stop] = stop - start >= _SHORTEST_ZERO or start == 0 or stop == len(run)
    n = len(run)
    spans = [slice(max(a - 1, 0), min(b + 1, n)) for a, b in true_runs(~released)]
    return [s for s in spans if s.stop - s.start > 1]


def _piece(run: AxleRecord, s: slice) -> smoother.UnbrokenRun:
    """The pressure's own samples of a piece, not those interpolated to the wheel's times.

    A slow pressure that repeats its value is taken as sampled as often as where it changes.
    """
    last_value, K, t = run.clamping_force[s], run.clamping_force_smooth[s], _seconds(run)[s]
    is_sample = np.diff(last_value, prepend=np.nan) != 0.0
    unchanged = last_value == K
    changes = t[is_sample]
    if unchanged.all() or len(changes) < 3:
        is_sample |= unchanged
    else:
        interval = float(np.median(np.diff(changes)))
        for start, stop in true_runs(unchanged):
            count = max(round((t[stop - 1] - t[start]) / interval), 1) + 1
            is_sample[start + np.round(np.linspace(0, stop - 1 - start, count)).astype(int)] = True
    is_sample[[0, -1]] = True
    return smoother.UnbrokenRun(
        (t - t[0])[is_sample], K[is_sample], *np.zeros((5, np.sum(is_sample)))
    )


def _line_error(t: Floats, knots: Floats, x: Floats) -> Floats:
    """Possible error at the times t of straight lines between x at `knots`, shape (n,)."""
    right = np.clip(np.searchsorted(knots, t), 1, len(knots) - 1)
    fraction = (t - knots[right - 1]) / (knots[right] - knots[right - 1])
    error: Floats = _bend(x)[right] * fraction * (1.0 - fraction)
    return error


def _seconds(run: AxleRecord) -> Floats:
    since: Floats = (run.t - run.t[0]) * 1e-9
    return since


def _step(runs: list[smoother.UnbrokenRun]) -> float:
    """Median interval [s]."""
    return float(np.median(np.concatenate([np.diff(r.t) for r in runs])))


def _sample(runs: list[smoother.UnbrokenRun]) -> list[smoother.UnbrokenRun]:
    """The runs, or blocks of a long log for the fit: half spread evenly, half the roughest.

    Slides are rare, and noise levels fitted without them would be wrong for them.
    """
    if sum(len(r.t) for r in runs) <= _FITTED_SAMPLES:
        return runs
    blocks = [
        smoother.UnbrokenRun(*(column[i : i + _BLOCK] for column in r))
        for r in runs
        for i in range(0, len(r.t), _BLOCK)
    ]
    count = min(_FITTED_SAMPLES // _BLOCK // 2, len(blocks))
    roughest = np.argsort([-np.sum(np.diff(b.y, 2) ** 2) for b in blocks], kind="stable")[:count]
    spread = np.linspace(0, len(blocks) - 1, count).astype(int)
    return [blocks[i] for i in sorted({*roughest, *spread})]


# Butterworth: the paper's way


def _butterworth(runs: list[AxleRecord], ripples: list[Floats], w: Wheelset) -> list[RunEstimate]:
    """Zero-phase Butterworth low pass on ω, differentiated; K as the smoother has it.

    Each run is resampled to its median interval, filtered forwards and backwards, and put back to
    its own times. The removed noise is taken as white; sigma is the part of it that passes the
    filter, and the noise of K.
    """
    from scipy.signal import butter, sosfiltfilt

    estimates = []
    for run, ripple, c in zip(runs, ripples, _clamping(runs), strict=True):
        t, y = _seconds(run), run.wheel_speed - ripple
        n = len(t)
        even_t = np.linspace(0.0, t[-1], max(n, round(t[-1] / float(np.median(np.diff(t)))) + 1))
        rate = (len(even_t) - 1) / t[-1]
        cutoff = min(_CUTOFF, 0.4 * rate)
        sos = butter(2, cutoff, fs=rate, output="sos")
        pad = min(len(even_t) - 1, round(3.0 * rate / cutoff))
        speed = np.interp(even_t, t, y)
        smooth = sosfiltfilt(sos, speed, padlen=pad)
        pulse = np.zeros(2 * pad + 3)
        pulse[pad + 1] = 1.0
        kernel = np.gradient(sosfiltfilt(sos, pulse, padlen=0), 1.0 / rate)
        removed = float(np.std(y - np.interp(t, even_t, smooth)))
        noise = max(removed, math.sqrt(float(np.mean(run.wheel_speed_steps**2)) / 12.0))
        speed_sigma = noise * math.sqrt(kernel @ kernel)
        acceleration = np.interp(t, even_t, np.gradient(smooth, 1.0 / rate))
        K, sigma = _noise(c, (acceleration, np.full(n, speed_sigma)), w)
        estimates.append(RunEstimate(K, acceleration, sigma))
    return estimates


METHODS: dict[str, ReferenceMethod] = {
    "smoother": ReferenceMethod(
        "Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445; Barber, J. Mach. Learn. Res. 7 (2006) 2515",
        _smoother,
    ),
    "butterworth": ReferenceMethod("Wu, Peng, Li, section 4", _butterworth),
}
