"""The response of the brakes: delay and build-up of each axle."""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from ..core.masks import true_runs
from ..core.model import Floats, Parameter
from ..core.physics import SLOW
from .find import BEGUN, Braking
from .signals import DROP, FAST, StopSignals, TimeSeries, brake_levels, quantisation_step
from .speed import CREEP, SmoothSpeed

FULL_SHARE = 0.95  # of the full value of a brake: the build-up ends
_LONGEST_BUILD_UP = 0.5  # of the braking: what is later is another brake, or the driver
_QUARTER = 0.25  # of the full value: nothing disturbs the build-up before it
_LEVEL_ERROR = 0.005  # 1 sigma of the full value, as a share of it
_COASTING_TIME = 3.0  # before the command, in which the train coasts [s]
_BIN, _MEMORY = 0.1, 1.0  # a speed is averaged, and the fit has one error, over so long [s]
_FEWEST_BINS, _COASTS = 5, 0.25  # before the command; a train that slows by more does not coast
_TRIED = 16  # begins and durations of a build-up that are tried
_LEAST_NOISE = 0.005  # 1 sigma of a mean speed [m/s]
_CHANGE = 0.2  # 1 sigma of the change of a deceleration from the highest speed to none, as a share
_SHORTEST_FIT = 1.0  # [s]
_STEADY = 0.02  # change of a share from the last eighth but one to the last: it is built up
_IMPOSSIBLE = 1e6  # mean square of what cannot be [m²/s²]
# shapes of a build-up: ∫ r dt over the time to 95 or 100 %
_BUILD_UPS: tuple[Callable[[Floats], Floats], ...] = (
    lambda x: np.minimum(x, 1.0) ** 2 / 2.0 + np.maximum(x - 1.0, 0.0),
    lambda x: x + np.expm1(-3.0 * x) / 3.0,
    lambda x: np.minimum(x, 1.0) ** 3 - np.minimum(x, 1.0) ** 4 / 2.0 + np.maximum(x - 1.0, 0.0),
)
_CREEPS = 0.02  # slip of a wheel from which it slides where it goes on to `_SLIDES`
_SLIDES = 0.05  # slip of a wheel that slides


class BrakeResponse(NamedTuple):
    """When the brakes of all axles build up, after the command; NaN where it is not defined."""

    delay: Parameter  # [s]
    equivalent: Parameter  # [s]
    full_value: float  # of the brake, mean over the axles: pressure [Pa] or force [N]
    build_up: float = math.nan  # how long it takes, by its first quarter where it is disturbed [s]
    source: Literal["brakes", "deceleration"] = "brakes"  # of `equivalent`

    @property
    def by_speed(self) -> bool:
        """Whether the deceleration shows it."""
        return self.source == "deceleration"


def find_response(
    signals: StopSignals,
    command: float,
    braking: Braking,
    start_share: float,
    smooth: SmoothSpeed,
) -> BrakeResponse:
    """The mean response of all axles, weighted by their brakes.

    It is not defined where WSP or a slide disturbs the build-up, nor where a pressure is at the end
    of its sensor's range, nor where the log begins after the command. Where another brake acts, or
    other cars brake later than the axles of the log, the train's `smooth` speed shows the response.
    The delay ends at `start_share` of the full brake.
    """
    delays, build_ups, weights = list[Parameter](), list[Parameter](), list[float]()
    quarters, shares = list[float](), list[TimeSeries]()
    unknown = Parameter(math.nan, math.nan)
    if braking.reason == BEGUN:
        return BrakeResponse(unknown, unknown, math.nan)
    if np.any((signals.saturated > command) & (signals.saturated < braking.stop)):
        return BrakeResponse(unknown, unknown, math.nan)  # nobody knows the full value
    disturbed = False
    for axle, brake in signals.brakes.items():
        released, full_value, noise = brake_levels(brake, braking.start, braking.stop)
        span = full_value - released
        window = brake.cut(command - 0.5, braking.stop)
        if span < 10.0 * noise or span <= 0.0 or len(window.t) < 2:
            continue
        share = (window.value - released) / span
        error = math.hypot(noise, quantisation_step(window.value) / math.sqrt(12.0)) / span
        t, begin_share = window.t - command, start_share or 5.0 * noise / span
        delay = _crossing(t, share, begin_share, error)
        build_up_end = _crossing(t, share, FULL_SHARE, math.hypot(error, _LEVEL_ERROR))
        if delay is None or build_up_end is None:
            disturbed = True
            continue
        # A valve that acts as soon after it cuts the last rise off: the full value is not known.
        rising = share[t <= 2.0 * build_up_end.value - delay.value]
        rising = rising[np.isfinite(rising)]
        fall = np.max(np.maximum.accumulate(rising) - rising) if len(rising) else 0.0
        disturbed |= bool(fall > DROP) or _slides(signals, axle, command, build_up_end.value)
        delays.append(delay)
        build_ups.append(build_up_end)
        weights.append(span)
        shares.append(TimeSeries(t, share))
        quarters.append(float(t[np.argmax(share >= _QUARTER)]) - delay.value)
    if not weights:
        return BrakeResponse(unknown, unknown, math.nan)
    delay, full_time = (
        Parameter(*np.average(times, axis=0, weights=weights).tolist())
        for times in (delays, build_ups)
    )
    longest, mean_weight = max(x.value for x in build_ups), float(np.mean(weights))
    is_disturbed = disturbed or longest > _LONGEST_BUILD_UP * (braking.stop - command)
    filling = max(quarters) / _QUARTER if is_disturbed else full_time.value
    others = any(f.overlaps(command, command + longest) for f in signals.other_brakes)
    if signals.others_later or others:
        equivalent = unknown
        if smooth.interval <= FAST:
            columns = [np.interp(shares[0].t, *x) for x in shares]
            mean = TimeSeries(shares[0].t, np.average(columns, axis=0, weights=weights))
            equivalent = (
                _response_by_speed(signals, mean, smooth.interval, command, braking.stop) or unknown
            )
        delay = unknown if signals.others_later else delay
        return BrakeResponse(delay, equivalent, mean_weight, filling, source="deceleration")
    if is_disturbed:
        return BrakeResponse(delay, unknown, mean_weight, filling)
    sigma = math.hypot(delay.tolerance, full_time.tolerance) / 2.0
    equivalent = Parameter((delay.value + full_time.value) / 2.0, sigma)
    return BrakeResponse(delay, equivalent, mean_weight, filling)


