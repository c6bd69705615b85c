"""Which column of a table is the time, in which form and unit, decided from its first rows."""

import math
import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow as pa

from ...core import toml, units
from ...core.errors import UserError
from ...core.finding import Finding
from ..source import ReadOptions
from .clock import EXCEL_DAYS, SCALE, Clock
from .dates import ANY_DATE, CLOCK, DATES, FORM_NAMES, GAP, READABLE, decided, forms_of
from .dialect import Dialect, is_null
from .header_words import NS_PER_UNIT, speaks_of_time, time_name, time_unit
from .lines import read_tail

_DATED = ("iso", "ymd", "dmy", "mdy")  # a column of dates, and the order of their numbers
TIME_UNITS = (*NS_PER_UNIT, *_DATED, "excel")

_S = 1_000_000_000
_EPOCH_S = (946_684_800.0, 2_840_140_800.0)  # 2000 to 2060
_STEP_S = (5e-5, 2.0)  # sampling periods of brake logs, for times whose unit is not stated
_SPAN_S = (3.0, 100_000.0)  # and their lengths
_SAME_RATE = 0.02  # two clocks whose rates differ by less are one
_CANONICAL = re.compile(  # stamps that Arrow reads itself
    r"[0-9]{4}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?"
    r"(Z|[+-][0-9]{2}:[0-9]{2})?"
)


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
        hint = f"{_stated_time('')}; known: {', '.join(TIME_UNITS)}"
        raise UserError(f"unknown time unit {unit!r}", hint, code=2)
    search = _ClockSearch(dialect, unit, rows, path)
    if options.time_channel is not None:
        i = column_index(dialect, options.time_channel, path)
        if clock := search.clock(i, "stated"):
            return clock
        raise _unreadable(dialect, i, path)
    named = search.named()
    text_columns = [i for i in named if len(dialect.numbers(i)) < len(dialect.column(i)) / 2]
    clock = search.first_clock(named, "column named")
    if clock is None and not text_columns:
        clock = search.first_clock(search.likely(), "time by its cells or unit: column")
    if clock is None and named:
        raise _unreadable(dialect, (text_columns or named)[0], path)
    if clock is None:
        text = f"{path}: no column is a time (columns: {', '.join(map(repr, dialect.names[:12]))})"
        raise UserError(text, _stated_time("NAME"))
    search.refuse_another(clock)
    return clock


def column_index(dialect: Dialect, name: str, path: Path) -> int:
    """Column of a name: the header text, one of its parts if unique, or "column N".

    Raises:
        UserError: for a name that no column has.
    """
    names = list(dialect.names)
    if name in names:
        return names.index(name)
    if (numbered := re.fullmatch(r"column ([0-9]+)", name)) and 1 <= int(numbered[1]) <= len(names):
        return int(numbered[1]) - 1
    folded = [n.casefold().strip() for n in names]
    if folded.count(name.casefold().strip()) == 1:
        return folded.index(name.casefold().strip())
    for cells in reversed(dialect.header_cells):
        if cells.count(name) == 1:
            return cells.index(name)
    hint = f'columns: {", ".join(map(repr, names[:20]))}; or by number, as "column 1"'
    raise UserError(f"{path}: no column {name!r}", hint)


def listed(names: Iterable[str], limit: int = 6) -> str:
    """Names as a message lists them: the first ones, and how many there are."""
    quoted_names = [repr(n) for n in names]
    return ", ".join(quoted_names[:limit]) + (
        f", … ({len(quoted_names)})" if len(quoted_names) > limit else ""
    )


def _stated_time(channel: str, unit: str = "s") -> str:
    """How a user states the time's column and unit."""
    entry = toml.table({"channel": channel, "unit": unit})
    return f"state it, as {toml.option(f'channels.time = {entry}')}"


def _unreadable(dialect: Dialect, i: int, path: Path) -> UserError:
    """The refusal of a column that is stated, or named, as the time."""
    cells = dialect.column(i)
    return UserError(
        f"{path}: column {dialect.names[i]!r} holds no times that can be read"
        + (f", as {cells[0][:40]!r}" if cells else ""),
        "export it in seconds, or as 2026-11-21 13:05:07.250; if another column is the time, "
        f"{_stated_time('NAME')} (unit: one of {', '.join(TIME_UNITS)})",
    )


