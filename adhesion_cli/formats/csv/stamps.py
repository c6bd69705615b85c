"""Dates and clocks: the forms in which logs write them, and the times that cells of a form say.

A form is a pattern; its named groups are the parts of a stamp, see `stamps.toml`.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ...core.model import Bools, Times

READABLE = 0.5  # of a time column's first cells must be readable
_LONGEST_LOG = 7  # days that a log may be long
_SAMPLE = 50  # cells that show whether a form is worth a look
_S = 1_000_000_000
_DAY = 86_400 * _S
_FRACTIONS = {"f": 1, "l": 1_000_000, "u": 1_000, "N": 1}  # groups, and their unit [ns]
_FRACTION = "(?P<f>[0-9]+)"
_COUNTS = ("(?P<l>[0-9]{1,3})", "(?P<u>[0-9]{1,6})")  # of it: milliseconds, microseconds
_FORMS = tomllib.loads(Path(__file__).with_name("stamps.toml").read_text("utf-8"))

_ZONES = {x: int(k) * 3600 for k, names in _FORMS["zones"].items() for x in names.split()}
_ZONE = _FORMS["zone"].replace("ZONES", "|".join(_ZONES))

_CLOCKS, _AFTER_DATE = (
    {name: pattern + _ZONE for name, pattern in _FORMS[kind].items()}
    for kind in ("clocks", "after_date")
)
DATES: dict[str, str] = {k: x for k, x in _FORMS["dates"].items() if "CLOCK" not in x}
CLOCKS: dict[str, str] = _CLOCKS | _FORMS["alone"]
DIGITS: dict[str, str] = _FORMS["after_date"]  # a clock only beside a date or milliseconds
STAMPS, SHORT_STAMPS = (  # date and clock, by the name of each
    {
        f"{clock} {date}": (form if "CLOCK" in form else f"{form}{_FORMS['gap']}CLOCK").replace(
            "CLOCK", pattern
        )
        for date, form in _FORMS[kind].items()
        for clock, pattern in (_CLOCKS | _AFTER_DATE).items()
    }
    for kind in ("dates", "short_dates")
)
_MONTHS = {name: int(k) for k, names in _FORMS["months"].items() for name in names.split()}

_ANY = [
    re.compile(re.sub(r"\?P<\w>", "?:", "|".join(forms.values())))
    for forms in (CLOCKS | {"": "[0-9]{1,3}:[0-9]{2}"}, DATES, STAMPS)
]


@lru_cache(1 << 14)  # as of `is_number`
def is_stamp(cell: str) -> bool:
    """Whether a cell reads like a date, a time of day or both."""
    return cell != "" and any(form.fullmatch(cell) for form in _ANY)


def month_number(name: str) -> int:
    """The number of a month by its name or the first letters of it, 0 of none.

    >>> month_number("Sept"), month_number("juillet"), month_number("bar")
    (9, 7, 0)
    """
    begins = [k for k in _MONTHS if name.casefold().startswith(k)]
    return _MONTHS[max(begins, key=len)] if begins else 0


def forms_of(cells: Sequence[str], forms: Mapping[str, str], order: str | None = None) -> list[str]:
    """Names of forms in which most cells are read, none if few; `order` of a date is as "dmy"."""
    sample = cells[:: len(cells) // _SAMPLE + 1]
    count, most_misses = {}, int(len(sample) - READABLE * len(sample))
    for name, pattern in forms.items():
        is_stated_order = order not in ("ymd", "dmy", "mdy") or name.endswith(order)
        match = re.compile(pattern).fullmatch
        misses = (c for c in sample if not match(c))  # as few as decide
        if is_stated_order and sample and next(islice(misses, most_misses, None), None) is None:
            count[name] = int(parse(pa.array(cells), pattern)[1].sum())
    largest = max(count.values(), default=0)
    is_readable = largest >= max(READABLE * len(cells), 1)
    return [name for name, n in count.items() if is_readable and n == largest]


def decided(cells: Sequence[str], forms: Mapping[str, str]) -> tuple[str, str, str] | None:
    """The only form in which the log is no longer than some days, and why; None for several.

    With one date, all forms give the same times after the log's start.

    `cells` are those of the first rows and the last ones.

    Returns:
        The form, the reason, and another form that gives another date, "" for none.
    """
    days = {name: read(cells, pattern) // _DAY for name, pattern in forms.items()}
    length = {name: int(np.ptp(numbers)) for name, numbers in days.items()}
    if not any(length.values()):
        names = list(forms)
        american = re.search(r"(?i)[ap]m\b", cells[0])  # "a. m." is Spanish
        form = next((x for x in names if x.endswith("mdy") and american), names[0])
        first_field = {"mdy": "month", "ymd": "year"}.get(form[-3:], "day")
        other_form = next((x for x in names if days[x][0] != days[form][0]), "")
        return form, f"the log has one date, read with the {first_field} first", other_form
    plausible = [name for name, n in length.items() if n <= _LONGEST_LOG]
    if len(plausible) == 1:
        return plausible[0], "the only order in which the dates are near", ""
    return None


def read(cells: Sequence[str], pattern: str) -> Times:
    """Times [ns] of the cells that match a pattern."""
    t, ok = parse(pa.array(cells), pattern)
    return t[ok]


def as_counted(cells: Sequence[str], pattern: str) -> str:
    """The pattern; of a fraction without leading zeros, as .20 after .180, one that counts.

    Such a fraction counts milliseconds or microseconds. Only so the times do not fall.
    """
    pattern = pattern.replace("(?P<l>[0-9]{3})", _COUNTS[0])  # as 10:15:7:20
    unnamed = pattern.replace("(?P<l>", "(?:")
    for counting in (pattern, *(unnamed.replace(_FRACTION, count) for count in _COUNTS)):
        t = read(cells, counting)
        if len(t) >= READABLE * len(cells) and not (np.diff(t) < 0).any():
            return counting
    return pattern


def parse(text: Any, pattern: str) -> tuple[Times, Bools]:
    """Times [ns] of stamps that match the pattern, and which do; `stamps.toml` names its groups."""
    groups = _Groups(text, pattern)
    ns, ok = _time_of_day(groups)
    if "y" in groups.names:
        days, is_date = _days(groups)
        ns, ok = ns + days * _DAY, ok & is_date
    zones = groups.text("z").dictionary_encode()
    ns = ns - np.array([_ahead(x) for x in zones.dictionary.to_pylist()])[zones.indices]
    ok &= groups.ok
    return np.where(ok, ns, 0), ok


def _ahead(zone: str) -> int:
    """How far a zone is ahead of UTC [ns].

    >>> _ahead("CET") / _S, _ahead("-0330") / _S, _ahead("GMT+1") / _S
    (3600.0, -12600.0, 3600.0)
    """
    hours, minutes = re.fullmatch(r"\D*([0-9]{0,2}):?([0-9]{0,2})", zone).groups()  # type: ignore
    shift = int(hours or 0) * 3600 + int(minutes or 0) * 60
    return _ZONES.get(zone, -shift if "-" in zone else shift) * _S


class _Groups:
    """What the named groups of a pattern match in each text; "" and 0 of a group it has not."""

    def __init__(self, text: Any, pattern: str) -> None:
        self._matches = pc.extract_regex(text, pattern=f"^(?:{pattern})$")
        self.ok: Bools = np.asarray(self._matches.is_valid())
        kind = self._matches.type
        self.names = {kind.field(k).name for k in range(kind.num_fields)}

    def text(self, name: str) -> Any:
        if name not in self.names:
            return pa.array([""]).take(pa.array(np.zeros(len(self.ok), np.int8)))
        return pc.fill_null(pc.struct_field(self._matches, name), "")

    def number(self, name: str) -> Times:
        if name not in self.names:
            return np.zeros(len(self.ok), np.int64)
        cells = self.text(name)
        if name == "f":  # digits of a fraction: as many as a nanosecond has
            digits = pc.utf8_rpad(pc.utf8_slice_codeunits(cells, 0, 9), 9, padding="0")
            cells = pc.if_else(pc.equal(cells, ""), "", digits)
        cells = pc.if_else(pc.equal(cells, ""), "0", cells)
        return np.asarray(pc.cast(cells, pa.int64()))


def _time_of_day(groups: _Groups) -> tuple[Times, Bools]:
    """Nanoseconds after midnight, and which are a time of day."""
    hour, minute, second = (groups.number(name) for name in "HMS")
    half_day = pc.utf8_lower(groups.text("p"))
    said = np.asarray(pc.not_equal(half_day, ""))
    ok = ~said | ((hour >= 1) & (hour <= 12))
    is_after_noon = np.asarray(pc.is_in(half_day, pa.array(["p", "下", "오후"])))
    hour = np.where(said, hour % 12 + 12 * is_after_noon, hour)
    ok &= ("y" not in groups.names) | (hour < 24)
    ok &= ("H" not in groups.names) | (minute < 60)
    ok &= ("M" not in groups.names) | (second <= 60)
    fraction = sum(groups.number(name) * ns for name, ns in _FRACTIONS.items())
    seconds = groups.number("D") * 86_400 + hour * 3600 + minute * 60 + second
    sign = np.where(np.asarray(pc.equal(groups.text("n"), "")), 1, -1)
    return sign * (seconds * _S + fraction), ok & (fraction < _S)


def _days(groups: _Groups) -> tuple[NDArray[np.int64], Bools]:
    year, month, day = (groups.number(name) for name in "ymd")
    year = np.where(year < 100, year + 2000, year)
    ok = (year >= 1678) & (year <= 2261)
    if "b" in groups.names:
        names = groups.text("b").dictionary_encode()
        month = np.array([month_number(x) for x in names.dictionary.to_pylist()])[names.indices]
    unit = "M"
    if "j" in groups.names:
        unit, month, day = "Y", np.ones_like(year), groups.number("j")
    ok &= (month >= 1) & (month <= 12) & (day >= 1)
    begin = np.where(ok, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
    days = begin.astype("datetime64[D]") + np.where(ok, day - 1, 0)
    own_period, named = (x.astype(f"datetime64[{unit}]") for x in (days, begin))
    ok &= own_period == named  # no 31 February
    return days.astype(np.int64), ok
