"""The time axis of one channel: errors of its clock are found, reported and masked.

Nothing is sorted.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from .finding import Finding, Severity
from .masks import edges, spans_of
from .model import Bools, Column, Floats, Times, pieces

_FIRST_STAMPS = 100_000  # of a log, in which most clocks count seconds above 59
_HOUR, _HOURLESS, _HALF_DAY = 3600 * 10**9, "clock without hours", "12-hour clock"
WRAPS_NS = {
    "32-bit millisecond counter": 2**32 * 10**6,
    "32-bit microsecond counter": 2**32 * 10**3,
    "16-bit millisecond counter": 2**16 * 10**6,
    "24-hour clock": 24 * 3600 * 10**9,
    _HALF_DAY: 12 * 3600 * 10**9,
    _HOURLESS: _HOUR,
}
_LEAST_SHARED = 5  # samples of one stamp that may have come evenly: fewer are as many devices'
_FULL_SHARE = 0.9  # share of the samples that then hold a value
_LEAST_STAMPS = 5  # of a log in which that shows
_NEAR = 10  # samples on either side that show whether as many came around a stamp as elsewhere
_MEANED = 0.5  # rounding and jitter are averaged over as long on either side [s]


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """One channel's own time, cleaned."""

    data: Column  # the samples that may be used; time rises strictly within a piece
    starts: tuple[int, ...]  # first index of each piece; the clock was set back between two
    interval_ns: int  # median sample interval
    gap_ns: int  # a longer interval is a gap
    gaps: int
    duplicates: int  # samples that repeat a time stamp
    backward: int  # samples older than one before them
    findings: tuple[Finding, ...]


def gap_limit(intervals: Times) -> int:
    """The interval [ns] above which samples are missing, from the usual one.

    Five times the median, unless more than one interval in twenty is longer. Then the log is
    written in bursts or on change, and only what is rare even there is a gap.
    """
    if not len(intervals):
        return 0
    limit = 5 * int(np.median(intervals))
    if np.mean(intervals > limit) > 0.05:
        limit = 5 * int(np.quantile(intervals, 0.99))
    return limit


def clean(name: str, column: Column, start_ns: int, max_gap_ns: int = 0) -> TimeAxis:
    """Finds what is wrong with a channel's time, masks bad samples, and splits where time jumps.

    The findings have the `name` of the channel and times after `start_ns`. Intervals longer than
    `max_gap_ns` are gaps; 0 decides from the channel itself.
    """
    t, wraps = unwrapped(column.t)
    report = _Report(name, t, start_ns)
    for counter, wrapped in wraps.items():
        report("time-wrapped", wrapped, "info", counter=counter)
    t = _spread(report, column.value)
    t = _without_rounding(report, column.value) if t is report.t else t
    usable = column.valid & np.isfinite(column.value)
    # The reader reports cells without any value; a wide table of several rates has many.
    report("not-a-number", column.valid & ~usable)

    restarts: tuple[int, ...] = (0,)
    out_of_order = duplicated = np.zeros(len(t), dtype=np.bool_)
    if not (t[1:] > t[:-1]).all():
        restarts, is_late, ahead = _order(t)
        _report_order(report, t, restarts, is_late, ahead)
        out_of_order = is_late | ahead
        usable &= ~out_of_order
        duplicated, clash = _repeated(report, t, column.value, usable)
        usable &= ~(duplicated | clash)

    jumps = np.zeros(len(t), dtype=np.bool_)
    jumps[list(restarts[1:])] = True
    piece_of = np.cumsum(jumps, dtype=np.int32)
    if usable.all():  # without a copy: channels of one table share its time
        data = Column(t, column.value, usable)
    else:
        data = Column(t[usable], column.value[usable], np.ones(int(usable.sum()), dtype=np.bool_))
        piece_of = piece_of[usable]
    starts = tuple(int(i) for i in np.flatnonzero(np.diff(piece_of, prepend=-1)))
    steps = np.diff(data.t)
    in_piece = np.diff(piece_of) == 0
    limit = max_gap_ns or gap_limit(steps[in_piece])
    gaps = np.flatnonzero(in_piece & (steps > limit))
    longest = float(steps[gaps].max(initial=0)) / 1e9
    begin, stop, limit_s = data.t[gaps], data.t[gaps + 1], math.floor(longest) + 1.0
    report.stretches("gap", begin, stop, len(gaps), longest_s=longest, limit_s=limit_s)
    interval = int(np.median(steps[in_piece])) if in_piece.any() else 0
    counts = len(gaps), int(duplicated.sum()), int(out_of_order.sum()) + len(restarts) - 1
    return TimeAxis(data, starts, interval, limit, *counts, tuple(report.findings))


