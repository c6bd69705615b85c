"""A synthetic analysed log: four axles, a slide on axle 2, a gap, known truth. Not a simulation."""

from pathlib import Path

import numpy as np

from adhesion_cli.core import physics
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import (
    AxleRecord,
    AxleResult,
    Channel,
    Column,
    Floats,
    IdentifiedVehicle,
    Log,
    Reference,
    Result,
    Score,
    Vehicle,
)

EPOCH = 1_760_000_000 * 10**9  # October 2025


def axle_result(axle: int, n: int, rate: float, start: int) -> AxleResult:
    vehicle, rng = Vehicle(), np.random.default_rng(axle)
    seconds = np.arange(n) / rate
    t = start + np.round(seconds * 1e9).astype(np.int64)
    end = seconds[-1]
    gap = slice(int(0.55 * n), int(0.58 * n))
    on, off = 0.05 * end, 0.9 * end
    pressure = (
        2.6e5 * np.clip((seconds - on) / 2.0, 0, 1) * (1 - np.clip((seconds - off) / 1.5, 0, 1))
    )
    K = physics.clamping_force(pressure, vehicle)
    slide = 0.5 + 0.5 * np.tanh(2 * (seconds - 0.3 * end)) * np.tanh(2 * (0.42 * end - seconds))
    rolling = physics.wheelset(vehicle, axle).rolling * vehicle.friction.value * K
    truth = rolling * (1 - 0.55 * slide * (axle == 2))
    v = np.maximum(30.0 - np.cumsum(rolling) / vehicle.axle_mass.value / rate, 0.0)
    s = 0.001 + 0.002 * truth / 5000 + 0.12 * slide * (axle == 2) + rng.normal(0, 1e-4, n)
    wheel_speed = v * (1 - s) / vehicle.radius(axle).value
    sigma = 25 + 60 * slide * (axle == 2)
    force = truth + rng.normal(0, 1, n) * sigma / 3
    estimates = {
        algo: truth + rng.normal(0, noise, n) - lag * np.gradient(truth, 1 / rate)
        for algo, noise, lag in (
            ("gradient", 30, 0.4), ("kalman", 90, 0.1), ("leso", 10, 0.9), ("neso", 20, 0.25),
            ("td", 120, 0.15),
        )
    }  # fmt: skip
    for column in (force, K, *estimates.values()):
        column[gap] = np.nan
    record = AxleRecord(
        axle, t, K, K, wheel_speed, (slice(0, gap.start), slice(gap.stop, n)),
        pressure=pressure, train_speed=v, truth=truth, true_slip=s,
    )  # fmt: skip
    reference = Reference("rts", "Rauch, Tung, Striebel 1965", force, sigma, 0.1 * np.abs(force))
    scores = []
    for algo, estimate in estimates.items():
        e = estimate - truth
        scores.append(
            Score(
                algo,
                "truth",
                float(np.sqrt(np.nanmean(e**2))),
                float(np.nanmean(e)),
                float(e[np.nanargmax(np.abs(e))]),
                0.2,
                0.98,
                None,
                1.0,
            )
        )
    best = min(s.rmse_n for s in scores)
    scores = [
        s.__class__(**{f: getattr(s, f) for f in s.__slots__} | {"relative": s.rmse_n / best})
        for s in scores
    ]
    applied = slice(int(on * rate), min(n, int((off + 1.5) * rate)))
    return AxleResult(
        record, reference, estimates, tuple(scores), (applied,),
        slip=np.where(v > 1.0, s, np.nan),
    )  # fmt: skip


def result(
    axles: int = 4, n: int = 6000, rate: float = 100.0, start: int = EPOCH, name: str = "stop.csv"
) -> Result:
    computed = tuple(axle_result(a, n, rate, start) for a in range(1, axles + 1))
    channels = tuple(
        Channel(
            f"speed {a.record.axle}", "", "wheel_speed", a.record.axle, "km/h", "name",
            Column(a.record.t, a.record.wheel_speed, np.isfinite(a.record.wheel_speed)),
        )
        for a in computed
    )  # fmt: skip
    findings = (
        Finding(
            "gap",
            "warning",
            "speed 2",
            spans=((0.55 * n / rate, 0.55 * n / rate + 1.8),),
            values={"longest_s": 1.8, "limit_s": 2.0},
        ),
        Finding("no-application", "info", "speed 1"),
    )
    log = Log(str(Path("logs") / name), "csv", "0" * 64, start >= EPOCH, n, channels, findings)
    settings = {
        "reference": "rts",
        "neso": {"beta1": 216.0, "beta2": 216.0, "delta": 0.02},
        "vehicle": {"friction": 0.3, "wheel_radius": [0.42]},
    }
    sources = (
        "Wu, Peng, Li: Online estimation algorithm of adhesive force for train wheel-track",
        "Rauch, Tung, Striebel: Maximum likelihood estimates of linear dynamic systems, 1965",
    )
    identified = IdentifiedVehicle(Vehicle(), "stated", None)
    return Result(log, identified, computed, findings, settings, sources)


def near(written: Floats, values: Floats, within: Floats | float) -> None:
    """Asserts that numbers of a file are those of a result, but for what is rounded away."""
    np.testing.assert_array_equal(np.isnan(written), np.isnan(values))
    assert (np.nan_to_num(np.abs(written - values)) <= within).all()
