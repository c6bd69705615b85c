"""Delimited text logs: pyarrow's parser over blocks of whole lines, every line accounted for.

`sniff` decides the dialect and `clock` the time; here the wanted columns are read with explicit
types, and what cannot be read is counted and located. A block is what is in memory beside the
wanted columns.
"""

import codecs
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from ..errors import UserError
from ..model import Bools, Column, Finding, Floats, Times
from .clock import Clock, checked_floats, column_index, find_clock, is_missing, toml
from .sniff import HEAD_BYTES, NULLS, Dialect, is_comment, is_null, sniff
from .source import Field, ReadOptions
from .words import is_group_name

_BLOCK = 16 << 20
_MAX_QUOTED = 1 << 20  # bytes of one quoted cell; more is an opening quote that never closes
_MAX_QUOTED_LINES = 100
_GZIP = b"\x1f\x8b"
_MAX_GROUPS = 64
_SKIPPED = {
    "too few cells": "have too few cells",
    "too many cells": "have too many cells",
    "time missing": "have no time stamp",
    "time unreadable": "have a time stamp that cannot be read",
    "group missing": "do not say which device or axle they belong to",
    "cut off": "are cut off where the compressed data end",
}


def open_csv(path: Path, options: ReadOptions) -> "CsvSource":
    """Opens a delimited text log, plain or gzip.

    Args:
        path: the log.
        options: what the user stated; it beats what the head of the file suggests.

    Raises:
        UserError: where the file is no such table, or can be read in more than one way.
    """
    head, complete = _head(path)
    dialect = sniff(head, complete, options, path)
    if complete and len(dialect.rows) < 2:
        raise UserError(
            f"{path}: {len(dialect.rows)} data row, nothing to analyse",
            "give a log of several rows",
        )
    if not dialect.headed and options.time_channel is None:
        raise _headerless(dialect, path)
    rows = len(dialect.rows)
    if not complete or len(dialect.rows) > 500:
        size = path.stat().st_size * (1 if not head_is_gzip(path) else 4)
        rows = max(
            rows,
            int(size / max(len(head), 1) * head.count(b"\n"))
            if not complete
            else head.count(b"\n"),
        )
    clock = find_clock(dialect, options, rows, path)
    return CsvSource(path, options, dialect, clock)


