"""The response of the brakes: delay and build-up of each axle."""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from ..core.masks import true_runs
from ..core.model import Floats, Parameter
from ..core.physics import SLOW
from .find import BEGUN, Braking
from .signals import DROP, FAST, GAP, StopSignals, TimeSeries, brake_levels, quantisation_step
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
_ANY_CHANGE = 1.0  # the same of cast iron
_SHORTEST_FIT = 1.0  # [s]
_STEADY = 0.02  # change of a share from the last eighth but one to the last: it is built up
_UNSEEN = 1.0  # longest time between two samples of a brake whose rise is seen [s]
_LEVEL_TIME = 0.4  # a share that is constant for so long is a level [s]
_IMPOSSIBLE = 1e6  # mean square of what cannot be [m²/s²]
_SURE_SIGMAS = 2.0  # by which the responses of brakes and deceleration may differ
_ALIKE = 0.1  # by which both may differ besides [s]
_FRICTION_SHARE = 0.3  # of the response, by which friction that changes with the force moves it
_DELAY_STEP = 0.02  # of the times at which a delay may end [s]
_FIRST_SHARE = 0.02  # of the full deceleration: it begins, where no share is stated
_CREEPS = 0.02  # slip of a wheel from which it slides where it goes on to `_SLIDES`
_SLIDES = 0.05  # slip of a wheel that slides


class _BuildUp(NamedTuple):
    """A shape of a build-up over the time, which is 1 at 95 or 100 %."""

    share: Callable[[Floats], Floats]  # r
    integral: Callable[[Floats], Floats]  # ∫ r dt


_BUILD_UPS = (
    _BuildUp(
        lambda x: np.minimum(x, 1.0),
        lambda x: np.minimum(x, 1.0) ** 2 / 2.0 + np.maximum(x - 1.0, 0.0),
    ),
    _BuildUp(lambda x: -np.expm1(-3.0 * x), lambda x: x + np.expm1(-3.0 * x) / 3.0),
    _BuildUp(
        lambda x: 3.0 * np.minimum(x, 1.0) ** 2 - 2.0 * np.minimum(x, 1.0) ** 3,
        lambda x: (
            np.minimum(x, 1.0) ** 3 - np.minimum(x, 1.0) ** 4 / 2.0 + np.maximum(x - 1.0, 0.0)
        ),
    ),
)


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
    quarters = list[float]()
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
        if delay is None or build_up_end is None or _rises_in_gap(brake, command):
            disturbed = True
            continue
        disturbed |= _is_vented(t, share, 2.0 * build_up_end.value - delay.value)
        disturbed |= _slides(signals, axle, command, build_up_end.value)
        delays.append(delay)
        build_ups.append(build_up_end)
        weights.append(span)
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
    acts = (
        signals.others_later
        or signals.mix_unknown
        or any(f.overlaps(command, command + longest) for f in signals.other_brakes)
    )
    by_speed = None
    if smooth.interval <= FAST and (acts or not is_disturbed):
        shown = _force_share(signals, command, braking)
        by_speed = _response_by_speed(signals, shown, command, braking, start_share, acts)
    difference = _sure_difference(signals, by_speed, command, braking) if by_speed else 0.0
    if acts or (by_speed and difference > _ALIKE + _FRICTION_SHARE * by_speed.of_shown):
        delay, equivalent = (by_speed.delay, by_speed.equivalent) if by_speed else [unknown] * 2
        return BrakeResponse(delay, equivalent, mean_weight, filling, source="deceleration")
    if is_disturbed:
        return BrakeResponse(delay, unknown, mean_weight, filling)
    sigma = math.hypot(math.hypot(delay.tolerance, full_time.tolerance) / 2.0, difference)
    equivalent = Parameter((delay.value + full_time.value) / 2.0, sigma)
    return BrakeResponse(delay, equivalent, mean_weight, filling)


class _ResponseBySpeed(NamedTuple):
    """The response of all brakes, whether a channel shows them or not [s]."""

    delay: Parameter
    equivalent: Parameter
    of_shown: float  # that of the brakes which channels show, by their force


