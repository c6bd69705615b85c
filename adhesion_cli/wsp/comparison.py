"""Controllers compared stop by stop: on the same rail, with the same noise."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from ..core import threads
from .stop import Verdict

Values = dict[str, tuple[float, float, float] | None]  # by field of `Verdict`
Job = TypeVar("Job")
Answer = TypeVar("Answer")


class Compared(NamedTuple):
    """A controller compared with the others."""

    patent_less_this_m: tuple[float, float, float] | None  # difference of the distances
    shortest: float  # share of the stops in which it has the shortest distance


def compared(by_law: Mapping[str, Sequence[Verdict]]) -> dict[str, Compared]:
    """Each controller compared with the others, by its stops: the same rail in each place."""
    distances = {law: [v.stopping_distance_m for v in stops] for law, stops in by_law.items()}
    smallest = np.min(list(distances.values()), axis=0)
    is_unique = np.sum(np.array(list(distances.values())) == smallest, axis=0) == 1
    answers = {}
    for law, runs in distances.items():
        saving = np.subtract(distances["patent"], runs).tolist()
        first_share = float(np.mean((np.array(runs) == smallest) & is_unique))
        answers[law] = Compared(interval(saving) if law != "patent" else None, first_share)
    return answers


def on_all_cores(
    run_job: Callable[[Job], Answer], jobs: Sequence[Job], progress: Callable[[str], None]
) -> list[Answer]:
    """`run_job` of every job, in the order of the jobs; compile shared functions before."""
    results: list[Answer] = []
    for x in threads.run_ahead(run_job, jobs):
        results.append(x)
        progress(f"{len(results)} of {len(jobs)} done")
    return results


def interval(values: Sequence[float | None]) -> tuple[float, float, float] | None:
    """Median, 2.5 % and 97.5 % quantile of the values; None without a value."""
    finite = [x for x in values if x is not None]
    if not finite:
        return None
    lower, middle, upper = np.quantile(finite, [0.025, 0.5, 0.975]).tolist()
    return middle, lower, upper


def intervals(stops: Sequence[Verdict]) -> Values:
    """`interval` of every field of the verdicts."""
    columns = zip(*stops, strict=True)
    return {k: interval(x) for k, x in zip(Verdict._fields, columns, strict=True)}
