"""Time and memory of an hour of one wheelset at 1 kHz, and the rate beside scipy's Radau.

    python benchmarks/simulate.py

The hour is the scenario `service-brake` going on at walking pace, every sensor at 1 kHz. The rival
integrates the same equations (1) (3) for the paper's varying condition to the same error of
ω, found against a run with a hundredth of the step: scipy's stiff method with the compiled creep
force, its tolerance the widest that is as good.
"""

import math
import resource
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp
from table import Row, show

from adhesion_cli.core import compiled, physics
from adhesion_cli.rail import creep_law
from adhesion_cli.wsp import simulate


def hour() -> None:
    scenario = simulate.load("service-brake")
    sensors = tuple(replace(x, rate=1000.0) for x in scenario.sensor)
    scenario = replace(scenario, duration=3600.0, sensor=sensors)
    simulate.run(replace(scenario, duration=1.0))  # compiles
    begin = time.perf_counter()
    simulation = simulate.run(scenario)
    solved = time.perf_counter()
    log = simulate.as_log(simulation)
    sensed = time.perf_counter()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(
        f"1 h at 1 kHz: {solved - begin:.1f} s to solve, {sensed - solved:.1f} s for "
        f"{log.rows_read / 1e6:.1f} million samples of the sensors, {peak:.0f} MB at most"
    )


def rows() -> Iterator[Row]:
    scenario = simulate.load("paper-varying")
    vehicle = scenario.vehicle
    R, I = vehicle.radius(1).value, vehicle.wheelset_inertia.value  # noqa: E741
    m, phi_k = vehicle.axle_mass.value, vehicle.friction.value * 21e3
    patch, law = scenario.contact.patch(m * physics.G), creep_law.condition("wet")
    force = compiled.function(creep_law.creep_force)

    def right_side(at: float, state: np.ndarray) -> tuple[float, float]:
        v, omega = state
        f0 = law.f0 * 0.6 * (1.0 + 0.35 * math.sin(math.pi * at))
        F, _ = force(v - omega * R, v, law._replace(f0=f0), patch)
        return -F / m, (F - phi_k) * R / I  # (1)

    exact = simulate.run(scenario, dt=1e-5)
    ours = simulate.run(scenario)

    def error(omega: np.ndarray) -> float:
        return float(np.abs(omega - exact.wheel_speed[::100, 0]).max())

    simulate.run(scenario)
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        simulate.run(scenario)
        times.append(time.perf_counter() - begin)
    t = ours.t * 1e-9
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9):
        begin = time.perf_counter()
        solution = solve_ivp(
            right_side, (0.0, t[-1]), (20.0, 20.0 / R), "Radau", t, rtol=tolerance, atol=tolerance
        )
        taken = time.perf_counter() - begin
        if (theirs := error(solution.y[1])) <= error(ours.wheel_speed[:, 0]):
            break
    against = f"scipy's Radau, as good to {theirs:.1g} rad/s"
    yield Row("simulate 10 s, varying adhesion", min(times) * 1e3, taken * 1e3, "ms", against)


if __name__ == "__main__":
    hour()
    show(rows())
