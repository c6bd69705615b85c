"""Run-out of a tone ring: a speed error that repeats with every turn of the wheel.

An eccentric or uneven ring reads ω (1 + A sin(θ − θ0)) with θ = ∫ω dt. At 0.1 % and nine turns a
second that is an apparent acceleration of 3 rad/s². Its phase identifies it: noise, brakes and
slides do not follow the angle. The part of ω faster than a turn is fitted to ω sin θ and ω cos θ by
least squares. The sums over half a second each give their error, for any kind of noise.
"""

import numpy as np

from ..core.model import Floats
from ..core.signals import running_integral

_ROUNDING = 1e-7  # a smaller variation is rounding of the numbers [rad/s]
_STRETCH = 300.0  # seconds fitted together
_BLOCK = 0.5  # seconds whose errors may be correlated
_FEWEST_BLOCKS = 16  # least blocks that show an error
_CERTAIN_SIGMAS = 8.0  # least sigma by which the share differs from 0
_DIAMETER = 0.02  # possible error of the wheel diameter by which km/h became turns
_ANGLE_STEP = 0.1  # of a turn at the end of a stretch: step of the search for the diameter


def find_run_out(t: Floats, y: Floats) -> tuple[Floats, float]:
    """The run-out in a wheel speed, and its largest share A; 0 where it is not certain.

    Times [s] and speeds [rad/s] are those of an uninterrupted run, shape (n,). The run-out is the
    part of y [rad/s], shape (n,).
    """
    run_out_speed, largest = np.zeros(len(t)), 0.0
    count = max(1, round((t[-1] - t[0]) / _STRETCH))
    edges = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], count + 1)[1:-1]))
    for s in np.split(np.arange(len(t)), edges):
        run_out_speed[s], share = _fit_stretch(t[s] - t[s[0]], y[s])
        largest = max(largest, share)
    return run_out_speed, largest


def _fit_stretch(t: Floats, y: Floats) -> tuple[Floats, float]:
    block = (t / _BLOCK).astype(int)
    no_run_out = np.zeros(len(t)), 0.0
    h = np.diff(t)
    if block[-1] + 1 < _FEWEST_BLOCKS or np.median(h) > _BLOCK / 4.0 or not y.any():
        return no_run_out
    angle = running_integral(t, y)
    width = 2 * max(1, round(0.125 / float(np.median(h)))) + 1
    fast = _fast(y, width)
    energy = np.bincount(block, fast**2) / np.maximum(np.bincount(block), 1)
    if np.median(energy) < _ROUNDING**2:
        return no_run_out
    weight = 1.0 / (energy + np.median(energy) + 1e-12)[block]  # slides count less

    # The radius by which km/h became rad/s may be wrong: take the turns that explain most.
    wave = _fast(y * np.sin(angle), width) + 1j * _fast(y * np.cos(angle), width)
    score = np.zeros(block[-1] + 1, complex)
    np.add.at(score, block, wave * fast * weight)
    middle = np.interp((np.arange(len(score)) + 0.5) * _BLOCK, t, angle)
    steps = int(_DIAMETER * angle[-1] / (2.0 * np.pi * _ANGLE_STEP)) + 1
    radius_errors = np.linspace(-_DIAMETER, _DIAMETER, 2 * steps + 1)
    likely = np.abs(np.exp(-1j * np.outer(radius_errors, middle)) @ score)
    angle *= 1.0 + radius_errors[np.argmax(likely)]

    waves = np.stack([y * np.sin(angle), y * np.cos(angle)])
    X = np.stack([_fast(x, width) for x in waves])
    normal = weight * X @ X.T
    c = np.linalg.pinv(normal) @ X @ (weight * fast)
    error_sums = np.stack([np.bincount(block, x * weight * (fast - c @ X)) for x in X])
    distance = normal @ c  # in units of the sums
    if distance @ np.linalg.pinv(error_sums @ error_sums.T) @ distance < _CERTAIN_SIGMAS**2:
        return no_run_out
    run_out_speed: Floats = c @ waves
    return run_out_speed, float(np.hypot(*c))


def _fast(x: Floats, width: int) -> Floats:
    """The difference of x and its moving mean over `width` samples, taken twice; shape (n,)."""
    return x - _mean(_mean(x, width), width)


def _mean(x: Floats, width: int) -> Floats:
    half_width = width // 2
    total = np.concatenate([[0.0], np.cumsum(np.pad(x, half_width, mode="edge"))])
    mean: Floats = (total[width:] - total[:-width]) / width
    return mean
