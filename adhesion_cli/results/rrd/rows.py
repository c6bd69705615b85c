"""Which rows of a record are drawn, and what stands for those that are not."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.model import AxleResult, Bools, Times
from .parts import SeriesPlot

OVERVIEW = 10_000  # rows of an overview: two for each column of the finest screens


class DrawnRows(NamedTuple):
    """Rows to draw as one line, in the order of time; shape (m,)."""

    t: Times  # of the rows [ns], rising
    row: NDArray[np.int64]  # of the record, −1 for one without values: a break in each line
    inside: Bools  # whether the row lies in a segment

    def select(self, draw_mask: Bools) -> "DrawnRows":
        """Some of the rows, by a mask of shape (m,)."""
        return DrawnRows(self.t[draw_mask], self.row[draw_mask], self.inside[draw_mask])


def of_axle(axle: AxleResult) -> DrawnRows:
    """Rows to draw: each sample, and a break wherever a segment ends.

    The viewer sorts rows by time. What came after a clock was set back would be mixed with what
    came before: it is drawn from where its times pass those.
    """
    t = axle.record.t
    inside = np.zeros(len(t), bool)
    for s in axle.record.segments:
        inside[s] = True
    bounds = {b for s in axle.record.segments for b in (s.start, s.stop)}
    edges = np.array(sorted(bounds - {0, len(t)}), np.int64)
    index = np.insert(np.arange(len(t)), edges, -1)
    times, inside = np.insert(t, edges, t[edges - 1] + 1), np.insert(inside, edges, False)
    is_newest = np.diff(np.maximum.accumulate(times), prepend=times[:1] - 1) > 0
    return DrawnRows(times, index, inside).select(is_newest)


def spans(index: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """First row of each span of `size` rows by their index (m,); a break is its own span."""
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
