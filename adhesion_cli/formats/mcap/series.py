"""What each topic of a log carries: its channels, its decoder, and the numbers in its messages."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice, pairwise
from typing import Any

from mcap.records import Schema

from ...core.finding import Finding, Severity
from ..source import MOST_WORDS, distinct_words
from . import fields
from .columns import Decoder
from .fields import Leaf, Stamp, Steps, Tree, UndecodableError, node_at, path
from .walk import Walk

_NEED_SCHEMA = ("protobuf", "cdr")  # encodings


@dataclass(slots=True)
class Series:
    """What one topic carries: channels of one schema and the same units."""

    topic: str
    encoding: str
    schema: Schema | None
    metadata: dict[str, str]
    schema_id: int = 0
    ids: list[int] = field(default_factory=list)  # of the channels
    rows: int = 0
    group: str = ""
    heads: list[bytes] = field(default_factory=list)  # first messages
    head_time: int = 0  # log time of the first
    decoder: Decoder | None = None
    tree: Tree = None  # what the first messages hold
    fields: dict[str, Leaf] = field(default_factory=dict)  # of numbers, by path
    texts: dict[str, Leaf] = field(default_factory=dict)  # of words, by path
    stamp: Stamp | None = None
    stamp_time: int = 0  # of the first message, 0 where it has none
    owner: Tree = None  # whose messages of the topic these are, where several come in turn
    owners: tuple[Tree, ...] = ()  # all of them
    owner_at: Steps = ()  # where a message names its owner
    stamps_repeat: bool = False  # among the first messages, as those of a date or of whole seconds

    def finding(self, code: str, severity: Severity, count: int = 0, **names: str) -> Finding:
        """A finding about this topic; without a count all its messages."""
        return Finding(code, severity, self.topic, count or self.rows, names=names)


def grouped(walk: Walk) -> list[Series]:
    """The channels of a log, as series; the first messages go from the walk to them."""
    by_key: dict[tuple[Any, ...], Series] = {}
    for channel in walk.channels.values():
        schema = walk.schemas.get(channel.schema_id)
        key = (
            channel.topic,
            channel.message_encoding,
            (schema.name, schema.encoding, schema.data) if schema else channel.schema_id,
            tuple(sorted(pair for pair in channel.metadata.items() if fields.states_unit(pair[0]))),
        )
        new_series = Series(channel.topic, channel.message_encoding, schema, channel.metadata)
        series = by_key.setdefault(key, new_series)
        series.schema_id = channel.schema_id
        series.ids.append(channel.id)
        series.rows += walk.counts[channel.id]
        time, heads = walk.heads.pop(channel.id, (0, []))
        if not series.heads:
            series.head_time, series.heads = time, heads
        elif series.encoding == "json":
            series.heads = series.heads + heads
    topics = Counter(series.topic for series in by_key.values())
    for series in by_key.values():
        if topics[series.topic] > 1:
            series.group = f"channel {series.ids[0]}"
    return list(by_key.values())


_Decoders = dict[tuple[str, int], Decoder]  # by encoding and schema
Owners = dict[str, tuple[Steps, tuple[Tree, ...]]]  # by topic: where they are named, and who


def discover(series: list[Series], owners: Owners) -> Iterator[Finding]:
    """Finds the numbers in the first messages of all series that have messages.

    One whose messages have several owners becomes a series of each; `owners` gets the new ones.
    """
    decoders: _Decoders = {}
    discovered = list[Series]()
    for s in series:
        trees: list[Tree] = []
        if s.rows:
            yield from _look(s, trees, decoders)
        owned_series = _by_owner(s, trees, owners) if trees else []
        for part, its_trees in owned_series:
            part.tree = fields.typical(its_trees)
            assert part.decoder is not None
            yield from _offer(part, part.decoder, its_trees)
            _find_stamp(part, its_trees)
            part.heads = []
        discovered += [part for part, _ in owned_series] or [s]
    series[:] = discovered


def _by_owner(s: Series, trees: list[Tree], owners: Owners) -> list[tuple[Series, list[Tree]]]:
    """The series of each owner with its first messages; the series itself where it has none."""
    place, known_owners = owners.get(s.topic, (fields.owner_of(trees), ()))
    trees_of: dict[Tree, list[Tree]] = {owner: [] for owner in known_owners}
    for tree in trees if place else ():
        if fields.is_label(owner := node_at(tree, place)):
            trees_of.setdefault(owner, []).append(tree)
    if not 1 < len(trees_of) <= MOST_WORDS:
        return [(s, trees)]
    owners[s.topic] = place, tuple(trees_of)
    owned_series = []
    for owner, its_trees in trees_of.items():
        group = f"{s.group} {fields.label_of(place, owner)}".strip()
        series = replace(s, owner=owner, owners=tuple(trees_of), owner_at=place, group=group)
        owned_series += [(replace(series, fields={}, texts={}), its_trees)] if its_trees else []
    return owned_series


def _look(s: Series, trees: list[Tree], decoders: _Decoders) -> Iterator[Finding]:
    """Finds the decoder of a series, and adds its first messages that decode to the trees."""
    key = s.encoding, s.schema_id
    try:
        s.decoder = decoders.get(key) or _decoder(s)
        if s.decoder is None:
            kind = s.encoding + (f" with schema {s.schema.encoding}" if s.schema else "")
            yield s.finding("mcap-encoding", "info", encoding=kind)
            return
        decoders[key] = s.decoder
        reason = ""
        for head in s.heads:
            try:
                trees.append(s.decoder.tree(head))
            except UndecodableError as e:
                reason = reason or str(e)
        if not trees:
            raise UndecodableError(f"first messages: {reason}")
    except UndecodableError as e:
        yield s.finding("mcap-topic-unreadable", "error", reason=str(e))


def _decoder(s: Series) -> Decoder | None:
    schema = s.schema
    if s.encoding == "json":
        from .json_messages import JsonDecoder

        text = schema.data if schema and schema.encoding == "jsonschema" else b""
        return JsonDecoder(text)
    if schema is None and s.encoding in _NEED_SCHEMA:
        raise UndecodableError("the file does not define its schema")
    kind = s.encoding, schema.encoding if schema else ""
    if schema and kind == ("protobuf", "protobuf"):
        from .protobuf import ProtobufDecoder

        return ProtobufDecoder(schema.name, schema.data)
    if schema and kind == ("cdr", "ros2msg"):
        from .ros2 import Ros2Decoder

        return Ros2Decoder(schema.name, schema.data)
    return None


def _offer(s: Series, decoder: Decoder, trees: list[Tree]) -> Iterator[Finding]:
    search = fields.LeafSearch(s.tree, decoder.unit, s.metadata, s.owner_at)
    numbers, texts, skipped = search.leaves, search.texts, search.omitted
    for leaf in numbers:
        if s.fields.setdefault(leaf.path, leaf) is not leaf:
            skipped.append(f"a second {leaf.path}")
        if (names := decoder.names(leaf.steps)) and len(names) <= MOST_WORDS:
            s.texts[leaf.path] = replace(leaf, words=(*names.values(),), numbers=(*names,))
    for steps in texts:
        met = (node_at(tree, steps) for tree in trees)
        if words := distinct_words(text for text in met if isinstance(text, str) and text):
            s.texts.setdefault(path(steps), Leaf(steps, words=words))
    if s.encoding == "json":  # a schema that says text means text
        skipped += islice(fields.quoted_numbers(s.tree), fields.MAX_NUMBERS)
    head_count = len(s.heads)
    if not numbers and s.rows > head_count and (s.encoding == "json" or any(fields.empty(s.tree))):
        skipped.append(f"what follows {head_count} messages without a number")
    if skipped:
        examples = ", ".join(p[:80] for p in skipped[:3])
        yield s.finding("mcap-not-offered", "info", len(skipped), fields=examples)


def _find_stamp(s: Series, trees: list[Tree]) -> None:
    s.stamp = fields.stamp(s.tree, texts=s.encoding == "json")
    if s.stamp is None:
        return
    has_stamp = any(node_at(trees[0], steps) is not None for steps in s.stamp.places)
    s.stamp_time = s.stamp.first_time(trees[0] if has_stamp else s.tree)
    stamps = [s.stamp.first_time(tree) for tree in trees]
    s.stamps_repeat = 2 * sum(a == b for a, b in pairwise(stamps)) > len(stamps) - 1
