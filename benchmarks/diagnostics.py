"""Scorecard of the checks: seeded faults found, and sound logs accused.

    python benchmarks/diagnostics.py [--sound N] [--faults N] [--seed S] [--jobs N] [--write]

The brake tests come from the simulation in this file. It shares no equation code with
`adhesion simulate`, so that the checks are not judged by their own assumptions. Each log draws its
vehicle, rail, valves, sensors and gradients from the ranges of `_vehicle`, `_route` and `_sensors`.

A sound log is accused if any check reports a warning or an error on it. A fault is found if a check
that can see this kind of fault reports a warning or an error. `--write` puts the tables into
docs/validation.md between its markers.
"""

import argparse
import contextlib
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numba import njit
from pyarrow import csv

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Finding, Parameter, Vehicle
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

HELD_OUT = 20261123  # seed of the published figures; thresholds are set on other seeds
GRAVITY = 9.80665  # [m/s²]
STEP = 0.002  # of the simulation [s]
PAGE = Path(__file__).parent.parent / "docs" / "validation.md"
MARK = "<!-- diagnostics scorecard: begin -->", "<!-- diagnostics scorecard: end -->"

# Findings about how the log was written or read: they accuse no sensor, clock, unit or vehicle.
LAYOUT = {"vehicle-assumed", "vehicle-default", "gap", "empty-channel", "too-short"}


class Car(NamedTuple):
    """True constants of a simulated vehicle."""

    mass: float  # per axle [kg]
    inertia: float  # of a wheelset [kg m²]
    friction: float  # at 10 m/s [-]
    fade: float  # change of the friction per m/s, share of it [s/m]
    per_bar: float  # clamping force per bar [N]
    spring: float  # what the return spring takes from the clamping force [N]
    resistance: tuple[float, float]  # m/s² at rest and per (m/s)²
    radius: np.ndarray  # of each axle [m]
    others: int  # further axles of the train, which are not in the log and roll


@njit(cache=True)
def _run(
    level, drive, slope, low, mass, inertia, friction, fade, per_bar, spring, rest, drag, radius,
    others, stiffness, peak, fall, fill, release, dead, wsp, v0, h,
):  # fmt: skip
    """March train and wheels; returns train speed, rim speed/R, pressure and slip per step."""
    n, k = len(level), len(radius)
    v, w, p = np.zeros(n), np.zeros((k, n)), np.zeros((k, n))
    slip = np.zeros((k, n))
    speed, turn, press, rail = v0, v0 / radius, np.zeros(k), level[0]
    state = np.zeros(k)
    for j in range(n):
        command = level[max(j - dead, 0)]
        rate = h / (fill if command > rail else release)
        rail += (command - rail) * min(rate, 1.0)
        total = 0.0
        for i in range(k):
            target = rail
            s = (speed - turn[i] * radius[i]) / max(speed, 0.5)
            if wsp and speed > 1.5:  # dump, hold, apply by slip
                if state[i] == 1.0:
                    state[i] = 1.0 if s > 0.08 else 2.0
                elif state[i] == 2.0:
                    state[i] = 2.0 if s > 0.03 else 0.0
                if s > 0.12:
                    state[i] = 1.0
                if state[i] == 1.0:
                    target = 0.0
                elif state[i] == 2.0:
                    target = press[i]
            else:
                state[i] = 0.0
            lag = 0.12 if target < press[i] else 0.25
            press[i] += (target - press[i]) * h / lag if wsp else (target - press[i])
            K = max(per_bar * press[i] - spring, 0.0)
            phi = friction * (1.0 + fade * (speed - 10.0))
            most = peak * (low[i, j] if low[i, j] < 1.0 else 1.0)
            gone = max(speed, 0.3)
            creep = (speed - turn[i] * radius[i]) / gone
            far = 0.6 * np.exp(-fall * max(abs(speed - turn[i] * radius[i]) - 0.3, 0.0)) + 0.4
            x = stiffness * creep / most
            bend = (1.0 + x**4) ** 0.25
            force = mass * GRAVITY * stiffness * creep / bend * far
            gain = mass * GRAVITY * stiffness / bend**5 * radius[i] / gone * far
            torque = force * radius[i] - phi * K * radius[i]
            change = h * torque / (inertia + h * gain * radius[i])
            turn[i] += change
            if turn[i] < 0.0 or (turn[i] < 0.02 and K > 0.0 and phi * K > abs(force)):
                turn[i] = 0.0
            total += inertia * change / h / radius[i] + phi * K  # reaction of the rail
            p[i, j], w[i, j], slip[i, j] = press[i], turn[i], creep
        K = max(per_bar * rail - spring, 0.0)
        rolling = friction * (1.0 + fade * (speed - 10.0)) * K
        rolling /= 1.0 + inertia / (mass * radius[0] ** 2)
        total += others * rolling
        a = drive[j] - total / (mass * (k + others))
        a -= rest + drag * speed * speed + GRAVITY * slope[j]
        speed += h * a
        if speed <= 0.0:
            speed = 0.0
        v[j] = speed
    return v, w, p, slip


