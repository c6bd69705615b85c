"""Collects the columns of one series, block by block."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...core.finding import Finding, Severity, Span, merge_spans
from ...core.model import Bools, Column, Floats, Times
from ...core.time_axis import spans_of
from ..source import TimeSource
from .blocks import Offsets, Records
from .columns import MessageFault, Wanted
from .fields import Leaf
from .series import Series

# From one run of rising times to another in the order of time, per fall of the time in the file.
# Late messages and exchanged chunks give about two. A clock that was set back gives more: it lays
# two stretches of the log over each other, and sorting would mix them.
_MOST_TURNS = 16
_MOST_REPORTED = 500  # kinds of faults of one channel that are reported one by one
_SEVERITY: dict[str, Severity] = {
    "mcap-bad-message": "error",
    "mcap-type-change": "error",
    "mcap-text-change": "error",
    "mcap-array-length": "warning",
    "mcap-late-field": "warning",
    "mcap-no-stamp": "error",
}


@dataclass(slots=True)
class _Faulty:
    """Messages of one series that share a fault."""

    offset: int  # offset in the file of the block where the first stands
    count: int = 0
    spans: tuple[Span, ...] = ()


class Collector:
    """The columns of one series.

    Args:
        series: the topic.
        source: the clock.
        leaves: the numbers and words of it that are wanted.
        log_start: the log's start [ns], for the findings.
    """

    def __init__(
        self, series: Series, source: TimeSource, leaves: list[Leaf], log_start: int
    ) -> None:
        self.series, self._source, self.leaves = series, source, leaves
        self._log_start = log_start
        self.rows = 0  # messages so far
        self._faults: dict[tuple[str, str, str], _Faulty] = {}  # by code, field and reason
        s = series
        self._wanted = Wanted.select(s.tree, leaves, s.stamp)
        places = list(self._wanted.numbers)
        self._stamp_at = [places.index(steps) for steps in s.stamp.places] if s.stamp else []
        self._t: Times = np.empty(s.rows, np.int64)
        self._values: Floats = np.empty((len(leaves), s.rows))
        self._backward_finding: Finding | None = None

    def take(self, records: Records, offset: int) -> None:
        """Adds its messages of the block at an offset of the file."""
        rows = slice(self.rows, self.rows + len(records.start))
        self.rows = rows.stop
        if rows.stop > self.series.rows:
            return  # the caller reports too many rows
        decoder, log = self.series.decoder, records.log_time
        assert decoder is not None
        with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
            data, begin, stop = records.data, records.data_start, records.stop
            values, faults = decoder.columns(data, begin, stop, self._wanted)
        self._values[:, rows] = values[: len(self.leaves)]
        self._t[rows] = records.publish_time if self._source == "publish" else log
        if self._source == "header" and (stamp := self.series.stamp):
            own_stamps, has_stamp = stamp.times(values[self._stamp_at])
            self._t[rows] = np.where(has_stamp, own_stamps, log)
            faults += self._without_stamp(has_stamp, rows, faults)
        for fault in faults:
            key = fault.code, fault.field, fault.reason
            if len(self._faults) >= _MOST_REPORTED and key not in self._faults:
                key = fault.code, fault.field and "further fields", fault.reason and "other reasons"
            faulty = self._faults.setdefault(key, _Faulty(offset))
            faulty.count += len(fault.rows)
            faulty.spans = merge_spans([*faulty.spans, *self._spans(fault.rows, log[fault.rows])])

    def _spans(self, rows: Offsets, t: Times) -> tuple[Span, ...]:
        """Time spans of messages, one of each run of them."""
        cuts = np.flatnonzero(np.diff(rows) > 1)
        begins, stops = t[np.append(0, cuts + 1)], t[np.append(cuts, -1)]
        return spans_of(np.minimum(begins, stops), np.maximum(begins, stops), self._log_start)

    def _without_stamp(
        self, has_stamp: Bools, rows: slice, faults: list[MessageFault]
    ) -> list[MessageFault]:
        """Takes out messages without a stamp; says which, but for those that do not decode."""
        self._values[:, rows][:, ~has_stamp] = np.nan
        lacking = ~has_stamp
        for fault in faults:
            if fault.code == "mcap-bad-message":
                lacking[fault.rows] = False
        return [MessageFault("mcap-no-stamp", np.flatnonzero(lacking))] if lacking.any() else []

    def columns(self) -> list[Column]:
        """One column per leaf, all with the same time array.

        Messages may stand in any order in the file: their log or publish time orders them. The
        stamps inside them are not sorted, and neither are the times of a clock that was set back.
        """
        t = self._t
        if self._source != "header" and (t[1:] < t[:-1]).any():
            order = np.argsort(t, kind="stable")
            run = np.append(0, np.cumsum(np.diff(t) < 0, dtype=np.int32))
            if np.count_nonzero(np.diff(run[order])) <= _MOST_TURNS * run[-1]:
                newest = np.maximum.accumulate(t)
                out_of_order = np.flatnonzero(t < newest)
                values = {"most_s": float((newest - t).max()) / 1e9}
                finding = self.series.finding(
                    "mcap-unordered", "warning", len(out_of_order), values, clock=self._source
                )
                self._backward_finding = replace(
                    finding, spans=self._spans(out_of_order, t[out_of_order])
                )
                for array in (t, *self._values):
                    array[:] = array[order]  # in place, to save memory
        return [self._column(*pair) for pair in zip(self.leaves, self._values, strict=True)]

    def _column(self, leaf: Leaf, value: Floats) -> Column:
        """One column; the numbers of an enum count its names."""
        words = tuple(self._wanted.words.get(leaf.steps, leaf.words))
        if leaf.numbers:
            is_number = value[:, None] == np.array(leaf.numbers)
            value = np.where(is_number.any(axis=1), is_number.argmax(axis=1), np.nan)
        return Column(self._t, value, np.isfinite(value), words)

    def findings(self) -> Iterator[Finding]:
        """What was found on the way; to be asked after `columns`."""
        if self._backward_finding:
            yield self._backward_finding
        for (code, place, reason), faulty in sorted(self._faults.items()):
            names = {k: v for k, v in (("field", place), ("reason", reason)) if v}
            finding = self.series.finding(
                code, _SEVERITY[code], faulty.count, {"byte": faulty.offset}, **names
            )
            yield replace(finding, spans=faulty.spans)
