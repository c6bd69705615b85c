"""Logs as CSV: one column per channel with its unit in the header, one row per time stamp.

Rows that reading left out, too.
"""

import csv
import io
from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa
from pyarrow.csv import CSVWriter

from ..core.model import Log, Reject
from ..core.text import printable
from . import names, wide_table
from .verified import verified


def write_log(path: Path, log: Log) -> None:
    """Write a log as a wide table.

    See `wide_table`; a cell without a value is empty.

    Args:
        path: file to write; its old content is lost.
        log: channels with a meaning are in SI, others in the unit they state.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    headers = ["time" if log.absolute else "time [s]"]
    for name, unit in names.channels(log):
        headers.append(
            names.cell(
                name
                if not unit or name.endswith((f"[{unit}]", f"({unit})"))
                else f"{name} [{unit}]"
            )
        )
    schema = pa.schema(list(zip(headers, wide_table.types(log), strict=True)))
    with verified(path) as file, CSVWriter(file, schema) as writer:
        for columns in wide_table.batches(log):
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
                table.writerow(
                    [names.cell(printable(c)) if isinstance(c, str) else c for c in cells]
                )
                count += 1
    return count
