"""Logs that a library reads: columns on one or several time axes, as a Source.

A format gives a `Reader`. What is wrong with single samples it gives as masks. This module makes
columns and findings of them, the same way for every format.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..core import time_axis
from ..core.finding import Finding, Severity, catalogue
from ..core.masks import spans_of, spans_of_mask
from ..core.model import Bools, Column, Floats, Times
from ..core.text import distinct
from .source import YEAR_1990, Field, ReadOptions, Source, without_numbers

MOST_NS = 2**62  # times beyond are no times

# Names of properties that may scale numbers
_MAY_SCALE = re.compile(
    r"(?i)^(?!NI_)(?:.*[^a-z])?(scal(e|ing)|slope|gain|factor|sensitivity)(?![a-z])"
)

MASKS: Mapping[str, Severity] = {  # what a mask over samples says
    "value-missing": "info",
    "value-marked-invalid": "warning",
    "value-is-text": "warning",
}


@dataclass(slots=True)
class Contents:
    """What opening a log tells."""

    fields: list[Field]  # of numbers
    start_ns: int  # of the log since 1970; 0 where it states none
    time_reason: str
    rows: int
    reasons: dict[str, object] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    texts: list[Field] = field(default_factory=list)  # of words, which are numbered on
    events: list[tuple[Finding, Times]] = field(default_factory=list)  # findings, and when [ns]


class TableSamples(NamedTuple):
    """One series: times, values and masks over them, shape (n,)."""

    t: Times  # one array for all series of one time axis
    value: Floats
    masks: Mapping[str, Bools] = {}  # by a key of `MASKS`: samples that hold no number, and why
    words: tuple[str, ...] = ()  # that the values are numbers of, NaN for none


class Reader(Protocol):
    """A log that a library has opened. Any exception means that the file is damaged."""

    contents: Contents

    def read(self, wanted: Sequence[int]) -> tuple[list[TableSamples], list[Finding]]:
        """The fields of these numbers, those of words behind the others; and what was found.

        Times [ns] are absolute where the log has a start.
        """
        ...


class TableSource(Source):
    """A log that a `Reader` reads; `ask` gives what it reads of some places, of None `contents`."""

    def __init__(
        self, path: Path, kind: str, options: ReadOptions, ask: Callable[[Any], Any]
    ) -> None:
        contents: Contents = ask(None)
        if not contents.fields or not contents.rows:
            in_file = (f for f in contents.findings if catalogue()[f.code].section == "file")
            raise without_numbers(path, in_file)
        super().__init__(path, options)
        self.format, self._ask, self._events = kind, ask, contents.events
        self.absolute, self.time_reason = contents.start_ns >= YEAR_1990, contents.time_reason
        self.rows, self.reasons = contents.rows, contents.reasons
        self.fields, self.texts = contents.fields, contents.texts
        self._places = {f: i for i, f in enumerate([*contents.fields, *contents.texts])}
        self.report(*contents.findings)

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, see `Source`."""
        series, findings = self._ask([self._places[f] for f in wanted])
        axes = {id(x.t): x.t for x in series}
        start = min((time_axis.earliest(t) for t in axes.values() if len(t)), default=0)
        self.report(*findings)
        self.report(*(replace(f, spans=spans_of(t, t, start)) for f, t in self._events))
        columns = []
        for f, (t, value, masks, labels) in zip(wanted, series, strict=True):
            valid = np.isfinite(value) if f.words else np.ones(len(value), np.bool_)
            for code, mask in masks.items():
                valid &= ~mask
                if count := int(np.count_nonzero(mask)):
                    # what was never measured is no loss
                    severity = MASKS[code] if count < len(mask) else "info"
                    spans, values = spans_of_mask(mask, t, start), {"samples": len(mask)}
                    self.report(Finding(code, severity, f.name, count, spans, values))
            columns.append(Column(t, np.where(valid, np.float64(value), np.nan), valid, labels))
        return columns


def nanoseconds(seconds: Floats, start: int) -> tuple[Times, Bools]:
    """Times [ns] of seconds after the log's start [ns], and which of them hold; shape (n,).

    >>> nanoseconds(np.array([0.02, np.nan]), 1_000)
    (array([20001000,     1000]), array([ True, False]))
    """
    with np.errstate(over="ignore", invalid="ignore"):
        ticks = np.asarray(seconds, np.float64) * 1e9
        ok = np.abs(ticks) < MOST_NS - abs(start)
    return np.rint(np.where(ok, ticks, 0.0)).astype(np.int64) + start, ok


def open_scale(properties: Iterable[str]) -> str:
    """Why raw numbers with properties of these names are not known, "" where they may be."""
    name = next(filter(_MAY_SCALE.search, properties), "")
    return f"property {name!r} may scale its raw numbers" if name else ""


class NamedColumn(NamedTuple):
    """What a file says of one channel."""

    group: str  # with one time axis
    name: str
    unit: str  # "" if silent
    folder: str  # the group, distinct from others of its name


def fields(named: Sequence[NamedColumn], unit_from: str) -> list[Field]:
    """A field for each channel of numbers; with its group, if its name is not enough.

    >>> both = [NamedColumn(f"Axle {k}", "p", "bar", k) for k in "12"]
    >>> [(f.channel, f.group) for f in fields([*both, NamedColumn("Train", "v", "", "3")], "DBC")]
    [('p', 'Axle 1'), ('p', 'Axle 2'), ('v', '')]
    """
    groups: dict[str, set[str]] = {}  # by the names of their channels
    for column in named:
        groups.setdefault(column.name, set()).add(column.group)
    # Groups that share the name of a channel are the same for several devices.
    alike = set().union(*(x for x in groups.values() if len(x) > 1))
    labels = [x.group if x.group in alike else "" for x in named]
    titles = distinct([f"{group}\0{x.name}" for group, x in zip(labels, named, strict=True)])
    names = (title.split("\0", 1)[1] for title in titles)
    all_fields = []
    for x, group, name in zip(named, labels, names, strict=True):
        source = unit_from if x.unit else ""
        all_fields.append(Field(name, "", "", group, x.unit, source, folder=x.folder))
    return all_fields


def state_fields(
    named: dict[Any, NamedColumn], words: dict[Any, tuple[str, ...]], numbers: dict[Any, Field]
) -> list[Field]:
    """A field for each channel of words, those of its head; words may stand for the `numbers`."""
    texts = {place: x for place, x in named.items() if place not in numbers}
    by_place = {**numbers, **dict(zip(texts, fields([*texts.values()], ""), strict=True))}
    return [replace(by_place[place], words=x) for place, x in words.items()]
