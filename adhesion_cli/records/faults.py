"""What a check finds in one channel, and how it is reported: within the window, with its spans.

`RepeatedRuns` are the stretches in which a channel repeats one value, as a stuck sensor does.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.finding import Finding, Severity
from ..core.masks import spans_of_mask
from ..core.model import Bools, Channel, Column, Floats, Times

Window = tuple[float | None, float | None]  # seconds after the log's start, from and to


class Fault(NamedTuple):
    """Samples of one channel that show a fault of its sensor."""

    code: str
    mask: Bools  # shape (n,)
    excluded: bool = True  # whether the samples must not be used
    severity: Severity = "warning"
    values: Mapping[str, float] = MappingProxyType({})  # the message quotes them
    names: Mapping[str, str] = MappingProxyType({})  # likewise
    title: str = ""  # of the channel that it is about, where its samples are of another one


class View(NamedTuple):
    """The part of a log that is analysed."""

    start_ns: int
    window: Window = (None, None)

    def seconds(self, t: Times) -> Floats:
        """Time after the log's start, shape (n,) [s]."""
        return (t - self.start_ns) / 1e9

    def contains(self, t: Times) -> Bools:
        """Which times lie in the window, shape (n,)."""
        since, (start, stop) = self.seconds(t), self.window
        has_begun: Bools = since >= (-np.inf if start is None else start)
        return has_begun & (since <= (np.inf if stop is None else stop))

    def report(self, fault: Fault, channel: Channel) -> list[Finding]:
        """The finding of a fault; none where the window holds no sample of it.

        Its mask is over the channel's samples.
        """
        t = channel.data.t
        mask = fault.mask
        mask = mask & self.contains(t) if mask.any() else mask
        if not mask.any():
            return []
        spans = spans_of_mask(mask, t, self.start_ns)
        place, count = fault.title or channel.title, int(mask.sum())
        quoted = dict(fault.values), dict(fault.names)
        return [Finding(fault.code, fault.severity, place, count, spans, *quoted)]


def remove_samples(channel: Channel, excluded: Bools) -> Channel:
    """A channel without some samples, as if they had not been logged."""
    if not excluded.any():
        return channel
    d, included = channel.data, ~excluded
    included_before = np.concatenate([[0], np.cumsum(included)])  # samples kept before each one
    starts = {int(included_before[s]) for s in channel.starts} - {int(included_before[-1])}
    data = Column(d.t[included], d.value[included], d.valid[included])
    return replace(channel, data=data, starts=tuple(sorted(starts)))


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
