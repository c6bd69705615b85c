"""The time that messages carry inside: seconds and nanoseconds, one number, or a text."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from ...core.model import Bools, Floats, Times
from .fields import Steps, Tree, is_number, node_at, stamp_keys

_PLACES: tuple[Steps, ...] = (
    ("header", "stamp"),
    ("header", "timestamp"),
    ("timestamp",),
    ("stamp",),
    ("time",),
    ("ts",),
)
_SECOND = 10**9
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_CALENDAR = (631_152_000 * 10**6, 4_102_444_800 * 10**6)  # 1990 to 2100 [us]
_UNITS = (1e6, 1e3, 1.0, 1e-3)  # microseconds in what clocks count: s, ms, us, ns


@dataclass(frozen=True, slots=True)
class Stamp:
    """Where messages keep their own time."""

    places: tuple[Steps, ...]  # of seconds and nanoseconds, or of one number or text
    unit: float = 0.0  # microseconds in the unit of one number
    text: bool = False  # ISO 8601, which decoders give as microseconds since 1970

    def times(self, values: Floats) -> tuple[Times, Bools]:
        """Stamps [ns] from values of shape (len(places), n), and which of them are stamps.

        One number is taken to the microsecond, which is what a double carries.
        """
        if len(self.places) == 2:
            seconds, nanos = values
            has_stamp = (np.abs(seconds) < 9e9) & (np.abs(nanos) < 4.3e9)  # not NaN, fits 64 bits
            has_stamp &= (seconds != 0) | (nanos != 0)
            stamp_seconds = np.where(has_stamp, seconds, 0).astype(np.int64) * _SECOND
            return stamp_seconds + np.where(has_stamp, nanos, 0).astype(np.int64), has_stamp
        micros = np.rint(values[0] * self.unit)
        has_stamp = (micros >= _CALENDAR[0]) & (micros < _CALENDAR[1])
        return np.where(has_stamp, micros, 0).astype(np.int64) * 1000, has_stamp

    def first_time(self, tree: Tree) -> int:
        """The stamp of one message [ns], 0 where it has none."""
        parts = [node_at(tree, steps) for steps in self.places]
        if self.text:
            parts = [microseconds(text) for text in parts]
        values = [[float(v)] if is_number(v) else [np.nan] for v in parts]
        return int(self.times(np.array(values))[0][0])


def microseconds(text: Tree) -> float:
    """Microseconds since 1970 of an ISO 8601 time with a date, UTC unless it states a zone.

    NaN for everything else.
    """
    if not isinstance(text, str) or text[10:11] not in ("T", " "):
        return float("nan")
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return float("nan")
    return float(((time if time.tzinfo else time.replace(tzinfo=UTC)) - _EPOCH) // _MICROSECOND)


def stamp(tree: Tree, texts: bool) -> Stamp | None:
    """Where a message keeps its own time: the first of the usual names that holds one.

    That is a pair of seconds and nanoseconds, or a number of s, ms, us or ns between 1990 and 2100;
    with `texts` an ISO 8601 text, too.
    """
    for steps in _PLACES:
        value = node_at(tree, steps)
        if keys := stamp_keys(value):
            return Stamp(((*steps, keys[0]), (*steps, keys[1])))
        if is_number(value):
            for unit in _UNITS:
                if _CALENDAR[0] <= value * unit < _CALENDAR[1]:
                    return Stamp((steps,), unit)
        elif texts and _CALENDAR[0] <= microseconds(value) < _CALENDAR[1]:
            return Stamp((steps,), 1.0, text=True)
    return None
