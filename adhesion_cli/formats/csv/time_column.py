"""Which column of a table is the time, in which form and unit, decided from its first rows."""

import json
import math
import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ...core import units
from ...core.errors import UserError
from ...core.finding import Finding
from ..source import ReadOptions
from .clock import SCALE, SERIALS, Clock, backwards
from .dialect import Dialect, is_null
from .header_words import (
    CLOCK,
    COUNTER,
    DATE,
    NS_PER_UNIT,
    is_named,
    speaks_of_time,
    time_name,
    time_unit,
)

TIME_UNITS = (*NS_PER_UNIT, "iso", "dmy", "mdy", "excel", "matlab")

_S = 1_000_000_000
_EPOCH_S = (946_684_800.0, 2_840_140_800.0)  # 2000 to 2060
_STEP_S = (5e-5, 2.0)  # sampling periods of brake logs, for times whose unit is not stated
_SPAN_S = (3.0, 100_000.0)  # and their lengths
_SAME_RATE = 0.02  # two clocks whose rates differ by less are one
_READABLE = 0.5  # of a time column's first cells must be readable

_CLOCK = (
    r"(?P<H>[0-9]{1,2}):(?P<M>[0-9]{2})(?::(?P<S>[0-9]{2})(?:[.,](?P<f>[0-9]+)|:(?P<l>[0-9]{3}))?)?"
    r"(?:\s*(?P<p>[AaPp])[Mm])?"
)
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
_CANONICAL = re.compile(  # stamps that Arrow reads itself
    r"[0-9]{4}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?"
    r"(Z|[+-][0-9]{2}:[0-9]{2})?"
)


def _unnamed(pattern: str) -> str:
    return re.sub(r"\?P<\w+>", "?:", pattern)


_ANY_CLOCK = _unnamed(_CLOCK + _ZONE)
_ANY_DATE = "|".join(map(_unnamed, _DATES.values()))


def find_clock(dialect: Dialect, options: ReadOptions, rows: float, path: Path) -> Clock:
    """Decides which column is the time, in which form and unit, and why.

    Args:
        dialect: with the first rows.
        options: `time_channel` and `time_unit` have priority over what the rows suggest.
        rows: rows of the whole file, estimated.
        path: of the file.

    Raises:
        UserError: where no column is a time, or its unit or order of day and month is open.
    """
    unit = options.time_unit
    if unit is not None and unit not in TIME_UNITS:
        raise UserError(f"unknown time unit {unit!r}", f"known: {', '.join(TIME_UNITS)}", code=2)
    search = _Search(dialect, unit, rows, path)
    if options.time_channel is not None:
        i = column_index(dialect, options.time_channel, path)
        if clock := search.clock(i, "stated"):
            return clock
        raise _unreadable(dialect, i, path)
    named = search.named()
    if clock := search.first_named(named):
        return replace(clock, findings=(*clock.findings, *search.others(clock)))
    unread = [i for i in named if dialect.column(i)]
    if clock := search.guess(unread):
        search.others(clock)  # may refuse
        return _guessed(clock, dialect)
    if unread:
        raise _unreadable(dialect, unread[0], path)
    raise UserError(
        f"{path}: no column is a time (columns: {', '.join(map(repr, dialect.names[:12]))})",
        'state it, as time = {channel = "…", unit = "s"} under [channels]',
    )


def column_index(dialect: Dialect, name: str, path: Path) -> int:
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


def listed(names: Iterable[str], most: int = 6) -> str:
    """Names as a message lists them: the first ones, and how many there are."""
    shown = [repr(n) for n in names]
    return ", ".join(shown[:most]) + (f", … ({len(shown)})" if len(shown) > most else "")


def toml(text: str) -> str:
    """A TOML basic string."""
    return json.dumps(text, ensure_ascii=False)


