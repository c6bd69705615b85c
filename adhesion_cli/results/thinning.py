"""Which samples of a long log its results have: each in and around brake applications and slides.

Elsewhere a train coasts or stands, and what is computed there would fill most of a file.
"""

import numpy as np
from numpy.typing import NDArray

from ..core.model import AxleResult, Bools, Times

LONG_ROWS = 20_000  # rows of an axle; one with more is thinned
AROUND = 2_000_000_000  # before and after a brake application or slide [ns]
SAMPLE_INTERVAL = 500_000_000  # elsewhere there is one sample of so long [ns]
THINNED_NOTE = (
    f"computed values: one of each {SAMPLE_INTERVAL / 1e9:g} s; "
    f"in brake applications and slides and {AROUND / 1e9:g} s around them, all"
)


def needs_thinning(axle: AxleResult) -> bool:
    """Whether the results of an axle are thinned."""
    return len(axle.record) > LONG_ROWS


def keep_mask(axle: AxleResult, t: Times) -> Bools:
    """Whether the results of a long log have these times of an axle, (n,)."""
    mask: Bools = np.diff(t // SAMPLE_INTERVAL, prepend=t[0] // SAMPLE_INTERVAL - 1) != 0
    times = [(axle.record.t[s.start], axle.record.t[s.stop - 1]) for s in axle.applications]
    for begin, stop in [*times, *((e.t, e.until) for e in axle.events if e.until is not None)]:
        mask |= (t >= begin - AROUND) & (t <= stop + AROUND)
    return mask


def kept_rows(axle: AxleResult) -> NDArray[np.int64] | None:
    """Rows of an axle whose computed values are kept, rising, (k,); None where all are."""
    if not needs_thinning(axle):
        return None
    return np.flatnonzero(keep_mask(axle, axle.record.t))
