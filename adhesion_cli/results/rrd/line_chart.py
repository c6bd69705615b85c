"""µ over the position on the line, and where wheels slid: a bar for each part of the way."""

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
from .. import palette

_BARS = 400  # of a chart, at most
_SHORTEST = 5.0  # way of a bar [m]
_ROUND = (1.0, 2.0, 5.0, 10.0)  # ways of bars are these, times a power of ten


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
    way = _bar_way(float(np.ptp(position)) if len(position) else 0.0)
    bins, place = np.unique(np.floor(position / way), return_inverse=True)
    counts = np.bincount(place, minlength=len(bins))
    mean = np.bincount(place, mu, len(bins)) / np.maximum(counts, 1)
    slid_bins = np.unique(np.floor(slides_at[np.isfinite(slides_at)] / way))
    return LineBars(way, (bins + 0.5) * way, mean, np.isin(bins, slid_bins))


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
    of_line = route.position_from == "position"
    axis = "position on the line [km]" if of_line else "way since the start of the log [km]"
    return rrb.BarChartView(
        origin=origin,
        name=f"Mean µ of the axles over the {axis}, red: a wheel slides",
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _bar_way(length: float) -> float:
    """A round way of a bar, so that a chart of this length has few enough [m]."""
    least_width = max(length / _BARS, _SHORTEST)
    power = 10.0 ** math.floor(math.log10(least_width))
    return next(x * power for x in _ROUND if x * power >= least_width * (1.0 - 1e-9))