def stated_vehicle(rng: np.random.Generator) -> Vehicle:
    """A vehicle as its operator states it, with the default tolerances."""
    usual = Vehicle()

    def with_usual(name: str, value: float) -> Parameter:
        p = np.atleast_2d(getattr(usual, name))[0]
        return Parameter(value, value * float(p[1] / p[0]))

    mass = float(np.exp(rng.uniform(np.log(4500.0), np.log(16000.0))))
    radius = rng.uniform(0.40, 0.47)
    friction = rng.uniform(0.18, 0.38)
    inertia = mass * radius**2 * rng.uniform(0.06, 0.17)
    bar = rng.uniform(2.8, 4.2)  # full service brake
    wanted = rng.uniform(0.8, 1.2) * mass * (1.0 + inertia / (mass * radius**2)) / friction
    piston = np.pi * 0.1295**2 / 4.0 * bar * 1e5 - 1450.0
    return replace(
        usual,
        axle_mass=with_usual("axle_mass", mass),
        wheelset_inertia=with_usual("wheelset_inertia", inertia),
        friction=with_usual("friction", friction),
        wheel_radius=(with_usual("wheel_radius", radius),),
        lever_ratio=Parameter(float(wanted / (2.0 * 0.97 * piston)), 0.0),
    )


def true_car(rng: np.random.Generator, v: Vehicle, axles: int) -> Car:
    """The true vehicle: each constant off by its stated tolerance."""

    def true(p: Parameter) -> float:
        return float(p.value + p.tolerance * np.clip(rng.standard_normal(), -2.5, 2.5))

    ratio = v.discs.value * true(v.efficiency) * v.lever_ratio.value
    radius = v.wheel_radius[0]
    worn = radius.tolerance * np.clip(rng.standard_normal(axles), -2.5, 2.5)
    return Car(
        true(v.axle_mass), true(v.wheelset_inertia), true(v.friction), rng.normal(0.0, 0.002),
        ratio * np.pi * true(v.cylinder_diameter) ** 2 / 4.0 * 1e5, ratio * true(v.spring_force),
        (rng.uniform(0.005, 0.02), rng.uniform(1e-5, 6e-5)), radius.value + worn,
        int(rng.choice([0, 0, axles])),
    )  # fmt: skip


def _full(v: Vehicle) -> float:
    """Pressure [bar] that brakes the stated vehicle with 1 m/s²."""
    m, I, R = v.axle_mass.value, v.wheelset_inertia.value, v.wheel_radius[0].value  # noqa: E741
    K = m * (1.0 + I / (m * R * R)) / v.friction.value
    ratio = v.discs.value * v.efficiency.value * v.lever_ratio.value
    piston = np.pi * v.cylinder_diameter.value**2 / 4.0
    return float((K / ratio + v.spring_force.value) / piston / 1e5)


