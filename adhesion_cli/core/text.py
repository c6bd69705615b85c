"""What people read: names from logs, which may be hostile, and numbers with an uncertainty."""

import math
import os
import re
import shlex
import sys
import unicodedata
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

# Control, format (bidi overrides, zero width, tags), surrogate, line and paragraph separators.
_UNSAFE = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
_BARE_WORD = re.compile(r"[\w%+=:./-]+")
_EVERY_SHELL = re.compile(r"[^\"'$`!\\\x00-\x1f]+")
NO_VALUE = re.compile(  # words in place of a number or a state that say that there is none
    r"(?i)\b(sna|snv|n/?a|not[ _]?(avail|valid|def|used)\w*|invalid|inv|err(or)?|fault\w*|fail\w*"
    r"|undef\w*|unspec\w*|reserved|unknown|no[ _]?(signal|value)|init\w*|ung(ü|ue)ltig|fehler\w*)\b"
)
_FURTHER = 3  # decimals that a small uncertainty adds; below it is one of the computer's numbers
_KIND_OF_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:")  # a letter alone is a drive


def printable(text: str) -> str:
    r"""The text on one line, with a code for every character that could control a terminal.

    >>> printable("speed\x1b[2J\u202e")
    'speed\\x1b[2J\\u202e'
    """
    if text.isprintable():  # the ordinary case; stricter than the rule below
        return text
    return "".join(
        c.encode("unicode_escape").decode() if unicodedata.category(c) in _UNSAFE else c
        for c in text
    )


def is_pasted_whole(text: str) -> bool:
    """Whether cmd, PowerShell and POSIX shells take the text as it is, in double quotes."""
    return _EVERY_SHELL.fullmatch(text) is not None


def stem(log: str | Path) -> str:
    """A log's name without its endings; a result's is that of the log it was made from."""
    name = Path(log).name.removesuffix(".gz")
    return name.removesuffix(Path(name).suffix).removesuffix(".adhesion")


def shell_word(text: str) -> str:
    r"""The text as one word for a shell.

    Double quotes mean the same to cmd, PowerShell and POSIX shells, single quotes do not.

    >>> shell_word("brake.csv"), shell_word("brake test.csv")
    ('brake.csv', '"brake test.csv"')
    """
    if _BARE_WORD.fullmatch(text):
        return text
    return f'"{text}"' if sys.platform == "win32" or is_pasted_whole(text) else shlex.quote(text)


def utf8(text: str) -> str:
    r"""The text with a code for what UTF-8 cannot hold, as some bytes of file names.

    >>> utf8("bad\udcff.csv")
    'bad\\udcff.csv'
    """
    return text.encode("utf-8", "backslashreplace").decode()


def as_url(path: Path) -> str | None:
    """The URL that somebody gave in place of a path; None for a path.

    >>> as_url(Path("s3://trains/2026"))
    's3://trains/2026'
    """
    kind, *path_parts = path.parts or ("",)  # a path has lost one of the slashes
    if not _KIND_OF_URL.fullmatch(kind) or Path(kind).exists():
        return None
    return f"{kind}//{'/'.join(path_parts)}"


def by_uncertainty(value: float, u: float, max_decimals: int = 15) -> tuple[str, str]:
    """A value and its uncertainty, with the digits that the uncertainty allows.

    Two significant digits of the uncertainty are kept, and the value to the same decimal place
    (GUM 7.2.6). Where `max_decimals` allow fewer, the uncertainty has one significant digit.

    >>> by_uncertainty(-7.398e-05, 0.00011)
    ('-0.00007', '0.00011')
    >>> by_uncertainty(-7.398e-05, 0.00011, 3)
    ('-0.0001', '0.0001')
    """
    if not 0.0 < u < math.inf:
        return f"{value:.4g}", f"{u:g}"
    first_digit = -int(f"{u:.1e}".partition("e")[2])
    decimals_limit = max(max_decimals, min(first_digit, max_decimals + _FURTHER))
    place = min(first_digit + 1, decimals_limit)
    # + 0.0: no "-0"
    value_text, u_text = (f"{round(x, place) + 0.0:.{max(place, 0)}f}" for x in (value, u))
    return value_text, u_text


def iso(t_ns: int) -> str:
    """A time stamp as ISO 8601, UTC, to the microsecond."""
    return datetime.fromtimestamp(t_ns // 1000 / 1e6, UTC).isoformat().replace("+00:00", "Z")


def listed(names: Iterable[str], limit: int = 6) -> str:
    """Names as a message lists them: the first ones, and how many there are."""
    quoted_names = [repr(n) for n in names]
    suffix = f", … ({len(quoted_names)})" if len(quoted_names) > limit else ""
    return ", ".join(quoted_names[:limit]) + suffix


def enumerated(items: Iterable[object]) -> str:
    """A list as a sentence has it: `1, 2 and 3`."""
    *leading, final = map(str, items)
    return f"{', '.join(leading)} and {final}" if leading else final


def distinct(names: list[str]) -> list[str]:
    """The same names, each later repetition numbered.

    >>> distinct(["a", "b", "a"])
    ['a', 'b', 'a (2)']
    """
    used_names, repeats, numbered = set(names), Counter[str](), []
    for name in names:
        repeats[name] += 1
        candidate = name
        while repeats[name] > 1 and (candidate := f"{name} ({repeats[name]})") in used_names:
            repeats[name] += 1
        used_names.add(candidate)
        numbered.append(candidate)
    return numbered


def drop_output() -> None:
    """Sends what is still to be printed nowhere, else the interpreter fails on it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