@dataclass(frozen=True, slots=True)
class _Report:
    """Collects what is wrong with the samples of a channel, at its times `t` [ns]."""

    channel: str
    t: Times
    start_ns: int
    findings: list[Finding] = field(default_factory=list)

    def __call__(
        self, code: str, mask: Bools, severity: Severity = "warning", **data: float | str
    ) -> None:
        """Reports the samples of a mask, if there are any; each run of them is a span."""
        starts, stops = edges(mask).T
        start, stop = self.t[starts], self.t[stops - 1]
        self.stretches(code, start, stop, int(np.count_nonzero(mask)), severity, **data)

    def stretches(
        self,
        code: str,
        start: Times,
        stop: Times,
        count: int,
        severity: Severity = "warning",
        **data: float | str,
    ) -> None:
        """Reports stretches of time [ns], if there are any, with the numbers and names given."""
        if count:
            spans = spans_of(np.minimum(start, stop), np.maximum(start, stop), self.start_ns)
            values = {key: x for key, x in data.items() if not isinstance(x, str)}
            names = {key: x for key, x in data.items() if isinstance(x, str)}
            self.findings.append(Finding(code, severity, self.channel, count, spans, values, names))


def _order(t: Times) -> tuple[tuple[int, ...], Bools, Bools]:
    """Where the clock [ns] starts anew; samples older than the newest of their piece; outliers.

    The single stamp of an outlier is later, by a gap, than those before and after it.
    """
    ahead = np.zeros(len(t), dtype=np.bool_)
    steps = np.diff(t)
    limit = gap_limit(steps[steps > 0])
    jumps = np.zeros(len(t) - 1, dtype=np.bool_)  # from the sample before to the one behind
    jumps[0] = limit > 0
    two_steps = t[2:] - t[:-2]
    jumps[1:] = (two_steps >= 0) & (two_steps <= limit) & (steps[:-1] > limit)
    ahead[:-1] = jumps & (steps < -limit)
    t = np.where(ahead, np.roll(t, -1), t)
    restarts = _restarts(t, np.maximum.accumulate(t))
    is_late = np.zeros(len(t), dtype=np.bool_)
    for piece in pieces(restarts, len(t)):
        is_late[piece] = t[piece] < np.maximum.accumulate(t[piece])
    return restarts, is_late & ~ahead, ahead


def _report_order(
    report: _Report, t: Times, restarts: tuple[int, ...], is_late: Bools, ahead: Bools
) -> None:
    # The stamp before a jump says where it is.
    before_jump = np.array(restarts[1:], dtype=np.int64) - 1
    largest_s = float((t[before_jump] - t[before_jump + 1]).max(initial=0)) / 1e9
    report.stretches(
        "time-backward", t[before_jump], t[before_jump], len(before_jump), most_s=largest_s
    )
    sound = np.where(is_late | ahead, 0, np.arange(len(t)))
    sound[0] = ahead[0]
    report = replace(report, t=t[np.maximum.accumulate(sound)])  # a wrong stamp says no time
    report("time-out-of-order", is_late)
    report("time-outlier", ahead)


