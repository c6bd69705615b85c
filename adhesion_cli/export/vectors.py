"""Test vectors of a method: samples of a bundled log, and what the Python `step` makes of them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..analysis.prepare import prepare
from ..channels.log import read
from ..core import bundled, estimator, methods, physics
from ..core.model import AxleRecord, Vehicle, Wheelset
from ..formats.open import open_source
from ..formats.source import ReadOptions
from ..wsp import wsp_controller
from ..wsp.controller import Observed
from .single_precision import single, values

LOG = "low-adhesion.csv"  # it has slides
ALGO = "kalman"  # estimator in the loop of a controller
Answers = list[tuple[float, ...] | None]  # None: no finite number


class Vectors(NamedTuple):
    """Samples of one axle in order of time."""

    rows: list[tuple[float, ...]]  # interval [s], 0 at the first, and the inputs of `step`
    expected: list[tuple[float, ...]]  # what the method answers
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
    rows = list(zip(h, K, y, strict=True))
    answers = ["sigma", "F"] if est.has_sigma else ["F"]

    def run(init: Any, step: Any, rounding: Any) -> Answers:
        p_, w_ = rounding(p), rounding(w)
        return _run(
            [rounding(row) for row in rows],
            answers,
            lambda row: init(p_, w_, *row[1:]),
            lambda s, row: step(p_, w_, s, *row),
        )

    return _vectors(rows, est, run)


def of_controller(
    law: methods.Method, p: Any, settings: wsp_controller.Settings, vehicle: Vehicle
) -> Vectors:
    """What the law of axle 1 observes in the log, with slips judged and valves."""
    observations: list[tuple[float, Observed]] = []
    axles = records(vehicle)

    def init(p: Any, o: Observed) -> Any:
        observations.append((0.0, _as_floats(o)))
        return law.init(p, o)

    def step(p: Any, s: Any, h: float, o: Observed) -> Any:
        observations.append((h, _as_floats(o)))
        return law.step(p, s, h, o)

    chosen = wsp_controller.choose(law.name, ALGO, settings, vehicle)
    watched = chosen._replace(controller=replace(law, init=init, step=step))
    columns = [[x.tolist() for x in (a.wheel_speed, a.clamping_force)] for a in axles]
    samples = (
        (t, None, [y[i] for y, _ in columns], [K[i] for _, K in columns])
        for i, t in enumerate(axles[0].t.tolist())
    )
    for _ in wsp_controller.online(watched, samples):
        pass
    first_axle = observations[:: len(axles)]
    rows = [(h, *o) for h, o in first_axle]

    def run(init: Any, step: Any, rounding: Any) -> Answers:
        p_ = rounding(p)
        return _run(
            [rounding(row) for row in first_axle],
            ["judged", "valve"],
            lambda row: init(p_, row[1]),
            lambda s, row: step(p_, s, *row),
        )

    return _vectors(rows, law, run)


@lru_cache(maxsize=1)
def records(vehicle: Vehicle) -> list[AxleRecord]:
    """The axles of the bundled log; K with the fade of the pad friction."""
    log = read(open_source(bundled.folder("sample_logs") / LOG, ReadOptions()), [], vehicle)
    axle_records = prepare(log, vehicle).records
    return [physics.with_fade(record, vehicle) for record in axle_records]


def _as_floats(o: Observed) -> Observed:
    return Observed._make(map(float, o))._replace(at_least=int(o.at_least))


def _vectors(rows: Any, method: methods.Method, run: Callable[..., Any]) -> Vectors:
    expected = [x for x in run(method.init, method.step, lambda state: state) if x is not None]
    with np.errstate(all="ignore"):
        singles = run(single(method.init), single(method.step), values)
    return Vectors(rows, expected, singles)


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
