"""All axles of a log on one coarse, even grid, on which an hour is 14 400 numbers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.model import (
    Z95,
    AxleRecord,
    Bools,
    Floats,
    Times,
    Vehicle,
)
from ..core.physics import FREE as FREE
from ..core.physics import GRADIENT
from ..core.signals import median, true_runs
from ..records.axle_channels import AxleChannels

LEAST = 8  # samples on it that show anything
STEP = 0.25  # where the log is fast enough [s]
_SLOW = 5.0  # a log with longer intervals has more likely the wrong time unit than noise [s]
_MOST = 20_000  # samples on it
_FIRMLY = 0.3  # of the highest K: a brake that no motor works against
_DRIVEN = 0.3  # a train that gains more than this without brake is driven: 3 % of gradient [m/s²]


@dataclass(frozen=True)
class Grid:
    """All axles on one even time axis; NaN where a channel has no sample nearby, or a wrong one.

    Wrong is a pressure, and its K, where its sensor's range ends.
    """

    first: int  # its first time [ns]
    step: float  # [s]
    rim: Floats  # ω R by the vehicle's radius, shape (k, n) [m/s]
    clamping: Floats  # K, shape (k, n) [N]
    pressure: Floats  # p, shape (k, n) [Pa]; NaN where the log has K
    train: Floats | None  # train speed, shape (n,) [m/s]
    train_error: Floats | float = 0.0  # an integrated one may err by that (95 %), (n,) [m/s]

    @property
    def fastest(self) -> Floats:
        """The train speed, else the fastest axle's rim speed, shape (n,) [m/s]."""
        return largest(self.rim) if self.train is None else self.train

    @cached_property
    def braking(self) -> Floats:
        """Deceleration of the train, else the mean one of the axles that roll, (n,) [m/s²].

        NaN where it gains speed without brake, and a second around: a motor drives it.
        """
        if self.train is not None:
            slowing = -self.slope(self.train)
        else:
            rolls = np.sum(self.rolling, axis=0)
            sums = np.sum(np.where(self.rolling, -self.slope(self.rim), 0.0), axis=0)
            slowing = np.where(rolls > 0, sums / np.maximum(rolls, 1), np.nan)
        K = self.mean(largest(self.clamping))
        driven = (FREE * np.nanmax(K, initial=0.0) > K) & (slowing < -_DRIVEN)
        return np.where(far(~driven, 2 * self.half), slowing, np.nan)

    @cached_property
    def share(self) -> Floats:
        """Rim speeds as shares of the train's, 1 while rolling whatever the diameters; (k, n).

        A braked wheel that slides turns slower than the train: the usual ratio is a high one.
        """
        fastest = self.fastest
        top = float(np.nanmax(fastest, initial=0.0))
        ratio = self.rim / np.where(fastest > max(0.1 * top, 1e-9), fastest, np.nan)
        return _of_usual(ratio, fastest > 0.3 * top)

    @cached_property
    def rolling(self) -> Bools:
        """Where an axle does not slide, as far as the log shows, nor within a second; (k, n)."""
        near = np.abs(self.share - 1.0) < 0.03
        return far(near, 2 * self.half)

    @cached_property
    def slid_together(self) -> bool:
        """Whether the fastest wheel gained speed while braked: no train does, so all slid."""
        if self.train is not None:
            return False
        K = largest(self.clamping)
        braked = ~far(_FIRMLY * np.nanmax(K, initial=0.0) > K, 2 * self.half)
        return bool(np.any(self.slope(self.fastest)[braked] > GRADIENT))

    def at(self, t: Times, where: Bools) -> Bools:
        """A mask on the grid, shape (n,), as one on samples at these times, shape (m,)."""
        place = np.rint((t - self.first) / (1e9 * self.step)).astype(np.int64)
        on = (place >= 0) & (place < len(where))
        return on & where[np.clip(place, 0, len(where) - 1)]

    @property
    def half(self) -> int:
        """Grid steps in half a second, fewer where the whole log is short."""
        n = int(self.rim.shape[-1])
        return max(1, min(round(0.5 / self.step), n // 8))

    def slope(self, x: Floats) -> Floats:
        """Rate of change of x over about a second, shape (..., n) [1/s]."""
        j = self.half
        rate = np.full(x.shape, np.nan)
        rate[..., j:-j] = (x[..., 2 * j :] - x[..., : -2 * j]) / (2.0 * j * self.step)
        return rate

    def mean(self, x: Floats) -> Floats:
        """Mean over the same stretch, shape (..., n)."""
        j = self.half
        known = np.isfinite(x)
        halves = np.stack([np.where(known, x, 0.0), ~known])
        total = np.cumsum((halves[..., 1:] + halves[..., :-1]) / 2.0, axis=-1)
        total = np.concatenate([np.zeros((*total.shape[:-1], 1)), total], axis=-1)
        smooth = np.full(x.shape, np.nan)
        within, lacking = total[..., 2 * j :] - total[..., : -2 * j]
        smooth[..., j:-j] = np.where(lacking > 0.0, np.nan, within / (2.0 * j))
        return smooth


def grid(axles: Sequence[AxleChannels], vehicle: Vehicle, finest: float = STEP) -> Grid | None:
    """None where all axles share too little time, or where a clock jumps back.

    Args:
        axles: of one log.
        vehicle: for the wheels' radii.
        finest: step where the log is fast enough [s].
    """
    return grids(axles, vehicle, [finest])[0]


def grids(
    axles: Sequence[AxleChannels], vehicle: Vehicle, finest: Sequence[float]
) -> list[Grid] | list[None]:
    """`grid` for several steps: each channel is integrated once."""
    steps = _steps(axles, finest)
    if not steps:
        return [None] * len(finest)
    first = max(int(a.record.t[0]) for a in axles)
    last = min(int(a.record.t[-1]) for a in axles)
    evens = [_Even.of(s, int((last - first) / 1e9 / s) + 1) for s in steps]
    means = _Means(first, evens)
    rows = [np.full((3, len(axles), len(e.t)), np.nan) for e in evens]
    for i, a in enumerate(axles):
        r, radius = a.record, vehicle.radius(a.record.axle).value
        for row, x in zip(rows, means.of(r, r.wheel_speed), strict=True):
            row[0, i] = radius * x
        brakes = [r.clamping_force_smooth, *([] if r.pressure is None else [r.pressure])]
        for k, brake in enumerate(brakes, 1):
            # The true one is higher than where the sensor's range ends.
            known = brake if r.saturated is None else np.where(r.saturated, np.nan, brake)
            for row, x in zip(rows, means.of(r, known), strict=True):
                row[k, i] = x
    trains = means.of_train(axles)
    return [
        Grid(first, e.step, rim, clamping, pressure, train, error)
        for e, (rim, clamping, pressure), (train, error) in zip(evens, rows, trains, strict=True)
    ]


def with_train(g: Grid, axles: Sequence[AxleChannels]) -> Grid:
    """The grid of axles of which only the train speed is another one."""
    even = _Even.of(g.step, g.rim.shape[-1])
    train, error = _Means(g.first, [even]).of_train(axles)[0]
    return replace(g, train=train, train_error=error)


def _steps(axles: Sequence[AxleChannels], finest: Sequence[float]) -> list[float]:
    """The step of each grid [s]; none where there can be no grid."""
    if not axles:
        return []
    usual = 0.0
    for i, a in enumerate(axles):
        if i == 0 or not np.array_equal(a.record.t, axles[i - 1].record.t):
            between = np.diff(a.record.t)
            if (between <= 0).any():
                return []  # it is not known what was at the same time
            usual = max(usual, median(between) / 1e9)
    first = max(int(a.record.t[0]) for a in axles)
    span = (min(int(a.record.t[-1]) for a in axles) - first) / 1e9
    steps = [max(usual, min(s, span / 200.0), span / _MOST) for s in finest]
    if usual > _SLOW:
        steps = [max(s, span / 500.0) for s in steps]
    return steps if all(int(span / s) + 1 >= LEAST for s in steps) else []


class _Even(NamedTuple):
    """The times of a grid."""

    step: float  # [s]
    t: Floats  # after its first time, (n,) [s]

    @classmethod
    def of(cls, step: float, n: int) -> "_Even":
        return cls(step, step * np.arange(n, dtype=np.float64))


class _Place(NamedTuple):
    """Where times lie between samples, for what is linear between these."""

    before: NDArray[np.int64]
    after: NDArray[np.int64]
    beyond: Floats  # the sample before [s]
    gap: Floats  # between the two samples [s]

    @classmethod
    def of(cls, u: Floats, t: Floats) -> "_Place":
        """Times t, rising and within those of the samples, u."""
        before = np.searchsorted(u, t, side="right") - 1
        after = np.minimum(before + 1, len(u) - 1)
        return cls(before, after, t - u[before], np.where(after > before, u[after] - u[before], 1))

    def at(self, x: Floats) -> Floats:
        """What samples x give there."""
        low = x[self.before]
        value: Floats = (x[self.after] - low) / self.gap * self.beyond + low
        return value


class _Cells:
    """The steps of a grid, each around its time, over samples at the times u (m,) [s]."""

    def __init__(self, u: Floats, even: _Even) -> None:
        self.inside = (even.t >= u[0]) & (even.t <= u[-1])
        t, half = even.t[self.inside], even.step / 2.0
        low, high = (np.clip(t + x, u[0], u[-1]) for x in (-half, half))
        self._width = high - low
        self._low, self._high = _Place.of(u, low), _Place.of(u, high)

    def means(self, area: Floats) -> Floats:
        """Means over the steps inside, by the integral up to each sample (m,)."""
        mean: Floats = (self._high.at(area) - self._low.at(area)) / self._width
        return mean


class _Means:
    """Means of an axle's channels over the steps of grids that begin at `first` [ns]."""

    def __init__(self, first: int, evens: Sequence[_Even]) -> None:
        self._first, self._evens = first, evens
        self._own = np.empty(0)  # times of the latest axle [s]
        self._of: AxleRecord | None = None
        self._cells: dict[int, list[_Cells]] = {}  # of whole segments, by their beginning

    def of(self, record: AxleRecord, x: Floats) -> list[Floats]:
        """Of each grid, (n,); NaN outside the segments."""
        self._take(record)
        found = [np.full(len(e.t), np.nan) for e in self._evens]
        for s in record.segments:
            own, known = self._own[s], np.isfinite(x[s])
            whole = bool(known.all())
            u, y = (own, x[s]) if whole else (own[known], x[s][known])
            if len(u) < 2:
                continue
            cells = self._cells.get(s.start) if whole else None
            cells = cells or [_Cells(u, e) for e in self._evens]
            if whole:
                self._cells[s.start] = cells
            area = _integral(u, y)
            for even, c, row in zip(self._evens, cells, found, strict=True):
                mean = c.means(area)
                if not whole:  # no gap is bridged
                    bridged = np.interp(even.t[c.inside], own, known) < 0.5
                    mean = np.where(bridged, np.nan, mean)
                row[c.inside] = mean
        return found

    def of_train(self, axles: Sequence[AxleChannels]) -> list[tuple[Floats | None, Floats | float]]:
        """The train speed and its error (95 %), of each grid."""
        for r in (a.record for a in axles):
            if r.train_speed is not None:
                speeds = self.of(r, r.train_speed)
                if r.train_speed_sigma is None:
                    return [(v, 0.0) for v in speeds]
                sigmas = self.of(r, r.train_speed_sigma)
                return [(v, Z95 * s) for v, s in zip(speeds, sigmas, strict=True)]
        return [(None, 0.0) for _ in self._evens]

    def _take(self, r: AxleRecord) -> None:
        """Takes the times of an axle; columns of one table share them."""
        last, self._of = self._of, r
        if last is r or (last and last.segments == r.segments and np.array_equal(last.t, r.t)):
            return
        self._own, self._cells = (r.t - self._first) / 1e9, {}


def _integral(u: Floats, y: Floats) -> Floats:
    """∫ y du up to each sample, shape (m,)."""
    area = np.zeros(len(u))
    middle = y[1:] + y[:-1]
    middle /= 2.0
    middle *= np.diff(u)
    np.cumsum(middle, out=area[1:])
    return area


def largest(x: Floats) -> Floats:
    """Largest finite value over the axles, NaN where there is none; shape (n,)."""
    top: Floats = np.max(np.where(np.isfinite(x), x, -np.inf), axis=0)
    return np.where(np.isfinite(top), top, np.nan)


def far(mask: Bools, j: int) -> Bools:
    """True more than j samples from every False, shape (..., n)."""
    near, reached = ~mask, 0  # that many samples or fewer from a False
    while reached < j:
        more = min(j - reached, 2 * reached + 1)  # a step to each side reaches three times as far
        wide = near.copy()
        wide[..., more:] |= near[..., :-more]
        wide[..., :-more] |= near[..., more:]
        near, reached = wide, reached + more
    return ~near


def lasting(mask: Bools, seconds: float, g: Grid) -> Bools:
    """The runs of True that last longer than that, shape (n,)."""
    long = np.zeros(len(mask), dtype=np.bool_)
    for first, past in true_runs(mask):
        long[first:past] = (past - first) * g.step > seconds
    return long


def _of_usual(share: Floats, where: Bools) -> Floats:
    """Each row over its own high value; shape (k, n)."""
    found = np.full(share.shape, np.nan)
    for row, x in zip(found, share, strict=True):
        known = x[np.isfinite(x) & where]
        if len(known):
            row[:] = x / max(float(np.quantile(known, 0.9)), 1e-9)
    return found