def earliest(t: Times) -> int:
    """The earliest time [ns] that is not left out as out of order."""
    t, _ = unwrapped(t)
    if (t[1:] < t[:-1]).any():
        t = t[~_order(t)[1]]
    return int(t.min())


def _repeated(report: _Report, t: Times, value: Floats, usable: Bools) -> tuple[Bools, Bools]:
    """Samples that repeat a stamp, and all samples of stamps that have different values.

    It reports both. Rows without a value of the channel are none of its samples.
    """
    usable_index = np.flatnonzero(usable)
    duplicated, clash = np.zeros((2, len(t)), dtype=np.bool_)
    repeats = np.diff(t[usable_index], prepend=t[usable_index][:1] - 1) == 0
    if not repeats.any():
        return duplicated, clash
    duplicated[usable_index] = repeats
    differs = repeats & (np.diff(value[usable_index], prepend=0.0) != 0.0)
    # Two values for one instant: every sample of that stamp is masked, not just the later ones.
    groups = np.cumsum(~repeats) - 1
    clash[usable_index] = np.isin(groups, groups[differs])
    sizes = np.bincount(groups)
    # rows written twice
    doubled = not differs.any() and bool((np.diff(value[usable_index]) != 0.0).any())
    if np.mean(sizes > 1) > 0.5 and len(sizes) > 1 and not doubled:
        interval_s = float(np.median(np.diff(t[usable_index][~repeats]))) / 1e9
        samples = float(np.median(sizes))
        report("time-coarse", duplicated | clash, samples=samples, apart_s=interval_s)
    else:
        report("time-duplicate", duplicated & ~clash)
        report("time-conflict", clash)
    return duplicated, clash


def _spread(report: _Report, value: Floats) -> Times:
    """The times of samples that came evenly, under a clock that ticks more rarely.

    The order is known where one even rate agrees with every stamp to within a sample, gaps between
    stamps apart. Rows of several interleaved devices look the same. But their values differ less
    from those one stamp before than from their neighbours.
    """
    t = report.t
    inside = t[1:] == t[:-1]
    if np.count_nonzero(inside) <= len(t) / 2 or (t[1:] < t[:-1]).any():
        return t
    changes = value[1:] != value[:-1]
    if changes.any() and not changes[inside].any():
        return t  # one sample of each stamp, repeated
    if np.count_nonzero(np.isfinite(value)) < _FULL_SHARE * len(t):
        return t  # rows of several channels alternate
    first_sample = np.flatnonzero(np.diff(t, prepend=t[0] - 1))  # sample of each stamp
    last_sample = np.append(first_sample[1:], len(t)) - 1
    stamps = t[first_sample]
    if len(stamps) < _LEAST_STAMPS:
        return t
    tick = float(np.median(np.diff(stamps)))
    stretches = np.split(np.arange(len(stamps)), np.flatnonzero(np.diff(stamps) > 1.5 * tick) + 1)
    longest = max(stretches, key=len)[1:]  # the first stamp may have begun before the log
    if len(longest) < _LEAST_STAMPS - 1:
        return t
    sample_count = first_sample[longest] - first_sample[longest[0]]
    since = stamps[longest] - stamps[longest[0]]
    period = float(np.polyfit(sample_count, since, 1)[0])
    per_stamp = round(tick / period)
    if per_stamp < _LEAST_SHARED or _alternates(value, per_stamp):
        return t
    even_t = np.empty_like(t)
    for stretch in stretches:
        rows = slice(first_sample[stretch[0]], last_sample[stretch[-1]] + 1)
        since = stamps[stretch] - stamps[stretch[0]]
        earliest = np.max(since - period * (first_sample[stretch] - rows.start))
        latest = np.min(since + tick - period * (last_sample[stretch] - rows.start))
        if earliest - latest > period:
            return t
        n = np.arange(rows.stop - rows.start)
        even_t[rows] = t[rows.start] + np.rint((earliest + latest) / 2.0 + period * n).astype(int)
    _report_spread(report, t, tick, period)
    return even_t


