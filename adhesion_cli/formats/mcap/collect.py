"""Collects the columns of one series, block by block."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...core.finding import Finding, Severity, Span, merged
from ...core.model import Bools, Column, Floats, Times
from ..source import TimeSource
from .blocks import Offsets, Records
from .columns import Fault, Wanted
from .series import Series

_SECOND = 10**9
# From one run of rising times to another in the order of time, per fall of the time in the file.
# Late messages and exchanged chunks give about two. A clock that was set back gives more: it lays
# two stretches of the log over each other, and sorting would mix them.
_MOST_TURNS = 16
_MOST_REPORTED = 500  # kinds of faults of one channel that are reported one by one
_MOST_SPANS = 1000  # time spans of one of them that are kept before they are joined
_SEVERITY: dict[str, Severity] = {
    "mcap-bad-message": "error",
    "mcap-type-change": "error",
    "mcap-text-change": "error",
    "mcap-array-length": "warning",
    "mcap-long-message": "warning",
    "mcap-not-a-number": "warning",
    "mcap-late-field": "warning",
    "mcap-no-stamp": "error",
    "mcap-rounded": "info",
}


class Collector:
    """The columns of one series.

    Args:
        series: the topic.
        source: the clock.
        paths: the numbers of it that are wanted.
    """

    def __init__(self, series: Series, source: TimeSource, paths: list[str]) -> None:
        self.series, self._source, self.paths = series, source, paths
        self.rows = 0  # messages so far
        self._faults: dict[tuple[str, str, str], _Faulty] = {}  # by code, field and reason
        self._ahead = (1 << 62, -(1 << 62))  # lowest and highest of stamp minus log time [ns]
        self._late: _Faulty | None = None  # messages that stand after later ones
        self._most_late = 0  # [ns]
        s = series
        self._wanted = Wanted.of(s.tree, [s.leaves[p] for p in paths], s.stamp)
        places = list(self._wanted.leaves)
        self._stamp_at = [places.index(steps) for steps in s.stamp.places] if s.stamp else []
        self._t: Times = np.empty(s.rows, np.int64)
        self._values: Floats = np.empty((len(paths), s.rows))
        self._newest = np.int64(-(1 << 63))

    def take(self, records: Records, at: int) -> None:
        """Adds its messages of the block at an offset of the file."""
        here = slice(self.rows, self.rows + len(records.start))
        self.rows = here.stop
        if here.stop > self.series.rows:
            return  # the caller reports too many rows
        decoder, log = self.series.decoder, records.log_time
        assert decoder is not None
        with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
            data, begin, end = records.data, records.data_start, records.end
            values, faults = decoder.columns(data, begin, end, self._wanted)
        self._values[:, here] = values[: len(self.paths)]
        t = records.publish_time if self._source == "publish" else log
        if stamp := self.series.stamp:
            own, known = stamp.times(values[self._stamp_at])
            if known.any():
                low, high = (own - log)[known].min(), (own - log)[known].max()
                self._ahead = min(self._ahead[0], int(low)), max(self._ahead[1], int(high))
            if self._source == "header":
                t = np.where(known, own, log)
                faults += self._without_stamp(known, here, faults)
        self._t[here] = t
        if self._source != "header":
            self._note_late(t, here.start, at)
        for fault in faults:
            key = fault.code, fault.field, fault.reason
            if len(self._faults) >= _MOST_REPORTED and key not in self._faults:
                key = fault.code, fault.field and "further fields", fault.reason and "other reasons"
            rows = fault.rows
            self._faults.setdefault(key, _Faulty(at)).add(here.start + rows, log[rows])

    def _without_stamp(self, known: Bools, here: slice, faults: list[Fault]) -> list[Fault]:
        """Takes out messages without a stamp; says which, but for those that do not decode."""
        self._values[:, here][:, ~known] = np.nan
        lacking = ~known
        for fault in faults:
            if fault.code == "mcap-bad-message":
                lacking[fault.rows] = False
        return [Fault("mcap-no-stamp", np.flatnonzero(lacking))] if lacking.any() else []

    def _note_late(self, t: Times, row: int, at: int) -> None:
        newest = np.maximum.accumulate(np.maximum(t, self._newest))
        self._newest = newest[-1]
        if len(late := np.flatnonzero(t < newest)):
            self._late = self._late or _Faulty(at)
            self._late.add(row + late, t[late])
            self._most_late = max(self._most_late, int((newest - t).max()))

    def columns(self) -> list[Column]:
        """One column per path, all with the same time array.

        Messages may stand in any order in the file: their log or publish time orders them. The
        stamps inside them are not sorted, and neither are the times of a clock that was set back.
        """
        if self._late:
            order = np.argsort(self._t, kind="stable")
            run = np.append(0, np.cumsum(np.diff(self._t) < 0, dtype=np.int32))
            if np.count_nonzero(np.diff(run[order])) <= _MOST_TURNS * run[-1]:
                for one in (self._t, *self._values):
                    one[:] = one[order]  # in place, to save memory
            else:
                self._late = None
        return [Column(self._t, v, np.isfinite(v)) for v in self._values]

    def findings(self, start: int) -> Iterator[Finding]:
        """What was found on the way; to be asked after `columns`.

        Args:
            start: the log's start [ns].
        """
        s, clock = self.series, {"clock": self._source}
        if late := self._late:
            values = {"most_s": self._most_late / 1e9}
            found = s.finding("mcap-unordered", "warning", late.count, values, **clock)
            yield replace(found, spans=late.spans(start))
        for (code, place, reason), one in sorted(self._faults.items()):
            names = {k: v for k, v in (("field", place), ("reason", reason)) if v}
            found = s.finding(code, _SEVERITY[code], one.count, {"byte": one.at}, **names)
            yield replace(found, spans=one.spans(start))
        low, high = self._ahead
        if low <= high and (max(-low, high) > _SECOND or high - low > _SECOND):
            values = {"low_s": low / 1e9, "high_s": high / 1e9}
            yield s.finding("mcap-stamp-offset", "info", 1, values, **clock)


class _Faulty:
    """Messages of one series that share a fault: how many, and where.

    Args:
        at: offset in the file of the block where the first stands.
    """

    def __init__(self, at: int) -> None:
        self.at, self.count = at, 0
        self._last = -1
        self._spans: list[Span] = []  # [ns], whole numbers

    def add(self, rows: Offsets, t: Times) -> None:
        """Adds messages, by their numbers in the series and their times [ns]."""
        cuts = np.flatnonzero(np.diff(rows) > 1)
        first, last = t[np.append(0, cuts + 1)].tolist(), t[np.append(cuts, -1)].tolist()
        if self._spans and rows[0] == self._last + 1:
            first[0] = self._spans.pop()[0]
        self._spans += [(min(a, b), max(a, b)) for a, b in zip(first, last, strict=True)]
        if len(self._spans) > _MOST_SPANS:
            self._spans = list(merged(self._spans))
        self.count += len(rows)
        self._last = int(rows[-1])

    def spans(self, start: int) -> tuple[Span, ...]:
        """From and to of the messages, seconds after a start [ns]."""
        return merged([((a - start) / 1e9, (b - start) / 1e9) for a, b in self._spans])
