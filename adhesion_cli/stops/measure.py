"""One stop, measured: distance, deceleration and response time, with expanded uncertainties.

Equations, with v0 the speed at the command and s the stopping distance:

    response time            t_e = t_a + t_ab / 2, over the axles weighted by brake force
    mean deceleration        a_m = v0² / (2 s)
    equivalent deceleration  a_e = v0² / (2 (s − v0 t_e))
    on level track           a_level = a_e − g i / (1000 ρ)
    at nominal speed         s_n = v_n t_e + v_n² / (2 a_level)
    without a response time  s_n = s · 3.933 ρ V_n² / (3.933 ρ V_0² − i s), V in km/h

The brake force of a train changes with the speed and is built up slowly, so that neither s_n is
exact: their difference is in the uncertainty of both.

t_a is the delay until the brake has the start share of its full value, t_ab the time from there to
95 %; i is the gradient in ‰, uphill positive; ρ the factor of the rotating mass.

Sources: mean deceleration: StrabVO, annex 1. Response: SUBSET-026, 3.13.2.2.3.2; EN 14531-1.
Uncertainty: JCGM 100, 5.1.2.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..core.model import Parameter
from ..core.physics import BAR, SLOW, G
from ..core.summary import Measured, StopContribution, StopSummary
from .axle_stops import all_axles_slide, axle_stops, on_time
from .command import find_command
from .find import Braking
from .response import BrakeResponse, find_response
from .settings import StopSettings
from .signals import StopSignals, TimeSeries
from .speed import FIT, largest_jerk, locked_time, over_slides, smoothed_speed

K95 = 2.0  # coverage factor
_CREEP = 0.08  # 1 sigma of a jerk by wheels, as a share: their creep builds up with the brake
NOMINAL_SPEEDS = (30, 50, 60, 80, 100, 120, 140, 160, 200)  # [km/h]


class ToLevel(NamedTuple):
    """What turns a stop into one on level track."""

    gradient: Parameter  # uphill positive [‰]
    rotating: float  # ρ, factor of the rotating mass


class _Values(NamedTuple):
    """What is measured itself."""

    v0: float
    distance: float
    duration: float
    delay: float
    response: float
    gradient: float


def measure_stop(
    signals: StopSignals, braking: Braking, to_level: ToLevel, settings: StopSettings
) -> StopSummary:
    """The figures of one braking."""
    command, command_u, source = find_command(signals, braking)
    if source == "pressure":
        command -= settings.dead_time
    smooth = smoothed_speed(signals.speed, command, braking.stop, _reading_interval(signals))
    t, v = smooth.t, smooth.v
    hidden, locked = 0.0, Parameter(0.0, 0.0)
    if signals.speed_from == "axles":
        locked = locked_time(signals.speed, t, v)
        v, hidden = over_slides(t, v)
        signals = signals._replace(speed=TimeSeries(t, v))
    v0 = float(np.interp(command, t, v))
    is_braking = t >= command - 1e-9
    distance = float(np.trapezoid(v[is_braking], t[is_braking]))
    by_sliding_wheels = signals.speed_from == "axles" and all_axles_slide(signals, command)
    is_shown = not (hidden or by_sliding_wheels or _is_coarse(signals, command, braking.stop))
    is_of_wheels = signals.speed_from == "axles" or signals.is_coarse is not None
    jerk = largest_jerk(smooth, command, _CREEP * is_of_wheels) if is_shown else None
    response = find_response(signals, command, braking, settings.start_share)
    nominal = settings.nominal_speed or float(
        min(NOMINAL_SPEEDS, key=lambda speed: abs(speed - 3.6 * v0))
    )
    delay, equivalent = response.delay.value, math.nan if hidden else response.equivalent.value
    gradient = to_level.gradient.value
    duration = braking.stop + locked.value - command
    values = _Values(v0, distance, duration, delay, equivalent, gradient)
    stop_u = math.hypot(braking.stop_sigma, locked.tolerance)
    build_up = response.delay.tolerance, response.equivalent.tolerance
    dead_time = _dead_time_sigma(response, settings) if source == "pressure" else 0.0
    sigmas = _Sigmas(smooth.noise, smooth.interval, command_u, stop_u, dead_time, hidden, *build_up)
    figures = _Figures(
        values, _errors(signals, settings, values, to_level, sigmas), nominal, to_level
    )
    valid = not braking.reason
    measured = figures.measured if valid else lambda _: None
    sanding = signals.sanding
    return StopSummary(
        start_s=command,
        end_s=braking.stop,
        command_from=source,
        speed_from=signals.speed_from,
        nominal_speed_kmh=nominal,
        valid=valid,
        reason=braking.reason or None,
        pressure_bar=_bar(response.full_value) if signals.by_pressure else None,
        initial_speed_mps=figures.measured("v0"),
        distance_m=measured("distance"),
        duration_s=measured("duration"),
        delay_s=figures.measured("delay"),
        response_time_s=figures.measured("response"),
        mean_deceleration=measured("mean"),
        equivalent_deceleration=measured("equivalent"),
        jerk=jerk and Measured(jerk.value, K95 * jerk.tolerance),
        corrected_distance_m=measured("corrected"),
        energy_distance_m=measured("by_energy"),
        axles=tuple(axle_stops(signals, command, braking, settings)),
        sanding_s=sanding and on_time(sanding.cut(command, braking.stop)),
        reservoir_drop_pa=_drop(signals.reservoir, command, braking.stop),
        budget=figures.budget(),
        speed=(t[is_braking] - command, np.where(smooth.is_read, v, np.nan)[is_braking]),
    )


def _reading_interval(signals: StopSignals) -> float:
    """Between readings of the speed [s]; of wheels, where they give its shape."""
    own_interval = 0.0 if signals.is_coarse is not None else signals.interval
    return max(float(np.median(np.diff(signals.speed.t))), own_interval)


def _is_coarse(signals: StopSignals, start: float, stop: float) -> bool:
    """Whether a train that moves has a slow speed without the shape of its wheels anywhere."""
    if signals.is_coarse is None:
        return False
    t, v = signals.speed
    is_moving = (t >= start) & (t <= stop) & (v > SLOW)
    return bool(signals.is_coarse[is_moving].any())


def _drop(reservoir: TimeSeries | None, start: float, stop: float) -> float | None:
    """By how much the reservoir's pressure falls below that at the command [Pa]."""
    if reservoir is None or not len(pressure := reservoir.cut(start, stop).value):
        return None
    return float(pressure[0] - np.min(pressure))


