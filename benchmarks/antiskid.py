"""Time of a stop in closed loop; time and memory of a sweep on all cores.

    python benchmarks/antiskid.py [STOPS]

The stop is the scenario `slippery-stop` on very slippery rail: four axles at 1 ms for more than a
minute, under each controller. The sweep has at least STOPS stops (1000 if not given), as
`adhesion antiskid slippery-stop --rails --seeds N` makes them.
"""

import os
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

from table import Row, show

from adhesion_cli.wsp import closed_loop, controller, scenario, sweep


def rows() -> Iterator[Row]:
    long = replace(scenario.load("slippery-stop"), rail=sweep.RAILS["very-low"])
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


def many(stops: int) -> None:
    case = scenario.load("slippery-stop")
    each = len(sweep.RAILS) * len(controller.registry())
    seeds = -(-stops // each)
    sweep.sweep(case, 1)  # compiles
    begin = time.perf_counter()
    sweep.sweep(case, seeds)
    taken = time.perf_counter() - begin
    print(
        f"{seeds * each} stops in {taken:.1f} s on {os.cpu_count()} cores, "
        f"{seeds * each / taken:.1f} a second; "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB at most"
    )


if __name__ == "__main__":
    show(rows())
    many(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
