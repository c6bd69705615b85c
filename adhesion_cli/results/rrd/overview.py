"""The first tab of several axles: all of them on common charts."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core import physics
from ...core.model import AxleResult, Floats, Result
from ...rail.events import Slide
from .. import palette
from . import parts, rows

_SLIP = 3.0  # least range of slip [%]
_MOST = 20  # slides that are listed


Slides = Mapping[int, Sequence[Slide]]  # of each axle, by its number


def worst(slides: Sequence[Slide]) -> float:
    """The largest slip of an axle's slides; 0 without a slide."""
    return max((x.max_slip for x in slides), default=0.0)


def listed(slides: Slides, start_ns: int) -> str:
    """Slides as Markdown, the deepest first; their times count from the start of the log."""
    found = [(axle, x) for axle, of in slides.items() for x in of]
    if not found:
        return "none"
    found.sort(key=lambda of: -of[1].max_slip)
    lines = ["| axle | at [s] | for [s] | distance [m] | max slip [%] |", "|---|---|---|---|---|"]
    for axle, x in found[:_MOST]:
        at, bound = (x.start - start_ns) / 1e9, "≥ " * x.at_least
        numbers = f"{x.duration:.2f}", f"{x.distance:.1f}", f"{100.0 * min(x.max_slip, 1.0):.1f}"
        lines.append(f"| {axle} | {at:.2f} | {' | '.join(bound + n for n in numbers)} |")
    if len(found) > _MOST:
        lines.append(f"\n{len(found) - _MOST} slides more are in the result file.")
    return "\n".join(lines)


def send(rec: rr.RecordingStream, root: str, times: parts.Clock, result: Result) -> None:
    """Sends a line per axle and chart, each span of samples by its lowest and highest value.

    Args:
        rec: where to.
        root: of the log's entities.
        times: of time stamps.
        result: of several axles.
    """
    for i, axle in enumerate(result.axles):
        t, index, inside = rows.of_axle(axle)
        first = np.arange(0, len(t), -(-2 * len(t) // rows.OVERVIEW))
        for path, name, colour, values in _lines(result, axle, palette.rgba(palette.nth(i))):
            known = (index >= 0) & (inside | path.startswith("speed"))
            line = parts.lines(path, [(name, colour, np.where(known, values[index], np.nan))])
            parts.send_plot(rec, f"{root}/all/{path}", times, *rows.envelope(t, line, first))


def _lines(result: Result, axle: AxleResult, colour: int) -> Iterator[tuple[str, str, int, Floats]]:
    """Chart and entity, name, colour and values (n,) of each line of an axle."""
    record, F = axle.record, axle.reference.force
    N, name = record.axle, f"axle {record.axle}"
    if record.train_speed is not None and axle is result.axles[0]:
        yield "speed/train", "train", parts.TRAIN, record.train_speed * 3.6
    rim = record.wheel_speed * result.vehicle.radius(N).value
    yield f"speed/{N}", name, colour, rim * 3.6
    yield f"force/{N}", name, colour, F / 1e3
    yield f"coefficient/{N}", name, colour, physics.coefficient(F, result.vehicle)
    if axle.slip is not None:
        yield f"slip/{N}", name, colour, 100.0 * axle.slip


def tab(root: str, result: Result, slides: Slides) -> rrb.Container:
    """Speeds, forces, coefficients and slips of all axles, one chart each."""
    forces = [a.reference.force / 1e3 for a in result.axles]
    mu = [physics.coefficient(a.reference.force, result.vehicle) for a in result.axles]
    path = f"{root}/all"
    charts = [
        parts.chart(f"{path}/speed", "All axles: speed [km/h]", legend="RightTop"),
        parts.chart(
            f"{path}/force", "All axles: adhesion force, reference [kN]",
            parts.span_of([], forces), legend=None,
        ),
        parts.chart(
            f"{path}/coefficient", "All axles: adhesion coefficient µ",
            parts.span_of([], mu), legend=None,
        ),
    ]  # fmt: skip
    if any(a.slip is not None for a in result.axles):
        top = 100.0 * max(min(worst(of), 1.0) for of in slides.values())
        span = (-0.1 * max(top, _SLIP), 1.1 * max(top, _SLIP))
        charts.append(parts.chart(f"{path}/slip", "All axles: slip [%]", span, legend=None))
    summary = rrb.TextDocumentView(origin=f"{root}/summary", name="Summary")
    return rrb.Horizontal(rrb.Vertical(*charts), summary, column_shares=[2, 1], name="All axles")
