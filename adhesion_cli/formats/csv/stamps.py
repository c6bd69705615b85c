"""Forms in which logs write dates and clocks, as patterns whose groups are the parts of a stamp."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path

_FORMS = tomllib.loads(Path(__file__).with_name("stamps.toml").read_text("utf-8"))


def _with_zone(kind: str) -> dict[str, str]:
    return {name: pattern + _FORMS["zone"] for name, pattern in _FORMS[kind].items()}


def _joined(date: str, clock: str) -> str:
    return date.replace("CLOCK", clock) if "CLOCK" in date else f"{date}{_FORMS['gap']}{clock}"


DATES: dict[str, str] = {k: x for k, x in _FORMS["dates"].items() if "CLOCK" not in x}
CLOCKS: dict[str, str] = _with_zone("clocks") | _FORMS["alone"]
STAMPS: dict[str, str] = {  # date and clock, by the name of each
    f"{clock} {date}": _joined(_FORMS["dates"][date], pattern)
    for date in _FORMS["dates"]
    for clock, pattern in (_with_zone("clocks") | _with_zone("after_date")).items()
}
_MONTHS = {name: int(k) for k, names in _FORMS["months"].items() for name in names.split()}


def _any_of(forms: Mapping[str, str]) -> re.Pattern[str]:
    return re.compile("|".join(re.sub(r"\?P<\w>", "?:", form) for form in forms.values()))


_ANY = [_any_of(forms) for forms in (CLOCKS | {"": "[0-9]{1,3}:[0-9]{2}"}, DATES, STAMPS)]


def is_stamp(cell: str) -> bool:
    """Whether a cell reads like a date, a time of day or both."""
    return any(form.fullmatch(cell) for form in _ANY)


def month(name: str) -> int:
    """The number of a month by its name or the first letters of it, 0 of none.

    >>> month("Sept"), month("juillet"), month("März"), month("bar")
    (9, 7, 3, 0)
    """
    begins = [k for k in _MONTHS if name.casefold().startswith(k)]
    return _MONTHS[max(begins, key=len)] if begins else 0