def _unreadable(dialect: Dialect, i: int, path: Path) -> UserError:
    """The refusal of a column that is stated, or named, as the time."""
    name, cells, numbers = dialect.names[i], dialect.column(i), dialect.numbers(i)
    if len(numbers) > len(cells) / 2:
        falls = sum(b < a for a, b in pairwise(numbers))
        if not falls:
            return UserError(
                f"{path}: column {name!r} holds numbers, as {cells[0]!r}, not stamps",
                f"state its unit: one of {', '.join((*NS_PER_UNIT, *SERIALS))}",
            )
        return UserError(
            f"{path}: time column {name!r} falls in {falls} of the first {len(numbers)} rows",
            "export the rows in the order of time, or state the time, as "
            f'time = {{channel = {toml(name)}, unit = "s"}} under [channels]: rows '
            "older than those before are then left out",
        )
    return UserError(
        f"{path}: column {name!r} holds no times" + (f", as {cells[0][:40]!r}" if cells else ""),
        "export it in seconds or as date and time, or state another, as "
        'time = {channel = "…", unit = "s"} under [channels]',
    )


def _guessed(clock: Clock, dialect: Dialect) -> Clock:
    """The clock with a finding: a warning where only rising numbers indicate it."""
    i = clock.columns[0]
    name = dialect.names[i]
    open_unit = any(f.code == "time-unit-guessed" for f in clock.findings)
    note = Finding(
        "time-guessed", "warning" if open_unit and not _says_time(dialect, i) else "info",
        channel=name, names={"column": repr(name), "reason": clock.reason},
    )  # fmt: skip
    return replace(clock, findings=(*clock.findings, note))


@dataclass(frozen=True, slots=True)
class _Search:
    """Reads columns as times."""

    dialect: Dialect
    unit: str | None  # stated
    rows: float  # of the whole file, estimated
    path: Path

    def named(self) -> list[int]:
        """Columns whose name says that they are the time, the likeliest first."""
        found = []
        for i in range(len(self.dialect.names) * self.dialect.headed):
            if name := _named(self.dialect, i):
                constant = len(self.dialect.rows) > 2 and len(set(self.dialect.column(i))) < 2
                found.append((constant, name[0], i))
        return [i for _, _, i in sorted(found)]

    def first_named(self, named: list[int]) -> Clock | None:
        """The first of these columns that can be read as a time.

        Raises:
            UserError: where none can, and why the first of them is in doubt.
        """
        doubt: UserError | None = None
        for i in named:
            try:
                if clock := self.clock(i, f"column named {self.dialect.names[i]!r}"):
                    return clock
            except UserError as error:
                doubt = doubt or error
        if doubt:
            raise doubt
        return None

    def guess(self, unread: list[int]) -> Clock | None:
        """A column of stamps, else one that rises strictly; `unread` have the name of a time."""
        dialect = self.dialect
        columns = range(len(dialect.names) * dialect.headed)
        for i in columns:
            cells = dialect.column(i)
            stamps = _date_form(cells, self.unit) or _share(cells, _CLOCK) > 0.8
            if stamps and (clock := self.clock(i, "first column of stamps")):
                return clock
        if not all(_numeric(dialect, k) for k in unread):
            return None  # the time is there, in a form that is not known
        for i in columns:
            if (
                is_named(dialect.names[i], COUNTER)
                or _measured(dialect, i)
                or not _rises(dialect, i)
            ):
                continue
            if self.unit is None and _counts(dialect, i) and not _says_time(dialect, i):
                continue
            if clock := self.clock(i, "first column that rises strictly"):
                return clock
        return None

    def clock(self, i: int, why: str) -> Clock | None:
        """The column read as a time, None where it is not one."""
        cells, name = self.dialect.column(i), self.dialect.names[i]
        if not cells:
            return None
        dated = self.unit in ("iso", "dmy", "mdy") or (self.unit is None and is_named(name, DATE))
        if _numeric(self.dialect, i) and not (dated and _share(cells, r"[12][0-9]{7}") == 1):
            clock = _NumberClock(self, i, why).clock()
        else:
            clock = _stamp_clock(self, i, why)
        if clock:
            rows = [[row[k] for k in clock.columns] for row in self.dialect.rows]
            clock.refuse_unpadded(rows, self.dialect.names[clock.columns[-1]], self.path)
        return clock

    def others(self, clock: Clock) -> tuple[Finding, ...]:
        """Reports further time columns.

        Raises:
            UserError: where a column with a similar name ("time1" and "time2") holds other times,
                or one that speaks of time has another rate.
        """
        dialect, i = self.dialect, clock.columns[-1]
        columns = range(len(dialect.names))
        named = {k for k in columns if _named(dialect, k)}
        cells = dialect.column(i)
        others = [k for k in columns if k not in clock.columns and dialect.column(k) != cells]
        for k in others:
            name = dialect.names[k]
            similar = _unnumbered(name) == _unnumbered(dialect.names[i]) and (
                k in named or _rises(dialect, k, whole=False)
            )
            if not similar and k not in named and not speaks_of_time(name):
                continue
            if similar or self._is_another(clock, k, not named & {i, k}):
                raise UserError(
                    f"{self.path}: {dialect.names[i]!r} and {name!r} are both times, and differ: "
                    "the log does not state which columns belong to which",
                    "export all channels on one time axis; or, if all columns that are needed "
                    f'belong to one, state it, as time = {{channel = "column {i + 1}"}} under '
                    "[channels]",
                )
        others = [k for k in others if k in named]
        if not others:
            return ()
        note = Finding(
            "time-other-columns", "info", channel=dialect.names[i], count=len(others),
            names={"columns": listed(dialect.names[k] for k in others),
                   "taken": repr(dialect.names[i])},
        )  # fmt: skip
        return (note,)

    def _is_another(self, clock: Clock, k: int, offset: bool) -> bool:
        """Whether a column is a clock of another rate, or shifted where `offset` counts.

        A unit that is not stated is not another rate. Nor is a clock that counts coarsely.
        """
        try:
            other = replace(self, unit=None).clock(k, "as well")
        except UserError:
            return False
        guessed = ["time-unit-guessed" in {f.code for f in c.findings} for c in (clock, other) if c]
        if other is None or guessed == [False, True]:
            return False
        times = []
        for c in (clock, other):
            cells = ([None if is_null(x := row[n]) else x for row in self.dialect.rows]
                     for n in c.columns)  # fmt: skip
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


