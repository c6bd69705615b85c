"""Delimited text logs: their fields, their columns, and findings about their rows and cells.

`detect_dialect` decides how the log is written, `time_column` which column is the time, and
`long_table` which rows belong together. `rows` reads the wanted columns.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ...core.errors import UserError
from ...core.finding import Finding, merged
from ...core.model import Column, Reject, Times
from ...core.time_axis import earliest, unwrapped
from ...core.units import in_name
from ...core.units import unit as known_unit
from ..source import Field, ReadOptions
from .block_parser import Table
from .clock import Clock, backwards
from .detect_dialect import detect_dialect
from .dialect import Dialect, is_null, number_grammar
from .lines import read_head, read_tail
from .long_table import Series, find_keys, interleaved
from .losses import quoted
from .rows import Reading, read_rows
from .time_column import find_clock, listed, toml

_NUMERIC = 0.2  # of a column's cells in the head: below, it is a column of words
_MEASURED = ("pressure", "speed", "angular speed", "force", "acceleration")
_HALF_DAY = 43_200 * 1_000_000_000


def open_csv(path: Path, options: ReadOptions) -> "CsvSource":
    """Opens a delimited text log, plain or gzip.

    Args:
        path: the log.
        options: what the user stated; it has priority over what the file suggests.

    Raises:
        UserError: where the file is no such table, or can be read in more than one way.
    """
    head, complete, size = read_head(path)
    dialect = detect_dialect(head, complete, options, path)
    if complete and len(dialect.rows) < 2:
        raise UserError(
            f"{path}: {len(dialect.rows)} data row, nothing to analyse",
            "give a log of several rows",
        )
    if not dialect.headed and options.time_channel is None:
        raise _headerless(dialect, path)
    rows = size / len(head) * (head.count(b"\n") or head.count(b"\r"))
    return CsvSource(path, options, dialect, find_clock(dialect, options, rows, path), int(rows))


class CsvSource:
    """A delimited text log, opened; implements `Source`.

    `lines` counts the lines of the file by what became of them, complete after `columns`.
    """

    format = "csv"

    def __init__(
        self, path: Path, options: ReadOptions, dialect: Dialect, clock: Clock, expected: int
    ) -> None:
        self.path = path
        self.absolute = clock.absolute
        self.time_reason = clock.reason
        self.rows = 0
        self.findings: list[Finding] = list(clock.findings)
        self.metadata = {"preamble": dialect.metadata} if dialect.metadata else {}
        self.account: dict[str, str] = {}
        self.lines: Counter[str] = Counter()
        self.rejects: Iterable[Reject] = ()
        self._options, self._dialect, self._clock = options, dialect, clock
        types = dict.fromkeys(clock.columns, clock.types)
        self._table = Table(path, options, dialect, clock, types, {}, expected)
        self._keys = find_keys(self._table)
        self._series = list(self._keys.series.values()) or [Series()]
        self.findings += self._keys.findings
        names = dialect.names
        taken = {*clock.columns, *self._keys.columns}
        self._tail = read_tail(path, dialect)
        for i in range(len(names)):
            if unit := _unit_in(dialect.column(i), dialect.decimal):
                types[i], self._table.units[i] = (pa.string(),), unit
        free = [i for i in range(len(names)) if i not in taken]
        numeric = [i for i in free if self._is_numeric(i)]
        self._places = self._fields(numeric)  # number of the series, and column
        self.fields: list[Field] = list(self._places)
        self.stated: dict[str, Any] = dict(dialect.why)
        self.stated["time"] = clock.reason
        if text := [i for i in free if i not in numeric]:
            self.stated["not numeric"] = ", ".join(names[i] for i in text)
        for i in text:
            self._report_text(i)
        if self._keys.columns:
            keys = " and ".join(repr(names[i]) for i in self._keys.columns)
            self.stated["group"] = f"{keys}: {'; '.join(x.title for x in self._series)}"
        if dialect.duplicates:
            self._report(
                Finding(
                    "csv-duplicate-names", "info", count=len(dialect.duplicates),
                    names={"columns": listed(dialect.duplicates)},
                )
            )  # fmt: skip
        if not self._keys.columns and (found := interleaved(dialect, clock.columns)):
            self._report(found)

    def _fields(self, numeric: Sequence[int]) -> dict[Field, tuple[int, int]]:
        """Each column of numbers once for each series, with the numbers of series and column."""
        places = {}
        for k, series in enumerate(self._series):
            for i in numeric:
                name = self._dialect.names[i]
                channel = series.signal or name
                if series.signal and len(numeric) > 1:
                    channel += f" {name}"
                unit, source = self._dialect.units[i], "units row"
                if series.unit:
                    unit, source = series.unit, "units column"
                elif i in self._table.units:
                    unit, source = self._table.units[i], "cells"
                source = source if unit else ""
                one = Field(
                    channel, group=series.group, unit=unit, unit_from=source, signal=series.signal
                )
                places[one] = k, i
        return places

    def _report_text(self, i: int) -> None:
        """Reports a column of words that looks as if it should hold numbers."""
        name, cells = self._dialect.names[i], self._dialect.column(i)
        if self._other_decimal(i):
            decimal = {"decimal": repr(self._dialect.decimal)}
            self._report(Finding("csv-mixed-decimals", "warning", channel=name, names=decimal))
            return
        unit = known_unit(self._dialect.units[i] or in_name(name)[1])
        if cells and unit and unit.dimension in _MEASURED:
            self._report(
                Finding(
                    "csv-no-numbers", "warning", channel=name, count=len(cells),
                    names={"example": quoted(cells[0])},
                )
            )  # fmt: skip

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, in that order, rows in the log's own order, time untouched.

        A cell that holds no number is NaN with `valid` False; a row without a time is left out.
        Fields of one group share one time array.

        Raises:
            UserError: where the log cannot be read, with file, place and remedy; with
                `ReadOptions.strict` also where a row or cell cannot.
        """
        indices = sorted({self._places[f][1] for f in wanted})
        read = read_rows(self._table, indices, self._keys.columns, list(self._keys.series))
        t, codes, values, losses = read.times, read.codes, read.values, read.losses
        self.lines = Counter({kind: n for kind, n in losses.lines.items() if n})
        self.rows = losses.lines["used"] + losses.lines["other group"]
        self.rejects = losses.rejects or ()
        self._refuse_time(t)
        self._report_reading(read)
        order = np.argsort(codes, kind="stable")  # each series in the log's own order
        bounds = np.searchsorted(codes, np.arange(len(self._series) + 1), sorter=order)
        times: dict[int, Times] = {}
        out = []
        for f in wanted:
            k, i = self._places[f]
            value = values[i]
            if len(codes):
                rows = order[bounds[k] : bounds[k + 1]]
                value = value[rows]
                times.setdefault(k, t[rows])
            whole = not any(column == i for column, _ in losses.cells)
            valid = np.ones(len(value), np.bool_) if whole else np.isfinite(value)
            out.append(Column(times.get(k, t), value, valid))
        return out

    def _refuse_time(self, t: Times) -> None:
        """Refuses times that never change, always fall, or are hours and minutes."""
        i = self._clock.columns[-1]
        name, cells = self._dialect.names[i], self._dialect.column(i)
        if self._clock.is_packed(t, cells):
            raise UserError(
                f"{self.path}: time column {name!r} writes hours, minutes and seconds as one "
                f"number, as {cells[0]!r}",
                "export it in seconds, or as 12:34:56.7",
            )
        falls = np.count_nonzero(t[1:] < t[:-1])
        if not falls and t[0] == t[-1]:
            what = f"all {len(t)} rows have" if len(t) > 1 else "only one row has a time,"
            raise UserError(
                f"{self.path}: the clock stands still: {what} {cells[0]!r} in column {name!r}",
                "state another column, as time = {channel = …} under [channels], or log anew",
            )
        if falls > 0.9 * (len(t) - 1) > 1:
            raise backwards(self.path, name, cells)

    def _is_numeric(self, i: int) -> bool:
        """Whether a column holds numbers: in the head, or else near the end of the file."""
        if i in self._table.units:
            return True
        cells = self._dialect.column(i)
        if not cells and self._dialect.names[i] == f"column {i + 1}":
            return not self._dialect.headed  # an empty column without a name
        number = self._dialect.number()
        late = [c for row in self._tail if not is_null(c := row[i])]
        return any(
            sum(bool(number.fullmatch(c)) for c in of) >= _NUMERIC * len(of) for of in (cells, late)
        )

    def _other_decimal(self, i: int) -> bool:
        """Whether a column's numbers have the decimal mark that the other columns do not."""
        mark = "." if self._dialect.decimal == "," else ","
        cells = self._dialect.column(i)
        found = [c for c in cells if mark in c and number_grammar(mark).fullmatch(c)]
        return len(found) > len(cells) / 2

    def _report_reading(self, read: Reading) -> None:
        """Reports what a pass over the file has left out, and how the file ends."""
        start = earliest(read.times)
        for finding in read.losses.findings(start):
            self._report(finding)
        if read.lines.damage:
            damage = {"damage": read.lines.damage}
            self._report(Finding("csv-gzip-damaged", "warning", names=damage))
        if read.lines.open_end:
            self._report(Finding("csv-no-final-newline", "info"))
        if self._clock.pattern and not self.absolute:
            t = read.times
            back = np.flatnonzero(np.diff(unwrapped(t)[0]) < -_HALF_DAY)
            if len(back):
                pairs = np.sort([t[back], t[back + 1]], axis=0) - start
                spans = [(a / 1e9, b / 1e9) for a, b in pairs.T.tolist()]
                name = self._dialect.names[self._clock.columns[0]]
                self._report(
                    Finding(
                        "time-of-day-wrapped", "warning", channel=name, count=len(back),
                        spans=merged(spans),
                    )
                )  # fmt: skip

    def _report(self, finding: Finding) -> None:
        """Adds a finding that is not there from an earlier reading.

        Raises:
            UserError: with `ReadOptions.strict`, where it says that something was left out.
        """
        lossy = finding.severity != "info" and finding.code != "devices-interleaved"
        if self._options.strict and lossy:
            channel = f"{finding.channel}: " if finding.channel else ""
            raise UserError(
                f"{self.path}: {channel}{finding.message}",
                "correct the log, or read it without --strict",
            )
        if finding not in self.findings:
            self.findings.append(finding)


