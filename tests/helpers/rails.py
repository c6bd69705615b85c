"""Stops on a set of rails, over seeds, on all cores: for tests and benchmarks."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from adhesion_cli.wsp.closed_loop import ESTIMATOR, dry_distance, run, verdict
from adhesion_cli.wsp.replay import on_all_cores
from adhesion_cli.wsp.scenario import Film, Rail, Scenario, Section
from adhesion_cli.wsp.stop import Verdict
from adhesion_cli.wsp.wsp_controller import Settings

_EVEN_RAILS = "dry", "wet", "low", "very-low", "early-peak", "late-peak"
# By name; lengths are ours.
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


def verdicts(
    scenario: Scenario,
    rails: Sequence[str],
    laws: Sequence[str],
    seeds: Iterable[int],
    algo: str = ESTIMATOR,
    settings: Settings | None = None,
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
    for job, x in zip(jobs, on_all_cores(run_job, jobs, lambda _: None), strict=True):
        by_case.setdefault(job[:2], []).append(x)
    return by_case
