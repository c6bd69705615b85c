"""All axles of a log on one coarse, even grid, on which an hour is 14 400 numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from ..core.finding import Finding
from ..core.masks import erode, true_runs
from ..core.model import Z95, AxleRecord, Bools, Floats, Times, Vehicle, without_motors
from ..core.physics import CRAWL, GRADIENT, RELEASED_SHARE, G, table_share, wheelset
from ..core.signals import running_integral
from ..records.axle_channels import AxleChannels
from .track import Gradient

GRADIENT_SIGMA = 0.05  # 1 sigma of gradients along the track: 5 per mille, assumed [m/s²]
FEWEST = 8  # samples on it that show anything
STEP = 0.25  # where the log is fast enough [s]
FINE_STEP = 0.05  # the same where brakes change [s]
# a log with longer intervals has more likely the wrong time unit than noise [s]
_LONGEST_INTERVAL = 5.0
_MOST_SAMPLES = 20_000  # samples on it
_FIRM_BRAKE = 0.3  # of the highest K: a brake that no motor works against
# a train that gains more than this without brake is driven: 3 % of gradient [m/s²]
_DRIVEN_RATE = 0.3
_GAIN = 0.05  # one that gains more beside a brake application is driven, or rolls downhill [m/s²]
_BESIDE = 6.0  # before and after a brake application [s]
_LEAST_BESIDE = 1.5  # of it that shows a gain [s]
_HELD_SHARE, _HELD_PRESSURE = 0.2, 5.5e4  # of the highest, and [Pa]: every brake acts above both
_HELD_RATE = 0.03  # a braked train that slows less for long is held on a downhill [m/s²]
_HELD_WINDOW, _HELD_TIME = 10.0, 20.0  # over which it slows, and shortest holding [s]


@dataclass(frozen=True)
class Grid:
    """All axles on one even time axis; NaN where a channel has no sample nearby, or a wrong one.

    Wrong is a pressure, and its K, where its sensor's range ends, while another brake acts, and
    while the brake holds the speed on a downhill that nobody knows.
    """

    start_ns: int  # its first time [ns]
    step: float  # [s]
    rim: Floats  # ω R by the vehicle's radius, shape (k, n) [m/s]
    clamping: Floats  # K times what a friction table says of φ, shape (k, n) [N]
    pressure: Floats  # p, shape (k, n) [Pa]; NaN where the log has K
    train: Floats | None  # train speed, shape (n,) [m/s]
    train_error: Floats | float = 0.0  # an integrated one may err by that (95 %), (n,) [m/s]
    friction: Floats | float = 1.0  # φ of the friction table over the stated φ, (k, n)
    # what the known gradient has taken from the speed of a train that rolls, (n,) [m/s]
    climb: Floats | float = 0.0
    gradient_sigma: float = GRADIENT_SIGMA  # 1 sigma of the gradient that is not known [m/s²]
    # the motors' part of K, and 1 sigma of their force at the rim; None without a channel of it
    motors: Floats | None = None  # (k, n) [N]
    motor_sigma: Floats | None = None  # (k, n) [N]
    # where the brake holds the speed on a downhill, and its pressures are left out, (n,)
    hold_mask: Bools | None = None

    @property
    def friction_clamping(self) -> Floats:
        """K of the friction brake alone, shape (k, n) [N]."""
        return without_motors(self.clamping, self.motors)

    @property
    def fastest(self) -> Floats:
        """The train speed, else the fastest axle's rim speed, shape (n,) [m/s]."""
        return largest(self.rim) if self.train is None else self.train

    @cached_property
    def braking(self) -> Floats:
        """Deceleration of the train, else the mean one of the axles that roll, (n,) [m/s²].

        NaN where a motor drives it.
        """
        return np.where(self.driven, np.nan, self._slowing_of_all)

    @property
    def driven(self) -> Bools:
        """Where the train gains speed without brake, and two seconds around: a motor drives it.

        One that gains alike before and after a brake application rolls downhill.
        """
        return self._drive[0]

    @property
    def downhill_sigma(self) -> Floats:
        """1 sigma of a gradient, where it may drive the train instead of motors, (n,) [m/s²]."""
        return self._drive[1]

    @cached_property
    def has_traction(self) -> bool:
        """Whether the log has the force by which motors drive the train."""
        return self.motors is not None and bool(np.nanmin(self.motors, initial=0.0) < 0.0)

    @cached_property
    def _drive(self) -> tuple[Bools, Floats]:
        K, second = self.smooth(largest(self.clamping)), 2 * self.half_width
        least_braking = RELEASED_SHARE * np.nanmax(K, initial=0.0)
        gain, downhill_sigma = -self._slowing_of_all, np.zeros(len(K))
        motor_mask = ~erode(~((least_braking > K) & (gain > _DRIVEN_RATE)), 2 * second)
        applications = [] if self.has_traction else true_runs(least_braking <= K)
        edges = [0, *np.ravel(applications).astype(int), len(K)]
        for i, (start, stop) in enumerate(applications):
            releases = slice(edges[2 * i], start), slice(stop, edges[2 * i + 3])
            gain_before, gain_after = (
                self._gain_beside(gain[release][::order])
                for release, order in zip(releases, (-1, 1), strict=True)
            )
            if not self.fastest[stop - 1] > CRAWL:
                gain_after = math.nan  # it stood
            if abs(gain_before - gain_after) < _GAIN:
                continue
            for rate, release in zip((gain_before, gain_after), releases, strict=True):
                motor_mask[release] |= (rate > _GAIN) & (gain[release] > _GAIN)
            if motor_mask[max(start - second, 0) : start].any():  # the motor releases late
                motor_mask[start : start + 2 * second] = True
            if _GAIN < gain_before < GRADIENT:
                ignorance = self.gradient_sigma / GRADIENT_SIGMA  # 1 where no gradient is known
                downhill_sigma[edges[2 * i] : stop] = ignorance * gain_before / 2.0
        return ~erode(~motor_mask, 1), downhill_sigma

    def _gain_beside(self, gain: Floats) -> float:
        """The mean gain beside a brake, of samples in order from it; NaN where too few are known.

        Within a second of it a gain is not that of a train without brake.
        """
        second = 2 * self.half_width
        near_gain = gain[second : second + round(_BESIDE / self.step)]
        near_gain = near_gain[np.isfinite(near_gain)]
        lasts = len(near_gain) * self.step >= _LEAST_BESIDE
        return float(np.mean(near_gain)) if lasts else math.nan

    @cached_property
    def _slowing_of_all(self) -> Floats:
        if self.train is not None:
            return self.slowing(self.train)
        rolls = np.sum(self.rolling, axis=0)
        sums = np.sum(np.where(self.rolling, self.slowing(self.rim), 0.0), axis=0)
        return np.where(rolls > 0, sums / np.maximum(rolls, 1), np.nan)

    @cached_property
    def share(self) -> Floats:
        """Rim speeds as shares of the train's, 1 while rolling whatever the diameters; (k, n).

        A braked wheel that slides turns slower than the train: the usual ratio is a high one.
        """
        fastest = self.fastest
        top = float(np.nanmax(fastest, initial=0.0))
        shares = self.rim / np.where(fastest > max(0.1 * top, 1e-9), fastest, np.nan)
        for row in shares:
            usual = row[np.isfinite(row) & (fastest > 0.3 * top)]
            row /= max(float(np.quantile(usual, 0.9)), 1e-9) if len(usual) else np.nan
        return shares

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
        return bool(np.any(-self.slowing(self.fastest)[braked] > GRADIENT))

    def sample_mask(self, t: Times, grid_mask: Bools) -> Bools:
        """A mask on the grid, shape (n,), as one on samples at these times, shape (m,)."""
        place = np.rint((t - self.start_ns) / (1e9 * self.step)).astype(np.int64)
        inside = (place >= 0) & (place < len(grid_mask))
        return inside & grid_mask[np.clip(place, 0, len(grid_mask) - 1)]

    @property
    def t(self) -> Times:
        """Its times [ns], shape (n,)."""
        steps = np.arange(self.rim.shape[1], dtype=np.float64) * self.step * 1e9
        return self.start_ns + np.rint(steps).astype(np.int64)

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

    @cached_property
    def rim_rate(self) -> Floats:
        """Rate of change of the rim speeds, shape (k, n) [m/s²]."""
        return self.slope(self.rim)

    @cached_property
    def train_rate(self) -> Floats | None:
        """Rate of change of the train speed, shape (n,) [m/s²]."""
        return None if self.train is None else self.slope(self.train)

    def slowing(self, v: Floats) -> Floats:
        """Deceleration without that by the known gradient, shape (..., n) [m/s²]."""
        return -self.slope(v + self.climb)

    def smooth(self, x: Floats) -> Floats:
        """Mean of x over about a second, shape (..., n)."""
        j = self.half_width
        finite = np.isfinite(x)
        halves = np.stack([np.where(finite, x, 0.0), ~finite])
        total = np.cumsum((halves[..., 1:] + halves[..., :-1]) / 2.0, axis=-1)
        total = np.concatenate([np.zeros((*total.shape[:-1], 1)), total], axis=-1)
        means = np.full(x.shape, np.nan)
        sums, lacking = total[..., 2 * j :] - total[..., : -2 * j]
        means[..., j:-j] = np.where(lacking > 0.0, np.nan, sums / (2.0 * j))
        return means