def _unit_in(cells: list[str], decimal: str) -> str:
    """The unit after the number in most of a column's cells, "" where there is none."""
    number = re.compile(rf"(?:{number_grammar(decimal).pattern})\s*([^\s\d].*)")
    found = Counter(m[1] for c in cells if (m := number.fullmatch(c)))
    ((unit, n),) = found.most_common(1) or [("", 0)]
    return unit if n > len(cells) / 2 and known_unit(unit) else ""


def _headerless(dialect: Dialect, path: Path) -> UserError:
    """The refusal of a table without names of columns, with the mapping to write."""
    if dialect.above:
        return UserError(
            f"{path}: the rows from line {dialect.first_line} on have no header, and those above, "
            f"from line {dialect.above[0][0]} on, another delimiter or number of columns",
            "split the log there, and read each part by itself",
        )
    first = dialect.rows[0]
    found = interleaved(dialect, (0,))
    group, hint, rest = "", "", list(range(2, len(first) + 1))
    if found:
        group = f"; column {found.channel!r} seems to hold devices: {found.names['groups']}"
        hint = f'group = {{channel = {toml(found.channel)}, equals = "…"}}, '
        rest = [k for k in rest if found.channel != f"column {k}"]
    return UserError(
        f"{path}: has no header row (line {dialect.first_line} is numbers: "
        f"{', '.join(first[:4])}{', …' if len(first) > 4 else ''}){group}",
        'map its columns by number under [channels], as time = {channel = "column 1", unit = "s"}, '
        f'{hint}pressure."axle 1" = {{channel = "column {rest[0]}", unit = "bar"}}, '
        f'speed."axle 1" = {{channel = "column {rest[-1]}", unit = "km/h"}}',
    )
