"""Wheel speeds that are always the same share of the train's: units and wheel diameters."""

import math
from collections.abc import Iterator
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from ...core import toml
from ...core.finding import Finding
from ...core.masks import erode
from ...core.model import Bools, Floats, Quantity
from ...core.physics import CRAWL
from ...core.units import UNITS, alternative_units
from ...train.grid import FEWEST, Grid
from ..registry import About
from ..scene import Scene
from .impossible_values import join_units

ABOUT = About("Units and diameters of the wheels", "wheels", 10)


class Params(NamedTuple):
    """Thresholds."""

    sigmas: Annotated[float, Quantity("-", "of the radius: wear of 1 sound wheel of 400", 1.0)] = (
        3.0
    )
    floor: Annotated[float, Quantity("m/s", "by which two speeds that agree may differ")] = 0.05
    unit: Annotated[float, Quantity("-", "no wheel is so worn: the factor is a unit's", 1.0)] = 1.25


def check(p: Params, s: Scene) -> Iterator[Finding]:
    """Against the train's speed, else against the other axles'."""
    axles, g = s.axles, s.grid
    # What is left of a wheel speed's quantisation in the mean over a step of the grid [m/s].
    intervals = [1.0 / a.speed.rate_hz if a.speed.rate_hz else 0.0 for a in axles]
    steps = (a.speed.coarsest * min(1.0, x / g.step) for a, x in zip(axles, intervals, strict=True))
    floor = p.floor + max(r.value for r in s.vehicle.wheel_radius) * max(steps) / 2.0
    if axles[0].train is not None:
        floor += axles[0].train.step / 3.0
    of_another_unit = {}
    for i in range(len(axles)):
        reference = _reference(g, i)
        if reference is None:
            continue
        scale = 1.0 / _usual_share(g, i)
        if not 1.0 / p.unit < scale < p.unit:
            of_another_unit[i] = scale
        elif (scale := _scale(p, s, i, reference, floor)) != 1.0:
            if 0.8 < scale < 1.25:
                yield diameter_finding(s, i, scale)
            else:
                of_another_unit[i] = scale
    all_differ = len(of_another_unit) == len(axles)
    for i, scale in of_another_unit.items():
        yield _unit(s, i, scale, all_differ)


def _reference(g: Grid, i: int) -> Floats | None:
    """What axle i is compared with (n,) [m/s]; None where there is nothing."""
    if g.train is not None:
        return g.train
    if len(g.rim) > 2:
        return np.asarray(np.median(g.rim, axis=0))
    return g.rim[1] if len(g.rim) == 2 and i == 0 else None


def _scale(p: Params, s: Scene, i: int, reference: Floats, floor: float) -> float:
    """The reference over this axle's speed, 1 where they agree or nothing is clear."""
    g = s.grid
    fast = reference > max(0.15 * float(np.nanmax(reference, initial=0.0)), CRAWL)
    selected = fast & np.isfinite(g.rim[i]) & (g.rim[i] > CRAWL)
    if selected.sum() < FEWEST:
        return 1.0
    scale = float(np.median(reference[selected] / g.rim[i][selected]))
    residual = float(np.median(np.abs(reference[selected] - scale * g.rim[i][selected])))
    radius = s.vehicle.radius(s.axles[i].record.axle)
    worn = 0.0 if g.train is not None else 1.0 / (len(g.rim) - 1)  # the others are, too
    allowed = max(p.sigmas * radius.share * math.sqrt(1.0 + worn), 0.005)
    differs = abs(scale - 1.0)
    if residual > floor or differs < allowed:
        return 1.0
    unbraked = _is_unbraked(g, i) & (reference > CRAWL) & (g.rim[i] > CRAWL)
    if unbraked.any():  # an unbraked wheel does not slide
        unbraked_scale = float(np.median(reference[unbraked] / g.rim[i][unbraked]))
        differs = min(differs, 2.0 * abs(unbraked_scale - 1.0))
    elif g.train is None and g.step > 0.5:  # a steady slide looks the same
        return 1.0
    clear = differs >= allowed and differs * float(np.nanmedian(reference)) >= 2.0 * floor
    return scale if clear else 1.0


def _is_unbraked(g: Grid, i: int) -> Bools:
    """Where a wheel is not braked, nor was within half a second, shape (n,)."""
    return erode(g.clamping[i] <= 0.0, g.half_width)


def _usual_share(g: Grid, i: int) -> float:
    """The usual ratio of a wheel to the train speed, 1 where it has none.

    A wheel without brake rolls. A braked wheel rolls where its ratio is the same again and again;
    the highest such ratio counts. The ratio of a wheel that slides all the time varies.
    """
    if g.train is None:
        return 1.0
    fast = g.train > max(0.3 * float(np.nanmax(g.train, initial=0.0)), CRAWL)
    fast &= g.rim[i] > CRAWL / 10.0
    share = np.where(fast, g.rim[i], np.nan) / np.where(fast, g.train, 1.0)
    second = max(3, round(1.0 / g.step))
    unbraked = share[fast & _is_unbraked(g, i)]
    if len(unbraked) >= second:
        return float(np.median(unbraked))
    shares = np.sort(share[np.isfinite(share)])
    counts = np.searchsorted(shares, 1.03 * shares) - np.searchsorted(shares, 0.97 * shares)
    frequent = shares[counts >= max(second, FEWEST, len(shares) // 5)]
    return float(frequent[-1]) if len(frequent) else 1.0


def _reference_name(s: Scene) -> dict[str, str]:
    return {"reference": "the other axles" if s.grid.train is None else "the train speed"}


def _unit(s: Scene, i: int, scale: float, all_differ: bool) -> Finding:
    """A wheel speed of another unit than stated; where all axles differ, or a train speed."""
    a = s.axles[i]
    wheel = "speed" if all_differ else f"speed.axle{a.record.axle}"
    speeds = {wheel: a.speed}
    if all_differ and s.grid.train is not None and a.train:
        speeds["train_speed"] = a.train
    candidates, options = [], []
    for name, channel in speeds.items():
        factor = 1.0 / scale if channel is a.speed else scale
        units = alternative_units(channel, s.vehicle, partial(_agree, factor))
        candidates += [f"{name.partition('.')[0]} in {u}" for u in units]
        options += [toml.option(f'channels.{name}.unit = "{u}"') for u in units[:1]]
    names = {
        **_reference_name(s),
        "units": join_units(candidates),
        "option": " or ".join(options) or toml.option(f'channels.{wheel}.unit = "km/h"'),
    }
    values = {"factor": 1.0 / scale}
    return s.finding("speed-unit-suspect", "warning", a.speed, None, i, values, names)


def _agree(scale: float, factor: float) -> bool:
    return 0.87 < scale * factor < 1.15


def diameter_finding(s: Scene, i: int, scale: float) -> Finding:
    """A wheel of another diameter than stated, or than the logger takes it for."""
    a, values = s.axles[i], {"factor": 1.0 / scale}
    unit, code = UNITS.get(a.speed.unit.strip().lower()), "wheel-diameter-in-logger"
    if unit is None or unit.dimension != "speed":
        code = "wheel-diameter"
        values["diameter_m"] = 2.0 * scale * s.vehicle.radius(a.record.axle).value
    return s.finding(code, "warning", a.speed, None, i, values, _reference_name(s))
