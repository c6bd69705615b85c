"""The first bytes of a text log: their format, encoding and lines."""

import codecs
import re
from collections.abc import Sequence
from pathlib import Path

from ...core.errors import UserError
from ..number_text import plain
from .dialect import HEAD_BYTES

_HEAD_LINES = 600
_OPEN_QUOTE = re.compile(r'(?:^|[;,\t|])\s*"[^"]*$')  # of a cell that goes on in the next line
_DATA = re.compile(r'\s*"?[+-]?[0-9]')  # begin of a line of numbers
_MOST_LINE_ENDS = 20  # in the cells of one row
_CONTROLS = bytes(b for b in range(1, 32) if b not in b"\t\n\r\f\v\x1a\x1b")
FORMATS = "CSV, MCAP, Parquet, Excel, MATLAB, MDF 4, TDMS, CAN (BLF, ASC, TRC, candump, BUSMASTER)"
READABLE = f"give a log in one of the formats: {FORMATS}"
Line = tuple[int, str]  # number, from 1, and text
# Shift-JIS: kana and kanji that no European text has as two bytes, then any kanji. Two neighbours
# are a word; one alone may be a dash, an apostrophe or a per mille sign of cp1252 and what follows.
_OWN = rb"(?:\x82[\x9f-\xf1]|\x83[\x40-\x7e\x80-\x96]|[\x88-\x9f][\x80-\xfc])"
_ANY = rb"(?:\x81\x5b|\x82[\x9f-\xf1]|[\x83\x88-\x9f][\x40-\x7e\x80-\xfc])"
_JAPANESE = re.compile(rb"%b%b+|%b%b+" % (_OWN, _ANY, _ANY, _OWN))

# Words for pressure, speed and wheel by which a codec is known, and the first codec that has them.
_WORDS = {
    "cp1250": "ciśni prędko koła tlak nyomás presiun",
    "cp1251": "давлен скорост тиск швидк ось км/ч",
    "cp866": "давлен скорост",
    "big5": "壓力 速度 時間",
    "euc_kr": "압력 속도 시간",
}


def encoding_of(head: bytes, encoding: str | None, path: Path) -> tuple[str, int, str]:
    """Codec, bytes of byte order mark, and why.

    Raises:
        UserError: where the file is binary, or the stated encoding unknown.
    """
    for mark, codec in (
        (codecs.BOM_UTF8, "utf-8"),
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
    ):
        if head.startswith(mark):
            return codec, len(mark), f"{codec} (byte order mark)"
    codec, reason = _given_encoding(head, encoding, path) if encoding else _guessed(head, path)
    return codec, 0, f"{codec} ({reason})"


def _given_encoding(head: bytes, encoding: str, path: Path) -> tuple[str, str]:
    try:
        codec = codecs.lookup(encoding).name
        b"a".decode(codec, "replace")  # refuses codecs that are no text, as base64
    except (LookupError, UnicodeError):
        hint = "state it, as `--set csv.encoding=utf-16` (or utf-8, gb18030, cp1252)"
        raise UserError(f"{path}: unknown encoding {encoding!r}", hint) from None
    if codec == "utf-16":  # without a mark: whichever half holds the NULs of ASCII
        codec = "utf-16-be" if head[0:4000:2].count(0) > head[1:4000:2].count(0) else "utf-16-le"
    return codec, "stated"


