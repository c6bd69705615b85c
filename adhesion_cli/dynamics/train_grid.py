"""All axles of a log on one coarse, even grid, on which an hour is 14 400 numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.finding import Finding, Severity, merged
from ..core.model import (
    Z95,
    AxleRecord,
    Bools,
    Channel,
    Floats,
    Parameter,
    Times,
    Vehicle,
)
from ..core.physics import FREE as FREE
from ..core.physics import GRADIENT, rolling_deceleration, wheelset
from ..core.signals import true_runs

LEAST = 8  # samples on it that show anything
_STEP = 0.25  # where the log is fast enough [s]
_SLOW = 5.0  # a log with longer intervals has more likely the wrong time unit than noise [s]
_MOST = 20_000  # samples on it
_FIRMLY = 0.3  # of the highest K: a brake that no motor works against
_DRIVEN = 0.3  # a train that gains more than this without brake is driven: 3 % of gradient [m/s²]


class Axle(NamedTuple):
    """One axle's record and the channels it comes from."""

    record: AxleRecord
    speed: Channel
    brake: Channel
    train: Channel | None


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


class Line(NamedTuple):
    """Another force line: K is s (K − o)."""

    scale: float  # s
    offset: float  # o [N]
    factor: float  # on the highest K


class Piece(NamedTuple):
    """What a stretch of the log says of one number."""

    begin: float  # seconds after the first time of the grid
    end: float
    value: Parameter


class Design(NamedTuple):
    """The pieces of one log, and its clamping force all along."""

    t: Floats  # even, (n,) [s]
    K: Floats  # as a straight line of the pressure, below zero too, over its highest value; (n,)
    faster: Floats  # u − ū (n,) [m/s]
    top: float  # the highest K [N]
    at: NDArray[np.int64]  # samples of the pieces, (m,)
    first: NDArray[np.int64]  # place of each piece's first one in `at`, (p,)
    size: Floats  # how many each has, (p,)
    doubt: Floats  # prior covariance of the pieces' gradients, (p, p) [m²/s⁴]
    bends: bool  # whether pieces have γ
    time: Floats  # from the piece's middle, (m,) [s]
    measured: Floats  # speed (m,) [m/s]
    v: Floats  # speed without α and γ (m,) [m/s]
    speed: Floats  # that itself, smooth (m,) [m/s]
    squared: Floats  # ∫u² dt without α and γ (m,) [m²/s]
    c: float  # deceleration by the highest K [m/s²]
    noise: float  # 1 sigma of v's white noise [m/s]
    floor: float  # 1 sigma of what no noise shows: rounding, and what the model leaves out [m/s]
    seen: bool  # whether a train speed would show that all wheels slide
    interval: float  # the longer one of speed and pressure [s]
    mean: float  # ū, at which c holds [m/s]
    creeps: bool  # whether the speed is that of wheels


class Explanation(NamedTuple):
    """What differs from the stated vehicle, as far as the log shows."""

    late: Parameter  # by which the pressure is late, with its 1 sigma [s]; 0 where clocks agree
    line: Line | None  # None where it is as stated
    either: bool = False  # it is one of both, and nothing says which
    # By the vehicle as stated: the gradient that would explain what the pressure does not, above 0
    # where it drives the train [m/s²].
    pieces: tuple[Piece, ...] = ()
    # The brake applications of wheels that roll, by the train speed, else by the wheels.
    design: Design | None = None


class Scene(NamedTuple):
    """What every check looks at."""

    axles: Sequence[Axle]
    grid: Grid
    vehicle: Vehicle
    start_ns: int  # the log's start
    explanation: Explanation  # of how the train slows

    @property
    def by_rolling(self) -> float:
        """Deceleration of a train that rolls, per K of an axle [m/s² per N]. Source: (1)."""
        axle = self.axles[0].record.axle
        w = wheelset(self.vehicle, axle)
        return rolling_deceleration(w) * self.vehicle.radius(axle).value

    def found(  # noqa: PLR0913 (the fields of a finding)
        self, code: str, severity: Severity, channel: Channel, where: Bools | None = None,
        axle: int = 0, values: Mapping[str, float] | None = None,
        names: Mapping[str, str] | None = None,
    ) -> Finding:  # fmt: skip
        """A finding about the samples of an axle, by its place, where a mask on the grid holds."""
        t = self.axles[axle].record.t
        on = np.ones(len(t), dtype=np.bool_) if where is None else self.grid.at(t, where)
        since = (t - self.start_ns) / 1e9
        spans = merged([(float(since[a]), float(since[b - 1])) for a, b in true_runs(on)])
        return Finding(
            code, severity, channel.title, max(int(on.sum()), 1), spans,
            values or {}, names or {},
        )  # fmt: skip


