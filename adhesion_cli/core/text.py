"""Names and texts from logs may be hostile. They are made safe here before anyone sees them."""

import unicodedata
from collections import Counter

# Control, format (bidi overrides, zero width, tags), surrogate, line and paragraph separators.
_UNSAFE = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


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


def utf8(text: str) -> str:
    r"""The text with a code for what UTF-8 cannot hold, as some bytes of file names.

    >>> utf8("bad\udcff.csv")
    'bad\\udcff.csv'
    """
    return text.encode("utf-8", "backslashreplace").decode()


def distinct(names: list[str]) -> list[str]:
    """The same names, each later repetition numbered.

    >>> distinct(["a", "b", "a"])
    ['a', 'b', 'a (2)']
    """
    taken, repeats, numbered = set(names), Counter[str](), []
    for name in names:
        repeats[name] += 1
        free = name
        while repeats[name] > 1 and (free := f"{name} ({repeats[name]})") in taken:
            repeats[name] += 1
        taken.add(free)
        numbered.append(free)
    return numbered