class CsvSource:
    """A delimited text log, opened; implements `Source`.

    `lines` counts the lines of the file by what became of them, complete after `columns`.
    """

    format = "csv"

    def __init__(self, path: Path, options: ReadOptions, dialect: Dialect, clock: Clock) -> None:
        self.path = path
        self.absolute = clock.absolute
        self.time_reason = clock.reason
        self.rows = 0
        self.findings: list[Finding] = list(clock.findings)
        self.metadata = {"preamble": dialect.metadata} if dialect.metadata else {}
        self.lines: Counter[str] = Counter()
        self._options, self._dialect, self._clock = options, dialect, clock
        self._types: dict[int, list[Any]] = {
            i: list(clock.types) for i in clock.columns
        }  # types still to try
        self._group, self._groups = self._find_groups()
        names = dialect.names
        taken = {*clock.columns, self._group}
        numeric = [i for i in range(len(names)) if i not in taken and self._is_numeric(i)]
        self._index = {names[i]: i for i in numeric}
        self.fields: list[Field] = [
            Field(
                channel=names[i],
                group=group,
                unit=(unit := dialect.units[i] if dialect.units else ""),
                unit_from="units row" if unit else "",
            )
            for group in (self._groups or [""])
            for i in numeric
        ]
        self.stated: dict[str, Any] = dict(dialect.why)
        self.stated["time"] = clock.reason
        text = [names[i] for i in range(len(names)) if i not in taken and i not in numeric]
        if text:
            self.stated["not numeric"] = ", ".join(text)
        if self._group is not None:
            self.stated["group"] = f"{names[self._group]!r}: {', '.join(self._groups)}"
        if dialect.duplicates:
            self._report(
                "csv-duplicate-names", "info",
                f"{', '.join(map(repr, dialect.duplicates))} stand above several columns; the "
                'second is called "… (2)"', "", len(dialect.duplicates),
            )  # fmt: skip
        if self._group is None and (found := interleaved(dialect, clock.columns)):
            self._report("interleaved", "warning", *found)

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, in that order, rows in the log's own order, time untouched.

        A cell that holds no number is NaN with `valid` False; a row without a time is left out.
        Fields of one group share one time array.

        Raises:
            UserError: where the log cannot be read, with file, place and remedy; with
                `ReadOptions.strict` also where a row or cell cannot.
        """
        indices = sorted({self._index[f.channel] for f in wanted})
        scan = _Scan(self.path, self._options, self._dialect, self._clock, self._types)
        t, codes, values = scan.read(indices, self._group, self._groups)
        self.rows = len(t) + scan.lines["other group"]
        self.lines = scan.lines
        self._report_rows(scan)
        self._report_cells(scan, indices)
        rows = [codes == k for k in range(len(self._groups))] if self._group is not None else []
        times = [t[r] for r in rows] if len(rows) > 1 else [t]
        out = []
        for f in wanted:
            value = values[self._index[f.channel]]
            k = self._groups.index(f.group) if len(rows) > 1 else 0
            value = value[rows[k]] if len(rows) > 1 else value
            out.append(Column(times[k], value, np.isfinite(value)))
        return out

    def _is_numeric(self, i: int) -> bool:
        cells = self._dialect.column(i)
        number = self._dialect.number()
        if not cells:
            return self._dialect.names[i] != f"column {i + 1}" or not self._dialect.headed
        return sum(bool(number.fullmatch(c)) for c in cells) >= 0.5 * len(cells)

    def _find_groups(self) -> tuple[int | None, list[str]]:
        """Column that tells devices or axles apart, and its values; (None, []) in a wide log."""
        names = self._dialect.names
        stated = self._options.group_channel
        if stated is None:
            candidates = [
                i
                for i, name in enumerate(names)
                if self._dialect.headed and is_group_name(name) and i not in self._clock.columns
            ]
        else:
            candidates = [column_index(self._dialect, stated, self.path)]
        for i in candidates:
            scan = _Scan(self.path, self._options, self._dialect, self._clock, self._types)
            t, codes, _ = scan.read([], i, None)
            groups = scan.groups
            if stated is not None:
                return i, self._chosen(groups, i)
            if _is_long(t, codes, len(groups)):
                self._report(
                    "long-layout", "info",
                    f"column {names[i]!r} tells {len(groups)} series apart ({', '.join(groups)}); "
                    "each value column is read once for each", names[i], len(groups),
                )  # fmt: skip
                return i, groups
        return None, []

    def _chosen(self, groups: list[str], i: int) -> list[str]:
        name = self._dialect.names[i]
        if len(groups) > _MAX_GROUPS and self._options.group_equals is None:
            raise UserError(
                f"{self.path}: column {name!r} has {len(groups)} values, too many to be devices",
                f'state one, as group = {{channel = {toml(name)}, equals = "…"}} under [channels]',
            )
        if self._options.group_equals is None:
            return groups
        if self._options.group_equals not in groups:
            raise UserError(
                f"{self.path}: no row has {self._options.group_equals!r} in column {name!r}",
                f"values: {', '.join(groups[:20])}",
            )
        return [self._options.group_equals]

    def _report_rows(self, scan: "_Scan") -> None:
        skipped = {c: scan.lines[c] for c in _SKIPPED if scan.lines[c]}
        if skipped:
            parts = [
                f"{n} {_SKIPPED[c]} (first in line {scan.first[c][0]}: {scan.first[c][1]})"
                for c, n in skipped.items()
            ]
            self._report(
                "csv-rows-skipped", "warning", f"rows left out: {'; '.join(parts)}", "",
                sum(skipped.values()),
            )  # fmt: skip
        for code, severity, message, count in scan.notes:
            self._report(code, severity, message, "", count)

    def _report_cells(self, scan: "_Scan", indices: list[int]) -> None:
        for i in indices:
            name = self._dialect.names[i]
            for state, code, severity, text in (
                (1, "csv-missing-cells", "info", "are empty or say there is no value"),
                (2, "csv-bad-cells", "warning", "hold no number"),
            ):
                if n := scan.cells[i, state]:
                    line, shown = scan.first_cell[i, state]
                    self._report(
                        code, severity, f"{n} cells {text} (first in line {line}: {shown})", name, n
                    )

    def _report(self, code: str, severity: Any, message: str, channel: str, count: int) -> None:
        """Adds a finding, in place of an earlier one of the same code and channel."""
        if self._options.strict and severity != "info" and code != "interleaved":
            raise UserError(
                f"{self.path}: {channel + ': ' if channel else ''}{message}",
                "mend the log, or read it without --strict",
            )
        found = Finding(code, severity, message, channel, count)
        for k, old in enumerate(self.findings):
            if (old.code, old.channel) == (code, channel):
                self.findings[k] = found
                return
        self.findings.append(found)


@dataclass(slots=True)
class _Block:
    """Whole lines, each ended by a line feed."""

    data: bytes
    first_line: int

    def ends(self, delimiter: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Positions of all line feeds, and of those that end a row."""
        text = np.frombuffer(self.data, np.uint8)
        feeds = np.flatnonzero(text == 10)
        quotes = np.flatnonzero(text == 34)
        if not len(quotes):
            return feeds, feeds
        if not (np.searchsorted(quotes, feeds) % 2).any():
            return feeds, feeds
        inside = np.zeros(len(feeds), bool)
        for m in _quoted(delimiter).finditer(self.data):
            a, b = np.searchsorted(feeds, m.span())
            inside[a:b] = True
        return feeds, feeds[~inside]


