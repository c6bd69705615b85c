"""A finding: one thing about the data that the user must be able to know.

A finding is data: a code, where it is, and the numbers that belong to it. Its words stand once, in
the catalogue `findings.toml`; terminal, JSON, `adhesion explain` and the docs all read them there.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

# In a remedy: what it would have pasted, with fields of the finding; and on which condition.
_OPTION = re.compile(r"`[^`]*--set[^`]*(?<!\{)\{\w[^`]*`|\{option\}")
_CONDITION = re.compile(r"(?:If|Only|For)[^,]*,")
Severity = Literal["info", "warning", "error"]
Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """What the catalogue says of a code."""

    code: str
    section: str  # where the documentation lists it
    title: str
    message: str  # template of one line; its fields are the finding's values and names
    cause: str
    effect: str  # on the result
    remedy: str  # a template, too
    limits: str = ""  # what the check cannot see
    keeps_data: bool = False  # whether a warning of it is about settings, and no data is lost


@cache
def catalogue() -> dict[str, CatalogueEntry]:
    """Every code with its words, in the order of the file."""
    text = Path(__file__).with_name("findings.toml").read_text("utf-8")
    return {code: CatalogueEntry(code, **entry) for code, entry in tomllib.loads(text).items()}


class _NotStated:
    """A field that a finding lacks: the rest of the sentence is shown all the same."""

    def __format__(self, _: str) -> str:
        return "…"


class _Fields(dict[str, Any]):
    def __missing__(self, _: str) -> _NotStated:
        return _NotStated()


def is_lossy(code: str, severity: str) -> bool:
    """Whether a finding sets exit code 3; a code that the catalogue does not know counts."""
    entry = catalogue().get(code)
    return severity != "info" and not (entry and entry.keeps_data)


def is_doubt(code: str, severity: str) -> bool:
    """Whether a finding says that the log contradicts its vehicle."""
    return severity != "info" and code in ("vehicle-in-doubt", "vehicle-suspect")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing about the data that the user must be able to know.

    `warning` and `error` mean that data was dropped, repaired or refused, or that a result cannot
    be trusted. See `lossy` for the exit code.
    """

    code: str  # stable, kebab-case, an entry of the catalogue
    severity: Severity
    channel: str = ""
    count: int = 1
    spans: tuple[Span, ...] = ()  # from and to, seconds after the log's start
    values: Mapping[str, float] = field(default_factory=dict)  # the name ends with the unit
    names: Mapping[str, str] = field(default_factory=dict)  # texts: a column, a unit

    def overlaps(self, start: float, stop: float) -> bool:
        """Whether it holds at any time between two [s]; one that has no time holds always."""
        return not self.spans or any(a < stop and start < b for a, b in self.spans)

    def __hash__(self) -> int:
        return hash((self.code, self.severity, self.channel, self.count, self.spans))

    @property
    def lossy(self) -> bool:
        """Whether it sets exit code 3: data was dropped, repaired or refused, or may be wrong."""
        return is_lossy(self.code, self.severity)

    @property
    def first_s(self) -> float | None:
        """Seconds after the log's start; None where it has no time."""
        return self.spans[0][0] if self.spans else None

    @property
    def message(self) -> str:
        """One line that says what is wrong."""
        return catalogue()[self.code].message.format_map(self._fields())

    @property
    def hint(self) -> str | None:
        """What to do, None where nothing need be done."""
        return catalogue()[self.code].remedy.format_map(self._fields()) or None

    @property
    def option(self) -> str:
        """What the remedy would have pasted, with its condition; "" where that is not all known."""
        for sentence in re.split(r"(?<=\.) (?=[A-Z])", catalogue()[self.code].remedy):
            template, condition = _OPTION.search(sentence), _CONDITION.match(sentence)
            fields = self._fields()
            if template and {*re.findall(r"(?<!\{)\{(\w+)", template[0])} <= fields.keys():
                text = template[0].format_map(fields)
                if "=NAME" not in text:
                    return f"{condition[0]} {text}" if condition else text.strip("`")
        return ""

    def _fields(self) -> "_Fields":
        speeds = {k: v for k, v in self.values.items() if k.endswith("_mps")}
        in_kmh = {k.replace("_mps", "_kmh"): 3.6 * v for k, v in speeds.items()}
        return _Fields({**self.values, **in_kmh, **self.names})


def merge_spans(spans: Sequence[Span], limit: int = 20) -> tuple[Span, ...]:
    """The spans [s] in the order of time, the nearest joined until at most `limit` are left."""
    merged: list[Span] = []
    for start, stop in sorted(spans):
        if merged and start <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(merged[-1][1], stop)
        else:
            merged.append((start, stop))
    if len(merged) <= limit:
        return tuple(merged)
    gaps = [(b[0] - a[1], i) for i, (a, b) in enumerate(pairwise(merged), 1)]
    edges = [0, *sorted(i for _, i in sorted(gaps, reverse=True)[: limit - 1]), len(merged)]
    return tuple((merged[i][0], merged[j - 1][1]) for i, j in pairwise(edges))
