"""Figures of what a brake's switches did: valves, wheel slide protection, sanding, commands."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d
from bokeh.plotting import figure

from ...core.model import Floats, Meaning
from .. import palette
from . import decimate
from .run import LoggedState

TITLES: dict[Meaning, str] = {
    "emergency": "emergency brake",
    "brake_command": "brake command",
    "hold_valve": "hold valve",
    "vent_valve": "vent valve",
    "wsp_active": "WSP active",
    "sanding": "sanding",
}
_LANE = 26  # height of a lane
_FRAME = 64  # of legend and axis
_HIGH = 0.8  # of a lane, at the highest value
_MOST = 2000  # stretches of a state that are drawn
_ASIDE = 0.2  # a sample so near to an end of a gap is not in it [s]
_NO_TIMES = np.empty(0)


def draw_lanes(
    fig: figure, states: Sequence[LoggedState], log_times: Floats = _NO_TIMES
) -> dict[str, list[Any]]:
    """A lane for each state, the first one on top: as high as its value; returns the legend."""
    items = {}
    for i, state in enumerate(states):
        begins, stops, values = stretches(state, log_times)
        bottom = float(len(states) - 1 - i)
        highest = float(np.max(np.abs(state.value), initial=0.0)) or 1.0
        source = ColumnDataSource(
            {
                "begin": begins,
                "stop": stops,
                "bottom": np.full(len(begins), bottom),
                "top": bottom + _HIGH * np.abs(values) / highest,
                "state": [_word(state, value) for value in values.astype(np.float64).tolist()],
            }
        )
        edges, colour = ("begin", "stop", "bottom", "top"), palette.nth(i)
        style = {"fill_color": colour, "line_color": colour}
        renderer = fig.quad(*edges, source=source, **style)
        name = title = TITLES[state.meaning]
        if len(state.levels[1:]) > 1:  # more than off and on
            name = f"{title}: {', '.join(state.levels[1:])}"
        tips = [(title, "@state"), ("from", "@begin{0.00} s"), ("to", "@stop{0.00} s")]
        fig.add_tools(HoverTool(renderers=[renderer], tooltips=tips))
        items[name] = [renderer]
    fig.height = _FRAME + _LANE * len(states)
    fig.y_range = Range1d(-0.1, len(states))
    fig.yaxis.ticker = []
    fig.ygrid.grid_line_color = None
    return items


def stretches(state: LoggedState, log_times: Floats = _NO_TIMES) -> tuple[Floats, Floats, Floats]:
    """Begin, stop [s] and value of each stretch in which a state is not 0, shape (n,).

    A sample holds until the next one, until a gap of the log before that, or to the end of the log.
    Of more stretches than a picture shows, the highest value of each of equal times is taken.
    `log_times` are those of the samples of its axles, shape (m,) [s].
    """
    t, value = state.t, state.value
    end_by_row = _ends_at_gaps(t, decimate.gaps(log_times))
    edges = np.flatnonzero(np.diff(value, prepend=np.nan) != 0.0)
    if len(edges) > _MOST:
        bucket = np.floor((t - t[0]) / max(t[-1] - t[0], 1e-9) * _MOST)
        edges = np.flatnonzero(np.diff(bucket, prepend=np.nan) != 0.0)
    if not len(edges):
        return t, t, value
    edges = np.union1d(edges, np.fromiter(end_by_row, np.int64) + 1)
    lowest, highest = (f.reduceat(value, edges) for f in (np.minimum, np.maximum))
    values = np.where(highest >= -lowest, highest, lowest)
    last_rows = [*(edges[1:] - 1).tolist(), len(t) - 1]
    following = np.append(t[1:], max(t[-1], np.max(log_times, initial=-np.inf)))
    stops = np.array([end_by_row.get(row, following[row]) for row in last_rows])
    is_acting = values != 0.0
    return t[edges][is_acting], stops[is_acting], values[is_acting]


def _ends_at_gaps(t: Floats, gaps: Floats) -> dict[int, float]:
    """The rows before the gaps in which a state has no sample, and until when they hold [s]."""
    rows_before = np.searchsorted(t, gaps[:, 0] + _ASIDE, side="right") - 1
    rows_after = np.searchsorted(t, gaps[:, 1] - _ASIDE)
    undivided = (rows_before >= 0) & (rows_after == rows_before + 1)
    rows, first_gaps = np.unique(rows_before[undivided], return_index=True)
    stops = np.maximum(gaps[undivided, 0][first_gaps], t[rows])
    return dict(zip(rows.tolist(), stops.tolist(), strict=True))


def _word(state: LoggedState, value: float) -> str:
    is_level = value.is_integer() and 0 <= value < len(state.levels)
    return state.levels[int(value)] if is_level else f"{value:g}"