def _named(dialect: Dialect, i: int) -> tuple[int, str | None] | None:
    """Rank and unit of a column whose name is a time's."""
    for text in (dialect.names[i], *(cells[i] for cells in reversed(dialect.parts))):
        if found := time_name(text):
            return found
    return (1000, None) if is_named(dialect.names[i], DATE) else None


def _measured(dialect: Dialect, i: int) -> bool:
    """Whether a column's unit is not one of time, or not a known one."""
    name = dialect.names[i]
    text = dialect.units[i] or units.in_name(name)[1] or units.unknown_in(name)
    unit = units.unit(text)
    return bool(text) and (unit is None or unit.dimension != "time") and not time_unit(text)


def _says_time(dialect: Dialect, i: int) -> bool:
    """Whether a column's name speaks of time, or its unit is one of time."""
    name = dialect.names[i]
    said = (dialect.units[i], units.in_name(name)[1], name)
    return any(map(time_unit, said)) or speaks_of_time(name)


def _counts(dialect: Dialect, i: int) -> bool:
    """Whether a column's numbers are those of rows: each is the last one plus 1."""
    cells = dialect.column(i)
    whole = all(c.isascii() and c.isdigit() for c in cells)
    return whole and all(int(b) - int(a) == 1 for a, b in pairwise(cells))


def _numeric(dialect: Dialect, i: int) -> bool:
    return len(dialect.numbers(i)) >= _READABLE * len(dialect.column(i))


def _rises(dialect: Dialect, i: int, whole: bool = True) -> bool:
    """Whether a column's numbers rise strictly; without a missing one if `whole`."""
    values, cells = dialect.numbers(i), dialect.column(i)
    if len(cells) < 3 or len(values) < len(cells) or (whole and len(cells) < len(dialect.rows)):
        return False
    return all(b > a for a, b in pairwise(values))


