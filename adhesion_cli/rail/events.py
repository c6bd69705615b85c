"""Slides and changes of region, of a log or of a stop in closed loop."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ..core.model import Bools, Event, Floats, Regions, Times
from ..core.signals import true_runs
from ..core.stop import SLIDE
from .slope import SHOWN

UNSEEN = 0.5  # a slide may be hidden in as long a time without slip [s]
CAUGHT = 0.01  # slip at which a slide is over
_SHORT = 0.1  # least duration of a slide [s]
_LASTS = 0.5  # least duration of a region that is an event [s]


class Slide(NamedTuple):
    """One slide of one axle, from `CAUGHT` to `CAUGHT` with more than `SLIDE` between.

    With an estimated or delayed train speed its numbers are lower bounds.
    """

    where: slice  # of the record
    start: int  # [ns]
    duration: float  # [s]
    distance: float  # of the train during the slide [m]
    max_slip: float  # [-]
    energy: float | None  # ∫ F (v − ωR) dt, heat and wear of tread and rail [J]; None without F
    at_least: bool  # the train speed is estimated, or its delay is unknown

    def __str__(self) -> str:
        heat = "" if self.energy is None else f", {self.energy / 1e3:.1f} kJ"
        least = "at least " if self.at_least else ""
        text = f"{self.duration:.2f} s, {self.distance:.0f} m, slip up to {self.max_slip:.0%}"
        return f"slide of {least}{text}{heat}"


def slides(  # noqa: PLR0913 (one column each)
    segment: slice, t: Times, v: Floats, s: Floats, clear: Floats, F: Floats, at_least: bool,
    noise: Floats | None = None,
) -> Iterator[Slide]:  # fmt: skip
    """Slides in a segment, in the order of time.

    Args:
        segment: of the columns, all of shape (n,).
        t: [ns].
        v: train speed [m/s].
        s: slip [-].
        clear: slip minus its possible error.
        F: adhesion force [N].
        at_least: as in `Slide`.
        noise: of slip; a slide must exceed it (n,).
    """
    for first, past in true_runs(clear[segment] > CAUGHT):
        where = slice(segment.start + first, segment.start + past)
        seconds = (t[where] - t[where.start]) * 1e-9
        deep: Bools = clear[where] > SLIDE + (0.0 if noise is None else noise[where])
        if float(np.diff(seconds, prepend=seconds[0])[deep].sum()) < _SHORT:
            continue
        heat = F[where] * s[where] * v[where]  # v − ωR = s v
        known = np.isfinite(heat).all()  # a locked wheel of a log has no F
        yield Slide(
            where, int(t[where.start]), float(seconds[-1]),
            float(np.trapezoid(v[where], seconds)), float(s[where].max()),
            float(np.trapezoid(heat, seconds)) if known else None, at_least,
        )  # fmt: skip


def of_axle(
    axle: int, found: Iterable[Slide], segments: Iterable[slice], t: Times, code: Regions
) -> tuple[Event, ...]:
    """Slides, and changes of region that last; in the order of time.

    Args:
        axle: its number.
        found: its slides.
        segments: of `t` and `code`.
        t: [ns], shape (n,).
        code: index into `slope.SHOWN`, shape (n,).
    """
    name = f"axle {axle}"
    events = [
        Event(x.start, "slide", f"{name}: {x}", x.start + round(x.duration * 1e9)) for x in found
    ]
    for segment in segments:
        mine, at = code[segment], t[segment]
        starts = np.concatenate([[0], np.flatnonzero(np.diff(mine)) + 1])
        lasts = np.diff(at[starts], append=at[-1]) * 1e-9 >= _LASTS
        before = SHOWN[0]
        for i in starts[lasts].tolist():
            after = SHOWN[mine[i]]
            if after != before:
                text = f"{name}: region changes from {before} to {after}"
                events.append(Event(int(at[i]), "region-change", text))
            before = after
    return tuple(sorted(events))
