"""Wheels that turn faster than the train, or slower though no brake is on.

A brake makes a wheel slower, only a motor makes it faster. Without a train speed, the reference is
the median of the wheels while none is braked. An unbraked wheel always has the same ratio to the
train speed, whatever its diameter.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ...core.finding import Finding
from ...core.masks import erode
from ...core.model import Bools, Floats, Quantity, fraction
from ...core.physics import CRAWL
from ...train.grid import long_runs
from ..registry import About
from ..scene import Scene
from .wheel_scale import diameter_finding

ABOUT = About("Wheels that leave the train's speed", "wheels", 20)


class Params(NamedTuple):
    """Thresholds."""

    apart: Annotated[float, fraction("of the train's speed: wear and creep are less")] = 0.05
    apart_floor: Annotated[float, Quantity("m/s", "and at low speed this much")] = 0.3
    drift: Annotated[float, fraction("of the train speed, against the wheel's usual ratio")] = 0.02
    drift_floor: Annotated[float, Quantity("m/s", "and at low speed this much")] = 0.15
    half: Annotated[float, fraction("slower by more is no larger wheel but a sensor")] = 0.5
    lasts: Annotated[float, Quantity("s", "a wheel catches up faster after a slide")] = 2.0
    driven: Annotated[float, Quantity("m/s²", "a train with more may be driven: wheels spin")] = 0.1


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """One finding per axle that leaves the train's speed for a while."""
    g = s.grid
    reference, of_train = g.train, "the train"
    if reference is None:
        if len(s.axles) < 3:
            return
        released_all = np.all([erode(K <= 0.0, g.half_width) for K in g.clamping], axis=0)
        reference = np.where(released_all, np.median(g.rim, axis=0), np.nan)
        of_train = "the other axles"
    for i, a in enumerate(s.axles):
        released = erode(g.clamping[i] <= 0.0, 2 * g.half_width)  # a wheel that slid has caught up
        delay_error = max(g.step, a.record.train_speed_interval) * np.abs(g.slope(reference))
        delay_error += g.train_error  # of one that was integrated
        difference = np.where(reference > CRAWL, g.rim[i] - reference, 0.0)
        allowed = p.apart * reference + p.apart_floor + delay_error
        braked = np.isfinite(g.braking)  # not driven
        departs = (difference > allowed) & braked | (difference < -allowed) & released
        mask = long_runs(departs, p.lasts, g)
        if mask.any():
            shares = difference[mask] / reference[mask]
            share = float(np.median(shares))
            lowest, highest = np.quantile(shares, [0.1, 0.9])
            is_steady = highest - lowest < p.drift and g.train is not None
            if is_steady and -p.half < share < 0.0:
                yield diameter_finding(s, i, 1.0 / (1.0 + share))  # a drag is not so steady
                continue
            code = "wheel-faster" if share > 0.0 else "wheel-slower-unbraked"
            values, names = {"share": abs(share)}, {"reference": of_train}
            yield s.finding(code, "warning", a.speed, mask, i, values, names)
        elif g.train is not None:
            yield from _drifts(p, s, i, released & braked, delay_error)


def _drifts(p: Params, s: Scene, i: int, rolling: Bools, delay_error: Floats) -> Iterator[Finding]:
    """An unbraked wheel whose ratio to the train speed is not its usual one."""
    g = s.grid
    assert g.train is not None
    rolling = rolling & (g.train > CRAWL) & (g.slope(g.train) < p.driven)
    if not rolling.any():
        return
    usual = float(np.median(g.rim[i][rolling] / g.train[rolling]))
    difference = g.rim[i] - usual * g.train
    allowed = p.drift * g.train + p.drift_floor + delay_error
    mask = long_runs(rolling & (np.abs(difference) > allowed), p.lasts, g)
    if mask.any():
        values = {"share": float(np.median(difference[mask] / g.train[mask]))}
        yield s.finding("wheel-speed-drift", "warning", s.axles[i].speed, mask, i, values)
