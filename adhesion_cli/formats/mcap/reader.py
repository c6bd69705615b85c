"""MCAP logs as a Source: which numbers their messages hold, by which clock, and columns of them."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...core.errors import UserError
from ...core.finding import Finding
from ...core.model import Column
from ..source import YEAR_1990, Field, ReadOptions, Source, TimeSource
from .collect import Collector, deal
from .fields import Leaf
from .series import Owners, Series, discover, grouped
from .walk import Walk

_DAY = 86_400 * 10**9


def open_mcap(path: Path, options: ReadOptions) -> "McapSource":
    """Opens an MCAP log: walks all records, checks them, and lists the numbers in its messages.

    Raises:
        UserError: where the file is no MCAP, nothing in it is whole, it has no messages, or it
            is damaged and options.strict is set; "FILE: byte N: what".
    """
    source = McapSource(Path(path), options)
    if not source.rows:
        channels = len(source.walk.channels)
        raise UserError(
            f"{path}: the log has no messages ({channels} channels are defined)",
            "check that the logger recorded anything",
        )
    return source


class McapSource(Source):
    """An MCAP log, opened.

    `content` has the bytes of the file, where they are in memory; `owners` those of messages that
    earlier parts of the log have.
    """

    format = "mcap"
    remedy = "read without --strict to leave these messages out"

    def __init__(
        self,
        path: Path,
        options: ReadOptions,
        content: bytes | None = None,
        owners: Owners | None = None,
    ) -> None:
        super().__init__(path, options)
        self.owners = owners or {}
        self.walk = walk = Walk(path, options, content)
        self.rows = walk.rows
        self.metadata, self.account = walk.metadata, walk.account()
        self.report(*self._of_walk())
        self._series = grouped(walk)
        self.report(*discover(self._series, options, self.owners))
        self.fields = [_field(s, p, leaf) for s in self._series for p, leaf in s.fields.items()]
        self.texts = [
            replace(_field(s, p, leaf), words=leaf.words)
            for s in self._series
            for p, leaf in s.texts.items()
        ]
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
                raise UserError(
                    f"{self.path}: no field {f.path!r} in {f.channel!r}",
                    "`adhesion inspect` lists the fields of a log",
                )
            leaves.setdefault((f.channel, f.group), {})[leaf] = None
        series = [by_topic[key] for key in leaves]
        if series:
            self._take_clock(series)
        for s in series:
            if self.clock == "header" and s.stamp is None:
                raise UserError(
                    f"{self.path}: {s.topic}: messages carry no stamp",
                    "state another clock, as --set channels.time.source=log (or publish)",
                )
        collectors = [
            Collector(by_topic[key], self.clock, list(chosen), self.walk.times[0])
            for key, chosen in leaves.items()
        ]
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
        for block, records in self.walk.reread():
            topic = topic_of[records.channel]
            order = np.argsort(topic, kind="stable")
            for rows in np.split(order, np.flatnonzero(np.diff(topic[order])) + 1):
                if len(rows) and topic[rows[0]] >= 0:
                    for collector, own in deal(topics[topic[rows[0]]], records.select(rows)):
                        collector.take(own, block.offset)


def _field(s: Series, place: str, leaf: Leaf) -> Field:
    unit = leaf.unit, leaf.unit_from
    return Field(s.topic, place, leaf.label, s.group, *unit, s.name, s.encoding)


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
