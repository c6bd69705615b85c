"""The time of a table: which column, in which form, and its exact int64 nanoseconds.

Numbers go through float64 only where that keeps nanoseconds (at today's epoch it loses 256 of
them), else they are read as decimals and shifted. Stamps without a zone count as UTC, times of day
from midnight.
"""

import math
import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa

from ...core import units
from ...core.errors import UserError
from ...core.finding import Finding
from ...core.model import Bools, Times
from ..source import ReadOptions
from . import arrow as pc
from .dialect import INFINITE, NULLS, Dialect, is_null, number_grammar
from .header_words import (
    NS_PER_UNIT,
    is_clock_name,
    is_counter_name,
    is_date_name,
    speaks_of_time,
    time_name,
    time_unit,
)

TIME_UNITS = (*NS_PER_UNIT, "iso", "dmy", "mdy", "excel", "matlab")

_S = 1_000_000_000
_DAY = 86_400 * _S
_EPOCH_S = (946_684_800.0, 2_840_140_800.0)  # 2000 to 2060
_SERIALS = {"excel": (30_000, 60_000, 25_569), "matlab": (730_000, 753_000, 719_529)}
_STEP_S = (5e-5, 2.0)  # sampling periods of brake logs, for times whose unit nobody states
_SPAN_S = (3.0, 100_000.0)  # and their lengths
_SCALE = {"s": 9, "ms": 6, "us": 3, "ns": 0, "min": 9, "h": 9}
_EXACT = 2.0**50  # ns, 13 days: below, float64 is less than half a nanosecond off after scaling
_SAME_RATE = 0.02  # two clocks that run by less apart are one
_READABLE = 0.5  # of a time column's head must be readable

_CLOCK = (
    r"(?P<H>[0-9]{1,2}):(?P<M>[0-9]{2})(?::(?P<S>[0-9]{2})(?:[.,](?P<f>[0-9]+)|:(?P<l>[0-9]{3}))?)?"
    r"(?:\s*(?P<p>[AaPp])[Mm])?"
)
_SECONDS = r"[+-]?[0-9]+[.,](?P<f>[0-9]+)"
_SHORT_CLOCK = r"(?P<M>[0-9]{1,2}):(?P<S>[0-9]{2})[.,](?P<f>[0-9]+)"
_DURATIONS = (
    r"(?P<S>[0-9]{1,9})(?:[.,](?P<f>[0-9]+))?\s*s(?:ec)?",  # MATLAB
    r"(?P<D>[0-9]{1,5}) days?,?\s+" + _CLOCK,  # pandas, Python
)
_ZONE = r"\s*(?P<z>Z|z|UTC|GMT|[+-][0-9]{2}:?[0-9]{2}|[+-][0-9]{2})?"
_GAP = r"(?:[Tt]|[\s,_]+)"
_DATES = {
    "ymd": r"(?P<y>[0-9]{4})[-/.年](?P<m>[0-9]{1,2})[-/.月](?P<d>[0-9]{1,2})日?",
    "ymd compact": r"(?P<y>[0-9]{4})(?P<m>[0-9]{2})(?P<d>[0-9]{2})",
    "dmy": r"(?P<d>[0-9]{1,2})[./-](?P<m>[0-9]{1,2})[./-](?P<y>[0-9]{4}|[0-9]{2})",
    "mdy": r"(?P<m>[0-9]{1,2})[/-](?P<d>[0-9]{1,2})[/-](?P<y>[0-9]{4}|[0-9]{2})",
    "d mon y": r"(?P<d>[0-9]{1,2})[-. ]{0,2}(?P<n>[A-Za-zä]{3})[a-z]*\.?[-. ]{0,2}(?P<y>[0-9]{4})",
}
_MONTHS = "jan feb mar apr may jun jul aug sep oct nov dec mär mai okt dez".split()
_MONTH_NUMBER = np.array([*range(1, 13), 3, 5, 10, 12], dtype=np.int64)
_CANONICAL = re.compile(
    r"[0-9]{4}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?"
    r"(Z|[+-][0-9]{2}:[0-9]{2})?"
)


