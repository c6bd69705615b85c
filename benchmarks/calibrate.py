"""Force of held-back logs, by the vehicle as stated and as `adhesion calibrate` finds it.

    python benchmarks/calibrate.py [--vehicles N] [--fit N] [--held N] [--seed S] [--write]

Vehicles and logs are those of the simulation in `diagnostics.py`, with default tolerances. All logs
of a vehicle have its constants. Route, gradients, rail, creep stiffness, valves and sensors are
drawn anew for each log. Half of the logs have a slide.

The error of a log is the rms error of the force over all its brake applications, divided by the rms
of the true force. The table has its rms over the held-back logs. The error of the mean is that of
the mean force of each brake application, divided by the true one; its rms is over all of them. A
brake application is inside if its true mean force lies in its 95 % interval. The rows `true` have
the vehicle without any error: what is left there are the sensors and the slides. The column
`vehicle alone` has the rms difference from the force by that vehicle: no sensor and no slide is in
it.
"""

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import diagnostics as drawn
import numpy as np

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.channels.log import read
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Z95, Parameter, Vehicle
from adhesion_cli.core.physics import force_line, wheelset, with_fade
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.records import brake_applications
from adhesion_cli.reference import force
from adhesion_cli.studies.calibrate import calibrate

MARK = "<!-- calibration: begin -->", "<!-- calibration: end -->"


class Held(NamedTuple):
    """One log that was not used: squares of the relative error, and applications inside."""

    squares: float
    of_vehicle: float  # the same of the difference from the force by the true vehicle
    means: list[float]  # relative error of the mean force of each brake application
    inside: list[bool]
    bands: list[float]  # relative half-width of its 95 % interval


def true_force(ride: drawn.Ride, car: drawn.Car) -> np.ndarray:
    """Adhesion force of each axle at every step, (axles, n) [N]. Source: wheelset equation (1)."""
    K = np.maximum(car.per_bar * ride.pressure - car.spring, 0.0)
    force = car.friction * (1.0 + car.fade * (ride.train - 10.0)) * K
    turns = np.diff(ride.wheel, axis=1, prepend=ride.wheel[:, :1]) / drawn.STEP
    return force + car.inertia * turns / car.radius[:, None]


def judged(
    path: Path, true_of: np.ndarray, vehicle: Vehicle, exact: Vehicle
) -> Held | None:  # fmt: skip
    """The force of a log by a vehicle, against the true one; None without a brake application."""
    log = read(open_source(path, ReadOptions()), (), vehicle)
    errors, forces, apart = [], [], []
    found = Held(0.0, 0.0, [], [], [])
    by_true = prepare(read(open_source(path, ReadOptions()), (), exact), exact).records
    for record, other in zip(prepare(log, vehicle).records, by_true, strict=True):
        ref = force.compute(with_fade(record, vehicle), vehicle)
        of_true = ref if vehicle is exact else force.compute(with_fade(other, exact), exact)
        own = drawn.STEP * np.arange(true_of.shape[1])
        true = np.interp(record.t * 1e-9, own, true_of[record.axle - 1])
        for s in brake_applications.find_applications(record):
            known = np.isfinite(ref.force[s]) & np.isfinite(of_true.force[s])
            if known.sum() < 2:
                continue
            off = (ref.force[s] - true[s])[known]
            mean = [float(np.mean(x[s][known])) for x in (ref.sigma, ref.tolerance, true)]
            half = Z95 * float(np.hypot(*mean[:2]))
            errors.append(off)
            apart.append((ref.force[s] - of_true.force[s])[known])
            forces.append(true[s][known])
            found.means.append(float(np.mean(off)) / mean[2])
            found.inside.append(abs(float(np.mean(off))) <= half)
            found.bands.append(half / mean[2])
    if not errors:
        return None
    whole = np.sum(np.concatenate(forces) ** 2)
    squares, own = (float(np.sum(np.concatenate(x) ** 2) / whole) for x in (errors, apart))
    return found._replace(squares=squares, of_vehicle=own)


def true_vehicle(v: Vehicle, car: drawn.Car) -> Vehicle:
    """The stated vehicle with the constants of the simulated one, all exact."""
    piston = np.pi * v.cylinder_diameter.value**2 / 4.0 * v.discs.value * v.efficiency.value
    lever = car.per_bar / 1e5 / piston
    spring = car.spring / (v.discs.value * v.efficiency.value * lever)
    values = {
        "friction": car.friction, "friction_fade": car.fade, "friction_speed": 10.0,
        "axle_mass": car.mass, "wheelset_inertia": car.inertia, "lever_ratio": lever,
        "spring_force": spring,
    }  # fmt: skip
    return replace(v, **{name: Parameter(float(x), 0.0) for name, x in values.items()})


