"""What a check finds in one channel, and how it is reported: within the window, with its spans."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core.finding import Finding, Severity, merged
from ..core.model import Bools, Channel, Column, Floats, Times
from ..core.signals import true_runs

Window = tuple[float | None, float | None]  # seconds after the log's start, from and to


class Fault(NamedTuple):
    """Samples of one channel that show a fault of its sensor."""

    code: str
    where: Bools  # shape (n,)
    left_out: bool = True  # whether the samples must not be used
    severity: Severity = "warning"


class View(NamedTuple):
    """The part of a log that is analysed."""

    start_ns: int
    window: Window = (None, None)

    def seconds(self, t: Times) -> Floats:
        """Time after the log's start, shape (n,) [s]."""
        since: Floats = (t - self.start_ns) / 1e9
        return since

    def holds(self, t: Times) -> Bools:
        """Which times lie in the window, shape (n,)."""
        since, (first, last) = self.seconds(t), self.window
        inside: Bools = (since >= (-np.inf if first is None else first)) & (
            since <= (np.inf if last is None else last)
        )
        return inside

    def report(
        self, fault: Fault, channel: Channel,
        values: Mapping[str, float] | None = None, names: Mapping[str, str] | None = None,
    ) -> list[Finding]:  # fmt: skip
        """The finding of a fault; none where the window holds no sample of it.

        Args:
            fault: its mask is over the channel's samples.
            channel: whose fault it is.
            values: numbers that the message quotes.
            names: texts that the message quotes.
        """
        t = channel.data.t
        where = fault.where
        where = where & self.holds(t) if where.any() else where
        if not where.any():
            return []
        since = self.seconds(t)
        spans = merged([(float(since[a]), float(since[b - 1])) for a, b in true_runs(where)])
        return [
            Finding(
                fault.code, fault.severity, channel=channel.title, count=int(where.sum()),
                spans=spans, values=values or {}, names=names or {},
            )
        ]  # fmt: skip


def without(channel: Channel, left_out: Bools) -> Channel:
    """A channel without some samples, as if they had not been logged."""
    if not left_out.any():
        return channel
    d, kept = channel.data, ~left_out
    before = np.concatenate([[0], np.cumsum(kept)])  # samples kept before each one
    starts = {int(before[s]) for s in channel.starts} - {int(before[-1])}
    data = Column(d.t[kept], d.value[kept], d.valid[kept])
    return replace(channel, data=data, starts=tuple(sorted(starts)))
