"""Excel workbooks: the cells of a sheet become lines of text, which are read as a text log.

So header, units and time are found by the rules of CSV. Line N of a message is row N of the sheet.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Column
from .csv.reader import CsvSource
from .csv.time_column import listed
from .isolated import Library
from .sheet_text import SheetText, option, write_text
from .source import Field, ReadOptions

_LIBRARY = Library("xlsx", "Excel", (), "")
_OF_TEXT = ("encoding", "delimiter", "decimal")  # decisions that a workbook does not need


def open_workbook(path: Path, options: ReadOptions) -> "WorkbookSource":
    """Opens a sheet of a workbook as a log.

    Args:
        path: the workbook: .xlsx, .xlsm, .xlsb, .xls or .ods.
        options: what the user stated, as the sheet.

    Raises:
        UserError: where the workbook cannot be read or has no such sheet, or the sheet is no log.
    """
    folder = TemporaryDirectory(prefix="adhesion-", ignore_cleanup_errors=True)
    text = Path(folder.name) / "sheet.txt"
    sheet: SheetText = _LIBRARY.call(path, write_text, text, options.sheet, options.decimal)
    of_text = replace(options, encoding="utf-8", delimiter="\t", decimal=".")
    with _named(text, f"{path}: sheet {sheet.name!r}"):
        try:
            source = WorkbookSource.open(text, of_text)
        except UserError as error:
            if sheet.other_sheets and not options.sheet:
                error.hint = (
                    f"{error.hint}; or state another sheet ({listed(sheet.other_sheets)}), as "
                )
                error.hint += option(sheet.other_sheets[0])
            raise
    source.attach(path, folder, sheet, is_stated=options.sheet is not None)
    return source


class WorkbookSource(CsvSource):
    """A sheet of a workbook, opened; implements `Source`."""

    format = "xlsx"

    def attach(
        self, path: Path, folder: TemporaryDirectory[str], sheet: SheetText, *, is_stated: bool
    ) -> None:
        """Takes the workbook's name and the folder with the sheet's text."""
        self.path, self._folder, self._sheet = path, folder, sheet.name
        reason = "stated" if is_stated else "the first with columns of numbers"
        decisions = {k: v for k, v in self.reasons.items() if k not in _OF_TEXT}
        self.reasons = {"sheet": f"{sheet.name!r} ({reason})", **decisions}
        if sheet.other_sheets and not is_stated:
            names = {"sheet": repr(sheet.name), "others": listed(sheet.other_sheets)}
            names["option"] = option(sheet.other_sheets[0])
            self.findings.append(Finding("one-sheet-read", "info", names=names))

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, see `Source`."""
        with _named(self.table.path, f"{self.path}: sheet {self._sheet!r}"):
            columns = super().columns(wanted)
        return columns


@contextmanager
def _named(text: Path, name: str) -> Iterator[None]:
    """An error in the text is one in the sheet."""
    try:
        yield
    except UserError as error:
        error.text = error.text.replace(str(text), name)
        raise
