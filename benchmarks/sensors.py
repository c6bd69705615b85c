"""Logs of real sensors: what the reference and `imm` are worth on them, against the truth.

    python benchmarks/sensors.py [--logs N] [--seed S] [--jobs N] [--write] [--folder FOLDER]

One car of four axles stops from 12 to 30 m/s, on half of the logs with slides. It shares no
equation code with `adhesion simulate`. The vehicle is stated at its nominal values. A log draws:

| part | what is drawn |
|---|---|
| car | constants within the default tolerances, weight transfer, pitching |
| friction | changes over speed, temperature and clamping force |
| brake | dead time, filling, a chamber that lags the sensor, hysteresis of the caliper |
| WSP | valves that vent, hold and refill in pulses, every 10 ms |
| rail | adhesion over the way, low patches; an axle that slides cleans it for the next |
| wheel speed | pole wheel of 80 to 110 teeth with a timer, run-out, vibration of 5–15 Hz |
| train speed | none, a radar, or a GPS receiver that lags 0.2–1 s |
| bus | cycles that jitter, stamps rounded to 1–10 ms, 10 to 500 Hz |

Targets of the estimators are the reference and the truth. A slide counts from 0.5 s before the slip
exceeds 0.04 to 0.5 s after it; valves count as long as they cycle, and 0.3 s longer. The highest µ
is that of the mean over 0.1 s. `--folder` writes the logs, and the truth of each at its samples.
`--write` puts the tables into docs/validation.md between their marks.
"""

import argparse
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from diagnostics import GRAVITY, Test, log_of, stated_vehicle, write_between
from numba import njit
from pyarrow import csv
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.signal import lfilter

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import Settings, load
from adhesion_cli.analysis.summarise import brake_applications
from adhesion_cli.core.model import Z95, AxleResult, Bools, Floats, Result, Vehicle

HELD_OUT = 20270115  # first seed of the published figures; nothing was developed on it
MARK = "<!-- sensors: begin -->", "<!-- sensors: end -->"
FIVE = "gradient", "kalman", "leso", "neso", "td"
RATES = 10.0, 20.0, 50.0, 100.0, 200.0, 500.0
AXLES = 4
STEP = 0.001  # of the simulation [s]
BIN = 0.5  # of the rail [m]
PLACES = np.array([0.0, 2.5, 17.5, 20.0])  # of the axles behind the first one [m]
SLIP, ABOUT = 0.04, 0.5  # of a slide; and how long it counts before and after [s]
CYCLES = 0.3  # valves count so much longer [s]
PEAK = 0.1  # time over which the highest µ is a mean [s]
FEWEST = 20  # samples of a regime that are judged
APPLY, HOLD, DUMP = 0, 1, 2


# The car


class Car(NamedTuple):
    """True constants; numbers, for numba."""

    mass: float  # of an axle [kg]
    inertia: float  # [kg m²]
    radius: float  # [m]
    friction: float  # cold, at 10 m/s and full pressure
    fade: float  # change per m/s, share of it [s/m]
    hot: float  # share that is lost per kelvin
    heat: float  # of the friction pair [J/K]
    pressed: float  # share that is lost from no to full clamping force
    per_bar: float  # clamping force [N]
    spring: float  # clamping force that the spring takes [N]
    full: float  # clamping force of the full brake [N]
    hysteresis: float  # half-width, share of the force
    dead: float  # [s]
    fill: float  # time constant of the command [s]
    refill: float  # of a cylinder behind a valve [s]
    vent: float  # [s]
    chamber: float  # lag of the chamber behind the sensor [s]
    bogies: float  # load that moves between the bogies, share per m/s²
    wheelsets: float  # and between the wheelsets of a bogie
    pitch: float  # frequency of pitching [Hz]
    stiffness: float  # creep: dµ/ds
    fall: float  # of adhesion over the sliding speed [s/m]
    rest: float  # share of adhesion that stays
    clean: float  # share of dirt that a metre of sliding removes [1/m]
    high: float  # slip at which a valve vents
    low: float  # slip at which it fills again
    resistance: float  # with the gradient [m/s²]


class Motion(NamedTuple):
    """A stop as it was, every `STEP`; shape (n,), or (axles, n)."""

    train: Floats  # [m/s]
    wheel: Floats  # [rad/s]
    pressure: Floats  # at the sensor [bar]
    force: Floats  # adhesion force [N]
    coefficient: Floats  # force over the load of the wheelset
    slip: Floats
    valves: Floats  # 1: the valves cycle