def _route(rng: np.random.Generator, full: float, v0: float) -> tuple[np.ndarray, ...]:
    """Pressure asked for [bar], traction [m/s²] and gradient [-] at every step."""
    level: list[np.ndarray] = []
    drive: list[np.ndarray] = []
    slope: list[np.ndarray] = []

    def add(seconds: float, bar: float, traction: float) -> None:
        n = round(seconds / STEP)
        level.append(np.full(n, bar))
        drive.append(np.full(n, traction))
        slope.append(np.full(n, grade))

    many, speed = int(rng.choice([1, 1, 2, 3, 4])), v0
    grade = rng.normal(0.0, 0.003)
    add(rng.uniform(2.0, 8.0), 0.0, 0.0)
    for i in range(many):
        last, grade = i == many - 1, rng.normal(0.0, 0.003)
        share = rng.uniform(0.35, 1.1)
        to = 0.0 if last and rng.random() < 0.7 else rng.uniform(0.3, 0.75) * speed
        seconds = (speed - to) / share
        if rng.random() < 0.35:  # in steps, as a driver brakes
            add(rng.uniform(2.0, 5.0), full * share * rng.uniform(0.4, 0.7), 0.0)
        add(min(seconds, 60.0), full * share, 0.0)
        if to == 0.0:
            add(rng.uniform(4.0, 10.0), full * share, 0.0)
            break
        add(rng.uniform(3.0, 12.0), 0.0, 0.0)
        speed = to
        if not last and rng.random() < 0.5:
            gained = rng.uniform(3.0, 10.0)
            add(gained / 0.5, 0.0, 0.5)
            add(rng.uniform(3.0, 6.0), 0.0, 0.0)
            speed += gained
    return np.concatenate(level), np.concatenate(drive), np.concatenate(slope)


def _rail(rng: np.random.Generator, axles: int, level: np.ndarray) -> np.ndarray:
    """Share of the peak adhesion that each axle has at every step: low in one to three places."""
    low = np.ones((axles, len(level)))
    braked = np.flatnonzero(level > 0.0)
    for _ in range(int(rng.integers(1, 4))):
        first = int(rng.choice(braked))
        n, share = round(rng.uniform(2.0, 8.0) / STEP), rng.uniform(0.15, 0.35)
        for i in range(axles):
            begin = first + round(0.15 * i / STEP)
            low[i, begin : begin + n] = min(share * (1.0 + 0.2 * i), 1.0)
    return low


@dataclass
class Test:
    """One brake test: what the sensors give, and what is stated about the vehicle."""

    vehicle: Vehicle
    t: np.ndarray  # [s]
    pressure: np.ndarray  # (axles, n) [bar]
    wheel: np.ndarray  # (axles, n) [km/h]
    train: np.ndarray | None  # [km/h]; NaN where the receiver gives nothing
    true_pressure: np.ndarray  # (axles, n) without the sensor's noise and step
    slides: bool

    def brake(self) -> tuple[float, float]:
        """First and last time at which a brake is on [s]."""
        on = np.flatnonzero(self.pressure.max(axis=0) > 0.3 * self.pressure.max())
        return float(self.t[on[0]]), float(self.t[on[-1]])


def _rounded(x: np.ndarray, step: float) -> np.ndarray:
    return np.round(np.round(x / step) * step, 9) if step else np.round(x, 6)


class Ride(NamedTuple):
    """A simulated brake test before its sensors; columns of one value per `STEP`."""

    stated: Vehicle
    train: np.ndarray  # (n,) [m/s]
    wheel: np.ndarray  # (axles, n) [rad/s]
    pressure: np.ndarray  # (axles, n) [bar]
    slip: np.ndarray  # (axles, n)
    slides: bool


def simulated(rng: np.random.Generator, axles: int = 0, train: bool | None = None) -> Test:
    """A sound brake test."""
    return sensed(rng, ridden(rng, axles), train)


