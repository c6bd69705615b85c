"""What every recording is made of: one way to write it, charts, states, the window's layout."""

import hashlib
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings
from numpy.typing import NDArray

from ...core.model import AxleResult, Bools, Floats, Times
from ...core.text import printable
from ...core.toml import Table
from ...rail.slope import REGION_TITLES, Bands
from .. import names, palette, text_tables
from .glyphs import drawable

REFERENCE = TRAIN = palette.rgba(palette.LIGHT)
TRUTH = palette.rgba(palette.YELLOW)
WHEEL = PRESSURE = palette.rgba(palette.SKY)
CLAMPING = SLOPE = palette.rgba(palette.ORANGE)
MOTORS = palette.rgba(palette.GREEN)
_CELL = 200  # letters of a setting that are shown; the result file has all
JUDGED = 1 << 18  # values of a series that its chart's range is judged by
GLOBAL_VIEW = "view/5c0dca6a-e63f-9cf7-f657-2602590474cc"  # whose time axis linked views share


class Page(Protocol):
    """What a recording shows: its data and the views of them."""

    def send(self, rec: rr.RecordingStream) -> None:
        """Sends everything."""

    def layout(self) -> rrb.Container:
        """The views."""


def write(
    path: Path, name: str, source_identity: str, pages: Sequence[Page], timeline: str = "time"
) -> None:
    """Writes a recording, a tab for each page; `source_identity` tells it from others."""
    rr.set_strict_mode(True)  # otherwise a mistake is a warning and the data is missing
    identity = hashlib.sha256(source_identity.encode()).hexdigest()
    layout = Layout([page.layout() for page in pages], timeline)
    with path.open("wb") as file:
        rec = RecordingInFile(file, f"adhesion-{identity[:16]}")
        rec.send_blueprint(layout, make_active=False, make_default=True)
        layout.disconnect()
        rec.send_recording_name(name)
        for page in pages:
            page.send(rec)
        rec.end()
        del rec
    # The SDK keeps the data of ended recordings, some MB each, until it is told to look for them.
    rerun_bindings.flush_and_cleanup_orphaned_recordings()


# An .rrd stream: its header, then messages, each after its kind and length; the last is its end.
_STREAM_HEADER = 12  # bytes
_MESSAGE = struct.Struct("<QQ")
_END = 0  # the kind of the last message
_MOST_WAITING = 128 << 20  # bytes of data that may wait until the file gets them


class RecordingInFile(rr.RecordingStream):
    """A recording in a file that we write.

    The SDK's own file would not report a full disk, and the SDK waits for ever after one. A short
    recording is written at its end, with the footer by which a reader finds its parts. A long one
    is written bit by bit and has no footer, as with the SDK's `write_footer` off: memory is
    bounded.
    """

    def __init__(self, file: BinaryIO, recording_id: str | None = None) -> None:
        super().__init__("adhesion", recording_id=recording_id)
        self._file, self._stream = file, rr.binary_stream(self)
        self._has_header, self._waiting = False, 0

    def send_columns(  # type: ignore[override]
        self, path: str, times: Any, columns: Any, **options: Any
    ) -> None:
        """As of the SDK; where much waits, it goes into the file."""
        rr.send_columns(path, times, columns, **options, recording=self)
        self._waiting += sum(column.as_arrow_array().nbytes for column in columns)
        if self._waiting > _MOST_WAITING:
            self.write()

    def write(self) -> None:
        """Appends to the file what was sent since the last call, and no footer; raises OSError.

        Each read of the SDK's stream is a whole recording. Its header goes into the file once, and
        its end never.
        """
        self._append(footer=False)

    def end(self) -> None:
        """Writes the rest, with a footer where this is all; raises OSError."""
        self._append(footer=not self._has_header)
        self.disconnect()

    def _append(self, footer: bool) -> None:
        data, self._waiting = memoryview(self._stream.read() or b""), 0
        start = _STREAM_HEADER if self._has_header else 0
        end = _STREAM_HEADER
        while end < len(data):
            kind, length = _MESSAGE.unpack_from(data, end)
            if kind == _END:
                end = len(data) if footer else end
                break
            end += _MESSAGE.size + length
        while start < end <= len(data):
            start += self._file.write(data[start:end])
            self._has_header = True


