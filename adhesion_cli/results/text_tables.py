"""Tables and folded lines of text, for a terminal and for a text panel of a recording."""

import io
import shutil
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

from ..core.finding import Finding
from ..core.summary import FindingSummary
from ..core.text import by_uncertainty, enumerated, printable
from ..rail.highest import SLIPPERY, is_known

NARROW = 80  # columns where there is no terminal, and in a recording
DASH = "-"  # where a number is not known
ED = "ED [%]"  # the column of the share of the ED brake
_DECIMALS = 6  # of a number with an uncertainty, at most
_INSTANT = 0.005  # a shorter span is one time [s]
_LOCKED = 0.9995  # slip that is shown as 100 %
_TEXT = 16  # columns that a text keeps
NOT_KNOWN = "not known"
DOUBT = "?"  # behind a µ of a log that contradicts its vehicle
MARK = "*"  # behind a µ without the force of another brake that acts
_OF_MARK = f"{MARK}: without the force of another brake that acts (`other-brake`)."
_OF_NOT_KNOWN = (
    f"{NOT_KNOWN}: the interval of µ, or of Fmax over the weight, holds both 0 and {SLIPPERY}, so "
    "that the number says nothing. A stated vehicle makes the interval narrower."
)


class TitledTable(NamedTuple):
    """A table on screen, page and recording; one without rows has its note only."""

    title: str
    rows: Sequence[Mapping[str, str]]
    text_columns: int = 1  # how many columns are texts, from the left
    note: str = ""  # below it, a line for each subject
    lead: str = ""  # above it
    figure: Any = None  # `campaign.Bars` above it on a page
    links: Mapping[str, str] = {}  # places on the page, by the text of a cell
    marked: str = ""  # the column in colour on a page

    def text(self) -> str:
        """The table without its title, as wide as the terminal."""
        lines = [self.lead] * bool(self.lead)
        lines += [records(self.rows, None, self.text_columns)] if self.rows else []
        return "\n".join([*lines, *map(folded, self.note.splitlines())])


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    text_columns: int = 1,
    width: int | None = None,
) -> str:
    """Columns under their header: texts to the left, numbers to the right.

    The first `text_columns` columns are texts. They are folded to `width`, or to the terminal; but
    names of logs lose their middle where they still differ.
    Names of columns and numbers are never folded: the table is wider where they have no room.
    """
    from rich.cells import cell_len
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    min_widths = []
    for i, name in enumerate(header):
        longest = max(cell_len(printable(row[i])) for row in (header, *rows))
        min_widths.append(max(min(longest, _TEXT), cell_len(name)) if i < text_columns else longest)
    columns = width or shutil.get_terminal_size((NARROW, 24)).columns
    gap = 2 if sum(min_widths) + 2 * (len(min_widths) - 1) <= columns else 1
    rows = _with_short_logs(header, rows, min_widths, columns - gap * (len(header) - 1))
    rich_table = Table(box=None, padding=(0, gap, 0, 0))
    for i, name in enumerate(header):
        alignment: Literal["left", "right"] = "left" if i < text_columns else "right"
        rich_table.add_column(
            Text(name), justify=alignment, no_wrap=i >= text_columns, min_width=min_widths[i]
        )
    for row in rows:
        rich_table.add_row(*(Text(printable(cell), overflow="fold") for cell in row))
    buffer = io.StringIO()
    columns = max(columns, sum(min_widths) + gap * (len(min_widths) - 1))
    Console(file=buffer, width=columns + gap, color_system=None).print(rich_table)
    lines = [line.rstrip() for line in buffer.getvalue().splitlines()]
    return "\n".join([lines[0], "-" * max(map(cell_len, lines)), *lines[1:]])


