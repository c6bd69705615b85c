"""Samples as lines: JSON on standard output, and one line on a terminal."""

import json
import math
import os
import shutil
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence

from ..core.annotated import Json
from ..core.document import finite
from ..core.model import Vehicle
from ..core.physics import coefficient
from ..core.text import drop_output
from ..reference.budget import coefficient_u95
from .axle import LiveEstimate, LiveSample, Sink

_STATE_INTERVAL = 0.2  # between two states of the line [s]
_USUAL = 80  # columns of a terminal that does not say
_SILENCE = 3.0  # after which it is said that no sample comes [s]

Say = Callable[[str], None]


class JsonLines(Sink):
    """An object per sample, axle and estimator on a line, also where its reader may be gone."""

    def __init__(self, algos: Sequence[str], vehicle: Vehicle, outlives_reader: bool) -> None:
        self._algos, self._vehicle, self._outlives_reader = algos, vehicle, outlives_reader
        self._reader_gone = False

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        lines = [self._line(s, algo) for s in samples for algo in self._algos]
        text = "\n".join([*lines, ""]).encode()
        try:
            # Past Python's buffer: a thread that waits in it for a reader would hold up the exit.
            while text and not self._reader_gone:
                text = text[os.write(sys.stdout.fileno(), text) :]
        except BrokenPipeError:
            if not self._outlives_reader:
                raise
            self._reader_gone = True
            drop_output()

    def _line(self, s: LiveSample, algo: str) -> str:
        e = s.estimates.get(algo, LiveEstimate(math.nan, math.nan))
        mu = float(coefficient(e.force, self._vehicle, s.axle))  # type: ignore[arg-type]
        said: Json = {
            "axle": s.axle,
            "force_n": finite(e.force),
            "coefficient": finite(mu),
            "u95_n": finite(e.u95),
            "algo": algo,
            "status": s.status,
            "slip": finite(s.slip),
            "regime": s.regime or None,
        }
        return f'{{"t": {_seconds(s.t)}, {json.dumps(said)[1:]}'


class Counts(Sink):
    """How many samples came of each axle, and how many of them have a force."""

    def __init__(self) -> None:
        self._all, self._with_estimate = Counter[int](), Counter[int]()

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        for s in samples:
            self._all[s.axle] += 1
            self._with_estimate[s.axle] += bool(s.estimates)

    def lines(self) -> list[str]:
        """A line per axle."""
        if not self._all:
            return ["no sample came"]
        lines = []
        for n, count in sorted(self._all.items()):
            unestimated = count - self._with_estimate[n]
            force_text = f", {unestimated} of them without a force" if unestimated else ""
            lines.append(f"axle {n}: {count} sample{'s' * (count != 1)}{force_text}")
        return lines


class Waiting(Sink):
    """Says once that no sample comes, and once that they come again."""

    def __init__(self, name: str, say: Say) -> None:
        self._name, self._say = name, say
        self._last_arrival, self._waits = time.monotonic(), False
        self._timer = threading.Timer(_SILENCE, self.idle)  # for the first sample
        self._timer.daemon = True
        self._timer.start()

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        self._last_arrival = time.monotonic()
        if self._waits:
            self._waits = False
            self._say(f"samples come from {self._name}")

    def idle(self) -> None:
        """See `Sink`."""
        if not self._waits and time.monotonic() - self._last_arrival >= _SILENCE:
            self._waits = True
            self._say(f"waiting for samples from {self._name}")

    def close(self) -> None:
        """See `Sink`."""
        self._timer.cancel()


class StatusLine(Sink):
    """The newest sample of each axle on one line of the terminal, as wide as that is."""

    def __init__(self, algo: str, vehicle: Vehicle) -> None:
        self._algo, self._vehicle = algo, vehicle
        self._newest: dict[int, LiveSample] = {}
        self._count, self._since = 0, time.monotonic()
        self._rate, self._last_arrival = 0.0, 0.0
        self._is_drawn = False

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        self._newest |= {s.axle: s for s in samples}
        self._count += len(samples)
        self._last_arrival = time.monotonic()

    def idle(self) -> None:
        """See `Sink`."""
        clock = time.monotonic()
        if clock - self._since < _STATE_INTERVAL or not self._newest:
            return
        self._rate = self._count / len(self._newest) / (clock - self._since)  # of an axle
        self._since, self._count = clock, 0
        tail = f"{self._rate:.0f} Hz, {1e3 * (clock - self._last_arrival):.0f} ms ago"
        self._write(self._fitted(tail, _columns() - 1))

    def _fitted(self, tail: str, width: int) -> str:
        """All axles; in a short form where they need that; else the worst ones, as many as fit."""
        samples = [s for _, s in sorted(self._newest.items())]
        line = " | ".join([*(self._axle(s) for s in samples), tail])
        if len(line) <= width:
            return line
        entries = [(s, self._axle(s, brief=True)) for s in samples]
        line = " | ".join(text for _, text in entries)
        if len(line) <= width:
            return line

        def badness(entry: tuple[LiveSample, str]) -> tuple[bool, float]:
            """A sensor without a value, then the largest slip: what is looked at first."""
            slip = entry[0].slip
            return not entry[0].estimates, slip if math.isfinite(slip) else 0.0

        worst = sorted(entries, key=badness, reverse=True)
        count = len(worst)
        while count and len(line) > width:
            count -= 1
            remainder = [f"{len(entries) - count} more"]
            line = " | ".join([*(text for _, text in worst[:count]), *remainder])
        return line[: max(width, 0)]

    def _axle(self, s: LiveSample, brief: bool = False) -> str:
        if not (e := s.estimates.get(self._algo)):
            return f"{s.axle}: {s.status.replace('-', ' ')}"
        vehicle = self._vehicle.of_axle(s.axle)
        u95 = coefficient_u95(e.u95, e.force, vehicle, e.mass)
        mu = [float(coefficient(x, vehicle, s.axle)) for x in (e.force, u95)]  # type: ignore[arg-type]
        band = f"±{mu[1]:.3f}" if math.isfinite(mu[1]) else ""
        slip = f" {100.0 * s.slip:.{not brief:d}f} %" if math.isfinite(s.slip) else ""
        if brief:
            return f"{s.axle}: {mu[0]:.3f}{slip}"
        return f"{s.axle}: µ {mu[0]:.3f}{band}{slip} {s.regime}".rstrip()

    def _write(self, text: str) -> None:
        self._is_drawn = bool(text)
        sys.stderr.write(f"\r\x1b[2K{text}")
        sys.stderr.flush()

    def clear(self) -> None:
        """Makes room for other text; the line comes again below it."""
        if self._is_drawn:
            self._write("")

    def close(self) -> None:
        """See `Sink`."""
        self.clear()


def _columns() -> int:
    """Width of the terminal now: it may be changed at any time."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns or _USUAL
    except (OSError, ValueError):
        return shutil.get_terminal_size((_USUAL, 24)).columns


def _seconds(t: int) -> str:
    """A time stamp [ns] in seconds, exactly: a float has no nanoseconds of a date."""
    seconds, nanoseconds = divmod(abs(t), 1_000_000_000)
    return f"{'-' * (t < 0)}{seconds}.{f'{nanoseconds:09d}'.rstrip('0') or '0'}"
