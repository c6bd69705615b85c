"""The estimator imm against the reference: its errors, its band, and what is possible.

    python benchmarks/imm.py [--seed S] [--scale X] [--jobs N] [--write]

The logs come from the simulation in `diagnostics.py`, with the sensors of this file. Nothing was
set on the seeds that are used if none is given. Rivals are the best of the paper's five, chosen
afterwards for each axle, and the forward pass of the offline smoother with the noise levels that it
fitted to the whole log. A slide counts from 0.5 s before the slip exceeds 0.04 to 0.5 s after it.
The exact force is that of the stated vehicle, from the simulation's own acceleration and pressure:
it shows where the reference is what errs. "Exact itself" is its own rmse against the reference.
`--write` puts the table into docs/validation.md between its marks.
"""

import argparse
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from diagnostics import STEP, Ride, Test, log_of, ridden, write_between

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core import compiled, estimator
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Z95, AxleRecord, Floats, Vehicle
from adhesion_cli.core.physics import clamping_force, wheelset
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.records import brake_applications
from adhesion_cli.reference import force, smoother

HELD_OUT = 20261124  # first seed of the published figures; imm was developed on others
MARK = "<!-- imm: begin -->", "<!-- imm: end -->"
FIVE = "gradient", "kalman", "leso", "neso", "td"
SENSORS = "white noise", "display steps", "pulse counter", "pulse period"
SLIP, ABOUT = 0.04, 0.5  # of a slide; and how long it counts before and after [s]
FEWEST = 5  # samples that are judged


class Group(NamedTuple):
    """Logs at some rates, as many of each sensor."""

    name: str
    rates: tuple[float, float]  # [Hz]
    axles: int  # 0: drawn
    logs: int  # of each sensor


GROUPS = (
    Group("20–200 Hz", (20.0, 200.0), 0, 25),
    Group("1 Hz", (1.0, 1.0), 1, 8),
    Group("1–10 kHz", (1e3, 1e4), 1, 3),
)


class Judged(NamedTuple):
    """imm on one axle, while its wheel rolls or slides."""

    group: str
    sensor: str
    slides: bool
    of_best: float  # rmse over that of the best of the five
    of_exact: float  # the same against the exact force
    itself: float  # rmse of the exact force over that of the best of the five
    of_forward: float  # and over that of the forward pass
    within: float  # share of the samples at which its 95 % band holds the reference


# Logs


def sensed(rng: np.random.Generator, ride: Ride, sensor: str, rates: tuple[float, float]) -> Test:
    """The log of a ride with this kind of speed sensor."""
    rate = float(np.exp(rng.uniform(*np.log(rates))))
    t = np.arange(0.0, (len(ride.train) - 1) * STEP, 1.0 / rate)
    own, R = STEP * np.arange(len(ride.train)), ride.stated.wheel_radius[0].value
    wheel = np.array([read_out(rng, t, own, turning, R, sensor) for turning in ride.wheel])
    noise, step = np.exp(rng.uniform(*np.log([5e-4, 0.02]))), rng.choice([0.0, 0.01, 0.02, 0.05])
    clean = np.array([np.interp(t, own, x) for x in ride.pressure])
    pressure = clean + rng.normal(0.0, noise, clean.shape)
    pressure = np.round(pressure / step) * step if step else pressure
    return Test(ride.stated, t, np.round(pressure, 6), wheel, None, clean, ride.slides)


def read_out(
    rng: np.random.Generator, t: Floats, own: Floats, turning: Floats, R: float, sensor: str
) -> Floats:
    """Wheel speed ωR [km/h] at the times t, of ω [rad/s] at the times `own`."""
    turn, pulse = np.interp(t, own, turning), 2.0 * np.pi / rng.choice([80, 100, 120])
    if sensor == "pulse counter":  # pulses since the sample before
        angle = np.interp(t, own, np.cumsum(turning) * STEP)
        total = np.floor((angle + rng.uniform(0.0, pulse)) / pulse)
        turns = np.diff(total, prepend=2.0 * total[0] - total[1]) * pulse / (t[1] - t[0])
    elif sensor == "pulse period":  # whole ticks of a timer from pulse to pulse
        turns = pulse / (np.round(pulse / np.maximum(turn, 0.05) / 5e-6) * 5e-6)
    else:
        turns = turn + rng.normal(0.0, np.exp(rng.uniform(*np.log([0.002, 0.1]))), len(t)) / 3.6 / R
    kmh = 3.6 * R * turns
    if sensor == "display steps":
        step = rng.choice([0.01, 0.1, 0.5])
        kmh = np.round(kmh / step) * step
    return np.where(turn > 0.05, np.maximum(np.round(kmh, 6), 0.0), 0.0)


# Judging


