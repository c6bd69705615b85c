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
_FIT = 20_000  # samples that the noise levels are fitted to
_BLOCK = 2_000  # consecutive samples fitted together
_PULSES = 24.0  # of a counter that give a speed to a few percent
_COUNTED = 0.18  # noise of its counts in pulses²; 0.28 where all phases occur, rounding 0.08
_BRIEF = 0.1  # a slide hardly changes within [s]
_KNOTS = 6  # samples of a run of equal speeds that are used
_DITHER = 2  # samples that a level of dither lasts; longer, and its errors are not independent
_ZEROS = 10  # fewer samples of K = 0 in a row are noise around the spring's force
_FLOOR = 1e-12  # least variance of the speed's noise [rad²/s²]
_SMALL = 100.0  # clamping force below which there is no braking [N]
_SURE: tuple[float, ...] = (0.5, 0.5)  # slack of coupling and rolling [nats], see `smoother.Prior`
_DOUBT: tuple[float, ...] = (2.0, 2.0, 4.5)  # the same, and of sliding, for a pulse counter
_SLOWEST = 0.2  # longest interval at which slides are looked for [s]
_CLEARLY = 15.0  # nats by which slides must be more likely
_NATS = 3.0  # of a likelihood without correlated errors that count as one
_OFTEN = 0.75  # pressure samples per speed sample from which its rate counts as equal
_NEVER, _LIKELY = 1e-3, 0.8  # probabilities below which, and above which, a case is taken as sure
_LEAVE = np.array([[0.0, 0.02, 0.05], [0.02, 0.0, 1.0], [10.0, 10.0, 0.0]])  # regimes [1/s]
_CUTOFF = 2.0  # of the Butterworth filter, −3 dB of one pass [Hz]
_START = np.array([0.9, 0.05, 0.05])
_DECADES = (2.0, 1.0, 2.0, 1.5, 0.7)  # 1 sigma of the prior of noise, coupling, each roughness
_SHARE = 1e-3  # square of the share of φK's rise that rolling does not explain, to a factor of 10


_Known = tuple[Floats, Floats]  # a column and its 1 sigma, shape (n,)


class _Clamping(NamedTuple):
    """The clamping force without its noise; columns of shape (n,)."""

    K: Floats  # [N]
    sigma: Floats  # 1 sigma at its own samples, a line between them [N]
    missed: Floats  # 1 sigma of what lines between its samples may miss [N]
    measured: Bools  # the samples of the speed that are nearest to its own


class Parts(NamedTuple):
    """The result of a method for one run of a moving wheel; columns of shape (n,)."""

    clamping_force: Floats  # K [N], with less noise
    acceleration: Floats  # ω̇ [rad/s²]
    sigma: Floats  # 1 sigma of φK + ω̇/a from noise alone [N]
    averaged: float = 0.0  # probability that a speed is the mean since the last one
    squares: Floats | None = None  # normalised innovations squared, where the filter has a sample


class Method(NamedTuple):
    """A way to compute the reference."""

    source: str
    # Takes the runs, the run-out in the wheel speed of each, and the wheelset's constants.
    parts: Callable[[list[AxleRecord], list[Floats], Wheelset], list[Parts]]


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
    runs = [record.cut(s) for s in slices]
    ripples = [run_out.found(_seconds(r), r.wheel_speed) for r in runs]
    late = record.pressure_late.value
    force, sigma, tolerance, mass = (np.full(len(record), np.nan) for _ in range(4))
    found = METHODS[method].parts(runs, [part for part, _ in ripples], w)
    for s, parts in zip(slices, found, strict=True):
        force[s] = w.phi * parts.clamping_force + parts.acceleration / w.a  # (1)
        sigma[s] = parts.sigma
        tolerance[s], mass[s] = _tolerance(record.cut(s), vehicle, parts)
        if late:
            t = (record.t[s] - record.t[s.start]) * 1e-9
            off = np.interp(t + late, t, parts.clamping_force) - parts.clamping_force
            sigma[s] = np.hypot(sigma[s], w.phi * off)
    unknown_torque = driven(record, vehicle.radius(record.axle).value)
    for column in (force, sigma, tolerance, mass):
        column[unknown_torque] = np.nan
    largest = max((share for _, share in ripples), default=0.0)
    averaged = found[0].averaged if found else 0.0
    pulses = _pulses(max(runs, key=len)) if runs else math.inf
    squares = [parts.squares for parts in found if parts.squares is not None]
    nis = innovations.mean(np.concatenate(squares)) if squares else None
    source, open_ = METHODS[method].source, record.saturated
    return Reference(
        method, source, force, sigma, tolerance, open_, largest, pulses, averaged, mass, nis
    )


