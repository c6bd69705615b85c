"""All axles of a log on one coarse, even grid, on which an hour is 14 400 numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
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
from ..core.physics import GRADIENT, RELEASED_SHARE
from ..core.signals import median, true_runs
from ..records.axle_channels import AxleChannels

FEWEST = 8  # samples on it that show anything
STEP = 0.25  # where the log is fast enough [s]
FINE_STEP = 0.05  # the same where brakes change [s]
# a log with longer intervals has more likely the wrong time unit than noise [s]
_LONGEST_INTERVAL = 5.0
_MOST_SAMPLES = 20_000  # samples on it
_FIRM_BRAKE = 0.3  # of the highest K: a brake that no motor works against
# a train that gains more than this without brake is driven: 3 % of gradient [m/s²]
_DRIVEN_RATE = 0.3


@dataclass(frozen=True)
class Grid:
    """All axles on one even time axis; NaN where a channel has no sample nearby, or a wrong one.

    Wrong is a pressure, and its K, where its sensor's range ends.
    """

    start_ns: int  # its first time [ns]
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
        driven = (RELEASED_SHARE * np.nanmax(K, initial=0.0) > K) & (slowing < -_DRIVEN_RATE)
        return np.where(erode(~driven, 2 * self.half_width), slowing, np.nan)

    @cached_property
    def share(self) -> Floats:
        """Rim speeds as shares of the train's, 1 while rolling whatever the diameters; (k, n).

        A braked wheel that slides turns slower than the train: the usual ratio is a high one.
        """
        fastest = self.fastest
        top = float(np.nanmax(fastest, initial=0.0))
        ratio = self.rim / np.where(fastest > max(0.1 * top, 1e-9), fastest, np.nan)
        return _relative_to_high(ratio, fastest > 0.3 * top)

    @cached_property
    def rolling(self) -> Bools:
        """Where an axle does not slide, as far as the log shows, nor within a second; (k, n)."""
        turns_as_train = np.abs(self.share - 1.0) < 0.03
        return erode(turns_as_train, 2 * self.half_width)

    @cached_property
    def slid_together(self) -> bool:
        """Whether the fastest wheel gained speed while braked: no train does, so all slid."""
        if self.train is not None:
            return False
        K = largest(self.clamping)
        braked = ~erode(_FIRM_BRAKE * np.nanmax(K, initial=0.0) > K, 2 * self.half_width)
        return bool(np.any(self.slope(self.fastest)[braked] > GRADIENT))

    def sample_mask(self, t: Times, grid_mask: Bools) -> Bools:
        """A mask on the grid, shape (n,), as one on samples at these times, shape (m,)."""
        place = np.rint((t - self.start_ns) / (1e9 * self.step)).astype(np.int64)
        inside = (place >= 0) & (place < len(grid_mask))
        return inside & grid_mask[np.clip(place, 0, len(grid_mask) - 1)]

    @property
    def half_width(self) -> int:
        """Grid steps in half a second, fewer where the whole log is short."""
        n = int(self.rim.shape[-1])
        return max(1, min(round(0.5 / self.step), n // 8))

    def slope(self, x: Floats) -> Floats:
        """Rate of change of x over about a second, shape (..., n) [1/s]."""
        j = self.half_width
        rate = np.full(x.shape, np.nan)
        rate[..., j:-j] = (x[..., 2 * j :] - x[..., : -2 * j]) / (2.0 * j * self.step)
        return rate

    def mean(self, x: Floats) -> Floats:
        """Mean over the same stretch, shape (..., n)."""
        j = self.half_width
        finite = np.isfinite(x)
        halves = np.stack([np.where(finite, x, 0.0), ~finite])
        total = np.cumsum((halves[..., 1:] + halves[..., :-1]) / 2.0, axis=-1)
        total = np.concatenate([np.zeros((*total.shape[:-1], 1)), total], axis=-1)
        smooth = np.full(x.shape, np.nan)
        sums, lacking = total[..., 2 * j :] - total[..., : -2 * j]
        smooth[..., j:-j] = np.where(lacking > 0.0, np.nan, sums / (2.0 * j))
        return smooth


class Grids(NamedTuple):
    """All axles of a log on a coarse grid, for what rolls, and on one as fine as brakes change."""

    coarse: Grid
    fine: Grid


def build_grids(axles: Sequence[AxleChannels], vehicle: Vehicle) -> Grids | None:
    """Both grids; None where `grid` is. Arguments as of it."""
    coarse, fine = grids(axles, vehicle, [STEP, FINE_STEP])
    return Grids(coarse, fine) if coarse and fine else None


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
    start_ns = max(int(a.record.t[0]) for a in axles)
    stop_ns = min(int(a.record.t[-1]) for a in axles)
    evens = [_GridTimes.build(s, int((stop_ns - start_ns) / 1e9 / s) + 1) for s in steps]
    means = _Means(start_ns, evens)
    rows = [np.full((3, len(axles), len(e.t)), np.nan) for e in evens]
    for i, a in enumerate(axles):
        r, radius = a.record, vehicle.radius(a.record.axle).value
        for row, x in zip(rows, means.average(r, r.wheel_speed), strict=True):
            row[0, i] = radius * x
        brakes = [r.clamping_force_smooth, *([] if r.pressure is None else [r.pressure])]
        for k, brake in enumerate(brakes, 1):
            # The true one is higher than where the sensor's range ends.
            unsaturated = brake if r.saturated is None else np.where(r.saturated, np.nan, brake)
            for row, x in zip(rows, means.average(r, unsaturated), strict=True):
                row[k, i] = x
    trains = means.average_train(axles)
    return [
        Grid(start_ns, e.step, rim, clamping, pressure, train, error)
        for e, (rim, clamping, pressure), (train, error) in zip(evens, rows, trains, strict=True)
    ]


def _steps(axles: Sequence[AxleChannels], finest: Sequence[float]) -> list[float]:
    """The step of each grid [s]; none where there can be no grid."""
    if not axles:
        return []
    usual = 0.0
    for i, a in enumerate(axles):
        if i == 0 or not np.array_equal(a.record.t, axles[i - 1].record.t):
            intervals = np.diff(a.record.t)
            if (intervals <= 0).any():
                return []  # it is not known what was at the same time
            usual = max(usual, median(intervals) / 1e9)
    start_ns = max(int(a.record.t[0]) for a in axles)
    span = (min(int(a.record.t[-1]) for a in axles) - start_ns) / 1e9
    steps = [max(usual, min(s, span / 200.0), span / _MOST_SAMPLES) for s in finest]
    if usual > _LONGEST_INTERVAL:
        steps = [max(s, span / 500.0) for s in steps]
    return steps if all(int(span / s) + 1 >= FEWEST for s in steps) else []


class _GridTimes(NamedTuple):
    """The times of a grid."""

    step: float  # [s]
    t: Floats  # after its first time, (n,) [s]

    @classmethod
    def build(cls, step: float, n: int) -> "_GridTimes":
        return cls(step, step * np.arange(n, dtype=np.float64))


class _Place(NamedTuple):
    """Where times lie between samples, for what is linear between these."""

    left: NDArray[np.int64]
    right: NDArray[np.int64]
    distance: Floats  # the sample before [s]
    gap: Floats  # between the two samples [s]

    @classmethod
    def locate(cls, u: Floats, t: Floats) -> "_Place":
        """Times t, rising and within those of the samples, u."""
        left_index = np.searchsorted(u, t, side="right") - 1
        right_index = np.minimum(left_index + 1, len(u) - 1)
        return cls(
            left_index,
            right_index,
            t - u[left_index],
            np.where(right_index > left_index, u[right_index] - u[left_index], 1),
        )

    def interpolate(self, x: Floats) -> Floats:
        """What samples x give there."""
        left_value = x[self.left]
        value: Floats = (x[self.right] - left_value) / self.gap * self.distance + left_value
        return value


class _Cells:
    """The steps of a grid, each around its time, over samples at the times u (m,) [s]."""

    def __init__(self, u: Floats, times: _GridTimes) -> None:
        self.inside = (times.t >= u[0]) & (times.t <= u[-1])
        t, half_step = times.t[self.inside], times.step / 2.0
        left, right = (np.clip(t + x, u[0], u[-1]) for x in (-half_step, half_step))
        self._width = right - left
        self._lower, self._upper = _Place.locate(u, left), _Place.locate(u, right)

    def means(self, area: Floats) -> Floats:
        """Means over the steps inside, by the integral up to each sample (m,)."""
        mean: Floats = (self._upper.interpolate(area) - self._lower.interpolate(area)) / self._width
        return mean


class _Means:
    """Means of an axle's channels over the steps of grids that begin at `first` [ns]."""

    def __init__(self, start_ns: int, evens: Sequence[_GridTimes]) -> None:
        self._start_ns, self._evens = start_ns, evens
        self._axle_times = np.empty(0)  # times of the latest axle [s]
        self._record: AxleRecord | None = None
        self._cells: dict[int, list[_Cells]] = {}  # of whole segments, by their beginning

    def average(self, record: AxleRecord, x: Floats) -> list[Floats]:
        """Of each grid, (n,); NaN outside the segments."""
        self._take(record)
        rows = [np.full(len(e.t), np.nan) for e in self._evens]
        for s in record.segments:
            t, finite = self._axle_times[s], np.isfinite(x[s])
            complete = bool(finite.all())
            u, y = (t, x[s]) if complete else (t[finite], x[s][finite])
            if len(u) < 2:
                continue
            cells = self._cells.get(s.start) if complete else None
            cells = cells or [_Cells(u, e) for e in self._evens]
            if complete:
                self._cells[s.start] = cells
            area = _integral(u, y)
            for times, c, row in zip(self._evens, cells, rows, strict=True):
                mean = c.means(area)
                if not complete:  # no gap is bridged
                    bridged = np.interp(times.t[c.inside], t, finite) < 0.5
                    mean = np.where(bridged, np.nan, mean)
                row[c.inside] = mean
        return rows

    def average_train(
        self, axles: Sequence[AxleChannels]
    ) -> list[tuple[Floats | None, Floats | float]]:
        """The train speed and its error (95 %), of each grid."""
        for r in (a.record for a in axles):
            if r.train_speed is not None:
                speeds = self.average(r, r.train_speed)
                if r.train_speed_sigma is None:
                    return [(v, 0.0) for v in speeds]
                sigmas = self.average(r, r.train_speed_sigma)
                return [(v, Z95 * s) for v, s in zip(speeds, sigmas, strict=True)]
        return [(None, 0.0) for _ in self._evens]

    def _take(self, r: AxleRecord) -> None:
        """Takes the times of an axle; columns of one table share them."""
        previous, self._record = self._record, r
        if previous is r or (
            previous and previous.segments == r.segments and np.array_equal(previous.t, r.t)
        ):
            return
        self._axle_times, self._cells = (r.t - self._start_ns) / 1e9, {}


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


def erode(mask: Bools, j: int) -> Bools:
    """True more than j samples from every False, shape (..., n)."""
    reached_mask, width = ~mask, 0  # that many samples or fewer from a False
    while width < j:
        growth = min(j - width, 2 * width + 1)  # a step to each side reaches three times as far
        widened = reached_mask.copy()
        widened[..., growth:] |= reached_mask[..., :-growth]
        widened[..., :-growth] |= reached_mask[..., growth:]
        reached_mask, width = widened, width + growth
    return ~reached_mask


def long_runs(mask: Bools, seconds: float, g: Grid) -> Bools:
    """The runs of True that last longer than that, shape (n,)."""
    in_long_run = np.zeros(len(mask), dtype=np.bool_)
    for start, stop in true_runs(mask):
        in_long_run[start:stop] = (stop - start) * g.step > seconds
    return in_long_run


def _relative_to_high(share: Floats, fast: Bools) -> Floats:
    """Each row over its own high value; shape (k, n)."""
    rows = np.full(share.shape, np.nan)
    for row, x in zip(rows, share, strict=True):
        values = x[np.isfinite(x) & fast]
        if len(values):
            row[:] = x / max(float(np.quantile(values, 0.9)), 1e-9)
    return rows
