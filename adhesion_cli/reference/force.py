"""Offline reference of the adhesion force, F = φK + ω̇/a, with its uncertainty.

It is neither causal nor the truth. `sigma` is its uncertainty by noise and smoothing; the 95 % band
also contains the vehicle's tolerances. Where the wheel stands there is no reference: friction can
then be anything up to φK.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..core import innovations
from ..core.masks import true_runs
from ..core.model import AxleRecord, Floats, Reference, Vehicle, Wheelset, without_motors
from ..core.physics import CHAIN, LONGEST_DUMP, piston_area, rolling_deceleration, wheelset
from ..core.signals import driven, means_around, moving, running_integral, white_noise
from . import noise_fit, run_out, smoother
from .clamping import SmoothedClamping, smooth_clamping
from .noise_fit import LIKELY, SLACK, Slack, ValueAndSigma, median_step, rate_of_change, seconds_of
from .pulses import count_pulses, counts_together, informative_samples, pulse_means, remove_steps
from .smoother import MeasurementNoise, Regimes, Runs, UnbrokenRun

ZERO = "pressure_zero"  # name of the budget's row for the zero that was taken off
CREEPAGE = "creepage"  # and for a brake force that the creepage of the axle contradicts
_SHORTEST = 8  # least samples of a run: fewer do not show their noise
_COUNTER_SLACK: Slack = (2.0, 2.0, 4.5)  # the same, and of sliding, for a pulse counter
_RATE_SHARE = 0.75  # pressure samples per speed sample from which its rate counts as equal
_CUTOFF = 2.0  # of the Butterworth filter, −3 dB of one pass [Hz]
_LAGS = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06)  # by which pads may lag the pressure [s]
_SHORTEST_SLIDE = 0.15  # a shorter one may be a disturbed reading of the speed [s]
_ONSET_TIME = 0.2  # before and behind a slide the innovations are not judged [s]
_MISFIT_TIME = 0.5  # about a speed, in which ω̇ explains it [s]
_FAST_SHARE = 0.1  # of the highest speed: the wheel moves
_GAIN = 0.02  # share of its speed that no wheel gains by noise
_LAG_NATS = 3.0  # by which a lag must be more likely than none
_SHARE = 1e-3  # square of the share of φK's rise that rolling does not explain, to a factor of 10


class RunEstimate(NamedTuple):
    """The result of a method for one run of a moving wheel; columns of shape (n,)."""

    clamping_force: Floats  # K [N], with less noise
    acceleration: Floats  # ω̇ [rad/s²]
    sigma: Floats  # 1 sigma of φK + ω̇/a from noise alone [N]
    averaged: float = 0.0  # probability that a speed is the mean since the last one
    squares: Floats | None = None  # normalised innovations squared, of a wheel that rolls (m,)
    speed_sigma: Floats | None = None  # 1 sigma of a speed as measured, without rounding [rad/s]
    clamping_sigma: Floats | None = None  # 1 sigma of φK from noise alone [N]
    pad_lag: float = 0.0  # by which the pads lag the pressure, as the slides show it [s]


def compute(record: AxleRecord, vehicle: Vehicle, method: str = "smoother") -> Reference:
    """Reference adhesion force over all segments, each on its own.

    They are NaN in a segment of too few samples, where the wheel stands, and where a motor drives
    it. The run-out of a tone ring is removed first. If the pressure is delayed, sigma contains the
    error of K. The record is `faded`. The vehicle's values give F, its tolerances the band.
    """
    source, estimate_runs = METHODS[method]
    w = wheelset(vehicle, record.axle)
    slices = [s for s in moving(record) if s.stop - s.start >= _SHORTEST]
    runs = [record.extract(s) for s in slices]
    ripples = [run_out.find_run_out(seconds_of(r), r.wheel_speed) for r in runs]
    delay = record.pressure_late.value
    force, sigma, tolerance, mass = (np.full(len(record), np.nan) for _ in range(4))
    impulse, clamping = np.full((2, len(record)), np.inf)
    estimates = estimate_runs(runs, [ripple for ripple, _ in ripples], w)
    for s, estimate in zip(slices, estimates, strict=True):
        force[s] = w.phi * estimate.clamping_force + estimate.acceleration / w.a  # (1)
        sigma[s] = estimate.sigma
        if estimate.speed_sigma is not None and estimate.clamping_sigma is not None:
            impulse[s], clamping[s] = estimate.speed_sigma / w.a, estimate.clamping_sigma
        tolerance[s], mass[s] = _tolerance(record.extract(s), vehicle, estimate)
        if delay:
            t = (record.t[s] - record.t[s.start]) * 1e-9
            K = without_motors(estimate.clamping_force, record.extract(s).motor_clamping_smooth)
            delay_error = np.interp(t + delay, t, K) - K
            sigma[s] = np.hypot(sigma[s], w.phi * delay_error)
    unknown_torque = driven(record, vehicle.radius(record.axle).value)
    for column in (force, sigma, tolerance, mass):
        column[unknown_torque] = np.nan
    squares = [estimate.squares for estimate in estimates if estimate.squares is not None]
    return Reference(
        method=method,
        source=source,
        force=force,
        sigma=sigma,
        tolerance=tolerance,
        saturated=record.saturated,
        runout=max((share for _, share in ripples), default=0.0),
        pulses=count_pulses(max(runs, key=len)) if runs else math.inf,
        averaged=estimates[0].averaged if estimates else 0.0,
        mass=mass,
        nis=innovations.mean(np.concatenate(squares)) if squares else None,
        impulse=impulse,
        clamping=clamping,
        pad_lag=max((estimate.pad_lag for estimate in estimates), default=0.0),
        brake=w.phi * record.clamping_force,
    )


def _tolerance(run: AxleRecord, vehicle: Vehicle, estimate: RunEstimate) -> tuple[Floats, Floats]:
    """1 sigma of the force from the vehicle's tolerances, and its covariance with ln m [N]."""
    speed = run.wheel_speed * vehicle.radius(run.axle).value
    K = estimate.clamping_force
    sigma = np.zeros(len(run))
    if run.motor_clamping_smooth is not None and run.motor_sigma is not None:
        K, sigma = without_motors(K, run.motor_clamping_smooth), run.motor_sigma
        K = np.where(run.friction_clamping_smooth > 0.0, K, 0.0)
    earlier = before_lag(run, vehicle, K)
    variance, mass = by_tolerances(run, vehicle, K, estimate.acceleration, speed, earlier)
    variance = variance + sigma**2
    return np.sqrt(np.maximum(variance, 0.0)), np.zeros(len(run)) + mass


