"""Decides from its head how a text log is written, with the reason for each decision."""

import re
from collections import Counter
from collections.abc import Sequence
from itertools import filterfalse
from pathlib import Path

from ...core.errors import UserError
from ...core.units import in_name, unit
from .. import number_text
from ..number_text import group_mark, is_number, is_plain_number, number_grammar, unit_behind
from ..source import ReadOptions
from . import dialect
from .dialect import TEXT_MARK, Dialect, fit, is_comment, is_null, split, without_brackets
from .header import DELIMITERS, REMARKS, FirstRows, Header, column_names, find_header
from .header_words import label
from .lines import Line, encoding_of, first_lines, first_numbers, line_too_long
from .stamps import CLOCKS, DATES, STAMPS, forms_of, is_stamp

_MAX_COLUMNS = 10_000
_END_OF_HEADER = "***End_of_Header***"
_MARKED = re.compile(r"""(?:^|[;,\t|"])(?:'|="+)[-+.,0-9]""")  # by what makes a cell a text
_GROUPED = {m: re.compile(rf"[+-]?[1-9]\d{{0,2}}[{m}]\d{{3}}") for m in ".,"}
_SPACED = r"^([-+])\s+"  # a sign that stands apart, as GRAPHTEC writes it
# as a terminal's stamps; but a number in parentheses is below zero
_BRACKETED = r"^\[(.*[0-9])\]$", r"^[(<](.*[0-9]:.*[0-9])[)>]$"
_SECTION = re.compile(r"\[[A-Za-z ]+\]")  # a line as [data]
_TABS = 0.8  # of what tabs split must be worth a cell, to be no blanks that align columns


def detect_dialect(head: bytes, complete: bool, options: ReadOptions, path: Path) -> Dialect:
    """Decides how to read a file from its head.

    `head` has at most `HEAD_BYTES`, decompressed; `complete` says whether that is the whole file.

    Raises:
        UserError: where this is no table of numbers, or cannot be read only one way.
    """
    reasons: dict[str, str] = {}
    encoding, reasons["encoding"] = encoding_of(head, options.encoding, path)
    lines = first_lines(head, encoding, complete, path)
    preamble, body = _body(lines, complete, path)
    delimiter_given, directive = _stated_delimiter(body[0][1], options)
    body = body[bool(directive) :]
    texts = [text for _, text in body]
    delimiter, width, reasons["delimiter"] = _delimiter(texts, delimiter_given, path)
    if directive and options.delimiter is None:
        reasons["delimiter"] = f"{delimiter!r} (stated in the line {directive!r})"
    rows = [(number, _cells(text, delimiter, width)) for number, text in body]
    rows_above = [(number, split(text, delimiter)) for number, text in preamble]
    by_width = (x for _, x in rows if len(x) == width)
    of_width = [[c.removesuffix(unit_behind(c)).rstrip() for c in x] for x in by_width]
    decimal, reasons["decimal"] = _decimal(of_width, width, options, path)
    table = FirstRows(lines, rows, delimiter, width, decimal, path)
    header = find_header(table, options.header)
    rows_above += rows[: header.top]
    pairs = [x if any(x[1:]) else [c.strip() for c in x[0].split(":", 1)] for _, x in rows_above]
    labels = {kind: x for x in pairs if len(x) > 1 and (kind := label(x[0]))}
    if "names" in labels:
        header.names = [["", *labels["names"][1:]]]
    data = table.of_width(header.start)
    header.names = [_completed(x, data) for x in header.names]
    last_name = fit(header.names[-1], width)[-1] if header.names else ""
    # a delimiter at the end of each row makes an empty column
    used_width = width - (width > 2 and not last_name and not any(row[-1] for row in data))
    table.refuse_another(header.top)
    if options.header is not False:
        table.refuse_width(header, used_width)
    names = column_names(header.names, used_width)
    preamble_texts = tuple(x.strip() for number, x in lines if number < rows[header.top][0])
    units, units_reason = _units_row(table, header, labels, used_width)
    reasons |= {"header": _why_header(table, header, options), "units row": units_reason}
    reasons |= _reasons_around(lines, preamble_texts)
    units = list(map(without_brackets, fit(units, used_width)))
    data = [row[:used_width] for row in data]
    proven_mark = decimal if _proves_decimal(data, used_width, decimal) else ""
    removals = _clean(data, units, any(map(_MARKED.search, texts)), proven_mark)
    _refuse_grouped(data, names, decimal, options, path)
    return Dialect(
        width=width,
        names=names,
        header_cells=tuple(tuple(fit(x, used_width)) for x in header.names),
        units=tuple(units),
        rows=data,
        encoding=encoding,
        delimiter=delimiter,
        decimal=decimal,
        headed=bool(header.names),
        first_line=rows[header.start][0],
        reasons={k: x for k, x in reasons.items() if x},
        removals=removals,
        labels=labels,
        has_remarks=any(len(x) > width and x[width].casefold() in REMARKS for x in header.names),
        segments=_segments(preamble, rows_above),
        preamble=preamble_texts,
    )