class Truth(NamedTuple):
    """What a log does not show, at its samples; shape (n,), or (axles, n)."""

    t: Floats  # when the sample was taken; the log has its stamp [s]
    force: Floats
    coefficient: Floats
    slip: Floats
    valves: Bools
    near_slide: Bools
    highest: Floats  # highest mean coefficient over `PEAK` near the sample


@njit(cache=True)
def _run(car, level, rail, clean, v0, h):
    """March the car until it stands; the rail is cleaned in place."""
    n = len(level)
    train, wheel, pressure = np.zeros(n), np.zeros((4, n)), np.zeros((4, n))
    forces, loads, slips, valves = wheel.copy(), wheel.copy(), wheel.copy(), wheel.copy()
    v, x, pipe, pitch, pitching, a = v0, 0.0, 0.0, 0.0, 0.0, 0.0
    w, rim_before = np.full(4, v0 / car.radius), np.full(4, v0)
    p, chamber, K, T = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    phase, since, valve, delayed = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((4, 20))
    omega = 2.0 * np.pi * car.pitch
    for j in range(n):
        command = level[max(j - int(car.dead / h), 0)]
        pipe += (command - pipe) * h / car.fill
        pitching += h * (omega * omega * (a - pitch) - 0.5 * omega * pitching)
        pitch += h * pitching
        total = 0.0
        for i in range(4):
            share = car.bogies * (1.0 if i < 2 else -1.0)
            share += car.wheelsets * (1.0 if i % 2 == 0 else -1.0)
            load = car.mass * GRAVITY * (1.0 + share * pitch)
            rim = w[i] * car.radius
            slip = (v - rim) / max(v, 0.5)
            if j % 10 == 0:
                gained = (rim - rim_before[i]) / (10.0 * h)
                rim_before[i] = rim
                since[i] += 10.0 * h
                before = phase[i]
                if v < 1.5:
                    phase[i] = 0.0
                elif (slip > car.high and gained < 1.0) or (slip > car.low and gained < -4.0):
                    phase[i] = 1.0
                elif phase[i] == 1.0 and gained > 0.5:
                    phase[i] = 2.0
                elif phase[i] == 2.0 and slip < car.low:
                    phase[i] = 3.0
                elif phase[i] == 3.0 and since[i] > 1.5:
                    phase[i] = 0.0
                if phase[i] != before:
                    since[i] = 0.0
                if phase[i] == 1.0:
                    valve[i] = 2.0
                elif phase[i] == 2.0 or (phase[i] == 3.0 and since[i] % 0.2 > 0.07):
                    valve[i] = 1.0
                else:
                    valve[i] = 0.0
            acts = delayed[i, j % 20]
            delayed[i, j % 20] = valve[i]
            if acts == 2.0:
                p[i] -= p[i] * h / car.vent
            elif acts == 0.0:
                lag = car.refill if pipe - p[i] > 0.05 else 0.03
                p[i] += (pipe - p[i]) * h / lag
            chamber[i] += (p[i] - chamber[i]) * h / car.chamber
            pressed = max(car.per_bar * chamber[i] - car.spring, 0.0)
            K[i] = min(
                max(K[i], pressed * (1.0 - car.hysteresis)), pressed * (1.0 + car.hysteresis)
            )
            phi = car.friction * (1.0 + car.fade * (rim - 10.0)) * (1.0 - car.hot * T[i])
            phi *= 1.0 + car.pressed * (1.0 - K[i] / car.full)
            T[i] += h * (phi * K[i] * rim / car.heat - T[i] / 60.0)
            b = min(int((x - PLACES[i] + 20.0) / BIN), len(rail) - 1)
            most = rail[b]
            gone, sliding = max(v, 0.3), v - rim
            creep = sliding / gone
            far = (1.0 - car.rest) * np.exp(-car.fall * max(abs(sliding) - 0.3, 0.0)) + car.rest
            bend = (1.0 + (car.stiffness * creep / most) ** 4) ** 0.25
            force = load * car.stiffness * creep / bend * far
            gain = load * car.stiffness / bend**5 * car.radius / gone * far
            torque = (force - phi * K[i]) * car.radius
            change = h * torque / (car.inertia + h * gain * car.radius)
            turned = w[i] + change
            if turned < 0.0 or (turned < 0.02 and phi * K[i] > abs(force)):
                change, turned = -w[i], 0.0
            w[i] = turned
            reaction = car.inertia * change / h / car.radius + phi * K[i]
            if turned == 0.0:
                reaction = force
            if abs(sliding) > 0.03 * gone:
                rail[b] += (clean - rail[b]) * min(car.clean * abs(sliding) * h, 1.0)
            total += reaction
            forces[i, j], loads[i, j], slips[i, j] = reaction, load, creep
            pressure[i, j], wheel[i, j] = p[i], w[i]
            valves[i, j] = 1.0 if phase[i] > 0.0 else 0.0
        a = total / (4.0 * car.mass)
        train[j] = v
        x += h * v
        v -= h * (a + car.resistance)
        if v <= 0.02:
            return train, wheel, pressure, forces, loads, slips, valves, j
    return train, wheel, pressure, forces, loads, slips, valves, n - 1


