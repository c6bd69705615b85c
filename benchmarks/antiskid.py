"""Time of a stop in closed loop; every controller on a set of rails, over seeds, on all cores.

    python benchmarks/antiskid.py [--seeds N] [--algo NAME] [--train-speed axles] [--set NAME=VALUE]

The first table is the scenario `slippery-stop` on very slippery rail: four axles at 1 ms for more
than a minute, under each controller. The second is `slippery-stop` on each rail of
`tests/helpers/rails.py`, N times (42 if not given): mean, 2.5 and 97.5 % quantile over the seeds.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from table import Row, show

from adhesion_cli.analysis.settings import load as load_settings
from adhesion_cli.wsp import closed_loop, controller, scenario
from adhesion_cli.wsp.stop import Verdict
from adhesion_cli.wsp.wsp_controller import Settings

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from helpers import rails


def rows() -> Iterator[Row]:
    long = replace(scenario.load("slippery-stop"), rail=rails.RAILS["very-low"])
    for law in controller.registry():
        closed_loop.run(long, law)  # compiles
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            done = closed_loop.run(long, law)
            times.append(time.perf_counter() - begin)
        stopped = float(done.t[-1]) * 1e-9
        name = f"stop in closed loop, {law}"
        yield Row(name, min(times), stopped, "s", "the stop's own time", most=1.0 / 60.0)


def cell(values: Sequence[float | None]) -> str:
    """Mean and, in brackets, 2.5 and 97.5 % quantile."""
    numbers = [x for x in values if x is not None]
    if not numbers:
        return "–"
    low, high = np.quantile(numbers, [0.025, 0.975])
    return f"{np.mean(numbers):.4g} ({low:.4g} to {high:.4g})"


def many(case: scenario.Scenario, seeds: int, algo: str, settings: Settings) -> None:
    """Prints a row per rail and controller."""
    laws, begin = list(controller.registry()), time.perf_counter()
    stops = rails.verdicts(case, list(rails.RAILS), laws, range(seeds), algo, settings)
    taken = time.perf_counter() - begin
    print("\n| rail | controller | patent less this [m] |", " | ".join(Verdict._fields), "|")
    print("|---" * (len(Verdict._fields) + 3) + "|")
    for (rail, law), verdicts in stops.items():
        columns = [list(x) for x in zip(*verdicts, strict=True)]
        patent = [v.stopping_distance_m for v in stops[rail, "patent"]]
        saving = np.subtract(patent, [v.stopping_distance_m for v in verdicts]).tolist()
        print("|", rail, "|", law, "|", " | ".join(map(cell, [saving, *columns])), "|")
    print(f"{len(stops) * seeds} stops in {taken:.1f} s on {os.cpu_count()} cores")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=42)
    parser.add_argument("--algo", default=closed_loop.ESTIMATOR)
    parser.add_argument("--train-speed", choices=["measured", "axles"])
    parser.add_argument("--set", action="append", default=[])
    given = parser.parse_args()
    show(rows())
    case = scenario.load("slippery-stop").with_train_speed(given.train_speed)
    many(case, given.seeds, given.algo, load_settings(assignments=given.set).overrides)


if __name__ == "__main__":
    main()