def _share(cells: Sequence[str], pattern: str) -> float:
    return sum(bool(re.fullmatch(pattern, c)) for c in cells) / max(len(cells), 1)


def _unnumbered(name: str) -> str:
    return re.sub(r"[\s_.]*\(?[0-9]+\)?(?=\W*\w*\W*$)", "", name).strip()


class _NumberClock:
    """A column of numbers as a time; `why` says why it is looked at."""

    def __init__(self, search: _Search, i: int, why: str) -> None:
        self.path, self.dialect, self.i, self.why = search.path, search.dialect, i, why
        self.stated = search.unit
        self.name = self.dialect.names[i]
        number = self.dialect.number()
        self.cells = [c for c in self.dialect.column(i) if number.fullmatch(c)]
        self.values = [v for v in self.dialect.numbers(i) if math.isfinite(v)]
        steps = [b - a for a, b in pairwise(self.values) if b > a]
        self.step = statistics.median(steps) if steps else 0.0
        self.rows = search.rows

    def clock(self) -> Clock | None:
        """The clock; None where the column is not a time.

        Raises:
            UserError: where its unit is open, or the times fall or are out of range.
        """
        n = len(self.values)
        falls = sum(b < a for a, b in pairwise(self.values))
        if falls > 0.9 * (n - 1) > 1:
            raise backwards(self.path, self.name, self.cells)
        if not n or (self.why != "stated" and falls > 0.3 * n):  # a T that is a temperature
            return None
        found = self._said_unit() or self._shown_unit()
        unit, source = found or self._plausible_unit()
        if unit in ("iso", "dmy", "mdy"):
            return None
        decimal = self.dialect.decimal
        if unit in SERIALS:
            reason = f"{self.why}; {unit} serial days ({source})"
            types: tuple[Any, ...] = (pa.float64(), pa.string())
            return Clock((self.i,), unit, "", decimal, True, reason, types)
        absolute = self._is_epoch(unit, source)
        reason = f"{self.why}; {'Unix epoch, ' if absolute else ''}{unit} ({source})"
        types = (pa.decimal128(38, SCALE[unit]), pa.decimal128(38, 18), pa.string())
        types = types if absolute else (pa.float64(), *types)
        note = Finding(
            "time-unit-guessed", "info", channel=self.name,
            names={"column": repr(self.name), "unit": unit, "reason": source},
        )  # fmt: skip
        notes = () if found else (note,)
        return Clock((self.i,), unit, "", decimal, absolute, reason, types, notes)

    def _refusal(self, text: str) -> UserError:
        return UserError(
            f"{self.path}: {text}",
            f'state it, as time = {{channel = {toml(self.name)}, unit = "ms"}} under [channels] '
            f"(one of {', '.join(NS_PER_UNIT)}, excel, matlab)",
        )

    def _is_epoch(self, unit: str, source: str) -> bool:
        """Whether the times count from 1970.

        Raises:
            UserError: where they lie beyond 2060 or do not fit 64 bits.
        """
        seconds = self.values[0] * NS_PER_UNIT[unit] / _S
        if seconds > _EPOCH_S[1] and source != "stated":
            raise self._refusal(
                f"time column {self.name!r} in {unit} ({source}) would lie beyond the year 2060 "
                f"({self.cells[0]})"
            )
        if abs(seconds) >= 2**63 / _S:
            raise self._refusal(
                f"times in column {self.name!r} do not fit 64-bit nanoseconds "
                f"({self.cells[0]} {unit})"
            )
        return seconds >= _EPOCH_S[0]

    def _said_unit(self) -> tuple[str, str] | None:
        """The unit that the user, the units row or the header states, and which of them.

        Raises:
            UserError: where header and units row state different ones.
        """
        if self.stated:
            return self.stated, "stated"
        name, named = self.name, _named(self.dialect, self.i)
        in_brackets = re.search(r"[\[(]([^\])]*)[\])]$", name)
        said = (
            (time_unit(self.dialect.units[self.i]), "units row"),
            (named[1] if named else None, "header"),
            (time_unit(in_brackets[1]) if in_brackets else None, "header"),  # "Zeit 1 - Rate [s]"
        )
        found = {unit: source for unit, source in said if unit}
        if len(found) > 1:
            text = " and ".join(f"{unit!r} ({source})" for unit, source in found.items())
            raise UserError(
                f"{self.path}: the unit of time column {name!r} is stated twice: {text}",
                f'state it, as time = {{channel = {toml(name)}, unit = "…"}} under [channels]',
            )
        return next(iter(found.items()), None)

    def _shown_unit(self) -> tuple[str, str] | None:
        """The unit in which times lie in our days, and why."""
        first, last, step = self.values[0], self.values[-1], self.step
        digits = sum(len(re.split("[.,]", c)[-1]) >= 6 for c in self.cells if re.search("[.,]", c))
        if digits > len(self.cells) / 2 and (not step or 1e-5 <= step * 86_400 <= 60):
            for serial, (low, high, _) in SERIALS.items():
                if low <= first <= high:
                    return serial, f"serial days between {low} and {high}"
        for u in ("s", "ms", "us", "ns"):
            second = _S // NS_PER_UNIT[u]
            in_our_days = all(_EPOCH_S[0] <= v / second <= _EPOCH_S[1] for v in (first, last))
            if in_our_days and step / second <= 60:
                return u, "epoch by its magnitude"
        return None

    def _plausible_unit(self) -> tuple[str, str]:
        """The only unit in which a brake log could have this step and length, and why.

        Raises:
            UserError: where there are several, or none.
        """
        values, step = self.values, self.step
        span = (values[-1] - values[0]) / max(len(values) - 1, 1) * max(self.rows - 1, 1)
        possible = [
            u
            for u in ("s", "ms", "us", "ns")
            if _STEP_S[0] <= step * NS_PER_UNIT[u] / _S <= _STEP_S[1]
            and _SPAN_S[0] <= span * NS_PER_UNIT[u] / _S <= _SPAN_S[1]
        ]
        # fractions of milliseconds would be a rate above 1 kHz
        if step < 1 and _STEP_S[0] <= step and any(v != int(v) for v in values):
            possible = ["s"]
        if len(possible) != 1:
            raise self._refusal(
                f"the unit of time column {self.name!r} is not stated and not clear from its "
                f"values (step {step:g}, from {self.cells[0]} to {self.cells[-1]})"
            )
        return possible[0], f"step {step:g}, about {span:g} long"