class _Figures:
    """All quantities of a stop, and how each source of error changes them.

    `errors` are the values changed by one standard uncertainty, by the source.
    """

    def __init__(
        self, values: _Values, errors: Mapping[str, _Values], nominal: float, to_level: ToLevel
    ) -> None:
        self._derived = _derive(values, nominal / 3.6, to_level.rotating)
        self._effects = {
            source: {
                name: x - self._derived[name]
                for name, x in _derive(changed, nominal / 3.6, to_level.rotating).items()
            }
            for source, changed in errors.items()
        }
        names = "corrected", "by_energy"
        between = self._derived["by_energy"] - self._derived["corrected"]
        error = between / math.sqrt(3.0) if math.isfinite(between) else 0.0
        self._effects[_FORMULA] = dict.fromkeys(self._derived, 0.0) | dict.fromkeys(names, error)

    def measured(self, name: str) -> Measured | None:
        """A quantity with its uncertainty; None where it is not known."""
        if not math.isfinite(self._derived[name]):
            return None
        squares = {source: effect[name] ** 2 for source, effect in self._effects.items()}
        common = sum(x for source, x in squares.items() if source in _COMMON)
        u, u_common = math.sqrt(sum(squares.values())), math.sqrt(common)
        return Measured(self._derived[name], K95 * u, K95 * u_common)

    def budget(self) -> tuple[StopContribution, ...]:
        """What each source contributes to distance and deceleration."""
        name = "equivalent" if math.isfinite(self._derived["equivalent"]) else "mean"
        return tuple(
            StopContribution(source, source in _COMMON, effect["distance"], effect[name])
            for source, effect in self._effects.items()
            if source != _FORMULA
        )


