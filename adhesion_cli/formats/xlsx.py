"""Excel workbooks: the cells of a sheet become lines of text, which are read as a text log.

So header, units and time are found by the rules of CSV. Line N of a message is row N of the sheet.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.text import listed
from .as_text import as_log
from .csv.reader import CsvSource, open_csv
from .isolated import Library
from .sheet_text import SheetText, option, write_text
from .source import ReadOptions

_LIBRARY = Library("xlsx", "Excel", (), "")


def open_workbook(path: Path, options: ReadOptions) -> CsvSource:
    """Opens a sheet of a workbook (.xlsx, .xlsm, .xlsb, .xls or .ods) as a log.

    Raises:
        UserError: where the workbook cannot be read or has no such sheet, or the sheet is no log.
    """
    folder = TemporaryDirectory(prefix="adhesion-", ignore_cleanup_errors=True)
    text = Path(folder.name) / "sheet.txt"
    of_text = replace(options, encoding="utf-8", delimiter="\t", decimal=options.decimal or ".")
    refusals: dict[str, UserError] = {}  # a list of channels may stand before the samples
    joins = True
    while True:
        sheet: SheetText | None = _LIBRARY.call(path, write_text, text, options, [*refusals], joins)
        if sheet is None:
            raise next(iter(refusals.values()))
        others = sheet.other_sheets if options.sheet is None else []
        names = listed(sheet.names)
        place = f"{path}: sheet {names}"
        try:
            source = open_csv(text, of_text, place)
            if source.fields or sheet.has_channels or not others:
                break
            error = UserError(f"{place}: holds no numbers over time", "give a sheet with a log")
        except UserError as refusal:
            error = refusal
        if len(sheet.names) > 1:
            joins = False
            continue
        if others:
            error.hint = f"{error.hint}; or state another sheet ({listed(others)}), as "
            error.hint += option(others[0])
        if sheet.has_channels or not others:
            raise error
        refusals[sheet.names[0]] = error
    as_log(source, "xlsx", path, folder)
    reason = "the first that is a log" if refusals else sheet.reason
    source.reasons = {"sheet": f"{names} ({reason})", **source.reasons}
    if others:
        for sheet_refusal in refusals.values():
            reason += f" ({sheet_refusal.text.removeprefix(f'{path}: ')})"
        values = {"sheet": names, "reason": reason, "others": listed(others)}
        values["option"] = option(others[0])
        source.findings.append(
            Finding("one-sheet-read", "warning" if sheet.is_part else "info", names=values)
        )
    return source