@dataclass(frozen=True, slots=True)
class _ClockSearch:
    """Reads columns as times."""

    dialect: Dialect
    unit: str | None  # stated
    rows: float  # of the whole file, estimated
    path: Path

    def named(self) -> list[int]:
        """Columns whose name says that they are the time, the likeliest first."""
        dialect = self.dialect
        matches = []
        for i in range(len(dialect.names) * dialect.headed):
            if name := _named(dialect, i):
                constant = len(dialect.rows) > 2 and len(set(dialect.column(i))) < 2
                matches.append((constant, name[0], i))
        return [i for _, _, i in sorted(matches)]

    def likely(self) -> list[int]:
        """Columns of stamps, then those that rise and whose name or unit speaks of time."""
        dialect = self.dialect
        columns = range(len(dialect.names) * dialect.headed)
        stamps = [i for i in columns if forms_of(dialect.column(i), self.unit)]
        stamps += [i for i in columns if _share(dialect.column(i), CLOCK) >= READABLE]
        return stamps + [i for i in columns if _says_time(dialect, i) and _rises(dialect, i)]

    def first_clock(self, columns: Sequence[int], reason: str) -> Clock | None:
        """The first of these columns that can be read as a time.

        Raises:
            UserError: where none can, and why the first of them is in doubt.
        """
        doubt: UserError | None = None
        for i in columns:
            try:
                if clock := self.clock(i, f"{reason} {self.dialect.names[i]!r}"):
                    return clock
            except UserError as error:
                doubt = doubt or error
        if doubt:
            raise doubt
        return None

    def clock(self, i: int, reason: str) -> Clock | None:
        """The column read as a time, None where it is not one."""
        cells = self.dialect.column(i)
        if not cells:
            return None
        if len(self.dialect.numbers(i)) >= READABLE * len(cells):
            return self._of_numbers(i, reason)
        return self._of_stamps(i, reason)

    def refuse_another(self, clock: Clock) -> None:
        """Refuses a second time of another rate: nobody says which channels belong to it.

        A column of a similar name ("time1" and "time2") need only hold other times.

        Raises:
            UserError: names both.
        """
        dialect, i = self.dialect, clock.columns[-1]
        for k, name in enumerate(dialect.names):
            if k in clock.columns or dialect.column(k) == dialect.column(i):
                continue
            named = _named(dialect, k) is not None
            similar = _unnumbered(name) == _unnumbered(dialect.names[i])
            if similar and (named or _rises(dialect, k)):
                differs = True
            elif named or speaks_of_time(name):
                differs = _runs_apart(dialect, i, k, not (named or _named(dialect, i)))
            else:
                continue
            if differs:
                text = (
                    f"{self.path}: {dialect.names[i]!r} and {name!r} are both times, and differ: "
                )
                text += "the log does not state which columns belong to which"
                hint = "export all channels on one time axis; or, if all columns that are needed "
                hint += f"belong to one, {_stated_time(f'column {i + 1}', '')}"
                raise UserError(text, hint)

    def _of_numbers(self, i: int, choice: str) -> Clock | None:
        """The clock of a column of numbers; None where it is not a time.

        Raises:
            UserError: where its unit is open.
        """
        dialect, name = self.dialect, self.dialect.names[i]
        values = [v for v in dialect.numbers(i) if math.isfinite(v)]
        falls = sum(b < a for a, b in pairwise(values))
        said = self._said_unit(i)
        if not values or (not said and 0.3 * len(values) < falls < 0.9 * (len(values) - 1)):
            return None  # a T that is a temperature
        unit_source = said or self._shown_unit(i, values)
        unit, source = unit_source or self._plausible_unit(i, values)
        if unit in _DATED:
            return None
        absolute = unit == "excel" or values[0] * NS_PER_UNIT[unit] / _S >= _EPOCH_S[0]
        kind: Any = pa.float64()
        if unit == "excel":
            reason = f"{choice}; Excel serial days ({source})"
        else:
            reason = f"{choice}; {'Unix epoch, ' if absolute else ''}{unit} ({source})"
            seconds = values[0] * NS_PER_UNIT[unit] / _S
            if seconds > (2**62 / _S if source == "stated" else _EPOCH_S[1]):
                text = f"times in column {name!r} in {unit} ({source}) would lie beyond the year "
                raise self._refusal(i, f"{text}2060 ({dialect.column(i)[0]})")
            if absolute and unit in SCALE:
                kind = pa.decimal128(38, SCALE[unit])
        names = {"column": repr(name), "unit": unit, "reason": source}
        note = Finding("time-unit-guessed", "info", name, names=names)
        notes = () if unit_source else (note,)
        return Clock((i,), unit, "", dialect.decimal, absolute, reason, kind, notes)

    def _refusal(self, i: int, text: str) -> UserError:
        units = f"(unit: one of {', '.join(NS_PER_UNIT)}, excel)"
        hint = f"{_stated_time(self.dialect.names[i], 'ms')} {units}"
        return UserError(f"{self.path}: {text}", hint)

    def _said_unit(self, i: int) -> tuple[str, str] | None:
        """The unit that the user, the units row or the header states, and which of them.

        Raises:
            UserError: where header and units row state different ones.
        """
        if self.unit:
            return self.unit, "stated"
        name, named = self.dialect.names[i], _named(self.dialect, i)
        said = {"units row": time_unit(self.dialect.units[i])}
        said["header"] = (named[1] if named else None) or time_unit(units.in_name(name)[1])
        sources = {unit: source for source, unit in said.items() if unit}
        if len(sources) > 1:
            text = " and ".join(f"{unit!r} ({source})" for unit, source in sources.items())
            raise self._refusal(i, f"the unit of time column {name!r} is stated twice: {text}")
        return next(iter(sources.items()), None)

    def _shown_unit(self, i: int, values: list[float]) -> tuple[str, str] | None:
        """The unit in which times lie in our days, and why."""
        edges, step = (values[0], values[-1]), _step(values)
        cells = self.dialect.column(i)
        fine_cells = sum(len(re.split("[.,]", c)[-1]) >= 6 for c in cells if re.search("[.,]", c))
        lowest, highest = EXCEL_DAYS
        if fine_cells > len(cells) / 2 and lowest <= edges[0] <= highest and step * 86_400 <= 60:
            return "excel", f"serial days between {lowest} and {highest}"
        for u in ("s", "ms", "us", "ns"):
            second = _S // NS_PER_UNIT[u]
            in_our_days = all(_EPOCH_S[0] <= v / second <= _EPOCH_S[1] for v in edges)
            if in_our_days and step / second <= 60:
                return u, "epoch by its magnitude"
        return None

    def _plausible_unit(self, i: int, values: list[float]) -> tuple[str, str]:
        """The only unit in which a brake log could have this step and length, and why.

        Raises:
            UserError: where there are several, or none.
        """
        step = _step(values)
        span = (values[-1] - values[0]) / max(len(values) - 1, 1) * max(self.rows - 1, 1)
        possible = []
        for u in ("s", "ms", "us", "ns"):
            step_s, span_s = (x * NS_PER_UNIT[u] / _S for x in (step, span))
            if _STEP_S[0] <= step_s <= _STEP_S[1] and _SPAN_S[0] <= span_s <= _SPAN_S[1]:
                possible.append(u)
        # fractions of milliseconds would be a rate above 1 kHz
        if _STEP_S[0] <= step < 1 and any(v != int(v) for v in values):
            possible = ["s"]
        if len(possible) != 1:
            cells = self.dialect.column(i)
            text = f"the unit of time column {self.dialect.names[i]!r} is not stated and not clear "
            text += f"from its values (step {step:g}, from {cells[0]} to {cells[-1]})"
            raise self._refusal(i, text)
        return possible[0], f"step {step:g}, about {span:g} long"

    def _of_stamps(self, i: int, choice: str) -> Clock | None:
        """The clock of stamps, with the column of the other half of date and time; None for none.

        Raises:
            UserError: where day/month and month/day are possible.
        """
        dialect, columns = self.dialect, [i]
        time_only = _share(dialect.column(i), CLOCK) >= READABLE
        if time_only and (date := self._partner(i, i - 1, ANY_DATE)) is not None:
            columns = [date, i]
        elif _share(dialect.column(i), ANY_DATE) >= READABLE:
            if (time := self._partner(i, i + 1, CLOCK)) is None:
                return None
            columns = [i, time]
        names = " + ".join(repr(dialect.names[k]) for k in columns)
        forms = forms_of(dialect.column(columns[0]), self.unit)
        if not forms:
            reason = f"{choice}; time of day in {names}, without a date"
            clock = Clock((i,), "", CLOCK, dialect.decimal, False, reason, pa.string())
            return clock if time_only else None
        form, order = self._order(columns[0], forms)
        kind: Any = pa.string()
        canonical = [_CANONICAL.fullmatch(c) for c in dialect.column(i)]
        with_zone = {bool(m and m[1]) for m in canonical}
        if len(columns) == 1 and all(canonical) and len(with_zone) == 1:
            kind = pa.timestamp("ns", "UTC" if True in with_zone else None)
        zone = "" if kind.equals(pa.timestamp("ns", "UTC")) else "; UTC where no zone is stated"
        reason = f"{choice}; date and time in {names} ({form[-3:]}{order}{zone})"
        pattern = f"{DATES[form]}{GAP}{CLOCK}"
        return Clock(tuple(columns), "", pattern, dialect.decimal, True, reason, kind)

    def _order(self, i: int, forms: list[str]) -> tuple[str, str]:
        """The form of the dates in a column, and what decided between several.

        Raises:
            UserError: where nothing does.
        """
        name, cells = self.dialect.names[i], self.dialect.column(i)
        if len(forms) > 1:
            tail = read_tail(self.path, self.dialect)
            cells += [c for row in tail if not is_null(c := row[i])]
            forms = [form for form in forms_of(cells, self.unit) if form in forms]
        if len(forms) < 2:
            return forms[0], ""
        if decided_form := decided(cells, forms):
            return decided_form[0], f": {decided_form[1]}"
        alternatives = " or ".join(toml.quoted(form[-3:]) for form in forms[1:])
        readings = " or ".join(FORM_NAMES[form] for form in forms)
        hint = f"{_stated_time(name, forms[0][-3:])} (or {alternatives})"
        raise UserError(f"{self.path}: {cells[0]!r} in {name!r} may be {readings}", hint)

    def _partner(self, i: int, neighbour: int, pattern: str) -> int | None:
        """The column with the other half of date and time; the neighbour is preferred."""
        columns = sorted(range(len(self.dialect.names)), key=lambda k: k != neighbour)
        cells = ((k, self.dialect.column(k)) for k in columns if k != i)
        return next((k for k, column in cells if _share(column, pattern) >= READABLE), None)


