"""Logs of simulated brakes as CSV, the sensors varied; truth is known."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from adhesion_cli import simulate
from adhesion_cli.scenario import Scenario, Sensor
from adhesion_cli.simulate import Recording


@cache
def simulation(name: str, train: float = 0.0) -> simulate.Simulation:
    """A bundled scenario; its train starts at another speed [m/s] if one is given."""
    s = simulate.load(name)
    if train:
        s = replace(s, train=replace(s.train, speed=train))
    return simulate.run(s)


def recordings(
    name: str, *, seed: int = 1, rate: float = 0.0, noise: float | None = None,
    kmh: float = 0.0, train: bool | None = None, **sensor: float,
) -> list[Recording]:  # fmt: skip
    """What the scenario's loggers write, with other rates, noise, steps or train speed."""
    true = simulation(name)

    def varied(s: Sensor) -> Sensor:
        if rate:
            own = min(rate, s.rate) if s.signal == "train_speed" else rate
            s = replace(s, rate=own, jitter=0.0)
        if s.signal == "wheel_speed":
            if kmh:
                s = replace(s, unit="km/h", resolution=kmh, teeth=0)
            if noise is not None:
                s = replace(s, noise_variance=noise, teeth=0)
        return s

    sensors = [varied(s) for s in true.scenario.sensor if train is not False or s.signal != "train_speed"]
    if train and not any(s.signal == "train_speed" for s in sensors):
        sensors.append(
            Sensor("train_speed", "km/h", min(rate or 10.0, 10.0), noise_variance=1e-4)
        )
    scenario: Scenario = replace(true.scenario, sensor=tuple(sensors))
    return simulate.log(replace(true, scenario=scenario, seed=seed))


def write(path: Path, recordings: list[Recording], unit: str = "s") -> Path:
    """A CSV with one row per time stamp, a cell empty where a channel has no sample."""
    times = np.unique(np.concatenate([r.t for r in recordings]))
    columns = []
    for r in recordings:
        cells = np.full(len(times), "", dtype=object)
        cells[np.searchsorted(times, r.t)] = r.texts()
        columns.append(cells)
    head = ",".join([f"time [{unit}]", *(f"{r.name} [{r.unit or '-'}]" for r in recordings)])
    rows = (f"{t / 1e9:.6f}," + ",".join(row) for t, *row in zip(times.tolist(), *columns))
    path.write_text("\n".join([head, *rows]) + "\n")
    return path