def before_lag(record: AxleRecord, vehicle: Vehicle, K: Floats) -> Floats:
    """K as the pads have it that lag by `vehicle.friction_lag` (n,) [N].

    The chamber of a cylinder follows the sensor, and the friction of a caliper holds the pads back
    as the pressure turns. No published value is known. 10 to 60 ms are usual behind a valve.
    """
    lag = vehicle.friction_lag.value + vehicle.friction_lag.tolerance
    t = (record.t - record.t[0]) * 1e-9
    earlier = K.copy()
    for s in record.segments:
        earlier[s] = np.interp(t[s] - lag, t[s], K[s])
    return earlier


def by_tolerances(
    record: AxleRecord, vehicle: Vehicle, K: Floats, dw: Floats, v: Floats, earlier: Floats | None
) -> tuple[Any, Any]:
    """Variance of the force [N²] by the vehicle's tolerances, and its covariance with ln m [N].

    Arguments as of `contributions`: arrays, or numbers for one sample.
    """
    by_name = contributions(record, vehicle, K, dw, v, earlier)
    mass = {"axle_mass": vehicle.axle_mass.share}
    return vehicle.covariance(by_name, by_name), vehicle.covariance(by_name, mass)


def contributions(
    record: AxleRecord, vehicle: Vehicle, K: Floats, dw: Floats, v: Floats, earlier: Floats | None
) -> dict[str, Floats]:
    """By how much each tolerance moves F = φK + I ω̇/R, first order [N]; (n,) each.

    Every parameter varies on its own, at measured ω and p, or K if the log has K. A speed logged in
    m/s or km/h is ωR, and the reader has divided it by R: an error of R counts twice there. `K` is
    that of the friction brake, with the friction's change over speed; `earlier` that before the lag
    of the pads, from `before_lag`, None where K is steady. `v` is ωR [m/s].
    """
    R, inertia, phi = vehicle.radius(record.axle), vehicle.wheelset_inertia, vehicle.friction
    fade, speed_difference = vehicle.friction_fade, v - vehicle.friction_speed.value
    by_fade = phi.value * K * speed_difference / (1.0 + fade.value * speed_difference)
    by_radius = (-2.0 if record.of_rim else -1.0) * dw * inertia.value / R.value**2
    terms = {
        "friction": K * phi.tolerance,
        "friction_fade": by_fade * fade.tolerance,
        "wheelset_inertia": dw / R.value * inertia.tolerance,
        "wheel_radius": by_radius * R.tolerance,
    }
    if record.creepage_doubt:
        terms[CREEPAGE] = phi.value * K * record.creepage_doubt
    if record.pressure is not None and earlier is not None:
        terms["friction_lag"] = phi.value * (earlier - K)
    if record.pressure is not None:
        chain = {name: getattr(vehicle, name) for name in CHAIN}
        ratio = math.prod(x.value for x in chain.values())  # K over the piston's force    (15)
        piston = K + np.where(K > 0.0, ratio * vehicle.spring_force.value, 0.0)
        d = vehicle.cylinder_diameter
        terms |= {name: phi.value * K * x.share for name, x in chain.items()}
        terms["cylinder_diameter"] = phi.value * piston * 2.0 * d.share
        terms["spring_force"] = -phi.value * ratio * vehicle.spring_force.tolerance * (K > 0.0)
        if zero := record.pressure_zero.tolerance:
            per_pascal = ratio * piston_area(vehicle)
            terms[ZERO] = np.where(K > 0.0, -phi.value * per_pascal * zero, 0.0)
    return terms


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
    clamping = smooth_clamping(runs)
    highest = max(float(c.K.max()) for c in clamping)
    scale = w.a * w.phi * max(highest, noise_fit.NO_BRAKING)  # of δ, if all of φK went missing
    counts, step = counts_together(max(runs, key=len)), runs[0].wheel_speed_step
    wheel = [_rolling_run(r, x, c.K, w) for r, x, c in zip(runs, ripples, clamping, strict=True)]
    if counts:
        triples = zip(runs, ripples, wheel, strict=True)
        informative = [pulse_means(r, x, run, counts) for r, x, run in triples]
        # The errors of successive means are correlated, those of every second one are not.
        fitted_to = [UnbrokenRun(*(c[::2].copy() for c in run)) for run in informative]
        rounding, slack, white = step**2 / 6.0 / counts**2, _COUNTER_SLACK, fitted_to
    else:
        steps = (r.wheel_speed_steps for r in runs)
        common = map(noise_fit.common_noise, wheel, steps)
        noisy = zip(wheel, common, strict=True)
        wheel = [run._replace(own_variance=run.own_variance + x) for run, x in noisy]
        informative = fitted_to = [informative_samples(run) for run in wheel]
        rounding = float(np.mean([np.mean(r.wheel_speed_steps**2) for r in runs])) / 12.0
        slack, white = SLACK, wheel
    noise = max(white_noise((r.t, r.y) for r in white) - rounding, 1e-3 * rounding)
    rough = scale**2 * np.array([1e-5, 1e-2, 10.0, 10.0])
    prior = MeasurementNoise(noise, _SHARE * scale, rough)
    fitted, regimes = noise_fit.fit_regimes(fitted_to, median_step(wheel), scale, prior, slack)
    slides = len(regimes.start) > 1 and not counts
    lag = _most_likely_lag(runs, clamping, wheel, regimes, fitted, w) if slides else 0.0
    if lag > 0.0:
        clamping, wheel = _delay(runs, clamping, wheel, lag, w)
        informative = fitted_to = [informative_samples(run) for run in wheel]
        fitted = noise_fit.fit_again(fitted_to, regimes, prior, slack, fitted)
    pairs = zip(wheel, informative, strict=True)
    rates = [rate_of_change(*pair, regimes, fitted) for pair in pairs]
    averaged, judged, levels = 0.0, fitted_to, fitted
    if not counts and not lag and not runs[0].pressure_late.value:  # these look alike
        averaged, mean_rates, means, noise_of_means = _as_means(
            runs, wheel, informative, fitted, regimes, prior
        )
        if mean_rates:
            rate_pairs = zip(rates, mean_rates, strict=True)
            rates = [noise_fit.mix_estimates(*pair, averaged) for pair in rate_pairs]
        if averaged > LIKELY:
            judged, levels = means, noise_of_means
    squares = [_rolling_squares(run, regimes, levels) for run in judged]
    rolls = len(regimes.start) == 1 and _sparse(runs)
    force_of = _between_samples if rolls else _noise
    forces = [force_of(*pair, w) for pair in zip(clamping, rates, strict=True)]
    variance = math.inf if counts else levels.measurement  # a count is a mean, not a level
    estimates, runs_of_wheel = [], zip(forces, rates, squares, wheel, clamping, strict=True)
    for (K, sigma), (rate, _), z2, run, c in runs_of_wheel:
        speed_sigma = np.maximum(np.sqrt(variance + run.own_variance), np.abs(_misfit(run, rate)))
        clamping_sigma = w.phi * np.hypot(c.sigma, c.missed)
        estimates.append(
            RunEstimate(K, rate, sigma, averaged, z2, speed_sigma, clamping_sigma, lag)
        )
    return estimates


