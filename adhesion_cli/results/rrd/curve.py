"""Slip over adhesion: Rerun has no such chart, so its axes are drawn as lines and labels."""

import math
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core.model import Bools, Floats, Times, Vehicle
from ...rail import fit, slope
from .. import palette
from .parts import REGION_STATES, Clock

_SCATTER = 20_000  # points of one slip-adhesion scatter
_POINTS = 4_000  # places of its moving operating point
_WIDTH, _HEIGHT = 200.0, 100.0  # of the plotted area, in scene units; y points down
_LABEL = 6.0  # by which the viewer puts a label below its point, about
_LOWEST_SLIP, _HIGHEST_SLIP = -0.1, 1.0  # that are shown; a very slow wheel can have any
_BACKGROUND = [16, 18, 20]
_LINES = 17.0, 29.0  # heights of what stands below it
_NOW_COLOUR, _PEAK_COLOUR = palette.rgba(palette.WHITE), palette.rgba(palette.VERMILLION)
_FIT_COLOUR = palette.rgba(palette.ORANGE)
_TOP_LAYER = 60.0  # of what is drawn above the scatter
_TEXT = 0xD0D0D0FF
_AGES = ([70, 70, 255], [110, 200, 210], [230, 150, 70])  # red, green, blue over time


class _Frame(NamedTuple):
    """The plotted area: slip from left to right, µ from low to high."""

    slip_min: float
    slip_max: float
    mu_min: float
    mu_max: float

    def place(self, slip: Floats, mu: Floats) -> Floats:
        """Points of the picture, shape (n, 2)."""
        x = (slip - self.slip_min) / (self.slip_max - self.slip_min) * _WIDTH
        return np.stack([x, (mu - self.mu_min) / (self.mu_min - self.mu_max) * _HEIGHT], axis=-1)

    def contains(self, slip: Floats, mu: Floats) -> Bools:
        """Which of the points lie inside; none that is NaN."""
        inside: Bools = (slip >= self.slip_min) & (slip <= self.slip_max)
        return inside & (mu >= self.mu_min) & (mu <= self.mu_max)