def _quoted(delimiter: str) -> re.Pattern[bytes]:
    """A quoted cell: the quote opens it only at the start of the cell."""
    d = re.escape(_separator(delimiter).encode())
    return re.compile(rb"(?<![^\n" + d + rb'])"[^"]*(?:""[^"]*)*(?:"|\Z)')


def _separator(delimiter: str) -> str:
    return "\t" if delimiter == " " else delimiter


@dataclass(slots=True)
class _Scan:
    """One pass over the file for some of its columns."""

    path: Path
    options: ReadOptions
    dialect: Dialect
    clock: Clock
    types: dict[int, list[Any]]  # Arrow types still to try by column; shared between passes
    lines: Counter[str] = field(default_factory=Counter)
    first: dict[str, tuple[int, str]] = field(default_factory=dict)
    cells: Counter[tuple[int, int]] = field(default_factory=Counter)
    first_cell: dict[tuple[int, int], tuple[int, str]] = field(default_factory=dict)
    groups: list[str] = field(default_factory=list)
    notes: list[tuple[str, str, str, int]] = field(default_factory=list)

    def read(
        self, indices: list[int], group: int | None, groups: list[str] | None
    ) -> tuple[Times, NDArray[np.int64], dict[int, Floats]]:
        """Times, group codes and values of the rows that have a time.

        Args:
            indices: wanted columns.
            group: column of the group, None in a wide log.
            groups: the values wanted, in order of their codes; None: every value met.
        """
        self.lines.update(self.dialect.before)
        self.groups = list(groups or [])
        for i in indices:
            self.types.setdefault(i, [pa.float64(), pa.string()])
        times: list[Times] = []
        codes: list[NDArray[np.int64]] = []
        values: dict[int, list[Floats]] = {i: [] for i in indices}
        for block in self._blocks():
            table, rows = self._parse(block, indices, group)
            t, keep = self._times(block, table, rows)
            code = np.zeros(len(t), np.int64)
            if group is not None:
                code, said = self._codes(table[f"g{group}"], groups is None)
                self._drop(block, rows, keep & ~said, "group missing")
                keep &= said
                self.lines["other group"] += int((keep & (code < 0)).sum())
                keep &= code >= 0
            every = bool(keep.all())
            self.lines["used"] += len(t) if every else int(keep.sum())
            times.append(t if every else t[keep])
            codes.append(code if every else code[keep])
            for i in indices:
                value, state = checked_floats(table[f"c{i}"], self.dialect.decimal)
                if state.any():
                    self._count_cells(block, rows, i, np.where(keep, state, 0))
                values[i].append(value if every else value[keep])
        if not times or not sum(map(len, times)):
            raise UserError(
                f"{self.path}: no row has a time stamp that can be read",
                'state the time, as time = {channel = "…", unit = "s"} under [channels]',
            )
        return (
            np.concatenate(times),
            np.concatenate(codes),
            {i: np.concatenate(values.pop(i)) for i in indices},
        )

    def _parse(
        self, block: _Block, indices: list[int], group: int | None
    ) -> tuple[dict[str, Any], "_Rows"]:
        """Wanted columns of the block as Arrow arrays, "c0" and so on, the group as text."""
        wanted = [*self.clock.columns, *indices]
        width = self.dialect.width
        rows = _Rows(block, self.dialect)
        names = [f"c{i}" for i in range(width)]
        multiline = False
        if b'"' in block.data:
            feeds, ends = block.ends(self.dialect.delimiter)
            multiline = len(feeds) > len(ends)
        while True:
            types = {f"c{i}": self.types[i][0] for i in wanted}
            if group is not None:
                types.setdefault(f"c{group}", pa.string())
            rows.begin()
            try:
                table = rows.parse(names, types, multiline, threads=True)
                break
            except pa.ArrowInvalid as error:
                self._demote(block, str(error), wanted)
        out = {f"c{i}": _flat(table[f"c{i}"]) for i in wanted}
        if group is not None:
            out[f"g{group}"] = _flat(table[f"c{group}"]).cast(pa.string())
        for i in indices:
            # 1e400 parses as infinity: only the strict grammar tells it from a spelled "inf"
            if (
                pa.types.is_floating(out[f"c{i}"].type)
                and np.isinf(out[f"c{i}"].to_numpy(zero_copy_only=False)).any()
            ):
                self.types[i].pop(0)
                return self._parse(block, indices, group)
        feeds_count = block.data.count(b"\n")
        counted = table.num_rows + sum(rows.invalid.values())
        self.lines.update(rows.invalid)
        if feeds_count != counted:
            feeds, ends = block.ends(self.dialect.delimiter)
            starts = np.concatenate(([0], ends[:-1] + 1))
            blank = int((ends == starts).sum())
            self.lines["blank"] += blank
            self.lines["inside quotes"] += len(feeds) - len(ends)
            if feeds_count != counted + blank + len(feeds) - len(ends):
                raise UserError(
                    f"{self.path}: quotes from line {block.first_line} on cannot be followed "
                    f"({feeds_count} lines, {counted} rows)",
                    "mend the quotes in the log",
                )
        for kind in ("too few cells", "too many cells"):
            if rows.invalid[kind] and kind not in self.first:
                self.first[kind] = rows.first_invalid(names, types, multiline)[kind]
        return out, rows

    def _demote(self, block: _Block, error: str, wanted: list[int]) -> None:
        """Drops the type that the block's cells do not fit; raises where none is left."""
        found = re.search(r"CSV column #(\d+)", error)
        i = int(found[1]) if found else -1
        if "straddling" in error or "too large" in error:
            at = max(block.data.split(b"\n"), key=len)
            line = block.first_line + block.data.count(b"\n", 0, block.data.index(at))
            raise UserError(
                f"{self.path}: line {line} is {len(at) >> 10} KiB long",
                "give a text log with one row per line",
            )
        if "UTF8" in error and not block.data.isascii():
            fixed = block.data.decode("utf-8", "replace").encode()
            if fixed != block.data:
                block.data = fixed
                return
        if i in self.types and len(self.types[i]) > 1:
            self.types[i].pop(0)
            return
        raise UserError(
            f"{self.path}: cannot be read from line {block.first_line} on: {error.splitlines()[0]}",
            "mend the log, or state its dialect under [csv]",
        )

    def _times(self, block: _Block, table: dict[str, Any], rows: "_Rows") -> tuple[Times, Bools]:
        arrays = [table[f"c{i}"] for i in self.clock.columns]
        t, ok = self.clock.nanoseconds(arrays)
        if ok.all():
            return t, ok.copy()
        missing = np.zeros(len(t), bool)
        for array in arrays:
            missing |= is_missing(array)
        unreadable = ~ok & ~missing
        comments = np.zeros(len(t), bool)
        if self.dialect.comment.encode() in block.data if self.dialect.comment else True:
            for r in np.flatnonzero(~ok):
                comments[r] = is_comment(rows.text(int(r)))
        self.lines["comment"] += int(comments.sum())
        self._drop(block, rows, ~ok & missing & ~comments, "time missing")
        self._drop(block, rows, unreadable & ~comments, "time unreadable")
        return t, ok.copy()

    def _codes(self, array: Any, grow: bool) -> tuple[NDArray[np.int64], Bools]:
        """Index of each row's group, −1 for one not wanted, and which rows state one."""
        import pyarrow.compute as pc

        encoded = pc.utf8_trim_whitespace(array).dictionary_encode()
        said = np.asarray(encoded.indices.is_valid())
        values = encoded.dictionary.to_pylist()
        if grow:
            self.groups += [v for v in values if not is_null(v) and v not in self.groups]
        if len(self.groups) > 100_000:
            raise UserError(
                f"{self.path}: the group column has more than 100000 values",
                "name a column of few values as the group",
            )
        at = {v: k for k, v in enumerate(self.groups)}
        codes = np.array([at.get(v, -1) for v in values] or [-1], np.int64)
        none = np.array([is_null(v) for v in values] or [True])
        index = np.asarray(encoded.indices.fill_null(0)).astype(np.int64)
        return codes[index], said & ~none[index]

    def _drop(self, block: _Block, rows: "_Rows", which: Bools, kind: str) -> None:
        if n := int(which.sum()):
            self.lines[kind] += n
            if kind not in self.first:
                r = int(np.flatnonzero(which)[0])
                self.first[kind] = rows.line(r), _shown(rows.text(r))

    def _count_cells(self, block: _Block, rows: "_Rows", i: int, state: Any) -> None:
        for k in (1, 2):
            at = np.flatnonzero(state == k)
            self.cells[i, k] += len(at)
            if len(at) and (i, k) not in self.first_cell:
                r = int(at[0])
                self.first_cell[i, k] = rows.line(r), _shown(rows.cell(r, i))

    def _blocks(self) -> Iterator[_Block]:
        """The file's data lines in blocks that end where a row ends."""
        rest = b""
        line = 1
        skip = self.dialect.first_line - 1
        done = False
        chunks = self._text()
        while not done:
            chunk = next(chunks, None)
            done = chunk is None
            data = rest + (chunk or b"")
            if skip:
                if data.count(b"\n") < skip and not done:
                    rest = data
                    continue
                at = 0
                for _ in range(skip):
                    at = data.find(b"\n", at) + 1
                data, line, skip = data[at:], line + skip, 0
            if done and data and not data.endswith(b"\n"):
                if any(n[0] == "csv-gzip-damaged" for n in self.notes):
                    at = data.rfind(b"\n") + 1
                    last = line + data.count(b"\n")
                    self.lines["cut off"] += 1
                    self.first["cut off"] = last, _shown(data[at:].decode("utf-8", "replace"))
                    data = data[:at]
                else:
                    data += b"\n"
                    self.notes.append((
                        "csv-no-final-newline", "info",
                        "the last line has no line end; if the log was cut there, its last cell "
                        "may be incomplete", 1,
                    ))  # fmt: skip
            cut = data.rfind(b"\n") + 1
            if data.count(b'"', 0, cut) % 2:
                cut = self._cut(data, line, done)
            elif len(data) - cut > _BLOCK:
                number = line + data.count(b"\n")
                raise UserError(
                    f"{self.path}: line {number} is longer than {_BLOCK >> 20} MiB",
                    "give a text log with one row per line",
                )
            whole, rest = data[:cut], data[cut:]
            if whole:
                block = _Block(whole, line)
                line += whole.count(b"\n")
                if self.dialect.delimiter == " ":
                    spaced = re.sub(rb"[ \t]+", b"\t", whole)
                    block.data = re.sub(rb"(?m)^\t|\t$", b"", spaced)
                yield block

    def _cut(self, data: bytes, line: int, done: bool) -> int:
        """Where the last row of `data` ends, given an odd number of quotes in it."""
        last = len(data)
        for m in _quoted(self.dialect.delimiter).finditer(data):
            closed = m.end() < len(data) or (done and m[0].endswith(b'"') and len(m[0]) > 1)
            lines = data.count(b"\n", *m.span()) if len(m[0]) > 80 else 0
            if len(m[0]) > _MAX_QUOTED or lines > _MAX_QUOTED_LINES or (done and not closed):
                number = line + data.count(b"\n", 0, m.start())
                raise UserError(
                    f"{self.path}: the quote opened in line {number} does not close",
                    "mend the quotes in that line",
                )
            if not closed:
                last = m.start()
        return data.rfind(b"\n", 0, last) + 1

    def _text(self) -> Iterator[bytes]:
        """The file as UTF-8 with line feeds, in chunks."""
        decoder = None
        if self.dialect.encoding != "utf-8":
            decoder = codecs.getincrementaldecoder(self.dialect.encoding)("replace")
        bom = self.dialect.bom
        held = b""
        for raw in self._bytes():
            chunk, bom = raw[bom:], 0
            if decoder:
                chunk = decoder.decode(chunk).encode()
            if held or b"\r" in chunk:
                chunk = held + chunk
                held = b"\r" if chunk.endswith(b"\r") else b""
                chunk = (
                    chunk[: len(chunk) - len(held)].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
                )
            yield chunk
        if held:
            yield b"\n"

    def _bytes(self) -> Iterator[bytes]:
        if not head_is_gzip(self.path):
            with self.path.open("rb") as file:
                while chunk := file.read(_BLOCK):
                    yield chunk
            return
        total = 0
        with gzip.open(self.path) as file:
            parts: list[bytes] = []
            more = b"-"
            while more:
                try:
                    more = file.read1(_BLOCK)
                except (EOFError, gzip.BadGzipFile, zlib.error) as error:
                    self.notes.append(
                        ("csv-gzip-damaged", "warning", f"compressed data end early: {error}", 1)
                    )
                    more = b""
                total += len(more)
                if total > self.options.max_inflated:
                    raise UserError(
                        f"{self.path}: inflates to more than {self.options.max_inflated >> 20} MiB",
                        "raise --max-inflated if the file can be trusted",
                    )
                parts.append(more)
                if not more or sum(map(len, parts)) >= _BLOCK:
                    yield b"".join(parts)
                    parts.clear()


