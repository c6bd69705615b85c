"""Logs as tables: one train in a stop; three trains as one operator publishes them."""

import random

START = 1_722_520_000  # s since 1970
_STEPS = (0, 10, 20, 30, 40, 51, 61, 71, 81, 91, 101, 172)
_SPEED = (95.1, 97.4, 98.7, 93.8, 84.3, 74.8, 64.2, 50.4, 14.6, 14.6, 14.6, 0.1)  # km/h, of train 5
_PRESSURE = (0.01, 0.0, 0.01, 0.95, 0.92, 1.07, 1.06, 1.58, 1.04, 0.95, 0.93, 0.91)  # bar, axle 1


def three_trains() -> str:
    """Three trains, no header, a row every 10 s.

    Seconds and train in columns 1 and 2; pressures [bar] in 6 and 7, speed [km/h] in 12.
    """
    lines = []
    for step, speed, pressure in zip(_STEPS, _SPEED, _PRESSURE, strict=True):
        other = (29.4, 4.4, 1.5, 0.0, 1.3, 46.2, 4.5, 0.0, 1296.0, 0.03, 50.6)
        second = round(0.9 * pressure, 3)
        braking = (29.7, 4.5, 1.1, pressure, second, 39.8, 3.5, 0.0, 1024.0, speed, 51.3)
        for train, cells in ((3, other), (4, other), (5, braking)):
            lines.append(",".join(map(str, (START + step, train, *cells, 4.43))))
    return "\n".join(lines) + "\n"


def rows(n: int = 400, start: float = 0.0, rate: float = 50.0) -> str:
    """One axle that is braked and never slides, its sensors as a CSV log."""
    noise = random.Random(7)
    lines = ["time [s],bc pressure [bar],wheel speed [km/h]"]
    for i in range(n):
        t = i / rate
        pressure = 3.5 * min(max(t - 1.0, 0.0), 1.0)
        speed = 72.0 - 1.25 * max(t - 1.5, 0.0) + 0.002 * noise.randrange(13)
        lines.append(f"{start + t:.3f},{pressure:.3f},{speed:.4f}")
    return "\n".join(lines) + "\n"