_LEAST_DEAD_TIME, _DEAD_TIME_SHARE = 0.2, 0.15  # [s], of the build-up: 1 sigma, assumed
_DEAD_TIME_ERROR = 0.1  # 1 sigma of a stated dead time, as a share of it
_FORMULA = "formula"  # of the corrected distance: the true one lies between those of both
# the same in every stop of a series
_COMMON = ("speed scale", "speed delay", "dead time", "gradient", _FORMULA)


class _Sigmas(NamedTuple):
    speed: float  # noise of one sample [m/s]
    interval: float  # between samples of the speed [s]
    command: float  # of the command time [s]
    standstill: float  # of the time of standstill [s]
    dead_time: float  # of a brake whose command is not logged [s]
    hidden: float  # of the distance, by slides of all axles [m]
    delay: float  # by noise and level of the brake [s]
    response: float  # the same [s]


def _bar(pressure: float) -> float | None:
    return pressure / BAR if math.isfinite(pressure) else None


def _dead_time_sigma(response: BrakeResponse, settings: StopSettings) -> float:
    """1 sigma of the time between a command that is not logged and the first rise [s].

    A slow brake is late, too: as a share of its build-up. A stated dead time is known better.
    """
    if settings.dead_time:
        return _DEAD_TIME_ERROR * settings.dead_time
    share = _DEAD_TIME_SHARE * response.build_up if math.isfinite(response.build_up) else 0.0
    return max(_LEAST_DEAD_TIME, share)


def _errors(
    signals: StopSignals,
    settings: StopSettings,
    values: _Values,
    to_level: ToLevel,
    sigmas: _Sigmas,
) -> dict[str, _Values]:
    """The measured values changed by one standard uncertainty of each source."""
    scale = settings.speed_scale or signals.scale
    v0, s = values.v0, values.distance
    interval, delay_sigma, command = sigmas.interval, signals.delay_sigma, sigmas.command
    fitted = max(FIT / max(interval, 1e-3), 1.0)
    return {
        "speed scale": values._replace(v0=v0 * (1.0 + scale), distance=s * (1.0 + scale)),
        "speed delay": values._replace(
            distance=s + v0 * delay_sigma, duration=values.duration + delay_sigma
        ),
        "speed noise": values._replace(
            v0=v0 + 1.5 * sigmas.speed / math.sqrt(fitted),
            distance=s + sigmas.speed * math.sqrt(interval * max(values.duration, 0.0)),
        ),
        "sliding axles": values._replace(distance=s + sigmas.hidden),
        "command time": values._replace(
            distance=s + v0 * command,
            duration=values.duration + command,
            delay=values.delay + command,
            response=values.response + command,
        ),
        "dead time": values._replace(
            distance=s + v0 * sigmas.dead_time,
            duration=values.duration + sigmas.dead_time,
            delay=values.delay + sigmas.dead_time,
            response=values.response + sigmas.dead_time,
        ),
        "build-up": values._replace(
            delay=values.delay + sigmas.delay, response=values.response + sigmas.response
        ),
        "standstill": values._replace(duration=values.duration + sigmas.standstill),
        "gradient": values._replace(gradient=values.gradient + to_level.gradient.tolerance),
    }


def _derive(x: _Values, nominal: float, rho: float) -> dict[str, float]:
    """All quantities from those that are measured; NaN where one is not known."""
    braked = x.distance - x.v0 * x.response
    mean = x.v0**2 / (2.0 * x.distance) if x.distance > 0.0 else math.nan
    equivalent = x.v0**2 / (2.0 * braked) if braked > 0.0 else math.nan
    level = equivalent - G * x.gradient / (1000.0 * rho)
    corrected = nominal * x.response + nominal**2 / (2.0 * level) if level > 0.0 else math.nan
    energy = 3.933 * rho * (3.6 * x.v0) ** 2 - x.gradient * x.distance
    by_energy = x.distance * 3.933 * rho * (3.6 * nominal) ** 2 / max(energy, 1e-9)
    if not math.isfinite(x.response):
        corrected = by_energy
    return {
        "v0": x.v0,
        "distance": x.distance,
        "duration": x.duration,
        "delay": x.delay,
        "response": x.response,
        "mean": mean,
        "equivalent": equivalent,
        "corrected": corrected,
        "by_energy": by_energy,
    }