@dataclass(slots=True)
class _Rows:
    """The rows of one block: parsing them, and finding their lines where something is wrong."""

    block: _Block
    dialect: Dialect
    invalid: Counter[str] = field(default_factory=Counter)
    numbers: list[tuple[int, str, str]] = field(default_factory=list)
    _lines: Any = None
    _spans: Any = None

    def begin(self) -> None:
        self.invalid.clear()

    def parse(self, names: list[str], types: dict[str, Any], multiline: bool, threads: bool) -> Any:
        """Arrow table of the rows of the right width; others go to `invalid`."""
        counter, numbers = self.invalid, self.numbers

        def wrong(row: Any) -> str:
            text = row.text
            if not text.strip():
                kind = "blank"
            elif is_comment(text):
                kind = "comment"
            else:
                few = row.actual_columns < row.expected_columns
                kind = "too few cells" if few else "too many cells"
            if threads:
                counter[kind] += 1
            else:
                numbers.append((row.number, kind, text[:200]))
            return "skip"

        return pyarrow.csv.read_csv(
            pa.BufferReader(self.block.data),
            pyarrow.csv.ReadOptions(column_names=names, use_threads=threads),
            pyarrow.csv.ParseOptions(
                delimiter=_separator(self.dialect.delimiter),
                newlines_in_values=multiline,
                invalid_row_handler=wrong,
            ),
            pyarrow.csv.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=list(NULLS),
                strings_can_be_null=True,
                decimal_point=self.dialect.decimal,
            ),
        )

    def first_invalid(
        self, names: list[str], types: dict[str, Any], multiline: bool
    ) -> dict[str, tuple[int, str]]:
        """Line and text of the first wrong row of each kind."""
        self._locate()
        return {
            kind: (int(self._spans[number - 1][2]), _shown(text))
            for number, kind, text in reversed(self.numbers)
        }

    def _locate(self) -> None:
        """Finds the line of every row, by a second parse in one thread that numbers the rows."""
        if self._lines is not None:
            return
        feeds, ends = self.block.ends(self.dialect.delimiter)
        starts = np.concatenate(([0], ends[:-1] + 1))
        lines = self.block.first_line + np.searchsorted(feeds, starts)
        filled = ends > starts
        self._spans = np.column_stack((starts, ends, lines))[filled]
        if self.invalid:
            self.numbers.clear()
            names = [f"c{i}" for i in range(self.dialect.width)]
            self.parse(names, {"c0": pa.binary()}, len(ends) < len(feeds), threads=False)
        wrong = [number - 1 for number, _, _ in self.numbers]
        self._lines = np.delete(np.arange(len(self._spans)), wrong)

    def line(self, row: int) -> int:
        """Line number of a row of the table."""
        self._locate()
        return int(self._spans[self._lines[row]][2])

    def text(self, row: int) -> str:
        """Text of a row of the table."""
        self._locate()
        start, end, _ = self._spans[self._lines[row]]
        return self.block.data[start : min(end, start + 100_000)].decode("utf-8", "replace")

    def cell(self, row: int, column: int) -> str:
        """Text of one cell of a row of the table."""
        from .sniff import split

        cells = split(self.text(row), _separator(self.dialect.delimiter))
        return cells[column] if column < len(cells) else ""


