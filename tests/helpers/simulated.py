"""Logs of simulated brakes as CSV, with other sensors and vehicles, and faults put into them."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.units import UNITS
from adhesion_cli.formats.open import open_source
from adhesion_cli.wsp import simulate
from adhesion_cli.wsp.scenario import Sensor
from adhesion_cli.wsp.simulate import Recording

Recordings = list[Recording]


@cache
def simulation(name: str, vehicle: Vehicle | None = None) -> simulate.Simulation:
    """A bundled scenario, with another vehicle on the scenario's own wheels if one is given."""
    s = simulate.load(name)
    if vehicle:
        s = replace(s, vehicle=replace(vehicle, wheel_radius=s.vehicle.wheel_radius))
    return simulate.run(s)


def friction_force(true: simulate.Simulation) -> np.ndarray:
    """B [N]: φK while the wheel turns, what holds it (F) while it stands; ω̇ = a(F − B)."""
    phi = true.scenario.vehicle.friction.value
    return np.where(true.wheel_speed > 0.0, phi * true.clamping_force, true.adhesion_force)


def recordings(
    name: str, *, seed: int = 1, rate: float = 0.0, noise: float | None = None,
    kmh: float = 0.0, teeth: int = 0, train: bool | None = None, vehicle: Vehicle | None = None,
) -> Recordings:  # fmt: skip
    """What the scenario's loggers write.

    Args:
        name: a bundled scenario.
        seed: of the sensors' noise.
        rate: of all sensors [Hz], of a train speed at most its own; 0: the scenario's.
        noise: variance of the wheel speed's noise [rad²/s²], None: the scenario's.
        kmh: step of the wheel speed, 0: the scenario's.
        teeth: of the wheel's pulse counter, 0: the scenario's.
        train: with or without a train speed, None: as the scenario has it.
        vehicle: in place of the scenario's.
    """
    true = simulation(name, vehicle)

    def varied(s: Sensor) -> Sensor:
        if rate:
            own = min(rate, s.rate) if s.signal == "train_speed" else rate
            s = replace(s, rate=own, jitter=0.0)
        if s.signal == "wheel_speed" and kmh:
            s = replace(s, unit="km/h", resolution=kmh, teeth=0)
        if s.signal == "wheel_speed" and noise is not None:
            s = replace(s, noise_variance=noise, teeth=0)
        if s.signal == "wheel_speed" and teeth:
            s = replace(s, teeth=teeth)
        return s

    sensors = [varied(s) for s in true.scenario.sensor]
    if train is False:
        sensors = [s for s in sensors if s.signal != "train_speed"]
    if train and not any(s.signal == "train_speed" for s in sensors):
        every = min(rate or 10.0, 10.0)
        sensors.append(Sensor("train_speed", "km/h", every, noise_variance=1e-4))
    scenario = replace(true.scenario, sensor=tuple(sensors))
    return simulate.log(replace(true, scenario=scenario, seed=seed))


def write(path: Path, log: Recordings) -> Path:
    """A CSV with one row per time stamp, a cell empty where a channel has no sample."""
    times = np.unique(np.concatenate([r.t for r in log]))
    cells = np.full((len(times), len(log)), "", dtype=object)
    for column, r in zip(cells.T, log, strict=True):
        column[np.searchsorted(times, r.t)] = r.texts()
    head = ",".join(["time [s]", *(f"{r.name} [{r.unit}]" for r in log)])
    rows = (f"{t / 1e9:.6f},{','.join(row)}" for t, row in zip(times, cells, strict=True))
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def told(log: Recordings, folder: Path, stated: settings.Settings) -> list[Finding]:
    """What reading a log says of its sensors."""
    one = read(
        open_source(write(folder / "log.csv", log), stated.read), stated.mappings, stated.vehicle
    )
    return prepare(one, stated.vehicle).findings


def which(log: Recordings, signal: str, axle: int = 0) -> list[int]:
    """Places of a signal's channels in the log, of one axle only if it is given."""
    return [i for i, r in enumerate(log) if r.signal == signal and axle in (0, r.axle or 1)]


