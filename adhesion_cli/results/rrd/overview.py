"""The first tab of several axles, or of several logs: all of them on common charts."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core import physics, rounding, text
from ...core.model import AxleResult, Floats, Result
from ...rail.events import Slide
from ...records.route import Route
from .. import palette, slip_text, train_stops
from . import parts

_SLIP = 3.0  # least range of slip [%]
_LISTED_SLIDES = 20  # slides that are listed


Slides = Mapping[int, Sequence[Slide]]  # of each axle, by its number
DrawnAxle = tuple[AxleResult, parts.DrawnRows]


def worst(slides: Sequence[Slide]) -> float:
    """The largest slip of an axle's slides; 0 without a slide."""
    return max((x.max_slip or 0.0 for x in slides), default=0.0)


def listed(slides: Slides, start_ns: int, route: Route) -> str:
    """Slides as Markdown, the deepest first, with the log's clock and places where it has them."""
    pairs = [(axle, slide) for axle, axle_slides in slides.items() for slide in axle_slides]
    pairs.sort(key=lambda pair: -(pair[1].max_slip or 0.0))
    rows = [slip_text.slide_row(*pair, start_ns, route) for pair in pairs[:_LISTED_SLIDES]]
    table = parts.markdown_table(rows)
    if len(pairs) > _LISTED_SLIDES:
        table += f"\n\n{len(pairs) - _LISTED_SLIDES} slides more are in the result file."
    return table


def send(
    rec: rr.RecordingStream,
    root: str,
    times: parts.Clock,
    result: Result,
    axles: Iterable[DrawnAxle],
) -> None:
    """Sends a line per axle and chart."""
    names: dict[str, int] = {}
    groups = _groups(result)
    for i, (axle, drawn_rows) in enumerate(axles):
        N, speed = axle.record.axle, axle.record.train_speed
        place, name = next((k, g) for k, (g, axles) in enumerate(groups) if N in axles)
        if speed is not None and i == 0:
            names["train"] = parts.TRAIN
            train = {"speed": speed * 3.6}
            line = "train", "train", parts.TRAIN
            _send(rec, f"{root}/all", times, drawn_rows, line, train)
        names[name] = palette.rgba(palette.nth(place))
        line = str(N), name, names[name]
        _send(rec, f"{root}/all", times, drawn_rows, line, _values(result, axle))
    parts.send_names(rec, f"{root}/lines/all", times, result.log.start_ns(), [*names.items()])


def _groups(result: Result) -> list[tuple[str, list[int]]]:
    """The axles that have a colour of their own, or of many the groups that have one."""
    numbers = [axle.record.axle for axle in result.axles]
    if len(numbers) <= train_stops.MANY_AXLES:
        return [(f"axle {number}", [number]) for number in numbers]
    cars = {axle.number: axle.car for axle in result.vehicle.axles}
    return [(f"axles {name}", axles) for name, axles in train_stops.group_numbers(numbers, cars)]


def _send(
    rec: rr.RecordingStream,
    path: str,
    times: parts.Clock,
    drawn_rows: parts.DrawnRows,
    line: tuple[str, str, int],
    values_by_chart: Mapping[str, Floats],
) -> None:
    """Sends a line of an axle into each chart; `line` is part of its entity, name and colour."""
    (key, name, colour), (t, index, inside) = line, drawn_rows
    for chart, values in values_by_chart.items():
        is_valid = (index >= 0) & (inside | (chart == "speed"))
        plot = parts.lines(key, [(name, colour, np.where(is_valid, values[index], np.nan))])
        parts.send_plot(rec, f"{path}/{chart}/{key}", times, t, plot)


def _values(result: Result, axle: AxleResult) -> dict[str, Floats]:
    """The values of an axle, (n,), by chart."""
    record, reference = axle.record, axle.reference
    mu, mu_sigma = (
        physics.coefficient(x, result.vehicle, record.axle)
        for x in (reference.force, reference.sigma)
    )
    columns = {
        "speed": record.wheel_speed * result.vehicle.radius(record.axle).value * 3.6,
        "force": rounding.rounded(reference.force / 1e3, reference.sigma / 1e3),
        "coefficient": rounding.rounded(mu, mu_sigma),
    }
    if axle.slip is not None:
        columns["slip"] = rounding.rounded(100.0 * axle.slip, 100.0 * rounding.SLIP)
    return columns


