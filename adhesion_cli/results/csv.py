"""Logs as CSV: one column per channel with its unit in the header, one row per time stamp.

Rows that reading left out, too.
"""

import csv
import io
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow.csv import CSVWriter

from ..core.model import Log, Reject, Times
from ..core.text import printable
from . import names
from .verified import verified

_ROWS = 1 << 16  # written at once


def write_log(path: Path, log: Log) -> None:
    """Write a log as a wide table.

    Channels with different time stamps share a row only where the stamps are equal; nothing is
    interpolated, a cell without a value is empty. Every channel keeps its own order: where its
    time jumps back, a new pass through time begins below. Clock times are in UTC to the
    nanosecond; others are seconds, which still tell nanoseconds apart after 50 days.

    Args:
        path: file to write; its old content is lost.
        log: channels with a meaning are in SI, others in the unit they state.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    axes = {id(c.data.t): _Axis.of(c.data.t) for c in log.channels}
    headers = ["time" if log.absolute else "time [s]"]
    for name, unit in names.channels(log):
        headers.append(_cell(name if not unit or name.endswith((f"[{unit}]", f"({unit})"))
                             else f"{name} [{unit}]"))  # fmt: skip
    types = [pa.timestamp("ns", "UTC") if log.absolute else pa.float64()]
    schema = pa.schema(list(zip(headers, types + [pa.float64()] * len(log.channels), strict=True)))
    with verified(path) as file, CSVWriter(file, schema) as writer:
        for parts in _parts(axes):
            t, rows = _rows(axes, parts)
            columns = [pa.array(t, types[0]) if log.absolute else pa.array(t / 1e9)]
            for channel in log.channels:
                values, known = np.zeros(len(t)), np.zeros(len(t), bool)
                row, part = rows[id(channel.data.t)], parts[id(channel.data.t)]
                values[row] = channel.data.value[part]
                known[row] = channel.data.valid[part]
                columns.append(pa.array(values, mask=~known | np.isnan(values)))
            writer.write_batch(pa.record_batch(columns, schema=schema))


def write_rejects(path: Path, logs: Iterable[Log]) -> int:
    """Write what was left out of text logs, a line each, and how many there are.

    Args:
        path: file to write; its old content is lost.
        logs: as read with `ReadOptions.rejects`.

    Raises:
        OSError: the file cannot be written.
        UserError: a log cannot be read any more, or the file does not read back.
    """
    count = 0
    with verified(path) as file, io.TextIOWrapper(file, "utf-8", newline="") as text:
        table = csv.writer(text, lineterminator="\n")
        table.writerow(("file", *Reject._fields))
        for log in logs:
            for reject in log.rejects:
                cells = (log.path, *reject)
                table.writerow([_cell(printable(c)) if isinstance(c, str) else c for c in cells])
                count += 1
    return count


class _Axis(NamedTuple):
    """The time of channels, and its passes: it jumps back between two."""

    t: Times
    edges: NDArray[np.int64]  # where each begins, and the end

    @classmethod
    def of(cls, t: Times) -> "_Axis":
        return cls(t, np.concatenate([[0], np.flatnonzero(t[1:] < t[:-1]) + 1, [len(t)]]))

    def place(self, at: int) -> tuple[int, int]:
        """The pass of a sample, and its stamp."""
        return int(np.searchsorted(self.edges, at, side="right")) - 1, int(self.t[at])

    def past(self, place: tuple[int, int]) -> int:
        """The first sample behind a place."""
        first, end = self.edges[np.minimum([place[0], place[0] + 1], len(self.edges) - 1)]
        return int(first + np.searchsorted(self.t[first:end], place[1], side="right"))


def _parts(axes: dict[int, _Axis]) -> Iterator[dict[int, slice]]:
    """The samples of each axis that are written at once, to the same place in all of them."""
    at = dict.fromkeys(axes, 0)
    while left := [key for key, axis in axes.items() if at[key] < len(axis.t)]:
        last = min(axes[key].place(min(at[key] + _ROWS, len(axes[key].t)) - 1) for key in left)
        ends = {key: axis.past(last) for key, axis in axes.items()}
        yield {key: slice(at[key], end) for key, end in ends.items()}
        at = ends


def _rows(
    axes: dict[int, _Axis], parts: dict[int, slice]
) -> tuple[Times, dict[int, NDArray[np.int64]]]:
    """One row per distinct time stamp, and the row of each sample of each axis.

    A stamp that an axis repeats, or comes back to, gets its own row. A row is identified by
    (how often the time has jumped back, stamp, how often it repeated just now).
    """
    table = np.concatenate([_keys(axes[key], part) for key, part in parts.items()], axis=1)
    order = np.lexsort(table[::-1])
    table = table[:, order]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(table, axis=1) != 0).any(axis=0)
    row = np.empty(len(order), np.int64)
    row[order] = np.cumsum(new) - 1
    ends = np.cumsum([part.stop - part.start for part in parts.values()])
    return table[1, new], dict(zip(parts, np.split(row, ends[:-1]), strict=True))


def _keys(axis: _Axis, part: slice) -> NDArray[np.int64]:
    t, number = axis.t[part], np.arange(part.start, part.stop)
    new = np.diff(t, prepend=t[:1] - 1) != 0
    repeated = number - np.maximum.accumulate(np.where(new, number, 0))
    return np.stack([np.searchsorted(axis.edges, number, side="right"), t, repeated])


# Where a formula may begin: at the start of a cell, and, as programs differ in what parts cells,
# behind any separator, but for a number with its sign.
_FORMULA = re.compile(
    r"""^(?=[=+\-@＝＋－＠])|(?<=[;,\t|"])(?=[=@＝＠]|[-+－＋](?![\d.eE+-]+([;,\t|"]|$)))"""
)


def _cell(text: str) -> str:
    """A cell that no spreadsheet takes for a formula, or for several cells with one."""
    return _FORMULA.sub("'", text)
