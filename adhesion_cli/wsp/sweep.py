"""Many stops: every controller on a set of rails, over seeds, on all cores."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..core import threads
from .closed_loop import ESTIMATOR, against, dry_distance, run, verdict
from .controller import registry
from .scenario import Film, Rail, Scenario, Section, StopLimit
from .stop import Verdict
from .wsp_controller import Settings

_EVEN_RAILS = "dry", "wet", "low", "very-low", "early-peak", "late-peak"
# Rails of a sweep by name; lengths are ours.
RAILS = {name: Rail((Section(0.0, name),)) for name in _EVEN_RAILS} | {
    "sudden": Rail(
        (
            Section(0.0, "wet"),
            Section(150.0, "low"),
            Section(300.0, "very-low"),
            Section(450.0, "low", 1.6),
            Section(550.0, "very-low"),
            Section(700.0, "low"),
        )
    ),
    "film": Rail(
        (Section(0.0, "wet"),),
        film=Film("very-low", first=100.0, length=30.0, pitch=50.0, count=40),
    ),
}
SPREAD = 0.2  # of f0 from seed to seed

Values = dict[str, tuple[float, float, float] | None]  # by field of `Verdict`
Job = TypeVar("Job")
Answer = TypeVar("Answer")


class Compared(NamedTuple):
    """A controller compared with the others, stop by stop on the same rail with the same noise."""

    patent_less_this_m: tuple[float, float, float] | None  # difference of the distances
    shortest: float  # share of the stops in which it has the shortest distance


class SweepRow(NamedTuple):
    """One controller on one rail; each value as mean over the seeds, 2.5 % and 97.5 % quantile."""

    rail: str
    controller: str
    dry_distance_m: float
    values: Values
    compared: Compared
    limits: tuple[tuple[StopLimit, float], ...] = ()  # each with the share of stops that keep it


def sweep(
    scenario: Scenario,
    seeds: int,
    algo: str = ESTIMATOR,
    settings: Settings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[SweepRow]:
    """Every controller on every rail of `RAILS`, with seeds from 0; arguments as in `verdicts`."""
    laws, runs = list(registry()), range(seeds)
    by_case = verdicts(scenario, list(RAILS), laws, runs, algo, settings, progress)
    dry, rows = dry_distance(scenario), []
    for rail in RAILS:
        by_law = {c: v for (r, c), v in by_case.items() if r == rail}
        comparison = compared(by_law)
        for controller, stops in by_law.items():
            by_stop = [[ok for _, ok in against(scenario.limit, v)] for v in stops]
            limits = tuple(zip(scenario.limit, np.mean(by_stop, axis=0).tolist(), strict=True))
            values = intervals(stops), comparison[controller]
            rows.append(SweepRow(rail, controller, dry, *values, limits))
    return rows


def compared(
    by_law: Mapping[str, Sequence[Verdict]], average: Callable[[list[float]], Any] = np.mean
) -> dict[str, Compared]:
    """Each controller compared with the others.

    Args:
        by_law: stops by controller, the same in each place.
        average: as in `interval`.
    """
    distances = {law: [v.stopping_distance_m for v in stops] for law, stops in by_law.items()}
    smallest = np.min(list(distances.values()), axis=0)
    is_unique = np.sum(np.array(list(distances.values())) == smallest, axis=0) == 1
    answers = {}
    for law, runs in distances.items():
        saving = np.subtract(distances["patent"], runs).tolist()
        first_share = float(np.mean((np.array(runs) == smallest) & is_unique))
        answers[law] = Compared(interval(saving, average) if law != "patent" else None, first_share)
    return answers


def verdicts(  # noqa: PLR0913 (benchmarks choose rails, controllers and seeds)
    scenario: Scenario,
    rails: Sequence[str],
    laws: Sequence[str],
    seeds: Iterable[int],
    algo: str = ESTIMATOR,
    settings: Settings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[tuple[str, str], list[Verdict]]:
    """Stops by rail and controller, one a seed, on all cores.

    A seed gives the noise and one rail, the same for every controller. The rail's f0 differs by up
    to `SPREAD` from that of its name.

    Args:
        scenario: train, brake and WSP.
        rails: names in `RAILS`.
        laws: controllers.
        seeds: of the stops.
        algo: online estimator in the loop.
        settings: as in `run`.
        progress: gets the progress.
    """
    dry = dry_distance(scenario)
    for law in laws:  # compile before the threads start
        run(replace(scenario, rail=RAILS["dry"]), law, 0, algo, settings)

    def run_job(job: tuple[str, str, int]) -> Verdict:
        rail, law, seed = job
        factor = 1.0 + SPREAD * (2.0 * np.random.default_rng(seed).random() - 1.0)
        rail_text = RAILS[rail]
        sections = tuple(replace(x, scale=x.scale * factor) for x in rail_text.section)
        film = rail_text.film and replace(rail_text.film, scale=rail_text.film.scale * factor)
        case = replace(scenario, rail=replace(rail_text, section=sections, film=film))
        return verdict(run(case, law, seed, algo, settings), case, dry)

    jobs = [(r, c, seed) for r in rails for c in laws for seed in seeds]
    by_case: dict[tuple[str, str], list[Verdict]] = {}
    for job, x in zip(jobs, on_all_cores(run_job, jobs, progress), strict=True):
        by_case.setdefault(job[:2], []).append(x)
    return by_case


def on_all_cores(
    run_job: Callable[[Job], Answer], jobs: Sequence[Job], progress: Callable[[str], None]
) -> list[Answer]:
    """`run_job` of every job, in the order of the jobs; compile shared functions before."""
    results: list[Answer] = []
    for x in threads.run_ahead(run_job, jobs):
        results.append(x)
        progress(f"{len(results)} of {len(jobs)} done")
    return results


def interval(
    values: Sequence[float | None], middle: Callable[[list[float]], Any] = np.mean
) -> tuple[float, float, float] | None:
    """Mean (or `middle`), 2.5 % and 97.5 % quantile of the values; None without a value."""
    finite = [x for x in values if x is not None]
    if not finite:
        return None
    lower, upper = np.quantile(finite, [0.025, 0.975])
    return float(middle(finite)), float(lower), float(upper)


def intervals(stops: Sequence[Verdict], middle: Callable[[list[float]], Any] = np.mean) -> Values:
    """`interval` of every field of the verdicts."""
    columns = zip(*stops, strict=True)
    return {k: interval(x, middle) for k, x in zip(Verdict._fields, columns, strict=True)}