def _flat(column: Any) -> Any:
    """One Arrow array from a chunked one."""
    if column.num_chunks == 1:
        return column.chunk(0)
    return pa.concat_arrays(column.chunks) if column.num_chunks else column.combine_chunks()


def _shown(text: str) -> str:
    """Text of a log as it may stand in a message."""
    return repr(text if len(text) <= 60 else text[:59] + "…")


def _head(path: Path) -> tuple[bytes, bool]:
    """First bytes of the decompressed file, and whether that is all of it."""
    try:
        if not path.is_file():
            missing = not path.exists()
            raise UserError(
                f"{path}: {'no such file' if missing else 'is not a file'}", "check the path"
            )
        if head_is_gzip(path):
            with gzip.open(path) as file:
                head = b""
                while len(head) <= HEAD_BYTES:
                    try:
                        more = file.read1(HEAD_BYTES + 1 - len(head))
                    except EOFError:
                        more = b""
                    if not more:
                        break
                    head += more
        else:
            with path.open("rb") as file:
                head = file.read(HEAD_BYTES + 1)
    except (gzip.BadGzipFile, zlib.error) as error:
        raise UserError(f"{path}: gzip data are damaged: {error}", "fetch the file again") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}", "check the path") from None
    if not head.strip():
        raise UserError(f"{path}: is empty", "give a log with a header and data rows")
    return head[:HEAD_BYTES], len(head) <= HEAD_BYTES