def drawn_car(rng: np.random.Generator, v: Vehicle, full: float) -> Car:
    """The true car; the stated one is nominal, its default tolerances hold the truth."""

    def near(value: float, sigma: float) -> float:
        return value * (1.0 + sigma * float(np.clip(rng.standard_normal(), -2.0, 2.0)))

    ratio = v.discs.value * v.efficiency.value * v.lever_ratio.value
    per_bar = ratio * np.pi * v.cylinder_diameter.value**2 / 4.0 * 1e5
    spring, mass = ratio * v.spring_force.value, near(v.axle_mass.value, 0.03)
    return Car(
        mass=mass, inertia=near(v.wheelset_inertia.value, 0.05),
        radius=near(v.wheel_radius[0].value, 0.005), friction=near(v.friction.value, 0.06),
        fade=rng.normal(0.0, 0.002), hot=rng.uniform(0.0, 6e-4), heat=rng.uniform(0.6, 2.0) * mass,
        pressed=rng.uniform(0.0, 0.1), per_bar=near(per_bar, 0.03), spring=near(spring, 0.1),
        full=max(per_bar * full - spring, 1.0), hysteresis=rng.uniform(0.02, 0.08),
        dead=rng.uniform(0.05, 0.4), fill=rng.uniform(0.3, 1.0), refill=rng.uniform(0.15, 0.4),
        vent=rng.uniform(0.08, 0.2), chamber=rng.uniform(0.01, 0.06),
        bogies=rng.uniform(0.01, 0.025), wheelsets=rng.uniform(0.005, 0.03),
        pitch=rng.uniform(0.8, 1.6), stiffness=float(np.exp(rng.uniform(*np.log([8.0, 60.0])))),
        fall=rng.uniform(0.1, 0.4), rest=rng.uniform(0.3, 0.6), clean=rng.uniform(0.3, 3.0),
        high=rng.uniform(0.08, 0.2), low=rng.uniform(0.02, 0.05),
        resistance=rng.uniform(0.008, 0.03) + GRAVITY * rng.normal(0.0, 0.002),
    )  # fmt: skip


def drawn_rail(rng: np.random.Generator, way: float, slides: bool) -> tuple[Floats, float]:
    """Peak adhesion of every bin of the way, and of a clean rail."""
    bins = int(way / BIN) + 100
    clean = rng.uniform(0.25, 0.35) if not slides or rng.random() < 0.5 else rng.uniform(0.14, 0.2)
    waves = lfilter([1.0], [1.0, -0.95], rng.standard_normal(bins))
    rail = clean * (1.0 + 0.08 * waves / np.std(waves))
    patches = int(rng.integers(1, 6)) if slides else 0
    for first in rng.uniform(20.0, 0.8 * way, patches):
        begin, share = int(first / BIN), rng.uniform(0.15, 0.45)
        end = begin + int(np.exp(rng.uniform(*np.log([5.0, 120.0]))) / BIN)
        rail[begin:end] *= share
    return np.maximum(rail, 0.02), clean


def driven(rng: np.random.Generator, full: float, v0: float) -> Floats:
    """Command pressure at every step [bar]: coasting, one or two levels, a release at times."""
    share, parts = rng.uniform(0.5, 1.05), []
    parts.append((rng.uniform(3.0, 6.0), 0.0))
    if rng.random() < 0.4:
        parts.append((rng.uniform(2.0, 5.0), full * share * rng.uniform(0.4, 0.7)))
    if rng.random() < 0.3:
        parts.append((rng.uniform(4.0, 8.0), full * share))
        parts.append((rng.uniform(4.0, 6.0), 0.0))
    parts.append((2.5 * v0 / share + 10.0, full * share))
    return np.concatenate([np.full(round(seconds / STEP), bar) for seconds, bar in parts])


