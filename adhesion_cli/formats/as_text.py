"""Logs that become a text log: header, units, time and devices are found by the rules of CSV."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from .csv.reader import CsvSource, open_csv
from .source import ReadOptions

_OF_TEXT = ("encoding", "delimiter", "decimal")  # decisions that such a log does not need


def open_text(
    kind: str, path: Path, write: Callable[[Path, Path], object], options: ReadOptions
) -> CsvSource:
    """Opens a log as text.

    Args:
        kind: its format.
        path: of the log.
        write: writes the log, its first argument, as text with commas, its second one.
        options: what the user stated.

    Raises:
        UserError: where the text is no log.
    """
    folder = TemporaryDirectory(prefix="adhesion-", ignore_cleanup_errors=True)
    text = Path(folder.name) / "log.csv"
    write(path, text)
    as_written = replace(options, encoding="utf-8", delimiter=",", decimal=".")
    return as_log(open_csv(text, as_written, str(path)), kind, path, folder)


def as_log(source: CsvSource, kind: str, path: Path, folder: TemporaryDirectory[str]) -> CsvSource:
    """The text of a log as the log itself; the folder of the text goes with it."""
    source.format, source.path, source.folder = kind, path, folder
    source.reasons = {k: v for k, v in source.reasons.items() if k not in _OF_TEXT}
    return source
