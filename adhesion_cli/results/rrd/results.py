"""Analysed logs: a tab for each axle with its forces, and its slip where it has one."""

import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from ...core import finding, model, physics, rounding, signals
from ...core.model import AxleResult, Floats, Result, Times
from ...core.physics import LOCKED, SLIDES
from ...core.summary import ResultSummary, summarise_vehicle
from ...core.text import printable
from ...rail import fit, locks, sliding
from ...rail.slope import Bands
from ...records.route import find_route
from ...scores.metrics import pool_scores
from ...stops.settings import StopSettings
from .. import log_events, names, palette, result_rows, text_tables, thinning, train_stops
from ..application_tables import application_tables, stop_table
from ..vehicle_text import describe_vehicle
from . import curve, glyphs, line_views, overview, parts

_EVENT_WIDTH = 88  # letters of a line of an event: what the column beside the charts holds
_LEVEL = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
_ON = 0.5  # a state is 0 or 1
_SWITCHED: tuple[model.Meaning, ...] = (
    "emergency",
    "hold_valve",
    "vent_valve",
    "wsp_active",
    "sanding",
)
_MOST_LEVELS = 8  # of a command that are states of their own
_ROWS = 1 << 16  # rows sent at once
Note = tuple[str, fit.RailFit | None]
_StateLane = tuple[str, NDArray[np.int8], parts.States]  # name, codes (n,), states
_NO_NOTE: Note = "`adhesion slip` shows peak, rail and slides.", None


def write_results(
    path: Path,
    results: Sequence[Result],
    notes: Sequence[Note] = (),
    summaries: Sequence[ResultSummary] = (),
) -> None:
    """Write analysed logs into one recording.

    Several are laid over each other in the first tab, and each has its own tab. On the timeline
    `brake`, which is then shown, time counts from each log's own brake start. `notes` are on the
    slip of each axle of one log, with its rail; with them, slip is shown first.
    """
    names_of_logs = glyphs.drawable_names(names.logs(results)) if len(results) > 1 else [""]
    pages = [
        _Page(name, result, notes, summary)
        for name, result, summary in zip_longest(names_of_logs, results, summaries)
    ]
    title = ", ".join(page.title for page in pages)
    identity = " ".join(page.result.log.sha256 for page in pages)
    if len(pages) == 1:
        parts.write(path, title, identity, pages)
        return
    runs = overview.ComparedRuns([page.run for page in pages])
    parts.write(path, title, identity, [runs, *pages], "brake")


