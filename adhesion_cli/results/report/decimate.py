"""Which rows of long columns a picture needs."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.model import Floats

Rows = NDArray[np.int64]
_OUTSIDE = 0.2  # share of the rows for what no brake application covers
_GAP = 5.0  # a longer interval between samples than so many usual ones is a gap
_LEAST_GAP = 0.5  # [s]


def rows(
    t: Floats, columns: Sequence[Floats], ranks: Sequence[Sequence[Sequence[float]]], limit: int
) -> Rows:
    """The rows to draw, rising: every one where there is room, else extremes of equal parts.

    Of each part of a column the rows with its lowest and its highest value stay. No value is made
    up, and no slide or outlier is lost. Times are in seconds (n,), each column is (n,), NaN where
    it has no value. `ranks` are the time spans that matter, the most important ones first; what is
    in none comes last. About `limit` rows stay; at least a few hundred are useful.
    """
    n = len(t)
    if n <= limit:
        return np.arange(n)
    rank = np.full(n, len(ranks))
    for k, spans in reversed(list(enumerate(ranks))):
        for begin, stop in spans:
            rank[(t >= begin) & (t <= stop)] = k
    chosen_rows, budget = [_edges(t, columns, limit // 4)], limit - min(int(_OUTSIDE * limit), n)
    for k in range(len(ranks) + 1):
        bucket = np.flatnonzero(rank == k)
        room = budget if k < len(ranks) else budget + int(_OUTSIDE * limit)
        chosen = bucket if len(bucket) <= room else _extremes(bucket, columns, max(room, 2))
        budget = max(budget - len(chosen), limit // 10)
        chosen_rows.append(chosen)
    return np.unique(np.concatenate(chosen_rows))


def with_gaps(t: Floats, chosen: Rows) -> Rows:
    """The rows, with −1 where a line must not join its neighbours: a gap, or time set back."""
    return np.insert(chosen, np.searchsorted(chosen, np.unique(_breaks(t)), side="right"), -1)


def gaps(t: Floats) -> Floats:
    """Begin and end of each gap between samples at these times, shape (k, 2) [s]."""
    broken = _breaks(t)
    spans = np.column_stack([t[broken], t[broken + 1]])
    return spans[spans[:, 1] > spans[:, 0]]


def _breaks(t: Floats) -> Rows:
    """The rows after which there is a gap, or time is set back."""
    step = np.diff(t)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    return np.flatnonzero((step > max(_GAP * usual, _LEAST_GAP)) | (step <= 0))


def _edges(t: Floats, columns: Sequence[Floats], limit: int) -> Rows:
    """First and last row of each stretch with values, unless there are too many."""
    finite = np.stack([np.isfinite(c) for c in columns])
    changes = np.flatnonzero((finite[:, 1:] != finite[:, :-1]).any(axis=0))
    changes = changes if 2 * len(changes) <= limit else changes[:0]
    return np.unique(np.concatenate([changes, changes + 1, [0, len(t) - 1]]))


def _extremes(candidates: Rows, columns: Sequence[Floats], room: int) -> Rows:
    """The rows with the lowest and highest value of each column in each of equal parts."""
    size = max(-(-2 * len(columns) * len(candidates) // room), 2)
    bucket_count = -(-len(candidates) // size)
    padding = np.full(bucket_count * size - len(candidates), candidates[-1])
    padded = np.concatenate([candidates, padding]).reshape(bucket_count, size)
    extremes = [padded[:, 0]]
    for column in columns:
        values = column[padded]
        for worst, choose in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            positions = choose(np.where(np.isnan(values), worst, values), axis=1)
            extremes.append(padded[np.arange(bucket_count), positions])
    return np.unique(np.concatenate(extremes))