def _date_form(cells: Sequence[str], unit: str | None) -> str | None:
    """Name of the date form most cells start with, None for none; "dmy|mdy" where both fit.

    "dmy|ymd" where the year, of two digits, may stand in front: "24/05/13", not "24.05.13".
    """
    fits = {
        form
        for form, date in _DATES.items()
        if _share(cells, f"{date}(?:{_GAP}{_CLOCK}{_ZONE})?") >= _READABLE
    }
    if not fits & {"dmy", "mdy"}:
        return next((form for form in _DATES if form in fits), None)
    if unit in ("dmy", "mdy"):
        return unit if unit in fits else None
    found = [re.match(r"([0-9]{1,2})[./-]([0-9]{1,2})", c) for c in cells]
    pairs = [(int(m[1]), int(m[2])) for m in found if m]
    if "mdy" not in fits or ("dmy" in fits and any(a > 12 for a, _ in pairs)):
        short = r"[0-9]{2}([/-])[0-9]{1,2}\1(?:[0-2][0-9]|3[01])(?![0-9]).*"
        return "dmy|ymd" if _share(cells, short) >= _READABLE else "dmy"
    return "mdy" if any(b > 12 for _, b in pairs) else "dmy|mdy"


def _stamp_clock(search: _Search, i: int, why: str) -> Clock | None:
    """A column of stamps as a time, with the column of the other half of date and time."""
    dialect = search.dialect
    cells = dialect.column(i)
    columns = [i]
    form = _date_form(cells, search.unit)
    date_only = bool(form) and _share(cells, _ANY_DATE) >= _READABLE
    clock_only = not form and _share(cells, _ANY_CLOCK) >= _READABLE
    if date_only:
        partner = _partner(dialect, i, i + 1, CLOCK, _ANY_CLOCK)
        if partner is None:
            return None
        columns = [i, partner]
    elif clock_only:
        partner = _partner(dialect, i, i - 1, DATE, _ANY_DATE)
        if partner is not None:
            columns = [partner, i]
            form = _date_form(dialect.column(partner), search.unit)
    if form:
        return _dated_clock(search, i, columns, form, why)
    return _undated_clock(search, i, clock_only, why)


