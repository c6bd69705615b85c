"""Excel workbooks: the cells of a sheet become lines of text, which are read as a text log.

So header, units and time are found by the rules of CSV. Line N of a message is row N of the sheet.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from ..core.errors import UserError
from ..core.finding import Finding
from .as_text import TextSource, named
from .csv.time_column import listed
from .isolated import Library
from .sheet_text import SheetText, option, write_text
from .source import ReadOptions

_LIBRARY = Library("xlsx", "Excel", (), "")


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
    sheet: SheetText = _LIBRARY.call(path, write_text, text, options.sheet)
    of_text = replace(options, encoding="utf-8", delimiter="\t", decimal=options.decimal or ".")
    with named(text, f"{path}: sheet {sheet.name!r}"):
        try:
            source = WorkbookSource.open(text, of_text)
        except UserError as error:
            if sheet.other_sheets and not options.sheet:
                error.hint = (
                    f"{error.hint}; or state another sheet ({listed(sheet.other_sheets)}), as "
                )
                error.hint += option(sheet.other_sheets[0])
            raise
    source.attach_sheet(path, folder, sheet, is_stated=options.sheet is not None)
    return source


class WorkbookSource(TextSource):
    """A sheet of a workbook, opened; implements `Source`."""

    def attach_sheet(
        self, path: Path, folder: TemporaryDirectory[str], sheet: SheetText, *, is_stated: bool
    ) -> None:
        """Takes the workbook's name and the folder with the sheet's text."""
        self.attach("xlsx", path, folder, f"{path}: sheet {sheet.name!r}")
        reason = "stated" if is_stated else "the first with columns of numbers"
        self.reasons = {"sheet": f"{sheet.name!r} ({reason})", **self.reasons}
        if sheet.other_sheets and not is_stated:
            names = {"sheet": repr(sheet.name), "others": listed(sheet.other_sheets)}
            names["option"] = option(sheet.other_sheets[0])
            self.findings.append(Finding("one-sheet-read", "info", names=names))
