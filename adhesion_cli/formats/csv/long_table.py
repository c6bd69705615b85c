"""Long tables: interleaved rows of several devices, axles or signals, separated by key columns."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray

from ...core import toml
from ...core.errors import UserError
from ...core.finding import Finding
from ...core.model import Times
from ...core.text import listed
from ..number_text import number_grammar
from .block_parser import CsvTable
from .dialect import Dialect
from .header_words import GROUP, SIGNAL, UNITS, is_named, is_units_row
from .rows import Key, read_rows
from .time_column import column_index

_MAX_GROUPS = 64  # devices or axles of one log
_MAX_SIGNALS = 1_000


@dataclass(frozen=True, slots=True)
class LongSeries:
    """What the rows of one key are."""

    group: str = ""  # device or axle
    signal: str = ""  # what the value column holds there, in a table of signals
    unit: str = ""  # of it

    @property
    def title(self) -> str:
        """As messages name it."""
        is_pair = self.signal and self.group
        return f"{self.signal} ({self.group})" if is_pair else self.signal or self.group


@dataclass(frozen=True, slots=True)
class Keys:
    """The columns that separate the series of a long table; none in a wide one."""

    columns: tuple[int, ...] = ()
    series: dict[Key, LongSeries] = field(default_factory=dict)  # those that are read
    findings: tuple[Finding, ...] = ()


def find_keys(table: CsvTable) -> Keys:
    """Finds the columns that separate series: stated, or known by their name and contents.

    Raises:
        UserError: where a stated column or value is not there, or has too many values.
    """
    dialect, options = table.dialect, table.options
    candidates = (i for i in range(len(dialect.names)) if i not in table.clock.columns)
    named = [i for i in candidates if _is_key(dialect, i)]
    if options.group_channel is not None:
        return _stated_keys(table, column_index(dialect, options.group_channel, table.path), named)
    attempts = [tuple(named)] if len(named) > 1 else []
    for columns in [*attempts, *((i,) for i in named)]:
        read = read_rows(table, [], columns)
        if _is_long_table(read.times, read.codes, len(read.met)):
            return _keys(dialect, columns, read.met)
    return Keys()


def _of_one_device(column: str, device: str) -> dict[str, str]:
    """The option that reads one device only."""
    table = toml.value({"channel": column, "equals": device})
    return {"option": toml.option(f"channels.group = {table}")}


def _stated_keys(table: CsvTable, i: int, named: list[int]) -> Keys:
    """The series of the stated column. Further columns may separate those of its one value."""
    dialect, path, equals = table.dialect, table.path, table.options.group_equals
    name = dialect.names[i]
    groups = [g for (g,) in read_rows(table, [], (i,)).met]
    option = _of_one_device(name, groups[0])["option"]
    if equals is None:
        if len(groups) > _MAX_GROUPS:
            text = f"{path}: column {name!r} has {len(groups)} values, too many to be devices"
            raise UserError(text, f"state one, as {option}")
        return replace(_keys(dialect, (i,), [(g,) for g in groups]), findings=())
    if equals not in groups:
        hint = f"state one, as {option}; values: {', '.join(groups[:20])}"
        raise UserError(f"{path}: no row has {equals!r} in column {name!r}", hint)
    other_group = next((g for g in sorted(groups) if g != equals), equals)
    names = {"groups": listed(sorted(groups)), "read": equals}
    names |= _of_one_device(name, other_group)
    values = {"devices": len(groups)}
    finding = Finding("one-device-read", "info", name, len(groups), values=values, names=names)
    if unused := tuple(k for k in named if k != i):
        columns = (i, *unused)
        read = read_rows(table, [], columns)
        matching = [k for k, key in enumerate(read.met) if key[0] == equals]
        rows = np.isin(read.codes, matching)
        if _is_long_table(read.times[rows], read.codes[rows], len(matching)):
            keys = _keys(dialect, columns, [read.met[k] for k in matching])
            return replace(keys, findings=(finding, *keys.findings))
    return Keys((i,), {(equals,): LongSeries(equals)}, (finding,))


def _is_key(dialect: Dialect, i: int) -> bool:
    """Whether a column may separate series, by its name and its cells in the head."""
    name, cells = dialect.names[i], dialect.column(i)
    is_key_name = is_named(name, GROUP) or is_named(name, SIGNAL) or _holds_units(dialect, i)
    limit = _MAX_GROUPS if is_named(name, GROUP) else _MAX_SIGNALS
    has_few_values = len(set(cells)) <= limit  # a column that numbers the rows has more
    return dialect.headed and is_key_name and has_few_values and len(cells) > len(dialect.rows) / 2


def _holds_units(dialect: Dialect, i: int) -> bool:
    return is_named(dialect.names[i], UNITS) and is_units_row(list(set(dialect.column(i))))


def _keys(dialect: Dialect, columns: tuple[int, ...], keys: list[Key]) -> Keys:
    """What each key stands for: as few of its cells as separate the series."""
    places = range(len(columns))
    unit = next((p for p in places if _holds_units(dialect, columns[p])), None)
    signals = [p for p in places if p != unit and is_named(dialect.names[columns[p]], SIGNAL)]
    signal = max(signals, key=lambda p: len({key[p] for key in keys}), default=unit)
    group = [p for p in places if p not in (unit, signal)]
    remaining = [p for p in places if p not in group]
    for p in reversed(group):
        ungrouped = [q for q in group if q != p] + remaining
        if ungrouped and len({tuple(key[q] for q in ungrouped) for key in keys}) == len(keys):
            group.remove(p)
    series = {}
    for key in keys:
        signal_name, its_unit = ("" if p is None else key[p] for p in (signal, unit))
        series[key] = LongSeries(", ".join(key[p] for p in group), signal_name, its_unit)
    device = group[0] if group else 0
    column_names = [dialect.names[i] for i in columns]
    names = {"columns": listed(column_names), "titles": listed(x.title for x in series.values())}
    names |= _of_one_device(column_names[device], keys[0][device])
    values, count = {"series": len(series)}, len(series)
    finding = Finding("long-layout", "info", column_names[0], count, values=values, names=names)
    return Keys(columns, series, (finding,))


def _is_long_table(t: Times, codes: NDArray[np.int64], groups: int) -> bool:
    """Whether keys separate several series that share one table."""
    if not 2 <= groups <= _MAX_SIGNALS:
        return False
    order = np.argsort(codes, kind="stable")
    steps = np.diff(t[order])[np.diff(codes[order]) == 0]
    if not len(steps):
        return False
    interleaves = (np.diff(codes) != 0).mean() >= 0.3
    if interleaves and not (steps < 0).any():  # rounded stamps may be equal
        return True
    repeats = (np.diff(t) <= 0).sum()
    return bool(repeats and (steps <= 0).sum() <= 0.5 * repeats)


def interleaved(dialect: Dialect, time: Sequence[int]) -> Finding | None:
    """A finding where rows of several devices seem to be interleaved.

    A column of few values keeps changing. The other columns are smooth only within each of them.
    """
    number = number_grammar(dialect.decimal)
    columns = {i: [row[i] for row in dialect.rows] for i in range(len(dialect.names))}
    numeric = {}
    for i, cells in columns.items():
        varies = i not in time and len(set(cells)) >= max(5, len(cells) // 10)
        if varies and all(map(number.fullmatch, cells)):
            numeric[i] = np.array([float(c.replace(",", ".")) for c in cells])
    for i, cells in columns.items():
        counts = Counter(cells)
        changes = sum(a != b for a, b in pairwise(cells)) >= 0.3 * len(cells)
        is_repeated = 2 <= len(counts) <= 32 and min(counts.values()) >= 3
        are_identifiers = all(re.fullmatch(r"\w{1,16}", c) for c in counts)
        if i in time or not (is_repeated and changes and are_identifiers):
            continue
        key = np.array(cells)
        smooth = []
        for value in (value for k, value in numeric.items() if k != i):
            step_across = median(np.abs(np.diff(value)))
            step_within = median(np.concatenate([np.abs(np.diff(value[key == c])) for c in counts]))
            smooth.append(step_within < 0.5 * step_across)
        if smooth and sum(smooth) >= 0.5 * len(smooth):
            name, devices = dialect.names[i], sorted(counts)
            names = {"groups": listed(devices), **_of_one_device(name, devices[0])}
            n, code = len(devices), "devices-interleaved"
            return Finding(code, "warning", name, n, values={"devices": n}, names=names)
    return None
