"""Runs of True in a mask: where they are, what lies deep in them, and their spans of time."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from .finding import Span, merge_spans
from .model import Bools, Times


def true_runs(mask: Bools) -> list[tuple[int, int]]:
    """First and past-the-last index of each run of True in a mask of shape (n,)."""
    return [(a, b) for a, b in edges(mask).tolist()]


def edges(mask: Bools) -> NDArray[np.int64]:
    """The same as an array, shape (runs, 2)."""
    change = np.empty(len(mask) + 1, dtype=np.bool_)
    change[1:-1] = mask[1:] != mask[:-1]
    change[0], change[-1] = (mask[0], mask[-1]) if len(mask) else (False, False)
    return np.flatnonzero(change).reshape(-1, 2)


def runs_within(mask: Bools, segments: Iterable[slice]) -> list[slice]:
    """Each run of True in a mask (n,), none across two segments of it."""
    return [slice(s.start + a, s.start + b) for s in segments for a, b in true_runs(mask[s])]


def erode(mask: Bools, j: int) -> Bools:
    """True more than j samples from every False, shape (..., n)."""
    reached_mask, width = ~mask, 0  # that many samples or fewer from a False
    while width < j:
        growth = min(j - width, 2 * width + 1)  # a step to each side reaches three times as far
        widened = reached_mask.copy()
        widened[..., growth:] |= reached_mask[..., :-growth]
        widened[..., :-growth] |= reached_mask[..., growth:]
        reached_mask, width = widened, width + growth
    return ~reached_mask


def spans_of_mask(mask: Bools, t: Times, start_ns: int) -> tuple[Span, ...]:
    """The stretches of the samples of a mask at times [ns]; each run of them is one."""
    starts, stops = edges(mask).T
    start, stop = np.sort([t[starts], t[stops - 1]], axis=0)
    return spans_of(start, stop, start_ns)


def spans_of(start: Times, stop: Times, start_ns: int) -> tuple[Span, ...]:
    """Stretches [ns] as seconds after the log's start, the nearest joined until few are left."""
    merged = merge_spans([*zip(start.tolist(), stop.tolist(), strict=True)])
    return tuple(((a - start_ns) / 1e9, (b - start_ns) / 1e9) for a, b in merged)