def judged(case: tuple[Group, str, int]) -> list[Judged]:
    """Every axle of the log of this seed; none of a log that cannot be analysed."""
    group, sensor, seed = case
    rng = np.random.default_rng([seed, *group.name.encode(), *sensor.encode()])
    ride = ridden(rng, group.axles)
    test = sensed(rng, ride, sensor, group.rates)
    with tempfile.TemporaryDirectory() as folder:
        try:
            log = read(open_source(log_of(test, Path(folder)), ReadOptions()), (), test.vehicle)
            records = prepare(log, test.vehicle).records
        except UserError:
            return []
    found = []
    for r in records:
        own = STEP * np.arange(len(ride.train))
        off = (np.abs(ride.slip[r.axle - 1]) > SLIP) & (ride.train > 1.5)
        w, turning = wheelset(test.vehicle, r.axle), ride.wheel[r.axle - 1]
        clamping = clamping_force(ride.pressure[r.axle - 1] * 1e5, test.vehicle)
        force_at = w.phi * clamping + np.gradient(turning, STEP) / w.a
        near = np.convolve(off, np.ones(round(2.0 * ABOUT / STEP)), "same") > 0.5
        seconds = (r.t - log.start_ns()) * 1e-9
        slides, exact = np.interp(seconds, own, near) > 0.5, np.interp(seconds, own, force_at)
        found += [Judged(group.name, sensor, *x) for x in compared(r, test.vehicle, slides, exact)]
    return found


def compared(
    r: AxleRecord, vehicle: Vehicle, slides: np.ndarray, exact: Floats
) -> Iterator[tuple[bool, float, float, float, float, float]]:
    """Fields of `Judged` for one axle."""
    reference = force.compute(r, vehicle).force
    known, smoother.smooth = smoother.smooth, forward
    try:
        passed = force.compute(r, vehicle).force
    finally:
        smoother.smooth = known
    w, starts = wheelset(vehicle, r.axle), np.array([s.start for s in r.segments])
    F = {
        name: compiled.batch(
            e, e.Params(), w, r.t, r.clamping_force, r.wheel_speed, starts
        )
        for name, e in estimator.registry().items()
        if name in (*FIVE, "imm")
    }  # fmt: skip
    imm, sigma, _ = F["imm"]
    assert sigma is not None
    braked, applications = np.zeros(len(r), bool), brake_applications.find_applications(r)
    for s in applications:
        braked[s] = True
    for s in brake_applications.find_start_ups(r, applications):
        braked[s] = False
    braked &= np.isfinite(reference) & np.isfinite(passed)
    for sliding in (False, True):
        used = braked & (slides == sliding)
        if used.sum() < FEWEST:
            continue

        def rms(x: Floats, target: Floats = reference, used: np.ndarray = used) -> float:
            return float(np.sqrt(np.mean((x - target)[used] ** 2)))

        within = np.abs(imm - reference)[used] <= Z95 * sigma[used]
        best = min(rms(F[name][0]) for name in FIVE)
        of_exact = rms(imm, exact) / min(rms(F[name][0], exact) for name in FIVE)
        yield (
            sliding, rms(imm) / best, of_exact, rms(exact) / best, rms(imm) / rms(passed),
            float(np.mean(within)),
        )  # fmt: skip


def forward(
    run: smoother.UnbrokenRun, regimes: smoother.Regimes, noise: smoother.MeasurementNoise
) -> smoother.Smooth:
    """`smoother.smooth` from the samples so far."""
    kept = np.empty((len(run.t), len(regimes.follow), 6))
    smoother._forward(run, regimes, noise, kept)
    p = kept[:, :, 5] / kept[:, :, 5].sum(axis=1, keepdims=True)
    level, rate = ((p * kept[:, :, i]).sum(axis=1) for i in (0, 1))
    still = np.zeros(len(run.t))
    return smoother.Smooth(level, still, run.u + rate, still)


# The table


def table(found: list[Judged]) -> str:
    """Medians, and in brackets the worst axle, as Markdown."""
    heads = (
        "logs", "wheel", "axles", "of best of five", "above 1", "against the exact force",
        "exact itself", "of forward pass", "band holds",
    )  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "|---|---|" + "---:|" * 7]
    first = GROUPS[0].name
    parts = [(g.name, [x for x in found if x.group == g.name]) for g in GROUPS]
    parts[1:1] = [
        (f"– {s}", [x for x in found if (x.group, x.sensor) == (first, s)]) for s in SENSORS
    ]
    for name, own in parts:
        for slides in (False, True):
            some = [x for x in own if x.slides == slides]
            if not some:
                continue
            best, exact, itself, passed, within = np.array([x[3:] for x in some]).T
            lines.append(
                f"| {name} | {'slides' if slides else 'rolls'} | {len(some)} | "
                f"{np.median(best):.2f} ({best.max():.2f}) | {np.sum(best > 1.0)} | "
                f"{np.median(exact):.2f} | {np.median(itself):.2f} | {np.median(passed):.2f} | "
                f"{100.0 * np.mean(within):.1f} % |"
            )
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=HELD_OUT)
    parser.add_argument("--scale", type=float, default=1.0, help="share of the logs")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    options = parser.parse_args()
    cases = [
        (g, sensor, options.seed + i)
        for g in GROUPS
        for sensor in SENSORS
        for i in range(max(round(options.scale * g.logs), 1))
    ]
    with ProcessPoolExecutor(options.jobs) as pool:
        found = [x for some in pool.map(judged, cases) for x in some]
    text = table(found)
    print(text)
    if options.write:
        write_between(MARK, text)


if __name__ == "__main__":
    main()
