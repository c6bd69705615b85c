"""Samples as objects in JSON, one a message: by standard input, a file, UDP or MQTT."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..core.annotated import Json
from ..core.errors import UserError
from ..core.finding import Finding
from ..formats.csv.header_words import GROUP, NS_PER_UNIT, is_named, time_name
from ..formats.source import Field, ReadOptions, Source
from .feed import PAUSE, AddSource, Feed, FeedRow, Pump

MOST_BYTES = 1 << 20  # of one message
_DEEPEST, _MOST_VALUES = 8, 1000
_MOST_FIELDS = 5000  # of a sender
_HEAD_MESSAGES = 200  # messages that show the fields
_EXAMPLE_CHARACTERS = 40  # characters of a message that is reported
_LARGE = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # numbers that count from 1970 in this unit


Values = tuple[int, dict[Field, float]]  # time [ns] and what was measured


class UnreadableError(Exception):
    """A message without samples; its text says why."""


class Fields(Source):
    """The fields of a sender; samples come later."""

    format, absolute, rows, time_reason = "live", True, 0, "stamps of the messages"

    def __init__(self, name: str, fields: Sequence[Field]) -> None:
        super().__init__(Path(name), ReadOptions())
        self.fields = list(fields)


class Messages(Feed):
    """Messages of a sender, each an object in JSON with names and numbers.

    A name of time gives the stamp: a number, or a date in ISO 8601. Without one the time of arrival
    is the stamp. A name of an axle or device, as `axle`, says whose values they are. `arriving`
    gives None where there was no message for `TICK`, `dropped` how many were dropped since its last
    call.
    """

    _form = "not an object in JSON"  # what a message is that cannot be read

    def __init__(
        self,
        name: str,
        arriving: Iterator[Any],
        options: ReadOptions,
        dropped: Callable[[], int] = lambda: 0,
    ) -> None:
        self.name = name
        self._arriving, self._options, self._dropped = arriving, options, dropped
        self._head: list[Values] = []
        self._fields: dict[Field, None] = {}  # every field that came
        self._bad, self._why, self._example = 0, "", ""
        self._stamped = True

    def head(self) -> Fields:
        """See `Feed`."""
        begin = 0.0
        for message in self._arriving:
            if message is not None and (sample := self._sample(message)):
                begin = begin or time.monotonic()
                self._head.append(sample)
                self._learn(sample[1])
            is_late = begin and time.monotonic() - begin > PAUSE
            if is_late or len(self._head) >= _HEAD_MESSAGES:
                break
        if not self._fields:
            reason = f" ({self._why}: {self._example})" if self._bad else ""
            hint = 'send objects such as {"t": 12.34, "axle 1 speed [km/h]": 80.2}'
            raise UserError(f"{self.name}: no message holds a number{reason}", hint)
        return Fields(self.name, [*self._fields])

    def _learn(self, values: dict[Field, float]) -> bool:
        """Remembers the fields of a message; a sender that invents ever more is not followed."""
        if len(self._fields) >= _MOST_FIELDS:
            return False
        self._fields |= dict.fromkeys(values)
        return True

    def rows(self, wanted: list[Field], add_source: AddSource) -> Iterator[FeedRow | None]:
        """See `Feed`."""
        place = {f: i for i, f in enumerate(wanted)}

        def row(sample: Values) -> FeedRow:
            t, values = sample
            if not self._fields.keys() >= values.keys() and self._learn(values):
                add_source(Fields(self.name, [*self._fields]))
                place.update((f, i) for i, f in enumerate(wanted))
            return FeedRow(t, {place[f]: x for f, x in values.items() if f in place})

        yield from map(row, self._head)
        self._head.clear()
        for message in self._arriving:
            if message is None:
                yield None
            elif sample := self._sample(message):
                yield row(sample)

    def findings(self) -> list[Finding]:
        """See `Feed`."""
        found = []
        if self._bad:
            names = {"reason": self._why, "example": self._example}
            found.append(Finding("messages-unreadable", "warning", count=self._bad, names=names))
            self._bad = 0
        if dropped := self._dropped():
            found.append(Finding("samples-dropped", "warning", count=dropped))
        if not self._stamped:
            found.append(Finding("time-of-arrival", "info"))
            self._stamped = True
        return found

    def _sample(self, message: Any) -> Values | None:
        """Time and values of a message; None where it has none, which is counted."""
        try:
            return self.parsed(message)
        except Exception as error:  # whatever one message raises, the next ones come
            if not self._bad:
                self._why = str(error) if isinstance(error, UnreadableError) else self._form
                is_text = isinstance(message, bytes)
                text = message.decode("utf-8", "replace") if is_text else str(message)
                self._example = repr(text[:_EXAMPLE_CHARACTERS])
            self._bad += 1
            return None

    def parsed(self, message: Any) -> Values | None:
        """Time and values of a message, None where it says nothing; any error if unreadable."""
        if not message.strip():
            return None
        if len(message) > MOST_BYTES:
            raise UnreadableError(f"longer than {MOST_BYTES >> 20} MiB")
        said = json.loads(message)
        if not isinstance(said, dict):
            raise UnreadableError("not an object in JSON")
        flat = dict(_flat(said, "", 0))
        if len(flat) > _MOST_VALUES:
            raise UnreadableError(f"more than {_MOST_VALUES} values")
        stamp = self._stamp_name(flat)
        t = self._nanoseconds(stamp, flat.pop(stamp)) if stamp else time.time_ns()
        group = next((k for k in flat if is_named(k, GROUP)), None)
        axle_label = str(flat.pop(group)) if group else ""
        axle_label = f"{group} {axle_label}" if group and axle_label.isdigit() else axle_label
        values = {
            Field(name, group=axle_label): float(x)
            for name, x in flat.items()
            if isinstance(x, int | float) and not isinstance(x, bool)
        }
        if not values:
            raise UnreadableError("no number")
        self._stamped = self._stamped and bool(stamp)
        return t, values

    def _stamp_name(self, flat: Json) -> str:
        """The name of the time, "" where no value is one."""
        if time_channel := self._options.time_channel:
            if time_channel not in flat:
                raise UnreadableError(f"no time {time_channel!r}")
            return time_channel
        ranked = sorted((rank[0], name) for name in flat if (rank := time_name(name)))
        return ranked[0][1] if ranked else ""

    def _nanoseconds(self, name: str, value: Any) -> int:
        if isinstance(value, str):
            instant = datetime.fromisoformat(value)
            since = (instant if instant.tzinfo else instant.replace(tzinfo=UTC)) - datetime(
                1970, 1, 1, tzinfo=UTC
            )
            return (since.days * 86400 + since.seconds) * 10**9 + since.microseconds * 1000
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise UnreadableError("no time that can be read")
        named = time_name(name)
        unit = self._options.time_unit or (named[1] if named else None)
        unit = unit or next((u for smallest, u in _LARGE if abs(value) > smallest), "s")
        if unit not in NS_PER_UNIT:
            raise UnreadableError(f"its time is stated in {unit!r}")
        return round(value * NS_PER_UNIT[unit])


def _flat(said: Json, prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Names and values of an object and those in it, names joined by points."""
    if depth > _DEEPEST:
        raise UnreadableError("nested too deeply")
    for key, value in said.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.", depth + 1)
        else:
            yield f"{prefix}{key}", value


def in_datagrams(pump: Pump[bytes]) -> Iterator[bytes | None]:
    """The messages of pieces that each hold one, or several on lines."""
    for piece in pump:
        yield from [None] if piece is None else piece.splitlines()


def lines(pieces: Iterator[bytes | None]) -> Iterator[bytes | None]:
    """Whole lines of bytes that arrive; of one that is too long, as much as shows that."""
    remainder = b""
    for piece in pieces:
        if piece is None:
            yield None
            continue
        *complete, remainder = (remainder + piece).split(b"\n")
        yield from complete
        if len(remainder) > 2 * MOST_BYTES:
            remainder = remainder[: MOST_BYTES + 1]
    if remainder:
        yield remainder
