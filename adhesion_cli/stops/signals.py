"""What shows the stops of a train: its speed, its brakes and its commands, on one clock.

Times are seconds after the start of the log.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from ..core.finding import Finding
from ..core.masks import true_runs
from ..core.model import AxleRecord, Bools, Channel, Floats, Log, Meaning, Times, Vehicle
from ..core.physics import STANDING, with_fade
from ..core.signals import in_order, means_around, median_of_five, robust_sigma
from ..rail.speed_errors import CLEAR_SIGMAS, delay_sigma, has_uncertain_delay, unknown_delay
from ..rail.wheel_calibration import calibrate_radius
from ..train.longitudinal import EARLY

SpeedSource = Literal["train", "axles"]
FAST = 0.275  # longest interval of a fast train speed: 4 readings a second, and 10 % [s]
_AVERAGED = 5  # intervals of a slow train speed over which its difference to the wheels is averaged
_ROLLING = 0.03  # a rim that differs from the train by more slides, as a share of the speed
_GAIN = 0.5  # a braked train whose fastest wheel gains more than this slid with all wheels [m/s]
_SLOW_ROLLING = 0.5  # the same at low speed [m/s]
_COMMANDS: tuple[Meaning, ...] = ("brake_command", "emergency", "brake_pipe")
_VALVES: tuple[Meaning, ...] = ("hold_valve", "vent_valve")  # the last one counts
UNKNOWN_SCALE = 0.005  # 1 sigma of a speed sensor's scale, as a share, where nobody states it
DROP = 0.1  # of the full value: a fall in the build-up is a valve of the WSP
GAP = 5.0  # a longer interval, over the usual one, is a gap
_RELEASED = 3.0  # time before it over which the released level is a median [s]
_REACHED = 0.95  # of the highest brake: what comes before a valve vents has reached the full one
_HIGH_SHARE = 0.9  # of the highest brake: samples above it are those of the full brake


class TimeSeries(NamedTuple):
    """A quantity over time, both of shape (n,); times rise, values are finite or NaN."""

    t: Floats
    value: Floats

    def interpolated(self, t: Floats) -> Floats:
        """Values at other times, shape (m,); NaN before the first and after the last."""
        return np.interp(t, self.t, self.value, left=np.nan, right=np.nan)

    def cut(self, start: float, stop: float) -> "TimeSeries":
        """The samples from `start` to `stop`, both included."""
        selected = slice(*np.searchsorted(self.t, [start, np.nextafter(stop, np.inf)]))
        return TimeSeries(self.t[selected], self.value[selected])


class StopSignals(NamedTuple):
    """The signals of one log."""

    speed: TimeSeries  # of the train [m/s]
    speed_from: SpeedSource
    scale: float  # 1 sigma of the speed's scale, as a share
    delay_sigma: float  # 1 sigma of the speed's delay [s]
    rims: Mapping[int, TimeSeries]  # by axle, the speed of the wheel's rim as the train's [m/s]
    brakes: Mapping[int, TimeSeries]  # by axle, cylinder pressure [Pa], else clamping force [N]
    # brake_command, emergency, brake_pipe: every channel of the log, cars may have their own
    commands: Mapping[str, Sequence[TimeSeries]]
    valves: Mapping[int, TimeSeries] = {}  # by axle, its vent valve, else its hold valve: 0 or 1
    sanding: TimeSeries | None = None  # 0 or 1
    reservoir: TimeSeries | None = None  # pressure [Pa]
    saturated: Floats = np.empty(0)  # when a pressure is at the end of its sensor's range [s]
    by_pressure: bool = True  # whether `brakes` are pressures
    other_brakes: Sequence[Finding] = ()  # when brakes act that the log does not show
    pressure_sigma: float = 0.0  # 1 sigma of the pressures' delay, where the log shows one [s]
    mix_unknown: bool = False  # whether nobody knows the share of motors in the brake
    others_later: bool = False  # whether other cars brake later than the axles of the log
    is_coarse: Bools | None = None  # where the speed is a slow one, interpolated, (n,)
    interval: float = 0.0  # between the train speed's own samples [s]
    level_sigma: float = 0.0  # 1 sigma of the speed by those of a slow one, where wheels shape it
    radius_shares: Mapping[int, float] = {}  # by axle, 1 sigma of the wheel's radius
    # by axle, the clamping force with what friction changes of it, where the vehicle is known
    clamping: Mapping[int, TimeSeries] = {}
    knows_delay: bool = True  # whether the speed's delay is known, or as short as usual
    overlaps: Sequence[tuple[float, float]] = ()  # times that a clock that is set back gives twice
    filled: Bools | None = None  # where the speed was not logged, and is the wheels', (n,)

    @property
    def by_wheels(self) -> bool:
        """Whether the wheels give the shape of the speed."""
        return self.speed_from == "axles" or self.is_coarse is not None

    @property
    def wheels_show_begin(self) -> bool:
        """Whether the wheels show when the train begins to slow: its own speed may be late."""
        return self.by_wheels or (bool(self.rims) and not self.knows_delay)

    def coarse_interval(self, t: float) -> float:
        """The interval of a slow speed where no wheel shows its shape [s]; else 0."""
        if self.is_coarse is None:
            return 0.0
        place = min(int(np.searchsorted(self.speed.t, t)), len(self.is_coarse) - 1)
        return self.interval if self.is_coarse[place] else 0.0

    def least_speed(self, t: Floats) -> Floats:
        """The least speed [m/s] of a braked train at times t, by its possible delay; (m,)."""
        delayed_t: Floats = np.minimum(t + CLEAR_SIGMAS * self.delay_sigma, self.speed.t[-1])
        return np.minimum(self.speed.interpolated(t), self.speed.interpolated(delayed_t))


def of_records(records: Sequence[AxleRecord], log: Log, vehicle: Vehicle) -> StopSignals:
    """The signals of a log with wheel speeds and brakes, every axle on one clock."""
    start_ns, base = log.start_ns(), max(records, key=len)
    measured = base.train_speed is not None and not base.train_speed_made
    rims, radius_shares = {}, {}
    for r in records:
        radius = calibrate_radius(r, vehicle)[0] if measured else vehicle.radius(r.axle)
        alone = r.speeds_alone and r.speeds_alone.wheel_speed * radius.value
        rims[r.axle] = _on_segments(r, r.wheel_speed * radius.value, start_ns, alone)
        radius_shares[r.axle] = radius.tolerance / radius.value
    scale, sigma, is_coarse, filled, level_sigma = UNKNOWN_SCALE, 0.0, None, None, 0.0
    if measured and base.train_speed is not None:
        alone = base.speeds_alone and base.speeds_alone.train_speed
        train = _with_alone(base, base.train_speed, start_ns, alone)
        sigma = delay_sigma(base)
        if base.train_speed_interval > FAST:
            train, is_coarse, level_sigma = _shaped(train, rims, base.train_speed_interval)
        train, filled = _over_gaps(train, rims)
    else:
        radius = vehicle.radius(base.axle)
        train, scale = _fastest(rims, rims[base.axle].t), radius.share
    ends = [_seconds(r.t, start_ns)[r.saturated] for r in records if r.saturated is not None]
    pressure_delay = base.pressure_late
    brakes = {r.axle: _on_segments(r, _brake(r), start_ns) for r in records}
    by_friction = (with_fade(r, vehicle) for r in records)
    clamping = {r.axle: _on_segments(r, r.clamping_force, start_ns) for r in by_friction}
    if pressure_delay.value > 0.0:  # no train slows before its brakes act
        brakes, clamping = (
            {axle: TimeSeries(x.t - pressure_delay.value, x.value) for axle, x in columns.items()}
            for columns in (brakes, clamping)
        )
    return StopSignals(
        train,
        "train" if measured else "axles",
        scale,
        sigma,
        rims,
        brakes,
        saturated=np.concatenate([np.empty(0), *ends]),
        by_pressure=not any(map(_by_force, records)),
        pressure_sigma=math.hypot(pressure_delay.value / math.sqrt(3.0), pressure_delay.tolerance),
        others_later=pressure_delay.value < -EARLY,
        is_coarse=is_coarse,
        interval=base.train_speed_interval,
        level_sigma=level_sigma,
        radius_shares=radius_shares,
        clamping=clamping,
        knows_delay=not (measured and has_uncertain_delay(base)),
        overlaps=_overlaps(_seconds(base.t, start_ns)),
        filled=filled,
        **_logged(log),
    )


def _brake(record: AxleRecord) -> Floats:
    """What shows the brake of an axle: its pressure; the whole force where motors brake, too."""
    if record.pressure is None or _by_force(record):
        return np.maximum(record.clamping_force, 0.0)  # traction is no brake
    return record.pressure


def _by_force(record: AxleRecord) -> bool:
    return record.pressure is None or record.motor_clamping is not None


def of_log(log: Log, vehicle: Vehicle) -> StopSignals | None:
    """The signals of a log from which no record can be made, as logged; None without a speed."""
    start_ns = log.start_ns()
    speeds = _channels(log, "train_speed") or _channels(log, "wheel_speed")
    if not speeds:
        return None
    source: SpeedSource = "train" if speeds[0].meaning == "train_speed" else "axles"
    series = [_series(c, start_ns) for c in speeds]
    if source == "axles":  # ω to the speed of the rim
        series = [
            TimeSeries(x.t, x.value * vehicle.radius(c.axle or 1).value)
            for x, c in zip(series, speeds, strict=True)
        ]
    speed = max(series, key=lambda x: len(x.t))
    if source == "axles":
        speed = TimeSeries(speed.t, np.fmax.reduce([x.interpolated(speed.t) for x in series]))
    brakes = {
        c.axle or i: _series(c, start_ns)
        for i, c in enumerate(_channels(log, "pressure") or _channels(log, "clamping_force"), 1)
    }
    logged, sigma = _logged(log), 0.0
    if source == "train" and (brakes or logged["commands"]) and len(speed.t) > 1:
        sigma = unknown_delay(float(np.median(np.diff(speed.t))))
    by_pressure = bool(_channels(log, "pressure"))
    speed_and_scale = speed, source, UNKNOWN_SCALE, sigma
    return StopSignals(*speed_and_scale, {}, brakes, by_pressure=by_pressure, **logged)


def _channels(log: Log, meaning: Meaning) -> list[Channel]:
    return [c for c in log.channels if c.meaning == meaning and len(c.data.t) > 1]


def _series(channel: Channel, start_ns: int, is_state: bool = False) -> TimeSeries:
    """The samples of a channel that may be used, without single outliers.

    A state keeps them: a valve may open for one sample.
    """
    data = channel.data
    is_used = data.valid & np.isfinite(data.value)
    t, value = (data.t[is_used] - start_ns) * np.float64(1e-9), data.value[is_used]
    return TimeSeries(*in_order(t, value if is_state or not len(t) else median_of_five(value)))


def _logged(log: Log) -> dict[str, Any]:
    """Commands, valves, sanding and reservoir, where the log has them; names as the signals'."""
    start_ns = log.start_ns()
    commands = {name: _channels(log, name) for name in _COMMANDS}
    valves = [c for meaning in _VALVES for c in _channels(log, meaning) if c.axle is not None]
    sanding, reservoir = _channels(log, "sanding"), _channels(log, "reservoir_pressure")
    return {
        "commands": {name: [_series(c, start_ns) for c in x] for name, x in commands.items() if x},
        "valves": {c.axle: _series(c, start_ns, is_state=True) for c in valves},
        "sanding": _series(sanding[0], start_ns, is_state=True) if sanding else None,
        "reservoir": _series(reservoir[0], start_ns) if reservoir else None,
    }