def ridden(rng: np.random.Generator, axles: int = 0) -> Ride:
    """A brake test as it truly was."""
    stated = stated_vehicle(rng)
    axles = axles or int(rng.choice([1, 1, 2, 4, 4, 3]))
    return ride_of(rng, stated, true_car(rng, stated, axles))


def ride_of(rng: np.random.Generator, stated: Vehicle, car: Car) -> Ride:
    """A brake test of a vehicle."""
    axles, full = len(car.radius), _full(stated)
    slides = bool(rng.random() < 0.5)
    for _ in range(20):
        v0 = rng.uniform(12.0, 45.0)
        level, drive, slope = _route(rng, full, v0)
        low = _rail(rng, axles, level) if slides else np.ones((axles, len(level)))
        v, w, p, slip = _run(
            level, drive, slope, low, car.mass, car.inertia, car.friction, car.fade, car.per_bar,
            car.spring, *car.resistance, car.radius, car.others,
            float(np.exp(rng.uniform(np.log(8.0), np.log(60.0)))), rng.uniform(0.22, 0.35),
            rng.uniform(0.1, 0.4), rng.uniform(0.25, 0.9), rng.uniform(0.3, 1.2),
            round(rng.uniform(0.0, 0.3) / STEP), slides, v0, STEP,
        )  # fmt: skip
        if (np.abs(slip) > 0.08).any() == slides:
            break
    return Ride(stated, v, w, p, slip, slides)


def sensed(rng: np.random.Generator, ride: Ride, with_train: bool | None) -> Test:
    """The log of a ride: rates, noise, steps and pulse timers of its sensors."""
    stated, v, w, p, _, slides = ride
    axles, span = len(w), len(v) * STEP
    rate = rng.uniform(1.0, 2.0) if rng.random() < 0.07 else np.exp(rng.uniform(*np.log([5, 200])))
    t = np.arange(0.0, span - STEP, 1.0 / rate)
    own = STEP * np.arange(len(v))
    R = stated.wheel_radius[0].value
    noise, step = np.exp(rng.uniform(*np.log([0.002, 0.1]))), float(rng.choice([0, 0.01, 0.1, 0.5]))
    timer = 2.0 * np.pi / rng.choice([80, 100, 120]) if rng.random() < 0.15 else 0.0
    wheel = np.empty((axles, len(t)))
    for i in range(axles):
        turn = np.interp(t, own, w[i])
        if timer:  # whole ticks from pulse to pulse
            ticks = np.round(timer / np.maximum(turn, 0.05) / 5e-6) * 5e-6
            wheel[i] = np.where(turn > 0.05, 3.6 * R * timer / ticks, 0.0)
        else:
            wheel[i] = _rounded(3.6 * turn * R + rng.normal(0.0, noise, len(t)), step)
            wheel[i] = np.where(turn > 0.05, np.maximum(wheel[i], 0.0), 0.0)
    noise, step = np.exp(rng.uniform(*np.log([5e-4, 0.02]))), rng.choice([0.0, 0.01, 0.02, 0.05])
    clean = np.array([np.interp(t, own, x) for x in p])
    clean *= 1.0 + 0.005 * rng.standard_normal((axles, 1))
    clean += 0.01 * rng.standard_normal((axles, 1))
    pressure = _rounded(clean + rng.normal(0.0, noise, clean.shape), step)
    train = None
    if with_train or (with_train is None and rng.random() < 0.5):
        train = _received(rng, t, np.interp(t, own, v), rate)
    return Test(stated, t, pressure, wheel, train, clean, slides)


def _received(rng: np.random.Generator, t: np.ndarray, v: np.ndarray, rate: float) -> np.ndarray:
    """The train speed of a radar at every sample, or of a receiver at 1 to 10 Hz [km/h]."""
    kmh = _rounded(3.6 * (v + rng.normal(0.0, rng.uniform(0.005, 0.08), len(t))), 0.01)
    kmh = np.maximum(kmh, 0.0)
    every = round(rate / rng.choice([1.0, 2.0, 5.0, 10.0]))
    if every > 1 and rng.random() < 0.6:
        blank = np.arange(len(t)) % every != 0
        kmh[blank] = np.nan
    return kmh


