"""Dates of a text log: which of their numbers is the day, the month and the year."""

import re
from collections.abc import Sequence
from datetime import date

CLOCK = (
    r"(?P<H>[0-9]{1,3}):(?P<M>[0-9]{2}):(?P<S>[0-9]{2})(?:[.,](?P<f>[0-9]+)|:(?P<l>[0-9]{3}))?"
    r"(?:\s*(?P<p>[AaPp])[Mm])?\s*(?P<z>Z|z|UTC|GMT|[+-][0-9]{2}:?[0-9]{2}|[+-][0-9]{2})?"
)
GAP = r"(?:[Tt]|[\s,_]+)"
DATES = {  # a year of two digits is of this century
    "ymd": r"(?P<y>[0-9]{4})[-/.年](?P<m>[0-9]{1,2})[-/.月](?P<d>[0-9]{1,2})日?",
    "dmy": r"(?P<d>[0-9]{1,2})[./-](?P<m>[0-9]{1,2})[./-](?P<y>[0-9]{4}|[0-9]{2})",
    "mdy": r"(?P<m>[0-9]{1,2})[/-](?P<d>[0-9]{1,2})[/-](?P<y>[0-9]{4}|[0-9]{2})",
    "yymd": r"(?P<y>[0-9]{2})[/-](?P<m>[0-9]{1,2})[/-](?P<d>[0-9]{1,2})",
}
ANY_DATE = "|".join(re.sub(r"\?P<\w>", "?:", form) for form in DATES.values())
READABLE = 0.5  # of a time column's first cells must be readable
_LONGEST_LOG = 7  # days that a log may be long

FORM_NAMES = {"dmy": "day/month", "mdy": "month/day", "yymd": "year/month/day"}


def forms_of(cells: Sequence[str], order: str | None) -> list[str]:
    """Forms in which the most of the cells begin with a date; none where that are few.

    Args:
        cells: of a column, dates or dates and times.
        order: the order that the user states, as "dmy".
    """
    count = {form: len(_days(cells, form)) for form in DATES}
    if order in ("ymd", "dmy", "mdy"):
        count = {form: n for form, n in count.items() if form.endswith(order)}
    largest = max(count.values())
    is_readable = largest >= max(READABLE * len(cells), 1)
    return [form for form, n in count.items() if is_readable and n == largest]


def decided(cells: Sequence[str], forms: Sequence[str]) -> tuple[str, str] | None:
    """The only form in which the log is no longer than some days, and why; None for several.

    With one date, all forms give the same times after the log's start.

    Args:
        cells: of the first rows and the last ones.
        forms: more than one, as `forms_of` gives them.
    """
    days = {form: _days(cells, form) for form in forms}
    length = {form: max(day_numbers) - min(day_numbers) for form, day_numbers in days.items()}
    if not any(length.values()):
        american = "mdy" in forms and re.search("(?i)[ap]m", cells[0])
        form = "mdy" if american else forms[0]
        return form, f"the log has one date, read with the {'month' if american else 'day'} first"
    plausible = [form for form, n in length.items() if n <= _LONGEST_LOG]
    if len(plausible) == 1:
        return plausible[0], "the only order in which the dates are near"
    return None


def _days(cells: Sequence[str], form: str) -> list[int]:
    """The days of the cells that are dates in a form, counted from 1 January of year 1."""
    pattern = re.compile(f"{DATES[form]}(?:{GAP}{CLOCK})?")
    days = []
    for match in filter(None, map(pattern.fullmatch, cells)):
        year, month, day = (int(match[name]) for name in "ymd")
        try:
            days.append(date(year + 2000 * (year < 100), month, day).toordinal())
        except ValueError:  # no month has that many days
            continue
    return days