def _step(values: list[float]) -> float:
    """The median step of the times that rise, 0 where none does."""
    return statistics.median([b - a for a, b in pairwise(values) if b > a] or [0.0])


def _runs_apart(dialect: Dialect, i: int, k: int, offset: bool) -> bool:
    """Whether two columns rise at rates that no unit explains, or begin apart if `offset`."""
    pairs = [(row[i], row[k]) for row in dialect.rows if not (is_null(row[i]) or is_null(row[k]))]
    number = dialect.number()
    if len(pairs) < 3 or not all(number.fullmatch(c) for pair in pairs for c in pair):
        return False
    t, u = ([float(c.replace(",", ".")) for c in column] for column in zip(*pairs, strict=True))
    if not all(b > a for times in (t, u) for a, b in pairwise(times)):
        return False
    rate = (u[-1] - u[0]) / (t[-1] - t[0])
    if not 1e-12 < rate < 1e12:
        return True
    scale = 10.0 ** round(math.log10(rate))
    lag = abs(rate / scale - 1.0)
    return lag > max(_SAME_RATE, 2.0 / len(t)) or (offset and u[0] != t[0] * scale)


def _named(dialect: Dialect, i: int) -> tuple[int, str | None] | None:
    """Rank and unit of a column whose name is a time's."""
    texts = (dialect.names[i], *(cells[i] for cells in reversed(dialect.header_cells)))
    return next((named_time for text in texts if (named_time := time_name(text))), None)


def _says_time(dialect: Dialect, i: int) -> bool:
    """Whether a column's name speaks of time and has no other unit, or its unit is one of time."""
    name = dialect.names[i]
    unit = dialect.units[i] or units.in_name(name)[1] or units.unknown_in(name)
    return bool(time_unit(unit or name) or (speaks_of_time(name) and not unit))


def _rises(dialect: Dialect, i: int) -> bool:
    """Whether a column's numbers rise strictly."""
    values = dialect.numbers(i)
    if len(values) < max(3, len(dialect.column(i))):
        return False
    return all(b > a for a, b in pairwise(values))


def _share(cells: Sequence[str], pattern: str) -> float:
    return sum(bool(re.fullmatch(pattern, c)) for c in cells) / max(len(cells), 1)


def _unnumbered(name: str) -> str:
    return re.sub(r"[\s_.]*\(?[0-9]+\)?(?=\W*\w*\W*$)", "", name).strip()
