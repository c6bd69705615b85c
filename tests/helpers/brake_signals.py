"""Signals of a brake for the estimators."""

import numpy as np

from adhesion_cli.core import estimator
from adhesion_cli.core.model import AxleRecord, Vehicle
from adhesion_cli.core.physics import clamping_force, wheelset
from adhesion_cli.wsp import scenario, simulate

W = wheelset(Vehicle(), 1)


REGISTRY = estimator.registry()


STEADY = W.rolling * W.phi * 21e3  # 5378 N


def rolling_brake(t, ramp=2.5, y0=20 / 0.42):
    """Exact signals of (1) without slip: 2 s coasting, K to 21 kN along `ramp` [s], then held."""
    x = np.clip((t - 2.0) / ramp, 0.0, None)
    K = 21e3 * np.minimum(x, 1.0)
    impulse = 21e3 * ramp * np.where(x < 1.0, 0.5 * x**2, x - 0.5)
    return K, y0 - W.a * W.phi * (1.0 - W.rolling) * impulse, W.rolling * W.phi * K


def simulated(name, seed):
    """The record of every axle of a bundled scenario, as its sensors give it, with the truth."""
    simulation = simulate.run(scenario.load(name), seed=seed)
    vehicle = simulation.scenario.vehicle
    log = {(r.signal, r.axle): r for r in simulate.log(simulation)}
    for axle in range(1, simulation.scenario.train.axles + 1):
        speed, pressure = log["wheel_speed", axle], log["pressure", axle]
        held = pressure.value[np.searchsorted(pressure.t, speed.t, side="right") - 1]
        K = clamping_force(held * 1e5, vehicle)
        yield AxleRecord(
            axle, speed.t, K, K, speed.value / 3.6 / vehicle.radius(axle).value,
            (slice(0, len(speed.t)),),
            truth=np.interp(speed.t, simulation.t, simulation.signal("truth", axle)),
        )  # fmt: skip


def online(est, p, samples):
    """F̂ [N] after each (time [ns], K [N], y [rad/s]), as they arrive."""
    state, previous = None, 0
    for t, K, y in samples:
        state = estimator.advance(est, p, W, state, (t - previous) * 1e-9, K, y)
        previous = t
        yield state.F