# ---- data


@dataclass(frozen=True, slots=True)
class SeriesPlot:
    """Series of one entity: values of shape (n, k), as a band where `half_width` is given."""

    name: str
    series: tuple[str, ...]
    colours: tuple[int, ...]
    values: Floats
    half_width: Floats | None = None  # half width of a band around the values, shape (n, k)
    widths: tuple[float, ...] = ()


def lines(name: str, columns: list[tuple[str, int, Floats]], width: float = 1.5) -> SeriesPlot:
    """Plain lines, each of (what the legend says, colour, values of shape (n,))."""
    series, colours, values = zip(*columns, strict=True)
    matrix = np.stack(values, axis=1)
    return SeriesPlot(name, series, colours, matrix, widths=(width,) * len(series))


Band = tuple[str, int, Floats, Floats]  # name, colour, middle and half width, (n,) each


def bands(name: str, columns: Sequence[Band], width: float = 0.0) -> SeriesPlot:
    """Bands, each with a line of this width in its middle."""
    series, colours, values, half_widths = zip(*columns, strict=True)
    middle, half_width = np.stack(values, axis=1), np.stack(half_widths, axis=1)
    return SeriesPlot(name, series, colours, middle, half_width, (width,) * len(series))


def send_text(rec: rr.RecordingStream, path: str, text: str) -> None:
    """Sends a text in Markdown."""
    rec.log(path, rr.TextDocument(drawable(text), media_type=rr.MediaType.MARKDOWN), static=True)


def escape_markdown(text: str) -> str:
    """Text from a log that must not become markup, a link or a picture."""
    return re.sub(r"([\\`*_{}\[\]()<>#+!|~&:-])", r"\\\1", printable(text))


def markdown_table(rows: Sequence[Mapping[str, str]]) -> str:
    """Rows with the same keys, which are the header; without rows it says so."""
    if not rows:
        return "none"
    cells = [[*rows[0]], ["---"] * len(rows[0])]
    cells += [[escape_markdown(cell) for cell in row.values()] for row in rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in cells)


def titled(x: text_tables.TitledTable) -> str:
    """A table under its title as Markdown."""
    body = [x.lead, *([markdown_table(x.rows)] if x.rows else []), *x.note.splitlines()]
    return "\n\n".join([f"\n## {x.title}", *filter(None, body)])


def settings_table(settings: Table) -> str:
    """Nested settings as Markdown, a row each; a long list is cut off."""
    rows = [
        {"setting": name, "value": value if len(value) <= _CELL else f"{value[:_CELL]} …"}
        for name, value in names.flat(dict(settings)).items()
    ]
    return f"## Settings\n\n{markdown_table(rows)}"


Clock = Callable[[Times], list[rr.TimeColumn]]


def send_plot(
    rec: rr.RecordingStream,
    path: str,
    times: Clock,
    t: Times,
    plot: SeriesPlot,
    styled: bool = True,
) -> None:
    """Sends a plot, and with `styled` what it looks like."""
    if styled:
        style = rr.SeriesLines if plot.half_width is None else rr.Measurements.from_fields
        series, colours = list(plot.series), np.array(plot.colours, np.uint32)
        rec.log(path, style(names=series, colors=colours, widths=list(plot.widths)), static=True)
    if plot.half_width is None:
        data = rr.Scalars.columns(scalars=plot.values)
    else:
        values, variances = plot.values.ravel(), plot.half_width.ravel() ** 2
        data = rr.Measurements.columns(values=values, variances=variances)
    rec.send_columns(path, times(t), data)


def send_names(
    rec: rr.RecordingStream, path: str, times: Clock, t: int, names: Sequence[tuple[str, int]]
) -> None:
    """Sends names of lines, each in the colour of its line, at a time [ns]."""
    texts = [f"\u25a0 {drawable(name)}" for name, _ in names]
    colours = np.array([colour for _, colour in names], np.uint32)
    data = rr.TextLog.columns(text=texts, color=colours)
    rec.send_columns(path, times(np.full(len(names), t)), data)