class Grids(NamedTuple):
    """All axles of a log on a coarse grid, for what rolls, and on one as fine as brakes change."""

    coarse: Grid
    fine: Grid


def on_gradient(grids: Grids, gradient: Gradient | None, vehicle: Vehicle) -> Grids:
    """The grids of a log whose gradient is known, or None."""
    if gradient is None:
        return grids
    share = wheelset(replace(vehicle, axles=()), 1).rolling  # of the mean axle
    climbing = []
    for g in grids:
        slowing, seconds = share * G * gradient.at(g.t), (g.t - g.start_ns) * np.float64(1e-9)
        climb = running_integral(seconds, slowing)
        climbing.append(replace(g, climb=climb, gradient_sigma=G * gradient.sigma))
    return Grids(*climbing)


def without_pressures(grids: Grids, start_ns: int, other_brakes: Sequence[Finding]) -> Grids:
    """The grids without the pressures that do not show what slows.

    So it is while another brake acts, and while the brake holds the speed on a downhill.
    """
    spans = [span for f in other_brakes for span in f.spans]
    masked = []
    for g in grids:
        t, hold_mask = (g.t - start_ns) * 1e-9, _hold_mask(g)
        acts = hold_mask.copy()
        for start, stop in spans:
            acts |= (t > start - g.step) & (t < stop + g.step)
        clamping, pressure = (np.where(acts, np.nan, x) for x in (g.clamping, g.pressure))
        masked.append(replace(g, clamping=clamping, pressure=pressure, hold_mask=hold_mask))
    return Grids(*masked)