def _seconds(t: Times, start_ns: int) -> Floats:
    return (t - start_ns) * np.float64(1e-9)


def _with_alone(record: AxleRecord, x: Floats, start_ns: int, alone: Floats | None) -> TimeSeries:
    """A speed of an axle; `alone` are its values where the brake is not known."""
    t, value = record.t, x.astype(np.float64)
    if record.speeds_alone is not None and alone is not None:
        t, value = np.append(t, record.speeds_alone.t), np.append(value, alone)
    return TimeSeries(*in_order(_seconds(t, start_ns), value))


def _on_segments(
    record: AxleRecord, x: Floats, start_ns: int, alone: Floats | None = None
) -> TimeSeries:
    """A channel of an axle with NaN between its segments, which nothing may cross.

    A speed goes on where the brake is not known, `alone`.
    """
    series = _with_alone(record, x, start_ns, alone)
    ends = _seconds(record.t[[s.stop - 1 for s in record.segments]], start_ns)
    if alone is not None:
        interval = np.diff(series.t)
        ends = series.t[np.append(interval > GAP * np.median(interval), True)]
    t, value = np.append(series.t, ends + 1e-6), np.append(series.value, np.full(len(ends), np.nan))
    return TimeSeries(*in_order(t, value))


def _shaped(
    train: TimeSeries, rims: Mapping[int, TimeSeries], interval: float
) -> tuple[TimeSeries, Bools, float]:
    """A slow train speed with the shape of the fastest wheel, and where it has none, (n,).

    Last, 1 sigma of its level by the noise of the readings [m/s].

    The wheels are quick and creep; the train speed is slow and does not. The sum of the wheels'
    speed and of the averaged difference has neither fault. Where all wheels slide, and as long
    around as the average is, the train speed is taken as it is. Where all wheels stand, its next
    reading counts: the difference before that is one of a late speed.
    """
    fastest = _fastest(rims, train.t).value
    difference = train.value - fastest
    limit = np.maximum(_ROLLING * train.value, _SLOW_ROLLING)
    rolls = np.abs(difference) < limit
    rolling_difference = np.where(rolls, difference, 0.0)
    mean, share = (
        means_around(train.t, x, _AVERAGED * interval) for x in (rolling_difference, rolls)
    )
    is_coarse: Bools = share < 1.0
    next_reading = np.interp(train.t + interval, train.t, train.value)
    shaped = np.where(fastest < STANDING, np.fmin(train.value, next_reading), fastest + mean)
    readings = np.arange(train.t[0], train.t[-1], interval)
    of_readings = np.interp(readings, train.t, rolling_difference)
    changes = np.diff(of_readings[np.isfinite(of_readings)])
    level_sigma = robust_sigma(changes) / math.sqrt(2.0 * _AVERAGED) if len(changes) else 0.0
    return TimeSeries(train.t, np.where(is_coarse, train.value, shaped)), is_coarse, level_sigma


