"""Brake applications of an axle: where its brake is on, from the build-up to the release."""

import math
from collections.abc import Iterable

import numpy as np

from ..core.masks import true_runs
from ..core.model import AxleRecord, Floats
from ..core.physics import CRAWL, LONGEST_DUMP
from ..core.signals import median_of_five, moving, white_noise

_BRAKING_FORCE = 200.0  # clamping force that is braking [N]
_RELEASED_FORCE = 60.0  # and that still belongs to it [N]
_TAIL = 1.0  # time after the release that still counts [s]
_SHORTEST = 0.5  # shorter is no application [s]
START_UP = 3.0  # response of the slowest published estimator, LESO in Table 2 [s]


def find_applications(record: AxleRecord) -> tuple[slice, ...]:
    """Brake applications: build-up, hold and release with a short tail; never across segments.

    K above 5 % of its range, and clearly above its noise, is a brake. Its application reaches back
    and forth down to 2 %. A K that stays on is a sensor's offset if it is less than a tenth of the
    peaks, else a drag brake. A wheel that stands has no application: (1) says nothing about it.
    Nor is a brake that was applied while it stood, and is released as it starts: it slows nothing.
    """
    runs = moving(record)
    if not runs:
        return ()
    K = np.full(len(record), np.nan)
    for s in runs:
        K[s] = np.maximum(median_of_five(record.clamping_force[s]), 0.0)
    lowest, top = (float(x) for x in np.nanpercentile(K, [2.0, 100.0]))
    base = lowest if lowest < 0.1 * top else 0.0
    # What bends from one sample to the next is noise, but on a slow log it is the brake itself.
    bend = math.sqrt(white_noise((record.t[s], record.clamping_force[s]) for s in runs))
    noise = min(bend, 0.025 * (top - base))
    on_force = base + max(0.05 * (top - base), 8.0 * noise, _BRAKING_FORCE)
    off_force = base + max(0.02 * (top - base), 4.0 * noise, _RELEASED_FORCE)
    return tuple(a for s in runs for a in _application_slices(record, K, s, on_force, off_force))


def _application_slices(
    record: AxleRecord, K: Floats, run: slice, on_force: float, off_force: float
) -> Iterable[slice]:
    t = (record.t[run] - record.t[run.start]) * 1e-9
    spans: list[tuple[int, int]] = []
    for start, stop in true_runs(K[run] > off_force):
        if not (K[run][start:stop] > on_force).any():
            continue
        if start == 0 and _lets_start(record, K, slice(run.start, run.start + stop)):
            continue
        if spans and t[start] - t[spans[-1][1] - 1] < LONGEST_DUMP:
            start = spans.pop()[0]
        spans.append((start, stop))
    for i, (start, stop) in enumerate(spans):
        if t[stop - 1] - t[start] < _SHORTEST or stop - start < 3:
            continue
        end_index = int(np.searchsorted(t, t[stop - 1] + _TAIL, side="right"))
        if i + 1 < len(spans):
            end_index = min(end_index, spans[i + 1][0] - 1)
        yield slice(run.start + max(start - 1, 0), run.start + end_index)  # last one released


def _lets_start(record: AxleRecord, K: Floats, span: slice) -> bool:
    """Whether K only falls, from where the wheel began to turn, and the wheel gets faster.

    Beside a train that moves, the wheel was locked, and the brake goes on.
    """
    stood = span.start > 0 and span.start not in {s.start for s in record.segments}
    if record.train_speed is not None and record.train_speed[span.start] > CRAWL:
        return False
    y = record.wheel_speed[span]
    return stood and bool(K[span].max() <= 1.1 * K[span.start] and y[-1] > y[0])


def find_start_ups(record: AxleRecord, applications: Iterable[slice]) -> list[slice]:
    """Start-ups: the first `START_UP` of every application during which a segment begins.

    Estimators start there at F̂ = 0 because the log does; on the train they would be running.
    """
    begun = {s.start for s in record.segments}
    start_ups = []
    for s in applications:
        if s.start in begun and record.clamping_force[s.start] > _BRAKING_FORCE:
            t = record.t[s]  # rising; of the whole record it need not be
            stop = int(np.searchsorted(t, t[0] + round(START_UP * 1e9)))
            start_ups.append(slice(s.start, s.start + stop))
    return start_ups
