"""Line charts as SVG: small enough to need no plotting library, plain enough for a web page."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from ..core.model import Floats
from .verified import verified

COLOURS = ("#2f6fb3", "#d9822b", "#c23b3b", "#7d57b5", "#238a80", "#a08a00", "#c75b86", "#7a5636")
BLACK, GREY = "#222222", "#999999"

_WIDTH, _HEIGHT = 330, 190  # of a panel's frame
_LEFT, _RIGHT, _TOP, _BOTTOM, _LEGEND = 62, 14, 30, 40, 15  # around it
_HEAD = 34  # above the panels
_ABREAST = 3  # names in a row of the legend
_SHADE = 0.16  # opacity of a band


@dataclass(frozen=True, slots=True)
class Line:
    """One curve; NaN, and what a logarithmic axis cannot show, leave a hole."""

    name: str  # in the legend; "" for none
    x: Floats
    y: Floats
    colour: str
    dashed: bool = False
    dots: float = 0.0  # diameter of its points, which then stand alone


@dataclass(frozen=True, slots=True)
class Band:
    """A span of x, or of y, with a shade over it."""

    name: str  # in the legend
    low: float
    high: float
    colour: str
    of_x: bool = True


@dataclass(frozen=True, slots=True)
class Panel:
    """One chart."""

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    log_x: bool = False
    log_y: bool = False
    y_range: tuple[float, float] | None = None  # None: all there is
    x_range: tuple[float, float] | None = None
    bands: Sequence[Band] = ()
    x_names: Sequence[str] = ()  # of x 0, 1, 2 … in place of numbers


def write(path: Path, title: str, panels: Sequence[Panel], columns: int = 2) -> None:
    """Write the panels row by row under a title.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    legend = max(-(-len(_keys(p)) // _ABREAST) for p in panels) * _LEGEND
    wide, high = _LEFT + _WIDTH + _RIGHT, _TOP + _HEIGHT + _BOTTOM + legend
    columns = min(columns, len(panels))
    width, height = columns * wide, _HEAD + -(-len(panels) // columns) * high
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}" font-family="sans-serif" font-size="11" fill="{BLACK}">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        _text(width / 2, 22, title, "middle", 'font-size="14" font-weight="bold"'),
    ]
    for i, panel in enumerate(panels):
        x, y = i % columns * wide + _LEFT, _HEAD + i // columns * high + _TOP
        parts += [f'<g transform="translate({x},{y})">', *_panel(panel), "</g>"]
    with verified(path) as file:
        file.write("\n".join([*parts, "</svg>", ""]).encode())


def _panel(panel: Panel) -> Iterator[str]:
    xs = _Axis.over([line.x for line in panel.lines], panel.log_x, _WIDTH, panel.x_range)
    ys = _Axis.over([line.y for line in panel.lines], panel.log_y, _HEIGHT, panel.y_range)
    names = xs.place(np.arange(len(panel.x_names), dtype=np.float64)).tolist()
    numbered = zip(names, panel.x_names, strict=True) if names else xs.ticks()
    for i, (at, label) in enumerate(numbered):
        yield f'<path d="M{at:.1f} 0V{_HEIGHT}" stroke="#e6e6e6"/>'
        low = 12 * (i % 2) if names else 0  # every other name, for room
        yield _text(at, _HEIGHT + 14 + low, label, "middle")
    for at, label in ys.ticks():
        yield f'<path d="M0 {_HEIGHT - at:.1f}H{_WIDTH}" stroke="#e6e6e6"/>'
        yield _text(-5, _HEIGHT - at + 4, label, "end")
    yield f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="none" stroke="{GREY}"/>'
    yield f'<svg width="{_WIDTH}" height="{_HEIGHT}">'  # cuts off what lies outside
    for band in panel.bands:
        ends = np.array([band.low, band.high])
        if band.of_x:
            a, b = xs.place(ends).tolist()
            place = f'x="{a:.1f}" y="0" width="{b - a:.1f}" height="{_HEIGHT}"'
        else:
            b, a = (_HEIGHT - ys.place(ends)).tolist()
            place = f'x="0" y="{a:.1f}" width="{_WIDTH}" height="{b - a:.1f}"'
        yield f'<rect {place} fill="{band.colour}" fill-opacity="{_SHADE}"/>'
    for line in panel.lines:
        draw, look = (_dots, _dotted(line.dots)) if line.dots else (_curve, _line(line, 1.3))
        data = draw(xs.place(line.x), _HEIGHT - ys.place(line.y))
        yield f'<path d="{data}" fill="none" stroke="{line.colour}" {look}/>'
    yield "</svg>"
    yield _text(_WIDTH / 2, -9, panel.title, "middle", 'font-weight="bold"')
    yield _text(_WIDTH / 2, _HEIGHT + 30, panel.x_label, "middle")
    turned = f'transform="rotate(-90)" fill="{BLACK}"'
    yield _text(-_HEIGHT / 2, -_LEFT + 13, panel.y_label, "middle", turned)
    for i, key in enumerate(_keys(panel)):
        x, y = i % _ABREAST * _WIDTH / _ABREAST, _HEIGHT + _BOTTOM + 4 + i // _ABREAST * _LEGEND
        way, look = "h18", f'stroke-opacity="{_SHADE}" stroke-width="11"'
        if isinstance(key, Line):
            way, look = ("m9 0h0", _dotted(6.0)) if key.dots else (way, _line(key, 2))
        yield f'<path d="M{x:.0f} {y}{way}" stroke="{key.colour}" {look}/>'
        yield _text(x + 22, y + 4, key.name, "start")


def _keys(panel: Panel) -> list[Line | Band]:
    """What has a place in the legend."""
    keys: list[Line | Band] = [*panel.lines, *panel.bands]
    return [key for key in keys if key.name]


def _line(line: Line, width: float) -> str:
    return f'stroke-width="{width}"' + (' stroke-dasharray="5 3"' if line.dashed else "")


def _dotted(width: float) -> str:
    return f'stroke-width="{width}" stroke-linecap="round"'


@dataclass(frozen=True, slots=True)
class _Axis:
    """From numbers to pixels; `low` and `high` are logarithms on a logarithmic axis."""

    low: float
    high: float
    log: bool
    length: float

    @classmethod
    def over(
        cls,
        columns: Sequence[Floats],
        log: bool,
        length: float,
        limits: tuple[float, float] | None = None,
    ) -> "_Axis":
        values = np.concatenate([*columns, [*(limits or ())]])
        values = _scaled(np.asarray(limits, np.float64) if limits else values, log)
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        if low == high:
            low, high = low - 0.5, high + 0.5
        margin = 0.0 if limits else 0.03 * (high - low)
        return cls(low - margin, high + margin, log, length)

    def place(self, values: Floats) -> Floats:
        placed: Floats = (_scaled(values, self.log) - self.low) / (self.high - self.low)
        return placed * self.length

    def ticks(self) -> Iterator[tuple[float, str]]:
        """Pixels and labels: 1-2-5 steps, decades, or 1-2-5 within few decades."""
        span = self.high - self.low
        if self.log:
            decades = range(math.floor(self.low), math.ceil(self.high) + 1)
            some = decades[:: math.ceil(span / 6.0)]
            values = [m * 10.0**k for k in some for m in ((1, 2, 5) if span < 2.5 else (1,))]
        else:
            power = 10.0 ** math.floor(math.log10(span / 8.0))
            step = next(m * power for m in (1, 2, 5, 10) if m * power >= span / 8.0)
            first = math.floor(self.low / step)
            values = [k * step for k in range(first, first + 11)]
        places = self.place(np.array(values))
        for value, at in zip(values, places.tolist(), strict=True):
            if -0.5 <= at <= self.length + 0.5:
                yield at, f"{value + 0.0:.6g}"


def _scaled(values: Floats, log: bool) -> Floats:
    values = np.asarray(values, np.float64)
    if not log:
        return values
    positive = values > 0.0
    return np.where(positive, np.log10(np.where(positive, values, 1.0)), np.nan)


def _curve(x: Floats, y: Floats) -> str:
    """Path through the points; of many in one pixel column only the lowest and the highest."""
    known = np.isfinite(x) & np.isfinite(y)
    if len(x) > 4 * _WIDTH:
        column = np.floor(np.where(known, x, -1.0))
        ends = np.flatnonzero(np.diff(column, prepend=np.nan, append=np.nan) != 0)
        kept = []
        for a, b in pairwise(ends):
            if known[a]:
                kept += sorted({a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))})
            else:
                kept.append(a)
        x, y, known = x[kept], y[kept], known[kept]
    parts, pen = [], "M"
    for a, b, there in zip(x.tolist(), np.clip(y, -1e4, 1e4).tolist(), known.tolist(), strict=True):
        if there:
            parts.append(f"{pen}{a:.1f} {b:.1f}")
        pen = "L" if there else "M"
    return "".join(parts)


def _dots(x: Floats, y: Floats) -> str:
    """A dot at every point, to the pixel; one below the other are a line."""
    known = np.isfinite(x) & np.isfinite(y) & (np.abs(x) < 1e4) & (np.abs(y) < 1e4)
    places = np.unique(np.round(np.stack([x[known], y[known]], axis=1)), axis=0)
    gaps = np.flatnonzero((np.diff(places, axis=0) != [0.0, 1.0]).any(axis=1)) + 1
    ends = [0, *gaps.tolist(), len(places)] if len(places) else []
    runs = [(*places[a], b - a - 1) for a, b in pairwise(ends)]
    return "".join(f"M{a:g} {b:g}v{n}" for a, b, n in runs)


def _text(x: float, y: float, text: str, anchor: str, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" {more}>{escape(text)}</text>'