def _reasons_around(lines: Sequence[Line], preamble: Sequence[str]) -> dict[str, str]:
    """What is said of comments and of the lines before the header."""
    preamble_lines = sum(not is_comment(x) for x in preamble if x.strip(" \t;,|"))
    comment = next((m[1] for _, text in lines if (m := dialect.COMMENT.match(text))), "")
    return {
        "comments": comment and f"lines starting with {comment!r} (seen in the head)",
        "preamble": f"{preamble_lines} lines (before the header)" if preamble_lines else "",
    }


def _segments(
    preamble: Sequence[tuple[int, str]], rows_above: Sequence[tuple[int, list[str]]]
) -> tuple[str, ...]:
    """The first cells of the header of a segment, which follows the own one of an LVM file."""
    header_ends = (k for k, (_, text) in enumerate(preamble, 1) if text.startswith(_END_OF_HEADER))
    own_lines = next(header_ends, 0)
    return tuple(cells[0] for _, cells in rows_above[own_lines:]) if preamble else ()


def _cells(text: str, delimiter: str, width: int) -> list[str]:
    """Cells of a line; names of several words, aligned by blanks, are parted by two."""
    cells = split(text, delimiter)
    if delimiter == " " and len(cells) != width:
        aligned = re.split(r"[ \t]{2,}|\t", text.strip())
        return aligned if len(aligned) == width else cells
    return cells


def _completed(names: list[str], data: list[list[str]]) -> list[str]:
    """The names of a header; with the one that lacks, where rows have one cell more.

    It numbers the rows, as R writes, or a delimiter parts a stamp: a blank the date from the clock,
    a comma the milliseconds from the seconds.
    """
    if len(data) < 3 or len(names) != len(data[0]) - 1:
        return names
    firsts, seconds = ([row[k] for row in data] for k in (0, 1))
    if firsts == [str(k) for k in range(1, len(firsts) + 1)]:
        return ["", *names]
    if forms_of(firsts, DATES) and forms_of(seconds, CLOCKS):
        return [names[0], *names]
    is_parted = forms_of(firsts, STAMPS) and all(re.fullmatch("[0-9]{3}", c) for c in seconds)
    return [names[0], "ms", *names[1:]] if is_parted else names


def _units_row(
    table: FirstRows, header: Header, labels: dict[str, list[str]], width: int
) -> tuple[list[str], str]:
    """The cells of the units row, none where there is none, and which row it is."""
    if header.units is not None:
        n, units = table.rows[header.units]
        return units, f"line {n} (every cell is a unit)"
    if "units" in labels and any(map(unit, labels["units"][1:])):
        return ["", *labels["units"][1:]], f"{labels['units'][0]!r} above the table"
    units = _units_of_sections(table.lines, width)
    return units, "in the sections above the table" if units else ""


def _units_of_sections(lines: list[Line], width: int) -> list[str]:
    """The units of a VBOX file: in long names of all columns, or listed for the last ones."""
    sections, name = dict[str, list[str]](), ""
    for text in (text.strip() for _, text in lines):
        if mark := _SECTION.fullmatch(text):
            name = mark[0]
        elif text:
            sections.setdefault(name, []).append(text)
    units = [in_name(x)[1] for x in sections.get("[header]", ())]
    if len(units) != width or "[column names]" not in sections:
        return []
    listed = sections.get("[channel units]", [])
    return units[: width - len(listed)] + listed


def _clean(
    rows: list[list[str]], units: list[str], has_text_marks: bool, decimal: str
) -> dict[int, str]:
    """Takes what numbers do not need out of the cells; returns its pattern by column.

    A unit behind the numbers of a column without one is its unit. Both lists are changed in place.
    `decimal` is the decimal mark, where some number proves it, else "".
    """
    removals = {}
    for i in range(len(units)):
        suffix, pattern = _needless([c for row in rows if not is_null(c := row[i])], decimal)
        units[i] = units[i] or suffix
        if has_text_marks and not pattern:
            removals[i] = TEXT_MARK.pattern
        elif pattern:
            removals[i] = pattern
            for row in rows:
                row[i] = re.sub(pattern, r"\1", row[i])
    return removals


