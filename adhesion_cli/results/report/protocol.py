"""The protocol of a brake test: what is filled in, and the tables of a series."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ...core.summary import FindingSummary
from ...stops.series import StopSeries

# What a protocol states, by its part; what nobody stated is an empty line to fill in by hand.
FIELDS: Mapping[str, Sequence[str]] = {
    "Vehicle": (
        "vehicle", "configuration", "brake mode", "load", "wheel diameters", "friction pairing",
    ),
    "Track": ("line", "track", "gradient", "rail condition", "weather"),
    "Instruments": ("speed sensor", "pressure sensors", "recorder", "uncertainty"),
    "Test": ("date", "place", "tester", "approved by", "signature"),
}  # fmt: skip


class Protocol(NamedTuple):
    """A series as a page."""

    title: str
    texts: Mapping[str, str]  # of the fields, and of others that the plan states
    series: StopSeries
    findings: Sequence[tuple[str, FindingSummary]]  # after the name of the log, "" for one log
    about: Mapping[str, str]  # how it was made, by the name of the fact
    braked_weight: bool = False
    vehicle: Sequence[str] = ()  # the vehicle, or those of groups, in a line each


def headline(p: Protocol) -> tuple[str, str]:
    """The mark of the page, and how many stops and limits there are, in one line."""
    stops, limits = p.series.stops, p.series.limits
    valid = sum(s.stop.valid for s in stops)
    text = f"{valid} valid stop{'s' * (valid != 1)} of {len(stops)}."
    if not limits:
        return ("good" if valid == len(stops) else "slid"), text
    counts = {name: sum(x.verdict == name for x in limits) for name in _VERDICTS}
    listed = ", ".join(f"{n} {_VERDICTS[name]}" for name, n in counts.items() if n)
    mark = "slid" if counts["fail"] else "unknown" if counts["undecided"] else "good"
    return mark, f"{text} Limits: {listed}."


_VERDICTS = {"pass": "kept", "fail": "not kept", "undecided": "undecided"}


def parts(p: Protocol) -> list[tuple[str, list[tuple[str, str]]]]:
    """The fields of each part with their texts, empty where nobody stated them."""
    stated = {key.replace("_", " "): text for key, text in p.texts.items()}
    named = {field for fields in FIELDS.values() for field in fields}
    other_facts = [(key, text) for key, text in stated.items() if key not in named]
    filled = [
        (part, [(field, stated.get(field, "")) for field in fields])
        for part, fields in FIELDS.items()
    ]
    return [*filled, *([("Further", other_facts)] if other_facts else [])]