def _partner(
    dialect: Dialect, i: int, next_to: int, words: frozenset[str], pattern: str
) -> int | None:
    """The column with the other half of date and time: by name, else the neighbour."""
    order = [k for k, n in enumerate(dialect.names) if k != i and is_named(n, words)]
    order += [next_to] if 0 <= next_to < len(dialect.names) else []
    return next((k for k in order if _share(dialect.column(k), pattern) >= _READABLE), None)


def _dated_clock(search: _Search, i: int, columns: list[int], form: str, why: str) -> Clock:
    """The clock of date and time in `columns`.

    Raises:
        UserError: where the order of day, month and year is open.
    """
    dialect = search.dialect
    names = " + ".join(repr(dialect.names[k]) for k in columns)
    cells = [dialect.column(k) for k in columns]
    if "|" in form:
        other = form == "dmy|ymd"
        orders = "day/month/year or year/month/day" if other else "day/month or month/day"
        raise UserError(
            f"{search.path}: {cells[0][0]!r} in {names} may be {orders}",
            f'state it, as time = {{channel = {toml(dialect.names[i])}, unit = "dmy"}} '
            + ("under [channels], or export the year with four digits" if other
               else '(or "mdy") under [channels]'),
        )  # fmt: skip
    pattern = f"{_DATES[form]}{_GAP}{_CLOCK}{_ZONE}"
    whole = (" ".join(p) for p in zip(*cells, strict=False))
    zones = [m["z"] for c in whole if (m := re.fullmatch(pattern, c))]
    notes: tuple[Finding, ...] = ()
    if missing := sum(not zone for zone in zones):
        note = Finding(
            "time-zone-missing", "info", channel=dialect.names[i],
            values={"share": missing / len(zones)}, names={"columns": names},
        )  # fmt: skip
        notes = (note,)
    types: tuple[Any, ...] = (pa.string(),)
    plain = [_CANONICAL.fullmatch(c) for c in dialect.column(i)]
    if len(columns) == 1 and all(plain):
        with_zone = {bool(m[1]) for m in plain if m}
        if len(with_zone) == 1:
            types = (pa.timestamp("ns", "UTC" if with_zone.pop() else None), pa.string())
    reason = f"{why}; {'date and time in' if len(columns) == 2 else 'stamps in'} {names} ({form})"
    return Clock(tuple(columns), "", pattern, dialect.decimal, True, reason, types, notes)


def _undated_clock(search: _Search, i: int, clock_only: bool, why: str) -> Clock | None:
    """The clock of times of day or durations; None where the column has neither.

    Raises:
        UserError: where times of day may be hours and minutes, or minutes and seconds.
    """
    cells, name = search.dialect.column(i), search.dialect.names[i]
    reason = f"{why}; time of day in {name!r}, without a date"
    if clock_only:
        pattern = _CLOCK + _ZONE
        if not any(c.count(":") > 1 for c in cells):
            raise UserError(
                f"{search.path}: {cells[0]!r} in {name!r} may be hours and minutes or minutes "
                "and seconds",
                "export the time with hours, minutes and seconds",
            )
    elif _share(cells, _SHORT_CLOCK) >= _READABLE:
        pattern = _SHORT_CLOCK
    elif found := next((d for d in _DURATIONS if _share(cells, d) >= _READABLE), None):
        pattern, reason = found, f"{why}; durations in {name!r}"
    else:
        return None
    return Clock((i,), "", pattern, search.dialect.decimal, False, reason)
