"""Stretches in which a channel repeats one value."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.model import Bools, Channel, Floats


class RepeatedRuns(NamedTuple):
    """Stretches of equal values without a gap, shape (k,)."""

    start: NDArray[np.int64]  # index of its first sample
    final: NDArray[np.int64]  # and of its last one
    value: Floats  # what it repeats
    seconds: Floats  # from first to last [s]
    leap: Floats  # change of the value at its end; infinite for the last one, which never ends

    @property
    def length(self) -> NDArray[np.int64]:
        """Number of samples, shape (k,)."""
        return self.final - self.start + 1

    def repeated(self, stuck: Bools) -> Bools:
        """All but the first sample of some stretches: that one is a measurement; shape (n,)."""
        edges = np.zeros(self.final[-1] + 2, dtype=np.int64)
        edges[self.start[stuck] + 1] += 1
        edges[self.final[stuck] + 1] -= 1
        return np.cumsum(edges[:-1]) > 0


def runs(c: Channel) -> RepeatedRuns:
    """The stretches of a channel."""
    t, x = c.data.t, c.data.value
    changed = np.ones(len(t) + 1, dtype=np.bool_)
    dt = np.diff(t)
    changed[1:-1] = (x[1:] != x[:-1]) | (dt <= 0) | (dt > c.gap_ns)
    edges = np.flatnonzero(changed)
    start, final = edges[:-1], edges[1:] - 1
    leap = np.abs(np.append(x[start[1:]], np.inf) - x[final])
    return RepeatedRuns(start, final, x[start], (t[final] - t[start]) / 1e9, leap)
