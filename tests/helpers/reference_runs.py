"""Runs of the reference, and how it does."""

import math

import numpy as np

from adhesion_cli.core import physics
from adhesion_cli.core.model import (
    AxleRecord,
    Bools,
    Floats,
    Reference,
    Vehicle,
)
from helpers import simulated

VEHICLE = Vehicle()


def logged(
    name: str, rate: float, *, axle: int = 1, seed: int = 1, noise: float = 1e-5, kmh: float = 0.0,
    teeth: int = 0, pressure_noise: float = 0.0, pressure_step: float = 0.0,
    pressure_rate: float = 0.0, jitter: float = 0.0, vehicle: Vehicle = VEHICLE,
) -> tuple[AxleRecord, Bools]:  # fmt: skip
    """One axle of a simulation as sensors see it, and where it slides.

    The record's truth is φK + ω̇/a of the noiseless signals and the given vehicle: what a
    reference can know.
    """
    true = simulated.simulation(name)
    random = np.random.default_rng(seed)
    dense, j = true.t * 1e-9, axle - 1
    R = vehicle.radius(axle).value
    t = np.arange(0.0, dense[-1], 1.0 / rate)
    t[1:-1] += random.uniform(-jitter, jitter, len(t) - 2) / rate
    speed = np.interp(t, dense, true.wheel_speed[:, j])
    step = 0.0
    if teeth:
        turned = np.cumsum(true.wheel_speed[:, j]) * dense[1]
        pulses = np.floor(np.interp(t, dense, turned) * teeth / (2.0 * math.pi))
        y = np.diff(pulses, prepend=np.nan) * 2.0 * math.pi / teeth * rate
        y[0] = y[1]
        step = 2.0 * math.pi / teeth * rate
    else:
        y = speed + random.normal(0.0, math.sqrt(noise), len(t)) * (speed > 0.0)
    if kmh:
        step = kmh / 3.6 / R
        y = np.round(y / step) * step
    own = t if not pressure_rate else np.arange(0.0, dense[-1], 1.0 / pressure_rate)
    p = np.interp(own, dense, true.pressure[:, j]) + random.normal(0, 1, len(own)) * pressure_noise
    if pressure_step:
        p = np.round(p / pressure_step) * pressure_step
    K = physics.clamping_force(p, vehicle)
    last = np.searchsorted(own, t + 1e-9) - 1
    phi = physics.wheelset(vehicle, axle).phi
    I = vehicle.wheelset_inertia.value  # noqa: E741
    acceleration = (true.adhesion_force - simulated.friction_force(true))[:, j] * physics.wheelset(
        true.scenario.vehicle, axle
    ).a
    F = phi * physics.clamping_force(true.pressure[:, j], vehicle) + I / R * acceleration
    record = AxleRecord(
        axle, np.round(t * 1e9).astype(np.int64), K[last], np.interp(t, own, K), y,
        (slice(0, len(t)),), step, pressure=p[last], truth=np.interp(t, dense, F),
        clamping_force_step=pressure_step * 0.0256,
    )  # fmt: skip
    v = np.interp(t, dense, true.train_speed)
    return record, np.abs(v - speed * true.scenario.vehicle.radius(axle).value) > 0.012 * v


def rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2)))


def best_butterworth(record: AxleRecord, used: Bools) -> float:
    """RMSE of the best zero-phase Butterworth there is, chosen knowing the truth.

    It may filter ω̇ alone and leave φK as it is, or F as a whole.
    """
    from scipy.signal import butter, sosfiltfilt

    assert record.truth is not None
    w = physics.wheelset(VEHICLE, record.axle)
    t = record.t * 1e-9
    even = np.linspace(t[0], t[-1], len(t))
    rate = (len(t) - 1) / (t[-1] - t[0])
    speed, pressed = (
        np.interp(even, t, x) for x in (record.wheel_speed, w.phi * record.clamping_force_smooth)
    )
    best = math.inf
    for cutoff in np.geomspace(0.05, 0.45 * rate, 30):
        pad = min(len(t) - 1, int(3.0 * rate / cutoff))
        for order in (1, 2, 4):
            sos = butter(order, cutoff, fs=rate, output="sos")
            slow = np.gradient(sosfiltfilt(sos, speed, padlen=pad), 1.0 / rate)
            whole = pressed + np.gradient(speed, 1.0 / rate) / w.a
            for F in (pressed + slow / w.a, sosfiltfilt(sos, whole, padlen=pad)):
                best = min(best, rms((np.interp(t, even, F) - record.truth)[used]))
    return best


ROLLING = {
    "1 Hz": {"rate": 1.0},
    "10 Hz": {"rate": 10.0},
    "50 Hz": {"rate": 50.0},
    "100 Hz": {"rate": 100.0},
    "200 Hz": {"rate": 200.0},
    "irregular": {"rate": 100.0, "jitter": 0.4},
    "0.1 km/h steps": {"rate": 50.0, "kmh": 0.1},
    "pulse counter": {"rate": 20.0, "teeth": 200},
    "noisy pressure": {"rate": 100.0, "pressure_noise": 1000.0, "pressure_step": 1000.0},
    "coarse pressure": {"rate": 100.0, "pressure_noise": 300.0, "pressure_step": 5000.0},
    "slow pressure": {"rate": 100.0, "pressure_noise": 500.0, "pressure_rate": 10.0},
    "1 km/h steps at 10 Hz": {"rate": 10.0, "kmh": 1.0},
    "1 km/h steps at 100 Hz": {"rate": 100.0, "kmh": 1.0},
    "1 km/h steps and noise": {"rate": 100.0, "kmh": 1.0, "noise": 1e-3},
    "fast pulse counter": {"rate": 100.0, "teeth": 80},
}


SLIDING = {
    "20 Hz": {"rate": 20.0, "pressure_noise": 500.0},
    "100 Hz": {"rate": 100.0, "pressure_noise": 500.0},
    "200 Hz": {"rate": 200.0},
    "0.1 km/h steps": {"rate": 50.0, "kmh": 0.1, "pressure_noise": 1000.0},
    "slow pressure": {
        "rate": 50.0, "pressure_rate": 25.0, "pressure_noise": 1000.0, "pressure_step": 1000.0,
    },
}  # fmt: skip


HARD = {
    "0.1 km/h steps at 1 kHz": {"rate": 1000.0, "kmh": 0.1},
    "pressure at 1 Hz": {"rate": 50.0, "pressure_noise": 500.0, "pressure_rate": 1.0},
}


HARD_SLIDING = {
    "1 km/h steps at 50 Hz": {"rate": 50.0, "kmh": 1.0, "pressure_noise": 300.0},
    "1 km/h steps at 100 Hz": {"rate": 100.0, "kmh": 1.0, "pressure_noise": 300.0},
    "0.5 km/h steps at 200 Hz": {"rate": 200.0, "kmh": 0.5, "pressure_noise": 300.0},
}


def share_inside(F: Reference, truth: Floats, used: Bools) -> float:
    return float(np.mean((np.abs(F.force - truth) < 1.96 * F.sigma)[used]))
