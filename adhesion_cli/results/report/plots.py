"""The figures of a report, drawn by Bokeh in the browser; the same data give the same bytes."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from bokeh import layouts, models
from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.models import ColumnDataSource, Range1d
from bokeh.plotting import figure
from bokeh.resources import INLINE, Resources
from numpy.typing import NDArray

from ...core.finding import merge_spans
from ...core.model import Floats, Meaning
from ...core.summary import Measured
from ...stops.series import SeriesStop
from .. import palette, plane
from ..train_stops import MANY_AXLES, group_numbers
from . import campaign, decimate, place_plots, state_plots
from .run import LoggedState, ReportAxle, ReportRun

MOST_VALUES = 800_000  # numbers in all figures of a page
_DETAIL = 3  # more numbers of an axle with figures of its own, over those of the others
_BITS = 12  # of a number's mantissa that a picture shows
_CURVE = 400  # points of the deceleration of one stop
_POINTS = 2500  # of µ over slip, of a force of motors or a reservoir, per axle
_MARGIN = 1.0  # around a brake application that is drawn in full [s]
_RARE = 0.002  # share of the samples that may lie outside of a chart of errors
_ERRORS = "error_"  # column of an estimator's error
_WEAK = 0.13
_EQUIVALENT = "equivalent_deceleration"
_LEAST_SPREAD = 2.0  # of speeds around the stops of a series [km/h]
_LEAD_TIME = 3.0  # shown before and after braking, where runs are compared [s]
_NARROW = 45  # letters in a row of a legend that a narrow screen has room for
_SIGN = 5  # of these for the sign in front of each name
_SHADES = 500  # slides of all axles together that are shaded one by one
_FONT = "13px"
# Title, factor and place of what is drawn as a curve.
_CURVES: dict[Meaning, tuple[str, float, str]] = {
    "ed_force": ("ED force [kN]", 1e-3, "ed-force"),
    "traction_force": ("Traction [kN]", 1e-3, "traction"),
    "reservoir_pressure": ("Reservoir [bar]", 1e-5, "reservoir"),
}
_ID = re.compile(r'"p\d+"')  # of a model of Bokeh


@dataclass(frozen=True, slots=True)
class RunFigures:
    """Figures of one run: names of their places on the page."""

    overview: list[str]
    places: list[str]  # where positions are known
    axles: dict[int, list[str]]
    step: float  # longest interval between drawn samples inside of brake applications [s]


class Figures:
    """All figures of a page, in one document, linked; they have about so many `values` together."""

    def __init__(self, values: int = MOST_VALUES) -> None:
        self._values, self._places = values, dict[str, figure]()
        self._cursor = models.Span(dimension="height", line_color="#888888", line_dash="dotted")

    def of_run(self, run: ReportRun, axles: Sequence[int] | None = None) -> RunFigures:
        """Overview, then figures per axle on one time axis, of these axles or of those chosen."""
        axle_numbers = run.detailed if axles is None else axles
        earliest, latest = (f(float(f(a.t)) for a in run.axles if len(a.t)) for f in (min, max))
        time = Range1d(earliest, latest, bounds=(earliest, latest))
        detailed = [axle for axle in run.axles if axle.number in axle_numbers]
        limit = self._values // max(len(run.axles) + _DETAIL * len(detailed), 1)
        sources: dict[int, ColumnDataSource] = {}
        longest_step = 0.0
        for axle in run.axles:
            room = (1 + _DETAIL) * limit if axle in detailed else limit
            sources[axle.number], step = _source(axle, room)
            longest_step = max(longest_step, step)
        overview = self._overview(run, sources, time)
        figures = {a.number: self._axle(a, sources[a.number], time, run) for a in detailed}
        return RunFigures(overview, self._of_places(run), figures, longest_step)

    def of_runs(self, runs: Sequence[ReportRun], adhesion: bool = True) -> dict[int, list[str]]:
        """Speed and adhesion coefficient of each axle, all runs from the start of their braking.

        Where the coefficients may not be compared, without `adhesion`, there is the speed. Returns
        the places of the figures, by axle.
        """
        braked = [o.end_s - r.brake_s for r in runs for a in r.axles for o in a.applications]
        latest = [float(a.t[-1]) - r.brake_s for r in runs for a in r.axles if len(a.t)]
        time = Range1d(-_LEAD_TIME, max(braked or latest, default=1.0) + _LEAD_TIME)
        axle_numbers = runs[0].detailed
        numbers = sorted({a.number for run in runs for a in run.axles if a.number in axle_numbers})
        limit = self._values // max(sum(len(run.axles) for run in runs), 1)
        sources = {}
        for N in numbers:
            speed = self._figure("Speed [km/h], black: train", 230, time)
            coefficient = self._figure("Adhesion coefficient [-]", 190, time)
            figures = [speed, coefficient] if adhesion else [speed]
            figures[-1].xaxis.axis_label = "time after the start of braking [s]"
            items: dict[str, list[Any]] = {}
            axle_sources = []
            for i, run in enumerate(runs):
                for axle in (a for a in run.axles if a.number == N):
                    source, _ = _source(axle, limit, run.brake_s)
                    colour = palette.nth(i)
                    items[f"run {i + 1}"] = [
                        _line(speed, source, "train", palette.BLACK, 0.8),
                        _line(speed, source, "rim", colour),
                        _line(coefficient, source, "mu", colour),
                    ]
                    axle_sources.append(source)
            speed.y_range = _range([_column(x, "rim") for x in axle_sources], is_full=True)
            coefficient.y_range = _range([_column(x, "mu") for x in axle_sources])
            _legend(speed, items)
            sources[N] = [self._place(fig, f"axle-{N}-{i}") for i, fig in enumerate(figures)]
        return sources

    def of_bars(self, bars: campaign.Bars, place: str) -> str:
        """Percentiles of the adhesion coefficient of groups, side by side; returns the place."""
        axis = "datetime" if bars.dated else "linear"
        tools = "xpan,xwheel_zoom,reset,save"
        title = "Mean adhesion coefficient [-]"
        fig = _figure(title, 260, bars.label, tools, None, x_axis_type=axis)
        data = {name: [getattr(bar, name) for bar in bars.bars] for name in campaign.Bar._fields}
        data["left"] = [0.95 * bar.begin + 0.05 * bar.stop for bar in bars.bars]
        data["right"] = [0.05 * bar.begin + 0.95 * bar.stop for bar in bars.bars]
        data["centre"] = [0.5 * (bar.begin + bar.stop) for bar in bars.bars]
        if bars.named:
            fig.xaxis.ticker = models.FixedTicker(ticks=data["centre"])
            fig.xaxis.major_label_overrides = dict(zip(data["centre"], data["name"], strict=True))
        source = ColumnDataSource(data)
        fill = {"fill_color": palette.BLUE, "fill_alpha": 0.25, "line_color": None}
        span = fig.quad("left", "right", "upper", "lower", source=source, **fill)
        edge = {"line_color": palette.BLUE, "line_width": 2.5}
        middle = fig.segment("left", "middle", "right", "middle", source=source, **edge)
        items = {"5 % to 95 %": [span], "median": [middle]}
        if any(np.isfinite(data["slid"])):
            slid = fig.scatter("centre", "slid", source=source, size=9, color=palette.VERMILLION)
            items["median of those with slides"] = [slid]
        fig.y_range = Range1d(0.0, 1.05 * max(*data["upper"], *np.nan_to_num(data["slid"])) or 1.0)
        _legend(fig, items)
        tips = [(bars.label, "@name"), ("brake applications", "@number")]
        tips += [("5 %, median, 95 %", "@lower{0.000}, @middle{0.000}, @upper{0.000}")]
        fig.add_tools(models.HoverTool(renderers=[span], tooltips=tips))
        return self._place(fig, place)

    def of_stops(self, stops: Sequence[SeriesStop]) -> list[str]:
        """Deceleration over speed of all stops, and their distances; returns the places."""
        groups = list(dict.fromkeys(s.group for s in stops))
        over_speed = _figure("Deceleration [m/s²]", 280, "speed [km/h]")
        begins = [3.6 * s.stop.initial_speed_mps.value for s in stops if s.stop.initial_speed_mps]
        distances = _figure("Distance [m]", 260, "speed at the command [km/h]")
        if begins:  # stops from one speed are not spread over the figure
            distances.x_range = Range1d(min(begins) - _LEAST_SPREAD, max(begins) + _LEAST_SPREAD)
        shows_equivalent = all(s.measured(_EQUIVALENT) for s in stops if s.stop.valid)
        quantity = _EQUIVALENT if shows_equivalent else "mean_deceleration"
        title = "Equivalent deceleration" if shows_equivalent else "Mean deceleration"
        decelerations = _figure(f"{title} [m/s²]", 220, "stop")
        lines: dict[str, list[Any]] = {}
        points: dict[str, list[Any]] = {}
        highest = list[float]()  # deceleration of each stop but its rarest values
        for i, s in enumerate(stops, 1):
            colour = palette.nth(groups.index(s.group))
            if s.stop.speed is not None:
                speed, slowing = _deceleration(*s.stop.speed)
                if np.isfinite(slowing).any():
                    highest.append(float(np.nanquantile(slowing, 0.99)))
                source = ColumnDataSource({"v": _rounded(speed), "a": _rounded(slowing)})
                style = {"source": source, "color": colour, "line_width": 1.2}
                lines.setdefault(s.group, []).append(over_speed.line("v", "a", **style))
            if (v0 := s.stop.initial_speed_mps) and (distance := s.measured("distance_m")):
                renderers = _with_bar(distances, 3.6 * v0.value, distance, colour)
                points.setdefault(s.group, []).extend(renderers)
            if value := s.measured(quantity):
                points.setdefault(s.group, []).extend(_with_bar(decelerations, i, value, colour))
        over_speed.y_range = Range1d(0.0, 1.1 * (max(highest, default=1.0) or 1.0))
        _legend(over_speed, lines)
        _legend(distances, points)
        figures = {"stops-speed": over_speed, "stops-distance": distances, "stops": decelerations}
        return [self._place(fig, place) for place, fig in figures.items()]

    def figures_of(self, places: Iterable[str]) -> list[figure]:
        """The figures in these places."""
        return [self._places[place] for place in places]

    def library(self) -> str:
        """BokehJS, which draws them."""
        return "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw[:1])

    def as_json(self) -> str:
        """The document and where each of its figures goes, with ids that are always the same."""
        document = Document()
        with document.models.freeze():  # else each figure costs a walk through all of them
            for fig in self._places.values():
                document.add_root(fig)
        roots = {fig.id: place for place, fig in self._places.items()}
        page = {"doc": document.to_json(deferred=False), "roots": roots, "root_ids": list(roots)}
        text, names = json.dumps(page, separators=(",", ":")), dict[str, str]()
        # Numbered from the first: Bokeh counts on in a process.
        return _ID.sub(lambda found: names.setdefault(found[0], f'"m{len(names)}"'), text)

    # ---- figures

    def _overview(
        self, run: ReportRun, sources: Mapping[int, ColumnDataSource], time: Range1d
    ) -> list[str]:
        speed = self._figure("Speed [km/h]", 240, time)
        adhesion = self._figure("Adhesion coefficient [-]", 190, time)
        items: dict[str, list[Any]] = {}
        slides = merge_spans([span for axle in run.axles for span in _slides(axle)], _SHADES)
        for fig in (speed, adhesion):
            _shade(fig, slides)
        for i, (name, axles) in enumerate(_legend_of_axles(run)):
            for source in (sources[axle] for axle in axles):
                lines = ((speed, "rim"), (adhesion, "mu"))
                items.setdefault(name, []).extend(
                    [_line(fig, source, column, palette.nth(i), 1.3) for fig, column in lines]
                )
        if with_train := [a for a in run.axles if a.has_values("train")]:
            source = sources[with_train[0].number]
            items[run.train] = [_line(speed, source, "train", palette.BLACK, 2.0)]
        speed.y_range = _range([_column(s, "rim") for s in sources.values()], is_full=True)
        adhesion.y_range = _range([_braked(a, a.force) / a.weight for a in run.axles])
        _legend(speed, items)
        places = [self._place(speed, "overview-speed")]
        longest = max(run.axles, key=lambda axle: len(axle.t))
        train_states = [s for s in run.states if s.axle is None]
        places += self._states(train_states, time, "overview", longest.t)
        if any(axle.has_values("force") for axle in run.axles):
            places.append(self._place(adhesion, "overview-adhesion"))
        return places

    def _states(
        self, states: Sequence[LoggedState], time: Range1d, place: str, log_times: Floats
    ) -> list[str]:
        """What the switches, valves and commands did, then forces of motors and the reservoir."""
        lanes = [s for s in states if s.meaning in state_plots.TITLES]
        lanes.sort(key=lambda s: [*state_plots.TITLES].index(s.meaning))
        places = []
        if lanes:
            fig = self._figure("States", 0, time)
            _legend(fig, state_plots.draw_lanes(fig, lanes, log_times))
            places.append(self._place(fig, f"{place}-states"))
        for state in (s for s in states if s.meaning in _CURVES):
            title, scale, name = _CURVES[state.meaning]
            fig = self._figure(title, 110, time)
            values = state.value * scale
            indices = decimate.with_gaps(state.t, decimate.rows(state.t, [values], [], _POINTS))
            shown = np.where(indices < 0, np.nan, values[indices])
            source = ColumnDataSource({"t": _seconds(state.t, indices), "y": _rounded(shown)})
            _line(fig, source, "y", palette.GREEN)
            places.append(self._place(fig, f"{place}-{name}"))
        return places

    def _of_places(self, run: ReportRun) -> list[str]:
        """µ over the position, and the way as a map; nothing where no place is known."""
        figures = {}
        has_force = any(axle.has_values("force") for axle in run.axles)
        if run.route.position_from and has_force:
            fig = _figure("Adhesion coefficient [-]", 220, plane.position_label(run.route))
            _shade(fig, merge_spans(place_plots.slid_positions(run), _SHADES))
            by_number = {axle.number: axle for axle in run.axles}
            items: dict[str, list[Any]] = {}
            for i, (name, axles) in enumerate(_legend_of_axles(run)):
                for axle in (by_number[number] for number in axles):
                    renderers = place_plots.draw_over_position(fig, axle, run, palette.nth(i))
                    items.setdefault(name, []).extend(renderers)
            fig.y_range = _range([_braked(a, a.force) / a.weight for a in run.axles])
            _legend(fig, items)
            figures["places-adhesion"] = fig
        if run.route.lines():
            fig = _figure("north [km]", 420, "east [km]", drag="pan", match_aspect=True)
            _legend(fig, place_plots.draw_map(fig, run))
            figures["places-map"] = fig
        return [self._place(fig, place) for place, fig in figures.items()]

    def _axle(
        self, axle: ReportAxle, source: ColumnDataSource, time: Range1d, run: ReportRun
    ) -> list[str]:
        N, slides, train = axle.number, _slides(axle), run.train
        speed = self._figure("Speed [km/h]", 180, time)
        items = {"wheel": [_line(speed, source, "rim", palette.BLUE)]}
        if axle.has_values("train"):
            items[train] = [_line(speed, source, "train", palette.BLACK)]
        speed.y_range = _range([_column(source, "rim"), _column(source, "train")], is_full=True)
        _finish(speed, items, slides, source, "km/h", {train: "train", "wheel": "rim"})

        name, unit = ("Pressure", "bar") if axle.has_values("pressure") else ("K of the axle", "kN")
        brake = self._figure(f"{name} [{unit}]", 130, time)
        _line(brake, source, "brake", palette.GREEN)
        brake.y_range = _range([_column(source, "brake")], is_full=True)
        _finish(brake, {}, slides, source, unit, {name.lower(): "brake"})

        force = self._figure("Adhesion force [kN]", 230, time)
        band = force.varea("t", "lower", "upper", source=source, color=palette.GREY, alpha=0.35)
        items = {"95 % band": [band], "reference": [_line(force, source, "force", palette.BLACK)]}
        if axle.has_values("truth"):
            items["truth"] = [_line(force, source, "truth", palette.GREEN)]
        edges = (axle.lower, axle.upper, axle.force, axle.truth)
        force.y_range = _range([_braked(axle, edge) * 1e-3 for edge in edges])
        column_names = {"force": "force", "from": "lower", "to": "upper"}
        _finish(force, items, slides, source, "kN", column_names)
        figures = [speed, brake]
        if axle.has_values("force") or axle.has_values("truth"):
            figures.append(force)

        if any(np.isfinite(error).any() for error in axle.errors.values()):
            errors = self._figure("Estimator error [kN]", 190, time)
            columns = {algo: f"{_ERRORS}{algo}" for algo in axle.errors}
            items = {
                algo: [_line(errors, source, column, palette.of_method(algo), 1.1)]
                for algo, column in columns.items()
            }
            errors.y_range = _range([_braked(axle, e) * 1e-3 for e in axle.errors.values()])
            _finish(errors, items, slides, source, "kN", columns)
            figures.append(errors)
        figures[-1].xaxis.axis_label = "time after the start of the log [s]"
        figures[-1].height += 20
        places = [self._place(f, f"axle-{N}-{i}") for i, f in enumerate(figures)]
        states = [s for s in run.states if s.axle == N]
        places[1:1] = self._states(states, time, f"axle-{N}", axle.t)
        if axle.has_values("slip") and axle.has_values("force"):
            places.append(self._place(self._curve(axle), f"axle-{N}-curve"))
        return places

    def _curve(self, axle: ReportAxle) -> figure:
        """µ over slip while braked: where the wheel rolls, and where it slides."""
        fig = _figure("Adhesion coefficient [-]", 300, "slip [%]")
        braked = _inside(axle.t, [(o.start_s, o.end_s) for o in axle.applications])
        sliding = _inside(axle.t, _slides(axle))
        items = {}
        style = {"size": 4, "alpha": 0.6}
        for name, selected, colour in (
            ("wheel rolls", braked & ~sliding, palette.BLUE),
            ("wheel slides", braked & sliding, palette.VERMILLION),
        ):
            rows = np.flatnonzero(selected & np.isfinite(axle.slip) & np.isfinite(axle.force))
            if len(rows):
                rows = rows[:: -(-len(rows) // _POINTS)]
                slip, mu = 100.0 * axle.slip[rows], axle.force[rows] / axle.weight
                source = ColumnDataSource({"slip": _rounded(slip), "mu": _rounded(mu)})
                items[name] = [fig.scatter("slip", "mu", source=source, color=colour, **style)]
        _legend(fig, items)
        return fig

    def _figure(self, label: str, height: int, time: Range1d) -> figure:
        tools = "xbox_zoom,box_zoom,xpan,xwheel_zoom,reset,save"
        fig = _figure(label, height, "", tools, "xbox_zoom", x_range=time)
        fig.add_tools(models.CrosshairTool(overlay=self._cursor))
        return fig

    def _place(self, fig: figure, place: str) -> str:
        self._places[place] = fig
        return place


def _figure(
    label: str,
    height: int,
    x_label: str = "",
    tools: str = "box_zoom,pan,wheel_zoom,reset,save",
    drag: str | None = "box_zoom",
    **axes: Any,
) -> figure:
    fig = figure(
        height=height,
        sizing_mode="stretch_width",
        tools=tools,
        active_drag=drag,
        active_scroll=None,
        output_backend="canvas",
        **axes,
    )
    fig.xaxis.axis_label, fig.yaxis.axis_label = x_label, label
    fig.yaxis.ticker.desired_num_ticks = 5
    for axis in fig.axis:
        axis.minor_tick_line_color = None
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = _FONT
    fig.min_border_left = 70  # so that time stands at one place in all figures
    fig.min_border_right = 12
    fig.toolbar.logo = None
    fig.toolbar.autohide = True
    fig.outline_line_color = None
    fig.grid.grid_line_color = "#e6e6e6"
    return fig


def _legend(fig: figure, items: Mapping[str, Sequence[Any]]) -> None:
    if not items:
        return
    legend = models.Legend(
        items=[models.LegendItem(label=name, renderers=list(x)) for name, x in items.items()],
        orientation="horizontal",
        click_policy="hide",
        ncols=len(items) if sum(map(len, items)) + _SIGN * len(items) <= _NARROW else 3,
        border_line_color=None,
        padding=0,
        margin=2,
        label_text_font_size=_FONT,
        spacing=5,
        location="top_left",
    )
    fig.add_layout(legend, "above")


def _line(
    fig: figure, source: ColumnDataSource, column: str, colour: str, width: float = 1.4
) -> Any:
    return fig.line("t", column, source=source, color=colour, line_width=width)


def _finish(
    fig: figure,
    items: Mapping[str, Sequence[Any]],
    slides: Sequence[tuple[float, float]],
    source: ColumnDataSource,
    unit: str,
    column_names: Mapping[str, str],
) -> None:
    """Legend, the slides as shades, and values under the pointer."""
    lines = list(fig.renderers)
    _shade(fig, slides)
    _legend(fig, items)
    tips = [("time", "@t{0.00} s")]
    tips += [
        (name, f"@{column}{{0.00}} {unit}")
        for name, column in column_names.items()
        if column != "train" or np.isfinite(_column(source, column)).any()
    ]
    fig.add_tools(models.HoverTool(renderers=lines[-1:], tooltips=tips, mode="vline"))


def _shade(fig: figure, spans: Sequence[tuple[float, float]]) -> None:
    if spans:
        begins, stops = zip(*spans, strict=True)
        style = {"fill_color": palette.VERMILLION, "fill_alpha": _WEAK, "line_color": None}
        fig.vstrip(x0=list(begins), x1=list(stops), level="underlay", **style)


def _legend_of_axles(run: ReportRun) -> list[tuple[str, Sequence[int]]]:
    """The axles that have a colour, or of many the groups that have one: name and numbers."""
    if len(run.axles) > MANY_AXLES:
        first_group, *groups = group_numbers([axle.number for axle in run.axles], run.cars)
        return [(f"axles {first_group[0]}", first_group[1]), *groups]
    first, *others = (axle.number for axle in run.axles)
    return [(f"axle {first}", [first]), *((str(number), [number]) for number in others)]


# ---- data


def _source(axle: ReportAxle, limit: int, zero: float = 0.0) -> tuple[ColumnDataSource, float]:
    """The columns of an axle that are drawn over time, as many rows as there is room for.

    There are about `limit` numbers. Time counts from `zero`, after the log's start [s]. Returns as
    well the usual interval between rows in brake applications, 0 if all are there [s].
    """
    columns = {
        "rim": axle.rim * 3.6,
        "train": axle.train * 3.6,
        "brake": axle.pressure * 1e-5 if axle.has_values("pressure") else axle.clamping * 1e-3,
        "force": axle.force * 1e-3,
        "mu": axle.force / axle.weight,
        "lower": axle.lower * 1e-3,
        "upper": axle.upper * 1e-3,
        "truth": axle.truth * 1e-3,
        **{f"{_ERRORS}{algo}": error * 1e-3 for algo, error in axle.errors.items()},
    }
    empty = [name for name, c in columns.items() if not np.isfinite(c).any()]
    room = limit // (1 + len(columns) - len(empty))
    # What follows from another column, or from noise around it, does not choose the rows.
    judged = [columns[n] for n in columns if n not in (*empty, "mu", "lower", "upper", "truth")]
    braked = [(o.start_s - _MARGIN, o.end_s + _MARGIN) for o in axle.applications]
    chosen = decimate.rows(axle.t, judged, [_slides(axle), braked], room)
    has_band = np.isfinite(axle.lower) & np.isfinite(axle.upper)
    indices, flat = _edged(decimate.with_gaps(axle.t, chosen), has_band)
    data: dict[str, NDArray[np.float32]] = {"t": _seconds(axle.t - zero, indices)}
    for name, column in columns.items():
        if name not in empty:
            data[name] = _rounded(np.where(indices < 0, np.nan, column[indices]))
    if flat.any():
        data["upper"][flat] = data["lower"][flat]
    for name in {"rim", "train"} & set(empty):
        data[name] = np.full(len(indices), np.nan, np.float32)
    omitted = _inside(axle.t, braked).sum() - _inside(axle.t[chosen], braked).sum()
    steps = np.diff(axle.t[chosen])[_inside(axle.t[chosen[1:]], braked)]
    return ColumnDataSource(data), float(np.quantile(steps, 0.9)) if omitted else 0.0


def _deceleration(t: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Speed [km/h] and mean deceleration over a second [m/s²] of a stop."""
    half_window = min(0.5, 0.25 * float(t[-1] - t[0]))
    earlier_speed, later_speed = np.interp(t - half_window, t, v), np.interp(t + half_window, t, v)
    span = np.minimum(t + half_window, t[-1]) - np.maximum(t - half_window, t[0])
    shown_rows = slice(None, None, max(1, len(t) // _CURVE))
    return 3.6 * v[shown_rows], ((earlier_speed - later_speed) / span)[shown_rows]


def _with_bar(fig: figure, x: float, value: Measured, colour: str) -> list[Any]:
    style = {"color": colour, "line_width": 1.5}
    bar = fig.segment([x], [value.value - value.u95], [x], [value.value + value.u95], **style)
    return [bar, fig.scatter([x], [value.value], size=6, color=colour)]


def _edged(
    indices: decimate.Rows, finite: NDArray[np.bool_]
) -> tuple[decimate.Rows, NDArray[np.bool_]]:
    """The rows, with one more on each side of a stretch where the band is not known.

    Bokeh draws an area past points that are not known. It shows nothing there if the band has no
    height at both sides. A row of `indices` is −1 where a line is broken, `finite` says whether it
    has a band. Returns the rows with those at the sides twice, and whether a row is such a second
    one.
    """
    inner = np.flatnonzero((indices >= 0) & finite[indices])
    gaps = inner[:-1][np.diff(inner) > 1]
    begins = inner[1:][np.diff(inner) > 1]
    places = np.concatenate([gaps + 1, begins])
    order = np.argsort(places, kind="stable")
    values = indices[np.concatenate([gaps, begins])][order]
    flat = np.insert(np.zeros(len(indices), np.bool_), places[order], True)
    return np.insert(indices, places[order], values), flat


def _seconds(t: Floats, indices: decimate.Rows) -> Any:
    """Times, with that of the row before where a line is broken."""
    places = np.where(indices < 0, np.roll(indices, 1), indices)
    is_exact = not len(t) or t[-1] <= 8192.0  # to the millisecond
    return t[places].astype(np.float32 if is_exact else np.float64)


def _rounded(values: Floats) -> NDArray[np.float32]:
    """The values with the digits that a picture shows; what is not shown costs no space."""
    bits = np.ascontiguousarray(values, np.float32).view(np.uint32)
    rounding = np.uint32(1 << (22 - _BITS))
    mask = np.uint32(0xFFFFFFFF << (23 - _BITS) & 0xFFFFFFFF)
    return np.where(np.isfinite(values), (bits + rounding) & mask, bits).view(np.float32)


def _column(source: ColumnDataSource, name: str) -> Floats:
    return np.asarray(source.data.get(name, np.empty(0)), np.float64)


def _slides(axle: ReportAxle) -> list[tuple[float, float]]:
    slides = (x for application in axle.applications for x in application.slide_list)
    return [(x.start_s, x.start_s + x.duration_s) for x in slides]


def _inside(t: Floats, spans: Iterable[tuple[float, float]]) -> NDArray[np.bool_]:
    inside = np.zeros(len(t), np.bool_)
    for begin, stop in spans:
        inside |= (t >= begin) & (t <= stop)
    return inside


def _braked(axle: ReportAxle, column: Floats) -> Floats:
    """A column in brake applications, or all of it without one."""
    values: Floats = column[_inside(axle.t, [(o.start_s, o.end_s) for o in axle.applications])]
    return values if len(values) else column


def _range(columns: Sequence[Floats], is_full: bool = False) -> Range1d:
    """All values but the rarest spikes, and zero; with `is_full` all."""
    shares = [0.0, 1.0] if is_full else [_RARE, 1.0 - _RARE]
    extremes = [0.0]
    for values in (c[np.isfinite(c)] for c in columns):
        if len(values):
            extremes += np.quantile(values, shares).tolist()
    margin = 0.05 * (max(extremes) - min(extremes)) or 1.0
    return Range1d(min(extremes) - margin, max(extremes) + margin)


_FRAME = 60  # pixels around all figures


class Plot:
    """Figures below each other with one time axis; a notebook shows them.

    `axles` are drawn one by one; without any, speeds and µ of all together. `layout` is the Bokeh
    layout, as `bokeh.io.show` takes it.
    """

    def __init__(self, run: ReportRun, axles: Sequence[int] = ()) -> None:
        figures = Figures()
        figure_set = figures.of_run(run, axles)
        places = [place for axle in axles for place in figure_set.axles[axle]]
        figures_shown = figures.figures_of(places or figure_set.overview)
        self.layout: Any = layouts.column(figures_shown, sizing_mode="stretch_width")
        self._title = run.name
        self._height = _FRAME + sum(fig.height for fig in figures_shown)

    def html(self) -> str:
        """A page with the figures that needs no network and no other file."""
        return str(file_html(self.layout, INLINE, title=self._title))

    def write(self, place: Path | str) -> None:
        """Writes `html` to a file, whose old content is lost; raises OSError."""
        Path(place).write_bytes(self.html().encode())

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{self._height}px;border:0"
        return f'<iframe style="{style}" srcdoc="{escape(self.html())}"></iframe>'