def _with_short_logs(
    header: Sequence[str], rows: Sequence[Sequence[str]], min_widths: Sequence[int], width: int
) -> Sequence[Sequence[str]]:
    """The rows; names of logs that have no room beside the other columns lose their middle."""
    if "log" not in header:
        return rows
    i = header.index("log")
    longest = [max(map(len, cells)) for cells in zip(header, *rows, strict=True)]
    room = max(width - sum(longest) + longest[i], min_widths[i])
    short_names = {row[i]: shortened(printable(row[i]), room, room // 2) for row in rows}
    differ = len({*short_names.values()}) == len(short_names)
    return [[*row[:i], short_names[row[i]], *row[i + 1 :]] for row in rows] if differ else rows


def shortened(text: str, width: int, last: int = 0) -> str:
    """The text in this width, with so many of its last characters."""
    if len(text) <= width:
        return text
    return f"{text[: width - last - 1].rstrip()}…{text[len(text) - last :].lstrip()}"


def records(
    rows: Sequence[Mapping[str, str]], width: int | None = None, text_columns: int = 1
) -> str:
    """A `table` of rows, whose keys are its header."""
    header = columns_of(rows)
    cells = [[row.get(key, DASH) for key in header] for row in rows]
    return table(header, cells, text_columns, width)


def columns_of(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """The columns of all rows; one that the first rows lack stands where the others have it.

    >>> columns_of([{"at": "1", "v": "2"}, {"at": "3", "clock": "4", "v": "5"}])
    ['at', 'clock', 'v']
    """
    columns: list[str] = []
    for row in rows:
        place = 0
        for name in row:
            if name not in columns:
                columns.insert(place, name)
            place = columns.index(name) + 1
    return columns


def non_empty(rows: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """The rows without the columns that hold no value."""
    heads = [x for x in columns_of(rows) if any(row.get(x, DASH) != DASH for row in rows)]
    return [{head: row.get(head, DASH) for head in heads} for row in rows]


def folded(text: str, indent: str = "", width: int | None = None) -> str:
    """A line of text as wide as `width`, or else the terminal; what follows indented."""
    width = width or shutil.get_terminal_size((NARROW, 24)).columns
    return textwrap.fill(
        text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def when_and_where(time: str | None, km: float | None = None) -> dict[str, str]:
    """The columns of the log's clock, from ISO 8601, and of the position, where a log has them."""
    clock = {"clock": time.partition("T")[2][:8]} if time else {}
    return clock if km is None else clock | {"km": number(km, 3)}


def number(value: float | None, digits: int = 0) -> str:
    """A number with fixed digits; a dash for None."""
    return DASH if value is None else f"{round(value, digits) + 0.0:.{digits}f}"  # no "-0"


def with_u95(x: Sequence[float | None] | None, factor: float = 1.0, digits: int = _DECIMALS) -> str:
    """A value with its uncertainty, the first two of `x`, times a factor; a dash without them."""
    if x is None:
        return DASH
    value, u95, *_ = x
    if value is None or u95 is None:
        return NOT_KNOWN
    return "±".join(by_uncertainty(factor * value, factor * u95, digits))


def describe_times(findings: Sequence[Finding | FindingSummary]) -> str:
    """The first time span and how many more there are; else how often."""
    spans = sorted(span for f in findings for span in f.spans)
    if not spans:
        count = sum(f.count for f in findings)
        return f"{count}×" if count > len(findings) else ""
    begin, stop = spans[0]
    first_span = f"{begin:.2f} s" if stop - begin < _INSTANT else f"{begin:.2f}–{stop:.2f} s"
    return f"{first_span} and {len(spans) - 1} more" if len(spans) > 1 else first_span


def numbered(numbers: Sequence[int]) -> str:
    """Numbers as a sentence has them; three or more in a row as a range.

    >>> numbered([1, 2, 3, 5, 7, 8])
    '1 to 3, 5, 7 and 8'
    """
    runs: list[list[int]] = []
    for place in sorted(numbers):
        if runs and place == runs[-1][-1] + 1:
            runs[-1].append(place)
        else:
            runs.append([place])
    parts: list[object] = []
    for run in runs:
        parts += [f"{run[0]} to {run[-1]}"] if len(run) > 2 else run
    return enumerated(parts)


def bounded_number(value: float | None, digits: int, bound: bool) -> str:
    """A number, marked if it is a lower bound."""
    return "≥ " * (bound and value is not None) + number(value, digits)


def energy_text(energy: float | None, u95: float | None, bound: bool) -> str:
    """The friction energy of slides [kJ] with its uncertainty, both in J; marked as a bound."""
    if energy is None or u95 is None:
        return bounded_number(energy and 1e-3 * energy, 1, bound)
    return "≥ " * bound + with_u95((energy, u95), 1e-3, 1)


def slip_text(slip: float | None, bound: bool, u95: float | None = None) -> str:
    """A largest slip [%]; of a locked wheel it is 100 %, whatever the train speed's error."""
    if slip is not None and slip > _LOCKED:
        return "100"
    if slip is not None and u95 is not None and not bound:
        return with_u95((slip, u95), 100.0, 1)
    return bounded_number(slip and 100.0 * slip, 1, bound)


def share_with_interval(share: float | None, interval: tuple[float, float] | None) -> str:
    """A share with its interval [%]; a dash where it is not known."""
    text = number(share if share is None else 100.0 * share)
    if share is None or interval is None:
        return text
    lower, upper = (number(100.0 * x) for x in interval)
    return f"{text} ({lower}–{upper})"


def coefficient_text(x: Sequence[float | None] | None, other_brake: bool = False) -> str:
    """µ with its uncertainty, the first two of `x`, marked if another brake acts; or not known."""
    if x is None:
        return DASH
    value, u95, *_ = x
    known = value is not None and u95 is not None and is_known(value, u95)
    return with_u95(x, 1.0, 3) + MARK * other_brake if known else NOT_KNOWN


def doubted(cell: str, in_doubt: bool) -> str:
    """A cell of µ, with a mark where the log contradicts its vehicle."""
    return cell + DOUBT * (in_doubt and cell not in (DASH, NOT_KNOWN))


def describe_cells(rows: Iterable[Mapping[str, str]]) -> str:
    """What a mark behind a number means, and why cells are not known; "" where there is neither."""
    cells = [cell for row in rows for cell in row.values()]
    is_marked = any("±" in cell and cell.endswith(MARK) for cell in cells)
    return " ".join(filter(None, [_OF_MARK * is_marked, _OF_NOT_KNOWN * (NOT_KNOWN in cells)]))
