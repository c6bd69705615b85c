"""MCAP logs: which numbers their messages hold, by which clock, and columns of them."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mcap.records import Schema

from ...core.errors import UserError
from ...core.finding import Finding, Severity, Span, merged
from ...core.model import Column, Floats, Reject, Times
from ..source import Field, ReadOptions
from .columns import Decoder, Fault, Wanted
from .fields import (
    MOST_LEAVES,
    Leaf,
    Tree,
    UndecodableError,
    at,
    empty,
    leaves,
    number_texts,
    states_unit,
    typical,
)
from .messages import Offsets, Records
from .stamps import Stamp, stamp
from .walk import Walk

_YEAR_1990 = 631_152_000 * 10**9  # earlier stamps count from a start of their own
_DAY = 86_400 * 10**9
_SECOND = 10**9
# From one run of rising times to another in the order of time, per fall of the time in the file.
# Late messages and exchanged chunks give about two; a clock set back makes two stretches of the
# log lie over each other, which to sort would be to mix.
_MOST_TURNS = 16
_FEW = 4  # first messages of a channel with a schema that are looked into; further ones ...
_SPARE = 4096  # ... where an array is empty in all of them, so many in all channels
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


@dataclass(slots=True)
class _Series:
    """What one topic carries: channels of one schema."""

    topic: str
    encoding: str
    schema: Schema | None
    metadata: dict[str, str]
    ids: list[int] = field(default_factory=list)
    rows: int = 0
    group: str = ""
    heads: list[bytes] = field(default_factory=list)
    head_time: int = 0
    decoder: Decoder | None = None
    tree: Tree = None
    leaves: dict[str, Leaf] = field(default_factory=dict)
    stamp: Stamp | None = None
    stamp_time: int = 0  # of the first message, 0 where it has none
    stamps_repeat: bool = False  # among the first messages, as those of a date or of whole seconds

    @property
    def name(self) -> str:
        return self.schema.name if self.schema else ""

    def finding(self, code: str, severity: Severity, count: int = 0, **names: str) -> Finding:
        """A finding about this topic; without a count all its messages."""
        return Finding(code, severity, channel=self.topic, count=count or self.rows, names=names)


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


class McapSource:
    """An MCAP log, see Source."""

    format = "mcap"
    rejects: Iterable[Reject] = ()

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        self.walk = Walk(path, options)
        self.rows = self.walk.rows
        self.metadata, self.account = self.walk.metadata, self.walk.account()
        self.findings: list[Finding] = []
        self._reported: set[Finding] = set()
        self._decoders: dict[int, Decoder] = {}  # by schema id
        self._report_walk()
        self._series = self._group()
        self._discover()
        self.fields: Sequence[Field] = [
            Field(s.topic, p, leaf.label, s.group, leaf.unit, leaf.unit_from, s.name, s.encoding)
            for s in self._series
            for p, leaf in s.leaves.items()
        ]
        self.stated: dict[str, Any] = {
            "profile": self.walk.profile,
            "library": self.walk.library,
            "chunks": self.walk.chunks,
            "compression": ", ".join(sorted(self.walk.compressions)) or "none",
            "attachments": len(self.walk.attachments),
        }
        self._take_clock([s for s in self._series if s.leaves])

    # ------------------------------------------------------------------ what is in it

    def _report_walk(self) -> None:
        walk, losses = self.walk, self.walk.losses
        if walk.damage:
            first = walk.damage[0]
            values = {"byte": first.at, "kept_messages": self.rows}
            if losses.lost:
                values["lost_messages"] = losses.lost
            found = Finding("mcap-damaged", "error", count=len(walk.damage), values=values,
                            names={"damage": first.what})  # fmt: skip
            self._report(found)
        if lost := {i: n for i, n in walk.counts.items() if i not in walk.channels}:
            some = ", ".join(map(str, sorted(lost)[:5])) + (", ..." if len(lost) > 5 else "")
            found = Finding("mcap-unknown-channel", "error", count=sum(lost.values()),
                            names={"channels": some})  # fmt: skip
            self._report(found)
        if losses.unchecked:
            self._report(Finding("mcap-unchecked", "info", count=losses.unchecked))
        if damage := losses.past.get("damage"):
            severity: Severity = "warning" if losses.suspect else "info"
            count, names = losses.suspect or 1, {"damage": damage[:200]}
            self._report(Finding("mcap-recovered", severity, count=count, names=names))
        if walk.unknown:
            self._report(Finding("mcap-unknown-record", "info", count=walk.unknown))

    def _report(self, finding: Finding) -> None:
        """Adds a finding that is not there yet; with strict an error ends the reading."""
        if self._options.strict and finding.severity == "error":
            where = f" {finding.channel}:" if finding.channel else ""
            text = f"{self.path}:{where} {finding.message}"
            raise UserError(text, "read without --strict to leave these messages out")
        if finding not in self._reported:
            self._reported.add(finding)
            self.findings.append(finding)

    def _group(self) -> list[_Series]:
        """Channels that carry one topic with one schema and the same units are one series."""
        series: dict[tuple[Any, ...], _Series] = {}
        for channel in self.walk.channels.values():
            schema = self.walk.schemas.get(channel.schema_id)
            key = (
                channel.topic, channel.message_encoding,
                (schema.name, schema.encoding, schema.data) if schema else channel.schema_id,
                tuple(sorted(pair for pair in channel.metadata.items() if states_unit(pair[0]))),
            )  # fmt: skip
            one = series.setdefault(
                key, _Series(channel.topic, channel.message_encoding, schema, channel.metadata)
            )
            one.ids.append(channel.id)
            one.rows += self.walk.counts[channel.id]
            time, heads = self.walk.heads.get(channel.id, (0, []))
            if not one.heads:
                one.head_time, one.heads = time, heads
            elif one.encoding == "json":
                one.heads = one.heads + heads
            if channel.schema_id and schema is None and self.walk.counts[channel.id]:
                self._report(
                    Finding("mcap-unknown-schema", "error", channel=channel.topic,
                            values={"schema": channel.schema_id})
                )  # fmt: skip
        self.walk.heads.clear()
        topics = Counter(one.topic for one in series.values())
        for one in series.values():
            if topics[one.topic] > 1:
                one.group = f"channel {one.ids[0]}"
            if len(one.ids) > 1:
                values = {"channels": len(one.ids)}
                self._report(Finding("mcap-shared-topic", "info", channel=one.topic, values=values))
        return list(series.values())

    def _discover(self) -> None:  # noqa: C901, PLR0912, PLR0915
        """Finds the numbers in each series' first messages."""
        total, more, spare = 0, list[str](), _SPARE
        for s in self._series:
            if not s.rows:
                continue
            if total >= self._options.max_series:
                more.append(s.topic)
                continue
            try:
                s.decoder = self._decoder(s)
            except UndecodableError as e:
                self._report(s.finding("mcap-topic-unreadable", "error", reason=str(e)))
                continue
            if s.decoder is None:
                kind = s.encoding + (f" with schema {s.schema.encoding}" if s.schema else "")
                self._report(s.finding("mcap-encoding", "info", encoding=kind))
                continue
            schema = s.encoding != "json"
            why = "" if s.heads else "first message is too large"
            trees: list[Tree] = []
            lacks, sizes, seen = True, set[int](), 0
            for seen, head in enumerate(s.heads, 1):
                if schema and len(trees) >= _FEW:
                    if not (lacks and spare):
                        seen -= 1
                        break
                    if len(head) in sizes:
                        continue  # with more in it, it were longer
                    spare -= 1
                sizes.add(len(head))
                try:
                    trees.append(s.decoder.tree(head))
                    lacks = lacks and any(empty(trees[-1]))
                except UndecodableError as e:
                    why = why or str(e)
            s.heads = []
            if not trees:
                self._report(s.finding("mcap-topic-unreadable", "error", reason=why))
                continue
            s.tree = typical(trees)
            found, left_out = leaves(s.tree, s.decoder.unit, s.metadata)
            for leaf in found:
                if s.leaves.setdefault(leaf.path, leaf) is not leaf:
                    left_out.append(f"a second {leaf.path}")
            total += len(s.leaves)
            if not found and s.rows > seen and not (schema and not any(empty(s.tree))):
                left_out.append(f"what messages hold behind {seen} without a number")
            if left_out:
                some = ", ".join(p[:80] for p in left_out[:3])
                self._report(s.finding("mcap-not-offered", "info", len(left_out), fields=some))
            # Where a schema says text, text it is.
            if not schema and (texts := list(islice(number_texts(s.tree), MOST_LEAVES))):
                some = ", ".join(texts[:3])[:200]
                severity: Severity = "info" if s.leaves else "warning"
                self._report(s.finding("mcap-number-text", severity, len(texts), fields=some))
            if (of := stamp(s.tree, texts=s.encoding == "json")) is not None:
                has = any(at(trees[0], steps) is not None for steps in of.places)
                s.stamp_time = of.first(trees[0] if has else s.tree)
                stamps = [of.first(tree) for tree in trees]
                # Protobuf shows what is absent: a 0 that is there is where some count starts.
                s.stamp = replace(of, zero=s.encoding == "protobuf" and max(stamps) < _YEAR_1990)
                repeats = sum(a == b for a, b in pairwise(stamps))
                s.stamps_repeat = 2 * repeats > len(stamps) - 1

        if more:
            values = {"series": total, "needed": total + len(more)}
            self._report(
                Finding(
                    "mcap-series-limit", "warning", channel=more[0], count=len(more), values=values
                )
            )

    def _decoder(self, s: _Series) -> Decoder | None:
        schema = s.schema
        if s.encoding == "json":
            from .json_messages import JsonDecoder

            text = schema.data if schema and schema.encoding == "jsonschema" else b""
            return JsonDecoder(text, self._options.max_part)
        if schema is None:
            return None
        kind = s.encoding, schema.encoding
        if kind not in (("protobuf", "protobuf"), ("cdr", "ros2msg")):
            return None
        if schema.id not in self._decoders:
            if kind[0] == "protobuf":
                from .protobuf import ProtobufDecoder

                self._decoders[schema.id] = ProtobufDecoder(schema.name, schema.data)
            else:
                from .ros2 import Ros2Decoder

                self._decoders[schema.id] = Ros2Decoder(schema.name, schema.data)
        return self._decoders[schema.id]

    # ------------------------------------------------------------------ time

    def _take_clock(self, of: Sequence[_Series]) -> None:
        """Decides on one clock for these series."""
        self._source, self.time_reason, self.absolute = self._clock(of)
        self.stated["time"] = self.time_reason

    def _clock(
        self, of: Sequence[_Series]
    ) -> tuple[Literal["log", "publish", "header"], str, bool]:
        """Which of a message's times is the time of its values, why, and whether since 1970."""
        first, last = self.walk.times
        calendar = first >= _YEAR_1990
        asked = self._options.time_source
        stamps = [s.stamp_time for s in of if s.stamp_time]
        if asked == "header":
            since_1970 = bool(stamps) and min(stamps) >= _YEAR_1990
            return "header", "stamp inside the messages, as asked for", since_1970
        if asked is not None:
            return asked, f"{asked} time, as asked for", calendar
        if why_not := self._without_stamps(of):
            return "log", f"log time: {why_not}", calendar
        stands_still = first == last and self.rows > len(of)
        apart = max(abs(s.stamp_time - s.head_time) for s in of)
        if stands_still and min(stamps) >= _YEAR_1990:
            return "header", "stamp inside the messages: the log time stands still", True
        if apart > _DAY:
            reason = f"log time: stamps inside the messages are {apart / 1e9:.0f} s away from it"
            return "log", reason, calendar
        reason = f"stamp inside the messages, at first {apart / 1e9:.6f} s from log time"
        return "header", reason, calendar

    def _without_stamps(self, of: Sequence[_Series]) -> str:
        """Why stamps inside the messages cannot be the clock of these series, "" if they can."""
        if not any(s.stamp for s in of):
            return "no message carries a stamp of its own"
        for s in of:
            if s.stamp is None:
                return f"{s.topic} carries no stamp of its own"
        for s in of:
            if not s.stamp_time:
                return f"the stamp inside the first message of {s.topic} is 0 or not set"
            if s.stamps_repeat:
                return f"the stamps inside the first messages of {s.topic} repeat"
        return ""

    # ------------------------------------------------------------------ columns

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, see Source."""
        takers: dict[int, _Taker] = {}
        series = {(s.topic, s.group): s for s in self._series}
        for f in wanted:
            s = series.get((f.channel, f.group))
            if s is None or f.path not in s.leaves:
                raise UserError(
                    f"{self.path}: no field {f.path!r} in {f.channel!r}",
                    "`adhesion inspect` lists the fields of a log",
                )
            taker = takers.setdefault(id(s), _Taker(s))
            if f.path not in taker.paths:
                taker.paths.append(f.path)
        if takers:
            self._take_clock([taker.series for taker in takers.values()])
            self._report_unused_stamps([taker.series for taker in takers.values()])
        for taker in takers.values():
            if self._source == "header" and taker.series.stamp is None:
                raise UserError(
                    f"{self.path}: {taker.series.topic}: messages carry no stamp",
                    "state another time source, log or publish",
                )
            taker.prepare(self._source)
        self._take(list(takers.values()))
        by_field: dict[tuple[str, str, str], Column] = {}
        for taker in takers.values():
            if taker.rows != taker.series.rows:
                raise self.walk.changed()
            for p, column in zip(taker.paths, taker.columns(), strict=True):
                by_field[taker.series.topic, taker.series.group, p] = column
            self._report_columns(taker)
        return [by_field[f.channel, f.group, f.path] for f in wanted]

    def _take(self, takers: list["_Taker"]) -> None:
        """Hands each the messages of its channels; the cost of a block does not grow with them."""
        whose = np.full(1 << 16, -1, np.int32)  # by channel id
        for k, taker in enumerate(takers):
            whose[taker.series.ids] = k
        for block, records in self.walk.again():
            of = whose[records.channel]
            rows = np.flatnonzero(of >= 0)
            of = of[rows].astype(np.uint16)  # which numpy sorts in linear time
            rows = rows[np.argsort(of, kind="stable")]
            counts = np.bincount(of)
            ends = np.cumsum(counts)
            for k in np.flatnonzero(counts).tolist():
                mine = rows[ends[k] - counts[k] : ends[k]]
                takers[k].take(records.some(mine), block.at)

    def _report_unused_stamps(self, of: Sequence[_Series]) -> None:
        # In a result of ours the stamp is the log time; where a log begins at 0 it is not set.
        stamped = [s.topic for s in of if s.stamp and not s.name.startswith("adhesion.")]
        why_not = self._without_stamps(of)
        if stamped and why_not and self._options.time_source is None:
            self._report(
                Finding("mcap-stamp-unused", "info", channel=stamped[0], count=len(stamped),
                        names={"reason": why_not})
            )  # fmt: skip

    def _report_columns(self, taker: "_Taker") -> None:
        series, start = taker.series, self.walk.times[0]
        clock = {"clock": self._source}
        if late := taker.late:
            values = {"most_s": taker.most_late / 1e9}
            found = series.finding("mcap-unordered", "warning", late.count, **clock)
            self._report(replace(found, spans=late.spans(start), values=values))
        for (code, place, reason), one in sorted(taker.found.items()):
            names = {k: v for k, v in (("field", place), ("reason", reason)) if v}
            found = series.finding(code, _SEVERITY[code], one.count, **names)
            self._report(replace(found, spans=one.spans(start), values={"byte": one.at}))
        low, high = taker.ahead
        if low <= high and (max(-low, high) > _SECOND or high - low > _SECOND):
            values = {"low_s": low / 1e9, "high_s": high / 1e9}
            found = series.finding("mcap-stamp-offset", "info", 1, **clock)
            self._report(replace(found, values=values))


class _Found:
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


class _Taker:
    """Collects the columns of one series, block by block."""

    def __init__(self, series: _Series) -> None:
        self.series, self.paths = series, list[str]()
        self.rows = 0
        self.found: dict[tuple[str, str, str], _Found] = {}  # by code, field and reason
        self.ahead = (1 << 62, -(1 << 62))  # lowest and highest of stamp minus log time [ns]
        self.late: _Found | None = None  # messages that stand after later ones
        self.most_late = 0  # [ns]

    def prepare(self, source: Literal["log", "publish", "header"]) -> None:
        s = self.series
        self._source = source
        self._wanted = Wanted.of(s.tree, [s.leaves[p] for p in self.paths], s.stamp)
        places = list(self._wanted.leaves)
        self._stamp_at = [places.index(steps) for steps in s.stamp.places] if s.stamp else []
        self._t: Times = np.empty(s.rows, np.int64)
        self._values: Floats = np.empty((len(self.paths), s.rows))
        self._newest = np.int64(-(1 << 63))

    def take(self, records: Records, at: int) -> None:
        """Adds its messages of the block at an offset of the file."""
        n = len(records.start)
        if self.rows + n > self.series.rows:
            self.rows += n  # of too many rows the caller tells
            return
        log = records.log_time
        decoder = self.series.decoder
        assert decoder is not None
        with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
            data, begin, end = records.data, records.data_start, records.end
            values, faults = decoder.columns(data, begin, end, self._wanted)
        here = slice(self.rows, self.rows + n)
        self.rows += n
        self._values[:, here] = values[: len(self.paths)]
        t = records.publish_time if self._source == "publish" else log
        if stamp := self.series.stamp:
            own, known = stamp.times(values[self._stamp_at])
            if known.any():
                ahead = (own - log)[known]
                self.ahead = (
                    min(self.ahead[0], int(ahead.min())),
                    max(self.ahead[1], int(ahead.max())),
                )
            if self._source == "header":
                t = np.where(known, own, log)
                if not known.all():
                    self._values[:, here][:, ~known] = np.nan
                    bad = [f.rows for f in faults if f.code == "mcap-bad-message"]
                    rows = np.flatnonzero(~known)
                    if len(rows := np.setdiff1d(rows, np.concatenate(bad)) if bad else rows):
                        faults.append(Fault("mcap-no-stamp", rows))
        self._t[here] = t
        if self._source != "header":
            self._note_late(t, here.start, at)
        for fault in faults:
            key = fault.code, fault.field, fault.reason
            if len(self.found) >= _MOST_REPORTED and key not in self.found:
                key = fault.code, fault.field and "further fields", fault.reason and "other reasons"
            rows = fault.rows
            self.found.setdefault(key, _Found(at)).add(here.start + rows, log[rows])

    def _note_late(self, t: Times, row: int, at: int) -> None:
        newest = np.maximum.accumulate(np.maximum(t, self._newest))
        self._newest = newest[-1]
        if len(late := np.flatnonzero(t < newest)):
            self.late = self.late or _Found(at)
            self.late.add(row + late, t[late])
            self.most_late = max(self.most_late, int((newest - t).max()))

    def columns(self) -> list[Column]:
        """One column per path, all with the same time array.

        Messages may stand in any order in the file: their log or publish time is what orders
        them. Stamps inside them are the sender's, whose order is left to be judged, and so is
        that of a clock that was set back.
        """
        if self.late:
            order = np.argsort(self._t, kind="stable")
            run = np.append(0, np.cumsum(np.diff(self._t) < 0, dtype=np.int32))
            if np.count_nonzero(np.diff(run[order])) <= _MOST_TURNS * run[-1]:
                for one in (self._t, *self._values):
                    one[:] = one[order]  # in place: beside all columns there is no room for them
            else:
                self.late = None
        return [Column(self._t, v, np.isfinite(v)) for v in self._values]