def gains_speed(v: Floats) -> bool:
    """Whether the fastest wheel of a braked train gains speed [m/s]: all wheels slid, then."""
    return bool(np.max(v - np.minimum.accumulate(v)) >= _GAIN)


def _overlaps(t: Floats) -> list[tuple[float, float]]:
    """The times that several pieces of a clock have, which is set back between them [s]."""
    pieces = [(x[0], x[-1]) for x in np.split(t, np.flatnonzero(np.diff(t) < 0.0) + 1)]
    overlap_bounds = (
        (max(a[0], b[0]), min(a[1], b[1])) for a, b in itertools.combinations(pieces, 2)
    )
    return [(float(start), float(stop)) for start, stop in overlap_bounds if start < stop]


def _over_gaps(
    train: TimeSeries, rims: Mapping[int, TimeSeries]
) -> tuple[TimeSeries, Bools | None]:
    """A train speed that has gaps, as of a receiver in a tunnel, and where the wheels fill them.

    The fastest wheel, with its difference before and after, takes the place of the train where it
    rolls at both ends and gains no speed between.
    """
    fastest = _fastest(rims, train.t).value
    difference = train.value - fastest
    known_indices = np.flatnonzero(np.isfinite(difference))
    filled = np.zeros(len(train.t), dtype=np.bool_)
    value = train.value.copy()
    for start, stop in true_runs(~np.isfinite(train.value)):
        place = int(np.searchsorted(known_indices, start))
        end_indices = known_indices[max(place - 1, 0) : place + 1]  # before and after
        gap = fastest[start:stop]
        limit = np.maximum(_ROLLING * train.value[end_indices], _SLOW_ROLLING)
        if (
            len(end_indices) < 2
            or not np.isfinite(gap).all()
            or (abs(difference[end_indices]) > limit).any()
        ):
            continue
        if not gains_speed(gap):
            offset = np.interp(train.t[start:stop], train.t[end_indices], difference[end_indices])
            value[start:stop], filled[start:stop] = gap + offset, True
    return TimeSeries(train.t, value), filled if filled.any() else None


def _fastest(rims: Mapping[int, TimeSeries], t: Floats) -> TimeSeries:
    return TimeSeries(t, np.fmax.reduce([rim.interpolated(t) for rim in rims.values()]))


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
    highest = float(np.quantile(applied, 0.98))
    high_level = released + _HIGH_SHARE * (highest - released)
    falls = np.maximum.accumulate(applied) - applied > DROP * (highest - released) + 5.0 * noise
    if falls.any():  # what a valve of the WSP has vented is not all filled again
        unvented = applied[: int(np.argmax(falls))]
        if float(np.quantile(unvented, 0.98)) - released >= _REACHED * (highest - released):
            reached = int(np.argmax(unvented >= high_level))
            return released, float(np.median(unvented[(reached + len(unvented)) // 2 :])), noise
    return released, float(np.median(applied[applied >= high_level])), noise


def quantisation_step(x: Floats) -> float:
    """Quantisation step of a signal."""
    steps = np.abs(np.diff(x[np.isfinite(x)]))
    steps = steps[steps > 0.0]
    return float(np.min(steps)) if len(steps) else 0.0