def grid(axles: Sequence[Axle], vehicle: Vehicle, finest: float = _STEP) -> Grid | None:
    """None where all axles share too little time, or where a clock jumps back.

    Args:
        axles: of one log.
        vehicle: for the wheels' radii.
        finest: step where the log is fast enough [s].
    """
    if not axles or any((np.diff(a.record.t) <= 0).any() for a in axles):
        return None  # it is not known what was at the same time
    first = max(int(a.record.t[0]) for a in axles)
    last = min(int(a.record.t[-1]) for a in axles)
    usual = max(float(np.median(np.diff(a.record.t))) for a in axles) / 1e9
    span = (last - first) / 1e9
    step = max(usual, min(finest, span / 200.0), span / _MOST)
    if usual > _SLOW:
        step = max(step, span / 500.0)
    n = int(span / step) + 1
    if n < LEAST:
        return None
    t = step * np.arange(n, dtype=np.float64)
    rim, clamping, pressure = np.full((3, len(axles), n), np.nan)
    train: Floats | None = None
    error: Floats | float = 0.0
    for i, a in enumerate(axles):
        r = a.record
        own = (r.t - first) / 1e9
        radius = vehicle.radius(r.axle).value
        ends = False if r.saturated is None else r.saturated  # the true one is higher there
        rim[i] = radius * _even(own, r.wheel_speed, r.segments, t, step)
        K = np.where(ends, np.nan, r.clamping_force_smooth)
        clamping[i] = _even(own, K, r.segments, t, step)
        if r.pressure is not None:
            p = np.where(ends, np.nan, r.pressure)
            pressure[i] = _even(own, p, r.segments, t, step)
        if train is None and r.train_speed is not None:
            train = _even(own, r.train_speed, r.segments, t, step)
            if r.train_speed_sigma is not None:
                error = Z95 * _even(own, r.train_speed_sigma, r.segments, t, step)
    return Grid(first, step, rim, clamping, pressure, train, error)


def _even(own: Floats, x: Floats, segments: tuple[slice, ...], t: Floats, step: float) -> Floats:
    """Means over a step, at even times; NaN outside the segments."""
    found = np.full(len(t), np.nan)
    for s in segments:
        known = np.isfinite(x[s])
        u, y = own[s][known], x[s][known]
        if len(u) < 2:
            continue
        area = np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2.0 * np.diff(u))])
        low = np.clip(t - step / 2.0, u[0], u[-1])
        high = np.clip(t + step / 2.0, u[0], u[-1])
        inside = (t >= u[0]) & (t <= u[-1])
        inside &= np.interp(t, own[s], known) >= 0.5  # no gap is bridged
        mean = (np.interp(high, u, area) - np.interp(low, u, area))[inside]
        found[inside] = mean / (high - low)[inside]
    return found


def largest(x: Floats) -> Floats:
    """Largest finite value over the axles, NaN where there is none; shape (n,)."""
    top: Floats = np.max(np.where(np.isfinite(x), x, -np.inf), axis=0)
    return np.where(np.isfinite(top), top, np.nan)


def far(mask: Bools, j: int) -> Bools:
    """True more than j samples from every False, shape (..., n)."""
    along = [(0, 0)] * (mask.ndim - 1)
    wide = np.pad(~mask, [*along, (j, j)], mode="edge")
    before = np.pad(np.cumsum(wide, axis=-1), [*along, (1, 0)])  # how many are False
    far: Bools = before[..., 2 * j + 1 :] == before[..., : -2 * j - 1]
    return far


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
