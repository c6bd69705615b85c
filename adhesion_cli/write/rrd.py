"""Results as a Rerun recording that opens in its own layout; the only module that knows Rerun.

The MCAP is the record; a recording is a view of it that opens only in a neighbouring version of the
viewer and can be made again. Everything is sent by columns.
"""

import hashlib
import math
import re
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from .. import physics
from ..model import AxleResult, Bools, Finding, Floats, Result, Score, Times
from ..slope import REGIONS
from ..stop import SLIDES, Stop
from ..text import printable
from . import names

OVERVIEW_FROM = 5_000_000  # points: above, the first tab shows a min/max overview
_OVERVIEW_ROWS = 20_000  # rows of an overview
_EVENT_WIDTH = 58  # letters of a line of an event: what the column beside the charts holds
_SCATTER = 20_000  # points of one slip-adhesion scatter
_POINTS = 4_000  # places of its moving operating point

_REFERENCE, _TRUTH = 0xC8C8C8FF, 0x54A24BFF
_TRAIN, _WHEEL, _PRESSURE, _CLAMPING = 0x9D9D9DFF, 0x4C9BE8FF, 0x4C9BE8FF, 0xF2A33AFF
_SLOPE = 0xF2A33AFF
_ESTIMATORS = (
    0x2F6FD0FF, 0xF2A33AFF, 0xE45756FF, 0xB98AE0FF, 0x3FBFB2FF,
    0xEBD03CFF, 0x6FB7FFFF, 0xA8794FFF, 0xE070E8FF, 0x7C83FFFF,
)  # fmt: skip
_LEVEL = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
_MARKDOWN = rr.MediaType.MARKDOWN
_ROWS = 1 << 16  # rows sent at once
_JUDGED = 1 << 18  # values of a series that its chart's range is judged by
_GLOBAL_VIEW = "view/5c0dca6a-e63f-9cf7-f657-2602590474cc"  # whose time axis linked views share


def write_result(
    path: Path, result: Result, algorithms: Sequence[str], notes: Sequence[str] = ()
) -> None:
    """Write one analysed log.

    Args:
        path: file to write; its old content is lost.
        result: the analysed log.
        algorithms: every estimator there is, in a fixed order: each keeps its colour whatever the
            selection.
        notes: on the slip of each axle; with them, slip is what is shown first.

    Raises:
        OSError: the file cannot be written or does not read back.
    """
    _write(path, [("", result)], algorithms, notes)


def write_comparison(path: Path, results: Sequence[Result], algorithms: Sequence[str]) -> None:
    """Write several analysed logs into one recording, each in a tab of its own.

    Time counts from each log's own brake start, so that they lie over one another.

    Args:
        path: file to write; its old content is lost.
        results: the analysed logs.
        algorithms: every estimator there is, in a fixed order.

    Raises:
        OSError: the file cannot be written or does not read back.
    """
    _write(path, list(zip(names.logs(results), results, strict=True)), algorithms)


def _write(
    path: Path, logs: list[tuple[str, Result]], algorithms: Sequence[str], notes: Sequence[str] = ()
) -> None:
    rr.set_strict_mode(True)  # otherwise a mistake is a warning and the data is missing
    known = [*algorithms, *sorted({a for _, r in logs for x in r.axles for a in x.estimates})]
    colours = _colours(known)
    pages = [_Page(name, result, colours, notes) for name, result in logs]
    identity = hashlib.sha256(" ".join(r.log.sha256 for _, r in logs).encode()).hexdigest()
    rec = rr.RecordingStream("adhesion", recording_id=f"adhesion-{identity[:16]}")
    try:
        rec.save(path, default_blueprint=_Layout(pages))
        rec.send_recording_name(", ".join(page.title for page in pages))
        rows = sum(page.send(rec) for page in pages)
        rec.flush()
    except RuntimeError as error:  # the binding's word for a file that cannot be written
        raise OSError(str(error)) from error
    finally:
        rec.disconnect()
    _verify(path, rows)


def _colours(algorithms: Sequence[str]) -> dict[str, int]:
    """A colour for each name, by the name: another estimator shifts only what it collides with.

    Where two names fall on one colour, the later in the alphabet moves on to the next free one.
    """
    places: dict[str, int] = {}
    n = len(_ESTIMATORS)
    for name in sorted(set(algorithms)):
        wanted = int(hashlib.sha256(name.encode()).hexdigest(), 16) % n
        taken = set(places.values())
        places[name] = next((p for i in range(n) if (p := (wanted + i) % n) not in taken), wanted)
    return {name: _ESTIMATORS[places[name]] for name in dict.fromkeys(algorithms)}


