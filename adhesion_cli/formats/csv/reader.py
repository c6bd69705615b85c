"""Delimited text logs: their fields, their columns, and findings about their rows and cells."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from ...core import toml
from ...core.errors import UserError
from ...core.finding import Finding
from ...core.model import Column, Times
from ...core.time_axis import earliest, from_digits
from ...core.units import in_name
from ...core.units import unit as known_unit
from ..number_text import is_number
from ..source import Field, ReadOptions, Source, distinct_words
from .block_parser import CsvTable
from .detect_dialect import detect_dialect
from .dialect import Dialect, stamps_in
from .header_words import VALUE, is_named, label, time_name
from .lines import read_head
from .long_table import LongSeries, find_keys, interleaved
from .rows import CsvRows, quoted, read_rows
from .stamps import CLOCKS, STAMPS, forms_of, is_stamp, parse
from .time_column import another_time, find_clock, find_pairs

_START = re.compile("(?i)start|begin|trigger|d[eé]but|inizio|inicio|开始|開始")
_HEX = re.compile("[0-9A-F]{2,}h?")
_NUMERIC = 0.2  # of a column's cells in the head: below, it is a column of words
_DIGITS = re.compile(r"[+-]?[0-9][0-9.,' ]*([^\d\s.,].*)?")  # perhaps with a unit behind them
_MEASURED = ("pressure", "speed", "angular speed", "force", "acceleration")


def open_csv(path: Path, options: ReadOptions, name: str = "") -> "CsvSource":
    """Opens a delimited text log, plain or compressed.

    `name` is that of the log in messages, if it is not its path.

    Raises:
        UserError: where the file is no such table, or can be read in more than one way.
    """
    with _named(path, name):
        head, complete, size = read_head(path)
        dialect = detect_dialect(head, complete, options, path)
        if complete and len(dialect.rows) < 2:
            hint = "give a log of several rows"
            raise UserError(f"{path}: {len(dialect.rows)} data row, nothing to analyse", hint)
        if not dialect.headed and options.time_channel is None:
            raise _headerless(dialect, path)
        rows = size / len(head) * (head.count(b"\n") or head.count(b"\r"))
    return open_table(path, dialect, rows, options, name)


def open_table(
    path: Path, dialect: Dialect, rows: float, options: ReadOptions, name: str = ""
) -> "CsvSource":
    """Opens a text log whose dialect is known.

    `rows` estimates those of the whole file; `name` is as above.

    Raises:
        UserError: where no column is a time, or it can be read in more than one way.
    """
    with _named(path, name):
        try:
            clock = find_clock(dialect, options, rows, path)
        except UserError:
            pairs = [] if options.time_channel else find_pairs(dialect, rows, path)
            tables = [CsvTable(path, options, dialect, *pair) for pair in pairs]
            if not tables:
                raise
            first_source, *others = [CsvSource(table, name) for table in tables]
            return first_source.with_others(others)
        return CsvSource(CsvTable(path, options, dialect, clock), name)


@contextmanager
def _named(path: Path, name: str) -> Iterator[None]:
    """An error in a file is one in the log of this name, if it has one."""
    try:
        yield
    except UserError as error:
        error.text = error.text.replace(str(path), name or str(path))
        raise


class CsvSource(Source):
    """A delimited text log; `lines` counts its lines by what became of them, after `columns`."""

    format = "csv"
    remedy = "correct the log, or read it without --strict"

    def __init__(self, table: CsvTable, name: str) -> None:
        dialect, clock = table.dialect, table.clock
        super().__init__(table.path, table.options)
        self.absolute, self.time_reason, self.rows = clock.absolute, clock.reason, 0
        self.findings += clock.findings
        self.lines: Counter[str] = Counter()
        self.others: Sequence[CsvSource] = ()
        self.folder: object = None  # with the text of a log of another format
        self.table, self._dialect, self._clock, self._name = table, dialect, clock, name
        self.keys = find_keys(self.table)
        self._series = list(self.keys.series.values()) or [LongSeries()]
        self.findings += self.keys.findings
        names = dialect.names
        reserved = {*clock.columns, *self.keys.columns}
        reserved |= {i for i in range(len(names)) if self._repeats_time(i)}
        data_columns = [i for i in table.columns or range(len(names)) if i not in reserved]
        numeric = [i for i in data_columns if self._is_numeric(i)]
        values = [i for i in numeric if is_named(names[i], VALUE)]
        if values and self._series[0].signal:  # beside the values stand their quality and such
            data_columns, numeric = values, values
        text = [i for i in data_columns if i not in numeric]
        has_states = len(self._series) == 1 and dialect.headed
        words = {i: distinct_words(dialect.column(i)) for i in text if has_states}
        self._words = {i: x for i, x in words.items() if x}
        self.places = self._fields(numeric)  # number of the series, and column
        self.fields = list(self.places)
        self.texts = [Field(names[i], words=x, column=i + 1) for i, x in self._words.items()]
        self.places |= zip(self.texts, ((0, i) for i in self._words), strict=True)
        self.reasons |= dialect.reasons
        self.reasons["time"] = clock.reason
        if not_numeric := [names[i] for i in text if i not in self._words]:
            self.reasons["not numeric"] = ", ".join(not_numeric)
        for i in text:
            self._report_text(i)
        if self.keys.columns:
            keys = " and ".join(repr(names[i]) for i in self.keys.columns)
            self.reasons["group"] = f"{keys}: {'; '.join(x.title for x in self._series)}"
        elif key := interleaved(dialect, clock.columns):
            self.report(key)

    def with_others(self, others: "Sequence[CsvSource]") -> "CsvSource":
        """The source, with the channels of others, which have times of their own."""
        self.others = others
        for other in others:
            self.fields = [*self.fields, *other.fields]
            self.texts = [*self.texts, *other.texts]
            self.reasons["time"] = self.time_reason = f"{self.time_reason}; {other.time_reason}"
        return self

    def _fields(self, numeric: Sequence[int]) -> dict[Field, tuple[int, int]]:
        """Each column of numbers once for each series, with the numbers of series and column."""
        places = {}
        for k, series in enumerate(self._series):
            for i in numeric:
                name = self._dialect.names[i]
                channel = series.signal or name
                if series.signal and len(numeric) > 1:
                    channel += f" {name}"
                unit = self._dialect.units[i]
                source = "cells" if i in self._dialect.removals else self._dialect.unit_source
                if in_column := series.unit or self._dialect.unit_beside(i):
                    unit, source = in_column, "units column"
                unit_from = source if unit else ""
                f = Field(channel, "", "", series.group, unit, unit_from, signal=series.signal)
                places[replace(f, column=i + 1)] = k, i
        return places

    def _repeats_time(self, i: int) -> bool:
        """Whether a column is the time once more, as LVM files have it for each channel."""
        times = [self._dialect.column(k) for k in self._clock.columns]
        is_named = any(time_name(cells[i]) for cells in self._dialect.header_cells)
        return is_named and self._dialect.column(i) in times

    def _report_text(self, i: int) -> None:
        """Reports a column that should hold numbers by its unit, or by the digits in its cells."""
        name, cells = self._dialect.names[i], {*self._dialect.column(i)}
        matches = (m for c in cells if not is_stamp(c) and (m := _DIGITS.fullmatch(c)))
        digits = sum(not m[1] or _is_measured(m[1]) for m in matches)
        has_unit = _is_measured(self._dialect.units[i] or in_name(name)[1])
        if cells and (has_unit or digits > max(1, len(cells) / 2)):
            first, *others = self._dialect.column(i)
            names = {"example": quoted(first)}
            self.report(Finding("csv-no-numbers", "warning", name, 1 + len(others), names=names))

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, see `Source`; a row without a time is left out."""
        with _named(self.table.path, self._name):
            own_fields = [f for f in wanted if f in self.places]
            own_columns = self._columns(own_fields) if own_fields else []
        columns = dict(zip(own_fields, own_columns, strict=True))
        for other in self.others:
            table_fields = [f for f in wanted if f in other.places]
            table_columns = other.columns(table_fields) if table_fields else []
            columns |= zip(table_fields, table_columns, strict=True)
            self.rows = max(self.rows, other.rows)
            self.report(*other.findings)
        return [columns[f] for f in wanted]

    def _columns(self, wanted: Sequence[Field]) -> list[Column]:
        indices = {self.places[f][1] for f in wanted}
        numeric, texts = sorted(indices - self._words.keys()), sorted(indices & self._words.keys())
        read = read_rows(self.table, numeric, self.keys.columns, list(self.keys.series), texts)
        t, codes = self._of_digits(self._of_segments(read)), read.codes
        self.lines = Counter({kind: n for kind, n in read.losses.lines.items() if n})
        self.rows = self.lines["used"] + self.lines["other group"]
        self._refuse_time(t)
        self.report(*read.losses.findings(t, earliest(t)))
        if read.lines.damage:
            spans, names = (((int(t[-1]) - earliest(t)) / 1e9,) * 2,), {"damage": read.lines.damage}
            values = {"line": sum(self.lines.values())}
            self.report(Finding("csv-gzip-damaged", "error", "", 1, spans, values, names))
        if read.lines.is_unfinished:
            self.report(Finding("csv-no-final-newline", "info"))
        lossy = {i for i, _ in read.losses.cells} | set(read.losses.unread)
        rows = []  # of each of several series, in the log's own order
        if (n := len(self._series)) > 1:
            order = np.argsort(codes, kind="stable")
            rows = np.split(order, np.searchsorted(codes, np.arange(1, n), sorter=order))
        times: dict[int, Times] = {}
        read_columns = []
        for f in wanted:
            k, i = self.places[f]
            value = read.values[i]
            if rows:
                value = value[rows[k]]
                times.setdefault(k, t[rows[k]])
            words = tuple(read.words.get(i, ()))
            valid = np.isfinite(value) if words or i in lossy else np.ones(len(value), np.bool_)
            read_columns.append(Column(times.get(k, t), value, valid, words))
        return read_columns

    def _of_segments(self, read: CsvRows) -> Times:
        """The times; where they begin anew below each header, after the clock that it states."""
        t, rows = read.times, np.array([row for row, _ in read.segments])
        begins = rows[(rows > 0) & (rows < len(t))]
        if not len(begins) or (t[begins] >= t[begins - 1]).any():
            return t
        first_stamps = stamps_in(self._dialect.preamble, self._dialect.delimiter)
        labels = {kind: key for key in first_stamps if (kind := label(key))}
        stamped = [first_stamps, *(stamps for _, stamps in read.segments)]
        has_both = {"date", "clock"} <= labels.keys()
        keys: list[tuple[str, ...]] = [(labels["date"], labels["clock"])] if has_both else []
        keys += [(key,) for key in first_stamps if _START.search(key) or key in labels.values()]
        for key in keys:
            cells = [" ".join(stamps.get(x, "") for x in key) for stamps in stamped]
            forms = forms_of(cells, STAMPS | CLOCKS)
            if not forms:
                continue
            starts, ok = parse(pa.array(cells), (STAMPS | CLOCKS)[forms[0]])
            offsets = starts[1:] - starts[0]
            shifts = np.append(0, offsets)[np.searchsorted(rows, np.arange(len(t)), side="right")]
            shifted = np.asarray(t + shifts)
            if ok.all() and (shifted[begins] >= shifted[begins - 1]).all():
                return shifted
        return t

    def _of_digits(self, t: Times) -> Times:
        """The times; those of a clock in digits that is read as a number are a time of day."""
        times = from_digits(t) if self._clock.may_be_digits else None
        if times is None:
            return t
        i = self._clock.columns[0]
        clock = self._clock.in_digits(self._dialect.names[i], self._dialect.column(i)[0])
        self.time_reason = self.reasons["time"] = clock.reason
        earlier = {*self._clock.findings, *clock.findings}
        self.findings = [*clock.findings, *(f for f in self.findings if f not in earlier)]
        return times

    def _refuse_time(self, t: Times) -> None:
        """Refuses times that never change, or nearly always fall."""
        if self._clock.step:
            return
        i = self._clock.columns[-1]
        name, cells = self._dialect.names[i], self._dialect.column(i)
        falls = np.count_nonzero(t[1:] < t[:-1])
        if not falls and t[0] == t[-1]:
            subject = f"all {len(t)} rows have" if len(t) > 1 else "only one row has a time,"
            text = f"the clock stands still: {subject} {cells[0]!r} in column {name!r}"
            hint = another_time(self._dialect, self._clock, self.rows, self.table.path)
            raise UserError(f"{self.table.path}: {text}", hint)
        if falls > 0.9 * (len(t) - 1) > 1:
            text = f"time column {name!r} runs backwards (from {cells[0]} to {cells[-1]})"
            hint = "export the rows in the order of time, the oldest first; nothing is sorted here"
            raise UserError(f"{self.table.path}: {text}", hint)

    def _is_numeric(self, i: int) -> bool:
        """Whether a column holds numbers in the head; an empty one may later, if it has a name."""
        cells = self._dialect.column(i)
        if not cells and self._dialect.names[i] == f"column {i + 1}":
            return not self._dialect.headed
        numbers = [*filter(is_number, cells)]
        is_aligned = len(numbers) < len(cells) and len({*map(len, cells)}) == 1
        if is_aligned and all(map(_HEX.fullmatch, cells)):
            return False
        has_unit = self._dialect.units[i] or in_name(self._dialect.names[i])[1]
        if len(numbers) < len(cells) and {*numbers} <= {"0", "1"} and not has_unit:
            return False  # states, as "0" and "ein"
        return len(numbers) >= _NUMERIC * len(cells)

    def is_loss(self, finding: Finding) -> bool:
        """Whether it says that something was left out."""
        return finding.severity != "info" and finding.code != "devices-interleaved"