def _rolling_squares(run: UnbrokenRun, regimes: Regimes, noise: MeasurementNoise) -> Floats:
    """Normalised innovations squared of a wheel that rolls, (m,).

    Where a slide begins or ends, the rail decides them and not the noise of the speed.
    """
    scores, rolling = smoother.innovations(run, regimes, noise)
    t, judged = run.t[1:], np.ones(len(scores), dtype=np.bool_)
    for start, stop in true_runs(rolling < 0.5):
        if t[stop - 1] - t[start] > _SHORTEST_SLIDE:
            around = np.searchsorted(t, [t[start] - _ONSET_TIME, t[stop - 1] + _ONSET_TIME])
            judged[slice(*around)] = False
    return scores[judged] ** 2


def _regains_grip(run: UnbrokenRun, K: Floats) -> bool:
    """Whether the wheel gains clearly speed in a braking: only one that slid does.

    A braking goes on while the wheel slide protection vents the brake and fills it again.

    Several regimes alone do not show a slide: the first moment of a hard brake looks alike.
    """
    released = K <= 0.0
    for start, stop in true_runs(released):
        is_vented = start > 0 and stop < len(K) and run.t[stop - 1] - run.t[start] < LONGEST_DUMP
        released[start:stop] = not is_vented
    for start, stop in true_runs(~released):
        speed = run.y[start:stop]
        gain = speed - np.minimum.accumulate(speed)
        if np.any((gain > _GAIN * speed) & (speed > _FAST_SHARE * run.y.max())):
            return True
    return False