def _sure_difference(
    signals: StopSignals, by_speed: _ResponseBySpeed, command: float, braking: Braking
) -> float:
    """By how much the responses of brakes and deceleration differ [s]; 0 within their errors.

    Much of it is another brake, which no channel shows. Little may be a friction that changes with
    the force of the blocks.
    """
    stop, is_later = braking.stop - command, by_speed.equivalent.value > by_speed.of_shown
    slid = is_later and any(_slides(signals, axle, command, stop) for axle in signals.rims)
    if slid or (is_later and signals.speed_from == "axles"):
        return 0.0  # a slippery rail makes the train slow later, too
    by_train = 0.0 if signals.wheels_show_begin else signals.delay_sigma
    error = math.hypot(by_speed.equivalent.tolerance, signals.pressure_sigma, by_train)
    difference = abs(by_speed.equivalent.value - by_speed.of_shown)
    return difference if difference > _SURE_SIGMAS * error + _ALIKE else 0.0


def _force_share(signals: StopSignals, command: float, braking: Braking) -> TimeSeries:
    """The share of the full force that all brakes with a channel have, after the command."""
    columns, full_force, t = list[Floats](), 0.0, np.empty(0)
    for axle, brake in signals.brakes.items():
        force = signals.clamping.get(axle, brake)
        released, full_value, _ = brake_levels(force, braking.start, braking.stop)
        if not columns:
            t = force.cut(command - 0.5, braking.stop).t
        columns.append(force.interpolated(t) - released)
        full_force += full_value - released
    share = np.nan_to_num(np.nansum(columns, axis=0) / max(full_force, 1e-9))
    return TimeSeries(t - command, share)


def _rolling_speed(signals: StopSignals) -> TimeSeries:
    """The mean speed of the wheels where it shows the begin of a braking, else the train's."""
    if not signals.rims or not signals.wheels_show_begin:
        return signals.speed
    t = signals.speed.t
    return TimeSeries(t, np.mean([rim.interpolated(t) for rim in signals.rims.values()], axis=0))


def _response_by_speed(
    signals: StopSignals,
    share: TimeSeries,
    command: float,
    braking: Braking,
    start_share: float,
    acts: bool,
) -> _ResponseBySpeed | None:
    """The response of all brakes by the deceleration.

    The speed of a train that coasts, and is braked with the share q of the logged brakes, and from
    t_0 on with the share r of those that no channel shows,

        v = v_0 + c t - a Q - b R - d ∫ (1 - v/v_0) dt,  Q = ∫ q dt, R = ∫ r dt,

    is fitted to the first half of the braking, or until such a brake ends. d is the change of the
    deceleration with the speed, within `_CHANGE` of it. r rises at any time, within any time, in a
    line, by saturation or as an S. At the end t of that, the line of the speed at established
    deceleration meets that of coasting at t - (a Q + b R) / (a q + b). The response is its mean
    over all r by their likelihood, and the delay that of the time at which a q + b r has the share
    `start_share` of its end. None where the brakes are not built up by then, where a wheel slides,
    and where the train slows before the command. Wheels creep by a share of their speed, and seem
    to slow earlier. `share` is q after the command; `acts` whether such a brake is known to act.
    """
    ends = [b - command for f in signals.other_brakes for _, b in f.spans if b > command]
    end = min([_LONGEST_BUILD_UP * (braking.stop - command), *ends])
    run = _rolling_speed(signals).cut(command - _COASTING_TIME, command + end)
    finite = np.isfinite(run.value)
    # a rail that limits the brakes makes a train slow later, too, before any wheel slides
    slip = _SLIDES if acts else _CREEPS
    slid = any(_slides(signals, axle, command, end, slip) for axle in signals.rims)
    if slid or end < _SHORTEST_FIT or not finite.any():
        return None
    bins = np.floor((run.t[finite] - command) / _BIN)
    _, places, counts = np.unique(bins, return_inverse=True, return_counts=True)
    t, v = (np.bincount(places, x[finite]) / counts for x in (run.t - command, run.value))
    fine: Floats = np.arange(0.0, end, 0.01)
    q = np.interp(fine, *share)
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
    change = _CHANGE if acts else _ANY_CHANGE
    prior, coarse = _LEAST_NOISE * end / (change * lost), round(_DELAY_STEP / 0.01)
    begin_share = start_share or _FIRST_SHARE
    fit = _SpeedFit(t, v - v[0], fixed, prior, fine[::coarse], q[::coarse], begin_share)
    times = _likeliest_times(fit, end)
    if times is None:
        return None
    delay, equivalent = times
    if signals.wheels_show_begin:
        creep, creep_sigma = (x * float(np.interp(0.0, t, v)) for x in CREEP)
        delay, equivalent = (
            Parameter(x.value + creep, math.hypot(x.tolerance, creep_sigma))
            for x in (delay, equivalent)
        )
    interval = float(np.median(np.diff(run.t)))
    delay, equivalent = (
        x._replace(tolerance=math.hypot(x.tolerance, 0.25 * interval)) for x in (delay, equivalent)
    )
    shown = float(fine[-1]) - 0.01 * float(np.sum(q)) / max(float(q[-1]), 1e-3)
    return _ResponseBySpeed(delay, equivalent, shown)


