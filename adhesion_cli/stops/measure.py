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
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..core.model import Parameter
from ..core.physics import BAR, SLOW, G
from ..core.summary import AxleStop, Measured, StopContribution, StopSummary
from .axle_stops import all_axles_slide, axle_stops, on_time
from .command import find_command, find_dead_time
from .find import ALL_LOCK, Braking
from .response import BrakeResponse, find_response
from .settings import StopSettings
from .signals import StopSignals, TimeSeries
from .speed import FIT, SmoothSpeed, largest_jerk, locked_time, over_slides, smoothed_speed

K95 = 2.0  # coverage factor
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
    response = find_response(signals, command, braking, settings.start_share, smooth)
    nominal = settings.nominal_speed or _usual_speed(v0)
    equivalent = math.nan if hidden else response.equivalent.value
    times = braking.stop + locked.value - command, response.delay.value, equivalent
    distance = float(np.trapezoid(v[is_braking], t[is_braking]))
    values = _Values(v0, distance, *times, to_level.gradient.value)
    unknown = _dead_time_sigma(response, settings) if source == "pressure" else 0.0
    clock = 0.0 if source == "deceleration" else signals.pressure_sigma
    # a command that is logged may be on either clock, that of the pressure or of the speed
    late = {} if source == "pressure" else {"delay": -clock, "response": -clock}
    of_response = late | ({"response": clock} if response.by_speed else {})
    errors = {
        **_speed_errors(values, smooth, signals, settings.speed_scale, response.by_speed),
        "sliding axles": {"distance": hidden},
        SPEED_GAP: {"distance": _gap_error(signals, command, braking.stop)},
        "command time": _early_command(v0, command_u),
        "dead time": _early_command(v0, unknown),
        "pressure clock": {"distance": v0 * clock, "duration": clock, **of_response},
        "build-up": {"delay": response.delay.tolerance, "response": response.equivalent.tolerance},
        "standstill": {"duration": math.hypot(braking.stop_sigma, locked.tolerance)},
        "gradient": {"gradient": to_level.gradient.tolerance},
    }
    quantities, budget = _quantities(values, errors, nominal, to_level)
    axles = tuple(axle_stops(signals, command, braking, settings))
    is_hidden = bool(hidden) or braking.reason.startswith(ALL_LOCK)
    if braking.reason:
        quantities |= dict.fromkeys(quantities.keys() - _OF_ANY_BRAKING)
    return StopSummary(
        start_s=command,
        end_s=braking.stop,
        command_from=source,
        speed_from=signals.speed_from,
        nominal_speed_kmh=nominal,
        valid=not braking.reason,
        reason=braking.reason or None,
        pressure_bar=_bar(response.full_value) if signals.by_pressure else None,
        dead_time_s=_measured(find_dead_time(signals, braking)),
        build_up_s=None if math.isnan(equivalent) else _measured(_build_up(response)),
        response_from=None if math.isnan(equivalent) else response.source,
        jerk=None if is_hidden else _jerk(signals, smooth, axles, command, braking.stop),
        axles=axles,
        sanding_s=signals.sanding and on_time(signals.sanding.cut(command, braking.stop)),
        reservoir_drop_pa=_drop(signals.reservoir, command, braking.stop),
        budget=budget,
        speed=(t[is_braking] - command, np.where(smooth.is_read, v, np.nan)[is_braking]),
        **quantities,
    )


def _usual_speed(v0: float) -> float:
    """The nominal speed that is nearest to a speed [m/s]; in km/h."""
    return float(min(NOMINAL_SPEEDS, key=lambda speed: abs(speed - 3.6 * v0)))


def _build_up(response: BrakeResponse) -> Parameter | None:
    """Twice from the delay to the equivalent step [s]: the whole build-up of a straight one."""
    if response.by_speed:
        return None
    equivalent = response.equivalent
    return Parameter(2.0 * (equivalent.value - response.delay.value), 2.0 * equivalent.tolerance)


def _reading_interval(signals: StopSignals) -> float:
    """Between readings of the speed [s]; of wheels, where they give its shape."""
    own_interval = 0.0 if signals.is_coarse is not None else signals.interval
    return max(float(np.median(np.diff(signals.speed.t))), own_interval)


def _jerk(
    signals: StopSignals,
    smooth: SmoothSpeed,
    axles: Sequence[AxleStop],
    command: float,
    stop: float,
) -> Measured | None:
    """The largest jerk, where a sensor shows the shape of the train's speed."""
    if not _has_shape(signals, axles, command, stop):
        return None
    return _measured(largest_jerk(smooth, command, signals.by_wheels))


def _has_shape(
    signals: StopSignals, axles: Sequence[AxleStop], command: float, stop: float
) -> bool:
    """Whether a sensor shows the shape of the train's speed, as wheels do of which one rolls."""
    if signals.by_wheels and axles and all(a.valve_actions > 1 for a in axles):
        return False  # no wheel rolls all along
    if signals.is_coarse is None:
        return signals.speed_from == "train" or not all_axles_slide(signals, command)
    t, v = signals.speed
    return not signals.is_coarse[(t >= command) & (t <= stop) & (v > SLOW)].any()


def _gap_error(signals: StopSignals, command: float, stop: float) -> float:
    """1 sigma of the distance, where wheels that may creep fill a gap of the speed [m]."""
    t, v = signals.speed
    if signals.filled is None:
        return 0.0
    inside = signals.filled & (t >= command) & (t <= stop)
    return _GAP_SHARE * float(np.sum(np.where(inside, v * np.gradient(t), 0.0)))


