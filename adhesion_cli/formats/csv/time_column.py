"""Which column of a table is the time, in which form and unit, decided from its first rows."""

import math
import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa

from ...core import toml, units
from ...core.errors import UserError
from ...core.finding import Finding
from ..number_text import number_grammar, number_of, unit_behind
from ..source import TAKEN_AS_UTC, ReadOptions
from . import header_words
from .cells import COUNTS, GPS, Clock, count_of
from .dialect import Dialect, is_null, stamps_in
from .header_words import NS_PER_UNIT, interval_s, label, speaks_of_time, time_name, time_unit
from .lines import read_tail
from .stamps import CLOCKS, DATES, DIGITS, SHORT_STAMPS, STAMPS, as_counted, decided, forms_of, read

_DATES = ("iso", "ymd", "dmy", "mdy")  # stated units of columns of dates
TIME_UNITS = (*COUNTS, *_DATES)

_S = 1_000_000_000
_DAY, _MINUTE, _ZONE_STEP = 86_400 * _S, 60 * _S, 900 * _S
_UNDATED = ", without a date"
_EPOCH_S = (946_684_800.0, 2_840_140_800.0)  # 2000 to 2060
_GPS_END_S = 1_893_456_000.0  # 2030: what would be later as GPS time counts from 1970
_STEP_S = (5e-5, 2.0)  # sampling periods of brake logs, for times whose unit is not stated
_SPAN_S = (3.0, 100_000.0)  # and their lengths
_SLOW_S = 10.0  # steps that no brake log has
_LATEST_S = 1e6  # of times in minutes, hours or days from any start
_YEAR_2040_S = 2_208_988_800.0  # later numbers of days would be those of other calendars
_SAME_RATE = 0.02  # two clocks whose rates differ by less are one
_ROWS_PER_STAMP = 4  # with fewer, a row without a stamp has lost it
_MOST_DATES = 8  # of a log
_SECONDS = r"(?P<n>-)?(?P<S>[0-9]{1,10})[.,](?P<f>[0-9]+)"
_DIGITS = {"y": 4, "S": 10, "l": 3, "u": 6, "N": 9}  # of a part of the time, else 2
_ORDERS = {"dmy": "day/month", "mdy": "month/day", "yymd": "year/month/day"}


def find_clock(dialect: Dialect, options: ReadOptions, rows: float, path: Path) -> Clock:
    """Decides which column is the time, in which form and unit, and why.

    `rows` estimates those of the whole file.

    Raises:
        UserError: where no column is a time, or its unit or order of day and month is open.
    """
    unit = options.time_unit
    if unit is not None and unit not in TIME_UNITS and not time_unit(unit):
        hint = f"{_stated_time('')}; known: {', '.join(TIME_UNITS)}"
        raise UserError(f"unknown time unit {unit!r}", hint, code=2)
    search = _ClockSearch(dialect, unit, rows, path)
    clock = search.of_parts()
    if options.time_channel is not None:
        i = column_index(dialect, options.time_channel, path)
        if clock is None or i not in clock.columns:
            clock = search.clock(i, "stated")
        if not clock:
            raise search.unreadable(i)
    if clock:
        return search.begun(clock)
    named = search.named()
    text_columns = [i for i in named if not dialect.is_numeric(i)]
    clock = search.first_clock(named, "column named")
    if clock is None and not text_columns:
        clock = search.first_clock(search.likely(), "time by its cells or unit: column")
    clock = clock or search.counted()
    if clock is None and named:
        raise search.unreadable((text_columns or named)[0])
    if clock is None:
        text = f"{path}: no column is a time (columns: {', '.join(map(repr, dialect.names[:12]))})"
        raise UserError(text, search.proposal())
    search.refuse_another(clock)
    clock = search.begun(search.with_date(search.counted_on(clock)))
    is_sparse = bool(clock.pattern) and all(map(search.stands_apart, clock.columns))
    return replace(clock, is_sparse=is_sparse)


