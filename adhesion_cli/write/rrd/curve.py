"""Slip over adhesion: Rerun has no such chart, so its axes are drawn as lines and labels."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...model import Floats, Times
from .parts import REGION_STATES, Clock

_SCATTER = 20_000  # points of one slip-adhesion scatter
_POINTS = 4_000  # places of its moving operating point
_WIDTH, _HEIGHT = 150.0, 100.0  # of the plotted area, in scene units; y points down
_LEAST, _MOST = -0.1, 1.0  # slips shown; a wheel at the limit of observation can say anything
_BACKGROUND = [16, 18, 20]
_Place = Callable[[Floats, Floats], Floats]  # slip and µ to points of the picture, shape (n, 2)
_AGES = ([70, 70, 255], [110, 200, 210], [230, 150, 70])  # red, green, blue over time


def send_curve(
    rec: rr.RecordingStream, path: str, times: Clock, t: Times, slip: Floats, mu: Floats,
    edges: Sequence[float],
) -> int:  # fmt: skip
    """The scatter, the edges of the slip band and the operating point as it moves.

    Returns:
        How many rows on a timeline.
    """
    place = _send_scatter(rec, path, slip, mu)
    strips = [place(np.full(2, s), np.array([0.0, math.inf])) for s in edges]
    lines = rr.LineStrips2D(strips, colors=REGION_STATES[2][1], radii=0.3)
    rec.log(f"{path}/band", lines, static=True)
    at = np.flatnonzero(np.isfinite(slip) & np.isfinite(mu))
    at = at[:: max(1, -(-len(at) // _POINTS))]
    style = rr.Points2D.from_fields(radii=1.8, colors=0xFFFFFFFF)
    rec.log(f"{path}/now", style, static=True)
    if len(at):
        points = rr.Points2D.columns(positions=place(slip[at], mu[at]))
        rec.send_columns(f"{path}/now", times(t[at]), points)
    return len(at)


def curve_view(origin: str, who: str) -> rrb.View:
    """The picture that `send_curve` sends."""
    return rrb.Spatial2DView(
        origin=origin, name=f"{who}: adhesion coefficient µ over slip [%]",
        visual_bounds=_bounds(), background=_BACKGROUND,
    )  # fmt: skip


def _bounds() -> rrb.VisualBounds2D:
    return rrb.VisualBounds2D(x_range=[-18, _WIDTH + 8], y_range=[-_HEIGHT - 14, 24])


def _send_scatter(rec: rr.RecordingStream, path: str, slip: Floats, mu: Floats) -> _Place:
    """Points of µ over slip on their axes; returns where in the picture a slip and a µ lie."""
    known = np.flatnonzero(np.isfinite(slip) & np.isfinite(mu))
    shown = known[(slip[known] >= _LEAST) & (slip[known] <= _MOST)]
    outside = len(known) - len(shown)
    shown = shown[:: max(1, -(-len(shown) // _SCATTER))]
    s, mu = slip[shown] * 100.0, mu[shown]

    xs, ys = _ticks(s, 5.0), _ticks(mu, 0.05)

    def x(value: Floats) -> Floats:
        return np.interp(value, xs[[0, -1]], [0.0, _WIDTH])

    def y(value: Floats) -> Floats:
        return np.interp(value, ys[[0, -1]], [0.0, -_HEIGHT])

    grid = [[(a, 0), (a, -_HEIGHT)] for a in x(xs)] + [[(0, b), (_WIDTH, b)] for b in y(ys)]
    rec.log(f"{path}/grid", rr.LineStrips2D(grid, colors=0x4A4A4AFF, radii=0.15), static=True)
    texts = [f"{v:g}" for v in xs] + [f"{v:g}" for v in ys]
    places = [(a, 5.0) for a in x(xs)] + [(-8.0, b) for b in y(ys)]
    notes, spots = ["blue: start of the log, yellow: end"], [(_WIDTH / 2, 14.0)]
    if outside:
        notes.append(f"{outside} points outside {_LEAST:.0%} to {_MOST:.0%} slip not shown")
        spots.append((_WIDTH / 2, -_HEIGHT - 9.0))
    labels = rr.Points2D(
        [*places, *spots], labels=[*texts, *notes], radii=0.0, show_labels=True, colors=0xD0D0D0FF
    )
    rec.log(f"{path}/labels", labels, static=True)
    age = np.linspace(0.0, 1.0, len(s))
    colours = np.stack([np.interp(age, [0.0, 0.5, 1.0], c) for c in _AGES], axis=1)
    points = rr.Points2D(np.stack([x(s), y(mu)], 1), radii=0.45, colors=colours.astype(np.uint8))
    rec.log(f"{path}/points", points, static=True)
    return lambda slip, mu: np.stack([x(slip * 100.0), y(mu)], axis=-1)


def _ticks(values: Floats, least: float) -> Floats:
    """Round numbers around the values, zero among them, at least `least` apart in total."""
    low = min(0.0, float(values.min(initial=0.0)))
    high = max(least, float(values.max(initial=0.0)))
    rough = (high - low) / 5
    step = 10.0 ** math.floor(math.log10(rough))
    step *= next(m for m in (1.0, 2.0, 5.0, 10.0) if m * step >= rough)
    return np.arange(math.floor(low / step), math.ceil(high / step) + 1, dtype=np.float64) * step