# Faults


def _from(test: Test, rng: np.random.Generator) -> int:
    """A sample within a brake after which there is still some brake."""
    first, last = test.brake()
    return int(np.searchsorted(test.t, rng.uniform(first, first + 0.6 * (last - first))))


def _later(x: np.ndarray, t: np.ndarray, by: float) -> np.ndarray:
    known = np.isfinite(x)
    moved = np.interp(t - by, t[known], x[known])
    return np.where(known, moved, np.nan)


def _pressure_all(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., None]:
    def fault(test: Test, rng: np.random.Generator) -> None:
        test.pressure = np.round(change(test.pressure), 6)

    return fault


def _pressure_late(test: Test, rng: np.random.Generator) -> None:
    by = rng.uniform(0.3, 1.0) * rng.choice([-1.0, 1.0, 1.0])
    test.pressure = np.array([_later(x, test.t, by) for x in test.pressure])


def _one_late(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.pressure)))
    test.pressure[i] = _later(test.pressure[i], test.t, rng.uniform(0.3, 1.0))


def _pressure_stuck(test: Test, rng: np.random.Generator) -> None:
    i, at = int(rng.integers(len(test.pressure))), _from(test, rng)
    test.pressure[i, at:] = test.pressure[i, at]


def _pressure_lost(test: Test, rng: np.random.Generator) -> None:
    i, at = int(rng.integers(len(test.pressure))), _from(test, rng)
    n = int(np.searchsorted(test.t, test.t[at] + rng.uniform(2.0, 6.0)))
    test.pressure[i, at:n] = 0.0


def _pressure_saturated(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.pressure)))
    end = rng.uniform(0.5, 0.85) * test.true_pressure[i].max()
    test.pressure[i] = np.minimum(test.pressure[i], np.round(end, 3))


def _pressure_spikes(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.pressure)))
    at = rng.choice(len(test.t), max(3, len(test.t) // 500), replace=False)
    test.pressure[i, at] = rng.choice([0.0, 10.0])


def _pressure_offset(test: Test, rng: np.random.Generator) -> None:
    top = test.pressure.max()
    test.pressure = np.round(test.pressure + rng.choice([-0.15, 0.15, 0.25]) * top, 6)


def _pressure_drift(test: Test, rng: np.random.Generator) -> None:
    i, top = int(rng.integers(len(test.pressure))), test.pressure.max()
    way = rng.choice([-0.4, 0.4]) * top
    test.pressure[i] = np.round(test.pressure[i] + way * test.t / test.t[-1], 6)


def _pressure_steps(test: Test, rng: np.random.Generator) -> None:
    """The scale of every pressure changes in mid-log, as by an amplifier's supply."""
    at = _from(test, rng)
    test.pressure[:, at:] = np.round(rng.choice([0.5, 1.7]) * test.pressure[:, at:], 6)


def _one_scale(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.pressure)))
    test.pressure[i] = np.round(rng.choice([0.5, 2.0]) * test.pressure[i], 6)


def _pressure_swapped(test: Test, rng: np.random.Generator) -> None:
    test.pressure[[0, -1]] = test.pressure[[-1, 0]]


def _wheel_swapped(test: Test, rng: np.random.Generator) -> None:
    test.wheel[[0, -1]] = test.wheel[[-1, 0]]


def _wheel_stuck(test: Test, rng: np.random.Generator) -> None:
    i, at = int(rng.integers(len(test.wheel))), _from(test, rng)
    test.wheel[i, at:] = test.wheel[i, at]