def titles(chart: str) -> dict[str, str]:
    """Quantity and unit of each chart; `chart` says whose force it is."""
    return {
        "speed": "speed [km/h]",
        "force": f"adhesion force, {chart} [kN]",
        "coefficient": "adhesion coefficient µ",
        "slip": "slip [%]",
    }


def _charts(
    path: str, axle_title: str, pairs: Sequence[tuple[Result, AxleResult]], slides: Sequence[Slide]
) -> list[rrb.View]:
    """A chart per quantity of some axles, on one time axis."""
    values = [_values(*pair) for pair in pairs]
    charts = []
    for name, title in titles("reference").items():
        pair = [v[name] for v in values if name in v and np.isfinite(v[name]).any()]
        if name == "slip":  # at the limit of observation a wheel can say anything
            top = max(100.0 * min(worst(slides), 1.0), _SLIP)
            span: tuple[float, float] | None = (-0.1 * top, 1.1 * top)
        else:
            span = parts.span_of([], pair) if name != "speed" else None
        if pair:
            charts.append(parts.chart(f"{path}/{name}", f"{axle_title}: {title}", span))
    return charts


def tab(root: str, result: Result, slides: Slides) -> rrb.Container:
    """Speeds, forces, coefficients and slips of all axles, one chart each."""
    all_slides = [x for axle_slides in slides.values() for x in axle_slides]
    charts = _charts(f"{root}/all", "All axles", [(result, a) for a in result.axles], all_slides)
    summary = rrb.TextDocumentView(origin=f"{root}/summary", name="Summary")
    rows = min(4 + len(result.axles), 20)  # of text: of 42 on a screen of 1080
    shares = [rows, 42 - rows]
    texts = rrb.Vertical(parts.names_view(f"{root}/lines/all"), summary, row_shares=shares)
    return rrb.Horizontal(rrb.Vertical(*charts), texts, column_shares=[2, 1], name="All axles")


class ComparedRun(NamedTuple):
    """A log among several."""

    name: str  # short
    result: Result
    times: parts.Clock  # of its time stamps
    slides: Slides
    axles: Sequence[DrawnAxle]


class ComparedRuns:
    """The first tab of several logs: laid over each other from the start of braking, by axles."""

    def __init__(self, runs: Sequence[ComparedRun]) -> None:
        self.runs = runs
        self.root = rr.new_entity_path([text.distinct([*(run.name for run in runs), "runs"])[-1]])
        self.axles = sorted({a.record.axle for run in runs for a in run.result.axles})

    def _slides(self, axle: int) -> list[Slide]:
        return [x for run in self.runs for x in run.slides.get(axle, ())]

    def send(self, rec: rr.RecordingStream) -> None:
        """Sends a line per log, axle and chart."""
        for i, run in enumerate(self.runs):
            for axle, drawn_rows in run.axles:
                path = f"{self.root}/axle/{axle.record.axle}"
                line = str(i + 1), run.name, palette.rgba(palette.nth(i))
                _send(rec, path, run.times, drawn_rows, line, _values(run.result, axle))
        names = [(run.name, palette.rgba(palette.nth(i))) for i, run in enumerate(self.runs)]
        times, start = self.runs[0].times, self.runs[0].result.log.start_ns()
        parts.send_names(rec, f"{self.root}/lines", times, start, names)

    def layout(self) -> rrb.Container:
        """A tab per axle; that of the worst slide is open."""
        tabs = []
        for N in self.axles:
            pairs = [(r.result, a) for r in self.runs for a in r.result.axles if a.record.axle == N]
            charts = _charts(f"{self.root}/axle/{N}", f"Axle {N}", pairs, self._slides(N))
            tabs.append(parts.named_charts(f"Axle {N}", charts, f"{self.root}/lines"))
        slides = [worst(self._slides(N)) for N in self.axles]
        return rrb.Tabs(*tabs, name="All logs", active_tab=slides.index(max(slides)))