def moved(rng: np.random.Generator, stated: Vehicle) -> Motion:
    """A stop of a car of this vehicle."""
    slides = bool(rng.random() < 0.5)
    for _ in range(30):
        v0, full = rng.uniform(12.0, 30.0), _full(stated)
        car, level = drawn_car(rng, stated, full), driven(rng, full, v0)
        rail, clean = drawn_rail(rng, v0 * len(level) * STEP, slides)
        *columns, last = _run(car, level, rail, clean, v0, STEP)
        train, wheel, pressure, force, load, slip, valves = (x[..., : last + 1] for x in columns)
        if bool((np.abs(slip[:, train > 2.0]) > 0.08).any()) == slides and last * STEP < 60.0:
            break
    return Motion(train, wheel, pressure, force, force / load, slip, valves)


def _full(v: Vehicle) -> float:
    """Pressure [bar] that brakes the stated vehicle with 1 m/s²."""
    m, I, R = v.axle_mass.value, v.wheelset_inertia.value, v.wheel_radius[0].value  # noqa: E741
    ratio = v.discs.value * v.efficiency.value * v.lever_ratio.value
    piston = np.pi * v.cylinder_diameter.value**2 / 4.0
    K = m * (1.0 + I / (m * R * R)) / v.friction.value
    return float((K / ratio + v.spring_force.value) / piston / 1e5)


# Its sensors


def sensed(
    rng: np.random.Generator, stated: Vehicle, motion: Motion, rate: float
) -> tuple[Test, Truth]:
    """The log of a stop, and the truth at its samples."""
    own = STEP * np.arange(len(motion.train))
    R = stated.wheel_radius[0].value
    cycle, jitter = 1.0 / rate, rng.uniform(0.0, 0.25) / rate
    t = np.arange(0.2, own[-1], cycle)
    t = t + rng.uniform(-jitter, jitter, len(t))
    teeth, tick = int(rng.integers(80, 111)), rng.choice([0.2e-6, 1e-6, 5e-6, 10e-6])
    gate = rng.choice([0.0, 0.0, 0.005, 0.02])
    shaking = 10.0 ** rng.uniform(-2.7, -1.3)  # at 20 m/s, rms [m/s]
    f, d = rng.uniform(5.0, 15.0), rng.uniform(0.03, 0.15)
    runs_out = rng.uniform(0.0, 2e-3)
    wheel = np.empty((AXLES, len(t)))
    for i in range(AXLES):
        vibration = shaking / R * motion.train / 20.0 * coloured(rng, len(own), f, d)
        turn = motion.wheel[i] * (1.0 + 0.003 * np.clip(rng.standard_normal(), -2.0, 2.0))
        wheel[i] = pole_wheel(rng, own, turn, vibration, t, teeth, tick, gate, runs_out)
    kmh, resolution = 3.6 * R * wheel, rng.choice([0.0, 0.001, 0.01, 0.1])
    kmh = np.round(kmh / resolution) * resolution if resolution else kmh
    noise, step = np.exp(rng.uniform(*np.log([1e-3, 0.02]))), rng.choice([0.001, 0.01, 0.02, 0.05])
    clean = np.array([np.interp(t, own, x) for x in motion.pressure])
    clean = clean * (1.0 + 0.005 * rng.standard_normal((AXLES, 1)))
    clean = clean + 0.01 * rng.standard_normal((AXLES, 1))
    pressure = np.round((clean + rng.normal(0.0, noise, clean.shape)) / step) * step
    slower = int(rng.choice([1, 1, 2, 5])) if rate >= 50.0 else 1  # a frame of its own
    if slower > 1:
        pressure[:, np.arange(len(t)) % slower != 0] = np.nan
    train = received(rng, own, motion.train, t)
    stamp = rng.choice([0.001, 0.001, 0.002, 0.005, 0.01])
    stamps = np.round(np.round(t / stamp) * stamp, 6)
    slid = bool((np.abs(motion.slip[:, motion.train > 2.0]) > 0.08).any())
    test = Test(stated, stamps, np.round(pressure, 6), np.round(kmh, 6), train, clean, slid)
    return test, truth_at(t, own, motion)