def _needless(cells: list[str], decimal: str) -> tuple[str, str]:
    """The unit behind the numbers of a column, and the pattern of what these do not need.

    It is the unit, where at least half of the cells have it; or marks between groups of digits: of
    a clock, which cannot wait until all cells of the column are known, or the decimal mark itself.
    """
    texts = list(filterfalse(is_plain_number, cells))  # only these may have a unit
    for pattern in (*_BRACKETED, _SPACED) if texts else ():
        if all(re.match(pattern, c) for c in (texts if pattern == _SPACED else cells)):
            return "", pattern
    suffixes = Counter(map(unit_behind, texts)) if len(texts) >= len(cells) / 2 else Counter[str]()
    suffix, count = suffixes.most_common(1)[0] if suffixes else ("", 0)
    if suffix and count >= len(cells) / 2:
        return suffix, rf"()\s*{re.escape(suffix)}\s*$"
    mark = group_mark(cells, decimal)
    return "", rf"{re.escape(mark)}([0-9]{{3}})\b" if mark else ""


def _body(lines: list[Line], complete: bool, path: Path) -> tuple[list[Line], list[Line]]:
    """The header of an LVM file, and the lines that may be header or rows."""
    holes = [number for number, text in lines if "\0" in text]
    if len(holes) > len(lines) / 2:
        text = f"{path}: is binary or damaged: NUL bytes in line {holes[0]} and most others"
        raise UserError(text, "give a text log, or fetch it from the recorder again")
    body = [x for x in lines if x[1].strip(" \t;,|") and not is_comment(x[1]) and "\0" not in x[1]]
    body = [x for x in body if not _SECTION.fullmatch(x[1].strip())]
    marks = [k + 1 for k, x in enumerate(body) if x[1].startswith(_END_OF_HEADER)]
    start = marks[0] if marks else 0  # LabVIEW's header has rows of numbers
    if len(marks) > 1 and any(x[1].startswith("Channels") for x in body[start : marks[1]]):
        start = marks[1]
    preamble, body = body[:start], body[start:]
    if len(body) == 1 and not complete:
        raise line_too_long(lines[-1][0] + 1, path)
    if len(body) < 2:
        hint = "give a log with a header and data rows"
        raise UserError(f"{path}: {len(body)} line and no data rows", hint)
    return preamble, body


def _stated_delimiter(first_line: str, options: ReadOptions) -> tuple[str | None, str]:
    """The delimiter that the user or the first line, "sep=;", states; and that line, else ""."""
    delimiter = options.delimiter
    directive = re.fullmatch(r"sep=(.)", first_line.strip())
    if directive and delimiter is None:
        delimiter = directive[1]
    names = {"\\t": "\t", "tab": "\t", "space": " ", "whitespace": " "}
    delimiter = names.get(delimiter or "", delimiter)
    if delimiter is not None and not re.fullmatch(r'(?![\w".+-])[\t -~]', delimiter):
        hint = 'state it, as --set \'csv.delimiter = ";"\' (or ",", "|", "tab", "space")'
        raise UserError(f"delimiter {delimiter!r} is not one character between cells", hint, code=2)
    return delimiter, directive[0] if directive else ""


