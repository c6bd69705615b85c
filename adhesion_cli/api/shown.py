"""A short HTML table, which a notebook shows of a result."""

from collections.abc import Mapping, Sequence
from html import escape

from ..core.finding import Finding
from ..core.text import printable

_TEXT_COLUMNS = "axle method channel meaning parameter unit why".split()


def page(title: str, *parts: str) -> str:
    """A title above tables and lists."""
    return "\n".join([f"<p><b>{_text(title)}</b></p>", *filter(None, parts)])


def table(rows: Sequence[Mapping[str, str]], caption: str = "") -> str:
    """A table of rows with the same keys, which are its header; "" without rows."""
    if not rows:
        return ""
    header = list(dict.fromkeys(key for row in rows for key in row))
    cells = ["".join(_cell("th", key, key) for key in header)]
    cells += ["".join(_cell("td", key, row.get(key, "-")) for key in header) for row in rows]
    title = f"<caption>{_text(caption)}</caption>" if caption else ""
    return f"<table>{title}{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"


def findings(items: Sequence[Finding], log: str = "") -> str:
    """A line for each finding, with what stands in front of it; "" without."""
    lines = (
        f"<li>{_text(log)}{f.severity}: {_text(f.message)} "
        f"<code>{_text(f.code)}</code> {_text(f.channel)}</li>"
        for f in items
    )
    return f"<ul>{''.join(lines)}</ul>" if items else ""


def _cell(tag: str, column: str, text: str) -> str:
    alignment = "left" if column in _TEXT_COLUMNS else "right"
    return f'<{tag} style="text-align:{alignment}">{_text(text)}</{tag}>'


def _text(text: str) -> str:
    return escape(printable(text))
