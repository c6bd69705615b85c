"""Which rows of a record are drawn, and what stands for those that are not."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.model import AxleResult, Bools, Times
from .parts import Plot

OVERVIEW = 10_000  # rows of an overview: two for each column of the finest screens


def of_axle(axle: AxleResult) -> tuple[Times, NDArray[np.int64], Bools]:
    """Rows to draw: each sample, and one without values wherever a segment begins or ends.

    Returns:
        time [ns], index into the record's columns (−1 for a break), and whether the row lies in a
        segment; shape (m,).
    """
    t = axle.record.t
    inside = np.zeros(len(t), bool)
    for s in axle.record.segments:
        inside[s] = True
    bounds = {b for s in axle.record.segments for b in (s.start, s.stop)} - {0, len(t)}
    edges = np.array(sorted(bounds), np.int64)
    index = np.insert(np.arange(len(t)), edges, -1)
    return np.insert(t, edges, t[edges - 1] + 1), index, np.insert(inside, edges, False)


def envelope(t: Times, plot: Plot, first: NDArray[np.int64]) -> tuple[Times, Plot]:
    """The lowest and the highest value of each span of rows, in the order in which the line goes.

    Args:
        t: of the rows [ns], shape (n,).
        plot: their values.
        first: row of each span, rising from 0, shape (k,). A span of one row stays that row.
    """
    if len(first) == len(t):
        return t, plot
    below, above = plot.values, plot.values
    if plot.half is not None:
        below, above = below - plot.half, above + plot.half
    low = np.fmin.reduceat(below, first, axis=0)  # fmin, fmax pass over NaN
    high = np.fmax.reduceat(above, first, axis=0)
    size = np.diff(first, append=len(t))
    each = np.repeat(np.arange(len(first)), np.minimum(size, 2))
    second = np.diff(each, prepend=-1) == 0
    at = first[each] + np.where(second, size[each] // 2, 0)
    if plot.half is not None:
        values, half = (low + high)[each] / 2, (high - low)[each] / 2
        return t[at], replace(plot, values=values, half=half)
    rises = plot.values[first + size - 1] >= plot.values[first]
    top = rises[each] == second[:, None]
    return t[at], replace(plot, values=np.where(top, high[each], low[each]))


def without_repeats(t: Times, plot: Plot) -> tuple[Times, Plot]:
    """The rows that change the lines: of a run of equal rows the first and the last."""
    columns = [x for x in (plot.values, plot.half) if x is not None]
    bits = np.concatenate(columns, axis=1).view(np.int64)
    same = (bits[1:] == bits[:-1]).all(axis=1)
    kept = np.ones(len(t), bool)
    kept[1:-1] = ~(same[:-1] & same[1:])
    half = None if plot.half is None else plot.half[kept]
    return t[kept], replace(plot, values=plot.values[kept], half=half)