def _hold_mask(g: Grid) -> Bools:
    """Where all axles are braked for long and the train keeps its speed; shape (n,)."""
    lowest = g.smooth(np.min(g.pressure, axis=0))
    threshold = _HELD_PRESSURE
    if not np.isfinite(lowest).any():
        lowest, threshold = g.smooth(np.min(g.clamping, axis=0)), 0.0
    pressed = lowest > max(threshold, _HELD_SHARE * float(np.nanmax(lowest, initial=0.0)))
    v, j = g.fastest + g.climb, max(round(_HELD_WINDOW / g.step / 2.0), 1)
    hold_mask, keeps_speed = np.zeros((2, len(v)), dtype=np.bool_)
    keeps_speed[j:-j] = np.abs(v[2 * j :] - v[: -2 * j]) < _HELD_RATE * 2 * j * g.step
    for start, stop in true_runs(pressed & keeps_speed & (g.fastest > CRAWL)):
        lasts = (stop - start) * g.step > _HELD_TIME
        # a stop in a wrong unit of time is no holding, and it kept its speed for half a window more
        if lasts and g.fastest[stop - 1] > g.fastest[start] / 2.0:
            hold_mask[max(start - j, 0) : stop + j] = True
    return hold_mask & pressed


def build_grids(axles: Sequence[AxleChannels]) -> Grids | None:
    """Both grids; None where `grid` is."""
    coarse, fine = (grid(axles, step) for step in (STEP, FINE_STEP))
    return Grids(coarse, fine) if coarse and fine else None


