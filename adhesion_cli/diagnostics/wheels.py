"""Wheel speeds against the train's, or each other: units, diameters, swapped axles."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..core.finding import Finding
from ..core.model import Bools, Channel, Floats, Vehicle
from ..core.signals import true_runs
from ..core.units import UNITS, listed, others
from ..dynamics.train_grid import CRAWL, LEAST, Grid, Scene, far, lasting

_FLOOR = 0.05  # by which two speeds that agree may differ [m/s]
_SIGMAS = 3.0  # of the wheel radius are tolerated
_APART = 0.05, 0.3  # a wheel that rolls is no farther from the train's speed: share, and [m/s]
_WANDERS = 0.02, 0.15  # nor, where no brake holds it, from what it usually is beside it: the same
_LASTS = 2.0  # for longer [s]
_DRIVEN = 0.1  # a train that gains more may be driven, and its wheels spin [m/s²]
_SWAP = 12  # samples of a slide that show whose pressure it follows
_SLIDES = 3  # of an axle: in one alone another's valve may open just as the rail holds again
_SLIDING = 0.97  # of the train's speed
_REACH = 1.0  # so late may all pressures be [s]


class _Match(NamedTuple):
    """How one speed follows another: reference ≈ scale · speed."""

    scale: float
    left: float  # median of what differs [m/s]


def _match(reference: Floats, y: Floats) -> _Match:
    """The scale at which a speed fits best."""
    fast = reference > max(0.15 * float(np.nanmax(reference, initial=0.0)), CRAWL)
    used = fast & np.isfinite(y) & (y > CRAWL)
    if used.sum() < LEAST:
        return _Match(1.0, math.inf)
    scale = float(np.median(reference[used] / y[used]))
    return _Match(scale, float(np.median(np.abs(reference[used] - scale * y[used]))))


def _rounding(speed: Channel, step: float, vehicle: Vehicle) -> float:
    """What is left of a wheel speed's quantisation in the mean over a step of the grid [m/s]."""
    interval = 1.0 / speed.rate_hz if speed.rate_hz else 0.0
    rim = max(r.value for r in vehicle.wheel_radius) * speed.coarsest
    return rim * min(1.0, interval / step) / 2.0


def speeds(s: Scene) -> Iterator[Finding]:
    """Units, clocks and wheel diameters that do not go with the train's speed or each other."""
    axles, g, vehicle = s.axles, s.grid, s.vehicle
    floor = _FLOOR + max(_rounding(a.speed, g.step, vehicle) for a in axles)
    if axles[0].train is not None:
        floor += axles[0].train.step / 3.0
    for i, a in enumerate(axles):
        if g.train is not None:
            reference = g.train
        elif len(axles) > 2:
            reference = np.median(g.rim, axis=0)
        elif i == 0 and len(axles) == 2:
            reference = g.rim[1]
        else:
            continue
        if not 0.8 < (kept := _kept_share(g, i)) < 1.25:
            yield _odd_wheel(s, i, 1.0 / kept)
            continue
        m = _match(reference, g.rim[i])
        R = vehicle.radius(a.record.axle)
        worn = 0.0 if g.train is not None else 1.0 / (len(axles) - 1)  # the others are, too
        allowed = _SIGMAS * R.tolerance / R.value * math.sqrt(1.0 + worn)
        differs = abs(m.scale - 1.0)
        if m.left > floor or differs < max(allowed, 0.005):
            continue
        free = _free(g, i) & (reference > CRAWL) & (g.rim[i] > CRAWL)
        if free.any():  # an unbraked wheel does not slide
            differs = min(
                differs, 2.0 * abs(float(np.median(reference[free] / g.rim[i][free])) - 1.0)
            )
            if differs < allowed:
                continue
        elif g.train is None and g.step > 0.5:  # a steady slide looks the same
            continue
        if differs * float(np.nanmedian(reference)) >= 2.0 * floor:
            yield _odd_wheel(s, i, m.scale)


