"""MCAP logs as a Source: which numbers their messages hold, by which clock, and columns of them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core.errors import UserError
from ...core.finding import Finding, Severity
from ...core.masks import spans_of_mask
from ...core.model import Column, Floats, Times
from ..source import YEAR_1990, Field, ReadOptions, Source, TimeSource, number_words
from .columns import Decoded, DecodingFault
from .fields import Leaf
from .records import Offsets, Records
from .series import Owners, Series, discover, grouped
from .walk import Walk

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
    """The messages of a topic for each collector, by owner; the first gets those of others."""
    series = collectors[0].series
    if not series.owner_at:
        yield collectors[0], records
        return
    assert series.decoder is not None
    names = tuple(owner.strip() for owner in series.owners if isinstance(owner, str))
    leaf = Leaf(series.owner_at, words=names)
    owners = Decoded(series.decoder, series.tree, [leaf], None, len(records.start))
    owners.fill(0, records.data, records.start, records.stop)
    codes = number_words(owners.words.get(series.owner_at, []), ())
    number_of = {x: codes.get(x.strip(), -1) if isinstance(x, str) else x for x in series.owners}
    numbers = owners.values[0]
    for collector in collectors:
        is_of_owner = numbers == number_of[collector.series.owner]
        if collector.series.owner == series.owners[0]:
            is_of_owner |= ~np.isin(numbers, list(number_of.values()))
        yield collector, records.select(np.flatnonzero(is_of_owner))


class Collector:
    """The columns of one series."""

    def __init__(
        self, series: Series, source: TimeSource, leaves: list[Leaf], log_start: int
    ) -> None:
        self.series, self._source, self.leaves = series, source, leaves
        self._log_start = log_start
        self.rows = 0  # messages so far
        assert series.decoder is not None
        self._decoded = Decoded(series.decoder, series.tree, leaves, series.stamp, series.rows)
        self._t = np.empty(series.rows, np.int64)

    def take(self, records: Records) -> None:
        """Adds its messages of the next block."""
        rows = slice(self.rows, self.rows + len(records.start))
        self.rows = rows.stop
        if rows.stop > self.series.rows:
            return  # the caller reports too many rows
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
        spans = spans_of_mask(t < newest, t, self._log_start)
        latest = {"most_s": float((newest - t).max()) / 1e9}
        count, names = int(np.count_nonzero(t < newest)), {"clock": self._source}
        finding = self.series.finding("mcap-unordered", "warning", count, **names)
        finding = replace(finding, spans=spans, values=latest)
        for array in (t, *values):
            array[:] = array[order]  # in place, to save memory
        return finding

    def _finding(self, fault: DecodingFault, rows: Offsets) -> Finding:
        names = {k: v for k, v in (("field", fault.field), ("reason", fault.reason)) if v}
        finding = self.series.finding(fault.code, _SEVERITY[fault.code], len(rows), **names)
        spans = spans_of_mask(np.isin(np.arange(len(self._t)), rows), self._t, self._log_start)
        return replace(finding, spans=spans)

    def _column(self, leaf: Leaf, value: Floats, t: Times) -> Column:
        """One column; the numbers of an enum count its names."""
        enum_names = tuple(self._decoded.words.get(leaf.steps, leaf.words))
        if leaf.numbers:
            is_number = value[:, None] == np.array(leaf.numbers)
            value = np.where(is_number.any(axis=1), is_number.argmax(axis=1), np.nan)
        return Column(t, value, np.isfinite(value), enum_names)


_DAY = 86_400 * 10**9


def open_mcap(path: Path, options: ReadOptions) -> "McapSource":
    """Opens an MCAP log: walks all records, checks them, and lists the numbers in its messages.

    Raises:
        UserError: where the file is no MCAP, nothing in it is whole, it has no messages, or it
            is damaged and options.strict is set; "FILE: byte N: what".
    """
    source = McapSource(Path(path), options)
    if not source.rows:
        text = f"{path}: the log has no messages ({len(source.walk.channels)} channels are defined)"
        raise UserError(text, "check that the logger recorded anything")
    return source


class McapSource(Source):
    """An MCAP log, opened.

    `content` has the bytes of the file, where they are in memory; `owners` those of messages that
    earlier parts of the log have.
    """

    format = "mcap"
    remedy = "read without --strict to leave these messages out"

    def __init__(
        self, path: Path, options: ReadOptions, content: bytes = b"", owners: Owners | None = None
    ) -> None:
        super().__init__(path, options)
        self.owners = owners or {}
        self.walk = walk = Walk(path, options, content)
        self.rows = walk.rows
        self.metadata, self.account = walk.metadata, walk.account()
        self.report(*self._of_walk())
        self._series = grouped(walk)
        self.report(*discover(self._series, self.owners))
        self.fields = [_field(s, p, leaf) for s in self._series for p, leaf in s.fields.items()]
        texts = ((s, p, leaf) for s in self._series for p, leaf in s.texts.items())
        self.texts = [replace(_field(*text), words=text[2].words) for text in texts]
        self.reasons = {
            "profile": walk.profile,
            "library": walk.library,
            "chunks": sum(block.chunk for block in walk.blocks),
            "compression": ", ".join(sorted(walk.compressions)) or "none",
        }
        self._take_clock([s for s in self._series if s.fields])

    def _of_walk(self) -> Iterable[Finding]:
        walk = self.walk
        if walk.damage:
            example = walk.damage[0]
            values = {"byte": example.at, "kept_messages": self.rows}
            if walk.lost_count:
                values["lost_messages"] = walk.lost_count
            names, count = {"damage": example.what}, len(walk.damage)
            yield Finding("mcap-damaged", "error", count=count, values=values, names=names)
        if walk.stray:
            ids = sorted(set(walk.counts) - set(walk.channels))
            listed_ids = ", ".join(map(str, ids[:5])) + (", ..." if len(ids) > 5 else "")
            names = {"channels": listed_ids}
            yield Finding("mcap-unknown-channel", "error", count=walk.stray, names=names)
        if walk.previous:
            names = {"damage": walk.previous[:200]}
            yield Finding("mcap-recovered", "warning", count=1, names=names)

    # ------------------------------------------------------------------ time

    def _take_clock(self, series: Sequence[Series]) -> None:
        self.clock, self.time_reason, self.absolute = self._clock(series)
        self.reasons["time"] = self.time_reason

    def _clock(self, series: Sequence[Series]) -> tuple[TimeSource, str, bool]:
        """Which of a message's times is the time of its values, why, and whether since 1970."""
        first_time, last_time = self.walk.times
        calendar = first_time >= YEAR_1990
        requested = self.options.time_source
        stamps = [s.stamp_time for s in series if s.stamp_time]
        if requested == "header":
            since_1970 = bool(stamps) and min(stamps) >= YEAR_1990
            return "header", "stamp inside the messages, as asked for", since_1970
        if requested is not None:
            return requested, f"{requested} time, as asked for", calendar
        if obstacle := _without_stamps(series):
            return "log", f"log time: {obstacle}", calendar
        is_constant = first_time == last_time and self.rows > len(series)
        largest_offset = max(abs(s.stamp_time - s.head_time) for s in series)
        if is_constant and min(stamps) >= YEAR_1990:
            return "header", "stamp inside the messages: the log time stands still", True
        if largest_offset > _DAY:
            seconds = f"{largest_offset / 1e9:.0f} s"
            reason = f"log time: stamps inside the messages are {seconds} away from it"
            return "log", reason, calendar
        reason = f"stamp inside the messages, at first {largest_offset / 1e9:.6f} s from log time"
        return "header", reason, calendar

    # ------------------------------------------------------------------ columns

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, see Source."""
        by_topic = {(s.topic, s.group): s for s in self._series}
        leaves: dict[tuple[str, str], dict[Leaf, None]] = {}  # in order, each once
        for f in wanted:
            s = by_topic.get((f.channel, f.group))
            leaf = (s.texts if f.words else s.fields).get(f.path) if s else None
            if leaf is None:
                hint = "`adhesion inspect` lists the fields of a log"
                raise UserError(f"{self.path}: no field {f.path!r} in {f.channel!r}", hint)
            leaves.setdefault((f.channel, f.group), {})[leaf] = None
        series = [by_topic[key] for key in leaves]
        if series:
            self._take_clock(series)
        for s in series:
            if self.clock == "header" and s.stamp is None:
                hint = "state another clock, as --set channels.time.source=log (or publish)"
                raise UserError(f"{self.path}: {s.topic}: messages carry no stamp", hint)
        start, pairs = self.walk.times[0], ((by_topic[key], [*x]) for key, x in leaves.items())
        collectors = [Collector(s, self.clock, chosen, start) for s, chosen in pairs]
        self._collect(collectors)
        by_field: dict[tuple[str, str, str, bool], Column] = {}
        for collector in collectors:
            if collector.rows != collector.series.rows and not collector.series.owner_at:
                raise self.walk.changed()
            topic, group = collector.series.topic, collector.series.group
            columns, findings = collector.finish()
            for leaf, column in zip(collector.leaves, columns, strict=True):
                by_field[topic, group, leaf.path, bool(leaf.words)] = column
            self.report(*findings)
        return [by_field[f.channel, f.group, f.path, bool(f.words)] for f in wanted]

    def _collect(self, collectors: Sequence[Collector]) -> None:
        """Hands each the messages of its channels; the cost of a block does not grow with them."""
        topics: dict[int, list[Collector]] = {}  # by their first channel
        topic_of = np.full(1 << 16, -1)  # by channel
        for collector in collectors:
            topics.setdefault(collector.series.ids[0], []).append(collector)
            topic_of[collector.series.ids] = collector.series.ids[0]
        for records in self.walk.reread():
            topic = topic_of[records.channel]
            order = np.argsort(topic, kind="stable")
            for rows in np.split(order, np.flatnonzero(np.diff(topic[order])) + 1):
                if len(rows) and topic[rows[0]] >= 0:
                    for collector, batch in deal(topics[topic[rows[0]]], records.select(rows)):
                        collector.take(batch)


def _field(s: Series, place: str, leaf: Leaf) -> Field:
    return Field(
        channel=s.topic,
        path=place,
        label=leaf.label,
        group=s.group,
        unit=leaf.unit,
        unit_from=leaf.unit_from,
        message_type=s.schema.name if s.schema else "",
        encoding=s.encoding,
    )


def _without_stamps(series: Sequence[Series]) -> str:
    """Why stamps inside the messages cannot be the clock of these series, "" if they can."""
    if not any(s.stamp for s in series):
        return "no message has a stamp inside"
    for s in series:
        if s.stamp is None:
            return f"{s.topic} has no stamps inside"
    for s in series:
        if not s.stamp_time:
            return f"the stamp inside the first message of {s.topic} is 0 or not set"
        if s.stamps_repeat:
            return f"the stamps inside the first messages of {s.topic} repeat"
    return ""
