"""Each axle in one stop: slip, locks, releases of its brake."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from ..core.masks import true_runs
from ..core.model import Floats, Parameter
from ..core.physics import SLIDE, SLOW, WORKING
from ..core.signals import means_around, median_of_five, robust_sigma
from ..core.summary import AxleStop
from ..rail.events import SHORTEST_SLIDE
from ..rail.locks import find_locks
from .find import Braking
from .settings import StopSettings
from .signals import DROP, StopSignals, TimeSeries, brake_levels
from .speed import excess_of_highest

SLIP_BANDS = (0.05, 0.1, 0.2, 0.5, 1.0)  # upper limits of the bands of the slip histogram
_SLIP_TIME = 0.1  # over which the largest slip of a wheel that does not slide is a mean [s]
_FAST_TIME = 0.5  # over which the train's speed is a mean that is judged [s]
_NOISE_TIMES = 0.1, 0.3, 1.0  # over which a slip's noise may be the same, as of a receiver [s]
_SLOWING_TIME = 2.0  # over which its deceleration there is a mean [s]
_SWITCHED_ON = 0.5  # a state is 0 or 1


def axle_stops(
    signals: StopSignals, command: float, braking: Braking, settings: StopSettings
) -> Iterator[AxleStop]:
    """Slip, locks and valve actions of each axle."""
    for axle in sorted({*signals.rims, *signals.brakes}):
        slip = slip_u95 = locked = longest = bands = bands_u95 = None
        if axle in signals.rims:
            rim = signals.rims[axle].cut(command, braking.stop)
            v, least_v = signals.speed.interpolated(rim.t), signals.least_speed(rim.t)
            locks = [
                x.duration for x in find_locks(rim.t, v, rim.value, settings.locks, least_v=least_v)
            ]
            v = v if signals.knows_delay else least_v
            # noise of a single speed selects no samples: those of a high noise would stay
            is_fast = means_around(rim.t, np.nan_to_num(v), _FAST_TIME) > WORKING
            has_slip = np.isfinite(v) & np.isfinite(rim.value) & is_fast & (v > SLOW)
            slips = 1.0 - rim.value[has_slip] / v[has_slip]
            if len(slips):
                columns = rim.t[has_slip], v[has_slip], slips
                errors = _slip_errors(*columns, signals.delay_sigma)
                slip, sigma = _largest_slip(*columns, signals)
                slip_u95 = 2.0 * math.hypot(sigma, signals.radius_shares.get(axle, 0.0))
                shares, _ = np.histogram(slips, [-np.inf, *SLIP_BANDS])
                bands = tuple((shares / len(slips)).tolist())
                levels = (SLIP_BANDS[0] + x for x in (-errors, errors))
                lowest, highest = (float(np.mean(slips <= level)) for level in levels)
                bands_u95 = (highest - lowest) / 2.0
            locked, longest = sum(locks, 0.0), max(locks, default=0.0)
            slip, slip_u95 = (1.0, 0.0) if locks else (slip and max(slip, 0.0), slip_u95)
        actions, vented = 0, None
        source: Literal["valves", "pressure"] | None = None
        if axle in signals.valves:
            valve = signals.valves[axle].cut(command, braking.stop)
            actions, source = len(true_runs(valve.value > _SWITCHED_ON)), "valves"
            vented = on_time(valve)
        elif axle in signals.brakes:
            actions, source = _releases(signals.brakes[axle], braking), "pressure"
        in_doubt = signals.speed_from == "axles" or not signals.knows_delay
        at_least = slip is not None and in_doubt
        yield AxleStop(
            axle,
            slip,
            locked,
            longest,
            actions,
            bands,
            valves_from=source,
            vented_s=vented,
            rolling_u95=bands_u95,
            at_least=at_least,
            max_slip_u95=None if at_least else slip_u95,
        )


def all_axles_slide(signals: StopSignals, start: float) -> bool:
    """Whether each axle slides at some time after that: none shows the train's speed all along."""
    slides = []
    for rim in signals.rims.values():
        run = rim.cut(start, math.inf)
        v = signals.speed.interpolated(run.t)
        with np.errstate(invalid="ignore"):
            deep = (v > WORKING) & (run.value < (1.0 - SLIDE) * v)
        slides.append(any(run.t[b - 1] - run.t[a] > SHORTEST_SLIDE for a, b in true_runs(deep)))
    return bool(slides) and all(slides)