def apart(s: Scene) -> Iterator[Finding]:
    """Wheels that turn faster than the train, or slower though no brake holds them.

    A brake makes a wheel slower, only a motor makes it faster. Without a train speed that of most
    wheels is one where none is braked. A wheel that no brake holds is as fast beside the train all
    along, whatever its diameter.
    """
    g = s.grid
    reference = g.train
    if reference is None:
        if len(s.axles) < 3:
            return
        free = np.all([_free(g, i) for i in range(len(s.axles))], axis=0)
        reference = np.where(free, np.median(g.rim, axis=0), np.nan)
    braked = np.isfinite(g.braking)  # not driven
    for i, a in enumerate(s.axles):
        between = max(g.step, a.record.train_speed_interval) * np.abs(g.slope(reference))
        between += g.train_error  # of one that was integrated
        allowed = _APART[0] * reference + _APART[1] + between
        off = np.where(reference > CRAWL, g.rim[i] - reference, 0.0)
        released = far(g.clamping[i] <= 0.0, 2 * g.half)  # a wheel that slid has caught up
        where = lasting((off > allowed) & braked | (off < -allowed) & released, _LASTS, g)
        if not where.any() and g.train is not None:
            free = released & braked & (reference > CRAWL) & (g.slope(reference) < _DRIVEN)
            usual = float(np.median(g.rim[i][free] / reference[free])) if free.any() else 1.0
            off = g.rim[i] - usual * reference
            allowed = _WANDERS[0] * reference + _WANDERS[1] + between
            where = lasting(free & (np.abs(off) > allowed), _LASTS, g)
            if where.any():
                yield _wanders(s, i, off / reference, where)
            continue
        if not where.any():
            continue
        share = float(np.median(off[where] / reference[where]))
        way, of_brake = "faster than", ""
        if share < 0.0:
            way, of_brake = "slower, and no pressure holds it, than", ", a pressure that is lost"
        other, of_train = "train", ", or a train speed that errs"
        if g.train is None:
            other, of_train = "other axles", ""
        text = (
            f"the wheel turns {100.0 * abs(share):.0f} % {way} the {other}: a wheel-speed sensor "
            f"that drifts, saturates, wraps or has another scale{of_brake}{of_train}; force and "
            "slip are wrong there; leave these times out with --from and --to, or the axle with "
            "--axle"
        )
        yield s.told("speed-suspect", "warning", text, a.speed, where, i)


def _wanders(s: Scene, i: int, share: Floats, where: Bools) -> Finding:
    """A wheel that no brake holds and that is not as fast beside the train as at other times."""
    most = 100.0 * float(np.median(share[where]))
    way = "faster" if most > 0.0 else "slower"
    text = (
        f"where no brake holds it the wheel turns {abs(most):.0f} % {way} "
        "beside the train than at other times: its sensor or the train speed drifts, or is off for "
        "a while; slip is wrong by that; leave these times out with --from and --to"
    )
    return s.told("speed-suspect", "warning", text, s.axles[i].speed, where, i)


def _free(g: Grid, i: int) -> Bools:
    """Where a wheel is not braked, nor was within half a second, shape (n,)."""
    return far(g.clamping[i] <= 0.0, g.half)


