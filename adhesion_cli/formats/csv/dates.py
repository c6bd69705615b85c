"""Which form of date and clock the cells of a column have."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

from ...core.model import Times
from .cells import stamps

READABLE = 0.5  # of a time column's first cells must be readable
_LONGEST_LOG = 7  # days that a log may be long
_SAMPLE = 50  # cells that show whether a form is worth a look
_DAY = 86_400 * 10**9

_FRACTION = "(?P<f>[0-9]+)"
_COUNTS = ("(?P<l>[0-9]{1,3})", "(?P<u>[0-9]{1,6})")  # of it: milliseconds, microseconds


def forms_of(cells: Sequence[str], forms: Mapping[str, str], order: str | None = None) -> list[str]:
    """Names of the forms in which the most of the cells are read; none where that are few.

    Args:
        cells: of a column.
        forms: patterns by name.
        order: the order of a date that the user states, as "dmy".
    """
    sample = cells[:: len(cells) // _SAMPLE + 1]
    count = {}
    for name, pattern in forms.items():
        is_stated_order = order not in ("ymd", "dmy", "mdy") or name.endswith(order)
        hits = sum(bool(re.fullmatch(pattern, c)) for c in sample) if is_stated_order else 0
        if hits and hits >= READABLE * len(sample):
            count[name] = int(stamps(pa.array(cells), pattern)[1].sum())
    largest = max(count.values(), default=0)
    is_readable = largest >= max(READABLE * len(cells), 1)
    return [name for name, n in count.items() if is_readable and n == largest]


def decided(cells: Sequence[str], forms: Mapping[str, str]) -> tuple[str, str] | None:
    """The only form in which the log is no longer than some days, and why; None for several.

    With one date, all forms give the same times after the log's start.

    Args:
        cells: of the first rows and the last ones.
        forms: more than one, as `forms_of` names them.
    """
    days = {name: read(cells, pattern) // _DAY for name, pattern in forms.items()}
    length = {name: int(np.ptp(numbers)) for name, numbers in days.items()}
    if not any(length.values()):
        names = list(forms)
        american = re.search(r"(?i)[ap]\.?\s?m", cells[0])
        form = next((x for x in names if x.endswith("mdy") and american), names[0])
        first_field = "month" if form.endswith("mdy") else "day"
        return form, f"the log has one date, read with the {first_field} first"
    plausible = [name for name, n in length.items() if n <= _LONGEST_LOG]
    if len(plausible) == 1:
        return plausible[0], "the only order in which the dates are near"
    return None


def read(cells: Sequence[str], pattern: str) -> Times:
    """Times [ns] of the cells that match a pattern."""
    t, ok = stamps(pa.array(cells), pattern)
    return t[ok]


def with_counted_fraction(cells: Sequence[str], pattern: str) -> str:
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
