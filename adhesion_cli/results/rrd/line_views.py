"""Views of the line: µ over the position in bars, and the way of a train as a map, with slides."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core import physics
from ...core.model import Bools, Floats, Result
from ...rail.events import Slide
from ...records.route import Route
from .. import palette, plane
from ..plane import Plane, kilometre_posts
from .parts import Clock

_BARS = 400  # of a chart, at most
_SHORTEST = 5.0  # way of a bar [m]
_ROUND = (1.0, 2.0, 5.0, 10.0)  # ways of bars are these, times a power of ten
_SIZE = 100.0  # of the longer side of the map, in scene units; y points down
_MARGIN = 12.0
_POINTS = 4_000  # of the way, and of the moving place
_SLIDE_POINTS = 20  # of a slide
_BACKGROUND = [16, 18, 20]


class LineBars(NamedTuple):
    """A bar for each part of the way on which the train braked, shape (n,)."""

    way: float  # of each bar [m]
    position: Floats  # of its middle [m]
    coefficient: Floats  # mean µ of all axles there, in brake applications
    slid: Bools  # whether a wheel slid there


def find_bars(result: Result, route: Route, slides: Mapping[int, Sequence[Slide]]) -> LineBars:
    """The bars of an analysed log."""
    positions, coefficients, slid = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    for axle in result.axles:
        record, force = axle.record, axle.reference.force
        slid += [route.positions.at(record.t[x.samples]) for x in slides.get(record.axle, ())]
        for s in axle.applications:
            positions.append(route.positions.at(record.t[s]))
            coefficients.append(physics.coefficient(force[s], result.vehicle, record.axle))
    position, mu = np.concatenate(positions), np.concatenate(coefficients)
    has_place = np.isfinite(position) & np.isfinite(mu)
    position, mu, slides_at = position[has_place], mu[has_place], np.concatenate(slid)
    bar_length = _bar_way(float(np.ptp(position)) if len(position) else 0.0)
    bins, place = np.unique(np.floor(position / bar_length), return_inverse=True)
    counts = np.bincount(place, minlength=len(bins))
    mean = np.bincount(place, mu, len(bins)) / np.maximum(counts, 1)
    slid_bins = np.unique(np.floor(slides_at[np.isfinite(slides_at)] / bar_length))
    return LineBars(bar_length, (bins + 0.5) * bar_length, mean, np.isin(bins, slid_bins))


def send_chart(rec: rr.RecordingStream, path: str, bars: LineBars) -> None:
    """Sends the bars, those with slides in another colour."""
    for name, is_in_series, colour in (
        ("rolls", ~bars.slid, palette.SKY),
        ("slides", bars.slid, palette.VERMILLION),
    ):
        if is_in_series.any():
            chart = rr.BarChart(
                bars.coefficient[is_in_series],
                abscissa=bars.position[is_in_series] / 1e3,
                widths=np.full(int(is_in_series.sum()), bars.way / 1e3, np.float32),
                color=palette.rgba(colour),
            )
            rec.log(f"{path}/{name}", chart, static=True)


def chart_view(origin: str, route: Route) -> rrb.View:
    """The chart that `send_chart` sends."""
    return rrb.BarChartView(
        origin=origin,
        name=f"Mean µ of the axles over the {plane.position_label(route)}, red: a wheel slides",
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _bar_way(length: float) -> float:
    """A round way of a bar, so that a chart of this length has few enough [m]."""
    least_width = max(length / _BARS, _SHORTEST)
    power = 10.0 ** math.floor(math.log10(least_width))
    return next(x * power for x in _ROUND if x * power >= least_width * (1.0 - 1e-9))


_TEXT, _WAY_COLOUR = 0xD0D0D0FF, 0x8A8A8AFF


def send_map(
    rec: rr.RecordingStream, path: str, times: Clock, route: Route, slides: Sequence[Slide]
) -> bool:
    """Sends the map; returns whether there is one: the log has coordinates."""
    lines = route.lines()
    if not lines or route.coordinates is None:
        return False
    points = np.concatenate(lines)
    plane = Plane(*np.mean(points, axis=0).tolist())
    scale = _SIZE / max(float(np.ptp(np.stack(plane.at(points)), axis=1).max()), 1e-3)

    def on_map(places: Floats) -> Floats:
        east, north = plane.at(places)
        return scale * np.stack([east, -north], axis=-1)

    step = max(1, -(-len(points) // _POINTS))
    way_lines = [on_map(line[::step]) for line in lines]
    rec.log(f"{path}/way", rr.LineStrips2D(way_lines, colors=_WAY_COLOUR, radii=0.25), static=True)
    slid = []
    for x in slides:
        t = x.start + np.linspace(0.0, 1e9 * x.duration, _SLIDE_POINTS).astype(np.int64)
        places = route.coordinates.at(t)
        slid.append(on_map(places[np.isfinite(places).all(axis=1)]))
    if slid := [strip for strip in slid if len(strip) > 1]:
        strips = rr.LineStrips2D(slid, colors=palette.rgba(palette.VERMILLION), radii=0.7)
        rec.log(f"{path}/slides", strips, static=True)
    kilometres, places = kilometre_posts(route)
    if kilometres:
        labels = rr.Points2D(
            on_map(places), labels=kilometres, radii=0.5, show_labels=True, colors=_TEXT
        )
        rec.log(f"{path}/kilometres", labels, static=True)
    t, places = route.coordinates[:2]
    rows = slice(None, None, max(1, -(-len(t) // _POINTS)))
    dot = rr.Points2D.from_fields(radii=1.2, colors=palette.rgba(palette.WHITE), draw_order=60.0)
    rec.log(f"{path}/now", dot, static=True)
    moving = rr.Points2D.columns(positions=on_map(places[rows]))
    rec.send_columns(f"{path}/now", times(t[rows]), moving)
    return True


def map_view(origin: str) -> rrb.View:
    """The picture that `send_map` sends."""
    extent = _SIZE / 2.0 + _MARGIN
    return rrb.Spatial2DView(
        origin=origin,
        name="Way of the train: red: a wheel slides, white: now",
        visual_bounds=rrb.VisualBounds2D(x_range=[-extent, extent], y_range=[-extent, extent]),
        background=_BACKGROUND,
    )