def _delimiter(lines: list[str], delimiter_given: str | None, path: Path) -> tuple[str, int, str]:
    sample = lines[max(len(lines) // 3, first_numbers(lines)) :][:300]
    best: tuple[float, int, str] | None = None
    largest_share = 0.0
    there = set().union(*sample)
    for delimiter in [delimiter_given] if delimiter_given else DELIMITERS:
        if there.isdisjoint(" \t" if delimiter == " " else delimiter):
            continue  # each line is one cell
        rows = [split(s, delimiter) for s in sample]
        weight: Counter[int] = Counter()
        for cells in rows:
            weight[len(cells)] += sum(is_number(c) or is_stamp(c) for c in cells)
        width = max(weight, key=lambda w: (weight[w], w), default=0)
        if width < 2:
            continue
        if width > _MAX_COLUMNS:
            hint = "export the channels that are needed"
            raise UserError(f"{path}: {width} columns, more than {_MAX_COLUMNS}", hint)
        fits = [cells for cells in rows if len(cells) == width]
        other_marks = {*";\t|,"} - {delimiter}
        all_cells = [c for cells in fits for c in cells]
        texts = [c for c in all_cells if not (is_null(c) or is_number(c) or is_stamp(c))]
        worth = len(all_cells) - len(texts) + 0.5 * sum(map(other_marks.isdisjoint, texts))
        share = len(fits) / len(rows)
        score = worth / len(all_cells) * share
        if delimiter == " " and best and best[2] == "\t" and best[0] > _TABS:
            continue  # blanks stand inside the cells, as between date and time
        if best is None or (round(score, 2), width) > (round(best[0], 2), best[1]):
            best, largest_share = (score, width, delimiter), share
    if best is None:
        hint = "a log needs a time column and one more; if it has, state what separates them, as "
        hint += "`--set csv.delimiter=semicolon`"
        raise UserError(f"{path}: no delimiter splits the rows into columns", hint)
    _, width, delimiter = best
    delimiter_name = "whitespace" if delimiter == " " else repr(delimiter)
    reason = f"{width} columns in {largest_share:.0%} of the head's rows"
    return delimiter, width, f"{delimiter_name} ({'stated' if delimiter_given else reason})"


def _decimal(
    rows: list[list[str]], width: int, options: ReadOptions, path: Path
) -> tuple[str, str]:
    """Decimal mark and why; refuses a comma that could group digits."""
    if options.decimal:
        if options.decimal not in (".", ","):
            text = f"decimal {options.decimal!r} is neither '.' nor ','"
            raise UserError(text, "state it, as `--set csv.decimal=comma`", code=2)
        return options.decimal, f"{options.decimal!r} (stated)"
    commas = 0  # columns with decimal commas, less those with decimal points
    example, doubtful = "", list[str]()
    for i in range(width):
        cells = [c for row in rows if is_number(c := row[i])]
        if group_mark(cells):
            continue
        comma, dot = ([c for c in cells if m in c] for m in ",.")
        dot = [c for c in dot if not _GROUPED["."].fullmatch(c)]  # which no decimals are
        if comma or dot:
            commas += 1 if len(comma) > len(dot) else -1
        example, doubtful = example or "".join(comma[:1]), doubtful or (comma and cells)
    if commas <= 0:
        return ".", "'.' (no decimal comma in most columns)"
    is_in_clock = any(re.search(r":[0-9]{2},[0-9]", c) for row in rows for c in row)
    if not (is_in_clock or _proves_decimal(rows, width, ",")):
        text = f"{path}: {example!r} may be a decimal comma or grouped thousands"
        raise UserError(text, _likelier(doubtful, ","))
    return ",", f"',' (as in {example!r})"


def _refuse_grouped(
    rows: list[list[str]], names: tuple[str, ...], decimal: str, options: ReadOptions, path: Path
) -> None:
    """Refuses numbers with points that could be thousands separators.

    One program writes a file: a point that is a decimal mark in one column groups digits in none.
    """
    if decimal != "." or options.decimal or _proves_decimal(rows, len(names), "."):
        return
    number = number_grammar(decimal)
    for i, name in enumerate(names):
        cells = [row[i] for row in rows if number.fullmatch(row[i])]
        dotted = [c for c in cells if "." in c]
        integers = [c for c in cells if c.isdigit()]
        if len(dotted) > 1 and integers and all(len(c) <= 3 for c in integers):
            text = f"{path}: column {name!r}: {dotted[0]!r} and {integers[0]!r} may be grouped "
            raise UserError(text + "thousands or a decimal point", _likelier(cells, "."))


def _likelier(cells: list[str], mark: str) -> str:
    """How to state the decimal mark: this one, or the other where groups make smaller jumps."""
    numbers = list(filter(number_grammar(mark).fullmatch, cells))
    mark_names = ["comma", "point"] if mark == "," else ["point", "comma"]
    likely, unlikely = mark_names[:: -1 if number_text.has_smaller_jumps(numbers, mark) else 1]
    return f"state it, as `--set csv.decimal={likely}` (or {unlikely})"


def _proves_decimal(rows: list[list[str]], width: int, mark: str) -> bool:
    """Whether some number cannot be grouped digits."""
    number = number_grammar(mark)
    cells = (c for row in rows for c in row[:width])
    return any(mark in c and number.fullmatch(c) and not _GROUPED[mark].fullmatch(c) for c in cells)


def _why_header(table: FirstRows, header: Header, options: ReadOptions) -> str:
    if not header.names:
        return f"none ({'stated' if options.header is False else 'the rows start with numbers'})"
    if named := header.named(table):
        lines = " + ".join(f"line {n}" for n, _ in named)
        return f"{lines} ({'stated' if options.header else 'text above numbers'})"
    if header.top < header.start:
        return "a row of names above the table"
    return "a comment line above the data (it names as many columns)"