def _wheel_zero(test: Test, rng: np.random.Generator) -> None:
    i, at = int(rng.integers(len(test.wheel))), _from(test, rng)
    n = int(np.searchsorted(test.t, test.t[at] + rng.uniform(1.0, 5.0)))
    test.wheel[i, at:n] = 0.0


def _wheel_spikes(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.wheel)))
    at = rng.choice(len(test.t), max(3, len(test.t) // 500), replace=False)
    test.wheel[i, at] *= rng.choice([0.0, 2.5])


def _wheel_diameter(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.wheel)))
    test.wheel[i] = np.round(rng.choice([0.95, 1.05]) * test.wheel[i], 6)


def _wheel_drift(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.wheel)))
    gain = 1.0 + rng.choice([-0.15, 0.15]) * test.t / test.t[-1]
    test.wheel[i] = np.round(gain * test.wheel[i], 6)


def _wheel_saturated(test: Test, rng: np.random.Generator) -> None:
    i = int(rng.integers(len(test.wheel)))
    test.wheel[i] = np.minimum(test.wheel[i], np.round(0.7 * test.wheel[i].max(), 2))


def _unit(name: str, factor: float) -> Callable[..., None]:
    def fault(test: Test, rng: np.random.Generator) -> None:
        setattr(test, name, np.round(factor * getattr(test, name), 6))

    return fault


def _train_late(test: Test, rng: np.random.Generator) -> None:
    assert test.train is not None
    test.train = _later(test.train, test.t, rng.uniform(0.5, 2.0))


def _train_offset(test: Test, rng: np.random.Generator) -> None:
    assert test.train is not None
    test.train = np.round(test.train + rng.choice([-3.0, 3.0]), 6)


def _train_stuck(test: Test, rng: np.random.Generator) -> None:
    assert test.train is not None
    at = _from(test, rng)
    known = np.flatnonzero(np.isfinite(test.train))
    value = test.train[known[np.searchsorted(known, at, side="right") - 1]]
    test.train[at:] = np.where(np.isfinite(test.train[at:]), value, np.nan)


def _train_spikes(test: Test, rng: np.random.Generator) -> None:
    assert test.train is not None
    known = np.flatnonzero(np.isfinite(test.train))
    test.train[rng.choice(known, min(3, len(known)), replace=False)] = rng.choice([0.0, 300.0])


def _stated_wrong(name: str, factor: float) -> Callable[..., None]:
    def fault(test: Test, rng: np.random.Generator) -> None:
        p = getattr(test.vehicle, name)
        wrong = Parameter(factor * p.value, factor * p.tolerance)
        test.vehicle = replace(test.vehicle, **{name: wrong})

    return fault


class Fault(NamedTuple):
    """One kind of fault: how it is made, what it needs, and whose channel a finding may name."""

    make: Callable[..., None]
    axles: int = 0  # that the log must have; 0 any
    train: bool | None = None
    seen: str = "pressure unit vehicle brake axle force deceleration"  # codes' beginnings


