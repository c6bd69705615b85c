"""Excel workbooks, cell by cell: what other programs write, and what they should not."""

from collections.abc import Mapping, Sequence
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr
from zipfile import ZIP_DEFLATED, ZipFile

DAY = timedelta(days=1)
FORMATS = ("General", "dd.mm.yyyy hh:mm:ss.000", "dd.mm.yyyy", "hh:mm:ss.000", "[h]:mm:ss.000")
_MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_RELATIONS = 'xmlns="http://schemas.openxmlformats.org/package/2006/relationships"'
_XML = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>'


class Error(NamedTuple):
    """A cell with an error."""

    text: str


class Formula(NamedTuple):
    """A cell with a formula, perhaps without a value."""

    text: str
    value: float | None = None


class Serial(NamedTuple):
    """A number of days with the format of a time."""

    days: float
    style: int = 1  # index in `FORMATS`


Cell = float | str | bool | date | time | timedelta | Error | Formula | Serial | None


def write(
    path: Path,
    sheets: Mapping[str, Sequence[Sequence[Cell]]],
    *,
    hidden: Sequence[str] = (),
    since_1904: bool = False,
    merged: Sequence[str] = (),
) -> Path:
    """Writes a workbook; numbers with all their digits."""
    day_zero = datetime(1904, 1, 1) if since_1904 else datetime(1899, 12, 30)
    names = list(sheets)
    listed = "".join(
        f'<sheet name={quoteattr(name)} sheetId="{k}" r:id="rId{k}"'
        f"{' state=' + chr(34) + 'hidden' + chr(34) if name in hidden else ''}/>"
        for k, name in enumerate(names, 1)
    )
    relations = "".join(
        f'<Relationship Id="rId{k}" Type="{_OFFICE}/worksheet" Target="worksheets/s{k}.xml"/>'
        for k in range(1, len(names) + 1)
    )
    formats = "".join(
        f'<numFmt numFmtId="{164 + k}" formatCode="{code}"/>' for k, code in enumerate(FORMATS)
    )
    styles = "".join(f'<xf numFmtId="{164 + k if k else 0}"/>' for k in range(len(FORMATS)))
    merges = "".join(f'<mergeCell ref="{x}"/>' for x in merged)
    with ZipFile(path, "w", ZIP_DEFLATED) as parts:
        parts.writestr("[Content_Types].xml", f"{_XML}<Types/>")
        book = f'<Relationship Id="r" Type="{_OFFICE}/officeDocument" Target="xl/workbook.xml"/>'
        parts.writestr("_rels/.rels", f"{_XML}<Relationships {_RELATIONS}>{book}</Relationships>")
        parts.writestr(
            "xl/workbook.xml",
            f'{_XML}<workbook {_MAIN} xmlns:r="{_OFFICE}"><workbookPr date1904="{since_1904:d}"/>'
            f"<sheets>{listed}</sheets></workbook>",
        )
        parts.writestr(
            "xl/_rels/workbook.xml.rels",
            f"{_XML}<Relationships {_RELATIONS}>{relations}</Relationships>",
        )
        parts.writestr(
            "xl/styles.xml",
            f"{_XML}<styleSheet {_MAIN}><numFmts>{formats}</numFmts>"
            f"<cellXfs>{styles}</cellXfs></styleSheet>",
        )
        for k, name in enumerate(names, 1):
            rows = "".join(
                f'<row r="{r}">{"".join(_cell(r, c, x, day_zero) for c, x in enumerate(row))}</row>'
                for r, row in enumerate(sheets[name], 1)
            )
            parts.writestr(
                f"xl/worksheets/s{k}.xml",
                f"{_XML}<worksheet {_MAIN}><sheetData>{rows}</sheetData>"
                f"{f'<mergeCells>{merges}</mergeCells>' if merges else ''}</worksheet>",
            )
    return path


def _cell(row: int, column: int, value: Cell, day_zero: datetime) -> str:
    place = f'r="{chr(65 + column)}{row}"'
    if value is None or value == "":
        return ""
    if isinstance(value, Formula):
        result = "" if value.value is None else repr(value.value)
        return f"<c {place}><f>{escape(value.text)}</f><v>{result}</v></c>"
    if isinstance(value, Error):
        return f'<c {place} t="e"><v>{value.text}</v></c>'
    if isinstance(value, bool):
        return f'<c {place} t="b"><v>{value:d}</v></c>'
    if isinstance(value, str):
        text = f'<is><t xml:space="preserve">{escape(value)}</t></is>'
        return f'<c {place} t="inlineStr">{text}</c>'
    days, style = _days(value, day_zero)
    return f'<c {place} s="{style}"><v>{days!r}</v></c>'


def _days(value: float | date | time | timedelta | Serial, day_zero: datetime) -> tuple[float, int]:
    """The number of a cell, and its style."""
    if isinstance(value, Serial):
        return value.days, value.style
    if isinstance(value, datetime):
        return (value - day_zero) / DAY, 1
    if isinstance(value, date):
        return (datetime.combine(value, time()) - day_zero) / DAY, 2
    if isinstance(value, time):
        return (datetime.combine(day_zero, value) - day_zero) / DAY, 3
    if isinstance(value, timedelta):
        return value / DAY, 4
    return value, 0
