"""Which rows of a record are drawn."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.model import AxleResult, Bools, Times


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