def _kept_share(g: Grid, i: int) -> float:
    """The share of the train's speed that a wheel keeps to, 1 where it keeps to none.

    A wheel without brake rolls. A braked one does where it keeps to one share again and again, the
    highest such share: one that slides all the time wanders and keeps to none.
    """
    if g.train is None:
        return 1.0
    fast = g.train > max(0.3 * float(np.nanmax(g.train, initial=0.0)), CRAWL)
    fast &= g.rim[i] > CRAWL / 10.0
    share = np.where(fast, g.rim[i], np.nan) / np.where(fast, g.train, 1.0)
    second = max(3, round(1.0 / g.step))
    free = np.sort(share[fast & _free(g, i)])
    if len(free) >= second:
        return float(np.median(free))
    some = np.sort(share[np.isfinite(share)])
    near = np.searchsorted(some, 1.03 * some) - np.searchsorted(some, 0.97 * some)
    kept = some[near >= max(second, LEAST, len(some) // 5)]
    return float(kept[-1]) if len(kept) else 1.0


def _odd_wheel(s: Scene, i: int, scale: float) -> Finding:
    """A wheel speed that is always the same share of what it should be."""
    a, by_train = s.axles[i], s.grid.train is not None
    other = "the train speed" if by_train else "the other axles"
    text = f"the wheel speed is {1.0 / scale:.3g} times that of {other}"
    if not 0.8 < scale < 1.25:
        likely = others(a.speed, s.vehicle, lambda x: 0.87 < x / scale < 1.15)
        text += f": state the unit in [channels] speed{listed(likely)}"
        if by_train and a.train:
            likely = others(a.train, s.vehicle, lambda x: 0.87 < x * scale < 1.15)
            text += f" or train_speed{listed(likely)}"
        return s.told("unit-suspect", "warning", text, a.speed, axle=i)
    unit = UNITS.get(a.speed.unit.strip().lower())
    if unit is not None and unit.dimension == "speed":
        text += (
            f": the logger takes a wheel {100.0 * abs(1.0 - scale):.1f} % too "
            f"{'large' if scale < 1.0 else 'small'}, and slip is wrong by that; correct the "
            "diameter in the logger"
        )
    else:
        diameter = 2.0 * scale * s.vehicle.radius(a.record.axle).value
        text += (
            f": the wheel's diameter is {diameter:.4f} m; "
            "state it in [vehicle] wheel_diameter, one per axle"
        )
    return s.told("wheel-diameter", "warning", text, a.speed, axle=i)


# Swapped axles


def swapped(s: Scene) -> Iterator[Finding]:
    """Axles that answer to another axle's pressure while they slide, not to their own.

    A wheel that slides is free: by (1) its ω̇ follows −aφK at once, while F changes slowly. Where
    all pressures are late by the same, that of an axle that slides later may seem to be another's:
    a clock that makes an axle follow its own as well as any other is no swap.
    """
    axles, g = s.axles, s.grid
    every, reach = range(len(axles)), min(round(_REACH / g.step), g.rim.shape[1] // 4)
    shifts = sorted(range(-reach, reach + 1), key=abs)
    own = np.array([[_follows(g, i, i, k) for i in every] for k in shifts])
    late = own[np.argmax(own.mean(axis=1))]
    for i, a in enumerate(axles):
        if len(list(true_runs(g.share[i] < _SLIDING))) < _SLIDES:
            continue
        follows = [_follows(g, i, j) for j in every]
        j = int(np.argmax(follows))
        if follows[j] > max(0.7, late[i] / 0.9) and follows[i] < 0.3:
            text = (
                f"where axle {a.record.axle} slides it follows the pressure of axle "
                f"{axles[j].record.axle}, not its own: swapped? "
                "State which channel is whose in [channels]"
            )
            yield s.told("axles-swapped", "warning", text, a.speed, g.share[i] < _SLIDING, i)


def _follows(g: Grid, i: int, j: int, shift: int = 0) -> float:
    """How well changes of axle i's ω̇ while it slides go with the pressure of j, so much later.

    0 where nothing tells; the shift is in steps of the grid.
    """
    change, release = _kink(_kink(g.rim[i])), np.full(g.rim.shape, np.nan)
    kinks = -_kink(g.clamping)
    n = len(change)
    release[:, max(-shift, 0) : n - max(shift, 0)] = kinks[:, max(shift, 0) : n - max(-shift, 0)]
    used = (g.share[i] < _SLIDING) & np.isfinite(change) & np.isfinite(release).all(axis=0)
    x, y = change[used], release[j][used]
    if len(x) < _SWAP or not np.ptp(x) or np.ptp(y) <= 0.2 * float(np.nanmax(g.clamping)):
        return 0.0
    return float(np.corrcoef(x, y)[0, 1])


def _kink(x: Floats) -> Floats:
    """Change from the sample before to the one behind, shape (..., n)."""
    change = np.full(x.shape, np.nan)
    change[..., 1:-1] = x[..., 2:] - x[..., :-2]
    return change
