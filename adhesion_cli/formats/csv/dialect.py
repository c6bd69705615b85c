"""What a delimited text file looks like, decided from its head, with the reason for each decision.

Plain Python over a bounded head; reading the values is the job of `csv`.
"""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...core.errors import UserError
from ...core.units import in_name
from ..source import ReadOptions
from .header_words import is_signal_name, is_units_name, is_units_row, normal, time_name

HEAD_BYTES = 1 << 20
MAX_COLUMNS = 10_000
DELIMITERS = (";", "\t", ",", "|", " ")
_HEAD_LINES = 600
_TABS = 0.8  # of what tabs split must be worth a cell, to be no blanks that align columns

NULLS = (
    "", "NaN", "nan", "NAN", "-nan", "NULL", "null", "Null", "None", "none", "N/A", "n/a", "NA",
    "-", "--", "---", "#N/A", "#NA", "#NV",
)  # fmt: skip
INFINITE = (
    "inf", "-inf", "+inf", "Inf", "-Inf", "+Inf", "INF", "-INF", "+INF",
    "Infinity", "-Infinity", "infinity", "-infinity",
)  # fmt: skip
_NULLS = frozenset((*NULLS, *INFINITE))

_COMMENT = re.compile(r"\s*(#(?!N/?A\b|NV\b|DIV/0|VALUE!|REF!)|%|//)")
_DATE = (
    r"(?:\d{1,4}[-/.年]\d{1,2}[-/.月]\d{1,4}日?|\d{1,2}[-. ]?[A-Za-zä]{3}\.?[-. ]?\d{2,4}|\d{8})"
)
_CLOCK = (
    r"\d{1,3}:\d{2}(?::\d{2}(?:[.,]\d+|:\d{3})?|[.,]\d+)?(?:\s*[AaPp][Mm])?"
    r"\s*(?:Z|UTC|GMT|[+-]\d{2}:?\d{0,2})?"
)
_STAMP = re.compile(rf"(?:{_DATE}(?:[T ,_]+{_CLOCK})?|{_CLOCK})")
_OPEN_QUOTE = re.compile(r'(?:^|[;,\t|] ?)"[^"]*(?:""[^"]*)*$')
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:[., '’\u00a0\u202f]\d{3})+(?:[.,]\d+)?")
_CONTROLS = bytes(b for b in range(1, 32) if b not in b"\t\n\r\f\v\x1a\x1b")
_REMARKS = ("comment", "comments", "remark", "remarks", "kommentar", "bemerkung", "备注", "注释")
_MAGIC = (
    (b"\x89MCAP0\r\n", "an MCAP file", "give it the suffix .mcap"),
    (b"PK\x03\x04", "an Excel workbook (.xlsx) or ZIP archive", "export it as CSV"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook (.xls)", "export the sheet as CSV"),
    (b"\x89HDF", "an HDF5 or MATLAB v7.3 file", "export the signals as CSV"),
    (b"MATLAB 5.0", "a MATLAB file", "export the signals as CSV"),
    (b"MDF     ", "an ASAM MDF recording", "export the signals as CSV"),
    (b"%PDF-", "a PDF document", "export the log as CSV"),
    (b"PAR1", "a Parquet file", "export it as CSV"),
    (b"SQLite format 3", "an SQLite database", "export the table as CSV"),
    (b"\x28\xb5\x2f\xfd", "zstd-compressed", "decompress it first"),
    (b"BZh", "bzip2-compressed", "decompress it first"),
    (b"\xfd7zXZ", "xz-compressed", "decompress it first"),
    (b"\xff\xd8\xff", "a JPEG image", "give a log"),
    (b"\x89PNG", "a PNG image", "give a log"),
    (b"version https://git-lfs", "a Git LFS pointer", "fetch the file it stands for: git lfs pull"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Dialect:
    """How to read one file; `why` gives each decision with its reason."""

    encoding: str  # Python codec; UTF-8 passes through undecoded
    bom: int  # bytes before the text
    delimiter: str  # one character; " " stands for runs of spaces and tabs
    decimal: str
    comment: str  # prefix of comment lines, "" where none was seen
    width: int  # cells of each data row, one more than `names` where rows end in a delimiter
    names: tuple[str, ...]  # one per column, distinct: the header text, else "column N"
    parts: tuple[tuple[str, ...], ...]  # cells of each header row, for headers of several rows
    units: tuple[str, ...]  # units row, "" where it says nothing
    duplicates: tuple[str, ...]  # header texts that stand above several columns
    headed: bool
    first_line: int  # line of the first data row, from 1
    before: dict[str, int]  # lines before it, by class
    first: dict[str, tuple[int, str]]  # the first line of each class, and its text
    metadata: dict[str, str]  # key: value lines of the preamble
    rows: list[list[str]]  # data rows of the head, each as wide as `names`
    why: dict[str, str] = field(default_factory=dict)
    above: tuple[tuple[int, int, str], ...] = ()  # rows above the header: first, last line, text

    def number(self) -> re.Pattern[str]:
        """Strict grammar of a number in this dialect."""
        return number_grammar(self.decimal)

    def column(self, index: int) -> list[str]:
        """Non-null cells of a column in the head's rows."""
        return [c for row in self.rows if not is_null(c := row[index])]

    def numbers(self, index: int) -> list[float]:
        """Numbers of a column in the head's rows."""
        number = self.number()
        cells = (c for c in self.column(index) if number.fullmatch(c))
        return [float(c.replace(",", ".")) for c in cells]

    def contradicted(self, cells: list[str]) -> bool:
        """Whether a row among the data is a header, or a units row, of other columns than ours."""
        said = [c for c in cells if c]
        if not self.headed or len(said) < max(2, len(cells) / 2):
            return False
        if is_units_row(cells):
            ours = [u or in_name(n)[1] for n, u in zip(self.names, self.units, strict=True)]
            pairs = zip(ours, map(_bare, _fit(cells, len(ours))), strict=True)
            return any(normal(a) != normal(b) for a, b in pairs if b)
        known = {normal(c) for row in self.parts for c in row if c}
        names = sum(normal(c) in known or bool(in_name(c)[1]) for c in said)
        if not any(map(time_name, said)) and (names < len(said) / 2 or any(map(_is_number, said))):
            return False
        row = "\0".join(map(normal, cells)).rstrip("\0")  # it may have been cut off
        return not any("\0".join(map(normal, ours)).startswith(row) for ours in self.parts)


def number_grammar(decimal: str) -> re.Pattern[str]:
    """ASCII digits, one decimal mark, an exponent; no hex, no "_", no grouping."""
    d = re.escape(decimal)
    return re.compile(rf"[+-]?(?:[0-9]+(?:{d}[0-9]*)?|{d}[0-9]+)(?:[eE][+-]?[0-9]{{1,3}})?")


def is_null(cell: str) -> bool:
    """Whether a cell is one of the spellings of "no value", or of infinity."""
    return cell in _NULLS


def is_comment(line: str) -> bool:
    """Whether a line is a comment ("#", "%", "//"), Excel's error values excepted."""
    return _COMMENT.match(line) is not None


def uncommented(line: str) -> str:
    """A line without the mark that makes it a comment."""
    return _COMMENT.sub("", line, count=1).strip() if is_comment(line) else line


def sniff(head: bytes, complete: bool, options: ReadOptions, path: Path) -> Dialect:
    """Decide how to read a file from its head.

    Args:
        head: first bytes of the (decompressed) file, `HEAD_BYTES` at most.
        complete: whether that is the whole file.
        options: what the user stated; it beats what the head suggests.
        path: for messages.

    Raises:
        UserError: where this is no table of numbers, or cannot be read only one way.
    """
    _refuse_other_formats(head, path)
    why: dict[str, str] = {}
    encoding, bom, why["encoding"] = _encoding(head, options, path)
    text = _decode(head[bom:], encoding, complete)
    _refuse_text_formats(text, path)
    lines = _logical_lines(text, complete, path)
    body, block = _body(lines, complete, path)
    stated, directive = _stated_delimiter(body[0][1], options)
    if directive:
        body = body[1:]
    delimiter, width, why["delimiter"] = _delimiter([s for _, s in body], stated, path)
    if directive and options.delimiter is None:
        why["delimiter"] = f"{delimiter!r} (stated in the line {directive!r})"
    table, labelled = _labelled([(n, split(s, delimiter)) for n, s in body], width)
    labelled += [(n, split(s, delimiter)) for n, s in block]
    rows = [cells for _, cells in table if len(cells) == width]
    decimal, why["decimal"] = _decimal(rows, width, options, path)
    texts = dict(body)
    heads, of_units, top, start = _head(
        table, texts, lines, (delimiter, width, decimal), options, path
    )
    first_line = table[start][0]
    cells_per_row = width
    data = [c for _, c in table[start:] if len(c) == width]
    width = _without_trailing(heads, data, width)
    named = [(n, cells) for n, cells in table[top:start] if cells in heads]
    if not heads and options.header is None:
        named = [(n, cells) for n, cells in table[max(0, top - 2) : top] if _names_time(cells)]
    _refuse_width(named, texts, data, width, delimiter, path)
    names, duplicates = _names(heads, width)
    _refuse_grouped(data, names, decimal, options, path)
    rows_above = _rows_above(
        [(n, n + more, s) for n, s, more in lines if n in texts and n < table[top][0]]
    )
    before, first = _lines_before(lines, table, (top, start, of_units), rows_above)
    preamble = [cells for n, cells in table[:top]]
    comment = next((m[1] for _, s, _ in lines if (m := _COMMENT.match(s))), "")
    lines_above = [n for n, cells in table[top:start] if cells in heads]
    why["header"] = _why_header(bool(heads), lines_above, options)
    unit_cells: list[str] = []
    if of_units is not None:
        n, unit_cells = table[of_units]
        why["units row"] = f"line {n} (every cell is a unit)"
    elif found := _labelled_units(labelled):
        n, (label, *unit_cells) = found
        why["units row"] = f"line {n} (its first cell is {label!r})"
        unit_cells.insert(0, "")
    if comment:
        why["comments"] = f"lines starting with {comment!r} (seen in the head)"
    if before["preamble"]:
        why["preamble"] = f"{before['preamble']} lines (before the header)"
    return Dialect(
        encoding, bom, delimiter, decimal, comment, cells_per_row, names,
        tuple(tuple(_fit(h, width)) for h in heads),
        tuple(_bare(c) for c in _fit(unit_cells, width)),
        duplicates, bool(heads), first_line, dict(before), first, _metadata(preamble),
        [row[: len(names)] for row in data], why, rows_above,
    )  # fmt: skip


def _body(
    lines: list[tuple[int, str, int]], complete: bool, path: Path
) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    """Numbered lines that may be header or rows, and those of LabVIEW's header before them.

    Raises:
        UserError: where there are too few for a table, or most are no text.
    """
    holes = [n for n, s, _ in lines if "\0" in s]
    if len(holes) > len(lines) / 2:
        raise UserError(
            f"{path}: is binary or damaged: NUL bytes in line {holes[0]} and most others",
            "give a text log",
        )
    body = [(n, s) for n, s, _ in lines if s.strip() and not is_comment(s) and "\0" not in s]
    marks = [k for k, (_, s) in enumerate(body) if s.startswith("***End_of_Header***")]
    block = body[: marks[-1]] if marks else []  # LabVIEW's header, which has rows of numbers
    body = body[marks[-1] + 1 :] if marks else body
    if not body:
        raise UserError(f"{path}: holds no rows", "give a log with a header and data rows")
    if len(body) == 1 and complete:
        raise UserError(
            f"{path}: one line ({body[0][1][:40]!r}) and no data rows",
            "give a log with a header and data rows",
        )
    if len(body) == 1:
        raise _too_long(lines[-1][0] + 1 + lines[-1][2], path)
    return body, block


def _head(
    table: list[tuple[int, list[str]]],
    texts: dict[int, str],
    lines: list[tuple[int, str, int]],
    form: tuple[str, int, str],
    options: ReadOptions,
    path: Path,
) -> tuple[list[list[str]], int | None, int, int]:
    """The header, wherever it stands.

    Args:
        table: the numbered rows.
        texts: what they say, by their numbers.
        lines: all lines of the head, comments too.
        form: delimiter, number of columns, decimal mark.
        options: `header` beats what the rows suggest.
        path: for messages.

    Returns:
        Its rows, top first; the index in `table` of the units row, of the topmost row of these,
        and of the first row of data.

    Raises:
        UserError: where there are no data rows.
    """
    delimiter, width, decimal = form
    start = _first_data(table, width, decimal)
    if start is None:
        raise UserError(
            f"{path}: no data rows under the header (no row of {width} cells holds numbers)",
            "give a log with data rows; if its numbers use a decimal comma, state decimal = \",\" "
            "under [csv]",
        )  # fmt: skip
    if options.header is False:
        return [], None, start, start
    heads, units, top = _headers(table, start, width, decimal)
    if heads:
        return heads, units, top, start
    if options.header:
        if start + 1 >= len(table):
            raise UserError(f"{path}: header only, no data rows", "give a log with data rows")
        return [table[start][1]], None, start, start + 1
    heads = _commented_header(lines, table[start][0], delimiter, width)
    if not heads and delimiter == " " and start > 0:
        heads = _aligned_header(texts[table[start - 1][0]], width)
        top -= len(heads)
    return heads, units, top, start


def _stated_delimiter(first: str, options: ReadOptions) -> tuple[str | None, str]:
    """The delimiter that the user or the first line, "sep=;", states; and that line, else ""."""
    stated = options.delimiter
    directive = re.fullmatch(r"sep=(.)", first.strip())
    if directive and stated is None:
        stated = directive[1]
    stated = {"\\t": "\t", "tab": "\t", "space": " ", "whitespace": " "}.get(stated or "", stated)
    if stated is not None and (
        not re.fullmatch(r"[\t -~]", stated) or re.match(r'[\w".+-]', stated)
    ):
        raise UserError(
            f"delimiter {stated!r} is not one character between cells",
            'state ";", ",", "|", "tab" or "space"', 2,
        )  # fmt: skip
    return stated, directive[0] if directive else ""


def _why_header(headed: bool, above: list[int], options: ReadOptions) -> str:
    """Why these lines are the header, none of them where it is a comment or there is none."""
    if not headed:
        return f"none ({'stated' if options.header is False else 'the rows start with numbers'})"
    if above:
        lines = " + ".join(f"line {n}" for n in above)
        return f"{lines} ({'stated' if options.header else 'text above numbers'})"
    return "a comment line above the data (it names as many columns)"


def split(line: str, delimiter: str) -> list[str]:
    """Cells of one logical line, stripped of blanks around them."""
    if delimiter == " ":
        line = re.sub(r"[ \t]+", " ", line.strip())
    try:
        return [
            c.strip()
            for c in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
        ]
    except csv.Error:  # a cell beyond the reader's limit of 128 KiB
        return [line]


def _refuse_other_formats(head: bytes, path: Path) -> None:
    for magic, what, remedy in _MAGIC:
        if head.startswith(magic):
            raise UserError(f"{path}: is {what}, not CSV", remedy)


def _refuse_text_formats(text: str, path: Path) -> None:
    start = text[:2000].lstrip().casefold()
    if re.match(r"<(!--|!doctype|html|head|body|table|\?xml)", start):
        raise UserError(f"{path}: is HTML or XML, not CSV", "download the log itself, not the page")
    if re.match(r"[{\[]\s*[\[{\"]", start) and "}" in start:
        raise UserError(f"{path}: is JSON, not CSV", "export the log as CSV or MCAP")


def _encoding(head: bytes, options: ReadOptions, path: Path) -> tuple[str, int, str]:  # noqa: C901, PLR0912
    """Codec, bytes of byte order mark, and why."""
    for mark, codec in (
        (codecs.BOM_UTF8, "utf-8"),
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
    ):
        if head.startswith(mark):
            return codec, len(mark), f"{codec} (byte order mark)"
    if options.encoding:
        try:
            codec = codecs.lookup(options.encoding).name
            b"a".decode(codec, "replace")  # refuses codecs that are no text, as base64
        except (LookupError, UnicodeError):
            raise UserError(
                f"{path}: unknown encoding {options.encoding!r}",
                "state utf-8, utf-16, gb18030 or cp1252",
            ) from None
        if codec == "utf-16":  # without a mark: whichever half holds the NULs of ASCII
            codec = (
                "utf-16-be" if head[0:4000:2].count(0) > head[1:4000:2].count(0) else "utf-16-le"
            )
        return codec, 0, f"{codec} (stated)"
    if 0 in head:
        even, odd = head[0::2].count(0), head[1::2].count(0)
        for few, many, codec in ((even, odd, "utf-16-le"), (odd, even, "utf-16-be")):
            if many > len(head) // 5 and few <= many // 50:
                return codec, 0, f"{codec} (every second byte is NUL)"
    controls = len(head) - len(head.translate(None, _CONTROLS))
    if controls > max(4, len(head) // 200):
        raise UserError(f"{path}: is a binary file, not CSV", "give a CSV or MCAP log")
    if head.isascii():
        return "utf-8", 0, "utf-8 (only ASCII in the head)"
    try:
        codecs.getincrementaldecoder("utf-8")("strict").decode(head)
        return "utf-8", 0, "utf-8 (the head decodes)"
    except UnicodeDecodeError:
        pass
    high = len(re.findall(rb"[\x80-\xff]", head))
    # Chinese text is pairs of high bytes; a Latin-1 umlaut, degree or micro sign stands alone
    pairs = 2 * len(re.findall(rb"[\xa1-\xf7][\xa1-\xfe]", head))
    try:
        codecs.getincrementaldecoder("gb18030")("strict").decode(head)
        if pairs > 0.5 * high:
            return "gb18030", 0, "gb18030 (not UTF-8; high bytes come in pairs)"
    except UnicodeDecodeError:
        pass
    if pairs > 0.9 * high and high > 50:
        return "gb18030", 0, "gb18030 (not UTF-8; high bytes come in pairs)"
    return "cp1252", 0, "cp1252 (not UTF-8; high bytes stand alone)"


def _decode(head: bytes, encoding: str, complete: bool) -> str:
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, complete)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _logical_lines(text: str, complete: bool, path: Path) -> list[tuple[int, str, int]]:
    """(line number, text, further lines inside quotes) of the head's first lines."""
    if not text.strip("\n\t "):
        raise UserError(f"{path}: is empty", "give a log with a header and data rows")
    if not text.strip("\0\n\t "):
        raise UserError(
            f"{path}: holds nothing but NUL bytes: space that was reserved and never written",
            "fetch the log from the recorder again",
        )
    lines = text.split("\n", 4 * _HEAD_LINES)
    if not complete and len(lines) == 1:
        raise UserError(
            f"{path}: no line end in the first {len(text) >> 10} KiB",
            "give a text log with one row per line",
        )
    if not complete or len(lines) > 4 * _HEAD_LINES or not lines[-1]:
        lines.pop()
    out: list[tuple[int, str, int]] = []
    i = 0
    while i < len(lines) and len(out) < _HEAD_LINES:
        line, more = lines[i], 0
        if _OPEN_QUOTE.search(line) and not is_comment(line):
            for k in range(1, min(100, len(lines) - i)):
                if lines[i + k].count('"') % 2:
                    line, more = "\n".join(lines[i : i + k + 1]), k
                    break
        if len(line) > HEAD_BYTES // 2:
            raise _too_long(i + 1, path)
        out.append((i + 1, line, more))
        i += 1 + more
    return out


def _too_long(line: int, path: Path) -> UserError:
    return UserError(
        f"{path}: line {line} is longer than {HEAD_BYTES >> 11} KiB",
        "give a text log with one row per line",
    )


def _is_number(cell: str) -> bool:
    return _DOT.fullmatch(cell) is not None or _COMMA.fullmatch(cell) is not None


_DOT, _COMMA = number_grammar("."), number_grammar(",")


def _delimiter(lines: list[str], stated: str | None, path: Path) -> tuple[str, int, str]:
    """Delimiter, number of columns, and why."""
    sample = lines[len(lines) // 3 :][:300]
    best: tuple[float, int, str] | None = None
    found = 0.0
    for delimiter in [stated] if stated else DELIMITERS:
        rows = [split(s, delimiter) for s in sample]
        weight: Counter[int] = Counter()
        for cells in rows:
            weight[len(cells)] += sum(1 for c in cells if _is_number(c) or _STAMP.fullmatch(c))
        if not weight:
            continue
        width = max(weight, key=lambda w: (weight[w], w))
        if width < 2:
            continue
        if width > MAX_COLUMNS:
            raise UserError(
                f"{path}: {width} columns, more than {MAX_COLUMNS}",
                "export the channels that are needed",
            )
        fits = [cells for cells in rows if len(cells) == width]
        worth = sum(_worth(c, delimiter) for cells in fits for c in cells)
        share = len(fits) / len(rows)
        score = worth / sum(len(c) for c in fits) * share
        if delimiter == " " and best and best[2] == "\t" and best[0] > _TABS:
            continue  # blanks stand inside the cells, as between date and time
        if best is None or (round(score, 2), width) > (round(best[0], 2), best[1]):
            best, found = (score, width, delimiter), share
    if best is None:
        raise UserError(
            f"{path}: no delimiter splits the rows into columns",
            'a log needs a time column and one more; state delimiter = ";" under [csv] if it has',
        )
    _, width, delimiter = best
    shown = "whitespace" if delimiter == " " else repr(delimiter)
    reason = "stated" if stated else f"{width} columns in {found:.0%} of the head's rows"
    return delimiter, width, f"{shown} ({reason})"


def _worth(cell: str, delimiter: str) -> float:
    if is_null(cell) or _is_number(cell) or _STAMP.fullmatch(cell) or _GROUPED.fullmatch(cell):
        return 1.0
    return 0.0 if any(d in cell for d in ";\t|," if d != delimiter) else 0.5


def _decimal(
    rows: list[list[str]], width: int, options: ReadOptions, path: Path
) -> tuple[str, str]:
    """Decimal mark and why; refuses a comma that could group digits."""
    if options.decimal:
        if options.decimal not in (".", ","):
            raise UserError(f"decimal {options.decimal!r} is neither '.' nor ','", code=2)
        decimal, reason = options.decimal, "stated"
    else:
        marks: Counter[str] = Counter()
        example = ""
        for i in range(width):
            cells = [row[i] for row in rows]
            comma = [c for c in cells if "," in c and _COMMA.fullmatch(c)]
            dot = [c for c in cells if "." in c and _DOT.fullmatch(c)]
            if comma or dot:
                marks["," if len(comma) > len(dot) else "."] += 1
            example = example or (comma[0] if comma else "")
        decimal = "," if marks[","] > marks["."] else "."
        reason = f"as in {example!r}" if decimal == "," else "no decimal comma in most columns"
        if decimal == "," and not _proves_decimal(rows, width, ","):
            raise UserError(
                f"{path}: {example!r} may be a decimal comma or grouped thousands",
                'state decimal = "," (or ".") under [csv]',
            )
    return decimal, f"{decimal!r} ({reason})"


def _refuse_grouped(
    rows: list[list[str]], names: tuple[str, ...], decimal: str, options: ReadOptions, path: Path
) -> None:
    """Refuses numbers with thousands separators, and points that could be some.

    One program writes a file: a point that is a decimal mark in one column groups digits in none.
    """
    number = number_grammar(decimal)
    sure = decimal != "." or bool(options.decimal) or _proves_decimal(rows, len(names), ".")
    for i, name in enumerate(names):
        cells = [row[i] for row in rows if not is_null(row[i])]
        grouped = [c for c in cells if _GROUPED.fullmatch(c) and not number.fullmatch(c)]
        numbers = sum(bool(number.fullmatch(c)) for c in cells)
        if grouped and numbers + len(grouped) > len(cells) / 2 and not _STAMP.fullmatch(grouped[0]):
            mark = re.sub("[+0-9-]", "", grouped[0])[0]
            either = mark in ",." and all(c.count(mark) == 1 for c in grouped)
            bare = grouped[0].replace(mark, "")
            raise UserError(
                f"{path}: column {name!r} groups digits, as in {grouped[0]!r}",
                f"export it without thousands separators, as {bare!r}"
                + (f"; if {mark!r} is its decimal mark, with {decimal!r} as the others"
                   if either and mark != decimal else ""),
            )  # fmt: skip
        dotted = [c for c in cells if "." in c and number.fullmatch(c)]
        whole = [c for c in cells if c.isascii() and c.isdigit()]
        if (
            not sure
            and len(dotted) > 1
            and whole
            and all(re.fullmatch(r"[+-]?[1-9]\d{0,2}\.\d{3}", c) for c in dotted)
            and all(len(c) <= 3 for c in whole)
        ):
            raise UserError(
                f"{path}: column {name!r}: {dotted[0]!r} beside {whole[0]!r} may be grouped "
                "thousands or a decimal point",
                'state decimal = "." under [csv] if it is a decimal point',
            )


def _proves_decimal(rows: list[list[str]], width: int, mark: str) -> bool:
    """Whether some number cannot be grouped digits."""
    number = number_grammar(mark)
    grouped = re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(mark)}\d{{3}}")
    return any(
        mark in c and number.fullmatch(c) and not grouped.fullmatch(c)
        for row in rows
        for c in row[:width]
    )


def _first_data(table: list[tuple[int, list[str]]], width: int, decimal: str) -> int | None:
    """Index of the first row that reads like the rows at the end of the head."""
    number = number_grammar(decimal)

    def typed(c: str) -> bool:
        return number.fullmatch(c) is not None or _STAMP.fullmatch(c) is not None

    tail = [cells for _, cells in table[len(table) // 3 :] if len(cells) == width]
    if not tail:
        return None
    numeric = []
    for i in range(width):
        said = [row[i] for row in tail if not is_null(row[i])]
        if said and sum(typed(c) for c in said) >= 0.5 * len(said):
            numeric.append(i)

    def like(cells: list[str]) -> bool:
        remark = len(cells) == width + 1 and not is_null(cells[-1]) and not typed(cells[-1])
        if len(cells) != width and not remark:
            return False
        said = [cells[i] for i in numeric if not is_null(cells[i])]
        words = [c for c in said if not typed(c)]
        if any(time_name(c) for c in words):  # a header whose other names are numbers
            return False
        return len(words) < 0.5 * len(said)

    flags = [like(cells) for _, cells in table]
    for i, flag in enumerate(flags):
        near = flags[i : i + 6]
        if flag and sum(near) >= 0.3 * len(near):
            return i
    return None


def _labelled(
    table: list[tuple[int, list[str]]], width: int
) -> tuple[list[tuple[int, list[str]]], list[tuple[int, list[str]]]]:
    """The table without the rows that its first column names and data rows leave without a name.

    Exports of TDMS channels have them below the header, as "Channel", "unit_string", "Length".

    Returns:
        Table and labelled rows.
    """
    tail = [cells for _, cells in table[len(table) // 3 :] if len(cells) == width]
    if any(cells[0] for cells in tail):
        return table, []
    head = next((i for i, (_, cells) in enumerate(table) if is_signal_name(cells[0])), len(table))
    rows = [(n, cells) for n, cells in table[head + 1 :] if cells[0]]
    return [row for row in table if row not in rows], rows


def _labelled_units(labelled: list[tuple[int, list[str]]]) -> tuple[int, list[str]] | None:
    """The row of units among rows that their first cell names; its line, its cells."""
    if any(cells[:2] == ["X_Columns", "Multi"] for _, cells in labelled):
        return None  # LabVIEW's with a time for each channel: the units have other places
    return next(((n, cells) for n, cells in labelled if is_units_name(cells[0])), None)


def _headers(  # noqa: C901
    table: list[tuple[int, list[str]]], start: int, width: int, decimal: str
) -> tuple[list[list[str]], int | None, int]:
    """Header rows above the data (top first); index of the units row, and of the topmost row."""
    number = number_grammar(decimal)

    def texts(cells: list[str]) -> bool:
        if not width - 1 <= len(cells) <= width + 1 or (len(cells) < width and width == 2):
            return False
        said = [c for c in cells if c]
        if any(time_name(c) for c in said):
            return True
        return bool(said) and not any(number.fullmatch(c) for c in said if c not in ("-", "1"))

    def of_units(k: int) -> bool:
        """Whether row k is a row of units below one of names."""
        if k < 1 or not (texts(table[k][1]) and is_units_row(table[k][1])):
            return False
        above = table[k - 1][1]
        return texts(above) and sum(bool(c) for c in above) >= len(above) / 2

    top, units = start, None
    heads: list[list[str]] = []
    if of_units(start - 1):
        top = units = start - 1
    elif of_units(start - 2) and texts(table[start - 1][1]):  # remarks stand below the units
        top = units = start - 2
    while top > 0 and len(heads) < 4:
        cells = table[top - 1][1]
        said = sum(bool(c) for c in cells)
        pairs = sum(bool(re.match(r"[^:=\[(]+[:=]\s*\S", c)) for c in cells)
        if not texts(cells):
            # Names that are numbers are no names, but a short or long header must be told of
            break
        if not heads:
            if said < len(cells) / 2 or (pairs > said / 2 and said < len(cells)):
                break
        elif units is None and len(cells) == width and is_units_row(cells):
            top = units = top - 1  # above the names
            break
        else:
            repeated = len(set(heads[0])) < len(heads[0])
            spanning = repeated and said >= 2 and len(cells) == width
            full = width > 2 and said == len(cells) == width and len(heads) < 2
            if pairs > said / 2 or not (spanning or full):
                break
        heads.insert(0, cells)
        top -= 1
    return heads, units, top


def _names_time(cells: list[str]) -> bool:
    """Whether a row reads like a header: a time among names, and no number."""
    return any(map(time_name, cells)) and not any(
        _is_number(c) or _STAMP.fullmatch(c) for c in cells
    )


def _rows_above(lines: list[tuple[int, int, str]]) -> tuple[tuple[int, int, str], ...]:
    """Lines before the header that are rows of another table: two or more in turn, of one width.

    Each begins with a number or a stamp, as do half of its cells, whatever delimits them.
    """

    def form(text: str) -> tuple[str, int] | None:
        for delimiter in DELIMITERS:
            cells = split(text, delimiter)
            typed = [_is_number(c) or bool(_STAMP.fullmatch(c)) for c in cells if not is_null(c)]
            if sum(typed) >= max(2, len(typed) / 2) and typed[0]:
                return delimiter, len(cells)
        return None

    forms = [None, *(form(text) for _, _, text in lines), None]
    return tuple(
        line
        for k, line in enumerate(lines, 1)
        if forms[k] and forms[k] in (forms[k - 1], forms[k + 1])
    )


def _commented_header(
    lines: list[tuple[int, str, int]], first_line: int, delimiter: str, width: int
) -> list[list[str]]:
    """Names in the last comment line above the data, as numpy writes them."""
    for n, text, _ in reversed(lines):
        if n < first_line and is_comment(text):
            cells = split(uncommented(text), delimiter)
            return [cells] if len(cells) == width and not any(map(_is_number, cells)) else []
    return []


def _aligned_header(line: str, width: int) -> list[list[str]]:
    """Names that have blanks in them, above columns that blanks align: two stand between names."""
    cells = re.split(r"\s{2,}|\t", line.strip())
    return [cells] if len(cells) == width and _names_time(cells) else []


def _without_trailing(heads: list[list[str]], data: list[list[str]], width: int) -> int:
    """Width without the empty column that a delimiter at the end of each row makes."""
    empty = all(not row[-1] for row in data)
    if empty and width > 2 and (not heads or len(heads[-1]) < width or not heads[-1][-1]):
        return width - 1
    return width


def _refuse_width(
    heads: list[tuple[int, list[str]]],
    texts: dict[int, str],
    data: list[list[str]],
    width: int,
    delimiter: str,
    path: Path,
) -> None:
    """Refuses a header of another width than the rows; `texts` are the lines by their numbers.

    Raises:
        UserError: names both, and where the comma is decimal mark as well, that.
    """
    for n, cells in heads:
        extra = [c for c in cells[width:] if c and c.casefold() not in _REMARKS]
        if len(cells) >= width and not extra:
            continue
        if _OPEN_QUOTE.search(texts[n]):
            raise UserError(
                f"{path}: the quote opened in line {n} does not close",
                "mend the quotes in that line",
            )
        text = f"{path}: the header (line {n}) names {len(cells)} columns, the rows have {width}"
        said = [c for row in data for c in row if c]
        whole = delimiter == "," and all(re.fullmatch(r"[+-]?[0-9]+", c) for c in said)
        if whole and width > len(cells) and any(re.fullmatch("0[0-9]+", c) for c in said):
            raise UserError(
                f"{text}: the comma is delimiter and decimal mark at once",
                "export it with semicolons between the cells, or with decimal points",
            )
        raise UserError(
            text,
            "mend the header, or state header = false under [csv] and map the columns as "
            '"column 1", "column 2", …',
        )


def _fit(cells: list[str], width: int) -> list[str]:
    return (cells + [""] * width)[:width]


def _bare(unit: str) -> str:
    """A units cell without its brackets; "" for a dash."""
    found = re.fullmatch(r"[\[({<](.*)[\])}>]", unit)
    text = (found[1] if found else unit).strip()
    return "" if text in ("-", "--") else text


def _names(heads: list[list[str]], width: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Distinct names, and those that stood above several columns."""
    filled = []
    for k, cells in enumerate(heads):
        cells = _fit(cells, width)
        if k < len(heads) - 1:  # a title above several columns stands in the first of them
            last = ""
            for i, c in enumerate(cells):
                last = c or last
                cells[i] = last
        filled.append(cells)
    names: list[str] = []
    taken: set[str] = set()
    seen: Counter[str] = Counter()
    for i in range(width):
        name = " ".join(dict.fromkeys(row[i] for row in filled if row[i])) or f"column {i + 1}"
        seen[name] += 1
        while name in taken:
            name = f"{name} ({seen[name]})"
        taken.add(name)
        names.append(name)
    return tuple(names), tuple(n for n, k in seen.items() if k > 1)


def _lines_before(
    lines: list[tuple[int, str, int]],
    table: list[tuple[int, list[str]]],
    header: tuple[int, int, int | None],
    rows_above: Sequence[tuple[int, int, str]],
) -> tuple[Counter[str], dict[str, tuple[int, str]]]:
    """Lines before the first data row: how many of each class, and the first of each.

    Args:
        lines: those of the head: number, text, further lines inside quotes.
        table: the numbered rows.
        header: indices in `table` of its first row, of the first data row and of the units row.
        rows_above: those that are rows of another table.
    """
    top, start, units = header
    above = {line for line, _, _ in rows_above}

    def kind(line: int, text: str) -> str:
        if not text.strip():
            return "blank"
        if "\0" in text:
            return "NUL bytes"
        if is_comment(text):
            return "comment"
        if top < start and line >= table[top][0]:
            return "units" if units is not None and line == table[units][0] else "header"
        return "another table" if line in above else "preamble"

    before: Counter[str] = Counter()
    first: dict[str, tuple[int, str]] = {}
    for line, text, more in lines:
        if line < table[start][0]:
            of = kind(line, text)
            before[of] += 1
            before["inside quotes"] += more
            first.setdefault(of, (line, text))
    return +before, first


def _metadata(preamble: list[list[str]]) -> dict[str, str]:
    """`key: value` and `key = value` cells, and rows of just a key and a value."""
    out: dict[str, str] = {}
    for cells in preamble:
        said = [c for c in cells if c]
        found = [m for c in said if (m := re.match(r"([^:=]{1,80}?)\s*[:=]\s*(.+)", c))]
        if len(found) == len(said):
            out.update((m[1], m[2]) for m in found)
        elif len(said) == 2:
            out[said[0].rstrip(" :=")] = said[1]
    return out
