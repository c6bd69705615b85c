"""Slides and changes of region, of a log or of a stop in closed loop."""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.masks import runs_within, true_runs
from ..core.model import Event, Floats, Regions, Times
from ..core.physics import SLIDE, WORKING
from ..core.signals import means_around
from .slope import REGION_TITLES

HIDDEN_TIME = 0.5  # a slide may be hidden in as long a time without slip [s]
END_SLIP = 0.01  # slip at which a slide is over
ROLLS = END_SLIP / 2.0  # a wheel that slips less rolls, whatever the error
SHORTEST_SLIDE = 0.1  # least duration of a slide [s]
_LONGEST_CREEP = 0.5  # creep that an error may hide before and after a slide [s]
_VENTED = 0.8  # of the largest brake force in a lock: less at its end lets the wheel turn
_SHORTEST_REGION = 0.5  # least duration of a region that is an event [s]


class Slide(NamedTuple):
    """One slide of one axle, from `END_SLIP` to `END_SLIP` with more than `SLIDE` between.

    With an estimated or delayed train speed its numbers are lower bounds.
    """

    samples: slice  # of the record
    start: int  # [ns]
    duration: float  # [s]
    distance: float  # of the train during the slide [m]
    max_slip: float | None  # while the train is faster than `WORKING` [-]; None where it is not
    # ∫ F (v − ωR) dt, heat and wear of tread and rail, by `over_locks` [J]
    energy: float | None  # None without F
    is_lower_bound: bool  # the train speed is estimated, or its delay is unknown
    lock_u95: float = 0.0  # expanded uncertainty of the energy by the F of locks [J]
    # expanded uncertainties; None of a lower bound
    duration_u95: float | None = None  # [s]
    max_slip_u95: float | None = None  # [-]

    @property
    def lag_at_most(self) -> float:
        """The way by which the wheel at most lagged the train [m]."""
        return self.distance * (self.max_slip or 0.0)

    def __str__(self) -> str:
        heat = "" if self.energy is None else f", {self.energy / 1e3:.1f} kJ"
        bound = "at least " if self.is_lower_bound else ""
        slip = "" if self.max_slip is None else f", slip up to {self.max_slip:.0%}"
        return f"slide of {bound}{self.duration:.2f} s, {self.distance:.0f} m{slip}{heat}"


def slides(  # noqa: PLR0913 (one column each)
    segments: Iterable[slice],
    t: Times,
    v: Floats,
    s: Floats,
    certain_slip: Floats,
    F: Floats,
    is_lower_bound: bool,
    noise: Floats | None = None,
    brake: Floats | None = None,
    error: Floats | None = None,
) -> Iterator[Slide]:
    """Slides in the order of time, none across two segments.

    All columns have shape (n,): times [ns], train speed [m/s], slip, slip minus its possible error,
    adhesion force [N]; and `noise` of slip, which a slide must exceed, `brake` force at the rim
    [N], and the `error` of slip that lasts, expanded. `is_lower_bound` is as in `Slide`.
    """
    parts, extent = [*segments], None
    zeros = np.zeros(len(s))
    lasting, changing = (zeros if x is None else x for x in (error, noise))
    columns = t, v, s, lasting, changing
    depth = certain_slip - (0.0 if noise is None else noise)
    runs = [x for x in runs_within(certain_slip > END_SLIP, parts) if _is_deep(t[x], depth[x])]
    # slides are apart where the wheel slips least between them
    cuts = [a.stop + int(np.argmin(s[a.stop : b.start + 1])) for a, b in pairwise(runs)]
    for samples, *between in zip(runs, [0, *cuts], [*cuts, len(t)], strict=False):
        seconds = (t[samples] - t[samples.start]) * 1e-9
        fast = v[samples] > WORKING
        sliding_speed = s[samples] * v[samples]  # v − ωR = s v
        known = np.maximum(F[samples], 0.0)  # a braked wheel that slides is not driven
        force, force_error = over_locks(known, None if brake is None else brake[samples])
        is_known = bool(np.isfinite(known).any())
        slide = Slide(
            samples,
            int(t[samples.start]),
            float(seconds[-1]),
            float(np.trapezoid(v[samples], seconds)),
            min(float(s[samples][fast].max()), 1.0) if fast.any() else None,  # noise of a lock
            float(np.trapezoid(force * sliding_speed, seconds)) if is_known else None,
            is_lower_bound,
            float(np.trapezoid(force_error * sliding_speed, seconds)) if is_known else 0.0,
        )
        if error is None:
            yield slide
            continue
        if extent is None or not extent.segment.start <= samples.start < extent.segment.stop:
            extent = _Extent(next(x for x in parts if x.start <= samples.start < x.stop), columns)
        yield extent.measured(slide, *between)


def _is_deep(t: Times, depth: Floats) -> bool:
    """Whether a run of slip is a slide: above `SLIDE` for long enough; shapes (n,)."""
    seconds = (t - t[0]) * 1e-9
    return float(np.diff(seconds, prepend=seconds[0])[depth > SLIDE].sum()) >= SHORTEST_SLIDE