def head_is_gzip(path: Path) -> bool:
    """Whether the file is gzip by its first bytes."""
    with path.open("rb") as file:
        return file.read(2) == _GZIP


def _headerless(dialect: Dialect, path: Path) -> UserError:
    """The refusal of a table whose columns nobody named, with the mapping to write."""
    first = dialect.rows[0]
    found = interleaved(dialect, (0,))
    group = f"; {found[0]}" if found else ""
    return UserError(
        f"{path}: has no header row (line {dialect.first_line} is numbers: "
        f"{', '.join(first[:4])}{', …' if len(first) > 4 else ''}){group}",
        'map its columns by number under [channels], as time = {channel = "column 1", unit = "s"}, '
        + ('group = {channel = ' + toml(found[1]) + ', equals = "…"}, ' if found else "")
        + 'pressure."axle 1" = {channel = "column 2", unit = "bar"}, '
        'speed."axle 1" = {channel = "column 3", unit = "km/h"}',
    )  # fmt: skip


def _is_long(t: Times, codes: NDArray[np.int64], groups: int) -> bool:
    """Whether a column tells several series apart that share one table."""
    if not 2 <= groups <= _MAX_GROUPS:
        return False
    order = np.argsort(codes, kind="stable")
    within = np.diff(t[order])[np.diff(codes[order]) == 0]
    if not len(within):
        return False
    overall = np.diff(t)
    still_wrong = (within <= 0).sum()
    if (overall <= 0).any():
        return bool(still_wrong <= 0.5 * (overall <= 0).sum())
    return bool((np.diff(codes) != 0).mean() >= 0.3)


