"""How a table's time column, group column and units row are known by their words."""

import re
import tomllib
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from ...core import units

_S = 1_000_000_000
NS_PER_UNIT = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": _S}
NS_PER_UNIT |= {"min": 60 * _S, "h": 3_600 * _S, "d": 86_400 * _S}

_VOCABULARY = tomllib.loads(Path(__file__).with_name("header_words.toml").read_text("utf-8"))
_PARTS = {word: part for part, words in _VOCABULARY["parts"].items() for word in words.split()}
_LABELS = {word: kind for kind, words in _VOCABULARY["labels"].items() for word in words.split()}
_TIME: list[str] = _VOCABULARY["time"].split()
_UNITS_ROW = frozenset(_VOCABULARY["units_row"].split())
GROUP, SIGNAL, VALUE, UNITS, STATISTICS, TYPES, _QUALITY = (
    frozenset(_VOCABULARY[kind].split())
    for kind in ("group", "signal", "value", "units", "statistics", "types", "quality")
)
# Behind the name of a time.
_REMARK = re.compile(
    r"(?i)\s*[\[(](?:UTC|GMT|local|ISO ?8601|[a-z]{1,4}[-/:.]\D\S*|hh?mm?s\S*|\d+)[\])]$"
)


def normal(text: str) -> str:
    """The text as it is compared: compatibility forms folded, no case, no separators."""
    return re.sub(r"[\s_.\-]+", "", unicodedata.normalize("NFKC", text).casefold())


def time_unit(text: str) -> str | None:
    """Unit of time that a text states: a key of `NS_PER_UNIT`, or one with a factor.

    >>> time_unit("(Sec.)"), time_unit("[10 ms]"), time_unit("bar")
    ('s', '10 ms', None)
    >>> time_unit("s/10")
    '1/10 s'
    """
    text = re.sub(r"^(\w+)\s*/\s*(10+)$", r"1/\2 \1", text.strip(" .[](){}<>"))
    unit = units.unit(text) or units.rare_unit(text)
    return unit.name if unit and unit.dimension == "time" else None


@lru_cache(1 << 12)  # a live sender repeats its names in each message
def time_name(header: str) -> tuple[int, str | None] | None:
    """Rank (lower is likelier) and stated unit of a header that names time, None of another.

    "t [ms]", "time_ms", "Zeit (s)", "时间(s)", "Time/s", "timeMs", "elapsed_seconds".
    """
    text = unicodedata.normalize("NFKC", header).strip()
    if len(text) > 80:
        return None
    unit = None
    for pattern in (
        r"^(.*?)\s*[\[(<{]\s*([^\])>}]*)\s*[\])>}]$",
        r"^(.*?)\s*(?:/|,|\bin\b)\s*(\w+)$",
        r"^(.*?)[ _\-.](\w+)$",
        r"^(.*?[a-z])(Ns|Us|Ms|S|Sec)$",
    ):
        split = re.match(pattern, text)
        named_unit = time_unit(split[2]) if split else None
        # a factor stands in brackets: "time_10s" is a mean
        if split and named_unit and (named_unit in NS_PER_UNIT or pattern.endswith("]$")):
            text, unit = split[1], named_unit
            break
    else:  # "Time [hh:mm:ss.fff]", "Timestamp (UTC)"
        text = _REMARK.sub("", text)
    name = normal(text)
    base_name = name.rstrip("0123456789")
    if len(base_name) > 2 or unit:  # "time2", "t2 [s]"; T1 and T2 alone are temperatures
        name = base_name or name
    if name == "tid" and unit:  # else a thread's number
        name = "tidpunkt"
    if name not in _TIME:
        return None
    own_unit = "s" if name == "xvalue" else time_unit(name if name not in ("t", "h", "s") else "")
    return _TIME.index(name), unit or own_unit


def time_part(header: str) -> str | None:
    """Which part of the time a header names, as a group of `stamps.toml`.

    >>> time_part("/axle/header/stamp/nanosec"), time_part("Minute"), time_part("min. speed")
    ('N', 'M', None)
    """
    unit = units.unit(units.in_name(header)[1])
    if unit and unit.dimension != "time":  # "km/h" is no hour
        return None
    return _PARTS.get(normal(re.split(r"[/.](?=\w)", header)[-1]).strip("[](){}"))


def label(cell: str) -> str | None:
    """What a row above a table holds by its first cell: "names", "units", "interval" and so on."""
    return _LABELS.get(normal(re.sub(r"(?<=\w)\s*[\[(].*", "", cell)).strip(":[]"))


def unit_of(text: str) -> units.Unit | None:
    """The unit that a text is, or has in its name."""
    return units.unit(text) or units.unit(units.in_name(text)[1])


def interval_s(kind: str | None, number: float, texts: Iterable[str]) -> float:
    """Seconds between samples by a label's kind, its number and texts of its unit; 0 for none."""
    stated_units = [unit for unit in map(unit_of, texts) if unit]
    dimension = {"interval": "time", "rate": "pulse rate"}.get(kind or "")
    if not dimension or number <= 0.0 or any(x.dimension != dimension for x in stated_units):
        return 0.0
    number *= stated_units[0].factor if stated_units else 1.0
    return number if kind == "interval" else 1.0 / number


@lru_cache(1 << 10)
def quality_column(names: tuple[str, ...], i: int) -> int | None:
    """The column that says how good the values of column `i` are, None for none.

    Where a row has the values of several channels, another one's quality says nothing.

    >>> quality_column(("t", "p [bar]", "p quality", "v", "v quality"), 1)
    2
    """
    own_name = "" if is_named(names[i], VALUE) else normal(units.in_name(names[i])[0])
    normal_names = [normal(name) for name in names]
    qualities = {own_name + word for word in _QUALITY}
    return next((k for k, name in enumerate(normal_names) if name in qualities), None)


def speaks_of_time(header: str) -> bool:
    """Whether a word of a header that need not name time does: "t_p", "Time pressure [s]"."""
    tokens = re.findall(r"[^\W\d_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", header).casefold())
    return any(word in _TIME for word in tokens)


@lru_cache(1 << 12)
def is_named(header: str, vocabulary: frozenset[str]) -> bool:
    """Whether a header is one of the words."""
    return normal(header) in vocabulary


def is_statistic(cell: str) -> bool:
    """Whether a row is of statistics by its first cell, as "Max" and "Max. range"."""
    return not STATISTICS.isdisjoint((normal(cell.strip(":")), normal(cell.partition(" ")[0])))


def is_units_row(cells: list[str]) -> bool:
    """Whether the cells of a row are units: all of them, or most and the others short.

    Letters that are names as well (t, v, p, a) count only where every cell is a unit.
    """
    said = [unicodedata.normalize("NFKC", c).casefold().replace(" ", "") for c in cells if c]
    has_plain = not _UNITS_ROW.isdisjoint(said)  # so that "0.5bar" is no number with its unit
    unit_cells = [
        c in _UNITS_ROW
        or (has_plain and c[0].isdecimal() and units.unit(c) is not None)
        or re.fullmatch(r"[\[({<][^\])}>]{0,16}[\])}>]|[hmsdyf.:/-]{4,}", c) is not None
        for c in said
    ]
    if not any(c not in ("-", "--") for c in said):
        return False
    certain = sum(k and (len(c) > 1 or c in "s%°-") for k, c in zip(unit_cells, said, strict=True))
    all_short = all(k or len(c) <= 10 for k, c in zip(unit_cells, said, strict=True))
    return all(unit_cells) or (all_short and certain >= 2 / 3 * len(said))