def _tolerance(run: AxleRecord, vehicle: Vehicle, parts: Parts) -> tuple[Floats, Floats]:
    """1 sigma of the force from the vehicle's tolerances, and its covariance with ln m [N]."""
    speed = run.wheel_speed * vehicle.radius(run.axle).value
    variance, mass = by_tolerances(run, vehicle, parts.clamping_force, parts.acceleration, speed)
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

    Arguments as of `moves`: arrays, or numbers for one sample.
    """
    moved = moves(record, vehicle, K, dw, speed)
    mass = {"axle_mass": vehicle.axle_mass.tolerance / vehicle.axle_mass.value}
    return vehicle.covariance(moved, moved), vehicle.covariance(moved, mass)


def moves(
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
    fade, at = vehicle.friction_fade, speed - vehicle.friction_speed.value
    terms = {
        "friction": K * phi.tolerance,
        "friction_fade": phi.value * K * at / (1.0 + fade.value * at) * fade.tolerance,
        "wheelset_inertia": dw / R.value * inertia.tolerance,
        "wheel_radius": (-2.0 if record.of_rim else -1.0)
        * dw * inertia.value / R.value**2 * R.tolerance,
    }  # fmt: skip
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


def _smoother(runs: list[AxleRecord], ripples: list[Floats], w: Wheelset) -> list[Parts]:
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
    scale = w.a * w.phi * max(highest, _SMALL)  # of δ, if all of φK went missing
    together, step = _counted(max(runs, key=len)), runs[0].wheel_speed_step
    every = zip(runs, ripples, clamping, strict=True)
    wheel = [_rolling(r, x, c.K, w) for r, x, c in every]
    if together:  # errors of successive counts are correlated; those of every second one are not
        telling = [
            _pulsed(r, x, run, together) for r, x, run in zip(runs, ripples, wheel, strict=True)
        ]
        fitted_to = [smoother.Run(*(column[::2].copy() for column in run)) for run in telling]
        rounding, slack, white = step**2 / 6.0 / together**2, _DOUBT, fitted_to
    else:
        telling = fitted_to = [_telling(run) for run in wheel]
        rounding = float(np.mean([np.mean(r.wheel_speed_steps**2) for r in runs])) / 12.0
        slack, white = _SURE, wheel
    noise = max(white_noise((r.t, r.y) for r in white) - rounding, 1e-3 * rounding)
    prior = smoother.Noise(noise, _SHARE * scale, scale**2 * np.array([1e-5, 1e-2, 10.0]))
    fitted, regimes = _fit_either(fitted_to, _step(wheel), scale, prior, slack)
    rates = [_rate(*both, regimes, fitted) for both in zip(wheel, telling, strict=True)]
    averaged, judged = 0.0, (fitted_to, fitted)
    if not together and not runs[0].pressure_late.value:
        means = [_telling(run, mean=True) for run in wheel]
        averaged, noise_of = 0.5, fitted
        if not _sparse(runs):
            averaged, noise_of = _half_late(telling, means, fitted, regimes, prior)
        if averaged > _NEVER:
            late = [_rate(*both, regimes, noise_of) for both in zip(wheel, means, strict=True)]
            rates = [_mixed(*both, averaged) for both in zip(rates, late, strict=True)]
        judged = (means, noise_of) if averaged > _LIKELY else judged
    squares = [smoother.innovations(run, regimes, judged[1]) ** 2 for run in judged[0]]
    rolls = len(regimes.start) == 1 and _sparse(runs)
    forces = [
        _between(*both, w) if rolls else _noise(*both, w)
        for both in zip(clamping, rates, strict=True)
    ]
    return [
        Parts(K, rate, sigma, averaged, z2)
        for (K, sigma), (rate, _), z2 in zip(forces, rates, squares, strict=True)
    ]


def _noise(c: _Clamping, rate: _Known, w: Wheelset) -> _Known:
    """K, and 1 sigma of φK + ω̇/a [N]."""
    return c.K, np.hypot(rate[1] / w.a, w.phi * np.hypot(c.sigma, c.missed))


def _between(c: _Clamping, rate: _Known, w: Wheelset) -> _Known:
    """The same for a wheel that only rolls, and a K that is measured less often than the speed.

    There ω̇ shows K between its samples: F and ω̇ follow it at once. So ω̇ departs from what straight
    lines of K explain by −a(1 − rolling)φ times the error of K. How far K may be off the line
    bounds it, so a slow δ stays one.
    """
    per, n, own = w.a * (1.0 - w.rolling), np.arange(len(c.K)), np.flatnonzero(c.measured)
    off = rate[0] + per * w.phi * c.K
    off = off - np.interp(n, own, off[own])
    now, then = rate[1] ** 2, np.interp(n, own, rate[1][own] ** 2)
    missed = (w.phi * c.missed) ** 2
    gain = missed / np.maximum(missed + (now + then) / per**2, _FLOOR)
    K = c.K - gain * off / per / w.phi
    by = gain / (1.0 - w.rolling)
    variance = (1.0 - gain) ** 2 * missed + ((by - 1.0) ** 2 * now + by**2 * then) / w.a**2
    return K, np.sqrt(variance + (w.phi * c.sigma) ** 2)


def _rate(
    whole: smoother.Run, run: smoother.Run, regimes: smoother.Regimes, noise: smoother.Noise
) -> _Known:
    """ω̇ and its 1 sigma at the times of `whole`, estimated from `run`; shape (n,)."""
    x = smoother.smooth(run, regimes, noise)
    if run.t is whole.t:
        return x.rate, x.rate_sigma
    missed = _missed(whole.t, run.t, x.rate)
    rate: Floats = whole.u + np.interp(whole.t, run.t, x.rate)
    return rate, np.hypot(np.interp(whole.t, run.t, x.rate_sigma), missed)


def _sparse(runs: list[AxleRecord]) -> bool:
    """Whether K is measured less often than the speed.

    Then the error of straight lines between its samples looks like half an interval of the speed.
    """
    measured, between = (
        sum(int(np.count_nonzero(np.diff(column))) for column in columns)
        for columns in zip(
            *((r.clamping_force, r.clamping_force_smooth) for r in runs), strict=True
        )
    )
    return measured < _OFTEN * between


def _half_late(
    now: list[smoother.Run],
    means: list[smoother.Run],
    noise: smoother.Noise,
    regimes: smoother.Regimes,
    prior: smoother.Noise,
) -> tuple[float, smoother.Noise]:
    """Probability that readings are means since the one before, and the noise levels for that.

    The effect of K on ω̇ shows it: at once, or half an interval later.
    """
    first, some = _sample(now), _sample(means)
    known = smoother.likelihood(first, regimes, noise)
    if smoother.likelihood(some, regimes, noise) < known - _CLEARLY:
        return 0.0, noise
    noise, _ = _fit(some, regimes, prior, _SURE, noise)
    gain = smoother.likelihood(some, regimes, noise) - known
    return 1.0 / (1.0 + math.exp(min(-gain / _NATS, 700.0))), noise


def _mixed(one: _Known, other: _Known, share: float) -> _Known:
    """The first one, or the other if that is clearly more likely; 1 sigma contains both."""
    chosen = other[0] if share > _LIKELY else one[0]
    variances = [sigma**2 + (x - chosen) ** 2 for x, sigma in (one, other)]
    return chosen, np.sqrt((1.0 - share) * variances[0] + share * variances[1])


def _rolling(run: AxleRecord, ripple: Floats, K: Floats, w: Wheelset) -> smoother.Run:
    """The run as a rolling wheel: ω̇ known from K except δ."""
    t = _seconds(run)
    u = -rolling_deceleration(w) * K
    lost = np.diff(t, prepend=0.0) * _bend(u) / 8.0  # as by a kink in u half way
    y, known = _unstepped(t, run.wheel_speed, run.wheel_speed_steps)
    s = w.a * w.phi * w.rolling * K
    return smoother.Run(t, y - ripple, u, s, lost**2, known, np.zeros(len(t)))


def _counted(run: AxleRecord) -> int:
    """How many samples of a pulse counter to take together; 0 for another sensor.

    Together they have `_PULSES`, but they are no longer than `_BRIEF`.
    """
    y, step, t = run.wheel_speed, run.wheel_speed_step, _seconds(run)
    if step == 0.0 or len(y) < 100:
        return 0
    if not (run.of_totals or _dithers(t, y / step)):
        return 0
    interval = float(np.median(np.diff(t)))
    m = min(_PULSES * step / max(float(np.median(y)), step), _BRIEF / interval)
    return max(round(m), 1)


def _dithers(t: Floats, y: Floats) -> bool:
    """Whether whole numbers y change from sample to sample as counts of pulses do.

    Counters lose no pulse: sums over four samples vary no more than one sample does. Sums of
    rounded noise vary four times as much. A rounded ramp looks similar, but its error is half a
    step only, while a count has errors at both ends. Only parts where y changes are judged.
    """
    found = []
    for first in np.linspace(0, len(y) - 100, min(len(y) // 50, 100)).astype(int):
        at, some = t[first : first + 100], y[first : first + 100]
        one = np.mean([white_noise([(at[i : i + 50], some[i : i + 50])]) for i in (0, 50)])
        if one >= 1.0 / 24.0:
            sums = np.convolve(some, np.ones(4), "valid")
            four = np.mean([white_noise([(at[i:-3:4], sums[i::4])]) for i in range(4)])
            found.append((one, four / one))
    if len(found) < 2:
        return False
    one, more = np.median(found, axis=0)
    return bool(one >= _COUNTED and more <= 2.0)


def _pulses(run: AxleRecord) -> float:
    """Mean number of a counter's pulses in `_BRIEF`; inf for at least `_PULSES`, or no counter.

    A speed below its step is a counter's.
    """
    step, mean = run.wheel_speed_step, float(np.mean(run.wheel_speed))
    if step == 0.0:
        return math.inf
    pulses = mean / step * _BRIEF / float(np.median(np.diff(_seconds(run))))
    return pulses if pulses < _PULSES and (mean < step or _counted(run) > 0) else math.inf


def _pulsed(run: AxleRecord, ripple: Floats, whole: smoother.Run, m: int) -> smoother.Run:
    """A counter's run in means over m samples, at their middle, of the level without ∫u.

    The only error is the rounding at both ends of a mean. A sample counts the interval before it,
    or, if the log has totals, the interval about it.
    """
    m = min(m, len(run) // 4)
    n, t = len(run) // m * m, whole.t
    interval = float(np.median(np.diff(t)))
    end = t + interval / 2.0 if run.of_totals else t
    begin = np.maximum(np.concatenate([end[:1], end[:-1]]), end - 1.5 * interval)
    begin[0] = end[0] - interval
    gained = [np.interp(x, t, _gained(t, whole.u)) for x in (begin, end)]
    y = np.mean((run.wheel_speed - ripple - np.mean(gained, axis=0))[:n].reshape(-1, m), axis=1)
    begin, end = begin[:n:m], end[m - 1 : n : m]
    middle = (begin + end) / 2.0
    lost = np.diff(np.interp(middle, t, np.cumsum(whole.lost)), prepend=0.0)
    known = np.full(len(y), run.wheel_speed_step**2 / 6.0 / m**2)
    s = np.interp(middle, t, whole.s)
    return smoother.Run(middle, y, np.zeros(len(y)), s, lost, known, end - begin)


def _gained(t: Floats, u: Floats) -> Floats:
    """∫u from the first sample on, shape (n,)."""
    mean = (u + np.concatenate([u[:1], u[:-1]])) / 2.0
    gained: Floats = np.cumsum(np.diff(t, prepend=t[0]) * mean)
    return gained


def _unstepped(t: Floats, y: Floats, step: Floats) -> tuple[Floats, Floats]:
    """A signal rounded to these steps (n,), and its variance (n,); inf: a repeated sample.

    Rounding errors are independent only if the signal moves a step per sample. If it stays on a
    level for several, it is known best at the change to the next: half way, to within its movement
    in one interval. The run of equal values then counts as one sample. Where two levels alternate
    from sample to sample the errors are independent again: noise, or a pulse counter. A counter
    that measures the period of pulses has varying steps, and repeats its last value until the next
    pulse.
    """
    n, variance = len(y), step**2 / 12.0
    first = np.flatnonzero(np.diff(y, prepend=np.nan) != 0.0)  # of each run of equal values
    if len(first) == n or not step.any():
        return y, variance
    length = np.diff(first, append=n)
    jump = np.diff(y[first])
    back = np.zeros(len(first) + 2, dtype=bool)  # runs that end where they came from
    back[2:-2] = jump[1:] * jump[:-1] < 0.0
    dither = np.repeat(back[1:-1] & (back[:-2] | back[2:]) & (length <= _DITHER), length)

    long, count = np.repeat(length, length), np.repeat(np.minimum(length, _KNOTS), length)
    knot = (np.arange(n) - np.repeat(first, length)) * (count - 1) // np.maximum(long - 1, 1)
    used = np.diff(knot, prepend=-1) != 0
    used[first] = True
    level, told = y.copy(), np.where(used, count * variance, np.inf)

    far = np.abs(np.concatenate([[0.0], jump, [0.0]])) >= 1.5 * step[[*first, -1]]
    at, lasts = first[1:], np.diff(t[first], append=t[-1])
    slow = (np.minimum(length[1:], length[:-1]) > 1) & (np.abs(jump) < 1.5 * step[at])
    told[at[~slow]], told[at[~slow] - 1] = variance[at[~slow]], variance[at[~slow] - 1]
    at, jump, lasts = at[slow], jump[slow], np.minimum(lasts[1:], lasts[:-1])[slow]
    share = np.minimum((t[at] - t[at - 1]) / lasts, 1.0)  # of a step in one interval
    level[at] -= 0.5 * jump * (1.0 - share)
    told[at] = variance[at] * share**2
    if np.ptp(step) > 0.0:
        waits = (length > 1) & (far[1:] | far[:-1])
        told[np.repeat(waits, length)] = np.inf
        told[first[waits]] = variance[first[waits]]
    return np.where(dither, y, level), np.where(dither, variance, told)


def _telling(run: smoother.Run, mean: bool = False) -> smoother.Run:
    """The informative samples, of the level without ∫u; the run itself if all are.

    A step of the smoother without a measurement would only blur its regimes. With `mean`, each
    sample is the mean since the one before.
    """
    t, told = run.t, np.isfinite(run.known)
    if told.all() and not mean:
        return run
    h = np.diff(t, prepend=t[0] - np.median(np.diff(t))) * mean
    begin = t - np.minimum(h, 1.5 * np.median(h))
    gained = np.mean([np.interp(x, t, _gained(t, run.u)) for x in (begin, t)], axis=0)
    middle = (begin + t) / 2.0
    lost = np.interp(middle, t, np.cumsum(run.lost))[told]
    return smoother.Run(
        middle[told], (run.y - gained)[told], np.zeros(np.sum(told)),
        np.interp(middle, t, run.s)[told], np.diff(lost, prepend=0.0), run.known[told],
        (t - begin)[told],
    )  # fmt: skip


def _bend(x: Floats) -> Floats:
    """The larger second difference at i − 1 and i, shape (n,)."""
    bend = np.abs(np.diff(x, 2, prepend=x[0], append=x[-1])) if len(x) else x
    larger: Floats = np.maximum(bend, np.concatenate([bend[:1], bend[:-1]]))
    return larger


def _fit_either(
    runs: list[smoother.Run], interval: float, scale: float, prior: smoother.Noise,
    slack: tuple[float, ...],
) -> tuple[smoother.Noise, smoother.Regimes]:  # fmt: skip
    """Noise levels for a wheel that only rolls, or also slides if that is clearly more likely.

    A slow log only rolls: a slide of a few samples cannot be recognised.
    """
    some = _sample(runs)
    one = smoother.Regimes(np.zeros(1), np.zeros((1, 1)), np.ones(1), scale + 1.0)
    only, likely = _fit(some, one, prior, slack)
    if interval > _SLOWEST:
        return only, one
    three = smoother.Regimes(np.array([0.0, 1.0, 1.0]), _LEAVE, _START, scale + 1.0)
    both, likelier = _fit(some, three, prior, slack)
    return (both, three) if likelier - likely > _CLEARLY else (only, one)


def _fit(
    runs: list[smoother.Run], regimes: smoother.Regimes, prior: smoother.Noise,
    slack: tuple[float, ...], near: smoother.Noise | None = None,
) -> tuple[smoother.Noise, float]:  # fmt: skip
    """Noise levels of these regimes, the first of the prior, and their log posterior."""
    M = len(regimes.start)
    guess = prior._replace(rough=prior.rough[:M])
    return smoother.fit(
        runs, regimes, smoother.Prior(guess, _DECADES[: 2 + M], _FLOOR, slack), near
    )


def _clamping(runs: list[AxleRecord]) -> list[_Clamping]:
    """K without its noise: constant, moving, or stepping (then as measured).

    K = 0 is a bound of (15), not a measurement with noise: there it is exact.
    """
    pieces = [[_piece(r, s) for s in _pressed(r)] for r in runs]
    every = [piece for some in pieces for piece in some]
    if not every:
        none = [np.zeros(len(r)) for r in runs]
        return [_Clamping(x, x, x, np.ones(len(x), bool)) for x in none]
    scale = max(max(float(np.max(np.abs(r.y))) for r in every), _SMALL)
    step = _step(every)
    floor = (1e-5 * scale) ** 2 + runs[0].clamping_force_step ** 2 / 12.0  # never quite zero
    rough = scale**2 * np.array([1e-6, 0.1, 3.0 / step**3])
    guess = smoother.Noise(max(white_noise((r.t, r.y) for r in every), floor), 0.0, rough)
    regimes = smoother.Regimes(np.zeros(3), _LEAVE, _START, 3.0 * scale)
    known = smoother.Prior(guess, [2.0, 0.0, 2.0, 2.0, 0.0], floor)
    noise, _ = smoother.fit(_sample(every), regimes, known)
    found = []
    for r, some in zip(runs, pieces, strict=True):
        K, sigma, missed = np.zeros((3, len(r)))
        measured = np.ones(len(r), bool)
        for s, own in zip(_pressed(r), some, strict=True):
            t, x = _seconds(r)[s], smoother.smooth(own, regimes, noise)
            t = t - t[0]
            K[s] = np.interp(t, own.t, x.level)
            sigma[s] = np.interp(t, own.t, x.level_sigma)
            missed[s] = _missed(t, own.t, x.level)
            measured[s] = False
            measured[s.start + np.searchsorted((t[1:] + t[:-1]) / 2.0, own.t)] = True
        found.append(_Clamping(K, sigma, missed, measured))
    return found


def _pressed(run: AxleRecord) -> list[slice]:
    """Where K > 0, with one sample of the zero on either side; short zeros are noise."""
    off = run.clamping_force_smooth <= 0.0
    for first, past in true_runs(off):
        off[first:past] = past - first >= _ZEROS or first == 0 or past == len(run)
    n = len(run)
    spans = [slice(max(a - 1, 0), min(b + 1, n)) for a, b in true_runs(~off)]
    return [s for s in spans if s.stop - s.start > 1]


def _piece(run: AxleRecord, s: slice) -> smoother.Run:
    """The pressure's own samples of a piece, not those interpolated to the wheel's times.

    A slow pressure that repeats its value is taken as sampled as often as where it changes.
    """
    held, K, t = run.clamping_force[s], run.clamping_force_smooth[s], _seconds(run)[s]
    own = np.diff(held, prepend=np.nan) != 0.0
    same = held == K
    changes = t[own]
    if same.all() or len(changes) < 3:
        own |= same
    else:
        interval = float(np.median(np.diff(changes)))
        for first, past in true_runs(same):
            count = max(round((t[past - 1] - t[first]) / interval), 1) + 1
            own[first + np.round(np.linspace(0, past - 1 - first, count)).astype(int)] = True
    own[[0, -1]] = True
    return smoother.Run((t - t[0])[own], K[own], *np.zeros((5, np.sum(own))))


def _missed(t: Floats, known: Floats, x: Floats) -> Floats:
    """Possible error at the times t of straight lines between x at `known`, shape (n,)."""
    after = np.clip(np.searchsorted(known, t), 1, len(known) - 1)
    part = (t - known[after - 1]) / (known[after] - known[after - 1])
    missed: Floats = _bend(x)[after] * part * (1.0 - part)
    return missed


def _seconds(run: AxleRecord) -> Floats:
    since: Floats = (run.t - run.t[0]) * 1e-9
    return since


def _step(runs: list[smoother.Run]) -> float:
    """Median interval [s]."""
    return float(np.median(np.concatenate([np.diff(r.t) for r in runs])))


def _sample(runs: list[smoother.Run]) -> list[smoother.Run]:
    """The runs, or blocks of a long log for the fit: half spread evenly, half the roughest.

    Slides are rare, and noise levels fitted without them would be wrong for them.
    """
    if sum(len(r.t) for r in runs) <= _FIT:
        return runs
    blocks = [
        smoother.Run(*(column[i : i + _BLOCK] for column in r))
        for r in runs
        for i in range(0, len(r.t), _BLOCK)
    ]
    half = min(_FIT // _BLOCK // 2, len(blocks))
    rough = np.argsort([-np.sum(np.diff(b.y, 2) ** 2) for b in blocks], kind="stable")[:half]
    even = np.linspace(0, len(blocks) - 1, half).astype(int)
    return [blocks[i] for i in sorted({*rough, *even})]


# Butterworth: the paper's way


def _butterworth(runs: list[AxleRecord], ripples: list[Floats], w: Wheelset) -> list[Parts]:
    """Zero-phase Butterworth low pass on ω, differentiated; K as the smoother has it.

    Each run is resampled to its median interval, filtered forwards and backwards, and put back to
    its own times. The removed noise is taken as white; sigma is the part of it that passes the
    filter, and the noise of K.
    """
    from scipy.signal import butter, sosfiltfilt

    found = []
    for run, ripple, c in zip(runs, ripples, _clamping(runs), strict=True):
        t, y = _seconds(run), run.wheel_speed - ripple
        n = len(t)
        even = np.linspace(0.0, t[-1], max(n, round(t[-1] / float(np.median(np.diff(t)))) + 1))
        rate = (len(even) - 1) / t[-1]
        cutoff = min(_CUTOFF, 0.4 * rate)
        sos = butter(2, cutoff, fs=rate, output="sos")
        pad = min(len(even) - 1, round(3.0 * rate / cutoff))
        speed = np.interp(even, t, y)
        smooth = sosfiltfilt(sos, speed, padlen=pad)
        pulse = np.zeros(2 * pad + 3)
        pulse[pad + 1] = 1.0
        kernel = np.gradient(sosfiltfilt(sos, pulse, padlen=0), 1.0 / rate)
        removed = float(np.std(y - np.interp(t, even, smooth)))
        noise = max(removed, math.sqrt(float(np.mean(run.wheel_speed_steps**2)) / 12.0))
        speed_sigma = noise * math.sqrt(kernel @ kernel)
        acceleration = np.interp(t, even, np.gradient(smooth, 1.0 / rate))
        K, sigma = _noise(c, (acceleration, np.full(n, speed_sigma)), w)
        found.append(Parts(K, acceleration, sigma))
    return found


METHODS: dict[str, Method] = {
    "smoother": Method(
        "Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445; Barber, J. Mach. Learn. Res. 7 (2006) 2515",
        _smoother,
    ),
    "butterworth": Method("Wu, Peng, Li, section 4", _butterworth),
}
