"""The released and the full value of a brake, and its noise."""

import numpy as np

from ..core.model import Floats
from ..core.signals import robust_sigma
from .signals import TimeSeries

DROP = 0.1  # of the full value: a fall in the build-up is a valve of the WSP
_RELEASED = 3.0  # time before it over which the released level is a median [s]
_HIGH_SHARE = 0.9  # of the highest brake: samples above it are those of the full brake


def brake_levels(brake: TimeSeries, start: float, stop: float) -> tuple[float, float, float]:
    """Released and full value of a brake in a braking, and its noise (1 sigma)."""
    released_values = brake.cut(start - _RELEASED - 1.0, start - 1.0).value
    released_values = released_values[np.isfinite(released_values)]
    applied = brake.cut(start, stop).value
    applied = applied[np.isfinite(applied)]
    if not len(applied):
        return 0.0, 0.0, 0.0
    released = float(np.median(released_values)) if len(released_values) else 0.0
    noise = robust_sigma(released_values - released) if len(released_values) else 0.0
    high_level = released + _HIGH_SHARE * (float(np.quantile(applied, 0.98)) - released)
    return released, float(np.median(applied[applied >= high_level])), noise


def quantisation_step(x: Floats) -> float:
    """Quantisation step of a signal."""
    steps = np.abs(np.diff(x[np.isfinite(x)]))
    steps = steps[steps > 0.0]
    return float(np.min(steps)) if len(steps) else 0.0
