"""Accuracy of the reference against the best zero-phase Butterworth chosen knowing the truth.

    python benchmarks/reference.py

Simulated logs with known force: RMSE of the smoother over that of the best filter (cut-off and
order searched with the truth at hand; φK left alone or filtered along), the share of errors within
1.96 sigma while rolling and while sliding, and the time for one hour at 100 Hz. Several noise
seeds; the worst ratio and share count.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from table import Row

from adhesion_cli.core.model import AxleRecord, Floats
from adhesion_cli.reference import force

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from helpers.reference_runs import (
    HARD,
    HARD_SLIDING,
    ROLLING,
    SLIDING,
    VEHICLE,
    best_butterworth,
    logged,
    rms,
)

SEEDS = range(1, 6)


def hour(name: str) -> AxleRecord:
    """A record repeated to one hour at 100 Hz, each repetition a segment."""
    one, _ = logged(name, 100.0, pressure_noise=1000.0)
    n = len(one)
    times = 360_000 // n
    every = one.t[-1] + one.t[1]
    columns = ("clamping_force", "clamping_force_smooth", "wheel_speed", "pressure", "truth")
    return replace(
        one,
        t=np.concatenate([one.t + i * every for i in range(times)]),
        segments=tuple(slice(i * n, (i + 1) * n) for i in range(times)),
        **{name: np.tile(getattr(one, name), times) for name in columns},
    )


def cases() -> Iterator[tuple[str, float, float, Floats]]:
    """Of each case: name, the RMSE and the best filter's of the worst seed, shares of errors."""
    for name in ("service-brake", "four-axles", "low-adhesion", "leaf-film"):
        slides_too = name in ("low-adhesion", "leaf-film")
        settings = SLIDING | HARD_SLIDING if slides_too else ROLLING | HARD
        for case, how in settings.items():
            pairs, inside = [], []
            for seed in SEEDS:
                record, slides = logged(name, seed=seed, **how)
                F = force.compute(record, VEHICLE)
                error = F.force - record.truth
                used = np.isfinite(error)
                pairs.append((rms(error[used]), best_butterworth(record, used)))
                good = np.abs(error) < 1.96 * F.sigma
                inside.append([good[used & part].mean() if part.any() else np.nan
                               for part in (~slides, slides)])  # fmt: skip
            ours, best = max(pairs, key=lambda pair: pair[0] / pair[1])
            yield f"{name}, {case}", ours, best, np.min(inside, axis=0)


def rows() -> Iterator[Row]:
    for name, ours, best, _ in cases():
        yield Row(name, ours, best, "N RMSE", "the best Butterworth knowing the truth")


def main() -> None:
    print(f"{'':32} {'RMSE':>7} {'best':>7} {'ratio':>6}   within 1.96 sigma: rolling, sliding")
    for name, ours, best, inside in cases():
        share = " ".join(f"{100.0 * x:6.0f} %" for x in inside)
        print(f"{name:32} {ours:7.2f} {best:7.2f} {ours / best:6.2f} {share}", flush=True)
    record = hour("low-adhesion")
    force.compute(record, VEHICLE)
    start = time.perf_counter()
    force.compute(record, VEHICLE)
    print(f"one hour at 100 Hz: {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
