"""Time per sample of every compiled estimator loop, and of the C that `export-c` makes of it.

    python benchmarks/estimators.py

The rival of a loop is the target of 200 ns: an hour of four axles at 100 Hz then takes 0.3 s. Both
run on one log, turn by turn; the quickest of the turns counts.

The rows `export` run the C of `adhesion export-c` as a control unit does: a loop in another file
calls `_step` for each sample, with its checks of every input. The flags are $CC -O2
-ffp-contract=off, without optimization at link time. The rival is the compiled loop over the same
arrays. Both give the same bits. The rows `even` have equal intervals, as a cyclic task has.
"""

import ctypes
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from table import Row, show

from adhesion_cli.core import compiled, estimator, methods
from adhesion_cli.core.model import Floats, Times, Vehicle, Wheelset
from adhesion_cli.core.physics import wheelset
from adhesion_cli.export.c_types import DOUBLE
from adhesion_cli.export.interface import Interface

N = 20_000  # samples, 1 kHz with jitter
TURNS = 250  # short ones: other programs run between them
TARGET = 200.0  # time per sample [ns]


def quickest(*loops: Callable[[], object]) -> list[float]:
    """Time per sample of each loop [ns]."""
    taken: list[list[float]] = [[] for _ in loops]
    for _ in range(TURNS):
        for times, run in zip(taken, loops, strict=True):
            begin = time.perf_counter()
            run()
            times.append(time.perf_counter() - begin)
    return [min(times) / N * 1e9 for times in taken]


class Log(NamedTuple):
    """Columns of a log, shape (n,)."""

    t: Times
    K: Floats
    y: Floats


def log(jitter: int, n: int) -> Log:
    """A brake application at 1 kHz; each interval differs by at most `jitter` [ns]."""
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.integers(1_000_000 - jitter, 1_000_000 + jitter + 1, n))
    K = 21e3 * np.minimum(t * 1e-9, 1.0) + rng.normal(0.0, 50.0, n)
    return Log(t, K, 100.0 - 0.4 * t * 1e-9 + rng.normal(0.0, 3e-3, n))


def c_loop(loop: Callable[..., object], p: Any, w: Wheelset, of: Log) -> Callable[[], Floats]:
    """A loop of the library over a log."""
    columns = (np.array(p), np.array(w), *of)
    inputs = [ctypes.c_void_p(x.ctypes.data) for x in columns]

    def run(_: object = columns) -> Floats:  # which must live as long
        F = np.empty(len(of.t))
        loop(*inputs, ctypes.c_long(len(F)), ctypes.c_void_p(F.ctypes.data))
        return F

    return run


EXPORTED = """
#include "adhesion_{name}.h"
void loop(const void *p, const void *w, const int64_t *t, const double *K, const double *y, long n,
    double *F)
{{
    adhesion_{name}_state s;
    (void)adhesion_{name}_init(&s, p, w, K[0], y[0]);
    F[0] = s.now.F;
    for (long i = 1; i < n; i++) {{
        (void)adhesion_{name}_step(&s, (double)(t[i] - t[i - 1]) * 1e-9, K[i], y[i]);
        F[i] = s.now.F;
    }}
}}
"""


def export_loop(est: estimator.Estimator, p: Any, w: Wheelset, of: Log, folder: str) -> Any:
    """A loop of the exported C over a log."""
    vehicle = (w.radius, w.phi, w.inertia, w.mass)
    code = Interface(est, p, vehicle, DOUBLE, "benchmark").code()
    place = Path(folder)
    (place / f"adhesion_{est.name}.h").write_text(code.header)
    (place / f"adhesion_{est.name}.c").write_text(code.source)
    (place / f"{est.name}.c").write_text(EXPORTED.format(name=est.name))
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-fno-lto", "-shared", "-fPIC"]
    sources = [f"{est.name}.c", f"adhesion_{est.name}.c"]
    # The loop calls `_step` directly, as in a program that is one file.
    link = ["-Wl,-Bsymbolic", "-o", f"{est.name}.so"]
    command = [os.environ.get("CC", "cc"), *flags, *link, *sources, "-lm"]
    subprocess.run(command, check=True, cwd=place)
    return c_loop(ctypes.CDLL(str(place / f"{est.name}.so")).loop, p, w, of)


def export_rows(est: estimator.Estimator, p: Any, w: Wheelset) -> Iterator[Row]:
    """The exported C against the compiled loop."""
    starts = np.zeros(1, np.int64)
    for jitter, what in ((100_000, ""), (0, ", even")):
        of = log(jitter, N)
        with tempfile.TemporaryDirectory() as folder:
            run_export = export_loop(est, p, w, of, folder)

            def run_compiled(of=of):
                return compiled.batch(est, p, w, *of, starts)[0]

            np.testing.assert_array_equal(run_export(), run_compiled())
            ns, loop_ns = quickest(run_export, run_compiled)
        yield Row(f"export {est.name}{what}", ns, loop_ns, "ns/sample", "the compiled loop")


def rows() -> Iterator[Row]:
    w = wheelset(Vehicle(), 1)
    t, K, y = log(100_000, N)
    starts = np.zeros(1, np.int64)
    for name, est in estimator.registry().items():
        p = methods.validate(est, {})
        yield from export_rows(est, p, w)
        (ns,) = quickest(partial(compiled.batch, est, p, w, t, K, y, starts))
        yield Row(f"estimator {name}", ns, TARGET, "ns/sample", "the target", most=1.0)


if __name__ == "__main__":
    show(rows())