def find_pairs(dialect: Dialect, rows: float, path: Path) -> list[tuple[Clock, range]]:
    """The times of a table in which each stands before its own channels; none of another table.

    They are named alike, or begin together: else nobody knows whether they count from one start.

    Returns:
        Each clock, with the columns whose time it is.
    """
    search, names = _ClockSearch(dialect, None, rows, path), dialect.names
    alike = [k for k, name in enumerate(names) if _unnumbered(name) == _unnumbered(names[0])]
    units_of_names = enumerate(zip(names, map(time_unit, dialect.units), strict=True))
    times = [k for k, (x, u) in units_of_names if u or speaks_of_time(x) or _named(dialect, k)]
    begins = alike if len(alike) > 1 and {*alike} <= {*times} else times
    columns = [range(a + 1, b) for a, b in pairwise([*begins, len(names)])]
    if len(begins) < 2 or begins[0] or not all(columns):
        return []
    try:
        clocks = [search.clock(k, f"column named {names[k]!r}") for k in begins]
    except UserError:
        return []
    begun = [search.begun(clock) for clock in clocks if clock]
    firsts = [search.first_time(clock) for clock in begun]
    if len(begun) < len(begins) or (begins is times and np.ptp(firsts) > _S):
        return []
    return list(zip(begun, columns, strict=True))


def another_time(dialect: Dialect, clock: Clock, rows: float, path: Path) -> str:
    """What to do where the columns of a clock hold no times: another column, if one may be it."""
    return _ClockSearch(dialect, None, rows, path).proposal(without=clock.columns)


def column_index(dialect: Dialect, name: str, path: Path) -> int:
    """Column of a name: the header text, one of its parts if unique, or "column N".

    Raises:
        UserError: for a name that no column has.
    """
    names = list(dialect.names)
    if name in names:
        return names.index(name)
    numbers = [f"column {k}" for k in range(1, len(names) + 1)]
    folded = [n.casefold().strip() for n in names]
    in_rows = ((cells, name) for cells in reversed(dialect.header_cells))
    for texts, text in ((numbers, name), (folded, name.casefold().strip()), *in_rows):
        if texts.count(text) == 1:
            return texts.index(text)
    hint = f'columns: {", ".join(map(repr, names[:20]))}; or by number, as "column 1"'
    raise UserError(f"{path}: no column {name!r}", hint)


