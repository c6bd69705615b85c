"""Frequency response of an estimator, measured by running it on sines.

The input follows from the wheelset equation (1) for a force F = φK + A sin 2πft at constant K: a
wheel speed that swings by Y = aA/(2πf). The result is the harmonic of the estimate at f (harmonic
balance). For a linear estimator that is its frequency response. For another one it is its
describing function, which depends on A. F̂/Y is the gain from noise of the wheel speed at f.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core import compiled
from ..core.estimator import Estimator
from ..core.model import Floats, Wheelset

FREQUENCIES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # [Hz]
AMPLITUDES = (100.0, 1000.0, 5000.0)  # A [N]
STEP = 1e-3  # interval of the samples [s]
LINEAR = 0.01  # answers that differ less between amplitudes are one

_CLAMPING_FORCE = 21e3  # K [N]; only swings about φK are looked at
_SPEED = 50.0  # mean ω [rad/s]
_WINDOW = 2.0  # shortest time over which a harmonic is taken [s]
_SETTLED = 1e-4  # two windows that differ less are settled
_LONGEST = 400.0  # time after which it is taken as it is [s]


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """One estimator at one amplitude; None: any amplitude, it is linear. Columns over frequency."""

    algo: str
    amplitude_n: float | None
    frequency_hz: Floats
    gain: Floats  # of the force [-]
    delay_s: Floats  # of the force; unwrapped over frequency
    noise_gain: Floats  # force for a swing of the wheel speed [N/(rad/s)]


def responses(
    est: Estimator, p: Any, w: Wheelset, frequencies: Sequence[float] = FREQUENCIES
) -> list[FrequencyResponse]:
    """The response at each of `AMPLITUDES`, or a single one where they make no difference.

    The frequencies rise, below half of 1/`STEP` [Hz].
    """
    f = np.array(frequencies)
    measured = np.array([[_answer(est, p, w, x, A) / A for x in f] for A in AMPLITUDES])
    difference = float(np.max(np.abs(np.diff(measured, axis=0)) / np.abs(measured[1:]).clip(1e-9)))
    amplitudes: Sequence[float | None] = AMPLITUDES if difference > LINEAR else (None,)
    gain, delay = np.abs(measured), -np.unwrap(np.angle(measured)) / (2.0 * math.pi * f)
    noise_gain = gain * 2.0 * math.pi * f / w.a
    return [
        FrequencyResponse(est.name, A, f, gain[i], delay[i], noise_gain[i])
        for i, A in enumerate(amplitudes)
    ]


def harmonic(t: Floats, x: Floats, frequency: float) -> complex:
    """Amplitude and phase of x at a frequency, as those of sin 2πft; whole periods, shape (n,).

    Least squares, together with a mean and a slope.
    """
    angle = 2.0 * math.pi * frequency * t
    columns = np.stack([np.sin(angle), np.cos(angle), np.ones_like(t), t - np.mean(t)], axis=1)
    sine, cosine, _, _ = np.linalg.solve(columns.T @ columns, columns.T @ x)
    return complex(float(sine), float(cosine))


def _answer(est: Estimator, p: Any, w: Wheelset, f: float, A: float) -> complex:
    """Harmonic of F̂ at f once two windows in a row agree [N]."""
    window = math.ceil(_WINDOW * f) / f  # whole periods
    n = round(window / STEP)
    windows = 8
    while True:
        t: Floats = np.arange(windows * n + 1) * np.float64(STEP)
        y = _SPEED - w.a * A / (2.0 * math.pi * f) * np.cos(2.0 * math.pi * f * t)  # (1)
        K = np.full_like(t, _CLAMPING_FORCE)
        F = compiled.batch(est, p, w, np.round(t * 1e9).astype(np.int64), K, y, np.zeros(1, int))[0]
        two = slice(-2 * n, -n), slice(-n, None)
        previous, latest = (harmonic(t[s], F[s], f) for s in two)
        if abs(latest - previous) < _SETTLED * A or t[-1] > _LONGEST:
            return latest
        windows *= 2