def _largest_slip(t: Floats, v: Floats, slips: Floats, signals: StopSignals) -> Parameter:
    """The largest slip of a short time, and 1 sigma of it by noise and by the train's speed.

    The largest of several values has the largest of their errors, too: half of what that is to be
    expected is taken off, as of the largest jerk.
    """
    interval = float(np.median(np.diff(t))) if len(t) > 1 else _SLIP_TIME
    is_fast = 5.0 * interval <= 2.0 * _SLIP_TIME  # five slow samples are longer than a slide
    smooth = means_around(t, median_of_five(slips) if is_fast else slips, _SLIP_TIME)
    widths = sorted({max(round(x / interval), 1) for x in _NOISE_TIMES})
    noise = max(_noise(smooth, v, width) for width in widths)
    k = int(np.argmax(smooth))
    sigma = noise / float(v[k])
    near = np.sum(smooth > smooth[k] - 2.0 * sigma) / widths[0]
    half_excess = 0.5 * sigma * excess_of_highest(1.0 + float(near))
    around = np.abs(t - t[k]) < _SLOWING_TIME / 2.0
    slowing = max(_slowing(t, v), _slowing(t[around], v[around]))
    by_train = math.hypot(signals.delay_sigma * slowing, signals.level_sigma) / float(v[k])
    return Parameter(float(smooth[k]) - half_excess, math.hypot(sigma, half_excess, by_train))


def _noise(slips: Floats, v: Floats, width: int) -> float:
    """1 sigma of the speeds [m/s] by the second differences of a slip over so many samples."""
    if len(slips) <= 2 * width:
        return 0.0
    bends = slips[2 * width :] - 2.0 * slips[width:-width] + slips[: -2 * width]
    return robust_sigma(bends * v[width:-width]) / math.sqrt(6.0)


def _slowing(t: Floats, v: Floats) -> float:
    """Mean deceleration [m/s²]."""
    return abs(float(v[0] - v[-1])) / max(float(t[-1] - t[0]), 1e-9)


def _slip_errors(t: Floats, v: Floats, slips: Floats, delay_sigma: float) -> Floats:
    """Expanded uncertainty of each slip by noise and delay, larger the slower the train is, (n,).

    Noise of the speeds moves a slip over the limit of a band, and a train speed with a delay moves
    all of them. `delay_sigma` is in s.
    """
    noise = robust_sigma((slips - median_of_five(slips)) * v)
    errors: Floats = 2.0 * math.hypot(noise, delay_sigma * _slowing(t, v)) / v
    return errors


def on_time(state: TimeSeries) -> float:
    """How long a state is on [s]; each sample lasts until the next one."""
    return float(np.sum(np.diff(state.t)[state.value[:-1] > _SWITCHED_ON]))


def _releases(brake: TimeSeries, braking: Braking) -> int:
    """How often a brake falls by a tenth of its full value before the train stands."""
    released, full_value, _ = brake_levels(brake, braking.start, braking.stop)
    run = brake.cut(braking.start, braking.stop)
    x = run.value[np.isfinite(run.value)]
    if full_value <= released or not len(x):
        return 0
    count, highest, lowest, falls = 0, x[0], x[0], False
    for value in median_of_five(x).tolist():
        if falls:
            lowest = min(lowest, value)
            if value > lowest + DROP * (full_value - released):
                falls, highest = False, value
        else:
            highest = max(highest, value)
            if value < highest - DROP * (full_value - released):
                falls, lowest, count = True, value, count + 1
    return count
