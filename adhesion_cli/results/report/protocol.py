"""The protocol of a brake test: what is filled in, and the tables of a series."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ...core.summary import FindingSummary
from ...stops.series import Group, GroupDifference, LimitVerdict, SeriesStop, WspSummary
from .. import stop_rows

# What a protocol states, by its part; what nobody stated is an empty line to fill in by hand.
FIELDS: Mapping[str, Sequence[str]] = {
    "Vehicle": (
        "vehicle", "configuration", "brake mode", "load", "wheel diameters", "friction pairing",
    ),
    "Track": ("line", "track", "gradient", "rail condition", "weather"),
    "Instruments": ("speed sensor", "pressure sensors", "recorder", "uncertainty"),
    "Test": ("date", "place", "tester", "approved by"),
}  # fmt: skip


class Protocol(NamedTuple):
    """A series as a page."""

    title: str
    texts: Mapping[str, str]  # of the fields, and of others that the plan states
    stops: Sequence[SeriesStop]
    groups: Sequence[Group]
    differences: Sequence[GroupDifference]
    limits: Sequence[LimitVerdict]
    wsp: Sequence[WspSummary]
    findings: Sequence[FindingSummary]
    about: Mapping[str, str]  # how it was made, by the name of the fact
    braked_weight: bool = False


def headline(p: Protocol) -> tuple[str, str]:
    """The mark of the page, and how many stops and limits there are, in one line."""
    valid = sum(s.stop.valid for s in p.stops)
    text = f"{valid} valid stops of {len(p.stops)}."
    if not p.limits:
        return ("good" if valid == len(p.stops) else "slid"), text
    counts = {name: sum(x.verdict == name for x in p.limits) for name in _VERDICTS}
    listed = ", ".join(f"{n} {_VERDICTS[name]}" for name, n in counts.items() if n)
    mark = "slid" if counts["fail"] else "unknown" if counts["undecided"] else "good"
    return mark, f"{text} Limits: {listed}."


_VERDICTS = {"pass": "kept", "fail": "not kept", "undecided": "undecided"}


def parts(p: Protocol) -> list[tuple[str, list[tuple[str, str]]]]:
    """The fields of each part with their texts, empty where nobody stated them."""
    stated = {key.replace("_", " "): text for key, text in p.texts.items()}
    named = {field for fields in FIELDS.values() for field in fields}
    further = [(key, text) for key, text in stated.items() if key not in named]
    filled = [
        (part, [(field, stated.get(field, "")) for field in fields])
        for part, fields in FIELDS.items()
    ]
    return [*filled, *([("Further", further)] if further else [])]


def tables(p: Protocol) -> list[tuple[str, list[dict[str, str]], int, str]]:
    """Title, rows, columns of text and note of each table; those with rows."""
    command = stop_rows.describe_sources([s.stop for s in p.stops])
    remarks = " ".join(stop_rows.remarks(p.stops))
    rows = stop_rows
    each = [
        ("Stops", rows.series_rows(p.stops), 2, f"{rows.NOTE} {command} {remarks}".strip()),
        ("Statistics", rows.group_rows(p.groups), 2, rows.OF_GROUPS),
        ("Differences", rows.difference_rows(p.differences), 3, ""),
        ("Limits", rows.limit_rows(p.limits), 3, rows.OF_LIMITS),
        *(("Wheel slide protection", rows.wsp_rows(x), 1, rows.describe_wsp(x)) for x in p.wsp),
    ]
    if p.braked_weight:
        each.append(("Braked weight", rows.braked_weight_rows(p.stops), 2, rows.OF_LAMBDA))
    each.append(("Uncertainty of the distance", rows.budget_rows(p.stops), 2, rows.OF_BUDGET))
    return [table for table in each if table[1]]