def _stated_time(channel: str, unit: str = "s") -> str:
    """How a user states the time's column and unit."""
    entry = toml.table({"channel": channel, "unit": unit})
    return f"state it, as {toml.option(f'channels.time = {entry}')}"


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
        columns = range(len(dialect.names) * dialect.headed)
        ranks = {i: name[0] for i in columns if (name := _named(dialect, i))}
        is_constant = {i: len(dialect.rows) > 2 and len(set(dialect.column(i))) < 2 for i in ranks}
        return sorted(ranks, key=lambda i: (is_constant[i], ranks[i]))

    def likely(self) -> list[int]:
        """Columns of stamps, then those that rise and whose name or unit speaks of time."""
        dialect, forms = self.dialect, CLOCKS | STAMPS
        columns = {i: dialect.column(i) for i in range(len(dialect.names) * dialect.headed)}
        varying = {i: cells for i, cells in columns.items() if len({*cells}) > 1}
        stamps = [i for i, cells in varying.items() if forms_of(cells, forms, self.unit)]
        dates = [i for i, cells in columns.items() if forms_of(cells, DATES)]
        rising = [i for i in columns if _rises(dialect, i)]
        shown = {i: self._shown_unit(i, dialect.numbers(i), None) for i in rising}
        counts = {i: COUNTS[x[0]] for i, x in shown.items() if x}
        sure = [i for i, x in counts.items() if x.ns == NS_PER_UNIT["d"] or x.at_1970 > 1e12]
        return [*stamps, *dates, *(i for i in rising if i in sure or _says_time(dialect, i))]

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
        # digits may be a date and a time
        if self.dialect.is_numeric(i) and not forms_of(cells, STAMPS):
            return self._of_digits(i, reason) or self._of_numbers(i, reason)
        return self._of_stamps(i, reason)

    def counted(self) -> Clock | None:
        """The clock of rows without a time, whose interval or rate stands above the table."""
        labels = self.dialect.labels
        for kind in ("interval", "rate"):
            cells = [c for c in labels.get(kind, [])[1:] if c]
            if not cells:
                continue
            suffix = unit_behind(cells[0])
            texts = [suffix, *labels.get("interval_unit", []), *cells[1:], labels[kind][0]]
            step_s = interval_s(kind, number_of(cells[0].removesuffix(suffix)) or 0.0, texts)
            if _STEP_S[0] <= step_s <= _STEP_S[1]:
                step = round(_S * step_s)
                reason = f"rows are counted; {step_s:g} s apart by {labels[kind][0]!r}"
                return Clock((), "", "", self.dialect.decimal, False, reason, step=step)
        return None

    def begun(self, clock: Clock) -> Clock:
        """The clock; with the date or the start above the table, where these give it one.

        A time of day takes the date, a time that counts from about 0 the start. With a note where
        the start contradicts the first row, or its day and month may be exchanged.
        """
        text, patterns = self._stamp_above()
        columns = [self.dialect.column(i) for i in clock.columns]
        is_digits = clock.may_be_digits and forms_of(columns[0], DIGITS)
        if not patterns or is_digits or not all(columns):
            return clock
        first_time = self.first_time(clock)
        starts = {int(read([text], x)[0]) for x in patterns}
        start = min(starts)
        begin: int | None = start
        is_zoned, kind = False, "date"
        if "<H>" in patterns[0]:
            kind, match = "start", re.fullmatch(patterns[0], text)
            is_zoned = bool(match and match["z"])
            begin = _begin(clock, first_time, start, is_zoned)
        elif clock.absolute or "<H>" not in clock.pattern or not _MINUTE < first_time < _DAY:
            return clock
        if clock.absolute and (begin is not None or len(starts) > 1):
            return clock
        if len(starts) > 1:
            problem = "it may be day/month or month/day"
        elif begin is None:
            problem = f"the first row is at {' '.join(x[0] for x in columns)}"
        else:
            zone = "" if is_zoned else f", {TAKEN_AS_UTC}"
            reason = clock.reason.removesuffix(_UNDATED)
            reason += f"; {kind} {text} above the table{zone}"
            return replace(clock, start=begin, absolute=True, reason=reason)
        note = Finding("start-not-used", "info", names={"start": text, "problem": problem})
        return replace(clock, findings=(*clock.findings, note))

    def first_time(self, clock: Clock) -> int:
        """The time of the first row [ns], 0 where rows are counted."""
        cells = [pa.array(self.dialect.column(i)[:1]) for i in clock.columns]
        return int(clock.nanoseconds(cells)[0][0]) if cells else 0

    def _stamp_above(self) -> tuple[str, list[str]]:
        """Start or date that the lines above the table state, and the patterns that read it."""
        stamps = stamps_in(self.dialect.preamble, self.dialect.delimiter)
        labelled = [(kind, x) for text, x in stamps.items() if (kind := label(text))]
        halves = {kind.replace("day", "date"): x for kind, x in reversed(labelled)}
        date, clock = halves.get("date", ""), halves.get("clock", "")
        whole_stamps = [x for kind, x in labelled if kind in ("date", "day", "clock")]
        for forms, texts in (STAMPS, [*whole_stamps, f"{date} {clock}"]), (DATES, [date]):
            for text in texts:
                if names := forms_of([text], forms, self.unit):
                    return text, [forms[name] for name in names]
        return "", []

    def counted_on(self, clock: Clock) -> Clock:
        """The clock; of stamps that rows share, a time in a known unit that counts on from them."""
        dialect, stamped = self.dialect, self._joined(clock.columns)
        columns = [dialect.column(k) for k in clock.columns]
        has_all_rows = all(len(cells) == len(stamped) for cells in columns)
        if not clock.pattern or not has_all_rows or 2 * len(set(stamped)) > len(stamped):
            return clock
        stamps, ok = clock.nanoseconds([pa.array(cells) for cells in columns])
        search = replace(self, unit=None) if self.unit in _DATES else self  # it is the stamps'
        for i, name in enumerate(dialect.names):
            if not _rises(dialect, i) or not _says_time(dialect, i):
                continue
            try:
                relative = search._said_unit(i) and search._of_numbers(i, f"column named {name!r}")
            except UserError:  # its unit is in doubt
                continue
            if not relative or relative.absolute or not ok.all():
                continue
            times, _ = relative.nanoseconds([pa.array(dialect.column(i))])
            if len(times) == len(stamps) and np.ptp(offsets := stamps - times) <= _S:
                reason = f"{relative.reason}; start by {clock.reason}"
                notes = (*clock.findings, *relative.findings)
                start = int(offsets.max())  # the stamps are rounded down
                relative = replace(relative, start=start, reason=reason, findings=notes)
                return replace(relative, absolute=clock.absolute)
        return clock

    def with_date(self, clock: Clock) -> Clock:
        """The clock; a time of day with its first date, where most rows have none.

        With a note where a date is lost that no form reads.
        """
        is_clock = "<H>" in clock.pattern and not clock.absolute
        for i, name in enumerate(self.dialect.names):
            cells = self.dialect.column(i)
            forms = forms_of(cells, DATES, self.unit) if is_clock and self.stands_apart(i) else []
            if forms and self._is_first_day(i, clock):
                form, order, other_form = self._order((i,), forms, DATES)
                begin = int(read(cells[:1], DATES[form])[0])
                reason = clock.reason.removesuffix(_UNDATED)
                reason += f" on the date in {name!r} ({form}{order}; {TAKEN_AS_UTC})"
                notes = self._dates(i, f"- {form}", f"- {other_form}") if other_form else ()
                findings = (*clock.findings, *notes)
                return replace(clock, start=begin, absolute=True, reason=reason, findings=findings)
            if label(name) == "date" and cells and i not in clock.columns and not clock.absolute:
                note = Finding("date-not-read", "info", name, names={"example": cells[0][:40]})
                return replace(clock, findings=(*clock.findings, note))
        return clock

    def of_parts(self) -> Clock | None:
        """The clock of columns from year to second, or of seconds and a fraction of them."""
        dialect, columns = self.dialect, dict[str, int]()
        for i, name in enumerate(dialect.names):
            if field := header_words.time_part(name):
                columns.setdefault(field, i)
        fraction = [field for field in "lNu" if field in columns][:1]
        wholes = ("ymdHMS", "HMS", "S" * len(fraction))
        whole_fields = next((p for p in wholes if {*p} <= {*columns}), "")
        fields = [*whole_fields, *fraction]
        used_columns = tuple(columns[field] for field in fields)
        patterns = [rf"(?P<{p}>[0-9]{{1,{_DIGITS.get(p, 2)}}})(?:[.,]0*)?" for p in fields]
        if not fraction:
            patterns[-1:] = [r"(?P<S>[0-9]{1,2})(?:[.,](?P<f>[0-9]+))?"]
        pattern = " ".join(patterns)
        cells = self._joined(used_columns) if whole_fields else []
        if not forms_of(cells, {"": pattern}) or (np.diff(read(cells, pattern)) < 0).any():
            return None
        if not fraction and not re.search("[.,]", cells[-1]) and len(set(cells)) < len(cells):
            return None
        names = " + ".join(repr(dialect.names[i]) for i in used_columns)
        absolute = "y" in fields or read(cells[:1], pattern)[0] >= _EPOCH_S[0] * _S
        reason = f"parts of the time in {names}"
        return Clock(used_columns, "", pattern, dialect.decimal, absolute, reason)

    def _joined(self, columns: Sequence[int]) -> list[str]:
        """The cells of several columns, joined by blanks, of rows that have all of them."""
        rows = ([row[k] for k in columns] for row in self.dialect.rows)
        return [" ".join(cells) for cells in rows if not any(map(is_null, cells))]

    def refuse_another(self, clock: Clock) -> None:
        """Refuses a second time of another rate: nobody says which channels belong to it.

        A column of a similar name ("time1" and "time2") need only hold other times.

        Raises:
            UserError: names both.
        """
        dialect, i = self.dialect, (clock.columns or (-1,))[-1]
        for k, name in enumerate(dialect.names):
            if k in clock.columns or i < 0 or dialect.column(k) == dialect.column(i):
                continue
            named = _named(dialect, k) is not None
            similar = _unnumbered(name) == _unnumbered(dialect.names[i])
            if similar and (named or _rises(dialect, k)):
                differs = True
            elif named or (speaks_of_time(name) and _says_time(dialect, k)):  # no temperature
                differs = _runs_apart(dialect, i, k, not (named or _named(dialect, i)))
            else:
                continue
            if differs:
                raise UserError(
                    f"{self.path}: {dialect.names[i]!r} and {name!r} are both times, and differ: "
                    "which columns belong to which is not clear",
                    "give the times one name, and write each before its channels; or export all "
                    "channels on one time axis; or, if all that are needed belong to one, "
                    + _stated_time(f"column {i + 1}", ""),
                )

    def _of_numbers(self, i: int, choice: str) -> Clock | None:
        """The clock of a column of numbers; None where it is not a time."""
        dialect, name = self.dialect, self.dialect.names[i]
        values = [v for v in dialect.numbers(i) if math.isfinite(v)]
        falls = sum(b < a for a, b in pairwise(values))
        said = self._said_unit(i)
        if falls and (not said or said[0] == "s"):
            pattern = as_counted(dialect.column(i), _SECONDS)
            if pattern != _SECONDS:
                reason = f"{choice}; s, with a fraction that has no leading zeros"
                return Clock((i,), "", pattern, ".", False, reason)
        if not values or (not said and 0.3 * len(values) < falls < 0.9 * (len(values) - 1)):
            return None  # a T that is a temperature
        if said and said[0] in _DATES:
            return None
        unit_source = self._shown_unit(i, values, said) or said
        unit, source = unit_source or self._plausible_unit(i, values)
        notes: tuple[Finding, ...] = ()
        if not unit_source:
            names = {"column": repr(name), "unit": unit, "reason": source}
            notes = (Finding("time-unit-guessed", "info", name, names=names),)
        if source != "stated" and (gps := self._gps(name, unit, values[0])):
            unit, note = gps
            notes = (*notes, note)
        count = count_of(unit)
        absolute = bool(count.at_1970) or count.seconds(values[0]) >= _EPOCH_S[0]
        is_slow = unit == "s" and source != "stated" and _step(values) >= _SLOW_S and not absolute
        if is_slow and "ms" in self._usual_units(values):
            text = f"{self.path}: time column {name!r} says s, and has steps of {_step(values):g} "
            text += f"s: the log would be {self._length(values):g} s long"
            raise UserError(text, f"{self.proposal(i, values)} (or s)")
        epoch = "Unix epoch, " if absolute else ""
        reason = f"{choice}; {count.name or epoch + unit} ({source})"
        if count.seconds(values[0]) > (2**62 / _S if source == "stated" else _EPOCH_S[1]):
            text = f"{self.path}: times in column {name!r} in {unit} ({source}) would lie beyond "
            text += f"the year 2060 ({dialect.column(i)[0]})"
            raise UserError(text, self.proposal(i, values))
        return Clock((i,), unit, "", dialect.mark(i), absolute, reason, notes)

    def _gps(self, name: str, unit: str, first: float) -> tuple[str, Finding] | None:
        """The count of times that may be GPS's, ten years apart, and a note; None for others."""
        if unit not in GPS or not _EPOCH_S[0] <= COUNTS[unit].seconds(first):
            return None
        is_gps = "gps" in name.casefold() and "utc" not in name.casefold()
        is_possible = COUNTS[GPS[unit]].seconds(first) < _GPS_END_S
        if not is_gps and not is_possible:
            return None
        is_gps &= is_possible
        taken, other_unit = (GPS[unit], unit) if is_gps else (unit, GPS[unit])
        titles = ("Unix time", "GPS time")
        names = {"taken": titles[is_gps], "other": titles[not is_gps]}
        names["option"] = toml.option(f"channels.time.unit = {toml.quoted(other_unit)}")
        return taken, Finding("time-gps", "info", name, names=names)

    def proposal(
        self, i: int | None = None, values: Sequence[float] = (), without: Sequence[int] = ()
    ) -> str:
        """What to do about a time in doubt: a column and a unit with a usual rate, if there is one.

        The column is `i`, with these first values; else the first that rises, `without` some.
        """
        columns = range(len(self.dialect.names)) if i is None else [i]
        for k in (k for k in columns if k not in without):
            numbers = values or (self.dialect.numbers(k) if _rises(self.dialect, k) else [])
            if i is None and set(np.diff(numbers)) == {1.0}:  # they count rows
                stated = _stated_time(self.dialect.names[k], "20 ms")
                return f"if the rows of {self.dialect.names[k]!r} are 20 ms apart, {stated}"
            shown_unit = self._shown_unit(k, [*numbers], None) if numbers else None
            units = [shown_unit[0]] if shown_unit else []
            units = units or self._usual_units(numbers) or self._usual_units(numbers, 0.0)
            if units:
                other_units = f" (or {', '.join(units[1:])})" * (len(units) > 1)
                return f"{_stated_time(self.dialect.names[k], units[0])}{other_units}"
        return "export the log with a column of times, in seconds or as 2026-11-21 13:05:07.250"

    def unreadable(self, i: int) -> UserError:
        """The refusal of a column that is stated, or named, as the time."""
        cells = self.dialect.column(i)
        text = f"{self.path}: column {self.dialect.names[i]!r} holds no times that can be read"
        hint = "export it in seconds, or as 2026-11-21 13:05:07.250"
        if self.unit:
            hint += f"; or state its unit, one of {', '.join(COUNTS)}"
        return UserError(text + (f", as {cells[0][:40]!r}" if cells else ""), hint)

    def _said_unit(self, i: int) -> tuple[str, str] | None:
        """The unit that the user, the units row or the header states, and which of them."""
        if self.unit:
            return self.unit, "stated"
        name, named = self.dialect.names[i], _named(self.dialect, i)
        said = {self.dialect.unit_source: time_unit(self.dialect.units[i])}
        said["header"] = (named[1] if named else None) or time_unit(units.in_name(name)[1])
        sources = {unit: source for source, unit in said.items() if unit}
        if len(sources) > 1:
            text = " and ".join(f"{unit!r} ({source})" for unit, source in sources.items())
            text = f"the unit of time column {name!r} is stated twice: {text}"
            raise UserError(f"{self.path}: {text}", self.proposal(i, self.dialect.numbers(i)))
        return next(iter(sources.items()), None)

    def _shown_unit(
        self, i: int, values: list[float], said: tuple[str, str] | None
    ) -> tuple[str, str] | None:
        """The count in which times lie in our days, and why; only of the length that is `said`."""
        edges, step = (values[0], values[-1]), _step(values)
        cells = self.dialect.column(i)
        fine_cells = sum(len(re.split("[.,]", c)[-1]) >= 6 for c in cells if re.search("[.,]", c))
        for unit, count in COUNTS.items():
            if said and (said[1] == "stated" or count.ns != count_of(said[0]).ns):
                continue
            if unit in GPS.values():  # nothing but a name tells them from Unix time
                continue
            is_day = count.ns == NS_PER_UNIT["d"]
            is_possible = count.at_1970 if is_day else count.ns <= _S
            if not is_possible or (is_day and not said and fine_cells <= len(cells) / 2):
                continue
            latest = _YEAR_2040_S if is_day and not said else _EPOCH_S[1]
            in_our_days = all(_EPOCH_S[0] <= count.seconds(v) <= latest for v in edges)
            longest = 2.0 if count.at_1970 and not is_day else 60.0
            if in_our_days and step * count.ns / _S <= longest:
                return unit, said[1] if said else f"{count.name or 'epoch'} by its magnitude"
        return None

    def _plausible_unit(self, i: int, values: list[float]) -> tuple[str, str]:
        """The only unit in which a brake log could have this step and length, and why."""
        step = _step(values)
        possible = [u for u in self._usual_units(values) if NS_PER_UNIT[u] <= _S]
        # fractions of milliseconds would be a rate above 1 kHz
        if _STEP_S[0] <= step < 1 and any(v != int(v) for v in values):
            possible = ["s"]
        if len(possible) != 1:
            cells = self.dialect.column(i)
            text = f"the unit of time column {self.dialect.names[i]!r} is not stated and not clear "
            text += f"from its values (step {step:g}, from {cells[0]} to {cells[-1]})"
            raise UserError(f"{self.path}: {text}", self.proposal(i, values))
        return possible[0], f"step {step:g}, about {self._length(values):g} long"

    def _length(self, values: Sequence[float]) -> float:
        """The length of the log by the first of its times."""
        return (values[-1] - values[0]) / max(len(values) - 1, 1) * max(self.rows - 1, 1)

    def _usual_units(self, values: Sequence[float], shortest_s: float = _SPAN_S[0]) -> list[str]:
        """Units in which these times are those of a brake log, none beyond 2060."""
        if not values:
            return []
        step, length = _step(values), self._length(values)
        return [
            u
            for u in ("ms", "s", "us", "ns", "min", "h", "d")
            if _STEP_S[0] <= step * NS_PER_UNIT[u] / _S <= _STEP_S[1]
            and shortest_s <= length * NS_PER_UNIT[u] / _S <= _SPAN_S[1]
            and COUNTS[u].seconds(values[-1]) <= (_LATEST_S if NS_PER_UNIT[u] > _S else _EPOCH_S[1])
        ]

    def _of_stamps(self, i: int, choice: str) -> Clock | None:
        """The clock of stamps, with the column of the other half of date and time, or None."""
        cells = self.dialect.column(i)
        if forms_of(cells, DATES) and (k := self._partner(i, i + 1, CLOCKS)) is not None:
            columns, forms = ((k,), CLOCKS) if self.stands_apart(i) else ((i, k), STAMPS)
            return self._stamped(columns, forms, choice)
        if not forms_of(cells, CLOCKS):
            return self._stamped((i,), STAMPS, choice)
        if (k := self._partner(i, i - 1, DATES)) is not None:
            return self._stamped((k, i), STAMPS, choice)
        return self._beside_date(i, choice) or self._stamped((i,), CLOCKS, choice)

    def _beside_date(self, i: int, choice: str) -> Clock | None:
        """The clock of a time of day beside a column named as a date; None where there is none."""
        dates = (k for k, x in enumerate(self.dialect.names) if k != i and label(x) == "date")
        k = next((k for k in dates if not self.stands_apart(k)), None)
        forms = (STAMPS, SHORT_STAMPS) if k is not None else ()
        clocks = (self._stamped((k or 0, i), x, choice) for x in forms)
        return next(filter(None, clocks), None)

    def _of_digits(self, i: int, choice: str) -> Clock | None:
        """The clock of digits, HHMMSS, beside a date, or of whole seconds beside milliseconds."""
        cells, names = self.dialect.column(i), self.dialect.names
        is_clock = bool(forms_of(cells, DIGITS))
        if is_clock and (dated := self._beside_date(i, choice)):
            return dated
        said = self._said_unit(i)
        pattern = DIGITS["digits"] if is_clock and not said else "(?P<S>[0-9]{1,10})"
        columns, pattern = self._with_fraction((i,), pattern)
        t = read(self._joined(columns), pattern)
        is_whole = len(columns) > 1 and len(set(cells)) < len(cells)
        if not is_whole or (said and said[0] != "s") or (np.diff(t) < 0).any():
            return None
        absolute = bool(t[0] >= _EPOCH_S[0] * _S)
        reason = f"{choice}; with a fraction in {names[columns[1]]!r}"
        return Clock(columns, "", pattern, self.dialect.decimal, absolute, reason)

    def _stamped(
        self, columns: tuple[int, ...], forms: Mapping[str, str], choice: str
    ) -> Clock | None:
        """The clock of stamps in these columns, joined; None where they are none."""
        dialect = self.dialect
        order = None if forms is CLOCKS else self.unit
        form_names = forms_of(self._joined(columns), forms, order)
        if not form_names:
            return None
        form, order, other_form = self._order(columns, form_names, forms)
        names = " + ".join(repr(dialect.names[k]) for k in columns)
        reason = f"{choice}; time of day in {names}{_UNDATED}"
        pattern = as_counted(self._joined(columns), forms[form])
        is_dated = forms is not CLOCKS
        if is_dated:
            matches = (re.fullmatch(pattern, c) for c in self._joined(columns))
            is_zoned = all(m.groupdict().get("z") for m in matches if m)
            zone = "" if is_zoned else f"; {TAKEN_AS_UTC} where no zone is stated"
            date = form.split()[1].replace("yymd", "ymd")
            reason = f"{choice}; date and time in {names} ({date}{order}{zone})"
        notes = self._dates(columns[0], form, other_form) if other_form else ()
        columns, pattern = self._with_fraction(columns, pattern)
        return Clock(columns, "", pattern, dialect.decimal, is_dated, reason, notes)

    def _dates(self, i: int, form: str, other_form: str) -> tuple[Finding, ...]:
        """The note that a date may be another one."""
        dates = (x.split()[1] for x in (form, other_form))
        taken_order, other_order = (_ORDERS.get(x, "year/month/day") for x in dates)
        option = toml.option(f"channels.time.unit = {toml.quoted(other_form[-3:])}")
        names = {"taken": taken_order, "other": other_order, "option": option}
        names["example"] = self.dialect.column(i)[0]
        return (Finding("date-order-guessed", "info", self.dialect.names[i], names=names),)

    def _with_fraction(self, columns: tuple[int, ...], pattern: str) -> tuple[tuple[int, ...], str]:
        """Columns and pattern of stamps without a fraction, with a column of it if there is one."""
        fields = {header_words.time_part(name): i for i, name in enumerate(self.dialect.names)}
        field = next((p for p in "lNu" if p in fields and fields[p] not in columns), None)
        has_fraction = re.compile(r"[0-9][.,]0*[1-9][0-9]*\D*$").search
        if field is None or any(map(has_fraction, self._joined(columns))):
            return columns, pattern
        longer = (*columns, fields[field])
        unnamed = re.sub(r"\?P<[flu]>", "?:", pattern)
        with_part = rf"{unnamed} (?P<{field}>[0-9]{{1,{_DIGITS[field]}}})"
        is_read = forms_of(self._joined(longer), {"": with_part})
        return (longer, with_part) if is_read else (columns, pattern)

    def _order(
        self, columns: Sequence[int], names: list[str], forms: Mapping[str, str]
    ) -> tuple[str, str, str]:
        """The form of the stamps in these columns, what decided between several, and another."""
        cells = self._joined(columns)
        if len(names) > 1:
            rows = ([row[k] for k in columns] for row in read_tail(self.path, self.dialect))
            cells += [" ".join(row) for row in rows if not any(map(is_null, row))]
            names = [name for name in forms_of(cells, forms, self.unit) if name in names] or names
        if len(names) < 2:
            return names[0], "", ""
        if decided_form := decided(cells, {name: forms[name] for name in names}):
            return decided_form[0], f": {decided_form[1]}", decided_form[2]
        column, dates = self.dialect.names[columns[0]], [name.split()[-1] for name in names]
        alternatives = " or ".join(toml.quoted(date[-3:]) for date in dates[1:])
        readings = " or ".join(_ORDERS.get(date, date) for date in dates)
        hint = f"{_stated_time(column, dates[0][-3:])} (or {alternatives})"
        raise UserError(f"{self.path}: {cells[0]!r} in {column!r} may be {readings}", hint)

    def _partner(self, i: int, neighbour: int, forms: Mapping[str, str]) -> int | None:
        """The column with the other half of date and time; the neighbour is preferred."""
        for k in sorted(range(len(self.dialect.names)), key=lambda k: k != neighbour):
            cells = self.dialect.column(k)
            is_date = forms is not CLOCKS
            if k == i or (is_date and (self.stands_apart(k) or len(set(cells)) > _MOST_DATES)):
                continue
            if forms_of(cells, forms):
                return k
        return None

    def _is_first_day(self, i: int, clock: Clock) -> bool:
        """Whether no midnight is before the first date of a column."""
        rows_before = next(k for k, row in enumerate(self.dialect.rows) if not is_null(row[i]))
        times = read(self._joined(clock.columns)[: rows_before + 1], clock.pattern)
        return bool((np.diff(times) >= 0).all())

    def stands_apart(self, i: int) -> bool:
        """Whether the cells of a column stand alone, with rows without one between them."""
        has_cell = [not is_null(row[i]) for row in self.dialect.rows]
        rare = _ROWS_PER_STAMP * sum(has_cell) <= len(has_cell) + _ROWS_PER_STAMP
        return rare and not any(a and b for a, b in pairwise(has_cell))