class _Extent:
    """How long slides last, and how uncertain that and their largest slip are.

    A slide lasts from `END_SLIP` to `END_SLIP`. Its error moves both ends: the interval is from the
    slip less its error to the slip with it, and at most `_LONGEST_CREEP` longer at each end. It
    crosses the limit between samples, and slips most between them. Another slide ends it, too.
    Where the noise of single samples hides that crossing, means of a short time show it.
    """

    def __init__(
        self, segment: slice, columns: tuple[Times, Floats, Floats, Floats, Floats]
    ) -> None:
        t, self.v, s, lasting, noise = (x[segment] for x in columns)
        self.segment, self.t, self.s = segment, t, s
        self.seconds: Floats = (t - t[0]) * np.float64(1e-9)
        self.interval = float(np.median(np.diff(self.seconds))) if len(t) > 1 else 0.0
        self.error: Floats = np.hypot(lasting, noise)
        is_known = np.isfinite(s)
        mean = means_around(self.seconds, np.where(is_known, s, 0.0), SHORTEST_SLIDE)
        count = max(SHORTEST_SLIDE / max(self.interval, 1e-9), 1.0)
        is_noisy = is_known & (noise > ROLLS)
        self.level = np.where(is_noisy, mean, s)
        self.level_error = np.hypot(lasting, np.where(is_noisy, noise / math.sqrt(count), noise))
        levels = self.level, self.level + self.level_error
        self.rolling = [np.flatnonzero(~(x > END_SLIP)) for x in levels]  # samples in no slide

    def measured(self, slide: Slide, earliest: int, end: int) -> Slide:
        """A slide with its begin, duration, distance and errors, by the samples of the segment.

        It begins at the `earliest` sample or later, and ends before `end`.
        """
        start, stop = (x - self.segment.start for x in (slide.samples.start, slide.samples.stop))
        k = start + int(np.argmax(self.s[start:stop]))
        limits = earliest - self.segment.start, end - self.segment.start - 1
        (first, last), most = (self._around(rolling, k, limits) for rolling in self.rolling)
        hidden = self.seconds[[first, last]] + np.array([-_LONGEST_CREEP, _LONGEST_CREEP])
        before, after = np.searchsorted(self.seconds, hidden).tolist()
        most = max(most[0], before), min(most[1], after, len(self.s) - 1)
        certain = self.level[start:stop] - self.level_error[start:stop]
        surely = start + np.flatnonzero(certain > END_SLIP)
        least = (surely[0], surely[-1]) if len(surely) else (k, k)
        shortest, duration, longest = (
            self.seconds[b] - self.seconds[a] for a, b in (least, (first, last), most)
        )
        change = max(longest - duration, duration - shortest)
        by_interval = self.interval * float(np.mean(self.v[first : last + 1]))
        run = slice(first, last + 1)
        fast = start + np.flatnonzero(self.v[start:stop] > WORKING)
        slip_u95 = None
        if len(fast):
            k = int(fast[np.argmax(self.s[fast])])
            changes = np.abs(np.diff(self.s[max(k - 2, 0) : k + 3]))
            slip_u95 = math.hypot(self.error[k], float(np.nanmax(changes, initial=0.0)) / 2.0)
        return slide._replace(
            start=int(self.t[first]),
            duration=float(duration) + self.interval,
            distance=float(np.trapezoid(self.v[run], self.seconds[run])) + by_interval,
            duration_u95=math.hypot(change, self.interval),
            max_slip_u95=slip_u95,
        )

    def _around(
        self, rolling: NDArray[np.int64], k: int, limits: tuple[int, int]
    ) -> tuple[int, int]:
        """First and last sample around k that is in no `rolling`, within limits."""
        i = int(np.searchsorted(rolling, k))
        first = int(rolling[i - 1]) + 1 if i else 0
        last = int(rolling[i]) - 1 if i < len(rolling) else len(self.s) - 1
        return max(first, limits[0]), max(min(last, limits[1]), first)


def over_locks(F: Floats, brake: Floats | None) -> tuple[Floats, Floats]:
    """A force with values for a locked wheel, which shows none, and by how much they may be wrong.

    A wheel stays locked while the rail gives less than the brake force at the rim, `brake`. Where
    that lasts up to the end, a better rail turned the wheel: the lock had the force before it.
    Where the brake was vented, it was that before, that after or between. All are (n,) [N].
    """
    filled, error = F.copy(), np.zeros(len(F))
    for start, stop in true_runs(~np.isfinite(F)):
        before, after = (F[i] if 0 <= i < len(F) else None for i in (start - 1, stop))
        lasts = brake is not None and brake[stop - 1] > _VENTED * brake[start:stop].max()
        if before is None or after is None:
            neighbour = after if before is None else before
            filled[start:stop] = error[start:stop] = np.nan if neighbour is None else neighbour
        elif brake is not None and lasts:
            filled[start:stop] = before
            error[start:stop] = abs(min(after, brake[start:stop].max()) - before)
        else:
            filled[start:stop] = np.linspace(before, after, stop - start + 2)[1:-1]
            error[start:stop] = abs(after - before) / 2.0
    return filled, error


def axle_events(
    axle: int, slides: Iterable[Slide], segments: Iterable[slice], t: Times, code: Regions
) -> tuple[Event, ...]:
    """Slides, and changes of region that last; in the order of time.

    `segments` are of `t` [ns] and `code`, the index into `slope.REGION_TITLES`, both of shape (n,).
    """
    name = f"axle {axle}"
    events = [
        Event(x.start, "slide", f"{name}: {x}", x.start + round(x.duration * 1e9), axle)
        for x in slides
    ]
    for segment in segments:
        codes, segment_t = code[segment], t[segment]
        starts = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1])
        lasts = np.diff(segment_t[starts], append=segment_t[-1]) * 1e-9 >= _SHORTEST_REGION
        previous = REGION_TITLES[0]
        for i in starts[lasts].tolist():
            region = REGION_TITLES[codes[i]]
            if region != previous:
                text = f"{name}: region changes from {previous} to {region}"
                events.append(Event(int(segment_t[i]), "region-change", text, axle=axle))
            previous = region
    return tuple(sorted(events))
