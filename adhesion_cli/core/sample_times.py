"""A channel at the times of another one: its last value there, or on a line between two."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .model import Bools, Channel, Floats, Times


class SampleTimes(NamedTuple):
    """Times at which other channels are looked up, in pieces between the jumps of their clock."""

    t: Times  # (n,) [ns]
    pieces: tuple[slice, ...] = (slice(None),)

    def last_value(self, channel: Channel) -> tuple[Floats, Bools]:
        """Last value of a channel at each time, and whether it is fresh enough to use; (n,)."""
        value, fresh = np.full(len(self.t), np.nan), np.zeros(len(self.t), dtype=np.bool_)
        for piece, xs, ys in self._samples(channel):
            t = self.t[piece]
            if np.array_equal(xs, t):  # columns of one table
                value[piece], fresh[piece] = ys, True
                continue
            index = np.searchsorted(xs, t, side="right") - 1
            has_sample = index >= 0
            index = np.maximum(index, 0)
            value[piece] = ys[index]
            fresh[piece] = has_sample & (t - xs[index] <= channel.gap_ns)
        return value, fresh

    def interpolate(self, channel: Channel) -> Floats:
        """A channel on a line between two samples, (n,); NaN outside of them and in gaps."""
        value = np.full(len(self.t), np.nan)
        for piece, xs, ys in self._samples(channel):
            t = self.t[piece]
            if np.array_equal(xs, t):
                value[piece] = ys
                continue
            later_index = np.clip(np.searchsorted(xs, t, side="left"), 0, len(xs) - 1)
            earlier_index = np.maximum(later_index - 1, 0)
            gap = xs[later_index] - xs[earlier_index]
            # Differences of int64 are exact; seconds since 1970 as floats are not.
            fraction = np.clip((t - xs[earlier_index]) / np.maximum(gap, 1), 0.0, 1.0)
            between = ys[earlier_index] + fraction * (ys[later_index] - ys[earlier_index])
            unknown = (t < xs[0]) | (t > xs[-1]) | ((t < xs[later_index]) & (gap > channel.gap_ns))
            value[piece] = np.where(
                unknown, np.nan, np.where(xs[later_index] == t, ys[later_index], between)
            )
        return value

    def _samples(self, channel: Channel) -> Iterator[tuple[slice, Times, Floats]]:
        """Each piece with the times and values of the channel's piece that goes with it.

        Channels that the clock's jumps part into equally many pieces belong together piece by
        piece, also where times repeat. Else a piece goes with the only one that shares time, and
        with none where two do: which one was logged along cannot be known.
        """
        t, value = channel.data.t, channel.data.value
        for k, piece in enumerate(self.pieces):
            sources = channel.pieces
            if len(sources) == len(self.pieces):
                sources = sources[k : k + 1]
            else:
                start, stop = self.t[piece][[0, -1]]
                sources = tuple(p for p in sources if t[p][0] <= stop and t[p][-1] >= start)
            if len(sources) == 1:
                yield piece, t[sources[0]], value[sources[0]]