_State = tuple[str, int]  # name and colour
States = tuple[_State, ...]


def _states(names_: Sequence[str], *colours: str) -> tuple[_State, ...]:
    return tuple(zip(names_, map(palette.rgba, colours), strict=True))


# The first colour is that of a state in which nothing is the matter.
BRAKE = _states(("released", "applied"), palette.OFF, palette.BLUE)
REGION_STATES = _states(REGION_TITLES, palette.OFF, palette.BLUE, palette.GREEN, palette.VERMILLION)
WHEELS = _states(
    ("rolls", "slides", "locked", "stands"),
    palette.OFF, palette.ORANGE, palette.VERMILLION, palette.LIGHT,
)  # fmt: skip
STANDS = 3  # of `WHEELS`
SWITCHES = _states(("off", "on"), palette.OFF, palette.GREEN)
VALVES = _states(("apply", "hold", "vent"), palette.BLUE, palette.ORANGE, palette.VERMILLION)


def level_states(names_: Sequence[str]) -> States:
    """States of the levels of a command: the first is that in which it demands nothing."""
    colours = (palette.OFF, *(palette.nth(i) for i in range(len(names_) - 1)))
    return _states([drawable(name) for name in names_], *colours)


def send_states(
    rec: rr.RecordingStream,
    path: str,
    times: Clock,
    t: Times,
    codes: NDArray[np.int8],
    states: Sequence[_State],
) -> None:
    """States by their code, −1 for none, a row per change."""
    names_, colours = zip(*states, strict=True)
    style = rr.StateConfiguration(values=list(names_), colors=np.array(colours, np.uint32))
    rec.log(path, style, static=True)
    change_rows = np.flatnonzero(np.diff(codes, prepend=-2))
    labels = [states[c][0] if c >= 0 else "" for c in codes[change_rows].tolist()]
    rec.send_columns(path, times(t[change_rows]), rr.StateChange.columns(state=labels))


def send_band(
    rec: rr.RecordingStream, path: str, times: Clock, t: Times, lower: float, upper: float
) -> None:
    """Sends the edges of a band of the AND-test, from the first time to the last."""
    colour, band_edges = REGION_STATES[2][1], np.ones(2)
    edges = [("least", colour, lower * band_edges), ("most", colour, upper * band_edges)]
    send_plot(rec, f"{path}/band", times, t[[0, -1]], lines("", edges, 1.0))


class DrawnRows(NamedTuple):
    """Rows to draw as one line, in the order of time; shape (m,)."""

    t: Times  # of the rows [ns], rising
    row: NDArray[np.int64]  # of the record, −1 for one without values: a break in each line
    inside: Bools  # whether the row lies in a segment

    def select(self, draw_mask: Bools) -> "DrawnRows":
        """Some of the rows, by a mask of shape (m,)."""
        return DrawnRows(self.t[draw_mask], self.row[draw_mask], self.inside[draw_mask])


def rows_of_axle(axle: AxleResult) -> DrawnRows:
    """Rows to draw: each sample, and a break wherever a segment ends.

    The viewer sorts rows by time. What came after a clock was set back would be mixed with what
    came before: it is drawn from where its times pass those.
    """
    t = axle.record.t
    inside = np.zeros(len(t), bool)
    for s in axle.record.segments:
        inside[s] = True
    bounds = {b for s in axle.record.segments for b in (s.start, s.stop)}
    edges = np.array(sorted(bounds - {0, len(t)}), np.int64)
    index = np.insert(np.arange(len(t)), edges, -1)
    times, inside = np.insert(t, edges, t[edges - 1] + 1), np.insert(inside, edges, False)
    is_newest = np.diff(np.maximum.accumulate(times), prepend=times[:1] - 1) > 0
    return DrawnRows(times, index, inside).select(is_newest)


# ---- views


