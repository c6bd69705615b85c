"""The way of a train as a map without a network, with its slides and its place over time."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core.model import Floats
from ...rail.events import Slide
from ...records.route import Route
from .. import palette
from ..plane import Plane, kilometre_posts
from .parts import Clock

_SIZE = 100.0  # of the longer side of the map, in scene units; y points down
_MARGIN = 12.0
_POINTS = 4_000  # of the way, and of the moving place
_SLIDE_POINTS = 20  # of a slide
_BACKGROUND = [16, 18, 20]
_TEXT, _WAY = 0xD0D0D0FF, 0x8A8A8AFF


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
    way = [on_map(line[::step]) for line in lines]
    rec.log(f"{path}/way", rr.LineStrips2D(way, colors=_WAY, radii=0.25), static=True)
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
    shown = slice(None, None, max(1, -(-len(t) // _POINTS)))
    now = rr.Points2D.from_fields(radii=1.2, colors=palette.rgba(palette.WHITE), draw_order=60.0)
    rec.log(f"{path}/now", now, static=True)
    moving = rr.Points2D.columns(positions=on_map(places[shown]))
    rec.send_columns(f"{path}/now", times(t[shown]), moving)
    return True


def map_view(origin: str) -> rrb.View:
    """The picture that `send_map` sends."""
    half = _SIZE / 2.0 + _MARGIN
    return rrb.Spatial2DView(
        origin=origin,
        name="Way of the train: red: a wheel slides, white: now",
        visual_bounds=rrb.VisualBounds2D(x_range=[-half, half], y_range=[-half, half]),
        background=_BACKGROUND,
    )