def _begin(clock: Clock, first_time: int, start: int, is_zoned: bool) -> int | None:
    """What dates times [ns] of a clock by their start; None where the first row contradicts it."""
    period = _ZONE_STEP if is_zoned or clock.absolute else _DAY  # zones differ by quarters
    lag = (first_time - start + period // 2) % period - period // 2
    if clock.absolute:
        return 0 if abs(lag) <= _MINUTE and abs(first_time - start) < _DAY else None
    if abs(lag) <= _MINUTE and ("<H>" in clock.pattern or abs(first_time) > _MINUTE):
        return start + lag - first_time
    return start if abs(first_time) <= _MINUTE else None


def _step(values: Sequence[float]) -> float:
    """The median step of the times that rise, 0 where none does."""
    return statistics.median([b - a for a, b in pairwise(values) if b > a] or [0.0])


def _runs_apart(dialect: Dialect, i: int, k: int, offset: bool) -> bool:
    """Whether two columns rise at rates that no unit explains, or begin apart if `offset`."""
    pairs = [(row[i], row[k]) for row in dialect.rows if not (is_null(row[i]) or is_null(row[k]))]
    number = number_grammar(dialect.decimal)
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


def _unnumbered(name: str) -> str:
    return re.sub(r"[\s_.]*\(?[0-9]+\)?(?=\W*\w*\W*$)", "", name).strip()
