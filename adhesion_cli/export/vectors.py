"""Test vectors of an estimator: samples of a bundled log, and what its Python `step` answers."""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..analysis.prepare import prepare
from ..channels.log import read
from ..core import bundled, estimator, physics
from ..core.model import AxleRecord, Vehicle, Wheelset
from ..formats.open import open_source
from ..formats.source import ReadOptions
from .single_precision import single, values

LOG = "low-adhesion.csv"  # it has slides
Answers = list[tuple[float, ...] | None]  # None: no finite number


class Vectors(NamedTuple):
    """Samples of one axle in order of time."""

    rows: list[tuple[float, ...]]  # interval [s], 0 at the first, and the inputs of `step`
    expected: list[tuple[float, ...]]  # what the estimator answers
    singles: Answers  # the same in single precision

    def largest(self, answer: int) -> float:
        """Largest absolute value of an answer."""
        return max(abs(row[answer]) for row in self.expected)

    def single_errors(self, answer: int) -> list[float]:
        """By how much single precision differs, at each sample."""
        pairs = zip(self.expected, self.singles, strict=True)
        return [abs(x[answer] - reference[answer]) if x else math.inf for reference, x in pairs]

    @property
    def missing_count(self) -> int:
        """Samples at which single precision has no finite answer."""
        return self.singles.count(None)


def of_estimator(est: estimator.Estimator, p: Any, w: Wheelset, vehicle: Vehicle) -> Vectors:
    """K [N] and speed [rad/s] of axle 1 of the log, with estimates; raises as `check_step`."""
    record = records(vehicle)[0]
    s = max(record.segments, key=lambda s: int(s.stop - s.start))
    t, K, y = (x[s].tolist() for x in (record.t, record.clamping_force, record.wheel_speed))
    h = [0.0, *((b - a) * 1e-9 for a, b in pairwise(t))]
    estimator.check_step(est, p, max(h))
    rows: list[tuple[float, ...]] = list(zip(h, K, y, strict=True))
    answers = ["sigma", "F"] if est.has_sigma else ["F"]

    def run(init: Any, step: Any, rounding: Any) -> Answers:
        p_, w_ = rounding(p), rounding(w)
        return _run(
            [rounding(row) for row in rows],
            answers,
            lambda row: init(p_, w_, *row[1:]),
            lambda s, row: step(p_, w_, s, *row),
        )

    expected = [x for x in run(est.init, est.step, lambda state: state) if x is not None]
    with np.errstate(all="ignore"):
        singles = run(single(est.init), single(est.step), values)
    return Vectors(rows, expected, singles)


@lru_cache(maxsize=1)
def records(vehicle: Vehicle) -> list[AxleRecord]:
    """The axles of the bundled log; K with the fade of the pad friction."""
    log = read(open_source(bundled.folder("sample_logs") / LOG, ReadOptions()), [], vehicle)
    axle_records = prepare(log, vehicle).records
    return [physics.with_fade(record, vehicle) for record in axle_records]


def _run(
    rows: Sequence[Any], answers: Sequence[str], init: Callable[..., Any], step: Callable[..., Any]
) -> Answers:
    """The answers; None where one is not finite. The state is then as before, as in C."""
    state = init(rows[0])
    answers_by_sample: Answers = [tuple(float(getattr(state, x)) for x in answers)]
    for row in rows[1:]:
        following = step(state, row)
        answer = tuple(float(getattr(following, x)) for x in answers)
        if all(map(math.isfinite, answer)):
            state = following
        answers_by_sample.append(answer if all(map(math.isfinite, answer)) else None)
    return answers_by_sample