def _verify(path: Path, rows: int) -> None:
    """Read the file once: the SDK's writing thread keeps a full disk to itself."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a missing footer is only a warning
            chunks = RrdReader(path).stream().filter(is_static=False)
            found = sum(chunk.num_rows for chunk in chunks)
    except (RuntimeError, RerunWarning) as error:
        raise OSError(f"the recording does not read back as written ({error})") from error
    if found != rows:
        raise OSError(f"the recording does not read back as written ({found} of {rows} rows)")


# ---- what is drawn


@dataclass(frozen=True, slots=True)
class _Plot:
    """Series that share an entity: values of shape (n, k), as a band where `half` is given."""

    name: str
    series: tuple[str, ...]
    colours: tuple[int, ...]
    values: Floats
    half: Floats | None = None  # half width of a band around the values, shape (n, k)
    widths: tuple[float, ...] = ()


class _Page:
    """One log: its entities under `root` and the views that show them."""

    def __init__(
        self, name: str, result: Result, colours: dict[str, int], notes: Sequence[str]
    ) -> None:
        self.result, self.colours, self.notes = result, colours, notes
        self.title = printable(Path(result.log.path).name)
        self.root = rr.new_entity_path([name]) if name else ""
        started = [int(a.record.t[a.applications[0].start]) for a in result.axles if a.applications]
        self.start = result.log.start_ns()
        self.zero = min(started, default=self.start)  # brake start
        points = sum(len(a.record) * (2 * len(a.estimates) + 9) for a in result.axles)
        self.large = points > OVERVIEW_FROM

    # -- data

    def send(self, rec: rr.RecordingStream) -> int:
        """Send everything; returns the number of rows on a timeline."""
        rows = 0
        for n, axle in enumerate(self.result.axles):
            path = f"axle/{axle.record.axle}"
            t, index, inside = _rows(axle)
            span = -(-2 * len(t) // _OVERVIEW_ROWS)
            step = max(_ROWS // span, 1) * span
            for at in range(0, len(t), step):
                part = slice(at, at + step)
                for plot in self._plots(axle, index[part], inside[part]):
                    rows += self._send_plot(
                        rec, f"{self.root}/{path}/{plot.name}", t[part], plot, at == 0
                    )
                    if self.large:
                        whole = f"{self.root}/overview/{path}/{plot.name}"
                        rows += self._send_plot(
                            rec, whole, *_envelope(t[part], plot, span), at == 0
                        )
                rec.flush()  # or the SDK queues the whole log
            scores = rr.TextDocument("\n".join(_scores(axle.scores)), media_type=_MARKDOWN)
            rec.log(f"{self.root}/{path}/scores", scores, static=True)
            if axle.slip is not None:
                rows += self._send_slip(rec, f"{self.root}/{path}", axle, axle.slip)
                note = (
                    self.notes[n] if self.notes else "`adhesion slip` tells peak, rail and slides."
                )
                fixed = rr.TextDocument(note, media_type=_MARKDOWN)
                rec.log(f"{self.root}/{path}/note", fixed, static=True)
        rows += self._send_events(rec)
        for name, text in (
            ("summary", _summary(self.result)),
            ("about", _about(self.result, self.large)),
        ):
            rec.log(f"{self.root}/{name}", rr.TextDocument(text, media_type=_MARKDOWN), static=True)
        return rows

    def _times(self, t: Times) -> list[rr.TimeColumn]:
        columns = [rr.TimeColumn("time", duration=(t - self.zero).astype("timedelta64[ns]"))]
        if self.result.log.absolute:
            columns.append(rr.TimeColumn("clock", timestamp=t.astype("datetime64[ns]")))
        return columns

    def _plots(self, axle: AxleResult, index: NDArray[np.int64], inside: Bools) -> Iterator[_Plot]:
        """What is drawn of some rows, see `_rows`."""
        record, reference = axle.record, axle.reference

        def column(values: Floats, factor: float = 1.0) -> Floats:
            return np.where(index < 0, np.nan, values[index] * factor)

        def computed(values: Floats) -> Floats:
            return np.where(inside, column(values), np.nan)

        radius = self.result.vehicle.radius(record.axle).value
        speeds = [("wheel", _WHEEL, column(record.wheel_speed, radius * 3.6))]
        if record.train_speed is not None:
            speeds.insert(0, ("train", _TRAIN, column(record.train_speed, 3.6)))
        yield _lines("speed", speeds)
        brake = [("clamping force K [kN]", _CLAMPING, column(record.clamping_force, 1e-3))]
        if record.pressure is not None:
            bar = column(record.pressure, 1e-5)
            brake.insert(0, ("brake cylinder pressure [bar]", _PRESSURE, bar))
        yield _lines("braking", brake)

        lower, upper = computed(reference.lower), computed(reference.upper)
        yield _Plot(
            "force/band", ("95 % band",), (_REFERENCE,),
            (lower + upper)[:, None] / 2, (upper - lower)[:, None] / 2, (0.0,),
        )  # fmt: skip
        yield _Plot(
            "force/reference", ("reference ± 1 sigma",), (_REFERENCE,),
            computed(reference.force)[:, None], computed(reference.sigma)[:, None], (1.0,),
        )  # fmt: skip
        if record.truth is not None:
            yield _lines("force/truth", [("truth", _TRUTH, computed(record.truth))])
        algos = [a for a in self.colours if a in axle.estimates]
        estimates = [(a, self.colours[a], computed(axle.estimates[a])) for a in algos]
        errors = [
            (a, self.colours[a], np.where(inside, axle.error(a, index), np.nan)) for a in algos
        ]
        if algos:
            yield _lines("force/estimates", estimates)
            yield _lines("error", errors)
        if axle.slope is not None and axle.slope_confidence is not None:
            yield _lines("slope", [("slope dµ/ds", _SLOPE, computed(axle.slope))])
            sure = computed(axle.slope_confidence)
            yield _lines("confidence", [("confidence", _REFERENCE, sure)])

    def _send_plot(
        self, rec: rr.RecordingStream, path: str, t: Times, plot: _Plot, first: bool
    ) -> int:
        style = rr.SeriesLines if plot.half is None else rr.Measurements.from_fields
        series, colours = list(plot.series), np.array(plot.colours, np.uint32)
        if first:
            rec.log(
                path, style(names=series, colors=colours, widths=list(plot.widths)), static=True
            )
        if plot.half is None:
            data = rr.Scalars.columns(scalars=plot.values)
        else:
            data = rr.Measurements.columns(
                values=plot.values.ravel(), variances=plot.half.ravel() ** 2
            )
        rec.send_columns(path, self._times(t), data)
        return len(t)

    def _send_slip(self, rec: rr.RecordingStream, path: str, axle: AxleResult, slip: Floats) -> int:
        """The operating point on its curve; brake, region and wheel as states."""
        mu = physics.coefficient(axle.reference.force, self.result.vehicle)
        bands = self.result.settings.get("bands", {})
        edges = [bands[k] for k in ("slip_low", "slip_high") if k in bands]
        rows = _send_curve(rec, f"{path}/slip", self._times, axle.record.t, slip, mu, edges)
        t, index, inside = _rows(axle)
        n = len(axle.record)
        braked, slides = np.zeros(n, np.int8), np.zeros(n, np.int8)
        for s in axle.applications:
            braked[physics.pressed(axle.record, s)[0]] = 1
        for e in axle.events:
            if e.until is not None:
                slides[(axle.record.t >= e.t) & (axle.record.t <= e.until)] = SLIDES
        region = np.zeros(n, np.int8) if axle.region is None else axle.region
        for name, codes, states in (
            ("brake", braked, _BRAKE), ("region", region, _REGIONS), ("wheel", slides, _WHEELS),
        ):  # fmt: skip
            shown = np.where(inside, codes[index], -1)
            lane = f"{path}/state/{name}"
            rows += _send_states(rec, lane, self._times, t, shown, states)
        return rows

    def _send_events(self, rec: rr.RecordingStream) -> int:
        events = [
            (self.start + round((f.first_s or 0.0) * 1e9), _LEVEL[f.severity], _finding(f))
            for f in self.result.findings
        ]
        for axle in self.result.axles:
            for s in axle.applications:
                on, gone = physics.pressed(axle.record, s)
                for i, what in ((on.start, "applied"), (on.stop - 1, "released"))[: 1 + gone]:
                    text = f"axle {axle.record.axle}: brake {what}"
                    events.append((int(axle.record.t[i]), "INFO", text))
            events += [(x.t, "INFO", x.message) for x in axle.events]
        if not events:
            return 0
        events.sort(key=lambda e: e[0])
        times, levels, texts = zip(*events, strict=True)
        told = [
            textwrap.fill(f"{(t - self.zero) / 1e9:+.2f} s  {text}", _EVENT_WIDTH)
            for t, text in zip(times, texts, strict=True)
        ]
        data = rr.TextLog.columns(text=told, level=levels)
        rec.send_columns(f"{self.root}/events", self._times(np.array(times, np.int64)), data)
        return len(events)

    # -- layout

    def layout(self) -> rrb.Container:
        """Tabs: one per axle, then the summary; a second set of axles with full data if large."""
        tabs = [self._axle_tab(a, "overview/" if self.large else "") for a in self.result.axles]
        if self.large:
            full = [self._axle_tab(a, "") for a in self.result.axles]
            tabs.append(rrb.Tabs(*full, name="Full data"))
        summary = rrb.Horizontal(
            rrb.TextDocumentView(origin=f"{self.root}/summary", name="Scores and findings"),
            self._about(),
            name="Summary",
        )
        return rrb.Tabs(*tabs, summary, name=self.title)

    def _axle_tab(self, axle: AxleResult, prefix: str) -> rrb.Container:
        N = axle.record.axle
        path, exact = f"{self.root}/{prefix}axle/{N}", f"{self.root}/axle/{N}"
        against = "truth" if any(s.against == "truth" for s in axle.scores) else "reference"
        reference, estimates = axle.reference, axle.estimates
        force = _span([reference.lower, reference.upper], list(estimates.values()))
        rows = [
            _chart(f"{path}/speed", f"Axle {N}: speed [km/h]", legend="RightTop"),
            _chart(f"{path}/braking", f"Axle {N}: pressure [bar], clamping force [kN]"),
            _chart(f"{path}/force", f"Axle {N}: adhesion force [N]", force),
        ]
        shares = [3.0, 3.0, 6.0]
        if estimates:
            braking = np.concatenate([np.arange(s.start, s.stop) for s in _applications(axle)])
            braking = braking[:: max(1, len(braking) // _JUDGED)]
            error = _span([], [axle.error(a, braking) for a in estimates])
            title = f"Axle {N}: estimate minus {against} [N]"
            rows.append(_chart(f"{path}/error", title, error, legend=None))
            shares.append(3.0)
        title = f"Axle {N} (overview)" if prefix else f"Axle {N}"
        forces = rrb.Horizontal(
            rrb.Vertical(*rows, row_shares=shares),
            rrb.Vertical(
                rrb.TextDocumentView(origin=f"{exact}/scores", name=f"Axle {N}: scores"),
                self._events(), self._about(), row_shares=[2.5, 4.0, 5.0],
            ),
            column_shares=[7, 3], name=title if axle.slip is None else "Force",
        )  # fmt: skip
        if axle.slip is None:
            return forces
        slip = self._slip_tab(axle, path, exact)
        return rrb.Tabs(forces, slip, active_tab=1 if self.notes else 0, name=title)

    def _slip_tab(self, axle: AxleResult, path: str, exact: str) -> rrb.Container:
        N = axle.record.axle
        rows: list[rrb.View] = [
            _chart(f"{path}/speed", f"Axle {N}: speed [km/h]", legend="RightTop"),
            _chart(f"{path}/braking", f"Axle {N}: pressure [bar], clamping force [kN]"),
        ]
        shares = [3.0, 3.0]
        if axle.slope is not None:
            rows += _slope_charts(path, f"Axle {N}", axle.slope)
            shares += [2.5, 1.5]
        rows.append(_states(f"{exact}/state", f"Axle {N}: brake, region on the curve, wheel"))
        return rrb.Horizontal(
            rrb.Vertical(*rows, row_shares=[*shares, 3.0]),
            rrb.Vertical(
                _curve_view(f"{exact}/slip", f"Axle {N}"),
                rrb.TextDocumentView(origin=f"{exact}/note", name=f"Axle {N}: rail and slides"),
                self._events(), row_shares=[5.0, 3.0, 3.0],
            ),
            column_shares=[6, 4], name="Slip",
        )  # fmt: skip

    def _about(self) -> rrb.View:
        return rrb.TextDocumentView(origin=f"{self.root}/about", name="How this was made")

    def _events(self) -> rrb.View:
        columns = rrb.TextLogColumns(
            timeline_columns=[rrb.encodings.TimelineColumn("time", visible=False)],  # in the body
            text_log_columns=["LogLevel", "Body"],
        )
        return rrb.TextLogView(origin=f"{self.root}/events", name="Events", columns=columns)


def _lines(name: str, columns: list[tuple[str, int, Floats]], width: float = 1.5) -> _Plot:
    series, colours, values = zip(*columns, strict=True)
    matrix = np.stack(values, axis=1)
    return _Plot(name, series, colours, matrix, widths=(width,) * len(series))


def _rows(axle: AxleResult) -> tuple[Times, NDArray[np.int64], Bools]:
    """Rows to draw: each sample, and one without values wherever a segment begins or ends.

    Returns:
        time [ns], index into the record's columns (−1 for a break), and whether the row lies in a
        segment; shape (m,).
    """
    t = axle.record.t
    inside = np.zeros(len(t), bool)
    for s in axle.record.segments:
        inside[s] = True
    bounds = {b for s in axle.record.segments for b in (s.start, s.stop)} - {0, len(t)}
    edges = np.array(sorted(bounds), np.int64)
    index = np.insert(np.arange(len(t)), edges, -1)
    return np.insert(t, edges, t[edges - 1] + 1), index, np.insert(inside, edges, False)


def _envelope(t: Times, plot: _Plot, step: int) -> tuple[Times, _Plot]:
    """The lowest and the highest value of each span of `step` rows, as two rows a span."""
    at = np.arange(0, len(t), step)
    below, above = plot.values, plot.values
    if plot.half is not None:
        below, above = below - plot.half, above + plot.half
    low = np.fmin.reduceat(below, at, axis=0)  # fmin, fmax pass over NaN
    high = np.fmax.reduceat(above, at, axis=0)
    values, half = np.stack([low, high], axis=1).reshape(-1, low.shape[1]), None
    if plot.half is not None:
        values, half = (
            np.repeat((low + high) / 2, 2, axis=0),
            np.repeat((high - low) / 2, 2, axis=0),
        )
    middle = np.minimum(at + step // 2, len(t) - 1)
    return np.stack([t[at], t[middle]], axis=1).ravel(), replace(plot, values=values, half=half)


_Clock = Callable[[Times], list[rr.TimeColumn]]
_State = tuple[str, int]  # name and colour
_OFF = 0x4A4E54FF  # of a state in which nothing is the matter
_BRAKE: tuple[_State, ...] = (("released", _OFF), ("applied", 0x4C78A8FF))
_REGIONS: tuple[_State, ...] = tuple(
    zip(REGIONS, (_OFF, 0x4C78A8FF, 0x54A24BFF, 0xE45756FF), strict=True)
)
_WHEELS: tuple[_State, ...] = (("rolls", _OFF), ("slides", 0xF2A33AFF), ("locked", 0xE45756FF))
_VALVES: tuple[_State, ...] = (("apply", 0x54A24BFF), ("hold", 0xF2A33AFF), ("vent", 0xE45756FF))


def _send_states(
    rec: rr.RecordingStream, path: str, times: _Clock, t: Times, codes: NDArray[np.int8],
    states: Sequence[_State],
) -> int:  # fmt: skip
    """States by their code, −1 for none, a row per change; returns how many."""
    names_, colours = zip(*states, strict=True)
    style = rr.StateConfiguration(values=list(names_), colors=np.array(colours, np.uint32))
    rec.log(path, style, static=True)
    at = np.flatnonzero(np.diff(codes, prepend=-2))
    told = [states[c][0] if c >= 0 else "" for c in codes[at].tolist()]
    rec.send_columns(path, times(t[at]), rr.StateChange.columns(state=told))
    return len(at)


# ---- views


class _Layout(rrb.Blueprint):
    """The whole window: paused, side panels shut, every chart on the same time axis, all of it."""

    def __init__(self, pages: "Sequence[_Page | _Stops]") -> None:
        layouts = [page.layout() for page in pages]
        super().__init__(
            layouts[0] if len(layouts) == 1 else rrb.Tabs(*layouts),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="collapsed", timeline="time", play_state="paused"),
            auto_views=False,
            auto_layout=False,
        )

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        # Linked charts take the range of a view that has no name in the API; the default of that
        # one is half a minute around the cursor.
        super()._log_to_stream(stream)
        everything = rr.encodings.TimeRange(
            start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite()
        )
        stream.log(f"{_GLOBAL_VIEW}/TimeAxis", rrb.TimeAxis(view_range=everything))


def _chart(
    origin: str,
    name: str,
    span: tuple[float, float] | None = None,
    *,
    legend: Literal["LeftTop", "RightTop"] | None = "LeftTop",
) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=origin, name=name, axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(corner=legend, visible=legend is not None),
    )  # fmt: skip


def _slope_charts(path: str, who: str, slope: Floats) -> list[rrb.View]:
    """Slope and confidence; the steep slopes, at next to no slip, would flatten the rest."""
    known = slope[np.isfinite(slope)]
    ends = np.quantile(known, [0.05, 0.9]) if len(known) else np.zeros(2)
    span = _span([np.clip(ends, -5.0, 5.0), np.array([-0.2, 0.2])], [])
    return [
        _chart(f"{path}/slope", f"{who}: slope of µ over slip", span, legend=None),
        _chart(f"{path}/confidence", f"{who}: confidence in it", (0.0, 1.05), legend=None),
    ]


def _states(origin: str, name: str) -> rrb.View:
    axis = rrb.TimeAxis(link="LinkToGlobal")
    return rrb.StateTimelineView(origin=origin, name=name, time_view=axis)


def _curve_view(origin: str, who: str) -> rrb.View:
    return rrb.Spatial2DView(
        origin=origin, name=f"{who}: adhesion coefficient µ over slip [%]",
        visual_bounds=_bounds(), background=_BACKGROUND,
    )  # fmt: skip


def _applications(axle: AxleResult) -> Sequence[slice]:
    return axle.applications or (slice(0, len(axle.record)),)


def _span(whole: Sequence[Floats], most: Sequence[Floats]) -> tuple[float, float] | None:
    """Range of a chart: all of some series, and of others all but their rarest spikes.

    The viewer's own range leaves out the bands, and one wild sample flattens everything else.
    """

    def ends(values: Floats, quantiles: list[float]) -> Floats:
        finite = values[np.isfinite(values)]
        return np.quantile(finite, quantiles) if len(finite) else np.empty(0)

    extremes = [ends(v, [0.0, 1.0]) for v in whole]
    extremes += [ends(v[:: max(1, len(v) // _JUDGED)], [0.001, 0.999]) for v in most]
    every = np.concatenate([*extremes, [0.0]])
    low, high = float(every.min()), float(every.max())
    margin = 0.05 * (high - low)
    return (low - margin, high + margin) if margin > 0.0 else None


# ---- slip over adhesion: Rerun has no such chart, so its axes are drawn as lines and labels

_WIDTH, _HEIGHT = 150.0, 100.0  # of the plotted area, in scene units; y points down
_LEAST, _MOST = -0.1, 1.0  # slips shown; a wheel at the limit of observation can say anything
_BACKGROUND = [16, 18, 20]
_Place = Callable[[Floats, Floats], Floats]  # slip and µ to points of the picture, shape (n, 2)
_AGES = ([70, 70, 255], [110, 200, 210], [230, 150, 70])  # red, green, blue over time


def _bounds() -> rrb.VisualBounds2D:
    return rrb.VisualBounds2D(x_range=[-18, _WIDTH + 8], y_range=[-_HEIGHT - 14, 24])


def _send_scatter(rec: rr.RecordingStream, path: str, slip: Floats, mu: Floats) -> _Place:
    """Points of µ over slip on their axes; returns where in the picture a slip and a µ lie."""
    known = np.flatnonzero(np.isfinite(slip) & np.isfinite(mu))
    shown = known[(slip[known] >= _LEAST) & (slip[known] <= _MOST)]
    outside = len(known) - len(shown)
    shown = shown[:: max(1, -(-len(shown) // _SCATTER))]
    s, mu = slip[shown] * 100.0, mu[shown]

    xs, ys = _ticks(s, 5.0), _ticks(mu, 0.05)

    def x(value: Floats) -> Floats:
        return np.interp(value, xs[[0, -1]], [0.0, _WIDTH])

    def y(value: Floats) -> Floats:
        return np.interp(value, ys[[0, -1]], [0.0, -_HEIGHT])

    grid = [[(a, 0), (a, -_HEIGHT)] for a in x(xs)] + [[(0, b), (_WIDTH, b)] for b in y(ys)]
    rec.log(f"{path}/grid", rr.LineStrips2D(grid, colors=0x4A4A4AFF, radii=0.15), static=True)
    texts = [f"{v:g}" for v in xs] + [f"{v:g}" for v in ys]
    places = [(a, 5.0) for a in x(xs)] + [(-8.0, b) for b in y(ys)]
    notes, spots = ["blue: start of the log, yellow: end"], [(_WIDTH / 2, 14.0)]
    if outside:
        notes.append(f"{outside} points outside {_LEAST:.0%} to {_MOST:.0%} slip not shown")
        spots.append((_WIDTH / 2, -_HEIGHT - 9.0))
    labels = rr.Points2D(
        [*places, *spots], labels=[*texts, *notes], radii=0.0, show_labels=True, colors=0xD0D0D0FF
    )
    rec.log(f"{path}/labels", labels, static=True)
    age = np.linspace(0.0, 1.0, len(s))
    colours = np.stack([np.interp(age, [0.0, 0.5, 1.0], c) for c in _AGES], axis=1)
    points = rr.Points2D(np.stack([x(s), y(mu)], 1), radii=0.45, colors=colours.astype(np.uint8))
    rec.log(f"{path}/points", points, static=True)
    return lambda slip, mu: np.stack([x(slip * 100.0), y(mu)], axis=-1)


def _send_curve(
    rec: rr.RecordingStream, path: str, times: _Clock, t: Times, slip: Floats, mu: Floats,
    edges: Sequence[float],
) -> int:  # fmt: skip
    """The scatter, the edges of the slip band and the operating point as it moves.

    Returns:
        How many rows on a timeline.
    """
    place = _send_scatter(rec, path, slip, mu)
    strips = [place(np.full(2, s), np.array([0.0, math.inf])) for s in edges]
    lines = rr.LineStrips2D(strips, colors=_REGIONS[2][1], radii=0.3)
    rec.log(f"{path}/band", lines, static=True)
    at = np.flatnonzero(np.isfinite(slip) & np.isfinite(mu))
    at = at[:: max(1, -(-len(at) // _POINTS))]
    style = rr.Points2D.from_fields(radii=1.8, colors=0xFFFFFFFF)
    rec.log(f"{path}/now", style, static=True)
    if len(at):
        points = rr.Points2D.columns(positions=place(slip[at], mu[at]))
        rec.send_columns(f"{path}/now", times(t[at]), points)
    return len(at)


def _ticks(values: Floats, least: float) -> Floats:
    """Round numbers around the values, zero among them, at least `least` apart in total."""
    low = min(0.0, float(values.min(initial=0.0)))
    high = max(least, float(values.max(initial=0.0)))
    rough = (high - low) / 5
    step = 10.0 ** math.floor(math.log10(rough))
    step *= next(m for m in (1.0, 2.0, 5.0, 10.0) if m * step >= rough)
    return np.arange(math.floor(low / step), math.ceil(high / step) + 1, dtype=np.float64) * step


# ---- text


def _summary(result: Result) -> str:
    lines = [f"# {_plain(Path(result.log.path).name)}", ""]
    lines += ["## Findings", ""]
    lines += [f"- **{f.severity}** {_plain(_finding(f))}" for f in result.findings] or ["none"]
    for axle in result.axles:
        lines += ["", f"## Axle {axle.record.axle}", "", *_scores(axle.scores)]
    return "\n".join(lines)


def _about(result: Result, large: bool) -> str:
    methods = sorted({a.reference.method for a in result.axles})
    lines = [
        "## What the lines mean",
        "",
        "Grey is the reference: the wide band holds the truth with 95 %, vehicle tolerances "
        "included; the narrow one is one sigma of its noise. Green is the truth, where the log "
        "has it. Each estimator has its own colour everywhere. A gap in a line is a gap in the "
        "data.",
        "",
        "Time counts from the first brake application; the timeline `clock` is the log's own.",
        "",
        f"Reference: {', '.join(map(_plain, methods))}.",
        "",
        *([_OVERVIEW, ""] if large else []),
        "## Settings",
        "",
        "| setting | value |",
        "|---|---|",
        *(f"| {_plain(k)} | {_plain(v)} |" for k, v in names.flat(result.settings).items()),
        "",
        "## Sources",
        "",
        *(f"- {_plain(s)}" for s in result.sources),
        "",
        f"SHA-256 of the log: `{result.log.sha256}`",
    ]
    return "\n".join(lines)


_OVERVIEW = (
    f"The log is long: the overviews show the lowest and the highest value of each of "
    f"{_OVERVIEW_ROWS // 2} spans of time, the tab Full data every sample."
)


def _scores(scores: Sequence[Score]) -> list[str]:
    head = ["estimator", "against", "RMSE [N]", "bias [N]", "max error [N]", "lag [s]", "gain",
            "response [s]", "relative"]  # fmt: skip
    rows = [
        [
            _plain(s.algo), s.against, _number(s.rmse_n, 1), _number(s.bias_n, 1),
            _number(s.max_error_n, 0), _number(s.lag_s, 2), _number(s.gain, 3),
            _number(s.response_s, 2), _number(s.relative, 2),
        ]
        for s in sorted(scores, key=lambda s: math.inf if s.rmse_n is None else s.rmse_n)
    ]  # fmt: skip
    return ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _finding(finding: Finding) -> str:
    where = f"{finding.channel}: " if finding.channel else ""
    often = f" ({finding.count} ×)" if finding.count > 1 else ""
    return printable(f"{finding.code}: {where}{finding.message}{often}")


def _plain(text: str) -> str:
    """Text from a log that must not become markup, a link or a picture."""
    return re.sub(r"([\\`*_{}\[\]()<>#+!|~&:-])", r"\\\1", printable(text))


# ---- stops in closed loop


def write_stops(
    path: Path, name: str, stops: Sequence[Stop], weight: float, band: tuple[float, float],
    verdict: str,
) -> None:  # fmt: skip
    """Write stops of one train under several controllers, side by side, a tab for each axle.

    Args:
        path: file to write; its old content is lost.
        name: of the scenario.
        stops: one per controller.
        weight: of an axle on the rail [N].
        band: least and most slip of the band that is drawn [-].
        verdict: text of the first tab.

    Raises:
        OSError: the file cannot be written or does not read back.
    """
    rr.set_strict_mode(True)
    page = _Stops(stops, weight, band, verdict)
    key = repr([name, *((s.controller, s.seed, s.air, len(s.t)) for s in stops)])
    identity = hashlib.sha256(key.encode()).hexdigest()
    rec = rr.RecordingStream("adhesion", recording_id=f"adhesion-{identity[:16]}")
    try:
        rec.save(path, default_blueprint=_Layout([page]))
        rec.send_recording_name(printable(name))
        rows = page.send(rec)
        rec.flush()
    except RuntimeError as error:  # the binding's word for a file that cannot be written
        raise OSError(str(error)) from error
    finally:
        rec.disconnect()
    _verify(path, rows)


class _Stops:
    """Stops under several controllers and the views that show them."""

    def __init__(
        self, stops: Sequence[Stop], weight: float, band: tuple[float, float], verdict: str
    ) -> None:
        self.stops, self.weight, self.band, self.verdict = stops, weight, band, verdict

    def send(self, rec: rr.RecordingStream) -> int:
        """Send everything; returns the number of rows on a timeline."""
        fixed = f"```\n{self.verdict}\n```"
        rec.log("verdict", rr.TextDocument(fixed, media_type=_MARKDOWN), static=True)
        rows = 0
        for n, stop in enumerate(self.stops):
            train = [(stop.controller, _ESTIMATORS[n], stop.train_speed * 3.6)]
            rows += _send_lines(rec, "train", stop.t, _lines(stop.controller, train))
            for i in range(stop.pressure.shape[1]):
                rows += self._send_axle(rec, f"{stop.controller}/axle/{i + 1}", stop, i)
        return rows

    def _send_axle(self, rec: rr.RecordingStream, path: str, stop: Stop, i: int) -> int:
        speeds = [
            ("train", _TRAIN, stop.train_speed * 3.6), ("wheel", _WHEEL, stop.rim_speed[:, i] * 3.6)
        ]  # fmt: skip
        pressures = [
            ("without controller", _REFERENCE, stop.demand * 1e-5),
            ("cylinder", _PRESSURE, stop.pressure[:, i] * 1e-5),
        ]
        forces = [
            ("most the rail gives", _REFERENCE, stop.peak[:, i]),
            ("true", _TRUTH, stop.force[:, i]),
            (f"estimated ({stop.algo})", _CLAMPING, stop.estimate[:, i]),
        ]
        rows = 0
        for plot in (
            _lines("speed", speeds), _lines("pressure", pressures), _lines("force", forces),
            _lines("slope", [("slope dµ/ds", _SLOPE, stop.slope[:, i])]),
            _lines("confidence", [("confidence", _REFERENCE, stop.confidence[:, i])]),
        ):  # fmt: skip
            rows += _send_lines(rec, path, stop.t, plot)

        for name, codes, states in (
            ("valve", stop.valve, _VALVES), ("region", stop.region, _REGIONS),
            ("wheel", stop.sliding(), _WHEELS),
        ):  # fmt: skip
            lane = f"{path}/state/{name}"
            rows += _send_states(rec, lane, _since_start, stop.t, codes[:, i], states)

        slip, mu = stop.slip[:, i], stop.force[:, i] / self.weight
        return rows + _send_curve(rec, f"{path}/slip", _since_start, stop.t, slip, mu, self.band)

    def layout(self) -> rrb.Container:
        """Tabs: the verdict, then one per axle with a column per controller."""
        first = rrb.Vertical(
            rrb.TextDocumentView(origin="verdict", name="Verdict"),
            _chart("train", "Train speed [km/h]", legend="RightTop"),
            row_shares=[1.0, 2.0],
            name="Verdict",
        )
        axles = self.stops[0].pressure.shape[1]
        return rrb.Tabs(first, *(self._axle_tab(i + 1) for i in range(axles)))

    def _axle_tab(self, axle: int) -> rrb.Container:
        columns = []
        for stop in self.stops:
            path, who = f"{stop.controller}/axle/{axle}", stop.controller
            views = [
                _chart(f"{path}/speed", f"{who}: speed [km/h]", legend="RightTop"),
                _chart(f"{path}/pressure", f"{who}: pressure [bar]", legend="RightTop"),
                _states(f"{path}/state", f"{who}: valves, region on the curve, wheel"),
                _chart(f"{path}/force", f"{who}: adhesion force [N]", legend="RightTop"),
                *_slope_charts(path, who, stop.slope[:, axle - 1]),
                _curve_view(f"{path}/slip", who),
            ]
            columns.append(rrb.Vertical(*views, row_shares=[2.5, 2.0, 2.6, 2.0, 2.0, 1.4, 4.0]))
        return rrb.Horizontal(*columns, name=f"Axle {axle}")


def _send_lines(rec: rr.RecordingStream, path: str, t: Times, plot: _Plot) -> int:
    colours = np.array(plot.colours, np.uint32)
    style = rr.SeriesLines(names=list(plot.series), colors=colours, widths=list(plot.widths))
    rec.log(f"{path}/{plot.name}", style, static=True)
    data = rr.Scalars.columns(scalars=plot.values)
    rec.send_columns(f"{path}/{plot.name}", _since_start(t), data)
    return len(t)


def _since_start(t: Times) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("time", duration=t.astype("timedelta64[ns]"))]
