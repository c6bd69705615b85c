"""The time axis of one channel: what is wrong with it is found, told, masked; nothing is sorted."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..model import Bools, Channel, Column, Finding, Floats, Times

WRAPS_NS = {
    "32-bit millisecond counter": 2**32 * 10**6,
    "32-bit microsecond counter": 2**32 * 10**3,
    "16-bit millisecond counter": 2**16 * 10**6,
    "24-hour clock": 24 * 3600 * 10**9,
}
HOUR_NS = 3600 * 10**9
_STUCK = 10  # samples of one stamp: more than a repeated or doubled row


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """One channel's own time, cleaned.

    Attributes:
        data: the samples that may be used; time rises strictly within a piece.
        starts: first index of each piece of `data`; the clock jumped back between two pieces.
        interval_ns: median sample interval.
        gap_ns: a longer interval is a gap.
        gaps: how many there are.
        duplicates: samples that repeat a time stamp.
        backward: samples older than one before them.
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

    Five times the median, unless more than one interval in twenty is longer: then the log is
    written in bursts or on change, and only what is rare even there is a gap.
    """
    if not len(intervals):
        return 0
    limit = 5 * int(np.median(intervals))
    if np.mean(intervals > limit) > 0.05:
        limit = 5 * int(np.quantile(intervals, 0.99))
    return limit


def clean(name: str, column: Column, start_ns: int, max_gap_ns: int = 0) -> TimeAxis:
    """Finds what is wrong with a channel's time, masks what cannot be used, splits where it jumps.

    Args:
        name: the channel, for the findings.
        column: samples as the log has them.
        start_ns: the log's start, for the findings.
        max_gap_ns: intervals longer than this are gaps; 0 decides from the channel itself.
    """
    findings: list[Finding] = []

    def tell(code: str, message: str, where: Bools, severity: str = "warning") -> None:
        if count := int(where.sum()):
            first = (int(t[np.argmax(where)]) - start_ns) / 1e9
            findings.append(Finding(code, severity, message, name, count, first))  # type: ignore[arg-type]

    t, wraps = unwrapped(column.t)
    for width, wrapped in wraps.items():
        tell("time-wrapped", f"{width} wrapped: continued", wrapped)
    usable = column.valid & np.isfinite(column.value)
    # Cells without any value are the reader's to tell; in a wide table of several rates most are.
    tell("not-a-number", "samples are NaN or infinite: left out", column.valid & ~usable)

    # Late samples: older than the newest so far, while the clock itself goes on.
    rises = bool((t[1:] > t[:-1]).all())
    restarts = (0,) if rises else _restarts(t, np.maximum.accumulate(t))
    late = np.zeros(len(t), dtype=np.bool_)
    for piece in pieces(restarts, len(t)) if not rises else ():
        top = np.maximum.accumulate(t[piece])
        late[piece] = t[piece] < top
    last = np.array(restarts[1:], dtype=np.int64) - 1  # the stamp before a jump says where it is
    back = t[last] - t[last + 1]
    hour = np.abs(back - HOUR_NS) < HOUR_NS / 100
    by = "up to " * (len(last) > 1) + f"{back[~hour].max(initial=0) / 1e9:.3f} s"
    for code, text, which in (
        ("time-dst", "clock set back one hour (summer time?): a new segment begins", hour),
        ("time-backward", f"clock jumps back {by}: a new segment begins", ~hour),
    ):
        where = np.zeros(len(t), dtype=np.bool_)
        where[last[which]] = True
        tell(code, text, where)
    tell("time-late", "samples older than their predecessor: left out, not sorted", late)
    usable &= ~late

    same = np.zeros(len(t), dtype=np.bool_)
    if not rises:
        kept = np.flatnonzero(~late)
        repeats = np.diff(t[kept], prepend=t[kept][:1] - 1) == 0
        same[kept[repeats]] = True
    if same.any():
        previous = np.zeros(len(t), dtype=np.int64)
        previous[kept] = np.concatenate([kept[:1], kept[:-1]])
        value = column.value
        differs = same & (value != value[previous]) & usable & usable[previous]
        # Two values for one instant: every sample of that stamp is masked, not just the later ones.
        groups = np.cumsum(~same)
        clash = np.isin(groups, groups[differs]) & ~late
        sizes = np.bincount(groups[kept], minlength=groups[-1] + 1)
        stuck = (sizes > _STUCK)[groups] & ~late
        sizes = sizes[sizes > 0]
        if np.mean(sizes > 1) > 0.5 and len(sizes) > 1:
            apart = float(np.median(np.diff(t[kept][~repeats]))) / 1e9
            tell(
                "time-coarse",
                f"about {np.median(sizes):.0f} samples share each time stamp, {apart:g} s apart: "
                "those that differ are left out, for what came when is not known; export the time "
                "with more decimals, or state [channels] group if rows of several devices "
                "alternate", same | clash,
            )  # fmt: skip
        else:
            tell(
                "time-stuck",
                "the clock stands still: samples of one time stamp are left out, or one is kept if "
                "they are equal", stuck,
            )  # fmt: skip
            said = same & ~differs & ~stuck
            tell("time-duplicate", "samples repeated with the same time: dropped", said)
            said = clash & ~stuck
            tell("time-conflict", "different values with one time stamp: all left out", said)
        usable &= ~(same | clash)

    jumps = np.zeros(len(t), dtype=np.bool_)
    jumps[last + 1] = True
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
    long = within & (steps > limit)
    if long.any():
        first = (int(data.t[np.argmax(long)]) - start_ns) / 1e9
        longest = float(steps[long].max()) / 1e9
        hour = abs(longest * 1e9 - HOUR_NS) < HOUR_NS / 100
        summer = " (an hour: summer time?)" if hour else ""
        message = f"no samples for up to {longest:.3f} s{summer}: not bridged, a new segment begins"
        findings.append(Finding("gap", "warning", message, name, int(long.sum()), first))
    interval = int(np.median(steps[within])) if within.any() else 0
    return TimeAxis(
        data, starts, interval, limit, int(long.sum()), int(same.sum()),
        int(late.sum()) + len(restarts) - 1, tuple(findings),
    )  # fmt: skip


def unwrapped(t: Times) -> tuple[Times, dict[str, Bools]]:
    """The times of a counter as if it had not wrapped, and where it did, by its width."""
    found: dict[str, Bools] = {}
    if not (t[1:] < t[:-1]).any():
        return t, found
    for width, wrap_ns in WRAPS_NS.items():
        fall = np.diff(t, prepend=t[:1])
        wrapped = (fall < 0) & (np.abs(fall + wrap_ns) < wrap_ns // 1000)
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
        if stays and rises and index - starts[-1] > 1:
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


def _samples(at: Over, of: Channel) -> tuple[Times, Floats]:
    """The piece of a channel that goes with a piece of another one.

    Channels that the clock's jumps part into equally many pieces belong together piece by piece,
    also where times repeat. Else the only piece that shares time; nothing where two do: which one
    was logged along cannot be known.
    """
    own = pieces(of.starts, len(of.data.t))
    if len(own) != at.n:
        t = of.data.t
        own = [p for p in own if t[p][0] <= at.t[-1] and t[p][-1] >= at.t[0]]
    chosen = own[at.k] if len(own) == at.n else own[0] if len(own) == 1 else slice(0, 0)
    return of.data.t[chosen], of.data.value[chosen]


def hold(at: Over, of: Channel) -> tuple[Floats, Bools]:
    """Last value of a channel at each time, and whether it is fresh enough to use; shape (n,)."""
    xs, ys = _samples(at, of)
    if not len(xs):
        return np.full(len(at.t), np.nan), np.zeros(len(at.t), dtype=np.bool_)
    index = np.searchsorted(xs, at.t, side="right") - 1
    known = index >= 0
    index = np.maximum(index, 0)
    return ys[index], known & (at.t - xs[index] <= of.gap_ns)


def interpolated(at: Over, of: Channel) -> Floats:
    """Linear interpolation of a channel, shape (n,).

    NaN before its first sample and across its gaps; the last value holds as long as `hold` does.
    """
    xs, ys = _samples(at, of)
    if not len(xs):
        return np.full(len(at.t), np.nan)
    t = at.t
    after = np.clip(np.searchsorted(xs, t, side="left"), 0, len(xs) - 1)
    before = np.maximum(after - 1, 0)
    gap = xs[after] - xs[before]
    # Differences of int64 are exact; seconds since 1970 as floats are not.
    part = np.clip((t - xs[before]) / np.maximum(gap, 1), 0.0, 1.0)
    value = ys[before] + part * (ys[after] - ys[before])
    unknown = (t < xs[0]) | (t > xs[-1] + of.gap_ns) | ((t < xs[after]) & (gap > of.gap_ns))
    return np.where(unknown, np.nan, np.where(xs[after] == t, ys[after], value))
