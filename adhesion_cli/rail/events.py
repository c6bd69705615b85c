"""Slides and changes of region, of a log or of a stop in closed loop."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ..core.model import Bools, Event, Floats, Regions, Times
from ..core.physics import SLIDE, WORKING
from ..core.signals import true_runs
from .slope import REGION_TITLES

HIDDEN_TIME = 0.5  # a slide may be hidden in as long a time without slip [s]
END_SLIP = 0.01  # slip at which a slide is over
SHORTEST_SLIDE = 0.1  # least duration of a slide [s]
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
    # ∫ F (v − ωR) dt, heat and wear of tread and rail, by a straight line of F over a lock [J]
    energy: float | None  # None without F
    is_lower_bound: bool  # the train speed is estimated, or its delay is unknown
    lock_u95: float = 0.0  # of the energy, by a lock: its F is that before, that after or between

    def __str__(self) -> str:
        heat = "" if self.energy is None else f", {self.energy / 1e3:.1f} kJ"
        bound = "at least " if self.is_lower_bound else ""
        slip = "" if self.max_slip is None else f", slip up to {self.max_slip:.0%}"
        return f"slide of {bound}{self.duration:.2f} s, {self.distance:.0f} m{slip}{heat}"


def slides(  # noqa: PLR0913 (one column each)
    segment: slice,
    t: Times,
    v: Floats,
    s: Floats,
    certain_slip: Floats,
    F: Floats,
    is_lower_bound: bool,
    noise: Floats | None = None,
) -> Iterator[Slide]:
    """Slides in a segment, in the order of time.

    All columns have shape (n,): times [ns], train speed [m/s], slip, slip minus its possible error,
    adhesion force [N]; and `noise` of slip, which a slide must exceed. `is_lower_bound` is as in
    `Slide`.
    """
    for start, stop in true_runs(certain_slip[segment] > END_SLIP):
        samples = slice(segment.start + start, segment.start + stop)
        seconds = (t[samples] - t[samples.start]) * 1e-9
        deep: Bools = certain_slip[samples] > SLIDE + (0.0 if noise is None else noise[samples])
        if float(np.diff(seconds, prepend=seconds[0])[deep].sum()) < SHORTEST_SLIDE:
            continue
        fast = v[samples] > WORKING
        force = F[samples]
        finite = np.isfinite(force)
        sliding_speed = s[samples] * v[samples]  # v − ωR = s v
        lock_u95 = 0.0
        if is_known := bool(finite.any()):  # a locked wheel of a log has no F
            force = np.maximum(force, 0.0)  # a braked wheel that slides is not driven
            lock_u95 = _lock_u95(seconds, force, sliding_speed)
            force = np.interp(seconds, seconds[finite], force[finite])
        heat = force * sliding_speed
        yield Slide(
            samples,
            int(t[samples.start]),
            float(seconds[-1]),
            float(np.trapezoid(v[samples], seconds)),
            min(float(s[samples][fast].max()), 1.0) if fast.any() else None,  # noise of a lock
            float(np.trapezoid(heat, seconds)) if is_known else None,
            is_lower_bound,
            lock_u95,
        )


def _lock_u95(t: Floats, F: Floats, sliding_speed: Floats) -> float:
    """By how much the energy of a slide is uncertain where F is NaN; all columns (n,) [J].

    F is there between that before and that after, and any up to twice the known one at an end.
    """
    known, u95 = np.flatnonzero(np.isfinite(F)), 0.0
    for start, stop in true_runs(~np.isfinite(F)):
        place = int(np.searchsorted(known, start))
        before, after = (F[known[i]] if 0 <= i < len(known) else None for i in (place - 1, place))
        half = before or after or 0.0
        if before is not None and after is not None:
            half = abs(after - before) / 2.0
        part = slice(max(start - 1, 0), stop + 1)
        u95 += float(half) * float(np.trapezoid(sliding_speed[part], t[part]))
    return u95


def axle_events(
    axle: int, slides: Iterable[Slide], segments: Iterable[slice], t: Times, code: Regions
) -> tuple[Event, ...]:
    """Slides, and changes of region that last; in the order of time.

    `segments` are of `t` [ns] and `code`, the index into `slope.REGION_TITLES`, both of shape (n,).
    """
    name = f"axle {axle}"
    events = [
        Event(x.start, "slide", f"{name}: {x}", x.start + round(x.duration * 1e9)) for x in slides
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
                events.append(Event(int(segment_t[i]), "region-change", text))
            previous = region
    return tuple(sorted(events))
