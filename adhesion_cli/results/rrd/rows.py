"""Which rows of a record are drawn, and what stands for those that are not."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.model import AxleResult, Bools, Times
from .parts import SeriesPlot

OVERVIEW = 10_000  # rows of an overview: two for each column of the finest screens


class Lane(NamedTuple):
    """Rows to draw as one line, in the order of time; shape (m,)."""

    place: int  # 0, or of a further line where the clock was set back over times that are drawn
    t: Times  # of the rows [ns], rising
    row: NDArray[np.int64]  # of the record, −1 for one without values: a break in each line
    inside: Bools  # whether the row lies in a segment

    def path_under(self, path: str) -> str:
        """The entity of these rows; a chart shows what is below its own, too."""
        return f"{path}/again/{self.place}" if self.place else path

    def select(self, is_drawn: Bools) -> "Lane":
        """Some of the rows, by a mask of shape (m,)."""
        return Lane(self.place, self.t[is_drawn], self.row[is_drawn], self.inside[is_drawn])


def of_axle(axle: AxleResult) -> list[Lane]:
    """Rows to draw: each sample, and a break wherever a segment ends or the clock is set back.

    The viewer sorts rows by time. What came after a clock was set back would be mixed with what
    came before, so it has a lane of its own while their times overlap.
    """
    t = axle.record.t
    inside = np.zeros(len(t), bool)
    for s in axle.record.segments:
        inside[s] = True
    backward = np.flatnonzero(np.diff(t) < 0) + 1
    bounds = {b for s in axle.record.segments for b in (s.start, s.stop)} | {*backward.tolist()}
    edges = np.array(sorted(bounds - {0, len(t)}), np.int64)
    index = np.insert(np.arange(len(t)), edges, -1)
    times, inside = np.insert(t, edges, t[edges - 1] + 1), np.insert(inside, edges, False)
    places = _places(times)
    lanes = []
    for k in range(int(places.max(initial=0)) + 1):
        rows = np.flatnonzero(places == k)
        lanes.append(Lane(k, times[rows], index[rows], inside[rows]))
    return lanes


def _places(t: Times) -> NDArray[np.int64]:
    """The lane of each row: of each stretch of rising times the first that has ended by then."""
    starts = np.append(0, np.flatnonzero(np.diff(t) < 0) + 1)
    stops = np.append(starts[1:], len(t))
    places, lane_ends = np.zeros(len(t), np.int64), [int(t[0]) - 1] if len(t) else []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        if start == stop:
            continue
        k = next((k for k, lane_end in enumerate(lane_ends) if lane_end < t[start]), len(lane_ends))
        lane_ends[k : k + 1] = [int(t[stop - 1])]
        places[start:stop] = k
    return places


def spans(index: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """First row of each span of `size` rows of a lane's index (m,); a break is its own span."""
    breaks = np.flatnonzero(index < 0)
    starts = np.concatenate([np.arange(0, len(index), size), breaks, breaks + 1])
    return np.unique(starts[starts < len(index)])


def envelope(t: Times, plot: SeriesPlot, starts: NDArray[np.int64]) -> tuple[Times, SeriesPlot]:
    """The lowest and the highest value of each span of rows, in the order in which the line goes.

    `starts` has the row of each span, rising from 0, shape (k,). A span of one row stays that row.
    """
    if len(starts) == len(t):
        return t, plot
    lower, upper = plot.values, plot.values
    if plot.half_width is not None:
        lower, upper = lower - plot.half_width, upper + plot.half_width
    minima = np.fmin.reduceat(lower, starts, axis=0)  # fmin, fmax pass over NaN
    maxima = np.fmax.reduceat(upper, starts, axis=0)
    size = np.diff(starts, append=len(t))
    bucket = np.repeat(np.arange(len(starts)), np.minimum(size, 2))
    second = np.diff(bucket, prepend=-1) == 0
    rows_chosen = starts[bucket] + np.where(second, size[bucket] // 2, 0)
    if plot.half_width is not None:
        values, half_width = (minima + maxima) / 2, (maxima - minima) / 2
        plot = replace(plot, values=values[bucket], half_width=half_width[bucket])
        return t[rows_chosen], plot
    rises = plot.values[starts + size - 1] >= plot.values[starts]
    values = np.where(rises[bucket] == second[:, None], maxima[bucket], minima[bucket])
    return t[rows_chosen], replace(plot, values=values)
