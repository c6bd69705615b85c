"""Pressure sensors that are stuck, or saturated at the end of their range.

A sensor is stuck where its noise ends, or where it shows one value in the whole log while all other
axles are applied and released. A pressure without noise that is stuck for a part of the log is
found by the comparison of the axles.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..core.methods import About
from ..core.model import Bools, Channel, Floats, Quantity, fraction
from .choose import BRAKES, Channels, Key
from .faults import Fault, RepeatedRuns

ABOUT = About("Stuck and saturated pressures", "the chance of equal samples of white noise")
_SHORT_RUN = 30  # samples: so long a stretch is no noise
_ENOUGH_SAMPLES = 20  # samples that show noise


class Params(NamedTuple):
    """Thresholds."""

    chance: Annotated[float, Quantity("-", "of equal samples in a log", 1e-12, 1.0)] = 1e-3
    small: Annotated[float, fraction("of the highest value: may be noise")] = 0.02
    level: Annotated[float, Quantity("-", "small changes: range of noise about a level")] = 4.0
    near: Annotated[float, Quantity("s", "before and after, in which a level holds")] = 0.4
    longer: Annotated[float, Quantity("-", "times the usual: valves keep a value, too")] = 4.0
    rises: Annotated[float, Quantity("-", "of itself, in half a second before a top")] = 0.05
    varies: Annotated[float, fraction("of the highest value: all others vary")] = 0.3


def find_brake_faults(
    p: Params, channels: Channels, repeats: Mapping[Key, RepeatedRuns]
) -> dict[Key, list[Fault]]:
    """Where each pressure [Pa] or K [N] is stuck or saturated, also by those of the other axles.

    `repeats` has, here and below, the stretches in which a channel repeats a value.
    """
    faults = {}
    for key, brake in channels.items():
        if key[0] in BRAKES:
            other_brakes = [c for k, c in channels.items() if k[0] == key[0] and k != key]
            stuck, saturated = standing(p, brake, repeats[key], other_brakes)
            saturation = Fault("pressure-saturated", saturated, False)
            faults[key] = [Fault("pressure-stuck", stuck), saturation]
    return faults


def standing(
    p: Params, brake: Channel, equal_runs: RepeatedRuns, other_brakes: Sequence[Channel] = ()
) -> tuple[Bools, Bools]:
    """Samples at which a pressure sensor is stuck, and those at the end of its range; (n,) each.

    Where it reads its lowest value, its range may end there: that is no fault.
    """
    x = brake.data.value
    if not np.ptp(x) and other_brakes:
        top = max(float(c.data.value.max()) for c in other_brakes)
        if all(np.ptp(c.data.value) > p.varies * top for c in other_brakes):
            return np.ones(len(x), dtype=np.bool_), np.zeros(len(x), dtype=np.bool_)
    silent = _silent(p, brake, equal_runs)
    flat = _flat_top(p, brake, equal_runs, silent)
    silent &= ~flat
    if silent.any() and _range_ends_low(p, brake, equal_runs):
        silent &= equal_runs.value > x.min()
    return equal_runs.repeated(silent), equal_runs.repeated(flat)


def _flat_top(p: Params, brake: Channel, equal_runs: RepeatedRuns, silent: Bools) -> Bools:
    """Silent stretches at the highest value, reached steeply or more than once; shape (k,)."""
    x = brake.data.value
    top = float(x.max())
    flat: Bools = silent & (equal_runs.value == top)
    if flat.sum() == 1:
        start = equal_runs.start[flat]
        earlier = np.maximum(start - max(2, round((brake.rate_hz or 1.0) / 2.0)), 0)
        flat[flat] = top - x[earlier] > p.rises * top
    return flat


def _range_ends_low(p: Params, brake: Channel, equal_runs: RepeatedRuns) -> bool:
    """Whether the sensor reads nothing below its lowest value: it is there often, not by chance.

    So it is, too, where nearly all of the time near that value is at it: of a slow release, many
    samples are near it.
    """
    lowest, highest = float(brake.data.value.min()), float(brake.data.value.max())
    is_run, value = equal_runs.length >= _SHORT_RUN, equal_runs.value
    near_lowest = (value[~is_run] <= lowest + max(p.small * highest, 4.0 * brake.step)).sum()
    silence = equal_runs.length[is_run & (value == lowest)].sum()
    often = max((value[~is_run] == lowest).sum(), 0.01 * silence)
    return bool(near_lowest < max(_ENOUGH_SAMPLES, 10.0 * often))


def _silent(p: Params, brake: Channel, equal_runs: RepeatedRuns) -> Bools:
    """Stretches longer than the channel's noise allows, none where it has no noise; shape (k,).

    Noise is small changes up and down. Where there are steps, it is two of them at least: a quiet
    signal that crosses from one step to the next changes by one. Below the highest value noise is
    about a level: valves that move the pressure make such changes, too.
    """
    x, rate, value = brake.data.value, brake.rate_hz or 0.0, equal_runs.value
    length = equal_runs.length
    small = max(p.small * float(x.max()), 2.5 * brake.step)
    turns = _turns(value, small, 1.5 * brake.step)
    j = min(max(2, round(p.near * rate)), 20)
    nearby = sliding_window_view(np.pad(value, j, "edge"), 2 * j + 1)
    level = np.ptp(nearby, axis=1) <= p.level * small

    def longest(selected: Bools) -> float:
        """What the noise there allows."""
        noisy = (length < _SHORT_RUN) & (value > x.min()) & selected
        samples = int(length[noisy].sum())
        if samples < _ENOUGH_SAMPLES or (turns & selected[1:-1]).sum() < max(6.0, 0.03 * samples):
            return np.inf
        # How often it repeats by chance; more often half way between two steps.
        chance = np.clip(1.0 - noisy.sum() / samples + 0.15, 0.45, 0.7)
        return float(np.log(p.chance / len(x)) / np.log(chance))

    not_highest = value < x.max()
    # Stretches that come again and again with about one length show valves, not noise.
    usual_length = float(np.sort(length[not_highest])[-4:][0]) if not_highest.any() else 0.0
    shortest = max(longest(level), p.longer * usual_length)
    return np.where(not_highest, length >= shortest, length > longest(np.ones_like(level)))


def _turns(value: Floats, largest_noise: float, clear_change: float) -> Bools:
    """Where small changes up and down follow each other, shape (k - 2,).

    `value` is of stretches that follow each other (k,). A change above `largest_noise` is no noise;
    one of both must be larger than `clear_change`.
    """
    changes = np.diff(value)
    larger = np.maximum(np.abs(changes[1:]), np.abs(changes[:-1]))
    returns: Bools = np.sign(changes[1:]) * np.sign(changes[:-1]) < 0.0
    return returns & (larger <= largest_noise) & (larger > clear_change)
