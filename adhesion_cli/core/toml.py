"""TOML from the user, bounded in size, and TOML that a message shows."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from .errors import UserError
from .text import is_pasted_whole, shell_word

_MOST_BYTES = 1 << 20  # bytes of a file
_LONGEST = 4_000  # characters of a line; the parser's memory is the square of a key's dots
DEEPEST = 16  # tables and lists inside each other
_NAMES_IN_HINT = 5  # names of files in a hint
BARE_NUMBER = re.compile(r"[+-]?(\.\d+|\d+\.)(e[+-]?\d+)?")  # as people write, and TOML does not
_MOST_OPTIONS = 8  # in a hint
_LARGEST = 1e18  # no number of a setting is larger


Table = dict[str, Any]  # of TOML, as `tomllib` gives it


def read(path: Path, hint: str) -> Table:
    """The tables of a file; a UserError for what is no TOML or too large, with this `hint`."""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
        if len(data) > _MOST_BYTES:
            raise UserError(f"{path}: is larger than {_MOST_BYTES >> 20} MiB", hint, code=2)
        return parsed(data.decode("utf-8-sig"), str(path))
    except FileNotFoundError:
        raise UserError(f"{path}: no such file", _nearby(path), code=2) from None
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}", hint, code=2) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: {error}", hint, code=2) from error


def _nearby(path: Path) -> str:
    """What there is in place of a missing file: the nearest TOML file, or those of its folder."""
    folder = path.parent
    if not folder.is_dir():
        return f"there is no folder {str(folder)!r}"
    names = {p.stem: p.name for p in sorted(folder.glob("*.toml"))}
    if nearest := get_close_matches(path.stem, names, n=1, cutoff=0.5):
        return f"did you mean {str(folder / names[nearest[0]])!r}?"
    listing = ", ".join([*names.values()][:_NAMES_IN_HINT] + ["…"] * (len(names) > _NAMES_IN_HINT))
    return f"TOML files in {str(folder)!r}: {listing or 'none'}"


def parsed(text: str, origin: str) -> Table:
    """The tables of a text, named `origin` in errors: finite numbers of bounded size and depth.

    Raises TOMLDecodeError where it is not TOML, UserError where it is too large.
    """
    text = text.replace("\r\n", "\n")
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > _LONGEST:
            problem = f"line {number} ({line[:40]}…) has more than {_LONGEST} characters"
            raise UserError(f"{origin}: {problem}", "write shorter keys and values", code=2)
    try:
        tree = tomllib.loads(text)
    except RecursionError:
        raise _too_deep(origin, text.partition("=")[0].strip()) from None
    return bounded(tree, origin)


def bounded(tree: Table, origin: str) -> Table:
    """The same tree; a UserError where it is too deep, or a number is not finite or too large."""
    pending: list[tuple[tuple[str, ...], Any]] = [((), tree)]
    while pending:
        keys, value = pending.pop()
        if len(keys) > DEEPEST:
            raise _too_deep(origin, keys[0])
        if isinstance(value, (int, float)) and not abs(value) <= _LARGEST:
            number = value if isinstance(value, float) else "an integer of many digits"
            problem = f"{'.'.join(keys)} = {number} is not finite, or too large"
            raise UserError(f"{origin}: {problem}", "write a plain number", code=2)
        if isinstance(value, list):
            value = dict(enumerate(value, 1))
        if isinstance(value, dict):
            pending += [((*keys, str(key)), inner) for key, inner in value.items()]
    return tree


def _too_deep(origin: str, key: str) -> UserError:
    problem = f"{key[:40]} is nested deeper than {DEEPEST} levels"
    return UserError(f"{origin}: {problem}", "settings have two or three levels", code=2)


def target(path: Path) -> Path:
    """The file that settings are written to; a UserError for another suffix."""
    if path.suffix.lower() != ".toml":
        raise UserError(f"{path}: settings are TOML", "-o FILE.toml", code=2)
    return path


def quoted(text: str) -> str:
    """A TOML basic string."""
    return json.dumps(text, ensure_ascii=False)


def table(entries: Mapping[str, str | int]) -> str:
    """A table in one line, without what is empty."""
    return value({k: v for k, v in entries.items() if v})


def key(name: str) -> str:
    """A key, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quoted(name)


def value(item: Any) -> str:
    """A value in one line; a number with nine digits."""
    if isinstance(item, Mapping):
        return "{" + ", ".join(f"{key(k)} = {value(v)}" for k, v in item.items()) + "}"
    if isinstance(item, Sequence) and not isinstance(item, str):
        return "[" + ", ".join(map(value, item)) + "]"
    return (
        repr(float(f"{item:.9g}"))
        if isinstance(item, float)
        else json.dumps(item, ensure_ascii=False)
    )


def option(*lines: str) -> str:
    """The options that state lines of TOML, as `--set vehicle.friction=0.3`, in back quotes.

    A text that cannot be pasted into every shell makes them lines for `adhesion.toml`. Each line
    has its heading: it may as well stand at the top of a TOML file.
    """
    values = [pair for line in lines for pair in _values(tomllib.loads(line), "")]
    texts = [f"{name}={x if isinstance(x, str) else value(x)}" for name, x in values]
    is_short = len(texts) <= _MOST_OPTIONS and all(map(is_pasted_whole, texts))
    if not is_short or any(isinstance(x, str) and not _is_bare_text(x) for _, x in values):
        return " and ".join(f"`{line}`" for line in lines) + " in adhesion.toml"
    return f"`{' '.join(f'--set {shell_word(text)}' for text in texts)}`"


def _values(tree: Table, heading: str) -> Iterator[tuple[str, Any]]:
    for name, item in tree.items():
        path = heading + re.sub("^(axle|bogie) ", r"\1", name)
        if isinstance(item, Mapping):
            yield from _values(dict(item), f"{path}.")
        else:
            yield path, item


def _is_bare_text(text: str) -> bool:
    """Whether a text without quotes is read as the same text."""
    try:
        number = tomllib.loads(f"x = {text}")["x"]
        return type(number) in (int, float) and abs(number) <= _LARGEST and str(number) == text
    except tomllib.TOMLDecodeError:
        return text == text.strip() and not BARE_NUMBER.fullmatch(text)
