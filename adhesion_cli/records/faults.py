"""What a check finds in one channel, and how it is reported: within the window, with its spans."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

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
        return (since >= (-np.inf if start is None else start)) & (
            since <= (np.inf if stop is None else stop)
        )

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
