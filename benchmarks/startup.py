"""Start-up: help against a bare interpreter, `analyze` on the sample against its imports.

    python benchmarks/startup.py

Median of whole processes, caches warm. The rival of `analyze` is a process that only loads what it
must: numpy, pyarrow.csv, rerun, numba and its cached loops, each called on three samples.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from table import Row, show

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "sample_logs" / "service-brake.csv"
RUNS = 7
LOADING = """
import numpy as np, pyarrow.csv, rerun
from adhesion_cli import compiled, estimator, physics, reference
from adhesion_cli.model import AxleRecord, Vehicle
t, x = np.arange(3) * 10**7, np.array([9.0, 8.9, 8.8])
for est in estimator.registry().values():
    compiled.batch(est, est.Params(), physics.wheelset(Vehicle(), 1), t, x, x, np.array([0]))
reference.compute(AxleRecord(1, t, x, x, x, (slice(0, 3),)), Vehicle())
"""


def seconds(*arguments: str) -> float:
    """Median wall time of a Python process."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(RUNS + 1):
            start = time.perf_counter()
            subprocess.run(
                [sys.executable, *arguments], cwd=folder, check=True, capture_output=True
            )
            times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def rows() -> Iterator[Row]:
    adhesion = ("-m", "adhesion_cli")
    bare = seconds("-c", "pass")
    for command in (["--help"], ["analyze", "--help"], ["estimators"]):
        name = " ".join(["adhesion", *command])
        yield Row(name, seconds(*adhesion, *command), bare, "s", "python -c pass")
    own = seconds(*adhesion, "analyze", str(SAMPLE), "--force")
    against = "loading numpy, pyarrow.csv, rerun, numba's cache"
    yield Row("adhesion analyze SAMPLE", own, seconds("-c", LOADING), "s", against, most=1.5)


if __name__ == "__main__":
    show(rows())