class _Page:
    """One log: its entities under `root` and the views that show them."""

    def __init__(
        self,
        name: str,
        result: Result,
        notes: Sequence[Note],
        summary: ResultSummary | None,
    ) -> None:
        self.result, self.notes, self.summary = result, notes, summary
        (self.title,) = glyphs.drawable_names([printable(Path(result.log.path).name)])
        self.root = rr.new_entity_path([name]) if name else ""
        self.zeros = {"time": result.log.start_ns()}
        if name:  # the logs of a comparison, by their own brakes
            self.zeros["brake"] = result.brake_ns()
        self.axles = [(a, self._drawn_rows(a)) for a in self.result.axles]
        self.slides = {a.record.axle: sliding.slides(a) for a in self.result.axles}
        self.route = find_route(result.log)
        bars = line_views.find_bars(self.result, self.route, self.slides)
        self.bars = bars if len(bars.position) else None
        self.run = overview.ComparedRun(name, self.result, self.times, self.slides, self.axles)
        self.thinned = any(map(thinning.needs_thinning, self.result.axles))
        self.lists: dict[str, list[model.Event]] = {}  # by the list's entity
        for x in log_events.of_result(result):
            kind = "findings" if x.code in finding.catalogue() else "events"
            series_path = f"/{kind}/log" if x.axle is None else f"/{kind}/axle/{x.axle}"
            self.lists.setdefault(series_path, []).append(x)
        bands_table = result.settings.get("bands")
        self.bands = Bands(**bands_table) if bands_table else None

    # -- data

    def send(self, rec: rr.RecordingStream) -> None:
        """Send everything."""
        for n, (axle, drawn_rows) in enumerate(self.axles):
            path = f"axle/{axle.record.axle}"
            lines = self._send_lines(rec, path, axle, drawn_rows)
            entity, start = f"{self.root}/lines/{path}", self.zeros["time"]
            parts.send_names(rec, entity, self.times, start, [*lines.items()])
            parts.send_text(rec, f"{self.root}/{path}/scores", _scores(axle.scores))
            if axle.slip is not None:
                note, rail = self.notes[n] if self.notes else _NO_NOTE
                self._send_slip(rec, f"{self.root}/{path}", axle, axle.slip, rail)
                parts.send_text(rec, f"{self.root}/{path}/note", note)
            self._send_states(rec, f"{self.root}/{path}", axle)
        if len(self.result.axles) > 1:
            overview.send(rec, self.root, self.times, self.result, self.axles)
        slides = [x for of_axle in self.slides.values() for x in of_axle]
        if self.bars is not None:
            line_views.send_chart(rec, f"{self.root}/line", self.bars)
        line_views.send_map(rec, f"{self.root}/map", self.times, self.route, slides)
        self._send_lists(rec)
        parts.send_text(rec, f"{self.root}/summary", self._summary_text())
        parts.send_text(rec, f"{self.root}/about", _about(self.result, self.thinned))

    def _send_lines(
        self, rec: rr.RecordingStream, path: str, axle: AxleResult, drawn_rows: parts.DrawnRows
    ) -> dict[str, int]:
        """The charts of an axle, by parts of a long log; returns names and colours of forces."""
        t, index, inside = drawn_rows
        lines: dict[str, int] = {}
        for offset in range(0, len(t), _ROWS):
            piece = slice(offset, offset + _ROWS)
            for plot in self._plots(axle, index[piece], inside[piece]):
                full_path = f"{self.root}/{path}/{plot.name}"
                parts.send_plot(rec, full_path, self.times, t[piece], plot, offset == 0)
                if plot.name.startswith("force/"):
                    lines |= zip(plot.series, plot.colours, strict=True)
            rec.flush()  # or the SDK queues the whole log
        return lines

    def _drawn_rows(self, axle: AxleResult) -> parts.DrawnRows:
        """The rows that are drawn: of a long log those that its results have, and each break."""
        all_rows = parts.rows_of_axle(axle)
        if not thinning.needs_thinning(axle):
            return all_rows
        return all_rows.select(thinning.keep_mask(axle, all_rows.t) | (all_rows.row < 0))

    def times(self, t: Times) -> list[rr.TimeColumn]:
        """Time stamps on each timeline."""
        since = {name: (t - zero).astype("timedelta64[ns]") for name, zero in self.zeros.items()}
        columns = [rr.TimeColumn(name, duration=duration) for name, duration in since.items()]
        if self.result.log.absolute:
            columns.append(rr.TimeColumn("clock", timestamp=t.astype("datetime64[ns]")))
        return columns

    def _measured(
        self, record: model.AxleRecord, column: Callable[[Floats, float], Floats]
    ) -> Iterator[parts.SeriesPlot]:
        radius = self.result.vehicle.radius(record.axle).value
        phi = self.result.vehicle.of_axle(record.axle).friction.value
        K = record.clamping_force if self._shows_clamping(record) else None
        speeds = [
            ("train", parts.TRAIN, record.train_speed, 3.6),
            ("wheel", parts.WHEEL, record.wheel_speed, 3.6 * radius),
        ]
        braking = [
            ("brake cylinder pressure [bar]", parts.PRESSURE, record.pressure, 1e-5),
            ("clamping force K of the axle [10 kN]", parts.CLAMPING, K, 1e-4),
            (f"{_motors_title(record)} [10 kN]", parts.MOTORS, record.motor_clamping, 1e-4 * phi),
        ]
        for chart, lines in (("speed", speeds), ("braking", braking)):
            known_lines = [(name, c, column(x, k)) for name, c, x, k in lines if x is not None]
            yield parts.lines(chart, known_lines)

    def _shows_clamping(self, record: model.AxleRecord) -> bool:
        """Whether K is known: logged, or from the pressure by a known vehicle."""
        return record.pressure is None or self.result.identified.known

    def _plots(
        self, axle: AxleResult, index: NDArray[np.int64], inside: model.Bools
    ) -> Iterator[parts.SeriesPlot]:
        """What is drawn of some rows, see `parts.DrawnRows`."""
        record, reference = axle.record, axle.reference

        def column(values: Floats, factor: float = 1.0) -> Floats:
            return np.where(index < 0, np.nan, values[index] * factor)

        def computed(values: Floats) -> Floats:
            return np.where(inside, column(values), np.nan)

        noise = column(reference.sigma)

        def force(values: Floats, sigma: Floats = noise) -> Floats:
            return rounding.rounded(computed(values), sigma)

        yield from self._measured(record, column)
        lower, upper = computed(reference.lower), computed(reference.upper)
        middle = rounding.rounded((lower + upper) / 2, noise)
        half_width = rounding.digits((upper - lower) / 2)
        band = "95 % band", parts.REFERENCE, middle, half_width
        yield parts.bands("force/band", [band])
        sigma = rounding.digits(computed(reference.sigma))
        band = "reference ± 1 sigma", parts.REFERENCE, force(reference.force), sigma
        yield parts.bands("force/reference", [band], 1.0)
        if record.truth is not None:
            yield parts.lines("force/truth", [("truth", parts.TRUTH, force(record.truth))])
        estimates, errors, bands = [], [], []
        for algo in sorted(axle.estimates):
            colour = palette.rgba(palette.of_method(algo))
            F = force(axle.estimates[algo], column(axle.sigma(algo)))
            error = rounding.rounded(axle.error(algo, index), noise)
            estimates.append((algo, colour, F))
            errors.append((algo, colour, np.where(inside, error, np.nan)))
            if algo in axle.sigmas:
                half_width = rounding.digits(model.Z95 * computed(axle.sigmas[algo]))
                bands.append((f"{algo}: own 95 % band", colour, F, half_width))
        if bands:
            yield parts.bands("force/own", bands)
        if estimates:
            yield parts.lines("force/estimates", estimates)
            yield parts.lines("error", errors)
        if axle.slope is not None and axle.slope_confidence is not None:
            slope = rounding.digits(computed(axle.slope))
            yield parts.lines("slope", [("slope dµ/ds", parts.SLOPE, slope)])
            confidence = rounding.digits(computed(axle.slope_confidence))
            yield parts.lines("confidence", [("confidence", parts.REFERENCE, confidence)])

    def _send_slip(
        self,
        rec: rr.RecordingStream,
        path: str,
        axle: AxleResult,
        slip: Floats,
        rail: fit.RailFit | None,
    ) -> None:
        vehicle = self.result.vehicle.of_axle(axle.record.axle)
        mu = physics.coefficient(axle.reference.force, vehicle, axle.record.axle)
        t, times, bands = axle.record.t, self.times, self.bands
        fitted = (rail, vehicle) if rail else None
        curve.send_curve(rec, f"{path}/slip", times, t, slip, mu, bands, fitted=fitted)
        if axle.slope is not None and bands:
            parts.send_band(rec, f"{path}/slope", times, t, bands.slope_low, bands.slope_high)

    def _send_states(self, rec: rr.RecordingStream, path: str, axle: AxleResult) -> None:
        """The brake and the logged states; of an axle with slip its region and its wheel, too."""
        n, drawn_rows = len(axle.record), parts.rows_of_axle(axle)
        braked = np.zeros(n, np.int8)
        for s in axle.applications:
            braked[signals.pressed_part(axle.record, s)[0]] = 1
        slip_states = [] if axle.slip is None else self._slip_states(axle)
        for name, codes, states in (
            ("brake", braked, parts.BRAKE),
            *slip_states,
            *_logged_states(self.result.log, axle.record),
        ):
            drawn_codes = np.where(drawn_rows.inside, codes[drawn_rows.row], -1)
            parts.send_states(
                rec, f"{path}/state/{name}", self.times, drawn_rows.t, drawn_codes, states
            )

    def _slip_states(self, axle: AxleResult) -> list[_StateLane]:
        """The region on the curve, and whether the wheel rolls."""
        n = len(axle.record)
        slides = np.zeros(n, np.int8)
        for e in axle.events:
            if e.until is not None:
                slides[(axle.record.t >= e.t) & (axle.record.t <= e.until)] = SLIDES
        radius = self.result.vehicle.radius(axle.record.axle).value
        limits = StopSettings(**self.result.settings.get("stops", {})).locks
        for lock in locks.locks_of_axle(axle.record, radius, limits):
            slides[lock.samples] = LOCKED
        slides[signals.standing(axle.record) & (slides == 0)] = parts.STANDS
        region = np.zeros(n, np.int8) if axle.region is None else axle.region
        return [("region", region, parts.REGION_STATES), ("wheel", slides, parts.WHEELS)]

    def _send_lists(self, rec: rr.RecordingStream) -> None:
        """Findings and events; each text wrapped: the viewer shows only the first line of a row."""
        for path, list_text in self.lists.items():
            rows = []
            for x in sorted(list_text, key=lambda e: e.t):
                code = f"{x.code}: " if x.code in finding.catalogue() else ""
                text = f"{(x.t - self.zeros['time']) / 1e9:.2f} s  {code}{x.message}"
                lines = textwrap.wrap(text, _EVENT_WIDTH, subsequent_indent=" " * 6)
                rows += [(x.t, _LEVEL[x.severity], glyphs.drawable(line)) for line in lines]
            times, levels, texts = zip(*rows, strict=True)
            data = rr.TextLog.columns(text=texts, level=levels)
            rec.send_columns(f"{self.root}{path}", self.times(np.array(times, np.int64)), data)

    def _summary_text(self) -> str:
        """Vehicle, stops, brake applications, slides, findings and scores as Markdown."""
        result, tables = self.result, list[text_tables.TitledTable]()
        if self.summary:
            cars = {axle.number: axle.car for axle in result.vehicle.axles}
            tables = [*stop_table([self.summary]), *application_tables([self.summary], cars=cars)]
        entries = [
            f"- **{f.severity}** {parts.escape_markdown(f'{f.code}: {log_events.text(f)}')}"
            for f in result.findings
        ]
        axles = self.summary.axles if self.summary else ()
        lines = [
            f"# {parts.escape_markdown(self.title)}\n",
            describe_vehicle(summarise_vehicle(result.identified), axles),
            *map(parts.titled, tables),
            "\n## Each slide\n",
            overview.listed(self.slides, result.log.start_ns(), self.route),
            "\n## Findings\n",
            *(entries or ["none"]),
        ]
        if len(result.axles) > train_stops.MANY_AXLES:
            pooled = pool_scores(axle.scores for axle in result.axles)
            lines.append(f"\n## All axles\n\n{_scores(pooled)}")
        else:
            lines += [f"\n## Axle {a.record.axle}\n\n{_scores(a.scores)}" for a in result.axles]
        return "\n".join(lines)

    # -- layout

    def layout(self) -> rrb.Container:
        """Tabs: all axles, one per axle, summary, settings."""
        axles = sorted(self.result.axles, key=lambda a: a.record.axle)
        slides = [overview.worst(self.slides[a.record.axle]) for a in axles]
        tabs: list[rrb.Container | rrb.View] = [self._axle_tab(a) for a in axles]
        if len(axles) > 1:
            tabs.insert(0, overview.tab(self.root, self.result, self.slides))
        places: list[rrb.View] = []
        if self.bars is not None:
            places.append(line_views.chart_view(f"{self.root}/line", self.route))
        if self.route.lines():
            places.append(line_views.map_view(f"{self.root}/map"))
        if places:
            tabs.append(rrb.Vertical(*places, row_shares=[1, 2][: len(places)], name="On the line"))
        for entity, name in (("summary", "Summary"), ("about", "How this was made, settings")):
            tabs.append(rrb.TextDocumentView(origin=f"{self.root}/{entity}", name=name))
        # the worst slip of an axle, where asked for
        tab = 1 + slides.index(max(slides)) if self.notes and len(axles) > 1 else 0
        return rrb.Tabs(*tabs, name=self.title, active_tab=tab)

    def _axle_tab(self, axle: AxleResult) -> rrb.Container:
        N = axle.record.axle
        path = f"{self.root}/axle/{N}"
        reference, estimates = axle.reference, axle.estimates
        force = parts.span_of([], list(estimates.values()), [reference.lower, reference.upper])
        chart = parts.chart(f"{path}/force", f"Axle {N}: adhesion force [N]", force)
        rows, shares = self._inputs(path, axle), [3.0, 4.2]
        if _is_known([reference.force, *estimates.values()]):
            rows.append(chart)
            shares.append(5.0)  # 1 bar of 7 needs 24 px for its number, on a screen of 1080
        if _is_known(estimates.values()):
            braking = np.r_[axle.applications or (slice(0, len(axle.record)),)]
            braking = braking[:: max(1, len(braking) // parts.JUDGED)]
            error = parts.span_of([], [axle.error(a, braking) for a in estimates])
            against = next((s.against for s in axle.scores), "reference")
            title = f"Axle {N}: estimate minus {against} [N]"
            rows.append(parts.chart(f"{path}/error", title, error))
            shares.append(3.0)
        if logged := self._logged_names(axle):
            names_of_states = ["brake", *logged]
            contents = [f"$origin/{name}/**" for name in names_of_states]
            states = f"Axle {N}: {', '.join(names_of_states)}"
            rows.append(parts.states_view(f"{path}/state", states, contents))
            shares.append(2.1 + 0.9 * len(logged))
        forces = rrb.Horizontal(
            rrb.Vertical(*rows, row_shares=shares),
            rrb.Vertical(
                rrb.TextDocumentView(origin=f"{path}/scores", name=f"Axle {N}: scores"),
                parts.names_view(f"{self.root}/lines/axle/{N}"),
                *self._lists(N),
                row_shares=[2.9, 2.9, 2.1, 2.1],
            ),
            column_shares=[2, 1],
            name=f"Axle {N}" if axle.slip is None else "Force",
        )
        if axle.slip is None:
            return forces
        slip = self._slip_tab(axle, path)
        return rrb.Tabs(forces, slip, active_tab=1 if self.notes else 0, name=f"Axle {N}")

    def _slip_tab(self, axle: AxleResult, path: str) -> rrb.Container:
        N = axle.record.axle
        rows, shares = self._inputs(path, axle), [2.7, 4.0]
        if axle.slope is not None:
            rows += parts.slope_charts(path, f"Axle {N}", axle.slope, self.bands)
            shares += [2.3, 1.5]
        heights = [4.5, 4.5, 1.5, 1.5] if self.notes else [4.5, 1.0, 2.8, 2.8]
        logged = self._logged_names(axle)
        states = f"Axle {N}: {', '.join(['brake', 'region on the curve', 'wheel', *logged])}"
        rows.append(parts.states_view(f"{path}/state", states))
        return rrb.Horizontal(
            rrb.Vertical(*rows, row_shares=[*shares, 3.0 + len(logged)]),
            rrb.Vertical(
                curve.curve_view(f"{path}/slip", f"Axle {N}"),
                rrb.TextDocumentView(origin=f"{path}/note", name=f"Axle {N}: rail and slides"),
                *self._lists(N),
                row_shares=heights,
            ),
            column_shares=[6, 4],
            name="Slip",
        )

    def _inputs(self, path: str, axle: AxleResult) -> list[rrb.View]:
        record, title = axle.record, f"Axle {axle.record.axle}"
        speeds = "speed [km/h]" + ", blue: wheel, grey: train" * (record.train_speed is not None)
        brakes = ["blue: pressure [bar]"] * (record.pressure is not None)
        if self._shows_clamping(record):
            brakes.append("orange: clamping force K of the axle, all pads [10 kN]")
        if record.motor_clamping is not None:
            brakes.append(f"green: {_motors_title(record)} [10 kN]")
        charts = (("speed", speeds), ("braking", ", ".join(brakes)))
        return [parts.chart(f"{path}/{name}", f"{title}: {text}") for name, text in charts]

    def _logged_names(self, axle: AxleResult) -> list[str]:
        return [name for name, *_ in _logged_states(self.result.log, axle.record)]

    def _lists(self, axle: int) -> list[rrb.View]:
        contents = [f"$origin/{list_name}" for list_name in ("log", f"axle/{axle}")]
        return [
            parts.list_view(f"{self.root}/{kind}", f"Axle {axle}: {kind}", contents)
            for kind in ("findings", "events")
        ]


def _logged_states(log: model.Log, record: model.AxleRecord) -> Iterator[_StateLane]:
    """Commands, valves of an axle, WSP and sanding, where the log has them."""
    on = {
        meaning: _sampled(channel.data, record.t) > _ON
        for meaning in _SWITCHED
        if (channel := log.find(meaning, record.axle)) is not None
    }
    if command := log.find("brake_command", record.axle):
        yield "command", *_levels(_sampled(command.data, record.t), command.levels)
    if "emergency" in on:
        yield "emergency", on["emergency"].astype(np.int8), parts.SWITCHES
    codes: dict[model.Meaning, int] = {"hold_valve": 1, "vent_valve": 2}
    valves = [code * on[name] for name, code in codes.items() if name in on]
    if valves:
        yield "valve", np.max(valves, axis=0).astype(np.int8), parts.VALVES
    for name, meaning in (("WSP", "wsp_active"), ("sanding", "sanding")):
        if meaning in on:
            yield name, on[meaning].astype(np.int8), parts.SWITCHES


def _levels(values: Floats, words: Sequence[str]) -> tuple[NDArray[np.int8], parts.States]:
    """The codes of a command's values, shape (n,), and its states: one for each of a few values."""
    distinct_values = np.unique([0.0, *values])
    if len(distinct_values) > _MOST_LEVELS:
        return (values > 0.0).astype(np.int8), parts.SWITCHES
    by_value = {float(k): word for k, word in enumerate(words) if word}
    names = [by_value.get(x, f"{x:g}") for x in distinct_values.tolist()]
    if len(names) == len(parts.SWITCHES) and not words:
        names = [name for name, _ in parts.SWITCHES]
    return np.searchsorted(distinct_values, values).astype(np.int8), parts.level_states(names)


def _sampled(column: model.Column, t: Times) -> Floats:
    """The last value of a state at each time, shape (n,); 0 before the first."""
    is_usable = column.valid & np.isfinite(column.value)
    values = np.concatenate([[0.0], column.value[is_usable]])
    return values[np.searchsorted(column.t[is_usable], t, side="right")]


def _motors_title(record: model.AxleRecord) -> str:
    return "ED force at the rim" + ", traction below 0" * record.traction_known


def _is_known(columns: Iterable[Floats]) -> bool:
    return any(np.isfinite(column).any() for column in columns)


# ---- text


_LINES = """
The 95 % band of the reference holds the truth with 95 %, vehicle tolerances included. Each
estimator has its own colour everywhere. A gap in a line is a gap in the data, or the clock was set
back: the line goes on where its times are new.

Time counts from the start of the log, as on the screen and in the findings. The timeline `clock` is
the log's own. In a comparison, `brake` counts from the first brake application of each log.
"""
_THINNED = f"""
Every sample is drawn in brake applications and slides and {thinning.AROUND / 1e9:g} s around them.
Between them one sample of each {thinning.SAMPLE_INTERVAL / 1e9:g} s is drawn.
"""


def _about(result: Result, thinned: bool) -> str:
    methods = sorted({a.reference.method for a in result.axles})
    lines = [
        f"Reference: {', '.join(map(parts.escape_markdown, methods))}.",
        _LINES,
        _THINNED * thinned,
        parts.settings_table(result.settings),
        "\n## Sources\n",
        *(f"- {parts.escape_markdown(s)}" for s in result.sources),
        f"\nSHA-256 of the log: `{result.log.sha256}`",
    ]
    return "\n".join(lines)


def _scores(scores: Sequence[model.Score]) -> str:
    """Scores as Markdown, the best first; a column without values would push others out of view."""
    scores = sorted(scores, key=lambda s: math.inf if s.rmse_n is None else s.rmse_n)
    rows = [
        {"method": "", "against": s.against} | row
        for s, row in zip(scores, result_rows.score_rows(scores), strict=True)
    ]
    return parts.markdown_table(rows)