def drawn_vehicle(
    seed: int, mass: float
) -> tuple[np.random.Generator, Vehicle, drawn.Car]:  # fmt: skip
    """One vehicle as stated and as it is, and what draws its logs."""
    rng = np.random.default_rng([seed, 18])
    stated = drawn.stated_vehicle(rng)
    stated = replace(
        stated, axle_mass=Parameter(stated.axle_mass.value, mass * stated.axle_mass.value)
    )
    return rng, stated, drawn.true_car(rng, stated, int(rng.choice([1, 1, 2, 4, 4, 3])))


def by_mass(seed: int, mass: float) -> float:
    """Relative error of the force where all but the mass is known: force over mass, exactly.

    By linear regression, as in `reference.calibrated_vehicle`.
    """
    _, stated, car = drawn_vehicle(seed, mass)
    w = wheelset(stated, 1).rolling
    per_bar = 1e5 * force_line(stated).per_pascal
    chain = np.log(car.friction * car.per_bar / (stated.friction.value * per_bar))
    names = ("friction", "efficiency", "discs", "lever_ratio", "radius_ratio")
    shares = [getattr(stated, n).tolerance / getattr(stated, n).value for n in names]
    piston = stated.cylinder_diameter
    known = np.sum(np.square([*shares, 2.0 * piston.tolerance / piston.value]))
    seen = chain - w * np.log(car.mass / stated.axle_mass.value)
    return float(known / (known + (w * mass) ** 2) * seen - chain)


def vehicle(seed: int, fit: int, held: int, mass: float) -> list[list[Held]] | str:
    """One vehicle: its held-back logs as stated, calibrated and true; or why it was refused."""
    rng, stated, car = drawn_vehicle(seed, mass)
    with tempfile.TemporaryDirectory() as where:
        paths, forces = [], []
        for i in range(fit + held):
            ride = drawn.ride_of(rng, stated, car)
            (folder := Path(where) / f"{i}").mkdir()
            paths.append(drawn.log_of(drawn.sensed(rng, ride, None), folder))
            forces.append(true_force(ride, car))
        try:
            done = calibrate(paths[:fit], lambda **_: Settings(vehicle=stated), lambda _: None)
        except UserError as error:
            return error.text
        both = list(zip(paths[fit:], forces[fit:], strict=True))
        exact = true_vehicle(stated, car)
        every = (stated, done.settings.vehicle, exact)
        found = ([judged(path, true, v, exact) for path, true in both] for v in every)
        return [[h for h in of if h] for of in found]


def row(name: str, held: list[Held]) -> str:
    """A row of the table."""
    rms = np.sqrt(np.mean([h.squares for h in held]))
    median = np.median(np.sqrt([h.squares for h in held]))
    means, inside, bands = (
        np.array([x for h in held for x in getattr(h, name)])
        for name in ("means", "inside", "bands")
    )
    own = np.sqrt(np.mean([h.of_vehicle for h in held]))
    shown = [f"{x:.3f}" for x in (rms, median, own, np.sqrt(np.mean(means**2)), inside.mean())]
    return f"| {name} | {' | '.join(shown)} | {100.0 * np.median(bands):.1f} % |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--fit", type=int, default=5, help="logs to calibrate with")
    parser.add_argument("--held", type=int, default=5, help="logs that are held back")
    parser.add_argument("--seed", type=int, default=drawn.HELD_OUT)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    options = parser.parse_args()
    lines = [
        f"{options.vehicles} vehicles, each with {options.fit} logs to calibrate and "
        f"{options.held} held back.",
        "",
        "| mass known to | vehicle | rms error | median | vehicle alone | error of the mean "
        "| inside | band ± |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    refused: list[str] = []
    floors: list[str] = []
    seeds = range(options.seed, options.seed + options.vehicles)
    for mass in (0.05, 0.01):
        work = partial(vehicle, fit=options.fit, held=options.held, mass=mass)
        if options.jobs > 1:
            with ProcessPoolExecutor(options.jobs) as pool:
                found = list(pool.map(work, seeds))
        else:
            found = [work(seed) for seed in seeds]
        done = [x for x in found if not isinstance(x, str)]
        for i, name in enumerate(("stated", "calibrated", "true")):
            lines.append(row(f"{100.0 * mass:g} % | {name}", [h for x in done for h in x[i]]))
        refused += [x for x in found if isinstance(x, str)]
        floor = np.sqrt(np.mean([by_mass(seed, mass) ** 2 for seed in seeds]))
        floors.append(f"{floor:.3f} for a mass known to {100.0 * mass:g} %")
    least = ", ".join(floors)
    lines += ["", f"If nothing but the mass were unknown, `vehicle alone` would be {least}."]
    lines += ["", f"Vehicles refused, of {2 * options.vehicles}: {len(refused)}."]
    print(*refused, sep="\n", file=sys.stderr)
    text = "\n".join(lines)
    print(text)
    if options.write:
        drawn.write_between(MARK, text)


if __name__ == "__main__":
    main()