def _report_spread(report: _Report, t: Times, tick: float, period: float) -> None:
    """Notes that samples got even times: no data is lost."""
    apart_s, rate_hz = tick / 1e9, float(f"{1e9 / period:.3g}")
    code, begin, final = "time-coarse-spread", t[:1], t[-1:]
    report.stretches(code, begin, final, len(t), "info", apart_s=apart_s, rate_hz=rate_hz)


def _without_rounding(report: _Report, value: Floats) -> Times:
    """The times of samples of a cycle that jitters, under stamps that are rounded.

    Samples share a stamp by rounding where no more samples came around it than elsewhere: rows that
    are written twice come on top. Each time is the mean of the stamps around it, the cycle apart.
    """
    is_finite = np.isfinite(value)
    if np.count_nonzero(is_finite) >= _FULL_SHARE * len(is_finite):
        is_finite[:] = True
    t, value = report.t[is_finite], value[is_finite]
    steps = np.diff(t)
    inside = steps == 0
    too_short_to_tell = len(t) <= 4 * _NEAR or np.count_nonzero(~inside) < _LEAST_STAMPS
    if too_short_to_tell or not inside.any() or (steps < 0).any():
        return report.t
    changes = value[1:] != value[:-1]
    if np.count_nonzero(changes) * np.mean(inside) > 1.0 and not changes[inside].any():
        return report.t  # one sample of each stamp, repeated
    limit, tick = gap_limit(steps), float(np.quantile(steps[~inside], 0.01))
    around = (t[2 * _NEAR :] - t[: -2 * _NEAR]) / (2.0 * _NEAR)
    period = float(np.median(around))
    shared = np.flatnonzero(inside[_NEAR:-_NEAR])
    if not len(shared) or not np.mean(around[shared]) > (1.0 - 0.25 / _NEAR) * period > 0.0:
        return report.t
    per_stamp = round(tick / period)
    if per_stamp > _LEAST_SHARED or _alternates(value, max(per_stamp, 2)):
        return report.t
    even_t = report.t.copy()
    width = _width(t - period * np.arange(len(t)), period)
    cuts = [0, *(np.flatnonzero(steps > limit) + 1), len(t)]
    even_t[is_finite] = np.concatenate(
        [_mean_times(t[a:b], period, width) for a, b in pairwise(cuts)]
    )
    if (np.diff(even_t[is_finite]) <= 0).any():
        return report.t
    _report_spread(report, t, tick, period)
    # Rows without a value get the time of the sample before them, else they were out of order.
    rows = np.where(is_finite, np.arange(len(is_finite)), np.argmax(is_finite))
    return even_t[np.maximum.accumulate(rows)]


def _width(late: Floats, period: float) -> int:
    """Over how many samples on either side to average stamps that are so late [ns], (n,)."""
    width, nearby = round(_MEANED * 1e9 / period), np.std(late[_NEAR:] - late[:-_NEAR])
    while width > _NEAR and np.std(late[width:] - late[:-width]) > 1.2 * nearby:
        width //= 2
    return max(width, _NEAR)


def _mean_times(t: Times, period: float, width: int) -> Times:
    """Each stamp [ns] as the mean of those up to `width` samples around, moved by their periods."""
    n = np.arange(len(t))
    total = np.concatenate([[0.0], np.cumsum(t - t[0] - period * n)])
    reach = np.minimum(np.minimum(n, n[::-1]), width)  # as many on either side: no drift goes in
    reach = np.maximum(reach, min(_NEAR, len(t)))
    first_row, last_row = np.maximum(n - reach, 0), np.minimum(n + reach + 1, len(t))
    mean = (total[last_row] - total[first_row]) / (last_row - first_row)
    times: Times = t[0] + np.rint(period * n + mean).astype(np.int64)
    return times


