"""Expanded uncertainties of stops hold the truth as often as they say, over drawn sensors."""

import math

import numpy as np
import pytest

from adhesion_cli.core.model import Parameter
from adhesion_cli.core.physics import G
from adhesion_cli.core.summary import StopSummary
from adhesion_cli.stops.find import find_brakings
from adhesion_cli.stops.measure import ToLevel, measure_stop
from adhesion_cli.stops.settings import StopSettings
from adhesion_cli.stops.signals import StopSignals, TimeSeries

STEP = 0.002
RHO = 1.06
SCALE, LATE, UPHILL = 0.005, 0.05, 3.0  # 1 sigma, as the program takes them: -, s, ‰


def drawn_stop(rng: np.random.Generator) -> tuple[list[StopSummary], dict[str, float]]:
    """The stops of a drawn log, and the truth of its one stop."""
    v0, level = rng.uniform(8.0, 55.0), rng.uniform(0.4, 2.0)
    climb = G * rng.normal(0.0, UPHILL) / 1000.0 / RHO
    dead, build_up = rng.uniform(0.1, 1.0), rng.uniform(0.4, 5.0)
    on = 10.0 + rng.uniform(0.0, 1.0)
    t = np.arange(0.0, on + v0 / level * 1.2 + build_up + 15.0, STEP)
    since = np.maximum(t - on - dead, 0.0)
    if rng.random() < 0.5:
        share = np.clip(since / build_up, 0.0, 1.0)
        times = [dead + x * build_up for x in (0.1, 0.95)]
    else:
        share = 1.0 - np.exp(-3.0 * since / build_up)
        times = [dead - build_up / 3.0 * math.log(1.0 - x) for x in (0.1, 0.95)]
    v = v0 - np.cumsum(np.where(t < on, 0.0, level * share + climb)) * STEP
    v = np.maximum(v, 0.0)
    response = sum(times) / 2.0
    distance = float(np.trapezoid(v[t >= on], t[t >= on]))
    truth = {
        "initial_speed_mps": v0,
        "distance_m": distance,
        "duration_s": float(t[np.argmax(v <= 0.0)]) - on,
        "delay_s": times[0],
        "response_time_s": response,
        "mean_deceleration": v0**2 / (2.0 * distance),
        "equivalent_deceleration": v0**2 / (2.0 * (distance - v0 * response)),
    }
    rate, step = float(rng.choice([10, 20, 50, 100])), rng.choice([0.001, 0.1 / 3.6])
    samples = np.arange(0.0, t[-1], 1.0 / rate)
    speed = np.interp(samples - rng.normal(0.0, LATE), t, v)
    noise = rng.normal(0.0, rng.choice([0.01, 0.05, 0.1]), len(samples)) * (speed > 0.3)
    speed = np.maximum(step * np.round((speed * (1.0 + rng.normal(0.0, SCALE)) + noise) / step), 0)
    pressure = 3e5 * np.interp(samples, t, share) + rng.normal(0.0, 500.0, len(samples))
    pressure = 1e3 * np.round(pressure / 1e3)
    commands = {"brake_command": [TimeSeries(samples, (samples >= on) * 1.0)]}
    brakes = {1: TimeSeries(samples, pressure)}
    signals = StopSignals(TimeSeries(samples, speed), "train", SCALE, LATE, {}, brakes, commands)
    to_level = ToLevel(Parameter(0.0, UPHILL), RHO)
    stops = [measure_stop(signals, b, to_level, StopSettings()) for b in find_brakings(signals)]
    return stops, truth


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    rng = np.random.default_rng(7)
    inside: dict[str, list[bool]] = {}
    for _ in range(300):
        (stop,), truth = drawn_stop(rng)
        assert stop.valid
        for name, value in truth.items():
            if measured := getattr(stop, name):
                inside.setdefault(name, []).append(abs(measured.value - value) <= measured.u95)
    shares = {name: np.mean(x) for name, x in inside.items()}
    assert all(len(x) > 290 for x in inside.values())
    assert min(shares.values()) > 0.92, shares