def _response_by_speed(
    signals: StopSignals, share: TimeSeries, interval: float, command: float, stop: float
) -> Parameter | None:
    """The response of all brakes by the deceleration, and 1 sigma [s].

    The speed of a train that coasts, and is braked with the share q of the logged brakes, and from
    t_0 on with the share r of those that no channel shows,

        v = v_0 + c t - a Q - b R - d ∫ (1 - v/v_0) dt,  Q = ∫ q dt, R = ∫ r dt,

    is fitted to the first half of the braking, or until such a brake ends. d is the change of the
    deceleration with the speed, within `_CHANGE` of it. r rises at any time, within any time, in a
    line, by saturation or as an S. At the end t of that, the line of the speed at established
    deceleration meets that of coasting at t - (a Q + b R) / (a q + b). The response is its mean
    over all r by their likelihood. None where the brakes are not built up by then, where a wheel
    slides, and where the train slows before the command. Wheels that show the speed creep by a
    share of it, and seem to slow earlier. `share` is q after the command, `interval` that between
    readings [s].
    """
    ends = [b - command for f in signals.other_brakes for _, b in f.spans if b > command]
    end = min([_LONGEST_BUILD_UP * (stop - command), *ends])
    run = signals.speed.cut(command - _COASTING_TIME, command + end)
    finite = np.isfinite(run.value)
    slid = any(_slides(signals, axle, command, end) for axle in signals.rims)
    if slid or end < _SHORTEST_FIT or not finite.any():
        return None
    bins = np.floor((run.t[finite] - command) / _BIN)
    _, places, counts = np.unique(bins, return_inverse=True, return_counts=True)
    t, v = (np.bincount(places, x[finite]) / counts for x in (run.t - command, run.value))
    fine: Floats = np.arange(0.0, end, 0.01)
    q = np.nan_to_num(np.interp(fine, *share))
    eighth = max(len(q) // 8, 1)
    lost = float(v[0] - v[-1])
    before = t < 0.0
    if (
        len(t) < _TRIED
        or lost <= 0.0
        or before.sum() < _FEWEST_BINS
        or -np.polyfit(t[before], v[before], 1)[0] > _COASTS * lost / end
        or abs(q[-2 * eighth : -eighth].mean() - q[-eighth:].mean()) > _STEADY
    ):
        return None
    loss_share = np.maximum(1.0 - np.interp(fine, t, v) / np.interp(0.0, t, v), 0.0)
    Q, D = (np.interp(t, fine, 0.01 * (np.cumsum(x) - x / 2.0)) for x in (q, loss_share))
    fixed = np.stack([np.ones_like(t), t, -Q, -D], axis=-1)
    fit = _SpeedFit(t, v - v[0], fixed, _LEAST_NOISE * end / (_CHANGE * lost), float(q[-1]))
    responses, losses, logs = list[Floats](), list[Floats](), list[Floats]()
    for build_up in _BUILD_UPS:
        starts, rises = np.linspace(0.0, end, _TRIED), end * np.linspace(0.02, 1.0, _TRIED)
        for _ in range(2):
            response, loss = fit.of_build_ups(build_up, starts, rises)
            cell = np.ptp(starts) * np.ptp(rises)
            i, j = np.unravel_index(np.argmin(loss), loss.shape)
            starts, rises = (
                np.linspace(
                    max(x[k] - 2.0 * (x[1] - x[0]), low), x[k] + 2.0 * (x[1] - x[0]), _TRIED
                )
                for x, k, low in ((starts, i, 0.0), (rises, j, 0.01 * end))
            )
        responses.append(response.ravel())
        losses.append(loss)
        logs.append(-0.5 * np.ptp(t) / _MEMORY * np.log(loss.ravel()) + math.log(cell))
    if np.min(losses) >= _IMPOSSIBLE:
        return None
    all_logs = np.concatenate(logs)
    weights, times = np.exp(all_logs - np.max(all_logs)), np.concatenate(responses)
    mean = float(np.average(times, weights=weights))
    variance = float(np.average((times - mean) ** 2, weights=weights))
    if signals.by_wheels:
        creep, creep_sigma = (x * float(np.interp(0.0, t, v)) for x in CREEP)
        mean, variance = mean + creep, variance + creep_sigma**2
    return Parameter(mean, math.hypot(math.sqrt(variance), 0.25 * interval))


class _SpeedFit(NamedTuple):
    """What is fitted to a speed, see `_response_by_speed`."""

    t: Floats  # after the command (n,) [s]
    v: Floats  # less the first one (n,) [m/s]
    fixed: Floats  # factors of v_0, c, a and d (n, 4)
    prior: float  # weight of d = 0
    last_share: float  # q at the end

    def of_build_ups(
        self, build_up: Callable[[Floats], Floats], starts: Floats, rises: Floats
    ) -> tuple[Floats, Floats]:
        """Response and mean square of what is left, (starts, rises), of each build-up."""
        start, rise = starts[:, None, None], rises[:, None]
        R = rise * build_up(np.maximum(self.t - start, 0.0) / rise)
        shape = (len(starts), len(rises), *self.fixed.shape)
        columns = np.concatenate([np.broadcast_to(self.fixed, shape), -R[..., None]], axis=-1)
        normal = np.swapaxes(columns, -1, -2) @ columns
        normal += np.diag([0.0, 0.0, 1e-6, self.prior**2, 1e-6])
        x = np.linalg.solve(normal, (self.v @ columns)[..., None])[..., 0]
        left = self.v - (columns @ x[..., None])[..., 0]
        _, _, a, d, b = np.moveaxis(x, -1, 0)
        end_rate = np.maximum(a * self.last_share + b, 1e-3)
        response = self.t[-1] - (a * -self.fixed[-1, 2] + b * R[..., -1]) / end_rate
        loss = np.mean(left**2, axis=-1) + (self.prior * d) ** 2 / len(self.t) + _LEAST_NOISE**2
        possible = (a > 0.0) & (b > 0.0) & (starts[:, None] + rises < self.t[-1])
        return response, np.where(possible, loss, _IMPOSSIBLE)


def _crossing(t: Floats, share: Floats, level: float, error: float) -> Parameter | None:
    """The first time at which a rising share of the full brake reaches a level, between samples.

    `error` is 1 sigma of the share: the flatter it rises, the less is its time known.
    """
    reached = np.flatnonzero(share >= level)
    if not len(reached):
        return None
    k = int(reached[0])
    interval = float(np.median(np.diff(t)))
    upper_places, lower_places = (
        np.flatnonzero(share >= level + x) for x in (2.0 * error, -2.0 * error)
    )
    spread = t[upper_places[0]] - t[lower_places[0]] if len(upper_places) else t[-1] - t[k]
    sigma = math.hypot(float(spread) / 4.0, 0.25 * interval)
    if k == 0 or not share[k - 1] < level:
        return Parameter(float(t[k]), sigma)
    fraction = (level - share[k - 1]) / (share[k] - share[k - 1])
    return Parameter(float(t[k - 1] + fraction * (t[k] - t[k - 1])), sigma)


def _slides(signals: StopSignals, axle: int, command: float, build_up: float) -> bool:
    """Whether an axle begins to slide while its brake builds up [s]."""
    if axle not in signals.rims:
        return False
    rim = signals.rims[axle].cut(command, math.inf)
    v = signals.least_speed(rim.t)
    with np.errstate(divide="ignore", invalid="ignore"):
        slip = np.where(v > SLOW, 1.0 - rim.value / v, 0.0)
        runs = true_runs(slip > _CREEPS)
        return any(rim.t[a] - command < build_up and np.max(slip[a:b]) > _SLIDES for a, b in runs)
