"""Each axle in one stop: slip, locks, releases of its brake."""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from ..core.physics import WORKING
from ..core.signals import median_of_five, true_runs
from ..core.summary import AxleStop
from ..rail.locks import find_locks
from .brake_levels import brake_levels
from .find import Braking
from .settings import StopSettings
from .signals import Series, StopSignals

SLIP_BANDS = (0.05, 0.1, 0.2, 0.5, 1.0)  # upper limits of the bands of the slip histogram
_ON = 0.5  # a state is 0 or 1
_DROP = 0.1  # of the full value: a fall in the build-up is a valve of the WSP


def axle_stops(
    signals: StopSignals, command: float, braking: Braking, settings: StopSettings
) -> Iterator[AxleStop]:
    """Slip, locks and valve actions of each axle."""
    for axle in sorted({*signals.rims, *signals.brakes}):
        slip = locked = longest = bands = None
        if axle in signals.rims:
            rim = signals.rims[axle].between(command, braking.end)
            v = signals.speed.at(rim.t)
            known = np.isfinite(v) & np.isfinite(rim.value) & (v > WORKING)
            slips = 1.0 - rim.value[known] / v[known]
            if len(slips):
                slip = float(np.max(median_of_five(slips)))
                shares, _ = np.histogram(slips, [-np.inf, *SLIP_BANDS])
                bands = tuple((shares / len(slips)).tolist())
            locks = [x.duration for x in find_locks(rim.t, v, rim.value, settings.locks)]
            locked, longest = sum(locks, 0.0), max(locks, default=0.0)
            slip = 1.0 if locks else slip
        actions, vented = 0, None
        source: Literal["valves", "pressure"] | None = None
        if axle in signals.valves:
            valve = signals.valves[axle].between(command, braking.end)
            actions, source, vented = len(true_runs(valve.value > _ON)), "valves", on_time(valve)
        elif axle in signals.brakes:
            actions, source = _releases(signals.brakes[axle], braking), "pressure"
        row = AxleStop(axle, slip, locked, longest, actions, bands)
        yield row._replace(valves_from=source, vented_s=vented)


def on_time(state: Series) -> float:
    """How long a state is on [s]; each sample lasts until the next one."""
    return float(np.sum(np.diff(state.t)[state.value[:-1] > _ON]))


def _releases(brake: Series, braking: Braking) -> int:
    """How often a brake falls by a tenth of its full value before the train stands."""
    released, full, _ = brake_levels(brake, braking.on, braking.end)
    part = brake.between(braking.on, braking.end)
    x = part.value[np.isfinite(part.value)]
    if full <= released or not len(x):
        return 0
    count, high, low, falls = 0, x[0], x[0], False
    for value in median_of_five(x).tolist():
        if falls:
            low = min(low, value)
            if value > low + _DROP * (full - released):
                falls, high = False, value
        else:
            high = max(high, value)
            if value < high - _DROP * (full - released):
                falls, low, count = True, value, count + 1
    return count