_OF_SPEED = "speed wheel unit train axle vehicle pressure deceleration force"
_OF_TRAIN = "train speed unit wheel vehicle deceleration"
FAULTS: dict[str, Fault] = {
    "pressure x0.5": Fault(_pressure_all(lambda p: 0.5 * p)),
    "pressure x0.8": Fault(_pressure_all(lambda p: 0.8 * p)),
    "pressure x1.3": Fault(_pressure_all(lambda p: 1.3 * p)),
    "pressure x2": Fault(_pressure_all(lambda p: 2.0 * p)),
    "pressure offset": Fault(_pressure_offset),
    "pressure drift, one axle": Fault(_pressure_drift, 4),
    "pressure drift, single axle": Fault(_pressure_drift, 1),
    "pressure delayed": Fault(_pressure_late),
    "pressure delayed, one axle": Fault(_one_late, 4),
    "pressure stuck": Fault(_pressure_stuck),
    "pressure lost": Fault(_pressure_lost),
    "pressure saturated": Fault(_pressure_saturated),
    "pressure outliers": Fault(_pressure_spikes),
    "pressure scale changes": Fault(_pressure_steps),
    "pressure scale, one axle": Fault(_one_scale, 4),
    "pressures swapped": Fault(_pressure_swapped, 4),
    "pressure in MPa": Fault(_unit("pressure", 0.1)),
    "pressure in psi": Fault(_unit("pressure", 14.5038)),
    "wheel speed stuck": Fault(_wheel_stuck, seen=_OF_SPEED),
    "wheel speed lost": Fault(_wheel_zero, seen=_OF_SPEED),
    "wheel speed outliers": Fault(_wheel_spikes, seen=_OF_SPEED),
    "wheel speed drifts": Fault(_wheel_drift, 4, seen=_OF_SPEED),
    "wheel speed saturated": Fault(_wheel_saturated, seen=_OF_SPEED),
    "wheel diameter 5 %": Fault(_wheel_diameter, 4, seen=_OF_SPEED),
    "wheel diameter 5 %, train speed": Fault(_wheel_diameter, 1, True, _OF_SPEED),
    "wheel speeds swapped": Fault(_wheel_swapped, 4, seen=_OF_SPEED),
    "wheel speed in m/s": Fault(_unit("wheel", 1.0 / 3.6), seen=_OF_SPEED),
    "train speed delayed": Fault(_train_late, train=True, seen=_OF_TRAIN),
    "train speed offset": Fault(_train_offset, train=True, seen=_OF_TRAIN),
    "train speed stuck": Fault(_train_stuck, train=True, seen=_OF_TRAIN),
    "train speed outliers": Fault(_train_spikes, train=True, seen=_OF_TRAIN),
    "train speed in m/s": Fault(_unit("train", 1.0 / 3.6), train=True, seen=_OF_TRAIN),
    "axle mass x0.5": Fault(_stated_wrong("axle_mass", 0.5)),
    "axle mass x2": Fault(_stated_wrong("axle_mass", 2.0)),
    "friction x1.5": Fault(_stated_wrong("friction", 1.5)),
}


# Judging


class Verdict(NamedTuple):
    """What one log gets."""

    kind: str  # of fault, "" for a sound log
    seed: int
    codes: tuple[str, ...]  # of warnings and errors, each once
    said: tuple[str, ...]  # the same with the channel and the message
    found: bool


def log_of(test: Test, folder: Path) -> Path:
    """The test as a log in this folder."""
    path = folder / "log.csv"
    columns: dict[str, Any] = {"time [s]": np.round(test.t, 6)}
    for i in range(len(test.wheel)):
        columns[f"bc_pressure_{i + 1} [bar]"] = test.pressure[i]
        columns[f"wheel_speed_{i + 1} [km/h]"] = np.round(test.wheel[i], 6)
    if test.train is not None:
        columns["train_speed [km/h]"] = pa.array(test.train, from_pandas=True)
    csv.write_csv(pa.table(columns), path)
    return path


def reported(test: Test, folder: Path) -> list[Finding]:
    """What reading, records and checks report of a test."""
    path = log_of(test, folder)
    try:
        log = read(open_source(path, ReadOptions()), (), test.vehicle)
        findings = prepare(log, test.vehicle).findings
    except UserError as error:
        return [
            Finding("not-analysable", "error", names={"reason": error.text, "hint": error.hint})
        ]
    return [*log.findings, *findings]


def drawn(kind: str, seed: int) -> Test:
    """The test of this seed, with a fault of this kind."""
    rng = np.random.default_rng([seed, *kind.encode()])  # adding a kind changes no other
    if not kind:
        return simulated(rng)
    fault = FAULTS[kind]
    test = simulated(rng, fault.axles, fault.train)
    while "swapped" in kind and not test.slides:  # axles that roll alike cannot tell
        test = simulated(rng, fault.axles, fault.train)
    fault.make(test, rng)
    return test


