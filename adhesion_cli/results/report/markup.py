"""Pieces of HTML; whatever comes from a log is text and never markup."""

import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from zlib import compress

from ...core.text import printable, utf8


def text(value: object) -> str:
    """Text of a log, a file's name or a number, for use between tags and in attributes."""
    return escape(printable(utf8(str(value))))


def element(name: str, content: str, css: str = "", **attributes: str) -> str:
    """An element around content that is HTML already."""
    all_attributes = ({"class": css} if css else {}) | attributes
    attribute_text = "".join(f' {key}="{escape(value)}"' for key, value in all_attributes.items())
    return f"<{name}{attribute_text}>{content}</{name}>"


def prose(content: str) -> str:
    """Plain text whose parts between backticks are code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", text(content))


def paragraph(content: str, css: str = "") -> str:
    """A paragraph of plain text, see `prose`."""
    return element("p", prose(content), css)


def table(
    rows: Sequence[Mapping[str, str]],
    text_columns: int = 1,
    marks: Sequence[tuple[str, str]] = (),
    css: str = "",
    links: Mapping[str, str] = {},
) -> str:
    """A table of rows that have the same keys, which are its header; nothing without rows.

    Args:
        rows: plain text.
        text_columns: how many columns are texts, from the left.
        marks: of each row its class and the column that has it.
        css: more classes of the box around it.
        links: places on the page, by the text of a cell.
    """
    if not rows:
        return ""
    header = list(rows[0])
    head = "".join(
        element("th", text(name), "text" * (i < text_columns)) for i, name in enumerate(header)
    )
    body = []
    for k, row in enumerate(rows):
        cells = []
        for i, (name, cell) in enumerate(row.items()):
            css_of = ["text"] * (i < text_columns)
            css_of += ["mark", marks[k][0]] if marks and marks[k][1] == name else []
            css_of += ["free"] if i < text_columns and len(cell) > 30 else []
            content = text(cell)
            content = element("a", content, href=links[cell]) if cell in links else content
            cells.append(element("td", content, " ".join(css_of)))
        body.append(element("tr", "".join(cells)))
    rows_text = "\n".join([f"<thead><tr>{head}</tr></thead>\n<tbody>", *body, "</tbody>"])
    return element("div", element("table", rows_text), f"table {css}".strip())


def packed(place: str, content: str) -> str:
    """Content that the page's script unpacks; base64 cannot end the element."""
    data = b64encode(compress(content.encode("utf-8"), 9)).decode("ascii")
    return f'<script type="text/plain" id="{place}">{data}</script>'
