"""The time axis of one channel: errors of its clock are found, reported and masked.

Nothing is sorted.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from .finding import Finding, Span
from .model import Bools, Channel, Column, Floats, Times

WRAPS_NS = {
    "32-bit millisecond counter": 2**32 * 10**6,
    "32-bit microsecond counter": 2**32 * 10**3,
    "16-bit millisecond counter": 2**16 * 10**6,
    "24-hour clock": 24 * 3600 * 10**9,
}
_MOST_SPANS = 20  # of one finding
_LEAST_SHARED = 5  # samples of one stamp that may have come evenly: fewer are as many devices'
_FULL = 0.9  # share of the samples that then hold a value
_LEAST_STAMPS = 5  # of a log in which that shows


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """One channel's own time, cleaned.

    Attributes:
        data: the samples that may be used; time rises strictly within a piece.
        starts: first index of each piece of `data`; the clock was set back between two pieces.
        interval_ns: median sample interval.
        gap_ns: a longer interval is a gap.
        gaps: how many there are.
        duplicates: samples that repeat a time stamp.
        backward: samples older than one before them.
        findings: what was wrong.
    """

    data: Column
    starts: tuple[int, ...]
    interval_ns: int
    gap_ns: int
    gaps: int
    duplicates: int
    backward: int
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

    Args:
        name: the channel, for the findings.
        column: samples as the log has them.
        start_ns: the log's start, for the findings.
        max_gap_ns: intervals longer than this are gaps; 0 decides from the channel itself.
    """
    t, wraps = unwrapped(column.t)
    report = _Report(name, t, start_ns)
    for counter, wrapped in wraps.items():
        report("time-wrapped", wrapped, counter=counter)
    t = _spread(report, column.value)
    usable = column.valid & np.isfinite(column.value)
    # The reader reports cells without any value; a wide table of several rates has many.
    report("not-a-number", column.valid & ~usable)

    restarts: tuple[int, ...] = (0,)
    out = same = np.zeros(len(t), dtype=np.bool_)
    if not (t[1:] > t[:-1]).all():
        restarts, late, ahead = _order(t)
        _report_order(report, t, restarts, late, ahead)
        out = late | ahead
        usable &= ~out
        same, clash = _repeated(report, t, column.value, usable)
        usable &= ~(same | clash)

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
    within = np.diff(piece_of) == 0
    limit = max_gap_ns or gap_limit(steps[within])
    gaps = np.flatnonzero(within & (steps > limit))
    longest = float(steps[gaps].max(initial=0)) / 1e9
    report.stretches("gap", data.t[gaps], data.t[gaps + 1], len(gaps), longest_s=longest)
    interval = int(np.median(steps[within])) if within.any() else 0
    return TimeAxis(
        data, starts, interval, limit, len(gaps), int(same.sum()),
        int(out.sum()) + len(restarts) - 1, tuple(report.findings),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Report:
    """Collects what is wrong with the samples of a channel, at its times `t` [ns]."""

    channel: str
    t: Times
    start_ns: int
    findings: list[Finding] = field(default_factory=list)

    def __call__(self, code: str, where: Bools, **data: float | str) -> None:
        """Reports the samples of a mask, if there are any; each run of them is a span."""
        edges = np.flatnonzero(np.diff(where, prepend=False, append=False))
        first, last = self.t[edges[::2]], self.t[edges[1::2] - 1]
        self.stretches(code, first, last, int(np.count_nonzero(where)), **data)

    def stretches(
        self, code: str, begin: Times, end: Times, count: int, **data: float | str
    ) -> None:
        """Reports stretches of time [ns], if there are any, with the numbers and names given."""
        if count:
            spans = spans_of(np.minimum(begin, end), np.maximum(begin, end), self.start_ns)
            values = {key: x for key, x in data.items() if not isinstance(x, str)}
            names = {key: x for key, x in data.items() if isinstance(x, str)}
            found = Finding(
                code, "warning", channel=self.channel, count=count, spans=spans,
                values=values, names=names,
            )  # fmt: skip
            self.findings.append(found)


def spans_of(begin: Times, end: Times, start_ns: int) -> tuple[Span, ...]:
    """Stretches [ns] as seconds after the log's start, the nearest joined until few are left."""
    order = np.argsort(begin, kind="stable")
    begin, end = begin[order], np.maximum.accumulate(end[order])
    between = begin[1:] - end[:-1]
    cuts = np.flatnonzero(between > 0)
    if len(cuts) >= _MOST_SPANS:
        widest = np.argsort(between[cuts], kind="stable")[1 - _MOST_SPANS :]
        cuts = np.sort(cuts[widest])
    first, last = np.r_[0, cuts + 1], np.r_[cuts, len(begin) - 1]
    return tuple(
        ((a - start_ns) / 1e9, (b - start_ns) / 1e9)
        for a, b in zip(begin[first].tolist(), end[last].tolist(), strict=True)
    )


def _order(t: Times) -> tuple[tuple[int, ...], Bools, Bools]:
    """What is out of order in the times [ns] of n samples.

    Returns:
        Where the clock starts anew. Samples older than the newest so far of their piece, (n,).
        Samples whose single stamp is later, by a gap, than the stamps before and after it, (n,).
    """
    ahead = np.zeros(len(t), dtype=np.bool_)
    steps = np.diff(t)
    limit = gap_limit(steps[steps > 0])
    on = np.zeros(len(t) - 1, dtype=np.bool_)  # from the sample before to the one behind
    on[0] = limit > 0
    across = t[2:] - t[:-2]
    on[1:] = (across >= 0) & (across <= limit) & (steps[:-1] > limit)
    ahead[:-1] = on & (steps < -limit)
    t = np.where(ahead, np.roll(t, -1), t)
    restarts = _restarts(t, np.maximum.accumulate(t))
    late = np.zeros(len(t), dtype=np.bool_)
    for piece in pieces(restarts, len(t)):
        late[piece] = t[piece] < np.maximum.accumulate(t[piece])
    return restarts, late & ~ahead, ahead


def _report_order(
    report: _Report, t: Times, restarts: tuple[int, ...], late: Bools, ahead: Bools
) -> None:
    """Reports where the clock was set back, and samples out of order."""
    last = np.array(restarts[1:], dtype=np.int64) - 1  # the stamp before a jump says where it is
    most = float((t[last] - t[last + 1]).max(initial=0)) / 1e9
    report.stretches("time-backward", t[last], t[last], len(last), most_s=most)
    good = np.where(late | ahead, 0, np.arange(len(t)))
    good[0] = ahead[0]
    report = replace(report, t=t[np.maximum.accumulate(good)])  # a wrong stamp says no time
    report("time-out-of-order", late)
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
    kept = np.flatnonzero(usable)
    same, clash = np.zeros((2, len(t)), dtype=np.bool_)
    repeats = np.diff(t[kept], prepend=t[kept][:1] - 1) == 0
    if not repeats.any():
        return same, clash
    same[kept] = repeats
    differs = repeats & (np.diff(value[kept], prepend=0.0) != 0.0)
    # Two values for one instant: every sample of that stamp is masked, not just the later ones.
    groups = np.cumsum(~repeats) - 1
    clash[kept] = np.isin(groups, groups[differs])
    sizes = np.bincount(groups)
    doubled = not differs.any() and bool((np.diff(value[kept]) != 0.0).any())  # rows written twice
    if np.mean(sizes > 1) > 0.5 and len(sizes) > 1 and not doubled:
        apart = float(np.median(np.diff(t[kept][~repeats]))) / 1e9
        samples = float(np.median(sizes))
        report("time-coarse", same | clash, samples=samples, apart_s=apart)
    else:
        report("time-duplicate", same & ~clash)
        report("time-conflict", clash)
    return same, clash


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
    if np.count_nonzero(np.isfinite(value)) < _FULL * len(t):
        return t  # rows of several channels alternate
    first = np.flatnonzero(np.diff(t, prepend=t[0] - 1))  # sample of each stamp
    last = np.append(first[1:], len(t)) - 1
    stamps = t[first]
    if len(stamps) < _LEAST_STAMPS:
        return t
    tick = float(np.median(np.diff(stamps)))
    stretches = np.split(np.arange(len(stamps)), np.flatnonzero(np.diff(stamps) > 1.5 * tick) + 1)
    longest = max(stretches, key=len)[1:]  # the first stamp may have begun before the log
    if len(longest) < _LEAST_STAMPS - 1:
        return t
    at, since = first[longest] - first[longest[0]], stamps[longest] - stamps[longest[0]]
    period = float(np.polyfit(at, since, 1)[0])
    many = round(tick / period)
    if many < _LEAST_SHARED or _alternates(value, many):
        return t
    even = np.empty_like(t)
    for stretch in stretches:
        rows = slice(first[stretch[0]], last[stretch[-1]] + 1)
        since = stamps[stretch] - stamps[stretch[0]]
        earliest = np.max(since - period * (first[stretch] - rows.start))
        latest = np.min(since + tick - period * (last[stretch] - rows.start))
        if earliest - latest > period:
            return t
        n = np.arange(rows.stop - rows.start)
        even[rows] = t[rows.start] + np.rint((earliest + latest) / 2.0 + period * n).astype(int)
    everywhere = np.ones(len(t), dtype=np.bool_)
    report("time-coarse-spread", everywhere, samples=many, apart_s=tick / 1e9, rate_hz=1e9 / period)
    return even


def _alternates(value: Floats, many: int) -> bool:
    """Whether samples differ more from their neighbours than from those `many` samples before."""
    near, far = (np.abs(value[k:] - value[:-k]) for k in (1, many))
    return bool(np.nansum(near) / len(near) > 1.2 * np.nansum(far) / max(len(far), 1))


def unwrapped(t: Times) -> tuple[Times, dict[str, Bools]]:
    """The times of a counter as if it had not wrapped, and where it did, by its width."""
    found: dict[str, Bools] = {}
    if not (t[1:] < t[:-1]).any():
        return t, found
    steps = np.diff(t)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for width, wrap_ns in WRAPS_NS.items():
        fall = np.diff(t, prepend=t[:1])
        near = max(wrap_ns // 1000, min(2.0 * usual, wrap_ns // 100))
        wrapped = (fall < 0) & (np.abs(fall + wrap_ns) < near)
        if wrapped.any():
            found[width] = wrapped
            t = t + wrap_ns * np.cumsum(wrapped)
    return t, found


def _restarts(t: Times, newest: Times) -> tuple[int, ...]:
    """Where the clock starts anew: a fall after which time runs on from the lower value."""
    starts = [0]
    falls = np.flatnonzero(np.diff(t) < 0) + 1
    for index in falls:
        ahead = t[index : index + 3]
        stays = len(ahead) >= 2 and bool(np.all(ahead < newest[index - 1]))
        rises = bool(np.all(np.diff(ahead) >= 0))
        if stays and rises:
            starts.append(int(index))
    return tuple(starts)


def pieces(starts: tuple[int, ...], n: int) -> list[slice]:
    """The stretches between two jumps of the clock; none where there is no sample."""
    return [slice(a, b) for a, b in zip(starts, (*starts[1:], n), strict=True)] if n else []


class Over(NamedTuple):
    """Where to look for another channel's samples: at these times, in the k-th of n pieces."""

    t: Times
    k: int
    n: int


def overs(of: Channel) -> Iterator[Over]:
    """The times of a channel, piece by piece between the jumps of its clock."""
    parts = pieces(of.starts, len(of.data.t))
    for k, part in enumerate(parts):
        yield Over(of.data.t[part], k, len(parts))


def _samples(at: Over, of: Channel) -> tuple[Times, Floats]:
    """The piece of a channel that goes with a piece of another one.

    Channels that the clock's jumps part into equally many pieces belong together piece by piece,
    also where times repeat. Else the only piece that shares time; nothing where two do: which one
    was logged along cannot be known.
    """
    own = pieces(of.starts, len(of.data.t))
    if len(own) == at.n == 1:
        return of.data.t, of.data.value
    if len(own) != at.n:
        t = of.data.t
        own = [p for p in own if t[p][0] <= at.t[-1] and t[p][-1] >= at.t[0]]
    chosen = own[at.k] if len(own) == at.n else own[0] if len(own) == 1 else slice(0, 0)
    return of.data.t[chosen], of.data.value[chosen]


def hold(at: Over, of: Channel) -> tuple[Floats, Bools]:
    """Last value of a channel at each time, and whether it is fresh enough to use; shape (n,).

    The values are the channel's own array where the times are the same.
    """
    xs, ys = _samples(at, of)
    if not len(xs):
        return np.full(len(at.t), np.nan), np.zeros(len(at.t), dtype=np.bool_)
    if np.array_equal(xs, at.t):  # columns of one table
        return ys, np.ones(len(xs), dtype=np.bool_)
    index = np.searchsorted(xs, at.t, side="right") - 1
    known = index >= 0
    index = np.maximum(index, 0)
    return ys[index], known & (at.t - xs[index] <= of.gap_ns)


def interpolated(at: Over, of: Channel) -> Floats:
    """Linear interpolation of a channel, shape (n,); its own array where the times are the same.

    NaN before its first sample and across its gaps; the last value holds as long as `hold` does.
    """
    xs, ys = _samples(at, of)
    if not len(xs):
        return np.full(len(at.t), np.nan)
    if np.array_equal(xs, at.t):
        return ys
    t = at.t
    after = np.clip(np.searchsorted(xs, t, side="left"), 0, len(xs) - 1)
    before = np.maximum(after - 1, 0)
    gap = xs[after] - xs[before]
    # Differences of int64 are exact; seconds since 1970 as floats are not.
    part = np.clip((t - xs[before]) / np.maximum(gap, 1), 0.0, 1.0)
    value = ys[before] + part * (ys[after] - ys[before])
    unknown = (t < xs[0]) | (t > xs[-1] + of.gap_ns) | ((t < xs[after]) & (gap > of.gap_ns))
    return np.where(unknown, np.nan, np.where(xs[after] == t, ys[after], value))
