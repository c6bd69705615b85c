"""Samples as lines: JSON on standard output, and one line on a terminal."""

import json
import math
import sys
import time
from collections.abc import Sequence
from typing import Any

from ..core.model import Z95, Vehicle
from ..core.physics import coefficient
from ..core.text import drop_output
from .axle import Estimate, Sample

_EVERY = 0.2  # between two states of the line [s]


class JsonLines:
    """An object per sample, axle and estimator, each on a line of its own.

    Args:
        algos: estimators that are printed.
        vehicle: for the coefficient.
        alone: whether nobody else takes the samples; else they go on without a reader.
    """

    def __init__(self, algos: Sequence[str], vehicle: Vehicle, alone: bool) -> None:
        self._algos, self._vehicle, self._alone = algos, vehicle, alone
        self._gone = False

    def take(self, samples: Sequence[Sample]) -> None:
        """See `Sink`."""
        if self._gone:
            return
        lines = [json.dumps(self._object(s, algo)) for s in samples for algo in self._algos]
        try:
            sys.stdout.write("\n".join([*lines, ""]))
            sys.stdout.flush()
        except BrokenPipeError:
            if self._alone:
                raise
            self._gone = True
            drop_output()

    def _object(self, s: Sample, algo: str) -> dict[str, Any]:
        e = s.estimates.get(algo, Estimate(math.nan, math.nan))
        return {
            "t": s.t * 1e-9,
            "axle": s.axle,
            "force_n": _known(e.force),
            "coefficient": _known(float(coefficient(e.force, self._vehicle))),  # type: ignore[arg-type]
            "u95_n": _known(Z95 * e.sigma),
            "algo": algo,
            "status": s.status,
        }

    def idle(self) -> None:
        """See `Sink`."""

    def close(self) -> None:
        """See `Sink`."""


class StatusLine:
    """The newest sample of each axle on one line of the terminal.

    Args:
        algo: the estimator that is shown.
        vehicle: for the coefficient.
    """

    def __init__(self, algo: str, vehicle: Vehicle) -> None:
        self._algo, self._vehicle = algo, vehicle
        self._newest: dict[int, Sample] = {}
        self._count, self._since = 0, time.monotonic()
        self._rate, self._came = 0.0, 0.0

    def take(self, samples: Sequence[Sample]) -> None:
        """See `Sink`."""
        self._newest |= {s.axle: s for s in samples}
        self._count += 1
        self._came = time.monotonic()

    def idle(self) -> None:
        """See `Sink`."""
        now = time.monotonic()
        if now - self._since < _EVERY or not self._newest:
            return
        self._rate = self._count / (now - self._since)
        self._since, self._count = now, 0
        parts = [self._axle(s) for _, s in sorted(self._newest.items())]
        parts.append(f"{self._rate:.0f} Hz, {1e3 * (now - self._came):.0f} ms ago")
        self._write(" | ".join(parts))

    def _axle(self, s: Sample) -> str:
        if not (e := s.estimates.get(self._algo)):
            return f"{s.axle}: no pressure"
        mu = [float(coefficient(x, self._vehicle)) for x in (e.force, Z95 * e.sigma)]  # type: ignore[arg-type]
        band = f"±{mu[1]:.3f}" if math.isfinite(mu[1]) else ""
        slip = f" {100.0 * s.slip:.1f} %" if math.isfinite(s.slip) else ""
        return f"{s.axle}: µ {mu[0]:.3f}{band}{slip} {e.regime}".rstrip()

    def _write(self, text: str) -> None:
        sys.stderr.write(f"\r\x1b[2K{text}")
        sys.stderr.flush()

    def close(self) -> None:
        """See `Sink`."""
        if self._newest:
            self._write("")


def _known(x: float) -> float | None:
    return x if math.isfinite(x) else None