def _likeliest_times(fit: "_SpeedFit", end: float) -> tuple[Parameter, Parameter] | None:
    """Delay and response by their likelihood, within a time after the command; None: no fit [s]."""
    times_tried, losses, logs = list[Floats](), list[Floats](), list[Floats]()
    for build_up in _BUILD_UPS:
        starts, rises = np.linspace(0.0, end, _TRIED), end * np.linspace(0.02, 1.0, _TRIED)
        for _ in range(2):
            times, loss = fit.of_build_ups(build_up, starts, rises)
            cell = np.ptp(starts) * np.ptp(rises)
            i, j = np.unravel_index(np.argmin(loss), loss.shape)
            starts, rises = (
                np.linspace(
                    max(x[k] - 2.0 * (x[1] - x[0]), low), x[k] + 2.0 * (x[1] - x[0]), _TRIED
                )
                for x, k, low in ((starts, i, 0.0), (rises, j, 0.01 * end))
            )
        times_tried.append(times.reshape(2, -1))
        losses.append(loss)
        logs.append(-0.5 * np.ptp(fit.t) / _MEMORY * np.log(loss.ravel()) + math.log(cell))
    if np.min(losses) >= _IMPOSSIBLE:
        return None
    all_logs = np.concatenate(logs)
    weights = np.exp(all_logs - np.max(all_logs))
    delay, response = (
        Parameter(
            mean := float(np.average(x, weights=weights)),
            math.sqrt(float(np.average((x - mean) ** 2, weights=weights))),
        )
        for x in np.concatenate(times_tried, axis=1)
    )
    return delay._replace(tolerance=math.hypot(delay.tolerance, _DELAY_STEP)), response


class _SpeedFit(NamedTuple):
    """What is fitted to a speed, see `_response_by_speed`."""

    t: Floats  # after the command (n,) [s]
    v: Floats  # less the first one (n,) [m/s]
    fixed: Floats  # factors of v_0, c, a and d (n, 4)
    prior: float  # weight of d = 0
    coarse: Floats  # times after the command (m,) [s]
    q: Floats  # at these times (m,)
    start_share: float  # of the full brake: the delay ends

    def of_build_ups(
        self, build_up: _BuildUp, starts: Floats, rises: Floats
    ) -> tuple[Floats, Floats]:
        """Delay and response, (2, starts, rises), and mean square of what is left.

        The latter is (starts, rises), for each build-up.
        """
        start, rise = starts[:, None, None], rises[:, None]
        R = rise * build_up.integral(np.maximum(self.t - start, 0.0) / rise)
        shape = (len(starts), len(rises), *self.fixed.shape)
        columns = np.concatenate([np.broadcast_to(self.fixed, shape), -R[..., None]], axis=-1)
        normal = np.swapaxes(columns, -1, -2) @ columns
        normal += np.diag([0.0, 0.0, 1e-6, self.prior**2, 1e-6])
        x = np.linalg.solve(normal, (self.v @ columns)[..., None])[..., 0]
        left = self.v - (columns @ x[..., None])[..., 0]
        _, _, a, d, b = np.moveaxis(x, -1, 0)
        end_rate = np.maximum(a * self.q[-1] + b, 1e-3)
        response = self.t[-1] - (a * -self.fixed[-1, 2] + b * R[..., -1]) / end_rate
        r = build_up.share(np.maximum(self.coarse - start, 0.0) / rise)
        has_begun = a[..., None] * self.q + b[..., None] * r >= (
            self.start_share * end_rate[..., None]
        )
        delay = self.coarse[np.argmax(has_begun, axis=-1)]
        loss = np.mean(left**2, axis=-1) + (self.prior * d) ** 2 / len(self.t) + _LEAST_NOISE**2
        possible = (a > 0.0) & (b > 0.0) & (starts[:, None] + rises < self.t[-1])
        return np.stack([delay, response]), np.where(possible, loss, _IMPOSSIBLE)


