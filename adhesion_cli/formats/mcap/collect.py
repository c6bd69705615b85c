"""Collects the columns of one series, block by block."""

from bisect import bisect
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...core.finding import Finding, Severity, Span
from ...core.masks import spans_of
from ...core.model import Column, Floats, Times
from ..source import TimeSource, number_words
from .blocks import Offsets, Records
from .columns import Decoded, DecodingFault
from .fields import Leaf
from .series import Series

# From one run of rising times to another in the order of time, per fall of the time in the file.
# Late messages and exchanged chunks give about two. A clock that was set back gives more: it lays
# two stretches of the log over each other, and sorting would mix them.
_MOST_TURNS = 16
_SEVERITY: dict[str, Severity] = {
    "mcap-bad-message": "error",
    "mcap-type-change": "error",
    "mcap-text-change": "error",
    "mcap-array-length": "warning",
    "mcap-late-field": "warning",
    "mcap-no-stamp": "error",
}


def deal(
    collectors: Sequence["Collector"], records: Records
) -> Iterator[tuple["Collector", Records]]:
    """The messages of a topic for each of its collectors, by their owner.

    Messages of owners that the first ones do not name go to the first owner, which reports them.
    """
    series = collectors[0].series
    if not series.owner_at:
        yield collectors[0], records
        return
    assert series.decoder is not None
    names = tuple(owner.strip() for owner in series.owners if isinstance(owner, str))
    leaf = Leaf(series.owner_at, words=names)
    owners = Decoded(series.decoder, series.tree, [leaf], None, len(records.start))
    owners.fill(0, records.data, records.start, records.stop)
    words = number_words(owners.words.get(series.owner_at, []), ())
    number_of = {
        owner: words.get(owner.strip(), -1) if isinstance(owner, str) else owner
        for owner in series.owners
    }
    numbers = owners.values[0]
    for collector in collectors:
        is_own = numbers == number_of[collector.series.owner]
        if collector.series.owner == series.owners[0]:
            is_own |= ~np.isin(numbers, list(number_of.values()))
        yield collector, records.select(np.flatnonzero(is_own))


class Collector:
    """The columns of one series."""

    def __init__(
        self, series: Series, source: TimeSource, leaves: list[Leaf], log_start: int
    ) -> None:
        self.series, self._source, self.leaves = series, source, leaves
        self._log_start = log_start
        self.rows = 0  # messages so far
        self._blocks: list[tuple[int, int]] = []  # first message and offset of each block
        assert series.decoder is not None
        self._decoded = Decoded(series.decoder, series.tree, leaves, series.stamp, series.rows)
        self._t = np.empty(series.rows, np.int64)

    def take(self, records: Records, offset: int) -> None:
        """Adds its messages of the block at an offset of the file."""
        rows = slice(self.rows, self.rows + len(records.start))
        self.rows = rows.stop
        if rows.stop > self.series.rows:
            return  # the caller reports too many rows
        self._blocks.append((rows.start, offset))
        self._t[rows] = records.publish_time if self._source == "publish" else records.log_time
        with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
            self._decoded.fill(rows.start, records.data, records.start, records.stop)

    def finish(self) -> tuple[list[Column], list[Finding]]:
        """One column per leaf, all with the same time array; and what was wrong.

        Messages may stand in any order in the file: their log or publish time orders them. The
        stamps inside them are not sorted, and neither are the times of a clock that was set back.
        """
        decoded, stamp = self._decoded, self.series.stamp
        decoded.values = decoded.values[:, : self.rows]
        t = self._t = self._t[: self.rows]
        decodes = decoded.finish()
        values = decoded.values[: len(self.leaves)]
        if self._source == "header" and stamp:
            places = [decoded.numbers.index(steps) for steps in stamp.places]
            own_stamps, has_stamp = stamp.times(decoded.values[places])
            # a clock that counts from zero may be at zero, and so is the log's then
            has_stamp |= (t == 0) & (decoded.values[places] == 0.0).all(axis=0)
            t = np.where(has_stamp, own_stamps, t)
            values[:, ~has_stamp] = np.nan
            decoded.note(DecodingFault("mcap-no-stamp"), np.flatnonzero(decodes & ~has_stamp))
        findings = []
        for fault, faulty in sorted(decoded.faults.items()):
            rows = np.array(faulty)
            if fault.code != "mcap-bad-message":
                rows = rows[decodes[rows]]
            findings += [self._finding(fault, rows)] if len(rows) else []
        if self._source != "header" and (finding := self._sort(t, values)):
            findings.insert(0, finding)
        columns = [self._column(*pair, t) for pair in zip(self.leaves, values, strict=True)]
        return columns, findings

    def _sort(self, t: Times, values: Floats) -> Finding | None:
        """Sorts the messages by their times, in place; None where they are in order."""
        if not (t[1:] < t[:-1]).any():
            return None
        order = np.argsort(t, kind="stable")
        run = np.append(0, np.cumsum(np.diff(t) < 0, dtype=np.int32))
        if np.count_nonzero(np.diff(run[order])) > _MOST_TURNS * run[-1]:
            return None
        newest = np.maximum.accumulate(t)
        late_rows = np.flatnonzero(t < newest)
        numbers, names = {"most_s": float((newest - t).max()) / 1e9}, {"clock": self._source}
        finding = self.series.finding("mcap-unordered", "warning", len(late_rows), numbers, **names)
        finding = replace(finding, spans=self._spans(late_rows, t))
        for array in (t, *values):
            array[:] = array[order]  # in place, to save memory
        return finding

    def _finding(self, fault: DecodingFault, rows: Offsets) -> Finding:
        first_block = bisect([row for row, _ in self._blocks], rows[0]) - 1
        names = {k: v for k, v in (("field", fault.field), ("reason", fault.reason)) if v}
        numbers = {"byte": self._blocks[first_block][1]}
        severity = _SEVERITY[fault.code]
        finding = self.series.finding(fault.code, severity, len(rows), numbers, **names)
        return replace(finding, spans=self._spans(np.unique(rows), self._t))

    def _spans(self, rows: Offsets, t: Times) -> tuple[Span, ...]:
        """Time spans of messages, one of each run of them."""
        cuts = np.flatnonzero(np.diff(rows) > 1)
        begins, stops = t[rows[np.append(0, cuts + 1)]], t[rows[np.append(cuts, -1)]]
        return spans_of(np.minimum(begins, stops), np.maximum(begins, stops), self._log_start)

    def _column(self, leaf: Leaf, value: Floats, t: Times) -> Column:
        """One column; the numbers of an enum count its names."""
        words = tuple(self._decoded.words.get(leaf.steps, leaf.words))
        if leaf.numbers:
            is_number = value[:, None] == np.array(leaf.numbers)
            value = np.where(is_number.any(axis=1), is_number.argmax(axis=1), np.nan)
        return Column(t, value, np.isfinite(value), words)