def _measured(x: Parameter | None) -> Measured | None:
    return x and Measured(x.value, K95 * x.tolerance)


def _drop(reservoir: TimeSeries | None, start: float, stop: float) -> float | None:
    """By how much the reservoir's pressure falls below that at the command [Pa]."""
    if reservoir is None or not len(pressure := reservoir.cut(start, stop).value):
        return None
    return float(pressure[0] - np.min(pressure))


def _quantities(
    values: _Values, errors: Mapping[str, Mapping[str, float]], nominal: float, to_level: ToLevel
) -> tuple[dict[str, Any], tuple[StopContribution, ...]]:
    """All quantities of a stop, None where one is not known, and what contributes to them.

    `errors` are what one standard uncertainty adds to the values, by the source.
    """
    conditions = nominal / 3.6, to_level.rotating
    derived, effects = _derive(values, *conditions), dict[str, dict[str, float]]()
    for source, added in errors.items():
        changed = values._replace(**{k: getattr(values, k) + x for k, x in added.items()})
        effects[source] = {k: x - derived[k] for k, x in _derive(changed, *conditions).items()}
    names = "corrected_distance_m", "energy_distance_m"
    between = derived["energy_distance_m"] - derived["corrected_distance_m"]
    error = between / math.sqrt(3.0) if math.isfinite(between) else 0.0
    effects[_FORMULA] = dict.fromkeys(derived, 0.0) | dict.fromkeys(names, error)
    quantities: dict[str, Measured | None] = dict.fromkeys(derived)
    for name, x in derived.items():
        if math.isfinite(x):
            u = math.hypot(*(effect[name] for effect in effects.values()))
            common = math.hypot(*(effects[source][name] for source in _COMMON))
            quantities[name] = Measured(x, K95 * u, K95 * common)
    equivalent = "equivalent_deceleration"
    slowing = equivalent if quantities[equivalent] else "mean_deceleration"
    budget = tuple(
        StopContribution(source, source in _COMMON, effect["distance_m"], effect[slowing])
        for source, effect in effects.items()
        if source != _FORMULA
    )
    return quantities, budget


_OF_ANY_BRAKING = {"initial_speed_mps", "delay_s", "response_time_s"}  # also of no whole stop
SPEED_GAP = "gap of the speed"  # the source of an error
_GAP_SHARE = 0.01  # 1 sigma of the speed of braked wheels that roll, as a share
_LEAST_DEAD_TIME, _MOST_DEAD_TIME = 0.2, 1.5  # 1 sigma, assumed [s]
_DEAD_TIME_SHARE = 0.2  # the same of the build-up, between them
DEAD_TIME_ERROR = 0.1  # 1 sigma of a stated dead time, as a share of it
_FORMULA = "formula"  # of the corrected distance: the true one lies between those of both
# the same in every stop of a series
_COMMON = ("speed scale", "speed delay", "dead time", "pressure clock", "gradient", _FORMULA)


def _bar(pressure: float) -> float | None:
    return pressure / BAR if math.isfinite(pressure) else None


def _dead_time_sigma(response: BrakeResponse, settings: StopSettings) -> float:
    """1 sigma of the time between a command that is not logged and the first rise [s].

    A slow brake is late, too: as a share of its build-up. A stated dead time is known better.
    """
    if settings.dead_time:
        return DEAD_TIME_ERROR * settings.dead_time
    share = _DEAD_TIME_SHARE * response.build_up if math.isfinite(response.build_up) else 0.0
    return min(max(_LEAST_DEAD_TIME, share), _MOST_DEAD_TIME)


def _speed_errors(
    x: _Values,
    smooth: SmoothSpeed,
    signals: StopSignals,
    stated_scale: float,
    response_by_speed: bool,
) -> dict[str, dict[str, float]]:
    """What one standard uncertainty of scale, delay and noise of the speed adds to the values."""
    scale, delay_sigma = stated_scale or signals.scale, signals.delay_sigma
    fitted = max(FIT / max(smooth.interval, 1e-3), 1.0)
    noise = smooth.noise * math.sqrt(smooth.interval * max(x.duration, 0.0))
    return {
        "speed scale": {"v0": x.v0 * scale, "distance": x.distance * scale},
        "speed delay": {
            "distance": x.v0 * delay_sigma,
            "duration": delay_sigma,
            "response": response_by_speed * (not signals.wheels_show_begin) * delay_sigma,
        },
        "speed noise": {"v0": 1.5 * smooth.noise / math.sqrt(fitted), "distance": noise},
    }


def _early_command(v0: float, seconds: float) -> dict[str, float]:
    """What a command that is earlier by so many seconds adds to the values."""
    times = dict.fromkeys(("duration", "delay", "response"), seconds)
    return {"distance": v0 * seconds, **times}


def _derive(x: _Values, nominal: float, rho: float) -> dict[str, float]:
    """All quantities, as `StopSummary` names them; NaN where one is not known."""
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
        "initial_speed_mps": x.v0,
        "distance_m": x.distance,
        "duration_s": x.duration,
        "delay_s": x.delay,
        "response_time_s": x.response,
        "mean_deceleration": mean,
        "equivalent_deceleration": equivalent,
        "corrected_distance_m": corrected,
        "energy_distance_m": by_energy,
    }
