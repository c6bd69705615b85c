"""What a record shows before any estimate: brake on, wheel still, moving or driven, noise."""

import math
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .masks import runs_within, true_runs
from .model import Z95, AxleRecord, Bools, Floats, Times
from .physics import CRAWL, GRADIENT, RELEASED_SHARE, RISE, SLIDE

_Time = TypeVar("_Time", np.int64, np.float64)
_RELEASED_SHARE = 0.2  # share of the largest clamping force: below it a brake is released
_CRAWL = 0.2  # a wheel slower than this may stand [rad/s]
_BRAKED_CRAWL, _LONGEST_CRAWL = 0.7, 3.0  # [rad/s] and [s]: a brake stops a wheel sooner
_HIGHEST = 2.5  # no sensor reads zero above it: 4 km/h [rad/s]
_CUT_OFF_FACTOR = 1.25  # so much above a sensor's lowest speed, noise makes it read zero
_STOP = 0.3  # and does, if it stays so for this long [s]
_OVERDUE = 0.1  # a reading that repeats for less is rounding [s]
_DRIVEN = 3.0  # a wheel after a slide has caught up after this long [s]


def in_order(t: NDArray[_Time], value: Floats) -> tuple[NDArray[_Time], Floats]:
    """Samples in the order of time, one per time: the first. Shapes (n,)."""
    times, first_rows = np.unique(t, return_index=True)
    return times, value[first_rows]


def running_integral(t: Floats, x: Floats) -> Floats:
    """∫ x dt since the first sample, by the trapezoidal rule, shape (n,)."""
    area: Floats = np.zeros(len(x))
    np.cumsum(np.diff(t) * (x[1:] + x[:-1]) / 2.0, out=area[1:])
    return area


def means_around(t: Floats, x: NDArray[Any], width: float) -> Floats:
    """Mean of the samples within `width` about each time, fewer at the ends, shape (n,)."""
    first_row = np.searchsorted(t, t - width / 2.0)
    last_row = np.searchsorted(t, t + width / 2.0, side="right")
    total = np.append(0.0, np.cumsum(x))
    mean: Floats = (total[last_row] - total[first_row]) / (last_row - first_row)
    return mean


def robust_sigma(errors: Floats) -> float:
    """1 sigma of normal errors about zero by their median size, whatever outliers there are."""
    return 1.4826 * float(np.median(np.abs(errors)))