class Layout(rrb.Blueprint):
    """The whole window: a tab for each layout, panels shut, one time axis; `live` follows."""

    def __init__(self, layouts: Sequence[rrb.Container], timeline: str, live: bool = False) -> None:
        play_state: Literal["following", "paused"] = "following" if live else "paused"
        super().__init__(
            layouts[0] if len(layouts) == 1 else rrb.Tabs(*layouts),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="collapsed", timeline=timeline, play_state=play_state),
            auto_views=False,
            auto_layout=False,
        )

    def disconnect(self) -> None:
        """Ends the SDK's own recording of this layout, which else keeps two threads for ever."""
        self._stream.disconnect()

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        # Linked charts take the range of a view that has no name in the API; the default of that
        # one is half a minute around the cursor.
        super()._log_to_stream(stream)
        everything = rr.encodings.TimeRange(*[rr.TimeRangeBoundary.infinite()] * 2)
        stream.log(f"{GLOBAL_VIEW}/TimeAxis", rrb.TimeAxis(view_range=everything))


def chart(origin: str, name: str, span: tuple[float, float] | None = None) -> rrb.View:
    """The plots below an entity over time, in this range; the title has the colours, or names."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def slope_charts(path: str, title: str, slope: Floats, bands: Bands | None) -> list[rrb.View]:
    """Slope and confidence; the steep slopes, at next to no slip, would flatten the rest."""
    green = f", green: band {bands.slope_low:g} to {bands.slope_high:g}" if bands else ""
    finite = slope[np.isfinite(slope)]
    quantiles = np.quantile(finite, [0.05, 0.9]) if len(finite) else np.zeros(2)
    span = span_of([np.clip(quantiles, -5.0, 5.0), np.array([-0.25, 0.25])], [])
    return [
        chart(f"{path}/slope", f"{title}: slope of µ over slip{green}", span),
        chart(f"{path}/confidence", f"{title}: confidence in the slope", (0.0, 1.05)),
    ]


def names_view(origin: str) -> rrb.View:
    """The names that `send_names` sends."""
    return list_view(origin, "Lines", ["$origin/**"], ("Body",))


def named_charts(
    name: str, charts: Sequence[rrb.View], lines: str, heights: list[float] | None = None
) -> rrb.Container:
    """A tab of charts with the names of their lines beside them."""
    column = rrb.Vertical(*charts, row_shares=heights)
    return rrb.Horizontal(column, names_view(lines), column_shares=[6, 1], name=name)


def list_view(
    origin: str,
    name: str,
    contents: list[str],
    columns: tuple[Literal["LogLevel", "Body"], ...] = ("LogLevel", "Body"),
) -> rrb.View:
    """Rows of text; their times stand in them."""
    time = rrb.encodings.TimelineColumn("time", visible=False)
    return rrb.TextLogView(
        origin=origin,
        name=name,
        contents=contents,
        columns=rrb.TextLogColumns(timeline_columns=[time], text_log_columns=list(columns)),
    )


def states_view(origin: str, name: str, contents: Sequence[str] = ("$origin/**",)) -> rrb.View:
    """Lanes of states over time."""
    axis = rrb.TimeAxis(link="LinkToGlobal")
    return rrb.StateTimelineView(origin=origin, name=name, contents=contents, time_view=axis)


def span_of(
    full_columns: Sequence[Floats], limited_columns: Sequence[Floats], bands: Sequence[Floats] = ()
) -> tuple[float, float] | None:
    """Range of a chart: all of some series, of others all but their rarest spikes, most of bands.

    The viewer's own range leaves out the bands, and one wild sample flattens everything else.
    """
    extremes = [0.0]
    for columns, share, rows in (
        (full_columns, 0.0, None),
        (limited_columns, 0.001, JUDGED),
        (bands, 0.02, JUDGED),
    ):
        for values in columns:
            judged = values[:: max(1, len(values) // rows)] if rows else values
            finite = judged[np.isfinite(judged)]
            extremes += np.quantile(finite, [share, 1.0 - share]).tolist() if len(finite) else []
    lowest, highest = min(extremes), max(extremes)
    margin = 0.05 * (highest - lowest)
    return (lowest - margin, highest + margin) if margin > 0.0 else None