def _guessed(head: bytes, path: Path) -> tuple[str, str]:
    even_zeros, odd_zeros = head[0::2].count(0), head[1::2].count(0)
    for rarer, commoner, codec in (
        (even_zeros, odd_zeros, "utf-16-le"),
        (odd_zeros, even_zeros, "utf-16-be"),
    ):
        if commoner > len(head) // 5 and rarer <= commoner // 50:
            return codec, "every second byte is NUL"
    controls = len(head) - len(head.translate(None, _CONTROLS))
    if controls > max(4, len(head) // 200):
        raise UserError(f"{path}: is a binary file, not CSV", READABLE)
    if head.isascii():
        return "utf-8", "only ASCII in the head"
    if _decodes(head, "utf-8"):
        return "utf-8", "the head decodes"
    for codec, known_words in _WORDS.items():
        # bytes have no letters beyond ASCII, so each word is looked for in three forms
        spellings = (f(x) for x in known_words.split() for f in (str.lower, str.upper, str.title))
        if any(spelling.encode(codec) in head for spelling in spellings):
            return codec, "not UTF-8; words of its languages"
    high_bytes = len(re.findall(rb"[\x80-\xff]", head))
    # Chinese text is pairs of high bytes; a Latin-1 umlaut, degree or micro sign stands alone
    pairs = 2 * len(re.findall(rb"[\xa1-\xf7][\xa1-\xfe]", head))
    if pairs > 0.5 * high_bytes and (
        _decodes(head, "gb18030") or (pairs > 0.9 * high_bytes and high_bytes > 50)
    ):
        return "gb18030", "not UTF-8; high bytes come in pairs"
    in_words = sum(map(len, _JAPANESE.findall(head)))  # bytes
    if 2 * in_words > high_bytes and _decodes(head, "cp932"):
        return "cp932", "not UTF-8; words of Shift-JIS"
    return "cp1252", "not UTF-8; high bytes stand alone"


def _decodes(head: bytes, codec: str) -> bool:
    try:
        codecs.getincrementaldecoder(codec)("strict").decode(head)
    except UnicodeDecodeError:
        return False
    return True


def first_lines(head: bytes, encoding: str, complete: bool, path: Path) -> list[Line]:
    """The first lines that are whole.

    Raises:
        UserError: where the text is empty, HTML, XML or JSON, or a line is too long.
    """
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, complete)
    text = plain(text.replace("\r\n", "\n").replace("\r", "\n"))
    _refuse_other_texts(text, path)
    lines = text.split("\n")
    if not complete and len(lines) == 1:
        hint = "give a text log with one row per line"
        raise UserError(f"{path}: no line end in the first {len(text) >> 10} KiB", hint)
    if not complete or not lines[-1]:
        lines.pop()
    lines = lines[: max(_HEAD_LINES, 2 * first_numbers(lines))]
    for number, line in enumerate(lines, 1):
        if len(line) > HEAD_BYTES // 2:
            raise line_too_long(number, path)
    return _with_line_ends(list(enumerate(lines, 1)))


def first_numbers(lines: Sequence[str]) -> int:
    """Index of the first line that begins with a number, 0 where others are not a preamble."""
    is_data = [_DATA.match(line) is not None for line in lines]
    begin = is_data.index(True) if True in is_data else 0
    return begin if 2 * sum(is_data) > max(begin, len(lines) - begin) else 0


def _with_line_ends(lines: list[Line]) -> list[Line]:
    """The lines; those above the data whose quotes close in a later line are one with it."""
    joined: list[Line] = []
    for k, (number, text) in enumerate(lines):
        if _DATA.match(text):
            return [*joined, *lines[k:]]
        previous_text = joined[-1][1] if joined else ""
        if _OPEN_QUOTE.search(previous_text) and previous_text.count("\n") < _MOST_LINE_ENDS:
            joined[-1] = joined[-1][0], f"{previous_text}\n{text}"
        else:
            joined.append((number, text))
    return joined


def _refuse_other_texts(text: str, path: Path) -> None:
    start = text[:2000].lstrip().casefold()
    if re.match(r"<(!--|!doctype|html|head|body|table|\?xml)", start):
        raise UserError(f"{path}: is HTML or XML, not CSV", "download the log itself, not the page")
    if re.match(r"[{\[]\s*[\[{\"]", start) and "}" in start:
        raise UserError(f"{path}: is JSON, not CSV", f"export the log as one of: {FORMATS}")
    if not text.strip("\n\t "):
        raise UserError(f"{path}: is empty", "give a log with a header and data rows")
    if not text.strip("\0\n\t "):
        text = f"{path}: holds nothing but NUL bytes: space that was reserved and never written"
        raise UserError(text, "fetch the log from the recorder again")


def line_too_long(line: int, path: Path) -> UserError:
    """The refusal of a line of more than half of the head."""
    hint = "give a text log with one row per line"
    return UserError(f"{path}: line {line} is longer than {HEAD_BYTES >> 11} KiB", hint)
