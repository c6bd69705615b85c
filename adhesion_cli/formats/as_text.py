"""Logs that become a text log: units, time and devices are found by the rules of CSV."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from .csv.dialect import Dialect
from .csv.reader import CsvSource, open_table
from .source import ReadOptions

HEAD = 1_000  # rows that show which column is the time
_OF_TEXT = ("encoding", "delimiter", "decimal")  # decisions that such a log does not need


def open_text(
    kind: str, path: Path, write: Callable[[Path], Sequence[str]], options: ReadOptions
) -> CsvSource:
    """Opens a table of another format as text.

    `write` writes it as text, as `write_table` does, and gives the unit of each column.

    Raises:
        UserError: where the table is no log.
    """
    folder = TemporaryDirectory(prefix="adhesion-", ignore_cleanup_errors=True)
    text = Path(folder.name) / "log.csv"
    units = write(text)
    with text.open(encoding="utf-8", newline="") as file:
        lines = list(islice(file, HEAD + 1))
    names, *rows = csv.reader(lines)
    dialect = dialect_of(tuple(names), tuple(units), rows, "field metadata")
    row_count = len(rows) * text.stat().st_size / max(len("".join(lines).encode()), 1)
    options = replace(options, header=None, delimiter=None, decimal=None, encoding=None)
    return as_log(open_table(text, dialect, row_count, options, str(path)), kind, path, folder)


def dialect_of(
    names: tuple[str, ...], units: tuple[str, ...], rows: list[list[str]], unit_source: str
) -> Dialect:
    """The dialect of a table whose columns are known."""
    return Dialect(len(names), names, (names,), units, rows, first_line=2, unit_source=unit_source)


def as_log(source: CsvSource, kind: str, path: Path, folder: TemporaryDirectory[str]) -> CsvSource:
    """The text of a log as the log itself; the folder of the text goes with it."""
    source.format, source.path, source.folder = kind, path, folder
    source.reasons = {k: v for k, v in source.reasons.items() if k not in _OF_TEXT}
    return source


def write_table(arrays: dict[str, Any], text: Path) -> None:
    """Writes Arrow arrays of one length as the columns of a text log, under their names."""
    import pyarrow.csv

    cells = [printable(array) for array in arrays.values()]
    pyarrow.csv.write_csv(pa.Table.from_arrays(cells, [*arrays]), text)


def printable(array: Any) -> Any:
    """An Arrow array as a text log has its cells: numbers with all digits, times in UTC.

    The text of a float32 has the fewest digits that tell it from others: 3000.01, a step of 10 ms,
    which a double of it has not.
    """
    kind, types = array.type, pa.types
    if types.is_duration(kind):
        return array.cast(pa.duration("ns"), safe=False).cast(pa.int64())
    if types.is_boolean(kind):
        return array.cast(pa.int8())
    if types.is_float16(kind) or types.is_decimal(kind):
        return array.cast(pa.float64(), safe=False)
    if types.is_date64(kind):
        return array.cast(pa.timestamp("ms"), safe=False).cast(pa.string())
    if types.is_timestamp(kind):
        # The text of another zone needs a database of time zones, which not every Windows has.
        cells = array.cast(pa.timestamp(kind.unit)).cast(pa.string())
        return pc.binary_join_element_wise(cells, "Z", "") if kind.tz else cells
    if types.is_integer(kind) or types.is_floating(kind):
        return array
    return pc.replace_substring_regex(array.cast(pa.string()), r"[\r\n]+", " ")
