"""Figures of a run over the line: µ over the kilometre, and the way of the train as a map."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.plotting import figure

from ...core.model import Floats
from ...core.summary import SlideSummary
from .. import palette
from ..plane import Plane, kilometre_posts
from ..text_tables import number, slip_text
from .run import ReportAxle, ReportRun

_STEP = 5.0  # of the position, over which µ is averaged [m]
_MOST_POINTS = 4000  # of a map's line
_SLIDE_POINTS = 20  # of a slide's line on a map


def draw_over_position(fig: figure, axle: ReportAxle, run: ReportRun, colour: str) -> list[Any]:
    """µ of an axle in its brake applications over the position, a mean every 5 m."""
    km, mu = list[float](), list[float]()
    for a in axle.applications:
        inside = (axle.t >= a.start_s) & (axle.t <= a.end_s) & np.isfinite(axle.force)
        metres = run.route.positions.at(_times(run, axle.t[inside]))
        known = np.isfinite(metres)
        metres, values = metres[known], (axle.force[inside] / axle.weight)[known]
        if not len(metres):
            continue
        first = np.flatnonzero(np.diff(np.floor(metres / _STEP), prepend=np.nan))
        counts = np.diff(first, append=len(metres))
        for column, series in ((km, metres / 1e3), (mu, values)):
            column += [*(np.add.reduceat(series, first) / counts).tolist(), np.nan]
    if not km:
        return []
    source = ColumnDataSource({"km": np.array(km, np.float32), "mu": np.array(mu, np.float32)})
    return [fig.line("km", "mu", source=source, color=colour, line_width=1.3)]


def slid_positions(run: ReportRun) -> list[tuple[float, float]]:
    """From and to of each slide [km]."""
    spans = []
    for _, x in _slides(run):
        times = _times(run, np.array([x.start_s, x.start_s + x.duration_s]))
        begin, stop = (run.route.positions.at(times) / 1e3).tolist()
        if np.isfinite([begin, stop]).all():
            spans.append((min(begin, stop), max(begin, stop)))
    return spans


def draw_map(fig: figure, run: ReportRun) -> dict[str, list[Any]]:
    """The way of the train, its stops and its slides; returns what a legend names."""
    lines = run.route.lines()
    plane = Plane(*np.mean(np.concatenate(lines), axis=0).tolist())
    step = -(-sum(map(len, lines)) // _MOST_POINTS)
    items: dict[str, list[Any]] = {}
    for line in lines:
        drawn = fig.line(*plane.at(line[:: max(step, 1)]), color=palette.GREY, line_width=2.0)
        items.setdefault("way", []).append(drawn)
    if slides := [(axle, x) for axle, x in _slides(run) if x.latitude is not None]:
        items["slides"] = _draw_slides(fig, run, plane, slides)
    stops = [s for s in run.summary.stops if s.latitude is not None]
    if stops:
        tips = {
            "stop at": [f"{number(s.start_s, 1)} s" for s in stops],
            "position": [f"{number(s.position_m and s.position_m / 1e3, 3)} km" for s in stops],
            "distance": [f"{number(s.distance_m and s.distance_m.value, 1)} m" for s in stops],
        }
        items["stops"] = _points(fig, plane, stops, tips, palette.BLUE, 8)
    kilometres, places = kilometre_posts(run.route)
    east, north = plane.at(places)
    fig.scatter(east, north, size=4, color=palette.BLACK)
    style = {"text_font_size": "11px", "text_color": palette.GREY, "x_offset": 6, "y_offset": 6}
    fig.text(east, north, kilometres, **style)
    return items


def _draw_slides(
    fig: figure, run: ReportRun, plane: Plane, slides: Sequence[tuple[int, SlideSummary]]
) -> list[Any]:
    drawn = []
    for _, x in slides:
        seconds = x.start_s + np.linspace(0.0, x.duration_s, _SLIDE_POINTS)
        assert run.route.coordinates
        places = run.route.coordinates.at(_times(run, seconds))
        places = places[np.isfinite(places).all(axis=1)]
        drawn.append(fig.line(*plane.at(places), color=palette.VERMILLION, line_width=6.0))
    of_slides = [x for _, x in slides]
    tips = {
        "slide of axle": [str(axle) for axle, _ in slides],
        "at": [f"{number(x.start_s, 1)} s" for x in of_slides],
        "position": [f"{number(x.position_km, 3)} km" for x in of_slides],
        "distance": [f"{number(x.distance_m, 0)} m" for x in of_slides],
        "largest slip": [
            f"{slip_text(x.max_slip, x.at_least, x.max_slip_u95)} %" for x in of_slides
        ],
    }
    return drawn + _points(fig, plane, of_slides, tips, palette.VERMILLION, 7)


def _points(
    fig: figure,
    plane: Plane,
    places: Iterable[Any],
    tips: Mapping[str, Sequence[str]],
    colour: str,
    size: int,
) -> list[Any]:
    """Points with what the pointer shows of each, by its name."""
    east, north = plane.at(np.array([[x.latitude, x.longitude] for x in places]))
    source = ColumnDataSource({"east": east, "north": north, **tips})
    style = {"size": size, "color": colour, "line_color": "white"}
    points = fig.scatter("east", "north", source=source, **style)
    fig.add_tools(HoverTool(renderers=[points], tooltips=[(name, f"@{{{name}}}") for name in tips]))
    return [points]


def _slides(run: ReportRun) -> list[tuple[int, SlideSummary]]:
    return [(a.number, x) for a in run.axles for o in a.applications for x in o.slide_list]


def _times(run: ReportRun, seconds: Floats) -> Any:
    return run.start_ns + np.round(1e9 * seconds).astype(np.int64)
