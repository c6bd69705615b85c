"""A slow signal in a fast table: each of its samples is repeated until the next one comes.

The repeats are no measurements: a ramp that is read off once a second is not a staircase.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core import time_axis
from ..core.finding import Finding
from ..core.model import Channel, Floats
from .choose import BRAKES, Channels
from .faults import View

_FEWEST_HOLDS = 4  # stands of equal length that show how often a channel is sampled
_SLOWEST = 2.0  # a longer interval is not a sensor's but a test's programme [s]


def remove_repeats(channels: Channels, view: View) -> tuple[Channels, list[Finding]]:
    """The channels as they were measured: what a table repeats is no measurement."""
    measured, findings = {}, []
    for key, c in channels.items():
        measured[key] = c
        of_speed = key[0] in ("wheel_speed", "train_speed")
        seconds = interval(c) if of_speed or key[0] in BRAKES else 0.0
        if seconds:
            measured[key] = readings(c, seconds)
            start, stop = view.seconds(c.data.t[[0, -1]])
            repeats = len(c.data.t) - len(measured[key].data.t)
            code = "speed-repeated" if of_speed else "pressure-repeated"
            spans, values = ((float(start), float(stop)),), {"interval_s": seconds}
            findings.append(Finding(code, "info", c.title, repeats, spans, values))
    return measured, findings


def interval(channel: Channel) -> float:
    """How often a channel that repeats its samples really has a new one [s]; 0 where each is new.

    A signal that moves by more than one of its steps from one sample to the next goes on moving:
    it never stands in between, unless it is held. And what is held stands equally long, or much
    longer where it does not change; never shorter, by however small a step it goes on. A rounded
    signal that moves slowly stands, too, but goes on by a single step, or by two after any time.
    """
    holds = []  # index of the first sample of each, and of the next one's; whether it moves clearly
    for piece in _pieces(channel):
        change_index = piece.start + _changes(channel.data.value[piece])
        clear = np.abs(np.diff(channel.data.value[change_index])) > 1.5 * channel.coarsest
        holds.append((change_index[:-1], change_index[1:], clear))
    start, stop, clear = (np.concatenate(side) for side in zip(*holds, strict=True))
    hold_times = (channel.data.t[stop] - channel.data.t[start]) * 1e-9
    hold_time, count = hold_times[clear], (stop - start)[clear]
    if len(count) < _FEWEST_HOLDS or np.mean(count < 2) > 0.05:
        return 0.0
    usual = hold_time < 1.5 * np.median(hold_time)
    if usual.sum() < _FEWEST_HOLDS:
        return 0.0
    usual_time = float(np.mean(hold_time[usual]))
    if np.mean(hold_times < 0.6 * usual_time) > 0.05:
        return 0.0
    deviation = np.abs(hold_time - usual_time)[usual]
    even_share = np.mean(deviation <= np.maximum(0.1 * usual_time, (hold_time / count)[usual]))
    return usual_time if usual_time < _SLOWEST and even_share > 0.8 else 0.0


def readings(channel: Channel, interval: float) -> Channel:
    """The channel of the samples, `interval` [s] apart, that are its own, without the repeats."""
    pieces = list(_pieces(channel))
    reading_index = [_reading_index(channel, piece, interval) for piece in pieces]
    pairs = zip(pieces, reading_index, strict=True)
    index = np.concatenate([piece.start + i for piece, i in pairs])
    data = channel.data
    return replace(
        channel,
        data=replace(data, t=data.t[index], value=data.value[index], valid=data.valid[index]),
        starts=tuple(int(n) for n in np.cumsum([0, *map(len, reading_index[:-1])])),
        gap_ns=max(channel.gap_ns, time_axis.gap_limit(np.array([round(interval * 1e9)]))),
        rate_hz=1.0 / interval,
    )


def _reading_index(channel: Channel, piece: slice, interval: float) -> NDArray[np.int64]:
    """Index, in an uninterrupted piece, of each sample that is no repeat."""
    t, x = channel.data.t[piece], channel.data.value[piece]
    t = (t - t[0]) * np.float64(1e-9)
    change_index = _changes(x)
    readings = np.rint(np.diff(t[change_index], append=t[-1]) / interval)
    count = np.maximum(readings, 1.0).astype(int)  # of each hold
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    reading_t = t[np.repeat(change_index, count)] + nth * interval * (1.0 - 1e-9)
    index: NDArray[np.int64] = np.searchsorted(t, reading_t)
    return index


def _pieces(channel: Channel) -> Iterator[slice]:
    """Where neither a gap nor the clock interrupts."""
    t = channel.data.t
    cuts = np.flatnonzero((np.diff(t) <= 0) | (np.diff(t) > channel.gap_ns)) + 1
    for a, b in zip([0, *cuts], [*cuts, len(t)], strict=True):
        yield slice(int(a), int(b))


def _changes(x: Floats) -> NDArray[np.int64]:
    """Index of each sample that is another value than the one before, the first one too."""
    return np.concatenate([[0], np.flatnonzero(x[1:] != x[:-1]) + 1])
