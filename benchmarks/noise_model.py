"""NIS of sound logs, and of speeds whose noise is not as the filters assume.

    python benchmarks/noise_model.py [--sound N] [--faults N] [--write]

The logs are those of benchmarks/diagnostics.py, with other seeds than the thresholds were set on.
NIS needs no truth: it is the normalised innovation squared of the reference's forward filter and of
`imm`. A log is accused where `noise-model` names one of its axles. `--write` puts the table into
docs/validation.md between its markers.
"""

import argparse
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import diagnostics as drawn
import numpy as np

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core import compiled, estimator, innovations, physics
from adhesion_cli.core.model import Nis
from adhesion_cli.diagnostics import noise_model
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.reference import force

SEED = 770_000
MARK = "<!-- noise model: begin -->", "<!-- noise model: end -->"
NOISE = 0.3  # of the faults [km/h]
IMM = estimator.registry()["imm"]
Change = Callable[[drawn.Test, np.random.Generator], None]


def _turning(test: drawn.Test, added: np.ndarray) -> None:
    """Adds to the speed of wheels that turn."""
    test.wheel = np.where(test.wheel > 1.0, np.maximum(test.wheel + added, 0.0), test.wheel)


def _filtered(test: drawn.Test, rng: np.random.Generator) -> None:
    """A low pass of the recorder, 0.2 s, after noise."""
    _turning(test, rng.normal(0.0, NOISE, test.wheel.shape))
    share = 1.0 - np.exp(-np.median(np.diff(test.t)) / 0.2)
    for row in test.wheel:
        level = row[0]
        for i, y in enumerate(row):
            level += share * (y - level)
            row[i] = level if y > 0.0 else 0.0


def _bursts(test: drawn.Test, rng: np.random.Generator) -> None:
    """Noise in the second half of the log only."""
    _turning(test, rng.normal(0.0, NOISE, test.wheel.shape) * (test.t > test.t[-1] / 2.0))


def _disturbed(test: drawn.Test, rng: np.random.Generator) -> None:
    """Noise in 3 % of the samples, as by a bad cable."""
    some = rng.random(test.wheel.shape) < 0.03
    _turning(test, rng.normal(0.0, 1.0, test.wheel.shape) * some)


def _vibrates(test: drawn.Test, rng: np.random.Generator) -> None:
    """1.7 Hz."""
    _turning(test, NOISE * np.sin(2.0 * np.pi * 1.7 * test.t)[None])


def _flat(test: drawn.Test, rng: np.random.Generator) -> None:
    """A place on the tread, a tenth of its circumference, at which the wheel turns slower."""
    R = test.vehicle.wheel_radius[0].value
    turned = np.cumsum(test.wheel / 3.6 / R * np.gradient(test.t), axis=1) % (2.0 * np.pi)
    _turning(test, -NOISE * np.exp(-0.5 * ((turned - np.pi) / 0.3) ** 2))


def _jitter(test: drawn.Test, rng: np.random.Generator) -> None:
    """Time stamps off by up to 0.45 of an interval."""
    h = np.median(np.diff(test.t))
    test.t = np.sort(test.t + rng.uniform(-0.45, 0.45, len(test.t)) * h)


FAULTS: dict[str, Change] = {
    "speed filtered by the recorder": _filtered,
    "noise in half of the log": _bursts,
    "noise in 3 % of the samples": _disturbed,
    "vibration of 1.7 Hz": _vibrates,
    "wheel flat": _flat,
    "jitter of the time stamps": _jitter,
}


class Judged(NamedTuple):
    """One axle."""

    reference: Nis | None
    imm: Nis | None
    accused: bool


def axles(seed: int, change: Change | None = None) -> Iterator[Judged]:
    """Every axle of one log."""
    test = drawn.simulated(np.random.default_rng([seed]))
    if change:
        change(test, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        source = open_source(drawn.log_of(test, Path(folder)), ReadOptions())
        records = prepare(read(source, (), test.vehicle), test.vehicle).records
    for r in records:
        w, faded = physics.wheelset(test.vehicle, r.axle), physics.with_fade(r, test.vehicle)
        starts = np.array([s.start for s in r.segments])
        columns = r.t, faded.clamping_force, r.wheel_speed, starts
        squares = compiled.batch(IMM, IMM.Params(), w, *columns).nis
        assert squares is not None
        found = Judged(force.compute(faded, test.vehicle).nis, innovations.mean(squares), False)
        both = {"the reference": found.reference, "imm": found.imm}
        told = list(noise_model.check(noise_model.Params(), "axle", both))
        yield found._replace(accused=bool(told))


def row(name: str, logs: list[list[Judged]]) -> str:
    """One row of the table."""
    every = [a for log in logs for a in log]
    cells = []
    for nis in ([a.reference for a in every], [a.imm for a in every]):
        means = np.array([x.mean for x in nis if x])
        cells.append(f"{np.median(means):.2f} ({means.min():.2f}–{means.max():.2f})")
    accused = sum(any(a.accused for a in log) for log in logs)
    return f"| {name} | {len(every)} | {cells[0]} | {cells[1]} | {accused} of {len(logs)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sound", type=int, default=60)
    parser.add_argument("--faults", type=int, default=8)
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    options = parser.parse_args()
    lines = ["| logs | axles | NIS of the reference | NIS of `imm` | accused |"]
    lines.append("|---|---:|---|---|---:|")
    kinds: dict[str, Change | None] = {"sound": None, **FAULTS}
    for name, change in kinds.items():
        count = options.faults if change else options.sound
        lines.append(row(name, [list(axles(SEED + i, change)) for i in range(count)]))
        print(lines[-1], flush=True)
    if options.write:
        drawn.write_between(MARK, "\n".join(lines))


if __name__ == "__main__":
    main()
