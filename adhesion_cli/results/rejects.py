"""What reading left out of text logs, as CSV."""

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from ..core.model import Log, Reject
from ..core.text import printable
from . import names
from .verified import verified


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
                texts = (names.cell(printable(c)) if isinstance(c, str) else c for c in cells)
                table.writerow(texts)
                count += 1
    return count