def finite_median(x: Floats) -> Floats:
    """Median over the rows that have a value, of x (k, n); NaN where none has."""
    ordered, count = np.sort(x, axis=0), len(x) - np.isnan(x).sum(axis=0)  # NaN comes last
    column, last_index = np.arange(x.shape[1]), np.maximum(count - 1, 0)
    middle = (ordered[last_index // 2, column] + ordered[(last_index + 1) // 2, column]) / 2.0
    return np.where(np.isfinite(x).any(axis=0), middle, np.nan)


def median_of_five(x: Floats) -> Floats:
    """Running median of five (n,): no single sample starts or ends anything."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(x, 2, mode="edge"), 5)
    return np.median(windows, axis=-1)


def largest_nearby(x: Floats, j: int) -> Floats:
    """Largest value within j samples, (n,); NaN counts as 0."""
    padded = np.pad(np.nan_to_num(x), j, mode="edge")
    largest: Floats = np.lib.stride_tricks.sliding_window_view(padded, 2 * j + 1).max(axis=-1)
    return largest


def pressed_part(record: AxleRecord, application: slice) -> tuple[slice, bool]:
    """The samples of an application until its pressure is gone, and whether that is in the log.

    An application ends where the wheel stands, because (1) does not hold there. Its pressure lasts.
    """
    K, final = record.clamping_force, application.stop - 1
    stop = next(s.stop for s in record.segments if s.start <= final < s.stop)
    released = np.flatnonzero(K[final:stop] <= _RELEASED_SHARE * np.nanmax(K[application]))
    return slice(application.start, final + int(released[0]) + 1 if len(released) else stop), len(
        released
    ) > 0


def standing(record: AxleRecord) -> Bools:
    """Where the wheel stands, and does not merely pass through zero; shape (n,).

    (1) does not hold there: the brake's friction is unknown, from 0 to φK. A single reading between
    two stands is the last tooth of a pole wheel that comes to rest, and so is the last reading of a
    slow wheel that is kept for longer than the next tooth would take. A sensor may show up to
    1 km/h where its wheel stands: a wheel so slow stands where a brake has been on for 3 s.
    """
    is_slow = np.abs(record.wheel_speed) <= max(
        _CRAWL, record.wheel_speed_step / 2.0, _CUT_OFF_FACTOR * _lowest(record)
    )
    is_slow |= _crawls_braked(record)
    stands = np.zeros(len(record), dtype=bool)
    for s in record.segments:
        for start, stop in true_runs(is_slow[s]):
            start, stop = s.start + start, s.start + stop
            is_stop = (record.t[stop - 1] - record.t[start]) * 1e-9 >= _STOP
            stands[start:stop] = is_stop or stop == s.stop
        for start, stop in true_runs(~stands[s])[1:]:
            run = slice(s.start + start, s.start + stop)
            stands[run] |= run.stop < s.stop and not np.ptp(record.wheel_speed[run])
        stands[_kept_to_the_end(record, s)] = True
    return stands


def _crawls_braked(record: AxleRecord) -> Bools:
    """Where a wheel shows a walking speed for longer than a brake lets it turn, (n,).

    It stands from where it is first as slow as its sensor shows it in the later half of that time.
    A wheel beside a train that moves slides.
    """
    K, speed, t = record.clamping_force, np.abs(record.wheel_speed), record.t * 1e-9
    is_slow = (np.nan_to_num(K) > 0.5 * float(np.nanmax(K, initial=0.0))) & (speed < _BRAKED_CRAWL)
    if record.train_speed is not None:
        is_slow &= ~(record.train_speed > CRAWL)
    is_at_rest = np.zeros(len(record), dtype=bool)
    for run in runs_within(is_slow, record.segments):
        if t[run.stop - 1] - t[run.start] > _LONGEST_CRAWL:
            resting = speed[run] <= speed[(run.start + run.stop) // 2 : run.stop].max()
            is_at_rest[run.start + int(np.argmax(resting)) : run.stop] = True
    return is_at_rest


def _kept_to_the_end(record: AxleRecord, segment: slice) -> slice:
    """The samples after the last change of a slow wheel's speed, if the next one is overdue."""
    speed, t = np.abs(record.wheel_speed[segment]), record.t[segment] * 1e-9
    changes = np.flatnonzero(np.diff(speed)) + 1
    if len(changes) < 2 or speed[-1] > min(_HIGHEST, float(speed.min())):
        return slice(0, 0)
    kept_time, earlier_kept_time = t[-1] - t[changes[-1]], t[changes[-1]] - t[changes[-2]]
    is_overdue = kept_time > max(2.0 * earlier_kept_time, _OVERDUE)
    return slice(segment.start + int(changes[-1]), segment.stop) if is_overdue else slice(0, 0)


def _lowest(record: AxleRecord) -> float:
    """The lowest speed of a sensor that reads zero below it [rad/s]; 0 of one that shows any speed.

    The step from there to zero is no deceleration. A step of the sensor's rounding is none either.
    """
    speed = np.abs(record.wheel_speed)
    turns = speed > 0.0
    if turns.all() or not turns.any():
        return 0.0
    lowest = float(speed[turns].min())
    return lowest if max(_CRAWL, 3.0 * record.wheel_speed_step) < lowest < _HIGHEST else 0.0


def moving(record: AxleRecord) -> list[slice]:
    """The segments without the times in which the wheel stands."""
    return runs_within(~standing(record), record.segments)


def driven(record: AxleRecord, radius: float) -> Bools:
    """Where a motor accelerates the wheel, of this radius [m]; shape (n,).

    The brake is released, and the wheel or the train gains more speed than on a gradient. A wheel
    does so for longer than after a slide, and not more slowly than the train. The motor's torque is
    not in (1), unless a channel of the traction force has it.
    """
    is_driven = np.zeros(len(record), dtype=bool)
    if record.traction_known:
        return is_driven
    released = _released(record)
    for s in record.segments:
        t = (record.t[s] - record.t[s.start]) * 1e-9
        rim, train = record.wheel_speed[s] * radius, record.train_speed
        for start, stop in true_runs(released[s]):
            run, run_t = slice(s.start + start, s.start + stop), t[start:stop]
            gains = _gains_speed(run_t, rim[start:stop])
            if train is not None:
                gains &= ~(rim[start:stop] < (1.0 - SLIDE) * train[run])
            for a, b in true_runs(gains):
                gains[a:b] &= run_t[b - 1] - run_t[a] >= _DRIVEN
            if train is not None and not record.train_speed_made:
                gains |= _gains_speed(run_t, train[run])  # no slide lets the train gain speed
            for a, b in true_runs(gains):
                is_driven[run] |= (run_t >= run_t[a] - 1.0) & (run_t <= run_t[b - 1] + 1.0)
    return is_driven


def _released(record: AxleRecord) -> Bools:
    """Where neither friction brake nor motors brake; a residual pressure is no brake; (n,)."""
    K = np.fmax(record.friction_clamping, record.friction_clamping_smooth)
    top, lowest = np.nanmax(K, initial=0.0), np.nanmin(K, initial=np.inf)
    base = lowest if lowest < 0.1 * top else 0.0
    released: Bools = base + RELEASED_SHARE * (top - base) >= K
    if (by_motors := record.motor_clamping) is not None:
        released &= by_motors <= RELEASED_SHARE * by_motors.max(initial=0.0)
    return released


def _gains_speed(t: Floats, v: Floats) -> Bools:
    """Where a speed gains more than on a gradient over 2 s, and less than after a slide; (n,)."""
    has_speed = np.isfinite(v)
    if not has_speed.any():
        return has_speed
    earlier_time, later_time = np.maximum(t - 1.0, t[0]), np.minimum(t + 1.0, t[-1])
    gain = np.interp(later_time, t[has_speed], v[has_speed]) - np.interp(
        earlier_time, t[has_speed], v[has_speed]
    )
    duration = later_time - earlier_time
    gains: Bools = (gain > GRADIENT * duration) & (gain < RISE * duration) & (duration >= 1.0)
    return gains


def bends(t: Floats | Times, x: Floats) -> Floats:
    """Square deviation from the straight line through both neighbours, (..., n − 2).

    Its mean is the variance of white noise on a smooth signal. Times rise strictly along the last
    axis, (..., n).
    """
    share = (t[..., 1:-1] - t[..., :-2]) / (t[..., 2:] - t[..., :-2])  # of the later neighbour
    deviation = x[..., 1:-1] - (1.0 - share) * x[..., :-2] - share * x[..., 2:]
    return deviation**2 / (1.0 + share**2 + (1.0 - share) ** 2)


def white_noise(runs: Iterable[tuple[Floats | Times, Floats]]) -> float:
    """Variance of the white noise on smooth signals; 0 where too short.

    Mean square deviation from the straight line through both neighbours, in blocks of 50 samples.
    It is the median of the blocks: steps in fewer than half of them do not count. Times and values
    of each run have shape (n,), and the times rise strictly.
    """
    blocks = []
    for t, x in runs:
        square = bends(t, x)
        full_count = len(square) // 50 * 50
        blocks.append(square[:full_count].reshape(-1, 50).mean(axis=1))
        if full_count < len(square):
            blocks.append(square[full_count:].mean(keepdims=True))
    variances = np.concatenate(blocks) if blocks else np.empty(0)
    return float(np.median(variances)) if len(variances) else 0.0


def coverage_factor(freedom: float) -> float:
    """How many sigma hold 95 % where sigma has so many degrees of freedom: Student's t.

    Wallace's formula (1959): within 0.1 % from 10 degrees on and 1.2 % from 3 on, larger below.
    scipy.special has the exact one, and importing that takes a tenth of a short run.
    """
    if freedom > 1e6:
        return Z95
    z = Z95 * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0)
    return math.sqrt(freedom * math.expm1(z * z / freedom))
