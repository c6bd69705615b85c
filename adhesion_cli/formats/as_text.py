"""Logs that become a text log: header, units, time and devices are found by the rules of CSV."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from ..core.errors import UserError
from ..core.model import Column
from .csv.reader import CsvSource
from .source import Field, ReadOptions

_OF_TEXT = ("encoding", "delimiter", "decimal")  # decisions that such a log does not need


class TextSource(CsvSource):
    """A log as text, opened; implements `Source`."""

    def attach(
        self, kind: str, path: Path, folder: TemporaryDirectory[str], name: str = ""
    ) -> None:
        """Takes the format and the name of the log, and the folder with its text."""
        self.format, self.path, self._folder, self._name = kind, path, folder, name or str(path)
        self.reasons = {k: v for k, v in self.reasons.items() if k not in _OF_TEXT}

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, see `Source`."""
        with named(self.table.path, self._name):
            columns = super().columns(wanted)
        return columns


@contextmanager
def named(text: Path, name: str) -> Iterator[None]:
    """An error in the text is one in the log of this name."""
    try:
        yield
    except UserError as error:
        error.text = error.text.replace(str(text), name)
        raise


def open_text(
    kind: str, path: Path, write: Callable[[Path, Path], object], options: ReadOptions
) -> TextSource:
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
    with named(text, str(path)):
        source = TextSource.open(
            text, replace(options, encoding="utf-8", delimiter=",", decimal=".")
        )
    source.attach(kind, path, folder)
    return source