def judged(case: tuple[str, int]) -> Verdict:
    """One log, drawn and checked."""
    kind, seed = case
    with tempfile.TemporaryDirectory() as where:
        findings = reported(drawn(kind, seed), Path(where))
    counted = [f for f in findings if f.severity != "info" and f.code not in LAYOUT]
    codes = tuple(sorted({f.code for f in counted}))
    seen = (*FAULTS[kind].seen.split(), "not-analysable", "interleaved") if kind else ()
    said = tuple(f"{f.code}: {f.channel}: {f.message}" for f in counted)
    return Verdict(kind, seed, codes, said, bool(seen) and any(c.startswith(seen) for c in codes))


def verdicts(sound: int, faults: int, seed: int, jobs: int) -> Iterator[Verdict]:
    """Of so many sound logs, and of so many of each kind of fault."""
    cases = [("", seed + i) for i in range(sound)]
    cases += [(kind, seed + i) for kind in FAULTS for i in range(faults)]
    if jobs == 1:
        yield from map(judged, cases)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(judged, cases, chunksize=4)


def _alone(v: Verdict, code: str) -> bool:
    seen = (*FAULTS[v.kind].seen.split(), "not-analysable", "interleaved")
    return v.found and [c for c in v.codes if c.startswith(seen)] == [code]


def table(found: list[Verdict]) -> str:
    """The scorecard as Markdown."""
    sound, faulty = [v for v in found if not v.kind], [v for v in found if v.kind]
    accused, caught = sum(bool(v.codes) for v in sound), sum(v.found for v in faulty)
    lines = []
    if sound:
        share = 100.0 * accused / len(sound)
        lines.append(f"- Sound logs accused: {accused} of {len(sound)} ({share:.1f} %).")
    if faulty:
        share = 100.0 * caught / len(faulty)
        lines.append(f"- Faults found: {caught} of {len(faulty)} ({share:.1f} %).")
    lines += ["", "| code | faults found | found by it alone | sound logs accused |"]
    lines += ["|---|---:|---:|---:|"]
    on_sound = Counter(c for v in sound for c in v.codes)
    on_faulty = Counter(c for v in faulty if v.found for c in v.codes)
    alone = Counter(c for v in faulty for c in v.codes if _alone(v, c))
    for code in sorted(on_sound | on_faulty, key=lambda c: (-alone[c], -on_faulty[c], c)):
        lines.append(f"| `{code}` | {on_faulty[code]} | {alone[code]} | {on_sound[code]} |")
    lines += ["", "| fault | found |", "|---|---:|"]
    by_kind = defaultdict(list)
    for v in faulty:
        by_kind[v.kind].append(v.found)
    lines += [f"| {kind} | {sum(x)} of {len(x)} |" for kind, x in by_kind.items()]
    return "\n".join(lines)


def write_between(mark: tuple[str, str], text: str) -> None:
    """Puts a text between two marks of the page on validation."""
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(mark[0])
    _, _, tail = rest.partition(mark[1])
    PAGE.write_text(f"{head}{mark[0]}\n{text}\n{mark[1]}{tail}", encoding="utf-8")


def main() -> None:
    """Print the scorecard."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sound", type=int, default=300, help="sound logs")
    parser.add_argument("--faults", type=int, default=8, help="logs of each kind of fault")
    parser.add_argument("--seed", type=int, default=HELD_OUT)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    parser.add_argument("--list", action="store_true", help="list accused and missed logs")
    options = parser.parse_args()
    found = list(verdicts(options.sound, options.faults, options.seed, options.jobs))
    if options.list:
        for v in found:
            if bool(v.codes) if not v.kind else not v.found:
                print(f"[{v.kind or 'sound'} {v.seed}]", *v.said, sep="\n    ", file=sys.stderr)
    text = table(found)
    with contextlib.suppress(BrokenPipeError):
        print(text)
    if options.write:
        write_between(MARK, text)


if __name__ == "__main__":
    main()