def send_curve(  # noqa: PLR0913 (columns of one picture)
    rec: rr.RecordingStream,
    path: str,
    times: Clock,
    t: Times,
    slip: Floats,
    mu: Floats,
    bands: slope.Bands | None,
    peak: tuple[Floats, Floats] | None = None,
    fitted: tuple[fit.RailFit, Vehicle] | None = None,
    judged: str = "",
) -> None:
    """The scatter, the slip band of the AND-test, the operating point as it moves.

    Times [ns], slip [-] and µ [-] have shape (n,), as slip and µ of the curve's peak have, where
    they are known. The slip band of `bands` is drawn, and curve and peak of `fitted`, a rail that
    was fitted to slides of a vehicle. `judged` says what the band judges.
    """
    frame = _send_scatter(rec, path, slip, mu)
    notes = "blue: start, yellow: end, white: now" + (", red: the rail's peak" if peak else "")
    if fitted:
        notes += _send_fit(rec, path, frame, *fitted)
    texts = [notes]
    if bands:
        bounds, height = (bands.slip_low, bands.slip_high), np.array([frame.mu_min, frame.mu_max])
        lower, upper = (100.0 * np.array(bounds)).tolist()
        texts.append(f"green: slip band {lower:g} to {upper:g} %{judged}")
        visible = [s for s in bounds if frame.slip_min < s < frame.slip_max]
        edges = [frame.place(np.full(2, s), height) for s in visible]
        band = rr.LineStrips2D(edges, colors=REGION_STATES[2][1], radii=0.3)
        rec.log(f"{path}/band", band, static=True)
    spots = [(_WIDTH / 2, y) for y in _LINES[: len(texts)]]
    labels = rr.Points2D(spots, labels=texts, radii=0.0, show_labels=True, colors=_TEXT)
    rec.log(f"{path}/notes", labels, static=True)
    moving = [("peak", 2.0, _PEAK_COLOUR, peak)] if peak else []
    moving += [("now", 2.4, _NOW_COLOUR, (slip, mu))]
    for name, size, colour, (s, m) in moving:
        style = rr.Points2D.from_fields(radii=size, colors=colour, draw_order=_TOP_LAYER)
        rec.log(f"{path}/{name}", style, static=True)
        finite = np.flatnonzero(np.isfinite(s) & np.isfinite(m))
        finite = finite[:: max(1, -(-len(finite) // _POINTS))]
        inside = frame.contains(s[finite], m[finite])  # outside there is nothing to see
        if inside.any():
            rows = finite[inside]
            points = rr.Points2D.columns(positions=frame.place(s[rows], m[rows]))
            points = points.partition(inside.astype(np.int64))
            rec.send_columns(f"{path}/{name}", times(t[finite]), points)


def _send_fit(
    rec: rr.RecordingStream, path: str, frame: _Frame, rail: fit.RailFit, vehicle: Vehicle
) -> str:
    """The likeliest curve, and the peak with its 95 % interval; returns what they are."""
    slip = np.geomspace(1e-4, frame.slip_max, 200)
    mu = fit.curve(rail.best, rail.speed, slip, vehicle)
    inside = frame.contains(slip, mu)
    strips = [frame.place(slip[inside], mu[inside])]
    note = f", orange: fit at {3.6 * rail.speed:.0f} km/h"
    if rail.peak_slip and rail.peak_mu:
        peak_range = np.clip(np.array(rail.peak_slip), frame.slip_min, frame.slip_max)
        height = np.full(3, min(max(rail.peak_mu.value, frame.mu_min), frame.mu_max))
        value, *interval = frame.place(peak_range, height)
        strips.append(np.array(interval))
        dot = rr.Points2D([value], radii=1.6, colors=_PEAK_COLOUR, draw_order=_TOP_LAYER)
        rec.log(f"{path}/fit/peak", dot, static=True)
        note += ", red: its peak, 95 %"
    colours = [_FIT_COLOUR, _PEAK_COLOUR][: len(strips)]
    lines = rr.LineStrips2D(strips, colors=colours, radii=0.4, draw_order=_TOP_LAYER)
    rec.log(f"{path}/fit/curve", lines, static=True)
    return note


def curve_view(origin: str, title: str) -> rrb.View:
    """The picture that `send_curve` sends."""
    return rrb.Spatial2DView(
        origin=origin,
        name=f"{title}: adhesion coefficient µ over slip [%]",
        visual_bounds=rrb.VisualBounds2D(x_range=[-20, _WIDTH + 6], y_range=[-_HEIGHT - 16, 46]),
        background=_BACKGROUND,
    )


def _send_scatter(rec: rr.RecordingStream, path: str, slip: Floats, mu: Floats) -> _Frame:
    """Points of µ over slip on their axes; returns what these hold."""
    finite = np.flatnonzero(np.isfinite(slip) & np.isfinite(mu))
    visible = finite[(slip[finite] >= _LOWEST_SLIP) & (slip[finite] <= _HIGHEST_SLIP)]
    outside = len(finite) - len(visible)
    visible = visible[:: max(1, -(-len(visible) // _SCATTER))]
    s, mu = slip[visible], mu[visible]
    (x_min, x_max, xs), (y_min, y_max, ys) = _axis(s, 0.05), _axis(mu, 0.05)
    frame = _Frame(x_min, x_max, y_min, y_max)

    x = frame.place(xs, np.full(len(xs), y_min))[:, 0]
    y = frame.place(np.full(len(ys), x_min), ys)[:, 1]
    border = [(0, 0), (0, -_HEIGHT), (_WIDTH, -_HEIGHT), (_WIDTH, 0), (0, 0)]
    grid = [[(a, 0), (a, -_HEIGHT)] for a in x] + [[(0, b), (_WIDTH, b)] for b in y]
    strips = rr.LineStrips2D([*grid, border], colors=0x4A4A4AFF, radii=0.15)
    rec.log(f"{path}/grid", strips, static=True)
    texts = [f"{100.0 * v:g}" for v in xs] + [f"{v:g}" for v in ys]
    places = [(a, 2.0) for a in x] + [(-9.0, b - _LABEL) for b in y]
    if outside:
        slips = f"{_LOWEST_SLIP:.0%} to {_HIGHEST_SLIP:.0%} slip"
        texts.append(f"{outside} points outside {slips} not shown")
        places.append((_WIDTH / 2, -_HEIGHT - 7.0 - _LABEL))
    labels = rr.Points2D(places, labels=texts, radii=0.0, show_labels=True, colors=_TEXT)
    rec.log(f"{path}/labels", labels, static=True)
    age = np.linspace(0.0, 1.0, len(s))
    colours = np.stack([np.interp(age, [0.0, 0.5, 1.0], c) for c in _AGES], axis=1)
    points = rr.Points2D(frame.place(s, mu), radii=0.45, colors=colours.astype(np.uint8))
    rec.log(f"{path}/points", points, static=True)
    return frame


def _axis(values: Floats, smallest_span: float) -> tuple[float, float, Floats]:
    """Ends and round numbers of an axis that holds all values and 0, at least so long."""
    lowest = min(0.0, float(values.min(initial=0.0)))
    highest = max(smallest_span, float(values.max(initial=0.0)))
    rough = (highest - lowest) / 5
    step = 10.0 ** math.floor(math.log10(rough))
    step *= next(m for m in (1.0, 2.0, 5.0, 10.0) if m * step >= rough)
    lowest, highest = lowest - 0.02 * (highest - lowest), highest + 0.03 * (highest - lowest)
    numbers = np.arange(math.ceil(lowest / step), math.floor(highest / step) + 1, dtype=np.float64)
    return lowest, highest, numbers * step
