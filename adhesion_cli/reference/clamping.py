"""The clamping force of an axle, smoothed, with the error of its samples."""

from typing import NamedTuple

import numpy as np

from ..core.masks import true_runs
from ..core.model import AxleRecord, Bools, Floats
from ..core.signals import white_noise
from . import smoother
from .noise_fit import (
    NO_BRAKING,
    line_error,
    median_step,
    seconds_of,
    switching_regimes,
    take_samples,
)
from .smoother import MeasurementNoise, Prior, Runs, UnbrokenRun

_FEW = 100  # fewer samples of a brake may be all bends
_MEDIAN_SQUARE = 0.455  # of a standard normal value
_SHORTEST_ZERO = 10  # fewer samples of K = 0 in a row are noise around the spring's force


class SmoothedClamping(NamedTuple):
    """The clamping force without its noise; columns of shape (n,)."""

    K: Floats  # [N]
    sigma: Floats  # 1 sigma at its own samples, a line between them [N]
    missed: Floats  # 1 sigma of what lines between its samples may miss [N]
    measured: Bools  # the samples of the speed that are nearest to its own


def smooth_clamping(runs: list[AxleRecord]) -> list[SmoothedClamping]:
    """K without its noise: constant, moving, or stepping (then as measured).

    K = 0 is a bound of (15), not a measurement with noise: there it is exact.
    """
    pieces = [[_piece(r, s) for s in _braked_spans(r)] for r in runs]
    all_pieces = [one for run_pieces in pieces for one in run_pieces]
    if not all_pieces:
        zeros = [np.zeros(len(r)) for r in runs]
        return [SmoothedClamping(x, x, x, np.ones(len(x), bool)) for x in zeros]
    scale = max(max(float(np.max(np.abs(r.y))) for r in all_pieces), NO_BRAKING)
    step = median_step(all_pieces)
    floor = (1e-5 * scale) ** 2 + runs[0].clamping_force_step ** 2 / 12.0  # never quite zero
    rough = scale**2 * np.array([1e-6, 0.1, 3.0 / step**3])
    variance, decades = white_noise((r.t, r.y) for r in all_pieces), 2.0
    if sum(len(r.t) for r in all_pieces) < _FEW:
        variance, decades = min(variance, _noise_of_bends(all_pieces)), 0.5
    guess = MeasurementNoise(max(variance, floor), 0.0, rough)
    regimes = switching_regimes(np.zeros(3), 3.0 * scale)
    prior = Prior(guess, [decades, 0.0, 2.0, 2.0, 0.0], floor)
    noise, _ = smoother.fit(take_samples(all_pieces), regimes, prior)
    clamping = []
    for r, run_pieces in zip(runs, pieces, strict=True):
        K, sigma, missed = np.zeros((3, len(r)))
        measured = np.ones(len(r), bool)
        for s, piece in zip(_braked_spans(r), run_pieces, strict=True):
            t, x = seconds_of(r)[s], smoother.smooth(piece, regimes, noise)
            t = t - t[0]
            K[s] = np.interp(t, piece.t, x.level)
            sigma[s] = np.interp(t, piece.t, x.level_sigma)
            missed[s] = line_error(t, piece.t, x.level)
            measured[s] = False
            measured[s.start + np.searchsorted((t[1:] + t[:-1]) / 2.0, piece.t)] = True
        clamping.append(SmoothedClamping(K, sigma, missed, measured))
    return clamping


def _noise_of_bends(pieces: Runs) -> float:
    """Variance of the white noise, by fourth differences; infinite where there is none.

    From one sample to the next a slow log shows how a brake bends, and that looks like noise. Noise
    is what changes how it bends. Where the brake begins and ends is a kink.
    """
    bends = np.concatenate([np.diff(r.y[1:-1], 4) for r in pieces])
    return float(np.median(bends**2)) / _MEDIAN_SQUARE / 70.0 if len(bends) else np.inf


def _braked_spans(run: AxleRecord) -> list[slice]:
    """Where K > 0, with one sample of the zero on either side; short zeros are noise."""
    released = run.clamping_force_smooth == 0.0  # motors that drive are below zero
    for start, stop in true_runs(released):
        released[start:stop] = stop - start >= _SHORTEST_ZERO or start == 0 or stop == len(run)
    n = len(run)
    spans = [slice(max(a - 1, 0), min(b + 1, n)) for a, b in true_runs(~released)]
    return [s for s in spans if s.stop - s.start > 1]


def _piece(run: AxleRecord, s: slice) -> UnbrokenRun:
    """The pressure's own samples of a piece, not those interpolated to the wheel's times.

    A slow pressure that repeats its value is taken as sampled as often as where it changes.
    """
    last_value, K, t = run.clamping_force[s], run.clamping_force_smooth[s], seconds_of(run)[s]
    is_sample = np.diff(last_value, prepend=np.nan) != 0.0
    unchanged = last_value == K
    changes = t[is_sample]
    if unchanged.all() or len(changes) < 3:
        is_sample |= unchanged
    else:
        interval = float(np.median(np.diff(changes)))
        for start, stop in true_runs(unchanged):
            count = max(round((t[stop - 1] - t[start]) / interval), 1) + 1
            is_sample[start + np.round(np.linspace(0, stop - 1 - start, count)).astype(int)] = True
    is_sample[[0, -1]] = True
    zeros = np.zeros((5, np.sum(is_sample)))
    return UnbrokenRun((t - t[0])[is_sample], K[is_sample], *zeros)