def interleaved(dialect: Dialect, time: Sequence[int]) -> tuple[str, str, int] | None:
    """Message, column and number of values where rows of several devices seem to alternate.

    A column of few values that keeps changing, while the others run smoothly only within one of
    its values.
    """
    rows = dialect.rows
    number = dialect.number()
    numeric: dict[int, Floats] = {}
    for i in range(len(dialect.names)):
        cells = [row[i] for row in rows]
        if i not in time and all(number.fullmatch(c) for c in cells):
            numeric[i] = np.array([float(c.replace(",", ".")) for c in cells])
    for i, name in enumerate(dialect.names):
        cells = [row[i] for row in rows]
        counts = Counter(cells)
        if i in time or not 2 <= len(counts) <= 32 or min(counts.values()) < 3:
            continue
        if any(is_null(c) or not re.fullmatch(r"\w{1,16}", c) for c in counts):
            continue
        if sum(a != b for a, b in pairwise(cells)) < 0.3 * len(cells):
            continue
        key = np.array(cells)
        smooth, judged = 0, 0
        for k, value in numeric.items():
            if k == i or len(set(value)) < max(5, len(value) // 10):
                continue
            across = median(np.abs(np.diff(value)))
            within = median(np.concatenate([np.abs(np.diff(value[key == c])) for c in counts]))
            judged += 1
            smooth += within < 0.5 * across
        if judged and smooth >= 0.5 * judged:
            values = sorted(counts)
            return (
                f"rows of several devices alternate: column {name!r} holds {', '.join(values)}; "
                f"state one, as group = {{channel = {toml(name)}, equals = {toml(values[0])}}} "
                "under [channels]",
                name,
                len(values),
            )
    return None