def _crossing(t: Floats, share: Floats, level: float, error: float) -> Parameter | None:
    """The first time at which a rising share of the full brake reaches a level, between samples.

    `error` is 1 sigma of the share: the flatter it rises, the less is its time known. It is reached
    anywhere in a gap of the log.
    """
    known = np.isfinite(share)
    t, share = t[known], share[known]
    reached = np.flatnonzero(share >= level)
    if not len(reached):
        return None
    k = int(reached[0])
    interval = float(np.median(np.diff(t)))
    upper_places, lower_places = (
        np.flatnonzero(share >= level + x) for x in (2.0 * error, -2.0 * error)
    )
    spread = t[upper_places[0]] - t[lower_places[0]] if len(upper_places) else t[-1] - t[k]
    gap = float(t[k] - t[k - 1]) if k else 0.0
    in_gap = gap / math.sqrt(12.0) if gap > GAP * interval else 0.0
    sigma = math.hypot(float(spread) / 4.0, 0.25 * interval, in_gap)
    if k == 0 or not share[k - 1] < level:
        return Parameter(float(t[k]), sigma)
    fraction = (level - share[k - 1]) / (share[k] - share[k - 1])
    return Parameter(float(t[k - 1] + fraction * (t[k] - t[k - 1])), sigma)


def _rises_in_gap(brake: TimeSeries, command: float) -> bool:
    """Whether a brake has no samples near the command: its rise is not seen."""
    t = brake.t[np.isfinite(brake.value)]
    first_index, last_index = np.searchsorted(t, [command - _UNSEEN, command + _UNSEEN])
    longest = float(np.max(np.diff(t[max(first_index - 1, 0) : last_index + 1]), initial=0.0))
    return bool(t[0] > command or longest > max(_UNSEEN, 3.0 * float(np.median(np.diff(t)))))


def _is_vented(t: Floats, share: Floats, window_end: float) -> bool:
    """Whether a valve cuts the rise of a brake off: the full value is not known.

    It acts as soon after the build-up as that lasts, until `window_end` [s], and no level comes
    before.
    """
    run = (t <= window_end) & np.isfinite(share)
    t, share = t[run], share[run]
    falls = np.maximum.accumulate(share) - share
    if not (falls > DROP).any():
        return False
    level_end = int(np.flatnonzero(falls[: int(np.argmax(falls > DROP))] < _STEADY)[-1])
    level = share[(t > t[level_end] - _LEVEL_TIME) & (t <= t[level_end])]
    if len(level) < 4:
        return True
    halves = np.array_split(level, 2)
    return abs(float(np.mean(halves[0]) - np.mean(halves[1]))) > _STEADY


def _slides(
    signals: StopSignals, axle: int, command: float, build_up: float, limit: float = _SLIDES
) -> bool:
    """Whether an axle begins to slip by more than a limit while its brake builds up [s]."""
    if axle not in signals.rims:
        return False
    rim = signals.rims[axle].cut(command, math.inf)
    v = signals.least_speed(rim.t)
    with np.errstate(divide="ignore", invalid="ignore"):
        slip = np.where(v > SLOW, 1.0 - rim.value / v, 0.0)
        runs = true_runs(slip > _CREEPS)
        return any(rim.t[a] - command < build_up and np.max(slip[a:b]) > limit for a, b in runs)