def grid(axles: Sequence[AxleChannels], finest: float = STEP) -> Grid | None:
    """None where all axles share too little time, or where a clock jumps back.

    The step is `finest` [s] where the log is fast enough.
    """
    step = _step(axles, finest)
    if step is None:
        return None
    start_ns = max(int(a.record.t[0]) for a in axles)
    stop_ns = min(int(a.record.t[-1]) for a in axles)
    t = step * np.arange(int((stop_ns - start_ns) / 1e9 / step) + 1, dtype=np.float64)
    records = [a.record for a in axles]
    radii = np.array([[a.vehicle.wheel_radius[0].value] for a in axles])
    on_grid = partial(_rows, records, start_ns, t)
    rim = radii * on_grid([r.wheel_speed for r in records])
    clamping = on_grid([_within_range(r, r.clamping_force_smooth) for r in records])
    pressure = on_grid([_within_range(r, r.pressure) for r in records])
    motors = sigma = train = None
    train_error: Floats | float = 0.0
    if any(a.motors for a in axles):
        motors = on_grid([r.motor_clamping_smooth for r in records], without=0.0)
        sigma = on_grid([r.motor_sigma for r in records], without=0.0)
    if r := next((r for r in records if r.train_speed is not None), None):
        train, train_sigma = _rows([r, r], start_ns, t, [r.train_speed, r.train_speed_sigma])
        train_error = 0.0 if r.train_speed_sigma is None else Z95 * train_sigma
    by_friction = without_motors(clamping, motors)
    friction: Floats | float = 1.0
    tables = [a.friction_table or a.vehicle.friction_table for a in axles]
    if any(tables):
        rows = zip(rim, by_friction, tables, strict=True)
        friction = np.array([table_share(v, K, x) * np.ones(len(t)) for v, K, x in rows])
    clamping = friction * by_friction + (0.0 if motors is None else motors)
    speeds = train, train_error, friction
    return Grid(start_ns, step, rim, clamping, pressure, *speeds, motors=motors, motor_sigma=sigma)


def _within_range(record: AxleRecord, brake: Floats | None) -> Floats | None:
    """A brake without what is at the end of its sensor's range: the true one is higher there."""
    if brake is None or record.saturated is None:
        return brake
    return np.where(record.saturated, np.nan, brake)


def _step(axles: Sequence[AxleChannels], finest: float) -> float | None:
    """The step of a grid [s]; None where there can be no grid."""
    if not axles:
        return None
    usual = 0.0
    for intervals in (np.diff(a.record.t) for a in axles):
        if (intervals <= 0).any():
            return None  # it is not known what was at the same time
        usual = max(usual, float(np.median(intervals)) / 1e9)
    start_ns = max(int(a.record.t[0]) for a in axles)
    span = (min(int(a.record.t[-1]) for a in axles) - start_ns) / 1e9
    step = max(usual, min(finest, span / 200.0), span / _MOST_SAMPLES)
    if usual > _LONGEST_INTERVAL:
        step = max(step, span / 500.0)
    return step if int(span / step) + 1 >= FEWEST else None


def _rows(
    records: Sequence[AxleRecord],
    start_ns: int,
    t: Floats,
    columns: Sequence[Floats | None],
    without: float = math.nan,
) -> Floats:
    """A column of each axle over the steps of a grid, (k, n); `without`, of an axle without it.

    The times of the grid `t` [s] count from `start_ns`.
    """
    rows = np.full((len(records), len(t)), without)
    for row, r, x in zip(rows, records, columns, strict=True):
        if x is not None:
            row[:] = _means(r, x, start_ns, t)
    return rows


def _means(record: AxleRecord, x: Floats, start_ns: int, t: Floats) -> Floats:
    """Means of one column over the steps, (n,); NaN outside the segments."""
    means, half_step = np.full(len(t), np.nan), t[1] / 2.0
    for s in record.segments:
        u, finite = (record.t[s] - start_ns) / 1e9, np.isfinite(x[s])
        if finite.sum() < 2:
            continue
        known_t, y = u[finite], x[s][finite]
        inside = (t >= known_t[0]) & (t <= known_t[-1])
        edges = t[inside] - half_step, t[inside] + half_step
        window_starts, window_stops = (np.clip(x, known_t[0], known_t[-1]) for x in edges)
        area = running_integral(known_t, y)
        gained = np.interp(window_stops, known_t, area) - np.interp(window_starts, known_t, area)
        bridged = np.interp(t[inside], u, finite) < 0.5  # no gap is bridged
        means[inside] = np.where(bridged, np.nan, gained / (window_stops - window_starts))
    return means


def largest(x: Floats) -> Floats:
    """Largest finite value over the axles, NaN where there is none; shape (n,)."""
    top: Floats = np.max(np.where(np.isfinite(x), x, -np.inf), axis=0)
    return np.where(np.isfinite(top), top, np.nan)


def long_runs(mask: Bools, seconds: float, g: Grid) -> Bools:
    """The runs of True that last longer than that, shape (n,)."""
    in_long_run = np.zeros(len(mask), dtype=np.bool_)
    for start, stop in true_runs(mask):
        in_long_run[start:stop] = (stop - start) * g.step > seconds
    return in_long_run
