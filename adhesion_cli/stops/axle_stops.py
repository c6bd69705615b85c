"""Each axle in one stop: slip, locks, releases of its brake."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from ..core.masks import true_runs
from ..core.model import Floats
from ..core.physics import SLIDE, WORKING
from ..core.signals import median_of_five, robust_sigma
from ..core.summary import AxleStop
from ..rail.events import SHORTEST_SLIDE
from ..rail.locks import find_locks
from .find import Braking
from .settings import StopSettings
from .signals import DROP, StopSignals, TimeSeries, brake_levels

SLIP_BANDS = (0.05, 0.1, 0.2, 0.5, 1.0)  # upper limits of the bands of the slip histogram
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
            v = v if signals.knows_delay else least_v
            has_slip = np.isfinite(v) & np.isfinite(rim.value) & (v > WORKING)
            slips = 1.0 - rim.value[has_slip] / v[has_slip]
            if len(slips):
                errors = _slip_errors(rim.t[has_slip], v[has_slip], slips, signals.delay_sigma)
                smooth = median_of_five(slips)
                k = int(np.argmax(smooth))
                slip = float(smooth[k])
                by_radius = 2.0 * signals.radius_shares.get(axle, 0.0)
                slip_u95 = math.hypot(float(errors[k]), by_radius)
                shares, _ = np.histogram(slips, [-np.inf, *SLIP_BANDS])
                bands = tuple((shares / len(slips)).tolist())
                levels = (SLIP_BANDS[0] + x for x in (-errors, errors))
                lowest, highest = (float(np.mean(slips <= level)) for level in levels)
                bands_u95 = (highest - lowest) / 2.0
            locks = [x.duration for x in find_locks(rim.t, least_v, rim.value, settings.locks)]
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


def _slip_errors(t: Floats, v: Floats, slips: Floats, delay_sigma: float) -> Floats:
    """Expanded uncertainty of each slip by noise and delay, larger the slower the train is, (n,).

    Noise of the speeds moves a slip over the limit of a band, and a train speed with a delay moves
    all of them. `delay_sigma` is in s.
    """
    noise = robust_sigma((slips - median_of_five(slips)) * v)
    slowing = abs(float(v[0] - v[-1])) / max(float(t[-1] - t[0]), 1e-9)
    errors: Floats = 2.0 * math.hypot(noise, delay_sigma * slowing) / v
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
