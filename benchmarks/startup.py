"""Start-up: help against a bare interpreter, `analyze` on the sample against its imports.

    python benchmarks/startup.py

Median of whole processes, caches warm. The rival of `analyze` is a process that only loads what it
must: numpy, pyarrow.csv, rerun, numba and its cached loops, each called on three samples. Its numba
loads as numba does by itself, scipy.linalg with it.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from table import Row, show

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "sample_logs" / "service-brake.csv"
RUNS = 7
LOADING = """
import numpy as np, pyarrow.csv, rerun, numba.np.arraymath
from adhesion_cli.core import compiled, estimator, physics
from adhesion_cli.core.model import AxleRecord, Vehicle
from adhesion_cli.reference import force
t, x = np.arange(3) * 10**7, np.array([9.0, 8.9, 8.8])
for est in estimator.registry().values():
    compiled.batch(est, est.Params(), physics.wheelset(Vehicle(), 1), t, x, x, np.array([0]))
force.compute(AxleRecord(1, t, x, x, x, (slice(0, 3),)), Vehicle())
"""


def seconds(*commands: Sequence[str]) -> list[float]:
    """Median wall time of each Python process; they take turns, so that a slow minute hits all."""
    # As installed: with the bytecode that pip writes.
    env = {name: x for name, x in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    times: list[list[float]] = [[] for _ in commands]
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(RUNS + 1):
            for command, taken in zip(commands, times, strict=True):
                start = time.perf_counter()
                subprocess.run(
                    [sys.executable, *command], cwd=folder, env=env, check=True,
                    capture_output=True,
                )  # fmt: skip
                taken.append(time.perf_counter() - start)
    return [statistics.median(taken[1:]) for taken in times]


def rows() -> Iterator[Row]:
    adhesion = ("-m", "adhesion_cli")
    light = (["--help"], ["analyze", "--help"], ["estimators"])
    bare, *took = seconds(["-c", "pass"], *([*adhesion, *command] for command in light))
    for command, own in zip(light, took, strict=True):
        yield Row(" ".join(["adhesion", *command]), own, bare, "s", "python -c pass")
    own, loading = seconds([*adhesion, "analyze", str(SAMPLE), "--force"], ["-c", LOADING])
    against = "loading numpy, pyarrow.csv, rerun, numba's cache"
    yield Row("adhesion analyze SAMPLE", own, loading, "s", against, most=1.5)


if __name__ == "__main__":
    show(rows())