def changed(
    log: Recordings, signal: str, change: Callable[[Recording], Recording], axle: int = 0
) -> Recordings:
    """The log with some channels changed."""
    places = which(log, signal, axle)
    return [change(r) if i in places else r for i, r in enumerate(log)]


def stuck(log: Recordings, signal: str, axle: int, at: float, seconds: float) -> Recordings:
    """One sensor repeats the value it has at this time."""

    def change(r: Recording) -> Recording:
        value, t = r.value.copy(), r.t * 1e-9
        inside = (t >= at) & (t < at + seconds)
        value[inside] = value[np.argmax(inside)]
        return replace(r, value=value)

    return changed(log, signal, change, axle)


def put(
    log: Recordings, signal: str, axle: int, where: Callable[[Recording], np.ndarray], value: float
) -> Recordings:  # fmt: skip
    """Another value at some samples: a wire that comes loose, a disturbance, NaN for none."""
    return changed(
        log, signal, lambda r: replace(r, value=np.where(where(r), value, r.value)), axle
    )


def during(at: float, seconds: float) -> Callable[[Recording], np.ndarray]:
    """The samples of a time."""
    return lambda r: (r.t * 1e-9 >= at) & (r.t * 1e-9 < at + seconds)


def single(random: np.random.Generator, count: int) -> Callable[[Recording], np.ndarray]:
    """Some samples here and there."""
    return lambda r: np.isin(np.arange(len(r.t)), random.integers(0, len(r.t), count))


def scaled(log: Recordings, signal: str, axle: int, times: float, plus: float = 0.0) -> Recordings:
    """Values that many times as large, and shifted by so many SI units."""
    return changed(
        log, signal,
        lambda r: replace(r, value=times * r.value + plus / UNITS[r.unit.lower()].factor), axle,
    )  # fmt: skip


def saturated(log: Recordings, share: float) -> Recordings:
    """Pressure sensors whose range ends at this share of the highest pressure."""
    top = max(float(log[i].value.max()) for i in which(log, "pressure"))

    def change(r: Recording) -> Recording:
        return replace(r, value=np.minimum(r.value, round(share * top, r.decimals or 0)))

    return changed(log, "pressure", change)


def mislabelled(log: Recordings, signal: str, unit: str) -> Recordings:
    """The values as they are, with another unit's name."""
    return changed(log, signal, lambda r: replace(r, unit=unit))


def late(log: Recordings, signal: str, seconds: float, axle: int = 0) -> Recordings:
    """Time stamps of another clock."""
    return changed(log, signal, lambda r: replace(r, t=r.t + round(seconds * 1e9)), axle)


def pressed(
    log: Recordings, axle: int, change: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Recordings:
    """Pressures changed: their time as a share of the log's, their value as one of the highest."""

    def pressure(r: Recording) -> Recording:
        top = float(r.value.max())
        return replace(r, value=top * change(r.t / r.t[-1], r.value / top))

    return changed(log, "pressure", pressure, axle)


def worn(log: Recordings, axle: int, scale: float) -> Recordings:
    """A wheel speed that many times as large, as with another diameter."""
    exact = changed(log, "wheel_speed", lambda r: replace(r, decimals=None), axle)
    return scaled(exact, "wheel_speed", axle, scale)


def slower(log: Recordings, times: float) -> Recordings:
    """Time stamps in another unit."""
    return [replace(r, t=np.round(r.t * times).astype(np.int64)) for r in log]


def swapped(log: Recordings, one: int, other: int) -> Recordings:
    """The wheel speeds of two axles under each other's names."""
    (i,), (j,) = which(log, "wheel_speed", one), which(log, "wheel_speed", other)
    a, b = log[i], log[j]
    exchanged = {i: replace(a, t=b.t, value=b.value), j: replace(b, t=a.t, value=a.value)}
    return [exchanged.get(k, r) for k, r in enumerate(log)]