def truth_at(t: Floats, own: Floats, motion: Motion) -> Truth:
    """The truth at these times."""

    def longer(mark: Bools, seconds: float) -> Bools:
        window = np.ones(round(2.0 * seconds / STEP))
        return np.array([np.convolve(x, window, "same") > 0.5 for x in mark])

    off = (np.abs(motion.slip) > SLIP) & (motion.train > 1.5)
    nearest = np.clip(np.round(t / STEP).astype(int), 0, len(own) - 1)
    force, coefficient, slip = (
        np.array([np.interp(t, own, x) for x in column])
        for column in (motion.force, motion.coefficient, motion.slip)
    )
    valves, near = longer(motion.valves > 0.0, CYCLES), longer(off, ABOUT)
    # Of all instants, not only of the samples: at 10 Hz these are as far apart as the time is long.
    mean = uniform_filter1d(motion.coefficient, round(PEAK / STEP), axis=1)
    interval = max(round(float(np.median(np.diff(t))) / STEP), 1)
    highest = maximum_filter1d(mean, interval, axis=1)
    return Truth(
        t, force, coefficient, slip, valves[:, nearest], near[:, nearest], highest[:, nearest]
    )


def coloured(rng: np.random.Generator, n: int, f: float, d: float) -> Floats:
    """Noise of rms 1 about the frequency f [Hz], damped by d; every `STEP`."""
    pole = np.exp(2.0 * np.pi * f * STEP * (-d + 1j * np.sqrt(1.0 - d * d)))
    noise = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.standard_normal(n + 2000))
    return noise[2000:] / np.std(noise)


def pole_wheel(
    rng: np.random.Generator, own: Floats, turn: Floats, vibration: Floats, t: Floats,
    teeth: int, tick: float, gate: float, runs_out: float,
) -> Floats:  # fmt: skip
    """Speed [rad/s] by the teeth since the gate began, at least one; 0 without any for 0.3 s."""
    angle = np.cumsum(turn) * STEP
    seen = angle + runs_out * np.sin(angle + rng.uniform(0.0, 6.28)) + np.cumsum(vibration) * STEP
    seen = np.maximum.accumulate(seen) + 1e-9 * np.arange(len(own))
    pitch, count = 2.0 * np.pi / teeth, int(seen[-1] / (2.0 * np.pi / teeth))
    tooth = pitch * (0.003 * rng.standard_normal(teeth))[np.arange(count) % teeth]
    edges = np.interp(pitch * np.arange(count) + tooth, seen, own)
    edges = np.maximum.accumulate(np.round(edges / tick) * tick)
    last = np.searchsorted(edges, t, side="right") - 1
    first = np.minimum(np.searchsorted(edges, t - gate, side="right") - 1, last - 1)
    last, first = np.maximum(last, 1), np.maximum(first, 0)
    speed = (last - first) * pitch / np.maximum(edges[last] - edges[first], tick)
    return np.where(t - edges[last] > 0.3, 0.0, speed)


def received(rng: np.random.Generator, own: Floats, v: Floats, t: Floats) -> Floats | None:
    """Train speed [km/h] of a radar or a receiver, late; NaN between its own samples."""
    kind = rng.choice(["none", "radar", "gps", "gps"])
    if kind == "none":
        return None
    late = rng.uniform(0.2, 1.0)
    sigma = rng.uniform(0.02, 0.1) if kind == "radar" else rng.uniform(0.01, 0.06)
    kmh = 3.6 * (np.interp(t - late, own, v) + rng.normal(0.0, sigma, len(t)))
    kmh = np.maximum(np.round(kmh, 2 if kind == "gps" else 1), 0.0)
    rate = 1.0 / np.median(np.diff(t))
    every = round(rate / (rng.choice([1.0, 5.0, 10.0]) if kind == "gps" else min(rate, 20.0)))
    kmh[np.arange(len(t)) % max(every, 1) != 0] = np.nan
    return kmh


def simulated(seed: int, rate: float) -> tuple[Test, Truth]:
    """The log of this seed, and its truth."""
    rng = np.random.default_rng([seed, 40])
    stated = stated_vehicle(rng)
    motion = moved(rng, stated)
    return sensed(rng, stated, motion, rate)


