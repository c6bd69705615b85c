"""Time of a stop in closed loop, and of a sweep on all cores.

    python benchmarks/antiskid.py [STOPS]

The stop is the scenario `slippery-stop` on very slippery rail: four axles at 1 ms for more than a
minute, under each controller. The sweep has at least STOPS stops (1000 if not given), as
`adhesion antiskid slippery-stop --rails --seeds N` makes them.
"""

import os
import sys
import time
from dataclasses import replace

from adhesion_cli import antiskid, controller, scenario, sweep


def stop() -> None:
    long = replace(scenario.load("slippery-stop"), rail=sweep.RAILS["very-low"])
    for law in controller.registry():
        antiskid.run(long, law)  # compiles
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            done = antiskid.run(long, law)
            times.append(time.perf_counter() - begin)
        seconds = float(done.t[-1]) * 1e-9
        minute = min(times) / seconds * 60.0
        print(f"{law}: {min(times):.2f} s for a stop of {seconds:.0f} s, {minute:.2f} s a minute")


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
        f"{taken / (seeds * each) * 1e3:.0f} ms each"
    )


if __name__ == "__main__":
    stop()
    many(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
