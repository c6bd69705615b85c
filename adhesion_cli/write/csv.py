"""Logs as CSV: one column per channel with its unit in the header, one row per time stamp.

Rows that reading left out, too.
"""

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow.csv import CSVWriter

from ..model import Log, Reject, Times
from ..text import printable
from . import names

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
    """
    time, places = _rows([c.data.t for c in log.channels])
    headers = ["time" if log.absolute else "time [s]"]
    for name, unit in names.channels(log):
        headers.append(_cell(name if not unit or name.endswith((f"[{unit}]", f"({unit})"))
                             else f"{name} [{unit}]"))  # fmt: skip
    types = [pa.timestamp("ns", "UTC") if log.absolute else pa.float64()]
    schema = pa.schema(list(zip(headers, types + [pa.float64()] * len(places), strict=True)))
    with path.open("wb") as file, CSVWriter(file, schema) as writer:
        for part in _parts(len(time)):
            t = time[part]
            columns = [pa.array(t, types[0]) if log.absolute else pa.array(t / 1e9)]
            for channel, place in zip(log.channels, places, strict=True):
                first, last = np.searchsorted(place, (part.start, part.stop))
                values, known = np.zeros(len(t)), np.zeros(len(t), bool)
                rows = place[first:last] - part.start
                values[rows] = channel.data.value[first:last]
                known[rows] = channel.data.valid[first:last]
                columns.append(pa.array(values, mask=~known | np.isnan(values)))
            writer.write_batch(pa.record_batch(columns, schema=schema))


def write_rejects(path: Path, logs: Iterable[Log]) -> int:
    """Write what was left out of text logs, a line each, and how many there are.

    Args:
        path: file to write; its old content is lost.
        logs: as read with `ReadOptions.rejects`.

    Raises:
        OSError: the file cannot be written.
        UserError: a log cannot be read any more.
    """
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("file", *Reject._fields))
        for log in logs:
            for reject in log.rejects:
                cells = (log.path, *reject)
                table.writerow([_cell(printable(c)) if isinstance(c, str) else c for c in cells])
                count += 1
    return count


def _rows(axes: list[Times]) -> tuple[Times, list[NDArray[np.int64]]]:
    """One row per distinct time stamp, and the row of each sample of each channel.

    A stamp that a channel repeats, or comes back to, gets a row of its own: rows are told apart
    by (how often the channel's time has jumped back, stamp, how often it repeated just now).
    """
    keys = {id(t): _keys(t) for t in axes}
    if not keys:
        return np.empty(0, np.int64), []
    table = np.concatenate(list(keys.values()), axis=1)
    order = np.lexsort(table[::-1])
    table = table[:, order]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(table, axis=1) != 0).any(axis=0)
    row = np.empty(len(order), np.int64)
    row[order] = np.cumsum(new) - 1
    ends = np.cumsum([k.shape[1] for k in keys.values()])
    of = dict(zip(keys, np.split(row, ends[:-1]), strict=True))
    return table[1, new], [of[id(t)] for t in axes]


def _keys(t: Times) -> NDArray[np.int64]:
    step = np.diff(t, prepend=t[:1])
    number = np.arange(len(t))
    new = step != 0
    new[:1] = True
    repeated = number - np.maximum.accumulate(np.where(new, number, 0))
    return np.stack([np.cumsum(step < 0), t, repeated])


def _parts(rows: int) -> Iterator[slice]:
    for at in range(0, rows, _ROWS):
        yield slice(at, min(at + _ROWS, rows))


def _cell(text: str) -> str:
    """A cell that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text