def write_truth(truth: Truth, path: Path) -> None:
    """The truth at the samples, as CSV."""
    columns: dict[str, Any] = {"time [s]": truth.t}
    for i in range(AXLES):
        columns[f"force_{i + 1} [N]"] = np.round(truth.force[i], 3)
        columns[f"coefficient_{i + 1} [-]"] = np.round(truth.coefficient[i], 7)
        columns[f"slip_{i + 1} [-]"] = np.round(truth.slip[i], 6)
        columns[f"valves_{i + 1} [-]"] = truth.valves[i].astype(int)
        columns[f"near_slide_{i + 1} [-]"] = truth.near_slide[i].astype(int)
    csv.write_csv(pa.table(columns), path)


# Judging


REGIMES = "rolls", "slides", "valves"


class Estimated(NamedTuple):
    """`imm` on one axle of one log, in one regime."""

    rate: float
    regime: str
    of_best: float  # rmse over that of the best of the five; target the reference
    best: str  # which of the five that is
    of_best_truth: float  # the same; target the truth
    of_kalman: float  # over kalman's; target the reference
    within: float  # share of the samples at which its 95 % band holds the reference
    reference: float  # rmse of the reference over the mean force


class Applied(NamedTuple):
    """One brake application of one axle."""

    slides: bool
    mean_inside: bool
    highest_inside: bool
    highest_off: float  # error of the highest µ, share of the true one


class Judged(NamedTuple):
    """One log."""

    rate: float
    slides: bool
    estimates: list[Estimated]
    applications: list[Applied]
    codes: list[str]  # of warnings and errors


def settings_of(v: Vehicle) -> Settings:
    """The vehicle as its operator states it: nominal values."""
    names = "axle_mass", "wheelset_inertia", "friction", "lever_ratio"
    table: dict[str, Any] = {name: getattr(v, name).value for name in names}
    table["wheel_radius"] = v.wheel_radius[0].value
    return load(assignments=[{"vehicle": table}], folder=False)


def judged(case: tuple[int, float]) -> Judged | None:
    """The log of this seed; None if it cannot be analysed."""
    seed, rate = case
    test, truth = simulated(seed, rate)
    with tempfile.TemporaryDirectory() as folder:
        result = analyze(log_of(test, Path(folder)), settings_of(test.vehicle), (*FIVE, "imm"))
    codes = sorted({f.code for f in result.findings if f.severity != "info"})
    return Judged(
        rate, test.slides, list(estimates(result, truth, rate)), list(applied(result, truth)), codes
    )


def at_record(axle: AxleResult, truth: Truth, start_ns: int) -> tuple[Floats, Floats, Bools, Bools]:
    """True force and µ, and where the wheel slides and valves cycle, at the record's times."""
    i, t = axle.record.axle - 1, (axle.record.t - start_ns) * 1e-9 + truth.t[0]
    force, mu, slides, valves = (
        np.interp(t, truth.t, x[i])
        for x in (truth.force, truth.coefficient, truth.near_slide, truth.valves)
    )
    return force, mu, slides > 0.5, valves > 0.5


def estimates(result: Result, truth: Truth, rate: float) -> Iterator[Estimated]:
    """Every axle in every regime."""
    for axle in result.axles:
        reference = axle.reference.force
        force, _, slides, valves = at_record(axle, truth, result.log.start_ns())
        braked = np.zeros(len(axle.record), bool)
        for s in axle.applications:
            braked[s] = True
        braked &= np.isfinite(reference)
        within = np.abs(axle.estimates["imm"] - reference) <= Z95 * axle.sigma("imm")
        for regime, where in zip(REGIMES, (~slides & ~valves, slides, valves), strict=True):
            used = braked & where
            if used.sum() < FEWEST:
                continue

            def rms(x: Floats, target: Floats, used: Bools = used) -> float:
                return float(np.sqrt(np.mean((x - target)[used] ** 2)))

            by_reference, by_truth = (
                {name: rms(x, target) for name, x in axle.estimates.items()}
                for target in (reference, force)
            )
            best = min(FIVE, key=by_reference.__getitem__)
            yield Estimated(
                rate, regime, by_reference["imm"] / by_reference[best], best,
                by_truth["imm"] / min(by_truth[name] for name in FIVE),
                by_reference["imm"] / by_reference["kalman"],
                float(np.mean(within[used])),
                rms(reference, force) / float(np.mean(force[braked])),
            )  # fmt: skip


