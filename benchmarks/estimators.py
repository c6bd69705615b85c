"""Time per sample of every compiled estimator loop, and its ratio to the same loop in C.

    python benchmarks/estimators.py

The C is `estimators.c`, compiled with $CC (cc) -O3 -march=native. Both run on the same log, turn
by turn; the quickest of the turns counts. Both must give the same F̂. imm has no loop in C: its
rival is the time of 4 million samples a second.
"""

import ctypes
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from table import Row, show

from adhesion_cli.core import compiled, estimator, methods
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset

N = 200_000  # samples, 1 kHz with jitter
TURNS = 25
NO_C = {"imm": 250.0}  # least speed of loops that C does not have [ns]


def c_library(folder: str) -> ctypes.CDLL:
    library = Path(folder) / "estimators.so"
    source = Path(__file__).with_suffix(".c")
    compiler = os.environ.get("CC", "cc")
    flags = ["-O3", "-march=native", "-shared", "-fPIC", "-o"]
    subprocess.run([compiler, *flags, str(library), str(source), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def quickest(*loops: Callable[[], object]) -> list[float]:
    """Time per sample of each loop [ns]."""
    taken: list[list[float]] = [[] for _ in loops]
    for _ in range(TURNS):
        for times, run in zip(taken, loops, strict=True):
            begin = time.perf_counter()
            run()
            times.append(time.perf_counter() - begin)
    return [min(times) / N * 1e9 for times in taken]


def rows() -> Iterator[Row]:
    w = wheelset(Vehicle(), 1)
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.integers(900_000, 1_100_000, N))
    K = 21e3 * np.minimum(t * 1e-9, 1.0) + rng.normal(0.0, 50.0, N)
    y = 100.0 - 0.4 * t * 1e-9 + rng.normal(0.0, 3e-3, N)
    starts = np.zeros(1, np.int64)
    constants = np.array(w)

    with tempfile.TemporaryDirectory() as folder:
        library = c_library(folder)
        for name, est in estimator.registry().items():
            p = methods.validated(est, {})

            def run_compiled(est=est, p=p):
                return compiled.batch(est, p, w, t, K, y, starts)[0]

            if name in NO_C:
                (ns,) = quickest(run_compiled)
                yield Row(f"estimator {name}", ns, NO_C[name], "ns/sample", "the target", most=1.0)
                continue
            loop = getattr(library, name)
            values = np.array(p)
            inputs = [ctypes.c_void_p(x.ctypes.data) for x in (values, constants, t, K, y)]

            def run_c(loop=loop, inputs=inputs):
                F = np.empty(N)
                loop(*inputs, ctypes.c_long(N), ctypes.c_void_p(F.ctypes.data))
                return F

            np.testing.assert_allclose(run_c(), run_compiled(), rtol=1e-9, atol=1e-6)
            ns, c_ns = quickest(run_compiled, run_c)
            yield Row(f"estimator {name}", ns, c_ns, "ns/sample", "the same loop in C, -O3")


if __name__ == "__main__":
    show(rows())
