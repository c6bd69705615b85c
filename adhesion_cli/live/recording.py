"""Samples as an MCAP file that can be read while it grows, and after a kill."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.settings import Settings, tree
from ..core.errors import UserError
from ..core.estimator import Estimator
from ..core.text import printable
from ..results.mcap import GrowingResult, Samples
from .axle import Estimate, Sample

_EVERY = 0.5  # between two chunks [s]
_NOTHING = Estimate(float("nan"), float("nan"))


class Recording:
    """A file of all samples.

    Args:
        path: of the file; an older one is replaced.
        log: name of the sender.
        settings: in force.
        algos: estimators with their parameters.
        axles: numbers of the axles.

    Raises:
        UserError: where the file cannot be written.
    """

    def __init__(
        self, path: Path, log: str, settings: Settings,
        algos: Mapping[str, tuple[Estimator, Any]], axles: Sequence[int],
    ) -> None:  # fmt: skip
        self._path, self._algos = path, sorted(algos)
        self._waiting: dict[int, list[Sample]] = {axle: [] for axle in axles}
        self._since = time.monotonic()
        stated = tree(settings, [est for est, _ in algos.values()], axles)
        nothing = {axle: self._samples([]) for axle in axles}
        try:
            self._file = path.open("wb")
            self._result = GrowingResult(self._file, log, stated, settings.vehicle, nothing)
        except OSError as error:
            raise self._failed(error) from error

    def take(self, samples: Sequence[Sample]) -> None:
        """See `Sink`."""
        for s in samples:
            self._waiting[s.axle].append(s)

    def idle(self) -> None:
        """See `Sink`."""
        if time.monotonic() - self._since >= _EVERY:
            self._write()

    def close(self) -> None:
        """See `Sink`."""
        with self._file:
            self._write()
            try:
                self._result.finish()
            except OSError as error:
                raise self._failed(error) from error

    def _write(self) -> None:
        """Writes what waits."""
        self._since = time.monotonic()
        new = {axle: self._samples(of) for axle, of in self._waiting.items() if of}
        try:
            self._result.add(new)
        except OSError as error:
            raise self._failed(error) from error
        for of in self._waiting.values():
            of.clear()

    def _failed(self, error: OSError) -> UserError:
        text = f"{printable(str(self._path))}: cannot be written: {error.strerror}"
        return UserError(
            text, "what is in the file so far can be read; free space, or -o elsewhere"
        )

    def _samples(self, of: Sequence[Sample]) -> Samples:
        """The samples of one axle as columns."""
        columns = [
            np.array([getattr(s, name) for s in of], np.float64)
            for name in ("pressure", "clamping", "speed", "train", "slip")
        ]
        pressure, clamping, speed, train, slip = columns
        estimates = {}
        for algo in self._algos:
            said = [s.estimates.get(algo, _NOTHING) for s in of]
            force, sigma = (np.array([x[i] for x in said], np.float64) for i in (0, 1))
            estimates[algo] = force, sigma
        t = np.array([s.t for s in of], np.int64)
        return Samples(t, pressure, clamping, speed, train, slip, estimates)
