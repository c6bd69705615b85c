"""Slip over adhesion: Rerun has no such chart, so its axes are drawn as lines and labels."""

import math
from collections.abc import Callable

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...model import Floats, Times
from ...slope import Bands
from .parts import REGION_STATES, Clock

_SCATTER = 20_000  # points of one slip-adhesion scatter
_POINTS = 4_000  # places of its moving operating point
_WIDTH, _HEIGHT = 200.0, 100.0  # of the plotted area, in scene units; y points down
_LABEL = 6.0  # by which the viewer puts a label below its point, about
_LEAST, _MOST = -0.1, 1.0  # slips shown; a wheel at the limit of observation can say anything
_BACKGROUND = [16, 18, 20]
_Place = Callable[[Floats, Floats], Floats]  # slip and µ to points of the picture, shape (n, 2)
_NOW, _PEAK = 0xFFFFFFFF, 0xE45756FF
_ABOVE = 60.0  # of what is drawn above the scatter
_AGES = ([70, 70, 255], [110, 200, 210], [230, 150, 70])  # red, green, blue over time


def send_curve(
    rec: rr.RecordingStream, path: str, times: Clock, t: Times, slip: Floats, mu: Floats,
    bands: Bands | None, peak: tuple[Floats, Floats] | None = None,
) -> int:  # fmt: skip
    """The scatter, the slip band of the AND-test, the operating point as it moves.

    Args:
        rec: where to.
        path: of the picture.
        times: of `t`.
        t: times [ns], shape (n,).
        slip: s [-], shape (n,).
        mu: [-], shape (n,).
        bands: whose slip band is drawn; None for none.
        peak: slip and µ of the curve's peak, shape (n,) each, where they are known.

    Returns:
        How many rows on a timeline.
    """
    place = _send_scatter(rec, path, slip, mu, ", red: the rail's peak" if peak else "")
    if bands:
        ends = place(np.array([bands.slip_low, bands.slip_high]), np.array([math.inf, -math.inf]))
        ends = np.clip(ends, [0.0, -_HEIGHT], [_WIDTH, 0.0])  # it may reach beyond the picture
        band = rr.Boxes2D(
            array=ends.reshape(1, 4), array_format=rr.Box2DFormat.XYXY,
            colors=REGION_STATES[2][1], radii=0.3,
        )  # fmt: skip
        rec.log(f"{path}/band", band, static=True)
    rows = 0
    moving = [("peak", 2.0, _PEAK, peak)] if peak else []
    moving += [("now", 2.4, _NOW, (slip, mu))]
    for name, size, colour, (s, m) in moving:
        style = rr.Points2D.from_fields(radii=size, colors=colour, draw_order=_ABOVE)
        rec.log(f"{path}/{name}", style, static=True)
        at = np.flatnonzero(np.isfinite(s) & np.isfinite(m))
        at = at[:: max(1, -(-len(at) // _POINTS))]
        if len(at):
            points = rr.Points2D.columns(positions=place(s[at], m[at]))
            rec.send_columns(f"{path}/{name}", times(t[at]), points)
        rows += len(at)
    return rows


def curve_view(origin: str, who: str) -> rrb.View:
    """The picture that `send_curve` sends."""
    return rrb.Spatial2DView(
        origin=origin, name=f"{who}: adhesion coefficient µ over slip [%]",
        visual_bounds=_bounds(), background=_BACKGROUND,
    )  # fmt: skip


def _bounds() -> rrb.VisualBounds2D:
    return rrb.VisualBounds2D(x_range=[-20, _WIDTH + 6], y_range=[-_HEIGHT - 16, 34])


def _send_scatter(
    rec: rr.RecordingStream, path: str, slip: Floats, mu: Floats, note: str
) -> _Place:
    """Points of µ over slip on their axes; returns where in the picture a slip and a µ lie."""
    known = np.flatnonzero(np.isfinite(slip) & np.isfinite(mu))
    shown = known[(slip[known] >= _LEAST) & (slip[known] <= _MOST)]
    outside = len(known) - len(shown)
    shown = shown[:: max(1, -(-len(shown) // _SCATTER))]
    s, mu = slip[shown] * 100.0, mu[shown]
    (left, right, xs), (low, high, ys) = _axis(s, 5.0), _axis(mu, 0.05)

    def x(value: Floats) -> Floats:
        return (value - left) / (right - left) * _WIDTH

    def y(value: Floats) -> Floats:
        return (value - low) / (low - high) * _HEIGHT

    frame = [(0, 0), (0, -_HEIGHT), (_WIDTH, -_HEIGHT), (_WIDTH, 0), (0, 0)]
    grid = [[(a, 0), (a, -_HEIGHT)] for a in x(xs)] + [[(0, b), (_WIDTH, b)] for b in y(ys)]
    strips = rr.LineStrips2D([*grid, frame], colors=0x4A4A4AFF, radii=0.15)
    rec.log(f"{path}/grid", strips, static=True)
    texts = [f"{v:g}" for v in xs] + [f"{v:g}" for v in ys]
    places = [(a, 2.0) for a in x(xs)] + [(-9.0, b - _LABEL) for b in y(ys)]
    notes, spots = [f"blue: start, yellow: end, white: now{note}"], [(_WIDTH / 2, 17.0)]
    if outside:
        notes.append(f"{outside} points outside {_LEAST:.0%} to {_MOST:.0%} slip not shown")
        spots.append((_WIDTH / 2, -_HEIGHT - 7.0 - _LABEL))
    labels = rr.Points2D(
        [*places, *spots], labels=[*texts, *notes], radii=0.0, show_labels=True, colors=0xD0D0D0FF
    )
    rec.log(f"{path}/labels", labels, static=True)
    age = np.linspace(0.0, 1.0, len(s))
    colours = np.stack([np.interp(age, [0.0, 0.5, 1.0], c) for c in _AGES], axis=1)
    points = rr.Points2D(np.stack([x(s), y(mu)], 1), radii=0.45, colors=colours.astype(np.uint8))
    rec.log(f"{path}/points", points, static=True)
    return lambda slip, mu: np.stack([x(slip * 100.0), y(mu)], axis=-1)


def _axis(values: Floats, least: float) -> tuple[float, float, Floats]:
    """Ends of an axis that holds all values and 0, at least `least` long, and its round numbers."""
    low = min(0.0, float(values.min(initial=0.0)))
    high = max(least, float(values.max(initial=0.0)))
    rough = (high - low) / 5
    step = 10.0 ** math.floor(math.log10(rough))
    step *= next(m for m in (1.0, 2.0, 5.0, 10.0) if m * step >= rough)
    low, high = low - 0.02 * (high - low), high + 0.03 * (high - low)
    numbers = np.arange(math.ceil(low / step), math.floor(high / step) + 1, dtype=np.float64)
    return low, high, numbers * step
