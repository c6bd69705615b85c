"""What the first answer is worth: µ of trains that nobody stated, against the truth.

Draws trains of four axles with two bogie pressures: brake, friction over speed, gradient,
resistance, sensor rates, with and without GPS. All wheels roll. Per kind it prints how many
rows (brake application and axle) have their true mean µ inside the 95 % band, the ratio to it, the
width of the band, and slides that were invented.

    python benchmarks/first_answer.py [DRAWS]

| kind | what is special |
|---|---|
| several stops | 2 to 5 stops from 15 to 28 m/s |
| a short stop | one stop from 8 to 14 m/s |
| one bogie | the other bogie's brake is cut off |
| foreign brake | the rest of the train brakes 10 % (1 sigma) harder or weaker per mass |
"""

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.model import Floats
from adhesion_cli.core.physics import G
from adhesion_cli.core.summary import AxleSummary

KINDS = ("several stops", "a short stop", "one bogie", "foreign brake")
STEP = 0.005  # of the simulation [s]
FILLING = 0.3  # time constant of the cylinder [s]


class Train(NamedTuple):
    """One draw."""

    rotating: float  # ρ [-]
    brake: float  # force at the rim per mass and pressure [m/s² per bar]
    zero: float  # pressure from which it acts [bar]
    fade: float  # change of the friction [s/m]
    resistance: float  # [m/s²]
    drag: float  # [1/m]
    gradient: float  # its largest deceleration [m/s²]
    braked: float  # share of the axles
    foreign: float  # of the rest of the train's brake


def draw_train(rng: np.random.Generator, kind: str) -> Train:
    """A train, from an empty metro to a loaded coach."""
    return Train(
        rng.uniform(0.04, 0.12),
        rng.uniform(0.15, 0.6),
        rng.uniform(0.05, 0.5),
        rng.normal(0.0, 0.003),
        rng.uniform(0.008, 0.03),
        rng.uniform(1e-5, 6e-5),
        rng.normal(0.0, 5e-3) * G,
        0.5 if kind == "one bogie" else 1.0,
        rng.normal(0.0, 0.1) if kind == "foreign brake" else 0.0,
    )


def run(
    rng: np.random.Generator, kind: str, train: Train
) -> tuple[Floats, list[tuple[float, float]]]:
    """Time, speed [m/s] and pressure [bar], (3, n); and each stop's command and mean µ."""
    short = kind == "a short stop"
    stops = 1 if short else int(rng.integers(2, 6))
    rows, truth = [], []
    t, pressure = 0.0, 0.0
    v = rng.uniform(8.0, 14.0) if short else rng.uniform(15.0, 28.0)
    for _ in range(stops):
        command, applied, used = t + 8.0, rng.uniform(1.0, 3.2), []
        while v > 0.0:
            pressure += (applied - pressure) * STEP / FILLING * (t > command)
            force = train.brake * max(pressure - train.zero, 0.0) * (1.0 + train.fade * (v - 15.0))
            slope = train.gradient * np.sin(t / 60.0 + 0.3)
            slowing = force * train.braked * (1.0 + train.foreign)
            slowing += train.resistance + train.drag * v * v + slope
            slowing /= 1.0 + train.rotating
            v = max(v - STEP * slowing, 0.0)
            if force > 0.0 and v > 0.3:
                used.append((force - train.rotating * slowing) / G)
            rows.append((t, v, pressure))
            t += STEP
        truth.append((command, float(np.mean(used))))
        for seconds in np.arange(0.0, 6.0, STEP):
            pressure += ((applied if seconds < 5.0 else 0.0) - pressure) * STEP / FILLING
            rows.append((t, 0.0, pressure))
            t += STEP
        faster = rng.uniform(0.4, 0.9)
        while v < 28.0 and len(truth) < stops:
            v, pressure = v + faster * STEP, pressure * (1.0 - STEP / FILLING)
            rows.append((t, v, pressure))
            t += STEP
    return np.array(rows).T, truth


def write(path: Path, rng: np.random.Generator, train: Train, course: Floats) -> None:
    """The log of a run, as a logger would have it."""
    rate = float(rng.choice([10.0, 20.0, 50.0, 100.0]))
    t = np.arange(int(course[0, -1] * rate)) / rate
    v, pressure = (np.interp(t, course[0], x) for x in course[1:])
    columns = {"time [s]": t}
    for bogie, share in ((1, 1.0), (2, float(train.braked == 1.0))):
        columns[f"BCP bogie {bogie} [bar]"] = (
            share * pressure + rng.normal(0.0, 0.01, len(t))
        ).round(2)
    for axle in range(1, 5):
        noise = rng.normal(0.0, 0.05, len(t)) * (v > 0.0)
        columns[f"axle {axle} speed [km/h]"] = np.maximum(3.6 * v + noise, 0.0).round(2)
    cells = {name: [f"{x:g}" for x in values] for name, values in columns.items()}
    if rng.random() < 0.5:
        late = np.interp(t - rng.uniform(0.0, 0.9), *course[:2])
        read = np.maximum(3.6 * late + rng.normal(0.0, 0.1, len(t)), 0.0).round(2)
        cells["GPS speed [km/h]"] = [
            f"{x:g}" if i % int(rate) == 0 else "" for i, x in enumerate(read)
        ]
    lines = (",".join(row) for row in zip(*cells.values(), strict=True))
    path.write_text("\n".join([",".join(cells), *lines, ""]))


class Row(NamedTuple):
    """One brake application of one axle; NaN where µ is not known."""

    ratio: float  # mean µ over the true one
    u95: float  # over the true one
    slides: int  # that nobody slid


def judge(job: tuple[str, int]) -> tuple[str, list[Row]]:
    """The rows of one draw."""
    kind, seed = job
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    train = draw_train(rng, kind)
    course, truth = run(rng, kind, train)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        write(path, rng, train, course)
        result = analyze(path, load(folder=False), ["td"], train_speed=True)
    return kind, list(_rows(summarise(result, {}).axles, truth, train))


def _rows(
    axles: Sequence[AxleSummary], truth: list[tuple[float, float]], train: Train
) -> Iterator[Row]:
    for axle in axles:
        for a in axle.applications:
            command, mu = min(truth, key=lambda x: abs(x[0] - a.start_s))
            if abs(command - a.start_s) < 4.0 and (train.braked == 1.0 or axle.axle < 3):
                c = a.coefficient
                yield Row(c.mean / mu, c.mean_u95 / mu, a.slides) if c else Row(np.nan, np.nan, 0)


def main() -> None:
    """Prints a line per kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("draws", nargs="?", type=int, default=40)
    draws = parser.parse_args().draws
    rows: dict[str, list[Row]] = {kind: [] for kind in KINDS}
    with ProcessPoolExecutor() as pool:
        for kind, found in pool.map(judge, [(kind, i) for kind in KINDS for i in range(draws)]):
            rows[kind] += found
    print(
        "kind             rows  known  in band  ratio (median, rms error)  u95    slides invented"
    )
    for kind, of_kind in rows.items():
        x = np.array([row for row in of_kind if np.isfinite(row.ratio)])
        error = x[:, 0] - 1.0
        print(
            f"{kind:15}  {len(of_kind):4}  {len(x) / len(of_kind):5.1%}  "
            f"{np.mean(np.abs(error) <= x[:, 1]):7.1%}  {np.median(x[:, 0]):.3f}, "
            f"{np.sqrt(np.mean(error**2)):.3f}               {np.median(x[:, 1]):5.1%}  "
            f"{int(x[:, 2].sum())}"
        )


if __name__ == "__main__":
    main()