@dataclass(frozen=True, slots=True)
class Clock:
    """How to get int64 ns from one or two columns of the table."""

    columns: tuple[int, ...]
    unit: str  # of a number: key of `NS_PER_UNIT`; "excel", "matlab"; "" for stamps
    pattern: str  # of a stamp, date and clock joined by a blank; "" for numbers
    decimal: str
    absolute: bool  # counts from 1970
    reason: str
    types: tuple[Any, ...]  # Arrow types to try in turn, text last
    findings: tuple[Finding, ...] = ()

    def nanoseconds(self, arrays: Sequence[Any]) -> tuple[Times, Bools]:
        """Times [ns] of the rows of one block, and which of them hold; shape (n,).

        Args:
            arrays: the clock's columns, of one of `types`, nulls where a cell says nothing.
        """
        if self.pattern:
            if pa.types.is_timestamp(arrays[0].type):
                ok = np.asarray(arrays[0].is_valid())
                return np.asarray(arrays[0].cast(pa.int64()).fill_null(0)), ok
            text = [pc.utf8_trim_whitespace(a) for a in arrays]
            if len(text) == 2:
                text = [pc.binary_join_element_wise(*text, " ")]
            return _stamps(text[0], self.pattern)
        (array,) = arrays
        if self.unit in _SERIALS:
            value, ok = _floats(array, self.decimal)
            ok &= np.abs(value) < 1e6
            days = np.where(ok, value - _SERIALS[self.unit][2], 0.0)
            whole = np.floor(days)
            # a serial day holds about a microsecond; rounding there keeps even steps even
            t = (
                whole.astype(np.int64) * _DAY
                + np.rint((days - whole) * 86_400e6).astype(np.int64) * 1000
            )
            return t, ok
        if pa.types.is_floating(array.type):
            value = array.to_numpy(zero_copy_only=False) * NS_PER_UNIT[self.unit]
            ok = np.isfinite(value)
            if not ok.all():
                value[~ok] = 0.0
            return np.rint(value, out=value).astype(np.int64), ok
        t, ok = _decimals(array, _SCALE[self.unit], self.decimal)
        if factor := {"min": 60, "h": 3600}.get(self.unit):
            ok &= np.abs(t) < 2**62 // factor
            t = np.where(ok, t, 0) * factor
        return t, ok

    def refuse_unpadded(self, rows: Sequence[Sequence[str]], name: str, path: Any) -> None:
        """Refuses times whose fraction is a whole number of ms, us or ns without leading zeros.

        "5.7" is 5.007 s then. Read as decimals such times fall once a second, as numbers never.

        Args:
            rows: the cells of the clock's columns, of rows in turn.
            name: the column, for the message.
            path: for the message.
        """
        pattern = self.pattern or (_SECONDS if self.unit == "s" else "")
        if "(?P<f>" not in pattern:
            return
        found = [m for row in rows if (m := re.fullmatch(pattern, " ".join(row)))]
        digits = {len(m["f"]) for m in found if m["f"]}
        if len(digits) < 2 or (most := max(digits)) > 9:
            return
        width = -(-most // 3) * 3
        padded = [
            m.string[: m.start("f")] + m["f"].zfill(width) + m.string[m.end("f") :]
            if m["f"] else m.string for m in found
        ]  # fmt: skip
        (t, _), (as_number, _) = (
            _stamps(pa.array(x), pattern) if self.pattern
            else _decimals(pa.array(x), 9, self.decimal)
            for x in ([m.string for m in found], padded)
        )  # fmt: skip
        falls = np.flatnonzero(np.diff(t) < 0)
        if len(falls) and not (np.diff(as_number) < 0).any():
            k = int(falls[0])
            raise UserError(
                f"{path}: the fractions of a second in {name!r} lack their leading zeros: "
                f"{found[k][0]!r} stands before {found[k + 1][0]!r}, as if it were {padded[k]!r}",
                f"export the time with all {width} decimals; nothing is repaired here",
            )

    def is_packed(self, t: Times, cells: Sequence[str]) -> bool:
        """Whether the times [ns] of a log are no seconds but hhmmss.ss, as of a receiver's UTC.

        No such number ends in 60 to 99, and one in 59 is followed by one in 00.
        """
        padded = any(re.match(r"0[0-9]{5}(?:[.,]|$)", c) for c in cells)
        if self.unit != "s" or self.absolute or not (padded or t.max() >= 10_000 * _S):
            return False
        if (t[:: len(t) // 1000 + 1] % (100 * _S) >= 60 * _S).any():  # all would cost memory
            return False
        rest = t % (100 * _S)
        turns = (np.diff(t // (100 * _S)) == 1) & (rest[:-1] >= 59 * _S) & (rest[1:] < _S)
        return bool(turns.any() and (rest < 60 * _S).all())

    def is_exact(self, array: Any) -> bool:
        """Whether a block of the clock's column, read as float64, keeps nanoseconds."""
        if self.unit in _SERIALS:
            return True
        value = array.to_numpy(zero_copy_only=False)
        ends = np.fmin.reduce(value, initial=0.0), np.fmax.reduce(value, initial=0.0)
        return bool(max(-ends[0], ends[1]) * NS_PER_UNIT[self.unit] < _EXACT)


def find_clock(dialect: Dialect, options: ReadOptions, rows: float, path: Any) -> Clock:  # noqa: C901, PLR0912
    """Decide which column is the time, in which form and unit, and why.

    Args:
        dialect: with the head's rows.
        options: `time_channel` and `time_unit` beat what the head suggests.
        rows: rows of the whole file, estimated.
        path: for messages.

    Raises:
        UserError: where no column is a time, or its unit or order of day and month is open.
    """
    unit = options.time_unit
    if unit is not None and unit not in TIME_UNITS:
        raise UserError(f"unknown time unit {unit!r}", f"known: {', '.join(TIME_UNITS)}", code=2)
    if options.time_channel is not None:
        i = column_index(dialect, options.time_channel, path)
        clock = _clock_of(dialect, i, unit, rows, path, "stated")
        if clock is None:
            raise _unreadable(dialect, i, path)
        return clock
    named = []
    for i in range(len(dialect.names)):
        if dialect.headed and (found := _named(dialect, i)):
            constant = len(dialect.rows) > 2 and len(set(dialect.column(i))) < 2
            named.append((constant, found[0], i))
    doubt: UserError | None = None
    for _, _, i in sorted(named):
        try:
            clock = _clock_of(dialect, i, unit, rows, path, f"column named {dialect.names[i]!r}")
        except UserError as error:
            doubt = doubt or error
            continue
        if clock:
            told = _others(dialect, clock, rows, path)
            return replace(clock, findings=(*clock.findings, *told))
    if doubt:
        raise doubt
    unread = [i for _, _, i in sorted(named) if dialect.column(i)]
    if dialect.headed:
        for i in range(len(dialect.names)):
            stamps = _date_form(dialect.column(i), unit) or _share(dialect.column(i), _CLOCK) > 0.8
            if stamps and (
                clock := _clock_of(dialect, i, unit, rows, path, "first column of stamps")
            ):
                _others(dialect, clock, rows, path)
                return _guessed(clock, dialect)
        for i, name in enumerate(dialect.names):
            if any(not _numeric(dialect, k) for k in unread):
                break  # the time is there, in a form that is not known
            if is_counter_name(name) or _measured(dialect, i) or not _rises(dialect, i):
                continue
            if unit is None and _counts(dialect, i) and not _says_time(dialect, i):
                continue
            if clock := _clock_of(dialect, i, unit, rows, path, "first column that rises strictly"):
                _others(dialect, clock, rows, path)
                return _guessed(clock, dialect)
    if unread:
        raise _unreadable(dialect, unread[0], path)
    raise UserError(
        f"{path}: no column is a time (columns: {', '.join(map(repr, dialect.names[:12]))})",
        'state it, as time = {channel = "…", unit = "s"} under [channels]',
    )


def backwards(path: Any, name: str, cells: Sequence[str]) -> UserError:
    """The refusal of a log whose time falls, as `cells` of column `name` do."""
    return UserError(
        f"{path}: time column {name!r} runs backwards (from {cells[0]} to {cells[-1]})",
        "export the rows in the order of time, the oldest first; nothing is sorted here",
    )


def column_index(dialect: Dialect, name: str, path: Any) -> int:
    """Column of a name: the header text, one of its parts if unique, or "column N".

    Raises:
        UserError: for a name that no column has.
    """
    names = list(dialect.names)
    if name in names:
        return names.index(name)
    if (found := re.fullmatch(r"column ([0-9]+)", name)) and 1 <= int(found[1]) <= len(names):
        return int(found[1]) - 1
    folded = [n.casefold().strip() for n in names]
    if folded.count(name.casefold().strip()) == 1:
        return folded.index(name.casefold().strip())
    for cells in reversed(dialect.parts):
        if cells.count(name) == 1:
            return cells.index(name)
    raise UserError(
        f"{path}: no column {name!r}",
        f'columns: {", ".join(map(repr, names[:20]))}; or by number, as "column 1"',
    )


def _unreadable(dialect: Dialect, i: int, path: Any) -> UserError:
    """The refusal of a column that is stated, or called, a time."""
    cells = dialect.column(i)
    numbers = [float(c.replace(",", ".")) for c in cells if dialect.number().fullmatch(c)]
    if len(numbers) > len(cells) / 2:
        falls = sum(b < a for a, b in pairwise(numbers))
        if not falls:
            return UserError(
                f"{path}: column {dialect.names[i]!r} holds numbers, as {cells[0]!r}, not stamps",
                f"state its unit: one of {', '.join((*NS_PER_UNIT, *_SERIALS))}",
            )
        return UserError(
            f"{path}: time column {dialect.names[i]!r} falls in {falls} of the first "
            f"{len(numbers)} rows",
            "export the rows in the order of time, or state the time, as "
            f'time = {{channel = {toml(dialect.names[i])}, unit = "s"}} under [channels]: rows '
            "older than those before are then left out",
        )
    return UserError(
        f"{path}: column {dialect.names[i]!r} holds no times"
        + (f", as {cells[0][:40]!r}" if cells else ""),
        "export it in seconds or as date and time, or state another, as "
        'time = {channel = "…", unit = "s"} under [channels]',
    )


def _measured(dialect: Dialect, i: int) -> bool:
    """Whether a column's unit is one that no time has, or none that is known."""
    in_row = dialect.units[i] if dialect.units else ""
    text = in_row or units.in_name(dialect.names[i])[1] or units.unknown_in(dialect.names[i])
    unit = units.unit(text)
    return bool(text) and (unit is None or unit.dimension != "time") and not time_unit(text)


def _says_time(dialect: Dialect, i: int) -> bool:
    """Whether a column's name speaks of time, or its unit is one of time."""
    name = dialect.names[i]
    said = (dialect.units[i], units.in_name(name)[1], name)
    return any(map(time_unit, said)) or speaks_of_time(name)


def _counts(dialect: Dialect, i: int) -> bool:
    """Whether a column's numbers are those of rows: each is by one above the last."""
    cells = dialect.column(i)
    whole = all(c.isascii() and c.isdigit() for c in cells)
    return whole and all(int(b) - int(a) == 1 for a, b in pairwise(cells))


def _numeric(dialect: Dialect, i: int) -> bool:
    cells = dialect.column(i)
    return sum(bool(dialect.number().fullmatch(c)) for c in cells) >= _READABLE * len(cells)


def _named(dialect: Dialect, i: int) -> tuple[int, str | None] | None:
    for text in (dialect.names[i], *(cells[i] for cells in reversed(dialect.parts))):
        if found := time_name(text):
            return found
    return (1000, None) if is_date_name(dialect.names[i]) else None


def _guessed(clock: Clock, dialect: Dialect) -> Clock:
    """The clock, told as a guess: a warning where nothing but that it rises speaks for it."""
    i = clock.columns[0]
    name = dialect.names[i]
    open_unit = any(f.code == "time-unit-guessed" for f in clock.findings)
    note = Finding(
        "time-guessed", "warning" if open_unit and not _says_time(dialect, i) else "info",
        channel=name, names={"column": repr(name), "reason": clock.reason},
    )  # fmt: skip
    return replace(clock, findings=(*clock.findings, note))


def _share(cells: Sequence[str], pattern: str) -> float:
    return sum(bool(re.fullmatch(pattern, c)) for c in cells) / max(len(cells), 1)


def _rises(dialect: Dialect, i: int, whole: bool = True) -> bool:
    """Whether a column's numbers rise strictly; without a missing one if `whole`."""
    cells = dialect.column(i)
    number = dialect.number()
    if len(cells) < 3 or (whole and len(cells) < len(dialect.rows)):
        return False
    if not all(map(number.fullmatch, cells)):
        return False
    values = [float(c.replace(",", ".")) for c in cells]
    return all(b > a for a, b in pairwise(values))


def _others(dialect: Dialect, clock: Clock, rows: float, path: Any) -> tuple[Finding, ...]:
    """Tells of further time columns; refuses those that time other columns than the clock does.

    Raises:
        UserError: where a column named alike ("time1", "time2"; "time of p", "time of v") holds
            other times, or one that speaks of time runs at another rate.
    """
    i = clock.columns[-1]
    named = {k for k in range(len(dialect.names)) if _named(dialect, k)}
    others = [
        k
        for k in range(len(dialect.names))
        if k not in clock.columns and dialect.column(k) != dialect.column(i)
    ]
    for k in others:
        name = dialect.names[k]
        alike = _unnumbered(name) == _unnumbered(dialect.names[i]) and (
            k in named or _rises(dialect, k, whole=False)
        )
        if not alike and k not in named and not speaks_of_time(name):
            continue
        if alike or _times_others(dialect, clock, k, not named & {i, k}, rows, path):
            raise UserError(
                f"{path}: {dialect.names[i]!r} and {name!r} are both times, and differ: which "
                "columns belong to which is not stated",
                "export all channels on one time axis; or, if all columns that are needed belong "
                f'to one, state it, as time = {{channel = "column {i + 1}"}} under [channels]',
            )
    others = [k for k in others if k in named]
    if not others:
        return ()
    columns, taken = listed(dialect.names[k] for k in others), dialect.names[i]
    return (
        Finding(
            "time-other-columns", "info", channel=taken, count=len(others),
            names={"columns": columns, "taken": repr(taken)},
        ),
    )  # fmt: skip


def _times_others(
    dialect: Dialect, clock: Clock, k: int, offset: bool, rows: float, path: Any
) -> bool:
    """Whether a column is a clock of its own: of another rate, or shifted where `offset` counts.

    Another unit that nobody states is no other rate, nor is a clock that counts coarsely.
    """
    try:
        other = _clock_of(dialect, k, None, rows, path, "as well")
    except UserError:
        return False
    guessed = ["time-unit-guessed" in {f.code for f in c.findings} for c in (clock, other) if c]
    if other is None or guessed == [False, True]:
        return False
    times = []
    for c in (clock, other):
        cells = [[None if is_null(row[n]) else row[n] for row in dialect.rows] for n in c.columns]
        t, ok = c.nanoseconds([pa.array(column, pa.string()) for column in cells])
        times.append(np.where(ok, t, np.nan))
    t, u = np.array(times)[:, np.isfinite(times).all(axis=0)]
    if len(t) < 3 or not ((np.diff(t) > 0).all() and (np.diff(u) > 0).all()):
        return False
    apart = (u - u[0]) - (t - t[0])
    rate = (u[-1] - u[0]) / (t[-1] - t[0])
    scaled = any(abs(rate * s - 1) < _SAME_RATE for s in (1e-9, 1e-6, 1e-3, 1, 1e3, 1e6, 1e9))
    faster = not scaled and float(np.ptp(apart)) > 2 * float(np.median(np.diff(t)))
    return faster or (offset and bool(t[0] != u[0]))


def _unnumbered(name: str) -> str:
    return re.sub(r"[\s_.]*\(?[0-9]+\)?(?=\W*\w*\W*$)", "", name).strip()


def _clock_of(
    dialect: Dialect, i: int, unit: str | None, rows: float, path: Any, why: str
) -> Clock | None:
    """The column read as a time, None where it is none."""
    cells = dialect.column(i)
    if not cells:
        return None
    dated = unit in ("iso", "dmy", "mdy") or (unit is None and is_date_name(dialect.names[i]))
    if _numeric(dialect, i) and not (dated and _share(cells, r"[12][0-9]{7}") == 1):
        clock = _number_clock(dialect, i, unit, rows, path, why)
    else:
        clock = _stamp_clock(dialect, i, unit, path, why)
    if clock:
        name = dialect.names[clock.columns[-1]]
        clock.refuse_unpadded([[row[k] for k in clock.columns] for row in dialect.rows], name, path)
    return clock


def _number_clock(
    dialect: Dialect, i: int, unit: str | None, rows: float, path: Any, why: str
) -> Clock | None:
    name = dialect.names[i]
    number = dialect.number()
    cells = [c for c in dialect.column(i) if number.fullmatch(c)]
    values = [v for c in cells if math.isfinite(v := float(c.replace(",", ".")))]
    if not values:
        return None
    falls = sum(b < a for a, b in pairwise(values))
    if falls > 0.9 * (len(values) - 1) > 1:
        raise backwards(path, name, cells)
    if why != "stated" and falls > 0.3 * len(values):  # a T that is a temperature
        return None
    steps = [b - a for a, b in pairwise(values) if b > a]
    step = statistics.median(steps) if steps else 0.0
    span = (values[-1] - values[0]) / max(len(values) - 1, 1) * max(rows - 1, 1)
    stated, source = (
        _said_unit(dialect, i, unit, path) or _shown_unit(cells, values, step) or (None, "")
    )
    notes: tuple[Finding, ...] = ()
    ask = (
        f'state it, as time = {{channel = {toml(name)}, unit = "ms"}} under [channels] '
        f"(one of {', '.join(NS_PER_UNIT)}, excel, matlab)"
    )
    if stated in ("iso", "dmy", "mdy"):
        return None
    if stated in _SERIALS:
        types: tuple[Any, ...] = (pa.float64(), pa.string())
        reason = f"{why}; {stated} serial days ({source})"
        return Clock((i,), stated, "", dialect.decimal, True, reason, types, notes)
    if stated is None:
        stated, source = _plausible_unit(values, step, span), f"step {step:g}, about {span:g} long"
        if stated is None:
            raise UserError(
                f"{path}: the unit of time column {name!r} is not stated and not plain from its "
                f"values (step {step:g}, from {cells[0]} to {cells[-1]})",
                ask,
            )
        notes = (
            Finding(
                "time-unit-guessed", "info", channel=name,
                names={"column": repr(name), "unit": stated, "reason": source},
            ),
        )  # fmt: skip
    seconds = values[0] * NS_PER_UNIT[stated] / _S
    if seconds > _EPOCH_S[1] and source != "stated":
        raise UserError(
            f"{path}: time column {name!r} in {stated} ({source}) would lie beyond the year 2060 "
            f"({cells[0]})",
            ask,
        )
    if abs(seconds) >= 2**63 / _S:
        raise UserError(
            f"{path}: times in column {name!r} do not fit 64-bit nanoseconds ({cells[0]} {stated})",
            ask,
        )
    absolute = seconds >= _EPOCH_S[0]
    reason = f"{why}; {'Unix epoch, ' if absolute else ''}{stated} ({source})"
    scale = _SCALE[stated]
    types = (pa.float64(), pa.decimal128(38, scale), pa.decimal128(38, 18), pa.string())
    types = types[1:] if absolute else types
    return Clock((i,), stated, "", dialect.decimal, absolute, reason, types, notes)


def _said_unit(dialect: Dialect, i: int, unit: str | None, path: Any) -> tuple[str, str] | None:
    """The unit that somebody says a time column is in, and who does.

    Raises:
        UserError: where header and units row say two.
    """
    named = _named(dialect, i)
    in_brackets = re.search(r"[\[(]([^\])]*)[\])]$", dialect.names[i])
    said = (
        (unit, "stated"),
        (time_unit(dialect.units[i]) if dialect.units else None, "units row"),
        (named[1] if named else None, "header"),
        (time_unit(in_brackets[1]) if in_brackets else None, "header"),  # "Zeit 1 - Messrate [s]"
    )
    units = {u: source for u, source in (said[:1] if unit else said) if u}
    if len(units) > 1:
        text = " and ".join(f"{u!r} ({source})" for u, source in units.items())
        raise UserError(
            f"{path}: the unit of time column {dialect.names[i]!r} is stated twice: {text}",
            f'state it, as time = {{channel = {toml(dialect.names[i])}, unit = "…"}} under '
            "[channels]",
        )
    return next(iter(units.items()), None)


def _shown_unit(cells: list[str], values: list[float], step: float) -> tuple[str, str] | None:
    """The unit in which times lie in our days, and what it is then."""
    ends = values[0], values[-1]
    digits = sum(len(re.split("[.,]", c)[-1]) >= 6 for c in cells if re.search("[.,]", c))
    if digits > len(cells) / 2 and (not step or 1e-5 <= step * 86_400 <= 60):
        for serial, (low, high, _) in _SERIALS.items():
            if low <= ends[0] <= high:
                return serial, f"serial days between {low} and {high}"
    for u in ("s", "ms", "us", "ns"):
        second = _S // NS_PER_UNIT[u]
        if all(_EPOCH_S[0] <= v / second <= _EPOCH_S[1] for v in ends) and step / second <= 60:
            return u, "epoch by its magnitude"
    return None


def _plausible_unit(values: list[float], step: float, span: float) -> str | None:
    """The one unit in which a brake log could have this step and length, None if several."""
    possible = [
        u
        for u in ("s", "ms", "us", "ns")
        if _STEP_S[0] <= step * NS_PER_UNIT[u] / _S <= _STEP_S[1]
        and _SPAN_S[0] <= span * NS_PER_UNIT[u] / _S <= _SPAN_S[1]
    ]
    whole = all(v == int(v) for v in values)
    if not whole and step < 1 and _STEP_S[0] <= step:  # fractions below 1 ms would be above 1 kHz
        return "s"
    return possible[0] if len(possible) == 1 else None


def listed(names: Iterable[str], most: int = 6) -> str:
    """Names as a message lists them: the first ones, and how many there are."""
    shown = [repr(n) for n in names]
    return ", ".join(shown[:most]) + (f", … ({len(shown)})" if len(shown) > most else "")


def toml(text: str) -> str:
    """A TOML basic string."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _date_form(cells: Sequence[str], unit: str | None) -> str | None:
    """Name of the date form most cells start with, None for none; "dmy|mdy" where both fit.

    "dmy|ymd" where the year, of two digits, may stand in front: "24/05/13", not "24.05.13".
    """
    if not cells:
        return None
    fits = {
        form: _share(cells, f"{date}(?:{_GAP}{_CLOCK}{_ZONE})?") >= _READABLE
        for form, date in _DATES.items()
    }
    if fits["dmy"] or fits["mdy"]:
        if unit in ("dmy", "mdy"):
            return unit if fits[unit] else None
        found = [re.match(r"([0-9]{1,2})([./-])([0-9]{1,2})", c) for c in cells]
        pairs = [(int(m[1]), int(m[3])) for m in found if m]
        if (fits["dmy"] and any(a > 12 for a, _ in pairs)) or not fits["mdy"]:
            short = r"[0-9]{2}([/-])[0-9]{1,2}\1(?:[0-2][0-9]|3[01])(?![0-9]).*"
            return "dmy|ymd" if _share(cells, short) >= _READABLE else "dmy"
        if any(b > 12 for _, b in pairs):
            return "mdy"
        return "dmy|mdy"
    return next((form for form, ok in fits.items() if ok), None)


def _stamp_clock(dialect: Dialect, i: int, unit: str | None, path: Any, why: str) -> Clock | None:  # noqa: C901, PLR0912
    cells = dialect.column(i)
    columns = [i]
    date_only = clock_only = False
    form = _date_form(cells, unit)
    if form and _share(cells, "|".join(_unnamed(d) for d in _DATES.values())) >= _READABLE:
        date_only = True
    clocks = f"(?:{_unnamed(_CLOCK)}{_unnamed(_ZONE)})"
    if not form and _share(cells, clocks) >= _READABLE:
        clock_only = True
    if date_only or clock_only:
        partner = _partner(dialect, i, date_only, clocks, unit)
        if partner is not None:
            columns = [i, partner] if date_only else [partner, i]
            if clock_only:
                form = _date_form(dialect.column(partner), unit)
        elif date_only:
            return None
    names = " + ".join(repr(dialect.names[k]) for k in columns)
    if form in ("dmy|mdy", "dmy|ymd"):
        other = form == "dmy|ymd"
        orders = "day/month/year or year/month/day" if other else "day/month or month/day"
        raise UserError(
            f"{path}: {dialect.column(columns[0])[0]!r} in {names} may be {orders}",
            f'state it, as time = {{channel = {toml(dialect.names[i])}, unit = "dmy"}} '
            + ("under [channels], or export the year with four digits" if other
               else '(or "mdy") under [channels]'),
        )  # fmt: skip
    notes: list[Finding] = []
    if form:
        pattern = f"{_DATES[form]}{_GAP}{_CLOCK}{_ZONE}"
        whole = [" ".join(p) for p in zip(*(dialect.column(k) for k in columns), strict=False)]
        zones = [m["z"] for c in whole if (m := re.fullmatch(pattern, c))]
        if not all(zones):
            share = zones.count("") + zones.count(None)
            notes.append(
                Finding(
                    "time-zone-missing", "info", channel=dialect.names[i],
                    values={"share": share / len(zones)}, names={"columns": names},
                )
            )  # fmt: skip
        reason = (
            f"{why}; {'date and time in' if len(columns) == 2 else 'stamps in'} {names} ({form})"
        )
        types: tuple[Any, ...] = (pa.string(),)
        plain = [_CANONICAL.fullmatch(c) for c in cells]
        if len(columns) == 1 and all(plain):
            with_zone = {bool(m[1]) for m in plain if m}
            if len(with_zone) == 1:
                types = (pa.timestamp("ns", "UTC" if with_zone.pop() else None), pa.string())
        return Clock(
            tuple(columns), "", pattern, dialect.decimal, True, reason, types, tuple(notes)
        )
    if clock_only:
        pattern = f"{_CLOCK}{_ZONE}"
        if not any(c.count(":") > 1 for c in cells):
            raise UserError(
                f"{path}: {cells[0]!r} in {names} may be hours and minutes or minutes and seconds",
                "export the time with hours, minutes and seconds",
            )
    elif _share(cells, _SHORT_CLOCK) >= _READABLE:
        pattern = _SHORT_CLOCK
    elif found := next((d for d in _DURATIONS if _share(cells, d) >= _READABLE), None):
        reason = f"{why}; durations in {names}"
        return Clock((i,), "", found, dialect.decimal, False, reason, (pa.string(),))
    else:
        return None
    reason = f"{why}; time of day in {names}, without a date"
    return Clock((i,), "", pattern, dialect.decimal, False, reason, (pa.string(),))


def _unnamed(pattern: str) -> str:
    return re.sub(r"\?P<\w+>", "?:", pattern)


def _partner(
    dialect: Dialect, i: int, date_only: bool, clocks: str, unit: str | None
) -> int | None:
    """The column that holds the other half of date and time: by name, else the neighbour."""
    named = is_clock_name if date_only else is_date_name
    order = [k for k, n in enumerate(dialect.names) if k != i and named(n)]
    beside = i + 1 if date_only else i - 1
    order += [beside] if 0 <= beside < len(dialect.names) else []
    dates = "|".join(_unnamed(d) for d in _DATES.values())
    for k in order:
        if _share(dialect.column(k), clocks if date_only else dates) >= _READABLE:
            return k
    return None


def _floats(array: Any, decimal: str) -> tuple[Any, Bools]:
    """Values and which hold, from float64 or checked text."""
    value, state = checked_floats(array, decimal)
    return value, state == 0


def checked_floats(array: Any, decimal: str, unit: str = "") -> tuple[Any, Any]:
    """Numbers of one column of a block by the strict grammar.

    Args:
        array: Arrow array of float64 or text, null where a cell says nothing.
        decimal: decimal mark of the text.
        unit: may stand behind each number of the text.

    Returns:
        float64 values, NaN where there is none, and int8 states: 0 number, 1 nothing said,
        2 no number, 3 infinite; both of shape (n,).
    """
    if pa.types.is_floating(array.type):
        value = array.to_numpy(zero_copy_only=False)
        return value, (~np.isfinite(value)).view(np.int8)
    text = pc.utf8_trim_whitespace(array)
    if unit:
        text = pc.replace_substring_regex(text, r"\s*" + re.escape(unit) + "$", "")
    numeric = pc.fill_null(pc.match_substring_regex(text, _re2(decimal)), False)
    plain = pc.replace_substring(text, decimal, ".") if decimal != "." else text
    value = pc.cast(pc.if_else(numeric, plain, None), pa.float64()).to_numpy(zero_copy_only=False)
    state = np.zeros(len(value), np.int8)
    odd = np.flatnonzero(~np.isfinite(value))
    if len(odd):
        few = text.take(pa.array(odd))
        infinite = np.isinf(value[odd]) | _is_one_of(INFINITE, few)
        state[odd] = np.select([_says_nothing(few), infinite], [1, 3], 2)
        value = np.where(state == 0, value, np.nan)
    return value, state


def _says_nothing(text: Any) -> Bools:
    """Which trimmed cells are null or spell it, shape (n,)."""
    return np.asarray(pc.is_null(text)) | _is_one_of(NULLS, text)


def _is_one_of(words: Sequence[str], text: Any) -> Bools:
    return np.asarray(pc.is_in(text, pa.array(words, pa.string())))


def is_missing(array: Any) -> Bools:
    """Which cells of a column of a block say nothing, shape (n,)."""
    if pa.types.is_string(array.type):
        return _says_nothing(pc.utf8_trim_whitespace(array))
    if pa.types.is_floating(array.type):
        return np.asarray(np.isnan(array.to_numpy(zero_copy_only=False)))
    return np.asarray(array.is_null())


def _re2(decimal: str) -> str:
    return f"^(?:{number_grammar(decimal).pattern})$"


def _decimals(array: Any, scale: int, decimal: str) -> tuple[Times, Bools]:
    """Decimals times 10**scale as int64, exactly, rounded to the nearest; and which hold."""
    extra: Any = None
    if pa.types.is_string(array.type):
        text = pc.utf8_trim_whitespace(array)
        text = pc.replace_substring(text, decimal, ".") if decimal != "." else text
        ok = pc.fill_null(pc.match_substring_regex(text, _re2(".")), False)
        power = pc.match_substring(text, "e", ignore_case=True)
        # digits beyond the 18th decimal say nothing here; powers of ten are small enough for float
        short = pc.replace_substring_regex(text, r"(\.[0-9]{18})[0-9]+", r"\1")
        short = pc.if_else(
            pc.match_substring_regex(short, r"^[+-]?[0-9]{0,19}(?:\.|$)"), short, None
        )
        array = pc.cast(
            pc.if_else(pc.and_(ok, pc.invert(power)), short, None), pa.decimal128(38, 18)
        )
        extra = pc.cast(pc.if_else(pc.and_(ok, power), text, None), pa.float64())
    if array.type.scale != scale:
        array = pc.round(array, ndigits=scale, round_mode="half_to_even")
        array = array.cast(pa.decimal128(38, scale))
    words = np.frombuffer(array.buffers()[1], np.int64, 2 * len(array), 16 * array.offset)
    low, high = words[0::2], words[1::2]
    ok = high == low >> 63
    if array.null_count:
        ok &= np.asarray(array.is_valid())
    t = np.where(ok, low, 0)
    if extra is not None:
        with np.errstate(over="ignore"):
            value = extra.to_numpy(zero_copy_only=False) * 10.0**scale
        use = np.abs(value) < 2.0**62
        t = np.where(use, np.rint(np.where(use, value, 0)).astype(np.int64), t)
        ok = ok | use
    return t, ok


def _stamps(text: Any, pattern: str) -> tuple[Times, Bools]:
    """Times [ns] of stamps that match the pattern, and which do."""
    found = pc.extract_regex(text, pattern=f"^(?:{pattern})$")
    ok = np.asarray(found.is_valid())
    names = [found.type.field(k).name for k in range(found.type.num_fields)]

    def part(name: str) -> Any:
        return pc.fill_null(pc.struct_field(found, name), "")

    def number(name: str, default: int = 0, digits: Any = None) -> Times:
        if name not in names:
            return np.full(len(text), default, np.int64)
        cells = part(name) if digits is None else digits(part(name))
        cells = pc.if_else(pc.equal(cells, ""), str(default), cells)
        return np.asarray(pc.cast(cells, pa.int64()))

    def nine(cells: Any) -> Any:
        padded = pc.utf8_rpad(pc.utf8_slice_codeunits(cells, 0, 9), 9, padding="0")
        return pc.if_else(pc.equal(cells, ""), "", padded)

    hour, minute, second = number("H"), number("M"), number("S")
    fraction = number("f", digits=nine) + number("l") * 1_000_000
    if "p" in names:
        half = part("p")
        said = np.asarray(pc.not_equal(half, ""))
        ok &= ~said | ((hour >= 1) & (hour <= 12))
        afternoon = np.asarray(pc.equal(pc.utf8_lower(half), "p"))
        hour = np.where(said, hour % 12 + 12 * afternoon, hour)
    ok &= (hour < 24) & (minute < 60) & ((second <= 60) | ("M" not in names))
    ns = (hour * 3600 + minute * 60 + second) * _S + fraction + number("D") * _DAY
    if "y" in names:
        year, day = number("y", 1970), number("d", 1)
        year = np.where(year < 70, year + 2000, np.where(year < 100, year + 1900, year))
        if "n" in names:
            index = pc.index_in(pc.utf8_lower(part("n")), pa.array(_MONTHS))
            at = np.asarray(pc.fill_null(index, -1))
            ok &= at >= 0
            month = _MONTH_NUMBER[at]
        else:
            month = number("m", 1)
        ok &= (month >= 1) & (month <= 12) & (year >= 1678) & (year <= 2261) & (day >= 1)
        months = np.where(ok, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
        days = months.astype("datetime64[D]") + np.where(ok, day - 1, 0)
        ok &= days.astype("datetime64[M]") == months
        ns = ns + days.astype(np.int64) * _DAY
    if "z" in names:
        zone = pc.replace_substring_regex(part("z"), "[^0-9+-]", "")
        digits = pc.utf8_rpad(pc.utf8_slice_codeunits(zone, 1, 5), 4, padding="0")
        shift = np.asarray(pc.cast(digits, pa.int64()))
        shift = (shift // 100 * 3600 + shift % 100 * 60) * _S
        ns = ns - np.where(np.asarray(pc.starts_with(zone, "-")), -shift, shift)
    return np.where(ok, ns, 0), ok
