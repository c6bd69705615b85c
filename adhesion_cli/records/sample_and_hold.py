"""A slow signal in a fast table: each of its samples is repeated until the next one comes.

The repeats are no measurements: a ramp that is read off once a second is not a staircase.
"""

from collections.abc import Iterator
from dataclasses import astuple, replace

import numpy as np
from numpy.typing import NDArray

from ..core import time_axis
from ..core.model import Channel, Column, Floats

_LEAST = 4  # stands of equal length that show how often a channel is sampled
_SLOWEST = 2.0  # a longer interval is not a sensor's but a test's programme [s]


def interval(channel: Channel) -> float:
    """How often a channel that repeats its samples really has a new one [s]; 0 where each is new.

    A signal that moves by more than one of its steps from one sample to the next goes on moving:
    it never stands in between, unless it is held. And what is held stands equally long, or much
    longer where it does not change. A rounded signal that moves slowly stands, too, but goes on by
    a single step.
    """
    stands = []  # index of the first sample of each, and of the next one's
    for piece in _pieces(channel):
        first = piece.start + _changes(channel.data.value[piece])
        clear = np.abs(np.diff(channel.data.value[first])) > 1.5 * channel.coarsest
        stands.append((first[:-1][clear], first[1:][clear]))
    begin, end = (np.concatenate(side) for side in zip(*stands, strict=True))
    count = end - begin
    if len(count) < _LEAST or np.mean(count < 2) > 0.05:
        return 0.0
    stood = (channel.data.t[end] - channel.data.t[begin]) * 1e-9
    short = stood < 1.5 * np.median(stood)
    if short.sum() < _LEAST:
        return 0.0
    every = float(np.mean(stood[short]))
    away = np.abs(stood - every)[short]
    even = np.mean(away <= np.maximum(0.1 * every, (stood / count)[short]))
    return every if every < _SLOWEST and even > 0.8 else 0.0


def readings(channel: Channel, interval: float) -> Channel:
    """The channel of the samples, `interval` [s] apart, that are its own, without the repeats."""
    pieces = list(_pieces(channel))
    own = [_own(channel, piece, interval) for piece in pieces]
    index = np.concatenate([piece.start + i for piece, i in zip(pieces, own, strict=True)])
    return replace(
        channel,
        data=Column(*(column[index] for column in astuple(channel.data))),
        starts=tuple(int(n) for n in np.cumsum([0, *map(len, own[:-1])])),
        gap_ns=max(channel.gap_ns, time_axis.gap_limit(np.array([round(interval * 1e9)]))),
        rate_hz=1.0 / interval,
    )


def _own(channel: Channel, piece: slice, interval: float) -> NDArray[np.int64]:
    """Index, in an uninterrupted piece, of each sample that is no repeat."""
    t, x = _seconds(channel, piece), channel.data.value[piece]
    first = _changes(x)
    equal = np.maximum(np.rint(np.diff(t[first], append=t[-1]) / interval), 1.0).astype(int)
    nth = np.arange(equal.sum()) - np.repeat(np.cumsum(equal) - equal, equal)
    own: NDArray[np.int64] = np.searchsorted(
        t, t[np.repeat(first, equal)] + nth * interval * (1.0 - 1e-9)
    )
    return own


def _pieces(channel: Channel) -> Iterator[slice]:
    """Where neither a gap nor the clock interrupts."""
    t = channel.data.t
    cuts = np.flatnonzero((np.diff(t) <= 0) | (np.diff(t) > channel.gap_ns)) + 1
    for a, b in zip([0, *cuts], [*cuts, len(t)], strict=True):
        yield slice(int(a), int(b))


def _changes(x: Floats) -> NDArray[np.int64]:
    """Index of each sample that is another value than the one before, the first one too."""
    return np.concatenate([[0], np.flatnonzero(x[1:] != x[:-1]) + 1])


def _seconds(channel: Channel, piece: slice) -> Floats:
    t = channel.data.t[piece]
    since: Floats = (t - t[0]) * 1e-9
    return since