def _is_measured(text: str) -> bool:
    unit = known_unit(text)
    return unit is not None and unit.dimension in _MEASURED


def _headerless(dialect: Dialect, path: Path) -> UserError:
    """The refusal of a table without names of columns, with the mapping to write."""
    first_row = dialect.rows[0]
    half = len(dialect.rows) / 2
    columns = zip(*dialect.rows, strict=True)
    number_counts = [sum(map(is_number, cells)) for cells in columns]
    stamps = [k for k, cell in enumerate(first_row, 1) if is_stamp(cell) and not is_number(cell)]
    numeric = [k for k, n in enumerate(number_counts, 1) if n > half and k not in stamps]
    time, *channels = [*stamps[:1], *numeric] or [0]
    place = f"(line {dialect.first_line}: {', '.join(first_row[:4])}{', …' * (len(first_row) > 4)})"
    if not channels:
        hint = "export the log as a table with a row of names"
        return UserError(f"{path}: has no header row and no columns of numbers {place}", hint)
    unit = "" if stamps else ", unit = 's'"
    lines = [f"channels.time = {{channel = {time}{unit}}}"]
    keys = ("pressure", "bar"), ("speed", "km/h")
    for (name, unit), k in zip(keys, dict.fromkeys((channels[0], channels[-1])), strict=False):
        lines.append(f"channels.{name} = {{channel = {k}, unit = '{unit}'}}")
    hint = f"state its columns by number, as {toml.option(*lines)}"
    return UserError(f"{path}: has no header row {place}", hint)