def applied(result: Result, truth: Truth) -> Iterator[Applied]:
    """Every brake application with a µ."""
    start = result.log.start_ns()
    for axle in result.axles:
        _, mu, slides, _ = at_record(axle, truth, start)
        t = (axle.record.t - start) * 1e-9
        smooth = np.interp(t + truth.t[0], truth.t, truth.highest[axle.record.axle - 1])
        for a in brake_applications(result)[axle.record.axle]:
            used = (t >= a.start_s - 1e-6) & (t <= a.end_s + 1e-6)
            used &= np.isfinite(axle.reference.force)
            c = a.coefficient
            if c is None or c.max is None or used.sum() < FEWEST:
                continue
            highest = float(smooth[used].max())
            yield Applied(
                bool(slides[used].any()),
                abs(c.mean - float(mu[used].mean())) <= c.mean_u95,
                abs(c.max - highest) <= c.max_u95,
                c.max / highest - 1.0,
            )


# The tables


def table(found: list[Judged]) -> str:
    """The figures as Markdown."""
    applications = [a for log in found for a in log.applications]
    rolling, sliding = ([a for a in applications if a.slides == x] for x in (False, True))
    lines = ["| figure | rolling | with slides |", "|---|---:|---:|"]
    for name, inside in (
        ("mean µ inside its band", "mean_inside"),
        ("highest µ inside its band", "highest_inside"),
    ):
        cells = [
            f"{100.0 * np.mean([getattr(a, inside) for a in some]):.1f} % of {len(some)}"
            for some in (rolling, sliding)
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    cells = [f"{100.0 * np.median([a.highest_off for a in x]):+.1f} %" for x in (rolling, sliding)]
    lines.append(f"| error of the highest µ, median | {' | '.join(cells)} |")
    cells = [
        f"{sum('noise-model' in log.codes for log in some)} of {len(some)}"
        for some in ([log for log in found if log.slides == x] for x in (False, True))
    ]
    lines.append(f"| logs with a warning `noise-model` | {' | '.join(cells)} |")
    heads = (
        "rate", "wheel", "axles", "`imm` of best of five", "above 1", "target is the truth",
        "of `kalman`", "band holds", "reference, rmse over mean force",
    )  # fmt: skip
    lines += ["", f"| {' | '.join(heads)} |", "|---|---|" + "---:|" * 7]
    groups = [("10–50 Hz", (10.0, 20.0, 50.0)), ("100–500 Hz", (100.0, 200.0, 500.0))]
    groups += [(f"– {rate:g} Hz", (rate,)) for rate in RATES]
    every = [e for log in found for e in log.estimates]
    for name, rates in groups:
        for regime in REGIMES:
            some = [e for e in every if e.rate in rates and e.regime == regime]
            if not some:
                continue
            best, true = [e.of_best for e in some], [e.of_best_truth for e in some]
            lines.append(
                f"| {name} | {regime} | {len(some)} | {np.median(best):.2f} ({max(best):.2f}) | "
                f"{sum(x > 1.0 for x in best)} | {np.median(true):.2f} | "
                f"{np.median([e.of_kalman for e in some]):.2f} | "
                f"{100.0 * np.mean([e.within for e in some]):.1f} % | "
                f"{np.median([e.reference for e in some]):.3f} |"
            )
    return "\n".join(lines)


def warnings(found: list[Judged]) -> Iterable[str]:
    """How many logs have each code."""
    codes = [c for log in found for c in log.codes]
    return (f"{code}: {codes.count(code)}" for code in sorted(set(codes)))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=HELD_OUT)
    parser.add_argument("--logs", type=int, default=24)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    parser.add_argument("--folder", type=Path, help="write the logs and their truth there")
    options = parser.parse_args()
    cases = [(options.seed + i, RATES[i % len(RATES)]) for i in range(options.logs)]
    if options.folder:
        for seed, rate in cases:
            folder = options.folder / f"{seed}-{rate:g}Hz"
            folder.mkdir(parents=True, exist_ok=True)
            test, truth = simulated(seed, rate)
            log_of(test, folder)
            write_truth(truth, folder / "truth.csv")
        return
    with ProcessPoolExecutor(options.jobs) as pool:
        found = [x for x in pool.map(judged, cases) if x]
    text = table(found)
    print(text, *warnings(found), sep="\n")
    if options.write:
        write_between(MARK, text)


if __name__ == "__main__":
    main()