def _alternates(value: Floats, per_stamp: int) -> bool:
    """Whether samples differ more from their neighbours than from those a stamp before."""
    neighbour, stamp_before = (np.abs(value[k:] - value[:-k]) for k in (1, per_stamp))
    return bool(
        np.nansum(neighbour) / len(neighbour)
        > 1.2 * np.nansum(stamp_before) / max(len(stamp_before), 1)
    )


def unwrapped(t: Times) -> tuple[Times, dict[str, Bools]]:
    """The times of a counter as if it had not wrapped, and where it did, by its width."""
    wraps: dict[str, Bools] = {}
    if not (t[1:] < t[:-1]).any():
        return t, wraps
    steps = np.diff(t)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    hourless = t.min() >= 0 and t.max() < _HOUR  # else it is the end of summer time
    is_half_day = t.min() >= _HOUR and t.max() < 13 * _HOUR
    for width, wrap_ns in WRAPS_NS.items():
        if (width == _HOURLESS and not hourless) or (width == _HALF_DAY and not is_half_day):
            continue
        fall = np.diff(t, prepend=t[:1])
        tolerance = max(wrap_ns // 1000, min(2.0 * usual, wrap_ns // 100))
        wrapped = (fall < 0) & (np.abs(fall + wrap_ns) < tolerance)
        if wrapped.any():
            wraps[width] = wrapped
            t = t + wrap_ns * np.cumsum(wrapped)
    return t, wraps


def from_digits(t: Times) -> Times | None:
    """The times [ns] of a clock whose digits, HHMMSS, are read as seconds; None where they are not.

    They are where 59.98 is followed by 100.00, and no second and no minute is above 59. They
    begin anew behind 235959.98, and without hours, as MMSS, behind 5959.98.

    >>> from_digits(np.array([5_958, 5_959, 10_000, 10_001]) * 10**9) // 10**9
    array([3598, 3599, 3600, 3601])
    """
    # Seconds above 59 among the first stamps spare copies of all of them.
    if (t[:_FIRST_STAMPS] % (100 * 10**9) >= 60 * 10**9).any():
        return None
    last_digits, digits_of_turn = (
        (6_000, 10_000) if t.max(initial=0) < 6_000 * 10**9 else (236_000, 240_000)
    )
    t = t + np.cumsum(np.diff(t, prepend=t[:1]) < -(last_digits - 100) * 10**9) * (
        digits_of_turn * 10**9
    )
    minutes, ns = np.divmod(t, 100 * 10**9)
    if not len(t) or t.min() < 0 or ns.max() >= 60 * 10**9 or (minutes % 100).max() >= 60:
        return None
    clock = seconds_of_digits(t)
    turns = np.flatnonzero(np.diff(minutes) > 0)
    steps = np.diff(clock)
    limit = gap_limit(steps[steps > 0])
    is_proven = len(turns) and np.mean((steps[turns] <= limit) & (np.diff(t)[turns] > limit)) > 0.5
    return clock if is_proven else None


def seconds_of_digits(t: Times) -> Times:
    """The time of day [ns] whose digits, HHMMSS, are read as seconds [ns]."""
    minutes, ns = np.divmod(t, 100 * 10**9)
    return np.asarray(minutes // 100 * _HOUR + minutes % 100 * (60 * 10**9) + ns)


def _restarts(t: Times, newest: Times) -> tuple[int, ...]:
    """Where the clock starts anew: a fall after which time runs on from the lower value."""
    starts = [0]
    falls = np.flatnonzero(np.diff(t) < 0) + 1
    for index in falls:
        ahead = t[index : index + 3]
        stays_low = len(ahead) >= 2 and bool(np.all(ahead < newest[index - 1]))
        rises = bool(np.all(np.diff(ahead) >= 0))
        if stays_low and rises:
            starts.append(int(index))
    return tuple(starts)