def _misfit(run: UnbrokenRun, rate: Floats) -> Floats:
    """By how much each speed departs from the estimated ω̇, within half a second (n,) [rad/s].

    A peak of a few samples that the smoother takes for noise departs by more than its sigma.
    """
    drift = run.y - running_integral(run.t, rate)
    return drift - means_around(run.t, drift, _MISFIT_TIME)


def _as_means(
    runs: list[AxleRecord],
    wheel: Runs,
    informative: Runs,
    fitted: MeasurementNoise,
    regimes: Regimes,
    prior: MeasurementNoise,
) -> tuple[float, list[ValueAndSigma], Runs, MeasurementNoise]:
    """The probability that speeds are means since the last one, the rates then, and the samples.

    Where samples are sparse, nothing shows it: both are as likely. Without a probability there are
    no rates. `informative` are the samples of `wheel` that tell something, as speeds of their
    instant, and `fitted` is their noise.
    """
    means = [informative_samples(run, mean=True) for run in wheel]
    probability, noise = 0.5, fitted
    if not _sparse(runs):
        probability, noise = noise_fit.probability_of_means(
            informative, means, fitted, regimes, prior
        )
    pairs = zip(wheel, means, strict=True) if probability > noise_fit.NEVER else ()
    rates = [rate_of_change(*pair, regimes, noise) for pair in pairs]
    return probability, rates, means, noise


def _most_likely_lag(
    runs: list[AxleRecord],
    clamping: list[SmoothedClamping],
    wheel: Runs,
    regimes: Regimes,
    noise: MeasurementNoise,
    w: Wheelset,
) -> float:
    """By how much the pads lag the pressure [s]; 0 if no lag is clearly more likely.

    A wheel that slides shows it, for its ω̇ follows φK at once: where a valve vents and the pads do
    not yet follow, the force would seem to drop. The lags are those of `vehicle.friction_lag`. One
    below the interval of the speeds is none: a speed that is a mean since the last one looks alike.
    """
    if not any(_regains_grip(run, c.K) for run, c in zip(wheel, clamping, strict=True)):
        return 0.0
    likelihoods = []
    for lag in _LAGS:
        _, delayed = _delay(runs, clamping, wheel, lag, w)
        sample = noise_fit.take_samples([informative_samples(run) for run in delayed])
        likelihoods.append(smoother.likelihood(sample, regimes, noise))
    best = int(np.argmax(likelihoods))
    is_clear = likelihoods[best] > likelihoods[0] + _LAG_NATS
    return _LAGS[best] if is_clear and _LAGS[best] > median_step(wheel) else 0.0


def _delay(
    runs: list[AxleRecord],
    clamping: list[SmoothedClamping],
    wheel: Runs,
    lag: float,
    w: Wheelset,
) -> tuple[list[SmoothedClamping], Runs]:
    """K as the pads have it that lag by `lag` [s], and the runs with it."""
    pairs = zip(map(seconds_of, runs), clamping, strict=True)
    clamping = [c._replace(K=np.interp(t - lag, t, c.K)) for t, c in pairs]
    wheel = [run._replace(**_inputs(run.t, c.K, w)) for run, c in zip(wheel, clamping, strict=True)]
    return clamping, wheel


def _noise(c: SmoothedClamping, rate: ValueAndSigma, w: Wheelset) -> ValueAndSigma:
    """K, and 1 sigma of φK + ω̇/a [N]."""
    return c.K, np.hypot(rate[1] / w.a, w.phi * np.hypot(c.sigma, c.missed))


def _between_samples(c: SmoothedClamping, rate: ValueAndSigma, w: Wheelset) -> ValueAndSigma:
    """The same for a wheel that only rolls, and a K that is measured less often than the speed.

    There ω̇ shows K between its samples: F and ω̇ follow it at once. So ω̇ departs from what straight
    lines of K explain by −a(1 − rolling)φ times the error of K. How far K may be off the line
    bounds it, so a slow δ stays one.
    """
    rate_per_force = w.a * (1.0 - w.rolling)
    n, measured_index = np.arange(len(c.K)), np.flatnonzero(c.measured)
    departure = rate[0] + rate_per_force * w.phi * c.K
    departure = departure - np.interp(n, measured_index, departure[measured_index])
    variance_here = rate[1] ** 2
    variance_there = np.interp(n, measured_index, rate[1][measured_index] ** 2)
    missed = (w.phi * c.missed) ** 2
    total = missed + (variance_here + variance_there) / rate_per_force**2
    gain = missed / np.maximum(total, noise_fit.FLOOR)
    K = c.K - gain * departure / rate_per_force / w.phi
    rate_gain = gain / (1.0 - w.rolling)
    variance = (1.0 - gain) ** 2 * missed + (
        (rate_gain - 1.0) ** 2 * variance_here + rate_gain**2 * variance_there
    ) / w.a**2
    return K, np.sqrt(variance + (w.phi * c.sigma) ** 2)


def _sparse(runs: list[AxleRecord]) -> bool:
    """Whether K is measured less often than the speed.

    Then the error of straight lines between its samples looks like half an interval of the speed.
    """
    measured = sum(np.count_nonzero(np.diff(r.clamping_force)) for r in runs)
    interpolated = sum(np.count_nonzero(np.diff(r.clamping_force_smooth)) for r in runs)
    return bool(measured < _RATE_SHARE * interpolated)


def _rolling_run(run: AxleRecord, ripple: Floats, K: Floats, w: Wheelset) -> UnbrokenRun:
    """The run as a rolling wheel: ω̇ known from K except δ."""
    t = seconds_of(run)
    y, own_variance = remove_steps(t, run.wheel_speed, run.wheel_speed_steps)
    return UnbrokenRun(
        t, y - ripple, **_inputs(t, K, w), own_variance=own_variance, span=np.zeros(len(t))
    )


def _inputs(t: Floats, K: Floats, w: Wheelset) -> dict[str, Floats]:
    u = -rolling_deceleration(w) * K
    bend = np.diff(t, prepend=0.0) * noise_fit.largest_bend(u) / 8.0  # as by a kink in u half way
    return {"u": u, "s": w.a * w.phi * w.rolling * K, "input_variance": bend**2}


def _butterworth(runs: list[AxleRecord], ripples: list[Floats], w: Wheelset) -> list[RunEstimate]:
    """Zero-phase Butterworth low pass on ω, differentiated; K as the smoother has it.

    Each run is resampled to its median interval, filtered forwards and backwards, and put back to
    its own times. The removed noise is taken as white; sigma is the part of it that passes the
    filter, and the noise of K.
    """
    from scipy.signal import butter, sosfiltfilt

    estimates = []
    for run, ripple, c in zip(runs, ripples, smooth_clamping(runs), strict=True):
        t, y = seconds_of(run), run.wheel_speed - ripple
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


# Source of each, and what takes the runs, the run-out in the wheel speed of each, and the wheelset.
METHODS: dict[str, tuple[str, Callable[..., list[RunEstimate]]]] = {
    "smoother": (
        "Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445; Barber, J. Mach. Learn. Res. 7 (2006) 2515",
        _smoother,
    ),
    "butterworth": ("Wu, Peng, Li, section 4", _butterworth),
}
